//! A graph flattened to a list of scalar instructions over registers of several lanes.
//!
//! One pass over the instructions evaluates [`LANES`] points, which spreads the cost of dispatch and lets the compiler
//! vectorise the arithmetic (the idea of fidget's tapes).

use super::super::schedule::{Step, schedule};
use super::super::{Binary, Compare, Filter, Fold, Graph, GridId, Input, NodeId, Op, TableId, Unary};
use super::registers::{Register, Registers};
use super::{Tables, Voxels, binary, cell_hash, compare, interpolate, interpolate_gradient, unary};

/// Points evaluated at once.
pub const LANES: usize = 8;
/// One scalar at every point.
pub type Lanes = [f64; LANES];

/// What the inputs are.
#[derive(Clone, Debug)]
pub struct Environment<'a> {
    /// Positions, in units of length.
    pub position: [Lanes; 3],
    /// Directions.
    pub direction: [Lanes; 3],
    /// Cosine of the scattering angle.
    pub cos_theta: Lanes,
    /// Seconds.
    pub time: f64,
    /// Altitude over each shell of the scene.
    pub altitudes: &'a [Lanes],
    /// Values of parameters, in the graph's units; truth values as 0 or 1.
    pub params: &'a [Vec<f64>],
    /// The graph's tables for this frame; may be empty if the tape uses none.
    pub tables: &'a Tables,
}

impl Default for Environment<'static> {
    fn default() -> Self {
        static NONE: Tables = Tables(Vec::new());
        Self {
            position: [[0.0; LANES]; 3],
            direction: [[0.0; LANES]; 3],
            cos_theta: [0.0; LANES],
            time: 0.0,
            altitudes: &[],
            params: &[],
            tables: &NONE,
        }
    }
}

#[derive(Clone, Debug)]
enum Instruction {
    Input(Input, u8, Register),
    Param(u32, u8, Register),
    Unary(Unary, Register, Register),
    Binary(Binary, Register, Register, Register),
    PowI(i32, Register, Register),
    Compare(Compare, Register, Register, Register),
    Select(Register, Register, Register, Register),
    Dot(Vec<(Register, Register)>, Register),
    Sample {
        grid: GridId,
        filter: Filter,
        dims: [u32; 3],
        outside: f64,
        at: [Register; 3],
        out: Register,
    },
    SampleGradient {
        grid: GridId,
        filter: Filter,
        dims: [u32; 3],
        at: [Register; 3],
        out: Register,
    },
    Lookup {
        table: TableId,
        at: Register,
        width: u8,
        out: Register,
    },
    LookupSlope {
        table: TableId,
        at: Register,
        width: u8,
        out: Register,
    },
    CellHash {
        cell: [Register; 3],
        seed: Register,
        out: Register,
    },
    Loop {
        start: i32,
        end: i32,
        fold: Fold,
        variable: Register,
        code: Vec<Instruction>,
        body: Vec<Register>,
        out: Register,
    },
}

/// A compiled evaluation of some roots of a graph.
#[derive(Clone, Debug)]
pub struct Tape {
    code: Vec<Instruction>,
    constants: Vec<(Register, f64)>,
    registers: u32,
    roots: Vec<Vec<Register>>,
    tables: bool,
}

/// Registers of one evaluation; made by [`Tape::scratch`], reused from run to run.
#[derive(Clone, Debug)]
pub struct Scratch {
    registers: Vec<Lanes>,
}

impl Tape {
    /// Compiles the evaluation of `roots`.
    #[must_use]
    pub fn new(graph: &Graph, roots: &[NodeId]) -> Self {
        let mut builder = Builder { graph, registers: Registers::new(graph), tables: false };
        let code = builder.steps(&schedule(graph, roots));
        let roots = roots.iter().map(|r| builder.registers.get(*r)).collect();
        let Registers { constants, count, .. } = builder.registers;
        Self { code, constants, registers: count, roots, tables: builder.tables }
    }

    /// Whether [`Environment::tables`] is read.
    #[must_use]
    pub fn uses_tables(&self) -> bool {
        self.tables
    }

    /// Registers for this tape.
    #[must_use]
    pub fn scratch(&self) -> Scratch {
        let mut registers = vec![[0.0; LANES]; self.registers as usize];
        for (r, v) in &self.constants {
            registers[*r as usize] = [*v; LANES];
        }
        Scratch { registers }
    }

    /// Evaluates all lanes. `scratch` must come from this tape.
    pub fn run<V: Voxels + ?Sized>(&self, environment: &Environment<'_>, voxels: &V, scratch: &mut Scratch) {
        run(&self.code, environment, voxels, &mut scratch.registers);
    }

    /// Components of root `i` after a run.
    #[must_use]
    pub fn root(&self, scratch: &Scratch, i: usize) -> Vec<Lanes> {
        self.roots[i].iter().map(|r| scratch.registers[*r as usize]).collect()
    }

    /// Component `c` of root `i` after a run.
    #[must_use]
    pub fn component<'s>(&self, scratch: &'s Scratch, i: usize, c: usize) -> &'s Lanes {
        &scratch.registers[self.roots[i][c] as usize]
    }

    /// Components of root `i`.
    #[must_use]
    pub fn width(&self, i: usize) -> usize {
        self.roots[i].len()
    }
}

struct Builder<'a> {
    graph: &'a Graph,
    registers: Registers,
    tables: bool,
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
                    code.push(Instruction::Loop { start, end, fold, variable, code: code_inside, body, out });
                }
            }
        }
        code
    }

    fn node(&mut self, id: NodeId, code: &mut Vec<Instruction>) {
        let op = *self.graph.op(id);
        let width = self.graph.width(id);
        let registers = match self.registers.without_instruction(op) {
            Some(registers) => registers,
            None if matches!(op, Op::LoopVar(_)) => return, // bound by its loop
            None => {
                let out = self.registers.fresh(width);
                let range = out..out + u32::from(width);
                match op {
                    Op::Input(i) => range.clone().zip(0..).for_each(|(r, c)| code.push(Instruction::Input(i, c, r))),
                    Op::Param(p) => range.clone().zip(0..).for_each(|(r, c)| code.push(Instruction::Param(p.0, c, r))),
                    Op::Unary(u, a) => {
                        range
                            .clone()
                            .zip(self.registers.get(a))
                            .for_each(|(r, a)| code.push(Instruction::Unary(u, a, r)));
                    }
                    Op::Binary(b, x, y) => {
                        for ((r, x), y) in range.clone().zip(self.registers.get(x)).zip(self.registers.get(y)) {
                            code.push(Instruction::Binary(b, x, y, r));
                        }
                    }
                    Op::PowI(a, n) => {
                        range
                            .clone()
                            .zip(self.registers.get(a))
                            .for_each(|(r, a)| code.push(Instruction::PowI(n, a, r)));
                    }
                    Op::Compare(c, x, y) => {
                        code.push(Instruction::Compare(c, self.registers.get(x)[0], self.registers.get(y)[0], out))
                    }
                    Op::Select { condition, accept, reject } => {
                        let c = self.registers.get(condition)[0];
                        for ((r, x), y) in range.clone().zip(self.registers.get(accept)).zip(self.registers.get(reject))
                        {
                            code.push(Instruction::Select(c, x, y, r));
                        }
                    }
                    Op::Dot(a, b) => code.push(Instruction::Dot(
                        self.registers.get(a).into_iter().zip(self.registers.get(b)).collect(),
                        out,
                    )),
                    Op::Sample { grid, at } => {
                        let info = self.graph.grid(grid);
                        code.push(Instruction::Sample {
                            grid,
                            filter: info.filter,
                            dims: info.header.dims,
                            outside: info.outside,
                            at: self.registers.three(at),
                            out,
                        });
                    }
                    Op::SampleGradient { grid, at } => {
                        let info = self.graph.grid(grid);
                        let at = self.registers.three(at);
                        code.push(Instruction::SampleGradient {
                            grid,
                            filter: info.filter,
                            dims: info.header.dims,
                            at,
                            out,
                        });
                    }
                    Op::Lookup { table, at } => {
                        self.tables = true;
                        code.push(Instruction::Lookup { table, at: self.registers.get(at)[0], width, out });
                    }
                    Op::LookupSlope { table, at } => {
                        self.tables = true;
                        code.push(Instruction::LookupSlope { table, at: self.registers.get(at)[0], width, out });
                    }
                    Op::CellHash { cell, seed } => {
                        code.push(Instruction::CellHash {
                            cell: self.registers.three(cell),
                            seed: self.registers.get(seed)[0],
                            out,
                        });
                    }
                    Op::Const(_)
                    | Op::Truth(_)
                    | Op::LoopVar(_)
                    | Op::Splat(..)
                    | Op::Extract(..)
                    | Op::Compose(..)
                    | Op::Reduce { .. } => unreachable!("handled above or by its loop"),
                }
                range.collect()
            }
        };
        self.registers.set(id, registers);
    }
}

#[expect(clippy::needless_range_loop, reason = "a lane is one index into several registers")]
fn run<V: Voxels + ?Sized>(code: &[Instruction], env: &Environment<'_>, voxels: &V, r: &mut [Lanes]) {
    for instruction in code {
        match instruction {
            Instruction::Input(input, c, out) => {
                let c = *c as usize;
                r[*out as usize] = match input {
                    Input::Position => env.position[c],
                    Input::Direction => env.direction[c],
                    Input::CosTheta => env.cos_theta,
                    Input::Versine => env.cos_theta.map(|c| 1.0 - c),
                    Input::Vercosine => env.cos_theta.map(|c| 1.0 + c),
                    Input::Time => [env.time; LANES],
                    Input::Altitude(shell) => env.altitudes[*shell as usize],
                };
            }
            Instruction::Param(p, c, out) => r[*out as usize] = [env.params[*p as usize][*c as usize]; LANES],
            Instruction::Unary(op, a, out) => {
                let a = r[*a as usize];
                r[*out as usize] = match op {
                    Unary::Neg => a.map(|x| -x),
                    op => a.map(|x| unary(*op, x)),
                };
            }
            Instruction::Binary(op, a, b, out) => {
                let (a, b) = (r[*a as usize], r[*b as usize]);
                let out = &mut r[*out as usize];
                // The four plain ones in loops of their own, so that they vectorise.
                match op {
                    Binary::Add => (0..LANES).for_each(|i| out[i] = a[i] + b[i]),
                    Binary::Sub => (0..LANES).for_each(|i| out[i] = a[i] - b[i]),
                    Binary::Mul => (0..LANES).for_each(|i| out[i] = a[i] * b[i]),
                    Binary::Div => (0..LANES).for_each(|i| out[i] = a[i] / b[i]),
                    op => (0..LANES).for_each(|i| out[i] = binary(*op, a[i], b[i])),
                }
            }
            Instruction::PowI(n, a, out) => r[*out as usize] = r[*a as usize].map(|x| x.powi(*n)),
            Instruction::Compare(op, a, b, out) => {
                let (a, b) = (r[*a as usize], r[*b as usize]);
                (0..LANES).for_each(|i| r[*out as usize][i] = f64::from(u8::from(compare(*op, a[i], b[i]))));
            }
            Instruction::Select(c, a, b, out) => {
                let (c, a, b) = (r[*c as usize], r[*a as usize], r[*b as usize]);
                (0..LANES).for_each(|i| r[*out as usize][i] = if c[i] != 0.0 { a[i] } else { b[i] });
            }
            Instruction::Dot(pairs, out) => {
                let mut sum = [0.0; LANES];
                for (a, b) in pairs {
                    let (a, b) = (r[*a as usize], r[*b as usize]);
                    (0..LANES).for_each(|i| sum[i] += a[i] * b[i]);
                }
                r[*out as usize] = sum;
            }
            Instruction::Sample { grid, filter, dims, outside, at, out } => {
                for i in 0..LANES {
                    let at = at.map(|a| r[a as usize][i]);
                    r[*out as usize][i] = interpolate(*filter, *dims, *outside, at, |ijk| voxels.voxel(*grid, ijk));
                }
            }
            Instruction::SampleGradient { grid, filter, dims, at, out } => {
                for i in 0..LANES {
                    let at = at.map(|a| r[a as usize][i]);
                    let gradient = interpolate_gradient(*filter, *dims, at, |ijk| voxels.voxel(*grid, ijk));
                    (0..3).for_each(|c| r[*out as usize + c][i] = gradient[c]);
                }
            }
            Instruction::Lookup { table, at, width, out } => {
                let table = env.tables.get(*table);
                let at = r[*at as usize];
                for (i, x) in at.iter().enumerate() {
                    for c in 0..*width as usize {
                        r[*out as usize + c][i] = if x.is_nan() { f64::NAN } else { table.value(*x, c) };
                    }
                }
            }
            Instruction::LookupSlope { table, at, width, out } => {
                let table = env.tables.get(*table);
                let at = r[*at as usize];
                for (i, x) in at.iter().enumerate() {
                    for c in 0..*width as usize {
                        r[*out as usize + c][i] = if x.is_nan() { f64::NAN } else { table.slope(*x, c) };
                    }
                }
            }
            Instruction::CellHash { cell, seed, out } => {
                for i in 0..LANES {
                    let hash = cell_hash(cell.map(|c| r[c as usize][i]), r[*seed as usize][i]);
                    (0..3).for_each(|c| r[*out as usize + c][i] = hash[c]);
                }
            }
            Instruction::Loop { start, end, fold, variable, code, body, out } => {
                let identity = match fold {
                    Fold::Sum => 0.0,
                    Fold::Product => 1.0,
                    Fold::Min => f64::INFINITY,
                    Fold::Max => f64::NEG_INFINITY,
                };
                let op = match fold {
                    Fold::Sum => Binary::Add,
                    Fold::Product => Binary::Mul,
                    Fold::Min => Binary::Min,
                    Fold::Max => Binary::Max,
                };
                let mut total = [[identity; LANES]; 4];
                for value in *start..*end {
                    r[*variable as usize] = [f64::from(value); LANES];
                    run(code, env, voxels, r);
                    for (total, body) in total.iter_mut().zip(body) {
                        (0..LANES).for_each(|i| total[i] = binary(op, total[i], r[*body as usize][i]));
                    }
                }
                (0..body.len()).for_each(|c| r[*out as usize + c] = total[c]);
            }
        }
    }
}
