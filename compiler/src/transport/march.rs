//! Steps through a segment in which something varies: a fixed number of them, or by local error control.

use super::media::Medium;
use super::sample::Sampled;
use super::shapes::{FAR, Ray};
use super::stride::Stride;
use super::trace::{Origin, Segment, State, Tracer, Walk, largest, least, widen};
use crate::fields::Code;
use crate::ir::NodeId;
use crate::program::kernel::{Expr, LocalId, Math, Prim, Ty};
use crate::program::{EMPTY, FrameValue, OutputKind, StepRule};

/// Beyond this optical depth e^(−τ) is 0 in f32.
pub(super) const OPAQUE: f64 = 104.0;
/// Share of `accuracy` that step control spends; the rest is left for rounding and early exit.
const SHARE: f64 = 0.5;
/// Share of `accuracy` that steps with kinks and edges of shadows may spend beside, all together.
const PURSE: f64 = 0.25;
/// Of which one step may take this part of what is left.
const BITE: f64 = 0.125;
/// Pieces of a slab that are never too many.
const LEAST_PIECES: f64 = 64.0;
/// Longest piece of a ray in a slab that is lit by the one before, in thicknesses: rays are turned by up to 45° anyway.
const LONGEST: f64 = 2.0;
/// How far inside a step samples stay of its ends where fields jump: bisections end within a millionth of a step.
const INSET: f64 = 4e-6;

impl Tracer<'_> {
    /// Steps through a segment in which something varies.
    pub(super) fn march(&mut self, code: &mut Code, state: &State, media: &[Medium<'_>], segment: &Segment) {
        let length = code.bind("length", Ty::F32, segment.b.clone() - segment.a.clone());
        let reach = match &segment.reach {
            // Of a part that reaches farther than the whole was thought to, as the last one may.
            Some(reach) if segment.part => code.bind("reach", Ty::F32, reach.clone().max(length.clone())),
            Some(reach) => reach.clone(),
            None => length.clone(),
        };
        match self.rule {
            StepRule::Fixed(_) => self.march_fixed(code, state, media, segment, &length, &reach),
            StepRule::Slabs { .. } | StepRule::Splats { .. } if matches!(self.walk, Walk::Eye | Walk::Light) => {
                self.march_slab(code, state, media, segment, &length);
            }
            StepRule::Closed
            | StepRule::Adaptive(_)
            | StepRule::Paths(_)
            | StepRule::Slabs { .. }
            | StepRule::Splats { .. } => {
                self.march_adaptive(code, state, media, segment, &length, &reach);
            }
        }
    }

    fn march_fixed(
        &mut self,
        code: &mut Code,
        state: &State,
        media: &[Medium<'_>],
        segment: &Segment,
        length: &Expr,
        reach: &Expr,
    ) {
        let steps = self.builder.frame(FrameValue::Steps).convert(Prim::F32);
        let share = Expr::math(Math::Ceil, [steps * (length.clone() / reach.clone()) - 1e-4]);
        self.midpoints(code, state, media, segment, (length, share.max(1.0)));
    }

    /// So many steps of equal length.
    fn midpoints(
        &mut self,
        code: &mut Code,
        state: &State,
        media: &[Medium<'_>],
        Segment { ray, a, .. }: &Segment,
        (length, count): (&Expr, Expr),
    ) {
        let count = code.bind("count", Ty::F32, count);
        let h = code.bind("h", Ty::F32, length.clone() / count.clone());
        let i = code.var("step", Ty::F32, 0.0);
        code.open();
        code.break_if(Expr::Local(i).greater_equal(count));
        let t = a.clone() + (Expr::Local(i) + 0.5) * h.clone();
        self.midpoint(code, state, media, ray, t, &h);
        code.add(i, 1.0);
        if let (Some(depth), false) = (state.depth, self.wants(OutputKind::OpticalDepth)) {
            code.break_if(least(depth.into(), self.scene.depth_width).greater(OPAQUE));
        }
        let block = code.close();
        code.push_loop(block);
    }

    /// Where planes stand across half an angle, rays of a wide view may go along them for far longer than slabs are thick.
    fn longest_across(&mut self, code: &mut Code) -> Option<Expr> {
        if !self.half_angle || !matches!(self.walk, Walk::Eye) {
            return None;
        }
        let step = self.builder.frame(FrameValue::SlabStep);
        Some(code.bind("longest", Ty::F32, step * LONGEST))
    }

    /// The midpoint rule over what is inside a slab, cut where a field jumps and fine where something is narrow.
    fn march_slab(&mut self, code: &mut Code, state: &State, media: &[Medium<'_>], segment: &Segment, length: &Expr) {
        let Segment { ray, a, b, .. } = segment;
        let stops = self.stops(code, ray, media);
        let longest = self.longest_across(code);
        if !stops.any() {
            match longest {
                None => self.midpoint(code, state, media, ray, (a.clone() + b.clone()) * 0.5, length),
                Some(longest) => {
                    let count = Expr::math(Math::Ceil, [length.clone() / longest - 1e-4]);
                    self.midpoints(code, state, media, segment, (length, count.max(1.0).min(LEAST_PIECES)));
                }
            }
            return;
        }
        let shortest = code.bind("shortest", Ty::F32, length.clone() * (1.0 / 1_048_576.0));
        let slabs = self.builder.frame(FrameValue::SlabCount).convert(Prim::F32);
        let cap = self.builder.frame(FrameValue::MaxWork).convert(Prim::F32) / slabs;
        let cap = code.bind("most_pieces", Ty::F32, cap.max(LEAST_PIECES));
        let s = code.var("s", Ty::F32, 0.0);
        let pieces = code.var("pieces", Ty::F32, 0.0);
        // Whether the piece at hand begins at a curved jump.
        let touched = stops.has_sides().then(|| code.var("touched", Ty::BOOL, false));
        code.open();
        let rest = code.bind("rest", Ty::F32, length.clone() - Expr::Local(s));
        code.break_if(rest.clone().less_equal(0.0));
        let from = code.bind("from", Ty::F32, a.clone() + Expr::Local(s));
        let wanted = longest.map_or(rest.clone(), |longest| rest.clone().min(longest));
        let Stride { step, crosses, place, .. } =
            self.stride(code, &stops, (ray, media), &from, [wanted, rest.clone(), shortest.clone()]);
        let spent = code.bind("spent", Ty::BOOL, Expr::Local(pieces).greater_equal(cap));
        let step = code.bind("piece", Ty::F32, spent.clone().select(rest.clone(), step));
        if matches!(self.walk, Walk::Light) {
            self.lose_sight(code, state, &spent);
        } else if let Some(error) = state.error {
            // What lies in the rest is anybody's guess, and counts as wrong.
            let white = self.builder.frame(FrameValue::White);
            let seen = match state.depth {
                Some(depth) => (-least(depth.into(), self.scene.depth_width)).exp(),
                None => Expr::F32(1.0),
            };
            let bright = match state.radiance {
                Some(radiance) => white.max(largest(radiance.into(), self.scene.light_width)),
                None => white,
            };
            code.add(error, spent.select(seen * bright, 0.0));
        }
        // Where a field jumps is rounded.
        let before = if touched.is_some() { self.before(code, state) } else { [None, None] };
        self.midpoint(code, state, media, ray, from.clone() + step.clone() * 0.5, &step);
        if let (Some(touched), Some(crosses)) = (touched, &crosses) {
            self.count_rounded_jumps(code, state, (touched, crosses), (&place, &step), before);
        }
        code.add(s, step);
        code.add(pieces, 1.0);
        let block = code.close();
        code.push_loop(block);
    }

    /// A step of length h about the point at t, with the coefficients that are found there.
    fn midpoint(&mut self, code: &mut Code, state: &State, media: &[Medium<'_>], ray: &Ray, t: Expr, h: &Expr) {
        let sampled = self.sample(code, ray, state, media, t, "mid");
        let (x, light) = self.step(code, &sampled, h, "");
        if let (Some(radiance), Some(light)) = (state.radiance, light) {
            let light = self.weighted(state, light, self.scene.light_width);
            code.add(radiance, light);
        }
        if let (Some(error), Some(off)) = (state.error, sampled.source_error) {
            let seen = match state.depth {
                Some(depth) => (-least(depth.into(), self.scene.depth_width)).exp(),
                None => Expr::F32(1.0),
            };
            let seen = match &x {
                Some(x) => {
                    let mean = self.attenuated(code, x.clone(), self.scene.depth_width);
                    seen * largest(mean, self.scene.depth_width)
                }
                None => seen,
            };
            code.add(error, seen * off * h.clone());
        }
        if let (Some(depth), Some(x)) = (state.depth, x) {
            code.add(depth, x);
        }
        if let Some(work) = state.work {
            code.add(work, 1u32);
        }
    }

    /// The exact exponential over a step with constant coefficients: optical depth, and light in the width of radiance.
    fn step(&mut self, code: &mut Code, sampled: &Sampled, h: &Expr, tag: &str) -> (Option<Expr>, Option<Expr>) {
        let (dw, ew, lw) = (self.scene.depth_width, self.source_width(), self.scene.light_width);
        let x =
            sampled.extinction.clone().map(|k| code.bind(&format!("x{tag}"), Ty::float(dw), k * h.clone().splat(dw)));
        let light = sampled.source.clone().map(|e| {
            let light = widen(e * h.clone().splat(ew), ew, lw);
            let light = match &x {
                Some(x) => {
                    let mean = self.attenuated(code, x.clone(), dw);
                    light * widen(mean, dw, lw)
                }
                None => light,
            };
            code.bind(&format!("light{tag}"), Ty::float(lw), light)
        });
        (x, light)
    }

    /// A length that no field here changes much faster than: twice that on which the fastest would run through all its values. Nothing where
    /// light has edges, matter is here and there, or it is not known how fast some field changes.
    fn gentle(&self, media: &[Medium<'_>]) -> Option<f64> {
        // Where bricks differ, matter is in some places and not in others.
        if self.scene.is_lit() || media.iter().any(|m| m.matter.bounds.is_some()) {
            return None;
        }
        let mut least = f64::INFINITY;
        for matter in media.iter().map(|m| m.matter).filter(|m| m.varying) {
            for root in [matter.extinction, matter.emission].into_iter().flatten() {
                let (range, steep) =
                    (self.features().ranges()[root.0 as usize], self.features().steepness()[root.0 as usize]);
                // What does not vary has no length.
                if steep > 0.0 {
                    least = least.min(2.0 * (range.high - range.low) / steep);
                }
            }
        }
        (least > 0.0 && least.is_finite()).then_some(least)
    }

    /// Longest step: a third of it must see the smallest cell of anything piecewise that is here.
    /// Of a part of a ray, the whole counts.
    fn longest_step(&self, code: &mut Code, media: &[Medium<'_>], length: &Expr, whole: Option<&Expr>) -> Expr {
        let open = self.scene.matter.iter().any(|m| self.open_depth(m));
        let shadow = matches!(self.walk, Walk::Shadow { .. });
        // A column needs less care than what is seen along it; what has a closed form is smooth.
        let parts = if !open || shadow { 12.0 } else { 32.0 };
        let within = |share: f64| match whole {
            Some(whole) => length.clone().min(whole.clone() * share),
            None => length.clone() * share,
        };
        let plain = within(1.0 / parts);
        // Where fields are known to change slowly, samples a quarter of a step apart see all of it.
        let plain = match self.gentle(media).filter(|_| !shadow) {
            Some(gentle) => plain.max(within(1.0 / 4.0).min(gentle)),
            None => plain,
        };
        let mut finest: Option<Expr> = None;
        for medium in media.iter().filter(|m| m.matter.varying) {
            let roots: Vec<NodeId> = [medium.matter.extinction, medium.matter.emission].into_iter().flatten().collect();
            let Some(cell) = self.features().length(&roots) else { continue };
            let own = match &medium.here {
                Some(here) => here.clone().select(2.0 * cell, FAR),
                None => Expr::F32(2.0 * cell),
            };
            finest = Some(match finest {
                Some(so_far) => so_far.min(own),
                None => own,
            });
        }
        // Where nothing piecewise is, the length alone decides.
        match finest {
            None => plain,
            Some(Expr::F32(cell)) => within(1.0 / 8.0).min(cell),
            Some(finest) => {
                let finest = code.bind("finest", Ty::F32, finest);
                finest.clone().less(FAR).select(within(1.0 / 8.0).min(finest), plain)
            }
        }
    }

    fn march_adaptive(
        &mut self,
        code: &mut Code,
        state: &State,
        media: &[Medium<'_>],
        segment: &Segment,
        length: &Expr,
        reach: &Expr,
    ) {
        let (ray, a) = (&segment.ray, &segment.a);
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let accuracy = self.builder.frame(FrameValue::Accuracy);
        // A column alone is compared with no white.
        let column = matches!(self.walk, Walk::Shadow { .. });
        let white = if column { Expr::F32(1.0) } else { self.builder.frame(FrameValue::White) };
        let cap = self.builder.frame(FrameValue::MaxWork);
        let cap = if self.cache.is_some() { cap.min(super::cache::MOST_LOOKS) } else { cap };
        let longest = self.longest_step(code, media, length, segment.part.then_some(reach));
        let usual = code.bind("longest", Ty::F32, longest);
        // Through nothing that is known to be far away, a few steps lead.
        let told = media.iter().all(|m| !m.matter.varying || m.support_at.is_some());
        let longest = match told.then(|| self.longest_told(media)).flatten() {
            Some(told) => code.bind("longest_at_all", Ty::F32, usual.clone().max((length.clone() * 0.25).min(told))),
            None => usual.clone(),
        };
        let shortest = code.bind("shortest", Ty::F32, length.clone() * (1.0 / 1_048_576.0));
        let stops = self.stops(code, ray, media);
        let gap = self.longest_unseen(code, ray, media);
        // Distance from the start of the segment.
        let s = code.var("s", Ty::F32, 0.0);
        let h = code.var("h", Ty::F32, longest.clone());
        // What single steps may cost beyond their shares, where a kink or a shadow's edge lies in them.
        let purse = code.var("purse", Ty::F32, (length.clone() / reach.clone()).min(1.0) * PURSE);
        let nodes = self.declare_nodes(code, state, media);
        // Whether the step at hand begins at a curved jump, whose place is rounded.
        let told = stops.has_sides() && state.error.is_some() && matches!(self.walk, Walk::Eye);
        let touched = told.then(|| code.var("touched", Ty::BOOL, false));
        code.open();
        self.leap(code, state, media, segment, (s, nodes.fresh), [length, &shortest, reach]);
        let rest = code.bind("rest", Ty::F32, length.clone() - Expr::Local(s));
        code.break_if(rest.clone().less_equal(0.0));
        let from = code.bind("from", Ty::F32, a.clone() + Expr::Local(s));
        let Stride { step, last, ahead, crosses, place } =
            self.stride(code, &stops, (ray, media), &from, [h.into(), rest, shortest.clone()]);
        // A step that may begin or end at a jump is looked at from within.
        let inset = stops.has_jumps().then(|| {
            let inset = (place.clone() * 2.0 + step.clone() * INSET).min(step.clone() * 0.125);
            code.bind("inset", Ty::F32, inset)
        });
        self.look(code, state, media, ray, &nodes, &from, (&step, inset.as_ref()));
        let half = code.bind("half", Ty::F32, step.clone() * 0.5);
        let (x_whole, light_whole) = self.step(code, &nodes.whole(), &step, "_whole");
        let (x_first, light_first) = self.step(code, &nodes.first(), &half, "_first");
        let (x_second, light_second) = self.step(code, &nodes.second(), &half, "_second");
        let x = x_first.clone().zip(x_second).map(|(a, b)| code.bind("x", Ty::float(dw), a + b));
        let front = state.depth.map(|d| code.bind("front", Ty::float(dw), (-Expr::Local(d)).exp()));
        // By what values differ between samples they would differ for the rounding of places: no shorter step helps.
        let blur = code.bind("blur", Ty::F32, place.clone().min(half.clone()));
        let thinner = x.clone().zip(x_whole.clone()).map(|(a, b)| a.min(b));
        let thinner = thinner.map(|x| code.bind("thinner", Ty::float(dw), x));
        let glows = light_whole.is_some() || nodes.source_error().is_some();
        let mean = thinner.clone().filter(|_| glows).map(|x| self.attenuated(code, x, dw));
        let mean = mean.map(|m| code.bind("mean", Ty::float(dw), m));
        // Excess over a share of what is allowed, and the same as a part of all that is.
        let mut wrong: Vec<Expr> = vec![];
        let mut cost: Vec<Expr> = vec![];
        // What must hold whatever is in the purse.
        let mut strict: Vec<Expr> = vec![];
        // What is added to the error if the step is taken.
        let mut pending: Vec<(LocalId, Expr)> = vec![];
        let mut light_gain = None;
        if let (Some(whole), Some(first), Some(second)) = (light_whole, light_first, light_second) {
            let noise = widen(nodes.source_swing() * blur.clone().splat(self.source_width()), self.source_width(), lw);
            let noise = match &mean {
                Some(mean) => noise * widen(mean.clone(), dw, lw),
                None => noise,
            };
            let behind = match &x_first {
                Some(x) => widen((-x.clone()).exp(), dw, lw) * second,
                None => second,
            };
            let both = code.bind("light", Ty::float(lw), first + behind);
            let weight = front.clone().map_or(Expr::F32(1.0).splat(lw), |f| widen(f, dw, lw));
            let gain = code.bind("gain", Ty::float(lw), weight.clone() * both.clone());
            let noise = code.bind("noise", Ty::F32, largest(weight.clone() * noise, lw));
            let off = (both.clone() - whole).abs();
            let off = match (&thinner, &mean, nodes.front()) {
                (Some(x), Some(mean), Some(front)) => off.max(self.hidden_front((x, mean), front, both)),
                _ => off,
            };
            let off = code.bind("light_error", Ty::F32, largest(weight * off, lw));
            light_gain = Some(gain.clone());
            // Light this step may be wrong by: its share of A·max(W, L), or A of what it adds itself.
            let radiance = state.radiance.expect("there is light to add");
            let so_far = largest(Expr::Local(radiance) + gain.clone(), lw);
            let bright = code.bind("bright", Ty::F32, white.clone().max(so_far));
            let share = bright.clone() * (step.clone() / reach.clone());
            let allowed = accuracy.clone() * SHARE * share.max(least(gain, lw));
            let clear = code.bind("clear_error", Ty::F32, off.clone() - noise.clone());
            wrong.push(clear.clone() / allowed.max(1e-37));
            cost.push(clear / (accuracy.clone() * bright).max(1e-37));
            if let Some(error) = state.error {
                pending.push((error, off.clone()));
            }
            if let Some(rounding) = state.apart.rounding {
                pending.push((rounding, off.min(noise)));
            }
        }
        if let (Some(x), Some(whole), Some(thinner), Some(front)) = (&x, x_whole, &thinner, &front) {
            let noise = nodes.extinction_swing() * blur.splat(dw);
            let off = (x.clone() - whole).abs();
            let off = match self.walk {
                // The halves are wrong by less than a quarter of the difference on anything smooth.
                Walk::Shadow { .. } => off * Expr::F32(0.25).splat(dw),
                Walk::Eye | Walk::Light | Walk::Path(_) | Walk::Ratio(_) => off,
            };
            let off = code.bind("depth_off", Ty::float(dw), off);
            // Through the thinner of the two estimates, what lies behind is seen.
            let through = front.clone() * (-thinner.clone()).exp();
            let seen = through.clone() * off.clone().min(Expr::F32(1.0).splat(dw));
            let seen = code.bind("seen_error", Ty::F32, largest(seen, dw));
            let allowed = match &self.walk {
                Walk::Eye | Walk::Light | Walk::Path(_) | Walk::Ratio(_) => accuracy.clone(),
                // Half goes to the shadows, relative to the light that comes through, or to white.
                Walk::Shadow { dim } => accuracy.clone() * 0.5 * dim.clone().max(largest(through.clone(), dw)),
            };
            let clear = (off.clone() - noise).max(Expr::F32(0.0).splat(dw));
            let clear = code.bind("clear_off", Ty::float(dw), clear);
            let felt = largest(through.clone() * clear.clone().min(Expr::F32(1.0).splat(dw)), dw);
            let blurred = through * (off.clone() - clear.clone()).min(Expr::F32(1.0).splat(dw));
            let felt = code.bind("felt", Ty::F32, felt / allowed.max(1e-37));
            wrong.push(felt.clone() / (step.clone() / reach.clone() * SHARE).max(1e-37));
            cost.push(felt);
            if self.wants(OutputKind::OpticalDepth) {
                let depth = state.depth.expect("there is depth to add");
                let share = x.clone().max(Expr::Local(depth) * (step.clone() / reach.clone()).splat(dw));
                let relative = clear / (share * (accuracy.clone() * SHARE).splat(dw)).max(Expr::F32(1e-30).splat(dw));
                strict.push(largest(relative, dw));
            }
            if let Some(unsure) = state.apart.depth {
                pending.push((unsure, largest(off.clone(), dw)));
            }
            if let (Some(error), Walk::Shadow { .. }) = (state.error, &self.walk) {
                pending.push((error, largest(off, dw)));
            } else if let Some(error) = state.error {
                let behind = match state.radiance {
                    Some(radiance) => white.clone().max(largest(radiance.into(), lw)),
                    None => white.clone(),
                };
                let behind = code.bind("behind", Ty::F32, behind);
                pending.push((error, seen * behind.clone()));
                if let Some(rounding) = state.apart.rounding {
                    pending.push((rounding, largest(blurred, dw) * behind));
                }
            }
        }
        if let (Some(error), Some(off)) = (state.error, nodes.source_error()) {
            let seen = front.clone().map_or(Expr::F32(1.0), |f| largest(f, dw));
            // What is deep in a step cannot be seen.
            let off = match (mean, thinner, nodes.front_error()) {
                (Some(mean), Some(x), Some((at_front, extinction))) => {
                    let within = off * step.clone() * largest(mean.clone(), dw);
                    let front = self.front_share((&x, &mean), extinction);
                    within.max(at_front * largest(front, dw))
                }
                (Some(mean), ..) => off * step.clone() * largest(mean, dw),
                (None, ..) => off * step.clone(),
            };
            pending.push((error, seen * off));
        }
        // Something is in this brick, and no sample has met it: it may lie between them.
        let seen = [x.clone().map(|x| largest(x, dw)), light_gain.clone().map(|l| largest(l, lw))];
        let seen = seen.into_iter().flatten().reduce(Expr::max).unwrap_or(Expr::F32(0.0));
        if let Some(gap) = gap {
            let much = code.bind("gaps", Ty::F32, step.clone() / gap);
            strict.push(seen.clone().equal(0.0).select(much.clone() * much, 0.0));
        }
        if matches!(self.walk, Walk::Eye) && media.iter().any(|m| m.matter.bounds.is_some()) {
            let ways = self.clear_ways(code, media, &|n| nodes.support(n).map(|w| w.most));
            let hidden = code.var("hidden", Ty::F32, 0.0);
            code.open();
            let middle = from.clone() + half.clone();
            let longest = self.longest_hiding(code, ray, media, &ways, middle);
            if let Some(longest) = &longest {
                let much = code.bind("times", Ty::F32, step.clone() / longest.clone());
                code.set(hidden, much.clone() * much.clone() * much);
            }
            let block = code.close();
            if longest.is_some() {
                code.push_if(seen.clone().equal(0.0), block);
                strict.push(hidden.into());
            }
            if let Some(longest) = self.longest_celled(code, media, &ways, &usual) {
                let much = code.bind("cells", Ty::F32, step.clone() / longest);
                let much = much.clone() * much.clone() * much;
                strict.push(seen.equal(0.0).select(0.0, much));
            }
        }
        let worst = |all: Vec<Expr>| all.into_iter().reduce(Expr::max).unwrap_or(Expr::F32(0.0));
        let strict = code.bind("strict", Ty::F32, worst(strict));
        let wrong = code.bind("excess", Ty::F32, worst(wrong).max(strict.clone()));
        let cost = code.bind("cost", Ty::F32, worst(cost));
        let spent = match state.work {
            Some(work) => Expr::Local(work).greater_equal(cap),
            None => Expr::Bool(false),
        };
        let spent = code.bind("spent", Ty::BOOL, spent);
        let within = code.bind("within_share", Ty::BOOL, wrong.clone().less_equal(1.0));
        let bought = cost.clone().less_equal(Expr::Local(purse) * BITE).and(strict.less_equal(1.0));
        let bought = code.bind("bought", Ty::BOOL, bought.and(!within.clone()));
        // Errors fall as the third to the fifth power of a step and their shares as the first; where a kink is bought, steps
        // behind it are what they were before.
        let factor = Expr::F32(0.8) / Expr::math(Math::Pow, [wrong.max(1e-6), (1.0 / 3.0).into()]);
        let factor = Expr::math(Math::Clamp, [factor, Expr::F32(0.2), Expr::F32(1.5)]);
        let wanted = bought.clone().select(Expr::F32(1.0), factor) * step.clone();
        let wanted = code.bind("wanted", Ty::F32, wanted);
        let short = step.clone().less_equal(shortest.clone());
        let accept = within.or(bought.clone()).or(short).or(spent.clone());
        let accept = code.bind("accept", Ty::BOOL, accept);
        code.open();
        let before = if touched.is_some() { self.before(code, state) } else { [None, None] };
        if let (Some(radiance), Some(gain)) = (state.radiance, light_gain) {
            self.count_bright(code, state, &gain, (front.as_ref(), x.as_ref()));
            code.add(radiance, gain);
        }
        if let (Some(depth), Some(x)) = (state.depth, x) {
            code.add(depth, x);
        }
        if let (Some(touched), Some(crosses)) = (touched, &crosses) {
            self.count_rounded_jumps(code, state, (touched, crosses), (&place, &step), before);
        }
        for (error, amount) in pending {
            code.add(error, amount);
        }
        if let (Some(error), Some(depth)) = (state.error, state.depth) {
            // Out of work: what lies in the rest of the segment is anybody's guess, and counts as wrong.
            code.open();
            let seen = largest((-Expr::Local(depth)).exp(), dw);
            let bright = match state.radiance {
                Some(radiance) => white.max(largest(radiance.into(), lw)),
                None => Expr::F32(1.0),
            };
            code.add(error, seen * bright);
            let missed = code.close();
            code.push_if(spent.clone(), missed);
        }
        code.add(purse, bought.select(-cost, 0.0));
        code.add(s, step);
        code.break_if(last);
        self.early_exit(code, state, segment);
        let taken = code.close();
        code.push_if(accept.clone(), taken);
        // A step cut short by a jump says nothing against the length it would have had.
        let cut = ahead.map(|jump| jump.less(h)).into_iter().chain(crosses).reduce(Expr::or);
        let cut = cut.map(|cut| code.bind("cut", Ty::BOOL, cut));
        // What the last sample found is what the first of the next step would, but beyond a jump.
        let same = match &cut {
            Some(cut) => accept.clone().and(!cut.clone()),
            None => accept.clone(),
        };
        self.carry(code, &nodes, &accept, &same);
        let wanted = match cut {
            Some(cut) => accept.and(cut).select(wanted.clone().max(h), wanted),
            None => wanted,
        };
        let ways = self.clear_ways(code, media, &|n| nodes.support(n).map(|w| w.latest));
        let longest = match self.longest_celled(code, media, &ways, &usual) {
            Some(onward) => longest.min(onward),
            None => longest,
        };
        let next = Expr::math(Math::Clamp, [wanted, shortest.clone(), longest.max(shortest)]);
        // Out of work: the rest is taken in one step, whose error stands in the report.
        code.set(h, spent.select(length.clone(), next));
        let block = code.close();
        code.push_loop(block);
    }

    /// What a step too thick to be seen through may be wrong by. Its light comes from where it begins, which means over the step
    /// and over its halves weigh alike: light that reaches no deeper than a skin, say. There the source function k_e/k_t of the
    /// first sample decides; where nothing is, nothing is known of it.
    fn hidden_front(&self, (x, mean): (&Expr, &Expr), (source, extinction): (Expr, Expr), light: Expr) -> Expr {
        let (dw, ew, lw) = (self.scene.depth_width, self.source_width(), self.scene.light_width);
        let thick = self.thickness(mean);
        let front = (widen(source, ew, lw) * widen(self.stopped(x, extinction), dw, lw)).min(Expr::F32(1e30).splat(lw));
        (front - light).abs() * widen(thick, dw, lw)
    }

    /// The length over which a step of depth x would be seen if the extinction were everywhere as where it begins, as far as it is
    /// too thick for what lies deep in it to matter.
    fn front_share(&self, (x, mean): (&Expr, &Expr), extinction: Expr) -> Expr {
        self.stopped(x, extinction) * self.thickness(mean)
    }

    /// (1 − e^(−x))/k_t.
    fn stopped(&self, x: &Expr, extinction: Expr) -> Expr {
        let wide = |value: f64| Expr::F32(value).splat(self.scene.depth_width);
        (wide(1.0) - (-x.clone()).exp()) / extinction.max(wide(1e-30))
    }

    /// From 0 of what can be seen through to 1 of what cannot, by the mean transmittance within.
    fn thickness(&self, mean: &Expr) -> Expr {
        let wide = |value: f64| Expr::F32(value).splat(self.scene.depth_width);
        (wide(1.0) - mean.clone() * wide(2.0)).max(wide(0.0))
    }

    /// Leaps over empty bricks.
    fn leap(
        &mut self,
        code: &mut Code,
        state: &State,
        media: &[Medium<'_>],
        segment: &Segment,
        (s, fresh): (LocalId, LocalId),
        [length, shortest, reach]: [&Expr; 3],
    ) {
        if self.leaps(media) {
            // In a loop of its own, so that rays which leap do not hold up those beside them that step.
            code.open();
            let at = code.bind("at_brick", Ty::F32, segment.a.clone() + Expr::Local(s));
            let clear = self.clear_way(code, &segment.ray, media, &at);
            let clear = code.bind("clear_way", Ty::F32, clear);
            code.break_if(clear.clone().less_equal(0.0).or(Expr::Local(s).greater_equal(length.clone())));
            code.add(s, clear.clone().max(shortest.clone()));
            if state.error.is_some() && !self.wants(OutputKind::OpticalDepth) {
                // What counts as empty may hold this much.
                let accuracy = self.builder.frame(FrameValue::Accuracy);
                let share = accuracy * (clear / reach.clone()).min(1.0) * EMPTY;
                let left = match self.walk {
                    // The error of a shadow is one of depth.
                    Walk::Shadow { .. } => share,
                    Walk::Eye | Walk::Light | Walk::Path(_) | Walk::Ratio(_) => {
                        share * self.builder.frame(FrameValue::White)
                    }
                };
                state.add_error(code, Origin::Storage, left);
            }
            code.set(fresh, true);
            let over = code.close();
            code.open();
            code.push_loop(over);
            let leap = code.close();
            // A lattice of one brick has nothing to leap over.
            let bricked = self.bricked(media);
            code.push_if(bricked, leap);
        }
    }
}
