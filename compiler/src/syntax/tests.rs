//! Tests of this room, beside the data they read.

mod accepted;
mod generated;
mod layout;
mod refused;
mod shape;
mod show;

use super::ast::Module;
use super::parse;
use crate::diagnostic::{Diagnostics, render};
use crate::source::Sources;

/// The snippets of the language contract.
const SNIPPETS: [(&str, &str); 5] = [
    ("items", include_str!("tests/items.vol")),
    ("ball", include_str!("tests/ball.vol")),
    ("brain", include_str!("tests/brain.vol")),
    ("haze", include_str!("tests/haze.vol")),
    ("corners", include_str!("tests/corners.vol")),
];

/// Reads a text; the rendered diagnostics with it.
fn read(text: &str) -> (Module, Diagnostics, String) {
    let mut sources = Sources::default();
    let id = sources.add("test.vol", text);
    let mut diagnostics = Diagnostics::default();
    let module = parse(id, text, &mut diagnostics);
    let rendered = render(&diagnostics, &sources);
    (module, diagnostics, rendered)
}

/// Reads a text that must have neither errors nor warnings.
fn read_clean(text: &str) -> Module {
    let (module, _, rendered) = read(text);
    assert!(rendered.is_empty(), "{rendered}");
    module
}
