//! Intervals of every node over all positions, directions, times and parameter values: signs, finiteness, bounds.
//!
//! Intervals are in f64 and widened outward by a few ulp at each operation. Parameters may be set beyond their range, so they
//! count as any number. A node whose interval may contain no number at all (`sqrt(-1)`) is marked [`Range::nan`].

use crate::ir::{Binary, Compare, Filter, Fold, Graph, Input, NodeId, Op, Unary};
use crate::loader::Scalar;

/// What a node's components can be.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Range {
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
    /// Whether it may be no number.
    pub nan: bool,
}

impl Range {
    /// Any number, and none.
    pub const ANY: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY, nan: true };

    fn new(low: f64, high: f64, nan: bool) -> Self {
        if low.is_nan() || high.is_nan() {
            return Self { nan: true, ..Self::ANY };
        }
        // The operations that make the ends are right to an ulp or two.
        let widen = |x: f64, up: bool| {
            if x == 0.0 || x.is_infinite() || x.fract() == 0.0 && x.abs() < 1e15 {
                return x;
            }
            let step = 4.0 * f64::EPSILON * x.abs() + f64::MIN_POSITIVE;
            if up { x + step } else { x - step }
        };
        Self { low: widen(low, false), high: widen(high, true), nan }
    }

    fn point(x: f64) -> Self {
        if x.is_nan() { Self::ANY } else { Self { low: x, high: x, nan: false } }
    }

    fn hull(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high), nan: self.nan || other.nan }
    }

    fn finite(self) -> bool {
        self.low.is_finite() && self.high.is_finite()
    }

    /// Whether it is a number ≥ 0 for certain.
    #[must_use]
    pub fn is_nonnegative(self) -> bool {
        !self.nan && self.low >= 0.0
    }

    /// Whether it is a finite number for certain.
    #[must_use]
    pub fn is_finite(self) -> bool {
        !self.nan && self.finite()
    }
}

fn combine(a: Range, b: Range, f: impl Fn(f64, f64) -> f64) -> Range {
    let ends = [f(a.low, b.low), f(a.low, b.high), f(a.high, b.low), f(a.high, b.high)];
    let low = ends.iter().copied().fold(f64::INFINITY, f64::min);
    let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let lost = ends.iter().any(|e| e.is_nan());
    if lost { Range::ANY } else { Range::new(low, high, a.nan || b.nan) }
}

fn multiply(a: Range, b: Range) -> Range {
    // 0 · ∞ at an end of the intervals is 0 unless the infinity can really be taken: then it is no number.
    let product = |x: f64, y: f64| if x == 0.0 || y == 0.0 { 0.0 } else { x * y };
    let meets_zero = |r: Range| r.low <= 0.0 && r.high >= 0.0;
    let nan = meets_zero(a) && !b.finite() || meets_zero(b) && !a.finite();
    let mut out = combine(a, b, product);
    out.nan |= nan;
    out
}

fn monotone(a: Range, domain: (f64, f64), f: impl Fn(f64) -> f64) -> Range {
    let nan = a.nan || a.low < domain.0 || a.high > domain.1;
    let (low, high) = (a.low.clamp(domain.0, domain.1), a.high.clamp(domain.0, domain.1));
    Range::new(f(low), f(high), nan)
}

fn unary(op: Unary, a: Range) -> Range {
    let all = (f64::NEG_INFINITY, f64::INFINITY);
    match op {
        Unary::Neg => Range { low: -a.high, high: -a.low, nan: a.nan },
        Unary::Abs => {
            let low = if a.low <= 0.0 && a.high >= 0.0 { 0.0 } else { a.low.abs().min(a.high.abs()) };
            Range { low, high: a.low.abs().max(a.high.abs()), nan: a.nan }
        }
        Unary::Sign => Range { low: -1.0, high: 1.0, nan: a.nan },
        Unary::Floor => monotone(a, all, f64::floor),
        Unary::Ceil => monotone(a, all, f64::ceil),
        Unary::Round => monotone(a, all, f64::round_ties_even),
        Unary::Sqrt => monotone(a, (0.0, f64::INFINITY), f64::sqrt),
        Unary::Exp => monotone(a, all, f64::exp),
        Unary::Expm1 => monotone(a, all, f64::exp_m1),
        Unary::Log => monotone(a, (0.0, f64::INFINITY), f64::ln),
        Unary::Sin | Unary::Cos => Range { low: -1.0, high: 1.0, nan: a.nan || !a.finite() },
        Unary::Tan => Range { nan: a.nan || !a.finite(), ..Range::ANY },
        Unary::Asin => monotone(a, (-1.0, 1.0), f64::asin),
        Unary::Acos => {
            let r = monotone(a, (-1.0, 1.0), |x| -x.acos());
            Range { low: -r.high, high: -r.low, nan: r.nan }
        }
        Unary::Atan => monotone(a, all, f64::atan),
        Unary::Sinh => monotone(a, all, f64::sinh),
        Unary::Cosh => {
            let b = unary(Unary::Abs, a);
            monotone(b, all, f64::cosh)
        }
        Unary::Tanh => monotone(a, all, f64::tanh),
        Unary::Not => Range { low: 0.0, high: 1.0, nan: false },
    }
}

fn binary(op: Binary, a: Range, b: Range) -> Range {
    match op {
        Binary::Add => combine(a, b, |x, y| x + y),
        Binary::Sub => combine(a, b, |x, y| x - y),
        Binary::Mul => multiply(a, b),
        Binary::Div => {
            if b.low <= 0.0 && b.high >= 0.0 {
                // A quotient by something that can vanish has no bound, but it keeps a common sign.
                let nonnegative = a.low >= 0.0 && b.low >= 0.0;
                return Range { low: if nonnegative { 0.0 } else { f64::NEG_INFINITY }, ..Range::ANY };
            }
            let nan = !a.finite() && !b.finite();
            let mut out = combine(a, b, |x, y| if x.is_infinite() && y.is_infinite() { f64::INFINITY } else { x / y });
            out.nan |= nan;
            out
        }
        Binary::Min => Range { low: a.low.min(b.low), high: a.high.min(b.high), nan: a.nan || b.nan },
        Binary::Max => Range { low: a.low.max(b.low), high: a.high.max(b.high), nan: a.nan || b.nan },
        Binary::Pow => {
            if a.low >= 0.0 && !b.nan && b.low >= 0.0 {
                combine(a, b, f64::powf)
            } else if a.low >= 0.0 {
                Range { low: 0.0, ..Range::ANY }
            } else {
                Range::ANY
            }
        }
        Binary::Atan2 => Range { low: -std::f64::consts::PI, high: std::f64::consts::PI, nan: a.nan || b.nan },
        Binary::Mod => {
            if b.low > 0.0 && b.finite() && a.finite() {
                Range { low: 0.0, high: b.high, nan: a.nan || b.nan }
            } else {
                Range::ANY
            }
        }
        Binary::And | Binary::Or => Range { low: 0.0, high: 1.0, nan: false },
    }
}

fn power(a: Range, n: i32) -> Range {
    if n < 0 {
        return binary(Binary::Div, Range::point(1.0), power(a, -n));
    }
    if n % 2 == 0 {
        let b = unary(Unary::Abs, a);
        Range::new(b.low.powi(n), b.high.powi(n), b.nan)
    } else {
        Range::new(a.low.powi(n), a.high.powi(n), a.nan)
    }
}

/// The range of the values of a grid, from how it is stored; voxels that are no numbers were replaced at loading.
fn stored(graph: &Graph, grid: crate::ir::GridId) -> Range {
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
    let scaled = combine(Range::point(low), Range::point(high), |a, _| a * info.header.slope + info.header.intercept)
        .hull(combine(Range::point(high), Range::point(low), |a, _| a * info.header.slope + info.header.intercept));
    filtered(graph, grid, scaled)
}

/// The values of a grid between its voxels, from those of the voxels.
fn filtered(graph: &Graph, grid: crate::ir::GridId, scaled: Range) -> Range {
    let info = graph.grid(grid);
    let scaled = match info.filter {
        Filter::Nearest | Filter::Linear => scaled,
        // Catmull–Rom weights of one axis sum to 1 in at most 1.25 of absolute value: three axes overshoot by (1.25³ − 1)/2.
        Filter::Cubic => {
            let over = (scaled.high - scaled.low) * 0.5 * (1.25f64.powi(3) - 1.0);
            Range::new(scaled.low - over, scaled.high + over, false)
        }
    };
    scaled.hull(Range::point(info.outside))
}

/// What each loop variable can be, by depth: the hull over all loops of that depth.
fn loop_variables(graph: &Graph) -> [Range; 16] {
    let mut out = [None::<Range>; 16];
    for id in graph.ids() {
        if let Op::Reduce { depth, start, end, .. } = *graph.op(id) {
            let range = Range { low: f64::from(start), high: f64::from(end.max(start + 1) - 1), nan: false };
            let slot = &mut out[depth as usize];
            *slot = Some(slot.map_or(range, |r| r.hull(range)));
        }
    }
    out.map(|r| r.unwrap_or(Range { low: f64::from(i32::MIN), high: f64::from(i32::MAX), nan: false }))
}

/// What is known about the inputs.
#[derive(Clone, Debug)]
pub struct Known<'a> {
    /// Of every component of a position, and of altitudes, in units of length.
    pub position: Range,
    /// Seconds.
    pub time: Range,
    /// Values of parameters in the graph's units; nothing is known of those that are missing.
    pub params: &'a [Vec<f64>],
    /// Values of grids, by their number; of those that are missing, what their type can hold.
    pub grids: &'a [Range],
}

impl Default for Known<'_> {
    /// Nothing: positions, times and parameters are numbers, however large.
    fn default() -> Self {
        let number = Range { low: -f64::MAX, high: f64::MAX, nan: false };
        Self { position: number, time: number, params: &[], grids: &[] }
    }
}

/// The range of every node, all components together.
#[must_use]
pub fn ranges(graph: &Graph) -> Vec<Range> {
    ranges_of(graph, &Known::default())
}

/// The range of every node where something is known about the inputs: majorants of coefficients.
#[must_use]
pub fn ranges_of(graph: &Graph, known: &Known<'_>) -> Vec<Range> {
    let stored = |grid: crate::ir::GridId| match known.grids.get(grid.0 as usize) {
        Some(values) => filtered(graph, grid, *values),
        None => stored(graph, grid),
    };
    let mut out: Vec<Range> = Vec::with_capacity(graph.len());
    let variables = loop_variables(graph);
    for id in graph.ids() {
        let get = |n: NodeId| out[n.0 as usize];
        let range = match *graph.op(id) {
            Op::Const(c) => c.values().into_iter().map(Range::point).reduce(Range::hull).unwrap_or(Range::ANY),
            Op::Truth(_) | Op::Compare(Compare::Less | Compare::LessEqual | Compare::Equal, ..) => {
                Range { low: 0.0, high: 1.0, nan: false }
            }
            Op::Input(Input::Direction | Input::CosTheta) => Range { low: -1.0, high: 1.0, nan: false },
            Op::Input(Input::Versine | Input::Vercosine) => Range { low: 0.0, high: 2.0, nan: false },
            Op::Input(Input::Position | Input::Altitude(_)) => known.position,
            Op::Input(Input::Time) => known.time,
            Op::Param(p) => match known.params.get(p.0 as usize) {
                Some(values) => values.iter().copied().map(Range::point).reduce(Range::hull).unwrap_or(Range::ANY),
                None => Range { low: -f64::MAX, high: f64::MAX, nan: false },
            },
            Op::LoopVar(depth) => variables[depth as usize],
            Op::Unary(u, a) => unary(u, get(a)),
            Op::Binary(Binary::Mul, a, b) if a == b => power(get(a), 2),
            Op::Binary(b, x, y) => binary(b, get(x), get(y)),
            Op::PowI(a, n) => power(get(a), n),
            Op::Select { accept, reject, .. } => get(accept).hull(get(reject)),
            Op::Compose(parts, width) => {
                parts[..width as usize].iter().map(|p| get(*p)).reduce(Range::hull).unwrap_or(Range::ANY)
            }
            Op::Splat(a, _) | Op::Extract(a, _) => get(a),
            Op::Dot(a, b) => {
                let product = if a == b { power(get(a), 2) } else { multiply(get(a), get(b)) };
                let width = f64::from(graph.width(a));
                multiply(product, Range::point(width))
            }
            Op::Sample { grid, .. } => stored(grid),
            Op::SampleGradient { grid, .. } => {
                let r = stored(grid);
                let d = 4.0 * (r.high - r.low);
                Range::new(-d, d, false)
            }
            Op::Lookup { table, .. } => {
                let values =
                    graph.table(table).values.iter().map(|v| get(*v)).reduce(Range::hull).unwrap_or(Range::ANY);
                let key = match *graph.op(id) {
                    Op::Lookup { at, .. } => get(at),
                    _ => Range::ANY,
                };
                Range { nan: values.nan || key.nan, ..values }
            }
            Op::LookupSlope { .. } => Range::ANY,
            Op::CellHash { .. } => Range { low: 0.0, high: 1.0, nan: false },
            Op::Reduce { fold, start, end, body, .. } => {
                let body = get(body);
                let count = f64::from((end - start).max(0));
                match fold {
                    _ if end <= start => Range::ANY,
                    Fold::Sum => multiply(body, Range::point(count)),
                    Fold::Min | Fold::Max => body,
                    Fold::Product if body.low >= 0.0 => {
                        Range::new(body.low.powi(end - start), body.high.powi(end - start), body.nan)
                    }
                    Fold::Product => Range::ANY,
                }
            }
        };
        out.push(range);
    }
    out
}
