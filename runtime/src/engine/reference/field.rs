//! Fields of one frame as tapes, evaluated at eight points of a ray at once.

use super::closed::Closed;
use super::events::{self, Event, Events, Levels, Watch};
use super::gauss::{N, Nodes};
use super::light::{self, LightField};
use super::paths::bound::Majorants;
use super::paths::phase::PhaseTable;
use super::shape::{self, AltitudeRay, Solid};
use super::surface::{self, SurfaceField};
use super::trace::BANDS;
use crate::frame::vector::{Vec3, along};
use crate::frame::{Placed, placed, shells};
use compiler::diagnostic::Diagnostic;
use compiler::ir::derive::gradient;
use compiler::ir::eval::{Environment, Scratch, Tables, Tape, Voxels, evaluate_with};
use compiler::ir::{FieldScene, Graph, Input, Medium, NodeId, Op, Scattering, Tier};
use compiler::source::Span;
use std::collections::HashMap;

/// A list of roots with the places where they may not be smooth.
#[derive(Clone, Debug)]
pub(super) struct Field {
    full: Sampler,
    /// Without what had to be unrolled from loops, if anything had to: cheaper, for rough tolerances.
    lean: Option<Sampler>,
    /// Whether nothing varies along a ray.
    pub(super) uniform: bool,
}

/// Tapes of some roots and of what is watched beside them.
#[derive(Clone, Debug)]
pub(super) struct Sampler {
    /// The roots, then the nodes of `watches`.
    pub(super) tape: Tape,
    /// How many roots there are.
    pub(super) roots: usize,
    /// What is looked for in each of the nodes after the roots.
    pub(super) watches: Vec<Watch>,
    /// Nodes that are straight along a ray.
    pub(super) straight: Option<Tape>,
    /// Their levels.
    pub(super) levels: Vec<Levels>,
}

impl Sampler {
    fn new(graph: &Graph, roots: &[NodeId], events: &Events, lean: bool) -> Self {
        let taken = |e: &&Event| !(lean && e.unrolled);
        let (mut nodes, mut watches) = (roots.to_vec(), vec![]);
        for event in events.curved.iter().filter(taken) {
            nodes.push(event.node);
            watches.push(event.watch.clone());
        }
        let (mut straight, mut levels) = (vec![], vec![]);
        for event in events.straight.iter().filter(taken) {
            if let Watch::Levels(l) = &event.watch {
                straight.push(event.node);
                levels.push(l.clone());
            }
        }
        Self {
            tape: Tape::new(graph, &nodes),
            roots: roots.len(),
            watches,
            straight: (!straight.is_empty()).then(|| Tape::new(graph, &straight)),
            levels,
        }
    }
}

impl Sampler {
    /// With everything watched as if it were curved.
    fn curved(graph: &Graph, roots: &[NodeId], events: Events) -> Self {
        let Events { mut straight, mut curved } = events;
        straight.append(&mut curved);
        Self::new(graph, roots, &Events { curved: straight, straight: vec![] }, false)
    }
}

/// What is behind everything, as a field of the direction, which stands for the position: so its events are found as those
/// of any field.
fn sky(graph: &mut Graph, background: NodeId, tables: &Tables) -> Sampler {
    let (direction, position) = (graph.input(Input::Direction), graph.input(Input::Position));
    let live = graph.reachable(&[background]);
    let mut map: Vec<NodeId> = graph.ids().collect();
    map[direction.0 as usize] = position;
    let ids: Vec<NodeId> =
        graph.ids().filter(|id| live.get(id.0 as usize) == Some(&true) && *id != direction).collect();
    for id in ids {
        let old = *graph.op(id);
        let new = Graph::map_operands(&old, |a| map[a.0 as usize]);
        if new != old {
            map[id.0 as usize] = graph.push(new);
        }
    }
    let root = map[background.0 as usize];
    let events = events::find(graph, &[root], tables);
    Sampler::curved(graph, &[root], events)
}

impl Field {
    fn new(graph: &mut Graph, roots: &[NodeId], tables: &Tables) -> Self {
        let tiers = graph.tiers();
        let uniform = roots.iter().all(|r| tiers[r.0 as usize] < Tier::Sample);
        let events = if uniform { Events::default() } else { events::find(graph, roots, tables) };
        let unrolled = events.curved.iter().chain(&events.straight).any(|e| e.unrolled);
        Self {
            full: Sampler::new(graph, roots, &events, false),
            lean: unrolled.then(|| Sampler::new(graph, roots, &events, true)),
            uniform,
        }
    }

    /// What is evaluated: everything, or only what rough tolerances need.
    pub(super) fn sampler(&self, lean: bool) -> &Sampler {
        self.lean.as_ref().filter(|_| lean).unwrap_or(&self.full)
    }
}

/// What a medium does to light on its way from a light to a point.
#[derive(Clone, Debug)]
pub(super) struct Shade {
    /// Its optical depth in closed form, if it has one.
    pub(super) closed: Option<Closed>,
    /// k_a, k_s.
    pub(super) field: Field,
}

/// A medium of one frame.
#[derive(Clone, Debug)]
pub(super) struct MediumField {
    pub(super) name: String,
    pub(super) span: Option<Span>,
    pub(super) solid: Solid,
    /// k_a, k_s, k_e.
    pub(super) field: Field,
    /// Where there are lights.
    pub(super) shade: Option<Shade>,
    /// Whether k_s is more than the constant 0.
    pub(super) scatters: bool,
    /// Whether k_e is more than the constant 0.
    pub(super) emits: bool,
    /// `None` is isotropic.
    pub(super) phase: Option<Tape>,
    /// For paths: directions of its phase function, if that is the same everywhere.
    pub(super) table: Option<PhaseTable>,
    /// For paths: no extinction in it is above this; infinite if unknown, or if there are no paths.
    pub(super) bound: Majorants,
    /// For the projections: the data.
    pub(super) data: Option<Field>,
    /// For the projections: colour of a value of the data, which stands for the cosine.
    pub(super) color: Option<Tape>,
    /// Exact gradient of the data, where there is one.
    pub(super) gradient: Option<Tape>,
}

/// Everything of a scene that does not depend on the ray.
#[derive(Clone, Debug)]
pub(super) struct Fields {
    pub(super) media: Vec<MediumField>,
    /// Of the direction in place of the position.
    pub(super) background: Sampler,
    /// How messages call the background.
    pub(super) sky_name: String,
    pub(super) lights: Vec<LightField>,
    /// Whether the background shines on media and surfaces.
    pub(super) environment: bool,
    /// Media scatter light towards the eye.
    pub(super) scatters: bool,
    /// Polar axis for integrals over the sphere, if directions differ most by their angle to it.
    pub(super) axis: Option<Vec3>,
    pub(super) surfaces: Vec<SurfaceField>,
    /// Where splats are.
    pub(super) splats: Vec<Placed>,
    /// Tapes of the fields of `sdf` shapes.
    pub(super) sdf: HashMap<NodeId, Tape>,
    /// Exact gradients of those that bound surfaces, where there are any.
    pub(super) slopes: HashMap<NodeId, Tape>,
    /// Centre and radius of each shell whose altitude is asked for.
    pub(super) shells: Vec<(Vec3, f64)>,
    pub(super) tables: Tables,
    pub(super) params: Vec<Vec<f64>>,
    pub(super) time: f64,
}

impl Fields {
    pub(super) fn new<V: Voxels + ?Sized>(
        scene: &FieldScene,
        params: &[Vec<f64>],
        time: f64,
        voxels: &V,
    ) -> Result<Self, Diagnostic> {
        let mut graph = scene.graph.clone();
        let tables = Tables::evaluate(&graph, params, time);
        let now = Now { params, time, tables: &tables, voxels };
        let frame = |nodes: &[NodeId]| now.numbers(&scene.graph, nodes);
        let bands = (scene.bands.count() as usize).clamp(1, BANDS);
        let tiers = graph.tiers();
        let mut sdf = HashMap::new();
        let mut solid_of = |shape: &compiler::ir::Shape| -> Result<Solid, String> {
            let mut nodes = vec![];
            shape.clone().map_nodes(&mut |n| {
                if tiers[n.0 as usize] <= Tier::Frame {
                    nodes.push(n);
                }
                n
            });
            let values: HashMap<NodeId, Vec<f64>> =
                if nodes.is_empty() { HashMap::new() } else { nodes.iter().copied().zip(frame(&nodes)).collect() };
            let mut value = |n: NodeId| values.get(&n).cloned().unwrap_or_else(|| vec![f64::NAN]);
            let solid = shape::evaluate(shape, &mut value)?;
            let mut fields = vec![];
            solid.fields(&mut fields);
            for field in fields {
                sdf.entry(field).or_insert_with(|| Tape::new(&scene.graph, &[field]));
            }
            Ok(solid)
        };
        let lights = light::evaluate(scene, bands, &frame)?;
        let surfaces = surface::evaluate(scene, &frame, &mut solid_of)?;
        let splats = placed(scene, &frame)?;
        let mut solids = vec![];
        for medium in &scene.media {
            solids.push(solid_of(&medium.shape).map_err(|part| {
                let message = format!("the {part} in the shape of medium `{}` is not finite", medium.name);
                with_span(Diagnostic::error("E0651", message), medium.span)
                    .hint("check the params and divisions that it uses")
            })?);
        }
        let slopes = surface::slopes(&mut graph, &surfaces);
        let scatter = scene.render.scattering != Scattering::None;
        let lit = !lights.is_empty() || scene.environment;
        let paths = scene.render.scattering == Scattering::Multiple;
        let shaded = paths || lit && (scatter || !surfaces.is_empty());
        let mut media = vec![];
        for (medium, solid) in scene.media.iter().zip(solids) {
            media.push(MediumField {
                name: medium.name.clone(),
                span: medium.span,
                solid,
                field: Field::new(&mut graph, &[medium.k_a, medium.k_s, medium.k_e], &tables),
                shade: shaded.then(|| shade(&mut graph, medium, bands, &now)),
                scatters: is_something(&graph, medium.k_s),
                emits: is_something(&graph, medium.k_e),
                phase: medium.phase.map(|p| Tape::new(&scene.graph, &[p])),
                table: None,
                bound: Majorants::everywhere(f64::INFINITY),
                data: medium.data.map(|d| Field::new(&mut graph, &[d], &tables)),
                color: medium.data_color.map(|c| Tape::new(&scene.graph, &[c])),
                gradient: medium.data.and_then(|d| {
                    let position = graph.input(Input::Position);
                    let gradient = gradient(&mut graph, d, position).ok()?;
                    Some(Tape::new(&graph, &[gradient]))
                }),
            });
        }
        let shells = shells(scene, params, time);
        let named = scene.graph.origin(scene.background).name.as_deref().and_then(|n| n.strip_suffix(".environment"));
        let mut all = Self {
            media,
            background: sky(&mut graph, scene.background, &tables),
            sky_name: match named {
                Some(name) => format!("the environment of light `{name}`"),
                None if scene.environment => "the environment".to_owned(),
                None => "the background".to_owned(),
            },
            lights,
            environment: scene.environment,
            scatters: lit && scatter && !paths,
            axis: None,
            surfaces,
            splats,
            sdf,
            slopes,
            shells,
            params: params.to_vec(),
            time,
            tables,
        };
        if paths {
            all.prepare_paths(scene, voxels);
        }
        if all.environment && shaded {
            all.axis = all.find_axis(voxels);
        }
        Ok(all)
    }

    /// Bounds of extinction where there is no closed form, and tables of phase functions that are the same everywhere.
    fn prepare_paths<V: Voxels + ?Sized>(&mut self, scene: &FieldScene, voxels: &V) {
        let tiers = scene.graph.tiers();
        let mut tables = vec![];
        for (field, medium) in self.media.iter().zip(&scene.media) {
            let closed = field.shade.as_ref().is_some_and(|s| s.closed.is_some());
            let bound = if closed {
                Majorants::everywhere(f64::INFINITY)
            } else {
                let frame = (self.params.as_slice(), self.time);
                Majorants::new(&scene.graph, &[medium.k_a, medium.k_s], &field.solid, &self.shells, frame, voxels)
            };
            let same =
                medium.phase.is_some_and(|p| tiers[p.0 as usize] < Tier::Sample && !uses_direction(&scene.graph, p));
            let table = field.phase.as_ref().filter(|_| same).and_then(|tape| {
                let mut scratch = tape.scratch();
                let ray = Ray::new([0.0; 3], [0.0, 0.0, 1.0], &self.shells);
                let values = |cosines: &Nodes| {
                    self.run_phase(tape, &mut scratch, voxels, &ray, &[0.0; N], cosines);
                    let at = |b: usize| *tape.component(&scratch, 0, b.min(tape.width(0) - 1));
                    // What is wrong with it is reported where it is used.
                    Ok(std::array::from_fn(|b| at(b).map(|v| if v > 0.0 && v.is_finite() { v } else { 0.0 })))
                };
                let bands = (scene.bands.count() as usize).clamp(1, BANDS);
                PhaseTable::new(true, bands, values).ok().flatten()
            });
            tables.push((bound, table));
        }
        for (field, (bound, table)) in self.media.iter_mut().zip(tables) {
            (field.bound, field.table) = (bound, table);
        }
    }

    /// The normal of the first plane, or the direction in which an atmosphere thins, unless a phase function is so peaked that
    /// the direction of the ray matters more.
    fn find_axis<V: Voxels + ?Sized>(&self, voxels: &V) -> Option<Vec3> {
        let peaked = self.media.iter().any(|m| {
            m.scatters
                && m.phase.as_ref().is_some_and(|tape| {
                    let cosines = [1.0, 0.99, 0.9, 0.5, -0.5, -0.9, -0.99, -1.0];
                    let mut scratch = tape.scratch();
                    self.run_phase(
                        tape,
                        &mut scratch,
                        voxels,
                        &Ray::new([0.0; 3], [0.0, 0.0, 1.0], &self.shells),
                        &[0.0; N],
                        &cosines,
                    );
                    let most =
                        (0..tape.width(0)).flat_map(|c| tape.component(&scratch, 0, c)).fold(0.0f64, |m, v| m.max(*v));
                    most > 0.35
                })
        });
        if peaked {
            return None;
        }
        let plane = self.surfaces.iter().find_map(|s| match &s.form {
            surface::SurfaceForm::Plane { normal, .. } => Some(*normal),
            surface::SurfaceForm::Disc { .. } | surface::SurfaceForm::Boundary(_) | surface::SurfaceForm::Mesh(_) => {
                None
            }
        });
        let thins = || self.media.iter().find_map(|m| m.shade.as_ref()?.closed.as_ref()?.slope(self, voxels));
        plane.or_else(thins)
    }

    /// Numbers of a node of tier Frame, without voxels.
    pub(super) fn number(&self, scene: &FieldScene, node: NodeId) -> f64 {
        evaluate_with(&scene.graph, &[node], &self.params, self.time, &self.tables)[0][0]
    }

    /// Evaluates a tape at points of a ray. Light travels against the ray inside media; an environment is seen along it.
    pub(super) fn run<V: Voxels + ?Sized>(
        &self,
        tape: &Tape,
        scratch: &mut Scratch,
        voxels: &V,
        ray: &Ray,
        ts: &Nodes,
        towards_sky: bool,
    ) {
        self.run_with(tape, scratch, voxels, ray, ts, &[0.0; N], if towards_sky { 1.0 } else { -1.0 });
    }

    /// Evaluates a phase function at points of the ray into which light is scattered, at cosines of the angle of scattering.
    pub(super) fn run_phase<V: Voxels + ?Sized>(
        &self,
        tape: &Tape,
        scratch: &mut Scratch,
        voxels: &V,
        ray: &Ray,
        ts: &Nodes,
        cosines: &Nodes,
    ) {
        self.run_with(tape, scratch, voxels, ray, ts, cosines, -1.0);
    }

    /// Evaluates what is behind everything in several directions.
    pub(super) fn run_sky<V: Voxels + ?Sized>(&self, scratch: &mut Scratch, voxels: &V, directions: &[Vec3; N]) {
        let environment = Environment {
            position: std::array::from_fn(|c| directions.map(|d| d[c])),
            time: self.time,
            params: &self.params,
            tables: &self.tables,
            ..Environment::default()
        };
        self.background.tape.run(&environment, voxels, scratch);
    }

    fn run_with<V: Voxels + ?Sized>(
        &self,
        tape: &Tape,
        scratch: &mut Scratch,
        voxels: &V,
        ray: &Ray,
        ts: &Nodes,
        cosines: &Nodes,
        sign: f64,
    ) {
        let mut position = [[0.0; N]; 3];
        for (lane, t) in ts.iter().enumerate() {
            let p = along(ray.origin, ray.direction, *t);
            (0..3).for_each(|c| position[c][lane] = p[c]);
        }
        let altitudes: Vec<Nodes> = ray.altitudes.iter().map(|a| ts.map(|t| a.at(t))).collect();
        let environment = Environment {
            position,
            direction: ray.direction.map(|d| [sign * d; N]),
            cos_theta: *cosines,
            time: self.time,
            altitudes: &altitudes,
            params: &self.params,
            tables: &self.tables,
        };
        tape.run(&environment, voxels, scratch);
    }

    /// Evaluates a colour at values of its data, which stand for the cosine.
    pub(super) fn run_value<V: Voxels + ?Sized>(&self, tape: &Tape, scratch: &mut Scratch, voxels: &V, values: &Nodes) {
        let environment = Environment {
            cos_theta: *values,
            time: self.time,
            params: &self.params,
            tables: &self.tables,
            ..Environment::default()
        };
        tape.run(&environment, voxels, scratch);
    }

    /// Evaluates a tape at positions off the ray.
    pub(super) fn run_at<V: Voxels + ?Sized>(
        &self,
        tape: &Tape,
        scratch: &mut Scratch,
        voxels: &V,
        ray: &Ray,
        points: &[Vec3; N],
    ) {
        let altitude = |(center, radius): &(Vec3, f64)| {
            points.map(|p| AltitudeRay::new(p, ray.direction, *center, *radius).at(0.0))
        };
        let altitudes: Vec<Nodes> = self.shells.iter().map(altitude).collect();
        let environment = Environment {
            position: std::array::from_fn(|c| points.map(|p| p[c])),
            direction: ray.direction.map(|d| [-d; N]),
            cos_theta: [0.0; N],
            time: self.time,
            altitudes: &altitudes,
            params: &self.params,
            tables: &self.tables,
        };
        tape.run(&environment, voxels, scratch);
    }
}

/// Whether a node is anything but the constant 0.
fn is_something(graph: &Graph, node: NodeId) -> bool {
    graph.constant(node).is_none_or(|c| c.values().iter().any(|v| *v != 0.0))
}

fn uses_direction(graph: &Graph, node: NodeId) -> bool {
    graph.reads(&[node], |op| *op == Op::Input(Input::Direction))
}

/// What nodes of tier Frame depend on.
struct Now<'a, V: ?Sized> {
    params: &'a [Vec<f64>],
    time: f64,
    tables: &'a Tables,
    voxels: &'a V,
}

impl<V: Voxels + ?Sized> Now<'_, V> {
    fn numbers(&self, graph: &Graph, nodes: &[NodeId]) -> Vec<Vec<f64>> {
        let tape = Tape::new(graph, nodes);
        let environment =
            Environment { time: self.time, params: self.params, tables: self.tables, ..Environment::default() };
        let mut scratch = tape.scratch();
        tape.run(&environment, self.voxels, &mut scratch);
        (0..nodes.len()).map(|i| tape.root(&scratch, i).iter().map(|lane| lane[0]).collect()).collect()
    }
}

/// A medium as shadow rays see it.
fn shade<V: Voxels + ?Sized>(graph: &mut Graph, medium: &Medium, bands: usize, now: &Now<'_, V>) -> Shade {
    let roots = [medium.k_a, medium.k_s];
    let closed = Closed::find(graph, &roots, bands, |g, nodes| now.numbers(g, nodes));
    Shade { closed, field: Field::new(graph, &roots, now.tables) }
}

/// A ray with what the inputs need.
#[derive(Clone, Debug)]
pub(super) struct Ray {
    pub(super) origin: Vec3,
    /// Unit vector.
    pub(super) direction: Vec3,
    pub(super) altitudes: Vec<AltitudeRay>,
}

impl Ray {
    pub(super) fn new(origin: Vec3, direction: Vec3, shells: &[(Vec3, f64)]) -> Self {
        let altitudes = shells.iter().map(|(c, r)| AltitudeRay::new(origin, direction, *c, *r)).collect();
        Self { origin, direction, altitudes }
    }

    pub(super) fn at(&self, t: f64) -> Vec3 {
        along(self.origin, self.direction, t)
    }
}

pub(super) fn with_span(diagnostic: Diagnostic, span: Option<Span>) -> Diagnostic {
    match span {
        Some(span) => diagnostic.at(span, ""),
        None => diagnostic,
    }
}

/// A coefficient that is negative (`E0650`) or not finite (`E0651`) at a position. `value` and `position` in SI.
#[must_use]
pub fn bad_coefficient(medium: &str, span: Option<Span>, field: &str, value: f64, position: Vec3) -> Diagnostic {
    bad_field(&format!("medium `{medium}`"), span, field, value, position)
}

/// The same for a field of anything.
pub(super) fn bad_field(owner: &str, span: Option<Span>, field: &str, value: f64, position: Vec3) -> Diagnostic {
    let [x, y, z] = position;
    let place = format!("at ({x:.6}, {y:.6}, {z:.6}) m");
    let diagnostic = if value < 0.0 && value.is_finite() {
        Diagnostic::error("E0650", format!("{field} of {owner} is negative: {value:.6e} {place}"))
            .hint(format!("clamp it: `{field} = max(0, …)`"))
    } else {
        let what = match value {
            v if v.is_nan() => "not a number".to_owned(),
            v if v.is_finite() => format!("too large ({v:e})"),
            _ => "infinite".to_owned(),
        };
        Diagnostic::error("E0651", format!("{field} of {owner} is {what} {place}"))
            .hint("look for a division by zero, a root or logarithm of a negative number, or an overflow there")
    };
    with_span(diagnostic, span)
}
