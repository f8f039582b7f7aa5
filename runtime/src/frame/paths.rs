//! Progressive drawing of random paths: batches of equal size, their mean, and the standard error of the mean.

/// Batches before a standard error is believed: with 32 it is itself known to 1/√62 = 13 %.
pub(super) const LEAST_BATCHES: u32 = 32;
/// Paths that one invocation follows at most: drivers limit how long a shader may run, some without a word.
pub(super) const TOGETHER: u32 = 8;
/// Paths of a pixel or ray when neither `samples` nor the accuracy ends it before.
pub(super) const MOST_PATHS: u32 = 1 << 20;

/// How many paths to follow, in which batches.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) struct Batches {
    /// Paths of one batch.
    pub(super) size: u32,
    /// Batches at most.
    pub(super) most: u32,
    /// Whether the accuracy ends it before.
    pub(super) open: bool,
}

impl Batches {
    /// For a fixed number of samples (rounded up to whole batches), or for as many as are needed.
    pub(super) fn new(samples: Option<u32>) -> Self {
        match samples {
            Some(n) => {
                let size = n.div_ceil(LEAST_BATCHES).max(1);
                Self { size, most: n.div_ceil(size).max(1), open: false }
            }
            None => Self { size: 4, most: MOST_PATHS / 4, open: true },
        }
    }

    /// Larger batches as the picture settles, so that the host is not asked for every few paths.
    pub(super) fn after(self, batches: u32) -> u32 {
        // Equal batches keep the standard error simple; only how often it is looked at grows.
        if self.open { (batches / 8).clamp(1, 64) } else { 1 }
    }
}

/// Mean and variance of every number of a picture over batches (Welford 1962).
#[derive(Clone, Debug)]
pub(super) struct Tally {
    batches: u32,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Tally {
    pub(super) fn new(count: usize) -> Self {
        Self { batches: 0, mean: vec![0.0; count], squares: vec![0.0; count] }
    }

    /// Adds the mean of one batch.
    pub(super) fn add(&mut self, batch: &[f32]) {
        self.batches += 1;
        let n = f64::from(self.batches);
        for ((mean, squares), value) in self.mean.iter_mut().zip(&mut self.squares).zip(batch) {
            let value = f64::from(*value);
            let off = value - *mean;
            *mean += off / n;
            *squares += off * (value - *mean);
        }
    }

    /// Batches so far.
    pub(super) fn batches(&self) -> u32 {
        self.batches
    }

    /// The means.
    pub(super) fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Standard error of mean number `i`; infinite after a single batch, which says nothing of it.
    pub(super) fn error(&self, i: usize) -> f64 {
        let n = f64::from(self.batches);
        if self.batches < 2 { f64::INFINITY } else { (self.squares[i] / (n * (n - 1.0))).sqrt() }
    }

    /// The largest standard error, and the largest as a multiple of what is allowed at its pixel of `bands` numbers.
    pub(super) fn worst(&self, bands: usize, accuracy: f64, white: f64) -> (f64, f64) {
        let mut most = (0.0f64, 0.0f64);
        for (pixel, means) in self.mean.chunks_exact(bands).enumerate() {
            let brightest = means.iter().copied().fold(white, f64::max);
            for band in 0..bands {
                let error = self.error(pixel * bands + band);
                most.0 = most.0.max(error);
                let share = if error == 0.0 { 0.0 } else { error / (accuracy * brightest) };
                most.1 = most.1.max(share);
            }
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tally_is_mean_and_standard_error() {
        let mut tally = Tally::new(2);
        assert!(tally.error(0).is_infinite());
        for batch in [[1.0, 5.0], [2.0, 5.0], [4.0, 5.0], [5.0, 5.0]] {
            tally.add(&batch);
        }
        assert_eq!(tally.mean(), [3.0, 5.0]);
        // Deviations 2, 1, 1, 2: variance of the mean 10 / (4 · 3).
        assert!((tally.error(0) - (10.0f64 / 12.0).sqrt()).abs() < 1e-15);
        assert_eq!(tally.error(1), 0.0);
        let (most, share) = tally.worst(2, 0.1, 1.0);
        assert!((most - (10.0f64 / 12.0).sqrt()).abs() < 1e-15);
        assert!((share - most / 0.5).abs() < 1e-12);
    }

    #[test]
    fn samples_come_in_at_least_as_many_paths_as_asked() {
        for n in [1, 5, 31, 32, 33, 64, 1000] {
            let b = Batches::new(Some(n));
            assert!(b.size * b.most >= n && b.size * (b.most - 1) < n, "{n}: {b:?}");
        }
    }
}
