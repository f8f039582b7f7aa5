//! Random numbers that depend on a seed, a ray and a sample alone, so that threads and order change nothing.

/// SplitMix64 (Steele, Lea and Flood 2014): a counter and a mixer of 64 bits.
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

fn mixed(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Random {
    /// The stream of one sample; `key` tells rays apart.
    pub(crate) fn new(seed: u64, key: u64, sample: u64) -> Self {
        Self(mixed(mixed(mixed(seed ^ STEP).wrapping_add(key)).wrapping_add(sample.wrapping_mul(STEP))))
    }

    /// Mixes numbers into a key.
    pub(crate) fn key(numbers: impl IntoIterator<Item = f64>) -> u64 {
        numbers.into_iter().fold(STEP, |key, x| mixed(key.wrapping_add(x.to_bits()).wrapping_add(STEP)))
    }

    /// Uniform in (0, 1), never at its ends.
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(STEP);
        ((mixed(self.0) >> 12) as f64 + 0.5) * 2f64.powi(-52)
    }

    /// Exponential with mean 1.
    pub(crate) fn depth(&mut self) -> f64 {
        -self.unit().ln()
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn moments() {
        let n = 200_000u32;
        let (mut sum, mut square, mut lag) = (0.0, 0.0, 0.0);
        let mut random = Random::new(7, 1, 2);
        let mut last = random.unit();
        for _ in 0..n {
            let x = random.unit();
            sum += x;
            square += x * x;
            lag += (x - 0.5) * (last - 0.5);
            last = x;
        }
        let n = f64::from(n);
        assert!((sum / n - 0.5).abs() < 5.0 * (1.0 / 12.0 / n).sqrt());
        assert!((square / n - 1.0 / 3.0).abs() < 5.0 * (4.0 / 45.0 / n).sqrt());
        assert!((lag / n).abs() < 5.0 / 12.0 / n.sqrt());
        let first = |seed, key, sample| Random::new(seed, key, sample).unit();
        assert_ne!(first(1, 2, 3), first(1, 3, 2));
        assert_eq!(first(1, 2, 3), first(1, 2, 3));
    }
}
