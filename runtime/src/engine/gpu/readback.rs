//! One dispatch in flight: its buffers, its way to the GPU and back.

use super::adapter::Gpu;
use super::draw::Source;
use super::errors::GpuError;
use super::pipelines::Pipelines;
use super::resources::Resources;
use super::uniforms::Part;
use compiler::program::{Binding, Extent, Program};
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
    group: wgpu::BindGroup,
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
        gpu.watch.check()?;
        let (mut grids, mut tables) = (resources.grids.iter(), resources.tables.iter());
        let mut meshes = resources.meshes.iter();
        let mut entries = vec![];
        for (binding, b) in (0..).zip(&plan.bindings) {
            let resource = match b {
                Binding::Uniforms => uniforms.as_ref().map(wgpu::Buffer::as_entire_binding),
                Binding::Rays => rays.as_ref().map(wgpu::Buffer::as_entire_binding),
                Binding::Records => Some(records.as_entire_binding()),
                Binding::Grid(_) => grids.next().map(wgpu::BindingResource::TextureView),
                Binding::Cache => resources.cache.as_ref().map(wgpu::Buffer::as_entire_binding),
                Binding::Mesh(_) => meshes.next().map(wgpu::Buffer::as_entire_binding),
                Binding::Table(_) => tables.next().map(|(_, b, _)| b.as_entire_binding()),
            };
            entries.extend(resource.map(|resource| wgpu::BindGroupEntry { binding, resource }));
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("plan"),
            layout: &pipelines.layout,
            entries: &entries,
        });
        gpu.watch.check()?;
        Ok(Self { capacity, uniforms, rays, records, staging, stamps, group })
    }

    /// Whether it is large enough.
    pub(super) fn holds(&self, program: &Program, invocations: u64) -> bool {
        invocations * u64::from(program.plan.stride.max(1)) * 4 <= self.capacity
    }

    /// Runs a part of the pass that fills the cache, and waits for it.
    pub(super) fn fill(
        &self,
        gpu: &Gpu,
        program: &Program,
        pipelines: &Pipelines,
        (kernel, nodes): (u32, u32),
        block: &[u8],
    ) -> Result<(), GpuError> {
        if let Some(uniforms) = &self.uniforms {
            gpu.queue.write_buffer(uniforms, 0, block);
        }
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("fill") });
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, &self.group, &[]);
            pass.set_pipeline(&pipelines.kernels[kernel as usize]);
            let group = program.kernels[kernel as usize].workgroup[0].max(1);
            pass.dispatch_workgroups(nodes.div_ceil(group), 1, 1);
        }
        let index = gpu.queue.submit([encoder.finish()]);
        gpu.watch.wait(index)?;
        gpu.watch.check()
    }

    /// Sends one dispatch on its way.
    pub(super) fn submit(
        &self,
        gpu: &Gpu,
        program: &Program,
        pipelines: &Pipelines,
        (slot, part): (usize, Part),
        block: &[u8],
        source: Source<'_>,
    ) -> Result<Flight, GpuError> {
        if let Some(uniforms) = &self.uniforms {
            gpu.queue.write_buffer(uniforms, 0, block);
        }
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
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("tile") });
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("tile"),
                timestamp_writes: self.stamps.as_ref().map(|(query_set, _)| wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(0),
                    end_of_pass_write_index: Some(1),
                }),
            });
            pass.set_bind_group(0, &self.group, &[]);
            for step in &program.plan.passes {
                let [gx, gy, _] = program.kernels[step.kernel as usize].workgroup.map(|g| g.max(1));
                let groups = match step.extent {
                    Extent::Tile => [part.size[0].div_ceil(gx), part.size[1].div_ceil(gy)],
                    Extent::Rays => [part.rays.div_ceil(gx), 1],
                };
                pass.set_pipeline(&pipelines.kernels[step.kernel as usize]);
                pass.dispatch_workgroups(groups[0], groups[1], 1);
            }
        }
        let floats = invocations * program.plan.stride as usize;
        let bytes = floats as u64 * 4;
        encoder.copy_buffer_to_buffer(&self.records, 0, &self.staging, 0, bytes);
        if let Some((set, resolved)) = &self.stamps {
            encoder.resolve_query_set(set, 0..2, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, &self.staging, stamp_offset(self.capacity), STAMPS);
        }
        let submitted = Instant::now();
        let index = gpu.queue.submit([encoder.finish()]);
        gpu.watch.check()?;
        let (sender, mapped) = mpsc::channel();
        self.staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // Nobody listens when the drawing was given up meanwhile.
            let _ = sender.send(result);
        });
        gpu.watch.check()?;
        Ok(Flight { slot, part, submitted, index, floats, mapped })
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
