//! One stretch of a ray: its optical depth, the radiance it adds at its near end, and how wrong either may be.
//!
//! Panels are solved on their own and composed afterwards (`L = L₁ + e^(−τ₁)·L₂`), so that refining one leaves the others.

use super::gauss::{Decay, Nodes, RULE};

/// What one band of a panel does. Lengths and coefficients in matching units.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub(super) struct Slice {
    /// ∫σ.
    pub(super) tau: f64,
    /// Error of `tau`.
    pub(super) tau_error: f64,
    /// ∫ j·e^(−∫σ) from the near end.
    pub(super) radiance: f64,
    /// Error of `radiance` from its own quadrature and from the shape of σ inside.
    pub(super) radiance_error: f64,
    /// Whether nothing was approximated but rounding.
    pub(super) exact: bool,
    /// The highest coefficients are rounding noise or near it: dividing further may gain nothing.
    pub(super) noisy: bool,
    /// σ and j at the near end, by the interpolant.
    pub(super) near: [f64; 2],
    /// Likewise at the far end.
    pub(super) far: [f64; 2],
}

/// (1 − e^(−x))/x, 1 at 0.
pub(super) fn phi(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { -(-x).exp_m1() / x }
}

fn range(f: &Nodes) -> (f64, f64) {
    f.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)))
}

/// Constant extinction and emission over a length that may be infinite.
pub(super) fn constant(h: f64, sigma: f64, j: f64) -> Slice {
    let tau = if sigma == 0.0 { 0.0 } else { sigma * h };
    let radiance = if j == 0.0 {
        0.0
    } else if tau > 1.0 {
        j / sigma * -(-tau).exp_m1()
    } else {
        j * h * phi(tau)
    };
    let error = 4.0 * f64::EPSILON;
    let tau_error = if tau.is_finite() { error * tau } else { 0.0 };
    let ends = [sigma, j];
    Slice {
        tau,
        tau_error,
        radiance,
        radiance_error: error * radiance,
        exact: true,
        noisy: true,
        near: ends,
        far: ends,
    }
}

/// Values of an interpolant at 0 and 1: P_k is (−1)^k and 1 there.
fn ends(c: &Nodes) -> (f64, f64) {
    let (even, odd) = (c[0] + c[2] + c[4] + c[6], c[1] + c[3] + c[5] + c[7]);
    (even - odd, even + odd)
}

/// Extinction `s` and emission `j` at the nodes of a panel of length `h`; all finite and not negative. Each `j` is only
/// known to within `noise`, whose effect on the radiance the caller counts.
pub(super) fn solve_noisy(h: f64, s: &Nodes, j: &Nodes, noise: f64) -> Slice {
    const SAME: f64 = 4.0 * f64::EPSILON;
    let ((s_min, s_max), (j_min, j_max)) = (range(s), range(j));
    if s_max - s_min <= SAME * s_max && j_max - j_min <= SAME * j_max {
        return constant(h, 0.5 * (s_min + s_max), 0.5 * (j_min + j_max));
    }
    let rule = &*RULE;
    let c = rule.coefficients(s);
    let emitted = rule.coefficients(j);
    let (sigma_ends, j_ends) = (ends(&c), ends(&emitted));
    let slice = vary(h, (s, j, noise), (&c, &emitted));
    Slice { near: [sigma_ends.0, j_ends.0], far: [sigma_ends.1, j_ends.1], ..slice }
}

/// The same for values that vary, with the coefficients of both interpolants.
fn vary(h: f64, (s, j, unknown): (&Nodes, &Nodes, f64), (c, emitted): (&Nodes, &Nodes)) -> Slice {
    let rule = &*RULE;
    let (s_max, j_max) = (range(s).1, range(j).1);
    let decay = Decay::of(c);
    let noise = 2.0 * f64::EPSILON;
    let tau = h * rule.mean(s);
    let tau_error = h * decay.quadrature() + noise * tau;
    let mut noisy = decay.last <= 1e-9 * s_max;
    if j_max == 0.0 {
        return Slice { tau, tau_error, noisy, ..Slice::default() };
    }
    if s_max == 0.0 {
        let decay = Decay::above(emitted, unknown);
        let radiance = h * rule.mean(j);
        let noisy = decay.last <= (1e-9 * j_max).max(4.0 * unknown);
        let radiance_error = h * decay.quadrature() + noise * radiance;
        return Slice { radiance, radiance_error, noisy, ..Slice::default() };
    }
    // The interpolant of a jump overshoots: keep the running depth within what it can be.
    let e = rule.running(s).map(|x| (-(h * x).clamp(0.0, tau)).exp());
    let seen: Nodes = std::array::from_fn(|i| j[i] * e[i]);
    let absorbed: Nodes = std::array::from_fn(|i| s[i] * e[i]);
    let (q_seen, q_absorbed) = (h * rule.mean(&seen), h * rule.mean(&absorbed));
    let opacity = -(-tau).exp_m1();
    // Source function where there is extinction.
    let (mut low, mut high) = (f64::INFINITY, 0.0f64);
    for i in 0..s.len() {
        if s[i] > 0.0 {
            low = low.min(j[i] / s[i]);
            high = high.max(j[i] / s[i]);
        } else if j[i] > 0.0 {
            high = f64::INFINITY;
        }
    }
    // (Where extinction vanishes before emission does, the source function has no end.)
    if high.is_finite() && high - low <= 16.0 * f64::EPSILON * high {
        // Emission proportional to extinction: only the total depth matters.
        let radiance = high * opacity;
        let radiance_error = high * (-tau).exp() * tau_error + noise * radiance;
        return Slice { tau, tau_error, radiance, radiance_error, noisy, ..Slice::default() };
    }
    if tau <= 6.0 {
        // The mean source under these weights makes a constant source exact, and with it whatever j has in common with σ.
        let source = q_seen / q_absorbed;
        let (radiance, source) = if q_absorbed > 0.0 && source.is_finite() && tau > 0.0 {
            (source * opacity, source)
        } else {
            (q_seen, 0.0)
        };
        let rest: Nodes = std::array::from_fn(|i| (j[i] - source * s[i]) * e[i]);
        let rest_decay = Decay::above(&rule.coefficients(&rest), unknown);
        let rest_size = h * rule.mean(&rest.map(f64::abs));
        noisy &= rest_decay.last <= (1e-9 * j_max).max(4.0 * unknown);
        let inside = h * decay.interpolation();
        let radiance_error =
            h * rest_decay.quadrature() + rest_size * inside + source * (-tau).exp() * tau_error + noise * radiance;
        return Slice { tau, tau_error, radiance, radiance_error, noisy, ..Slice::default() };
    }
    // Optically thick: only the range of the source is certain until the panel has been divided.
    let source = if q_absorbed > 1e-3 { (q_seen / q_absorbed).clamp(low, high) } else { j[0] / s[0] };
    let most = h * j_max;
    let radiance = if source.is_finite() { (source * opacity).min(most) } else { most };
    let radiance_error = (high - low).min(most) + noise * radiance;
    Slice { tau, tau_error, radiance, radiance_error, ..Slice::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solve(h: f64, s: &Nodes, j: &Nodes) -> Slice {
        solve_noisy(h, s, j, 0.0)
    }

    fn nodes(f: impl Fn(f64) -> f64) -> Nodes {
        RULE.x.map(f)
    }

    #[test]
    fn extinction_that_vanishes_before_emission_leaves_numbers() {
        let steep: Nodes = std::array::from_fn(|i| 10f64.powf(-300.0 - 3.5 * i as f64));
        let glow = steep.map(|x| x * 1e4);
        for (s, j) in [(steep, glow), (steep.map(|x| x * 1e-8), glow), (steep, steep.map(|x| x * 1e8))] {
            let slice = solve_noisy(2.0, &s, &j, 0.0);
            assert!(slice.radiance.is_finite() && slice.radiance >= 0.0, "{slice:?}");
            assert!(slice.radiance_error.is_finite(), "{slice:?}");
        }
    }

    #[test]
    fn constants_are_exact_from_nothing_to_1e30() {
        for exponent in -30..=30 {
            let sigma = 10f64.powi(exponent);
            let slice = solve(2.0, &[sigma; 8], &[3.0; 8]);
            assert_eq!(slice.tau, 2.0 * sigma);
            let exact = 3.0 / sigma * -(-2.0 * sigma).exp_m1();
            assert!((slice.radiance / exact - 1.0).abs() < 1e-15, "{sigma}");
            assert!(slice.exact);
        }
        assert_eq!(solve(2.0, &[0.0; 8], &[3.0; 8]).radiance, 6.0);
        assert_eq!(constant(f64::INFINITY, 2.0, 3.0).radiance, 1.5);
        assert_eq!(constant(f64::INFINITY, 0.0, 0.0).tau, 0.0);
    }

    #[test]
    fn proportional_emission_sees_only_depth() {
        let slice = solve(1.0, &nodes(|x| 1e9 * x), &nodes(|x| 3e9 * x));
        assert!((slice.radiance - 3.0).abs() < 1e-14);
    }

    #[test]
    fn smooth_panels_are_within_their_errors() {
        // σ = a + b x, j = c + d x: against a fine composite rule.
        for (a, b, c, d) in [(0.1, 0.3, 1.0, 2.0), (2.0, 3.0, 1.0, -1.0), (0.0, 5.0, 1.0, 0.0), (0.0, 1e-9, 1.0, 1.0)] {
            let slice = solve(1.0, &nodes(|x| a + b * x), &nodes(|x| c + d * x));
            let n = 400_000;
            let exact: f64 = (0..n)
                .map(|i| (f64::from(i) + 0.5) / f64::from(n))
                .map(|x| (c + d * x) * (-(a * x + 0.5 * b * x * x)).exp())
                .sum::<f64>()
                / f64::from(n);
            let error = (slice.radiance - exact).abs();
            assert!(error <= slice.radiance_error + 1e-11, "{a} {b} {c} {d}: {error} > {}", slice.radiance_error);
            assert!(slice.radiance_error < 1e-3 * exact);
        }
    }

    #[test]
    fn thick_panels_admit_what_they_do_not_know() {
        let slice = solve(1.0, &[100.0; 8], &nodes(|x| 100.0 * (1.0 + x)));
        let exact = 1.01; // S(0) + S′/σ
        assert!((slice.radiance - exact).abs() <= slice.radiance_error);
    }
}
