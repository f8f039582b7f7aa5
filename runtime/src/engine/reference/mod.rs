//! The reference engine: the transfer equation in f64, adaptively, to a relative tolerance, with an estimate of its own error.
//!
//! It reads the graph as lowered and shares no integration code with the backends, so that a mistake of theirs shows.
//!
//! # Method
//! A ray is cut wherever it enters or leaves a shape (exact interval algebra over closed forms, `shape`), and inside media at
//! every place where a field may not be smooth: faces of voxels, stops of tables, cells of noise, zeros of the arguments of
//! `abs`, `min`, `max` and comparisons, peaks of exponentials (`events`). Each stretch becomes panels of eight Gauss–Legendre
//! nodes (`gauss`, `panel`), which carry their own optical depth, radiance and errors of both; panels are divided until the
//! composed radiance, depth and transmittance are within the tolerance (`trace`). Errors come from the decay of Legendre
//! coefficients, so they are estimates; where coefficients are constant to the last bit the closed form is used and the error
//! is rounding. Rays that never leave a medium are followed in octaves (`tail`).
//!
//! Positions and lengths are in the graph's units; the caller converts. `Input::Direction` is the direction in which light
//! travels, which inside media is against the ray; the background sees the direction of the ray.
//!
//! # Splats
//! Splats of files are thin layers on the ray, each covering what is behind it (`splats`). They cut the stretches of media, and
//! everything is composed in one order. They are seen by the eye alone: they neither shadow nor shine on anything.
//!
//! # Light
//! A ray ends at the first surface (`surface`), whose reflected radiance is behind everything before it. With
//! `scattering = single` media scatter what arrives from lights and the environment into the ray: each node of a panel asks
//! for it (`scatter`), along shadow rays whose optical depth is closed where media are uniform or exponential and adaptive
//! elsewhere (`shade`), over caps of the sphere by adaptive cubature (`sphere`). Panels are cut where shadows begin, which is known
//! of closed forms (`silhouette`) and probed for besides. Errors of
//! what arrives are carried along and added to the error of the ray; tolerances below 1e-9 (1e-7 where light comes from an
//! environment or a disc) are not attempted then, and `error` says what was reached. With `scattering = multiple` paths are
//! drawn (`paths`) and the error is a standard error.

#![expect(clippy::needless_range_loop, reason = "a band indexes several arrays at once")]

mod closed;
mod compose;
mod events;
mod faces;
mod field;
mod fixed;
mod gauss;
mod interval;
mod light;
mod negative;
mod panel;
mod paths;
mod project;
mod refine;
mod render;
mod scatter;
mod shade;
mod shape;
mod silhouette;
mod sphere;
mod splats;
mod split;
mod surface;
mod survey;
mod tail;
#[cfg(test)]
mod tests;
mod trace;
mod whole;

pub use field::bad_coefficient;
pub use render::{Picture, Pixels};
pub use surface::{MeshHit, Meshes, Triangles};
pub use survey::{Least, Survey, survey};
pub use whole::WholeReference;

use crate::data::splats::Splats;
use crate::frame::Camera;
use crate::frame::vector::{Vec3, normalize};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;
use compiler::ir::{Composite, FieldScene, NodeId, Scattering, Shape};
use field::{Fields, Ray};
pub(crate) use paths::Random;
use splats::World;
use splats::view::Projected;
use std::sync::Arc;
use trace::{BANDS, Worker};

/// A box around a shape, if it has one that is easily seen. `value` gives the numbers of a node of tier Frame.
pub(crate) fn bounding_box(shape: &Shape, value: &mut dyn FnMut(NodeId) -> Vec<f64>) -> Option<(Vec3, Vec3)> {
    shape::evaluate(shape, value).ok()?.bounds()
}

/// What has to be within the tolerance.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum Goal {
    /// Radiance, optical depth and transmittance: probes.
    All,
    /// Radiance alone: pictures.
    Radiance,
}

/// How hard to try.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Options {
    /// Relative tolerance of the radiance, and of depth and transmittance if they count.
    pub rtol: f64,
    /// Absolute tolerance of the radiance, in lx.
    pub atol: f64,
    /// What has to be within the tolerance.
    pub goal: Goal,
    /// Field evaluations per ray after which a ray is given up and says so.
    pub max_evaluations: u64,
    /// Instead of all that: the language's default rule with this many steps.
    pub steps: Option<u32>,
    /// With `scattering = multiple`: most paths per ray, in place of the scene's `samples`.
    pub samples: Option<u64>,
    /// With `scattering = multiple`: other seeds draw other paths.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rtol: 1e-10,
            atol: 0.0,
            goal: Goal::All,
            max_evaluations: 2_000_000,
            steps: None,
            samples: None,
            seed: 0,
        }
    }
}

impl Options {
    /// For pictures: every pixel within `accuracy · max(white, its radiance)`, with a margin.
    #[must_use]
    pub fn accuracy(accuracy: f64, white: f64) -> Self {
        let rtol = 0.25 * accuracy;
        Self { rtol, atol: rtol * white, goal: Goal::Radiance, ..Self::default() }
    }
}

impl Options {
    /// Rough enough to leave kinks inside loops to the adaptive part.
    fn is_lean(&self) -> bool {
        self.goal == Goal::Radiance && self.rtol >= 1e-6
    }
}

/// What kind of promise an error is; the greater, the weaker.
#[derive(Copy, Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ErrorKind {
    /// Nothing but rounding was approximated.
    Bound,
    /// From the decay of coefficients.
    Estimate,
    /// From the spread of random paths: one standard deviation of their mean.
    StandardError,
}

impl ErrorKind {
    /// As in the output of `probe`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bound => "bound",
            Self::Estimate => "estimate",
            Self::StandardError => "standard-error",
        }
    }
}

/// One ray. Lists have one entry per band.
#[derive(Clone, Debug, PartialEq)]
pub struct RayResult {
    /// Radiance that reaches the origin, in lx.
    pub radiance: Vec<f64>,
    /// e^(−optical depth).
    pub transmittance: Vec<f64>,
    /// ∫ (k_a + k_s) along the ray; may be infinite.
    pub optical_depth: Vec<f64>,
    /// Error of the radiance.
    pub error: Vec<f64>,
    /// As much of that as is rounding.
    pub rounding: Vec<f64>,
    /// Error of the optical depth.
    pub error_tau: Vec<f64>,
    /// What the errors are.
    pub error_kind: ErrorKind,
    /// Points at which fields were evaluated.
    pub evaluations: u64,
    /// False when `max_evaluations` ended the ray before its tolerance was met; the errors still hold.
    pub complete: bool,
}

/// A scene of one frame, ready to trace.
#[derive(Clone, Debug)]
pub struct Reference<'a, V: ?Sized> {
    scene: &'a FieldScene,
    voxels: &'a V,
    meshes: Option<&'a dyn Meshes>,
    splats: Option<World>,
    fields: Fields,
    bands: usize,
}

impl<'a, V: Voxels + ?Sized> Reference<'a, V> {
    /// Evaluates what depends on parameters and time, and compiles the fields. `params` are in the graph's units, one list
    /// per parameter of the scene; `time` is in seconds.
    ///
    /// # Errors
    /// `E0650` when a light has a negative strength; `E0651` when a shape or light has a value that is not finite; `E0654` when the parameters do not fit the scene.
    pub fn new(scene: &'a FieldScene, params: &[Vec<f64>], time: f64, voxels: &'a V) -> Result<Self, Diagnostic> {
        let widths = scene.graph.params.iter().map(|t| t.width() as usize);
        if params.len() != scene.graph.params.len() || !widths.zip(params).all(|(w, p)| w == p.len()) {
            let message = format!("the scene has {} params, other values were given", scene.graph.params.len());
            return Err(Diagnostic::error("E0654", message));
        }
        let bands = (scene.bands.count() as usize).clamp(1, BANDS);
        let fields = Fields::new(scene, params, time, voxels)?;
        Ok(Self { scene, voxels, meshes: None, splats: None, fields, bands })
    }

    /// With the triangles of the scene's meshes; without them a surface of triangles is not there.
    #[must_use]
    pub fn with_meshes(self, meshes: &'a dyn Meshes) -> Self {
        Self { meshes: Some(meshes), ..self }
    }

    /// With the splats of the scene, an entry for each item of them; without them there are none.
    #[must_use]
    pub fn with_splats(self, files: &[Arc<Splats>]) -> Self {
        let splats = (!files.is_empty()).then(|| World::new(self.scene, &self.fields.splats, files));
        Self { splats, ..self }
    }

    /// The splats as a camera sees them.
    fn project(&self, camera: &Camera) -> Option<Projected> {
        self.splats.as_ref().map(|world| Projected::new(world, camera))
    }

    /// Number of bands of every result.
    #[must_use]
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// Follows one ray from `origin` (in units of length) along `direction` (of any length but zero).
    ///
    /// # Errors
    /// A coefficient that is negative (`E0650`) or not finite (`E0651`) with its medium and place; a medium without end that
    /// cannot be integrated (`E0652`); a ray without direction (`E0654`).
    pub fn trace(&self, origin: Vec3, direction: Vec3, options: &Options) -> Result<RayResult, Diagnostic> {
        self.trace_with(&mut self.worker(), (origin, direction), None, options)
    }

    fn worker(&self) -> Worker<'_, V> {
        Worker::new(&self.fields, self.voxels, self.meshes, self.scene.units.length, self.bands)
    }

    fn trace_with(
        &self,
        worker: &mut Worker<'_, V>,
        (origin, direction): (Vec3, Vec3),
        pixel: Option<(&Projected, [f64; 2])>,
        options: &Options,
    ) -> Result<RayResult, Diagnostic> {
        let Some(direction) = normalize(direction).filter(|_| crate::frame::vector::is_finite(origin)) else {
            return Err(Diagnostic::error("E0654", "a ray needs a finite origin and a direction that is not zero"));
        };
        let ray = Ray::new(origin, direction, &self.fields.shells);
        worker.layers = match (pixel, &self.splats) {
            (Some((seen, at)), _) => seen.at(at, direction),
            (None, Some(world)) => world.along(origin, direction),
            (None, None) => vec![],
        };
        match self.scene.render.composite {
            Composite::Radiance => match self.scene.render.scattering {
                Scattering::None | Scattering::Single => worker.transfer(&ray, options),
                Scattering::Multiple => worker.paths(&ray, options, self.scene.render.samples),
            },
            composite @ (Composite::Maximum | Composite::Minimum | Composite::Average | Composite::Isosurface(_)) => {
                let value = match composite {
                    Composite::Isosurface(node) => self.fields.number(self.scene, node),
                    Composite::Radiance | Composite::Maximum | Composite::Minimum | Composite::Average => 0.0,
                };
                let behind = worker.background(&ray)?;
                worker.project(&ray, &behind, composite, value, options)
            }
        }
    }
}
