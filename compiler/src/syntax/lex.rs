//! Tokens and comments with their places: what recovery, the nesting limits and the formatter need, and what pest,
//! which reads characters, does not give. Its words agree with `grammar/vol.pest`; a test holds them together.

use super::limits::MAX_NESTING;
use crate::diagnostic::Diagnostic;
use crate::source::{SourceId, Span};
use pest::unicode::{WHITE_SPACE, XID_CONTINUE, XID_START};

/// The kinds of tokens.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum TokenKind {
    /// A name, a unit or a reserved word.
    Word,
    /// `1.5e3`
    Number,
    /// `"…"`
    String,
    /// `#fff`
    Color,
    /// A mark, of one or two characters.
    Symbol,
    /// Something that is no token of the language; a problem has been noted.
    Bad,
}

/// A token where it stands.
#[derive(Copy, Clone, Debug)]
pub(super) struct Token {
    pub(super) kind: TokenKind,
    /// First byte.
    pub(super) start: usize,
    /// One past the last byte.
    pub(super) end: usize,
    /// Whether it is the first token on its line.
    pub(super) starts_line: bool,
}

/// The kinds of comments.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum CommentKind {
    /// `// …`
    Line,
    /// `/* … */`
    Block,
    /// `/// …`
    ItemDoc,
    /// `//! …`
    ModuleDoc,
}

/// A comment where it stands, without its line break.
#[derive(Copy, Clone, Debug)]
pub(super) struct Comment {
    pub(super) kind: CommentKind,
    pub(super) start: usize,
    pub(super) end: usize,
}

/// Something wrong with the characters themselves.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    /// The token it is about; `None` for a comment, which swallows the rest of the text.
    pub(super) token: Option<usize>,
    pub(super) diagnostic: Diagnostic,
}

/// A text taken apart.
#[derive(Clone, Debug)]
pub(super) struct Scan<'t> {
    pub(super) source: SourceId,
    pub(super) text: &'t str,
    pub(super) tokens: Vec<Token>,
    pub(super) comments: Vec<Comment>,
    pub(super) problems: Vec<Problem>,
}

/// The words that are never names.
pub(super) const RESERVED: [&str; 7] = ["if", "then", "else", "let", "true", "false", "in"];

const PAIRS: [&str; 10] = ["::", "..", "->", "=>", "==", "!=", "<=", ">=", "&&", "||"];
const SINGLES: &str = "()[]{},;:=<>+-*/^!.";

impl<'t> Scan<'t> {
    /// The text of a token.
    pub(super) fn word(&self, index: usize) -> &'t str {
        self.tokens.get(index).map_or("", |t| &self.text[t.start..t.end])
    }

    /// Whether the token is this mark.
    pub(super) fn is(&self, index: usize, symbol: &str) -> bool {
        self.tokens.get(index).is_some_and(|t| t.kind == TokenKind::Symbol) && self.word(index) == symbol
    }

    /// Whether the token is a word that may be a name.
    pub(super) fn is_name(&self, index: usize) -> bool {
        self.kind(index) == Some(TokenKind::Word) && !RESERVED.contains(&self.word(index))
    }

    /// The kind of a token.
    pub(super) fn kind(&self, index: usize) -> Option<TokenKind> {
        self.tokens.get(index).map(|t| t.kind)
    }

    /// The span of a token; past the last one, the end of the text.
    pub(super) fn span(&self, index: usize) -> Span {
        match self.tokens.get(index) {
            Some(t) => Span::new(self.source, t.start, t.end),
            None => Span::new(self.source, self.text.len(), self.text.len()),
        }
    }

    /// Whether a value can end with this token.
    pub(super) fn ends_value(&self, index: usize) -> bool {
        match self.kind(index) {
            Some(TokenKind::Word) => !matches!(self.word(index), "if" | "then" | "else" | "let" | "in"),
            Some(TokenKind::Number | TokenKind::String | TokenKind::Color | TokenKind::Bad) => true,
            Some(TokenKind::Symbol) => matches!(self.word(index), ")" | "]" | "}"),
            None => false,
        }
    }
}

/// Whether a name can start with this character.
pub(super) fn starts_name(c: char) -> bool {
    c == '_' || c.is_ascii_alphabetic() || (!c.is_ascii() && XID_START(c))
}

/// Whether a name can go on with this character.
pub(super) fn continues_name(c: char) -> bool {
    c == '_' || c.is_ascii_alphanumeric() || (!c.is_ascii() && c != '\u{B7}' && XID_CONTINUE(c))
}

fn is_space(c: char) -> bool {
    matches!(c, ' ' | '\n' | '\t' | '\r' | '\u{FEFF}') || WHITE_SPACE(c)
}

/// Takes a text apart.
pub(super) fn scan(source: SourceId, text: &str) -> Scan<'_> {
    let mut lexer = Lexer {
        at: 0,
        starts_line: true,
        scan: Scan { source, text, tokens: vec![], comments: vec![], problems: vec![] },
    };
    lexer.run();
    lexer.scan
}

struct Lexer<'t> {
    at: usize,
    starts_line: bool,
    scan: Scan<'t>,
}

impl<'t> Lexer<'t> {
    fn rest(&self) -> &'t str {
        &self.scan.text[self.at..]
    }

    fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    fn skip_while(&mut self, keep: impl Fn(char) -> bool) {
        let rest = self.rest();
        self.at += rest.find(|c| !keep(c)).unwrap_or(rest.len());
    }

    fn span(&self, start: usize) -> Span {
        Span::new(self.scan.source, start, self.at)
    }

    fn push(&mut self, kind: TokenKind, start: usize) {
        let starts_line = std::mem::take(&mut self.starts_line);
        self.scan.tokens.push(Token { kind, start, end: self.at, starts_line });
    }

    /// Notes something wrong with the token that is pushed next.
    fn problem(&mut self, diagnostic: Diagnostic) {
        self.scan.problems.push(Problem { token: Some(self.scan.tokens.len()), diagnostic });
    }

    fn run(&mut self) {
        while let Some(c) = self.peek() {
            let start = self.at;
            if is_space(c) {
                self.starts_line |= c == '\n';
                self.at += c.len_utf8();
            } else if self.rest().starts_with("//") {
                self.line_comment(start);
            } else if self.rest().starts_with("/*") {
                self.block_comment(start);
            } else if c.is_ascii_digit() {
                self.number(start);
            } else if starts_name(c) {
                self.word(start);
            } else if c == '"' {
                self.string(start);
            } else if c == '#' {
                self.color(start);
            } else if c == '.' && self.rest()[1..].starts_with(|d: char| d.is_ascii_digit()) {
                self.leading_dot(start);
            } else {
                self.symbol(start, c);
            }
        }
    }

    fn line_comment(&mut self, start: usize) {
        let rest = self.rest();
        let kind = if rest.starts_with("///") && !rest.starts_with("////") {
            CommentKind::ItemDoc
        } else if rest.starts_with("//!") {
            CommentKind::ModuleDoc
        } else {
            CommentKind::Line
        };
        let line = rest.split('\n').next().unwrap_or(rest);
        self.at += line.len();
        self.scan.comments.push(Comment { kind, start, end: start + line.trim_end().len() });
    }

    fn block_comment(&mut self, start: usize) {
        let bytes = self.scan.text.as_bytes();
        let (mut depth, mut deepest) = (0usize, 0usize);
        while self.at < bytes.len() {
            if bytes[self.at..].starts_with(b"/*") {
                depth += 1;
                deepest = deepest.max(depth);
                self.at += 2;
            } else if bytes[self.at..].starts_with(b"*/") {
                depth -= 1;
                self.at += 2;
                if depth == 0 {
                    break;
                }
            } else {
                self.starts_line |= bytes[self.at] == b'\n';
                self.at += 1;
            }
        }
        let opening = Span::new(self.scan.source, start, start + 2);
        if depth > 0 {
            let diagnostic = Diagnostic::error("E0105", "this comment is never closed").at(opening, "opened here");
            let diagnostic = if depth > 1 {
                diagnostic.note("comments nest: each `/*` inside needs a `*/` of its own")
            } else {
                diagnostic
            };
            self.scan.problems.push(Problem { token: None, diagnostic: diagnostic.hint("close it with `*/`") });
        } else if deepest > MAX_NESTING {
            let message = format!("comments are nested more than {MAX_NESTING} deep");
            let diagnostic = Diagnostic::error("E0119", message).at(opening, "the outermost one");
            self.scan.problems.push(Problem { token: None, diagnostic });
        }
        self.scan.comments.push(Comment { kind: CommentKind::Block, start, end: self.at });
    }

    fn digits(&mut self) {
        self.skip_while(|c| c.is_ascii_digit());
        loop {
            let underscores = self.rest().len() - self.rest().trim_start_matches('_').len();
            if underscores == 0 || !self.rest()[underscores..].starts_with(|c: char| c.is_ascii_digit()) {
                return;
            }
            self.at += underscores;
            self.skip_while(|c| c.is_ascii_digit());
        }
    }

    fn number(&mut self, start: usize) {
        self.digits();
        let mut whole = true;
        let mut chars = self.rest().chars();
        if chars.next() == Some('.') && chars.next().is_some_and(|c| c.is_ascii_digit()) {
            whole = false;
            self.at += 1;
            self.digits();
        }
        let rest = self.rest();
        if let Some(after) = rest.strip_prefix(['e', 'E']) {
            let digits = after.strip_prefix(['+', '-']).unwrap_or(after);
            if digits.starts_with(|c: char| c.is_ascii_digit()) {
                whole = false;
                self.at += rest.len() - digits.len();
                self.skip_while(|c| c.is_ascii_digit());
            } else if !digits.starts_with(continues_name) {
                self.at += rest.len() - digits.len();
                let hint = format!(
                    "write the exponent, as in `{}e3`, or leave the `e` out",
                    &self.scan.text[start..start + 1]
                );
                let span = self.span(start);
                self.problem(Diagnostic::error("E0107", "the exponent has no digits").at(span, "").hint(hint));
                self.push(TokenKind::Bad, start);
                return;
            }
        }
        let rest = self.rest();
        if rest.starts_with('.') && !rest.starts_with("..") {
            self.at += 1;
            let written = &self.scan.text[start..self.at];
            let digits = &written[..written.len() - 1];
            let hint = if whole { format!("write `{digits}` or `{digits}.0`") } else { format!("write `{digits}`") };
            let span = self.span(start);
            let problem = Diagnostic::error("E0107", "a decimal point needs a digit after it");
            self.problem(problem.at(span, "ends with a point").hint(hint));
            self.push(TokenKind::Bad, start);
            return;
        }
        self.push(TokenKind::Number, start);
        // `1024x768` is three tokens, though `x768` alone would be a name.
        if whole && rest.starts_with('x') && rest[1..].starts_with(|c: char| c.is_ascii_digit()) {
            let x = self.at;
            self.at += 1;
            self.push(TokenKind::Word, x);
        }
    }

    fn word(&mut self, start: usize) {
        self.skip_while(continues_name);
        self.push(TokenKind::Word, start);
    }

    fn leading_dot(&mut self, start: usize) {
        self.at += 1;
        self.digits();
        let written = &self.scan.text[start..self.at];
        let span = self.span(start);
        let problem = Diagnostic::error("E0107", "a number starts with a digit");
        self.problem(problem.at(span, "starts with a point").hint(format!("write `0{written}`")));
        self.push(TokenKind::Bad, start);
    }

    fn string(&mut self, start: usize) {
        self.at += 1;
        let mut problems = vec![];
        loop {
            self.skip_while(|c| !matches!(c, '"' | '\\' | '\n' | '\r'));
            let escape = self.at;
            match self.peek() {
                Some('"') => {
                    self.at += 1;
                    break;
                }
                Some('\\') => {
                    self.at += 1;
                    if let Some(problem) = self.escape(escape) {
                        problems.push(problem);
                    }
                }
                _ => {
                    let end = start + self.scan.text[start..self.at].trim_end().len();
                    let opening = Span::new(self.scan.source, start, end.max(start + 1));
                    let problem = Diagnostic::error("E0104", "this text in quotes is never closed");
                    problems.push(
                        problem
                            .at(opening, "no `\"` before the end of the line")
                            .hint("close it with `\"`; a line break inside is written `\\n`, a quotation mark `\\\"`"),
                    );
                    break;
                }
            }
        }
        let kind = if problems.is_empty() { TokenKind::String } else { TokenKind::Bad };
        for problem in problems {
            self.problem(problem);
        }
        self.push(kind, start);
    }

    /// After the backslash at `start`.
    fn escape(&mut self, start: usize) -> Option<Diagnostic> {
        let c = self.peek().filter(|c| !matches!(c, '\n' | '\r'))?;
        self.at += c.len_utf8();
        match c {
            'n' | 't' | '"' | '\\' => None,
            'u' => {
                let digits = self.rest().strip_prefix('{').and_then(|r| r.split_once('}')).map(|(digits, _)| digits);
                let hexadecimal = |d: &&str| (1..=6).contains(&d.len()) && d.bytes().all(|b| b.is_ascii_hexdigit());
                if let Some(digits) = digits.filter(hexadecimal) {
                    self.at += digits.len() + 2;
                    let code = u32::from_str_radix(digits, 16).ok().and_then(char::from_u32);
                    return code.is_none().then(|| {
                        Diagnostic::error("E0106", format!("there is no character U+{}", digits.to_uppercase()))
                            .at(self.span(start), "")
                            .note("characters go from 0 to 10FFFF, without D800 to DFFF")
                    });
                }
                Some(
                    Diagnostic::error("E0106", "`\\u` needs a character's number in braces")
                        .at(self.span(start), "")
                        .hint("write one to six hexadecimal digits, as in `\\u{fc}`"),
                )
            }
            other => {
                let problem =
                    Diagnostic::error("E0106", format!("there is no escape `\\{other}`")).at(self.span(start), "");
                Some(
                    problem.hint(
                        "the escapes are `\\n`, `\\t`, `\\\"`, `\\\\` and `\\u{…}`; for a backslash write `\\\\`",
                    ),
                )
            }
        }
    }

    fn color(&mut self, start: usize) {
        self.at += 1;
        self.skip_while(continues_name);
        let digits = &self.scan.text[start + 1..self.at];
        let span = self.span(start);
        let forms = "a colour is `#rgb`, `#rrggbb` or `#rrggbbaa`, in hexadecimal digits";
        if let Some(wrong) = digits.chars().find(|c| !c.is_ascii_hexdigit()) {
            let problem = Diagnostic::error("E0109", format!("`{wrong}` is no hexadecimal digit"));
            self.problem(problem.at(span, "in this colour").note(forms));
            self.push(TokenKind::Bad, start);
        } else if !matches!(digits.len(), 3 | 6 | 8) {
            let count = match digits.len() {
                0 => "no digits".to_owned(),
                1 => "1 digit".to_owned(),
                n => format!("{n} digits"),
            };
            let mut problem =
                Diagnostic::error("E0109", "a colour has 3, 6 or 8 digits").at(span, format!("this has {count}"));
            if let [r, g, b, a] = digits.as_bytes() {
                let doubled: String = [r, r, g, g, b, b, a, a].iter().map(|d| char::from(**d)).collect();
                problem = problem.hint(format!("with transparency a colour has eight: `#{doubled}`"));
            }
            self.problem(problem.note(forms));
            self.push(TokenKind::Bad, start);
        } else {
            self.push(TokenKind::Color, start);
        }
    }

    fn symbol(&mut self, start: usize, c: char) {
        if PAIRS.iter().any(|p| self.rest().starts_with(p)) {
            self.at += 2;
            self.push(TokenKind::Symbol, start);
        } else if SINGLES.contains(c) {
            self.at += 1;
            self.push(TokenKind::Symbol, start);
        } else {
            self.skip_while(|d| d == c);
            let problem = super::words::foreign_character(c).map_or_else(
                || Diagnostic::error("E0122", format!("`{}` has no meaning here", c.escape_debug())),
                |(what, hint)| Diagnostic::error("E0122", what).hint(hint),
            );
            let span = self.span(start);
            self.problem(problem.at(span, ""));
            self.push(TokenKind::Bad, start);
        }
    }
}
