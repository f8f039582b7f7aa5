//! The field graph and its f64 evaluator against definitions written out here a second time.

mod closed;
mod derive;
mod feature;
mod grid;
mod hash;
mod interval;
mod loops;
mod tables;

use compiler::ir::eval::{Environment, LANES, NoVoxels, Tables, Tape, Voxels};
use compiler::ir::{Filter, Graph, GridId, GridInfo, NodeId};
use compiler::loader::{GridHeader, Scalar};

/// A grid whose voxels are a function of their indices.
pub(crate) struct Lattice<F>(pub(crate) F);

impl<F: Fn([u32; 3]) -> f64 + Sync> Voxels for Lattice<F> {
    fn voxel(&self, _grid: GridId, index: [u32; 3]) -> f64 {
        (self.0)(index)
    }
}

/// A grid of these dimensions whose voxel indices are the world.
pub(crate) fn declare(graph: &mut Graph, dims: [u32; 3], filter: Filter, outside: f64) -> GridId {
    graph.grids.push(GridInfo {
        name: "head".into(),
        span: None,
        path: "head.nii".into(),
        from: "scene.vol".into(),
        header: GridHeader {
            dims,
            scalar: Scalar::F32,
            slope: 1.0,
            intercept: 0.0,
            world_from_index: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        },
        filter,
        outside,
    });
    GridId(graph.grids.len() as u32 - 1)
}

/// The value of a node at a position, the same position in every lane.
pub(crate) fn at_with(graph: &Graph, node: NodeId, p: [f64; 3], voxels: &dyn Voxels) -> Vec<f64> {
    let tape = Tape::new(graph, &[node]);
    let tables = Tables::evaluate(graph, &[], 0.0);
    let environment = Environment { position: p.map(|v| [v; LANES]), tables: &tables, ..Environment::default() };
    let mut scratch = tape.scratch();
    tape.run(&environment, voxels, &mut scratch);
    tape.root(&scratch, 0).iter().map(|lanes| lanes[0]).collect()
}

pub(crate) fn at(graph: &Graph, node: NodeId, p: [f64; 3]) -> Vec<f64> {
    at_with(graph, node, p, &NoVoxels)
}

pub(crate) fn close(a: f64, b: f64, tolerance: f64) -> bool {
    a == b || (a - b).abs() <= tolerance * (1.0 + a.abs().max(b.abs()))
}
