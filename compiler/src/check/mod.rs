//! Types and dimensions: the only room that knows units.

pub mod hir;
