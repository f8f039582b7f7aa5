//! How fast fields can vary: Lipschitz constants, and the length below which a field has no features.
//!
//! Both are found structurally: |∇(a+b)| ≤ |∇a| + |∇b|, |∇ sin a| ≤ |∇a|, and so on. Where no bound follows, there is none.

use super::interval::Interval;
use super::range::{Known, ranges, ranges_of, slope_per_voxel};
use crate::ir::{Binary, Filter, Fold, Graph, GridId, Input, NodeId, Op, Unary};

/// Bounds on the change of each node with position, in 1/unit of length: of a vector, the Euclidean length of the change.
/// Infinite where no bound is known, 0 where the node does not vary.
///
/// Across the outer faces of a grid its interpolant jumps to the value outside: bounds hold on either side of them.
#[must_use]
pub fn lipschitz(graph: &Graph) -> Vec<f64> {
    steepness_within(graph, &ranges(graph), &[])
}

/// As [`lipschitz`], where something is known of the inputs, and of each grid how fast its interpolant changes with voxel
/// coordinates (Euclidean length of its gradient, by its number; what is missing follows from the range of values).
#[must_use]
pub fn lipschitz_of(graph: &Graph, known: &Known<'_>, slopes: &[f64]) -> Vec<f64> {
    steepness_within(graph, &ranges_of(graph, known), slopes)
}

fn grid_slope(graph: &Graph, grid: GridId, values: Interval, known: &[f64]) -> f64 {
    match (graph.grid(grid).filter, known.get(grid.0 as usize)) {
        (Filter::Nearest, _) => f64::INFINITY,
        (Filter::Linear | Filter::Cubic, Some(slope)) => *slope,
        (Filter::Linear | Filter::Cubic, None) => 3f64.sqrt() * slope_per_voxel(graph, grid, values),
    }
}

/// What is finer, in units of the scene, is no place that f32 could tell from the next; and of an argument whose slope has no end
/// but that of numbers (`p.x * p.y` of a place anywhere) nothing is known.
const UNRESOLVED: f64 = 1e-9;

/// The smallest cell of anything piecewise that the roots contain; for several sets of roots see [`Features::length`].
#[must_use]
pub fn feature_length(graph: &Graph, roots: &[NodeId]) -> Option<f64> {
    Features::new(graph).length(roots)
}

/// What is known of every node of a graph that grows no more, for questions about several of its fields.
#[derive(Clone, Debug)]
pub struct Features<'g> {
    graph: &'g Graph,
    ranges: Vec<Interval>,
    steepness: Vec<f64>,
}

impl<'g> Features<'g> {
    /// The facts about a graph as it is now.
    #[must_use]
    pub fn new(graph: &'g Graph) -> Self {
        let ranges = ranges(graph);
        let steepness = steepness_within(graph, &ranges, &[]);
        Self { graph, ranges, steepness }
    }

    /// What [`ranges`] gives.
    #[must_use]
    pub fn ranges(&self) -> &[Interval] {
        &self.ranges
    }

    /// What [`lipschitz`] gives.
    #[must_use]
    pub fn steepness(&self) -> &[f64] {
        &self.steepness
    }

    /// The smallest cell of anything piecewise that the roots contain, in units of length: voxels of grids, cells of noise
    /// (whatever passes through `floor`), rows of tables over keys of known slope. `None` if there is nothing of the kind.
    #[must_use]
    pub fn length(&self, roots: &[NodeId]) -> Option<f64> {
        let Self { graph, ranges, steepness } = self;
        let live = graph.reachable(roots);
        let mut least = f64::INFINITY;
        let mut cells = |steep: f64, width: f64| {
            if steep > 0.0 && steep.is_finite() && width / steep > UNRESOLVED {
                least = least.min(width / steep);
            }
        };
        for id in graph.ids().filter(|id| live[id.0 as usize]) {
            match *graph.op(id) {
                Op::Unary(Unary::Floor | Unary::Ceil | Unary::Round, a) => {
                    cells(scalar_steepness(graph, steepness, a), 1.0)
                }
                Op::Sample { at, .. } | Op::SampleGradient { at, .. } => {
                    cells(scalar_steepness(graph, steepness, at), 1.0)
                }
                Op::Lookup { table, at } => {
                    let keys: Option<Vec<f64>> = graph.table(table).keys.iter().map(|k| graph.number(*k)).collect();
                    // Only a table over a field of known slope has cells of a known size; over voxels the grid decides.
                    let over_grid = !steepness[at.0 as usize].is_finite() || is_sampled(graph, at);
                    if let (Some(keys), false) = (keys, over_grid) {
                        let gap =
                            keys.windows(2).map(|w| w[1] - w[0]).filter(|g| *g > 0.0).fold(f64::INFINITY, f64::min);
                        let span = ranges[at.0 as usize];
                        if gap.is_finite() && span.high > span.low {
                            cells(steepness[at.0 as usize], gap);
                        }
                    }
                }
                _ => {}
            }
        }
        least.is_finite().then_some(least)
    }
}

fn steepness_within(graph: &Graph, ranges: &[Interval], known: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = Vec::with_capacity(graph.len());
    for id in graph.ids() {
        let get = |n: NodeId| out[n.0 as usize];
        let range = |n: NodeId| ranges[n.0 as usize];
        let magnitude = |n: NodeId| range(n).low.abs().max(range(n).high.abs());
        // 0 · ∞: a factor that does not vary contributes nothing, however large the other is.
        let times = |l: f64, m: f64| if l == 0.0 || m == 0.0 { 0.0 } else { l * m };
        let bound = match *graph.op(id) {
            Op::Const(_) | Op::Truth(_) | Op::Param(_) | Op::LoopVar(_) => 0.0,
            Op::Input(Input::Position | Input::Altitude(_)) => 1.0,
            Op::Input(Input::Direction | Input::CosTheta | Input::Versine | Input::Vercosine | Input::Time) => 0.0,
            Op::Unary(u, a) => match u {
                Unary::Neg | Unary::Abs | Unary::Sin | Unary::Cos | Unary::Atan | Unary::Tanh => get(a),
                Unary::Exp | Unary::Expm1 => times(get(a), range(a).high.exp()),
                Unary::Sqrt => {
                    // sqrt(dot(v, v)) is a length: as steep as v itself.
                    match *graph.op(a) {
                        Op::Dot(x, y) if x == y => get(x),
                        _ => times(get(a), 0.5 / range(a).low.max(0.0).sqrt()),
                    }
                }
                Unary::Log => times(get(a), 1.0 / range(a).low.max(0.0)),
                Unary::Sign
                | Unary::Floor
                | Unary::Ceil
                | Unary::Round
                | Unary::Tan
                | Unary::Asin
                | Unary::Acos
                | Unary::Sinh
                | Unary::Cosh
                | Unary::Not => times(get(a), f64::INFINITY),
            },
            Op::Binary(b, x, y) => match b {
                Binary::Add | Binary::Sub => get(x) + get(y),
                Binary::Mul => times(get(x), magnitude(y)) + times(get(y), magnitude(x)),
                Binary::Div => {
                    let least = if range(y).low > 0.0 { range(y).low } else { (-range(y).high).max(0.0) };
                    times(get(x), 1.0 / least) + times(times(get(y), magnitude(x)), 1.0 / (least * least))
                }
                Binary::Min | Binary::Max if graph.width(x) == 1 => get(x).max(get(y)),
                // Some components may be the one's, some the other's.
                Binary::Min | Binary::Max => get(x).hypot(get(y)),
                Binary::Pow | Binary::Atan2 | Binary::Mod => times(get(x) + get(y), f64::INFINITY),
                Binary::And | Binary::Or => times(get(x) + get(y), f64::INFINITY),
            },
            Op::PowI(a, n) => times(get(a), f64::from(n.abs()) * magnitude(a).powi(n - 1).abs()),
            Op::Compare(_, a, b) => times(get(a) + get(b), f64::INFINITY),
            Op::Select { condition, accept, reject } => get(condition) + get(accept).max(get(reject)),
            Op::Compose(parts, width) => parts[..width as usize].iter().map(|p| get(*p).powi(2)).sum::<f64>().sqrt(),
            // A vector's bound is that of its Euclidean length.
            Op::Splat(a, width) => get(a) * f64::from(width).sqrt(),
            Op::Extract(a, _) => get(a),
            Op::Dot(a, b) => match (graph.constant(a), graph.constant(b)) {
                (Some(c), _) => times(get(b), norm(c.values())),
                (_, Some(c)) => times(get(a), norm(c.values())),
                _ => {
                    let width = f64::from(graph.width(a)).sqrt();
                    width * (times(get(a), magnitude(b)) + times(get(b), magnitude(a)))
                }
            },
            Op::Sample { grid, at } => times(get(at), grid_slope(graph, grid, range(id), known)),
            Op::Lookup { at, .. } | Op::LookupSlope { at, .. } | Op::SampleGradient { at, .. } => {
                times(get(at), f64::INFINITY)
            }
            Op::CellHash { cell, .. } => times(get(cell), f64::INFINITY),
            Op::Reduce { fold, start, end, body, .. } => match fold {
                Fold::Sum => times(get(body), f64::from((end - start).max(0))),
                Fold::Min | Fold::Max => get(body),
                Fold::Product => times(get(body), f64::INFINITY),
            },
        };
        out.push(if bound.is_nan() { f64::INFINITY } else { bound });
    }
    out
}

fn norm(values: Vec<f64>) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn is_sampled(graph: &Graph, node: NodeId) -> bool {
    graph.reads(&[node], |op| matches!(op, Op::Sample { .. }))
}

/// The steepness of a vector is that of its steepest component: cells are counted per axis.
fn scalar_steepness(graph: &Graph, steepness: &[f64], node: NodeId) -> f64 {
    match *graph.op(node) {
        Op::Compose(parts, width) => {
            parts[..width as usize].iter().map(|p| steepness[p.0 as usize]).fold(0.0, f64::max)
        }
        _ => steepness[node.0 as usize],
    }
}
