//! What light costs: each light and each step of single scattering, light by slices, and random paths on both engines. Times are those of
//! the machine.

use compiler::Options;
use compiler::ir::{Backend, Stacks};
use compiler::program::OutputKind;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use runtime::frame::{EngineChoice, FileLoader, Session, Settings};
use std::path::Path;
use std::time::Instant;
use tyndall_tests::{draw, open, root};

const SIZE: u32 = 128;

/// Coefficients through which light has a closed optical depth, and through which it must be stepped.
const COEFFICIENTS: [(&str, &str); 2] = [
    ("closed shadows", "k_s = 1 /m * exp(-p.y / 2 m)  k_a = 0.1 /m * exp(-p.x / 1 m)"),
    ("stepped shadows", "k_s = 1 /m * (1 + 0.5 * sin(p.x / 0.1 m) * sin(p.y / 0.1 m))"),
];

/// A medium under some suns, of which none is like another.
fn lit(coefficients: &str, lights: u32) -> String {
    let suns = (0..lights).map(|i| format!("light sun_{i} {{ direction = ({i}, -2, 1)  irradiance = 1 lx }}\n"));
    let medium = format!("medium matter {{ shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)  {coefficients} }}");
    format!("{medium}\n{}render {{ scattering = single }}", suns.collect::<String>())
}

fn session(text: &str, options: Options) -> Option<Session> {
    let settings = Settings { options, engine: EngineChoice::Gpu, ..Settings::default() };
    Session::open("bench.vol", text, &FileLoader::new(root()), settings).ok()
}

/// Counted evaluations of a ray, and the least milliseconds of some frames.
fn cost(session: &mut Session) -> (f64, f64) {
    let drawn: Vec<_> = (0..5).map(|_| draw(Path::new("bench.vol"), session)).collect();
    let evaluations = drawn[0].evaluations.unwrap_or(0) as f64 / f64::from(SIZE * SIZE);
    (evaluations, drawn.iter().map(|d| d.milliseconds).fold(f64::INFINITY, f64::min))
}

/// A light more, and steps more. Where shadows are stepped through, optical depths towards the lights are looked up on a lattice
/// that each frame fills anew. What is printed are counts, and times as multiples of that of one light and 64 steps, which other
/// work on the machine changes less than the times themselves.
fn single(c: &mut Criterion) {
    for (word, coefficients) in COEFFICIENTS {
        let mut group = c.benchmark_group(format!("single scattering at 128x128 on the GPU, {word}"));
        group.sample_size(10);
        let mut whole = None;
        for (lights, steps) in [(1, 64), (0, 64), (2, 64), (4, 64), (1, 16), (1, 32), (1, 128)] {
            let mut options = Options { size: Some([SIZE, SIZE]), steps: Some(steps), ..Options::default() };
            options.outputs.push(OutputKind::Evaluations);
            let Some(mut session) = session(&lit(coefficients, lights), options) else { return };
            let (evaluations, least) = cost(&mut session);
            let share = least / *whole.get_or_insert(least);
            println!(
                "{word}, {lights} lights, {steps} steps: {evaluations:.1} evaluations a ray, {share:.2} of the time"
            );
            group.throughput(Throughput::Elements(u64::from(SIZE * SIZE * steps)));
            let id = BenchmarkId::from_parameter(format!("{lights} lights, {steps} steps"));
            group.bench_function(id, |b| b.iter(|| draw(Path::new("bench.vol"), &mut session)));
        }
    }
}

/// Paths per second on the cumulus, and from their spread the time to a standard error of 1 % at every pixel.
fn paths(c: &mut Criterion) {
    let mut group = c.benchmark_group("paths of the cumulus");
    group.sample_size(10);
    let path = root().join("examples/paths/cumulus.vol");
    for (engine, word, size) in [(EngineChoice::Gpu, "gpu", [64, 40]), (EngineChoice::Reference, "reference", [16, 10])]
    {
        let samples = 64;
        let options = Options { size: Some(size), samples: Some(samples), accuracy: Some(1e-2), ..Options::default() };
        let Some(mut session) = open(&path, options, engine) else { continue };
        let drawn = draw(&path, &mut session);
        let count = u64::from(size[0] * size[1] * samples);
        if let Some((_, share)) = drawn.predicted {
            // The error falls as 1/√n.
            let seconds = drawn.milliseconds / 1e3 * share * share / f64::from(size[0] * size[1]);
            println!(
                "{word}: {:.0} paths a second, 1 % at the worst pixel after {:.0} paths of each, {seconds:.3} s a pixel",
                count as f64 / (drawn.milliseconds / 1e3),
                share * share * f64::from(samples)
            );
        }
        group.throughput(Throughput::Elements(count));
        group.bench_function(BenchmarkId::from_parameter(word), |b| b.iter(|| draw(&path, &mut session)));
    }
}

/// Media under one sun, by slices: smooth waves, and billows of noise.
const SLICED: [(&str, &str); 2] = [
    (
        "waves",
        "medium waves {
            shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)
            k_s = rgb(0.6, 1, 1.5) / m * (1 + 0.8 * sin(5 * p.x / 1 m) * cos(4 * p.y / 1 m + 3 * p.z / 1 m))
            k_a = 0.2 / m
        }",
    ),
    (
        "billows",
        "use std::noise::fbm
        medium billows {
            shape = sphere(center: (0, 0, 0) m, radius: 1 m)
            density = smoothstep(0.4, 0.7, fbm(p / 0.5 m, octaves: 3)) * max(0, 1 - dot(p, p) / 1 m^2)
            k_s = 12 / m
        }",
    ),
];

/// Planes across half the angle between view and light, from slab to slab, against planes across the view, whose light is looked up in columns
/// on a lattice that each frame fills anew: milliseconds of a frame, the best of three, and its error on pixels that the reference follows.
fn sliced(_: &mut Criterion) {
    let view = "light sun { direction = (0.3, -1, 0.6)  irradiance = 6 lx }
        camera { from = (0.9, 0.6, -4) m  to = (0,0,0) m  fov = 36 deg }
        image { size = 256 x 192  aa = none }";
    for (word, medium) in SLICED {
        let text = format!("{medium}\n{view}");
        for (stacks, how) in [(Stacks::View, "looked up"), (Stacks::HalfAngle, "from slab to slab")] {
            for slices in [16, 32, 64, 128, 256] {
                let backend = Some(Backend::Slicing);
                let options = Options { backend, stacks: Some(stacks), slices: Some(slices), ..Options::default() };
                let Some(mut session) = session(&text, options) else { return };
                let mut frame = || {
                    let started = Instant::now();
                    let drawing = draw(Path::new("bench.vol"), &mut session);
                    (1e3 * started.elapsed().as_secs_f64(), drawing)
                };
                // By the wall clock: what fills a lattice before the picture counts.
                let drawn: Vec<_> = (0..3).map(|_| frame()).collect();
                let least = drawn.iter().map(|d| d.0).fold(f64::INFINITY, f64::min);
                let measured = session.measure(&drawn[0].1, 64, 1).expect("the reference follows it");
                println!(
                    "{word}, {how}, {slices} slabs: {least:.0} ms, RMS {:.1e} lx, at most {:.1e} lx",
                    measured.rms, measured.max
                );
            }
        }
    }
}

criterion_group!(benches, single, sliced, paths);
criterion_main!(benches);
