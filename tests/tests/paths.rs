//! Scattering of all orders (`suite/paths/*.vol`): both path tracers against what is known, and against each other within
//! their joint standard error. The seeds are fixed, so a failure is one for good.

use compiler::Options;
use runtime::frame::{EngineChoice, RayAnswer};
use tyndall_tests::{Expectation, every_scene, files, probe};

const FOLDER: &str = "tests/suite/paths";
/// Paths of each ray.
const SAMPLES: u32 = 1 << 14;

fn follow(path: &std::path::Path, engine: EngineChoice) -> Option<Vec<(Expectation, RayAnswer)>> {
    let options = Options { samples: Some(SAMPLES), ..Options::probe() };
    probe(path, options, engine)
}

/// Differences from what is known that chance does not explain: beyond 4.5 standard errors, one in 150 000.
fn unexplained(answers: &[(Expectation, RayAnswer)]) -> Vec<String> {
    let mut wrong = vec![];
    for (expected, answer) in answers {
        assert_eq!(answer.error_kind, "standard-error", "{}", expected.line);
        let Some(radiance) = &expected.radiance else { continue };
        for (i, (found, error)) in answer.radiance.iter().zip(&answer.error).enumerate() {
            let known = radiance[i.min(radiance.len() - 1)];
            // Beyond rounding of f32 in hundreds of scatterings.
            if (found - known).abs() > 4.5 * error + 1e-5 * known {
                wrong.push(format!("{}\n    expected {known}, found {found} ± {error}", expected.line));
            }
            // A test that allows anything shows nothing.
            if *error > 0.05 * known {
                wrong.push(format!("{}\n    {found} ± {error} says nothing of {known}", expected.line));
            }
        }
    }
    wrong
}

#[test]
fn the_gpu_agrees_with_theory() {
    every_scene(FOLDER, |path| Some(unexplained(&follow(path, EngineChoice::Gpu)?)));
}

#[test]
fn the_reference_agrees_with_theory() {
    every_scene(FOLDER, |path| Some(unexplained(&follow(path, EngineChoice::Reference)?)));
}

#[test]
fn both_path_tracers_agree_within_their_joint_error() {
    let mut scores = vec![];
    for path in files(FOLDER, "vol") {
        let (Some(gpu), Some(reference)) = (follow(&path, EngineChoice::Gpu), follow(&path, EngineChoice::Reference))
        else {
            return;
        };
        for ((expected, a), (_, b)) in gpu.iter().zip(&reference) {
            for i in 0..a.radiance.len() {
                let joint = a.error[i].hypot(b.error[i]).hypot(1e-5 * b.radiance[i]);
                let z = (a.radiance[i] - b.radiance[i]) / joint;
                assert!(z.abs() < 5.0, "{}: {}: {z} joint standard errors apart", path.display(), expected.line);
                scores.push(z);
            }
        }
    }
    // The histogram is that of a normal distribution: its second moment is 1. Bands of a ray share their paths, so that there
    // are about a third as many independent scores.
    let spread = scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64;
    println!("{} scores, mean square {spread}", scores.len());
    assert!(scores.len() >= 30 && (0.2..2.5).contains(&spread), "{} scores, mean square {spread}", scores.len());
}
