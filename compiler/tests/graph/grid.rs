//! Interpolation between voxels.

use crate::close;
use compiler::ir::Filter;
use compiler::ir::eval::{interpolate, interpolate_gradient};
use proptest::prelude::*;

const DIMS: [u32; 3] = [6, 5, 7];

fn inside() -> impl Strategy<Value = [f64; 3]> {
    (0.0..5.0f64, 0.0..4.0f64, 0.0..6.0f64).prop_map(|(x, y, z)| [x, y, z])
}

/// Far enough from the faces that all four taps of a cubic are voxels of their own.
fn well_inside() -> impl Strategy<Value = [f64; 3]> {
    (1.0..4.0f64, 1.0..3.0f64, 1.0..5.0f64).prop_map(|(x, y, z)| [x, y, z])
}

fn coefficients() -> impl Strategy<Value = [f64; 4]> {
    prop::array::uniform4(-2.0..2.0f64)
}

fn affine(c: [f64; 4], x: [f64; 3]) -> f64 {
    c[0] + c[1] * x[0] + c[2] * x[1] + c[3] * x[2]
}

fn whole(i: [u32; 3]) -> [f64; 3] {
    i.map(f64::from)
}

proptest! {
    #[test]
    fn linear_interpolation_reproduces_affine_data(c in coefficients(), x in inside()) {
        let v = interpolate(Filter::Linear, DIMS, 99.0, x, |i| affine(c, whole(i)));
        prop_assert!(close(v, affine(c, x), 1e-12), "{v} against {}", affine(c, x));
    }

    #[test]
    fn linear_interpolation_is_trilinear(x in inside()) {
        let f = |x: [f64; 3]| (1.0 + x[0]) * (2.0 - x[1]) * (0.5 + x[2]);
        let v = interpolate(Filter::Linear, DIMS, 99.0, x, |i| f(whole(i)));
        prop_assert!(close(v, f(x), 1e-12));
    }

    /// Catmull–Rom has third order: it reproduces polynomials up to degree 2 in each coordinate, not cubics.
    #[test]
    fn cubic_interpolation_reproduces_quadratic_data(c in coefficients(), x in well_inside()) {
        let f = |x: [f64; 3]| {
            (c[0] + c[1] * x[0] + c[2] * x[0] * x[0]) * (1.0 + x[1] * x[1]) * (c[3] + x[2] - 0.25 * x[2] * x[2])
        };
        let v = interpolate(Filter::Cubic, DIMS, 99.0, x, |i| f(whole(i)));
        prop_assert!(close(v, f(x), 1e-11), "{v} against {}", f(x));
    }

    #[test]
    fn every_filter_passes_through_the_samples(i in (0u32..6, 0u32..5, 0u32..7)) {
        let data = |i: [u32; 3]| f64::from(i[0] * 31 + i[1] * 17 + i[2] * 5 % 11).sin();
        let i = [i.0, i.1, i.2];
        for filter in [Filter::Nearest, Filter::Linear, Filter::Cubic] {
            let v = interpolate(filter, DIMS, 99.0, whole(i), data);
            prop_assert!(close(v, data(i), 1e-14), "{filter:?}");
        }
    }

    #[test]
    fn nearest_takes_the_voxel_the_point_lies_in(x in (-0.5..5.5f64, -0.5..4.5f64, -0.5..6.5f64)) {
        let x = [x.0, x.1, x.2];
        let data = |i: [u32; 3]| f64::from(i[0] + 10 * i[1] + 100 * i[2]);
        let v = interpolate(Filter::Nearest, DIMS, 99.0, x, data);
        // A voxel is the cube of side 1 around its sample.
        let distance: f64 = (0..3).map(|a| {
            let digit = (v / 10f64.powi(a as i32)).floor() % 10.0;
            (digit - x[a]).abs()
        }).fold(0.0, f64::max);
        prop_assert!(distance <= 0.5 + 1e-12, "{x:?} in the voxel of {v}");
    }

    /// Within the outer half voxel the value is that of the face next to it.
    #[test]
    fn the_rim_is_clamped(x in inside(), axis in 0usize..3, depth in 0.0..0.5f64, high in any::<bool>()) {
        let data = |i: [u32; 3]| f64::from(i[0] * 3 + i[1] * 7 + i[2] * 13).cos();
        let last = f64::from(DIMS[axis] - 1);
        let (mut rim, mut face) = (x, x);
        (rim[axis], face[axis]) = if high { (last + depth, last) } else { (-depth, 0.0) };
        for filter in [Filter::Nearest, Filter::Linear, Filter::Cubic] {
            let (a, b) = (interpolate(filter, DIMS, 99.0, rim, data), interpolate(filter, DIMS, 99.0, face, data));
            // Half-way between voxels nearest may differ, but not across the rim.
            prop_assert!(close(a, b, 1e-14), "{filter:?} {a} {b}");
            let g = interpolate_gradient(filter, DIMS, rim, data);
            prop_assert_eq!(g[axis], 0.0, "no slope across the rim");
        }
    }

    #[test]
    fn beyond_the_faces_is_outside(x in inside(), axis in 0usize..3, far in 0.5000001..1e9f64, high in any::<bool>()) {
        let mut x = x;
        x[axis] = if high { f64::from(DIMS[axis] - 1) + far } else { -far };
        for filter in [Filter::Nearest, Filter::Linear, Filter::Cubic] {
            prop_assert_eq!(interpolate(filter, DIMS, -7.0, x, |_| 1.0), -7.0);
            prop_assert_eq!(interpolate_gradient(filter, DIMS, x, |i| f64::from(i[0])), [0.0; 3]);
        }
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_interpolant(x in inside()) {
        let data = |i: [u32; 3]| f64::from(i[0] * 29 + i[1] * 13 + i[2] * 7).sin();
        let step = 1e-5;
        // Differences across a corner of the interpolant would be no derivative.
        prop_assume!(x.iter().all(|v| (v - v.round()).abs() > 2.0 * step));
        for filter in [Filter::Linear, Filter::Cubic] {
            let g = interpolate_gradient(filter, DIMS, x, data);
            for axis in 0..3 {
                let (mut low, mut high) = (x, x);
                low[axis] -= step;
                high[axis] += step;
                let slope = (interpolate(filter, DIMS, 0.0, high, data) - interpolate(filter, DIMS, 0.0, low, data))
                    / (2.0 * step);
                prop_assert!(close(g[axis], slope, 1e-8), "{filter:?} {} {slope}", g[axis]);
            }
        }
    }

    /// Interpolation never fetches beyond the grid, whatever the size.
    #[test]
    fn no_fetch_leaves_the_grid(dims in prop::array::uniform3(1u32..4), x in prop::array::uniform3(-1.0..4.0f64)) {
        for filter in [Filter::Nearest, Filter::Linear, Filter::Cubic] {
            let fetch = |i: [u32; 3]| {
                assert!((0..3).all(|a| i[a] < dims[a]), "{filter:?} fetched {i:?} of {dims:?}");
                2.5
            };
            let v = interpolate(filter, dims, 0.0, x, fetch);
            let within = (0..3).all(|a| x[a] >= -0.5 && x[a] <= f64::from(dims[a]) - 0.5);
            prop_assert!(close(v, if within { 2.5 } else { 0.0 }, 1e-14), "weights sum to 1");
            prop_assert!(interpolate_gradient(filter, dims, x, fetch).iter().all(|g| g.abs() < 1e-13));
        }
    }
}

#[test]
fn no_place_at_all_is_outside() {
    for x in [[f64::NAN, 0.0, 0.0], [0.0, f64::INFINITY, 0.0], [0.0, 0.0, f64::NEG_INFINITY]] {
        for filter in [Filter::Nearest, Filter::Linear, Filter::Cubic] {
            assert_eq!(interpolate(filter, DIMS, 4.0, x, |_| 1.0), 4.0);
        }
    }
}

/// Half-way between two voxels belongs to the upper one, but the last face belongs to the last voxel.
#[test]
fn ties_of_nearest() {
    let data = |i: [u32; 3]| f64::from(i[0]);
    let at = |x: f64| interpolate(Filter::Nearest, [3, 1, 1], 99.0, [x, 0.0, 0.0], data);
    assert_eq!([at(-0.5), at(0.49), at(0.5), at(1.5), at(2.5)], [0.0, 0.0, 1.0, 2.0, 2.0]);
}
