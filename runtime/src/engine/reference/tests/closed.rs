//! Closed forms.

use super::super::{ErrorKind, Options, Reference};
use super::build::*;
use compiler::ir::eval::NoVoxels;
use compiler::ir::{FieldScene, Input, PrimitiveKind, Shape};

fn ball(k_a: f64, k_e: f64, background: f64) -> FieldScene {
    let mut b = Build::default();
    let shape = b.sphere([0.0; 3], 1.0);
    b.plain(shape, k_a, k_e);
    b.scene(background)
}

/// S(1 − e^(−τ)) + T·L.
fn uniform(k_a: f64, k_e: f64, length: f64, background: f64) -> f64 {
    let tau: f64 = k_a * length;
    if tau == 0.0 {
        return k_e * length + background;
    }
    k_e / k_a * -(-tau).exp_m1() + (-tau).exp() * background
}

#[test]
fn uniform_ball() {
    let scene = ball(2.0, 3.0, 0.0);
    let on = ahead(&scene);
    close(&on, uniform(2.0, 3.0, 2.0, 0.0), 4.0, 2e-15);
    assert_eq!(on.error_kind, ErrorKind::Bound);
    let off = trace(&scene, [0.6, 0.0, -4.0], [0.0, 0.0, 1.0]);
    close(&off, uniform(2.0, 3.0, 1.6, 0.0), 3.2, 4e-15);
    let inside = trace(&scene, [0.0, 0.0, 0.5], [0.0, 0.0, 3.0]);
    close(&inside, uniform(2.0, 3.0, 0.5, 0.0), 1.0, 2e-15);
    let miss = trace(&scene, [0.0, 1.5, -4.0], [0.0, 0.0, 1.0]);
    assert_eq!((miss.radiance[0], miss.optical_depth[0], miss.evaluations), (0.0, 0.0, 0));
}

#[test]
fn absorbing_slab_and_background() {
    let mut b = Build::default();
    let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
    b.plain(shape, 0.7, 0.0);
    let scene = b.scene(5.0);
    close(&ahead(&scene), 5.0 * (-1.4f64).exp(), 1.4, 1e-15);
    let slanted = trace(&scene, [0.0, 0.0, -4.0], [1.0, 0.0, 1.0]);
    close(&slanted, 5.0 * (-1.4 * 2f64.sqrt()).exp(), 1.4 * 2f64.sqrt(), 4e-15);
    close(&ahead(&ball(2.0, 3.0, 7.0)), uniform(2.0, 3.0, 2.0, 7.0), 4.0, 2e-15);
}

#[test]
fn emission_with_little_or_much_absorption() {
    close(&ahead(&ball(0.0, 3.0, 1.0)), 7.0, 0.0, 1e-15);
    close(&ahead(&ball(1e-12, 3.0, 0.0)), uniform(1e-12, 3.0, 2.0, 0.0), 2e-12, 1e-14);
    close(&ahead(&ball(1e6, 3.0, 1.0)), 3e-6, 2e6, 1e-15);
    close(&ahead(&ball(1e30, 3.0, 1.0)), 3e-30, 2e30, 1e-15);
}

#[test]
fn linear_density() {
    // σ = 1 + (z + 1)/2·3 over z in [−1, 1], j = 2σ + 1 for a source that varies.
    let mut b = Build::default();
    let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
    let k_a = b.linear(2, 1.5, 2.5);
    let twice = b.times(2.0, k_a);
    let one = b.c(1.0);
    let k_e = b.g.add(twice, one);
    b.medium(shape, k_a, k_e);
    let scene = b.scene(0.3);
    let tau: f64 = 5.0;
    // ∫₀² e^{−(s + 0.75 s²)} ds by the error function is awkward; a fine Gauss rule will do.
    let extra = quad(|s| (-(s + 0.75 * s * s)).exp(), 0.0, 2.0);
    expect(&ahead(&scene), 2.0 * (1.0 - (-tau).exp()) + extra + 0.3 * (-tau).exp(), tau);
}

/// Composite Gauss with four points on 2000 panels.
pub(super) fn quad(f: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    panels(f, a, b, 2000)
}

/// Likewise on `n` panels.
pub(super) fn panels(f: impl Fn(f64) -> f64, a: f64, b: f64, n: i32) -> f64 {
    let (x, w) =
        ([0.339_981_043_584_856_3, 0.861_136_311_594_052_6], [0.652_145_154_862_546_2, 0.347_854_845_137_453_8]);
    let h = (b - a) / f64::from(n);
    let panel = |i: i32| {
        let m = a + h * (f64::from(i) + 0.5);
        (0..2).map(|k| w[k] * (f(m - 0.5 * h * x[k]) + f(m + 0.5 * h * x[k]))).sum::<f64>()
    };
    0.5 * h * (0..n).map(panel).sum::<f64>()
}

#[test]
fn exponential_density() {
    // k = 3 e^{−2z}, S = 1.5.
    let mut b = Build::default();
    let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
    let a = b.linear(2, -2.0, 0.0);
    let e = b.exp(a);
    let (k_a, k_e) = (b.times(3.0, e), b.times(4.5, e));
    b.medium(shape, k_a, k_e);
    let scene = b.scene(1.0);
    let tau = 1.5 * (2f64.exp() - (-2f64).exp());
    expect(&ahead(&scene), 1.5 * (1.0 - (-tau).exp()) + (-tau).exp(), tau);
}

/// erf by its Maclaurin series; fine for |x| ≤ 4.
fn erf(x: f64) -> f64 {
    let (mut term, mut sum, mut n) = (x, x, 0.0);
    while f64::abs(term) > 1e-18 {
        n += 1.0;
        term *= -x * x / n;
        sum += term / (2.0 * n + 1.0);
    }
    sum * 2.0 / std::f64::consts::PI.sqrt()
}

#[test]
fn gaussian_blob() {
    for (width, distance) in [(0.5, 0.2), (0.05, 0.0), (1e-3, 1e-3), (1e-5, 0.0)] {
        let mut b = Build::default();
        let shape = b.sphere([0.0; 3], 1.0);
        let r2 = b.square([0.0; 3]);
        let a = b.times(-1.0 / (width * width), r2);
        let e = b.exp(a);
        let (k_a, k_e) = (b.times(2.0, e), b.times(6.0, e));
        b.medium(shape, k_a, k_e);
        let scene = b.scene(1.0);
        let result = trace(&scene, [distance, 0.0, -4.0], [0.0, 0.0, 1.0]);
        let half = (1.0f64 - distance * distance).sqrt() / width;
        let line = std::f64::consts::PI.sqrt() * width * if half > 4.0 { 1.0 - erfc_tail(half) } else { erf(half) };
        let tau = 2.0 * (-(distance / width).powi(2)).exp() * line;
        expect(&result, 3.0 * -(-tau).exp_m1() + (-tau).exp(), tau);
    }
}

fn erfc_tail(x: f64) -> f64 {
    if x > 27.0 { 0.0 } else { (-x * x).exp() / (x * std::f64::consts::PI.sqrt()) }
}

#[test]
fn overlapping_and_nested() {
    let mut b = Build::default();
    let outer = b.sphere([0.0; 3], 1.0);
    let inner = b.sphere([0.0; 3], 0.5);
    let aside = b.sphere([0.0, 0.0, 1.0], 0.5);
    b.plain(outer, 1.0, 1.0);
    b.plain(inner, 2.0, 6.0);
    b.plain(aside, 0.5, 0.0);
    let scene = b.scene(2.0);
    // Segments: [−1,−½] 1/1, [−½,½] 3/7, [½,1] 1.5/1, [1,1.5] 0.5/0.
    let mut radiance = 2.0;
    for (k, e, h) in [(0.5, 0.0, 0.5), (1.5, 1.0, 0.5), (3.0, 7.0, 1.0), (1.0, 1.0, 0.5f64)] {
        radiance = uniform(k, e, h, radiance);
    }
    close(&ahead(&scene), radiance, 0.25 + 0.75 + 3.0 + 0.5, 1e-14);
}

#[test]
fn constructive_shapes() {
    let mut b = Build::default();
    let (ball, hole) = (b.sphere([0.0; 3], 1.0), b.sphere([0.0, 0.0, -1.0], 0.5));
    let cut = b.slab([0.0, 0.0, 1.0], -9.0, 0.25);
    let shape = Shape::Intersection(vec![Shape::Difference(Box::new(ball), vec![hole]), cut]);
    b.plain(shape, 1.0, 1.0);
    let far = b.sphere([0.0, 0.0, 3.0], 1.0);
    let near = b.sphere([0.0, 0.0, 2.5], 1.0);
    b.plain(Shape::Union(vec![far, near]), 1.0, 1.0);
    let scene = b.scene(0.0);
    let length: f64 = 0.75 + 2.5;
    close(&ahead(&scene), -(-length).exp_m1(), length, 1e-14);
}

#[test]
fn signed_distance_shape() {
    let mut b = Build::default();
    let r2 = b.square([0.0; 3]);
    let r = b.g.unary(compiler::ir::Unary::Sqrt, r2);
    let one = b.c(1.0);
    let field = b.g.sub(r, one);
    b.plain(primitive(PrimitiveKind::Sdf { field }), 2.0, 3.0);
    let scene = b.scene(0.0);
    close(&ahead(&scene), uniform(2.0, 3.0, 2.0, 0.0), 4.0, 1e-13);
    close(&trace(&scene, [0.6, 0.0, -4.0], [0.0, 0.0, 1.0]), uniform(2.0, 3.0, 1.6, 0.0), 3.2, 1e-13);
    close(&trace(&scene, [0.0; 3], [0.0, 0.0, 1.0]), uniform(2.0, 3.0, 1.0, 0.0), 2.0, 1e-13);
}

fn atmosphere() -> FieldScene {
    // k_a = 0.2 e^{−y/8}, S = 3.
    let mut b = Build::default();
    let a = b.linear(1, -1.0 / 8.0, 0.0);
    let e = b.exp(a);
    let (k_a, k_e) = (b.times(0.2, e), b.times(0.6, e));
    b.medium(Shape::Everywhere, k_a, k_e);
    b.scene(1.0)
}

#[test]
fn exponential_atmosphere_without_end() {
    let scene = atmosphere();
    for sine in [1.0f64, 0.3, 1e-2, 1e-4] {
        let up = trace(&scene, [0.0, 2.0, 0.0], [(1.0 - sine * sine).sqrt(), sine, 0.0]);
        let tau = 1.6 * (-0.25f64).exp() / sine;
        expect(&up, 3.0 * -(-tau).exp_m1() + (-tau).exp(), tau);
    }
    for direction in [[1.0, 0.0, 0.0], [1.0, -0.1, 0.0], [0.0, -1.0, 0.0]] {
        let result = trace(&scene, [0.0, 2.0, 0.0], direction);
        close(&result, 3.0, f64::INFINITY, 1e-12);
        assert_eq!(result.transmittance[0], 0.0);
    }
}

#[test]
fn uniform_without_end() {
    let mut b = Build::default();
    b.plain(Shape::Everywhere, 0.5, 2.0);
    close(&ahead(&b.scene(1.0)), 4.0, f64::INFINITY, 1e-15);
    let mut b = Build::default();
    b.plain(Shape::Everywhere, 0.0, 2.0);
    let scene = b.scene(1.0);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let error = reference.trace([0.0; 3], [0.0, 0.0, 1.0], &Options::default()).unwrap_err();
    assert_eq!(error.code, "E0652");
    // A slab along the ray is without end too.
    let mut b = Build::default();
    let shape = b.slab([0.0, 1.0, 0.0], -1.0, 1.0);
    b.plain(shape, 0.5, 2.0);
    close(&ahead(&b.scene(1.0)), 4.0, f64::INFINITY, 1e-15);
}

#[test]
fn power_law_without_end() {
    // 1/(1 + z²) from −∞… here from −4 on: τ = atan 4 + π/2.
    let mut b = Build::default();
    let z = b.axis(2);
    let z2 = b.g.mul(z, z);
    let one = b.c(1.0);
    let d = b.g.add(one, z2);
    let k = b.g.div(one, d);
    b.medium(Shape::Everywhere, k, k);
    let scene = b.scene(0.0);
    let tau = 4f64.atan() + std::f64::consts::FRAC_PI_2;
    expect(&ahead(&scene), -(-tau).exp_m1(), tau);
}

#[test]
fn altitude_over_a_planet() {
    // Air of scale height 8e-3 planet radii over a planet, straight up from two millionths.
    let mut b = Build::default();
    let (center, radius) = (b.g.vector(&[0.0, -1.0, 0.0]), b.c(1.0));
    b.shells.push((center, radius));
    let outer = b.c(1.1);
    let h = b.g.input(Input::Altitude(0));
    let a = b.times(-1000.0, h);
    let e = b.exp(a);
    let (k_a, k_e) = (b.times(700.0, e), b.times(1400.0, e));
    b.medium(primitive(PrimitiveKind::Shell { center, inner: radius, outer }), k_a, k_e);
    let scene = b.scene(0.0);
    let up = trace(&scene, [0.0, 2e-6, 0.0], [0.0, 1.0, 0.0]);
    let tau = 0.7 * ((-2e-3f64).exp() - (-100f64).exp());
    expect(&up, 2.0 * -(-tau).exp_m1(), tau);
    let down = trace(&scene, [0.0, 2e-6, 0.0], [0.0, -1.0, 0.0]);
    // Two altitudes above ground, then the other side of the planet.
    let tau = 0.7 * -(-2e-3f64).exp_m1() + 0.7;
    expect(&down, 2.0 * -(-tau).exp_m1(), tau);
}

#[test]
fn invariances() {
    // All lengths × s, coefficients / s.
    let wavy = |s: f64| {
        let mut b = Build::default();
        let shape = b.sphere([0.0; 3], s);
        let a = b.linear(2, 3.0 / s, 0.4);
        let w = b.g.unary(compiler::ir::Unary::Sin, a);
        let e = b.exp(w);
        let k_a = b.times(2.0 / s, e);
        let k_e = b.c(3.0 / s);
        b.medium(shape, k_a, k_e);
        b.scene(0.5)
    };
    let at = |s: f64| trace(&wavy(s), [0.3 * s, 0.1 * s, -4.0 * s], [0.0, 0.0, 1.0]);
    let one = at(1.0);
    for s in [1e-6, 1e6] {
        let other = at(s);
        assert!((other.radiance[0] / one.radiance[0] - 1.0).abs() < 1e-10);
        assert!((other.optical_depth[0] / one.optical_depth[0] - 1.0).abs() < 1e-10);
    }
    let back = trace(&wavy(1.0), [0.3, 0.1, 4.0], [0.0, 0.0, -1.0]);
    assert!((back.optical_depth[0] / one.optical_depth[0] - 1.0).abs() < 1e-10);
    // Split at z = 0: composing the halves gives the whole.
    let near = trace(&wavy(1.0), [0.3, 0.1, 0.0], [0.0, 0.0, 1.0]);
    let whole_tau = one.optical_depth[0];
    let front_tau = whole_tau - near.optical_depth[0];
    let front_back = trace(&wavy(1.0), [0.3, 0.1, 0.0], [0.0, 0.0, -1.0]);
    assert!((front_back.optical_depth[0] / front_tau - 1.0).abs() < 1e-9);
}

#[test]
fn wrong_coefficients_are_named() {
    let mut b = Build::default();
    let shape = b.sphere([0.0; 3], 1.0);
    let k = b.linear(2, 1.0, 0.0);
    let zero = b.c(0.0);
    b.medium(shape, k, zero);
    let scene = b.scene(0.0);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let error = reference.trace([0.0, 0.0, -4.0], [0.0, 0.0, 1.0], &Options::default()).unwrap_err();
    assert_eq!(error.code, "E0650");
    assert!(error.message.contains("k_a of medium `m0`") && error.message.contains(" m"), "{}", error.message);
    let mut b = Build::default();
    let x = b.linear(2, 1.0, -5.0);
    let k = b.g.unary(compiler::ir::Unary::Sqrt, x);
    let zero = b.c(0.0);
    let shape = b.sphere([0.0; 3], 1.0);
    b.medium(shape, zero, k);
    let scene = b.scene(0.0);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let error = reference.trace([0.0, 0.0, -4.0], [0.0, 0.0, 1.0], &Options::default()).unwrap_err();
    assert_eq!(error.code, "E0651");
    assert!(error.message.contains("k_e"));
    let error = reference.trace([0.0; 3], [0.0; 3], &Options::default()).unwrap_err();
    assert_eq!(error.code, "E0654");
}

#[test]
fn fixed_steps_converge_with_order_two() {
    let mut b = Build::default();
    let shape = b.sphere([0.0; 3], 1.0);
    let r2 = b.square([0.1, 0.2, 0.3]);
    let a = b.times(-3.0, r2);
    let e = b.exp(a);
    let k_a = b.times(4.0, e);
    let x = b.linear(2, 2.0, 0.0);
    let w = b.exp(x);
    b.medium(shape, k_a, w);
    let scene = b.scene(0.7);
    let exact = ahead(&scene).radiance[0];
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let error = |n: u32| {
        let options = Options { steps: Some(n), ..Options::default() };
        (reference.trace([0.0, 0.0, -4.0], [0.0, 0.0, 1.0], &options).unwrap().radiance[0] - exact).abs()
    };
    let points: Vec<(f64, f64)> = [16, 32, 64, 128, 256].map(|n| (f64::from(n).ln(), error(n).ln())).to_vec();
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let slope = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>()
        / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>();
    assert!((slope + 2.0).abs() < 0.1, "slope {slope}");
}

#[test]
fn pictures_on_all_cores() {
    let scene = ball(2.0, 3.0, 0.25);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let camera = crate::frame::Camera::from_scene(&scene, &[], 0.0).unwrap();
    let last = std::sync::Mutex::new(0.0f64);
    let progress = |share: f64| {
        let mut last = last.lock().unwrap();
        *last = last.max(share);
    };
    let offsets = crate::frame::sample_offsets(4);
    let picture = reference.render(&camera, &offsets, &Options::default(), &progress).unwrap();
    assert_eq!(*last.lock().unwrap(), 1.0);
    assert_eq!(picture.pixels.radiance.len(), 16 * 12);
    let some = reference.pixels(&camera, &[[7, 5], [0, 0]], &offsets, &Options::default()).unwrap();
    assert_eq!(some.radiance[0], picture.pixels.radiance[5 * 16 + 7]);
    assert_eq!(some.radiance[1], 0.25);
    assert_eq!(some.transmittance[1], 1.0);
    let empty = reference.render(&camera.with_size([0, 0]), &offsets, &Options::default(), &|_| {}).unwrap();
    assert!(empty.pixels.radiance.is_empty());
}
