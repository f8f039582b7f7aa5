//! The reference picture, as much of it as its share of the budget allows.

use super::{LONGEST, SHORTEST, Study, TRUTH};
use crate::engine::reference::{Goal, Options, Pixels};
use crate::frame::{COVERAGE, Params, Session, Trouble, sample_offsets, splitmix, stratified_pixels};
use crate::image::{Display, Picture, Shown};
use compiler::ir::Bands;
use std::time::Instant;

/// Relative tolerances that are tried, from rough to fine, below a hundredth of the scene's accuracy.
const TOLERANCES: [f64; 4] = [1e-4, 1e-5, 1e-6, 1e-7];
/// Pixels that are drawn to see how long one takes.
const PILOT: u32 = 12;
/// A finer tolerance is worth a picture this small, not a smaller one.
const WORTH: f64 = 64.0;
/// Paths of a pixel: a multiple of the reference's batches, at least and at most.
const PATHS: u64 = 512;
const MOST_PATHS: u64 = 1 << 18;
/// Part of the time that is planned for; some pixels take longer than those that were looked at.
const CAUTION: f64 = 0.7;
/// Seconds between looks at the clock, about.
const BREATH: f64 = 0.3;

/// The reference picture in numbers.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct ReferenceFacts {
    /// `estimate` or `standard-error`.
    pub kind: &'static str,
    /// Pixels at which it is known.
    pub pixels: u32,
    /// Pixels in all.
    pub of: u32,
    /// Rays or paths of a pixel off edges.
    pub samples: u64,
    /// Relative tolerance of a ray; nothing for paths.
    pub rtol: Option<f64>,
    /// Its largest error off edges, in lx.
    pub max_error: f64,
    /// The root of the mean square of its errors off edges, in lx.
    pub rms_error: f64,
    /// Field evaluations.
    pub evaluations: u64,
    /// Seconds.
    pub seconds: f64,
}

impl ReferenceFacts {
    /// Before anything is drawn.
    fn of(kind: &'static str) -> Self {
        Self {
            kind,
            pixels: 0,
            of: 0,
            samples: 0,
            rtol: None,
            max_error: 0.0,
            rms_error: 0.0,
            evaluations: 0,
            seconds: 0.0,
        }
    }
}

/// The reference picture.
#[derive(Clone, Debug)]
pub(crate) struct Truth {
    pub(super) size: [u32; 2],
    pub(crate) bands: usize,
    pub(crate) white: f64,
    pub(crate) accuracy: f64,
    pub(super) display: Display,
    /// In lx; pixels whose truth is not known are black.
    pub(crate) radiance: Vec<f64>,
    /// The largest of a pixel's bands, in lx.
    pub(crate) error: Vec<f64>,
    pub(crate) known: Vec<bool>,
    picture_bands: Bands,
    random: bool,
    offsets: Vec<[f64; 2]>,
    options: Options,
    facts: ReferenceFacts,
}

impl Truth {
    /// Chooses the size of the picture, unless it was given, and the tolerance, so that a share of the budget is enough.
    /// The session is left at that size.
    pub(super) fn plan(study: &Study<'_>, session: &mut Session, params: &Params) -> Result<(Self, [u32; 2]), Trouble> {
        let (request, own) = (study.request, session.size());
        let most = request.size.unwrap_or_else(|| shrunk(own, f64::from(LONGEST)));
        session.resize(most);
        let mut truth = Self::of(session, params, request.time, request.seed);
        let (white, accuracy, random) = (truth.white, truth.accuracy, truth.random);
        let available = CAUTION * request.budget * TRUTH;
        let longest = f64::from(most[0].max(most[1]));
        // How long the longer side may be if a pixel takes so many seconds.
        let fits = |each: f64| longest * (available / (each * f64::from(most[0]) * f64::from(most[1]))).sqrt();
        let pilot = stratified_pixels(most, PILOT, request.seed);
        let mut room = longest;
        if random {
            truth.options = Options { samples: Some(PATHS), rtol: 1e-12, ..truth.options };
            let each = truth.seconds_each(session, params, request.time, &pilot)?;
            room = fits(each);
            let times = (room / longest).powi(2).clamp(1.0, (MOST_PATHS / PATHS) as f64) as u64;
            truth.options.samples = Some(PATHS * times);
            truth.facts.samples = PATHS * times;
        } else {
            let loosest = (accuracy / 100.0).clamp(1e-12, TOLERANCES[0]);
            let finer = TOLERANCES.into_iter().filter(|t| *t < loosest);
            let (mut chosen, mut last) = (loosest, 0.0);
            for rtol in [loosest].into_iter().chain(finer) {
                truth.options = Options { rtol, atol: rtol * white, ..truth.options };
                // Do not even look at what will surely take too long.
                if last > 0.0 && (fits(2.0 * last) < WORTH.min(longest) || last * f64::from(PILOT) > 0.1 * available) {
                    break;
                }
                let each = truth.seconds_each(session, params, request.time, &pilot)?;
                if last > 0.0 && fits(each) < WORTH.min(longest) {
                    break;
                }
                (chosen, last, room) = (rtol, each, fits(each));
            }
            truth.options = Options { rtol: chosen, atol: chosen * white, ..truth.options };
            truth.facts.samples = truth.offsets.len() as u64;
            truth.facts.rtol = Some(chosen);
        }
        if request.size.is_none() {
            truth.size = shrunk(own, room.clamp(f64::from(SHORTEST), f64::from(LONGEST)));
        }
        let size = truth.size;
        session.resize(size);
        Ok((truth.unknown(), size))
    }

    /// One that is good enough to check a picture's accuracy.
    pub(crate) fn rough(session: &Session, params: &Params, time: f64) -> Self {
        let mut truth = Self::of(session, params, time, 0);
        let rtol = (truth.accuracy / 100.0).clamp(1e-12, TOLERANCES[0]);
        truth.options = Options { rtol, atol: rtol * truth.white, samples: Some(PATHS), ..truth.options };
        truth.unknown()
    }

    /// Of the picture that the session draws; tolerance and pixels are still to come.
    fn of(session: &Session, params: &Params, time: f64, seed: u64) -> Self {
        let random = session.is_random();
        Self {
            size: session.size(),
            bands: session.program().bands.wavelengths.len(),
            white: session.white(params, time),
            accuracy: session.accuracy(),
            display: session.display(params, time),
            radiance: vec![],
            error: vec![],
            known: vec![],
            picture_bands: session.program().bands.clone(),
            random,
            offsets: sample_offsets(session.program().plan.samples),
            options: Options { goal: Goal::Radiance, seed: seed ^ 0x7265_666c, ..Options::default() },
            facts: ReferenceFacts::of(if random { "standard-error" } else { "estimate" }),
        }
    }

    /// Nothing is known yet.
    fn unknown(mut self) -> Self {
        let count = self.size[0] as usize * self.size[1] as usize;
        self.radiance = vec![0.0; count * self.bands];
        self.error = vec![0.0; count];
        self.known = vec![false; count];
        self.facts.of = count as u32;
        self
    }

    /// Rays of a pixel.
    pub(crate) fn offsets(&self) -> &[[f64; 2]] {
        &self.offsets
    }

    /// How exactly they are followed.
    pub(crate) fn options(&self) -> &Options {
        &self.options
    }

    /// One that is known exactly everywhere.
    #[cfg(test)]
    pub(super) fn known(size: [u32; 2], bands: Bands, radiance: Vec<f64>, accuracy: f64) -> Self {
        let count = radiance.len() / bands.wavelengths.len();
        Self {
            size,
            bands: bands.wavelengths.len(),
            white: 1.0,
            accuracy,
            display: Display::default(),
            radiance,
            error: vec![0.0; count],
            known: vec![true; count],
            picture_bands: bands,
            random: false,
            offsets: vec![[0.5; 2]],
            options: Options::default(),
            facts: ReferenceFacts::of("estimate"),
        }
    }

    fn seconds_each(&self, session: &Session, params: &Params, time: f64, pixels: &[[u32; 2]]) -> Result<f64, Trouble> {
        let started = Instant::now();
        session.exact_pixels(params, time, (pixels, &self.offsets), &self.options)?;
        Ok(started.elapsed().as_secs_f64() / pixels.len().max(1) as f64)
    }

    /// Draws until it is whole or until a time; pixels in an order that is spread over the picture wherever it ends, those on
    /// edges last, if at all.
    pub(crate) fn draw(
        &mut self,
        session: &Session,
        params: &Params,
        time: f64,
        edges: &[bool],
        (with_edges, until): (bool, Instant),
        progress: &dyn Fn(f64),
    ) -> Result<(), Trouble> {
        let started = Instant::now();
        let width = self.size[0] as usize;
        let mut order: Vec<usize> = (0..self.known.len()).collect();
        order.sort_by_key(|i| (edges[*i], splitmix(&mut (*i as u64))));
        let plain = order.iter().filter(|i| !edges[**i]).count();
        order.truncate(if with_edges { order.len() } else { plain });
        let (mut at, mut chunk) = (0, 2);
        while at < order.len() && (at == 0 || Instant::now() < until) {
            if at == plain {
                // Pixels on edges take many rays.
                chunk = 2;
            }
            let end = (at + chunk).min(if at < plain { plain } else { order.len() });
            let numbers = &order[at..end];
            let pixels: Vec<[u32; 2]> = numbers.iter().map(|i| [(i % width) as u32, (i / width) as u32]).collect();
            let before = Instant::now();
            let found = self.pixels(session, params, time, &pixels, at >= plain)?;
            for (pixel, number) in numbers.iter().enumerate() {
                let from = |list: &[f64]| list[pixel * self.bands..][..self.bands].to_vec();
                self.radiance[number * self.bands..][..self.bands].copy_from_slice(&from(&found.radiance));
                self.error[*number] = from(&found.error).into_iter().fold(0.0, f64::max);
                self.known[*number] = true;
            }
            self.facts.evaluations += found.evaluations;
            at = end;
            let speed = before.elapsed().as_secs_f64() / numbers.len() as f64;
            // Not many more at a time than before: behind a dark sky there may be pixels that take long.
            chunk = ((BREATH / speed.max(1e-9)) as usize).clamp(2, (2 * chunk).min(4096));
            progress(at as f64 / order.len() as f64);
        }
        let off_edges = || (0..self.known.len()).filter(|i| self.known[*i] && !edges[*i]).map(|i| self.error[i]);
        self.facts.max_error = off_edges().fold(0.0, f64::max);
        let squares: f64 = off_edges().map(|e| e * e).sum();
        self.facts.rms_error = (squares / (off_edges().count() as f64).max(1.0)).sqrt();
        self.facts.pixels = self.known.iter().filter(|k| **k).count() as u32;
        self.facts.seconds = started.elapsed().as_secs_f64();
        Ok(())
    }

    fn pixels(
        &self,
        session: &Session,
        params: &Params,
        time: f64,
        pixels: &[[u32; 2]],
        on_edges: bool,
    ) -> Result<Pixels, Trouble> {
        if on_edges {
            // An edge is a share of the pixel, which takes many rays to count and no great accuracy along each.
            let rtol = self.options.rtol.max(1e-4);
            let options = Options { rtol, atol: rtol * self.white, ..self.options };
            return session.exact_pixels(params, time, (pixels, &sample_offsets(COVERAGE)), &options);
        }
        session.exact_pixels(params, time, (pixels, &self.offsets), &self.options)
    }

    /// Whether it is known at every pixel.
    pub(super) fn is_whole(&self) -> bool {
        self.known.iter().all(|k| *k)
    }

    pub(super) fn is_random(&self) -> bool {
        self.random
    }

    pub(super) fn facts(&self) -> ReferenceFacts {
        self.facts
    }

    /// As a screen shows it; what is not known is black.
    pub(super) fn shown(&self, display: &Display) -> Shown {
        let radiance = self.radiance.iter().map(|v| *v as f32).collect();
        Picture::new(self.size, self.picture_bands.clone(), radiance, None)
            .map_or(Shown { width: 0, height: 0, pixels: vec![] }, |picture| picture.shown(display))
    }
}

/// The same shape with a longer side of at most so many pixels.
fn shrunk([w, h]: [u32; 2], longest: f64) -> [u32; 2] {
    let share = (longest / f64::from(w.max(h))).min(1.0);
    [w, h].map(|n| ((f64::from(n) * share).round() as u32).max(1))
}
