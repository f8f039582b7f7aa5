//! A smooth positive function of the angle between few of its values: a cubic spline of its logarithm over a coordinate in
//! which the forward peak and the glory are as wide as everything else.

use std::f64::consts::PI;

/// θ ↦ ln(1 + Xθ) + 4θ − ½ ln(1 + X(π − θ)): steps of equal length are proportional to the angle beyond 1/X from straight on
/// and straight back, and even between.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) struct Warp(pub(super) f64);

impl Warp {
    pub(super) fn of(self, theta: f64) -> f64 {
        (self.0 * theta).ln_1p() + 4.0 * theta - 0.5 * (self.0 * (PI - theta)).ln_1p()
    }

    fn range(self) -> (f64, f64) {
        (self.of(0.0), self.of(PI))
    }

    /// Angles at `count` + 1 equal steps.
    pub(super) fn angles(self, count: usize) -> Vec<f64> {
        let (low, high) = self.range();
        let angle = |i: usize| {
            let wanted = low + (high - low) * i as f64 / count as f64;
            let (mut a, mut b) = (0.0, PI);
            for _ in 0..60 {
                let middle = 0.5 * (a + b);
                if self.of(middle) < wanted {
                    a = middle;
                } else {
                    b = middle;
                }
            }
            0.5 * (a + b)
        };
        (0..=count)
            .map(|i| match i {
                0 => 0.0,
                i if i == count => PI,
                i => angle(i),
            })
            .collect()
    }
}

/// The spline. Its slope is 0 at both ends, as that of every intensity is straight on and straight back.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spline {
    warp: Warp,
    step: f64,
    /// Logarithms, and second derivatives of the spline times step²/6.
    points: Vec<(f64, f64)>,
}

impl Spline {
    /// Through positive values at [`Warp::angles`], three or more.
    pub(super) fn through(warp: Warp, values: &[f64]) -> Self {
        let logs: Vec<f64> = values.iter().map(|v| v.max(f64::MIN_POSITIVE).ln()).collect();
        let last = logs.len() - 1;
        let (low, high) = warp.range();
        // Thomas' algorithm for c[i − 1] + 4c[i] + c[i + 1] = y[i − 1] − 2y[i] + y[i + 1], half of it at the ends.
        let (mut upper, mut right) = (vec![0.0; last + 1], vec![0.0; last + 1]);
        for i in 0..=last {
            let (lower, diagonal, bend) = match i {
                0 => (0.0, 2.0, logs[1] - logs[0]),
                i if i == last => (1.0, 2.0, logs[i - 1] - logs[i]),
                i => (1.0, 4.0, logs[i - 1] - 2.0 * logs[i] + logs[i + 1]),
            };
            let (before_upper, before_right) = if i == 0 { (0.0, 0.0) } else { (upper[i - 1], right[i - 1]) };
            let pivot = diagonal - lower * before_upper;
            upper[i] = if i == last { 0.0 } else { 1.0 / pivot };
            right[i] = (bend - lower * before_right) / pivot;
        }
        let mut points: Vec<(f64, f64)> = logs.iter().map(|y| (*y, 0.0)).collect();
        let mut next = 0.0;
        for i in (0..=last).rev() {
            next = right[i] - upper[i] * next;
            points[i].1 = next;
        }
        Self { warp, step: (high - low) / last as f64, points }
    }

    pub(super) fn at(&self, theta: f64) -> f64 {
        let place = (self.warp.of(theta) - self.warp.range().0) / self.step;
        let i = (place as usize).min(self.points.len() - 2);
        let t = place - i as f64;
        let s = 1.0 - t;
        let ((y0, c0), (y1, c1)) = (self.points[i], self.points[i + 1]);
        (s * y0 + t * y1 + (s * s * s - s) * c0 + (t * t * t - t) * c1).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A peak of Henyey and Greenstein's, and its likeness backwards.
    fn lobes(theta: f64) -> f64 {
        let lobe = |g: f64, mu: f64| (1.0 - g * g) / (1.0 + g * g - 2.0 * g * mu).powf(1.5);
        lobe(0.98, theta.cos()) + 0.02 * lobe(0.9, -theta.cos())
    }

    #[test]
    fn splines_converge_with_the_fourth_power() {
        let warp = Warp(100.0);
        let error = |count: usize| {
            let values: Vec<f64> = warp.angles(count).into_iter().map(lobes).collect();
            let spline = Spline::through(warp, &values);
            let difference = |i: i32| {
                let theta = PI * f64::from(i) / 5000.0;
                (spline.at(theta) / lobes(theta) - 1.0).abs()
            };
            (0..=5000).map(difference).fold(0.0, f64::max)
        };
        let (coarse, fine) = (error(200), error(400));
        assert!(coarse < 1e-4 && fine > 0.0, "{coarse:e}");
        let order = (coarse / fine).log2();
        assert!((3.5..4.6).contains(&order), "{coarse:e} and {fine:e}: order {order}");
    }

    #[test]
    fn warped_angles_ascend_from_end_to_end() {
        for x in [1.0, 1e2, 1e4] {
            let angles = Warp(x).angles(333);
            assert_eq!((angles[0], angles[333]), (0.0, PI));
            assert!(angles.is_sorted_by(|a, b| a < b));
        }
    }
}
