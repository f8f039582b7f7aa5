//! Dividing panels until a ray is within its tolerance, and summing what is wrong with it then.

use super::compose::{Panel, behind_each, compose, reaches, seams, weigh};
use super::field::Ray;
use super::panel::phi;
use super::scatter::Behind;
use super::tail::Rest;
use super::trace::{BANDS, PerBand, Segment, Worker};
use super::{ErrorKind, Goal, Options, RayResult};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Divides the panels that spoil the result until its error is within the tolerance. Whether it is (or nothing more can
    /// be gained in f64).
    pub(super) fn refine(
        &mut self,
        ray: &Ray,
        segments: &[Segment],
        panels: &mut Vec<Panel>,
        behind: &PerBand,
        rest: &Rest,
        options: &Options,
    ) -> Result<bool, Diagnostic> {
        let bands = self.bands;
        let mut shares: Vec<f64> = vec![];
        loop {
            seams(panels, bands);
            let totals = compose(panels, behind, bands);
            shares.clear();
            for (panel, wrong) in panels.iter().zip(weigh(panels, behind, bands)) {
                let mut share = 0.0f64;
                for b in (0..bands).filter(|b| !panel.is_exact(*b)) {
                    let allowed = (options.rtol * totals.radiance[b]).max(options.atol).max(1e-300);
                    share = share.max(wrong[b] / allowed);
                    let tau = totals.tau[b];
                    if options.goal == Goal::All && tau.is_finite() && !rest.infinite[b] {
                        let allowed = options.rtol * if tau < 745.0 { tau.min(1.0) } else { tau };
                        share = share.max(panel.tau_error(b) / allowed.max(1e-300));
                    }
                }
                shares.push(share);
            }
            let total: f64 = shares.iter().sum();
            if total <= 1.0 {
                return Ok(true);
            }
            if self.evaluations > options.max_evaluations {
                return Ok(false);
            }
            let mut order: Vec<usize> = (0..panels.len()).collect();
            order.sort_by(|a, b| shares[*b].total_cmp(&shares[*a]));
            let mut left = total;
            let mut divide = vec![false; panels.len()];
            let mut any = false;
            for i in order {
                if left <= 0.5 || shares[i] <= 0.0 {
                    break;
                }
                left -= shares[i];
                let p = &panels[i];
                if !p.is_exhausted(bands) && p.h.is_finite() && p.h > 8.0 * f64::EPSILON * p.a.abs() && p.h > 1e-290 {
                    divide[i] = true;
                    any = true;
                }
            }
            if !any {
                return Ok(true);
            }
            let old = std::mem::take(panels);
            let mut front = [0.0; BANDS];
            for (i, p) in old.into_iter().enumerate() {
                let before = front;
                (0..bands).for_each(|b| front[b] += p.slices[b].tau);
                if !divide[i] {
                    panels.push(p);
                    continue;
                }
                self.front = before;
                let half = 0.5 * p.h;
                let stalled = if shares[i] > 0.4 * p.parent { p.stalled + 1 } else { 0 };
                for (a, plain) in [(p.a, p.plain), (p.a + half, true)] {
                    let first = panels.len();
                    self.build(ray, segments, p.segment, (a, half, p.forced, plain), panels)?;
                    for child in &mut panels[first..] {
                        child.stalled = stalled;
                        child.parent = shares[i];
                    }
                }
            }
        }
    }

    /// The result with its errors summed.
    pub(super) fn finish(&self, panels: &[Panel], beyond: &Behind, rest: &Rest, complete: bool) -> RayResult {
        let bands = self.bands;
        let behind = &beyond.radiance;
        let totals = compose(panels, behind, bands);
        let mut closed = rest.exact && !beyond.rough;
        let (mut wrong, mut wrong_tau, mut rounded) = ([0.0; BANDS], [0.0; BANDS], [0.0; BANDS]);
        let arriving = behind_each(panels, behind, bands);
        let weights = weigh(panels, behind, bands);
        let reach = reaches(panels, &arriving, bands);
        for b in 0..bands {
            // What dividing does not help is noise of the fields.
            let mut noise = 0.0;
            for (p, w) in panels.iter().zip(&weights) {
                wrong[b] += w[b];
                if p.is_exact(b) || p.is_exhausted(bands) {
                    noise += w[b];
                }
                wrong_tau[b] += p.tau_error(b);
                closed &= p.is_exact(b);
            }
            // Where a medium begins or ends is rounded relative to its distance: dL/dt there is ±T·σ·(S − L).
            for (i, p) in panels.iter().enumerate() {
                let s = &p.slices[b];
                let starts = i == 0 || panels[i - 1].segment != p.segment;
                let ends = panels.get(i + 1).is_none_or(|q| q.segment != p.segment);
                let place = if ends { p.a + p.h } else { p.a };
                let share = 4.0 * f64::EPSILON * place / p.h;
                if (starts || ends) && p.h > 0.0 && p.h.is_finite() && s.tau.is_finite() {
                    wrong_tau[b] += s.tau * share;
                    let contrast = (s.radiance / phi(s.tau) - s.tau * arriving[i][b]).abs();
                    rounded[b] += reach[i][b] * (-s.tau).exp() * share * contrast;
                }
                wrong[b] += reach[i][b] * p.inner[b];
            }
            let tau = if rest.infinite[b] { f64::INFINITY } else { totals.tau[b] };
            let rounding = 4.0 * f64::EPSILON;
            rounded[b] += rounding * totals.radiance[b];
            wrong[b] += rest.radiance[b] + rounded[b] + self.moved;
            rounded[b] += noise;
            let last = if rest.infinite[b] { 0.0 } else { reach[panels.len()][b] };
            wrong[b] += last * (behind[b] * rest.tau[b] + beyond.wrong[b]);
            wrong_tau[b] = if tau.is_finite() { wrong_tau[b] + rest.tau[b] + rounding * tau } else { 0.0 };
        }
        let optical_depth: Vec<f64> =
            (0..bands).map(|b| if rest.infinite[b] { f64::INFINITY } else { totals.tau[b] }).collect();
        RayResult {
            radiance: totals.radiance[..bands].to_vec(),
            transmittance: optical_depth.iter().map(|t| (-t).exp()).collect(),
            optical_depth,
            error: wrong[..bands].to_vec(),
            rounding: rounded[..bands].to_vec(),
            error_tau: wrong_tau[..bands].to_vec(),
            error_kind: if closed { ErrorKind::Bound } else { ErrorKind::Estimate },
            evaluations: self.evaluations,
            complete,
        }
    }
}
