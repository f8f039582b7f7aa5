//! What lowering refuses, and where it points.

use crate::build::*;
use crate::{codes, faults, metres};
use compiler::check::hir::*;
use compiler::ir::{Filter, Fold};
use compiler::syntax::ast::BinaryOp;

fn looping(end: Expr) -> Expr {
    reduce(Fold::Sum, 9, n(0.0), end, n(1.0)).at(50)
}

#[test]
fn a_param_cannot_bound_a_loop_and_the_argument_is_shown() {
    // fn inner(n) = sum(i in 0..2 * n) 1; fn outer(k) = { let j = k  inner(j) }; density = outer(octaves)
    let mut scene = with_density(function(1, vec![the_param(0, Dim::default()).at(10)], number()).at(9));
    scene.params.push(param("octaves", 4.0, 0.0));
    let bound = op(BinaryOp::Multiply, n(2.0), local(0, number()).at(21), number()).at(20);
    let f = |name: &str, body| Function {
        name: name.into(),
        span: span(0),
        parameters: vec![("n".into(), number())],
        result: number(),
        body,
    };
    scene.functions.push(f("inner", looping(bound)));
    let call_inner = function(0, vec![local(1, number()).at(31)], number()).at(30);
    let block = ExprKind::Let(vec![(LocalId(1), "j".into(), local(0, number()).at(40))], Box::new(call_inner));
    scene.functions.push(f("outer", expr(block, number())));
    assert_eq!(faults(&scene), [("E0501", vec![10, 20])], "the param, and the bound it reaches");
    scene.media[0].density = Some(function(1, vec![n(4.0)], number()));
    assert_eq!(codes(&scene), [""; 0]);
}

#[test]
fn bounds_are_whole_constants() {
    assert_eq!(faults(&with_density(looping(n(2.5).at(7)))), [("E0502", vec![7, 50])]);
    assert_eq!(codes(&with_density(looping(n(f64::INFINITY)))), ["E0502"]);
    assert_eq!(codes(&with_density(looping(component(plain_p(), 0, Dim::default())))), ["E0501"]);
    // The variable of an outer loop is no constant either.
    let triangle = reduce(Fold::Sum, 0, n(0.0), n(4.0), reduce(Fold::Sum, 1, n(0.0), local(0, number()), n(1.0)));
    assert_eq!(codes(&with_density(triangle)), ["E0501"]);
}

#[test]
fn loops_may_not_run_too_often() {
    assert_eq!(codes(&with_density(looping(n(4096.0)))), [""; 0]);
    assert_eq!(codes(&with_density(looping(n(4097.0)))), ["E0503"]);
    let nest = |a: f64, b: f64| reduce(Fold::Sum, 0, n(0.0), n(a), reduce(Fold::Sum, 1, n(0.0), n(b), n(1.0)));
    assert_eq!(codes(&with_density(nest(1024.0, 1024.0))), [""; 0]);
    assert_eq!(codes(&with_density(nest(1024.0, 1025.0))), ["E0503"]);
    // Many nests, each within the limit, that are not equal.
    let many = (0..20).fold(n(0.0), |sum, i| {
        let nest = nest(1024.0, 1024.0 - f64::from(i));
        op(BinaryOp::Add, sum, nest, number())
    });
    assert_eq!(codes(&with_density(many)), ["E0503"]);
    let deep = (0..13).fold(n(1.0), |body, i| reduce(Fold::Sum, i, n(0.0), n(1.0), body));
    assert_eq!(codes(&with_density(deep)), ["E0504"]);
}

#[test]
fn the_extremum_of_nothing() {
    assert_eq!(codes(&with_density(reduce(Fold::Max, 0, n(2.0), n(2.0), n(1.0)))), ["E0514"]);
    assert_eq!(codes(&with_density(reduce(Fold::Min, 0, n(2.0), n(1.0), n(1.0)))), ["E0514"]);
}

fn doubling(levels: u32, step: impl Fn(Expr, u32) -> Expr) -> Scene {
    // f0(x) = x; f(k)(x) = f(k−1)(x) + f(k−1)(step(x, k))
    let x = || local(0, number());
    let mut scene = with_density(function(levels, vec![component(plain_p(), 0, Dim::default())], number()));
    for level in 0..=levels {
        let body = match level {
            0 => x(),
            _ => op(
                BinaryOp::Add,
                function(level - 1, vec![x()], number()),
                function(level - 1, vec![step(x(), level)], number()),
                number(),
            ),
        };
        scene.functions.push(Function {
            name: format!("f{level}"),
            span: span(0),
            parameters: vec![("x".into(), number())],
            result: number(),
            body,
        });
    }
    scene
}

/// Sixty doublings would be 10¹⁸ calls; equal ones are lowered once.
#[test]
fn calls_that_double_at_every_level_are_shared() {
    let lowered = metres(&doubling(60, |x, _| x));
    assert!(lowered.graph.len() < 200, "{} nodes", lowered.graph.len());
}

/// Where every call is different they are counted, and it ends.
#[test]
fn calls_that_double_and_differ_are_too_many() {
    let scene = doubling(60, |x, level| op(BinaryOp::Add, x, n(f64::from(level)), number()));
    assert_eq!(codes(&scene)[0], "E0505");
}

#[test]
fn nesting_is_bounded() {
    let nested = |depth| (0..depth).fold(n(0.5), |e, _| call(Builtin::Cos, vec![e], number()));
    assert_eq!(codes(&with_density(nested(200))), [""; 0]);
    assert_eq!(codes(&with_density(nested(5000))), ["E0505"]);
}

/// Each derivative of a product of n factors has n terms; n of those nested would be n^n.
#[test]
fn derivatives_are_bounded() {
    let mut f = component(plain_p(), 0, Dim::default());
    for id in 0..6 {
        let shift = op(BinaryOp::Multiply, n(10f64.powi(id)), local(id as u32, number()), number());
        f = op(BinaryOp::Add, f, shift, number());
    }
    f = call(Builtin::Sin, vec![f], number());
    for id in 0..6 {
        f = reduce(Fold::Product, id, n(0.0), n(10.0), f);
    }
    let slope = call(Builtin::Gradient, vec![f, p()], Type::Vec3(length(-1)));
    let scaled = op(BinaryOp::Multiply, component(slope, 0, length(-1)), m(1.0), number());
    assert_eq!(codes(&with_density(scaled)), ["E0505"]);
}

#[test]
fn no_second_derivative_of_a_grid() {
    let sample = expr(ExprKind::Sample(GridId(0), Box::new(p())), number());
    let slope = call(Builtin::Gradient, vec![sample, p()], Type::Vec3(length(-1)));
    let size = call(Builtin::Length, vec![slope], Type::Number(length(-1)));
    let twice = call(Builtin::Gradient, vec![size, p()], Type::Vec3(length(-2))).at(12);
    let k = op(BinaryOp::Multiply, component(twice, 0, length(-2)), quantity(1.0, length(2)), number());
    let mut scene = with_density(k);
    scene.grids.push(crate::expressions::oblique());
    assert_eq!(faults(&scene), [("E0506", vec![12])]);
}

#[test]
fn a_flat_grid() {
    let mut scene = with_density(expr(ExprKind::Sample(GridId(0), Box::new(p())), number()));
    let flat = [[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 1.0, 0.0], [1.0, 1.0, 2.0, 0.0]];
    scene.grids.push(grid([2, 2, 2], flat, Filter::Linear));
    assert_eq!(codes(&scene), ["E0515"]);
}

#[test]
fn unbounded_shapes_have_no_centre() {
    let slab = call(Builtin::Slab, vec![v3(0.0, 1.0, 0.0), m(0.0), m(1.0)], Type::Shape);
    let everywhere = call(Builtin::Everywhere, vec![], Type::Shape);
    let sdf = call(Builtin::Sdf, vec![px(0)], Type::Shape);
    let half = call(Builtin::Union, vec![sphere(m3(0.0, 0.0, 0.0), 1.0), slab.clone()], Type::Shape);
    for shape in [slab, everywhere, sdf, half] {
        let mut scene = scene();
        scene.camera.to = Some(call(Builtin::Center, vec![shape], Type::Vec3(length(1))));
        assert_eq!(codes(&scene), ["E0507"]);
    }
}

#[test]
fn what_must_not_be_zero() {
    let transformed = |t: Expr| {
        let mut scene = with_density(n(1.0));
        scene.media[0].transform = Some(t);
        scene
    };
    let scale = |e| call(Builtin::Scale, vec![e], Type::Transform);
    assert_eq!(codes(&transformed(scale(n(0.0)))), ["E0508"]);
    assert_eq!(codes(&transformed(scale(v3(1.0, 0.0, 1.0)))), ["E0508"]);
    let rotate = call(Builtin::Rotate, vec![v3(0.0, 0.0, 0.0), n(1.0)], Type::Transform);
    assert_eq!(codes(&transformed(rotate)), ["E0508"]);
    let mut scene = transformed(scale(the_param(0, Dim::default())));
    scene.params.push(param("size", 0.0, 0.0));
    assert_eq!(codes(&scene), ["E0508"], "at the default of the param");
    scene.params[0].default = vec![2.0];
    assert_eq!(codes(&scene), [""; 0]);
}

#[test]
fn what_may_not_differ_from_place_to_place() {
    let mut scene = with_density(n(1.0));
    scene.media[0].shape = Some(call(Builtin::Sphere, vec![m3(0.0, 0.0, 0.0), px(0).at(5)], Type::Shape));
    assert_eq!(faults(&scene), [("E0509", vec![5])]);
    let mut scene = with_density(n(1.0));
    scene.camera.from = Some(p());
    assert_eq!(codes(&scene), ["E0509"]);
    let mut scene = with_density(n(1.0));
    let light = dimension(0, 1);
    let radiance =
        op(BinaryOp::Multiply, component(plain_p(), 1, Dim::default()), quantity(1.0, light), Type::Number(light));
    scene.lights.push(Light { name: "sky".into(), span: span(0), kind: LightKind::Environment { radiance } });
    assert_eq!(codes(&scene), ["E0509"]);
}

#[test]
fn altitude_needs_an_even_shell() {
    let k = || op(BinaryOp::Divide, input(Input::Altitude), quantity(1.0, length(2)), Type::Number(length(-1)));
    let mut scene = scene();
    scene.media.push(Medium { k_a: Some(k()), ..medium("air") });
    assert_eq!(codes(&scene), ["E0511"]);
    let shell = call(Builtin::Shell, vec![m3(0.0, 0.0, 0.0), m(1.0), m(2.0)], Type::Shape);
    scene.media[0].shape = Some(shell);
    assert_eq!(codes(&scene), [""; 0]);
    scene.media[0].transform = Some(call(Builtin::Scale, vec![v3(1.0, 2.0, 1.0)], Type::Transform));
    assert_eq!(codes(&scene), ["E0511"]);
}

#[test]
fn cameras_that_see_nothing() {
    let mut scene = with_density(n(1.0));
    scene.camera.to = scene.camera.from.clone();
    assert_eq!(codes(&scene), ["E0512"]);
    let mut scene = with_density(n(1.0));
    scene.camera.up = Some(v3(0.0, 0.0, -2.0).at(3));
    assert_eq!(faults(&scene), [("E0512", vec![3])]);
    for fov in [0.0, -1.0, 3.2] {
        let mut scene = with_density(n(1.0));
        scene.camera.projection = Projection::Perspective(Some(n(fov)));
        assert_eq!(codes(&scene), ["E0512"], "{fov}");
    }
}

#[test]
fn shapes_are_chosen_when_compiling() {
    let choice = |c| {
        let (a, b) = (sphere(m3(0.0, 0.0, 0.0), 1.0), call(Builtin::Everywhere, vec![], Type::Shape));
        let mut scene = with_density(n(1.0));
        scene.params.push(param("big", 1.0, 0.0));
        scene.media[0].shape = Some(expr(ExprKind::If(Box::new(c), Box::new(a), Box::new(b)), Type::Shape));
        scene
    };
    let known = op(BinaryOp::Less, n(1.0), n(2.0), Type::Bool);
    assert_eq!(codes(&choice(known)), [""; 0]);
    let live = op(BinaryOp::Less, the_param(0, Dim::default()), n(2.0), Type::Bool);
    assert_eq!(codes(&choice(live)), ["E0513"]);
}

#[test]
fn coefficients_are_finite_and_not_negative() {
    for (value, code) in [(-1.0, "E0516"), (f64::NAN, "E0516"), (f64::INFINITY, "E0516")] {
        let mut scene = scene();
        scene.media.push(Medium { k_a: Some(per_m(value)), ..medium("cloud") });
        assert_eq!(codes(&scene), [code]);
    }
    let negative = op(BinaryOp::Subtract, n(1.0), n(2.0), number());
    assert_eq!(codes(&with_density(negative)), ["E0516"], "through the density");
}

/// One run reports everything it can.
#[test]
fn several_faults_at_once() {
    let mut scene = scene();
    scene.media.push(Medium { k_a: Some(per_m(-1.0)), k_s: Some(per_m(f64::NAN)), ..medium("a") });
    scene.media.push(Medium { density: Some(looping(n(0.5))), k_a: Some(per_m(1.0)), ..medium("b") });
    scene.camera.to = scene.camera.from.clone();
    assert_eq!(codes(&scene), ["E0516", "E0516", "E0502", "E0512"]);
}

/// Checking would never let these through; lowering says so instead of failing.
#[test]
fn broken_promises_are_reported() {
    assert_eq!(codes(&with_density(local(3, number()))), ["E0500"]);
    assert_eq!(codes(&with_density(op(BinaryOp::Add, n(1.0), truth(true), number()))), ["E0500"]);
    let pair = expr(ExprKind::Vector(vec![n(1.0), n(2.0)]), Type::Vec2(Dim::default()));
    assert_eq!(codes(&with_density(call(Builtin::Dot, vec![pair, v3(1.0, 2.0, 3.0)], number()))), ["E0500"]);
    assert_eq!(codes(&with_density(function(7, vec![], number()))), ["E0500"]);
    let mut scene = scene();
    scene.image.wavelengths = vec![];
    assert_eq!(codes(&scene), ["E0500"]);
}
