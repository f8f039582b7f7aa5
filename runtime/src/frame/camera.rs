//! Rays of a camera, in f64.

use super::vector::{Vec3, add, along, cross, dot, normalize, scale, sub};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{FieldScene, Projection};

/// A camera of one frame, in the graph's units of length.
///
/// With forward `f = (to − from)/|to − from|`, right `r = f × up` (normalised) and true up `u = r × f`, and for a
/// picture of W × H pixels `x = (2·px/W − 1)·W/H`, `y = 1 − 2·py/H`:
/// - perspective: origin `from`, direction `f + tan(fov/2)·(x·r + y·u)`, normalised; `fov` is vertical;
/// - orthographic: origin `from + height/2·(x·r + y·u)`, direction `f`;
/// - panorama: longitude `φ = 2π·(px/W − ½)`, latitude `θ = π·(½ − py/H)`,
///   direction `cos θ·(cos φ·f + sin φ·r) + sin θ·u`.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye, in units of length.
    pub from: Vec3,
    /// Unit vector to the middle of the picture.
    pub forward: Vec3,
    /// Unit vector to the right.
    pub right: Vec3,
    /// Unit vector up, perpendicular to both.
    pub up: Vec3,
    /// How rays leave it.
    pub view: View,
    /// Width and height of the picture in pixels.
    pub size: [u32; 2],
}

/// A projection of one frame.
#[derive(Copy, Clone, Debug, PartialEq)]
pub enum View {
    /// Half the vertical field of view, as a tangent.
    Perspective {
        /// tan(fov/2).
        tangent: f64,
    },
    /// Half the height of the picture in space.
    Orthographic {
        /// Units of length.
        half_height: f64,
    },
    /// Equirectangular.
    Panorama,
}

impl Camera {
    /// Evaluates a scene's camera. `params` are in the graph's units, `time` in seconds.
    ///
    /// # Errors
    /// `E0653` when it looks nowhere: `from` equals `to`, or a value is not finite or out of range.
    pub fn from_scene(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> Result<Self, Diagnostic> {
        let camera = &scene.camera;
        let mut nodes = vec![camera.from, camera.to, camera.up];
        match camera.projection {
            Projection::Perspective { fov: node } | Projection::Orthographic { height: node } => nodes.push(node),
            Projection::Panorama => {}
        }
        let values = evaluate_frame(&scene.graph, &nodes, params, time);
        let three = |i: usize| -> Vec3 { std::array::from_fn(|c| values[i][c.min(values[i].len() - 1)]) };
        let bad = |what: &str, hint: &str| Diagnostic::error("E0653", format!("the camera {what}")).hint(hint);
        let (from, to, up) = (three(0), three(1), three(2));
        let Some(forward) = normalize(sub(to, from)) else {
            return Err(bad("looks nowhere: `from` and `to` are the same point", "move one of them"));
        };
        if !super::vector::is_finite(from) {
            return Err(bad("stands at a position that is not finite", "check the params that `from` uses"));
        }
        let right = right_of(forward, up);
        let view = match camera.projection {
            Projection::Perspective { .. } => {
                let fov = values[3][0];
                if !(fov > 0.0 && fov < std::f64::consts::PI) {
                    return Err(bad(
                        &format!("has a field of view of {}°", fov.to_degrees()),
                        "`fov` lies between 0 deg and 180 deg",
                    ));
                }
                View::Perspective { tangent: (fov / 2.0).tan() }
            }
            Projection::Orthographic { .. } => {
                let height = values[3][0];
                if !(height > 0.0 && height.is_finite()) {
                    return Err(bad("has an orthographic height that is not positive", "give `height` in metres"));
                }
                View::Orthographic { half_height: height / 2.0 }
            }
            Projection::Panorama => View::Panorama,
        };
        Ok(Self { from, forward, right, up: cross(right, forward), view, size: scene.image.size })
    }

    /// The same camera for a picture of another size.
    #[must_use]
    pub fn with_size(self, size: [u32; 2]) -> Self {
        Self { size, ..self }
    }

    /// Origin and unit direction of the ray through a point of the picture, in pixel coordinates.
    #[must_use]
    pub fn ray(&self, px: f64, py: f64) -> (Vec3, Vec3) {
        let (w, h) = (f64::from(self.size[0].max(1)), f64::from(self.size[1].max(1)));
        let (x, y) = ((2.0 * px - w) / h, (h - 2.0 * py) / h);
        match self.view {
            View::Perspective { tangent } => {
                let side = add(scale(self.right, x * tangent), scale(self.up, y * tangent));
                (self.from, normalize(add(self.forward, side)).unwrap_or(self.forward))
            }
            View::Orthographic { half_height } => {
                let origin = along(along(self.from, self.right, x * half_height), self.up, y * half_height);
                (origin, self.forward)
            }
            View::Panorama => {
                let longitude = std::f64::consts::TAU * (px / w - 0.5);
                let latitude = std::f64::consts::PI * (0.5 - py / h);
                let level = add(scale(self.forward, longitude.cos()), scale(self.right, longitude.sin()));
                let direction = add(scale(level, latitude.cos()), scale(self.up, latitude.sin()));
                (self.from, normalize(direction).unwrap_or(self.forward))
            }
        }
    }
}

/// `forward × up`, normalised. Where `up` is along `forward` or no direction at all, the axis least along `forward` stands
/// in for it: looking straight down is no mistake.
fn right_of(forward: Vec3, up: Vec3) -> Vec3 {
    if let Some(up) = normalize(up) {
        let right = cross(forward, up);
        if dot(right, right) > 1e-24
            && let Some(right) = normalize(right)
        {
            return right;
        }
    }
    let axis = (0..3).min_by(|a, b| forward[*a].abs().total_cmp(&forward[*b].abs())).unwrap_or(0);
    let mut up = [0.0; 3];
    up[axis] = 1.0;
    normalize(cross(forward, up)).unwrap_or([1.0, 0.0, 0.0])
}
