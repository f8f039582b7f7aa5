//! Phase functions: normalised over the sphere whatever they are written as.
//!
//! What depends on nothing but the cosine is integrated when compiling and divided by its integral. What depends on params,
//! time or place is integrated at a handful of their values: if it is normalised at all of them (as everything in
//! `std::phase` is) it stays as it is, otherwise it is divided by its own integral, a sum in the graph by the double
//! exponential rule of Takahasi and Mori (1974), which follows every change of a param. That rule is good to 1e-7 where the
//! function is smooth; where it jumps between the ends at an angle that a param moves, to a few hundredths.

use super::{Lowered, Lowerer};
use crate::check::hir;
use crate::diagnostic::Diagnostic;
use crate::ir::eval::PhasePlace;
use crate::ir::{Fold, Graph, Input, NodeId, Op, Shape, Unary, eval};
use std::f64::consts::PI;

/// Integrals this close to 1 are 1.
const CLOSE: f64 = 1e-9;
/// Nodes of the rule in the graph, on both sides of the middle, and how far it reaches.
const NODES: i32 = 96;
const REACH: f64 = 3.0;

/// What a phase function follows besides the angle.
struct Dependence {
    params: Vec<bool>,
    /// Position, direction, altitude, time, or voxels.
    place: bool,
}

impl Dependence {
    fn varies(&self) -> bool {
        self.place || self.params.contains(&true)
    }
}

/// Where a phase function is looked at.
struct Trial {
    params: Vec<Vec<f64>>,
    place: PhasePlace<'static>,
    /// Whether the scene can come to this: a place may lie outside of the medium, and a param without a range may not make
    /// sense at every value.
    trusted: bool,
    /// Whether the params are at their defaults.
    default: bool,
}

/// Why light cannot be scattered so.
fn problem(facts: &eval::PhaseFacts) -> Option<String> {
    if facts.diverges || facts.integral.iter().any(|i| !i.is_finite()) {
        Some("cannot be integrated over the sphere".to_owned())
    } else if facts.least.0 < 0.0 {
        Some(format!("is negative: {:.4} at cos_theta = {:.4}", facts.least.0, facts.least.1))
    } else if facts.integral.iter().any(|i| *i <= 0.0) {
        Some("is zero in every direction".to_owned())
    } else {
        None
    }
}

impl<'s> Lowerer<'s, '_> {
    pub(super) fn phase(
        &mut self,
        medium: &hir::Medium,
        expr: &'s hir::Expr,
        shape: &Shape,
    ) -> Lowered<Option<NodeId>> {
        let node = self.spectrum(expr)?;
        let cosine = self.graph.input(Input::CosTheta);
        let name = format!("{}.phase", medium.name);
        // A table of `mie` is normalised as it is interpolated; to integrate its thousands of corners would be less exact.
        if self.is_mie(node) {
            self.name(node, &name);
            return Ok(Some(node));
        }
        let depends = self.dependence(node);
        let (mut factor, mut bad, mut good) = (None, None, false);
        for trial in self.trials(&depends, shape) {
            let Trial { params, place, trusted, .. } = &trial;
            let facts = eval::phase_facts_in(&self.graph, node, &PhasePlace { params, ..*place });
            if let Some(problem) = problem(&facts) {
                if *trusted {
                    return self.refuse_phase(medium, expr, &problem, &trial, &depends);
                }
                bad.get_or_insert((problem, trial));
                continue;
            }
            good = true;
            let unit = facts.integral.iter().all(|i| (i - 1.0).abs() <= CLOSE + 2.0 * facts.uncertainty);
            if !unit && factor.is_none() {
                factor = Some(facts.integral);
            }
        }
        if let Some((problem, trial)) = bad.filter(|_| !good) {
            return self.refuse_phase(medium, expr, &problem, &trial, &depends);
        }
        let Some(integral) = factor else {
            self.name(node, &name);
            return Ok(Some(node));
        };
        let shown: Vec<String> = integral.iter().map(|i| format!("{:.6}", 1.0 / i)).collect();
        self.diagnostics.push(
            Diagnostic::remark("N0518", format!("the phase function of `{}` was normalised", medium.name))
                .at(expr.span, format!("its integral over the sphere was not 1: multiplied by {}", shown.join(", "))),
        );
        let width = self.graph.width(node);
        let integral = if depends.varies() { self.sphere_integral(node, cosine) } else { self.graph.vector(&integral) };
        let integral = self.graph.widen(integral, width);
        let node = self.graph.div(node, integral);
        self.name(node, &name);
        self.span_new(expr.span);
        Ok(Some(node))
    }

    fn dependence(&self, node: NodeId) -> Dependence {
        let mut depends = Dependence { params: vec![false; self.scene.params.len()], place: false };
        let live = self.graph.reachable(&[node]);
        for id in self.graph.ids().filter(|id| live[id.0 as usize]) {
            match *self.graph.op(id) {
                Op::Param(p) => depends.params[p.0 as usize] = true,
                Op::Input(Input::CosTheta) => {}
                Op::Input(_) | Op::Sample { .. } | Op::SampleGradient { .. } => depends.place = true,
                Op::Const(_)
                | Op::Truth(_)
                | Op::LoopVar(_)
                | Op::Unary(..)
                | Op::Binary(..)
                | Op::PowI(..)
                | Op::Compare(..)
                | Op::Select { .. }
                | Op::Compose(..)
                | Op::Splat(..)
                | Op::Extract(..)
                | Op::Dot(..)
                | Op::Lookup { .. }
                | Op::LookupSlope { .. }
                | Op::CellHash { .. }
                | Op::Reduce { .. } => {}
            }
        }
        depends
    }

    /// Values of the params, places in the box of the medium, and times at which a phase function is looked at: the params'
    /// defaults first.
    fn trials(&mut self, depends: &Dependence, shape: &Shape) -> Vec<Trial> {
        let params = self.defaults();
        let (min, max) = self.bounds(std::slice::from_ref(shape)).unwrap_or(([-1.0; 3], [1.0; 3]));
        let within = |parts: [f64; 3]| std::array::from_fn(|i| min[i] + (max[i] - min[i]) * parts[i]);
        let place = PhasePlace {
            params: &[],
            position: within([0.55, 0.47, 0.52]),
            direction: [0.36, 0.48, 0.8],
            time: 0.0,
            voxel: 0.0,
        };
        let mut trials = vec![Trial { params: params.clone(), place, trusted: !depends.place, default: true }];
        if depends.varies() {
            for share in [0.03, 0.4, 0.77, 0.98] {
                let mut params = params.clone();
                let mut trusted = !depends.place;
                for (i, (values, param)) in params.iter_mut().zip(&self.scene.params).enumerate() {
                    let factor = self.units.scale(param.dimension[0]);
                    match param.range {
                        Some((low, high)) => values.iter_mut().for_each(|v| *v = (low + (high - low) * share) * factor),
                        // Which values make sense is not known.
                        None if depends.params[i] => {
                            values.iter_mut().for_each(|v| *v = *v * (0.5 + share) + 0.3 * share * factor);
                            trusted = false;
                        }
                        None => {}
                    }
                }
                let place = PhasePlace {
                    params: &[],
                    position: within([share, 1.0 - share * share, 0.3 + 0.4 * share]),
                    direction: [0.6 * share, -0.8 * share, (1.0 - share * share).sqrt()],
                    time: 3.0 * share,
                    voxel: 2.0 * share,
                };
                trials.push(Trial { params, place, trusted, default: false });
            }
        }
        trials
    }

    fn refuse_phase<T>(
        &mut self,
        medium: &hir::Medium,
        expr: &hir::Expr,
        problem: &str,
        trial: &Trial,
        depends: &Dependence,
    ) -> Lowered<T> {
        let mut diagnostic = Diagnostic::error("E0517", format!("the phase function of `{}` {problem}", medium.name))
            .at(expr.span, "light cannot be scattered by this")
            .note("a phase function says how much light is turned by each angle: 0 or more, and not all of it 0");
        if !trial.default {
            let mut values = vec![];
            for (i, param) in self.scene.params.iter().enumerate().filter(|(i, _)| depends.params[*i]) {
                let factor = self.units.scale(param.dimension[0]);
                let shown: Vec<String> = trial.params[i].iter().map(|v| format!("{:.4}", v / factor)).collect();
                values.push(format!("`{}` at {}", param.name, shown.join(", ")));
            }
            if !values.is_empty() {
                diagnostic = diagnostic.note(format!("this is with {}", values.join(" and ")));
            }
        }
        self.report(diagnostic.hint("clamp it with `max(0, …)`, or take one of `std::phase`"))
    }

    /// 2π ∫ f dμ as a node, by μ = tanh(π/2 · sinh t).
    fn sphere_integral(&mut self, node: NodeId, cosine: NodeId) -> NodeId {
        let depth = (0..16).rev().find(|d| !self.graph.ids().any(|id| *self.graph.op(id) == Op::LoopVar(*d)));
        let depth = depth.unwrap_or(15);
        let step = REACH / f64::from(NODES);
        let g = &mut self.graph;
        let variable = g.push(Op::LoopVar(depth));
        let h = g.scalar(step);
        let t = g.mul(variable, h);
        let half_pi = g.scalar(0.5 * PI);
        let sinh = g.unary(Unary::Sinh, t);
        let s = g.mul(half_pi, sinh);
        let mu = g.unary(Unary::Tanh, s);
        let value = substitute(g, node, cosine, mu);
        let (cosh_t, cosh_s) = (g.unary(Unary::Cosh, t), g.unary(Unary::Cosh, s));
        let square = g.mul(cosh_s, cosh_s);
        let scale = g.scalar(2.0 * PI * 0.5 * PI * step);
        let weight = g.mul(scale, cosh_t);
        let weight = g.div(weight, square);
        let width = g.width(value);
        let weight = g.widen(weight, width);
        let term = g.mul(weight, value);
        g.reduce(Fold::Sum, depth, -NODES..NODES + 1, term)
    }
}

/// A copy of what a node is with another node in place of an input.
fn substitute(graph: &mut Graph, root: NodeId, input: NodeId, by: NodeId) -> NodeId {
    let live = graph.reachable(&[root]);
    let mut map: Vec<NodeId> = graph.ids().collect();
    map[input.0 as usize] = by;
    let ids: Vec<NodeId> = graph.ids().filter(|id| live.get(id.0 as usize) == Some(&true)).collect();
    for id in ids {
        if id == input {
            continue;
        }
        let old = *graph.op(id);
        let new = Graph::map_operands(&old, |a| map[a.0 as usize]);
        if new != old {
            map[id.0 as usize] = graph.push(new);
        }
    }
    map[root.0 as usize]
}
