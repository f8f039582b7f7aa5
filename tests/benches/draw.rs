//! Frames and field evaluations. Times are those of the machine; evaluations are counted and are not.

use compiler::Options;
use compiler::ir::Aa;
use compiler::program::OutputKind;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use runtime::frame::{EngineChoice, Session};
use std::path::PathBuf;
use tyndall_tests::{draw, open, root};

fn example(name: &str) -> PathBuf {
    root().join("examples").join(name).with_extension("vol")
}

fn one_ray_per_pixel(name: &str, size: [u32; 2], engine: EngineChoice) -> Option<Session> {
    let mut options = Options { size: Some(size), aa: Some(Aa::None), ..Options::default() };
    options.outputs.push(OutputKind::Evaluations);
    open(&example(name), options, engine)
}

/// A frame at 512², one ray per pixel, at the example's own accuracy.
fn frames(c: &mut Criterion) {
    let mut group = c.benchmark_group("frame at 512x512 on the GPU");
    group.sample_size(10);
    for name in ["brain", "nebula"] {
        let Some(mut session) = one_ray_per_pixel(name, [512, 512], EngineChoice::Gpu) else { continue };
        group.bench_function(name, |b| b.iter(|| draw(&example(name), &mut session)));
    }
}

/// Field evaluations per second of each engine, on the nebula.
fn evaluations(c: &mut Criterion) {
    let mut group = c.benchmark_group("field evaluations");
    group.sample_size(10);
    for (engine, word, size) in [
        (EngineChoice::Gpu, "gpu", [256, 256]),
        (EngineChoice::Cpu, "cpu", [48, 48]),
        (EngineChoice::Reference, "reference", [16, 16]),
    ] {
        let Some(mut session) = one_ray_per_pixel("nebula", size, engine) else { continue };
        let path = example("nebula");
        let drawn = draw(&path, &mut session);
        group.throughput(Throughput::Elements(drawn.evaluations.unwrap_or(0)));
        group.bench_function(BenchmarkId::from_parameter(word), |b| b.iter(|| draw(&path, &mut session)));
    }
}

criterion_group!(benches, frames, evaluations);
criterion_main!(benches);
