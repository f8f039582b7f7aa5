//! PLY, the Stanford triangle format, in its three encodings.
//!
//! Of the elements, `vertex` (scalars `x`, `y`, `z` of any type) and `face` (a list `vertex_indices` or `vertex_index`) are
//! used; all others are skipped by their types.

use super::soup::{Soup, index_error, next_line, number, shown, words};
use super::{broken, truncated};
use crate::data::input::unreadable;
use compiler::loader::LoadError;
use std::io::{BufRead, ErrorKind};

/// A header longer than this is none.
const MAX_HEADER_LINES: usize = 100_000;

#[derive(Copy, Clone, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Binary { big_endian: bool },
}

#[derive(Copy, Clone, Debug, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// From bytes in little-endian order, of which the first `bytes()` count.
    fn value(self, b: [u8; 8]) -> f64 {
        match self {
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Self::I32 => f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F64 => f64::from_le_bytes(b),
        }
    }
}

/// What the values of a property are for.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
enum Role {
    Coordinate(usize),
    Corners,
    Nothing,
}

#[derive(Debug)]
struct Property {
    role: Role,
    scalar: Scalar,
    /// The type of the length, for a list.
    length: Option<Scalar>,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    /// Fewest bytes that one of it takes.
    fn least(&self, encoding: Encoding) -> u64 {
        let bytes = match encoding {
            // A digit and what parts it from the next.
            Encoding::Ascii => 2 * self.properties.len(),
            Encoding::Binary { .. } => self.properties.iter().map(|p| p.length.unwrap_or(p.scalar).bytes()).sum(),
        };
        // An element without properties would have no size; no file needs many of those.
        bytes.max(1) as u64
    }

    fn has(&self, roles: &[Role]) -> bool {
        roles.iter().all(|r| self.properties.iter().any(|p| p.role == *r))
    }
}

/// `length` is that of the whole file in bytes.
pub(super) fn read(mut reader: impl BufRead, length: u64) -> Result<Soup, LoadError> {
    let (encoding, elements) = header(&mut reader)?;
    // The last line of a text may lack its end.
    let mut left = length.saturating_add(1);
    for element in &elements {
        let needed = element.count.saturating_mul(element.least(encoding));
        left = left.checked_sub(needed).ok_or_else(|| {
            let (n, name) = (element.count, &element.name);
            truncated(format!("promises {n} of element `{name}`, of which its {length} bytes cannot hold all"))
        })?;
    }
    let mut soup = Soup::default();
    let mut body = Body { reader, encoding, line: vec![], at: 0 };
    let mut corners = vec![];
    for element in &elements {
        let is_vertex = element.name == "vertex";
        for n in 0..element.count {
            let place = || format!("{} {n}", element.name);
            body.start(&place)?;
            let mut position = [0.0; 3];
            corners.clear();
            for property in &element.properties {
                let count = match property.length {
                    None => 1,
                    Some(scalar) => {
                        let value = body.value(scalar, &place)?;
                        whole(value).ok_or_else(|| broken(format!("has a list of {value} entries in {}", place())))?
                    }
                };
                for _ in 0..count {
                    let value = body.value(property.scalar, &place)?;
                    match property.role {
                        Role::Coordinate(axis) => position[axis] = value,
                        Role::Corners => corners.push(
                            whole(value).ok_or_else(|| index_error(format!("names corner {value} in {}", place())))?,
                        ),
                        Role::Nothing => {}
                    }
                }
            }
            if is_vertex {
                soup.corner(position)?;
            } else {
                soup.polygon(&corners, place)?;
            }
        }
    }
    Ok(soup)
}

/// A number that can count or name something.
fn whole(value: f64) -> Option<u32> {
    (value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value)).then_some(value as u32)
}

fn header(reader: &mut impl BufRead) -> Result<(Encoding, Vec<Element>), LoadError> {
    let (mut encoding, mut elements): (_, Vec<Element>) = (None, vec![]);
    let mut line = vec![];
    for at in 1.. {
        if at > MAX_HEADER_LINES {
            return Err(broken("has no `end_header`"));
        }
        if !next_line(reader, &mut line)? {
            return Err(truncated("ends inside its header"));
        }
        let wrong = |what: &str| broken(format!("has {what} in line {at}: `{}`", shown(line.trim_ascii())));
        let words: Vec<&[u8]> = words(&line).collect();
        match words.as_slice() {
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"ply"] if at == 1 => {}
            [b"format", kind, b"1.0"] if encoding.is_none() => {
                encoding = Some(match *kind {
                    b"ascii" => Encoding::Ascii,
                    b"binary_little_endian" => Encoding::Binary { big_endian: false },
                    b"binary_big_endian" => Encoding::Binary { big_endian: true },
                    _ => return Err(wrong("an unknown encoding")),
                });
            }
            [b"element", name, count] => {
                let name = String::from_utf8_lossy(name).into_owned();
                let count = std::str::from_utf8(count).ok().and_then(|c| c.parse().ok());
                let count = count.ok_or_else(|| wrong("no count"))?;
                if elements.iter().any(|e| e.name == name) {
                    return Err(wrong("an element twice"));
                }
                elements.push(Element { name, count, properties: vec![] });
            }
            [b"property", rest @ ..] => {
                let element = elements.last_mut().ok_or_else(|| wrong("a property of no element"))?;
                let property = property(&element.name, rest).ok_or_else(|| wrong("a property of an unknown type"))?;
                if property.role != Role::Nothing && element.has(&[property.role]) {
                    return Err(wrong("a property twice"));
                }
                element.properties.push(property);
            }
            [b"end_header"] => break,
            _ => return Err(wrong("something unknown")),
        }
    }
    let encoding = encoding.ok_or_else(|| broken("has no line `format`"))?;
    for element in &elements {
        let roles = [Role::Coordinate(0), Role::Coordinate(1), Role::Coordinate(2)];
        if element.name == "vertex" && !element.has(&roles) {
            return Err(broken("has corners without `x`, `y` and `z`"));
        }
    }
    Ok((encoding, elements))
}

fn property(element: &str, words: &[&[u8]]) -> Option<Property> {
    Some(match words {
        [b"list", length, scalar, name] => {
            let length = Scalar::named(length).filter(|s| !matches!(s, Scalar::F32 | Scalar::F64))?;
            let corners = element == "face" && matches!(*name, b"vertex_indices" | b"vertex_index");
            let role = if corners { Role::Corners } else { Role::Nothing };
            Property { role, scalar: Scalar::named(scalar)?, length: Some(length) }
        }
        [scalar, name] => {
            let axis = ["x", "y", "z"].iter().position(|n| element == "vertex" && n.as_bytes() == *name);
            Property {
                role: axis.map_or(Role::Nothing, Role::Coordinate),
                scalar: Scalar::named(scalar)?,
                length: None,
            }
        }
        _ => return None,
    })
}

/// What follows the header.
struct Body<R: BufRead> {
    reader: R,
    encoding: Encoding,
    /// The line that is being read, of a text.
    line: Vec<u8>,
    at: usize,
}

impl<R: BufRead> Body<R> {
    /// Goes to the next element.
    fn start(&mut self, place: &impl Fn() -> String) -> Result<(), LoadError> {
        if self.encoding != Encoding::Ascii {
            return Ok(());
        }
        self.at = 0;
        while next_line(&mut self.reader, &mut self.line)? {
            if words(&self.line).next().is_some() {
                return Ok(());
            }
        }
        Err(truncated(format!("ends before {}", place())))
    }

    fn value(&mut self, scalar: Scalar, place: &impl Fn() -> String) -> Result<f64, LoadError> {
        let big_endian = match self.encoding {
            Encoding::Ascii => return self.word(place),
            Encoding::Binary { big_endian } => big_endian,
        };
        let mut bytes = [0; 8];
        let part = &mut bytes[..scalar.bytes()];
        self.reader.read_exact(part).map_err(|e| match e.kind() {
            ErrorKind::UnexpectedEof => truncated(format!("ends inside {}", place())),
            _ => unreadable(&e),
        })?;
        if big_endian {
            part.reverse();
        }
        Ok(scalar.value(bytes))
    }

    /// The next number of the line; its declared type says nothing about how it is written.
    fn word(&mut self, place: &impl Fn() -> String) -> Result<f64, LoadError> {
        let rest = &self.line[self.at..];
        let skipped = rest.len() - rest.trim_ascii_start().len();
        let rest = &rest[skipped..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at += skipped + length;
        let word = &rest[..length];
        if word.is_empty() {
            return Err(broken(format!("has too few numbers in {}", place())));
        }
        number(word).ok_or_else(|| broken(format!("has `{}` for a number in {}", shown(word), place())))
    }
}
