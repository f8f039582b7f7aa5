//! Which nodes are affine in the position: a·p + b with a and b constant along the ray.

use crate::ir::{Binary, Graph, Input, NodeId, Op, Tier, Unary};

/// A scalar node written as `gradient · p + offset`; both are of tier Frame or lower.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct AffineForm {
    /// Width 3; `None` is zero.
    pub gradient: Option<NodeId>,
    /// Width 1.
    pub offset: NodeId,
}

/// Finds the affine form of a scalar node, adding the nodes of its coefficients to the graph through `push`.
pub fn affine_form(
    graph: &mut Graph,
    push: &mut dyn FnMut(&mut Graph, Op) -> NodeId,
    node: NodeId,
) -> Option<AffineForm> {
    if graph.tiers()[node.0 as usize] <= Tier::Frame {
        return Some(AffineForm { gradient: None, offset: node });
    }
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
            affine_form(graph, push, part)
        }
        Op::Dot(a, b) => {
            let tiers = graph.tiers();
            let position = |n: NodeId| *graph.op(n) == Op::Input(Input::Position);
            let frame = |n: NodeId| tiers[n.0 as usize] <= Tier::Frame;
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
            let form = affine_form(graph, push, a)?;
            let gradient = form.gradient.map(|g| push(graph, Op::Unary(Unary::Neg, g)));
            Some(AffineForm { gradient, offset: push(graph, Op::Unary(Unary::Neg, form.offset)) })
        }
        Op::Binary(op @ (Binary::Add | Binary::Sub), a, b) => {
            let (a, b) = (affine_form(graph, push, a)?, affine_form(graph, push, b)?);
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
            let (a, b) = (affine_form(graph, push, a)?, affine_form(graph, push, b)?);
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
