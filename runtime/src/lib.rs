//! Draws a compiled Tyndall program: volume readers, engines and picture writers.
//!
//! Takes what `compiler` hands over and never generates shader text.

pub mod data;
pub mod engine;
pub mod frame;
pub mod image;
pub mod report;
pub mod stress;
