//! What rounding makes of the ends of stretches of a ray, as an error of what is seen.

use super::shapes::FAR;
use super::trace::{Origin, Segment, State, Tracer, Walk, largest, widen};
use crate::fields::Code;
use crate::program::FrameValue;
use crate::program::StepRule;
use crate::program::kernel::{Expr, LocalId, Ty};

/// Half a unit in the last place of an f32, relative.
pub(crate) const HALF_ULP: f64 = 1.0 / 16_777_216.0;

impl Tracer<'_> {
    /// Depth and radiance in front of a segment, where the error is kept.
    pub(super) fn before(&self, code: &mut Code, state: &State) -> [Option<Expr>; 2] {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let splats = matches!(self.rule, StepRule::Splats { .. });
        if splats || state.error.is_none() {
            return [None, None];
        }
        [
            state.depth.map(|d| code.bind("depth_before", Ty::float(dw), Expr::Local(d))),
            state.radiance.map(|r| code.bind("radiance_before", Ty::float(lw), Expr::Local(r))),
        ]
    }

    /// Adds to the error what it makes that the ends of a segment are rounded.
    pub(super) fn count_rounded_ends(
        &mut self,
        code: &mut Code,
        state: &State,
        segment: &Segment,
        before: [Option<Expr>; 2],
    ) {
        if state.error.is_none() {
            return;
        }
        let Some(all) = self.moved(code, state, before) else { return };
        let Segment { ray, a, b, .. } = segment;
        let place = largest(ray.origin.clone().abs(), 3) * 2.0 + a.clone().abs() + b.clone().abs();
        let off = code.bind("rounded", Ty::F32, place.min(FAR) * HALF_ULP / (b.clone() - a.clone()).max(1e-37));
        let off = off.min(1.0) * all;
        match &segment.slab {
            // The ends of slabs are no boundaries: what one lacks the next has.
            Some([from, to]) => {
                let bounded = a.clone().greater(from.clone()).or(b.clone().less(to.clone()));
                state.add_error(code, Origin::Rounding, bounded.select(off, 0.0));
            }
            None => state.add_error(code, Origin::Rounding, off),
        }
    }

    /// Adds to the error what it makes that a curved jump is found where f32 can tell it: in the step that ends there, and in the next,
    /// which begins there and is `touched` by it.
    pub(super) fn count_rounded_jumps(
        &mut self,
        code: &mut Code,
        state: &State,
        (touched, crosses): (LocalId, &Expr),
        (place, step): (&Expr, &Expr),
        before: [Option<Expr>; 2],
    ) {
        let all = match self.walk {
            Walk::Light => self.added(state, before),
            Walk::Eye | Walk::Shadow { .. } | Walk::Path(_) | Walk::Ratio(_) => self.moved(code, state, before),
        };
        if let Some(all) = all {
            let off = place.clone() / step.clone().max(1e-37);
            let jumps = Expr::Local(touched).or(crosses.clone());
            state.add_error(code, Origin::Rounding, jumps.select(off.min(1.0) * all, 0.0));
        }
        code.set(touched, crosses.clone());
    }

    /// The optical depth that was added since `before`.
    fn added(&self, state: &State, [before, _]: [Option<Expr>; 2]) -> Option<Expr> {
        before.zip(state.depth).map(|(before, depth)| largest(Expr::Local(depth) - before, self.scene.depth_width))
    }

    /// What a stretch moves the picture by for its length, in what was added since `before`: a length of `l` that is off by δ is off
    /// by δ/l in optical depth, and by less than e^(−x/2) δ/l in its own light.
    pub(super) fn moved(
        &mut self,
        code: &mut Code,
        state: &State,
        [depth_before, radiance_before]: [Option<Expr>; 2],
    ) -> Option<Expr> {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let mut parts = vec![];
        let x = depth_before.zip(state.depth).map(|(before, depth)| {
            let x = code.bind("segment_depth", Ty::float(dw), Expr::Local(depth) - before);
            let white = self.builder.frame(FrameValue::White);
            let bright = match state.radiance {
                Some(radiance) => white.max(largest(radiance.into(), lw)),
                None => white,
            };
            parts.push(bright * largest((-Expr::Local(depth)).exp() * x.clone(), dw));
            x
        });
        if let Some((before, radiance)) = radiance_before.zip(state.radiance) {
            let own = Expr::Local(radiance) - before;
            let own = match &x {
                Some(x) => own * widen((x.clone() * Expr::F32(-0.5).splat(dw)).exp(), dw, lw),
                None => own,
            };
            parts.push(largest(own, lw));
        }
        parts.into_iter().reduce(|a, b| a + b)
    }
}
