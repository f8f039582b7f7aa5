//! `mie` from text to graph, against the series themselves.

use crate::{Place, here, value};
use compiler::diagnostic::{Diagnostics, Severity, render};
use compiler::ir::eval::mie::Sphere;
use compiler::ir::{FieldScene, Units, verify};
use compiler::loader::NoFiles;
use compiler::lower::{lower, lower_scaled};
use std::f64::consts::PI;

/// Lowers what stands in the one medium of a scene, in RGB.
fn scene(units: Option<Units>, medium: &str) -> Result<(FieldScene, Vec<&'static str>), Vec<&'static str>> {
    let text = format!(
        "param share = 0.25 in 0 .. 1\n\
         table n {{ 400 nm: 1.4  700 nm: 1.3 }}\n\
         table dense {{ 0: share  1: 1 }}\n\
         const one = {{ let i = 1  sum(j in 0..3) i * (j - 0.5) }}\n\
         fn water(l: length) -> number = 1.32 + 3e3 nm^2 / l^2\n\
         fn turned(cos_theta: number, share: number) -> spectrum = mix(mie(radius: 1 um, index: 1.5), mie(2 um, 1.5), share)\n\
         medium a {{ shape = sphere(center: (0,0,0) m, radius: 1 m)  {medium} }}\n\
         light sun {{ direction = (0, -1, 0)  irradiance = 1 lx }}"
    );
    let (sources, found, scene) = compiler::check_scene("scene.vol", &text, &NoFiles);
    let scene = scene.unwrap_or_else(|| panic!("{}", render(&found, &sources)));
    let mut diagnostics = Diagnostics::default();
    let lowered = match units {
        Some(units) => lower(&scene, units, &mut diagnostics),
        None => lower_scaled(&scene, &mut diagnostics),
    };
    for d in diagnostics.iter() {
        assert!(compiler::diagnostic::explain(d.code).is_some(), "{} is not registered", d.code);
        assert!(d.primary_span().is_some() && (!d.hints.is_empty() || !d.notes.is_empty()), "{}", d.code);
    }
    let codes: Vec<&str> = diagnostics.iter().map(|d| d.code).collect();
    let Some(lowered) = lowered else { return Err(codes) };
    assert!(diagnostics.iter().all(|d| d.severity != Severity::Error));
    verify(&lowered.graph, &lowered.roots()).expect("a well-formed graph");
    Ok((lowered, codes))
}

const WAVELENGTHS: [f64; 3] = [680e-9, 550e-9, 440e-9];

fn sphere(radius: f64, n: f64, k: f64, band: usize) -> Sphere {
    Sphere::new(2.0 * PI * radius / WAVELENGTHS[band], n, k)
}

#[test]
fn phase_functions_are_those_of_the_spheres() {
    // What is written, and radius, n and k per band.
    let water = |l: f64| 1.32 + 3e3 / (l * 1e9).powi(2);
    let table = |l: f64| 1.4 - 0.1 * (l * 1e9 - 400.0) / 300.0;
    type Band = fn(f64) -> f64;
    let cases: Vec<(&str, Band, Band, Band)> = vec![
        ("mie(radius: 1 um, index: 1.33)", |_| 1e-6, |_| 1.33, |_| 0.0),
        ("mie(1 um, 1.33)", |_| 1e-6, |_| 1.33, |_| 0.0),
        ("mie(radius: 1 um, index: (1.5, 0.01))", |_| 1e-6, |_| 1.5, |_| 0.01),
        ("mie(radius: 1 um, index: 1.5, k: 0.01)", |_| 1e-6, |_| 1.5, |_| 0.01),
        ("mie(radius: 30 nm, index: (0.2, 3.4), spread: 1)", |_| 30e-9, |_| 0.2, |_| 3.4),
        ("mie(radius: 700 nm, index: water(lambda))", |_| 700e-9, water, |_| 0.0),
        ("mie(radius: 700 nm, index: n(lambda))", |_| 700e-9, table, |_| 0.0),
        ("mie(radius: lambda, index: 1.2, k: rgb(0, 0, 0))", |l| l, |_| 1.2, |_| 0.0),
        ("mie(radius: one * 1 um, index: 1.4, cos_theta: cos_theta)", |_| 1.5e-6, |_| 1.4, |_| 0.0),
        ("{ let r = 0.5 um  mie(2 * r, index: 1.33) }", |_| 1e-6, |_| 1.33, |_| 0.0),
    ];
    for (text, radius, n, k) in cases {
        for units in [None, Some(Units { length: 1024.0 })] {
            let (scene, codes) = scene(units, &format!("k_s = 1 /m  phase = {text}")).expect(text);
            assert_eq!(codes, [""; 0], "{text}");
            let node = scene.media[0].phase.expect("a phase function");
            for i in (0..=180).step_by(9) {
                let cos_theta = (f64::from(i) * PI / 180.0).cos();
                let values = value(&scene, node, &Place { cos_theta, ..here(0.0, 0.0, 0.0) });
                assert_eq!(values.len(), 3);
                for (band, got) in values.iter().enumerate() {
                    let l = WAVELENGTHS[band];
                    let exact = sphere(radius(l), n(l), k(l), band).phase(cos_theta);
                    assert!((got / exact - 1.0).abs() < 3e-4, "{text}, {i} degrees, band {band}: {got} {exact}");
                }
            }
        }
    }
}

#[test]
fn rounding_of_the_cosine_is_no_fault() {
    let (scene, _) = scene(None, "k_s = 1 /m  phase = mie(radius: 5 um, index: 1.33)").expect("a scene");
    let node = scene.media[0].phase.expect("a phase function");
    let at = |cos_theta: f64| value(&scene, node, &Place { cos_theta, ..here(0.0, 0.0, 0.0) });
    assert_eq!(at(1.0 + 1e-7), at(1.0));
    assert_eq!(at(-1.0 - 1e-7), at(-1.0));
}

#[test]
fn mixtures_follow_params() {
    let share = "phase = mix(mie(radius: 1 um, index: 1.5), mie(radius: 2 um, index: 1.5), share)";
    for phase in [share, "phase = turned(share: share)"] {
        let (scene, codes) = scene(None, &format!("k_s = 1 /m  {phase}")).expect("a scene");
        assert_eq!(codes, [""; 0], "{phase} is normalised already");
        let node = scene.media[0].phase.expect("a phase function");
        for cos_theta in [-0.9, 0.0, 0.8] {
            for (band, got) in value(&scene, node, &Place { cos_theta, ..Place::default() }).into_iter().enumerate() {
                let of = |radius: f64| sphere(radius, 1.5, 0.0, band).phase(cos_theta);
                let exact = 0.75 * of(1e-6) + 0.25 * of(2e-6);
                assert!((got / exact - 1.0).abs() < 3e-4, "{phase}: {got} {exact}");
            }
        }
    }
}

#[test]
fn cross_sections_are_areas() {
    for (text, share) in [
        ("mie_scattering(radius: 2 um, index: (1.5, 0.01))", [1.0, 0.0]),
        ("mie_absorption(radius: 2 um, index: (1.5, 0.01))", [0.0, 1.0]),
        ("mie_extinction(2 um, 1.5, k: 0.01)", [1.0, 1.0]),
    ] {
        for units in [None, Some(Units { length: 1.0 }), Some(Units { length: 4096.0 })] {
            let (scene, codes) = scene(units, &format!("k_s = 1e9 m^-3 * {text}")).expect(text);
            assert_eq!(codes, [""; 0], "{text}");
            let values = value(&scene, scene.media[0].k_s, &here(0.1, 0.2, 0.3));
            for (band, got) in values.into_iter().enumerate() {
                let sphere = sphere(2e-6, 1.5, 0.01, band);
                let q = share[0] * sphere.q_scattering() + share[1] * sphere.q_absorption();
                let per_metre = got * scene.units.scale(1.0);
                let exact = 1e9 * PI * 4e-12 * q;
                assert!((per_metre / exact - 1.0).abs() < 1e-12, "{text}: {per_metre} {exact}");
            }
        }
    }
    // Absorption of what is clear is nothing, and nothing is drawn for it.
    let (scene, _) = scene(None, "k_s = 1 /m  k_a = 1e9 m^-3 * mie_absorption(1 um, 1.33)").expect("a scene");
    assert_eq!(value(&scene, scene.media[0].k_a, &here(0.0, 0.0, 0.0)), [0.0; 3]);
}

#[test]
fn a_spread_smooths_and_scatters_more() {
    let k_s = |text: &str| {
        let (scene, _) = scene(None, &format!("k_s = 1e9 m^-3 * mie_scattering({text})")).expect("a scene");
        value(&scene, scene.media[0].k_s, &here(0.0, 0.0, 0.0))
    };
    let (one, many) = (k_s("10 um, 1.33"), k_s("10 um, 1.33, spread: 1.5"));
    // Large spheres take away twice their shadow: ⟨r²⟩ = r̃² exp(2 ln² s).
    for (one, many) in one.iter().zip(many) {
        assert!((many / one / (2.0 * 1.5_f64.ln().powi(2)).exp() - 1.0).abs() < 0.05, "{one} {many}");
    }
}

#[test]
fn equal_particles_share_a_table() {
    let phase = "phase = mix(mie(1 um, 1.5), mie(radius: 1000 nm, index: (1.5, 0)), share)";
    let (scene, _) = scene(None, &format!("k_s = 1 /m  {phase}")).expect("a scene");
    assert_eq!(scene.graph.tables.iter().filter(|t| t.name == "mie").count(), 1);
}

#[test]
fn what_is_not_known_or_does_not_exist_is_refused() {
    for (phase, code) in [
        ("mie(radius: share * 1 um, index: 1.5)", "E0524"),
        ("mie(radius: 1 um, index: 1.5 + 0.1 * time / 1 s)", "E0524"),
        ("mie(radius: length(p), index: 1.5)", "E0524"),
        ("mie(radius: 1 um, index: 1.5, spread: 1 + cos_theta^2)", "E0524"),
        ("mie(radius: 1 um, index: 1.5, k: dense(0.5))", "E0524"),
        ("mie(radius: 0 m, index: 1.5)", "E0525"),
        ("mie(radius: -1 um, index: 1.5)", "E0525"),
        ("mie(radius: 1 um, index: 0)", "E0525"),
        ("mie(radius: 1 um, index: (1.5, -0.1))", "E0525"),
        ("mie(radius: 1 um, index: 1.5, spread: 0.9)", "E0525"),
        ("mie(radius: 1 um, index: 1.5, spread: 100)", "E0525"),
        ("mie(radius: 1 um, index: 1)", "E0525"),
        ("mie(radius: 10 mm, index: 1.5)", "E0525"),
        ("mie(radius: 1e-6 nm, index: 1.5)", "E0525"),
        ("mie(radius: 1 um, index: 0 / (1 - 1))", "E0525"),
    ] {
        assert_eq!(scene(None, &format!("k_s = 1 /m  phase = {phase}")).map(|_| ()), Err(vec![code]), "{phase}");
    }
    // A table that follows a param, and that nothing here reads, is no obstacle.
    let (_, codes) =
        scene(None, "k_s = dense(0.5) / 1 m  phase = mie(radius: 1 um, index: n(550 nm))").expect("a scene");
    assert_eq!(codes, [""; 0]);
}

#[test]
fn coarse_tables_are_told() {
    for (phase, code) in [("mie(radius: 10 um, index: 1.33)", "N0526"), ("mie(radius: 400 um, index: 1.33)", "W0527")] {
        // In grey, since each band takes a second.
        let (_, codes) = scene(None, &format!("k_s = 1 /m  phase = {phase} }} image {{ bands = gray")).expect(phase);
        assert_eq!(codes, [code], "{phase}");
    }
}
