//! SPZ, versions 2 and 3: one gzip stream of a header of 16 bytes and then, for all splats together, positions (three
//! fixed-point numbers of 24 bits), opacities, colours, logarithms of deviations, rotations and spherical harmonics, one byte
//! a number but for rotations. Little-endian throughout.

use super::{Builder, CODES, Gaussian, MAX_SPLATS, broken, coefficients, too_many};
use crate::data::LoadWarning;
use crate::data::body::{Gzip, MAX_DEFLATE};
use crate::data::input::unreadable;
use compiler::diagnostic::Severity;
use compiler::loader::LoadError;
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::{self, BufRead, Read};

/// `NGSP`
pub(super) const MAGIC: [u8; 4] = *b"NGSP";

/// Flags of the header.
const ANTIALIASED: u8 = 1;
const EXTENDED: u8 = 2;

/// `E0665`
pub(super) fn version(number: u32) -> LoadError {
    LoadError {
        code: "E0665",
        message: format!("is of version {number} of SPZ"),
        hint: Some("versions 2 and 3 are read: save it as one of these, or as PLY".into()),
    }
}

fn stopped(error: &io::Error) -> LoadError {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => CODES.truncated("ends inside its compressed data"),
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => broken(format!("cannot be decompressed: {error}")),
        _ => unreadable(error),
    }
}

/// The next `bytes` bytes; memory grows with what arrives.
fn block(reader: &mut impl Read, bytes: u64, what: &str) -> Result<Vec<u8>, LoadError> {
    let mut out = vec![];
    reader.take(bytes).read_to_end(&mut out).map_err(|e| stopped(&e))?;
    if (out.len() as u64) < bytes {
        let message = format!("ends inside its {what}: {bytes} bytes are promised, {} are there", out.len());
        return Err(CODES.truncated(message));
    }
    Ok(out)
}

/// `length` is that of the whole file in bytes.
pub(super) fn read(reader: impl BufRead, length: u64) -> Result<Builder, LoadError> {
    let mut stream = Gzip::new(reader);
    let header = block(&mut stream, 16, "header")?;
    let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    if header[..4] != MAGIC {
        return Err(broken("does not start as SPZ files do"));
    }
    let (format, count) = (word(4), word(8));
    let (degree, fraction, flags) = (header[12], header[13], header[14]);
    if !(2..=3).contains(&format) {
        return Err(version(format));
    }
    if degree > 4 {
        return Err(broken(format!("has spherical harmonics of degree {degree}, and there are none above 4")));
    }
    if fraction > 30 {
        return Err(broken(format!("has positions with {fraction} bits behind the point")));
    }
    if count as usize > MAX_SPLATS {
        return Err(too_many());
    }
    let n = u64::from(count);
    let (turn, above) = (if format == 3 { 4 } else { 3 }, 3 * (coefficients(degree) - 1));
    let promised = n * (16 + turn + above as u64);
    if promised / MAX_DEFLATE > length {
        let message = format!("promises {n} splats, {promised} bytes, which its {length} bytes cannot hold");
        return Err(CODES.truncated(message));
    }
    let centers = block(&mut stream, 9 * n, "positions")?;
    let opacities = block(&mut stream, n, "opacities")?;
    let colors = block(&mut stream, 3 * n, "colours")?;
    let deviations = block(&mut stream, 3 * n, "scales")?;
    let rotations = block(&mut stream, turn * n, "rotations")?;
    let rest = block(&mut stream, above as u64 * n, "spherical harmonics")?;
    // To its end, where the checksum is; extensions of the format lie there, too.
    io::copy(&mut stream.take(1 << 20), &mut io::sink()).map_err(|e| stopped(&e))?;
    let mut builder = Builder::new(degree, flags & ANTIALIASED != 0);
    if flags & EXTENDED != 0 {
        builder.warnings.push(LoadWarning {
            code: "W0661",
            severity: Severity::Warning,
            message: "has extensions, which are not read".into(),
            hint: Some("if it looks wrong, save it without extensions".into()),
        });
    }
    let unit = 0.5_f64.powi(i32::from(fraction));
    let mut harmonics = vec![0.0; above + 3];
    for i in 0..count as usize {
        for (slot, byte) in harmonics[..3].iter_mut().zip(&colors[3 * i..]) {
            *slot = (f64::from(*byte) / 255.0 - 0.5) / 0.15;
        }
        for (slot, byte) in harmonics[3..].iter_mut().zip(&rest[above * i..]) {
            *slot = (f64::from(*byte) - 128.0) / 128.0;
        }
        let q = &rotations[turn as usize * i..];
        builder.push(&Gaussian {
            center: std::array::from_fn(|axis| {
                let b = &centers[9 * i + 3 * axis..];
                // The sign bit is the highest of three bytes.
                f64::from(i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8) * unit
            }),
            rotation: if format == 3 {
                smallest_three([q[0], q[1], q[2], q[3]])
            } else {
                first_three([q[0], q[1], q[2]])
            },
            deviations: std::array::from_fn(|axis| (f64::from(deviations[3 * i + axis]) / 16.0 - 10.0).exp()),
            opacity: f64::from(opacities[i]) / 255.0,
            harmonics: &harmonics,
        })?;
    }
    Ok(builder)
}

/// x, y, z as bytes around 127.5; w is what is missing to a unit quaternion, never negative.
fn first_three(bytes: [u8; 3]) -> [f64; 4] {
    let [x, y, z] = bytes.map(|b| f64::from(b) / 127.5 - 1.0);
    [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z]
}

/// The number of the largest of x, y, z, w in two bits, then the others in order, each a sign and nine bits of √½; the
/// largest is what is missing to a unit quaternion.
fn smallest_three(bytes: [u8; 4]) -> [f64; 4] {
    let mut bits = u32::from_le_bytes(bytes);
    let largest = (bits >> 30) as usize;
    let mut q = [0.0; 4];
    for i in (0..4).rev().filter(|i| *i != largest) {
        let size = f64::from(bits & 0x1ff) / 511.0 * FRAC_1_SQRT_2;
        q[i] = if bits & 0x200 == 0 { size } else { -size };
        bits >>= 10;
    }
    q[largest] = (1.0 - q.iter().map(|x| x * x).sum::<f64>()).max(0.0).sqrt();
    let [x, y, z, w] = q;
    [w, x, y, z]
}
