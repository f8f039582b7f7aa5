//! `outline` and `slice`: the polygons of slabs, and what a slab sends and lets through at a pixel.

use crate::fields::{Code, KernelBuilder};
use crate::ir::Stacks;
use crate::program::AGAINST;
use crate::program::FrameValue;
use crate::program::kernel::{BinaryOp, Carries, Expr, Function, Prim, Ty};
use crate::transport::aim::Note;
use crate::transport::half::LightSlabs;
use crate::transport::layers::Layers;
use crate::transport::slab::Pieces;

/// The entry points of corners and of pixels.
pub(super) fn entries(
    builder: &mut KernelBuilder,
    slabs: &Pieces,
    layers: &Layers,
    stacks: Stacks,
) -> (Function, Function) {
    let corner = corner(builder, "Corner");
    let colors = layers.colors(builder);
    let (origin, size) = (builder.frame(FrameValue::TileOrigin), builder.frame(FrameValue::TileSize));
    (outline(builder, "outline", corner, (origin, size)), slice(builder, slabs, layers, (corner, colors), stacks))
}

/// The same of what light loses in slabs.
pub(super) fn light_entries(builder: &mut KernelBuilder, slabs: &LightSlabs) -> (Function, Function) {
    let corner = corner(builder, "LightCorner");
    let fields = slabs.buffer.targets.iter().map(|t| (t.name.clone(), Ty::float(4))).collect();
    let colors = builder.add_carrier("LightColors", Carries::Colors, fields);
    let nodes = builder.frame(FrameValue::LightNodes);
    let origin = Expr::U32(0).splat(2);
    let outline = outline(builder, "light_outline", corner, (origin, nodes));
    let mut code = Code::new("light", None);
    let corner = code.parameter("corner", corner);
    let slab = code.bind("slab", Ty::F32, corner.clone().field(1).convert(Prim::F32));
    let texels = slabs.texels(builder, &mut code, (&corner.field(0), &slab));
    code.return_(Expr::Compose(colors, texels));
    (outline, code.finish(Some(colors)))
}

fn corner(builder: &mut KernelBuilder, name: &str) -> Ty {
    let fields = vec![("position".to_owned(), Ty::float(4)), ("slab".to_owned(), Ty::U32)];
    builder.add_carrier(name, Carries::Varyings, fields)
}

/// Corners on a canvas, from its origin and size in pixels.
fn outline(builder: &mut KernelBuilder, name: &str, corner: Ty, (origin, size): (Expr, Expr)) -> Function {
    let mut code = Code::new(name, None);
    let outlines = builder.outlines();
    let base = code.bind("base", Ty::U32, Expr::VertexIndex * 3u32);
    let at = |i: u32| Expr::load(outlines, base.clone() + i);
    let origin = code.bind("origin", Ty::float(2), origin.convert(Prim::F32));
    let size = code.bind("size", Ty::float(2), size.convert(Prim::F32));
    let along = |i: u32| (at(i) - origin.clone().component(i as u8)) / size.clone().component(i as u8) * 2.0;
    let x = code.bind("x", Ty::F32, along(0) - 1.0);
    let y = code.bind("y", Ty::F32, Expr::F32(1.0) - along(1));
    let position = Expr::Compose(Ty::float(4), vec![x, y, Expr::F32(0.5), Expr::F32(1.0)]);
    let slab = at(2).convert(Prim::U32);
    code.return_(Expr::Compose(corner, vec![position, slab]));
    code.finish(Some(corner))
}

fn slice(
    builder: &mut KernelBuilder,
    slabs: &Pieces,
    layers: &Layers,
    (corner, colors): (Ty, Ty),
    stacks: Stacks,
) -> Function {
    let mut code = Code::new("slice", None);
    let corner = code.parameter("corner", corner);
    let place = corner.clone().field(0);
    let width = builder.frame(FrameValue::TileSize).component(0);
    let row = place.clone().component(1).convert(Prim::U32);
    let record = code.bind("record", Ty::U32, row * width + place.component(0).convert(Prim::U32));
    let note = Note::read(builder, &mut code, &record);
    let number = match stacks {
        Stacks::View => corner.clone().field(1),
        Stacks::Object | Stacks::HalfAngle => Expr::binary(BinaryOp::BitAnd, corner.clone().field(1), AGAINST - 1),
    };
    let number = code.bind("number", Ty::F32, number.convert(Prim::F32));
    // Neighbours compute the plane between them alike, so that nothing is left out or counted twice.
    let plane = |n: Expr| note.first.clone() + n * note.step.clone();
    let ends = [plane(number.clone()), plane(number.clone() + 1.0)];
    let [near, far] = match stacks {
        Stacks::View => ends,
        Stacks::Object | Stacks::HalfAngle => {
            let [a, b] = ends.map(|end| code.bind("plane", Ty::F32, end));
            [a.clone().min(b.clone()), a.max(b)]
        }
    };
    let from = code.bind("from", Ty::F32, near.max(note.start.clone()));
    let to = code.bind("to", Ty::F32, far.min(note.end.clone()));
    let there = to.clone().greater(from.clone()).and(note.weight.clone().greater(0.0));
    let there = match stacks {
        Stacks::View => there,
        Stacks::Object | Stacks::HalfAngle => {
            // The farthest comes first along some rays, the nearest along others: each has its turn.
            let against = corner.field(1).greater_equal(AGAINST);
            there.and(Expr::binary(BinaryOp::Equal, against, note.step.clone().less(0.0)))
        }
    };
    let vars = layers.clear(&mut code);
    code.open();
    let mut arguments = vec![note.origin, note.direction, from, to];
    if slabs.light.is_some() {
        let plane = builder.frame(FrameValue::SlabStart) + number.clone() * builder.frame(FrameValue::SlabStep);
        arguments.push(code.bind("plane", Ty::F32, plane));
    }
    let value = code.bind("within", slabs.result, Expr::Call(slabs.piece, arguments));
    layers.fill(builder, &mut code, slabs, &vars, (&value, &number));
    let body = code.close();
    code.push_if(there, body);
    code.return_(Expr::Compose(colors, vars.into_iter().map(Expr::Local).collect()));
    code.finish(Some(colors))
}
