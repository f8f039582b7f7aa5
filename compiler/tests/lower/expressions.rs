//! Operators, choices, names, loops, calls, tables.

use crate::build::*;
use crate::{Place, close, here, in_units, metres, value, value_with};
use compiler::check::hir::*;
use compiler::ir::eval::{NoVoxels, Voxels};
use compiler::ir::{Filter, Fold, GridId as IrGrid, Op, Type as IrType, Units};
use compiler::syntax::ast::BinaryOp;

fn density(scene: &Scene) -> Vec<f64> {
    density_at(scene, &here(0.5, -2.0, 3.0))
}

/// The density of the first medium, whose k_a is 1/m.
fn density_at(scene: &Scene, place: &Place) -> Vec<f64> {
    let lowered = metres(scene);
    value(&lowered, lowered.media[0].k_a, place)
}

fn of(e: Expr) -> f64 {
    density(&with_density(e))[0]
}

fn truth_of(e: Expr) -> bool {
    of(expr(ExprKind::If(Box::new(e), Box::new(n(1.0)), Box::new(n(0.0))), number())) == 1.0
}

#[test]
fn arithmetic() {
    let binary = |o, a, b| of(op(o, n(a), n(b), number()));
    assert_eq!(binary(BinaryOp::Add, 2.0, 0.5), 2.5);
    assert_eq!(binary(BinaryOp::Subtract, 2.0, 0.5), 1.5);
    assert_eq!(binary(BinaryOp::Multiply, 2.0, 0.5), 1.0);
    assert_eq!(binary(BinaryOp::Divide, 2.0, 0.5), 4.0);
    assert_eq!(of(expr(ExprKind::Negate(Box::new(n(-3.0))), number())), 3.0);
    assert_eq!(
        of(component(op(BinaryOp::Multiply, n(2.0), plain_p(), Type::Vec3(Dim::default())), 2, Dim::default())),
        6.0
    );
}

#[test]
fn powers() {
    let power = |a: f64, b: f64| of(op(BinaryOp::Power, n(a), n(b), number()));
    assert_eq!([power(-2.0, 2.0), power(2.0, -2.0), power(-5.0, 0.0), power(9.0, 0.5)], [4.0, 0.25, 1.0, 3.0]);
    assert!(close(&[power(4.0, -0.5), power(2.0, 1.5)], &[0.5, 2.828_427_124_746_190_3], 1e-15));
    // What the exponent is decides the operation, also through names and arithmetic.
    let lowered = |e: Expr| {
        let lowered = metres(&with_density(op(BinaryOp::Power, component(plain_p(), 0, Dim::default()), e, number())));
        let ops: Vec<Op> = lowered.graph.ids().map(|id| *lowered.graph.op(id)).collect();
        (
            ops.iter().any(|o| matches!(o, Op::PowI(_, 3))),
            ops.iter().any(|o| matches!(o, Op::Binary(compiler::ir::Binary::Pow, ..))),
        )
    };
    assert_eq!(lowered(op(BinaryOp::Add, n(1.0), n(2.0), number())), (true, false));
    assert_eq!(lowered(n(2.5)), (false, true));
    assert_eq!(lowered(component(plain_p(), 1, Dim::default())), (false, true));
}

#[test]
fn comparison_and_logic() {
    let compare = |o, a, b| truth_of(op(o, n(a), n(b), Type::Bool));
    for (a, b) in [(1.0, 2.0), (2.0, 2.0), (3.0, 2.0)] {
        assert_eq!(compare(BinaryOp::Less, a, b), a < b);
        assert_eq!(compare(BinaryOp::LessEqual, a, b), a <= b);
        assert_eq!(compare(BinaryOp::Greater, a, b), a > b);
        assert_eq!(compare(BinaryOp::GreaterEqual, a, b), a >= b);
        assert_eq!(compare(BinaryOp::Equal, a, b), a == b);
        assert_eq!(compare(BinaryOp::NotEqual, a, b), a != b);
    }
    for a in [false, true] {
        assert_eq!(truth_of(expr(ExprKind::Not(Box::new(truth(a))), Type::Bool)), !a);
        for b in [false, true] {
            let logic = |o| truth_of(op(o, truth(a), truth(b), Type::Bool));
            assert_eq!(logic(BinaryOp::And), a && b);
            assert_eq!(logic(BinaryOp::Or), a || b);
            assert_eq!(logic(BinaryOp::Equal), a == b);
            assert_eq!(logic(BinaryOp::NotEqual), a != b);
        }
    }
    let vectors = |x| truth_of(op(BinaryOp::Equal, v3(1.0, 2.0, 3.0), v3(1.0, x, 3.0), Type::Bool));
    assert_eq!([vectors(2.0), vectors(2.5)], [true, false]);
}

#[test]
fn names_and_swizzles() {
    // { let q = p / 1 m  let x = q.zx  x.x * 10 + x.y }
    let q = local(0, Type::Vec3(Dim::default()));
    let zx = expr(ExprKind::Swizzle(Box::new(q), vec![2, 0]), Type::Vec2(Dim::default()));
    let pair = || local(1, Type::Vec2(Dim::default()));
    let last = op(
        BinaryOp::Add,
        op(BinaryOp::Multiply, component(pair(), 0, Dim::default()), n(10.0), number()),
        component(pair(), 1, Dim::default()),
        number(),
    );
    let block =
        ExprKind::Let(vec![(LocalId(0), "q".into(), plain_p()), (LocalId(1), "pair".into(), zx)], Box::new(last));
    let scene = with_density(expr(block, number()));
    assert_eq!(density(&scene), [30.5]);
    let lowered = metres(&scene);
    let names: Vec<&str> = lowered.graph.ids().filter_map(|id| lowered.graph.origin(id).name.as_deref()).collect();
    assert!(names.contains(&"q") && names.contains(&"pair") && names.contains(&"cloud.density"), "{names:?}");
}

/// A sum of a thousand terms is a tree a thousand deep.
#[test]
fn long_sums() {
    let sum = (1..=3000).fold(n(0.0), |sum, i| op(BinaryOp::Add, sum, n(f64::from(i)), number()));
    assert_eq!(of(sum), 3000.0 * 3001.0 / 2.0);
}

#[test]
fn loops_over_functions_of_their_variables() {
    // fn f(i, n) = sum(j in 0..n) i * j
    let mut scene =
        with_density(reduce(Fold::Sum, 0, n(0.0), n(4.0), function(0, vec![local(0, number()), n(3.0)], number())));
    let body = reduce(
        Fold::Sum,
        2,
        n(0.0),
        local(1, number()),
        op(BinaryOp::Multiply, local(0, number()), local(2, number()), number()),
    );
    scene.functions.push(Function {
        name: "f".into(),
        span: span(0),
        parameters: vec![("i".into(), number()), ("n".into(), number())],
        result: number(),
        body,
    });
    // (0 + 1 + 2 + 3) · (0 + 1 + 2)
    assert_eq!(density(&scene), [18.0]);
    // A bound may be computed, even by a loop over constants.
    let bound = reduce(Fold::Product, 1, n(1.0), n(4.0), local(1, number()));
    assert_eq!(of(reduce(Fold::Max, 0, n(0.0), bound, local(0, number()))), 5.0);
    // Backwards is empty.
    assert_eq!(of(reduce(Fold::Sum, 0, n(3.0), n(1.0), n(1.0))), 0.0);
}

#[test]
fn calls_share_what_is_equal() {
    // g(x) = exp(x) + exp(x); twice with the same argument.
    let exp = |e| call(Builtin::Exp, vec![e], number());
    let argument = || local(0, number());
    let x = || component(plain_p(), 0, Dim::default());
    let mut scene = with_density(op(
        BinaryOp::Multiply,
        function(0, vec![x()], number()),
        function(0, vec![x()], number()),
        number(),
    ));
    scene.functions.push(Function {
        name: "g".into(),
        span: span(0),
        parameters: vec![("x".into(), number())],
        result: number(),
        body: op(BinaryOp::Add, exp(argument()), exp(argument()), number()),
    });
    let lowered = metres(&scene);
    let exps = lowered.graph.ids().filter(|id| matches!(lowered.graph.op(*id), Op::Unary(compiler::ir::Unary::Exp, _)));
    assert_eq!(exps.count(), 1);
    assert!(close(&density(&scene), &[(2.0 * f64::exp(0.5)).powi(2)], 1e-15));
}

/// A scalar argument of a vector parameter is a vector inside.
#[test]
fn scalars_widen_to_vector_parameters() {
    let mut scene = with_density(function(0, vec![n(2.0)], number()));
    let v = || local(0, Type::Vec3(Dim::default()));
    scene.functions.push(Function {
        name: "size".into(),
        span: span(0),
        parameters: vec![("v".into(), Type::Vec3(Dim::default()))],
        result: number(),
        body: call(Builtin::Dot, vec![v(), v()], number()),
    });
    assert_eq!(density(&scene), [12.0]);
}

#[test]
fn constants_and_params() {
    let mut scene = with_density(op(
        BinaryOp::Multiply,
        expr(ExprKind::Const(ConstId(0)), number()),
        op(BinaryOp::Divide, the_param(0, length(1)), m(1.0), number()),
        number(),
    ));
    scene.constants.push(("two".into(), op(BinaryOp::Add, n(1.0), n(1.0), number())));
    scene.params.push(param("radius", 2.5, 1.0));
    assert_eq!(density(&scene), [5.0]);
    let lowered = metres(&scene);
    assert_eq!(lowered.graph.params, [IrType::SCALAR]);
}

#[test]
fn time_direction_and_angle() {
    let seconds = Dim { time: 12, ..Dim::default() };
    let time = op(BinaryOp::Divide, input(Input::Time), quantity(1.0, seconds), number());
    let dir = component(input(Input::Direction), 1, Dim::default());
    let sum = op(BinaryOp::Add, op(BinaryOp::Add, time, dir, number()), input(Input::CosTheta), number());
    let place = Place { time: 3.0, direction: [0.0, 0.5, 0.8], cos_theta: 0.25, ..Place::default() };
    assert_eq!(density_at(&with_density(sum), &place), [3.75]);
}

#[test]
fn tables() {
    // table t { 0 m: 1  2 m: 5 } at p.z, one entry of which reads another table.
    let key = op(BinaryOp::Add, px(2), m(-2.0), Type::Number(length(1)));
    let mut scene = with_density(expr(ExprKind::Lookup(TableId(0), Box::new(key)), number()));
    let inner = expr(ExprKind::Lookup(TableId(1), Box::new(n(0.5))), number());
    let rows = |rows| Table { name: "t".into(), span: span(0), key: number(), rows: TableRows::Values(rows) };
    scene.tables.push(rows(vec![(m(0.0), n(1.0)), (m(2.0), inner)]));
    scene.tables.push(rows(vec![(n(0.0), n(0.0)), (n(1.0), n(10.0))]));
    assert_eq!(density(&scene), [3.0]);
}

#[test]
fn transfer_functions() {
    let mut scene = scene();
    let layer = expr(ExprKind::Lookup(TableId(0), Box::new(component(plain_p(), 0, Dim::default()))), Type::Layer);
    let k = expr(ExprKind::LayerK(Box::new(layer.clone())), Type::Number(length(-1)));
    let c = expr(ExprKind::LayerColor(Box::new(layer.clone())), Type::Color);
    let k_e = op(BinaryOp::Multiply, k.clone(), c, Type::Spectrum(dimension(-1, 1)));
    scene.tables.push(Table {
        name: "tissue".into(),
        span: span(0),
        key: number(),
        rows: TableRows::Layers(vec![
            (n(0.0), color(0.0, 0.5, 1.0), per_m(0.0)),
            (n(1.0), color(1.0, 0.5, 0.0), op(BinaryOp::Multiply, n(2.0), per_m(20.0), Type::Number(length(-1)))),
        ]),
    });
    scene.media.push(Medium { k_a: Some(k), k_e: Some(k_e), transfer: Some(layer), ..medium("scan") });
    let lowered = metres(&scene);
    let place = here(0.25, 0.0, 0.0);
    assert_eq!(value(&lowered, lowered.media[0].k_a, &place), [10.0]);
    assert_eq!(value(&lowered, lowered.media[0].k_e, &place), [2.5, 5.0, 7.5]);
    assert_eq!(lowered.graph.tables[0].width, 4);
}

struct Ramp;

impl Voxels for Ramp {
    fn voxel(&self, _grid: IrGrid, index: [u32; 3]) -> f64 {
        f64::from(index[0]) + 10.0 * f64::from(index[1]) + 100.0 * f64::from(index[2])
    }
}

/// A grid of 2 × 3 × 5 mm voxels, turned a quarter about z and shifted.
pub(crate) fn oblique() -> Grid {
    grid([8, 8, 8], [[0.0, -3e-3, 0.0, 0.1], [2e-3, 0.0, 0.0, 0.2], [0.0, 0.0, 5e-3, 0.3]], Filter::Linear)
}

#[test]
fn grids_sit_where_their_header_says() {
    let mut scene = with_density(expr(ExprKind::Sample(GridId(0), Box::new(p())), number()));
    scene.grids.push(oblique());
    // The world place of voxel (1.5, 2, 3).
    let place = here(0.1 - 3e-3 * 2.0, 0.2 + 2e-3 * 1.5, 0.3 + 5e-3 * 3.0);
    for unit in [1.0, 64.0, 1.0 / 64.0] {
        let lowered = in_units(&scene, Units { length: unit });
        let got = value_with(&lowered, lowered.media[0].k_a, &place, &Ramp)[0] / unit;
        assert!(close(&[got], &[1.5 + 20.0 + 300.0], 1e-10), "{got}");
        assert_eq!(value_with(&lowered, lowered.media[0].k_a, &place, &NoVoxels), [0.0]);
    }
}

#[test]
fn the_gradient_of_a_grid_is_per_metre() {
    let sample = expr(ExprKind::Sample(GridId(0), Box::new(p())), number());
    let slope = call(Builtin::Gradient, vec![sample, p()], Type::Vec3(length(-1)));
    let scaled = op(BinaryOp::Multiply, component(slope, 0, length(-1)), m(-1.0), number());
    let mut scene = with_density(scaled);
    scene.grids.push(oblique());
    let lowered = metres(&scene);
    let place = here(0.1 - 3e-3 * 2.2, 0.2 + 2e-3 * 1.5, 0.3 + 5e-3 * 3.1);
    let got = value_with(&lowered, lowered.media[0].k_a, &place, &Ramp);
    // Along world x the second index falls by 1 per 3 mm.
    assert!(close(&got, &[10.0 / 3e-3], 1e-9), "{got:?}");
}
