//! Intervals of every node over all positions, directions, times and parameter values: signs, finiteness, bounds.
//!
//! One interval for all components of a node, by the operations of [`super::interval`]. Parameters may be set beyond their
//! range, so they count as any number. A node whose interval may contain no number at all (`sqrt(-1)`) is marked
//! [`Interval::nan`].

use super::interval::{CUBIC_OVERSHOOT, CUBIC_SLOPE, Interval, binary, power, unary};
use crate::ir::{Binary, Compare, Filter, Fold, Graph, Input, NodeId, Op};
use crate::loader::Scalar;

/// The range of the values of a grid, from how it is stored; voxels that are no numbers were replaced at loading.
fn stored(graph: &Graph, grid: crate::ir::GridId) -> Interval {
    let info = graph.grid(grid);
    let (low, high) = match info.header.scalar {
        Scalar::U8 => (0.0, f64::from(u8::MAX)),
        Scalar::I8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
        Scalar::U16 => (0.0, f64::from(u16::MAX)),
        Scalar::I16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
        Scalar::U32 => (0.0, f64::from(u32::MAX)),
        Scalar::I32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
        Scalar::U64 => (0.0, u64::MAX as f64),
        Scalar::I64 => (i64::MIN as f64, i64::MAX as f64),
        Scalar::F32 => (f64::from(f32::MIN), f64::from(f32::MAX)),
        Scalar::F64 => (f64::MIN, f64::MAX),
    };
    let product = binary(Binary::Mul, Interval::new(low, high), Interval::point(info.header.slope));
    filtered(graph, grid, binary(Binary::Add, product, Interval::point(info.header.intercept)))
}

/// The values of a grid between its voxels, from those of the voxels.
fn filtered(graph: &Graph, grid: crate::ir::GridId, scaled: Interval) -> Interval {
    let info = graph.grid(grid);
    let scaled = match info.filter {
        Filter::Nearest | Filter::Linear => scaled,
        Filter::Cubic => {
            let over = scaled.width() * CUBIC_OVERSHOOT;
            Interval::new(scaled.low - over, scaled.high + over)
        }
    };
    scaled.hull(Interval::point(info.outside))
}

fn times(a: Interval, b: Interval) -> Interval {
    binary(Binary::Mul, a, b)
}

/// The largest slope of a grid's interpolant along an axis of voxels, where the interpolant stays within `values`.
pub(super) fn slope_per_voxel(graph: &Graph, grid: crate::ir::GridId, values: Interval) -> f64 {
    match graph.grid(grid).filter {
        Filter::Nearest => 0.0,
        Filter::Linear => values.width(),
        Filter::Cubic => CUBIC_SLOPE * values.width(),
    }
}

/// What each loop variable can be, by depth: the hull over all loops of that depth.
fn loop_variables(graph: &Graph) -> [Interval; 16] {
    let mut out = [None::<Interval>; 16];
    for id in graph.ids() {
        if let Op::Reduce { depth, start, end, .. } = *graph.op(id) {
            let range = Interval { low: f64::from(start), high: f64::from(end.max(start + 1) - 1), nan: false };
            let slot = &mut out[depth as usize];
            *slot = Some(slot.map_or(range, |r| r.hull(range)));
        }
    }
    out.map(|r| r.unwrap_or(Interval { low: f64::from(i32::MIN), high: f64::from(i32::MAX), nan: false }))
}

/// What is known about the inputs.
#[derive(Clone, Debug)]
pub struct Known<'a> {
    /// Of every component of a position, and of altitudes, in units of length.
    pub position: Interval,
    /// Seconds.
    pub time: Interval,
    /// Values of parameters in the graph's units; nothing is known of those that are missing.
    pub params: &'a [Vec<f64>],
    /// Values of grids, by their number; of those that are missing, what their type can hold.
    pub grids: &'a [Interval],
}

impl Default for Known<'_> {
    /// Nothing: positions, times and parameters are numbers, however large.
    fn default() -> Self {
        let number = Interval::NUMBER;
        Self { position: number, time: number, params: &[], grids: &[] }
    }
}

/// The range of every node, all components together.
#[must_use]
pub fn ranges(graph: &Graph) -> Vec<Interval> {
    ranges_of(graph, &Known::default())
}

/// The range of every node where something is known about the inputs: majorants of coefficients.
#[must_use]
pub fn ranges_of(graph: &Graph, known: &Known<'_>) -> Vec<Interval> {
    let stored = |grid: crate::ir::GridId| match known.grids.get(grid.0 as usize) {
        Some(values) => filtered(graph, grid, *values),
        None => stored(graph, grid),
    };
    let mut out: Vec<Interval> = Vec::with_capacity(graph.len());
    let variables = loop_variables(graph);
    for id in graph.ids() {
        let get = |n: NodeId| out[n.0 as usize];
        let range = match *graph.op(id) {
            Op::Const(c) => c.values().into_iter().map(Interval::point).reduce(Interval::hull).unwrap_or(Interval::ANY),
            Op::Truth(_) | Op::Compare(Compare::Less | Compare::LessEqual | Compare::Equal, ..) => Interval::EITHER,
            Op::Input(Input::Direction | Input::CosTheta) => Interval { low: -1.0, high: 1.0, nan: false },
            Op::Input(Input::Versine | Input::Vercosine) => Interval { low: 0.0, high: 2.0, nan: false },
            Op::Input(Input::Position | Input::Altitude(_)) => known.position,
            Op::Input(Input::Time) => known.time,
            Op::Param(p) => match known.params.get(p.0 as usize) {
                Some(values) => {
                    values.iter().copied().map(Interval::point).reduce(Interval::hull).unwrap_or(Interval::ANY)
                }
                None => Interval::NUMBER,
            },
            Op::LoopVar(depth) => variables[depth as usize],
            Op::Unary(u, a) => unary(u, get(a)),
            Op::Binary(Binary::Mul, a, b) if a == b => power(get(a), 2),
            Op::Binary(b, x, y) => binary(b, get(x), get(y)),
            Op::PowI(a, n) => power(get(a), n),
            Op::Select { accept, reject, .. } => get(accept).hull(get(reject)),
            Op::Compose(parts, width) => {
                parts[..width as usize].iter().map(|p| get(*p)).reduce(Interval::hull).unwrap_or(Interval::ANY)
            }
            Op::Splat(a, _) | Op::Extract(a, _) => get(a),
            Op::Dot(a, b) => {
                let product = if a == b { power(get(a), 2) } else { times(get(a), get(b)) };
                let width = f64::from(graph.width(a));
                times(product, Interval::point(width))
            }
            Op::Sample { grid, .. } => stored(grid),
            Op::SampleGradient { grid, .. } => {
                let steepest = slope_per_voxel(graph, grid, stored(grid));
                Interval::new(-steepest, steepest)
            }
            Op::Lookup { table, .. } => {
                let values =
                    graph.table(table).values.iter().map(|v| get(*v)).reduce(Interval::hull).unwrap_or(Interval::ANY);
                let key = match *graph.op(id) {
                    Op::Lookup { at, .. } => get(at),
                    _ => Interval::ANY,
                };
                Interval { nan: values.nan || key.nan, ..values }
            }
            Op::LookupSlope { .. } => Interval::ANY,
            Op::CellHash { .. } => Interval::EITHER,
            Op::Reduce { fold, start, end, body, .. } => {
                let body = get(body);
                let count = f64::from((end - start).max(0));
                match fold {
                    _ if end <= start => Interval::ANY,
                    Fold::Sum => times(body, Interval::point(count)),
                    Fold::Min | Fold::Max => body,
                    Fold::Product if body.low >= 0.0 => power(body, end - start),
                    Fold::Product => Interval::ANY,
                }
            }
        };
        out.push(range);
    }
    out
}
