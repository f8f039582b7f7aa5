//! A graph flattened to a list of instructions on intervals, in the manner of [`crate::ir::eval::Tape`].

use super::number::{Interval, MAX_TERMS, binary, compare, polynomial, power, unary};
use super::pyramid::{Extremes, sample_gradient_range, sample_range};
use super::tables::TableBounds;
use crate::ir::eval::cell_hash;
use crate::ir::eval::registers::{Register, Registers};
use crate::ir::{Binary, Compare, Filter, Fold, Graph, GridId, Input, NodeId, Op, Step, TableId, Unary, schedule};
use rustc_hash::FxHashMap;

/// Where a field is to be bounded.
#[derive(Clone, Debug)]
pub struct Region<'a> {
    /// A box of positions, in units of length.
    pub position: [Interval; 3],
    /// Directions, each component on its own.
    pub direction: [Interval; 3],
    /// Cosine of the scattering angle.
    pub cos_theta: Interval,
    /// Seconds.
    pub time: Interval,
    /// Altitude over each shell of the scene; see [`altitudes`].
    pub altitudes: &'a [Interval],
    /// Values of parameters, in the graph's units; nothing is known of those that are missing.
    pub params: &'a [Vec<Interval>],
    /// The graph's tables for these parameters and times.
    pub tables: &'a TableBounds,
}

impl Default for Region<'static> {
    /// All of space, at any time.
    fn default() -> Self {
        const UNIT: Interval = Interval { low: -1.0, high: 1.0, nan: false };
        Self {
            position: [Interval::NUMBER; 3],
            direction: [UNIT; 3],
            cos_theta: UNIT,
            time: Interval::NUMBER,
            altitudes: &[],
            params: &[],
            tables: const { &TableBounds::NONE },
        }
    }
}

/// The altitude over a shell within a box of positions.
#[must_use]
pub fn altitudes(position: [Interval; 3], center: [f64; 3], radius: f64) -> Interval {
    let mut square = Interval::point(0.0);
    for axis in 0..3 {
        let from = binary(Binary::Sub, position[axis], Interval::point(center[axis]));
        square = binary(Binary::Add, square, power(from, 2));
    }
    binary(Binary::Sub, unary(Unary::Sqrt, square), Interval::point(radius))
}

#[derive(Clone, Debug)]
enum Instruction {
    Input(Input, u8, Register),
    Param(u32, u8, Register),
    Unary(Unary, Register, Register),
    Binary(Binary, Register, Register, Register),
    Power(i32, Register, Register),
    /// x − ⌊x⌋
    Fraction(Register, Register),
    /// Narrows a register by what the polynomial it is of another one can be.
    Polynomial(Register, Vec<f64>, Register),
    Compare(Compare, Register, Register, Register),
    Select(Register, Register, Register, Register),
    Dot(Vec<(Register, Register)>, Register),
    Sample(GridId, (Filter, [u32; 3], f64), [Register; 3], Register),
    SampleGradient(GridId, (Filter, [u32; 3]), [Register; 3], Register),
    Lookup(TableId, Register, u8, Register),
    LookupSlope(TableId, Register, u8, Register),
    CellHash([Register; 3], Register, Register),
    Loop {
        range: (i32, i32),
        fold: Fold,
        variable: Register,
        code: Vec<Instruction>,
        body: Vec<Register>,
        out: Register,
    },
}

/// A compiled evaluation of some roots of a graph over regions.
#[derive(Clone, Debug)]
pub struct Enclosure {
    code: Vec<Instruction>,
    constants: Vec<(Register, f64)>,
    registers: u32,
    roots: Vec<Vec<Register>>,
}

/// Registers of one evaluation; made by [`Enclosure::workspace`], reused from run to run.
#[derive(Clone, Debug)]
pub struct Workspace(Vec<Interval>);

impl Enclosure {
    /// Compiles the evaluation of `roots`.
    #[must_use]
    pub fn new(graph: &Graph, roots: &[NodeId]) -> Self {
        let mut builder = Builder {
            graph,
            registers: Registers::new(graph),
            polynomials: FxHashMap::default(),
            floors: FxHashMap::default(),
        };
        let code = builder.steps(&schedule(graph, roots));
        let roots = roots.iter().map(|r| builder.registers.get(*r)).collect();
        let Registers { constants, count, .. } = builder.registers;
        Self { code, constants, registers: count, roots }
    }

    /// How much work a run is, in simple instructions.
    #[must_use]
    pub fn cost(&self) -> u64 {
        cost(&self.code).max(1)
    }

    /// Registers for this evaluation.
    #[must_use]
    pub fn workspace(&self) -> Workspace {
        let mut registers = vec![Interval::point(0.0); self.registers as usize];
        for (r, v) in &self.constants {
            registers[*r as usize] = Interval::point(*v);
        }
        Workspace(registers)
    }

    /// Evaluates over a region. `work` must come from this enclosure.
    pub fn run(&self, region: &Region<'_>, voxels: &(impl Extremes + ?Sized), work: &mut Workspace) {
        run(&self.code, region, voxels, &mut work.0);
    }

    /// Components of root `i` after a run.
    #[must_use]
    pub fn root(&self, work: &Workspace, i: usize) -> Vec<Interval> {
        self.roots[i].iter().map(|r| work.0[*r as usize]).collect()
    }

    /// All components of root `i` together.
    #[must_use]
    pub fn hull(&self, work: &Workspace, i: usize) -> Interval {
        let parts = self.roots[i].iter().map(|r| work.0[*r as usize]);
        parts.reduce(Interval::hull).unwrap_or(Interval::ANY)
    }
}

/// A register as Σ cᵢ tⁱ of another one; a constant has none.
#[derive(Clone, Debug)]
struct Polynomial {
    base: Option<Register>,
    terms: Vec<f64>,
}

impl Polynomial {
    fn is_monomial(&self) -> bool {
        self.terms.iter().filter(|c| **c != 0.0).count() <= 1
    }

    fn combine(op: Binary, a: &Self, b: &Self) -> Option<Self> {
        let base = match (a.base, b.base) {
            (Some(x), Some(y)) if x != y => return None,
            (x, y) => x.or(y),
        };
        let term = |p: &Self, i: usize| p.terms.get(i).copied().unwrap_or(0.0);
        let most = a.terms.len().max(b.terms.len());
        let terms: Vec<f64> = match op {
            Binary::Add => (0..most).map(|i| term(a, i) + term(b, i)).collect(),
            Binary::Sub => (0..most).map(|i| term(a, i) - term(b, i)).collect(),
            Binary::Mul => {
                let mut out = vec![0.0; a.terms.len() + b.terms.len() - 1];
                for (i, x) in a.terms.iter().enumerate() {
                    for (j, y) in b.terms.iter().enumerate() {
                        out[i + j] += x * y;
                    }
                }
                out
            }
            Binary::Div if b.base.is_none() => a.terms.iter().map(|x| x / b.terms[0]).collect(),
            Binary::Div
            | Binary::Min
            | Binary::Max
            | Binary::Pow
            | Binary::Atan2
            | Binary::Mod
            | Binary::And
            | Binary::Or => return None,
        };
        // Coefficients are rounded; only where they are moderate is that covered by the room that the evaluation leaves.
        (terms.len() <= MAX_TERMS && terms.iter().all(|c| c.is_finite() && c.abs() < 1e100))
            .then_some(Self { base, terms })
    }
}

struct Builder<'a> {
    graph: &'a Graph,
    registers: Registers,
    polynomials: FxHashMap<Register, Polynomial>,
    /// Which register each ⌊x⌋ is of.
    floors: FxHashMap<Register, Register>,
}

impl Builder<'_> {
    fn steps(&mut self, steps: &[Step]) -> Vec<Instruction> {
        let mut code = vec![];
        for step in steps {
            match step {
                Step::Node(id) => self.node(*id, &mut code),
                Step::Loop(id, inner) => {
                    let Op::Reduce { fold, depth, start, end, body } = *self.graph.op(*id) else { continue };
                    let scope = self.registers.enter(depth);
                    let variable = scope.variable;
                    let code_inside = self.steps(inner);
                    let (body, out) = self.registers.leave(scope, *id, body);
                    code.push(Instruction::Loop { range: (start, end), fold, variable, code: code_inside, body, out });
                }
            }
        }
        code
    }

    /// A register as a polynomial: of itself if nothing better is known.
    fn polynomial(&self, r: Register) -> Polynomial {
        let own = || Polynomial { base: Some(r), terms: vec![0.0, 1.0] };
        self.polynomials.get(&r).cloned().unwrap_or_else(own)
    }

    fn binary(&mut self, op: Binary, x: Register, y: Register, out: Register, code: &mut Vec<Instruction>) {
        if op == Binary::Sub && self.floors.get(&y) == Some(&x) {
            code.push(Instruction::Fraction(x, out));
            return;
        }
        code.push(match op {
            Binary::Mul if x == y => Instruction::Power(2, x, out),
            _ => Instruction::Binary(op, x, y, out),
        });
        if let Some(p) = Polynomial::combine(op, &self.polynomial(x), &self.polynomial(y)) {
            self.narrow(p, out, code);
        }
    }

    fn narrow(&mut self, p: Polynomial, out: Register, code: &mut Vec<Instruction>) {
        if let Some(base) = p.base.filter(|_| p.terms.len() > 2 && !p.is_monomial()) {
            code.push(Instruction::Polynomial(base, p.terms.clone(), out));
        }
        self.polynomials.insert(out, p);
    }

    fn node(&mut self, id: NodeId, code: &mut Vec<Instruction>) {
        let op = *self.graph.op(id);
        let width = self.graph.width(id);
        let registers = match self.registers.without_instruction(op) {
            Some(registers) => registers,
            None if matches!(op, Op::LoopVar(_) | Op::Reduce { .. }) => return, // bound by its loop
            None => {
                let out = self.registers.fresh(width);
                self.operation(op, (out, width), code);
                (out..out + u32::from(width)).collect()
            }
        };
        self.registers.set(id, registers);
    }

    fn operation(&mut self, op: Op, (out, width): (Register, u8), code: &mut Vec<Instruction>) {
        let each = (0..width).map(|c| (c as usize, out + u32::from(c)));
        match op {
            Op::Input(i) => each.for_each(|(c, r)| code.push(Instruction::Input(i, c as u8, r))),
            Op::Param(p) => each.for_each(|(c, r)| code.push(Instruction::Param(p.0, c as u8, r))),
            Op::Unary(u, a) => {
                let a = self.registers.get(a);
                for (c, r) in each {
                    code.push(Instruction::Unary(u, a[c], r));
                    if u == Unary::Floor {
                        self.floors.insert(r, a[c]);
                    }
                    if u == Unary::Neg {
                        let mut p = self.polynomial(a[c]);
                        p.terms.iter_mut().for_each(|x| *x = -*x);
                        self.polynomials.insert(r, p);
                    }
                }
            }
            Op::Binary(b, x, y) => {
                let (x, y) = (self.registers.get(x), self.registers.get(y));
                each.for_each(|(c, r)| self.binary(b, x[c], y[c], r, code));
            }
            Op::PowI(a, n) => {
                let a = self.registers.get(a);
                for (c, r) in each {
                    code.push(Instruction::Power(n, a[c], r));
                    let base = self.polynomial(a[c]);
                    let powers = (1..n).try_fold(base.clone(), |p, _| Polynomial::combine(Binary::Mul, &p, &base));
                    if let Some(p) = powers.filter(|_| (1..=9).contains(&n)) {
                        self.polynomials.insert(r, p);
                    }
                }
            }
            Op::Compare(c, x, y) => {
                code.push(Instruction::Compare(c, self.registers.get(x)[0], self.registers.get(y)[0], out))
            }
            Op::Select { condition, accept, reject } => {
                let (c, x, y) =
                    (self.registers.get(condition)[0], self.registers.get(accept), self.registers.get(reject));
                each.for_each(|(i, r)| code.push(Instruction::Select(c, x[i], y[i], r)));
            }
            Op::Dot(a, b) => {
                code.push(Instruction::Dot(self.registers.get(a).into_iter().zip(self.registers.get(b)).collect(), out))
            }
            Op::Sample { grid, at } => {
                let info = self.graph.grid(grid);
                let facts = (info.filter, info.header.dims, info.outside);
                code.push(Instruction::Sample(grid, facts, self.registers.three(at), out));
            }
            Op::SampleGradient { grid, at } => {
                let info = self.graph.grid(grid);
                code.push(Instruction::SampleGradient(
                    grid,
                    (info.filter, info.header.dims),
                    self.registers.three(at),
                    out,
                ));
            }
            Op::Lookup { table, at } => code.push(Instruction::Lookup(table, self.registers.get(at)[0], width, out)),
            Op::LookupSlope { table, at } => {
                code.push(Instruction::LookupSlope(table, self.registers.get(at)[0], width, out))
            }
            Op::CellHash { cell, seed } => {
                code.push(Instruction::CellHash(self.registers.three(cell), self.registers.get(seed)[0], out));
            }
            Op::Const(_)
            | Op::Truth(_)
            | Op::LoopVar(_)
            | Op::Splat(..)
            | Op::Extract(..)
            | Op::Compose(..)
            | Op::Reduce { .. } => unreachable!("has no instruction of its own"),
        }
    }
}

fn cost(code: &[Instruction]) -> u64 {
    let one = |i: &Instruction| match i {
        Instruction::Input(..)
        | Instruction::Param(..)
        | Instruction::Unary(..)
        | Instruction::Binary(..)
        | Instruction::Power(..)
        | Instruction::Fraction(..)
        | Instruction::Compare(..)
        | Instruction::Select(..)
        | Instruction::Dot(..) => 1,
        Instruction::Polynomial(..) | Instruction::LookupSlope(..) => 4,
        Instruction::Lookup(..) | Instruction::CellHash(..) => 8,
        // Up to 125 voxels are read one by one.
        Instruction::Sample(..) | Instruction::SampleGradient(..) => 40,
        Instruction::Loop { range, code, .. } => {
            u64::from((range.1 - range.0).max(0).unsigned_abs()).saturating_mul(1 + cost(code))
        }
    };
    code.iter().map(one).fold(0, u64::saturating_add)
}

fn input(input: Input, c: usize, region: &Region<'_>) -> Interval {
    let side = |sign: f64| {
        binary(Binary::Add, Interval::point(1.0), {
            let c = region.cos_theta;
            if sign > 0.0 { c } else { unary(Unary::Neg, c) }
        })
    };
    match input {
        Input::Position => region.position[c],
        Input::Direction => region.direction[c],
        Input::CosTheta => region.cos_theta,
        Input::Versine => side(-1.0),
        Input::Vercosine => side(1.0),
        Input::Time => region.time,
        Input::Altitude(shell) => region.altitudes.get(shell as usize).copied().unwrap_or(Interval::NUMBER),
    }
}

/// Most cells whose hashes are looked at one by one.
const MOST_CELLS: f64 = 8.0;

fn hashes(cell: [Interval; 3], seed: Interval) -> [Interval; 3] {
    let all = [Interval { low: 0.0, high: 1.0, nan: false }; 3];
    let axes = [cell[0], cell[1], cell[2], seed].map(|i| (i.low.floor(), i.high.floor()));
    let count: f64 = axes.iter().map(|a| a.1 - a.0 + 1.0).product();
    let sure = cell.iter().chain([&seed]).all(|i| i.is_finite() && i.magnitude() < 2e9);
    if !(sure && count <= MOST_CELLS) {
        return all;
    }
    let mut out: Option<[Interval; 3]> = None;
    let steps = |a: (f64, f64)| (0..=(a.1 - a.0) as i32).map(move |i| a.0 + f64::from(i));
    for s in steps(axes[3]) {
        for z in steps(axes[2]) {
            for y in steps(axes[1]) {
                for x in steps(axes[0]) {
                    let own = cell_hash([x, y, z], s).map(Interval::point);
                    out = Some(match out {
                        Some(so_far) => [0, 1, 2].map(|c| so_far[c].hull(own[c])),
                        None => own,
                    });
                }
            }
        }
    }
    out.unwrap_or(all)
}

fn run(code: &[Instruction], region: &Region<'_>, voxels: &(impl Extremes + ?Sized), r: &mut [Interval]) {
    for instruction in code {
        match instruction {
            Instruction::Input(i, c, out) => r[*out as usize] = input(*i, *c as usize, region),
            Instruction::Param(p, c, out) => {
                let known = region.params.get(*p as usize).and_then(|v| v.get(*c as usize));
                r[*out as usize] = known.copied().unwrap_or(Interval::NUMBER);
            }
            Instruction::Unary(op, a, out) => r[*out as usize] = unary(*op, r[*a as usize]),
            Instruction::Binary(op, a, b, out) => r[*out as usize] = binary(*op, r[*a as usize], r[*b as usize]),
            Instruction::Power(n, a, out) => r[*out as usize] = power(r[*a as usize], *n),
            Instruction::Fraction(a, out) => {
                let a = r[*a as usize];
                let within = a.low.floor() == a.high.floor() && a.is_finite();
                let own = Interval { low: 0.0, high: 1.0, nan: a.nan || !a.is_finite() };
                r[*out as usize] =
                    if within { binary(Binary::Sub, a, Interval::point(a.low.floor())).meet(own) } else { own };
            }
            Instruction::Polynomial(base, terms, out) => {
                let own = r[*out as usize];
                if own.low < own.high {
                    r[*out as usize] = own.meet(polynomial(terms, r[*base as usize]));
                }
            }
            Instruction::Compare(op, a, b, out) => r[*out as usize] = compare(*op, r[*a as usize], r[*b as usize]),
            Instruction::Select(c, a, b, out) => {
                let (a, b) = (r[*a as usize], r[*b as usize]);
                r[*out as usize] = match r[*c as usize].exact() {
                    Some(0.0) => b,
                    Some(_) => a,
                    None => a.hull(b),
                };
            }
            Instruction::Dot(pairs, out) => {
                let mut sum = Interval::point(0.0);
                for (a, b) in pairs {
                    let product = if a == b {
                        power(r[*a as usize], 2)
                    } else {
                        binary(Binary::Mul, r[*a as usize], r[*b as usize])
                    };
                    sum = binary(Binary::Add, sum, product);
                }
                r[*out as usize] = sum;
            }
            Instruction::Sample(grid, facts, at, out) => {
                r[*out as usize] = sample_range(*facts, at.map(|a| r[a as usize]), *grid, voxels);
            }
            Instruction::SampleGradient(grid, facts, at, out) => {
                let own = sample_gradient_range(*facts, at.map(|a| r[a as usize]), *grid, voxels);
                (0..3).for_each(|c| r[*out as usize + c] = own);
            }
            Instruction::Lookup(table, at, width, out) => {
                let at = r[*at as usize];
                (0..*width as usize).for_each(|c| r[*out as usize + c] = region.tables.value(*table, at, c));
            }
            Instruction::LookupSlope(table, at, width, out) => {
                let at = r[*at as usize];
                (0..*width as usize).for_each(|c| r[*out as usize + c] = region.tables.slope(*table, at, c));
            }
            Instruction::CellHash(cell, seed, out) => {
                let own = hashes(cell.map(|c| r[c as usize]), r[*seed as usize]);
                (0..3).for_each(|c| r[*out as usize + c] = own[c]);
            }
            Instruction::Loop { range, fold, variable, code, body, out } => {
                let (identity, op) = match fold {
                    Fold::Sum => (0.0, Binary::Add),
                    Fold::Product => (1.0, Binary::Mul),
                    Fold::Min => (f64::INFINITY, Binary::Min),
                    Fold::Max => (f64::NEG_INFINITY, Binary::Max),
                };
                let mut total = [Interval::point(identity); 4];
                for value in range.0..range.1 {
                    r[*variable as usize] = Interval::point(f64::from(value));
                    run(code, region, voxels, r);
                    for (total, body) in total.iter_mut().zip(body) {
                        *total = binary(op, *total, r[*body as usize]);
                    }
                }
                (0..body.len()).for_each(|c| r[*out as usize + c] = total[c]);
            }
        }
    }
}
