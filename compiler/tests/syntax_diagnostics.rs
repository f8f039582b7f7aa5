//! Every text with errors under `tests/diagnostics/syntax` against its exact diagnostics.

use compiler::diagnostic::{Diagnostics, explain, render};
use compiler::source::Sources;

#[test]
#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn errors_are_worded_as_pinned() {
    insta::with_settings!({
        snapshot_path => "../../tests/diagnostics/syntax/snapshots",
        prepend_module_to_snapshot => false,
        omit_expression => true,
    }, {
        insta::glob!("../../tests/diagnostics/syntax", "*.vol", |path| {
            let text = std::fs::read_to_string(path).expect("the input is a text");
            let name = path.file_name().expect("a file has a name").to_string_lossy();
            let mut sources = Sources::default();
            let id = sources.add(name, &text);
            let mut diagnostics = Diagnostics::default();
            compiler::syntax::parse(id, &text, &mut diagnostics);
            for diagnostic in diagnostics.iter() {
                assert!(explain(diagnostic.code).is_some(), "{} is not explained", diagnostic.code);
            }
            insta::assert_snapshot!("diagnostics", render(&diagnostics, &sources));
        });
    });
}
