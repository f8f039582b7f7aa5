//! The device against a stable sort, and against lists and orders made by hand.

use super::super::{AdapterChoice, GpuErrorKind, Needs, Prepared, SceneData};
use super::*;
use crate::data::splats::Splats;
use crate::frame::footprints::tests::{cast, files, lists};
use crate::frame::vector::dot;
use crate::frame::{Camera, Eye, Lattice, Vec3, View};
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

fn compiled(text: &str, loader: &dyn Loader) -> Arc<Program> {
    let compiled = compiler::compile("scene.vol", text, loader, &compiler::Options::default());
    Arc::new(compiled.program.expect("the scene compiles"))
}

/// The sort of a scene, on the device; `None` where there is none.
fn sorter(text: &str, loader: &dyn Loader) -> Option<Prepared> {
    let program = compiled(text, loader);
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

fn stable(keys: &[u32]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    order.sort_by_key(|i| keys[*i as usize]);
    order
}

fn noise(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    }
}

#[test]
fn a_million_keys_with_ties_come_in_the_order_of_a_stable_sort() {
    let Some(mut sorter) = sorter(SMOKE, &compiler::loader::NoFiles) else { return };
    let mut next = noise(1);
    // A tenth as many keys as splats: each comes about ten times.
    let keys: Vec<u32> = (0..1_000_000).map(|_| (next() % 100_000) as u32 * 42_949).collect();
    let (order, seconds) = sorter.sort(&keys).expect("sorts");
    println!("{seconds:.3} s");
    let wanted = stable(&keys);
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
            assert_eq!(sorter.sort(&keys).expect("sorts").0, stable(&keys), "{count} keys, {mask:x}");
        }
        let falling: Vec<u32> = (0..count).rev().map(|i| i * 61_003).collect();
        assert_eq!(sorter.sort(&falling).expect("sorts").0, stable(&falling), "{count} keys");
    }
}

/// Nodes as they are drawn: each once, the farthest first, and none that is empty or behind the eye.
#[test]
fn nodes_of_a_lattice_come_from_far_to_near() {
    let Some(mut sorter) = sorter(SMOKE, &compiler::loader::NoFiles) else { return };
    // A metre in the units of the scene.
    let one = compiled(SMOKE, &compiler::loader::NoFiles).lowered.units.scale(1.0);
    let cube: [Vec3; 8] = std::array::from_fn(|i| std::array::from_fn(|k| if i >> k & 1 == 0 { -one } else { one }));
    for (forward, plane) in
        [([0.0, 0.0, 1.0], 3.0), ([0.6, 0.0, -0.8], 3.0), ([0.36, 0.48, 0.8], 3.0), ([0.36, 0.48, 0.8], 0.0)]
    {
        let mut frame = super::super::tests::frame([64, 64], vec![]);
        frame.eye = Eye { anchor: [0.0; 3], forward, right: [1.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], plane: plane * one };
        frame.lattice = Lattice::around(&[cube], 4000);
        let lattice = frame.lattice.clone();
        let place = |i: u32| -> Vec3 {
            let [nx, ny, _] = lattice.counts;
            let index = [i % nx, i / nx % ny, i / nx / ny].map(f64::from);
            std::array::from_fn(|k| lattice.low[k] + index[k] * lattice.spacing)
        };
        let order = sorter.nodes(&frame).expect("nodes");
        let depths: Vec<f64> = order.iter().map(|i| dot(place(*i), forward)).collect();
        assert!(depths.windows(2).all(|w| w[0] >= w[1] - 1e-5 * lattice.spacing));
        let mut drawn = vec![false; lattice.len() as usize];
        assert!(order.iter().all(|i| !std::mem::replace(&mut drawn[*i as usize], true)), "each once");
        for (i, drawn) in (0..).zip(drawn) {
            let (from_middle, ahead) = (dot(place(i), place(i)).sqrt(), dot(place(i), forward) + plane * one);
            // Gaussians reach 3.6 spacings, and what is wrong at a boundary is found two away.
            if from_middle < one - lattice.spacing && ahead > 0.0 {
                assert!(drawn, "{:?} is in the smoke", place(i));
            }
            if from_middle > one + 3.0 * lattice.spacing || ahead < -4.0 * lattice.spacing {
                assert!(!drawn, "{:?} is not seen", place(i));
            }
        }
        assert_eq!(sorter.nodes(&frame).expect("nodes"), order, "frame after frame");
    }
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
    for (count, size, from) in
        [(3000, [150, 70], -4.0), (3000, [1000, 900], 0.3), (40, [33, 18], 0.1), (30, [64, 64], 1e6), (1, [1, 1], -4.0)]
    {
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

#[test]
fn no_more_is_needed_than_webgpu_promises() {
    let promised = wgpu::Limits::default();
    let file = files(1, 1);
    for program in [compiled(SMOKE, &compiler::loader::NoFiles), compiled(ROOM, &Files(file[0].header()))] {
        let needs = Needs::of(&program);
        assert!(needs.storage_buffers <= promised.max_storage_buffers_per_shader_stage, "{needs:?}");
        assert!(needs.storage_bytes <= promised.max_storage_buffer_binding_size, "{needs:?}");
        assert!(
            needs.shared_bytes <= promised.max_compute_workgroup_storage_size && needs.shared_bytes > 0,
            "{needs:?}"
        );
        assert!(needs.invocations <= promised.max_compute_invocations_per_workgroup, "{needs:?}");
    }
    // However many there are, no side of a dispatch is too long.
    for count in [0, 1, 4096, 4097, 1 << 28, u32::MAX] {
        for takes in [SortPass::THREADS, SortPass::TAKES] {
            let [across, down] = SortPass::groups(count, takes);
            assert!(across.max(down) <= promised.max_compute_workgroups_per_dimension);
            assert!(u64::from(across) * u64::from(down) * u64::from(takes) >= u64::from(count));
        }
    }
}
