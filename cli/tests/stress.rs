//! `vol stress` as people and scripts use it.

mod place;

use place::{Place, keys};
use serde_json::Value;

/// Nothing is wrong with it.
const SOUND: &str = "param absorption = 2 /m in 0 /m .. 40 /m
medium ball { shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_a = absorption  k_e = 3 lx / m }
camera { from = (0, 0, -4) m  to = (0, 0, 0) m  fov = 40 deg }
";

/// The author promises that `soot` may be 0, and 0/0 is no coefficient.
const BROKEN: &str = "param soot = 1 in 0 .. 2
medium smoke {
    shape = sphere(center: (0, 0, 0) m, radius: 1 m)
    k_a = soot / soot * 2 /m
    k_e = 1 lx / m
}
camera { from = (0, 0, -4) m  to = (0, 0, 0) m  fov = 40 deg }
";

fn cases<'v>(document: &'v Value, engine: &str) -> Vec<&'v Value> {
    let cases = document["scenes"][0]["cases"].as_array().expect("cases");
    cases.iter().filter(|c| c["engine"] == engine).collect()
}

#[test]
fn a_sound_scene_passes_every_case() {
    let place = Place::new().with("s.vol", SOUND);
    let run = place.vol(&["stress", "s.vol", "--format", "json", "--engine", "cpu"]).done();
    let document = run.json("vol.stress");
    let head = ["schema", "version", "ok", "passed", "refused", "failed", "left_out", "scenes"];
    assert_eq!(keys(&document), head);
    assert_eq!((&document["ok"], &document["failed"]), (&true.into(), &0.into()));
    assert_eq!(keys(&document["scenes"][0]), ["scene", "spent_s", "cases"]);
    let cases = cases(&document, "cpu");
    let case = ["group", "case", "engine", "backend", "verdict", "reasons", "picture", "milliseconds"];
    assert_eq!(keys(cases[0]), case);
    let picture = [
        "size",
        "least_lx",
        "mean_lx",
        "most_lx",
        "compared",
        "error_lx",
        "reported_lx",
        "apart",
        "reported_over_measured",
    ];
    assert_eq!(keys(&cases[0]["picture"]), picture);
    let found = |name: &str| *cases.iter().find(|c| c["case"] == name).unwrap_or_else(|| panic!("no case `{name}`"));
    // What was done shows in the pictures.
    assert_eq!(found("no pixels: 0 x 0")["verdict"], "refused");
    assert_eq!(found("no matter: all coefficients 0")["picture"]["most_lx"].as_f64(), Some(0.0));
    assert_eq!(found("16384 x 1")["picture"]["size"], serde_json::json!([16384, 1]));
    let brightest = |name: &str| found(name)["picture"]["most_lx"].as_f64().expect("a number");
    // Through the middle k_e/k_a (1 − e^(−2 m k_a)), which is 6 lx without absorption and 3/40 lx with all of it.
    assert!((brightest("`absorption` at 0 m^-1, its least") - 6.0).abs() < 0.05);
    assert!((brightest("`absorption` at 40 m^-1, its most") - 0.075).abs() < 1e-3);
    let (plain, large) = (brightest("as it is"), brightest("everything a million times larger"));
    assert!((plain - large).abs() < 1e-3 * plain, "{plain} {large}");
    assert!(brightest("a white furnace") <= 1.0 + 1e-4);
    for group in ["scene", "params", "lengths", "camera", "coefficients", "furnace", "size"] {
        assert!(cases.iter().any(|c| c["group"] == group), "{group}");
    }
}

#[test]
fn a_sound_scene_passes_on_a_graphics_adapter() {
    let place = Place::new().with("s.vol", SOUND);
    let run = place.vol(&["stress", "s.vol", "--format", "json", "--engine", "gpu", "--backend", "raymarch"]);
    let document = run.json("vol.stress");
    assert_eq!(document["failed"], 0, "{document:#}");
    let cases = cases(&document, "gpu");
    if cases[0]["verdict"] == "left out" {
        assert!(std::env::var("TYNDALL_REQUIRE_GPU").is_err(), "{document:#}");
        eprintln!("skipped: no adapter");
        return;
    }
    assert!(cases.iter().all(|c| c["backend"] == "raymarch" && c["verdict"] != "left out"), "{document:#}");
}

#[test]
fn a_coefficient_that_is_no_number_at_the_end_of_a_range_is_named() {
    let place = Place::new().with("s.vol", BROKEN);
    let run = place.vol(&["stress", "s.vol", "--engine", "cpu", "--budget", "10"]);
    assert_eq!(run.code, 1, "{}{}", run.out, run.err);
    let failed: Vec<&str> = run.out.lines().filter(|l| l.trim_start().starts_with("fail")).collect();
    assert!(failed.iter().all(|l| l.contains("`soot` at 0, its least")) && !failed.is_empty(), "{}", run.out);
    assert!(run.out.contains("E0651") && run.out.contains("`k_a` of medium `smoke`"), "{}", run.out);
}

#[test]
fn a_scene_that_does_not_compile_has_no_trial() {
    let place =
        Place::new().with("s.vol", "medium ball { shape = sphere(center: (0, 0, 0) m, radius: 1)  k_a = 1 /m }\n");
    let run = place.vol(&["stress", "s.vol"]);
    assert!(run.code == 1 && run.err.contains("E0301"), "{}", run.err);
    let run = place.vol(&["stress", "s.vol", "--engine", "reference"]);
    assert!(run.code == 2 && run.err.contains("E0643"), "{}", run.err);
}
