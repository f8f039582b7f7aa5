//! Segments with closed forms, and where a ray through endless media may stop.

use super::media::Medium;
use super::shapes::{FAR, Ray};
use super::trace::{State, Tracer, widen};
use crate::fields::{Code, Helper};
use crate::ir::NodeId;
use crate::program::FrameValue;
use crate::program::kernel::{Expr, Ty};

/// Share of `accuracy` that the light beyond the last step of an endless ray may make up, if it were as bright as white.
const BEYOND: f64 = 1e-3;
/// The same for a fixed number of steps, which has no accuracy.
const BEYOND_FIXED: f64 = 1e-7;

impl Tracer<'_> {
    /// (1 − e^(−x))/x in each component.
    pub(super) fn attenuated(&mut self, code: &mut Code, x: Expr, width: u8) -> Expr {
        if width == 1 {
            return self.builder.call(self.graph, Helper::Attenuated, [x]);
        }
        let x = code.bind("x", Ty::float(width), x);
        let parts = (0..width).map(|i| self.builder.call(self.graph, Helper::Attenuated, [x.clone().component(i)]));
        Expr::Compose(Ty::float(width), parts.collect())
    }

    /// 1 − e^(−x) in each component.
    fn absorbed(&mut self, x: &Expr, width: u8) -> Expr {
        let one = |this: &mut Self, x: Expr| -this.builder.call(this.graph, Helper::Expm1, [-x]);
        if width == 1 {
            return one(self, x.clone());
        }
        let parts = (0..width).map(|i| one(self, x.clone().component(i))).collect();
        Expr::Compose(Ty::float(width), parts)
    }

    /// Adds up what each medium contributes where it is.
    fn total(&self, code: &mut Code, parts: Vec<(Option<Expr>, Expr, u8)>, width: u8, name: &str) -> Option<Expr> {
        let zero = || Expr::F32(0.0).splat(width);
        let parts = parts.into_iter().map(|(here, value, from)| {
            let value = widen(value, from, width);
            match here {
                Some(here) => here.select(value, zero()),
                None => value,
            }
        });
        let sum = parts.reduce(|a, b| a + b)?;
        Some(code.bind(name, Ty::float(width), sum))
    }

    pub(super) fn width(&self, node: Option<NodeId>) -> u8 {
        node.map_or(1, |n| self.graph.width(n))
    }

    /// Optical depth from a to b through media whose extinction has a closed form; at most 3e38.
    pub(super) fn depth_between(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        media: &[&Medium<'_>],
        a: &Expr,
        b: &Expr,
        name: &str,
    ) -> Option<Expr> {
        let dw = self.scene.depth_width;
        let uniform = media.iter().filter_map(|m| {
            let k = m.constant.extinction.clone()?;
            Some((m.here.clone(), k, self.width(m.matter.extinction)))
        });
        let uniform = uniform.collect();
        let mut parts = vec![];
        if let Some(k_t) = self.total(code, uniform, dw, "k_t") {
            parts.push((None, k_t * (b.clone() - a.clone()).splat(dw), dw));
        }
        for medium in media.iter().filter(|m| m.constant.extinction.is_none()) {
            for term in medium.matter.closed.iter().flatten() {
                let scale = self.builder.value(self.graph, term.scale, &format!("{}_k_t", medium.matter.name));
                let width = self.graph.width(term.scale);
                let (argument, rate) = match (term.gradient, term.offset) {
                    (Some(gradient), offset) => {
                        let g = self.builder.value(self.graph, gradient, "gradient");
                        let along = g.clone().dot(ray.origin.clone());
                        let argument = match offset {
                            Some(o) => along + self.builder.value(self.graph, o, "offset"),
                            None => along,
                        };
                        (argument, g.dot(ray.direction.clone()))
                    }
                    (None, Some(o)) => (self.builder.value(self.graph, o, "offset"), Expr::F32(0.0)),
                    (None, None) => (Expr::F32(0.0), Expr::F32(0.0)),
                };
                let integral = self.builder.helper(self.graph, Helper::ExponentialIntegral);
                let value = Expr::Call(integral, vec![argument, rate, a.clone(), b.clone()]);
                let value = code.bind("column", Ty::F32, value);
                parts.push((medium.here.clone(), scale * value.splat(width), width));
            }
        }
        let x = self.total(code, parts, dw, name)?;
        if !media.iter().any(|m| m.matter.region.is_unbounded(&self.scene.primitives)) {
            return Some(x);
        }
        // An endless segment is opaque where there is anything at all: 0 · 3e38 is 0.
        Some(code.bind(name, Ty::float(dw), x.min(Expr::F32(FAR).splat(dw))))
    }

    /// A segment in which everything has a closed form.
    pub(super) fn closed(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        media: &[&Medium<'_>],
        a: &Expr,
        b: &Expr,
    ) {
        let lw = self.scene.light_width;
        let x = self.depth_between(code, ray, media, a, b, "x");
        if state.radiance.is_some() {
            let light = if media.iter().all(|m| !m.matter.varying) {
                self.uniform_light(code, media, x.as_ref(), a, b)
            } else {
                self.shared_light(media, x.as_ref())
            };
            if let (Some(radiance), Some(light)) = (state.radiance, light) {
                let mut light = self.weighted(state, light, lw);
                if state.apart.depth.is_some() {
                    light = code.bind("brought", Ty::float(lw), light);
                    let front = state.depth.map(|d| (-Expr::Local(d)).exp());
                    self.count_bright(code, state, &light, (front.as_ref(), x.as_ref()));
                }
                code.add(radiance, light);
            }
        }
        if let (Some(depth), Some(x)) = (state.depth, x) {
            code.add(depth, x);
        }
    }

    /// k_e · (1 − e^(−x))/k_t, where all is uniform.
    fn uniform_light(
        &mut self,
        code: &mut Code,
        media: &[&Medium<'_>],
        x: Option<&Expr>,
        a: &Expr,
        b: &Expr,
    ) -> Option<Expr> {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let emission = media.iter().filter_map(|m| {
            let value = m.constant.emission.clone()?;
            Some((m.here.clone(), value, self.width(m.matter.emission)))
        });
        let emission = emission.collect();
        let k_e = self.total(code, emission, lw, "k_e")?;
        let length = code.bind("length", Ty::F32, b.clone() - a.clone());
        Some(match x {
            Some(x) => {
                let mean = self.attenuated(code, x.clone(), dw);
                k_e * widen(mean * length.splat(dw), dw, lw)
            }
            None => k_e * length.splat(lw),
        })
    }

    /// S · (1 − e^(−x)), where all media have one source function S = k_e/k_t.
    fn shared_light(&mut self, media: &[&Medium<'_>], x: Option<&Expr>) -> Option<Expr> {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let source = media.iter().find(|m| m.matter.emission.is_some()).and_then(|m| m.matter.source)?;
        let s = self.builder.value(self.graph, source, "source");
        let s = widen(s, self.graph.width(source), lw);
        let absorbed = self.absorbed(x?, dw);
        Some(s * widen(absorbed, dw, lw))
    }

    /// Where an endless ray through media with closed forms may stop: beyond, T(t) − T(∞) is below a share of the accuracy.
    /// At most twice too far.
    pub(super) fn last_step(&mut self, code: &mut Code, ray: &Ray, media: &[&Medium<'_>], a: &Expr) -> Expr {
        let dw = self.scene.depth_width;
        let share = match self.rule.accuracy() {
            Some(_) => self.builder.frame(FrameValue::Accuracy) * BEYOND,
            None => Expr::F32(BEYOND_FIXED),
        };
        let share = code.bind("share", Ty::F32, share);
        // Bisection over exponents of two from 2⁻³² to 2⁹⁶ units.
        let low = code.var("low", Ty::F32, -32.0);
        let high = code.var("high", Ty::F32, 96.0);
        code.open();
        code.break_if((Expr::Local(high) - Expr::Local(low)).less(0.75));
        let middle = code.bind("middle", Ty::F32, (Expr::Local(low) + Expr::Local(high)) * 0.5);
        let t = a.clone() + (middle.clone() * std::f64::consts::LN_2).exp();
        let t = code.bind("t_end", Ty::F32, t);
        let before = self.depth_between(code, ray, media, a, &t, "before");
        let rest = self.depth_between(code, ray, media, &t, &Expr::F32(FAR), "rest");
        let seen = match (before, rest) {
            (Some(before), Some(rest)) => {
                let behind = self.absorbed(&rest, dw);
                super::trace::largest((-before).exp() * behind, dw)
            }
            _ => Expr::F32(0.0),
        };
        let done = code.bind("done", Ty::BOOL, seen.less_equal(share));
        code.set(high, done.clone().select(middle.clone(), high));
        code.set(low, done.select(low, middle));
        let block = code.close();
        code.push_loop(block);
        a.clone() + (Expr::Local(high) * std::f64::consts::LN_2).exp()
    }
}
