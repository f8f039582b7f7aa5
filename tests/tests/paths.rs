//! Scattering of all orders (`suite/paths/*.vol`): both path tracers against what is known, and against each other within
//! their joint standard error. The seeds are fixed, so a failure is one for good.

use compiler::Options;
use compiler::ir::Scattering;
use runtime::frame::{EngineChoice, RayAnswer};
use tyndall_tests::{Expectation, every_scene, files, name, open, pixel_rays, probe, root};

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

/// Bounds between which a normally distributed number falls with equal chance: its eighths.
const EIGHTHS: [f64; 7] = [-1.150_35, -0.674_49, -0.318_64, 0.0, 0.318_64, 0.674_49, 1.150_35];

/// Every pixel of a small picture of each example, and of surfaces in the light of a lamp and a sun in mist, on both engines. Scores are the differences in joint standard errors; of
/// each pixel one band counts, since its bands share their paths.
#[test]
fn pictures_of_paths_agree_pixel_by_pixel() {
    let mut scores: Vec<f64> = vec![];
    let mist = root().join("tests/suite/orders/lamp_in_mist.vol");
    for path in files("examples/paths", "vol").into_iter().chain([mist]) {
        // What the reference does in seconds: paths through noise cost fifty times as much as through milk. With fewer paths
        // batches are not normally distributed: what brightens a table is rare.
        let (size, samples) = match name(&path) {
            "cumulus" => ([14, 9], 256),
            _ => ([12, 12], 1024),
        };
        let scattering = Some(Scattering::Multiple);
        let options = Options { samples: Some(samples), scattering, ..Options::probe() };
        let answers = [EngineChoice::Gpu, EngineChoice::Reference].map(|engine| {
            let mut session = open(&path, options.clone(), engine)?;
            let rays = pixel_rays(&session, size);
            Some(tyndall_tests::follow(&path, &mut session, &rays))
        });
        let [Some(gpu), Some(reference)] = answers else { return };
        let before = scores.len();
        for (pixel, (a, b)) in gpu.iter().zip(&reference).enumerate() {
            let at = || format!("{} at ({}, {})", path.display(), pixel % size[0] as usize, pixel / size[0] as usize);
            let band = pixel % a.radiance.len();
            let joint = a.error[band].hypot(b.error[band]);
            let off = a.radiance[band] - b.radiance[band];
            // Nothing but the background: no chance in it, only rounding.
            if joint <= 1e-5 * b.radiance[band] {
                assert!(off.abs() <= 3e-5 * b.radiance[band], "{}: {a:?} {b:?}", at());
                continue;
            }
            scores.push(off / joint);
            assert!(scores[scores.len() - 1].abs() < 6.0, "{}: {a:?} {b:?}", at());
        }
        println!("{}: {} pixels of chance", path.display(), scores.len() - before);
        assert!(scores.len() - before > 30);
    }
    // χ² of the histogram, 7 degrees of freedom: above 24.3 once in a thousand.
    let mut counts = [0u32; 8];
    scores.iter().for_each(|z| counts[EIGHTHS.partition_point(|e| e <= z)] += 1);
    let (n, expected) = (scores.len() as f64, scores.len() as f64 / 8.0);
    let chi: f64 = counts.iter().map(|c| (f64::from(*c) - expected).powi(2) / expected).sum();
    let beyond = |z: f64| scores.iter().filter(|s| s.abs() > z).count() as f64;
    println!("{n} scores {counts:?}, chi-square {chi:.1}, beyond 2 and 3: {} and {}", beyond(2.0), beyond(3.0));
    assert!(chi < 24.3, "chi-square {chi} of {counts:?}");
    // No engine is brighter, and no error is understated. Of 32 batches each, the joint error makes of the normal distribution one
    // of Student's t of 31 to 62 degrees of freedom, whose variance is ν/(ν − 2).
    let mean = scores.iter().sum::<f64>() / n;
    let variance = scores.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / (n - 1.0);
    println!("mean {mean:.3}, variance {variance:.3}");
    assert!(mean.abs() < 4.0 / n.sqrt(), "mean {mean} of {n} scores");
    let chance = 4.0 * (2.0 / n).sqrt();
    assert!((62.0 / 60.0 - chance..31.0 / 29.0 + chance).contains(&variance), "variance {variance} of {n} scores");
    // Of 4.6 % and 0.27 % for a normal distribution; a little more where an error itself is known from 32 batches only.
    assert!((0.025 * n..0.075 * n).contains(&beyond(2.0)), "{} of {n} beyond two standard errors", beyond(2.0));
    assert!(beyond(3.0) < 0.012 * n, "{} of {n} beyond three standard errors", beyond(3.0));
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
            // No matter of chance.
            for (a, b) in a.transmittance.iter().zip(&b.transmittance) {
                let at = || format!("{}: {}", path.display(), expected.line);
                assert!((a - b).abs() < 1e-4, "{}: transmittance {a} and {b}", at());
            }
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
