//! A loaded volume: header, voxels, range of values. Voxels are made safe for every engine here, in one pass.

use super::voxels::{Sample, Voxels, each};
use super::{LoadWarning, affine, body, broken};
use compiler::analysis::interval::Pyramid;
use compiler::diagnostic::Severity;
use compiler::loader::{GridHeader, LoadError};
use rayon::prelude::*;

/// A grid of voxels with its place in the world. Every value is finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    header: GridHeader,
    voxels: Voxels,
    range: (f64, f64),
}

impl Volume {
    /// Joins a header and its voxels, replaces what is not finite or denormal by a stored 0, and counts it.
    ///
    /// # Errors
    /// `E0603` when counts, types or scaling do not fit each other, `E0607` for a map to world space without an inverse,
    /// `E0608` for more than [`super::MAX_BYTES`].
    pub fn new(header: GridHeader, mut voxels: Voxels) -> Result<(Self, Vec<LoadWarning>), LoadError> {
        let (count, _) = body::extent(&header)?;
        if count == 0 || voxels.len() != count || voxels.scalar() != header.scalar {
            let [x, y, z] = header.dims;
            return Err(broken(format!(
                "has {} voxels of type {:?} where its header has {x} × {y} × {z} of type {:?}",
                voxels.len(),
                voxels.scalar(),
                header.scalar
            )));
        }
        if !(header.slope.is_finite() && header.intercept.is_finite()) {
            return Err(broken(format!("scales its values by {} and {}", header.slope, header.intercept)));
        }
        affine::check(&header.world_from_index)?;
        let scan = each!(&mut voxels, v => scan(v, header.slope, header.intercept));
        let warnings = scan.warnings(&header);
        Ok((Self { header, voxels, range: (scan.low, scan.high) }, warnings))
    }

    /// Size, scaling and place in the world.
    #[must_use]
    pub fn header(&self) -> &GridHeader {
        &self.header
    }

    /// The samples as they are stored.
    #[must_use]
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }

    /// The samples as bytes in native order, x fastest, for upload to a GPU.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.voxels.bytes()
    }

    /// Least and greatest value, after scaling; found once at load.
    #[must_use]
    pub fn range(&self) -> (f64, f64) {
        self.range
    }

    /// The value at voxel (i, j, k): `slope · stored + intercept`.
    ///
    /// # Panics
    /// When the position lies past the end of the voxels; callers clamp to [`GridHeader::dims`].
    #[inline]
    #[must_use]
    pub fn value(&self, i: usize, j: usize, k: usize) -> f64 {
        let [nx, ny, nz] = self.header.dims.map(|n| n as usize);
        debug_assert!(i < nx && j < ny && k < nz, "voxel ({i}, {j}, {k}) is outside {nx} × {ny} × {nz}");
        self.voxels.get((k * ny + j) * nx + i) * self.header.slope + self.header.intercept
    }
}

/// How many voxels were of a kind, and the first of them in memory.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
struct Tally {
    count: usize,
    first: usize,
}

impl Tally {
    fn add(&mut self, at: usize) {
        if self.count == 0 {
            self.first = at;
        }
        self.count += 1;
    }

    /// `later` comes after `self` in memory.
    fn then(self, later: Self) -> Self {
        let first = if self.count > 0 { self.first } else { later.first };
        Self { count: self.count + later.count, first }
    }
}

#[derive(Copy, Clone, Debug, PartialEq)]
struct Scan {
    low: f64,
    high: f64,
    nan: Tally,
    infinite: Tally,
    denormal: Tally,
    negative: Tally,
}

impl Scan {
    const NOTHING: Self = {
        let none = Tally { count: 0, first: 0 };
        Self { low: f64::INFINITY, high: f64::NEG_INFINITY, nan: none, infinite: none, denormal: none, negative: none }
    };

    fn then(self, later: Self) -> Self {
        Self {
            low: self.low.min(later.low),
            high: self.high.max(later.high),
            nan: self.nan.then(later.nan),
            infinite: self.infinite.then(later.infinite),
            denormal: self.denormal.then(later.denormal),
            negative: self.negative.then(later.negative),
        }
    }

    fn warnings(&self, header: &GridHeader) -> Vec<LoadWarning> {
        let [nx, ny, _] = header.dims.map(|n| n as usize);
        let place = |t: Tally| format!("({}, {}, {})", t.first % nx, t.first / nx % ny, t.first / nx / ny);
        let voxels = |t: Tally| if t.count == 1 { "1 voxel".into() } else { format!("{} voxels", t.count) };
        let mut found = vec![];
        let mut say = |code, severity, message, hint: Option<&str>| {
            found.push(LoadWarning { code, severity, message, hint: hint.map(Into::into) });
        };
        for (tally, what) in [(self.nan, "not a number"), (self.infinite, "infinite")] {
            if tally.count > 0 {
                let message = format!(
                    "{} {what} and now stored as 0 (value {}), the first at {}",
                    are(&voxels(tally), tally),
                    header.intercept,
                    place(tally)
                );
                say("W0601", Severity::Warning, message, Some("mask or fill them in the program that made the file"));
            }
        }
        if self.denormal.count > 0 {
            let message = format!(
                "{} too small for a normal floating-point number and now stored as 0, the first at {}",
                are(&voxels(self.denormal), self.denormal),
                place(self.denormal)
            );
            say("W0602", Severity::Note, message, None);
        }
        if self.negative.count > 0 {
            let message = format!(
                "{} negative, down to {}, the first at {}; they are kept",
                are(&voxels(self.negative), self.negative),
                self.low,
                place(self.negative)
            );
            say("W0603", Severity::Note, message, None);
        }
        found
    }
}

fn are(subject: &str, tally: Tally) -> String {
    format!("{subject} {}", if tally.count == 1 { "is" } else { "are" })
}

/// One parallel pass: replaces what engines cannot take and gathers what is to be said.
fn scan<T: Sample>(voxels: &mut [T], slope: f64, intercept: f64) -> Scan {
    const PART: usize = 1 << 16;
    let part = |(index, part): (usize, &mut [T])| {
        let mut scan = Scan::NOTHING;
        for (at, sample) in part.iter_mut().enumerate() {
            let at = index * PART + at;
            let mut value = sample.to_f64() * slope + intercept;
            if !value.is_finite() {
                // An overflow by scaling counts as infinite.
                let tally = if sample.to_f64().is_nan() { &mut scan.nan } else { &mut scan.infinite };
                tally.add(at);
                *sample = T::zeroed();
                value = intercept;
            } else if sample.is_denormal() {
                scan.denormal.add(at);
                *sample = T::zeroed();
                value = intercept;
            }
            if value < 0.0 {
                scan.negative.add(at);
            }
            scan.low = scan.low.min(value);
            scan.high = scan.high.max(value);
        }
        scan
    };
    // The order of parts is kept by `reduce`, so that "the first" means what it says on any number of cores.
    voxels.par_chunks_mut(PART).enumerate().map(part).reduce(|| Scan::NOTHING, Scan::then)
}

impl Volume {
    /// Least and greatest voxels of blocks, in parallel.
    #[must_use]
    pub fn pyramid(&self) -> Pyramid {
        let dims = self.header.dims;
        let voxel = |[i, j, k]: [u32; 3]| self.value(i as usize, j as usize, k as usize);
        let layers = (0..Pyramid::layers(dims)).into_par_iter();
        Pyramid::new(dims, layers.map(|layer| Pyramid::layer(dims, layer, voxel)).collect())
    }
}
