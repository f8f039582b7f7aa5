//! The projections of data (`composite`): largest, smallest and mean value along a ray, and the first surface of a value.
//!
//! A ray that meets data shows the colour of its value and is opaque; one that meets none shows the background.
//! Data are sampled at half the smallest cell (an eighth for a surface) and at both ends; an extreme is then refined by golden-section search around the best sample,
//! a surface by bisection between the samples on either side of it. Where three samples on one side come near a surface and go away
//! again, golden-section search tells whether the ray grazes it between them.

use super::media::{Medium, Varying};
use super::trace::{Segment, State, Tracer};
use crate::fields::{Code, Writer, field_function};
use crate::ir::{Composite, Graph, Input, NodeId};
use crate::program::kernel::{BinaryOp, Expr, LocalId, Math, Ty};
use crate::program::{FrameValue, StepRule};
use std::rc::Rc;

/// Data of one medium.
pub(super) struct Data {
    pub(super) value: NodeId,
    pub(super) color: NodeId,
    /// With respect to the position, for a surface.
    pub(super) gradient: Option<NodeId>,
}

/// What a projection keeps along the ray.
#[derive(Clone)]
pub(super) struct Projected {
    /// Best value so far, or the distance of the surface.
    best: LocalId,
    /// Number of the medium it belongs to plus one; 0 is none.
    owner: LocalId,
    /// For the mean: per medium, the integral and the length.
    means: Vec<(LocalId, LocalId)>,
}

const GOLDEN: f64 = 0.618_033_988_749_894_9;

impl Tracer<'_> {
    pub(super) fn declare_projection(&self, code: &mut Code) -> Projected {
        let start = match self.composite {
            Composite::Maximum => -super::shapes::FAR,
            Composite::Minimum | Composite::Isosurface(_) => super::shapes::FAR,
            Composite::Radiance | Composite::Average => 0.0,
        };
        let best = code.var("best", Ty::F32, start);
        let owner = code.var("owner", Ty::U32, 0u32);
        let mean = self.composite == Composite::Average;
        let means = self.scene.matter.iter().filter(|_| mean).map(|m| {
            let integral = code.var(&format!("{}_integral", m.name), Ty::F32, 0.0);
            (integral, code.var(&format!("{}_length", m.name), Ty::F32, 0.0))
        });
        let means = means.collect();
        Projected { best, owner, means }
    }

    /// The data's function of each medium, with what it takes from the ray.
    pub(super) fn data_media<'s>(&mut self, code: &mut Code, ray: &super::shapes::Ray) -> Vec<Medium<'s>>
    where
        Self: 's,
    {
        let scene: &super::matter::Scene = self.scene;
        let mut out = vec![];
        for matter in &scene.matter {
            let data = matter.data.as_ref().map(|d| d.value);
            let mut medium = Medium::plain(matter);
            if let Some(value) = data {
                let name = format!("{}_data", matter.name);
                let roots = [("value", value)];
                let function = field_function(self.graph, &scene.tiers, self.builder, &name, matter.span, &roots);
                let hoisted = self.along_ray(code, &-ray.direction.clone(), &function.hoisted);
                medium.varying = Some(Rc::new(Varying { name, function, hoisted }));
            }
            out.push(medium);
        }
        out
    }

    /// Looks for the value in one segment.
    pub(super) fn project_segment(&mut self, code: &mut Code, state: &State, media: &[Medium<'_>], segment: &Segment) {
        let Some(projected) = state.projected.clone() else { return };
        for (number, medium) in media.iter().enumerate() {
            let Some(varying) = medium.varying.clone() else { continue };
            code.open();
            let id = varying.function.id;
            let at = |t: Expr| {
                let mut arguments = vec![segment.ray.at(t)];
                arguments.extend(varying.hoisted.iter().cloned());
                Expr::Call(id, arguments)
            };
            self.project_medium(code, state, &projected, number, &at, segment);
            let body = code.close();
            match &medium.here {
                Some(here) => code.push_if(here.clone(), body),
                None => code.push_all(body),
            }
        }
    }

    fn project_medium(
        &mut self,
        code: &mut Code,
        state: &State,
        projected: &Projected,
        number: usize,
        at: &dyn Fn(Expr) -> Expr,
        segment: &Segment,
    ) {
        let (a, b) = (segment.a.clone(), segment.b.clone());
        let length = code.bind("length", Ty::F32, b - a.clone());
        let count = match self.rule {
            StepRule::Fixed(_) => self.builder.frame(FrameValue::Steps).convert(crate::program::kernel::Prim::F32),
            StepRule::Closed
            | StepRule::Adaptive(_)
            | StepRule::Paths(_)
            | StepRule::Slabs { .. }
            | StepRule::Splats { .. } => {
                let cell = self.data_cell();
                let cap = self.builder.frame(FrameValue::MaxWork).convert(crate::program::kernel::Prim::F32);
                // Within less of a cell data hardly turn twice.
                let share = if matches!(self.composite, Composite::Isosurface(_)) { 0.125 } else { 0.5 };
                Expr::math(Math::Ceil, [length.clone() / (share * cell)]).min(cap)
            }
        };
        let count = code.bind("count", Ty::F32, count.max(2.0));
        // Both ends are looked at just inside, where rounding cannot lead out.
        let inset = match self.composite {
            Composite::Maximum | Composite::Minimum | Composite::Isosurface(_) => {
                Some(code.bind("inset", Ty::F32, length.clone() * 3e-5))
            }
            Composite::Radiance | Composite::Average => None,
        };
        let span = match (&inset, self.composite) {
            (Some(inset), Composite::Isosurface(_)) => length - inset.clone() * 2.0,
            _ => length,
        };
        let h = code.bind("h", Ty::F32, span / count.clone());
        let i = code.var("step", Ty::F32, 0.0);
        let owner = number as u32 + 1;
        let (best, found) = (projected.best, projected.owner);
        let mut after_loop: Option<LocalId> = None;
        let previous = matches!(self.composite, Composite::Isosurface(_))
            .then(|| (code.var("previous", Ty::F32, 0.0), code.var("before", Ty::F32, 0.0)));
        if matches!(self.composite, Composite::Maximum | Composite::Minimum) {
            after_loop = Some(code.var("best_t", Ty::F32, -1.0));
        }
        if let (Some(best_t), Some(inset)) = (after_loop, &inset) {
            // An extreme often lies where the ray enters or leaves.
            for (name, t) in [("at_entry", a.clone() + inset.clone()), ("at_exit", segment.b.clone() - inset.clone())] {
                let t = code.bind(&format!("t_{name}"), Ty::F32, t);
                let value = code.bind(name, Ty::F32, at(t.clone()));
                let better = if self.composite == Composite::Maximum {
                    value.clone().greater(best)
                } else {
                    value.clone().less(best)
                };
                code.if_(better, |code| {
                    code.set(best, value);
                    code.set(found, owner);
                    code.set(best_t, t);
                });
            }
        }
        let level = match self.composite {
            Composite::Isosurface(level) => Some(self.builder.value(self.graph, level, "level")),
            Composite::Radiance | Composite::Maximum | Composite::Minimum | Composite::Average => None,
        };
        code.open();
        let t = match (&inset, self.composite) {
            (Some(inset), Composite::Isosurface(_)) => {
                code.break_if(Expr::Local(i).greater(count));
                code.bind("t_step", Ty::F32, a.clone() + inset.clone() + Expr::Local(i) * h.clone())
            }
            _ => {
                code.break_if(Expr::Local(i).greater_equal(count));
                code.bind("t_mid", Ty::F32, a.clone() + (Expr::Local(i) + 0.5) * h.clone())
            }
        };
        let value = code.bind("value", Ty::F32, at(t.clone()));
        if let Some(work) = state.work {
            code.add(work, 1u32);
        }
        match self.composite {
            Composite::Maximum | Composite::Minimum => {
                let better = if self.composite == Composite::Maximum {
                    value.clone().greater(best)
                } else {
                    value.clone().less(best)
                };
                let best_t = after_loop.expect("declared above");
                code.if_(better, |code| {
                    code.set(best, value);
                    code.set(found, owner);
                    code.set(best_t, t);
                });
            }
            Composite::Average => {
                let (integral, covered) = projected.means[number];
                code.add(integral, value * h.clone());
                code.add(covered, h.clone());
                code.set(found, owner);
            }
            Composite::Isosurface(_) => {
                let level = level.clone().expect("set above");
                let (previous, before) = previous.expect("declared above");
                let off = code.bind("off", Ty::F32, value - level.clone());
                let crossed = Expr::binary(BinaryOp::NotEqual, off.clone().less(0.0), Expr::Local(previous).less(0.0));
                let hit = code.var("hit", Ty::BOOL, crossed.and(Expr::Local(i).greater(0.0)));
                let low = code.var("low", Ty::F32, t.clone() - h.clone());
                let high = code.var("high", Ty::F32, t.clone());
                let near = Expr::Local(previous).abs();
                let turned = near.clone().less(Expr::Local(before).abs()).and(near.less(off.clone().abs()));
                let turned = turned.and(Expr::Local(i).greater(1.0)).and(!Expr::Local(hit));
                code.if_(turned, |code| {
                    graze(code, at, &level, previous, (hit, low, high), (&t, &h));
                });
                code.open();
                let round = code.var("round", Ty::U32, 0u32);
                code.loop_(|code| {
                    code.break_if(Expr::Local(round).greater_equal(24u32));
                    let middle = code.bind("middle", Ty::F32, (Expr::Local(low) + Expr::Local(high)) * 0.5);
                    let below = code.bind("off_middle", Ty::F32, at(middle.clone()) - level.clone());
                    let same = Expr::binary(BinaryOp::Equal, below.less(0.0), Expr::Local(previous).less(0.0));
                    code.if_else(same, |code| code.set(low, middle.clone()), |code| code.set(high, middle.clone()));
                    code.add(round, 1u32);
                });
                code.if_(Expr::Local(high).less(best), |code| {
                    code.set(best, high);
                    code.set(found, owner);
                });
                code.break_();
                let found_it = code.close();
                code.push_if(hit.into(), found_it);
                code.set(before, previous);
                code.set(previous, off);
            }
            Composite::Radiance => {}
        }
        code.add(i, 1.0);
        let block = code.close();
        code.push_loop(block);
        if let Some(best_t) = after_loop {
            self.refine(code, best, best_t, at, &h, segment);
        }
    }

    /// Golden-section search between the neighbours of the best sample.
    fn refine(
        &mut self,
        code: &mut Code,
        best: LocalId,
        best_t: LocalId,
        at: &dyn Fn(Expr) -> Expr,
        h: &Expr,
        segment: &Segment,
    ) {
        let maximum = self.composite == Composite::Maximum;
        code.open();
        let low = code.var("low", Ty::F32, (Expr::Local(best_t) - h.clone()).max(segment.a.clone()));
        let high = code.var("high", Ty::F32, (Expr::Local(best_t) + h.clone()).min(segment.b.clone()));
        let round = code.var("round", Ty::U32, 0u32);
        code.loop_(|code| {
            code.break_if(Expr::Local(round).greater_equal(16u32));
            let width = code.bind("width", Ty::F32, (Expr::Local(high) - Expr::Local(low)) * GOLDEN);
            let left = code.bind("left", Ty::F32, Expr::Local(high) - width.clone());
            let right = code.bind("right", Ty::F32, Expr::Local(low) + width);
            let (l, r) = (at(left.clone()), at(right.clone()));
            let l = code.bind("at_left", Ty::F32, l);
            let r = code.bind("at_right", Ty::F32, r);
            let (keep_left, better) = if maximum {
                (l.clone().greater(r.clone()), l.max(r).max(best))
            } else {
                (l.clone().less(r.clone()), l.min(r).min(best))
            };
            code.set(best, better);
            code.if_else(keep_left, |code| code.set(high, right), |code| code.set(low, left));
            code.add(round, 1u32);
        });
        let body = code.close();
        code.push_if(Expr::Local(best_t).greater_equal(segment.a.clone()), body);
    }

    fn data_cell(&self) -> f64 {
        let roots: Vec<NodeId> = self.scene.matter.iter().filter_map(|m| m.data.as_ref()).map(|d| d.value).collect();
        self.features().length(&roots).unwrap_or(1.0 / 256.0)
    }

    /// The colour of what was found, or the background. Gives radiance and whether the ray is transparent.
    pub(super) fn projected_light(
        &mut self,
        code: &mut Code,
        ray: &super::shapes::Ray,
        projected: &Projected,
        background: Expr,
    ) -> (Expr, Expr) {
        let width = self.scene.light_width;
        let light = code.var("light", Ty::float(width), background);
        let scene: &super::matter::Scene = self.scene;
        let found = code.bind("found", Ty::U32, projected.owner);
        if self.composite == Composite::Average {
            let total = projected.means.iter().map(|m| Expr::Local(m.1)).reduce(|a, b| a + b);
            let total = code.bind("total_length", Ty::F32, total.unwrap_or(Expr::F32(1.0)).max(1e-30));
            code.open();
            code.set(light, Expr::F32(0.0).splat(width));
            for (matter, (integral, length)) in scene.matter.iter().zip(&projected.means) {
                let Some(data) = &matter.data else { continue };
                let mean = Expr::Local(*integral) / Expr::Local(*length).max(1e-30);
                let mean = code.bind("mean", Ty::F32, mean);
                let color = self.color(code, ray, data, mean);
                let share = Expr::Local(*length) / total.clone();
                code.add(light, color * share.splat(width));
            }
            let body = code.close();
            code.push_if(found.clone().greater(0u32), body);
            return (light.into(), found.equal(0u32));
        }
        for (number, matter) in scene.matter.iter().enumerate() {
            let Some(data) = &matter.data else { continue };
            code.open();
            let color = match self.composite {
                Composite::Isosurface(level) => {
                    let level = self.builder.value(self.graph, level, "level");
                    let color = self.color(code, ray, data, level);
                    let shade = self.shade(code, ray, data, matter, projected);
                    color * shade.splat(width)
                }
                Composite::Radiance | Composite::Maximum | Composite::Minimum | Composite::Average => {
                    self.color(code, ray, data, projected.best.into())
                }
            };
            code.set(light, color);
            let body = code.close();
            code.push_if(found.clone().equal(number as u32 + 1), body);
        }
        (light.into(), found.equal(0u32))
    }

    fn color(&mut self, code: &mut Code, ray: &super::shapes::Ray, data: &Data, value: Expr) -> Expr {
        let mut writer = Writer::new(self.graph, &self.scene.tiers);
        // The engine supplies the value in place of the cosine; see `Medium::data_color`.
        writer.know_input(Input::Versine, Expr::F32(1.0) - value.clone());
        writer.know_input(Input::Vercosine, Expr::F32(1.0) + value.clone());
        writer.know_input(Input::CosTheta, value);
        writer.know_input(Input::Direction, -ray.direction.clone());
        let color = writer.write(self.builder, code, &[data.color]).remove(0);
        let from = self.graph.width(data.color);
        if from == self.scene.light_width { color } else { color.splat(self.scene.light_width) }
    }

    /// |n·d| with the exact normal: a light at the eye on a Lambertian surface.
    fn shade(
        &mut self,
        code: &mut Code,
        ray: &super::shapes::Ray,
        data: &Data,
        matter: &super::matter::Matter,
        projected: &Projected,
    ) -> Expr {
        let Some(gradient) = data.gradient else { return Expr::F32(1.0) };
        let tiers = &self.scene.tiers;
        let name = format!("{}_normal", matter.name);
        let function = field_function(self.graph, tiers, self.builder, &name, matter.span, &[("gradient", gradient)]);
        let mut writer = Writer::new(self.graph, tiers);
        writer.know_input(Input::Direction, -ray.direction.clone());
        let mut arguments = vec![ray.at(projected.best.into())];
        arguments.extend(writer.write(self.builder, code, &function.hoisted));
        let n = code.bind("normal", Ty::VEC3, Expr::Call(function.id, arguments));
        let steep = code.bind("steep", Ty::F32, Expr::math(Math::Length, [n.clone()]));
        let cosine = n.dot(ray.direction.clone()).abs() / steep.clone().max(1e-30);
        steep.greater(0.0).select(cosine, 1.0)
    }
}

/// The nearest approach to a surface around the last sample but one, all three on one side: a hit if it lies beyond. The ray
/// then passes the surface between `low` and `high`.
fn graze(
    code: &mut Code,
    at: &dyn Fn(Expr) -> Expr,
    level: &Expr,
    previous: LocalId,
    (hit, low, high): (LocalId, LocalId, LocalId),
    (t, h): (&Expr, &Expr),
) {
    let from = code.bind("graze_from", Ty::F32, t.clone() - h.clone() * 2.0);
    let left_end = code.var("left_end", Ty::F32, from.clone());
    let right_end = code.var("right_end", Ty::F32, t.clone());
    let side = code.bind("side", Ty::F32, Expr::Local(previous).less(0.0).select(-1.0, 1.0));
    let round = code.var("graze_round", Ty::U32, 0u32);
    code.loop_(|code| {
        code.break_if(Expr::Local(round).greater_equal(12u32));
        let width = code.bind("width", Ty::F32, (Expr::Local(right_end) - Expr::Local(left_end)) * GOLDEN);
        let left = code.bind("left", Ty::F32, Expr::Local(right_end) - width.clone());
        let right = code.bind("right", Ty::F32, Expr::Local(left_end) + width);
        let l = code.bind("off_left", Ty::F32, (at(left.clone()) - level.clone()) * side.clone());
        let r = code.bind("off_right", Ty::F32, (at(right.clone()) - level.clone()) * side.clone());
        for (off, place) in [(&l, &left), (&r, &right)] {
            code.if_(off.clone().less(0.0).and(!Expr::Local(hit)), |code| {
                code.set(hit, Expr::Bool(true));
                code.set(low, from.clone());
                code.set(high, place.clone());
            });
        }
        code.break_if(Expr::Local(hit));
        code.if_else(l.less(r), |code| code.set(right_end, right), |code| code.set(left_end, left));
        code.add(round, 1u32);
    });
}

/// Adds what a projection needs of each medium.
pub(super) fn data_of(
    graph: &mut Graph,
    medium: &crate::ir::Medium,
    composite: Composite,
) -> Result<Option<Data>, crate::ir::derive::Unsupported> {
    let (Some(value), Some(color)) = (medium.data, medium.data_color) else { return Ok(None) };
    let gradient = if let Composite::Isosurface(_) = composite {
        let position = graph.input(Input::Position);
        Some(crate::ir::derive::gradient(graph, value, position)?)
    } else {
        None
    };
    Ok(Some(Data { value, color, gradient }))
}
