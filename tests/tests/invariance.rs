//! What must not change, on both engines: scenes that are the same to the eye
//! (`suite/same/*/`), and rays on two sides of a boundary (`suite/continuous`).

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
    ask(path, engine, scattering, &rays(path))
}

fn ask(path: &Path, engine: EngineChoice, scattering: Option<Scattering>, rays: &[RayQuery]) -> Option<Vec<RayAnswer>> {
    let mut session = open(path, options(scattering), engine)?;
    let params = Params::defaults(&session.program().lowered);
    match session.probe(&params, rays, &ProbeSettings::default()) {
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
            let Some(found) = ask(path, engine, None, &rays) else { return Some(vec![]) };
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
