//! Pictures and probes in slabs: more and more of them until more change nothing by more than the accuracy allows.
//!
//! The midpoint rule in a slab is of second order where fields are smooth and of first order at the creases of data. The
//! error of n slabs is therefore estimated from the picture of m < n as |Iₙ − Iₘ| / (n/m − 1), which is exact for the first
//! order and too large for the second.

use super::{Canvas, Drawing, ProbeSettings, RayAnswer, Session, Trouble};
use crate::engine::gpu::{Clock, Timing};
use crate::frame::bounds::media_boxes;
use crate::frame::{Camera, Eye, Params, Slabs, scene_bounds};
use compiler::program::StepRule;

/// Slabs that are tried first.
const FIRST: u32 = 32;
/// Most slabs there can be: their numbers pass through f32 beside the code of a fault.
const MOST: u32 = 65535;

/// How many slabs come next: as many as an error of second order asks for, twice to eight times as many as before.
fn next(count: u32, share: f64, most: u32) -> u32 {
    let factor = (1.1 * share.sqrt()).clamp(2.0, 8.0);
    ((f64::from(count) * factor) as u32).min(most)
}

fn together(a: Timing, b: Timing) -> Timing {
    Timing {
        milliseconds: a.milliseconds + b.milliseconds,
        clock: if a.clock == Clock::Gpu { b.clock } else { a.clock },
        dispatches: a.dispatches + b.dispatches,
    }
}

impl Session {
    /// Whether the picture is drawn in slabs.
    pub(super) fn is_sliced(&self) -> bool {
        matches!(self.program.plan.steps, StepRule::Slabs { .. })
    }

    /// How many slabs there are at first and at most, and whether that is all that is asked for.
    fn slabs(&self) -> (u32, u32) {
        let most = MOST.min(self.program.lowered.render.max_work).max(1);
        match self.program.plan.steps {
            StepRule::Slabs { count: Some(n), .. } => (n.min(most), n.min(most)),
            StepRule::Slabs { count: None, .. }
            | StepRule::Closed
            | StepRule::Fixed(_)
            | StepRule::Adaptive(_)
            | StepRule::Paths(_) => (FIRST.min(most), most),
        }
    }

    pub(super) fn draw_slabs(
        &mut self,
        params: &Params,
        time: f64,
        camera: &Camera,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Drawing, Trouble> {
        let scene = &self.program.lowered;
        let bounds = scene_bounds(scene, &params.0, time);
        let boxes = media_boxes(scene, &params.0, time);
        let bands = scene.bands.count() as usize;
        let eye = Eye::new(camera, bounds);
        let (mut count, most) = self.slabs();
        let asked = count == most;
        let mut before: Option<(u32, Canvas, Timing)> = None;
        loop {
            let mut frame = self.frame(params, time, Some(camera), bounds);
            frame.slabs = Slabs::of_view(&boxes, &eye, camera, count);
            let (mut canvas, mut timing) = self.canvas(&frame, progress)?;
            let Some((fewer, coarse, so_far)) = before.take() else {
                if asked {
                    // Only what was asked for: nothing tells how good it is but the comparison with the reference.
                    canvas.predicted = None;
                    let drawing = self.drawing(canvas, timing, params, time)?;
                    return Ok(Drawing { slabs: Some(count), ..drawing });
                }
                before = Some((count, canvas, timing));
                count = next(count, 0.0, most);
                continue;
            };
            timing = together(timing, so_far);
            let share = canvas.compare(&coarse, f64::from(count) / f64::from(fewer) - 1.0, bands);
            canvas.evaluations = canvas.evaluations.zip(coarse.evaluations).map(|(a, b)| a + b);
            if share <= 1.0 || count >= most || !share.is_finite() {
                let drawing = self.drawing(canvas, timing, params, time)?;
                return Ok(Drawing { slabs: Some(count), ..drawing });
            }
            before = Some((count, canvas, timing));
            count = next(count, share, most);
        }
    }

    pub(super) fn probe_slabs(
        &mut self,
        params: &Params,
        rays: &[([f64; 3], [f64; 3])],
        settings: &ProbeSettings,
    ) -> Result<Vec<RayAnswer>, Trouble> {
        let boxes = media_boxes(&self.program.lowered, &params.0, settings.time);
        let accuracy = self.accuracy();
        let (mut count, most) = self.slabs();
        let asked = count == most;
        let mut coarse: Option<(u32, Vec<RayAnswer>)> = None;
        loop {
            let slabs = Slabs::of_rays(&boxes, rays.len(), count);
            let mut answers = self.probe_gpu(params, rays, settings, slabs)?;
            let Some((fewer, before)) = coarse.take() else {
                if asked && most == 1 {
                    return Ok(answers);
                }
                coarse = Some((count, answers));
                // Half as many, drawn after, tell as much about the error as twice as many.
                count = if asked { count.div_ceil(2) } else { next(count, 0.0, most) };
                continue;
            };
            let ratio = f64::from(count.max(fewer)) / f64::from(count.min(fewer)) - 1.0;
            if asked {
                let (mut fine, rough) = (before, answers);
                compare(&mut fine, &rough, ratio, accuracy);
                return Ok(fine);
            }
            let share = compare(&mut answers, &before, ratio, accuracy);
            if share <= 1.0 || count >= most || !share.is_finite() {
                return Ok(answers);
            }
            coarse = Some((count, answers));
            count = next(count, share, most);
        }
    }
}

/// Adds the estimated error of answers with more slabs to them, adds up the evaluations, and gives the largest error as a
/// multiple of what is allowed: |ΔL| ≤ A·|L|, |ΔT| ≤ A, |Δτ| ≤ A·τ.
fn compare(fine: &mut [RayAnswer], rough: &[RayAnswer], ratio: f64, accuracy: f64) -> f64 {
    let mut worst = 0.0f64;
    for (fine, rough) in fine.iter_mut().zip(rough) {
        let off = |a: &[f64], b: &[f64]| -> Vec<f64> {
            let change = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() / ratio.max(1e-9) };
            a.iter().zip(b).map(change).collect()
        };
        let radiance = off(&fine.radiance, &rough.radiance);
        for (error, off) in fine.error.iter_mut().zip(&radiance) {
            *error += off;
        }
        let light = fine.error.iter().zip(&fine.radiance).map(|(e, l)| if *e == 0.0 { 0.0 } else { e / l.abs() });
        let clear = off(&fine.transmittance, &rough.transmittance);
        let depth = off(&fine.optical_depth, &rough.optical_depth);
        let depth = depth.iter().zip(&fine.optical_depth).map(|(e, d)| if *e == 0.0 { 0.0 } else { e / d });
        worst = light.chain(clear).chain(depth).fold(worst, f64::max);
        fine.evaluations += rough.evaluations;
    }
    worst / accuracy
}

impl Canvas {
    /// Estimates the error from a picture with fewer slabs; the largest, as a multiple of what is allowed.
    fn compare(&mut self, coarse: &Self, ratio: f64, bands: usize) -> f64 {
        let own = self.predicted.unwrap_or((0.0, 0.0));
        let (mut error, mut share) = (0.0f64, 0.0f64);
        for (fine, rough) in self.radiance.chunks_exact(bands).zip(coarse.radiance.chunks_exact(bands)) {
            let off = fine.iter().zip(rough).map(|(a, b)| f64::from((a - b).abs()) / ratio).fold(0.0, f64::max);
            let brightest = fine.iter().fold(0.0f32, |m, v| m.max(*v));
            error = error.max(off);
            share = share.max(off / (self.accuracy * self.white.max(f64::from(brightest))));
        }
        self.predicted = Some((error + own.0, share + own.1));
        share
    }
}
