//! `plant`, `rank`, `corner` and `splat`: what the Gaussians of the lattice are, their order, their billboards, and what one sends and
//! lets through at a pixel.

use super::{doubt, sort};
use crate::fields::{Code, KernelBuilder};
use crate::ir::{FieldScene, Projection};
use crate::program::kernel::{Carries, Expr, Function, Math, Prim, Ty};
use crate::program::{FrameValue, RaySource, SortPass};
use crate::transport::aim::Note;
use crate::transport::layers::{Layers, components};
use crate::transport::records;
use crate::transport::slab::{Part, Pieces};

/// Deviation of a Gaussian in spacings.
const WIDTH: f64 = 0.8;
/// A mean over a cube, over the peak of a Gaussian that holds as much: (2π)^(3/2)·κ³.
pub(super) const PEAK: f64 = 8.063_859_777_395_3;
/// Deviations at which a billboard ends. Beyond lies e^(−R²/2) of a Gaussian's share of an optical depth: [`crate::program::SPLAT_CUT`].
const REACH: f64 = 4.5;

/// The coefficients of a node: which parts of a piece they make, and their types, in the order of memory.
pub(super) fn kept(pieces: &Pieces) -> impl Iterator<Item = (Part, Ty)> + '_ {
    pieces.parts.iter().copied().filter(|p| matches!(p.0, Part::Light | Part::Depth))
}

/// f32 of all of them.
pub(super) fn coefficients(pieces: &Pieces) -> u32 {
    kept(pieces).map(|p| u32::from(components(p.1))).sum()
}

/// Which node along each axis.
pub(super) fn index(builder: &mut KernelBuilder, code: &mut Code, number: &Expr) -> [Expr; 3] {
    let counts = builder.frame(FrameValue::LatticeCounts);
    let (nx, ny) = (counts.clone().component(0), counts.component(1));
    let row = code.bind("row_number", Ty::U32, number.clone() / nx.clone());
    let x = number.clone() - row.clone() * nx;
    let z = code.bind("layer_number", Ty::U32, row.clone() / ny.clone());
    let y = row - z.clone() * ny;
    [x, y, z]
}

/// The place of a node.
pub(super) fn node(builder: &mut KernelBuilder, code: &mut Code, number: &Expr) -> Expr {
    let index = index(builder, code, number).map(|i| i.convert(Prim::F32)).into();
    let index = code.bind("node_index", Ty::VEC3, Expr::Compose(Ty::VEC3, index));
    let low = builder.frame(FrameValue::LatticeLow);
    let spacing = builder.frame(FrameValue::LatticeSpacing);
    code.bind("center", Ty::VEC3, low + index * spacing.splat(3))
}

/// The direction in which a node is seen.
pub(super) fn along(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    code: &mut Code,
    (rays, center): (RaySource, &Expr),
) -> Expr {
    let along = match (rays, scene.camera.projection) {
        (RaySource::List, _) => builder.frame(FrameValue::CameraForward),
        (RaySource::Camera, Projection::Perspective { .. }) => {
            let plane = builder.frame(FrameValue::CameraPlane);
            let from = center.clone() - builder.frame(FrameValue::CameraAnchor);
            let from = from + builder.frame(FrameValue::CameraForward) * plane.splat(3);
            // A node in the eye has no direction.
            let from = code.bind("from_eye", Ty::VEC3, from);
            let length = Expr::math(Math::Length, [from.clone()]).max(1e-30);
            from / length.splat(3)
        }
        (RaySource::Camera, Projection::Orthographic { .. } | Projection::Panorama) => {
            builder.frame(FrameValue::CameraForward)
        }
    };
    code.bind("along", Ty::VEC3, along)
}

/// The entry point that finds what is at the nodes.
pub(super) fn plant(scene: &FieldScene, builder: &mut KernelBuilder, pieces: &Pieces, rays: RaySource) -> Function {
    let mut code = Code::new("plant", None);
    let number = records::numbered(builder, &mut code);
    let center = node(builder, &mut code, &number);
    let along = along(scene, builder, &mut code, (rays, &center));
    let spacing = builder.frame(FrameValue::LatticeSpacing);
    let origin = center - along.clone() * (spacing.clone() * 0.5).splat(3);
    let origin = code.bind("origin", Ty::VEC3, origin);
    let arguments = vec![origin, along, Expr::F32(0.0), spacing.clone()];
    let value = code.bind("stretch", pieces.result, Expr::Call(pieces.piece, arguments));
    let parts = kept(pieces).filter_map(|p| pieces.place(p.0)).map(|place| value.clone().field(place));
    let arguments = parts.chain([spacing]).collect();
    let value = code.bind("mean", pieces.result, Expr::Call(pieces.means, arguments));
    let splats = builder.splats();
    let base = code.bind("base", Ty::U32, number * doubt::stride(pieces));
    let mut offset = 0u32;
    for (part, ty) in kept(pieces) {
        let place = pieces.place(part).expect("it is a part");
        let mean = value.clone().field(place) * Expr::F32(1.0 / PEAK).splat(components(ty));
        let mean = code.bind("peak", ty, mean);
        for i in 0..components(ty) {
            let component = if components(ty) == 1 { mean.clone() } else { mean.clone().component(i) };
            // By bits, since shaders may assume that there is no NaN: only finite numbers ≥ +0 are at most 7f7fffff.
            let component = code.bind("component", Ty::F32, component);
            let fine = component.clone().bitcast(Prim::U32).less_equal(0x7f7f_ffffu32);
            code.store(splats, base.clone() + offset, fine.select(component, 0.0));
            offset += 1;
        }
    }
    code.finish(None)
}

/// Reads what is known of a node, from some of its numbers on: one value for each of these types.
pub(super) fn read(
    code: &mut Code,
    (buffer, base): (u32, &Expr),
    from: u32,
    types: impl Iterator<Item = Ty>,
) -> Vec<Expr> {
    let mut offset = from;
    let mut out = vec![];
    for ty in types {
        let parts: Vec<Expr> = (0..u32::from(components(ty)))
            .map(|i| {
                let load = Expr::load(buffer, base.clone() + (offset + i));
                code.bind("coefficient", Ty::F32, load)
            })
            .collect();
        offset += u32::from(components(ty));
        out.push(if let [only] = parts.as_slice() { only.clone() } else { Expr::Compose(ty, parts) });
    }
    out
}

/// The entry points of corners and of pixels.
pub(super) fn entries(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    pieces: &Pieces,
    layers: &Layers,
    rays: RaySource,
) -> (Function, Function) {
    let fields = vec![("position".to_owned(), Ty::float(4)), ("node".to_owned(), Ty::U32)];
    let corner = builder.add_carrier("Corner", Carries::Varyings, fields);
    let colors = layers.colors(builder);
    let projection = match rays {
        RaySource::Camera => Some(scene.camera.projection),
        RaySource::List => None,
    };
    (corners(builder, projection, corner), splat(builder, pieces, layers, (corner, colors)))
}

/// The radius of the ball around a node beyond which nothing of it is drawn.
fn radius(builder: &mut KernelBuilder, code: &mut Code) -> Expr {
    let radius = builder.frame(FrameValue::LatticeSpacing) * (WIDTH * REACH);
    code.bind("radius", Ty::F32, radius)
}

/// The entry point that gives nodes their keys: by depth, the farthest first; last what holds nothing or lies behind the eye.
///
/// Depths are those of numbers of nodes, exact in f32, along the view. What rounding turns round lies within 1e-6 of the lattice's
/// length of being abreast, where either order is as good; the same lattice always has the same one.
pub(super) fn rank(scene: &FieldScene, builder: &mut KernelBuilder, pieces: &Pieces, rays: RaySource) -> Function {
    let mut code = Code::new("rank", None);
    let number = records::numbered(builder, &mut code);
    let splats = builder.splats_read();
    let base = code.bind("base", Ty::U32, number.clone() * doubt::stride(pieces));
    // Where the node holds nothing, its neighbours may say that it holds too little.
    let types = || kept(pieces).map(|p| p.1).chain(kept(pieces).map(|p| p.1));
    let values = read(&mut code, (splats, &base), 0, types());
    let mut largest = Expr::F32(0.0);
    for (value, ty) in values.into_iter().zip(types()) {
        for i in 0..components(ty) {
            let part = if components(ty) == 1 { value.clone() } else { value.clone().component(i) };
            largest = largest.max(part);
        }
    }
    let mut there = largest.greater(0.0);
    let forward = builder.frame(FrameValue::CameraForward);
    if rays == RaySource::Camera && scene.camera.projection != Projection::Panorama {
        let center = node(builder, &mut code, &number);
        let radius = radius(builder, &mut code);
        let way = center - builder.frame(FrameValue::CameraAnchor);
        let depth = way.dot(forward.clone()) + builder.frame(FrameValue::CameraPlane);
        there = there.and(depth.greater(-radius));
    }
    let index = index(builder, &mut code, &number).map(|i| i.convert(Prim::F32)).into();
    let depth = code.bind("depth", Ty::F32, Expr::Compose(Ty::VEC3, index).dot(forward));
    // −0 would come before 0.
    let key = sort::key(&mut code, Expr::F32(0.0) - depth);
    let keys = builder.keys();
    code.store(keys, number, there.select(key, SortPass::LAST));
    code.finish(None)
}

/// Two triangles around what the picture shows of a ball of `REACH` deviations; around all of it when the eye is inside.
fn corners(builder: &mut KernelBuilder, projection: Option<Projection>, corner: Ty) -> Function {
    let mut code = Code::new("corner", None);
    let order = builder.order();
    let number = code.bind("node", Ty::U32, Expr::load(order, Expr::InstanceIndex));
    let there = code.var("there", Ty::BOOL, Expr::Bool(true));
    let low = code.var("low", Ty::float(2), Expr::F32(-1.0).splat(2));
    let high = code.var("high", Ty::float(2), Expr::F32(1.0).splat(2));
    if let Some(projection) = projection {
        let center = node(builder, &mut code, &number);
        let radius = radius(builder, &mut code);
        let way = code.bind("way", Ty::VEC3, center - builder.frame(FrameValue::CameraAnchor));
        let right = builder.frame(FrameValue::CameraRight);
        let up = builder.frame(FrameValue::CameraUp);
        let forward = builder.frame(FrameValue::CameraForward);
        let plane = builder.frame(FrameValue::CameraPlane);
        let depth = code.bind("depth", Ty::F32, way.clone().dot(forward) + plane);
        let size = builder.frame(FrameValue::ImageSize).convert(Prim::F32);
        let size = code.bind("size", Ty::float(2), size);
        let aspect = size.clone().component(0) / size.clone().component(1);
        // The picture reaches from −aspect to aspect across, and from −1 to 1.
        let half = Expr::Compose(Ty::float(2), vec![aspect, Expr::F32(1.0)]);
        let half = code.bind("half", Ty::float(2), half);
        // A pixel more, for rays go through any point of a pixel.
        let margin = code.bind("margin", Ty::F32, Expr::F32(3.0) / size.component(1));
        code.open();
        let mut ends = [vec![], vec![]];
        for axis in [right, up] {
            let scale = code.bind("scale", Ty::F32, Expr::math(Math::Length, [axis.clone()]));
            let across = code.bind("across", Ty::F32, way.clone().dot(axis) / scale.clone());
            let (least, most) = match projection {
                Projection::Perspective { .. } => {
                    // Where planes through the eye touch the ball: (x·z ± r·√(x² + z² − r²)) / (z² − r²).
                    let room = depth.clone() * depth.clone() - radius.clone() * radius.clone();
                    let room = code.bind("room", Ty::F32, room.max(1e-30));
                    let root = (across.clone() * across.clone() + room.clone()).sqrt();
                    let root = code.bind("root", Ty::F32, root * radius.clone());
                    let middle = code.bind("middle", Ty::F32, across * depth.clone());
                    let denominator = code.bind("denominator", Ty::F32, room * scale);
                    let least = (middle.clone() - root.clone()) / denominator.clone();
                    (least, (middle + root) / denominator)
                }
                Projection::Orthographic { .. } | Projection::Panorama => {
                    let least = (across.clone() - radius.clone()) / scale.clone();
                    (least, (across + radius.clone()) / scale)
                }
            };
            ends[0].push(code.bind("least", Ty::F32, least - margin.clone()));
            ends[1].push(code.bind("most", Ty::F32, most + margin.clone()));
        }
        let [least, most] = ends.map(|e| Expr::Compose(Ty::float(2), e));
        let one = Expr::F32(1.0).splat(2);
        code.set(low, (least / half.clone()).max(-one.clone()));
        code.set(high, (most / half).min(one));
        let block = code.close();
        let outside = match projection {
            // In a ball that holds the eye, anything may be seen.
            Projection::Perspective { .. } => depth.clone().greater(radius.clone() * 1.01),
            Projection::Orthographic { .. } | Projection::Panorama => Expr::Bool(true),
        };
        code.push_if(outside, block);
        let seen = |i| Expr::Local(high).component(i).greater(Expr::Local(low).component(i));
        code.set(there, seen(0).and(seen(1)));
    }
    // Corners 0 1 2 and 3 4 5 of the two triangles.
    let index = Expr::VertexIndex;
    let is = |n: u32| index.clone().equal(n);
    let at_right = code.bind("at_right", Ty::BOOL, is(1).or(is(2)).or(is(4)));
    let at_top = code.bind("at_top", Ty::BOOL, is(2).or(is(4)).or(is(5)));
    let x = at_right.select(Expr::Local(high).component(0), Expr::Local(low).component(0));
    let y = at_top.select(Expr::Local(high).component(1), Expr::Local(low).component(1));
    // From the picture to the tile.
    let (x, y) = match projection {
        None => (x, y),
        Some(_) => {
            let origin = builder.frame(FrameValue::TileOrigin).convert(Prim::F32);
            let tile = builder.frame(FrameValue::TileSize).convert(Prim::F32);
            let picture = builder.frame(FrameValue::ImageSize).convert(Prim::F32);
            let origin = code.bind("tile_from", Ty::float(2), origin);
            let tile = code.bind("tile", Ty::float(2), tile);
            let picture = code.bind("picture", Ty::float(2), picture);
            let part = |v: &Expr, i: u8| v.clone().component(i);
            let px = (x + 1.0) * 0.5 * part(&picture, 0) - part(&origin, 0);
            let py = (Expr::F32(1.0) - y) * 0.5 * part(&picture, 1) - part(&origin, 1);
            (px / part(&tile, 0) * 2.0 - 1.0, Expr::F32(1.0) - py / part(&tile, 1) * 2.0)
        }
    };
    let shown = |v: Expr| Expr::Local(there).select(v, -2.0);
    let parts = vec![shown(x), shown(y), Expr::F32(0.5), Expr::F32(1.0)];
    let position = code.bind("position", Ty::float(4), Expr::Compose(Ty::float(4), parts));
    code.return_(Expr::Compose(corner, vec![position, number]));
    code.finish(Some(corner))
}

fn splat(builder: &mut KernelBuilder, pieces: &Pieces, layers: &Layers, (corner, colors): (Ty, Ty)) -> Function {
    let mut code = Code::new("splat", None);
    let corner = code.parameter("corner", corner);
    let place = corner.clone().field(0);
    let width = builder.frame(FrameValue::TileSize).component(0);
    let row = place.clone().component(1).convert(Prim::U32);
    let record = code.bind("record", Ty::U32, row * width + place.component(0).convert(Prim::U32));
    let note = Note::read(builder, &mut code, &record);
    let number = code.bind("number", Ty::U32, corner.field(1));
    let center = node(builder, &mut code, &number);
    let way = code.bind("way", Ty::VEC3, center - note.origin.clone());
    let abreast = code.bind("abreast", Ty::F32, way.clone().dot(note.direction.clone()));
    let foot = code.bind("foot", Ty::VEC3, way - note.direction.clone() * abreast.clone().splat(3));
    let deviation = builder.frame(FrameValue::LatticeSpacing) * WIDTH;
    let deviation = code.bind("deviation", Ty::F32, deviation);
    let distance = foot.clone().dot(foot) / (deviation.clone() * deviation.clone());
    let distance = code.bind("distance", Ty::F32, distance);
    let vars = layers.clear(&mut code);
    let share = share(&mut code, (&abreast, &deviation), &note);
    let there = distance.clone().less(REACH * REACH).and(share.clone().greater(0.0)).and(note.weight.greater(0.0));
    code.open();
    let length = (distance.clone() * -0.5).exp() * deviation * std::f64::consts::TAU.sqrt() * share;
    let length = code.bind("length", Ty::F32, length);
    let value = doubt::within(builder, &mut code, pieces, (&number, &length, &distance));
    layers.fill(builder, &mut code, pieces, &vars, (&value, &Expr::F32(0.0)));
    let body = code.close();
    code.push_if(there, body);
    code.return_(Expr::Compose(colors, vars.into_iter().map(Expr::Local).collect()));
    code.finish(Some(colors))
}

/// Which part of a Gaussian lies between the eye and where a surface ends the ray: Φ((end − t)/s) − Φ((start − t)/s).
fn share(code: &mut Code, (abreast, deviation): (&Expr, &Expr), note: &Note) -> Expr {
    let before = code.bind("before", Ty::F32, (note.start.clone() - abreast.clone()) / deviation.clone());
    let beyond = code.bind("beyond", Ty::F32, (note.end.clone() - abreast.clone()) / deviation.clone());
    let share = code.var("share", Ty::F32, Expr::F32(1.0));
    let cut = before.clone().greater(-REACH).or(beyond.clone().less(REACH));
    code.open();
    let part = normal(code, beyond) - normal(code, before);
    code.set(share, part.max(0.0));
    let body = code.close();
    code.push_if(cut, body);
    Expr::Local(share)
}

/// Φ, to 8e-8 (Abramowitz & Stegun 1964, 7.1.26, with erf(x/√2) = 2Φ(x) − 1).
fn normal(code: &mut Code, x: Expr) -> Expr {
    const POLYNOMIAL: [f64; 5] = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    let size =
        code.bind("size", Ty::F32, Expr::math(Math::Abs, [x.clone()]).min(8.0) * std::f64::consts::FRAC_1_SQRT_2);
    let t = code.bind("t", Ty::F32, Expr::F32(1.0) / (size.clone() * 0.327_591_1 + 1.0));
    let mut sum = Expr::F32(0.0);
    for c in POLYNOMIAL.into_iter().rev() {
        sum = sum * t.clone() + c;
    }
    let tail = sum * t * (-(size.clone() * size)).exp() * 0.5;
    let tail = code.bind("tail", Ty::F32, tail);
    x.greater(0.0).select(Expr::F32(1.0) - tail.clone(), tail)
}
