//! What is said about scenes that compile no further than their field graph, or name files that are wrong: each `.vol` file
//! below `tests/diagnostics/compile` has its rendered diagnostics beside it. What only checking finds stands in
//! `tests/diagnostics/check`. Adding a test means adding a file.

use compiler::diagnostic::{explain, render};
use runtime::frame::FileLoader;

#[test]
fn scenes_that_cannot_be_compiled_are_explained() {
    // As it is seen from here, so that what is printed is the same on every machine.
    let folder = "diagnostics/compile";
    insta::with_settings!({
        snapshot_path => "../diagnostics/compile/snapshots",
        prepend_module_to_snapshot => false,
        omit_expression => true,
    }, {
        insta::glob!("../diagnostics/compile", "*.vol", |path| {
            let text = std::fs::read_to_string(path).expect("the input is a text");
            let name = path.file_name().expect("a file has a name").to_string_lossy();
            let mut done = compiler::compile(&name, &text, &FileLoader::new(folder), &compiler::Options::default());
            // What is not drawn yet is for others to say.
            done.diagnostics.0.retain(|d| !d.code[1..].starts_with("09"));
            assert!(done.diagnostics.has_errors(), "{name} has nothing wrong with it");
            assert!(done.program.is_none(), "{name}");
            for diagnostic in done.diagnostics.iter() {
                assert!(explain(diagnostic.code).is_some(), "{} is not explained", diagnostic.code);
                assert!(diagnostic.primary_span().is_some(), "{} has no place", diagnostic.code);
            }
            insta::assert_snapshot!("diagnostics", render(&done.diagnostics, &done.sources));
        });
    });
}
