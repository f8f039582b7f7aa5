//! The rules of the house that a compiler cannot hold: who may import whom, which room may name which crate, how long a
//! file may grow. CONTRIBUTING.md explains them; a change of a table here is a change of the architecture.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Every room of the compiler with the rooms it may import. `a::b` allows only that part of `a`. Rooms that are files of
/// the crate's root other than these stand for the whole and may import anything; no room may import them but `lib`'s.
const ROOMS: &[(&str, &[&str])] = &[
    ("source", &[]),
    ("diagnostic", &["source"]),
    ("loader", &[]),
    ("syntax", &["diagnostic", "source"]),
    ("library", &["diagnostic", "source", "syntax"]),
    ("resolve", &["diagnostic", "library", "loader", "source", "syntax"]),
    // The checked scene shares the plain enums of the schedule and the picture with the field graph.
    ("check", &["diagnostic", "ir", "loader", "resolve", "source", "syntax"]),
    ("ir", &["loader", "source"]),
    // Operators keep their names from the syntax tree; nothing else of it is left after checking.
    ("lower", &["check::hir", "diagnostic", "ir", "loader", "source", "syntax::ast"]),
    ("program", &["ir", "loader", "source"]),
    // Lengths are changed where numbers have dimensions, the rest in the graph.
    ("trial", &["check::hir", "ir", "syntax::ast"]),
    // A grid's header bounds its values.
    ("analysis", &["ir", "loader"]),
    // Passes write into the ledger what they leave out.
    ("passes", &["analysis", "ir", "program::Ledger"]),
    ("fields", &["analysis", "ir", "program", "source"]),
    // It builds what the passes would leave of it.
    ("transport", &["analysis", "diagnostic", "fields", "ir", "passes", "program", "source"]),
    // Backends read the caller's overrides of the schedule.
    ("backends", &["Options", "diagnostic", "fields", "ir", "passes", "program", "source", "transport"]),
    ("emit", &["diagnostic", "ir", "program", "source"]),
];

/// The files of the compiler's root that join the rooms.
const JOINTS: &[&str] = &["lib", "options", "compile"];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the repository").to_owned()
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    let Ok(entries) = fs::read_dir(folder) else { return files };
    for entry in entries.map(|e| e.expect("a readable folder").path()) {
        if entry.is_dir() {
            files.extend(rust_files(&entry));
        } else if entry.extension().is_some_and(|e| e == "rs") {
            files.push(entry);
        }
    }
    files.sort();
    files
}

/// The code of a file: comments and the contents of strings blanked, so that only code is searched. Line breaks stay.
fn code_of(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    let blank =
        |out: &mut Vec<u8>, part: &[u8]| out.extend(part.iter().map(|b| if *b == b'\n' { b'\n' } else { b' ' }));
    while i < bytes.len() {
        let rest = &bytes[i..];
        let length = if rest.starts_with(b"//") {
            rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len())
        } else if rest.starts_with(b"/*") {
            block_comment(rest)
        } else if let Some(length) = raw_string(rest).filter(|_| i == 0 || !is_word(bytes[i - 1])) {
            length
        } else if rest[0] == b'"' {
            quoted(rest)
        } else if rest[0] == b'\'' && (rest.get(1) == Some(&b'\\') || rest.get(2) == Some(&b'\'')) {
            let first = if rest[1] == b'\\' { 3 } else { 2 };
            (first..rest.len()).find(|n| rest[*n] == b'\'').map_or(1, |n| n + 1)
        } else {
            out.push(rest[0]);
            i += 1;
            continue;
        };
        let length = length.min(rest.len());
        blank(&mut out, &rest[..length]);
        i += length;
    }
    String::from_utf8_lossy(&out).into_owned()
}

fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_' || byte >= 0x80
}

fn block_comment(text: &[u8]) -> usize {
    let (mut depth, mut i) = (0, 0);
    while i < text.len() {
        if text[i..].starts_with(b"/*") {
            depth += 1;
            i += 2;
        } else if text[i..].starts_with(b"*/") {
            depth -= 1;
            i += 2;
            if depth == 0 {
                break;
            }
        } else {
            i += 1;
        }
    }
    i
}

fn quoted(text: &[u8]) -> usize {
    let mut i = 1;
    while i < text.len() && text[i] != b'"' {
        i += if text[i] == b'\\' { 2 } else { 1 };
    }
    i + 1
}

fn raw_string(text: &[u8]) -> Option<usize> {
    let after = text.strip_prefix(b"br").or_else(|| text.strip_prefix(b"r"))?;
    let hashes = after.iter().take_while(|b| **b == b'#').count();
    if after.get(hashes) != Some(&b'"') {
        return None;
    }
    let start = text.len() - after.len() + hashes + 1;
    let end = [b"\"".as_slice(), &b"#".repeat(hashes)].concat();
    let found = text[start..].windows(end.len()).position(|w| w == end)?;
    Some(start + found + end.len())
}

/// The code without its test modules: they may look wherever they need to.
fn without_tests(code: &str) -> String {
    let mut rest = code;
    let mut out = String::new();
    while let Some(at) = rest.find("#[cfg(test)]") {
        out.push_str(&rest[..at]);
        let item = &rest[at..];
        let (brace, semicolon) = (item.find('{'), item.find(';'));
        let end = match (brace, semicolon) {
            (Some(brace), s) if s.is_none_or(|s| brace < s) => brace + closing_brace(&item[brace..]),
            (_, Some(semicolon)) => semicolon + 1,
            (_, None) => item.len(),
        };
        rest = &item[end..];
    }
    out + rest
}

fn closing_brace(text: &str) -> usize {
    let mut depth = 0;
    for (i, c) in text.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return i + 1;
        }
    }
    text.len()
}

/// Where a word stands as a word of its own.
fn words<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    let bytes = code.as_bytes();
    code.match_indices(word).map(|(at, _)| at).filter(move |at| {
        let end = at + word.len();
        (*at == 0 || !is_word(bytes[at - 1])) && (end == bytes.len() || !is_word(bytes[end]))
    })
}

/// Every path in the code that starts at the crate's root, as its first two segments after it; `module` is where the code
/// stands. Groups (`use crate::{ir::Op, source::Span}`) are taken apart.
fn root_paths(code: &str, module: &[String]) -> BTreeSet<Vec<String>> {
    let mut found = BTreeSet::new();
    for at in words(code, "crate") {
        if let Some(rest) = code[at + 5..].trim_start().strip_prefix("::") {
            expand(rest, &[], &mut found);
        }
    }
    for at in words(code, "super") {
        // `super::super` is read from its first word.
        if code[..at].trim_end().ends_with("::") {
            continue;
        }
        let (mut base, mut rest) = (module.to_vec(), &code[at..]);
        while let Some(after) = rest.trim_start().strip_prefix("super").and_then(|r| r.trim_start().strip_prefix("::"))
        {
            base.pop();
            rest = after;
        }
        if !base.starts_with(&module[..1]) {
            expand(rest, &base, &mut found);
        }
    }
    found
}

fn expand(rest: &str, base: &[String], found: &mut BTreeSet<Vec<String>>) {
    let rest = rest.trim_start();
    if let Some(group) = rest.strip_prefix('{') {
        let inner = &group[..closing_brace(rest).saturating_sub(2)];
        let (mut depth, mut start) = (0, 0);
        for (i, c) in inner.char_indices().chain([(inner.len(), ',')]) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    expand(&inner[start..i], base, found);
                    start = i + 1;
                }
                _ => {}
            }
        }
        return;
    }
    let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    if name.is_empty() {
        return;
    }
    let mut path = base.to_vec();
    path.push(name.clone());
    match rest[name.len()..].trim_start().strip_prefix("::") {
        Some(after) if path.len() < 2 => expand(after, &path, found),
        Some(_) | None => {
            found.insert(path);
        }
    }
}

/// The module path of a file below `src`: `ir/eval/mod.rs` is `ir::eval`.
fn module_of(file: &Path, src: &Path) -> Vec<String> {
    let relative = file.strip_prefix(src).expect("a file of the crate").with_extension("");
    let mut path: Vec<String> = relative.iter().map(|s| s.to_string_lossy().into_owned()).collect();
    if path.last().is_some_and(|l| l == "mod") {
        path.pop();
    }
    path
}

fn is_test_file(file: &Path) -> bool {
    file.components().any(|c| c.as_os_str() == "tests") || file.ends_with("tests.rs")
}

fn production_code(file: &Path) -> String {
    without_tests(&code_of(&fs::read_to_string(file).expect("a readable file")))
}

#[test]
fn rooms_of_the_compiler_import_only_what_the_table_allows() {
    let src = repository().join("compiler/src");
    let table: BTreeMap<&str, &[&str]> = ROOMS.iter().copied().collect();
    let mut wrong = vec![];
    for file in rust_files(&src) {
        let module = module_of(&file, &src);
        let room = module.first().expect("a file has a module").as_str();
        if is_test_file(&file) || JOINTS.contains(&room) {
            continue;
        }
        let Some(allowed) = table.get(room) else {
            wrong.push(format!("{}: the room `{room}` is not in the table", file.display()));
            continue;
        };
        for path in root_paths(&production_code(&file), &module) {
            let whole = path.join("::");
            let fits = |a: &&str| *a == path[0] || whole == **a;
            if path[0] != room && !allowed.iter().any(fits) {
                wrong.push(format!("{}: `{room}` may not import `{whole}`", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_table_of_rooms_has_no_cycle() {
    let mut settled: BTreeSet<&str> = BTreeSet::new();
    while settled.len() < ROOMS.len() {
        let before = settled.len();
        for (room, allowed) in ROOMS {
            let is_settled = |a: &&str| *a == "Options" || settled.contains(a.split("::").next().expect("a name"));
            if allowed.iter().all(is_settled) {
                settled.insert(room);
            }
        }
        assert!(settled.len() > before, "a cycle among the rooms that are not {settled:?}");
    }
}

#[test]
fn no_backend_imports_another() {
    let folder = repository().join("compiler/src/backends");
    let backends: Vec<String> = fs::read_dir(&folder)
        .map(|entries| {
            let names = entries.map(|e| e.expect("a readable folder").path());
            names
                .filter(|p| p.is_dir())
                .map(|p| p.file_name().expect("a name").to_string_lossy().into_owned())
                .collect()
        })
        .unwrap_or_default();
    for own in &backends {
        for file in rust_files(&folder.join(own)) {
            let code = production_code(&file);
            for other in backends.iter().filter(|b| *b != own) {
                let path = format!("backends::{other}");
                let beside = format!("super::{other}");
                assert!(!code.contains(&path), "{}: `{own}` imports `{other}`", file.display());
                assert!(!code.contains(&beside), "{}: `{own}` imports `{other}`", file.display());
            }
        }
    }
}

/// Fails for each file below `folder`, save those below `home`, that names the crate.
fn only_named_in(folder: &str, homes: &[&str], name: &str) {
    let root = repository();
    for file in rust_files(&root.join(folder)) {
        if homes.iter().any(|h| file.starts_with(root.join(h))) || is_test_file(&file) {
            continue;
        }
        let code = production_code(&file);
        let at = words(&code, name).next();
        assert!(at.is_none(), "{}: only {homes:?} may name `{name}`", file.display());
    }
}

#[test]
fn naga_and_wgpu_each_stay_in_their_room() {
    only_named_in("compiler/src", &["compiler/src/emit"], "naga");
    only_named_in("compiler/src", &[], "wgpu");
    only_named_in("runtime/src", &["runtime/src/engine/gpu"], "wgpu");
    only_named_in("runtime/src", &["runtime/src/engine/gpu"], "naga");
    only_named_in("cli/src", &[], "wgpu");
    only_named_in("cli/src", &[], "naga");
}

#[test]
fn only_syntax_names_pest() {
    only_named_in("compiler/src", &["compiler/src/syntax"], "pest");
}

#[test]
fn the_compiler_touches_no_file_clock_thread_or_environment() {
    let src = repository().join("compiler/src");
    for file in rust_files(&src).into_iter().filter(|f| !is_test_file(f)) {
        let code = production_code(&file);
        for path in ["std::fs", "std::env", "std::thread", "std::time", "std::net", "std::process"] {
            assert!(!code.contains(path), "{}: the compiler may not use `{path}`", file.display());
        }
    }
}

/// The files that may say `unsafe`, each once: wgpu takes a pipeline cache back on trust, and the environment is changed
/// before there is a second thread.
const UNSAFE: &[&str] = &["runtime/src/engine/gpu/pipelines.rs", "cli/src/main.rs"];

#[test]
fn no_file_is_over_a_thousand_lines_and_none_is_unsafe() {
    let root = repository();
    for part in ["compiler", "runtime", "cli", "tests"] {
        for file in rust_files(&root.join(part)) {
            let text = fs::read_to_string(&file).expect("a readable file");
            let lines = text.lines().count();
            assert!(lines <= 1000, "{}: {lines} lines; split it by what it is about", file.display());
            let code = code_of(&text);
            let allowed = usize::from(UNSAFE.iter().any(|f| file == root.join(f)));
            assert!(words(&code, "unsafe").count() <= allowed, "{}: `unsafe`", file.display());
        }
    }
}

#[test]
fn the_library_and_the_grammar_hold_no_rust() {
    for part in ["library", "grammar", "examples"] {
        assert_eq!(rust_files(&repository().join(part)), Vec::<PathBuf>::new(), "{part}/ is no place for Rust");
    }
}

mod reading_code {
    use super::{code_of, root_paths, without_tests, words};

    fn paths(code: &str, module: &[&str]) -> Vec<String> {
        let module: Vec<String> = module.iter().map(|s| (*s).to_owned()).collect();
        root_paths(code, &module).into_iter().map(|p| p.join("::")).collect()
    }

    #[test]
    fn comments_and_strings_are_no_code() {
        let code =
            code_of("a // crate::x\n/* crate::y /* z */ */ b \"crate::\\\"w\" r#\"crate::\"v\"# '\"' c '\\'' d 'l e");
        let words: Vec<&str> = code.split_whitespace().collect();
        assert_eq!(words, ["a", "b", "c", "d", "'l", "e"]);
    }

    #[test]
    fn test_modules_are_left_out() {
        let code = without_tests("a #[cfg(test)] mod tests; b #[cfg(test)] mod tests { fn f() { } } c");
        assert_eq!(code.split_whitespace().collect::<Vec<_>>(), ["a", "b", "c"]);
    }

    #[test]
    fn groups_and_supers_are_followed() {
        let found =
            paths("use crate::{ir::{Op, Node}, source::Span}; let x: crate::program::Ledger;", &["lower", "expr"]);
        assert_eq!(found, ["ir::Node", "ir::Op", "program::Ledger", "source::Span"]);
        assert_eq!(paths("use super::super::ir::Op; use super::Lowerer;", &["lower", "expr"]), ["ir::Op"]);
        assert_eq!(words("naga nagas our_naga (naga)", "naga").count(), 2);
    }
}
