//! The spherical harmonics in which the colours of splats are given.

use super::coefficients;
use std::f64::consts::PI;

/// What a splat looks like from a direction: ½ plus the harmonics times their coefficients, not below 0; sRGB-encoded red, green
/// and blue. `direction` is a unit vector from the eye to the splat, in the space of the file; `coefficients` are those of
/// [`super::Splats::harmonics`].
#[must_use]
pub fn color(coefficients: &[f32], degree: u8, direction: [f64; 3]) -> [f64; 3] {
    let mut sum = [0.5; 3];
    for (basis, rgb) in harmonics(degree, direction).into_iter().zip(coefficients.chunks_exact(3)) {
        (0..3).for_each(|c| sum[c] += basis * f64::from(rgb[c]));
    }
    sum.map(|x: f64| x.max(0.0))
}

/// The real spherical harmonics up to a degree of at most 3, l by l and m from −l to l, normalised over the sphere, with the
/// signs of the Condon–Shortley phase: those of the code by Kerbl et al. (2023).
#[must_use]
pub fn harmonics(degree: u8, [x, y, z]: [f64; 3]) -> Vec<f64> {
    let mut all = Vec::with_capacity(coefficients(degree));
    all.push(0.5 * (1.0 / PI).sqrt());
    if degree >= 1 {
        let n = (0.75 / PI).sqrt();
        all.extend([-n * y, n * z, -n * x]);
    }
    if degree >= 2 {
        let (n, m) = ((15.0 / PI).sqrt() / 2.0, (5.0 / PI).sqrt() / 4.0);
        let level = 2.0 * z * z - x * x - y * y;
        all.extend([n * x * y, -n * y * z, m * level, -n * x * z, 0.5 * n * (x * x - y * y)]);
    }
    if degree >= 3 {
        let (a, b) = ((17.5 / PI).sqrt() / 4.0, (105.0 / PI).sqrt() / 2.0);
        let (c, d) = ((10.5 / PI).sqrt() / 4.0, (7.0 / PI).sqrt() / 4.0);
        let (side, level) = (4.0 * z * z - x * x - y * y, 2.0 * z * z - 3.0 * x * x - 3.0 * y * y);
        all.extend([
            -a * y * (3.0 * x * x - y * y),
            b * x * y * z,
            -c * y * side,
            d * z * level,
            -c * x * side,
            0.5 * b * z * (x * x - y * y),
            -a * x * (x * x - 3.0 * y * y),
        ]);
    }
    all
}
