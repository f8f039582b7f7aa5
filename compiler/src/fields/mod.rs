//! From field graph to kernel code: shared by all backends, so that a field means the same in each.
//!
//! A node of tier Frame or lower is never computed in a kernel: it is a literal, or a uniform that the host evaluates in
//! f64. Nodes of tier Ray are computed once per ray and handed to the functions of the media as arguments.

mod builder;
mod code;
mod helpers;
mod table;
mod volume;

pub use builder::{Code, KernelBuilder};
pub use code::{FieldFunction, PhaseFunction, Writer, field_function, phase_function};
pub use helpers::Helper;
