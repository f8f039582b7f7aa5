//! The function `trace(origin, direction, start)`: one ray through all media, up to the first surface.
//!
//! The ray is cut at every boundary of a shape into segments in which the set of media is constant. A segment in which all
//! light has closed forms costs no step. In others coefficients are sampled at five points of a step (`nodes`), and Simpson's
//! rule gives their means over the step and over its halves; light is the exact exponential through a source that is constant
//! over each of these (Hillaire 2015). The halves are the result, the difference steers the step and is the reported error
//! (`march`). A number of `steps` that is asked for takes the midpoint rule instead, at order 2. The function `shadow` is the
//! same walk towards a light, for the optical depth alone.
//!
//! Optical depths are summed and never multiplied up as transmittances, so that nothing underflows early.

use super::light::{InScattered, Shadow};
use super::march::OPAQUE;
use super::matter::{Matter, Scene};
use super::media::Medium;
use super::project::Projected;
use super::shapes::{Boundaries, FAR, Ray, Region, SdfFunctions, SpanFunctions, primitive_span, sdf_functions};
use super::sheets::Nearest;
use crate::analysis::feature::Features;
use crate::fields::{Code, FieldFunction, KernelBuilder, Writer};
use crate::ir::{Composite, FieldScene, Graph, Input, NodeId, PrimitiveKind, Tier};
use crate::program::kernel::{Expr, FunctionId, LocalId, Prim, Ty};
use crate::program::{Fault, FrameValue, Ledger, OutputKind, StepRule};

/// What a handful of operations and an exponential of f32 may be wrong by, relative.
const ROUNDED: f64 = 6.0 * super::rounded::HALF_ULP;

/// What a traced ray returns, and where in the struct.
pub(crate) struct Traced {
    pub(crate) function: FunctionId,
    pub(crate) fields: Vec<(OutputKind, u8)>,
    /// For paths.
    pub(crate) random: Option<super::paths::Random>,
    /// What fills the cache, and its entry point.
    pub(crate) fill: Option<(crate::program::FillPass, crate::program::kernel::Function)>,
}

/// A stretch of a ray in which the set of media is constant.
pub(super) struct Segment {
    pub(super) ray: Ray,
    pub(super) a: Expr,
    pub(super) b: Expr,
    /// The length that errors are shared out over; `None` is the segment's own.
    pub(super) reach: Option<Expr>,
    /// Whether steps are shared out over it as well.
    pub(super) part: bool,
    /// Where the slab begins and ends that it lies in, if it does.
    pub(super) slab: Option<[Expr; 2]>,
}

/// The part of a ray that counts.
pub(super) struct Stretch {
    pub(super) start: Expr,
    /// `None` is infinity.
    pub(super) end: Option<Expr>,
    /// The length of the whole of which it is a part, if errors and steps are shared out over that.
    pub(super) whole: Option<Expr>,
}

/// What a walk along a ray is for.
#[derive(Clone)]
pub(super) enum Walk {
    /// Everything that the eye sees.
    Eye,
    /// The optical depth towards a light, to within this share of the transmittance or of `accuracy`.
    Shadow { dim: Expr },
    /// What light loses in a slab, on the way to it.
    Light,
    /// A flight of a path, to its next collision.
    Path(super::paths::Flight),
    /// An unbiased estimate of the transmittance towards a light.
    Ratio(super::paths::Ratio),
}

pub(crate) struct Tracer<'a> {
    pub(super) graph: &'a Graph,
    /// Found when something asks for them.
    pub(super) features: std::cell::OnceCell<Features<'a>>,
    pub(super) scene: &'a Scene,
    pub(super) builder: &'a mut KernelBuilder,
    pub(super) spans: SpanFunctions,
    pub(crate) rule: StepRule,
    pub(super) composite: Composite,
    pub(super) wanted: Vec<OutputKind>,
    pub(super) max_work: u32,
    pub(super) shells: Vec<(NodeId, NodeId)>,
    pub(super) walk: Walk,
    pub(super) nearest: Option<Nearest>,
    pub(super) shadow: Option<Shadow>,
    pub(super) in_scattered: Option<InScattered>,
    /// Columns of light that are kept.
    pub(super) cache: Option<super::cache::Cache>,
    /// Whether light is followed from slab to slab.
    pub(super) half_angle: bool,
    /// How, where that is worth it.
    pub(super) buffered: Option<super::half::Buffered>,
    /// While a slab is written: where its near plane is.
    pub(super) plane: Option<Expr>,
    /// Which media a shadow is of; `None` is all.
    pub(super) only: Option<fn(&Self, &Matter) -> bool>,
    /// Of paths.
    pub(super) random: Option<super::paths::Random>,
    /// `transmitted` of paths.
    pub(super) transmitted: Option<FunctionId>,
    /// The functions that read bounds of media, by number.
    pub(super) bricks: Vec<(u32, FunctionId)>,
    /// The function that tells on which side of curved jumps a place lies.
    pub(super) sides: Option<FieldFunction>,
    /// The functions that give the arguments of what is narrow, by number.
    pub(super) narrows: Vec<(u32, FieldFunction)>,
    /// The functions that say how far steps may go below the scalars that tell media.
    pub(super) clears: Vec<(u32, FunctionId)>,
}

/// Sums of parts of the error.
#[derive(Copy, Clone, Default)]
pub(super) struct Apart {
    pub(super) rounding: Option<LocalId>,
    pub(super) storage: Option<LocalId>,
    /// What the optical depth may be wrong by so far, where light lies behind it.
    pub(super) depth: Option<LocalId>,
}

/// Where an error comes from, if not from the rule that integrates.
#[derive(Copy, Clone)]
pub(super) enum Origin {
    Rounding,
    /// What is left out on purpose.
    Storage,
}

impl State {
    /// Adds to the error what does not come from the rule.
    pub(super) fn add_error(&self, code: &mut Code, origin: Origin, amount: Expr) {
        let Some(error) = self.error else { return };
        let part = match origin {
            Origin::Rounding => self.apart.rounding,
            Origin::Storage => self.apart.storage,
        };
        match part {
            Some(part) => {
                let amount = code.bind("amount", Ty::F32, amount);
                code.add(error, amount.clone());
                code.add(part, amount);
            }
            None => code.add(error, amount),
        }
    }
}

/// Variables of the function.
pub(super) struct State {
    pub(super) depth: Option<LocalId>,
    pub(super) radiance: Option<LocalId>,
    pub(super) error: Option<LocalId>,
    /// Parts of the error that are told apart, where they are wanted.
    pub(super) apart: Apart,
    pub(super) work: Option<LocalId>,
    pub(super) fault: Option<LocalId>,
    pub(super) fault_at: Option<LocalId>,
    pub(super) projected: Option<Projected>,
}

pub(super) fn largest(value: Expr, width: u8) -> Expr {
    (1..width).fold(value.clone().component_if(width, 0), |m, i| m.max(value.clone().component(i)))
}

pub(super) fn least(value: Expr, width: u8) -> Expr {
    (1..width).fold(value.clone().component_if(width, 0), |m, i| m.min(value.clone().component(i)))
}

pub(super) trait ComponentIf {
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

/// Whether the driver has ended loops by now: then a loop of two rounds ends after one.
pub(crate) fn cut_short(builder: &mut KernelBuilder, code: &mut Code) -> Expr {
    let rounds = builder.frame(FrameValue::Rounds);
    let done = code.var("rounds_done", Ty::U32, 0u32);
    code.open();
    code.add(done, 1u32);
    code.break_if(Expr::Local(done).greater_equal(rounds.clone()));
    let block = code.close();
    code.push_loop(block);
    Expr::Local(done).less(rounds)
}

impl<'a> Tracer<'a> {
    /// What is `wanted` of rays through a scene, stepped through by a rule.
    pub(crate) fn new(
        scene: &'a FieldScene,
        seen: &'a Scene,
        builder: &'a mut KernelBuilder,
        rule: StepRule,
        wanted: Vec<OutputKind>,
    ) -> Self {
        Self {
            graph: &scene.graph,
            features: std::cell::OnceCell::new(),
            scene: seen,
            builder,
            spans: SpanFunctions::default(),
            rule,
            composite: scene.render.composite,
            wanted,
            max_work: scene.render.max_work,
            shells: scene.shells.clone(),
            walk: Walk::Eye,
            nearest: None,
            shadow: None,
            in_scattered: None,
            cache: None,
            half_angle: false,
            buffered: None,
            plane: None,
            only: None,
            random: None,
            transmitted: None,
            bricks: vec![],
            sides: None,
            narrows: vec![],
            clears: vec![],
        }
    }
}

impl Tracer<'_> {
    pub(super) fn wants(&self, kind: OutputKind) -> bool {
        self.wanted.contains(&kind)
    }

    /// How fast fields vary.
    pub(super) fn features(&self) -> &Features<'_> {
        self.features.get_or_init(|| Features::new(self.graph))
    }

    /// Nodes of tier Ray on a ray along which light travels in this direction.
    pub(super) fn along_ray(&mut self, code: &mut Code, direction: &Expr, nodes: &[NodeId]) -> Vec<Expr> {
        if nodes.is_empty() {
            return vec![];
        }
        let mut writer = Writer::new(self.graph, &self.scene.tiers);
        writer.know_input(Input::Direction, direction.clone());
        writer.write(self.builder, code, nodes)
    }

    /// Writes the function.
    pub(crate) fn write(mut self, ledger: &mut Ledger) -> Traced {
        let sdfs = self.sdfs();
        let fill = self.write_light(&sdfs, ledger);
        let reflected = self.write_reflected();
        let mut code = Code::new("trace", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let start = code.parameter("start", Ty::F32);
        let state = self.declare(&mut code, ledger);
        let hit = self.nearest.map(|nearest| {
            let arguments = vec![ray.origin.clone(), ray.direction.clone(), start.clone(), Expr::F32(FAR)];
            code.bind("hit", nearest.result, Expr::Call(nearest.function, arguments))
        });
        let end = hit.clone().map(|h| h.field(0));
        self.follow(&mut code, &ray, &state, &sdfs, &Stretch { start, end, whole: None }, Some(ledger));
        let traced = self.finish(code, &ray, &state, hit.as_ref(), reflected.as_ref());
        Traced { fill, ..traced }
    }

    /// Writes what lights need: surfaces in their way, the optical depth towards them, and what they send into the eye. Gives
    /// what fills the cache of light, if there is one.
    pub(super) fn write_light(
        &mut self,
        sdfs: &[Option<SdfFunctions>],
        ledger: &mut Ledger,
    ) -> Option<(crate::program::FillPass, crate::program::kernel::Function)> {
        self.nearest = self.write_nearest();
        let mut fill = None;
        if self.half_angle && self.scene.is_lit() {
            self.buffered = self.write_buffer(sdfs, ledger);
            if self.buffered.is_none() {
                self.shadow = self.write_shadow(sdfs);
            }
        } else if self.scene.is_lit() && self.caches() {
            if let Some((cache, entry)) = self.write_cache(sdfs) {
                ledger.omit("steps towards lights at every sample", "columns of light are kept on a lattice", None);
                fill = Some((cache.fill.clone(), entry));
                self.cache = Some(cache);
            }
        } else if self.scene.is_lit() {
            self.shadow = self.write_shadow(sdfs);
        }
        self.in_scattered = self.write_in_scattered(ledger);
        // What falls on surfaces has crossed slabs that the buffer is not at.
        if self.buffered.is_some() && self.scene.sheets.iter().any(|s| s.albedo.is_some()) {
            self.shadow = self.write_shadow(sdfs);
        }
        fill
    }

    /// Writes `shadow`, if something attenuates.
    pub(super) fn write_shadow(&mut self, sdfs: &[Option<SdfFunctions>]) -> Option<Shadow> {
        self.write_shadow_of(sdfs, "shadow", |_, _| true)
    }

    /// Writes the same for some media.
    pub(super) fn write_shadow_of(
        &mut self,
        sdfs: &[Option<SdfFunctions>],
        name: &str,
        only: fn(&Self, &Matter) -> bool,
    ) -> Option<Shadow> {
        let scene = self.scene;
        if !scene.matter.iter().any(|m| m.extinction.is_some() && only(self, m)) {
            return None;
        }
        self.only = Some(only);
        let shadow = self.write_shadow_function(sdfs, name);
        self.only = None;
        shadow
    }

    fn write_shadow_function(&mut self, sdfs: &[Option<SdfFunctions>], name: &str) -> Option<Shadow> {
        let scene = self.scene;
        let dw = scene.depth_width;
        let mut code = Code::new(name, None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let limit = code.parameter("limit", Ty::F32);
        let stepped = scene.matter.iter().any(|m| self.open_depth(m) && self.only.is_none_or(|only| only(self, m)));
        let dim = if stepped { code.parameter("dim", Ty::F32) } else { Expr::F32(0.0) };
        let error = stepped && self.wants(OutputKind::Error);
        let work = stepped && !matches!(self.rule, StepRule::Closed);
        let state = State {
            depth: Some(code.var("depth", Ty::float(dw), Expr::F32(0.0).splat(dw))),
            radiance: None,
            error: error.then(|| code.var("error", Ty::F32, 0.0)),
            apart: Apart::default(),
            work: work.then(|| code.var("work", Ty::U32, 0u32)),
            fault: None,
            fault_at: None,
            projected: None,
        };
        let stretch = Stretch { start: Expr::F32(0.0), end: Some(limit), whole: None };
        self.follow_towards(&mut code, Walk::Shadow { dim }, (&ray, &state), sdfs, &stretch);
        let depth = Expr::Local(state.depth?);
        let extra = [state.error.map(|e| ("error", Expr::Local(e))), state.work.map(|w| ("work", Expr::Local(w)))];
        if extra.iter().all(Option::is_none) {
            let result = Ty::float(dw);
            code.return_(depth);
            let function = self.builder.add_function(code.finish(Some(result)));
            return Some(Shadow { function, result, error: None, work: None, stepped });
        }
        let mut fields = vec![("depth".to_owned(), Ty::float(dw))];
        let mut values = vec![depth];
        let mut places = [None, None];
        for (place, extra) in places.iter_mut().zip(extra) {
            if let Some((name, value)) = extra {
                *place = Some(fields.len() as u32);
                fields.push((name.to_owned(), Ty::F32));
                values.push(if name == "work" { value.convert(Prim::F32) } else { value });
            }
        }
        let result = self.builder.add_struct("Shadow", fields);
        code.return_(Expr::Compose(result, values));
        let function = self.builder.add_function(code.finish(Some(result)));
        Some(Shadow { function, result, error: places[0], work: places[1], stepped })
    }

    /// Follows a part of a ray towards a light, on a walk of its own.
    pub(super) fn follow_towards(
        &mut self,
        code: &mut Code,
        walk: Walk,
        (ray, state): (&Ray, &State),
        sdfs: &[Option<SdfFunctions>],
        stretch: &Stretch,
    ) {
        let (walk, wanted) = (std::mem::replace(&mut self.walk, walk), std::mem::take(&mut self.wanted));
        self.follow(code, ray, state, sdfs, stretch, None);
        (self.walk, self.wanted) = (walk, wanted);
    }

    /// Follows the ray through all media.
    pub(super) fn follow(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        sdfs: &[Option<SdfFunctions>],
        stretch: &Stretch,
        mut ledger: Option<&mut Ledger>,
    ) {
        let scene = self.scene;
        let names = self.primitive_names();
        let mut spans: Vec<Option<Expr>> = vec![];
        for (primitive, name) in scene.primitives.iter().zip(&names) {
            let span = primitive_span(self.graph, self.builder, &mut self.spans, code, ray, primitive, name);
            spans.push(span);
        }
        let mut media = match self.composite {
            Composite::Radiance => self.media(code, ray),
            Composite::Maximum | Composite::Minimum | Composite::Average | Composite::Isosurface(_) => {
                self.data_media(code, ray)
            }
        };
        let simple = match scene.matter.as_slice() {
            [only] => matches!(only.region, Region::Leaf(i) if spans[i].is_some()),
            _ => false,
        };
        let Stretch { start, end, whole } = stretch;
        let slab = self.slab_of(stretch);
        if simple {
            let span = spans.iter().flatten().next().cloned().expect("a simple scene has one span");
            let a = code.bind("enter", Ty::F32, span.clone().component(0).max(start.clone()));
            let b = span.component(1);
            let b = match end {
                Some(end) => b.min(end.clone()),
                None => b,
            };
            let b = code.bind("leave", Ty::F32, b);
            code.open();
            let reach = whole.clone().unwrap_or_else(|| b.clone() - a.clone());
            let segment = Segment {
                ray: ray.clone(),
                a: a.clone(),
                b: b.clone(),
                reach: Some(reach),
                part: whole.is_some(),
                slab,
            };
            self.segment(code, state, &media, &segment);
            let body = code.close();
            code.push_if(b.greater(a), body);
            if let Some(ledger) = &mut ledger {
                ledger.omit("loop over segments", "one convex medium cuts a ray at most twice", scene.matter[0].span);
            }
        } else if scene.primitives.is_empty() {
            let b = end.clone().unwrap_or(Expr::F32(FAR));
            let reach = whole.clone();
            let segment = Segment { ray: ray.clone(), a: start.clone(), b, reach, part: whole.is_some(), slab };
            self.segment(code, state, &media, &segment);
            if let (false, Some(ledger)) = (scene.matter.is_empty(), &mut ledger) {
                ledger.omit("loop over segments", "no shape cuts the rays", None);
            }
        } else {
            self.segments(code, ray, state, &mut media, (&spans, sdfs), stretch);
        }
    }

    /// The ends of a stretch of the eye's ray, if it is a slab.
    fn slab_of(&self, stretch: &Stretch) -> Option<[Expr; 2]> {
        let slab = matches!(self.rule, StepRule::Slabs { .. }) && matches!(self.walk, Walk::Eye);
        stretch.end.clone().filter(|_| slab).map(|end| [stretch.start.clone(), end])
    }

    pub(super) fn declare(&mut self, code: &mut Code, ledger: &mut Ledger) -> State {
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
        let steps = !matches!(self.rule, StepRule::Closed) || self.scene.is_lit();
        // Closed forms between boundaries are as good as the boundaries.
        let ends = through && !scene.matter.is_empty() && !scene.primitives.is_empty();
        let error = ((steps || ends) && self.wants(OutputKind::Error)).then(|| code.var("error", Ty::F32, 0.0));
        let mut part = |kind, name| (error.is_some() && self.wants(kind)).then(|| code.var(name, Ty::F32, 0.0));
        let rounding = part(OutputKind::Rounding, "rounding");
        let storage = part(OutputKind::Storage, "storage");
        let adaptive = matches!(self.rule, StepRule::Adaptive(_));
        let unsure = adaptive && error.is_some() && depth.is_some();
        let apart = Apart { rounding, storage, depth: unsure.then(|| code.var("depth_unsure", Ty::F32, 0.0)) };
        let work =
            (steps && (adaptive || self.wants(OutputKind::Evaluations))).then(|| code.var("work", Ty::U32, 0u32));
        let checked = through && scene.matter.iter().any(|m| !m.checks.is_empty()) && self.wants(OutputKind::Fault);
        let loops = self.has_loops();
        let fault = (checked || loops).then(|| code.var("fault", Ty::U32, 0u32));
        let fault_at = (checked || loops).then(|| code.var("fault_at", Ty::VEC3, Expr::F32(0.0).splat(3)));
        if !checked && through && !scene.matter.is_empty() {
            ledger.omit(
                "check of coefficients",
                "every coefficient is proved finite and not negative, or checked on the host",
                None,
            );
        }
        let projected = (self.composite != Composite::Radiance).then(|| self.declare_projection(code));
        State { depth, radiance, error, apart, work, fault, fault_at, projected }
    }

    /// Whether a ray can take many rounds of loops.
    pub(super) fn has_loops(&self) -> bool {
        self.wants(OutputKind::Fault) && (!matches!(self.rule, StepRule::Closed) || self.scene.is_lit())
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

    pub(super) fn sdfs(&mut self) -> Vec<Option<SdfFunctions>> {
        let scene = self.scene;
        let mut out = vec![];
        for (i, primitive) in scene.primitives.iter().enumerate() {
            out.push(match primitive.kind {
                PrimitiveKind::Sdf { field } => {
                    let slope = self.features().steepness()[field.0 as usize].max(1.0);
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

    /// Whether a medium's optical depth has no closed form along rays.
    pub(super) fn open_depth(&self, matter: &Matter) -> bool {
        let varies = matter.extinction.is_some_and(|n| self.scene.tiers[n.0 as usize] == Tier::Sample);
        varies && matter.closed.is_none()
    }

    /// Whether a segment with this medium is stepped through.
    pub(super) fn steps(&self, matter: &Matter) -> bool {
        match self.walk {
            Walk::Eye => matter.steps,
            Walk::Shadow { .. } | Walk::Light | Walk::Ratio(_) => self.open_depth(matter),
            Walk::Path(_) => true,
        }
    }

    /// The loop over segments between boundaries.
    fn segments(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        media: &mut [Medium<'_>],
        (spans, sdfs): (&[Option<Expr>], &[Option<SdfFunctions>]),
        stretch: &Stretch,
    ) {
        let start = stretch.start.clone();
        let end = stretch.end.clone().unwrap_or(Expr::F32(FAR));
        let t = code.var("t", Ty::F32, start.clone());
        // What the sdfs take from the ray.
        let travel = -ray.direction.clone();
        let mut sdf_arguments: Vec<Vec<Expr>> = vec![];
        for sdf in sdfs {
            sdf_arguments.push(match sdf {
                Some(sdf) => self.along_ray(code, &travel, &sdf.field.hoisted),
                None => vec![],
            });
        }
        // Errors and fixed steps are shared out in proportion to length, where the length is known beforehand.
        let all_known = spans.iter().all(Option::is_some);
        let endless =
            media.iter().any(|m| self.steps(m.matter) && m.matter.region.is_unbounded(&self.scene.primitives));
        let reach =
            (all_known && !endless && !matches!(self.rule, StepRule::Closed) && stretch.whole.is_none()).then(|| {
                let ends = spans.iter().flatten();
                let first = ends.clone().map(|s| s.clone().component(0)).reduce(Expr::min).expect("there is a shape");
                let last = ends.map(|s| s.clone().component(1)).reduce(Expr::max).expect("there is a shape");
                let last = match &stretch.end {
                    Some(end) => last.min(end.clone()),
                    None => last,
                };
                code.bind("reach", Ty::F32, last.min(1.0e30) - first.max(start))
            });
        let reach = reach.or(stretch.whole.clone());
        let part = stretch.whole.is_some();
        code.open();
        let next = code.var("next", Ty::F32, end.clone());
        let boundaries = Boundaries { spans, sdfs, arguments: &sdf_arguments };
        let inside = boundaries.advance(code, ray, t, next);
        for i in 0..media.len() {
            let (before, rest) = media.split_at_mut(i);
            let medium = &mut rest[0];
            let region = &medium.matter.region;
            medium.here = match before.iter().find(|m| m.matter.region == *region) {
                Some(there) => there.here.clone(),
                None => {
                    let here = region.inside(&|i| inside[i].clone());
                    here.map(|h| code.bind(&format!("in_{}", medium.matter.name), Ty::BOOL, h))
                }
            };
        }
        let anywhere = media.iter().map(|m| m.here.clone()).collect::<Option<Vec<Expr>>>();
        let anywhere = anywhere.and_then(|all| {
            let mut different: Vec<Expr> = vec![];
            all.into_iter().for_each(|here| {
                if !different.contains(&here) {
                    different.push(here);
                }
            });
            different.into_iter().reduce(Expr::or)
        });
        code.open();
        let slab = self.slab_of(stretch);
        self.segment(code, state, media, &Segment { ray: ray.clone(), a: t.into(), b: next.into(), reach, part, slab });
        let body = code.close();
        match anywhere {
            Some(condition) => code.push_if(condition, body),
            None => code.push_all(body),
        }
        if let Walk::Path(flight) = &self.walk {
            code.break_if(Expr::Local(flight.event).less(FAR));
        }
        code.set(t, next);
        code.break_if(Expr::Local(next).greater_equal(end));
        if let Some(depth) = state.depth {
            let dark = self.thinnest(depth).greater(OPAQUE);
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
        match self.walk.clone() {
            Walk::Eye => {
                let bounded = !self.scene.primitives.is_empty();
                let before = if bounded { self.before(code, state) } else { [None, None] };
                self.lit_segment(code, state, media, segment);
                self.count_rounded_ends(code, state, segment, before);
            }
            Walk::Shadow { .. } | Walk::Light => self.lit_segment(code, state, media, segment),
            Walk::Path(flight) => self.fly(code, state, media, segment, &flight),
            Walk::Ratio(ratio) => self.ratio(code, state, media, segment, &ratio),
        }
    }

    fn lit_segment(&mut self, code: &mut Code, state: &State, media: &[Medium<'_>], segment: &Segment) {
        let (stepped, others): (Vec<&Medium<'_>>, Vec<&Medium<'_>>) = media.iter().partition(|m| self.steps(m.matter));
        let Segment { ray, a, b, .. } = segment;
        if stepped.is_empty() {
            self.closed(code, ray, state, &others, a, b);
            return;
        }
        // Where only closed forms are present, no step is taken.
        let any = stepped.iter().map(|m| m.here.clone()).collect::<Option<Vec<Expr>>>();
        let any = any.and_then(|all| all.into_iter().reduce(Expr::or));
        match any {
            Some(condition) if !others.is_empty() => {
                code.open();
                self.march_to_end(code, state, media, segment);
                let steps = code.close();
                code.open();
                self.closed(code, ray, state, &others, a, b);
                let closed = code.close();
                code.push_if_else(condition, steps, closed);
            }
            _ => self.march_to_end(code, state, media, segment),
        }
    }

    /// Steps through a segment; through an endless one until the rest cannot be seen, and adds the depth of the rest.
    fn march_to_end(&mut self, code: &mut Code, state: &State, media: &[Medium<'_>], segment: &Segment) {
        let unbounded = |m: &&Medium<'_>| m.matter.region.is_unbounded(&self.scene.primitives);
        let endless: Vec<&Medium<'_>> = media.iter().filter(unbounded).filter(|m| !self.open_depth(m.matter)).collect();
        if endless.is_empty() {
            self.march(code, state, media, segment);
            return;
        }
        let Segment { ray, a, b, reach, part, slab } = segment;
        let far = code.bind("endless", Ty::BOOL, b.clone().greater_equal(FAR));
        let end = code.var("end", Ty::F32, b.clone());
        code.open();
        let last = self.last_step(code, ray, &endless, a);
        code.set(end, last);
        let block = code.close();
        code.push_if(far.clone(), block);
        let b = code.bind("last", Ty::F32, end);
        let slab = slab.clone();
        let rest = Segment { ray: ray.clone(), a: a.clone(), b: b.clone(), reach: reach.clone(), part: *part, slab };
        self.march(code, state, media, &rest);
        if let Some(depth) = state.depth {
            code.open();
            if let Some(rest) = self.depth_between(code, ray, &endless, &b, &Expr::F32(FAR), "rest") {
                let sum = (Expr::Local(depth) + rest).min(Expr::F32(FAR).splat(self.scene.depth_width));
                code.set(depth, sum);
            }
            let block = code.close();
            code.push_if(far, block);
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

    /// Radiance of the background, in the width of light.
    pub(super) fn background(&mut self, code: &mut Code, ray: &Ray) -> Option<Expr> {
        let node = self.scene.background?;
        // A sky is seen along the ray.
        let value = self.along_ray(code, &ray.direction, &[node]).remove(0);
        Some(widen(value, self.graph.width(node), self.scene.light_width))
    }

    /// Clear of a surface that was hit at t by more than the hit may be wrong by.
    pub(super) fn above(code: &mut Code, at: Expr, normal: &Expr, t: &Expr) -> Expr {
        let size = largest(at.clone().abs(), 3).max(t.clone().abs()).max(1e-3);
        code.bind("above", Ty::VEC3, at + normal.clone() * (size * 4e-6).splat(3))
    }

    /// Radiance behind the media: of the sky and the discs in it, or of the surface that was hit.
    fn behind(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        hit: Option<&Expr>,
        reflected: Option<&InScattered>,
    ) -> Option<Expr> {
        let lw = self.scene.light_width;
        let Some(hit) = hit else {
            let (sky, discs) = (self.background(code, ray), self.discs(code, ray));
            return match (sky, discs) {
                (Some(sky), Some(discs)) => Some(sky + discs),
                (sky, discs) => sky.or(discs),
            };
        };
        let t = hit.clone().field(0);
        let behind = code.var("behind", Ty::float(lw), Expr::F32(0.0).splat(lw));
        code.open();
        let (sky, discs) = (self.background(code, ray), self.discs(code, ray));
        for part in [sky, discs].into_iter().flatten() {
            code.add(behind, part);
        }
        let free = code.close();
        code.open();
        if let Some(reflected) = reflected {
            let normal = hit.clone().field(1);
            let at = code.bind("at", Ty::VEC3, ray.at(t.clone()));
            let at = Self::above(code, at, &normal, &t);
            let arguments = vec![at, normal, hit.clone().field(2)];
            let value = code.bind("reflected", reflected.result, Expr::Call(reflected.function, arguments));
            code.set(behind, reflected.light(&value, 0));
            if let (Some(error), Some(field)) = (state.error, reflected.error) {
                let through = self.transmittance(state).map_or(Expr::F32(1.0), |t| largest(t, self.scene.depth_width));
                code.add(error, through * value.clone().field(field));
            }
            if let (Some(work), Some(field)) = (state.work, reflected.work) {
                code.add(work, value.field(field).convert(Prim::U32));
            }
        }
        let stopped = code.close();
        let visible = match state.depth {
            Some(depth) => self.thinnest(depth).less(OPAQUE),
            None => Expr::Bool(true),
        };
        code.push_if(hit.clone().field(0).greater_equal(FAR), free);
        code.push_if(hit.clone().field(0).less(FAR).and(visible), stopped);
        Some(behind.into())
    }

    /// What the media send and let through.
    fn radiance(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        state: &State,
        hit: Option<&Expr>,
        reflected: Option<&InScattered>,
    ) -> Expr {
        let width = self.scene.light_width;
        let light = state.radiance.map(Expr::Local);
        let behind = self.behind(code, ray, state, hit, reflected);
        if let Some(value) = &behind {
            self.count_bright_behind(code, state, value);
        }
        let behind = behind.map(|value| self.weighted(state, value, width));
        match (light, behind) {
            (Some(light), Some(behind)) => light + behind,
            (Some(light), None) | (None, Some(light)) => light,
            (None, None) => Expr::F32(0.0).splat(width),
        }
    }

    /// The struct that is returned.
    pub(super) fn finish(
        mut self,
        mut code: Code,
        ray: &Ray,
        state: &State,
        hit: Option<&Expr>,
        reflected: Option<&InScattered>,
    ) -> Traced {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let mut shown = None;
        if let Some(projected) = &state.projected {
            let background = self.background(&mut code, ray);
            let background = background.unwrap_or_else(|| Expr::F32(0.0).splat(lw));
            shown = Some(self.projected_light(&mut code, ray, projected, background));
        }
        if let (Some(fault), true) = (state.fault, self.has_loops()) {
            let cut = cut_short(self.builder, &mut code);
            code.if_(cut, |code| code.set(fault, Fault::CUT_SHORT));
        }
        let mut fields: Vec<(OutputKind, u8)> = vec![];
        let mut values = vec![];
        let mut rounded = None;
        for kind in self.wanted.clone() {
            match kind {
                OutputKind::Radiance => {
                    let light = match &shown {
                        Some((light, _)) => light.clone(),
                        None => self.radiance(&mut code, ray, state, hit, reflected),
                    };
                    fields.push((kind, lw));
                    let light = code.bind("light", Ty::float(lw), light);
                    rounded = state.projected.is_none().then(|| largest(light.clone(), lw) * ROUNDED);
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
                    values.push(sum([state.error.map(Expr::Local), rounded.clone()]));
                }
                OutputKind::Rounding => {
                    fields.push((kind, 1));
                    values.push(sum([state.apart.rounding.map(Expr::Local), rounded.clone()]));
                }
                OutputKind::Storage => {
                    fields.push((kind, 1));
                    values.push(sum([state.apart.storage.map(Expr::Local), None]));
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
        Traced { function, fields, random: None, fill: None }
    }
}

/// 0 of nothing.
fn sum(terms: [Option<Expr>; 2]) -> Expr {
    terms.into_iter().flatten().reduce(|a, b| a + b).unwrap_or(Expr::F32(0.0))
}

fn collect(region: &Region, out: &mut Vec<usize>) {
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
