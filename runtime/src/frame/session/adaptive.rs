//! Pictures of which some pixels are drawn and the others filled in from those around them, where that is within what
//! `accuracy` allows.
//!
//! Pixels of a lattice are drawn first, then those of lattices of half its spacing, down to every pixel (Levoy 1990, "Volume
//! rendering by adaptive refinement"). A pixel midway between two that are known, or between four, is filled in by the cubic
//! through four of them in a row, on both diagonals in the middle of four; never across what a survey of the whole picture tells apart:
//! outlines of shapes, surfaces, suns (edge-aware upsampling, Kopf et al. 2007).
//!
//! What that may be wrong by is estimated as κ·D/8, with D the largest second difference at the known pixels around. D/8 is the error
//! of a straight line, which the cubic keeps well within where the picture is smooth. κ is measured: some of the pixels that would be filled
//! in are drawn all the same, and κ is twice the largest ratio of error to D/8 that those nearby show.

use super::canvas::{Canvas, trace_parts};
use super::{Drawing, Session, Trouble};
use crate::engine::gpu::{Clock, PackedRay, Timing};
use crate::frame::{Camera, Frame, Origins, Params, scene_bounds, splitmix};
use compiler::program::ALONE;
use std::time::Instant;

/// Pixels between those of the first lattice.
const SPACING: usize = 4;
/// A picture that is narrower is drawn whole.
const NARROW: usize = 64;
/// Share of what `accuracy` allows that filling in may take.
const SHARE: f64 = 0.25;
/// Of which so much is taken to be wrong at least, lest nothing be known where nothing bends.
const FLOOR: f64 = 0.05;
/// κ at least: where a straight line has a crease in its middle it is off by D/2.
const LEAST: f64 = 4.0;
/// κ as a multiple of the largest ratio that was found.
const MARGIN: f64 = 2.0;
/// κ holds in a square of so many pixels, and is found in it and those around it.
const BLOCK: usize = 64;
/// One in so many of the pixels that would be filled in is drawn, to find κ.
const CHECKED: u64 = 16;
/// How much of the errors at its four places a cubic takes over at most: (1 + 9 + 9 + 1)/16.
const TAKEN_OVER: f64 = 1.25;

/// A pixel that may be filled in.
#[derive(Copy, Clone, Debug)]
struct Guess {
    pixel: usize,
    rows: Rows,
    /// D/8 around it, and what is wrong at least, in lx.
    bend: f64,
    /// What is wrong with the pixels that it is filled in from, since they were filled in themselves.
    base: f64,
    /// What steps are wrong by along the rays that it is filled in from, and what all of it may be.
    marched: f64,
    allowed: f64,
    checked: bool,
}

impl Guess {
    fn error(&self, kappa: f64) -> f64 {
        kappa * self.bend + self.base
    }

    fn is_good(&self, kappa: f64) -> bool {
        let error = self.error(kappa);
        error <= SHARE * self.allowed && error + self.marched <= self.allowed
    }
}

/// Four pixels in a row, the guess in the middle: the two next to it, and the two behind them if they are like it.
#[derive(Copy, Clone, Debug)]
struct Row {
    near: [usize; 2],
    far: Option<[usize; 2]>,
}

impl Row {
    fn at(&self, value: impl Fn(usize) -> f64) -> f64 {
        let [b, c] = self.near.map(&value);
        match self.far.map(|far| far.map(&value)) {
            Some([a, d]) => (9.0 * (b + c) - (a + d)) / 16.0,
            None => 0.5 * (b + c),
        }
    }
}

/// One row through a pixel, or two that cross in it.
#[derive(Copy, Clone, Debug)]
struct Rows {
    first: Row,
    second: Option<Row>,
}

impl Rows {
    /// The pixels next to the guess.
    fn near(&self) -> impl Iterator<Item = usize> + use<> {
        let second = self.second.map(|row| row.near);
        self.first.near.into_iter().chain(second.into_iter().flatten())
    }

    fn at(&self, value: impl Fn(usize) -> f64) -> f64 {
        let first = self.first.at(&value);
        self.second.map_or(first, |second| 0.5 * (first + second.at(&value)))
    }
}

/// A picture while it is filled in.
struct Filling<'c> {
    canvas: &'c mut Canvas,
    survey: Vec<u32>,
    bands: usize,
    /// Of each pixel, what is wrong with it since it was filled in; 0 where it was drawn.
    filled: Vec<f32>,
}

impl Filling<'_> {
    fn size(&self) -> [usize; 2] {
        self.canvas.size.map(|n| n as usize)
    }

    /// The numbers of a pixel, in lx: its radiances, and its transmittances as parts of white.
    fn channels(&self) -> usize {
        if self.canvas.transmittance.is_some() { 2 * self.bands } else { self.bands }
    }

    fn value(&self, pixel: usize, channel: usize) -> f64 {
        match (&self.canvas.transmittance, channel.checked_sub(self.bands)) {
            (Some(transmittance), Some(band)) => {
                self.canvas.white * f64::from(transmittance[pixel * self.bands + band])
            }
            _ => f64::from(self.canvas.radiance[pixel * self.bands + channel]),
        }
    }

    fn brightest(&self, pixel: usize) -> f64 {
        let light = &self.canvas.radiance[pixel * self.bands..][..self.bands];
        light.iter().map(|v| f64::from(*v)).fold(self.canvas.white, f64::max)
    }

    /// The pixel at an offset, if it is in the picture and like this one.
    fn alike(&self, [x, y]: [usize; 2], [dx, dy]: [isize; 2]) -> Option<usize> {
        let [w, h] = self.size();
        let (x2, y2) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        let other = (x2 < w && y2 < h).then_some(y2 * w + x2)?;
        let own = self.survey[y * w + x];
        (own != ALONE && self.survey[other] == own).then_some(other)
    }

    /// The rows that a new pixel of the lattice of spacing `h` is filled in from: one beside, one above, or both diagonals.
    fn rows(&self, at: [usize; 2], h: usize) -> Option<Rows> {
        let odd = at.map(|n| !(n / h).is_multiple_of(2));
        let h = h as isize;
        let row = |[dx, dy]: [isize; 2]| {
            let place = |n: isize| self.alike(at, [n * h * dx, n * h * dy]);
            let near = [place(-1)?, place(1)?];
            Some(Row { near, far: place(-3).zip(place(3)).map(|(a, d)| [a, d]) })
        };
        let (first, second) = match odd {
            [true, false] => (row([1, 0])?, None),
            [false, true] => (row([0, 1])?, None),
            [true, true] => (row([1, 1])?, Some(row([1, -1])?)),
            [false, false] => return None,
        };
        Some(Rows { first, second })
    }

    /// D/8 at the pixels of the lattice of spacing `s`, the largest of each and those around it; infinite beside outlines.
    fn bends(&self, s: usize) -> (usize, Vec<f64>) {
        let [w, h] = self.size();
        let (columns, rows) = ((w - 1) / s + 1, (h - 1) / s + 1);
        let step = s as isize;
        let channels = self.channels();
        let inside = |[x, y]: [usize; 2], [dx, dy]: [isize; 2]| {
            x.checked_add_signed(dx).is_some_and(|x| x < w) && y.checked_add_signed(dy).is_some_and(|y| y < h)
        };
        let own = |i: usize, j: usize| {
            let at = [i * s, j * s];
            let pixel = at[1] * w + at[0];
            let mut most: Option<f64> = None;
            for [dx, dy] in [[1, 0], [0, 1], [1, 1], [1, -1]] {
                let ends = [[-step * dx, -step * dy], [step * dx, step * dy]];
                if !ends.iter().all(|end| inside(at, *end)) {
                    continue;
                }
                let bend = match ends.map(|end| self.alike(at, end)) {
                    [Some(before), Some(behind)] => {
                        let second = |c| self.value(before, c) - 2.0 * self.value(pixel, c) + self.value(behind, c);
                        // A NaN stays one, and nothing is filled in from it.
                        (0..channels).map(|c| second(c).abs() / 8.0).fold(0.0, larger)
                    }
                    // Beside an outline anything may be steep.
                    _ => f64::INFINITY,
                };
                most = Some(most.map_or(bend, |m| larger(m, bend)));
            }
            most
        };
        let places: Vec<(usize, usize)> = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))).collect();
        let single: Vec<Option<f64>> = places.iter().map(|(i, j)| own(*i, *j)).collect();
        let bends = around([columns, rows], &single);
        (columns, bends)
    }

    /// What is new on the lattice of spacing `h`: what may be filled in, and what must be drawn.
    fn guesses(&self, h: usize) -> (Vec<Guess>, Vec<u32>) {
        let [width, height] = self.size();
        let s = 2 * h;
        let (columns, bends) = self.bends(s);
        let bend_at = |pixel: usize| bends[pixel / width / s * columns + pixel % width / s];
        let (mut guesses, mut drawn) = (vec![], vec![]);
        let news = (0..height).step_by(h).flat_map(|y| (0..width).step_by(h).map(move |x| [x, y]));
        for at in news.filter(|at| at.iter().any(|n| n % s != 0)) {
            let pixel = at[1] * width + at[0];
            let Some(rows) = self.rows(at, h) else {
                drawn.push(pixel as u32);
                continue;
            };
            let near = || rows.near();
            let dimmest = near().map(|n| self.brightest(n)).fold(f64::INFINITY, f64::min);
            let allowed = self.canvas.accuracy * dimmest;
            let bend = near().map(bend_at).fold(0.0, larger) + FLOOR * SHARE * allowed;
            let base = TAKEN_OVER * near().map(|n| f64::from(self.filled[n])).fold(0.0, larger);
            let checked = splitmix(&mut (pixel as u64)).is_multiple_of(CHECKED);
            let marched =
                TAKEN_OVER * near().map(|n| f64::from(self.canvas.errors[n] - self.filled[n])).fold(0.0, larger);
            let guess = Guess { pixel, rows, bend, base, marched, allowed, checked };
            if guess.is_good(LEAST) {
                guesses.push(guess);
            } else {
                drawn.push(pixel as u32);
            }
        }
        (guesses, drawn)
    }

    /// κ of each block of the picture: from the pixels in and around it that were drawn to find it.
    fn kappas(&self, guesses: &[Guess]) -> Blocks {
        let [width, height] = self.size();
        let counts = [width, height].map(|n| n.div_ceil(BLOCK));
        let mut single = vec![Some(LEAST / MARGIN); counts[0] * counts[1]];
        for guess in guesses.iter().filter(|g| g.checked) {
            let off = |c| (guess.rows.at(|n| self.value(n, c)) - self.value(guess.pixel, c)).abs();
            let off = (0..self.channels()).map(off).fold(0.0, larger);
            // What steps are wrong by along either ray is counted besides.
            let known = guess.base + f64::from(self.canvas.errors[guess.pixel]) + guess.marched;
            // Where something is not a number, nothing around it is filled in.
            let ratio = if off.is_finite() { (off - known).max(0.0) / guess.bend } else { f64::INFINITY };
            let block = &mut single[guess.pixel / width / BLOCK * counts[0] + guess.pixel % width / BLOCK];
            *block = block.map(|most| most.max(ratio));
        }
        let kappas = around(counts, &single).into_iter().map(|ratio| MARGIN * ratio).collect();
        Blocks { width, columns: counts[0], kappas }
    }

    /// Fills a pixel in.
    fn fill(&mut self, guess: &Guess, kappa: f64) {
        let (pixel, rows, bands) = (guess.pixel, &guess.rows, self.bands);
        // Radiances and transmittances are what they can be, whatever a cubic makes of them.
        for band in 0..bands {
            let at = |n: usize| f64::from(self.canvas.radiance[n * bands + band]);
            self.canvas.radiance[pixel * bands + band] = rows.at(at).max(0.0) as f32;
            if let Some(transmittance) = &mut self.canvas.transmittance {
                let at = |n: usize| f64::from(transmittance[n * bands + band]);
                transmittance[pixel * bands + band] = rows.at(at).clamp(0.0, 1.0) as f32;
            }
        }
        let own = guess.error(kappa);
        let error = own + guess.marched;
        self.filled[pixel] = own as f32;
        self.canvas.errors[pixel] = error as f32;
        let allowed = self.canvas.accuracy * self.brightest(pixel);
        if let Some(most) = &mut self.canvas.predicted {
            *most = (most.0.max(error), most.1.max(error / allowed));
        }
        if let Some(origins) = &mut self.canvas.origins {
            origins.widen(Origins { discretisation: error, ..Origins::default() });
        }
    }
}

/// What holds in the blocks of a picture.
struct Blocks {
    width: usize,
    columns: usize,
    kappas: Vec<f64>,
}

impl Blocks {
    fn at(&self, pixel: usize) -> f64 {
        self.kappas[pixel / self.width / BLOCK * self.columns + pixel % self.width / BLOCK]
    }
}

/// The largest of each number on a lattice and those around it that are known; infinite where none is.
fn around([columns, rows]: [usize; 2], single: &[Option<f64>]) -> Vec<f64> {
    let nearby = |n: usize, count: usize| n.saturating_sub(1)..=(n + 1).min(count - 1);
    let most = |i: usize, j: usize| {
        let all = nearby(j, rows).flat_map(|j| nearby(i, columns).map(move |i| j * columns + i));
        all.filter_map(|n| single[n]).reduce(larger).unwrap_or(f64::INFINITY)
    };
    (0..rows * columns).map(|n| most(n % columns, n / columns)).collect()
}

/// The larger of two numbers; NaN if one is.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

impl Session {
    /// Draws some pixels and fills the others in.
    pub(super) fn draw_adaptive(
        &mut self,
        params: &Params,
        time: f64,
        camera: &Camera,
        progress: &dyn Fn(f64),
    ) -> Result<Drawing, Trouble> {
        let mut frame = self.frame(params, time, Some(camera), scene_bounds(&self.program.lowered, &params.0, time));
        let started = Instant::now();
        let mut canvas = Canvas::new(&self.program, frame.size, &frame);
        let survey = match self.engine.prepared().first_mut() {
            Some(first) => first.survey(&frame).map_err(|e| self.broken(&e))?,
            None => vec![],
        };
        let [width, height] = frame.size.map(|n| n as usize);
        let mut timing = Timing::default();
        let mut drawn = 0u64;
        let mut draw = |session: &mut Self, canvas: &mut Canvas, pixels: &[u32]| -> Result<(), Trouble> {
            if pixels.is_empty() {
                return Ok(());
            }
            timing = timing.and(session.draw_pixels(&frame, canvas, pixels)?);
            frame.goes_on = true;
            drawn += pixels.len() as u64;
            progress(drawn as f64 / (width * height) as f64);
            Ok(())
        };
        let whole = width.min(height) < NARROW || canvas.errors.is_empty();
        let spacing = if whole { 1 } else { SPACING };
        let first =
            (0..height).step_by(spacing).flat_map(|y| (0..width).step_by(spacing).map(move |x| (y * width + x) as u32));
        draw(self, &mut canvas, &first.collect::<Vec<_>>())?;
        let bands = self.program.places.len();
        let mut filling = Filling { canvas: &mut canvas, survey, bands, filled: vec![0.0; width * height] };
        let mut h = spacing / 2;
        while h > 0 {
            let (guesses, mut pixels) = filling.guesses(h);
            pixels.extend(guesses.iter().filter(|g| g.checked).map(|g| g.pixel as u32));
            pixels.sort_unstable();
            draw(self, filling.canvas, &pixels)?;
            let kappas = filling.kappas(&guesses);
            let (good, bad): (Vec<&Guess>, Vec<&Guess>) =
                guesses.iter().filter(|g| !g.checked).partition(|g| g.is_good(kappas.at(g.pixel)));
            draw(self, filling.canvas, &bad.iter().map(|g| g.pixel as u32).collect::<Vec<_>>())?;
            good.into_iter().for_each(|guess| filling.fill(guess, kappas.at(guess.pixel)));
            h /= 2;
        }
        // Filling in is work of the host, which no clock of a device knows.
        timing = Timing { milliseconds: started.elapsed().as_secs_f64() * 1e3, clock: Clock::Wall, ..timing };
        let drawing = self.drawing(canvas, timing, params, time)?;
        Ok(Drawing { drawn: Some(drawn), ..drawing })
    }

    /// Draws some pixels, counted row by row.
    fn draw_pixels(&mut self, frame: &Frame, canvas: &mut Canvas, pixels: &[u32]) -> Result<Timing, Trouble> {
        let width = frame.size[0];
        let place = |pixel: &u32| -> PackedRay {
            let [x, y] = [pixel % width, pixel / width].map(|n| n as f32);
            [x, y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        };
        let places: Vec<PackedRay> = pixels.iter().map(place).collect();
        let drawn = trace_parts(&mut self.engine, &self.program, frame, &places, &mut |reader, i, record| {
            canvas.put(reader, pixels[i] as usize, record);
        });
        drawn.map_err(|e| self.broken(&e))
    }
}
