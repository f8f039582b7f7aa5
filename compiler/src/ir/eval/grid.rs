//! Interpolation between voxels, in f64.

use crate::ir::Filter;

/// Where a coordinate falls on one axis: clamped coordinate, or `None` outside the outer faces; NaN is outside.
fn clamp_axis(x: f64, n: u32) -> Option<(f64, bool)> {
    let last = f64::from(n) - 1.0;
    (x >= -0.5 && x <= last + 0.5).then(|| (x.clamp(0.0, last), x > 0.0 && x < last))
}

/// Up to four taps on one axis: indices, weights, and the derivatives of the weights.
struct Taps {
    index: [u32; 4],
    weight: [f64; 4],
    slope: [f64; 4],
    count: usize,
}

fn taps(filter: Filter, x: f64, n: u32, inside: bool) -> Taps {
    let last = n - 1;
    match filter {
        Filter::Nearest => {
            // Half-way belongs to the upper voxel.
            let i = ((x + 0.5).floor() as u32).min(last);
            Taps { index: [i; 4], weight: [1.0, 0.0, 0.0, 0.0], slope: [0.0; 4], count: 1 }
        }
        Filter::Linear => {
            let i = (x.floor() as u32).min(last.saturating_sub(1));
            let t = x - f64::from(i);
            let s = if inside { 1.0 } else { 0.0 };
            Taps {
                index: [i, (i + 1).min(last), 0, 0],
                weight: [1.0 - t, t, 0.0, 0.0],
                slope: [-s, s, 0.0, 0.0],
                count: 2,
            }
        }
        Filter::Cubic => {
            let i = (x.floor() as u32).min(last.saturating_sub(1));
            let t = x - f64::from(i);
            let s = if inside { 0.5 } else { 0.0 };
            let weight = [
                0.5 * t * ((2.0 - t) * t - 1.0),
                0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
                0.5 * t * ((4.0 - 3.0 * t) * t + 1.0),
                0.5 * (t - 1.0) * t * t,
            ];
            let slope = [
                s * ((4.0 - 3.0 * t) * t - 1.0),
                s * t * (9.0 * t - 10.0),
                s * ((8.0 - 9.0 * t) * t + 1.0),
                s * t * (3.0 * t - 2.0),
            ];
            Taps { index: [i.saturating_sub(1), i, (i + 1).min(last), (i + 2).min(last)], weight, slope, count: 4 }
        }
    }
}

fn axes(filter: Filter, dims: [u32; 3], at: [f64; 3]) -> Option<[Taps; 3]> {
    let x = clamp_axis(at[0], dims[0])?;
    let y = clamp_axis(at[1], dims[1])?;
    let z = clamp_axis(at[2], dims[2])?;
    Some([taps(filter, x.0, dims[0], x.1), taps(filter, y.0, dims[1], y.1), taps(filter, z.0, dims[2], z.1)])
}

/// Value of a grid at voxel coordinates; see [`crate::ir::Op::Sample`].
pub fn interpolate(filter: Filter, dims: [u32; 3], outside: f64, at: [f64; 3], fetch: impl Fn([u32; 3]) -> f64) -> f64 {
    let Some([x, y, z]) = axes(filter, dims, at) else { return outside };
    let mut value = 0.0;
    for k in 0..z.count {
        for j in 0..y.count {
            let mut row = 0.0;
            for i in 0..x.count {
                row += x.weight[i] * fetch([x.index[i], y.index[j], z.index[k]]);
            }
            value += row * y.weight[j] * z.weight[k];
        }
    }
    value
}

/// Derivative of [`interpolate`] with respect to `at`.
pub fn interpolate_gradient(filter: Filter, dims: [u32; 3], at: [f64; 3], fetch: impl Fn([u32; 3]) -> f64) -> [f64; 3] {
    let Some([x, y, z]) = axes(filter, dims, at) else { return [0.0; 3] };
    let mut gradient = [0.0; 3];
    for k in 0..z.count {
        for j in 0..y.count {
            for i in 0..x.count {
                let v = fetch([x.index[i], y.index[j], z.index[k]]);
                gradient[0] += v * x.slope[i] * y.weight[j] * z.weight[k];
                gradient[1] += v * x.weight[i] * y.slope[j] * z.weight[k];
                gradient[2] += v * x.weight[i] * y.weight[j] * z.slope[k];
            }
        }
    }
    gradient
}
