//! Bounds of media on a lattice of bricks, worked out by the runtime from intervals of their fields: empty bricks are leapt
//! over, steps end before bricks in which something narrower than they may hide, tentative collisions happen at the rate of
//! the brick that they fall into.

use super::matter::{Matter, Scene};
use super::media::Medium;
use super::nodes::NODES;
use super::shapes::{FAR, Ray, Region};
use super::trace::Tracer;
use crate::analysis::feature::feature_length;
use crate::analysis::narrow::narrow;
use crate::analysis::support::support;
use crate::fields::{Code, field_function};
use crate::ir::{Composite, FieldScene, Graph, Input, NodeId, Op, Primitive, PrimitiveKind, Tier};
use crate::passes;
use crate::program::kernel::{Expr, FunctionId, LocalId, Math, Prim, Ty};
use crate::program::{FrameValue, HIDING, Ledger, MediumBounds, Narrow, SPANS, StepRule};

/// Numbers of a brick's record; see [`crate::program::Binding::Bounds`].
const RECORD: u32 = 4;

impl Scene {
    /// Finds which media keep bounds, and says why the others do not.
    pub(crate) fn keep_bounds(&mut self, scene: &mut FieldScene, rule: StepRule, ledger: &mut Ledger) {
        let varies = |n: Option<NodeId>| n.is_some_and(|n| self.tiers[n.0 as usize] == Tier::Sample);
        for m in &mut self.matter {
            let open = varies(m.extinction) && m.closed.is_none();
            let glows = m.steps && varies(m.emission);
            let why = match rule {
                _ if scene.render.composite != Composite::Radiance => "a projection looks at every value along a ray",
                StepRule::Fixed(_) => "a number of steps is asked for",
                StepRule::Splats { .. } => "it is not followed by steps along rays",
                _ if m.region.is_unbounded(&self.primitives) => "it has no end",
                _ if !has_box(&m.region, &self.primitives) => "no box around its shape is known",
                StepRule::Closed | StepRule::Adaptive(_) | StepRule::Slabs { .. } | StepRule::Paths(_)
                    if open || glows =>
                {
                    let bounds = bounds_of(scene, m, rule);
                    // One sample costs a slab less than to ask whether it is needed.
                    if matches!(rule, StepRule::Slabs { .. }) && bounds.narrow.is_empty() {
                        "slabs look for what is narrow in it alone, and nothing is"
                    } else {
                        m.bounds = Some(self.bounds.len() as u32);
                        self.bounds.push(bounds);
                        continue;
                    }
                }
                StepRule::Closed | StepRule::Adaptive(_) | StepRule::Slabs { .. } | StepRule::Paths(_) => {
                    "its coefficients have closed forms along rays"
                }
            };
            ledger.omit(format!("bounds of {}", m.name), why, m.span);
        }
        self.tiers = scene.graph.tiers();
    }
}

/// Whether a box around a region follows from its primitives.
fn has_box(region: &Region, primitives: &[Primitive]) -> bool {
    match region {
        Region::Everywhere => false,
        Region::Leaf(i) => match primitives[*i].kind {
            PrimitiveKind::Slab { .. } | PrimitiveKind::Sdf { .. } => false,
            PrimitiveKind::Sphere { .. }
            | PrimitiveKind::Ellipsoid { .. }
            | PrimitiveKind::Box { .. }
            | PrimitiveKind::Cylinder { .. }
            | PrimitiveKind::Shell { .. } => true,
        },
        Region::Union(parts) => parts.iter().all(|r| has_box(r, primitives)),
        Region::Intersection(parts) => parts.iter().any(|r| has_box(r, primitives)),
        Region::Difference(first, _) => has_box(first, primitives),
    }
}

fn bounds_of(scene: &mut FieldScene, m: &Matter, rule: StepRule) -> MediumBounds {
    let roots: Vec<NodeId> = [m.extinction, m.emission, m.scattering].into_iter().flatten().collect();
    let push = &mut |graph: &mut Graph, op| passes::push(graph, op);
    let narrow = match rule {
        // Paths meet what is narrow by chance, without bias.
        StepRule::Paths(_) => vec![],
        StepRule::Closed
        | StepRule::Fixed(_)
        | StepRule::Adaptive(_)
        | StepRule::Slabs { .. }
        | StepRule::Splats { .. } => narrow(&mut scene.graph, push, &roots),
    };
    let narrow = narrow.into_iter().map(|n| Narrow { argument: n.argument, gradient: n.gradient, bands: n.bands });
    let cell = feature_length(&scene.graph, &roots);
    let grain = cell.filter(|_| scene.graph.reads(&roots, is_noise));
    let support = match rule {
        StepRule::Closed | StepRule::Adaptive(_) if grain.is_some() => support(&mut scene.graph, push, &roots),
        StepRule::Closed
        | StepRule::Fixed(_)
        | StepRule::Adaptive(_)
        | StepRule::Slabs { .. }
        | StepRule::Splats { .. }
        | StepRule::Paths(_) => None,
    };
    let support = support.filter(|s| is_measurable(&scene.graph, *s));
    MediumBounds {
        medium: m.index,
        extinction: m.extinction,
        emission: m.emission,
        scattering: m.scattering,
        narrow: narrow.collect(),
        cell,
        grain,
        support,
    }
}

/// Whether a field is noise, alone or with other things that the runtime can evaluate without voxels.
fn is_measurable(graph: &Graph, node: NodeId) -> bool {
    let voxels_or_way =
        |op: &Op| matches!(op, Op::Sample { .. } | Op::SampleGradient { .. } | Op::Input(Input::Direction));
    graph.reads(&[node], is_noise) && !graph.reads(&[node], voxels_or_way)
}

fn is_noise(op: &Op) -> bool {
    matches!(op, Op::CellHash { .. })
}

/// Share of the way across a brick than which no step need be shorter.
const CRUMB: f64 = 2e-5;
/// What f32 may make of an argument, relative: a handful of operations.
const ROUNDED: f64 = 2e-6;
/// Steps across an occupied brick in which nothing is seen.
const UNSEEN: f64 = 6.0;
/// The least third power of how much shorter steps become where something may hide.
const HIDING_LEAST: f64 = 1e-4;

/// What a lattice says about a place and the way on from there.
pub(super) struct Brick {
    /// Largest extinction of any band in the brick.
    pub(super) extinction: Expr,
    /// Largest of what it sends towards the eye: emission and scattering.
    pub(super) source: Expr,
    /// Way to the end of the brick.
    pub(super) exit: Expr,
    /// Way to the end of the empty bricks around; 0 where this one is not empty.
    pub(super) clear: Expr,
    /// Of what is narrow, if the medium can have anything of that kind.
    pub(super) narrow: Option<NarrowPart>,
}

/// What a lattice says about what is narrow.
pub(super) struct NarrowPart {
    /// Way on which nothing narrow is that is not in this brick.
    quiet: Expr,
    /// How fast the arguments change at most that something narrow in this brick depends on; 0 where there is none.
    steep: Expr,
    /// Steps need be no shorter than this.
    crumb: Expr,
}

impl Tracer<'_> {
    /// The function that reads a medium's lattice: `name(p, d)`.
    fn brick_function(&mut self, matter: &Matter, number: u32) -> FunctionId {
        if let Some((_, function)) = self.bricks.iter().find(|b| b.0 == number) {
            return *function;
        }
        let name = format!("{}_bounds", matter.name);
        let buffer = self.builder.bounds(number, &name);
        let [low, per_unit, counts] = self.builder.lattice(number, &name);
        let mut fields = vec!["extinction", "source", "exit", "clear"];
        let watched = self.watches(number);
        if watched {
            fields.extend(["quiet", "steep", "crumb"]);
        }
        let fields = fields.into_iter().map(|n| (n.to_owned(), Ty::F32)).collect();
        let result = self.builder.add_struct(&format!("{}_brick", matter.name), fields);
        let mut code = Code::new(&name, matter.span);
        let p = code.parameter("p", Ty::VEC3);
        let d = code.parameter("d", Ty::VEC3);
        let u = code.bind("u", Ty::VEC3, (p - low) * per_unit.clone());
        let zero = || Expr::F32(0.0).splat(3);
        let last = counts.clone() - Expr::F32(1.0).splat(3);
        let cell = Expr::math(Math::Clamp, [Expr::math(Math::Floor, [u.clone()]), zero(), last]);
        let cell = code.bind("cell", Ty::VEC3, cell);
        let rows = cell.clone().component(2) * counts.clone().component(1) + cell.clone().component(1);
        let index = rows * counts.component(0) + cell.clone().component(0);
        let at = code.bind("at", Ty::U32, index.convert(Prim::U32) * RECORD);
        let load = |i: u32| Expr::load(buffer, if i == 0 { at.clone() } else { at.clone() + i });
        let extinction = code.bind("extinction", Ty::F32, load(0));
        let source = code.bind("source", Ty::F32, load(1));
        let empty = code.bind("empty", Ty::F32, load(2));
        let rate = code.bind("rate", Ty::VEC3, d * per_unit);
        // From the place in the brick to the faces that lie ahead, and the way across a whole brick, along each axis.
        let speed = code.bind("speed", Ty::VEC3, rate.clone().abs().max(Expr::F32(1e-30).splat(3)));
        let place = code.bind("place", Ty::VEC3, Expr::math(Math::Clamp, [u - cell, zero(), Expr::F32(1.0).splat(3)]));
        let ahead = (0..3u8).map(|i| {
            let x = place.clone().component(i);
            rate.clone().component(i).greater(0.0).select(Expr::F32(1.0) - x.clone(), x)
        });
        let ahead = Expr::Compose(Ty::VEC3, ahead.collect());
        let ahead = code.bind("ahead", Ty::VEC3, ahead);
        // Out of a cube of bricks around this one: `radius` bricks on either side, its own included.
        let out_of = |code: &mut Code, name: &str, radius: Expr| {
            let way = (ahead.clone() + (radius - 1.0).splat(3)) / speed.clone();
            let way = code.bind(&format!("way_{name}"), Ty::VEC3, way);
            let least = way.clone().component(0).min(way.clone().component(1)).min(way.component(2));
            code.bind(name, Ty::F32, least)
        };
        // A little further, so that the next brick is entered whatever rounds: bounds hold that much around their bricks.
        let nudge = speed.clone().component(0).max(speed.clone().component(1)).max(speed.clone().component(2));
        let across = code.bind("across", Ty::F32, Expr::F32(1.0) / nudge);
        let nudge = code.bind("nudge", Ty::F32, across.clone() * 1e-3);
        let exit = out_of(&mut code, "exit", Expr::F32(1.0)) + nudge.clone();
        let around = out_of(&mut code, "around", empty.clone().max(1.0)) + nudge.clone();
        let clear = empty.greater(0.0).select(around, 0.0);
        let mut values = vec![extinction, source, exit, clear];
        if watched {
            let calm = code.bind("calm", Ty::F32, load(3));
            let quiet = out_of(&mut code, "quiet", calm.clone().max(1.0)) + nudge;
            values.extend([quiet, (-calm).max(0.0), across * CRUMB]);
        }
        code.return_(Expr::Compose(result, values));
        let function = self.builder.add_function(code.finish(Some(result)));
        self.bricks.push((number, function));
        function
    }

    /// What the lattice of a medium says at a place, if it has one.
    pub(super) fn brick(&mut self, code: &mut Code, medium: &Medium<'_>, p: &Expr, d: &Expr) -> Option<Brick> {
        let number = medium.matter.bounds?;
        let function = self.brick_function(medium.matter, number);
        let result = self.builder.result_of(function);
        let value = Expr::Call(function, vec![p.clone(), d.clone()]);
        let value = code.bind(&format!("brick_of_{}", medium.matter.name), result, value);
        let field = |i: u32| value.clone().field(i);
        let narrow = self.watches(number).then(|| NarrowPart { quiet: field(4), steep: field(5), crumb: field(6) });
        Some(Brick { extinction: field(0), source: field(1), exit: field(2), clear: field(3), narrow })
    }

    /// Whether something narrow may be in the medium of these bounds.
    fn watches(&self, number: u32) -> bool {
        !self.scene.bounds[number as usize].narrow.is_empty()
    }

    /// Whether some of these media have bounds, and nothing else is always there beside them.
    pub(super) fn leaps(&self, media: &[Medium<'_>]) -> bool {
        media.iter().any(|m| m.matter.bounds.is_some())
            && media.iter().all(|m| m.matter.bounds.is_some() || m.here.is_some())
    }

    /// Whether some lattice of these media has more than one brick.
    pub(super) fn bricked(&mut self, media: &[Medium<'_>]) -> Expr {
        let bounded = media.iter().filter_map(|m| Some((m.matter.bounds?, &m.matter.name)));
        let several = bounded.map(|(number, name)| {
            let [_, _, counts] = self.builder.lattice(number, &format!("{name}_bounds"));
            counts.component(0).greater(1.0)
        });
        several.reduce(Expr::or).unwrap_or(Expr::Bool(false))
    }

    /// Way through empty bricks from a place on a ray, 0 where there is something.
    pub(super) fn clear_way(&mut self, code: &mut Code, ray: &Ray, media: &[Medium<'_>], t: &Expr) -> Expr {
        let p = code.bind("p_brick", Ty::VEC3, ray.at(t.clone()));
        self.least_of(code, media, "clear", &mut |this, code, medium| {
            Some(this.brick(code, medium, &p, &ray.direction).map_or(Expr::F32(0.0), |b| b.clear))
        })
    }

    /// Whether something narrow may be in some of these media.
    pub(super) fn may_be_narrow(&self, media: &[Medium<'_>]) -> bool {
        media.iter().any(|m| m.matter.bounds.is_some_and(|b| self.watches(b)))
    }

    /// Longest step from a place on a ray that misses nothing narrow. As in sphere tracing, no band of an argument's values is
    /// met before the argument can have come there, and none is crossed in less than it takes the argument to cross it.
    pub(super) fn longest_here(&mut self, code: &mut Code, ray: &Ray, media: &[Medium<'_>], t: &Expr) -> Option<Expr> {
        if !self.may_be_narrow(media) {
            return None;
        }
        let p = code.bind("p_narrow", Ty::VEC3, ray.at(t.clone()));
        Some(self.least_of(code, media, "longest_here", &mut |this, code, medium| {
            let number = medium.matter.bounds.filter(|b| this.watches(*b))?;
            let NarrowPart { quiet, steep, crumb } = this.brick(code, medium, &p, &ray.direction)?.narrow?;
            let longest = code.var("narrow_step", Ty::F32, quiet);
            code.open();
            let change = this.free_change(code, ray, medium, number, t);
            let step = (change / steep.clone()).max(crumb);
            code.set(longest, Expr::Local(longest).min(step));
            let block = code.close();
            code.push_if(steep.greater(0.0), block);
            Some(longest.into())
        }))
    }

    /// How far the arguments may change from what they are at t before one has met, or crossed, a band of narrow values.
    fn free_change(&mut self, code: &mut Code, ray: &Ray, medium: &Medium<'_>, number: u32, t: &Expr) -> Expr {
        let scene: &Scene = self.scene;
        let all = &scene.bounds[number as usize].narrow;
        let function = match self.narrows.iter().find(|n| n.0 == number) {
            Some((_, function)) => function.clone(),
            None => {
                let name = |i: usize| format!("argument_{i}");
                let roots: Vec<(String, NodeId)> = all.iter().enumerate().map(|(i, n)| (name(i), n.argument)).collect();
                let roots: Vec<(&str, NodeId)> = roots.iter().map(|(name, node)| (name.as_str(), *node)).collect();
                let name = format!("{}_narrow", medium.matter.name);
                let function =
                    field_function(self.graph, &scene.tiers, self.builder, &name, medium.matter.span, &roots);
                self.narrows.push((number, function.clone()));
                function
            }
        };
        let values = self.call_field(code, ray, &function, t, "narrow_arguments");
        let mut nearest: Option<Expr> = None;
        for (i, narrow) in all.iter().enumerate() {
            let argument = code.bind("argument", Ty::F32, function.part(&values, i));
            for (from, to) in &narrow.bands {
                if !(*from as f32).is_finite() || !(*to as f32).is_finite() {
                    return Expr::F32(0.0);
                }
                let away = (Expr::F32(*from) - argument.clone()).max(argument.clone() - *to);
                // The argument is rounded.
                let rounded = (argument.clone().abs() + from.abs().max(to.abs())) * ROUNDED;
                let change = (away - rounded).max(to - from);
                nearest = Some(match nearest {
                    Some(least) => least.min(change),
                    None => change,
                });
            }
        }
        code.bind("free_change", Ty::F32, nearest.unwrap_or(Expr::F32(FAR)))
    }

    /// The longest step on which it is believed that nothing is in an occupied brick, if that needs care: of fields with cells
    /// of a known size, steps follow those.
    pub(super) fn longest_unseen(&mut self, code: &mut Code, ray: &Ray, media: &[Medium<'_>]) -> Option<Expr> {
        let plain = |m: &Medium<'_>| m.matter.bounds.is_some_and(|b| self.scene.bounds[b as usize].cell.is_none());
        if !self.leaps(media) || !media.iter().any(plain) {
            return None;
        }
        let least = self.least_of(code, media, "gap", &mut |this, code, medium| {
            let number = medium.matter.bounds?;
            this.scene.bounds[number as usize].cell.is_none().then(|| {
                let [_, per_unit, _] = this.builder.lattice(number, &format!("{}_bounds", medium.matter.name));
                let rate = code.bind("bricks_per_way", Ty::VEC3, (ray.direction.clone() * per_unit).abs());
                let most = rate.clone().component(0).max(rate.clone().component(1)).max(rate.component(2));
                Expr::F32(1.0 / UNSEEN) / most.max(1e-30)
            })
        });
        Some(code.bind("longest_unseen", Ty::F32, least))
    }

    /// Longest step whose samples, this far from a medium by the scalar that tells it, leave nothing of it unseen: between two
    /// places as far apart as they are, that rises no higher. A function, since steps ask it of what is behind and of what is ahead.
    fn longest_clear(&mut self, code: &mut Code, medium: &Medium<'_>, risen: impl Into<Expr>) -> Option<Expr> {
        let (number, _) = medium.support_at?;
        let function = match self.clears.iter().find(|c| c.0 == number) {
            Some((_, function)) => *function,
            None => {
                let function = self.clear_function(medium.matter, number)?;
                self.clears.push((number, function));
                function
            }
        };
        Some(code.bind("longest_clear", Ty::F32, Expr::Call(function, vec![-risen.into()])))
    }

    /// `name(below)`: piecewise linear between the spans.
    fn clear_function(&mut self, matter: &Matter, number: u32) -> Option<FunctionId> {
        let cell = self.scene.bounds[number as usize].grain?;
        let name = format!("{}_clear", matter.name);
        let rises = self.builder.rises(number, &matter.name);
        let mut code = Code::new(&name, matter.span);
        let below = code.parameter("below", Ty::F32);
        let way = code.var("way", Ty::F32, 0.0);
        let mut before: Option<(f64, Expr)> = None;
        for (i, span) in SPANS.into_iter().enumerate() {
            let rise = rises[i / 3].clone().component((i % 3) as u8);
            let (apart, past, more) = match before {
                None => (span, below.clone(), rise.clone()),
                Some((shorter, lower)) => (span - shorter, below.clone() - lower.clone(), rise.clone() - lower),
            };
            let share = Expr::math(Math::Clamp, [past / more.max(1e-30), 0.0.into(), 1.0.into()]);
            code.add(way, share * (apart * cell * f64::from(NODES - 1)));
            before = Some((span, rise));
        }
        code.return_(Expr::Local(way));
        Some(self.builder.add_function(code.finish(Some(Ty::F32))))
    }

    /// For each medium that is told by a scalar, how far steps may go by what that is.
    pub(super) fn clear_ways(
        &mut self,
        code: &mut Code,
        media: &[Medium<'_>],
        risen: &dyn Fn(u32) -> Option<LocalId>,
    ) -> Vec<(u32, Expr)> {
        let way = |medium: &Medium<'_>| {
            let (number, _) = medium.support_at?;
            Some((number, self.longest_clear(code, medium, risen(number)?)?))
        };
        media.iter().filter_map(way).collect()
    }

    /// Longest step that what tells media ever allows.
    pub(super) fn longest_told(&self, media: &[Medium<'_>]) -> Option<f64> {
        let cells = media.iter().filter_map(|m| self.scene.bounds[m.support_at?.0 as usize].grain);
        let most = f64::from(NODES - 1) * SPANS[SPANS.len() - 1];
        cells.map(|cell| most * cell).reduce(f64::min)
    }

    /// Longest step where something is: the usual, but through nothing of a medium.
    pub(super) fn longest_celled(
        &mut self,
        code: &mut Code,
        media: &[Medium<'_>],
        ways: &[(u32, Expr)],
        usual: &Expr,
    ) -> Option<Expr> {
        if ways.is_empty() {
            return None;
        }
        Some(self.least_of(code, media, "celled", &mut |_, _, medium| {
            let (number, _) = medium.support_at?;
            let (_, way) = ways.iter().find(|w| w.0 == number)?;
            Some(way.clone().max(usual.clone()))
        }))
    }

    /// Longest step at t on which nothing that counts hides between samples which met nothing, where fields have cells of a known
    /// size. A bump that is cut off at zero is a parabola: of length ℓ and in a field of cells c and extinction σ it has an optical
    /// depth of about 3 σ ℓ³/c², and must not count against `accuracy`.
    pub(super) fn longest_hiding(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        media: &[Medium<'_>],
        ways: &[(u32, Expr)],
        t: Expr,
    ) -> Option<Expr> {
        let celled = |m: &Medium<'_>| m.matter.bounds.is_some_and(|b| self.scene.bounds[b as usize].grain.is_some());
        if !media.iter().any(celled) {
            return None;
        }
        let p = code.bind("p_hiding", Ty::VEC3, ray.at(t));
        let accuracy = self.builder.frame(FrameValue::Accuracy);
        let white = self.builder.frame(FrameValue::White);
        Some(self.least_of(code, media, "hiding", &mut |this, code, medium| {
            let cell = this.scene.bounds[medium.matter.bounds? as usize].grain?;
            let brick = this.brick(code, medium, &p, &ray.direction)?;
            let cell = match medium.support_at {
                Some((number, _)) => this.builder.grain(number, &medium.matter.name),
                None => Expr::F32(cell),
            };
            let most = brick.extinction.max(brick.source / white.clone()).max(1e-30) * cell.clone();
            let share = (accuracy.clone() * HIDING / most).min(1.0).max(HIDING_LEAST);
            let resolved = Expr::math(Math::Pow, [share, (1.0 / 3.0).into()]) * (cell * 2.0);
            let way = medium.support_at.and_then(|(number, _)| ways.iter().find(|w| w.0 == number));
            Some(match way {
                Some((_, way)) => resolved.max(way.clone()),
                None => resolved,
            })
        }))
    }

    /// The least of what is asked of each medium that is here; FAR where there is none.
    fn least_of(
        &mut self,
        code: &mut Code,
        media: &[Medium<'_>],
        name: &str,
        ask: &mut dyn FnMut(&mut Self, &mut Code, &Medium<'_>) -> Option<Expr>,
    ) -> Expr {
        if let ([only], true) = (media, media.iter().all(|m| m.here.is_none())) {
            return ask(self, code, only).unwrap_or(Expr::F32(FAR));
        }
        let least = code.var(name, Ty::F32, FAR);
        for medium in media {
            code.open();
            if let Some(value) = ask(self, code, medium) {
                code.set(least, Expr::Local(least).min(value));
            }
            let body = code.close();
            match &medium.here {
                Some(here) => code.push_if(here.clone(), body),
                None => code.push_all(body),
            }
        }
        Expr::Local(least)
    }
}
