//! The function `trace(origin, direction, start)`: one ray through all media.
//!
//! The ray is cut at every boundary of a shape into segments in which the set of media is constant. A segment in which all
//! coefficients have closed forms costs no step; in others the midpoint rule with the exact exponential inside a step
//! (Hillaire 2015) is applied once over a step and again over its halves: the halves are the result, the difference steers
//! the step and is the reported error.
//!
//! Optical depths are summed and never multiplied up as transmittances, so that nothing underflows early.

use super::march::OPAQUE;
use super::matter::{Matter, Scene};
use super::project::Projected;
use super::shapes::{FAR, Ray, SdfFunctions, SpanFunctions, primitive_span, sdf_functions};
use crate::analysis::feature::lipschitz;
use crate::fields::{Code, FieldFunction, Helper, KernelBuilder, Writer, field_function};
use crate::ir::{Composite, Graph, Input, NodeId, PrimitiveKind, Tier};
use crate::program::kernel::{BinaryOp, Expr, FunctionId, LocalId, Math, Prim, Ty};
use crate::program::{Fault, Ledger, OutputKind, StepRule};

/// What a traced ray returns, and where in the struct.
pub(super) struct Traced {
    pub(super) function: FunctionId,
    pub(super) fields: Vec<(OutputKind, u8)>,
}

/// The values of a medium's coefficients where they do not depend on the position.
#[derive(Clone, Default)]
pub(super) struct Constant {
    extinction: Option<Expr>,
    emission: Option<Expr>,
}

/// One medium while the function is written.
pub(super) struct Medium<'a> {
    matter: &'a Matter,
    constant: Constant,
    /// Its function of the position, with the values it takes from the ray.
    pub(super) function: Option<(FieldFunction, Vec<Expr>)>,
    /// Position of each varying field in the function's result.
    extinction_at: Option<usize>,
    emission_at: Option<usize>,
    checks_at: Vec<(usize, u32, u32)>,
    /// Whether it is here; `None` is always.
    pub(super) here: Option<Expr>,
}

impl<'a> Medium<'a> {
    /// Without any coefficient.
    pub(super) fn plain(matter: &'a Matter) -> Self {
        let constant = Constant::default();
        Self { matter, constant, function: None, extinction_at: None, emission_at: None, checks_at: vec![], here: None }
    }
}

/// A stretch of a ray in which the set of media is constant.
pub(super) struct Segment {
    pub(super) ray: Ray,
    pub(super) a: Expr,
    pub(super) b: Expr,
    /// The length that errors are shared out over; `None` is the segment's own.
    pub(super) reach: Option<Expr>,
}

pub(super) struct Tracer<'a> {
    pub(super) graph: &'a Graph,
    pub(super) scene: &'a Scene,
    pub(super) builder: &'a mut KernelBuilder,
    pub(super) spans: SpanFunctions,
    pub(super) rule: StepRule,
    pub(super) composite: Composite,
    pub(super) wanted: Vec<OutputKind>,
    pub(super) max_work: u32,
    pub(super) shells: Vec<(NodeId, NodeId)>,
}

/// Variables of the function.
pub(super) struct State {
    pub(super) depth: Option<LocalId>,
    pub(super) radiance: Option<LocalId>,
    pub(super) error: Option<LocalId>,
    pub(super) work: Option<LocalId>,
    fault: Option<LocalId>,
    fault_at: Option<LocalId>,
    pub(super) projected: Option<Projected>,
}

/// A sample of all media at a point.
pub(super) struct Sampled {
    pub(super) extinction: Option<Expr>,
    pub(super) emission: Option<Expr>,
}

pub(super) fn largest(value: Expr, width: u8) -> Expr {
    (1..width).fold(value.clone().component_if(width, 0), |m, i| m.max(value.clone().component(i)))
}

pub(super) fn least(value: Expr, width: u8) -> Expr {
    (1..width).fold(value.clone().component_if(width, 0), |m, i| m.min(value.clone().component(i)))
}

trait ComponentIf {
    fn component_if(self, width: u8, i: u8) -> Expr;
}

impl ComponentIf for Expr {
    fn component_if(self, width: u8, i: u8) -> Expr {
        if width == 1 { self } else { self.component(i) }
    }
}

pub(super) fn widen(value: Expr, from: u8, to: u8) -> Expr {
    if from == to { value } else { value.splat(to) }
}

impl Tracer<'_> {
    pub(super) fn wants(&self, kind: OutputKind) -> bool {
        self.wanted.contains(&kind)
    }

    /// Writes the function.
    pub(super) fn write(mut self, ledger: &mut Ledger) -> Traced {
        let scene = self.scene;
        let mut code = Code::new("trace", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let start = code.parameter("start", Ty::F32);
        let state = self.declare(&mut code, ledger);
        let sdfs = self.sdfs();
        let names = self.primitive_names();
        let mut spans: Vec<Option<Expr>> = vec![];
        for (primitive, name) in scene.primitives.iter().zip(&names) {
            let span = primitive_span(self.graph, self.builder, &mut self.spans, &mut code, &ray, primitive, name);
            spans.push(span);
        }
        let mut media = match self.composite {
            Composite::Radiance => self.media(&mut code, &ray),
            Composite::Maximum | Composite::Minimum | Composite::Average | Composite::Isosurface(_) => {
                self.data_media(&mut code, &ray)
            }
        };
        let simple = match scene.matter.as_slice() {
            [only] => matches!(only.region, super::shapes::Region::Leaf(i) if spans[i].is_some()),
            _ => false,
        };
        if simple {
            let span = spans.iter().flatten().next().cloned().expect("a simple scene has one span");
            let a = code.bind("enter", Ty::F32, span.clone().component(0).max(start));
            let b = code.bind("leave", Ty::F32, span.component(1));
            code.open();
            let reach = Some(b.clone() - a.clone());
            self.segment(&mut code, &state, &media, &Segment { ray: ray.clone(), a: a.clone(), b: b.clone(), reach });
            let body = code.close();
            code.push_if(b.greater(a), body);
            ledger.omit("loop over segments", "one convex medium cuts a ray at most twice", scene.matter[0].span);
        } else if scene.primitives.is_empty() {
            let segment = Segment { ray: ray.clone(), a: start, b: Expr::F32(FAR), reach: None };
            self.segment(&mut code, &state, &media, &segment);
            if !scene.matter.is_empty() {
                ledger.omit("loop over segments", "no shape cuts the rays", None);
            }
        } else {
            self.segments(&mut code, &ray, &state, &mut media, &spans, &sdfs, start);
        }
        self.finish(code, &ray, &state)
    }

    fn declare(&mut self, code: &mut Code, ledger: &mut Ledger) -> State {
        let scene = self.scene;
        let through = self.composite == Composite::Radiance;
        let depth = (through && scene.attenuates())
            .then(|| code.var("depth", Ty::float(scene.depth_width), Expr::F32(0.0).splat(scene.depth_width)));
        let radiance = (through && scene.glows() && self.wants(OutputKind::Radiance))
            .then(|| code.var("radiance", Ty::float(scene.light_width), Expr::F32(0.0).splat(scene.light_width)));
        if depth.is_none() && through {
            ledger.omit("optical depth", "nothing attenuates", None);
        }
        if radiance.is_none() && through {
            ledger.omit("emission along the ray", "nothing shines", None);
        }
        let steps = !matches!(self.rule, StepRule::Closed);
        let error = (steps && self.wants(OutputKind::Error)).then(|| code.var("error", Ty::F32, 0.0));
        let adaptive = matches!(self.rule, StepRule::Adaptive(_));
        let work =
            (steps && (adaptive || self.wants(OutputKind::Evaluations))).then(|| code.var("work", Ty::U32, 0u32));
        let checked = through && scene.matter.iter().any(|m| !m.checks.is_empty()) && self.wants(OutputKind::Fault);
        let fault = checked.then(|| code.var("fault", Ty::U32, 0u32));
        let fault_at = checked.then(|| code.var("fault_at", Ty::VEC3, Expr::F32(0.0).splat(3)));
        if !checked && through && !scene.matter.is_empty() {
            ledger.omit(
                "check of coefficients",
                "every coefficient is proved finite and not negative, or checked on the host",
                None,
            );
        }
        let projected = (self.composite != Composite::Radiance).then(|| self.declare_projection(code));
        State { depth, radiance, error, work, fault, fault_at, projected }
    }

    fn primitive_names(&self) -> Vec<String> {
        let mut names = vec![];
        for (i, primitive) in self.scene.primitives.iter().enumerate() {
            let owner = self.scene.matter.iter().find(|m| {
                let mut leaves = vec![];
                collect(&m.region, &mut leaves);
                leaves.contains(&i)
            });
            let word = match primitive.kind {
                PrimitiveKind::Sphere { .. } => "ball",
                PrimitiveKind::Ellipsoid { .. } => "ellipsoid",
                PrimitiveKind::Box { .. } => "box",
                PrimitiveKind::Slab { .. } => "slab",
                PrimitiveKind::Cylinder { .. } => "cylinder",
                PrimitiveKind::Shell { .. } => "shell",
                PrimitiveKind::Sdf { .. } => "sdf",
            };
            let owner = owner.map_or("shape", |m| m.name.as_str());
            names.push(if owner == word { word.to_owned() } else { format!("{owner}_{word}") });
        }
        names
    }

    fn sdfs(&mut self) -> Vec<Option<SdfFunctions>> {
        let steepness = lipschitz(self.graph);
        let scene = self.scene;
        let mut out = vec![];
        for (i, primitive) in scene.primitives.iter().enumerate() {
            out.push(match primitive.kind {
                PrimitiveKind::Sdf { field } => {
                    let slope = steepness[field.0 as usize].max(1.0);
                    let name = format!("sdf_{i}");
                    let cap = self.max_work.min(4096);
                    Some(sdf_functions(self.graph, &scene.tiers, self.builder, &name, field, slope, cap))
                }
                PrimitiveKind::Sphere { .. }
                | PrimitiveKind::Ellipsoid { .. }
                | PrimitiveKind::Box { .. }
                | PrimitiveKind::Slab { .. }
                | PrimitiveKind::Cylinder { .. }
                | PrimitiveKind::Shell { .. } => None,
            });
        }
        out
    }

    /// Writes the functions of varying media and evaluates the constant coefficients.
    fn media<'s>(&mut self, code: &mut Code, ray: &Ray) -> Vec<Medium<'s>>
    where
        Self: 's,
    {
        let scene: &Scene = self.scene;
        let tiers = &scene.tiers;
        let varies = |n: Option<NodeId>| n.filter(|n| tiers[n.0 as usize] == Tier::Sample);
        let mut out = vec![];
        for matter in &scene.matter {
            let (extinction, emission) = (varies(matter.extinction), varies(matter.emission));
            let checks = if self.wants(OutputKind::Fault) { matter.checks.as_slice() } else { &[] };
            let mut roots: Vec<(&str, NodeId)> = vec![];
            let mut place = |name: &'static str, node: NodeId| {
                roots.iter().position(|r| r.1 == node).unwrap_or_else(|| {
                    roots.push((name, node));
                    roots.len() - 1
                })
            };
            // Where steps are taken, everything that varies is sampled; where all is closed, nothing is.
            let sampled = !scene.closed && matter.varying;
            let extinction_at = extinction.filter(|_| sampled).map(|n| place("k_t", n));
            let emission_at = emission.filter(|_| sampled).map(|n| place("k_e", n));
            let checks_at: Vec<(usize, u32, u32)> = checks
                .iter()
                .filter(|_| sampled)
                .map(|c| {
                    let fault = |not_finite| Fault { medium: matter.index, field: c.field, not_finite }.code();
                    (place(c.field, c.node), fault(false), fault(true))
                })
                .collect();
            let function = sampled.then(|| {
                let name = format!("{}_at", matter.name);
                let function = field_function(self.graph, tiers, self.builder, &name, matter.span, &roots);
                let mut writer = Writer::new(self.graph, tiers);
                writer.know_input(Input::Direction, ray.direction.clone());
                let hoisted = writer.write(self.builder, code, &function.hoisted);
                (function, hoisted)
            });
            let mut constant = |node: Option<NodeId>, varying: Option<NodeId>, name: &str| {
                if varying.is_some() {
                    return None;
                }
                node.map(|n| {
                    if tiers[n.0 as usize] <= Tier::Frame {
                        return self.builder.value(self.graph, n, &format!("{}_{name}", matter.name));
                    }
                    let mut writer = Writer::new(self.graph, tiers);
                    writer.know_input(Input::Direction, ray.direction.clone());
                    let value = writer.write(self.builder, code, &[n]).remove(0);
                    code.bind(&format!("{}_{name}", matter.name), Ty::float(self.graph.width(n)), value)
                })
            };
            let constant = Constant {
                extinction: constant(matter.extinction, extinction, "k_t"),
                emission: constant(matter.emission, emission, "k_e"),
            };
            out.push(Medium { matter, constant, function, extinction_at, emission_at, checks_at, here: None });
        }
        out
    }

    /// The loop over segments between boundaries.
    fn segments(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        media: &mut [Medium<'_>],
        spans: &[Option<Expr>],
        sdfs: &[Option<SdfFunctions>],
        start: Expr,
    ) {
        let t = code.var("t", Ty::F32, start.clone());
        // What the sdfs take from the ray.
        let sdf_arguments: Vec<Vec<Expr>> = sdfs
            .iter()
            .map(|sdf| {
                sdf.as_ref().map_or(vec![], |sdf| {
                    let mut writer = Writer::new(self.graph, &self.scene.tiers);
                    writer.know_input(Input::Direction, ray.direction.clone());
                    writer.write(self.builder, code, &sdf.field.hoisted)
                })
            })
            .collect();
        // Errors and fixed steps are shared out in proportion to length, where the length is known beforehand.
        let all_known = spans.iter().all(Option::is_some);
        let reach = (all_known && !matches!(self.rule, StepRule::Closed)).then(|| {
            let ends = spans.iter().flatten();
            let first = ends.clone().map(|s| s.clone().component(0)).reduce(Expr::min).expect("there is a shape");
            let last = ends.map(|s| s.clone().component(1)).reduce(Expr::max).expect("there is a shape");
            code.bind("reach", Ty::F32, last.min(1.0e30) - first.max(start.clone()))
        });
        code.open();
        let next = code.var("next", Ty::F32, FAR);
        for span in spans.iter().flatten() {
            for i in 0..2 {
                let end = span.clone().component(i);
                let ahead = end.clone().greater(Expr::Local(t)).select(end, FAR);
                code.set(next, Expr::Local(next).min(ahead));
            }
        }
        for (sdf, arguments) in sdfs.iter().zip(&sdf_arguments) {
            if let Some(sdf) = sdf {
                let mut all = vec![ray.origin.clone(), ray.direction.clone(), t.into(), next.into()];
                all.extend(arguments.iter().cloned());
                code.set(next, Expr::Call(sdf.next, all));
            }
        }
        let middle = Expr::Local(next)
            .greater_equal(FAR)
            .select(Expr::Local(t) + (Expr::Local(t).abs() + 1.0), (Expr::Local(t) + Expr::Local(next)) * 0.5);
        let middle = code.bind("middle", Ty::F32, middle);
        let mut inside = vec![];
        for (i, span) in spans.iter().enumerate() {
            let value = match (span, &sdfs[i]) {
                (Some(span), _) => {
                    let after = middle.clone().greater(span.clone().component(0));
                    after.and(middle.clone().less(span.clone().component(1)))
                }
                (None, Some(sdf)) => {
                    let mut all = vec![ray.at(middle.clone())];
                    all.extend(sdf_arguments[i].iter().cloned());
                    Expr::Call(sdf.field.id, all).less(0.0)
                }
                (None, None) => Expr::Bool(false),
            };
            inside.push(code.bind(&format!("in_{i}"), Ty::BOOL, value));
        }
        for medium in media.iter_mut() {
            let here = medium.matter.region.inside(&|i| inside[i].clone());
            medium.here = here.map(|h| code.bind(&format!("in_{}", medium.matter.name), Ty::BOOL, h));
        }
        let anywhere = media.iter().map(|m| m.here.clone()).collect::<Option<Vec<Expr>>>();
        let anywhere = anywhere.and_then(|all| all.into_iter().reduce(Expr::or));
        code.open();
        self.segment(code, state, media, &Segment { ray: ray.clone(), a: t.into(), b: next.into(), reach });
        let body = code.close();
        match anywhere {
            Some(condition) => code.push_if(condition, body),
            None => code.push_all(body),
        }
        code.set(t, next);
        code.break_if(Expr::Local(next).greater_equal(FAR));
        if let Some(depth) = state.depth {
            let dark = least(depth.into(), self.scene.depth_width).greater(OPAQUE);
            if !self.wants(OutputKind::OpticalDepth) {
                code.break_if(dark);
            }
        }
        let block = code.close();
        code.push_loop(block);
    }

    /// Adds a segment to the state.
    fn segment(&mut self, code: &mut Code, state: &State, media: &[Medium<'_>], segment: &Segment) {
        if media.is_empty() {
            return;
        }
        if self.composite != Composite::Radiance {
            self.project_segment(code, state, media, segment);
            return;
        }
        let Segment { ray, a, b, .. } = segment;
        if self.scene.closed {
            self.closed(code, ray, state, media, a, b);
            return;
        }
        // Where only closed forms are present, no step is taken, and only there may a segment be endless.
        let stepped: Vec<&Medium<'_>> = media.iter().filter(|m| m.function.is_some()).collect();
        let any = stepped.iter().map(|m| m.here.clone()).collect::<Option<Vec<Expr>>>();
        let any = any.and_then(|all| all.into_iter().reduce(Expr::or));
        let others: Vec<&Medium<'_>> = media.iter().filter(|m| m.function.is_none()).collect();
        match any {
            Some(condition) if !others.is_empty() => {
                code.open();
                self.march(code, state, media, segment);
                let steps = code.close();
                code.open();
                self.closed_some(code, state, &others, a, b);
                let closed = code.close();
                code.push_if_else(condition, steps, closed);
            }
            _ => self.march(code, state, media, segment),
        }
    }

    /// e^(−depth), in the width of the radiance.
    fn transmittance(&self, state: &State) -> Option<Expr> {
        let depth = state.depth?;
        Some((-Expr::Local(depth)).exp())
    }

    pub(super) fn weighted(&self, state: &State, light: Expr, width: u8) -> Expr {
        let to = self.scene.light_width;
        let light = widen(light, width, to);
        match self.transmittance(state) {
            Some(t) => widen(t, self.scene.depth_width, to) * light,
            None => light,
        }
    }

    pub(super) fn attenuated(&mut self, code: &mut Code, x: Expr, width: u8) -> Expr {
        if width == 1 {
            return self.builder.call(self.graph, Helper::Attenuated, [x]);
        }
        let x = code.bind("x", Ty::float(width), x);
        let parts = (0..width).map(|i| self.builder.call(self.graph, Helper::Attenuated, [x.clone().component(i)]));
        Expr::Compose(Ty::float(width), parts.collect())
    }

    /// Adds up what is constant in the segment.
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

    fn width(&self, node: Option<NodeId>) -> u8 {
        node.map_or(1, |n| self.graph.width(n))
    }

    /// A segment of uniform media.
    fn closed_some(&mut self, code: &mut Code, state: &State, media: &[&Medium<'_>], a: &Expr, b: &Expr) {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let collect = |of: &dyn Fn(&Medium<'_>) -> (Option<Expr>, u8)| {
            let parts = media.iter().filter_map(|m| {
                let (value, width) = of(m);
                Some((m.here.clone(), value?, width))
            });
            parts.collect::<Vec<_>>()
        };
        let extinction = collect(&|m| (m.constant.extinction.clone(), self.width(m.matter.extinction)));
        let emission = collect(&|m| (m.constant.emission.clone(), self.width(m.matter.emission)));
        let unbounded = media.iter().any(|m| m.matter.region.is_unbounded(&self.scene.primitives));
        let length = code.bind("length", Ty::F32, b.clone() - a.clone());
        let k_t = self.total(code, extinction, dw, "k_t");
        let x = k_t.map(|k_t| {
            let x = k_t * length.clone().splat(dw);
            // An endless segment is opaque where there is anything at all: 0 · 3e38 is 0.
            code.bind("x", Ty::float(dw), if unbounded { x.min(Expr::F32(FAR).splat(dw)) } else { x })
        });
        if let Some(radiance) = state.radiance
            && let Some(k_e) = self.total(code, emission, lw, "k_e")
        {
            let light = match &x {
                Some(x) => {
                    let mean = self.attenuated(code, x.clone(), dw);
                    k_e * widen(mean * length.splat(dw), dw, lw)
                }
                None => k_e * length.splat(lw),
            };
            let light = self.weighted(state, light, lw);
            code.add(radiance, light);
        }
        if let (Some(depth), Some(x)) = (state.depth, x) {
            code.add(depth, x);
        }
    }

    /// A segment in a scene in which every segment has a closed form.
    fn closed(&mut self, code: &mut Code, ray: &Ray, state: &State, media: &[Medium<'_>], a: &Expr, b: &Expr) {
        if media.iter().all(|m| !m.matter.varying) {
            let all: Vec<&Medium<'_>> = media.iter().collect();
            self.closed_some(code, state, &all, a, b);
            return;
        }
        let dw = self.scene.depth_width;
        let lw = self.scene.light_width;
        let mut parts = vec![];
        for medium in media {
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
        let Some(x) = self.total(code, parts, dw, "x") else { return };
        let x = code.bind("x", Ty::float(dw), x.min(Expr::F32(FAR).splat(dw)));
        let source = media.iter().find_map(|m| m.matter.source);
        if let (Some(radiance), Some(source)) = (state.radiance, source) {
            let s = self.builder.value(self.graph, source, "source");
            let s = widen(s, self.graph.width(source), lw);
            let parts = (0..dw).map(|i| {
                let x = x.clone().component_if(dw, i);
                -self.builder.call(self.graph, Helper::Expm1, [-x])
            });
            let parts: Vec<Expr> = parts.collect();
            let absorbed = if dw == 1 { parts[0].clone() } else { Expr::Compose(Ty::float(dw), parts) };
            let light = self.weighted(state, s * widen(absorbed, dw, lw), lw);
            code.add(radiance, light);
        }
        if let Some(depth) = state.depth {
            code.add(depth, x);
        }
    }

    /// The altitude over a shell at a distance along the ray, without cancelling in the distance.
    fn altitude(&mut self, code: &mut Code, ray: &Ray, shell: u32, t: &Expr) -> Expr {
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
        let (dw, lw) = (self.scene.depth_width, self.emission_width());
        let t = code.bind(&format!("t_{tag}"), Ty::F32, t);
        let p = code.bind(&format!("p_{tag}"), Ty::VEC3, ray.at(t.clone()));
        let single = media.len() == 1 && media[0].here.is_none();
        if single {
            let (extinction, emission) = self.sample_one(code, ray, state, &media[0], &p, &t);
            let extinction = extinction.map(|e| code.bind(&format!("k_t_{tag}"), Ty::float(dw), e));
            let emission = emission.map(|e| code.bind(&format!("k_e_{tag}"), Ty::float(lw), e));
            return Sampled { extinction, emission };
        }
        let extinction = state.depth.map(|_| code.var(&format!("k_t_{tag}"), Ty::float(dw), Expr::F32(0.0).splat(dw)));
        let emission = state.radiance.map(|_| code.var(&format!("k_e_{tag}"), Ty::float(lw), Expr::F32(0.0).splat(lw)));
        for medium in media {
            code.open();
            let (k_t, k_e) = self.sample_one(code, ray, state, medium, &p, &t);
            if let (Some(total), Some(value)) = (extinction, k_t) {
                code.add(total, value);
            }
            if let (Some(total), Some(value)) = (emission, k_e) {
                code.add(total, value);
            }
            let body = code.close();
            match &medium.here {
                Some(here) => code.push_if(here.clone(), body),
                None => code.push_all(body),
            }
        }
        let bind = |code: &mut Code, var: Option<LocalId>, name: &str, width: u8| {
            var.map(|v| code.bind(&format!("{name}_{tag}"), Ty::float(width), v))
        };
        Sampled { extinction: bind(code, extinction, "k_t", dw), emission: bind(code, emission, "k_e", lw) }
    }

    pub(super) fn emission_width(&self) -> u8 {
        self.scene.matter.iter().map(|m| self.width(m.emission)).max().unwrap_or(1)
    }

    /// Evaluates one medium, in the widths of the scene.
    fn sample_one(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        medium: &Medium<'_>,
        p: &Expr,
        t: &Expr,
    ) -> (Option<Expr>, Option<Expr>) {
        let (dw, lw) = (self.scene.depth_width, self.emission_width());
        let matter = medium.matter;
        let (extinction_width, emission_width) = (self.width(matter.extinction), self.width(matter.emission));
        let mut extinction = medium.constant.extinction.clone();
        let mut emission = medium.constant.emission.clone();
        if let Some((function, hoisted)) = &medium.function {
            let mut arguments = vec![p.clone()];
            arguments.extend(hoisted.iter().cloned());
            for shell in &function.altitudes {
                let h = self.altitude(code, ray, *shell, t);
                arguments.push(h);
            }
            let value = code.bind(&matter.name, function.result, Expr::Call(function.id, arguments));
            let part = |i: usize| function.part(&value, i);
            if let (Some(fault), Some(fault_at)) = (state.fault, state.fault_at) {
                for (at, negative, not_finite) in &medium.checks_at {
                    check(
                        code,
                        fault,
                        fault_at,
                        part(*at),
                        self.check_width(matter, *at, medium),
                        *negative,
                        *not_finite,
                        p,
                    );
                }
            }
            extinction = medium.extinction_at.map(part).or(extinction);
            emission = medium.emission_at.map(part).or(emission);
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
        let extinction = extinction.map(|e| guard(e, extinction_width, dw, medium.extinction_at.is_some()));
        let emission = emission.map(|e| guard(e, emission_width, lw, medium.emission_at.is_some()));
        (extinction, emission.filter(|_| state.radiance.is_some()))
    }

    fn check_width(&self, matter: &Matter, at: usize, medium: &Medium<'_>) -> u8 {
        if medium.extinction_at == Some(at) {
            return self.width(matter.extinction);
        }
        if medium.emission_at == Some(at) {
            return self.width(matter.emission);
        }
        matter
            .checks
            .iter()
            .zip(&medium.checks_at)
            .find(|(_, c)| c.0 == at)
            .map_or(1, |(c, _)| self.graph.width(c.node))
    }

    /// Radiance of the background, in the width of light.
    fn background(&mut self, code: &mut Code, ray: &Ray) -> Option<Expr> {
        let node = self.scene.background?;
        let mut writer = Writer::new(self.graph, &self.scene.tiers);
        writer.know_input(Input::Direction, ray.direction.clone());
        let value = writer.write(self.builder, code, &[node]).remove(0);
        Some(widen(value, self.graph.width(node), self.scene.light_width))
    }

    /// What the media shine and let through.
    fn radiance(&mut self, code: &mut Code, ray: &Ray, state: &State) -> Expr {
        let width = self.scene.light_width;
        let light = state.radiance.map(Expr::Local);
        let behind = self.background(code, ray).map(|value| self.weighted(state, value, width));
        match (light, behind) {
            (Some(light), Some(behind)) => light + behind,
            (Some(light), None) | (None, Some(light)) => light,
            (None, None) => Expr::F32(0.0).splat(width),
        }
    }

    /// The struct that is returned.
    fn finish(mut self, mut code: Code, ray: &Ray, state: &State) -> Traced {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let mut shown = None;
        if let Some(projected) = &state.projected {
            let background = self.background(&mut code, ray);
            let background = background.unwrap_or_else(|| Expr::F32(0.0).splat(lw));
            shown = Some(self.projected_light(&mut code, ray, projected, background));
        }
        let mut fields: Vec<(OutputKind, u8)> = vec![];
        let mut values = vec![];
        for kind in self.wanted.clone() {
            match kind {
                OutputKind::Radiance => {
                    let light = match &shown {
                        Some((light, _)) => light.clone(),
                        None => self.radiance(&mut code, ray, state),
                    };
                    fields.push((kind, lw));
                    values.push(light);
                }
                OutputKind::Transmittance => {
                    fields.push((kind, dw));
                    values.push(match &shown {
                        Some((_, clear)) => clear.clone().select(1.0, 0.0).splat(dw),
                        None => self.transmittance(state).unwrap_or(Expr::F32(1.0)),
                    });
                }
                OutputKind::OpticalDepth => {
                    fields.push((kind, dw));
                    values.push(match &shown {
                        Some((_, clear)) => clear.clone().select(0.0, FAR).splat(dw),
                        None => state.depth.map_or(Expr::F32(0.0), Expr::Local),
                    });
                }
                OutputKind::Error => {
                    fields.push((kind, 1));
                    values.push(state.error.map_or(Expr::F32(0.0), Expr::Local));
                }
                OutputKind::Evaluations => {
                    fields.push((kind, 1));
                    values.push(state.work.map_or(Expr::F32(0.0), |w| Expr::Local(w).convert(Prim::F32)));
                }
                OutputKind::Fault => {
                    if let (Some(fault), Some(at)) = (state.fault, state.fault_at) {
                        fields.push((kind, 4));
                        let at = |i| Expr::Local(at).component(i);
                        let bits = Expr::Local(fault).bitcast(Prim::F32);
                        values.push(Expr::Compose(Ty::float(4), vec![bits, at(0), at(1), at(2)]));
                    }
                }
                // Made by the entry point, which knows the pixel.
                OutputKind::Edge => {}
            }
        }
        let names = fields.iter().map(|(kind, width)| (super::output_name(*kind).to_owned(), Ty::float(*width)));
        let result = self.builder.add_struct("Traced", names.collect());
        code.return_(Expr::Compose(result, values));
        let function = self.builder.add_function(code.finish(Some(result)));
        Traced { function, fields }
    }
}

fn collect(region: &super::shapes::Region, out: &mut Vec<usize>) {
    use super::shapes::Region;
    match region {
        Region::Everywhere => {}
        Region::Leaf(i) => out.push(*i),
        Region::Union(parts) | Region::Intersection(parts) => parts.iter().for_each(|r| collect(r, out)),
        Region::Difference(first, rest) => {
            collect(first, out);
            rest.iter().for_each(|r| collect(r, out));
        }
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
