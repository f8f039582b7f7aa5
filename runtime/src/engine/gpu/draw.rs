//! Drawing: a program made ready once, drawn as often as wanted.

use super::adapter::{Gpu, TARGET_SIDE, TILE_BYTES};
use super::errors::{GpuError, GpuErrorKind};
use super::pipelines::Pipelines;
use super::readback::{Flight, Once, Slot};
use super::resources::{Resources, SceneData, Uploads};
use super::sorting::{DIGITS, Sorting, read};
use super::tiles::{Pace, Walk};
use super::uniforms::{Block, Part};
use crate::frame::{Bricks, Frame};
use compiler::emit::Shader;
use compiler::ir::eval::Tables;
use compiler::program::{Binding, Geometry, Pass, Program, RaySource};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

/// Dispatches under way at once: one computes while another is read back.
const IN_FLIGHT: usize = 2;

/// A ray as kernels read it: origin xyz, least t, direction xyz, 0, in the scene's units.
pub type PackedRay = [f32; 8];

/// What one dispatch covered: `size[0] · size[1]` records, row by row, from `origin`. For a list of rays, the first
/// component alone counts.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// First pixel, or first ray.
    pub origin: [u32; 2],
    /// Pixels, or rays and 1.
    pub size: [u32; 2],
}

/// What a time was measured with.
#[derive(Copy, Clone, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// Time stamps of the GPU, summed over the dispatches.
    #[default]
    Gpu,
    /// The wall clock, from the first submission to the last readback.
    Wall,
}

/// What a drawing cost.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub struct Timing {
    /// How long it took, what is worked out once for a picture included (by the wall clock), but for arranging splats.
    pub milliseconds: f64,
    /// By which clock.
    pub clock: Clock,
    /// How many dispatches it was cut into.
    pub dispatches: u32,
    /// What went before, where there are splats.
    pub arranging: Arranging,
}

/// How splats were arranged on the device before a picture was drawn.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub struct Arranging {
    /// Splats that are drawn.
    pub drawn: u32,
    /// Those that are not: empty, behind the eye, or without a finite picture.
    pub unseen: u32,
    /// Milliseconds by the wall clock to put them in order of depth.
    pub order: f64,
    /// The same, to make lists of them.
    pub lists: f64,
}

impl Timing {
    /// With that of another drawing, made before or after.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let clock = if other.clock == Clock::Wall { Clock::Wall } else { self.clock };
        let milliseconds = self.milliseconds + other.milliseconds;
        let (a, b) = (self.arranging, other.arranging);
        // Parts of a program and drawings that lean have the same splats.
        let arranging = Arranging {
            drawn: a.drawn.max(b.drawn),
            unseen: a.unseen.max(b.unseen),
            order: a.order + b.order,
            lists: a.lists + b.lists,
        };
        Self { milliseconds, clock, dispatches: self.dispatches + other.dispatches, arranging }
    }
}

impl Clock {
    /// As in what `render` says.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Gpu => "gpu",
            Self::Wall => "wall",
        }
    }
}

/// Where the rays of a dispatch come from.
#[derive(Copy, Clone, Debug)]
pub(super) enum Source<'a> {
    Camera,
    List(&'a [PackedRay]),
}

/// A program on a device: pipelines, grids and buffers. Parameters are data here, never code.
#[derive(Debug)]
pub struct Prepared {
    gpu: Arc<Gpu>,
    program: Arc<Program>,
    pipelines: Pipelines,
    resources: Resources,
    slots: Vec<Slot>,
    /// Parameters and time that the tables hold.
    tables: Option<(Vec<Vec<f64>>, f64, Tables)>,
    /// The bounds of media that the device holds.
    bricks: Option<Arc<Vec<Vec<Bricks>>>>,
    /// Of the drawing that is under way.
    arranging: Arranging,
    /// Milliseconds that were spent for it on what is kept of light.
    filling: f64,
}

impl Gpu {
    /// Compiles the kernels of every part of a program and uploads what they read, once for all of them. `shaders[i][j]` is
    /// kernel `j` of part `i`.
    ///
    /// # Errors
    /// When memory does not suffice or the driver refuses.
    pub fn prepare(
        self: &Arc<Self>,
        program: &Arc<Program>,
        shaders: Vec<Vec<Shader>>,
        data: SceneData<'_>,
    ) -> Result<Vec<Prepared>, GpuError> {
        let mut uploads = Uploads::default();
        let parts = std::iter::once(program).chain(&program.further);
        let one = |(part, shaders): (&Arc<Program>, Vec<Shader>)| {
            self.prepare_part(part, shaders.into_iter().map(|s| s.module).collect(), data, &mut uploads)
        };
        parts.zip(shaders).map(one).collect()
    }

    #[cfg(test)]
    pub(super) fn prepare_modules(
        self: &Arc<Self>,
        program: &Arc<Program>,
        modules: Vec<naga::Module>,
        data: SceneData<'_>,
    ) -> Result<Prepared, GpuError> {
        self.prepare_part(program, modules, data, &mut Uploads::default())
    }

    fn prepare_part(
        self: &Arc<Self>,
        program: &Arc<Program>,
        modules: Vec<naga::Module>,
        data: SceneData<'_>,
        uploads: &mut Uploads,
    ) -> Result<Prepared, GpuError> {
        let pipelines = Pipelines::new(self, program, modules)?;
        let resources = Resources::new(self, program, data, uploads)?;
        Ok(Prepared {
            gpu: Arc::clone(self),
            program: Arc::clone(program),
            pipelines,
            resources,
            slots: vec![],
            tables: None,
            bricks: None,
            arranging: Arranging::default(),
            filling: 0.0,
        })
    }
}

impl Prepared {
    /// The device it is on.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Draws the camera's picture. `take` gets the records of each tile as it arrives: `plan.stride` floats each.
    ///
    /// # Errors
    /// When the device is lost, runs out of memory, or the plan wants a list of rays.
    pub fn draw(&mut self, frame: &Frame, take: &mut dyn FnMut(Tile, &[f32])) -> Result<Timing, GpuError> {
        self.expect(RaySource::Camera)?;
        self.run(frame, Source::Camera, frame.size, take)
    }

    /// Follows a list of rays, or of pixels where the plan fills others in; `take` gets their records in parts, in order.
    ///
    /// # Errors
    /// When the device is lost, runs out of memory, or the plan draws every pixel of a camera.
    pub fn trace(
        &mut self,
        frame: &Frame,
        rays: &[PackedRay],
        take: &mut dyn FnMut(Tile, &[f32]),
    ) -> Result<Timing, GpuError> {
        if self.program.plan.survey.is_none() {
            self.expect(RaySource::List)?;
        }
        let count = u32::try_from(rays.len())
            .map_err(|_| GpuError::new(GpuErrorKind::TooLarge, "more than 4294967295 rays at once"))?;
        self.run(frame, Source::List(rays), [count, 1], take)
    }

    /// What tells the pixels of the frame apart, row by row: see [`compiler::program::Plan::survey`]. Nothing if the plan draws every pixel.
    ///
    /// # Errors
    /// When the device is lost, or the picture is larger than what it binds at once.
    pub fn survey(&mut self, frame: &Frame) -> Result<Vec<u32>, GpuError> {
        if self.program.plan.survey.is_none() {
            return Ok(vec![]);
        }
        self.gpu.watch.check()?;
        let pixels = frame.size.iter().map(|n| u64::from(*n)).product::<u64>();
        let most = self.gpu.limits().max_storage_buffer_binding_size.min(u64::from(u32::MAX));
        // Buffers grow to powers of two.
        if (4 * pixels).next_power_of_two() > most {
            let message = format!("this adapter does not tell {pixels} pixels apart at once");
            return Err(GpuError::new(GpuErrorKind::TooLarge, message).hint("draw with `pixels = every`"));
        }
        let pixels = pixels as u32;
        let mut block = self.evaluate(frame);
        if self.resources.hold_survey(&self.gpu, pixels) {
            self.slots.clear();
        }
        self.once(&mut block, Once::Survey, pixels)?;
        self.resources.survey.as_ref().map_or(Ok(vec![]), |buffer| read(&self.gpu, buffer, pixels))
    }

    /// Gives back the memory that only drawing needs, so that parts drawn one after another do not all hold theirs.
    pub fn rest(&mut self) {
        self.slots.clear();
    }

    /// Sorts keys by the plan's own sort: `keys` has word w of key i of n at w·n + i, the least significant word first. Gives the
    /// numbers of the keys in order, and the seconds that took on the device, without the way there and back.
    ///
    /// # Errors
    /// When the device is lost, runs out of memory, or the plan sorts nothing.
    pub fn sort(&mut self, keys: &[u32]) -> Result<(Vec<u32>, f64), GpuError> {
        let (Some(sort), Some(steps)) = (self.program.plan.sort(), &self.pipelines.sort) else {
            return Err(GpuError::new(GpuErrorKind::Validation, "this program sorts nothing"));
        };
        let too_many = |_| GpuError::new(GpuErrorKind::TooLarge, "more than 4294967295 keys at once");
        let count = u32::try_from(keys.len() / sort.words.max(1) as usize).map_err(too_many)?;
        let size = (count, keys.len() as u64);
        if Sorting::hold(&mut self.resources.sorting, &self.gpu, &self.program, size)? {
            self.slots.clear();
        }
        let Some(sorting) = &self.resources.sorting else { return Ok((vec![], 0.0)) };
        self.gpu.queue.write_buffer(sorting.keys(), 0, bytemuck::cast_slice(keys));
        self.gpu.finish(Instant::now())?;
        let started = Instant::now();
        sorting.run(
            &self.gpu,
            &self.program,
            steps,
            &mut Block::of_sort(&self.program),
            (count, sort.words * DIGITS),
        )?;
        let seconds = 1e-3 * self.gpu.finish(started)?;
        Ok((read(&self.gpu, sorting.order(), count)?, seconds))
    }

    /// Nodes of a lattice in the order in which they are drawn.
    #[cfg(test)]
    pub(super) fn nodes(&mut self, frame: &Frame) -> Result<Vec<u32>, GpuError> {
        let mut block = self.evaluate(frame);
        self.once_for_all(frame, &mut block)?;
        match &self.resources.sorting {
            Some(sorting) => read(&self.gpu, sorting.order(), self.resources.drawn),
            None => Ok(vec![]),
        }
    }

    /// Lists of a frame as the device makes them, with their heads.
    #[cfg(test)]
    pub(super) fn lists(&mut self, frame: &Frame) -> Result<Vec<u32>, GpuError> {
        let mut block = self.evaluate(frame);
        self.list_footprints(frame, &mut block)?;
        let length = frame.footprints.heads().len() as u32 + frame.footprints.entries();
        match self.resources.sorting.as_ref().and_then(Sorting::lists) {
            Some(lists) => read(&self.gpu, lists, length),
            None => Ok(vec![]),
        }
    }

    fn expect(&self, rays: RaySource) -> Result<(), GpuError> {
        if self.program.plan.rays == rays {
            return Ok(());
        }
        Err(GpuError::new(GpuErrorKind::Validation, "this program was compiled for another source of rays"))
    }

    fn run(
        &mut self,
        frame: &Frame,
        source: Source<'_>,
        size: [u32; 2],
        take: &mut dyn FnMut(Tile, &[f32]),
    ) -> Result<Timing, GpuError> {
        let result = self.tiles(frame, source, size, take);
        if result.is_err() {
            // A given-up dispatch leaves its buffers mapped or in use.
            self.slots.clear();
        }
        result
    }

    /// Evaluates the tables if the parameters or the time changed.
    fn evaluate(&mut self, frame: &Frame) -> Block {
        let fresh = matches!(&self.tables, Some((p, t, _)) if *p == frame.params && *t == frame.time);
        if !fresh {
            let tables = Tables::evaluate(&self.program.optimised.graph, &frame.params, frame.time);
            self.resources.write_tables(&self.gpu, &tables);
            self.tables = Some((frame.params.clone(), frame.time, tables));
        }
        if !self.bricks.as_ref().is_some_and(|held| Arc::ptr_eq(held, &frame.bricks)) {
            self.resources.write_bounds(&self.gpu, frame.own_bricks());
            self.bricks = Some(Arc::clone(&frame.bricks));
        }
        let none = Tables::default();
        let tables = self.tables.as_ref().map_or(&none, |(_, _, t)| t);
        Block::new(&self.program, frame, tables)
    }

    /// Runs what runs once for a picture over some nodes, in dispatches that are short enough for watchdogs.
    fn once(&mut self, block: &mut Block, once: Once, nodes: u32) -> Result<(), GpuError> {
        // A first guess of what a dispatch can do in a tenth of a second, corrected by what each one took.
        let (mut first, mut count) = (0u32, 4096u32);
        if self.slots.is_empty() {
            self.slots.push(Slot::new(&self.gpu, &self.program, &self.pipelines, &self.resources, 1)?);
        }
        while first < nodes {
            let rays = count.min(nodes - first);
            let part = Part { origin: [first, 0], size: [rays, 1], rays, ..Part::default() };
            let started = Instant::now();
            let with = (&self.pipelines, &self.resources);
            self.slots[0].fill(&self.gpu, &self.program, with, (once, rays), block.part(part, (0, 0)))?;
            let seconds = started.elapsed().as_secs_f64().max(1e-6);
            first += rays;
            let ideal = f64::from(rays) * 0.1 / seconds;
            count = (ideal as u32).clamp(256, 4 * rays).min(65535 * 64);
        }
        Ok(())
    }

    /// Runs what runs once for a picture.
    fn once_for_all(&mut self, frame: &Frame, block: &mut Block) -> Result<(), GpuError> {
        let (fill, plant) = (self.program.plan.fill.as_ref().map(|f| f.nodes), self.program.plan.plant);
        if let Some(plant) = plant {
            let most = self.gpu.limits().max_storage_buffer_binding_size;
            if u64::from(frame.lattice.len()) * u64::from(plant.stride) * 4 > most {
                let message = format!("{} splats are more than this adapter holds", frame.lattice.len());
                return Err(GpuError::new(GpuErrorKind::TooLarge, message).hint("ask for fewer `splats`"));
            }
            let count = frame.lattice.len();
            let size = (count, u64::from(count) * u64::from(plant.sort.words));
            let moved = Sorting::hold(&mut self.resources.sorting, &self.gpu, &self.program, size)?;
            if self.resources.hold_splats(&self.gpu, count, plant.stride) || moved {
                self.slots.clear();
            }
        }
        if let Some(nodes) = fill {
            let started = Instant::now();
            self.once(block, Once::Fill, nodes)?;
            self.filling = started.elapsed().as_secs_f64() * 1e3;
        }
        if plant.is_some() {
            self.once(block, Once::Plant, frame.lattice.len())?;
            self.once(block, Once::Doubt, frame.lattice.len())?;
            self.once(block, Once::Rank, frame.lattice.len())?;
            self.put_in_order(block, frame.lattice.len())?;
        }
        Ok(())
    }

    /// Sorts as many splats by the keys that they have been given, and notes how many are drawn.
    fn put_in_order(&mut self, block: &mut Block, count: u32) -> Result<(), GpuError> {
        let (steps, sorting) = (&self.pipelines.sort, &self.resources.sorting);
        if let (Some(steps), Some(sorting), Some(sort)) = (steps, sorting, self.program.plan.sort()) {
            let started = Instant::now();
            sorting.run(&self.gpu, &self.program, steps, block, (count, sort.words * DIGITS))?;
            self.arranging.order = self.gpu.finish(started)?;
            self.resources.drawn = match &self.pipelines.drawn {
                Some(step) => sorting.drawn(&self.gpu, &self.program, step, block, count)?,
                None => count,
            };
            self.arranging.drawn = self.resources.drawn;
            self.arranging.unseen = count - self.resources.drawn;
        }
        Ok(())
    }

    /// Brings splats of files to the device, puts them in order there, and makes the lists of tiles.
    fn list_footprints(&mut self, frame: &Frame, block: &mut Block) -> Result<(), GpuError> {
        let (Some(sort), Some(lists)) = (&self.pipelines.sort, &self.pipelines.lists) else { return Ok(()) };
        let shown = &frame.footprints;
        let records = shown.records(frame.part);
        let most = self.gpu.limits().max_storage_buffer_binding_size;
        let bytes = 4 * records.len() as u64;
        // Buffers grow to powers of two.
        if bytes.next_power_of_two() > most {
            let message =
                format!("the splats take {} MB, and this adapter binds {} MB at once", bytes >> 20, most >> 20);
            return Err(GpuError::new(GpuErrorKind::TooLarge, message)
                .hint("draw with `--engine cpu`, or prune the file of splats"));
        }
        (self.arranging.drawn, self.arranging.unseen) = (shown.len(), shown.unseen());
        let mut moved = self.resources.write_footprints(&self.gpu, records);
        let (count, entries) = (shown.len(), shown.entries());
        let size = (count.max(entries), (shown.keys().len() as u64).max(entries.into()));
        moved |= Sorting::hold(&mut self.resources.sorting, &self.gpu, &self.program, size)?;
        if let Some(sorting) = &mut self.resources.sorting {
            moved |= sorting.write_lists(&self.gpu, shown)?;
            let digits = self.program.plan.sort().map_or(0, |s| s.words * DIGITS);
            // On their way before the clock starts.
            self.gpu.finish(Instant::now())?;
            let started = Instant::now();
            sorting.run(&self.gpu, &self.program, sort, block, (count, digits))?;
            self.arranging.order = self.gpu.finish(started)?;
            let started = Instant::now();
            sorting.list(&self.gpu, &self.program, (sort, lists), block, shown)?;
            self.arranging.lists = self.gpu.finish(started)?;
        }
        if moved {
            self.slots.clear();
        }
        Ok(())
    }

    fn tiles(
        &mut self,
        frame: &Frame,
        source: Source<'_>,
        size: [u32; 2],
        take: &mut dyn FnMut(Tile, &[f32]),
    ) -> Result<Timing, GpuError> {
        self.gpu.watch.check()?;
        (self.arranging, self.filling) = (Arranging::default(), 0.0);
        let mut block = self.evaluate(frame);
        let drawn = self.program.plan.bindings.contains(&Binding::Outlines);
        if drawn && self.resources.write_outlines(&self.gpu, &frame.slabs) {
            self.slots.clear();
        }
        if self.program.plan.footprints.is_some() {
            self.list_footprints(frame, &mut block)?;
        }
        if !frame.goes_on {
            self.once_for_all(frame, &mut block)?;
        }
        let plan = &self.program.plan;
        let record = u64::from(plan.stride.max(plan.notes).max(plan.carried).max(1)) * 4;
        let bytes = match source {
            Source::Camera => record,
            Source::List(_) => record.max(size_of::<PackedRay>() as u64),
        };
        let total = u64::from(size[0]) * u64::from(size[1]);
        let work = plan.work_per_ray.max(1).saturating_mul(plan.samples.max(1));
        let in_parts =
            |p: &Pass| matches!(p, Pass::Raster { geometry: Geometry::Billboards, .. } | Pass::Alternate { .. });
        let mut pace = if plan.passes.iter().any(in_parts) {
            Pace::steady(total, TILE_BYTES / bytes)
        } else {
            Pace::new(work, total, TILE_BYTES / bytes)
        };
        let first = plan.passes.iter().flat_map(Pass::kernels).next();
        let group = first.map_or([1; 3], |k| self.program.kernels[k as usize].workgroup());
        let mut walk = Walk::new(size, [group[0], group[1]]);
        if !plan.targets.is_empty() {
            walk = walk.within(TARGET_SIDE);
        }
        let largest = pace.most().min(total);
        if !self.slots.iter().all(|s| s.holds(&self.program, largest)) {
            self.slots.clear();
        }
        let mut free: Vec<usize> = (0..IN_FLIGHT).collect();
        let mut flights: VecDeque<Flight> = VecDeque::new();
        let started = Instant::now();
        let (mut last, mut stamped, mut dispatches, mut unstamped) = (started, 0.0, 0, false);
        loop {
            while let Some(slot) = free.last().copied() {
                let Some(part) = walk.next(pace.budget()) else { break };
                while self.slots.len() <= slot {
                    let new = Slot::new(&self.gpu, &self.program, &self.pipelines, &self.resources, largest)?;
                    self.slots.push(new);
                }
                let with = (&self.pipelines, &self.resources);
                let flight = self.slots[slot].submit(&self.gpu, &self.program, with, (slot, part), &mut block, source);
                flights.push_back(flight?);
                free.pop();
                dispatches += 1;
            }
            let Some(flight) = flights.pop_front() else { break };
            let Flight { slot, part, submitted, .. } = flight;
            let tile = Tile::from(part);
            let mut done = started;
            let seconds = self.slots[slot].retire(&self.gpu, flight, &mut |records| {
                done = Instant::now();
                take(tile, records);
            })?;
            free.push(slot);
            // A dispatch starts when it is submitted or when the one before it ends.
            let wall = done.saturating_duration_since(submitted.max(last)).as_secs_f64();
            last = done;
            match seconds {
                Some(seconds) => stamped += seconds,
                None => unstamped = true,
            }
            let area = u64::from(part.size[0]) * u64::from(part.size[1]);
            // Stamps of some drivers miss work that they put off; the longer of the two is the safe one for pace.
            pace.took(area, seconds.unwrap_or(0.0).max(wall));
        }
        let gpu_clock = self.gpu.timestamps && !unstamped && dispatches > 0;
        Ok(Timing {
            milliseconds: self.filling + 1e3 * if gpu_clock { stamped } else { started.elapsed().as_secs_f64() },
            clock: if gpu_clock { Clock::Gpu } else { Clock::Wall },
            dispatches,
            arranging: self.arranging,
        })
    }
}

impl From<Part> for Tile {
    fn from(part: Part) -> Self {
        Self { origin: part.origin, size: part.size }
    }
}
