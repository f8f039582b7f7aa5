//! Splatting: the media become Gaussians on a lattice, which are drawn as billboards across the view and blended, farthest
//! first (Westover 1990; Zwicker et al. 2001). What a Gaussian sends and lets through along a ray is its exact line integral
//! σ·√(2π)·s·exp(−d²/2s²), not a cap per splat.
//!
//! On nodes xᵢ with spacing h, coefficients are spread by Gaussians of deviation s = κ·h with peaks f(xᵢ)/(κ√(2π))³: the
//! quasi-interpolation of Maz'ya and Schmidt ("Approximate Approximations", 2007), of second order in h on smooth fields down
//! to a ripple of 6·e^(−2π²κ²). A node holds the mean over one spacing along the view, so that a boundary takes its share.
//!
//! Passes: `plant` finds what is at the nodes, `doubt` how wrong that may be, and `rank` their keys, which are sorted on the device
//! (`sort`), once for each picture; then, for each tile, `aim`, `corner` and `splat`, and
//! `resolve`, as in slicing. Emission is composed Gaussian by Gaussian in the order of their centres, as if each were thin.
//!
//! Where a scene has splats of files, those are what is drawn (`files`), and media between them are integrated.

mod doubt;
mod files;
mod lists;
mod sort;
mod splat;
mod veil;

use crate::Options;
use crate::diagnostic::Diagnostics;
use crate::fields::KernelBuilder;
use crate::ir::{FieldScene, Stacks};
use crate::program::kernel::{Kernel, Stage};
use crate::program::{Geometry, Ledger, OutputKind, Pass, Plan, PlantPass, Precision, StepRule};
use crate::transport::aim::{self, Aimed, Rays};
use crate::transport::layers::Layers;
use crate::transport::{Scene, Tracer, records, resolve};

/// Kernels and plan of a scene.
pub(super) fn build(
    scene: &mut FieldScene,
    options: &Options,
    ledger: &mut Ledger,
    diagnostics: &mut Diagnostics,
) -> Option<(Vec<Kernel>, Plan)> {
    if !scene.splats.is_empty() {
        return files::build(scene, options, ledger, diagnostics);
    }
    refuse(scene, options, diagnostics);
    let seen = Scene::new(scene, ledger, diagnostics);
    if diagnostics.has_errors() {
        return None;
    }
    let rule = StepRule::Splats { count: scene.render.splats, accuracy: scene.render.accuracy };
    let aa = options.aa.unwrap_or(scene.image.aa);
    let samples = records::samples(aa, options.rays, ledger);
    ledger.omit("division of pixels at edges", "Gaussians have none", None);
    let rays = Rays::new(samples, false);
    let mut builder = KernelBuilder::default();
    // What goes wrong at a node has no pixel to be told in.
    let told =
        |kind: &OutputKind| matches!(kind, OutputKind::Radiance | OutputKind::Transmittance | OutputKind::OpticalDepth);
    let wanted = options.outputs.iter().copied().filter(told).collect();
    let pieces = Tracer::new(scene, &seen, &mut builder, rule, wanted).write_slabs(ledger);
    let (outputs, stride) = records::layout(&pieces.whole.fields, false);
    let layers = Layers::new(&pieces, Precision::Single, false);
    let splats = doubt::stride(&pieces);
    let plant = splat::plant(scene, &mut builder, &pieces, options.rays);
    let doubt = doubt::entry(scene, &mut builder, &pieces, options.rays);
    let rank = splat::rank(scene, &mut builder, &pieces, options.rays);
    let aim = aim::entry(scene, &mut builder, &seen, &pieces, options.rays, (rays, Aimed::Planes(Stacks::View)));
    let (corner, splat) = splat::entries(scene, &mut builder, &pieces, &layers, options.rays);
    let resolve = resolve::entry(&mut builder, &pieces, &layers, (options.rays, rays, false), (stride, None));
    let (extent, group) = records::extent(options.rays);
    let mut entries = vec![
        ("plant", Stage::Compute([64, 1, 1]), plant),
        ("doubt", Stage::Compute([64, 1, 1]), doubt),
        ("aim", Stage::Compute(group), aim),
        ("corner", Stage::Vertex, corner),
        ("splat", Stage::Fragment, splat),
        ("resolve", Stage::Compute(group), resolve),
    ];
    entries.push(("rank", Stage::Compute([64, 1, 1]), rank));
    entries.push(("drawn", Stage::Compute([1, 1, 1]), sort::drawn(&mut builder)));
    let sort = sort::add(&mut builder, &mut entries, 1);
    let fill = records::add_fill(&mut entries, pieces.fill);
    let (kernels, bindings, uniforms) = builder.finish(entries);
    let plan = Plan {
        backend: "splatting",
        rays: options.rays,
        outputs,
        stride,
        bindings,
        uniforms,
        passes: vec![
            Pass::Compute { kernel: 2, extent },
            Pass::Raster { vertex: 3, fragment: 4, geometry: Geometry::Billboards },
            Pass::Compute { kernel: 5, extent },
        ],
        targets: layers.targets,
        light: None,
        notes: aim::NOTES,
        repeats: rays.count(),
        steps: rule,
        fill,
        bounds: vec![],
        plant: Some(PlantPass { kernel: 0, doubt: 1, stride: splats, rank: 6, sort, drawn: 7 }),
        footprints: None,
        carried: 0,
        survey: None,
        samples,
        work_per_ray: 4096,
    };
    Some((kernels, plan))
}

/// What billboards, or media among splats of files, cannot show.
pub(super) fn refuse(scene: &FieldScene, options: &Options, diagnostics: &mut Diagnostics) {
    if scene.splats.is_empty() {
        super::refuse_across_the_view(scene, options, ("splatting", "billboards"), diagnostics);
    } else {
        files::refuse(scene, diagnostics);
    }
}
