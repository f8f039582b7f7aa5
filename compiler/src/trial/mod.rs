//! Changes to a scene that put it to the test: what nobody writes, but what a param, a file or a slip of the pen may come to.
//!
//! A change is made once, before anything is built on the scene, and to the graph that the reference draws as well as to that
//! which the backends get, so that engines stay comparable. Lengths are changed in the checked scene, where every number
//! still has its dimension; the rest in the field graph.

mod lengths;
mod overlay;

pub(crate) use lengths::stretch;
pub(crate) use overlay::overlay;

/// What is changed.
#[derive(Copy, Clone, Debug, PartialEq)]
pub enum Change {
    /// All lengths times this: positions, sizes, wavelengths, and what is given per length. Radiance stays what it is. Grids and
    /// meshes are the loader's to stretch.
    Lengths(f64),
    /// Absorption, scattering and emission of every medium times this, but none above 1e30 in the scene's units.
    Matter(f64),
    /// Absorption and scattering of every medium times this, emission as it is.
    Extinction(f64),
    /// Henyey and Greenstein's phase function of this mean cosine in every medium.
    Asymmetry(f64),
    /// A white furnace: a background of 1 lx that shines from everywhere, and no other light; media scatter what they
    /// absorbed, surfaces are white. No pixel is brighter than 1 lx then, and with all orders of scattering each is 1 lx.
    Furnace,
}
