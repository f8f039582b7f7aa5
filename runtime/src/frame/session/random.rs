//! Pictures and probes by random paths on the GPU: batches until the standard error is small enough.

use super::Cause;
use super::canvas::{Canvas, draw_parts, trace_parts};
use super::{Drawing, ProbeSettings, RayAnswer, Session, Trouble};
use crate::frame::paths::{Batches, LEAST_BATCHES, TOGETHER, Tally};
use crate::frame::{Camera, FaultTally, Frame, Origins, Params, pack_ray, scene_bounds};
use crate::image::Picture;
use compiler::diagnostic::Diagnostic;
use compiler::program::{OutputKind, Program, StepRule, UniformSource};
use std::sync::Arc;

impl Session {
    /// Whether the picture, or some bands of it, are drawn by random paths.
    #[must_use]
    pub fn is_random(&self) -> bool {
        self.random_parts().contains(&true)
    }

    /// Which parts of the program are: where some bands scatter nothing, theirs are not.
    fn random_parts(&self) -> Vec<bool> {
        self.program.parts().map(|p| matches!(p.plan.steps, StepRule::Paths(_))).collect()
    }

    fn batches(&self) -> Batches {
        let samples = self.program.parts().find_map(|p| match p.plan.steps {
            StepRule::Paths(samples) => Some(samples),
            StepRule::Closed
            | StepRule::Fixed(_)
            | StepRule::Adaptive(_)
            | StepRule::Slabs { .. }
            | StepRule::Splats { .. } => None,
        });
        Batches::new(samples.unwrap_or(Some(1)))
    }

    /// Follows paths in batches until their standard error is within the accuracy at every pixel.
    pub(super) fn draw_paths(
        &mut self,
        params: &Params,
        time: f64,
        camera: &Camera,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Drawing, Trouble> {
        let program = Arc::clone(&self.program);
        let scene = &program.lowered;
        let mut frame = self.frame(params, time, Some(camera), scene_bounds(scene, &params.0, time));
        self.check_majorants(&frame)?;
        let batches = self.batches();
        let bands = program.places.len();
        let random = self.random_parts();
        let mut tally = Tally::new(camera.size[0] as usize * camera.size[1] as usize * bands);
        let mut look = LEAST_BATCHES;
        // What needs no paths is drawn once and is part of every batch.
        let mut still = Canvas::new(&program, camera.size, &frame);
        let drawn = draw_parts(&mut self.engine, &frame, &mut still, &|part| !random[part], &mut |_| {});
        let mut timing = drawn.map_err(|e| self.broken(&e))?;
        let exact = still.predicted.map_or(0.0, |p| p.0);
        let mut cut_off = 0.0f64;
        let mut faults = std::mem::take(&mut still.faults);
        let mut transmittance = None;
        // Paths of one dispatch: fewer if the driver turns out to end loops early.
        let mut together = batches.size.min(TOGETHER);
        let mut done_paths = 0;
        let mut batch = vec![0.0f32; camera.size[0] as usize * camera.size[1] as usize * bands];
        while tally.batches() < batches.most {
            frame.first_path = tally.batches() * batches.size + done_paths;
            frame.paths = together.min(batches.size - done_paths);
            let mut canvas = still.clone();
            let drawn = draw_parts(&mut self.engine, &frame, &mut canvas, &|part| random[part], &mut |_| {});
            timing = timing.and(drawn.map_err(|e| self.broken(&e))?);
            if canvas.faults.is_cut_short() {
                if frame.paths == 1 {
                    faults.join(canvas.faults);
                    break;
                }
                together = frame.paths / 2;
                continue;
            }
            faults.join(canvas.faults);
            let share = frame.paths as f32 / batches.size as f32;
            batch.iter_mut().zip(&canvas.radiance).for_each(|(sum, value)| *sum += share * value);
            done_paths += frame.paths;
            transmittance = transmittance.or(canvas.transmittance);
            cut_off = cut_off.max(canvas.predicted.map_or(0.0, |p| p.0));
            if done_paths < batches.size {
                continue;
            }
            done_paths = 0;
            tally.add(&batch);
            batch.fill(0.0);
            let mut done = f64::from(tally.batches()) / f64::from(batches.most);
            if batches.open && tally.batches() >= look {
                look = tally.batches() + batches.after(tally.batches());
                let (_, share) = tally.worst(bands, frame.accuracy, frame.white);
                if share <= 1.0 {
                    break;
                }
                // The error falls as 1/√n.
                done = done.max(1.0 / (share * share));
            }
            progress(done);
        }
        let worst = tally.worst(bands, frame.accuracy, frame.white);
        // Sums of so many paths in f32, whose roundings are of either sign (Higham 2002, §2.8).
        let brightest = tally.mean().iter().copied().fold(0.0, f64::max);
        let rounding = f64::from(batches.size).sqrt() * 0.5 * f64::from(f32::EPSILON) * brightest;
        let beside = exact + cut_off + rounding;
        let errors = (0..tally.mean().len() / bands).map(|i| {
            let standard = (0..bands).map(|b| tally.error(i * bands + b)).fold(0.0, f64::max);
            (standard + beside) as f32
        });
        let errors = errors.collect();
        let radiance = tally.mean().iter().map(|v| *v as f32).collect();
        Ok(Drawing {
            picture: Picture::new(camera.size, program.bands.clone(), radiance, transmittance)
                .map_err(|e| self.image(e))?,
            edges: vec![],
            predicted: Some((worst.0 + beside, worst.1)),
            // Parts of the program that need no paths are integrated.
            origins: Some(Origins { discretisation: exact, rounding, storage: cut_off, statistical: worst.0 }),
            errors,
            error_kind: "standard-error",
            paths: Some(u64::from(tally.batches()) * u64::from(batches.size)),
            drawn: None,
            slabs: None,
            splats: None,
            evaluations: None,
            milliseconds: timing.milliseconds,
            arranging: timing.arranging,
            clock: timing.clock.name(),
            dispatches: timing.dispatches,
            faults: faults.diagnostics(scene, "pixels"),
            params: params.clone(),
            time,
        })
    }

    /// Delta tracking needs a bound of every coefficient that has no closed form.
    fn check_majorants(&self, frame: &Frame) -> Result<(), Trouble> {
        self.program.parts().try_for_each(|part| self.check_part(part, frame))
    }

    fn check_part(&self, part: &Program, frame: &Frame) -> Result<(), Trouble> {
        let graph = &part.optimised.graph;
        let ranges = frame.majorants(graph);
        for field in &part.plan.uniforms.fields {
            let UniformSource::Majorant(node) = field.source else { continue };
            let high = ranges[node.0 as usize].high;
            if high.is_finite() && high < 1e30 {
                continue;
            }
            let what = graph.origin(node).name.clone().unwrap_or_else(|| "a coefficient".into());
            let diagnostic = Diagnostic::error("E0655", format!("no upper bound is known of `{what}`"))
                .note("random paths find collisions by a bound that the coefficient never exceeds")
                .hint("clamp it: `min(…, 100 /m)`, or give the medium a shape");
            // Of a sum that no line of the scene writes, the medium.
            let owner =
                part.lowered.media.iter().find(|m| what.split_once('.').is_some_and(|(name, _)| name == m.name));
            let origin = graph.origin(node).span.or(owner.and_then(|m| m.span));
            return Err(self.input(match origin {
                Some(span) => diagnostic.at(span, "this may be as large as can be"),
                None => diagnostic,
            }));
        }
        Ok(())
    }

    /// Random paths along each ray, until the standard error is within the accuracy relative to the radiance.
    pub(super) fn probe_paths(
        &mut self,
        params: &Params,
        rays: &[([f64; 3], [f64; 3])],
        settings: &ProbeSettings,
    ) -> Result<Vec<RayAnswer>, Trouble> {
        let program = Arc::clone(&self.program);
        let scene = &program.lowered;
        let bounds = scene_bounds(scene, &params.0, settings.time);
        let mut frame = self.frame(params, settings.time, None, bounds);
        self.check_majorants(&frame)?;
        let once: Vec<_> = rays.iter().map(|(o, d)| pack_ray(*o, *d, bounds)).collect();
        let bands = program.places.len();
        let batches = self.batches();
        let size = if batches.open { 256 } else { batches.size };
        let most = if batches.open { batches.most / 64 } else { batches.most };
        let mut tally = Tally::new(rays.len() * bands);
        let mut answers = vec![RayAnswer::blank(bands, "standard-error"); rays.len()];
        // What paths that were ended for their length might have brought to each ray, over all batches.
        let mut cut_off = vec![0.0f64; rays.len()];
        // Each ray is followed by several invocations, each a few paths.
        let mut together = size.min(TOGETHER);
        while tally.batches() < most {
            let copies = size.div_ceil(together);
            frame.paths = together;
            frame.first_path = tally.batches() * together;
            let packed: Vec<_> = (0..copies).flat_map(|_| once.iter().copied()).collect();
            let mut batch = vec![0.0f32; rays.len() * bands];
            let mut faults = FaultTally::default();
            let mut cut_now = vec![0.0f64; rays.len()];
            // Parts that need no paths find the same each time, which costs little here.
            let traced = trace_parts(&mut self.engine, &program, &frame, &packed, &mut |reader, number, record| {
                let ray = number % rays.len();
                for (band, value) in reader.bands(record, OutputKind::Radiance) {
                    batch[ray * bands + band] += value / copies as f32;
                }
                let cut = f64::from(reader.number(record, OutputKind::Error).unwrap_or(0.0));
                cut_now[ray] += cut / f64::from(copies);
                // Depths along the ray itself are found with the first paths.
                if frame.first_path == 0 {
                    reader.answer(record, &mut answers[ray]);
                }
                reader.fault(record, &mut faults);
            });
            traced.map_err(|e| self.broken(&e))?;
            if faults.is_cut_short() {
                if together == 1 || tally.batches() > 0 {
                    return Err(self.trouble(Cause::Machine, faults.diagnostics(scene, "rays")));
                }
                together /= 2;
                continue;
            }
            if !faults.is_empty() {
                return Err(self.trouble(Cause::Input, faults.diagnostics(scene, "rays")));
            }
            tally.add(&batch);
            cut_off.iter_mut().zip(&cut_now).for_each(|(sum, cut)| *sum += cut);
            let enough = batches.open && tally.batches() >= LEAST_BATCHES;
            if enough && tally.worst(bands, frame.accuracy, 0.0).1 <= 1.0 {
                break;
            }
        }
        let paths = u64::from(tally.batches()) * u64::from(size.div_ceil(together)) * u64::from(together);
        for (i, answer) in answers.iter_mut().enumerate() {
            answer.radiance = tally.mean()[i * bands..(i + 1) * bands].to_vec();
            let cut = cut_off[i] / f64::from(tally.batches());
            answer.error = (0..bands).map(|b| tally.error(i * bands + b) + cut).collect();
            answer.evaluations = paths;
        }
        Ok(answers)
    }
}
