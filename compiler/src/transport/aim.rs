//! `aim`: the ray of each pixel, where it ends, and where it meets the planes.

use super::records::{self, Pixel};
use super::slab::Pieces;
use super::{Scene, edges, rays};
use crate::fields::{Code, KernelBuilder};
use crate::ir::{FieldScene, Stacks};
use crate::program::kernel::{BinaryOp, Expr, Function, Prim, Ty};
use crate::program::{FrameValue, RaySource};

/// f32 of a ray's note.
pub(crate) const NOTES: u32 = 12;

/// Least cosine between a ray and what it crosses planes along.
const LEAST_FACING: f64 = 1e-6;

/// The rays through a pixel, one after another.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(crate) enum Rays {
    /// Through its centre, or one of a list.
    One,
    /// At as many points of it.
    Spread(u32),
    /// Two, on the two sides of an edge, weighed by what they cover.
    Divided,
}

impl Rays {
    /// From the samples of a pixel, and whether edges divide it.
    pub(crate) fn new(samples: u32, divided: bool) -> Self {
        match (samples, divided) {
            (_, true) => Self::Divided,
            (1, false) => Self::One,
            (n, false) => Self::Spread(n),
        }
    }

    /// How many.
    pub(crate) fn count(self) -> u32 {
        match self {
            Self::One => 1,
            Self::Spread(n) => n,
            Self::Divided => 2,
        }
    }
}

/// What passes after `aim` want to know of a ray besides.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(crate) enum Aimed {
    /// Where it meets the planes of slabs.
    Planes(Stacks),
    /// Which point of the picture it goes through.
    Point,
}

/// A ray as it is noted.
pub(crate) struct Note {
    pub(crate) origin: Expr,
    pub(crate) direction: Expr,
    /// Least t that counts.
    pub(crate) start: Expr,
    /// Where a surface ends it.
    pub(crate) end: Expr,
    /// t of the first plane, and from plane to plane; or the point of the picture, in pixels.
    pub(crate) first: Expr,
    pub(crate) step: Expr,
    /// Share of the pixel.
    pub(crate) weight: Expr,
    /// 1 where an edge divides the pixel, else 0.
    pub(crate) edge: Expr,
}

impl Note {
    /// Reads it back.
    pub(crate) fn read(builder: &mut KernelBuilder, code: &mut Code, record: &Expr) -> Self {
        let notes = builder.notes_read();
        let base = code.bind("note", Ty::U32, record.clone() * NOTES);
        let mut at = |name: &str, i: u32| code.bind(name, Ty::F32, Expr::load(notes, base.clone() + i));
        let origin = [at("origin_x", 0), at("origin_y", 1), at("origin_z", 2)];
        let start = at("start", 3);
        let direction = [at("direction_x", 4), at("direction_y", 5), at("direction_z", 6)];
        let (end, first, step) = (at("end", 7), at("first", 8), at("step", 9));
        let (weight, edge) = (at("weight", 10), at("edge", 11));
        let three = |parts: [Expr; 3]| Expr::Compose(Ty::VEC3, parts.into());
        let origin = code.bind("origin", Ty::VEC3, three(origin));
        let direction = code.bind("direction", Ty::VEC3, three(direction));
        Self { origin, direction, start, end, first, step, weight, edge }
    }

    fn write(self, builder: &mut KernelBuilder, code: &mut Code, record: &Expr) {
        let notes = builder.notes();
        let base = code.bind("note", Ty::U32, record.clone() * NOTES);
        let part = |v: &Expr, i: u8| v.clone().component(i);
        let (o, d) = (&self.origin, &self.direction);
        let values = [
            [part(o, 0), part(o, 1), part(o, 2), self.start],
            [part(d, 0), part(d, 1), part(d, 2), self.end],
            [self.first, self.step, self.weight, self.edge],
        ];
        for (i, value) in (0..).zip(values.into_iter().flatten()) {
            code.store(notes, base.clone() + i, value);
        }
    }
}

/// The entry point.
pub(crate) fn entry(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    seen: &Scene,
    pieces: &Pieces,
    source: RaySource,
    (rays, aimed): (Rays, Aimed),
) -> Function {
    match source {
        RaySource::Camera => camera(scene, builder, seen, pieces, (rays, aimed)),
        RaySource::List => list(builder, pieces, aimed),
    }
}

fn camera(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    seen: &Scene,
    pieces: &Pieces,
    (rays, aimed): (Rays, Aimed),
) -> Function {
    let mut code = Code::new("aim", None);
    let Pixel { x, y, record } = records::pixel(builder, &mut code);
    let camera = rays::Camera::new(builder, scene.camera.projection);
    let centre = |code: &mut Code| {
        (code.bind("center_x", Ty::F32, x.clone() + 0.5), code.bind("center_y", Ty::F32, y.clone() + 0.5))
    };
    let mut edge = Expr::F32(0.0);
    let ((at_x, at_y), weight) = match rays {
        Rays::One => (centre(&mut code), Expr::F32(1.0)),
        Rays::Spread(n) => {
            let number = builder.frame(FrameValue::Repeat).convert(Prim::F32);
            let (dx, dy) = rays::sample_offset(&mut code, number, n);
            ((x.clone() + dx, y.clone() + dy), Expr::F32(1.0 / f64::from(n)))
        }
        Rays::Divided => {
            let centre = centre(&mut code);
            match edges::divide(&scene.graph, builder, &mut code, &camera, seen.primitives(), centre.clone()) {
                None => (centre, Expr::F32(1.0)),
                Some(edges::Division { covered, inner, outer, divided }) => {
                    let second = Expr::binary(BinaryOp::NotEqual, builder.frame(FrameValue::Repeat), 0u32);
                    let second = code.bind("second", Ty::BOOL, second);
                    edge = divided.select(1.0, 0.0);
                    let at_x = centre.0 + second.clone().select(outer.0, inner.0);
                    let at_y = centre.1 + second.clone().select(outer.1, inner.1);
                    ((at_x, at_y), second.select(Expr::F32(1.0) - covered.clone(), covered))
                }
            }
        }
    };
    let ray = camera.ray(&mut code, "ray", at_x.clone(), at_y.clone());
    let end = pieces.end(&mut code, &ray.origin, &ray.direction, &ray.from);
    let (first, step) = match aimed {
        Aimed::Planes(Stacks::Object | Stacks::HalfAngle) => {
            let normal = code.bind("normal", Ty::VEC3, builder.frame(FrameValue::SlabNormal));
            let off = ray.origin.clone() - builder.frame(FrameValue::CameraAnchor);
            let start = builder.frame(FrameValue::SlabStart) - off.dot(normal.clone());
            // A ray along the planes stays between two of them; one that goes against them meets them the other way round.
            let facing = code.bind("along_normal", Ty::F32, ray.direction.clone().dot(normal));
            let least = facing.clone().less(0.0).select(-LEAST_FACING, LEAST_FACING);
            let facing = facing.clone().abs().less(LEAST_FACING).select(least, facing);
            let facing = code.bind("facing", Ty::F32, facing);
            (start / facing.clone(), builder.frame(FrameValue::SlabStep) / facing)
        }
        Aimed::Planes(Stacks::View) => {
            // Planes are counted from the anchor, where the ray's parameter is 0: thicker along rays off the axis.
            let facing = ray.direction.clone().dot(builder.frame(FrameValue::CameraForward));
            let facing = code.bind("facing", Ty::F32, facing);
            (builder.frame(FrameValue::SlabStart) / facing.clone(), builder.frame(FrameValue::SlabStep) / facing)
        }
        Aimed::Point => (at_x, at_y),
    };
    let rays::Start { origin, direction, from } = ray;
    Note { origin, direction, start: from, end, first, step, weight, edge }.write(builder, &mut code, &record);
    code.finish(None)
}

/// Rays of a list have no common planes: each is cut into equal parts within the box around the media.
fn list(builder: &mut KernelBuilder, pieces: &Pieces, aimed: Aimed) -> Function {
    let mut code = Code::new("aim", None);
    let index = records::listed(builder, &mut code);
    let ray = rays::list(builder, &mut code, &index);
    let end = pieces.end(&mut code, &ray.origin, &ray.direction, &ray.from);
    let (first, step) = match aimed {
        Aimed::Planes(_) => {
            let low = builder.frame(FrameValue::BoundsLow);
            let high = builder.frame(FrameValue::BoundsHigh);
            let arguments = vec![ray.origin.clone(), ray.direction.clone(), low, high];
            let span = code.bind("span", Ty::float(2), Expr::Call(pieces.through_box, arguments));
            let first = code.bind("first", Ty::F32, span.clone().component(0).max(ray.from.clone()));
            let length = (span.component(1).min(end.clone()) - first.clone()).max(0.0);
            (first, length / builder.frame(FrameValue::SlabCount).convert(Prim::F32))
        }
        Aimed::Point => (Expr::F32(0.0), Expr::F32(0.0)),
    };
    let rays::Start { origin, direction, from } = ray;
    let note = Note { origin, direction, start: from, end, first, step, weight: Expr::F32(1.0), edge: Expr::F32(0.0) };
    note.write(builder, &mut code, &index);
    code.finish(None)
}
