//! Least and greatest voxels of any box of a grid, and with them what its interpolant can be.

use super::number::Interval;
use crate::ir::eval::interpolate;
use crate::ir::{Filter, GridId};

/// Voxels along an edge of the finest blocks.
const BLOCK: u32 = 4;

/// How much tricubic weights exceed a mean: those of one axis sum to 1 in at most 1.25 of absolute value, so that three
/// axes overshoot the range of the voxels by (1.25³ − 1)/2 of it on either side.
pub(in super::super) const CUBIC_OVERSHOOT: f64 = 0.5 * (1.25 * 1.25 * 1.25 - 1.0);
/// Likewise of the derivative along one axis: slopes sum to 0 in at most 3 of absolute value, times 1.25 on the two others.
pub(in super::super) const CUBIC_SLOPE: f64 = 0.5 * 3.0 * 1.25 * 1.25;

/// Voxels and their extremes.
pub trait Extremes: Sync {
    /// The value at whole indices within the grid.
    fn voxel(&self, grid: GridId, index: [u32; 3]) -> f64;
    /// Least and greatest voxel from `low` to `high`, both included and within the grid; or anything wider.
    fn extremes(&self, grid: GridId, low: [u32; 3], high: [u32; 3]) -> (f64, f64);
}

/// For scenes without grids.
#[derive(Copy, Clone, Debug, Default)]
pub struct NoExtremes;

impl Extremes for NoExtremes {
    fn voxel(&self, _grid: GridId, _index: [u32; 3]) -> f64 {
        0.0
    }

    fn extremes(&self, _grid: GridId, _low: [u32; 3], _high: [u32; 3]) -> (f64, f64) {
        (0.0, 0.0)
    }
}

/// One level of a pyramid.
#[derive(Clone, Debug)]
struct Level {
    dims: [u32; 3],
    /// Voxels along an edge of a block.
    size: u32,
    blocks: Vec<(f64, f64)>,
}

/// Least and greatest voxel of blocks of 4³, 8³, … voxels.
#[derive(Clone, Debug)]
pub struct Pyramid {
    levels: Vec<Level>,
}

fn join(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0.min(b.0), a.1.max(b.1))
}

const NOTHING: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

impl Pyramid {
    /// Layers of blocks of a grid of this size: [`Pyramid::layer`] makes each, in any order or at once.
    #[must_use]
    pub fn layers(dims: [u32; 3]) -> u32 {
        dims[2].div_ceil(BLOCK)
    }

    /// One layer of blocks.
    #[must_use]
    pub fn layer(dims: [u32; 3], layer: u32, voxel: impl Fn([u32; 3]) -> f64) -> Vec<(f64, f64)> {
        let [nx, ny] = [dims[0].div_ceil(BLOCK), dims[1].div_ceil(BLOCK)];
        let mut out = vec![NOTHING; nx as usize * ny as usize];
        for k in layer * BLOCK..((layer + 1) * BLOCK).min(dims[2]) {
            for j in 0..dims[1] {
                let row = &mut out[(j / BLOCK * nx) as usize..][..nx as usize];
                for i in 0..dims[0] {
                    let v = voxel([i, j, k]);
                    let block = &mut row[(i / BLOCK) as usize];
                    *block = join(*block, (v, v));
                }
            }
        }
        out
    }

    /// The pyramid over all layers, in order.
    #[must_use]
    pub fn new(dims: [u32; 3], layers: Vec<Vec<(f64, f64)>>) -> Self {
        let mut level = Level {
            dims: dims.map(|n| n.div_ceil(BLOCK)),
            size: BLOCK,
            blocks: layers.into_iter().flatten().collect(),
        };
        let mut levels = vec![];
        while level.dims.iter().any(|n| *n > 1) {
            let below = &level;
            let dims = below.dims.map(|n| n.div_ceil(2));
            let mut blocks = vec![NOTHING; dims.iter().map(|n| *n as usize).product()];
            let [mut i, mut j, mut k] = [0u32; 3];
            for block in &below.blocks {
                let at = ((k / 2 * dims[1] + j / 2) * dims[0] + i / 2) as usize;
                blocks[at] = join(blocks[at], *block);
                i += 1;
                if i == below.dims[0] {
                    (i, j) = (0, j + 1);
                }
                if j == below.dims[1] {
                    (j, k) = (0, k + 1);
                }
            }
            let above = Level { dims, size: 2 * below.size, blocks };
            levels.push(std::mem::replace(&mut level, above));
        }
        levels.push(level);
        Self { levels }
    }

    /// Least and greatest voxel of all.
    #[must_use]
    pub fn whole(&self) -> (f64, f64) {
        self.levels.last().and_then(|l| l.blocks.first()).copied().unwrap_or((0.0, 0.0))
    }

    /// Least and greatest voxel from `low` to `high`, both included: voxel by voxel where they are few, else of the blocks
    /// that hold them.
    #[must_use]
    pub fn extremes(&self, low: [u32; 3], high: [u32; 3], voxel: impl Fn([u32; 3]) -> f64) -> (f64, f64) {
        let most = (0..3).map(|a| high[a] - low[a]).max().unwrap_or(0);
        if most <= BLOCK {
            let mut out = NOTHING;
            for k in low[2]..=high[2] {
                for j in low[1]..=high[1] {
                    for i in low[0]..=high[0] {
                        let v = voxel([i, j, k]);
                        out = join(out, (v, v));
                    }
                }
            }
            return out;
        }
        let level = self.levels.iter().find(|l| most <= 4 * l.size).unwrap_or(&self.levels[self.levels.len() - 1]);
        let (a, b) = (low.map(|x| x / level.size), high.map(|x| x / level.size));
        let mut out = NOTHING;
        for k in a[2]..=b[2] {
            for j in a[1]..=b[1] {
                for i in a[0]..=b[0] {
                    out = join(out, level.blocks[((k * level.dims[1] + j) * level.dims[0] + i) as usize]);
                }
            }
        }
        out
    }
}

/// The part of a range of coordinates that lies in the grid, and whether some of it lies beyond.
fn inside(at: Interval, n: u32) -> (Option<(f64, f64)>, bool) {
    let (least, most) = (-0.5, f64::from(n) - 0.5);
    let beyond = at.nan || at.low < least || at.high > most;
    if at.high < least || at.low > most {
        return (None, true);
    }
    // Coordinates are clamped to the centres of the outer voxels.
    let last = f64::from(n) - 1.0;
    (Some((at.low.clamp(0.0, last), at.high.clamp(0.0, last))), beyond)
}

/// Voxels that an interpolation between two coordinates reads.
fn touched(filter: Filter, (a, b): (f64, f64), n: u32) -> (u32, u32) {
    let last = n - 1;
    let whole = |x: f64| (x as u32).min(last);
    match filter {
        Filter::Nearest => (whole((a + 0.5).floor()), whole((b + 0.5).floor())),
        Filter::Linear => (whole(a.floor()), whole(b.floor() + 1.0)),
        Filter::Cubic => (whole((a.floor() - 1.0).max(0.0)), whole(b.floor() + 2.0)),
    }
}

struct Reach {
    low: [f64; 3],
    high: [f64; 3],
    first: [u32; 3],
    last: [u32; 3],
    beyond: bool,
}

fn reach(filter: Filter, dims: [u32; 3], at: [Interval; 3]) -> Option<Reach> {
    let mut out = Reach { low: [0.0; 3], high: [0.0; 3], first: [0; 3], last: [0; 3], beyond: false };
    for axis in 0..3 {
        let (part, beyond) = inside(at[axis], dims[axis]);
        out.beyond |= beyond;
        let part = part?;
        (out.low[axis], out.high[axis]) = part;
        (out.first[axis], out.last[axis]) = touched(filter, part, dims[axis]);
    }
    Some(out)
}

fn widened(low: f64, high: f64, over: f64) -> Interval {
    // Weights and sums of up to 64 products round.
    let room = 64.0 * f64::EPSILON * low.abs().max(high.abs()) * (1.0 + over);
    let over = over * (high - low);
    Interval::new(low - over - room, high + over + room)
}

/// What [`interpolate`] can give over a box of voxel coordinates.
pub fn sample_range(
    (filter, dims, outside): (Filter, [u32; 3], f64),
    at: [Interval; 3],
    grid: GridId,
    voxels: &(impl Extremes + ?Sized),
) -> Interval {
    let beyond = Interval::point(outside);
    let Some(reach) = reach(filter, dims, at) else { return beyond };
    let (low, high) = voxels.extremes(grid, reach.first, reach.last);
    let own = match filter {
        Filter::Nearest => Interval::new(low, high),
        // Within one cell the interpolant is linear along each axis: extreme at the corners of the box.
        Filter::Linear if low < high && (0..3).all(|a| reach.last[a] - reach.first[a] <= 1) => {
            let mut out: Option<Interval> = None;
            for corner in 0..8 {
                let at = [0, 1, 2].map(|a| if corner >> a & 1 == 1 { reach.high[a] } else { reach.low[a] });
                let v = interpolate(filter, dims, outside, at, |ijk| voxels.voxel(grid, ijk));
                out = Some(out.map_or(Interval::point(v), |o| o.hull(Interval::point(v))));
            }
            let out = out.unwrap_or(Interval::ANY);
            // The corners themselves are rounded relative to the voxels.
            let room = 64.0 * f64::EPSILON * low.abs().max(high.abs());
            Interval::new(out.low - room, out.high + room)
        }
        Filter::Linear if low == high => Interval::new(low, high),
        Filter::Linear => widened(low, high, 0.0),
        Filter::Cubic if low == high && low == 0.0 => Interval::point(0.0),
        Filter::Cubic => widened(low, high, CUBIC_OVERSHOOT),
    };
    if reach.beyond { own.hull(beyond) } else { own }
}

/// What one component of [`crate::ir::eval::interpolate_gradient`] can be over a box of voxel coordinates.
pub fn sample_gradient_range(
    (filter, dims): (Filter, [u32; 3]),
    at: [Interval; 3],
    grid: GridId,
    voxels: &(impl Extremes + ?Sized),
) -> Interval {
    let zero = Interval::point(0.0);
    let Some(reach) = reach(filter, dims, at) else { return zero };
    let (low, high) = voxels.extremes(grid, reach.first, reach.last);
    let most = match filter {
        Filter::Nearest => 0.0,
        Filter::Linear => high - low,
        Filter::Cubic => CUBIC_SLOPE * (high - low),
    };
    let most = most * (1.0 + 1e-12) + if low < high { 256.0 * f64::EPSILON * low.abs().max(high.abs()) } else { 0.0 };
    // Where all voxels are equal, what is left is the rounding of the weights.
    let most = if low == high && filter == Filter::Cubic { 256.0 * f64::EPSILON * low.abs() } else { most };
    Interval::new(-most, most)
}
