//! Every function of the prelude against values worked out by hand.

use crate::build::*;
use crate::{close, here, metres, value};
use compiler::check::hir::{Builtin, Dim, Expr, ExprKind, Surface, SurfaceShape, Type};
use compiler::loader::MeshHeader;
use compiler::syntax::ast::BinaryOp;

/// The value of an expression at p = (0.5, −2, 3) m, component by component.
fn eval(e: Expr) -> Vec<f64> {
    match e.ty {
        Type::Vec3(_) => (0..3).map(|i| scalar(component(e.clone(), i, Dim::default()))).collect(),
        _ => vec![scalar(e)],
    }
}

/// Lowering takes any number as an albedo, of either sign.
fn scalar(e: Expr) -> f64 {
    let mut scene = scene();
    let header = MeshHeader { triangles: 1, bounds: ([0.0; 3], [1.0; 3]) };
    let shape = SurfaceShape::Mesh { path: "probe.obj".into(), from: "test".into(), header };
    scene.surfaces.push(Surface { name: "probe".into(), span: span(0), shape, albedo: Some(e) });
    let lowered = metres(&scene);
    value(&lowered, lowered.surfaces[0].albedo, &here(0.5, -2.0, 3.0))[0]
}

fn one(builtin: Builtin, x: f64) -> f64 {
    eval(call(builtin, vec![n(x)], number()))[0]
}

fn two(builtin: Builtin, x: f64, y: f64) -> f64 {
    eval(call(builtin, vec![n(x), n(y)], number()))[0]
}

fn three(builtin: Builtin, x: f64, y: f64, z: f64) -> f64 {
    eval(call(builtin, vec![n(x), n(y), n(z)], number()))[0]
}

fn vectors(builtin: Builtin, arguments: Vec<Expr>) -> Vec<f64> {
    eval(call(builtin, arguments, Type::Vec3(Dim::default())))
}

#[track_caller]
fn is(got: f64, expected: f64) {
    assert!(close(&[got], &[expected], 1e-14), "{got} against {expected}");
}

#[test]
fn of_one_number() {
    is(one(Builtin::Exp, 1.5), 4.481_689_070_338_065);
    is(one(Builtin::Expm1, 1e-12), 1.000_000_000_000_5e-12);
    is(one(Builtin::Log, 7.0), 1.945_910_149_055_313_2);
    is(one(Builtin::Log2, 8.0), 3.0);
    is(one(Builtin::Log10, 1000.0), 3.0);
    is(one(Builtin::Exp2, -1.5), 0.353_553_390_593_273_8);
    is(one(Builtin::Sqrt, 2.25), 1.5);
    is(one(Builtin::Cbrt, 27.0), 3.0);
    is(one(Builtin::Cbrt, -8.0), -2.0);
    is(one(Builtin::Cbrt, 0.0), 0.0);
    is(one(Builtin::Sin, 0.5), 0.479_425_538_604_203);
    is(one(Builtin::Cos, 0.5), 0.877_582_561_890_372_8);
    is(one(Builtin::Tan, 0.5), 0.546_302_489_843_790_5);
    is(one(Builtin::Asin, 0.5), std::f64::consts::FRAC_PI_6);
    is(one(Builtin::Acos, 0.5), std::f64::consts::FRAC_PI_3);
    is(one(Builtin::Atan, 1.0), std::f64::consts::FRAC_PI_4);
    is(one(Builtin::Sinh, 1.0), 1.175_201_193_643_801_4);
    is(one(Builtin::Cosh, 1.0), 1.543_080_634_815_243_7);
    is(one(Builtin::Tanh, 1.0), 0.761_594_155_955_764_9);
    is(one(Builtin::Abs, -3.5), 3.5);
    for (x, sign) in [(-2.0, -1.0), (0.0, 0.0), (0.1, 1.0)] {
        is(one(Builtin::Sign, x), sign);
    }
    for (x, floor, ceil, round, fract) in [
        (1.25, 1.0, 2.0, 1.0, 0.25),
        (-1.25, -2.0, -1.0, -1.0, 0.75),
        (2.5, 2.0, 3.0, 2.0, 0.5),
        (3.5, 3.0, 4.0, 4.0, 0.5),
    ] {
        is(one(Builtin::Floor, x), floor);
        is(one(Builtin::Ceil, x), ceil);
        is(one(Builtin::Round, x), round);
        is(one(Builtin::Fract, x), fract);
    }
}

#[test]
fn of_two_and_three_numbers() {
    is(two(Builtin::Atan2, 1.0, -1.0), 2.356_194_490_192_345);
    is(two(Builtin::Min, 1.0, -1.0), -1.0);
    is(two(Builtin::Max, 1.0, -1.0), 1.0);
    is(eval(call(Builtin::Max, vec![n(1.0), n(7.0), n(3.0), n(5.0)], number()))[0], 7.0);
    is(eval(call(Builtin::Min, vec![n(1.0), n(7.0), n(-3.0), n(5.0)], number()))[0], -3.0);
    is(two(Builtin::Pow, 2.0, 0.25), 1.189_207_115_002_721);
    is(two(Builtin::Pow, -2.0, 3.0), -8.0);
    is(two(Builtin::Mod, -1.0, 3.0), 2.0);
    is(two(Builtin::Mod, 7.5, -2.0), -0.5);
    is(three(Builtin::Clamp, 5.0, 0.0, 2.0), 2.0);
    is(three(Builtin::Clamp, -5.0, 0.0, 2.0), 0.0);
    is(three(Builtin::Clamp, 1.5, 0.0, 2.0), 1.5);
    is(three(Builtin::Mix, 10.0, 20.0, 0.25), 12.5);
    assert_eq!(three(Builtin::Mix, 1e20, 3.0, 1.0), 3.0, "exact at the end");
    for (x, step) in [(0.9, 0.0), (1.0, 1.0), (1.1, 1.0)] {
        is(two(Builtin::Step, 1.0, x), step);
    }
    for (x, smooth) in [(0.0, 0.0), (1.5, 0.15625), (2.0, 0.5), (9.0, 1.0)] {
        is(three(Builtin::Smoothstep, 1.0, 3.0, x), smooth);
    }
    is(two(Builtin::Opacity, 0.5, 2.0), std::f64::consts::LN_2 / 2.0);
}

#[test]
fn of_vectors() {
    let (a, b) = (v3(1.0, 2.0, -2.0), v3(3.0, -1.0, 4.0));
    is(eval(call(Builtin::Dot, vec![a.clone(), b.clone()], number()))[0], -7.0);
    is(eval(call(Builtin::Length, vec![a.clone()], number()))[0], 3.0);
    is(eval(call(Builtin::Length, vec![n(-2.0)], number()))[0], 2.0);
    is(eval(call(Builtin::Distance, vec![a.clone(), b.clone()], number()))[0], 7.0);
    assert_eq!(vectors(Builtin::Cross, vec![a.clone(), b.clone()]), [6.0, -10.0, -7.0]);
    assert!(close(&vectors(Builtin::Normalize, vec![a.clone()]), &[1.0 / 3.0, 2.0 / 3.0, -2.0 / 3.0], 1e-15));
    let normal = v3(0.0, 1.0, 0.0);
    assert_eq!(vectors(Builtin::Reflect, vec![a.clone(), normal]), [1.0, -2.0, -2.0]);
    assert_eq!(vectors(Builtin::Vec3, vec![n(1.0), n(2.0), n(3.0)]), [1.0, 2.0, 3.0]);
    assert_eq!(vectors(Builtin::Step, vec![n(0.0), a.clone()]), [1.0, 1.0, 0.0]);
    assert_eq!(vectors(Builtin::Max, vec![a.clone(), b.clone()]), [3.0, 2.0, 4.0]);
    assert_eq!(vectors(Builtin::Clamp, vec![a.clone(), n(-1.0), n(1.0)]), [1.0, 1.0, -1.0]);
    assert_eq!(vectors(Builtin::Mix, vec![a, b, n(0.5)]), [2.0, 0.5, 1.0]);
    let pair = call(Builtin::Vec2, vec![n(3.0), n(4.0)], Type::Vec2(Dim::default()));
    is(eval(call(Builtin::Length, vec![pair], number()))[0], 5.0);
}

#[test]
fn of_colours() {
    let c = color(0.25, 0.5, 1.0);
    is(eval(call(Builtin::Luminance, vec![c], number()))[0], 0.2126 * 0.25 + 0.7152 * 0.5 + 0.0722);
    let made = call(Builtin::Color, vec![n(0.25), n(0.5), n(1.0)], Type::Color);
    is(eval(component(made, 2, Dim::default()))[0], 1.0);
    let layer = call(Builtin::Layer, vec![color(0.1, 0.2, 0.3), n(7.0)], Type::Layer);
    let k = ExprKind::LayerK(Box::new(layer.clone()));
    is(eval(expr(k, number()))[0], 7.0);
    let layer_color = expr(ExprKind::LayerColor(Box::new(layer)), Type::Color);
    is(eval(component(layer_color, 1, Dim::default()))[0], 0.2);
}

#[test]
fn of_cells() {
    let hash = compiler::ir::eval::cell_hash([0.0, -2.0, 3.0], 5.0);
    let q = call(Builtin::Floor, vec![plain_p()], Type::Vec3(Dim::default()));
    assert_eq!(vectors(Builtin::CellHash3, vec![q.clone(), n(5.0)]), hash);
    is(eval(call(Builtin::CellHash, vec![q, n(5.0)], number()))[0], hash[0]);
}

/// |p − c|² has the gradient 2 (p − c), and so has anything built on it by the chain rule.
#[test]
fn gradient() {
    let offset = op(BinaryOp::Subtract, p(), m3(1.0, 1.0, 1.0), Type::Vec3(length(1)));
    let square = call(Builtin::Dot, vec![offset.clone(), offset.clone()], Type::Number(length(2)));
    let slope = call(Builtin::Gradient, vec![square.clone(), p()], Type::Vec3(length(1)));
    assert_eq!(eval(slope), [-1.0, -6.0, 4.0]);
    let distance = call(Builtin::Length, vec![offset], Type::Number(length(1)));
    let unit = call(Builtin::Gradient, vec![distance, p()], Type::Vec3(Dim::default()));
    let size = f64::sqrt(0.25 + 9.0 + 4.0);
    assert!(close(&eval(unit), &[-0.5 / size, -3.0 / size, 2.0 / size], 1e-15));
}
