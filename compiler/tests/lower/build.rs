//! A small language for checked scenes.

use compiler::check::hir::*;
use compiler::ir::{Aa, Backend, BandsKind, Filter, Fold, Param, ParamId, ParamType, Scattering, Tonemap};
use compiler::loader::{GridHeader, Scalar};
use compiler::source::{SourceId, Span};
use compiler::syntax::ast::BinaryOp;

pub(crate) fn span(at: u32) -> Span {
    Span { source: SourceId(0), start: at, end: at + 1 }
}

/// A dimension of this many powers of length.
pub(crate) fn length(power: i16) -> Dim {
    Dim { length: 12 * power, ..Dim::default() }
}

pub(crate) fn dimension(length: i16, light: i16) -> Dim {
    Dim { length: 12 * length, light: 12 * light, ..Dim::default() }
}

pub(crate) fn expr(kind: ExprKind, ty: Type) -> Expr {
    Expr { kind, ty, span: span(0) }
}

impl At for Expr {
    fn at(mut self, start: u32) -> Self {
        self.span = span(start);
        self
    }
}

/// Gives an expression a place of its own.
pub(crate) trait At {
    fn at(self, start: u32) -> Self;
}

/// A plain number.
pub(crate) fn n(value: f64) -> Expr {
    quantity(value, Dim::default())
}

pub(crate) fn quantity(value: f64, dim: Dim) -> Expr {
    expr(ExprKind::Number(value), Type::Number(dim))
}

/// A length in metres.
pub(crate) fn m(value: f64) -> Expr {
    quantity(value, length(1))
}

/// A coefficient in 1/m.
pub(crate) fn per_m(value: f64) -> Expr {
    quantity(value, length(-1))
}

pub(crate) fn v3(x: f64, y: f64, z: f64) -> Expr {
    vec3([x, y, z], Dim::default())
}

/// A position in metres.
pub(crate) fn m3(x: f64, y: f64, z: f64) -> Expr {
    vec3([x, y, z], length(1))
}

fn vec3(v: [f64; 3], dim: Dim) -> Expr {
    expr(ExprKind::Vector(v.map(|v| quantity(v, dim)).to_vec()), Type::Vec3(dim))
}

pub(crate) fn color(r: f64, g: f64, b: f64) -> Expr {
    expr(ExprKind::Color([r, g, b, 1.0]), Type::Color)
}

pub(crate) fn truth(t: bool) -> Expr {
    expr(ExprKind::Bool(t), Type::Bool)
}

pub(crate) fn p() -> Expr {
    expr(ExprKind::Input(Input::Position), Type::Vec3(length(1)))
}

pub(crate) fn input(input: Input) -> Expr {
    let ty = match input {
        Input::Position => Type::Vec3(length(1)),
        Input::Direction => Type::Vec3(Dim::default()),
        Input::Lambda => Type::Spectrum(length(1)),
        Input::Time => Type::Number(Dim { time: 12, ..Dim::default() }),
        Input::Altitude => Type::Number(length(1)),
        Input::CosTheta => Type::Number(Dim::default()),
    };
    expr(ExprKind::Input(input), ty)
}

pub(crate) fn local(id: u32, ty: Type) -> Expr {
    expr(ExprKind::Local(LocalId(id)), ty)
}

pub(crate) fn number() -> Type {
    Type::Number(Dim::default())
}

pub(crate) fn op(op: BinaryOp, a: Expr, b: Expr, ty: Type) -> Expr {
    expr(ExprKind::Binary(op, Box::new(a), Box::new(b)), ty)
}

pub(crate) fn call(builtin: Builtin, arguments: Vec<Expr>, ty: Type) -> Expr {
    expr(ExprKind::Builtin(builtin, arguments), ty)
}

pub(crate) fn function(id: u32, arguments: Vec<Expr>, ty: Type) -> Expr {
    expr(ExprKind::Call(FunctionId(id), arguments), ty)
}

pub(crate) fn component(vector: Expr, i: u8, dim: Dim) -> Expr {
    expr(ExprKind::Swizzle(Box::new(vector), vec![i]), Type::Number(dim))
}

/// `p.x` and so on, in metres.
pub(crate) fn px(i: u8) -> Expr {
    component(p(), i, length(1))
}

/// `p / 1 m`
pub(crate) fn plain_p() -> Expr {
    op(BinaryOp::Divide, p(), m(1.0), Type::Vec3(Dim::default()))
}

pub(crate) fn reduce(fold: Fold, variable: u32, start: Expr, end: Expr, body: Expr) -> Expr {
    let ty = body.ty.clone();
    expr(
        ExprKind::Reduce {
            fold,
            variable: LocalId(variable),
            name: "i".into(),
            start: Box::new(start),
            end: Box::new(end),
            body: Box::new(body),
        },
        ty,
    )
}

pub(crate) fn sphere(center: Expr, radius: f64) -> Expr {
    call(Builtin::Sphere, vec![center, m(radius)], Type::Shape)
}

pub(crate) fn medium(name: &str) -> Medium {
    Medium {
        name: name.into(),
        span: span(0),
        shape: None,
        transform: None,
        density: None,
        k_a: None,
        k_s: None,
        k_e: None,
        phase: None,
        transfer: None,
    }
}

pub(crate) fn param(name: &str, default: f64, length: f64) -> Param {
    Param {
        name: name.into(),
        span: None,
        docs: None,
        ty: ParamType::Float(1),
        dimension: [length, 0.0, 0.0, 0.0],
        default: vec![default],
        range: None,
    }
}

pub(crate) fn the_param(id: u32, dim: Dim) -> Expr {
    expr(ExprKind::Param(ParamId(id)), Type::Number(dim))
}

pub(crate) fn grid(dims: [u32; 3], world_from_index: [[f64; 4]; 3], filter: Filter) -> Grid {
    Grid {
        name: "head".into(),
        span: span(0),
        path: "head.nii".into(),
        from: "scene.vol".into(),
        header: GridHeader { dims, scalar: Scalar::U8, slope: 1.0, intercept: 0.0, world_from_index },
        filter,
        outside: 0.0,
    }
}

/// An empty scene in RGB with a camera 4 m in front of the origin.
pub(crate) fn scene() -> Scene {
    Scene {
        params: vec![],
        constants: vec![],
        functions: vec![],
        tables: vec![],
        grids: vec![],
        media: vec![],
        lights: vec![],
        surfaces: vec![],
        splats: vec![],
        pending: vec![],
        camera: Camera {
            span: None,
            from: Some(m3(0.0, 0.0, -4.0)),
            to: Some(m3(0.0, 0.0, 0.0)),
            up: None,
            projection: Projection::Perspective(None),
        },
        image: Image {
            span: None,
            size: [64, 64],
            aa: Aa::Analytic,
            bands: BandsKind::Rgb,
            wavelengths: vec![680e-9, 550e-9, 440e-9],
            exposure: None,
            tonemap: Tonemap::None,
            background: None,
        },
        render: Render {
            span: None,
            backend: Backend::Auto,
            scattering: Scattering::None,
            scattering_explicit: false,
            composite: Composite::Radiance,
            accuracy: 1e-2,
            steps: None,
            slices: None,
            stacks: compiler::ir::Stacks::View,
            splats: None,
            samples: None,
            pixels: compiler::ir::Pixels::Every,
            max_work: 65536,
        },
    }
}

/// A scene of one medium whose density, a plain number, is the expression.
pub(crate) fn with_density(density: Expr) -> Scene {
    let mut scene = scene();
    scene.media.push(Medium { density: Some(density), k_a: Some(per_m(1.0)), ..medium("cloud") });
    scene
}
