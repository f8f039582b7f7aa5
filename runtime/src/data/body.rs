//! The voxel part of a file: where it starts, how it is encoded, and how much of it can be there at all.

use super::input::{Input, unreadable};
use super::voxels::{Voxels, read_binary, read_text};
use super::{MAX_BYTES, broken};
use compiler::loader::{GridHeader, LoadError};
use flate2::bufread::GzDecoder;
use std::io::{self, BufRead, BufReader, Read};

pub(super) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// How the voxels are written.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    Gzip,
    /// Decimal numbers between spaces, line breaks or commas.
    Text,
    /// Two hexadecimal digits a byte.
    Hex,
}

/// The voxels of a file, not read yet.
pub(super) struct Body {
    reader: BufReader<Input>,
    encoding: Encoding,
    /// Bytes to drop after decoding.
    skip: u64,
    big_endian: bool,
}

/// Why the voxels could not be read; how it is worded depends on the whole header.
#[derive(Debug)]
pub(super) enum Stop {
    Io(io::Error),
    Short { arrived: u64 },
    Number(String),
    NoMemory,
}

/// Compressed data cannot be asked to skip more than this: it would have to be unpacked only to be dropped.
const MAX_SKIP: u64 = 256 << 20;

/// Deflate packs at most 1032 bytes into one.
pub(super) const MAX_DEFLATE: u64 = 1040;

/// Number of samples and their bytes.
///
/// # Errors
/// `E0608` when that is more than [`MAX_BYTES`].
pub(super) fn extent(header: &GridHeader) -> Result<(usize, u64), LoadError> {
    let [x, y, z] = header.dims.map(u64::from);
    let count = x.checked_mul(y).and_then(|n| n.checked_mul(z));
    let bytes = count.and_then(|n| n.checked_mul(header.scalar.bytes() as u64)).filter(|n| *n <= MAX_BYTES);
    match (count.and_then(|n| usize::try_from(n).ok()), bytes) {
        (Some(count), Some(bytes)) => Ok((count, bytes)),
        _ => Err(LoadError {
            code: "E0608",
            message: format!("has {x} × {y} × {z} voxels of {} bytes, more than 16 GiB", header.scalar.bytes()),
            hint: Some("cut it or halve its resolution first".into()),
        }),
    }
}

impl Body {
    /// Checks that as many voxels as the header promises can follow. `offset` is where the encoded data starts in the
    /// file, `skip` how many bytes are to be dropped after decoding.
    ///
    /// # Errors
    /// `E0604` when the file is too short, `E0608` when the volume is too large.
    pub(super) fn new(
        input: Input,
        offset: u64,
        encoding: Encoding,
        skip: u64,
        header: &GridHeader,
        big_endian: bool,
    ) -> Result<Self, LoadError> {
        let (count, bytes) = extent(header)?;
        let present = input.length().saturating_sub(offset);
        let (offset, skip, possible) = match encoding {
            // Dropping bytes of plain data is a matter of starting later.
            Encoding::Raw => (offset.saturating_add(skip), 0, bytes.saturating_add(skip) <= present),
            Encoding::Gzip => (offset, skip, bytes / MAX_DEFLATE <= present),
            Encoding::Text => (offset.saturating_add(skip), 0, 2 * count as u64 <= present.saturating_sub(skip) + 1),
            Encoding::Hex => (offset.saturating_add(skip), 0, 2 * bytes <= present.saturating_sub(skip)),
        };
        if skip > MAX_SKIP {
            return Err(broken(format!("asks to skip {skip} bytes of compressed data")));
        }
        if !possible {
            let after = if offset == 0 { String::new() } else { format!(" after byte {offset}") };
            return Err(too_short(header, format!("of which its {} bytes{after} cannot hold all", input.length())));
        }
        Ok(Self { reader: input.into_reader(offset)?, encoding, skip, big_endian })
    }

    /// Decodes the voxels straight into their vector.
    pub(super) fn read(self, header: &GridHeader) -> Result<Voxels, LoadError> {
        let (count, bytes) = extent(header)?;
        let scalar = header.scalar;
        let swap = self.big_endian != cfg!(target_endian = "big");
        let mut reader = self.reader;
        let read = match self.encoding {
            // The file is known to be long enough, so all memory can be taken at once.
            Encoding::Raw => read_binary(scalar, &mut reader, count, count, swap),
            Encoding::Hex => read_binary(scalar, &mut Hex(reader), count, 0, swap),
            Encoding::Text => read_text(scalar, &mut reader, count),
            Encoding::Gzip => read_gzip(reader, self.skip, |r| read_binary(scalar, r, count, 0, swap)),
        };
        read.map_err(|stop| match stop {
            Stop::Io(error) => decode_error(&error),
            Stop::Short { arrived } => too_short(header, format!("that is {bytes} bytes, but {arrived} are there")),
            Stop::Number(text) => LoadError {
                code: "E0610",
                message: format!("has `{text}` among its voxels, which is no number that fits its type"),
                hint: None,
            },
            Stop::NoMemory => LoadError {
                code: "E0608",
                message: format!("needs {bytes} bytes of memory, more than there is"),
                hint: Some("cut it or halve its resolution first".into()),
            },
        })
    }
}

fn read_gzip(
    reader: BufReader<Input>,
    skip: u64,
    read: impl FnOnce(&mut dyn Read) -> Result<Voxels, Stop>,
) -> Result<Voxels, Stop> {
    let mut gzip = Gzip::new(reader);
    let dropped = io::copy(&mut (&mut gzip).take(skip), &mut io::sink()).map_err(Stop::Io)?;
    if dropped < skip {
        return Err(Stop::Short { arrived: 0 });
    }
    let voxels = read(&mut gzip)?;
    // Asking for one byte more makes the decoder compare the checksum, if the stream ends with the voxels.
    read_full(&mut gzip, &mut [0]).map_err(Stop::Io)?;
    Ok(voxels)
}

fn too_short(header: &GridHeader, what: String) -> LoadError {
    let [x, y, z] = header.dims;
    let size = header.scalar.bytes();
    let plural = if size == 1 { "" } else { "s" };
    LoadError {
        code: "E0604",
        message: format!("promises {x} × {y} × {z} voxels of {size} byte{plural}, {what}"),
        hint: Some("the file is cut off, or the header belongs to another file".into()),
    }
}

/// `E0610` for data that does not decode, `E0601` for a file that cannot be read.
pub(super) fn decode_error(error: &io::Error) -> LoadError {
    use io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    match error.kind() {
        InvalidData | InvalidInput | UnexpectedEof => LoadError {
            code: "E0610",
            message: format!("cannot be decoded: {error}"),
            hint: Some("the file is damaged or cut off: copy it again".into()),
        },
        _ => unreadable(error),
    }
}

/// Fills the buffer as far as the reader goes.
pub(super) fn read_full(reader: &mut dyn Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match reader.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}

/// All members of a gzip file, one after the other, and like gzip silent about what follows them: `flate2`'s own decoder
/// of many members takes padding after the last for damage.
pub(super) struct Gzip<R: BufRead> {
    member: Option<GzDecoder<R>>,
}

impl<R: BufRead> Gzip<R> {
    pub(super) fn new(reader: R) -> Self {
        Self { member: Some(GzDecoder::new(reader)) }
    }
}

impl<R: BufRead> Read for Gzip<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        while let Some(mut member) = self.member.take() {
            let n = member.read(buffer)?;
            if n > 0 {
                self.member = Some(member);
                return Ok(n);
            }
            let mut rest = member.into_inner();
            // The buffer may end between the two magic bytes; one is enough, since a member never starts otherwise.
            if rest.fill_buf()?.first() == Some(&GZIP_MAGIC[0]) {
                self.member = Some(GzDecoder::new(rest));
            }
        }
        Ok(0)
    }
}

/// Bytes out of hexadecimal digits; whatever space is between them is ignored.
struct Hex<R: BufRead>(R);

impl<R: BufRead> Read for Hex<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        let mut high = None;
        let mut text = [0; 1 << 12];
        while filled < buffer.len() {
            // Exactly as many digits as are missing, so that nothing has to be kept for the next call.
            let digits = (2 * (buffer.len() - filled) - usize::from(high.is_some())).min(text.len());
            let n = read_full(&mut self.0, &mut text[..digits])?;
            for &c in text[..n].iter().filter(|c| !c.is_ascii_whitespace()) {
                let Some(digit) = char::from(c).to_digit(16) else {
                    let message = format!("`{}` is no hexadecimal digit", char::from(c).escape_default());
                    return Err(io::Error::new(io::ErrorKind::InvalidData, message));
                };
                match high.take() {
                    None => high = Some(digit),
                    Some(h) => {
                        buffer[filled] = (h << 4 | digit) as u8;
                        filled += 1;
                    }
                }
            }
            if n == 0 {
                break;
            }
        }
        Ok(filled)
    }
}
