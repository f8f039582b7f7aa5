//! Any text to the parser, and through the formatter and back. Good seeds are `library`, `examples` and
//! `tests/diagnostics/syntax`; run with `-- -dict=fuzz/vol.dict -max_len=4000`.
#![no_main]

use compiler::diagnostic::Diagnostics;
use compiler::source::SourceId;
use compiler::syntax::{format, parse};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let mut diagnostics = Diagnostics::default();
    let module = parse(SourceId(0), text, &mut diagnostics);
    for label in diagnostics.iter().flat_map(|d| &d.labels) {
        // Every label must be a part of the text that can be underlined.
        assert!(text.get(label.span.range()).is_some(), "{label:?}");
    }
    let formatted = format(text);
    assert_eq!(formatted.is_err(), diagnostics.has_errors());
    let Ok(formatted) = formatted else { return };
    let mut again = Diagnostics::default();
    let read_again = parse(SourceId(0), &formatted, &mut again);
    assert!(!again.has_errors(), "{formatted}\n{again:?}");
    assert_eq!(module.items.len(), read_again.items.len());
    assert_eq!(format(&formatted).as_ref(), Ok(&formatted), "formatting is stable");
    let significant = |t: &str| t.chars().filter(|c| !c.is_whitespace() && *c != '\u{FEFF}').collect::<String>();
    assert_eq!(significant(text), significant(&formatted), "nothing but space changes");
});
