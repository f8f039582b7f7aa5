//! Closed forms, invariances and stiff cases, through scenes built node by node.

mod build;
mod closed;
mod grids;
mod paths;
mod project;
mod single;
mod stiff;
mod surfaces;
