//! Intervals of real numbers, rounded outward in f64, and the graph's operations on them.
//!
//! Sums, products, quotients and square roots are right to half an ulp, so that their ends move by one ulp unless the
//! result is exact; other functions are right to an ulp or two in every mathematical library that is used, and their ends
//! move by four.

use crate::ir::{Binary, Compare, Unary};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// What a number can be. Truth values are 0 and 1.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Interval {
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
    /// Whether it may be no number.
    pub nan: bool,
}

impl Interval {
    /// Any number, and none.
    pub const ANY: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY, nan: true };
    /// Any finite number.
    pub const NUMBER: Self = Self { low: -f64::MAX, high: f64::MAX, nan: false };
    /// A truth value of which nothing is known.
    pub const EITHER: Self = Self { low: 0.0, high: 1.0, nan: false };

    /// From the least to the greatest value.
    #[must_use]
    pub fn new(low: f64, high: f64) -> Self {
        Self::checked(low, high, false)
    }

    /// One number.
    #[must_use]
    pub fn point(x: f64) -> Self {
        Self::checked(x, x, false)
    }

    fn checked(low: f64, high: f64, nan: bool) -> Self {
        if low.is_nan() || high.is_nan() { Self::ANY } else { Self { low, high, nan } }
    }

    /// Ends that the functions of a mathematical library made.
    fn around(low: f64, high: f64, nan: bool) -> Self {
        let step = |x: f64| if x == 0.0 || x.is_infinite() { 0.0 } else { 4.0 * f64::EPSILON * x.abs() };
        Self::checked(low - step(low), high + step(high), nan)
    }

    /// The smallest interval around both.
    #[must_use]
    pub fn hull(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high), nan: self.nan || other.nan }
    }

    /// What lies in both, of which each is known to hold the value: a number that either holds for certain.
    #[must_use]
    pub fn meet(self, other: Self) -> Self {
        let (low, high) = (self.low.max(other.low), self.high.min(other.high));
        // Apart by rounding alone.
        let (low, high) = if low <= high { (low, high) } else { (high, low) };
        Self { low, high, nan: self.nan && other.nan }
    }

    /// Whether both ends are finite.
    fn ends(self) -> bool {
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
        !self.nan && self.ends()
    }

    /// The number it is, if it can be only one.
    #[must_use]
    pub fn exact(self) -> Option<f64> {
        (!self.nan && self.low == self.high).then_some(self.low)
    }

    /// Whether a number lies in it.
    #[must_use]
    pub fn holds(self, x: f64) -> bool {
        if x.is_nan() { self.nan } else { self.low <= x && x <= self.high }
    }

    /// Difference of the ends.
    #[must_use]
    pub fn width(self) -> f64 {
        self.high - self.low
    }

    /// The larger magnitude of its ends.
    #[must_use]
    pub fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    fn has_zero(self) -> bool {
        self.low <= 0.0 && self.high >= 0.0
    }
}

/// A rounded result moved outward by an ulp, unless it is known to be exact.
fn down(x: f64, exact: bool) -> f64 {
    if exact || x.is_infinite() { x } else { x.next_down() }
}

fn up(x: f64, exact: bool) -> f64 {
    if exact || x.is_infinite() { x } else { x.next_up() }
}

/// Whether a rounded sum is the sum (Knuth's two-sum has no rest).
fn exact_sum(a: f64, b: f64, sum: f64) -> bool {
    let c = sum - a;
    (a - (sum - c)) + (b - c) == 0.0
}

/// Whether a rounded product is known to be the product: a factor is 0, ±1 or ±2, or both are small whole numbers.
fn exact_product(a: f64, b: f64, product: f64) -> bool {
    let plain = |x: f64| x == 0.0 || x.abs() == 1.0 || x.abs() == 2.0;
    let whole = |x: f64| x.fract() == 0.0;
    plain(a) || plain(b) || (product.abs() < 9e15 && whole(a) && whole(b))
}

fn add(a: Interval, b: Interval) -> Interval {
    let (low, high) = (a.low + b.low, a.high + b.high);
    let (low_exact, high_exact) = (exact_sum(a.low, b.low, low), exact_sum(a.high, b.high, high));
    // ∞ − ∞
    let nan = a.nan || b.nan || (!a.ends() && !b.ends() && (low.is_nan() || high.is_nan() || opposed(a, b)));
    Interval::checked(down(low, low_exact), up(high, high_exact), nan)
}

/// Whether one may be +∞ while the other is −∞.
fn opposed(a: Interval, b: Interval) -> bool {
    let (up, down) = (f64::INFINITY, f64::NEG_INFINITY);
    (a.high == up && b.low == down) || (a.low == down && b.high == up)
}

fn negative(a: Interval) -> Interval {
    Interval { low: -a.high, high: -a.low, nan: a.nan }
}

fn multiply(a: Interval, b: Interval) -> Interval {
    // 0 · ∞ at an end of the intervals is 0 unless the infinity can really be taken: then it is no number.
    let product = |x: f64, y: f64| {
        let p = if x == 0.0 || y == 0.0 { 0.0 } else { x * y };
        let exact = exact_product(x, y, p);
        (down(p, exact), up(p, exact))
    };
    let ends = [product(a.low, b.low), product(a.low, b.high), product(a.high, b.low), product(a.high, b.high)];
    let low = ends.iter().fold(f64::INFINITY, |m, e| m.min(e.0));
    let high = ends.iter().fold(f64::NEG_INFINITY, |m, e| m.max(e.1));
    let nan = a.nan || b.nan || (a.has_zero() && !b.ends()) || (b.has_zero() && !a.ends());
    Interval::checked(low, high, nan)
}

fn divide(a: Interval, b: Interval) -> Interval {
    if b.has_zero() {
        // Zero has two signs, and so has what is infinite.
        return Interval::ANY;
    }
    let quotient = |x: f64, y: f64| {
        // ∞/∞ at an end of the intervals.
        if x.is_infinite() && y.is_infinite() {
            return (0.0f64.min(x * y.signum()), 0.0f64.max(x * y.signum()));
        }
        let q = x / y;
        let exact = x == 0.0 || y.is_infinite() || y.abs() == 1.0 || (q.fract() == 0.0 && q.abs() < 9e15 && q * y == x);
        (down(q, exact), up(q, exact))
    };
    let ends = [quotient(a.low, b.low), quotient(a.low, b.high), quotient(a.high, b.low), quotient(a.high, b.high)];
    let low = ends.iter().fold(f64::INFINITY, |m, e| m.min(e.0));
    let high = ends.iter().fold(f64::NEG_INFINITY, |m, e| m.max(e.1));
    Interval::checked(low, high, a.nan || b.nan || (!a.ends() && !b.ends()))
}

fn monotone(a: Interval, domain: (f64, f64), f: impl Fn(f64) -> f64) -> Interval {
    let nan = a.nan || a.low < domain.0 || a.high > domain.1;
    Interval::around(f(a.low.clamp(domain.0, domain.1)), f(a.high.clamp(domain.0, domain.1)), nan)
}

/// As [`monotone`] for functions that round to whole numbers or have a value in a known range.
fn kept(within: (f64, f64), a: Interval) -> Interval {
    Interval { low: a.low.clamp(within.0, within.1), high: a.high.clamp(within.0, within.1), nan: a.nan }
}

/// cos x: its extremes are at whole multiples of π.
fn cosine(a: Interval) -> Interval {
    // Beyond, the rounding of a quotient by π hides where the extremes are.
    const MOST: f64 = 1e9;
    if !(a.magnitude() < MOST && a.width() < TAU) {
        return Interval { low: -1.0, high: 1.0, nan: a.nan || !a.ends() };
    }
    // Whether a multiple shift + n · 2π lies within, with room for rounding.
    let meets = |shift: f64| {
        let (x, y) = ((a.low - shift) / TAU, (a.high - shift) / TAU);
        let room = 4.0 * f64::EPSILON * (1.0 + x.abs().max(y.abs()));
        (x - room).ceil() <= y + room
    };
    let (c, d) = (a.low.cos(), a.high.cos());
    let own = Interval::around(c.min(d), c.max(d), a.nan);
    let high = if meets(0.0) { 1.0 } else { own.high };
    let low = if meets(PI) { -1.0 } else { own.low };
    kept((-1.0, 1.0), Interval { low, high, nan: a.nan })
}

fn tangent(a: Interval) -> Interval {
    let nan = a.nan || !a.ends();
    let branch = |x: f64| ((x + FRAC_PI_2) / PI).floor();
    let room = 1e-12 * (1.0 + a.magnitude());
    if !nan && a.magnitude() < 1e9 && branch(a.low - room) == branch(a.high + room) {
        Interval::around(a.low.tan(), a.high.tan(), false)
    } else {
        Interval { nan, ..Interval::ANY }
    }
}

/// A componentwise operation.
#[must_use]
pub fn unary(op: Unary, a: Interval) -> Interval {
    let all = (f64::NEG_INFINITY, f64::INFINITY);
    let whole = |f: fn(f64) -> f64| Interval { low: f(a.low), high: f(a.high), nan: a.nan };
    match op {
        Unary::Neg => negative(a),
        Unary::Abs => {
            let low = if a.has_zero() { 0.0 } else { a.low.abs().min(a.high.abs()) };
            Interval { low, high: a.magnitude(), nan: a.nan }
        }
        Unary::Sign => {
            let sign = |x: f64| if x == 0.0 { 0.0 } else { x.signum() };
            Interval { low: sign(a.low), high: sign(a.high), nan: a.nan }
        }
        Unary::Floor => whole(f64::floor),
        Unary::Ceil => whole(f64::ceil),
        Unary::Round => whole(f64::round_ties_even),
        Unary::Sqrt => {
            let nan = a.nan || a.low < 0.0;
            let root = |x: f64| {
                let r = x.max(0.0).sqrt();
                (r, r * r == x && r.fract() == 0.0)
            };
            let ((low, low_exact), (high, high_exact)) = (root(a.low), root(a.high));
            Interval::checked(down(low, low_exact).max(0.0), up(high, high_exact), nan)
        }
        Unary::Exp => {
            let r = monotone(a, all, f64::exp);
            // The least positive numbers are not relative to anything.
            Interval { low: r.low.max(0.0), high: r.high + f64::MIN_POSITIVE, ..r }
        }
        Unary::Expm1 => kept((-1.0, f64::INFINITY), monotone(a, all, f64::exp_m1)),
        Unary::Log => monotone(a, (0.0, f64::INFINITY), f64::ln),
        Unary::Cos => cosine(a),
        // sin x = cos(x − π/2); the shift is right to half an ulp of x, on top of π's own rounding.
        Unary::Sin => {
            let room = f64::EPSILON * (a.magnitude() + 2.0);
            let exact = cosine(Interval { low: a.low - FRAC_PI_2 - room, high: a.high - FRAC_PI_2 + room, nan: a.nan });
            Interval { nan: a.nan || !a.ends(), ..exact }
        }
        Unary::Tan => tangent(a),
        Unary::Asin => monotone(a, (-1.0, 1.0), f64::asin),
        Unary::Acos => negative(monotone(a, (-1.0, 1.0), |x| -x.acos())),
        Unary::Atan => kept((-FRAC_PI_2.next_up(), FRAC_PI_2.next_up()), monotone(a, all, f64::atan)),
        Unary::Sinh => monotone(a, all, f64::sinh),
        Unary::Cosh => monotone(unary(Unary::Abs, a), all, f64::cosh),
        Unary::Tanh => kept((-1.0, 1.0), monotone(a, all, f64::tanh)),
        Unary::Not => Interval { low: 1.0 - a.high, high: 1.0 - a.low, nan: false },
    }
}

/// A componentwise operation on two independent operands.
#[must_use]
pub fn binary(op: Binary, a: Interval, b: Interval) -> Interval {
    match op {
        Binary::Add => add(a, b),
        Binary::Sub => add(a, negative(b)),
        Binary::Mul => multiply(a, b),
        Binary::Div => divide(a, b),
        Binary::Min => Interval { low: a.low.min(b.low), high: a.high.min(b.high), nan: a.nan || b.nan },
        Binary::Max => Interval { low: a.low.max(b.low), high: a.high.max(b.high), nan: a.nan || b.nan },
        Binary::Pow => pow(a, b),
        Binary::Atan2 => arc(a, b),
        Binary::Mod => modulo(a, b),
        Binary::And => Interval { low: a.low * b.low, high: a.high * b.high, nan: false },
        Binary::Or => Interval { low: a.low.max(b.low), high: a.high.max(b.high), nan: false },
    }
}

/// A comparison.
#[must_use]
pub fn compare(op: Compare, a: Interval, b: Interval) -> Interval {
    let (always, never) = match op {
        Compare::Less => (a.high < b.low, a.low >= b.high),
        Compare::LessEqual => (a.high <= b.low, a.low > b.high),
        Compare::Equal => (a.low == a.high && b.low == b.high && a.low == b.low, a.high < b.low || b.high < a.low),
    };
    // A comparison with no number is false.
    Interval { low: f64::from(u8::from(always && !a.nan && !b.nan)), high: f64::from(u8::from(!never)), nan: false }
}

/// a^b: between the values at the corners, since its logarithm is linear in b and in ln a.
fn pow(a: Interval, b: Interval) -> Interval {
    if let Some(n) = b.exact().filter(|n| n.fract() == 0.0 && n.abs() < 1e3) {
        let exact = power(a, n as i32);
        return Interval::around(exact.low, exact.high, exact.nan);
    }
    if a.low < 0.0 {
        return Interval::ANY;
    }
    let ends = [a.low.powf(b.low), a.low.powf(b.high), a.high.powf(b.low), a.high.powf(b.high)];
    let low = ends.iter().copied().fold(f64::INFINITY, f64::min);
    let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // 0^0 = ∞^0 = 1 between 0 and ∞, and 1^∞ likewise.
    let (low, high) = if b.has_zero() || !b.ends() { (low.min(1.0), high.max(1.0)) } else { (low, high) };
    let r = Interval::around(low, high, a.nan || b.nan);
    Interval { low: r.low.max(0.0), high: r.high + f64::MIN_POSITIVE, ..r }
}

/// atan2(y, x): extreme at the corners of a box that the cut, y = 0 left of the origin, does not touch.
fn arc(y: Interval, x: Interval) -> Interval {
    let nan = x.nan || y.nan;
    let whole = Interval { low: -PI.next_up(), high: PI.next_up(), nan };
    if (x.low <= 0.0 && y.has_zero()) || !x.ends() || !y.ends() {
        return whole;
    }
    let ends = [y.low.atan2(x.low), y.low.atan2(x.high), y.high.atan2(x.low), y.high.atan2(x.high)];
    let low = ends.iter().copied().fold(f64::INFINITY, f64::min);
    let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Interval { nan, ..Interval::around(low, high, nan).meet(whole) }
}

/// a − b·⌊a/b⌋: within one period a plain difference, else anything up to b.
fn modulo(a: Interval, b: Interval) -> Interval {
    if !(b.low > 0.0 && b.ends() && a.ends()) {
        return Interval::ANY;
    }
    let nan = a.nan || b.nan;
    let turns = divide(a, b);
    let (first, last) = (turns.low.floor(), turns.high.floor());
    if first == last && first.abs() < 9e15 {
        let own = add(a, negative(multiply(Interval::point(first), b)));
        return Interval { nan, ..own };
    }
    // Rounding may leave less than nothing, or all of b, where a is large. Where nothing is known of a, what counts is the
    // real number.
    let far = a.magnitude() >= 1e30;
    if !far && !turns.ends() {
        return Interval::ANY;
    }
    let slack = if far { 0.0 } else { 4.0 * f64::EPSILON * a.magnitude() };
    Interval { low: -slack, high: b.high + slack, nan }
}

/// A whole power.
#[must_use]
pub fn power(a: Interval, n: i32) -> Interval {
    if n == 0 {
        return Interval { nan: a.nan, ..Interval::point(1.0) };
    }
    if n < 0 {
        return divide(Interval::point(1.0), power(a, n.checked_neg().unwrap_or(i32::MAX)));
    }
    let ends = |a: Interval| {
        let exact = |x: f64| x == 0.0 || x.abs() == 1.0 || (x.fract() == 0.0 && x.powi(n).abs() < 9e15);
        // Every one of the multiplications rounds.
        let room = |x: f64| if exact(x) || x.is_infinite() { 0.0 } else { f64::from(n) * f64::EPSILON };
        let (low, high) = (a.low.powi(n), a.high.powi(n));
        let tiny = |x: f64| if exact(x) { 0.0 } else { f64::MIN_POSITIVE };
        let low = if low.is_infinite() { low } else { low - room(a.low) * low.abs() - tiny(a.low) };
        let high = if high.is_infinite() { high } else { high + room(a.high) * high.abs() + tiny(a.high) };
        Interval::checked(low, high, a.nan)
    };
    if n % 2 == 0 {
        let r = ends(unary(Unary::Abs, a));
        Interval { low: r.low.max(0.0), ..r }
    } else {
        ends(a)
    }
}

/// The values of the polynomial Σ cᵢ tⁱ over an interval, by the coefficients of Bernstein's basis there: never less than
/// them nor more, and exact where they are in order (Lane and Riesenfeld 1981).
#[must_use]
pub fn polynomial(coefficients: &[f64], t: Interval) -> Interval {
    if !t.ends() {
        return Interval::ANY;
    }
    let n = coefficients.len();
    let mut c = [0.0f64; MAX_TERMS];
    c[..n].copy_from_slice(coefficients);
    let c = &mut c[..n];
    // What rounding may add up to: each shift and scaling stays below Σ |cᵢ| · mᵢ.
    let m = t.magnitude();
    let size = coefficients.iter().rev().fold(0.0, |sum: f64, x| sum * m + x.abs());
    let room = 64.0 * f64::EPSILON * size + f64::MIN_POSITIVE;
    // Taylor shift to the lower end (Horner), scaled to the unit interval.
    for i in 0..n {
        for j in (i..n - 1).rev() {
            c[j] += t.low * c[j + 1];
        }
    }
    let mut scale = 1.0;
    for x in c.iter_mut() {
        *x *= scale;
        scale *= t.width();
    }
    // To Bernstein's basis: bⱼ = Σ_{i≤j} C(j,i)/C(n−1,i) cᵢ.
    let mut least = f64::INFINITY;
    let mut most = f64::NEG_INFINITY;
    for j in 0..n {
        let (mut b, mut ratio) = (0.0, 1.0);
        for (i, x) in c.iter().enumerate().take(j + 1) {
            b += ratio * x;
            // C(j,i+1)/C(n−1,i+1) from C(j,i)/C(n−1,i).
            if i < j {
                ratio *= (j - i) as f64 / (n - 1 - i) as f64;
            }
        }
        least = least.min(b);
        most = most.max(b);
    }
    Interval::checked(least - room, most + room, t.nan)
}

/// Most coefficients of a [`polynomial`].
pub const MAX_TERMS: usize = 10;
