//! Piecewise-linear tables.

use crate::{at, close};
use compiler::ir::{Graph, Input, NodeId, Op, Table};
use proptest::prelude::*;

/// A lookup of these rows at p.x.
fn lookup(rows: &[(f64, &[f64])]) -> (Graph, NodeId, NodeId) {
    let mut g = Graph::default();
    let keys = rows.iter().map(|r| g.scalar(r.0)).collect();
    let values = rows.iter().map(|r| g.vector(r.1)).collect();
    let width = rows[0].1.len() as u8;
    let table = g.add_table(Table { name: "t".into(), span: None, keys, values, width });
    let p = g.input(Input::Position);
    let x = g.extract(p, 0);
    let value = g.push(Op::Lookup { table, at: x });
    let slope = g.push(Op::LookupSlope { table, at: x });
    (g, value, slope)
}

fn values(g: &Graph, node: NodeId, xs: &[f64]) -> Vec<f64> {
    xs.iter().map(|x| at(g, node, [*x, 0.0, 0.0])[0]).collect()
}

#[test]
fn between_rows_it_is_linear_and_beyond_the_ends_constant() {
    let (g, value, slope) = lookup(&[(0.0, &[1.0]), (2.0, &[5.0]), (6.0, &[1.0])]);
    let xs = [-10.0, 0.0, 0.5, 2.0, 4.0, 6.0, 100.0];
    assert_eq!(values(&g, value, &xs), [1.0, 1.0, 2.0, 5.0, 3.0, 1.0, 1.0]);
    // The segment to the right holds at a key itself; the last key belongs to what is beyond.
    assert_eq!(values(&g, slope, &xs), [0.0, 2.0, 2.0, -1.0, -1.0, 0.0, 0.0]);
}

#[test]
fn equal_keys_make_a_jump_and_the_later_row_holds_at_it() {
    let (g, value, slope) = lookup(&[(0.0, &[0.0]), (1.0, &[1.0]), (1.0, &[10.0]), (1.0, &[4.0]), (2.0, &[6.0])]);
    let below = 1.0f64.next_down();
    let xs = [0.5, below, 1.0, 1.5];
    let got = values(&g, value, &xs);
    assert!(close(got[1], 1.0, 1e-15), "the first row counts from below: {}", got[1]);
    assert_eq!([got[0], got[2], got[3]], [0.5, 4.0, 5.0]);
    assert_eq!(values(&g, slope, &xs), [1.0, 1.0, 2.0, 2.0]);
}

#[test]
fn a_jump_at_an_end_and_a_single_row() {
    let (g, value, slope) = lookup(&[(0.0, &[1.0]), (0.0, &[2.0]), (1.0, &[3.0]), (1.0, &[7.0])]);
    assert_eq!(values(&g, value, &[-1.0, 0.0, 1.0, 2.0]), [1.0, 2.0, 7.0, 7.0]);
    assert_eq!(values(&g, slope, &[-1.0, 0.0, 1.0, 2.0]), [0.0, 1.0, 0.0, 0.0]);
    let (g, value, slope) = lookup(&[(3.0, &[8.0])]);
    assert_eq!(values(&g, value, &[-1.0, 3.0, 5.0]), [8.0; 3]);
    assert_eq!(values(&g, slope, &[-1.0, 3.0, 5.0]), [0.0; 3]);
}

#[test]
fn wide_values_and_no_key_at_all() {
    let (g, value, _) = lookup(&[(0.0, &[0.0, 10.0, 1.0, 0.0]), (4.0, &[4.0, 0.0, 1.0, 2.0])]);
    assert_eq!(at(&g, value, [1.0, 0.0, 0.0]), [1.0, 7.5, 1.0, 0.5]);
    assert!(at(&g, value, [f64::NAN, 0.0, 0.0]).iter().all(|v| v.is_nan()));
    assert_eq!(at(&g, value, [f64::NEG_INFINITY, 0.0, 0.0]), [0.0, 10.0, 1.0, 0.0]);
}

proptest! {
    /// Against a plain search from the left.
    #[test]
    fn any_table_agrees_with_a_linear_search(
        steps in prop::collection::vec((prop_oneof![Just(0.0), 0.01..3.0f64], -5.0..5.0f64), 1..12),
        x in -2.0..20.0f64,
    ) {
        let mut key = 0.0;
        let rows: Vec<(f64, [f64; 1])> = steps.iter().map(|(step, v)| { key += step; (key, [*v]) }).collect();
        let slices: Vec<(f64, &[f64])> = rows.iter().map(|(k, v)| (*k, v.as_slice())).collect();
        let (g, value, _) = lookup(&slices);
        let mut expected = rows[0].1[0];
        for pair in rows.windows(2) {
            let ((k0, [v0]), (k1, [v1])) = (pair[0], pair[1]);
            if x >= k1 {
                expected = v1;
            } else if x >= k0 {
                expected = v0 + (v1 - v0) * (x - k0) / (k1 - k0);
            }
        }
        let got = at(&g, value, [x, 0.0, 0.0])[0];
        prop_assert!(close(got, expected, 1e-12), "{got} against {expected}");
    }
}
