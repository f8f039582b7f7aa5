//! What an unsure optical depth does to light behind it that is brighter than white.
//!
//! Where a depth is off by δ, all light behind is off by as much of itself. Steps count that at once, as if what lies behind were white: media whose
//! source function k_e/k_t is no larger send no more through any depth. Of what is brighter the excess is counted where it is met.

use super::trace::{State, Tracer, largest, widen};
use crate::fields::Code;
use crate::program::FrameValue;
use crate::program::kernel::{Expr, Ty};

impl Tracer<'_> {
    /// Counts light of a stretch of depth `x`, as it is seen, against all depth before it: `front` is e^(−τ) of that.
    pub(super) fn count_bright(
        &mut self,
        code: &mut Code,
        state: &State,
        light: &Expr,
        (front, x): (Option<&Expr>, Option<&Expr>),
    ) {
        let (Some(error), Some(unsure), Some(front)) = (state.error, state.apart.depth, front) else { return };
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let white = self.builder.frame(FrameValue::White);
        let excess = match x {
            Some(x) => {
                let stopped = front.clone() * (Expr::F32(1.0).splat(dw) - (-x.clone()).exp());
                light.clone() - widen(stopped, dw, lw) * white.splat(lw)
            }
            None => light.clone(),
        };
        let excess = code.bind("beyond_white", Ty::F32, largest(excess, lw).max(0.0));
        let unsure = Expr::Local(unsure).min(1e3);
        code.add(error, excess * unsure.clone() * (unsure + 1.0));
    }

    /// Counts what is behind all media and as bright as that.
    pub(super) fn count_bright_behind(&mut self, code: &mut Code, state: &State, behind: &Expr) {
        let (Some(error), Some(unsure), Some(depth)) = (state.error, state.apart.depth, state.depth) else { return };
        let lw = self.scene.light_width;
        let white = self.builder.frame(FrameValue::White);
        let through = largest((-Expr::Local(depth)).exp(), self.scene.depth_width);
        let excess = (largest(behind.clone(), lw) - white).max(0.0);
        let unsure = Expr::Local(unsure).min(1e3);
        code.add(error, excess * through * unsure.clone() * (unsure + 1.0));
    }
}
