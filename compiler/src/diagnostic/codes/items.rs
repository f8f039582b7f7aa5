//! E04xx: items, properties and values.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[];
