//! Scattering of all orders: the function `path(origin, direction, start, seed)` follows one path of light backwards.
//!
//! The free flight to the next collision races two clocks (Kutz et al. 2017; Novák et al. 2018): the optical depth of media
//! with closed forms is inverted, that of the others is met by delta tracking under a majorant, and whichever comes first
//! ends the flight; the sum of independent Poisson processes is one. Lights are asked at every collision (next-event
//! estimation) through the depth of closed media and ratio tracking through the others; an environment is met by paths that
//! escape. All bands share a path: one of them, drawn at its start, decides, and each is weighted by its own density over
//! the mean density of all (the balance heuristic; Miller, Georgiev and Jarosz 2019). Paths end by Russian roulette.

use super::light::{LightSample, Receiver};
use super::media::Medium;
use super::shapes::{FAR, Ray, SdfFunctions};
use super::trace::{Apart, ComponentIf, Segment, State, Stretch, Traced, Tracer, Walk, cut_short, largest, widen};
use super::tracking::push_tracking;
use crate::fields::{Code, Helper, PhaseFunction, phase_function};
use crate::ir::Input;
use crate::program::kernel::{BinaryOp, Expr, Function, FunctionId, LocalId, Math, Prim, Ty};
use crate::program::{Fault, FrameValue, Ledger, OutputKind};
use std::f64::consts::PI;

/// Collisions after which roulette begins.
const SURE: u32 = 3;

/// Variables of a flight.
#[derive(Clone)]
pub(super) struct Flight {
    /// State of the random numbers.
    rng: LocalId,
    /// The band that decides.
    hero: Expr,
    /// Probability of each band to come this far.
    survival: LocalId,
    /// Light of what shines where null collisions are met, by band.
    emitted: LocalId,
    /// Weight of the path before the flight and densities of its bands.
    weight: LocalId,
    density: LocalId,
    /// Distance of the collision; FAR without one.
    pub(super) event: LocalId,
    /// Coefficients there: extinction, emission of media with closed forms, and scattering by phase function.
    extinction: LocalId,
    emission: LocalId,
    scattering: Vec<LocalId>,
}

/// Variables of a shadow ray by ratio tracking.
#[derive(Clone)]
pub(super) struct Ratio {
    rng: LocalId,
    weight: LocalId,
}

/// `next_random(state)`: the generator PCG-RXS-M-XS of O'Neill (2014) with 32 bits of state.
fn step_function() -> Function {
    let mut code = Code::new("next_random", None);
    let state = code.parameter("state", Ty::U32);
    code.return_(state * Expr::U32(747_796_405) + Expr::U32(2_891_336_453));
    code.finish(Some(Ty::U32))
}

/// `scramble(state)`: its output permutation.
fn scramble_function() -> Function {
    let mut code = Code::new("scramble", None);
    let state = code.parameter("state", Ty::U32);
    let shift = |a: Expr, b: Expr| Expr::binary(BinaryOp::ShiftRight, a, b);
    let by = shift(state.clone(), Expr::U32(28)) + Expr::U32(4);
    let word = Expr::binary(BinaryOp::BitXor, shift(state.clone(), by), state) * Expr::U32(277_803_737);
    let word = code.bind("word", Ty::U32, word);
    code.return_(Expr::binary(BinaryOp::BitXor, shift(word.clone(), Expr::U32(22)), word));
    code.finish(Some(Ty::U32))
}

/// The two functions of random numbers.
#[derive(Copy, Clone)]
pub(crate) struct Random {
    step: FunctionId,
    scramble: FunctionId,
}

impl Random {
    /// A number in (0, 1), from a state that is moved on.
    pub(crate) fn draw(self, code: &mut Code, rng: LocalId) -> Expr {
        code.set(rng, Expr::Call(self.step, vec![rng.into()]));
        let bits = Expr::Call(self.scramble, vec![rng.into()]);
        let top = Expr::binary(BinaryOp::ShiftRight, bits, Expr::U32(8)).convert(Prim::F32);
        code.bind("random", Ty::F32, (top + 0.5) * (1.0 / 16_777_216.0))
    }

    /// A state that has nothing in common with another's.
    pub(crate) fn mixed(self, state: Expr) -> Expr {
        Expr::Call(self.scramble, vec![Expr::Call(self.step, vec![state])])
    }
}

impl Tracer<'_> {
    pub(super) fn write_random(&mut self) -> Random {
        let step = self.builder.add_function(step_function());
        Random { step, scramble: self.builder.add_function(scramble_function()) }
    }

    /// Writes the function; its result has the fields of [`Traced`].
    pub(crate) fn write_paths(mut self, ledger: &mut Ledger) -> Traced {
        let scene = self.scene;
        let sdfs = self.sdfs();
        let random = self.write_random();
        self.random = Some(random);
        self.nearest = self.write_nearest();
        // Transmittance and depth along the first stretch are no matter of chance.
        let depth = self.wants(OutputKind::Transmittance) || self.wants(OutputKind::OpticalDepth);
        let direct = if depth { self.write_shadow(&sdfs) } else { None };
        if !scene.lights.is_empty() {
            self.transmitted = self.write_transmitted(&sdfs);
        }
        let phases = self.phase_functions();
        let (dw, lw) = (scene.depth_width, scene.light_width);
        let mut code = Code::new("path", None);
        let first =
            Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let start = code.parameter("start", Ty::F32);
        let seed = code.parameter("seed", Ty::U32);
        let zero = |width: u8| Expr::F32(0.0).splat(width);
        let one = |width: u8| Expr::F32(1.0).splat(width);
        let rng = code.var("rng", Ty::U32, seed);
        let pick = random.draw(&mut code, rng);
        let hero = Expr::math(Math::Floor, [pick * f64::from(dw)]).min(f64::from(dw - 1));
        let hero = code.bind("hero", Ty::F32, hero);
        let light = code.var("light", Ty::float(lw), zero(lw));
        let weight = code.var("weight", Ty::float(lw), one(lw));
        let density = code.var("density", Ty::float(dw), one(dw));
        let origin = code.var("from_here", Ty::VEC3, first.origin.clone());
        let direction = code.var("towards", Ty::VEC3, first.direction.clone());
        let begin = code.var("begin", Ty::F32, start.clone());
        let bounces = code.var("bounces", Ty::U32, 0u32);
        let error = code.var("cut_off", Ty::F32, 0.0);
        // Coefficients are looked at wherever a tentative collision is.
        let checked = self.wants(OutputKind::Fault) && scene.matter.iter().any(|m| !m.checks.is_empty());
        let fault = checked.then(|| code.var("fault", Ty::U32, 0u32));
        let fault_at = checked.then(|| code.var("fault_at", Ty::VEC3, zero(3)));
        code.open();
        let ray = Ray { origin: code.bind("o", Ty::VEC3, origin), direction: code.bind("d", Ty::VEC3, direction) };
        let flight = Flight {
            rng,
            hero: hero.clone(),
            survival: code.var("survival", Ty::float(dw), one(dw)),
            emitted: code.var("emitted", Ty::float(lw), zero(lw)),
            weight,
            density,
            event: code.var("event", Ty::F32, FAR),
            extinction: code.var("k_t_here", Ty::float(dw), zero(dw)),
            emission: code.var("k_e_here", Ty::float(lw), zero(lw)),
            scattering: (0..scene.phases.len())
                .map(|i| code.var(&format!("k_s_here_{i}"), Ty::float(lw), zero(lw)))
                .collect(),
        };
        let from = code.bind("begins", Ty::F32, begin);
        let hit = self.nearest.map(|nearest| {
            let arguments = vec![ray.origin.clone(), ray.direction.clone(), from.clone(), Expr::F32(FAR)];
            code.bind("hit", nearest.result, Expr::Call(nearest.function, arguments))
        });
        let end = hit.clone().map(|h| h.field(0));
        let state = State {
            depth: None,
            radiance: Some(flight.emitted),
            error: None,
            apart: Apart::default(),
            work: None,
            fault,
            fault_at,
            projected: None,
        };
        self.walk = Walk::Path(flight.clone());
        self.follow(&mut code, &ray, &state, &sdfs, &Stretch { start: from, end, whole: None }, None);
        self.walk = Walk::Eye;
        code.add(light, Expr::Local(flight.emitted));
        // Every band by its own probability over the mean of all.
        self.reweigh(&mut code, &flight, &Expr::Local(flight.survival));
        code.open();
        self.collide(&mut code, &ray, &flight, &phases, light, (origin, direction, begin));
        let collided = code.close();
        code.open();
        self.leave(&mut code, &ray, &flight, hit.as_ref(), light, bounces, (origin, direction, begin));
        let left = code.close();
        code.push_if_else(Expr::Local(flight.event).less(FAR), collided, left);
        code.add(bounces, 1u32);
        self.roulette(&mut code, &flight, bounces, error);
        let block = code.close();
        code.push_loop(block);
        let found = State { radiance: Some(light), error: Some(error), ..state };
        self.finish_path(code, (&first, &start), &found, direct.as_ref(), ledger)
    }

    /// The phase functions of the media that scatter.
    pub(super) fn phase_functions(&mut self) -> Vec<Option<PhaseFunction>> {
        let mut functions = vec![];
        for phase in &self.scene.phases {
            functions.push(phase.node.map(|node| {
                let name = format!("{}_phase", phase.name);
                phase_function(self.graph, &self.scene.tiers, self.builder, &name, node)
            }));
        }
        functions
    }

    /// The mean over the bands of a probability times the densities so far.
    fn mean_density(&self, flight: &Flight, probability: &Expr) -> Expr {
        let dw = self.scene.depth_width;
        let product = Expr::Local(flight.density) * probability.clone();
        let sum = (1..dw).fold(product.clone().component_if(dw, 0), |s, i| s + product.clone().component(i));
        (sum * (1.0 / f64::from(dw))).max(1e-37)
    }

    /// weight · f / mean and density · f / mean, for a flight of this probability in each band.
    fn reweigh(&mut self, code: &mut Code, flight: &Flight, probability: &Expr) {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let mean = code.bind("mean", Ty::F32, self.mean_density(flight, probability));
        let share = code.bind("share", Ty::float(dw), probability.clone() / mean.splat(dw));
        code.set(flight.weight, Expr::Local(flight.weight) * widen(share.clone(), dw, lw));
        code.set(flight.density, Expr::Local(flight.density) * share);
    }

    /// The component of the deciding band.
    fn heroic(&self, flight: &Flight, value: &Expr) -> Expr {
        let dw = self.scene.depth_width;
        (1..dw).fold(value.clone().component_if(dw, 0), |so_far, i| {
            flight.hero.clone().equal(f64::from(i)).select(value.clone().component(i), so_far)
        })
    }

    /// One segment of a flight: both clocks.
    pub(super) fn fly(
        &mut self,
        code: &mut Code,
        state: &State,
        media: &[Medium<'_>],
        segment: &Segment,
        flight: &Flight,
    ) {
        let Some(random) = self.random else { return };
        let Segment { ray, a, b, .. } = segment;
        let (open, closed): (Vec<&Medium<'_>>, Vec<&Medium<'_>>) = media
            .iter()
            .filter(|m| m.matter.extinction.is_some() || m.matter.emission.is_some())
            .partition(|m| self.is_tracked(m.matter));
        let closed: Vec<&Medium<'_>> = closed.into_iter().filter(|m| m.matter.extinction.is_some()).collect();
        let stop = code.var("stop", Ty::F32, b.clone());
        let ends = code.var("collides", Ty::U32, 0u32);
        if !closed.is_empty() {
            let target = -Expr::math(Math::Log, [random.draw(code, flight.rng)]);
            let target = code.bind("target", Ty::F32, target);
            self.invert(code, ray, &closed, (a, b), &target, flight, (stop, ends));
        }
        if !open.is_empty() {
            self.track(code, ray, state, (&open, &closed), a, flight, (stop, ends));
        }
        let stop = code.bind("stops", Ty::F32, stop);
        if let Some(depth) = self.depth_between(code, ray, &closed, a, &stop, "passed") {
            code.set(flight.survival, Expr::Local(flight.survival) * (-depth).exp());
        }
        code.open();
        code.set(flight.event, stop.clone());
        let sums = self.media_sums(code, ray, state, media, &stop, "here", true);
        if let Some(extinction) = sums.extinction {
            code.set(flight.extinction, extinction);
        }
        for (into, value) in flight.scattering.iter().zip(&sums.scattering) {
            code.set(*into, *value);
        }
        // What tracked media shine was counted on the way.
        let shining: Vec<&Medium<'_>> = closed.iter().copied().filter(|m| m.matter.emission.is_some()).collect();
        if !shining.is_empty() {
            let p = code.bind("p_here", Ty::VEC3, ray.at(stop.clone()));
            self.each_part(code, ray, state, &shining, (&p, &stop), &mut |code, _, part| {
                if let Some(emission) = part.emission {
                    code.add(flight.emission, emission);
                }
            });
        }
        let found = code.close();
        code.push_if(Expr::Local(ends).equal(1u32), found);
    }

    /// Whether a medium is met by delta tracking: it has no closed form, or shines in a way that collisions alone miss.
    pub(super) fn is_tracked(&self, matter: &super::matter::Matter) -> bool {
        self.open_depth(matter) || (matter.emission.is_some() && matter.source.is_none())
    }

    /// The distance at which the depth of closed media reaches the target.
    fn invert(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        closed: &[&Medium<'_>],
        (a, b): (&Expr, &Expr),
        target: &Expr,
        flight: &Flight,
        (stop, ends): (LocalId, LocalId),
    ) {
        let Some(whole) = self.depth_between(code, ray, closed, a, b, "whole") else { return };
        let whole = code.bind("whole_depth", Ty::F32, self.heroic(flight, &whole));
        code.open();
        code.set(ends, 1u32);
        if closed.iter().all(|m| m.constant.extinction.is_some()) {
            // Uniform: by proportion, or by the coefficient where there is no end.
            let unit = code.bind("one_further", Ty::F32, a.clone() + 1.0);
            let per_unit = self.depth_between(code, ray, closed, a, &unit, "per_unit");
            let k = per_unit.map_or(Expr::F32(1.0), |k| self.heroic(flight, &k)) / (unit - a.clone());
            let k = code.bind("k", Ty::F32, k);
            code.set(stop, (a.clone() + target.clone() / k.max(1e-37)).min(b.clone()));
        } else {
            let low = code.var("low", Ty::F32, 0.0);
            let high = code.var("high", Ty::F32, (b.clone() - a.clone()).min(1.0 / 4_294_967_296.0));
            // Twice as far until the target is passed, then bisection.
            code.open();
            let t = code.bind("t_high", Ty::F32, a.clone() + Expr::Local(high));
            let depth = self.depth_between(code, ray, closed, a, &t, "depth_high").unwrap_or(Expr::F32(0.0));
            let reached = self.heroic(flight, &depth).greater_equal(target.clone());
            code.break_if(
                reached.or(Expr::Local(high).greater_equal(b.clone() - a.clone())).or(Expr::Local(high).greater(1e30)),
            );
            code.set(low, high);
            code.set(high, (Expr::Local(high) * 2.0).min(b.clone() - a.clone()));
            let block = code.close();
            code.push_loop(block);
            let count = code.var("count", Ty::U32, 0u32);
            code.open();
            code.break_if(Expr::Local(count).greater_equal(24u32));
            let middle = code.bind("middle", Ty::F32, (Expr::Local(low) + Expr::Local(high)) * 0.5);
            let t = code.bind("t_middle", Ty::F32, a.clone() + middle.clone());
            let depth = self.depth_between(code, ray, closed, a, &t, "depth_middle").unwrap_or(Expr::F32(0.0));
            let beyond = code.bind("beyond", Ty::BOOL, self.heroic(flight, &depth).greater_equal(target.clone()));
            code.set(high, beyond.clone().select(middle.clone(), high));
            code.set(low, beyond.select(low, middle));
            code.add(count, 1u32);
            let block = code.close();
            code.push_loop(block);
            code.set(stop, a.clone() + (Expr::Local(low) + Expr::Local(high)) * 0.5);
        }
        let inside = code.close();
        code.push_if(whole.greater(target.clone()), inside);
    }

    /// Total extinction and emission of tracked media at a distance, in the widths of depth and light.
    fn tracked(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        open: &[&Medium<'_>],
        t: &Expr,
    ) -> (LocalId, Option<LocalId>) {
        let (dw, lw) = (self.scene.depth_width, self.source_width());
        let extinction = code.var("k_t", Ty::float(dw), Expr::F32(0.0).splat(dw));
        let shines = state.radiance.is_some() && open.iter().any(|m| m.matter.emission.is_some());
        let emission = shines.then(|| code.var("k_e", Ty::float(lw), Expr::F32(0.0).splat(lw)));
        let p = code.bind("p", Ty::VEC3, ray.at(t.clone()));
        self.each_part(code, ray, state, open, (&p, t), &mut |code, _, part| {
            if let Some(value) = part.extinction {
                code.add(extinction, value);
            }
            if let (Some(sum), Some(value)) = (emission, part.emission) {
                code.add(sum, value);
            }
        });
        (extinction, emission)
    }

    /// Delta tracking up to `stop`.
    fn track(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        (open, closed): (&[&Medium<'_>], &[&Medium<'_>]),
        a: &Expr,
        flight: &Flight,
        (stop, ends): (LocalId, LocalId),
    ) {
        let Some(random) = self.random else { return };
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let t = code.var("t_track", Ty::F32, a.clone());
        let still = self.still_rate(code, open, true);
        code.open();
        let sigma = self.tentative(code, ray, (open, true), still.as_ref(), (t, &stop.into()), flight.rng);
        let here = code.bind("t_here", Ty::F32, t);
        let (k_t, k_e) = self.tracked(code, ray, state, open, &here);
        if let Some(k_e) = k_e {
            // Every tentative collision is a sample of what shines there.
            let mut survival = Expr::Local(flight.survival);
            if let Some(depth) = self.depth_between(code, ray, closed, a, &here, "passed_here") {
                survival = survival * (-depth).exp();
            }
            let survival = code.bind("survives", Ty::float(dw), survival);
            let mean = self.mean_density(flight, &survival);
            let share = widen(survival / mean.splat(dw), dw, lw);
            let gain = Expr::Local(flight.weight) * share * Expr::Local(k_e) / sigma.clone().splat(lw);
            code.add(flight.emitted, gain);
        }
        let share = code.bind("real", Ty::float(dw), Expr::Local(k_t) / sigma.clone().splat(dw));
        let real = random.draw(code, flight.rng).less(self.heroic(flight, &share));
        code.open();
        code.set(stop, here);
        code.set(ends, 1u32);
        code.break_();
        let collision = code.close();
        code.push_if(real, collision);
        let null = (Expr::F32(1.0).splat(dw) - share).max(Expr::F32(0.0).splat(dw));
        code.set(flight.survival, Expr::Local(flight.survival) * null);
        let block = code.close();
        push_tracking(code, still, block);
    }

    /// One segment of a shadow ray: closed depth, and ratio tracking through the rest.
    pub(super) fn ratio(
        &mut self,
        code: &mut Code,
        state: &State,
        media: &[Medium<'_>],
        segment: &Segment,
        ratio: &Ratio,
    ) {
        let Some(random) = self.random else { return };
        let dw = self.scene.depth_width;
        let Segment { ray, a, b, .. } = segment;
        let (open, closed): (Vec<&Medium<'_>>, Vec<&Medium<'_>>) =
            media.iter().filter(|m| m.matter.extinction.is_some()).partition(|m| self.open_depth(m.matter));
        if let (Some(sum), Some(depth)) = (state.depth, self.depth_between(code, ray, &closed, a, b, "x")) {
            code.add(sum, depth);
        }
        if open.is_empty() {
            return;
        }
        let t = code.var("t_track", Ty::F32, a.clone());
        let still = self.still_rate(code, &open, false);
        code.open();
        let sigma = self.tentative(code, ray, (&open, false), still.as_ref(), (t, b), ratio.rng);
        let here = code.bind("t_here", Ty::F32, t);
        let (k_t, _) = self.tracked(code, ray, state, &open, &here);
        let null =
            (Expr::F32(1.0).splat(dw) - Expr::Local(k_t) / sigma.clone().splat(dw)).max(Expr::F32(0.0).splat(dw));
        let left = code.bind("left", Ty::float(dw), Expr::Local(ratio.weight) * null);
        code.set(ratio.weight, left.clone());
        let most = code.bind("most_left", Ty::F32, largest(left, dw));
        code.break_if(most.clone().equal(0.0));
        // Roulette on what hardly counts.
        code.open();
        let dies = random.draw(code, ratio.rng).greater(most.clone() * 10.0);
        code.open();
        code.set(ratio.weight, Expr::F32(0.0).splat(dw));
        code.break_();
        let dead = code.close();
        code.push_if(dies, dead);
        code.set(ratio.weight, Expr::Local(ratio.weight) / (most.clone() * 10.0).splat(dw));
        let faint = code.close();
        code.push_if(most.less(0.1), faint);
        let block = code.close();
        push_tracking(code, still, block);
    }

    /// Writes `transmitted(origin, direction, limit, seed)`, if something attenuates.
    fn write_transmitted(&mut self, sdfs: &[Option<SdfFunctions>]) -> Option<FunctionId> {
        if !self.scene.attenuates() {
            return None;
        }
        let dw = self.scene.depth_width;
        let mut code = Code::new("transmitted", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let limit = code.parameter("limit", Ty::F32);
        let seed = code.parameter("seed", Ty::U32);
        let ratio = Ratio {
            rng: code.var("rng", Ty::U32, seed),
            weight: code.var("weight", Ty::float(dw), Expr::F32(1.0).splat(dw)),
        };
        let state = State {
            depth: Some(code.var("depth", Ty::float(dw), Expr::F32(0.0).splat(dw))),
            radiance: None,
            error: None,
            apart: Apart::default(),
            work: None,
            fault: None,
            fault_at: None,
            projected: None,
        };
        let stretch = Stretch { start: Expr::F32(0.0), end: Some(limit), whole: None };
        self.follow_towards(&mut code, Walk::Ratio(ratio.clone()), (&ray, &state), sdfs, &stretch);
        let depth = state.depth.map_or(Expr::F32(0.0), Expr::Local);
        code.return_(Expr::Local(ratio.weight) * (-depth).exp());
        Some(self.builder.add_function(code.finish(Some(Ty::float(dw)))))
    }

    /// What a phase function scatters from the direction to the light into the path. Where the angle between them was drawn, its
    /// versine and vercosine come along: the directions themselves are too coarse for the narrowest lobes.
    pub(super) fn phase_value(
        &mut self,
        code: &mut Code,
        function: Option<&PhaseFunction>,
        index: usize,
        p: &Expr,
        (to, drawn): (&Expr, Option<&(Expr, Expr)>),
        direction: &Expr,
    ) -> Expr {
        let lw = self.scene.light_width;
        let Some(function) = function else { return Expr::F32(0.25 / PI).splat(lw) };
        let arguments = self.phase_arguments(code, function, p, (to, drawn), direction);
        let width = self.scene.phases[index].node.map_or(1, |n| self.graph.width(n));
        let value = Expr::Call(function.id, arguments).max(Expr::F32(0.0).splat(width));
        widen(code.bind("phase", Ty::float(width), value), width, lw)
    }

    /// The arguments of a phase function at a point, for light that comes from `to` and goes on against `direction`.
    fn phase_arguments(
        &mut self,
        code: &mut Code,
        function: &PhaseFunction,
        p: &Expr,
        (to, drawn): (&Expr, Option<&(Expr, Expr)>),
        direction: &Expr,
    ) -> Vec<Expr> {
        let half_square = |v: Expr| {
            let v = Expr::math(Math::Length, [v]);
            v.clone() * v * 0.5
        };
        let mut arguments = vec![];
        for input in &function.inputs {
            arguments.push(match input {
                Input::Position => p.clone(),
                // Light travels from the light to the point.
                Input::Direction => -to.clone(),
                Input::CosTheta => match drawn {
                    Some((versine, vercosine)) => (vercosine.clone() - versine.clone()) * 0.5,
                    None => Expr::math(Math::Clamp, [to.clone().dot(direction.clone()), (-1.0).into(), 1.0.into()]),
                },
                Input::Versine => drawn.map_or_else(|| half_square(to.clone() - direction.clone()), |d| d.0.clone()),
                Input::Vercosine => drawn.map_or_else(|| half_square(to.clone() + direction.clone()), |d| d.1.clone()),
                // Time is a uniform.
                Input::Time => continue,
                Input::Altitude(shell) => {
                    let ray = Ray { origin: p.clone(), direction: direction.clone() };
                    self.altitude(code, &ray, *shell, &Expr::F32(0.0))
                }
            });
        }
        arguments
    }

    /// Adds light of all lights at a point, each by one sample, weighted by a function of its direction.
    fn next_event(
        &mut self,
        code: &mut Code,
        p: &Expr,
        flight: &Flight,
        light: LocalId,
        weigh: &mut dyn FnMut(&mut Self, &mut Code, &LightSample) -> Expr,
    ) {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let Some(random) = self.random else { return };
        let receiver = Receiver::Path { rng: flight.rng };
        self.samples(code, p, &receiver, &mut |this, code, sample| {
            let weight = weigh(this, code, sample);
            let part = Expr::Local(flight.weight) * weight * sample.irradiance.clone();
            let part = code.bind("part", Ty::float(lw), part);
            let mut worth = code.bind("worth", Ty::BOOL, largest(part.clone(), lw).greater(0.0));
            if let Some(nearest) = this.nearest {
                let arguments = vec![p.clone(), sample.to.clone(), Expr::F32(0.0), sample.limit.clone()];
                let blocked = code.var("blocked", Ty::BOOL, !worth.clone());
                code.open();
                let hit = Expr::Call(nearest.function, arguments).field(0);
                code.set(blocked, hit.less(sample.limit.clone()));
                let ask = code.close();
                code.push_if(worth, ask);
                worth = code.bind("clear", Ty::BOOL, !Expr::Local(blocked));
            }
            code.open();
            match this.transmitted {
                Some(function) => {
                    code.set(flight.rng, Expr::Call(random.step, vec![flight.rng.into()]));
                    let seed = random.mixed(flight.rng.into());
                    let arguments = vec![p.clone(), sample.to.clone(), sample.limit.clone(), seed];
                    let t = code.bind("through", Ty::float(dw), Expr::Call(function, arguments));
                    code.add(light, part * widen(t, dw, lw));
                }
                None => code.add(light, part),
            }
            let body = code.close();
            code.push_if(worth, body);
        });
    }

    /// Emission, next-event estimation and a new direction at a collision.
    fn collide(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        flight: &Flight,
        phases: &[Option<PhaseFunction>],
        light: LocalId,
        (origin, direction, begin): (LocalId, LocalId, LocalId),
    ) {
        let Some(random) = self.random else { return };
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let p = code.bind("at", Ty::VEC3, ray.at(flight.event.into()));
        if self.scene.matter.iter().any(|m| m.emission.is_some() && !self.is_tracked(m)) {
            let mean = self.mean_density(flight, &Expr::Local(flight.extinction));
            let mean = code.bind("mean_k_t", Ty::F32, mean);
            let gain = Expr::Local(flight.weight) * Expr::Local(flight.emission) / mean.splat(lw);
            code.add(light, gain);
        }
        if phases.is_empty() {
            // Nothing scatters: what is hit absorbs.
            code.break_();
            return;
        }
        // One phase function of those that scatter here, by what each scatters in the deciding band. Every band has its own
        // probability of that choice, which counts like those of the flight: else weights would drift where media overlap.
        let narrow = |k: LocalId| if dw == lw { Expr::Local(k) } else { Expr::Local(k).component_if(lw, 0) };
        let own: Vec<Expr> =
            flight.scattering.iter().map(|k| code.bind("k_s_own", Ty::F32, self.heroic(flight, &narrow(*k)))).collect();
        let total = own.iter().cloned().reduce(|a, b| a + b).unwrap_or(Expr::F32(0.0));
        let total = code.bind("k_s_total", Ty::F32, total);
        code.break_if(total.clone().less_equal(0.0));
        let which = code.var("which", Ty::U32, 0u32);
        let chosen = code.var("k_s_chosen", Ty::float(lw), Expr::F32(0.0).splat(lw));
        let mut density = Expr::Local(flight.extinction);
        if flight.scattering.len() == 1 {
            code.set(chosen, flight.scattering[0]);
        } else {
            let pick = random.draw(code, flight.rng) * total;
            let pick = code.var("pick", Ty::F32, pick);
            let last = flight.scattering.len() - 1;
            for (i, (k, own)) in flight.scattering.iter().zip(&own).enumerate() {
                let below = if i == last { Expr::F32(FAR) } else { own.clone() };
                let mine = Expr::Local(pick).greater_equal(0.0).and(Expr::Local(pick).less(below));
                code.if_(mine, |code| {
                    code.set(which, i as u32);
                    code.set(chosen, *k);
                });
                code.set(pick, Expr::Local(pick) - own.clone());
            }
            let all = flight.scattering.iter().map(|k| narrow(*k)).reduce(|a, b| a + b).unwrap_or(Expr::F32(1.0));
            density = density * narrow(chosen) / all.max(Expr::F32(1e-37).splat(dw));
        }
        let density = code.bind("chance", Ty::float(dw), density);
        let mean = code.bind("mean_chance", Ty::F32, self.mean_density(flight, &density));
        code.set(flight.density, Expr::Local(flight.density) * density / mean.clone().splat(dw));
        let scattered = Expr::Local(chosen) / mean.splat(lw);
        code.set(flight.weight, Expr::Local(flight.weight) * scattered);
        let value = |this: &mut Self, code: &mut Code, to: (&Expr, Option<&(Expr, Expr)>)| {
            if phases.len() == 1 {
                return this.phase_value(code, phases[0].as_ref(), 0, &p, to, &ray.direction);
            }
            let out = code.var("phase_value", Ty::float(lw), Expr::F32(0.0).splat(lw));
            for (i, function) in phases.iter().enumerate() {
                code.open();
                let value = this.phase_value(code, function.as_ref(), i, &p, to, &ray.direction);
                code.set(out, value);
                let body = code.close();
                code.push_if(Expr::Local(which).equal(i as u32), body);
            }
            code.bind("phase_here", Ty::float(lw), out)
        };
        self.next_event(code, &p, flight, light, &mut |this, code, sample| value(this, code, (&sample.to, None)));
        // A direction by the parts into which the phase function divides the sphere; what they lack in detail, the weight makes
        // up for.
        let u = random.draw(code, flight.rng);
        let versine = code.var("drawn_versine", Ty::F32, u.clone() * 2.0);
        let vercosine = code.var("drawn_vercosine", Ty::F32, Expr::F32(2.0) - u.clone() * 2.0);
        let density = code.var("pdf", Ty::F32, 0.25 / PI);
        for (i, phase) in self.scene.phases.iter().enumerate() {
            let Some(table) = phase.draws else { continue };
            code.open();
            let turn = self.builder.call(self.graph, Helper::Lookup(table), [u.clone()]);
            let turn = code.bind("turn", Ty::float(2), turn);
            code.set(versine, turn.clone().component(0));
            code.set(vercosine, turn.clone().component(1));
            let slope = self.builder.call(self.graph, Helper::LookupSlope(table), [u.clone()]);
            let slope = code.bind("slope", Ty::float(2), slope);
            // The smaller of the two has all of its digits.
            let forward = turn.clone().component(0).less(turn.component(1));
            let slope = forward.select(slope.clone().component(0), -slope.component(1));
            code.set(density, Expr::F32(0.5 / PI) / slope.max(1e-30));
            let body = code.close();
            code.push_if(Expr::Local(which).equal(i as u32), body);
        }
        let frame = Self::across(code, &ray.direction);
        let turns = random.draw(code, flight.rng);
        let drawn = (code.bind("versine", Ty::F32, versine), code.bind("vercosine", Ty::F32, vercosine));
        let density = code.bind("chance_of_direction", Ty::F32, density);
        let to = Self::around(code, &ray.direction, &frame, (&drawn.0, &drawn.1), turns);
        let phase = value(self, code, (&to, Some(&drawn)));
        code.set(flight.weight, Expr::Local(flight.weight) * phase / density.splat(lw));
        code.set(origin, p.clone());
        code.set(direction, to);
        code.set(begin, 0.0);
    }

    /// A ray that meets a surface is reflected; one that meets none ends in the sky.
    fn leave(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        flight: &Flight,
        hit: Option<&Expr>,
        light: LocalId,
        bounces: LocalId,
        (origin, direction, begin): (LocalId, LocalId, LocalId),
    ) {
        let lw = self.scene.light_width;
        let Some(random) = self.random else { return };
        let escape = |this: &mut Self, code: &mut Code| {
            if let Some(sky) = this.background(code, ray) {
                code.open();
                code.add(light, Expr::Local(flight.weight) * sky);
                let seen = code.close();
                // A mere background is seen, but shines on nothing.
                let shines = if this.scene.environment { Expr::Bool(true) } else { Expr::Local(bounces).equal(0u32) };
                code.push_if(shines, seen);
            }
            // Discs of suns were asked for at every collision; only the eye sees them directly.
            if let Some(discs) = this.discs(code, ray) {
                code.open();
                code.add(light, Expr::Local(flight.weight) * discs);
                let seen = code.close();
                code.push_if(Expr::Local(bounces).equal(0u32), seen);
            }
            code.break_();
        };
        let Some(hit) = hit else {
            escape(self, code);
            return;
        };
        let t = hit.clone().field(0);
        code.open();
        escape(self, code);
        let free = code.close();
        code.push_if(t.clone().greater_equal(FAR), free);
        let normal = code.bind("surface_normal", Ty::VEC3, hit.clone().field(1));
        let at = code.bind("on_surface", Ty::VEC3, ray.at(t.clone()));
        let above = Self::above(code, at, &normal, &t);
        let albedo = self.albedo(code, &above, &hit.clone().field(2));
        code.break_if(largest(albedo.into(), lw).less_equal(0.0));
        code.set(flight.weight, Expr::Local(flight.weight) * Expr::Local(albedo));
        let up = normal.clone();
        self.next_event(code, &above, flight, light, &mut |_, code, sample| {
            let cosine = code.bind("cosine", Ty::F32, sample.to.clone().dot(up.clone()).max(0.0));
            (cosine * (1.0 / PI)).splat(lw)
        });
        let frame = Self::across(code, &normal);
        let u = random.draw(code, flight.rng);
        let mu = code.bind("mu", Ty::F32, u.sqrt());
        let turns = random.draw(code, flight.rng);
        let (versine, vercosine) = (Expr::F32(1.0) - mu.clone(), Expr::F32(1.0) + mu);
        let to = Self::around(code, &normal, &frame, (&versine, &vercosine), turns);
        code.set(origin, above);
        code.set(direction, to);
        code.set(begin, 0.0);
    }

    /// Ends paths that hardly count, and those that never end.
    fn roulette(&mut self, code: &mut Code, flight: &Flight, bounces: LocalId, error: LocalId) {
        let lw = self.scene.light_width;
        let Some(random) = self.random else { return };
        let most = code.bind("most_weight", Ty::F32, largest(flight.weight.into(), lw));
        code.break_if(most.clone().less_equal(0.0));
        code.open();
        let chance = code.bind("survives", Ty::F32, most.clone().min(1.0));
        let dies = random.draw(code, flight.rng).greater(chance.clone());
        code.break_if(dies);
        code.set(flight.weight, Expr::Local(flight.weight) / chance.splat(lw));
        let late = code.close();
        code.push_if(Expr::Local(bounces).greater(SURE), late);
        let cap = self.builder.frame(FrameValue::MaxWork);
        code.open();
        // What a longer path would have brought is not known; its weight says how much it could.
        code.add(error, most);
        code.break_();
        let cut = code.close();
        code.push_if(Expr::Local(bounces).greater_equal(cap), cut);
    }

    fn finish_path(
        self,
        mut code: Code,
        (ray, start): (&Ray, &Expr),
        found: &State,
        direct: Option<&super::light::Shadow>,
        ledger: &mut Ledger,
    ) -> Traced {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        ledger.omit("nested light integrals", "paths of all orders are followed one by one", None);
        // The same for every path, and read from those that come first alone.
        let depth = direct.map(|shadow| {
            let depth = code.var("direct_depth", Ty::float(dw), Expr::F32(0.0).splat(dw));
            code.open();
            let end = match self.nearest {
                Some(nearest) => {
                    let arguments = vec![ray.origin.clone(), ray.direction.clone(), start.clone(), Expr::F32(FAR)];
                    Expr::Call(nearest.function, arguments).field(0)
                }
                None => Expr::F32(FAR),
            };
            let end = code.bind("first_end", Ty::F32, end);
            let limit = end.clone().greater_equal(FAR).select(FAR, end - start.clone());
            let mut arguments = vec![ray.at(start.clone()), ray.direction.clone(), limit];
            if shadow.stepped {
                arguments.push(Expr::F32(0.0));
            }
            let value = code.bind("direct", shadow.result, Expr::Call(shadow.function, arguments));
            code.set(depth, shadow.depth(&value));
            let first = code.close();
            code.push_if(self.builder.frame(FrameValue::FirstPath).equal(0u32), first);
            Expr::Local(depth)
        });
        let cut = cut_short(self.builder, &mut code);
        let fault = found.fault.map_or(Expr::U32(0), Expr::Local);
        let fault = code.bind("bits", Ty::F32, cut.select(Expr::U32(Fault::CUT_SHORT), fault).bitcast(Prim::F32));
        let fault_at = found.fault_at.map_or(Expr::F32(0.0).splat(3), Expr::Local);
        let mut fields: Vec<(OutputKind, u8)> = vec![];
        let mut values = vec![];
        for kind in self.wanted.clone() {
            let (width, value) = match kind {
                OutputKind::Radiance => (lw, found.radiance.map_or(Expr::F32(0.0).splat(lw), Expr::Local)),
                OutputKind::Transmittance => (dw, depth.clone().map_or(Expr::F32(1.0), |d| (-d).exp())),
                OutputKind::OpticalDepth => (dw, depth.clone().unwrap_or(Expr::F32(0.0))),
                OutputKind::Error => (1, found.error.map_or(Expr::F32(0.0), Expr::Local)),
                OutputKind::Fault => {
                    let at = (0..3).map(|i| fault_at.clone().component(i));
                    (4, Expr::Compose(Ty::float(4), [fault.clone()].into_iter().chain(at).collect()))
                }
                OutputKind::Rounding | OutputKind::Storage | OutputKind::Evaluations | OutputKind::Edge => continue,
            };
            fields.push((kind, width));
            values.push(value);
        }
        let names = fields.iter().map(|(kind, width)| (super::output_name(*kind).to_owned(), Ty::float(*width)));
        let result = self.builder.add_struct("Traced", names.collect());
        code.return_(Expr::Compose(result, values));
        let function = self.builder.add_function(code.finish(Some(result)));
        Traced { function, fields, random: self.random, fill: None }
    }
}
