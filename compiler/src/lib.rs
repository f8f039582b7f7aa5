//! The compiler of Tyndall, the language for light in matter: `.vol` text in, a [`program::Program`] out.
//!
//! A pure library: no files, clock, threads or environment, and no wgpu. Texts and grid headers come through
//! [`loader::Loader`]. The rooms, in the order in which a scene passes through them:

mod compile;
mod options;

// Texts and spans.
pub mod source;
// The one diagnostic type, its codes and its rendering.
pub mod diagnostic;
// How texts and grid headers come in.
pub mod loader;
// Text to syntax tree, and the one format.
pub mod syntax;
// The standard library, parsed once.
pub mod library;
// Modules and names.
pub mod resolve;
// Types and dimensions.
pub mod check;
// Changes to a scene that put it to the test.
pub mod trial;
// Checked scene to field graph.
pub mod lower;
// The field graph: semantics, evaluation, derivatives.
pub mod ir;
// Facts about graphs.
pub mod analysis;
// Graph and facts to a better graph.
pub mod passes;
// Fields as kernel code, for all backends.
pub mod fields;
// Light along a ray as kernel code, for the backends that follow rays.
pub(crate) mod transport;
// Raymarching and its kin: kernels and plans.
pub mod backends;
// Kernels to naga, WGSL and the other targets.
pub mod emit;
// What the runtime gets.
pub mod program;

pub use compile::{check, check_scene, compile};
pub use options::{Compilation, Options};
