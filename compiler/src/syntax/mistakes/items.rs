//! Mistakes in the frame of an item: imports, names, `=`, rows, the head of a function.

use super::{Place, Teller, reserved, token};
use crate::diagnostic::Diagnostic;
use crate::syntax::grammar::Rule;
use crate::syntax::lex::{RESERVED, TokenKind};

impl Teller<'_, '_> {
    pub(super) fn import(&self) -> Diagnostic {
        let problem = |message: String| Diagnostic::error("E0124", message).at(self.here(), "");
        let found = self.found().unwrap_or("");
        let form = "write `use std::noise::fbm`, `use std::noise::{fbm, worley}` or `use \"./my_lib.vol\"::name`";
        match found {
            "*" => {
                problem("names are imported one by one".to_owned()).hint("list them: `use std::noise::{fbm, worley}`")
            }
            "as" => problem("an imported name keeps its name".to_owned()).hint("leave `as …` out"),
            "." | "/" | ":" => problem(format!("parts of a path are joined by `::`, not `{found}`")).hint(form),
            "" if self.stop.wants(Rule::path_separator) => {
                problem("this does not say which name to import".to_owned()).hint(form)
            }
            "" => problem("a name must follow".to_owned()).hint(form),
            _ if self.stop.wants(Rule::path_separator) => {
                problem(format!("expected `::` and a name, found {}", token(self.scan, self.at))).hint(form)
            }
            _ => problem(format!("expected a name to import, found {}", token(self.scan, self.at))).hint(form),
        }
    }

    pub(super) fn row(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        let problem = |message: &str| Diagnostic::error("E0125", message).at(self.here(), "");
        let form = "a row is a key, `:` and its values, as in `30: #000, 0 /m`";
        if self.opener().is_some() {
            return None;
        }
        match self.found() {
            Some("=" | "=>" | "->") => Some(problem("a row's key is followed by `:`").note(form)),
            Some(";") => Some(problem("rows are not separated by `;`").hint("leave it out")),
            Some(",") if self.before().is_none_or(|b| scan.is(b, ",")) => {
                Some(problem("a value must stand here").note(form))
            }
            Some(":") => {
                let comma = (self.lo..self.at).rev().find(|i| scan.is(*i, ",") || scan.is(*i, ":"));
                let comma = comma.filter(|i| scan.is(*i, ","))?;
                let problem = Diagnostic::error("E0125", "rows are not separated by `,`").at(scan.span(comma), "");
                Some(problem.because(self.here(), "this makes what stands before it a key").hint("leave it out"))
            }
            Some("+") => Some(
                problem("keys and values of rows are products")
                    .note("rows stand side by side, so a sum would run into the next key")
                    .hint("put the sum in parentheses"),
            ),
            _ if self.stop.wants(Rule::colon) => {
                let minus = (self.lo + 1..self.at).rev().take_while(|i| !scan.is(*i, ",") && !scan.is(*i, ":"));
                let minus = minus.into_iter().find(|i| scan.is(*i, "-") && scan.ends_value(*i - 1));
                if let Some(minus) = minus {
                    let problem =
                        Diagnostic::error("E0125", "this minus sign starts a new row").at(scan.span(minus), "");
                    let note = "rows stand side by side, so keys and values are products";
                    return Some(problem.note(note).hint("put the difference in parentheses"));
                }
                if self.before().is_some_and(|b| scan.kind(b) == Some(TokenKind::Number))
                    && scan.kind(self.at) == Some(TokenKind::Word)
                {
                    return None;
                }
                let what = if self.at < self.hi { token(scan, self.at) } else { "the end".to_owned() };
                let problem = Diagnostic::error("E0125", format!("expected `:` after a row's key, found {what}"));
                Some(problem.at(self.here(), "").note(form))
            }
            _ => None,
        }
    }

    pub(super) fn name_wanted(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        if !self.stop.wants(Rule::name) || self.stop.wants_value() {
            return None;
        }
        if self.at < self.hi && RESERVED.contains(&scan.word(self.at)) {
            return Some(reserved(scan, self.at));
        }
        let before = self.before().map_or("", |b| scan.word(b));
        match before {
            "const" | "param" | "fn" | "let" => {
                let found = if self.at < self.hi { format!(", found {}", token(scan, self.at)) } else { String::new() };
                Some(
                    Diagnostic::error("E0113", format!("expected a name after `{before}`{found}"))
                        .at(self.here(), "")
                        .hint(format!("write `{before} name …`")),
                )
            }
            "." => Some(Diagnostic::error("E0101", "expected the name of a part after `.`").at(self.here(), "")),
            _ => None,
        }
    }

    /// Something else where `=` must stand.
    pub(super) fn equals_wanted(&self) -> Option<Diagnostic> {
        let scan = self.scan;
        if !self.stop.wants(Rule::equals) || self.before_is_let_or_fn_type() {
            return None;
        }
        let before = self.before()?;
        let name = scan.word(before);
        let problem = |message: String| Diagnostic::error("E0114", message).at(self.here(), "");
        let thing = match self.place {
            Place::Property => "a property",
            Place::Item | Place::Use | Place::Rows => "a value",
        };
        Some(match self.found() {
            Some(mark @ (":" | "==" | "=>" | "->" | "::")) if scan.kind(self.at) == Some(TokenKind::Symbol) => {
                problem(format!("{thing} is given with `=`, not `{mark}`")).hint(format!("write `{name} = …`"))
            }
            Some("(") if self.place == Place::Item => problem("only `fn` has parameters".to_owned())
                .hint(format!("write `fn {name}(x: number) -> number = …`")),
            Some("{") => {
                problem(format!("expected `=` after `{name}`, found `{{`")).note("items do not stand inside each other")
            }
            Some(_) => problem(format!("expected `=` after `{name}`, found {}", token(scan, self.at)))
                .hint(format!("write `{name} = …`")),
            None => Diagnostic::error("E0114", format!("`{name}` is given no value"))
                .at(scan.span(before), "expected `=` and a value after it"),
        })
    }

    /// `let x` and a function's result have `=`s with advice of their own.
    pub(super) fn before_is_let_or_fn_type(&self) -> bool {
        let let_name = self.at >= self.lo + 2 && self.scan.word(self.at - 2) == "let";
        let_name || self.in_function_head()
    }

    pub(super) fn in_function_head(&self) -> bool {
        self.scan.word(self.lo) == "fn"
            && self.place == Place::Item
            && !(self.lo..self.at).any(|i| self.scan.is(i, "=") && !self.inside_parameters(i))
    }

    pub(super) fn inside_parameters(&self, index: usize) -> bool {
        let mut depth = 0usize;
        for i in self.lo..index {
            depth = match self.scan.word(i) {
                "(" => depth + 1,
                ")" => depth.saturating_sub(1),
                _ => depth,
            };
        }
        depth > 0
    }

    pub(super) fn function(&self) -> Option<Diagnostic> {
        if !self.in_function_head() || self.at <= self.lo + 1 {
            return None;
        }
        let scan = self.scan;
        let problem = |message: &str| Diagnostic::error("E0126", message).at(self.here(), "");
        let form = "a function is written `fn name(parameter: type) -> type = value`";
        let stop = self.stop;
        if stop.wants(Rule::open_paren) {
            return Some(problem("a function's name is followed by its parameters").note(form));
        }
        if stop.wants(Rule::arrow) {
            let hint = if self.found_is(&["{"]) { "write `-> number = {`" } else { "write `-> number`, or what it is" };
            return Some(problem("a function says what it returns").note(form).hint(hint));
        }
        if stop.wants(Rule::colon) {
            let name = self.before().map_or("", |b| scan.word(b));
            let first = self.found().unwrap_or("");
            let hint = if scan.is_name(self.at) {
                format!("write the name first: `{first}: {name}`")
            } else {
                format!("write `{name}: number`, or what it is")
            };
            return Some(problem("a parameter says its type").note(form).hint(hint));
        }
        if stop.wants(Rule::equals) {
            let hint = if self.found_is(&["{"]) { "write `= {`" } else { "write `= …`" };
            return Some(problem("a function's value follows `=`").note(form).hint(hint));
        }
        if stop.wants(Rule::type_one)
            || stop.wants(Rule::type_name)
            || stop.wants(Rule::type_factor)
            || stop.wants(Rule::type_expression)
        {
            let types = "types are `number`, `length`, `time`, `light`, their products and powers, `vec2`, `vec3`, `spectrum`, `color`, `bool`, `string`, `layer`, `grid`";
            return Some(problem("a type must stand here").note(types));
        }
        None
    }
}
