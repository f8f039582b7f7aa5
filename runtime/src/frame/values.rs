//! Values of a frame that no engine can draw with: what depends on params and time alone is looked at before anything is drawn.

use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{FieldScene, NodeId, Tier};
use compiler::source::Span;

/// An albedo above this is above 1 by more than rounding.
pub(crate) const GAIN: f64 = 1.0 + 1e-9;
/// What to do about that.
pub(crate) const AT_MOST_ONE: &str = "no surface reflects more than it gets: `albedo = min(1, …)`";

/// The f32 nearest to a number. What f32 cannot hold becomes the largest it can, so that a coefficient of 1e40 is opaque
/// rather than a fault, and light of 1e40 lx is shown; what has no finite value stays so and is found by whoever looks.
pub(crate) fn to_f32(x: f64) -> f32 {
    if x.is_finite() { (x as f32).clamp(f32::MIN, f32::MAX) } else { x as f32 }
}

/// The first coefficient, albedo or emission that is the same everywhere and is negative, not finite, or gains energy.
///
/// # Errors
/// `E0650`, `E0651`, `E0657`.
pub(super) fn check(scene: &FieldScene, params: &[Vec<f64>], time: f64) -> Result<(), Diagnostic> {
    let tiers = scene.graph.tiers();
    let at = |owner: String, span: Option<Span>, fields: &[(&'static str, NodeId)]| {
        let fields = fields.iter().filter(|(_, n)| tiers[n.0 as usize] <= Tier::Frame);
        let mut all = vec![];
        for (field, node) in fields {
            all.push((owner.clone(), scene.graph.origin(*node).span.or(span), *field, *node));
        }
        all
    };
    let media = scene
        .media
        .iter()
        .map(|m| at(format!("medium `{}`", m.name), m.span, &[("k_a", m.k_a), ("k_s", m.k_s), ("k_e", m.k_e)]));
    let surfaces = scene.surfaces.iter().map(|s| at(format!("surface `{}`", s.name), s.span, &[("albedo", s.albedo)]));
    let all: Vec<_> = media.chain(surfaces).flatten().collect();
    let nodes: Vec<NodeId> = all.iter().map(|(_, _, _, node)| *node).collect();
    let values = evaluate_frame(&scene.graph, &nodes, params, time);
    for ((owner, span, field, _), bands) in all.into_iter().zip(values) {
        // In the graph's units the size of a coefficient means little, but its sign and its being finite do.
        let found = bands.iter().find_map(|v| {
            let (code, what, hint) = match v {
                v if !v.is_finite() => ("E0651", "not finite", "look for a division by zero or an overflow in it"),
                v if *v < 0.0 => ("E0650", "negative", "put `max(0, …)` around it, or keep an `albedo` below 1"),
                v if field == "albedo" && *v > GAIN => ("E0657", "above 1", AT_MOST_ONE),
                _ => return None,
            };
            Some(Diagnostic::error(code, format!("`{field}` of {owner} is {what} everywhere")).hint(hint))
        });
        if let Some(diagnostic) = found {
            return Err(match span {
                Some(span) => diagnostic.at(span, "with these values of the params"),
                None => diagnostic,
            });
        }
    }
    Ok(())
}
