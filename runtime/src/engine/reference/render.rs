//! Whole pictures and lists of pixels on all cores.

use super::splats::view::Projected;
use super::{Options, RayResult, Reference};
use crate::frame::Camera;
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Results of some pixels. Each list has `bands` numbers per pixel, pixels in the order that was asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pixels {
    /// Mean radiance over the samples of the pixel, in lx.
    pub radiance: Vec<f64>,
    /// Mean transmittance.
    pub transmittance: Vec<f64>,
    /// Mean of the errors of the radiance.
    pub error: Vec<f64>,
    /// As much of that as is rounding.
    pub rounding: Vec<f64>,
    /// Field evaluations in all.
    pub evaluations: u64,
    /// Rays that stopped at `max_evaluations`.
    pub incomplete: u64,
}

/// A whole picture, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width and height.
    pub size: [u32; 2],
    /// Numbers per pixel.
    pub bands: usize,
    /// Every pixel.
    pub pixels: Pixels,
}

impl<V: Voxels + ?Sized> Reference<'_, V> {
    /// Draws a picture on all cores: the mean over `offsets` (positions inside a pixel) of the rays of `camera`.
    /// `progress` is called with the share that is done, from any thread, in no particular order.
    ///
    /// # Errors
    /// Those of [`Reference::trace`]; the first one in reading order.
    pub fn render(
        &self,
        camera: &Camera,
        offsets: &[[f64; 2]],
        options: &Options,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Picture, Diagnostic> {
        let [w, h] = camera.size;
        // Runs of pixels, short enough that cores finish together.
        const RUN: u64 = 64;
        let all = u64::from(w) * u64::from(h);
        let runs = all.div_ceil(RUN);
        let seen = self.project(camera);
        let done = AtomicU64::new(0);
        let failed = AtomicU64::new(u64::MAX);
        let parts: Vec<Result<Pixels, Diagnostic>> = (0..runs)
            .into_par_iter()
            .map_init(
                || self.worker(),
                |worker, run| {
                    // After an error only earlier runs matter, for the first error in reading order.
                    if failed.load(Ordering::Relaxed) < run {
                        return Ok(Pixels::default());
                    }
                    let pixels = (run * RUN..(run * RUN + RUN).min(all))
                        .map(|i| [(i % u64::from(w)) as u32, (i / u64::from(w)) as u32]);
                    let result = self.some(worker, (camera, seen.as_ref()), pixels, offsets, options);
                    if result.is_err() {
                        failed.fetch_min(run, Ordering::Relaxed);
                    }
                    let count = done.fetch_add(1, Ordering::Relaxed) + 1;
                    progress(count as f64 / runs as f64);
                    result
                },
            )
            .collect();
        Ok(Picture { size: camera.size, bands: self.bands, pixels: join(parts)? })
    }

    /// Draws some pixels on all cores; see [`Reference::render`].
    ///
    /// # Errors
    /// Those of [`Reference::trace`].
    pub fn pixels(
        &self,
        camera: &Camera,
        pixels: &[[u32; 2]],
        offsets: &[[f64; 2]],
        options: &Options,
    ) -> Result<Pixels, Diagnostic> {
        let seen = self.project(camera);
        let eye = (camera, seen.as_ref());
        let parts = pixels
            .par_iter()
            .map_init(|| self.worker(), |worker, p| self.some(worker, eye, [*p].into_iter(), offsets, options))
            .collect();
        join(parts)
    }

    /// Traces rays (origins in units of length, directions of any length) on all cores.
    ///
    /// # Errors
    /// Those of [`Reference::trace`].
    pub fn rays(&self, rays: &[([f64; 3], [f64; 3])], options: &Options) -> Result<Vec<RayResult>, Diagnostic> {
        let one = |worker: &mut _, ray: &([f64; 3], [f64; 3])| self.trace_with(worker, *ray, None, options);
        let all: Vec<_> = rays.par_iter().map_init(|| self.worker(), one).collect();
        all.into_iter().collect()
    }

    fn some(
        &self,
        worker: &mut super::Worker<'_, V>,
        (camera, seen): (&Camera, Option<&Projected>),
        pixels: impl Iterator<Item = [u32; 2]>,
        offsets: &[[f64; 2]],
        options: &Options,
    ) -> Result<Pixels, Diagnostic> {
        let mut out = Pixels::default();
        let share = 1.0 / offsets.len().max(1) as f64;
        for [x, y] in pixels {
            let first = out.radiance.len();
            for list in [&mut out.radiance, &mut out.transmittance, &mut out.error, &mut out.rounding] {
                list.resize(first + self.bands, 0.0);
            }
            for [dx, dy] in offsets {
                let at = [f64::from(x) + dx, f64::from(y) + dy];
                let pixel = seen.map(|seen| (seen, at));
                let result = self.trace_with(worker, camera.ray(at[0], at[1]), pixel, options)?;
                for b in 0..self.bands {
                    out.radiance[first + b] += share * result.radiance[b];
                    out.transmittance[first + b] += share * result.transmittance[b];
                    out.error[first + b] += share * result.error[b];
                    out.rounding[first + b] += share * result.rounding[b];
                }
                out.evaluations += result.evaluations;
                out.incomplete += u64::from(!result.complete);
            }
        }
        Ok(out)
    }
}

fn join(parts: Vec<Result<Pixels, Diagnostic>>) -> Result<Pixels, Diagnostic> {
    let mut out = Pixels::default();
    for part in parts {
        let part = part?;
        out.radiance.extend(part.radiance);
        out.transmittance.extend(part.transmittance);
        out.error.extend(part.error);
        out.rounding.extend(part.rounding);
        out.evaluations += part.evaluations;
        out.incomplete += part.incomplete;
    }
    Ok(out)
}
