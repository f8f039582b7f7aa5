//! What `accuracy` and `steps` promise: the GPU against the reference on every example, and orders of convergence.

use compiler::Options;
use compiler::program::OutputKind;
use runtime::frame::{Cause, EngineChoice, FileLoader, Params, ProbeSettings, RayQuery, Session, Settings};
use std::path::Path;
use tyndall_tests::{expectations, files, root};

fn open(path: &Path, text: &str, options: Options, engine: EngineChoice) -> Option<Session> {
    let name = path.file_name().and_then(|n| n.to_str()).expect("a name");
    let settings = Settings { options, engine, ..Settings::default() };
    match Session::open(name, text, &FileLoader::new(path.parent().expect("a folder")), settings) {
        Ok(session) => Some(session),
        Err(trouble) if trouble.cause == Cause::Machine => {
            runtime::engine::skip_without_adapter();
            None
        }
        Err(trouble) => panic!("{}", compiler::diagnostic::render(&trouble.diagnostics, &trouble.sources)),
    }
}

/// Each example at a quarter of a thousand pixels: the engine's own resolution of steps, not of the picture, is on trial.
#[test]
fn every_example_is_within_its_accuracy() {
    let mut wrong = vec![];
    for path in files("examples", "vol") {
        let text = std::fs::read_to_string(&path).expect("the scene is text");
        let mut options = Options { size: Some([64, 64]), ..Options::default() };
        options.outputs.push(OutputKind::Edge);
        let Some(mut session) = open(&path, &text, options, EngineChoice::Gpu) else { return };
        let params = Params::defaults(&session.program().lowered);
        let drawing = session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
        assert!(drawing.faults.iter().count() == 0, "{}: {:?}", path.display(), drawing.faults);
        let measured = session.measure(&drawing, 256, 1).unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
        println!("{}: {measured:?}", path.display());
        if !measured.within() {
            wrong.push(format!("{}: {measured:?}", path.display()));
        }
    }
    assert!(wrong.is_empty(), "beyond their accuracy:\n{}", wrong.join("\n"));
}

/// Slope of the logarithm of the error against that of the number of steps, by least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) = points.iter().map(|(a, b)| (a.ln(), b.ln())).unzip();
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let covariance: f64 = x.iter().zip(&y).map(|(a, b)| (a - mx) * (b - my)).sum();
    covariance / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>()
}

fn errors(engine: EngineChoice, ladder: &[u32]) -> Option<Vec<(f64, f64)>> {
    // Smooth along the ray, and neither symmetric nor vanishing at the ends, where the midpoint rule would be too good.
    let path = root().join("tests/suite/exponential_density.vol");
    let text = std::fs::read_to_string(&path).expect("the scene is text");
    let wanted = expectations(&text).remove(0);
    let exact = wanted.radiance.expect("a radiance")[0];
    let mut points = vec![];
    for steps in ladder {
        let options = Options { steps: Some(*steps), ..Options::probe() };
        let mut session = open(&path, &text, options, engine)?;
        let params = Params::defaults(&session.program().lowered);
        let rays = [RayQuery { origin: wanted.origin, direction: wanted.direction }];
        let answers = session.probe(&params, &rays, &ProbeSettings::default());
        let answers = answers.unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
        points.push((f64::from(*steps), (answers[0].radiance[0] - exact).abs()));
    }
    Some(points)
}

#[test]
fn the_default_rule_converges_with_order_two_in_f64() {
    let points = errors(EngineChoice::Cpu, &[8, 16, 32, 64, 128, 256]).expect("the processor is always there");
    let slope = slope(&points);
    assert!((slope + 2.0).abs() < 0.05, "slope {slope} over {points:?}");
}

#[test]
fn the_default_rule_converges_with_order_two_on_the_gpu() {
    // Until rounding in f32 takes over.
    let Some(points) = errors(EngineChoice::Gpu, &[4, 8, 16, 32, 64]) else { return };
    let slope = slope(&points);
    assert!((slope + 2.0).abs() < 0.15, "slope {slope} over {points:?}");
}

/// Scenes without a closed form: what the GPU draws is what the reference finds.
#[test]
fn gpu_and_reference_agree_on_every_feature() {
    let mut wrong = vec![];
    for path in files("tests/suite/agree", "vol") {
        let text = std::fs::read_to_string(&path).expect("the scene is text");
        let mut options = Options { size: Some([40, 40]), ..Options::default() };
        options.outputs.push(OutputKind::Edge);
        let Some(mut session) = open(&path, &text, options, EngineChoice::Gpu) else { return };
        let params = Params::defaults(&session.program().lowered);
        let drawing = session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
        assert!(drawing.faults.iter().count() == 0, "{}: {:?}", path.display(), drawing.faults);
        let measured = session.measure(&drawing, 256, 1).unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
        println!("{}: {measured:?} predicted {:?}", path.display(), drawing.predicted);
        if !measured.within() {
            wrong.push(format!("{}: {measured:?}", path.display()));
        }
    }
    assert!(wrong.is_empty(), "beyond their accuracy:\n{}", wrong.join("\n"));
}
