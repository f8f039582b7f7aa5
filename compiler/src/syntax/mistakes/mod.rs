//! What went wrong where the grammar stopped, in words for people: first the mistakes that newcomers make, by what stands
//! around the place, then a plain "expected this, found that".

use crate::diagnostic::Diagnostic;
use crate::syntax::ast::is_unit;
use crate::syntax::grammar::{Failure, Rule};
use crate::syntax::lex::{RESERVED, Scan, TokenKind};
use std::ops::Range;

mod items;
mod marks;
mod values;
mod vocabulary;

use vocabulary::{Category, category};

/// What was being read.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(in crate::syntax) enum Place {
    /// `name = value` in a block.
    Property,
    /// `const`, `param` or `fn`.
    Item,
    /// `use`.
    Use,
    /// The rows of a table or transfer function.
    Rows,
}

/// Where the grammar stopped.
#[derive(Clone, Debug)]
pub(in crate::syntax) struct Stop {
    /// The first token that did not fit; one past the last if more was wanted.
    at: usize,
    /// What the grammar had tried there.
    expected: Vec<Rule>,
}

impl Stop {
    /// Finds the token for a failure in the text of `tokens`, which starts at byte `base`.
    pub(in crate::syntax) fn new(scan: &Scan<'_>, tokens: Range<usize>, base: usize, failure: Failure) -> Self {
        let byte = base + failure.at;
        let at = scan.tokens.partition_point(|t| t.end <= byte).clamp(tokens.start, tokens.end);
        Self { at, expected: failure.expected }
    }

    fn wants(&self, rule: Rule) -> bool {
        self.expected.contains(&rule)
    }

    fn wants_value(&self) -> bool {
        self.expected.iter().any(|r| category(*r) == Some(Category::Value))
    }
}

/// A token, as a message names it.
pub(in crate::syntax) fn token(scan: &Scan<'_>, index: usize) -> String {
    let word = scan.word(index);
    match scan.kind(index) {
        None => "the end of the text".to_owned(),
        Some(TokenKind::Word) if RESERVED.contains(&word) => format!("the word `{word}`"),
        Some(TokenKind::Word) if is_unit(word) => format!("the unit `{word}`"),
        Some(TokenKind::Word) => format!("the name `{word}`"),
        Some(TokenKind::Number) => format!("the number `{word}`"),
        Some(TokenKind::String) => "text in quotes".to_owned(),
        Some(TokenKind::Color) => format!("the colour `{word}`"),
        Some(TokenKind::Symbol | TokenKind::Bad) => format!("`{word}`"),
    }
}

/// A reserved word where a name must stand.
pub(in crate::syntax) fn reserved(scan: &Scan<'_>, index: usize) -> Diagnostic {
    Diagnostic::error("E0118", format!("`{}` is a word of the language and cannot be a name", scan.word(index)))
        .at(scan.span(index), "a name must stand here")
        .note(format!("the reserved words are {}", RESERVED.map(|w| format!("`{w}`")).join(", ")))
}

/// Says what is wrong with `tokens`.
pub(in crate::syntax) fn describe(scan: &Scan<'_>, tokens: Range<usize>, stop: &Stop, place: Place) -> Diagnostic {
    let teller = Teller { scan, lo: tokens.start, hi: tokens.end, at: stop.at, stop, place };
    if stop.expected.is_empty() {
        return Diagnostic::error("E0119", "this is too deeply nested to be read")
            .at(teller.here(), "")
            .hint("name the inner parts with `let`, `const` or `fn`");
    }
    None.or_else(|| if place == Place::Use { Some(teller.import()) } else { None })
        .or_else(|| if place == Place::Rows { teller.row() } else { None })
        .or_else(|| stop.wants(Rule::size_part).then(|| teller.size()))
        .or_else(|| teller.power())
        .or_else(|| teller.name_wanted())
        .or_else(|| teller.equals_wanted())
        .or_else(|| teller.function())
        .or_else(|| teller.branch())
        .or_else(|| teller.binding())
        .or_else(|| teller.mark())
        .or_else(|| teller.side_by_side())
        .or_else(|| teller.value_wanted())
        .unwrap_or_else(|| teller.plain())
}

struct Teller<'a, 't> {
    scan: &'a Scan<'t>,
    lo: usize,
    hi: usize,
    /// The token that did not fit; `hi` at the end.
    at: usize,
    stop: &'a Stop,
    place: Place,
}

impl Teller<'_, '_> {
    /// The span of the token that did not fit, or of the last one if more was wanted.
    fn here(&self) -> crate::source::Span {
        self.scan.span(if self.at < self.hi { self.at } else { self.hi - 1 })
    }

    fn found(&self) -> Option<&str> {
        (self.at < self.hi).then(|| self.scan.word(self.at))
    }

    fn found_is(&self, symbols: &[&str]) -> bool {
        self.at < self.hi && symbols.iter().any(|s| self.scan.is(self.at, s))
    }

    fn before(&self) -> Option<usize> {
        self.at.checked_sub(1).filter(|b| *b >= self.lo)
    }

    fn before_ends_value(&self) -> bool {
        self.before().is_some_and(|b| self.scan.ends_value(b))
    }

    /// The bracket around the place, within the tokens.
    fn opener(&self) -> Option<usize> {
        let mut depth = 0usize;
        (self.lo..self.at).rev().find(|index| {
            if self.scan.kind(*index) != Some(TokenKind::Symbol) {
                return false;
            }
            match self.scan.word(*index) {
                ")" | "]" | "}" => depth += 1,
                "(" | "[" | "{" if depth == 0 => return true,
                "(" | "[" | "{" => depth -= 1,
                _ => {}
            }
            false
        })
    }

    fn opener_is(&self, symbol: &str) -> bool {
        self.opener().is_some_and(|o| self.scan.is(o, symbol))
    }

    fn text(&self, from: usize, to: usize) -> &str {
        &self.scan.text[self.scan.span(from).range().start..self.scan.span(to).range().end]
    }

    fn plain(&self) -> Diagnostic {
        let scan = self.scan;
        let mut wanted: Vec<String> = vec![];
        let mut categories: Vec<Category> = self.stop.expected.iter().filter_map(|r| category(*r)).collect();
        categories.sort();
        categories.dedup();
        let useful = categories.iter().any(|c| !matches!(c, Category::Operator));
        for category in categories.into_iter().filter(|c| !useful || *c != Category::Operator) {
            wanted.push(category.phrase().to_owned());
        }
        let list = match wanted.as_slice() {
            [] => "something else".to_owned(),
            [one] => one.clone(),
            [most @ .., last] => format!("{} or {last}", most.join(", ")),
        };
        let problem = if self.at < self.hi {
            Diagnostic::error("E0101", format!("expected {list}, found {}", token(scan, self.at)))
        } else {
            Diagnostic::error("E0101", format!("expected {list} after {}", token(scan, self.hi - 1)))
        };
        problem.at(self.here(), "")
    }
}
