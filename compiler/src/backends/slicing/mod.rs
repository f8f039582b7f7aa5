//! Slicing: planes across the view, or across an axis of the media, cut them into slabs, which are drawn as polygons and
//! blended, farthest first (Cullip & Neumann 1993; Wilson et al. 1994; three stacks: Rezk-Salama et al. 2000). What a slab sends and lets through comes from its middle, with the exact
//! exponential over the length that the ray has in it, which grows off the axis of a perspective.
//!
//! Three passes for each tile: `aim` finds the ray of each pixel, where it ends, and where it meets the planes; `outline`
//! and `slice` draw the slabs; `resolve` puts what lies behind the media behind them and writes records. Light is blended
//! per band with the band's own transmittance, in f32; optical depths are summed and never multiplied up as transmittances.
//! Each band fades in the alpha of a target of its own, all in one pass: blending from two sources takes one target at a time
//! on every API beneath, so that depths, errors and faults would need a second pass that evaluates every field again.

mod half;
mod slice;

use crate::Options;
use crate::diagnostic::Diagnostics;
use crate::fields::KernelBuilder;
use crate::ir::{FieldScene, Stacks};
use crate::program::kernel::{Kernel, Stage};
use crate::program::{Draw, FrameValue, Geometry, Ledger, OutputKind, Pass, Plan, Precision, RaySource, StepRule};
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
    refuse(scene, options, diagnostics);
    let mut seen = Scene::new(scene, ledger, diagnostics);
    if diagnostics.has_errors() {
        return None;
    }
    let (mut count, accuracy) = (scene.render.slices, scene.render.accuracy);
    if count.is_none() && seen.closed {
        ledger.omit("more than one slab", "every coefficient has a closed form along a ray", None);
        count = Some(1);
    }
    let rule = StepRule::Slabs { count, accuracy };
    if options.unbounded {
        ledger.omit("bounds of media", "no brick of them is empty or much thinner than others", None);
    } else {
        seen.keep_bounds(scene, rule, ledger);
    }
    let aa = options.aa.unwrap_or(scene.image.aa);
    let samples = records::samples(aa, options.rays, ledger);
    let divided = records::divides(aa, options.rays, seen.primitives(), ledger);
    let rays = Rays::new(samples, divided);
    let mut builder = KernelBuilder::default();
    let mut wanted = records::wanted(&options.outputs);
    let precision = match (options.blending, options.rays) {
        (Precision::Half, RaySource::Camera) => {
            ledger.omit("f32 targets", "the adapter blends f16 alone; what that rounds is in the reported error", None);
            ledger.omit("count of field evaluations", "f16 cannot count beyond 2048", None);
            wanted.retain(|kind| *kind != OutputKind::Evaluations);
            Precision::Half
        }
        (Precision::Single | Precision::Half, _) => Precision::Single,
    };
    let stacks = match options.rays {
        RaySource::Camera => scene.render.stacks,
        // Rays of a list have no common planes.
        RaySource::List => Stacks::View,
    };
    let alternating = stacks == Stacks::HalfAngle;
    let tracer = Tracer::new(scene, &seen, &mut builder, rule, wanted);
    let tracer = if alternating { tracer.along_half_angle() } else { tracer };
    let slabs = tracer.write_slabs(ledger);
    let edge = divided && options.outputs.contains(&OutputKind::Edge);
    let (outputs, stride) = records::layout(&slabs.whole.fields, edge);
    let layers = Layers::new(&slabs, precision, alternating);
    let aim = aim::entry(scene, &mut builder, &seen, &slabs, options.rays, (rays, Aimed::Planes(stacks)));
    let (outline, slice) = slice::entries(&mut builder, &slabs, &layers, stacks);
    let resolve = resolve::entry(
        &mut builder,
        &slabs,
        &layers,
        (options.rays, rays, edge),
        (stride, Some(FrameValue::SlabCount)),
    );
    let (extent, group) = records::extent(options.rays);
    let mut entries = vec![
        ("aim", Stage::Compute(group), aim),
        ("outline", Stage::Vertex, outline),
        ("slice", Stage::Fragment, slice),
        ("resolve", Stage::Compute(group), resolve),
    ];
    let mut light = None;
    if let Some(slabs) = &slabs.light {
        let (outline, lost) = slice::light_entries(&mut builder, slabs);
        let vertex = entries.len() as u32;
        entries.extend([("light_outline", Stage::Vertex, outline), ("light", Stage::Fragment, lost)]);
        light = Some((Draw { vertex, fragment: vertex + 1 }, slabs.buffer.clone()));
    }
    let (draw, buffer) = light.unzip();
    let fill = records::add_fill(&mut entries, slabs.fill);
    let (kernels, bindings, uniforms) = builder.finish(entries);
    let plan = Plan {
        backend: "slicing",
        rays: options.rays,
        outputs,
        stride,
        bindings,
        uniforms,
        passes: vec![
            Pass::Compute { kernel: 0, extent },
            if alternating {
                Pass::Alternate { seen: Draw { vertex: 1, fragment: 2 }, light: draw }
            } else {
                Pass::Raster { vertex: 1, fragment: 2, geometry: Geometry::Outlines }
            },
            Pass::Compute { kernel: 3, extent },
        ],
        targets: layers.targets,
        light: buffer,
        notes: aim::NOTES,
        repeats: rays.count(),
        steps: rule,
        fill,
        plant: None,
        footprints: None,
        carried: 0,
        bounds: seen.bounds,
        survey: None,
        samples,
        work_per_ray: count.unwrap_or(256),
    };
    Some((kernels, plan))
}

/// What slabs cannot show.
pub(super) fn refuse(scene: &FieldScene, options: &Options, diagnostics: &mut Diagnostics) {
    super::refuse_splats(scene, "slicing", diagnostics);
    super::refuse_across_the_view(scene, options, ("slicing", "planes"), diagnostics);
    if options.rays == RaySource::Camera && scene.render.stacks == Stacks::HalfAngle {
        half::refuse(scene, options, diagnostics);
    }
}
