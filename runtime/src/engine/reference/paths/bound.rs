//! Upper bounds of extinction for delta tracking: intervals of the coefficients over bricks of the box around a medium, with
//! the params of the frame as numbers and grids within the extremes of their voxels.

use super::super::field::Ray;
use super::super::shape::Solid;
use super::super::trace::LARGEST;
use crate::frame::vector::Vec3;
use compiler::analysis::interval::{Enclosure, Extremes, Interval, Pyramid, Region, TableBounds, altitudes};
use compiler::ir::eval::Voxels;
use compiler::ir::{Graph, GridId, NodeId};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Bricks along every axis.
const BRICKS: usize = 16;

/// Voxels with their extremes, made when they are first asked for.
struct Bounded<'a, V: ?Sized> {
    graph: &'a Graph,
    voxels: &'a V,
    pyramids: Vec<OnceLock<Pyramid>>,
}

impl<V: Voxels + ?Sized> Extremes for Bounded<'_, V> {
    fn voxel(&self, grid: GridId, index: [u32; 3]) -> f64 {
        self.voxels.voxel(grid, index)
    }

    fn extremes(&self, grid: GridId, low: [u32; 3], high: [u32; 3]) -> (f64, f64) {
        let voxel = |index: [u32; 3]| self.voxels.voxel(grid, index);
        let pyramid = self.pyramids[grid.0 as usize].get_or_init(|| {
            let dims = self.graph.grid(grid).header.dims;
            let layers = (0..Pyramid::layers(dims)).into_par_iter();
            Pyramid::new(dims, layers.map(|layer| Pyramid::layer(dims, layer, voxel)).collect())
        });
        pyramid.extremes(low, high, voxel)
    }
}

/// What extinction is nowhere above, brick by brick.
#[derive(Clone, Debug)]
pub(in super::super) struct Majorants {
    low: Vec3,
    edge: Vec3,
    /// One for all of space where the medium has no box.
    bounds: Vec<f64>,
}

impl Majorants {
    /// The same everywhere.
    pub(in super::super) fn everywhere(bound: f64) -> Self {
        Self { low: [0.0; 3], edge: [f64::INFINITY; 3], bounds: vec![bound] }
    }

    /// Of the sum of `roots`, per band, whichever is largest. A bound is infinite where none is found.
    pub(in super::super) fn new<V: Voxels + ?Sized>(
        graph: &Graph,
        roots: &[NodeId],
        solid: &Solid,
        shells: &[(Vec3, f64)],
        (params, time): (&[Vec<f64>], f64),
        voxels: &V,
    ) -> Self {
        let code = Enclosure::new(graph, roots);
        let params: Vec<Vec<Interval>> =
            params.iter().map(|v| v.iter().map(|x| Interval::point(*x)).collect()).collect();
        let time = Interval::point(time);
        let tables = TableBounds::new(graph, &params, time);
        let voxels = Bounded { graph, voxels, pyramids: graph.grids.iter().map(|_| OnceLock::new()).collect() };
        let bound = |position: [Interval; 3], work: &mut _| {
            let above: Vec<Interval> = (shells.iter())
                .map(|(center, radius)| {
                    let over = altitudes(position, *center, *radius);
                    // Rounding on the shell itself.
                    let low = if solid.is_shell_over(*center, *radius) { over.low.max(0.0) } else { over.low };
                    Interval { low: low - 1e-9 * radius, ..over }
                })
                .collect();
            let region =
                Region { position, time, altitudes: &above, params: &params, tables: &tables, ..Region::default() };
            code.run(&region, &voxels, work);
            // What is no number is reported where it is met.
            let total: f64 = (0..roots.len()).map(|r| code.hull(work, r)).map(|i| i.high.max(0.0)).sum();
            if total <= LARGEST { total } else { f64::INFINITY }
        };
        let Some((low, high)) = solid.bounds().filter(|(a, b)| (0..3).all(|i| b[i] > a[i])) else {
            return Self::everywhere(bound([Interval::NUMBER; 3], &mut code.workspace()));
        };
        let edge: Vec3 = std::array::from_fn(|i| (high[i] - low[i]) / BRICKS as f64);
        let brick = |n: usize, work: &mut _| {
            let at = [n % BRICKS, n / BRICKS % BRICKS, n / (BRICKS * BRICKS)];
            // A little wider than the brick: places are rounded.
            let position = [0, 1, 2].map(|i| {
                let a = low[i] + at[i] as f64 * edge[i];
                let rim = 1e-6 * edge[i] + 1e-9 * low[i].abs().max(high[i].abs());
                Interval::new(a - rim, a + edge[i] + rim)
            });
            bound(position, work)
        };
        let all = (0..BRICKS.pow(3)).into_par_iter();
        let bounds = all.map_init(|| code.workspace(), |work, n| brick(n, work)).collect();
        Self { low, edge, bounds }
    }

    /// The largest of all.
    pub(in super::super) fn most(&self) -> f64 {
        self.bounds.iter().copied().fold(0.0, f64::max)
    }

    /// Moves `t` on to the next tentative event before `end`, at the rate of the bound where the ray is and at least at
    /// `least`; gives that rate, infinite where there is no bound, or nothing if there is no event. `depth` draws optical
    /// depths: anew in every brick, since they have no memory.
    pub(in super::super) fn next(
        &self,
        ray: &Ray,
        t: &mut f64,
        (end, least): (f64, f64),
        depth: &mut dyn FnMut() -> f64,
    ) -> Option<f64> {
        while *t < end {
            let (bound, exit) = self.at(ray.at(*t), ray.direction);
            let rate = bound.max(least);
            if !rate.is_finite() {
                return Some(rate);
            }
            let step = if rate > 0.0 { depth() / rate } else { f64::INFINITY };
            // Far away, as far as rounding lets a ray advance.
            let exit = exit.max(4.0 * f64::EPSILON * t.abs());
            *t += step.min(exit);
            if step <= exit && *t < end {
                return Some(rate);
            }
        }
        None
    }

    /// The bound at a place, and how far it holds along a direction; a little beyond, so that the next brick is entered.
    pub(in super::super) fn at(&self, p: Vec3, d: Vec3) -> (f64, f64) {
        if self.bounds.len() == 1 {
            return (self.bounds[0], f64::INFINITY);
        }
        let (mut index, mut exit) = (0, f64::INFINITY);
        for axis in (0..3).rev() {
            let u = (p[axis] - self.low[axis]) / self.edge[axis];
            let cell = u.floor().clamp(0.0, BRICKS as f64 - 1.0);
            index = index * BRICKS + cell as usize;
            let rate = d[axis] / self.edge[axis];
            let ahead = if rate > 0.0 { cell + 1.0 - u } else { u - cell };
            if rate != 0.0 {
                exit = exit.min((ahead.max(0.0) + 1e-7) / rate.abs());
            }
        }
        (self.bounds[index], exit)
    }
}
