//! The one format of the language.
//!
//! Works on tokens, so that every comment and every spelling stays as it is; the grammar's pairs only say what each token
//! is for. Line breaks that the author put inside an expression stay, and none are added there.

use super::ast::is_unit;
use super::grammar::{self, Rule};
use super::lex::{Comment, CommentKind, Scan, TokenKind, scan};
use crate::diagnostic::Diagnostics;
use crate::source::SourceId;
use pest::iterators::{Pair, Pairs};
use std::ops::RangeInclusive;

/// A block stays on one line up to this many characters.
const MAX_WIDTH: usize = 100;
/// More bytes than that are surely more characters than [`MAX_WIDTH`].
const MAX_BYTES: usize = 4 * MAX_WIDTH;
const INDENT: &str = "    ";

/// The text in the one format: four spaces of indentation, a property per line unless the block was written on one line
/// and fits into 100 columns, rows of tables beside each other where they were and fit, at most one blank line in a row. Formatting twice changes nothing more.
///
/// # Errors
/// The diagnostics of a text with syntax errors; their source is number 0.
pub fn format(text: &str) -> Result<String, Diagnostics> {
    let mut diagnostics = Diagnostics::default();
    super::parse(SourceId(0), text, &mut diagnostics);
    if diagnostics.has_errors() {
        return Err(diagnostics);
    }
    let scan = scan(SourceId(0), text);
    let Ok(pairs) = grammar::read(Rule::module, text) else { return Err(diagnostics) };
    let roles = Roles::of(&scan, pairs);
    let mut printer = Printer {
        scan: &scan,
        roles: &roles,
        out: String::new(),
        line_start: 0,
        line_indent: 0,
        levels: vec![],
        next_comment: 0,
    };
    printer.run();
    Ok(printer.out)
}

/// What each token is for, as far as layout cares.
struct Roles {
    /// Starts an item.
    item: Vec<bool>,
    /// Starts a property, a row, a `let` or the value of a block.
    entry: Vec<bool>,
    /// Starts a row of a table, which the given token ends.
    row: Vec<Option<usize>>,
    /// Opens a body of entries, which the given token closes.
    body: Vec<Option<usize>>,
    /// Closes a body of entries.
    closes_body: Vec<bool>,
    /// No space before it.
    glued: Vec<bool>,
    /// No space after it.
    glues: Vec<bool>,
    /// No line break before it.
    joined: Vec<bool>,
}

impl Roles {
    fn of(scan: &Scan<'_>, pairs: Pairs<'_, Rule>) -> Self {
        let no = vec![false; scan.tokens.len()];
        let mut roles = Self {
            item: no.clone(),
            entry: no.clone(),
            row: vec![None; scan.tokens.len()],
            body: vec![None; scan.tokens.len()],
            closes_body: no.clone(),
            glued: no.clone(),
            glues: no.clone(),
            joined: no,
        };
        for pair in pairs.flatten() {
            roles.note(scan, pair);
        }
        for index in 1..scan.tokens.len() {
            // `4 /m` is how a reciprocal unit is written everywhere in the field.
            let number_before = scan.kind(index - 1) == Some(TokenKind::Number);
            if scan.is(index, "/") && number_before && is_unit(scan.word(index + 1)) {
                roles.glues[index] = true;
            }
        }
        roles
    }

    fn note(&mut self, scan: &Scan<'_>, pair: Pair<'_, Rule>) {
        let (first, end) = tokens_of(scan, &pair);
        if first >= end {
            return;
        }
        match pair.as_rule() {
            Rule::item => self.item[first] = true,
            Rule::property | Rule::binding => self.entry[first] = true,
            Rule::row => {
                self.entry[first] = true;
                self.row[first] = Some(end - 1);
            }
            Rule::named_block | Rule::plain_block | Rule::table_item | Rule::transfer_item => {
                self.note_body(scan, pair)
            }
            Rule::block => {
                let value =
                    pair.clone().into_inner().find(|p| matches!(p.as_rule(), Rule::formula | Rule::conditional));
                if let Some(value) = value {
                    self.entry[tokens_of(scan, &value).0] = true;
                }
                self.note_body(scan, pair);
            }
            Rule::negate | Rule::not | Rule::open_paren | Rule::open_bracket => self.glues[first] = true,
            Rule::power | Rule::dot | Rule::path_separator => {
                self.glued[first] = true;
                self.glues[first] = true;
            }
            Rule::colon | Rule::comma | Rule::semicolon => {
                self.glued[first] = true;
                self.joined[first] = true;
            }
            Rule::close_paren | Rule::close_bracket => self.glued[first] = true,
            Rule::arguments => self.glued[first] = true,
            Rule::reduce | Rule::function_item => self.note_parenthesis_and_range(scan, pair),
            Rule::unit_suffix | Rule::equals => self.joined[first] = true,
            Rule::size => (first + 1..end).for_each(|t| self.joined[t] = true),
            Rule::type_expression => (first + 1..end).for_each(|t| self.glued[t] = true),
            Rule::use_list => {
                self.glues[first] = true;
                self.glued[end - 1] = true;
            }
            _ => {}
        }
    }

    fn note_body(&mut self, scan: &Scan<'_>, pair: Pair<'_, Rule>) {
        let start = tokens_of(scan, &pair).0;
        let brace = |rule| move |p: &Pair<'_, Rule>| p.as_rule() == rule;
        let open = pair.clone().into_inner().find(brace(Rule::open_brace));
        let close = pair.into_inner().filter(brace(Rule::close_brace)).last();
        if let (Some(open), Some(close)) = (open, close) {
            let (open, close) = (tokens_of(scan, &open).0, tokens_of(scan, &close).0);
            self.body[open] = Some(close);
            self.closes_body[close] = true;
            (start + 1..=open).for_each(|t| self.joined[t] = true);
        }
    }

    /// The parenthesis after a name, and dots between ends that are single tokens: `sum(i in 0..3)`.
    fn note_parenthesis_and_range(&mut self, scan: &Scan<'_>, pair: Pair<'_, Rule>) {
        let parts: Vec<_> = pair.into_inner().collect();
        if let Some(paren) = parts.iter().find(|p| p.as_rule() == Rule::open_paren) {
            self.glued[tokens_of(scan, paren).0] = true;
        }
        if let Some(dots) = parts.iter().position(|p| p.as_rule() == Rule::range_dots) {
            let single = |p: &Pair<'_, Rule>| {
                let (first, end) = tokens_of(scan, p);
                end == first + 1
            };
            if dots > 0 && parts.get(dots + 1).is_some_and(single) && single(&parts[dots - 1]) {
                let at = tokens_of(scan, &parts[dots]).0;
                self.glued[at] = true;
                self.glues[at] = true;
            }
        }
    }
}

/// The first token of a pair, and one past its last.
fn tokens_of(scan: &Scan<'_>, pair: &Pair<'_, Rule>) -> (usize, usize) {
    let span = pair.as_span();
    let first = scan.tokens.partition_point(|t| t.start < span.start());
    (first, scan.tokens.partition_point(|t| t.start < span.end()))
}

/// Something that is open around the place of printing.
struct Level {
    /// What opened it.
    kind: LevelKind,
    /// Indentation of the line it was opened on, in steps.
    outer: usize,
}

#[derive(Copy, Clone, PartialEq, Eq)]
enum LevelKind {
    /// A body with one entry per line.
    Body,
    /// Parentheses, brackets or the braces of `use`.
    Bracket,
}

/// How a token is set off from what stands before it.
#[derive(Copy, Clone, PartialEq, Eq)]
enum Break {
    /// On the same line, after this many spaces.
    Space(usize),
    /// On a line of its own with this indentation.
    Line(usize),
}

struct Printer<'a, 't> {
    scan: &'a Scan<'t>,
    roles: &'a Roles,
    out: String,
    /// Where the line being printed starts.
    line_start: usize,
    /// Indentation of the line being printed, in steps.
    line_indent: usize,
    levels: Vec<Level>,
    /// The next comment to print.
    next_comment: usize,
}

impl Printer<'_, '_> {
    fn run(&mut self) {
        let count = self.scan.tokens.len();
        let mut index = 0;
        while index < count {
            self.gap(Some(index));
            index = match self.roles.body[index] {
                Some(close) => match self.flat(index..=close) {
                    Some(line) if self.column() + line.chars().count() <= MAX_WIDTH => {
                        self.out.push_str(&line);
                        let end = self.scan.tokens[close].end;
                        self.next_comment = self.scan.comments.partition_point(|c| c.start < end);
                        close + 1
                    }
                    _ => {
                        self.out.push('{');
                        self.levels.push(Level { kind: LevelKind::Body, outer: self.line_indent });
                        index + 1
                    }
                },
                None => {
                    let word = self.scan.word(index);
                    self.out.push_str(word);
                    if self.scan.kind(index) == Some(TokenKind::Symbol) && matches!(word, "(" | "[" | "{") {
                        self.levels.push(Level { kind: LevelKind::Bracket, outer: self.line_indent });
                    }
                    index + 1
                }
            };
        }
        self.gap(None);
        if !self.out.is_empty() {
            self.out.push('\n');
        }
    }

    fn column(&self) -> usize {
        let line = &self.out[self.line_start..];
        if line.len() > MAX_BYTES { line.len() } else { line.chars().count() }
    }

    fn comment(&mut self, text: &str) {
        if let Some(last_break) = text.rfind('\n') {
            self.line_start = self.out.len() + last_break + 1;
        }
        self.out.push_str(text);
    }

    fn newline(&mut self, indent: usize, blank: bool) {
        if !self.out.is_empty() {
            self.out.push_str(if blank { "\n\n" } else { "\n" });
        }
        self.line_start = self.out.len();
        self.out.extend(std::iter::repeat_n(INDENT, indent));
        self.line_indent = indent;
    }

    /// Indentation of a line that starts here without starting an item or an entry.
    fn inner_indent(&self, previous: Option<usize>) -> usize {
        match self.levels.last() {
            None => 1,
            Some(Level { kind: LevelKind::Body, outer }) => outer + 2,
            Some(Level { kind: LevelKind::Bracket, outer }) => {
                let starts_part = previous.is_some_and(|p| matches!(self.scan.word(p), "(" | "[" | "{" | ","));
                outer + if starts_part { 1 } else { 2 }
            }
        }
    }

    /// Spaces between a token and the one before it, on one line.
    fn spaces(&self, index: usize) -> usize {
        usize::from(!(self.roles.glued[index] || self.roles.glues[index - 1]))
    }

    /// Everything between the token before `next` and `next` itself: comments, line breaks, spaces.
    fn gap(&mut self, next: Option<usize>) {
        let scan = self.scan;
        let previous = next.unwrap_or(scan.tokens.len()).checked_sub(1);
        let closes =
            next.is_some_and(|n| scan.kind(n) == Some(TokenKind::Symbol) && matches!(scan.word(n), ")" | "]" | "}"));
        let opens_body = previous.is_some_and(|p| self.roles.body[p].is_some());
        let entry = next.is_none_or(|n| self.roles.item[n] || self.roles.entry[n]);
        let in_body = self.levels.last().is_none_or(|l| l.kind == LevelKind::Body);
        let structural = entry || (closes && in_body);
        let entry_indent = self.levels.last().map_or(0, |l| l.outer + 1);

        let mut from = previous.map_or(0, |p| scan.tokens[p].end);
        let mut after: Option<Comment> = None;
        let mut comment_led_line = false;
        while let Some(comment) = scan.comments.get(self.next_comment).copied() {
            if next.is_some_and(|n| comment.start > scan.tokens[n].start) {
                break;
            }
            self.next_comment += 1;
            let lines = line_breaks(&scan.text[from..comment.start]);
            let forced = after.is_some_and(|c| c.kind != CommentKind::Block);
            if self.out.is_empty() {
                comment_led_line = true;
            } else if lines > 0 || forced {
                let indent = if structural { entry_indent } else { self.inner_indent(previous) };
                let first_in_body = opens_body && after.is_none();
                self.newline(indent, structural && lines > 1 && !first_in_body);
                comment_led_line = true;
            } else {
                let gap = if comment.kind == CommentKind::Block { " " } else { "  " };
                self.out.push_str(gap);
            }
            self.comment(&scan.text[comment.start..comment.end]);
            from = comment.end;
            after = Some(comment);
        }

        let Some(next) = next else { return };
        let lines = line_breaks(&scan.text[from..scan.tokens[next].start]);
        let forced = after.is_some_and(|c| c.kind != CommentKind::Block);
        if closes {
            let level = self.levels.pop();
            let outer = level.as_ref().map_or(0, |l| l.outer);
            let empty_body = opens_body && after.is_none();
            let on_own_line = forced || (structural && !empty_body) || (!structural && lines > 0);
            if on_own_line {
                self.newline(outer, false);
            } else if after.is_some() {
                self.out.push(' ');
            } else if !structural {
                self.out.push_str(if self.spaces(next) > 0 { " " } else { "" });
            }
            return;
        }
        if self.out.is_empty() {
            return;
        }
        let layout = if entry {
            // A comment in front of an entry, on its line, stays there.
            if comment_led_line && !forced && lines == 0 {
                Break::Space(1)
            } else if lines == 0 && after.is_none() && !opens_body && self.row_fits(next) {
                Break::Space(2)
            } else {
                Break::Line(entry_indent)
            }
        } else {
            let opens = previous.is_some_and(|p| {
                self.scan.kind(p) == Some(TokenKind::Symbol) && matches!(scan.word(p), "(" | "[" | "{")
            });
            let glued = self.spaces(next) == 0 && !opens;
            if forced || (lines > 0 && !glued && !self.roles.joined[next]) {
                Break::Line(self.inner_indent(previous))
            } else {
                Break::Space(if after.is_some() { 1 } else { self.spaces(next) })
            }
        };
        match layout {
            Break::Space(spaces) => self.out.extend(std::iter::repeat_n(' ', spaces)),
            Break::Line(indent) => {
                let first_in_body = opens_body && after.is_none();
                self.newline(indent, entry && lines > 1 && !first_in_body);
            }
        }
    }

    /// Whether this starts a row of a table that may stand beside the row before it: long tables are written in lines of
    /// several rows.
    fn row_fits(&self, first: usize) -> bool {
        let row = self.roles.row[first].and_then(|last| self.flat(first..=last));
        row.is_some_and(|row| self.column() + 2 + row.chars().count() <= MAX_WIDTH)
    }

    /// The tokens on one line, if they were written on one.
    fn flat(&self, tokens: RangeInclusive<usize>) -> Option<String> {
        let scan = self.scan;
        let (first, last) = (*tokens.start(), *tokens.end());
        let (start, end) = (scan.tokens[first].start, scan.tokens[last].end);
        if scan.text[start..end].contains('\n') {
            return None;
        }
        let mut comments = scan.comments[self.next_comment..].iter().skip_while(|c| c.start < start).peekable();
        let mut line = String::new();
        for index in tokens {
            let mut after_comment = false;
            while let Some(comment) = comments.next_if(|c| c.start < scan.tokens[index].start) {
                line.push(' ');
                line.push_str(&scan.text[comment.start..comment.end]);
                after_comment = true;
            }
            let opens = index > first && self.roles.body[index - 1].is_some();
            let closes_body = self.roles.closes_body[index];
            let spaces = if index == first || (opens && closes_body && !after_comment) {
                0
            } else if self.roles.entry[index] && !opens {
                2
            } else if after_comment || opens || closes_body {
                1
            } else {
                self.spaces(index)
            };
            line.extend(std::iter::repeat_n(' ', spaces));
            line.push_str(scan.word(index));
            if line.len() > MAX_BYTES {
                return None;
            }
        }
        Some(line)
    }
}

fn line_breaks(between: &str) -> usize {
    between.bytes().filter(|b| *b == b'\n').count()
}
