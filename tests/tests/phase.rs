//! Phase functions: those of the library over a table of their parameters, and what a scene makes of its own.
//!
//! Reciprocity (Helmholtz: the same when light runs the other way) holds for every one of them by the type: a phase function
//! sees only the cosine of the angle between the two directions, which their exchange and reversal leaves as it is.

use compiler::diagnostic::{Diagnostics, render};
use compiler::ir::FieldScene;
use compiler::ir::eval::{Environment, LANES, NoVoxels, Tables, Tape, phase_draws, phase_facts_at};
use compiler::loader::NoFiles;
use compiler::lower::lower_scaled;
use std::f64::consts::PI;

/// A medium with this phase function; what was declared before it, and the codes of what was reported.
fn scene(before: &str, phase: &str) -> (Option<FieldScene>, Vec<&'static str>, String) {
    let text = format!(
        "use std::phase::{{isotropic, rayleigh, henyey_greenstein, schlick, cornette_shanks, draine, droplets}}\n{before}\n\
         medium a {{ shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_s = 1 /m  phase = {phase} }}\n\
         light sun {{ direction = (0, -1, 0)  irradiance = 1 lx }}"
    );
    let (sources, found, scene) = compiler::check_scene("scene.vol", &text, &NoFiles);
    let scene = scene.unwrap_or_else(|| panic!("{}", render(&found, &sources)));
    let mut diagnostics = Diagnostics::default();
    let lowered = lower_scaled(&scene, &mut diagnostics);
    assert_eq!(lowered.is_none(), diagnostics.has_errors());
    (lowered, diagnostics.iter().map(|d| d.code).collect(), render(&diagnostics, &sources))
}

fn lowered(before: &str, phase: &str, codes: &[&str]) -> FieldScene {
    let (scene, found, shown) = scene(before, phase);
    assert_eq!(found, codes, "{phase}: {shown}");
    scene.expect("a scene")
}

/// The bands of the phase function of a scene at a cosine, a position in metres, and values of the params.
fn value(scene: &FieldScene, cosine: f64, position: [f64; 3], params: &[f64]) -> Vec<f64> {
    let Some(node) = scene.media[0].phase else { return vec![1.0 / (4.0 * PI)] };
    let params: Vec<Vec<f64>> = params.iter().map(|p| vec![*p]).collect();
    let tables = Tables::evaluate(&scene.graph, &params, 0.0);
    let tape = Tape::new(&scene.graph, &[node]);
    let environment = Environment {
        position: position.map(|x| [x * scene.units.scale(1.0); LANES]),
        cos_theta: [cosine; LANES],
        params: &params,
        tables: &tables,
        ..Environment::default()
    };
    let mut scratch = tape.scratch();
    tape.run(&environment, &NoVoxels, &mut scratch);
    tape.root(&scratch, 0).iter().map(|lanes| lanes[0]).collect()
}

/// 2π ∫₋₁¹ of f and of μ·f by μ = ±(1 − e^(−s)), which gives narrow lobes their room, and Simpson's rule.
fn moments(f: impl Fn(f64) -> f64) -> (f64, f64) {
    let (mut zeroth, mut first) = (0.0, 0.0);
    let (steps, end) = (8_000, 44.0);
    for sign in [1.0, -1.0] {
        for i in 0..=steps {
            let s = end * f64::from(i) / f64::from(steps);
            let weight = if i == 0 || i == steps { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
            let rest = (-s).exp();
            let mu = sign * (1.0 - rest);
            let part = weight / 3.0 * end / f64::from(steps) * rest * f(mu);
            zeroth += part;
            first += mu * part;
        }
    }
    (2.0 * PI * zeroth, 2.0 * PI * first)
}

fn draine(g: f64, a: f64) -> f64 {
    g * (1.0 + a * (3.0 + 2.0 * g * g) / 5.0) / (1.0 + a * (1.0 + 2.0 * g * g) / 3.0)
}

/// Every phase function of the library, and its mean cosine as its documentation states it.
fn library() -> Vec<(String, f64)> {
    let mut cases = vec![("isotropic".to_owned(), 0.0), ("rayleigh".to_owned(), 0.0)];
    for depolarisation in [0.0, 0.0279, 0.5] {
        cases.push((format!("rayleigh(depolarisation: {depolarisation})"), 0.0));
    }
    for g in [0.0, 1e-3, 0.3, 0.76, 0.9, 0.99, 0.9999, 0.999_999] {
        for g in [g, -g] {
            cases.push((format!("henyey_greenstein(g: {g})"), g));
            cases.push((format!("cornette_shanks(g: {g})"), 3.0 * g * (4.0 + g * g) / (5.0 * (2.0 + g * g))));
            for alpha in [0.0, 0.4, 3.0] {
                cases.push((format!("draine(g: {g}, alpha: {alpha})"), draine(g, alpha)));
            }
            // 1/k − (1 − k²)·artanh(k)/k², whose parts cancel for small k: 2k/3 + 2k³/15 + …
            let mean = if g.abs() < 0.01 {
                2.0 * g / 3.0 + 2.0 * g.powi(3) / 15.0
            } else {
                1.0 / g - (1.0 - g * g) * g.atanh() / (g * g)
            };
            cases.push((format!("schlick(k: {g})"), mean));
        }
    }
    for diameter in [5.0_f64, 12.0, 20.0, 50.0] {
        let forward = (-0.099_056_7 / (diameter - 1.671_54)).exp();
        let wide = (-2.206_79 / (diameter + 3.910_29) - 0.428_934).exp();
        let alpha = (3.624_89 - 8.292_88 / (diameter + 5.528_25)).exp();
        let share = (-0.599_085 / (diameter - 0.641_583) - 0.665_888).exp();
        cases.push((
            format!("droplets(diameter: {diameter} um)"),
            (1.0 - share) * forward + share * draine(wide, alpha),
        ));
    }
    cases
}

#[test]
fn the_library_is_normalised_positive_and_as_forward_as_it_says() {
    for (text, mean) in library() {
        let scene = lowered("", &text, &[]);
        let Some(node) = scene.media[0].phase else {
            assert_eq!((text.as_str(), mean), ("isotropic", 0.0));
            continue;
        };
        let tables = Tables::evaluate(&scene.graph, &[], 0.0);
        let tape = Tape::new(&scene.graph, &[node]);
        let mut scratch = tape.scratch();
        let scratch = std::cell::RefCell::new(&mut scratch);
        let at = |mu: f64| {
            let environment = Environment { cos_theta: [mu; LANES], tables: &tables, ..Environment::default() };
            let mut scratch = scratch.borrow_mut();
            tape.run(&environment, &NoVoxels, &mut scratch);
            tape.component(&scratch, 0, 0)[0]
        };
        let (integral, first) = moments(|mu| {
            let f = at(mu);
            assert!(f > 0.0 && f.is_finite(), "{text} is {f} at {mu}");
            f
        });
        assert!((integral - 1.0).abs() < 1e-6, "{text}: {integral}");
        assert!((first - mean).abs() < 1e-6, "{text}: {first} instead of {mean}");
        // What the compiler says of it, by another rule.
        let facts = phase_facts_at(&scene.graph, node, &[], [0.0; 3]);
        // At the tip of the narrowest lobes, numbers next to 1 are too coarse for the cosine.
        let blur = f64::EPSILON * 2.0 * PI * at(1.0).max(at(-1.0));
        assert!(!facts.diverges && facts.uncertainty < 1e-10 + blur, "{text}: {facts:?}");
        assert!((facts.integral[0] - 1.0).abs() < 1e-6, "{text}: {facts:?}");
        assert!((facts.moment[0] - mean).abs() < 1e-6, "{text}: {facts:?}");
        assert!(facts.least.0 > 0.0 && facts.most >= at(1.0).max(at(-1.0)) * 0.999, "{text}: {facts:?}");
    }
}

/// Directions as the GPU draws them, evenly within rings, and weighted by the phase function over the density: χ² of their
/// histogram over 32 parts of the sphere that get equal shares of the light, by an integration of its own.
#[test]
fn directions_are_drawn_as_phase_functions_scatter() {
    let mut cases: Vec<String> = library().into_iter().map(|c| c.0).collect();
    cases.push("mie(radius: 2 um, index: 1.333)".into());
    cases.push("mix(henyey_greenstein(g: 0.9), henyey_greenstein(g: -0.6), 0.3)".into());
    for text in cases {
        let scene = lowered("", &text, &[]);
        let Some(node) = scene.media[0].phase else { continue };
        let tables = Tables::evaluate(&scene.graph, &[], 0.0);
        let environment = Environment { tables: &tables, ..Environment::default() };
        let rings = phase_draws(&scene.graph, node, &environment);
        let tape = Tape::new(&scene.graph, &[node]);
        let mut scratch = tape.scratch();
        let mut at = |mu: f64| {
            let environment = Environment { cos_theta: [mu; LANES], ..environment.clone() };
            tape.run(&environment, &NoVoxels, &mut scratch);
            let width = tape.width(0);
            (0..width).map(|b| tape.component(&scratch, 0, b)[0]).sum::<f64>() / width as f64
        };
        // Light from straight on backwards, on a grid that is fine at both ends, by the trapezoid rule. Signed: 1 − μ forward, and
        // minus 1 + μ backward, which keeps the digits.
        let (steps, range) = (8000, 34.0);
        let ladder = |i: i32| if i == steps { 0.0 } else { (-range * f64::from(i) / f64::from(steps)).exp() };
        let mut grid: Vec<f64> = (0..=steps).rev().map(ladder).collect();
        grid.extend((0..=steps).map(|i| -ladder(i)));
        let mu = |g: f64| if g > 0.0 { 1.0 - g } else { -1.0 - g };
        let (mut below, mut sum, mut last) = (vec![0.0], 0.0, at(1.0));
        for pair in grid.windows(2) {
            let now = at(if pair[1] == 0.0 { -1.0 } else { mu(pair[1]) });
            // From 1 to −1, both of which stand for μ = 0, is no way.
            let way = if pair[0] > 0.0 && pair[1] < 0.0 { 0.0 } else { pair[0].max(pair[1]) - pair[0].min(pair[1]) };
            sum += way * PI * (last + now);
            (last, _) = (now, below.push(sum));
        }
        assert!((sum - 1.0).abs() < 1e-3, "{text}: {sum}");
        // Where a direction lies, from straight on (0) to straight back (grid.len() − 1).
        let part = |versine: f64, vercosine: f64| {
            let signed = if versine <= 1.0 { versine } else { -vercosine };
            let i = if versine <= 1.0 {
                grid[..=steps as usize].partition_point(|g| *g < signed)
            } else {
                steps as usize + 1 + grid[steps as usize + 1..].partition_point(|g| *g < signed)
            };
            let i = i.clamp(1, grid.len() - 1);
            let share = ((signed - grid[i - 1]) / (grid[i] - grid[i - 1])).clamp(0.0, 1.0);
            ((below[i - 1] + share * (below[i] - below[i - 1])) / sum * 32.0).min(31.0) as usize
        };
        let draws = 32_000;
        let mut sums = [(0.0f64, 0.0f64); 32];
        let mut state = 1u64;
        let mut largest = 0.0f64;
        for _ in 0..draws {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let u = (state >> 11) as f64 / (1u64 << 53) as f64;
            let i = rings.partition_point(|r| r.share <= u).clamp(1, rings.len() - 1);
            let (a, b) = (&rings[i - 1], &rings[i]);
            let t = (u - a.share) / (b.share - a.share);
            let versine = a.versine + t * (b.versine - a.versine);
            let vercosine = a.vercosine + t * (b.vercosine - a.vercosine);
            let forward = versine < vercosine;
            let height = if forward { b.versine - a.versine } else { a.vercosine - b.vercosine };
            let density = (b.share - a.share) / (2.0 * PI * height);
            let weight = at(if forward { 1.0 - versine } else { vercosine - 1.0 }) / density;
            largest = largest.max(weight);
            let sum = &mut sums[part(versine, vercosine)];
            *sum = (sum.0 + weight, sum.1 + weight * weight);
        }
        // Rings are so narrow that no direction counts much more than another.
        assert!(largest < 1.25, "{text}: a direction weighs {largest}");
        let expected = f64::from(draws) / 32.0;
        let variance = |squares: f64| squares - expected * expected / f64::from(draws);
        let chi: f64 = sums.iter().map(|(s, squares)| (s - expected).powi(2) / variance(*squares)).sum();
        // 32 degrees of freedom: above 80 for one function in 170 000, and there are a hundred.
        assert!(chi < 80.0, "{text}: {chi} of {sums:?}");
    }
}

#[test]
fn mixtures_are_sums() {
    let scene = lowered("", "mix(henyey_greenstein(g: 0.8), rayleigh, 0.3)", &[]);
    for cosine in [-1.0_f64, -0.3, 0.0, 0.9, 1.0] {
        let hg = (1.0 - 0.64) / (4.0 * PI * (1.0 + 0.64 - 1.6 * cosine).powf(1.5));
        let rayleigh = 3.0 / (16.0 * PI) * (1.0 + cosine * cosine);
        let expected = 0.7 * hg + 0.3 * rayleigh;
        assert!((value(&scene, cosine, [0.0; 3], &[])[0] / expected - 1.0).abs() < 1e-12);
    }
    let mean = phase_facts_at(&scene.graph, scene.media[0].phase.expect("a node"), &[], [0.0; 3]).moment[0];
    assert!((mean - 0.7 * 0.8).abs() < 1e-10, "{mean}");
}

/// Functions of the angle that are not normalised, and what they become.
#[test]
fn what_is_not_normalised_becomes_so_and_is_told() {
    let kappa = 20.0_f64;
    let cases: Vec<(&str, Box<dyn Fn(f64) -> f64>)> = vec![
        ("1 + cos_theta", Box::new(|mu| (1.0 + mu) / (4.0 * PI))),
        ("7 * henyey_greenstein(g: 0.5)", Box::new(|mu| 0.75 / (4.0 * PI * (1.25 - mu).powf(1.5)))),
        ("max(0, cos_theta)", Box::new(|mu: f64| mu.max(0.0) / PI)),
        ("if cos_theta > 0.3 then 2 else 0", Box::new(|mu| if mu > 0.3 { 1.0 / (2.0 * PI * 0.7) } else { 0.0 })),
        (
            "exp(20 * (cos_theta - 1))",
            Box::new(move |mu| kappa / (2.0 * PI * (1.0 - (-2.0 * kappa).exp())) * (kappa * (mu - 1.0)).exp()),
        ),
        ("1e-30 * (1 + cos_theta^2)", Box::new(|mu| 3.0 / (16.0 * PI) * (1.0 + mu * mu))),
        ("acos(clamp(cos_theta, -1, 1))", Box::new(|mu: f64| mu.acos() / (2.0 * PI * PI))),
    ];
    for (text, exact) in cases {
        let scene = lowered("", text, &["N0518"]);
        for cosine in [-1.0, -0.71, 0.0, 0.29, 0.31, 0.99, 1.0] {
            let (got, exact) = (value(&scene, cosine, [0.0; 3], &[])[0], exact(cosine));
            assert!((got - exact).abs() <= 1e-8 * (exact + 1.0 / (4.0 * PI)), "{text} at {cosine}: {got} {exact}");
        }
    }
    // The factor that is reported: 1/(4π).
    let (_, _, shown) = scene("", "1 + cos_theta");
    assert!(shown.contains("multiplied by 0.079577"), "{shown}");
    // One factor for each band.
    let scene = lowered("", "1 + rgb(0, 1, 0.5) * cos_theta^2", &["N0518"]);
    for (got, part) in value(&scene, 0.6, [0.0; 3], &[]).into_iter().zip([0.0, 1.0, 0.5]) {
        let exact = (1.0 + part * 0.36) / (4.0 * PI * (1.0 + part / 3.0));
        assert!((got - exact).abs() < 1e-10, "{got} {exact}");
    }
}

#[test]
fn what_cannot_scatter_light_is_refused() {
    for (before, phase) in [
        ("", "cos_theta"),
        ("", "cos_theta - 2"),
        ("", "1 - 1.001 * cos_theta^2"),
        ("", "0 * cos_theta"),
        ("", "max(0, cos_theta - 2)"),
        ("", "1 / (1 - cos_theta)"),
        ("", "sqrt(cos_theta)"),
        ("", "log(0 * cos_theta)"),
        ("", "rgb(1, 1, 0) * (1 + cos_theta)"),
        ("param tilt = 0 in 0 .. 2", "1 - tilt * cos_theta"),
        ("param tilt = 5", "1 - tilt * cos_theta"),
        ("", "-(p.x / 1 m)^2 - 1"),
        ("", "1 + (p.x / 1 m - 100) * cos_theta"),
    ] {
        assert_eq!(scene(before, phase).1, ["E0517"], "{before} {phase}");
    }
    // Which param makes it so is told.
    let (_, _, shown) = scene("param tilt = 0 in 0 .. 2", "1 - tilt * cos_theta");
    assert!(shown.contains("`tilt` at 1.54"), "{shown}");
}

/// The factor follows params, where it is needed.
#[test]
fn normalisation_follows_params() {
    let tilt = "param tilt = 0.5 in 0 .. 1";
    let (kappa, share) = ("param kappa = 1 in 0.01 .. 50", "param g = 0.2 in -0.95 .. 0.95");
    type Exact = fn(f64, f64) -> f64;
    let cases: [(&str, &str, &[f64], Exact); 6] = [
        (tilt, "1 + tilt * cos_theta^2", &[0.0, 0.37, 1.0, 12.0], |t, mu| {
            (1.0 + t * mu * mu) / (4.0 * PI * (1.0 + t / 3.0))
        }),
        // Normalised at the default, and there alone; no range says where it may go.
        ("param tilt = 0", "(1 + tilt * cos_theta^2) / (4 * pi)", &[0.0, 1.0, 3.0], |t, mu| {
            (1.0 + t * mu * mu) / (4.0 * PI * (1.0 + t / 3.0))
        }),
        (kappa, "exp(kappa * cos_theta)", &[0.01, 1.0, 50.0], |k, mu| {
            k / (2.0 * PI * (1.0 - (-2.0 * k).exp())) * (k * (mu - 1.0)).exp()
        }),
        (kappa, "exp(-kappa * cos_theta)", &[0.01, 1.0, 50.0], |k, mu| {
            k / (2.0 * PI * (1.0 - (-2.0 * k).exp())) * (-k * (mu + 1.0)).exp()
        }),
        (share, "(1 + g^2 - 2 * g * cos_theta)^(-1.5)", &[-0.95, 0.0, 0.3, 0.95], |g, mu| {
            (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * mu).powf(1.5))
        }),
        (tilt, "sqrt(1 - tilt * cos_theta^2)", &[0.0, 0.5, 1.0], |t, mu| {
            let root = t.sqrt();
            let half = if t == 0.0 { 1.0 } else { 0.5 * ((1.0 - t).sqrt() + root.asin() / root) };
            (1.0 - t * mu * mu).sqrt() / (4.0 * PI * half)
        }),
    ];
    for (before, text, values, exact) in cases {
        let scene = lowered(before, text, &["N0518"]);
        for param in values {
            for cosine in [-1.0, -0.5, 0.0, 0.8, 1.0] {
                let (got, exact) = (value(&scene, cosine, [0.0; 3], &[*param])[0], exact(*param, cosine));
                let close = (got - exact).abs() <= 1e-7 * (exact + 1e-3);
                assert!(close, "{text} with {param} at {cosine}: {got} instead of {exact}");
            }
        }
    }
    // What is normalised at every value costs nothing.
    let scene = lowered("param g = 0.2 in -0.95 .. 0.95", "henyey_greenstein(g: g)", &[]);
    let hg = |g: f64, mu: f64| (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * mu).powf(1.5));
    assert!((value(&scene, 0.4, [0.0; 3], &[-0.7])[0] / hg(-0.7, 0.4) - 1.0).abs() < 1e-12);
    lowered("param g = 0.3", "henyey_greenstein(g: g)", &[]);
    lowered("param g = 0.9", "mix(henyey_greenstein(g: g), rayleigh, 0.1)", &[]);
}

#[test]
fn normalisation_follows_places() {
    let scene = lowered("", "1 + clamp(p.x / 1 m, 0, 1) * cos_theta^2", &["N0518"]);
    for x in [-1.0_f64, 0.0, 0.4, 1.0] {
        let t = x.clamp(0.0, 1.0);
        let exact = (1.0 + t * 0.25) / (4.0 * PI * (1.0 + t / 3.0));
        let got = value(&scene, -0.5, [x, 0.3, 0.1], &[])[0];
        assert!((got / exact - 1.0).abs() < 1e-7, "{x}: {got} {exact}");
    }
    // Normalised everywhere, or at least wherever it is looked at.
    lowered("", "henyey_greenstein(g: clamp(p.y / 2 m, -0.9, 0.9))", &[]);
    lowered("", "henyey_greenstein(g: lambda / 1 um)", &[]);
    // Right in the medium: it is no fault that it would be negative elsewhere.
    let far = lowered("", "1 + 0.5 * p.x / 1 m * cos_theta", &["N0518"]);
    assert!((value(&far, 0.5, [0.4, 0.0, 0.0], &[])[0] - 1.1 / (4.0 * PI)).abs() < 1e-8);
    // Normalised at time 0 alone.
    lowered("", "(1 + 0.1 * time / 1 s * cos_theta^2) / (4 * pi)", &["N0518"]);
    lowered("", "(1 + dir.x^2 * cos_theta^2) / (4 * pi)", &["N0518"]);
}
