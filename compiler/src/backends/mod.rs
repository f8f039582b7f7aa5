//! Backends: field graph and facts in, kernels and a plan out. None imports another.

mod forecast;
pub mod raymarch;
pub mod slicing;
pub mod splatting;

use crate::Options;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{Backend, Composite, FieldScene, Projection};
use crate::program::{Ledger, Plan, RaySource, kernel::Kernel};
use crate::transport::{endless, is_multiple};

pub use forecast::{Rates, choose, field_weight, forecasts, settle};

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

/// Says what a backend cannot do that the ray marcher can.
fn cannot(backend: &str, what: &str, word: &str) -> Diagnostic {
    Diagnostic::error("E0530", format!("{backend} cannot {what}"))
        .note(format!("{word} can be drawn by: raymarch"))
        .hint("use `backend = raymarch`, or `auto`")
}

/// Refuses what pieces across the view, which fill a bounded part of space, cannot show.
fn refuse_across_the_view(
    scene: &FieldScene,
    options: &Options,
    (backend, pieces): (&str, &str),
    diagnostics: &mut Diagnostics,
) {
    if options.rays == RaySource::Camera && scene.camera.projection == Projection::Panorama {
        let what = format!("draw a panorama: {pieces} do not cross a view all around");
        diagnostics.push(cannot(backend, &what, "`projection = panorama`"));
    }
    match scene.render.composite {
        Composite::Radiance => {}
        Composite::Maximum | Composite::Minimum | Composite::Average | Composite::Isosurface(_) => {
            diagnostics.push(cannot(backend, "project data", "`composite`"));
        }
    }
    for medium in endless(scene) {
        let what = format!("draw `{}`, which has no end", medium.name);
        let diagnostic = cannot(backend, &what, "a medium without end");
        diagnostics.push(match medium.span {
            Some(span) => diagnostic.at(span, "this medium"),
            None => diagnostic,
        });
    }
    if is_multiple(scene) {
        diagnostics.push(cannot(backend, "follow light from scattering to scattering", "`scattering = multiple`"));
    }
}

/// What a backend makes of a scene. It may add nodes to the scene that its plan names.
pub type Build = fn(&mut FieldScene, &Options, &mut Ledger, &mut Diagnostics) -> Option<(Vec<Kernel>, Plan)>;

/// Says what of an optimised scene a backend cannot draw.
pub type Refuse = fn(&FieldScene, &Options, &mut Diagnostics);

/// A backend.
#[derive(Copy, Clone, Debug)]
pub struct Entry {
    /// Which.
    pub backend: Backend,
    /// Its word in the language.
    pub word: &'static str,
    /// Makes kernels and a plan.
    pub build: Build,
    /// Says why it could not.
    pub refuse: Refuse,
    /// What it takes and what it leaves, as `cargo bench --bench forecast` measured it.
    pub rates: Rates,
}

/// Every backend. Adding one is an entry here.
pub const REGISTRY: [Entry; 3] = [
    Entry {
        backend: Backend::Raymarch,
        word: "raymarch",
        build: raymarch::build,
        refuse: raymarch::refuse,
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
        refuse: slicing::refuse,
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
        refuse: splatting::refuse,
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
