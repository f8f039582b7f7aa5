//! Pictures and probes of splats.

use super::refine::{Ladder, Pieces, Refined};
use super::{Drawing, ProbeSettings, RayAnswer, Session, Trouble};
use crate::frame::bounds::media_boxes;
use crate::frame::{Camera, Lattice, Params, scene_bounds};
use compiler::program::{Precision, SPLAT_CUT, StepRule};

/// Splats that are tried first.
const FIRST: u32 = 4096;
/// Most splats that are tried without being asked for.
const MOST: u32 = 1 << 20;
/// Most splats there can be.
const LIMIT: u32 = 1 << 24;

/// What blending the Gaussians along a ray may round, relative. Those within reach of it are as many as nodes in a tube that is
/// as long as the lattice; their roundings are of either sign and add up as their root (Higham 2002, §2.8), which is no bound.
fn blended(lattice: &Lattice) -> f64 {
    /// Radius of that tube in spacings.
    const REACH: f64 = 3.6;
    let longest = lattice.counts.iter().map(|n| f64::from(*n).powi(2)).sum::<f64>().sqrt();
    (std::f64::consts::PI * REACH * REACH * longest).sqrt() * Precision::Single.blend_error()
}

impl Session {
    /// Whether the picture is drawn of splats.
    pub(super) fn is_splatted(&self) -> bool {
        matches!(self.program.plan.steps, StepRule::Splats { .. })
    }

    fn splats(&self) -> Ladder {
        let (first, most) = match self.program.plan.steps {
            StepRule::Splats { count: Some(n), .. } => (n.min(LIMIT), n.min(LIMIT)),
            StepRule::Splats { count: None, .. }
            | StepRule::Closed
            | StepRule::Fixed(_)
            | StepRule::Adaptive(_)
            | StepRule::Paths(_)
            | StepRule::Slabs { .. } => (FIRST, MOST),
        };
        Ladder { first, most, power: 1.0 / 3.0, exact: false }
    }

    pub(super) fn draw_splats(
        &mut self,
        params: &Params,
        time: f64,
        camera: &Camera,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Drawing, Trouble> {
        let bounds = scene_bounds(&self.program.lowered, &params.0, time);
        let boxes = media_boxes(&self.program.lowered, &params.0, time);
        let frame = |session: &Self, count: u32| {
            let mut frame = session.frame(params, time, Some(camera), bounds);
            frame.lattice = Lattice::around(&boxes, count);
            let pieces = Pieces { count: frame.lattice.len(), size: frame.lattice.spacing };
            (frame, pieces)
        };
        let refined = self.refine(self.splats(), progress, &frame)?;
        let Refined { mut frame, mut canvas, mut timing, pieces, spent } = refined;
        // Two lattices differ by nothing where a boundary is off by as much in both: what the last leaves open is drawn.
        let mut ends = vec![];
        frame.goes_on = true;
        for lean in [1.0, -1.0] {
            frame.lean = lean;
            let (end, took) = self.canvas(&frame, &|_| {})?;
            timing = timing.and(took);
            ends.push(end);
        }
        let rounded = blended(&frame.lattice);
        canvas.enclose(&ends, (SPLAT_CUT, rounded), self.program.places.len());
        Ok(Drawing {
            splats: Some(pieces.count),
            evaluations: Some(spent * self.program.parts().count() as u64),
            ..self.drawing(canvas, timing, params, time)?
        })
    }

    /// Each ray on its own, since splats are put in order along one direction.
    pub(super) fn probe_splats(
        &mut self,
        params: &Params,
        rays: &[([f64; 3], [f64; 3])],
        settings: &ProbeSettings,
    ) -> Result<Vec<RayAnswer>, Trouble> {
        let boxes = media_boxes(&self.program.lowered, &params.0, settings.time);
        let mut answers = vec![];
        for ray in rays {
            let asked = |count: u32| {
                let lattice = Lattice::around(&boxes, count);
                let pieces = Pieces { count: lattice.len(), size: lattice.spacing };
                (lattice, pieces)
            };
            let answer = |session: &mut Self, lattice: Lattice, lean: f64| {
                session.probe_gpu(params, std::slice::from_ref(ray), settings, |frame| {
                    frame.eye.forward = ray.1;
                    (frame.lattice, frame.lean, frame.goes_on) = (lattice, lean, lean != 0.0);
                })
            };
            let mut last = Lattice::default();
            let (mut refined, _) = self.refine_probe(self.splats(), &mut |session, count| {
                let (lattice, pieces) = asked(count);
                last.clone_from(&lattice);
                let mut answers = answer(session, lattice, 0.0)?;
                for answer in &mut answers {
                    // What lies beyond the billboards; the lattice's own error is found from another lattice.
                    answer.error = answer.radiance.iter().map(|l| SPLAT_CUT * l).collect();
                    answer.evaluations = u64::from(pieces.count) * session.program.parts().count() as u64;
                }
                Ok((answers, pieces))
            })?;
            for lean in [1.0, -1.0] {
                for (answer, end) in refined.iter_mut().zip(answer(self, last.clone(), lean)?) {
                    for (band, error) in answer.error.iter_mut().enumerate() {
                        *error = error.max((end.radiance[band] - answer.radiance[band]).abs());
                    }
                }
            }
            answers.extend(refined);
        }
        Ok(answers)
    }
}
