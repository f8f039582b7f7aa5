//! Derivatives against central differences.

use crate::{Lattice, at_with, close, declare};
use compiler::ir::derive::{Unsupported, directional, gradient};
use compiler::ir::{Binary, Compare, Filter, Fold, Graph, Input, NodeId, Op, Table, Type, Unary, verify};
use proptest::prelude::*;

fn voxels(i: [u32; 3]) -> f64 {
    f64::from(i[0] * 29 + i[1] * 13 + i[2] * 7).sin()
}

/// Checks the gradient of `f` at a point against differences; the field must be smooth within `step` of it.
fn check(g: &mut Graph, f: NodeId, p: [f64; 3], step: f64, tolerance: f64) -> Result<(), TestCaseError> {
    let x = g.input(Input::Position);
    let slope = gradient(g, f, x).expect("a derivative");
    verify(g, &[f, slope]).map_err(TestCaseError::fail)?;
    let got = at_with(g, slope, p, &Lattice(voxels));
    for axis in 0..3 {
        let (mut low, mut high) = (p, p);
        low[axis] -= step;
        high[axis] += step;
        let value = |p| at_with(g, f, p, &Lattice(voxels))[0];
        let expected = (value(high) - value(low)) / (2.0 * step);
        prop_assert!(close(got[axis], expected, tolerance), "axis {axis}: {} against {expected}", got[axis]);
    }
    Ok(())
}

/// Three smooth, different scalars of the position, all between 0.2 and 0.9 for 0 < p < 1.
fn scalars(g: &mut Graph) -> [NodeId; 3] {
    let p = g.input(Input::Position);
    [[0.2, 0.3, 0.1, 0.25], [0.1, 0.1, 0.4, 0.21], [0.3, 0.05, 0.2, 0.3]].map(|[a, b, c, d]| {
        let (row, rest) = (g.vector(&[a, b, c]), g.scalar(d));
        let linear = g.dot(p, row);
        g.add(linear, rest)
    })
}

/// The scalars as a vector, so that componentwise rules are seen on vectors too.
fn vector(g: &mut Graph) -> NodeId {
    let parts = scalars(g);
    g.compose(&parts)
}

fn sum_of_parts(g: &mut Graph, v: NodeId) -> NodeId {
    let row = g.vector(&[1.0, -2.0, 0.5]);
    g.dot(v, row)
}

fn point() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(0.01..0.99f64)
}

const UNARY: [Unary; 17] = [
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
    Unary::Tanh,
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn unary_operations(p in point()) {
        for op in UNARY.into_iter().chain([Unary::Sinh, Unary::Cosh]) {
            let mut g = Graph::default();
            let v = vector(&mut g);
            let applied = g.unary(op, v);
            let f = sum_of_parts(&mut g, applied);
            // round jumps at one half.
            prop_assume!(at_with(&g, v, p, &Lattice(voxels)).iter().all(|x| (x - 0.5).abs() > 1e-4));
            check(&mut g, f, p, 1e-5, 1e-7).map_err(|e| TestCaseError::fail(format!("{op:?}: {e}")))?;
        }
    }

    #[test]
    fn binary_operations(p in point()) {
        let all = [Binary::Add, Binary::Sub, Binary::Mul, Binary::Div, Binary::Min, Binary::Max, Binary::Pow,
            Binary::Atan2, Binary::Mod];
        for op in all {
            for constant in 0..3 {
                let mut g = Graph::default();
                let a = vector(&mut g);
                let row = g.vector(&[0.7, 0.31, 0.45]);
                let swapped = { let s = scalars(&mut g); g.compose(&[s[1], s[2], s[0]]) };
                let (x, y) = match constant { 0 => (a, swapped), 1 => (a, row), _ => (row, a) };
                // Corners of min and max, and jumps of mod, have no derivative to compare with.
                let (vx, vy) = (at_with(&g, x, p, &Lattice(voxels)), at_with(&g, y, p, &Lattice(voxels)));
                prop_assume!(vx.iter().zip(&vy).all(|(x, y)| {
                    (x - y).abs() > 1e-4 && ((x / y) - (x / y).round()).abs() > 1e-3
                }));
                let applied = g.binary(op, x, y);
                let f = sum_of_parts(&mut g, applied);
                check(&mut g, f, p, 1e-5, 1e-6).map_err(|e| TestCaseError::fail(format!("{op:?}: {e}")))?;
            }
        }
    }

    #[test]
    fn powers_products_and_choices(p in point(), n in -4i32..6) {
        let mut g = Graph::default();
        let v = vector(&mut g);
        let power = g.powi(v, n);
        let f = sum_of_parts(&mut g, power);
        check(&mut g, f, p, 1e-5, 1e-6)?;
        let f = g.dot(v, power);
        check(&mut g, f, p, 1e-5, 1e-6)?;
        let [a, b, _] = scalars(&mut g);
        let condition = g.compare(Compare::Less, a, b);
        let third = g.extract(v, 2);
        let f = g.select(condition, a, third);
        let (va, vb) = (at_with(&g, a, p, &Lattice(voxels))[0], at_with(&g, b, p, &Lattice(voxels))[0]);
        prop_assume!((va - vb).abs() > 1e-4);
        check(&mut g, f, p, 1e-5, 1e-7)?;
        let wide = g.widen(a, 3);
        let product = g.mul(wide, v);
        let f = sum_of_parts(&mut g, product);
        check(&mut g, f, p, 1e-5, 1e-7)?;
    }

    #[test]
    fn loops(p in point(), trips in 1i32..6) {
        for fold in [Fold::Sum, Fold::Product, Fold::Min, Fold::Max] {
            let mut g = Graph::default();
            let [a, b, _] = scalars(&mut g);
            let i = g.push(Op::LoopVar(0));
            let j = g.push(Op::LoopVar(1));
            // An inner loop that uses both variables and the position.
            let angle = g.mul(a, j);
            let angle = g.add(angle, i);
            let wave = g.unary(Unary::Cos, angle);
            let inner = g.reduce(Fold::Sum, 1, 0..3, wave);
            let offset = g.mul(b, i);
            let body = g.add(inner, offset);
            let f = g.reduce(fold, 0, 0..trips, body);
            if matches!(fold, Fold::Min | Fold::Max) {
                // Not near a change of the extremum.
                let values: Vec<f64> = (0..trips).map(|k| {
                    let one = g.reduce(Fold::Sum, 0, k..k + 1, body);
                    at_with(&g, one, p, &Lattice(voxels))[0]
                }).collect();
                let mut sorted = values.clone();
                sorted.sort_by(f64::total_cmp);
                prop_assume!(sorted.windows(2).all(|w| w[1] - w[0] > 1e-3));
            }
            check(&mut g, f, p, 1e-5, 1e-6).map_err(|e| TestCaseError::fail(format!("{fold:?}: {e}")))?;
        }
    }

    #[test]
    fn grids_and_tables(p in point()) {
        for filter in [Filter::Nearest, Filter::Linear, Filter::Cubic] {
            let mut g = Graph::default();
            let grid = declare(&mut g, [5, 6, 4], filter, 0.0);
            // An oblique map into the grid.
            let x = g.input(Input::Position);
            let rows = [[2.0, 0.5, 0.0], [-0.5, 3.0, 0.3], [0.2, 0.1, 2.0]].map(|r| {
                let row = g.vector(&r);
                g.dot(row, x)
            });
            let turned = g.compose(&rows);
            let offset = g.vector(&[0.3, 0.8, 0.1]);
            let place = g.add(turned, offset);
            let f = g.push(Op::Sample { grid, at: place });
            let index = at_with(&g, place, p, &Lattice(voxels));
            // Corners of the linear filter at whole indices, jumps of the nearest one half-way.
            prop_assume!(index.iter().all(|v| ((2.0 * v) - (2.0 * v).round()).abs() > 1e-3));
            check(&mut g, f, p, 1e-5, 1e-7).map_err(|e| TestCaseError::fail(format!("{filter:?}: {e}")))?;
            // Through a table with a wide value.
            let keys = [-0.8, 0.1, 0.1, 0.7].map(|k| g.scalar(k)).to_vec();
            let values = [[0.0, 1.0], [2.0, 0.5], [5.0, -1.0], [3.0, 0.0]].map(|v| g.vector(&v)).to_vec();
            let table = g.add_table(Table { name: "t".into(), span: None, keys, values, width: 2 });
            let value = at_with(&g, f, p, &Lattice(voxels))[0];
            prop_assume!([-0.8, 0.1, 0.7].iter().all(|k: &f64| (value - k).abs() > 1e-3));
            let looked = g.push(Op::Lookup { table, at: f });
            let (a, b) = (g.extract(looked, 0), g.extract(looked, 1));
            let f = g.mul(a, b);
            check(&mut g, f, p, 1e-5, 1e-6).map_err(|e| TestCaseError::fail(format!("{filter:?} table: {e}")))?;
        }
    }

    /// A second derivative is the derivative of the first.
    #[test]
    fn twice(p in point()) {
        let mut g = Graph::default();
        let [a, b, c] = scalars(&mut g);
        let product = g.mul(a, b);
        let wave = g.unary(Unary::Sin, product);
        let f = g.binary(Binary::Pow, c, wave);
        let x = g.input(Input::Position);
        let first = gradient(&mut g, f, x).expect("a derivative");
        let along = g.extract(first, 1);
        check(&mut g, along, p, 1e-5, 1e-6)?;
    }

    #[test]
    fn along_a_direction(p in point(), d in prop::array::uniform3(-1.0..1.0f64)) {
        let mut g = Graph::default();
        let v = vector(&mut g);
        let f = g.unary(Unary::Exp, v);
        let (x, direction) = (g.input(Input::Position), g.vector(&d));
        let along = directional(&mut g, f, x, direction).expect("a derivative").expect("not zero");
        prop_assert_eq!(g.ty(along), Type::VEC3);
        let got = at_with(&g, along, p, &Lattice(voxels));
        for c in 0..3u8 {
            let part = g.extract(f, c);
            let slope = gradient(&mut g, part, x).expect("a derivative");
            let slope = at_with(&g, slope, p, &Lattice(voxels));
            let expected: f64 = (0..3).map(|i| slope[i] * d[i]).sum();
            prop_assert!(close(got[c as usize], expected, 1e-12));
        }
    }
}

#[test]
fn what_does_not_depend_on_the_variable_makes_no_node() {
    let mut g = Graph::default();
    let p = g.input(Input::Position);
    let time = g.input(Input::Time);
    let wave = g.unary(Unary::Sin, time);
    let cell = g.unary(Unary::Floor, p);
    let hash = g.push(Op::CellHash { cell, seed: time });
    let x = g.extract(p, 0);
    let noise = g.extract(hash, 1);
    let mut f = g.mul(wave, noise);
    f = g.mul(f, x);
    let before = g.len();
    let slope = gradient(&mut g, f, p).expect("a derivative");
    // sin(time) · noise in x, zero elsewhere: the vector and at most the constants it needs.
    let text = compiler::ir::print(&g, &[("slope".into(), slope)]);
    assert!(g.len() - before <= 6, "{text}");
    assert!(!text.contains("cos"), "no derivative of time:\n{text}");
    let zero = gradient(&mut g, wave, p).expect("a derivative");
    assert_eq!(g.constant(zero).expect("a constant").values(), [0.0; 3]);
}

/// The derivatives of a sum along the three axes share one loop.
#[test]
fn a_sum_is_one_loop() {
    let mut g = Graph::default();
    let p = g.input(Input::Position);
    let i = g.push(Op::LoopVar(0));
    let scaled = g.mul(p, i);
    let square = g.dot(scaled, scaled);
    let wave = g.unary(Unary::Cos, square);
    let f = g.reduce(Fold::Sum, 0, 0..5, wave);
    let slope = gradient(&mut g, f, p).expect("a derivative");
    let live = g.reachable(&[slope]);
    let loops = g.ids().filter(|id| live[id.0 as usize] && matches!(g.op(*id), Op::Reduce { .. }));
    assert_eq!(loops.count(), 1);
}

#[test]
fn the_variable_may_be_any_vector() {
    let mut g = Graph::default();
    let p = g.input(Input::Position);
    let scale = g.scalar(4.0);
    let q = g.mul(p, scale);
    let f = g.dot(q, q);
    let slope = gradient(&mut g, f, q).expect("a derivative");
    assert_eq!(at_with(&g, slope, [1.0, 2.0, 3.0], &Lattice(voxels)), [8.0, 16.0, 24.0], "2 q");
    let slope = gradient(&mut g, f, p).expect("a derivative");
    assert_eq!(at_with(&g, slope, [1.0, 2.0, 3.0], &Lattice(voxels)), [32.0, 64.0, 96.0], "32 p");
}

/// A variable made of a loop's variable is not the node of equal form inside another loop of that depth.
#[test]
fn a_loop_that_rebinds_the_variables_variable_is_constant() {
    let mut g = Graph::default();
    let p = g.input(Input::Position);
    let i = g.push(Op::LoopVar(0));
    let x = g.mul(p, i);
    let square = g.dot(x, x);
    let closed = g.reduce(Fold::Sum, 0, 0..3, square);
    let f = g.mul(closed, square);
    let slope = gradient(&mut g, f, x).expect("a derivative");
    let body = g.extract(slope, 0);
    let total = g.reduce(Fold::Sum, 0, 1..3, body);
    // closed · 2 x summed over i = 1, 2 with x = i p: closed = (0 + 1 + 4) |p|².
    let expected = 5.0 * 14.0 * 2.0 * (1.0 + 2.0);
    assert_eq!(at_with(&g, total, [1.0, 2.0, 3.0], &Lattice(voxels))[0], expected);
}

#[test]
fn what_has_no_derivative_is_said() {
    let mut g = Graph::default();
    let grid = declare(&mut g, [4, 4, 4], Filter::Cubic, 0.0);
    let p = g.input(Input::Position);
    let f = g.push(Op::Sample { grid, at: p });
    let first = gradient(&mut g, f, p).expect("a derivative");
    let size = g.dot(first, first);
    assert_eq!(gradient(&mut g, size, p), Err(Unsupported::SecondDerivativeOfGrid(grid)));

    let (i, x) = (g.push(Op::LoopVar(0)), g.extract(p, 0));
    let body = g.add(x, i);
    let long = g.reduce(Fold::Product, 0, 0..65, body);
    assert_eq!(gradient(&mut g, long, p), Err(Unsupported::LongFold(Fold::Product)));
    let constant = g.reduce(Fold::Product, 0, 0..65, i);
    assert!(gradient(&mut g, constant, p).is_ok(), "it does not depend on p");

    let altitude = g.input(Input::Altitude(0));
    assert_eq!(gradient(&mut g, altitude, p), Err(Unsupported::Altitude));
    assert_eq!(gradient(&mut g, p, p), Err(Unsupported::Shape));
    assert_eq!(gradient(&mut g, x, x), Err(Unsupported::Shape));
}
