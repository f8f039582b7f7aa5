//! Wavefront OBJ: the `v` and `f` lines of it.
//!
//! Indices count from 1, negative ones from the last corner so far; `f 1/2/3` names a corner, a texture coordinate and a
//! normal, of which the first counts. A `\` at the end of a line continues it. The fourth number of `v` is a weight that
//! only curves use (and some programs write colours there), so it changes nothing.

use super::soup::{Soup, index_error};
use super::{CODES, broken, not_a_mesh};
use crate::data::text::{next_line, number, shown, words};
use compiler::loader::LoadError;
use std::io::BufRead;

pub(super) fn read(mut reader: impl BufRead) -> Result<Soup, LoadError> {
    let mut soup = Soup::default();
    let (mut line, mut more, mut at, mut anything) = (vec![], vec![], 0_u64, false);
    let mut face = vec![];
    while next_line(&mut reader, &mut line, CODES)? {
        at += 1;
        let start = at;
        while continued(&mut line) && next_line(&mut reader, &mut more, CODES)? {
            at += 1;
            line.push(b' ');
            line.extend_from_slice(&more);
            if line.len() > 1 << 24 {
                return Err(broken(format!("has a line of more than 16 MiB from line {start} on")));
            }
        }
        let text = line.split(|c| *c == b'#').next().unwrap_or_default();
        let mut words = words(text);
        match words.next() {
            Some(b"v") => {
                anything = true;
                soup.corner(position(words, start)?)?;
            }
            // `fo` is how the oldest files spell it.
            Some(b"f" | b"fo") => {
                anything = true;
                face.clear();
                for word in words {
                    face.push(index(word, soup.corners(), start)?);
                }
                if face.len() < 3 {
                    return Err(broken(format!("has a face of {} corners in line {start}", face.len())));
                }
                soup.polygon(&face, || format!("line {start} (corners counted from 0)"))?;
            }
            Some(_) | None => {}
        }
    }
    if anything { Ok(soup) } else { Err(not_a_mesh()) }
}

/// Takes a `\` from the end of a line.
fn continued(line: &mut Vec<u8>) -> bool {
    let end = line.trim_ascii_end().len();
    let continued = end > 0 && line[end - 1] == b'\\';
    if continued {
        line.truncate(end - 1);
    }
    continued
}

fn position<'a>(mut words: impl Iterator<Item = &'a [u8]>, line: u64) -> Result<[f64; 3], LoadError> {
    let mut position = [0.0; 3];
    for x in &mut position {
        let word =
            words.next().ok_or_else(|| broken(format!("has a corner of fewer than 3 numbers in line {line}")))?;
        *x = number(word).ok_or_else(|| broken(format!("has `{}` for a number in line {line}", shown(word))))?;
    }
    Ok(position)
}

/// The number of a corner, from 0.
fn index(word: &[u8], corners: usize, line: u64) -> Result<u32, LoadError> {
    let first = word.split(|c| *c == b'/').next().unwrap_or_default();
    let number: Option<i64> = std::str::from_utf8(first).ok().and_then(|t| t.parse().ok());
    let number = number.ok_or_else(|| broken(format!("has `{}` for a corner in line {line}", shown(word))))?;
    let from_0 =
        if number > 0 { Some(number - 1) } else { (corners as i64).checked_add(number).filter(|_| number < 0) };
    from_0
        .and_then(|n| u32::try_from(n).ok())
        .ok_or_else(|| index_error(format!("names corner {number} in line {line}, where there are {corners}")))
}
