//! Raymarching: one ray per sample, front to back.

use crate::Options;
use crate::diagnostic::Diagnostics;
use crate::fields::{Code, KernelBuilder};
use crate::ir::{Aa, Composite, FieldScene, Pixels};
use crate::program::kernel::{BinaryOp, Expr, Function, FunctionId, Kernel, LocalId, Prim, Stage, Ty};
use crate::program::{ALONE, FILLED, FrameValue, Ledger, OutputKind, Pass, Plan, RaySource, StepRule};
use crate::transport::records::{self, Pixel, pixel, pixel_of, store};
use crate::transport::{Scene, Traced, Tracer, edges, is_multiple, output_name, rays};

/// Kernel and plan of a scene.
pub(super) fn build(
    scene: &mut FieldScene,
    options: &Options,
    ledger: &mut Ledger,
    diagnostics: &mut Diagnostics,
) -> Option<(Vec<Kernel>, Plan)> {
    refuse(scene, options, diagnostics);
    let mut seen = Scene::new(scene, ledger, diagnostics);
    seen.refuse_endless(scene, diagnostics);
    if diagnostics.has_errors() {
        return None;
    }
    let many = is_multiple(scene);
    let rule =
        if many { StepRule::Paths(scene.render.samples) } else { StepRule::along_rays(&scene.render, seen.closed) };
    if seen.closed && scene.render.composite == Composite::Radiance {
        ledger.omit("loop over steps", "every coefficient has a closed form along a ray", None);
    }
    if options.unbounded {
        ledger.omit("bounds of media", "no brick of them is empty or much thinner than others", None);
    } else {
        seen.keep_bounds(scene, rule, ledger);
    }
    let wanted = records::wanted(&options.outputs);
    let aa = options.aa.unwrap_or(scene.image.aa);
    let samples = records::samples(aa, options.rays, ledger);
    let edged = !many && records::divides(aa, options.rays, seen.primitives(), ledger);
    let mut builder = KernelBuilder::default();
    let tracer = Tracer::new(scene, &seen, &mut builder, rule, wanted);
    let fills = fills_in(scene, options, &tracer, samples, ledger);
    let mut traced = if many { tracer.write_paths(ledger) } else { tracer.write(ledger) };
    let edge_wanted = edged && options.outputs.contains(&OutputKind::Edge);
    let (outputs, stride) = records::layout(&traced.fields, edge_wanted);
    let (extent, workgroup) = records::extent(if fills { RaySource::List } else { options.rays });
    let entry = match options.rays {
        RaySource::Camera if many => path_camera_entry(scene, &mut builder, &traced, stride, aa != Aa::None),
        RaySource::List if many => path_list_entry(&mut builder, &traced, stride),
        RaySource::Camera if edged => {
            edged_entry(scene, &mut builder, seen.primitives(), &traced, (stride, edge_wanted), fills)
        }
        RaySource::Camera => camera_entry(scene, &mut builder, &traced, (stride, samples), fills),
        RaySource::List => list_entry(&mut builder, &traced, stride),
    };
    let name = match options.rays {
        RaySource::Camera => "draw",
        RaySource::List => "probe",
    };
    let mut entries = vec![(name, Stage::Compute(workgroup), entry)];
    let fill = records::add_fill(&mut entries, traced.fill.take());
    let survey = fills.then(|| {
        let function = Tracer::new(scene, &seen, &mut builder, rule, vec![]).write_survey();
        let primitives = if edged { seen.primitives() } else { &[] };
        let entry = survey_entry(scene, &mut builder, primitives, function);
        entries.push(("survey_pixels", Stage::Compute([64, 1, 1]), entry));
        entries.len() as u32 - 1
    });
    let (kernels, bindings, uniforms) = builder.finish(entries);
    let work_per_ray = match rule {
        StepRule::Closed => 1,
        StepRule::Fixed(n) => n,
        StepRule::Adaptive(_) => 512,
        StepRule::Paths(_) | StepRule::Slabs { .. } | StepRule::Splats { .. } => 256,
    };
    let plan = Plan {
        backend: "raymarch",
        rays: options.rays,
        outputs,
        stride,
        bindings,
        uniforms,
        passes: vec![Pass::Compute { kernel: 0, extent }],
        targets: vec![],
        light: None,
        notes: 0,
        repeats: 1,
        steps: rule,
        fill,
        plant: None,
        footprints: None,
        carried: 0,
        bounds: seen.bounds,
        survey,
        samples,
        work_per_ray: work_per_ray * samples,
    };
    Some((kernels, plan))
}

/// Whether some pixels are drawn and others filled in from them.
fn fills_in(scene: &FieldScene, options: &Options, tracer: &Tracer<'_>, samples: u32, ledger: &mut Ledger) -> bool {
    if options.rays == RaySource::List {
        return false;
    }
    let reason = match (scene.render.pixels, tracer.rule) {
        (Pixels::Every, _) => "every pixel is to be drawn",
        (Pixels::Adaptive, StepRule::Closed) => "closed forms take less than telling pixels apart",
        (Pixels::Adaptive, StepRule::Fixed(_)) => "with a given number of steps nothing is known of the error",
        (Pixels::Adaptive, StepRule::Paths(_)) => "random paths are noise, and noise cannot be filled in",
        (Pixels::Adaptive, _) if scene.render.composite != Composite::Radiance => {
            "projections of data are not smooth between pixels"
        }
        (Pixels::Adaptive, _) if samples > 1 => "with several rays for each pixel edges lie within pixels",
        (Pixels::Adaptive, _) if !tracer.is_surveyable() => "the outline of a signed distance field has no closed form",
        (Pixels::Adaptive, _) => return true,
    };
    ledger.omit(FILLED, reason, None);
    false
}

/// What it cannot draw. That an endless medium has no closed form it finds when it builds.
pub(super) fn refuse(scene: &FieldScene, _: &Options, diagnostics: &mut Diagnostics) {
    super::refuse_splats(scene, "the ray marcher", diagnostics);
}

/// Sums over the rays of a pixel; of what went wrong, the first.
struct Sums(Vec<LocalId>);

impl Sums {
    fn new(code: &mut Code, traced: &Traced) -> Self {
        let var = |(kind, width): &(OutputKind, u8)| {
            code.var(output_name(*kind), Ty::float(*width), Expr::F32(0.0).splat(*width))
        };
        Self(traced.fields.iter().map(var).collect())
    }

    /// Adds a ray with a weight. Evaluations are counted, not weighed.
    fn add(&self, code: &mut Code, traced: &Traced, ray: &Expr, weight: &Expr) {
        for (i, ((kind, width), sum)) in traced.fields.iter().zip(&self.0).enumerate() {
            let value = ray.clone().field(i as u32);
            match kind {
                OutputKind::Fault => {
                    let code_so_far = Expr::Local(*sum).component(0).bitcast(Prim::U32);
                    let none = Expr::binary(BinaryOp::Equal, code_so_far, 0u32);
                    code.set(*sum, none.select(value, *sum));
                }
                OutputKind::Evaluations => code.add(*sum, value),
                OutputKind::Radiance
                | OutputKind::Transmittance
                | OutputKind::OpticalDepth
                | OutputKind::Error
                | OutputKind::Rounding
                | OutputKind::Storage
                | OutputKind::Edge => code.add(*sum, value * weight.clone().splat(*width)),
            }
        }
    }

    fn values(&self) -> Vec<Expr> {
        self.0.iter().map(|s| Expr::Local(*s)).collect()
    }
}

/// One ray per pixel, two where an edge divides it.
fn edged_entry(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    primitives: &[crate::ir::Primitive],
    traced: &Traced,
    (stride, edge_wanted): (u32, bool),
    fills: bool,
) -> Function {
    let mut code = Code::new("draw", None);
    let Pixel { x, y, record } = pixel_of(builder, &mut code, fills);
    let camera = rays::Camera::new(builder, scene.camera.projection);
    let centre = (x + 0.5, y + 0.5);
    let centre = (code.bind("center_x", Ty::F32, centre.0), code.bind("center_y", Ty::F32, centre.1));
    let division = edges::divide(&scene.graph, builder, &mut code, &camera, primitives, centre.clone());
    let Some(edges::Division { covered, inner, outer, divided }) = division else {
        return code.finish(None);
    };
    let sums = Sums::new(&mut code, traced);
    let weight = code.var("weight", Ty::F32, covered.clone());
    let at_x = code.var("at_x", Ty::F32, centre.0.clone() + inner.0);
    let at_y = code.var("at_y", Ty::F32, centre.1.clone() + inner.1);
    let side = code.var("side_of_edge", Ty::U32, 0u32);
    code.open();
    let start = camera.ray(&mut code, "ray", at_x.into(), at_y.into());
    let result = builder.result_of(traced.function);
    let ray = code.bind("traced", result, rays::call(traced.function, &start));
    sums.add(&mut code, traced, &ray, &weight.into());
    code.add(side, 1u32);
    let done = Expr::Local(side).greater_equal(2u32).or(!divided.clone());
    code.break_if(done);
    code.set(weight, Expr::F32(1.0) - covered);
    code.set(at_x, centre.0 + outer.0);
    code.set(at_y, centre.1 + outer.1);
    let block = code.close();
    code.push_loop(block);
    let mut values = sums.values();
    let mut widths: Vec<u8> = traced.fields.iter().map(|f| f.1).collect();
    if edge_wanted {
        values.push(divided.select(1.0, 0.0));
        widths.push(1);
    }
    store(builder, &mut code, &widths, &values, &record, stride);
    code.finish(None)
}

fn camera_entry(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    traced: &Traced,
    (stride, samples): (u32, u32),
    fills: bool,
) -> Function {
    let mut code = Code::new("draw", None);
    let Pixel { x, y, record } = pixel_of(builder, &mut code, fills);
    let camera = rays::Camera::new(builder, scene.camera.projection);
    let result = builder.result_of(traced.function);
    if samples == 1 {
        let start = camera.ray(&mut code, "ray", x + 0.5, y + 0.5);
        let traced_ray = code.bind("traced", result, rays::call(traced.function, &start));
        let values: Vec<Expr> = (0..traced.fields.len() as u32).map(|i| traced_ray.clone().field(i)).collect();
        store(builder, &mut code, &widths(traced), &values, &record, stride);
        return code.finish(None);
    }
    let sums = Sums::new(&mut code, traced);
    let index = code.var("sample", Ty::F32, 0.0);
    code.open();
    let (dx, dy) = rays::sample_offset(&mut code, index.into(), samples);
    let start = camera.ray(&mut code, "ray", x + dx, y + dy);
    let ray = code.bind("traced", result, rays::call(traced.function, &start));
    sums.add(&mut code, traced, &ray, &Expr::F32(1.0 / f64::from(samples)));
    code.add(index, 1.0);
    code.break_if(Expr::Local(index).greater_equal(f64::from(samples)));
    let block = code.close();
    code.push_loop(block);
    store(builder, &mut code, &widths(traced), &sums.values(), &record, stride);
    code.finish(None)
}

/// What tells the pixels of a picture apart. One that an edge divides is like no other.
fn survey_entry(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    primitives: &[crate::ir::Primitive],
    survey: FunctionId,
) -> Function {
    let mut code = Code::new("survey_pixels", None);
    let number = records::numbered(builder, &mut code);
    let width = builder.frame(FrameValue::ImageSize).component(0);
    let row = code.bind("row", Ty::U32, number.clone() / width.clone());
    let column = number.clone() - row.clone() * width;
    let center = |code: &mut Code, name: &str, n: Expr| code.bind(name, Ty::F32, n.convert(Prim::F32) + 0.5);
    let centre = (center(&mut code, "center_x", column), center(&mut code, "center_y", row));
    let camera = rays::Camera::new(builder, scene.camera.projection);
    let division = edges::divide(&scene.graph, builder, &mut code, &camera, primitives, centre.clone());
    let start = camera.ray(&mut code, "ray", centre.0, centre.1);
    let met = code.bind("met", Ty::U32, rays::call(survey, &start));
    let met = match division {
        Some(edges::Division { divided, .. }) => divided.select(Expr::U32(ALONE), met.min(Expr::U32(ALONE - 1))),
        None => met,
    };
    let buffer = builder.survey();
    code.store(buffer, number, met);
    code.finish(None)
}

fn widths(traced: &Traced) -> Vec<u8> {
    traced.fields.iter().map(|f| f.1).collect()
}

fn list_entry(builder: &mut KernelBuilder, traced: &Traced, stride: u32) -> Function {
    let mut code = Code::new("probe", None);
    let index = records::listed(builder, &mut code);
    let start = rays::list(builder, &mut code, &index);
    let result = builder.result_of(traced.function);
    let traced_ray = code.bind("traced", result, rays::call(traced.function, &start));
    let values: Vec<Expr> = (0..traced.fields.len() as u32).map(|i| traced_ray.clone().field(i)).collect();
    store(builder, &mut code, &widths(traced), &values, &index, stride);
    code.finish(None)
}

/// The mean of this dispatch's paths from one ray each; `ray` gives the ray, from random numbers of its own.
fn path_loop(
    builder: &mut KernelBuilder,
    code: &mut Code,
    traced: &Traced,
    number: Expr,
    ray: &mut dyn FnMut(&mut KernelBuilder, &mut Code, LocalId) -> rays::Start,
) -> Vec<Expr> {
    let random = traced.random.expect("paths have random numbers");
    let result = builder.result_of(traced.function);
    let sums = Sums::new(code, traced);
    let count = builder.frame(FrameValue::Paths);
    let first = builder.frame(FrameValue::FirstPath);
    let seed = builder.frame(FrameValue::Seed);
    let share = code.bind("share", Ty::F32, Expr::F32(1.0) / count.clone().convert(Prim::F32));
    let index = code.var("path_number", Ty::U32, 0u32);
    code.open();
    code.break_if(Expr::Local(index).greater_equal(count));
    let own = random.mixed(number + random.mixed(first + Expr::Local(index) + random.mixed(seed)));
    let rng = code.var("rng", Ty::U32, own);
    let start = ray(builder, code, rng);
    let arguments = vec![start.origin, start.direction, start.from, rng.into()];
    let path = code.bind("followed", result, Expr::Call(traced.function, arguments));
    sums.add(code, traced, &path, &share);
    code.add(index, 1u32);
    let block = code.close();
    code.push_loop(block);
    sums.values()
}

fn path_camera_entry(
    scene: &FieldScene,
    builder: &mut KernelBuilder,
    traced: &Traced,
    stride: u32,
    spread: bool,
) -> Function {
    let mut code = Code::new("draw", None);
    let Pixel { x, y, record } = pixel(builder, &mut code);
    let camera = rays::Camera::new(builder, scene.camera.projection);
    let size = builder.frame(FrameValue::ImageSize);
    let prim = Prim::U32;
    let number = y.clone().convert(prim) * size.component(0) + x.clone().convert(prim);
    let number = code.bind("pixel_number", Ty::U32, number);
    let values = path_loop(builder, &mut code, traced, number, &mut |_, code, rng| {
        let random = traced.random.expect("paths have random numbers");
        // Anti-aliased: paths spread over the pixel.
        let mut offset = || if spread { random.draw(code, rng) } else { Expr::F32(0.5) };
        let (dx, dy) = (offset(), offset());
        camera.ray(code, "ray", x.clone() + dx, y.clone() + dy)
    });
    store(builder, &mut code, &widths(traced), &values, &record, stride);
    code.finish(None)
}

fn path_list_entry(builder: &mut KernelBuilder, traced: &Traced, stride: u32) -> Function {
    let mut code = Code::new("probe", None);
    let index = records::listed(builder, &mut code);
    // Long lists are followed in parts: each ray's random numbers go by its place in the whole.
    let number = builder.frame(FrameValue::TileOrigin).component(0) + index.clone();
    let number = code.bind("ray_number", Ty::U32, number);
    let values =
        path_loop(builder, &mut code, traced, number, &mut |builder, code, _| rays::list(builder, code, &index));
    store(builder, &mut code, &widths(traced), &values, &index, stride);
    code.finish(None)
}
