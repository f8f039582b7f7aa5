//! Source text to validated WGSL, for each example. The library is parsed before the clock starts.

use compiler::emit::emit;
use compiler::{Options, compile};
use criterion::{Criterion, criterion_group, criterion_main};
use runtime::frame::FileLoader;
use std::hint::black_box;
use tyndall_tests::{files, name, root, text};

fn to_wgsl(c: &mut Criterion) {
    let loader = FileLoader::new(root().join("examples"));
    let mut group = c.benchmark_group("text to validated WGSL");
    for path in files("examples", "vol") {
        let (name, text) = (name(&path), text(&path));
        group.bench_function(name, |b| {
            b.iter(|| {
                let out = compile(name, black_box(&text), &loader, &Options::default());
                let program = out.program.expect("the example compiles");
                let shaders = program.kernels.iter().map(|k| emit(k).expect("a shader").wgsl().expect("WGSL"));
                shaders.map(|s| s.len()).sum::<usize>()
            });
        });
    }
}

criterion_group!(benches, to_wgsl);
criterion_main!(benches);
