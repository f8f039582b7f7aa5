//! Any text to the parser, and through the formatter and back. Good seeds are `library`, `examples`,
//! `tests/diagnostics/syntax` and `fuzz/seeds/parse`; run with `-- -dict=fuzz/vol.dict -max_len=4000`.
#![no_main]

#[path = "../checks/parse.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    checks::check(bytes);
});
