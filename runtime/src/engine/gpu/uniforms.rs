//! Contents of the uniform block and of tables: evaluated in f64, stored as the shader sees them.

use crate::frame::{Frame, to_f32};
use compiler::ir::TableId;
use compiler::ir::eval::{Tables, evaluate_with};
use compiler::program::{FrameValue, Program, UniformField, UniformSource};

/// The part of a drawing that one dispatch covers.
#[derive(Copy, Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Part {
    /// First pixel of a tile.
    pub(super) origin: [u32; 2],
    /// Pixels of a tile.
    pub(super) size: [u32; 2],
    /// Rays of the list.
    pub(super) rays: u32,
    /// Of a sort.
    pub(super) sort: SortPart,
}

/// What a pass of a sort is about.
#[derive(Copy, Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SortPart {
    /// Things that are sorted.
    pub(super) count: u32,
    /// Word of their keys, and first bit of the digit in it.
    pub(super) word: u32,
    pub(super) shift: u32,
    /// Tallies that are summed up.
    pub(super) scanned: u32,
}

/// The uniform block of one drawing; [`Block::part`] fills in what changes from dispatch to dispatch.
#[derive(Clone, Debug)]
pub(super) struct Block {
    bytes: Vec<u8>,
    moving: Vec<UniformField>,
    /// Rounds of [`compiler::program::Pass::Rounds`].
    pub(super) rounds: u32,
}

impl Block {
    /// Evaluates everything that is the same in the whole drawing.
    pub(super) fn new(program: &Program, frame: &Frame, tables: &Tables) -> Self {
        let layout = &program.plan.uniforms;
        let nodes: Vec<_> = layout
            .fields
            .iter()
            .filter_map(|f| match f.source {
                UniformSource::Node(id) => Some(id),
                UniformSource::Majorant(_) | UniformSource::Bricks(..) | UniformSource::Frame(_) => None,
            })
            .collect();
        let graph = &program.optimised.graph;
        let mut values = evaluate_with(graph, &nodes, &frame.params, frame.time, tables).into_iter();
        let bounded = layout.fields.iter().any(|f| matches!(f.source, UniformSource::Majorant(_)));
        let majorants = if bounded { frame.majorants(graph) } else { vec![] };
        let mut block =
            Self { bytes: vec![0; layout.size as usize], moving: vec![], rounds: frame.footprints.rounds() };
        for field in &layout.fields {
            match field.source {
                UniformSource::Node(_) => block.store(field, &values.next().unwrap_or_default()),
                UniformSource::Majorant(node) => block.store(field, &[majorants[node.0 as usize].high]),
                UniformSource::Bricks(number, part) => {
                    let place = frame.own_bricks().get(number as usize).map_or([1.0; 3], |b| b.lattice(part));
                    block.store(field, &place);
                }
                UniformSource::Frame(value) => match still(value, frame) {
                    Some(value) => block.store(field, &value),
                    None => block.moving.push(field.clone()),
                },
            }
        }
        block
    }

    /// Of a sort alone, without a drawing.
    pub(super) fn of_sort(program: &Program) -> Self {
        let layout = &program.plan.uniforms;
        let sorts = |field: &&UniformField| match field.source {
            UniformSource::Frame(value) => !of_part(value, Part::default(), (0, 0)).is_empty(),
            UniformSource::Node(_) | UniformSource::Majorant(_) | UniformSource::Bricks(..) => false,
        };
        let moving = layout.fields.iter().filter(sorts).cloned().collect();
        Self { bytes: vec![0; layout.size as usize], moving, rounds: 1 }
    }

    /// The bytes for one dispatch: of the plan's repeats, and of rounds, those of these numbers.
    pub(super) fn part(&mut self, part: Part, (repeat, round): (u32, u32)) -> &[u8] {
        for field in std::mem::take(&mut self.moving) {
            if let UniformSource::Frame(value) = field.source {
                self.store(&field, &of_part(value, part, (repeat, round)));
            }
            self.moving.push(field);
        }
        &self.bytes
    }

    fn store(&mut self, field: &UniformField, values: &[f64]) {
        let start = field.offset as usize;
        for (slot, value) in self.bytes[start..].chunks_exact_mut(4).zip(values).take(field.width as usize) {
            let bits = if field.integer { *value as u32 } else { to_f32(*value).to_bits() };
            slot.copy_from_slice(&bits.to_ne_bytes());
        }
    }
}

/// The value, if it is the same in every dispatch.
fn still(value: FrameValue, frame: &Frame) -> Option<Vec<f64>> {
    let eye = &frame.eye;
    Some(match value {
        FrameValue::TileOrigin | FrameValue::TileSize | FrameValue::RayCount => return None,
        FrameValue::Repeat | FrameValue::Round => return None,
        FrameValue::SortCount | FrameValue::SortWord | FrameValue::SortShift | FrameValue::ScanLength => return None,
        FrameValue::ImageSize => frame.size.map(f64::from).to_vec(),
        FrameValue::CameraAnchor => eye.anchor.to_vec(),
        FrameValue::CameraForward => eye.forward.to_vec(),
        FrameValue::CameraRight => eye.right.to_vec(),
        FrameValue::CameraUp => eye.up.to_vec(),
        FrameValue::CameraPlane => vec![eye.plane],
        FrameValue::Accuracy => vec![frame.accuracy],
        FrameValue::White => vec![frame.white],
        FrameValue::Steps => vec![f64::from(frame.steps)],
        FrameValue::MaxWork => vec![f64::from(frame.max_work)],
        FrameValue::Paths => vec![f64::from(frame.paths)],
        FrameValue::FirstPath => vec![f64::from(frame.first_path)],
        FrameValue::Seed => vec![f64::from(frame.seed)],
        FrameValue::Rounds => vec![2.0],
        FrameValue::CacheLow => frame.lattice_of_columns().0.to_vec(),
        FrameValue::CacheSize => frame.lattice_of_columns().1.to_vec(),
        FrameValue::PixelScale => vec![f64::from(frame.size[1]) / 2.0],
        FrameValue::SlabStart => vec![frame.slabs.start],
        FrameValue::SlabNormal => frame.slabs.normal.to_vec(),
        FrameValue::SlabStep => vec![frame.slabs.step],
        FrameValue::SlabCount => vec![f64::from(frame.slabs.count)],
        FrameValue::LightCenter => frame.slabs.light.center.to_vec(),
        FrameValue::LightForward => frame.slabs.light.forward.to_vec(),
        FrameValue::LightRight => frame.slabs.light.axes[0].to_vec(),
        FrameValue::LightUp => frame.slabs.light.axes[1].to_vec(),
        FrameValue::LightCorner => frame.slabs.light.corner.to_vec(),
        FrameValue::LightNear => vec![frame.slabs.light.near],
        FrameValue::LightNodes => frame.slabs.light.counts.map(f64::from).to_vec(),
        FrameValue::BoundsLow => frame.slabs.bounds[0].to_vec(),
        FrameValue::BoundsHigh => frame.slabs.bounds[1].to_vec(),
        FrameValue::LatticeLow => frame.lattice.low.to_vec(),
        FrameValue::LatticeSpacing => vec![frame.lattice.spacing],
        FrameValue::Lean => vec![frame.lean],
        FrameValue::LatticeCounts => frame.lattice.counts.map(f64::from).to_vec(),
        FrameValue::ListEdge => vec![f64::from(frame.footprints.edge())],
        FrameValue::RoundCount => vec![f64::from(frame.footprints.rounds())],
        FrameValue::ListEntries => vec![f64::from(frame.footprints.entries())],
        FrameValue::ListColumns => vec![f64::from(frame.footprints.columns())],
    })
}

fn of_part(value: FrameValue, part: Part, (repeat, round): (u32, u32)) -> Vec<f64> {
    match value {
        FrameValue::TileOrigin => part.origin.map(f64::from).to_vec(),
        FrameValue::TileSize => part.size.map(f64::from).to_vec(),
        FrameValue::RayCount => vec![f64::from(part.rays)],
        FrameValue::Repeat => vec![f64::from(repeat)],
        FrameValue::Round => vec![f64::from(round)],
        FrameValue::SortCount => vec![f64::from(part.sort.count)],
        FrameValue::SortWord => vec![f64::from(part.sort.word)],
        FrameValue::SortShift => vec![f64::from(part.sort.shift)],
        FrameValue::ScanLength => vec![f64::from(part.sort.scanned)],
        FrameValue::ImageSize
        | FrameValue::CameraAnchor
        | FrameValue::CameraForward
        | FrameValue::CameraRight
        | FrameValue::CameraUp
        | FrameValue::CameraPlane
        | FrameValue::Accuracy
        | FrameValue::White
        | FrameValue::Steps
        | FrameValue::MaxWork
        | FrameValue::Paths
        | FrameValue::FirstPath
        | FrameValue::Seed
        | FrameValue::Rounds
        | FrameValue::CacheLow
        | FrameValue::CacheSize
        | FrameValue::PixelScale
        | FrameValue::SlabStart
        | FrameValue::SlabNormal
        | FrameValue::SlabStep
        | FrameValue::SlabCount
        | FrameValue::LightCenter
        | FrameValue::LightForward
        | FrameValue::LightRight
        | FrameValue::LightUp
        | FrameValue::LightCorner
        | FrameValue::LightNear
        | FrameValue::LightNodes
        | FrameValue::BoundsLow
        | FrameValue::BoundsHigh
        | FrameValue::LatticeLow
        | FrameValue::LatticeSpacing
        | FrameValue::Lean
        | FrameValue::LatticeCounts
        | FrameValue::ListEdge
        | FrameValue::RoundCount
        | FrameValue::ListEntries
        | FrameValue::ListColumns => vec![],
    }
}

/// A table as the shader reads it: per row its key, then its values.
pub(super) fn table_rows(tables: &Tables, id: TableId) -> Vec<f32> {
    let table = tables.get(id);
    let mut rows = Vec::with_capacity(table.keys.len() * (table.width + 1));
    for (key, values) in table.keys.iter().zip(table.values.chunks(table.width.max(1))) {
        rows.push(to_f32(*key));
        rows.extend(values.iter().map(|v| to_f32(*v)));
    }
    rows
}
