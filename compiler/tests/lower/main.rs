//! Lowering of checked scenes that are built by hand, so that nothing but lowering is under test.

mod build;
mod builtins;
mod expressions;
mod limits;
mod mie;
mod real;
mod regions;
mod scenes;
mod spectra;

use compiler::check::hir;
use compiler::diagnostic::Diagnostics;
use compiler::ir::eval::{Environment, LANES, NoVoxels, Tables, Tape, Voxels};
use compiler::ir::{FieldScene, NodeId, Units, verify};
use compiler::lower::{lower, lower_scaled};

/// Lowers a scene that must be without fault, in metres.
pub(crate) fn metres(scene: &hir::Scene) -> FieldScene {
    in_units(scene, Units::METRE)
}

pub(crate) fn in_units(scene: &hir::Scene, units: Units) -> FieldScene {
    let mut diagnostics = Diagnostics::default();
    let lowered = lower(scene, units, &mut diagnostics);
    assert_eq!(diagnostics.0, [], "no finding");
    let lowered = lowered.expect("a field scene");
    verify(&lowered.graph, &lowered.roots()).expect("a well-formed graph");
    lowered
}

/// The codes and labelled places of what a scene's lowering reports.
pub(crate) fn faults(scene: &hir::Scene) -> Vec<(&'static str, Vec<u32>)> {
    let mut diagnostics = Diagnostics::default();
    let lowered = lower_scaled(scene, &mut diagnostics);
    assert!(lowered.is_none() == diagnostics.has_errors(), "an error and no scene, or a scene and no error");
    for d in diagnostics.iter() {
        assert!(compiler::diagnostic::explain(d.code).is_some(), "{} is not registered", d.code);
        assert!(!d.hints.is_empty() || !d.notes.is_empty(), "{} says nothing about what to do", d.code);
    }
    diagnostics.iter().map(|d| (d.code, d.labels.iter().map(|l| l.span.start).collect())).collect()
}

pub(crate) fn codes(scene: &hir::Scene) -> Vec<&'static str> {
    faults(scene).into_iter().map(|f| f.0).collect()
}

/// What the fields see.
#[derive(Clone, Debug, Default)]
pub(crate) struct Place {
    pub(crate) position: [f64; 3],
    pub(crate) direction: [f64; 3],
    pub(crate) cos_theta: f64,
    pub(crate) time: f64,
    pub(crate) altitude: f64,
}

/// A position in metres.
pub(crate) fn here(x: f64, y: f64, z: f64) -> Place {
    Place { position: [x, y, z], direction: [0.0, 0.0, 1.0], ..Place::default() }
}

/// The value of a node, with lengths of the place in metres and params at their defaults.
pub(crate) fn value_with(scene: &FieldScene, node: NodeId, place: &Place, voxels: &dyn Voxels) -> Vec<f64> {
    let factor = scene.units.scale(1.0);
    let params: Vec<Vec<f64>> = scene
        .params
        .iter()
        .map(|p| p.default.iter().map(|v| v * scene.units.scale(p.dimension[0])).collect())
        .collect();
    let tables = Tables::evaluate(&scene.graph, &params, place.time);
    let altitudes = vec![[place.altitude * factor; LANES]; scene.shells.len()];
    let environment = Environment {
        position: place.position.map(|v| [v * factor; LANES]),
        direction: place.direction.map(|v| [v; LANES]),
        cos_theta: [place.cos_theta; LANES],
        time: place.time,
        altitudes: &altitudes,
        params: &params,
        tables: &tables,
    };
    let tape = Tape::new(&scene.graph, &[node]);
    let mut scratch = tape.scratch();
    tape.run(&environment, voxels, &mut scratch);
    tape.root(&scratch, 0).iter().map(|lanes| lanes[0]).collect()
}

pub(crate) fn value(scene: &FieldScene, node: NodeId, place: &Place) -> Vec<f64> {
    value_with(scene, node, place, &NoVoxels)
}

pub(crate) fn close(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.len() == b.len()
        && a.iter().zip(b).all(|(a, b)| {
            a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= tolerance * (1.0 + a.abs().max(b.abs()))
        })
}
