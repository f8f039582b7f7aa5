//! Files of splats as scenes name them, the example, and the GPU against the reference.

use compiler::ir::{Aa, Backend};
use compiler::program::OutputKind;
use compiler::{Options, compile};
use runtime::data::Memory;
use runtime::data::splats::{Splats, read_splats_from};
use runtime::frame::{Drawing, EngineChoice, FileLoader, Params, ProbeSettings, RayQuery, Session, Settings};
use runtime::image::metric::compare;
use runtime::image::{WriteOptions, read_png, srgb_encode, write_png};
use std::path::Path;
use std::sync::Arc;
use tyndall_tests::splats::{One, ball, file, noise, odd, some};
use tyndall_tests::{Made, bonsai, codes, draw, fail, open, root};

/// The file beside the examples is what its generator makes, to a step of each number.
#[test]
fn the_bonsai_is_what_its_generator_makes() {
    let path = root().join("examples/data/bonsai.spz");
    let kept = std::fs::read(&path).expect("the file is there");
    assert!(kept.len() < 300 << 10, "{} bytes", kept.len());
    let read = |bytes: Vec<u8>| read_splats_from(&Memory::one("a.spz", bytes), Path::new("a.spz")).expect("reads").0;
    let (kept, made) = (read(kept), read(bonsai::file()));
    assert_eq!(kept.header().count, made.header().count);
    let off = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0_f32, f32::max);
    for i in 0..kept.len() {
        assert!(off(&kept.centers()[i], &made.centers()[i]) <= 2e-5, "splat {i}");
        assert!(off(kept.harmonics(i), made.harmonics(i)) <= 0.13, "splat {i}");
    }
    // What the generator wanted is what the reader gives.
    for (i, wanted) in bonsai::splats().iter().enumerate() {
        let center = wanted.center.map(|x| x as f32);
        assert!(off(&made.centers()[i], &center) <= 1e-5, "splat {i}");
        let turn: f64 = (0..4).map(|k| f64::from(made.rotations()[i][k]) * wanted.rotation[k]).sum();
        assert!(turn.abs() > 0.9999, "splat {i}: {turn}");
        for k in 0..3 {
            let ratio = f64::from(made.deviations()[i][k]) / wanted.deviations[k];
            assert!((ratio.ln()).abs() <= 0.04, "splat {i}: {ratio}");
        }
    }
}

/// A scene on an engine; `None` where the machine lacks it.
fn session(text: &str, splats: &Arc<Splats>, engine: EngineChoice, options: Options) -> Option<Session> {
    let settings = Settings { options, engine, ..Settings::default() };
    match Session::open("scene.vol", text, &Made(splats.clone()), settings) {
        Ok(session) => Some(session),
        Err(trouble) if trouble.cause == runtime::frame::Cause::Machine => {
            runtime::engine::skip_without_adapter();
            None
        }
        Err(trouble) => fail(Path::new("scene.vol"), &trouble),
    }
}

fn drawn(text: &str, splats: &Arc<Splats>, engine: EngineChoice) -> Option<Drawing> {
    let mut session = session(text, splats, engine, Options::default())?;
    let drawing = draw(Path::new("scene.vol"), &mut session);
    assert_eq!(drawing.faults.iter().count(), 0, "{:?}", drawing.faults);
    let finite = drawing.picture.radiance().iter().all(|l| l.is_finite() && *l >= 0.0);
    assert!(finite, "{text}");
    assert!(drawing.picture.transmittance().expect("asked for").iter().all(|t| (0.0..=1.0).contains(t)), "{text}");
    Some(drawing)
}

fn apart(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (srgb_encode((*a).into()) - srgb_encode((*b).into())).abs()).fold(0.0, f64::max)
}

/// The GPU's picture is the reference's: in what is shown, and in lx within what is said of it and a little for f32.
fn agrees(text: &str, splats: &Arc<Splats>) -> Option<f64> {
    let gpu = drawn(text, splats, EngineChoice::Gpu)?;
    let reference = drawn(text, splats, EngineChoice::Reference)?;
    let off = apart(gpu.picture.radiance(), reference.picture.radiance());
    assert!(off <= 1.0 / 255.0, "{off} apart\n{text}");
    let through = |d: &Drawing| d.picture.transmittance().expect("asked for").to_vec();
    let through = through(&gpu).iter().zip(&through(&reference)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(through <= 1.0 / 255.0, "transmittance {through} apart\n{text}");
    let pixels = gpu.picture.radiance().chunks_exact(3).zip(reference.picture.radiance().chunks_exact(3));
    for ((found, wanted), said) in pixels.zip(&gpu.errors) {
        let off = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let bright = wanted.iter().fold(1.0f32, |m, x| m.max(*x));
        let rounding = 5e-5 + 2e-9 * splats.len() as f32;
        assert!(off <= said + rounding * bright, "{off}, said to be {said}\n{text}");
    }
    Some(off)
}

const VIEW: &str = "splats room { file = \"s.ply\" }
    camera { from = (0.3, 0.5, -3) m  to = (0.1, 0, 0) m  fov = 50 deg }
    image { size = 33 x 18  background = #336699 }";

/// All degrees, both ways of blending, with and without the low-pass that keeps light, in all views; some splats behind the
/// eye and some at the near plane.
#[test]
fn gpu_and_reference_draw_the_same_splats() {
    for (degree, blend, antialiased, view) in [
        (0, "encoded", false, "fov = 50 deg"),
        (1, "linear", false, "fov = 50 deg"),
        (2, "encoded", true, "fov = 20 deg  up = (0, -1, 0)"),
        (3, "linear", true, "projection = orthographic(height: 2.5 m)"),
        (3, "encoded", false, "projection = orthographic(height: 2.5 m)  up = (1, 0.2, 0)"),
        (3, "encoded", false, "projection = panorama"),
        (2, "linear", true, "projection = panorama"),
    ] {
        let splats = file(&some(150, 3 + u64::from(degree)), degree, antialiased);
        let text = VIEW.replace("fov = 50 deg", view).replace("s.ply\"", &format!("s.ply\"  blend = {blend}"));
        let Some(off) = agrees(&text, &splats) else { return };
        // From within, where some are behind the eye and some beside it.
        let within = text.replace("from = (0.3, 0.5, -3) m", "from = (0.1, 0.05, -0.3) m");
        let Some(inside) = agrees(&within, &splats) else { return };
        println!("degree {degree}, {blend}, {view}: {off:.1e}, from within {inside:.1e}");
    }
}

/// Samples of a pixel, several items, transforms, grey and many bands.
#[test]
fn gpu_and_reference_draw_the_same_scenes_of_splats() {
    let splats = file(&some(80, 17), 2, false);
    let two = VIEW.replace(
        "splats room { file = \"s.ply\" }",
        "splats room { file = \"s.ply\"  blend = linear }
         splats other { file = \"s.ply\"  transform = rotate(axis: (0, 1, 0), angle: 70 deg) * scale(0.5) }",
    );
    let fog = "fog { k = 0.3 /m  color = #c8d0d8 }";
    let wall = "surface wall { shape = plane(point: (0, 0, 0.3) m, normal: (0, 0, -1))  albedo = 0.7 }
        light sky { environment = rgb(0.5, 0.6, 0.9) * lx }  render { scattering = none }";
    let gas = "medium gas { shape = box(min: (-0.7, -0.7, -0.7) m, max: (0.7, 0.4, 0.7) m)
        density = 1 + sin(p.x / 0.2 m)  k_a = 1.5 * rgb(1, 1.4, 2) / m  k_e = rgb(0.6, 0.4, 0.2) * (1 lx / m) }
        image { size = 12 x 9  aa = none }  render { accuracy = 1e-3 }";
    for extra in ["", fog, wall] {
        if agrees(&format!("{two}\n{extra}"), &splats).is_none() {
            return;
        }
    }
    let few = file(&some(12, 18), 2, false);
    let plain = VIEW.replace("image { size = 33 x 18  background = #336699 }", gas);
    let samples = VIEW.replace("background = #336699", "background = #336699  aa = ssaa(4)");
    let bands = VIEW.replace("size = 33 x 18", "size = 9 x 6  bands = spectral(7)");
    let gray = VIEW.replace("size = 33 x 18", "size = 9 x 6  bands = gray");
    for text in [plain, samples, gray] {
        let Some(gpu) = drawn(&text, &few, EngineChoice::Gpu) else { return };
        let reference = drawn(&text, &few, EngineChoice::Reference).expect("always there");
        let off = apart(gpu.picture.radiance(), reference.picture.radiance());
        println!("{off:.1e}");
        assert!(off <= 1.0 / 255.0, "{off}\n{text}");
    }
    // Each part of the spectrum has the light of its own bands.
    let Some(gpu) = drawn(&bands, &few, EngineChoice::Gpu) else { return };
    let reference = drawn(&bands, &few, EngineChoice::Reference).expect("always there");
    assert!(apart(gpu.picture.radiance(), reference.picture.radiance()) <= 1.0 / 255.0);
    let differ = gpu.picture.radiance().chunks_exact(7).any(|p| (p[0] - p[6]).abs() > 0.01);
    assert!(differ, "all bands are alike");
}

#[test]
fn the_order_in_the_file_does_not_matter_unless_depths_are_equal() {
    let mut list = some(300, 7);
    let Some(first) = drawn(VIEW, &file(&list, 3, false), EngineChoice::Gpu) else { return };
    list.reverse();
    list.swap(3, 150);
    let second = drawn(VIEW, &file(&list, 3, false), EngineChoice::Gpu).expect("it was there");
    let off = apart(first.picture.radiance(), second.picture.radiance());
    assert!(off <= 1e-6, "{off}");
    // At one depth the first of the file is in front.
    let text = "splats room { file = \"s.ply\"  blend = linear }
        camera { from = (0, 0, -4) m  to = (0, 0, 0) m }  image { size = 3 x 3 }";
    let ball = |color: [f64; 3]| ball([0.0; 3], 5.0, 1.0, color);
    let (red, blue) = (ball([1.0, 0.0, 0.0]), ball([0.0, 0.0, 1.0]));
    let middle = |list: &[One]| {
        let drawing = drawn(text, &file(list, 0, false), EngineChoice::Gpu).expect("it was there");
        drawing.picture.pixel(1, 1).to_vec()
    };
    let near = |a: &[f32], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(near(&middle(&[red.clone(), blue.clone()]), [1.0, 0.0, 0.0]));
    assert!(near(&middle(&[blue, red]), [0.0, 0.0, 1.0]));
    // Depths that 32 bits do not tell apart are in order all the same.
    let ahead = One { center: [0.0, 0.0, -1e-9], ..ball([0.0, 1.0, 0.0]) };
    assert!(near(&middle(&[ball([1.0, 0.0, 0.0]), ahead]), [0.0, 1.0, 0.0]));
}

/// An upright picture turned round is that of a camera that stands on its head; and each frame is the one before, bit by bit.
#[test]
fn cameras_on_their_heads_and_frames_one_after_another() {
    let splats = file(&some(200, 9), 3, false);
    let Some(upright) = drawn(VIEW, &splats, EngineChoice::Gpu) else { return };
    let text = VIEW.replace("fov = 50 deg", "fov = 50 deg  up = (0, -1, 0)");
    let inverted = drawn(&text, &splats, EngineChoice::Gpu).expect("it was there");
    let turned: Vec<f32> = inverted.picture.radiance().chunks_exact(3).rev().flatten().copied().collect();
    let off = apart(&turned, upright.picture.radiance());
    assert!(off <= 1e-5, "{off}");
    let mut session = session(VIEW, &splats, EngineChoice::Gpu, Options::default()).expect("it was there");
    for _ in 0..3 {
        let again = draw(Path::new("scene.vol"), &mut session);
        assert_eq!(again.picture.radiance(), upright.picture.radiance());
    }
}

/// All splats are behind the eye: nothing is to be put in order, and the background is as it was.
#[test]
fn no_splats_in_view() {
    let behind: Vec<One> = (0..5).map(|i| ball([0.3, 0.5, -3.5 - f64::from(i)], 0.1, 0.9, [1.0; 3])).collect();
    let Some(gpu) = drawn(VIEW, &file(&behind, 0, false), EngineChoice::Gpu) else { return };
    let pixel = gpu.picture.pixel(3, 3);
    assert!(pixel.iter().zip([0.2, 0.4, 0.6]).all(|(l, c)| (srgb_encode((*l).into()) - c).abs() < 1e-6), "{pixel:?}");
    assert!(gpu.picture.transmittance().expect("asked for").iter().all(|t| *t == 1.0));
}

/// On both engines, from afar and along rays: no NaN, nothing negative, no transmittance beyond 1.
#[test]
fn odd_splats_make_no_odd_pixels() {
    let media = ["", "fog { k = 0.1 /m  color = #888 }", "fog { k = 1e30 /m  color = #888 }"];
    let views = ["fov = 50 deg", "fov = 179 deg", "projection = orthographic(height: 3 m)", "projection = panorama"];
    let rays = [[0.0, 0.0, 1.0], [1.0, 1e-9, 0.0], [-0.3, 0.1, 0.9]];
    let rays = rays.map(|direction| RayQuery { origin: [0.0, 0.1, -3.0], direction });
    for (i, view) in views.into_iter().enumerate() {
        for (blend, engine) in [
            ("encoded", EngineChoice::Gpu),
            ("linear", EngineChoice::Gpu),
            ("encoded", EngineChoice::Reference),
            ("linear", EngineChoice::Reference),
        ] {
            let text = VIEW.replace("fov = 50 deg", view).replace("s.ply\"", &format!("s.ply\"  blend = {blend}"));
            let text = text.replace("33 x 18", "17 x 5") + media[i % 3];
            let splats = file(&odd(), 3, i % 2 == 1);
            if drawn(&text, &splats, engine).is_none() {
                continue;
            }
            let mut session = session(&text, &splats, engine, Options::probe()).expect("it was there");
            let params = Params::defaults(&session.program().lowered);
            let found = session.probe(&params, &rays, &ProbeSettings::default());
            for answer in found.unwrap_or_else(|t| fail(Path::new("scene.vol"), &t)) {
                assert!(answer.radiance.iter().all(|l| *l >= 0.0 && !l.is_nan()), "{answer:?}");
                assert!(answer.optical_depth.iter().all(|t| *t >= 0.0), "{answer:?}");
            }
        }
    }
    if drawn(VIEW, &file(&some(1, 5), 1, false), EngineChoice::Gpu).is_none() {
        return;
    }
    // A million times larger and smaller.
    let splats = file(&some(60, 5), 1, false);
    let plain = drawn(VIEW, &splats, EngineChoice::Gpu).expect("it was there");
    for factor in ["1e-6", "1e6"] {
        let text = VIEW.replace("s.ply\"", &format!("s.ply\"  transform = scale({factor})"));
        let text = text.replace(" m  ", &format!(" * {factor} m  "));
        let scaled = drawn(&text, &splats, EngineChoice::Gpu).expect("it was there");
        assert!(apart(scaled.picture.radiance(), plain.picture.radiance()) < 1e-4, "{factor}");
    }
}

/// More of them in one pixel than drivers let a loop have rounds, and more than a dispatch goes through; through media without
/// and with steps.
#[test]
fn a_pixel_may_have_any_number_of_splats() {
    let mut x = noise(31);
    let thin = |x: &mut dyn FnMut() -> f64, opacity: f64| One {
        center: [0.2 * x() - 0.1, 0.2 * x() - 0.1, 2.0 * x() - 1.0],
        rotation: [1.0, 0.0, 0.0, 0.0],
        deviations: [0.3; 3],
        opacity,
        harmonics: (0..3).map(|_| 3.0 * (x() - 0.5)).collect(),
    };
    let view = "splats room { file = \"s.ply\" }  camera { from = (0, 0, -3) m  to = (0, 0, 0) m  fov = 30 deg }
        image { size = 3 x 2  background = #808080  aa = none }  render { accuracy = 1e-3 }";
    let gas = "medium gas { shape = sphere(center: (0, 0, 0) m, radius: 0.7 m)
        density = 1 + sin(p.z / 0.1 m)  k_a = 2 /m  k_e = rgb(1, 0.4, 0.2) * (1 lx / m) }";
    for (count, media) in [(70_000, ""), (700, gas)] {
        let list: Vec<One> = (0..count).map(|_| thin(&mut x, 3.0 / f64::from(count))).collect();
        let Some(off) = agrees(&format!("{view}\n{media}"), &file(&list, 0, false)) else { return };
        println!("{count}: {off:.1e}");
    }
}

#[test]
fn rays_by_hand_meet_the_same_splats() {
    let splats = file(&some(60, 23), 3, false);
    let text = format!("{VIEW}\nfog {{ k = 0.2 /m  color = #aabbcc }}");
    let rays: Vec<RayQuery> = (0..20)
        .map(|i| {
            let angle = f64::from(i) * 0.7;
            RayQuery { origin: [0.2 * angle.sin(), 0.1, -2.0], direction: [0.3 * angle.cos(), 0.2 * angle.sin(), 1.0] }
        })
        .collect();
    let answers = |engine: EngineChoice| {
        let mut session = session(&text, &splats, engine, Options::probe())?;
        let params = Params::defaults(&session.program().lowered);
        Some(session.probe(&params, &rays, &ProbeSettings::default()).unwrap_or_else(|t| fail(Path::new("s"), &t)))
    };
    let Some(gpu) = answers(EngineChoice::Gpu) else { return };
    for (found, wanted) in gpu.iter().zip(answers(EngineChoice::Reference).expect("always there")) {
        for band in 0..3 {
            let off = (found.radiance[band] - wanted.radiance[band]).abs();
            assert!(off <= found.error[band] + 2e-5, "{found:?} {wanted:?}");
        }
    }
}

#[test]
fn the_bonsai_on_the_gpu() {
    let path = root().join("examples/splats/bonsai.vol");
    let mut options = Options { size: Some([40, 40]), ..Options::default() };
    options.outputs.push(OutputKind::Edge);
    // Nobody needs to choose.
    let Some(mut session) = open(&path, options, EngineChoice::Gpu) else { return };
    assert_eq!(session.program().plan.backend, "splatting");
    let drawing = draw(&path, &mut session);
    let measured = session.measure(&drawing, 256, 1).unwrap_or_else(|t| fail(&path, &t));
    println!("{measured:?}, predicted {:?}", drawing.predicted);
    assert!(measured.within(), "{measured:?}");
    let predicted = drawing.predicted.expect("it is said").0;
    assert!(measured.max <= predicted + measured.reference_error, "{measured:?} {predicted}");
    assert!(predicted < 5e-3, "{predicted}");
    // As it looked, by the measure of `pictures`.
    let options = Options { size: Some([96, 96]), aa: Some(Aa::None), ..Options::default() };
    let drawing = draw(&path, &mut open(&path, options, EngineChoice::Gpu).expect("it was there"));
    let kept = root().join("tests/pictures/bonsai.png");
    if std::env::var_os("TYNDALL_UPDATE_PICTURES").is_some() {
        write_png(&kept, &drawing.picture, &WriteOptions::default()).expect("the picture can be kept");
    }
    let kept = read_png(&kept).unwrap_or_else(|e| panic!("{e:?}"));
    let now = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bonsai.png");
    write_png(&now, &drawing.picture, &WriteOptions::default()).expect("a scratch folder");
    let flip = compare(&kept, &read_png(&now).unwrap_or_else(|e| panic!("{e:?}"))).expect("one size").flip;
    assert!(flip <= 0.01, "mean FLIP {flip}");
}

#[test]
fn other_backends_name_the_one_that_draws_splats() {
    let path = root().join("examples/splats/bonsai.vol");
    for backend in [Backend::Raymarch, Backend::Slicing] {
        let options = Options { backend: Some(backend), ..Options::default() };
        let found: Vec<_> = codes(&path, &options);
        assert!(found.contains(&"E0530"), "{found:?}");
        let loader = FileLoader::new(root().join("examples/splats"));
        let out = compile("bonsai.vol", &tyndall_tests::text(&path), &loader, &options);
        let said = compiler::diagnostic::render(&out.diagnostics, &out.sources);
        assert!(said.contains("splatting"), "{said}");
    }
    // As many Gaussians of media as somebody asks for have no place there.
    let options = Options { splats: Some(1000), ..Options::default() };
    assert_eq!(codes(&path, &options), ["E0530"]);
}

/// What is compiled for splats without media and for those in fog.
#[test]
fn code_for_splats() {
    let splats = file(&some(3, 1), 0, false);
    let shown = |text: &str| {
        let out = compile("scene.vol", text, &Made(splats.clone()), &Options::default());
        let program =
            out.program.unwrap_or_else(|| panic!("{}", compiler::diagnostic::render(&out.diagnostics, &out.sources)));
        let blend = program.kernels.iter().find(|k| k.name == "blend").expect("it is there");
        let wgsl = compiler::emit::emit(blend).expect("it is valid").wgsl().expect("WGSL");
        (compiler::program::print_plan(&program), wgsl)
    };
    let linear = "splats room { file = \"s.ply\"  blend = linear }  camera { from = (0, 0, -3) m  to = (0, 0, 0) m }";
    let (plan, code) = shown(linear);
    assert!(!code.contains("srgb_encode"), "{code}");
    insta::assert_snapshot!("splats_linear_plan", plan);
    insta::assert_snapshot!("splats_linear", code);
    let fog = format!("{linear} fog {{ k = 0.3 /m  color = #c8d0d8 }}").replace("linear", "encoded");
    insta::assert_snapshot!("splats_in_fog", shown(&fog).1);
}
