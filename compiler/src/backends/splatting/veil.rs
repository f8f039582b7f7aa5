//! `blend`: one ray through the splats of its list and the media between them, from the farthest to the nearest.

use crate::fields::{Code, Helper, KernelBuilder};
use crate::ir::{FieldScene, SplatBlend};
use crate::program::kernel::{BinaryOp, Expr, Function, FunctionId, LocalId, Math, Prim, Ty};
use crate::program::{Fault, FootprintShape, FrameValue, Ledger, OutputKind, RaySource};
use crate::transport::aim::{Note, Rays};
use crate::transport::layers::{component, components};
use crate::transport::records::{self, Pixel};
use crate::transport::slab::{Part, Pieces};
use crate::transport::{HALF_ULP, cut_short};

/// Largest optical depth that f32 holds, and some room.
const OPAQUE: f64 = 3.0e38;
/// What an error of encoded numbers e becomes in light is at most 2.4·light/e times as large, and e ≥ error.
const DECODED: f64 = 2.4;
/// Where media lie between encoded splats, a change behind a splat may be this many times as large before it, where it is dark.
const THROUGH_DARK: f64 = 13.0;

/// What a blend rounds, relative.
const BLENDED: f64 = 3.0 * HALF_ULP;
/// What a power may be off by, of numbers from 1e-4 to 1.
const POWER: f64 = 32.0 * HALF_ULP;

/// What comes out.
pub(super) fn fields(pieces: &Pieces, edge: bool) -> Vec<(OutputKind, u8)> {
    let mut fields = pieces.whole.fields.clone();
    // Lists are long: the loop over one may be cut short even where nothing else is.
    if !fields.iter().any(|f| f.0 == OutputKind::Fault) {
        fields.push((OutputKind::Fault, 4));
    }
    if edge {
        fields.push((OutputKind::Edge, 1));
    }
    fields
}

/// How splats are blended, and what the sum is in at a place of the code.
enum Numbers {
    /// Radiances, all along.
    Linear,
    /// Encoded between the first splat and the last, with no medium there.
    Encoded,
    /// Encoded when the variable says so.
    Either(LocalId),
}

/// Largest component.
fn largest(value: &Expr, width: u8) -> Expr {
    let ty = Ty::float(width);
    (1..width).fold(component(value.clone(), ty, 0), |m, i| m.max(component(value.clone(), ty, i)))
}

/// A function of each component.
fn each(code: &mut Code, name: &str, width: u8, value: Expr, f: impl Fn(Expr) -> Expr) -> Expr {
    let ty = Ty::float(width);
    let value = code.bind(name, ty, value);
    let parts: Vec<Expr> = (0..width).map(|i| f(component(value.clone(), ty, i))).collect();
    if let [only] = parts.as_slice() { only.clone() } else { Expr::Compose(ty, parts) }
}

fn fitted(value: Expr, from: u8, to: u8) -> Expr {
    if from == to { value } else { value.splat(to) }
}

/// The ray as it is followed, from its far end to the eye.
struct Blend<'a> {
    pieces: &'a Pieces,
    note: Note,
    /// Width of light, and of optical depths.
    lw: u8,
    dw: u8,
    numbers: Numbers,
    encode: Option<FunctionId>,
    decode: Option<FunctionId>,
    light: LocalId,
    /// Of each band, in the numbers that `light` is in: of media, and of rounding.
    error: Option<LocalId>,
    rounding: Option<LocalId>,
    depth: Option<LocalId>,
    /// −log of what splats let through.
    veiled: Option<LocalId>,
    work: Option<LocalId>,
    fault: LocalId,
    fault_at: LocalId,
    /// Where what has been followed so far begins.
    here: LocalId,
    /// Length that errors of media are shared out over, once it is known.
    part_of: Option<LocalId>,
    /// The largest radiance so far, and of encoded colours.
    most: Option<LocalId>,
    most_encoded: Option<LocalId>,
}

impl Blend<'_> {
    /// What is attenuated as light is.
    fn errors(&self) -> impl Iterator<Item = LocalId> {
        [self.error, self.rounding].into_iter().flatten()
    }

    /// Adds what rounding makes of a sum, and what else it moves it by. Roundings are of either sign and independent of each other: they
    /// add up as their root (Higham 2002, §2.8), which is an estimate.
    fn round(&self, code: &mut Code, moved: Option<Expr>) {
        let Some(rounding) = self.rounding else { return };
        let lw = self.lw;
        let own = Expr::Local(self.light).abs() * Expr::F32(BLENDED).splat(lw);
        let own = match moved {
            Some(moved) => own + moved,
            None => own,
        };
        let own = code.bind("rounded", Ty::float(lw), own);
        // By the larger, so that no square overflows or vanishes.
        let most = own.clone().max(Expr::Local(rounding)).max(Expr::F32(1e-37).splat(lw));
        let most = code.bind("most_rounded", Ty::float(lw), most);
        let part = code.bind("part_rounded", Ty::float(lw), own.min(Expr::Local(rounding)) / most.clone());
        code.set(rounding, most * (part.clone() * part + Expr::F32(1.0).splat(lw)).sqrt());
    }

    /// Slope of the code of sRGB at a radiance, or of its inverse at an encoded number.
    fn slope(decoding: bool, value: Expr) -> Expr {
        let power = |x: Expr, p: f64| Expr::math(Math::Pow, [x, Expr::F32(p)]);
        if decoding {
            let curve = power((value.clone().max(0.0) + 0.055) / 1.055, 1.4) * (2.4 / 1.055);
            value.less_equal(0.040_45).select(1.0 / 12.92, curve)
        } else {
            let curve = power(value.clone().max(1e-30), 1.0 / 2.4 - 1.0) * (1.055 / 2.4);
            value.less_equal(0.003_130_8).select(12.92, curve)
        }
    }

    /// Makes encoded numbers of radiances, or radiances of encoded numbers, whatever they are now.
    fn convert(&self, code: &mut Code, to_encoded: bool) {
        let (Some(encode), Some(decode)) = (self.encode, self.decode) else { return };
        let condition = match self.numbers {
            Numbers::Linear | Numbers::Encoded => return,
            Numbers::Either(flag) => flag,
        };
        code.open();
        self.change(code, if to_encoded { encode } else { decode }, !to_encoded);
        code.set(condition, Expr::Bool(to_encoded));
        let block = code.close();
        let condition = Expr::Local(condition);
        code.push_if(if to_encoded { !condition } else { condition }, block);
    }

    /// The same without asking.
    fn change(&self, code: &mut Code, function: FunctionId, decoding: bool) {
        let before = Expr::Local(self.light);
        if self.error.is_some() {
            let slope = each(code, "at", self.lw, before.clone(), |x| Self::slope(decoding, x));
            let slope = code.bind("slope", Ty::float(self.lw), slope);
            for var in self.errors() {
                code.set(var, Expr::Local(var) * slope.clone());
            }
        }
        let after = each(code, "before", self.lw, before, |x| Expr::Call(function, vec![x]));
        code.set(self.light, after);
        // A power is a product inside an exponential.
        self.round(code, Some(Expr::Local(self.light).abs() * Expr::F32(POWER).splat(self.lw)));
    }

    /// Goes from where it is to `to`, through the media between.
    fn stretch(&self, code: &mut Code, to: &Expr) {
        if self.pieces.parts.is_empty() {
            return;
        }
        code.open();
        let note = &self.note;
        let mut arguments = vec![note.origin.clone(), note.direction.clone(), to.clone(), self.here.into()];
        arguments.extend(self.part_of.map(Expr::Local));
        let value = code.bind("between", self.pieces.result, Expr::Call(self.pieces.piece, arguments));
        let part = |part| self.pieces.place(part).map(|i| value.clone().field(i));
        let (light, depth) = (part(Part::Light), part(Part::Depth));
        // Where there is nothing, numbers stay what they are.
        let there = [depth.clone().map(|d| largest(&d, self.dw)), light.clone().map(|l| largest(&l, self.lw))];
        let there =
            there.into_iter().flatten().chain(part(Part::Error).filter(|_| self.error.is_some())).reduce(Expr::max);
        code.open();
        self.convert(code, false);
        let through = depth.clone().map(|d| code.bind("through", Ty::float(self.dw), (-d).exp()));
        let mut sum = Expr::Local(self.light);
        if let Some(through) = &through {
            sum = fitted(through.clone(), self.dw, self.lw) * sum;
        }
        if let Some(light) = light {
            sum = light + sum;
        }
        code.set(self.light, sum);
        if let Some(through) = &through {
            for var in self.errors() {
                code.set(var, fitted(through.clone(), self.dw, self.lw) * var);
            }
        }
        let rounded = part(Part::Rounding);
        if let (Some(error), Some(own)) = (self.error, part(Part::Error)) {
            let own = match &rounded {
                Some(rounded) => (own - rounded.clone()).max(0.0),
                None => own,
            };
            code.add(error, own.splat(self.lw));
        }
        self.round(code, rounded.map(|rounded| rounded.splat(self.lw)));
        if let Some(most) = self.most {
            code.set(most, Expr::Local(most).max(largest(&self.light.into(), self.lw)));
        }
        if let (Some(total), Some(depth)) = (self.depth, depth) {
            // At most what an endless column has.
            code.set(total, (Expr::Local(total) + depth).min(Expr::F32(OPAQUE).splat(self.dw)));
        }
        let changed = code.close();
        match there {
            Some(there) => code.push_if(there.greater(0.0), changed),
            None => code.push_all(changed),
        }
        if let (Some(work), Some(own)) = (self.work, part(Part::Work)) {
            code.add(work, own.convert(Prim::F32));
        }
        if let Some(own) = part(Part::Fault) {
            code.open();
            code.set(self.fault, own.clone());
            let middle = (to.clone() + Expr::Local(self.here).min(1.0e30)) * 0.5;
            code.set(self.fault_at, note.origin.clone() + note.direction.clone() * middle.splat(3));
            let block = code.close();
            code.push_if(own.greater(0u32), block);
        }
        code.set(self.here, to.clone());
        let block = code.close();
        code.push_if(Expr::Local(self.here).greater(to.clone()), block);
    }
}

/// A footprint at the point of the picture, or on the ray: t, α, and whether its colours are encoded.
struct Met {
    t: Expr,
    alpha: Expr,
    /// What rounding may make of α, relative.
    off: Expr,
    encoded: Expr,
    /// Where its colours are.
    colors: Expr,
}

/// What is the same for all footprints on a ray.
struct Place {
    shape: FootprintShape,
    stride: u32,
    direction: Expr,
    /// Pixels from the middle of the picture, and the cosine to the view.
    plane: Option<(Expr, Expr, Expr)>,
}

impl Place {
    fn new(builder: &mut KernelBuilder, code: &mut Code, (shape, stride): (FootprintShape, u32), note: &Note) -> Self {
        let plane = (shape == FootprintShape::Plane).then(|| {
            let size = builder.frame(FrameValue::ImageSize).convert(Prim::F32);
            let size = code.bind("size", Ty::float(2), size);
            let x = code.bind("from_middle_x", Ty::F32, note.first.clone() - size.clone().component(0) * 0.5);
            let y = code.bind("from_middle_y", Ty::F32, note.step.clone() - size.component(1) * 0.5);
            let facing = note.direction.clone().dot(builder.frame(FrameValue::CameraForward));
            (x, y, code.bind("facing", Ty::F32, facing))
        });
        Self { shape, stride, direction: note.direction.clone(), plane }
    }
}

fn meet(builder: &mut KernelBuilder, code: &mut Code, place: &Place, number: &Expr) -> Met {
    let footprints = builder.footprints();
    let base = code.bind("base", Ty::U32, number.clone() * place.stride);
    let mut next = 0u32;
    let mut read = |code: &mut Code, name: &str| {
        next += 1;
        code.bind(name, Ty::F32, Expr::load(footprints, base.clone() + (next - 1)))
    };
    let depth = read(code, "depth");
    // In the exponent, how far sums may be off: of the terms of each, and of its own size.
    let off = |sum: &Expr, terms: Expr| sum.clone().abs() * terms;
    let (t, power, off) = match (place.shape, &place.plane) {
        (FootprintShape::Plane, Some((x, y, facing))) => {
            let [xx, xy, x0, yy, y0] = ["xx", "xy", "x0", "yy", "y0"].map(|name| read(code, name));
            let terms_u = (xx.clone() * x.clone()).abs() + (xy.clone() * y.clone()).abs() + x0.clone().abs();
            let terms_v = (yy.clone() * y.clone()).abs() + y0.clone().abs();
            let u = code.bind("u", Ty::F32, xx * x.clone() + xy * y.clone() + x0);
            let v = code.bind("v", Ty::F32, yy * y.clone() + y0);
            let t = code.bind("t", Ty::F32, depth / facing.clone());
            let off = off(&u, terms_u) + off(&v, terms_v);
            (t, Some(u.clone() * u + v.clone() * v), Some(off))
        }
        (FootprintShape::Ray | FootprintShape::Plane, _) => (depth, None, None),
        (FootprintShape::Around, _) => {
            let mut axis = |name: &str| {
                let parts = ["x", "y", "z"].map(|part| read(code, &format!("{name}_{part}")));
                let axis = code.bind(name, Ty::VEC3, Expr::Compose(Ty::VEC3, parts.into()));
                (axis.clone().dot(place.direction.clone()), axis.abs().dot(place.direction.clone().abs()))
            };
            let [(a, terms_a), (b, terms_b), (c, terms_c)] = ["a", "b", "c"].map(&mut axis);
            let ahead = code.bind("ahead", Ty::F32, c);
            let u = code.bind("u", Ty::F32, a / ahead.clone());
            let v = code.bind("v", Ty::F32, b / ahead.clone());
            let off = off(&u, terms_a) + off(&v, terms_b) + (u.clone() * u.clone() + v.clone() * v.clone()) * terms_c;
            let off = off / ahead.clone().max(1e-30);
            (depth, Some(ahead.greater(0.0).select(u.clone() * u + v.clone() * v, 1.0e30)), Some(off))
        }
    };
    let opacity = read(code, "opacity");
    let mut alpha = opacity.clone().abs();
    let mut relative = Expr::F32(BLENDED);
    if let (Some(power), Some(off)) = (power, off) {
        let power = code.bind("power", Ty::F32, power);
        alpha = alpha * (power.clone() * -0.5).exp();
        relative = (off * 3.0 + power * 2.0 + 6.0) * HALF_ULP;
    }
    let alpha = code.bind("alpha", Ty::F32, alpha);
    Met { t, alpha, off: relative, encoded: opacity.less(0.0), colors: base + place.shape.head() }
}

/// −log(1 − α), at most [`OPAQUE`].
fn veiled(code: &mut Code, alpha: &Expr) -> Expr {
    let a = || alpha.clone();
    // Where 1 − α loses digits, five terms of the series are right to 1e-8.
    let series =
        a() * (Expr::F32(1.0) + a() * (Expr::F32(0.5) + a() * (Expr::F32(1.0 / 3.0) + a() * (a() * 0.2 + 0.25))));
    let left = code.bind("left", Ty::F32, Expr::F32(1.0) - a());
    let log = -Expr::math(Math::Log, [left.clone().max(1e-30)]);
    let log = left.greater(0.0).select(log, OPAQUE);
    alpha.clone().less(0.03).select(series, log)
}

/// The entry point, and f32 that an invocation carries from round to round.
pub(super) fn entry(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    pieces: &Pieces,
    (shape, footprint, of_round): (FootprintShape, u32, u32),
    (rays, stride): (Rays, u32),
    (fields, ledger): (&[(OutputKind, u8)], &mut Ledger),
) -> (Function, u32) {
    let mut code = Code::new("blend", None);
    let source = if shape == FootprintShape::Ray { RaySource::List } else { RaySource::Camera };
    let record = match source {
        RaySource::Camera => {
            let Pixel { record, .. } = records::pixel(builder, &mut code);
            record
        }
        RaySource::List => records::listed(builder, &mut code),
    };
    let note = Note::read(builder, &mut code, &record);
    if rays != Rays::One {
        // The other side of an edge, where there is none.
        let again = Expr::binary(BinaryOp::NotEqual, builder.frame(FrameValue::Repeat), 0u32);
        code.if_(again.and(note.weight.clone().less_equal(0.0)), Code::return_nothing);
    }
    let origin = builder.frame(FrameValue::TileOrigin);
    let tile = match source {
        RaySource::List => origin.component(0) + record.clone(),
        RaySource::Camera => {
            let edge = builder.frame(FrameValue::ListEdge);
            let whole = |at: &Expr| at.clone().convert(Prim::U32) / edge.clone();
            whole(&note.step) * builder.frame(FrameValue::ListColumns) + whole(&note.first)
        }
    };
    let lists = builder.tile_lists();
    let tile = code.bind("tile", Ty::U32, tile * 3u32);
    let list = |i: u32| Expr::load(lists, tile.clone() + i);
    // Which part of the list this round goes through, from its end.
    let first = code.bind("first_of_list", Ty::U32, list(0));
    let last = code.bind("end_of_list", Ty::U32, list(3));
    let length = code.bind("length_of_list", Ty::U32, last.clone() - first.clone());
    let round = builder.frame(FrameValue::Round);
    let done = Expr::Math(Math::Min, vec![round.clone() * of_round, length.clone()]);
    let done = code.bind("done_before", Ty::U32, done);
    let next = code.var("next", Ty::U32, last - done.clone());
    let part = Expr::Math(Math::Min, vec![Expr::U32(of_round), length - done]);
    let first = code.bind("first_of_round", Ty::U32, Expr::Local(next) - part);

    let lw = (footprint - shape.head()) as u8;
    let dw = pieces.place(Part::Depth).map_or(1, |i| components(pieces.parts[i as usize].1));
    let wants = |kind: OutputKind| fields.iter().any(|f| f.0 == kind);
    let through = wants(OutputKind::Transmittance) || wants(OutputKind::OpticalDepth);
    let media = !pieces.parts.is_empty();
    let blends = |blend: SplatBlend| scene.splats.iter().any(|s| s.blend == blend);
    let (encoded, linear) = (blends(SplatBlend::Encoded), blends(SplatBlend::Linear));
    if !encoded {
        ledger.omit("encoding of light", "all splats are blended linearly", None);
    }
    let zeros = |width: u8| Expr::F32(0.0).splat(width);
    let told = wants(OutputKind::Error);
    let light = code.var("light", Ty::float(lw), zeros(lw));
    let fault = (code.var("fault", Ty::U32, 0u32), code.var("fault_at", Ty::VEC3, zeros(3)));
    let numbers = match (encoded, linear, media) {
        (false, _, _) => Numbers::Linear,
        (true, false, false) => Numbers::Encoded,
        (true, _, _) => Numbers::Either(code.var("is_encoded", Ty::BOOL, Expr::Bool(false))),
    };
    let blend = Blend {
        pieces,
        lw,
        dw,
        numbers,
        encode: encoded.then(|| builder.helper(&scene.graph, Helper::SrgbEncode)),
        decode: encoded.then(|| builder.helper(&scene.graph, Helper::SrgbDecode)),
        light,
        error: told.then(|| code.var("error", Ty::float(lw), zeros(lw))),
        rounding: told.then(|| code.var("rounding", Ty::float(lw), zeros(lw))),
        depth: (through && pieces.place(Part::Depth).is_some()).then(|| code.var("depth", Ty::float(dw), zeros(dw))),
        veiled: through.then(|| code.var("veiled", Ty::F32, 0.0)),
        work: wants(OutputKind::Evaluations).then(|| code.var("work", Ty::F32, 0.0)),
        fault: fault.0,
        fault_at: fault.1,
        here: code.var("here", Ty::F32, note.end.clone()),
        part_of: pieces.controlled.then(|| code.var("part_of", Ty::F32, 0.0)),
        most: told.then(|| code.var("most", Ty::F32, 0.0)),
        most_encoded: (told && encoded).then(|| code.var("most_encoded", Ty::F32, 0.0)),
        note,
    };
    let carried = blend.carried();
    let floats: u32 = carried.iter().map(|(_, ty)| u32::from(components(*ty))).sum();
    let memory = builder.carried();
    let own = code.bind("own", Ty::U32, record.clone() * floats);
    code.open();
    blend.begin(&mut code, builder);
    let begin = code.close();
    code.open();
    let mut at = 0;
    for (var, ty) in &carried {
        let value = restore(&mut code, *ty, &mut |_| {
            at += 1;
            Expr::load(memory, own.clone() + (at - 1))
        });
        code.set(*var, value);
    }
    let go_on = code.close();
    code.push_if_else(round.clone().equal(0u32), begin, go_on);
    let place = Place::new(builder, &mut code, (shape, footprint), &blend.note);
    code.open();
    code.break_if(Expr::Local(next).less_equal(first));
    code.set(next, Expr::Local(next) - 1u32);
    let number = code.bind("number", Ty::U32, Expr::load(lists, next));
    let met = meet(builder, &mut code, &place, &number);
    let seen = met.alpha.clone().greater(0.0).and(met.t.clone().less(blend.note.end.clone()));
    code.open();
    blend.layer(&mut code, builder, &met, linear);
    let layer = code.close();
    code.push_if(seen, layer);
    let block = code.close();
    code.push_loop(block);
    // What is left for the next round.
    code.open();
    blend.cut(&mut code, builder);
    let mut at = 0;
    for (var, ty) in &carried {
        for value in keep(*var, *ty) {
            code.store(memory, own.clone() + at, value);
            at += 1;
        }
    }
    code.return_nothing();
    let leave = code.close();
    let more = (round + 1u32).less(builder.frame(FrameValue::RoundCount));
    code.push_if(more, leave);
    let start = blend.note.start.clone();
    blend.stretch(&mut code, &start);
    match (&blend.numbers, blend.decode) {
        (Numbers::Encoded, Some(decode)) => blend.change(&mut code, decode, true),
        _ => blend.convert(&mut code, false),
    }
    blend.cut(&mut code, builder);
    let left_out = (list(1).bitcast(Prim::F32), list(2).bitcast(Prim::F32));
    let values = blend.values(&mut code, fields, left_out, media);
    let weight = (rays != Rays::One).then_some(&blend.note.weight);
    records::gather(builder, &mut code, (fields, values), (&record, stride), weight);
    (code.finish(None), floats)
}

/// A variable as f32.
fn keep(var: LocalId, ty: Ty) -> Vec<Expr> {
    match ty {
        Ty::BOOL => vec![Expr::Local(var).select(1.0, 0.0)],
        Ty::U32 => vec![Expr::Local(var).bitcast(Prim::F32)],
        ty => (0..components(ty)).map(|i| component(var.into(), ty, i)).collect(),
    }
}

/// Back from what `next` reads, one f32 after another.
fn restore(code: &mut Code, ty: Ty, next: &mut dyn FnMut(&mut Code) -> Expr) -> Expr {
    let parts: Vec<Expr> = (0..components(ty))
        .map(|_| {
            let value = next(code);
            code.bind("carried_over", Ty::F32, value)
        })
        .collect();
    match (ty, parts.as_slice()) {
        (Ty::BOOL, [only]) => only.clone().greater(0.5),
        (Ty::U32, [only]) => only.clone().bitcast(Prim::U32),
        (_, [only]) => only.clone(),
        (ty, _) => Expr::Compose(ty, parts),
    }
}

impl Blend<'_> {
    /// All that a round leaves for the next.
    fn carried(&self) -> Vec<(LocalId, Ty)> {
        let flag = match self.numbers {
            Numbers::Linear | Numbers::Encoded => None,
            Numbers::Either(flag) => Some((flag, Ty::BOOL)),
        };
        let scalars = [self.veiled, self.work, Some(self.here), self.part_of, self.most, self.most_encoded];
        let mut all = vec![(self.light, Ty::float(self.lw)), (self.fault, Ty::U32), (self.fault_at, Ty::VEC3)];
        all.extend(self.errors().map(|e| (e, Ty::float(self.lw))));
        all.extend(self.depth.map(|d| (d, Ty::float(self.dw))));
        all.extend(flag);
        all.extend(scalars.into_iter().flatten().map(|v| (v, Ty::F32)));
        all
    }

    /// What lies behind everything.
    fn begin(&self, code: &mut Code, builder: &KernelBuilder) {
        let (pieces, note) = (self.pieces, &self.note);
        let mut arguments = vec![note.origin.clone(), note.direction.clone(), note.start.clone()];
        if pieces.place(Part::Fault).is_some() {
            arguments.push(Expr::F32(0.0).splat(3));
        }
        for (part, ty) in &pieces.parts {
            arguments.push(match part {
                Part::Light | Part::Depth => Expr::F32(0.0).splat(components(*ty)),
                Part::Error | Part::Rounding => Expr::F32(0.0),
                Part::Work | Part::Fault => Expr::U32(0),
            });
        }
        let whole = builder.result_of(pieces.whole.function);
        let whole = code.bind("behind", whole, Expr::Call(pieces.whole.function, arguments));
        let found = |kind: OutputKind| {
            let place = pieces.whole.fields.iter().position(|f| f.0 == kind)?;
            Some((whole.clone().field(place as u32), pieces.whole.fields[place].1))
        };
        if let Some((value, width)) = found(OutputKind::Radiance) {
            code.set(self.light, fitted(value, width, self.lw));
        }
        if let (Some(error), Some(rounding), Some((value, _))) = (self.error, self.rounding, found(OutputKind::Error)) {
            let rounded = found(OutputKind::Rounding).map_or(Expr::F32(0.0), |(value, _)| value);
            code.set(error, (value - rounded.clone()).max(0.0).splat(self.lw));
            code.set(rounding, rounded.splat(self.lw));
        }
        if let (Some(work), Some((value, _))) = (self.work, found(OutputKind::Evaluations)) {
            code.set(work, value);
        }
        if let Some((value, _)) = found(OutputKind::Fault) {
            let value = code.bind("fault_behind", Ty::float(4), value);
            code.set(self.fault, value.clone().component(0).bitcast(Prim::U32));
            let at = (1..4).map(|i| value.clone().component(i)).collect();
            code.set(self.fault_at, Expr::Compose(Ty::VEC3, at));
        }
        if let Some(most) = self.most {
            code.set(most, largest(&self.light.into(), self.lw));
        }
        if let (Numbers::Encoded, Some(encode)) = (&self.numbers, self.encode) {
            self.change(code, encode, false);
        }
    }

    /// Notices a driver that has ended loops.
    fn cut(&self, code: &mut Code, builder: &mut KernelBuilder) {
        let cut = cut_short(builder, code);
        code.if_(cut, |code| code.set(self.fault, Fault::CUT_SHORT));
    }

    /// The media behind a splat, and the splat over it.
    fn layer(&self, code: &mut Code, builder: &mut KernelBuilder, met: &Met, linear: bool) {
        if let Some(part_of) = self.part_of {
            // From where the media begin to the farthest splat.
            let low = builder.frame(FrameValue::BoundsLow);
            let high = builder.frame(FrameValue::BoundsHigh);
            let arguments = vec![self.note.origin.clone(), self.note.direction.clone(), low, high];
            code.open();
            let span = code.bind("span", Ty::float(2), Expr::Call(self.pieces.through_box, arguments));
            let begin = span.clone().component(0).max(self.note.start.clone());
            let length = met.t.clone().min(span.component(1)) - begin;
            code.set(part_of, length.max(1e-30));
            let block = code.close();
            self.stretch(code, &met.t);
            code.push_if(Expr::Local(part_of).equal(0.0), block);
        } else {
            self.stretch(code, &met.t);
        }
        match self.numbers {
            Numbers::Linear | Numbers::Encoded => {}
            Numbers::Either(_) if !linear => self.convert(code, true),
            Numbers::Either(_) => {
                code.open();
                self.convert(code, true);
                let encoded = code.close();
                code.open();
                self.convert(code, false);
                let plain = code.close();
                code.push_if_else(met.encoded.clone(), encoded, plain);
            }
        }
        let footprints = builder.footprints();
        let first = code.bind("colors", Ty::U32, met.colors.clone());
        let parts: Vec<Expr> = (0..u32::from(self.lw))
            .map(|i| code.bind("color", Ty::F32, Expr::load(footprints, first.clone() + i)))
            .collect();
        let colors =
            if let [only] = parts.as_slice() { only.clone() } else { Expr::Compose(Ty::float(self.lw), parts) };
        let colors = code.bind("blended", Ty::float(self.lw), colors);
        let left = code.bind("left_through", Ty::F32, Expr::F32(1.0) - met.alpha.clone());
        let sum =
            colors.clone() * met.alpha.clone().splat(self.lw) + Expr::Local(self.light) * left.clone().splat(self.lw);
        // An α that is off moves the sum from what is behind towards the splat, or back.
        let moved = self.error.map(|_| {
            let apart = (colors.clone() - Expr::Local(self.light)).abs();
            let off = met.alpha.clone() * met.off.clone();
            code.bind("moved", Ty::float(self.lw), apart * off.splat(self.lw))
        });
        code.set(self.light, sum);
        for var in self.errors() {
            code.set(var, Expr::Local(var) * left.clone().splat(self.lw));
        }
        self.round(code, moved);
        let bright = largest(&colors, self.lw);
        match (self.most, self.most_encoded) {
            (Some(most), None) => code.set(most, Expr::Local(most).max(bright)),
            (Some(_), Some(encoded)) if !linear => code.set(encoded, Expr::Local(encoded).max(bright)),
            (Some(most), Some(encoded)) => {
                let bright = code.bind("bright", Ty::F32, bright);
                let zero = || Expr::F32(0.0);
                code.set(encoded, Expr::Local(encoded).max(met.encoded.clone().select(bright.clone(), zero())));
                code.set(most, Expr::Local(most).max(met.encoded.clone().select(zero(), bright)));
            }
            (None, _) => {}
        }
        if let Some(total) = self.veiled {
            let own = veiled(code, &met.alpha);
            code.set(total, (Expr::Local(total) + own).min(OPAQUE));
        }
    }

    /// The outputs, with what was left out of the list (the sum of its α, and its largest radiance) in the error.
    fn values(&self, code: &mut Code, fields: &[(OutputKind, u8)], left_out: (Expr, Expr), media: bool) -> Vec<Expr> {
        let depth = self.veiled.map(|veiled| {
            let all = match self.depth {
                Some(depth) => Expr::Local(depth) + Expr::Local(veiled).splat(self.dw),
                None => veiled.into(),
            };
            code.bind("depth_of_all", Ty::float(self.dw), all.min(Expr::F32(OPAQUE).splat(self.dw)))
        });
        let missing = self.most.map(|most| {
            let mut bright = Expr::Local(most).max(left_out.1.clone());
            if let (Some(encoded), Some(decode)) = (self.most_encoded, self.decode) {
                bright = bright.max(Expr::Call(decode, vec![encoded.into()]));
            }
            let gain = match (&self.numbers, media) {
                (Numbers::Linear, _) => 1.0,
                (Numbers::Encoded, _) | (Numbers::Either(_), false) => DECODED,
                (Numbers::Either(_), true) => THROUGH_DARK,
            };
            code.bind("missing", Ty::F32, left_out.0.clone() * bright * gain)
        });
        let missing = || missing.clone().expect("made where an error is told");
        let told = |var: Option<LocalId>| Expr::Local(var.expect("it is wanted"));
        let value = |(kind, width): &(OutputKind, u8)| match kind {
            OutputKind::Radiance => self.light.into(),
            OutputKind::Transmittance => fitted((-depth.clone().expect("it is wanted")).exp(), self.dw, *width),
            OutputKind::OpticalDepth => fitted(depth.clone().expect("it is wanted"), self.dw, *width),
            OutputKind::Error => largest(&(told(self.error) + told(self.rounding)), self.lw) + missing(),
            OutputKind::Rounding => largest(&told(self.rounding), self.lw),
            // What lists leave out.
            OutputKind::Storage => missing(),
            OutputKind::Evaluations => self.work.expect("it is wanted").into(),
            OutputKind::Fault => {
                let at = |i| Expr::Local(self.fault_at).component(i);
                let bits = Expr::Local(self.fault).bitcast(Prim::F32);
                Expr::Compose(Ty::float(4), vec![bits, at(0), at(1), at(2)])
            }
            OutputKind::Edge => self.note.edge.clone(),
        };
        fields.iter().map(value).collect()
    }
}
