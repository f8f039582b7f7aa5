//! What `accuracy` and `steps` promise: the GPU against the reference on every example, and orders of convergence.

use compiler::Options;
use compiler::ir::Backend;
use compiler::program::OutputKind;
use runtime::frame::EngineChoice;
use tyndall_tests::{codes, draw, every_scene, fail, name, open, probe, root};

/// Every scene of a folder, drawn on the GPU in a small square and compared with the reference: by marching at every pixel
/// that does not straddle an edge, by other backends at a sample of them.
fn all_within_their_accuracy(folder: &str, backend: Backend, size: impl Fn(&str) -> u32) {
    every_scene(folder, |path| {
        let size = size(name(path));
        let mut options = Options { size: Some([size, size]), backend: Some(backend), ..Options::default() };
        options.outputs.push(OutputKind::Edge);
        if backend != Backend::Raymarch && codes(path, &options) == ["E0530"] {
            println!("{}: not for {backend:?}", path.display());
            return Some(vec![]);
        }
        let mut session = open(path, options, EngineChoice::Gpu)?;
        let drawing = draw(path, &mut session);
        let every = backend == Backend::Raymarch;
        let measured = if every { session.measure_off_edges(&drawing) } else { session.measure(&drawing, 256, 1) };
        let measured = measured.unwrap_or_else(|t| fail(path, &t));
        println!("{}: {measured:?} predicted {:?}", path.display(), drawing.predicted);
        let mut wrong = vec![];
        if drawing.faults.iter().count() > 0 {
            wrong.push(format!("{:?}", drawing.faults));
        }
        if !measured.within() {
            wrong.push(format!("beyond its accuracy: {measured:?}"));
        }
        // Edges are lines: what remains is most of the picture.
        let all = measured.pixels + measured.straddling == size * size && 4 * measured.straddling <= size * size;
        if every && !all {
            wrong.push(format!("most of {size} x {size} pixels should be compared: {measured:?}"));
        }
        Some(wrong)
    });
}

/// The engine's own resolution of steps, not of the picture, is on trial; what the reference needs seconds for is small.
#[test]
fn every_example_is_within_its_accuracy() {
    all_within_their_accuracy("examples", Backend::Raymarch, |name| match name {
        "smoke" => 8,
        "nebula" | "brain_shaded" => 16,
        "brain" | "brain_sliced" | "cloud" | "street_lamps" => 32,
        _ => 48,
    });
}

/// Scenes without a closed form: what the GPU draws is what the reference finds.
#[test]
fn gpu_and_reference_agree_on_every_feature() {
    all_within_their_accuracy("tests/suite/agree", Backend::Raymarch, |_| 40);
}

/// Slabs show the same, where they can show it.
#[test]
fn slicing_and_reference_agree_on_every_feature() {
    all_within_their_accuracy("tests/suite/agree", Backend::Slicing, |_| 24);
}

/// Suns with discs, of which the GPU takes points: what that leaves out is reported, be it more than the accuracy. The reference
/// takes a second for a few pixels.
#[test]
fn discs_of_suns_are_as_good_as_reported() {
    every_scene("tests/suite/discs", |path| {
        let mut session = open(path, Options { size: Some([24, 24]), ..Options::default() }, EngineChoice::Gpu)?;
        let drawing = draw(path, &mut session);
        let measured = session.measure(&drawing, 16, 1).unwrap_or_else(|t| fail(path, &t));
        println!("{}: {measured:?} predicted {:?}", path.display(), drawing.predicted);
        let told = drawing.predicted.is_some_and(|p| measured.share <= p.1);
        let wrong = format!("{measured:?} predicted {:?}", drawing.predicted);
        Some(if told && measured.pixels >= 8 { vec![] } else { vec![wrong] })
    });
}

/// Shells far thinner than the steps between them: the mean of the picture is the reference's, pixel for pixel nearly so.
#[test]
fn thin_shells_have_the_right_mean() {
    every_scene("tests/suite/thin", |path| {
        let options = Options { size: Some([24, 24]), aa: Some(compiler::ir::Aa::None), ..Options::default() };
        let mut gpu = open(path, options.clone(), EngineChoice::Gpu)?;
        let mut reference = open(path, options, EngineChoice::Reference)?;
        let (gpu, reference) = (draw(path, &mut gpu), draw(path, &mut reference));
        let mean = |d: &runtime::frame::Drawing| {
            let all = d.picture.radiance();
            all.iter().map(|v| f64::from(*v)).sum::<f64>() / all.len() as f64
        };
        let (found, wanted) = (mean(&gpu), mean(&reference));
        let close = (found - wanted).abs() <= 0.01 * wanted && wanted > 0.02;
        Some(if close { vec![] } else { vec![format!("mean {found} instead of {wanted}")] })
    });
}

/// Slope of the logarithm of the error against that of the number of steps, by least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) = points.iter().map(|(a, b)| (a.ln(), b.ln())).unzip();
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let covariance: f64 = x.iter().zip(&y).map(|(a, b)| (a - mx) * (b - my)).sum();
    covariance / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>()
}

fn errors(engine: EngineChoice, ladder: &[u32], schedule: fn(u32) -> Options) -> Option<Vec<(f64, f64)>> {
    // Smooth along the ray, and neither symmetric nor vanishing at the ends, where the midpoint rule would be too good.
    let path = root().join("tests/suite/exponential_density.vol");
    let mut points = vec![];
    for steps in ladder {
        let answers = probe(&path, schedule(*steps), engine)?;
        let (wanted, found) = &answers[0];
        let exact = wanted.radiance.as_ref().expect("a radiance")[0];
        points.push((f64::from(*steps), (found.radiance[0] - exact).abs()));
    }
    Some(points)
}

fn steps(n: u32) -> Options {
    Options { steps: Some(n), ..Options::probe() }
}

#[test]
fn slicing_converges_with_order_two() {
    let schedule = |n| Options { slices: Some(n), backend: Some(Backend::Slicing), ..Options::probe() };
    let Some(points) = errors(EngineChoice::Gpu, &[4, 8, 16, 32, 64], schedule) else { return };
    let slope = slope(&points);
    assert!((slope + 2.0).abs() < 0.15, "slope {slope} over {points:?}");
}

#[test]
fn the_default_rule_converges_with_order_two_in_f64() {
    let points = errors(EngineChoice::Cpu, &[8, 16, 32, 64, 128, 256], steps).expect("the processor is always there");
    let slope = slope(&points);
    assert!((slope + 2.0).abs() < 0.05, "slope {slope} over {points:?}");
}

#[test]
fn the_default_rule_converges_with_order_two_on_the_gpu() {
    // Until rounding in f32 takes over.
    let Some(points) = errors(EngineChoice::Gpu, &[4, 8, 16, 32, 64], steps) else { return };
    let slope = slope(&points);
    assert!((slope + 2.0).abs() < 0.15, "slope {slope} over {points:?}");
}
