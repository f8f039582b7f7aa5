//! E06xx: data files and run time.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[];
