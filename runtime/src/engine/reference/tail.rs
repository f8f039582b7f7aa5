//! The part of a ray that never leaves a medium: uniform media in closed form, others in octaves until the rest is decided.

use super::compose::{Panel, compose};
use super::field::{Ray, with_span};
use super::gauss::N;
use super::panel::{Slice, constant};
use super::shade::DARK;
use super::trace::{BANDS, PerBand, Segment, Worker};
use super::{Goal, Options};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;

/// What lies beyond the last panel.
#[derive(Copy, Clone, Debug)]
pub(super) struct Rest {
    /// Bands whose optical depth is infinite.
    pub(super) infinite: [bool; BANDS],
    /// Error of the depth by leaving the rest out.
    pub(super) tau: PerBand,
    /// Error of the radiance likewise.
    pub(super) radiance: PerBand,
    /// Whether nothing was left out.
    pub(super) exact: bool,
}

impl Default for Rest {
    fn default() -> Self {
        Self { infinite: [false; BANDS], tau: [0.0; BANDS], radiance: [0.0; BANDS], exact: true }
    }
}

/// First octave, in units.
const FIRST: f64 = 1.0 / 1024.0;
/// Nothing is concluded from decay before this distance, in units: a medium may begin far away.
const NEAR: f64 = 1_048_576.0;
/// Beyond this distance the search ends.
const FAR: f64 = 1e12;

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Integrates a segment without end.
    ///
    /// In octaves [t, 2t]: the depth and radiance of one to those of the one before tell a geometric or faster decay, whose
    /// rest is bounded by the geometric series; a constant is summed in closed form; growth makes the depth infinite.
    pub(super) fn tail(
        &mut self,
        ray: &Ray,
        segments: &[Segment],
        index: usize,
        panels: &mut Vec<Panel>,
        options: &Options,
    ) -> Result<Rest, Diagnostic> {
        let segment = &segments[index];
        let bands = self.bands;
        let mut rest = Rest::default();
        if segment.uniform {
            let mut one = vec![];
            self.first(ray, segments, index, (segment.start, segment.start + 1.0), (1, 0.0), &mut one)?;
            if let Some(p) = one.pop() {
                self.forever(segment, p, segment.start, panels)?;
            }
            return Ok(rest);
        }
        let closed = |m: &usize| self.fields.media[*m].shade.as_ref().is_some_and(|s| s.closed.is_some());
        let smooth = segment.active.iter().all(closed);
        let (mut t, mut w) = (segment.start, FIRST);
        let mut previous: Option<(PerBand, PerBand, f64)> = None;
        loop {
            let before = compose(panels, &[0.0; BANDS], bands);
            let first = panels.len();
            // Each node of what scatters is dear, and closed forms are smooth.
            let least = if segment.scatters && smooth { 1 } else { 8 };
            self.first(ray, segments, index, (t, t + w), (least, 512.0), panels)?;
            t += w;
            let after = compose(panels, &[0.0; BANDS], bands);
            let steps: PerBand = std::array::from_fn(|b| panels[first..].iter().map(|p| p.slices[b].tau).sum::<f64>());
            let gains: PerBand = std::array::from_fn(|b| (after.radiance[b] - before.radiance[b]).max(0.0));
            for b in 0..bands {
                self.opaque[b] = after.tau[b] > DARK;
            }
            let even = panels[first..].iter().all(|p| p.slices[..bands].iter().all(|s| s.exact));
            let mut settled = true;
            for b in 0..bands {
                let tau = after.tau[b];
                let allowed_tau = match options.goal {
                    Goal::All => options.rtol * tau.min(1.0),
                    Goal::Radiance => options.rtol,
                };
                let allowed = (options.rtol * after.radiance[b]).max(options.atol);
                let (tau_before, gain_before) = previous.map_or((0.0, 0.0), |p| (p.0[b], p.1[b]));
                let tau_rest = geometric(tau_before, steps[b]);
                let gain_rest = geometric(gain_before, gains[b]);
                let grows = self.opaque[b] && (self.overflow[b] || t >= NEAR && steps[b] >= 0.9 * tau_before);
                if grows {
                    rest.infinite[b] = true;
                    rest.tau[b] = 0.0;
                    rest.radiance[b] = 0.0;
                } else if t >= NEAR && tau_rest <= 0.1 * allowed_tau && gain_rest <= 0.1 * allowed {
                    rest.infinite[b] = false;
                    rest.tau[b] = tau_rest;
                    rest.radiance[b] = gain_rest;
                } else {
                    settled = false;
                }
            }
            if settled {
                // A rest that is zero to the last bit on two octaves counts as left out all the same.
                rest.exact = false;
                return Ok(rest);
            }
            // Constant to the last bit over two octaves, and no band in motion: the closed form from here on.
            let alike = previous.is_some_and(|(tau, _, width)| {
                (0..bands).all(|b| (steps[b] / w - tau[b] / width).abs() <= 1e-14 * steps[b] / w)
            });
            if t >= NEAR
                && even
                && alike
                && let Some(last) = panels.last().cloned()
            {
                rest.exact = false;
                self.forever(segment, last, t, panels)?;
                for b in 0..bands {
                    rest.infinite[b] |= steps[b] > 0.0;
                }
                return Ok(rest);
            }
            if t > FAR || self.evaluations > options.max_evaluations {
                return Err(self.endless(segment, "cannot be shown to converge"));
            }
            previous = Some((steps, gains, w));
            w *= 2.0;
        }
    }

    /// Continues the constants of a panel from `t` to infinity.
    fn forever(&self, segment: &Segment, like: Panel, t: f64, panels: &mut Vec<Panel>) -> Result<(), Diagnostic> {
        let mut slices = [Slice::default(); BANDS];
        for b in 0..self.bands {
            let s = &like.slices[b];
            let sigma = s.tau / like.h;
            if sigma == 0.0 {
                if s.radiance > 0.0 {
                    return Err(
                        self.endless(segment, "emits without end and absorbs nothing: its radiance is infinite")
                    );
                }
                continue;
            }
            // radiance = j·(1 − e^(−τ))/σ gives back the source function.
            let source = s.radiance / -(-s.tau).exp_m1();
            slices[b] = constant(f64::INFINITY, sigma, source * sigma);
        }
        panels.push(Panel { a: t, h: f64::INFINITY, slices, ..like });
        Ok(())
    }

    fn endless(&self, segment: &Segment, why: &str) -> Diagnostic {
        let media = segment.active.iter().map(|m| &self.fields.media[*m]);
        let culprit = media.clone().find(|m| !m.field.uniform).or_else(|| media.clone().next());
        let (name, span) = culprit.map_or(("", None), |m| (m.name.as_str(), m.span));
        with_span(Diagnostic::error("E0652", format!("medium `{name}` {why} along a ray that never leaves it")), span)
            .hint("give it a `shape`")
            .note(format!("looked at {} points", self.evaluations.max(N as u64)))
    }
}

/// Rest of a series whose last two terms are given, if it decays at least geometrically.
pub(super) fn geometric(before: f64, last: f64) -> f64 {
    if last == 0.0 && before == 0.0 {
        return 0.0;
    }
    let ratio = last / before;
    if ratio < 0.75 { last * ratio / (1.0 - ratio) } else { f64::INFINITY }
}
