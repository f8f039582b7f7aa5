//! Marks of other languages, ours in the wrong place, and values without a mark between them.

use super::{Place, Teller};
use crate::diagnostic::Diagnostic;
use crate::syntax::ast::is_unit;
use crate::syntax::grammar::Rule;
use crate::syntax::lex::{RESERVED, TokenKind};
use crate::syntax::{tree, words};

impl Teller<'_, '_> {
    /// Marks of other languages, and ours in the wrong place.
    pub(super) fn mark(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        if self.at >= self.hi || scan.kind(self.at) != Some(TokenKind::Symbol) {
            return None;
        }
        let problem = |code: &'static str, message: String| Diagnostic::error(code, message).at(self.here(), "");
        let found = scan.word(self.at);
        let before = self.before();
        let word_before = before.map_or("", |b| scan.word(b));
        let adjacent = before.is_some_and(|b| scan.tokens[b].end == scan.tokens[self.at].start);
        let pair = || before.map_or(self.here(), |b| scan.span(b).to(self.here()));
        Some(match found {
            "*" if adjacent && word_before == "*" => {
                Diagnostic::error("E0116", "there is no `**` operator").at(pair(), "").hint("write `^` for powers")
            }
            "+" if adjacent && word_before == "+" => {
                Diagnostic::error("E0116", "there is no `++` operator").at(pair(), "").note("values never change")
            }
            "=" if adjacent && matches!(word_before, "+" | "-" | "*" | "/" | "^") => {
                let message = format!("there is no `{word_before}=` operator");
                Diagnostic::error("E0116", message).at(pair(), "").note("values never change")
            }
            "=" if self.opener_is("(") && before.is_some_and(|b| scan.is_name(b)) => {
                let function = self.opener().and_then(|o| o.checked_sub(1)).map_or("", |f| scan.word(f));
                if matches!(function, "sum" | "product") {
                    problem("E0114", format!("`{function}` runs over a range with `in`"))
                        .hint(format!("write `{function}({word_before} in 0..n) …`"))
                } else {
                    problem("E0114", "arguments are named with `:`, not `=`".to_owned())
                        .hint(format!("write `{word_before}: …`"))
                }
            }
            "=>" | "->" => problem("E0116", format!("`{found}` has no meaning here")),
            "=" => problem("E0116", "a second `=` has no meaning here".to_owned()).hint("a comparison is written `==`"),
            _ if self.stop.wants(Rule::range_dots) && self.before_ends_value() => {
                problem("E0101", format!("expected `..` between the ends of a range, found `{found}`"))
                    .hint("write a range as `0 .. 10`")
            }
            "," | ";" if self.opener().is_none() && self.before_ends_value() => {
                let things = match self.place {
                    Place::Property => "properties",
                    Place::Item | Place::Use | Place::Rows => "items",
                };
                problem("E0115", format!("{things} are not separated by `{found}`")).hint("leave it out")
            }
            ";" if self.opener_is("(") || self.opener_is("[") => {
                problem("E0115", "values in brackets are separated by commas".to_owned()).hint("write `,`")
            }
            "," if self.opener_is("{") && self.before_ends_value() => {
                problem("E0115", "the names of a block are not separated by `,`".to_owned())
                    .hint("leave it out, or write `;`")
            }
            "::" => problem("E0124", "a path stands only in `use`".to_owned())
                .hint("import the name at the top, as in `use std::noise::fbm`, and write it alone"),
            "[" if self.before_ends_value() => problem("E0111", "values are not indexed".to_owned())
                .hint("name the part, as in `p.x`, or use a `table`"),
            "(" if self.before_ends_value() => {
                let object = before.filter(|b| *b >= self.lo + 2 && scan.is(*b - 1, "."));
                let problem = if object.is_some() {
                    problem("E0111", "a part of a value is not called".to_owned())
                        .hint(format!("functions stand before their arguments: `{word_before}(…)`"))
                } else {
                    problem("E0111", "two values stand side by side".to_owned())
                        .hint("write `*` between them to multiply")
                };
                match before {
                    Some(b) => problem.because(scan.span(b), "the first ends here"),
                    None => problem,
                }
            }
            "{" if self.before_ends_value() => {
                let item = (self.lo..self.at).rev().take(2).find(|i| words::block_word(scan.word(*i)).is_some());
                match item {
                    Some(item) => problem("E0101", "items do not stand inside each other".to_owned())
                        .because(scan.span(item), "a new item seems to start here")
                        .hint("close the braces before it"),
                    None => problem("E0111", "a block cannot follow a value".to_owned())
                        .hint("write an operator between them"),
                }
            }
            ".." => problem("E0101", "a range has no place here".to_owned())
                .note("ranges stand in `sum(i in 0..n)` and after `in` of a `param`"),
            "." if self.before_ends_value() => problem("E0101", "expected the name of a part after `.`".to_owned()),
            "." => problem("E0107", "a point does not start a value".to_owned())
                .hint("a number starts with a digit: `0.5`"),
            ":" if self.opener_is("(") => {
                problem("E0101", "`:` names an argument, and follows a single word".to_owned())
            }
            ":" => problem("E0101", "`:` has no meaning here".to_owned()),
            _ => return None,
        })
    }

    /// Two values without an operator between them.
    pub(super) fn side_by_side(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        let before = self.before()?;
        let kind = scan.kind(self.at).filter(|_| self.at < self.hi)?;
        if !scan.ends_value(before) || kind == TokenKind::Symbol {
            return None;
        }
        let word = scan.word(self.at);
        let here = self.here();
        let after_number = scan.kind(before) == Some(TokenKind::Number);
        let two = || {
            Diagnostic::error("E0111", "two values stand side by side")
                .at(here, "the second")
                .because(scan.span(before), "the first ends here")
        };
        if kind == TokenKind::Word {
            if RESERVED.contains(&word) && !matches!(word, "true" | "false") {
                return None;
            }
            let attached = word.strip_prefix('x').is_some_and(|d| d.bytes().all(|b| b.is_ascii_digit()));
            if attached && after_number {
                return Some(self.size());
            }
            let item = tree::block_kind(word).is_some_and(|k| scan.is(self.at + 1 + usize::from(k.is_named()), "{"));
            if item && self.opener().is_none() {
                let problem = Diagnostic::error("E0101", "items do not stand inside each other")
                    .at(here, "a new item starts here");
                return Some(problem.hint("close the brace of the item around it first"));
            }
            if self.place == Place::Property && self.opener().is_none() && scan.tokens[self.at].starts_line {
                let lonely = self.at + 1 == self.hi || scan.is_name(self.at + 1);
                if lonely && !is_unit(word) {
                    let problem = Diagnostic::error("E0114", format!("`{word}` is given no value"));
                    return Some(problem.at(here, "expected `=` and a value after it"));
                }
            }
            if let Some(operator) = match word.to_lowercase().as_str() {
                "and" => Some("&&"),
                "or" => Some("||"),
                "xor" => Some("!="),
                _ => None,
            } {
                let problem = Diagnostic::error("E0116", format!("there is no `{word}` operator")).at(here, "");
                return Some(problem.hint(format!("write `{operator}`")));
            }
            if after_number && !is_unit(word) {
                return Some(self.unknown_unit(word, before));
            }
            if is_unit(word) {
                let problem =
                    Diagnostic::error("E0111", format!("`{word}` must follow a number or a tuple")).at(here, "");
                let (note, operator) = if is_unit(scan.word(before)) {
                    ("units are multiplied like all values", "*")
                } else {
                    ("only a number or a tuple is multiplied by the unit beside it", "*")
                };
                return Some(
                    problem
                        .because(scan.span(before), "follows this")
                        .note(note)
                        .hint(format!("write `{operator} {word}`")),
                );
            }
            if scan.word(before) == "not" {
                let problem = Diagnostic::error("E0116", "there is no `not` operator").at(scan.span(before), "");
                return Some(problem.hint("write `!`"));
            }
            if scan.word(before) == "return" {
                let problem = Diagnostic::error("E0116", "there is no `return`").at(scan.span(before), "");
                return Some(problem.hint("the last expression of a block is its value"));
            }
            let starts_value =
                scan.kind(self.at + 1).is_some_and(|k| k != TokenKind::Symbol) || scan.is(self.at + 1, "(");
            if self.place == Place::Property && self.opener().is_none() && self.at + 1 < self.hi && starts_value {
                let problem = Diagnostic::error("E0114", format!("expected `=` after `{word}`"))
                    .at(here, "a property starts here");
                return Some(problem.hint(format!("write `{word} = …`")));
            }
        }
        let numbers = after_number && kind == TokenKind::Number;
        if numbers && word == "1" && scan.is(self.at + 1, "/") && scan.is_name(self.at + 2) {
            let (number, unit) = (scan.word(before), scan.word(self.at + 2));
            return Some(two().hint(format!("write `{number} /{unit}`")));
        }
        let in_list = self.opener().is_some_and(|o| !scan.is(o, "{"));
        Some(two().hint(if in_list {
            "write `,` or an operator between them"
        } else {
            "write an operator between them"
        }))
    }
}
