//! One ray through the transfer equation: segments, panels, refinement, composition.

use super::events::Watch;
use super::field::{Fields, Ray, bad_coefficient};
use super::gauss::{Decay, N, Nodes, RULE, monotone, root};
use super::interval::Intervals;
use super::panel::{Slice, phi, solve};
use super::shape::negative;
use super::{ErrorKind, Goal, Options, RayResult};
use crate::frame::vector::scale;
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::{Scratch, Voxels};

/// A scene has at most this many bands.
pub(super) const BANDS: usize = 4;
/// Larger coefficients count as infinite: sums and products of a few such still are finite.
const LARGEST: f64 = 1e280;
/// Lattices with more crossings than this on one stretch are left to the adaptive part.
pub(super) const MOST: f64 = 100_000.0;
/// One number per band.
pub(super) type PerBand = [f64; BANDS];

/// A stretch of the ray with the same media all along.
#[derive(Clone, Debug)]
pub(super) struct Segment {
    pub(super) start: f64,
    pub(super) end: f64,
    /// Indices of media.
    pub(super) active: Vec<usize>,
    /// None of them varies along the ray.
    pub(super) uniform: bool,
}

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
    pub(super) slices: [Slice; BANDS],
}

impl Panel {
    fn tau_error(&self, band: usize) -> f64 {
        self.slices[band].tau_error + self.seam[band][0]
    }

    fn radiance_error(&self, band: usize) -> f64 {
        self.slices[band].radiance_error + self.seam[band][1]
    }

    fn is_exact(&self, band: usize) -> bool {
        self.slices[band].exact && self.seam[band] == [0.0; 2]
    }

    /// Dividing it has not helped for long, and what is left looks like rounding.
    fn is_exhausted(&self, bands: usize) -> bool {
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

/// State of one thread: registers of the tapes, and what they cost.
pub(super) struct Worker<'r, V: ?Sized> {
    pub(super) fields: &'r Fields,
    pub(super) voxels: &'r V,
    /// Metres per unit.
    pub(super) metre: f64,
    pub(super) bands: usize,
    /// Registers of each medium's tape: the full one, then the lean one.
    scratch: [Vec<Scratch>; 2],
    /// Rough tolerances: cheaper tapes.
    pub(super) lean: bool,
    /// Rougher still: fewer cuts.
    rough: bool,
    pub(super) evaluations: u64,
    /// Bands whose optical depth is infinite whatever comes: there an overflow is no mistake.
    pub(super) opaque: [bool; BANDS],
    /// Such an overflow happened.
    pub(super) overflow: [bool; BANDS],
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

impl<'r, V: Voxels + ?Sized> Worker<'r, V> {
    pub(super) fn new(fields: &'r Fields, voxels: &'r V, metre: f64, bands: usize) -> Self {
        let scratch =
            [false, true].map(|lean| fields.media.iter().map(|m| m.field.sampler(lean).tape.scratch()).collect());
        Self {
            fields,
            voxels,
            metre,
            bands,
            scratch,
            lean: false,
            rough: false,
            evaluations: 0,
            opaque: [false; BANDS],
            overflow: [false; BANDS],
        }
    }

    /// Where the ray is inside each medium.
    pub(super) fn inside(&mut self, ray: &Ray) -> Result<Vec<Intervals>, Diagnostic> {
        let fields = self.fields;
        let mut all = vec![];
        for medium in &fields.media {
            let mut sdf = |node, within: &Intervals| -> Result<Intervals, Diagnostic> {
                let tape = &fields.sdf[&node];
                let mut scratch = tape.scratch();
                negative(within, |ts| {
                    fields.run(tape, &mut scratch, self.voxels, ray, ts, false);
                    self.evaluations += N as u64;
                    let values = *tape.component(&scratch, 0, 0);
                    match values.iter().position(|v| v.is_nan()) {
                        Some(i) => {
                            let place = scale(ray.at(ts[i]), self.metre);
                            Err(bad_coefficient(&medium.name, medium.span, "the field of `sdf`", values[i], place))
                        }
                        None => Ok(values),
                    }
                })
            };
            all.push(medium.solid.intervals(ray.origin, ray.direction, &Intervals::all(), &mut sdf)?);
        }
        Ok(all)
    }

    /// Cuts the ray wherever a medium begins or ends; stretches without media are left out.
    pub(super) fn segments(&self, inside: &[Intervals]) -> Vec<Segment> {
        let mut cuts: Vec<f64> = inside.iter().flat_map(|i| i.0.iter().flat_map(|(a, b)| [*a, *b])).collect();
        cuts.sort_by(f64::total_cmp);
        cuts.dedup();
        let mut segments = vec![];
        for pair in cuts.windows(2) {
            let (start, end) = (pair[0], pair[1]);
            let middle = if end.is_finite() { start + 0.5 * (end - start) } else { 2.0 * start + 1.0 };
            let active: Vec<usize> = (0..inside.len()).filter(|m| inside[*m].contains(middle)).collect();
            if !active.is_empty() {
                let uniform = active.iter().all(|m| self.fields.media[*m].field.uniform);
                segments.push(Segment { start, end, active, uniform });
            }
        }
        segments
    }

    /// Total extinction and emission of some media at the nodes of a panel.
    pub(super) fn sample(
        &mut self,
        ray: &Ray,
        active: &[usize],
        ts: &Nodes,
    ) -> Result<[[Nodes; BANDS]; 2], Diagnostic> {
        let mut total = [[[0.0; N]; BANDS]; 2];
        for &m in active {
            let medium = &self.fields.media[m];
            let tape = &medium.field.sampler(self.lean).tape;
            let scratch = &mut self.scratch[usize::from(self.lean)][m];
            self.fields.run(tape, scratch, self.voxels, ray, ts, false);
            for (root, name) in ["k_a", "k_s", "k_e"].into_iter().enumerate() {
                let into = &mut total[root / 2];
                let width = tape.width(root);
                for band in 0..self.bands {
                    let values = tape.component(scratch, root, band.min(width - 1));
                    for (lane, value) in values.iter().enumerate() {
                        if *value >= 0.0 && *value <= LARGEST {
                            into[band][lane] += value;
                        } else if self.opaque[band] && (value.is_nan() || *value > LARGEST) {
                            self.overflow[band] = true;
                        } else {
                            let place = scale(ray.at(ts[lane]), self.metre);
                            return Err(bad_coefficient(&medium.name, medium.span, name, value / self.metre, place));
                        }
                    }
                }
            }
        }
        self.evaluations += N as u64;
        Ok(total)
    }

    /// Where in the panel just sampled (0..1) its fields may not be smooth.
    /// The flag tells a mere bisection.
    fn splits(&self, active: &[usize], forced: u8, out: &mut Vec<(f64, bool)>) {
        for &m in active {
            let field = self.fields.media[m].field.sampler(self.lean);
            let scratch = &self.scratch[usize::from(self.lean)][m];
            for (i, watch) in field.watches.iter().enumerate() {
                let values = field.tape.component(scratch, field.roots + i, 0);
                splits_of(values, watch, forced, self.lean, out);
            }
        }
        sort_splits(out);
    }

    /// Solves a stretch of a segment, divided where its fields ask for it.
    fn build(
        &mut self,
        ray: &Ray,
        segments: &[Segment],
        segment: usize,
        (a, h, forced, plain): (f64, f64, u8, bool),
        out: &mut Vec<Panel>,
    ) -> Result<(), Diagnostic> {
        let active = &segments[segment].active;
        let mut stack = vec![(a, h, forced, plain)];
        let mut xs = vec![];
        while let Some((a, h, forced, plain)) = stack.pop() {
            let ts = RULE.x.map(|x| a + h * x);
            let [sigma, emission] = self.sample(ray, active, &ts)?;
            if forced < 14 && h > 64.0 * f64::EPSILON * a.abs() {
                xs.clear();
                self.splits(active, forced, &mut xs);
                if !xs.is_empty() {
                    let mut end = 1.0;
                    for (x, plain) in xs.iter().rev().copied().chain([(0.0, plain)]) {
                        stack.push((a + h * x, h * (end - x), forced + 1, plain));
                        end = x;
                    }
                    continue;
                }
            }
            let mut slices = [Slice::default(); BANDS];
            for band in 0..self.bands {
                // Neutral media: bands are often equal.
                slices[band] = if band > 0 && sigma[band] == sigma[band - 1] && emission[band] == emission[band - 1] {
                    slices[band - 1]
                } else {
                    solve(h, &sigma[band], &emission[band])
                };
            }
            out.push(Panel {
                a,
                h,
                segment,
                forced,
                stalled: 0,
                parent: f64::INFINITY,
                plain,
                seam: [[0.0; 2]; BANDS],
                slices,
            });
        }
        Ok(())
    }

    /// First panels of a stretch: cut at every straight event, and fine enough to notice features of ordinary size.
    pub(super) fn first(
        &mut self,
        ray: &Ray,
        segments: &[Segment],
        segment: usize,
        (start, end): (f64, f64),
        (least, most): (usize, f64),
        out: &mut Vec<Panel>,
    ) -> Result<(), Diagnostic> {
        let Segment { active, uniform, .. } = &segments[segment];
        if *uniform {
            return self.build(ray, segments, segment, (start, end - start, 0, false), out);
        }
        let mut cuts = vec![(start, false), (end, false)];
        for &m in active {
            self.straight(ray, m, (start, end), most, &mut cuts);
        }
        let cuts = thin(cuts, self.rough);
        let pieces = cuts.len() - 1;
        for pair in cuts.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let share = (least as f64 * (b - a) / (end - start)).ceil();
            let parts = if pieces >= least { 1.0 } else { share.max(1.0) };
            let h = (b - a) / parts;
            for i in 0..parts as usize {
                self.build(ray, segments, segment, (a + h * i as f64, h, 0, i > 0), out)?;
            }
        }
        Ok(())
    }

    /// Adds the parameters where a straight node of a medium passes a level.
    fn straight(&mut self, ray: &Ray, medium: usize, (start, end): (f64, f64), most: f64, cuts: &mut Vec<(f64, bool)>) {
        let field = self.fields.media[medium].field.sampler(self.lean);
        let Some(tape) = &field.straight else { return };
        let mut scratch = tape.scratch();
        let mut ts = [start; N];
        ts[1] = end;
        self.fields.run(tape, &mut scratch, self.voxels, ray, &ts, false);
        self.evaluations += 2;
        for (i, levels) in field.levels.iter().enumerate() {
            let values = tape.component(&scratch, i, 0);
            cuts_of((values[0], values[1]), (start, end), levels, most, cuts);
        }
    }

    /// The transfer equation along a ray before a background.
    pub(super) fn transfer(&mut self, ray: &Ray, behind: &PerBand, options: &Options) -> Result<RayResult, Diagnostic> {
        self.evaluations = 0;
        self.opaque = [false; BANDS];
        self.overflow = [false; BANDS];
        self.lean = options.is_lean();
        self.rough = self.lean && options.rtol >= 5e-4;
        let inside = self.inside(ray)?;
        let segments = self.segments(&inside);
        if let Some(steps) = options.steps {
            return super::fixed::march(self, ray, &segments, behind, steps);
        }
        let mut panels = vec![];
        let mut rest = super::tail::Rest::default();
        for (i, segment) in segments.iter().enumerate() {
            if segment.end.is_finite() {
                self.first(
                    ray,
                    &segments,
                    i,
                    (segment.start, segment.end),
                    (if self.rough { 16 } else { 32 }, MOST),
                    &mut panels,
                )?;
            } else {
                rest = self.tail(ray, &segments, i, &mut panels, options)?;
            }
        }
        let complete = self.refine(ray, &segments, &mut panels, behind, &rest, options)?;
        Ok(self.finish(&panels, behind, &rest, complete))
    }

    /// Divides the panels that spoil the result until its error is within the tolerance. Whether it is (or nothing more can
    /// be gained in f64).
    fn refine(
        &mut self,
        ray: &Ray,
        segments: &[Segment],
        panels: &mut Vec<Panel>,
        behind: &PerBand,
        rest: &super::tail::Rest,
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
            for (i, p) in old.into_iter().enumerate() {
                if !divide[i] {
                    panels.push(p);
                    continue;
                }
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
    fn finish(&self, panels: &[Panel], behind: &PerBand, rest: &super::tail::Rest, complete: bool) -> RayResult {
        let bands = self.bands;
        let totals = compose(panels, behind, bands);
        let mut closed = rest.exact;
        let (mut wrong, mut wrong_tau) = ([0.0; BANDS], [0.0; BANDS]);
        let beyond = behind_each(panels, behind, bands);
        let weights = weigh(panels, behind, bands);
        for b in 0..bands {
            for (p, w) in panels.iter().zip(&weights) {
                wrong[b] += w[b];
                wrong_tau[b] += p.tau_error(b);
                closed &= p.is_exact(b);
            }
            // Where a medium begins or ends is rounded relative to its distance: dL/dt there is ±T·σ·(S − L).
            let mut tau = Sum::default();
            for (i, p) in panels.iter().enumerate() {
                let s = &p.slices[b];
                let starts = i == 0 || panels[i - 1].segment != p.segment;
                let ends = panels.get(i + 1).is_none_or(|q| q.segment != p.segment);
                let place = if ends { p.a + p.h } else { p.a };
                let share = 4.0 * f64::EPSILON * place / p.h;
                if (starts || ends) && p.h.is_finite() && s.tau.is_finite() {
                    wrong_tau[b] += s.tau * share;
                    let contrast = (s.radiance / phi(s.tau) - s.tau * beyond[i][b]).abs();
                    wrong[b] += (-(tau.get() + s.tau)).exp() * share * contrast;
                }
                tau.add(s.tau);
            }
            let tau = if rest.infinite[b] { f64::INFINITY } else { totals.tau[b] };
            let rounding = 4.0 * f64::EPSILON;
            wrong[b] += rest.radiance[b] + rounding * totals.radiance[b];
            wrong[b] += (-tau).exp() * behind[b] * rest.tau[b];
            wrong_tau[b] = if tau.is_finite() { wrong_tau[b] + rest.tau[b] + rounding * tau } else { 0.0 };
        }
        let optical_depth: Vec<f64> =
            (0..bands).map(|b| if rest.infinite[b] { f64::INFINITY } else { totals.tau[b] }).collect();
        RayResult {
            radiance: totals.radiance[..bands].to_vec(),
            transmittance: optical_depth.iter().map(|t| (-t).exp()).collect(),
            optical_depth,
            error: wrong[..bands].to_vec(),
            error_tau: wrong_tau[..bands].to_vec(),
            error_kind: if closed { ErrorKind::Bound } else { ErrorKind::Estimate },
            evaluations: self.evaluations,
            complete,
        }
    }
}

/// Radiance that arrives at the far end of each panel.
fn behind_each(panels: &[Panel], behind: &PerBand, bands: usize) -> Vec<PerBand> {
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
fn weigh(panels: &[Panel], behind: &PerBand, bands: usize) -> Vec<PerBand> {
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
fn seams(panels: &mut [Panel], bands: usize) {
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

/// Cuts where a straight quantity passes levels on its way from `g0` at `start` to `g1` at `end`.
pub(super) fn cuts_of(
    (g0, g1): (f64, f64),
    (start, end): (f64, f64),
    levels: &super::events::Levels,
    most: f64,
    cuts: &mut Vec<(f64, bool)>,
) {
    if !g0.is_finite() || !g1.is_finite() || g0 == g1 || levels.count(g0.min(g1), g0.max(g1)) > most {
        return;
    }
    levels.visit(g0.min(g1), g0.max(g1), |level| {
        let t = start + (end - start) * ((level - g0) / (g1 - g0));
        if t > start && t < end {
            cuts.push((t, levels.soft));
        }
    });
}

/// Sorts divisions and drops those at the ends and those that coincide.
pub(super) fn sort_splits(xs: &mut Vec<(f64, bool)>) {
    xs.retain(|x| x.0 > 1e-12 && x.0 < 1.0 - 1e-12);
    xs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    xs.dedup_by(|b, a| b.0 - a.0 < 1e-12);
}

/// Sorts cuts and drops those that coincide, and when rough also two of three in every run of soft ones.
pub(super) fn thin(mut cuts: Vec<(f64, bool)>, rough: bool) -> Vec<f64> {
    cuts.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut kept: Vec<f64> = vec![];
    let mut skipped = 0;
    for (t, soft) in cuts {
        if kept.last().is_some_and(|last| t - last <= 4.0 * f64::EPSILON * t.abs()) {
            continue;
        }
        if rough && soft && skipped < 2 {
            skipped += 1;
            continue;
        }
        skipped = 0;
        kept.push(t);
    }
    kept
}

/// Where in a panel (0..1) it should be divided for the sake of one watched quantity.
pub(super) fn splits_of(values: &Nodes, watch: &Watch, forced: u8, lean: bool, out: &mut Vec<(f64, bool)>) {
    if values.iter().any(|v| !v.is_finite()) {
        return;
    }
    let c = RULE.coefficients(values);
    let spread: f64 = c[1..].iter().map(|x| x.abs()).sum();
    if spread <= 1e-14 * c[0].abs() {
        return;
    }
    let (low, high) = (c[0] - spread, c[0] + spread);
    let decay = Decay::of(&c);
    let resolved = decay.interpolation() <= 1e-6 * spread || decay.interpolation() <= 1e-13 * c[0].abs();
    match watch {
        Watch::Levels(levels) => {
            let count = levels.count(low, high);
            if count == 0.0 {
                return;
            }
            if !resolved || count > 64.0 {
                if forced < if lean { 2 } else { 8 } {
                    out.push((0.5, true));
                }
                return;
            }
            let points = monotone(&c);
            for pair in points.windows(2) {
                let (p, q) = (pair[0], pair[1]);
                levels.visit(p.1.min(q.1), p.1.max(q.1), |level| out.push((root(&c, level, p, q), false)));
            }
        }
        Watch::Peak => {
            // Only where the exponential peaks between the nodes, or before the first or after the last.
            if forced >= 6 || 2.0 * spread < 4.0 || decay.interpolation() > 0.1 * spread {
                return;
            }
            let points = monotone(&c);
            let seen = values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v));
            let Some(peak) = points.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)) else { return };
            if peak.1 - seen < 2.0 {
                return;
            }
            out.push((peak.0, true));
            beside(&c, &points, peak, |value, drop| value < peak.1 - drop, &[4.0, 30.0], |d| peak.1 - d, out);
        }
        Watch::Pole => {
            let seen = values.iter().fold(f64::INFINITY, |m, v| m.min(v.abs()));
            if forced >= 6 || !resolved {
                return;
            }
            let sign = c[0].signum();
            let points = monotone(&c);
            let Some(pole) = points.iter().copied().min_by(|a, b| (sign * a.1).total_cmp(&(sign * b.1))) else {
                return;
            };
            if sign * pole.1 <= 0.0 || seen < 3.0 * pole.1.abs() {
                return;
            }
            out.push((pole.0, true));
            let beyond = |value: f64, times: f64| sign * value > times * sign * pole.1;
            beside(&c, &points, pole, beyond, &[3.0, 40.0], |d| d * pole.1, out);
        }
    }
}

/// Adds the nearest places on both sides of an extremum where the interpolant has moved away by given amounts.
fn beside(
    c: &Nodes,
    points: &[(f64, f64)],
    middle: (f64, f64),
    beyond: impl Fn(f64, f64) -> bool,
    amounts: &[f64],
    level: impl Fn(f64) -> f64,
    out: &mut Vec<(f64, bool)>,
) {
    for amount in amounts {
        let right = points.iter().find(|p| p.0 > middle.0 && beyond(p.1, *amount));
        let left = points.iter().rev().find(|p| p.0 < middle.0 && beyond(p.1, *amount));
        for side in [left, right].into_iter().flatten() {
            out.push((root(c, level(*amount), middle, *side), true));
        }
    }
}
