//! Printing: diagnostics for people and programs, documents, progress.

use crate::args::Format;
use codespan_reporting::files::SimpleFiles;
use codespan_reporting::term::termcolor::{ColorChoice, StandardStream};
use codespan_reporting::term::{Config, emit_to_write_style};
use compiler::diagnostic::{Diagnostic, Diagnostics, Label, Severity, to_codespan};
use compiler::source::{Sources, Span};
use indicatif::{ProgressBar, ProgressStyle};
use runtime::frame::{Cause, Origins, Trouble};
use serde_json::{Map, Value, json};
use std::io::{IsTerminal, Write};

/// How the program ends.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// What was asked for is done.
    Done = 0,
    /// The input is at fault.
    Input = 1,
    /// The command line is wrong.
    Usage = 2,
    /// The machine cannot do it.
    Machine = 3,
}

impl From<Cause> for Exit {
    fn from(cause: Cause) -> Self {
        match cause {
            Cause::Input => Self::Input,
            Cause::Arguments => Self::Usage,
            Cause::Machine => Self::Machine,
        }
    }
}

/// Writes to standard output. A reader that has seen enough is no error.
pub(crate) fn say(text: &str) {
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}

/// Writes to standard error.
pub(crate) fn complain(text: &str) {
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

/// Prints a document: its schema and version, then the rest.
pub(crate) fn document(schema: &str, body: Value) {
    say(&document_text(schema, body));
}

/// The text of a document.
pub(crate) fn document_text(schema: &str, body: Value) -> String {
    let mut all = Map::new();
    all.insert("schema".into(), schema.into());
    all.insert("version".into(), 1.into());
    if let Value::Object(body) = body {
        all.extend(body);
    }
    format!("{:#}\n", Value::Object(all))
}

/// Prints diagnostics for people, in colour on a terminal.
pub(crate) fn diagnostics(found: &Diagnostics, sources: &Sources) {
    let mut files = SimpleFiles::new();
    for (_, source) in sources.iter() {
        files.add(source.name.clone(), source.text.clone());
    }
    let colour = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let mut stream = StandardStream::stderr(if colour { ColorChoice::Auto } else { ColorChoice::Never });
    for diagnostic in found.iter() {
        if emit_to_write_style(&mut stream, &Config::default(), &files, &to_codespan(diagnostic)).is_err() {
            complain(&format!("{}: {}\n", diagnostic.code, diagnostic.message));
        }
    }
}

/// A diagnostic for programs.
pub(crate) fn diagnostic_json(diagnostic: &Diagnostic, sources: &Sources) -> Value {
    let mut object = json!({
        "code": diagnostic.code,
        "severity": diagnostic.severity,
        "message": diagnostic.message,
    });
    if let (Value::Object(object), Value::Object(place)) = (&mut object, place(diagnostic.primary_span(), sources)) {
        object.extend(place);
        let labels: Vec<Value> = diagnostic.labels.iter().map(|l| label_json(l, sources)).collect();
        object.insert("labels".into(), labels.into());
        object.insert("notes".into(), diagnostic.notes.clone().into());
        object.insert("hints".into(), diagnostic.hints.clone().into());
    }
    object
}

fn label_json(label: &Label, sources: &Sources) -> Value {
    let mut object = place(Some(label.span), sources);
    if let Value::Object(object) = &mut object {
        object.insert("text".into(), label.text.clone().into());
        object.insert("primary".into(), label.primary.into());
    }
    object
}

/// File, line and column of both ends, from 1; the end is exclusive. Nulls for what has no place.
fn place(span: Option<Span>, sources: &Sources) -> Value {
    let Some(span) = span else {
        return json!({ "file": null, "line": null, "column": null, "end_line": null, "end_column": null });
    };
    let (line, column) = sources.line_column(span);
    let (end_line, end_column) = sources.line_column(Span { start: span.end, ..span });
    let file = &sources.get(span.source).name;
    json!({ "file": file, "line": line, "column": column, "end_line": end_line, "end_column": end_column })
}

/// All diagnostics for programs.
pub(crate) fn diagnostics_json(found: &Diagnostics, sources: &Sources) -> Value {
    found.iter().map(|d| diagnostic_json(d, sources)).collect()
}

/// Reports why a command could not do its work.
pub(crate) fn fail(format: Format, schema: &str, trouble: &Trouble) -> Exit {
    match format {
        Format::Human => diagnostics(&trouble.diagnostics, &trouble.sources),
        Format::Json => {
            let list = diagnostics_json(&trouble.diagnostics, &trouble.sources);
            document(schema, json!({ "ok": false, "diagnostics": list }));
        }
    }
    trouble.cause.into()
}

/// A failure without a place in any text.
pub(crate) fn trouble(cause: Cause, code: &'static str, message: impl Into<String>, hint: Option<&str>) -> Trouble {
    let mut diagnostic = Diagnostic::error(code, message);
    diagnostic.hints.extend(hint.map(str::to_owned));
    Trouble { cause, diagnostics: Diagnostics(vec![diagnostic]), sources: Sources::default() }
}

/// How many errors and warnings there are.
pub(crate) fn count(found: &Diagnostics) -> (usize, usize) {
    let of = |severity| found.iter().filter(|d| d.severity == severity).count();
    (of(Severity::Error), of(Severity::Warning))
}

/// Where an error comes from, in lx.
pub(crate) fn origins_json(origins: Origins) -> Value {
    json!({
        "discretisation": number(origins.discretisation),
        "rounding": number(origins.rounding),
        "storage": number(origins.storage),
        "statistical": number(origins.statistical),
    })
}

/// The same for people; what is left out where there is none of it.
pub(crate) fn origins_text(origins: Origins) -> String {
    let Origins { discretisation, rounding, storage, statistical } = origins;
    let chance = if statistical > 0.0 { format!("statistical {statistical:.2e}, ") } else { String::new() };
    format!("{chance}discretisation {discretisation:.2e}, rounding {rounding:.2e}, storage {storage:.2e} lx")
}

/// A number for JSON: what JSON cannot say is a string.
pub(crate) fn number(value: f64) -> Value {
    if value.is_nan() {
        "nan".into()
    } else if value.is_infinite() {
        if value > 0.0 { "inf".into() } else { "-inf".into() }
    } else {
        value.into()
    }
}

/// A bar on a terminal, nothing elsewhere.
pub(crate) fn progress(format: Format, what: &str) -> ProgressBar {
    if format == Format::Json || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent}% {elapsed}") {
        bar.set_style(style);
    }
    bar.set_message(what.to_owned());
    bar
}
