//! Scenes whose answer is known in closed form (`suite/*.vol`), on every engine, through the same rays that `vol probe` follows.

use compiler::Options;
use runtime::frame::EngineChoice;
use tyndall_tests::{every_scene, gpu_tolerance, probe, text};

fn pairs<'a>(expected: &'a Option<Vec<f64>>, found: &'a [f64]) -> impl Iterator<Item = (f64, f64)> + 'a {
    let expected = expected.as_deref().unwrap_or(&[]);
    found
        .iter()
        .enumerate()
        .filter(move |_| !expected.is_empty())
        .map(move |(i, f)| (expected[i.min(expected.len() - 1)], *f))
}

#[test]
fn the_reference_agrees_to_nine_digits() {
    every_scene("tests/suite", |path| {
        let answers = probe(path, Options::probe(), EngineChoice::Reference).expect("the reference needs no machine");
        let mut wrong = vec![];
        for (e, a) in answers {
            let lists =
                [(&e.radiance, &a.radiance), (&e.transmittance, &a.transmittance), (&e.depth, &a.optical_depth)];
            for (expected, found) in lists {
                for (x, y) in pairs(expected, found) {
                    let close = x == y || (x - y).abs() <= 1e-9 * x.abs().max(1e-30);
                    if !close {
                        wrong.push(format!("{}\n    expected {x:e}, found {y:e}", e.line));
                    }
                }
            }
        }
        Some(wrong)
    });
}

#[test]
fn the_gpu_agrees_to_a_ten_thousandth_of_the_largest_radiance() {
    every_scene("tests/suite", |path| {
        let options = Options { accuracy: Some(1e-5), ..Options::probe() };
        let answers = probe(path, options, EngineChoice::Gpu)?;
        let tolerance = gpu_tolerance(&text(path));
        let largest =
            answers.iter().flat_map(|(e, _)| e.radiance.iter().flatten()).fold(1e-3f64, |m, x| m.max(x.abs()));
        let mut wrong = vec![];
        for (e, a) in answers {
            let mut check = |what: &str, x: f64, y: f64, allowed: f64| {
                if !(x == y || (x - y).abs() <= allowed) {
                    wrong.push(format!("{}\n    {what}: expected {x:e}, found {y:e}", e.line));
                }
            };
            for (x, y) in pairs(&e.radiance, &a.radiance) {
                check("radiance", x, y, tolerance * largest);
            }
            for (x, y) in pairs(&e.transmittance, &a.transmittance) {
                check("transmittance", x, y, tolerance);
            }
            for (x, y) in pairs(&e.depth, &a.optical_depth) {
                check("depth", x, y, tolerance * x.abs());
            }
        }
        Some(wrong)
    });
}
