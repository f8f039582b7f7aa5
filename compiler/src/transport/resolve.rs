//! `resolve`: what was drawn into the targets, with what lies behind the media, as records.

use super::aim::{Note, Rays};
use super::layers::{CUT_SHORT, Layers, components};
use super::records::{self, Pixel};
use super::slab::{Part, Pieces};
use super::trace::largest;
use crate::fields::{Code, KernelBuilder};
use crate::program::kernel::{Expr, Function, Prim, Ty};
use crate::program::{Fault, FrameValue, OutputKind, RaySource};

/// The entry point.
pub(crate) fn entry(
    builder: &mut KernelBuilder,
    pieces: &Pieces,
    layers: &Layers,
    (source, rays, edge): (RaySource, Rays, bool),
    (stride, blends): (u32, Option<FrameValue>),
) -> Function {
    let mut code = Code::new("resolve", None);
    let (record, place) = match source {
        RaySource::Camera => {
            let Pixel { record, .. } = records::pixel(builder, &mut code);
            (record, [Expr::GlobalId.component(0), Expr::GlobalId.component(1)])
        }
        RaySource::List => {
            let index = records::listed(builder, &mut code);
            (index.clone(), [index, Expr::U32(0)])
        }
    };
    let place = Expr::Compose(Ty::Value(Prim::I32, 2), place.map(|p| p.convert(Prim::I32)).into());
    let place = code.bind("place", Ty::Value(Prim::I32, 2), place);
    let texels: Vec<Expr> = (0..)
        .zip(&layers.targets)
        .map(|(i, target)| {
            let texture = builder.target(i, &target.name);
            let load = Expr::texture_load(texture, place.clone());
            code.bind(&format!("{}_texel", target.name), Ty::float(4), load)
        })
        .collect();
    let channel = |part: Part, component: u8| {
        let found = layers.channels.iter().zip(&texels).find_map(|(channels, texel)| {
            let at = channels.iter().position(|c| *c == (part, component))?;
            Some(texel.clone().component(at as u8))
        });
        found.expect("every part of a slab has its channel")
    };
    let note = Note::read(builder, &mut code, &record);
    let mut arguments = vec![note.origin.clone(), note.direction.clone(), note.start.clone()];
    let fault = pieces.place(Part::Fault).map(|_| {
        let packed = code.bind("packed", Ty::F32, channel(Part::Fault, 0));
        let (number, slab) = layers.fault(builder, &mut code, &packed);
        let t = note.first.clone() + (slab + 0.5) * note.step.clone();
        let at = note.origin.clone() + note.direction.clone() * t.splat(3);
        arguments.push(code.bind("fault_at", Ty::VEC3, at));
        let code_of = code.bind("fault_code", Ty::U32, number.convert(Prim::U32));
        code_of.clone().greater_equal(CUT_SHORT).select(Fault::CUT_SHORT, code_of)
    });
    let mut sums = vec![];
    for (part, ty) in &pieces.parts {
        let sum = match part {
            Part::Light | Part::Depth => {
                let read = |i| layers.read(builder, *part, channel(*part, i));
                let parts: Vec<Expr> = (0..components(*ty)).map(read).collect();
                if let [only] = parts.as_slice() { only.clone() } else { Expr::Compose(*ty, parts) }
            }
            Part::Error | Part::Rounding => layers.read(builder, *part, channel(*part, 0)),
            Part::Work => channel(*part, 0).convert(Prim::U32),
            Part::Fault => fault.clone().expect("made above"),
        };
        sums.push(code.bind(&format!("all_{}", part.name()), *ty, sum));
    }
    arguments.extend(sums.iter().cloned());
    let whole = builder.result_of(pieces.whole.function);
    let whole = code.bind("traced", whole, Expr::Call(pieces.whole.function, arguments));
    let mut values: Vec<Expr> = (0..pieces.whole.fields.len() as u32).map(|i| whole.clone().field(i)).collect();
    let mut fields = pieces.whole.fields.clone();
    let place = |kind| fields.iter().position(|f: &(OutputKind, u8)| f.0 == kind);
    let told = place(OutputKind::Error).zip(place(OutputKind::Radiance));
    if let (Some((error, radiance)), Some(blends)) = (told, blends) {
        let count = code.bind("blends", Ty::F32, builder.frame(blends).convert(Prim::F32));
        let most = |part: Part| {
            let at = pieces.place(part)? as usize;
            Some(largest(sums[at].clone().abs(), components(pieces.parts[at].1)))
        };
        let (light, depth) = (most(Part::Light), most(Part::Depth));
        let behind = match pieces.place(Part::Light) {
            Some(own) => values[radiance].clone() - sums[own as usize].clone(),
            None => values[radiance].clone(),
        };
        let behind = largest(behind.abs(), fields[radiance].1);
        let rounded = layers.rounding(builder, &count, light, (behind, depth));
        let rounded = code.bind("blending_error", Ty::F32, rounded);
        values[error] = values[error].clone() + rounded.clone();
        let summed = pieces.place(Part::Error).map(|at| (sums[at as usize].clone(), channel(Part::Error, 0)));
        let (kind, more) = layers.blending(builder, summed);
        if let Some(at) = place(kind) {
            let own = values[at].clone() + rounded;
            values[at] = match more {
                Some(more) => own + more,
                None => own,
            };
        }
    }
    if edge {
        values.push(note.edge.clone());
        fields.push((OutputKind::Edge, 1));
    }
    let weight = (rays != Rays::One).then_some(&note.weight);
    records::gather(builder, &mut code, (&fields, values), (&record, stride), weight);
    code.finish(None)
}
