//! The language's own texts: the library and the examples are read without an error, and formatting keeps them readable.

use compiler::diagnostic::{Diagnostics, Severity, all_codes, render};
use compiler::source::Sources;
use compiler::syntax;

#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn texts(folder: &str) -> Vec<(String, String)> {
    let folder = format!("{}/../{folder}", env!("CARGO_MANIFEST_DIR"));
    let Ok(entries) = std::fs::read_dir(folder) else { return vec![] };
    let paths = entries.filter_map(|e| e.ok().map(|e| e.path()));
    let mut texts: Vec<_> = paths
        .filter(|p| p.extension().is_some_and(|e| e == "vol"))
        .map(|p| (p.display().to_string(), std::fs::read_to_string(&p).expect("a scene is a text")))
        .collect();
    texts.sort();
    texts
}

fn read(name: &str, text: &str) -> (usize, String) {
    let mut sources = Sources::default();
    let id = sources.add(name, text);
    let mut diagnostics = Diagnostics::default();
    let module = syntax::parse(id, text, &mut diagnostics);
    (module.items.len(), render(&diagnostics, &sources))
}

#[test]
fn library_and_examples_are_read_and_formatted() {
    let all = [texts("library"), texts("examples")].concat();
    assert!(!all.is_empty());
    for (name, text) in all {
        let (items, rendered) = read(&name, &text);
        assert!(rendered.is_empty() && items > 0, "{rendered}");
        let once = syntax::format(&text).expect("a text without errors is formatted");
        assert_eq!(read(&name, &once).0, items);
        assert_eq!(syntax::format(&once).as_ref(), Ok(&once), "{name}: formatting is stable");
    }
}

/// The examples of the explanations: what is called right has no syntax error, and what is called wrong has that one.
#[test]
fn explanations_show_what_they_explain() {
    for info in all_codes().filter(|c| c.code.starts_with("E01") || c.code.starts_with("W01")) {
        let mut parts: Vec<(&str, String)> = vec![];
        for line in info.explanation.lines() {
            match line {
                "Wrong:" | "Right:" | "Doubtful:" | "Clear:" => parts.push((line, String::new())),
                _ => {
                    if let (Some((_, code)), Some(line)) = (parts.last_mut(), line.strip_prefix("    ")) {
                        code.push_str(line);
                        code.push('\n');
                    }
                }
            }
        }
        assert!(parts.len() >= 2 || info.code == "E0119", "{} has no two examples", info.code);
        for (kind, code) in parts {
            let mut diagnostics = Diagnostics::default();
            let id = Sources::default().add("example", &code);
            syntax::parse(id, &code, &mut diagnostics);
            match kind {
                "Wrong:" | "Doubtful:" => {
                    assert!(diagnostics.iter().any(|d| d.code == info.code), "{}: {code}{diagnostics:?}", info.code);
                    let severity = if info.code.starts_with('W') { Severity::Warning } else { Severity::Error };
                    assert!(diagnostics.iter().all(|d| d.severity == severity), "{}: {code}", info.code);
                }
                _ => assert!(diagnostics.0.is_empty(), "{}: {code}{diagnostics:?}", info.code),
            }
        }
    }
}

/// The language reference shows only what is read.
#[test]
#[expect(clippy::disallowed_methods, reason = "the test reads its inputs; the compiler does not")]
fn snippets_of_the_reference_are_read() {
    let path = format!("{}/../grammar/reference.md", env!("CARGO_MANIFEST_DIR"));
    let reference = std::fs::read_to_string(path).expect("the reference is there");
    let snippets: Vec<&str> = reference.split("```").skip(1).step_by(2).collect();
    assert!(snippets.len() >= 4);
    for snippet in snippets {
        let (items, rendered) = read("reference.md", snippet);
        assert!(rendered.is_empty() && items > 0, "{rendered}");
    }
}
