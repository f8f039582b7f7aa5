//! 3D Gaussian splats in f64, by the published formulas, without tiles, cut-offs or caps (Kerbl et al., "3D Gaussian Splatting
//! for Real-Time Radiance Field Rendering", 2023; Zwicker et al., "EWA Splatting", 2002).
//!
//! A splat of centre μ, covariance Σ and opacity o covers a ray by
//!
//! ```text
//! α = o · exp(−½ dᵀ Σ'⁻¹ d)
//! ```
//!
//! where Σ' is Σ as the ray sees it and d the ray's offset from μ there. For a pixel (`view`) Σ' is the projection into the
//! picture, affine around the centre and widened by a low-pass of 0.3 px². A ray of a probe has no pixel: Σ' is the projection
//! along the ray, without a low-pass, so that α is the largest value of o·exp(−½ (x−μ)ᵀΣ⁻¹(x−μ)) on the ray.
//!
//! A splat acts where the ray is abreast of its centre, as a thin layer that lets 1 − α through (`veil`).

pub(super) mod veil;
pub(super) mod view;

use super::trace::{BANDS, PerBand};
use crate::data::splats::{Splats, color};
use crate::frame::Placed;
use crate::frame::vector::{Vec3, dot, normalize, sub};
use crate::image::{srgb_decode, srgb_encode};
use compiler::ir::FieldScene;
use std::sync::Arc;
use veil::{Layer, Light};

/// A symmetric 3×3 matrix.
pub(super) type Symmetric = [Vec3; 3];

/// One splat in the world, in the graph's units.
#[derive(Copy, Clone, Debug)]
pub(super) struct Splat {
    pub(super) center: Vec3,
    pub(super) covariance: Symmetric,
    pub(super) opacity: f64,
    set: u32,
    index: u32,
}

/// The splats of one file in one place.
#[derive(Clone, Debug)]
struct Set {
    splats: Arc<Splats>,
    placed: Placed,
    /// What the file calls 1 in the world: the mean over directions of what the transform does, in the graph's units.
    size: f64,
}

/// All splats of a frame.
#[derive(Clone, Debug)]
pub(super) struct World {
    pub(super) list: Vec<Splat>,
    sets: Vec<Set>,
    /// For each band, the parts of red, green and blue in it.
    parts: Vec<Vec3>,
}

impl World {
    /// `files` has an entry for each item of splats.
    pub(super) fn new(scene: &FieldScene, placed: &[Placed], files: &[Arc<Splats>]) -> Self {
        let unit = scene.units.scale(1.0);
        let mut world = Self { list: vec![], sets: vec![], parts: scene.bands.resample() };
        for (set, (placed, splats)) in placed.iter().zip(files).enumerate() {
            let m = &placed.rows;
            let determinant = dot(m[0], crate::frame::vector::cross(m[1], m[2]));
            let size = determinant.abs().cbrt() * unit * splats.unit();
            world.list.reserve(splats.len());
            for index in 0..splats.len() {
                let turn = rotation(splats.rotations()[index].map(f64::from));
                let deviations = splats.deviations()[index].map(|s| f64::from(s) * unit);
                // Columns of A·R·diag(s): the principal axes in the world.
                let axes: Symmetric =
                    std::array::from_fn(|k| m.map(|row| dot(row, turn.map(|r| r[k])) * deviations[k]));
                let own = splats.centers()[index].map(|x| f64::from(x) * unit);
                world.list.push(Splat {
                    center: std::array::from_fn(|i| dot(m[i], own) + placed.offset[i]),
                    covariance: std::array::from_fn(|i| {
                        std::array::from_fn(|j| (0..3).map(|k| axes[k][i] * axes[k][j]).sum())
                    }),
                    opacity: f64::from(splats.opacities()[index]),
                    set: set as u32,
                    index: index as u32,
                });
            }
            world.sets.push(Set { splats: splats.clone(), placed: *placed, size });
        }
        world
    }

    fn set(&self, splat: &Splat) -> &Set {
        &self.sets[splat.set as usize]
    }

    /// What a splat sends along a direction of view (in the world, from the eye), as it is blended: encoded numbers, or lx.
    pub(super) fn light(&self, splat: &Splat, view: Vec3) -> Light {
        let set = self.set(splat);
        let own = normalize(set.placed.back.map(|row| dot(row, view))).unwrap_or([0.0, 0.0, 1.0]);
        let seen = color(set.splats.harmonics(splat.index as usize), set.splats.degree(), own).map(srgb_decode);
        let mut value: PerBand = [0.0; BANDS];
        for (slot, parts) in value.iter_mut().zip(&self.parts) {
            *slot = dot(*parts, seen);
        }
        if set.placed.encoded { Light::Encoded(value.map(srgb_encode)) } else { Light::Linear(value) }
    }

    /// What lies on a ray that belongs to no pixel, from near to far.
    pub(super) fn along(&self, origin: Vec3, direction: Vec3) -> Vec<Layer> {
        let mut layers = vec![];
        let plane = across(direction);
        for splat in &self.list {
            let way = sub(splat.center, origin);
            let t = dot(way, direction);
            if !(t > 0.0) {
                continue;
            }
            let offset = plane.map(|axis| dot(axis, way));
            let Some(precision) = inverse(project(&splat.covariance, &plane)) else { continue };
            let alpha = splat.opacity * response(precision, offset);
            if alpha > 0.0 {
                let view = normalize(way).unwrap_or(direction);
                layers.push(Layer { t, alpha, light: self.light(splat, view) });
            }
        }
        // Stable: of splats at one depth the first in the file is in front.
        layers.sort_by(|a, b| a.t.total_cmp(&b.t));
        layers
    }
}

/// Two unit vectors that span the plane across a direction.
pub(super) fn across(direction: Vec3) -> [Vec3; 2] {
    let axis = (0..3).min_by(|a, b| direction[*a].abs().total_cmp(&direction[*b].abs())).unwrap_or(0);
    let mut other = [0.0; 3];
    other[axis] = 1.0;
    let u = normalize(crate::frame::vector::cross(direction, other)).unwrap_or([1.0, 0.0, 0.0]);
    [u, crate::frame::vector::cross(direction, u)]
}

/// J Σ Jᵀ as (xx, xy, yy), for two rows of J.
pub(super) fn project(covariance: &Symmetric, rows: &[Vec3; 2]) -> Vec3 {
    let [a, b] = rows.map(|row| covariance.map(|c| dot(c, row)));
    [dot(rows[0], a), dot(rows[0], b), dot(rows[1], b)]
}

/// The inverse of a symmetric 2×2 matrix (xx, xy, yy), if it has one: what is seen edge-on has no width.
pub(super) fn inverse([xx, xy, yy]: Vec3) -> Option<Vec3> {
    let determinant = xx * yy - xy * xy;
    // Of a plane seen edge-on rounding may leave anything.
    (determinant > 8.0 * f64::EPSILON * xx * yy).then(|| [yy / determinant, -xy / determinant, xx / determinant])
}

/// exp(−½ dᵀ Σ⁻¹ d), given Σ⁻¹.
pub(super) fn response([xx, xy, yy]: Vec3, [x, y]: [f64; 2]) -> f64 {
    let power = xx * x * x + 2.0 * xy * x * y + yy * y * y;
    // Beyond this the exponential is 0 in f64.
    if power > 1500.0 { 0.0 } else { (-0.5 * power.max(0.0)).exp() }
}

/// Rows of the rotation of a unit quaternion w, x, y, z.
fn rotation([w, x, y, z]: [f64; 4]) -> Symmetric {
    // Of 32-bit numbers: not quite of length 1.
    let s = 2.0 / (w * w + x * x + y * y + z * z);
    [
        [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
    ]
}
