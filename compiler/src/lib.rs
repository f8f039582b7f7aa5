//! The compiler of Tyndall, the language for light in matter: `.vol` text in, a `Program` out.
//!
//! A pure library: no files, clock, threads or environment, and no wgpu. Texts and grid headers come through [`loader::Loader`].

pub mod check;
pub mod diagnostic;
pub mod emit;
pub mod ir;
pub mod library;
pub mod loader;
pub mod lower;
mod options;
pub mod program;
pub mod resolve;
pub mod source;
pub mod syntax;
pub use options::{Compilation, Options};
pub mod analysis;
pub mod backends;
pub mod fields;
pub mod passes;
