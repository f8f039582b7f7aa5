//! Optical depth alone, along rays to lights: closed forms where media have them, else adaptive panels.
//!
//! Depths of overlapping media add up, so each medium is integrated on its own over the stretches where it is. Light that has
//! crossed a depth beyond which e^(−τ) is 0 in f64 is gone, whatever comes after.

use super::field::{Ray, Sampler, bad_coefficient, with_span};
use super::gauss::{Decay, N, Nodes, RULE};
use super::split::{cuts_of, sort_splits, splits_of, thin};
use super::trace::{BANDS, LARGEST, MOST, PerBand, Worker};
use crate::frame::vector::scale;
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;

/// Depth beyond which nothing is seen: e^−760 is 0 in f64.
pub(super) const DARK: f64 = 760.0;
/// First octave of a stretch without end, in units.
const FIRST: f64 = 1.0 / 1024.0;
/// Nothing is concluded from decay before this distance, in units: a medium may begin far away.
const NEAR: f64 = 1_048_576.0;
/// Beyond this distance the search ends.
const FAR: f64 = 1e12;
/// Panels of one stretch beyond which it is taken as it is.
const PIECES: usize = 20_000;

/// Optical depth with its error, per band.
#[derive(Copy, Clone, Debug, Default)]
pub(super) struct Depth {
    /// May be infinite.
    pub(super) tau: PerBand,
    pub(super) error: PerBand,
}

impl Depth {
    pub(super) fn is_dark(&self, bands: usize) -> bool {
        self.tau[..bands].iter().all(|t| *t > DARK)
    }

    fn add(&mut self, other: &Self) {
        for b in 0..BANDS {
            self.tau[b] += other.tau[b];
            self.error[b] += other.error[b];
        }
    }

    /// e^(−τ), and by how much it may be wrong.
    pub(super) fn transmittance(&self, band: usize) -> (f64, f64) {
        let (tau, error) = (self.tau[band], self.error[band]);
        let t = (-tau).exp();
        // What rounding makes of a place inside something dense may be more than the whole depth.
        (t, if error < 0.5 { t * error.exp_m1() } else { (-(tau - error).max(0.0)).exp() - t })
    }

    /// The same, with the place from which it is measured uncertain by depths of `blur`.
    pub(super) fn blurred(mut self, blur: &PerBand) -> Self {
        (0..BANDS).for_each(|b| self.error[b] += blur[b]);
        self
    }
}

/// A solved stretch.
struct Piece {
    a: f64,
    h: f64,
    forced: u8,
    depth: Depth,
}

impl Piece {
    fn error(&self, bands: usize) -> f64 {
        self.depth.error[..bands].iter().fold(0.0, |m, e| m.max(*e))
    }
}

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Optical depth of all media from the origin of a ray to `reach`, which may be infinite, to an absolute tolerance.
    ///
    /// # Errors
    /// A coefficient without value; a medium without end that cannot be integrated.
    pub(super) fn depth(&mut self, ray: &Ray, reach: f64, tolerance: f64) -> Result<Depth, Diagnostic> {
        let fields = self.fields;
        let mut total = Depth::default();
        for (m, medium) in fields.media.iter().enumerate() {
            if medium.shade.is_none() {
                continue;
            }
            let (one, list);
            let inside: &[(f64, f64)] = match medium.solid.span(ray.origin, ray.direction) {
                Some(None) => &[],
                Some(Some(span)) => {
                    one = [span];
                    &one
                }
                None => {
                    list = self.intervals(&medium.solid, ("medium", &medium.name, medium.span), ray)?;
                    &list.0
                }
            };
            for &(a, b) in inside {
                let b = b.min(reach);
                if a >= b {
                    break;
                }
                let part = self.part(ray, m, (a, b), tolerance)?;
                total.add(&part);
                if total.is_dark(self.bands) {
                    return Ok(total);
                }
            }
        }
        Ok(total)
    }

    /// Optical depth of one medium over a stretch within it, which may be endless.
    ///
    /// # Errors
    /// Those of [`Worker::depth`].
    pub(super) fn part(
        &mut self,
        ray: &Ray,
        m: usize,
        (a, b): (f64, f64),
        tolerance: f64,
    ) -> Result<Depth, Diagnostic> {
        let fields = self.fields;
        let closed = fields.media[m].shade.as_ref().and_then(|s| s.closed.as_ref());
        let closed =
            closed.and_then(|c| c.depth(fields, self.voxels, self.closed[m].as_mut(), ray, (a, b), self.bands));
        Ok(match closed {
            Some(tau) => {
                self.evaluations += 1;
                Depth { tau, error: tau.map(|t| if t.is_finite() { 8.0 * f64::EPSILON * t } else { 0.0 }) }
            }
            None if b.is_finite() => self.stretch(ray, m, (a, b), if self.lean { 2 } else { 4 }, tolerance)?.0,
            None => self.endless_stretch(ray, m, a, tolerance)?,
        })
    }

    /// Extinction of one medium at eight points. The flag tells a number that is too large.
    pub(super) fn extinction(&mut self, ray: &Ray, m: usize, ts: &Nodes) -> Result<([Nodes; BANDS], bool), Diagnostic> {
        let medium = &self.fields.media[m];
        let mut sigma = [[0.0; N]; BANDS];
        let mut overflow = false;
        let Some(shade) = &medium.shade else { return Ok((sigma, false)) };
        let tape = &shade.field.sampler(self.lean).tape;
        let scratch = &mut self.shade[usize::from(self.lean)][m];
        self.fields.run(tape, scratch, self.voxels, ray, ts, false);
        self.evaluations += N as u64;
        for (root, name) in ["k_a", "k_s"].into_iter().enumerate() {
            let width = tape.width(root);
            for band in 0..self.bands {
                let values = tape.component(scratch, root, band.min(width - 1));
                for (lane, value) in values.iter().enumerate() {
                    if *value >= 0.0 && *value <= LARGEST {
                        sigma[band][lane] += value;
                    } else if *value > LARGEST {
                        overflow = true;
                    } else {
                        let place = scale(ray.at(ts[lane]), self.metre);
                        return Err(bad_coefficient(&medium.name, medium.span, name, value / self.metre, place));
                    }
                }
            }
        }
        Ok((sigma, overflow))
    }

    /// Solves a stretch, divided where the field asks for it. False where it is too dense for numbers.
    fn pieces(
        &mut self,
        ray: &Ray,
        m: usize,
        sampler: &Sampler,
        (a, h, forced): (f64, f64, u8),
        out: &mut Vec<Piece>,
    ) -> Result<bool, Diagnostic> {
        let mut stack = vec![(a, h, forced)];
        let mut xs = vec![];
        while let Some((a, h, forced)) = stack.pop() {
            let ts = RULE.x.map(|x| a + h * x);
            let (sigma, overflow) = self.extinction(ray, m, &ts)?;
            if overflow {
                return Ok(false);
            }
            if forced < 14 && h > 64.0 * f64::EPSILON * a.abs() && !sampler.watches.is_empty() {
                xs.clear();
                let scratch = &self.shade[usize::from(self.lean)][m];
                for (i, watch) in sampler.watches.iter().enumerate() {
                    let values = sampler.tape.component(scratch, sampler.roots + i, 0);
                    splits_of(values, watch, forced, self.lean, &mut xs);
                }
                sort_splits(&mut xs);
                if !xs.is_empty() {
                    let mut end = 1.0;
                    for x in xs.iter().rev().map(|x| x.0).chain([0.0]) {
                        stack.push((a + h * x, h * (end - x), forced + 1));
                        end = x;
                    }
                    continue;
                }
            }
            let mut depth = Depth::default();
            for band in 0..self.bands {
                if band > 0 && sigma[band] == sigma[band - 1] {
                    (depth.tau[band], depth.error[band]) = (depth.tau[band - 1], depth.error[band - 1]);
                    continue;
                }
                let tau = h * RULE.mean(&sigma[band]);
                let decay = Decay::of(&RULE.coefficients(&sigma[band]));
                (depth.tau[band], depth.error[band]) = (tau, h * decay.quadrature() + 4.0 * f64::EPSILON * tau);
            }
            out.push(Piece { a, h, forced, depth });
        }
        Ok(true)
    }

    /// Depth of one medium over a finite stretch that it fills, cut into `least` panels at first. The flag tells that it is
    /// too dense for numbers.
    fn stretch(
        &mut self,
        ray: &Ray,
        m: usize,
        (start, end): (f64, f64),
        least: usize,
        tolerance: f64,
    ) -> Result<(Depth, bool), Diagnostic> {
        const BLACK: (Depth, bool) = (Depth { tau: [f64::INFINITY; BANDS], error: [0.0; BANDS] }, true);
        let fields = self.fields;
        let Some(shade) = &fields.media[m].shade else { return Ok((Depth::default(), false)) };
        let sampler = shade.field.sampler(self.lean);
        let mut pieces = vec![];
        if shade.field.uniform {
            if !self.pieces(ray, m, sampler, (start, end - start, 0), &mut pieces)? {
                return Ok(BLACK);
            }
        } else {
            let mut cuts = vec![(start, false), (end, false)];
            self.straight(ray, sampler, (start, end), MOST, &mut cuts);
            let cuts = thin(cuts, false);
            for pair in cuts.windows(2) {
                let (a, b) = (pair[0], pair[1]);
                let parts =
                    if cuts.len() > least { 1.0 } else { (least as f64 * (b - a) / (end - start)).ceil().max(1.0) };
                let h = (b - a) / parts;
                for i in 0..parts as usize {
                    if !self.pieces(ray, m, sampler, (a + h * i as f64, h, 0), &mut pieces)? {
                        return Ok(BLACK);
                    }
                }
            }
        }
        loop {
            let mut total = Depth::default();
            pieces.iter().for_each(|p| total.add(&p.depth));
            let largest = total.tau[..self.bands].iter().fold(0.0f64, |m, t| m.max(*t));
            let allowed = tolerance.max(16.0 * f64::EPSILON * largest);
            let wrong: f64 = pieces.iter().map(|p| p.error(self.bands)).sum();
            // What is dark by far more than it is wrong stays so.
            let dark = (0..self.bands).all(|b| total.tau[b] - total.error[b] > DARK);
            if wrong <= allowed || dark || pieces.len() > PIECES {
                return Ok((total, false));
            }
            let mut order: Vec<usize> = (0..pieces.len()).collect();
            order.sort_by(|x, y| pieces[*y].error(self.bands).total_cmp(&pieces[*x].error(self.bands)));
            let mut left = wrong;
            let mut divide = vec![false; pieces.len()];
            let mut any = false;
            for i in order {
                let p = &pieces[i];
                if left <= 0.5 * allowed {
                    break;
                }
                left -= p.error(self.bands);
                // Rounding is not mended by dividing.
                let noise = (0..self.bands).all(|b| p.depth.error[b] <= 32.0 * f64::EPSILON * p.depth.tau[b]);
                if !noise && p.h > 8.0 * f64::EPSILON * p.a.abs() && p.h > 1e-290 {
                    divide[i] = true;
                    any = true;
                }
            }
            if !any {
                return Ok((total, false));
            }
            for (i, p) in std::mem::take(&mut pieces).into_iter().enumerate() {
                if divide[i] {
                    let half = 0.5 * p.h;
                    for a in [p.a, p.a + half] {
                        if !self.pieces(ray, m, sampler, (a, half, p.forced), &mut pieces)? {
                            return Ok(BLACK);
                        }
                    }
                } else {
                    pieces.push(p);
                }
            }
        }
    }

    /// Depth of one medium that the ray never leaves, in octaves: until it is dark, or decays so that the rest is little.
    fn endless_stretch(&mut self, ray: &Ray, m: usize, start: f64, tolerance: f64) -> Result<Depth, Diagnostic> {
        let mut total = Depth::default();
        let (mut t, mut w) = (start, FIRST);
        let mut before: PerBand = [0.0; BANDS];
        loop {
            let (step, black) = self.stretch(ray, m, (t, t + w), 2, 0.05 * tolerance)?;
            total.add(&step);
            t += w;
            if black || total.is_dark(self.bands) {
                return Ok(Depth { tau: [f64::INFINITY; BANDS], error: [0.0; BANDS] });
            }
            let rest: PerBand = std::array::from_fn(|b| super::tail::geometric(before[b], step.tau[b]));
            if t >= NEAR && (0..self.bands).all(|b| total.tau[b] > DARK || rest[b] <= 0.1 * tolerance) {
                for b in 0..self.bands {
                    total.error[b] += if total.tau[b] > DARK { 0.0 } else { rest[b] };
                }
                return Ok(total);
            }
            if t > FAR {
                let medium = &self.fields.media[m];
                let name = &medium.name;
                let message = format!("medium `{name}` cannot be shown to converge along a ray that never leaves it");
                return Err(with_span(Diagnostic::error("E0652", message), medium.span)
                    .hint("give it a `shape`")
                    .note("the ray leads from a lit point to a light"));
            }
            before = step.tau;
            w *= 2.0;
        }
    }

    /// Adds the parameters where a straight node passes a level.
    pub(super) fn straight(
        &mut self,
        ray: &Ray,
        sampler: &Sampler,
        (start, end): (f64, f64),
        most: f64,
        cuts: &mut Vec<(f64, bool)>,
    ) {
        let Some(tape) = &sampler.straight else { return };
        let mut scratch = tape.scratch();
        let mut ts = [start; N];
        ts[1] = end;
        self.fields.run(tape, &mut scratch, self.voxels, ray, &ts, false);
        self.evaluations += 2;
        for (i, levels) in sampler.levels.iter().enumerate() {
            let values = tape.component(&scratch, i, 0);
            cuts_of((values[0], values[1]), (start, end), levels, most, cuts);
        }
    }
}
