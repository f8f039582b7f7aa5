//! Intervals of fields over regions: no value lies outside, and where a sharper form is known the interval is tight.

use crate::{Lattice, declare};
use compiler::analysis::interval::{
    Enclosure, Extremes, Interval, NoExtremes, Pyramid, Region, TableBounds, Workspace, binary, compare, polynomial,
    power, unary,
};
use compiler::ir::eval::{self, Environment, LANES, Tables, Tape, Voxels};
use compiler::ir::{
    Binary, Compare, Filter, Fold, Graph, GridId, Input, NodeId, Op, ParamId, Table, TableId, Type, Unary,
};

/// A plain generator (SplitMix64: Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        (low + (high - low) * self.unit()).clamp(low, high)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// Numbers of all sizes, and those at which something happens.
    fn number(&mut self) -> f64 {
        const SPECIAL: [f64; 14] = [
            0.0,
            1.0,
            -1.0,
            0.5,
            -0.5,
            2.0,
            3.0,
            -2.5,
            1e-300,
            -1e-12,
            1e12,
            3.2,
            std::f64::consts::TAU,
            -std::f64::consts::FRAC_PI_2,
        ];
        match self.below(8) {
            0 => SPECIAL[self.below(SPECIAL.len())],
            1 => self.between(-1.0, 1.0).powi(3) * 10f64.powi(self.below(40) as i32 - 20),
            2 => self.between(-1.0, 1.0).mul_add(700.0, 0.0),
            3 => self.below(9) as f64 - 4.0,
            _ => self.between(-4.0, 4.0),
        }
    }

    fn interval(&mut self) -> Interval {
        let a = self.number();
        let b = match self.below(4) {
            0 => a,
            1 => a + self.between(0.0, 1e-6) * a.abs(),
            2 => a + self.unit(),
            _ => self.number(),
        };
        Interval::new(a.min(b), a.max(b))
    }

    /// Within it, at its ends every so often.
    fn within(&mut self, i: Interval) -> f64 {
        match self.below(6) {
            0 => i.low,
            1 => i.high,
            _ => self.between(i.low, i.high),
        }
    }
}

const UNARY: [Unary; 20] = [
    Unary::Neg,
    Unary::Abs,
    Unary::Sign,
    Unary::Floor,
    Unary::Ceil,
    Unary::Round,
    Unary::Sqrt,
    Unary::Exp,
    Unary::Expm1,
    Unary::Log,
    Unary::Sin,
    Unary::Cos,
    Unary::Tan,
    Unary::Asin,
    Unary::Acos,
    Unary::Atan,
    Unary::Sinh,
    Unary::Cosh,
    Unary::Tanh,
    Unary::Not,
];
const BINARY: [Binary; 9] = [
    Binary::Add,
    Binary::Sub,
    Binary::Mul,
    Binary::Div,
    Binary::Min,
    Binary::Max,
    Binary::Pow,
    Binary::Atan2,
    Binary::Mod,
];

#[test]
fn no_operation_leaves_its_interval() {
    let mut random = Random(1);
    for _ in 0..30_000 {
        let (a, b) = (random.interval(), random.interval());
        let points: Vec<(f64, f64)> = (0..4).map(|_| (random.within(a), random.within(b))).collect();
        for op in UNARY.into_iter().filter(|op| *op != Unary::Not) {
            let i = unary(op, a);
            for (x, _) in &points {
                let v = eval::unary(op, *x);
                assert!(i.holds(v), "{op:?} {x:e} = {v:e} of {a:?} in {i:?}");
            }
        }
        for op in BINARY {
            let i = binary(op, a, b);
            for (x, y) in &points {
                let v = eval::binary(op, *x, *y);
                assert!(i.holds(v), "{op:?} {x:e} {y:e} = {v:e} of {a:?} {b:?} in {i:?}");
            }
        }
        for op in [Compare::Less, Compare::LessEqual, Compare::Equal] {
            let i = compare(op, a, b);
            for (x, y) in &points {
                assert!(i.holds(f64::from(u8::from(eval::compare(op, *x, *y)))), "{op:?} {a:?} {b:?}");
            }
        }
        for n in [-3, -2, -1, 0, 1, 2, 3, 5, 8] {
            let i = power(a, n);
            for (x, _) in &points {
                let v = x.powi(n);
                assert!(i.holds(v), "{x:e}^{n} = {v:e} of {a:?} in {i:?}");
            }
        }
    }
}

#[test]
fn polynomials_are_bounded_and_tight() {
    let mut random = Random(2);
    let value = |c: &[f64], x: f64| c.iter().rev().fold(0.0, |sum, c| sum * x + c);
    for _ in 0..20_000 {
        let n = 2 + random.below(8);
        let c: Vec<f64> = (0..n).map(|_| random.between(-3.0, 3.0)).collect();
        let a = random.between(-2.0, 2.0);
        let t = Interval::new(a, a + random.unit() * random.unit());
        let i = polynomial(&c, t);
        for _ in 0..4 {
            let v = value(&c, random.within(t));
            assert!(i.holds(v), "{c:?} over {t:?}: {v} in {i:?}");
        }
    }
    // 6t⁵ − 15t⁴ + 10t³ rises from 0 to 1.
    let fade = polynomial(&[0.0, 0.0, 0.0, 10.0, -15.0, 6.0], Interval::new(0.0, 1.0));
    assert!(fade.low > -1e-12 && fade.high < 1.0 + 1e-12, "{fade:?}");
}

/// Voxels with their pyramid.
struct Bounded<F> {
    lattice: Lattice<F>,
    pyramid: Pyramid,
}

impl<F: Fn([u32; 3]) -> f64 + Sync> Bounded<F> {
    fn new(dims: [u32; 3], f: F) -> Self {
        let layers = (0..Pyramid::layers(dims)).map(|l| Pyramid::layer(dims, l, &f)).collect();
        Self { lattice: Lattice(f), pyramid: Pyramid::new(dims, layers) }
    }
}

impl<F: Fn([u32; 3]) -> f64 + Sync> Extremes for Bounded<F> {
    fn voxel(&self, grid: GridId, index: [u32; 3]) -> f64 {
        self.lattice.voxel(grid, index)
    }

    fn extremes(&self, _grid: GridId, low: [u32; 3], high: [u32; 3]) -> (f64, f64) {
        self.pyramid.extremes(low, high, |ijk| (self.lattice.0)(ijk))
    }
}

/// A graph of every operation, grown at random over the position, with grids, tables, a parameter and a loop variable.
fn grow(random: &mut Random, dims: [u32; 3]) -> (Graph, Vec<NodeId>) {
    let mut graph = Graph::default();
    let grids = [Filter::Nearest, Filter::Linear, Filter::Cubic].map(|f| declare(&mut graph, dims, f, 0.25));
    graph.params.push(Type::Float(2));
    let table = |graph: &mut Graph, keys: &[f64], width: u8, random: &mut Random| {
        let keys: Vec<NodeId> = keys.iter().map(|k| graph.scalar(*k)).collect();
        let values = keys.iter().map(|_| {
            let v: Vec<f64> = (0..width).map(|_| random.between(-2.0, 5.0)).collect();
            graph.vector(&v)
        });
        let values = values.collect();
        graph.add_table(Table { name: "rows".into(), span: None, keys, values, width })
    };
    let tables: [TableId; 2] = [
        table(&mut graph, &[-2.0, -0.5, -0.5, 0.1, 0.2, 0.2001, 1.5, 4.0], 1, random),
        table(&mut graph, &[0.0, 0.5, 1.0], 3, random),
    ];
    let position = graph.input(Input::Position);
    let param = graph.push(Op::Param(ParamId(0)));
    let mut vectors = vec![position];
    let mut scalars: Vec<NodeId> = (0..3).map(|i| graph.extract(position, i)).collect();
    scalars.extend([0, 1].map(|i| graph.extract(param, i)));
    for _ in 0..2 + random.below(14) {
        let pick = |random: &mut Random, list: &[NodeId]| {
            // Mostly the latest, so that graphs grow deep.
            let back = random.below(list.len().min(5));
            list[list.len() - 1 - back]
        };
        let (x, y, v) = (pick(random, &scalars), pick(random, &scalars), pick(random, &vectors));
        match random.below(18) {
            0 => scalars.push(graph.unary(UNARY[random.below(19)], x)),
            1 | 2 => scalars.push(graph.binary(BINARY[random.below(9)], x, y)),
            3 => scalars.push(graph.powi(x, random.below(6) as i32 - 1)),
            4 => {
                let condition = graph.push(Op::Compare(Compare::Less, x, y));
                scalars.push(graph.push(Op::Select { condition, accept: y, reject: x }));
            }
            5 => vectors.push(graph.compose(&[x, y, x])),
            6 => scalars.push(graph.dot(v, v)),
            7 => scalars.push(graph.dot(v, position)),
            8 => scalars.push(graph.push(Op::Sample { grid: grids[random.below(3)], at: v })),
            9 => vectors.push(graph.push(Op::SampleGradient { grid: grids[random.below(3)], at: v })),
            10 => scalars.push(graph.push(Op::Lookup { table: tables[0], at: x })),
            11 => vectors.push(graph.push(Op::Lookup { table: tables[1], at: x })),
            12 => scalars.push(graph.push(Op::LookupSlope { table: tables[0], at: x })),
            13 => {
                let seed = graph.scalar(7.0);
                vectors.push(graph.push(Op::CellHash { cell: v, seed }));
            }
            14 => {
                let floor = graph.unary(Unary::Floor, v);
                vectors.push(graph.sub(v, floor));
            }
            15 => {
                let c = graph.scalar(random.between(-2.0, 2.0));
                let product = graph.mul(x, c);
                scalars.push(graph.binary(Binary::Add, product, c));
            }
            16 => {
                let i = graph.push(Op::LoopVar(0));
                let body = graph.binary(Binary::Mul, i, x);
                let fold = [Fold::Sum, Fold::Product, Fold::Min, Fold::Max][random.below(4)];
                scalars.push(graph.reduce(fold, 0, -1..3, body));
            }
            _ => vectors.push(graph.binary(BINARY[random.below(6)], v, position)),
        }
    }
    let roots = scalars.into_iter().chain(vectors).collect();
    (graph, roots)
}

/// Values at random points of a region against its intervals; how many numbers were compared.
fn compare_values<V: Voxels + Extremes>(
    (graph, roots): (&Graph, &[NodeId]),
    code: (&Enclosure, &mut Workspace),
    tape: &Tape,
    boxes: [Interval; 3],
    params: &[Vec<Interval>],
    voxels: &V,
    random: &mut Random,
) -> usize {
    let time = Interval::point(0.5);
    let tables = TableBounds::new(graph, params, time);
    let (code, work) = code;
    code.run(&Region { position: boxes, params, time, tables: &tables, ..Region::default() }, voxels, work);
    let mut scratch = tape.scratch();
    let mut count = 0;
    for _ in 0..3 {
        let position = boxes.map(|i| std::array::from_fn(|_| random.within(i)));
        let chosen: Vec<Vec<f64>> = params.iter().map(|v| v.iter().map(|i| random.within(*i)).collect()).collect();
        let values = Tables::evaluate(graph, &chosen, 0.5);
        let environment =
            Environment { position, time: 0.5, params: &chosen, tables: &values, ..Environment::default() };
        tape.run(&environment, voxels, &mut scratch);
        for (i, root) in roots.iter().enumerate() {
            let intervals = code.root(work, i);
            for (lanes, interval) in tape.root(&scratch, i).iter().zip(intervals) {
                for lane in 0..LANES {
                    count += 1;
                    assert!(
                        interval.holds(lanes[lane]),
                        "{:?} = {:e} at {:?} of {boxes:?} is not in {interval:?}\n{}",
                        graph.op(*root),
                        lanes[lane],
                        position.map(|p| p[lane]),
                        compiler::ir::print(graph, &[("root".into(), *root)]),
                    );
                }
            }
        }
    }
    count
}

impl<F: Fn([u32; 3]) -> f64 + Sync> Voxels for Bounded<F> {
    fn voxel(&self, grid: GridId, index: [u32; 3]) -> f64 {
        self.lattice.voxel(grid, index)
    }
}

#[test]
fn no_value_of_a_field_leaves_its_interval() {
    let dims = [13, 9, 21];
    let voxels = Bounded::new(dims, |[i, j, k]| {
        let n = (i * 73 + j * 179 + k * 283) % 101;
        if n < 40 { 0.0 } else { f64::from(n) * 0.07 - 2.0 }
    });
    let mut random = Random(3);
    let mut count = 0;
    for _ in 0..2000 {
        let (graph, roots) = grow(&mut random, dims);
        let (code, tape) = (Enclosure::new(&graph, &roots), Tape::new(&graph, &roots));
        let mut work = code.workspace();
        for _ in 0..6 {
            let size = [1e-6, 1e-2, 0.5, 3.0, 30.0][random.below(5)];
            let boxes = [0, 1, 2].map(|axis| {
                let low = random.between(-2.0, f64::from(dims[axis]) + 1.0);
                Interval::new(low, low + size * random.unit())
            });
            let params = [(0..2).map(|_| random.interval()).collect::<Vec<_>>()];
            count += compare_values((&graph, &roots), (&code, &mut work), &tape, boxes, &params, &voxels, &mut random);
        }
    }
    assert!(count > 5_000_000, "{count}");
}

#[test]
fn intervals_are_tight_where_forms_are_known() {
    let mut graph = Graph::default();
    let p = graph.input(Input::Position);
    let x = graph.extract(p, 0);
    let square = graph.mul(x, x);
    let floor = graph.unary(Unary::Floor, x);
    let fraction = graph.sub(x, floor);
    let dot = graph.dot(p, p);
    let sine = graph.unary(Unary::Sin, x);
    let grid = declare(&mut graph, [4, 4, 4], Filter::Linear, 0.0);
    let sample = graph.push(Op::Sample { grid, at: p });
    let roots = [square, fraction, dot, sine, sample];
    let code = Enclosure::new(&graph, &roots);
    let mut work = code.workspace();
    let voxels = Bounded::new([4, 4, 4], |[i, j, k]| f64::from(i * j * k));
    let mut over = |low: f64, high: f64| {
        let region = Region { position: [Interval::new(low, high); 3], ..Region::default() };
        code.run(&region, &voxels, &mut work);
        [0, 1, 2, 3, 4].map(|i| code.hull(&work, i))
    };
    let close = |i: Interval, low: f64, high: f64| (i.low - low).abs() < 1e-12 && (i.high - high).abs() < 1e-12;
    let [square, fraction, dot, _, _] = over(-1.0, 2.0);
    assert_eq!((square.low, square.high, fraction.low, fraction.high), (0.0, 4.0, 0.0, 1.0));
    assert_eq!((dot.low, dot.high), (0.0, 12.0));
    let [_, fraction, _, sine, sample] = over(1.25, 1.75);
    assert!(close(fraction, 0.25, 0.75) && close(sine, 1.25f64.sin(), 1.0), "{fraction:?} {sine:?}");
    // Trilinear: x·y·z itself, extreme at the corners.
    assert!(close(sample, 1.25f64.powi(3), 1.75f64.powi(3)), "{sample:?}");
}

#[test]
fn tables_and_grids_that_nothing_reaches_are_what_lies_there() {
    let mut graph = Graph::default();
    let p = graph.input(Input::Position);
    let x = graph.extract(p, 0);
    let keys: Vec<NodeId> = (0..1000).map(|i| graph.scalar(f64::from(i))).collect();
    // A spike of one row.
    let values = (0..1000).map(|i| graph.scalar(if i == 500 { 7.0 } else { 0.0 })).collect();
    let table = graph.add_table(Table { name: "spike".into(), span: None, keys, values, width: 1 });
    let looked = graph.push(Op::Lookup { table, at: x });
    let code = Enclosure::new(&graph, &[looked]);
    let mut work = code.workspace();
    let tables = TableBounds::new(&graph, &[], Interval::point(0.0));
    let mut over = |low: f64, high: f64| {
        let position = [Interval::new(low, high); 3];
        code.run(&Region { position, tables: &tables, ..Region::default() }, &NoExtremes, &mut work);
        code.hull(&work, 0)
    };
    assert_eq!((over(-5.0, 499.0).low, over(-5.0, 499.0).high), (0.0, 0.0));
    assert_eq!((over(501.0, 2000.0).low, over(501.0, 2000.0).high), (0.0, 0.0));
    assert_eq!(over(0.0, 999.0).high, 7.0);
    assert!((over(500.5, 600.0).high - 3.5).abs() < 1e-9);
}
