//! Spheres of one size or of many: cross-sections and phase functions, averaged over sizes as their light adds up.
//!
//! Sizes follow a log-normal distribution of number, n(ln r) ∝ exp(−(ln r − ln r̃)²/(2 ln² s)), with the median radius r̃ and the
//! geometric standard deviation s (Hansen and Travis, Space Science Reviews 16, 1974). Sums over equal steps of ln r converge
//! faster than any power of the step for such weights, once the step resolves how the waves of a sphere interfere, except for
//! clear spheres, whose narrow resonances a lattice meets by chance. Steps are halved until nothing changes, or until the work
//! is not worth it, and what changed last is the stated error.

use super::sphere::Sphere;
use super::spline::{Spline, Warp};
use super::{LARGEST_TABULATED, SIZES};
use std::f64::consts::PI;

/// Relative change of the sums below which they have converged.
const CONVERGED: f64 = 2e-5;
/// Terms of series that may be summed to find the sizes, and again for the angles of a phase function: half a second or so.
const WORK: f64 = 3e8;
/// Weights below this part of the largest do not count.
const NEGLIGIBLE: f64 = 1e-7;
/// Standard deviations that are looked at on each side.
const REACH: f64 = 6.5;
/// Angles that must have converged while the sizes are found, beyond cross-sections.
const PROBES: usize = 48;
/// Steps between angles of a phase function, first.
const ANGLES: usize = 256;

/// What is known of the particles. Lengths in metres.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Particles {
    /// The radius, or the median of the radii by number.
    pub radius: f64,
    /// Real part of the index relative to what is around them.
    pub n: f64,
    /// Imaginary part, 0 or more: k of n + ik.
    pub k: f64,
    /// Geometric standard deviation of the radii, 1 or more.
    pub spread: f64,
}

/// Why there is no answer.
#[derive(Copy, Clone, Debug, PartialEq)]
pub enum EnsembleError {
    /// Some size parameter that matters lies outside of what is computed.
    Size(f64),
    /// The particles have the index of what is around them: they scatter nothing, so that no angle is special.
    Nothing,
}

/// Averages per particle, in square metres.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct CrossSections {
    /// Of scattering.
    pub scattering: f64,
    /// Of absorption.
    pub absorption: f64,
    /// Mean cosine of what is scattered.
    pub asymmetry: f64,
    /// Estimated relative error of the average over sizes; 0 for one size.
    pub error: f64,
}

/// A phase function, exact but for the average over sizes.
#[derive(Clone, Debug)]
pub struct Ensemble {
    /// Averages over the sizes.
    pub cross_sections: CrossSections,
    /// Estimated relative error of the average over sizes, at the worst angle.
    pub error: f64,
    shape: Shape,
}

#[derive(Clone, Debug)]
enum Shape {
    One(Sphere),
    Many(Spline, usize),
}

impl Ensemble {
    /// Averages the phase functions, weighted by how much each size scatters.
    ///
    /// # Errors
    /// [`EnsembleError::Size`] beyond [`super::LARGEST_TABULATED`], [`EnsembleError::Nothing`] where nothing is scattered.
    pub fn new(particles: &Particles, wavelength: f64) -> Result<Self, EnsembleError> {
        let sizes = Sizes::new(particles, wavelength, LARGEST_TABULATED)?;
        if sizes.is_one() {
            let sphere = Sphere::new(sizes.median, sizes.n, sizes.k);
            if !(sphere.q_scattering() > 0.0) {
                return Err(EnsembleError::Nothing);
            }
            let cross_sections = CrossSections::new(particles, wavelength)?;
            return Ok(Self { cross_sections, error: 0.0, shape: Shape::One(sphere) });
        }
        let warp = Warp(sizes.size(sizes.range.1).max(1.0));
        let (means, step, mut error) = sizes.converged(&warp.angles(PROBES));
        if !(means[SCATTERING] > 0.0) {
            return Err(EnsembleError::Nothing);
        }
        let mut count = ANGLES;
        let (mut values, mut work) = sizes.intensities(&warp.angles(count), step);
        loop {
            // How well every other value foretells those between; with all of them, an eighth of it at most.
            let halves = Spline::through(warp, &values.iter().copied().step_by(2).collect::<Vec<f64>>());
            let angles = warp.angles(count);
            let between = angles.iter().zip(&values).skip(1).step_by(2);
            let bend = between.map(|(t, v)| (halves.at(*t) / v - 1.0).abs()).fold(0.0, f64::max) / 8.0;
            if bend <= CONVERGED || 3.0 * work > WORK {
                error += bend;
                break;
            }
            count *= 2;
            let angles: Vec<f64> = warp.angles(count).into_iter().skip(1).step_by(2).collect();
            let (new, more) = sizes.intensities(&angles, step);
            work += more;
            let mut joined = vec![values[0]];
            joined.extend(new.iter().zip(&values[1..]).flat_map(|(a, b)| [*a, *b]));
            values = joined;
        }
        // |S|² over k² is the differential cross-section; x²Q means that of πr² = x²λ²/(4π).
        values.iter_mut().for_each(|v| *v /= PI * means[SCATTERING]);
        let shape = Shape::Many(Spline::through(warp, &values), count);
        Ok(Self { cross_sections: sizes.cross_sections(&means, error), error, shape })
    }

    /// The phase function at a cosine: 2π ∫ p dμ = 1, within the error.
    #[must_use]
    pub fn phase(&self, cosine: f64) -> f64 {
        match &self.shape {
            Shape::One(sphere) => sphere.phase(cosine),
            Shape::Many(spline, _) => {
                spline.at(2.0 * (1.0 - cosine).max(0.0).sqrt().atan2((1.0 + cosine).max(0.0).sqrt()))
            }
        }
    }

    /// The most half waves that it can have from 0 to 180 degrees.
    #[must_use]
    pub fn half_waves(&self) -> usize {
        match &self.shape {
            Shape::One(sphere) => 2 * sphere.modes().len(),
            Shape::Many(_, count) => count / 4,
        }
    }

    /// Terms that one value takes.
    pub(super) fn terms(&self) -> usize {
        match &self.shape {
            Shape::One(sphere) => sphere.modes().len(),
            Shape::Many(..) => 20,
        }
    }
}

impl CrossSections {
    /// Averages over the sizes.
    ///
    /// # Errors
    /// [`EnsembleError::Size`] beyond [`super::SIZES`].
    pub fn new(particles: &Particles, wavelength: f64) -> Result<Self, EnsembleError> {
        let sizes = Sizes::new(particles, wavelength, SIZES.1)?;
        let (means, _, error) = sizes.converged(&[]);
        Ok(sizes.cross_sections(&means, error))
    }

    /// Of extinction.
    #[must_use]
    pub fn extinction(&self) -> f64 {
        self.scattering + self.absorption
    }
}

/// Places in the vector of sums: x²·Q of scattering, of absorption, of scattering times g, then intensities.
const SCATTERING: usize = 0;
const ABSORPTION: usize = 1;
const ASYMMETRY: usize = 2;
const FIRST_ANGLE: usize = 3;

/// Size parameters in equal steps of their logarithm.
struct Sizes {
    n: f64,
    k: f64,
    /// Size parameter of the median, and ln s.
    median: f64,
    sigma: f64,
    /// The range of (ln x − ln median)/σ with weights that matter.
    range: (f64, f64),
    wavelength: f64,
}

impl Sizes {
    fn new(particles: &Particles, wavelength: f64, largest: f64) -> Result<Self, EnsembleError> {
        let Particles { radius, n, k, spread } = *particles;
        let median = 2.0 * PI * radius / wavelength;
        let sigma = spread.ln();
        let mut sizes = Self { n, k, median, sigma, range: (0.0, 0.0), wavelength };
        if sigma > 0.0 {
            sizes.range = sizes.relevant();
        }
        for t in [sizes.range.0, sizes.range.1] {
            let x = sizes.size(t);
            if !(SIZES.0..=largest).contains(&x) {
                return Err(EnsembleError::Size(x));
            }
        }
        Ok(sizes)
    }

    fn size(&self, t: f64) -> f64 {
        self.median * (self.sigma * t).exp()
    }

    /// Bounds on what a size adds to cross-sections, and to the forward peak, up to a constant: small spheres scatter as x⁶.
    fn weights(&self, t: f64) -> [f64; 2] {
        let (ln, density) = (self.median.ln() + self.sigma * t, -0.5 * t * t);
        let section = density + 2.0 * ln + (4.0 * ln).min(0.0);
        // Absorption falls as x³ only.
        let absorbed = density + 2.0 * ln + ln.min(0.0);
        [section.max(if self.k > 0.0 { absorbed } else { section }), section + 2.0 * ln.max(0.0)]
    }

    /// Where weights are not negligible.
    fn relevant(&self) -> (f64, f64) {
        let ends = (-REACH, REACH + 6.0 * self.sigma);
        let steps = 400;
        let at = |i: i32| ends.0 + (ends.1 - ends.0) * f64::from(i) / f64::from(steps);
        let all: Vec<(f64, [f64; 2])> = (0..=steps).map(|i| (at(i), self.weights(at(i)))).collect();
        let most = |i: usize| all.iter().map(|w| w.1[i]).fold(f64::NEG_INFINITY, f64::max);
        let (a, b) = (most(0) + NEGLIGIBLE.ln(), most(1) + NEGLIGIBLE.ln());
        let mut kept = all.iter().filter(|w| w.1[0] > a || w.1[1] > b).map(|w| w.0);
        let low = kept.next().unwrap_or(0.0);
        (low, kept.next_back().unwrap_or(low))
    }

    fn is_one(&self) -> bool {
        self.range.0 == self.range.1
    }

    /// Means of everything over the sizes, the step of their lattice, and the estimated relative error.
    fn converged(&self, angles: &[f64]) -> (Vec<f64>, f64, f64) {
        let cosines: Vec<f64> = angles.iter().map(|t| t.cos()).collect();
        let mut sums = vec![0.0; FIRST_ANGLE + cosines.len()];
        let (low, high) = self.range;
        if self.is_one() {
            self.add(low, &cosines, &mut sums);
            return (sums, 1.0, 0.0);
        }
        // The first lattice resolves the weights; each halving adds the points between.
        let mut step = 0.25_f64.min((high - low) / 8.0);
        let mut work = self.add_all(low, step, &cosines, &mut sums);
        let mut now = means(&sums, step);
        let limit = if angles.is_empty() { WORK / 2.0 } else { WORK };
        loop {
            work += self.add_all(low + 0.5 * step, step, &cosines, &mut sums);
            step *= 0.5;
            let next = means(&sums, step);
            let change = |(a, b): (&f64, &f64)| if *b > 0.0 { (a / b - 1.0).abs() } else { 0.0 };
            // The mean cosine may pass 0; it is as good as the cross-section.
            let [first, rest] = [0..ASYMMETRY, FIRST_ANGLE..now.len()];
            let error = first.chain(rest).map(|i| change((&now[i], &next[i]))).fold(0.0, f64::max);
            now = next;
            // With all the angles, the last lattice takes several times as long.
            let rest = if angles.is_empty() { 1.0 } else { 2.5 };
            if error <= CONVERGED || 2.0 * rest * work > limit {
                return (now, step, error);
            }
        }
    }

    /// Mean intensities at some angles, and the terms it took.
    fn intensities(&self, angles: &[f64], step: f64) -> (Vec<f64>, f64) {
        let cosines: Vec<f64> = angles.iter().map(|t| t.cos()).collect();
        let mut sums = vec![0.0; FIRST_ANGLE + cosines.len()];
        let work = self.add_all(self.range.0, step, &cosines, &mut sums);
        (means(&sums[FIRST_ANGLE..], step), work)
    }

    /// Adds the sizes of a lattice; returns the terms it took.
    fn add_all(&self, low: f64, step: f64, cosines: &[f64], sums: &mut [f64]) -> f64 {
        let count = ((self.range.1 - low) / step).floor() as usize + 1;
        (0..count).map(|i| self.add(low + step * i as f64, cosines, sums)).sum()
    }

    /// Adds one size.
    fn add(&self, t: f64, cosines: &[f64], sums: &mut [f64]) -> f64 {
        let x = self.size(t);
        let sphere = Sphere::new(x, self.n, self.k);
        let weight = (-0.5 * t * t).exp();
        let section = weight * x * x;
        sums[SCATTERING] += section * sphere.q_scattering();
        sums[ABSORPTION] += section * sphere.q_absorption();
        sums[ASYMMETRY] += section * sphere.q_scattering() * sphere.asymmetry();
        sphere.add_intensities(cosines, weight, &mut sums[FIRST_ANGLE..]);
        // A coefficient takes as long as about 100 terms at an angle.
        let inner = x * (self.n * self.n + self.k * self.k).sqrt();
        sphere.modes().len() as f64 * (cosines.len() + 100) as f64 + 20.0 * inner
    }

    fn cross_sections(&self, means: &[f64], error: f64) -> CrossSections {
        // πr² = x²·λ²/(4π)
        let area = self.wavelength * self.wavelength / (4.0 * PI);
        let asymmetry = if means[SCATTERING] > 0.0 { means[ASYMMETRY] / means[SCATTERING] } else { 0.0 };
        CrossSections { scattering: area * means[SCATTERING], absorption: area * means[ABSORPTION], asymmetry, error }
    }
}

/// ∫ exp(−t²/2) dt = √(2π), whatever part of it the range leaves out.
fn means(sums: &[f64], step: f64) -> Vec<f64> {
    sums.iter().map(|s| s * step / (2.0 * PI).sqrt()).collect()
}
