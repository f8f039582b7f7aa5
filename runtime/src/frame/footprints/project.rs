//! The projection of splats into a picture, or onto a ray.

use super::{Cast, FLOOR, LeftOut, bounded};
use crate::data::splats::color;
use crate::frame::vector::{Vec3, cross, dot, length, normalize, sub};
use crate::frame::{Camera, View};
use crate::image::{srgb_decode, srgb_encode};
use rayon::prelude::*;

/// The low-pass, in px².
const LOW_PASS: f64 = 0.3;
/// Nearer than this, in units of the file, nothing is seen.
const NEAR: f64 = 0.2;
/// How far slopes count, in halves of the picture.
const AROUND: f64 = 1.3;
/// The least share of the opacity that the low-pass leaves.
const FAINTEST: f64 = 0.000_025;

/// A splat in the world.
struct Body {
    center: Vec3,
    /// The axes, as long as the deviations along them.
    axes: [Vec3; 3],
    opacity: f64,
}

/// A splat in the picture.
#[derive(Copy, Clone, Debug)]
pub(super) struct Seen {
    /// Along the view, or the distance in a panorama.
    depth: f64,
    /// Pixels from the upper left corner; in a panorama the direction.
    pub(super) at: Vec3,
    /// Of the widened covariance xx, xy, yy: in px², in a panorama in the plane across `at`, in rad².
    pub(super) covariance: Vec3,
    /// Its determinant.
    determinant: f64,
    pub(super) opacity: f64,
    /// Linear red, green and blue.
    light: [f32; 3],
    encoded: bool,
}

impl Seen {
    /// The largest of red, green and blue, in lx: no band has more.
    pub(super) fn brightness(&self) -> f64 {
        self.light.iter().fold(0.0_f32, |m, x| m.max(*x)).into()
    }

    fn write_light(&self, out: &mut Vec<f32>, bands: &[Vec3]) {
        write_light(out, self.light.map(f64::from), self.encoded, bands);
    }
}

/// The colours of a footprint in the bands, as they are blended.
fn write_light(out: &mut Vec<f32>, light: Vec3, encoded: bool, bands: &[Vec3]) {
    out.extend(bands.iter().map(|parts| {
        let value = dot(*parts, light);
        bounded(if encoded { srgb_encode(value) } else { value })
    }));
}

/// What kernels read as the opacity.
fn signed(opacity: f64, encoded: bool) -> f32 {
    bounded(if encoded { -opacity } else { opacity })
}

impl Cast<'_> {
    /// Sets and numbers of all splats, by one number for each.
    fn place(&self, number: usize) -> (usize, usize) {
        let mut rest = number;
        for (set, file) in self.files.iter().enumerate() {
            if rest < file.len() {
                return (set, rest);
            }
            rest -= file.len();
        }
        (0, 0)
    }

    fn body(&self, set: usize, index: usize) -> Body {
        let (file, placed) = (&self.files[set], &self.placed[set]);
        let m = &placed.rows;
        let [w, x, y, z] = file.rotations()[index].map(f64::from);
        // Of 32-bit numbers: not quite of length 1.
        let s = 2.0 / (w * w + x * x + y * y + z * z);
        let columns = [
            [1.0 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y)],
            [s * (x * y - w * z), 1.0 - s * (x * x + z * z), s * (y * z + w * x)],
            [s * (x * z + w * y), s * (y * z - w * x), 1.0 - s * (x * x + y * y)],
        ];
        let deviations = file.deviations()[index];
        let axes = std::array::from_fn(|k| {
            let scale = f64::from(deviations[k]) * self.unit;
            m.map(|row| scale * dot(row, columns[k]))
        });
        let own = file.centers()[index].map(|x| f64::from(x) * self.unit);
        let center = std::array::from_fn(|i| dot(m[i], own) + placed.offset[i]);
        Body { center, axes, opacity: f64::from(file.opacities()[index]) }
    }

    /// Linear red, green and blue along a direction of view.
    fn light(&self, set: usize, index: usize, view: Vec3) -> Vec3 {
        let (file, placed) = (&self.files[set], &self.placed[set]);
        let own = normalize(placed.back.map(|row| dot(row, view))).unwrap_or([0.0, 0.0, 1.0]);
        color(file.harmonics(index), file.degree(), own).map(srgb_decode)
    }

    /// What a file calls 1, in the graph's units: the mean over directions of what its transform does.
    fn size(&self, set: usize) -> f64 {
        let m = &self.placed[set].rows;
        dot(m[0], cross(m[1], m[2])).abs().cbrt() * self.unit * self.files[set].unit()
    }

    fn see(&self, camera: &Camera, sizes: &[f64], number: usize) -> Option<Seen> {
        let (set, index) = self.place(number);
        let body = self.body(set, index);
        let way = sub(body.center, camera.from);
        let [w, h] = camera.size.map(|n| f64::from(n.max(1)));
        let (right, down) = (camera.right, camera.up.map(|x| -x));
        let [x, y, z] = [right, down, camera.forward].map(|axis| dot(axis, way));
        let (depth, at, rows, low_pass) = match camera.view {
            View::Perspective { tangent } => {
                let focal = 0.5 * h / tangent;
                let slope = |x: f64, most: f64| (x / z).clamp(-AROUND * most, AROUND * most);
                let (u, v) = (slope(x, tangent * w / h), slope(y, tangent));
                let row = |axis: Vec3, slope: f64| -> Vec3 {
                    std::array::from_fn(|i| focal / z * (axis[i] - slope * camera.forward[i]))
                };
                let at = [0.5 * w + focal * x / z, 0.5 * h + focal * y / z, 0.0];
                (z, at, [row(right, u), row(down, v)], LOW_PASS)
            }
            View::Orthographic { half_height } => {
                let scale = 0.5 * h / half_height;
                let at = [0.5 * w + scale * x, 0.5 * h + scale * y, 0.0];
                (z, at, [right, down].map(|axis| axis.map(|v| v * scale)), LOW_PASS)
            }
            View::Panorama => {
                let (distance, at) = (length(way), normalize(way)?);
                let rows = across(at).map(|axis| axis.map(|v| v / distance));
                (distance, at, rows, LOW_PASS * (std::f64::consts::PI / h).powi(2))
            }
        };
        if !(depth > NEAR * sizes[set]) {
            return None;
        }
        let [a, b] = rows.map(|row| body.axes.map(|axis| dot(row, axis)));
        let (xx, xy, yy) = (dot(a, a), dot(a, b), dot(b, b));
        // Cauchy–Binet: no difference of large numbers.
        let area = cross(a, b);
        let sharp = dot(area, area);
        let determinant = sharp + low_pass * (xx + yy) + low_pass * low_pass;
        let kept = if self.files[set].antialiased() { (sharp / determinant).max(FAINTEST).sqrt() } else { 1.0 };
        let covariance = [xx + low_pass, xy, yy + low_pass];
        let opacity = body.opacity * kept;
        let finite = covariance.iter().chain(&at).chain([&determinant, &opacity, &depth]).all(|x| x.is_finite());
        if !finite || opacity <= 0.0 {
            return None;
        }
        let view = match camera.view {
            View::Orthographic { .. } => camera.forward,
            View::Perspective { .. } | View::Panorama => normalize(way)?,
        };
        let light = self.light(set, index, view).map(bounded);
        let encoded = self.placed[set].encoded;
        Some(Seen { depth, at, covariance, determinant, opacity, light, encoded })
    }
}

/// Two unit vectors that span the plane across a direction.
pub(super) fn across(direction: Vec3) -> [Vec3; 2] {
    let axis = (0..3).min_by(|a, b| direction[*a].abs().total_cmp(&direction[*b].abs())).unwrap_or(0);
    let other = std::array::from_fn(|i| f64::from(u8::from(i == axis)));
    let u = normalize(cross(direction, other)).unwrap_or([1.0, 0.0, 0.0]);
    [u, cross(direction, u)]
}

/// All splats that a camera may see. What is behind the eye or has no finite picture is not among them.
#[derive(Clone, Debug)]
pub struct Projected {
    pub(super) list: Vec<Seen>,
    panorama: bool,
    middle: [f64; 2],
}

impl Projected {
    /// Projects them, in the order of the scene.
    #[must_use]
    pub fn new(cast: &Cast<'_>, camera: &Camera) -> Self {
        let sizes: Vec<f64> = (0..cast.files.len()).map(|set| cast.size(set)).collect();
        let list = (0..cast.len()).into_par_iter().filter_map(|number| cast.see(camera, &sizes, number)).collect();
        let panorama = matches!(camera.view, View::Panorama);
        Self { list, panorama, middle: camera.size.map(|n| 0.5 * f64::from(n.max(1))) }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Their keys, as [`super::Footprints::keys`] has them.
    pub(super) fn keys(&self) -> Vec<u32> {
        super::keys(self.list.iter().map(|s| s.depth))
    }

    /// What kernels read, for each part of a program. `plane` is the depth of the anchor.
    pub(super) fn records(&self, plane: f64, bands: &[Vec<Vec3>]) -> Vec<Vec<f32>> {
        let one = |bands: &Vec<Vec3>| {
            let stride = if self.panorama { 11 } else { 7 } + bands.len();
            let mut out = Vec::with_capacity(self.list.len() * stride);
            for seen in &self.list {
                let [_, xy, yy] = seen.covariance;
                // Σ⁻¹ = MᵀM with M = [p, q; 0, r].
                let p = (yy / seen.determinant).sqrt();
                let (q, r) = (-p * xy / yy, 1.0 / yy.sqrt());
                if self.panorama {
                    let [s, t] = across(seen.at);
                    let a: Vec3 = std::array::from_fn(|i| p * s[i] + q * t[i]);
                    let b = t.map(|x| r * x);
                    out.push(bounded(seen.depth));
                    out.extend(a.into_iter().chain(b).chain(seen.at).map(bounded));
                } else {
                    // From the middle of the picture, where f32 has its digits.
                    let [x, y] = [self.middle[0] - seen.at[0], self.middle[1] - seen.at[1]];
                    out.extend([seen.depth - plane, p, q, p * x + q * y, r, r * y].map(bounded));
                }
                out.push(signed(seen.opacity, seen.encoded));
                seen.write_light(&mut out, bands);
            }
            out
        };
        bands.iter().map(one).collect()
    }
}

/// A splat on a ray.
pub(super) struct Met {
    t: f64,
    alpha: f64,
    light: Vec3,
    encoded: bool,
}

impl Met {
    pub(super) fn t(&self) -> f64 {
        self.t
    }

    pub(super) fn write(&self, out: &mut Vec<f32>, start: f64, bands: &[Vec3]) {
        out.extend([bounded(self.t + start), signed(self.alpha, self.encoded)]);
        write_light(out, self.light, self.encoded, bands);
    }
}

/// The splats on a ray, in the order of the scene, and what is left out: α is the largest value of o·exp(−½ (x−μ)ᵀΣ⁻¹(x−μ)) on the ray.
pub(super) fn along(cast: &Cast<'_>, (origin, direction): (Vec3, Vec3), cut: f64) -> (Vec<Met>, LeftOut) {
    let plane = across(direction);
    let one = |number: usize| {
        let (set, index) = cast.place(number);
        let body = cast.body(set, index);
        let way = sub(body.center, origin);
        let t = dot(way, direction);
        if !(t > 0.0) {
            return None;
        }
        let [a, b] = plane.map(|row| body.axes.map(|axis| dot(row, axis)));
        let area = cross(a, b);
        let (determinant, xx, xy, yy) = (dot(area, area), dot(a, a), dot(a, b), dot(b, b));
        // What is seen edge-on has no width.
        if !(determinant > 8.0 * f64::EPSILON * xx * yy) {
            return None;
        }
        let [x, y] = plane.map(|axis| dot(axis, way));
        let power = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant;
        let alpha = body.opacity * (-0.5 * power.max(0.0)).exp();
        let seen = alpha.is_finite() && t.is_finite() && alpha > FLOOR;
        let light = cast.light(set, index, normalize(way).unwrap_or(direction));
        seen.then_some(Met { t, alpha, light, encoded: cast.placed[set].encoded })
    };
    let mut met: Vec<Met> = (0..cast.len()).into_par_iter().filter_map(one).collect();
    let mut left_out = LeftOut { alpha: FLOOR * cast.len() as f64, brightest: 0.0 };
    met.retain(|m| {
        let kept = m.alpha >= cut;
        if !kept {
            left_out.add(m.alpha, m.light.into_iter().fold(0.0, f64::max));
        }
        kept
    });
    (met, left_out)
}
