//! Splats as a camera sees them: the affine approximation of its projection around each centre.
//!
//! In a perspective view, with t the centre relative to the eye along right, down and forward, and f the focal length in pixels,
//!
//! ```text
//! J = | f/t_z   0    −f·t_x/t_z² |        Σ' = J Σ Jᵀ + 0.3·I
//!     |  0    f/t_z  −f·t_y/t_z² |
//! ```
//!
//! where t_x/t_z and t_y/t_z in the last column are kept within 1.3 times what the picture shows, as the authors' code does:
//! far outside the picture the approximation breaks down. Centres nearer than 0.2 of the file's units, and those behind the eye,
//! are not seen. An orthographic projection is affine itself. A panorama projects each splat onto the plane that touches the
//! sphere of directions at its centre, where a pixel is π/height wide; the picture's pixels are that size at the horizon.
//!
//! Splats that were fitted with a low-pass that keeps their light have α times √(|J Σ Jᵀ| / |Σ'|).

use super::veil::{Layer, Light};
use super::{Splat, World, across, inverse, project, response};
use crate::frame::vector::{Vec3, dot, length, normalize, sub};
use crate::frame::{Camera, View};

/// The low-pass, in px².
const LOW_PASS: f64 = 0.3;
/// Nearer than this, in units of the file, nothing is seen.
const NEAR: f64 = 0.2;
/// Of the picture's half width and height.
const AROUND: f64 = 1.3;
/// The least share of its opacity that the low-pass leaves a splat.
const FAINTEST: f64 = 0.000_025;

/// A splat in the picture.
#[derive(Copy, Clone, Debug)]
struct Seen {
    /// Depth: along the view, or the distance for a panorama.
    depth: f64,
    /// In pixels; for a panorama the direction of the centre and two axes across it.
    place: Place,
    /// The inverse of the widened covariance: xx, xy, yy.
    precision: Vec3,
    opacity: f64,
    light: Light,
}

#[derive(Copy, Clone, Debug)]
enum Place {
    Pixel([f64; 2]),
    Direction { at: Vec3, axes: [Vec3; 2] },
}

/// All splats that a camera may see, from near to far; of those at one depth the first in the scene is in front.
#[derive(Clone, Debug)]
pub(in crate::engine::reference) struct Projected {
    camera: Camera,
    list: Vec<Seen>,
}

impl Projected {
    pub(in crate::engine::reference) fn new(world: &World, camera: &Camera) -> Self {
        let mut list: Vec<Seen> = world.list.iter().filter_map(|s| see(world, camera, s)).collect();
        list.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        Self { camera: *camera, list }
    }

    /// What covers a point of the picture, in pixel coordinates; `direction` is that of its ray.
    pub(in crate::engine::reference) fn at(&self, pixel: [f64; 2], direction: Vec3) -> Vec<Layer> {
        let slant = match self.camera.view {
            View::Perspective { .. } => 1.0 / dot(direction, self.camera.forward),
            View::Orthographic { .. } | View::Panorama => 1.0,
        };
        let mut layers = vec![];
        for seen in &self.list {
            let offset = match &seen.place {
                Place::Pixel(at) => [pixel[0] - at[0], pixel[1] - at[1]],
                Place::Direction { at, axes } => {
                    let ahead = dot(direction, *at);
                    if ahead <= 0.0 {
                        continue;
                    }
                    axes.map(|a| dot(a, direction) / ahead)
                }
            };
            let alpha = seen.opacity * response(seen.precision, offset);
            if alpha > 0.0 {
                layers.push(Layer { t: seen.depth * slant, alpha, light: seen.light });
            }
        }
        layers
    }
}

fn see(world: &World, camera: &Camera, splat: &Splat) -> Option<Seen> {
    let way = sub(splat.center, camera.from);
    let (w, h) = (f64::from(camera.size[0].max(1)), f64::from(camera.size[1].max(1)));
    let (right, down) = (camera.right, camera.up.map(|x| -x));
    let [x, y, z] = [right, down, camera.forward].map(|axis| dot(axis, way));
    let (depth, place, rows, low_pass) = match camera.view {
        View::Perspective { tangent } => {
            let f = 0.5 * h / tangent;
            let within = |slope: f64, most: f64| slope.clamp(-AROUND * most, AROUND * most);
            let (sx, sy) = (within(x / z, tangent * w / h), within(y / z, tangent));
            let row = |axis: Vec3, slope: f64| -> Vec3 {
                std::array::from_fn(|i| f / z * (axis[i] - slope * camera.forward[i]))
            };
            let at = [0.5 * w + f * x / z, 0.5 * h + f * y / z];
            (z, Place::Pixel(at), [row(right, sx), row(down, sy)], LOW_PASS)
        }
        View::Orthographic { half_height } => {
            let scale = 0.5 * h / half_height;
            let at = [0.5 * w + scale * x, 0.5 * h + scale * y];
            (z, Place::Pixel(at), [right, down].map(|axis| axis.map(|v| v * scale)), LOW_PASS)
        }
        View::Panorama => {
            let (distance, at) = (length(way), normalize(way)?);
            let axes = across(at);
            let rows = axes.map(|axis| axis.map(|v| v / distance));
            (distance, Place::Direction { at, axes }, rows, LOW_PASS * (std::f64::consts::PI / h).powi(2))
        }
    };
    let set = world.set(splat);
    if !(depth > NEAR * set.size) {
        return None;
    }
    let [xx, xy, yy] = project(&splat.covariance, &rows);
    let covariance = [xx + low_pass, xy, yy + low_pass];
    let kept = if set.splats.antialiased() {
        let share = (xx * yy - xy * xy) / (covariance[0] * covariance[2] - xy * xy);
        share.max(FAINTEST).sqrt()
    } else {
        1.0
    };
    let view = match camera.view {
        View::Orthographic { .. } => camera.forward,
        View::Perspective { .. } | View::Panorama => normalize(way)?,
    };
    let precision = inverse(covariance)?;
    Some(Seen { depth, place, precision, opacity: splat.opacity * kept, light: world.light(splat, view) })
}
