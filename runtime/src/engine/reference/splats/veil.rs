//! Splats on a ray as thin layers, and runs of them with nothing between as one.
//!
//! A layer of colour c that covers α of what is behind it lets B become α·c + (1 − α)·B: of radiances for splats that are blended
//! linearly, of sRGB-encoded numbers for those that are blended as they were fitted,
//!
//! ```text
//! B → decode(α·c + (1 − α)·encode(B))
//! ```
//!
//! per band, with 1 lx as white. Media before and behind act on radiances in either case.

use super::super::compose::Panel;
use super::super::panel::Slice;
use super::super::trace::{BANDS, PerBand, Segment};
use crate::image::{srgb_decode, srgb_encode};

/// What a splat sends, per band.
#[derive(Copy, Clone, Debug)]
pub(in crate::engine::reference) enum Light {
    /// sRGB-encoded numbers.
    Encoded(PerBand),
    /// lx
    Linear(PerBand),
}

/// A splat on a ray.
#[derive(Copy, Clone, Debug)]
pub(in crate::engine::reference) struct Layer {
    pub(in crate::engine::reference) t: f64,
    pub(in crate::engine::reference) alpha: f64,
    pub(in crate::engine::reference) light: Light,
}

/// Layers that are blended as encoded numbers: E → color + left·E.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(in crate::engine::reference) struct Veil {
    color: PerBand,
    left: f64,
}

impl Veil {
    fn encoded(&self, behind: f64, band: usize) -> f64 {
        // What nothing is left of may be infinite.
        let rest = if self.left > 0.0 { self.left * srgb_encode(behind) } else { 0.0 };
        self.color[band] + rest
    }

    /// The radiance before it, given that behind it.
    pub(in crate::engine::reference) fn over(&self, behind: f64, band: usize) -> f64 {
        srgb_decode(self.encoded(behind, band))
    }

    /// How fast that grows with the radiance behind it.
    pub(in crate::engine::reference) fn slope(&self, behind: f64, band: usize) -> f64 {
        if self.left == 0.0 || !behind.is_finite() {
            return self.left;
        }
        let inner = if behind <= 0.003_130_8 { 12.92 } else { 1.055 / 2.4 * behind.powf(1.0 / 2.4 - 1.0) };
        let e = self.encoded(behind, band);
        let outer = if e <= 0.040_45 { 1.0 / 12.92 } else { 2.4 / 1.055 * ((e + 0.055) / 1.055).powf(1.4) };
        self.left * inner * outer
    }
}

/// A run of layers that are blended in one way, at the place of the first.
#[derive(Clone, Debug)]
struct Run {
    t: f64,
    encoded: bool,
    color: PerBand,
    left: f64,
    /// −log of what is left, which does not vanish with it.
    tau: f64,
}

impl Run {
    fn add(&mut self, layer: &Layer) {
        let (Light::Encoded(value) | Light::Linear(value)) = layer.light;
        for (sum, x) in self.color.iter_mut().zip(value) {
            *sum += self.left * layer.alpha * x;
        }
        self.left *= 1.0 - layer.alpha;
        self.tau -= (-layer.alpha).ln_1p();
    }

    fn panel(&self) -> Panel {
        let error = 64.0 * f64::EPSILON;
        let slice = |band: usize| {
            let color = self.color[band];
            let radiance = if self.encoded { srgb_decode(color) } else { color };
            Slice {
                tau: self.tau,
                tau_error: if self.tau.is_finite() { error * self.tau } else { 0.0 },
                radiance,
                radiance_error: error * radiance,
                exact: true,
                noisy: true,
                ..Slice::default()
            }
        };
        let veil = self.encoded.then_some(Veil { color: self.color, left: self.left });
        Panel { veil, ..Panel::new((self.t, 0.0), usize::MAX, std::array::from_fn(slice)) }
    }
}

/// Joins layers (from near to far, all before `reach`) with nothing between them, and cuts the segments of the ray at the
/// rest. Layers of less than `faint` inside media join the run before them; the second result is the sum of their α.
pub(in crate::engine::reference) fn place(
    layers: &[Layer],
    reach: f64,
    segments: &mut Vec<Segment>,
    faint: f64,
) -> (Vec<Panel>, f64) {
    let (mut runs, mut moved): (Vec<Run>, f64) = (vec![], 0.0);
    for layer in layers.iter().take_while(|l| l.t < reach) {
        let encoded = matches!(layer.light, Light::Encoded(_));
        let joins = runs.last_mut().filter(|r| r.encoded == encoded).filter(|r| {
            let clear = !segments.iter().any(|s| s.start < layer.t && s.end > r.t);
            if !clear && layer.alpha < faint {
                moved += layer.alpha;
            }
            clear || layer.alpha < faint
        });
        match joins {
            Some(run) => run.add(layer),
            None => {
                let mut run = Run { t: layer.t, encoded, color: [0.0; BANDS], left: 1.0, tau: 0.0 };
                run.add(layer);
                runs.push(run);
            }
        }
    }
    cut(segments, &runs);
    (runs.iter().map(Run::panel).collect(), moved)
}

/// Cuts segments where runs are.
fn cut(segments: &mut Vec<Segment>, runs: &[Run]) {
    if runs.is_empty() {
        return;
    }
    let old = std::mem::take(segments);
    for segment in old {
        let inside: Vec<f64> = runs.iter().map(|r| r.t).filter(|t| segment.start < *t && *t < segment.end).collect();
        let finite = if segment.end.is_finite() { segment.end } else { inside.last().copied().unwrap_or(0.0) };
        let whole = finite - segment.start;
        let mut start = segment.start;
        for end in inside.into_iter().chain([segment.end]) {
            if end > start {
                let share = if whole > 0.0 { ((end - start) / whole).min(1.0) } else { 1.0 };
                segments.push(Segment { start, end, share: segment.share * share, ..segment.clone() });
            }
            start = end;
        }
    }
}
