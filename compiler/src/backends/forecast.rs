//! Which backend draws a scene fastest to the accuracy asked: what `backend = auto` goes by.
//!
//! A ray through media costs each backend
//!
//!   time = redrawn · (ray + n·(piece + w·unit))
//!
//! with n pieces along it, which look at fields of the weight w, and a lattice of n³ nodes costs n³·(node + seen·w·unit) besides. What
//! is left is an error of
//!
//!   error = first · n^(−order)
//!
//! of display white, the largest of a picture, so that the accuracy tells n. The weight of fields is that of their operations, counted in sums and
//! products of one component. All of it is measured, on examples, by `cargo bench --bench forecast`, which prints this
//! module's tables; they hold for the machine on which they were measured, and the choice between backends wherever their ratios
//! do. A scene can be smoother or rougher than the examples, by which times are wrong by a factor of two and errors by more. The
//! ray marcher alone controls its error where it arises; the others find theirs by drawing twice. It is therefore taken unless another
//! is predicted to be twice as fast. What a picture really is wrong by, the drawing reports.

use super::{Entry, REGISTRY};
use crate::Options;
use crate::diagnostic::Diagnostics;
use crate::ir::{Backend, FieldScene, Filter, Graph, NodeId, Op, RenderInfo, Scattering, Tier, Unary, free_variables};
use crate::passes::is_zero;
use crate::program::{Forecast, Outcome, Plan, StepRule};
use crate::transport::is_multiple;

/// What a backend takes, in nanoseconds, and what it leaves. Those of all backends stand in [`REGISTRY`].
#[derive(Copy, Clone, Debug)]
pub struct Rates {
    /// For a ray, whatever is on it.
    pub ray: f64,
    /// For a piece on a ray, fields apart.
    pub piece: f64,
    /// Whether fields are evaluated for each piece on a ray.
    pub looks: bool,
    /// For a node of a lattice, fields apart, and how often it looks at these; both 0 without a lattice.
    pub node: f64,
    /// See there.
    pub seen: f64,
    /// How often a picture is drawn until it is known to be good enough, in drawings of the last.
    pub redrawn: f64,
    /// The error that one piece would leave, as a share of display white.
    pub first: f64,
    /// How fast it falls with their number.
    pub order: f64,
    /// Most pieces along a ray.
    pub most: f64,
}

/// Nanoseconds of a sum or product of one component, and of a lit sample's share of looking its lights up.
const UNIT: f64 = 0.009;
const LOOK: f64 = 30.0;
/// Nanoseconds for a splat of a file: projected, put in order and in lists, blended.
const SPLAT: f64 = 1500.0;
/// Nanoseconds of a random path, fields apart, and how often one evaluates them.
const PATH: f64 = 5000.0;
const FLIGHTS: f64 = 60.0;
/// What is left of an error where no rule leaves one, as a share of white.
const ROUNDING: f64 = 1e-6;
/// By how much another backend must be faster than the ray marcher.
const MARGIN: f64 = 2.0;

/// Sums and products of one component that an operation is worth.
fn weight(graph: &Graph, id: NodeId) -> f64 {
    let width = f64::from(graph.width(id));
    match *graph.op(id) {
        Op::Const(_) | Op::Truth(_) | Op::Param(_) | Op::Input(_) | Op::LoopVar(_) => 0.0,
        Op::Splat(..) | Op::Extract(..) | Op::Compose(..) | Op::Reduce { .. } => 0.0,
        Op::Unary(op, _) => width * unary(op),
        Op::Binary(..) | Op::Compare(..) | Op::Select { .. } => width,
        Op::PowI(_, n) => width * f64::from(n.unsigned_abs().max(2).ilog2()),
        Op::Dot(a, _) => 2.0 * f64::from(graph.width(a)),
        Op::CellHash { .. } => 40.0,
        Op::Lookup { table, .. } | Op::LookupSlope { table, .. } => {
            // Found by halving, and blended.
            let rows = graph.table(table).keys.len().max(2) as f64;
            10.0 * rows.log2() + 2.0 * width
        }
        Op::Sample { grid, .. } | Op::SampleGradient { grid, .. } => match graph.grid(grid).filter {
            Filter::Nearest => 30.0,
            Filter::Linear => 120.0,
            Filter::Cubic => 900.0,
        },
    }
}

fn unary(op: Unary) -> f64 {
    match op {
        Unary::Neg | Unary::Not | Unary::Abs | Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round => 1.0,
        Unary::Sqrt => 4.0,
        Unary::Exp | Unary::Expm1 | Unary::Log => 12.0,
        Unary::Sin | Unary::Cos | Unary::Tan => 20.0,
        Unary::Asin | Unary::Acos | Unary::Atan | Unary::Sinh | Unary::Cosh | Unary::Tanh => 25.0,
    }
}

/// The weight of all fields of media that vary along a ray, in an optimised scene.
#[must_use]
pub fn field_weight(scene: &FieldScene) -> f64 {
    let graph = &scene.graph;
    let (tiers, free) = (graph.tiers(), free_variables(graph));
    let roots: Vec<NodeId> = scene.media.iter().flat_map(|m| [m.k_a, m.k_s, m.k_e]).collect();
    let live = graph.reachable(&roots);
    let mut rounds = [1.0f64; 16];
    let here: Vec<NodeId> = graph.ids().filter(|id| live[id.0 as usize]).collect();
    for id in &here {
        if let Op::Reduce { depth, start, end, .. } = *graph.op(*id) {
            let known = &mut rounds[usize::from(depth) % 16];
            *known = known.max(f64::from(end - start));
        }
    }
    let each =
        here.into_iter().filter(|id| tiers[id.0 as usize] == Tier::Sample || free[id.0 as usize] != 0).map(|id| {
            let times: f64 = (0..16).filter(|d| free[id.0 as usize] >> d & 1 == 1).map(|d| rounds[d]).product();
            times * weight(graph, id)
        });
    each.sum()
}

/// What each backend is predicted to make of an optimised scene.
#[must_use]
pub fn forecasts(scene: &FieldScene, options: &Options) -> Vec<Forecast> {
    let weight = field_weight(scene);
    let lit = scene.render.scattering != Scattering::None && scene.media.iter().any(|m| !is_zero(&scene.graph, m.k_s));
    let lights = if lit { scene.lights.len() + usize::from(scene.environment) } else { 0 };
    let field = UNIT * weight + LOOK * lights as f64;
    let [width, height] = scene.image.size;
    let rays = f64::from(width) * f64::from(height);
    let closed = weight == 0.0 && lights == 0;
    let forecast = |entry: &Entry| {
        let mut refused = Diagnostics::default();
        (entry.refuse)(scene, options, &mut refused);
        let outcome = match refused.iter().next() {
            Some(first) => Outcome::Refused(first.message.clone()),
            None => drawn(entry, scene, (rays, field, closed)),
        };
        Forecast { backend: entry.backend, word: entry.word, outcome }
    };
    REGISTRY.iter().map(forecast).collect()
}

fn drawn(entry: &Entry, scene: &FieldScene, (rays, field, closed): (f64, f64, bool)) -> Outcome {
    let Entry { backend, rates, .. } = *entry;
    let render = &scene.render;
    if !scene.splats.is_empty() {
        // Media between them are integrated as by the ray marcher, in no more pieces than splats lie on a ray.
        let pieces: f64 = scene.splats.iter().map(|s| f64::from(s.header.count)).sum();
        let milliseconds = (rays * (rates.ray + field) + pieces * SPLAT) / 1e6;
        return Outcome::Drawn { pieces, of: "splats of files", milliseconds, error: render.accuracy };
    }
    if is_multiple(scene) {
        // The standard error falls with the root of their number, from about that of white.
        let pieces = render.samples.map_or_else(|| (1.0 / render.accuracy.max(1e-6)).powi(2), f64::from);
        let milliseconds = rays * pieces * (PATH + FLIGHTS * field) / 1e6;
        return Outcome::Drawn { pieces, of: "paths a pixel", milliseconds, error: pieces.max(1.0).powf(-0.5) };
    }
    // Pieces along a ray: what is asked for, or what the accuracy needs.
    let asked = match backend {
        Backend::Auto | Backend::Raymarch => render.steps.map(f64::from),
        Backend::Slicing => render.slices.map(f64::from),
        Backend::Splatting => render.splats.map(|n| f64::from(n).cbrt()),
    };
    let needed = (rates.first / render.accuracy.max(1e-12)).powf(1.0 / rates.order);
    let exact = closed && backend != Backend::Splatting;
    let along = if exact { 1.0 } else { asked.unwrap_or(needed).clamp(1.0, rates.most) };
    let redrawn = if exact || asked.is_some() { 1.0 } else { rates.redrawn };
    let piece = rates.piece + if rates.looks { field } else { 0.0 };
    let nodes = along.powi(3) * (rates.node + rates.seen * field);
    let nanoseconds = redrawn * (rays * (rates.ray + along * piece) + nodes);
    let (pieces, of) = match backend {
        Backend::Auto | Backend::Raymarch => (along, "samples a ray"),
        Backend::Slicing => (along, "slabs"),
        Backend::Splatting => (along.powi(3), "Gaussians"),
    };
    let pieces = if exact { 0.0 } else { pieces };
    let error = if exact { ROUNDING } else { rates.first * along.powf(-rates.order) };
    Outcome::Drawn { pieces, of, milliseconds: nanoseconds / 1e6, error }
}

/// Corrects what was predicted of the backend that was taken, where building it found closed forms for everything.
pub fn settle(forecasts: &mut [Forecast], plan: &Plan, scene: &FieldScene) {
    if !scene.splats.is_empty() {
        return;
    }
    let taken = REGISTRY.iter().zip(forecasts).find(|(entry, _)| entry.word == plan.backend);
    if let (Some((entry, forecast)), StepRule::Closed) = (taken, plan.steps) {
        let rays = f64::from(scene.image.size[0]) * f64::from(scene.image.size[1]);
        let milliseconds = rays * (entry.rates.ray + entry.rates.piece) / 1e6;
        forecast.outcome = Outcome::Drawn { pieces: 0.0, of: "", milliseconds, error: ROUNDING };
    }
}

/// The fastest of those that are predicted to keep the accuracy, the ray marcher's time counted half. A number of steps that is asked
/// for stands in the place of the accuracy and means the ray marcher. Where none is good enough, the first that can draw the scene at
/// all; where none can, the ray marcher, which says why.
#[must_use]
pub fn choose(forecasts: &[Forecast], render: &RenderInfo) -> Backend {
    let mut best: Option<(Backend, f64)> = None;
    let mut able = None;
    for forecast in forecasts {
        let Outcome::Drawn { milliseconds, error, .. } = forecast.outcome else { continue };
        able = able.or(Some(forecast.backend));
        let marches = forecast.backend == Backend::Raymarch;
        let time = if marches { milliseconds / MARGIN } else { milliseconds };
        let fits = if render.steps.is_some() { marches } else { error <= 1.001 * render.accuracy };
        if fits && best.is_none_or(|b| time < b.1) {
            best = Some((forecast.backend, time));
        }
    }
    best.map(|b| b.0).or(able).unwrap_or(Backend::Raymarch)
}
