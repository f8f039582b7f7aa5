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

/// What the ledger calls pixels that are not drawn.
pub(crate) const FILLED: &str = "pixels that are filled in";

/// All of them, in the order of the pipeline.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ledger(pub Vec<Omission>);

impl Ledger {
    /// Notes that something was left out.
    pub fn omit(&mut self, feature: impl Into<String>, reason: impl Into<String>, span: Option<Span>) {
        self.0.push(Omission { feature: feature.into(), reason: reason.into(), span });
    }

    /// One ledger of several programs, each with the name of what it draws: what all of them leave out stands once, what only
    /// some do with their names.
    #[must_use]
    pub fn merge(mut parts: Vec<(String, Self)>) -> Self {
        if parts.len() < 2 {
            return parts.pop().map(|p| p.1).unwrap_or_default();
        }
        let mut all: Vec<(&Omission, Vec<usize>)> = vec![];
        for (part, omission) in parts.iter().enumerate().flat_map(|(i, (_, l))| l.0.iter().map(move |o| (i, o))) {
            match all.iter_mut().find(|(o, _)| *o == omission) {
                Some((_, found)) => found.push(part),
                None => all.push((omission, vec![part])),
            }
        }
        let named = |(omission, mut found): (&Omission, Vec<usize>)| {
            found.dedup();
            let mut omission = omission.clone();
            if found.len() < parts.len() {
                let names: Vec<&str> = found.iter().map(|i| parts[*i].0.as_str()).collect();
                omission.reason += &format!(" (at {})", names.join(", "));
            }
            omission
        };
        Self(all.into_iter().map(named).collect())
    }
}
