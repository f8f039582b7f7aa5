//! Multiple scattering: furnaces, published solutions, the limits in which it is something else, and whether errors are honest.

use super::super::{ErrorKind, Options, RayResult, Reference};
use super::build::*;
use super::closed::panels;
use crate::frame::vector::normalize;
use compiler::ir::eval::NoVoxels;
use compiler::ir::{Binary, FieldScene, Filter, Input, NodeId, Scattering, Shape, SurfaceShape, Unary};
use std::f64::consts::PI;

fn many() -> Build {
    Build { scattering: Some(Scattering::Multiple), ..Build::default() }
}

fn cast(scene: &FieldScene, o: [f64; 3], d: [f64; 3], samples: u64, seed: u64) -> RayResult {
    let reference = Reference::new(scene, &[], 0.0, &NoVoxels).unwrap();
    let options = Options { samples: Some(samples), seed, rtol: 1e-12, ..Options::default() };
    let result = reference.trace(o, d, &options).unwrap();
    assert_eq!(result.error_kind, ErrorKind::StandardError);
    result
}

fn straight(scene: &FieldScene, samples: u64) -> RayResult {
    cast(scene, [0.1, 0.05, -4.0], [0.0, 0.0, 1.0], samples, 1)
}

/// Within 4.5 standard errors, and those small enough to show a mistake.
#[track_caller]
fn agree(result: &RayResult, band: usize, exact: f64, most: f64) {
    let (l, error) = (result.radiance[band], result.error[band]);
    assert!((l - exact).abs() <= 4.5 * error, "{l} ± {error}, not {exact}");
    assert!(error <= most * exact, "± {error:e} of {exact:e} shows nothing");
}

/// A density that no closed form describes, between 0.5 and 2.5 times `k`.
fn wavy(b: &mut Build, k: f64) -> NodeId {
    let x = b.linear(2, 5.0, 0.3);
    let s = b.g.unary(Unary::Sin, x);
    let more = b.c(1.5);
    let s = b.g.add(s, more);
    b.times(k, s)
}

#[test]
fn white_furnace() {
    // Whatever there is, if it absorbs nothing it is not seen in uniform light.
    type Fill = fn(&mut Build);
    let fills: [(&str, Fill, bool); 7] = [
        (
            "uniform",
            |b| {
                let shape = b.sphere([0.0; 3], 1.0);
                b.milk(shape, 0.0, 3.0, None);
            },
            true,
        ),
        (
            "wavy",
            |b| {
                let shape = b.sphere([0.0; 3], 1.0);
                let (zero, k_s) = (b.c(0.0), wavy(b, 2.0));
                b.scattering(shape, zero, k_s, None);
            },
            true,
        ),
        (
            "two at once",
            |b| {
                let (one, two) = (b.sphere([0.0; 3], 1.0), b.cube([-0.5; 3], [0.9; 3]));
                let (zero, k_s) = (b.c(0.0), wavy(b, 2.0));
                b.scattering(one, zero, k_s, None);
                b.milk(two, 0.0, 5.0, None);
            },
            true,
        ),
        (
            "layer that thins",
            |b| {
                let a = b.linear(2, 0.7, 0.0);
                let e = b.exp(a);
                let (zero, k_s) = (b.c(0.0), b.times(0.5, e));
                let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
                b.scattering(shape, zero, k_s, None);
            },
            true,
        ),
        (
            "white ball in mist",
            |b| {
                let (shape, core) = (b.sphere([0.0; 3], 1.0), b.sphere([0.0, 0.0, 0.2], 0.4));
                b.milk(shape, 0.0, 1.0, None);
                b.surface(SurfaceShape::Boundary(core), 1.0);
            },
            true,
        ),
        (
            "forward",
            |b| {
                let shape = b.sphere([0.0; 3], 1.0);
                let phase = b.hg(0.85);
                b.milk(shape, 0.0, 6.0, Some(phase));
            },
            false,
        ),
        (
            "backward here, forward there",
            |b| {
                let shape = b.sphere([0.0; 3], 1.0);
                let phase = place_phase(b);
                b.milk(shape, 0.0, 4.0, Some(phase));
            },
            false,
        ),
    ];
    for (name, fill, exact) in fills {
        let mut b = Build { environment: true, ..many() };
        fill(&mut b);
        let result = straight(&b.scene(2.0), 2048);
        let wrong = (result.radiance[0] - 2.0).abs();
        if exact {
            assert!(wrong < 1e-12, "{name}: {}", result.radiance[0]);
        } else {
            assert!(
                wrong <= 4.5 * result.error[0] && result.error[0] < 0.04,
                "{name}: {} ± {}",
                result.radiance[0],
                result.error[0]
            );
        }
    }
}

/// HG with g = 0.6·z.
fn place_phase(b: &mut Build) -> NodeId {
    let g = b.linear(2, 0.6, 0.0);
    let cosine = b.g.input(Input::CosTheta);
    let g2 = b.g.mul(g, g);
    let one = b.c(1.0);
    let above = b.g.sub(one, g2);
    let above = b.times(0.25 / PI, above);
    let gc = b.g.mul(g, cosine);
    let gc = b.times(-2.0, gc);
    let below = b.g.add(one, g2);
    let below = b.g.add(below, gc);
    let power = b.c(1.5);
    let below = b.g.binary(Binary::Pow, below, power);
    b.g.div(above, below)
}

#[test]
fn little_scattering_is_single() {
    // Orders beyond the first are a thousandth of it here.
    let scene = |scattering: Scattering, light: usize| {
        let mut b = Build { scattering: Some(scattering), ..Build::default() };
        let shape = b.sphere([0.0; 3], 1.0);
        let (k_a, k_s) = (wavy(&mut b, 0.5), wavy(&mut b, 1e-4));
        let phase = if light == 2 { place_phase(&mut b) } else { b.hg(0.5) };
        b.scattering(shape, k_a, k_s, Some(phase));
        match light {
            0 => b.sun([0.3, -1.0, 0.2], 5.0, None),
            1 => b.lamp([0.3, 0.2, 0.1], 2.0, None),
            2 => b.lamp([1.5, 0.2, -2.0], 2.0, Some(0.1)),
            3 => b.sun([0.3, -1.0, 0.2], 5.0, Some(0.7)),
            _ => b.environment = true,
        }
        b.disc([0.0, 1.5, 0.0], [0.0, 1.0, 0.0], 0.3, 0.0);
        b.scene(if light == 4 { 1.0 } else { 0.0 })
    };
    for light in 0..5 {
        let o = [0.1, 0.05, -4.0];
        let single = scene(Scattering::Single, light);
        let reference = Reference::new(&single, &[], 0.0, &NoVoxels).unwrap();
        let options = Options { rtol: 1e-4, ..Options::default() };
        let exact = reference.trace(o, [0.0, 0.0, 1.0], &options).unwrap();
        let found = cast(&scene(Scattering::Multiple, light), o, [0.0, 0.0, 1.0], 8192, 3);
        let off = (found.radiance[0] - exact.radiance[0]).abs();
        assert!(
            off <= 4.5 * found.error[0] + 2e-3 * exact.radiance[0],
            "{light}: {} ± {} {}",
            found.radiance[0],
            found.error[0],
            exact.radiance[0]
        );
        assert!(found.error[0] < 0.05 * exact.radiance[0], "{light}: ± {}", found.error[0]);
        assert!((found.optical_depth[0] - exact.optical_depth[0]).abs() < 1e-3 * exact.optical_depth[0]);
    }
}

/// H(μ) for isotropic scattering (Chandrasekhar 1950): 1/H = √(1 − ϖ) + ϖ/2·∫ μ′H(μ′)/(μ + μ′) dμ′, by iteration.
fn h_function(albedo: f64, mu: &[f64]) -> Vec<f64> {
    let n = 400;
    let nodes: Vec<f64> = (0..n).map(|i| (f64::from(i) + 0.5) / f64::from(n)).collect();
    let mut h = vec![1.0; nodes.len()];
    let at = |h: &[f64], mu: f64| {
        let sum: f64 = nodes.iter().zip(h).map(|(m, h)| m * h / (mu + m)).sum::<f64>() / f64::from(n);
        1.0 / ((1.0 - albedo).sqrt() + 0.5 * albedo * sum)
    };
    for _ in 0..200 {
        h = nodes.iter().map(|m| at(&h, *m)).collect();
    }
    mu.iter().map(|m| at(&h, *m)).collect()
}

#[test]
fn light_reflected_by_half_of_space() {
    for (albedo, closed) in [(0.5, true), (0.9, true), (0.9, false), (0.99, true)] {
        for (mu0, mu) in [(0.6, 1.0), (1.0, 0.8), (0.3, 0.4)] {
            let mut b = many();
            let deep = b.slab([0.0, 0.0, 1.0], 0.0, 400.0);
            if closed {
                b.milk(deep, 1.0 - albedo, albedo, None);
            } else {
                // Depth alone matters, not how it is spread.
                let (k_a, k_s) = (wavy(&mut b, 1.0 - albedo), wavy(&mut b, albedo));
                b.scattering(deep, k_a, k_s, None);
            }
            b.sun([(1.0f64 - mu0 * mu0).sqrt(), 0.0, mu0], 3.0, None);
            let d = [0.0, (1.0f64 - mu * mu).sqrt(), mu];
            let result = cast(&b.scene(0.0), [0.0, 0.0, -1.0], d, 16384, 5);
            let h = h_function(albedo, &[mu, mu0]);
            let exact = albedo / (4.0 * PI) * 3.0 * mu0 / (mu + mu0) * h[0] * h[1];
            agree(&result, 0, exact, 0.02);
        }
    }
}

#[test]
fn inside_of_a_white_ball() {
    // Every point of the wall sees every other alike: L = a·E/π/(1 − a).
    let albedo = 0.7;
    let mut b = many();
    let wall = b.sphere([0.0; 3], 2.0);
    b.surface(SurfaceShape::Boundary(wall), albedo);
    b.lamp([0.0; 3], 3.0, None);
    let result = cast(&b.scene(0.0), [0.3, 0.0, 0.0], [0.0, 0.6, 0.8], 8192, 1);
    agree(&result, 0, albedo * 0.75 / PI / (1.0 - albedo), 0.02);
}

#[test]
fn emission_on_the_way() {
    for (k_a, k_e) in [(2.0, 3.0), (1e-3, 3.0), (0.0, 3.0)] {
        let mut b = many();
        let shape = b.sphere([0.0; 3], 1.0);
        b.plain(shape, k_a, k_e);
        let result = cast(&b.scene(0.5), [0.0, 0.0, -4.0], [0.0, 0.0, 1.0], 16384, 1);
        let tau: f64 = 2.0 * k_a;
        let exact = if tau == 0.0 { 6.0 } else { k_e / k_a * -(-tau).exp_m1() } + 0.5 * (-tau).exp();
        agree(&result, 0, exact, 0.02);
    }
    // Fog without end: what it emits it absorbs.
    let mut b = many();
    let a = b.linear(1, -1.0, 0.0);
    let e = b.exp(a);
    let (k_a, k_e) = (b.times(0.3, e), b.times(0.6, e));
    b.medium(Shape::Everywhere, k_a, k_e);
    let up = cast(&b.scene(0.5), [0.0; 3], [0.0, 1.0, 0.0], 16384, 1);
    agree(&up, 0, 2.0 * -(-0.3f64).exp_m1() + 0.5 * (-0.3f64).exp(), 0.02);
}

#[test]
fn standard_errors_are_honest() {
    // Means of many seeds are as far apart as each of them says.
    let mut b = many();
    let shape = b.sphere([0.0; 3], 1.0);
    let phase = b.hg(0.5);
    b.milk(shape, 0.2, 3.0, Some(phase));
    b.sun([1.0, -1.0, 0.3], 5.0, None);
    b.lamp([0.5, 0.5, -1.5], 1.0, None);
    let scene = b.scene(0.1);
    let results: Vec<RayResult> =
        (0..120).map(|seed| cast(&scene, [0.1, 0.05, -4.0], [0.0, 0.0, 1.0], 1024, seed)).collect();
    let n = results.len() as f64;
    let mean = results.iter().map(|r| r.radiance[0]).sum::<f64>() / n;
    let chi: f64 = results.iter().map(|r| ((r.radiance[0] - mean) / r.error[0]).powi(2)).sum::<f64>() / (n - 1.0);
    // χ²/119 has a standard deviation of 0.13, and batches of 32 add a little.
    assert!((0.55..1.7).contains(&chi), "{chi}");
    let again = cast(&scene, [0.1, 0.05, -4.0], [0.0, 0.0, 1.0], 1024, 7);
    assert_eq!(again, results[7]);
    assert_ne!(results[7].radiance, results[8].radiance);
    // More samples, smaller errors, by the square root.
    let more = cast(&scene, [0.1, 0.05, -4.0], [0.0, 0.0, 1.0], 16384, 7);
    let ratio = results.iter().map(|r| r.error[0]).sum::<f64>() / n / more.error[0];
    assert!((2.4..6.5).contains(&ratio), "{ratio}");
    // A tolerance that is reached ends early.
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let options = Options { samples: Some(1 << 20), rtol: 0.05, ..Options::default() };
    let rough = reference.trace([0.1, 0.05, -4.0], [0.0, 0.0, 1.0], &options).unwrap();
    assert!(rough.error[0] <= 0.051 * rough.radiance[0] && rough.evaluations < more.evaluations);
}

#[test]
fn bands_share_paths() {
    let k_s = [0.2, 1.0, 12.0];
    let scene = |bands: usize, pick: Option<usize>, closed: bool| {
        let mut b = Build { bands, ..many() };
        let shape = b.sphere([0.0; 3], 1.0);
        let k_a = b.c(0.1);
        let k = match pick {
            Some(i) => b.c(k_s[i]),
            None => b.g.vector(&k_s),
        };
        let k = if closed {
            k
        } else {
            let density = wavy(&mut b, 0.7);
            let density = b.g.widen(density, if pick.is_some() { 1 } else { 3 });
            b.g.mul(k, density)
        };
        let phase = b.hg(0.4);
        b.scattering(shape, k_a, k, Some(phase));
        b.sun([1.0, -1.0, 0.3], 5.0, None);
        b.scene(0.1)
    };
    for closed in [true, false] {
        let all = straight(&scene(3, None, closed), 32768);
        for band in 0..3 {
            let one = straight(&scene(1, Some(band), closed), 32768);
            let spread = f64::hypot(one.error[0], all.error[band]);
            assert!(
                (one.radiance[0] - all.radiance[band]).abs() < 4.5 * spread,
                "{band}: {} {}",
                one.radiance[0],
                all.radiance[band]
            );
            assert!(spread < 0.05 * one.radiance[0], "{band}: ± {spread} of {}", one.radiance[0]);
        }
    }
}

#[test]
fn energy_never_grows() {
    // Light from everywhere on something that absorbs: less comes from it, and the less the more it absorbs.
    let mut last = 2.0;
    for k_a in [0.0, 0.1, 1.0, 10.0] {
        let mut b = Build { environment: true, ..many() };
        let shape = b.sphere([0.0; 3], 1.0);
        let phase = b.hg(0.3);
        b.milk(shape, k_a, 4.0, Some(phase));
        let result = straight(&b.scene(2.0), 8192);
        assert!(result.radiance[0] <= last + 4.5 * result.error[0], "{k_a}: {} after {last}", result.radiance[0]);
        last = result.radiance[0];
    }
    assert!(last < 0.5);
    // A layer gives back no more than it gets: reflected and passed on flux under the sun, by rays all over a hemisphere.
    let mut b = many();
    let layer = b.slab([0.0, 0.0, 1.0], 0.0, 2.0);
    b.milk(layer, 0.0, 1.0, None);
    b.sun([0.0, 0.0, 1.0], 1.0, None);
    let scene = b.scene(0.0);
    let flux = |side: f64| {
        panels(
            |mu| {
                let d = [(1.0 - mu * mu).sqrt(), 0.0, side * mu];
                2.0 * PI * mu * cast(&scene, [0.0, 0.0, 1.0 - 4.0 * side], d, 2048, 9).radiance[0]
            },
            0.0,
            1.0,
            4,
        )
    };
    let total = flux(1.0) + flux(-1.0) + (-2.0f64).exp();
    assert!((total - 1.0).abs() < 0.01, "{total}");
}

#[test]
fn what_has_no_bound_is_refused() {
    let refused = |fill: &dyn Fn(&mut Build)| {
        let mut b = many();
        fill(&mut b);
        b.sun([0.0, 0.0, 1.0], 1.0, None);
        let scene = b.scene(0.0);
        let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
        let options = Options { samples: Some(64), ..Options::default() };
        reference.trace([0.1, 0.0, -4.0], [0.0, 0.0, 1.0], &options).map_err(|e| e.code)
    };
    // Everywhere, without a closed form; bounded in space but not in value; bounded in both.
    let ripples = |b: &mut Build, shape: Shape| {
        let (zero, k_s) = (b.c(0.0), wavy(b, 0.1));
        b.scattering(shape, zero, k_s, None);
    };
    assert_eq!(refused(&|b| ripples(b, Shape::Everywhere)).unwrap_err(), "E0655");
    let pole = |b: &mut Build| {
        let shape = b.sphere([0.0; 3], 1.0);
        let (zero, r2) = (b.c(0.0), b.square([0.0; 3]));
        let one = b.c(1.0);
        let k_s = b.g.div(one, r2);
        b.scattering(shape, zero, k_s, None);
    };
    assert_eq!(refused(&pole).unwrap_err(), "E0655");
    let square = |b: &mut Build| {
        let shape = b.sphere([0.0; 3], 1.0);
        let (zero, r2) = (b.c(0.0), b.square([3.0, 0.0, 0.0]));
        b.scattering(shape, zero, r2, None);
    };
    assert!(refused(&square).is_ok());
}

#[test]
fn grids_bound_themselves() {
    // Voxels of 64-bit numbers, which could be anything, hold 0 and 3.
    let mut b = Build { environment: true, ..many() };
    let sample = b.grid([2, 2, 2], [1.0; 3], [-0.5; 3], Filter::Linear);
    let (shape, zero) = (b.cube([-1.0; 3], [1.0; 3]), b.c(0.0));
    b.scattering(shape, zero, sample, None);
    let scene = b.scene(2.0);
    let voxels = Values { dims: [2, 2, 2], data: vec![0.0, 3.0, 3.0, 0.0, 1.0, 0.0, 2.0, 3.0] };
    let reference = Reference::new(&scene, &[], 0.0, &voxels).unwrap();
    let options = Options { samples: Some(1024), ..Options::default() };
    let d = normalize([0.1, 0.2, 1.0]).unwrap();
    let result = reference.trace([0.0, 0.0, -4.0], d, &options).unwrap();
    assert!((result.radiance[0] - 2.0).abs() < 1e-12, "{}", result.radiance[0]);
}
