//! E01xx: syntax.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[];
