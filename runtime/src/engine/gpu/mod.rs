//! Draws with wgpu on any adapter, software ones too. The only room that names wgpu.
//!
//! One open device ([`Gpu`]) takes compiled programs ([`Gpu::prepare`]) and draws them ([`Prepared::draw`]) or follows
//! lists of rays ([`Prepared::trace`]) through the same kernels. Parameters, time and camera are data: only pipelines
//! for another program compile anything. A picture is cut into tiles by the time that tiles take. Nothing here panics
//! for what a machine does: failures are [`GpuError`]s.

mod adapter;
mod draw;
mod errors;
mod pipelines;
mod readback;
mod resources;
mod sorting;
#[cfg(test)]
mod tests;
mod tiles;
mod uniforms;

pub use adapter::{AdapterChoice, AdapterKind, AdapterReport, Gpu, Needs, adapters};
pub use draw::{Arranging, Clock, PackedRay, Prepared, Tile, Timing};
pub use errors::{GpuError, GpuErrorKind};
pub use pipelines::cache_folder;
pub use resources::{GridData, SceneData};
