//! What lists promise: nothing is left out of a tile but what is counted.

use super::*;
use crate::data::splats::Gaussian;
use crate::frame::View;
use crate::frame::vector::{dot, normalize};

fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1u64 << 31) as f64
    }
}

pub(crate) fn files(count: usize, seed: u64) -> Vec<Arc<Splats>> {
    let mut x = noise(seed);
    let gaussians = (0..count).map(|_| Gaussian {
        center: [4.0 * x() - 2.0, 4.0 * x() - 2.0, 4.0 * x() - 2.0],
        rotation: [x() - 0.5, x() - 0.5, x() - 0.5, x() - 0.5],
        deviations: std::array::from_fn(|_| 10f64.powf(-3.0 + 2.5 * x())),
        opacity: x(),
        harmonics: &[0.3, 0.1, -0.2],
    });
    vec![Arc::new(Splats::new(0, false, gaussians).expect("splats").0)]
}

pub(crate) fn cast(files: &[Arc<Splats>]) -> Cast<'_> {
    let rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Cast { files, placed: vec![Placed { rows, offset: [0.0; 3], back: rows, encoded: true }], unit: 1.0 }
}

/// α of a splat at a point of the picture, from its numbers as kernels read them.
fn alpha(record: &[f32], camera: &Camera, at: [f64; 2]) -> f64 {
    let f = |i: usize| f64::from(record[i]);
    let three = |i: usize| -> Vec3 { [f(i), f(i + 1), f(i + 2)] };
    let (u, v, o) = match camera.view {
        View::Panorama => {
            let direction = camera.ray(at[0], at[1]).1;
            let ahead = dot(three(7), direction);
            if ahead <= 0.0 {
                return 0.0;
            }
            (dot(three(1), direction) / ahead, dot(three(4), direction) / ahead, f(10))
        }
        View::Perspective { .. } | View::Orthographic { .. } => {
            let [x, y] = [0, 1].map(|i| at[i] - 0.5 * f64::from(camera.size[i]));
            (f(1) * x + f(2) * y + f(3), f(4) * y + f(5), f(6))
        }
    };
    o.abs() * (-0.5 * (u * u + v * v)).exp()
}

/// The lists that the device is to make of what it gets.
pub(crate) fn lists(shown: &Footprints) -> Vec<Vec<u32>> {
    let count = shown.len();
    let word = |i: u32| u64::from(shown.keys[i as usize]);
    let mut order: Vec<u32> = (0..count).collect();
    order.sort_by_key(|i| (word(count + i) << 32) | word(*i));
    let mut lists = vec![vec![]; shown.heads.len() / 3 - 1];
    for splat in order {
        let [first, rest, widths, rows] = shown.reaches[splat as usize];
        for row in 0..rows {
            let parts = [first..first + (widths >> 16), rest..rest + (widths & 0xffff)];
            parts.into_iter().flatten().for_each(|tile| lists[(tile + row * shown.columns) as usize].push(splat));
        }
    }
    lists
}

#[test]
fn what_lists_leave_out_is_counted() {
    let forward = normalize([0.2, -0.1, 1.0]).expect("not zero");
    let right = normalize(crate::frame::vector::cross(forward, [0.0, 1.0, 0.0])).expect("not along up");
    let up = crate::frame::vector::cross(right, forward);
    let views = [
        (View::Perspective { tangent: 0.4 }, [0.0, 0.0, -4.0]),
        (View::Perspective { tangent: 2.0 }, [0.1, 0.0, 0.2]),
        (View::Orthographic { half_height: 1.5 }, [0.0, 0.0, -4.0]),
        (View::Panorama, [0.1, 0.0, 0.2]),
    ];
    for (view, from) in views {
        // A width that no tile divides.
        let camera = Camera { from, forward, right, up, view, size: [150, 70] };
        let eye = Eye::new(&camera, None);
        for (accuracy, seed) in [(1e-2, 1), (1.0, 2), (100.0, 3)] {
            let files = files(400, seed);
            let bands = [vec![[1.0, 0.0, 0.0]]];
            let shown = Footprints::of_picture(&cast(&files), &camera, &eye, &bands, accuracy);
            let stride = if view == View::Panorama { 12 } else { 8 };
            let records: Vec<&[f32]> = shown.records(0).chunks_exact(stride).collect();
            assert!(records.len() > 50);
            let lists = lists(&shown);
            let starts = shown.heads().iter().step_by(3);
            let lengths = starts.clone().zip(starts.skip(1)).map(|(start, end)| (end - start) as usize);
            assert!(lengths.eq(lists.iter().map(Vec::len)), "heads are those of lists");
            let edge = shown.edge();
            let across = camera.size[0].div_ceil(edge);
            let (mut listed, mut apart, mut loosest) = (0, 0.0_f64, 0.0_f64);
            let mut x = noise(seed + 9);
            for _ in 0..600 {
                let at = [150.0 * x(), 70.0 * x()];
                let tile = (at[1] as u32 / edge * across + at[0] as u32 / edge) as usize;
                let list = &lists[tile];
                let depths = list.iter().map(|i| records[*i as usize][0]);
                let mut once = list.clone();
                once.sort_unstable();
                assert!(depths.is_sorted() && once.windows(2).all(|w| w[0] != w[1]), "each once, the nearest first");
                listed += list.len();
                let left_out = f64::from(f32::from_bits(shown.heads()[3 * tile + 1]));
                let others = (0..records.len()).filter(|i| once.binary_search(&(*i as u32)).is_err());
                let sum: f64 = others.map(|i| alpha(records[i], &camera, at)).sum();
                assert!(sum <= left_out * (1.0 + 1e-6), "{view:?} {at:?}: {sum} left out, {left_out} counted");
                apart = apart.max(sum);
                loosest = loosest.max(left_out);
            }
            println!(
                "{view:?}: {:.1} of {} listed, {apart:.1e} of {loosest:.1e}",
                listed as f64 / 600.0,
                records.len()
            );
            assert!(listed > 0 && listed < 600 * records.len() || accuracy < 0.1, "lists leave something out");
            assert!(accuracy < 1.0 || apart > 0.0, "something is left out");
        }
    }
}

#[test]
fn many_large_splats_have_larger_tiles() {
    let camera = Camera {
        from: [0.0, 0.0, -4.0],
        forward: [0.0, 0.0, 1.0],
        right: [-1.0, 0.0, 0.0],
        up: [0.0, 1.0, 0.0],
        view: View::Perspective { tangent: 0.5 },
        size: [4096, 4096],
    };
    let mut x = noise(4);
    let gaussians = (0..1000).map(|_| Gaussian {
        center: [x(), x(), x()],
        rotation: [1.0, 0.0, 0.0, 0.0],
        deviations: [3.0; 3],
        opacity: 0.5,
        harmonics: &[0.0; 3],
    });
    let files = vec![Arc::new(Splats::new(0, false, gaussians).expect("splats").0)];
    let shown = Footprints::of_picture(&cast(&files), &camera, &Eye::new(&camera, None), &[vec![[1.0; 3]]], 1e-2);
    assert!(shown.edge() > 16 && shown.entries() <= 1 << 24, "{}", shown.edge());
}
