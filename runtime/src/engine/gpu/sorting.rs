//! The sort of a plan on the device, and the lists that are made of what it gives: buffers, and passes.

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
            | Binding::Records
            | Binding::Notes
            | Binding::NotesRead
            | Binding::Outlines
            | Binding::Splats
            | Binding::SplatsRead
            | Binding::Workgroup(_)
            | Binding::Footprints
            | Binding::Carried
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

#[cfg(test)]
mod tests {
    use super::super::{AdapterChoice, GpuErrorKind, Needs, Prepared, SceneData};
    use super::*;
    use crate::data::splats::Splats;
    use crate::engine::order::{depth_key, sorted_indices};
    use crate::frame::footprints::tests::{cast, files, lists};
    use crate::frame::{Camera, Eye, View};
    use compiler::loader::{GridHeader, LoadError, Loader, SplatsHeader};
    use std::sync::Arc;

    /// Whatever file is named, it is these splats.
    struct Files(SplatsHeader);

    impl Loader for Files {
        fn module(&self, _: &str, path: &str) -> Result<(String, String), LoadError> {
            panic!("{path}")
        }

        fn grid(&self, _: &str, path: &str) -> Result<GridHeader, LoadError> {
            panic!("{path}")
        }

        fn splats(&self, _: &str, _: &str) -> Result<SplatsHeader, LoadError> {
            Ok(self.0)
        }
    }

    const SMOKE: &str = "medium smoke { shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_a = 1 /m }
        camera { from = (0, 0, -3) m  to = (0, 0, 0) m }  render { backend = splatting }";

    /// The sort of a scene, on the device; `None` where there is none.
    fn sorter(text: &str, loader: &dyn Loader) -> Option<Prepared> {
        let options = compiler::Options::default();
        let compiled = compiler::compile("scene.vol", text, loader, &options);
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
        let Some(mut sorter) = sorter(SMOKE, &compiler::loader::NoFiles) else { return };
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
        let Some(mut sorter) = sorter(SMOKE, &compiler::loader::NoFiles) else { return };
        let mut next = noise(2);
        for count in [0, 1, 2, 15, 16, 17, 255, 256, 257, 4095, 4096, 4097, 12_289, 70_000] {
            for mask in [u32::MAX, 0xff00_00ff, 0x8000_0001, 0] {
                let keys: Vec<u32> = (0..count).map(|_| (next() as u32 ^ ((next() as u32) << 8)) & mask).collect();
                assert_eq!(sorter.sort(&keys).expect("sorts").0, sorted_indices(&keys), "{count} keys, {mask:x}");
            }
            let falling: Vec<u32> = (0..count).rev().map(|i| i * 61_003).collect();
            assert_eq!(sorter.sort(&falling).expect("sorts").0, sorted_indices(&falling), "{count} keys");
        }
        let odd = [f32::NAN, -0.0, 0.0, f32::INFINITY, -1.0, f32::NEG_INFINITY, -f32::NAN, 1e-45].map(depth_key);
        assert_eq!(sorter.sort(&odd).expect("sorts").0, [5, 4, 1, 2, 7, 3, 0, 6]);
    }

    #[test]
    fn keys_of_two_words_are_sorted_by_both() {
        let file = files(1, 1);
        let Some(mut sorter) = sorter(ROOM, &Files(file[0].header())) else { return };
        let mut next = noise(3);
        let keys: Vec<u64> = (0..10_000).map(|_| ((next() % 90) << 32) | (next() % 20)).collect();
        let words: Vec<u32> = keys.iter().map(|k| *k as u32).chain(keys.iter().map(|k| (*k >> 32) as u32)).collect();
        let mut wanted: Vec<u32> = (0..keys.len() as u32).collect();
        wanted.sort_by_key(|i| keys[*i as usize]);
        assert_eq!(sorter.sort(&words).expect("sorts").0, wanted);
    }

    const ROOM: &str = "splats room { file = \"s.ply\" }  camera { from = (0, 0, -4) m  to = (0, 0, 0) m }";

    #[test]
    fn lists_of_tiles_are_in_order_of_depth() {
        // From many splats with large tiles and small to none at all.
        for (count, size, from) in [
            (3000, [150, 70], -4.0),
            (3000, [1000, 900], 0.3),
            (40, [33, 18], 0.1),
            (30, [64, 64], 1e6),
            (1, [1, 1], -4.0),
        ] {
            let files: Vec<Arc<Splats>> = files(count, 5);
            let camera = Camera {
                from: [0.1, 0.2, from],
                forward: [0.0, 0.0, 1.0],
                right: [-1.0, 0.0, 0.0],
                up: [0.0, 1.0, 0.0],
                view: View::Perspective { tangent: 0.5 },
                size,
            };
            for view in [camera.view, View::Panorama] {
                let camera = Camera { view, ..camera };
                let text = match view {
                    View::Panorama => ROOM.replace("to =", "projection = panorama  to ="),
                    View::Perspective { .. } | View::Orthographic { .. } => ROOM.to_owned(),
                };
                let Some(mut sorter) = sorter(&text, &Files(files[0].header())) else { return };
                let eye = Eye::new(&camera, None);
                let shown = Footprints::of_picture(&cast(&files), &camera, &eye, &[vec![[1.0; 3]; 3]], 1e-2);
                let mut frame = super::super::tests::frame(size, vec![]);
                frame.footprints = Arc::new(shown);
                for _ in 0..2 {
                    let made = sorter.lists(&frame).expect("lists");
                    let mut wanted = frame.footprints.heads().to_vec();
                    wanted.extend(lists(&frame.footprints).into_iter().flatten());
                    assert!(made == wanted, "{count} splats, {size:?}: {} numbers", wanted.len());
                }
            }
        }
    }
}
