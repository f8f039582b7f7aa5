//! Text to syntax tree. pest's `Rule` never leaves this room.
//!
//! [`parse`] reads the whole text with the grammar. Only when that fails does it go item by item and property by property
//! to report every error and keep what can be read. [`format()`] is the one format of the language.

pub mod ast;
mod brackets;
mod expression;
mod format;
mod grammar;
mod lex;
mod limits;
mod mistakes;
mod recover;
#[cfg(test)]
mod tests;
mod tree;
mod words;

pub use format::format;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::source::{SourceId, Span};

/// Reads the text of a source.
///
/// Always returns what could be read. If `diagnostics` has errors afterwards, items or properties may be missing from the
/// module; [`ast::Module::unread`] has the names of the items that are.
pub fn parse(id: SourceId, text: &str, diagnostics: &mut Diagnostics) -> ast::Module {
    let mut module = ast::Module { docs: None, items: vec![], unread: vec![], span: Span::new(id, 0, text.len()) };
    if text.len() > limits::MAX_BYTES {
        let message = format!("this text is larger than {} MiB", limits::MAX_BYTES >> 20);
        module.span = Span::new(id, 0, 0);
        diagnostics.push(Diagnostic::error("E0119", message).at(module.span, "").hint("keep data in files of its own"));
        return module;
    }
    let scan = lex::scan(id, text);
    let first = scan.tokens.first().map_or(text.len(), |t| t.start);
    module.docs = tree::docs(&scan, lex::CommentKind::ModuleDoc, 0, first);
    let too_deep = limits::too_deep(&scan);
    let whole = if scan.problems.is_empty() && too_deep.is_none() {
        grammar::read(grammar::Rule::module, text).map_err(Some)
    } else {
        Err(None)
    };
    (module.items, module.unread) = match whole {
        Ok(pairs) => tree::Builder { scan: &scan, base: 0, diagnostics }.items(pairs),
        Err(failure) => {
            let read = recover::module(&scan, too_deep, diagnostics);
            // What the grammar refuses as a whole must not pass because its parts are fine.
            if !diagnostics.has_errors() {
                let at = failure.map_or(0, |f| scan.tokens.partition_point(|t| t.end <= f.at));
                diagnostics
                    .push(Diagnostic::error("E0101", "this text cannot be read any further").at(scan.span(at), ""));
            }
            read
        }
    };
    module
}
