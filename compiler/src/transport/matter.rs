//! The media as this backend sees them: what is uniform, what has a closed form, what must be sampled, what must be checked.

use super::project::{Data, data_of};
use super::shapes::{Region, is_hosted, region};
use super::sheets::{Sheet, sheets};
use crate::analysis::closed::{ExponentialTerm, exponential_sum, ratio};
use crate::analysis::interval::Interval;
use crate::analysis::jumps::{Jumps, jumps};
use crate::analysis::range::ranges;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{
    Binary, Composite, FieldScene, Graph, Light, LightKind, NodeId, Op, Primitive, Scattering, Table, TableId, Tier,
    eval,
};
use crate::passes::{self, is_zero};
use crate::program::{Ledger, MediumBounds};
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
    /// k_s where it sends light of some light towards the eye; `None` if there is no such light.
    pub(super) scattering: Option<NodeId>,
    /// Its phase function, by number in [`Scene::phases`].
    pub(super) phase: usize,
    /// Whether some coefficient depends on the position.
    pub(super) varying: bool,
    /// Whether a segment with it is stepped through, since its light has no closed form.
    pub(super) steps: bool,
    /// The extinction's closed form along rays, if it has one.
    pub(super) closed: Option<Vec<ExponentialTerm>>,
    /// k_e/k_t, if that does not depend on the position.
    pub(super) source: Option<NodeId>,
    /// Largest k_e/k_t, if a bound is known now; what is scattered not counted.
    pub(super) source_bound: Option<f64>,
    /// Coefficients not known to be finite and ≥ 0.
    pub(super) checks: Vec<Check>,
    /// Planes on which its coefficients jump.
    pub(super) jumps: Jumps,
    /// What a projection shows of it.
    pub(super) data: Option<Data>,
    /// Its bounds, by number in [`crate::program::Plan::bounds`].
    pub(super) bounds: Option<u32>,
}

/// A phase function that some media share.
pub(super) struct Phase {
    /// Name of the first medium that has it.
    pub(super) name: String,
    /// `None` is isotropic.
    pub(super) node: Option<NodeId>,
    /// At the params' defaults, averaged over the bands.
    pub(super) mean_cosine: f64,
    /// For paths: 1 − cos and 1 + cos of the angle by the share of the directions that are drawn below it.
    pub(super) draws: Option<TableId>,
}

/// All that the kernel needs to know about the scene.
pub(crate) struct Scene {
    pub(super) matter: Vec<Matter>,
    /// Of the media that scatter light towards the eye.
    pub(super) phases: Vec<Phase>,
    /// Lights that shine on media or surfaces.
    pub(super) lights: Vec<Light>,
    /// Whether the background shines on media and surfaces too.
    pub(super) environment: bool,
    pub(super) sheets: Vec<Sheet>,
    pub(super) primitives: Vec<Primitive>,
    pub(super) tiers: Vec<Tier>,
    pub(super) background: Option<NodeId>,
    /// Components of optical depths.
    pub(super) depth_width: u8,
    /// Components of radiance.
    pub(super) light_width: u8,
    /// What bounds media, for the runtime.
    pub(crate) bounds: Vec<MediumBounds>,
    /// Whether every segment has a closed form.
    pub(crate) closed: bool,
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
    pub(crate) fn new(scene: &mut FieldScene, ledger: &mut Ledger, diagnostics: &mut Diagnostics) -> Self {
        let media = scene.media.clone();
        let composite = scene.render.composite;
        let projecting = composite != Composite::Radiance;
        let shining = !projecting && (!scene.lights.is_empty() || scene.environment);
        let lit = shining && scene.render.scattering != Scattering::None;
        let defaults = scene.defaults();
        let paths = scene.render.scattering == Scattering::Multiple;
        let sheets = if projecting { vec![] } else { sheets(scene, ledger) };
        let graph = &mut scene.graph;
        let mut primitives = vec![];
        let mut phases: Vec<Phase> = vec![];
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
            let scattering = (lit && !is_zero(graph, medium.k_s)).then_some(medium.k_s);
            let phase = match scattering {
                Some(_) => phase_of(graph, medium, (&defaults, paths), &mut phases, ledger),
                None => 0,
            };
            let roots: Vec<NodeId> = [extinction, emission].into_iter().flatten().collect();
            let jumps = if projecting { Jumps::default() } else { jumps(graph, push, &roots) };
            matter.push((
                index as u32,
                medium,
                (extinction, emission, scattering, phase),
                closed,
                quotient,
                data,
                jumps,
            ));
        }
        let tiers = graph.tiers();
        let ranges = ranges(graph);
        let range = |n: NodeId| ranges[n.0 as usize];
        let varies = |n: Option<NodeId>| n.is_some_and(|n| tiers[n.0 as usize] == Tier::Sample);
        let mut matter: Vec<Matter> = matter
            .into_iter()
            .map(|(index, medium, (extinction, emission, scattering, phase), closed, quotient, data, jumps)| {
                let varying = varies(extinction) || varies(emission);
                let checks = [("k_a", medium.k_a), ("k_s", medium.k_s), ("k_e", medium.k_e)]
                    .into_iter()
                    .filter(|(_, n)| {
                        varies(Some(*n)) && !(range(*n).is_nonnegative() && range(*n).high < f64::INFINITY)
                    })
                    .map(|(field, node)| Check { field, node })
                    .collect();
                let bound = |r: Interval| (!r.nan && r.high.is_finite() && r.low >= 0.0).then_some(r.high);
                Matter {
                    index,
                    name: medium.name.clone(),
                    span: medium.span,
                    region: region(&medium.shape, &mut primitives),
                    extinction,
                    emission,
                    scattering,
                    phase,
                    varying,
                    steps: false,
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
                    bounds: None,
                }
            })
            .collect();
        mark_steps(&mut matter, &tiers);
        let width = |n: Option<NodeId>| n.map_or(1, |n| graph.width(n));
        let depth_width = matter.iter().map(|m| width(m.extinction)).max().unwrap_or(1);
        let background = (!is_zero(graph, scene.background)).then_some(scene.background);
        let lights = if shining { scene.lights.clone() } else { vec![] };
        let light_width = if projecting {
            let colors = matter.iter().filter_map(|m| m.data.as_ref()).map(|d| graph.width(d.color));
            colors.max().unwrap_or(1).max(width(background))
        } else {
            let strength = |l: &Light| match l.kind {
                LightKind::Directional { irradiance, .. } => irradiance,
                LightKind::Point { intensity, .. } => intensity,
            };
            let nodes = matter.iter().flat_map(|m| [m.emission, m.scattering]).flatten();
            let nodes = nodes.chain(lights.iter().map(strength)).chain(sheets.iter().filter_map(|s| s.albedo));
            let nodes = nodes.chain(phases.iter().filter_map(|p| p.node)).chain(background);
            let nodes: Vec<NodeId> = nodes.collect();
            let own = nodes.iter().map(|n| graph.width(*n)).max().unwrap_or(1);
            if !scene.splats.is_empty() {
                // The light of splats is in their files, and has every band.
                scene.bands.wavelengths.len() as u8
            } else if nodes.is_empty() {
                own
            } else {
                own.max(depth_width)
            }
        };
        let depth_width = if projecting { 1 } else { depth_width };
        let closed = !projecting && matter.iter().all(|m| !m.steps);
        let environment = shining && scene.environment && background.is_some();
        Self {
            matter,
            phases,
            lights,
            environment,
            sheets,
            primitives,
            tiers,
            background,
            depth_width,
            light_width,
            bounds: vec![],
            closed,
        }
    }

    /// Uniform media add up; beyond them, extinction must be a sum of exponentials, and what shines must shine everywhere with
    /// one source function.
    fn all_closed(matter: &[&Matter]) -> bool {
        if matter.iter().all(|m| !m.varying) {
            return true;
        }
        if matter.iter().any(|m| m.closed.is_none()) {
            return false;
        }
        let shining: Vec<&&Matter> = matter.iter().filter(|m| m.emission.is_some()).collect();
        match shining.first() {
            None => true,
            Some(first) => {
                first.source.is_some()
                    && shining.len() == matter.len()
                    && shining.iter().all(|m| m.source == first.source)
            }
        }
    }

    /// Whether anything sends light from within the media.
    pub(crate) fn glows(&self) -> bool {
        self.matter.iter().any(|m| m.emission.is_some() || m.scattering.is_some())
    }

    /// Whether light of lights is gathered somewhere.
    pub(crate) fn is_lit(&self) -> bool {
        !self.lights.is_empty() || self.environment
    }

    /// Whether anything attenuates.
    pub(super) fn attenuates(&self) -> bool {
        self.matter.iter().any(|m| m.extinction.is_some())
    }
}

/// Decides which media are stepped through: those that scatter light towards the eye, those without a closed form, and those
/// whose light has none together with the others'.
fn mark_steps(matter: &mut [Matter], tiers: &[Tier]) {
    for m in matter.iter_mut() {
        let varies = m.extinction.is_some_and(|n| tiers[n.0 as usize] == Tier::Sample);
        m.steps = m.scattering.is_some() || (varies && m.closed.is_none());
    }
    let rest: Vec<&Matter> = matter.iter().filter(|m| !m.steps).collect();
    if !Scene::all_closed(&rest) {
        matter.iter_mut().filter(|m| m.varying).for_each(|m| m.steps = true);
    }
}

/// The number of a medium's phase function among those of the scene.
fn phase_of(
    graph: &mut Graph,
    medium: &crate::ir::Medium,
    (defaults, paths): (&[Vec<f64>], bool),
    phases: &mut Vec<Phase>,
    ledger: &mut Ledger,
) -> usize {
    // A phase function that turned out to be a number is the same in every direction.
    let node = medium.phase.filter(|n| graph.constant(*n).is_none());
    if node.is_none() {
        ledger.omit(format!("phase function of {}", medium.name), "it scatters alike in all directions", medium.span);
    }
    if let Some(known) = phases.iter().position(|p| p.node == node) {
        return known;
    }
    let mean_cosine = node.map_or(0.0, |n| {
        let facts = eval::phase_facts_at(graph, n, defaults, [0.0; 3]);
        let mean = facts.moment.iter().sum::<f64>() / facts.integral.iter().sum::<f64>();
        if mean.is_finite() { mean.clamp(-1.0, 1.0) } else { 0.0 }
    });
    let draws = node.filter(|_| paths).map(|n| {
        let tables = eval::Tables::evaluate(graph, defaults, 0.0);
        let environment = eval::Environment { params: defaults, tables: &tables, ..eval::Environment::default() };
        let parts = eval::phase_draws(graph, n, &environment);
        let keys = parts.iter().map(|p| graph.scalar(p.share)).collect();
        let values = parts.iter().map(|p| graph.vector(&[p.versine, p.vercosine])).collect();
        let name = format!("{}_directions", medium.name);
        graph.add_table(Table { name, span: medium.span, keys, values, width: 2 })
    });
    phases.push(Phase { name: medium.name.clone(), node, mean_cosine, draws });
    phases.len() - 1
}
