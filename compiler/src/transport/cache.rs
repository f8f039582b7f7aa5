//! Light on its way through media without closed forms, worked out once for a picture: optical depths from the nodes of a
//! lattice to each light, between which rays interpolate.
//!
//! Without it every step of every ray would step towards every light. Suns and lamps have a fine lattice; of the disc of a sun
//! and of an environment fixed sets of directions are kept on coarser ones. Depths are interpolated (they are smoother than what they let through),
//! and what the lattice of half the resolution tells of the nodes around a place, against what they are, is the measure of the error that
//! each look-up adds to the picture's ([`bent`]).
//!
//! Neither lattice sees what is thinner than a cell. But along the way to the light depth falls by the extinction, dτ/ds = −σ: where
//! the extinction at a place and the slope of what is interpolated there disagree, the cell holds more than its nodes tell, and the
//! difference over half the way through the cell is added instead, if that is more. On smooth fields this is of second order, too.

use super::light::LightSample;
use super::shapes::{FAR, SdfFunctions};
use super::trace::{ComponentIf, Tracer, largest};
use crate::fields::Code;
use crate::ir::LightKind;
use crate::program::kernel::{Expr, Function, FunctionId, Math, Prim, Ty};
use crate::program::{FillPass, FrameValue, StepRule};

/// Nodes along each edge for suns and lamps, by the accuracy; odd, so that every other one makes a lattice too.
fn fine_nodes(rule: StepRule) -> u32 {
    match rule.accuracy() {
        Some(a) if a < 5e-3 => 129,
        Some(a) if a < 2e-2 => 97,
        Some(_) | None => 65,
    }
}

/// Points of a disc, in a medium.
pub(super) const DISC: u32 = 8;
/// Nodes along each edge for an environment.
const COARSE: u32 = 25;
/// Directions of an environment.
pub(super) const SKY: u32 = 24;
/// Evaluations along a ray of which some look up columns: drivers that end loops after 65535 rounds get this far.
pub(super) const MOST_LOOKS: u32 = 12_000;
/// Depth between the nodes of a cell, and share of it by which two lattices differ, above which nothing is known within the cell.
const TORN: (f64, f64) = (4.0, 0.2);
/// What a depth may be wrong by, as a share of the way through a cell times the extinction that its lattice does not have: half of it, which is as
/// far as a node is away along the way, and half as much again for what changes across it.
const MISSED: f64 = 0.75;
/// What a shadow may be wrong by, as a share of the accuracy for light of strength 1.
const DIM: f64 = 0.1;

/// What of the light is kept.
#[derive(Clone)]
pub(super) struct Cache {
    /// `column_fine(p, to, limit, channel)` and the same of the sky: depth, and its error in the last component.
    fine: Option<FunctionId>,
    disc: Option<FunctionId>,
    sky: Option<FunctionId>,
    /// Depth through closed media alone, if there are any beside.
    pub(super) closed: Option<super::light::Shadow>,
    pub(super) fill: FillPass,
}

/// Which column of the cache a sample of a light asks for.
#[derive(Clone)]
pub(super) enum Channel {
    /// Of a light that shines from one place, by its number.
    Light(u32),
    /// Of a disc, by the number of its light, and of its points.
    Disc(u32, Expr),
    /// Of a direction of the sky, by its number.
    Sky(Expr),
}

/// Whether one node of a cell may lie before something opaque and another behind it, so that light may come through between them or not.
fn is_torn(apart: &Expr, range: &Expr) -> Expr {
    range.clone().greater(TORN.0).and(apart.clone().greater(range.clone() * TORN.1))
}

/// What a depth between nodes may be wrong by, of second order in their distance: a third of what every other node tells otherwise at this
/// place. But in torn cells everything.
pub(super) fn resolved(apart: Expr, range: Expr) -> Expr {
    is_torn(&apart, &range).select(range, apart * (1.0 / 3.0))
}

/// The same by the node of the cell of which every other node tells the most otherwise. Where depths are smooth the largest error within
/// the cell is a quarter of that; where they have a kink, as from the edge of a shape on, it is up to half of it or as much, and the
/// difference is no small part of the range.
fn bent(bend: Expr, range: Expr) -> Expr {
    let sharp = bend.clone() / range.max(1e-30);
    bend * (sharp.min(0.25) + 0.25)
}

impl Tracer<'_> {
    /// Whether light is worth keeping: shadows are stepped through, and what they step through is bounded.
    pub(super) fn caches(&self) -> bool {
        let scene = self.scene;
        let open = scene.matter.iter().filter(|m| self.open_depth(m));
        let bounded = open.clone().all(|m| !m.region.is_unbounded(&scene.primitives));
        !scene.phases.is_empty() && open.count() > 0 && bounded
    }

    /// Direction number `index` of the sky: a Fibonacci lattice on the sphere.
    pub(super) fn sky_direction(code: &mut Code, index: &Expr) -> Expr {
        let versine = code.bind("versine", Ty::F32, (index.clone() + 0.5) * (2.0 / f64::from(SKY)));
        let turns = Self::fract(code, index.clone() * super::light::GOLDEN);
        let up = code.bind("up", Ty::VEC3, Expr::Compose(Ty::VEC3, [0.0, 1.0, 0.0].map(Expr::F32).into()));
        let frame = Self::across(code, &up);
        Self::around(code, &up, &frame, (&versine, &(Expr::F32(2.0) - versine.clone())), turns)
    }

    fn corner(&mut self) -> (Expr, Expr) {
        (self.builder.frame(FrameValue::CacheLow), self.builder.frame(FrameValue::CacheSize))
    }

    /// Writes the functions that look up, and the entry point that fills.
    pub(super) fn write_cache(&mut self, sdfs: &[Option<SdfFunctions>]) -> Option<(Cache, Function)> {
        let dw = self.scene.depth_width;
        let open = self.write_shadow_of(sdfs, "shadow_of_open", Self::open_depth)?;
        let closed = self.scene.matter.iter().any(|m| m.extinction.is_some() && !self.open_depth(m));
        let closed =
            if closed { self.write_shadow_of(sdfs, "shadow_of_closed", |this, m| !this.open_depth(m)) } else { None };
        let n = fine_nodes(self.rule);
        let (lights, discs) = (self.of_kind(false), self.of_kind(true));
        let fine = lights * n.pow(3);
        // All points of a disc together have as many nodes as a light that shines from one place; odd, too.
        let half = n.div_ceil(2);
        let disc = DISC * discs * half.pow(3);
        let sky = if self.scene.environment { SKY * COARSE.pow(3) } else { 0 };
        let buffer = self.builder.cache();
        let mut code = Code::new("fill", None);
        let origin = self.builder.frame(FrameValue::TileOrigin).component(0);
        let count = self.builder.frame(FrameValue::RayCount);
        let own = code.bind("own", Ty::U32, Expr::GlobalId.component(0));
        code.if_(own.clone().greater_equal(count), Code::return_nothing);
        let index = code.bind("index", Ty::U32, origin + own);
        let (low, size) = self.corner();
        let to = code.var("to", Ty::VEC3, Expr::F32(0.0).splat(3));
        let limit = code.var("limit", Ty::F32, FAR);
        let place = code.var("place", Ty::VEC3, Expr::F32(0.0).splat(3));
        let node = |code: &mut Code, rest: &Expr, n: u32| {
            let rem = |a: Expr, b: u32| Expr::binary(crate::program::kernel::BinaryOp::Rem, a, b);
            let i = rem(rest.clone(), n).convert(Prim::F32);
            let j = rem(rest.clone() / n, n).convert(Prim::F32);
            let k = (rest.clone() / (n * n)).convert(Prim::F32);
            let at = Expr::Compose(Ty::VEC3, vec![i, j, k]) * Expr::F32(1.0 / f64::from(n - 1)).splat(3);
            code.bind("share", Ty::VEC3, at)
        };
        code.open();
        let channel = code.bind("channel", Ty::U32, index.clone() / n.pow(3));
        let share = node(&mut code, &(index.clone() - channel.clone() * n.pow(3)), n);
        let p = code.bind("p", Ty::VEC3, low.clone() + share * size.clone());
        code.set(place, p.clone());
        let numbered: Vec<_> = (0u32..).zip(self.scene.lights.clone()).collect();
        for (number, light) in numbered.iter().filter(|(_, light)| !light.kind.is_disc()) {
            code.open();
            match light.kind {
                LightKind::Directional { direction, .. } => {
                    let travel = self.builder.value(self.graph, direction, &format!("{}_direction", light.name));
                    code.set(to, -travel);
                }
                LightKind::Point { position, .. } => {
                    let at = self.builder.value(self.graph, position, &format!("{}_position", light.name));
                    let way = code.bind("way", Ty::VEC3, at - p.clone());
                    let distance = code.bind("distance", Ty::F32, Expr::math(Math::Length, [way.clone()]));
                    code.set(to, way / distance.clone().max(1e-30).splat(3));
                    code.set(limit, distance);
                }
            }
            let body = code.close();
            code.push_if(channel.clone().equal(self.among_its_kind(*number)), body);
        }
        let suns = code.close();
        code.open();
        let rest = code.bind("rest", Ty::U32, index.clone() - fine);
        let channel = code.bind("point_number", Ty::U32, rest.clone() / half.pow(3));
        let share = node(&mut code, &(rest - channel.clone() * half.pow(3)), half);
        let p = code.bind("p", Ty::VEC3, low.clone() + share * size.clone());
        code.set(place, p);
        for (number, light) in &numbered {
            let LightKind::Directional { direction, angular_diameter: Some(diameter), .. } = light.kind else {
                continue;
            };
            code.open();
            let travel = self.builder.value(self.graph, direction, &format!("{}_direction", light.name));
            let middle = code.bind("middle", Ty::VEC3, -travel);
            let diameter = self.builder.value(self.graph, diameter, &format!("{}_angular_diameter", light.name));
            let cap = Self::height_of_cap(&mut code, &(diameter * 0.5));
            let frame = Self::across(&mut code, &middle);
            let own = self.among_its_kind(*number);
            let point = (channel.clone() - own * DISC).convert(Prim::F32);
            let direction = Self::disc_direction(&mut code, (&middle, &frame), cap, point, DISC);
            code.set(to, direction);
            let body = code.close();
            code.push_if((channel.clone() / DISC).equal(own), body);
        }
        let points = code.close();
        code.open();
        let rest = code.bind("rest", Ty::U32, index.clone() - (fine + disc));
        let channel = code.bind("direction_number", Ty::U32, rest.clone() / COARSE.pow(3));
        let share = node(&mut code, &(rest - channel.clone() * COARSE.pow(3)), COARSE);
        let p = code.bind("p", Ty::VEC3, low + share * size);
        code.set(place, p);
        let direction = Self::sky_direction(&mut code, &channel.convert(Prim::F32));
        code.set(to, direction);
        let skies = code.close();
        let kinds: Vec<_> = [(fine, suns), (disc, points), (sky, skies)].into_iter().filter(|k| k.0 > 0).collect();
        let (mut first, alone) = (0, kinds.len() == 1);
        for (nodes, body) in kinds {
            let here = index.clone().greater_equal(first).and(index.clone().less(first + nodes));
            if alone {
                code.push_all(body);
            } else {
                code.push_if(here, body);
            }
            first += nodes;
        }
        let mut arguments = vec![Expr::Local(place), Expr::Local(to), Expr::Local(limit)];
        if open.stepped {
            arguments.push(Expr::F32(DIM));
        }
        let value = code.bind("shade", open.result, Expr::Call(open.function, arguments));
        let depth = code.bind("depth", Ty::float(dw), open.depth(&value));
        for i in 0..dw {
            let part = if dw == 1 { depth.clone() } else { depth.clone().component(i) };
            code.store(buffer, index.clone() * u32::from(dw) + u32::from(i), part);
        }
        let entry = code.finish(None);
        let media = self.scene.matter.iter().filter(|m| self.open_depth(m)).map(|m| m.index).collect();
        let nodes = fine + disc + sky;
        let fill = FillPass { kernel: 1, nodes, floats: nodes * u32::from(dw), media };
        let sky = (sky > 0).then(|| self.column("column_of_sky", COARSE, fine + disc));
        let disc = (disc > 0).then(|| self.column("column_of_disc", half, fine));
        let fine = (fine > 0).then(|| self.column("column", n, 0));
        Some((Cache { fine, disc, sky, closed, fill }, entry))
    }

    /// Writes `name(p, to, limit, channel)`: trilinear interpolation of depths, with the error as last component.
    fn column(&mut self, name: &str, n: u32, first: u32) -> FunctionId {
        let dw = self.scene.depth_width;
        let (low, size) = self.corner();
        let wide = Ty::float(dw);
        let found = self.builder.add_struct(
            &format!("{name}_between"),
            vec![("depth".into(), wide), ("error".into(), Ty::F32), ("slope".into(), wide)],
        );
        let lattice = self.between(&format!("{name}_lattice"), found, n, first);
        let result =
            self.builder.add_struct(&format!("{name}_value"), vec![("depth".into(), wide), ("error".into(), Ty::F32)]);
        let axis = self.spans.within(self.builder);
        let mut code = Code::new(name, None);
        let p = code.parameter("p", Ty::VEC3);
        let to = code.parameter("to", Ty::VEC3);
        let limit = code.parameter("limit", Ty::F32);
        let channel = code.parameter("channel", Ty::U32);
        let k_open = code.parameter("k_open", wide);
        // From outside, the column begins where the way to the light enters the lattice.
        let from = code.bind("from_low", Ty::VEC3, p - low);
        let mut enter = Expr::F32(0.0);
        let mut leave = limit;
        for i in 0..3u8 {
            let arguments =
                vec![from.clone().component(i), to.clone().component(i), Expr::F32(0.0), size.clone().component(i)];
            let span = code.bind("span", super::shapes::SPAN, Expr::Call(axis, arguments));
            enter = enter.max(span.clone().component(0));
            leave = leave.min(span.component(1));
        }
        let enter = code.bind("enters", Ty::F32, enter);
        code.if_(enter.clone().greater_equal(leave), |code| {
            code.return_(Expr::Compose(result, vec![Expr::F32(0.0).splat(dw), Expr::F32(0.0)]));
        });
        let way = code.bind("way", Ty::VEC3, to.clone() / size.clone());
        let inside = enter.clone().less_equal(0.0);
        let u = (from + to * enter.splat(3)) / size;
        let u = Expr::math(Math::Clamp, [u, Expr::F32(0.0).splat(3), Expr::F32(1.0).splat(3)]);
        let near = code.bind("near", found, Expr::Call(lattice, vec![u, channel, way.clone()]));
        let off = near.clone().field(1);
        let through_cell = Expr::F32(1.0) / (largest(way.abs(), 3) * f64::from(n - 1));
        let missed = largest((k_open.clone() + near.clone().field(2)).abs(), dw) * through_cell * MISSED;
        let asked = inside.and(k_open.component_if(dw, 0).greater_equal(0.0));
        let off = asked.select(off.clone().max(missed.min(1e30)), off);
        code.return_(Expr::Compose(result, vec![near.field(0), off]));
        self.builder.add_function(code.finish(Some(result)))
    }

    /// The nodes of one channel around a cell, of which each edge spans `stride` nodes.
    fn corners(&mut self, code: &mut Code, cell: &Expr, base: &Expr, n: u32, stride: u32) -> Vec<Expr> {
        let dw = self.scene.depth_width;
        let buffer = self.builder.cache();
        let names = ["i", "j", "k"];
        let low = [0u8, 1, 2].map(|axis| {
            let whole = cell.clone().component(axis).convert(Prim::U32) * stride;
            code.bind(names[usize::from(axis)], Ty::U32, whole)
        });
        let corner = |c: usize| {
            let at = |axis: usize| if c >> axis & 1 == 1 { low[axis].clone() + stride } else { low[axis].clone() };
            let node = base.clone() + at(0) + at(1) * n + at(2) * (n * n);
            let node = code.bind("node", Ty::U32, node * u32::from(dw));
            let mut parts: Vec<Expr> = (0..dw).map(|i| Expr::load(buffer, node.clone() + u32::from(i))).collect();
            let value = if dw == 1 { parts.remove(0) } else { Expr::Compose(Ty::float(dw), parts) };
            code.bind("node_depth", Ty::float(dw), value)
        };
        (0..8).map(corner).collect()
    }

    /// Writes `name(u, channel, way)`: the depth between the nodes, what it may be wrong by for its nodes, and how it changes along the way.
    fn between(&mut self, name: &str, found: Ty, n: u32, first: u32) -> FunctionId {
        let dw = self.scene.depth_width;
        let wide = Ty::float(dw);
        let mut code = Code::new(name, None);
        let u = code.parameter("u", Ty::VEC3);
        let channel = code.parameter("channel", Ty::U32);
        let way = code.parameter("way", Ty::VEC3);
        let cells = f64::from(n - 1);
        let x = code.bind("x", Ty::VEC3, u * Expr::F32(cells).splat(3));
        let floor = Expr::math(Math::Floor, [x.clone()]);
        let cell = Expr::math(Math::Clamp, [floor, Expr::F32(0.0).splat(3), Expr::F32(cells - 1.0).splat(3)]);
        let cell = code.bind("cell", Ty::VEC3, cell);
        let f = code.bind("f", Ty::VEC3, x - cell.clone());
        let rough_cell = Expr::math(Math::Floor, [cell.clone() * Expr::F32(0.5).splat(3)]);
        let rough_cell = code.bind("rough_cell", Ty::VEC3, rough_cell);
        // Where in the cell of twice the size the nodes are: at 0 and 1/2, or at 1/2 and 1.
        let lower = code.bind("lower", Ty::VEC3, cell.clone() * Expr::F32(0.5).splat(3) - rough_cell.clone());
        let base = code.bind("base", Ty::U32, channel * n.pow(3) + first);
        let near = self.corners(&mut code, &cell, &base, n, 1);
        let mut rough = self.corners(&mut code, &rough_cell, &base, n, 2);
        // What every other node tells of the nodes of the cell.
        for axis in 0..3usize {
            let at = lower.clone().component(axis as u8);
            for c in (0..8).filter(|c| c >> axis & 1 == 0) {
                let (a, b) = (rough[c].clone(), rough[c | 1 << axis].clone());
                let change = code.bind("change_across", wide, b - a.clone());
                let here = code.bind("halfway", wide, a + change.clone() * at.clone().splat(dw));
                rough[c | 1 << axis] = code.bind("farther", wide, here.clone() + change * Expr::F32(0.5).splat(dw));
                rough[c] = here;
            }
        }
        // How the weights of nodes change along the way.
        let way = code.bind("cells_along", Ty::VEC3, way * Expr::F32(cells).splat(3));
        let zero = || Expr::F32(0.0).splat(dw);
        let (mut sum, mut apart, mut slope, mut bend) = (zero(), zero(), zero(), zero());
        let (mut least, mut most) = (near[0].clone(), near[0].clone());
        for (c, (value, told)) in near.iter().zip(rough).enumerate() {
            let upper = |axis: usize| c >> axis & 1 == 1;
            let [a, b, c] = [0usize, 1, 2].map(|axis| {
                let f = f.clone().component(axis as u8);
                if upper(axis) { f } else { Expr::F32(1.0) - f }
            });
            let others = [b.clone() * c.clone(), a.clone() * c.clone(), a.clone() * b.clone()];
            let change = others.into_iter().enumerate().map(|(axis, others)| {
                let along = way.clone().component(axis as u8) * others;
                if upper(axis) { along } else { -along }
            });
            let change = change.reduce(|a, b| a + b).unwrap_or(Expr::F32(0.0));
            let weight = code.bind("weight", Ty::F32, a * b * c);
            let differs = code.bind("differs", wide, value.clone() - told);
            sum = code.bind("sum", wide, sum + value.clone() * weight.clone().splat(dw));
            apart = code.bind("apart", wide, apart + differs.clone() * weight.splat(dw));
            slope = code.bind("slope", wide, slope + value.clone() * change.splat(dw));
            bend = bend.max(differs.abs());
            (least, most) = (least.min(value.clone()), most.max(value.clone()));
        }
        let apart = code.bind("apart_most", Ty::F32, largest(apart.abs(), dw));
        let bend = code.bind("bend", Ty::F32, largest(bend, dw));
        let range = code.bind("range", Ty::F32, largest(most - least, dw));
        let torn = is_torn(&apart, &range);
        let off = torn.select(range.clone(), bent(bend, range));
        code.return_(Expr::Compose(found, vec![sum, off, slope]));
        self.builder.add_function(code.finish(Some(found)))
    }

    /// How many columns a gathering looks up: they count as evaluations. Of light that is followed from slab to slab, the way back to
    /// the plane is evaluated.
    pub(super) fn looks(&self) -> Option<u32> {
        if self.buffered.is_some() {
            return Some(1);
        }
        let sky = if self.scene.environment { SKY } else { 0 };
        self.cache.as_ref().map(|_| self.of_kind(false) + DISC * self.of_kind(true) + sky)
    }

    /// The number of a light among those with a disc, or without.
    fn among_its_kind(&self, number: u32) -> u32 {
        let lights = &self.scene.lights;
        let own = lights[number as usize].kind.is_disc();
        lights[..number as usize].iter().filter(|l| l.kind.is_disc() == own).count() as u32
    }

    /// How many lights there are with a disc, or without.
    fn of_kind(&self, disc: bool) -> u32 {
        self.scene.lights.iter().filter(|l| l.kind.is_disc() == disc).count() as u32
    }

    /// Depth towards a sample's light, and what it may be wrong by. `k_open` is the extinction at the place of the media that are kept.
    pub(super) fn look_up(
        &mut self,
        code: &mut Code,
        cache: &Cache,
        p: &Expr,
        sample: &LightSample,
        k_open: Option<&Expr>,
    ) -> (Expr, Expr) {
        let dw = self.scene.depth_width;
        // Negative where it is not known.
        let k_open = k_open.cloned().unwrap_or_else(|| Expr::F32(-1.0).splat(dw));
        let (function, number) = match &sample.channel {
            Channel::Light(i) => (cache.fine, Expr::U32(self.among_its_kind(*i))),
            Channel::Disc(i, point) => {
                (cache.disc, Expr::U32(self.among_its_kind(*i) * DISC) + point.clone().convert(Prim::U32))
            }
            Channel::Sky(index) => (cache.sky, index.clone().convert(Prim::U32)),
        };
        let mut depth = Expr::F32(0.0).splat(dw);
        let mut error = Expr::F32(0.0);
        if let Some(function) = function {
            let result = self.builder.result_of(function);
            let arguments = vec![p.clone(), sample.to.clone(), sample.limit.clone(), number, k_open];
            let value = code.bind("kept", result, Expr::Call(function, arguments));
            depth = value.clone().field(0);
            error = value.field(1);
        }
        if let Some(closed) = &cache.closed {
            let arguments = vec![p.clone(), sample.to.clone(), sample.limit.clone()];
            let value = Expr::Call(closed.function, arguments);
            depth = depth + value;
        }
        (code.bind("depth_to_light", Ty::float(dw), depth), error)
    }
}
