//! What ten minutes of fuzzing each found to take different ways through the parser and the compiler, apart from the texts of the
//! suites; `cargo fuzz` takes it up again with `cargo +nightly fuzz run compile fuzz/seeds/compile`.

#[path = "../../fuzz/checks/compile.rs"]
mod compiling;
#[path = "../../fuzz/checks/parse.rs"]
mod parsing;

/// How many of a target's seeds pass and how many are refused; a broken promise panics.
#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn run(target: &str, check: fn(&[u8]) -> bool) -> (usize, usize) {
    let folder = format!("{}/../fuzz/seeds/{target}", env!("CARGO_MANIFEST_DIR"));
    let entries = std::fs::read_dir(folder).expect("the seeds are there");
    let seeds = entries.map(|e| std::fs::read(e.expect("a folder can be listed").path()).expect("a seed can be read"));
    let (passed, refused): (Vec<bool>, Vec<bool>) = seeds.map(|seed| check(&seed)).partition(|passed| *passed);
    (passed.len(), refused.len())
}

#[test]
fn what_fuzzing_found_is_read_or_refused() {
    let (read, refused) = run("parse", parsing::check);
    assert!(read > 5 && refused > 50, "{read} read, {refused} refused");
}

#[test]
fn what_fuzzing_found_is_compiled_or_refused() {
    let (compiled, refused) = run("compile", compiling::check);
    assert!(compiled > 5 && refused > 50, "{compiled} compiled, {refused} refused");
}
