//! The display transform: exposure, tone map, sRGB encoding.

use super::Picture;
use compiler::ir::Tonemap;
use rayon::prelude::*;

/// How radiance becomes what a screen shows: encode(tonemap(L / 1 lx · 2^exposure)), clamped to 0 … 1.
///
/// Tone maps work on each of R, G, B:
/// - `none`: x
/// - `reinhard`: x / (1 + x) (Reinhard et al. 2002, eq. 3)
/// - `aces`: x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14) (Narkowicz 2015, a fit to the ACES reference)
/// - `exposure`: 1 − e^(−x)
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Display {
    /// Stops; each doubles the brightness.
    pub exposure: f64,
    /// The curve that brings high radiance below 1.
    pub tonemap: Tonemap,
}

impl Default for Display {
    fn default() -> Self {
        Self { exposure: 0.0, tonemap: Tonemap::None }
    }
}

/// sRGB encoding of a linear value (IEC 61966-2-1).
#[must_use]
pub fn srgb_encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Inverse of [`srgb_encode`].
#[must_use]
pub fn srgb_decode(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

impl Display {
    /// One linear channel to its encoded value in 0 … 1; the argument is not NaN.
    fn channel(&self, linear: f64) -> f64 {
        // A finite gain, since 0 · ∞ is NaN; then below any overflow in the curves, and far above white in each of them.
        let x = (linear * self.exposure.clamp(-1000.0, 1000.0).exp2()).clamp(0.0, 1e60);
        let mapped = match self.tonemap {
            Tonemap::None => x,
            Tonemap::Reinhard => x / (1.0 + x),
            Tonemap::Aces => x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14),
            Tonemap::Exposure => -(-x).exp_m1(),
        };
        srgb_encode(mapped.clamp(0.0, 1.0)).clamp(0.0, 1.0)
    }
}

/// NaN cannot come out of an engine; if one does, it must be seen.
const MAGENTA: [f64; 3] = [1.0, 0.0, 1.0];

/// A picture as a screen shows it: sRGB-encoded red, green and blue in 0 … 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Row by row from the top.
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// Applies the display transform.
    #[must_use]
    pub fn shown(&self, display: &Display) -> Shown {
        let (pixels, _) = self.map_shown(display, |v| v as f32);
        Shown { width: self.width, height: self.height, pixels }
    }

    /// Applies the display transform and turns each channel into whatever is to be stored. Also counts pixels with a NaN.
    pub(super) fn map_shown<T: Send>(
        &self,
        display: &Display,
        store: impl Fn(f64) -> T + Sync,
    ) -> (Vec<[T; 3]>, usize) {
        let weights = self.bands.display();
        let pixels = self
            .radiance
            .par_chunks_exact(weights.len())
            .map(|pixel| {
                if pixel.iter().any(|v| v.is_nan()) {
                    return MAGENTA.map(&store);
                }
                let mut rgb = [0.0; 3];
                for (radiance, weight) in pixel.iter().zip(&weights) {
                    // Not ∞ times a weight of 0, which would be NaN.
                    let radiance = f64::from(radiance.clamp(f32::MIN, f32::MAX));
                    for (channel, weight) in rgb.iter_mut().zip(weight) {
                        *channel += radiance * weight;
                    }
                }
                rgb.map(|c| store(display.channel(c)))
            })
            .collect();
        (pixels, super::count_nan(self))
    }
}
