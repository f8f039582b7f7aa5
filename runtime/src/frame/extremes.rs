//! The grids of a scene with the extremes of their voxels.

use super::Loaded;
use compiler::analysis::interval::{Extremes, Pyramid};
use compiler::ir::GridId;
use compiler::ir::eval::Voxels;
use std::sync::OnceLock;

/// The grids of a scene, by their number.
#[derive(Clone, Debug, Default)]
pub struct Grids {
    loaded: Vec<Loaded>,
    /// Made when they are first asked for.
    pyramids: Vec<OnceLock<Pyramid>>,
}

impl Grids {
    /// Of these volumes.
    #[must_use]
    pub fn new(loaded: Vec<Loaded>) -> Self {
        let pyramids = loaded.iter().map(|_| OnceLock::new()).collect();
        Self { loaded, pyramids }
    }

    /// The volumes.
    #[must_use]
    pub fn loaded(&self) -> &[Loaded] {
        &self.loaded
    }

    fn pyramid(&self, grid: usize) -> &Pyramid {
        self.pyramids[grid].get_or_init(|| self.loaded[grid].volume.pyramid())
    }
}

impl Voxels for Grids {
    fn voxel(&self, grid: GridId, [i, j, k]: [u32; 3]) -> f64 {
        self.loaded[grid.0 as usize].volume.value(i as usize, j as usize, k as usize)
    }
}

impl Extremes for Grids {
    fn voxel(&self, grid: GridId, index: [u32; 3]) -> f64 {
        Voxels::voxel(self, grid, index)
    }

    fn extremes(&self, grid: GridId, low: [u32; 3], high: [u32; 3]) -> (f64, f64) {
        self.pyramid(grid.0 as usize).extremes(low, high, |index| Voxels::voxel(self, grid, index))
    }
}
