//! Vectors: components of built vectors are found again, and what is equal in every band becomes one scalar.
//! Exact: no value changes.

use crate::ir::{Graph, NodeId, Op};

/// The scalar that a node repeats in every component, if it does.
pub(super) fn splat_of(graph: &mut Graph, id: NodeId) -> Option<NodeId> {
    match *graph.op(id) {
        Op::Splat(a, _) => Some(a),
        Op::Const(c) if c.width() > 1 && c.values().iter().all(|v| v.to_bits() == c.get(0).to_bits()) => {
            Some(graph.scalar(c.get(0)))
        }
        _ => None,
    }
}

/// The scalar a root can be replaced by when it is the same in every band.
pub(super) fn narrow(graph: &mut Graph, id: NodeId) -> NodeId {
    splat_of(graph, id).unwrap_or(id)
}

pub(super) fn rule(graph: &mut Graph, op: &Op) -> Option<NodeId> {
    match *op {
        Op::Splat(a, 1) => Some(a),
        Op::Extract(a, i) => match *graph.op(a) {
            Op::Compose(parts, _) => Some(parts[i as usize]),
            Op::Splat(a, _) => Some(a),
            _ => None,
        },
        Op::Compose(parts, width) => {
            let used = &parts[..width as usize];
            if used.iter().all(|p| *p == used[0]) {
                return Some(super::push(graph, Op::Splat(used[0], width)));
            }
            // (v.x, v.y, v.z) is v.
            let Op::Extract(whole, 0) = *graph.op(used[0]) else { return None };
            let same = |(i, p): (usize, &NodeId)| *graph.op(*p) == Op::Extract(whole, i as u8);
            (graph.width(whole) == width && used.iter().enumerate().all(same)).then_some(whole)
        }
        // What is done to equal components is done once.
        Op::Unary(u, a) => {
            let width = graph.width(a);
            let a = splat_of(graph, a)?;
            let once = super::push(graph, Op::Unary(u, a));
            Some(super::push(graph, Op::Splat(once, width)))
        }
        Op::PowI(a, n) => {
            let width = graph.width(a);
            let a = splat_of(graph, a)?;
            let once = super::push(graph, Op::PowI(a, n));
            Some(super::push(graph, Op::Splat(once, width)))
        }
        Op::Binary(b, x, y) => {
            let width = graph.width(x);
            let (x, y) = (splat_of(graph, x)?, splat_of(graph, y)?);
            let once = super::push(graph, Op::Binary(b, x, y));
            Some(super::push(graph, Op::Splat(once, width)))
        }
        Op::Select { condition, accept, reject } => {
            let width = graph.width(accept);
            let (accept, reject) = (splat_of(graph, accept)?, splat_of(graph, reject)?);
            let once = super::push(graph, Op::Select { condition, accept, reject });
            Some(super::push(graph, Op::Splat(once, width)))
        }
        Op::Reduce { fold, depth, start, end, body } => {
            let width = graph.width(body);
            let body = splat_of(graph, body)?;
            let once = super::push(graph, Op::Reduce { fold, depth, start, end, body });
            Some(super::push(graph, Op::Splat(once, width)))
        }
        Op::Const(_)
        | Op::Truth(_)
        | Op::Input(_)
        | Op::Param(_)
        | Op::LoopVar(_)
        | Op::Compare(..)
        | Op::Splat(..)
        | Op::Dot(..)
        | Op::Sample { .. }
        | Op::SampleGradient { .. }
        | Op::Lookup { .. }
        | Op::LookupSlope { .. }
        | Op::CellHash { .. } => None,
    }
}
