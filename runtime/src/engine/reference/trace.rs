//! One ray through the transfer equation: segments and their first panels.

use super::compose::Panel;
use super::field::{Fields, Ray, bad_field};
use super::gauss::{N, Nodes, RULE};
use super::interval::Intervals;
use super::negative::negative;
use super::panel::{Slice, solve_noisy};
use super::scatter::{Behind, PLACES};
use super::shape::Solid;
use super::silhouette::{of_solid, of_surface};
use super::splats::veil::{self, Layer};
use super::split::{sort_splits, splits_of, thin};
use super::surface::Meshes;
use super::tail::Rest;
use super::{Options, RayResult};
use crate::frame::vector::scale;
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::{Scratch, Voxels};
use compiler::source::Span;

/// A scene has at most this many bands.
pub(super) const BANDS: usize = 4;
/// Larger coefficients count as infinite: sums and products of a few such still are finite.
pub(super) const LARGEST: f64 = 1e280;
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
    /// Nothing about them varies along the ray.
    pub(super) uniform: bool,
    /// Some of them scatter light into the ray.
    pub(super) scatters: bool,
    /// Its part of the stretch that it was cut out of where splats are.
    pub(super) share: f64,
}

/// State of one thread: registers of the tapes, and what they cost.
pub(super) struct Worker<'r, V: ?Sized> {
    pub(super) fields: &'r Fields,
    pub(super) voxels: &'r V,
    pub(super) meshes: Option<&'r dyn Meshes>,
    /// Metres per unit.
    pub(super) metre: f64,
    pub(super) bands: usize,
    /// Registers of each medium's tape: the full one, then the lean one.
    pub(super) scratch: [Vec<Scratch>; 2],
    /// The same for the tapes that shadow rays run.
    pub(super) shade: [Vec<Scratch>; 2],
    /// Registers of the exponents of closed forms, of phase functions, and of the background.
    pub(super) closed: Vec<Option<Scratch>>,
    pub(super) phases: Vec<Option<Scratch>>,
    pub(super) sky: Scratch,
    /// k_s of each medium at the nodes that were sampled last, if media scatter.
    pub(super) k_s: Vec<[Nodes; BANDS]>,
    /// Where the ray is cut besides: lights' places, and the depths of the scattering segment at hand.
    marks: Vec<f64>,
    /// Optical depth before the panel at hand.
    pub(super) front: PerBand,
    /// Tolerance of what arrives at a point: relative, of an optical depth absolute.
    pub(super) inner: f64,
    /// What may be left out of the light that is scattered into the ray, and along how much of it any is.
    pub(super) enough: f64,
    pub(super) lit: f64,
    /// Rough tolerances: cheaper tapes.
    pub(super) lean: bool,
    /// Rougher still: fewer cuts.
    rough: bool,
    pub(super) evaluations: u64,
    /// Bands whose optical depth is infinite whatever comes: there an overflow is no mistake.
    pub(super) opaque: [bool; BANDS],
    /// Such an overflow happened.
    pub(super) overflow: [bool; BANDS],
    /// Splats on the ray, from near to far.
    pub(super) layers: Vec<Layer>,
    /// What moving faint ones to others' places may do to the radiance.
    pub(super) moved: f64,
}

impl<'r, V: Voxels + ?Sized> Worker<'r, V> {
    pub(super) fn new(
        fields: &'r Fields,
        voxels: &'r V,
        meshes: Option<&'r dyn Meshes>,
        metre: f64,
        bands: usize,
    ) -> Self {
        let media = &fields.media;
        let scratch = [false, true].map(|lean| media.iter().map(|m| m.field.sampler(lean).tape.scratch()).collect());
        let shades = || media.iter().filter_map(|m| m.shade.as_ref());
        Self {
            fields,
            voxels,
            meshes,
            metre,
            bands,
            scratch,
            shade: [false, true].map(|lean| shades().map(|s| s.field.sampler(lean).tape.scratch()).collect()),
            closed: shades().map(|s| s.closed.as_ref()?.scratch()).collect(),
            phases: media.iter().map(|m| Some(m.phase.as_ref()?.scratch())).collect(),
            sky: fields.background.tape.scratch(),
            k_s: vec![[[0.0; N]; BANDS]; media.len()],
            marks: vec![],
            front: [0.0; BANDS],
            inner: 0.0,
            enough: 0.0,
            lit: 0.0,
            lean: false,
            rough: false,
            evaluations: 0,
            opaque: [false; BANDS],
            overflow: [false; BANDS],
            layers: vec![],
            moved: 0.0,
        }
    }

    /// Where the ray is inside each medium.
    pub(super) fn inside(&mut self, ray: &Ray) -> Result<Vec<Intervals>, Diagnostic> {
        let fields = self.fields;
        fields.media.iter().map(|m| self.intervals(&m.solid, ("medium", &m.name, m.span), ray)).collect()
    }

    /// Where the ray is inside a shape of something (what, its name and place, for messages).
    pub(super) fn intervals(
        &mut self,
        solid: &Solid,
        (what, name, span): (&str, &str, Option<Span>),
        ray: &Ray,
    ) -> Result<Intervals, Diagnostic> {
        let fields = self.fields;
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
                        Err(bad_field(&format!("{what} `{name}`"), span, "the field of `sdf`", values[i], place))
                    }
                    None => Ok(values),
                }
            })
        };
        solid.intervals(ray.origin, ray.direction, &Intervals::all(), &mut sdf)
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
                let scatters = self.fields.scatters && active.iter().any(|m| self.fields.media[*m].scatters);
                let uniform = !scatters && active.iter().all(|m| self.fields.media[*m].field.uniform);
                segments.push(Segment { start, end, active, uniform, scatters, share: 1.0 });
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
                    if root == 1 && self.fields.scatters {
                        self.k_s[m][band] = values.map(|v| if v <= LARGEST { v } else { 0.0 });
                    }
                    for (lane, value) in values.iter().enumerate() {
                        if *value >= 0.0 && *value <= LARGEST {
                            into[band][lane] += value;
                        } else if self.opaque[band] && (value.is_nan() || *value > LARGEST) {
                            self.overflow[band] = true;
                        } else {
                            let place = scale(ray.at(ts[lane]), self.metre);
                            let owner = format!("medium `{}`", medium.name);
                            return Err(bad_field(&owner, medium.span, name, value / self.metre, place));
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
    pub(super) fn build(
        &mut self,
        ray: &Ray,
        segments: &[Segment],
        segment: usize,
        (a, h, forced, plain): (f64, f64, u8, bool),
        out: &mut Vec<Panel>,
    ) -> Result<(), Diagnostic> {
        let Segment { active, scatters, .. } = &segments[segment];
        let mut stack = vec![(a, h, forced, plain)];
        let mut xs = vec![];
        while let Some((a, h, forced, plain)) = stack.pop() {
            let ts = RULE.x.map(|x| a + h * x);
            let [sigma, mut emission] = self.sample(ray, active, &ts)?;
            if forced < 14 && h > 64.0 * f64::EPSILON * a.abs() {
                xs.clear();
                self.splits(active, forced, &mut xs);
                if *scatters && xs.is_empty() {
                    xs.extend(self.shadow_cuts(ray, a, h)?.into_iter().map(|x| (x, false)));
                }
                if !xs.is_empty() {
                    let mut end = 1.0;
                    for (x, plain) in xs.iter().rev().copied().chain([(0.0, plain)]) {
                        stack.push((a + h * x, h * (end - x), forced + 1, plain));
                        end = x;
                    }
                    continue;
                }
            }
            let wrong = if *scatters { Some(self.scatter(ray, active, &ts, (&sigma, &mut emission))?) } else { None };
            let (mut slices, mut inner) = ([Slice::default(); BANDS], [0.0; BANDS]);
            for band in 0..self.bands {
                // Neutral media: bands are often equal.
                slices[band] = if band > 0 && sigma[band] == sigma[band - 1] && emission[band] == emission[band - 1] {
                    slices[band - 1]
                } else {
                    let noise = wrong.map_or(0.0, |w| w[band].iter().fold(0.0f64, |m, x| m.max(*x)));
                    solve_noisy(h, &sigma[band], &emission[band], noise)
                };
                // Where nothing can be seen any more, coefficients near the end of f64 overflow to no harm.
                if self.opaque[band] && !(slices[band].tau.is_finite() && slices[band].radiance.is_finite()) {
                    slices[band] = Slice { tau: LARGEST, ..Slice::default() };
                }
                // Seen through what of the panel lies before it.
                let reach = if slices[band].tau > 0.0 { super::panel::phi(slices[band].tau) } else { 1.0 };
                inner[band] = wrong.map_or(0.0, |w| h * reach * w[band].iter().fold(0.0f64, |m, x| m.max(*x)));
            }
            (0..self.bands).for_each(|b| self.front[b] += slices[b].tau);
            out.push(Panel { forced, plain, inner, ..Panel::new((a, h), segment, slices) });
        }
        Ok(())
    }

    /// Where a scattering segment is cut besides: where lights are nearest, where shadows begin and end, and at a few depths
    /// from where it begins, since of something dense only a skin may be lit and seen that no node would meet.
    fn mark(&mut self, ray: &Ray, segment: &Segment) -> Result<(), Diagnostic> {
        self.marks.clear();
        if !segment.scatters {
            return Ok(());
        }
        let fields = self.fields;
        for light in &fields.lights {
            light.beam.cuts(ray, &mut self.marks);
            fields.surfaces.iter().for_each(|s| of_surface(&s.form, ray, &light.beam, &mut self.marks));
            fields.media.iter().for_each(|m| of_solid(&m.solid, ray, &light.beam, &mut self.marks));
        }
        // A little inside, should a field be infinite at the very edge.
        let within = segment.start + 1e-9 * (segment.end - segment.start).min(1.0);
        let [sigma, _] = self.sample(ray, &segment.active, &[within; N])?;
        let far = ray.origin.iter().fold(segment.start, |m, x| m.max(x.abs()));
        for band in 0..self.bands {
            let k = sigma[band][0];
            if k * (segment.end - segment.start) > 8.0 {
                // No nearer than places can be told apart: what is left there counts as uncertain.
                let least = PLACES * far;
                self.marks.extend([0.25, 1.0, 3.0, 8.0, 20.0].map(|tau| segment.start + (tau / k).max(least)));
            }
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
            self.straight(ray, self.fields.media[m].field.sampler(self.lean), (start, end), most, &mut cuts);
        }
        if segments[segment].scatters {
            cuts.extend(self.marks.iter().filter(|t| **t > start && **t < end).map(|t| (*t, false)));
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

    /// Starts a ray: nothing is counted yet.
    pub(super) fn begin(&mut self, options: &Options) -> Options {
        self.evaluations = 0;
        self.opaque = [false; BANDS];
        self.overflow = [false; BANDS];
        self.moved = 0.0;
        self.lean = options.is_lean();
        self.rough = self.lean && options.rtol >= 5e-4;
        self.front = [0.0; BANDS];
        self.tolerances(options)
    }

    /// The splats of the ray as panels without length, where they cut the segments.
    fn veils(&mut self, segments: &mut Vec<Segment>, reach: f64, behind: &Behind, options: &Options) -> Vec<Panel> {
        if self.layers.is_empty() {
            return vec![];
        }
        // So faint that all of them together do not matter.
        let faint = 1e-2 * options.rtol.max(1e-13) / self.layers.len() as f64;
        let (veils, moved) = veil::place(&self.layers, reach, segments, faint);
        // Nothing on the ray is brighter than its parts; a veil lets changes through at most 13 times as large, where it is dark.
        let most = veils.iter().flat_map(|v| v.slices).map(|s| s.radiance).chain(behind.radiance).fold(1.0, f64::max);
        self.moved = 13.0 * moved * most;
        veils
    }

    /// The transfer equation along a ray up to a surface, or else to what is behind everything.
    pub(super) fn transfer(&mut self, ray: &Ray, options: &Options) -> Result<RayResult, Diagnostic> {
        let options = &self.begin(options);
        let hit = self.nearest(ray, f64::INFINITY)?;
        let behind = match &hit {
            Some(hit) => self.reflected(ray, hit)?,
            None => Behind { radiance: self.background(ray)?, ..Behind::default() },
        };
        let mut inside = self.inside(ray)?;
        if let Some(hit) = hit {
            let before = Intervals::of(0.0, hit.t);
            inside.iter_mut().for_each(|i| *i = i.intersection(&before));
        }
        let mut segments = self.segments(&inside);
        let reach = hit.map_or(f64::INFINITY, |h| h.t);
        let veils = self.veils(&mut segments, reach, &behind, options);
        self.lit = segments.iter().filter(|s| s.scatters).map(|s| s.end - s.start).sum();
        if let Some(steps) = options.steps {
            return super::fixed::march(self, ray, &segments, &veils, &behind, steps);
        }
        let mut panels = vec![];
        let mut rest = Rest::default();
        self.front = [0.0; BANDS];
        let mut veils = veils.into_iter().peekable();
        for (i, segment) in segments.iter().enumerate() {
            while let Some(veil) = veils.next_if(|v| v.a <= segment.start) {
                (0..self.bands).for_each(|b| self.front[b] += veil.slices[b].tau);
                panels.push(veil);
            }
            self.mark(ray, segment)?;
            if segment.end.is_finite() {
                let still = segment.active.iter().all(|m| self.fields.media[*m].field.uniform);
                let least = match (segment.scatters, self.rough) {
                    // Where fields vary they ask for more by themselves.
                    (true, _) if still => 4,
                    // Light from everywhere costs much and varies little.
                    (true, true) if self.fields.environment => 6,
                    (true, false) if self.fields.environment && self.lean => 12,
                    (_, true) => 16,
                    (_, false) => 32,
                };
                let least = (f64::from(least) * segment.share).ceil() as usize;
                self.first(ray, &segments, i, (segment.start, segment.end), (least, MOST), &mut panels)?;
            } else {
                rest = self.tail(ray, &segments, i, &mut panels, options)?;
            }
        }
        panels.extend(veils);
        let complete = self.refine(ray, &segments, &mut panels, &behind.radiance, &rest, options)?;
        Ok(self.finish(&panels, &behind, &rest, complete))
    }
}
