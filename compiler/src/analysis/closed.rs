//! Coefficients with a closed form along every straight ray: sums of c·exp(g·p + b).
//!
//! Along p = o + t·d such a term is c·exp(g·o + b)·exp(t·g·d), so its optical depth over [a, e] is elementary; a uniform
//! coefficient is the term with g = 0. This is what makes fog and exponential atmospheres cost no loop.

use super::affine::affine_form;
use crate::ir::{Binary, Graph, NodeId, Op, Tier, Unary};

/// `scale · exp(gradient · p + offset)`.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct ExponentialTerm {
    /// Spectrum or scalar, tier Frame or lower.
    pub scale: NodeId,
    /// Width 3, tier Frame or lower; `None` is a uniform term.
    pub gradient: Option<NodeId>,
    /// Width 1, tier Frame or lower; absent for a uniform term.
    pub offset: Option<NodeId>,
}

/// Factors of a product that are looked at to cancel them.
const MAX_FACTORS: usize = 256;

type Push<'a> = &'a mut dyn FnMut(&mut Graph, Op) -> NodeId;

fn mul(graph: &mut Graph, push: Push<'_>, a: NodeId, b: NodeId) -> NodeId {
    let width = graph.width(a).max(graph.width(b));
    let a = if graph.width(a) == width { a } else { push(graph, Op::Splat(a, width)) };
    let b = if graph.width(b) == width { b } else { push(graph, Op::Splat(b, width)) };
    push(graph, Op::Binary(Binary::Mul, a, b))
}

/// The terms whose sum a node is, if it has this form; at most `limit` of them.
pub fn exponential_sum(graph: &mut Graph, push: Push<'_>, node: NodeId, limit: usize) -> Option<Vec<ExponentialTerm>> {
    if graph.tiers()[node.0 as usize] <= Tier::Frame {
        return Some(vec![ExponentialTerm { scale: node, gradient: None, offset: None }]);
    }
    let one = |graph: &mut Graph| graph.scalar(1.0);
    let terms = match *graph.op(node) {
        Op::Splat(a, _) => exponential_sum(graph, push, a, limit)?,
        Op::Unary(Unary::Exp, a) if graph.width(a) == 1 => {
            let form = affine_form(graph, push, a)?;
            let scale = one(graph);
            vec![ExponentialTerm { scale, gradient: form.gradient, offset: Some(form.offset) }]
        }
        Op::Unary(Unary::Neg, a) => {
            let mut terms = exponential_sum(graph, push, a, limit)?;
            for term in &mut terms {
                term.scale = push(graph, Op::Unary(Unary::Neg, term.scale));
            }
            terms
        }
        Op::Binary(op @ (Binary::Add | Binary::Sub), a, b) => {
            let mut terms = exponential_sum(graph, push, a, limit)?;
            for mut term in exponential_sum(graph, push, b, limit)? {
                if op == Binary::Sub {
                    term.scale = push(graph, Op::Unary(Unary::Neg, term.scale));
                }
                terms.push(term);
            }
            terms
        }
        Op::Binary(Binary::Mul, a, b) => {
            let (a, b) = (exponential_sum(graph, push, a, limit)?, exponential_sum(graph, push, b, limit)?);
            let mut terms = vec![];
            for x in &a {
                for y in &b {
                    let scale = mul(graph, push, x.scale, y.scale);
                    let sum = |graph: &mut Graph, push: Push<'_>, x: Option<NodeId>, y: Option<NodeId>| match (x, y) {
                        (Some(x), Some(y)) => Some(push(graph, Op::Binary(Binary::Add, x, y))),
                        (x, y) => x.or(y),
                    };
                    let gradient = sum(graph, push, x.gradient, y.gradient);
                    let offset = sum(graph, push, x.offset, y.offset);
                    terms.push(ExponentialTerm { scale, gradient, offset });
                }
            }
            terms
        }
        Op::Binary(Binary::Div, a, b) if graph.tiers()[b.0 as usize] <= Tier::Frame => {
            let mut terms = exponential_sum(graph, push, a, limit)?;
            for term in &mut terms {
                let width = graph.width(term.scale).max(graph.width(b));
                let x = if graph.width(term.scale) == width {
                    term.scale
                } else {
                    push(graph, Op::Splat(term.scale, width))
                };
                let y = if graph.width(b) == width { b } else { push(graph, Op::Splat(b, width)) };
                term.scale = push(graph, Op::Binary(Binary::Div, x, y));
            }
            terms
        }
        _ => return None,
    };
    (terms.len() <= limit).then_some(terms)
}

/// A product's factors, each with whether it divides, and whether the product is the negative of theirs; splats are
/// looked through. Beyond [`MAX_FACTORS`] the product is its own only factor.
fn factors(graph: &Graph, product: NodeId) -> (bool, Vec<(NodeId, bool)>) {
    let (mut negative, mut out) = (false, vec![]);
    let mut stack = vec![(product, false)];
    while let Some((node, inverse)) = stack.pop() {
        match *graph.op(node) {
            Op::Splat(a, _) => stack.push((a, inverse)),
            Op::Binary(Binary::Mul, a, b) => stack.extend([(b, inverse), (a, inverse)]),
            Op::Binary(Binary::Div, a, b) => stack.extend([(b, !inverse), (a, inverse)]),
            Op::Unary(Unary::Neg, a) => {
                negative = !negative;
                stack.push((a, inverse));
            }
            _ => out.push((node, inverse)),
        }
        if out.len() + stack.len() > MAX_FACTORS {
            return (false, vec![(product, false)]);
        }
    }
    (negative, out)
}

/// `numerator / denominator` with the factors that both have cancelled: the source function k_e/k_t of a medium whose
/// density scales both.
pub fn ratio(graph: &mut Graph, push: Push<'_>, numerator: NodeId, denominator: NodeId) -> NodeId {
    let (flip_top, mut top) = factors(graph, numerator);
    let (flip_bottom, bottom) = factors(graph, denominator);
    let flip = flip_top != flip_bottom;
    for (node, inverse) in bottom {
        if let Some(i) = top.iter().position(|(n, inv)| *n == node && *inv == inverse) {
            top.remove(i);
        } else {
            top.push((node, !inverse));
        }
    }
    let mut result = graph.scalar(if flip { -1.0 } else { 1.0 });
    for (node, _) in top.iter().filter(|t| !t.1) {
        result = mul(graph, push, result, *node);
    }
    for (node, _) in top.iter().filter(|t| t.1) {
        let width = graph.width(result).max(graph.width(*node));
        let x = if graph.width(result) == width { result } else { push(graph, Op::Splat(result, width)) };
        let y = if graph.width(*node) == width { *node } else { push(graph, Op::Splat(*node, width)) };
        result = push(graph, Op::Binary(Binary::Div, x, y));
    }
    result
}
