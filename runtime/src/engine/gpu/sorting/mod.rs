//! The sort of a plan on the device, and the lists that are made of what it gives: buffers, and passes.

#[cfg(test)]
mod tests;

use super::adapter::Gpu;
use super::errors::{GpuError, GpuErrorKind};
use super::pipelines::{Pipeline, Step};
use super::resources::storage;
use super::uniforms::{Block, Part, SortPart};
use crate::frame::Footprints;
use compiler::program::{Binding, Program, SortBuffer, SortPass};
use std::sync::mpsc;

/// Digits of a word.
pub(super) const DIGITS: u32 = 32 / SortPass::DIGIT;

/// Whether this adapter binds so many bytes at once. Buffers grow to powers of two.
fn fits(gpu: &Gpu, bytes: u64) -> Result<(), GpuError> {
    let most = gpu.limits().max_storage_buffer_binding_size;
    if bytes.next_power_of_two() <= most {
        return Ok(());
    }
    let message = format!(
        "to put the splats in order takes {} MB, and this adapter binds {} MB at once",
        bytes >> 20,
        most >> 20
    );
    Err(GpuError::new(GpuErrorKind::TooLarge, message).hint("draw with `--engine cpu`, or with fewer splats"))
}

/// The compiled kernels of a sort.
#[derive(Debug)]
pub(super) struct SortSteps {
    pub(super) count: Step,
    pub(super) scan: Step,
    pub(super) scatter: Step,
}

/// The compiled kernels that make lists.
#[derive(Debug)]
pub(super) struct ListSteps {
    pub(super) sums: Step,
    pub(super) starts: Step,
    pub(super) spread: Step,
    pub(super) fill: Step,
}

/// What lists are made in.
#[derive(Debug)]
struct Listing {
    reaches: wgpu::Buffer,
    starts: wgpu::Buffer,
    entries: wgpu::Buffer,
    lists: wgpu::Buffer,
}

/// Memory for sorting up to so many things.
#[derive(Debug)]
pub(super) struct Sorting {
    count: u32,
    words: u64,
    listing: Option<Listing>,
    uniforms: wgpu::Buffer,
    /// All words of all keys, as they were given.
    keys: wgpu::Buffer,
    /// What passes go from and to: keys and numbers.
    pairs: [[wgpu::Buffer; 2]; 2],
    tallies: wgpu::Buffer,
}

impl Sorting {
    /// Memory for so many things, and so many words of keys, unless what there is suffices. Gives whether it is another one now.
    pub(super) fn hold(
        slot: &mut Option<Self>,
        gpu: &Gpu,
        program: &Program,
        (count, words): (u32, u64),
    ) -> Result<bool, GpuError> {
        if slot.as_ref().is_some_and(|s| s.count >= count && s.words >= words) {
            return Ok(false);
        }
        fits(gpu, 4 * words.max(count.into()))?;
        let pair = || ["sorted keys", "sorted numbers"].map(|label| storage(gpu, label, 4 * u64::from(count)));
        let groups = u64::from(count.div_ceil(SortPass::TAKES));
        *slot = Some(Self {
            count,
            words,
            listing: None,
            uniforms: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("sort"),
                size: u64::from(program.plan.uniforms.size.max(16)),
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            keys: storage(gpu, "keys", 4 * words),
            pairs: [pair(), pair()],
            tallies: storage(gpu, "tallies", (groups * 4) << SortPass::DIGIT),
        });
        gpu.watch.check()?;
        Ok(true)
    }

    /// Keys as they are given, word by word.
    pub(super) fn keys(&self) -> &wgpu::Buffer {
        &self.keys
    }

    /// Numbers in their order, after [`Self::run`].
    pub(super) fn order(&self) -> &wgpu::Buffer {
        &self.pairs[0][1]
    }

    /// Lists, after [`Self::list`].
    pub(super) fn lists(&self) -> Option<&wgpu::Buffer> {
        self.listing.as_ref().map(|l| &l.lists)
    }

    pub(super) fn tallies(&self) -> &wgpu::Buffer {
        &self.tallies
    }

    /// What is bound where a pass goes from one pair to the other.
    fn buffer(&self, binding: Binding, from: usize) -> Option<&wgpu::Buffer> {
        let [keys, numbers] = [0, 1];
        Some(match binding {
            Binding::Uniforms => &self.uniforms,
            Binding::Keys | Binding::KeysRead => &self.keys,
            Binding::Sorting(SortBuffer::KeysFrom) => &self.pairs[from][keys],
            Binding::Sorting(SortBuffer::NumbersFrom) => &self.pairs[from][numbers],
            Binding::Sorting(SortBuffer::KeysTo) => &self.pairs[1 - from][keys],
            Binding::Sorting(SortBuffer::NumbersTo) => &self.pairs[1 - from][numbers],
            Binding::Tallies => &self.tallies,
            Binding::Order => self.order(),
            Binding::Reaches => &self.listing.as_ref()?.reaches,
            Binding::Starts | Binding::StartsRead => &self.listing.as_ref()?.starts,
            Binding::Entries | Binding::EntriesRead => &self.listing.as_ref()?.entries,
            Binding::TileLists | Binding::TileListsWritten => &self.listing.as_ref()?.lists,
            Binding::Grid(_)
            | Binding::Table(_)
            | Binding::Mesh(_)
            | Binding::Cache
            | Binding::Bounds(_)
            | Binding::Rays
            | Binding::Survey
            | Binding::Records
            | Binding::Notes
            | Binding::NotesRead
            | Binding::Outlines
            | Binding::Splats
            | Binding::SplatsRead
            | Binding::Workgroup(_)
            | Binding::Footprints
            | Binding::Carried
            | Binding::Target(_)
            | Binding::Light(_) => return None,
        })
    }

    fn group(&self, gpu: &Gpu, program: &Program, step: &Step, from: usize) -> wgpu::BindGroup {
        let bindings = (0..).zip(program.plan.bindings.iter().zip(&step.used));
        let entries: Vec<_> = bindings
            .filter(|(_, (_, used))| **used)
            .filter_map(|(number, (binding, _))| {
                let resource = self.buffer(*binding, from)?.as_entire_binding();
                Some(wgpu::BindGroupEntry { binding: number, resource })
            })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("sort"),
            layout: &step.layout,
            entries: &entries,
        })
    }

    /// Puts the numbers of as many keys in order by so many digits, and waits for nothing: a submission for each digit, short enough for watchdogs.
    pub(super) fn run(
        &self,
        gpu: &Gpu,
        program: &Program,
        steps: &SortSteps,
        block: &mut Block,
        (count, digits): (u32, u32),
    ) -> Result<(), GpuError> {
        if count == 0 {
            return Ok(());
        }
        let all = [&steps.count, &steps.scan, &steps.scatter];
        // The last of an even number of passes ends in the first pair. A digit more that is 0 everywhere moves nothing.
        let groups = [0, 1].map(|from| all.map(|step| self.group(gpu, program, step, from)));
        let blocks = SortPass::groups(count, SortPass::TAKES);
        let scanned = count.div_ceil(SortPass::TAKES) << SortPass::DIGIT;
        for pass in 0..digits.next_multiple_of(2) {
            let (word, shift) = (pass / DIGITS, pass % DIGITS * SortPass::DIGIT);
            let sort = SortPart { count, word, shift, scanned };
            gpu.queue.write_buffer(&self.uniforms, 0, block.part(Part { sort, ..Part::default() }, (0, 0)));
            let mut encoder =
                gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("sort") });
            let own = &groups[pass as usize % 2];
            for ((step, group), [across, down]) in all.iter().zip(own).zip([blocks, [1, 1], blocks]) {
                dispatch(&mut encoder, step, group, [across, down]);
            }
            gpu.queue.submit([encoder.finish()]);
            gpu.watch.check()?;
        }
        Ok(())
    }

    /// Makes room for lists, and writes what the runtime knows of them.
    pub(super) fn write_lists(&mut self, gpu: &Gpu, shown: &Footprints) -> Result<bool, GpuError> {
        let reaches: &[u8] = bytemuck::cast_slice(shown.reaches());
        let sizes = [
            reaches.len() as u64,
            4 * u64::from(shown.len()),
            4 * u64::from(shown.entries()),
            4 * (shown.heads().len() as u64 + u64::from(shown.entries())),
        ];
        fits(gpu, sizes.into_iter().max().unwrap_or(0))?;
        let held = self.listing.as_ref().is_some_and(|l| {
            [&l.reaches, &l.starts, &l.entries, &l.lists].into_iter().zip(sizes).all(|(b, size)| b.size() >= size)
        });
        if !held {
            let [reaches, starts, entries, lists] = sizes;
            self.listing = Some(Listing {
                reaches: storage(gpu, "tiles of splats", reaches),
                starts: storage(gpu, "starts of entries", starts),
                entries: storage(gpu, "entries", entries),
                lists: storage(gpu, "lists", lists),
            });
            gpu.watch.check()?;
        }
        if let Some(listing) = &self.listing {
            gpu.queue.write_buffer(&listing.reaches, 0, reaches);
            gpu.queue.write_buffer(&listing.lists, 0, bytemuck::cast_slice(shown.heads()));
        }
        gpu.queue.write_buffer(&self.keys, 0, bytemuck::cast_slice(shown.keys()));
        Ok(!held)
    }

    /// Makes the lists of splats that are in order.
    pub(super) fn list(
        &self,
        gpu: &Gpu,
        program: &Program,
        (sort, steps): (&SortSteps, &ListSteps),
        block: &mut Block,
        shown: &Footprints,
    ) -> Result<(), GpuError> {
        let (count, entries) = (shown.len(), shown.entries());
        if entries == 0 {
            return Ok(());
        }
        let part = SortPart { count, scanned: count.div_ceil(SortPass::TAKES), ..SortPart::default() };
        let part = Part { sort: part, ..Part::default() };
        let blocks = SortPass::groups(count, SortPass::TAKES);
        let each = SortPass::groups(entries, SortPass::THREADS);
        let run = |block: &mut Block, all: &[(&Step, [u32; 2])]| {
            gpu.queue.write_buffer(&self.uniforms, 0, block.part(part, (0, 0)));
            for (step, groups) in all {
                let group = self.group(gpu, program, step, 0);
                let mut encoder =
                    gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("lists") });
                dispatch(&mut encoder, step, &group, *groups);
                gpu.queue.submit([encoder.finish()]);
            }
            gpu.watch.check()
        };
        let all = [(&steps.sums, blocks), (&sort.scan, [1, 1]), (&steps.starts, blocks), (&steps.spread, each)];
        run(block, &all)?;
        let tiles = (shown.heads().len() / 3) as u32;
        let bits = u32::BITS - tiles.leading_zeros();
        self.run(gpu, program, sort, block, (entries, bits.div_ceil(SortPass::DIGIT)))?;
        run(block, &[(&steps.fill, each)])
    }

    /// How many of the sorted keys are not the last there is, by the kernel of the plan.
    pub(super) fn drawn(
        &self,
        gpu: &Gpu,
        program: &Program,
        step: &Step,
        block: &mut Block,
        count: u32,
    ) -> Result<u32, GpuError> {
        if count == 0 {
            return Ok(0);
        }
        let sort = SortPart { count, ..SortPart::default() };
        gpu.queue.write_buffer(&self.uniforms, 0, block.part(Part { sort, ..Part::default() }, (0, 0)));
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("drawn") });
        dispatch(&mut encoder, step, &self.group(gpu, program, step, 0), [1, 1]);
        gpu.queue.submit([encoder.finish()]);
        Ok(read(gpu, self.tallies(), 1)?.first().copied().unwrap_or(0))
    }
}

fn dispatch(encoder: &mut wgpu::CommandEncoder, step: &Step, group: &wgpu::BindGroup, [across, down]: [u32; 2]) {
    // What sorts is compute.
    if let Pipeline::Compute(pipeline) = &step.pipeline {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, group, &[]);
        pass.set_pipeline(pipeline);
        pass.dispatch_workgroups(across, down, 1);
    }
}

/// The first numbers of a buffer, once all is done that was submitted before.
pub(super) fn read(gpu: &Gpu, buffer: &wgpu::Buffer, count: u32) -> Result<Vec<u32>, GpuError> {
    if count == 0 {
        return Ok(vec![]);
    }
    let size = 4 * u64::from(count);
    let staging = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("read back"),
        size,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("read back") });
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
    let index = gpu.queue.submit([encoder.finish()]);
    let (sender, mapped) = mpsc::channel();
    staging.map_async(wgpu::MapMode::Read, .., move |result| {
        // Nobody listens when the drawing was given up meanwhile.
        let _ = sender.send(result);
    });
    gpu.watch.wait(index)?;
    let mapped = mapped.recv().is_ok_and(|r| r.is_ok());
    let view = if mapped { staging.get_mapped_range(..).ok() } else { None };
    let Some(view) = view else { return Err(GpuError::lost("its memory cannot be read back")) };
    Ok(bytemuck::pod_collect_to_vec(&view))
}
