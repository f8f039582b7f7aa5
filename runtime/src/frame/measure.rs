//! How far a picture is from the reference.

use super::session::Drawing;
use super::{Camera, sample_offsets, stratified_pixels};
use crate::engine::reference::{Goal, Options, Pixels, WholeReference};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;

/// Samples of a pixel that straddles an edge, where the picture says what share of the pixel each side has.
pub(crate) const COVERAGE: u32 = 256;

/// The measured error of a picture, in lx, over the pixels and bands that were compared. Pixels that straddle an edge are
/// counted apart: within rounding of the edge either side is right.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Measured {
    /// Pixels that were compared and do not straddle an edge.
    pub pixels: u32,
    /// The largest difference.
    pub max: f64,
    /// The root of the mean square.
    pub rms: f64,
    /// The largest difference as a multiple of what `accuracy` allows in its pixel.
    pub share: f64,
    /// The pixel of that one.
    pub worst: [u32; 2],
    /// Pixels that straddle an edge.
    pub straddling: u32,
    /// The largest difference among those; 0 where they are only counted.
    pub straddling_max: f64,
    /// The largest error of the reference itself.
    pub reference_error: f64,
}

/// Where the error of a picture comes from, as its engine knows it: of each the largest over the pixels and parts of the program, in lx.
/// They need not be of one pixel, so that their sum may exceed the largest error; it is never less.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub struct Origins {
    /// Of the rule that integrates: of steps, slabs, lattices, panels, and of pixels filled in from those around them.
    pub discretisation: f64,
    /// Of floating point: of places, of ends of segments, of sums, of blending in f32.
    pub rounding: f64,
    /// Of what is left out on purpose or kept with fewer digits than it was found with: what lies behind where a ray ends early, bricks
    /// that count as empty, tails of Gaussians, splats too faint for the list of a tile, paths ended for their length, blending in f16, f64 kept as f32.
    pub storage: f64,
    /// Of chance: the standard error of random paths.
    pub statistical: f64,
}

impl Origins {
    /// The larger of each.
    pub(crate) fn widen(&mut self, other: Self) {
        self.discretisation = self.discretisation.max(other.discretisation);
        self.rounding = self.rounding.max(other.rounding);
        self.storage = self.storage.max(other.storage);
        self.statistical = self.statistical.max(other.statistical);
    }
}

/// Rays per pixel that stand for the truth.
#[derive(Copy, Clone, Debug)]
pub(super) struct Samples {
    /// In pixels that do not straddle an edge.
    plain: u32,
    /// In those that do; none if they are only counted.
    edges: Option<u32>,
}

impl Samples {
    /// For a picture of `samples` rays per pixel whose edges are smoothed by area, or not.
    pub(super) fn new(samples: u32, by_area: bool) -> Self {
        Self { plain: samples, edges: Some(if by_area { COVERAGE } else { samples }) }
    }

    /// Pixels that straddle an edge are counted and not compared, which takes most of the time.
    pub(super) fn off_edges(self) -> Self {
        Self { edges: None, ..self }
    }
}

impl Measured {
    /// Whether every pixel that does not straddle an edge is within the scene's accuracy.
    #[must_use]
    pub fn within(&self) -> bool {
        self.share <= 1.0
    }

    /// Compares `spread.0` pixels chosen by the seed `spread.1`; `allowed` is (A, W) of `accuracy`.
    pub(super) fn of<V: Voxels + ?Sized>(
        reference: &WholeReference<'_, V>,
        camera: &Camera,
        drawing: &Drawing,
        samples: Samples,
        spread: (u32, u64),
        allowed: (f64, f64),
    ) -> Result<Self, Diagnostic> {
        let (accuracy, white) = allowed;
        let chosen = stratified_pixels(camera.size, spread.0, spread.1);
        // A hundred times better than what is checked is enough to check it.
        let rtol = (accuracy / 100.0).clamp(1e-12, 1e-3);
        let options = Options { rtol, atol: rtol * white, goal: Goal::Radiance, ..Options::default() };
        let straddles = |[x, y]: [u32; 2]| {
            let at = y as usize * camera.size[0] as usize + x as usize;
            drawing.edges.get(at).copied().unwrap_or(false)
        };
        let (edges, plain): (Vec<_>, Vec<_>) = chosen.into_iter().partition(|p| straddles(*p));
        let truth = reference.pixels(camera, &plain, &sample_offsets(samples.plain), &options)?;
        // An edge is a share of the pixel, which takes many rays to count and no great accuracy along each.
        let rtol = (accuracy / 10.0).clamp(1e-4, 1e-2);
        let rough = Options { rtol, atol: rtol * white, ..options };
        let at_edges = match samples.edges {
            Some(n) => reference.pixels(camera, &edges, &sample_offsets(n), &rough)?,
            None => Pixels::default(),
        };
        let bands = reference.bands();
        let mut found = Self {
            pixels: 0,
            max: 0.0,
            rms: 0.0,
            share: 0.0,
            worst: [0, 0],
            straddling: edges.len() as u32,
            straddling_max: 0.0,
            reference_error: truth.error.iter().copied().fold(0.0, f64::max),
        };
        let mut squares = 0.0;
        let differences = |[x, y]: [u32; 2], truth: &[f64]| -> Vec<f64> {
            let drawn = drawing.picture.pixel(x, y);
            drawn.iter().zip(truth).map(|(a, b)| difference(f64::from(*a), *b)).collect()
        };
        let largest = |list: &[f64]| list.iter().copied().fold(0.0, f64::max);
        for (pixel, truth) in edges.iter().zip(at_edges.radiance.chunks_exact(bands)) {
            found.straddling_max = found.straddling_max.max(largest(&differences(*pixel, truth)));
        }
        for (pixel, truth) in plain.iter().zip(truth.radiance.chunks_exact(bands)) {
            let list = differences(*pixel, truth);
            found.pixels += 1;
            found.max = found.max.max(largest(&list));
            let share = largest(&list) / (accuracy * white.max(largest(truth)));
            if share > found.share {
                (found.share, found.worst) = (share, *pixel);
            }
            squares += list.iter().map(|d| d * d).sum::<f64>();
        }
        found.rms = (squares / (f64::from(found.pixels) * bands as f64).max(1.0)).sqrt();
        Ok(found)
    }
}

/// A NaN is as wrong as can be; equal infinities agree.
pub(crate) fn difference(a: f64, b: f64) -> f64 {
    let d = (a - b).abs();
    if a == b {
        0.0
    } else if d.is_nan() {
        f64::INFINITY
    } else {
        d
    }
}

/// The largest error, and the largest as a multiple of what `accuracy` allows.
pub(super) fn worst(
    errors: impl Iterator<Item = f64>,
    radiance: impl Iterator<Item = f64>,
    accuracy: f64,
    white: f64,
) -> (f64, f64) {
    errors.zip(radiance).fold((0.0, 0.0), |(most, share): (f64, f64), (error, radiance)| {
        (most.max(error), share.max(error / (accuracy * white.max(radiance))))
    })
}
