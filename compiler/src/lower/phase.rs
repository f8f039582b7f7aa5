//! Phase functions: normalised over the sphere whatever they are written as.
//!
//! What depends on nothing but the cosine is integrated when compiling and divided by its integral. What depends on params,
//! time or place is integrated at a handful of their values: if it is normalised at all of them (as everything in
//! `std::phase` is) it stays as it is, otherwise it is divided by its own integral, a sum in the graph by the double
//! exponential rule of Takahasi and Mori (1974), which follows every change of a param.

use super::{Lowered, Lowerer};
use crate::check::hir;
use crate::diagnostic::Diagnostic;
use crate::ir::{Fold, Graph, Input, NodeId, Op, Unary, eval};
use std::f64::consts::PI;

/// Integrals this close to 1 are 1.
const CLOSE: f64 = 1e-9;
/// Nodes of the rule in the graph, on both sides of the middle, and how far it reaches.
const NODES: i32 = 96;
const REACH: f64 = 3.0;

impl<'s> Lowerer<'s, '_> {
    pub(super) fn phase(&mut self, medium: &hir::Medium, expr: &'s hir::Expr) -> Lowered<Option<NodeId>> {
        let node = self.spectrum(expr)?;
        let cosine = self.graph.input(Input::CosTheta);
        let live = self.graph.reachable(&[node]);
        // Whatever varies must do so through the cosine alone to be integrated now.
        let varies = self.graph.ids().any(|id| {
            live[id.0 as usize]
                && id != cosine
                && matches!(
                    self.graph.op(id),
                    Op::Input(_) | Op::Param(_) | Op::Sample { .. } | Op::SampleGradient { .. }
                )
        });
        let name = format!("{}.phase", medium.name);
        // A table of `mie` is normalised as it is interpolated; to integrate its thousands of corners would be less exact.
        if self.is_mie(node) {
            self.name(node, &name);
            return Ok(Some(node));
        }
        let mut factor = None;
        for (params, position) in self.trials(varies) {
            let facts = eval::phase_facts_at(&self.graph, node, &params, position);
            self.refuse_phase(medium, expr, &facts)?;
            let unit = facts.integral.iter().all(|i| (i - 1.0).abs() <= CLOSE + 2.0 * facts.uncertainty);
            if !unit {
                factor = Some(facts.integral);
                break;
            }
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
        let integral = if varies { self.sphere_integral(node, cosine) } else { self.graph.vector(&integral) };
        let integral = self.graph.widen(integral, width);
        let node = self.graph.div(node, integral);
        self.name(node, &name);
        self.span_new(expr.span);
        Ok(Some(node))
    }

    /// Values of the params and places at which a phase function is looked at.
    fn trials(&self, varies: bool) -> Vec<(Vec<Vec<f64>>, [f64; 3])> {
        let defaults = self.defaults();
        let mut trials = vec![(defaults.clone(), [0.31, 0.17, 0.23])];
        if varies {
            for share in [0.03, 0.4, 0.77, 0.98] {
                let mut params = defaults.clone();
                for (values, param) in params.iter_mut().zip(&self.scene.params) {
                    if let Some((low, high)) = param.range {
                        let factor = self.units.scale(param.dimension[0]);
                        values.iter_mut().for_each(|v| *v = (low + (high - low) * share) * factor);
                    }
                }
                trials.push((params, [share, 1.0 - 2.0 * share, -share * share]));
            }
        }
        trials
    }

    fn refuse_phase(&mut self, medium: &hir::Medium, expr: &hir::Expr, facts: &eval::PhaseFacts) -> Lowered<()> {
        let problem = if facts.diverges || facts.integral.iter().any(|i| !i.is_finite()) {
            "cannot be integrated over the sphere".to_owned()
        } else if facts.least.0 < 0.0 {
            format!("is negative: {:.4} at cos_theta = {:.4}", facts.least.0, facts.least.1)
        } else if facts.integral.iter().any(|i| *i <= 0.0) {
            "is zero in every direction".to_owned()
        } else {
            return Ok(());
        };
        self.report(
            Diagnostic::error("E0517", format!("the phase function of `{}` {problem}", medium.name))
                .at(expr.span, "light cannot be scattered by this")
                .note("a phase function says how much light is turned by each angle: 0 or more, and not all of it 0")
                .hint("clamp it with `max(0, …)`, or take one of `std::phase`"),
        )
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
