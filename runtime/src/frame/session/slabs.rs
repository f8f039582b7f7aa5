//! Pictures and probes in slabs.

use super::refine::{Ladder, Pieces, Refined};
use super::{Drawing, ProbeSettings, RayAnswer, Session, Trouble};
use crate::frame::bounds::media_boxes;
use crate::frame::half::open_boxes;
use crate::frame::{Camera, Eye, HalfAngle, Params, Shining, Slabs, Vec3, scene_bounds};
use compiler::ir::Stacks;
use compiler::program::{Precision, StepRule};

/// Slabs that are tried first.
const FIRST: u32 = 32;
/// Where they are blended in f16.
const FIRST_HALF: u32 = 8;
/// Most slabs there can be: their numbers pass through f32 beside the code of a fault.
const MOST: u32 = 65535;

impl Session {
    /// Whether the picture is drawn in slabs.
    pub(super) fn is_sliced(&self) -> bool {
        matches!(self.program.plan.steps, StepRule::Slabs { .. })
    }

    /// Whether they are blended in f16.
    pub(super) fn blends_half(&self) -> bool {
        self.program.plan.targets.iter().any(|t| t.precision == Precision::Half)
    }

    /// Whether light is followed from slab to slab.
    pub(super) fn follows_light(&self) -> bool {
        self.program.parts().any(|p| p.plan.light.is_some())
    }

    fn slabs(&self) -> Ladder {
        let most = MOST.min(self.program.lowered.render.max_work).max(1);
        let (first, most) = match self.program.plan.steps {
            StepRule::Slabs { count: Some(n), .. } => (n.min(most), n.min(most)),
            StepRule::Slabs { count: None, .. }
            | StepRule::Closed
            | StepRule::Fixed(_)
            | StepRule::Adaptive(_)
            | StepRule::Paths(_)
            | StepRule::Splats { .. } => (if self.blends_half() { FIRST_HALF } else { FIRST }.min(most), most),
        };
        // A number that nobody asked for is the compiler's, where more would change nothing.
        let given = matches!(self.program.plan.steps, StepRule::Slabs { count: Some(_), .. });
        let exact = given && self.program.lowered.render.slices.is_none();
        Ladder { first, most, power: 1.0, exact }
    }

    pub(super) fn draw_slabs(
        &mut self,
        params: &Params,
        time: f64,
        camera: &Camera,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Drawing, Trouble> {
        let bounds = scene_bounds(&self.program.lowered, &params.0, time);
        let boxes = media_boxes(&self.program.lowered, &params.0, time);
        let eye = Eye::new(camera, bounds);
        let half = self.half_angle(params, time, &boxes, &eye)?;
        let frame = |session: &Self, count: u32| {
            let mut frame = session.frame(params, time, Some(camera), bounds);
            frame.slabs = match &half {
                Some((half, open)) => Slabs::half_angle((&boxes, open), &eye, camera, (half, count)),
                None => {
                    let stacks = session.program.lowered.render.stacks;
                    Slabs::of_view(&boxes, &eye, camera, (stacks, count))
                }
            };
            (frame, Pieces { count, size: 1.0 / f64::from(count) })
        };
        let Refined { canvas, timing, pieces, .. } = self.refine(self.slabs(), progress, &frame)?;
        Ok(Drawing { slabs: Some(pieces.count), ..self.drawing(canvas, timing, params, time)? })
    }

    /// How light is followed from slab to slab, and the boxes that it is followed through, where it is.
    fn half_angle(
        &self,
        params: &Params,
        time: f64,
        boxes: &[[Vec3; 8]],
        eye: &Eye,
    ) -> Result<Option<(HalfAngle, Vec<[Vec3; 8]>)>, Trouble> {
        let scene = &self.program.lowered;
        let shining = match scene.render.stacks {
            Stacks::View | Stacks::Object => None,
            Stacks::HalfAngle => Shining::of_scene(scene, &params.0, time),
        };
        let Some(shining) = shining else { return Ok(None) };
        let half = HalfAngle::new(shining, boxes, eye).map_err(|diagnostic| {
            let span = scene.lights.first().and_then(|light| light.span);
            self.input(match span {
                Some(span) => diagnostic.at(span, "this one"),
                None => diagnostic,
            })
        })?;
        Ok(Some((half, open_boxes(&self.program, &params.0, time))))
    }

    pub(super) fn probe_slabs(
        &mut self,
        params: &Params,
        rays: &[([f64; 3], [f64; 3])],
        settings: &ProbeSettings,
    ) -> Result<Vec<RayAnswer>, Trouble> {
        let boxes = media_boxes(&self.program.lowered, &params.0, settings.time);
        let refined = self.refine_probe(self.slabs(), &mut |session, count| {
            let slabs = Slabs::of_rays(&boxes, rays.len(), count);
            let answers = session.probe_gpu(params, rays, settings, |frame| frame.slabs = slabs)?;
            Ok((answers, Pieces { count, size: 1.0 / f64::from(count) }))
        });
        Ok(refined?.0)
    }
}
