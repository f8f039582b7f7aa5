//! All orders of scattering: an unbiased path tracer in f64.
//!
//! Paths start at the eye. Distances are drawn without bias (`collide`), lights are looked for at every collision and bounce
//! along shadow rays whose transmittance is exact or drawn without bias (`shadow`); light of lamps in media also along each stretch by
//! the angle at the lamp, both weighted by the balance heuristic. The environment is met by paths that escape, and by nothing
//! else, so nothing counts twice. New directions follow the phase function (`phase`) or the cosine of a surface. A path that
//! carries little ends by chance.
//!
//! Samples fall into batches; the error is the standard error of the mean of their means. It rests on the batches alone, so a
//! rare event that no path has met is not in it.

pub(super) mod bound;
mod collide;
pub(super) mod phase;
mod random;
mod shadow;
mod walk;

use super::field::Ray;
use super::trace::{BANDS, PerBand, Worker};
use super::{ErrorKind, Options, RayResult};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;
pub(crate) use random::Random;
use walk::Walk;

/// Batches of every estimate.
const BATCHES: usize = 32;
/// Samples of a ray when nothing else is said.
const SAMPLES: u64 = 1 << 14;
/// Samples per batch before a standard error is believed.
const LEAST: u64 = 16;

/// Mean of the batches' means and its standard error.
fn estimate(sums: &[PerBand; BATCHES], count: u64, bands: usize) -> (PerBand, PerBand) {
    let (mut mean, mut error) = ([0.0; BANDS], [0.0; BANDS]);
    let n = BATCHES as f64;
    for b in 0..bands {
        let means = sums.map(|s| s[b] / count as f64);
        mean[b] = means.iter().sum::<f64>() / n;
        let spread = means.iter().map(|m| (m - mean[b]).powi(2)).sum::<f64>();
        error[b] = (spread / (n * (n - 1.0))).sqrt();
    }
    (mean, error)
}

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// The radiance along a ray, all orders of scattering included: until its standard error is within the tolerance, or for
    /// as many samples as are allowed.
    ///
    /// # Errors
    /// Fields without value; `E0655` for a medium that has no bound, or never ends and has no closed form.
    pub(super) fn paths(
        &mut self,
        ray: &Ray,
        options: &Options,
        samples: Option<u32>,
    ) -> Result<RayResult, Diagnostic> {
        let options = &self.begin(options);
        self.inner = 1e-8;
        let bands = self.bands;
        let wanted = options.samples.or(samples.map(u64::from)).unwrap_or(SAMPLES).max(1);
        let most = wanted.div_ceil(BATCHES as u64);
        let key = Random::key(ray.origin.iter().chain(&ray.direction).copied());
        let mut sums = [[0.0; BANDS]; BATCHES];
        let mut count = 0;
        let (mut mean, mut error);
        loop {
            // By halves more each time, so that looking costs little.
            let next = (count + (count / 2).max(LEAST)).min(most);
            for (batch, sum) in sums.iter_mut().enumerate() {
                for i in count..next {
                    let random = Random::new(options.seed, key, i * BATCHES as u64 + batch as u64);
                    let found = Walk::new(self, random).run(ray)?;
                    (0..bands).for_each(|b| sum[b] += found[b]);
                }
            }
            count = next;
            (mean, error) = estimate(&sums, count, bands);
            let met = (0..bands).all(|b| error[b] <= (options.rtol * mean[b]).max(options.atol));
            if met || count >= most {
                break;
            }
        }
        let hit = self.nearest(ray, f64::INFINITY)?;
        let depth = self.depth(ray, hit.map_or(f64::INFINITY, |h| h.t), options.rtol.max(1e-10))?;
        let floor = |b: usize| 1e-8 * mean[b];
        Ok(RayResult {
            radiance: mean[..bands].to_vec(),
            transmittance: depth.tau[..bands].iter().map(|t| (-t).exp()).collect(),
            optical_depth: depth.tau[..bands].to_vec(),
            // Depths that are not drawn are known to so much.
            error: (0..bands).map(|b| error[b] + floor(b)).collect(),
            rounding: (0..bands).map(|b| error[b].min(4.0 * f64::EPSILON * mean[b].abs())).collect(),
            error_tau: depth.error[..bands].to_vec(),
            error_kind: ErrorKind::StandardError,
            evaluations: self.evaluations,
            complete: true,
        })
    }
}
