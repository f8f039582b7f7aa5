//! Eight-point Gauss–Legendre panels: quadrature, interpolation, and what the decay of the coefficients says about errors.

use std::sync::LazyLock;

/// Points of a panel; also the lanes of a tape.
pub(super) const N: usize = compiler::ir::eval::LANES;

/// Values at the nodes of a panel, or coefficients of Legendre polynomials.
pub(super) type Nodes = [f64; N];

/// Tables of the rule on [0, 1].
pub(super) struct Rule {
    /// Nodes in (0, 1), ascending.
    pub(super) x: Nodes,
    /// Weights; they sum to 1.
    pub(super) w: Nodes,
    /// `transform[k][i]`: coefficient k of the shifted Legendre polynomial through values at the nodes.
    transform: [Nodes; N],
    /// `integral[i][j]`: ∫ from 0 to node i of the j-th Lagrange polynomial.
    integral: [Nodes; N],
}

/// P₀ to P_N at `x` in [−1, 1].
fn legendre(x: f64) -> [f64; N + 1] {
    let mut p = [1.0; N + 1];
    p[1] = x;
    for k in 1..N {
        let n = k as f64;
        p[k + 1] = ((2.0 * n + 1.0) * x * p[k] - n * p[k - 1]) / (n + 1.0);
    }
    p
}

pub(super) static RULE: LazyLock<Rule> = LazyLock::new(|| {
    let n = N as f64;
    let (mut x, mut w) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        // Newton from the classical guess.
        let mut z = -(std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5)).cos();
        let mut slope = 0.0;
        for _ in 0..50 {
            let p = legendre(z);
            slope = n * (z * p[N] - p[N - 1]) / (z * z - 1.0);
            z -= p[N] / slope;
        }
        x[i] = z;
        w[i] = 2.0 / ((1.0 - z * z) * slope * slope);
    }
    let mut transform = [[0.0; N]; N];
    for (k, row) in transform.iter_mut().enumerate() {
        for i in 0..N {
            row[i] = 0.5 * (2.0 * k as f64 + 1.0) * w[i] * legendre(x[i])[k];
        }
    }
    let mut integral = [[0.0; N]; N];
    for i in 0..N {
        let p = legendre(x[i]);
        for (k, row) in transform.iter().enumerate() {
            // ∫ P_k from −1 to x, halved for the unit interval.
            let upto = if k == 0 { x[i] + 1.0 } else { (p[k + 1] - p[k - 1]) / (2.0 * k as f64 + 1.0) };
            for j in 0..N {
                integral[i][j] += 0.5 * upto * row[j];
            }
        }
    }
    Rule { x: x.map(|z| 0.5 * (z + 1.0)), w: w.map(|w| 0.5 * w), transform, integral }
});

impl Rule {
    /// ∫ over the unit interval.
    pub(super) fn mean(&self, f: &Nodes) -> f64 {
        self.w.iter().zip(f).map(|(w, f)| w * f).sum()
    }

    /// Coefficients of the interpolant.
    pub(super) fn coefficients(&self, f: &Nodes) -> Nodes {
        std::array::from_fn(|k| self.transform[k].iter().zip(f).map(|(t, f)| t * f).sum())
    }

    /// ∫ of the interpolant from 0 to each node.
    pub(super) fn running(&self, f: &Nodes) -> Nodes {
        std::array::from_fn(|i| self.integral[i].iter().zip(f).map(|(t, f)| t * f).sum())
    }
}

/// How well an interpolant represents its function.
#[derive(Copy, Clone, Debug)]
pub(super) struct Decay {
    /// Size of the highest coefficients.
    pub(super) last: f64,
    /// By how much pairs of coefficients shrink.
    pub(super) ratio: f64,
}

impl Decay {
    pub(super) fn of(c: &Nodes) -> Self {
        Self::above(c, 0.0)
    }

    /// The same for values that are only known to within `noise` each, which no division of the panel mends: coefficients
    /// that such noise explains count as none.
    pub(super) fn above(c: &Nodes, noise: f64) -> Self {
        let size = c.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let floor = (16.0 * f64::EPSILON * size).max(2.0 * noise);
        let last = c[N - 1].hypot(c[N - 2]);
        if last <= floor || !last.is_finite() {
            let ratio = if last.is_finite() { 0.0 } else { 1.0 };
            return Self { last, ratio };
        }
        let middle = c[N - 3].hypot(c[N - 4]).max(floor);
        let first = c[N - 5].hypot(c[N - 6]).max(floor);
        Self { last, ratio: (last / middle).max(middle / first) }
    }

    /// Error of the mean by the Gauss rule, which aliases only what lies N orders beyond the last coefficients: with fast
    /// decay much less than the last ones, with none a few times as much (after Berntsen and Espelid 1991, cautiously).
    pub(super) fn quadrature(&self) -> f64 {
        let r = self.ratio;
        if r < 0.5 { 40.0 * r * r * r * self.last } else { 10.0 * self.last * r.min(1.0) }
    }

    /// Error of the interpolant itself, in the largest norm.
    pub(super) fn interpolation(&self) -> f64 {
        4.0 * self.last * self.ratio.min(1.0)
    }
}

/// Value of the interpolant at `x` in [0, 1], by Clenshaw's recurrence.
pub(super) fn value(c: &Nodes, x: f64) -> f64 {
    let z = 2.0 * x - 1.0;
    let (mut b1, mut b2) = (0.0, 0.0);
    for k in (1..N).rev() {
        let n = k as f64;
        let b = c[k] + (2.0 * n + 1.0) / (n + 1.0) * z * b1 - (n + 1.0) / (n + 2.0) * b2;
        (b1, b2) = (b, b1);
    }
    c[0] + z * b1 - 0.5 * b2
}

/// Points of the unit interval between which the interpolant is monotone (the ends among them), with its values.
pub(super) fn monotone(c: &Nodes) -> Vec<(f64, f64)> {
    const STEPS: usize = 16;
    let at = |i: usize| {
        // Denser at the ends, as the nodes are.
        let x = 0.5 - 0.5 * (std::f64::consts::PI * i as f64 / STEPS as f64).cos();
        (x, value(c, x))
    };
    let points: [(f64, f64); STEPS + 1] = std::array::from_fn(at);
    let mut out = vec![points[0]];
    for i in 1..STEPS {
        let [a, b, d] = [points[i - 1], points[i], points[i + 1]];
        if (b.1 - a.1) * (d.1 - b.1) < 0.0 {
            out.push(extremum(c, a.0, d.0, b.1 > a.1));
        }
    }
    out.push(points[STEPS]);
    out
}

/// Golden section between two points that enclose one extremum.
fn extremum(c: &Nodes, mut a: f64, mut b: f64, maximum: bool) -> (f64, f64) {
    const G: f64 = 0.618_033_988_749_894_9;
    let f = |x: f64| if maximum { -value(c, x) } else { value(c, x) };
    let (mut x, mut y) = (b - G * (b - a), a + G * (b - a));
    let (mut fx, mut fy) = (f(x), f(y));
    // Values are flat near an extremum: half the digits of the place are all there are.
    while b - a > 1e-8 {
        if fx < fy {
            (b, y, fy) = (y, x, fx);
            x = b - G * (b - a);
            fx = f(x);
        } else {
            (a, x, fx) = (x, y, fy);
            y = a + G * (b - a);
            fy = f(y);
        }
    }
    let x = 0.5 * (a + b);
    (x, value(c, x))
}

/// Where the interpolant equals `level` between two points of opposite sides, by the Illinois rule.
pub(super) fn root(c: &Nodes, level: f64, (mut a, fa): (f64, f64), (mut b, fb): (f64, f64)) -> f64 {
    let (mut fa, mut fb) = (fa - level, fb - level);
    if fa == 0.0 {
        return a;
    }
    for _ in 0..80 {
        if fb == 0.0 || (b - a).abs() <= 2.0 * f64::EPSILON {
            return b;
        }
        let x = b - fb * (b - a) / (fb - fa);
        let x = if x > a.min(b) && x < a.max(b) { x } else { 0.5 * (a + b) };
        let fx = value(c, x) - level;
        if fx * fb < 0.0 {
            (a, fa) = (b, fb);
        } else {
            fa *= 0.5;
        }
        if (x - b).abs() <= f64::EPSILON {
            return x;
        }
        (b, fb) = (x, fx);
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_polynomials() {
        let f = |p: i32| RULE.x.map(|x| x.powi(p));
        for p in 0..16 {
            assert!((RULE.mean(&f(p)) - 1.0 / f64::from(p + 1)).abs() < 1e-15, "{p}");
        }
        for p in 0..8 {
            let running = RULE.running(&f(p));
            for i in 0..N {
                assert!((running[i] - RULE.x[i].powi(p + 1) / f64::from(p + 1)).abs() < 1e-14);
            }
            let c = RULE.coefficients(&f(p));
            assert!((value(&c, 0.3) - 0.3f64.powi(p)).abs() < 1e-14 && (value(&c, 1.0) - 1.0).abs() < 1e-13);
        }
    }

    #[test]
    fn errors_are_estimated_from_above() {
        type Case = (fn(f64) -> f64, f64);
        let cases: [Case; 6] = [
            (|x| (-3.0 * x).exp(), (1.0 - (-3.0f64).exp()) / 3.0),
            (|x| (20.0 * x).sin(), (1.0 - 20.0f64.cos()) / 20.0),
            (|x| (x - 0.3).abs(), 0.29),
            (|x| f64::from(u8::from(x > 0.37)), 0.63),
            (|x| 1.0 / (1.0 + 100.0 * (x - 0.4) * (x - 0.4)), (4.0f64.atan() + 6.0f64.atan()) / 10.0),
            (|x| x.sqrt(), 2.0 / 3.0),
        ];
        for (i, (f, exact)) in cases.into_iter().enumerate() {
            let values = RULE.x.map(f);
            let error = (RULE.mean(&values) - exact).abs();
            let estimate = Decay::of(&RULE.coefficients(&values)).quadrature();
            assert!(estimate + 1e-15 >= error, "case {i}: {estimate} < {error}");
        }
    }

    #[test]
    fn roots_and_extrema() {
        let c = RULE.coefficients(&RULE.x.map(|x| (x - 0.2) * (x - 0.7)));
        let points = monotone(&c);
        assert_eq!(points.len(), 3);
        assert!((points[1].0 - 0.45).abs() < 1e-7);
        assert!((root(&c, 0.0, points[0], points[1]) - 0.2).abs() < 1e-14);
        assert!((root(&c, 0.0, points[1], points[2]) - 0.7).abs() < 1e-14);
    }
}
