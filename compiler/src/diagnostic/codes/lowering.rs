//! E05xx: lowering, analysis and backends.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[];
