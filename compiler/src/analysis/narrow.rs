//! Where a field may rise and fall again within a short way: bands of some argument that samples may step across.
//!
//! A bump is found structurally: between two thresholds that one argument is compared with or clamped at
//! (`abs(r − R) < w`), within the bell of an exponential of a square, between rows of a table where its values turn. How long
//! the way through a band is, and whether it is met at all, is a matter of the argument's range and slope in a region.
//! Lattice noise has cells of a known size instead ([`super::feature`]) and is left out.

use super::Push;
use crate::ir::derive::{Budget, gradient_with};
use crate::ir::{Binary, Graph, Input, NodeId, Op, Unary};
use rustc_hash::FxHashMap;

/// Most rows of a table that are looked at: a longer one is read from data, where rows are no features.
const MOST_ROWS: usize = 4096;
/// A turn of a table counts if both its sides are at least this share of all that the column spans.
const PROMINENT: f64 = 0.25;
/// One that is at half its height no wider than this share of the table counts, too, if it is at least this share
/// of the column's integral.
const SPIKE: (f64, f64) = (1.0 / 256.0, 1e-3);
/// Most arguments that are followed.
const LIMIT: usize = 16;

/// A scalar field and the bands of its values within which something may happen.
#[derive(Clone, Debug, PartialEq)]
pub struct Narrow {
    /// Width 1.
    pub argument: NodeId,
    /// Its gradient with respect to the position, width 3.
    pub gradient: NodeId,
    /// Ascending pairs.
    pub bands: Vec<(f64, f64)>,
}

/// Thresholds and bands by argument.
#[derive(Default)]
struct Found {
    thresholds: FxHashMap<NodeId, Vec<f64>>,
    bands: FxHashMap<NodeId, Vec<(f64, f64)>>,
    order: Vec<NodeId>,
}

impl Found {
    fn threshold(&mut self, graph: &Graph, argument: NodeId, value: f64) {
        for (argument, value) in stripped(graph, argument, value) {
            self.thresholds.entry(argument).or_default().push(value);
            self.order.push(argument);
        }
    }

    fn band(&mut self, argument: NodeId, band: (f64, f64)) {
        self.bands.entry(argument).or_default().push(band);
        self.order.push(argument);
    }
}

/// Takes apart what only shifts, scales or mirrors an argument: where its own variable has to be for it to have this value.
fn stripped(graph: &Graph, argument: NodeId, value: f64) -> Vec<(NodeId, f64)> {
    let mut out = vec![];
    let mut stack = vec![(argument, value, 0)];
    while let Some((node, value, depth)) = stack.pop() {
        if depth > 64 || !value.is_finite() {
            continue;
        }
        let mut push = |n: NodeId, v: f64| stack.push((n, v, depth + 1));
        match *graph.op(node) {
            Op::Unary(Unary::Neg, a) => push(a, -value),
            Op::Unary(Unary::Abs, a) if value >= 0.0 => {
                push(a, value);
                push(a, -value);
            }
            // A length is never below 0: the ball that it is less in has two sides to a ray.
            Op::Unary(Unary::Sqrt, a) if value >= 0.0 && matches!(*graph.op(a), Op::Dot(x, y) if x == y) => {
                out.push((node, value));
                out.push((node, -value));
            }
            Op::PowI(a, 2) if value >= 0.0 => {
                push(a, value.sqrt());
                push(a, -value.sqrt());
            }
            Op::Binary(Binary::Mul, a, b) if a == b && value >= 0.0 => {
                push(a, value.sqrt());
                push(a, -value.sqrt());
            }
            Op::Binary(op, a, b) => match (op, graph.number(a), graph.number(b)) {
                (Binary::Add, _, Some(c)) => push(a, value - c),
                (Binary::Add, Some(c), _) => push(b, value - c),
                (Binary::Sub, _, Some(c)) => push(a, value + c),
                (Binary::Sub, Some(c), _) => push(b, c - value),
                (Binary::Mul, _, Some(c)) => push(a, value / c),
                (Binary::Mul, Some(c), _) => push(b, value / c),
                (Binary::Div, _, Some(c)) => push(a, value * c),
                _ => out.push((node, value)),
            },
            _ => out.push((node, value)),
        }
    }
    out
}

/// Pairs of keys between which some column of a table rises and falls again, or the other way round, by as much as counts.
fn turns(keys: &[f64], columns: &[Vec<f64>]) -> Vec<(f64, f64)> {
    let mut out = vec![];
    for column in columns {
        let (low, high) = column.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |m, v| (m.0.min(*v), m.1.max(*v)));
        let least = PROMINENT * (high - low);
        let pieces = || keys.windows(2).zip(column.windows(2));
        let whole: f64 = pieces().map(|(k, v)| 0.5 * (k[1] - k[0]) * (v[0].abs() + v[1].abs())).sum();
        let spanned = keys[keys.len() - 1] - keys[0];
        // Where the run that the last change belongs to began, and its sign.
        let mut run: Option<(usize, f64)> = None;
        for i in 1..column.len() {
            let change = column[i] - column[i - 1];
            if change == 0.0 {
                continue;
            }
            match run {
                Some((_, sign)) if sign == change.signum() => {}
                Some((first, _)) => {
                    // From where it began to turn away until it stops coming back.
                    let end = (i..column.len()).find(|j| (column[*j] - column[*j - 1]) * change <= 0.0);
                    let end = end.map_or(column.len() - 1, |j| j - 1);
                    let peak = column[i - 1];
                    let height = (peak - column[first]).abs().min((peak - column[end]).abs());
                    if height >= least {
                        out.push((keys[first], keys[end]));
                    } else {
                        // Where it is more than half as high as it rises.
                        let level = peak - 0.5 * height * (peak - column[end]).signum();
                        let cut = |a: usize, b: usize| {
                            let share = (level - column[a]) / (column[b] - column[a]);
                            keys[a] + share.clamp(0.0, 1.0) * (keys[b] - keys[a])
                        };
                        let beyond = |j: usize| (column[j] - level) * (peak - level) <= 0.0;
                        let from = (first..i - 1).rev().find(|j| beyond(*j)).map_or(keys[first], |j| cut(j, j + 1));
                        let to = (i..=end).find(|j| beyond(*j)).map_or(keys[end], |j| cut(j, j - 1));
                        let width = to - from;
                        if width <= SPIKE.0 * spanned && height * width >= SPIKE.1 * whole {
                            out.push((from, to));
                        }
                    }
                    run = Some((i - 1, change.signum()));
                }
                None => run = Some((i - 1, change.signum())),
            }
        }
    }
    out
}

/// Every argument of the roots with its bands. Derivatives are added to the graph.
pub fn narrow(graph: &mut Graph, push: Push<'_>, roots: &[NodeId]) -> Vec<Narrow> {
    let live = graph.reachable(roots);
    let ids: Vec<NodeId> = graph.ids().filter(|id| live[id.0 as usize]).collect();
    let mut found = Found::default();
    for id in ids {
        match *graph.op(id) {
            Op::Compare(_, a, b) => match (graph.number(a), graph.number(b)) {
                (_, Some(c)) => found.threshold(graph, a, c),
                (Some(c), _) => found.threshold(graph, b, c),
                (None, None) => {
                    let difference = push(graph, Op::Binary(Binary::Sub, a, b));
                    found.threshold(graph, difference, 0.0);
                }
            },
            Op::Unary(Unary::Sign, a) if graph.width(a) == 1 => found.threshold(graph, a, 0.0),
            Op::Binary(Binary::Min | Binary::Max, a, b) if graph.width(a) == 1 => {
                match (graph.number(a), graph.number(b)) {
                    (_, Some(c)) => found.threshold(graph, a, c),
                    (Some(c), _) => found.threshold(graph, b, c),
                    (None, None) => {}
                }
            }
            // A bell falls to 1/e at ±1 of what is squared.
            Op::Unary(Unary::Exp, a) if graph.width(a) == 1 => found.threshold(graph, a, -1.0),
            Op::Lookup { table, at } => {
                let table = graph.table(table);
                if table.keys.len() > MOST_ROWS {
                    continue;
                }
                let keys: Option<Vec<f64>> = table.keys.iter().map(|k| graph.number(*k)).collect();
                let rows: Option<Vec<Vec<f64>>> =
                    table.values.iter().map(|v| graph.constant(*v).map(|c| c.values())).collect();
                let (Some(keys), Some(rows)) = (keys, rows) else { continue };
                let columns: Vec<Vec<f64>> =
                    (0..table.width as usize).map(|c| rows.iter().map(|r| r[c.min(r.len() - 1)]).collect()).collect();
                for band in turns(&keys, &columns) {
                    found.band(at, band);
                }
            }
            _ => {}
        }
    }
    let mut order = std::mem::take(&mut found.order);
    order.sort_unstable();
    order.dedup();
    let mut out = vec![];
    for argument in order {
        let mut bands = found.bands.remove(&argument).unwrap_or_default();
        let mut thresholds = found.thresholds.remove(&argument).unwrap_or_default();
        thresholds.sort_by(f64::total_cmp);
        bands.extend(thresholds.windows(2).map(|w| (w[0], w[1])));
        bands.retain(|b| b.0 < b.1);
        bands.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        bands.dedup();
        if bands.is_empty() || out.len() == LIMIT || !smooth(graph, argument) {
            continue;
        }
        let position = graph.input(Input::Position);
        if let Ok(gradient) = gradient_with(graph, argument, position, &[], &mut Budget::default()) {
            out.push(Narrow { argument, gradient, bands });
        }
    }
    out
}

/// Whether a field varies with the position, and not by lattice noise.
fn smooth(graph: &Graph, node: NodeId) -> bool {
    graph.reads(&[node], |op| matches!(op, Op::Input(Input::Position)))
        && !graph.reads(&[node], |op| matches!(op, Op::CellHash { .. }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(graph: &mut Graph, x: f64) -> NodeId {
        graph.scalar(x)
    }

    fn distance(graph: &mut Graph) -> NodeId {
        let p = graph.input(Input::Position);
        let square = graph.dot(p, p);
        graph.unary(Unary::Sqrt, square)
    }

    fn find(graph: &mut Graph, root: NodeId) -> Vec<Narrow> {
        narrow(graph, &mut |g, op| g.push(op), &[root])
    }

    #[test]
    fn a_thin_shell_is_a_band_of_the_distance() {
        let mut graph = Graph::default();
        let r = distance(&mut graph);
        let (radius, width) = (number(&mut graph, 0.5), number(&mut graph, 1e-4));
        let off = graph.sub(r, radius);
        let off = graph.unary(Unary::Abs, off);
        let inside = graph.push(Op::Compare(crate::ir::Compare::Less, off, width));
        let (one, zero) = (number(&mut graph, 1.0), number(&mut graph, 0.0));
        let root = graph.push(Op::Select { condition: inside, accept: one, reject: zero });
        let found = find(&mut graph, root);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].argument, r);
        assert!(found[0].bands.iter().any(|b| (b.1 - b.0 - 2e-4).abs() < 1e-12), "{:?}", found[0].bands);
    }

    #[test]
    fn a_bell_is_as_wide_as_what_it_squares() {
        let mut graph = Graph::default();
        let r = distance(&mut graph);
        let (radius, width) = (number(&mut graph, 0.5), number(&mut graph, 1e-3));
        let off = graph.sub(r, radius);
        let off = graph.binary(Binary::Div, off, width);
        let square = graph.mul(off, off);
        let down = graph.unary(Unary::Neg, square);
        let root = graph.unary(Unary::Exp, down);
        let found = find(&mut graph, root);
        assert!(found[0].bands.iter().any(|b| (b.1 - b.0 - 2e-3).abs() < 1e-12), "{:?}", found[0].bands);
    }

    #[test]
    fn tables_turn_where_they_peak_and_not_where_they_rise() {
        let rise = turns(&[0.0, 1.0, 2.0, 3.0], &[vec![0.0, 0.0, 5.0, 6.0]]);
        assert_eq!(rise, []);
        let peak = turns(&[0.0, 1.0, 1.5, 2.0, 9.0], &[vec![0.0, 0.0, 5.0, 0.0, 0.0]]);
        assert_eq!(peak, [(1.0, 2.0)]);
        let dent = turns(&[0.0, 1.0, 2.0, 3.0], &[vec![0.0, 12.0, 9.0, 300.0]]);
        assert_eq!(dent, []);
    }
}
