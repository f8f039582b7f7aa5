//! The example scenes, from text to field graph.

use crate::{Place, close, here, value, value_with};
use compiler::check::hir;
use compiler::diagnostic::{Diagnostics, render};
use compiler::ir::eval::NoVoxels;
use compiler::ir::{FieldScene, Tier, verify};
use compiler::loader::{GridHeader, LoadError, Loader, Scalar};
use compiler::lower::{lower, lower_scaled};

/// Grids of a millimetre, whatever the file.
struct Grids;

impl Loader for Grids {
    fn module(&self, _from: &str, path: &str) -> Result<(String, String), LoadError> {
        Err(LoadError { code: "E0601", message: format!("there is no `{path}`"), hint: None })
    }

    fn grid(&self, _from: &str, _path: &str) -> Result<GridHeader, LoadError> {
        let world_from_index = [[1e-3, 0.0, 0.0, -0.1], [0.0, 1e-3, 0.0, -0.13], [0.0, 0.0, 1e-3, -0.07]];
        Ok(GridHeader { dims: [197, 233, 189], scalar: Scalar::U8, slope: 1.0, intercept: 0.0, world_from_index })
    }
}

fn checked(text: &str) -> (compiler::source::Sources, hir::Scene) {
    let (sources, diagnostics, scene) = compiler::check_scene("scene.vol", text, &Grids);
    assert!(!diagnostics.has_errors(), "{}", render(&diagnostics, &sources));
    (sources, scene.expect("a checked scene"))
}

fn lowered(text: &str) -> FieldScene {
    let (sources, scene) = checked(text);
    let mut diagnostics = Diagnostics::default();
    let lowered = lower_scaled(&scene, &mut diagnostics);
    // Two bands cannot show colours, and say so.
    diagnostics.0.retain(|d| d.code != "W0528");
    assert_eq!(diagnostics.0, [], "{}", render(&diagnostics, &sources));
    let lowered = lowered.expect("a field scene");
    verify(&lowered.graph, &lowered.roots()).expect("a well-formed graph");
    lowered
}

/// Nodes that the scene needs, not those that were made on the way.
fn live(scene: &FieldScene) -> usize {
    scene.graph.reachable(&scene.roots()).iter().filter(|l| **l).count()
}

const EXAMPLES: [(&str, &str); 6] = [
    ("brain", include_str!("../../../examples/brain.vol")),
    ("cloud", include_str!("../../../examples/cloud.vol")),
    ("glowing_ball", include_str!("../../../examples/glowing_ball.vol")),
    ("haze", include_str!("../../../examples/haze.vol")),
    ("nebula", include_str!("../../../examples/nebula.vol")),
    ("overlap", include_str!("../../../examples/overlap.vol")),
];

#[test]
fn examples() {
    for (name, text) in EXAMPLES {
        let scene = lowered(text);
        let tiers = scene.graph.tiers();
        for medium in &scene.media {
            for node in [medium.k_a, medium.k_s, medium.k_e] {
                let width = scene.graph.width(node);
                assert!(width == 1 || width == scene.bands.count(), "{}", medium.name);
                for place in [here(0.01, 0.02, -0.03), here(0.3, 0.4, 0.1), here(-0.2, 0.6, -0.3)] {
                    let values = value_with(&scene, node, &place, &NoVoxels);
                    assert!(values.iter().all(|v| *v >= 0.0), "{} at {place:?}: {values:?}", medium.name);
                }
            }
        }
        assert!([scene.camera.from, scene.camera.to].iter().all(|n| tiers[n.0 as usize] <= Tier::Frame));
        // Loops stay loops and equal expressions one node: the largest example has some hundred.
        assert!(live(&scene) < 2000, "{} nodes in {name}", live(&scene));
    }
}

/// What the library computes does not depend on the units that lengths are measured in.
#[test]
fn noise_is_the_same_in_all_units() {
    let text = "use std::noise::{fbm, worley}\n\
                medium cloud { density = fbm(p / 0.3 m, octaves: 3) + worley(p / 0.2 m) k_a = 1 /m }\n\
                camera { from = (0, 0, -4) m to = (0, 0, 0) m }";
    let (_, scene) = checked(text);
    let mut diagnostics = Diagnostics::default();
    let place = here(0.21, -0.43, 1.07);
    let mut at = |length: f64| {
        let lowered = lower(&scene, compiler::ir::Units { length }, &mut diagnostics).expect("a field scene");
        value(&lowered, lowered.media[0].k_a, &place)[0] / length
    };
    let metre = at(1.0);
    assert!(metre > 0.0);
    assert!(close(&[at(1024.0), at(1.0 / 1024.0)], &[metre; 2], 1e-15));
}

/// The gradient of the library's noise against differences of the noise.
#[test]
fn gradients_of_noise() {
    for noise in ["perlin(q)", "fbm(q, octaves: 3)", "worley(q)", "value(q)", "turbulence(q)", "ridged(q)"] {
        let name = noise.split('(').next().unwrap_or_default();
        let text = format!(
            "use std::noise::{name}\n\
             fn f(q: vec3) -> number = {noise}\n\
             medium a {{ k_a = (10 + f(p / 1 m)) /m  k_s = (10 + gradient(f, p / 1 m).x) /m }}"
        );
        let scene = lowered(&text);
        let unit = scene.units.length;
        let f = |x: f64| value(&scene, scene.media[0].k_a, &here(x, 0.37, 0.71))[0] / unit;
        for x in [0.234, 1.61, -2.83] {
            let slope = value(&scene, scene.media[0].k_s, &here(x, 0.37, 0.71))[0] / unit - 10.0;
            let h = 1e-5;
            let expected = (f(x + h) - f(x - h)) / (2.0 * h);
            assert!(close(&[slope], &[expected], 1e-6), "{noise} at {x}: {slope} against {expected}");
        }
    }
}

/// The scenes that the contract of the language prints in full.
#[test]
fn a_scene_of_one_medium_is_framed() {
    let scene = lowered("medium ball { shape = sphere(center: (0, 1, 0) m, radius: 1 m) k_a = 2 /m }");
    let to = value(&scene, scene.camera.to, &Place::default());
    assert_eq!(to, [0.0, 1.0, 0.0]);
}

/// Every function of the prelude and every form of expression, as the checker hands them over.
const PRELUDE: &str = r##"
grid head { file = "head.nii" filter = cubic }
table profile { 0 m: 1  10 m: 0.5  10 m: 0.25 }
transfer tissue { 0: #000, 0 /m  100: #e68066, 20 /m }
param gain = 2 in 0 .. 4
param size = 1 m in 0.5 m .. 3 m
param tint = #80a0ff
param on = true
const two_pi = 2 * pi
const heights = (0.5, 1, 2) m
fn unary(x: number) -> number =
    exp(x) + expm1(x) + log(x) + log2(x) + log10(x) + exp2(x) + sqrt(x) + cbrt(x) + sin(x) + cos(x) + tan(x)
    + asin(x / 9) + acos(x / 9) + atan(x) + sinh(x) + cosh(x) + tanh(x) + abs(x) + sign(x) + floor(x) + ceil(x) + round(x) + fract(x)
fn binary(x: number, y: number = 2) -> number =
    atan2(y, x) + min(x, y, 3) + max(x, y) + pow(x, y) + x ^ 3 + x ^ -0.5 + x ^ 1.5 + mod(x, y) + clamp(x, 0, y) + mix(x, y, 0.5) + step(x, y)
    + smoothstep(0, y, x) + (if x < y && !(x == y) || x >= 2 then 1 else if x != 1 then 2 else 3)
fn vectors(q: vec3) -> number = {
    let v = vec3(2) + (1, 2, 3) * q
    let w = vec2(q.x, q.z)
    dot(v, cross(q, v)) + length(v) + distance(v, q) + normalize(v).y + reflect(v, normalize(q)).z + length(w) + w.x + v.zx.y + dot(max(v, q), floor(q))
}
fn loops(q: vec3, n: number) -> number =
    sum(i in 0..n) { let a = q * i  length(a) } + product(i in 1..n) (1 + i) + max(i in 0..n) q.x * i + min(i in -1..2) sum(j in 0..n) i * j + q.y
fn shade(x: number, hard: number = 1) -> layer = layer(color: mix(#000, #fff, clamp(x, 0, 1)), k: hard * opacity(0.5, per: 1 mm))
fn hill(q: vec3<length>) -> length = length(q) - 0.8 m
medium a {
    shape = sphere(center: (0, 0, 0) m, radius: size)
    transform = translate(heights) * rotate(axis: (0, 1, 0), angle: 20 deg) * scale((1, 2, 1))
    density = abs(unary(1.5 + gain) + binary(2) + vectors(p / size) + loops(p / 1 m, 3) + two_pi) * profile(p.y) + cell_hash(floor(p / 1 m), 3)
    k_a = rgb(1, 2, gain) / m * (550 nm / lambda)^4
    k_s = tint * 2 /m
    k_e = (if on then 1 else 2) * luminance(tint) * lx / m + length(cell_hash3(p / 1 m, 1)) * exp(-time / 1 s) * lx / m
}
medium b { shape = intersection(bounds(head), box(min: min_corner(head), max: center(head))) transfer = tissue(head(p)) }
medium c { shape = difference(sdf(hill(p)), slab(axis: (0, 1, 0), from: 0 m, to: 1 cm)) transfer = shade(head(p) / 255) }
medium d {
    shape = shell(center: (0, -10, 0) m, inner: 9 m, outer: 12 m)
    k_a = exp(-h / 1 m) * (2 + gradient(h, p).y) /m
    k_e = (3 + gradient(head, p) / 1 m^-1).x^2 * lx / m
}
medium e {
    shape = union(cylinder(from: (0, 0, 0) m, to: (1, 0, 0) m, radius: 10 cm), ellipsoid(center: (0, 0, 0) m, radii: (1, 2, 3) m))
    k_a = (2 + dot(gradient(hill, p), dir)) /m
}
light sky { environment = mix(rgb(0.4, 0.6, 0.8), rgb(0.1, 0.2, 0.5), clamp(dir.y, 0, 1)) * lx }
camera { from = max_corner(head) + size * (3, 1, -4) to = center(head) + (0, 0, 0.1) m projection = orthographic(height: 2 m) }
image { exposure = gain - 2 }
"##;

#[test]
fn the_prelude() {
    for bands in ["rgb", "gray", "[650 nm, 500 nm]", "[680 nm, 590 nm, 530 nm, 440 nm]"] {
        let scene = lowered(&PRELUDE.replace("image { ", &format!("image {{ bands = {bands} ")));
        let place = Place { direction: [0.0, 0.6, 0.8], altitude: 0.5, time: 1.0, ..here(0.21, 0.34, 0.55) };
        for medium in &scene.media {
            for node in [medium.k_a, medium.k_s, medium.k_e] {
                let values = value_with(&scene, node, &place, &NoVoxels);
                assert!(values.iter().all(|v| v.is_finite()), "{bands}: {} {values:?}", medium.name);
            }
        }
        assert_eq!(scene.media.len(), 5);
    }
}

/// What the passes make of a scene has the values of the scene as it was lowered.
#[test]
fn passes_keep_values() {
    let scene = lowered(PRELUDE);
    let optimised = compiler::passes::optimise(&scene, &mut compiler::program::Ledger::default());
    verify(&optimised.graph, &optimised.roots()).expect("a well-formed graph");
    assert_eq!(optimised.shells.len(), scene.shells.len());
    for i in 0..40 {
        let t = f64::from(i);
        let direction = [0.6 * t.sin(), 0.6 * t.cos(), 0.8];
        let place =
            Place { direction, altitude: 0.1 * t, time: 0.1 * t, ..here((1.7 * t).sin(), (2.3 * t).cos(), 0.05 * t) };
        for (before, after) in scene.media.iter().zip(&optimised.media) {
            for (a, b) in [(before.k_a, after.k_a), (before.k_s, after.k_s), (before.k_e, after.k_e)] {
                let (a, b) = (value(&scene, a, &place), value(&optimised, b, &place));
                let b = if b.len() < a.len() { vec![b[0]; a.len()] } else { b };
                assert!(close(&a, &b, 1e-9), "{} at {place:?}: {a:?} and {b:?}", before.name);
            }
        }
    }
}
