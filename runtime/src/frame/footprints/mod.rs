//! Splats of files as a picture shows them: projected in f64, with what the device needs to put them in order and into the lists of
//! the tiles that they cover.
//!
//! Projection stays here because WGSL has no f64, and pairs of f32 are no way out where a compiler may reorder sums: centres
//! far from the origin, needles, and splats beside the eye lose what f32 cannot hold. Keys are the bits of f64 depths, so
//! that splats are in order even where f32 does not tell their depths apart.
//!
//! The formulas are those of the language reference (Zwicker et al., "EWA Splatting", 2002; Kerbl et al., 2023). The square root of
//! a covariance is what is kept, so that needles and discs lose no digits: with the axes of a splat scaled by its deviations as
//! columns of A, and the projection J, determinants come from |row₁ × row₂|² of J·A instead of differences.
//!
//! A list leaves out what covers less than [`CUT`] of `accuracy` anywhere in its tile. The sum of what it leaves out is kept with it,
//! and becomes part of the reported error; below [`FLOOR`] each is counted as that much.

mod lists;
mod project;
#[cfg(test)]
pub(crate) mod tests;

pub use project::Projected;

use super::{Eye, Params, Placed, Vec3, placed};
use crate::data::splats::Splats;
use crate::frame::Camera;
use compiler::diagnostic::Diagnostic;
use compiler::ir::FieldScene;
use compiler::ir::eval::evaluate_frame;
use std::ops::Range;
use std::sync::Arc;

/// Least α that is drawn, as a share of `accuracy`.
const CUT: f64 = 1e-4;
/// Below this α nothing is told from anything else.
const FLOOR: f64 = 1e-12;

/// All splats of a scene, placed for one frame.
#[derive(Clone, Debug)]
pub struct Cast<'a> {
    files: &'a [Arc<Splats>],
    placed: Vec<Placed>,
    /// Units of the graph in a metre.
    unit: f64,
}

impl<'a> Cast<'a> {
    /// `files` has an entry for each item of splats.
    ///
    /// # Errors
    /// `E0651` for a transform that is not finite.
    pub fn new(scene: &FieldScene, params: &Params, time: f64, files: &'a [Arc<Splats>]) -> Result<Self, Diagnostic> {
        let placed = placed(scene, &|nodes| evaluate_frame(&scene.graph, nodes, &params.0, time))?;
        Ok(Self { files, placed, unit: scene.units.scale(1.0) })
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.files.iter().map(|f| f.len()).sum()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What kernels read of the splats of files; see [`compiler::program::Binding`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Footprints {
    edge: u32,
    columns: u32,
    unseen: u32,
    rounds: u32,
    records: Vec<Vec<f32>>,
    keys: Vec<u32>,
    reaches: Vec<[u32; 4]>,
    heads: Vec<u32>,
}

/// Columns of tiles (the second part is empty but where a panorama comes round) and rows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Tiles {
    columns: [Range<u32>; 2],
    rows: Range<u32>,
}

impl Tiles {
    fn each(&self, mut visit: impl FnMut([u32; 2])) {
        for row in self.rows.clone() {
            for column in self.columns[0].clone().chain(self.columns[1].clone()) {
                visit([column, row]);
            }
        }
    }

    fn holds(&self, [column, row]: [u32; 2]) -> bool {
        self.rows.contains(&row) && self.columns.iter().any(|c| c.contains(&column))
    }

    fn area(&self) -> u64 {
        self.columns.iter().map(|c| c.len() as u64).sum::<u64>() * self.rows.len() as u64
    }

    /// As [`compiler::program::Binding::Reaches`] says, where so many tiles are in a row of the picture.
    fn packed(&self, across: u32) -> [u32; 4] {
        let first = |columns: &Range<u32>| self.rows.start * across + columns.start;
        let [main, rest] = &self.columns;
        let widths = ((main.len() as u32) << 16) | rest.len() as u32;
        [first(main), first(rest), widths, self.rows.len() as u32]
    }
}

/// Keys of depths in the words of a sort: the bits of f64, which grow with what is not negative.
fn keys(depths: impl Iterator<Item = f64> + Clone) -> Vec<u32> {
    let bits = depths.map(f64::to_bits);
    bits.clone().map(|b| b as u32).chain(bits.map(|b| (b >> 32) as u32)).collect()
}

impl Footprints {
    /// Edge of the tiles that have lists, in pixels.
    #[must_use]
    pub fn edge(&self) -> u32 {
        self.edge.max(1)
    }

    /// How many of them are in a row.
    #[must_use]
    pub fn columns(&self) -> u32 {
        self.columns
    }

    /// Dispatches that it takes to go through the longest list.
    #[must_use]
    pub fn rounds(&self) -> u32 {
        self.rounds.max(1)
    }

    /// The same, if a dispatch goes through so many entries of a list.
    #[must_use]
    pub fn in_rounds_of(self, entries: u32) -> Self {
        let starts = self.heads.iter().step_by(3);
        let longest = starts.clone().zip(starts.skip(1)).map(|(start, end)| end - start).max().unwrap_or(0);
        Self { rounds: longest.div_ceil(entries.max(1)), ..self }
    }

    /// The numbers of the splats, for the bands of one part of the program.
    #[must_use]
    pub fn records(&self, part: usize) -> &[f32] {
        self.records.get(part).map_or(&[], Vec::as_slice)
    }

    /// Their keys, in two words: as [`compiler::program::Binding::Keys`] says.
    #[must_use]
    pub fn keys(&self) -> &[u32] {
        &self.keys
    }

    /// The tiles that each reaches, as [`compiler::program::Binding::Reaches`] says.
    #[must_use]
    pub fn reaches(&self) -> &[[u32; 4]] {
        &self.reaches
    }

    /// The heads of all lists, and of one more: as [`compiler::program::Binding::TileLists`] says.
    #[must_use]
    pub fn heads(&self) -> &[u32] {
        &self.heads
    }

    /// How many splats there are.
    #[must_use]
    pub fn len(&self) -> u32 {
        self.reaches.len() as u32
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.reaches.is_empty()
    }

    /// How many there are besides that are behind the eye or have no finite picture.
    #[must_use]
    pub fn unseen(&self) -> u32 {
        self.unseen
    }

    /// Entries of all lists.
    #[must_use]
    pub fn entries(&self) -> u32 {
        self.heads.len().checked_sub(3).map_or(0, |end| self.heads[end] - self.heads[0])
    }

    /// Of a picture. `bands` has for each part of the program and each band of it the parts of red, green and blue.
    #[must_use]
    pub fn of_picture(cast: &Cast<'_>, camera: &Camera, eye: &Eye, bands: &[Vec<Vec3>], accuracy: f64) -> Self {
        let projected = Projected::new(cast, camera);
        let lists = projected.lists(camera, CUT * accuracy);
        Self {
            edge: lists.edge,
            columns: lists.columns,
            unseen: (cast.len() - projected.len()) as u32,
            rounds: 1,
            records: projected.records(eye.plane, bands),
            keys: projected.keys(),
            reaches: lists.reaches,
            heads: lists.heads,
        }
    }

    /// Of rays of a list; `starts` says at which t each of them begins.
    #[must_use]
    pub fn of_rays(cast: &Cast<'_>, rays: &[(Vec3, Vec3)], starts: &[f64], bands: &[Vec<Vec3>], accuracy: f64) -> Self {
        let mut all = Self { edge: 1, columns: 1, rounds: 1, records: vec![vec![]; bands.len()], ..Self::default() };
        let mut depths = vec![];
        let head = 3 * (rays.len() + 1);
        for (row, ((origin, direction), start)) in (0..).zip(rays.iter().zip(starts)) {
            let (met, left_out) = project::along(cast, (*origin, *direction), CUT * accuracy);
            all.heads.extend([(head + depths.len()) as u32, left_out.alpha(), left_out.light()]);
            let ray = Tiles { columns: [0..1, 0..0], rows: row..row + 1 };
            for one in &met {
                depths.push(one.t());
                all.reaches.push(ray.packed(1));
                for (records, bands) in all.records.iter_mut().zip(bands) {
                    one.write(records, *start, bands);
                }
            }
        }
        all.heads.extend([(head + depths.len()) as u32, 0, 0]);
        all.keys = keys(depths.iter().copied());
        all
    }
}

/// What a list does without.
#[derive(Copy, Clone, Debug, Default)]
struct LeftOut {
    /// Sum of the largest α of each.
    alpha: f64,
    /// lx
    brightest: f64,
}

impl LeftOut {
    fn add(&mut self, alpha: f64, light: f64) {
        self.alpha += alpha;
        self.brightest = self.brightest.max(light);
    }

    /// As kernels read it.
    fn alpha(&self) -> u32 {
        bounded(self.alpha).to_bits()
    }

    fn light(&self) -> u32 {
        bounded(self.brightest).to_bits()
    }
}

/// The nearest number that f32 holds with room for sums.
fn bounded(x: f64) -> f32 {
    x.clamp(-1e37, 1e37) as f32
}
