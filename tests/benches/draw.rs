//! Frames and field evaluations. Times are those of the machine; evaluations are counted and are not.

use compiler::Options;
use compiler::program::OutputKind;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use runtime::frame::{EngineChoice, FileLoader, Params, Session, Settings};
use tyndall_tests::root;

fn open(name: &str, size: [u32; 2], engine: EngineChoice) -> Option<Session> {
    let path = root().join("examples").join(name).with_extension("vol");
    let text = std::fs::read_to_string(path).expect("the example exists");
    let mut options = Options { size: Some(size), aa: Some(compiler::ir::Aa::None), ..Options::default() };
    options.outputs.push(OutputKind::Evaluations);
    let settings = Settings { options, engine, ..Settings::default() };
    match Session::open(name, &text, &FileLoader::new(root().join("examples")), settings) {
        Ok(session) => Some(session),
        Err(trouble) => {
            eprintln!("{name}: {}", compiler::diagnostic::render(&trouble.diagnostics, &trouble.sources));
            None
        }
    }
}

/// A frame at 512², one ray per pixel, at the example's own accuracy.
fn frames(c: &mut Criterion) {
    let mut group = c.benchmark_group("frame at 512x512 on the GPU");
    group.sample_size(10);
    for name in ["brain", "nebula"] {
        let Some(mut session) = open(name, [512, 512], EngineChoice::Gpu) else { continue };
        let params = Params::defaults(&session.program().lowered);
        group.bench_function(name, |b| {
            b.iter(|| session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| panic!("{:?}", t.diagnostics)));
        });
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
        let Some(mut session) = open("nebula", size, engine) else { continue };
        let params = Params::defaults(&session.program().lowered);
        let drawn = session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
        group.throughput(Throughput::Elements(drawn.evaluations.unwrap_or(0)));
        group.bench_function(BenchmarkId::from_parameter(word), |b| {
            b.iter(|| session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| panic!("{:?}", t.diagnostics)));
        });
    }
}

criterion_group!(benches, frames, evaluations);
criterion_main!(benches);
