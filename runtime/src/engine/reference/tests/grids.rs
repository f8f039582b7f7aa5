//! Voxels against brute force that knows every cell.

use super::build::*;
use compiler::ir::eval::interpolate;
use compiler::ir::{Filter, Shape, Table};

fn noise(n: usize) -> Vec<f64> {
    let mut state = 12345u64;
    (0..n)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        })
        .collect()
}

/// Optical depth and radiance (S = `source` of the value) of `scale·value` along a ray, by cutting at every half voxel and
/// Gauss rules on many parts of each piece.
struct Brute<'a> {
    values: &'a Values,
    filter: Filter,
    spacing: [f64; 3],
    scale: f64,
    parts: usize,
}

impl Brute<'_> {
    fn run(&self, o: [f64; 3], d: [f64; 3], k: impl Fn(f64) -> f64, s: impl Fn(f64) -> f64) -> (f64, f64) {
        let l = d.iter().map(|x| x * x).sum::<f64>().sqrt();
        let d = d.map(|x| x / l);
        let mut cuts = vec![0.0];
        for axis in 0..3 {
            for i in -1..=2 * self.values.dims[axis] as i64 {
                let t = (0.5 * i as f64 * self.spacing[axis] - o[axis]) / d[axis];
                if t > 0.0 && t.is_finite() {
                    cuts.push(t);
                }
            }
        }
        cuts.sort_by(f64::total_cmp);
        let at = |t: f64| {
            let index = std::array::from_fn(|i| (o[i] + d[i] * t) / self.spacing[i]);
            let v = &self.values;
            interpolate(self.filter, v.dims, 0.0, index, |[i, j, k]| {
                v.data[(i + v.dims[0] * (j + v.dims[1] * k)) as usize]
            })
        };
        let (mut tau, mut radiance) = (0.0f64, 0.0);
        let x = [0.339_981_043_584_856_3, 0.861_136_311_594_052_6];
        let w = [0.652_145_154_862_546_2, 0.347_854_845_137_453_8];
        for pair in cuts.windows(2) {
            let h = (pair[1] - pair[0]) / self.parts as f64;
            for i in 0..self.parts {
                let m = pair[0] + h * (i as f64 + 0.5);
                let sample = |z: f64| self.scale * k(at(m + 0.5 * h * z));
                // Depth by Gauss; the radiance of a tiny part with its mean source as seen through half of it.
                let nodes = [(-x[0], w[0]), (x[0], w[0]), (-x[1], w[1]), (x[1], w[1])];
                let part: f64 = nodes.iter().map(|(z, w)| 0.5 * h * w * sample(*z)).sum();
                let (mut lost, mut seen) = (0.0, 0.0);
                for (z, w) in nodes {
                    let weight = w * sample(z) * (-0.5 * part * (1.0 + z)).exp();
                    lost += weight;
                    seen += weight * s(at(m + 0.5 * h * z));
                }
                if part > 0.0 {
                    radiance += (-tau).exp() * seen / lost * -(-part).exp_m1();
                }
                tau += part;
            }
        }
        (radiance, tau)
    }
}

fn compare(dims: [u32; 3], spacing: [f64; 3], filter: Filter, scale: f64, o: [f64; 3], d: [f64; 3]) {
    let values = Values { dims, data: noise((dims[0] * dims[1] * dims[2]) as usize) };
    let mut b = Build::default();
    let sample = b.grid(dims, spacing, [0.0; 3], filter);
    let zero = b.c(0.0);
    let sample = b.max(sample, zero);
    let k_a = b.times(scale, sample);
    let k_e = b.g.mul(k_a, sample);
    let corner = |s: f64| -> [f64; 3] { std::array::from_fn(|i| spacing[i] * (s * f64::from(dims[i]) - 0.5)) };
    let shape = b.cube(corner(0.0), corner(1.0));
    b.medium(shape, k_a, k_e);
    let scene = b.scene(0.0);
    let result = trace_in(&scene, &values, o, d);
    let brute = Brute { values: &values, filter, spacing, scale, parts: 400 };
    let (radiance, tau) = brute.run(o, d, |v| v.max(0.0), |v| v);
    assert!(tau > 0.0, "the ray misses");
    expect(&result, radiance, tau);
    // The error is honest about depth at once; cell faces leave nothing to search for.
    if filter == Filter::Nearest {
        assert!(result.evaluations < 200 * u64::from(dims.iter().sum::<u32>()));
    }
}

#[test]
fn random_voxels() {
    for filter in [Filter::Linear, Filter::Nearest, Filter::Cubic] {
        compare([7, 6, 5], [1.0; 3], filter, 0.7, [-2.0, 1.3, 0.7], [1.0, 0.31, 0.23]);
        compare([7, 6, 5], [1.0; 3], filter, 0.7, [2.2, 1.3, 0.7], [0.0, 0.0, 1.0]);
    }
}

#[test]
fn one_voxel_and_flat_grids() {
    for filter in [Filter::Linear, Filter::Nearest, Filter::Cubic] {
        compare([1, 1, 1], [1.0; 3], filter, 2.0, [-2.0, 0.1, 0.2], [1.0, 0.0, 0.0]);
        compare([1, 5, 1], [1.0; 3], filter, 2.0, [0.1, -2.0, 0.2], [0.02, 1.0, 0.01]);
    }
}

#[test]
fn spacing_of_one_to_a_thousand() {
    compare([30, 6, 4], [0.01, 10.0, 1.0], Filter::Linear, 0.5, [-0.1, 12.0, 1.1], [0.004, 1.0, 0.03]);
    compare([30, 6, 4], [0.01, 10.0, 1.0], Filter::Linear, 5.0, [-0.1, 22.0, 1.1], [1.0, 0.2, 0.03]);
}

#[test]
fn transfer_function_of_a_grid() {
    let dims = [6, 6, 6];
    let values = Values { dims, data: noise(216) };
    let mut b = Build::default();
    let sample = b.grid(dims, [1.0; 3], [0.0; 3], Filter::Linear);
    let stops = [(0.2, 0.0), (0.4, 1.0), (0.41, 5.0), (0.41, 0.5), (0.8, 3.0)];
    let keys = stops.map(|s| b.c(s.0)).to_vec();
    let rows = stops.map(|s| b.c(s.1)).to_vec();
    let table = b.g.add_table(Table { name: "t".into(), span: None, keys, values: rows, width: 1 });
    let k_a = b.g.push(compiler::ir::Op::Lookup { table, at: sample });
    let k_e = b.g.mul(k_a, sample);
    let shape = b.cube([-0.5; 3], [5.5; 3]);
    b.medium(shape, k_a, k_e);
    let scene = b.scene(0.0);
    let (o, d) = ([-2.0, 1.3, 0.7], [1.0, 0.31, 0.23]);
    let result = trace_in(&scene, &values, o, d);
    let lookup = |x: f64| {
        let after = stops.iter().filter(|s| s.0 <= x).count();
        match after {
            0 => 0.0,
            5 => 3.0,
            _ => {
                let (a, b) = (stops[after - 1], stops[after]);
                a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0)
            }
        }
    };
    // Brute force does not know the stops: it is only as good as its parts.
    let brute = Brute { values: &values, filter: Filter::Linear, spacing: [1.0; 3], scale: 1.0, parts: 40_000 };
    let (radiance, tau) = brute.run(o, d, lookup, |v| v);
    assert!((result.radiance[0] / radiance - 1.0).abs() < 2e-6, "{} {radiance}", result.radiance[0]);
    assert!((result.optical_depth[0] / tau - 1.0).abs() < 2e-6);
    assert!(result.error[0] <= 1e-10 * radiance);
    // Stops are solved for, not searched for.
    assert!(result.evaluations < 3000, "{}", result.evaluations);
}

#[test]
fn everywhere_with_a_grid() {
    // The grid alone bounds the medium.
    let dims = [4, 4, 4];
    let values = Values { dims, data: vec![0.5; 64] };
    let mut b = Build::default();
    let sample = b.grid(dims, [1.0; 3], [0.0; 3], Filter::Linear);
    let zero = b.c(0.0);
    b.medium(Shape::Everywhere, sample, zero);
    let scene = b.scene(1.0);
    let result = trace_in(&scene, &values, [-100.0, 1.0, 1.2], [1.0, 0.0, 0.0]);
    expect(&result, (-2.0f64).exp(), 2.0);
}
