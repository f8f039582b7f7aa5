//! Constant folding, in f64: an operation on constants becomes its value, if that is finite.
//!
//! A value that is not finite stays an operation: what reaches a picture is checked there and reported with its place.

use crate::ir::eval::{Tables, binary, cell_hash, compare, evaluate_with, unary};
use crate::ir::{Binary, Constant, Graph, NodeId, Op, Unary};

pub(super) fn rule(graph: &mut Graph, op: &Op) -> Option<NodeId> {
    let constant = |id: NodeId| graph.constant(id);
    let truth = |id: NodeId| if let Op::Truth(t) = graph.op(id) { Some(*t) } else { None };
    let zip = |a: Constant, b: Constant, f: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
        a.values().into_iter().zip(b.values()).map(|(a, b)| f(a, b)).collect()
    };
    let values: Vec<f64> = match *op {
        Op::Unary(Unary::Not, a) => {
            let value = !truth(a)?;
            return Some(graph.truth(value));
        }
        Op::Binary(Binary::And, a, b) => {
            let value = truth(a)? && truth(b)?;
            return Some(graph.truth(value));
        }
        Op::Binary(Binary::Or, a, b) => {
            let value = truth(a)? || truth(b)?;
            return Some(graph.truth(value));
        }
        Op::Compare(c, a, b) => {
            let value = compare(c, constant(a)?.get(0), constant(b)?.get(0));
            return Some(graph.truth(value));
        }
        Op::Unary(u, a) => constant(a)?.values().into_iter().map(|x| unary(u, x)).collect(),
        Op::Binary(b, x, y) => zip(constant(x)?, constant(y)?, &|x, y| binary(b, x, y)),
        Op::PowI(a, n) => constant(a)?.values().into_iter().map(|x| x.powi(n)).collect(),
        Op::Compose(parts, width) => {
            let parts: Option<Vec<f64>> = parts[..width as usize].iter().map(|p| Some(constant(*p)?.get(0))).collect();
            parts?
        }
        Op::Splat(a, width) => vec![constant(a)?.get(0); width as usize],
        Op::Extract(a, i) => vec![constant(a)?.get(i as usize)],
        Op::Dot(a, b) => vec![zip(constant(a)?, constant(b)?, &|x, y| x * y).into_iter().sum()],
        Op::CellHash { cell, seed } => {
            let cell = constant(cell)?;
            cell_hash([cell.get(0), cell.get(1), cell.get(2)], constant(seed)?.get(0)).to_vec()
        }
        Op::Const(_)
        | Op::Truth(_)
        | Op::Input(_)
        | Op::Param(_)
        | Op::LoopVar(_)
        | Op::Select { .. }
        | Op::Sample { .. }
        | Op::SampleGradient { .. }
        | Op::Lookup { .. }
        | Op::LookupSlope { .. } => return None,
        Op::Reduce { .. } => return constant_loop(graph, op),
    };
    values.iter().all(|v| v.is_finite()).then(|| graph.vector(&values))
}

/// A loop over constants alone is run here.
fn constant_loop(graph: &mut Graph, op: &Op) -> Option<NodeId> {
    let Op::Reduce { depth, body, .. } = *op else { return None };
    let mut seen = rustc_hash::FxHashSet::default();
    let mut stack = vec![(body, 1u16 << depth)];
    while let Some((id, bound)) = stack.pop() {
        if !seen.insert((id, bound)) {
            continue;
        }
        let inner = match *graph.op(id) {
            Op::LoopVar(d) if bound & (1 << d) == 0 => return None,
            Op::Reduce { depth, .. } => bound | 1 << depth,
            Op::Input(_)
            | Op::Param(_)
            | Op::Sample { .. }
            | Op::SampleGradient { .. }
            | Op::Lookup { .. }
            | Op::LookupSlope { .. } => return None,
            _ => bound,
        };
        Graph::operands(graph.op(id), |a| stack.push((a, inner)));
    }
    // The loop itself is added for a moment, so that the evaluator can run it.
    let id = graph.push(*op);
    let value = evaluate_with(graph, &[id], &[], 0.0, &Tables::default()).remove(0);
    value.iter().all(|v| v.is_finite()).then(|| graph.vector(&value))
}
