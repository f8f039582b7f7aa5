//! What must not change, on both engines: scenes that are the same to the eye (`suite/same/*/`).

use compiler::Options;
use compiler::ir::Scattering;
use runtime::frame::{Cause, EngineChoice, Params, ProbeSettings, RayAnswer, RayQuery};
use std::path::{Path, PathBuf};
use tyndall_tests::{expectations, fail, files, open, root, text};

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
