//! Backends: field graph and facts in, kernels and a plan out. None imports another.

pub mod raymarch;
pub mod slicing;
pub mod splatting;

use crate::Options;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{Backend, FieldScene};
use crate::program::{Ledger, Plan, kernel::Kernel};

/// Says of splats of files that a backend does not draw them.
fn refuse_splats(scene: &FieldScene, backend: &str, diagnostics: &mut Diagnostics) {
    let Some(splats) = scene.splats.first() else { return };
    let diagnostic = Diagnostic::error("E0530", format!("{backend} cannot draw the splats `{}`", splats.name))
        .note(
            "splats of files can be drawn by: splatting, with all media that have a closed form to infinity or an end",
        )
        .hint("use `backend = splatting`, or `auto`");
    diagnostics.push(match splats.span {
        Some(span) => diagnostic.at(span, "these splats"),
        None => diagnostic,
    });
}

/// What a backend makes of a scene. It may add nodes to the scene that its plan names.
pub type Build = fn(&mut FieldScene, &Options, &mut Ledger, &mut Diagnostics) -> Option<(Vec<Kernel>, Plan)>;

/// Every backend, by the word of the language. Adding one is a line here.
pub const REGISTRY: [(Backend, &str, Build); 3] = [
    (Backend::Raymarch, "raymarch", raymarch::build),
    (Backend::Slicing, "slicing", slicing::build),
    (Backend::Splatting, "splatting", splatting::build),
];
