//! NRRD, attached (`.nrrd`) and detached (`.nhdr`), versions 1 to 5; there is no crate for it.
//!
//! After <https://teem.sourceforge.net/nrrd/format.html>. Not read, with an error that says so: bzip2, voxels spread over
//! several files, `block` types, more than three axes in space, more than one value a voxel.

mod fields;
mod geometry;

use super::body::{self, Body, Encoding};
use super::input::{Files, Input, unreadable};
use super::{LoadWarning, Opened, broken};
use compiler::loader::{GridHeader, LoadError, Scalar};
use fields::Fields;
use std::io::{BufRead, Seek, SeekFrom};
use std::path::Path;

/// Headers are short; one that does not end within this is none.
const MAX_HEADER: u64 = 1 << 20;

/// Parses the header and finds the voxels.
pub(super) fn open(files: &dyn Files, path: &Path, mut input: Input) -> Result<Opened, LoadError> {
    let text = input.peek(MAX_HEADER)?;
    let (fields, header_length) = Fields::parse(&text)?;
    if header_length.is_none() && input.length() > MAX_HEADER {
        return Err(broken("has a header without end (there is no empty line after it)"));
    }
    let mut warnings = vec![];
    let header = grid(&fields, &mut warnings)?;
    let encoding = encoding(&fields)?;
    let big_endian = big_endian(&fields, encoding, header.scalar)?;

    let (mut input, offset) = match fields.get("datafile") {
        None => {
            let offset = header_length.ok_or_else(|| broken("ends with its header and names no data file"))?;
            (input, offset)
        }
        Some(name) => {
            let first = name.split_whitespace().next().unwrap_or_default();
            if first.eq_ignore_ascii_case("list") || name.contains('%') {
                return Err(LoadError {
                    code: "E0609",
                    message: "has its voxels in several files, which is not read".into(),
                    hint: Some("join them into one file: `unu save -f nrrd -i in.nhdr -o out.nrrd`".into()),
                });
            }
            let data = path.parent().unwrap_or(Path::new("")).join(name);
            let input = files.open(&data).map_err(|e| LoadError {
                message: format!("has its voxels in `{}`, which {}", data.display(), e.message),
                ..e
            })?;
            (input, 0)
        }
    };

    let offset = skip_lines(&mut input, offset, fields.integer("lineskip")?.unwrap_or(0))?;
    let (_, bytes) = body::extent(&header)?;
    let skip = match fields.integer("byteskip")?.unwrap_or(0) {
        // The voxels are the last bytes of the file, whatever stands before them.
        -1 if encoding == Encoding::Raw => input.length().saturating_sub(offset).saturating_sub(bytes),
        n => u64::try_from(n).map_err(|_| match n {
            -1 => broken("has `byte skip: -1`, which is for raw voxels only"),
            _ => broken(format!("has `byte skip: {n}`")),
        })?,
    };
    let body = Body::new(input, offset, encoding, skip, &header, big_endian)?;
    Ok(Opened { header, body, warnings })
}

fn grid(fields: &Fields, warnings: &mut Vec<LoadWarning>) -> Result<GridHeader, LoadError> {
    let scalar = scalar(fields.required("type")?)?;
    let (dims, world_from_index) = geometry::read(fields, warnings)?;
    super::affine::check(&world_from_index)?;
    Ok(GridHeader { dims, scalar, slope: 1.0, intercept: 0.0, world_from_index })
}

/// All spellings of the format's definition.
fn scalar(name: &str) -> Result<Scalar, LoadError> {
    let plain = name.split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase();
    Ok(match plain.as_str() {
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Scalar::U8,
        "signed char" | "char" | "int8" | "int8_t" => Scalar::I8,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Scalar::U16,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Scalar::I16,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Scalar::U32,
        "int" | "signed int" | "int32" | "int32_t" => Scalar::I32,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Scalar::U64,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Scalar::I64,
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        "block" => {
            return Err(LoadError {
                code: "E0605",
                message: "has opaque blocks for voxels, where a grid has one real number each".into(),
                hint: Some("convert it to a grid of 32-bit floating-point or integer numbers".into()),
            });
        }
        _ => return Err(broken(format!("has the sample type `{name}`, which NRRD does not define"))),
    })
}

fn encoding(fields: &Fields) -> Result<Encoding, LoadError> {
    let name = fields.required("encoding")?;
    match name.to_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "gzip" | "gz" => Ok(Encoding::Gzip),
        "ascii" | "text" | "txt" => Ok(Encoding::Text),
        "hex" => Ok(Encoding::Hex),
        "bzip2" | "bz2" | "zrl" => Err(LoadError {
            code: "E0609",
            message: format!("has the encoding `{name}`, which is not read"),
            hint: Some("pack it with gzip: `unu save -f nrrd -e gzip -i in.nrrd -o out.nrrd`".into()),
        }),
        _ => Err(broken(format!("has the encoding `{name}`, which NRRD does not define"))),
    }
}

fn big_endian(fields: &Fields, encoding: Encoding, scalar: Scalar) -> Result<bool, LoadError> {
    match fields.get("endian").map(str::to_lowercase).as_deref() {
        Some("little") => Ok(false),
        Some("big") => Ok(true),
        Some(other) => Err(broken(format!("has `endian: {other}`, which is neither little nor big"))),
        None if scalar.bytes() == 1 || encoding == Encoding::Text => Ok(false),
        None => Err(LoadError {
            code: "E0603",
            message: "does not say the order of the bytes in a voxel".into(),
            hint: Some("add the line `endian: little` (or `big`) to its header".into()),
        }),
    }
}

/// Where the line after the next `lines` lines starts.
fn skip_lines(input: &mut Input, offset: u64, lines: i64) -> Result<u64, LoadError> {
    let lines = u64::try_from(lines).map_err(|_| broken(format!("has `line skip: {lines}`")))?;
    if lines == 0 {
        return Ok(offset);
    }
    let mut reader = input.reader()?;
    reader.seek(SeekFrom::Start(offset)).map_err(|e| unreadable(&e))?;
    let (mut at, mut left) = (offset, lines);
    while left > 0 {
        // Not `read_until`, which would gather a whole line in memory, however long.
        let buffer = reader.fill_buf().map_err(|e| unreadable(&e))?;
        if buffer.is_empty() {
            return Err(broken(format!("asks to skip {lines} lines, more than there are")));
        }
        let used = match buffer.iter().position(|b| *b == b'\n') {
            Some(end) => {
                left -= 1;
                end + 1
            }
            None => buffer.len(),
        };
        at += used as u64;
        reader.consume(used);
    }
    Ok(at)
}
