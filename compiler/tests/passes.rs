//! Passes never change what a field is: random graphs, before and after, at random points.

use compiler::analysis::range::ranges;
use compiler::ir::eval::{Environment, LANES, NoVoxels, Tables, Tape};
use compiler::ir::{
    Aa, Backend, Bands, BandsKind, Binary, Camera, Compare, Composite, FieldScene, Fold, Graph, ImageInfo, Input,
    Medium, NodeId, Op, Projection, RenderInfo, Scattering, Shape, Table, Tonemap, Unary, Units, verify,
};
use compiler::passes;
use compiler::program::Ledger;
use proptest::prelude::*;

/// A small machine that turns random bytes into a well-typed graph.
struct Maker<'a> {
    graph: Graph,
    scalars: Vec<NodeId>,
    vectors: Vec<NodeId>,
    truths: Vec<NodeId>,
    bytes: std::slice::Iter<'a, u8>,
}

impl Maker<'_> {
    fn byte(&mut self) -> usize {
        self.bytes.next().copied().unwrap_or(0) as usize
    }

    fn pick(&mut self, from: fn(&Self) -> &Vec<NodeId>) -> NodeId {
        let n = self.byte();
        let list = from(self);
        list[n % list.len()]
    }

    fn step(&mut self) {
        let what = self.byte() % 16;
        let (a, b) = (self.pick(|m| &m.scalars), self.pick(|m| &m.scalars));
        let (v, w) = (self.pick(|m| &m.vectors), self.pick(|m| &m.vectors));
        let g = &mut self.graph;
        match what {
            0 => self.scalars.push(g.add(a, b)),
            1 => self.scalars.push(g.sub(a, b)),
            2 => self.scalars.push(g.mul(a, b)),
            3 => self.scalars.push(g.dot(v, w)),
            4 => self.vectors.push(g.add(v, w)),
            5 => self.vectors.push(g.mul(v, a)),
            6 => {
                let op = [Unary::Neg, Unary::Abs, Unary::Sin, Unary::Exp, Unary::Floor, Unary::Tanh][b.0 as usize % 6];
                // Kept small, so that exponentials of exponentials stay finite.
                let small = g.unary(Unary::Tanh, a);
                self.scalars.push(g.unary(op, small));
            }
            7 => self.scalars.push(g.extract(v, (a.0 % 3) as u8)),
            8 => self.vectors.push(g.compose(&[a, b, a])),
            9 => self.truths.push(g.compare(Compare::Less, a, b)),
            10 => {
                let c = self.pick(|m| &m.truths);
                self.vectors.push(self.graph.select(c, v, w));
            }
            11 => {
                let c = self.pick(|m| &m.truths);
                self.scalars.push(self.graph.select(c, a, b));
            }
            12 => self.scalars.push(g.binary(Binary::Min, a, b)),
            13 => self.vectors.push(g.widen(a, 3)),
            14 => {
                let i = g.push(Op::LoopVar(0));
                let body = g.add(i, a);
                self.scalars.push(g.reduce(Fold::Sum, 0, 0..3, body));
            }
            _ => self.scalars.push(g.powi(a, (b.0 % 4) as i32)),
        }
    }
}

fn random_scene(bytes: &[u8]) -> FieldScene {
    let mut graph = Graph::default();
    let p = graph.input(Input::Position);
    let d = graph.input(Input::Direction);
    let mut scalars: Vec<NodeId> = [0.0, 1.0, -1.0, 2.0, 0.3].iter().map(|x| graph.scalar(*x)).collect();
    let keys: Vec<NodeId> = [-1.0, 0.5, 0.5, 2.0].iter().map(|x| graph.scalar(*x)).collect();
    let values: Vec<NodeId> = [0.0, 1.0, -2.0, 3.0].iter().map(|x| graph.scalar(*x)).collect();
    let table = graph.add_table(Table { name: "t".into(), span: None, keys, values, width: 1 });
    let x = graph.extract(p, 0);
    scalars.push(x);
    scalars.push(graph.push(Op::Lookup { table, at: x }));
    let ones = graph.vector(&[1.0, 1.0, 1.0]);
    let axis = graph.vector(&[0.0, 2.0, 0.0]);
    let truths = vec![graph.truth(true)];
    let mut maker = Maker { graph, scalars, vectors: vec![p, d, ones, axis], truths, bytes: bytes.iter() };
    for _ in 0..24 {
        maker.step();
    }
    let (a, v) = (*maker.scalars.last().unwrap(), *maker.vectors.last().unwrap());
    let mut graph = maker.graph;
    let (zero, one) = (graph.scalar(0.0), graph.scalar(1.0));
    let (origin, ahead) = (graph.vector(&[0.0; 3]), graph.vector(&[0.0, 0.0, 1.0]));
    let up = graph.vector(&[0.0, 1.0, 0.0]);
    FieldScene {
        lights: vec![],
        surfaces: vec![],
        meshes: vec![],
        splats: vec![],
        environment: false,
        graph,
        units: Units::METRE,
        bands: Bands { kind: BandsKind::Rgb, wavelengths: vec![680e-9, 550e-9, 440e-9] },
        params: vec![],
        media: vec![Medium {
            name: "m".into(),
            span: None,
            shape: Shape::Everywhere,
            k_a: v,
            k_s: zero,
            k_e: a,
            phase: None,
            data: None,
            data_color: None,
        }],
        background: zero,
        shells: vec![],
        camera: Camera { from: origin, to: ahead, up, projection: Projection::Perspective { fov: one } },
        image: ImageInfo { size: [1, 1], aa: Aa::None, exposure: zero, tonemap: Tonemap::None },
        render: RenderInfo {
            backend: Backend::Auto,
            scattering: Scattering::None,
            composite: Composite::Radiance,
            accuracy: 1e-2,
            steps: None,
            slices: None,
            stacks: compiler::ir::Stacks::View,
            pixels: compiler::ir::Pixels::Every,
            splats: None,
            samples: None,
            max_work: 65536,
        },
    }
}

/// Values of the two fields at eight points; a neutral spectrum is repeated.
fn evaluate(scene: &FieldScene, seed: u64) -> Vec<f64> {
    let medium = &scene.media[0];
    let tape = Tape::new(&scene.graph, &[medium.k_a, medium.k_e]);
    let tables = Tables::evaluate(&scene.graph, &[], 0.0);
    let mut state = seed | 1;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64 * 6.0 - 3.0
    };
    let mut environment = Environment { tables: &tables, ..Environment::default() };
    for axis in 0..3 {
        for lane in 0..LANES {
            environment.position[axis][lane] = random();
            environment.direction[axis][lane] = random() / 3.0;
        }
    }
    let mut scratch = tape.scratch();
    tape.run(&environment, &NoVoxels, &mut scratch);
    let mut out = vec![];
    for root in 0..2 {
        for c in 0..3 {
            out.extend(tape.component(&scratch, root, c.min(tape.width(root) - 1)));
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn optimised_fields_have_the_same_values(bytes in prop::collection::vec(any::<u8>(), 200), seed in any::<u64>()) {
        let scene = random_scene(&bytes);
        verify(&scene.graph, &scene.roots()).unwrap();
        let optimised = passes::optimise(&scene, &mut Ledger::default());
        verify(&optimised.graph, &optimised.roots()).unwrap();
        for (a, b) in evaluate(&scene, seed).into_iter().zip(evaluate(&optimised, seed)) {
            // A few rules round differently; over 24 operations that may grow by the conditioning of sums.
            prop_assert!(!a.is_finite() || (a - b).abs() <= 1e-9 * (1.0 + a.abs()), "{a} became {b}");
        }
    }

    #[test]
    fn values_lie_in_their_ranges(bytes in prop::collection::vec(any::<u8>(), 200), seed in any::<u64>()) {
        let scene = random_scene(&bytes);
        let ranges = ranges(&scene.graph);
        let values = evaluate(&scene, seed);
        for (i, node) in [scene.media[0].k_a, scene.media[0].k_e].into_iter().enumerate() {
            let range = ranges[node.0 as usize];
            for value in &values[i * 3 * LANES..(i + 1) * 3 * LANES] {
                let fits = *value >= range.low && *value <= range.high || value.is_nan() && range.nan;
                prop_assert!(fits, "{value} is outside {range:?}");
            }
        }
    }
}

#[test]
fn what_is_equal_in_all_bands_becomes_one_scalar() {
    let mut scene = random_scene(&[]);
    let graph = &mut scene.graph;
    let p = graph.input(Input::Position);
    let x = graph.extract(p, 0);
    let grey = graph.vector(&[2.0, 2.0, 2.0]);
    scene.media[0].k_a = graph.mul(grey, x);
    let optimised = passes::optimise(&scene, &mut Ledger::default());
    assert_eq!(optimised.graph.width(optimised.media[0].k_a), 1);
}

#[test]
fn one_less_an_exponential_is_rewritten_without_cancellation() {
    let mut scene = random_scene(&[]);
    let graph = &mut scene.graph;
    let p = graph.input(Input::Position);
    let x = graph.extract(p, 0);
    let e = graph.unary(Unary::Exp, x);
    let one = graph.scalar(1.0);
    scene.media[0].k_a = graph.sub(one, e);
    let optimised = passes::optimise(&scene, &mut Ledger::default());
    let Op::Unary(Unary::Neg, inner) = *optimised.graph.op(optimised.media[0].k_a) else { panic!("a negation") };
    assert!(matches!(optimised.graph.op(inner), Op::Unary(Unary::Expm1, _)));
}

#[test]
fn dead_fields_leave_no_node() {
    let mut scene = random_scene(&[]);
    let p = scene.graph.input(Input::Position);
    let x = scene.graph.extract(p, 1);
    let (zero, sine) = (scene.graph.scalar(0.0), scene.graph.unary(Unary::Sin, x));
    scene.media[0].k_a = scene.graph.mul(sine, zero);
    scene.media[0].k_e = zero;
    let optimised = passes::optimise(&scene, &mut Ledger::default());
    let sines = optimised.graph.ids().filter(|id| matches!(optimised.graph.op(*id), Op::Unary(Unary::Sin, _)));
    assert_eq!(sines.count(), 0);
}
