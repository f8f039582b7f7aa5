//! The handover from compiler to runtime: plain data.

mod forecast;
pub mod kernel;
mod ledger;
mod plan;
mod print;
mod reach;
mod verify_kernel;

pub use forecast::{Forecast, Outcome, print_forecasts};
pub(crate) use ledger::FILLED;
pub use ledger::{Ledger, Omission};
pub use plan::{
    AGAINST, ALONE, Binding, Blend, BricksPart, Draw, EMPTY, Extent, Fault, FillPass, FootprintLayout, FootprintShape,
    FrameValue, Geometry, HIDING, LightBuffer, ListPasses, MOST_BRICKS, MediumBounds, Narrow, Output, OutputKind, Pass,
    Plan, PlantPass, Precision, RaySource, SPANS, SPLAT_CUT, SortBuffer, SortPass, StepRule, Target, UniformField,
    UniformLayout, UniformSource, texture_prim,
};
pub use print::{print_graphviz, print_ir, print_ledger, print_plan, print_scene};
pub(crate) use reach::expressions;
pub use reach::{reached, used_resources, used_structs};
pub(crate) use verify_kernel::breaks;
pub use verify_kernel::{MAX_BLOCK_DEPTH, MAX_EXPRESSION_DEPTH, verify};

use crate::ir::{Bands, FieldScene};
use std::sync::Arc;

/// A compiled scene.
///
/// A kernel has at most [`Bands::TOGETHER`] bands. A picture of more is drawn in parts, each by a program of its own: this
/// one draws the first, [`Program::further`] the others. They share everything but what depends on the wavelength, so what
/// is asked of the scene's geometry, camera, parameters and schedule may be asked of the first.
#[derive(Clone, Debug)]
pub struct Program {
    /// The scene as lowered, for the reference engine: a wrong pass cannot hide there.
    pub lowered: FieldScene,
    /// The scene after the passes: what the plan's nodes refer to.
    pub optimised: FieldScene,
    /// The kernels that the plan's passes name. `emit` turns each into a shader.
    pub kernels: Vec<kernel::Kernel>,
    /// What to bind, fill and dispatch.
    pub plan: Plan,
    /// What each backend was predicted to need.
    pub forecasts: Vec<Forecast>,
    /// What was left out of all parts, and why. Empty in further parts.
    pub ledger: Ledger,
    /// Every band of the picture; a further part has its own alone.
    pub bands: Bands,
    /// Where each of them is drawn.
    pub places: Vec<BandPlace>,
    /// The other parts.
    pub further: Vec<Arc<Program>>,
}

/// Where a band of the picture is drawn.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct BandPlace {
    /// 0 for the program itself, i + 1 for `further[i]`.
    pub part: usize,
    /// Which of its bands.
    pub band: usize,
}

impl Program {
    /// A program of one part, from the scene as lowered and as optimised.
    #[must_use]
    pub fn new(
        (lowered, optimised): (FieldScene, FieldScene),
        kernels: Vec<kernel::Kernel>,
        plan: Plan,
        ledger: Ledger,
    ) -> Self {
        let bands = lowered.bands.clone();
        let places = (0..bands.wavelengths.len()).map(|band| BandPlace { part: 0, band }).collect();
        Self { lowered, optimised, kernels, plan, forecasts: vec![], ledger, bands, places, further: vec![] }
    }

    /// The program and its further parts.
    pub fn parts(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(self.further.iter().map(|p| &**p))
    }
}
