//! Scenes with mistakes, and exactly what is said about them: each `.vol` file below `tests/diagnostics/check` has its
//! rendered diagnostics beside it. Adding a test means adding a file.

use compiler::check;
use compiler::diagnostic::{Diagnostics, explain, render};
use compiler::loader::{GridHeader, LoadError, Loader, Scalar, SplatsHeader};
use compiler::resolve;
use compiler::source::Sources;

/// A machine on which every volume is a 4×4×4 cube of one millimetre, but `missing` ones, and a few modules exist.
struct Fake;

impl Loader for Fake {
    fn module(&self, from: &str, path: &str) -> Result<(String, String), LoadError> {
        let text = match path {
            "./my_lib.vol" => {
                "fn name(x: number) -> number = x\nfn twice(x: number) -> number = 2 * x\nmedium ball { k_a = 1 /m }"
            }
            "./circle_a.vol" => "use \"./circle_b.vol\"::b\nfn a(x: number) -> number = b(x)",
            "./circle_b.vol" => "use \"./circle_a.vol\"::a\nfn b(x: number) -> number = x",
            "./wrong.vol" => "fn f(x: number) -> length = x",
            _ => {
                return Err(LoadError {
                    code: "E0601",
                    message: format!("there is no file `{path}`"),
                    hint: Some(format!("paths are relative to the file that names them, `{from}`")),
                });
            }
        };
        Ok((path.trim_start_matches("./").to_owned(), text.to_owned()))
    }

    fn grid(&self, from: &str, path: &str) -> Result<GridHeader, LoadError> {
        let known = [".nii", ".nii.gz", ".nrrd", ".nhdr"].iter().any(|end| path.ends_with(end));
        if path.contains("missing") || !known {
            return Err(LoadError {
                code: "E0601",
                message: format!("there is no file `{path}`"),
                hint: Some(format!("paths are relative to the file that names them, `{from}`")),
            });
        }
        let mm = 1e-3;
        Ok(GridHeader {
            dims: [4, 4, 4],
            scalar: Scalar::U8,
            slope: 1.0,
            intercept: 0.0,
            world_from_index: [[mm, 0.0, 0.0, 0.0], [0.0, mm, 0.0, 0.0], [0.0, 0.0, mm, 0.0]],
        })
    }

    fn splats(&self, _: &str, _: &str) -> Result<SplatsHeader, LoadError> {
        let bounds = ([0.0; 3], [1.0; 3]);
        Ok(SplatsHeader { count: 1, degree: 0, bounds, core: bounds })
    }
}

fn checked(name: &str, text: &str) -> (Option<check::hir::Scene>, Diagnostics, Sources) {
    let mut sources = Sources::default();
    let mut diagnostics = Diagnostics::default();
    let modules = resolve::load(name, text, &Fake, &mut sources, &mut diagnostics);
    let scene = check::check(&modules, &Fake, &mut diagnostics);
    (scene, diagnostics, sources)
}

#[test]
#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn wrong_scenes_are_explained() {
    insta::with_settings!({
        snapshot_path => "../../tests/diagnostics/check/snapshots",
        prepend_module_to_snapshot => false,
        omit_expression => true,
    }, {
        insta::glob!("../../tests/diagnostics/check", "*.vol", |path| {
            let text = std::fs::read_to_string(path).expect("the input is a text");
            let name = path.file_name().expect("a file has a name").to_string_lossy();
            let (scene, diagnostics, sources) = checked(&name, &text);
            assert!(!diagnostics.0.is_empty(), "{name} has nothing wrong with it");
            assert_eq!(scene.is_none(), diagnostics.has_errors(), "{name}");
            for diagnostic in diagnostics.iter() {
                assert!(explain(diagnostic.code).is_some(), "{} is not explained", diagnostic.code);
                assert!(diagnostic.primary_span().is_some(), "{} has no place", diagnostic.code);
            }
            insta::assert_snapshot!("diagnostics", render(&diagnostics, &sources));
        });
    });
}

/// The code blocks of the language's contract, which every compiler of it must take.
#[test]
#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn the_contract_checks() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/contract");
    let mut files: Vec<_> = std::fs::read_dir(path).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 4, "{files:?}");
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let name = file.file_name().unwrap().to_str().unwrap();
        let (scene, diagnostics, sources) = checked(name, &text);
        assert!(scene.is_some(), "{name}\n{}", render(&diagnostics, &sources));
        assert!(!diagnostics.has_errors());
    }
}

/// Scenes that use the language in ways that are easily broken: they must compile to the end, without a warning of the
/// checker's.
#[test]
#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn right_scenes_compile() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/right");
    let mut files: Vec<_> = std::fs::read_dir(path).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    let mut bad = String::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let name = file.file_name().unwrap().to_str().unwrap();
        let done = compiler::compile(name, &text, &Fake, &compiler::Options::default());
        // What is not drawn yet (09) or hard to draw (05) is for others to say.
        let ours = done.diagnostics.iter().any(|d| !matches!(&d.code[1..3], "05" | "09"));
        if ours || done.program.is_none() {
            bad.push_str(&render(&done.diagnostics, &done.sources));
        }
    }
    assert!(bad.is_empty(), "{bad}");
}

/// Every scene of these tests with each of its words left out, and each doubled: whatever is wrong then, it is reported
/// and nothing breaks.
#[test]
#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn no_scene_breaks_the_checker() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");
    let folders =
        [format!("{root}/right"), format!("{root}/contract"), format!("{root}/../../tests/diagnostics/check")];
    let mut tried = 0;
    for folder in folders {
        let mut files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|f| f.unwrap().path()).collect();
        files.retain(|f| f.extension().is_some_and(|e| e == "vol"));
        files.sort();
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            for (start, end) in words(&text) {
                for new in ["", &format!("{0} {0}", &text[start..end]), "0", "p", "#fff", "head", "(1, 2)"] {
                    let changed = format!("{}{new}{}", &text[..start], &text[end..]);
                    let (scene, diagnostics, sources) = checked("scene.vol", &changed);
                    assert_eq!(
                        scene.is_none(),
                        diagnostics.has_errors(),
                        "{changed}\n{}",
                        render(&diagnostics, &sources)
                    );
                    tried += 1;
                }
            }
        }
    }
    assert!(tried > 10_000, "{tried}");
}

/// Where the words, numbers and marks of a text lie.
fn words(text: &str) -> Vec<(usize, usize)> {
    let mut found: Vec<(usize, usize)> = vec![];
    let mut last = None;
    for (i, c) in text.char_indices() {
        let end = i + c.len_utf8();
        let kind = if c.is_whitespace() {
            0
        } else if c.is_alphanumeric() || c == '_' || c == '.' {
            1
        } else {
            2
        };
        match (kind, last, found.last_mut()) {
            (1, Some(1), Some(word)) => word.1 = end,
            (0, ..) => {}
            _ => found.push((i, end)),
        }
        last = Some(kind);
    }
    found
}
