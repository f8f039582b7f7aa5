//! Diagnostics as text, through codespan-reporting.

use super::{Diagnostic, Diagnostics, Severity};
use crate::source::Sources;
use codespan_reporting::{diagnostic as cs, files::SimpleFiles, term};

/// The codespan form of one diagnostic; file ids are the [`crate::source::SourceId`]s.
#[must_use]
pub fn to_codespan(diagnostic: &Diagnostic) -> cs::Diagnostic<usize> {
    let severity = match diagnostic.severity {
        Severity::Error => cs::Severity::Error,
        Severity::Warning => cs::Severity::Warning,
        Severity::Note => cs::Severity::Note,
    };
    let labels = diagnostic.labels.iter().map(|l| {
        let id = l.span.source.0 as usize;
        let label =
            if l.primary { cs::Label::primary(id, l.span.range()) } else { cs::Label::secondary(id, l.span.range()) };
        label.with_message(&l.text)
    });
    let notes = diagnostic.notes.iter().map(|n| format!("note: {n}"));
    let hints = diagnostic.hints.iter().map(|h| format!("help: {h}"));
    cs::Diagnostic::new(severity)
        .with_code(diagnostic.code)
        .with_message(&diagnostic.message)
        .with_labels(labels.collect())
        .with_notes(notes.chain(hints).collect())
}

/// All diagnostics as plain text, without colours: what a pipe and the snapshots see.
#[must_use]
pub fn render(diagnostics: &Diagnostics, sources: &Sources) -> String {
    let mut files = SimpleFiles::new();
    for (_, source) in sources.iter() {
        files.add(source.name.clone(), source.text.clone());
    }
    let config = term::Config::default();
    let mut out = String::new();
    for diagnostic in diagnostics.iter() {
        // Only a span outside its file can fail here; the message itself must not be lost then.
        if term::emit_to_string(&mut out, &config, &files, &to_codespan(diagnostic)).is_err() {
            out.push_str(&format!("{}: {}\n", diagnostic.code, diagnostic.message));
        }
    }
    out
}
