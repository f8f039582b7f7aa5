//! What is said about media before they are drawn: each `.vol` file below `tests/diagnostics/findings` has it, rendered, beside it.

use compiler::diagnostic::{Severity, explain, render};
use runtime::frame::{FileLoader, findings};
use tyndall_tests::{files, name, text};

#[test]
fn media_that_are_not_what_was_meant_are_told() {
    insta::with_settings!({
        snapshot_path => "../diagnostics/findings/snapshots",
        prepend_module_to_snapshot => false,
        omit_expression => true,
    }, {
        insta::glob!("../diagnostics/findings", "*.vol", |path| {
            let text = std::fs::read_to_string(path).expect("the input is a text");
            let name = path.file_name().expect("a file has a name").to_string_lossy();
            let done = compiler::compile(&name, &text, &FileLoader::default(), &compiler::Options::default());
            let found = findings(done.program.as_ref().expect("it compiles"), None);
            assert!(found.iter().count() > 0, "{name} has nothing to be told");
            for diagnostic in found.iter() {
                assert!(explain(diagnostic.code).is_some(), "{} is not explained", diagnostic.code);
                assert!(diagnostic.primary_span().is_some(), "{} has no place", diagnostic.code);
            }
            insta::assert_snapshot!("findings", render(&found, &done.sources));
        });
    });
}

/// A warning fails `vol check --deny warnings`, so that none may be wrong about scenes that are as they should be.
#[test]
fn nothing_is_wrong_with_the_examples() {
    for path in files("examples", "vol") {
        let folder = path.parent().expect("a file is in a folder");
        let done =
            compiler::compile(name(&path), &text(&path), &FileLoader::new(folder), &compiler::Options::default());
        let found = findings(done.program.as_ref().expect("it compiles"), None);
        let warnings: Vec<_> = found.iter().filter(|d| d.severity == Severity::Warning).collect();
        assert!(warnings.is_empty(), "{}: {warnings:?}", path.display());
    }
}
