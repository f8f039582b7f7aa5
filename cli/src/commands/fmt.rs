//! `vol fmt`

use super::read;
use crate::args::{Fmt, Format};
use crate::output::{Exit, diagnostics, diagnostics_json, document, say};
use compiler::diagnostic::{Diagnostic, Diagnostics};
use compiler::source::Sources;
use runtime::frame::{FileLoader, STDIN};
use serde_json::{Value, json};

/// What became of one file.
enum Outcome {
    Same,
    Changed(String),
    Failed(Diagnostics, Sources),
}

pub(super) fn run(format: Format, arguments: &Fmt) -> Exit {
    let loader = FileLoader::default();
    let mut exit = Exit::Done;
    let mut files: Vec<Value> = vec![];
    for name in &arguments.scenes {
        let mut outcome = one(&loader, name);
        if let Outcome::Changed(text) = &outcome
            && !arguments.check
            && name != STDIN
            && let Err(error) = std::fs::write(name, text)
        {
            let diagnostic = Diagnostic::error("E0601", format!("`{name}` cannot be written: {error}"));
            outcome = Outcome::Failed(Diagnostics(vec![diagnostic]), Sources::default());
        }
        let changed = matches!(outcome, Outcome::Changed(_));
        if matches!(outcome, Outcome::Failed(..)) || (changed && arguments.check) {
            exit = Exit::Input;
        }
        match (format, outcome) {
            (Format::Human, Outcome::Failed(found, sources)) => diagnostics(&found, &sources),
            (Format::Human, Outcome::Changed(text)) if name == STDIN && !arguments.check => say(&text),
            (Format::Human, Outcome::Same) if name == STDIN && !arguments.check => {}
            (Format::Human, Outcome::Changed(_)) => say(&format!("{name}\n")),
            (Format::Human, Outcome::Same) => {}
            (Format::Json, Outcome::Failed(found, sources)) => {
                files.push(json!({ "file": name, "diagnostics": diagnostics_json(&found, &sources) }));
            }
            (Format::Json, Outcome::Changed(text)) => {
                let text = if name == STDIN { Value::from(text) } else { Value::Null };
                files.push(json!({ "file": name, "changed": true, "text": text, "diagnostics": [] }));
            }
            (Format::Json, Outcome::Same) => {
                files.push(json!({ "file": name, "changed": false, "text": null, "diagnostics": [] }));
            }
        }
    }
    if format == Format::Json {
        document("vol.fmt", json!({ "ok": exit == Exit::Done, "files": files }));
    }
    exit
}

fn one(loader: &FileLoader, name: &str) -> Outcome {
    let text = match read(loader, name) {
        Ok(text) => text,
        Err(trouble) => return Outcome::Failed(trouble.diagnostics, trouble.sources),
    };
    match compiler::syntax::format(&text) {
        // Standard output gets the whole text, changed or not.
        Ok(formatted) if formatted == text && name != STDIN => Outcome::Same,
        Ok(formatted) => Outcome::Changed(formatted),
        Err(found) => {
            let mut sources = Sources::default();
            sources.add(name, text);
            Outcome::Failed(found, sources)
        }
    }
}
