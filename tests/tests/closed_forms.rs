//! Scenes whose answer is known in closed form (`suite/*.vol`), on every engine, through the same rays that `vol probe` follows.

use compiler::Options;
use runtime::frame::{EngineChoice, FileLoader, Params, ProbeSettings, RayAnswer, RayQuery, Session, Settings};
use tyndall_tests::{Expectation, expectations, files, gpu_tolerance};

/// Answers of one engine, or `None` where the machine has none.
fn probe(engine: EngineChoice, path: &std::path::Path, accuracy: Option<f64>) -> Option<Vec<(Expectation, RayAnswer)>> {
    let text = std::fs::read_to_string(path).expect("the scene is text");
    let name = path.file_name().and_then(|n| n.to_str()).expect("a name");
    let wanted = expectations(&text);
    assert!(!wanted.is_empty(), "{name} expects nothing");
    let options = Options { accuracy, ..Options::probe() };
    let settings = Settings { options, engine, ..Settings::default() };
    let loader = FileLoader::new(path.parent().expect("a folder"));
    let mut session = match Session::open(name, &text, &loader, settings) {
        Ok(session) => session,
        Err(trouble) if trouble.cause == runtime::frame::Cause::Machine => {
            runtime::engine::skip_without_adapter();
            return None;
        }
        Err(trouble) => panic!("{name}: {}", compiler::diagnostic::render(&trouble.diagnostics, &trouble.sources)),
    };
    let params = Params::defaults(&session.program().lowered);
    let rays: Vec<RayQuery> = wanted.iter().map(|e| RayQuery { origin: e.origin, direction: e.direction }).collect();
    let answers = session.probe(&params, &rays, &ProbeSettings::default());
    let answers =
        answers.unwrap_or_else(|t| panic!("{name}: {}", compiler::diagnostic::render(&t.diagnostics, &t.sources)));
    Some(wanted.into_iter().zip(answers).collect())
}

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
    let mut wrong = vec![];
    for path in files("tests/suite", "vol") {
        for (e, a) in probe(EngineChoice::Reference, &path, None).expect("the reference needs no machine") {
            let lists =
                [(&e.radiance, &a.radiance), (&e.transmittance, &a.transmittance), (&e.depth, &a.optical_depth)];
            for (expected, found) in lists {
                for (x, y) in pairs(expected, found) {
                    let close = x == y || (x - y).abs() <= 1e-9 * x.abs().max(1e-30);
                    if !close {
                        wrong.push(format!("{}: {}\n    expected {x:e}, found {y:e}", path.display(), e.line));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} rays are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn the_gpu_agrees_to_a_ten_thousandth_of_the_largest_radiance() {
    let mut wrong = vec![];
    for path in files("tests/suite", "vol") {
        let Some(answers) = probe(EngineChoice::Gpu, &path, Some(1e-5)) else { return };
        let tolerance = gpu_tolerance(&std::fs::read_to_string(&path).expect("the scene is text"));
        let largest =
            answers.iter().flat_map(|(e, _)| e.radiance.iter().flatten()).fold(1e-3f64, |m, x| m.max(x.abs()));
        for (e, a) in answers {
            let mut check = |what: &str, x: f64, y: f64, allowed: f64| {
                if !(x == y || (x - y).abs() <= allowed) {
                    wrong.push(format!("{}: {}\n    {what}: expected {x:e}, found {y:e}", path.display(), e.line));
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
    }
    assert!(wrong.is_empty(), "{} values are wrong:\n{}", wrong.len(), wrong.join("\n"));
}
