//! Scenes whose answer is known in closed form (`suite/*.vol`), on every engine, through the same rays that `vol probe` follows.

use compiler::Options;
use compiler::ir::Backend;
use compiler::trial::Change;
use runtime::frame::EngineChoice;
use tyndall_tests::{codes, every_scene, gpu_tolerance, name, probe, text};

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
    reference("tests/suite", 1e-9, None);
}

#[test]
fn the_reference_agrees_on_light_to_seven_digits() {
    reference("tests/suite/light", 1e-7, None);
}

#[test]
fn nothing_depends_on_the_unit_of_length() {
    for factor in [1e6, 1e-6] {
        let change = Some(Change::Lengths(factor));
        reference("tests/suite", 1e-8, change);
        reference("tests/suite/light", 1e-6, change);
    }
}

fn reference(folder: &str, tolerance: f64, change: Option<Change>) {
    every_scene(folder, |path| {
        // An optical depth has no unit either.
        let options = Options { change, ..Options::probe() };
        let answers = probe(path, options, EngineChoice::Reference).expect("the reference needs no machine");
        let mut wrong = vec![];
        for (e, a) in answers {
            let lists =
                [(&e.radiance, &a.radiance), (&e.transmittance, &a.transmittance), (&e.depth, &a.optical_depth)];
            for (expected, found) in lists {
                for (x, y) in pairs(expected, found) {
                    let close = x == y || (x - y).abs() <= tolerance * x.abs().max(1e-30);
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
    gpu("tests/suite", Backend::Raymarch, (1e-5, 1e-4), &[]);
}

#[test]
fn the_gpu_agrees_on_light_to_its_accuracy() {
    gpu("tests/suite/light", Backend::Raymarch, (1e-3, 1e-3), &[]);
}

/// Slabs fill a bounded part of space: these scenes have media without end.
#[test]
fn slicing_agrees_to_a_ten_thousandth_of_the_largest_radiance() {
    let endless = ["absorbing_slab", "fog", "layered_fog", "signed_distance", "signed_source", "two_atmospheres"];
    gpu("tests/suite", Backend::Slicing, (1e-4, 1e-4), &endless);
}

#[test]
fn slicing_agrees_on_light_to_its_accuracy() {
    let endless = ["airlight", "atmosphere_under_sun", "floor_under_glass", "large_lamp", "slab_under_slanting_sun"];
    gpu("tests/suite/light", Backend::Slicing, (1e-3, 1e-3), &endless);
}

/// Probes every scene of a folder but those that the backend is known to refuse, which it must.
fn gpu(folder: &str, backend: Backend, (accuracy, tolerance): (f64, f64), refused: &[&str]) {
    every_scene(folder, |path| {
        let options = Options { accuracy: Some(accuracy), backend: Some(backend), ..Options::probe() };
        if refused.contains(&name(path)) {
            let codes = codes(path, &options);
            return Some(if codes == ["E0530"] { vec![] } else { vec![format!("not refused: {codes:?}")] });
        }
        let answers = probe(path, options, EngineChoice::Gpu)?;
        let tolerance = gpu_tolerance(&text(path)).max(tolerance);
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
