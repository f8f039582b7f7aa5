//! E02xx: names and modules.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[];
