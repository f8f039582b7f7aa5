//! Where a ray may end early, and what that may cost.

use super::march::OPAQUE;
use super::trace::{Origin, Segment, State, Tracer, Walk, largest, least};
use crate::fields::Code;
use crate::ir::NodeId;
use crate::program::kernel::{Expr, Ty};
use crate::program::{FrameValue, OutputKind};

/// Share of `accuracy` that may be left behind where a ray ends early.
const LEFT: f64 = 0.05;

/// What can be known beforehand of the light from behind a place on a ray.
struct Unseen {
    /// An upper bound of the background and of the source functions k_e/k_t that have one: of media that overlap, the sum of the
    /// emissions is no larger a multiple of the sum of the extinctions.
    sources: f64,
    /// An upper bound of the emission, per length, of media that do not absorb as much as they shine: it is not bounded but by how far they reach.
    glow: f64,
    /// Whether there is light besides of which no bound is known.
    guessed: bool,
}

impl Tracer<'_> {
    /// Leaves the loop when nothing behind can be seen any more, and adds what that may cost to the error.
    pub(super) fn early_exit(&mut self, code: &mut Code, state: &State, segment: &Segment) {
        let (Some(depth), false) = (state.depth, self.wants(OutputKind::OpticalDepth)) else { return };
        let thin = code.bind("thinnest", Ty::F32, least(depth.into(), self.scene.depth_width));
        if state.error.is_some() && matches!(self.walk, Walk::Eye) {
            let accuracy = self.builder.frame(FrameValue::Accuracy);
            let white = self.builder.frame(FrameValue::White);
            let Unseen { sources, glow, guessed } = self.unseen();
            let mut bound = Expr::F32(sources.max(1e-30));
            let mut bright = white.clone();
            // How far what shines may reach, where that is known.
            let endless = glow > 0.0 && segment.reach.is_none();
            if let (true, Some(reach)) = (glow > 0.0, &segment.reach) {
                bound = bound + reach.clone() * glow;
            }
            if guessed || glow > 0.0 {
                let seen = match state.radiance {
                    Some(radiance) => largest(radiance.into(), self.scene.light_width),
                    None => Expr::F32(0.0),
                };
                let seen = code.bind("seen", Ty::F32, seen);
                if guessed {
                    // It is taken to be at most ten times as bright as what has been seen.
                    bound = bound.max((seen.clone() * 10.0).max(white.clone()));
                }
                bright = white.max(seen);
            }
            if !endless {
                let through = code.bind("through", Ty::F32, (-thin.clone()).exp());
                let rest = code.bind("rest_bound", Ty::F32, through.clone() * bound);
                let dim = rest.clone().less(accuracy.clone() * LEFT * bright);
                code.open();
                state.add_error(code, Origin::Storage, rest);
                code.break_();
                let leave = code.close();
                code.push_if(dim.and(through.less(accuracy * LEFT)), leave);
            }
        }
        code.break_if(thin.greater(OPAQUE));
    }

    fn unseen(&self) -> Unseen {
        // Of what a surface reflects, and of discs in the sky, no bound is known.
        let surfaces = self.scene.sheets.iter().any(|s| s.albedo.is_some());
        let discs = self.scene.lights.iter().any(|l| l.kind.is_disc());
        let mut unseen = Unseen { sources: 0.0, glow: 0.0, guessed: surfaces || discs };
        // What is not a number is a fault, and drawn nowhere.
        let most = |node: NodeId| {
            let high = self.features().ranges()[node.0 as usize].high;
            (high < 1e30).then_some(high.max(0.0))
        };
        match self.scene.background.map(most) {
            None => {}
            Some(Some(bright)) => unseen.sources = bright,
            Some(None) => unseen.guessed = true,
        }
        for matter in &self.scene.matter {
            // Nor of what is scattered.
            unseen.guessed |= matter.scattering.is_some();
            match (matter.source_bound, matter.emission.and_then(most)) {
                (Some(bound), _) => unseen.sources = unseen.sources.max(bound),
                (None, Some(emission)) => unseen.glow += emission,
                (None, None) => unseen.guessed = true,
            }
        }
        unseen
    }
}
