//! Optical depth in closed form: coefficients that are sums of c·exp(e(p)), e straight along every ray.
//!
//! ∫ c·exp(e) over a length h on which e goes from e₀ to e₁ is c·h·(exp(e₁) − exp(e₀))/(e₁ − e₀). Shadow rays are many, and
//! fog and exponential atmospheres are common: this is what they cost. Written apart from what the backends use.

use super::events::degrees;
use super::field::{Fields, Ray};
use super::gauss::N;
use super::panel::phi;
use super::trace::{BANDS, PerBand};
use compiler::ir::eval::{Scratch, Tape, Voxels};
use compiler::ir::{Binary, Graph, NodeId, Op, Tier, Unary};

/// A sum of exponentials with the factors of one frame.
#[derive(Clone, Debug)]
pub(super) struct Closed {
    /// Factor, and which of the exponents; none is uniform.
    terms: Vec<(PerBand, Option<usize>)>,
    exponents: Option<Tape>,
    /// How many exponents there are.
    count: usize,
}

/// How far out a slope is measured on rays without end.
const OUT: f64 = 1_099_511_627_776.0;
/// More terms than this are integrated numerically.
const TERMS: usize = 8;

struct Term {
    factor: NodeId,
    exponent: Option<NodeId>,
}

struct Finder<'g> {
    graph: &'g mut Graph,
    tiers: Vec<Tier>,
    degree: Vec<u8>,
}

impl Finder<'_> {
    fn is_frame(&self, node: NodeId) -> bool {
        // Nodes that the search itself made are products of such factors.
        self.tiers.get(node.0 as usize).is_none_or(|t| *t <= Tier::Frame)
    }

    fn times(&mut self, a: NodeId, b: NodeId, op: Binary) -> NodeId {
        let width = self.graph.width(a).max(self.graph.width(b));
        let (a, b) = (self.graph.widen(a, width), self.graph.widen(b, width));
        self.graph.binary(op, a, b)
    }

    fn terms(&mut self, node: NodeId) -> Option<Vec<Term>> {
        if self.is_frame(node) {
            return Some(vec![Term { factor: node, exponent: None }]);
        }
        let terms = match *self.graph.op(node) {
            Op::Splat(a, _) => self.terms(a)?,
            Op::Unary(Unary::Exp, a) if self.graph.width(a) == 1 && self.degree[a.0 as usize] <= 1 => {
                let factor = self.graph.scalar(1.0);
                vec![Term { factor, exponent: Some(a) }]
            }
            Op::Binary(Binary::Add, a, b) => {
                let mut terms = self.terms(a)?;
                terms.extend(self.terms(b)?);
                terms
            }
            Op::Binary(Binary::Mul, a, b) => {
                let (a, b) = (self.terms(a)?, self.terms(b)?);
                let mut terms = vec![];
                for x in &a {
                    for y in &b {
                        let factor = self.times(x.factor, y.factor, Binary::Mul);
                        let exponent = match (x.exponent, y.exponent) {
                            (Some(x), Some(y)) => Some(self.graph.add(x, y)),
                            (x, y) => x.or(y),
                        };
                        terms.push(Term { factor, exponent });
                    }
                }
                terms
            }
            Op::Binary(Binary::Div, a, b) if self.is_frame(b) => {
                let mut terms = self.terms(a)?;
                for term in &mut terms {
                    term.factor = self.times(term.factor, b, Binary::Div);
                }
                terms
            }
            _ => return None,
        };
        (terms.len() <= TERMS).then_some(terms)
    }
}

impl Closed {
    /// The closed form of the sum of `roots`, if it has one and no factor is negative or not finite. `frame` evaluates nodes
    /// of tier Frame in the graph as it is then.
    pub(super) fn find(
        graph: &mut Graph,
        roots: &[NodeId],
        bands: usize,
        frame: impl FnOnce(&Graph, &[NodeId]) -> Vec<Vec<f64>>,
    ) -> Option<Self> {
        let (tiers, degree) = (graph.tiers(), degrees(graph));
        let mut finder = Finder { graph, tiers, degree };
        let mut terms = vec![];
        for root in roots {
            terms.extend(finder.terms(*root)?);
        }
        let factors: Vec<NodeId> = terms.iter().map(|t| t.factor).collect();
        let values = frame(graph, &factors);
        let mut exponents: Vec<NodeId> = vec![];
        let mut out: Vec<(PerBand, Option<usize>)> = vec![];
        for (term, value) in terms.iter().zip(values) {
            let mut factor = [0.0; BANDS];
            for (b, slot) in factor.iter_mut().enumerate().take(bands) {
                *slot = value[b.min(value.len() - 1)];
            }
            if factor.iter().any(|f| !(*f >= 0.0 && f.is_finite())) {
                return None;
            }
            let exponent = term.exponent.map(|e| {
                exponents.iter().position(|x| *x == e).unwrap_or_else(|| {
                    exponents.push(e);
                    exponents.len() - 1
                })
            });
            match out.iter_mut().find(|o| o.1 == exponent) {
                Some(other) => other.0.iter_mut().zip(factor).for_each(|(a, b)| *a += b),
                None => out.push((factor, exponent)),
            }
        }
        let tape = (!exponents.is_empty()).then(|| Tape::new(graph, &exponents));
        Some(Self { terms: out, exponents: tape, count: exponents.len() })
    }

    pub(super) fn scratch(&self) -> Option<Scratch> {
        self.exponents.as_ref().map(Tape::scratch)
    }

    /// The direction in which the exponents change most, as a difference over a unit, if they change.
    pub(super) fn slope<V: Voxels + ?Sized>(&self, fields: &Fields, voxels: &V) -> Option<[f64; 3]> {
        let tape = self.exponents.as_ref()?;
        let mut scratch = tape.scratch();
        let along = |axis: usize| Ray::new([0.0; 3], std::array::from_fn(|i| f64::from(u8::from(i == axis))), &[]);
        let slope = |axis: usize, scratch: &mut Scratch| {
            fields.run(tape, scratch, voxels, &along(axis), &std::array::from_fn(|i| i as f64), false);
            let e = tape.component(scratch, 0, 0);
            e[1] - e[0]
        };
        let slope = [0, 1, 2].map(|axis| slope(axis, &mut scratch));
        crate::frame::vector::normalize(slope)
    }

    /// The same along one ray. Nothing if the exponents have no value.
    pub(super) fn profile<V: Voxels + ?Sized>(
        &self,
        fields: &Fields,
        voxels: &V,
        scratch: Option<&mut Scratch>,
        ray: &Ray,
        start: f64,
    ) -> Option<Profile> {
        let mut slopes = [[0.0; 2]; 2 * TERMS];
        if let (Some(tape), Some(scratch)) = (&self.exponents, scratch) {
            let mut ts = [start; N];
            ts[1] = start + OUT;
            fields.run(tape, scratch, voxels, ray, &ts, false);
            for (i, slot) in slopes.iter_mut().enumerate().take(self.count) {
                let e = tape.component(scratch, i, 0);
                *slot = [e[0], (e[1] - e[0]) / OUT];
            }
        }
        let mut terms = vec![];
        for (factor, exponent) in &self.terms {
            let [e, slope] = exponent.map_or([0.0; 2], |i| slopes[i]);
            if !e.is_finite() || !slope.is_finite() {
                return None;
            }
            let size = e.exp();
            terms.push((factor.map(|f| if f == 0.0 { 0.0 } else { f * size }), slope));
        }
        Some(Profile { terms })
    }

    /// Optical depth between two parameters of a ray, the second of which may be infinite; it may be infinite too. Nothing
    /// if the exponents have no value.
    pub(super) fn depth<V: Voxels + ?Sized>(
        &self,
        fields: &Fields,
        voxels: &V,
        scratch: Option<&mut Scratch>,
        ray: &Ray,
        (a, b): (f64, f64),
        bands: usize,
    ) -> Option<PerBand> {
        let out = if b.is_finite() { b } else { a + OUT };
        let mut ends = [[0.0; 2]; 2 * TERMS];
        if let (Some(tape), Some(scratch)) = (&self.exponents, scratch) {
            let mut ts = [a; N];
            ts[1] = out;
            fields.run(tape, scratch, voxels, ray, &ts, false);
            for (i, slot) in ends.iter_mut().enumerate().take(self.count) {
                let e = tape.component(scratch, i, 0);
                *slot = [e[0], e[1]];
            }
        }
        let mut tau = [0.0; BANDS];
        for (factor, exponent) in &self.terms {
            let [e0, e1] = exponent.map_or([0.0; 2], |i| ends[i]);
            if !e0.is_finite() || !e1.is_finite() {
                return None;
            }
            // ∫ exp(e) without the factor.
            let line = if b.is_finite() {
                (b - a) * e0.max(e1).exp() * phi((e1 - e0).abs())
            } else if e1 < e0 {
                e0.exp() * ((out - a) / (e0 - e1))
            } else {
                f64::INFINITY
            };
            for band in 0..bands {
                if factor[band] > 0.0 && line > 0.0 {
                    tau[band] += factor[band] * line;
                }
            }
        }
        Some(tau)
    }
}

/// Extinction along a ray from some place on: Σ c·exp(s·x).
#[derive(Clone, Debug)]
pub(super) struct Profile {
    terms: Vec<(PerBand, f64)>,
}

impl Profile {
    /// Extinction at `x`.
    pub(super) fn at(&self, x: f64, band: usize) -> f64 {
        self.terms.iter().map(|(c, s)| if c[band] == 0.0 { 0.0 } else { c[band] * (s * x).exp() }).sum()
    }

    /// Depth up to `x`, which may be infinite, as may be the depth.
    pub(super) fn depth(&self, x: f64, band: usize) -> f64 {
        let one = |(c, s): &(PerBand, f64)| {
            if c[band] == 0.0 || x == 0.0 {
                0.0
            } else if x.is_infinite() {
                if *s < 0.0 { c[band] / -s } else { f64::INFINITY }
            } else if *s <= 0.0 {
                c[band] * x * phi(-s * x)
            } else {
                c[band] * x * phi(s * x) * (s * x).exp()
            }
        };
        self.terms.iter().map(one).sum()
    }

    /// Where the depth is `tau`, if that is before `end`, which may be infinite.
    pub(super) fn invert(&self, tau: f64, end: f64, band: usize) -> Option<f64> {
        if !(self.depth(end, band) > tau) {
            return None;
        }
        if let [(c, s)] = self.terms.as_slice() {
            let y = tau / c[band];
            let x = if *s == 0.0 { y } else { (y * s).ln_1p() / s };
            return Some(x.clamp(0.0, end));
        }
        let (mut low, mut high) = (0.0, if end.is_finite() { end } else { 1.0 });
        while self.depth(high, band) < tau {
            low = high;
            high *= 2.0;
        }
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if self.depth(middle, band) < tau { low = middle } else { high = middle }
        }
        Some(high)
    }
}
