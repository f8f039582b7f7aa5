//! What slabs that are lit one after another cannot show: light that does not come from one place.

use crate::Options;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{FieldScene, LightKind, Scattering};
use crate::program::Precision;

/// Says why `stacks = half_angle` cannot draw a scene.
pub(super) fn refuse(scene: &FieldScene, options: &Options, diagnostics: &mut Diagnostics) {
    let mut say = |what: String, span| {
        let diagnostic = Diagnostic::error("E0531", format!("`stacks = half_angle` {what}"));
        let diagnostic = match span {
            Some(span) => diagnostic.at(span, "this one"),
            None => diagnostic,
        };
        diagnostics.push(
            diagnostic
                .note("its planes stand across half the angle between the view and one light, which shines from one place")
                .hint("use `stacks = view`, which draws any light"),
        );
    };
    match scene.lights.as_slice() {
        [] => say("follows one light, and the scene has none".into(), None),
        [light] => match light.kind {
            LightKind::Directional { angular_diameter: None, .. } | LightKind::Point { .. } => {}
            LightKind::Directional { angular_diameter: Some(_), .. } => {
                say(format!("follows light from one direction, and `{}` has a disc", light.name), light.span);
            }
        },
        [_, second, ..] => {
            say(format!("follows one light, and the scene has {}", scene.lights.len()), second.span);
        }
    }
    if scene.environment {
        say("follows one light, and the environment shines from everywhere".into(), None);
    }
    if scene.render.scattering == Scattering::None && !scene.lights.is_empty() {
        say("follows light that media scatter, and none scatters any".into(), None);
    }
    if options.blending == Precision::Half {
        say("adds up optical depths in f32, and this adapter blends f16 alone".into(), None);
    }
}
