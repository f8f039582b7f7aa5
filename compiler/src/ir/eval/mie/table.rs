//! A phase function as a table that is linear between its rows.
//!
//! The key is sin(θ/2) − cos(θ/2) = −√2 cos(θ/2 + 45°), from −1 straight on to 1 straight back. It is nearly even in θ (its
//! slope lies between ½ and √½), so that the forward peak and the glory are resolved as well as the rest, and it takes two
//! square roots of 1 − μ and 1 + μ, each accurate in f32 where it is small; an arc cosine is not.

use super::ensemble::Ensemble;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_4, PI, SQRT_2};

/// Most rows.
pub(super) const MOST_ROWS: usize = 1 << 14;
/// The relative error at which a table is good enough.
pub(super) const TOLERANCE: f64 = 1e-4;
/// Values below this are as good as nothing: errors are relative to no less.
const FLOOR: f64 = 1e-7;
/// Terms of series that the making of one table may sum.
const WORK: usize = 300_000_000;

/// Nodes and weights of Gauss and Legendre's rule on [−1, 1], the positive half.
const GAUSS: [(f64, f64); 2] =
    [(0.339_981_043_584_856_26, 0.652_145_154_862_546_1), (0.861_136_311_594_052_6, 0.347_854_845_137_453_9)];

/// Rows of keys from −1 to 1 with one value per band.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseTable {
    /// Ascending.
    pub keys: Vec<f64>,
    /// One list per row, one number per band. Of each band 2π ∫ p dμ = 1.
    pub values: Vec<Vec<f64>>,
    /// The largest relative difference to the exact functions between the rows, as far as it was looked for: at a quarter,
    /// half and three quarters of each.
    pub error: f64,
}

/// The key of a cosine.
#[must_use]
pub fn key_of_cosine(cosine: f64) -> f64 {
    let cosine = cosine.clamp(-1.0, 1.0);
    (0.5 * (1.0 - cosine)).sqrt() - (0.5 * (1.0 + cosine)).sqrt()
}

fn cosine_of_key(key: f64) -> f64 {
    (2.0 * ((-key / SQRT_2).clamp(-1.0, 1.0).acos() - FRAC_PI_4)).cos()
}

/// Two neighbouring rows, and the values at a quarter, half and three quarters between them.
struct Gap {
    error: f64,
    from: f64,
    to: f64,
    values: [Vec<f64>; 5],
}

impl PartialEq for Gap {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Gap {}
impl PartialOrd for Gap {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Gap {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.error.total_cmp(&other.error).then(self.from.total_cmp(&other.from))
    }
}

impl Gap {
    fn new(from: f64, to: f64, values: [Vec<f64>; 5]) -> Self {
        let mut error = 0.0_f64;
        for (i, t) in [(1, 0.25), (2, 0.5), (3, 0.75)] {
            for ((a, exact), b) in values[0].iter().zip(&values[i]).zip(&values[4]) {
                error = error.max((a + (b - a) * t - exact).abs() / exact.max(FLOOR));
            }
        }
        Self { error, from, to, values }
    }

    fn halves(self, value: impl Fn(f64) -> Vec<f64>) -> [Self; 2] {
        let Self { from, to, values: [a, b, c, d, e], .. } = self;
        let at = |t: f64| from + (to - from) * t;
        let middle = at(0.5);
        let left = [a, value(at(0.125)), b, value(at(0.375)), c.clone()];
        let right = [c, value(at(0.625)), d, value(at(0.875)), e];
        [Self::new(from, middle, left), Self::new(middle, to, right)]
    }
}

/// Places rows where the functions bend, until linear interpolation is within 1e-4 of each, or the rows are 16384.
#[must_use]
pub fn tabulate(bands: &[Ensemble]) -> PhaseTable {
    let value = |key: f64| -> Vec<f64> {
        let cosine = cosine_of_key(key);
        bands.iter().map(|band| band.phase(cosine)).collect()
    };
    let waves = bands.iter().map(Ensemble::half_waves).max().unwrap_or(0);
    let terms: usize = bands.iter().map(Ensemble::terms).sum();
    let most = (WORK / (4 * terms.max(1))).clamp(64, MOST_ROWS);
    // Two rows for each half wave of the finest structure there can be, so that none is overlooked.
    let start = (2 * waves).clamp(32, most / 2);
    let mut gaps = BinaryHeap::with_capacity(most);
    let at = |i: usize| -1.0 + 2.0 * i as f64 / start as f64;
    let mut last = value(-1.0);
    for i in 0..start {
        let (from, to) = (at(i), at(i + 1));
        let within = [0.25, 0.5, 0.75, 1.0].map(|t| value(from + (to - from) * t));
        let [b, c, d, e] = within;
        let a = std::mem::replace(&mut last, e.clone());
        gaps.push(Gap::new(from, to, [a, b, c, d, e]));
    }
    while gaps.len() + 1 < most && gaps.peek().is_some_and(|g| g.error > TOLERANCE) {
        let Some(worst) = gaps.pop() else { break };
        gaps.extend(worst.halves(value));
    }
    let error = gaps.peek().map_or(0.0, |g| g.error);
    let mut gaps = gaps.into_vec();
    gaps.sort_by(|a, b| a.from.total_cmp(&b.from));
    let mut keys = vec![-1.0];
    let mut values = vec![value(-1.0)];
    for gap in gaps {
        let [.., end] = gap.values;
        keys.push(gap.to);
        values.push(end);
    }
    let mut table = PhaseTable { keys, values, error };
    let integrals = table.integrals();
    for row in &mut table.values {
        row.iter_mut().zip(&integrals).for_each(|(v, i)| *v /= i);
    }
    table
}

impl PhaseTable {
    /// 2π ∫ p dμ of each band, of the table as it is interpolated: μ = −k√(2 − k²), so dμ/dk = −2(1 − k²)/√(2 − k²).
    #[must_use]
    pub fn integrals(&self) -> Vec<f64> {
        let bands = self.values.first().map_or(0, Vec::len);
        let mut sums = vec![0.0; bands];
        for (keys, rows) in self.keys.windows(2).zip(self.values.windows(2)) {
            let (low, high) = (keys[0], keys[1]);
            // Weights of the two rows by Gauss and Legendre's rule with four nodes. There is a closed form, but its
            // differences lose digits over short gaps; the weight is smooth.
            let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
            let mut weights = [0.0; 2];
            for (x, w) in GAUSS.into_iter().flat_map(|(x, w)| [(x, w), (-x, w)]) {
                let k = middle + half * x;
                let measure = w * half * 2.0 * (1.0 - k * k) / (2.0 - k * k).sqrt();
                weights[0] += measure * 0.5 * (1.0 - x);
                weights[1] += measure * 0.5 * (1.0 + x);
            }
            for ((sum, a), b) in sums.iter_mut().zip(&rows[0]).zip(&rows[1]) {
                *sum += 2.0 * PI * (weights[0] * a + weights[1] * b);
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_and_cosines_belong_together() {
        for i in 0..=1000 {
            let key = f64::from(i) / 500.0 - 1.0;
            let cosine = cosine_of_key(key);
            assert!((key_of_cosine(cosine) - key).abs() < 1e-12, "{key}");
            assert!((cosine + key * (2.0 - key * key).sqrt()).abs() < 1e-15);
        }
        assert_eq!((key_of_cosine(1.0), key_of_cosine(-1.0)), (-1.0, 1.0));
        assert_eq!(key_of_cosine(1.0 + 1e-15), key_of_cosine(1.0), "rounding beyond the end is no NaN");
    }

    #[test]
    fn integrals_are_those_of_the_interpolant() {
        // A constant: 4π. The key itself is odd in θ − 90°: 0. Its square is 1 − sin θ: 4π − 2π·π/2, for a fine table.
        let table = |f: &dyn Fn(f64) -> f64, rows: usize| {
            let keys: Vec<f64> = (0..rows).map(|i| 2.0 * i as f64 / (rows - 1) as f64 - 1.0).collect();
            let values = keys.iter().map(|k| vec![f(*k)]).collect();
            PhaseTable { keys, values, error: 0.0 }.integrals()[0]
        };
        assert!((table(&|_| 1.0, 65) - 4.0 * PI).abs() < 1e-12);
        assert!(table(&|k| k, 65).abs() < 1e-13);
        assert!((table(&|k| k * k, 20_001) - (4.0 * PI - PI * PI)).abs() < 1e-7);
    }
}
