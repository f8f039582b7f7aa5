//! The omission ledger: what a program does without, and why.

use crate::source::Span;

/// One thing left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Omission {
    /// What: `loop over steps`, `phase function`, `binding for rays` …
    pub feature: String,
    /// Why it is not needed, as a sentence.
    pub reason: String,
    /// The line that made it unneeded, if one did.
    pub span: Option<Span>,
}

/// All of them, in the order of the pipeline.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ledger(pub Vec<Omission>);

impl Ledger {
    /// Notes that something was left out.
    pub fn omit(&mut self, feature: impl Into<String>, reason: impl Into<String>, span: Option<Span>) {
        self.0.push(Omission { feature: feature.into(), reason: reason.into(), span });
    }
}
