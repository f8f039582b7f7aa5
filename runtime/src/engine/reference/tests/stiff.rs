//! Coefficients that jump, spike and dwarf everything.

use super::super::{Goal, Options, Reference};
use super::build::*;
use compiler::ir::eval::NoVoxels;
use compiler::ir::{Binary, Compare, Fold, Op, PrimitiveKind, Shape, Table, Unary};

#[test]
fn varying_and_huge() {
    // σ = a(1 + s), j = a(1 + s)(1 + s) with s = z + 1 in [0, 2]: S = 1 + s. L = ∫ S e^{−τ} dτ with τ = a(s + s²/2).
    // 1 + s = √(1 + 2τ/a); substitution u = (1 + s)²·a/2 makes it an incomplete gamma function; for a → ∞, L → 1 + 1/a.
    for a in [1e3, 1e6, 1e12, 1e30] {
        let mut b = Build::default();
        let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
        let source = b.linear(2, 1.0, 2.0);
        let k_a = b.times(a, source);
        let k_e = b.g.mul(k_a, source);
        b.medium(shape, k_a, k_e);
        let scene = b.scene(1.0);
        // Asymptotic series of ∫ √(1 + 2x/a) e^{−x} dx: Σ binomial(½, n) (2/a)ⁿ n!.
        let exact = 1.0 + 1.0 / a - 1.0 / (a * a) + 3.0 / (a * a * a) - 15.0 / a.powi(4);
        expect(&ahead(&scene), exact, 4.0 * a);
    }
}

#[test]
fn jump_of_1e12() {
    // k = 1 for z < 0.1234, 1e12 beyond; S = 1 before, 5 beyond.
    for emission in [true, false] {
        let mut b = Build::default();
        let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
        let (z, place) = (b.axis(2), b.c(0.1234));
        let before = b.g.compare(Compare::Less, z, place);
        let (one, huge, five) = (b.c(1.0), b.c(1e12), b.c(if emission { 5e12 } else { 0.0 }));
        let k_a = b.g.select(before, one, huge);
        let k_e = b.g.select(before, one, five);
        b.medium(shape, k_a, k_e);
        let scene = b.scene(3.0);
        let tau = 1.1234;
        let radiance = 1.0 - f64::exp(-tau) + if emission { 5.0 * f64::exp(-tau) } else { 0.0 };
        expect(&ahead(&scene), radiance, tau + 1e12 * (1.0 - 0.1234));
    }
}

#[test]
fn hidden_jump() {
    // A step that no event announces: floor of a smooth bend inside a sine. Bisection alone has to find it.
    let mut b = Build::default();
    let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
    // tanh(1e18·(z − 0.3)) is a step for all that f64 can tell.
    let x = b.linear(2, 1e18, -0.3e18);
    let step = b.g.unary(compiler::ir::Unary::Tanh, x);
    let one = b.c(1.0);
    let k = b.g.add(step, one);
    b.medium(shape, k, k);
    let scene = b.scene(2.0);
    let tau: f64 = 1.4;
    expect(&ahead(&scene), 1.0 - (-tau).exp() + 2.0 * (-tau).exp(), tau);
}

#[test]
fn thin_shell() {
    let mut b = Build::default();
    let (center, inner, outer) = (b.g.vector(&[0.0; 3]), b.c(1.0 - 1e-4), b.c(1.0));
    b.plain(primitive(PrimitiveKind::Shell { center, inner, outer }), 100.0, 300.0);
    let scene = b.scene(0.0);
    let tau: f64 = 0.02;
    close(&ahead(&scene), 3.0 * -(-tau).exp_m1(), tau, 1e-11);
    // The same as a field inside a ball: |r − 0.99995| < 5e-5.
    let mut b = Build::default();
    let shape = b.sphere([0.0; 3], 1.5);
    let r2 = b.square([0.0; 3]);
    let r = b.g.unary(compiler::ir::Unary::Sqrt, r2);
    let middle = b.c(1.0 - 5e-5);
    let off = b.g.sub(r, middle);
    let off = b.g.unary(compiler::ir::Unary::Abs, off);
    let width = b.c(5e-5);
    let inside = b.g.compare(Compare::Less, off, width);
    let (k, zero) = (b.c(100.0), b.c(0.0));
    let k_a = b.g.select(inside, k, zero);
    let k_e = b.times(3.0, k_a);
    b.medium(shape, k_a, k_e);
    let scene = b.scene(0.0);
    let result = trace(&scene, [0.3, 0.0, -4.0], [0.0, 0.0, 1.0]);
    let chord = |r: f64| (r * r - 0.09).sqrt();
    let tau = 200.0 * (chord(1.0) - chord(1.0 - 1e-4));
    expect(&result, 3.0 * -(-tau).exp_m1(), tau);
}

#[test]
fn spike_in_a_table() {
    // A transfer spike of width 1e-4 on a key that rises along the ray.
    let mut b = Build::default();
    let shape = b.slab([0.0, 0.0, 1.0], -1.0, 1.0);
    let keys: Vec<_> = [0.0, 0.5, 0.50005, 0.5001, 1.0].map(|k| b.c(k)).to_vec();
    let values: Vec<_> = [0.0, 0.0, 1e4, 0.0, 0.0].map(|k| b.c(k)).to_vec();
    let table = b.g.add_table(Table { name: "t".into(), span: None, keys, values, width: 1 });
    // (z + 1)²/4: curved, so that the stops have to be found.
    let x = b.linear(2, 0.5, 0.5);
    let key = b.g.mul(x, x);
    let k = b.g.push(compiler::ir::Op::Lookup { table, at: key });
    b.medium(shape, k, k);
    let scene = b.scene(1.0);
    // ∫ spike dz = ∫ spike(key)·dz/dkey dkey, dz/dkey = 1/√key.
    let hat = |x: f64| if x < 0.50005 { (x - 0.5) * 2e8 } else { (0.5001 - x) * 2e8 };
    let n = 200_000;
    let tau: f64 = (0..n)
        .map(|i| 0.5 + 1e-4 * (f64::from(i) + 0.5) / f64::from(n))
        .map(|key| hat(key) / key.sqrt() * 1e-4 / f64::from(n))
        .sum();
    let result = ahead(&scene);
    assert!((result.optical_depth[0] / tau - 1.0).abs() < 1e-9);
    assert!((result.radiance[0] - 1.0).abs() < 1e-12);
}

#[test]
fn picture_accuracy_costs_less() {
    let mut b = Build::default();
    let r2 = b.square([0.0; 3]);
    let a = b.times(-4.0, r2);
    let e = b.exp(a);
    let k = b.times(3.0, e);
    let two = b.times(2.0, k);
    let shape = b.sphere([0.0; 3], 1.0);
    let z = b.linear(2, 0.4, 1.0);
    let k_e = b.g.mul(two, z);
    b.medium(shape, k, k_e);
    let scene = b.scene(0.1);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let cast = |o: &Options| reference.trace([0.2, 0.0, -4.0], [0.0, 0.0, 1.0], o).unwrap();
    let fine = cast(&Options::default());
    let options = Options::accuracy(1e-2, 1.0);
    assert_eq!(options.goal, Goal::Radiance);
    let rough = cast(&options);
    let wrong = (rough.radiance[0] - fine.radiance[0]).abs();
    assert!(wrong <= 1e-2 && wrong <= rough.error[0] + fine.error[0]);
    assert!(rough.evaluations <= fine.evaluations);
    let capped = cast(&Options { max_evaluations: 10, rtol: 1e-15, ..Options::default() });
    assert!(!capped.complete || capped.error[0] < 1e-14);
}

#[test]
fn nothing_at_all() {
    let scene = Build::default().scene(0.5);
    close(&ahead(&scene), 0.5, 0.0, 0.0);
    let mut b = Build::default();
    b.plain(Shape::Union(vec![]), 1.0, 1.0);
    close(&ahead(&b.scene(0.5)), 0.5, 0.0, 0.0);
}

/// Fields of every temper over a ball, each with an emission of its own.
fn tempers() -> Vec<(&'static str, compiler::ir::FieldScene)> {
    let mut scenes = vec![];
    let mut with = |name, k: &dyn Fn(&mut Build) -> compiler::ir::NodeId| {
        let mut b = Build::default();
        let shape = b.sphere([0.0; 3], 1.0);
        let k_a = k(&mut b);
        let source = b.linear(2, 0.5, 1.0);
        let k_e = b.g.mul(k_a, source);
        b.medium(shape, k_a, k_e);
        scenes.push((name, b.scene(0.2)));
    };
    with("waves", &|b| {
        let x = b.linear(2, 25.0, 0.3);
        let s = b.g.unary(Unary::Sin, x);
        let one = b.c(1.2);
        b.g.add(s, one)
    });
    with("creases", &|b| {
        let x = b.linear(2, 9.0, 0.3);
        let s = b.g.unary(Unary::Sin, x);
        let a = b.g.unary(Unary::Abs, s);
        b.times(4.0, a)
    });
    with("root", &|b| {
        let x = b.linear(2, 1.0, 1.0);
        b.g.unary(Unary::Sqrt, x)
    });
    with("steps in a loop", &|b| {
        let i = b.g.push(Op::LoopVar(0));
        let z = b.linear(2, 2.0, 5.1);
        let x = b.g.mul(z, i);
        let f = b.g.unary(Unary::Floor, x);
        let rest = b.g.sub(x, f);
        let sum = b.g.reduce(Fold::Sum, 0, 1..5, rest);
        b.times(0.5, sum)
    });
    with("noise", &|b| {
        // Value noise along z: random numbers blended by a smooth step.
        let z = b.linear(2, 7.0, 0.4);
        let f = b.g.unary(Unary::Floor, z);
        let t = b.g.sub(z, f);
        let (two, three) = (b.c(2.0), b.c(3.0));
        let tt = b.g.mul(t, t);
        let s = b.g.mul(two, t);
        let s = b.g.sub(three, s);
        let s = b.g.mul(tt, s);
        let zero = b.c(0.0);
        let random = |b: &mut Build, shift: f64| {
            let shift = b.c(shift);
            let x = b.g.add(f, shift);
            let cell = b.g.compose(&[x, zero, zero]);
            let hash = b.g.push(Op::CellHash { cell, seed: zero });
            b.g.extract(hash, 0)
        };
        let (a, c) = (random(b, 0.0), random(b, 1.0));
        let d = b.g.sub(c, a);
        let d = b.g.mul(d, s);
        let n = b.g.add(a, d);
        let half = b.c(0.45);
        let n = b.g.sub(n, half);
        let n = b.max(n, zero);
        b.times(8.0, n)
    });
    with("dense", &|b| {
        let x = b.linear(2, 3.0, 0.3);
        let e = b.exp(x);
        b.times(300.0, e)
    });
    with("ripples in the distance", &|b| {
        let r2 = b.square([0.1, 0.05, 0.0]);
        let r = b.g.unary(Unary::Sqrt, r2);
        let x = b.times(30.0, r);
        let s = b.g.unary(Unary::Cos, x);
        let one = b.c(1.0);
        let s = b.g.add(s, one);
        b.g.binary(Binary::Pow, s, one)
    });
    scenes
}

#[test]
fn errors_hold_at_every_tolerance() {
    for (name, scene) in tempers() {
        let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
        for (origin, direction) in [([0.0, 0.0, -4.0], [0.0, 0.0, 1.0]), ([0.31, 0.2, -4.0], [-0.01, 0.02, 1.0])] {
            let cast = |o: &Options| reference.trace(origin, direction, o).unwrap();
            let truth = cast(&Options { rtol: 1e-13, ..Options::default() });
            for exponent in 2..12 {
                let rtol = 10f64.powi(-exponent);
                for goal in [Goal::All, Goal::Radiance] {
                    let result = cast(&Options { rtol, goal, ..Options::default() });
                    let (l, wrong) = (truth.radiance[0], (result.radiance[0] - truth.radiance[0]).abs());
                    assert!(wrong <= result.error[0] + 2e-13 * l, "{name} {rtol:e}: {wrong:e} > {:e}", result.error[0]);
                    assert!(result.complete && result.error[0] <= 1.01 * rtol * l + 1e-13 * l, "{name} {rtol:e}");
                    if goal == Goal::All {
                        let (tau, wrong) = (truth.optical_depth[0], result.optical_depth[0] - truth.optical_depth[0]);
                        assert!(wrong.abs() <= result.error_tau[0] + 2e-13 * tau, "{name} {rtol:e}: depth {wrong:e}");
                    }
                }
            }
        }
    }
}

#[test]
fn bands_of_every_size() {
    // 0, 1 and 1e30 side by side.
    let mut b = Build { bands: 3, ..Build::default() };
    let shape = b.sphere([0.0; 3], 1.0);
    let z = b.linear(2, 0.5, 1.0);
    let scale = b.g.vector(&[0.0, 1.0, 1e30]);
    let k_a = b.g.mul(scale, z);
    let k_e = b.c(3.0);
    b.medium(shape, k_a, k_e);
    let scene = b.scene(0.5);
    let result = ahead(&scene);
    assert!((result.radiance[0] - 6.5).abs() < 1e-14);
    assert_eq!(result.optical_depth[0], 0.0);
    assert!((result.optical_depth[1] - 2.0).abs() < 1e-14);
    assert!((result.radiance[2] - 6e-30).abs() < 1e-39, "{:e}", result.radiance[2]);
    assert_eq!(result.transmittance[2], 0.0);
}

#[test]
fn overflow_is_an_error_with_a_place() {
    for scale in [1e300, 1e308] {
        let mut b = Build::default();
        let shape = b.sphere([0.0; 3], 1.0);
        let x = b.linear(2, scale, scale);
        b.medium(shape, x, x);
        let scene = b.scene(0.0);
        let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
        let error = reference.trace([0.0, 0.0, -4.0], [0.0, 0.0, 1.0], &Options::default()).unwrap_err();
        assert_eq!(error.code, "E0651");
    }
}
