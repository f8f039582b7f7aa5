//! Bounds of a medium's coefficients on a lattice of bricks, from intervals of its fields in f64; see
//! [`compiler::program::Binding::Bounds`].
//!
//! A coarse lattice comes first; its bricks are halved along every axis as long as that tells more, but for those in which
//! nothing is. How far it goes depends on what an evaluation costs, not on the clock, so that pictures do not depend on the
//! machine.

use super::Vec3;
use super::bounds::shells;
use super::extremes::Grids;
use super::rises::{Rises, rises};
use super::vector::length;
use crate::engine::reference::bounding_box;
use compiler::analysis::feature::lipschitz_of;
use compiler::analysis::interval::{Enclosure, Interval, Region, TableBounds, Workspace, altitudes};
use compiler::analysis::range::Known;
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{FieldScene, NodeId, Primitive, PrimitiveKind, Shape};
use compiler::program::{BricksPart, EMPTY, HIDING, MOST_BRICKS, MediumBounds, SPANS};
use rayon::prelude::*;

/// Instructions on intervals that one level of a lattice may cost: about half a second of one core.
const BUDGET: u64 = 50_000_000;
/// Bricks along an axis at first.
const FEWEST: u32 = 16;
/// Most bricks along an axis.
const MOST: u32 = 64;
/// How far the bounds of a brick hold beyond it, as a share of its edge, and what f32 may lose of a coordinate.
const RIM: (f64, f64) = (2e-3, 1e-6);

/// The bounds of one medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Bricks {
    low: Vec3,
    per_unit: Vec3,
    counts: [u32; 3],
    /// Extinction, source, radius of emptiness, calm.
    records: Vec<[f32; 4]>,
    /// How far the scalar that tells the medium rises between places, where steps go by that.
    rises: Rises,
}

/// What counts as nothing: extinction and emission per unit of length.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Nothing {
    /// A of `accuracy`.
    pub accuracy: f64,
    /// W of `accuracy`; 0 for a probe, for which nothing is nothing but what f32 cannot hold.
    pub white: f64,
    /// Whether random paths read the lattice: every face that they cross costs them a draw, so that bricks much smaller than
    /// the way between tentative collisions only cost.
    pub paths: bool,
}

/// A brick before its neighbours are looked at.
#[derive(Copy, Clone, Debug, Default)]
struct Own {
    extinction: f64,
    source: f64,
    occupied: bool,
    /// How fast arguments change at most that something narrow in it depends on, if there is any.
    steep: Option<f64>,
}

impl Bricks {
    /// Where the lattice lies.
    #[must_use]
    pub fn lattice(&self, part: BricksPart) -> Vec3 {
        match part {
            BricksPart::Low => self.low,
            BricksPart::PerUnit => self.per_unit,
            BricksPart::Counts => self.counts.map(f64::from),
            BricksPart::RiseNear => [0, 1, 2].map(|i| self.rises.over[i]),
            BricksPart::RiseFar => [3, 4, 5].map(|i| self.rises.over[i]),
            BricksPart::Grain => [self.rises.grain, 0.0, 0.0],
        }
    }

    /// Whether it is one brick, which tells no more than a bound of the whole.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.counts == [1; 3]
    }

    /// The records, brick by brick.
    #[must_use]
    pub fn records(&self) -> &[[f32; 4]] {
        &self.records
    }

    /// The largest extinction of all.
    #[must_use]
    pub fn majorant(&self) -> f64 {
        self.records.iter().map(|r| f64::from(r[0])).fold(0.0, f64::max)
    }

    /// The share of the bricks in which something is.
    #[must_use]
    pub fn occupied(&self) -> f64 {
        self.records.iter().filter(|r| r[2] == 0.0).count() as f64 / self.records.len().max(1) as f64
    }

    /// Whether a cell of the medium's field can be so dense, with params anywhere in their ranges, that steps need to know where.
    #[must_use]
    pub fn hides(
        scene: &FieldScene,
        bounds: &MediumBounds,
        (params, time): (&[Vec<f64>], f64),
        grids: &Grids,
        nothing: Nothing,
    ) -> bool {
        let Some(cell) = bounds.grain.filter(|_| !nothing.paths) else { return false };
        let mut value = |node: NodeId| evaluate_frame(&scene.graph, &[node], params, time).remove(0);
        let shape = &scene.media[bounds.medium as usize].shape;
        let (low, high) = bounding_box(shape, &mut value).unwrap_or(([-1e18; 3], [1e18; 3]));
        let mut fields = Fields::new(scene, bounds, params, time);
        for (own, param) in fields.params.iter_mut().zip(&scene.params) {
            let Some((least, most)) = param.range else { continue };
            let unit = scene.units.scale(param.dimension[0]);
            own.fill(Interval::new(least * unit, most * unit));
        }
        fields.tables = TableBounds::new(&scene.graph, &fields.params, fields.time);
        let mut work = fields.code.workspace();
        fields.run([0, 1, 2].map(|i| Interval::new(low[i], high[i])), grids, &mut work);
        let largest = |root: usize| fields.code.hull(&work, root).magnitude();
        let extinction = fields.extinction.map_or(0.0, largest);
        let source = fields.source.iter().map(|s| largest(*s)).fold(0.0, f64::max);
        let source = if nothing.white > 0.0 { source / nothing.white } else { source };
        !(extinction.max(source) * cell <= HIDING * nothing.accuracy)
    }

    /// Evaluates the bounds of a medium. `scene` is the optimised one; params are in the graph's units.
    #[must_use]
    pub fn new(
        scene: &FieldScene,
        bounds: &MediumBounds,
        (params, time): (&[Vec<f64>], f64),
        grids: &Grids,
        nothing: Nothing,
    ) -> Self {
        let graph = &scene.graph;
        let mut value = |node: NodeId| evaluate_frame(graph, &[node], params, time).remove(0);
        let shape = &scene.media[bounds.medium as usize].shape;
        let around =
            bounding_box(shape, &mut value).filter(|(a, b)| (0..3).all(|i| b[i] > a[i] && (b[i] - a[i]).is_finite()));
        let code = Fields::new(scene, bounds, params, time);
        // Without a box, one brick that is all of space.
        let (low, high, first) = match around {
            Some((low, high)) => (low, high, if nothing.paths { FEWEST / 2 } else { FEWEST }),
            None => ([-1e18; 3], [1e18; 3], 1),
        };
        let diagonal = length(std::array::from_fn(|i| high[i] - low[i]));
        let tiny = |size: f64| {
            let share = EMPTY * nothing.accuracy * size / diagonal;
            // What lights make of scattering is not known here.
            if bounds.scattering.is_none() && share.is_finite() { share.max(1e-37) } else { 1e-37 }
        };
        let tiny = if nothing.white > 0.0 { [tiny(1.0), tiny(nothing.white)] } else { [1e-37; 2] };
        let mut cover = Cover { fields: &code, bounds, grids, low, edge: [0.0; 3], tiny };
        let mut n = first;
        let mut places: Vec<[u32; 3]> = (0..n * n * n)
            .map(|i| [i % n, i / n % n, i / (n * n)])
            .filter(|at| !outside(shape, (low, high, n), *at))
            .collect();
        let bricks = loop {
            cover.edge = std::array::from_fn(|i| (high[i] - low[i]) / f64::from(n));
            let met = places.len();
            let bricks: Vec<([u32; 3], Own)> = places
                .into_par_iter()
                .with_min_len(16)
                .map_init(|| code.code.workspace(), |work, at| (at, cover.own(at, work)))
                .filter(|(_, own)| own.occupied)
                .collect();
            let next = bricks.len() as u64 * 8 * code.code.cost();
            let told = worth(&bricks, met);
            if n > 1 && n == first && !told {
                // One brick that is all of the box.
                let all = bricks.iter().map(|b| b.1).reduce(Own::join);
                n = 1;
                cover.edge = std::array::from_fn(|i| high[i] - low[i]);
                break all.map(|own| ([0; 3], own)).into_iter().collect();
            }
            let densest = bricks.iter().map(|b| b.1.extinction).fold(0.0, f64::max);
            let fine = nothing.paths && densest * cover.edge.iter().fold(0.0f64, |m, e| m.max(*e)) < 1.0;
            if n == 1 || n >= MOST || next > BUDGET || !told || fine {
                break bricks;
            }
            n *= 2;
            let children = |at: [u32; 3]| (0..8u32).map(move |c| std::array::from_fn(|i| 2 * at[i] + (c >> i & 1)));
            places = bricks.iter().flat_map(|(at, _)| children(*at)).collect();
        };
        let (edge, counts) = (cover.edge, [n; 3]);
        debug_assert!(n * n * n <= MOST_BRICKS);
        let index = |[i, j, k]: [u32; 3]| ((k * counts[1] + j) * counts[0] + i) as usize;
        let mut own = vec![Own::default(); counts.iter().product::<u32>() as usize];
        for (at, brick) in bricks {
            own[index(at)] = brick;
        }
        let empty = distances(counts, |i| own[i].occupied);
        let calm = distances(counts, |i| own[i].steep.is_some());
        let up = |x: f64| if x > f64::from(f32::MAX) { f32::MAX } else { ((x * (1.0 + 1e-6)) as f32).next_up() };
        let records = own.iter().enumerate().map(|(i, own)| {
            let size = |x: f64| if x > 0.0 { up(x) } else { 0.0 };
            let calm = own.steep.map_or(calm[i] as f32, |steep| -(steep as f32).clamp(1e-37, f32::MAX));
            if own.occupied {
                [size(own.extinction), size(own.source), 0.0, calm]
            } else {
                [0.0, 0.0, empty[i] as f32, calm]
            }
        });
        let told = (bounds.support, bounds.extinction.or(bounds.emission), bounds.grain, around);
        let rises = match told {
            (Some(support), Some(coefficient), Some(cell), Some(around)) => {
                rises(scene, (support, coefficient), cell, around, (params, time))
            }
            (None, ..) | (_, None, ..) | (.., None, _) | (.., None) => {
                Rises { over: [1e30; SPANS.len()], grain: bounds.grain.unwrap_or(1.0) }
            }
        };
        Self { low, per_unit: edge.map(|e| 1.0 / e), counts, records: records.collect(), rises }
    }
}

/// Distance of every brick to the nearest that is marked, in bricks along the farthest axis; by two sweeps, each of which
/// looks at the half of the neighbours that it has met.
fn distances(counts: [u32; 3], marked: impl Fn(usize) -> bool) -> Vec<u32> {
    let [nx, ny, nz] = counts.map(|n| n as i64);
    let mut out: Vec<u32> = (0..(nx * ny * nz) as usize).map(|i| if marked(i) { 0 } else { 4 * MOST }).collect();
    let offsets: Vec<[i64; 3]> =
        (0..27).map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1]).filter(|[x, y, z]| z * 9 + y * 3 + x < 0).collect();
    for sign in [1, -1] {
        for n in 0..nx * ny * nz {
            let at = if sign > 0 { n } else { nx * ny * nz - 1 - n };
            let (i, j, k) = (at % nx, at / nx % ny, at / (nx * ny));
            let mut least = out[at as usize];
            for [x, y, z] in &offsets {
                let (i, j, k) = (i + sign * x, j + sign * y, k + sign * z);
                if (0..nx).contains(&i) && (0..ny).contains(&j) && (0..nz).contains(&k) {
                    least = least.min(out[((k * ny + j) * nx + i) as usize] + 1);
                }
            }
            out[at as usize] = least;
        }
    }
    out
}

/// The fields of a medium, ready to be evaluated over boxes.
struct Fields {
    code: Enclosure,
    tables: TableBounds,
    params: Vec<Vec<Interval>>,
    time: Interval,
    shells: Vec<(Vec3, f64)>,
    /// Roots of the coefficients.
    extinction: Option<usize>,
    source: Vec<usize>,
    /// Root of the first argument of what is narrow, of which each is followed by its gradient.
    narrow: usize,
    /// How fast each argument changes at most, wherever it is.
    steepest: Vec<f64>,
}

impl Fields {
    fn new(scene: &FieldScene, bounds: &MediumBounds, params: &[Vec<f64>], time: f64) -> Self {
        let graph = &scene.graph;
        let mut roots: Vec<NodeId> = vec![];
        let mut place = |node: Option<NodeId>| {
            node.map(|node| {
                roots.push(node);
                roots.len() - 1
            })
        };
        let extinction = place(bounds.extinction);
        let source = [place(bounds.emission), place(bounds.scattering)].into_iter().flatten().collect();
        let narrow = roots.len();
        roots.extend(bounds.narrow.iter().flat_map(|n| [n.argument, n.gradient]));
        let steepest = if bounds.narrow.is_empty() {
            vec![]
        } else {
            let known = Known { params, time: Interval::point(time), ..Known::default() };
            let all = lipschitz_of(graph, &known, &[]);
            bounds.narrow.iter().map(|n| all[n.argument.0 as usize]).collect()
        };
        let shells = shells(scene, params, time);
        let params: Vec<Vec<Interval>> =
            params.iter().map(|v| v.iter().map(|x| Interval::point(*x)).collect()).collect();
        let time = Interval::point(time);
        let tables = TableBounds::new(graph, &params, time);
        Self { code: Enclosure::new(graph, &roots), tables, params, time, shells, extinction, source, narrow, steepest }
    }

    fn run(&self, position: [Interval; 3], grids: &Grids, work: &mut Workspace) {
        let above: Vec<Interval> = self.shells.iter().map(|(c, r)| altitudes(position, *c, *r)).collect();
        let region = Region {
            position,
            time: self.time,
            altitudes: &above,
            params: &self.params,
            tables: &self.tables,
            ..Region::default()
        };
        self.code.run(&region, grids, work);
    }
}

/// What is needed to cover a lattice.
struct Cover<'a> {
    fields: &'a Fields,
    bounds: &'a MediumBounds,
    grids: &'a Grids,
    low: Vec3,
    edge: Vec3,
    /// Extinction and emission that count as nothing.
    tiny: [f64; 2],
}

impl Cover<'_> {
    /// What is in a brick.
    fn own(&self, at: [u32; 3], work: &mut Workspace) -> Own {
        let position = [0, 1, 2].map(|i| {
            let a = self.low[i] + f64::from(at[i]) * self.edge[i];
            let b = a + self.edge[i];
            let rim = RIM.0 * self.edge[i] + RIM.1 * a.abs().max(b.abs());
            Interval::new(a - rim, b + rim)
        });
        self.fields.run(position, self.grids, work);
        let code = &self.fields.code;
        let largest = |root: usize| code.hull(work, root).magnitude();
        // What is no number must be met, so that it is reported.
        let lost = self.fields.extinction.iter().chain(&self.fields.source).any(|r| code.hull(work, *r).nan);
        let extinction = self.fields.extinction.map_or(0.0, largest);
        let source = self.fields.source.iter().map(|s| largest(*s)).fold(0.0, f64::max);
        let occupied = lost || extinction > self.tiny[0] || source > self.tiny[1];
        let size = self.edge.iter().fold(0.0f64, |m, e| m.max(*e));
        // What steps resolve anyway, or no step within a brick can miss.
        let resolved = self.bounds.cell.map_or(size, |cell| size.min(2.0 * cell));
        let mut steep: Option<f64> = None;
        for (i, narrow) in self.bounds.narrow.iter().enumerate() {
            let root = self.fields.narrow + 2 * i;
            let argument = code.hull(work, root);
            let slope: f64 = code.root(work, root + 1).iter().map(|c| c.magnitude().powi(2)).sum();
            let slope = slope.sqrt().min(self.fields.steepest[i]);
            let fine = |(from, to): &(f64, f64)| {
                let met = argument.low <= *to && argument.high >= *from;
                let within = argument.low >= *from && argument.high <= *to;
                met && !within && (to - from) < resolved * slope
            };
            if narrow.bands.iter().any(fine) {
                steep = Some(steep.map_or(slope, |s| s.max(slope)));
            }
        }
        Own { extinction, source, occupied, steep }
    }
}

impl Own {
    /// What holds in both.
    fn join(self, other: Self) -> Self {
        Self {
            extinction: self.extinction.max(other.extinction),
            source: self.source.max(other.source),
            occupied: self.occupied || other.occupied,
            steep: self.steep.into_iter().chain(other.steep).reduce(f64::max),
        }
    }
}

/// Whether halving the bricks is likely to tell more: some turned out to be empty, some are far less dense than others, or
/// something narrow is among them.
fn worth(bricks: &[([u32; 3], Own)], met: usize) -> bool {
    let emptied = (met - bricks.len()) as f64 > 0.02 * met as f64;
    let most = bricks.iter().map(|b| b.1.extinction).fold(0.0, f64::max);
    let mean = bricks.iter().map(|b| b.1.extinction).sum::<f64>() / bricks.len().max(1) as f64;
    emptied || mean < 0.5 * most || bricks.iter().any(|b| b.1.steep.is_some())
}

/// Whether a brick lies outside a ball that is all of a shape.
fn outside(shape: &Shape, (low, high, n): (Vec3, Vec3, u32), at: [u32; 3]) -> bool {
    let Shape::Primitive(Primitive { kind: PrimitiveKind::Sphere { .. }, from_world: None, .. }) = shape else {
        return false;
    };
    // The box around a ball has its centre and its radius.
    let square: f64 = (0..3)
        .map(|i| {
            let edge = (high[i] - low[i]) / f64::from(n);
            let (a, centre) = (low[i] + f64::from(at[i]) * edge, 0.5 * (low[i] + high[i]));
            (centre.clamp(a, a + edge) - centre).powi(2)
        })
        .sum();
    square.sqrt() > 0.5 * (high[0] - low[0]) * (1.0 + 1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_the_farthest_axis() {
        let counts = [7, 5, 6];
        let marked = [[1i64, 1, 1], [6, 4, 0]];
        let index = |p: [i64; 3]| ((p[2] * 5 + p[1]) * 7 + p[0]) as usize;
        let found = distances(counts, |i| marked.iter().any(|p| index(*p) == i));
        for k in 0..6 {
            for j in 0..5 {
                for i in 0..7 {
                    let to = |p: &[i64; 3]| (p[0] - i).abs().max((p[1] - j).abs()).max((p[2] - k).abs()) as u32;
                    assert_eq!(found[index([i, j, k])], marked.iter().map(to).min().expect("two"), "{i} {j} {k}");
                }
            }
        }
        assert!(distances([2, 2, 2], |_| false).iter().all(|d| *d >= 64));
    }
}
