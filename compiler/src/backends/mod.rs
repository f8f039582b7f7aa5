//! Backends: field graph and facts in, kernels and a plan out. None imports another.

mod forecast;
pub mod raymarch;
pub mod slicing;
pub mod splatting;

use crate::Options;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{Backend, FieldScene};
use crate::program::{Ledger, Plan, kernel::Kernel};

pub use forecast::{Rates, choose, field_weight, forecasts, settle};

/// The message of the first finding.
fn reason(found: &Diagnostics) -> Option<String> {
    found.iter().next().map(|d| d.message.clone())
}

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

/// Why a backend cannot draw an optimised scene, in a sentence.
pub type Refusal = fn(&FieldScene, &Options) -> Option<String>;

/// A backend.
#[derive(Copy, Clone, Debug)]
pub struct Entry {
    /// Which.
    pub backend: Backend,
    /// Its word in the language.
    pub word: &'static str,
    /// Makes kernels and a plan.
    pub build: Build,
    /// Says whether it could.
    pub refusal: Refusal,
    /// What it takes and what it leaves, as `cargo bench --bench forecast` measured it.
    pub rates: Rates,
}

/// Every backend. Adding one is an entry here.
pub const REGISTRY: [Entry; 3] = [
    Entry {
        backend: Backend::Raymarch,
        word: "raymarch",
        build: raymarch::build,
        refusal: raymarch::refusal,
        rates: Rates {
            ray: 420.0,
            piece: 30.0,
            looks: true,
            node: 0.0,
            seen: 0.0,
            redrawn: 1.0,
            first: 5.8,
            order: 1.6,
            most: 65_535.0,
        },
    },
    Entry {
        backend: Backend::Slicing,
        word: "slicing",
        build: slicing::build,
        refusal: slicing::refusal,
        rates: Rates {
            ray: 740.0,
            piece: 31.0,
            looks: true,
            node: 0.0,
            seen: 0.0,
            redrawn: 1.5,
            first: 214.0,
            order: 1.9,
            most: 16_384.0,
        },
    },
    Entry {
        backend: Backend::Splatting,
        word: "splatting",
        build: splatting::build,
        refusal: splatting::refusal,
        rates: Rates {
            ray: 300.0,
            piece: 5.0,
            looks: false,
            node: 1500.0,
            seen: 50.0,
            redrawn: 1.3,
            first: 1.4,
            order: 0.2,
            most: 256.0,
        },
    },
];
