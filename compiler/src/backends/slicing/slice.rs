//! `outline` and `slice`: the polygons of slabs, and what a slab sends and lets through at a pixel.

use super::aim::Note;
use crate::fields::{Code, KernelBuilder};
use crate::program::kernel::{Carries, Expr, Function, Prim, Ty};
use crate::program::{Blend, FrameValue, Target};
use crate::transport::slab::{Part, Slabs};

/// A fault as a number that f32 holds exactly: its code, at most 255, times this, and the number of the slab.
pub(super) const FAULT: f64 = 65536.0;
/// Stands for [`crate::program::Fault::CUT_SHORT`].
pub(super) const CUT_SHORT: u32 = 255;

/// Which number of a slab goes into which channel of which target.
pub(super) struct Layers {
    pub(super) targets: Vec<Target>,
    /// Of each target, what its channels hold: a part and its component. The fourth of a target of light is for the
    /// transmittance that it fades by.
    pub(super) channels: Vec<Vec<(Part, u8)>>,
}

impl Layers {
    pub(super) fn new(slabs: &Slabs) -> Self {
        let width = |part| slabs.place(part).map_or(0, |i| components(slabs.parts[i as usize].1));
        let (light, depth) = (width(Part::Light), width(Part::Depth));
        let mut layers = Self { targets: vec![], channels: vec![] };
        let all: Vec<u8> = (0..light).collect();
        // A target fades by one transmittance: bands that fade alike share one.
        for bands in all.chunks(if depth > 1 { 1 } else { 3 }) {
            let name = match (depth, bands) {
                (0 | 1, [0, ..]) => "light".to_owned(),
                (_, bands) => format!("light_{}", bands[0]),
            };
            let channels = bands.iter().map(|b| (Part::Light, *b)).collect();
            layers.push(name, Blend::Over, channels);
        }
        let sums = (0..depth).map(|b| (Part::Depth, b));
        let sums = sums.chain([Part::Work, Part::Error].into_iter().filter(|p| width(*p) > 0).map(|p| (p, 0)));
        let sums: Vec<_> = sums.collect();
        for (i, part) in sums.chunks(4).enumerate() {
            layers.push(if i == 0 { "sums".into() } else { "more_sums".into() }, Blend::Add, part.to_vec());
        }
        if width(Part::Fault) > 0 {
            layers.push("faults".into(), Blend::Max, vec![(Part::Fault, 0)]);
        }
        if layers.targets.is_empty() {
            layers.push("nothing".into(), Blend::Add, vec![]);
        }
        layers
    }

    fn push(&mut self, name: String, blend: Blend, channels: Vec<(Part, u8)>) {
        let count = match channels.len() {
            0 | 1 => 1,
            2 => 2,
            _ => 4,
        };
        self.targets.push(Target { name, channels: count, blend });
        self.channels.push(channels);
    }
}

/// Components of a value.
pub(super) fn components(ty: Ty) -> u8 {
    match ty {
        Ty::Value(_, width) => width,
        Ty::Struct(_) => 0,
    }
}

/// A component of a part that may have one only.
pub(super) fn component(value: Expr, ty: Ty, i: u8) -> Expr {
    if components(ty) > 1 { value.component(i) } else { value }
}

/// The entry points of corners and of pixels.
pub(super) fn entries(builder: &mut KernelBuilder, slabs: &Slabs, layers: &Layers) -> (Function, Function) {
    let fields = vec![("position".to_owned(), Ty::float(4)), ("slab".to_owned(), Ty::U32)];
    let corner = builder.add_carrier("Corner", Carries::Varyings, fields);
    let fields = layers.targets.iter().map(|t| (t.name.clone(), Ty::float(4))).collect();
    let colors = builder.add_carrier("Colors", Carries::Colors, fields);
    (outline(builder, corner), slice(builder, slabs, layers, (corner, colors)))
}

fn outline(builder: &mut KernelBuilder, corner: Ty) -> Function {
    let mut code = Code::new("outline", None);
    let outlines = builder.outlines();
    let base = code.bind("base", Ty::U32, Expr::VertexIndex * 3u32);
    let at = |i: u32| Expr::Load(outlines, Box::new(base.clone() + i));
    let origin = builder.frame(FrameValue::TileOrigin).convert(Prim::F32);
    let size = builder.frame(FrameValue::TileSize).convert(Prim::F32);
    let origin = code.bind("origin", Ty::float(2), origin);
    let size = code.bind("size", Ty::float(2), size);
    let along = |i: u32| (at(i) - origin.clone().component(i as u8)) / size.clone().component(i as u8) * 2.0;
    let x = code.bind("x", Ty::F32, along(0) - 1.0);
    let y = code.bind("y", Ty::F32, Expr::F32(1.0) - along(1));
    let position = Expr::Compose(Ty::float(4), vec![x, y, Expr::F32(0.5), Expr::F32(1.0)]);
    let slab = at(2).convert(Prim::U32);
    code.return_(Expr::Compose(corner, vec![position, slab]));
    code.finish(Some(corner))
}

fn slice(builder: &mut KernelBuilder, slabs: &Slabs, layers: &Layers, (corner, colors): (Ty, Ty)) -> Function {
    let mut code = Code::new("slice", None);
    let corner = code.parameter("corner", corner);
    let place = corner.clone().field(0);
    let width = builder.frame(FrameValue::TileSize).component(0);
    let row = place.clone().component(1).convert(Prim::U32);
    let record = code.bind("record", Ty::U32, row * width + place.component(0).convert(Prim::U32));
    let note = Note::read(builder, &mut code, &record);
    let number = code.bind("number", Ty::F32, corner.field(1).convert(Prim::F32));
    // Neighbours compute the plane between them alike, so that nothing is left out or counted twice.
    let plane = |n: Expr| note.first.clone() + n * note.step.clone();
    let from = code.bind("from", Ty::F32, plane(number.clone()).max(note.start.clone()));
    let to = code.bind("to", Ty::F32, plane(number.clone() + 1.0).min(note.end.clone()));
    let clear = |layer: usize| match layers.targets[layer].blend {
        Blend::Over => Expr::Compose(Ty::float(4), [0.0, 0.0, 0.0, 1.0].map(Expr::F32).into()),
        Blend::Add | Blend::Max => Expr::F32(0.0).splat(4),
    };
    let vars: Vec<_> =
        layers.targets.iter().enumerate().map(|(i, t)| code.var(&t.name, Ty::float(4), clear(i))).collect();
    let there = to.clone().greater(from.clone()).and(note.weight.clone().greater(0.0));
    code.open();
    let arguments = vec![note.origin.clone(), note.direction.clone(), from, to];
    let value = code.bind("within", slabs.result, Expr::Call(slabs.slab, arguments));
    let part = |part: Part, i: u8| {
        let place = slabs.place(part)?;
        Some(component(value.clone().field(place), slabs.parts[place as usize].1, i))
    };
    for (layer, var) in vars.iter().enumerate() {
        let mut parts = vec![Expr::F32(0.0); 4];
        for (slot, (kind, i)) in parts.iter_mut().zip(&layers.channels[layer]) {
            let Some(value) = part(*kind, *i) else { continue };
            *slot = match kind {
                Part::Light | Part::Depth | Part::Error => value,
                Part::Work => value.convert(Prim::F32),
                Part::Fault => {
                    let code_of = Expr::Math(crate::program::kernel::Math::Min, vec![value.clone(), CUT_SHORT.into()]);
                    value.greater(0u32).select(code_of.convert(Prim::F32) * FAULT + number.clone(), 0.0)
                }
            };
        }
        if layers.targets[layer].blend == Blend::Over {
            let band = layers.channels[layer].first().map_or(0, |c| c.1);
            parts[3] = part(Part::Depth, band).map_or(Expr::F32(1.0), |depth| (-depth).exp());
        }
        code.set(*var, Expr::Compose(Ty::float(4), parts));
    }
    let body = code.close();
    code.push_if(there, body);
    code.return_(Expr::Compose(colors, vars.into_iter().map(Expr::Local).collect()));
    code.finish(Some(colors))
}
