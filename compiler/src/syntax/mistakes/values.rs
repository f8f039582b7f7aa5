//! Mistakes inside a value: powers of units, conditionals, blocks, units, missing parts.

use super::{Teller, token};
use crate::diagnostic::Diagnostic;
use crate::syntax::ast::{UNITS, is_unit};
use crate::syntax::grammar::Rule;
use crate::syntax::lex::TokenKind;
use crate::syntax::words;

impl Teller<'_, '_> {
    /// `2 m^0.5`, `2 m^n`, `length^n`.
    pub(super) fn power(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        if self.stop.wants(Rule::whole_number) || self.stop.wants(Rule::type_exponent) {
            let note = "only whole powers of a dimension have a meaning that can be checked";
            let problem =
                Diagnostic::error("E0121", "the power of a unit is a whole number").at(self.here(), "").note(note);
            let caret = (self.lo..self.at).rev().find(|i| scan.is(*i, "^"))?;
            let value = caret.checked_sub(2).filter(|v| *v >= self.lo && scan.kind(*v) == Some(TokenKind::Number));
            return Some(match value {
                Some(value) if is_unit(scan.word(caret - 1)) => {
                    let quantity = self.text(value, caret - 1);
                    problem.hint(format!("to raise the whole quantity, write `({quantity})^…`"))
                }
                _ => problem,
            });
        }
        let second = self.at + 1;
        let powered = self.before().is_some_and(|b| scan.is(b, "^") && b > self.lo && is_unit(scan.word(b - 1)));
        if powered && second < self.hi && scan.is(second, "^") {
            let problem = Diagnostic::error("E0121", "a unit takes one power").at(scan.span(second), "a second one");
            return Some(problem.hint("use parentheses to raise the quantity again, as in `(2 m^2)^3`"));
        }
        None
    }

    /// `if` without `then` or `else`.
    pub(super) fn branch(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        let (then, other) = (self.stop.wants(Rule::then_word), self.stop.wants(Rule::else_word));
        if !then && !other {
            return None;
        }
        let word = (self.lo..self.at).rev().find(|i| scan.word(*i) == "if")?;
        if self.found_is(&["=", "<=", ">="]) && then {
            return Some(
                Diagnostic::error("E0116", "a comparison is written `==`")
                    .at(self.here(), "")
                    .note("`=` gives a name a value"),
            );
        }
        let misspelt_unit =
            self.before().is_some_and(|b| scan.kind(b) == Some(TokenKind::Number)) && scan.is_name(self.at);
        let property = scan.is_name(self.at) && scan.is(self.at + 1, "=");
        if self.at < self.hi && !property && (misspelt_unit || is_unit(scan.word(self.at)) || !self.before_ends_value())
        {
            return None;
        }
        if self.found_is(&["(", "[", ".", "::", "=>", "->", ".."]) {
            return None;
        }
        let missing = if then { "then" } else { "else" };
        let message = if then { "this `if` has no `then`" } else { "this `if` has no `else`" };
        let label = format!("`{missing}` must follow here");
        let problem = Diagnostic::error("E0127", message).at(scan.span(word), "").because(self.here(), label);
        Some(problem.note("a conditional is a value: `if c then a else b`, all three parts"))
    }

    pub(super) fn binding(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        let problem = |message: &str| Diagnostic::error("E0128", message).at(self.here(), "");
        let form = "a block is `{ let x = …  let y = …  value }`";
        let before = self.before()?;
        if self.at >= self.lo + 2 && scan.word(self.at - 2) == "let" && self.stop.wants(Rule::equals) {
            if self.found_is(&[":"]) {
                return Some(
                    problem("a `let` names no type").note(form).hint(format!("write `let {} = …`", scan.word(before))),
                );
            }
            return Some(problem("a `let` gives its name a value with `=`").note(form));
        }
        if scan.word(self.at) == "let" && self.at < self.hi {
            return Some(problem("`let` stands at the start of a block").note(form));
        }
        let in_block = self.opener().is_some_and(|o| scan.is(o, "{"));
        if in_block
            && self.found_is(&["}"])
            && (scan.ends_value(before) || scan.is(before, ";") || scan.is(before, "{"))
        {
            let opener = self.opener()?;
            let problem = Diagnostic::error("E0128", "this block has no value").at(scan.span(opener), "");
            return Some(problem.because(self.here(), "the value must stand before this `}`").note(form));
        }
        if in_block && self.found_is(&["="]) && scan.is_name(before) {
            let problem = Diagnostic::error("E0128", "a name in a block is given with `let`").at(scan.span(before), "");
            return Some(problem.note(form).hint(format!("write `let {} = …`", scan.word(before))));
        }
        None
    }

    pub(super) fn size(&self) -> Diagnostic {
        Diagnostic::error("E0123", "a size is two whole numbers around `x`")
            .at(self.here(), "")
            .hint("write `1024 x 768` or `1024x768`; to multiply, write `*`")
    }

    pub(super) fn unknown_unit(&self, word: &str, before: usize) -> Diagnostic {
        let number = self.scan.word(before);
        if word.strip_prefix(['e', 'E']).is_some_and(|d| d.is_empty()) {
            return Diagnostic::error("E0107", "the exponent has no digits")
                .at(self.scan.span(before).to(self.here()), "");
        }
        let problem =
            Diagnostic::error("E0110", format!("there is no unit `{word}`")).at(self.here(), "follows a number");
        match words::unit(word) {
            Some(Ok(unit)) => problem.hint(format!("write `{number} {unit}`")),
            Some(Err(advice)) => problem.hint(advice),
            None => problem
                .note(format!("the units are {}", UNITS.map(|u| format!("`{u}`")).join(", ")))
                .hint(format!("to multiply, write `{number} * {word}`")),
        }
    }

    /// Nothing where a value must stand.
    pub(super) fn value_wanted(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        let before = self.before()?;
        if !self.stop.wants_value() || scan.ends_value(before) {
            return None;
        }
        let after = scan.word(before);
        let found = if self.at < self.hi { format!(", found {}", token(scan, self.at)) } else { String::new() };
        let closes = self.found_is(&[")", "]", "}"]);
        if after == "(" && closes {
            let problem = Diagnostic::error("E0117", "nothing stands in these parentheses");
            return Some(problem.at(scan.span(before).to(self.here()), ""));
        }
        let problem = Diagnostic::error("E0117", format!("expected a value after `{after}`{found}"));
        let label = if self.at < self.hi { "" } else { "a value must follow" };
        let at = if self.at < self.hi && !closes { self.here() } else { scan.span(before) };
        Some(problem.at(at, if closes { "a value must follow" } else { label }))
    }
}
