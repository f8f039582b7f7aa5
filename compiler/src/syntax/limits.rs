//! How much a text may ask for. Reading recurses on brackets, `if`s and the like, and every later room recurses on the
//! height of the tree, so both are bounded here, once, before any of them starts.

use super::lex::{Scan, TokenKind};
use crate::diagnostic::Diagnostic;

/// Brackets, `if`s, `sum`s and the like inside each other.
pub(super) const MAX_NESTING: usize = 64;

/// Height of an expression's tree; a chain `a + b + c` of n operators is n high.
pub(super) const MAX_HEIGHT: usize = 256;

/// Bytes of one text; spans count in `u32`, and no scene is written by hand at a fraction of this.
pub(super) const MAX_BYTES: usize = 64 << 20;

/// Findings in one text; nobody reads more, and looking for repeated ones costs time that grows with their square.
pub(super) const MAX_FINDINGS: usize = 256;

/// What nests inside one bracket without a bracket of its own.
#[derive(Default)]
struct Frame {
    /// `if`s whose `else` has not come.
    ifs: usize,
    /// `sum(i in a..b)` before a body, `vec3<` before a type.
    prefixes: usize,
}

/// The first token that lies too deep, with what to say about it. Counts high rather than low.
pub(super) fn too_deep(scan: &Scan<'_>) -> Option<(usize, Diagnostic)> {
    let mut outer: Vec<Frame> = vec![];
    let mut top = Frame::default();
    let mut depth = 0usize;
    for (index, token) in scan.tokens.iter().enumerate() {
        let word = scan.word(index);
        match (token.kind, word) {
            (TokenKind::Symbol, "(" | "[" | "{") => {
                outer.push(std::mem::take(&mut top));
                depth += 1;
            }
            (TokenKind::Symbol, ")" | "]" | "}") => {
                depth -= top.ifs + top.prefixes;
                depth -= usize::from(!outer.is_empty());
                top = outer.pop().unwrap_or_default();
            }
            (TokenKind::Word, "if") => {
                top.ifs += 1;
                depth += 1;
            }
            (TokenKind::Word, "else") => {
                depth -= usize::from(top.ifs > 0) + std::mem::take(&mut top.prefixes);
                top.ifs = top.ifs.saturating_sub(1);
            }
            (TokenKind::Word, "sum" | "product" | "max" | "min")
                if scan.is(index + 1, "(") && scan.is_name(index + 2) && scan.word(index + 3) == "in" =>
            {
                top.prefixes += 1;
                depth += 1;
            }
            (TokenKind::Symbol, "<") => {
                top.prefixes += 1;
                depth += 1;
            }
            (TokenKind::Symbol, "," | ";" | ":" | "=" | "+" | "&&" | "||" | "==" | "..")
            | (TokenKind::Word, "then" | "let") => {
                depth -= std::mem::take(&mut top.prefixes);
            }
            _ => {}
        }
        if depth > MAX_NESTING {
            let diagnostic = Diagnostic::error("E0119", format!("this is nested more than {MAX_NESTING} deep"))
                .at(scan.span(index), "one level too many")
                .hint("name the inner parts with `let`, `const` or `fn`");
            return Some((index, diagnostic));
        }
    }
    None
}
