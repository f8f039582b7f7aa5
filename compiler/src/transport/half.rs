//! Light that is followed from slab to slab (Kniss, Premože, Hansen, Shirley & McPherson 2003, "A Model for Volume Lighting and
//! Modeling"): planes stand across half the angle between the ways of sight and light, so that both meet the slabs in order, and a
//! buffer across the way of light holds what that has lost before the slab at hand ([`crate::program::Pass::Alternate`]).
//!
//! Towards a place in a slab light has lost what the buffer holds on its way, interpolated between nodes, and what is in the slab
//! between its near plane and the place. That is integrated as the slab itself is, by the midpoint rule between boundaries, and so is
//! what is added to the buffer behind the slab. Both are of second order in the thickness; nodes lie as close as planes, so
//! that interpolation is, too. Depths are summed, as everywhere, and not multiplied up as transmittances.
//!
//! What the buffer's resolution may make wrong is taken from the nodes themselves, as it is of columns of light (`cache`): a third of
//! the difference from what every other node tells, since the error falls with the square of their distance, and all that nodes
//! around a place differ by where they are torn apart. What the slabs' thickness adds shrinks with that of the slabs, and is in what
//! pictures of two numbers of slabs differ by; but where light does not come through a slab both may be dark alike, and what its middle
//! does not tell of the light in a slab is added besides.

use super::cache::resolved;
use super::light::{LightSample, Shadow};
use super::march::OPAQUE;
use super::shapes::{Ray, SdfFunctions};
use super::trace::{Apart, State, Stretch, Tracer, Walk, cut_short, largest};
use crate::fields::Code;
use crate::program::kernel::{Expr, FunctionId, Math, Prim, Ty};
use crate::program::{Blend, FrameValue, Ledger, LightBuffer, OutputKind, Precision, Target};

/// More optical depth than this is not added up: sums of it, and differences, are finite.
const MOST: f64 = 1e30;
/// Least cosine between light and what crosses the planes. The runtime keeps it far larger.
const LEAST_FACING: f64 = 1e-3;

/// What the kernel that is drawn into the buffer is made of.
#[derive(Clone)]
pub(crate) struct LightSlabs {
    /// `lost(origin, direction, from, to)`: optical depth of the media that the buffer is about, on the way to the light.
    lost: FunctionId,
    /// Its result: a struct of the depth, and of what that may be wrong by if it is kept.
    result: Ty,
    depth_width: u8,
    error: bool,
    pub(crate) buffer: LightBuffer,
}

/// The same with the function that reads it: `light_before(p, to, limit, plane)`.
#[derive(Clone)]
pub(super) struct Buffered {
    pub(super) slabs: LightSlabs,
    before: FunctionId,
    /// Depth through media with closed forms, if there are any beside.
    closed: Option<Shadow>,
}

impl Tracer<'_> {
    /// Follows light from slab to slab.
    pub(crate) fn along_half_angle(mut self) -> Self {
        self.half_angle = true;
        self
    }

    /// Writes what a buffer needs, if some depth has no closed form.
    pub(super) fn write_buffer(&mut self, sdfs: &[Option<SdfFunctions>], ledger: &mut Ledger) -> Option<Buffered> {
        let open = self.scene.matter.iter().filter(|m| self.open_depth(m));
        let media: Vec<u32> = open.map(|m| m.index).collect();
        if self.scene.phases.is_empty() {
            ledger.omit("buffer of light", "no medium scatters light towards the eye", None);
            return None;
        }
        if media.is_empty() {
            ledger.omit("buffer of light", "every optical depth towards the light has a closed form", None);
            return None;
        }
        ledger.omit(
            "columns of light, and steps towards the light at every sample",
            "light is followed from slab to slab",
            None,
        );
        let closed = self.scene.matter.iter().any(|m| m.extinction.is_some() && !self.open_depth(m));
        let closed =
            if closed { self.write_shadow_of(sdfs, "shadow_of_closed", |this, m| !this.open_depth(m)) } else { None };
        let depth_width = self.scene.depth_width;
        let error = self.wants(OutputKind::Error);
        let (lost, result) = self.write_lost(sdfs, error);
        let target = |name: &str, channels: u8| Target {
            name: name.to_owned(),
            channels: if channels == 3 { 4 } else { channels },
            blend: Blend::Add,
            precision: Precision::Single,
        };
        let all = depth_width + u8::from(error);
        let mut targets = vec![target("light_lost", all.min(4))];
        if all > 4 {
            targets.push(target("light_unsure", 1));
        }
        let slabs = LightSlabs { lost, result, depth_width, error, buffer: LightBuffer { targets, media } };
        let before = self.write_before(&slabs);
        Some(Buffered { slabs, before, closed })
    }

    fn write_lost(&mut self, sdfs: &[Option<SdfFunctions>], error: bool) -> (FunctionId, Ty) {
        let dw = self.scene.depth_width;
        let mut code = Code::new("lost", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let (from, to) = (code.parameter("from", Ty::F32), code.parameter("to", Ty::F32));
        let depth = code.var("depth", Ty::float(dw), Expr::F32(0.0).splat(dw));
        let state = State {
            depth: Some(depth),
            radiance: None,
            error: error.then(|| code.var("error", Ty::F32, 0.0)),
            apart: Apart::default(),
            work: None,
            fault: None,
            fault_at: None,
            projected: None,
        };
        self.only = Some(|this, m| this.open_depth(m));
        let stretch = Stretch { start: from, end: Some(to), whole: None };
        self.follow_towards(&mut code, Walk::Light, (&ray, &state), sdfs, &stretch);
        self.only = None;
        let mut fields = vec![("depth".to_owned(), Ty::float(dw))];
        let mut values = vec![Expr::Local(depth).min(Expr::F32(MOST).splat(dw))];
        if let Some(error) = state.error {
            fields.push(("error".to_owned(), Ty::F32));
            values.push(error.into());
        }
        let result = self.builder.add_struct("Lost", fields);
        code.return_(Expr::Compose(result, values));
        (self.builder.add_function(code.finish(Some(result))), result)
    }

    /// `light_lattice(at, stride)`: what nodes tell of a place among them, of which every `stride`th counts. Depth; and where errors are
    /// kept, what that may be wrong by and what the nodes around differ by.
    fn write_light_lattice(&mut self, slabs: &LightSlabs) -> (FunctionId, Ty) {
        let dw = slabs.depth_width;
        let wide = Ty::float(dw);
        let textures: Vec<u32> =
            (0..).zip(&slabs.buffer.targets).map(|(i, t)| self.builder.light_target(i, &t.name)).collect();
        let mut code = Code::new("light_lattice", None);
        let at = code.parameter("at", Ty::float(2));
        let stride = code.parameter("stride", Ty::U32);
        let nodes = self.builder.frame(FrameValue::LightNodes);
        let axes: Vec<[Expr; 2]> = (0..2u8)
            .map(|i| {
                let word = |name: &str| format!("{name}_{}", ["x", "y"][usize::from(i)]);
                let cells = (nodes.clone().component(i) - 1u32) / stride.clone();
                let most = code.bind(&word("most"), Ty::F32, (cells - 1u32).convert(Prim::F32));
                let x = code.bind(&word("at"), Ty::F32, at.clone().component(i) / stride.clone().convert(Prim::F32));
                let cell = Expr::math(Math::Clamp, [Expr::math(Math::Floor, [x.clone()]), 0.0.into(), most]);
                let cell = code.bind(&word("cell"), Ty::F32, cell);
                let first = code.bind(&word("first"), Ty::U32, cell.clone().convert(Prim::U32) * stride.clone());
                [first, code.bind(&word("share"), Ty::F32, x - cell)]
            })
            .collect();
        let mut found: Option<[Expr; 4]> = None;
        for c in 0..4u32 {
            let mut weight = Expr::F32(1.0);
            let mut place = vec![];
            for (i, [first, share]) in axes.iter().enumerate() {
                let beyond = c >> i & 1 == 1;
                let node = if beyond { first.clone() + stride.clone() } else { first.clone() };
                place.push(node.convert(Prim::I32));
                let own = if beyond { share.clone() } else { Expr::F32(1.0) - share.clone() };
                weight = if i == 0 { own } else { weight * own };
            }
            let place = code.bind("node", Ty::Value(Prim::I32, 2), Expr::Compose(Ty::Value(Prim::I32, 2), place));
            let texels: Vec<Expr> = textures
                .iter()
                .map(|t| code.bind("texel", Ty::float(4), Expr::texture_load(*t, place.clone())))
                .collect();
            let number = |n: u8| texels[usize::from(n / 4)].clone().component(n % 4);
            let depth = if dw == 1 { number(0) } else { Expr::Compose(wide, (0..dw).map(number).collect()) };
            let depth = code.bind("node_depth", wide, depth);
            let weight = code.bind("weight", Ty::F32, weight);
            let off = if slabs.error { number(dw) * weight.clone() } else { Expr::F32(0.0) };
            let term = depth.clone() * weight.splat(dw);
            found = Some(match found {
                None => [term, depth.clone(), depth, off],
                Some([sum, least, most, unsure]) => [
                    code.bind("sum", wide, sum + term),
                    code.bind("least", wide, least.min(depth.clone())),
                    code.bind("most", wide, most.max(depth)),
                    code.bind("unsure", Ty::F32, unsure + off),
                ],
            });
        }
        let [sum, least, most, unsure] = found.expect("a cell has four nodes");
        let mut fields = vec![("depth".to_owned(), wide)];
        let mut values = vec![sum];
        if slabs.error {
            fields.extend([("unsure".to_owned(), Ty::F32), ("range".to_owned(), Ty::F32)]);
            values.extend([unsure, largest(most - least, dw)]);
        }
        let result = self.builder.add_struct("BetweenNodes", fields);
        code.return_(Expr::Compose(result, values));
        (self.builder.add_function(code.finish(Some(result))), result)
    }

    /// `light_before(p, to, limit, plane)`: what light has lost on its way to a place behind the plane up to which the buffer
    /// holds that; `plane` is its distance from the anchor along the normal.
    fn write_before(&mut self, slabs: &LightSlabs) -> FunctionId {
        let dw = slabs.depth_width;
        let (lattice, between) = self.write_light_lattice(slabs);
        let mut code = Code::new("light_before", None);
        let p = code.parameter("p", Ty::VEC3);
        let to = code.parameter("to", Ty::VEC3);
        let limit = code.parameter("limit", Ty::F32);
        let plane = code.parameter("plane", Ty::F32);
        let mut frame = |value| self.builder.frame(value);
        let q = code.bind("from_center", Ty::VEC3, p.clone() - frame(FrameValue::LightCenter));
        let spread = Expr::F32(1.0) + frame(FrameValue::LightForward).dot(q.clone()) * frame(FrameValue::LightNear);
        let across = [FrameValue::LightRight, FrameValue::LightUp].map(|axis| frame(axis).dot(q.clone()));
        let at = Expr::Compose(Ty::float(2), across.into()) / spread.splat(2) - frame(FrameValue::LightCorner);
        let last = frame(FrameValue::LightNodes).convert(Prim::F32) - Expr::F32(1.0).splat(2);
        let at = Expr::math(Math::Clamp, [at, Expr::F32(0.0).splat(2), last]);
        let at = code.bind("at", Ty::float(2), at);
        let fine = code.bind("fine", between, Expr::Call(lattice, vec![at.clone(), Expr::U32(1)]));
        let normal = code.bind("normal", Ty::VEC3, frame(FrameValue::SlabNormal));
        let behind = (p.clone() - frame(FrameValue::CameraAnchor)).dot(normal.clone()) - plane;
        let facing = (-to.clone().dot(normal)).max(LEAST_FACING);
        let way = code.bind("way", Ty::F32, (behind / facing).max(0.0).min(limit));
        let own = code.bind("own", slabs.result, Expr::Call(slabs.lost, vec![p, to, Expr::F32(0.0), way]));
        let depth = fine.clone().field(0) + own.clone().field(0);
        let mut fields = vec![("depth".to_owned(), Ty::float(dw))];
        let mut values = vec![depth];
        if slabs.error {
            let rough = code.bind("rough", between, Expr::Call(lattice, vec![at, Expr::U32(2)]));
            let apart = code.bind("apart", Ty::F32, largest((fine.clone().field(0) - rough.field(0)).abs(), dw));
            let off = resolved(apart, fine.clone().field(2));
            fields.push(("error".to_owned(), Ty::F32));
            // Across the slab light falls by twice the depth δ up to here: its middle is wrong by δ²/6 of itself (sinh δ/δ − 1) where that is
            // little, and by no more than all that comes to the plane.
            let deep = code.bind("deep", Ty::F32, largest(own.clone().field(0), dw));
            let skin = deep.clone() * (deep * (1.0 / 6.0)).min(1.0);
            values.push(off + fine.field(1) + own.field(1) + skin);
        }
        let result = self.builder.add_struct("LightBefore", fields);
        code.return_(Expr::Compose(result, values));
        self.builder.add_function(code.finish(Some(result)))
    }

    /// Depth towards a sample's light from a place behind the plane, and what it may be wrong by.
    pub(super) fn look_back(
        &mut self,
        code: &mut Code,
        buffered: &Buffered,
        p: &Expr,
        sample: &LightSample,
        plane: &Expr,
    ) -> (Expr, Option<Expr>) {
        let dw = self.scene.depth_width;
        let result = self.builder.result_of(buffered.before);
        let arguments = vec![p.clone(), sample.to.clone(), sample.limit.clone(), plane.clone()];
        let value = code.bind("before", result, Expr::Call(buffered.before, arguments));
        let mut depth = value.clone().field(0);
        if let Some(closed) = &buffered.closed {
            let arguments = vec![p.clone(), sample.to.clone(), sample.limit.clone()];
            depth = depth + Expr::Call(closed.function, arguments);
        }
        let off = buffered.slabs.error.then(|| value.field(1));
        (code.bind("depth_to_light", Ty::float(dw), depth), off)
    }

    /// Adds to the error of a slab of light what it cannot tell.
    pub(super) fn lose_sight(&self, code: &mut Code, state: &State, when: &Expr) {
        if let Some(error) = state.error {
            code.add(error, when.clone().select(OPAQUE, 0.0));
        }
    }
}

impl LightSlabs {
    /// What light loses in a slab, on its way through the node whose texel has its centre at `place`: a vec4 for each target.
    pub(crate) fn texels(
        &self,
        builder: &mut crate::fields::KernelBuilder,
        code: &mut Code,
        (place, slab): (&Expr, &Expr),
    ) -> Vec<Expr> {
        let mut frame = |value| builder.frame(value);
        let corner = code.bind("corner_node", Ty::float(2), frame(FrameValue::LightCorner));
        let axes = [FrameValue::LightRight, FrameValue::LightUp].map(&mut frame);
        let mut across = Expr::F32(0.0).splat(3);
        for (i, axis) in (0u8..).zip(axes) {
            let node = place.clone().component(i) - 0.5 + corner.clone().component(i);
            let square = axis.clone().dot(axis.clone());
            let name = format!("across_{}", ["x", "y"][usize::from(i)]);
            let part = code.bind(&name, Ty::VEC3, axis * (node / square).splat(3));
            across = if i == 0 { part } else { across + part };
        }
        let across = code.bind("across", Ty::VEC3, across);
        let toward = frame(FrameValue::LightForward) + across.clone() * frame(FrameValue::LightNear).splat(3);
        let way = code.bind("way", Ty::VEC3, Expr::math(Math::Normalize, [toward]));
        let origin = code.bind("origin", Ty::VEC3, frame(FrameValue::LightCenter) + across);
        let normal = code.bind("normal", Ty::VEC3, frame(FrameValue::SlabNormal));
        let facing = code.bind("facing", Ty::F32, way.clone().dot(normal.clone()).max(LEAST_FACING));
        let off = (origin.clone() - frame(FrameValue::CameraAnchor)).dot(normal);
        let first = code.bind("first", Ty::F32, frame(FrameValue::SlabStart) - off);
        let step = frame(FrameValue::SlabStep);
        // Neighbours compute the plane between them alike.
        let plane = |n: Expr| (first.clone() + n * step.clone()) / facing.clone();
        let near = code.bind("near", Ty::F32, plane(slab.clone()));
        let far = code.bind("far", Ty::F32, plane(slab.clone() + 1.0));
        // Fields are asked on the way to the light.
        let arguments = vec![origin, -way, -far, -near];
        let value = code.bind("within", self.result, Expr::Call(self.lost, arguments));
        let depth = value.clone().field(0);
        let part = |i: u8| if self.depth_width == 1 { depth.clone() } else { depth.clone().component(i) };
        let mut numbers: Vec<Expr> = (0..self.depth_width).map(part).collect();
        if self.error {
            // What is seen has its own word for it: a fault.
            let cut = cut_short(builder, code);
            numbers.push(value.field(1) + cut.select(OPAQUE, 0.0));
        }
        let texel = |part: &[Expr]| {
            let rest = std::iter::repeat_n(Expr::F32(0.0), 4 - part.len());
            Expr::Compose(Ty::float(4), part.iter().cloned().chain(rest).collect())
        };
        numbers.chunks(4).map(texel).collect()
    }
}
