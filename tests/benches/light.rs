//! What light costs: each light and each step of single scattering, and random paths on both engines. Times are those of the machine.

use compiler::Options;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use runtime::frame::{EngineChoice, FileLoader, Session, Settings};
use std::path::Path;
use tyndall_tests::{draw, open, root};

const SIZE: u32 = 128;

/// A medium that varies under some suns, of which none is like another.
fn lit(lights: u32) -> String {
    let suns = (0..lights).map(|i| format!("light sun_{i} {{ direction = ({i}, -2, 1)  irradiance = 1 lx }}\n"));
    let medium = "medium waves {
        shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)
        k_s = 1 /m * (1 + 0.5 * sin(p.x / 0.1 m) * sin(p.y / 0.1 m))
    }";
    format!("{medium}\n{}render {{ scattering = single }}", suns.collect::<String>())
}

fn session(text: &str, options: Options) -> Option<Session> {
    let settings = Settings { options, engine: EngineChoice::Gpu, ..Settings::default() };
    Session::open("bench.vol", text, &FileLoader::new(root()), settings).ok()
}

/// A light more, and steps more, each with the optical depth towards the light looked up on its lattice.
fn single(c: &mut Criterion) {
    let mut group = c.benchmark_group("single scattering at 128x128 on the GPU");
    group.sample_size(10);
    for (lights, steps) in [(0, 64), (1, 64), (2, 64), (4, 64), (1, 16), (1, 32), (1, 128)] {
        let options = Options { size: Some([SIZE, SIZE]), steps: Some(steps), ..Options::default() };
        let Some(mut session) = session(&lit(lights), options) else { return };
        group.throughput(Throughput::Elements(u64::from(SIZE * SIZE * steps)));
        let id = BenchmarkId::from_parameter(format!("{lights} lights, {steps} steps"));
        group.bench_function(id, |b| b.iter(|| draw(Path::new("bench.vol"), &mut session)));
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
                "{word}: 1 % at the worst pixel after {:.0} paths of each, {seconds:.3} s a pixel",
                share * share * 64.0
            );
        }
        group.throughput(Throughput::Elements(count));
        group.bench_function(BenchmarkId::from_parameter(word), |b| b.iter(|| draw(&path, &mut session)));
    }
}

criterion_group!(benches, single, paths);
criterion_main!(benches);
