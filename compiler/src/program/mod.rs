//! The handover from compiler to runtime: plain data.

pub mod kernel;
mod ledger;
mod plan;
mod print;
mod reach;
mod verify_kernel;

pub use ledger::{Ledger, Omission};
pub use plan::{
    Binding, Blend, Extent, Fault, FillPass, FrameValue, Geometry, Output, OutputKind, Pass, Plan, PlantPass,
    RaySource, SPLAT_CUT, StepRule, Target, UniformField, UniformLayout, UniformSource, texture_prim,
};
pub use print::{print_graphviz, print_ir, print_ledger, print_plan, print_scene};
pub(crate) use reach::expressions;
pub use reach::{reached, used_resources, used_structs};
pub(crate) use verify_kernel::breaks;
pub use verify_kernel::{MAX_BLOCK_DEPTH, MAX_EXPRESSION_DEPTH, verify};

use crate::ir::FieldScene;

/// A compiled scene.
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
    /// What was left out, and why.
    pub ledger: Ledger,
}
