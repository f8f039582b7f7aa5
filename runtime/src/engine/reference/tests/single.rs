//! Single scattering: closed forms, independent quadratures, invariances.

use super::super::{Options, RayResult, Reference};
use super::build::*;
use super::closed::{panels, quad};
use crate::frame::vector::{Vec3, dot, normalize, scale};
use compiler::ir::eval::NoVoxels;
use compiler::ir::{Binary, FieldScene, Input, Scattering, Shape, SurfaceShape, Unary};
use std::f64::consts::PI;

fn lit() -> Build {
    Build { scattering: Some(Scattering::Single), ..Build::default() }
}

/// Radiance is within `rtol` and within its own error, which is of use.
#[track_caller]
fn near(result: &RayResult, exact: f64, rtol: f64) {
    let (l, error) = (result.radiance[0], result.error[0]);
    let wrong = (l - exact).abs();
    assert!(wrong <= rtol * exact.abs(), "radiance {l:e}, not {exact:e}: {:e}", wrong / exact);
    assert!(wrong <= error + 1e-12 * exact.abs(), "error {wrong:e} beyond {error:e}");
    assert!(error <= 1e-6 * l.abs() + 1e-300, "useless error {error:e} of {l:e}");
}

fn hg(g: f64, cosine: f64) -> f64 {
    (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5))
}

#[test]
fn ball_along_the_light() {
    let (k_a, k_s): (f64, f64) = (0.3, 1.2);
    let sigma = k_a + k_s;
    for (direction, g) in [
        ([0.0, 0.0, -1.0], None),
        ([0.0, 0.0, 1.0], None),
        ([0.0, 0.0, -1.0], Some(0.8)),
        ([0.0, 0.0, 1.0], Some(-0.5)),
    ] {
        let mut b = lit();
        let shape = b.sphere([0.0; 3], 1.0);
        let phase = g.map(|g| b.hg(g));
        b.milk(shape, k_a, k_s, phase);
        b.sun(direction, 5.0, None);
        let result = ahead(&b.scene(0.25));
        // Towards the eye the light went forward.
        let towards = direction[2] < 0.0;
        let phase = g.map_or(0.25 / PI, |g| hg(g, if towards { 1.0 } else { -1.0 }));
        let scattered = if towards { 2.0 * (-2.0 * sigma).exp() } else { -(-4.0 * sigma).exp_m1() / (2.0 * sigma) };
        near(&result, k_s * phase * 5.0 * scattered + 0.25 * (-2.0 * sigma).exp(), 1e-8);
        assert!((result.optical_depth[0] - 2.0 * sigma).abs() < 1e-14);
    }
}

/// Distance to the surface of a unit ball.
fn way_out(p: Vec3, w: Vec3) -> f64 {
    let b = dot(p, w);
    -b + (b * b + 1.0 - dot(p, p)).sqrt()
}

#[test]
fn ball_from_the_side() {
    let (k_a, k_s) = (0.3, 1.2);
    let light = normalize([0.7, -0.3, 0.2]).unwrap();
    let direction = normalize([-0.1, 0.02, 1.0]).unwrap();
    let origin = [0.3, 0.2, -4.0];
    let mut b = lit();
    let shape = b.sphere([0.0; 3], 1.0);
    let phase = b.hg(0.4);
    b.milk(shape, k_a, k_s, Some(phase));
    b.sun(light, 5.0, None);
    let result = trace(&b.scene(0.0), origin, direction);
    let w = scale(light, -1.0);
    let along = |t: f64| std::array::from_fn(|i| origin[i] + t * direction[i]);
    let m = dot(origin, direction);
    let half = (m * m + 1.0 - dot(origin, origin)).sqrt();
    let line = quad(|t| (-1.5 * (t + way_out(along(t - m - half), w))).exp(), 0.0, 2.0 * half);
    near(&result, k_s * hg(0.4, dot(w, direction)) * 5.0 * line, 1e-8);
}

#[test]
fn slab_at_every_incidence() {
    let (k_a, k_s, sigma): (f64, f64, f64) = (0.2, 0.9, 1.1);
    for (light, eye) in [
        ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]),
        ([-0.8, 0.0, -0.6], [0.0, 0.0, 1.0]),
        ([-0.8, 0.0, -0.6], [0.1, 0.5, 1.0]),
        ([0.48, 0.64, 0.6], [0.3, -0.5, 1.0]),
    ] {
        for g in [None, Some(0.6), Some(-0.9)] {
            let mut b = lit();
            let shape = b.slab([0.0, 0.0, 1.0], 0.0, 1.0);
            let phase = g.map(|g| b.hg(g));
            b.milk(shape, k_a, k_s, phase);
            b.sun(light, 2.0, None);
            let result = trace(&b.scene(0.0), [0.0, 0.0, -4.0], eye);
            let d = normalize(eye).unwrap();
            // e^(−σ z/v) on the way to the eye, e^(−σ z/u) or e^(−σ (1−z)/u) from the light.
            let (u, v) = (light[2].abs(), d[2]);
            let rate = if light[2] > 0.0 { 1.0 / v + 1.0 / u } else { 1.0 / v - 1.0 / u };
            let start = if light[2] > 0.0 { 1.0 } else { (-sigma / u).exp() };
            let x = sigma * rate;
            let line = if x.abs() < 1e-12 { 1.0 } else { -(-x).exp_m1() / x };
            let phase = g.map_or(0.25 / PI, |g| hg(g, -dot(light, d)));
            near(&result, k_s * phase * 2.0 / v * start * line, 1e-8);
        }
    }
}

#[test]
fn any_profile_against_the_light() {
    // With the light behind a slab, what is lost on both ways together is the whole depth: L = ϖ·phase·E·τ·e^(−τ).
    let mut b = lit();
    let shape = b.slab([0.0, 0.0, 1.0], 0.0, 1.0);
    let x = b.linear(2, 17.0, 0.3);
    let s = b.g.unary(Unary::Sin, x);
    let a = b.g.unary(Unary::Abs, s);
    let (k_a, k_s) = (b.times(0.5, a), b.times(1.5, a));
    b.scattering(shape, k_a, k_s, None);
    b.sun([0.0, 0.0, -1.0], 3.0, None);
    let result = ahead(&b.scene(0.0));
    let tau = result.optical_depth[0];
    let line = quad(|z| (17.0 * z + 0.3).sin().abs(), 0.0, 1.0);
    assert!((tau / (2.0 * line) - 1.0).abs() < 1e-5);
    near(&result, 0.75 / (4.0 * PI) * 3.0 * tau * (-tau).exp(), 1e-8);
}

#[test]
fn airlight_of_a_lamp() {
    // ∫ e^(−σ(t + d))/d² dt without end: t = c + q·tan θ takes the peak away.
    let (k_a, k_s, sigma): (f64, f64, f64) = (0.05, 0.2, 0.25);
    for (at, g) in
        [([1.0, 0.3, 2.0], None), ([0.05, 0.0, 1.0], None), ([1.0, 0.3, -6.0], None), ([1.0, 0.3, 2.0], Some(0.7))]
    {
        let mut b = lit();
        let phase = g.map(|g| b.hg(g));
        b.milk(Shape::Everywhere, k_a, k_s, phase);
        b.lamp(at, 3.0, None);
        let result = ahead(&b.scene(0.0));
        let c = at[2] + 4.0;
        let q = f64::hypot(at[0], at[1]);
        let line = quad(
            |theta: f64| {
                let d = q / theta.cos();
                let phase = g.map_or(0.25 / PI, |g| hg(g, -theta.sin()));
                phase * (-sigma * (c + q * theta.tan() + d)).exp()
            },
            (-c / q).atan(),
            0.5 * PI,
        );
        near(&result, k_s * 3.0 / q * line, 1e-7);
    }
    // Inside its radius the light is clamped.
    let mut b = lit();
    let shape = b.sphere([0.0; 3], 2.0);
    b.milk(shape, 0.0, 0.1, None);
    b.lamp([0.0; 3], 1.0, Some(0.5));
    let result = ahead(&b.scene(0.0));
    let line = quad(|z| (-0.1 * (z + 2.0 + z.abs())).exp() / z.abs().max(0.5).powi(2), -2.0, -0.5)
        + quad(|z| (-0.1 * (z + 2.0 + z.abs())).exp() * 4.0, -0.5, 0.0)
        + quad(|z| (-0.1 * (z + 2.0 + z.abs())).exp() * 4.0, 0.0, 0.5)
        + quad(|z| (-0.1 * (z + 2.0 + z.abs())).exp() / (z * z), 0.5, 2.0);
    near(&result, 0.1 * 0.25 / PI * line, 1e-8);
}

#[test]
fn thin_media() {
    for k in [1e-3, 1e-6, 1e-12] {
        let mut b = lit();
        let shape = b.sphere([0.0; 3], 1.0);
        let phase = b.hg(0.5);
        b.milk(shape, 0.0, k, Some(phase));
        b.sun([1.0, 0.0, 0.0], 2.0, None);
        let result = trace(&b.scene(0.0), [0.6, 0.0, -4.0], [0.0, 0.0, 1.0]);
        let first = k * hg(0.5, 0.0) * 2.0 * 1.6;
        assert!((result.radiance[0] / first - 1.0).abs() < 3.0 * k + 1e-9);
    }
}

#[test]
fn shadow_of_a_disc() {
    let sigma: f64 = 0.4;
    let mut b = lit();
    let shape = b.slab([1.0, 0.0, 0.0], -2.0, 2.0);
    b.milk(shape, 0.1, 0.3, None);
    b.sun([1.0, 0.0, 0.0], 3.0, None);
    b.disc([-1.0, 0.0, 0.3], [1.0, 0.0, 0.0], 0.25, 0.5);
    // Another on the far side, and one that the light meets edge on.
    b.disc([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 0.5);
    b.disc([-1.0, 0.0, 1.0], [0.0, 1.0, 0.0], 0.5, 0.5);
    let result = trace(&b.scene(0.0), [0.0, 0.0, -4.0], [0.0, 0.0, 1.0]);
    let j = 0.3 * 0.25 / PI * 3.0 * (-2.0 * sigma).exp();
    let lit = 1.0 - (-sigma * 4.05).exp() + (-sigma * 4.55).exp();
    near(&result, j / sigma * lit, 1e-8);
    assert_eq!(result.transmittance[0], 0.0);
}

#[test]
fn fog_before_a_lit_wall() {
    // Uniform fog from the eye to a wall, lamp at the eye: L = ∫ k_s/(4π)·I·e^(−2σt)/t² + …, beside the ray so that it ends.
    let (k_s, sigma): (f64, f64) = (0.3, 0.5);
    let mut b = lit();
    b.milk(Shape::Everywhere, 0.2, k_s, None);
    b.lamp([0.0, 0.5, -4.0], 2.0, None);
    b.plane([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 0.8);
    let result = ahead(&b.scene(9.0));
    let fog = quad(|theta: f64| (-sigma * (0.5 * theta.tan() + 0.5 / theta.cos())).exp(), 0.0, (5.0f64 / 0.5).atan());
    let d = f64::hypot(5.0, 0.5);
    let wall = 0.8 / PI * 2.0 / (d * d) * (5.0 / d) * (-sigma * (d + 5.0)).exp();
    near(&result, k_s * 0.25 / PI * 2.0 / 0.5 * fog + wall, 1e-8);
    assert!((result.optical_depth[0] - 2.5).abs() < 1e-12);
}

/// Haze of depth 0.4 over its floor and scale height 0.3, ϖ = 0.9.
fn haze(direction: Vec3, floor: bool, exact: bool) -> FieldScene {
    let mut b = lit();
    let a = b.linear(1, -1.0 / 0.3, 0.0);
    let mut e = b.exp(a);
    if !exact {
        // The same, but no closed form is seen in it.
        let x = b.axis(1);
        let (s, c) = (b.g.unary(Unary::Sin, x), b.g.unary(Unary::Cos, x));
        let (s, c) = (b.g.mul(s, s), b.g.mul(c, c));
        let one = b.g.add(s, c);
        e = b.g.mul(e, one);
    }
    let scale = 0.4 / 0.3;
    let (k_a, k_s) = (b.times(0.1 * scale, e), b.times(0.9 * scale, e));
    let phase = b.hg(0.3);
    b.scattering(Shape::Everywhere, k_a, k_s, Some(phase));
    b.sun(direction, 5.0, None);
    if floor {
        b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.5);
    }
    b.scene(0.2)
}

#[test]
fn haze_without_end() {
    let depth = |y: f64| 0.4 * (-y / 0.3).exp();
    let (y, phase) = (0.15, |c: f64| 0.9 * 5.0 * hg(0.3, c));
    let above = depth(y);
    for exact in [true, false] {
        // Straight up against the light that comes straight down.
        let scene = haze([0.0, -1.0, 0.0], true, exact);
        let up = trace(&scene, [0.0, y, 0.0], [0.0, 1.0, 0.0]);
        near(&up, (phase(1.0) * above + 0.2) * (-above).exp(), 1e-7);
        // Level: the same light all along.
        let level = trace(&scene, [0.0, y, 0.0], [1.0, 0.0, 0.0]);
        near(&level, phase(0.0) * (-above).exp(), 1e-7);
        // Down to the floor.
        let down = trace(&scene, [0.0, y, 0.0], [0.0, -1.0, 0.0]);
        let between = 0.4 - above;
        let scattered = phase(-1.0) * above.exp() * 0.5 * ((-2.0 * above).exp() - (-0.8f64).exp());
        near(&down, scattered + 0.5 / PI * 5.0 * (-0.4 - between).exp(), 1e-7);
    }
    // A slanted view and light, by the depth as variable: e^(−(τ₀−τ)/v − τ/u).
    let light = normalize([0.6, -0.5, 0.3]).unwrap();
    let d = normalize([0.3, 0.2, -0.5]).unwrap();
    let scene = haze(light, false, true);
    let found = trace(&scene, [0.0, y, 0.0], d);
    let (u, v) = (-light[1], d[1]);
    let line = quad(|tau| (-(above - tau) / v - tau / u).exp() / v, 0.0, above);
    near(&found, phase(-dot(light, d)) * line + 0.2 * (-above / v).exp(), 1e-7);
}

#[test]
fn white_sky_around_a_ball() {
    let (k_a, k_s, sigma): (f64, f64, f64) = (0.4, 0.8, 1.2);
    let mut b = Build { environment: true, ..lit() };
    let shape = b.sphere([0.0; 3], 1.0);
    b.milk(shape, k_a, k_s, None);
    let scene = b.scene(2.0);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let result = reference.trace([0.3, 0.0, -4.0], [0.0, 0.0, 1.0], &Options::default()).unwrap();
    // The mean of e^(−σs) over directions, about the radius; sines take the roots at the ends away.
    let mean = |r: f64| {
        let of = |m: f64| (-sigma * (-r * m + (r * r * m * m + 1.0 - r * r).sqrt())).exp();
        0.5 * (panels(|a| of(a.sin()) * a.cos(), -0.5 * PI, 0.0, 60)
            + panels(|a| of(1.0 - a.cos()) * a.sin(), 0.0, 0.5 * PI, 60))
    };
    let half = (1.0f64 - 0.09).sqrt();
    let at = |x: f64| (-sigma * half * (1.0 + x)).exp() * mean(f64::hypot(0.3, half * x));
    let line = half * panels(|a| at(a.sin()) * a.cos(), -0.5 * PI, 0.5 * PI, 120);
    near(&result, k_s * 2.0 * line + 2.0 * (-2.0 * sigma * half).exp(), 2e-7);
    // At the centre of a ball that scatters in a speck alone, every direction is the same depth away.
    let mut b = Build { environment: true, ..lit() };
    let (ball, speck) = (b.sphere([0.0; 3], 1.0), b.sphere([0.0; 3], 1e-3));
    b.plain(ball, sigma, 0.0);
    b.milk(speck, 0.0, 1e-3, None);
    let result = trace(&b.scene(2.0), [0.0; 3], [0.0, 0.0, 1.0]);
    let extra = result.radiance[0] - 2.0 * (-sigma - 1e-6f64).exp();
    assert!((extra / (1e-6 * 2.0 * (-sigma).exp()) - 1.0).abs() < 1e-3, "{extra:e}");
}

#[test]
fn sky_over_a_floor_in_thin_haze() {
    // A thin layer over black ground sees half of the sky: k·L₀/2 for every phase function with as much forward as back.
    let k = 1e-7;
    let mut b = Build { environment: true, ..lit() };
    let shape = b.slab([0.0, 1.0, 0.0], 1.0, 2.0);
    b.milk(shape, 0.0, k, None);
    b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.0);
    let result = trace(&b.scene(2.0), [0.0, 0.5, 0.0], [0.0, 1.0, 0.0]);
    assert!((result.radiance[0] - 2.0 * (1.0 - k) - k).abs() < 1e-12, "{:e}", result.radiance[0] - 2.0);
    let down = trace(
        &{
            let mut b = Build { environment: true, ..lit() };
            let shape = b.slab([0.0, 1.0, 0.0], 1.0, 2.0);
            b.milk(shape, 0.0, k, None);
            b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.0);
            b.scene(2.0)
        },
        [0.0, 3.0, 0.0],
        [0.0, -1.0, 0.0],
    );
    assert!((down.radiance[0] / k - 1.0).abs() < 1e-5, "{:e}", down.radiance[0]);
}

#[test]
fn small_discs_are_points() {
    // ∫ over a disc of an isotropic phase: E/(4π)·2/(1 + cos α).
    for alpha in [1e-4f64, 0.05, 0.5] {
        let mut b = lit();
        let shape = b.sphere([0.0; 3], 1.0);
        b.milk(shape, 0.0, 1e-14, None);
        b.sun([0.3, -1.0, 0.1], 5.0, Some(2.0 * alpha));
        let result = ahead(&b.scene(0.0));
        let exact = 2.0 * 1e-14 * 5.0 / (4.0 * PI) * 2.0 / (1.0 + alpha.cos());
        near(&result, exact, 2e-7);
    }
    // In a medium that dims it: apart by O(α²).
    let at = |alpha: Option<f64>| {
        let mut b = lit();
        let shape = b.sphere([0.0; 3], 1.0);
        let phase = b.hg(0.6);
        b.milk(shape, 0.2, 1.0, Some(phase));
        b.sun([0.3, -1.0, 0.1], 5.0, alpha.map(|a| 2.0 * a));
        ahead(&b.scene(0.0)).radiance[0]
    };
    let point = at(None);
    let (one, two) = (at(Some(0.05)) - point, at(Some(0.1)) - point);
    assert!((two / one - 4.0).abs() < 0.1, "{one:e} {two:e}");
}

#[test]
fn halves_scales_and_turns() {
    let base = |s: f64, turn: &dyn Fn(Vec3) -> Vec3, halves: bool| {
        let mut b = lit();
        let at = |v: Vec3| turn(v).map(|x| x * s);
        for _ in 0..if halves { 2 } else { 1 } {
            let share = if halves { 0.5 } else { 1.0 } / s;
            let shape = b.sphere(at([0.1, 0.0, 0.0]), s);
            let phase = b.hg(0.5);
            // A density that varies across the ball.
            let direction = b.g.vector(&turn([0.6, 0.0, 0.8]));
            let p = b.p();
            let x = b.g.dot(p, direction);
            let x = b.times(1.0 / s, x);
            let k = b.exp(x);
            let (k_a, k_s) = (b.times(0.3 * share, k), b.times(1.1 * share, k));
            b.scattering(shape, k_a, k_s, Some(phase));
        }
        b.disc(at([0.5, 1.0, 0.0]), turn([0.0, 1.0, 0.0]), 0.4 * s, 0.5);
        b.sun(turn([0.1, -1.0, 0.3]), 3.0, None);
        b.lamp(at([-1.0, 0.5, 0.3]), 2.0 * s * s, Some(0.1 * s));
        let scene = b.scene(0.1);
        trace(&scene, at([0.05, 0.1, -4.0]), turn([0.02, 0.0, 1.0])).radiance[0]
    };
    let same = |v: Vec3| v;
    let one = base(1.0, &same, false);
    // About (1, 1, 1) by a third, then about z by 0.3.
    let (sine, cosine) = 0.3f64.sin_cos();
    let turned = |v: Vec3| [cosine * v[2] - sine * v[0], sine * v[2] + cosine * v[0], v[1]];
    for other in [base(1e-6, &same, false), base(1e6, &same, false), base(1.0, &turned, false), base(1.0, &same, true)]
    {
        assert!((other / one - 1.0).abs() < 1e-8, "{other} {one}");
    }
}

#[test]
fn mixed_phases_add_up() {
    // Two media in one place: each with its own phase function, dimmed by both.
    let of = |first: (f64, Option<f64>), second: Option<(f64, Option<f64>)>| {
        let mut b = lit();
        for (k_s, g) in [Some(first), second].into_iter().flatten() {
            let shape = b.sphere([0.0; 3], 1.0);
            let phase = g.map(|g| b.hg(g));
            b.milk(shape, 0.0, k_s, phase);
        }
        b.sun([0.0, 0.0, -1.0], 1.0, None);
        ahead(&b.scene(0.0))
    };
    let both = of((0.3, Some(0.7)), Some((0.5, None)));
    near(&both, (0.3 * hg(0.7, 1.0) + 0.5 * 0.25 / PI) * 2.0 * (-1.6f64).exp(), 1e-8);
}

#[test]
fn phases_that_depend_on_place() {
    // g = 0.5·z: a mixture along the ray, thin.
    let mut b = lit();
    let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
    let g = b.linear(2, 0.5, 0.0);
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
    let phase = b.g.div(above, below);
    b.milk(shape, 0.0, 1e-9, Some(phase));
    b.sun([0.6, 0.0, 0.8], 1.0, None);
    let line = quad(|z| hg(0.5 * z, -0.8), -1.0, 1.0);
    let found = ahead(&b.scene(0.0));
    assert!((found.radiance[0] / (1e-9 * line) - 1.0).abs() < 1e-7);
}

#[test]
fn light_through_another_ball() {
    // The silhouette of one ball on another: depth has a root there.
    let mut b = lit();
    let (lit_ball, dim) = (b.sphere([0.0; 3], 1.0), b.sphere([0.0, 3.0, 0.2], 0.5));
    b.milk(lit_ball, 0.0, 0.7, None);
    b.plain(dim, 2.0, 0.0);
    b.sun([0.0, -1.0, 0.0], 1.0, None);
    let found = ahead(&b.scene(0.0));
    let chord = |z: f64| 2.0 * (0.25 - (z - 0.2) * (z - 0.2)).max(0.0).sqrt();
    let at = |z: f64| (-0.7 * (z + 1.0 + (1.0 - z * z).sqrt()) - 2.0 * chord(z)).exp();
    // z = 0.2 − ½·cos takes the roots away.
    let shaded = quad(|a: f64| at(0.2 - 0.5 * a.cos()) * 0.5 * a.sin(), 0.0, PI);
    let ends = |from: f64, to: f64| quad(|a: f64| at(a.sin()) * a.cos(), from.asin(), to.asin());
    near(&found, 0.7 * 0.25 / PI * (ends(-1.0, -0.3) + shaded + ends(0.7, 1.0)), 1e-8);
    // The same through a box: creases where the face that light enters by changes.
    let mut b = lit();
    let (lit_ball, dim) = (b.sphere([0.0; 3], 1.0), b.cube([-1.0, 2.0, -0.4], [1.0, 2.5, 0.3]));
    b.milk(lit_ball, 0.0, 0.7, None);
    b.plain(dim, 2.0, 0.0);
    let slope = 0.3;
    b.sun([0.0, -1.0, slope], 1.0, None);
    let found = ahead(&b.scene(0.0));
    let light = normalize([0.0, 1.0, -slope]).unwrap();
    let inside = |z: f64| {
        // Where the light that reaches z crosses y from 2 to 2.5.
        let at = |y: f64| z - slope * y;
        let (a, c) = (at(2.5).max(-0.4), at(2.0).min(0.3));
        (c - a).max(0.0) / slope * f64::hypot(1.0, slope)
    };
    let at = |z: f64| (-0.7 * (z + 1.0 + way_out([0.0, 0.0, z], light)) - 2.0 * inside(z)).exp();
    let mut places = [-1.0, -0.4 + slope * 2.0, -0.4 + slope * 2.5, 0.3 + slope * 2.0, 1.0];
    places.sort_by(f64::total_cmp);
    let line: f64 = places.windows(2).map(|p| quad(at, p[0], p[1])).sum();
    near(&found, 0.7 * 0.25 / PI * line, 1e-8);
}

#[test]
fn dense_media_stay_finite() {
    for k in [1e3, 1e9, 1e30] {
        let mut b = lit();
        let shape = b.sphere([0.0; 3], 1.0);
        b.milk(shape, 0.0, k, None);
        b.sun([0.0, 0.0, 1.0], 2.0, None);
        let found = ahead(&b.scene(1.0));
        // Lit from where it is seen: half of the light that is scattered back gets out, 1/(2σ)·k.
        let exact = 2.0 * 0.25 / PI * 0.5;
        let wrong = (found.radiance[0] - exact).abs();
        assert!(wrong <= 1e-8 * exact + found.error[0], "{k:e}: {} {exact} {:e}", found.radiance[0], found.error[0]);
        // Beyond what places can be told apart by, the error says so.
        assert!(k > 1e20 || found.error[0] < 1e-3 * exact, "{k:e}: {:e}", found.error[0]);
    }
}

#[test]
fn wrong_phases_are_named() {
    let mut b = lit();
    let shape = b.sphere([0.0; 3], 1.0);
    let cosine = b.g.input(Input::CosTheta);
    b.milk(shape, 0.0, 1.0, Some(cosine));
    b.sun([0.0, 0.0, 1.0], 2.0, None);
    let scene = b.scene(0.0);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let error = reference.trace([0.0, 0.0, -4.0], [0.0, 0.0, 1.0], &Options::default()).unwrap_err();
    assert_eq!(error.code, "E0650");
    assert!(error.message.contains("phase of medium `m0`"), "{}", error.message);
}

#[test]
fn bands_each_for_itself() {
    let mut b = Build { bands: 3, ..lit() };
    let shape = b.sphere([0.0; 3], 1.0);
    let zero = b.c(0.0);
    let k_s = b.g.vector(&[0.1, 1.0, 10.0]);
    b.scattering(shape, zero, k_s, None);
    b.sun([0.0, 0.0, 1.0], 2.0, None);
    let found = ahead(&b.scene(0.0));
    for (band, k) in [0.1, 1.0, 10.0].into_iter().enumerate() {
        let exact = 2.0 * 0.25 / PI * 0.5 * -f64::exp_m1(-4.0 * k);
        assert!((found.radiance[band] / exact - 1.0).abs() < 1e-8, "{band}");
    }
}

#[test]
fn pictures_need_less() {
    let mut b = lit();
    let shape = b.sphere([0.0; 3], 1.0);
    let r2 = b.square([0.0; 3]);
    let a = b.times(-3.0, r2);
    let e = b.exp(a);
    let (k_a, k_s) = (b.times(0.5, e), b.times(2.0, e));
    b.scattering(shape, k_a, k_s, None);
    b.sun([1.0, -1.0, 0.5], 2.0, None);
    let ball = b.sphere([-1.0, 1.0, 0.0], 0.3);
    b.surface(SurfaceShape::Boundary(ball), 0.5);
    let scene = b.scene(0.1);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    for o in [[0.0, 0.0, -4.0], [0.2, 0.1, -4.0], [-0.5, 0.5, -4.0]] {
        let cast = |options: &Options| reference.trace(o, [0.0, 0.0, 1.0], options).unwrap();
        let (fine, rough) = (cast(&Options::default()), cast(&Options::accuracy(1e-2, 1.0)));
        assert!(rough.evaluations < fine.evaluations);
        let wrong = (fine.radiance[0] - rough.radiance[0]).abs();
        assert!(wrong <= rough.error[0] + fine.error[0] && wrong < 0.25e-2, "{wrong:e} {:e}", rough.error[0]);
        // And the language's own rule with very many steps.
        let steps = cast(&Options { steps: Some(20_000), ..Options::default() });
        assert!((steps.radiance[0] / fine.radiance[0] - 1.0).abs() < 1e-3);
    }
}
