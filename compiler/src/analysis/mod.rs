//! Facts about graphs, never rewriting: what a backend may rely on.

pub mod affine;
pub mod closed;
pub mod feature;
pub mod interval;
pub mod jumps;
pub mod narrow;
pub mod range;
pub mod support;

use crate::ir::{Graph, NodeId, Op};

/// How an analysis adds a node that it derives, usually through the rules of the passes.
type Push<'a> = &'a mut dyn FnMut(&mut Graph, Op) -> NodeId;
