//! Integrals of phase functions over the sphere: 2π ∫₋₁¹ f(μ) dμ and its first moment.
//!
//! [−1, 1] is cut at 1 − |μ| = 2⁻ᵏ, since lobes are narrow near straight on and straight back, and each part is halved until
//! eight Gauss–Legendre nodes on the whole and on the halves agree.

use super::tape::{Environment, LANES, Scratch, Tape};
use super::{Tables, Voxels};
use crate::ir::{Graph, GridId, NodeId};
use std::collections::BinaryHeap;

/// Nodes and weights of the eight-point Gauss–Legendre rule on [−1, 1] (Abramowitz and Stegun, table 25.4), the positive half.
const NODES: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_27),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// What a phase function comes to; one number per band.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseFacts {
    /// 2π ∫ f dμ: 1 when it is normalised.
    pub integral: Vec<f64>,
    /// 2π ∫ μ·f dμ, not divided by the integral.
    pub moment: Vec<f64>,
    /// Estimated error of the integrals, all bands together.
    pub uncertainty: f64,
    /// The smallest value that was met, and its cosine.
    pub least: (f64, f64),
    /// The largest value that was met.
    pub most: f64,
    /// Whether some value was not finite, or the integral did not settle.
    pub diverges: bool,
}

/// Most evaluations of eight nodes.
const MOST: usize = 1 << 13;

struct Integrator<'a> {
    tape: Tape,
    environment: Environment<'a>,
    voxels: &'a dyn Voxels,
    facts: PhaseFacts,
    left: usize,
}

impl Integrator<'_> {
    /// Integral and first moment over [a, b] by one rule.
    fn rule(&mut self, a: f64, b: f64, scratch: &mut Scratch) -> Vec<[f64; 2]> {
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        let mut weights = [0.0; LANES];
        for (i, (x, w)) in NODES.iter().enumerate() {
            self.environment.cos_theta[2 * i] = middle - half * x;
            self.environment.cos_theta[2 * i + 1] = middle + half * x;
            weights[2 * i] = w * half;
            weights[2 * i + 1] = w * half;
        }
        self.left = self.left.saturating_sub(1);
        self.tape.run(&self.environment, self.voxels, scratch);
        let mut sums = vec![[0.0; 2]; self.tape.width(0)];
        for (band, sum) in sums.iter_mut().enumerate() {
            for (lane, value) in self.tape.component(scratch, 0, band).iter().enumerate() {
                let mu = self.environment.cos_theta[lane];
                sum[0] += weights[lane] * value;
                sum[1] += weights[lane] * value * mu;
                self.facts.diverges |= !value.is_finite();
                if *value < self.facts.least.0 {
                    self.facts.least = (*value, mu);
                }
                self.facts.most = self.facts.most.max(*value);
            }
        }
        sums
    }
}

/// A part of [−1, 1]: its ends, the integrals over its halves, and how far their sum is from the integral over the whole.
struct Part {
    wrong: f64,
    ends: (f64, f64),
    halves: [Vec<[f64; 2]>; 2],
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Part {}
impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Part {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.wrong.total_cmp(&other.wrong).then(self.ends.0.total_cmp(&other.ends.0))
    }
}

impl Integrator<'_> {
    fn part(&mut self, ends: (f64, f64), whole: &[[f64; 2]], scratch: &mut Scratch) -> Part {
        let middle = 0.5 * (ends.0 + ends.1);
        let halves = [self.rule(ends.0, middle, scratch), self.rule(middle, ends.1, scratch)];
        let [low, high] = &halves;
        let wrong = whole.iter().zip(low).zip(high).map(|((w, l), h)| (l[0] + h[0] - w[0]).abs()).sum();
        Part { wrong, ends, halves }
    }
}

/// Integrates a phase function of [`crate::ir::Input::CosTheta`], all other inputs as given: the part that is worst is halved
/// next. The relative error of the integral is about 1e-11 where the function is smooth.
#[must_use]
pub fn phase_facts(graph: &Graph, node: NodeId, environment: &Environment<'_>, voxels: &dyn Voxels) -> PhaseFacts {
    let tape = Tape::new(graph, &[node]);
    let mut scratch = tape.scratch();
    let bands = tape.width(0);
    let facts = PhaseFacts {
        integral: vec![0.0; bands],
        moment: vec![0.0; bands],
        uncertainty: 0.0,
        least: (f64::INFINITY, 0.0),
        most: 0.0,
        diverges: false,
    };
    let mut integrator = Integrator { tape, environment: environment.clone(), voxels, facts, left: MOST };
    let mut cuts: Vec<f64> = (1..=52).map(|k| 1.0 - 2f64.powi(-k)).collect();
    cuts.extend(cuts.clone().iter().map(|c| -c));
    cuts.extend([0.0, 1.0, -1.0]);
    cuts.sort_by(f64::total_cmp);
    let mut open = BinaryHeap::new();
    for pair in cuts.windows(2) {
        let whole = integrator.rule(pair[0], pair[1], &mut scratch);
        open.push(integrator.part((pair[0], pair[1]), &whole, &mut scratch));
    }
    let sizes = open.iter().flat_map(|p| &p.halves).flatten().map(|b| b[0].abs());
    let size: f64 = sizes.sum();
    let tolerance = 1e-14 * size;
    let mut done = vec![];
    while let Some(part) = open.pop() {
        let Part { wrong, ends: (a, b), halves } = part;
        if !(wrong > tolerance) || integrator.left == 0 || integrator.facts.diverges {
            done.push(Part { wrong, ends: (a, b), halves });
            break;
        }
        if b - a < 1e-14 {
            done.push(Part { wrong, ends: (a, b), halves });
            continue;
        }
        let middle = 0.5 * (a + b);
        for (ends, half) in [(a, middle), (middle, b)].into_iter().zip(&halves) {
            open.push(integrator.part(ends, half, &mut scratch));
        }
    }
    let mut facts = integrator.facts;
    let scale = 2.0 * std::f64::consts::PI;
    for part in done.into_iter().chain(open) {
        facts.uncertainty += scale * part.wrong;
        for (i, sum) in part.halves.iter().flat_map(|half| half.iter().enumerate()) {
            facts.integral[i] += scale * sum[0];
            facts.moment[i] += scale * sum[1];
        }
    }
    // In the narrowest lobes the cosine itself is rounded.
    facts.uncertainty += 0.5 * f64::EPSILON * scale * facts.most;
    facts.diverges |= !(facts.uncertainty <= 1e-2 * scale * size);
    facts
}

/// What else a phase function may depend on.
#[derive(Copy, Clone, Debug)]
pub struct PhasePlace<'a> {
    /// In the graph's units.
    pub params: &'a [Vec<f64>],
    /// In the graph's units; its second part stands for altitudes.
    pub position: [f64; 3],
    /// A unit vector.
    pub direction: [f64; 3],
    /// Seconds.
    pub time: f64,
    /// Of every voxel of every grid.
    pub voxel: f64,
}

struct Everywhere(f64);

impl Voxels for Everywhere {
    fn voxel(&self, _grid: GridId, _index: [u32; 3]) -> f64 {
        self.0
    }
}

/// [`phase_facts`] at one place.
#[must_use]
pub fn phase_facts_in(graph: &Graph, node: NodeId, place: &PhasePlace<'_>) -> PhaseFacts {
    let tables = Tables::evaluate(graph, place.params, place.time);
    let environment = Environment {
        position: place.position.map(|x| [x; LANES]),
        direction: place.direction.map(|x| [x; LANES]),
        time: place.time,
        params: place.params,
        tables: &tables,
        altitudes: &[[place.position[1]; LANES]; 16],
        ..Environment::default()
    };
    phase_facts(graph, node, &environment, &Everywhere(place.voxel))
}

/// [`phase_facts`] at values of parameters and a position, where nothing else matters.
#[must_use]
pub fn phase_facts_at(graph: &Graph, node: NodeId, params: &[Vec<f64>], position: [f64; 3]) -> PhaseFacts {
    phase_facts_in(graph, node, &PhasePlace { params, position, direction: [0.0, 0.0, 1.0], time: 0.0, voxel: 0.0 })
}
