//! `vol report` as people and scripts use it.

mod place;

use place::{Place, keys};
use serde_json::Value;
use std::fs;

/// Neither symmetric nor vanishing at the ends of a ray, where the midpoint rule would be too good; no edge in the picture.
const SMOOTH: &str = "medium gas {
    shape = box(min: (-9, -9, 0) m, max: (9, 9, 2) m)
    k_a = 2 /m * exp(-p.z / 0.7 m)
    k_e = 3 lx / m * (1 + sin(2 * p.z / 1 m)) * exp(-p.x / 3 m)
}
camera { from = (0.3, 0.2, -4) m  to = (0, 0, 0) m  fov = 30 deg }
image { size = 8 x 6 }
";

/// Light that is scattered again and again.
const SCATTERING: &str = "medium milk {
    shape = sphere(center: (0, 0, 0) m, radius: 1 m)
    k_s = 3 /m
    k_a = 0.3 /m
}
light sun { direction = (1, -1, 0.5)  irradiance = 5 lx }
camera { from = (0, 0, -4) m  to = (0, 0, 0) m  fov = 22 deg }
image { size = 6 x 4 }
render { scattering = multiple  samples = 64 }
";

fn report(scene: &str, more: &[&str]) -> (Place, Value) {
    let place = Place::new().with("s.vol", scene);
    let mut arguments = vec!["report", "s.vol", "-o", "out", "--format", "json"];
    arguments.extend(more);
    let document = place.vol(&arguments).done().json("vol.report");
    (place, document)
}

fn series<'v>(document: &'v Value, engine: &str, quantity: &str) -> Option<&'v Value> {
    let all = document["series"].as_array().expect("series");
    all.iter().find(|s| s["engine"] == engine && s["quantity"] == quantity)
}

#[test]
fn the_document_has_these_keys() {
    let (place, document) = report(SMOOTH, &["--engine", "cpu", "--budget", "2"]);
    let head =
        ["schema", "version", "ok", "scene", "size", "accuracy", "white_lx", "budget_s", "spent_s", "edge_pixels"];
    assert_eq!(keys(&document), [&head[..], &["reference", "series", "left_out", "diagnostics"]].concat());
    let reference =
        ["kind", "pixels", "of", "samples", "rtol", "max_error_lx", "rms_error_lx", "evaluations", "draw_ms"];
    assert_eq!(keys(&document["reference"]), reference);
    let cpu = series(&document, "cpu", "steps").expect("steps on the processor");
    assert_eq!(keys(cpu), ["engine", "adapter", "backend", "quantity", "slope", "theory", "rows"]);
    assert_eq!(keys(&cpu["slope"]), ["measured", "r2", "rows"]);
    assert_eq!(keys(&cpu["theory"]), ["slope", "reason"]);
    let row = &cpu["rows"][0];
    let costs = ["value", "chosen", "pareto", "steps", "compile_ms", "build_ms", "draw_ms", "draws", "clock"];
    let found = ["evaluations", "paths", "error", "edges", "predicted", "faults"];
    assert_eq!(keys(row), [&costs[..], &found].concat());
    assert_eq!(keys(&row["error"]), ["pixels", "max_lx", "rms_lx", "mean_lx", "share", "flip"]);
    assert_eq!(keys(&row["edges"]), ["pixels", "max_lx"]);
    let predicted = series(&document, "cpu", "accuracy").map(|s| &s["rows"][0]["predicted"]).expect("a prediction");
    assert_eq!(keys(predicted), ["kind", "max_lx", "share", "origins", "pixels_beyond", "held", "median_ratio"]);
    assert_eq!(keys(&predicted["origins"]), ["discretisation", "rounding", "storage", "statistical"]);
    // What is printed is what is written.
    let written = fs::read_to_string(place.path().join("out/report.json")).expect("written");
    assert_eq!(serde_json::from_str::<Value>(&written).expect("JSON"), document);
}

#[test]
fn the_table_has_a_line_for_each_picture() {
    let (place, document) = report(SMOOTH, &["--engine", "cpu", "--budget", "2"]);
    let table = fs::read_to_string(place.path().join("out/report.csv")).expect("written");
    let mut lines = table.lines();
    assert_eq!(
        lines.next(),
        Some(
            "engine,adapter,backend,quantity,value,chosen,pareto,compile_ms,build_ms,draw_ms,clock,evaluations,paths,pixels,\
             max_lx,rms_lx,mean_lx,share,flip,edge_pixels,edge_max_lx,predicted_kind,predicted_max_lx,predicted_share,\
             pixels_beyond,held,discretisation_lx,rounding_lx,storage_lx,statistical_lx"
        )
    );
    let lines: Vec<Vec<&str>> = lines.map(|l| l.split(',').collect()).collect();
    let rows: Vec<&Value> = document["series"]
        .as_array()
        .expect("series")
        .iter()
        .flat_map(|s| s["rows"].as_array().expect("rows"))
        .collect();
    assert_eq!(lines.len(), rows.len());
    for (line, row) in lines.iter().zip(rows) {
        assert_eq!((line.len(), line[0]), (30, "cpu"));
        let (written, expected) =
            (line[15].parse::<f64>().expect("a number"), row["error"]["rms_lx"].as_f64().expect("a number"));
        assert!((written - expected).abs() <= 1e-14 * expected, "{line:?}");
    }
}

#[test]
fn the_page_needs_no_network_and_shows_everything() {
    let (place, _) = report(SMOOTH, &["--budget", "8"]);
    let page = fs::read_to_string(place.path().join("out/report.html")).expect("written");
    for there in [
        "<svg",
        "rms error / lx",
        "time to draw / ms",
        "steps along a ray",
        "data:image/png;base64,",
        "prefers-color-scheme",
    ] {
        assert!(page.contains(there), "{there}");
    }
    for outside in ["http:", "https:", "<script", "<link", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
}

/// What the ray marcher cannot draw.
const SPLATS: &str = "splats tree { file = \"splats.ply\" }
camera { from = (0, 0, -4) m  to = (0, 0, 0) m  fov = 30 deg }
image { size = 8 x 6 }
";
/// Two Gaussians of degree 0, as 3D Gaussian splatting writes them (Kerbl et al. 2023).
const PLY: &str = "ply
format ascii 1.0
element vertex 2
property float x
property float y
property float z
property float f_dc_0
property float f_dc_1
property float f_dc_2
property float opacity
property float scale_0
property float scale_1
property float scale_2
property float rot_0
property float rot_1
property float rot_2
property float rot_3
end_header
0 0 0 1 0 0 1 -1 -1 -1 1 0 0 0
0.3 0.2 0.5 0 1 0 2 -2 -1 -2 1 0 0 0
";

#[test]
fn several_scenes_have_a_folder_each_and_an_index() {
    let place = Place::new().with("a.vol", SMOOTH).with("splats.vol", SPLATS).with("splats.ply", PLY);
    let place = place.with("broken.vol", "medium {");
    let run = place.vol(&["report", "a.vol", "splats.vol", "broken.vol", "a.vol", "-o", "out", "--budget", "2"]);
    // What one lacks does not keep the others from being drawn, and is said.
    assert_eq!(run.code, 1, "{}", run.err);
    assert!(run.err.contains("broken.vol"), "{}", run.err);
    let index = fs::read_to_string(place.path().join("out/README.md")).expect("an index");
    for there in ["## a\n", "## splats\n", "## a-2\n", "(a/report.svg)", "(a/report.html)", "| cpu |", "for about 2 s"]
    {
        assert!(index.contains(there), "{there}: {index}");
    }
    assert!(!index.contains("## broken"), "{index}");
    let own = place.path().display().to_string();
    for name in ["a", "splats", "a-2"] {
        for file in ["report.html", "report.json", "report.csv", "report.svg"] {
            let text = fs::read_to_string(place.path().join("out").join(name).join(file)).expect("written");
            assert!(!text.is_empty() && !text.contains(&own), "{name}/{file} names a place of this machine");
        }
    }
    // A plot of its own stands alone.
    let plot = fs::read_to_string(place.path().join("out/a/report.svg")).expect("a plot");
    for there in ["<svg xmlns=\"http://www.w3.org/2000/svg\"", "<style>", "--paper", "cpu, ", "rms error / lx"] {
        assert!(plot.contains(there), "{there}");
    }
    for outside in ["<script", "<link", "@import", "url(", "https:"] {
        assert!(!plot.contains(outside), "{outside}");
    }
}

#[test]
fn what_a_schedule_cannot_be_drawn_by_is_said_once() {
    let endless = "medium air { k_s = 0.02 /km * exp(-p.y / 1 km) }
light sun { direction = (0, -1, 1)  irradiance = 20 lx }
camera { from = (0, 2, 0) m  to = (0, 200, 1000) m  fov = 30 deg }
image { size = 4 x 4 }
render { scattering = single }
";
    let (_, document) = report(endless, &["--engine", "cpu", "--budget", "4"]);
    let left_out = document["left_out"].as_array().expect("a list");
    let steps: Vec<&Value> = left_out.iter().filter(|o| o["quantity"] == "steps").collect();
    let reason = |o: &&&Value| o["reason"].as_str().is_some_and(|r| r.contains("E0652"));
    let refused: Vec<_> = steps.iter().filter(reason).collect();
    assert!(refused.len() == 1 && refused[0]["values"].as_array().is_some_and(|v| v.len() > 3), "{document:#}");
}

#[test]
fn the_midpoint_rule_has_the_slope_of_theory_on_every_engine() {
    let (_, document) = report(SMOOTH, &["--budget", "6"]);
    let mut seen = 0;
    for engine in ["cpu", "gpu"] {
        let Some(series) = series(&document, engine, "steps") else { continue };
        let (measured, theory) = (&series["slope"]["measured"], &series["theory"]["slope"]);
        assert_eq!(theory.as_f64(), Some(-2.0));
        let measured = measured.as_f64().expect("a slope");
        assert!((measured + 2.0).abs() < 0.1, "{engine}: slope {measured}");
        seen += 1;
    }
    assert!(seen >= 1, "{document:#}");
    // And the scene's own schedule is among the pictures, once for each way to draw.
    let all = document["series"].as_array().expect("series");
    let mut ways: Vec<String> = all.iter().map(|s| format!("{} {}", s["engine"], s["backend"])).collect();
    ways.dedup();
    let rows = all.iter().flat_map(|s| s["rows"].as_array().expect("rows"));
    let chosen = rows.filter(|r| r["chosen"] == true).inspect(|r| {
        let share = r["error"]["share"].as_f64().expect("a share");
        assert!(share <= 1.0, "{r:#}");
    });
    assert_eq!(chosen.count(), ways.len(), "{ways:?}");
}

#[test]
fn random_paths_have_the_slope_of_a_mean() {
    let (_, document) = report(SCATTERING, &["--engine", "cpu", "--budget", "4"]);
    assert_eq!(document["reference"]["kind"], "standard-error");
    let series = series(&document, "cpu", "samples").expect("samples");
    let measured = series["slope"]["measured"].as_f64().expect("a slope");
    assert_eq!(series["theory"]["slope"].as_f64(), Some(-0.5));
    assert!((measured + 0.5).abs() < 0.15, "slope {measured}: {series:#}");
    for row in series["rows"].as_array().expect("rows") {
        // Predicted and measured agree: the largest of 72 standard errors, and the largest deviation.
        let (said, found) = (&row["predicted"]["max_lx"], &row["error"]["max_lx"]);
        let ratio = found.as_f64().expect("a number") / said.as_f64().expect("a number");
        assert!((0.2..8.0).contains(&ratio), "{row:#}");
    }
}

#[test]
fn what_the_budget_leaves_out_is_said() {
    let (_, document) = report(SMOOTH, &["--size", "160x120", "--budget", "0.2"]);
    let left_out = document["left_out"].as_array().expect("a list");
    assert!(!left_out.is_empty());
    for omitted in left_out {
        assert_eq!(keys(omitted), ["engine", "backend", "quantity", "values", "reason"]);
        assert!(omitted["reason"].as_str().is_some_and(|r| r.contains("the budget")), "{omitted}");
    }
}

#[test]
fn wrong_arguments_are_refused_before_anything_is_drawn() {
    let place = Place::new().with("s.vol", SMOOTH).with("file", "");
    let run = place.vol(&["report", "s.vol", "-o", "out", "--engine", "reference"]);
    assert!(run.code == 2 && run.err.contains("E0643"), "{}", run.err);
    let run = place.vol(&["report", "s.vol", "-o", "file"]);
    assert!(run.code == 1 && run.err.contains("E0642"), "{}", run.err);
    let run = place.vol(&["report", "s.vol", "-o", "out", "--set", "nothing=1"]);
    assert!(run.code == 2 && run.err.contains("E0640"), "{}", run.err);
    assert_eq!(place.vol(&["report", "s.vol"]).code, 2);
}
