//! Directions drawn from phase functions: a histogram of the mean over bands in u = 1 − cosine, with a little of the uniform
//! distribution mixed in so that nothing is left out. Weights are phase/density, so the histogram costs no bias.

use super::super::gauss::{N, Nodes, RULE};
use super::super::trace::BANDS;
use super::random::Random;
use compiler::diagnostic::Diagnostic;
use std::f64::consts::PI;

/// Share of the uniform distribution.
const UNIFORM: f64 = 0.02;

/// A distribution of u = 1 − cosine.
#[derive(Clone, Debug)]
pub(in super::super) struct PhaseTable {
    /// Ends of bins, ascending from 0 to 2.
    edges: Vec<f64>,
    /// Share of all bins up to each edge.
    share: Vec<f64>,
}

/// Bins that narrow towards both ends: so many octaves of each, so many bins in an octave.
fn edges(forward: i32, back: i32, parts: i32) -> Vec<f64> {
    let octaves = |n: i32| {
        let inner =
            (-n..0).flat_map(move |k| (0..parts).map(move |i| 2f64.powi(k) * (1.0 + f64::from(i) / f64::from(parts))));
        std::iter::once(0.0).chain(inner)
    };
    let mut list: Vec<f64> = octaves(forward).chain(std::iter::once(1.0)).collect();
    let mut far: Vec<f64> = octaves(back).map(|u| 2.0 - u).collect();
    far.reverse();
    list.append(&mut far);
    list
}

impl PhaseTable {
    /// `values` gives the phase function at eight cosines, for each of `bands`. Fine tables are for whole frames, rough ones
    /// for one place. Nothing if it is zero throughout.
    pub(in super::super) fn new(
        fine: bool,
        bands: usize,
        mut values: impl FnMut(&Nodes) -> Result<[Nodes; BANDS], Diagnostic>,
    ) -> Result<Option<Self>, Diagnostic> {
        let edges = if fine { edges(44, 44, 8) } else { edges(20, 12, 3) };
        let bins = edges.len() - 1;
        let mut mass = vec![0.0; bins];
        let mut mean = |cosines: &Nodes| -> Result<Nodes, Diagnostic> {
            let all = values(cosines)?;
            Ok(std::array::from_fn(|i| all[..bands].iter().map(|b| b[i]).sum::<f64>()))
        };
        if fine {
            for i in 0..bins {
                let (a, h) = (edges[i], edges[i + 1] - edges[i]);
                mass[i] = h * RULE.mean(&mean(&RULE.x.map(|x| 1.0 - (a + h * x)))?);
            }
        } else {
            for first in (0..bins).step_by(N) {
                let bin = |lane: usize| (first + lane).min(bins - 1);
                let found = mean(&std::array::from_fn(|l| 1.0 - 0.5 * (edges[bin(l)] + edges[bin(l) + 1])))?;
                for lane in 0..N.min(bins - first) {
                    mass[first + lane] = found[lane] * (edges[first + lane + 1] - edges[first + lane]);
                }
            }
        }
        let total: f64 = mass.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return Ok(None);
        }
        let mut share = vec![0.0];
        let mut sum = 0.0;
        for m in mass {
            sum += m / total;
            share.push(sum);
        }
        Ok(Some(Self { edges, share }))
    }

    /// A value of u, and the density of directions there per steradian.
    pub(super) fn draw(&self, random: &mut Random) -> (f64, f64) {
        let u = if random.unit() < UNIFORM {
            2.0 * random.unit()
        } else {
            let x = random.unit() * self.share[self.share.len() - 1];
            let bin = (self.share.partition_point(|s| *s <= x).max(1) - 1).min(self.edges.len() - 2);
            self.edges[bin] + (self.edges[bin + 1] - self.edges[bin]) * random.unit()
        };
        let bin = (self.edges.partition_point(|e| *e <= u).max(1) - 1).min(self.edges.len() - 2);
        let part = (self.share[bin + 1] - self.share[bin]) / (self.edges[bin + 1] - self.edges[bin]);
        (u, (1.0 - UNIFORM) * part / (2.0 * PI) + UNIFORM / (4.0 * PI))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_follow_the_function() {
        for (g, fine) in [
            (0.0, true),
            (0.9, true),
            (0.9, false),
            (-0.6, true),
            (0.9999, true),
            (-0.999_999, true),
            (0.999_999, true),
        ] {
            let hg = |c: f64| (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * c).powf(1.5));
            let table = PhaseTable::new(fine, 1, |c| Ok([c.map(hg); BANDS])).unwrap().unwrap();
            let mut random = Random::new(1, 2, 3);
            let n = 100_000;
            let (mut weight, mut cosine) = (0.0, 0.0);
            for _ in 0..n {
                let (u, density) = table.draw(&mut random);
                let w = hg(1.0 - u) / density;
                assert!(w < if fine { 1.6 } else { 4.0 }, "{g}: {w} at {u:e}");
                weight += w;
                cosine += w * (1.0 - u);
            }
            // Each part of the sphere gets its share: χ² over 32 parts of equal light by Henyey and Greenstein's distribution,
            // whose inverse is closed. 32 degrees of freedom are above 62.5 once in a thousand.
            let parts = 32;
            let part = |c: f64| {
                let below = if g == 0.0 {
                    0.5 * (1.0 + c)
                } else {
                    (1.0 - g * g) / (2.0 * g) * ((1.0 + g * g - 2.0 * g * c).powf(-0.5) - 1.0 / (1.0 + g))
                };
                ((below * f64::from(parts)) as usize).min(parts as usize - 1)
            };
            let mut sums = vec![(0.0, 0.0); parts as usize];
            for _ in 0..n {
                let (u, density) = table.draw(&mut random);
                let w = hg(1.0 - u) / density;
                let sum = &mut sums[part(1.0 - u)];
                *sum = (sum.0 + w, sum.1 + w * w);
            }
            let expected = f64::from(n) / f64::from(parts);
            let chi: f64 = sums
                .iter()
                .map(|(sum, squares)| (sum - expected).powi(2) / (squares - expected * expected / f64::from(n)))
                .sum();
            assert!(chi < 62.5, "{g}: {chi}");
            let n = f64::from(n);
            assert!(
                (weight / n - 1.0).abs() < 0.01 && (cosine / n - g).abs() < 0.01,
                "{g}: {} {}",
                weight / n,
                cosine / n
            );
        }
    }
}
