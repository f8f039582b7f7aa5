//! Coefficients that go wrong at run time (`suite/faults/*.vol`, each with a line `//? fault CODE FIELD of MEDIUM`): every
//! engine, at every order of scattering, in pictures and along rays, says which field of which medium it is, and where.

use compiler::Options;
use compiler::diagnostic::{Diagnostic, Diagnostics};
use compiler::ir::Scattering;
use runtime::frame::{EngineChoice, Params, ProbeSettings, Session};
use tyndall_tests::{every_scene, open, pixel_rays, text};

/// What a picture, or rays by hand, say is wrong.
fn faults(session: &mut Session, picture: bool) -> Diagnostics {
    let params = Params::defaults(&session.program().lowered);
    if picture {
        return session.draw(&params, 0.0, &|_| {}).map_or_else(|t| t.diagnostics, |d| d.faults);
    }
    let rays = pixel_rays(session, [6, 6]);
    session.probe(&params, &rays, &ProbeSettings::default()).map_or_else(|t| t.diagnostics, |_| Diagnostics::default())
}

/// Three numbers in `at (x, y, z) m`, of a place in the unit ball.
fn names_a_place(diagnostic: &Diagnostic) -> bool {
    let place = diagnostic.message.split_once("at (").and_then(|(_, rest)| rest.split_once(") m"));
    let Some((place, _)) = place else { return false };
    let numbers: Vec<f64> = place.split(", ").filter_map(|x| x.parse().ok()).collect();
    numbers.len() == 3 && numbers.iter().map(|x| x * x).sum::<f64>() < 1.001
}

fn all_are_named(engine: EngineChoice) {
    every_scene("tests/suite/faults", |path| {
        let text = text(path);
        let line = text.lines().find_map(|l| l.strip_prefix("//? fault ")).expect("a fault is expected");
        let [code, field, "of", medium] = line.split(' ').collect::<Vec<_>>()[..] else { panic!("`{line}`") };
        let mut wrong = vec![];
        for scattering in [Scattering::None, Scattering::Single, Scattering::Multiple] {
            for picture in [true, false] {
                let base = if picture { Options::default() } else { Options::probe() };
                let options = Options { size: Some([8, 8]), samples: Some(64), scattering: Some(scattering), ..base };
                let found = faults(&mut open(path, options, engine)?, picture);
                let named = |d: &Diagnostic| {
                    let words =
                        [field, medium].map(|w| d.message.contains(&format!("`{w}`")) || d.message.starts_with(w));
                    d.code == code && words == [true; 2] && names_a_place(d) && d.primary_span().is_some()
                };
                if !found.iter().any(named) {
                    wrong.push(format!("{engine:?}, {scattering:?}, picture: {picture}: {found:?}"));
                }
            }
        }
        Some(wrong)
    });
}

#[test]
fn the_gpu_names_them() {
    all_are_named(EngineChoice::Gpu);
}

#[test]
fn the_reference_names_them() {
    all_are_named(EngineChoice::Reference);
}
