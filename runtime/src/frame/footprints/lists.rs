//! Which tiles of a picture each splat covers, and what lists leave out: a sum in f64, for it is part of a reported error.

use super::project::{Projected, Seen};
use super::{FLOOR, LeftOut, Tiles};
use crate::frame::vector::dot;
use crate::frame::{Camera, View};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::Range;

/// Edge of a tile in pixels, if there is room for so many lists.
const EDGE: u32 = 16;
/// Entries of all lists; where there would be more, tiles are larger.
const MOST: u64 = 1 << 24;

/// What lists are made of.
pub(super) struct Lists {
    pub(super) edge: u32,
    pub(super) columns: u32,
    pub(super) reaches: Vec<[u32; 4]>,
    pub(super) heads: Vec<u32>,
}

/// Tiles on the picture.
struct Grid<'a> {
    camera: &'a Camera,
    edge: u32,
    counts: [u32; 2],
}

impl Grid<'_> {
    /// Tiles that an interval of pixels touches.
    fn touched(&self, axis: usize, from: f64, to: f64) -> Range<u32> {
        let (edge, size) = (f64::from(self.edge), f64::from(self.camera.size[axis]));
        if !(to >= 0.0 && from <= size) {
            return 0..0;
        }
        let first = (from / edge).floor().max(0.0) as u32;
        let last = (to / edge).floor().min(f64::from(self.counts[axis])) as u32;
        first.min(self.counts[axis])..(last + 1).min(self.counts[axis])
    }

    /// Tiles outside of which a splat covers less than `least`.
    fn reached(&self, seen: &Seen, least: f64) -> Tiles {
        if seen.opacity < least {
            return Tiles::default();
        }
        let reach = (2.0 * (seen.opacity / least).ln()).sqrt();
        let [xx, xy, yy] = seen.covariance;
        let around = |axis: usize, half: f64| self.touched(axis, seen.at[axis] - half, seen.at[axis] + half);
        match self.camera.view {
            View::Perspective { .. } | View::Orthographic { .. } => {
                Tiles { columns: [around(0, reach * xx.sqrt()), 0..0], rows: around(1, reach * yy.sqrt()) }
            }
            View::Panorama => {
                let [w, h] = self.camera.size.map(f64::from);
                let c = self.camera;
                let [x, y, z] = [c.right, c.up, c.forward].map(|axis| dot(axis, seen.at));
                let (longitude, latitude) = (x.atan2(z), y.clamp(-1.0, 1.0).asin());
                // The larger eigenvalue.
                let largest = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
                let angle = (reach * largest.sqrt()).atan() + 1e-9;
                let row = |latitude: f64| (0.5 - latitude / PI) * h;
                let rows = self.touched(1, row(latitude + angle), row(latitude - angle));
                let whole = 0..self.counts[0];
                if latitude.abs() + angle >= FRAC_PI_2 {
                    return Tiles { columns: [whole, 0..0], rows };
                }
                let half = (angle.sin() / latitude.cos()).min(1.0).asin() + 1e-9;
                let column = |longitude: f64| (longitude / PI + 1.0) * 0.5 * w;
                let (from, to) = (column(longitude - half), column(longitude + half));
                let main = self.touched(0, from, to);
                let rest = if from < 0.0 {
                    self.touched(0, from + w, w)
                } else if to > w {
                    self.touched(0, 0.0, to - w)
                } else {
                    0..0
                };
                let apart = rest.is_empty() || rest.start >= main.end || rest.end <= main.start;
                Tiles { columns: if apart { [main, rest] } else { [whole, 0..0] }, rows }
            }
        }
    }

    /// The most that a splat can cover in a tile.
    fn most(&self, seen: &Seen, [column, row]: [u32; 2]) -> f64 {
        match self.camera.view {
            View::Perspective { .. } | View::Orthographic { .. } => {
                // From the axes alone: for an offset along one, the least of the quadratic form over the other is x²/xx.
                let [xx, _, yy] = seen.covariance;
                let off = |axis: usize, tile: u32| {
                    let low = f64::from(tile * self.edge);
                    let high = low + f64::from(self.edge);
                    (low - seen.at[axis]).max(seen.at[axis] - high).max(0.0)
                };
                let (x, y) = (off(0, column), off(1, row));
                seen.opacity * (-0.5 * (x * x / xx).max(y * y / yy)).exp()
            }
            View::Panorama => seen.opacity,
        }
    }
}

impl Projected {
    /// What is listed where: all but what covers less than `cut` in a tile.
    pub(super) fn lists(&self, camera: &Camera, cut: f64) -> Lists {
        let cut = cut.max(2.0 * FLOOR);
        let mut edge = EDGE;
        loop {
            let grid = Grid { camera, edge, counts: camera.size.map(|n| n.div_ceil(edge).max(1)) };
            let listed: Vec<Tiles> = self.list.par_iter().map(|s| grid.reached(s, cut)).collect();
            let entries: u64 = listed.par_iter().map(Tiles::area).sum();
            if entries <= MOST || grid.counts == [1, 1] {
                return self.lists_of(&grid, cut, &listed);
            }
            edge *= 2;
        }
    }

    fn lists_of(&self, grid: &Grid<'_>, cut: f64, listed: &[Tiles]) -> Lists {
        let [columns, rows] = grid.counts;
        let tiles = columns as usize * rows as usize;
        let number = |[column, row]: [u32; 2]| row as usize * columns as usize + column as usize;
        let mut left_out = vec![LeftOut { alpha: FLOOR * self.list.len() as f64, brightest: 0.0 }; tiles];
        let mut lengths = vec![0u32; tiles];
        for (seen, listed) in self.list.iter().zip(listed) {
            listed.each(|tile| lengths[number(tile)] += 1);
            // What is just not listed, but for the very least.
            grid.reached(seen, FLOOR).each(|tile| {
                if !listed.holds(tile) {
                    left_out[number(tile)].add(grid.most(seen, tile).min(cut), seen.brightness());
                }
            });
        }
        let mut heads = Vec::with_capacity(3 * (tiles + 1));
        let mut at = 3 * (tiles as u32 + 1);
        for (left_out, length) in left_out.iter().zip(lengths) {
            heads.extend([at, left_out.alpha(), left_out.light()]);
            at += length;
        }
        heads.extend([at, 0, 0]);
        let reaches = listed.par_iter().map(|t| t.packed(columns)).collect();
        Lists { edge: grid.edge, columns, reaches, heads }
    }
}
