//! Readers of files of 3D Gaussian splats (Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering",
//! 2023): the PLY files of the authors' code, and SPZ of Niantic, versions 2 and 3.
//!
//! # Conventions
//! - Coordinates are **metres** and axes are taken as they stand: neither format has a unit. SPZ says that y is up; PLY files
//!   keep the axes of whatever found the cameras, often with y down.
//! - A splat has a centre, a rotation (a unit quaternion w, x, y, z), three standard deviations along the axes that it rotates,
//!   an opacity of 0 to 1, and spherical harmonics of degree 0 to 3 for each of red, green and blue, sRGB-encoded as they
//!   were fitted. PLY stores logarithms of deviations and logits of opacities; both are undone here.
//! - Splats with a number that is not finite, and those whose quaternion is zero, are left out, counted and reported as a
//!   [`LoadWarning`]. A deviation of 0 is kept: a disc, a needle, a point.
//! - Harmonics of degree 4, which SPZ may have, are left out and told.
//!
//! # Memory
//! 44 + 12·(degree + 1)² bytes a splat, all numbers of 32 bits: 56 bytes at degree 0, 236 at degree 3. While an SPZ file is read,
//! its decompressed bytes, 19 to 92 a splat, are held as well.
//!
//! The same trust as for volumes: no header is believed about sizes, and no input makes the readers panic.

mod harmonics;
mod ply;
mod spz;
#[cfg(test)]
mod tests;

pub use harmonics::{color, harmonics};

use super::body::GZIP_MAGIC;
use super::input::{Disk, Files};
use super::{Codes, LoadWarning, has_ending, named};
use compiler::diagnostic::Severity;
use compiler::loader::{LoadError, SplatsHeader};
use std::path::Path;

/// A file that breaks its format, and one that ends early.
const CODES: Codes = Codes { broken: "E0661", truncated: "E0662" };

/// The most splats that are read; memory ends earlier.
pub const MAX_SPLATS: usize = 1 << 26;

/// The highest degree of spherical harmonics.
pub const MAX_DEGREE: u8 = 3;

/// Splats in metres, in the order of their file. At least one; all numbers are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Splats {
    degree: u8,
    antialiased: bool,
    unit: f64,
    centers: Vec<[f32; 3]>,
    rotations: Vec<[f32; 4]>,
    deviations: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    harmonics: Vec<f32>,
}

impl Splats {
    /// Leaves out what cannot be drawn, and counts it.
    ///
    /// # Errors
    /// `E0663` when nothing remains, `E0664` when there are more than [`MAX_SPLATS`].
    ///
    /// # Panics
    /// If a splat has fewer harmonics than the degree needs.
    pub fn new<'a>(
        degree: u8,
        antialiased: bool,
        gaussians: impl IntoIterator<Item = Gaussian<'a>>,
    ) -> Result<(Self, Vec<LoadWarning>), LoadError> {
        let mut builder = Builder::new(degree, antialiased);
        gaussians.into_iter().try_for_each(|g| builder.push(&g))?;
        builder.finish()
    }

    /// How many there are.
    #[expect(clippy::len_without_is_empty, reason = "there is at least one")]
    #[must_use]
    pub fn len(&self) -> usize {
        self.centers.len()
    }

    /// Degree of the spherical harmonics, 0 to 3.
    #[must_use]
    pub fn degree(&self) -> u8 {
        self.degree
    }

    /// Whether they were fitted with a low-pass that keeps their light (Yu et al., "Mip-Splatting", 2024).
    #[must_use]
    pub fn antialiased(&self) -> bool {
        self.antialiased
    }

    /// What their file calls 1, in metres.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// The same as if every length of the file were so many times as large.
    ///
    /// # Errors
    /// `E0663` when nothing remains that 32-bit numbers hold.
    pub fn stretched(&self, factor: f64) -> Result<(Self, Vec<LoadWarning>), LoadError> {
        let mut builder = Builder::new(self.degree, self.antialiased);
        for i in 0..self.len() {
            let harmonics: Vec<f64> = self.harmonics(i).iter().copied().map(f64::from).collect();
            builder.push(&Gaussian {
                center: self.centers[i].map(|x| f64::from(x) * factor),
                rotation: self.rotations[i].map(f64::from),
                deviations: self.deviations[i].map(|x| f64::from(x) * factor),
                opacity: f64::from(self.opacities[i]),
                harmonics: &harmonics,
            })?;
        }
        let (splats, warnings) = builder.finish()?;
        Ok((Self { unit: self.unit * factor, ..splats }, warnings))
    }

    /// Centres, in metres.
    #[must_use]
    pub fn centers(&self) -> &[[f32; 3]] {
        &self.centers
    }

    /// Unit quaternions w, x, y, z.
    #[must_use]
    pub fn rotations(&self) -> &[[f32; 4]] {
        &self.rotations
    }

    /// Standard deviations along the rotated axes, in metres; 0 or larger.
    #[must_use]
    pub fn deviations(&self) -> &[[f32; 3]] {
        &self.deviations
    }

    /// 0 to 1.
    #[must_use]
    pub fn opacities(&self) -> &[f32] {
        &self.opacities
    }

    /// Coefficients of one splat: (degree + 1)² times red, green, blue, in the order of (l, m) with m from −l to l.
    ///
    /// # Panics
    /// If there is no splat of this number.
    #[must_use]
    pub fn harmonics(&self, splat: usize) -> &[f32] {
        let n = 3 * coefficients(self.degree);
        &self.harmonics[splat * n..(splat + 1) * n]
    }

    /// Bytes that a splat takes in memory.
    #[must_use]
    pub fn bytes_per_splat(&self) -> usize {
        44 + 12 * coefficients(self.degree)
    }

    /// What the compiler is told.
    #[must_use]
    pub fn header(&self) -> SplatsHeader {
        let mut header = SplatsHeader {
            count: self.len() as u32,
            degree: self.degree,
            bounds: ([0.0; 3], [0.0; 3]),
            core: ([0.0; 3], [0.0; 3]),
        };
        let mut line = vec![];
        for axis in 0..3 {
            line.clear();
            line.extend(self.centers.iter().map(|c| c[axis]));
            // The middle 98 %: what was fitted to a photograph has a few splats very far away.
            let apart = line.len() / 100;
            let mut nth = |n: usize| f64::from(*line.select_nth_unstable_by(n, f32::total_cmp).1);
            let last = self.len() - 1;
            (header.bounds.0[axis], header.bounds.1[axis]) = (nth(0), nth(last));
            (header.core.0[axis], header.core.1[axis]) = (nth(apart), nth(last - apart));
        }
        header
    }
}

/// Coefficients of one colour.
const fn coefficients(degree: u8) -> usize {
    (degree as usize + 1) * (degree as usize + 1)
}

/// Reads a file of splats.
///
/// # Errors
/// `E0601` when there is no such file, `E0660` to `E0665` when it holds no splats, is broken, cut off, has none that could be
/// seen, too many, or is of a version that is not read.
pub fn read_splats(path: &Path) -> Result<(Splats, Vec<LoadWarning>), LoadError> {
    read_splats_from(&Disk, path)
}

/// [`read_splats`] from any set of files.
///
/// # Errors
/// As [`read_splats`].
pub fn read_splats_from(files: &dyn Files, path: &Path) -> Result<(Splats, Vec<LoadWarning>), LoadError> {
    read(files, path).and_then(Builder::finish).map_err(|e| named(path, e))
}

/// What kind of file it is decides its content; the ending matters only for the wording of errors.
fn read(files: &dyn Files, path: &Path) -> Result<Builder, LoadError> {
    let mut input = files.open(path)?;
    let head = input.peek(4)?;
    if head.is_empty() {
        return Err(broken("is empty"));
    }
    let length = input.length();
    if head.starts_with(b"ply") && head.get(3).is_none_or(u8::is_ascii_whitespace) {
        return ply::read(input.into_reader(0)?, length);
    }
    if head.starts_with(&GZIP_MAGIC) {
        return spz::read(input.into_reader(0)?, length);
    }
    if head.starts_with(&spz::MAGIC) {
        return Err(spz::version(4));
    }
    if has_ending(path, &["ply"]) {
        return Err(broken("does not start with `ply`"));
    }
    if has_ending(path, &["spz"]) {
        return Err(broken("is not compressed with gzip, as SPZ files are"));
    }
    Err(no_splats("is not a file of splats of a known kind", "use the PLY files of 3D Gaussian splatting, or SPZ"))
}

/// `E0660`: another kind of file.
fn no_splats(message: impl Into<String>, hint: &str) -> LoadError {
    LoadError { code: "E0660", message: message.into(), hint: Some(hint.into()) }
}

/// `E0661`: the file breaks its format.
fn broken(message: impl Into<String>) -> LoadError {
    CODES.broken(message)
}

/// `E0664`.
fn too_many() -> LoadError {
    LoadError {
        code: "E0664",
        message: format!("has more than {MAX_SPLATS} splats"),
        hint: Some("prune it first".into()),
    }
}

/// One splat.
#[derive(Copy, Clone, Debug)]
pub struct Gaussian<'a> {
    /// Metres.
    pub center: [f64; 3],
    /// A quaternion w, x, y, z of any length but zero.
    pub rotation: [f64; 4],
    /// Standard deviations along the rotated axes, in metres.
    pub deviations: [f64; 3],
    /// 0 to 1.
    pub opacity: f64,
    /// As [`Splats::harmonics`]; more than those of the degree are ignored.
    pub harmonics: &'a [f64],
}

/// Splats so far, and what was left out.
#[derive(Clone, Debug)]
struct Builder {
    splats: Splats,
    seen: usize,
    wild: usize,
    turned: usize,
    first: Option<usize>,
    warnings: Vec<LoadWarning>,
}

impl Builder {
    /// Harmonics of higher degree than are kept are told.
    fn new(degree: u8, antialiased: bool) -> Self {
        let splats = Splats {
            degree: degree.min(MAX_DEGREE),
            antialiased,
            unit: 1.0,
            centers: vec![],
            rotations: vec![],
            deviations: vec![],
            opacities: vec![],
            harmonics: vec![],
        };
        let mut warnings = vec![];
        if degree > MAX_DEGREE {
            warnings.push(LoadWarning {
                code: "W0661",
                severity: Severity::Warning,
                message: format!("has spherical harmonics of degree {degree}; those above {MAX_DEGREE} are left out"),
                hint: None,
            });
        }
        Self { splats, seen: 0, wild: 0, turned: 0, first: None, warnings }
    }

    fn push(&mut self, raw: &Gaussian<'_>) -> Result<(), LoadError> {
        if self.seen >= MAX_SPLATS {
            return Err(too_many());
        }
        self.seen += 1;
        let out = &mut self.splats;
        let kept = &raw.harmonics[..3 * coefficients(out.degree)];
        let center = raw.center.map(|x| x as f32);
        let deviations = raw.deviations.map(|x| x as f32);
        // Harmonics beyond what 32 bits hold become infinite, too.
        let finite = |x: &f32| x.is_finite();
        let whole = center.iter().chain(&deviations).all(finite)
            && raw.opacity.is_finite()
            && raw.rotation.iter().all(|x| x.is_finite())
            && kept.iter().all(|x| (*x as f32).is_finite());
        // Divided by the largest first, so that no square overflows or vanishes.
        let largest = raw.rotation.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        if !whole || largest == 0.0 {
            *(if whole { &mut self.turned } else { &mut self.wild }) += 1;
            self.first.get_or_insert(self.seen);
            return Ok(());
        }
        let q = raw.rotation.map(|x| x / largest);
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        out.centers.push(center);
        out.rotations.push(q.map(|x| (x / norm) as f32));
        out.deviations.push(deviations);
        out.opacities.push(raw.opacity.clamp(0.0, 1.0) as f32);
        out.harmonics.extend(kept.iter().map(|x| *x as f32));
        Ok(())
    }

    /// # Errors
    /// `E0663` when nothing remains.
    fn finish(mut self) -> Result<(Splats, Vec<LoadWarning>), LoadError> {
        let mut parts = vec![];
        for (count, one, many) in [
            (self.wild, "1 splat has a number that is not finite", "splats have a number that is not finite"),
            (self.turned, "1 splat has a rotation of zero", "splats have a rotation of zero"),
        ] {
            match count {
                0 => {}
                1 => parts.push(one.to_owned()),
                n => parts.push(format!("{n} {many}")),
            }
        }
        if self.splats.centers.is_empty() {
            let why = if parts.is_empty() { String::new() } else { format!(": {}", parts.join(", ")) };
            return Err(LoadError {
                code: "E0663",
                message: format!("has no splat that could be seen{why}"),
                hint: Some("export it again".into()),
            });
        }
        if let Some(first) = self.first {
            self.warnings.push(LoadWarning {
                code: "W0660",
                severity: Severity::Warning,
                message: format!("{}; left out, the first is splat {first}", parts.join(" and ")),
                hint: Some("clean it in the program that made it".into()),
            });
        }
        Ok((self.splats, self.warnings))
    }
}
