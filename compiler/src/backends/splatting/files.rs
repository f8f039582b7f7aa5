//! Splats of files: what the runtime projects, put in order and into lists on the device, and blended in each pixel with the media between them.
//!
//! A splat is a thin layer where the ray is abreast of its centre. A pixel goes through the list of its tile from the farthest to
//! the nearest, with what the surface or the sky behind sends; the stretch of the media between two of them acts on radiances
//! as everywhere, and the splat on encoded numbers or on radiances, as its scene says. So the order of layers is that of the
//! picture, the media between them are integrated and not sampled once, and blending knows no threshold.
//!
//! Passes: those of `sort` and `lists`, once for each picture; then `aim` finds the rays, and `blend` goes along them.

use super::{lists, sort, veil};
use crate::Options;
use crate::backends::cannot;
use crate::diagnostic::Diagnostics;
use crate::fields::KernelBuilder;
use crate::ir::{FieldScene, Projection};
use crate::program::kernel::{Kernel, Stage};
use crate::program::{FootprintLayout, FootprintShape, Ledger, OutputKind, Pass, Plan, RaySource, StepRule};
use crate::transport::aim::{self, Aimed, Rays};
use crate::transport::{Scene, Tracer, records};

/// Entries of a list that a dispatch goes through, where all media have closed forms.
const CLOSED: u32 = 16384;
/// The same where they are stepped through.
const STEPPED: u32 = 256;

/// What cannot stand beside splats of files.
pub(super) fn refuse(scene: &FieldScene, diagnostics: &mut Diagnostics) {
    if scene.render.splats.is_some() {
        diagnostics.push(cannot(
            "splatting",
            "make Gaussians of media beside splats of files: it integrates media there",
            "`splats` beside an item of splats",
        ));
    }
}

/// Kernels and plan of a scene with splats of files.
pub(super) fn build(
    scene: &mut FieldScene,
    options: &Options,
    ledger: &mut Ledger,
    diagnostics: &mut Diagnostics,
) -> Option<(Vec<Kernel>, Plan)> {
    let seen = Scene::new(scene, ledger, diagnostics);
    seen.refuse_endless(scene, diagnostics);
    refuse(scene, diagnostics);
    if diagnostics.has_errors() {
        return None;
    }
    let rule = StepRule::along_rays(&scene.render, seen.closed);
    if seen.closed {
        ledger.omit("loop over steps", "every coefficient has a closed form along a ray", None);
    }
    ledger.omit("lattice of splats", "media between splats of files are integrated", None);
    let aa = options.aa.unwrap_or(scene.image.aa);
    let samples = records::samples(aa, options.rays, ledger);
    let divided = records::divides(aa, options.rays, seen.primitives(), ledger);
    let rays = Rays::new(samples, divided);
    let mut builder = KernelBuilder::default();
    let tracer = Tracer::new(scene, &seen, &mut builder, rule, records::wanted(&options.outputs));
    let pieces = tracer.write_slabs(ledger);
    let shape = match (options.rays, scene.camera.projection) {
        (RaySource::List, _) => FootprintShape::Ray,
        (RaySource::Camera, Projection::Perspective { .. } | Projection::Orthographic { .. }) => FootprintShape::Plane,
        (RaySource::Camera, Projection::Panorama) => FootprintShape::Around,
    };
    // Where media are stepped through, each entry may take many rounds of loops, of which drivers count all.
    let round = if seen.closed { CLOSED } else { STEPPED };
    let stride = shape.head() + scene.bands.wavelengths.len() as u32;
    let edge = divided && options.outputs.contains(&OutputKind::Edge);
    let fields = veil::fields(&pieces, edge);
    let (outputs, record) = records::layout(&fields, false);
    let aim = aim::entry(scene, &mut builder, &seen, &pieces, options.rays, (rays, Aimed::Point));
    let footprint = (shape, stride, round);
    let (blend, carried) = veil::entry(scene, &mut builder, &pieces, footprint, (rays, record), (&fields, ledger));
    let (extent, group) = records::extent(options.rays);
    let mut entries = vec![("aim", Stage::Compute(group), aim), ("blend", Stage::Compute(group), blend)];
    // Depths in f64 are two words.
    let sort = sort::add(&mut builder, &mut entries, 2);
    let lists = lists::add(&mut builder, &mut entries);
    let fill = records::add_fill(&mut entries, pieces.fill);
    let (kernels, bindings, uniforms) = builder.finish(entries);
    let plan = Plan {
        backend: "splatting",
        rays: options.rays,
        outputs,
        stride: record,
        bindings,
        uniforms,
        passes: vec![Pass::Compute { kernel: 0, extent }, Pass::Rounds { kernel: 1, extent }],
        targets: vec![],
        light: None,
        notes: aim::NOTES,
        repeats: rays.count(),
        steps: rule,
        fill,
        plant: None,
        footprints: Some(FootprintLayout { shape, stride, round, sort, lists }),
        carried,
        bounds: vec![],
        survey: None,
        samples,
        work_per_ray: 512,
    };
    Some((kernels, plan))
}
