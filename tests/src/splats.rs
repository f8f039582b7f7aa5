//! Splats that tests make.

use runtime::data::splats::{Gaussian, Splats};
use std::sync::Arc;

/// A splat as tests write it.
#[derive(Clone, Debug)]
pub struct One {
    /// Metres.
    pub center: [f64; 3],
    /// w, x, y, z, of any length.
    pub rotation: [f64; 4],
    /// Metres.
    pub deviations: [f64; 3],
    /// 0 … 1
    pub opacity: f64,
    /// Red, green and blue of each.
    pub harmonics: Vec<f64>,
}

/// Numbers from 0 to 1 that look random.
pub fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1u64 << 31) as f64
    }
}

/// A ball of one encoded colour.
#[must_use]
pub fn ball(center: [f64; 3], deviation: f64, opacity: f64, color: [f64; 3]) -> One {
    let harmonics = color.map(|c| (c - 0.5) / 0.282_094_791_773_878_14).to_vec();
    One { center, rotation: [1.0, 0.0, 0.0, 0.0], deviations: [deviation; 3], opacity, harmonics }
}

fn strewn(count: usize, seed: u64, shape: impl Fn(&mut dyn FnMut() -> f64) -> [f64; 3]) -> Vec<One> {
    let mut x = noise(seed);
    let mut one = || One {
        center: [2.0 * x() - 1.0, 2.0 * x() - 1.0, 2.0 * x() - 1.0],
        rotation: [x() - 0.5, x() - 0.5, x() - 0.5, x() - 0.5],
        deviations: shape(&mut x),
        opacity: x(),
        harmonics: (0..48).map(|_| 1.2 * (x() - 0.5)).collect(),
    };
    (0..count).map(|_| one()).collect()
}

/// Balls, needles and discs in a cube of edge 2 m.
#[must_use]
pub fn some(count: usize, seed: u64) -> Vec<One> {
    strewn(count, seed, |x| std::array::from_fn(|_| 10f64.powf(-3.0 + 2.5 * x())))
}

/// The same without extremes.
#[must_use]
pub fn plump(count: usize, seed: u64) -> Vec<One> {
    strewn(count, seed, |x| [0.02 + 0.3 * x() * x(), 0.02 + 0.3 * x() * x(), 0.02 + 0.1 * x()])
}

/// As degenerate as splats can be, for a camera at (0.3, 0.5, −3) m that looks along z: one is at its near plane, and one in it.
#[must_use]
pub fn odd() -> Vec<One> {
    let mut list = some(12, 3);
    list[0].deviations = [0.0; 3];
    list[1].deviations = [0.5, 0.5, 0.0];
    list[2].deviations = [1e-30, 0.3, 1e-30];
    list[3].deviations = [1e30, 1e30, 1e30];
    list[4].deviations = [1e15, 1e-15, 1.0];
    list[5].opacity = 1.0;
    list[6].opacity = 0.0;
    list[7].center = [1e30, -1e30, 1e30];
    list[8].harmonics = vec![1e30; 48];
    list[9].deviations = [1e4, 1e-4, 1e-4];
    list[10].center = [0.3, 0.5, -2.799];
    list[11].center = [0.3, 0.5, -3.0];
    list
}

/// A file of them.
///
/// # Panics
/// If none of them can be kept.
#[must_use]
pub fn file(list: &[One], degree: u8, antialiased: bool) -> Arc<Splats> {
    let gaussians = list.iter().map(|o| Gaussian {
        center: o.center,
        rotation: o.rotation,
        deviations: o.deviations,
        opacity: o.opacity,
        harmonics: &o.harmonics,
    });
    Arc::new(Splats::new(degree, antialiased, gaussians).expect("splats").0)
}
