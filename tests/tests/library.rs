//! The standard library against its sources: normalisation and mean cosines of phase functions, noise against an
//! independent implementation (`golden/library.json` was computed in NumPy from the definitions), colour maps against the
//! published ones, distance fields against their promise, media against the literature.

use compiler::check::check;
use compiler::diagnostic::{Diagnostics, render};
use compiler::ir::eval::{Environment, LANES, Lanes, NoVoxels, Tables, Tape};
use compiler::ir::{FieldScene, NodeId, Units};
use compiler::loader::NoFiles;
use compiler::source::Sources;
use compiler::{lower, resolve};
use std::f64::consts::PI;

const USES: &str = "
    use std::phase::{isotropic, rayleigh, henyey_greenstein, schlick, cornette_shanks, draine, droplets}
    use std::noise::{value, value3, perlin, perlin3, fbm, turbulence, ridged, worley, worley2, curl, warp}
    use std::color::{viridis, magma, inferno, plasma, cividis, grey, bone, hot, coolwarm, turbo, black_body, ramp}
    use std::shape::{sd_sphere, sd_box, sd_round_box, sd_torus, sd_capsule, sd_cylinder, sd_plane, sd_ellipsoid, sd_octahedron}
    use std::shape::{op_union, op_intersection, op_difference, op_shell, op_round, op_repeat, op_repeat_limited, op_mirror_x}
    use std::shape::{op_smooth_union, op_smooth_intersection, op_smooth_difference, op_rotate_x, op_rotate_y, op_rotate_z}
    use std::shade::phong
    use std::media::{water_k_a, water_rgb_k_a, air_k_s, air_density, fog_k_t, smoke_k_t, soot_albedo, whole_milk_k_s, skin2_k_a}
";

fn scene(text: &str) -> FieldScene {
    let text = format!("{USES}\n{text}");
    let (mut sources, mut diagnostics) = (Sources::default(), Diagnostics::default());
    let modules = resolve::load("library-test.vol", &text, &NoFiles, &mut sources, &mut diagnostics);
    let checked = check(&modules, &NoFiles, &mut diagnostics);
    let lowered = checked.and_then(|s| lower::lower(&s, Units::METRE, &mut diagnostics));
    lowered.unwrap_or_else(|| panic!("{}", render(&diagnostics, &sources)))
}

/// A field of one scene, evaluated at points or angles.
struct Field {
    tape: Tape,
    tables: Tables,
}

impl Field {
    fn new(scene: &FieldScene, node: NodeId) -> Self {
        Self { tape: Tape::new(&scene.graph, &[node]), tables: Tables::evaluate(&scene.graph, &[], 0.0) }
    }

    /// A number, as a function of `p` in metres.
    fn number(expression: &str) -> Self {
        Self::coefficient(&format!("({expression}) / 1 m"))
    }

    /// An absorption coefficient per metre, as a function of `p`.
    fn coefficient(expression: &str) -> Self {
        let scene =
            scene(&format!("medium test {{ shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_a = {expression} }}"));
        Self::new(&scene, scene.media[0].k_a)
    }

    fn phase(expression: &str) -> Self {
        let scene = scene(&format!(
            "medium test {{ shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_s = 1 /m  phase = {expression} }}
             light sun {{ direction = (0, -1, 0)  irradiance = 1 lx }}"
        ));
        match scene.media[0].phase {
            Some(phase) => Self::new(&scene, phase),
            None => {
                assert_eq!(expression, "isotropic", "only the isotropic phase has no node");
                let mut scene = scene;
                let node = scene.graph.scalar(1.0 / (4.0 * PI));
                Self::new(&scene, node)
            }
        }
    }

    /// The components at each point.
    fn at(&self, points: &[[f64; 3]]) -> Vec<Vec<f64>> {
        let mut scratch = self.tape.scratch();
        let mut out = vec![];
        for chunk in points.chunks(LANES) {
            let position = [0, 1, 2].map(|axis| lanes(chunk, |p| p[axis]));
            let environment = Environment { position, tables: &self.tables, ..Environment::default() };
            self.tape.run(&environment, &NoVoxels, &mut scratch);
            let root = self.tape.root(&scratch, 0);
            out.extend((0..chunk.len()).map(|lane| root.iter().map(|c| c[lane]).collect::<Vec<f64>>()));
        }
        out
    }

    /// The first component at each point.
    fn numbers(&self, points: &[[f64; 3]]) -> Vec<f64> {
        self.at(points).into_iter().map(|v| v[0]).collect()
    }

    fn at_angles(&self, cosines: &[f64]) -> Vec<f64> {
        let mut scratch = self.tape.scratch();
        let mut out = vec![];
        for chunk in cosines.chunks(LANES) {
            let environment =
                Environment { cos_theta: lanes(chunk, |c| *c), tables: &self.tables, ..Environment::default() };
            self.tape.run(&environment, &NoVoxels, &mut scratch);
            out.extend_from_slice(&self.tape.component(&scratch, 0, 0)[..chunk.len()]);
        }
        out
    }
}

fn lanes<T>(chunk: &[T], get: impl Fn(&T) -> f64) -> Lanes {
    std::array::from_fn(|i| get(&chunk[i.min(chunk.len() - 1)]))
}

/// Random numbers that are the same in every run (PCG, O'Neill 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let x = (((self.0 >> 18) ^ self.0) >> 27) as u32;
        f64::from(x.rotate_right((self.0 >> 59) as u32)) / 4_294_967_296.0
    }

    fn points(&mut self, count: usize, half: f64) -> Vec<[f64; 3]> {
        (0..count).map(|_| [0; 3].map(|_| (2.0 * self.next() - 1.0) * half)).collect()
    }
}

/// Nodes and weights for ∫₋₁¹: eight-point Gauss–Legendre on intervals that shrink by halves towards both ends, where
/// phase functions have their peaks.
fn angles() -> Vec<(f64, f64)> {
    const GAUSS: [(f64, f64); 4] = [
        (0.183_434_642_495_649_8, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887_27),
        (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
        (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
    ];
    let mut ends: Vec<f64> = (0..=40).map(|i| 1.0 - 0.5f64.powi(i)).chain([1.0]).collect();
    ends.extend(ends.clone().iter().map(|e| -e));
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let mut out = vec![];
    for pair in ends.windows(2) {
        let (middle, half) = (0.5 * (pair[0] + pair[1]), 0.5 * (pair[1] - pair[0]));
        for (x, w) in GAUSS {
            out.extend([(middle - half * x, half * w), (middle + half * x, half * w)]);
        }
    }
    out
}

#[test]
fn phase_functions_are_normalised_and_have_their_mean_cosine() {
    let draine = |g: f64, a: f64| g * (1.0 + a * (3.0 + 2.0 * g * g) / 5.0) / (1.0 + a * (1.0 + 2.0 * g * g) / 3.0);
    let schlick = |k: f64| 1.0 / k - (1.0 - k * k) * k.atanh() / (k * k);
    let droplets = |d: f64| {
        let (hg, wide) = ((-0.0990567 / (d - 1.67154)).exp(), (-2.20679 / (d + 3.91029) - 0.428934).exp());
        let (alpha, share) = ((3.62489 - 8.29288 / (d + 5.52825)).exp(), (-0.599085 / (d - 0.641583) - 0.665888).exp());
        (1.0 - share) * hg + share * draine(wide, alpha)
    };
    let mut cases = vec![
        ("isotropic".to_owned(), 0.0),
        ("rayleigh".to_owned(), 0.0),
        ("rayleigh(depolarisation: 0.0279)".to_owned(), 0.0),
        ("henyey_greenstein(g: 0)".to_owned(), 0.0),
        ("droplets".to_owned(), droplets(20.0)),
        ("droplets(diameter: 5 um)".to_owned(), droplets(5.0)),
        ("droplets(diameter: 1 mm)".to_owned(), droplets(50.0)),
    ];
    for g in [0.1, 0.6, -0.6, 0.76, 0.95, -0.99, 0.999] {
        cases.push((format!("henyey_greenstein(g: {g})"), g));
        cases.push((format!("schlick(k: {g})"), schlick(g)));
        cases.push((format!("cornette_shanks(g: {g})"), 3.0 * g * (4.0 + g * g) / (5.0 * (2.0 + g * g))));
        cases.push((format!("draine(g: {g}, alpha: 2.5)"), draine(g, 2.5)));
    }
    let angles = angles();
    let cosines: Vec<f64> = angles.iter().map(|a| a.0).collect();
    for (text, mean) in cases {
        let values = Field::phase(&text).at_angles(&cosines);
        assert!(values.iter().all(|v| *v > 0.0), "{text} is positive");
        let moment =
            |n: i32| -> f64 { angles.iter().zip(&values).map(|((x, w), f)| 2.0 * PI * w * x.powi(n) * f).sum() };
        assert!((moment(0) - 1.0).abs() < 1e-9, "{text}: integral {}", moment(0));
        assert!((moment(1) - mean).abs() < 1e-9, "{text}: mean cosine {} instead of {mean}", moment(1));
    }
}

#[test]
fn phase_functions_agree_where_they_meet() {
    let cosines: Vec<f64> = (0..=40).map(|i| f64::from(i) / 20.0 - 1.0).collect();
    for (a, b) in [
        ("draine(g: 0.4, alpha: 0)", "henyey_greenstein(g: 0.4)"),
        ("draine(g: -0.4, alpha: 1)", "cornette_shanks(g: -0.4)"),
        ("cornette_shanks(g: 0)", "rayleigh"),
        ("schlick(k: 0)", "isotropic"),
    ] {
        let (x, y) = (Field::phase(a).at_angles(&cosines), Field::phase(b).at_angles(&cosines));
        for ((x, y), c) in x.iter().zip(&y).zip(&cosines) {
            assert!((x - y).abs() < 1e-14, "{a} = {x}, {b} = {y} at {c}");
        }
    }
    // The peak keeps its digits: (1 + g) / (4π(1 − g)²) straight on.
    let g = 0.999_99;
    let peak = Field::phase("henyey_greenstein(g: 0.99999)").at_angles(&[1.0])[0];
    let exact = (1.0 + g) / (4.0 * PI * 1e-10);
    assert!((peak / exact - 1.0).abs() < 1e-10, "{peak} instead of {exact}");
}

fn golden() -> serde_json::Value {
    serde_json::from_str(include_str!("golden/library.json")).expect("the golden values are JSON")
}

fn floats(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

#[test]
fn noise_equals_an_independent_implementation() {
    let golden = golden();
    let points: Vec<[f64; 3]> = golden["points"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|p| floats(p).try_into().expect("three coordinates"))
        .collect();
    for (expression, expected) in golden["noise"].as_object().expect("a map") {
        let field = Field::number(&format!("{{ let q = p / 1 m  {expression} }}"));
        for ((value, expected), point) in field.numbers(&points).iter().zip(floats(expected)).zip(&points) {
            assert!((value - expected).abs() < 1e-11, "{expression} at {point:?}: {value} instead of {expected}");
        }
    }
}

fn statistics(values: &[f64]) -> (f64, f64, f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (mean, deviation, low, high)
}

#[test]
fn noise_has_the_mean_spread_and_range_that_its_documentation_states() {
    let points = Random(1).points(20_000, 300.0);
    for (expression, mean, deviation, low, high) in [
        ("value(p / 1 m)", 0.5, 0.2, 0.0, 1.0),
        ("value3(p / 1 m).y", 0.5, 0.2, 0.0, 1.0),
        ("perlin(p / 1 m)", 0.0, 0.25, -1.2, 1.2),
        ("perlin3(p / 1 m).z", 0.0, 0.25, -1.2, 1.2),
        ("fbm(p / 1 m)", 0.5, 0.12, 0.0, 1.0),
        ("fbm(p / 1 m, octaves: 1)", 0.5, 0.19, -0.4, 1.4),
        ("fbm(p / 1 m, octaves: 7)", 0.5, 0.11, 0.0, 1.0),
        ("turbulence(p / 1 m)", 0.2, 0.09, 0.0, 0.8),
        ("ridged(p / 1 m)", 0.66, 0.14, 0.0, 1.0),
        ("worley(p / 1 m)", 0.52, 0.17, 0.0, 1.0),
        ("worley2(p / 1 m)", 0.2, 0.15, 0.0, 1.0),
    ] {
        let (m, d, l, h) = statistics(&Field::number(expression).numbers(&points));
        assert!((m - mean).abs() < 0.01, "{expression}: mean {m} instead of {mean}");
        assert!((d - deviation).abs() < 0.015, "{expression}: deviation {d} instead of {deviation}");
        assert!(l >= low && h <= high, "{expression}: {l} to {h} leaves {low} to {high}");
    }
}

#[test]
fn noise_is_continuous_over_the_faces_of_its_cells() {
    let (small, mut random) = (1e-7, Random(2));
    let mut near: Vec<[f64; 3]> = random.points(600, 20.0);
    for (i, point) in near.iter_mut().enumerate() {
        point[i % 3] = point[i % 3].round() - small;
    }
    let mut far = near.clone();
    for (i, point) in far.iter_mut().enumerate() {
        point[i % 3] += 2.0 * small;
    }
    // Slopes: a step of 2e-7 over a face may change a noise by its steepest slope times that.
    for (expression, slope) in [
        ("value(p / 1 m)", 4.0),
        ("perlin(p / 1 m)", 6.0),
        ("fbm(p / 1 m)", 40.0),
        ("turbulence(p / 1 m)", 40.0),
        ("ridged(p / 1 m)", 80.0),
        ("worley(p / 1 m)", 1.0),
        ("worley2(p / 1 m)", 2.0),
    ] {
        let field = Field::number(expression);
        for (a, b) in field.numbers(&near).iter().zip(field.numbers(&far)) {
            assert!((a - b).abs() <= 2.0 * small * slope * 1.001, "{expression} jumps by {}", (a - b).abs());
        }
    }
}

#[test]
fn curl_is_the_curl_of_its_potentials_and_has_no_divergence() {
    let curl = Field::coefficient("rgb(curl(p / 1 m).x, curl(p / 1 m).y, curl(p / 1 m).z) / 1 m");
    let potentials = ["perlin(p / 1 m)", "perlin(p / 1 m, seed: 101)", "perlin(p / 1 m, seed: 202)"].map(Field::number);
    let step = 1e-4;
    for point in Random(3).points(60, 10.0) {
        // Differences must not reach over a face, where only two derivatives are continuous.
        if point.iter().any(|x| (x - x.round()).abs() < 3.0 * step) {
            continue;
        }
        let moved = |axis: usize, by: f64| {
            let mut p = point;
            p[axis] += by;
            p
        };
        let slope = |field: &Field, axis: usize| {
            let v = field.numbers(&[moved(axis, step), moved(axis, -step)]);
            (v[0] - v[1]) / (2.0 * step)
        };
        let [a, b, c] = &potentials;
        let expected = [slope(c, 1) - slope(b, 2), slope(a, 2) - slope(c, 0), slope(b, 0) - slope(a, 1)];
        let value = &curl.at(&[point])[0];
        for (v, e) in value.iter().zip(expected) {
            assert!((v - e).abs() < 1e-5, "curl at {point:?} is {value:?}, not {expected:?}");
        }
        let divergence: f64 = (0..3)
            .map(|axis| {
                let v = curl.at(&[moved(axis, step), moved(axis, -step)]);
                (v[0][axis] - v[1][axis]) / (2.0 * step)
            })
            .sum();
        assert!(divergence.abs() < 1e-4, "divergence {divergence} at {point:?}");
    }
}

fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[test]
fn colour_maps_are_within_one_step_of_the_published_ones() {
    let golden = golden();
    for (name, rows) in golden["color"].as_object().expect("a map") {
        let field = Field::coefficient(&format!("{name}(p.x / 1 m) * 1 / 1 m"));
        for row in rows.as_array().expect("a list") {
            let row = floats(row);
            let color = &field.at(&[[row[0], 0.0, 0.0]])[0];
            for (linear, expected) in color.iter().zip(&row[1..]) {
                let off = (encode(*linear) - expected).abs() * 255.0;
                assert!(off < 0.9, "{name}({}) is off by {off} of 255 steps", row[0]);
            }
        }
        let ends = field.at(&[[-3.0, 0.0, 0.0], [0.0; 3], [1.0, 0.0, 0.0], [7.0, 0.0, 0.0]]);
        assert!(ends[0] == ends[1] && ends[2] == ends[3], "{name} holds its ends");
    }
}

#[test]
fn black_bodies_have_the_colours_of_planck() {
    // Linear sRGB, brightest channel 1: Planck's law over the CIE 1931 observer in steps of a nanometre.
    let field = Field::coefficient("black_body(p.x / 1 m) * 1 / 1 m");
    for (kelvin, expected) in [
        (1000.0, [1.0, 0.008_610, 0.0]),
        (2700.0, [1.0, 0.415_327, 0.099_154]),
        (6500.0, [1.0, 0.942_846, 0.992_335]),
        (10_000.0, [0.609_233, 0.695_044, 1.0]),
        (40_000.0, [0.342_509, 0.480_273, 1.0]),
    ] {
        let color = &field.at(&[[kelvin, 0.0, 0.0]])[0];
        for (value, expected) in color.iter().zip(expected) {
            assert!((encode(*value) - encode(expected)).abs() < 0.5 / 255.0, "{kelvin} K: {color:?}");
        }
    }
    assert_eq!(
        Field::number("ramp(p.x / 1 m, 2, 4)").numbers(&[[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [9.0, 0.0, 0.0]]),
        [0.0, 0.5, 1.0]
    );
}

#[test]
fn distance_fields_never_claim_more_room_than_there_is() {
    let mut random = Random(4);
    let near = random.points(3000, 3.0);
    let far: Vec<[f64; 3]> = near
        .iter()
        .map(|p| {
            let reach = 2.0 * random.next().powi(3);
            p.map(|x| x + reach * (2.0 * random.next() - 1.0))
        })
        .collect();
    let sphere = "sd_sphere(p - (0.5, 0, 0) m, 0.8 m)";
    let cube = "sd_box(p, (0.7, 0.5, 0.9) m)";
    for field in [
        "sd_sphere(p, 1.2 m)".to_owned(),
        cube.to_owned(),
        "sd_round_box(p, (0.7, 0.5, 0.9) m, 0.2 m)".to_owned(),
        "sd_torus(p, 1.1 m, 0.3 m)".to_owned(),
        "sd_capsule(p, (-1, 0.2, 0) m, (0.5, 1, 0.7) m, 0.25 m)".to_owned(),
        "sd_cylinder(p, 0.8 m, 1.1 m)".to_owned(),
        "sd_plane(p, (0.6, 0.8, 0))".to_owned(),
        "sd_ellipsoid(p, (1.5, 0.5, 1) m)".to_owned(),
        "sd_octahedron(p, 1.3 m)".to_owned(),
        format!("op_union({sphere}, {cube})"),
        format!("op_intersection({sphere}, {cube})"),
        format!("op_difference({sphere}, {cube})"),
        format!("op_smooth_union({sphere}, {cube}, 0.6 m)"),
        format!("op_smooth_intersection({sphere}, {cube}, 0.6 m)"),
        format!("op_smooth_difference({sphere}, {cube}, 0.6 m)"),
        format!("op_shell({cube}, 0.1 m)"),
        format!("op_round({cube}, 0.1 m)"),
        "sd_sphere(op_repeat(p, (2, 2, 2) m), 0.6 m)".to_owned(),
        "sd_box(op_repeat_limited(p, (1.5, 2, 2) m, (1, 0, 2)), (0.3, 0.4, 0.5) m)".to_owned(),
        "sd_capsule(op_mirror_x(p), (0.5, 0, 0) m, (1.5, 0.5, 0) m, 0.2 m)".to_owned(),
        "sd_box(op_rotate_x(op_rotate_y(op_rotate_z(p, 20 deg), -50 deg), 70 deg), (0.7, 0.5, 0.9) m)".to_owned(),
    ] {
        let values = Field::number(&format!("({field}) / 1 m"));
        for (((a, b), p), q) in values.numbers(&near).iter().zip(values.numbers(&far)).zip(&near).zip(&far) {
            let apart = p.iter().zip(q).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
            assert!((a - b).abs() <= apart + 1e-12, "{field}: {a} at {p:?} and {b} at {q:?}, {apart} apart");
        }
    }
}

#[test]
fn distance_fields_have_their_values() {
    for (field, point, expected) in [
        ("sd_sphere(p, 2 m)", [3.0, 4.0, 0.0], 3.0),
        ("sd_box(p, (1, 2, 3) m)", [4.0, 6.0, 0.0], 5.0),
        ("sd_box(p, (1, 2, 3) m)", [0.5, 0.0, 0.0], -0.5),
        ("sd_round_box(p, (1, 2, 3) m, 0.5 m)", [2.0, 0.0, 0.0], 1.0),
        ("sd_torus(p, 2 m, 0.5 m)", [0.0, 0.0, 2.0], -0.5),
        ("sd_torus(p, 2 m, 0.5 m)", [5.0, 4.0, 0.0], 4.5),
        ("sd_capsule(p, (0, 0, 0) m, (0, 2, 0) m, 0.5 m)", [3.0, 6.0, 0.0], 4.5),
        ("sd_cylinder(p, 1 m, 2 m)", [4.0, 6.0, 0.0], 5.0),
        ("sd_cylinder(p, 1 m, 2 m)", [0.0, 1.5, 0.0], -0.5),
        ("sd_plane(p, (0, 1, 0))", [9.0, -2.0, 5.0], -2.0),
        ("sd_ellipsoid(p, (2, 1, 4) m)", [0.0, 3.0, 0.0], 2.0),
        ("op_shell(sd_sphere(p, 2 m), 0.5 m)", [0.0, 0.0, 2.0], -0.25),
        ("op_smooth_union(p.x, p.y, 1 m)", [3.0, 3.0, 0.0], 2.75),
        ("op_smooth_union(p.x, p.y, 1 m)", [3.0, 4.5, 0.0], 3.0),
        ("op_smooth_difference(p.x, p.y, 1 m)", [3.0, -3.0, 0.0], 3.25),
        ("op_repeat(p, (2, 3, 4) m).x", [7.5, 0.0, 0.0], -0.5),
        ("op_repeat_limited(p, (2, 3, 4) m, (1, 1, 1)).x", [7.5, 0.0, 0.0], 5.5),
        ("op_mirror_x(p).x", [-7.5, 0.0, 0.0], 7.5),
        // A form turned by a right angle about z points along +y where it pointed along +x.
        ("sd_capsule(op_rotate_z(p, 90 deg), (0, 0, 0) m, (2, 0, 0) m, 0.5 m)", [0.0, 2.0, 0.0], -0.5),
        ("sd_capsule(op_rotate_x(p, 90 deg), (0, 0, 0) m, (0, 2, 0) m, 0.5 m)", [0.0, 0.0, 2.0], -0.5),
        ("sd_capsule(op_rotate_y(p, 90 deg), (0, 0, 0) m, (0, 0, 2) m, 0.5 m)", [2.0, 0.0, 0.0], -0.5),
    ] {
        let value = Field::number(&format!("({field}) / 1 m")).numbers(&[point])[0];
        assert!((value - expected).abs() < 1e-12, "{field} at {point:?} is {value}, not {expected}");
    }
}

#[test]
fn media_have_the_coefficients_of_their_sources() {
    let at = |expression: &str| Field::coefficient(expression).at(&[[0.0; 3]])[0].clone();
    let close = |values: &[f64], expected: &[f64], relative: f64| {
        values.len() == expected.len() && values.iter().zip(expected).all(|(v, e)| (v / e - 1.0).abs() < relative)
    };
    // Pope and Fry 1997 at 680, 550 and 440 nm.
    assert!(close(&at("water_k_a(lambda)"), &[0.465, 0.0565, 0.00635], 1e-12), "{:?}", at("water_k_a(lambda)"));
    assert!(close(&at("water_rgb_k_a(amount: 2)"), &[0.93, 0.113, 0.0127], 1e-12));
    // Bucholtz 1995, table 2: 4.513e-27, 1.101e-26 (interpolated) cm² at 550 and 440 nm, times 2.54743e19 /cm³.
    let air = at("air_k_s(lambda)");
    assert!((air[1] / 1.1497e-5 - 1.0).abs() < 0.01, "{air:?}");
    assert!((air[2] / air[1] - (550.0f64 / 440.0).powf(4.08)).abs() < 0.02, "{air:?}");
    // Contrast 2 % at the visibility.
    let fog = at("fog_k_t(300 m)")[0];
    assert!(((-fog * 300.0).exp() - 0.02).abs() < 1e-4, "{fog}");
    // A density of 1 /m leaves a tenth after a metre.
    assert!(((-at("smoke_k_t(1 /m)")[0]).exp() - 0.1).abs() < 1e-12);
    assert!(close(&at("soot_albedo() / 1 m"), &[0.25], 1e-12));
    assert!(close(&at("air_density(8 km) / 1 m"), &[(-1.0f64).exp()], 1e-12));
    // Jensen et al. 2001, per millimetre.
    assert!(close(&at("whole_milk_k_s(amount: 0.5)"), &[1275.0, 1605.0, 1885.0], 1e-12));
    assert!(close(&at("skin2_k_a()"), &[13.0, 70.0, 145.0], 1e-12));
}

/// Phong's colours by hand: of a grey layer whose surface lies across a vector, seen along z.
#[test]
fn layers_are_shaded_by_how_they_lie() {
    let shaded = |normal: &str, more: &str| -> f64 {
        let grey = "layer(color: color(0.4, 0.4, 0.4), k: 2 /m)";
        let scene = scene(&format!(
            "medium test {{
                shape = sphere(center: (0, 0, 0) m, radius: 1 m)
                transfer = phong({grey}, {normal} / 1 m, (0, 0, 1){more})
            }}"
        ));
        let medium = &scene.media[0];
        let [k_a, k_e] = [medium.k_a, medium.k_e].map(|node| Field::new(&scene, node).numbers(&[[0.0; 3]])[0]);
        assert!((k_a - 2.0).abs() < 1e-12, "the extinction stays: {k_a}");
        k_e / k_a
    };
    let color = |lit: f64, glint: f64| 0.4 * lit * (1.0 - glint) + glint;
    let half = 0.5f64.sqrt();
    for (normal, more, expected) in [
        // Towards the eye, across, away, at 60 degrees.
        ("(0, 0, 3)", "", color(1.0, 0.25)),
        ("(2, 0, 0)", "", color(0.25, 0.0)),
        ("(0, 0, -0.01)", "", color(1.0, 0.25)),
        ("(0.75^0.5, 0, 0.5)", "", color(0.625, 0.25 * 0.5f64.powi(24))),
        // Lit from the side: half way between, and straight at the light.
        ("(1, 0, 1)", ", to_light: (5, 0, 0)", color(0.25 + 0.75 * half, 0.25)),
        ("(1, 0, 0)", ", to_light: (5, 0, 0)", color(1.0, 0.25 * half.powi(24))),
        ("(0, 0, 1)", ", ambient: 0.1, diffuse: 0.2, specular: 0", color(0.3, 0.0)),
        ("(0.75^0.5, 0, 0.5)", ", specular: 1, shininess: 2", color(0.625, 0.25)),
        // Light from behind: no direction is half way.
        ("(1, 0, 0)", ", to_light: (0, 0, -1)", color(0.25, 0.0)),
        // No gradient, no surface; one of `soft` is half of one.
        ("(0, 0, 0)", "", 0.4),
        ("(2, 0, 0)", ", soft: 2 /m", 0.5 * (0.4 + 0.1)),
    ] {
        let found = shaded(normal, more);
        assert!((found - expected).abs() < 1e-9, "{normal}{more}: {found} instead of {expected}");
    }
}

#[test]
fn every_public_function_of_the_library_is_documented_and_reaches_a_test() {
    let tests = include_str!("library.rs");
    let golden = include_str!("golden/library.json");
    for module in ["phase", "noise", "color", "shape", "media", "shade"] {
        let path = format!("{}/../library/{module}.vol", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).expect("the module is there");
        let lines: Vec<&str> = text.lines().collect();
        for (i, line) in lines.iter().enumerate() {
            let Some(name) = line.strip_prefix("fn ").and_then(|l| l.split('(').next()) else { continue };
            assert!(i > 0 && lines[i - 1].starts_with("///"), "{module}.vol: `{name}` has no documentation");
            let called_here = text.matches(&format!("{name}(")).count() > 1;
            let tested = [tests, golden].iter().any(|t| t.contains(name));
            // The materials of Jensen's table are rows of one kind; two of them stand for all.
            let row = module == "media" && line.contains("amount: number = 1");
            assert!(tested || called_here || row, "{module}.vol: `{name}` is not tested");
        }
    }
}
