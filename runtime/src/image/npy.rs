//! NumPy arrays.

use super::{ImageError, Picture, Written};
use npyz::{DType, WriterBuilder};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes the radiance as an array of height × width × bands, little-endian f32 in C order.
///
/// # Errors
/// `E0620`.
pub fn write_npy(path: &Path, picture: &Picture) -> Result<Written, ImageError> {
    let fail = |e: &dyn std::fmt::Display| ImageError::write_to(path, e);
    let shape = [u64::from(picture.height), u64::from(picture.width), picture.bands.wavelengths.len() as u64];
    let little_endian = "<f4".parse().map_err(|e| fail(&e))?;
    let mut file = BufWriter::new(File::create(path).map_err(|e| fail(&e))?);
    let mut writer = npyz::WriteOptions::new()
        .dtype(DType::Plain(little_endian))
        .shape(&shape)
        .writer(&mut file)
        .begin_nd()
        .map_err(|e| fail(&e))?;
    writer.extend(picture.radiance.iter().copied()).map_err(|e| fail(&e))?;
    writer.finish().map_err(|e| fail(&e))?;
    file.flush().map_err(|e| fail(&e))?;
    Ok(Written { nan: super::count_nan(picture) })
}
