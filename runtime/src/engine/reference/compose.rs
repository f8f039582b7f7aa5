//! How solved panels add up along a ray, and what their errors do to the whole.

use super::panel::Slice;
use super::trace::{BANDS, PerBand};

/// A solved stretch.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    pub(super) a: f64,
    pub(super) h: f64,
    pub(super) segment: usize,
    /// Divisions so far that events asked for.
    pub(super) forced: u8,
    /// Divisions in a row that gained little.
    pub(super) stalled: u8,
    /// Share of the tolerance that its parent had.
    pub(super) parent: f64,
    /// Its near end is where a stretch was divided for no reason in the fields: they should be continuous there.
    pub(super) plain: bool,
    /// What a jump at either end that no node has seen may add to the errors of depth and radiance.
    pub(super) seam: [[f64; 2]; BANDS],
    /// Error of the radiance by what its nodes were told wrong, which no division mends.
    pub(super) inner: PerBand,
    pub(super) slices: [Slice; BANDS],
}

impl Panel {
    pub(super) fn tau_error(&self, band: usize) -> f64 {
        self.slices[band].tau_error + self.seam[band][0]
    }

    pub(super) fn radiance_error(&self, band: usize) -> f64 {
        self.slices[band].radiance_error + self.seam[band][1]
    }

    pub(super) fn is_exact(&self, band: usize) -> bool {
        self.slices[band].exact && self.seam[band] == [0.0; 2]
    }

    /// Dividing it has not helped for long, and what is left looks like rounding.
    pub(super) fn is_exhausted(&self, bands: usize) -> bool {
        self.stalled >= 6
            && (0..bands).all(|b| {
                let (s, seam) = (&self.slices[b], &self.seam[b]);
                (s.noisy || s.exact) && seam[0] <= 1e-9 * s.tau && seam[1] <= 1e-9 * s.radiance
            })
    }
}

/// What each band of a whole ray comes to.
#[derive(Copy, Clone, Debug, Default)]
pub(super) struct Totals {
    pub(super) tau: PerBand,
    pub(super) radiance: PerBand,
}

/// Sum that keeps what rounding loses (Neumaier), also over infinities.
#[derive(Copy, Clone, Debug, Default)]
pub(super) struct Sum(f64, f64);

impl Sum {
    pub(super) fn add(&mut self, x: f64) {
        let s = self.0 + x;
        if s.is_finite() {
            self.1 += if self.0.abs() >= x.abs() { (self.0 - s) + x } else { (x - s) + self.0 };
        }
        self.0 = s;
    }

    pub(super) fn get(self) -> f64 {
        if self.0.is_finite() { self.0 + self.1 } else { self.0 }
    }
}

/// Radiance that arrives at the far end of each panel.
pub(super) fn behind_each(panels: &[Panel], behind: &PerBand, bands: usize) -> Vec<PerBand> {
    let mut all = vec![[0.0; BANDS]; panels.len()];
    let mut beyond = *behind;
    for (out, p) in all.iter_mut().zip(panels).rev() {
        *out = beyond;
        for b in 0..bands {
            beyond[b] = p.slices[b].radiance + (-p.slices[b].tau).exp() * beyond[b];
        }
    }
    all
}

/// What the errors of each panel do to the radiance: its own seen through what lies before it, and that of its depth on
/// everything behind it.
pub(super) fn weigh(panels: &[Panel], behind: &PerBand, bands: usize) -> Vec<PerBand> {
    let mut wrong = behind_each(panels, behind, bands);
    for b in 0..bands {
        let mut tau = Sum::default();
        for (w, p) in wrong.iter_mut().zip(panels) {
            let s = &p.slices[b];
            let reach = (-tau.get()).exp();
            w[b] =
                if reach > 0.0 { reach * (p.radiance_error(b) + (-s.tau).exp() * w[b] * p.tau_error(b)) } else { 0.0 };
            tau.add(s.tau);
        }
    }
    wrong
}

/// What hides between panels: where the interpolants on both sides of a mere division disagree, something jumps between the
/// last node of one and the first of the other, each at most a fiftieth of its panel away.
pub(super) fn seams(panels: &mut [Panel], bands: usize) {
    const UNSEEN: f64 = 0.02;
    panels.iter_mut().for_each(|p| p.seam = [[0.0; 2]; BANDS]);
    for i in 1..panels.len() {
        let (before, after) = panels.split_at_mut(i);
        let (p, q) = (&mut before[i - 1], &mut after[0]);
        if !q.plain || p.segment != q.segment {
            continue;
        }
        for b in 0..bands {
            let ([s0, j0], [s1, j1]) = (p.slices[b].far, q.slices[b].near);
            let beyond_noise = |x: f64, size: f64| if x.abs() <= 1e-12 * size.abs() { 0.0 } else { x };
            let (ds, dj) = (beyond_noise(s1 - s0, s0), beyond_noise(j1 - j0, j0));
            if ds == 0.0 && dj == 0.0 {
                continue;
            }
            let most = p.slices[b].radiance.max(q.slices[b].radiance);
            for side in [&mut *p, &mut *q] {
                let s = &side.slices[b];
                // A jump of σ with its source changes depth alone.
                let source = if s.tau > 0.0 { s.radiance / -(-s.tau).exp_m1() } else { 0.0 };
                side.seam[b][0] += UNSEEN * side.h * ds.abs();
                side.seam[b][1] += (UNSEEN * side.h * (dj - source * ds).abs()).min(most);
            }
        }
    }
}

/// Totals of solved panels in order.
pub(super) fn compose(panels: &[Panel], behind: &PerBand, bands: usize) -> Totals {
    let mut totals = Totals::default();
    for b in 0..bands {
        let (mut tau, mut radiance) = (Sum::default(), Sum::default());
        for p in panels {
            radiance.add((-tau.get()).exp() * p.slices[b].radiance);
            tau.add(p.slices[b].tau);
        }
        radiance.add((-tau.get()).exp() * behind[b]);
        totals.tau[b] = tau.get();
        totals.radiance[b] = radiance.get();
    }
    totals
}
