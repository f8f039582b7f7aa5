//! What bands cost: each four are a program of their own. The soap bubble in 1, 3, 4, 8 and 16 bands.

use compiler::loader::NoFiles;
use compiler::{Options, compile};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use runtime::frame::{EngineChoice, FileLoader, Params, Session, Settings};
use std::hint::black_box;
use tyndall_tests::{root, text};

/// The example with as many bands.
fn bubble(bands: u32) -> String {
    let all = text(&root().join("examples/soap_bubble.vol"));
    let changed = all.replace("spectral(16)", &format!("spectral({bands})"));
    assert!(bands == 16 || changed != all, "the example asks for sixteen bands");
    changed
}

const BANDS: [u32; 5] = [1, 3, 4, 8, 16];

/// From text to validated shaders.
fn shaders(c: &mut Criterion) {
    let mut group = c.benchmark_group("text to shaders by bands");
    for bands in BANDS {
        let text = bubble(bands);
        group.bench_function(BenchmarkId::from_parameter(bands), |b| {
            b.iter(|| {
                let out = compile("bubble.vol", black_box(&text), &NoFiles, &Options::default());
                let program = out.program.expect("the example compiles");
                let kernels = program.parts().flat_map(|p| &p.kernels);
                kernels.map(|k| compiler::emit::emit(k).expect("a shader").entry.len()).sum::<usize>()
            });
        });
    }
}

/// A frame at 128², one ray per pixel.
fn frames(c: &mut Criterion) {
    let mut group = c.benchmark_group("frame at 128x128 by bands");
    group.sample_size(10);
    for bands in BANDS {
        let options = Options { size: Some([128, 128]), aa: Some(compiler::ir::Aa::None), ..Options::default() };
        let settings = Settings { options, engine: EngineChoice::Gpu, ..Settings::default() };
        let opened = Session::open("bubble.vol", &bubble(bands), &FileLoader::new(root()), settings);
        let Ok(mut session) = opened else { continue };
        let params = Params::defaults(&session.program().lowered);
        group.bench_function(BenchmarkId::from_parameter(bands), |b| {
            b.iter(|| session.draw(&params, 0.0, &|_| {}).expect("a picture"));
        });
    }
}

criterion_group!(benches, shaders, frames);
criterion_main!(benches);
