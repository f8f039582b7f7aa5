//! Five samples across a step, and what Simpson's rule makes of them: once over the step, and once over each half of it. The
//! two differ wherever the samples show anything but a cubic; the last sample is the first of the next step.

use super::media::Medium;
use super::sample::Sampled;
use super::shapes::{FAR, Ray};
use super::trace::{State, Tracer};
use crate::fields::Code;
use crate::program::kernel::{Expr, LocalId, Ty};

/// Samples on a step.
pub(super) const NODES: u32 = 5;

/// A quantity that is sampled across a step.
struct Followed {
    width: u8,
    /// Means over the halves of the step.
    first: LocalId,
    second: LocalId,
    latest: LocalId,
    /// At the beginning of the step.
    start: LocalId,
    /// Of what steers the step.
    steering: Option<Steering>,
}

/// What the halves are compared with.
struct Steering {
    /// The mean over the step.
    whole: LocalId,
    /// By how much samples differ from those before them, in all.
    swing: LocalId,
}

/// The scalar without which there is nothing of a medium.
pub(super) struct Watched {
    /// Of the medium's bounds.
    pub(super) number: u32,
    /// The largest on the step.
    pub(super) most: LocalId,
    pub(super) latest: LocalId,
}

/// What the samples of a step found.
pub(super) struct Nodes {
    /// Whether the beginning of the step has not been sampled yet.
    pub(super) fresh: LocalId,
    extinction: Option<Followed>,
    source: Option<Followed>,
    error: Option<Followed>,
    supports: Vec<Watched>,
}

impl Followed {
    fn declare(code: &mut Code, name: &str, width: u8, steers: bool) -> Self {
        let ty = Ty::float(width);
        let mut var = |what: &str| code.var(&format!("{name}_{what}"), ty, Expr::F32(0.0).splat(width));
        let steering = steers.then(|| Steering { whole: var("whole"), swing: var("swing") });
        Self { width, first: var("first"), second: var("second"), latest: var("latest"), start: var("start"), steering }
    }

    fn splat(&self, value: Expr) -> Expr {
        value.splat(self.width)
    }

    /// Begins a step, with its first sample if that is known.
    fn begin(&self, code: &mut Code, fresh: &Expr) {
        let known = fresh.clone().select(0.0, 1.0 / 6.0);
        let known = self.splat(known) * Expr::Local(self.start);
        if let Some(Steering { whole, swing }) = self.steering {
            code.set(whole, known.clone());
            code.set(swing, self.splat(Expr::F32(0.0)));
        }
        code.set(self.first, known);
        code.set(self.second, self.splat(Expr::F32(0.0)));
        code.set(self.latest, self.start);
    }

    fn add(&self, code: &mut Code, value: Expr, weights: &Weights) {
        if let Some(Steering { whole, swing }) = self.steering {
            code.add(whole, value.clone() * self.splat(weights.whole.clone()));
            let change = (value.clone() - Expr::Local(self.latest)).abs();
            code.add(swing, change * self.splat(weights.later.clone()));
        }
        for (sum, weight) in [(self.first, &weights.first), (self.second, &weights.second)] {
            code.add(sum, value.clone() * self.splat(weight.clone()));
        }
        code.set(self.latest, value.clone());
        let start = weights.later.clone().greater(0.0).select(self.start, value);
        code.set(self.start, start);
    }
}

/// Weights of a sample in the means, and 1 but for the first.
struct Weights {
    whole: Expr,
    first: Expr,
    second: Expr,
    later: Expr,
}

impl Nodes {
    fn of(&self, mean: impl Fn(&Followed) -> Option<LocalId>) -> Sampled {
        let value = |f: &Option<Followed>| f.as_ref().and_then(&mean).map(Expr::Local);
        Sampled {
            extinction: value(&self.extinction),
            source: value(&self.source),
            source_error: None,
            supports: vec![],
        }
    }

    /// Means over the step.
    pub(super) fn whole(&self) -> Sampled {
        self.of(|f| f.steering.as_ref().map(|s| s.whole))
    }

    /// Means over its first half.
    pub(super) fn first(&self) -> Sampled {
        self.of(|f| Some(f.first))
    }

    /// Means over its second half.
    pub(super) fn second(&self) -> Sampled {
        self.of(|f| Some(f.second))
    }

    /// Source and extinction where the step begins.
    pub(super) fn front(&self) -> Option<(Expr, Expr)> {
        let (source, extinction) = (self.source.as_ref()?, self.extinction.as_ref()?);
        Some((source.start.into(), extinction.start.into()))
    }

    /// By how much extinction changes across the step, back and forth.
    pub(super) fn extinction_swing(&self) -> Expr {
        Self::swing(self.extinction.as_ref())
    }

    /// By how much the source changes across the step, back and forth.
    pub(super) fn source_swing(&self) -> Expr {
        Self::swing(self.source.as_ref())
    }

    fn swing(of: Option<&Followed>) -> Expr {
        of.and_then(|f| f.steering.as_ref()).map_or(Expr::F32(0.0), |s| s.swing.into())
    }

    /// How near the step came to a medium.
    pub(super) fn support(&self, number: u32) -> Option<&Watched> {
        self.supports.iter().find(|w| w.number == number)
    }

    /// The mean of what the source may be wrong by, if that is known.
    pub(super) fn source_error(&self) -> Option<Expr> {
        self.error.as_ref().map(|f| (Expr::Local(f.first) + Expr::Local(f.second)) * 0.5)
    }

    /// The same where the step begins, and the extinction there.
    pub(super) fn front_error(&self) -> Option<(Expr, Expr)> {
        let (error, extinction) = (self.error.as_ref()?, self.extinction.as_ref()?);
        Some((error.start.into(), extinction.start.into()))
    }

    fn all(&self) -> impl Iterator<Item = &Followed> {
        [&self.extinction, &self.source, &self.error].into_iter().flatten()
    }
}

impl Tracer<'_> {
    /// What samples will find, before the first of them.
    pub(super) fn declare_nodes(&self, code: &mut Code, state: &State, media: &[Medium<'_>]) -> Nodes {
        let lit = self.in_scattered.as_ref().filter(|_| state.radiance.is_some());
        let attenuates = media.iter().any(|m| m.matter.extinction.is_some());
        let glows = lit.is_some() || media.iter().any(|m| m.matter.emission.is_some());
        let told = lit.is_some_and(|l| l.error.is_some()) && state.error.is_some();
        let supports = media.iter().filter_map(|m| m.support_at).map(|(number, _)| Watched {
            number,
            most: code.var(&format!("support_most_{number}"), Ty::F32, -FAR),
            latest: code.var(&format!("support_{number}"), Ty::F32, -FAR),
        });
        let supports = supports.collect();
        Nodes {
            supports,
            fresh: code.var("fresh", Ty::BOOL, true),
            extinction: attenuates.then(|| Followed::declare(code, "k_t", self.scene.depth_width, true)),
            source: (glows && state.radiance.is_some())
                .then(|| Followed::declare(code, "source", self.source_width(), true)),
            error: told.then(|| Followed::declare(code, "source_error", 1, false)),
        }
    }

    /// Samples a step. One loop, so that a shader holds the fields once.
    pub(super) fn look(
        &mut self,
        code: &mut Code,
        state: &State,
        media: &[Medium<'_>],
        ray: &Ray,
        nodes: &Nodes,
        from: &Expr,
        (step, inset): (&Expr, Option<&Expr>),
    ) {
        let fresh = Expr::Local(nodes.fresh);
        for followed in nodes.all() {
            followed.begin(code, &fresh);
        }
        for watched in &nodes.supports {
            code.set(watched.most, fresh.clone().select(-FAR, watched.latest));
        }
        if let Some(work) = state.work {
            code.add(work, fresh.clone().select(NODES, NODES - 1));
        }
        let node = code.var("node", Ty::F32, fresh.select(0.0, 1.0));
        code.open();
        let quarter = Expr::F32(0.25) * Expr::Local(node);
        let t = match inset {
            Some(inset) => from.clone() + inset.clone() + (step.clone() - inset.clone() * 2.0) * quarter,
            None => from.clone() + step.clone() * quarter,
        };
        let sampled = self.sample(code, ray, state, media, t, "node");
        let odd = Expr::Local(node).equal(1.0).or(Expr::Local(node).equal(3.0));
        let odd = code.bind("odd", Ty::BOOL, odd);
        let simpson = code.bind("simpson", Ty::F32, odd.clone().select(2.0 / 3.0, 1.0 / 6.0));
        let middle = Expr::Local(node).equal(2.0).select(2.0 / 3.0, 1.0 / 6.0);
        let mut bind = |name: &str, value: Expr| code.bind(name, Ty::F32, value);
        let weights = Weights {
            whole: bind("weight_whole", odd.select(0.0, middle)),
            first: bind("weight_first", Expr::Local(node).less_equal(2.0).select(simpson.clone(), 0.0)),
            second: bind("weight_second", Expr::Local(node).greater_equal(2.0).select(simpson, 0.0)),
            later: bind("later", Expr::Local(node).greater(0.0).select(1.0, 0.0)),
        };
        let found = [&sampled.extinction, &sampled.source, &sampled.source_error];
        for (followed, value) in [&nodes.extinction, &nodes.source, &nodes.error].into_iter().zip(found) {
            debug_assert_eq!(followed.is_some(), value.is_some(), "what samples find is known before");
            if let (Some(followed), Some(value)) = (followed, value) {
                followed.add(code, value.clone(), &weights);
            }
        }
        for (watched, (number, value)) in nodes.supports.iter().zip(sampled.supports) {
            debug_assert_eq!(watched.number, number, "in the order of the media");
            code.set(watched.most, Expr::Local(watched.most).max(value.clone()));
            code.set(watched.latest, value);
        }
        code.add(node, 1.0);
        code.break_if(Expr::Local(node).greater_equal(f64::from(NODES)));
        let block = code.close();
        code.push_loop(block);
    }

    /// After a step: `taken`, the next begins where it ended, and what was found there holds unless something jumps.
    pub(super) fn carry(&self, code: &mut Code, nodes: &Nodes, taken: &Expr, holds: &Expr) {
        for followed in nodes.all() {
            code.set(followed.start, taken.clone().select(followed.latest, followed.start));
        }
        code.set(nodes.fresh, taken.clone().and(!holds.clone()));
    }
}
