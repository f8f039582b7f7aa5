//! Where fields jump along a ray: planes on which a comparison changes sides, or on which a rounded coordinate changes.
//!
//! At a jump every rule of integration falls to order 1 unless a step ends there. Where a ray meets a plane, an argument that is
//! affine in the position, is known beforehand; of other arguments it is known that their values at both ends of a step lie on
//! two sides. Lattice noise is smooth across its cells, so that its roundings are left out.

use super::Push;
use super::affine::{AffineForm, AffineForms};
use crate::ir::{Binary, Filter, Graph, NodeId, Op, Unary};
use rustc_hash::FxHashSet;

/// Most jumps on planes that are followed, and most on curved surfaces: beyond, step control must find them.
const LIMIT: usize = 16;
const CURVED_LIMIT: usize = 8;
/// Rows of tables that are no features of their data, and the share of its keys within which a table turns so sharply that its
/// turns are as good as jumps.
const FEW_ROWS: usize = 64;
const SHARP: f64 = 1.0 / 64.0;

/// A family of parallel planes.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Jump {
    /// Width 3, tier Frame or lower.
    pub gradient: NodeId,
    /// Width 1, tier Frame or lower.
    pub offset: NodeId,
    /// Whether the field jumps at every whole value of `gradient · p + offset`; else at 0 alone.
    pub every_whole: bool,
}

/// A surface where an argument that is not affine changes its sign.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Curved {
    /// Width 1, tier Sample.
    pub argument: NodeId,
    /// Whether the field jumps at every whole value; else at 0 alone.
    pub every_whole: bool,
}

/// Where fields jump.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Jumps {
    /// On planes.
    pub planes: Vec<Jump>,
    /// Elsewhere.
    pub curved: Vec<Curved>,
}

/// The jumps of what the roots need.
pub fn jumps(graph: &mut Graph, push: Push<'_>, roots: &[NodeId]) -> Jumps {
    let live = graph.reachable(roots);
    let smooth = cells_of_noise(graph, &live);
    let ids: Vec<NodeId> = graph.ids().filter(|id| live[id.0 as usize]).collect();
    let mut out = Jumps::default();
    let mut forms = AffineForms::default();
    let mut add = |graph: &mut Graph, push: Push<'_>, node: NodeId, shift: f64, every_whole: bool| {
        let (gradient, offset) = match forms.find(graph, push, node) {
            Some(AffineForm { gradient: Some(gradient), offset }) => (gradient, offset),
            Some(AffineForm { gradient: None, .. }) => return,
            None => {
                let argument = if shift == 0.0 {
                    node
                } else {
                    let shift = graph.scalar(shift);
                    push(graph, Op::Binary(Binary::Add, node, shift))
                };
                let curved = Curved { argument, every_whole };
                if graph.width(argument) == 1 && out.curved.len() < CURVED_LIMIT && !out.curved.contains(&curved) {
                    out.curved.push(curved);
                }
                return;
            }
        };
        let offset = if shift == 0.0 {
            offset
        } else {
            let shift = graph.scalar(shift);
            push(graph, Op::Binary(Binary::Add, offset, shift))
        };
        let jump = Jump { gradient, offset, every_whole };
        if out.planes.len() < LIMIT && !out.planes.contains(&jump) {
            out.planes.push(jump);
        }
    };
    for id in ids {
        match *graph.op(id) {
            Op::Compare(_, a, b) => {
                let difference = push(graph, Op::Binary(Binary::Sub, a, b));
                add(graph, push, difference, 0.0, false);
            }
            Op::Unary(Unary::Sign, a) if graph.width(a) == 1 => add(graph, push, a, 0.0, false),
            Op::Unary(Unary::Floor | Unary::Ceil, a) if !smooth.contains(&id) => {
                for i in 0..graph.width(a) {
                    let part = if graph.width(a) == 1 { a } else { push(graph, Op::Extract(a, i)) };
                    add(graph, push, part, 0.0, true);
                }
            }
            Op::Unary(Unary::Round, a) if !smooth.contains(&id) && graph.width(a) == 1 => {
                add(graph, push, a, 0.5, true);
            }
            Op::Sample { grid, at } if graph.grid(grid).filter == Filter::Nearest => {
                for i in 0..3 {
                    let part = push(graph, Op::Extract(at, i));
                    add(graph, push, part, 0.5, true);
                }
            }
            // The slope of a trilinear cell jumps at its faces, which lie at whole coordinates.
            Op::SampleGradient { grid, at } if graph.grid(grid).filter == Filter::Linear => {
                for i in 0..3 {
                    let part = push(graph, Op::Extract(at, i));
                    add(graph, push, part, 0.0, true);
                }
            }
            Op::Lookup { table, at } | Op::LookupSlope { table, at } => {
                let slope = matches!(graph.op(id), Op::LookupSlope { .. });
                let keys: Option<Vec<f64>> = graph.table(table).keys.iter().map(|k| graph.number(*k)).collect();
                let keys = keys.unwrap_or_default();
                let sharp = match keys.as_slice() {
                    [first, .., last] if keys.len() <= FEW_ROWS => SHARP * (last - first),
                    _ => 0.0,
                };
                let mut ends: Vec<f64> = vec![];
                for pair in keys.windows(2).filter(|w| slope || w[1] - w[0] <= sharp) {
                    ends.push(pair[0]);
                    if pair[1] > pair[0] && !slope {
                        ends.push(pair[1]);
                    }
                }
                ends.dedup();
                for key in ends {
                    let key = graph.scalar(key);
                    let difference = push(graph, Op::Binary(Binary::Sub, at, key));
                    add(graph, push, difference, 0.0, false);
                }
            }
            _ => {}
        }
    }
    out
}

/// Roundings that lattice noise hashes: it is smooth across them.
fn cells_of_noise(graph: &Graph, live: &[bool]) -> FxHashSet<NodeId> {
    let mut found = FxHashSet::default();
    for id in graph.ids().filter(|id| live[id.0 as usize]) {
        if let Op::CellHash { cell, .. } = *graph.op(id) {
            let under = graph.reachable(&[cell]);
            let rounding = |n: &NodeId| matches!(graph.op(*n), Op::Unary(Unary::Floor | Unary::Ceil | Unary::Round, _));
            found.extend(graph.ids().filter(|n| under[n.0 as usize]).filter(rounding));
        }
    }
    found
}
