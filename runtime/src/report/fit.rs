//! Slopes on log-log axes, and the front of pictures that nothing beats.

use super::Series;

/// A straight line on log-log axes: error ∝ quantity^value.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Slope {
    /// The exponent.
    pub value: f64,
    /// Share of the variance that the line explains.
    pub r2: f64,
    /// Rows that it rests on.
    pub rows: u32,
    /// ln of the error where ln of the quantity is 0.
    pub offset: f64,
}

impl Slope {
    /// The fitted error at a value of the quantity.
    #[must_use]
    pub fn at(&self, quantity: f64) -> f64 {
        (self.offset + self.value * quantity.ln()).exp()
    }
}

/// Least squares through the logarithms of points (quantity, error), both above 0; nothing for fewer than three.
pub(super) fn fit(points: &[(f64, f64)]) -> Option<Slope> {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    if logs.len() < 3 || logs.iter().any(|(x, y)| !x.is_finite() || !y.is_finite()) {
        return None;
    }
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |f: &dyn Fn(f64, f64) -> f64| logs.iter().map(|(x, y)| f(x - mx, y - my)).sum::<f64>();
    let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
    if xx <= 0.0 {
        return None;
    }
    let value = xy / xx;
    let r2 = if yy > 0.0 { xy * xy / (xx * yy) } else { 1.0 };
    Some(Slope { value, r2, rows: logs.len() as u32, offset: my - value * mx })
}

/// Marks each row that has no rival with both less error and less time to draw.
pub(super) fn mark_pareto(series: &mut [Series]) {
    let all: Vec<(f64, f64)> = series.iter().flat_map(|s| &s.rows).map(|row| (row.draw_ms, row.error.rms)).collect();
    let beaten = |(time, error): (f64, f64)| {
        all.iter().any(|(t, e)| *t <= time && *e <= error && (*t < time || *e < error)) || !error.is_finite()
    };
    for row in series.iter_mut().flat_map(|s| &mut s.rows) {
        row.pareto = !beaten((row.draw_ms, row.error.rms));
    }
}

#[cfg(test)]
mod tests {
    use super::fit;

    #[test]
    fn a_power_law_is_found_with_its_exponent() {
        let points: Vec<(f64, f64)> = [4.0, 8.0, 16.0, 32.0].map(|n: f64| (n, 3.0 * n.powi(-2))).to_vec();
        let slope = fit(&points).expect("four points");
        assert!((slope.value + 2.0).abs() < 1e-12 && (slope.r2 - 1.0).abs() < 1e-12, "{slope:?}");
        assert!((slope.at(64.0) - 3.0 / 4096.0).abs() < 1e-12);
        assert_eq!(slope.rows, 4);
    }

    #[test]
    fn too_few_or_impossible_points_have_no_slope() {
        assert_eq!(fit(&[(1.0, 1.0), (2.0, 0.5)]), None);
        assert_eq!(fit(&[(1.0, 1.0), (2.0, 0.0), (4.0, 0.1)]), None);
        assert_eq!(fit(&[(2.0, 1.0), (2.0, 0.5), (2.0, 0.1)]), None);
    }
}
