//! The projections of data along a ray: largest, smallest and mean value, and the first surface of a value.
//!
//! Each stretch between cell faces is represented by its interpolant, divided until that is good enough to decide: a stretch
//! whose interpolant stays below the largest value so far is never looked at again.
//!
//! A pixel is either the colour of its value or, where the ray meets no data, the background; so its transmittance is 0 or 1.

use super::field::{Ray, Sampler, bad_coefficient, with_span};
use super::gauss::{Decay, N, Nodes, RULE, monotone, root};
use super::interval::Intervals;
use super::scatter::PLACES;
use super::split::{cuts_of, sort_splits, splits_of, thin};
use super::trace::{BANDS, MOST, PerBand, Worker};
use super::{ErrorKind, Options, RayResult};
use crate::frame::vector::{Vec3, add, dot, normalize, scale};
use compiler::diagnostic::Diagnostic;
use compiler::ir::Composite;
use compiler::ir::eval::{Scratch, Voxels};

/// Divisions of a stretch before its interpolant is taken as it is: 2⁻⁴⁰ of it is below what positions resolve.
const DEPTH: u8 = 40;

/// One evaluated stretch of data.
struct Stretch {
    a: f64,
    h: f64,
    /// Legendre coefficients of the data.
    c: Nodes,
    /// Of the interpolant.
    error: f64,
    /// Values at the nodes.
    values: Nodes,
    depth: u8,
}

impl Stretch {
    /// Nothing can be gained by dividing.
    fn last(&self) -> bool {
        self.depth >= DEPTH || self.h <= 16.0 * f64::EPSILON * self.a.abs()
    }
}

/// Data of one medium along a ray: hands out stretches front to back.
struct Walk<'w> {
    medium: usize,
    field: &'w Sampler,
    scratch: Scratch,
    stack: Vec<(f64, f64, u8, u8)>,
}

/// A stretch without its very ends: where a shape ends as a grid does, places there may round to outside of it, and a single
/// such value would count.
fn inner(ray: &Ray, (start, end): (f64, f64)) -> (f64, f64) {
    let inset = PLACES * ray.origin.iter().fold(end, |m, x| m.max(x.abs()));
    if end - start > 4.0 * inset { (start + inset, end - inset) } else { (start, end) }
}

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Projects the data of all media that have some; of several, the one with the largest (smallest, nearest) value counts,
    /// and of means the mean of their colours by length.
    pub(super) fn project(
        &mut self,
        ray: &Ray,
        behind: &PerBand,
        composite: Composite,
        level: f64,
        options: &Options,
    ) -> Result<RayResult, Diagnostic> {
        self.evaluations = 0;
        let inside = self.inside(ray)?;
        // Value, its error, shade, and medium or weight.
        let mut best: Option<(f64, f64, usize, f64)> = None;
        let mut mixed = [0.0; BANDS];
        let mut mixed_error = [0.0; BANDS];
        let mut length = 0.0;
        for (m, inside) in inside.iter().enumerate() {
            let medium = &self.fields.media[m];
            let Some(field) = medium.data.as_ref().map(|d| d.sampler(options.is_lean())) else { continue };
            if inside.0.last().is_some_and(|i| i.1.is_infinite()) {
                let message =
                    format!("the data of medium `{}` are projected along a ray that never leaves it", medium.name);
                return Err(with_span(Diagnostic::error("E0652", message), medium.span)
                    .hint("give it a `shape`, such as `bounds` of its grid"));
            }
            if inside.0.is_empty() {
                continue;
            }
            let rtol = options.rtol.max(1e-14);
            match composite {
                Composite::Maximum | Composite::Minimum => {
                    let sign = if composite == Composite::Maximum { 1.0 } else { -1.0 };
                    let (value, error) = self.extreme(ray, m, field, inside, sign, rtol)?;
                    if best.is_none_or(|b| sign * value > sign * b.0) {
                        best = Some((value, error, m, 1.0));
                    }
                }
                Composite::Average => {
                    let (value, error) = self.mean(ray, m, field, inside, rtol)?;
                    let weight: f64 = inside.0.iter().map(|i| i.1 - i.0).sum();
                    let (color, wrong) = self.color(m, value, error)?;
                    for b in 0..self.bands {
                        mixed[b] += weight * color[b];
                        mixed_error[b] += weight * wrong[b];
                    }
                    length += weight;
                }
                Composite::Isosurface(_) => {
                    if let Some((t, error)) = self.crossing(ray, m, field, inside, level)?
                        && best.is_none_or(|b| t < b.0)
                    {
                        best = Some((t, error, m, 0.0));
                    }
                }
                Composite::Radiance => {}
            }
        }
        let (radiance, error, hit) = match (composite, best) {
            (Composite::Isosurface(_), Some((t, wrong, m, _))) => {
                let shade = self.shade(ray, m, t)?;
                let beside = self.shade(ray, m, (t + wrong).max(0.0))?;
                let (color, _) = self.color(m, level, 0.0)?;
                let slack = (shade - beside).abs() + 1e-12;
                (color.map(|c| c * shade), color.map(|c| c.abs() * slack), true)
            }
            (_, Some((value, error, m, _))) => {
                let (color, wrong) = self.color(m, value, error)?;
                (color, wrong, true)
            }
            (_, None) if length > 0.0 => (mixed.map(|c| c / length), mixed_error.map(|e| e / length), true),
            (_, None) => (*behind, [0.0; BANDS], false),
        };
        let bands = self.bands;
        let depth = if hit { f64::INFINITY } else { 0.0 };
        Ok(RayResult {
            radiance: radiance[..bands].to_vec(),
            transmittance: vec![(-depth).exp(); bands],
            optical_depth: vec![depth; bands],
            error: error[..bands].to_vec(),
            rounding: error[..bands].iter().zip(&radiance).map(|(e, l)| e.min(4.0 * f64::EPSILON * l.abs())).collect(),
            error_tau: vec![0.0; bands],
            error_kind: if hit { ErrorKind::Estimate } else { ErrorKind::Bound },
            evaluations: self.evaluations,
            complete: self.evaluations <= options.max_evaluations,
        })
    }

    /// Begins at one interval of a medium.
    fn walk<'w>(&mut self, ray: &Ray, medium: usize, field: &'w Sampler, (start, end): (f64, f64)) -> Walk<'w> {
        let mut cuts = vec![(start, false), (end, false)];
        if let Some(tape) = &field.straight {
            let mut scratch = tape.scratch();
            let mut ts = [start; N];
            ts[1] = end;
            self.fields.run(tape, &mut scratch, self.voxels, ray, &ts, false);
            for (i, levels) in field.levels.iter().enumerate() {
                let g = tape.component(&scratch, i, 0);
                cuts_of((g[0], g[1]), (start, end), levels, MOST, &mut cuts);
            }
        }
        let cuts = thin(cuts, false);
        let least = 32usize.div_ceil(cuts.len().max(2) - 1);
        let mut stack = vec![];
        for pair in cuts.windows(2).rev() {
            let h = (pair[1] - pair[0]) / least as f64;
            (0..least).rev().for_each(|i| stack.push((pair[0] + h * i as f64, h, 0, 0)));
        }
        Walk { medium, field, scratch: field.tape.scratch(), stack }
    }

    /// The next stretch, divided where its events ask for it.
    fn next(&mut self, ray: &Ray, walk: &mut Walk<'_>) -> Result<Option<Stretch>, Diagnostic> {
        while let Some((a, h, depth, forced)) = walk.stack.pop() {
            let ts = RULE.x.map(|x| a + h * x);
            self.fields.run(&walk.field.tape, &mut walk.scratch, self.voxels, ray, &ts, false);
            self.evaluations += N as u64;
            let values = *walk.field.tape.component(&walk.scratch, 0, 0);
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                let medium = &self.fields.media[walk.medium];
                let place = scale(ray.at(ts[i]), self.metre);
                return Err(bad_coefficient(&medium.name, medium.span, "the projected data", values[i], place));
            }
            let mut xs = vec![];
            if forced < 10 {
                for (i, watch) in walk.field.watches.iter().enumerate() {
                    let watched = walk.field.tape.component(&walk.scratch, walk.field.roots + i, 0);
                    splits_of(watched, watch, forced, false, &mut xs);
                }
                sort_splits(&mut xs);
            }
            if !xs.is_empty() {
                let mut end = 1.0;
                for x in xs.iter().rev().map(|x| x.0).chain([0.0]) {
                    walk.stack.push((a + h * x, h * (end - x), depth + 1, forced + 1));
                    end = x;
                }
                continue;
            }
            let c = RULE.coefficients(&values);
            let size = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let error = Decay::of(&c).interpolation() + 8.0 * f64::EPSILON * size;
            return Ok(Some(Stretch { a, h, c, error, values, depth }));
        }
        Ok(None)
    }

    fn divide(walk: &mut Walk<'_>, s: &Stretch) {
        let half = 0.5 * s.h;
        walk.stack.push((s.a + half, half, s.depth + 1, 0));
        walk.stack.push((s.a, half, s.depth + 1, 0));
    }

    /// Largest value of `sign · data`, unsigned again, and its error.
    fn extreme(
        &mut self,
        ray: &Ray,
        m: usize,
        field: &Sampler,
        inside: &Intervals,
        sign: f64,
        rtol: f64,
    ) -> Result<(f64, f64), Diagnostic> {
        let (mut best, mut wrong) = (f64::NEG_INFINITY, 0.0);
        for interval in &inside.0 {
            let mut walk = self.walk(ray, m, field, inner(ray, *interval));
            while let Some(s) = self.next(ray, &mut walk)? {
                let seen = s.values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(sign * v));
                if seen > best {
                    (best, wrong) = (seen, 0.0);
                }
                let bound: f64 = sign * s.c[0] + s.c[1..].iter().map(|c| c.abs()).sum::<f64>() + s.error;
                if bound <= best {
                    continue;
                }
                let top = monotone(&s.c).iter().fold(f64::NEG_INFINITY, |m, p| m.max(sign * p.1));
                if top + s.error <= best {
                    continue;
                }
                if s.error <= rtol * top.abs() || s.last() {
                    if top > best {
                        (best, wrong) = (top, s.error);
                    }
                } else {
                    Self::divide(&mut walk, &s);
                }
            }
        }
        Ok((sign * best, wrong))
    }

    /// Mean over the length inside, and its error.
    fn mean(
        &mut self,
        ray: &Ray,
        m: usize,
        field: &Sampler,
        inside: &Intervals,
        rtol: f64,
    ) -> Result<(f64, f64), Diagnostic> {
        let length: f64 = inside.0.iter().map(|i| i.1 - i.0).sum();
        let mut total = super::compose::Sum::default();
        let (mut size, mut wrong) = (0.0f64, 0.0);
        for interval in &inside.0 {
            let mut walk = self.walk(ray, m, field, *interval);
            while let Some(s) = self.next(ray, &mut walk)? {
                let mean = RULE.mean(&s.values);
                let error = Decay::of(&s.c).quadrature();
                size = size.max(mean.abs());
                if error <= 0.25 * rtol * size || error * s.h <= 1e-3 * rtol * size * length || s.last() {
                    total.add(mean * s.h);
                    wrong += error * s.h;
                } else {
                    Self::divide(&mut walk, &s);
                }
            }
        }
        Ok((total.get() / length, wrong / length + 4.0 * f64::EPSILON * size))
    }

    /// First parameter where the data pass `level`, by value or by a jump between stretches, and its error.
    fn crossing(
        &mut self,
        ray: &Ray,
        m: usize,
        field: &Sampler,
        inside: &Intervals,
        level: f64,
    ) -> Result<Option<(f64, f64)>, Diagnostic> {
        for interval in &inside.0 {
            let mut before: Option<bool> = None;
            let mut walk = self.walk(ray, m, field, inner(ray, *interval));
            while let Some(s) = self.next(ray, &mut walk)? {
                let spread: f64 = s.c[1..].iter().map(|c| c.abs()).sum::<f64>() + s.error;
                if (s.c[0] - level).abs() > spread {
                    let above = s.c[0] > level;
                    if before.is_some_and(|b| b != above) {
                        return Ok(Some((s.a, 0.0)));
                    }
                    before = Some(above);
                    continue;
                }
                let size = level.abs().max(s.values.iter().fold(0.0f64, |m, v| m.max(v.abs())));
                if s.error > 1e-11 * size && !s.last() {
                    Self::divide(&mut walk, &s);
                    continue;
                }
                let points = monotone(&s.c);
                let above = points[0].1 >= level;
                if before.is_some_and(|b| b != above) && (points[0].1 - level).abs() > s.error {
                    return Ok(Some((s.a, 0.0)));
                }
                for pair in points.windows(2) {
                    if (pair[0].1 >= level) != (pair[1].1 >= level) {
                        let x = root(&s.c, level, pair[0], pair[1]);
                        return Ok(Some((s.a + s.h * x, 1e-10 * s.h)));
                    }
                }
                before = Some(points[points.len() - 1].1 >= level);
            }
        }
        Ok(None)
    }

    /// Headlight on a Lambertian surface: |n·d| with the exact gradient of the data as normal; 1 where it has none.
    fn shade(&mut self, ray: &Ray, m: usize, t: f64) -> Result<f64, Diagnostic> {
        let medium = &self.fields.media[m];
        let at = ray.at(t);
        let gradient: Vec3 = if let Some(tape) = &medium.gradient {
            let mut scratch = tape.scratch();
            self.fields.run_at(tape, &mut scratch, self.voxels, ray, &[at; N]);
            self.evaluations += 1;
            std::array::from_fn(|c| tape.component(&scratch, 0, c)[0])
        } else if let Some(field) = medium.data.as_ref().map(|d| d.sampler(true)) {
            // No symbolic derivative: central differences of fourth order.
            let step = 1e-4 * crate::frame::vector::length(at).max(1e-3);
            let mut scratch = field.tape.scratch();
            std::array::from_fn(|axis| {
                let mut unit = [0.0; 3];
                unit[axis] = step;
                let points = [-2.0, -1.0, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0].map(|k| add(at, scale(unit, k)));
                self.fields.run_at(&field.tape, &mut scratch, self.voxels, ray, &points);
                self.evaluations += 4;
                let v = field.tape.component(&scratch, 0, 0);
                (v[0] - 8.0 * v[1] + 8.0 * v[2] - v[3]) / (12.0 * step)
            })
        } else {
            return Ok(1.0);
        };
        Ok(normalize(gradient).map_or(1.0, |n| dot(n, ray.direction).abs()))
    }

    /// Colour of a value, and how far an error of the value moves it.
    fn color(&mut self, m: usize, value: f64, error: f64) -> Result<(PerBand, PerBand), Diagnostic> {
        let medium = &self.fields.media[m];
        let Some(tape) = &medium.color else { return Ok(([1.0; BANDS], [0.0; BANDS])) };
        let mut scratch = tape.scratch();
        let mut lanes = [value; N];
        (lanes[1], lanes[2]) = (value - error, value + error);
        self.fields.run_value(tape, &mut scratch, self.voxels, &lanes);
        self.evaluations += 1;
        let (mut color, mut wrong) = ([0.0; BANDS], [0.0; BANDS]);
        for b in 0..self.bands {
            let v = tape.component(&scratch, 0, b.min(tape.width(0) - 1));
            if !v[0].is_finite() {
                let message = format!("the colour of medium `{}` is not finite for the value {value}", medium.name);
                return Err(with_span(Diagnostic::error("E0651", message), medium.span));
            }
            color[b] = v[0];
            wrong[b] = (v[1] - v[0]).abs().max((v[2] - v[0]).abs()) + 4.0 * f64::EPSILON * v[0].abs();
        }
        Ok((color, wrong))
    }
}
