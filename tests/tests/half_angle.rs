//! Light that is followed from slab to slab: what it promises beyond what every backend does.

use compiler::Options;
use compiler::ir::{Aa, Backend, Scattering, Stacks};
use compiler::program::{Precision, print_plan};
use compiler::trial::Change;
use runtime::frame::{Drawing, EngineChoice, FileLoader, Params, Session, Settings};
use std::path::Path;
use tyndall_tests::{codes, codes_of, draw, every_scene, fail, open, open_text};

fn halves() -> Options {
    let backend = Some(Backend::Slicing);
    Options { backend, stacks: Some(Stacks::HalfAngle), aa: Some(Aa::None), ..Options::default() }
}

fn drawn(text: &str, options: Options) -> Option<Drawing> {
    Some(draw(Path::new("scene.vol"), &mut open_text(text, options)?))
}

/// As the reference engine sees it.
fn referred(text: &str) -> Drawing {
    let options = Options { aa: Some(Aa::None), accuracy: Some(1e-6), ..Options::default() };
    let settings = Settings { options, engine: EngineChoice::Reference, ..Settings::default() };
    let session = Session::open("scene.vol", text, &FileLoader::new(Path::new(".")), settings);
    draw(Path::new("scene.vol"), &mut session.unwrap_or_else(|t| fail(Path::new("scene.vol"), &t)))
}

/// Root mean square and largest difference.
fn apart(a: &[f32], b: &[f32]) -> (f64, f64) {
    assert_eq!(a.len(), b.len());
    let off = || a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs()));
    ((off().map(|d| d * d).sum::<f64>() / a.len() as f64).sqrt(), off().fold(0.0, f64::max))
}

/// Draws a scene to an accuracy and compares every pixel with the reference: no more may be wrong anywhere than is reported of the picture,
/// and of nearly all pixels no more than is reported of themselves and a hundredth of what is allowed (pictures of two numbers of slabs may be
/// alike at one by chance).
fn agree(what: &str, text: &str, accuracy: f64) {
    let options = Options { accuracy: Some(accuracy), ..halves() };
    let Some(ours) = drawn(text, options) else { return };
    let exact = referred(text);
    let (a, b) = (ours.picture.radiance(), exact.picture.radiance());
    let bands = a.len() / ours.errors.len();
    let off = |i: usize| (i * bands..(i + 1) * bands).map(|j| (a[j] - b[j]).abs()).fold(0.0, f32::max);
    let offs: Vec<f32> = (0..ours.errors.len()).map(off).collect();
    let worst = offs.iter().copied().fold(0.0, f32::max);
    let beyond = offs
        .iter()
        .zip(&ours.errors)
        .filter(|(off, said)| f64::from(**off) > f64::from(**said) + 1e-2 * accuracy)
        .count();
    let bright = a.iter().copied().fold(0.0, f32::max);
    let (most, share) = ours.predicted.expect("slabs are compared");
    println!(
        "{what}: {:?} slabs, off by {worst:.2e}, reported {most:.2e}, brightest {bright:.2}, {beyond} beyond",
        ours.slabs
    );
    assert!(f64::from(worst) <= most, "{what}: {worst} of {most} that is reported");
    assert!(beyond * 10 <= offs.len(), "{what}: {beyond} pixels are worse than reported");
    assert!(share < 3.0, "{what}: {share} of what accuracy allows");
    let [ours, exact] = [&ours, &exact].map(|d| d.picture.transmittance().expect("it is asked for"));
    assert!(apart(ours, exact).1 < 2.0 * accuracy, "{what}: transmittance off by {}", apart(ours, exact).1);
    assert!(ours.iter().copied().fold(1.0, f32::min) < 0.9, "{what}: something is seen");
}

const MIST: &str = "
    medium mist {
        shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)
        k_s = rgb(0.6, 1, 1.5) / m * (1 + 0.8 * sin(3 * p.x / 1 m) * cos(2 * p.y / 1 m + 2 * p.z / 1 m))
        k_a = 0.2 / m * (1 + 0.5 * sin(2 * p.y / 1 m))
        phase = henyey_greenstein(0.4)
    }
    image { size = 12 x 9  aa = none  background = #203040 }
";

const FRONT: &str = "camera { from = (0.9, 0.6, -4) m  to = (0,0,0) m  fov = 42 deg }";

fn sun(direction: &str) -> String {
    format!("light sun {{ direction = {direction}  irradiance = 6 lx }}")
}

/// Light from beside, from behind the eye, towards it, along the axes of the box, and exactly with and against the view.
#[test]
fn light_from_all_sides() {
    for direction in [
        "(0.3, -1, 0.6)",
        "(-0.2, -0.3, 1)",
        "(0.2, -0.3, -1)",
        "(0, -1, 0)",
        "(1, 0, 0)",
        "(-0.9, -0.6, 4)",
        "(0.9, 0.6, -4)",
    ] {
        agree(direction, &format!("{MIST}{FRONT}{}", sun(direction)), 1e-2);
    }
}

#[test]
fn cameras_near_far_inside_wide_and_orthographic() {
    for camera in [
        "camera { from = (-0.3, -0.2, 0.1) m  to = (-1, 0, 0) m  fov = 60 deg }",
        "camera { from = (2, 1.5, -3) m  to = (0,0,0) m  projection = orthographic(height: 2.8 m) }",
        "camera { from = (1e5, 2e4, 3e4) m  to = (0,0,0) m  fov = 0.002 deg }",
        // So wide that planes across half the angle are met from both sides.
        "camera { from = (0.1, 0.2, -1.3) m  to = (0.4, -0.1, 0) m  fov = 120 deg }",
        "camera { from = (0.1, 0.2, 0.3) m  to = (0.4, -0.1, 1) m  fov = 130 deg }",
    ] {
        agree(camera, &format!("{MIST}{camera}{}", sun("(0.3, -1, 0.1)")), 1e-2);
    }
}

#[test]
fn lamps_outside_of_the_media() {
    for light in [
        "light lamp { position = (0.5, 2.5, 0.3) m  intensity = 20 lx * m^2 }",
        "light lamp { position = (-1, 1.6, -2) m  intensity = 20 lx * m^2 }",
        "light lamp { position = (0, 1.3, 0) m  intensity = 5 lx * m^2  radius = 0.1 m }",
        "light lamp { position = (300, 900, -200) m  intensity = 5e6 lx * m^2 }",
    ] {
        agree(light, &format!("{MIST}{FRONT}{light}"), 1e-2);
    }
}

/// One medium more, surfaces in the light, a lattice of voxels, more bands than a target holds.
#[test]
fn whatever_slabs_take_otherwise() {
    let light = sun("(0.4, -1, 0.3)");
    let ball = "surface ball { shape = sphere(center: (0.2, 0.9, 0.1) m, radius: 0.35 m)  albedo = 0.6 }";
    let floor = "surface floor { shape = plane(point: (0, -1.2, 0) m, normal: (0, 1, 0))  albedo = 0.5 }";
    let haze =
        "medium haze { shape = sphere(center: (0.3, 0, -0.4) m, radius: 1.1 m)  k_s = 0.4 /m  k_e = 0.02 lx / m }";
    let drops =
        "medium drops { shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)  k_s = 0.5 /m * (1 + sin(4 * p.y / 1 m)) }";
    for parts in [haze, drops, ball, floor, &format!("{ball} {floor} {haze}")] {
        agree(parts, &format!("{MIST}{FRONT}{light}{parts}"), 1e-2);
    }
    let grey = MIST.replace("rgb(0.6, 1, 1.5)", "1");
    agree("one transmittance", &format!("{grey}{FRONT}{light}"), 1e-2);
    agree("one band", &format!("{grey}{FRONT}{light}").replace("aa = none", "aa = none  bands = gray"), 1e-2);
    agree("six bands", &format!("{MIST}{FRONT}{light}").replace("aa = none", "aa = none  bands = spectral(6)"), 1e-2);
    agree("four bands", &format!("{MIST}{FRONT}{light}").replace("aa = none", "aa = none  bands = spectral(4)"), 1e-2);
}

/// Coefficients that vary across one axis only, with closed forms that the compiler does not know: k(y) = 1 + 0.8 sin 3y per metre.
const LAYERS: &str = "
    medium layers {
        shape = box(min: (-2, -1, -1) m, max: (2, 1, 1) m)
        k_s = 0.7 /m * (1 + 0.8 * sin(3 * AXIS / 1 m))
        k_a = 0.3 /m * (1 + 0.8 * sin(3 * AXIS / 1 m))
    }
    camera { from = (0, 0, -9) m  to = (0,0,0) m  projection = orthographic(height: 2 m) }
    image { size = 128 x 128  aa = none }
";

/// ∫ k from a to b.
fn depth(a: f64, b: f64) -> f64 {
    b - a + 0.8 / 3.0 * ((3.0 * a).cos() - (3.0 * b).cos())
}

/// Light down through layers, straight and slanting, while the view goes along them; along the view and against it, with layers
/// across. What is scattered is 0.7/4π of 8 lx; e^(−τ) towards the light is constant along the ray, or follows from the depth on it.
#[test]
fn light_through_layers_has_closed_forms() {
    let share = 8.0 * 0.7 / (4.0 * std::f64::consts::PI);
    let total = depth(-1.0, 1.0);
    let k = |y: f64| 1.0 + 0.8 * (3.0 * y).sin();
    let across = |y: f64, cosine: f64| (-depth(y, 1.0) / cosine).exp() * (1.0 - (-2.0 * k(y)).exp());
    let slant = 1.0 / 1.25f64.sqrt();
    let cases: [(&str, &str, &dyn Fn(f64) -> f64); 4] = [
        ("(0, -1, 0)", "p.y", &|y| across(y, 1.0)),
        ("(0.5, -1, 0)", "p.y", &|y| across(y, slant)),
        ("(0, 0, 1)", "p.z", &|_| (1.0 - (-2.0 * total).exp()) / 2.0),
        ("(0, 0, -1)", "p.z", &|_| total * (-total).exp()),
    ];
    for (direction, axis, exact) in cases {
        let sun = format!("light sun {{ direction = {direction}  irradiance = 8 lx }}");
        let text = format!("{}{sun}", LAYERS.replace("AXIS", axis));
        let mut errors = vec![];
        for slices in [16, 32, 64] {
            let Some(drawing) = drawn(&text, Options { slices: Some(slices), ..halves() }) else { return };
            let off = |(i, pixel): (usize, &[f32])| {
                let y = 1.0 - ((i / 128) as f64 + 0.5) / 64.0;
                // Where a ray goes along a face within a slab of it, all of it is at the crease there.
                if y > 0.9 {
                    return 0.0;
                }
                (f64::from(pixel[0]) - share * exact(y)).abs()
            };
            let pixels = drawing.picture.radiance().chunks(3).enumerate();
            errors.push(pixels.map(off).fold(0.0, f64::max));
        }
        let slope = (errors[2] / errors[0]).log2() / 2.0;
        println!("{direction} along {axis}: {errors:?}, slope {slope:.2}");
        assert!(errors[2] < 1e-3 && slope < -1.7, "{direction}: {errors:?}, slope {slope}");
    }
}

/// Slabs of half the thickness leave a quarter of the error, where fields are smooth.
#[test]
fn errors_fall_with_the_square_of_the_thickness() {
    let inside = "sphere(center: (0,0,0) m, radius: 1.2 m)  density = max(0, 1 - length(p)^2 / 1.44 m^2)^2";
    let ball = MIST.replace("box(min: (-1, -1, -1) m, max: (1, 1, 1) m)", inside);
    for light in [sun("(0.3, -1, 0.6)"), "light lamp { position = (-1, 2.2, -1.5) m  intensity = 20 lx * m^2 }".into()]
    {
        let text = format!("{ball}{FRONT}{light}");
        let mut errors = vec![];
        let exact = referred(&text);
        for slices in [16, 32, 64] {
            let Some(drawing) = drawn(&text, Options { slices: Some(slices), ..halves() }) else { return };
            errors.push(apart(drawing.picture.radiance(), exact.picture.radiance()).0);
        }
        let slope = (errors[2] / errors[0]).log2() / 2.0;
        println!("{light}: {errors:?}, slope {slope:.2}");
        assert!(slope < -1.6 && errors[2] < 1e-3, "{errors:?}, slope {slope}");
    }
}

/// What is said of scenes whose light cannot be followed so, word for word.
#[test]
fn what_light_cannot_be_followed_is_said() {
    let light = sun("(0, -1, 0)");
    let cases = [
        ("no light", MIST.to_owned()),
        ("two lights", format!("{MIST}{light}\n{}", sun("(1, 0, 0)").replace("sun", "other"))),
        ("a disc", format!("{MIST}{}", light.replace("lx }", "lx  angular_diameter = 0.5 deg }"))),
        ("a sky", format!("{MIST}{light}\nlight sky {{ environment = 1 lx }}")),
        ("no scattering", format!("{MIST}{light}\nrender {{ scattering = none }}")),
    ];
    let mut said = String::new();
    for (what, text) in cases {
        let out = compiler::compile("scene.vol", &text, &FileLoader::new(Path::new(".")), &halves());
        said += &format!("{what}\n{}\n", compiler::diagnostic::render(&out.diagnostics, &out.sources));
        // A list of rays has no common planes, whatever stands in the scene.
        let options = Options { backend: Some(Backend::Slicing), stacks: Some(Stacks::HalfAngle), ..Options::probe() };
        assert!(codes_of(&text, &options).is_empty(), "{what}");
    }
    let half = Options { blending: Precision::Half, ..halves() };
    let text = format!("{MIST}{light}");
    let out = compiler::compile("scene.vol", &text, &FileLoader::new(Path::new(".")), &half);
    said += &format!("f16\n{}\n", compiler::diagnostic::render(&out.diagnostics, &out.sources));
    let unused = format!("{MIST}{light}\nrender {{ backend = raymarch  stacks = half_angle }}");
    let out = compiler::compile("scene.vol", &unused, &FileLoader::new(Path::new(".")), &Options::default());
    said += &format!("another backend\n{}\n", compiler::diagnostic::render(&out.diagnostics, &out.sources));
    let within = format!("{MIST}{FRONT}light lamp {{ position = (0.2, 0.3, 0) m  intensity = 1 lx * m^2 }}");
    let Some(mut session) = open_text(&within, halves()) else { return };
    let params = Params::defaults(&session.program().lowered);
    let trouble = session.draw(&params, 0.0, &|_| {}).expect_err("the lamp is in the mist");
    said += &format!("a lamp within\n{}", compiler::diagnostic::render(&trouble.diagnostics, &trouble.sources));
    insta::assert_snapshot!(said);
}

/// The plan draws slabs by turns; what it leaves out is in the ledger, and so is the buffer where nothing needs it.
#[test]
fn the_plan_says_whose_turn_it_is() {
    let text = format!("{MIST}{FRONT}{}", sun("(0.3, -1, 0.6)"));
    let Some(session) = open_text(&text, Options { backend: None, ..halves() }) else { return };
    let program = session.program();
    let kernel = program.kernels.iter().find(|k| k.name == "light").expect("light is drawn");
    let wgsl = compiler::emit::emit(kernel).expect("it can be").wgsl().expect("WGSL");
    insta::assert_snapshot!(format!("{}\n{wgsl}", print_plan(program)));
    assert!(program.ledger.0.iter().any(|o| o.feature.starts_with("columns of light")));
    let closed = "medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_s = 1 /m }";
    let text = format!("{closed}{FRONT}{} image {{ size = 12 x 9  aa = none }}", sun("(0.3, -1, 0.6)"));
    let session = open_text(&text, halves()).expect("as before");
    let program = session.program();
    assert!(program.plan.light.is_none() && program.ledger.0.iter().any(|o| o.feature == "buffer of light"));
    agree("closed forms", &text, 1e-2);
}

/// Where light does not come through a slab, twice as many are as dark: that must be told by other means. And a hundredth of the matter is hardly seen.
#[test]
fn opaque_and_clear_media_keep_their_word() {
    let text = format!("{MIST}{FRONT}{}", sun("(0.3, -1, 0.6)"));
    for factor in [1e-2, 1e6] {
        let change = Some(Change::Matter(factor));
        let Some(ours) = drawn(&text, Options { change, slices: None, ..halves() }) else { return };
        let reference = Options { aa: Some(Aa::None), change, ..Options::default() };
        let settings = Settings { options: reference, engine: EngineChoice::Reference, ..Settings::default() };
        let session = Session::open("scene.vol", &text, &FileLoader::new(Path::new(".")), settings);
        let exact = draw(Path::new("scene.vol"), &mut session.unwrap_or_else(|t| fail(Path::new("scene.vol"), &t)));
        let pixels = ours.picture.radiance().chunks(3).zip(exact.picture.radiance().chunks(3)).zip(&ours.errors);
        let (mut beyond, mut worst) = (0, 0.0f32);
        for ((a, b), said) in pixels {
            assert!(a.iter().all(|v| v.is_finite() && *v >= 0.0));
            let off = a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
            beyond += usize::from(off > said + 1e-4);
            worst = worst.max(off);
        }
        println!(
            "matter times {factor:e}: {:?} slabs, off by {worst:.2e}, of {:?}, {beyond} beyond",
            ours.slabs, ours.predicted
        );
        assert!(beyond <= 5 && f64::from(worst) <= ours.predicted.expect("compared").0, "{factor}: {beyond}, {worst}");
    }
}

/// Whatever of the suites has one light from one place, against the reference.
#[test]
fn scenes_of_the_suites() {
    let mut lit = vec![];
    for folder in ["light", "agree", "discs", "continuous", "same/single", "slabs"].map(|f| format!("tests/suite/{f}"))
    {
        every_scene(&folder, |path| {
            let options =
                Options { size: Some([9, 7]), accuracy: Some(1e-2), scattering: Some(Scattering::Single), ..halves() };
            let refused = codes(path, &options);
            if !refused.is_empty() {
                assert!(refused.iter().all(|c| ["E0530", "E0531"].contains(c)), "{}: {refused:?}", path.display());
                return Some(vec![]);
            }
            let mut session = open(path, options, EngineChoice::Gpu)?;
            let params = Params::defaults(&session.program().lowered);
            let drawing = match session.draw(&params, 0.0, &|_| {}) {
                Ok(drawing) => drawing,
                // A lamp among the media.
                Err(trouble) if trouble.diagnostics.iter().any(|d| d.code == "E0531") => return Some(vec![]),
                Err(trouble) => fail(path, &trouble),
            };
            let measured = session.measure(&drawing, 63, 1).unwrap_or_else(|t| fail(path, &t));
            let buffered = session.program().plan.light.is_some();
            // And places on surfaces, which are rounded.
            let said = drawing.predicted.expect("slabs are compared").0 + measured.reference_error + 1e-4;
            println!(
                "{}: buffer {buffered}, {:?} slabs, {:.2e} of {said:.2e}",
                path.display(),
                drawing.slabs,
                measured.max
            );
            lit.push(buffered);
            let wrong = measured.max > said;
            Some(wrong.then(|| format!("{:e} lx, and {said:e} is reported", measured.max)).into_iter().collect())
        });
    }
    assert!(lit.is_empty() || (lit.len() > 5 && lit.iter().any(|b| *b)), "{lit:?}");
}
