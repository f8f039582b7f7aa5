//! What a caller can ask of a compilation beyond the scene, and what it gets.

use crate::diagnostic::Diagnostics;
use crate::ir::{Aa, Backend, Pixels, Scattering, Stacks};
use crate::program::{OutputKind, Precision, Program, RaySource};
use crate::source::Sources;
use crate::trial::Change;

/// Overrides of the scene's schedule, and what is to come out. None of it but [`Options::change`] changes what the scene means.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Where rays come from.
    pub rays: RaySource,
    /// What comes out of each ray; the plan says where in the record.
    pub outputs: Vec<OutputKind>,
    /// Instead of `render.backend`.
    pub backend: Option<Backend>,
    /// Instead of `render.steps`.
    pub steps: Option<u32>,
    /// Instead of `render.slices`.
    pub slices: Option<u32>,
    /// Instead of `render.stacks`.
    pub stacks: Option<Stacks>,
    /// Instead of `render.pixels`.
    pub pixels: Option<Pixels>,
    /// Instead of `render.splats`.
    pub splats: Option<u32>,
    /// Instead of `render.accuracy`; also drops `render.steps`, `.slices`, `.splats` and `.samples` unless they are given too.
    pub accuracy: Option<f64>,
    /// Instead of `render.scattering`.
    pub scattering: Option<Scattering>,
    /// Instead of `render.samples`.
    pub samples: Option<u32>,
    /// Instead of `image.size`.
    pub size: Option<[u32; 2]>,
    /// Instead of `image.aa`.
    pub aa: Option<Aa>,
    /// Leaves the bounds of media out: whoever has the voxels found that they tell nothing.
    pub unbounded: bool,
    /// What slabs of a picture are blended in.
    pub blending: Precision,
    /// A change that puts the scene to the test.
    pub change: Option<Change>,
}

impl Default for Options {
    /// A picture by the scene's own schedule: radiance, transmittance and error of each pixel.
    fn default() -> Self {
        Self {
            rays: RaySource::Camera,
            outputs: vec![OutputKind::Radiance, OutputKind::Transmittance, OutputKind::Error],
            backend: None,
            steps: None,
            slices: None,
            stacks: None,
            pixels: None,
            splats: None,
            accuracy: None,
            scattering: None,
            samples: None,
            size: None,
            aa: None,
            unbounded: false,
            blending: Precision::Single,
            change: None,
        }
    }
}

impl Options {
    /// For probes: a list of rays, and every quantity of the transfer equation.
    #[must_use]
    pub fn probe() -> Self {
        Self {
            rays: RaySource::List,
            outputs: vec![
                OutputKind::Radiance,
                OutputKind::Transmittance,
                OutputKind::OpticalDepth,
                OutputKind::Error,
                OutputKind::Evaluations,
            ],
            ..Self::default()
        }
    }
}

/// What a compilation makes: findings always, a program when there is no error.
#[derive(Clone, Debug)]
pub struct Compilation {
    /// Every text that was read, for rendering the diagnostics.
    pub sources: Sources,
    /// The findings.
    pub diagnostics: Diagnostics,
    /// The program, if nothing stopped the compilation.
    pub program: Option<Program>,
}
