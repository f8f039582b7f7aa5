//! Directions drawn from phase functions: the sphere cut into rings around the direction of travel, within each of which the
//! function hardly varies.

use super::NoVoxels;
use super::tape::{Environment, LANES, Tape};
use crate::ir::{Graph, NodeId};
use std::f64::consts::PI;

/// Where a ring begins and the one before it ends.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Part {
    /// Of directions that are drawn, the share nearer to straight on.
    pub share: f64,
    /// 1 − cos θ.
    pub versine: f64,
    /// 1 + cos θ.
    pub vercosine: f64,
}

/// Halvings of 1 ∓ cos θ towards straight on and straight back: the narrowest lobes, of mean cosines ±0.999999, are 5·10⁻¹³ wide.
const OCTAVES: i32 = 44;
/// Rings to begin with in each octave.
const FINE: usize = 64;
/// By how much the density of light may vary within a ring, unless there would be more than [`MOST`].
const LEVEL: f64 = 1.1;
/// Most rings.
const MOST: usize = 1024;
/// Share of the directions that are drawn evenly over the sphere, and as many again evenly over the rings: so that none is left
/// out, whatever the params become, and so that rings with little light keep their digits in f32.
const EVEN: f64 = 0.01;

/// 1 − cos θ and 1 + cos θ at the ends of the finest rings, from straight on to straight back.
fn fine() -> Vec<(f64, f64)> {
    let inner = (-OCTAVES..0).flat_map(|k| (0..FINE).map(move |i| 2f64.powi(k) * (1.0 + i as f64 / FINE as f64)));
    let forward: Vec<f64> = std::iter::once(0.0).chain(inner).collect();
    let back = forward.iter().rev().map(|w| (2.0 - w, *w));
    forward.iter().map(|v| (*v, 2.0 - v)).chain(std::iter::once((1.0, 1.0))).chain(back).collect()
}

/// The rings of a phase function, of the mean over its bands. Within each, directions are drawn evenly; the last part ends the
/// last ring.
///
/// A direction's density is that of its ring: (share of the ring)/(2π · its height), about the value of the function.
#[must_use]
pub fn phase_draws(graph: &Graph, node: NodeId, environment: &Environment<'_>) -> Vec<Part> {
    let tape = Tape::new(graph, &[node]);
    let mut scratch = tape.scratch();
    let mut environment = environment.clone();
    let ends = fine();
    let count = ends.len() - 1;
    let height = |from: usize, to: usize| {
        // The difference of the smaller ones has all of its digits.
        if ends[to].0 <= 1.0 { ends[to].0 - ends[from].0 } else { ends[from].1 - ends[to].1 }
    };
    let mut values = vec![];
    for first in (0..count).step_by(LANES) {
        for lane in 0..LANES {
            let i = (first + lane).min(count - 1);
            let middle = |a: f64, b: f64| 0.5 * (a + b);
            let versine = middle(ends[i].0, ends[i + 1].0);
            environment.cos_theta[lane] =
                if versine < 1.0 { 1.0 - versine } else { middle(ends[i].1, ends[i + 1].1) - 1.0 };
        }
        tape.run(&environment, &NoVoxels, &mut scratch);
        let bands = tape.width(0);
        for lane in 0..LANES.min(count - first) {
            let mean = (0..bands).map(|b| tape.component(&scratch, 0, b)[lane]).sum::<f64>() / bands as f64;
            values.push(if mean.is_finite() { mean.max(0.0) } else { 0.0 });
        }
    }
    let total: f64 = (0..count).map(|i| 2.0 * PI * height(i, i + 1) * values[i]).sum();
    let light = if total > 0.0 && total.is_finite() { (1.0 - 2.0 * EVEN) / total } else { 0.0 };
    // Per steradian.
    let density: Vec<f64> = values.iter().map(|v| light * v + EVEN / (4.0 * PI)).collect();
    let mut level = LEVEL;
    let mut rings = merged(&density, level);
    while rings.len() - 1 > MOST {
        level *= LEVEL;
        rings = merged(&density, level);
    }
    let mut weights: Vec<f64> =
        rings.windows(2).map(|r| (r[0]..r[1]).map(|i| 2.0 * PI * height(i, i + 1) * density[i]).sum()).collect();
    let (sum, own) = (weights.iter().sum::<f64>(), EVEN / weights.len() as f64);
    weights.iter_mut().for_each(|w| *w = (1.0 - EVEN) * *w / sum + own);
    let mut share = 0.0;
    let mut parts = vec![];
    for (i, end) in rings.iter().enumerate() {
        parts.push(Part { share, versine: ends[*end].0, vercosine: ends[*end].1 });
        share += weights.get(i).copied().unwrap_or(0.0);
    }
    if let Some(last) = parts.last_mut() {
        last.share = 1.0;
    }
    parts
}

/// Neighbours joined as long as the largest is at most `level` times the smallest: where each group begins, and the end.
fn merged(density: &[f64], level: f64) -> Vec<usize> {
    let mut starts = vec![0];
    let (mut low, mut high) = (f64::INFINITY, 0.0f64);
    for (i, d) in density.iter().enumerate() {
        let (lower, higher) = (low.min(*d), high.max(*d));
        if higher > level * lower {
            starts.push(i);
            (low, high) = (*d, *d);
        } else {
            (low, high) = (lower, higher);
        }
    }
    starts.push(density.len());
    starts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::Input;

    fn line() -> Vec<Part> {
        // f = (1 + μ)/(4π).
        let mut graph = Graph::default();
        let (mu, one) = (graph.input(Input::CosTheta), graph.scalar(1.0));
        let sum = graph.add(mu, one);
        let scale = graph.scalar(0.25 / PI);
        let node = graph.mul(sum, scale);
        phase_draws(&graph, node, &Environment::default())
    }

    #[test]
    fn rings_of_a_line() {
        let parts = line();
        assert_eq!(parts[0], Part { share: 0.0, versine: 0.0, vercosine: 2.0 });
        assert_eq!(parts[parts.len() - 1], Part { share: 1.0, versine: 2.0, vercosine: 0.0 });
        let rings = parts.len() - 1;
        assert!((20..100).contains(&rings), "{rings}");
        for part in &parts {
            assert!((part.versine + part.vercosine - 2.0).abs() < 1e-15, "{part:?}");
            // Of the light, 1 − (1 + μ)²/4 goes nearer to straight on.
            let below = (1.0 - 2.0 * EVEN) * (1.0 - 0.25 * part.vercosine.powi(2)) + EVEN * 0.5 * part.versine;
            let off = part.share - below;
            assert!((-1e-4..EVEN + 1e-4).contains(&off), "{part:?}: {below}");
        }
    }

    #[test]
    fn weights_hardly_vary() {
        for pair in line().windows(2) {
            let [a, b] = pair else { unreachable!("two at a time") };
            let density = (b.share - a.share) / (2.0 * PI * (b.versine - a.versine));
            for mu in [1.0 - a.versine, 1.0 - b.versine] {
                let weight = 0.25 / PI * (1.0 + mu) / density;
                assert!(weight < LEVEL / (1.0 - 3.0 * EVEN), "{pair:?}: {weight}");
            }
        }
    }

    #[test]
    fn rings_of_nothing_cover_the_sphere() {
        let mut graph = Graph::default();
        let zero = graph.scalar(0.0);
        let parts = phase_draws(&graph, zero, &Environment::default());
        assert_eq!(parts.len(), 2);
    }
}
