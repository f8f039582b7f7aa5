//! E09xx: parts of the language that are not there yet.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[];
