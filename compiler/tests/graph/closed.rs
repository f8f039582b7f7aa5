//! Closed forms along rays: what is found of a node has the node's values, and sharing costs no time.

use crate::{at, close};
use compiler::analysis::affine::affine_form;
use compiler::analysis::closed::{exponential_sum, ratio};
use compiler::ir::{Binary, Graph, Input, NodeId, Op, ParamId, Tier, Tiers, Type, Unary};
use proptest::prelude::*;

const PLACES: [[f64; 3]; 3] = [[0.5, -0.25, 0.75], [-1.0, 0.5, 0.125], [0.0, 1.5, -0.5]];

fn push(graph: &mut Graph, op: Op) -> NodeId {
    graph.push(op)
}

fn value(graph: &Graph, node: NodeId, p: [f64; 3]) -> f64 {
    at(graph, node, p)[0]
}

fn coordinate(graph: &mut Graph, i: u8) -> NodeId {
    let p = graph.input(Input::Position);
    graph.extract(p, i)
}

/// A node of bytes: sums, products and quotients of coordinates, numbers and what came before, exponentials if asked for.
fn grow(graph: &mut Graph, bytes: &[[u8; 3]], exponentials: bool) -> NodeId {
    let mut nodes: Vec<NodeId> = (0..3).map(|i| coordinate(graph, i)).collect();
    nodes.extend([-1.5, 0.5, 2.0].map(|x| graph.scalar(x)));
    for [what, a, b] in bytes {
        let (a, b) = (nodes[*a as usize % nodes.len()], nodes[*b as usize % nodes.len()]);
        let node = match what % 6 {
            0 => graph.add(a, b),
            1 => graph.sub(a, b),
            2 => graph.mul(a, b),
            3 => graph.unary(Unary::Neg, a),
            4 => {
                let divisor = graph.scalar(4.0);
                graph.div(a, divisor)
            }
            _ if exponentials => graph.unary(Unary::Exp, a),
            _ => {
                let vector = graph.compose(&[a, b, a]);
                let sum = graph.add(vector, b);
                graph.extract(sum, 2)
            }
        };
        nodes.push(node);
    }
    nodes[nodes.len() - 1]
}

proptest! {
    #[test]
    fn an_affine_form_is_the_node(bytes in prop::collection::vec(any::<[u8; 3]>(), 1..12)) {
        let mut graph = Graph::default();
        let node = grow(&mut graph, &bytes, false);
        if let Some(form) = affine_form(&mut graph, &mut push, node) {
            for p in PLACES {
                let gradient = form.gradient.map_or(vec![0.0; 3], |g| at(&graph, g, [f64::NAN; 3]));
                let offset = value(&graph, form.offset, [f64::NAN; 3]);
                let found: f64 = gradient.iter().zip(p).map(|(g, x)| g * x).sum::<f64>() + offset;
                prop_assert!(close(found, value(&graph, node, p), 1e-9), "{found}");
            }
        }
    }

    #[test]
    fn a_sum_of_exponentials_is_the_node(bytes in prop::collection::vec(any::<[u8; 3]>(), 1..12)) {
        let mut graph = Graph::default();
        let node = grow(&mut graph, &bytes, true);
        if let Some(terms) = exponential_sum(&mut graph, &mut push, node, 8) {
            prop_assert!(terms.len() <= 8);
            for p in PLACES {
                let mut found = 0.0;
                for term in &terms {
                    let gradient = term.gradient.map_or(vec![0.0; 3], |g| at(&graph, g, [f64::NAN; 3]));
                    let offset = term.offset.map_or(0.0, |o| value(&graph, o, [f64::NAN; 3]));
                    let exponent = gradient.iter().zip(p).map(|(g, x)| g * x).sum::<f64>() + offset;
                    found += value(&graph, term.scale, [f64::NAN; 3]) * exponent.exp();
                }
                let wanted = value(&graph, node, p);
                prop_assert!(close(found, wanted, 1e-6) || wanted.abs() > 1e100, "{found} is not {wanted}");
            }
        }
    }

    /// Signs stand anywhere in the products.
    #[test]
    fn a_ratio_times_its_denominator_is_its_numerator(
        top in prop::collection::vec(any::<[u8; 3]>(), 1..12),
        bottom in prop::collection::vec(any::<[u8; 3]>(), 1..12),
    ) {
        let mut graph = Graph::default();
        let (a, b) = (grow(&mut graph, &top, true), grow(&mut graph, &bottom, true));
        let quotient = ratio(&mut graph, &mut push, a, b);
        for p in PLACES {
            let wanted = value(&graph, a, p) / value(&graph, b, p);
            if wanted.is_finite() && wanted != 0.0 && wanted.abs() < 1e100 {
                let found = value(&graph, quotient, p);
                prop_assert!(close(found, wanted, 1e-6), "{found} is not {wanted}");
            }
        }
    }

    #[test]
    fn tiers_of_a_growing_graph_are_those_of_the_whole(bytes in prop::collection::vec(any::<[u8; 3]>(), 1..12)) {
        let mut graph = Graph::default();
        graph.params = vec![Type::SCALAR];
        let (mut tiers, mut found) = (Tiers::default(), vec![]);
        for node in [Op::Param(ParamId(0)), Op::Input(Input::Direction), Op::Input(Input::Time)] {
            let node = graph.push(node);
            found.push((node, tiers.of(&graph, node)));
        }
        for n in 1..=bytes.len() {
            let node = grow(&mut graph, &bytes[..n], true);
            found.push((node, tiers.of(&graph, node)));
        }
        let whole = graph.tiers();
        prop_assert_eq!(&found[..3].iter().map(|f| f.1).collect::<Vec<_>>(), &[Tier::Frame, Tier::Ray, Tier::Frame]);
        for (node, tier) in found {
            prop_assert_eq!(tier, whole[node.0 as usize]);
        }
    }
}

/// Each step needs the one before twice: visited once per use they would be 2^60.
#[test]
fn what_is_shared_is_looked_at_once() {
    let mut graph = Graph::default();
    let half = graph.scalar(0.5);
    let mut sum = coordinate(&mut graph, 0);
    for _ in 0..60 {
        let part = graph.mul(half, sum);
        sum = graph.add(sum, part);
    }
    let form = affine_form(&mut graph, &mut push, sum).expect("an affine form");
    let slope = at(&graph, form.gradient.expect("a slope"), [0.0; 3]);
    assert!(close(slope[0], 1.5f64.powi(60), 1e-12) && slope[1..] == [0.0, 0.0], "{slope:?}");

    let (x, one) = (coordinate(&mut graph, 0), graph.scalar(1.0));
    let mut product = graph.unary(Unary::Exp, x);
    for _ in 0..60 {
        let same = graph.mul(one, product);
        product = graph.push(Op::Binary(Binary::Mul, product, same));
    }
    let terms = exponential_sum(&mut graph, &mut push, product, 8).expect("one term");
    let slopes: Vec<f64> = terms.iter().map(|t| at(&graph, t.gradient.expect("a slope"), [0.0; 3])[0]).collect();
    assert_eq!(slopes, [2f64.powi(60)]);

    let quotient = ratio(&mut graph, &mut push, product, product);
    assert_eq!(value(&graph, quotient, PLACES[0]), 1.0);
}

/// A chain longer than any stack is deep has no closed form that is looked for, and does no harm.
#[test]
fn long_chains_do_not_overflow_the_stack() {
    let mut graph = Graph::default();
    let mut chain = coordinate(&mut graph, 0);
    for i in 0..200_000 {
        let step = graph.scalar(f64::from(i));
        chain = if i % 2 == 0 { graph.add(chain, step) } else { graph.mul(chain, step) };
    }
    assert_eq!(affine_form(&mut graph, &mut push, chain), None);
    assert_eq!(exponential_sum(&mut graph, &mut push, chain, 8), None);
    let quotient = ratio(&mut graph, &mut push, chain, chain);
    assert_eq!(value(&graph, quotient, PLACES[0]), 1.0);
}
