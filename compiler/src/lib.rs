//! The compiler of Tyndall, the language for light in matter: `.vol` text in, a [`program::Program`] out.
//!
//! A pure library: no files, clock, threads or environment, and no wgpu. Texts and grid headers come through
//! [`loader::Loader`]. The rooms, in the order in which a scene passes through them:

mod compile;
mod options;

/// Facts about graphs.
pub mod analysis;
/// Raymarching and its kin: kernels and plans.
pub mod backends;
/// Types and dimensions.
pub mod check;
/// The one diagnostic type, its codes and its rendering.
pub mod diagnostic;
/// Kernels to naga, WGSL and the other targets.
pub mod emit;
/// Fields as kernel code, for all backends.
pub mod fields;
/// The field graph: semantics, evaluation, derivatives.
pub mod ir;
/// The standard library, parsed once.
pub mod library;
/// How texts and grid headers come in.
pub mod loader;
/// Checked scene to field graph.
pub mod lower;
/// Graph and facts to a better graph.
pub mod passes;
/// What the runtime gets.
pub mod program;
/// Modules and names.
pub mod resolve;
/// Texts and spans.
pub mod source;
/// Text to syntax tree, and the one format.
pub mod syntax;

pub use compile::{check, check_scene, compile};
pub use options::{Compilation, Options};
