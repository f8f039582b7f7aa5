//! What must hold of any text that is compiled. Shared with `compiler/tests/fuzz_seeds.rs`.

use compiler::emit::{EmitError, emit};
use compiler::loader::NoFiles;
use compiler::{Options, compile};

/// Compiles a text for pictures and for probes, and writes the shaders; whether there were any.
pub(crate) fn check(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let mut drawn = false;
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
            drawn = true;
        }
    }
    drawn
}
