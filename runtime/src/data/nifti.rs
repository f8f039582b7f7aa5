//! NIfTI-1 and NIfTI-2.
//!
//! Our own reader: the crate `nifti` knows version 1 alone, and a second reader for version 2 beside it would share
//! nothing with it but the checks, which are the larger part of this file.
//!
//! After the definitions in `nifti1.h` and `nifti2.h`. The map to world space is the sform where there is one, else the
//! qform, else the bare spacing with voxel (0,0,0) at the origin (`nifti1.h`, "method 1").

use super::affine::{self, Unit};
use super::body::{self, Body, Encoding, Gzip};
use super::input::{Files, Input};
use super::{Opened, broken, has_ending};
use compiler::loader::{GridHeader, LoadError, Scalar};
use std::io::Read;
use std::path::{Path, PathBuf};

const SIZE_1: usize = 348;
const SIZE_2: usize = 540;

/// Whether the file starts with the size of a NIfTI (or ANALYZE) header.
pub(super) fn recognises(first: &[u8]) -> bool {
    version(first).is_some()
}

/// Version and whether the bytes are big-endian.
fn version(first: &[u8]) -> Option<(u8, bool)> {
    let size: [u8; 4] = first.get(..4)?.try_into().ok()?;
    let sizes = [(SIZE_1 as u32, 1), (SIZE_2 as u32, 2)];
    sizes.into_iter().find_map(|(expected, version)| {
        if u32::from_le_bytes(size) == expected {
            Some((version, false))
        } else if u32::from_be_bytes(size) == expected {
            Some((version, true))
        } else {
            None
        }
    })
}

/// The name of the other half of a pair: `a.hdr` and `a.img`, `a.hdr.gz` and `a.img.gz`.
pub(super) fn partner(path: &Path, ending: &str) -> PathBuf {
    if has_ending(path, &["gz"]) {
        path.with_extension("").with_extension(format!("{ending}.gz"))
    } else {
        path.with_extension(ending)
    }
}

/// Parses the header and finds the voxels.
pub(super) fn open(files: &dyn Files, path: &Path, mut input: Input, compressed: bool) -> Result<Opened, LoadError> {
    let bytes = if compressed {
        let mut bytes = Vec::new();
        let stream = Gzip::new(input.reader()?);
        stream.take(SIZE_2 as u64).read_to_end(&mut bytes).map_err(|e| body::decode_error(&e))?;
        bytes
    } else {
        input.peek(SIZE_2 as u64)?
    };
    let raw = RawHeader::parse(&bytes)?;
    let header = raw.header()?;
    let (input, compressed) = if raw.single_file {
        (input, compressed)
    } else {
        let partner = partner(path, "img");
        let mut image = files.open(&partner).map_err(|e| LoadError {
            message: format!("has its voxels in `{}`, which {}", partner.display(), e.message),
            hint: Some("keep header and voxels side by side under one name".into()),
            ..e
        })?;
        let compressed = image.peek(2)? == body::GZIP_MAGIC;
        (image, compressed)
    };
    let encoding = if compressed { Encoding::Gzip } else { Encoding::Raw };
    let body = Body::new(input, 0, encoding, raw.voxel_offset()?, &header, raw.big_endian)?;
    Ok(Opened { header, body, warnings: vec![] })
}

/// The fields that matter, of either version, widened.
struct RawHeader {
    version: u8,
    big_endian: bool,
    single_file: bool,
    datatype: i16,
    dims: [i64; 8],
    pixdim: [f64; 8],
    voxel_offset: f64,
    slope: f64,
    intercept: f64,
    units: i32,
    qform_code: i32,
    sform_code: i32,
    quaternion: [f64; 3],
    qoffset: [f64; 3],
    sform: [[f64; 4]; 3],
}

/// Numbers at fixed places in either byte order.
struct Fields<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl Fields<'_> {
    fn at<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut number = [0; N];
        number.copy_from_slice(&self.bytes[at..at + N]);
        if self.big_endian {
            number.reverse();
        }
        number
    }
    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.at(at))
    }
    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.at(at))
    }
    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.at(at))
    }
    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.at(at)))
    }
    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.at(at))
    }
}

impl RawHeader {
    fn parse(bytes: &[u8]) -> Result<Self, LoadError> {
        let Some((version, big_endian)) = version(bytes) else {
            return Err(broken("does not start with a NIfTI header"));
        };
        let size = if version == 1 { SIZE_1 } else { SIZE_2 };
        if bytes.len() < size {
            return Err(broken(format!("ends inside its header: {} of {size} bytes", bytes.len())));
        }
        let f = Fields { bytes, big_endian };
        let single_file = match (version, if version == 1 { &bytes[344..348] } else { &bytes[4..12] }) {
            (1, b"n+1\0") | (2, b"n+2\0\r\n\x1a\n") => true,
            (1, b"ni1\0") | (2, b"ni2\0\r\n\x1a\n") => false,
            (1, [0, ..]) => {
                return Err(LoadError {
                    code: "E0602",
                    message: "has an ANALYZE 7.5 header, which does not say how the data lies in space".into(),
                    hint: Some("convert it to NIfTI".into()),
                });
            }
            (_, magic) => {
                return Err(broken(format!("has the magic number `{}`, which is none of NIfTI", magic.escape_ascii())));
            }
        };
        Ok(if version == 1 {
            Self {
                version,
                big_endian,
                single_file,
                datatype: f.i16(70),
                dims: std::array::from_fn(|n| i64::from(f.i16(40 + 2 * n))),
                pixdim: std::array::from_fn(|n| f.f32(76 + 4 * n)),
                voxel_offset: f.f32(108),
                slope: f.f32(112),
                intercept: f.f32(116),
                units: i32::from(bytes[123]),
                qform_code: i32::from(f.i16(252)),
                sform_code: i32::from(f.i16(254)),
                quaternion: std::array::from_fn(|n| f.f32(256 + 4 * n)),
                qoffset: std::array::from_fn(|n| f.f32(268 + 4 * n)),
                sform: std::array::from_fn(|r| std::array::from_fn(|c| f.f32(280 + 16 * r + 4 * c))),
            }
        } else {
            Self {
                version,
                big_endian,
                single_file,
                datatype: f.i16(12),
                dims: std::array::from_fn(|n| f.i64(16 + 8 * n)),
                pixdim: std::array::from_fn(|n| f.f64(104 + 8 * n)),
                // Exact: offsets past 2⁵³ are refused anyway, the file is not that long.
                voxel_offset: f.i64(168) as f64,
                slope: f.f64(176),
                intercept: f.f64(184),
                units: f.i32(500),
                qform_code: f.i32(344),
                sform_code: f.i32(348),
                quaternion: std::array::from_fn(|n| f.f64(352 + 8 * n)),
                qoffset: std::array::from_fn(|n| f.f64(376 + 8 * n)),
                sform: std::array::from_fn(|r| std::array::from_fn(|c| f.f64(400 + 32 * r + 8 * c))),
            }
        })
    }

    fn header(&self) -> Result<GridHeader, LoadError> {
        let dims = self.dims()?;
        let scalar = self.scalar()?;
        let (slope, intercept) = self.scaling()?;
        let world_from_index = self.map(dims)?;
        affine::check(&world_from_index)?;
        Ok(GridHeader { dims, scalar, slope, intercept, world_from_index })
    }

    fn dims(&self) -> Result<[u32; 3], LoadError> {
        let axes = self.dims[0];
        if !(1..=7).contains(&axes) {
            return Err(broken(format!("has {axes} axes where NIfTI has 1 to 7")));
        }
        let mut sizes = [1_i64; 7];
        for (axis, size) in sizes.iter_mut().enumerate().take(axes as usize) {
            *size = self.dims[axis + 1];
            if *size < 1 {
                return Err(broken(format!("has {size} samples along its axis {axis}")));
            }
        }
        if let Some(n) = sizes[3..].iter().position(|n| *n > 1) {
            let (what, one) = if n == 0 { ("time steps", "time step") } else { ("values a voxel", "of them") };
            return Err(LoadError {
                code: "E0606",
                message: format!("holds {} {what}, where a grid has one", sizes[3 + n]),
                hint: Some(format!("extract one {one} first, for example with `fslroi`")),
            });
        }
        let too_many = |n: i64| LoadError {
            code: "E0608",
            message: format!("has {n} samples along one axis"),
            hint: Some("cut it or halve its resolution first".into()),
        };
        let mut dims = [1; 3];
        for (dim, size) in dims.iter_mut().zip(sizes) {
            *dim = u32::try_from(size).map_err(|_| too_many(size))?;
        }
        Ok(dims)
    }

    fn scalar(&self) -> Result<Scalar, LoadError> {
        let name = match self.datatype {
            2 => return Ok(Scalar::U8),
            256 => return Ok(Scalar::I8),
            512 => return Ok(Scalar::U16),
            4 => return Ok(Scalar::I16),
            768 => return Ok(Scalar::U32),
            8 => return Ok(Scalar::I32),
            1280 => return Ok(Scalar::U64),
            1024 => return Ok(Scalar::I64),
            16 => return Ok(Scalar::F32),
            64 => return Ok(Scalar::F64),
            1 => "single bits",
            32 | 1792 | 2048 => "complex numbers",
            128 | 2304 => "RGB colours",
            1536 => "128-bit floating-point numbers",
            n => return Err(broken(format!("has the sample type {n}, which NIfTI does not define"))),
        };
        Err(LoadError {
            code: "E0605",
            message: format!("has {name} for voxels, where a grid has one real number each"),
            hint: Some("convert it to a grid of 32-bit floating-point or integer numbers".into()),
        })
    }

    fn scaling(&self) -> Result<(f64, f64), LoadError> {
        if self.slope == 0.0 || !self.slope.is_finite() {
            return Ok((1.0, 0.0));
        }
        if !self.intercept.is_finite() {
            return Err(broken(format!("scales its values with the intercept {}", self.intercept)));
        }
        Ok((self.slope, self.intercept))
    }

    /// Bytes before the first voxel.
    fn voxel_offset(&self) -> Result<u64, LoadError> {
        // The header and the four bytes that announce extensions.
        let least = match (self.single_file, self.version) {
            (false, _) => 0,
            (true, 1) => SIZE_1 as u64 + 4,
            (true, _) => SIZE_2 as u64 + 4,
        };
        let offset = self.voxel_offset;
        if !(offset >= 0.0 && offset < (1_u64 << 53) as f64) {
            return Err(broken(format!("has its voxels start at byte {offset}")));
        }
        Ok((offset as u64).max(least))
    }

    /// The map from voxel index to world space in metres.
    fn map(&self, dims: [u32; 3]) -> Result<[[f64; 4]; 3], LoadError> {
        let unit = match self.units & 7 {
            1 => Unit::METRE,
            3 => Unit::MICROMETRE,
            // 2 is mm; 0 is unknown, and the rest is not defined.
            _ => Unit::MILLIMETRE,
        };
        let map = if self.sform_code > 0 {
            self.sform
        } else {
            let spacing = self.spacing(dims);
            let (rotation, origin) = if self.qform_code > 0 {
                (self.rotation()?, self.qoffset)
            } else {
                ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3])
            };
            // Column n of the rotation times the spacing of axis n.
            let steps = std::array::from_fn(|n| std::array::from_fn(|row| rotation[row][n] * spacing[n]));
            affine::from_columns(steps, origin)
        };
        Ok(map.map(|row| row.map(|x| unit.to_metres(x))))
    }

    /// Signed steps along the three axes, in the file's unit.
    fn spacing(&self, dims: [u32; 3]) -> [f64; 3] {
        let mut spacing: [f64; 3] = std::array::from_fn(|n| {
            let step = self.pixdim[n + 1].abs();
            // An axis that the file does not have has no spacing either; any will do for a single sample.
            if n as i64 >= self.dims[0] && dims[n] == 1 && !(step.is_finite() && step > 0.0) { 1.0 } else { step }
        });
        // "qfac": only the qform can mirror the third axis; the bare spacing of method 1 ignores it.
        if self.qform_code > 0 && self.pixdim[0] < 0.0 {
            spacing[2] = -spacing[2];
        }
        spacing
    }

    /// The rotation of the quaternion (a, b, c, d) of which the file keeps the last three.
    fn rotation(&self) -> Result<[[f64; 3]; 3], LoadError> {
        let [mut b, mut c, mut d] = self.quaternion;
        let squares = b * b + c * c + d * d;
        if !squares.is_finite() {
            return Err(LoadError {
                code: "E0607",
                message: format!("has the quaternion ({b}, {c}, {d}) for its orientation"),
                hint: Some("correct the orientation in the header".into()),
            });
        }
        // As nifti1_io does: f32 rounding, or a broken writer, can push the length past 1; then it is a half turn.
        let a = if 1.0 - squares < 1e-7 {
            let length = squares.sqrt();
            (b, c, d) = (b / length, c / length, d / length);
            0.0
        } else {
            (1.0 - squares).sqrt()
        };
        Ok([
            [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
            [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
            [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ])
    }
}
