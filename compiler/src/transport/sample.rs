//! Evaluates all media at a point of the ray: extinction, and everything that sends light towards the eye from there.

use super::light::InScattered;
use super::matter::Matter;
use super::media::{Medium, Varying};
use super::shapes::{FAR, Ray};
use super::stride::PLACE;
use super::trace::{ComponentIf, State, Tracer, Walk, largest, widen};
use crate::fields::Code;
use crate::program::kernel::{BinaryOp, Expr, LocalId, Math, Prim, Ty};

/// A sample of all media at a point.
pub(super) struct Sampled {
    pub(super) extinction: Option<Expr>,
    /// Emission and in-scattered light, per length.
    pub(super) source: Option<Expr>,
    /// What the latter may be wrong by, the largest over the bands.
    pub(super) source_error: Option<Expr>,
    /// By the number of a medium's bounds, the scalar without which there is nothing of it.
    pub(super) supports: Vec<(u32, Expr)>,
}

/// Sums over the media that are here.
pub(super) struct Sums {
    pub(super) extinction: Option<LocalId>,
    /// Of the media whose depths towards lights are kept, where that is not all.
    k_open: Option<LocalId>,
    pub(super) source: Option<LocalId>,
    /// By phase function.
    pub(super) scattering: Vec<LocalId>,
    /// By the number of a medium's bounds.
    supports: Vec<(u32, LocalId)>,
}

/// What one medium adds, in the widths of the scene.
pub(super) struct Part {
    pub(super) extinction: Option<Expr>,
    pub(super) emission: Option<Expr>,
    pub(super) scattering: Option<Expr>,
    support: Option<(u32, Expr)>,
}

impl Tracer<'_> {
    /// The altitude over a shell at a distance along the ray, without cancelling in the distance.
    pub(super) fn altitude(&mut self, code: &mut Code, ray: &Ray, shell: u32, t: &Expr) -> Expr {
        let (center, radius) = self.shells[shell as usize];
        let center = self.builder.value(self.graph, center, "shell_center");
        let radius = self.builder.value(self.graph, radius, "shell_radius");
        let from = code.bind("from_center", Ty::VEC3, ray.origin.clone() - center);
        let r = code.bind("r", Ty::F32, Expr::math(Math::Length, [from.clone()]));
        let gain = (from.dot(ray.direction.clone()) * 2.0 + t.clone()) * t.clone();
        let gain = code.bind("gain", Ty::F32, gain);
        r.clone() - radius + gain.clone() / ((r.clone() * r.clone() + gain).max(0.0).sqrt() + r)
    }

    /// Evaluates all media at a distance along the ray.
    pub(super) fn sample(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        media: &[Medium<'_>],
        t: Expr,
        tag: &str,
    ) -> Sampled {
        let (dw, lw) = (self.scene.depth_width, self.source_width());
        let t = code.bind(&format!("t_{tag}"), Ty::F32, t);
        let p = code.bind(&format!("p_{tag}"), Ty::VEC3, ray.at(t.clone()));
        let lights = self.in_scattered.clone().filter(|_| state.radiance.is_some());
        let single = media.len() == 1 && media[0].here.is_none() && lights.is_none();
        if single {
            let part = self.sample_one(code, ray, state, &media[0], (&p, &t), &mut None);
            let extinction = part.extinction.map(|e| code.bind(&format!("k_t_{tag}"), Ty::float(dw), e));
            let source = part.emission.map(|e| code.bind(&format!("k_e_{tag}"), Ty::float(lw), e));
            return Sampled { extinction, source, source_error: None, supports: part.support.into_iter().collect() };
        }
        let sums = self.media_sums(code, ray, state, media, &t, tag, lights.is_some());
        let mut source_error = None;
        if let (Some(lights), Some(source)) = (lights, sums.source) {
            source_error = self.add_scattered(code, ray, state, &lights, (&sums, source), &p, tag);
        }
        let bind = |code: &mut Code, var: Option<LocalId>, name: &str, width: u8| {
            var.map(|v| code.bind(&format!("{name}_{tag}"), Ty::float(width), v))
        };
        Sampled {
            extinction: bind(code, sums.extinction, "k_t", dw),
            source: bind(code, sums.source, "source", lw),
            source_error: source_error.map(Expr::Local),
            supports: sums.supports.into_iter().map(|(number, var)| (number, var.into())).collect(),
        }
    }

    /// Adds up what all media that are here have at a distance along the ray.
    pub(super) fn media_sums(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        media: &[Medium<'_>],
        t: &Expr,
        tag: &str,
        scatters: bool,
    ) -> Sums {
        let (dw, lw) = (self.scene.depth_width, self.source_width());
        let p = code.bind(&format!("at_{tag}"), Ty::VEC3, ray.at(t.clone()));
        let zero = |width: u8| Expr::F32(0.0).splat(width);
        let attenuates = media.iter().any(|m| m.matter.extinction.is_some());
        let extinction = attenuates.then(|| code.var(&format!("k_t_{tag}"), Ty::float(dw), zero(dw)));
        let source = state.radiance.map(|_| code.var(&format!("source_{tag}"), Ty::float(lw), zero(lw)));
        // Scattering is added up per phase function, so that lights are asked once, and only where something scatters.
        let count = if scatters { self.scene.phases.len() } else { 0 };
        let scattering: Vec<LocalId> =
            (0..count).map(|i| code.var(&format!("k_s_{tag}_{i}"), Ty::float(lw), zero(lw))).collect();
        let told = scatters && self.in_scattered.as_ref().is_some_and(|l| l.k_open);
        let open: Vec<u32> = media.iter().map(|m| m.matter).filter(|m| self.open_depth(m)).map(|m| m.index).collect();
        let closed = media.iter().any(|m| m.matter.extinction.is_some() && !open.contains(&m.matter.index));
        let k_open = (told && closed).then(|| code.var(&format!("k_open_{tag}"), Ty::float(dw), zero(dw)));
        let supported = media.iter().filter_map(|m| m.support_at);
        let supports: Vec<(u32, LocalId)> =
            supported.map(|(n, _)| (n, code.var(&format!("support_{tag}_{n}"), Ty::F32, -FAR))).collect();
        let all: Vec<&Medium<'_>> = media.iter().collect();
        self.each_part(code, ray, state, &all, (&p, t), &mut |code, matter, part| {
            if let (Some(total), Some(value)) = (extinction, part.extinction) {
                if let Some(k_open) = k_open.filter(|_| open.contains(&matter.index)) {
                    code.add(k_open, value.clone());
                }
                code.add(total, value);
            }
            if let (Some(total), Some(value)) = (source, part.emission) {
                code.add(total, value);
            }
            if let (Some(total), Some(value)) = (scattering.get(matter.phase), part.scattering) {
                code.add(*total, value);
            }
            if let Some((number, value)) = part.support {
                let own = supports.iter().filter(|s| s.0 == number);
                own.for_each(|(_, var)| code.set(*var, value.clone()));
            }
        });
        Sums { extinction, k_open, source, scattering, supports }
    }

    /// Adds k_s times the in-scattered light of each phase function to the source.
    fn add_scattered(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        lights: &InScattered,
        (sums, source): (&Sums, LocalId),
        p: &Expr,
        tag: &str,
    ) -> Option<LocalId> {
        let (dw, lw) = (self.scene.depth_width, self.source_width());
        let scattering = &sums.scattering;
        let most = scattering.iter().map(|k| largest(Expr::Local(*k), lw)).reduce(Expr::max);
        let most = most.unwrap_or(Expr::F32(0.0));
        let most = code.bind("k_s_most", Ty::F32, most);
        let error = lights.error.filter(|_| state.error.is_some());
        let error_var = error.map(|_| code.var(&format!("source_error_{tag}"), Ty::F32, 0.0));
        code.open();
        let mut arguments = vec![p.clone(), ray.direction.clone()];
        if lights.unsure {
            // How far the place is rounded, in optical depth.
            let place = largest(p.clone().abs(), 3) + largest(ray.origin.clone().abs(), 3);
            let dense = sums.extinction.map_or(Expr::F32(0.0), |k| largest(k.into(), dw));
            arguments.push((dense * (place * PLACE)).min(1e30));
        }
        if lights.k_open {
            let known = sums.k_open.or(sums.extinction).map(Expr::Local);
            arguments.push(known.unwrap_or_else(|| Expr::F32(0.0).splat(dw)));
        }
        arguments.extend(self.plane.clone().filter(|_| lights.plane));
        let gathered = code.bind("in_scattered", lights.result, Expr::Call(lights.function, arguments));
        for (i, k_s) in scattering.iter().enumerate() {
            code.add(source, Expr::Local(*k_s) * lights.light(&gathered, i));
        }
        if let (Some(error), Some(var)) = (error, error_var) {
            code.set(var, most.clone() * gathered.clone().field(error));
        }
        if let (Some(work), Some(looks)) = (state.work, self.looks()) {
            code.add(work, looks);
        }
        if let (Some(work), Some(field)) = (state.work, lights.work) {
            code.add(work, gathered.field(field).convert(Prim::U32));
        }
        let body = code.close();
        code.push_if(most.greater(0.0), body);
        error_var
    }

    /// Components of what sends light from within the media.
    pub(super) fn source_width(&self) -> u8 {
        if self.in_scattered.is_some() || matches!(self.walk, Walk::Path(_)) {
            return self.scene.light_width;
        }
        self.scene.matter.iter().map(|m| self.width(m.emission)).max().unwrap_or(1)
    }

    /// Evaluates the media that are at a place on the ray, and does something with what each adds.
    pub(super) fn each_part(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        media: &[&Medium<'_>],
        at: (&Expr, &Expr),
        add: &mut dyn FnMut(&mut Code, &Matter, Part),
    ) {
        self.each_group(code, media, &mut |tracer, code, together| {
            let mut value = None;
            for medium in together {
                let part = tracer.sample_one(code, ray, state, medium, at, &mut value);
                add(code, medium.matter, part);
            }
        });
    }

    /// Evaluates one medium. `value` is what the function that it shares with others gave, once that was called.
    fn sample_one(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        medium: &Medium<'_>,
        (p, t): (&Expr, &Expr),
        value: &mut Option<Expr>,
    ) -> Part {
        let (dw, lw) = (self.scene.depth_width, self.source_width());
        let matter = medium.matter;
        let mut extinction = medium.constant.extinction.clone();
        let mut emission = medium.constant.emission.clone();
        let mut scattering = medium.constant.scattering.clone();
        let mut support = None;
        if let Some(Varying { name, function, hoisted }) = medium.varying.as_deref() {
            let value = value.get_or_insert_with(|| self.call(code, ray, (function, hoisted), (p, t), name)).clone();
            let part = |i: usize| function.part(&value, i);
            if let (Some(fault), Some(fault_at)) = (state.fault, state.fault_at) {
                for (at, negative, not_finite) in &medium.checks_at {
                    let width = self.check_width(matter, *at, medium);
                    check(code, fault, fault_at, part(*at), width, *negative, *not_finite, p);
                }
            }
            extinction = medium.extinction_at.map(part).or(extinction);
            emission = medium.emission_at.map(part).or(emission);
            scattering = medium.scattering_at.map(part).or(scattering);
            support = medium.support_at.map(|(number, at)| (number, part(at)));
        }
        // A value that was reported must not spread.
        let guard = |value: Expr, width: u8, to: u8, varies: bool| {
            let value = if varies && !matter.checks.is_empty() {
                Expr::math(Math::Clamp, [value, Expr::F32(0.0).splat(width), Expr::F32(FAR).splat(width)])
            } else {
                value
            };
            widen(value, width, to)
        };
        let width = |n| self.width(n);
        let extinction = extinction.map(|e| guard(e, width(matter.extinction), dw, medium.extinction_at.is_some()));
        let emission = emission.map(|e| guard(e, width(matter.emission), lw, medium.emission_at.is_some()));
        let scattering = scattering.map(|e| guard(e, width(matter.scattering), lw, medium.scattering_at.is_some()));
        let light = state.radiance.is_some();
        Part { extinction, emission: emission.filter(|_| light), scattering: scattering.filter(|_| light), support }
    }

    fn check_width(&self, matter: &Matter, at: usize, medium: &Medium<'_>) -> u8 {
        let own = [
            (medium.extinction_at, matter.extinction),
            (medium.emission_at, matter.emission),
            (medium.scattering_at, matter.scattering),
        ];
        if let Some((_, node)) = own.into_iter().find(|(place, _)| *place == Some(at)) {
            return self.width(node);
        }
        matter
            .checks
            .iter()
            .zip(&medium.checks_at)
            .find(|(_, c)| c.0 == at)
            .map_or(1, |(c, _)| self.graph.width(c.node))
    }
}

/// Notes the first value that is negative or not finite. By bits, since shaders may assume that such values do not occur:
/// read as u32, only finite numbers ≥ +0 are at most 7f7fffff, and −0 is harmless.
fn check(
    code: &mut Code,
    fault: LocalId,
    fault_at: LocalId,
    value: Expr,
    width: u8,
    negative: u32,
    not_finite: u32,
    p: &Expr,
) {
    for i in 0..width {
        let bits = code.bind("bits", Ty::U32, value.clone().component_if(width, i).bitcast(Prim::U32));
        let bad =
            bits.clone().greater(0x7f7f_ffffu32).and(Expr::binary(BinaryOp::NotEqual, bits.clone(), 0x8000_0000u32));
        let bad = bad.and(Expr::Local(fault).equal(0u32));
        code.if_(bad, |code| {
            let magnitude = Expr::binary(BinaryOp::BitAnd, bits, 0x7fff_ffffu32);
            let infinite = magnitude.greater_equal(0x7f80_0000u32);
            code.set(fault, infinite.select(not_finite, negative));
            code.set(fault_at, p.clone());
        });
    }
}
