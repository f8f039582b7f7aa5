//! Upper bounds of extinction for delta tracking: interval arithmetic over the box around a medium, with the params of the
//! frame as numbers and grids within their own values.

use super::super::shape::Solid;
use super::super::trace::LARGEST;
use crate::frame::vector::{Vec3, length};
use compiler::analysis::range::ranges;
use compiler::ir::eval::Voxels;
use compiler::ir::{Binary, Constant, Filter, Graph, GridId, Input, NodeId, Op, Type};

/// Least and largest value of a grid, its `outside` and what a cubic filter may overshoot included.
fn values<V: Voxels + ?Sized>(graph: &Graph, grid: GridId, voxels: &V) -> (f64, f64) {
    let info = graph.grid(grid);
    let [nx, ny, nz] = info.header.dims;
    let (mut low, mut high) = (info.outside, info.outside);
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let v = voxels.voxel(grid, [i, j, k]);
                (low, high) = (low.min(v), high.max(v));
            }
        }
    }
    let over = match info.filter {
        Filter::Nearest | Filter::Linear => 0.0,
        // Catmull–Rom weights of one axis sum to 1 in at most 1.25 of absolute value.
        Filter::Cubic => (high - low) * 0.5 * (1.25f64.powi(3) - 1.0),
    };
    (low - over, high + over)
}

/// A number above the sum of `roots` (per band, whichever is largest) everywhere in a shape; infinite if none is found.
pub(in super::super) fn bound<V: Voxels + ?Sized>(
    graph: &Graph,
    roots: &[NodeId],
    solid: &Solid,
    shells: &[(Vec3, f64)],
    (params, time): (&[Vec<f64>], f64),
    voxels: &V,
) -> f64 {
    // A little wider than the shape: places are rounded.
    let around = solid.bounds().map(|(a, b)| {
        let rim = 1e-9 * a.iter().chain(&b).fold(0.0f64, |m, x| m.max(x.abs()));
        (a.map(|x| x - rim), b.map(|x| x + rim))
    });
    let live = graph.reachable(&table_roots(graph, roots));
    let mut new = graph.declarations();
    let mut map = vec![NodeId(0); graph.len()];
    for id in graph.ids().filter(|id| live.get(id.0 as usize) == Some(&true)) {
        let op = Graph::map_operands(graph.op(id), |a| map[a.0 as usize]);
        let node = match op {
            Op::Param(p) if matches!(graph.ty(id), Type::Float(_)) => {
                new.push(Op::Const(Constant::new(&params[p.0 as usize])))
            }
            Op::Input(Input::Time) => new.scalar(time),
            op => new.push(op),
        };
        let within = match op {
            Op::Input(Input::Position) => around.map(|(a, b)| (new.vector(&a), new.vector(&b))),
            Op::Input(Input::Altitude(shell)) => around.map(|around| {
                let (low, high) = altitudes(solid, shells[shell as usize], around);
                (new.scalar(low), new.scalar(high))
            }),
            Op::Sample { grid, .. } => {
                let (low, high) = values(graph, grid, voxels);
                Some((new.scalar(low), new.scalar(high)))
            }
            _ => None,
        };
        // Clamping to what it can be changes no value, but tells the intervals.
        map[id.0 as usize] = match within {
            None => node,
            Some((low, high)) => {
                let least = new.binary(Binary::Max, node, low);
                new.binary(Binary::Min, least, high)
            }
        };
    }
    for table in &mut new.tables {
        for node in table.keys.iter_mut().chain(&mut table.values) {
            *node = map[node.0 as usize];
        }
    }
    let ranges = ranges(&new);
    let total: f64 = roots.iter().map(|r| ranges[map[r.0 as usize].0 as usize].high.max(0.0)).sum();
    if total <= LARGEST { total } else { f64::INFINITY }
}

/// Roots, and what tables are made of.
fn table_roots(graph: &Graph, roots: &[NodeId]) -> Vec<NodeId> {
    let entries = graph.tables.iter().flat_map(|t| t.keys.iter().chain(&t.values)).copied();
    roots.iter().copied().chain(entries).collect()
}

/// Altitudes over a shell within a box.
fn altitudes(solid: &Solid, (center, radius): (Vec3, f64), (a, b): (Vec3, Vec3)) -> (f64, f64) {
    let far: Vec3 = std::array::from_fn(|i| (a[i] - center[i]).abs().max((b[i] - center[i]).abs()));
    let near: Vec3 = std::array::from_fn(|i| center[i].clamp(a[i], b[i]) - center[i]);
    let low = if solid.is_shell_over(center, radius) { 0.0 } else { length(near) - radius };
    // Rounding on the shell itself.
    (low - 1e-9 * radius, length(far) - radius)
}
