//! Bounds on how fast fields vary, against how fast they do.

use crate::at;
use compiler::analysis::feature::{Features, feature_length, lipschitz};
use compiler::ir::{Binary, Graph, Input, NodeId, Unary};
use proptest::prelude::*;

/// Scalars and vectors of bytes, over the position.
fn grow(graph: &mut Graph, bytes: &[[u8; 3]]) -> Vec<NodeId> {
    let position = graph.input(Input::Position);
    let mut vectors = vec![position, graph.vector(&[1.0, -2.0, 0.5])];
    let mut scalars: Vec<NodeId> = (0..3).map(|i| graph.extract(position, i)).collect();
    scalars.push(graph.scalar(-0.75));
    for [what, a, b] in bytes {
        let (x, y) = (scalars[*a as usize % scalars.len()], scalars[*b as usize % scalars.len()]);
        let (v, w) = (vectors[*a as usize % vectors.len()], vectors[*b as usize % vectors.len()]);
        let op = [Binary::Add, Binary::Sub, Binary::Mul, Binary::Min, Binary::Max][*a as usize % 5];
        match what % 9 {
            0 => scalars.push(graph.binary(op, x, y)),
            1 => vectors.push(graph.binary(op, v, w)),
            2 => vectors.push(graph.binary(op, v, x)),
            3 => scalars.push(graph.unary(Unary::Sin, x)),
            4 => vectors.push(graph.unary(Unary::Tanh, v)),
            5 => scalars.push(graph.dot(v, w)),
            6 => {
                let square = graph.dot(v, v);
                scalars.push(graph.unary(Unary::Sqrt, square));
            }
            7 => vectors.push(graph.widen(x, 3)),
            _ => vectors.push(graph.compose(&[x, y, x])),
        }
    }
    scalars.extend(vectors);
    scalars
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn no_field_is_steeper_than_its_bound(
        bytes in prop::collection::vec(any::<[u8; 3]>(), 1..8),
        from in prop::array::uniform3(-2.0..2.0f64),
        step in prop::array::uniform3(-1e-3..1e-3f64),
    ) {
        let mut graph = Graph::default();
        let nodes = grow(&mut graph, &bytes);
        let steepness = lipschitz(&graph);
        let to = [0, 1, 2].map(|i| from[i] + step[i]);
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        for node in nodes {
            let (a, b) = (at(&graph, node, from), at(&graph, node, to));
            let change: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
            let allowed = steepness[node.0 as usize] * norm(&step);
            // Rounding of the values themselves.
            let slack = 1e-13 * (1.0 + norm(&a));
            prop_assert!(norm(&change) <= allowed + slack || !norm(&change).is_finite(), "{} of {allowed}", norm(&change));
        }
    }
}

#[test]
fn cells_of_several_fields() {
    let mut graph = Graph::default();
    let position = graph.input(Input::Position);
    let x = graph.extract(position, 0);
    let roots = [0.5, 4.0].map(|scale| {
        let scale = graph.scalar(scale);
        let scaled = graph.mul(x, scale);
        graph.unary(Unary::Floor, scaled)
    });
    let features = Features::new(&graph);
    assert_eq!(features.length(&roots[..1]), Some(2.0));
    assert_eq!(features.length(&roots[1..]), Some(0.25));
    assert_eq!(feature_length(&graph, &roots), Some(0.25));
    assert_eq!(features.length(&[x]), None);
}
