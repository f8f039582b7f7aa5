//! The parser that pest makes of `grammar/vol.pest`. Only this room sees it.

use pest::Parser as _;
use pest::error::{ErrorVariant, InputLocation};
use pest::iterators::Pairs;

/// Kept in a module of its own because the derive macro writes `pub` items without documentation.
#[allow(missing_docs, unreachable_pub, clippy::all, reason = "the code is generated")]
mod generated {
    #[derive(pest_derive::Parser)]
    #[grammar = "../../grammar/vol.pest"]
    pub struct Grammar;
}

pub(super) use generated::Rule;

/// Where reading stopped, and what could have stood there.
#[derive(Clone, Debug)]
pub(super) struct Failure {
    /// Byte offset in the text that was read.
    pub(super) at: usize,
    /// What the grammar had tried there. Empty if the parser gave up for want of stack.
    pub(super) expected: Vec<Rule>,
}

/// Reads `text` as `rule`.
pub(super) fn read(rule: Rule, text: &str) -> Result<Pairs<'_, Rule>, Failure> {
    generated::Grammar::parse(rule, text).map_err(|error| {
        let at = match error.location {
            InputLocation::Pos(at) => at,
            InputLocation::Span((start, _)) => start,
        };
        let expected = match error.variant {
            ErrorVariant::ParsingError { positives, .. } => positives,
            ErrorVariant::CustomError { .. } => vec![],
        };
        Failure { at, expected }
    })
}
