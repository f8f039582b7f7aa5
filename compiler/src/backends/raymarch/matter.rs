//! The media as this backend sees them: what is uniform, what has a closed form, what must be sampled, what must be checked.

use super::project::{Data, data_of};
use super::shapes::{Region, is_hosted, region};
use crate::analysis::closed::{ExponentialTerm, exponential_sum, ratio};
use crate::analysis::jumps::{Jump, jumps};
use crate::analysis::range::{Range, ranges};
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{Binary, Composite, FieldScene, Graph, NodeId, Op, Primitive, Tier};
use crate::passes::{self, is_zero};
use crate::program::Ledger;
use crate::source::Span;

/// Most terms of a closed form: beyond, a loop over steps is no slower.
const TERMS: usize = 8;

/// A coefficient that must be checked where it is sampled.
#[derive(Copy, Clone, Debug)]
pub(super) struct Check {
    /// Index in [`crate::program::Fault`]'s fields.
    pub(super) field: &'static str,
    pub(super) node: NodeId,
}

/// One medium.
pub(super) struct Matter {
    /// Index in the scene.
    pub(super) index: u32,
    pub(super) name: String,
    pub(super) span: Option<Span>,
    pub(super) region: Region,
    /// k_a + k_s; `None` if it is 0.
    pub(super) extinction: Option<NodeId>,
    /// k_e; `None` if it is 0.
    pub(super) emission: Option<NodeId>,
    /// Whether some coefficient depends on the position.
    pub(super) varying: bool,
    /// The extinction's closed form along rays, if it has one.
    pub(super) closed: Option<Vec<ExponentialTerm>>,
    /// k_e/k_t, if that does not depend on the position.
    pub(super) source: Option<NodeId>,
    /// Largest k_e/k_t, if a bound is known now.
    pub(super) source_bound: Option<f64>,
    /// Coefficients not known to be finite and ≥ 0.
    pub(super) checks: Vec<Check>,
    /// Planes on which its coefficients jump.
    pub(super) jumps: Vec<Jump>,
    /// What a projection shows of it.
    pub(super) data: Option<Data>,
}

/// All that the kernel needs to know about the scene.
pub(super) struct Scene {
    pub(super) matter: Vec<Matter>,
    pub(super) primitives: Vec<Primitive>,
    pub(super) tiers: Vec<Tier>,
    pub(super) background: Option<NodeId>,
    /// Components of optical depths.
    pub(super) depth_width: u8,
    /// Components of radiance.
    pub(super) light_width: u8,
    /// Whether every segment has a closed form.
    pub(super) closed: bool,
}

fn add(graph: &mut Graph, a: NodeId, b: NodeId) -> NodeId {
    let width = graph.width(a).max(graph.width(b));
    let widen = |graph: &mut Graph, n: NodeId| {
        if graph.width(n) == width { n } else { passes::push(graph, Op::Splat(n, width)) }
    };
    let (a, b) = (widen(graph, a), widen(graph, b));
    passes::push(graph, Op::Binary(Binary::Add, a, b))
}

fn no_normal(medium: &crate::ir::Medium) -> Diagnostic {
    let message =
        format!("an isosurface of `{}` needs the gradient of its data, which is a gradient already", medium.name);
    let diagnostic = Diagnostic::error("E0522", message);
    match medium.span {
        Some(span) => diagnostic.at(span, "the data of this medium"),
        None => diagnostic,
    }
    .hint("project it with `composite = maximum`, or take the isosurface of the grid itself")
}

impl Scene {
    pub(super) fn new(scene: &mut FieldScene, ledger: &mut Ledger, diagnostics: &mut Diagnostics) -> Self {
        let media = scene.media.clone();
        let composite = scene.render.composite;
        let projecting = composite != Composite::Radiance;
        let graph = &mut scene.graph;
        let mut primitives = vec![];
        let mut matter = vec![];
        for (index, medium) in media.iter().enumerate() {
            let k_t = add(graph, medium.k_a, medium.k_s);
            graph.annotate(k_t, None, Some(&format!("{}.k_t", medium.name)));
            let extinction = (!is_zero(graph, k_t)).then_some(k_t);
            let emission = (!is_zero(graph, medium.k_e)).then_some(medium.k_e);
            let data = match data_of(graph, medium, composite) {
                Ok(data) => data.filter(|_| projecting),
                Err(_) => {
                    diagnostics.push(no_normal(medium));
                    None
                }
            };
            if projecting && data.is_none() {
                ledger.omit(format!("medium {}", medium.name), "it has no data to project", medium.span);
                continue;
            }
            if !projecting && extinction.is_none() && emission.is_none() {
                ledger.omit(format!("medium {}", medium.name), "all its coefficients are 0", medium.span);
                continue;
            }
            if emission.is_none() && !projecting {
                ledger.omit(format!("emission of {}", medium.name), "its k_e is 0", medium.span);
            }
            if extinction.is_none() && !projecting {
                ledger.omit(format!("extinction of {}", medium.name), "its k_a and k_s are 0", medium.span);
            }
            let push = &mut |graph: &mut Graph, op: Op| passes::push(graph, op);
            let closed = match extinction {
                Some(node) => exponential_sum(graph, push, node, TERMS),
                None => Some(vec![]),
            };
            let quotient = match (emission, extinction) {
                (Some(e), Some(t)) => Some(ratio(graph, push, e, t)),
                _ => None,
            };
            let roots: Vec<NodeId> = [extinction, emission].into_iter().flatten().collect();
            let jumps = if projecting { vec![] } else { jumps(graph, push, &roots) };
            matter.push((index as u32, medium, (extinction, emission), closed, quotient, data, jumps));
        }
        let tiers = graph.tiers();
        let ranges = ranges(graph);
        let range = |n: NodeId| ranges[n.0 as usize];
        let varies = |n: Option<NodeId>| n.is_some_and(|n| tiers[n.0 as usize] == Tier::Sample);
        let matter: Vec<Matter> = matter
            .into_iter()
            .map(|(index, medium, (extinction, emission), closed, quotient, data, jumps)| {
                let varying = varies(extinction) || varies(emission);
                let checks = [("k_a", medium.k_a), ("k_s", medium.k_s), ("k_e", medium.k_e)]
                    .into_iter()
                    .filter(|(_, n)| {
                        varies(Some(*n)) && !(range(*n).is_nonnegative() && range(*n).high < f64::INFINITY)
                    })
                    .map(|(field, node)| Check { field, node })
                    .collect();
                let bound = |r: Range| (!r.nan && r.high.is_finite() && r.low >= 0.0).then_some(r.high);
                Matter {
                    index,
                    name: medium.name.clone(),
                    span: medium.span,
                    region: region(&medium.shape, &mut primitives),
                    extinction,
                    emission,
                    varying,
                    closed,
                    source: quotient.filter(|q| is_hosted(&tiers, *q)),
                    source_bound: match (emission, quotient) {
                        (None, _) => Some(0.0),
                        (Some(_), Some(q)) => bound(range(q)).filter(|b| *b < 1e30),
                        (Some(_), None) => None,
                    },
                    checks,
                    jumps,
                    data,
                }
            })
            .collect();
        let width = |n: Option<NodeId>| n.map_or(1, |n| graph.width(n));
        let depth_width = matter.iter().map(|m| width(m.extinction)).max().unwrap_or(1);
        let background = (!is_zero(graph, scene.background)).then_some(scene.background);
        let glow = matter.iter().any(|m| m.emission.is_some());
        let mut light_width = matter.iter().map(|m| width(m.emission)).max().unwrap_or(1).max(width(background));
        if projecting {
            let colors = matter.iter().filter_map(|m| m.data.as_ref()).map(|d| graph.width(d.color));
            light_width = colors.max().unwrap_or(1).max(width(background));
        } else if background.is_some() || glow {
            light_width = light_width.max(depth_width);
        }
        let depth_width = if projecting { 1 } else { depth_width };
        let closed = !projecting && Self::all_closed(&matter);
        Self { matter, primitives, tiers, background, depth_width, light_width, closed }
    }

    /// Uniform media add up; beyond them, extinction must be a sum of exponentials, and what shines must shine everywhere with
    /// one source function.
    fn all_closed(matter: &[Matter]) -> bool {
        if matter.iter().all(|m| !m.varying) {
            return true;
        }
        if matter.iter().any(|m| m.closed.is_none()) {
            return false;
        }
        let shining: Vec<&Matter> = matter.iter().filter(|m| m.emission.is_some()).collect();
        match shining.first() {
            None => true,
            Some(first) => {
                first.source.is_some()
                    && shining.len() == matter.len()
                    && shining.iter().all(|m| m.source == first.source)
            }
        }
    }

    /// Whether anything shines.
    pub(super) fn glows(&self) -> bool {
        self.matter.iter().any(|m| m.emission.is_some())
    }

    /// Whether anything attenuates.
    pub(super) fn attenuates(&self) -> bool {
        self.matter.iter().any(|m| m.extinction.is_some())
    }
}
