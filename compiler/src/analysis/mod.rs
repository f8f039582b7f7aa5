//! Facts about graphs, never rewriting: what a backend may rely on.

pub mod affine;
pub mod closed;
pub mod feature;
pub mod jumps;
pub mod range;
