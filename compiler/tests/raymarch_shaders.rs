//! What the raymarch backend writes gets through the verifier, naga, and every target, for scenes with every feature.

use compiler::Options;
use compiler::backends::REGISTRY;
use compiler::diagnostic::Diagnostics;
use compiler::ir::{
    Aa, Affine, Backend, Bands, BandsKind, Binary, Camera, Compare, Composite, FieldScene, Filter, Fold, Graph, GridId,
    GridInfo, ImageInfo, Input, Medium, NodeId, Op, Param, ParamId, ParamType, Primitive, PrimitiveKind, Projection,
    RenderInfo, Scattering, Shape, Table, Tonemap, Type, Unary, Units,
};
use compiler::loader::{GridHeader, Scalar};
use compiler::program::Ledger;

/// A scene under construction.
#[derive(Clone)]
struct Builder {
    scene: FieldScene,
}

fn builder(bands: u8) -> Builder {
    let mut graph = Graph::default();
    let (from, to, up) = (graph.vector(&[0.0, 1.0, 5.0]), graph.vector(&[0.0; 3]), graph.vector(&[0.0, 1.0, 0.0]));
    let (fov, zero) = (graph.scalar(0.8), graph.scalar(0.0));
    let scene = FieldScene {
        lights: vec![],
        surfaces: vec![],
        meshes: vec![],
        splats: vec![],
        environment: false,
        graph,
        units: Units::METRE,
        bands: Bands { kind: BandsKind::List, wavelengths: (0..bands).map(|i| 4e-7 + 1e-7 * f64::from(i)).collect() },
        params: vec![],
        media: vec![],
        background: zero,
        shells: vec![],
        camera: Camera { from, to, up, projection: Projection::Perspective { fov } },
        image: ImageInfo { size: [64, 48], aa: Aa::None, exposure: zero, tonemap: Tonemap::None },
        render: RenderInfo {
            backend: Backend::Raymarch,
            scattering: Scattering::None,
            composite: Composite::Radiance,
            accuracy: 0.004,
            steps: None,
            slices: None,
            stacks: compiler::ir::Stacks::View,
            pixels: compiler::ir::Pixels::Every,
            splats: None,
            samples: None,
            max_work: 4096,
        },
    };
    Builder { scene }
}

impl Builder {
    fn number(&mut self, x: f64) -> NodeId {
        self.scene.graph.scalar(x)
    }

    fn point(&mut self, p: [f64; 3]) -> NodeId {
        self.scene.graph.vector(&p)
    }

    fn position(&mut self) -> NodeId {
        self.scene.graph.input(Input::Position)
    }

    fn param(&mut self, name: &str, default: f64) -> NodeId {
        self.scene.graph.params.push(Type::SCALAR);
        self.scene.params.push(Param {
            name: name.into(),
            span: None,
            docs: None,
            ty: ParamType::Float(1),
            dimension: [0.0; 4],
            default: vec![default],
            range: None,
        });
        self.scene.graph.param(ParamId(self.scene.params.len() as u32 - 1))
    }

    fn ball(&mut self, centre: [f64; 3], radius: f64) -> Shape {
        let (center, radius) = (self.point(centre), self.number(radius));
        primitive(PrimitiveKind::Sphere { center, radius })
    }

    fn medium(&mut self, name: &str, shape: Shape, k_a: NodeId, k_e: NodeId) {
        let (name, k_s) = (name.into(), self.number(0.0));
        let (span, phase, data, data_color) = (None, None, None, None);
        self.scene.media.push(Medium { name, span, shape, k_a, k_s, k_e, phase, data, data_color });
    }

    /// Something smooth that depends on the position, under a name that no shading language knows.
    fn waves(&mut self) -> NodeId {
        let p = self.position();
        let g = &mut self.scene.graph;
        let (x, y) = (g.extract(p, 0), g.extract(p, 1));
        let wave = g.unary(Unary::Sin, x);
        let r2 = g.dot(p, p);
        let product = g.mul(wave, y);
        let sum = g.add(product, r2);
        g.annotate(sum, None, Some("σ"));
        let negative = g.unary(Unary::Neg, sum);
        g.unary(Unary::Exp, negative)
    }

    fn grid(&mut self, scalar: Scalar, filter: Filter) -> NodeId {
        self.scene.graph.grids.push(GridInfo {
            name: "head".into(),
            span: None,
            path: "head.nii".into(),
            from: "scene.vol".into(),
            header: GridHeader {
                dims: [32, 48, 40],
                scalar,
                slope: 0.5,
                intercept: -1.0,
                world_from_index: [[0.1, 0.0, 0.0, -1.6], [0.0, 0.1, 0.0, -2.4], [0.0, 0.0, 0.1, -2.0]],
            },
            filter,
            outside: 0.0,
        });
        let grid = GridId(self.scene.graph.grids.len() as u32 - 1);
        let (p, ten) = (self.position(), self.point([10.0; 3]));
        let at = self.scene.graph.mul(p, ten);
        let value = self.scene.graph.push(Op::Sample { grid, at });
        let slope = self.scene.graph.push(Op::SampleGradient { grid, at });
        let steepness = self.scene.graph.dot(slope, slope);
        let sum = self.scene.graph.add(value, steepness);
        self.scene.graph.unary(Unary::Abs, sum)
    }

    fn table(&mut self, at: NodeId, width: u8) -> NodeId {
        let keys: Vec<NodeId> = [0.0, 0.5, 0.5, 1.0].into_iter().map(|k| self.number(k)).collect();
        let values = keys.iter().map(|k| self.scene.graph.widen(*k, width)).collect();
        let table = self.scene.graph.add_table(Table { name: "tissue".into(), span: None, keys, values, width });
        let slope = self.scene.graph.push(Op::LookupSlope { table, at });
        let value = self.scene.graph.push(Op::Lookup { table, at });
        self.scene.graph.binary(Binary::Max, value, slope)
    }
}

fn primitive(kind: PrimitiveKind) -> Shape {
    Shape::Primitive(Primitive { kind, from_world: None, span: None })
}

/// Builds a scene, emits it for every target, and reads the WGSL back.
fn draw(what: &str, mut scene: FieldScene, options: &Options) {
    let (mut ledger, mut diagnostics) = (Ledger::default(), Diagnostics::default());
    let built = (REGISTRY[0].build)(&mut scene, options, &mut ledger, &mut diagnostics);
    let (kernels, plan) = built.unwrap_or_else(|| panic!("{what}: {diagnostics:?}"));
    for kernel in &kernels {
        let shader = compiler::emit::emit(kernel).unwrap_or_else(|e| panic!("{what}: {e}\n{:?}", e.diagnostic().notes));
        let wgsl = shader.wgsl().expect("WGSL");
        let parsed = naga::front::wgsl::parse_str(&wgsl)
            .unwrap_or_else(|e| panic!("{what}: {}\n{wgsl}", e.emit_to_string(&wgsl)));
        naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
            .validate(&parsed)
            .unwrap_or_else(|e| panic!("{what}: {}\n{wgsl}", e.emit_to_string(&wgsl)));
        assert!(!shader.spirv().expect("SPIR-V").is_empty());
        for text in [shader.glsl(), shader.hlsl(), shader.msl()] {
            assert!(!text.expect("text").is_empty());
        }
        // The offsets that the runtime writes to are those that the shader reads from.
        let frame = parsed.types.iter().find_map(|(_, ty)| match (&ty.inner, ty.name.as_deref()) {
            (naga::TypeInner::Struct { members, span }, Some("Frame")) => Some((members, *span)),
            _ => None,
        });
        let (members, span) = frame.expect("a uniform struct");
        let offsets: Vec<u32> = members.iter().map(|m| m.offset).collect();
        assert_eq!(offsets, plan.uniforms.fields.iter().map(|f| f.offset).collect::<Vec<_>>(), "{what}");
        assert!(plan.uniforms.size >= span);
    }
}

fn draw_all_ways(what: &str, scene: &FieldScene) {
    for (way, options) in [
        ("picture", Options::default()),
        ("probe", Options::probe()),
        ("edges", Options { aa: Some(Aa::Analytic), ..Options::default() }),
        ("many samples", Options { aa: Some(Aa::Ssaa(4)), ..Options::default() }),
        ("steps", Options { steps: Some(16), ..Options::default() }),
    ] {
        draw(&format!("{what}, {way}"), scene.clone(), &options);
    }
}

#[test]
fn a_uniform_ball_in_one_three_and_four_bands() {
    for bands in [1, 3, 4] {
        let mut b = builder(bands);
        let ball = b.ball([0.0; 3], 1.0);
        let k_a = b.param("strength", 2.0);
        let k_e = b.scene.graph.widen(k_a, bands);
        b.medium("ball", ball, k_a, k_e);
        draw_all_ways(&format!("{bands} bands"), &b.scene);
    }
}

#[test]
fn every_shape_and_their_combinations() {
    let mut b = builder(3);
    let (zero, one, two, three) = (b.number(0.0), b.number(1.0), b.number(2.0), b.number(3.0));
    let [low, high, up, origin, radii] =
        [[-1.0, -2.0, -1.0], [1.0, 0.5, 2.0], [0.0, 1.0, 0.0], [0.0; 3], [1.0, 2.0, 3.0]].map(|p| b.point(p));
    let p = b.position();
    let squared = b.scene.graph.dot(p, p);
    let length = b.scene.graph.unary(Unary::Sqrt, squared);
    let field = b.scene.graph.sub(length, one);
    for kind in [
        PrimitiveKind::Sphere { center: origin, radius: two },
        PrimitiveKind::Ellipsoid { center: origin, radii },
        PrimitiveKind::Box { min: low, max: high },
        PrimitiveKind::Slab { axis: up, from: zero, to: one },
        PrimitiveKind::Cylinder { from: low, to: high, radius: one },
        PrimitiveKind::Shell { center: origin, inner: two, outer: three },
        PrimitiveKind::Sdf { field },
    ] {
        for moved in [false, true] {
            let mut b = b.clone();
            let rows = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 2.0]].map(|r| b.point(r));
            let from_world = moved.then_some(Affine { rows, offset: low });
            let shape = Shape::Primitive(Primitive { kind, from_world, span: None });
            let ball = b.ball([0.5, 0.0, 0.0], 1.0);
            let other = b.ball([-0.5, 0.0, 0.0], 1.5);
            let waves = b.waves();
            b.medium("m", Shape::Intersection(vec![shape.clone(), other.clone()]), waves, one);
            draw_all_ways(&format!("{kind:?}"), &b.scene);
            b.scene.media.clear();
            let inside = Shape::Intersection(vec![ball.clone(), shape.clone()]);
            let without = Shape::Difference(Box::new(ball), vec![shape, other.clone()]);
            b.medium("a", Shape::Union(vec![inside.clone(), other]), waves, one);
            b.medium("b", without, one, two);
            b.medium("c", inside, one, waves);
            draw_all_ways(&format!("combinations with {kind:?}"), &b.scene);
        }
    }
}

#[test]
fn a_fog_without_end() {
    let mut b = builder(3);
    let (one, two) = (b.number(1.0), b.number(2.0));
    b.medium("fog", Shape::Everywhere, one, two);
    draw_all_ways("fog", &b.scene);
}

#[test]
fn every_projection_of_the_camera_and_of_the_data() {
    for composite in 0..5 {
        for projection in 0..3 {
            let mut b = builder(3);
            let (height, level) = (b.number(4.0), b.number(0.5));
            match projection {
                0 => {}
                1 => b.scene.camera.projection = Projection::Orthographic { height },
                _ => b.scene.camera.projection = Projection::Panorama,
            }
            let ball = b.ball([0.0; 3], 1.0);
            let data = b.waves();
            let value = b.table(data, 3);
            b.medium("m", ball, data, value);
            let key = b.scene.graph.input(Input::CosTheta);
            let color = b.table(key, 3);
            b.scene.media[0].data = Some(data);
            b.scene.media[0].data_color = Some(color);
            b.scene.render.composite = match composite {
                0 => Composite::Radiance,
                1 => Composite::Maximum,
                2 => Composite::Minimum,
                3 => Composite::Average,
                _ => Composite::Isosurface(level),
            };
            draw(&format!("{composite} {projection}"), b.scene, &Options::default());
        }
    }
}

#[test]
fn every_filter_and_voxel() {
    for scalar in [Scalar::U8, Scalar::I16, Scalar::F32, Scalar::F64] {
        for filter in [Filter::Nearest, Filter::Linear, Filter::Cubic] {
            let mut b = builder(1);
            let (min, max) = (b.point([-1.5, -2.0, -2.0]), b.point([1.5, 2.0, 2.0]));
            let value = b.grid(scalar, filter);
            let color = b.table(value, 1);
            b.medium("head", primitive(PrimitiveKind::Box { min, max }), color, value);
            draw_all_ways(&format!("{scalar:?} {filter:?}"), &b.scene);
        }
    }
}

#[test]
fn every_operation() {
    use Unary as U;
    let mut b = builder(1);
    let p = b.position();
    let (seed, one) = (b.number(7.0), b.number(1.0));
    let g = &mut b.scene.graph;
    let (t, d) = (g.input(Input::Time), g.input(Input::Direction));
    let x = g.extract(p, 0);
    let mut terms = vec![g.dot(p, d)];
    let rounding = [U::Neg, U::Abs, U::Sign, U::Floor, U::Ceil, U::Round, U::Sqrt];
    let growing = [U::Exp, U::Expm1, U::Log, U::Sinh, U::Cosh, U::Tanh];
    let turning = [U::Sin, U::Cos, U::Tan, U::Asin, U::Acos, U::Atan];
    for u in rounding.into_iter().chain(growing).chain(turning) {
        terms.push(g.unary(u, x));
        let three = g.unary(u, p);
        terms.push(g.dot(three, p));
    }
    let sums = [Binary::Add, Binary::Sub, Binary::Mul, Binary::Div];
    for op in sums.into_iter().chain([Binary::Min, Binary::Max, Binary::Pow, Binary::Atan2, Binary::Mod]) {
        terms.push(g.binary(op, x, t));
        let three = g.binary(op, p, d);
        terms.push(g.dot(three, p));
    }
    terms.extend([-3, 0, 1, 2, 5].map(|n| g.powi(x, n)));
    let (less, equal) = (g.compare(Compare::Less, x, t), g.compare(Compare::Equal, x, t));
    let not = g.unary(U::Not, equal);
    let both = g.binary(Binary::And, less, not);
    let either = g.binary(Binary::Or, both, equal);
    terms.push(g.select(either, x, t));
    let hash = g.push(Op::CellHash { cell: p, seed });
    terms.push(g.dot(hash, p));
    let i = g.push(Op::LoopVar(0));
    let body = g.mul(i, x);
    for fold in [Fold::Sum, Fold::Product, Fold::Min, Fold::Max] {
        terms.push(g.reduce(fold, 0, -2..5, body));
        let empty = g.reduce(fold, 0, 3..3, body);
        terms.push(g.binary(Binary::Min, empty, x));
    }
    let sum = terms.into_iter().reduce(|a, b| g.add(a, b)).expect("terms");
    let squared = g.mul(sum, sum);
    let ball = b.ball([0.0; 3], 1.0);
    b.medium("m", ball, squared, one);
    draw_all_ways("every operation", &b.scene);
}
