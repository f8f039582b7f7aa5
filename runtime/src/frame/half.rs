//! Planes across half the angle between the ways of sight and light, and the nodes that keep light from slab to slab.

use super::bounds::boxes_of;
use super::vector::{add, cross, dot, length, normalize, scale, sub};
use super::{Eye, Vec3};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{FieldScene, LightKind};
use compiler::program::Program;

/// Least cosine between light and the normal of the planes anywhere in the media. Across half an angle it is 0.7 for parallel light;
/// the light of a lamp spreads.
const LEAST_FACING: f64 = 0.2;
/// Nearest that media may come to the plane of a lamp across its axis, as a share of its distance.
const NEAREST: f64 = 0.02;
/// Nodes along an axis at least and at most; odd, so that every other one makes a lattice too.
const NODES: [f64; 2] = [17.0, 1025.0];
/// Nodes between two planes along the way of light: at least as close as planes, and closer while there are no more of them than pixels.
const NODES_A_SLAB: [f64; 2] = [1.0, 2.0];
/// Share of their extent by which the outermost nodes lie within it: on the face of a box along which light goes, it is inside.
const INSET: f64 = 1e-6;

/// Where light comes from.
#[derive(Copy, Clone, Debug, PartialEq)]
pub enum Shining {
    /// A unit vector along which it travels.
    Parallel(Vec3),
    /// Where the lamp is, in the scene's units.
    Lamp(Vec3),
}

/// How planes stand, and light goes through them.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct HalfAngle {
    /// Across the planes; light goes along it.
    pub normal: Vec3,
    center: Vec3,
    forward: Vec3,
    near: f64,
}

/// The nodes of [`compiler::program::LightBuffer`], which has the formulas. Lengths are in the scene's units.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct LightNodes {
    /// Where the axis crosses the middle of the media.
    pub center: Vec3,
    /// A unit vector along it.
    pub forward: Vec3,
    /// Across it: nodes per unit of length.
    pub axes: [Vec3; 2],
    /// Coordinates of node (0, 0).
    pub corner: [f64; 2],
    /// One over the distance of the lamp from the centre, or 0.
    pub near: f64,
    /// Nodes along both axes.
    pub counts: [u32; 2],
}

impl Default for LightNodes {
    fn default() -> Self {
        Self {
            center: [0.0; 3],
            forward: [0.0, 0.0, 1.0],
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            corner: [0.0; 2],
            near: 0.0,
            counts: [3; 2],
        }
    }
}

impl LightNodes {
    /// Coordinates of the node at a place.
    #[must_use]
    pub fn node(&self, p: Vec3) -> [f64; 2] {
        let q = sub(p, self.center);
        let spread = 1.0 + self.near * dot(self.forward, q);
        std::array::from_fn(|i| dot(self.axes[i], q) / spread - self.corner[i])
    }
}

impl Shining {
    /// The only light of a scene. Params are in the graph's units.
    #[must_use]
    pub fn of_scene(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> Option<Self> {
        let light = scene.lights.first()?;
        let three = |node| -> Vec3 {
            let v = evaluate_frame(&scene.graph, &[node], params, time).remove(0);
            std::array::from_fn(|i| v[i.min(v.len() - 1)])
        };
        match light.kind {
            LightKind::Directional { direction, .. } => normalize(three(direction)).map(Self::Parallel),
            LightKind::Point { position, .. } => Some(Self::Lamp(three(position))),
        }
    }
}

/// Boxes around the media that light is followed through, in any part of a program.
#[must_use]
pub(super) fn open_boxes(program: &Program, params: &[Vec<f64>], time: f64) -> Vec<[Vec3; 8]> {
    let scene = &program.lowered;
    let lists: Vec<&Vec<u32>> = program.parts().filter_map(|p| p.plan.light.as_ref()).map(|l| &l.media).collect();
    let numbered = (0u32..).zip(&scene.media);
    let open = numbered.filter(|(i, _)| lists.iter().any(|list| list.contains(i))).map(|(_, m)| m);
    boxes_of(scene, open, (params, time))
}

impl HalfAngle {
    /// Planes across half the angle between the ways of sight and light, or between that of light and the opposite of sight where they go
    /// against one another (Kniss et al. 2003). Where light of a near lamp would meet them from the side, they turn towards it.
    ///
    /// # Errors
    /// `E0531` where the lamp stands among the media, or so near that its light meets no planes from one side alone.
    pub fn new(shining: Shining, boxes: &[[Vec3; 8]], eye: &Eye) -> Result<Self, Diagnostic> {
        let corners = || boxes.iter().flatten().copied();
        let extreme = |start: f64, pick: fn(f64, f64) -> f64| -> Vec3 {
            std::array::from_fn(|k| corners().map(|p| p[k]).fold(start, pick))
        };
        let (low, high) = (extreme(f64::INFINITY, f64::min), extreme(f64::NEG_INFINITY, f64::max));
        let center = if boxes.is_empty() { [0.0; 3] } else { scale(add(low, high), 0.5) };
        let (forward, near) = match shining {
            Shining::Parallel(way) => (way, 0.0),
            Shining::Lamp(at) => {
                let way = sub(center, at);
                let Some(forward) = normalize(way) else { return Err(among()) };
                (forward, 1.0 / length(way))
            }
        };
        let sight = if dot(forward, eye.forward) < 0.0 { scale(eye.forward, -1.0) } else { eye.forward };
        let faces = |normal: Vec3| {
            corners().all(|p| {
                let q = sub(p, center);
                let way = normalize(add(forward, scale(q, near)));
                1.0 + near * dot(forward, q) > NEAREST && way.is_some_and(|way| dot(way, normal) >= LEAST_FACING)
            })
        };
        let turned = [1.0, 0.5, 0.25, 0.0].iter().filter_map(|share| normalize(add(forward, scale(sight, *share))));
        let normal = turned.into_iter().find(|normal| faces(*normal)).ok_or_else(among)?;
        Ok(Self { normal, center, forward, near })
    }

    /// Nodes over these boxes for a picture of so many pixels, about as far apart as planes are along the way of light, or half as far.
    #[must_use]
    pub fn nodes(&self, boxes: &[[Vec3; 8]], step: f64, pixels: f64) -> LightNodes {
        let Self { normal, center, forward, near } = *self;
        let Some(first) = boxes.first() else { return LightNodes { center, forward, near, ..LightNodes::default() } };
        // Along an edge of the first box that light crosses as squarely as any: faces along which it goes are then sides of the lattice.
        let edges = (0..3).filter_map(|k| normalize(sub(first[1 << k], first[0])));
        let across = |edge: Vec3| sub(edge, scale(forward, dot(edge, forward)));
        let widest = edges.map(across).max_by(|a, b| length(*a).total_cmp(&length(*b)));
        let right = widest.and_then(normalize).unwrap_or([1.0, 0.0, 0.0]);
        let units = [right, cross(forward, right)];
        let plain = LightNodes { center, forward, axes: units, corner: [0.0; 2], near, counts: [3; 2] };
        let places: Vec<[f64; 2]> = boxes.iter().flatten().map(|p| plain.node(*p)).collect();
        let extreme = |start: f64, pick: fn(f64, f64) -> f64| -> [f64; 2] {
            std::array::from_fn(|i| places.iter().map(|p| p[i]).fold(start, pick))
        };
        let (lows, highs) = (extreme(f64::INFINITY, f64::min), extreme(f64::NEG_INFINITY, f64::max));
        let extents: [f64; 2] = std::array::from_fn(|i| (highs[i] - lows[i]).max(1e-30));
        let between = step / dot(normal, forward);
        let [sparse, dense] = NODES_A_SLAB;
        let affordable = between * (pixels / extents[0] / extents[1]).sqrt();
        let spacing = between / affordable.clamp(sparse, dense);
        let mut nodes = plain;
        for i in 0..2 {
            let (low, extent) = (lows[i], extents[i]);
            let [least, most] = NODES;
            let halves = (extent / spacing / 2.0).ceil().clamp((least - 1.0) / 2.0, (most - 1.0) / 2.0);
            let cells = 2.0 * halves;
            let rate = cells / (extent * (1.0 - 2.0 * INSET));
            nodes.axes[i] = scale(units[i], rate);
            nodes.corner[i] = (low + INSET * extent) * rate;
            nodes.counts[i] = cells as u32 + 1;
        }
        nodes
    }
}

fn among() -> Diagnostic {
    Diagnostic::error(
        "E0531",
        "`stacks = half_angle` follows light through the media from one side, and the lamp stands among them or too near",
    )
    .note("its planes face the light everywhere in the media, so the lamp must be outside of them, and not too near")
    .hint("move the lamp away, or use `stacks = view`, which draws any light")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(half: f64) -> [Vec3; 8] {
        std::array::from_fn(|i| std::array::from_fn(|k| if i >> k & 1 == 0 { -half } else { half }))
    }

    fn eye(forward: Vec3) -> Eye {
        Eye { anchor: [0.0; 3], forward, right: [1.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], plane: 0.0 }
    }

    #[test]
    fn planes_stand_across_half_the_angle_and_face_the_light() {
        let (boxes, sight) = ([cube(1.0)], [0.0, 0.0, 1.0]);
        for way in [[0.0, -1.0, 0.0], [0.0, -0.6, 0.8], [0.6, 0.0, -0.8], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]] {
            let half = HalfAngle::new(Shining::Parallel(way), &boxes, &eye(sight)).expect("parallel light");
            let (light, view) = (dot(half.normal, way), dot(half.normal, sight));
            assert!((light - view.abs()).abs() < 1e-12 && light > 0.7, "{way:?}: {light} {view}");
            assert!(view * dot(way, sight) >= 0.0, "{way:?}: with the view where light goes with it");
        }
    }

    #[test]
    fn nodes_span_the_boxes_and_lie_on_faces_along_the_light() {
        let boxes = [cube(1.0)];
        for shining in
            [Shining::Parallel([0.0, -1.0, 0.0]), Shining::Parallel([0.6, -0.8, 0.0]), Shining::Lamp([0.3, 4.0, -0.5])]
        {
            let half = HalfAngle::new(shining, &boxes, &eye([0.0, 0.0, 1.0])).expect("outside");
            let nodes = half.nodes(&boxes, 0.1, 0.0);
            assert!(nodes.counts.iter().all(|n| n % 2 == 1 && (17..100).contains(n)), "{:?}", nodes.counts);
            for i in 0..2 {
                let last = f64::from(nodes.counts[i] - 1);
                let places: Vec<f64> = boxes[0].iter().map(|p| nodes.node(*p)[i]).collect();
                let (low, high) = places.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
                assert!(
                    (-1e-3..0.0).contains(&low) && (0.0..1e-3).contains(&(high - last)),
                    "{shining:?}: {low} {high}"
                );
            }
        }
    }

    #[test]
    fn lamps_among_the_media_and_close_to_them_are_refused_and_planes_turn_towards_near_ones() {
        let boxes = [cube(1.0)];
        let of = |at| HalfAngle::new(Shining::Lamp(at), &boxes, &eye([0.0, 0.0, 1.0]));
        for at in [[0.0; 3], [0.5, 0.9, 0.0], [0.0, 1.001, 0.0]] {
            assert_eq!(of(at).expect_err("too near").code, "E0531", "{at:?}");
        }
        let (far, near) = (of([0.0, 9.0, 0.0]).expect("far"), of([0.0, 1.6, 0.0]).expect("near"));
        assert!((far.normal[1] + 0.5f64.sqrt()).abs() < 1e-12 && near.normal[1] < far.normal[1] - 0.1);
    }
}
