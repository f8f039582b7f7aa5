//! What fields can be over whole regions: interval arithmetic on the graph, rounded outward in f64.
//!
//! [`Enclosure`] is compiled from some roots of a graph, as [`crate::ir::eval::Tape`] is, and evaluated over a
//! [`Region`]: a box of positions, ranges of directions, times and parameters. No value of the field within the region lies
//! outside its interval. Natural extension (every operation on intervals) is sharpened where a form is known that loses
//! less: squares and scalar products of a vector with itself, x − ⌊x⌋, polynomials in one variable by Bernstein's basis,
//! monotone functions at their ends, sines between their extremes, trilinear cells at the corners of the region, grids by
//! min–max pyramids of their voxels, tables by those of their rows, lattice noise by the hashes of the cells it can meet.

mod number;
mod pyramid;
mod tables;
mod tape;

pub use number::{Interval, MAX_TERMS, binary, compare, polynomial, power, unary};
pub(super) use pyramid::{CUBIC_OVERSHOOT, CUBIC_SLOPE};
pub use pyramid::{Extremes, NoExtremes, Pyramid, sample_gradient_range, sample_range};
pub use tables::TableBounds;
pub use tape::{Enclosure, Region, Workspace, altitudes};
