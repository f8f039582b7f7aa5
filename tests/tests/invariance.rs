//! What must not change, and in which order things come, on both engines: scenes that are the same to the eye
//! (`suite/same/*/`), rays on two sides of a boundary (`suite/continuous`), and orders of scattering.

use compiler::Options;
use compiler::ir::Scattering;
use runtime::frame::{Cause, EngineChoice, Params, ProbeSettings, RayAnswer, RayQuery};
use std::path::{Path, PathBuf};
use tyndall_tests::{every_scene, expectations, fail, files, follow, open, root, text};

/// Paths of each ray where light is scattered many times.
const SAMPLES: u32 = 1 << 11;
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
    let mut session = open(path, options(scattering), engine)?;
    let params = Params::defaults(&session.program().lowered);
    match session.probe(&params, &rays(path), &ProbeSettings::default()) {
        Ok(answers) => Some(answers),
        // A software driver that ends long loops says nothing about light.
        Err(trouble) if trouble.cause == Cause::Machine => {
            println!("{}: {engine:?}: not on this driver", path.display());
            None
        }
        Err(trouble) => fail(path, &trouble),
    }
}

/// By how much the radiance of two answers in a band may differ: by chance, or by what the engine promises.
fn allowed(engine: EngineChoice, a: &RayAnswer, b: &RayAnswer, band: usize, largest: f64) -> f64 {
    if a.error_kind == "standard-error" || b.error_kind == "standard-error" {
        let error = |r: &RayAnswer| if r.error_kind == "standard-error" { r.error[band] } else { 0.0 };
        return 4.5 * error(a).hypot(error(b)) + 1e-5 * largest;
    }
    match engine {
        EngineChoice::Reference => 1e-7 * a.radiance[band].max(1e-9 * largest),
        EngineChoice::Gpu | EngineChoice::Cpu | EngineChoice::Auto => 2e-3 * largest,
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
            let mut session = open(path, options(None), engine)?;
            let found = follow(path, &mut session, &rays);
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
}

/// Every order of scattering adds light and takes none away.
#[test]
fn more_orders_of_scattering_are_brighter() {
    let mut strict = 0;
    for folder in ["tests/suite/light", "tests/suite/paths", "tests/suite/same/single"] {
        for path in files(folder, "vol") {
            for engine in ENGINES {
                let of = |scattering| answers(&path, engine, Some(scattering));
                let (Some(none), Some(single)) = (of(Scattering::None), of(Scattering::Single)) else { continue };
                let Some(multiple) = of(Scattering::Multiple) else { continue };
                let largest = brightest(&multiple);
                for (ray, ((n, s), m)) in none.iter().zip(&single).zip(&multiple).enumerate() {
                    for band in 0..n.radiance.len() {
                        let below = |a: &RayAnswer, b: &RayAnswer| {
                            a.radiance[band] <= b.radiance[band] + allowed(engine, a, b, band, largest)
                        };
                        let ordered = below(n, s) && below(s, m);
                        assert!(ordered, "{}: {engine:?}, ray {ray}: {n:?} {s:?} {m:?}", path.display());
                        let more = s.radiance[band] > 1.01 * n.radiance[band];
                        strict += u32::from(more && m.radiance[band] > 1.01 * s.radiance[band]);
                    }
                }
            }
        }
    }
    assert!(strict > 50, "only {strict} bands of rays in which each order shows");
}
