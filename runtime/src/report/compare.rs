//! One picture beside the reference picture.

use super::Comparison;
use super::truth::Truth;
use crate::frame::{Drawing, Origins, difference as apart};
use crate::image::metric::{PIXELS_PER_DEGREE, flip};

/// Differences in lx over pixels off edges where the reference is known, all bands.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub struct Errors {
    /// How many pixels.
    pub pixels: u32,
    /// The largest.
    pub max: f64,
    /// The root of the mean square.
    pub rms: f64,
    /// The mean.
    pub mean: f64,
    /// The largest as a multiple of what the scene's `accuracy` allows at its pixel.
    pub share: f64,
}

/// Differences in lx over pixels on edges where the reference is known.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub struct Edges {
    /// How many pixels.
    pub pixels: u32,
    /// The largest.
    pub max: f64,
}

/// What the engine said about its own picture.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Predicted {
    /// `bound`, `estimate` or `standard-error`.
    pub kind: &'static str,
    /// The largest, in lx.
    pub max: f64,
    /// The largest as a multiple of what the scene's `accuracy` allows at its pixel.
    pub share: f64,
    /// Where it comes from, where the backend tells.
    pub origins: Option<Origins>,
    /// Pixels off edges whose measured error is larger than what was said of them, the error of the reference and the
    /// rounding of a stored f32 granted; three standard errors count as said.
    pub beyond: u32,
    /// The median over pixels with a measured error of what was said, as a multiple of what was measured.
    pub median_ratio: Option<f64>,
}

impl Predicted {
    /// Whether every compared pixel is as good as was said. Of standard errors three are exceeded once in 370 pixels, and
    /// they are themselves estimated: one pixel in fifty may be.
    #[must_use]
    pub fn held(&self, pixels: u32) -> bool {
        match self.kind {
            "standard-error" => u64::from(self.beyond) * 50 <= u64::from(pixels),
            _ => self.beyond == 0,
        }
    }
}

/// Rounding to the nearest f32.
const STORED: f64 = f32::EPSILON as f64 / 2.0;

/// Everything that one comparison tells.
#[derive(Clone, Debug)]
pub(super) struct Compared {
    pub(super) error: Errors,
    pub(super) edges: Edges,
    pub(super) flip: Option<f64>,
    pub(super) predicted: Option<Predicted>,
    pub(super) comparison: Comparison,
}

pub(super) fn compare(drawing: &Drawing, truth: &Truth, edges: &[bool]) -> Compared {
    let bands = truth.bands;
    let mut difference = vec![f32::NAN; truth.known.len()];
    let (mut error, mut on_edges) = (Errors::default(), Edges::default());
    let (mut squares, mut sum, mut beyond, mut ratios) = (0.0, 0.0, 0, vec![]);
    let said_of = |pixel: usize| drawing.errors.get(pixel).map(|e| f64::from(*e));
    for (pixel, drawn) in drawing.picture.radiance().chunks_exact(bands).enumerate() {
        if !truth.known[pixel] {
            continue;
        }
        let exact = &truth.radiance[pixel * bands..][..bands];
        let list = drawn.iter().zip(exact).map(|(a, b)| apart(f64::from(*a), *b));
        let (mut most, mut brightest) = (0.0f64, 0.0f64);
        for (d, exact) in list.zip(exact) {
            most = most.max(d);
            brightest = brightest.max(exact.abs());
            if !edges[pixel] {
                squares += d * d;
                sum += d;
            }
        }
        difference[pixel] = most as f32;
        if edges[pixel] {
            on_edges.pixels += 1;
            on_edges.max = on_edges.max.max(most);
            continue;
        }
        error.pixels += 1;
        error.max = error.max.max(most);
        error.share = error.share.max(most / (truth.accuracy * truth.white.max(brightest)));
        if let Some(said) = said_of(pixel) {
            let times = if drawing.error_kind == "standard-error" { 3.0 } else { 1.0 };
            // Errors add where they are bounds, their squares where they are standard errors.
            let own = truth.error[pixel];
            let granted = if times > 1.0 { times * said.hypot(own) } else { said + own };
            beyond += u32::from(!(most <= granted + brightest * STORED));
            if most > own {
                ratios.push(said / most);
            }
        }
    }
    let count = (f64::from(error.pixels) * bands as f64).max(1.0);
    error.rms = (squares / count).sqrt();
    error.mean = sum / count;
    ratios.sort_by(f64::total_cmp);
    let predicted = drawing.predicted.map(|(max, _)| Predicted {
        kind: drawing.error_kind,
        max,
        share: share_of(drawing, truth),
        origins: drawing.origins,
        beyond,
        median_ratio: ratios.get(ratios.len() / 2).copied(),
    });
    let shown = drawing.picture.shown(&truth.display);
    let flip =
        truth.is_whole().then(|| flip(&truth.shown(&truth.display), &shown, PIXELS_PER_DEGREE)).and_then(Result::ok);
    let flip = flip.map(|map| map.iter().map(|v| f64::from(*v)).sum::<f64>() / map.len().max(1) as f64);
    Compared { error, edges: on_edges, flip, predicted, comparison: Comparison { shown, difference } }
}

/// What was said of the worst pixel, as a multiple of what the scene's own accuracy allows there.
fn share_of(drawing: &Drawing, truth: &Truth) -> f64 {
    let pixels = drawing.picture.radiance().chunks_exact(truth.bands).zip(&drawing.errors);
    let shares = pixels.map(|(drawn, said)| {
        let brightest = drawn.iter().copied().map(f64::from).fold(truth.white, f64::max);
        f64::from(*said) / (truth.accuracy * brightest)
    });
    shares.fold(0.0, f64::max)
}
