//! Coefficients with a closed form along every straight ray: sums of c·exp(g·p + b).
//!
//! Along p = o + t·d such a term is c·exp(g·o + b)·exp(t·g·d), so its optical depth over [a, e] is elementary; a uniform
//! coefficient is the term with g = 0. This is what makes fog and exponential atmospheres cost no loop.

use super::Push;
use super::affine::AffineForms;
use crate::ir::{Binary, Graph, NodeId, Op, Tier, Unary};
use rustc_hash::FxHashMap;

/// Operations within each other that are followed, as in `affine`.
const MAX_DEPTH: usize = 512;
/// Factors of a product that are looked at to cancel them.
const MAX_FACTORS: usize = 256;

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

/// `a op b`, the scalar one widened to the other's width.
fn binary(graph: &mut Graph, push: Push<'_>, op: Binary, a: NodeId, b: NodeId) -> NodeId {
    let width = graph.width(a).max(graph.width(b));
    let a = if graph.width(a) == width { a } else { push(graph, Op::Splat(a, width)) };
    let b = if graph.width(b) == width { b } else { push(graph, Op::Splat(b, width)) };
    push(graph, Op::Binary(op, a, b))
}

/// The terms whose sum a node is, if it has this form; at most `limit` of them.
pub fn exponential_sum(graph: &mut Graph, push: Push<'_>, node: NodeId, limit: usize) -> Option<Vec<ExponentialTerm>> {
    let mut sums = Sums { limit, affine: AffineForms::default(), known: FxHashMap::default(), depth: 0 };
    sums.find(graph, push, node)
}

/// The sums found in one graph: each node is looked at once, however many expressions share it.
struct Sums {
    limit: usize,
    affine: AffineForms,
    known: FxHashMap<NodeId, Option<Vec<ExponentialTerm>>>,
    depth: usize,
}

impl Sums {
    fn find(&mut self, graph: &mut Graph, push: Push<'_>, node: NodeId) -> Option<Vec<ExponentialTerm>> {
        if self.affine.tiers.of(graph, node) <= Tier::Frame {
            return Some(vec![ExponentialTerm { scale: node, gradient: None, offset: None }]);
        }
        if let Some(known) = self.known.get(&node) {
            return known.clone();
        }
        if self.depth == MAX_DEPTH {
            return None;
        }
        self.depth += 1;
        let terms = self.derive(graph, push, node);
        self.depth -= 1;
        self.known.insert(node, terms.clone());
        terms
    }

    /// The terms of a node that varies along the ray.
    fn derive(&mut self, graph: &mut Graph, push: Push<'_>, node: NodeId) -> Option<Vec<ExponentialTerm>> {
        let terms = match *graph.op(node) {
            Op::Splat(a, _) => self.find(graph, push, a)?,
            Op::Unary(Unary::Exp, a) if graph.width(a) == 1 => {
                let form = self.affine.find(graph, push, a)?;
                let scale = graph.scalar(1.0);
                vec![ExponentialTerm { scale, gradient: form.gradient, offset: Some(form.offset) }]
            }
            Op::Unary(Unary::Neg, a) => {
                let mut terms = self.find(graph, push, a)?;
                for term in &mut terms {
                    term.scale = push(graph, Op::Unary(Unary::Neg, term.scale));
                }
                terms
            }
            Op::Binary(op @ (Binary::Add | Binary::Sub), a, b) => {
                let mut terms = self.find(graph, push, a)?;
                for mut term in self.find(graph, push, b)? {
                    if op == Binary::Sub {
                        term.scale = push(graph, Op::Unary(Unary::Neg, term.scale));
                    }
                    terms.push(term);
                }
                terms
            }
            Op::Binary(Binary::Mul, a, b) => {
                let (a, b) = (self.find(graph, push, a)?, self.find(graph, push, b)?);
                let mut terms = vec![];
                for x in &a {
                    for y in &b {
                        let scale = binary(graph, push, Binary::Mul, x.scale, y.scale);
                        let sum = |graph: &mut Graph, push: Push<'_>, x: Option<NodeId>, y: Option<NodeId>| match (x, y)
                        {
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
            Op::Binary(Binary::Div, a, b) if self.affine.tiers.of(graph, b) <= Tier::Frame => {
                let mut terms = self.find(graph, push, a)?;
                for term in &mut terms {
                    term.scale = binary(graph, push, Binary::Div, term.scale, b);
                }
                terms
            }
            _ => return None,
        };
        (terms.len() <= self.limit).then_some(terms)
    }
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
        result = binary(graph, push, Binary::Mul, result, *node);
    }
    for (node, _) in top.iter().filter(|t| t.1) {
        result = binary(graph, push, Binary::Div, result, *node);
    }
    result
}
