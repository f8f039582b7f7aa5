//! What slicing promises beyond what every backend does: blending in f32, any camera, and a clear word where it cannot draw.

use compiler::Options;
use compiler::ir::{Aa, Backend, Scattering, Stacks};
use compiler::program::print_plan;
use runtime::engine::gpu::AdapterChoice;
use runtime::frame::{Cause, EngineChoice, FileLoader, Session, Settings};
use std::path::Path;
use tyndall_tests::{codes_of, draw, draw_text, open_text};

fn sliced() -> Options {
    Options { backend: Some(Backend::Slicing), aa: Some(Aa::None), ..Options::default() }
}

fn along_axes() -> Options {
    Options { stacks: Some(Stacks::Object), ..sliced() }
}

/// Slabs of opacity 1e-4 by the thousand: in 8 bits nothing would be left of them, in 16 bits two hundredths would be lost.
#[test]
fn four_thousand_thin_slabs_are_blended_without_loss() {
    let text = "
        medium veil {
            shape = box(min: (-10, -10, 0) m, max: (10, 10, 1) m)
            k_a = rgb(0.4096, 0.8, 0.1) / m
            k_e = rgb(0.4096, 0.4, 0.2) * lx / m
        }
        camera { from = (0,0,-40) m  to = (0,0,0) m  projection = orthographic(height: 1 m) }
        image { size = 4 x 4  aa = none }
        render { backend = slicing  slices = 4096 }";
    let Some((radiance, transmittance)) = draw_text(text, sliced()) else { return };
    for (l, t) in radiance.chunks(3).zip(transmittance.chunks(3)) {
        for (band, (k, e)) in [(0.4096f64, 0.4096f64), (0.8, 0.4), (0.1, 0.2)].into_iter().enumerate() {
            let through = (-k).exp();
            let (l, t) = (f64::from(l[band]), f64::from(t[band]));
            assert!((t / through - 1.0).abs() < 1e-4, "T {t}, not {through}");
            let light = e / k * (1.0 - through);
            assert!((l / light - 1.0).abs() < 2e-4, "L {l}, not {light}");
        }
    }
}

const BLOB: &str = "
    medium blob {
        shape = difference(sphere(center: (0,0,0) m, radius: 1 m), box(min: (0,0,-2) m, max: (2,2,2) m))
        k_a = rgb(1, 2, 0.5) / m * (1 + 0.5 * sin(4 * p.x / 1 m))
        k_e = 2 lx / m * (1 + p.y / 2 m)
    }
    image { size = 24 x 18  aa = none  background = #203040 }
";

/// Every pixel of a camera against the ray marcher, both to an accuracy of their own.
fn as_marched(camera: &str) {
    agree(&format!("{BLOB}{camera}"), camera);
}

fn worst(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

fn agree(text: &str, camera: &str) {
    let accuracy = Some(1e-3);
    let marched = Options { accuracy, backend: Some(Backend::Raymarch), ..sliced() };
    let Some((other_light, other_clear)) = draw_text(text, marched) else { return };
    for stacks in [Stacks::View, Stacks::Object] {
        let options = Options { accuracy, stacks: Some(stacks), ..sliced() };
        let (light, clear) = draw_text(text, options).expect("there is an adapter");
        let (off, off_clear) = (worst(&light, &other_light), worst(&clear, &other_clear));
        assert!(off <= 2e-3 && off_clear <= 2e-3, "{camera} {stacks:?}: {off} and {off_clear}");
        let dark = clear.iter().copied().fold(1.0, f32::min);
        assert!(dark < 0.9, "{camera}: something is seen, {dark}");
    }
}

#[test]
fn perspectives_near_far_and_inside() {
    as_marched("camera { from = (0.4, 0.3, -3) m  to = (0,0,0) m  fov = 60 deg }");
    as_marched("camera { from = (-0.3, -0.2, 0.1) m  to = (-1, 0, 0) m  fov = 100 deg }");
    as_marched("camera { from = (1e6, 2e5, 3e5) m  to = (0,0,0) m  fov = 0.0002 deg }");
    // So wide that some rays meet planes across an axis from behind, and one nearly goes along them.
    as_marched("camera { from = (-0.2, 0.1, -1.1) m  to = (0.75, 0, 0) m  fov = 110 deg }");
    as_marched("camera { from = (0.05, -0.2, 0.15) m  to = (-1, -0.9, -0.8) m  fov = 120 deg }");
    // Grazing: along a face of the box that is taken away.
    as_marched("camera { from = (0, 0.5, -3) m  to = (0, 0.5, 0) m  fov = 45 deg }");
}

/// More bands than a target holds are drawn in several programs.
#[test]
fn many_bands_are_sliced_too() {
    let camera = "camera { from = (0.4, 0.3, -3) m  to = (0,0,0) m  fov = 60 deg }";
    agree(&format!("{BLOB}{camera}").replace("aa = none", "aa = none  bands = spectral(6)"), camera);
}

#[test]
fn orthographic_views_from_outside_and_within() {
    as_marched("camera { from = (2, 2, -3) m  to = (0,0,0) m  projection = orthographic(height: 2.5 m) }");
    as_marched("camera { from = (0, 0, 0) m  to = (-1, 0, 0.2) m  projection = orthographic(height: 2 m) }");
}

#[test]
fn a_camera_that_looks_away_sees_the_background_alone() {
    let text = format!("{BLOB}camera {{ from = (0, 0, -3) m  to = (0, 0, -9) m  fov = 40 deg }}");
    let Some((light, clear)) = draw_text(&text, sliced()) else { return };
    assert!(clear.iter().all(|t| *t == 1.0));
    assert!(light.chunks(3).all(|l| l == &light[..3]) && light[2] > 0.0);
}

#[test]
fn what_slabs_cannot_show_is_refused_with_what_can() {
    let refused = |text: &str, options: Options| codes_of(text, &options) == ["E0530"];
    assert!(!refused(BLOB, sliced()));
    let fog = "fog { k = 0.1 /m  color = #fff }";
    assert!(refused(fog, sliced()));
    let panorama = format!("{BLOB}camera {{ from = (0,0,-3) m  to = (0,0,0) m  projection = panorama }}");
    assert!(refused(&panorama, sliced()));
    // A list of rays has no camera.
    assert!(!refused(&panorama, Options { backend: Some(Backend::Slicing), ..Options::probe() }));
    let lit = "
        medium cloud { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_s = 1 /m }
        light sun { direction = (0,-1,0)  irradiance = 1 lx }";
    assert!(!refused(lit, sliced()));
    assert!(refused(lit, Options { scattering: Some(Scattering::Multiple), ..sliced() }));
}

/// A field that jumps inside slabs is cut there: eight slabs show what closed forms show. On a plane, on a curved surface, and
/// twice within a ten thousandth of a slab.
#[test]
fn slabs_end_where_fields_jump() {
    let rest = "
        camera { from = (0.4, 0.3, -3) m  to = (0,0,0) m  fov = 50 deg }
        image { size = 24 x 18  aa = none  background = #203040 }
        render { backend = slicing  slices = 8 }";
    let coefficients = |k: f64| format!("k_a = {k} * rgb(1, 2, 0.5) / m  k_e = {k} * 2 lx / m");
    let cases = [
        ("sphere(center: (0,0,0) m, radius: 0.8 m)", "if length(p) < 0.8 m then 1 else 0", 1.0),
        ("box(min: (-1,-1,-1) m, max: (0.3,1,1) m)", "if p.x < 0.3 m then 1 else 0", 1.0),
        (
            "shell(center: (0,0,0) m, inner: 0.7 m, outer: 0.7001 m)",
            "if abs(length(p) - 0.70005 m) < 0.00005 m then 1 else 0",
            1e3,
        ),
    ];
    for (shape, density, k) in cases {
        let exact = format!("medium thing {{ shape = {shape}  {} }} {rest}", coefficients(k));
        let whole = "box(min: (-1,-1,-1) m, max: (1,1,1) m)";
        let cut = format!("medium thing {{ shape = {whole}  density = {density}  {} }} {rest}", coefficients(k));
        let Some((light, clear)) = draw_text(&exact, sliced()) else { return };
        let (cut_light, cut_clear) = draw_text(&cut, sliced()).expect("there is an adapter");
        let off = worst(&light, &cut_light).max(worst(&clear, &cut_clear));
        // A silhouette that is grazed, rounded.
        let allowed = if k > 1.0 { 5e-3 } else { 1e-5 };
        println!("{shape}: {off:e}");
        assert!(off < allowed, "{shape}: {off}");
        assert!(clear.iter().any(|t| *t < 0.9), "{shape}: something is seen");
    }
}

/// An adapter that cannot blend f32 gets targets of f16: what those round is reported, in the picture, the plan and the ledger.
#[test]
fn what_f16_rounds_is_reported() {
    let adapter = AdapterChoice { without_f32_blending: true, ..AdapterChoice::from_env() };
    let camera = "camera { from = (0.4, 0.3, -3) m  to = (0,0,0) m  fov = 60 deg }";
    let uniform = "
        medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_a = rgb(1, 2, 0.5) / m  k_e = 2 lx / m }
        image { size = 24 x 18  aa = none  background = #203040 }";
    // Far dimmer and far brighter than white, a thousand bands' width of depth, and in the dark.
    let dim = BLOB.replace("k_e = 2 lx / m", "k_e = 1e-3 lx / m").replace("#203040", "#000");
    let bright = BLOB.replace("k_e = 2 lx / m", "k_e = 500 lx / m");
    let beyond = BLOB.replace("k_e = 2 lx / m", "k_e = 1e5 lx / m");
    let thick = BLOB.replace("rgb(1, 2, 0.5)", "rgb(1e3, 2e5, 1e-3)");
    let exposed = BLOB.replace("aa = none", "aa = none  exposure = 3");
    for scene in [BLOB, uniform, &dim, &bright, &beyond, &thick, &exposed] {
        let text = format!("{scene}{camera}");
        let options = Options { accuracy: Some(2e-2), ..sliced() };
        let settings = Settings { options, engine: EngineChoice::Gpu, adapter: adapter.clone(), ..Settings::default() };
        let loader = FileLoader::new(Path::new("."));
        let mut session = match Session::open("scene.vol", &text, &loader, settings) {
            Ok(session) => session,
            Err(trouble) if trouble.cause == Cause::Machine => {
                runtime::engine::skip_without_adapter();
                return;
            }
            Err(trouble) => panic!("{:?}", trouble.diagnostics),
        };
        let program = session.program();
        assert!(print_plan(program).contains("× f16"), "the plan says so");
        assert!(program.ledger.0.iter().any(|o| o.feature == "f32 targets"), "the ledger says so");
        assert!(session.steps().contains("f16"));
        let half = draw(Path::new("scene.vol"), &mut session);
        let finer = Options { accuracy: Some(1e-4), ..sliced() };
        let mut session = open_text(&text, finer).expect("there is an adapter");
        let single = draw(Path::new("scene.vol"), &mut session);
        let (mut worst, mut least, mut rounded) = (0.0f32, f32::INFINITY, false);
        let pixels = half.picture.radiance().chunks(3).zip(single.picture.radiance().chunks(3));
        for ((a, b), (said, own)) in pixels.zip(half.errors.iter().zip(&single.errors)) {
            let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            rounded |= off > 1e-5 * b[0];
            if off > 0.0 {
                worst = worst.max(off / (said + own));
                least = least.min(off / (said + own));
            }
        }
        println!("{:?} slabs: measured over reported {least:.2e} to {worst:.2}", half.slabs);
        assert!(half.errors.len() == 24 * 18 && worst <= 1.0, "{scene}: {worst}");
        assert!(rounded, "f16 shows");
    }
}

/// Stacks across the axes of a box that is turned: what has a closed form is exact with one slab, along rays on and off the axis.
#[test]
fn stacks_across_axes_know_the_length_of_a_ray_in_a_slab() {
    let text = "
        medium brick {
            shape = box(min: (-0.8, -0.5, -0.3) m, max: (0.8, 0.5, 0.3) m)
            k_a = rgb(1, 2, 0.5) / m
            k_e = 2 lx / m
            transform = rotate(axis: (1, 2, 3), angle: 50 deg)
        }
        camera { from = (1, 0.7, -1.2) m  to = (0,0,0) m  fov = 80 deg }
        image { size = 24 x 18  aa = none  background = #203040 }
        render { backend = slicing  stacks = object }";
    let Some((light, clear)) = draw_text(text, sliced()) else { return };
    let (exact, exact_clear) =
        draw_text(text, Options { backend: Some(Backend::Raymarch), ..sliced() }).expect("as before");
    for slices in [1, 7, 64] {
        let (light, clear) = draw_text(text, Options { slices: Some(slices), ..sliced() }).expect("as before");
        let off = worst(&light, &exact).max(worst(&clear, &exact_clear));
        assert!(off < 1e-5, "{slices} slabs: {off}");
    }
    assert!(worst(&light, &exact).max(worst(&clear, &exact_clear)) < 1e-5);
}

const WAVES: &str = "
    medium waves {
        shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)
        k_a = rgb(1, 2, 0.5) / m * (1 + 0.8 * sin(5 * p.x / 1 m) * cos(4 * p.y / 1 m + 3 * p.z / 1 m))
        k_e = 2 lx / m * (1 + 0.5 * sin(3 * (p.x + p.z) / 1 m))
    }
    image { size = 16 x 12  aa = none  background = #203040 }
";

/// Root mean square and largest difference.
fn apart(a: &[f32], b: &[f32]) -> (f64, f64) {
    let squares: f64 = a.iter().zip(b).map(|(x, y)| f64::from(x - y).powi(2)).sum();
    ((squares / a.len() as f64).sqrt(), f64::from(worst(a, b)))
}

/// Both ways to cut are of second order, and so is the jump when the view passes from one axis to another: it is what both
/// pictures are wrong by.
#[test]
fn stacks_across_axes_are_of_second_order_and_so_is_their_switch() {
    let camera = |x: f64| format!("{WAVES}camera {{ from = ({x}, 0.6, -3) m  to = (0,0,0) m  fov = 50 deg }}");
    let draw = |text: &str, options: Options| draw_text(text, options);
    let slices = [24u32, 48, 96];
    let fine = Options { accuracy: Some(1e-6), backend: Some(Backend::Raymarch), ..sliced() };
    let Some((exact, _)) = draw(&camera(0.9), fine) else { return };
    let cut = |text: &str, n: u32, options: Options| {
        draw(text, Options { slices: Some(n), ..options }).expect("there is an adapter").0
    };
    for options in [sliced(), along_axes()] {
        let errors: Vec<f64> =
            slices.iter().map(|n| apart(&cut(&camera(0.9), *n, options.clone()), &exact).0).collect();
        let slope = (errors[2] / errors[0]).log2() / 2.0;
        println!("{:?}: {errors:?}, slope {slope:.2}", options.stacks);
        assert!((-2.25..-1.75).contains(&slope), "{:?}: {errors:?}", options.stacks);
    }
    // The axes tie where the eye is as far to the side as it is in front.
    let sides = [3.0 - 1e-5, 3.0 + 1e-5].map(camera);
    let jumps: Vec<f64> = slices
        .iter()
        .map(|n| {
            let [a, b] = [0, 1].map(|i| cut(&sides[i], *n, along_axes()));
            let [c, d] = [0, 1].map(|i| cut(&sides[i], *n, sliced()));
            assert!(apart(&c, &d).1 < 1e-4, "planes across the view turn with it");
            apart(&a, &b).1
        })
        .collect();
    println!("largest jump where the stack switches: {jumps:?}");
    let slope = (jumps[2] / jumps[0]).log2() / 2.0;
    assert!(jumps[0] > 1e-3 && (-2.4..-1.6).contains(&slope), "{jumps:?}");
}

#[test]
fn words_for_stacks_are_checked() {
    let with = |property: &str| format!("{BLOB} render {{ backend = slicing  {property} }}");
    let found = |property: &str| codes_of(&with(property), &Options::default());
    assert!(found("stacks = object").is_empty() && found("stacks = view").is_empty());
    assert_eq!(found("stacks = objects"), ["E0406"]);
    assert_eq!(found("stack = object"), ["E0401"]);
}

/// Bands that fade differently have a target each; those that fade alike share one.
#[test]
fn plans_say_how_transmittances_are_blended() {
    let plan = |text: &str| open_text(text, sliced()).map(|session| print_plan(session.program()));
    let Some(each) = plan(BLOB) else { return };
    assert!(each.contains("blended by a transmittance for each band, as the alphas of 3 targets"), "{each}");
    let alike = plan(&BLOB.replace("rgb(1, 2, 0.5) / m", "1 / m")).expect("there is an adapter");
    assert!(alike.contains("blended by one transmittance for all bands"), "{alike}");
}
