//! The sort of a plan on the device: its buffers, and its passes digit by digit.

use super::adapter::Gpu;
use super::errors::{GpuError, GpuErrorKind};
use super::pipelines::{Pipeline, Step};
use super::uniforms::{Block, Part, SortPart};
use compiler::program::{Binding, Program, SortBuffer, SortPass};
use std::sync::mpsc;

/// Digits of a word.
const DIGITS: u32 = 32 / SortPass::DIGIT;

/// The compiled kernels of a sort.
#[derive(Debug)]
pub(super) struct SortSteps {
    pub(super) count: Step,
    pub(super) scan: Step,
    pub(super) scatter: Step,
}

/// Memory for sorting up to so many things.
#[derive(Debug)]
pub(super) struct Sorting {
    count: u32,
    words: u32,
    uniforms: wgpu::Buffer,
    /// All words of all keys, as they were given.
    keys: wgpu::Buffer,
    /// What passes go from and to: keys and numbers.
    pairs: [[wgpu::Buffer; 2]; 2],
    tallies: wgpu::Buffer,
}

impl Sorting {
    /// Bytes of the largest buffer for so many keys.
    pub(super) fn bytes(count: u32, words: u32) -> u64 {
        (u64::from(count) * u64::from(words) * 4).next_power_of_two().max(64)
    }

    /// Memory for so many keys of so many words, unless what there is suffices. Gives whether it is another one now.
    pub(super) fn hold(
        slot: &mut Option<Self>,
        gpu: &Gpu,
        program: &Program,
        (count, words): (u32, u32),
    ) -> Result<bool, GpuError> {
        if slot.as_ref().is_some_and(|s| s.count >= count && s.words >= words) {
            return Ok(false);
        }
        let most = gpu.limits().max_storage_buffer_binding_size;
        if Self::bytes(count, words) > most {
            let message =
                format!("to put {count} splats in order takes {} MB at once", Self::bytes(count, words) >> 20);
            return Err(GpuError::new(
                GpuErrorKind::TooLarge,
                format!("{message}, and this adapter binds {}", most >> 20),
            )
            .hint("draw with `--engine cpu`, or with fewer splats"));
        }
        use wgpu::BufferUsages as Usage;
        let make = |label, size, usage| {
            let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
            gpu.device.create_buffer(&descriptor)
        };
        let both = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let pair = || ["sorted keys", "sorted numbers"].map(|label| make(label, Self::bytes(count, 1), both));
        let groups = u64::from(count.div_ceil(SortPass::TAKES)).max(1);
        *slot = Some(Self {
            count,
            words,
            uniforms: make("sort", u64::from(program.plan.uniforms.size.max(16)), Usage::UNIFORM | Usage::COPY_DST),
            keys: make("keys", Self::bytes(count, words), both),
            pairs: [pair(), pair()],
            tallies: make("tallies", groups * 4 << SortPass::DIGIT, both),
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
            Binding::Grid(_)
            | Binding::Table(_)
            | Binding::Mesh(_)
            | Binding::Cache
            | Binding::Bounds(_)
            | Binding::Rays
            | Binding::Records
            | Binding::Notes
            | Binding::NotesRead
            | Binding::Outlines
            | Binding::Splats
            | Binding::SplatsRead
            | Binding::Order
            | Binding::Workgroup(_)
            | Binding::Footprints
            | Binding::Carried
            | Binding::TileLists
            | Binding::Target(_) => return None,
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

    /// Puts the numbers of as many keys in order, and waits for nothing: a submission for each digit, short enough for watchdogs.
    pub(super) fn run(
        &self,
        gpu: &Gpu,
        program: &Program,
        steps: &SortSteps,
        block: &mut Block,
        (count, words): (u32, u32),
    ) -> Result<(), GpuError> {
        if count == 0 {
            return Ok(());
        }
        let all = [&steps.count, &steps.scan, &steps.scatter];
        // The last of an even number of passes ends in the first pair.
        let groups = [0, 1].map(|from| all.map(|step| self.group(gpu, program, step, from)));
        let blocks = SortPass::groups(count, SortPass::TAKES);
        let scanned = count.div_ceil(SortPass::TAKES) << SortPass::DIGIT;
        for pass in 0..words * DIGITS {
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

#[cfg(test)]
mod tests {
    use super::super::{AdapterChoice, GpuErrorKind, Needs, Prepared, SceneData};
    use super::*;
    use crate::engine::order::{depth_key, sorted_indices};
    use std::sync::Arc;

    const SMOKE: &str = "medium smoke { shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_a = 1 /m }
        camera { from = (0, 0, -3) m  to = (0, 0, 0) m }  render { backend = splatting }";

    /// The sort of a scene, on the device; `None` where there is none.
    fn sorter(text: &str) -> Option<Prepared> {
        let options = compiler::Options::default();
        let compiled = compiler::compile("scene.vol", text, &compiler::loader::NoFiles, &options);
        let program = Arc::new(compiled.program.expect("the scene compiles"));
        let shaders = vec![program.kernels.iter().map(|k| compiler::emit::emit(k).expect("valid")).collect()];
        let gpu = match Gpu::new(&AdapterChoice::from_env(), &Needs::of(&program)) {
            Ok(gpu) => Arc::new(gpu),
            Err(error) if error.kind == GpuErrorKind::NoAdapter => {
                crate::engine::skip_without_adapter();
                return None;
            }
            Err(error) => panic!("{error}"),
        };
        gpu.prepare(&program, shaders, SceneData::default()).expect("prepares").pop()
    }

    fn noise(seed: u64) -> impl FnMut() -> u64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        }
    }

    #[test]
    fn a_million_depths_with_ties_come_in_the_order_of_a_stable_sort() {
        let Some(mut sorter) = sorter(SMOKE) else { return };
        let mut next = noise(1);
        // A tenth as many depths as splats: each comes about ten times.
        let keys: Vec<u32> = (0..1_000_000).map(|_| depth_key((next() % 100_000) as f32 * 1e-3 - 20.0)).collect();
        let (order, seconds) = sorter.sort(&keys).expect("sorts");
        println!("{seconds:.3} s");
        let mut wanted: Vec<u32> = (0..keys.len() as u32).collect();
        wanted.sort_by_key(|i| keys[*i as usize]);
        assert!(order == wanted);
        // The same input gives the same order, frame after frame.
        assert!(sorter.sort(&keys).expect("sorts").0 == wanted);
    }

    #[test]
    fn any_number_of_any_keys() {
        let Some(mut sorter) = sorter(SMOKE) else { return };
        let mut next = noise(2);
        for count in [0, 1, 2, 15, 16, 17, 255, 256, 257, 4095, 4096, 4097, 12_289, 70_000] {
            for mask in [u32::MAX, 0xff00_00ff, 0x8000_0001, 0] {
                let keys: Vec<u32> = (0..count).map(|_| (next() as u32 ^ (next() as u32) << 8) & mask).collect();
                assert_eq!(sorter.sort(&keys).expect("sorts").0, sorted_indices(&keys), "{count} keys, {mask:x}");
            }
            let falling: Vec<u32> = (0..count).rev().map(|i| i * 61_003).collect();
            assert_eq!(sorter.sort(&falling).expect("sorts").0, sorted_indices(&falling), "{count} keys");
        }
        let odd = [f32::NAN, -0.0, 0.0, f32::INFINITY, -1.0, f32::NEG_INFINITY, -f32::NAN, 1e-45].map(depth_key);
        assert_eq!(sorter.sort(&odd).expect("sorts").0, [5, 4, 1, 2, 7, 3, 0, 6]);
    }
}
