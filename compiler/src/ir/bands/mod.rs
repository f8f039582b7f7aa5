//! The bands of a picture: their wavelengths, how they become red, green and blue, and how red, green and blue become them.
//!
//! # Display
//! A band's number is relative to daylight: 1 lx in every band is the spectrum of the standard illuminant D65, the white of
//! sRGB. Each band stands for the wavelengths between 380 and 780 nm that are nearer to it than to the others, and its
//! weight in X, Y and Z is the integral of D65 times a colour matching function of the CIE 1931 2° observer over these
//! (tables in steps of 5 nm, linear between them). Fields are evaluated at the wavelength of the band alone: for
//! `spectral(n)` that is the midpoint rule on n equal intervals.
//!
//! # Colours as spectra
//! `rgb(r, g, b)` is r, g and b times three smooth spectra between 0 and 1 that add up to 1 (see `observer`), taken at the
//! wavelength of the band. Seen through the integrals above they would come back as the primaries of sRGB up to what the
//! quadrature is wrong by, so a 3×3 matrix behind XYZ, near 1 where there are many bands, brings them back exactly. White
//! stays white, since the three add up to 1. The matrix is used only where it does not amplify errors of single bands.

mod observer;

use observer::{COUNT, DAYLIGHT, FIRST, MATCHING, RED_AND_BLUE, STEP};
use std::ops::Range;

/// Luminance of linear sRGB (Rec. 709 primaries).
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// From linear sRGB to CIE XYZ with white at Y = 1, by the primaries of IEC 61966-2-1; rows.
pub const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0],
    [2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0],
    [1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0],
];

/// Wavelengths that can be seen, in nanometres.
const VISIBLE: [f64; 2] = [FIRST, FIRST + STEP * (COUNT - 1) as f64];

/// What the absolute weights of a channel may add up to before colours are given up: what a band is wrong by shows so many
/// times as much. Many bands have 2.
const AMPLIFICATION: f64 = 4.0;

/// How a picture's bands are shown.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum BandsKind {
    /// 680, 550, 440 nm shown as R, G, B.
    Rgb,
    /// One band at 550 nm, shown grey.
    Gray,
    /// Wavelengths as listed; three of them are shown as R, G, B, other counts through CIE XYZ.
    List,
    /// The midpoints of equal intervals of 380 to 780 nm, shown through CIE XYZ.
    Spectral,
}

/// The bands that every spectrum has.
#[derive(Clone, Debug, PartialEq)]
pub struct Bands {
    /// How they are shown.
    pub kind: BandsKind,
    /// Wavelength of each, in metres. In a lowered scene 1 to 4 of them; a spectrum node has this many components, or 1 when
    /// it is neutral.
    pub wavelengths: Vec<f64>,
}

impl Bands {
    /// The most bands of a picture: closer than the tables of sight are, more would say nothing new.
    pub const MOST: usize = 64;
    /// The most bands of one program: a value of the graph has four components.
    pub const TOGETHER: usize = 4;

    /// The midpoints of `n` equal intervals of 380 to 780 nm.
    #[must_use]
    pub fn spectral(n: u32) -> Self {
        let [low, high] = VISIBLE;
        let at = |i: u32| (low + (high - low) * (f64::from(i) + 0.5) / f64::from(n)) * 1e-9;
        Self { kind: BandsKind::Spectral, wavelengths: (0..n).map(at).collect() }
    }

    /// Number of bands.
    #[must_use]
    pub fn count(&self) -> u8 {
        self.wavelengths.len() as u8
    }

    /// Neighbouring bands by at most [`Self::TOGETHER`], as even as can be.
    #[must_use]
    pub fn groups(&self) -> Vec<Range<usize>> {
        let n = self.wavelengths.len();
        let groups = n.div_ceil(Self::TOGETHER);
        (0..groups).map(|i| n * i / groups..n * (i + 1) / groups).collect()
    }

    /// Some of the bands.
    #[must_use]
    pub fn part(&self, range: Range<usize>) -> Self {
        Self { kind: self.kind, wavelengths: self.wavelengths[range].to_vec() }
    }

    /// Whether a wavelength in metres can be seen.
    #[must_use]
    pub fn is_visible(wavelength: f64) -> bool {
        let nm = wavelength * 1e9;
        // The way through metres costs a bit.
        (VISIBLE[0] - 1e-6..=VISIBLE[1] + 1e-6).contains(&nm)
    }

    /// For each band, the parts that red, green and blue have in it: a spectrum `rgb(r, g, b)` is the sum of the three times
    /// these.
    #[must_use]
    pub fn resample(&self) -> Vec<[f64; 3]> {
        match self.wavelengths.len() {
            _ if self.kind == BandsKind::Gray => vec![LUMINANCE; self.wavelengths.len()],
            1 if self.kind == BandsKind::Spectral => vec![LUMINANCE],
            n if self.is_rgb() => (0..n).map(|i| std::array::from_fn(|c| f64::from(u8::from(c == i)))).collect(),
            _ => self.wavelengths.iter().map(|w| primaries(w * 1e9)).collect(),
        }
    }

    /// For each band, what a radiance of 1 lx in it adds to linear red, green and blue.
    #[must_use]
    pub fn display(&self) -> Vec<[f64; 3]> {
        match self.wavelengths.len() {
            n @ (0 | 1) => vec![[1.0; 3]; n],
            n if self.kind == BandsKind::Gray => vec![[1.0; 3]; n],
            _ if self.is_rgb() => self.resample(),
            _ => self.corrected().unwrap_or_else(|| self.plain()),
        }
    }

    /// Whether `rgb(r, g, b)` is displayed as it is. Where there is a single band nobody would expect it to.
    #[must_use]
    pub fn shows_colors(&self) -> bool {
        self.kind == BandsKind::Gray || self.wavelengths.len() < 2 || self.is_rgb() || self.corrected().is_some()
    }

    /// Bands that are red, green and blue.
    fn is_rgb(&self) -> bool {
        match self.kind {
            BandsKind::Rgb => true,
            BandsKind::List => self.wavelengths.len() == 3,
            BandsKind::Gray | BandsKind::Spectral => false,
        }
    }

    /// CIE XYZ in linear sRGB, white at 1, 1, 1.
    fn plain(&self) -> Vec<[f64; 3]> {
        let nm: Vec<f64> = self.wavelengths.iter().map(|m| m * 1e9).collect();
        let xyz = tristimulus(&nm);
        let flat: [f64; 3] = std::array::from_fn(|c| xyz.iter().map(|b| b[c]).sum());
        let white: [f64; 3] = std::array::from_fn(|c| XYZ_FROM_RGB[c].iter().sum());
        let rgb_from_xyz = inverse(&XYZ_FROM_RGB).unwrap_or_default();
        xyz.iter()
            .map(|band| {
                // A list that the eye cannot see in one of X, Y, Z weighs its bands alike there.
                let scaled = |c: usize| {
                    if flat[c] > 1e-9 { band[c] * white[c] / flat[c] } else { white[c] / nm.len() as f64 }
                };
                apply(&rgb_from_xyz, [scaled(0), scaled(1), scaled(2)])
            })
            .collect()
    }

    /// The same with the primaries at their places too, if that amplifies no errors.
    fn corrected(&self) -> Option<Vec<[f64; 3]>> {
        let (plain, parts) = (self.plain(), self.resample());
        let seen: [[f64; 3]; 3] = std::array::from_fn(|row| {
            std::array::from_fn(|column| plain.iter().zip(&parts).map(|(w, p)| w[row] * p[column]).sum())
        });
        let back = inverse(&seen)?;
        let weights: Vec<[f64; 3]> = plain.iter().map(|w| apply(&back, *w)).collect();
        let calm = (0..3).all(|c| weights.iter().map(|w| w[c].abs()).sum::<f64>() <= AMPLIFICATION);
        calm.then_some(weights)
    }
}

impl std::fmt::Display for Bands {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let nm: Vec<String> = self.wavelengths.iter().map(|w| format!("{} nm", nanometres(*w))).collect();
        f.write_str(&nm.join(", "))
    }
}

/// A wavelength in metres, in nanometres to a thousandth and without trailing zeros.
#[must_use]
pub fn nanometres(metres: f64) -> String {
    let text = format!("{:.3}", metres * 1e9);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// An entry of a table at a wavelength in nanometres: the index below, and the share of the one above.
fn place(nm: f64) -> (usize, f64) {
    let at = ((nm.clamp(VISIBLE[0], VISIBLE[1]) - FIRST) / STEP).min((COUNT - 1) as f64);
    let below = (at as usize).min(COUNT - 2);
    (below, at - below as f64)
}

/// How much of red, green and blue there is at a wavelength in nanometres; the sum is 1.
fn primaries(nm: f64) -> [f64; 3] {
    let (i, t) = place(nm);
    let [red, blue]: [f64; 2] =
        std::array::from_fn(|c| RED_AND_BLUE[i][c] + t * (RED_AND_BLUE[i + 1][c] - RED_AND_BLUE[i][c]));
    let green = 1.0 - red - blue;
    // Where there is none, rounding makes none.
    [red, if green < 1e-9 { 0.0 } else { green }, blue]
}

/// For each band, X, Y and Z of the daylight that it stands for; a band that cannot be seen stands for none.
fn tristimulus(nm: &[f64]) -> Vec<[f64; 3]> {
    let visible = |l: &f64| Bands::is_visible(l * 1e-9);
    nm.iter()
        .map(|l| {
            if !visible(l) {
                return [0.0; 3];
            }
            let others = || nm.iter().copied().filter(visible);
            let below = others().filter(|o| o < l).fold(f64::NEG_INFINITY, f64::max);
            let above = others().filter(|o| o > l).fold(f64::INFINITY, f64::min);
            let alike = others().filter(|o| o == l).count() as f64;
            let from = if below.is_finite() { (below + l) / 2.0 } else { VISIBLE[0] };
            let to = if above.is_finite() { (above + l) / 2.0 } else { VISIBLE[1] };
            std::array::from_fn(|c| (integral(c, to) - integral(c, from)) / alike)
        })
        .collect()
}

/// The integral of D65 times a colour matching function up to a wavelength in nanometres.
fn integral(channel: usize, nm: f64) -> f64 {
    let at = |i: usize| DAYLIGHT[i] * MATCHING[i][channel];
    let (last, t) = place(nm);
    let whole: f64 = (0..last).map(|i| 0.5 * (at(i) + at(i + 1))).sum();
    STEP * (whole + t * at(last) + 0.5 * t * t * (at(last + 1) - at(last)))
}

fn apply(rows: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    rows.map(|row| row.iter().zip(v).map(|(a, b)| a * b).sum())
}

/// By cofactors; `None` where there is no inverse to speak of.
fn inverse(m: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let minor = |r: usize, c: usize| {
        let ([r1, r2], [c1, c2]) = ([(r + 1) % 3, (r + 2) % 3], [(c + 1) % 3, (c + 2) % 3]);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
    (determinant.abs() > 1e-12).then(|| std::array::from_fn(|r| std::array::from_fn(|c| minor(c, r) / determinant)))
}

#[cfg(test)]
mod tests;
