//! Pictures and probes by random paths on the GPU: batches until the standard error is small enough.

use super::Cause;
use super::{Canvas, Drawing, Engine, ProbeSettings, RayAnswer, Reader, Session, Trouble, unbounded};
use crate::engine::gpu::Clock;
use crate::frame::paths::{Batches, LEAST_BATCHES, TOGETHER, Tally};
use crate::frame::{Camera, FaultTally, Frame, Params, pack_ray, scene_bounds};
use crate::image::Picture;
use compiler::diagnostic::{Diagnostic, Diagnostics};
use compiler::program::{OutputKind, StepRule, UniformSource};
use std::sync::Arc;

impl Session {
    /// Whether the picture is drawn by random paths.
    #[must_use]
    pub fn is_random(&self) -> bool {
        matches!(self.program.plan.steps, StepRule::Paths(_))
    }

    fn batches(&self) -> Batches {
        match self.program.plan.steps {
            StepRule::Paths(samples) => Batches::new(samples),
            StepRule::Closed
            | StepRule::Fixed(_)
            | StepRule::Adaptive(_)
            | StepRule::Slabs { .. }
            | StepRule::Splats { .. } => Batches::new(Some(1)),
        }
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
        let bands = scene.bands.count() as usize;
        let mut tally = Tally::new(camera.size[0] as usize * camera.size[1] as usize * bands);
        let (mut milliseconds, mut dispatches, mut clock, mut look) = (0.0, 0, Clock::Gpu, LEAST_BATCHES);
        let mut transmittance = None;
        let mut cut_off = 0.0f64;
        let mut faults = FaultTally::default();
        // Paths of one dispatch: fewer if the driver turns out to end loops early.
        let mut together = batches.size.min(TOGETHER);
        let mut done_paths = 0;
        let mut batch = vec![0.0f32; camera.size[0] as usize * camera.size[1] as usize * bands];
        while tally.batches() < batches.most {
            frame.first_path = tally.batches() * batches.size + done_paths;
            frame.paths = together.min(batches.size - done_paths);
            let mut canvas = Canvas::new(&program.plan, camera.size, bands, &frame);
            let Engine::Gpu(prepared) = &mut self.engine else {
                return Err(self.trouble(Cause::Machine, Diagnostics::default()));
            };
            let timing = prepared.draw(&frame, &mut |tile, records| canvas.take(tile, records));
            let timing = timing.map_err(|e| self.broken(&e))?;
            milliseconds += timing.milliseconds;
            dispatches += timing.dispatches;
            if timing.clock == Clock::Wall {
                clock = Clock::Wall;
            }
            if canvas.faults.is_cut_short() {
                if frame.paths == 1 {
                    faults = canvas.faults;
                    break;
                }
                together = frame.paths / 2;
                continue;
            }
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
        let radiance = tally.mean().iter().map(|v| *v as f32).collect();
        Ok(Drawing {
            picture: Picture::new(camera.size, scene.bands.clone(), radiance, transmittance)
                .map_err(|e| self.image(e))?,
            edges: vec![],
            predicted: Some((worst.0 + cut_off, worst.1)),
            error_kind: "standard-error",
            paths: Some(u64::from(tally.batches()) * u64::from(batches.size)),
            slabs: None,
            splats: None,
            evaluations: None,
            milliseconds,
            clock: match clock {
                Clock::Gpu => "gpu",
                Clock::Wall => "wall",
            },
            dispatches,
            faults: faults.diagnostics(scene, "pixels"),
            params: params.clone(),
            time,
        })
    }

    /// Delta tracking needs a bound of every coefficient that has no closed form.
    fn check_majorants(&self, frame: &Frame) -> Result<(), Trouble> {
        let graph = &self.program.optimised.graph;
        let ranges = frame.majorants(graph);
        for field in &self.program.plan.uniforms.fields {
            let UniformSource::Majorant(node) = field.source else { continue };
            let high = ranges[node.0 as usize].high;
            if high.is_finite() && high < 1e30 {
                continue;
            }
            let what = graph.origin(node).name.clone().unwrap_or_else(|| "a coefficient".into());
            let diagnostic = Diagnostic::error("E0655", format!("no upper bound is known of `{what}`"))
                .note("random paths find collisions by a bound that the coefficient never exceeds")
                .hint("clamp it: `min(…, 100 /m)`, or give the medium a shape");
            let origin = graph.origin(node).span;
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
        let bands = scene.bands.count() as usize;
        let reader = Reader::new(&program.plan, bands);
        let batches = self.batches();
        let size = if batches.open { 256 } else { batches.size };
        let most = if batches.open { batches.most / 64 } else { batches.most };
        let mut tally = Tally::new(rays.len() * bands);
        let (mut depth, mut clear, mut cut_off) = (vec![], vec![], 0.0f64);
        // Each ray is followed by several invocations, each a few paths.
        let mut together = size.min(TOGETHER);
        while tally.batches() < most {
            let copies = size.div_ceil(together);
            frame.paths = together;
            frame.first_path = tally.batches() * together;
            let packed: Vec<_> = (0..copies).flat_map(|_| once.iter().copied()).collect();
            let mut batch = vec![0.0f32; rays.len() * bands];
            let (mut faults, mut number) = (FaultTally::default(), 0);
            let (mut clear_now, mut depth_now) = (vec![], vec![]);
            let Engine::Gpu(prepared) = &mut self.engine else {
                return Err(self.trouble(Cause::Machine, Diagnostics::default()));
            };
            let traced = prepared.trace(&frame, &packed, &mut |_, records| {
                for record in records.chunks_exact(reader.stride) {
                    let own = number % rays.len() * bands;
                    for (sum, value) in
                        batch[own..own + bands].iter_mut().zip(reader.bands(record, OutputKind::Radiance))
                    {
                        *sum += value / copies as f32;
                    }
                    cut_off = cut_off.max(f64::from(reader.number(record, OutputKind::Error).unwrap_or(0.0)));
                    if number < rays.len() {
                        let list = |kind| reader.bands(record, kind).map(f64::from).collect::<Vec<f64>>();
                        clear_now.push(list(OutputKind::Transmittance));
                        depth_now.push(list(OutputKind::OpticalDepth));
                    }
                    reader.fault(record, &mut faults);
                    number += 1;
                }
            });
            traced.map_err(|e| self.broken(&e))?;
            if faults.is_cut_short() {
                if together == 1 || tally.batches() > 0 {
                    return Err(self.trouble(Cause::Machine, faults.diagnostics(scene, "rays")));
                }
                together /= 2;
                continue;
            }
            if tally.batches() == 0 {
                (clear, depth) = (clear_now, depth_now);
            }
            tally.add(&batch);
            let enough = batches.open && tally.batches() >= LEAST_BATCHES;
            if enough && tally.worst(bands, frame.accuracy, 0.0).1 <= 1.0 {
                break;
            }
        }
        let paths = u64::from(tally.batches()) * u64::from(size.div_ceil(together)) * u64::from(together);
        Ok((0..rays.len())
            .map(|i| RayAnswer {
                radiance: tally.mean()[i * bands..(i + 1) * bands].to_vec(),
                transmittance: clear[i].clone(),
                optical_depth: depth[i].iter().copied().map(unbounded).collect(),
                error: (0..bands).map(|b| tally.error(i * bands + b) + cut_off).collect(),
                error_kind: "standard-error",
                evaluations: paths,
            })
            .collect())
    }
}
