//! Short loops are written out: the corners of a cell of noise, the powers of an octave. What then is constant folds away, and
//! no engine pays for a counter. Exact: the terms are folded in the same order.

use crate::ir::{Binary, Fold, Graph, NodeId, Op};
use rustc_hash::FxHashMap;

/// Most nodes that a loop may become.
const MOST: usize = 512;
/// Most rounds.
const ROUNDS: i32 = 16;

pub(super) fn rule(graph: &mut Graph, op: &Op) -> Option<NodeId> {
    let Op::Reduce { fold, depth, start, end, body } = *op else { return None };
    let rounds = end - start;
    if !(1..=ROUNDS).contains(&rounds) {
        return None;
    }
    let inside = varying(graph, body, depth, MOST / rounds as usize)?;
    let mut total = None;
    for round in start..end {
        let value = copy(graph, body, depth, f64::from(round), &inside);
        total = Some(match total {
            None => value,
            Some(total) => {
                let op = match fold {
                    Fold::Sum => Binary::Add,
                    Fold::Product => Binary::Mul,
                    Fold::Min => Binary::Min,
                    Fold::Max => Binary::Max,
                };
                super::push(graph, Op::Binary(op, total, value))
            }
        });
    }
    total
}

/// The nodes of a body that depend on its loop variable, operands first; `None` if there are more than `most`.
fn varying(graph: &Graph, body: NodeId, depth: u8, most: usize) -> Option<Vec<NodeId>> {
    let mut seen: FxHashMap<NodeId, bool> = FxHashMap::default();
    let mut found = vec![];
    let mut stack = vec![(body, false)];
    while let Some((node, ready)) = stack.pop() {
        if ready {
            let mut depends = *graph.op(node) == Op::LoopVar(depth);
            Graph::operands(graph.op(node), |a| depends |= seen.get(&a).copied().unwrap_or(false));
            // A loop of the same depth inside has a variable of its own.
            if matches!(*graph.op(node), Op::Reduce { depth: own, .. } if own == depth) {
                depends = false;
            }
            seen.insert(node, depends);
            if depends {
                found.push(node);
                if found.len() > most {
                    return None;
                }
            }
        } else if !seen.contains_key(&node) {
            stack.push((node, true));
            Graph::operands(graph.op(node), |a| {
                if !seen.contains_key(&a) {
                    stack.push((a, false));
                }
            });
        }
    }
    Some(found)
}

fn copy(graph: &mut Graph, body: NodeId, depth: u8, round: f64, inside: &[NodeId]) -> NodeId {
    let mut map: FxHashMap<NodeId, NodeId> = FxHashMap::default();
    for node in inside {
        if map.contains_key(node) {
            continue;
        }
        let op = *graph.op(*node);
        let new = if op == Op::LoopVar(depth) {
            graph.scalar(round)
        } else {
            let op = Graph::map_operands(&op, |a| map.get(&a).copied().unwrap_or(a));
            super::push(graph, op)
        };
        let origin = graph.origin(*node).clone();
        graph.annotate(new, origin.span, origin.name.as_deref());
        map.insert(*node, new);
    }
    map.get(&body).copied().unwrap_or(body)
}
