//! One dispatch in flight: its buffers, its way to the GPU and back.

use super::adapter::Gpu;
use super::draw::Source;
use super::errors::GpuError;
use super::pipelines::{Pipeline, Pipelines, Step, target_format};
use super::resources::Resources;
use super::uniforms::{Block, Part};
use compiler::program::{Binding, Blend, Extent, Geometry, Pass, Program, Target};
use std::ops::Range;
use std::sync::mpsc;
use std::time::Instant;

/// Bytes of the two time stamps behind the records.
const STAMPS: u64 = 16;
/// A copy of records may end at any multiple of 4; stamps want 8.
const STAMP_ALIGNMENT: u64 = 8;

/// Buffers of one dispatch, used again when it is done.
#[derive(Debug)]
pub(super) struct Slot {
    capacity: u64,
    uniforms: Option<wgpu::Buffer>,
    rays: Option<wgpu::Buffer>,
    records: wgpu::Buffer,
    staging: wgpu::Buffer,
    stamps: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    notes: Option<wgpu::Buffer>,
    carried: Option<wgpu::Buffer>,
    targets: Targets,
    /// Those of the buffer of light.
    light: Targets,
    groups: Groups,
}

/// What passes draw into, as large as the largest tile so far.
#[derive(Debug, Default)]
struct Targets {
    size: [u32; 2],
    views: Vec<wgpu::TextureView>,
}

impl Targets {
    /// Makes them so large at least. Gives whether they are others now.
    fn hold(&mut self, gpu: &Gpu, targets: &[Target], size: [u32; 2]) -> bool {
        let held = (0..2).all(|i| size[i] <= self.size[i]);
        if targets.is_empty() || held {
            return false;
        }
        let size: [u32; 2] = std::array::from_fn(|i| size[i].max(self.size[i]));
        let view = |target: &Target| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(&target.name),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: target_format(target),
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        *self = Self { size, views: targets.iter().map(view).collect() };
        true
    }

    /// A pass over so many of their pixels. They are cleared where a color is given.
    fn pass<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        [width, height]: [u32; 2],
        clear: Option<&dyn Fn(usize) -> wgpu::Color>,
        timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) -> wgpu::RenderPass<'e> {
        let attachment = |(number, view)| {
            let load = clear.map_or(wgpu::LoadOp::Load, |color| wgpu::LoadOp::Clear(color(number)));
            let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
            Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
        };
        let color_attachments: Vec<_> = self.views.iter().enumerate().map(attachment).collect();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("tile"),
            color_attachments: &color_attachments,
            depth_stencil_attachment: None,
            timestamp_writes,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        pass
    }
}

/// One bind group for each pass, and for the one that fills.
#[derive(Debug)]
struct Groups {
    passes: Vec<wgpu::BindGroup>,
    light: Option<wgpu::BindGroup>,
    fill: Option<wgpu::BindGroup>,
    plant: Option<wgpu::BindGroup>,
    doubt: Option<wgpu::BindGroup>,
    rank: Option<wgpu::BindGroup>,
    survey: Option<wgpu::BindGroup>,
}

/// A dispatch that has been submitted.
#[derive(Debug)]
pub(super) struct Flight {
    pub(super) slot: usize,
    pub(super) part: Part,
    pub(super) submitted: Instant,
    index: wgpu::SubmissionIndex,
    floats: usize,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
}

/// Billboards that are drawn at once.
const TOGETHER: u32 = 1 << 14;
/// Slabs likewise, where light meets one after another.
const TURNS: u32 = 32;

/// The instances of a pass, in parts; one of them where nothing is drawn.
fn instances(pass: &Pass, resources: &Resources, rounds: u32) -> Vec<Range<u32>> {
    match pass {
        Pass::Raster { geometry: Geometry::Billboards, .. } => {
            let count = resources.drawn;
            let starts = (0..count.max(1)).step_by(TOGETHER as usize);
            starts.map(|start| start..count.min(start + TOGETHER)).collect()
        }
        // Instances of a dispatch are rounds.
        Pass::Rounds { .. } => (0..rounds.max(1)).map(|round| round..round + 1).collect(),
        // Instances of what alternates are slabs.
        Pass::Alternate { .. } => {
            let count = resources.turns.0.len() as u32;
            let starts = (0..count.max(1)).step_by(TURNS as usize);
            starts.map(|start| start..count.min(start + TURNS)).collect()
        }
        Pass::Raster { geometry: Geometry::Outlines, .. } | Pass::Compute { .. } => std::iter::once(0..1).collect(),
    }
}

/// A pass that runs once for each picture, before its tiles.
#[derive(Copy, Clone, Debug)]
pub(super) enum Once {
    Fill,
    Plant,
    Doubt,
    Rank,
    Survey,
}

fn buffer(gpu: &Gpu, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
    gpu.device.create_buffer(&descriptor)
}

fn stamp_offset(records: u64) -> u64 {
    records.next_multiple_of(STAMP_ALIGNMENT)
}

impl Slot {
    /// Buffers for up to `invocations` records.
    pub(super) fn new(
        gpu: &Gpu,
        program: &Program,
        pipelines: &Pipelines,
        resources: &Resources,
        invocations: u64,
    ) -> Result<Self, GpuError> {
        use wgpu::BufferUsages as Usage;
        let plan = &program.plan;
        let capacity = invocations * u64::from(plan.stride.max(1)) * 4;
        let noted = invocations * u64::from(plan.notes.max(1)) * 4;
        let uses = |binding: Binding| plan.bindings.contains(&binding);
        let uniforms = uses(Binding::Uniforms)
            .then(|| buffer(gpu, "uniforms", u64::from(plan.uniforms.size.max(16)), Usage::UNIFORM | Usage::COPY_DST));
        let rays = uses(Binding::Rays).then(|| buffer(gpu, "rays", invocations * 32, Usage::STORAGE | Usage::COPY_DST));
        let records = buffer(gpu, "records", capacity, Usage::STORAGE | Usage::COPY_SRC);
        let staging = buffer(gpu, "staging", stamp_offset(capacity) + STAMPS, Usage::MAP_READ | Usage::COPY_DST);
        let stamps = gpu.timestamps.then(|| {
            let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("time"),
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            });
            (set, buffer(gpu, "time", STAMPS, Usage::QUERY_RESOLVE | Usage::COPY_SRC))
        });
        let over = invocations * u64::from(plan.carried.max(1)) * 4;
        let carried = uses(Binding::Carried).then(|| buffer(gpu, "carried", over, Usage::STORAGE));
        let notes = uses(Binding::NotesRead).then(|| buffer(gpu, "notes", noted, Usage::STORAGE));
        gpu.watch.check()?;
        let mut slot = Self {
            capacity,
            uniforms,
            rays,
            records,
            staging,
            stamps,
            notes,
            carried,
            targets: Targets::default(),
            light: Targets::default(),
            groups: Groups {
                passes: vec![],
                light: None,
                fill: None,
                plant: None,
                doubt: None,
                rank: None,
                survey: None,
            },
        };
        if plan.targets.is_empty() {
            slot.groups = slot.bind(gpu, program, pipelines, resources);
        }
        gpu.watch.check()?;
        Ok(slot)
    }

    /// Binds everything to every pass.
    fn bind(&self, gpu: &Gpu, program: &Program, pipelines: &Pipelines, resources: &Resources) -> Groups {
        let (mut grids, mut tables) = (resources.grids.iter(), resources.tables.iter());
        let (mut meshes, mut bounds) = (resources.meshes.iter(), resources.bounds.iter());
        fn whole(buffer: &Option<wgpu::Buffer>) -> Option<wgpu::BindingResource<'_>> {
            buffer.as_ref().map(wgpu::Buffer::as_entire_binding)
        }
        let bindings = program.plan.bindings.iter();
        let bound: Vec<Option<wgpu::BindingResource<'_>>> = bindings
            .map(|b| match b {
                Binding::Uniforms => whole(&self.uniforms),
                Binding::Rays => whole(&self.rays),
                Binding::Records => Some(self.records.as_entire_binding()),
                Binding::Notes | Binding::NotesRead => whole(&self.notes),
                Binding::Carried => whole(&self.carried),
                Binding::Grid(_) => grids.next().map(wgpu::BindingResource::TextureView),
                Binding::Cache => whole(&resources.cache),
                Binding::Mesh(_) => meshes.next().map(wgpu::Buffer::as_entire_binding),
                Binding::Bounds(_) => bounds.next().map(|(_, b)| b.as_entire_binding()),
                Binding::Table(_) => tables.next().map(|(_, b, _)| b.as_entire_binding()),
                Binding::Outlines => resources.outlines.as_ref().map(|o| o.0.as_entire_binding()),
                Binding::Order => resources.sorting.as_ref().map(|s| s.order().as_entire_binding()),
                Binding::Keys => resources.sorting.as_ref().map(|s| s.keys().as_entire_binding()),
                // Of the sort alone.
                Binding::KeysRead | Binding::Sorting(_) | Binding::Tallies | Binding::Workgroup(_) => None,
                Binding::Reaches | Binding::Starts | Binding::StartsRead => None,
                Binding::Entries | Binding::EntriesRead | Binding::TileListsWritten => None,
                Binding::Splats | Binding::SplatsRead => whole(&resources.splats),
                Binding::Survey => whole(&resources.survey),
                Binding::Footprints => resources.footprints.as_ref().map(|f| f.0.as_entire_binding()),
                Binding::TileLists => resources.sorting.as_ref()?.lists().map(wgpu::Buffer::as_entire_binding),
                Binding::Target(i) => self.targets.views.get(*i as usize).map(wgpu::BindingResource::TextureView),
                Binding::Light(i) => self.light.views.get(*i as usize).map(wgpu::BindingResource::TextureView),
            })
            .collect();
        let group = |step: &Step| {
            let entries: Vec<_> = (0..)
                .zip(bound.iter().zip(&step.used))
                .filter(|(_, (_, used))| **used)
                .filter_map(|(binding, (resource, _))| {
                    Some(wgpu::BindGroupEntry { binding, resource: resource.clone()? })
                })
                .collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("plan"),
                layout: &step.layout,
                entries: &entries,
            })
        };
        Groups {
            passes: pipelines.passes.iter().map(group).collect(),
            light: pipelines.light.as_ref().map(group),
            fill: pipelines.fill.as_ref().map(group),
            plant: pipelines.plant.as_ref().map(group),
            doubt: pipelines.doubt.as_ref().map(group),
            rank: pipelines.rank.as_ref().map(group),
            // Of several parts the first tells pixels apart for all.
            survey: pipelines.survey.as_ref().filter(|_| resources.survey.is_some()).map(group),
        }
    }

    /// Makes targets for a tile of this size, unless those there are hold it.
    fn hold(&mut self, gpu: &Gpu, program: &Program, (pipelines, resources): (&Pipelines, &Resources), size: [u32; 2]) {
        let plan = &program.plan;
        let kept = plan.light.as_ref().map_or(&[][..], |light| &light.targets);
        let moved = self.targets.hold(gpu, &plan.targets, size);
        if !self.light.hold(gpu, kept, resources.turns.1) && !moved {
            return;
        }
        self.groups = self.bind(gpu, program, pipelines, resources);
    }

    /// Whether it is large enough.
    pub(super) fn holds(&self, program: &Program, invocations: u64) -> bool {
        invocations * u64::from(program.plan.stride.max(1)) * 4 <= self.capacity
    }

    /// Runs a part of a pass that runs once for each picture, and waits for it.
    pub(super) fn fill(
        &mut self,
        gpu: &Gpu,
        program: &Program,
        (pipelines, resources): (&Pipelines, &Resources),
        (once, nodes): (Once, u32),
        block: &[u8],
    ) -> Result<(), GpuError> {
        self.hold(gpu, program, (pipelines, resources), [1, 1]);
        if let Some(uniforms) = &self.uniforms {
            gpu.queue.write_buffer(uniforms, 0, block);
        }
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("fill") });
        let (step, group, kernel) = match once {
            Once::Fill => (&pipelines.fill, &self.groups.fill, program.plan.fill.as_ref().map(|f| f.kernel)),
            Once::Plant => (&pipelines.plant, &self.groups.plant, program.plan.plant.map(|p| p.kernel)),
            Once::Doubt => (&pipelines.doubt, &self.groups.doubt, program.plan.plant.map(|p| p.doubt)),
            Once::Rank => (&pipelines.rank, &self.groups.rank, program.plan.plant.map(|p| p.rank)),
            Once::Survey => (&pipelines.survey, &self.groups.survey, program.plan.survey),
        };
        if let (Some(Step { pipeline: Pipeline::Compute(pipeline), .. }), Some(group), Some(kernel)) =
            (step, group, kernel)
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, group, &[]);
            pass.set_pipeline(pipeline);
            let group = program.kernels[kernel as usize].workgroup()[0].max(1);
            pass.dispatch_workgroups(nodes.div_ceil(group), 1, 1);
        }
        let index = gpu.queue.submit([encoder.finish()]);
        gpu.watch.wait(index)?;
        gpu.watch.check()
    }

    /// Sends one tile on its way: all passes, as often as the plan says. `block` gives the uniforms of each time.
    pub(super) fn submit(
        &mut self,
        gpu: &Gpu,
        program: &Program,
        (pipelines, resources): (&Pipelines, &Resources),
        (slot, part): (usize, Part),
        block: &mut Block,
        source: Source<'_>,
    ) -> Result<Flight, GpuError> {
        let plan = &program.plan;
        let invocations = match (source, &self.rays) {
            (Source::Camera, _) => part.size[0] as usize * part.size[1] as usize,
            (Source::List(rays), buffer) => {
                let first = part.origin[0] as usize;
                let rays = &rays[first..first + part.rays as usize];
                if let Some(buffer) = buffer {
                    gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(rays));
                }
                rays.len()
            }
        };
        self.hold(gpu, program, (pipelines, resources), part.size);
        let submitted = Instant::now();
        let repeats = plan.repeats.max(1);
        let mut index = None;
        for repeat in 0..repeats {
            if let Some(uniforms) = &self.uniforms {
                gpu.queue.write_buffer(uniforms, 0, block.part(part, (repeat, 0)));
            }
            let new_encoder =
                || gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("tile") });
            let mut encoder = new_encoder();
            let last_pass = plan.passes.len().saturating_sub(1);
            for (number, pass) in plan.passes.iter().enumerate() {
                let first = (repeat == 0 && number == 0).then_some(0);
                let last = (repeat + 1 == repeats && number == last_pass).then_some(1);
                let stamps = (first, last);
                for instances in instances(pass, resources, block.rounds) {
                    if instances.start > 0 {
                        // In parts that are short enough for watchdogs.
                        let full = std::mem::replace(&mut encoder, new_encoder());
                        gpu.queue.submit([full.finish()]);
                        if let (Pass::Rounds { .. }, Some(uniforms)) = (pass, &self.uniforms) {
                            gpu.queue.write_buffer(uniforms, 0, block.part(part, (repeat, instances.start)));
                        }
                    }
                    let draw = (number, pass, instances);
                    self.record(&mut encoder, program, (pipelines, resources), draw, part, stamps);
                }
            }
            if repeat + 1 == repeats {
                let bytes = invocations as u64 * u64::from(plan.stride) * 4;
                encoder.copy_buffer_to_buffer(&self.records, 0, &self.staging, 0, bytes);
                if let Some((set, resolved)) = &self.stamps {
                    encoder.resolve_query_set(set, 0..2, resolved, 0);
                    encoder.copy_buffer_to_buffer(resolved, 0, &self.staging, stamp_offset(self.capacity), STAMPS);
                }
            }
            index = Some(gpu.queue.submit([encoder.finish()]));
            gpu.watch.check()?;
        }
        let index = index.expect("a plan runs at least once");
        let (sender, mapped) = mpsc::channel();
        self.staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // Nobody listens when the drawing was given up meanwhile.
            let _ = sender.send(result);
        });
        gpu.watch.check()?;
        Ok(Flight { slot, part, submitted, index, floats: invocations * plan.stride as usize, mapped })
    }

    /// Records one pass over a tile, with time stamps before and after it if they have numbers.
    fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        program: &Program,
        (pipelines, resources): (&Pipelines, &Resources),
        (number, pass, instances): (usize, &Pass, Range<u32>),
        part: Part,
        (first, last): (Option<u32>, Option<u32>),
    ) {
        let stamps = self.stamps.as_ref().map(|s| &s.0).filter(|_| first.is_some() || last.is_some());
        let (step, group) = (&pipelines.passes[number], &self.groups.passes[number]);
        match (&step.pipeline, *pass) {
            (Pipeline::Compute(pipeline), Pass::Compute { kernel, extent } | Pass::Rounds { kernel, extent }) => {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some("tile"),
                    timestamp_writes: stamps.map(|query_set| wgpu::ComputePassTimestampWrites {
                        query_set,
                        beginning_of_pass_write_index: first,
                        end_of_pass_write_index: last,
                    }),
                });
                let [gx, gy, _] = program.kernels[kernel as usize].workgroup().map(|g| g.max(1));
                let groups = match extent {
                    Extent::Tile => [part.size[0].div_ceil(gx), part.size[1].div_ceil(gy)],
                    Extent::Rays => [part.rays.div_ceil(gx), 1],
                };
                pass.set_bind_group(0, group, &[]);
                pass.set_pipeline(pipeline);
                pass.dispatch_workgroups(groups[0], groups[1], 1);
            }
            (Pipeline::Raster(pipeline), Pass::Raster { geometry, .. }) => {
                let clear: &dyn Fn(usize) -> wgpu::Color = &|_| wgpu::Color::TRANSPARENT;
                let clear = (instances.start == 0).then_some(clear);
                let stamps = stamps.map(|query_set| wgpu::RenderPassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: first,
                    end_of_pass_write_index: last,
                });
                let mut pass = self.targets.pass(encoder, part.size, clear, stamps);
                pass.set_bind_group(0, group, &[]);
                pass.set_pipeline(pipeline);
                let corners = match geometry {
                    Geometry::Outlines => resources.outlines.as_ref().map_or(0, |o| o.1),
                    Geometry::Billboards => 6,
                };
                pass.draw(0..corners, instances);
            }
            // `aim` comes before and `resolve` after it: they have the time stamps.
            (Pipeline::Either(over, under), Pass::Alternate { .. }) => {
                let light = pipelines.light.as_ref().zip(self.groups.light.as_ref());
                self.alternate(
                    encoder,
                    &program.plan.targets,
                    resources,
                    ([under, over], group, light),
                    (instances, part),
                );
            }
            // Pipelines are made from the plan's passes, one by one.
            (Pipeline::Compute(_), Pass::Raster { .. } | Pass::Alternate { .. })
            | (Pipeline::Raster(_), Pass::Compute { .. } | Pass::Rounds { .. } | Pass::Alternate { .. })
            | (Pipeline::Either(..), Pass::Compute { .. } | Pass::Rounds { .. } | Pass::Raster { .. }) => {}
        }
    }

    /// Records some slabs, one after another: what is seen of each, and then what light loses in it.
    fn alternate(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &[Target],
        resources: &Resources,
        (seen, group, light): ([&wgpu::RenderPipeline; 2], &wgpu::BindGroup, Option<(&Step, &wgpu::BindGroup)>),
        (slabs, part): (Range<u32>, Part),
    ) {
        let (turns, nodes) = &resources.turns;
        if slabs.start == 0 {
            // Nothing is there yet, and lets everything through.
            let clear = |number: usize| match targets[number].blend {
                Blend::Over => wgpu::Color { a: 1.0, ..wgpu::Color::TRANSPARENT },
                Blend::Add | Blend::Max => wgpu::Color::TRANSPARENT,
            };
            drop(self.targets.pass(encoder, part.size, Some(&clear), None));
            if light.is_some() {
                drop(self.light.pass(encoder, *nodes, Some(&|_| wgpu::Color::TRANSPARENT), None));
            }
        }
        for turn in turns.iter().skip(slabs.start as usize).take(slabs.len()) {
            let sides = [&turn.along, &turn.against];
            if sides.iter().any(|corners| !corners.is_empty()) {
                let mut pass = self.targets.pass(encoder, part.size, None, None);
                pass.set_bind_group(0, group, &[]);
                for (corners, pipeline) in sides.into_iter().zip(seen).filter(|(corners, _)| !corners.is_empty()) {
                    pass.set_pipeline(pipeline);
                    pass.draw(corners.clone(), 0..1);
                }
            }
            if let (Some((Step { pipeline: Pipeline::Raster(pipeline), .. }, group)), false) =
                (light, turn.light.is_empty())
            {
                let mut pass = self.light.pass(encoder, *nodes, None, None);
                pass.set_bind_group(0, group, &[]);
                pass.set_pipeline(pipeline);
                pass.draw(turn.light.clone(), 0..1);
            }
        }
    }

    /// Waits for a dispatch, hands its records over, and returns the seconds the GPU says it took, if it says so.
    pub(super) fn retire(
        &self,
        gpu: &Gpu,
        flight: Flight,
        take: &mut dyn FnMut(&[f32]),
    ) -> Result<Option<f64>, GpuError> {
        gpu.watch.wait(flight.index)?;
        let mapped = flight.mapped.recv().is_ok_and(|r| r.is_ok());
        gpu.watch.check()?;
        let view = if mapped { self.staging.get_mapped_range(..).ok() } else { None };
        let Some(view) = view else { return Err(GpuError::lost("its memory cannot be read back")) };
        let records = &view[..flight.floats * 4];
        match bytemuck::try_cast_slice(records) {
            Ok(records) => take(records),
            // Mapped memory is aligned to more than a float everywhere known; a driver that differs costs a copy.
            Err(_) => take(&bytemuck::pod_collect_to_vec::<u8, f32>(records)),
        }
        let seconds = self.stamps.as_ref().and_then(|_| {
            let at = stamp_offset(self.capacity) as usize;
            let (stamps, _) = view.get(at..)?.as_chunks::<8>();
            let [begin, end] = [stamps.first()?, stamps.get(1)?].map(|b| u64::from_ne_bytes(*b));
            let ticks = end.checked_sub(begin).filter(|t| *t > 0)?;
            Some(ticks as f64 * f64::from(gpu.queue.get_timestamp_period()) * 1e-9)
        });
        drop(view);
        self.staging.unmap();
        Ok(seconds)
    }
}
