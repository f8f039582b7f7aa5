//! What went wrong where the grammar stopped, in words for people: first the mistakes that newcomers make, by what stands
//! around the place, then a plain "expected this, found that".

use super::ast::is_unit;
use super::grammar::{Failure, Rule};
use super::lex::{RESERVED, Scan, TokenKind};
use super::words;
use crate::diagnostic::Diagnostic;
use std::ops::Range;

/// What was being read.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum Place {
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
pub(super) struct Stop {
    /// The first token that did not fit; one past the last if more was wanted.
    at: usize,
    /// What the grammar had tried there.
    expected: Vec<Rule>,
}

impl Stop {
    /// Finds the token for a failure in the text of `tokens`, which starts at byte `base`.
    pub(super) fn new(scan: &Scan<'_>, tokens: Range<usize>, base: usize, failure: Failure) -> Self {
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
pub(super) fn token(scan: &Scan<'_>, index: usize) -> String {
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
pub(super) fn reserved(scan: &Scan<'_>, index: usize) -> Diagnostic {
    Diagnostic::error("E0118", format!("`{}` is a word of the language and cannot be a name", scan.word(index)))
        .at(scan.span(index), "a name must stand here")
        .note(format!("the reserved words are {}", RESERVED.map(|w| format!("`{w}`")).join(", ")))
}

/// Says what is wrong with `tokens`.
pub(super) fn describe(scan: &Scan<'_>, tokens: Range<usize>, stop: &Stop, place: Place) -> Diagnostic {
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

    fn import(&self) -> Diagnostic {
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

    fn row(&self) -> Option<Diagnostic> {
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

    /// `2 m^0.5`, `2 m^n`, `length^n`.
    fn power(&self) -> Option<Diagnostic> {
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

    fn name_wanted(&self) -> Option<Diagnostic> {
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
    fn equals_wanted(&self) -> Option<Diagnostic> {
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
    fn before_is_let_or_fn_type(&self) -> bool {
        let let_name = self.at >= self.lo + 2 && self.scan.word(self.at - 2) == "let";
        let_name || self.in_function_head()
    }

    fn in_function_head(&self) -> bool {
        self.scan.word(self.lo) == "fn"
            && self.place == Place::Item
            && !(self.lo..self.at).any(|i| self.scan.is(i, "=") && !self.inside_parameters(i))
    }

    fn inside_parameters(&self, index: usize) -> bool {
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

    fn function(&self) -> Option<Diagnostic> {
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

    /// `if` without `then` or `else`.
    fn branch(&self) -> Option<Diagnostic> {
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

    fn binding(&self) -> Option<Diagnostic> {
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

    /// Marks of other languages, and ours in the wrong place.
    fn mark(&self) -> Option<Diagnostic> {
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
    fn side_by_side(&self) -> Option<Diagnostic> {
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
            let item =
                super::tree::block_kind(word).is_some_and(|k| scan.is(self.at + 1 + usize::from(k.is_named()), "{"));
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

    fn size(&self) -> Diagnostic {
        Diagnostic::error("E0123", "a size is two whole numbers around `x`")
            .at(self.here(), "")
            .hint("write `1024 x 768` or `1024x768`; to multiply, write `*`")
    }

    fn unknown_unit(&self, word: &str, before: usize) -> Diagnostic {
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
                .note(format!("the units are {}", super::ast::UNITS.map(|u| format!("`{u}`")).join(", ")))
                .hint(format!("to multiply, write `{number} * {word}`")),
        }
    }

    /// Nothing where a value must stand.
    fn value_wanted(&self) -> Option<Diagnostic> {
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

/// What a rule of the grammar is called in a message.
#[derive(Copy, Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Category {
    Item,
    Property,
    Value,
    Name,
    Type,
    Mark(&'static str),
    Operator,
}

impl Category {
    fn phrase(self) -> &'static str {
        match self {
            Self::Item => "an item",
            Self::Property => "a property",
            Self::Value => "a value",
            Self::Name => "a name",
            Self::Type => "a type",
            Self::Mark(mark) => mark,
            Self::Operator => "an operator",
        }
    }
}

fn category(rule: Rule) -> Option<Category> {
    Some(match rule {
        Rule::item => Category::Item,
        Rule::property => Category::Property,
        Rule::formula
        | Rule::product
        | Rule::conditional
        | Rule::if_word
        | Rule::numeric
        | Rule::number
        | Rule::group
        | Rule::list
        | Rule::block
        | Rule::reference
        | Rule::reduce
        | Rule::reduce_word
        | Rule::argument
        | Rule::string
        | Rule::color
        | Rule::boolean
        | Rule::negate
        | Rule::not
        | Rule::row => Category::Value,
        Rule::name | Rule::parameter => Category::Name,
        Rule::type_expression | Rule::type_factor | Rule::type_name | Rule::type_one | Rule::type_group => {
            Category::Type
        }
        Rule::or
        | Rule::and
        | Rule::equal
        | Rule::not_equal
        | Rule::less
        | Rule::less_equal
        | Rule::greater
        | Rule::greater_equal
        | Rule::add
        | Rule::subtract
        | Rule::multiply
        | Rule::divide
        | Rule::power => Category::Operator,
        Rule::equals => Category::Mark("`=`"),
        Rule::colon => Category::Mark("`:`"),
        Rule::comma => Category::Mark("`,`"),
        Rule::arrow => Category::Mark("`->`"),
        Rule::range_dots => Category::Mark("`..`"),
        Rule::in_word => Category::Mark("`in`"),
        Rule::then_word => Category::Mark("`then`"),
        Rule::else_word => Category::Mark("`else`"),
        Rule::open_paren => Category::Mark("`(`"),
        Rule::close_paren => Category::Mark("`)`"),
        Rule::open_brace => Category::Mark("`{`"),
        Rule::close_brace => Category::Mark("`}`"),
        Rule::close_bracket => Category::Mark("`]`"),
        Rule::open_angle => Category::Mark("`<`"),
        Rule::close_angle => Category::Mark("`>`"),
        Rule::path_separator => Category::Mark("`::`"),
        _ => return None,
    })
}
