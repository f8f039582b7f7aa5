//! How far a field rises between two places above what it is at both of them, found by looking at many such pairs: an estimate,
//! which steps through a medium go by where they find nothing of it.

use super::Vec3;
use super::bounds::shells;
use super::vector::{length, sub};
use compiler::ir::eval::{Environment, LANES, Lanes, NoVoxels, Scratch, Tables, Tape};
use compiler::ir::{FieldScene, NodeId};
use compiler::program::SPANS;
use rayon::prelude::*;

/// Bundles of lines that are looked at, each from close by, for the first spans, and from afar, for the others.
const BUNDLES: u32 = 32;
/// The first of the spans that are looked at from afar.
const FAR_FROM: usize = 3;
/// Places on a line.
const PLACES: usize = 65;
/// Places that the shortest span of a line is long.
const SHORTEST: usize = 2;
/// How much higher than the highest of those that were looked at some may rise.
const BEYOND: f64 = 2.0;

/// What was found of a medium's support.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) struct Rises {
    /// How far it rises, over spans of [`SPANS`] cells; as much as f32 holds where it is no number somewhere.
    pub(super) over: [f64; SPANS.len()],
    /// The length over which a coefficient rises from nothing to all it is where that is fastest, were it a parabola: no longer
    /// than a cell, no shorter than the first span.
    pub(super) grain: f64,
}

/// Looks at a medium's support, and at a coefficient that it tells, along lines within a box.
pub(super) fn rises(
    scene: &FieldScene,
    (support, coefficient): (NodeId, NodeId),
    cell: f64,
    (low, high): (Vec3, Vec3),
    (params, time): (&[Vec<f64>], f64),
) -> Rises {
    let tape = Tape::new(&scene.graph, &[support, coefficient]);
    let tables = Tables::evaluate(&scene.graph, params, time);
    let shells = shells(scene, params, time);
    let at = |place: [Lanes; 3], scratch: &mut Scratch| -> (Lanes, Lanes) {
        let above = |(center, radius): &(Vec3, f64)| -> Lanes {
            std::array::from_fn(|l| length(sub([0, 1, 2].map(|i: usize| place[i][l]), *center)) - radius)
        };
        let altitudes: Vec<Lanes> = shells.iter().map(above).collect();
        let environment = Environment {
            position: place,
            time,
            altitudes: &altitudes,
            params,
            tables: &tables,
            ..Environment::default()
        };
        tape.run(&environment, &NoVoxels, scratch);
        let largest = |l: usize| (0..tape.width(1)).map(|c| tape.component(scratch, 1, c)[l]).fold(0.0, f64::max);
        (*tape.component(scratch, 0, 0), std::array::from_fn(largest))
    };
    let bundle = |scratch: &mut Scratch, number: u32| -> Found {
        let drawn: [[f64; 5]; LANES] = std::array::from_fn(|l| even(number * LANES as u32 + l as u32));
        let center = [0, 1, 2].map(|i: usize| drawn.map(|u| low[i] + u[i] * (high[i] - low[i])));
        let way: [Vec3; LANES] = drawn.map(|u| {
            let (z, turn) = (2.0 * u[3] - 1.0, std::f64::consts::TAU * u[4]);
            let r = (1.0 - z * z).sqrt();
            [r * turn.cos(), r * turn.sin(), z]
        });
        let mut found = Found::default();
        for spans in [0..FAR_FROM, FAR_FROM..SPANS.len()] {
            let spacing = SPANS[spans.start] * cell / SHORTEST as f64;
            let line: Vec<Lanes> = (0..PLACES)
                .map(|n| {
                    let far = (n as f64 - 0.5 * (PLACES - 1) as f64) * spacing;
                    let place = [0, 1, 2].map(|i: usize| std::array::from_fn(|l| center[i][l] + far * way[l][i]));
                    let (support, coefficient) = at(place, scratch);
                    for (s, k) in support.iter().zip(coefficient) {
                        found.largest = found.largest.max(k);
                        found.steepest = found.steepest.max(if *s > 0.0 { k / s } else { 0.0 });
                    }
                    support
                })
                .collect();
            for span in spans.clone() {
                let apart = SHORTEST << (span - spans.start);
                let rises = (0..PLACES - apart).flat_map(|n| (0..LANES).map(move |l| (n, l))).map(|(n, l)| {
                    let (a, b) = (line[n][l], line[n + apart][l]);
                    // A bend is highest somewhere between.
                    let most = (n + 1..n + apart).map(|n| line[n][l]).fold(f64::NEG_INFINITY, f64::max);
                    let rise = most - a.max(b);
                    if rise.is_nan() { f64::INFINITY } else { rise }
                });
                found.over[span] = rises.fold(0.0, f64::max);
            }
        }
        found
    };
    let found = (0..BUNDLES).into_par_iter().map_init(|| tape.scratch(), bundle).reduce(Found::default, |a, b| Found {
        over: std::array::from_fn(|i| a.over[i].max(b.over[i])),
        largest: a.largest.max(b.largest),
        steepest: a.steepest.max(b.steepest),
    });
    // What rises over the first span makes so much of the coefficient.
    let share = found.steepest * found.over[0] / found.largest;
    let grain = SPANS[0] * cell / share.sqrt();
    let mut before = 0.0f64;
    let over = found.over.map(|rise| {
        before = before.max((BEYOND * rise).min(1e30));
        before
    });
    Rises { over, grain: if grain.is_nan() { cell } else { grain.clamp(SPANS[0] * cell, cell) } }
}

/// The most of what was looked at.
#[derive(Copy, Clone, Default)]
struct Found {
    over: [f64; SPANS.len()],
    /// Of the coefficient.
    largest: f64,
    /// The coefficient over the support.
    steepest: f64,
}

/// The points of a sequence that fills the unit cube of five dimensions evenly (Roberts, The Unreasonable Effectiveness of
/// Quasirandom Sequences, 2018).
fn even(number: u32) -> [f64; 5] {
    // The root of x⁶ = x + 1.
    const ROOT: f64 = 1.134_724_138_401_519_5;
    std::array::from_fn(|i| (0.5 + f64::from(number + 1) * ROOT.powi(-(i as i32 + 1))).fract())
}

#[cfg(test)]
mod tests {
    use super::*;
    use compiler::Options;
    use compiler::loader::NoFiles;

    /// Of the support of a medium's density in a cube of two metres, over spans of cells of so many metres; as found.
    fn found(density: &str, cell: f64) -> [f64; SPANS.len()] {
        let text = format!(
            "medium bowl {{ shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)  density = {density}  k_a = 1 /m }}\n\
             camera {{ from = (0, 0, -4) m  to = (0, 0, 0) m }}"
        );
        let compiled = compiler::compile("m.vol", &text, &NoFiles, &Options::default());
        let mut scene = compiled.program.unwrap_or_else(|| panic!("{:?}", compiled.diagnostics)).lowered;
        let root = scene.media[0].k_a;
        let support = compiler::analysis::support::support(&mut scene.graph, &mut |g, op| g.push(op), &[root]);
        let unit = scene.units.length;
        let edge = ([-1.0 / unit; 3], [1.0 / unit; 3]);
        let support = support.expect("it is cut off");
        rises(&scene, (support, root), cell / unit, edge, (&[], 0.0)).over.map(|rise| rise / BEYOND)
    }

    #[test]
    fn a_bowl_rises_by_the_square_of_half_the_span() {
        // Between two places ℓ apart, −r² is higher than at both by (ℓ/2)² at most.
        let rises = found("max(0, 1 - dot(p, p) / 1 m^2)", 0.2);
        for (span, rise) in SPANS.iter().zip(rises) {
            let most = (0.5 * span * 0.2f64).powi(2);
            assert!(rise > 0.8 * most && rise < 1.0001 * most, "{span}: {rise} of {most}");
        }
    }

    #[test]
    fn what_is_straight_does_not_rise() {
        let rises = found("max(0, p.x / 1 m)", 0.2);
        assert!(rises.iter().all(|r| *r < 1e-12), "{rises:?}");
    }

    #[test]
    fn a_crest_rises_by_half_the_span() {
        let rises = found("max(0, 0.5 - abs(p.x / 1 m))", 0.2);
        for (span, rise) in SPANS.iter().zip(rises) {
            let most = 0.5 * span * 0.2;
            assert!(rise > 0.7 * most && rise < 1.0001 * most, "{span}: {rise} of {most}");
        }
    }
}
