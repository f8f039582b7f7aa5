//! Light of lights at a point: what media scatter towards the eye, and what falls on surfaces.
//!
//! Every light is a set of samples, each a direction and an irradiance on a plane facing it: one sample for a point or for
//! parallel light, a spiral over the disc of a sun (Vogel 1979), a Fibonacci lattice over the sphere for an environment
//! (Swinbank and Purser 2006), there drawn to where the phase function sends light. What a sample brings is attenuated by
//! e^(−τ) along the way to its light and lost behind a surface.

use super::cache::{Channel, DISC};
use super::shapes::{FAR, Ray};
use super::trace::{Tracer, largest, least, widen};
use crate::fields::{Code, Writer};
use crate::ir::{Input, Light, LightKind};
use crate::program::kernel::{Expr, FunctionId, LocalId, Math, Ty};
use crate::program::{FrameValue, Ledger, OutputKind, StepRule};
use std::f64::consts::PI;

/// 1 − 1/φ, in turns.
pub(super) const GOLDEN: f64 = 0.381_966_011_250_105_1;
/// Phase functions with a mean cosine below this are sampled evenly.
const NARROW: f64 = 0.3;
/// The largest mean cosine that directions are drawn for: narrower lobes are as wide as a direction's rounding.
const NARROWEST: f64 = 0.999_999;

/// The function `in_scattered(p, direction)`: ∫ phase · L_in dω for each phase function.
#[derive(Clone)]
pub(super) struct InScattered {
    pub(super) function: FunctionId,
    pub(super) result: Ty,
    /// Whether the result is a struct.
    many: bool,
    /// Field of the error.
    pub(super) error: Option<u32>,
    /// Field of the number of evaluations.
    pub(super) work: Option<u32>,
    /// Whether the function takes the optical depth that the rounding of its place may make.
    pub(super) unsure: bool,
    /// Whether it takes the extinction there of the media whose depths are kept.
    pub(super) k_open: bool,
    /// Whether it takes where the plane is behind which light is looked up.
    pub(super) plane: bool,
}

impl InScattered {
    /// What phase function `i` gathers.
    pub(super) fn light(&self, gathered: &Expr, i: usize) -> Expr {
        if self.many { gathered.clone().field(i as u32) } else { gathered.clone() }
    }
}

/// The function `shadow(origin, direction, limit, dim)`: optical depth towards a light.
#[derive(Clone)]
pub(super) struct Shadow {
    pub(super) function: FunctionId,
    pub(super) result: Ty,
    pub(super) error: Option<u32>,
    pub(super) work: Option<u32>,
    /// Whether steps are taken, so that a tolerance matters.
    pub(super) stepped: bool,
}

impl Shadow {
    /// The optical depth in a value that it returned.
    pub(super) fn depth(&self, value: &Expr) -> Expr {
        let plain = self.error.is_none() && self.work.is_none();
        if plain { value.clone() } else { value.clone().field(0) }
    }
}

/// One sample of a light.
pub(super) struct LightSample {
    /// Unit vector towards the light.
    pub(super) to: Expr,
    /// How far media and surfaces count.
    pub(super) limit: Expr,
    /// On a plane facing it, in the width of light.
    pub(super) irradiance: Expr,
    /// Of a light with many samples: whether this one has an even number.
    pub(super) even: Option<Expr>,
    /// Where its column is kept.
    pub(super) channel: Channel,
}

/// Who gathers light.
pub(super) enum Receiver<'r> {
    /// A medium; the eye looks along `direction`. Of phase functions with a narrow lobe, the mean cosine of the narrowest.
    Medium { direction: &'r Expr, narrow: Option<f64> },
    /// A surface with this normal.
    Surface { normal: &'r Expr },
    /// A vertex of a path, which takes one sample of each light at random, and none of the environment.
    Path { rng: LocalId },
}

/// The sums of a gathering function.
pub(super) struct Gathered {
    pub(super) sums: Vec<LocalId>,
    /// Of each light with many samples, the sum of the even ones less that of the odd ones, of the brightest band: by the number
    /// of the light, of an environment without one.
    pub(super) alternating: Vec<(Option<u32>, LocalId)>,
    pub(super) error: Option<LocalId>,
    /// How much optical depth the rounding of the place may make, where that is counted.
    pub(super) unsure: Option<Expr>,
    /// Extinction there of the media whose depths are kept.
    pub(super) k_open: Option<Expr>,
    /// The plane behind which light is looked up.
    pub(super) plane: Option<Expr>,
    pub(super) work: Option<LocalId>,
    /// The brightest light that a sample brought, whatever it counts.
    pub(super) brightest: Option<LocalId>,
}

impl Gathered {
    /// Adds what lights with many samples may be wrong by for their number to the error.
    pub(super) fn count_alternating(&self, code: &mut Code) {
        for (number, alternating) in &self.alternating {
            let Some(error) = self.error else { continue };
            // Half the samples of a sky alone would be wrong by about half this difference, all of them by less. A disc is cut by
            // edges, where points on a spiral converge more slowly.
            let share = if number.is_some() { 0.5 } else { 0.25 };
            code.add(error, Expr::Local(*alternating).abs() * share);
        }
    }
}

impl Tracer<'_> {
    /// Number of samples of an environment or of a disc.
    fn count(&self, per_accuracy: f64, least: u32, most: u32) -> u32 {
        let wanted = per_accuracy / self.rule.accuracy().unwrap_or(1e-2);
        (wanted.ceil() as u32).clamp(least, most)
    }

    pub(super) fn fract(code: &mut Code, x: Expr) -> Expr {
        let x = code.bind("turns", Ty::F32, x);
        x.clone() - Expr::math(Math::Floor, [x])
    }

    /// Two unit vectors across a third (Duff et al. 2017).
    pub(super) fn across(code: &mut Code, axis: &Expr) -> (Expr, Expr) {
        let n = |i| axis.clone().component(i);
        let sign = code.bind("sign", Ty::F32, n(2).greater_equal(0.0).select(1.0, -1.0));
        let a = code.bind("a", Ty::F32, Expr::F32(-1.0) / (sign.clone() + n(2)));
        let b = code.bind("b", Ty::F32, n(0) * n(1) * a.clone());
        let one = Expr::F32(1.0) + sign.clone() * n(0) * n(0) * a.clone();
        let u = Expr::Compose(Ty::VEC3, vec![one, sign.clone() * b.clone(), -(sign.clone() * n(0))]);
        let v = Expr::Compose(Ty::VEC3, vec![b, sign + n(1) * n(1) * a, -n(1)]);
        (code.bind("u", Ty::VEC3, u), code.bind("v", Ty::VEC3, v))
    }

    /// The direction at an angle from an axis, `turns` around it. The versine and vercosine are 1 − cos and 1 + cos of the angle:
    /// in f32 the cosine of a small angle does not say what its sine is.
    pub(super) fn around(
        code: &mut Code,
        axis: &Expr,
        frame: &(Expr, Expr),
        (versine, vercosine): (&Expr, &Expr),
        turns: Expr,
    ) -> Expr {
        let angle = code.bind("azimuth", Ty::F32, turns * (2.0 * PI));
        let rest = (versine.clone() * vercosine.clone()).max(0.0).sqrt();
        let rest = code.bind("sine", Ty::F32, rest);
        let mu = code.bind("cosine", Ty::F32, (vercosine.clone() - versine.clone()) * 0.5);
        let side = frame.0.clone() * (rest.clone() * Expr::math(Math::Cos, [angle.clone()])).splat(3);
        let other = frame.1.clone() * (rest * Expr::math(Math::Sin, [angle])).splat(3);
        let to = axis.clone() * mu.splat(3) + side + other;
        code.bind("to", Ty::VEC3, Expr::math(Math::Normalize, [to]))
    }

    /// The direction of a light from a place, or of the middle of its disc, and how far away it is.
    pub(super) fn towards(&mut self, code: &mut Code, p: &Expr, light: &Light) -> (Expr, Expr) {
        let name = &light.name;
        match light.kind {
            LightKind::Directional { direction, .. } => {
                let travel = self.builder.value(self.graph, direction, &format!("{name}_direction"));
                (code.bind(&format!("to_{name}"), Ty::VEC3, -travel), Expr::F32(FAR))
            }
            LightKind::Point { position, .. } => {
                let at = self.builder.value(self.graph, position, &format!("{name}_position"));
                let way = code.bind(&format!("way_to_{name}"), Ty::VEC3, at - p.clone());
                let distance = code.bind("distance", Ty::F32, Expr::math(Math::Length, [way.clone()]));
                let to = way / distance.clone().max(1e-30).splat(3);
                (code.bind(&format!("to_{name}"), Ty::VEC3, to), distance)
            }
        }
    }

    /// Calls `each` with every sample of every light.
    pub(super) fn samples(
        &mut self,
        code: &mut Code,
        p: &Expr,
        receiver: &Receiver<'_>,
        each: &mut dyn FnMut(&mut Self, &mut Code, &LightSample),
    ) {
        let lw = self.scene.light_width;
        for (number, light) in (0u32..).zip(self.scene.lights.clone()) {
            let name = light.name.clone();
            let (to, limit) = self.towards(code, p, &light);
            match light.kind {
                LightKind::Directional { irradiance, angular_diameter, .. } => {
                    let e = self.builder.value(self.graph, irradiance, &format!("{name}_irradiance"));
                    let e = widen(e, self.graph.width(irradiance), lw);
                    let Some(diameter) = angular_diameter else {
                        let channel = Channel::Light(number);
                        each(self, code, &LightSample { to, limit, irradiance: e, even: None, channel });
                        continue;
                    };
                    let diameter = self.builder.value(self.graph, diameter, &format!("{name}_angular_diameter"));
                    if let Receiver::Path { rng } = receiver {
                        self.disc_point(code, (number, &to), e, &(diameter * 0.5), *rng, each);
                    } else {
                        let on_surface = matches!(receiver, Receiver::Surface { .. });
                        self.disc(code, (number, &to), e, (&(diameter * 0.5), on_surface), each);
                    }
                }
                LightKind::Point { intensity, radius, .. } => {
                    let i = self.builder.value(self.graph, intensity, &format!("{name}_intensity"));
                    let i = widen(i, self.graph.width(intensity), lw);
                    let near = match radius {
                        Some(radius) => {
                            let radius = self.builder.value(self.graph, radius, &format!("{name}_radius"));
                            limit.clone().max(radius)
                        }
                        None => limit.clone(),
                    };
                    // At the point itself there is no direction, and no end to the light: it is left out there.
                    let near = code.bind("near", Ty::F32, near.max(1e-18));
                    let e = i / near.clone().splat(lw) / near.splat(lw);
                    let e = code.bind("irradiance", Ty::float(lw), e.min(Expr::F32(1e30).splat(lw)));
                    each(
                        self,
                        code,
                        &LightSample { to, limit, irradiance: e, even: None, channel: Channel::Light(number) },
                    );
                }
            }
        }
        if self.scene.environment && matches!(receiver, Receiver::Medium { .. } | Receiver::Surface { .. }) {
            self.environment(code, receiver, each);
        }
    }

    /// 1 − cos α of a disc of radius α, and the irradiance of one of so many samples of it: of the whole, E / (π sin² α) times
    /// its solid angle 2π(1 − cos α) is E · 2/(1 + cos α).
    fn cap(code: &mut Code, irradiance: Expr, radius: &Expr, count: u32, width: u8) -> (Expr, Expr) {
        let cap = Self::height_of_cap(code, radius);
        let share = Expr::F32(2.0 / f64::from(count)) / (Expr::F32(2.0) - cap.clone());
        (cap, code.bind("irradiance", Ty::float(width), irradiance * share.splat(width)))
    }

    pub(super) fn height_of_cap(code: &mut Code, radius: &Expr) -> Expr {
        let half = code.bind("half_sine", Ty::F32, Expr::math(Math::Sin, [radius.clone() * 0.5]));
        code.bind("cap", Ty::F32, half.clone() * half * 2.0)
    }

    /// Point number `i` of so many on a disc: a spiral around its middle.
    pub(super) fn disc_direction(
        code: &mut Code,
        (to, frame): (&Expr, &(Expr, Expr)),
        cap: Expr,
        i: Expr,
        count: u32,
    ) -> Expr {
        let versine = code.bind("versine", Ty::F32, cap * ((i.clone() + 0.5) * (1.0 / f64::from(count))));
        let turns = Self::fract(code, i * GOLDEN);
        Self::around(code, to, frame, (&versine, &(Expr::F32(2.0) - versine.clone())), turns)
    }

    pub(super) fn is_even(code: &mut Code, number: LocalId) -> Expr {
        let half = Expr::Local(number) * 0.5;
        code.bind("even", Ty::BOOL, half.clone().equal(Expr::math(Math::Floor, [half])))
    }

    /// A sun with a disc: points of a spiral, each with its share of the light.
    fn disc(
        &mut self,
        code: &mut Code,
        (number, to): (u32, &Expr),
        irradiance: Expr,
        (radius, on_surface): (&Expr, bool),
        each: &mut dyn FnMut(&mut Self, &mut Code, &LightSample),
    ) {
        let lw = self.scene.light_width;
        // Where nothing has a sharp edge few samples do, and a ray through a medium mixes those of many places.
        let count = if on_surface { self.count(0.64, 16, 512) } else { DISC };
        let (cap, e) = Self::cap(code, irradiance, radius, count, lw);
        let frame = Self::across(code, to);
        let i = code.var("of_light", Ty::F32, 0.0);
        code.open();
        let sample = Self::disc_direction(code, (to, &frame), cap, i.into(), count);
        let even = Some(Self::is_even(code, i));
        // Of columns that are kept, one that lies as far from the middle.
        let column = Expr::math(Math::Floor, [Expr::Local(i) * (f64::from(DISC) / f64::from(count))]);
        let (limit, channel) = (Expr::F32(FAR), Channel::Disc(number, column));
        each(self, code, &LightSample { to: sample, limit, irradiance: e, even, channel });
        code.add(i, 1.0);
        code.break_if(Expr::Local(i).greater_equal(f64::from(count)));
        let block = code.close();
        code.push_loop(block);
    }

    /// One point of a disc at random, with all of its light.
    fn disc_point(
        &mut self,
        code: &mut Code,
        (number, to): (u32, &Expr),
        irradiance: Expr,
        radius: &Expr,
        rng: LocalId,
        each: &mut dyn FnMut(&mut Self, &mut Code, &LightSample),
    ) {
        let lw = self.scene.light_width;
        let Some(random) = self.random else { return };
        let (cap, e) = Self::cap(code, irradiance, radius, 1, lw);
        let frame = Self::across(code, to);
        let u = random.draw(code, rng);
        let versine = code.bind("versine", Ty::F32, cap * u);
        let turns = random.draw(code, rng);
        let sample = Self::around(code, to, &frame, (&versine, &(Expr::F32(2.0) - versine.clone())), turns);
        each(
            self,
            code,
            &LightSample {
                to: sample,
                limit: Expr::F32(FAR),
                irradiance: e,
                even: None,
                channel: Channel::Light(number),
            },
        );
    }

    fn environment(
        &mut self,
        code: &mut Code,
        receiver: &Receiver<'_>,
        each: &mut dyn FnMut(&mut Self, &mut Code, &LightSample),
    ) {
        let Some(node) = self.scene.background else { return };
        let lw = self.scene.light_width;
        if self.cache.is_some() {
            return self.kept_environment(code, receiver, node, each);
        }
        let count = self.count(0.64, 32, 4096);
        let axis = match receiver {
            Receiver::Medium { direction, .. } => (*direction).clone(),
            Receiver::Surface { normal } => (*normal).clone(),
            Receiver::Path { .. } => return,
        };
        let frame = Self::across(code, &axis);
        let i = code.var("of_light", Ty::F32, 0.0);
        code.open();
        let u = code.bind("share", Ty::F32, (Expr::Local(i) + 0.5) * (1.0 / f64::from(count)));
        // 1 − cos and 1 + cos of the angle from the axis, and the solid angle that the sample stands for.
        let of_cosine = |mu: Expr| (Expr::F32(1.0) - mu.clone(), Expr::F32(1.0) + mu);
        let (turn, solid) = match receiver {
            Receiver::Surface { .. } | Receiver::Path { .. } => {
                let mu = code.bind("mu", Ty::F32, (Expr::F32(1.0) - u).max(0.0).sqrt());
                (of_cosine(mu.clone()), Expr::F32(PI / f64::from(count)) / mu.max(1e-6))
            }
            Receiver::Medium { narrow: None, .. } => {
                let mu = code.bind("mu", Ty::F32, Expr::F32(1.0) - u * 2.0);
                (of_cosine(mu), Expr::F32(4.0 * PI / f64::from(count)))
            }
            Receiver::Medium { narrow: Some(g), .. } => {
                // Henyey and Greenstein's lobe, whose distribution has a closed inverse. A narrow one lies where cosines
                // are 1 in f32: all is made of 1 − |cos θ|.
                let size = g.abs();
                let least = 1.0 - size;
                let spread = code.bind("spread", Ty::F32, Expr::F32(least) + u.clone() * (2.0 * size));
                let s = code.bind("s", Ty::F32, Expr::F32(least * (1.0 + size)) / spread.clone());
                let short = (Expr::F32(1.0) - u) * (s.clone() + least) * least / spread;
                let short = Expr::math(Math::Clamp, [short, 0.0.into(), 2.0.into()]);
                let short = code.bind("short", Ty::F32, short);
                let long = Expr::F32(2.0) - short.clone();
                // s² = 1 + g² − 2gμ.
                let density = Expr::F32(least * (1.0 + size) / (4.0 * PI)) / (s.clone() * s.clone() * s);
                let solid = Expr::F32(1.0 / f64::from(count)) / density;
                (if *g < 0.0 { (long, short) } else { (short, long) }, solid)
            }
        };
        let turns = Self::fract(code, Expr::Local(i) * GOLDEN);
        let to = Self::around(code, &axis, &frame, (&turn.0, &turn.1), turns);
        let value = self.along_ray(code, &to, &[node]).remove(0);
        let e = widen(value, self.graph.width(node), lw) * solid.splat(lw);
        let e = code.bind("irradiance", Ty::float(lw), e);
        let even = Self::is_even(code, i);
        each(
            self,
            code,
            &LightSample {
                to,
                limit: Expr::F32(FAR),
                irradiance: e,
                even: Some(even),
                channel: Channel::Sky(i.into()),
            },
        );
        code.add(i, 1.0);
        code.break_if(Expr::Local(i).greater_equal(f64::from(count)));
        let block = code.close();
        code.push_loop(block);
    }

    /// Adds what a sample brings, weighted in each sum, unless a surface is in the way.
    fn gather(&mut self, code: &mut Code, p: &Expr, sample: &LightSample, weights: &[Expr], into: &Gathered) {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let parts = weights.iter().enumerate().map(|(i, w)| {
            let value = sample.irradiance.clone() * w.clone();
            code.bind(&format!("part_{i}"), Ty::float(lw), value)
        });
        let parts: Vec<Expr> = parts.collect();
        let most = parts.iter().map(|p| largest(p.clone(), lw)).reduce(Expr::max).unwrap_or(Expr::F32(0.0));
        let most = code.bind("most", Ty::F32, most);
        let worth = most.clone().greater(0.0);
        code.open();
        if let Some(nearest) = self.nearest {
            let arguments = vec![p.clone(), sample.to.clone(), Expr::F32(0.0), sample.limit.clone()];
            let hit = Expr::Call(nearest.function, arguments).field(0);
            let blocked = code.bind("blocked", Ty::BOOL, hit.less(sample.limit.clone()));
            code.open();
            self.gather_clear(code, p, sample, &parts, &most, into, (dw, lw));
            let clear = code.close();
            code.push_if(!blocked, clear);
        } else {
            self.gather_clear(code, p, sample, &parts, &most, into, (dw, lw));
        }
        let body = code.close();
        code.push_if(worth, body);
    }

    fn gather_clear(
        &mut self,
        code: &mut Code,
        p: &Expr,
        sample: &LightSample,
        parts: &[Expr],
        most: &Expr,
        into: &Gathered,
        (dw, lw): (u8, u8),
    ) {
        let kept = if let Some((buffered, plane)) = self.buffered.clone().zip(into.plane.clone()) {
            Some(self.look_back(code, &buffered, p, sample, &plane))
        } else if let Some(cache) = self.cache.clone() {
            let (depth, off) = self.look_up(code, &cache, p, sample, into.k_open.as_ref());
            Some((depth, Some(off)))
        } else {
            None
        };
        let mut through = None;
        if let Some((depth, off)) = kept {
            let t = code.bind("through", Ty::float(dw), (-depth.clone()).exp());
            self.count_unsure(code, into, most, (&depth, &t), off);
            through = Some(widen(t, dw, lw));
        } else if let Some(shadow) = self.shadow.clone() {
            let mut arguments = vec![p.clone(), sample.to.clone(), sample.limit.clone()];
            if shadow.stepped {
                // Where white is large against what this light brings, its shadow need not be exact.
                let white = self.builder.frame(FrameValue::White);
                arguments.push(white / most.clone());
            }
            let value = code.bind("shade", shadow.result, Expr::Call(shadow.function, arguments));
            let depth = shadow.depth(&value);
            let t = code.bind("through", Ty::float(dw), (-depth.clone()).exp());
            if let (Some(work), Some(field)) = (into.work, shadow.work) {
                code.add(work, value.clone().field(field));
            }
            let off = shadow.error.map(|field| value.clone().field(field));
            self.count_unsure(code, into, most, (&depth, &t), off);
            through = Some(widen(t, dw, lw));
        }
        let brought = |part: &Expr| match &through {
            Some(t) => part.clone() * t.clone(),
            None => part.clone(),
        };
        for (sum, part) in into.sums.iter().zip(parts) {
            code.add(*sum, brought(part));
        }
        if let Some(brightest) = into.brightest {
            code.set(brightest, Expr::Local(brightest).max(largest(brought(&sample.irradiance), lw)));
        }
        let number = match &sample.channel {
            Channel::Light(number) | Channel::Disc(number, _) => Some(*number),
            Channel::Sky(_) => None,
        };
        let alternating = into.alternating.iter().find(|(of, _)| *of == number);
        if let (Some((_, alternating)), Some(even), [first, ..]) = (alternating, &sample.even, parts) {
            let value = largest(brought(first), lw);
            code.add(*alternating, even.clone().select(value.clone(), -value));
        }
    }

    /// Adds to the error what a depth that is off, and that of a place that is rounded, may do to the light that comes through.
    fn count_unsure(
        &self,
        code: &mut Code,
        into: &Gathered,
        most: &Expr,
        (depth, through): (&Expr, &Expr),
        off: Option<Expr>,
    ) {
        let Some(error) = into.error else { return };
        let dw = self.scene.depth_width;
        let wrong = match (into.unsure.clone(), off) {
            (None, None) => return,
            // Where the place alone is unsure by more than is seen through there may be all the light or none. Otherwise e^x − 1 < x + x².
            (Some(unsure), None) => {
                let little = largest(through.clone(), dw) * (unsure.clone() * unsure.clone() + unsure.clone());
                unsure.less(1.0).select(little, 1.0)
            }
            (unsure, Some(off)) => {
                let off = unsure.into_iter().fold(off, |a, b| a + b);
                let off = code.bind("depth_off", Ty::F32, off);
                let nearer = (depth.clone() - off.clone().splat(dw)).max(Expr::F32(0.0).splat(dw));
                let gained = largest((-nearer).exp() - through.clone(), dw);
                // Or there is something in the way that was not seen.
                let lost = largest(through.clone(), dw) * off.min(1.0);
                gained.max(lost)
            }
        };
        code.add(error, most.clone() * wrong);
    }

    /// In `media` it matters where in them a place is.
    fn declare_sums(&self, code: &mut Code, count: usize, media: bool) -> Gathered {
        let lw = self.scene.light_width;
        let wants_error = self.wants(OutputKind::Error) && !matches!(self.rule, StepRule::Closed);
        let sums = (0..count).map(|i| code.var(&format!("light_{i}"), Ty::float(lw), Expr::F32(0.0).splat(lw)));
        let sums = sums.collect();
        let discs =
            (0u32..).zip(&self.scene.lights).filter(|(_, light)| light.kind.is_disc()).map(|(number, _)| Some(number));
        let soft = discs.chain(self.scene.environment.then_some(None)).filter(|_| self.wants(OutputKind::Error));
        let alternating: Vec<_> = soft.map(|number| (number, code.var("alternating", Ty::F32, 0.0))).collect();
        let shadow = self.shadow.as_ref();
        let kept = self.cache.is_some() || self.buffered.is_some();
        let unsure = kept || shadow.is_some_and(|s| media || s.error.is_some());
        Gathered {
            sums,
            error: (!alternating.is_empty() || (wants_error && unsure)).then(|| code.var("error", Ty::F32, 0.0)),
            alternating,
            unsure: None,
            k_open: None,
            plane: None,
            work: shadow.is_some_and(|s| s.work.is_some()).then(|| code.var("work", Ty::F32, 0.0)),
            brightest: None,
        }
    }

    /// Returns the sums, with error and work where they are kept.
    fn return_sums(&mut self, mut code: Code, name: &str, gathered: &Gathered, values: Vec<Expr>) -> InScattered {
        let lw = self.scene.light_width;
        let (unsure, k_open) = (gathered.unsure.is_some(), gathered.k_open.is_some());
        let plane = gathered.plane.is_some();
        gathered.count_alternating(&mut code);
        let count = values.len() as u32;
        let extra = [gathered.error.map(|e| ("error", e)), gathered.work.map(|w| ("work", w))];
        let many = count > 1 || extra.iter().any(Option::is_some);
        if !many {
            let result = Ty::float(lw);
            code.return_(values.into_iter().next().unwrap_or(Expr::F32(0.0)));
            let function = self.builder.add_function(code.finish(Some(result)));
            return InScattered { function, result, many, error: None, work: None, unsure, k_open, plane };
        }
        let mut fields: Vec<(String, Ty)> = (0..count).map(|i| (format!("light_{i}"), Ty::float(lw))).collect();
        let mut values = values;
        let mut place = [None, None];
        for (slot, extra) in place.iter_mut().zip(extra) {
            if let Some((name, var)) = extra {
                *slot = Some(fields.len() as u32);
                fields.push((name.to_owned(), Ty::F32));
                values.push(var.into());
            }
        }
        let result = self.builder.add_struct(name, fields);
        code.return_(Expr::Compose(result, values));
        let function = self.builder.add_function(code.finish(Some(result)));
        InScattered { function, result, many, error: place[0], work: place[1], unsure, k_open, plane }
    }

    /// Writes `in_scattered`, if some medium scatters light of some light.
    pub(super) fn write_in_scattered(&mut self, ledger: &mut Ledger) -> Option<InScattered> {
        if self.scene.phases.is_empty() || !self.wants(OutputKind::Radiance) {
            return None;
        }
        let functions = self.phase_functions();
        let mut code = Code::new("in_scattered", None);
        let p = code.parameter("p", Ty::VEC3);
        let direction = code.parameter("direction", Ty::VEC3);
        let mut gathered = self.declare_sums(&mut code, functions.len(), true);
        let deep = self.shadow.is_some() || self.cache.is_some() || self.buffered.is_some();
        if gathered.error.is_some() && deep {
            gathered.unsure = Some(code.parameter("unsure", Ty::F32));
            let wide = Ty::float(self.scene.depth_width);
            gathered.k_open = self.cache.is_some().then(|| code.parameter("k_open", wide));
        }
        gathered.plane = self.buffered.as_ref().map(|_| code.parameter("plane", Ty::F32));
        let means = self.scene.phases.iter().map(|f| f.mean_cosine);
        let narrow = means.fold(0.0f64, |a, g| if g.abs() > a.abs() { g } else { a });
        // Directions drawn for one narrow lobe serve a wide one badly.
        let most = if self.scene.phases.len() == 1 { NARROWEST } else { 0.98 };
        let narrow = (narrow.abs() > NARROW).then_some(narrow.clamp(-most, most));
        let receiver = Receiver::Medium { direction: &direction, narrow };
        let sky = self.kept_sky(&mut code, &mut gathered);
        self.samples(&mut code, &p, &receiver, &mut |this, code, sample| {
            let each = functions.iter().enumerate();
            let weights: Vec<Expr> =
                each.map(|(i, f)| this.phase_value(code, f.as_ref(), i, &p, (&sample.to, None), &direction)).collect();
            let into = match &sky {
                Some(sky) if matches!(sample.channel, Channel::Sky(_)) => sky.gathering(code, &weights),
                Some(_) | None => &gathered,
            };
            this.gather(code, &p, sample, &weights, into);
        });
        if let Some(sky) = &sky {
            sky.add_to(&mut code, &gathered);
        }
        if self.scene.lights.is_empty() {
            ledger.omit("light of suns and lamps", "the environment is the only light", None);
        }
        let values = gathered.sums.iter().map(|s| Expr::Local(*s)).collect();
        Some(self.return_sums(code, "InScattered", &gathered, values))
    }

    /// Writes `reflected(p, normal, sheet)`: albedo · E / π of the surface that was hit.
    pub(super) fn write_reflected(&mut self) -> Option<InScattered> {
        if self.scene.sheets.iter().all(|s| s.albedo.is_none())
            || !self.scene.is_lit()
            || !self.wants(OutputKind::Radiance)
        {
            return None;
        }
        let lw = self.scene.light_width;
        let mut code = Code::new("reflected", None);
        let p = code.parameter("p", Ty::VEC3);
        let normal = code.parameter("normal", Ty::VEC3);
        let which = code.parameter("sheet", Ty::U32);
        let albedo = self.albedo(&mut code, &p, &which);
        let gathered = self.declare_sums(&mut code, 1, false);
        let receiver = Receiver::Surface { normal: &normal };
        self.samples(&mut code, &p, &receiver, &mut |this, code, sample| {
            let cosine = code.bind("cosine", Ty::F32, sample.to.clone().dot(normal.clone()).max(0.0));
            this.gather(code, &p, sample, &[cosine.splat(lw)], &gathered);
        });
        let share = Expr::Local(albedo) * Expr::F32(1.0 / PI).splat(lw);
        if let Some(error) = gathered.error {
            code.set(error, Expr::Local(error) * (1.0 / PI));
        }
        let values = vec![Expr::Local(gathered.sums[0]) * share];
        Some(self.return_sums(code, "Reflected", &gathered, values))
    }

    /// Albedo at a point of the sheet with this number, in the width of light.
    pub(super) fn albedo(&mut self, code: &mut Code, p: &Expr, which: &Expr) -> LocalId {
        let lw = self.scene.light_width;
        let albedo = code.var("albedo", Ty::float(lw), Expr::F32(0.0).splat(lw));
        for (i, sheet) in self.scene.sheets.iter().enumerate() {
            let Some(node) = sheet.albedo else { continue };
            code.open();
            let mut writer = Writer::new(self.graph, &self.scene.tiers);
            writer.know_input(Input::Position, p.clone());
            let value = writer.write(self.builder, code, &[node]).remove(0);
            code.set(albedo, widen(value, self.graph.width(node), lw));
            let body = code.close();
            code.push_if(which.clone().equal(i as u32), body);
        }
        albedo
    }

    /// Radiance of the discs of suns, for a ray that nothing stops.
    pub(super) fn discs(&mut self, code: &mut Code, ray: &Ray) -> Option<Expr> {
        let lw = self.scene.light_width;
        let mut sum: Option<Expr> = None;
        for Light { name, kind, .. } in self.scene.lights.clone() {
            let LightKind::Directional { direction, irradiance, angular_diameter: Some(diameter) } = kind else {
                continue;
            };
            let travel = self.builder.value(self.graph, direction, &format!("{name}_direction"));
            let e = self.builder.value(self.graph, irradiance, &format!("{name}_irradiance"));
            let diameter = self.builder.value(self.graph, diameter, &format!("{name}_angular_diameter"));
            let off = code.bind("off", Ty::VEC3, ray.direction.clone() + travel);
            let half = code.bind("half_sine", Ty::F32, Expr::math(Math::Sin, [diameter.clone() * 0.25]));
            let sine = code.bind("sine", Ty::F32, Expr::math(Math::Sin, [diameter * 0.5]));
            // |d − s|² = 4 sin²(angle/2).
            let inside = off.clone().dot(off).less(half.clone() * half * 4.0);
            let radiance = Expr::F32(1.0) / (sine.clone() * sine * PI).max(1e-30);
            let shown = inside.select(radiance, 0.0).splat(lw) * widen(e, self.graph.width(irradiance), lw);
            let shown = code.bind(&format!("{name}_disc"), Ty::float(lw), shown);
            sum = Some(match sum {
                Some(sum) => sum + shown,
                None => shown,
            });
        }
        sum
    }

    /// The least optical depth, for a test whether anything behind can be seen.
    pub(super) fn thinnest(&self, depth: LocalId) -> Expr {
        least(depth.into(), self.scene.depth_width)
    }
}
