//! Scattering by spheres against published values, limits that are known in closed form, and theorems.

use compiler::ir::eval::mie::{
    Complex, CrossSections, Ensemble, EnsembleError, LARGEST_TABULATED, Particles, PhaseTable, Sphere, key_of_cosine,
    tabulate,
};
use std::f64::consts::PI;

#[track_caller]
fn assert_close(got: f64, expected: f64, tolerance: f64, what: &str) {
    let error = (got - expected).abs() / expected.abs().max(f64::MIN_POSITIVE);
    assert!(error <= tolerance, "{what}: {got} instead of {expected}, off by {error:.1e}");
}

/// Nodes and weights of ∫₋₁¹ dμ by μ = cos θ and Fejér's rule, exact for polynomials below `count`.
fn fejer(count: usize) -> Vec<(f64, f64)> {
    (0..count)
        .map(|k| {
            let theta = (k as f64 + 0.5) * PI / count as f64;
            let sum: f64 = (1..=count / 2).map(|j| (2.0 * j as f64 * theta).cos() / (4.0 * (j * j) as f64 - 1.0)).sum();
            (theta.cos(), 2.0 / count as f64 * (1.0 - 2.0 * sum))
        })
        .collect()
}

/// Bohren and Huffman 1983, appendix A: a sphere of 0.525 µm and index 1.55 at 0.6328 µm.
#[test]
fn the_example_of_bohren_and_huffman() {
    let sphere = Sphere::new(2.0 * PI * 0.525 / 0.6328, 1.55, 0.0);
    assert_close(sphere.q_scattering(), 3.10543, 2e-6, "Q_sca");
    assert_close(sphere.q_extinction(), 3.10543, 2e-6, "Q_ext");
    assert_close(sphere.q_back(), 2.92534, 2e-6, "Q_back");
}

/// Wiscombe, "Mie scattering calculations", NCAR/TN-140+STR (1979), the tables of MIEV0: six or seven digits.
#[test]
fn wiscombes_tables() {
    // n, k, x, Q_ext, Q_sca, g
    #[rustfmt::skip]
    let cases = [
        (1.5, 0.0, 10.0, 2.881_999, Some(2.881_999), Some(0.742_913)),
        (1.33, 1e-5, 1.0, 0.093_952, Some(0.093_923), Some(0.184_517)),
        (1.33, 1e-5, 100.0, 2.101_321, Some(2.096_594), Some(0.868_959)),
        (1.33, 1e-5, 1e4, 2.004_089, Some(1.723_857), Some(0.907_840)),
        (1.5, 1.0, 1.0, 2.336_321, Some(0.663_454), Some(0.192_136)),
        (1.5, 1.0, 100.0, 2.097_502, Some(1.283_697), Some(0.850_252)),
        (1.5, 1.0, 1e4, 2.004_368, Some(1.236_574), Some(0.846_310)),
        (10.0, 10.0, 1.0, 2.532_993, Some(2.049_405), Some(-0.110_664)),
        (10.0, 10.0, 100.0, 2.071_124, Some(1.836_785), Some(0.556_215)),
        (10.0, 10.0, 1e4, 2.005_914, Some(1.795_393), Some(0.548_194)),
    ];
    for (n, k, x, extinction, scattering, asymmetry) in cases {
        let sphere = Sphere::new(x, n, k);
        let what = format!("m = {n} + {k}i, x = {x}");
        assert_close(sphere.q_extinction(), extinction, 6e-6, &format!("Q_ext, {what}"));
        if let Some(scattering) = scattering {
            assert_close(sphere.q_scattering(), scattering, 6e-6, &format!("Q_sca, {what}"));
        }
        if let Some(asymmetry) = asymmetry {
            assert_close(sphere.asymmetry(), asymmetry, 6e-6, &format!("g, {what}"));
        }
    }
}

/// (m² − 1)/(m² + 2) as real and imaginary part.
fn polarisability(n: f64, k: f64) -> (f64, f64) {
    let (re, im) = (n * n - k * k, 2.0 * n * k);
    let ((a, b), (c, d)) = ((re - 1.0, im), (re + 2.0, im));
    let norm = c * c + d * d;
    ((a * c + b * d) / norm, (b * c - a * d) / norm)
}

#[test]
fn small_spheres_are_rayleighs() {
    for (n, k) in [(1.33, 0.0), (1.5, 1e-9), (0.7, 0.0), (1.001, 0.0), (2.0, 0.5), (0.2, 3.4), (10.0, 10.0)] {
        for x in [1e-6, 1e-5, 1e-4, 1e-3] {
            let sphere = Sphere::new(x, n, k);
            let (re, im) = polarisability(n, k);
            let what = format!("m = {n} + {k}i, x = {x}");
            // What comes next is smaller by x²|m|², for metals by x³ over the damping of the resonance.
            let next = 20.0 * x * x * (1.0 + n * n + k * k) + 1e-10 / (n - 1.0).abs().min(1.0) * 1e-4;
            let scattering = 8.0 / 3.0 * x.powi(4) * (re * re + im * im);
            assert_close(sphere.q_scattering(), scattering, next, &format!("Q_sca, {what}"));
            if k > 0.0 {
                assert_close(sphere.q_absorption(), 4.0 * x * im, next + 10.0 * x * x, &format!("Q_abs, {what}"));
            }
            for cosine in [-1.0, -0.5, 0.0, 0.3, 1.0] {
                let rayleigh = 3.0 / (16.0 * PI) * (1.0 + cosine * cosine);
                assert_close(sphere.phase(cosine), rayleigh, 20.0 * next + 1e-12, &format!("p({cosine}), {what}"));
            }
            assert!(sphere.asymmetry().abs() < next, "g = {}, {what}", sphere.asymmetry());
        }
    }
    // g itself keeps its digits: it goes as x², whatever the size.
    let ratio = |x: f64| Sphere::new(x, 1.5, 0.0).asymmetry() / (x * x);
    for x in [1e-6, 1e-5, 1e-4, 1e-3] {
        assert_close(ratio(x), ratio(1e-2), 1e-4, "g/x²");
    }
}

#[test]
fn large_spheres_take_away_twice_their_shadow() {
    // The edge adds 1.9924 x^(−2/3) (Nussenzveig and Wiscombe, Physical Review Letters 45, 1980); the rest is of order 1/x.
    for (n, k) in [(1.5, 1.0), (1.33, 0.1), (0.2, 3.4), (2.0, 0.5)] {
        for x in [1e3_f64, 1e4, 1e5] {
            let edge = 1.992_386_1 * x.powf(-2.0 / 3.0);
            let rest = Sphere::new(x, n, k).q_extinction() - 2.0 - edge;
            assert!(rest.abs() < 8.0 / x, "m = {n} + {k}i, x = {x}: {rest:e} beside {edge:e}");
        }
    }
}

/// Indices of all kinds: clear, absorbing, metals, thinner than what is around them.
const INDICES: [(f64, f64); 12] = [
    (1.33, 0.0),
    (1.5, 0.0),
    (1.55, 0.1),
    (1.0001, 0.0),
    (0.7, 0.0),
    (0.75, 1e-6),
    (1.33, 1e-9),
    (2.5, 0.0),
    (0.2, 3.4),
    (10.0, 10.0),
    (1.5, 1.0),
    (0.05, 2.0),
];

fn sizes() -> impl Iterator<Item = f64> {
    (0..=44).map(|i| 1e-6 * 10_f64.powf(f64::from(i) / 4.0))
}

#[test]
fn nothing_breaks_at_any_size() {
    for (n, k) in INDICES {
        let mut small: Option<(f64, f64)> = None;
        for x in sizes() {
            let sphere = Sphere::new(x, n, k);
            let what = format!("m = {n} + {k}i, x = {x}");
            let (q, a, g) = (sphere.q_scattering(), sphere.q_absorption(), sphere.asymmetry());
            assert!(q > 0.0 && q < 6.0 && a >= 0.0 && a < 6.0, "{what}: {q} and {a}");
            assert!((k == 0.0) == (a == 0.0), "{what}: {a}");
            assert!(g > -0.5 && g < 1.0, "{what}: g = {g}");
            // While the sphere is small, more size scatters and absorbs more.
            if x < 0.1 / (n + k) {
                if let Some((before_q, before_a)) = small {
                    assert!(q > before_q && (k == 0.0 || a > before_a), "{what}");
                }
                small = Some((q, a));
            }
            // No mode scatters or absorbs more than the whole of its wave.
            for (i, (a, b)) in sphere.modes().iter().enumerate() {
                for c in [a, b] {
                    assert!(c.re.is_finite() && c.im.is_finite(), "{what}, order {}", i + 1);
                    assert!(c.norm() <= c.re + 1e-9, "{what}, order {}: {c:?}", i + 1);
                }
            }
            // The series has been summed to its end.
            let last = sphere.modes().last().expect("some modes");
            assert!(last.0.norm() + last.1.norm() < 1e-26, "{what}: {last:?}");
            for cosine in [-1.0, -0.99, 0.0, 0.5, 0.999, 1.0] {
                let p = sphere.phase(cosine);
                assert!(p.is_finite() && p >= 0.0, "{what}: p({cosine}) = {p}");
            }
        }
    }
}

#[test]
fn energy_is_kept_and_the_optical_theorem_holds() {
    for (n, k) in INDICES {
        for x in sizes().filter(|x| *x > 1e-3 && *x < 3e4) {
            let sphere = Sphere::new(x, n, k);
            let what = format!("m = {n} + {k}i, x = {x}");
            // Extinction as the shadow of the forward amplitude, Q = 4/x²·Re S(0), against scattering plus absorption.
            let (s1, s2) = sphere.amplitudes(1.0);
            assert_close(s2.re, s1.re, 1e-12, &format!("S₁ = S₂ forward, {what}"));
            let forward = 4.0 / (x * x) * s1.re;
            assert_close(sphere.q_extinction(), forward, 1e-9 + 1e-13 * x, &format!("optical theorem, {what}"));
            let direct: f64 =
                sphere.modes().iter().enumerate().map(|(i, (a, b))| (2 * i + 3) as f64 * (a.re + b.re)).sum();
            assert_close(sphere.q_extinction(), 2.0 / (x * x) * direct, 1e-12 + 1e-13 * x, &format!("sum, {what}"));
            // Straight back, S₁ = −S₂.
            let (s1, s2) = sphere.amplitudes(-1.0);
            assert!((s1.re + s2.re).hypot(s1.im + s2.im) <= 1e-8 * s1.norm().sqrt().max(1e-30), "backward, {what}");
        }
    }
}

#[test]
fn phase_functions_integrate_to_one_and_to_g() {
    for (n, k) in INDICES {
        for x in [0.01, 0.3, 1.0, 5.0, 20.0, 100.0, 333.0] {
            let sphere = Sphere::new(x, n, k);
            let rule = fejer(2 * sphere.modes().len() + 2);
            let moment = |power: i32| -> f64 {
                rule.iter().map(|(mu, w)| 2.0 * PI * w * mu.powi(power) * sphere.phase(*mu)).sum()
            };
            let what = format!("m = {n} + {k}i, x = {x}");
            assert_close(moment(0), 1.0, 1e-10, &format!("integral, {what}"));
            assert!((moment(1) - sphere.asymmetry()).abs() < 1e-10, "{what}: {} {}", moment(1), sphere.asymmetry());
        }
    }
}

/// a₁ and b₁ for small x to the next order (Bohren and Huffman 1983, section 5.1).
#[test]
fn first_coefficients_follow_their_series() {
    for (n, x) in [(1.5_f64, 1e-2_f64), (1.5, 1e-4), (0.6, 1e-3), (2.0, 1e-6)] {
        let (a, b) = Sphere::new(x, n, 0.0).modes()[0];
        let m2 = n * n;
        let a1 = -(2.0 * x.powi(3) / 3.0) * (m2 - 1.0) / (m2 + 2.0)
            - (2.0 * x.powi(5) / 5.0) * (m2 - 2.0) * (m2 - 1.0) / (m2 + 2.0).powi(2);
        let b1 = -(x.powi(5) / 45.0) * (m2 - 1.0);
        assert_close(a.im, a1, 10.0 * x.powi(4) + 1e-13, "Im a₁");
        assert_close(a.re, a1 * a1, 10.0 * x.powi(2) + 1e-13, "Re a₁ = |a₁|²");
        assert_close(b.im, b1, 10.0 * x.powi(2) + 1e-13, "Im b₁");
    }
    assert_eq!(Sphere::new(1e-3, 1.0, 0.0).modes()[0].0, Complex::default(), "no sphere, no light");
}

/// Absorption of nearly clear spheres goes as k, whatever the size: nothing is lost by subtraction.
#[test]
fn faint_absorption_keeps_its_digits() {
    for x in [0.1, 1.0, 10.3, 97.0] {
        let at = |k: f64| Sphere::new(x, 1.33, k).q_absorption() / k;
        assert_close(at(1e-14), at(1e-9), 1e-4, "Q_abs/k");
        assert_close(at(1e-12), at(1e-9), 1e-4, "Q_abs/k");
    }
}

fn droplets(radius: f64, spread: f64) -> Particles {
    Particles { radius, n: 1.33, k: 0.0, spread }
}

#[test]
fn one_size_is_a_spread_of_nothing() {
    let wavelength = 550e-9;
    for radius in [20e-9, 300e-9, 5e-6, 50e-6] {
        let sphere = Sphere::new(2.0 * PI * radius / wavelength, 1.33, 0.0);
        let area = PI * radius * radius;
        let sections = CrossSections::new(&droplets(radius, 1.0), wavelength).expect("a size that is computed");
        assert_close(sections.scattering, area * sphere.q_scattering(), 1e-13, "scattering");
        assert_eq!((sections.absorption, sections.error), (0.0, 0.0));
        assert_close(sections.asymmetry, sphere.asymmetry(), 1e-13, "g");
        let ensemble = Ensemble::new(&droplets(radius, 1.0), wavelength).expect("a phase function");
        for i in 0..=100 {
            let cosine = (f64::from(i) * PI / 100.0).cos();
            let exact = sphere.phase(cosine);
            assert!(
                (ensemble.phase(cosine) - exact).abs() < 1e-9 * exact + 1e-15 * sphere.phase(1.0),
                "{radius} {cosine}"
            );
        }
    }
}

/// Moments of the log-normal distribution: ⟨rⁿ⟩ = r̃ⁿ exp(n² ln² s / 2). Small spheres scatter as r⁶ and absorb as r³; large
/// ones take away as r².
#[test]
fn spreads_have_their_moments() {
    let wavelength = 550e-9;
    for spread in [1.1_f64, 1.5, 2.0] {
        let moment = |n: f64| (0.5 * n * n * spread.ln().powi(2)).exp();
        let at = |radius: f64, spread: f64| {
            let particles = Particles { radius, n: 1.5, k: 0.5, spread };
            CrossSections::new(&particles, wavelength).expect("a size that is computed")
        };
        let (one, many) = (at(1e-11, 1.0), at(1e-11, spread));
        assert_close(many.scattering / one.scattering, moment(6.0), 1e-4, "r⁶");
        assert_close(many.absorption / one.absorption, moment(3.0), 1e-4, "r³");
        assert!(many.error <= 1e-5);
        // Large: twice the area, with an edge of x^(−2/3) whose moment is that of 4/3.
        let x = 2.0 * PI * 10e-6 / wavelength;
        let large = at(10e-6, spread);
        let expected = PI * 1e-10 * (2.0 * moment(2.0) + 1.9924 * x.powf(-2.0 / 3.0) * moment(4.0 / 3.0));
        assert_close(large.extinction(), expected, 5e-3, "r²");
    }
}

/// The average over sizes against a plain sum over many of them.
#[test]
fn spreads_average_the_light_not_the_angles() {
    let wavelength = 550e-9;
    let (radius, spread) = (0.6e-6, 1.3_f64);
    let ensemble = Ensemble::new(&droplets(radius, spread), wavelength).expect("a phase function");
    assert!(ensemble.error < 1e-3, "{}", ensemble.error);
    let (mut sum, mut total, count) = (vec![0.0; 19], 0.0, 3000);
    for i in 0..count {
        let t = 8.0 * (f64::from(i) + 0.37) / f64::from(count) * 2.0 - 8.0;
        let x = 2.0 * PI * radius / wavelength * (t * spread.ln()).exp();
        let sphere = Sphere::new(x, 1.33, 0.0);
        let weight = (-0.5 * t * t).exp() * x * x * sphere.q_scattering();
        total += weight;
        for (j, s) in sum.iter_mut().enumerate() {
            *s += weight * sphere.phase((j as f64 * PI / 18.0).cos());
        }
    }
    for (j, s) in sum.iter().enumerate() {
        let got = ensemble.phase((j as f64 * PI / 18.0).cos());
        assert_close(got, s / total, 1e-4, &format!("{} degrees", 10 * j));
    }
    assert_close(ensemble.cross_sections.asymmetry, moments(&ensemble).1, 1e-4, "g");
    assert_close(moments(&ensemble).0, 1.0, 1e-4, "the integral, without any normalisation");
}

fn moments(ensemble: &Ensemble) -> (f64, f64) {
    let rule = fejer(4001);
    let moment =
        |power: i32| -> f64 { rule.iter().map(|(mu, w)| 2.0 * PI * w * mu.powi(power) * ensemble.phase(*mu)).sum() };
    (moment(0), moment(1))
}

#[test]
fn particles_that_are_not_computed_are_refused() {
    let wavelength = 500e-9;
    for radius in [1e-14, 1.0] {
        assert!(matches!(CrossSections::new(&droplets(radius, 1.0), wavelength), Err(EnsembleError::Size(_))));
    }
    // Drops of 1 mm have cross-sections and no table.
    assert!(CrossSections::new(&droplets(1e-3, 1.0), wavelength).is_ok());
    let size = 2.0 * PI * 1e-3 / wavelength;
    assert!(size > LARGEST_TABULATED);
    assert_eq!(Ensemble::new(&droplets(1e-3, 1.0), wavelength).map(|_| ()), Err(EnsembleError::Size(size)));
    let nothing = Particles { radius: 1e-6, n: 1.0, k: 0.0, spread: 1.0 };
    assert_eq!(CrossSections::new(&nothing, wavelength).expect("a cross-section").absorption, 0.0);
    assert_eq!(Ensemble::new(&nothing, wavelength).map(|_| ()), Err(EnsembleError::Nothing));
}

fn interpolated(table: &PhaseTable, cosine: f64, band: usize) -> f64 {
    let key = key_of_cosine(cosine);
    let after = table.keys.partition_point(|k| *k <= key).clamp(1, table.keys.len() - 1);
    let (k0, k1) = (table.keys[after - 1], table.keys[after]);
    let (a, b) = (table.values[after - 1][band], table.values[after][band]);
    a + (b - a) * (key - k0) / (k1 - k0)
}

#[test]
fn tables_are_within_their_stated_error() {
    let wavelengths = [680e-9, 550e-9, 440e-9];
    // Radius, spread, and whether 1e-4 can be reached with the rows there are.
    for (radius, spread, reached) in
        [(20e-9, 1.0, true), (0.5e-6, 1.0, true), (2e-6, 1.0, true), (2e-6, 1.3, true), (60e-6, 1.0, false)]
    {
        let bands: Vec<Ensemble> = wavelengths
            .iter()
            .map(|w| Ensemble::new(&droplets(radius, spread), *w).expect("a phase function"))
            .collect();
        let table = tabulate(&bands);
        let what = format!("{radius} m, {spread}, {} rows, error {:e}", table.keys.len(), table.error);
        assert_eq!(table.error <= 1e-4, reached, "{what}");
        assert!(table.keys.len() <= 1 << 14, "{what}");
        assert!(table.keys.is_sorted_by(|a, b| a < b), "{what}");
        assert_eq!((table.keys[0], table.keys[table.keys.len() - 1]), (-1.0, 1.0));
        for integral in table.integrals() {
            assert_close(integral, 1.0, 1e-12, &what);
        }
        // At angles that the table knows nothing of. The normalisation may shift all of it by as much again.
        for (band, ensemble) in bands.iter().enumerate() {
            for i in 0..3000 {
                let cosine = ((f64::from(i) + 0.618) / 3000.0 * PI).cos();
                let (got, exact) = (interpolated(&table, cosine, band), ensemble.phase(cosine));
                assert!((got / exact - 1.0).abs() <= 2.2 * table.error.max(1e-4), "{what}: {got} {exact} at {cosine}");
            }
        }
    }
}
