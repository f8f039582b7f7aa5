//! What is not drawn yet, said plainly and where it stands.

use crate::check::hir::Scene;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::Aa;
use crate::syntax::ast::BlockKind;

/// Warnings for the parts of a scene that the picture leaves out.
#[must_use]
pub fn pending(scene: &Scene) -> Diagnostics {
    let mut found = Diagnostics::default();
    for item in &scene.pending {
        let (code, what) = match item.kind {
            BlockKind::Text => ("W0903", "text"),
            BlockKind::Grid
            | BlockKind::Medium
            | BlockKind::Light
            | BlockKind::Surface
            | BlockKind::Splats
            | BlockKind::Fog
            | BlockKind::Style
            | BlockKind::Camera
            | BlockKind::Image
            | BlockKind::Render => continue,
        };
        found.push(
            Diagnostic::warning(code, format!("the {what} `{}` {} not drawn yet", item.name, is(what)))
                .at(item.span, "the picture is as if it were not there"),
        );
    }
    let aa = match scene.image.aa {
        Aa::None | Aa::Analytic | Aa::Ssaa(_) => None,
        Aa::Msaa(n) => Some(format!("msaa({n})")),
        Aa::Fxaa => Some("fxaa".to_owned()),
        Aa::Smaa => Some("smaa".to_owned()),
        Aa::Taa => Some("taa".to_owned()),
    };
    if let Some(name) = aa {
        let mut diagnostic = Diagnostic::warning("W0907", format!("`aa = {name}` is not there yet"))
            .note("the picture is drawn with `aa = analytic`")
            .hint("use `none`, `analytic` or `ssaa(n)`");
        if let Some(span) = scene.image.span {
            diagnostic = diagnostic.at(span, "asked for here");
        }
        found.push(diagnostic);
    }
    found
}

fn is(what: &str) -> &'static str {
    if what.ends_with('s') { "are" } else { "is" }
}
