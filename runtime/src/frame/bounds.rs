//! A ball around the scene, for choosing where rays begin.

use super::Vec3;
use super::vector::{add, cross, dot, is_finite, length, scale, sub};
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{FieldScene, Medium, NodeId, Primitive, PrimitiveKind, Shape};

/// A ball that holds something.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Ball {
    /// Its centre, in the scene's units.
    pub center: Vec3,
    /// Its radius, in the scene's units.
    pub radius: f64,
}

impl Ball {
    /// A ball around both.
    fn with(self, other: Self) -> Self {
        let gap = sub(other.center, self.center);
        let distance = length(gap);
        if distance + other.radius <= self.radius {
            return self;
        }
        if distance + self.radius <= other.radius {
            return other;
        }
        let radius = (distance + self.radius + other.radius) / 2.0;
        Self { center: add(self.center, scale(gap, (radius - self.radius) / distance)), radius }
    }
}

/// A ball around every medium; `None` when one of them has no bounds that are easily seen, or there is none.
/// Params are in the graph's units.
#[must_use]
pub fn scene_bounds(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> Option<Ball> {
    let of = |nodes: &[NodeId]| evaluate_frame(&scene.graph, nodes, params, time);
    let balls: Option<Vec<Ball>> = scene.media.iter().map(|m| shape(&m.shape, &of)).collect();
    balls?.into_iter().reduce(Ball::with).filter(|b| b.radius > 0.0 && b.radius.is_finite())
}

/// A ball around the media that are bounded, whatever else there is.
#[must_use]
pub(crate) fn bounded_media(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> Option<Ball> {
    let of = |nodes: &[NodeId]| evaluate_frame(&scene.graph, nodes, params, time);
    let balls = scene.media.iter().filter_map(|m| shape(&m.shape, &of));
    balls.reduce(Ball::with).filter(|b| b.radius > 0.0 && b.radius.is_finite())
}

/// Centres and radii of the shells over which altitudes are measured, in the scene's units.
#[must_use]
pub(crate) fn shells(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> Vec<(Vec3, f64)> {
    let of = |(center, radius): &(NodeId, NodeId)| {
        let v = evaluate_frame(&scene.graph, &[*center, *radius], params, time);
        (three(&v[0]), v[1][0])
    };
    scene.shells.iter().map(of).collect()
}

type Evaluate<'a> = dyn Fn(&[NodeId]) -> Vec<Vec<f64>> + 'a;

fn shape(s: &Shape, of: &Evaluate<'_>) -> Option<Ball> {
    match s {
        Shape::Everywhere => None,
        Shape::Primitive(p) => primitive(p, of),
        Shape::Union(parts) => {
            let balls: Option<Vec<Ball>> = parts.iter().map(|p| shape(p, of)).collect();
            balls?.into_iter().reduce(Ball::with)
        }
        Shape::Intersection(parts) => {
            parts.iter().filter_map(|p| shape(p, of)).min_by(|a, b| a.radius.total_cmp(&b.radius))
        }
        Shape::Difference(first, _) => shape(first, of),
    }
}

fn primitive(p: &Primitive, of: &Evaluate<'_>) -> Option<Ball> {
    // A sphere is its own ball, not that of the cube around it.
    if let (PrimitiveKind::Sphere { center, radius } | PrimitiveKind::Shell { center, outer: radius, .. }, None) =
        (p.kind, p.from_world)
    {
        let v = of(&[center, radius]);
        return Some(Ball { center: three(&v[0]), radius: v[1][0] });
    }
    let corners = corners(p, of)?;
    let center = scale(corners.iter().copied().fold([0.0; 3], add), 0.125);
    let radius = corners.iter().map(|c| length(sub(*c, center))).fold(0.0, f64::max);
    (is_finite(center) && radius.is_finite()).then_some(Ball { center, radius })
}

/// Corners of a box around a primitive. Bits 0, 1 and 2 of a corner's number say on which side it is along the axes of the
/// primitive's own space.
fn corners(p: &Primitive, of: &Evaluate<'_>) -> Option<[Vec3; 8]> {
    // Middle and half the size of a box around it, in its own space.
    let (center, half) = match p.kind {
        PrimitiveKind::Sphere { center, radius } | PrimitiveKind::Shell { center, outer: radius, .. } => {
            let v = of(&[center, radius]);
            (three(&v[0]), [v[1][0]; 3])
        }
        PrimitiveKind::Ellipsoid { center, radii } => {
            let v = of(&[center, radii]);
            (three(&v[0]), three(&v[1]))
        }
        PrimitiveKind::Box { min, max } => {
            let v = of(&[min, max]);
            let (min, max) = (three(&v[0]), three(&v[1]));
            (scale(add(min, max), 0.5), scale(sub(max, min), 0.5))
        }
        PrimitiveKind::Cylinder { from, to, radius } => {
            let v = of(&[from, to, radius]);
            let (from, to) = (three(&v[0]), three(&v[1]));
            let reach = sub(to, from).map(|x| x.abs() / 2.0 + v[2][0]);
            (scale(add(from, to), 0.5), reach)
        }
        PrimitiveKind::Slab { .. } | PrimitiveKind::Sdf { .. } => return None,
    };
    let own =
        |i: usize| std::array::from_fn(|k| if i >> k & 1 == 0 { center[k] - half[k] } else { center[k] + half[k] });
    let Some(affine) = p.from_world else { return Some(std::array::from_fn(own)) };
    let [x, y, z] = affine.rows;
    let v = of(&[x, y, z, affine.offset]);
    let rows = [0, 1, 2].map(|i| three(&v[i]));
    // Columns of the inverse.
    let columns = [cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])];
    let determinant = dot(rows[0], columns[0]);
    let to_world = |p: Vec3| (0..3).fold([0.0; 3], |sum, i| add(sum, scale(columns[i], p[i] / determinant)));
    Some(std::array::from_fn(|i| to_world(sub(own(i), three(&v[3])))))
}

/// Corners of boxes that hold the bounded media, as [`corners`] numbers them; of media without an end, none.
#[must_use]
pub(super) fn media_boxes(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> Vec<[Vec3; 8]> {
    boxes_of(scene, &scene.media, (params, time))
}

/// The same of some media.
#[must_use]
pub(super) fn boxes_of<'a>(
    scene: &FieldScene,
    media: impl IntoIterator<Item = &'a Medium>,
    (params, time): (&[Vec<f64>], f64),
) -> Vec<[Vec3; 8]> {
    let of = |nodes: &[NodeId]| evaluate_frame(&scene.graph, nodes, params, time);
    let all = media.into_iter().filter_map(|m| boxes(&m.shape, &of)).flatten();
    all.filter(|corners| corners.iter().all(|c| is_finite(*c))).collect()
}

/// Lower and upper corner of a box around some media; nothing where one has no end, or there is none.
#[must_use]
pub(super) fn box_around<'a>(
    scene: &FieldScene,
    media: impl IntoIterator<Item = &'a Medium>,
    (params, time): (&[Vec<f64>], f64),
) -> Option<[Vec3; 2]> {
    let of = |nodes: &[NodeId]| evaluate_frame(&scene.graph, nodes, params, time);
    let all: Option<Vec<_>> = media.into_iter().map(|m| boxes(&m.shape, &of)).collect();
    let all: Vec<Vec3> = all?.into_iter().flatten().flatten().collect();
    let extreme =
        |pick: fn(f64, f64) -> f64| all.iter().copied().reduce(|a, b| std::array::from_fn(|k| pick(a[k], b[k])));
    let corners = [extreme(f64::min)?, extreme(f64::max)?];
    corners.iter().all(|c| is_finite(*c)).then_some(corners)
}

fn boxes(s: &Shape, of: &Evaluate<'_>) -> Option<Vec<[Vec3; 8]>> {
    match s {
        Shape::Everywhere => None,
        Shape::Primitive(p) => Some(vec![corners(p, of)?]),
        Shape::Union(parts) => {
            let all: Option<Vec<_>> = parts.iter().map(|p| boxes(p, of)).collect();
            Some(all?.into_iter().flatten().collect())
        }
        Shape::Intersection(parts) => {
            let bounded = parts.iter().filter_map(|p| Some((shape(p, of)?.radius, boxes(p, of)?)));
            bounded.min_by(|a, b| a.0.total_cmp(&b.0)).map(|b| b.1)
        }
        Shape::Difference(first, _) => boxes(first, of),
    }
}

fn three(v: &[f64]) -> Vec3 {
    std::array::from_fn(|i| v.get(i).or(v.last()).copied().unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_around_two_balls() {
        let a = Ball { center: [0.0; 3], radius: 1.0 };
        let b = Ball { center: [4.0, 0.0, 0.0], radius: 2.0 };
        assert_eq!(a.with(b), Ball { center: [2.5, 0.0, 0.0], radius: 3.5 });
        let inside = Ball { center: [0.1, 0.0, 0.0], radius: 0.5 };
        assert_eq!(a.with(inside), a);
        assert_eq!(inside.with(a), a);
    }
}
