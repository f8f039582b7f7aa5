//! PLY, the Stanford format of elements with properties, in its three encodings: what meshes and splats have in common.

use super::Codes;
use super::input::unreadable;
use super::text::{next_line, number, shown, words};
use compiler::loader::LoadError;
use std::io::{BufRead, ErrorKind};

/// A header longer than this is none.
const MAX_HEADER_LINES: usize = 100_000;

#[derive(Copy, Clone, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Binary { big_endian: bool },
}

/// How a number is stored.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
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

/// One number, or one list of numbers, of an element.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    scalar: Scalar,
    /// The type of the length, for a list.
    length: Option<Scalar>,
}

impl Property {
    pub(super) fn is_list(&self) -> bool {
        self.length.is_some()
    }
}

/// So many things of one kind.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
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
}

/// What a file says it holds.
#[derive(Debug)]
pub(super) struct Header {
    encoding: Encoding,
    pub(super) elements: Vec<Element>,
}

impl Header {
    /// Reads the header and checks that a file of `length` bytes can hold what it promises. `once` says which properties
    /// (of an element, by name) may be given only once.
    pub(super) fn read(
        reader: &mut impl BufRead,
        length: u64,
        codes: Codes,
        once: impl Fn(&str, &str) -> bool,
    ) -> Result<Self, LoadError> {
        let header = Self::parse(reader, codes, once)?;
        // The last line of a text may lack its end.
        let mut left = length.saturating_add(1);
        for element in &header.elements {
            let needed = element.count.saturating_mul(element.least(header.encoding));
            left = left.checked_sub(needed).ok_or_else(|| {
                let (n, name) = (element.count, &element.name);
                codes
                    .truncated(format!("promises {n} of element `{name}`, of which its {length} bytes cannot hold all"))
            })?;
        }
        Ok(header)
    }

    fn parse(reader: &mut impl BufRead, codes: Codes, once: impl Fn(&str, &str) -> bool) -> Result<Self, LoadError> {
        let (mut encoding, mut elements): (_, Vec<Element>) = (None, vec![]);
        let mut line = vec![];
        for at in 1.. {
            if at > MAX_HEADER_LINES {
                return Err(codes.broken("has no `end_header`"));
            }
            if !next_line(reader, &mut line, codes)? {
                return Err(codes.truncated("ends inside its header"));
            }
            let wrong = |what: &str| codes.broken(format!("has {what} in line {at}: `{}`", shown(line.trim_ascii())));
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
                    let property = property(rest).ok_or_else(|| wrong("a property of an unknown type"))?;
                    let again = element.properties.iter().any(|p| p.name == property.name);
                    if again && once(&element.name, &property.name) {
                        return Err(wrong("a property twice"));
                    }
                    element.properties.push(property);
                }
                [b"end_header"] => break,
                _ => return Err(wrong("something unknown")),
            }
        }
        let encoding = encoding.ok_or_else(|| codes.broken("has no line `format`"))?;
        Ok(Self { encoding, elements })
    }

    /// The rest of the file.
    pub(super) fn body<R: BufRead>(&self, reader: R, codes: Codes) -> Body<R> {
        Body { reader, encoding: self.encoding, line: vec![], at: 0, codes }
    }
}

fn property(words: &[&[u8]]) -> Option<Property> {
    let name = |word: &[u8]| String::from_utf8_lossy(word).into_owned();
    Some(match words {
        [b"list", length, scalar, word] => {
            let length = Scalar::named(length).filter(|s| !matches!(s, Scalar::F32 | Scalar::F64))?;
            Property { name: name(word), scalar: Scalar::named(scalar)?, length: Some(length) }
        }
        [scalar, word] => Property { name: name(word), scalar: Scalar::named(scalar)?, length: None },
        _ => return None,
    })
}

/// A number that can count or name something.
pub(super) fn whole(value: f64) -> Option<u32> {
    (value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value)).then_some(value as u32)
}

/// What follows the header.
pub(super) struct Body<R: BufRead> {
    reader: R,
    encoding: Encoding,
    /// The line that is being read, of a text.
    line: Vec<u8>,
    at: usize,
    codes: Codes,
}

impl<R: BufRead> Body<R> {
    /// Goes to the next element. `place` names it for messages.
    pub(super) fn start(&mut self, place: &impl Fn() -> String) -> Result<(), LoadError> {
        if self.encoding != Encoding::Ascii {
            return Ok(());
        }
        self.at = 0;
        while next_line(&mut self.reader, &mut self.line, self.codes)? {
            if words(&self.line).next().is_some() {
                return Ok(());
            }
        }
        Err(self.codes.truncated(format!("ends before {}", place())))
    }

    /// Visits each value of the next property.
    pub(super) fn property(
        &mut self,
        property: &Property,
        place: &impl Fn() -> String,
        mut visit: impl FnMut(f64) -> Result<(), LoadError>,
    ) -> Result<(), LoadError> {
        let count = match property.length {
            None => 1,
            Some(scalar) => {
                let value = self.value(scalar, place)?;
                let wrong = || self.codes.broken(format!("has a list of {value} entries in {}", place()));
                whole(value).ok_or_else(wrong)?
            }
        };
        for _ in 0..count {
            visit(self.value(property.scalar, place)?)?;
        }
        Ok(())
    }

    fn value(&mut self, scalar: Scalar, place: &impl Fn() -> String) -> Result<f64, LoadError> {
        let big_endian = match self.encoding {
            Encoding::Ascii => return self.word(place),
            Encoding::Binary { big_endian } => big_endian,
        };
        let mut bytes = [0; 8];
        let part = &mut bytes[..scalar.bytes()];
        self.reader.read_exact(part).map_err(|e| match e.kind() {
            ErrorKind::UnexpectedEof => self.codes.truncated(format!("ends inside {}", place())),
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
            return Err(self.codes.broken(format!("has too few numbers in {}", place())));
        }
        let wrong = || self.codes.broken(format!("has `{}` for a number in {}", shown(word), place()));
        number(word).ok_or_else(wrong)
    }
}
