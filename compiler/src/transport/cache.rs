//! Light on its way through media without closed forms, worked out once for a picture: optical depths from the nodes of a
//! lattice to each light, between which rays interpolate.
//!
//! Without it every step of every ray would step towards every light. Suns and lamps have a fine lattice; of an environment
//! a fixed set of directions is kept on a coarse one. Depths are interpolated (they are smoother than what they let through),
//! and the difference from the lattice of half the resolution, divided by three since the error falls with its square, is
//! the error that each look-up adds to the picture's.

use super::light::LightSample;
use super::shapes::{FAR, SdfFunctions};
use super::trace::{Tracer, largest};
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

/// Nodes along each edge for an environment.
const COARSE: u32 = 25;
/// Directions of an environment.
pub(super) const SKY: u32 = 24;
/// Evaluations along a ray of which some look up columns: drivers that end loops after 65535 rounds get this far.
pub(super) const MOST_LOOKS: u32 = 12_000;
/// What a shadow may be wrong by, as a share of the accuracy for light of strength 1.
const DIM: f64 = 0.1;

/// What of the light is kept.
#[derive(Clone)]
pub(super) struct Cache {
    /// `column_fine(p, to, limit, channel)` and the same of the sky: depth, and its error in the last component.
    fine: Option<FunctionId>,
    sky: Option<FunctionId>,
    /// Depth through closed media alone, if there are any beside.
    pub(super) closed: Option<super::light::Shadow>,
    pub(super) fill: FillPass,
}

/// Which column of the cache a sample of a light asks for.
#[derive(Clone)]
pub(super) enum Channel {
    /// Of a light, by its number.
    Light(u32),
    /// Of a direction of the sky, by its number.
    Sky(Expr),
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
        let lights = self.scene.lights.len() as u32;
        let n = fine_nodes(self.rule);
        let fine = lights * n.pow(3);
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
        for (number, light) in (0u32..).zip(self.scene.lights.clone()) {
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
            code.push_if(channel.clone().equal(number), body);
        }
        let suns = code.close();
        code.open();
        let rest = code.bind("rest", Ty::U32, index.clone() - fine);
        let channel = code.bind("direction_number", Ty::U32, rest.clone() / COARSE.pow(3));
        let share = node(&mut code, &(rest - channel.clone() * COARSE.pow(3)), COARSE);
        let p = code.bind("p", Ty::VEC3, low + share * size);
        code.set(place, p);
        let direction = Self::sky_direction(&mut code, &channel.convert(Prim::F32));
        code.set(to, direction);
        let skies = code.close();
        match (fine > 0, sky > 0) {
            (true, true) => code.push_if_else(index.clone().less(fine), suns, skies),
            (true, false) => code.push_all(suns),
            (false, _) => code.push_all(skies),
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
        let fill = FillPass { kernel: 1, nodes: fine + sky, floats: (fine + sky) * u32::from(dw), media };
        let fine = (lights > 0).then(|| self.column("column", n, 0));
        let sky = (sky > 0).then(|| self.column("column_of_sky", COARSE, lights * n.pow(3)));
        Some((Cache { fine, sky, closed, fill }, entry))
    }

    /// Writes `name(p, to, limit, channel)`: trilinear interpolation of depths, with the error as last component.
    fn column(&mut self, name: &str, n: u32, first: u32) -> FunctionId {
        let dw = self.scene.depth_width;
        let buffer = self.builder.cache();
        let (low, size) = self.corner();
        let wide = Ty::float(dw);
        // One lattice with this many cells along an edge, of which each spans `stride` nodes.
        let mut code = Code::new(&format!("{name}_lattice"), None);
        let u = code.parameter("u", Ty::VEC3);
        let channel = code.parameter("channel", Ty::U32);
        let stride = code.parameter("stride", Ty::U32);
        let cells = code.bind("cells", Ty::U32, Expr::U32(n - 1) / stride.clone());
        let x = code.bind("x", Ty::VEC3, u * cells.clone().convert(Prim::F32).splat(3));
        let most = code.bind("most", Ty::F32, (cells - 1u32).convert(Prim::F32));
        let floor = Expr::math(Math::Floor, [x.clone()]);
        let cell = Expr::math(Math::Clamp, [floor, Expr::F32(0.0).splat(3), most.splat(3)]);
        let cell = code.bind("cell", Ty::VEC3, cell);
        let f = code.bind("f", Ty::VEC3, x - cell.clone());
        let whole = |i: u8| cell.clone().component(i).convert(Prim::U32) * stride.clone();
        let corner = [0u8, 1, 2].map(|i| code.bind(["i", "j", "k"][i as usize], Ty::U32, whole(i)));
        let base = code.bind("base", Ty::U32, channel * n.pow(3) + first);
        let mut sum: Option<Expr> = None;
        for c in 0..8u32 {
            let bit = |axis: u32| (c >> axis) & 1;
            let at = |axis: usize| {
                if bit(axis as u32) == 1 { corner[axis].clone() + stride.clone() } else { corner[axis].clone() }
            };
            let node = base.clone() + at(0) + at(1) * n + at(2) * (n * n);
            let node = code.bind("node", Ty::U32, node * u32::from(dw));
            let parts: Vec<Expr> = (0..dw).map(|i| Expr::Load(buffer, Box::new(node.clone() + u32::from(i)))).collect();
            let value = if dw == 1 { parts[0].clone() } else { Expr::Compose(wide, parts) };
            let weight = (0..3u8).map(|axis| {
                let f = f.clone().component(axis);
                if bit(u32::from(axis)) == 1 { f } else { Expr::F32(1.0) - f }
            });
            let weight = weight.reduce(|a, b| a * b).unwrap_or(Expr::F32(1.0));
            let term = code.bind("term", wide, value * weight.splat(dw));
            sum = Some(match sum {
                Some(sum) => code.bind("sum", wide, sum + term),
                None => term,
            });
        }
        code.return_(sum.unwrap_or(Expr::F32(0.0)));
        let lattice = self.builder.add_function(code.finish(Some(wide)));
        let result =
            self.builder.add_struct(&format!("{name}_value"), vec![("depth".into(), wide), ("error".into(), Ty::F32)]);
        let axis = self.spans.within(self.builder);
        let mut code = Code::new(name, None);
        let p = code.parameter("p", Ty::VEC3);
        let to = code.parameter("to", Ty::VEC3);
        let limit = code.parameter("limit", Ty::F32);
        let channel = code.parameter("channel", Ty::U32);
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
        let u = (from + to * enter.splat(3)) / size;
        let u = Expr::math(Math::Clamp, [u, Expr::F32(0.0).splat(3), Expr::F32(1.0).splat(3)]);
        let u = code.bind("u", Ty::VEC3, u);
        let near = Expr::Call(lattice, vec![u.clone(), channel.clone(), Expr::U32(1)]);
        let near = code.bind("depth", wide, near);
        let rough = code.bind("rough", wide, Expr::Call(lattice, vec![u, channel, Expr::U32(2)]));
        let off = largest((near.clone() - rough).abs(), dw) * (1.0 / 3.0);
        code.return_(Expr::Compose(result, vec![near, off]));
        self.builder.add_function(code.finish(Some(result)))
    }

    /// How many columns a gathering looks up: they count as evaluations.
    pub(super) fn looks(&self) -> Option<u32> {
        let sky = if self.scene.environment { SKY } else { 0 };
        self.cache.as_ref().map(|_| self.scene.lights.len() as u32 + sky)
    }

    /// Depth towards a sample's light, and what it may be wrong by.
    pub(super) fn look_up(&mut self, code: &mut Code, cache: &Cache, p: &Expr, sample: &LightSample) -> (Expr, Expr) {
        let dw = self.scene.depth_width;
        let (function, number) = match &sample.channel {
            Channel::Light(i) => (cache.fine, Expr::U32(*i)),
            Channel::Sky(index) => (cache.sky, index.clone().convert(Prim::U32)),
        };
        let mut depth = Expr::F32(0.0).splat(dw);
        let mut error = Expr::F32(0.0);
        if let Some(function) = function {
            let result = self.builder.result_of(function);
            let arguments = vec![p.clone(), sample.to.clone(), sample.limit.clone(), number];
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
