//! Scattering of light by spheres: the theory of Lorenz (1890) and Mie (1908), exact for any size and index. Numbers only.
//!
//! Notation of Bohren and Huffman, *Absorption and Scattering of Light by Small Particles* (1983), chapter 4: size parameter
//! x = 2πr/λ, relative index m = n + i·k with k ≥ 0 where light is absorbed, time factor e^(−iωt).
//!
//! # Why it is computed as it is
//! The textbook form of the coefficients, a = (u ψₙ − ψₙ₋₁)/(u ξₙ − ξₙ₋₁), cancels for orders beyond the size parameter, and
//! with it everything that is made of small coefficients: b₁ and g of small spheres, absorption by nearly clear ones.
//! - Ratios ρₙ(z) = ψₙ₊₁(z)/ψₙ(z) are computed downwards, ρₙ = 1/((2n + 3)/z − ρₙ₊₁), which is stable for every z. The
//!   logarithmic derivative is Dₙ(z) = (n + 1)/z − ρₙ(z).
//! - Beyond n = x the numerators are ψₙ·[(n + 1)(1 − m²)/(m²x) − ρₙ(mx)/m + ρₙ(x)] for a and ψₙ·[ρₙ(x) − m ρₙ(mx)] for b,
//!   whose leading terms have been cancelled by hand: Rayleigh's limit needs no series of its own.
//! - ψ goes upwards as far as n = x and from there by its ratios; χ is stable upwards.
//! - What a mode absorbs, Re a − |a|², is −Im u / |u ξₙ − ξₙ₋₁|² by the Wronskian ψₙ₋₁χₙ − ψₙχₙ₋₁ = 1: no difference of
//!   nearly equal numbers, and exactly 0 for k = 0.

mod complex;
mod ensemble;
mod sphere;
mod spline;
mod table;

pub use complex::Complex;
pub use ensemble::{CrossSections, Ensemble, EnsembleError, Particles};
pub use sphere::Sphere;
pub use table::{PhaseTable, key_of_cosine, tabulate};

/// Size parameters that are taken: beyond, nothing of what light does to a sphere is computed here.
pub const SIZES: (f64, f64) = (1e-6, 1e5);
/// The largest size parameter of a tabulated phase function.
pub const LARGEST_TABULATED: f64 = 1e4;
