//! What an engine is told about one drawing, and where f32 rays begin.

use super::bounds::Ball;
use super::vector::{along, dot, length, scale, sub};
use super::{Bricks, Camera, Vec3, View};
use compiler::analysis::interval::Interval;
use compiler::analysis::range::{Known, ranges_of};
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{FieldScene, Graph};
use std::sync::Arc;

/// An eye or a ray's origin farther from the scene than this many of its radii is moved near it.
const FAR: f64 = 16.0;

/// Everything about one drawing that a program does not know when it is compiled. Lengths are in the scene's units.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Values of the parameters, in the graph's units.
    pub params: Vec<Vec<f64>>,
    /// Seconds.
    pub time: f64,
    /// Pixels of the picture.
    pub size: [u32; 2],
    /// A of `accuracy`.
    pub accuracy: f64,
    /// W of `accuracy`, display white in lx; 0 for a probe, whose accuracy is relative.
    pub white: f64,
    /// `steps`.
    pub steps: u32,
    /// `max_work`
    pub max_work: u32,
    /// Where rays come from.
    pub eye: Eye,
    /// Paths of a pixel or ray in one dispatch, for scattering of all orders.
    pub paths: u32,
    /// Number of the first of them.
    pub first_path: u32,
    /// Of random numbers.
    pub seed: u32,
    /// A ball around the media, if they are bounded: for majorants.
    pub bounds: Option<Ball>,
    /// Values of the grids, for majorants.
    pub grids: Vec<Interval>,
    /// For slicing.
    pub slabs: super::Slabs,
    /// For splatting.
    pub lattice: super::Lattice,
    /// As [`compiler::program::FrameValue::Lean`].
    pub lean: f64,
    /// Whether this goes on with the picture of the drawing before: what is worked out once for a picture (light, splats) is there.
    pub goes_on: bool,
    /// Splats of files as the picture shows them.
    pub footprints: Arc<super::Footprints>,
    /// Bounds of media on lattices, by part of the program and number in its plan.
    pub bricks: Arc<Vec<Vec<Bricks>>>,
    /// The box around media whose columns of light are kept.
    pub columns: Option<[Vec3; 2]>,
    /// Which part is drawn.
    pub part: usize,
}

impl Frame {
    /// The same for another part of the program.
    #[must_use]
    pub fn of_part(&self, part: usize) -> Self {
        Self { part, ..self.clone() }
    }

    /// The bounds of the part that is drawn.
    #[must_use]
    pub fn own_bricks(&self) -> &[Bricks] {
        self.bricks.get(self.part).map_or(&[], Vec::as_slice)
    }

    /// Lower corner and edges of the box in which columns of light are kept: a little wider than what it is around, so that
    /// rounding leaves nothing outside, and nowhere without extent.
    #[must_use]
    pub fn lattice_of_columns(&self) -> (Vec3, Vec3) {
        let [low, high] = self.columns.unwrap_or([[-1.0; 3], [1.0; 3]]);
        let edges = sub(high, low);
        let rim = 1e-4 * edges.iter().copied().fold(0.0, f64::max) + 1e-30;
        (low.map(|x| x - rim), edges.map(|e| e + 2.0 * rim))
    }

    /// What every node of a graph can be anywhere in the scene.
    #[must_use]
    pub fn majorants(&self, graph: &Graph) -> Vec<Interval> {
        let mut known = Known {
            time: Interval { low: self.time, high: self.time, nan: false },
            params: &self.params,
            grids: &self.grids,
            ..Known::default()
        };
        if let Some(ball) = self.bounds {
            let reach = |sign: f64| ball.center.iter().map(move |c| c + sign * ball.radius);
            let low = reach(-1.0).fold(f64::INFINITY, f64::min);
            let high = reach(1.0).fold(f64::NEG_INFINITY, f64::max);
            known.position = Interval { low, high, nan: false };
        }
        ranges_of(graph, &known)
    }
}

/// The camera as kernels get it; see [`compiler::program::FrameValue`] for the formulas.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Eye {
    /// Where the rays' parameter is 0 in the middle of the picture.
    pub anchor: Vec3,
    /// Unit vector.
    pub forward: Vec3,
    /// Scaled by tan(fov/2) or half the height.
    pub right: Vec3,
    /// Scaled likewise.
    pub up: Vec3,
    /// Distance of the anchor from the eye along `forward`.
    pub plane: f64,
}

impl Eye {
    /// The eye of a camera. When it is far from the scene, the anchor is put abreast of the scene's centre: what is left
    /// for f32 are numbers of the size of the scene.
    #[must_use]
    pub fn new(camera: &Camera, bounds: Option<Ball>) -> Self {
        let factor = match camera.view {
            View::Perspective { tangent } => tangent,
            View::Orthographic { half_height } => half_height,
            View::Panorama => 1.0,
        };
        let plane = match camera.view {
            // A panorama looks everywhere; there is no plane to begin at.
            View::Panorama => 0.0,
            View::Perspective { .. } | View::Orthographic { .. } => shift(camera.from, camera.forward, bounds),
        };
        Self {
            anchor: along(camera.from, camera.forward, plane),
            forward: camera.forward,
            right: scale(camera.right, factor),
            up: scale(camera.up, factor),
            plane,
        }
    }
}

/// How far along a unit direction to begin instead: 0 unless the origin is far from the scene and the scene lies ahead.
fn shift(origin: Vec3, direction: Vec3, bounds: Option<Ball>) -> f64 {
    let Some(ball) = bounds else { return 0.0 };
    let to_scene = sub(ball.center, origin);
    if length(to_scene) <= FAR * ball.radius { 0.0 } else { dot(to_scene, direction).max(0.0) }
}

/// A ray of a list, as kernels read it: origin, least t, direction, 0. `direction` is a unit vector; lengths are in the
/// scene's units. An origin far from the scene is moved near it, in f64, and the least t says by how much.
#[must_use]
pub fn pack_ray(origin: Vec3, direction: Vec3, bounds: Option<Ball>) -> [f32; 8] {
    let shift = shift(origin, direction, bounds);
    let [x, y, z] = along(origin, direction, shift).map(|v| v as f32);
    let [u, v, w] = direction.map(|v| v as f32);
    [x, y, z, -shift as f32, u, v, w, 0.0]
}

/// Display white in lx: 2^−exposure. Params are in the graph's units.
#[must_use]
pub fn white(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> f64 {
    let exposure = evaluate_frame(&scene.graph, &[scene.image.exposure], params, time);
    (-exposure[0][0]).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(from: Vec3, view: View) -> Camera {
        Camera { from, forward: [0.0, 0.0, 1.0], right: [-1.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], view, size: [64, 48] }
    }

    /// The plan's formula in f64: origin, direction and least t of the ray through a point of the picture.
    fn ray(eye: &Eye, view: View, size: [u32; 2], x: f64, y: f64) -> (Vec3, Vec3, f64) {
        let (w, h) = (f64::from(size[0]), f64::from(size[1]));
        let (u, v) = ((2.0 * x - w) / h, 1.0 - 2.0 * y / h);
        let side: Vec3 = std::array::from_fn(|i| u * eye.right[i] + v * eye.up[i]);
        match view {
            View::Perspective { .. } => {
                let d = super::super::vector::add(eye.forward, side);
                let l = length(d);
                (along(eye.anchor, side, eye.plane), scale(d, 1.0 / l), -eye.plane * l)
            }
            View::Orthographic { .. } => (along(eye.anchor, side, 1.0), eye.forward, -eye.plane),
            View::Panorama => (eye.anchor, eye.forward, 0.0),
        }
    }

    #[test]
    fn near_and_far_eyes_give_the_rays_of_the_camera() {
        let ball = Some(Ball { center: [0.0; 3], radius: 1.0 });
        for view in [View::Perspective { tangent: 0.01 }, View::Orthographic { half_height: 1.5 }] {
            for distance in [0.5, 4.0, 100.0, 1e7] {
                let camera = camera([0.0, 0.0, -distance], view);
                let eye = Eye::new(&camera, ball);
                assert_eq!(eye.plane, if distance > 16.0 { distance } else { 0.0 });
                for [x, y] in [[0.0, 0.0], [32.0, 24.0], [63.5, 12.25]] {
                    let (origin, direction, least) = ray(&eye, view, camera.size, x, y);
                    let (from, along_ray) = camera.ray(x, y);
                    let begin = along(origin, direction, least);
                    assert!(length(sub(begin, from)) <= 1e-14 * distance.max(1.0), "{view:?} {distance}: {begin:?}");
                    assert!(length(sub(direction, along_ray)) < 1e-14);
                }
            }
        }
    }

    #[test]
    fn a_far_origin_keeps_its_place_in_f32() {
        let ball = Some(Ball { center: [0.0; 3], radius: 1.0 });
        // A million radii away, and a quarter of a radius off the axis: f32 at the origin would lose the offset's digits.
        let direction = super::super::vector::normalize([1e6, 0.25, 0.0]).expect("not zero");
        let packed = pack_ray([-1e6, 0.0, 0.0], direction, ball);
        assert!((packed[1] - 0.25).abs() < 1e-6 && packed[0].abs() < 0.1, "{packed:?}");
        assert!((packed[3] + 1e6).abs() < 1.0);
        // A ray that looks away stays where it is, and so does one that starts near.
        assert_eq!(pack_ray([-1e6, 0.0, 0.0], [-1.0, 0.0, 0.0], ball)[3], 0.0);
        assert_eq!(pack_ray([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], ball), [-3.0, 0.0, 0.0, -0.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(pack_ray([-1e6, 0.0, 0.0], direction, None)[3], 0.0);
    }
}
