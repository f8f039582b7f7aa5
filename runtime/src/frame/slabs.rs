//! Slabs across the view or across an axis of the media, and their outlines in the picture: what slicing draws.

use super::vector::{add, cross, dot, normalize, scale, sub};
use super::{Camera, Eye, HalfAngle, LightNodes, Vec3, View};
use compiler::ir::Stacks;
use compiler::program::AGAINST;
use std::ops::Range;

/// Pixels by which outlines are wider than what they hold: rays go through any point of a pixel, and rounding must not cut.
const MARGIN: f64 = 1.5;
/// An outline that reaches farther than this from the picture, in pixels, is taken to cover all of it.
const FARTHEST: f64 = 1e6;

/// The corners of one slab's outlines, where light meets one after another.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Turn {
    /// As rays see it that go along the normal.
    pub along: Range<u32>,
    /// As others do.
    pub against: Range<u32>,
    /// As light meets it, in texels of its buffer.
    pub light: Range<u32>,
}

/// Slabs between planes across the view. Lengths are in the scene's units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Slabs {
    /// Across the planes, a unit vector on the far side of them.
    pub normal: Vec3,
    /// Distance of the first plane from the eye's anchor, along the normal.
    pub start: f64,
    /// Distance from plane to plane.
    pub step: f64,
    /// How many slabs.
    pub count: u32,
    /// Lower and upper corner of a box around the media.
    pub bounds: [Vec3; 2],
    /// Triangles, three corners each, the farthest slab first: x and y in pixels of the picture, and the number of the slab,
    /// counted from the eye.
    pub outlines: Vec<[f32; 3]>,
    /// Where light meets them one after another: which of the corners are whose, the slab nearest to the light first.
    pub turns: Vec<Turn>,
    /// What keeps it from slab to slab.
    pub light: LightNodes,
}

/// Pairs of corners that an edge of a box joins: those whose numbers differ in one bit.
fn edges() -> impl Iterator<Item = (usize, usize)> {
    (0..8usize).flat_map(|i| (0..3).map(move |k| (i, i ^ (1 << k)))).filter(|(a, b)| a < b)
}

impl Slabs {
    /// `count` slabs across the boxes, as a camera sees them.
    #[must_use]
    pub fn of_view(boxes: &[[Vec3; 8]], eye: &Eye, camera: &Camera, (stacks, count): (Stacks, u32)) -> Self {
        let normal = match stacks {
            Stacks::View => eye.forward,
            Stacks::Object | Stacks::HalfAngle => axis(boxes, eye.forward),
        };
        // Nothing is seen behind the eye; planes across the media stay where they are.
        let nearest = match stacks {
            Stacks::View => -eye.plane,
            Stacks::Object | Stacks::HalfAngle => f64::NEG_INFINITY,
        };
        let [near, far] = depths(boxes, eye, normal);
        let near = near.max(nearest);
        let bounds = bounds(boxes);
        if far <= near || count == 0 || camera.size.contains(&0) {
            return Self { normal, step: 1.0, count, bounds, ..Self::default() };
        }
        // A little more, so that rounding leaves nothing outside.
        let slack = 1e-6 * (far - near);
        let start = (near - slack).max(nearest);
        let step = (far + slack - start) / f64::from(count);
        let mut outlines = vec![];
        let mut draw = |slab: u32, turn: u32| {
            let low = start + f64::from(slab) * step;
            fan(&mut outlines, &outline(boxes, normal, (low, low + step), eye, camera), slab + turn);
        };
        (0..count).rev().for_each(|slab| draw(slab, 0));
        if meets_from_behind(normal, eye, camera) {
            (0..count).for_each(|slab| draw(slab, AGAINST));
        }
        Self { normal, start, step, count, bounds, outlines, ..Self::default() }
    }

    /// `count` slabs across the boxes in the order in which light meets them. It is followed through those that are `open`.
    #[must_use]
    pub fn half_angle(
        (boxes, open): (&[[Vec3; 8]], &[[Vec3; 8]]),
        eye: &Eye,
        camera: &Camera,
        (half, count): (&HalfAngle, u32),
    ) -> Self {
        let normal = half.normal;
        let [near, far] = depths(boxes, eye, normal);
        let bounds = bounds(boxes);
        if far <= near || count == 0 || camera.size.contains(&0) {
            return Self { normal, step: 1.0, count, bounds, ..Self::default() };
        }
        let slack = 1e-6 * (far - near);
        let start = near - slack;
        let step = (far + slack - start) / f64::from(count);
        let light = half.nodes(open, step, f64::from(camera.size[0]) * f64::from(camera.size[1]));
        let [some_along, some_against] = facings(normal, eye, camera);
        let mut outlines = vec![];
        let mut add = |outline: &[[f64; 2]], number: u32| fan(&mut outlines, outline, number);
        let mut turns = vec![];
        for slab in 0..count {
            let low = start + f64::from(slab) * step;
            let seen = outline(boxes, normal, (low, low + step), eye, camera);
            let along = add(if some_along { &seen } else { &[] }, slab);
            let against = add(if some_against { &seen } else { &[] }, slab + AGAINST);
            let parts = open.iter().flat_map(|b| part(b, &|p| dot(sub(*p, eye.anchor), normal), (low, low + step)));
            let texels = parts.map(|p| light.node(p).map(|x| x + 0.5)).flat_map(around);
            let light = add(&hull(texels.collect()), slab);
            turns.push(Turn { along, against, light });
        }
        // What comes behind all that is seen is not asked for.
        while turns.last().is_some_and(|t| t.along.is_empty() && t.against.is_empty()) {
            turns.pop();
        }
        if let Some(last) = turns.last_mut() {
            last.light = 0..0;
        }
        Self { normal, start, step, count, bounds, outlines, turns, light }
    }

    /// `count` parts of each ray of a list within the boxes. The list is drawn as a picture one pixel high.
    #[must_use]
    pub fn of_rays(boxes: &[[Vec3; 8]], rays: usize, count: u32) -> Self {
        let wide = rays as f32 + 1.0;
        let mut outlines = vec![];
        for slab in (0..count).rev() {
            let corner = |x: f32, y: f32| [x, y, slab as f32];
            outlines.extend([corner(-1.0, -1.0), corner(wide, -1.0), corner(wide, 2.0)]);
            outlines.extend([corner(-1.0, -1.0), corner(wide, 2.0), corner(-1.0, 2.0)]);
        }
        let [low, high] = bounds(boxes);
        let slack: Vec3 = std::array::from_fn(|k| 1e-6 * (high[k] - low[k]));
        let bounds = [sub(low, slack), add(high, slack)];
        Self { step: 1.0, count, bounds, outlines, ..Self::default() }
    }
}

/// Of the directions across the faces of the first box that one which is most nearly along the view, pointing away from the eye.
fn axis(boxes: &[[Vec3; 8]], forward: Vec3) -> Vec3 {
    let Some(corners) = boxes.first() else { return forward };
    let edge = |k: usize| sub(corners[1 << k], corners[0]);
    let across = (0..3).filter_map(|k| normalize(cross(edge((k + 1) % 3), edge((k + 2) % 3))));
    let best = across.max_by(|a, b| dot(*a, forward).abs().total_cmp(&dot(*b, forward).abs()));
    best.map_or(forward, |n| if dot(n, forward) < 0.0 { scale(n, -1.0) } else { n })
}

/// Whether some ray of the picture goes against the normal of the planes, or along them.
fn meets_from_behind(normal: Vec3, eye: &Eye, camera: &Camera) -> bool {
    match camera.view {
        View::Orthographic { .. } => false,
        View::Perspective { .. } | View::Panorama => facings(normal, eye, camera)[1],
    }
}

/// Whether some ray of the picture goes along a normal, and whether some goes against it; one across it may do either.
fn facings(normal: Vec3, eye: &Eye, camera: &Camera) -> [bool; 2] {
    let [width, height] = camera.size.map(f64::from);
    let aspect = width / height;
    let corners = match camera.view {
        View::Orthographic { .. } => vec![eye.forward],
        View::Perspective { .. } | View::Panorama => [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]
            .iter()
            .map(|[u, v]| add(eye.forward, add(scale(eye.right, u * aspect), scale(eye.up, *v))))
            .collect(),
    };
    let facing = |corner: &Vec3| dot(*corner, normal);
    [corners.iter().any(|c| facing(c) >= -1e-6), corners.iter().any(|c| facing(c) <= 1e-6)]
}

/// Corners of the part of a box that lies between two depths.
fn part(corners: &[Vec3; 8], depth: &dyn Fn(&Vec3) -> f64, (low, high): (f64, f64)) -> Vec<Vec3> {
    let mut held: Vec<Vec3> = corners.iter().copied().filter(|p| (low..=high).contains(&depth(p))).collect();
    for (a, b) in edges() {
        let (a, b) = (corners[a], corners[b]);
        let (from, to) = (depth(&a), depth(&b));
        for plane in [low, high] {
            if (from - plane) * (to - plane) < 0.0 {
                held.push(add(a, scale(sub(b, a), (plane - from) / (to - from))));
            }
        }
    }
    held
}

/// Corners of a square around a point in pixels.
fn around([x, y]: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
    [-MARGIN, MARGIN].into_iter().flat_map(move |dx| [[x + dx, y - MARGIN], [x + dx, y + MARGIN]])
}

/// The least and the largest depth of boxes along a normal, from the eye's anchor; ∞ and −∞ where there is none.
fn depths(boxes: &[[Vec3; 8]], eye: &Eye, normal: Vec3) -> [f64; 2] {
    let depths = boxes.iter().flatten().map(|p| dot(sub(*p, eye.anchor), normal));
    depths.fold([f64::INFINITY, f64::NEG_INFINITY], |[near, far], d| [near.min(d), far.max(d)])
}

/// Adds the triangles of a convex outline, and says which corners they are.
fn fan(corners: &mut Vec<[f32; 3]>, outline: &[[f64; 2]], number: u32) -> Range<u32> {
    let first = corners.len() as u32;
    let corner = |p: [f64; 2]| [p[0] as f32, p[1] as f32, number as f32];
    for pair in outline.windows(2).skip(1) {
        corners.extend([corner(outline[0]), corner(pair[0]), corner(pair[1])]);
    }
    first..corners.len() as u32
}

/// Lower and upper corner of a box around all; an empty one where there is none.
fn bounds(boxes: &[[Vec3; 8]]) -> [Vec3; 2] {
    if boxes.is_empty() {
        return [[0.0; 3]; 2];
    }
    let extreme = |start: f64, pick: fn(f64, f64) -> f64| {
        std::array::from_fn(|k| boxes.iter().flatten().map(|p| p[k]).fold(start, pick))
    };
    [extreme(f64::INFINITY, f64::min), extreme(f64::NEG_INFINITY, f64::max)]
}

/// A convex polygon around all that the picture shows of the boxes between two depths, in pixels.
fn outline(boxes: &[[Vec3; 8]], normal: Vec3, (low, high): (f64, f64), eye: &Eye, camera: &Camera) -> Vec<[f64; 2]> {
    let [width, height] = camera.size.map(f64::from);
    let everything = || vec![[-1.0, -1.0], [width + 1.0, -1.0], [width + 1.0, height + 1.0], [-1.0, height + 1.0]];
    let depth = |p: &Vec3| dot(sub(*p, eye.anchor), normal);
    let mut points: Vec<[f64; 2]> = vec![];
    for corners in boxes {
        let held = part(corners, &depth, (low, high));
        let size = |p: &Vec3| match camera.view {
            View::Perspective { .. } => dot(sub(*p, eye.anchor), eye.forward) + eye.plane,
            View::Orthographic { .. } => 1.0,
            View::Panorama => 0.0,
        };
        // All of it behind the eye.
        if camera.view != View::Panorama && held.iter().all(|p| size(p) <= 0.0) {
            continue;
        }
        for p in held {
            let (q, size) = (sub(p, eye.anchor), size(&p));
            let along = |axis: &Vec3| dot(q, *axis) / (dot(*axis, *axis) * size);
            let x = (along(&eye.right) * height + width) / 2.0;
            let y = (1.0 - along(&eye.up)) * height / 2.0;
            // Beside the eye, or so near that the picture is within it.
            if size <= 0.0 || !(x.abs() < FARTHEST && y.abs() < FARTHEST) {
                return everything();
            }
            points.extend(around([x, y]));
        }
    }
    hull(points)
}

/// The convex hull, by monotone chains (Andrew 1979); nothing of fewer than three points.
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return vec![];
    }
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = vec![];
        for p in points {
            while let [.., a, b] = chain[..]
                && turn(a, b, p) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(low: f64, high: f64) -> [Vec3; 8] {
        std::array::from_fn(|i| std::array::from_fn(|k| if i >> k & 1 == 0 { low } else { high }))
    }

    fn camera(from: Vec3, view: View) -> Camera {
        Camera { from, forward: [0.0, 0.0, 1.0], right: [-1.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], view, size: [64, 48] }
    }

    fn inside(outline: &[[f32; 3]], slab: u32, x: f64, y: f64) -> bool {
        outline.chunks(3).filter(|t| t[0][2] == slab as f32).any(|t| {
            let side = |a: [f32; 3], b: [f32; 3]| {
                let [a, b] = [a, b].map(|p| [f64::from(p[0]), f64::from(p[1])]);
                (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            };
            let sides = [side(t[0], t[1]), side(t[1], t[2]), side(t[2], t[0])];
            sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
        })
    }

    #[test]
    fn outlines_hold_every_pixel_that_sees_the_slab() {
        for (from, view) in [
            ([0.3, 0.2, -4.0], View::Perspective { tangent: 0.4 }),
            ([0.0, 0.0, 0.0], View::Perspective { tangent: 0.7 }),
            ([0.1, -0.3, -1e6], View::Orthographic { half_height: 1.5 }),
        ] {
            let camera = camera(from, view);
            let eye = Eye::new(&camera, Some(crate::frame::Ball { center: [0.0; 3], radius: 1.8 }));
            let slabs = Slabs::of_view(&[cube(-1.0, 1.0)], &eye, &camera, (Stacks::View, 7));
            assert_eq!(slabs.count, 7);
            for j in 0..48 {
                for i in 0..64 {
                    let (origin, direction) = camera.ray(f64::from(i) + 0.5, f64::from(j) + 0.5);
                    for slab in 0..7u32 {
                        let middle = slabs.start + (f64::from(slab) + 0.5) * slabs.step;
                        let t = (middle + dot(sub(eye.anchor, origin), eye.forward)) / dot(direction, eye.forward);
                        let p = add(origin, scale(direction, t));
                        if t > 0.0 && p.iter().all(|x| x.abs() <= 1.0) {
                            let (x, y) = (f64::from(i) + 0.5, f64::from(j) + 0.5);
                            assert!(inside(&slabs.outlines, slab, x, y), "{view:?} {slab} {i} {j}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn slabs_are_ordered_from_far_to_near_and_tile_the_boxes() {
        let camera = camera([0.0, 0.0, -4.0], View::Perspective { tangent: 0.4 });
        let eye = Eye::new(&camera, None);
        let slabs = Slabs::of_view(&[cube(-1.0, 0.0), cube(0.5, 1.0)], &eye, &camera, (Stacks::View, 16));
        let order: Vec<f32> = slabs.outlines.iter().map(|v| v[2]).collect();
        assert!(order.windows(2).all(|w| w[0] >= w[1]) && order[0] == 15.0 && order.last() == Some(&0.0));
        assert!((slabs.start - 3.0).abs() < 1e-5 && (slabs.start + 16.0 * slabs.step - 5.0).abs() < 1e-5);
        // Between the two boxes there is nothing to draw.
        assert!(!slabs.outlines.iter().any(|v| v[2] == 10.0));
    }

    #[test]
    fn nothing_is_drawn_of_what_lies_behind_the_eye() {
        let camera = camera([0.0, 0.0, 4.0], View::Perspective { tangent: 0.4 });
        let eye = Eye::new(&camera, None);
        assert!(Slabs::of_view(&[cube(-1.0, 1.0)], &eye, &camera, (Stacks::View, 8)).outlines.is_empty());
    }
}
