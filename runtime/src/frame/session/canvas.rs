//! What the parts of a program write, brought together: pictures from tiles, answers from rays.

use super::{Engine, RayAnswer};
use crate::engine::gpu::{GpuError, PackedRay, Tile, Timing};
use crate::frame::{FaultTally, Frame, Origins};
use compiler::program::{OutputKind, Program};

/// Draws the wanted parts of a program, one after another.
pub(super) fn draw_parts(
    engine: &mut Engine,
    frame: &Frame,
    canvas: &mut Canvas,
    wanted: &dyn Fn(usize) -> bool,
    progress: &mut dyn FnMut(&Canvas),
) -> Result<Timing, GpuError> {
    let parts = engine.prepared();
    let several = parts.len() > 1;
    let mut all = Timing::default();
    for (part, prepared) in parts.iter_mut().enumerate().filter(|(part, _)| wanted(*part)) {
        // A pixel that goes wrong in several parts is one pixel.
        let before = std::mem::take(&mut canvas.faults);
        let timing = prepared.draw(&frame.of_part(part), &mut |tile, records| {
            canvas.take(part, tile, records);
            progress(canvas);
        })?;
        canvas.faults.join(before);
        all = all.and(timing);
        if several {
            prepared.rest();
        }
    }
    Ok(all)
}

/// Follows rays through every part of a program. `take` gets the number of the ray and its record in that part.
pub(super) fn trace_parts(
    engine: &mut Engine,
    program: &Program,
    frame: &Frame,
    rays: &[PackedRay],
    take: &mut dyn FnMut(&Reader, usize, &[f32]),
) -> Result<Timing, GpuError> {
    let several = !program.further.is_empty();
    let mut all = Timing::default();
    for (part, (reader, prepared)) in Reader::of_parts(program).iter().zip(engine.prepared()).enumerate() {
        let mut ray = 0;
        let timing = prepared.trace(&frame.of_part(part), rays, &mut |_, records| {
            for record in records.chunks_exact(reader.stride) {
                take(reader, ray, record);
                ray += 1;
            }
        })?;
        all = all.and(timing);
        if several {
            prepared.rest();
        }
    }
    Ok(all)
}

/// Reads quantities out of the records of one part of a program.
#[derive(Clone, Debug)]
pub(super) struct Reader {
    outputs: Vec<compiler::program::Output>,
    pub(super) stride: usize,
    /// Bands of the picture that this part draws, with their places among its own.
    bands: Vec<(usize, usize)>,
    /// Whether this is the first part, which alone says what is the same in all.
    first: bool,
}

impl Reader {
    pub(super) fn of_parts(program: &Program) -> Vec<Self> {
        let reader = |(part, program_part): (usize, &Program)| {
            let places = program.places.iter().enumerate().filter(|(_, place)| place.part == part);
            Self {
                outputs: program_part.plan.outputs.clone(),
                stride: program_part.plan.stride.max(1) as usize,
                bands: places.map(|(band, place)| (band, place.band)).collect(),
                first: part == 0,
            }
        };
        program.parts().enumerate().map(reader).collect()
    }

    fn find(&self, kind: OutputKind) -> Option<compiler::program::Output> {
        self.outputs.iter().copied().find(|o| o.kind == kind)
    }

    /// The number of each band of the picture that this part draws; a quantity of width 1 is the same in all. Nothing if it
    /// was not asked for.
    pub(super) fn bands<'r>(&'r self, record: &'r [f32], kind: OutputKind) -> impl Iterator<Item = (usize, f32)> + 'r {
        let output = self.find(kind);
        let (offset, width) = output.map_or((0, 1), |o| (o.offset as usize, o.width.max(1) as usize));
        let bands = if output.is_some() { self.bands.as_slice() } else { &[] };
        bands.iter().map(move |(band, own)| (*band, record[offset + (*own).min(width - 1)]))
    }

    /// Writes what a record of a probe says into the answer of its ray.
    pub(super) fn answer(&self, record: &[f32], answer: &mut RayAnswer) {
        let lists = [
            (OutputKind::Radiance, &mut answer.radiance),
            (OutputKind::Transmittance, &mut answer.transmittance),
            (OutputKind::Error, &mut answer.error),
        ];
        for (kind, list) in lists {
            self.bands(record, kind).for_each(|(band, value)| list[band] = f64::from(value));
        }
        for (band, value) in self.bands(record, OutputKind::OpticalDepth) {
            answer.optical_depth[band] = unbounded(f64::from(value));
        }
        answer.evaluations += self.number(record, OutputKind::Evaluations).map_or(0, |n| n as u64);
    }

    pub(super) fn number(&self, record: &[f32], kind: OutputKind) -> Option<f32> {
        self.find(kind).map(|o| record[o.offset as usize])
    }

    pub(super) fn fault(&self, record: &[f32], faults: &mut FaultTally) {
        if let Some(o) = self.find(OutputKind::Fault) {
            let at = o.offset as usize;
            let position = std::array::from_fn(|i| f64::from(record[at + 1 + i]));
            faults.add(record[at].to_bits(), position);
        }
    }
}

/// The picture while its tiles arrive.
#[derive(Clone, Debug)]
pub(super) struct Canvas {
    readers: Vec<Reader>,
    bands: usize,
    pub(super) size: [u32; 2],
    pub(super) white: f64,
    pub(super) accuracy: f64,
    filled: u64,
    total: u64,
    pub(super) radiance: Vec<f32>,
    pub(super) transmittance: Option<Vec<f32>>,
    pub(super) edges: Vec<bool>,
    pub(super) predicted: Option<(f64, f64)>,
    /// Of each pixel, the largest over its bands.
    pub(super) errors: Vec<f32>,
    pub(super) origins: Option<Origins>,
    pub(super) evaluations: Option<u64>,
    pub(super) faults: FaultTally,
}

impl Canvas {
    pub(super) fn new(program: &Program, size: [u32; 2], frame: &Frame) -> Self {
        let count = size[0] as usize * size[1] as usize;
        let bands = program.places.len();
        let has = |kind| program.plan.output(kind).is_some();
        Self {
            readers: Reader::of_parts(program),
            bands,
            size,
            white: frame.white,
            accuracy: frame.accuracy,
            filled: 0,
            total: count as u64 * program.parts().count() as u64,
            radiance: vec![0.0; count * bands],
            transmittance: has(OutputKind::Transmittance).then(|| vec![0.0; count * bands]),
            edges: if has(OutputKind::Edge) { vec![false; count] } else { vec![] },
            predicted: has(OutputKind::Error).then_some((0.0, 0.0)),
            origins: (has(OutputKind::Error) && has(OutputKind::Rounding) && has(OutputKind::Storage))
                .then(Origins::default),
            errors: if has(OutputKind::Error) { vec![0.0; count] } else { vec![] },
            evaluations: has(OutputKind::Evaluations).then_some(0),
            faults: FaultTally::default(),
        }
    }

    pub(super) fn done(&self) -> f64 {
        self.filled as f64 / self.total.max(1) as f64
    }

    pub(super) fn take(&mut self, part: usize, tile: Tile, records: &[f32]) {
        let [x0, y0] = tile.origin.map(|n| n as usize);
        let width = tile.size[0] as usize;
        let reader = self.readers[part].clone();
        for (i, record) in records.chunks_exact(reader.stride).enumerate() {
            self.put(&reader, (y0 + i / width) * self.size[0] as usize + x0 + i % width, record);
        }
    }

    /// Notes the record of a pixel, counted row by row.
    pub(super) fn put(&mut self, reader: &Reader, pixel: usize, record: &[f32]) {
        let own = pixel * self.bands..(pixel + 1) * self.bands;
        let mut brightest = 0.0f64;
        let slots = &mut self.radiance[own.clone()];
        for (band, value) in reader.bands(record, OutputKind::Radiance) {
            slots[band] = value;
            brightest = brightest.max(f64::from(value));
        }
        if let Some(transmittance) = &mut self.transmittance {
            let slots = &mut transmittance[own];
            reader.bands(record, OutputKind::Transmittance).for_each(|(band, value)| slots[band] = value);
        }
        let edge = reader.number(record, OutputKind::Edge).is_some_and(|e| e != 0.0);
        if let (Some(slot), true) = (self.edges.get_mut(pixel), reader.first) {
            *slot = edge;
        }
        // What is allowed follows the brightest band, which may be another part's: this is the stricter.
        if let (Some(most), Some(error)) = (&mut self.predicted, reader.number(record, OutputKind::Error)) {
            self.errors[pixel] = self.errors[pixel].max(error);
            let error = f64::from(error);
            if let Some(origins) = &mut self.origins {
                let part = |kind| reader.number(record, kind).map_or(0.0, f64::from);
                let (rounding, storage) = (part(OutputKind::Rounding), part(OutputKind::Storage));
                let discretisation = (error - rounding - storage).max(0.0);
                origins.widen(Origins { discretisation, rounding, storage, ..Origins::default() });
            }
            most.0 = most.0.max(error);
            most.1 = most.1.max(error / (self.accuracy * self.white.max(brightest)));
        }
        if let (Some(sum), Some(n)) = (&mut self.evaluations, reader.number(record, OutputKind::Evaluations)) {
            *sum += n as u64;
        }
        reader.fault(record, &mut self.faults);
        self.filled += 1;
    }
}

/// Kernels have no infinity: an integral that has no end is cut off at 3e38 before a coefficient scales it.
fn unbounded(depth: f64) -> f64 {
    if depth > 1e33 { f64::INFINITY } else { depth }
}
