//! Lines, words and numbers of files that are text, or begin with it.

use super::Codes;
use super::input::unreadable;
use compiler::loader::LoadError;
use std::io::{BufRead, Read};

/// Longer lines of text are no data.
const MAX_LINE: u64 = 16 << 20;

/// The next line of text without its end; `false` at the end of the file.
pub(super) fn next_line(reader: &mut impl BufRead, line: &mut Vec<u8>, codes: Codes) -> Result<bool, LoadError> {
    line.clear();
    let read = reader.by_ref().take(MAX_LINE).read_until(b'\n', line).map_err(|e| unreadable(&e))?;
    if read as u64 == MAX_LINE && line.last() != Some(&b'\n') {
        return Err(codes.broken("has a line of more than 16 MiB"));
    }
    if line.last() == Some(&b'\n') {
        line.pop();
    }
    Ok(read > 0)
}

/// The words of a line.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// A number as every program writes it; `nan` and `inf` are numbers here and fall out later.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// A word for a message, however strange.
pub(super) fn shown(word: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(word).chars().take(24).collect();
    text.escape_debug().to_string()
}
