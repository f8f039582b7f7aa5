//! Any text to validated shaders. Good seeds are `examples`, `tests/suite`, `tests/diagnostics` and `fuzz/seeds/compile`; run
//! with `-- -dict=fuzz/vol.dict -max_len=4000`.
#![no_main]

#[path = "../checks/compile.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    checks::check(bytes);
});
