//! What must hold of any text that is read. Shared with `compiler/tests/fuzz_seeds.rs`.

use compiler::diagnostic::Diagnostics;
use compiler::source::SourceId;
use compiler::syntax::{format, parse};

/// Reads a text, formats it and reads it again; whether it was without error.
pub(crate) fn check(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let mut diagnostics = Diagnostics::default();
    let module = parse(SourceId(0), text, &mut diagnostics);
    for label in diagnostics.iter().flat_map(|d| &d.labels) {
        // Every label must be a part of the text that can be underlined.
        assert!(text.get(label.span.range()).is_some(), "{label:?}");
    }
    let formatted = format(text);
    assert_eq!(formatted.is_err(), diagnostics.has_errors());
    let Ok(formatted) = formatted else { return false };
    let mut again = Diagnostics::default();
    let read_again = parse(SourceId(0), &formatted, &mut again);
    assert!(!again.has_errors(), "{formatted}\n{again:?}");
    assert_eq!(module.items.len(), read_again.items.len());
    assert_eq!(format(&formatted).as_ref(), Ok(&formatted), "formatting is stable");
    let significant = |t: &str| t.chars().filter(|c| !c.is_whitespace() && *c != '\u{FEFF}').collect::<String>();
    assert_eq!(significant(text), significant(&formatted), "nothing but space changes");
    true
}
