//! The engines: what turns a compiled scene into numbers.

pub mod gpu;
pub mod reference;

/// For tests that need an adapter where there is none: prints that they are skipped.
///
/// # Panics
/// With `TYNDALL_REQUIRE_GPU=1` in the environment, where an adapter must be there.
pub fn skip_without_adapter() {
    let required = std::env::var("TYNDALL_REQUIRE_GPU").is_ok_and(|v| v == "1");
    assert!(!required, "TYNDALL_REQUIRE_GPU is set, and there is no adapter");
    eprintln!("skipped: no adapter");
}
