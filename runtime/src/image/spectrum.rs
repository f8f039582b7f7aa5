//! How bands become red, green and blue.

use compiler::ir::{Bands, BandsKind};
use glam::{DMat3, DVec3};

/// The CIE 1931 2° colour matching functions, as fitted by Wyman, Sloan and Shirley, "Simple Analytic Approximations to
/// the CIE XYZ Color Matching Functions", JCGT 2(2), 2013 (multi-lobe; within 1% of the tables).
fn matching(nm: f64) -> DVec3 {
    let lobe = |centre: f64, below: f64, above: f64| {
        let t = (nm - centre) * if nm < centre { below } else { above };
        (-0.5 * t * t).exp()
    };
    DVec3::new(
        0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.0490, 0.0382),
        0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322),
        1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725),
    )
}

/// From linear sRGB to CIE XYZ with white at Y = 1, by the primaries of IEC 61966-2-1.
pub(super) const XYZ_FROM_RGB: DMat3 = DMat3::from_cols_array(&[
    10135552.0 / 24577794.0,
    2613072.0 / 12288897.0,
    1425312.0 / 73733382.0,
    8788810.0 / 24577794.0,
    8788810.0 / 12288897.0,
    8788810.0 / 73733382.0,
    4435075.0 / 24577794.0,
    887015.0 / 12288897.0,
    70074185.0 / 73733382.0,
]);

/// For each band, what a radiance of 1 lx in it adds to linear red, green and blue.
///
/// RGB pictures and lists of three bands are R, G, B in their order; grey adds to all alike. Other lists go through CIE
/// XYZ: each band stands for the wavelengths nearest to it between 380 and 780 nm, and X, Y, Z are scaled so that a flat
/// spectrum of 1 lx is white in any list, as the language promises.
#[must_use]
pub fn display_weights(bands: &Bands) -> Vec<[f64; 3]> {
    let n = bands.wavelengths.len();
    let identity = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    match (bands.kind, n) {
        (BandsKind::Rgb, _) | (BandsKind::List, 3) => identity,
        (BandsKind::Gray, _) | (BandsKind::List, 0 | 1) => vec![[1.0; 3]; n],
        (BandsKind::List, _) => through_xyz(&bands.wavelengths.iter().map(|m| m * 1e9).collect::<Vec<_>>()),
    }
}

fn through_xyz(nm: &[f64]) -> Vec<[f64; 3]> {
    let widths = widths(nm);
    let bands: Vec<DVec3> = nm.iter().zip(&widths).map(|(nm, width)| matching(*nm) * *width).collect();
    let flat: DVec3 = bands.iter().sum();
    let white = XYZ_FROM_RGB * DVec3::ONE;
    let rgb_from_xyz = XYZ_FROM_RGB.inverse();
    bands
        .iter()
        .map(|xyz| {
            // A list that the eye cannot see in one of X, Y, Z weighs its bands alike there.
            let scaled =
                |c: usize| if flat[c] > 1e-9 { xyz[c] * white[c] / flat[c] } else { white[c] / nm.len() as f64 };
            (rgb_from_xyz * DVec3::new(scaled(0), scaled(1), scaled(2))).to_array()
        })
        .collect()
}

/// How much of 380 to 780 nm is nearer to each wavelength than to the others; at least a nanometre.
fn widths(nm: &[f64]) -> Vec<f64> {
    let clamped: Vec<f64> = nm.iter().map(|l| l.clamp(380.0, 780.0)).collect();
    clamped
        .iter()
        .map(|l| {
            let below = clamped.iter().filter(|o| *o < l).fold(f64::NEG_INFINITY, |a, b| a.max(*b));
            let above = clamped.iter().filter(|o| *o > l).fold(f64::INFINITY, |a, b| a.min(*b));
            let from = if below.is_finite() { (below + l) / 2.0 } else { 380.0 };
            let to = if above.is_finite() { (above + l) / 2.0 } else { 780.0 };
            let shared = clamped.iter().filter(|o| *o == l).count() as f64;
            ((to - from) / shared).max(1.0)
        })
        .collect()
}
