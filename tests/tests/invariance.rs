//! What must not change, on both engines: scenes that are the same to the eye
//! (`suite/same/*/`), rays on two sides of a boundary (`suite/continuous`), and more light of more orders of scattering
//! (`suite/orders`).

use compiler::Options;
use compiler::ir::Scattering;
use runtime::frame::{EngineChoice, Params, ProbeSettings, RayAnswer, RayQuery};
use std::path::{Path, PathBuf};
use tyndall_tests::{every_scene, expectations, fail, files, open, root, text};

/// Paths of each ray where light is scattered many times.
const SAMPLES: u32 = 1 << 10;
const ENGINES: [EngineChoice; 2] = [EngineChoice::Gpu, EngineChoice::Reference];

fn options(scattering: Option<Scattering>) -> Options {
    Options { samples: Some(SAMPLES), accuracy: Some(1e-3), scattering, ..Options::probe() }
}

/// The rays that a scene names.
fn rays(path: &Path) -> Vec<RayQuery> {
    let rays = expectations(&text(path)).into_iter();
    rays.map(|e| RayQuery { origin: e.origin, direction: e.direction }).collect()
}

fn answers(path: &Path, engine: EngineChoice, scattering: Option<Scattering>) -> Option<Vec<RayAnswer>> {
    ask(path, engine, scattering, (&rays(path), ProbeSettings::default()))
}

fn ask(
    path: &Path,
    engine: EngineChoice,
    scattering: Option<Scattering>,
    (rays, settings): (&[RayQuery], ProbeSettings),
) -> Option<Vec<RayAnswer>> {
    let mut session = open(path, options(scattering), engine)?;
    let params = Params::defaults(&session.program().lowered);
    match session.probe(&params, rays, &settings) {
        Ok(answers) => Some(answers),
        // Drivers that end long loops say nothing about light, and air without end that absorbs nothing has no last order.
        Err(trouble) if trouble.diagnostics.iter().any(|d| ["E0655", "E0656"].contains(&d.code)) => {
            let codes: Vec<&str> = trouble.diagnostics.iter().map(|d| d.code).collect();
            println!("{}: {engine:?}: not compared: {codes:?}", path.display());
            None
        }
        Err(trouble) => fail(path, &trouble),
    }
}

/// By how much two answers of which one is of random paths may differ in a band by chance.
fn by_chance(a: &RayAnswer, b: &RayAnswer, band: usize) -> Option<f64> {
    let error = |r: &RayAnswer| (r.error_kind == "standard-error").then_some(r.error[band]);
    let joint = error(a).into_iter().chain(error(b)).reduce(f64::hypot)?;
    Some(4.5 * joint)
}

/// By how much the radiance of two answers in a band may differ: by chance, or by what the engine promises.
fn allowed(engine: EngineChoice, a: &RayAnswer, b: &RayAnswer, band: usize, largest: f64) -> f64 {
    match (by_chance(a, b, band), engine) {
        (Some(chance), _) => chance + 1e-5 * largest,
        (None, EngineChoice::Reference) => 1e-7 * a.radiance[band].max(1e-9 * largest),
        (None, EngineChoice::Gpu | EngineChoice::Cpu | EngineChoice::Auto) => 2e-3 * largest,
    }
}

fn brightest(answers: &[RayAnswer]) -> f64 {
    answers.iter().flat_map(|a| &a.radiance).fold(0.0, |m, x| m.max(*x))
}

fn groups(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(root().join(folder)).expect("the folder exists");
    let mut groups: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.is_dir()).collect();
    groups.sort();
    assert!(!groups.is_empty(), "no groups in {folder}");
    groups
}

/// Turned, a thousand times larger or smaller, in two halves: the i-th ray of every scene of a group sees the same.
#[test]
fn scenes_that_are_the_same_look_the_same() {
    let mut wrong = vec![];
    for group in groups("tests/suite/same") {
        let group = group.strip_prefix(root()).expect("below the root").to_str().expect("a name").to_owned();
        let scenes = files(&group, "vol");
        for engine in ENGINES {
            let Some(first) = answers(&scenes[0], engine, None) else { continue };
            let largest = brightest(&first);
            assert!(largest > 0.0, "{group} is dark");
            for path in &scenes[1..] {
                let Some(other) = answers(path, engine, None) else { continue };
                assert_eq!(first.len(), other.len(), "{}", path.display());
                for (ray, (a, b)) in first.iter().zip(&other).enumerate() {
                    for band in 0..a.radiance.len() {
                        let off = (a.radiance[band] - b.radiance[band]).abs();
                        if !(off <= allowed(engine, a, b, band, largest)) {
                            let (a, b) = (a.radiance[band], b.radiance[band]);
                            wrong.push(format!("{}: {engine:?}, ray {ray}: {b} instead of {a}", path.display()));
                        }
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// `//? near ray | ray`: an eye that moves a little, through a boundary of a medium, sees nearly the same.
#[test]
fn nothing_jumps_where_the_eye_enters_a_medium() {
    let mut compared = 0;
    for engine in ENGINES {
        every_scene("tests/suite/continuous", |path| {
            let numbers = |t: &str| -> Vec<f64> { t.split(',').map(|n| n.parse().expect("a number")).collect() };
            let one = |t: &str| {
                let mut parts = t.split_whitespace().map(|v| <[f64; 3]>::try_from(numbers(v)).expect("three numbers"));
                RayQuery { origin: parts.next().expect("an origin"), direction: parts.next().expect("a direction") }
            };
            let text = text(path);
            let lines: Vec<&str> = text.lines().filter_map(|l| l.strip_prefix("//? near ")).collect();
            assert!(!lines.is_empty(), "{} names no rays", path.display());
            let pair = |line: &&str| line.split("//").next().expect("a line").split('|').map(one).collect::<Vec<_>>();
            let rays: Vec<RayQuery> = lines.iter().flat_map(pair).collect();
            let Some(found) = ask(path, engine, None, (&rays, ProbeSettings::default())) else { return Some(vec![]) };
            compared += 1;
            let largest = brightest(&found);
            let mut wrong = vec![];
            for (line, pair) in lines.iter().zip(found.chunks_exact(2)) {
                for band in 0..pair[0].radiance.len() {
                    let off = (pair[0].radiance[band] - pair[1].radiance[band]).abs();
                    // The eye moves by a hundred-thousandth of a metre, through about as much depth.
                    if !(off <= allowed(engine, &pair[0], &pair[1], band, largest) + 1e-4 * largest) {
                        wrong.push(format!("{engine:?}, {line}: {:?} {:?}", pair[0].radiance, pair[1].radiance));
                    }
                }
            }
            Some(wrong)
        });
    }
    assert!(compared >= 3, "only {compared} scenes were compared");
}

/// Every order of scattering adds light and takes none away.
#[test]
fn more_orders_of_scattering_are_brighter() {
    for engine in ENGINES {
        let (mut compared, mut strict) = (0, 0);
        for path in files("tests/suite/orders", "vol") {
            let settings = ProbeSettings { rtol: 1e-4, ..ProbeSettings::default() };
            let of = |scattering| ask(&path, engine, Some(scattering), (&rays(&path), settings));
            let orders = [Scattering::None, Scattering::Single, Scattering::Multiple].map(of);
            let [Some(none), Some(single), Some(multiple)] = orders else { continue };
            compared += 1;
            // Of what the brightest ray shows, where there is no chance in it.
            let off = 2e-3 * brightest(&multiple);
            for (ray, ((n, s), m)) in none.iter().zip(&single).zip(&multiple).enumerate() {
                for band in 0..n.radiance.len() {
                    let below = |a: &RayAnswer, b: &RayAnswer, sign: f64| {
                        a.radiance[band] < b.radiance[band] + sign * (off + by_chance(a, b, band).unwrap_or(0.0))
                    };
                    let ordered = below(n, s, 1.0) && below(s, m, 1.0);
                    assert!(ordered, "{}: {engine:?}, ray {ray}: {n:?} {s:?} {m:?}", path.display());
                    strict += u32::from(below(n, s, -1.0) && below(s, m, -1.0));
                }
            }
        }
        println!("{engine:?}: {strict} bands of rays in which each order shows");
        assert!(strict > 20 || compared == 0, "{engine:?}: only {strict} bands of rays in which each order shows");
    }
}
