//! Reading a text that has errors: item by item, and inside a block property by property, so that one run reports many
//! errors and each only once.

use super::ast::{Block, BlockKind, Item, ItemKind, Name, Property};
use super::brackets::{Brackets, item_start, matched};
use super::grammar::{self, Rule};
use super::lex::{CommentKind, Scan, TokenKind};
use super::limits::MAX_FINDINGS;
use super::mistakes::{self, Place, Stop};
use super::tree::{Builder, block_kind, docs};
use super::words;
use crate::diagnostic::{Diagnostic, Diagnostics};
use pest::iterators::Pair;
use std::ops::Range;

/// Reads what can be read of a text that pest refuses as a whole, and reports why.
pub(super) fn module(
    scan: &Scan<'_>,
    too_deep: Option<(usize, Diagnostic)>,
    diagnostics: &mut Diagnostics,
) -> (Vec<Item>, Vec<Name>) {
    let brackets = matched(scan);
    let mut recovery = Recovery {
        scan,
        bad: vec![false; scan.tokens.len()],
        brackets: &brackets,
        found: Diagnostics::default(),
        items: vec![],
        unread: vec![],
    };
    let mut swallowed: Vec<usize> = vec![];
    for problem in &scan.problems {
        match problem.token {
            Some(token) => {
                recovery.bad[token] = true;
                if problem.diagnostic.code == "E0104" {
                    swallowed.push(token);
                }
            }
            None => swallowed.push(scan.tokens.len()),
        }
        recovery.report(problem.diagnostic.clone());
    }
    for (token, problem) in &brackets.problems {
        recovery.bad[*token] = true;
        // An open comment or an open text in quotes may well have swallowed the bracket that is missed.
        let until = problem.labels.get(1).map_or(u32::MAX, |label| label.span.start);
        let first = swallowed.partition_point(|t| t < token);
        let excused = swallowed.get(first).is_some_and(|t| scan.span(*t).start < until);
        if !(excused && problem.code == "E0102") {
            recovery.report(problem.clone());
        }
    }
    if let Some((token, problem)) = too_deep {
        recovery.bad[token] = true;
        recovery.report(problem);
    }
    for chunk in recovery.chunks() {
        if recovery.found.0.len() < MAX_FINDINGS {
            recovery.chunk(chunk);
        } else {
            recovery.skip(chunk);
        }
    }
    let Recovery { mut found, items, unread, .. } = recovery;
    found.0.sort_by_key(|d| d.primary_span().map_or(0, |s| s.start));
    for diagnostic in found.0 {
        diagnostics.push(diagnostic);
    }
    (items, unread)
}

struct Recovery<'a, 't> {
    scan: &'a Scan<'t>,
    /// Tokens that something has been reported about.
    bad: Vec<bool>,
    brackets: &'a Brackets,
    found: Diagnostics,
    items: Vec<Item>,
    unread: Vec<Name>,
}

impl<'a, 't> Recovery<'a, 't> {
    fn report(&mut self, diagnostic: Diagnostic) {
        if self.found.0.len() < MAX_FINDINGS {
            self.found.push(diagnostic);
        }
    }

    /// Keeps the name of an item that is not looked at.
    fn skip(&mut self, tokens: Range<usize>) {
        if self.scan.is_name(tokens.start + 1) {
            self.unread.push(self.name(tokens.start + 1));
        }
    }

    fn name(&self, index: usize) -> Name {
        Name { text: self.scan.word(index).to_owned(), span: self.scan.span(index) }
    }

    fn is_bad(&self, range: Range<usize>) -> bool {
        self.bad[range].contains(&true)
    }

    /// Ranges of tokens that each hold one item, or rubbish.
    fn chunks(&self) -> Vec<Range<usize>> {
        let mut starts: Vec<usize> = vec![];
        let mut braced = false;
        for index in 0..self.scan.tokens.len() {
            if self.brackets.depth[index] > 0 {
                continue;
            }
            if starts.last().is_none_or(|current| self.starts_chunk(*current, index, braced)) {
                starts.push(index);
                braced = false;
            }
            braced |= self.scan.is(index, "{");
        }
        let ends = starts.iter().skip(1).copied().chain([self.scan.tokens.len()]);
        starts.iter().copied().zip(ends).map(|(start, end)| start..end).collect()
    }

    /// Whether an item seems to start at a token outside of all brackets. `current` is the start of the one before it,
    /// `braced` whether that has opened a brace yet.
    fn starts_chunk(&self, current: usize, index: usize, braced: bool) -> bool {
        let scan = self.scan;
        if item_start(scan, index).is_some() {
            return true;
        }
        let before = scan.word(current);
        let open_ended = matches!(before, "const" | "param" | "fn");
        // Behind the closing brace of an item, whatever comes.
        if !open_ended
            && braced
            && scan.is(index - 1, "}")
            && self.brackets.depth[index - 1] == 0
            && !scan.is(index, "}")
        {
            return true;
        }
        if scan.kind(index) != Some(TokenKind::Word) {
            return false;
        }
        let starts_line = scan.tokens[index].starts_line;
        if before == "use" && starts_line {
            return true;
        }
        let starts_next = item_start(scan, index + 1).is_some();
        let two_names = scan.is_name(index) && scan.is_name(index + 1) && !starts_next;
        if two_names && starts_line && scan.is(index + 2, "{") {
            return true;
        }
        // Two words side by side, or a name before a brace or `=`, are nowhere in a value.
        if !scan.ends_value(index - 1) || scan.tokens[index - 1].kind == TokenKind::Number && !starts_line {
            return false;
        }
        let item_word = words::ITEM_WORDS.contains(&scan.word(index));
        let in_header = !open_ended && !braced && !starts_line;
        let names = two_names || scan.word(index) == "let";
        let opens = scan.is_name(index) && scan.is(index + 1, "{") || two_names && scan.is(index + 2, "{");
        let assigns = scan.is_name(index) && scan.is(index + 1, "=");
        let unknown_before = !words::ITEM_WORDS.contains(&before);
        !in_header && opens || starts_line && (item_word || names || unknown_before || assigns && open_ended)
    }

    /// Reports a mark between things that stand side by side without one.
    fn separator(&mut self, things: &str, mark: usize) {
        let word = self.scan.word(mark);
        let problem = Diagnostic::error("E0115", format!("{things} are not separated by `{word}`"));
        self.report(problem.at(self.scan.span(mark), "").hint("leave it out"));
    }

    fn chunk(&mut self, mut tokens: Range<usize>) {
        let scan = self.scan;
        while let Some(mark) = Some(tokens.start).filter(|t| *t < tokens.end) {
            if scan.is(mark, ";") || scan.is(mark, ",") {
                self.separator("items", mark);
            } else if !(scan.is(mark, "}") && self.bad[mark]) {
                break;
            }
            tokens.start += 1;
        }
        while tokens.start + 1 < tokens.end && (scan.is(tokens.end - 1, ";") || scan.is(tokens.end - 1, ",")) {
            tokens.end -= 1;
            self.separator("items", tokens.end);
        }
        if tokens.is_empty() {
            return;
        }
        let failure = if self.is_bad(tokens.clone()) {
            None
        } else {
            match self.read(Rule::lone_item, tokens.clone()) {
                Ok(()) => return,
                Err(stop) => Some(stop),
            }
        };
        let first = tokens.start;
        let word = scan.word(first);
        match (scan.kind(first), word) {
            (Some(TokenKind::Word), "use" | "const" | "param" | "fn") => {
                if scan.is_name(first + 1) && word != "use" {
                    self.unread.push(self.name(first + 1));
                }
                if let Some(stop) = failure {
                    let place = if word == "use" { Place::Use } else { Place::Item };
                    self.report(mistakes::describe(scan, tokens, &stop, place));
                }
            }
            (Some(TokenKind::Word), "table" | "transfer") => self.rows(tokens),
            (Some(TokenKind::Word), _) => match block_kind(word) {
                Some(kind) => self.block(tokens, kind, true),
                None => self.unknown(tokens),
            },
            _ => self.rubbish(tokens),
        }
    }

    /// Reads the tokens as one `rule` and keeps the items.
    fn read(&mut self, rule: Rule, tokens: Range<usize>) -> Result<(), Stop> {
        let (text, base) = self.text(tokens.clone());
        match grammar::read(rule, text) {
            Ok(pairs) => {
                let mut builder = Builder { scan: self.scan, base, diagnostics: &mut self.found };
                let (items, unread) = builder.items(pairs);
                self.items.extend(items);
                self.unread.extend(unread);
                Ok(())
            }
            Err(failure) => Err(Stop::new(self.scan, tokens, base, failure)),
        }
    }

    /// The text of a range of tokens, and where it starts.
    fn text(&self, tokens: Range<usize>) -> (&'t str, usize) {
        let all = &self.scan.tokens;
        let base = all[tokens.start].start;
        (&self.scan.text[base..all[tokens.end - 1].end], base)
    }

    fn rubbish(&mut self, tokens: Range<usize>) {
        if !self.is_bad(tokens.clone()) {
            let what = mistakes::token(self.scan, tokens.start);
            let problem = Diagnostic::error("E0101", format!("expected an item, found {what}"));
            let items = words::ITEM_WORDS.map(|w| format!("`{w}`")).join(", ");
            self.report(
                problem.at(self.scan.span(tokens.start), "").note(format!("an item starts with one of {items}")),
            );
        }
    }

    /// An item that starts with a word that starts no item.
    fn unknown(&mut self, tokens: Range<usize>) {
        let scan = self.scan;
        let first = tokens.start;
        let word = scan.word(first);
        let looks_like_item = scan.is(first + 1, "{") || scan.is_name(first + 1);
        if scan.is_name(first + 1) {
            self.unread.push(self.name(first + 1));
        }
        let problem = Diagnostic::error("E0112", format!("no item starts with `{word}`")).at(scan.span(first), "");
        let meant = words::item_word(word);
        let problem = if scan.is(first + 1, "=") {
            self.unread.push(self.name(first));
            problem
                .hint(format!("a value with a name is a constant: `const {word} = …`"))
                .note("properties stand inside the braces of an item")
        } else if words::is_shape(word) && looks_like_item {
            problem
                .note("a shape is a value")
                .hint(format!("give it to a medium: `medium name {{ shape = {word}(…) }}`"))
        } else if let Some(meant) = meant.filter(|_| looks_like_item || scan.is(first + 1, "(") || word == "let") {
            problem.hint(format!("did you mean `{meant}`?"))
        } else {
            let items = words::ITEM_WORDS.map(|w| format!("`{w}`")).join(", ");
            problem.note(format!("an item starts with one of {items}"))
        };
        self.report(problem);
        // What stands inside may hold more errors.
        if let Some(kind) = words::block_word(word).filter(|_| looks_like_item) {
            self.block(tokens, kind, false);
        }
    }

    /// The name of an item whose word is `tokens.start`, and the token after it.
    fn header(&mut self, tokens: &Range<usize>, named: bool) -> (Option<Name>, usize) {
        let scan = self.scan;
        let word = scan.word(tokens.start);
        let at = tokens.start + 1;
        let inside = at < tokens.end;
        match (named, scan.kind(at).filter(|_| inside)) {
            (true, Some(TokenKind::Word)) if scan.is_name(at) => (Some(self.name(at)), at + 1),
            (true, Some(TokenKind::Word)) => {
                self.report(mistakes::reserved(scan, at));
                (None, at + 1)
            }
            (true, Some(TokenKind::String)) => {
                let problem = Diagnostic::error("E0113", format!("the name of a {word} is a word"));
                self.report(problem.at(scan.span(at), "text in quotes").hint("leave the quotation marks out"));
                (None, at + 1)
            }
            (true, _) => {
                let example = match block_kind(word) {
                    Some(BlockKind::Medium) => "medium cloud {",
                    Some(BlockKind::Light) => "light sun {",
                    Some(BlockKind::Grid) => "grid head {",
                    _ => "",
                };
                let hint = if example.is_empty() { format!("{word} name {{") } else { example.to_owned() };
                let problem = Diagnostic::error("E0113", format!("this {word} has no name"));
                self.report(problem.at(scan.span(tokens.start), "a name must follow").hint(format!("write `{hint}`")));
                let skip = inside && matches!(scan.kind(at), Some(TokenKind::Number | TokenKind::Color));
                (None, at + usize::from(skip))
            }
            (false, Some(TokenKind::Word | TokenKind::String)) => {
                let problem = Diagnostic::error("E0113", format!("`{word}` takes no name"));
                let note = format!("there is at most one `{word}` in a scene");
                self.report(problem.at(scan.span(at), "").note(note).hint(format!("write `{word} {{`")));
                (None, at + 1)
            }
            (false, _) => (None, at),
        }
    }

    /// Finds the opening brace of an item at `at`; what stands between its braces.
    fn body(&mut self, tokens: &Range<usize>, at: usize) -> Option<Range<usize>> {
        let scan = self.scan;
        let mut brace = at;
        if brace < tokens.end && !scan.is(brace, "{") {
            if (brace + 1) < tokens.end && scan.is(brace + 1, "{") && matches!(scan.word(brace), "=" | ":" | ",") {
                let problem = Diagnostic::error("E0101", format!("expected `{{`, found `{}`", scan.word(brace)));
                self.report(problem.at(scan.span(brace), "").hint("leave it out: the brace follows the name"));
                brace += 1;
            } else if scan.is(brace, "(") && self.brackets.partner[brace].is_some_and(|p| scan.is(p + 1, "{")) {
                let problem = Diagnostic::error("E0101", "expected `{`, found `(`").at(scan.span(brace), "");
                self.report(problem.hint("only functions (`fn`) have parameters"));
                brace = self.brackets.partner[brace]? + 1;
            }
        }
        if brace >= tokens.end || !scan.is(brace, "{") {
            let before = scan.span(at.min(tokens.end) - 1);
            let found =
                if brace < tokens.end { mistakes::token(scan, brace) } else { "the end of the item".to_owned() };
            let problem =
                Diagnostic::error("E0101", format!("expected `{{` after `{}`, found {found}", scan.word(at - 1)));
            self.report(problem.at(before, "a `{` must follow"));
            // The brace that closes nothing has been reported only because of the missing one.
            self.found.0.retain(|d| {
                let inside = |s: crate::source::Span| tokens.clone().any(|t| scan.span(t) == s);
                !(d.code == "E0103" && d.primary_span().is_some_and(inside))
            });
            return None;
        }
        let end = self.brackets.partner[brace].map_or(tokens.end, |close| close.min(tokens.end));
        for extra in self.brackets.partner[brace].map_or(tokens.end, |p| p + 1)..tokens.end {
            if !self.bad[extra] {
                let problem =
                    Diagnostic::error("E0101", format!("expected an item, found {}", mistakes::token(scan, extra)));
                self.report(problem.at(scan.span(extra), ""));
                break;
            }
        }
        Some(brace + 1..end)
    }

    fn block(&mut self, tokens: Range<usize>, kind: BlockKind, known: bool) {
        let (name, at) = if known {
            self.header(&tokens, kind.is_named())
        } else {
            (None, tokens.start + 1 + usize::from(self.scan.is_name(tokens.start + 1)))
        };
        let Some(body) = self.body(&tokens, at) else {
            self.unread.extend(name);
            return;
        };
        let properties = self.properties(body);
        if !known || name.is_some() != kind.is_named() {
            return;
        }
        let word = self.scan.span(tokens.start);
        let span = word.to(self.scan.span(tokens.end - 1));
        let from = tokens.start.checked_sub(1).map_or(0, |t| self.scan.tokens[t].end);
        let docs = docs(self.scan, CommentKind::ItemDoc, from, word.start as usize);
        self.items.push(Item { docs, kind: ItemKind::Block(Block { kind, word, name, properties }), span });
    }

    /// Where properties start in a body, at least at its first token.
    fn property_starts(&self, body: Range<usize>) -> Vec<usize> {
        let scan = self.scan;
        let first = body.start;
        let depth = self.brackets.depth[first];
        let mut starts = vec![first];
        // `if`s that wait for their `then`: what follows them is compared, though `=` may be written.
        let mut conditions = 0usize;
        for index in body {
            if self.brackets.depth[index] != depth {
                continue;
            }
            match scan.word(index) {
                "if" => conditions += 1,
                "then" => conditions = conditions.saturating_sub(1),
                _ => {}
            }
            if index == first || !scan.is_name(index) {
                continue;
            }
            let part = scan.is(index - 1, ".");
            let compared = conditions > 0 && !scan.tokens[index].starts_line;
            let after_value = scan.ends_value(index - 1) || scan.is(index - 1, ";") || scan.is(index - 1, ",");
            let starts_here = match scan.word(index + 1) {
                "=" => !part && !compared,
                ":" | "==" | "=>" => after_value && !part && !compared,
                _ => false,
            };
            if starts_here {
                starts.push(index);
                conditions = 0;
            }
        }
        starts
    }

    fn properties(&mut self, body: Range<usize>) -> Vec<Property> {
        if body.is_empty() {
            return vec![];
        }
        let starts = self.property_starts(body.clone());
        let ends: Vec<usize> = starts.iter().skip(1).copied().chain([body.end]).collect();
        let mut properties = vec![];
        let mut separated = false;
        for (start, mut end) in starts.into_iter().zip(ends) {
            while end > start && (self.scan.is(end - 1, ",") || self.scan.is(end - 1, ";")) {
                end -= 1;
                // Who separates one property separates all of them.
                if !std::mem::replace(&mut separated, true) {
                    self.separator("properties", end);
                }
            }
            if start < end && !self.is_bad(start..end) {
                properties.extend(self.property(start..end));
            }
        }
        properties
    }

    fn property(&mut self, tokens: Range<usize>) -> Option<Property> {
        let (text, base) = self.text(tokens.clone());
        match grammar::read(Rule::lone_property, text) {
            Ok(mut pairs) => {
                let pair = pairs.next()?.into_inner().find(|p| p.as_rule() == Rule::property)?;
                Builder { scan: self.scan, base, diagnostics: &mut self.found }.property(pair).ok()
            }
            Err(failure) => {
                let stop = Stop::new(self.scan, tokens.clone(), base, failure);
                self.report(mistakes::describe(self.scan, tokens, &stop, Place::Property));
                None
            }
        }
    }

    fn rows(&mut self, tokens: Range<usize>) {
        let (name, at) = self.header(&tokens, true);
        self.unread.extend(name);
        let Some(body) = self.body(&tokens, at) else { return };
        if body.is_empty() || self.is_bad(body.clone()) {
            return;
        }
        let (text, base) = self.text(body.clone());
        match grammar::read(Rule::lone_rows, text) {
            // Only the header was at fault; the rows may still not build.
            Ok(pairs) => {
                let mut builder = Builder { scan: self.scan, base, diagnostics: &mut self.found };
                for row in pairs.flat_map(Pair::into_inner).filter(|p| p.as_rule() == Rule::row) {
                    if builder.row(row).is_err() {
                        break;
                    }
                }
            }
            Err(failure) => {
                let stop = Stop::new(self.scan, body.clone(), base, failure);
                self.report(mistakes::describe(self.scan, body, &stop, Place::Rows));
            }
        }
    }
}
