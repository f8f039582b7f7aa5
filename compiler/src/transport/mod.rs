//! Light along a ray, as kernel code: shared by every backend that follows rays, whole or in stretches, so that a scene
//! means the same in each.
//!
//! [`Scene`] is what must be known of a scene; [`Tracer`] writes the functions of a ray from it; [`rays`]
//! makes the rays of a camera or a list, [`edges`] finds silhouettes in pixels.

pub(crate) mod aim;
mod bricks;
mod bright;
mod cache;
mod closed;
pub(crate) mod edges;
mod endless;
mod exit;
pub(crate) mod half;
pub(crate) mod layers;
mod light;
mod march;
mod nodes;
mod matter;
mod media;
mod paths;
mod project;
pub(crate) mod rays;
pub(crate) mod records;
pub(crate) mod resolve;
mod rounded;
mod sample;
mod shapes;
mod sheets;
pub(crate) mod slab;
mod sides;
mod sky;
mod stride;
mod survey;
mod trace;
mod tracking;

use crate::program::OutputKind;

pub(crate) use endless::{endless, is_multiple};
pub(crate) use matter::Scene;
pub(crate) use rounded::HALF_ULP;
pub(crate) use trace::{Traced, Tracer, cut_short};

/// The name of an output in the shader.
pub(crate) fn output_name(kind: OutputKind) -> &'static str {
    match kind {
        OutputKind::Radiance => "radiance",
        OutputKind::Transmittance => "transmittance",
        OutputKind::OpticalDepth => "optical_depth",
        OutputKind::Error => "error",
        OutputKind::Rounding => "rounding",
        OutputKind::Storage => "storage",
        OutputKind::Evaluations => "evaluations",
        OutputKind::Fault => "fault",
        OutputKind::Edge => "edge",
    }
}
