//! Voxels at their own precision, and how bytes become voxels in place.

use super::body::{self, Stop};
use compiler::loader::Scalar;
use std::io::Read;

/// Samples as they are stored, x fastest, then y, then z; native byte order.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "the names are the types")]
pub enum Voxels {
    U8(Vec<u8>),
    I8(Vec<i8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    I32(Vec<i32>),
    U64(Vec<u64>),
    I64(Vec<i64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// Runs the same generic code on whichever vector is inside.
macro_rules! each {
    ($voxels:expr, $v:ident => $body:expr) => {
        match $voxels {
            Voxels::U8($v) => $body,
            Voxels::I8($v) => $body,
            Voxels::U16($v) => $body,
            Voxels::I16($v) => $body,
            Voxels::U32($v) => $body,
            Voxels::I32($v) => $body,
            Voxels::U64($v) => $body,
            Voxels::I64($v) => $body,
            Voxels::F32($v) => $body,
            Voxels::F64($v) => $body,
        }
    };
}
pub(super) use each;

/// Makes `Voxels` of a scalar type by a call that is generic in the type.
macro_rules! voxels_of {
    ($scalar:expr, $make:ident ( $($argument:expr),* )) => {
        match $scalar {
            Scalar::U8 => $make::<u8>($($argument),*).map(Voxels::U8),
            Scalar::I8 => $make::<i8>($($argument),*).map(Voxels::I8),
            Scalar::U16 => $make::<u16>($($argument),*).map(Voxels::U16),
            Scalar::I16 => $make::<i16>($($argument),*).map(Voxels::I16),
            Scalar::U32 => $make::<u32>($($argument),*).map(Voxels::U32),
            Scalar::I32 => $make::<i32>($($argument),*).map(Voxels::I32),
            Scalar::U64 => $make::<u64>($($argument),*).map(Voxels::U64),
            Scalar::I64 => $make::<i64>($($argument),*).map(Voxels::I64),
            Scalar::F32 => $make::<f32>($($argument),*).map(Voxels::F32),
            Scalar::F64 => $make::<f64>($($argument),*).map(Voxels::F64),
        }
    };
}

impl Voxels {
    /// How a sample is stored.
    #[must_use]
    pub fn scalar(&self) -> Scalar {
        match self {
            Self::U8(_) => Scalar::U8,
            Self::I8(_) => Scalar::I8,
            Self::U16(_) => Scalar::U16,
            Self::I16(_) => Scalar::I16,
            Self::U32(_) => Scalar::U32,
            Self::I32(_) => Scalar::I32,
            Self::U64(_) => Scalar::U64,
            Self::I64(_) => Scalar::I64,
            Self::F32(_) => Scalar::F32,
            Self::F64(_) => Scalar::F64,
        }
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        each!(self, v => v.len())
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The samples as bytes in native order, for upload.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        each!(self, v => bytemuck::cast_slice(v))
    }

    /// The stored number at a position in memory, as f64 (64-bit integers round beyond 2⁵³).
    ///
    /// # Panics
    /// Past the end, as a slice would.
    #[inline]
    #[must_use]
    pub fn get(&self, at: usize) -> f64 {
        each!(self, v => v[at].to_f64())
    }

    /// Bytes in memory that this takes, spare capacity included.
    #[cfg(test)]
    pub(super) fn allocated(&self) -> usize {
        each!(self, v => v.capacity()) * self.scalar().bytes()
    }
}

/// A type that a voxel can have.
pub(super) trait Sample: bytemuck::Pod + Send + Sync + std::str::FromStr {
    fn to_f64(self) -> f64;
    /// Denormal numbers of this very type.
    fn is_denormal(self) -> bool {
        false
    }
}

macro_rules! integers {
    ($($t:ty),*) => { $(impl Sample for $t {
        #[inline]
        fn to_f64(self) -> f64 {
            self as f64
        }
    })* };
}
integers!(u8, i8, u16, i16, u32, i32, u64, i64);

impl Sample for f32 {
    #[inline]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline]
    fn is_denormal(self) -> bool {
        self.is_subnormal()
    }
}

impl Sample for f64 {
    #[inline]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline]
    fn is_denormal(self) -> bool {
        self.is_subnormal()
    }
}

/// Reads `count` binary samples. `reserve` of them are allocated at once, the others as they arrive.
pub(super) fn read_binary(
    scalar: Scalar,
    reader: &mut dyn Read,
    count: usize,
    reserve: usize,
    swap: bool,
) -> Result<Voxels, Stop> {
    voxels_of!(scalar, fill(reader, count, reserve, swap))
}

/// Reads `count` samples written as decimal numbers.
pub(super) fn read_text(scalar: Scalar, reader: &mut dyn Read, count: usize) -> Result<Voxels, Stop> {
    voxels_of!(scalar, parse(reader, count))
}

/// Bytes that are asked of the reader at a time.
const CHUNK: usize = 1 << 20;

/// Makes room for `more` samples, doubling but never past `count`, and gives up instead of aborting without memory.
fn grow<T>(out: &mut Vec<T>, more: usize, count: usize) -> Result<(), Stop> {
    let needed = out.len() + more;
    if needed > out.capacity() {
        let target = count.min(needed.max(out.capacity().saturating_mul(2)));
        out.try_reserve_exact(target - out.len()).map_err(|_| Stop::NoMemory)?;
    }
    Ok(())
}

fn fill<T: Sample>(reader: &mut dyn Read, count: usize, reserve: usize, swap: bool) -> Result<Vec<T>, Stop> {
    let size = size_of::<T>();
    let mut out: Vec<T> = Vec::new();
    grow(&mut out, reserve.min(count), count)?;
    while out.len() < count {
        let start = out.len();
        let more = (count - start).min(CHUNK / size);
        grow(&mut out, more, count)?;
        out.resize(start + more, T::zeroed());
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut out[start..]);
        let arrived = body::read_full(reader, bytes).map_err(Stop::Io)?;
        if arrived < bytes.len() {
            return Err(Stop::Short { arrived: (start * size + arrived) as u64 });
        }
        if swap && size > 1 {
            bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
    }
    Ok(out)
}

/// Longest number that is taken seriously; f64 needs up to 770 digits to be written out in full.
const MAX_NUMBER: usize = 1024;

fn parse<T: Sample>(reader: &mut dyn Read, count: usize) -> Result<Vec<T>, Stop> {
    let mut out: Vec<T> = Vec::new();
    let mut word = Vec::new();
    let mut buffer = [0; 1 << 13];
    while out.len() < count {
        let n = body::read_full(reader, &mut buffer).map_err(Stop::Io)?;
        // A space after the last byte ends the last word.
        let end = if n == 0 { &b" "[..] } else { &buffer[..n] };
        for &byte in end {
            if !byte.is_ascii_whitespace() && byte != b',' {
                word.push(byte);
                if word.len() > MAX_NUMBER {
                    return Err(Stop::Number(String::from_utf8_lossy(&word[..16]).into_owned() + "…"));
                }
            } else if !word.is_empty() && out.len() < count {
                let text = String::from_utf8_lossy(&word);
                let number = text.parse().map_err(|_| Stop::Number(text.chars().take(32).collect()))?;
                grow(&mut out, 1, count)?;
                out.push(number);
                word.clear();
            }
        }
        if n == 0 && out.len() < count {
            return Err(Stop::Short { arrived: (out.len() * size_of::<T>()) as u64 });
        }
    }
    Ok(out)
}
