//! Where a path next meets a medium.
//!
//! Each medium is a Poisson process of its own, and the nearest event of all counts. Where the optical depth has a closed form
//! it is inverted; elsewhere tentative events are drawn at the rate of a bound and are real with probability σ/bound (Woodcock
//! et al. 1965). Decisions follow one band, drawn for each path; the densities of all bands are kept beside, and what a path
//! brings is divided by their mean, which bounds its weight by the number of bands (Miller, Georgiev and Jarosz 2019).

use super::super::closed::Profile;
use super::super::field::{Ray, bad_coefficient, with_span};
use super::super::gauss::{N, Nodes};
use super::super::trace::{BANDS, LARGEST, PerBand, Worker};
use super::bound::Majorants;
use super::walk::Walk;
use crate::frame::vector::scale;
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;

/// k_a, k_s and k_e at some place.
pub(super) type Coefficients = [PerBand; 3];

/// A collision.
#[derive(Copy, Clone, Debug)]
pub(super) struct Event {
    pub(super) t: f64,
    pub(super) medium: usize,
    pub(super) k: Coefficients,
    /// Tentative events happen at this rate; none where the depth was inverted.
    bound: Option<f64>,
}

/// A tentative event that was none.
struct Null {
    t: f64,
    k: Coefficients,
    bound: f64,
}

/// A stretch whose depth is closed.
struct Run {
    profile: Profile,
    start: f64,
    end: f64,
}

impl Run {
    fn depth(&self, t: f64, band: usize) -> f64 {
        if t <= self.start { 0.0 } else { self.profile.depth(t.min(self.end) - self.start, band) }
    }
}

/// Tentative events on one stretch before a path is given up.
const MOST: u64 = 20_000_000;

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Coefficients of a medium at eight points of a ray.
    pub(super) fn coefficients(&mut self, m: usize, ray: &Ray, ts: &Nodes) -> Result<[Coefficients; N], Diagnostic> {
        let medium = &self.fields.media[m];
        let tape = &medium.field.sampler(true).tape;
        let scratch = &mut self.scratch[1][m];
        let mut out = [[[0.0; BANDS]; 3]; N];
        self.fields.run(tape, scratch, self.voxels, ray, ts, false);
        for (root, name) in ["k_a", "k_s", "k_e"].into_iter().enumerate() {
            let width = tape.width(root);
            for band in 0..self.bands {
                for (lane, value) in tape.component(scratch, root, band.min(width - 1)).iter().enumerate() {
                    if !(*value >= 0.0 && *value <= LARGEST) {
                        let place = scale(ray.at(ts[lane]), self.metre);
                        return Err(bad_coefficient(&medium.name, medium.span, name, value / self.metre, place));
                    }
                    out[lane][root][band] = *value;
                }
            }
        }
        self.evaluations += N as u64;
        Ok(out)
    }
}

impl<V: Voxels + ?Sized> Walk<'_, '_, V> {
    /// Follows a ray up to `reach`: the next collision, if there is one. The throughput and what was emitted on the way are
    /// brought up to there. `spans` are the stretches of each medium.
    pub(super) fn collide(
        &mut self,
        ray: &Ray,
        spans: &[Vec<(f64, f64)>],
        reach: f64,
    ) -> Result<Option<Event>, Diagnostic> {
        let fields = self.worker.fields;
        let mut best: Option<Event> = None;
        let (mut nulls, mut runs): (Vec<Null>, Vec<Run>) = (vec![], vec![]);
        for (m, medium) in fields.media.iter().enumerate() {
            for &(start, end) in &spans[m] {
                let last = best.map_or(reach, |b| b.t);
                if start >= last {
                    break;
                }
                let closed = medium.shade.as_ref().and_then(|s| s.closed.as_ref());
                let worker = &mut *self.worker;
                let profile =
                    closed.and_then(|c| c.profile(fields, worker.voxels, worker.closed[m].as_mut(), ray, start));
                match profile {
                    Some(profile) if !(medium.emits && end.is_finite()) => {
                        let run = Run { profile, start, end };
                        let x = run.profile.invert(self.random.depth(), last.min(end) - start, self.hero);
                        if let Some(x) = x {
                            let t = start + x;
                            let k = self.worker.coefficients(m, ray, &[t; N])?[0];
                            best = Some(Event { t, medium: m, k, bound: None });
                        }
                        runs.push(run);
                    }
                    profile => {
                        let length = end - start;
                        // Convex: largest at an end.
                        let own = profile.as_ref().map(|p| {
                            (0..self.worker.bands).map(|b| p.at(0.0, b).max(p.at(length, b))).fold(0.0, f64::max)
                        });
                        let own = own.map(Majorants::everywhere);
                        let bounds = own.as_ref().unwrap_or(&medium.bound);
                        let least = if medium.emits { 2.0 / length } else { 0.0 };
                        if let Some(event) = self.delta(ray, m, (start, end.min(last)), (bounds, least), &mut nulls)? {
                            best = Some(event);
                        }
                    }
                }
            }
        }
        let arrived = best.map_or(reach, |b| b.t);
        nulls.retain(|n| n.t < arrived);
        nulls.sort_by(|a, b| a.t.total_cmp(&b.t));
        for null in &nulls {
            if null.k[2].iter().any(|e| *e > 0.0) {
                self.emit(&null.k[2], null.bound, &self.dimmed(&runs, null.t));
            }
            let missed: PerBand = std::array::from_fn(|b| 1.0 - (null.k[0][b] + null.k[1][b]) / null.bound);
            self.path.times(&missed, &missed);
        }
        let dimmed = self.dimmed(&runs, arrived);
        self.path.times(&dimmed, &dimmed);
        if let Some(Event { k, bound, .. }) = &best {
            let sigma: PerBand = std::array::from_fn(|b| k[0][b] + k[1][b]);
            if k[2].iter().any(|e| *e > 0.0) {
                match bound {
                    Some(bound) => self.emit(&k[2], *bound, &[1.0; BANDS]),
                    None => {
                        let mut here = self.path;
                        here.times(&[1.0; BANDS], &sigma);
                        self.gain(&here, &k[2]);
                    }
                }
            }
            let share = sigma[self.hero];
            if !(share > 0.0) {
                // The closed form sees something where the field rounds to nothing: no light comes from there.
                self.path.times(&[0.0; BANDS], &[1.0; BANDS]);
                return Ok(best);
            }
            self.path.times(&k[1].map(|s| s / share), &sigma.map(|s| s / share));
        }
        Ok(best)
    }

    /// e^(−depth) of closed stretches up to `t`, relative to the band that decides.
    fn dimmed(&self, runs: &[Run], t: f64) -> PerBand {
        let mut out = [1.0; BANDS];
        let depth = |b: usize| runs.iter().map(|r| r.depth(t, b)).sum::<f64>();
        if self.worker.bands > 1 {
            let own = depth(self.hero);
            (0..self.worker.bands).for_each(|b| out[b] = if b == self.hero { 1.0 } else { (own - depth(b)).exp() });
        }
        out
    }

    /// Adds what is emitted at a tentative event.
    fn emit(&mut self, k_e: &PerBand, bound: f64, dimmed: &PerBand) {
        let mut here = self.path;
        here.times(dimmed, dimmed);
        self.gain(&here, &k_e.map(|e| e / bound));
    }

    /// The first real event of a medium on a stretch, at the rate of tentative ones that holds where the ray is, and at least
    /// at `least`.
    fn delta(
        &mut self,
        ray: &Ray,
        m: usize,
        (start, end): (f64, f64),
        (bounds, least): (&Majorants, f64),
        nulls: &mut Vec<Null>,
    ) -> Result<Option<Event>, Diagnostic> {
        let medium = &self.worker.fields.media[m];
        let refuse = || {
            let what = if end.is_finite() { "has no bound that can be shown" } else { "never ends along a path" };
            let message = format!("medium `{}` {what}, which multiple scattering needs", medium.name);
            with_span(Diagnostic::error("E0655", message), medium.span).hint(if end.is_finite() {
                "give it a bounded `shape`, or clamp what grows: `min(…, 10 /m)`"
            } else {
                "give it a bounded `shape`"
            })
        };
        if !end.is_finite() && bounds.most().max(least) > 0.0 {
            return Err(refuse());
        }
        let mut t = start;
        let mut count = 0;
        loop {
            let mut rates: Nodes = [0.0; N];
            let mut ts: Nodes = [f64::INFINITY; N];
            for (slot, rate) in ts.iter_mut().zip(&mut rates) {
                let Some(bound) = bounds.next(ray, &mut t, (end, least), &mut || self.random.depth()) else { break };
                if !bound.is_finite() {
                    return Err(refuse());
                }
                (*slot, *rate) = (t, bound);
            }
            if ts[0] >= end {
                return Ok(None);
            }
            let found = self.worker.coefficients(m, ray, &ts.map(|t| t.min(end)))?;
            for ((t, bound), k) in ts.into_iter().zip(rates).zip(found) {
                if t >= end {
                    return Ok(None);
                }
                let most = (0..self.worker.bands).map(|b| k[0][b] + k[1][b]).fold(0.0, f64::max);
                if most > bound * (1.0 + 1e-9) {
                    let place = scale(ray.at(t), self.worker.metre);
                    let message =
                        format!("the extinction of medium `{}` exceeds its bound at {place:?} m", medium.name);
                    return Err(with_span(Diagnostic::error("E0655", message), medium.span)
                        .hint("this is a mistake of the renderer: please report it with the scene"));
                }
                if self.random.unit() * bound < k[0][self.hero] + k[1][self.hero] {
                    return Ok(Some(Event { t, medium: m, k, bound: Some(bound) }));
                }
                nulls.push(Null { t, k, bound });
            }
            count += N as u64;
            if count > MOST {
                let message = format!("medium `{}` is too uneven for multiple scattering", medium.name);
                return Err(with_span(Diagnostic::error("E0655", message), medium.span)
                    .hint("split it into parts that are dense and parts that are not"));
            }
        }
    }
}
