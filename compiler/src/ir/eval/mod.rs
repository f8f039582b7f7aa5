//! Evaluation in f64 on the CPU: the definition that every other evaluator is tested against.

mod draws;
mod grid;
pub mod mie;
mod sphere;
pub(crate) mod registers;
mod tape;

pub use draws::{Part, phase_draws};
pub use grid::{interpolate, interpolate_gradient};
pub use sphere::{PhaseFacts, PhasePlace, phase_facts, phase_facts_at, phase_facts_in};
pub use tape::{Environment, LANES, Lanes, Scratch, Tape};

use super::{Binary, Compare, Graph, GridId, NodeId, TableId, Unary};

/// Where voxels come from.
pub trait Voxels: Sync {
    /// The value (as the header scales it) at whole indices within the grid.
    fn voxel(&self, grid: GridId, index: [u32; 3]) -> f64;
}

/// For scenes without grids: every voxel is 0.
#[derive(Copy, Clone, Debug, Default)]
pub struct NoVoxels;

impl Voxels for NoVoxels {
    fn voxel(&self, _grid: GridId, _index: [u32; 3]) -> f64 {
        0.0
    }
}

/// The tables of a graph for one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tables(Vec<TableValues>);

/// One evaluated table.
#[derive(Clone, Debug, PartialEq)]
pub struct TableValues {
    /// Ascending keys.
    pub keys: Vec<f64>,
    /// `width` numbers per key.
    pub values: Vec<f64>,
    /// Components of a value.
    pub width: usize,
}

impl Tables {
    /// Evaluates the entries of every table, in order: an entry may read earlier tables. Params are in the graph's units.
    #[must_use]
    pub fn evaluate(graph: &Graph, params: &[Vec<f64>], time: f64) -> Self {
        let mut tables = Self::default();
        for table in &graph.tables {
            let flat = |nodes: &[NodeId]| -> Vec<f64> {
                evaluate_with(graph, nodes, params, time, &tables).into_iter().flatten().collect()
            };
            let (keys, values) = (flat(&table.keys), flat(&table.values));
            tables.0.push(TableValues { keys, values, width: table.width as usize });
        }
        tables
    }

    /// The table with this id.
    #[must_use]
    pub fn get(&self, id: TableId) -> &TableValues {
        &self.0[id.0 as usize]
    }
}

impl TableValues {
    /// The segment that holds at `x`: row before, row after and the position between them in 0..1.
    /// Both rows are equal beyond the ends.
    #[must_use]
    pub fn segment(&self, x: f64) -> (usize, usize, f64) {
        let after = self.keys.partition_point(|k| *k <= x);
        if after == 0 {
            return (0, 0, 0.0);
        }
        if after == self.keys.len() {
            return (after - 1, after - 1, 0.0);
        }
        let (low, high) = (self.keys[after - 1], self.keys[after]);
        (after - 1, after, (x - low) / (high - low))
    }

    /// Component `c` at `x`.
    #[must_use]
    pub fn value(&self, x: f64, c: usize) -> f64 {
        let (i, j, t) = self.segment(x);
        let (a, b) = (self.values[i * self.width + c], self.values[j * self.width + c]);
        if i == j { a } else { a + (b - a) * t }
    }

    /// Slope of component `c` at `x`.
    #[must_use]
    pub fn slope(&self, x: f64, c: usize) -> f64 {
        let (i, j, _) = self.segment(x);
        if i == j {
            return 0.0;
        }
        (self.values[j * self.width + c] - self.values[i * self.width + c]) / (self.keys[j] - self.keys[i])
    }
}

/// Evaluates nodes of tier Frame or lower. Params are in the graph's units, `time` in seconds.
#[must_use]
pub fn evaluate_frame(graph: &Graph, nodes: &[NodeId], params: &[Vec<f64>], time: f64) -> Vec<Vec<f64>> {
    let tables = Tables::evaluate(graph, params, time);
    evaluate_with(graph, nodes, params, time, &tables)
}

/// As [`evaluate_frame`], with tables that are evaluated already.
#[must_use]
pub fn evaluate_with(
    graph: &Graph,
    nodes: &[NodeId],
    params: &[Vec<f64>],
    time: f64,
    tables: &Tables,
) -> Vec<Vec<f64>> {
    let tape = Tape::new(graph, nodes);
    let environment = Environment { time, params, tables, ..Environment::default() };
    let mut scratch = tape.scratch();
    tape.run(&environment, &NoVoxels, &mut scratch);
    (0..nodes.len()).map(|i| tape.root(&scratch, i).iter().map(|lane| lane[0]).collect()).collect()
}

/// A componentwise operation on numbers. [`Unary::Not`] takes and gives 0 or 1.
#[must_use]
pub fn unary(op: Unary, a: f64) -> f64 {
    match op {
        Unary::Neg => -a,
        Unary::Abs => a.abs(),
        Unary::Sign => {
            if a > 0.0 {
                1.0
            } else if a < 0.0 {
                -1.0
            } else {
                a * 0.0
            }
        }
        Unary::Floor => a.floor(),
        Unary::Ceil => a.ceil(),
        Unary::Round => a.round_ties_even(),
        Unary::Sqrt => a.sqrt(),
        Unary::Exp => a.exp(),
        Unary::Expm1 => a.exp_m1(),
        Unary::Log => a.ln(),
        Unary::Sin => a.sin(),
        Unary::Cos => a.cos(),
        Unary::Tan => a.tan(),
        Unary::Asin => a.asin(),
        Unary::Acos => a.acos(),
        Unary::Atan => a.atan(),
        Unary::Sinh => a.sinh(),
        Unary::Cosh => a.cosh(),
        Unary::Tanh => a.tanh(),
        Unary::Not => 1.0 - a,
    }
}

/// A componentwise operation on numbers. And/Or take and give 0 or 1. Min and Max give NaN if either side is NaN.
#[must_use]
pub fn binary(op: Binary, a: f64, b: f64) -> f64 {
    match op {
        Binary::Add => a + b,
        Binary::Sub => a - b,
        Binary::Mul => a * b,
        Binary::Div => a / b,
        Binary::Min => {
            if a.is_nan() || a < b {
                a
            } else {
                b
            }
        }
        Binary::Max => {
            if a.is_nan() || a > b {
                a
            } else {
                b
            }
        }
        Binary::Pow => a.powf(b),
        Binary::Atan2 => a.atan2(b),
        Binary::Mod => a - b * (a / b).floor(),
        Binary::And => a * b,
        Binary::Or => a.max(b),
    }
}

/// A comparison.
#[must_use]
pub fn compare(op: Compare, a: f64, b: f64) -> bool {
    match op {
        Compare::Less => a < b,
        Compare::LessEqual => a <= b,
        Compare::Equal => a == b,
    }
}

fn whole(x: f64) -> u32 {
    // `as` saturates and takes NaN to 0, as WGSL's conversion does.
    (x.floor().clamp(f64::from(i32::MIN), 2_147_483_520.0)) as i32 as u32
}

/// Three uniform numbers in [0, 1) with 24 bits each, from a cell and a seed. PCG3D: Jarzynski and Olano,
/// "Hash Functions for GPU Rendering", JCGT 9(3), 2020. The seed is added first, scaled by three odd constants.
/// The upper clamp is the largest f32 below 2³¹, so that f32 and f64 agree.
#[must_use]
pub fn cell_hash(cell: [f64; 3], seed: f64) -> [f64; 3] {
    let s = whole(seed);
    let mut v = [
        whole(cell[0]).wrapping_add(s.wrapping_mul(0x9E37_79B9)),
        whole(cell[1]).wrapping_add(s.wrapping_mul(0x85EB_CA6B)),
        whole(cell[2]).wrapping_add(s.wrapping_mul(0xC2B2_AE35)),
    ];
    for x in &mut v {
        *x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    }
    let mix = |v: &mut [u32; 3]| {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    };
    mix(&mut v);
    for x in &mut v {
        *x ^= *x >> 16;
    }
    mix(&mut v);
    v.map(|x| f64::from(x >> 8) * (1.0 / 16_777_216.0))
}
