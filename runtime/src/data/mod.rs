//! Readers of volume files: NIfTI-1 and NIfTI-2 (`.nii`, `.nii.gz`, `.hdr` + `.img`) and NRRD (`.nrrd`, `.nhdr`); files of
//! triangles are in [`mesh`], files of 3D Gaussian splats in [`splats`].
//!
//! What kind of file it is decides its content; the ending matters only for the wording of errors.
//!
//! # Conventions
//! - World space is right-handed, in **metres**, and oriented as NIfTI has it: +x right, +y anterior, +z superior ("RAS+").
//!   NRRD spaces with another anatomical orientation (`left-posterior-superior`, …) are turned into it.
//! - A length without a unit, or with one that is not known, is in millimetres.
//! - Samples sit at whole-numbered voxel indices; axis 0 runs fastest in memory.
//! - A value is `slope · stored + intercept`, exactly as the header scales it, never normalised. A slope of 0, NaN or
//!   infinity means that there is no scaling. NRRD's `old min`/`old max` describe where values came from and change nothing.
//! - Voxels stay in memory at their own precision, once, decoded straight into place.
//! - Voxels that have no finite value (NaN, ±∞, and values that overflow when scaled) are **stored as 0**, so that their
//!   value is the intercept; denormal ones are stored as 0 too. Both are counted and reported as [`LoadWarning`]s.
//!   Negative values are legitimate (Hounsfield units) and kept; they are reported as a note.
//!
//! # Trust
//! Files are hostile until shown otherwise: every number of a header is checked, nothing is allocated on a header's word
//! alone (at most twice what has really arrived, plus a mebibyte), and no input makes the readers panic.

mod affine;
mod body;
mod input;
pub mod mesh;
mod nifti;
mod nrrd;
mod ply;
pub mod splats;
#[cfg(test)]
mod tests;
mod text;
mod volume;
mod voxels;

pub use input::{Disk, Files, Input, Memory};
pub use volume::Volume;
pub use voxels::Voxels;

use body::Body;
use compiler::diagnostic::{Diagnostic, Severity};
use compiler::loader::{GridHeader, LoadError};
use std::io::Read;
use std::path::Path;

/// The largest volume that is read: 16 GiB of voxels.
pub const MAX_BYTES: u64 = 16 << 30;

/// Something about a file that is worth telling and that did not stop it from loading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadWarning {
    /// A diagnostic code of the range `W06xx`.
    pub code: &'static str,
    /// [`Severity::Warning`] if data or units were changed or guessed, [`Severity::Note`] for a mere fact.
    pub severity: Severity,
    /// One sentence with the counts and the first place.
    pub message: String,
    /// What to try, if there is something.
    pub hint: Option<String>,
}

impl LoadWarning {
    /// The same as a diagnostic without a place; the caller knows which line of the scene named the file.
    #[must_use]
    pub fn to_diagnostic(&self) -> Diagnostic {
        let mut diagnostic = Diagnostic::warning(self.code, self.message.clone());
        diagnostic.severity = self.severity;
        match &self.hint {
            Some(hint) => diagnostic.hint(hint.clone()),
            None => diagnostic,
        }
    }
}

/// Reads what a volume file says about itself, and checks as much of it as is possible without reading voxels.
///
/// # Errors
/// `E0601` to `E0609`: no such file, unknown kind, broken or truncated header, sample type, number of axes, orientation,
/// size or encoding that cannot be used.
pub fn read_header(path: &Path) -> Result<GridHeader, LoadError> {
    read_header_from(&Disk, path)
}

/// [`read_header`] from any set of files.
///
/// # Errors
/// As [`read_header`].
pub fn read_header_from(files: &dyn Files, path: &Path) -> Result<GridHeader, LoadError> {
    open(files, path).map(|opened| opened.header).map_err(|e| named(path, e))
}

/// Reads a whole volume.
///
/// # Errors
/// As [`read_header`], and `E0604` or `E0610` where the voxels end early or cannot be decoded.
pub fn read_volume(path: &Path) -> Result<(Volume, Vec<LoadWarning>), LoadError> {
    read_volume_from(&Disk, path)
}

/// [`read_volume`] from any set of files.
///
/// # Errors
/// As [`read_volume`].
pub fn read_volume_from(files: &dyn Files, path: &Path) -> Result<(Volume, Vec<LoadWarning>), LoadError> {
    let read = || {
        let Opened { header, body, mut warnings } = open(files, path)?;
        let voxels = body.read(&header)?;
        let (volume, found) = Volume::new(header, voxels)?;
        warnings.extend(found);
        Ok((volume, warnings))
    };
    read().map_err(|e| named(path, e))
}

/// A file whose header has been read and checked.
struct Opened {
    header: GridHeader,
    body: Body,
    warnings: Vec<LoadWarning>,
}

/// Looks at the first bytes and lets the right reader parse the header.
fn open(files: &dyn Files, path: &Path) -> Result<Opened, LoadError> {
    // The picture half of a pair: its header has the same name.
    if has_ending(path, &["img", "img.gz"]) {
        return open(files, &nifti::partner(path, "hdr"));
    }
    let mut input = files.open(path)?;
    let head = input.peek(8)?;
    if head.is_empty() {
        return Err(broken("is empty"));
    }
    if head.starts_with(b"NRRD") {
        return nrrd::open(files, path, input);
    }
    let compressed = head.starts_with(&body::GZIP_MAGIC);
    let first = if compressed {
        let mut first = Vec::new();
        body::Gzip::new(input.reader()?).take(8).read_to_end(&mut first).map_err(|e| body::decode_error(&e))?;
        first
    } else {
        head
    };
    if nifti::recognises(&first) {
        return nifti::open(files, path, input, compressed);
    }
    if compressed && first.starts_with(b"NRRD") {
        return Err(LoadError {
            code: "E0602",
            message: "is a NRRD file compressed as a whole".into(),
            hint: Some("unpack it with gunzip; NRRD compresses inside the file, with `encoding: gzip`".into()),
        });
    }
    if has_ending(path, &["nii", "nii.gz", "hdr", "hdr.gz"]) {
        return Err(broken("does not start with a NIfTI header (its first number must be 348 or 540)"));
    }
    if has_ending(path, &["nrrd", "nhdr"]) {
        return Err(broken("does not start with `NRRD`"));
    }
    Err(LoadError {
        code: "E0602",
        message: "is not a volume file of a known kind".into(),
        hint: Some("use NIfTI (.nii, .nii.gz, .hdr + .img) or NRRD (.nrrd, .nhdr)".into()),
    })
}

/// Whether the file name ends in one of these, whatever their case.
fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    endings.iter().any(|e| name.strip_suffix(e).is_some_and(|stem| stem.ends_with('.')))
}

/// Under which codes a reader that others share reports.
#[derive(Copy, Clone, Debug)]
struct Codes {
    /// The file breaks its format.
    broken: &'static str,
    /// It ends early.
    truncated: &'static str,
}

impl Codes {
    fn broken(self, message: impl Into<String>) -> LoadError {
        LoadError { code: self.broken, message: message.into(), hint: None }
    }

    fn truncated(self, message: impl Into<String>) -> LoadError {
        LoadError {
            code: self.truncated,
            message: message.into(),
            hint: Some("the file is cut off, or its header is wrong: copy or export it again".into()),
        }
    }
}

/// `E0603`: the file breaks its format.
fn broken(message: impl Into<String>) -> LoadError {
    LoadError { code: "E0603", message: message.into(), hint: None }
}

/// Puts the path in front of the sentence.
fn named(path: &Path, error: LoadError) -> LoadError {
    LoadError { message: format!("`{}` {}", path.display(), error.message), ..error }
}
