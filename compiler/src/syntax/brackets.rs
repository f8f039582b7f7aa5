//! Which bracket belongs to which, in a text where some may be missing.

use super::ast::BlockKind;
use super::lex::{Scan, TokenKind};
use super::tree::block_kind;
use crate::diagnostic::Diagnostic;

/// The brackets of a text.
pub(super) struct Brackets {
    /// For each token, how many brackets are open around it; the brackets themselves count as outside.
    pub(super) depth: Vec<usize>,
    /// For each opening bracket that is closed, the closing one.
    pub(super) partner: Vec<Option<usize>>,
    /// What does not match, with the token it is about.
    pub(super) problems: Vec<(usize, Diagnostic)>,
}

/// How an item starts at this token, if one does.
#[derive(Copy, Clone, PartialEq, Eq)]
pub(super) enum Start {
    /// `medium x {`, `camera {`: a shape that nothing else in the language has.
    Certain,
    /// `const x =`, `use std::`: inside a block it might be something else.
    Likely,
}

/// Whether an item starts at this token.
pub(super) fn item_start(scan: &Scan<'_>, index: usize) -> Option<Start> {
    if scan.kind(index) != Some(TokenKind::Word) {
        return None;
    }
    let word = scan.word(index);
    let named = match block_kind(word).map(BlockKind::is_named) {
        Some(named) => Some(named),
        None if matches!(word, "table" | "transfer") => Some(true),
        None => None,
    };
    match (named, word) {
        (Some(true), _) if scan.is_name(index + 1) && scan.is(index + 2, "{") => Some(Start::Certain),
        (Some(false), _) if scan.is(index + 1, "{") => Some(Start::Certain),
        (None, "const" | "param") if scan.is_name(index + 1) && scan.is(index + 2, "=") => Some(Start::Likely),
        (None, "fn") if scan.is_name(index + 1) && scan.is(index + 2, "(") => Some(Start::Likely),
        (None, "use") if scan.kind(index + 1) == Some(TokenKind::String) => Some(Start::Likely),
        (None, "use") if scan.is_name(index + 1) && scan.is(index + 2, "::") => Some(Start::Likely),
        _ => None,
    }
}

/// Matches the brackets of a text: as they stand if that works out, otherwise with the help of where items start.
pub(super) fn matched(scan: &Scan<'_>) -> Brackets {
    let plain = walk(scan, false);
    if plain.problems.is_empty() { plain } else { walk(scan, true) }
}

/// Brackets reported at one place; the outermost ones matter.
const MAX_UNCLOSED: usize = 4;

fn closing(open: &str) -> &'static str {
    match open {
        "(" => ")",
        "[" => "]",
        _ => "}",
    }
}

fn walk(scan: &Scan<'_>, items_close: bool) -> Brackets {
    let count = scan.tokens.len();
    let mut brackets = Brackets { depth: vec![0; count], partner: vec![None; count], problems: vec![] };
    let mut open: Vec<usize> = vec![];
    for index in 0..count {
        if items_close && !open.is_empty() {
            let starts = match item_start(scan, index) {
                Some(Start::Certain) => true,
                Some(Start::Likely) => scan.tokens[index].starts_line,
                None => false,
            };
            if starts {
                for opening in open.drain(..).take(MAX_UNCLOSED) {
                    let what = format!("`{}` starts a new item here", scan.word(index));
                    brackets.problems.push((opening, unclosed(scan, opening).because(scan.span(index), what)));
                }
            }
        }
        brackets.depth[index] = open.len();
        if scan.kind(index) != Some(TokenKind::Symbol) {
            continue;
        }
        let word = scan.word(index);
        match word {
            "(" | "[" | "{" => open.push(index),
            ")" | "]" | "}" => match open.iter().rposition(|o| closing(scan.word(*o)) == word) {
                // A `)` does not reach through a `{`: between its braces all is well.
                Some(at) if word == "}" || open[at..].iter().all(|o| scan.word(*o) != "{") => {
                    for forgotten in open.drain(at + 1..).take(MAX_UNCLOSED) {
                        let what = format!("this `{word}` closes what lies around it");
                        brackets.problems.push((forgotten, unclosed(scan, forgotten).because(scan.span(index), what)));
                    }
                    if let Some(opening) = open.pop() {
                        brackets.partner[opening] = Some(index);
                    }
                    brackets.depth[index] = open.len();
                }
                _ => match open.last().copied() {
                    Some(top) if scan.word(top) != "{" => {
                        open.pop();
                        brackets.partner[top] = Some(index);
                        brackets.depth[index] = open.len();
                        let opened = scan.word(top);
                        let problem = Diagnostic::error("E0103", format!("`{opened}` is closed by `{word}`"))
                            .at(scan.span(index), "")
                            .because(scan.span(top), "opened here")
                            .hint(format!("write `{}`", closing(opened)));
                        brackets.problems.push((index, problem));
                    }
                    _ => {
                        let problem = Diagnostic::error("E0103", format!("this `{word}` closes nothing"));
                        let problem = problem.at(scan.span(index), "").hint("delete it, or add what opens it");
                        brackets.problems.push((index, problem));
                    }
                },
            },
            _ => {}
        }
    }
    for opening in open.into_iter().take(MAX_UNCLOSED) {
        brackets.problems.push((opening, unclosed(scan, opening)));
    }
    brackets
}

fn unclosed(scan: &Scan<'_>, opening: usize) -> Diagnostic {
    let word = scan.word(opening);
    Diagnostic::error("E0102", format!("this `{word}` is never closed"))
        .at(scan.span(opening), "opened here")
        .hint(format!("close it with `{}`", closing(word)))
}
