//! Any text to validated shaders. Good seeds are `examples`, `tests/suite` and `tests/diagnostics`; run with
//! `-- -dict=fuzz/vol.dict -max_len=4000`.
#![no_main]

use compiler::emit::{EmitError, emit};
use compiler::loader::NoFiles;
use compiler::{Options, compile};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    for options in [Options::default(), Options::probe()] {
        let out = compile("fuzz.vol", text, &NoFiles, &options);
        // Every finding can be shown, and without a program there is at least one.
        let shown = compiler::diagnostic::render(&out.diagnostics, &out.sources);
        assert!(out.program.is_some() || !shown.is_empty());
        for kernel in out.program.iter().flat_map(|p| &p.kernels) {
            match emit(kernel) {
                Ok(shader) => drop(shader.wgsl().expect("a valid shader can be written")),
                // A number beyond f32 is the scene's fault; anything else is ours.
                Err(error) => assert!(matches!(error, EmitError::Number { .. }), "{error}\n{text}"),
            }
        }
    }
});
