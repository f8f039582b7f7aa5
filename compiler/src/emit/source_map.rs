//! The source map: which line of a generated text stands for which expression of the scene, both ways.
//!
//! naga's spans carry no file and its writers drop them. Every name in a module is unique, so the line that defines a name
//! is found by looking for the name.

use super::Shader;
use crate::source::{Sources, Span};
use rustc_hash::FxHashMap;
use serde::Serialize;

/// What a name stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Origin {
    pub(super) name: String,
    pub(super) span: Span,
}

/// A line of the generated text that stands for something in the scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MapLine {
    /// From 1.
    pub generated: u32,
    /// The name defined or assigned there.
    pub name: String,
    /// What it stands for.
    pub span: Span,
}

/// A line of the map as tools want it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MapEntry {
    /// Line of the generated text, from 1.
    pub generated: u32,
    /// The name defined or assigned there.
    pub name: String,
    /// Name of the source.
    pub source: String,
    /// Line in the source, from 1.
    pub line: usize,
    /// Column in the source in characters, from 1.
    pub column: usize,
    /// First byte of the expression in the source.
    pub start: u32,
    /// One past its last byte.
    pub end: u32,
}

/// Lines of a generated text and what they stand for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SourceMap {
    /// In order of lines.
    pub lines: Vec<MapLine>,
    /// First and last line of each function that stands for something.
    functions: Vec<(u32, u32, Span)>,
}

impl SourceMap {
    /// What a line (from 1) stands for: what it defines, else the item its function stands for.
    #[must_use]
    pub fn scene_span(&self, line: u32) -> Option<Span> {
        let exact = self.lines.binary_search_by_key(&line, |l| l.generated).ok().map(|i| self.lines[i].span);
        exact.or_else(|| self.functions.iter().find(|f| (f.0..=f.1).contains(&line)).map(|f| f.2))
    }

    /// The lines (from 1) that stand for what a span covers. If it covers no whole expression, those of the smallest
    /// expression around it.
    #[must_use]
    pub fn generated_lines(&self, span: Span) -> Vec<u32> {
        let within = |inner: Span, outer: Span| {
            inner.source == outer.source && inner.start >= outer.start && inner.end <= outer.end
        };
        let pick = |wanted: &dyn Fn(Span) -> bool| -> Vec<u32> {
            self.lines.iter().filter(|l| wanted(l.span)).map(|l| l.generated).collect()
        };
        let covered = pick(&|origin| within(origin, span));
        if !covered.is_empty() {
            return covered;
        }
        let around = self.lines.iter().map(|l| l.span).filter(|origin| within(span, *origin));
        match around.min_by_key(|origin| origin.end - origin.start) {
            Some(smallest) => pick(&|origin| origin == smallest),
            None => vec![],
        }
    }

    /// The map with names, lines and columns instead of spans, ready to be written as JSON.
    #[must_use]
    pub fn entries(&self, sources: &Sources) -> Vec<MapEntry> {
        let entry = |l: &MapLine| {
            let (line, column) = sources.line_column(l.span);
            MapEntry {
                generated: l.generated,
                name: l.name.clone(),
                source: sources.get(l.span.source).name.clone(),
                line,
                column,
                start: l.span.start,
                end: l.span.end,
            }
        };
        self.lines.iter().map(entry).collect()
    }
}

impl Shader {
    /// The map of a text that this shader was written as: WGSL, GLSL, HLSL or MSL.
    #[must_use]
    pub fn source_map(&self, text: &str) -> SourceMap {
        let spans: FxHashMap<&str, Span> = self.origins.iter().map(|o| (o.name.as_str(), o.span)).collect();
        let mut map = SourceMap::default();
        let mut function: Option<(u32, Span)> = None;
        for (number, line) in (1u32..).zip(text.lines()) {
            let top = !line.starts_with([' ', '\t']);
            if top && line.starts_with('}') {
                if let Some((first, span)) = function.take() {
                    map.functions.push((first, number, span));
                }
                continue;
            }
            let Some((name, head)) = defined(line) else { continue };
            // GLSL has its own name for the entry point.
            let name = if top && head && name == "main" { self.entry.as_str() } else { name };
            // `f(…` at the beginning of a line deeper in is a call.
            if head && !top {
                continue;
            }
            if let Some(span) = spans.get(name) {
                if head {
                    function = Some((number, *span));
                }
                map.lines.push(MapLine { generated: number, name: name.to_owned(), span: *span });
            }
        }
        map
    }
}

/// The name that a line defines or assigns: the last word before the first `=`, `:`, `(`, `;` or `[`. Also whether it
/// looks like the head of a function.
fn defined(line: &str) -> Option<(&str, bool)> {
    let bytes = line.as_bytes();
    let is_word = |b: &u8| b.is_ascii_alphanumeric() || *b == b'_';
    let mut at = 0;
    while at < bytes.len() {
        match bytes[at] {
            // `metal::float3 name = …`
            b':' if bytes.get(at + 1) == Some(&b':') => at += 1,
            b'=' | b':' | b'(' | b';' | b'[' => break,
            _ => {}
        }
        at += 1;
    }
    let stop = *bytes.get(at)?;
    let before = line[..at].trim_end();
    let start = before.bytes().rposition(|b| !is_word(&b)).map_or(0, |i| i + 1);
    let name = &before[start..];
    (!name.is_empty()).then_some((name, stop == b'('))
}
