//! What is in each medium, looked at along a few rays: for remarks about a scene that is not drawn yet.

use super::field::Ray;
use super::interval::Intervals;
use super::shape;
use crate::frame::shells;
use crate::frame::vector::{Vec3, along, length, scale, sub};
use compiler::ir::eval::{Environment, LANES, Tables, Tape, Voxels, evaluate_frame};
use compiler::ir::{FieldScene, NodeId};

/// Rays through each medium.
const RAYS: usize = 96;
/// Runs of the evaluator on each of them, of eight places each.
const RUNS: usize = 2;

/// The least value found of a coefficient.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Least {
    /// Over all bands, in the graph's units.
    pub value: f64,
    /// Where, in the graph's units.
    pub place: Vec3,
}

/// What was found in a medium.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Number of the medium in the scene.
    pub medium: usize,
    /// Places that were looked at.
    pub places: usize,
    /// The least of k_a, k_s and k_e.
    pub least: [Option<Least>; 3],
    /// At how many places k_a, k_s or k_e is negative.
    pub negative: [usize; 3],
    /// At how many places some coefficient is not 0.
    pub occupied: usize,
    /// Corners of a box around those places.
    pub matter: Option<[Vec3; 2]>,
    /// Corners of the box around its shape.
    pub shape: [Vec3; 2],
    /// Optical depths of the rays, in the band that they are least in, ascending.
    pub depths: Vec<f64>,
}

/// A point of the additive sequence by the inverse powers of the root of x⁴ = x + 1 (Roberts 2018, R₃).
fn spread(i: usize) -> Vec3 {
    let step = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];
    step.map(|s: f64| (0.5 + s * (i as f64 + 1.0)).fract())
}

/// Looks into every medium whose shape has a box around it and no distance field in it. Params are in the graph's units.
/// Of media for which `skip` is true nothing is said.
pub fn survey<V: Voxels + ?Sized>(
    scene: &FieldScene,
    params: &[Vec<f64>],
    time: f64,
    voxels: &V,
    skip: &dyn Fn(usize) -> bool,
) -> Vec<Survey> {
    let graph = &scene.graph;
    let mut value = |node: NodeId| evaluate_frame(graph, &[node], params, time).remove(0);
    let shells = shells(scene, params, time);
    let tables = Tables::evaluate(graph, params, time);
    let mut out = vec![];
    for (number, medium) in scene.media.iter().enumerate().filter(|(i, _)| !skip(*i)) {
        let Ok(solid) = shape::evaluate(&medium.shape, &mut value) else { continue };
        let mut fields = vec![];
        solid.fields(&mut fields);
        let Some((low, high)) = solid.bounds().filter(|_| fields.is_empty()) else { continue };
        let diagonal = length(sub(high, low));
        if !(diagonal.is_finite() && diagonal > 0.0) {
            continue;
        }
        let tape = Tape::new(graph, &[medium.k_a, medium.k_s, medium.k_e]);
        let mut scratch = tape.scratch();
        let mut found = Survey {
            medium: number,
            places: 0,
            least: [None; 3],
            negative: [0; 3],
            occupied: 0,
            matter: None,
            shape: [low, high],
            depths: vec![],
        };
        for i in 0..RAYS {
            let through = spread(i);
            let through: Vec3 = std::array::from_fn(|a| low[a] + through[a] * (high[a] - low[a]));
            // Directions of a spiral on the sphere.
            let up = 1.0 - (2.0 * i as f64 + 1.0) / RAYS as f64;
            let turn = i as f64 * 2.399_963_229_728_653;
            let flat = (1.0 - up * up).sqrt();
            let direction = [flat * turn.cos(), up, flat * turn.sin()];
            let origin = along(through, direction, -diagonal);
            let within = Intervals(vec![(0.0, 2.0 * diagonal)]);
            let none = &mut |_: NodeId, _: &Intervals| -> Result<Intervals, std::convert::Infallible> {
                Ok(Intervals::empty())
            };
            let Ok(inside) = solid.intervals(origin, direction, &within, none);
            let ray = Ray::new(origin, direction, &shells);
            let mut depth = [0.0; super::trace::BANDS];
            let mut bands = 1;
            for (a, b) in inside.intersection(&within).0 {
                let count = RUNS * LANES;
                let h = (b - a) / count as f64;
                for run in 0..RUNS {
                    // Anywhere within its share of the stretch, so that nothing periodic is met at one phase.
                    let t: [f64; LANES] = std::array::from_fn(|lane| {
                        let n = run * LANES + lane;
                        a + h * (n as f64 + spread(i * count + n)[0])
                    });
                    let places = t.map(|t| ray.at(t));
                    let altitudes: Vec<[f64; LANES]> = ray.altitudes.iter().map(|s| t.map(|t| s.at(t))).collect();
                    let environment = Environment {
                        position: [0, 1, 2].map(|c| places.map(|p| p[c])),
                        direction: [0, 1, 2].map(|c| [-direction[c]; LANES]),
                        time,
                        altitudes: &altitudes,
                        params,
                        tables: &tables,
                        ..Environment::default()
                    };
                    tape.run(&environment, voxels, &mut scratch);
                    let mut met = [false; LANES];
                    for root in 0..3 {
                        let width = tape.width(root);
                        bands = bands.max(width);
                        let mut negative = [false; LANES];
                        for band in 0..width {
                            for (lane, v) in tape.component(&scratch, root, band).iter().enumerate() {
                                met[lane] |= *v != 0.0;
                                negative[lane] |= *v < 0.0;
                                if found.least[root].is_none_or(|l| *v < l.value) {
                                    found.least[root] = Some(Least { value: *v, place: places[lane] });
                                }
                            }
                        }
                        found.negative[root] += negative.iter().filter(|n| **n).count();
                        if root < 2 {
                            for band in 0..depth.len() {
                                let values = tape.component(&scratch, root, band.min(width - 1));
                                depth[band] += values.iter().filter(|v| v.is_finite()).sum::<f64>() * h;
                            }
                        }
                    }
                    found.places += LANES;
                    for (place, met) in places.iter().zip(met) {
                        if met {
                            found.occupied += 1;
                            found.matter = Some(match found.matter {
                                None => [*place, *place],
                                Some([low, high]) => [
                                    std::array::from_fn(|c| low[c].min(place[c])),
                                    std::array::from_fn(|c| high[c].max(place[c])),
                                ],
                            });
                        }
                    }
                }
            }
            let least = depth[..bands].iter().copied().fold(f64::INFINITY, f64::min);
            found.depths.push(least);
        }
        found.depths.sort_by(f64::total_cmp);
        out.push(found);
    }
    out
}

impl Survey {
    /// Share of the box around the shape that the box around its matter fills, in 0 … 1; 0 without matter.
    #[must_use]
    pub fn filled(&self) -> f64 {
        let Some([low, high]) = self.matter else { return 0.0 };
        let [a, b] = self.shape;
        (0..3).map(|c| ((high[c] - low[c]) / (b[c] - a[c]).max(1e-300)).min(1.0)).product()
    }

    /// The box around its matter with the room that places between those looked at need, in metres.
    #[must_use]
    pub fn suggested(&self, metre: f64) -> Option<[Vec3; 2]> {
        let [low, high] = self.matter?;
        let [a, b] = self.shape;
        let room = scale(sub(b, a), 0.5 / (self.places.max(1) as f64).cbrt());
        let low = std::array::from_fn(|c| (low[c] - room[c]).max(a[c]) * metre);
        let high = std::array::from_fn(|c| (high[c] + room[c]).min(b[c]) * metre);
        Some([low, high])
    }
}
