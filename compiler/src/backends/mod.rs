//! Backends: field graph and facts in, kernels and a plan out. None imports another.

pub mod raymarch;
pub mod slicing;
pub mod splatting;

use crate::Options;
use crate::diagnostic::Diagnostics;
use crate::ir::{Backend, FieldScene};
use crate::program::{Ledger, Plan, kernel::Kernel};

/// What a backend makes of a scene. It may add nodes to the scene that its plan names.
pub type Build = fn(&mut FieldScene, &Options, &mut Ledger, &mut Diagnostics) -> Option<(Vec<Kernel>, Plan)>;

/// Every backend, by the word of the language. Adding one is a line here.
pub const REGISTRY: [(Backend, &str, Build); 3] = [
    (Backend::Raymarch, "raymarch", raymarch::build),
    (Backend::Slicing, "slicing", slicing::build),
    (Backend::Splatting, "splatting", splatting::build),
];
