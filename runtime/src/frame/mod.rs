//! Where rays come from: the camera, sub-pixel positions, and which pixels are checked. Shared by every engine.
//!
//! Pixel coordinates are continuous: (0, 0) is the top left corner of the picture, and pixel `(i, j)` has its centre at
//! `(i + ½, j + ½)`.

mod bounds;
mod bricks;
mod camera;
mod extremes;
mod eye;
mod faults;
mod findings;
pub(crate) mod footprints;
mod half;
mod lattice;
mod loader;
mod measure;
mod params;
mod paths;
mod placed;
mod rises;
mod samples;
mod session;
mod slabs;
#[cfg(test)]
mod tests;
mod values;
pub(crate) mod vector;

pub use bounds::{Ball, scene_bounds};
pub(crate) use bounds::{bounded_media, shells};
pub use bricks::{Bricks, Nothing};
pub use camera::{Camera, View};
pub use extremes::Grids;
pub use eye::{Eye, Frame, pack_ray, white};
pub use faults::FaultTally;
pub use findings::findings;
pub use footprints::{Cast, Footprints, Projected};
pub use half::{HalfAngle, LightNodes, Shining};
pub use lattice::Lattice;
pub use loader::{FileLoader, Loaded, LoadedMesh, LoadedSplats, STDIN, SceneFiles};
pub(crate) use measure::{COVERAGE, difference};
pub use measure::{Measured, Origins};
pub use params::Params;
pub(crate) use params::with_unit;
pub(crate) use placed::{Placed, placed};
pub(crate) use samples::splitmix;
pub use samples::{sample_offsets, stratified_pixels};
pub(crate) use session::TOO_LONG;
pub use session::{Cause, Drawing, EngineChoice, ProbeSettings, RayAnswer, RayQuery, Session, Settings, Trouble};
pub use slabs::{Slabs, Turn};
pub(crate) use values::{AT_MOST_ONE, GAIN, to_f32};
pub use vector::Vec3;
