//! From radiance to files: the picture, its display transform, and writers for PNG, OpenEXR and NumPy.
//!
//! What is computed is linear radiance per band. Only PNG shows it: pixel = encode(tonemap(L / 1 lx · 2^exposure)),
//! see [`Display`]. EXR and NPY keep the radiance as it is.

mod display;
mod exr;
pub mod metric;
mod npy;
mod png;
#[cfg(test)]
mod tests;

pub use self::exr::write_exr;
pub use self::png::{SCENE_KEYWORD, png_bytes, read_png, read_png_scene, write_png};
pub use display::{Display, Shown, srgb_decode, srgb_encode};
pub use npy::write_npy;

use compiler::ir::{Bands, BandsKind, nanometres};
use std::path::Path;

/// Linear radiance of every pixel in every band, and optionally transmittance.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    width: u32,
    height: u32,
    bands: Bands,
    radiance: Vec<f32>,
    transmittance: Option<Vec<f32>>,
}

impl Picture {
    /// `radiance` in lx, and `transmittance`, are of height × width × bands, bands running fastest, then x; the first
    /// row is the top.
    ///
    /// # Errors
    /// `E0620` when the lengths do not fit, or there is no pixel or no band.
    pub fn new(
        size: [u32; 2],
        bands: Bands,
        radiance: Vec<f32>,
        transmittance: Option<Vec<f32>>,
    ) -> Result<Self, ImageError> {
        let [width, height] = size;
        let count = u128::from(width) * u128::from(height) * bands.wavelengths.len() as u128;
        let fits = |n: usize| n > 0 && n as u128 == count;
        if !fits(radiance.len()) || transmittance.as_ref().is_some_and(|t| !fits(t.len())) {
            return Err(ImageError::write(format!(
                "{width} × {height} pixels of {} bands cannot be made of {} numbers",
                bands.wavelengths.len(),
                radiance.len()
            )));
        }
        Ok(Self { width, height, bands, radiance, transmittance })
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// The bands of a pixel.
    #[must_use]
    pub fn bands(&self) -> &Bands {
        &self.bands
    }

    /// Radiance in lx; see [`Picture::new`] for the order.
    #[must_use]
    pub fn radiance(&self) -> &[f32] {
        &self.radiance
    }

    /// Transmittance in the order of the radiance, if it was kept.
    #[must_use]
    pub fn transmittance(&self) -> Option<&[f32]> {
        self.transmittance.as_deref()
    }

    /// The radiance of one pixel, a number per band.
    ///
    /// # Panics
    /// Outside of the picture.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> &[f32] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) is outside of {} × {}", self.width, self.height);
        let n = self.bands.wavelengths.len();
        let at = (y as usize * self.width as usize + x as usize) * n;
        &self.radiance[at..at + n]
    }

    /// `R`, `G`, `B`; `Y`; or `550nm`. A fraction is written with a comma (`562,5nm`), since a dot would make OpenEXR
    /// readers see a layer, as in the layout of Fichet et al. 2021 for spectral pictures.
    fn band_names(&self) -> Vec<String> {
        match self.bands.kind {
            BandsKind::Rgb => ["R", "G", "B"].map(String::from).to_vec(),
            BandsKind::Gray => vec!["Y".into()],
            BandsKind::List | BandsKind::Spectral => {
                self.bands.wavelengths.iter().map(|w| format!("{}nm", nanometres(*w).replace('.', ","))).collect()
            }
        }
    }
}

/// Bits of a PNG sample.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Default)]
pub enum Depth {
    /// 0 to 255.
    #[default]
    Eight,
    /// 0 to 65535.
    Sixteen,
}

/// What else a file holds besides the picture.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct WriteOptions {
    /// How a PNG shows the radiance.
    pub display: Display,
    /// Bits of a PNG sample.
    pub depth: Depth,
    /// The text of the scene, to be kept in PNG and EXR.
    pub scene: Option<String>,
}

/// What a writer noticed.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Default)]
pub struct Written {
    /// Pixels that were NaN. There should be none; PNG shows them in magenta.
    pub nan: usize,
}

/// Why a picture could not be written or read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageError {
    /// `E0620` to `E0622`.
    pub code: &'static str,
    /// One sentence.
    pub message: String,
    /// What to try, if there is something.
    pub hint: Option<String>,
}

impl ImageError {
    fn write(message: String) -> Self {
        Self { code: "E0620", message, hint: None }
    }

    fn write_to(path: &Path, error: &dyn std::fmt::Display) -> Self {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty() && !p.exists());
        let hint = folder.map(|p| format!("make the folder `{}` first", p.display()));
        Self { hint, ..Self::write(format!("`{}` cannot be written: {error}", path.display())) }
    }

    fn read(path: &Path, what: &str) -> Self {
        Self { code: "E0622", message: format!("`{}` {what}", path.display()), hint: None }
    }
}

/// Writes the picture in the format that the ending of `path` names: `.png`, `.exr` or `.npy`.
///
/// # Errors
/// `E0621` for another ending, `E0620` when the file cannot be written.
pub fn write(path: &Path, picture: &Picture, options: &WriteOptions) -> Result<Written, ImageError> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match ending.as_str() {
        "png" => write_png(path, picture, options),
        "exr" => write_exr(path, picture, options.scene.as_deref()),
        "npy" => write_npy(path, picture),
        _ => Err(ImageError {
            code: "E0621",
            message: format!("`{}` has an ending that no picture format has", path.display()),
            hint: Some("use .png (8 or 16 bits), .exr or .npy (linear radiance)".into()),
        }),
    }
}

/// Pixels with a NaN in any band.
fn count_nan(picture: &Picture) -> usize {
    let bands = picture.bands.wavelengths.len();
    picture.radiance.chunks_exact(bands).filter(|pixel| pixel.iter().any(|v| v.is_nan())).count()
}
