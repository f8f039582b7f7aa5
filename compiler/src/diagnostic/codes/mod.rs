//! The register of diagnostic codes: one file per range, so that a code is added beside its neighbours.
//!
//! `E01xx`/`W01xx` syntax, `02` names and modules, `03` types and dimensions, `04` items, properties and values,
//! `05` lowering, analysis and backends, `06` data files and run time, `09` parts of the language that are not there yet.

mod data;
mod items;
mod lowering;
mod machine;
mod names;
mod pending;
mod splats;
mod syntax;
mod types;

/// What `vol explain` knows about one code.
#[derive(Copy, Clone, Debug)]
pub struct CodeInfo {
    /// `E0301`.
    pub code: &'static str,
    /// One line.
    pub title: &'static str,
    /// Markdown: what it means, a wrong example, the right one.
    pub explanation: &'static str,
}

/// Every code, in order.
pub fn all_codes() -> impl Iterator<Item = &'static CodeInfo> {
    [
        syntax::CODES,
        names::CODES,
        types::CODES,
        items::CODES,
        lowering::CODES,
        data::CODES,
        machine::CODES,
        splats::CODES,
        pending::CODES,
    ]
    .into_iter()
    .flatten()
}

/// The entry of a code; case does not matter.
#[must_use]
pub fn explain(code: &str) -> Option<&'static CodeInfo> {
    all_codes().find(|c| c.code.eq_ignore_ascii_case(code))
}
