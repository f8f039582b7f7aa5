//! Splats of files as a picture shows them: projected in f64, put in order, and listed for the tiles that they cover.
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
mod tests;

pub use project::Projected;

use super::{Eye, Params, Placed, Vec3, placed};
use crate::data::splats::Splats;
use crate::frame::Camera;
use compiler::diagnostic::Diagnostic;
use compiler::ir::FieldScene;
use compiler::ir::eval::evaluate_frame;
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
    rounds: u32,
    records: Vec<Vec<f32>>,
    lists: Vec<u32>,
}

impl Footprints {
    /// Edge of the tiles that have lists, in pixels.
    #[must_use]
    pub fn edge(&self) -> u32 {
        self.edge.max(1)
    }

    /// Dispatches that it takes to go through the longest list.
    #[must_use]
    pub fn rounds(&self) -> u32 {
        self.rounds.max(1)
    }

    /// The same, if a dispatch goes through so many entries of a list.
    #[must_use]
    pub fn in_rounds_of(self, entries: u32) -> Self {
        let heads = self.lists.first().map_or(0, |first| *first as usize / 3);
        let longest = (1..heads).map(|i| self.lists[3 * i] - self.lists[3 * i - 3]).max().unwrap_or(0);
        Self { rounds: longest.div_ceil(entries.max(1)), ..self }
    }

    /// The numbers of the splats, for the bands of one part of the program.
    #[must_use]
    pub fn records(&self, part: usize) -> &[f32] {
        self.records.get(part).map_or(&[], Vec::as_slice)
    }

    /// The list of each tile.
    #[must_use]
    pub fn lists(&self) -> &[u32] {
        &self.lists
    }

    /// Of a picture. `bands` has for each part of the program and each band of it the parts of red, green and blue.
    #[must_use]
    pub fn of_picture(cast: &Cast<'_>, camera: &Camera, eye: &Eye, bands: &[Vec<Vec3>], accuracy: f64) -> Self {
        let mut projected = Projected::new(cast, camera);
        projected.sort();
        let lists = projected.lists(camera, CUT * accuracy);
        Self { edge: lists.edge, rounds: 1, records: projected.records(eye.plane, bands), lists: lists.numbers }
    }

    /// Of rays of a list; `starts` says at which t each of them begins.
    #[must_use]
    pub fn of_rays(cast: &Cast<'_>, rays: &[(Vec3, Vec3)], starts: &[f64], bands: &[Vec<Vec3>], accuracy: f64) -> Self {
        let mut all = Self { edge: 1, rounds: 1, records: vec![vec![]; bands.len()], lists: vec![] };
        let mut heads = vec![];
        let mut numbers = vec![];
        let head = 3 * (rays.len() + 1);
        for ((origin, direction), start) in rays.iter().zip(starts) {
            let (met, left_out) = project::along(cast, (*origin, *direction), CUT * accuracy);
            heads.extend([(head + numbers.len()) as u32, left_out.alpha(), left_out.light()]);
            for one in &met {
                numbers.push((all.records[0].len() / (2 + bands[0].len())) as u32);
                for (records, bands) in all.records.iter_mut().zip(bands) {
                    one.write(records, *start, bands);
                }
            }
        }
        heads.extend([(head + numbers.len()) as u32, 0, 0]);
        heads.extend(numbers);
        all.lists = heads;
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
