//! Pictures and probes of more and more pieces, until more of them change nothing by more than the accuracy allows.
//!
//! With pieces of size h (the thickness of a slab, the spacing of a lattice) the rules are of second order where fields are
//! smooth, and of first order at creases and boundaries. The error at h is therefore estimated from what was found at H > h
//! as |I(h) − I(H)| / (H/h − 1), which is exact for the first order and too large for the second.

use super::canvas::Canvas;
use super::{Cause, RayAnswer, Session, Trouble};
use crate::engine::gpu::Timing;
use crate::frame::{Frame, Origins};
use compiler::diagnostic::{Diagnostic, Diagnostics};
use std::time::Instant;

/// Errors of nodes of light that are less than this of those before are worth more slabs.
const SHRINKING: f64 = 0.7;
/// As long as there are no more slabs than these, whose nodes are as close as they get: what is left is reported.
const LIT_SLABS: u32 = 512;

/// The code of a picture that would take longer than it may.
pub(crate) const TOO_LONG: &str = "E0658";

/// What pieces have taken so far.
struct Clock {
    started: Instant,
    patience: Option<f64>,
    /// Numbers of pieces, and the seconds that each took.
    taken: Vec<(f64, f64)>,
}

impl Clock {
    fn new(patience: Option<f64>) -> Self {
        Self { started: Instant::now(), patience, taken: vec![] }
    }

    fn spent(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn tick(&mut self, count: u32) {
        let before: f64 = self.taken.iter().map(|t| t.1).sum();
        self.taken.push((f64::from(count), self.spent() - before));
    }

    /// The seconds that so many pieces would take, and those that are left, if that is less: in proportion to their number, but for what
    /// does not grow with it, which two numbers tell. Half of what the first ones took is counted as that: drivers compile shaders then.
    fn exceeds(&self, count: u32) -> Option<(f64, f64)> {
        let left = self.patience? - self.spent();
        let count = f64::from(count);
        let expected = match *self.taken.as_slice() {
            [] => return None,
            [(n, seconds)] => seconds * (1.0 + count / n) / 2.0,
            [.., (n, less), (m, more)] => more + ((more - less) / (m - n)).max(0.0) * (count - m),
        };
        (expected > left).then_some((expected, left.max(0.0)))
    }
}

/// How many pieces, and of what size.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) struct Pieces {
    pub(super) count: u32,
    pub(super) size: f64,
}

/// How many pieces there are at first and at most; the same if a number was asked for.
#[derive(Copy, Clone, Debug)]
pub(super) struct Ladder {
    pub(super) first: u32,
    pub(super) most: u32,
    /// By what power of their number the size of pieces falls: 1 for slabs, 1/3 for a lattice.
    pub(super) power: f64,
    /// Whether everything has a closed form, so that nothing is left but what rays say of themselves.
    pub(super) exact: bool,
}

/// What the last pieces gave.
pub(super) struct Refined {
    pub(super) frame: Frame,
    pub(super) canvas: Canvas,
    /// Of everything that was drawn.
    pub(super) timing: Timing,
    pub(super) pieces: Pieces,
    /// How many pieces there were in all.
    pub(super) spent: u64,
}

impl Ladder {
    fn is_asked(&self) -> bool {
        self.first == self.most
    }

    /// As many as an error of second order asks for, sizes halved at least and divided by eight at most.
    fn next(&self, count: u32, share: f64) -> u32 {
        let finer = (1.1 * share.sqrt()).clamp(2.0, 8.0).powf(1.0 / self.power).min(64.0);
        ((f64::from(count) * finer) as u32).min(self.most)
    }
}

impl Session {
    /// Draws with more and more pieces; `frame` makes the drawing's frame of a number of them, and says what came of it.
    pub(super) fn refine(
        &mut self,
        ladder: Ladder,
        progress: &dyn Fn(f64),
        frame: &dyn Fn(&Self, u32) -> (Frame, Pieces),
    ) -> Result<Refined, Trouble> {
        let bands = self.program.places.len();
        let mut count = ladder.first;
        let mut before: Option<(Pieces, Canvas, Timing, f64)> = None;
        let mut spent = 0u64;
        let mut clock = Clock::new(self.patience);
        loop {
            self.expect(&clock, count)?;
            let (frame, pieces) = frame(self, count);
            spent += u64::from(pieces.count);
            let (mut canvas, mut timing) = self.canvas(&frame, progress)?;
            clock.tick(count);
            let own = canvas.predicted.map_or(0.0, |p| p.1);
            let Some((larger, coarse, so_far, own_before)) = before.take() else {
                if ladder.exact {
                    return Ok(Refined { frame, canvas, timing, pieces, spent });
                }
                if ladder.is_asked() {
                    // Only what was asked for: nothing tells how good it is but the comparison with the reference.
                    canvas.say_nothing();
                    return Ok(Refined { frame, canvas, timing, pieces, spent });
                }
                before = Some((pieces, canvas, timing, own));
                count = ladder.next(count, 0.0);
                continue;
            };
            timing = timing.and(so_far);
            // What is blended in f16 gets worse with every piece.
            let rounded = canvas.predicted.filter(|_| self.blends_half()).map_or(0.0, |p| p.1);
            let share = canvas.compare(&coarse, larger.size / pieces.size - 1.0, bands);
            canvas.evaluations = canvas.evaluations.zip(coarse.evaluations).map(|(a, b)| a + b);
            // What nodes of light are wrong by shrinks with the slabs, unless there are as many as there may be.
            let shrinks = self.follows_light() && own < SHRINKING * own_before && count < LIT_SLABS;
            let share = if shrinks { share + own } else { share };
            if share <= rounded.max(1.0) || count >= ladder.most || !share.is_finite() {
                return Ok(Refined { frame, canvas, timing, pieces, spent });
            }
            before = Some((pieces, canvas, timing, own));
            count = ladder.next(count, share);
        }
    }

    /// Fails where so many pieces would take longer than they may.
    fn expect(&self, clock: &Clock, count: u32) -> Result<(), Trouble> {
        let Some((expected, patience)) = clock.exceeds(count) else { return Ok(()) };
        let message = format!("{count} pieces would take about {expected:.1} s, and {patience:.1} s are left for them");
        Err(self.trouble(Cause::Machine, Diagnostics(vec![Diagnostic::error(TOO_LONG, message)])))
    }

    /// Answers with more and more pieces; `probe` answers with a number of them. What it answered last is what comes out.
    pub(super) fn refine_probe(
        &mut self,
        ladder: Ladder,
        probe: &mut dyn FnMut(&mut Self, u32) -> Result<(Vec<RayAnswer>, Pieces), Trouble>,
    ) -> Result<(Vec<RayAnswer>, Pieces), Trouble> {
        let accuracy = self.accuracy();
        if ladder.is_asked() {
            // Fewer of them tell as much about the error as more would. What was asked for comes last.
            let fewer = (f64::from(ladder.first) * 0.5f64.powf(1.0 / ladder.power)).ceil() as u32;
            let rough = if fewer < ladder.first { Some(probe(self, fewer)?) } else { None };
            let (mut answers, pieces) = probe(self, ladder.first)?;
            if let Some((rough, larger)) = rough {
                compare(&mut answers, &rough, larger.size / pieces.size - 1.0, accuracy);
            }
            return Ok((answers, pieces));
        }
        let (mut answers, mut pieces) = probe(self, ladder.first)?;
        let mut count = ladder.next(ladder.first, 0.0);
        loop {
            let (mut fine, smaller) = probe(self, count)?;
            let share = compare(&mut fine, &answers, pieces.size / smaller.size - 1.0, accuracy);
            if share <= 1.0 || count >= ladder.most || !share.is_finite() {
                return Ok((fine, smaller));
            }
            (answers, pieces) = (fine, smaller);
            count = ladder.next(count, share);
        }
    }
}

/// Adds the estimated error of answers with more pieces to them, adds up the evaluations, and gives the largest error as a
/// multiple of what is allowed: |ΔL| ≤ A·|L|, |ΔT| ≤ A, |Δτ| ≤ A·τ.
fn compare(fine: &mut [RayAnswer], rough: &[RayAnswer], ratio: f64, accuracy: f64) -> f64 {
    let mut worst = 0.0f64;
    for (fine, rough) in fine.iter_mut().zip(rough) {
        let off = |a: &[f64], b: &[f64]| -> Vec<f64> {
            let change = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() / ratio.max(1e-9) };
            a.iter().zip(b).map(change).collect()
        };
        // The largest of all bands: in a single one two errors may be alike by chance.
        let radiance = off(&fine.radiance, &rough.radiance).into_iter().fold(0.0, f64::max);
        for error in &mut fine.error {
            *error += radiance;
        }
        let light = fine.error.iter().zip(&fine.radiance).map(|(e, l)| if *e == 0.0 { 0.0 } else { e / l.abs() });
        let clear = off(&fine.transmittance, &rough.transmittance);
        let depth = off(&fine.optical_depth, &rough.optical_depth);
        let depth = depth.iter().zip(&fine.optical_depth).map(|(e, d)| if *e == 0.0 { 0.0 } else { e / d });
        worst = light.chain(clear).chain(depth).fold(worst, f64::max);
        fine.evaluations += rough.evaluations;
    }
    worst / accuracy
}

impl Canvas {
    /// Estimates the error from a picture with fewer pieces; the largest, as a multiple of what is allowed.
    fn compare(&mut self, coarse: &Self, ratio: f64, bands: usize) -> f64 {
        let own = self.predicted.unwrap_or((0.0, 0.0));
        self.errors.resize(self.radiance.len() / bands, 0.0);
        let (mut error, mut share) = (0.0f64, 0.0f64);
        let mut apart = vec![0.0f32; self.errors.len()];
        let pixels = self.radiance.chunks_exact(bands).zip(coarse.radiance.chunks_exact(bands));
        for ((fine, rough), slot) in pixels.zip(&mut apart) {
            let off = fine.iter().zip(rough).map(|(a, b)| f64::from((a - b).abs()) / ratio).fold(0.0, f64::max);
            let brightest = fine.iter().fold(0.0f32, |m, v| m.max(*v));
            *slot = off as f32;
            error = error.max(off);
            share = share.max(off / (self.accuracy * self.white.max(f64::from(brightest))));
        }
        // In a single pixel two errors may be alike by chance: the largest of those around it counts.
        for (own, off) in self.errors.iter_mut().zip(widest(&apart, self.size[0] as usize)) {
            *own += off;
        }
        if let Some(origins) = &mut self.origins {
            origins.discretisation += error;
        }
        self.predicted = Some((error + own.0, share + own.1));
        share
    }

    /// Where nothing is known of the error but by comparison with the reference.
    pub(super) fn say_nothing(&mut self) {
        (self.predicted, self.origins, self.errors) = (None, None, vec![]);
    }

    /// Takes the difference from other pictures that may be right for the error, where that is more than is known. `cut` of the light of a
    /// pixel is left out besides, and `rounded` of it may be rounding.
    pub(super) fn enclose(&mut self, others: &[Self], (cut, rounded): (f64, f64), bands: usize) {
        self.errors.resize(self.radiance.len() / bands, 0.0);
        let (mut error, mut share) = (0.0f64, 0.0f64);
        let mut origins = Origins::default();
        for (pixel, known) in self.errors.iter_mut().enumerate() {
            let own = pixel * bands..(pixel + 1) * bands;
            let light = &self.radiance[own.clone()];
            let brightest = f64::from(light.iter().fold(0.0f32, |m, v| m.max(*v)));
            let apart = |other: &Self| {
                let pairs = light.iter().zip(&other.radiance[own.clone()]);
                pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            };
            let discretisation = f64::from(others.iter().map(apart).fold(0.0, f32::max).max(*known));
            let (rounding, storage) = (rounded * brightest, cut * brightest);
            let off = discretisation + rounding + storage;
            origins.widen(Origins { discretisation, rounding, storage, ..Origins::default() });
            *known = off as f32;
            error = error.max(off);
            share = share.max(off / (self.accuracy * self.white.max(brightest)));
        }
        self.predicted = Some((error, share));
        self.origins = Some(origins);
    }
}

/// The largest of each pixel and those around it, of pixels row by row.
fn widest(pixels: &[f32], width: usize) -> Vec<f32> {
    let around = |list: &[f32], step: usize, inside: &dyn Fn(usize) -> [bool; 2]| -> Vec<f32> {
        let one = |i: usize| {
            let [before, after] = inside(i);
            let before = if before { list[i - step] } else { list[i] };
            let after = if after { list[i + step] } else { list[i] };
            list[i].max(before).max(after)
        };
        (0..list.len()).map(one).collect()
    };
    let width = width.max(1);
    let across = around(pixels, 1, &|i| [i % width > 0, i % width + 1 < width]);
    around(&across, width, &|i| [i >= width, i + width < pixels.len()])
}

#[cfg(test)]
mod tests {
    use super::widest;

    #[test]
    fn the_largest_around_a_pixel_does_not_wrap_around_rows() {
        let pixels = [0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0];
        assert_eq!(widest(&pixels, 4), [0.0, 0.0, 9.0, 9.0, 0.0, 0.0, 9.0, 9.0, 0.0, 0.0, 5.0, 5.0]);
        assert_eq!(widest(&[], 0), [0.0; 0]);
    }
}
