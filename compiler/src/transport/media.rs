//! The media while a function is written: which of their coefficients vary, and the functions that give these at a place.
//!
//! Media that lie in the same region and read the same noise or voxels share one function, so that these are worked out once.

use super::matter::Matter;
use super::shapes::Ray;
use super::trace::{Tracer, Walk};
use crate::fields::{Code, FieldFunction, field_function};
use crate::ir::{Graph, NodeId, Op, Tier};
use crate::program::kernel::{Expr, Ty};
use crate::program::{Fault, OutputKind, StepRule};
use std::rc::Rc;

/// The values of a medium's coefficients where they do not depend on the position.
#[derive(Clone, Default)]
pub(super) struct Constant {
    pub(super) extinction: Option<Expr>,
    pub(super) emission: Option<Expr>,
    pub(super) scattering: Option<Expr>,
}

/// A function of the position, and the values that it takes from the ray.
pub(super) struct Varying {
    /// What its result is called.
    pub(super) name: String,
    pub(super) function: FieldFunction,
    pub(super) hoisted: Vec<Expr>,
}

/// One medium while the function is written.
pub(super) struct Medium<'a> {
    pub(super) matter: &'a Matter,
    pub(super) constant: Constant,
    /// Its function of the position, which other media may share.
    pub(super) varying: Option<Rc<Varying>>,
    /// Position of each varying field in the function's result.
    pub(super) extinction_at: Option<usize>,
    pub(super) emission_at: Option<usize>,
    pub(super) scattering_at: Option<usize>,
    /// The same of the scalar without which there is nothing of it, by the number of its bounds.
    pub(super) support_at: Option<(u32, usize)>,
    /// The same of what is checked, and the numbers of its faults: negative, and not finite.
    pub(super) checks_at: Vec<(usize, u32, u32)>,
    /// Whether it is here; `None` is always.
    pub(super) here: Option<Expr>,
}

impl<'a> Medium<'a> {
    /// Without any coefficient.
    pub(super) fn plain(matter: &'a Matter) -> Self {
        Self {
            matter,
            constant: Constant::default(),
            varying: None,
            extinction_at: None,
            emission_at: None,
            scattering_at: None,
            support_at: None,
            checks_at: vec![],
            here: None,
        }
    }

    /// Whether a call gives the coefficients of both.
    pub(super) fn goes_with(&self, other: &Self) -> bool {
        matches!((&self.varying, &other.varying), (Some(a), Some(b)) if Rc::ptr_eq(a, b))
    }

    /// Moves the positions of its fields.
    fn place(&mut self, to: impl Fn(usize) -> usize) {
        for at in [&mut self.extinction_at, &mut self.emission_at, &mut self.scattering_at].into_iter().flatten() {
            *at = to(*at);
        }
        self.support_at.iter_mut().for_each(|s| s.1 = to(s.1));
        self.checks_at.iter_mut().for_each(|c| c.0 = to(c.0));
    }
}

/// Media that share a function, and the fields that it gives: whose they are, what they are called there, and their node.
#[derive(Default)]
struct Group {
    members: Vec<usize>,
    fields: Vec<(usize, &'static str, NodeId)>,
    costly: Vec<NodeId>,
}

/// What is worth sharing: the nodes beneath these that read noise, voxels or tables at a place, or go round a loop.
fn costly(graph: &Graph, tiers: &[Tier], roots: &[NodeId]) -> Vec<NodeId> {
    let live = graph.reachable(roots);
    let dear = |id: &NodeId| {
        let reads = match graph.op(*id) {
            Op::CellHash { .. } | Op::Sample { .. } | Op::SampleGradient { .. } => true,
            Op::Lookup { .. } | Op::LookupSlope { .. } | Op::Reduce { .. } => true,
            Op::Const(_) | Op::Truth(_) | Op::Param(_) | Op::Input(_) | Op::LoopVar(_) => false,
            Op::Unary(..) | Op::Binary(..) | Op::PowI(..) | Op::Compare(..) | Op::Select { .. } => false,
            Op::Compose(..) | Op::Splat(..) | Op::Extract(..) | Op::Dot(..) => false,
        };
        reads && tiers[id.0 as usize] == Tier::Sample
    };
    graph.ids().filter(|id| live[id.0 as usize]).filter(dear).collect()
}

impl Tracer<'_> {
    /// Writes the functions of varying media and evaluates the constant coefficients.
    pub(super) fn media<'s>(&mut self, code: &mut Code, ray: &Ray) -> Vec<Medium<'s>>
    where
        Self: 's,
    {
        let scene = self.scene;
        let eye = matches!(self.walk, Walk::Eye | Walk::Path(_));
        // Light travels against the ray of the eye, and along no other than that from its source.
        let travel = -ray.direction.clone();
        let varies = |n: Option<NodeId>| n.filter(|n| scene.tiers[n.0 as usize] == Tier::Sample);
        let stepping = scene.matter.iter().any(|m| self.steps(m));
        let only = self.only;
        let mut out: Vec<Medium<'s>> = vec![];
        let mut groups: Vec<Group> = vec![];
        for matter in &scene.matter {
            if !eye && (matter.extinction.is_none() || only.is_some_and(|only| !only(self, matter))) {
                continue;
            }
            let wanted = [matter.extinction, matter.emission.filter(|_| eye), matter.scattering.filter(|_| eye)];
            let [extinction, emission, scattering] = wanted.map(varies);
            // Where steps are taken, everything that varies is sampled; where all is closed, nothing is.
            let sampled = (stepping || matches!(self.walk, Walk::Path(_)))
                && (eye || self.open_depth(matter) || matches!(self.walk, Walk::Shadow { .. }))
                && wanted.iter().any(|n| varies(*n).is_some());
            let mut medium = Medium::plain(matter);
            if sampled {
                let mut roots: Vec<(&'static str, NodeId)> = vec![];
                let mut place = |name: &'static str, node: NodeId| {
                    roots.iter().position(|r| r.1 == node).unwrap_or_else(|| {
                        roots.push((name, node));
                        roots.len() - 1
                    })
                };
                medium.extinction_at = extinction.map(|n| place("k_t", n));
                medium.emission_at = emission.map(|n| place("k_e", n));
                medium.scattering_at = scattering.map(|n| place("k_s", n));
                medium.support_at = self.support(matter).map(|(number, node)| (number, place("support", node)));
                let checks = if self.wants(OutputKind::Fault) { matter.checks.as_slice() } else { &[] };
                let fault = |field, not_finite| Fault { medium: matter.index, field, not_finite }.code();
                let check =
                    checks.iter().map(|c| (place(c.field, c.node), fault(c.field, false), fault(c.field, true)));
                medium.checks_at = check.collect();
                self.join(&mut medium, out.len(), &roots, &mut groups, &out);
            }
            let mut constant = |node: Option<NodeId>, varying: Option<NodeId>, name: &str| {
                let node = node.filter(|_| varying.is_none())?;
                let name = format!("{}_{name}", matter.name);
                if scene.tiers[node.0 as usize] <= Tier::Frame {
                    return Some(self.builder.value(self.graph, node, &name));
                }
                let value = self.along_ray(code, &travel, &[node]).remove(0);
                Some(code.bind(&name, Ty::float(self.graph.width(node)), value))
            };
            medium.constant = Constant {
                extinction: constant(wanted[0], extinction, "k_t"),
                emission: constant(wanted[1], emission, "k_e"),
                scattering: constant(wanted[2], scattering, "k_s"),
            };
            out.push(medium);
        }
        for group in groups {
            let varying = Rc::new(self.varying(code, &travel, &group, &out, eye));
            group.members.iter().for_each(|m| out[*m].varying = Some(varying.clone()));
        }
        out
    }

    /// What tells steps how far from a medium they are, and the number of its bounds.
    fn support(&self, matter: &Matter) -> Option<(u32, NodeId)> {
        let steered = matches!(self.rule, StepRule::Closed | StepRule::Adaptive(_)) && matches!(self.walk, Walk::Eye);
        let number = matter.bounds.filter(|_| steered)?;
        let node = self.scene.bounds[number as usize].support?;
        (self.scene.tiers[node.0 as usize] == Tier::Sample).then_some((number, node))
    }

    /// Puts a medium into the group of one that lies in the same region and shares something costly, or into one of its own.
    fn join(
        &self,
        medium: &mut Medium<'_>,
        number: usize,
        roots: &[(&'static str, NodeId)],
        groups: &mut Vec<Group>,
        out: &[Medium<'_>],
    ) {
        let nodes: Vec<NodeId> = roots.iter().map(|r| r.1).collect();
        let costly = costly(self.graph, &self.scene.tiers, &nodes);
        let fits = |g: &Group| {
            out[g.members[0]].matter.region == medium.matter.region && g.costly.iter().any(|n| costly.contains(n))
        };
        let at = groups.iter().position(fits).unwrap_or_else(|| {
            groups.push(Group::default());
            groups.len() - 1
        });
        let group = &mut groups[at];
        group.members.push(number);
        group.costly.extend(costly);
        let places: Vec<usize> = roots
            .iter()
            .map(|(name, node)| {
                group.fields.iter().position(|f| f.2 == *node).unwrap_or_else(|| {
                    group.fields.push((number, name, *node));
                    group.fields.len() - 1
                })
            })
            .collect();
        medium.place(|i| places[i]);
    }

    /// Writes the function of a group.
    fn varying(&mut self, code: &mut Code, travel: &Expr, group: &Group, out: &[Medium<'_>], eye: bool) -> Varying {
        let names: Vec<&str> = group.members.iter().map(|m| out[*m].matter.name.as_str()).collect();
        let name = names.join("_and_");
        let fields: Vec<(String, NodeId)> = group
            .fields
            .iter()
            .map(|(owner, field, node)| match names.len() {
                1 => ((*field).to_owned(), *node),
                _ => (format!("{}_{field}", out[*owner].matter.name), *node),
            })
            .collect();
        let roots: Vec<(&str, NodeId)> = fields.iter().map(|(name, node)| (name.as_str(), *node)).collect();
        let title = if eye { format!("{name}_at") } else { format!("{name}_k_t") };
        let span = out[group.members[0]].matter.span;
        let function = field_function(self.graph, &self.scene.tiers, self.builder, &title, span, &roots);
        let hoisted = self.along_ray(code, travel, &function.hoisted);
        Varying { name, function, hoisted }
    }

    /// Does something with each of some media that are here; those that a call gives together stand in one block.
    pub(super) fn each_group(
        &mut self,
        code: &mut Code,
        media: &[&Medium<'_>],
        visit: &mut dyn FnMut(&mut Self, &mut Code, &[&Medium<'_>]),
    ) {
        let mut rest = media.to_vec();
        while let Some(first) = rest.first().copied() {
            let (together, others): (Vec<_>, Vec<_>) =
                rest.iter().copied().partition(|m| std::ptr::eq(*m, first) || m.goes_with(first));
            rest = others;
            code.open();
            visit(self, code, &together);
            let body = code.close();
            match &first.here {
                Some(here) => code.push_if(here.clone(), body),
                None => code.push_all(body),
            }
        }
    }
}
