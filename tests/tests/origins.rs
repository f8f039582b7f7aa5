//! Where errors come from, as backends and engines tell it: the parts are the whole, each is what its name says, and none is less than
//! what can be measured of it.

use compiler::Options;
use compiler::ir::{Aa, Backend, Scattering};
use compiler::program::{OutputKind, Precision};
use runtime::frame::{Drawing, EngineChoice, FileLoader, Origins, Session, Settings};
use std::path::Path;
use tyndall_tests::{draw, fail, open, open_text, root};

const EYE: &str = "camera { from = (0, 0.1, -4) m  to = (0, 0, 0) m  fov = 40 deg }";
const SHAPE: &str = "shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)";

/// Everywhere the same: it has a closed form.
fn even() -> String {
    format!("medium even {{ {SHAPE}  k_a = 2 /m  k_e = 3 lx / m }}\n{EYE}")
}

/// It has none.
fn wavy(k_a: &str) -> String {
    let waves = "density = 1 + 0.9 * sin(20 * p.x / 1 m) * sin(8 * p.y / 1 m + 30 * p.z / 1 m)";
    format!("medium waves {{ {SHAPE}  {waves}  k_a = {k_a}  k_e = 3 lx / m }}\n{EYE}")
}

/// A smooth ball so many metres from the origin of everything.
fn far(x: f64) -> String {
    format!(
        "medium blob {{ shape = sphere(center: ({x}, 0, 0) m, radius: 1 m)  density = exp(-((p.x - {x} m)^2 + p.y^2 + p.z^2) / (0.5 m)^2)\n\
         k_a = 1 /m  k_e = 3 lx / m }}\ncamera {{ from = ({x}, 0, -4) m  to = ({x}, 0, 0) m  fov = 40 deg }}"
    )
}

/// The parts of an error, which are the whole, or bound it.
fn parts(drawing: &Drawing) -> Origins {
    let origins = drawing.origins.expect("it is told apart");
    let largest = drawing.predicted.expect("an error").0;
    let Origins { discretisation, rounding, storage, statistical } = origins;
    let each = [discretisation, rounding, storage, statistical];
    // Of every pixel they are the whole error, so that the largest of each is no more than that and no less together.
    assert!(each.iter().all(|e| (0.0..=1.0001 * largest).contains(e)), "{origins:?}, {largest}");
    assert!(each.iter().sum::<f64>() >= 0.9999 * largest, "{origins:?}, {largest}");
    origins
}

fn asked(options: Options) -> Options {
    let outputs = [OutputKind::Radiance, OutputKind::Error, OutputKind::Rounding, OutputKind::Storage];
    Options { outputs: outputs.to_vec(), size: Some([32, 32]), aa: Some(Aa::None), ..options }
}

/// A picture with its errors told apart.
fn told(text: &str, options: Options) -> Option<(Drawing, Origins)> {
    let drawing = draw(Path::new("scene.vol"), &mut open_text(text, asked(options))?);
    let origins = parts(&drawing);
    Some((drawing, origins))
}

/// The same in f64.
fn told_in_f64(text: &str, engine: EngineChoice, options: Options) -> (Drawing, Origins) {
    let settings = Settings { options, engine, ..Settings::default() };
    let session = Session::open("scene.vol", text, &FileLoader::new(Path::new(".")), settings);
    let drawing = draw(Path::new("scene.vol"), &mut session.unwrap_or_else(|t| fail(Path::new("scene.vol"), &t)));
    let origins = parts(&drawing);
    (drawing, origins)
}

fn by(backend: Backend) -> Options {
    Options { backend: Some(backend), ..Options::default() }
}

fn to(accuracy: f64, options: Options) -> Options {
    Options { accuracy: Some(accuracy), ..options }
}

/// The largest difference of two pictures, in lx.
fn apart(a: &Drawing, b: &Drawing) -> f64 {
    let pairs = a.picture.radiance().iter().zip(b.picture.radiance());
    pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
}

#[test]
fn by_marching() {
    // Nothing but rounding is wrong with what has a closed form.
    let Some((_, closed)) = told(&even(), Options::default()) else { return };
    assert!(closed.rounding > 0.0 && closed.discretisation < 1e-9 && closed.storage == 0.0, "{closed:?}");
    // Shorter steps make up for the rule, and for nothing else.
    let at = |text: &str, accuracy| told(text, to(accuracy, Options::default())).expect("seen above");
    let ((_, rough), (_, fine)) = (at(&wavy("0.4 /m"), 1e-2), at(&wavy("0.4 /m"), 1e-4));
    assert!(fine.discretisation < 0.1 * rough.discretisation, "{rough:?}, {fine:?}");
    assert!((0.2..5.0).contains(&(fine.rounding / rough.rounding)), "{rough:?}, {fine:?}");
    assert!(rough.storage == 0.0, "nothing is opaque or empty here: {rough:?}");
    // Where light from behind is given up, it counts as storage, and no more than accuracy lets it.
    let (drawing, dense) = at(&wavy("40 /m"), 1e-2);
    let bright = drawing.picture.radiance().iter().fold(1.0f32, |m, v| m.max(*v));
    assert!(dense.storage > 0.0 && dense.storage < 1e-2 * f64::from(bright), "{dense:?}");
    // Far from the origin of everything, f32 is coarse: ten thousand times as far, it loses as many digits.
    let ((_, near), (_, far)) = (at(&far(0.0), 1e-3), at(&far(1e4), 1e-3));
    assert!(far.rounding > 30.0 * near.rounding, "{near:?}, {far:?}");
}

#[test]
fn by_slicing() {
    let slicing = || by(Backend::Slicing);
    let Some((single, closed)) = told(&even(), slicing()) else { return };
    assert!(closed.rounding > 0.0 && closed.discretisation < 1e-9 && closed.storage == 0.0, "{closed:?}");
    // The same form in f64 tells what f32 made of it.
    let exact = told_in_f64(&even(), EngineChoice::Cpu, asked(Options::default())).0;
    assert!(apart(&single, &exact) <= closed.rounding, "{} {closed:?}", apart(&single, &exact));
    // Targets of f16 store less than was blended into them, and what they lose is no more than is said.
    let half = Options { blending: Precision::Half, ..slicing() };
    let (kept, stored) = told(&even(), half).expect("seen above");
    assert!(stored.storage > 100.0 * stored.rounding && stored.discretisation < 1e-9, "{stored:?}");
    let lost = apart(&kept, &single);
    assert!(lost > closed.rounding && lost <= stored.storage, "{lost} {stored:?}");
    // More slabs make up for the rule.
    let at = |text: &str, accuracy| told(text, to(accuracy, slicing())).expect("seen above").1;
    let (rough, fine) = (at(&wavy("0.4 /m"), 3e-1), at(&wavy("0.4 /m"), 1e-3));
    assert!(fine.discretisation < 0.1 * rough.discretisation && rough.storage == 0.0, "{rough:?}, {fine:?}");
    let (near, far) = (at(&far(0.0), 1e-2), at(&far(1e5), 1e-2));
    assert!(far.rounding > 30.0 * near.rounding, "{near:?}, {far:?}");
    // Of a number of slabs that was asked for nothing is known.
    let asked_for = Options { slices: Some(64), ..slicing() };
    let drawing = draw(Path::new("s"), &mut open_text(&wavy("0.4 /m"), asked(asked_for)).expect("seen above"));
    assert!(drawing.predicted.is_none() && drawing.origins.is_none() && drawing.errors.is_empty());
}

#[test]
fn of_steps_that_were_asked_for_nothing_is_told() {
    let Some(mut session) = open_text(&wavy("0.4 /m"), asked(Options { steps: Some(4), ..Options::default() })) else {
        return;
    };
    let drawing = draw(Path::new("s"), &mut session);
    assert!(drawing.predicted.is_none() && drawing.origins.is_none() && drawing.errors.is_empty());
}

#[test]
fn by_splatting() {
    let at = |splats| told(&far(0.0), Options { splats: Some(splats), ..by(Backend::Splatting) });
    let Some((drawing, rough)) = at(4096) else { return };
    let (_, fine) = at(65536).expect("seen above");
    // What a lattice is wrong by shrinks with its spacing, what rounding is grows with the number of Gaussians, and what lies beyond
    // billboards does neither.
    assert!(fine.discretisation < 0.5 * rough.discretisation, "{rough:?}, {fine:?}");
    assert!(fine.rounding > rough.rounding && rough.rounding > 0.0, "{rough:?}, {fine:?}");
    let brightest = f64::from(drawing.picture.radiance().iter().fold(0.0f32, |m, v| m.max(*v)));
    let cut = compiler::program::SPLAT_CUT * brightest;
    assert!((rough.storage / cut - 1.0).abs() < 1e-6 && (fine.storage / cut - 1.0).abs() < 0.5, "{rough:?}, {fine:?}");
}

#[test]
fn of_splats_of_files() {
    let path = root().join("examples/splats/bonsai.vol");
    let Some(mut session) = open(&path, asked(Options::default()), EngineChoice::Gpu) else { return };
    let drawing = draw(&path, &mut session);
    let origins = parts(&drawing);
    // Nothing is integrated by steps there; faint splats are left out of lists, and places in the picture are rounded.
    assert!(origins.discretisation < 0.1 * (origins.rounding + origins.storage), "{origins:?}");
    assert!(origins.rounding > 0.0 && origins.storage > 0.0, "{origins:?}");
    let measured = session.measure(&drawing, 64, 1).unwrap_or_else(|t| fail(&path, &t));
    assert!(
        measured.max <= drawing.predicted.expect("it is said").0 + measured.reference_error,
        "{measured:?} {origins:?}"
    );
}

#[test]
fn in_f64() {
    let at = |steps| {
        let options = asked(Options { steps: Some(steps), ..Options::default() });
        told_in_f64(&wavy("0.4 /m"), EngineChoice::Cpu, options)
    };
    let ((drawing, rough), (_, fine)) = (at(32), at(256));
    assert!(fine.discretisation < 0.05 * rough.discretisation, "{rough:?}, {fine:?}");
    assert!(rough.rounding > 0.0 && rough.rounding < 1e-13 && fine.rounding < 1e-13, "{rough:?}, {fine:?}");
    // A picture keeps f32 of them: half a unit in the last place.
    let brightest = f64::from(drawing.picture.radiance().iter().fold(0.0f32, |m, v| m.max(*v)));
    let kept = brightest * 0.5 * f64::from(f32::EPSILON);
    assert!((rough.storage / kept - 1.0).abs() < 1e-3, "{rough:?} {kept}");
    // A million times as far away, where a medium begins and ends is known to as many digits less.
    let from = |z: f64| {
        let medium = far(0.0).split("camera").next().expect("there is a medium").to_owned();
        let scene = format!("{medium}camera {{ from = (0, 0, -{z}) m  to = (0, 0, 0) m  fov = {} deg }}", 160.0 / z);
        let options = Options { size: Some([6, 6]), ..asked(Options::default()) };
        told_in_f64(&scene, EngineChoice::Reference, options).1
    };
    let (near, far) = (from(4.0), from(4e6));
    assert!(far.rounding > 1e3 * near.rounding && far.rounding > 3.0 * far.discretisation, "{near:?}, {far:?}");
}

/// Random paths integrate nothing by steps; what they are wrong by is chance.
#[test]
fn by_chance() {
    let scene = "medium milk { shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_s = 3 /m  k_a = 0.3 /m }
light sun { direction = (1, -1, 0.5)  irradiance = 5 lx }
camera { from = (0, 0, -4) m  to = (0, 0, 0) m  fov = 22 deg }";
    let paths = |samples| {
        let scattering = Some(Scattering::Multiple);
        Options { samples: Some(samples), scattering, ..Options::default() }
    };
    let check = |few: &Origins, many: &Origins| {
        let ratio = few.statistical / many.statistical;
        assert!((1.5..6.0).contains(&ratio), "{few:?}, {many:?}");
        assert!(few.discretisation == 0.0 && few.rounding > 0.0 && few.rounding < 1e-3 * few.statistical, "{few:?}");
    };
    let small = |options: Options| Options { size: Some([6, 4]), ..asked(options) };
    let in_f64 = |samples| told_in_f64(scene, EngineChoice::Cpu, small(paths(samples))).1;
    check(&in_f64(64), &in_f64(512));
    let Some((_, few)) = told(scene, paths(64)) else { return };
    check(&few, &told(scene, paths(512)).expect("seen above").1);
}
