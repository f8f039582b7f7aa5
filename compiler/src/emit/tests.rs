use super::*;
use crate::program::kernel::{
    BinaryOp, Carries, Expr, Function, FunctionId, Local, LocalId, Math, Prim, Resource, ResourceKind, Stage, Stmt,
    Struct, Ty, UnaryOp,
};
use crate::program::{FrameValue, UniformLayout, UniformSource};
use crate::source::{SourceId, Sources};

const UVEC3: Ty = Ty::Value(Prim::U32, 3);
const IVEC3: Ty = Ty::Value(Prim::I32, 3);

/// Gathers statements and locals of one function.
#[derive(Default)]
struct Writer {
    f: Function,
}

impl Writer {
    fn new(name: &str, parameters: &[(&str, Ty)], result: Option<Ty>) -> Self {
        let parameters = parameters.iter().map(|(n, ty)| ((*n).to_owned(), *ty)).collect();
        Self { f: Function { name: name.into(), parameters, result, ..Function::default() } }
    }

    fn local(&mut self, name: &str, ty: Ty) -> LocalId {
        self.f.locals.push(Local { name: name.into(), ty, origin: None });
        LocalId(self.f.locals.len() as u32 - 1)
    }

    fn bind(&mut self, name: &str, ty: Ty, e: Expr) -> Expr {
        let id = self.local(name, ty);
        self.f.body.push(Stmt::Let(id, e));
        Expr::Local(id)
    }

    fn traced(&mut self, name: &str, ty: Ty, e: Expr, start: usize, end: usize) -> Expr {
        let bound = self.bind(name, ty, e);
        let last = self.f.locals.len() - 1;
        self.f.locals[last].origin = Some(Span::new(SourceId(0), start, end));
        bound
    }

    fn variable(&mut self, name: &str, ty: Ty, e: Expr) -> LocalId {
        let id = self.local(name, ty);
        self.f.body.push(Stmt::Var(id, e));
        id
    }
}

fn kernel(entry: Function) -> Kernel {
    Kernel {
        name: "draw".into(),
        stage: Stage::Compute([8, 8, 1]),
        structs: vec![Struct {
            name: "Frame".into(),
            fields: vec![
                ("tile_origin".into(), Ty::Value(Prim::U32, 2)),
                ("tile_size".into(), Ty::Value(Prim::U32, 2)),
                ("anchor".into(), Ty::VEC3),
                ("accuracy".into(), Ty::F32),
                ("steps".into(), Ty::U32),
                ("σ".into(), Ty::float(4)),
            ],
            carries: None,
        }],
        resources: vec![
            Resource { name: "frame".into(), kind: ResourceKind::Uniform(0) },
            Resource { name: "records".into(), kind: ResourceKind::WriteBuffer(Ty::F32) },
            Resource { name: "rays".into(), kind: ResourceKind::ReadBuffer(Ty::float(4)) },
            Resource { name: "brain".into(), kind: ResourceKind::Texture3d(Prim::U32) },
            Resource { name: "head".into(), kind: ResourceKind::Texture3d(Prim::I32) },
            Resource { name: "heat".into(), kind: ResourceKind::Texture3d(Prim::F32) },
        ],
        functions: vec![],
        entry,
    }
}

fn component(e: Expr, i: u8) -> Expr {
    e.component(i)
}

fn vec3(x: f64, y: f64, z: f64) -> Expr {
    Expr::Compose(Ty::VEC3, vec![x.into(), y.into(), z.into()])
}

/// Emits, writes every target, reads the WGSL back and validates it, and checks that naga renamed nothing.
fn all_targets(kernel: &Kernel) -> (Shader, String) {
    let shader = emit(kernel).unwrap_or_else(|e| panic!("{e}\n{e:?}"));
    let wgsl = shader.wgsl().expect("WGSL");
    let parsed = naga::front::wgsl::parse_str(&wgsl).unwrap_or_else(|e| panic!("{}\n{wgsl}", e.emit_to_string(&wgsl)));
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&parsed)
        .unwrap_or_else(|e| panic!("{}\n{wgsl}", e.emit_to_string(&wgsl)));
    drop(info);
    let words: std::collections::HashSet<&str> =
        wgsl.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).collect();
    for (function, named) in (shader.module.functions.iter().map(|(_, f)| f))
        .chain(shader.module.entry_points.iter().map(|e| &e.function))
        .map(|f| (f, &f.named_expressions))
    {
        let locals = function.local_variables.iter().filter_map(|(_, v)| v.name.as_deref());
        let arguments = function.arguments.iter().filter_map(|a| a.name.as_deref());
        for name in named.values().map(String::as_str).chain(locals).chain(arguments).chain(function.name.as_deref()) {
            assert!(words.contains(name), "`{name}` was renamed in\n{wgsl}");
        }
    }
    for (_, g) in shader.module.global_variables.iter() {
        assert!(words.contains(g.name.as_deref().unwrap_or("?")));
    }
    assert!(!words.iter().any(|w| w.starts_with("_e")), "an unnamed value in\n{wgsl}");
    assert_eq!(shader.spirv().expect("SPIR-V")[0], 0x0723_0203);
    assert!(shader.glsl().expect("GLSL").contains("void main()"));
    let (hlsl, msl) = match kernel.stage {
        Stage::Compute(_) => ("numthreads(", "kernel void"),
        Stage::Vertex => ("SV_Position", "vertex "),
        Stage::Fragment => ("SV_Target", "fragment "),
    };
    assert!(shader.hlsl().expect("HLSL").contains(hlsl));
    assert!(shader.msl().expect("MSL").contains(msl));
    assert!(shader.naga_text().contains("entry_points"));
    (shader, wgsl)
}

/// A marcher in small: functions, loop, branches, buffers, texture, uniform.
fn march() -> Kernel {
    let mut density = Writer::new("плотность", &[("p", Ty::VEC3)], Some(Ty::F32));
    let p = Expr::Argument(0);
    let at = density.bind("cell", IVEC3, Expr::math(Math::Floor, [p.clone()]).convert(Prim::I32));
    let texel = Expr::texture_load(3, at);
    let value = density.traced("voxel", Ty::F32, texel.component(0).convert(Prim::F32), 30, 40);
    let r = density.traced("r²", Ty::F32, p.clone().dot(p), 50, 60);
    density.f.body.push(Stmt::Return(Some(value * (-r).exp())));
    density.f.origin = Some(Span::new(SourceId(0), 20, 70));

    let mut e = Writer::new("draw", &[], None);
    let id = e.bind("pixel", UVEC3, Expr::GlobalId);
    let width = e.bind("width", Ty::U32, component(Expr::Uniform(1), 0));
    let outside = Expr::binary(BinaryOp::GreaterEqual, component(id.clone(), 0), width.clone());
    e.f.body.push(Stmt::If(outside, vec![Stmt::Return(None)], vec![]));
    let index = e.bind(
        "index",
        Ty::U32,
        Expr::binary(BinaryOp::Add, Expr::binary(BinaryOp::Mul, component(id.clone(), 1), width), component(id, 0)),
    );
    let ray = e.bind("ray", Ty::float(4), Expr::load(2, index.clone()));
    let limit = e.bind("limit", Ty::F32, 100.0.into());
    let t = e.variable("t", Ty::F32, component(ray.clone(), 3));
    let tau = e.variable("τ", Ty::F32, 0.0.into());
    let n = e.variable("n", Ty::U32, 0u32.into());
    let count = Expr::Local(n).greater_equal(Expr::Uniform(4));
    let step = e.local("step", Ty::F32);
    let point = e.local("p", Ty::VEC3);
    let k = e.local("k", Ty::F32);
    let body = vec![
        Stmt::If(count.or(Expr::Local(t).greater(limit)), vec![Stmt::Break], vec![]),
        Stmt::Let(step, Expr::Uniform(3).max(0.01)),
        Stmt::Let(
            point,
            Expr::Uniform(2)
                + Expr::Compose(
                    Ty::VEC3,
                    vec![component(ray.clone(), 0), component(ray.clone(), 1), component(ray, 2)],
                ) * Expr::Local(t).splat(3),
        ),
        Stmt::Let(k, Expr::Call(FunctionId(0), vec![point.into()])),
        Stmt::Assign(tau, Expr::Local(tau) + Expr::Local(k) * Expr::Local(step)),
        Stmt::Assign(t, Expr::Local(t) + Expr::Local(step)),
        Stmt::Assign(n, Expr::binary(BinaryOp::Add, n, 1u32)),
        Stmt::If(Expr::Local(k).less(0.0), vec![Stmt::Continue], vec![Stmt::Assign(tau, Expr::Local(tau).abs())]),
    ];
    e.f.body.push(Stmt::Loop(body));
    e.f.body.push(Stmt::Store { buffer: 1, index, value: (-Expr::Local(tau)).exp() });
    let origins = [(tau, 80, 85), (k, 90, 99)];
    for (id, start, end) in origins {
        e.f.locals[id.0 as usize].origin = Some(Span::new(SourceId(0), start, end));
    }
    let mut k = kernel(e.f);
    k.functions.push(density.f);
    k
}

#[test]
fn a_marcher() {
    let (_, wgsl) = all_targets(&march());
    insta::assert_snapshot!(wgsl);
}

/// Every operator, function and expression once.
fn everything() -> Kernel {
    let hit = Ty::Struct(1);
    let mut nearest = Writer::new("nearest", &[("a", Ty::F32), ("b", Ty::F32)], Some(hit));
    let (a, b) = (Expr::Argument(0), Expr::Argument(1));
    nearest.f.body.push(Stmt::If(
        a.clone().less(b.clone()),
        vec![Stmt::Return(Some(Expr::Compose(hit, vec![a.clone(), vec3(1.0, 0.0, 0.0), true_()])))],
        vec![Stmt::Return(Some(Expr::Compose(hit, vec![b.clone(), vec3(0.0, 1.0, 0.0), Expr::Bool(false)])))],
    ));
    // Returns from within a loop that nothing breaks.
    let mut count = Writer::new("count", &[("limit", Ty::U32)], Some(Ty::U32));
    let i = count.variable("i", Ty::U32, 0u32.into());
    count.f.body.push(Stmt::Loop(vec![
        Stmt::If(Expr::Local(i).greater_equal(Expr::Argument(0)), vec![Stmt::Return(Some(Expr::Local(i)))], vec![]),
        Stmt::Assign(i, Expr::binary(BinaryOp::Add, i, 1u32)),
    ]));

    let mut e = Writer::new("everything", &[], None);
    let x = e.bind("x", Ty::F32, Expr::Uniform(3));
    let v = e.bind("v", Ty::VEC3, Expr::Uniform(2));
    let u = e.bind("u", Ty::U32, Expr::Uniform(4));
    let i = e.bind("i", Ty::I32, x.clone().convert(Prim::I32));
    let c = e.bind("c", Ty::BOOL, x.clone().greater(-0.5));
    for f in [
        Math::Abs,
        Math::Sign,
        Math::Floor,
        Math::Ceil,
        Math::Round,
        Math::Sqrt,
        Math::InverseSqrt,
        Math::Exp,
        Math::Log,
        Math::Sin,
        Math::Cos,
        Math::Tan,
        Math::Asin,
        Math::Acos,
        Math::Atan,
        Math::Sinh,
        Math::Cosh,
        Math::Tanh,
    ] {
        e.bind(&format!("{f:?}"), Ty::F32, Expr::math(f, [x.clone()]));
        e.bind(&format!("{f:?}_of_three"), Ty::VEC3, Expr::math(f, [v.clone()]));
    }
    for f in [Math::Atan2, Math::Pow, Math::Min, Math::Max] {
        e.bind(&format!("{f:?}"), Ty::F32, Expr::math(f, [x.clone(), 2.0.into()]));
        e.bind(&format!("{f:?}_of_three"), Ty::VEC3, Expr::math(f, [v.clone(), v.clone()]));
    }
    e.bind("clamp", Ty::F32, Expr::math(Math::Clamp, [x.clone(), 0.0.into(), 1.0.into()]));
    e.bind("clamp", Ty::I32, Expr::math(Math::Clamp, [i.clone(), Expr::I32(0), Expr::I32(9)]));
    e.bind("abs", Ty::I32, Expr::math(Math::Abs, [i.clone()]));
    e.bind("dot", Ty::F32, v.clone().dot(v.clone()));
    e.bind("cross", Ty::VEC3, Expr::math(Math::Cross, [v.clone(), vec3(0.0, 0.0, 1.0)]));
    e.bind("length", Ty::F32, Expr::math(Math::Length, [v.clone()]));
    e.bind("normalize", Ty::VEC3, Expr::math(Math::Normalize, [v.clone()]));
    use BinaryOp as B;
    for op in [B::Add, B::Sub, B::Mul, B::Div, B::Rem] {
        e.bind(&format!("{op:?}"), Ty::F32, Expr::binary(op, x.clone(), 3.0));
        e.bind(&format!("{op:?}_vector"), Ty::VEC3, Expr::binary(op, v.clone(), v.clone()));
        e.bind(&format!("{op:?}_unsigned"), Ty::U32, Expr::binary(op, u.clone(), 3u32));
        e.bind(&format!("{op:?}_signed"), Ty::I32, Expr::binary(op, i.clone(), Expr::I32(3)));
    }
    for op in [B::Less, B::LessEqual, B::Greater, B::GreaterEqual, B::Equal, B::NotEqual] {
        e.bind(&format!("{op:?}"), Ty::BOOL, Expr::binary(op, x.clone(), 3.0));
        e.bind(&format!("{op:?}_vector"), Ty::Value(Prim::Bool, 3), Expr::binary(op, v.clone(), v.clone()));
    }
    for op in [B::And, B::Or, B::BitAnd, B::BitOr, B::Equal, B::NotEqual] {
        e.bind(&format!("{op:?}"), Ty::BOOL, Expr::binary(op, c.clone(), !c.clone()));
    }
    for op in [B::BitAnd, B::BitOr, B::BitXor, B::ShiftLeft, B::ShiftRight] {
        e.bind(&format!("{op:?}"), Ty::U32, Expr::binary(op, u.clone(), 7u32));
        let three = Expr::U32(3).splat(3);
        e.bind(&format!("{op:?}"), UVEC3, Expr::binary(op, Expr::GlobalId, three));
    }
    e.bind("shift", Ty::I32, Expr::binary(B::ShiftRight, i.clone(), 3u32));
    e.bind("neg", Ty::I32, Expr::unary(UnaryOp::Neg, i.clone()));
    e.bind("neg", Ty::VEC3, -v.clone());
    e.bind("least", Ty::I32, Expr::binary(B::Add, Expr::I32(i32::MIN), i.clone()));
    e.bind("literal", Ty::F32, Expr::F32(1.5));
    e.bind("literal", Ty::BOOL, true_());
    e.bind("literal", Ty::I32, Expr::I32(-5));
    e.bind("literal", Ty::U32, Expr::U32(u32::MAX));
    for (to, from) in
        [(Prim::F32, &u), (Prim::F32, &i), (Prim::F32, &c), (Prim::U32, &x), (Prim::I32, &u), (Prim::Bool, &u)]
    {
        e.bind("converted", Ty::Value(to, 1), from.clone().convert(to));
    }
    e.bind("converted", Ty::Value(Prim::U32, 3), v.clone().convert(Prim::U32));
    for (to, from) in [(Prim::F32, &u), (Prim::U32, &x), (Prim::I32, &x), (Prim::U32, &i)] {
        e.bind("bits", Ty::Value(to, 1), from.clone().bitcast(to));
    }
    let infinity = e.bind("∞", Ty::F32, Expr::U32(0x7f80_0000).bitcast(Prim::F32));
    e.bind("not_a_number", Ty::F32, Expr::I32(0x7fc0_0000).bitcast(Prim::F32));
    e.bind("one", Ty::F32, Expr::U32(0x3f80_0000).bitcast(Prim::F32));
    e.bind("chosen", Ty::VEC3, c.clone().select(v.clone(), infinity.splat(3)));
    e.bind("chosen", Ty::I32, c.clone().select(i.clone(), Expr::I32(2)));
    for (texture, ty) in [(3, Prim::U32), (4, Prim::I32), (5, Prim::F32)] {
        let at = Expr::GlobalId.convert(Prim::I32);
        e.bind("texel", Ty::Value(ty, 4), Expr::texture_load(texture, at.clone()));
        e.bind("texel", Ty::Value(ty, 1), component(Expr::texture_load(texture, at), 1));
    }
    let found = e.bind("hit", hit, Expr::Call(FunctionId(0), vec![x.clone(), 4.0.into()]));
    e.bind("distance", Ty::F32, found.clone().field(0));
    let best = e.variable("best", hit, found);
    e.bind("normal", Ty::VEC3, Expr::Local(best).field(1));
    e.bind("copy", hit, Expr::Local(best));
    e.bind("alias", Ty::BOOL, c.clone());
    let calls = Expr::binary(
        BinaryOp::Add,
        Expr::Call(FunctionId(1), vec![u.clone()]),
        Expr::Call(FunctionId(1), vec![2u32.into()]),
    );
    let sum = e.bind("sum", Ty::U32, calls);
    let vec = Ty::Value(Prim::Bool, 2);
    e.bind("flags", vec, Expr::Compose(vec, vec![c.clone(), !c.clone()]));
    let old = Expr::load(1, sum.clone()) + component(Expr::load(2, u), 2);
    e.f.body.push(Stmt::Store { buffer: 1, index: sum, value: old });
    e.f.body.push(Stmt::If(c, vec![], vec![Stmt::Return(None)]));
    let mut k = kernel(e.f);
    let fields = vec![("t".into(), Ty::F32), ("normal".into(), Ty::VEC3), ("inside".into(), Ty::BOOL)];
    k.structs.push(Struct { name: "Hit".into(), fields, carries: None });
    k.functions = vec![nearest.f, count.f];
    k
}

fn true_() -> Expr {
    Expr::Bool(true)
}

#[test]
fn everything_in_every_target() {
    let (shader, wgsl) = all_targets(&everything());
    insta::assert_snapshot!(wgsl);
    // The names of calls are there in the other languages too.
    for text in [shader.glsl(), shader.hlsl(), shader.msl()] {
        let text = text.expect("text");
        assert!(text.contains(" hit = nearest("), "{text}");
        assert!(!text.contains(" _e"), "{text}");
    }
}

/// Corners that come out of a buffer, and pixels that say where they are.
#[test]
fn corners_and_pixels_in_every_target() {
    let varyings = vec![("position".into(), Ty::float(4)), ("slab".into(), Ty::U32), ("shade".into(), Ty::float(2))];
    let colors = vec![("light".into(), Ty::float(4)), ("sums".into(), Ty::float(4))];
    let (corner, color) = (Ty::Struct(1), Ty::Struct(2));
    let structs = [("Corner", Carries::Varyings, varyings), ("Colors", Carries::Colors, colors)]
        .map(|(name, carries, fields)| Struct { name: name.into(), fields, carries: Some(carries) });
    let staged = |stage, entry| {
        let mut k = kernel(entry);
        k.structs.extend(structs.clone());
        k.stage = stage;
        k
    };

    let mut outline = Writer::new("outline", &[], Some(corner));
    let at = Expr::load(2, Expr::VertexIndex + Expr::InstanceIndex);
    let at = outline.bind("at", Ty::float(4), at);
    let shade = Expr::Compose(Ty::float(2), vec![component(at.clone(), 0), component(at.clone(), 1)]);
    let value = Expr::Compose(corner, vec![at, Expr::InstanceIndex, shade]);
    outline.f.body.push(Stmt::Return(Some(value)));
    let (_, wgsl) = all_targets(&staged(Stage::Vertex, outline.f));
    insta::assert_snapshot!("corners", wgsl);

    let mut slice = Writer::new("slice", &[("corner", corner)], Some(color));
    let from = Expr::Argument(0);
    let light = slice.bind("light", Ty::float(4), from.clone().field(0) * component(from.clone().field(2), 0).splat(4));
    let sums = from.field(1).convert(Prim::F32).splat(4);
    slice.f.body.push(Stmt::Return(Some(Expr::Compose(color, vec![light, sums]))));
    let fragment = staged(Stage::Fragment, slice.f);
    let (_, wgsl) = all_targets(&fragment);
    insta::assert_snapshot!("pixels", wgsl);

    // A stage has what it has and nothing else.
    for stage in [Stage::Compute([8, 8, 1]), Stage::Vertex] {
        let wrong = Kernel { stage, ..fragment.clone() };
        assert!(crate::program::verify(&wrong).is_err());
    }
}

#[test]
fn variables_are_read_anew_after_assignments() {
    let mut e = Writer::new("e", &[], None);
    let a = e.variable("a", Ty::F32, Expr::Uniform(3));
    let b = e.variable("b", Ty::F32, 0.0.into());
    let c = e.variable("c", Ty::F32, Expr::Local(a) + Expr::Local(a));
    e.f.body.push(Stmt::If(
        Expr::Local(a).less(1.0),
        vec![Stmt::Assign(a, Expr::Local(a) * 2.0)],
        vec![Stmt::Assign(b, Expr::Local(a) * 3.0)],
    ));
    e.f.body.push(Stmt::Assign(c, Expr::Local(a) + Expr::Local(b) + Expr::Local(c)));
    e.f.body.push(Stmt::Loop(vec![
        Stmt::If(Expr::Local(c).greater(9.0), vec![Stmt::Break], vec![]),
        Stmt::Assign(c, Expr::Local(c) + Expr::Local(b)),
    ]));
    e.f.body.push(Stmt::Store { buffer: 1, index: 0u32.into(), value: Expr::Local(c) });
    let (_, wgsl) = all_targets(&kernel(e.f));
    insta::assert_snapshot!(wgsl);
}

#[test]
fn deep_and_wide_expressions_are_cut() {
    let mut e = Writer::new("e", &[], None);
    let mut deep = Expr::Uniform(3);
    for i in 0..150 {
        deep = (deep + f64::from(i)).abs();
    }
    let mut wide = Expr::Uniform(3);
    for _ in 0..8 {
        wide = wide.clone() * wide;
    }
    e.f.body.push(Stmt::Store { buffer: 1, index: 0u32.into(), value: deep });
    e.f.body.push(Stmt::Store { buffer: 1, index: 1u32.into(), value: wide });
    let (_, wgsl) = all_targets(&kernel(e.f));
    for line in wgsl.lines() {
        assert!(line.len() < 400, "{line}");
        let nesting = line.chars().scan(0, |d, c| {
            *d += i32::from(c == '(') - i32::from(c == ')');
            Some(*d)
        });
        assert!(nesting.max().unwrap_or(0) <= 15, "{line}");
    }
    assert!(wgsl.contains("let part = "));
}

#[test]
fn names_of_every_alphabet() {
    let mut e = Writer::new("e", &[], None);
    for name in [
        "σ_t",
        "sigma_t",
        "密度",
        "плотность",
        "loop",
        "half",
        "sample",
        "Texture2D",
        "x1",
        "x1",
        "x1_",
        "abs",
        "type",
        "records",
        "draw",
        "_e7",
        "main",
        "7",
        "",
        "a b",
        "new",
        "metal",
        "gl_x",
        "const_f32",
        "global_id",
        "type_1",
        "vec3f",
    ] {
        e.bind(name, Ty::F32, Expr::Uniform(3) + 1.0);
    }
    e.f.body.push(Stmt::Store { buffer: 1, index: component(Expr::GlobalId, 0), value: 1.0.into() });
    let (shader, wgsl) = all_targets(&kernel(e.f));
    for name in [
        "sigma_t",
        "sigma_t_b",
        "u5bc6_u5ea6_",
        "plotnost",
        "loop_v",
        "x1_",
        "x1_b",
        "x1_c",
        "draw_b",
        "records_b",
        "e7_",
    ] {
        assert!(wgsl.contains(&format!("let {name} = ")), "{name}\n{wgsl}");
    }
    // The other languages take the same names.
    for text in [shader.glsl(), shader.hlsl(), shader.msl()] {
        let text = text.expect("text");
        for (_, f) in shader.module.entry_points.iter().map(|e| ((), &e.function)) {
            for name in f.named_expressions.values() {
                assert!(text.contains(&format!(" {name} = ")), "`{name}` was renamed in\n{text}");
            }
        }
    }
}

#[test]
fn the_uniform_layout_is_that_of_the_module() {
    let source = UniformSource::Frame(FrameValue::White);
    for widths in [vec![1, 3, 1, 2, 4, 1], vec![3, 1, 3, 3], vec![2, 2, 3, 1, 1, 4], vec![1], vec![2, 1, 2]] {
        let fields = widths.iter().enumerate().map(|(i, w)| (format!("f{i}"), *w, i % 2 == 0, source));
        let layout = UniformLayout::new(fields);
        let mut e = Writer::new("e", &[], None);
        e.bind("x", Ty::U32, Expr::Uniform(0).bitcast(Prim::U32).component_or_self(widths[0]));
        let mut k = kernel(e.f);
        k.structs[0].fields = layout
            .fields
            .iter()
            .map(|f| (f.name.clone(), Ty::Value(if f.integer { Prim::U32 } else { Prim::F32 }, f.width)))
            .collect();
        let shader = emit(&k).expect("emits");
        let reparsed = naga::front::wgsl::parse_str(&shader.wgsl().expect("WGSL")).expect("parses");
        for module in [&shader.module, &reparsed] {
            let Some((members, span)) = module.types.iter().find_map(|(_, ty)| match &ty.inner {
                naga::TypeInner::Struct { members, span } => Some((members, *span)),
                _ => None,
            }) else {
                panic!("no struct")
            };
            let offsets: Vec<u32> = members.iter().map(|m| m.offset).collect();
            assert_eq!(offsets, layout.fields.iter().map(|f| f.offset).collect::<Vec<_>>(), "{widths:?}");
            assert!(layout.size.is_multiple_of(16) && layout.size >= span && layout.size < span + 16);
        }
    }
}

trait FirstComponent {
    fn component_or_self(self, width: u8) -> Expr;
}

impl FirstComponent for Expr {
    fn component_or_self(self, width: u8) -> Expr {
        if width == 1 { self } else { self.component(0) }
    }
}

#[test]
fn numbers_beyond_f32_are_refused_where_they_stand() {
    for (value, fits) in [
        (f64::NAN, false),
        (f64::INFINITY, false),
        (4e38, false),
        (-1e300, false),
        (3.4e38, true),
        (1e-42, true),
        (1e-300, true),
    ] {
        let mut e = Writer::new("e", &[], None);
        e.traced("x", Ty::F32, Expr::Uniform(3) + value, 5, 9);
        match emit(&kernel(e.f)) {
            Ok(_) => assert!(fits, "{value}"),
            Err(EmitError::Number { span, .. }) => {
                assert!(!fits, "{value}");
                assert_eq!(span, Some(Span::new(SourceId(0), 5, 9)));
            }
            Err(other) => panic!("{other}"),
        }
    }
}

#[test]
fn a_wrong_kernel_is_refused_before_naga_sees_it() {
    let mut e = Writer::new("e", &[], None);
    e.bind("x", Ty::F32, Expr::Uniform(2));
    let message = "function `e`: `x`: expected f32, not vec3<f32>";
    assert_eq!(emit(&kernel(e.f)).err(), Some(EmitError::Kernel(message.into())));
}

#[test]
fn every_error_has_an_explained_code() {
    let errors = [
        EmitError::Number { value: 1e99, span: None },
        EmitError::Kernel("x".into()),
        EmitError::Module { message: "x".into(), text: "y".into() },
        EmitError::Target { target: "GLSL", message: "x".into() },
    ];
    for e in errors {
        assert!(crate::diagnostic::explain(e.diagnostic().code).is_some());
    }
}

#[test]
fn an_unused_global_id_is_left_out() {
    let mut e = Writer::new("e", &[], None);
    e.f.body.push(Stmt::Store { buffer: 1, index: 0u32.into(), value: 1.0.into() });
    let (_, wgsl) = all_targets(&kernel(e.f));
    assert!(!wgsl.contains("global_invocation_id"));
}

#[test]
fn the_source_map_goes_both_ways() {
    let (shader, wgsl) = all_targets(&march());
    let span = |a, b| Span::new(SourceId(0), a, b);
    for text in [wgsl, shader.glsl().expect("GLSL"), shader.hlsl().expect("HLSL"), shader.msl().expect("MSL")] {
        let map = shader.source_map(&text);
        let lines: Vec<&str> = text.lines().collect();
        for (span, what) in [(span(30, 40), "voxel ="), (span(50, 60), " r2_ ="), (span(90, 99), " k = plotnost(")] {
            let generated = map.generated_lines(span);
            assert_eq!(generated.len(), 1, "{what}\n{text}");
            assert!(lines[generated[0] as usize - 1].contains(what), "{what}\n{text}");
            assert_eq!(map.scene_span(generated[0]), Some(span));
        }
        // The variable: where it is declared and wherever it is assigned.
        assert!(map.generated_lines(span(80, 85)).len() >= 3, "{text}");
        // A cursor inside an expression finds the expression around it.
        assert_eq!(map.generated_lines(span(33, 34)), map.generated_lines(span(30, 40)));
        // A line without a name of its own belongs to the function's item.
        let back = lines.iter().position(|l| l.contains("return") && l.contains("voxel")).expect("return") as u32 + 1;
        assert_eq!(map.scene_span(back), Some(span(20, 70)), "{text}");
        assert_eq!(map.scene_span(1), None);
        assert!(map.generated_lines(span(200, 210)).is_empty());
    }
    let mut sources = Sources::default();
    sources.add("scene.vol", "x\n".repeat(60));
    let map = shader.source_map(&shader.wgsl().expect("WGSL"));
    let entries = map.entries(&sources);
    assert_eq!(entries.len(), map.lines.len());
    let voxel = entries.iter().find(|e| e.name == "voxel").expect("voxel");
    assert_eq!((voxel.source.as_str(), voxel.line, voxel.column), ("scene.vol", 16, 1));
}
