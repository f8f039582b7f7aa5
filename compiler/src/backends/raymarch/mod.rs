//! Raymarching: one ray per sample, front to back.

mod matter;
mod rays;
mod shapes;
mod trace;

use crate::Options;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::fields::{Code, KernelBuilder};
use crate::ir::{Aa, Composite, FieldScene};
use crate::program::kernel::{BinaryOp, Expr, Kernel, LocalId, Ty};
use crate::program::{Extent, FrameValue, Ledger, Output, OutputKind, Pass, Plan, RaySource, StepRule};

/// The name of an output in the shader.
fn output_name(kind: OutputKind) -> &'static str {
    match kind {
        OutputKind::Radiance => "radiance",
        OutputKind::Transmittance => "transmittance",
        OutputKind::OpticalDepth => "optical_depth",
        OutputKind::Error => "error",
        OutputKind::Evaluations => "evaluations",
        OutputKind::Fault => "fault",
        OutputKind::Edge => "edge",
    }
}

/// Kernel and plan of a scene.
pub(super) fn build(
    scene: &mut FieldScene,
    options: &Options,
    ledger: &mut Ledger,
    diagnostics: &mut Diagnostics,
) -> Option<(Vec<Kernel>, Plan)> {
    let seen = matter::Scene::new(scene, ledger);
    endless(scene, &seen, diagnostics);
    if diagnostics.has_errors() {
        return None;
    }
    let steps = options.steps.or(if options.accuracy.is_some() { None } else { scene.render.steps });
    let accuracy = options.accuracy.unwrap_or(scene.render.accuracy);
    let rule = match steps {
        _ if seen.closed => StepRule::Closed,
        Some(n) => StepRule::Fixed(n),
        None => StepRule::Adaptive(accuracy),
    };
    if seen.closed && scene.render.composite == Composite::Radiance {
        ledger.omit("loop over steps", "every coefficient has a closed form along a ray", None);
    }
    let mut wanted = options.outputs.clone();
    if !wanted.contains(&OutputKind::Fault) {
        wanted.push(OutputKind::Fault);
    }
    wanted.sort_unstable();
    wanted.dedup();
    let samples = samples(options.aa.unwrap_or(scene.image.aa), options.rays, ledger);
    let mut builder = KernelBuilder::default();
    let tracer = trace::Tracer {
        graph: &scene.graph,
        scene: &seen,
        builder: &mut builder,
        spans: shapes::SpanFunctions::default(),
        rule,
        wanted,
        max_work: scene.render.max_work,
        shells: scene.shells.clone(),
    };
    let traced = tracer.write(ledger);
    let mut outputs = vec![];
    let mut stride = 0;
    for (kind, width) in &traced.fields {
        outputs.push(Output { kind: *kind, offset: stride, width: *width });
        stride += u32::from(*width);
    }
    let (entry, workgroup, extent) = match options.rays {
        RaySource::Camera => (camera_entry(scene, &mut builder, &traced, stride, samples), [8, 8, 1], Extent::Tile),
        RaySource::List => (list_entry(&mut builder, &traced, stride), [64, 1, 1], Extent::Rays),
    };
    let name = match options.rays {
        RaySource::Camera => "draw",
        RaySource::List => "probe",
    };
    let (kernel, bindings, uniforms) = builder.finish(name, workgroup, entry);
    let work_per_ray = match rule {
        StepRule::Closed => 1,
        StepRule::Fixed(n) => n,
        StepRule::Adaptive(_) => 512,
    };
    let plan = Plan {
        backend: "raymarch",
        rays: options.rays,
        outputs,
        stride,
        bindings,
        uniforms,
        passes: vec![Pass { kernel: 0, extent }],
        steps: rule,
        samples,
        work_per_ray: work_per_ray * samples,
    };
    Some((vec![kernel], plan))
}

/// A ray that never leaves a medium needs a closed form to infinity.
fn endless(scene: &FieldScene, seen: &matter::Scene, diagnostics: &mut Diagnostics) {
    for m in seen.matter.iter().filter(|m| m.region.is_unbounded(&seen.primitives)) {
        let at = |d: Diagnostic| match m.span {
            Some(span) => d.at(span, "this medium has no end"),
            None => d,
        };
        let hint = "give it a shape, for example `shape = sphere(center: (0,0,0) m, radius: 10 m)`";
        if m.varying && !seen.closed && !bounded_sdf(&m.region, &seen.primitives) {
            diagnostics.push(
                at(Diagnostic::error(
                    "E0510",
                    format!("`{}` reaches to infinity, and its integral along a ray has no closed form", m.name),
                ))
                .note("uniform and exponential coefficients can be integrated to infinity; other fields cannot")
                .hint(hint),
            );
        }
        if m.extinction.is_none() && m.emission.is_some() {
            diagnostics.push(
                at(Diagnostic::error(
                    "E0511",
                    format!("`{}` shines without end and absorbs nothing: its radiance is infinite", m.name),
                ))
                .hint("give it a k_a")
                .hint(hint),
            );
        }
    }
    let _ = scene;
}

/// A signed distance field may bound a medium although no box is known: tracing finds its far side, or that there is none.
fn bounded_sdf(region: &shapes::Region, primitives: &[crate::ir::Primitive]) -> bool {
    use shapes::Region;
    match region {
        Region::Leaf(i) => matches!(primitives[*i].kind, crate::ir::PrimitiveKind::Sdf { .. }),
        Region::Everywhere => false,
        Region::Union(parts) => parts.iter().all(|r| !r.is_unbounded(primitives) || bounded_sdf(r, primitives)),
        Region::Intersection(parts) => parts.iter().any(|r| bounded_sdf(r, primitives)),
        Region::Difference(first, _) => bounded_sdf(first, primitives),
    }
}

fn samples(aa: Aa, rays: RaySource, ledger: &mut Ledger) -> u32 {
    match (rays, aa) {
        (RaySource::List, _) => 1,
        (RaySource::Camera, Aa::Ssaa(n)) if n > 1 => n,
        (RaySource::Camera, _) => {
            ledger.omit("loop over samples of a pixel", "one ray per pixel is asked for", None);
            1
        }
    }
}

/// Stores a traced ray in its record.
fn store(
    builder: &mut KernelBuilder,
    code: &mut Code,
    traced: &trace::Traced,
    values: &[Expr],
    record: &Expr,
    stride: u32,
) {
    let records = builder.records();
    let base = code.bind("base", Ty::U32, record.clone() * stride);
    let mut offset = 0u32;
    for ((_, width), value) in traced.fields.iter().zip(values) {
        for i in 0..*width {
            let part = if *width == 1 { value.clone() } else { value.clone().component(i) };
            code.store(records, base.clone() + offset, part);
            offset += 1;
        }
    }
}

fn result_type(builder: &KernelBuilder, traced: &trace::Traced) -> Ty {
    builder.result_of(traced.function)
}

fn camera_entry(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    traced: &trace::Traced,
    stride: u32,
    samples: u32,
) -> crate::program::kernel::Function {
    let mut code = Code::new("draw", None);
    let tile = builder.frame(FrameValue::TileSize);
    let column = code.bind("column", Ty::U32, Expr::GlobalId.component(0));
    let row = code.bind("row", Ty::U32, Expr::GlobalId.component(1));
    let outside = column.clone().greater_equal(tile.clone().component(0));
    let outside = outside.or(row.clone().greater_equal(tile.clone().component(1)));
    code.if_(outside, Code::return_nothing);
    let origin = builder.frame(FrameValue::TileOrigin);
    let prim = crate::program::kernel::Prim::F32;
    let x = code.bind("x", Ty::F32, (origin.clone().component(0) + column.clone()).convert(prim));
    let y = code.bind("y", Ty::F32, (origin.component(1) + row.clone()).convert(prim));
    let record = code.bind("record", Ty::U32, row * tile.component(0) + column);
    let projection = scene.camera.projection;
    let result = result_type(builder, traced);
    if samples == 1 {
        let start = rays::camera(builder, &mut code, projection, x + 0.5, y + 0.5);
        let traced_ray = code.bind("traced", result, rays::call(traced.function, &start));
        let values: Vec<Expr> = (0..traced.fields.len() as u32).map(|i| traced_ray.clone().field(i)).collect();
        store(builder, &mut code, traced, &values, &record, stride);
        return code.finish(None);
    }
    // Means over the samples; of what went wrong, the first.
    let sums: Vec<LocalId> = traced
        .fields
        .iter()
        .map(|(kind, width)| code.var(output_name(*kind), Ty::float(*width), Expr::F32(0.0).splat(*width)))
        .collect();
    let index = code.var("sample", Ty::F32, 0.0);
    code.open();
    code.break_if(Expr::Local(index).greater_equal(f64::from(samples)));
    let (dx, dy) = rays::sample_offset(&mut code, index.into(), samples);
    let start = rays::camera(builder, &mut code, projection, x + dx, y + dy);
    let traced_ray = code.bind("traced", result, rays::call(traced.function, &start));
    for (i, ((kind, _), sum)) in traced.fields.iter().zip(&sums).enumerate() {
        let value = traced_ray.clone().field(i as u32);
        if *kind == OutputKind::Fault {
            let none = Expr::Local(*sum).component(0).bitcast(crate::program::kernel::Prim::U32);
            let none = Expr::binary(BinaryOp::Equal, none, 0u32);
            code.set(*sum, none.select(value, *sum));
        } else {
            code.add(*sum, value);
        }
    }
    code.add(index, 1.0);
    let block = code.close();
    code.push_loop(block);
    let values: Vec<Expr> = traced
        .fields
        .iter()
        .zip(&sums)
        .map(|((kind, width), sum)| match kind {
            OutputKind::Fault | OutputKind::Evaluations => Expr::Local(*sum),
            _ => Expr::Local(*sum) * Expr::F32(1.0 / f64::from(samples)).splat(*width),
        })
        .collect();
    store(builder, &mut code, traced, &values, &record, stride);
    code.finish(None)
}

fn list_entry(builder: &mut KernelBuilder, traced: &trace::Traced, stride: u32) -> crate::program::kernel::Function {
    let mut code = Code::new("probe", None);
    let index = code.bind("index", Ty::U32, Expr::GlobalId.component(0));
    let count = builder.frame(FrameValue::RayCount);
    code.if_(index.clone().greater_equal(count), Code::return_nothing);
    let start = rays::list(builder, &mut code, &index);
    let result = result_type(builder, traced);
    let traced_ray = code.bind("traced", result, rays::call(traced.function, &start));
    let values: Vec<Expr> = (0..traced.fields.len() as u32).map(|i| traced_ray.clone().field(i)).collect();
    store(builder, &mut code, traced, &values, &index, stride);
    code.finish(None)
}
