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
    assert_eq!(diagnostics.0, [], "{}", render(&diagnostics, &sources));
    let lowered = lowered.expect("a field scene");
    verify(&lowered.graph, &lowered.roots()).expect("a well-formed graph");
    lowered
}

/// Nodes that the scene needs, not those that were made on the way.
fn live(scene: &FieldScene) -> usize {
    scene.graph.reachable(&scene.roots()).iter().filter(|l| **l).count()
}

#[test]
fn examples() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");
    let mut found = 0;
    for entry in std::fs::read_dir(folder).expect("the examples") {
        let path = entry.expect("a file").path();
        if path.extension().is_none_or(|e| e != "vol") {
            continue;
        }
        let scene = lowered(&std::fs::read_to_string(&path).expect("a text"));
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
        assert!(live(&scene) < 2000, "{} nodes in {path:?}", live(&scene));
        found += 1;
    }
    assert!(found >= 6, "{found} examples");
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
