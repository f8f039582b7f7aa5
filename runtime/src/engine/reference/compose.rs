//! How solved panels add up along a ray, and what their errors do to the whole.

use super::panel::Slice;
use super::splats::veil::Veil;
use super::trace::{BANDS, PerBand};

/// A solved stretch, or a place where splats are.
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
    /// Splats that are blended as encoded numbers: what is behind them does not add to their light.
    pub(super) veil: Option<Veil>,
}

impl Panel {
    /// A stretch from a place on, of a length.
    pub(super) fn new((a, h): (f64, f64), segment: usize, slices: [Slice; BANDS]) -> Self {
        Self {
            a,
            h,
            segment,
            forced: 0,
            stalled: 0,
            parent: f64::INFINITY,
            plain: false,
            seam: [[0.0; 2]; BANDS],
            inner: [0.0; BANDS],
            slices,
            veil: None,
        }
    }

    pub(super) fn tau_error(&self, band: usize) -> f64 {
        self.slices[band].tau_error + self.seam[band][0]
    }

    pub(super) fn radiance_error(&self, band: usize) -> f64 {
        self.slices[band].radiance_error + self.seam[band][1]
    }

    pub(super) fn is_exact(&self, band: usize) -> bool {
        self.slices[band].exact && self.seam[band] == [0.0; 2]
    }

    /// The radiance before it, given that behind it.
    fn over(&self, behind: f64, band: usize) -> f64 {
        match &self.veil {
            None => self.slices[band].radiance + (-self.slices[band].tau).exp() * behind,
            Some(veil) => veil.over(behind, band),
        }
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
            beyond[b] = p.over(beyond[b], b);
        }
    }
    all
}

/// How much of a change of the radiance before each panel reaches the eye, given what arrives at their far ends, and at last
/// what reaches it from behind all.
pub(super) fn reaches(panels: &[Panel], arriving: &[PerBand], bands: usize) -> Vec<PerBand> {
    let mut all = vec![[1.0; BANDS]; panels.len() + 1];
    for b in 0..bands {
        let (mut tau, mut gain) = (Sum::default(), 1.0);
        for (i, p) in panels.iter().enumerate() {
            match &p.veil {
                None => tau.add(p.slices[b].tau),
                Some(veil) => gain *= veil.slope(arriving[i][b], b),
            }
            all[i + 1][b] = if gain > 0.0 { gain * (-tau.get()).exp() } else { 0.0 };
        }
    }
    all
}

/// What the errors of each panel do to the radiance: its own seen through what lies before it, and that of its depth on
/// everything behind it.
pub(super) fn weigh(panels: &[Panel], behind: &PerBand, bands: usize) -> Vec<PerBand> {
    let mut wrong = behind_each(panels, behind, bands);
    let reach = reaches(panels, &wrong, bands);
    for ((w, p), reach) in wrong.iter_mut().zip(panels).zip(reach) {
        for b in 0..bands {
            let s = &p.slices[b];
            let through = if p.veil.is_some() { 0.0 } else { (-s.tau).exp() * w[b] * p.tau_error(b) };
            w[b] = if reach[b] > 0.0 { reach[b] * (p.radiance_error(b) + through) } else { 0.0 };
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
    if panels.iter().any(|p| p.veil.is_some()) {
        // What veils let through depends on how much it is, so this goes from back to front.
        let arriving = behind_each(panels, behind, bands);
        for b in 0..bands {
            let mut tau = Sum::default();
            panels.iter().for_each(|p| tau.add(p.slices[b].tau));
            totals.tau[b] = tau.get();
            totals.radiance[b] = panels[0].over(arriving[0][b], b);
        }
        return totals;
    }
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
