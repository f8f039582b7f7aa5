//! E03xx: types and dimensions.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[];
