//! Which nodes are affine in the position: a·p + b with a and b constant along the ray.

use super::Push;
use crate::ir::{Binary, Graph, Input, NodeId, Op, Tier, Tiers, Unary};
use rustc_hash::FxHashMap;

/// Operations within each other that are followed: as many as an expression of a scene may have, and no stack overflows.
const MAX_DEPTH: usize = 512;

/// A scalar node written as `gradient · p + offset`; both are of tier Frame or lower.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct AffineForm {
    /// Width 3; `None` is zero.
    pub gradient: Option<NodeId>,
    /// Width 1.
    pub offset: NodeId,
}

/// Finds the affine form of a scalar node, adding the nodes of its coefficients to the graph through `push`.
pub fn affine_form(graph: &mut Graph, push: Push<'_>, node: NodeId) -> Option<AffineForm> {
    AffineForms::default().find(graph, push, node)
}

/// The affine forms found in one graph: each node is looked at once, however many expressions share it.
#[derive(Debug, Default)]
pub(super) struct AffineForms {
    pub(super) tiers: Tiers,
    known: FxHashMap<NodeId, Option<AffineForm>>,
    depth: usize,
}

impl AffineForms {
    /// What [`affine_form`] gives.
    pub(super) fn find(&mut self, graph: &mut Graph, push: Push<'_>, node: NodeId) -> Option<AffineForm> {
        if self.tiers.of(graph, node) <= Tier::Frame {
            return Some(AffineForm { gradient: None, offset: node });
        }
        if let Some(known) = self.known.get(&node) {
            return *known;
        }
        if self.depth == MAX_DEPTH {
            return None;
        }
        self.depth += 1;
        let form = self.derive(graph, push, node);
        self.depth -= 1;
        self.known.insert(node, form);
        form
    }

    /// The form of a node that varies along the ray.
    fn derive(&mut self, graph: &mut Graph, push: Push<'_>, node: NodeId) -> Option<AffineForm> {
        match *graph.op(node) {
            Op::Extract(a, i) if *graph.op(a) == Op::Input(Input::Position) => {
                let mut axis = [0.0; 3];
                axis[i as usize] = 1.0;
                let gradient = Some(graph.vector(&axis));
                Some(AffineForm { gradient, offset: graph.scalar(0.0) })
            }
            // A component of a sum is the sum of the components.
            Op::Extract(a, i) => {
                let part = match *graph.op(a) {
                    Op::Compose(parts, _) => parts[i as usize],
                    Op::Splat(part, _) => part,
                    Op::Unary(Unary::Neg, x) => {
                        let x = push(graph, Op::Extract(x, i));
                        push(graph, Op::Unary(Unary::Neg, x))
                    }
                    Op::Binary(op, x, y) => {
                        let (x, y) = (push(graph, Op::Extract(x, i)), push(graph, Op::Extract(y, i)));
                        push(graph, Op::Binary(op, x, y))
                    }
                    _ => return None,
                };
                self.find(graph, push, part)
            }
            Op::Dot(a, b) => {
                let position = |n: NodeId| *graph.op(n) == Op::Input(Input::Position);
                let mut frame = |n: NodeId| self.tiers.of(graph, n) <= Tier::Frame;
                let gradient = if position(a) && frame(b) {
                    b
                } else if position(b) && frame(a) {
                    a
                } else {
                    return None;
                };
                Some(AffineForm { gradient: Some(gradient), offset: graph.scalar(0.0) })
            }
            Op::Unary(Unary::Neg, a) => {
                let form = self.find(graph, push, a)?;
                let gradient = form.gradient.map(|g| push(graph, Op::Unary(Unary::Neg, g)));
                Some(AffineForm { gradient, offset: push(graph, Op::Unary(Unary::Neg, form.offset)) })
            }
            Op::Binary(op @ (Binary::Add | Binary::Sub), a, b) => {
                let (a, b) = (self.find(graph, push, a)?, self.find(graph, push, b)?);
                let gradient = match (a.gradient, b.gradient) {
                    (Some(x), Some(y)) => Some(push(graph, Op::Binary(op, x, y))),
                    (Some(x), None) => Some(x),
                    (None, Some(y)) if op == Binary::Add => Some(y),
                    (None, Some(y)) => Some(push(graph, Op::Unary(Unary::Neg, y))),
                    (None, None) => None,
                };
                Some(AffineForm { gradient, offset: push(graph, Op::Binary(op, a.offset, b.offset)) })
            }
            Op::Binary(op @ (Binary::Mul | Binary::Div), a, b) => {
                let (a, b) = (self.find(graph, push, a)?, self.find(graph, push, b)?);
                let (form, factor) = match (a.gradient, b.gradient) {
                    (_, None) => (a, b.offset),
                    (None, Some(_)) if op == Binary::Mul => (b, a.offset),
                    _ => return None,
                };
                let gradient = form.gradient.map(|g| {
                    let wide = push(graph, Op::Splat(factor, 3));
                    push(graph, Op::Binary(op, g, wide))
                });
                Some(AffineForm { gradient, offset: push(graph, Op::Binary(op, form.offset, factor)) })
            }
            _ => None,
        }
    }
}
