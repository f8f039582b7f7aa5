//! Scenes from text to numbers, through sessions.

use super::*;
use crate::engine::gpu::GpuErrorKind;
use compiler::Options;
use compiler::diagnostic::Severity;

/// A session on an engine, or `None` where there is no adapter for it.
fn open(text: &str, engine: EngineChoice, options: Options) -> Option<Session> {
    let settings = Settings { options, engine, ..Settings::default() };
    match Session::open("test.vol", text, &FileLoader::default(), settings) {
        Ok(session) => Some(session),
        Err(trouble) if trouble.diagnostics.iter().any(|d| d.code == GpuErrorKind::NoAdapter.code()) => {
            crate::engine::skip_without_adapter();
            None
        }
        Err(trouble) => panic!("{}", compiler::diagnostic::render(&trouble.diagnostics, &trouble.sources)),
    }
}

fn draw(session: &mut Session, sets: &[&str]) -> Drawing {
    let (params, found) = session.params(sets).expect("they fit");
    assert!(found.0.is_empty(), "{found:?}");
    session.draw(&params, 0.0, &|_| {}).expect("draws")
}

const BALL: &str = "
param absorption = 2 /m
param from = (0, 0, -4) m
medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_a = absorption  k_e = 3 lx / m }
camera { from = from  to = (0,0,0) m  fov = 40 deg }
image { size = 31 x 31  aa = none }
";

#[test]
fn parameters_change_the_picture_and_compile_nothing() {
    let Some(mut session) = open(BALL, EngineChoice::Gpu, Options::default()) else { return };
    let compiled = session.pipelines_created();
    for (set, k) in
        [("absorption=2", 2.0), ("absorption=0.5 /m", 0.5), ("absorption = 30 /km", 0.03), ("absorption=1e30", 1e30)]
    {
        let drawing = draw(&mut session, &[set]);
        let expected = 3.0 / k * -f64::exp_m1(-2.0 * k);
        let middle = f64::from(drawing.picture.pixel(15, 15)[0]);
        assert!((middle - expected).abs() < 1e-4 * expected.max(1.0), "{set}: {middle} is not {expected}");
    }
    assert_eq!(session.pipelines_created(), compiled);
}

#[test]
fn a_far_eye_sees_what_the_processor_sees() {
    for distance in ["-3 m", "-100 km", "-1e9 km"] {
        let sets = format!("from=(0.3 m, -0.2 m, {distance})");
        let scale = if distance == "-3 m" { "40 deg" } else { "1e-3 deg" };
        let text = BALL.replace("40 deg", scale);
        let Some(mut gpu) = open(&text, EngineChoice::Gpu, Options::default()) else { return };
        let Some(mut cpu) = open(&text, EngineChoice::Cpu, Options::default()) else { return };
        let (a, b) = (draw(&mut gpu, &[&sets]), draw(&mut cpu, &[&sets]));
        let far = a.picture.radiance().iter().zip(b.picture.radiance());
        let wrong = far.filter(|(a, b)| (**a - **b).abs() > 1e-4).count();
        // The silhouette goes through few pixels' centres to the last bit.
        assert!(wrong <= 3, "{distance}: {wrong} numbers differ");
    }
}

#[test]
fn rays_of_a_probe_may_start_anywhere() {
    let rays: Vec<RayQuery> = [
        ([0.0, 0.0, -4.0], [0.0, 0.0, 1.0]),
        ([0.5, 0.0, -1e9], [0.0, 0.0, 3.0]),
        ([0.25, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ([0.0, 0.0, 4.0], [0.0, 0.0, 1.0]),
    ]
    .map(|(origin, direction)| RayQuery { origin, direction })
    .into();
    let lengths = [2.0, 2.0 * 0.75f64.sqrt(), 1.25, 0.0];
    for engine in [EngineChoice::Gpu, EngineChoice::Cpu, EngineChoice::Reference] {
        let Some(mut session) = open(BALL, engine, Options::probe()) else { continue };
        let (params, _) = session.params::<&str>(&[]).expect("none");
        let answers = session.probe(&params, &rays, &ProbeSettings::default()).expect("traces");
        for (answer, length) in answers.iter().zip(lengths) {
            assert_eq!(answer.radiance.len(), 3);
            let tau = answer.optical_depth[0];
            assert!((tau - 2.0 * length).abs() < 1e-5, "{engine:?}: {tau} is not {}", 2.0 * length);
        }
    }
}

#[test]
fn faults_are_told_once_with_a_place_in_metres() {
    let text = BALL.replace("k_a = absorption", "k_a = absorption * (0.5 - p.x / 1 km * 1000)");
    let outputs = vec![compiler::program::OutputKind::Radiance, compiler::program::OutputKind::Fault];
    let options = Options { outputs, ..Options::default() };
    let Some(mut session) = open(&text, EngineChoice::Gpu, options) else { return };
    let drawing = draw(&mut session, &[]);
    let [fault] = drawing.faults.0.as_slice() else { panic!("{:?}", drawing.faults) };
    assert_eq!((fault.code, fault.severity), ("E0650", Severity::Error));
    assert!(fault.message.contains("`k_a` of `ball`") && fault.message.ends_with("pixels"), "{}", fault.message);
    let x: f64 =
        fault.message.split_once("at (").and_then(|(_, r)| r.split(',').next()?.parse().ok()).expect("a place");
    assert!(x > 0.49 && x < 1.01, "{}", fault.message);
    assert!(fault.primary_span().is_some());
}

#[test]
fn sets_take_every_kind_of_value() {
    let text = "
param a = 1
param b = 2 km in 0 km .. 5 km
param c = (1, 2, 3) m
param d = #ff0000
param e = true
param f = 30 deg
medium thing { shape = sphere(center: c, radius: b)  k_a = if e then a * luminance(d) / m else f / m }
";
    let Some(session) = open(text, EngineChoice::Cpu, Options::default()) else { return };
    let scene = &session.program().lowered;
    let unit = scene.units.length;
    let set = |sets: &[&str]| Params::from_sets(scene, sets);
    let (defaults, _) = set(&[]);
    assert_eq!(defaults, Params::defaults(scene));
    let cases: [(&str, usize, Vec<f64>); 9] = [
        ("a=7", 0, vec![7.0]),
        ("a = 2 * 3", 0, vec![6.0]),
        ("b=3 km", 1, vec![3000.0 / unit]),
        ("b=250", 1, vec![250.0 / unit]),
        ("c=(1,0,-1) km", 2, vec![1000.0 / unit, 0.0, -1000.0 / unit]),
        ("d=#00ff00", 3, vec![0.0, 1.0, 0.0]),
        ("e=false", 4, vec![0.0]),
        ("f=180 deg", 5, vec![std::f64::consts::PI]),
        ("f=1", 5, vec![1.0]),
    ];
    for (text, index, expected) in cases {
        let (params, found) = set(&[text]);
        assert!(found.0.is_empty(), "{text}: {found:?}");
        assert_eq!(params.0[index].len(), expected.len(), "{text}");
        for (a, b) in params.0[index].iter().zip(&expected) {
            assert!((a - b).abs() <= 1e-12 * b.abs(), "{text}: {:?} is not {expected:?}", params.0[index]);
        }
    }
    for (text, code) in [
        ("a=1 m", "E0641"),
        ("a=true", "E0641"),
        ("e=1", "E0641"),
        ("d=1", "E0641"),
        ("c=#fff", "E0641"),
        ("a=nan", "E0641"),
        ("a=", "E0641"),
        ("a=1 +", "E0641"),
        ("a=1\nmedium x { }", "E0641"),
        ("g=1", "E0640"),
        ("b=6 km", "W0640"),
    ] {
        let (_, found) = set(&[text]);
        assert_eq!(found.0.iter().map(|d| d.code).collect::<Vec<_>>(), [code], "{text}: {found:?}");
    }
}

#[test]
fn bounds_hold_shapes_wherever_they_are_put() {
    let ball = |shape: &str, transform: &str| {
        let text = format!("medium thing {{ shape = {shape}  {transform}  k_a = 1 /m }}");
        let session = open(&text, EngineChoice::Cpu, Options::default())?;
        let scene = &session.program().lowered;
        let ball = scene_bounds(scene, &[], 0.0)?;
        Some((ball.center.map(|x| x * scene.units.length), ball.radius * scene.units.length))
    };
    let (center, radius) = ball("sphere(center: (1,2,3) m, radius: 2 m)", "").expect("bounded");
    assert!((radius - 2.0).abs() < 1e-12 && center == [1.0, 2.0, 3.0]);
    let (center, radius) =
        ball("box(min: (0,0,0) m, max: (2,2,2) m)", "transform = translate((10,0,0) m) * scale(2)").expect("bounded");
    assert!((center[0] - 12.0).abs() < 1e-9 && (radius - 2.0 * 3f64.sqrt()).abs() < 1e-9, "{center:?} {radius}");
    let part = "intersection(slab(axis: (0,1,0), from: 0 m, to: 1 m), sphere(center: (0,0,0) m, radius: 5 m))";
    assert!(ball(part, "").is_some_and(|(_, r)| (r - 5.0).abs() < 1e-9));
    assert_eq!(ball("everywhere", ""), None);
}

#[test]
fn empty_and_tiny_pictures_are_drawn_or_refused() {
    for (size, fine) in [([1, 1], true), ([3, 1], true), ([0, 4], false)] {
        for engine in [EngineChoice::Gpu, EngineChoice::Cpu] {
            let options = Options { size: Some(size), ..Options::default() };
            let Some(mut session) = open(BALL, engine, options) else { continue };
            let (params, _) = session.params::<&str>(&[]).expect("none");
            assert_eq!(session.draw(&params, 0.0, &|_| {}).is_ok(), fine, "{size:?} {engine:?}");
        }
    }
}
