//! One sphere: coefficients, efficiencies, amplitudes.

use super::complex::Complex;
use std::f64::consts::PI;

/// A sphere and a wavelength. Everything follows from x and m.
#[derive(Clone, Debug)]
pub struct Sphere {
    x: f64,
    /// aₙ and bₙ for n = 1, 2, …
    modes: Vec<(Complex, Complex)>,
    scattering: f64,
    absorption: f64,
    asymmetry: f64,
}

/// Angles that are summed side by side.
const LANES: usize = 8;

/// Orders that matter. Wiscombe (Applied Optics 19, 1980) stops at x + 4.05 x^⅓ + 2, where |a|² is below 1e-14; amplitudes
/// matter here, because the light that goes back is 1e-10 of that which goes forward.
pub(super) fn orders(x: f64) -> usize {
    (x + 7.0 * x.cbrt() + 8.0) as usize
}

/// Downward recurrence of ρₙ(z) for n = 0 … `last`.
fn ratios(z: Complex, last: usize) -> Vec<Complex> {
    let size = z.norm().sqrt();
    let start = (size + 8.0 * size.cbrt()).max(last as f64) as usize + 24;
    let inverse = z.inverse();
    let mut ratio = Complex::ZERO;
    let mut all = vec![Complex::ZERO; last + 1];
    for n in (0..=start).rev() {
        ratio = (inverse.scale((2 * n + 3) as f64) - ratio).inverse();
        if n <= last {
            all[n] = ratio;
        }
    }
    all
}

/// ψₙ(x) and χₙ(x) for n = 0 … `last`, from the ratios of ψ.
fn riccati_bessel(x: f64, last: usize, ratios: &[Complex]) -> (Vec<f64>, Vec<f64>) {
    let (mut psi, mut chi) = (vec![x.sin()], vec![x.cos()]);
    let (mut before_psi, mut before_chi) = (x.cos(), -x.sin());
    for n in 0..last {
        let factor = (2 * n + 1) as f64 / x;
        let next = if (n + 1) as f64 <= x { factor * psi[n] - before_psi } else { ratios[n].re * psi[n] };
        before_psi = psi[n];
        psi.push(next);
        let next = factor * chi[n] - before_chi;
        before_chi = chi[n];
        chi.push(next);
    }
    (psi, chi)
}

impl Sphere {
    /// `x` within [`super::SIZES`], n > 0 and k ≥ 0. With the index of what is around it (n = 1, k = 0) it does nothing.
    #[must_use]
    pub fn new(x: f64, n: f64, k: f64) -> Self {
        let m = Complex::new(n, k);
        let last = orders(x);
        let inside = ratios(m.scale(x), last);
        let outside = ratios(Complex::real(x), last);
        let (psi, chi) = riccati_bessel(x, last, &outside);
        let inverse = m.inverse();
        let square = inverse * inverse;
        // (1 − m²)/m² from its factors, which keeps the digits of m near 1.
        let contrast = Complex::new(1.0 - n, -k) * Complex::new(1.0 + n, k) * square;
        let mut sphere = Self { x, modes: Vec::with_capacity(last), scattering: 0.0, absorption: 0.0, asymmetry: 0.0 };
        let one_over_x = 1.0 / x;
        for i in 1..=last {
            let nth = i as f64;
            let rho = inside[i];
            // D(mx)/m + n/x and m·D(mx) + n/x
            let u = square.scale((nth + 1.0) * one_over_x) - rho * inverse + Complex::real(nth * one_over_x);
            let v = Complex::real((2.0 * nth + 1.0) * one_over_x) - m * rho;
            let (over_a, over_b) = if contrast == Complex::ZERO {
                (Complex::ZERO, Complex::ZERO)
            } else if nth < x {
                (u.scale(psi[i]) - Complex::real(psi[i - 1]), v.scale(psi[i]) - Complex::real(psi[i - 1]))
            } else {
                let ratio = Complex::real(outside[i].re);
                let a = contrast.scale((nth + 1.0) * one_over_x) - rho * inverse + ratio;
                (a.scale(psi[i]), (ratio - m * rho).scale(psi[i]))
            };
            let mode = |over: Complex, factor: Complex| {
                let c = factor.scale(chi[i]) - Complex::real(chi[i - 1]);
                // over − i·c
                let under = Complex::new(over.re + c.im, over.im - c.re).inverse();
                (over * under, (-factor.im * under.norm()).max(0.0))
            };
            let ((a, lost_a), (b, lost_b)) = (mode(over_a, u), mode(over_b, v));
            let weight = 2.0 * nth + 1.0;
            sphere.scattering += weight * (a.norm() + b.norm());
            sphere.absorption += weight * (lost_a + lost_b);
            sphere.asymmetry += weight / (nth * (nth + 1.0)) * (a * b.conj()).re;
            if let Some((c, d)) = sphere.modes.last() {
                let l = nth - 1.0;
                sphere.asymmetry += l * (l + 2.0) / (l + 1.0) * ((*c * a.conj()).re + (*d * b.conj()).re);
            }
            sphere.modes.push((a, b));
        }
        let scale = 2.0 * one_over_x * one_over_x;
        sphere.asymmetry = if sphere.scattering > 0.0 { 2.0 * sphere.asymmetry / sphere.scattering } else { 0.0 };
        sphere.scattering *= scale;
        sphere.absorption *= scale;
        sphere
    }

    /// Cross-section of scattering over πr².
    #[must_use]
    pub fn q_scattering(&self) -> f64 {
        self.scattering
    }

    /// Cross-section of absorption over πr²; exactly 0 for k = 0.
    #[must_use]
    pub fn q_absorption(&self) -> f64 {
        self.absorption
    }

    /// Cross-section of extinction over πr².
    #[must_use]
    pub fn q_extinction(&self) -> f64 {
        self.scattering + self.absorption
    }

    /// 4|S(180°)|²/x²: what a radar sees, over πr².
    #[must_use]
    pub fn q_back(&self) -> f64 {
        4.0 / (self.x * self.x) * self.amplitudes(-1.0).0.norm()
    }

    /// Mean cosine of the scattering angle, g.
    #[must_use]
    pub fn asymmetry(&self) -> f64 {
        self.asymmetry
    }

    /// aₙ and bₙ, n = 1, 2, …
    #[must_use]
    pub fn modes(&self) -> &[(Complex, Complex)] {
        &self.modes
    }

    /// S₁ (perpendicular) and S₂ (parallel to the plane of scattering) at a cosine.
    #[must_use]
    pub fn amplitudes(&self, cosine: f64) -> (Complex, Complex) {
        let [[re1], [im1], [re2], [im2]] = self.sums([cosine]);
        (Complex::new(re1, im1), Complex::new(re2, im2))
    }

    /// (|S₁|² + |S₂|²)/2: intensity of unpolarised light. The differential cross-section is this times (λ/2π)².
    #[must_use]
    pub fn intensity(&self, cosine: f64) -> f64 {
        let (s1, s2) = self.amplitudes(cosine);
        0.5 * (s1.norm() + s2.norm())
    }

    /// Adds intensities at many cosines, times a weight.
    pub(super) fn add_intensities(&self, cosines: &[f64], weight: f64, sums: &mut [f64]) {
        for (cosines, sums) in cosines.chunks(LANES).zip(sums.chunks_mut(LANES)) {
            let mut lanes = [0.0; LANES];
            lanes[..cosines.len()].copy_from_slice(cosines);
            let [re1, im1, re2, im2] = self.sums(lanes);
            for (i, sum) in sums.iter_mut().enumerate() {
                let twice = re1[i] * re1[i] + im1[i] * im1[i] + re2[i] * re2[i] + im2[i] * im2[i];
                *sum += 0.5 * weight * twice;
            }
        }
    }

    /// Real and imaginary parts of S₁ and S₂ at some cosines side by side: each waits for its own last term alone.
    fn sums<const N: usize>(&self, cosines: [f64; N]) -> [[f64; N]; 4] {
        let [mut re1, mut im1, mut re2, mut im2] = [[0.0; N]; 4];
        let (mut pi, mut before) = ([1.0; N], [0.0; N]);
        let mut n = 1.0;
        for (a, b) in &self.modes {
            // (2n + 1)/(n(n + 1)) and (n + 1)/n.
            let inverse = 1.0 / (n * (n + 1.0));
            let weight = (2.0 * n + 1.0) * inverse;
            let growth = (n + 1.0) * (n + 1.0) * inverse;
            let (a, b) = (a.scale(weight), b.scale(weight));
            for i in 0..N {
                // Wiscombe's form of τ and of the next π.
                let s = cosines[i] * pi[i];
                let t = s - before[i];
                let tau = n * t - before[i];
                re1[i] += a.re * pi[i] + b.re * tau;
                im1[i] += a.im * pi[i] + b.im * tau;
                re2[i] += a.re * tau + b.re * pi[i];
                im2[i] += a.im * tau + b.im * pi[i];
                before[i] = pi[i];
                pi[i] = s + growth * t;
            }
            n += 1.0;
        }
        [re1, im1, re2, im2]
    }

    /// The phase function of unpolarised light: 2π ∫ p dμ = 1.
    #[must_use]
    pub fn phase(&self, cosine: f64) -> f64 {
        self.intensity(cosine) / (PI * self.x * self.x * self.scattering)
    }
}
