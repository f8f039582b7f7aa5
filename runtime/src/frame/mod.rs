//! Where rays come from: the camera, sub-pixel positions, and which pixels are checked. Shared by every engine.
//!
//! Pixel coordinates are continuous: (0, 0) is the top left corner of the picture, and pixel `(i, j)` has its centre at
//! `(i + ½, j + ½)`.

mod camera;
mod samples;
pub(crate) mod vector;

pub use camera::{Camera, View};
pub use samples::{sample_offsets, stratified_pixels};
pub use vector::Vec3;
