//! What can be said about the media of a scene before it is drawn: coefficients that go negative, media with nothing in them,
//! that nothing is seen through, or far smaller than their shapes, steps longer than what they should find, and differences that
//! were rewritten since their digits cancel.
//!
//! Media are looked at along some rays, by the reference's evaluator at the default values of params; that a medium is empty is
//! said only where intervals of its fields prove it.

use super::bricks::{Bricks, Nothing};
use super::extremes::Grids;
use super::vector::{Vec3, length, sub};
use crate::engine::reference::{Survey, survey};
use compiler::analysis::feature::lipschitz_of;
use compiler::analysis::interval::Interval;
use compiler::analysis::narrow::narrow;
use compiler::analysis::range::Known;
use compiler::diagnostic::{Diagnostic, Diagnostics};
use compiler::ir::{Binary, FieldScene, Op, Unary};
use compiler::program::Program;

/// Half the rays through a medium are dimmed by e to this: nothing is seen through it.
const OPAQUE: f64 = 50.0;
/// Share of its shape's box that matter must leave empty to be worth a remark, and places where it was found.
const ROOMY: (f64, usize) = (0.9, 12);

/// Looks at the media of a scene. Of those that depend on grids nothing is said without their voxels.
#[must_use]
pub fn findings(program: &Program, grids: Option<&Grids>) -> Diagnostics {
    let scene = &program.lowered;
    let params = scene.defaults();
    let sampled = |medium: usize| {
        let m = &scene.media[medium];
        let voxels = |op: &Op| matches!(op, Op::Sample { .. } | Op::SampleGradient { .. });
        scene.graph.reads(&[m.k_a, m.k_s, m.k_e], voxels)
    };
    let none = Grids::default();
    let skip = |medium: usize| grids.is_none() && sampled(medium);
    let grids = grids.unwrap_or(&none);
    let mut out = Diagnostics::default();
    for found in survey(scene, &params, 0.0, grids, &skip) {
        negative(scene, &found, &mut out);
        if found.occupied == 0 {
            empty(program, &found, (&params, grids), &mut out);
        } else {
            dense(scene, &found, &mut out);
            roomy(scene, &found, &mut out);
        }
        if let Some(steps) = scene.render.steps {
            overstepped(scene, &found, steps, &params, &mut out);
        }
    }
    rewritten(scene, &mut out);
    out
}

/// Tells where 1 − eˣ and eˣ − 1 stand in the scene's own text: passes make `expm1` of them.
fn rewritten(scene: &FieldScene, out: &mut Diagnostics) {
    let graph = &scene.graph;
    let live = graph.reachable(&scene.roots());
    let own = |span: &compiler::source::Span| {
        scene.media.iter().any(|m| m.span.is_some_and(|medium| medium.source == span.source))
    };
    for id in graph.ids().filter(|id| live[id.0 as usize]) {
        let Op::Binary(Binary::Sub, a, b) = *graph.op(id) else { continue };
        let exponential = |node| matches!(graph.op(node), Op::Unary(Unary::Exp, _));
        let (written, computed) = match (graph.number(a), graph.number(b)) {
            (Some(1.0), _) if exponential(b) => ("1 - exp(x)", "-expm1(x)"),
            (_, Some(1.0)) if exponential(a) => ("exp(x) - 1", "expm1(x)"),
            _ => continue,
        };
        let Some(span) = graph.origin(id).span.filter(own) else { continue };
        let message = format!("`{written}` is computed as `{computed}`: its digits would cancel where x is near 0");
        out.push(Diagnostic::remark("N0685", message).at(span, "here"));
    }
}

fn about(scene: &FieldScene, found: &Survey, diagnostic: Diagnostic, label: &str) -> Diagnostic {
    match scene.media[found.medium].span {
        Some(span) => diagnostic.at(span, label),
        None => diagnostic,
    }
}

fn point(p: Vec3, metre: f64) -> String {
    let [x, y, z] = p.map(|v| v * metre);
    format!("({x:.4}, {y:.4}, {z:.4}) m")
}

fn negative(scene: &FieldScene, found: &Survey, out: &mut Diagnostics) {
    let (metre, name) = (scene.units.length, &scene.media[found.medium].name);
    for (field, (least, count)) in ["k_a", "k_s", "k_e"].iter().zip(found.least.iter().zip(found.negative)) {
        let (Some(least), true) = (least, count > 0) else { continue };
        let (value, place) = (least.value / metre, point(least.place, metre));
        let places = found.places;
        let unit = if *field == "k_e" { "lx/m" } else { "/m" };
        let message = format!("`{field}` of medium `{name}` is negative: {value:.4} {unit} at {place}");
        let diagnostic = Diagnostic::warning("W0680", message)
            .note(format!("so it is at {count} of the {places} places that were looked at"))
            .hint(format!("clamp it: `{field} = max(0, …)`"));
        out.push(about(scene, found, diagnostic, "this medium"));
    }
}

fn empty(program: &Program, found: &Survey, (params, grids): (&[Vec<f64>], &Grids), out: &mut Diagnostics) {
    let nothing = Nothing { accuracy: 0.0, white: 0.0, paths: false };
    let proven = program.parts().all(|part| {
        let own = part.plan.bounds.iter().find(|b| b.medium as usize == found.medium);
        own.is_some_and(|b| Bricks::new(&part.optimised, b, (params, 0.0), grids, nothing).occupied() == 0.0)
    });
    if proven {
        let name = &program.lowered.media[found.medium].name;
        let diagnostic =
            Diagnostic::warning("W0681", format!("medium `{name}` is empty: its coefficients are 0 everywhere"))
                .hint("look at the thresholds in its density, and at where its shape is");
        out.push(about(&program.lowered, found, diagnostic, "nothing of this is seen"));
    }
}

fn dense(scene: &FieldScene, found: &Survey, out: &mut Diagnostics) {
    let median = found.depths[found.depths.len() / 2];
    if median > OPAQUE {
        let name = &scene.media[found.medium].name;
        let message = format!(
            "nothing is seen through medium `{name}`: half of all lines through it are of optical depth {median:.0} and more"
        );
        let diagnostic = Diagnostic::remark("N0682", message).hint(
            "if it should be translucent, give it smaller coefficients, or write them as `opacity(a, per: length)`",
        );
        out.push(about(scene, found, diagnostic, "only its surface shows"));
    }
}

fn roomy(scene: &FieldScene, found: &Survey, out: &mut Diagnostics) {
    let (filled, (most, least)) = (found.filled(), ROOMY);
    let Some([low, high]) = found.suggested(scene.units.length) else { return };
    if filled > 1.0 - most || found.occupied < least {
        return;
    }
    let name = &scene.media[found.medium].name;
    let message = format!("what is in medium `{name}` fills {:.1} % of the box around its shape", 100.0 * filled);
    let corner = |p: Vec3| format!("({:.3}, {:.3}, {:.3}) m", p[0], p[1], p[2]);
    let diagnostic = Diagnostic::remark("N0683", message)
        .note("empty space is leapt over where bounds of the fields are known, and stepped through where not")
        .hint(format!("all that was found lies in `box(min: {}, max: {})`", corner(low), corner(high)));
    out.push(about(scene, found, diagnostic, "this shape is far larger"));
}

/// Steps of a number that is asked for, and bands of values that they may pass over.
fn overstepped(scene: &FieldScene, found: &Survey, steps: u32, params: &[Vec<f64>], out: &mut Diagnostics) {
    let medium = &scene.media[found.medium];
    let [low, high] = found.shape;
    let step = length(sub(high, low)) / f64::from(steps.max(1));
    let mut graph = scene.graph.clone();
    let roots = [medium.k_a, medium.k_s, medium.k_e];
    let all = narrow(&mut graph, &mut |graph, op| graph.push(op), &roots);
    let reach = low.iter().chain(&high).fold(0.0f64, |m, v| m.max(v.abs()));
    let known =
        Known { position: Interval::new(-reach, reach), time: Interval::point(0.0), params, ..Known::default() };
    let slopes = lipschitz_of(&graph, &known, &[]);
    let ways = all.iter().flat_map(|n| {
        let slope = slopes[n.argument.0 as usize];
        n.bands.iter().map(move |(from, to)| (to - from) / slope)
    });
    let finest = ways.filter(|w| *w > 0.0).fold(f64::INFINITY, f64::min);
    if finest < step {
        let metre = scene.units.length;
        let (name, needed) = (&medium.name, (f64::from(steps) * step / finest).ceil());
        let message = format!(
            "steps of up to {:.2e} m pass over what is {:.2e} m wide in medium `{name}`",
            step * metre,
            finest * metre
        );
        let diagnostic = Diagnostic::warning("W0684", message)
            .hint(format!("leave `steps` out, so that `accuracy` finds it; or ask for {needed:.0} of them"));
        out.push(about(scene, found, diagnostic, "something narrow is in it"));
    }
}
