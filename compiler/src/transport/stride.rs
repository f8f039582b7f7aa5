//! Where steps end: at jumps of a field, on planes and on curved surfaces, and before they pass what samples might miss.

use super::media::Medium;
use super::shapes::{FAR, Ray};
use super::sides::Sides;
use super::trace::{Tracer, Walk, largest};
use crate::fields::Code;
use crate::ir::LightKind;
use crate::program::kernel::{Expr, Math, Ty};

/// How far rounding moves a sample, relative to its distance from the origins of the scene and of its ray: two units in the last
/// place of an f32.
pub(super) const PLACE: f64 = 1.0 / 4_194_304.0;

/// What ends steps along a ray.
pub(super) struct Stops {
    planes: Vec<Crossing>,
    sides: Option<Sides>,
    /// Whether something narrow may be in the media.
    narrow: bool,
}

/// A step.
pub(super) struct Stride {
    pub(super) step: Expr,
    /// Whether it takes all that is left.
    pub(super) last: Expr,
    /// Distance to what ends it, if anything may, and whether it ends at a curved jump.
    pub(super) ahead: Option<Expr>,
    pub(super) crosses: Option<Expr>,
    /// How far the places of samples are rounded.
    pub(super) place: Expr,
}

impl Stops {
    pub(super) fn has_jumps(&self) -> bool {
        !self.planes.is_empty() || self.has_sides()
    }

    /// Whether there are jumps on curved surfaces.
    pub(super) fn has_sides(&self) -> bool {
        self.sides.is_some()
    }

    /// Whether there are any.
    pub(super) fn any(&self) -> bool {
        self.has_jumps() || self.narrow
    }
}

impl Tracer<'_> {
    /// What ends steps along this ray.
    pub(super) fn stops(&mut self, code: &mut Code, ray: &Ray, media: &[Medium<'_>]) -> Stops {
        let planes = self.jumps(code, ray);
        let sides = self.sides(code, ray);
        Stops { planes, sides, narrow: self.may_be_narrow(media) }
    }

    /// A step from a distance along the ray, no longer than wanted and than what is left, and no shorter than makes sense.
    pub(super) fn stride(
        &mut self,
        code: &mut Code,
        stops: &Stops,
        (ray, media): (&Ray, &[Medium<'_>]),
        from: &Expr,
        [wanted, rest, shortest]: [Expr; 3],
    ) -> Stride {
        let narrow = self.longest_here(code, ray, media, from);
        // A step ends where a field jumps, and before it passes what samples might miss.
        let jump = stops.planes.iter().map(|j| j.distance(code, from)).chain(narrow).reduce(Expr::min);
        let ahead = jump.map(|jump| code.bind("to_jump", Ty::F32, jump.max(shortest.clone())));
        let reachable = match &ahead {
            Some(jump) => code.bind("reachable", Ty::F32, wanted.min(jump.clone())),
            None => wanted,
        };
        // The last step takes what is left, so that no sliver remains.
        let last = code.bind("last", Ty::BOOL, (reachable.clone() * 1.001).greater_equal(rest.clone()));
        let step = last.clone().select(rest, reachable);
        // The places of samples are rounded.
        let place = largest(ray.origin.clone().abs(), 3) + from.clone().abs();
        let place = code.bind("rounded_by", Ty::F32, place * PLACE);
        let (step, last, crosses) = match &stops.sides {
            Some(sides) => {
                let step = code.bind("whole_stride", Ty::F32, step);
                let cut = code.var("stride", Ty::F32, step.clone());
                let crosses = self.cut_at_jump(code, ray, sides, from, cut);
                // No shorter than places are rounded, on which side they are.
                let least = shortest.max(place.clone()).min(step.clone());
                let step = code.bind("step", Ty::F32, Expr::Local(cut).max(least));
                let last = code.bind("last", Ty::BOOL, last.and(!crosses.clone()));
                (step, last, Some(crosses))
            }
            None => (code.bind("step", Ty::F32, step), last, None),
        };
        Stride { step, last, ahead, crosses, place }
    }

    /// The planes on which some coefficient jumps, and those nearest to a lamp, as functions of the distance along this ray.
    fn jumps(&mut self, code: &mut Code, ray: &Ray) -> Vec<Crossing> {
        let scene: &super::matter::Scene = self.scene;
        let mut known: Vec<crate::analysis::jumps::Jump> = vec![];
        for jump in scene.matter.iter().flat_map(|m| &m.jumps.planes) {
            if !known.contains(jump) {
                known.push(*jump);
            }
        }
        let crossing = |(i, jump): (usize, crate::analysis::jumps::Jump)| {
            let gradient = self.builder.value(self.graph, jump.gradient, "jump_gradient");
            let offset = self.builder.value(self.graph, jump.offset, "jump_offset");
            let start = gradient.clone().dot(ray.origin.clone()) + offset;
            let start = code.bind(&format!("jump_start_{i}"), Ty::F32, start);
            let rate = code.bind(&format!("jump_rate_{i}"), Ty::F32, gradient.dot(ray.direction.clone()));
            Crossing { start, rate, every_whole: jump.every_whole }
        };
        let mut all: Vec<Crossing> = known.into_iter().enumerate().map(crossing).collect();
        if self.in_scattered.is_some() && matches!(self.walk, Walk::Eye) {
            for light in &scene.lights {
                let LightKind::Point { position, radius, .. } = light.kind else { continue };
                let at = self.builder.value(self.graph, position, &format!("{}_position", light.name));
                let way = code.bind("from_lamp", Ty::VEC3, ray.origin.clone() - at);
                let start = way.clone().dot(ray.direction.clone());
                let start = code.bind(&format!("past_{}", light.name), Ty::F32, start);
                all.push(Crossing { start: start.clone(), rate: Expr::F32(1.0), every_whole: false });
                let Some(radius) = radius else { continue };
                // Where the light begins and ends to be clamped.
                let radius = self.builder.value(self.graph, radius, &format!("{}_radius", light.name));
                let foot = way - ray.direction.clone() * start.clone().splat(3);
                let foot = code.bind("foot", Ty::VEC3, foot);
                let half = (radius.clone() * radius - foot.clone().dot(foot)).max(0.0).sqrt();
                let half = code.bind("half_chord", Ty::F32, half);
                for edge in [start.clone() + half.clone(), start - half] {
                    let start = code.bind("past_edge", Ty::F32, edge);
                    all.push(Crossing { start, rate: Expr::F32(1.0), every_whole: false });
                }
            }
        }
        all
    }
}

/// A coordinate `start + rate · t` that jumps at 0, or at every whole number.
struct Crossing {
    start: Expr,
    rate: Expr,
    every_whole: bool,
}

impl Crossing {
    /// From `t` to the next jump; FAR if there is none.
    fn distance(&self, code: &mut Code, t: &Expr) -> Expr {
        let x = code.bind("coordinate", Ty::F32, self.start.clone() + self.rate.clone() * t.clone());
        let still = self.rate.clone().equal(0.0);
        let to_next = if self.every_whole {
            let up = Expr::math(Math::Floor, [x.clone()]) + 1.0;
            let down = Expr::math(Math::Ceil, [x.clone()]) - 1.0;
            self.rate.clone().greater(0.0).select(up, down) - x
        } else {
            -x
        };
        let distance = code.bind("distance", Ty::F32, to_next / still.clone().select(1.0, self.rate.clone()));
        still.or(distance.clone().less_equal(0.0)).select(FAR, distance)
    }
}
