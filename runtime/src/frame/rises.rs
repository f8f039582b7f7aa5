//! How far a field rises between two places above what it is at both of them, found by looking at many such pairs: an estimate,
//! which steps through a medium go by where they find nothing of it.

use super::Vec3;
use super::bounds::shells;
use super::vector::{length, sub};
use compiler::ir::eval::{Environment, LANES, Lanes, NoVoxels, Scratch, Tables, Tape};
use compiler::ir::{FieldScene, NodeId};
use compiler::program::SPANS;
use rayon::prelude::*;

/// Bundles of pairs that are looked at, for each span.
const BUNDLES: u32 = 256;
/// How much higher than the highest of those that were looked at some may rise.
const BEYOND: f64 = 1.5;

/// Over spans of [`SPANS`] cells; as much as f32 holds where the field is no number somewhere. Pairs lie within a box.
pub(super) fn rises(
    scene: &FieldScene,
    support: NodeId,
    cell: f64,
    (low, high): (Vec3, Vec3),
    (params, time): (&[Vec<f64>], f64),
) -> [f64; SPANS.len()] {
    let tape = Tape::new(&scene.graph, &[support]);
    let tables = Tables::evaluate(&scene.graph, params, time);
    let shells = shells(scene, params, time);
    let at = |place: [Lanes; 3], scratch: &mut Scratch| -> Lanes {
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
        *tape.component(scratch, 0, 0)
    };
    let bundle = |scratch: &mut Scratch, number: u32| -> [f64; SPANS.len()] {
        let drawn: [[f64; 5]; LANES] = std::array::from_fn(|l| even(number * LANES as u32 + l as u32));
        let center = [0, 1, 2].map(|i: usize| drawn.map(|u| low[i] + u[i] * (high[i] - low[i])));
        let way: [Vec3; LANES] = drawn.map(|u| {
            let (z, turn) = (2.0 * u[3] - 1.0, std::f64::consts::TAU * u[4]);
            let r = (1.0 - z * z).sqrt();
            [r * turn.cos(), r * turn.sin(), z]
        });
        let middle = at(center, scratch);
        SPANS.map(|span| {
            let side = |sign: f64, scratch: &mut Scratch| {
                let far = sign * 0.5 * span * cell;
                let place = [0, 1, 2].map(|i: usize| -> Lanes { std::array::from_fn(|l| center[i][l] + far * way[l][i]) });
                at(place, scratch)
            };
            let (a, b) = (side(-1.0, scratch), side(1.0, scratch));
            let rise = |l: usize| {
                let rise = middle[l] - a[l].max(b[l]);
                if rise.is_nan() { f64::INFINITY } else { rise }
            };
            (0..LANES).map(rise).fold(0.0, f64::max)
        })
    };
    let most = |a: [f64; SPANS.len()], b: [f64; SPANS.len()]| std::array::from_fn(|i| f64::max(a[i], b[i]));
    let found = (0..BUNDLES)
        .into_par_iter()
        .with_min_len(16)
        .map_init(|| tape.scratch(), bundle)
        .reduce(|| [0.0; SPANS.len()], most);
    let mut before = 0.0f64;
    found.map(|rise| {
        before = before.max((BEYOND * rise).min(1e30));
        before
    })
}

/// The points of a sequence that fills the unit cube of five dimensions evenly (Roberts, The Unreasonable Effectiveness of
/// Quasirandom Sequences, 2018).
fn even(number: u32) -> [f64; 5] {
    // The root of x⁶ = x + 1.
    const ROOT: f64 = 1.134_724_138_401_519_5;
    std::array::from_fn(|i| (0.5 + f64::from(number + 1) * ROOT.powi(-(i as i32 + 1))).fract())
}
