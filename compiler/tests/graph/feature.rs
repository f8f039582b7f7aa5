//! The sizes of cells of fields.

use compiler::analysis::feature::{Features, feature_length};
use compiler::ir::{Graph, Input, Unary};

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
