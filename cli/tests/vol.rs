//! The program as people and scripts use it: exit codes, documents and messages.

mod place;

use place::{Place, Run};
use serde_json::Value;
use std::fs;
use std::path::Path;

const BALL: &str = "//! A uniform glowing ball.
param absorption = 2 /m in 0 /m .. 40 /m
medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_a = absorption  k_e = 3 lx / m }
camera { from = (0,0,-4) m  to = (0,0,0) m  fov = 40 deg }
image  { size = 24 x 16 }
";

fn ball() -> Place {
    Place::new().with("ball.vol", BALL)
}

fn near(value: &Value, expected: f64, tolerance: f64) {
    let number = value.as_f64().unwrap_or_else(|| panic!("{value} is no number"));
    assert!((number - expected).abs() <= tolerance, "{number} is not {expected}");
}

// ---- The command line ----

#[test]
fn an_unknown_command_is_told_which_there_are() {
    let run = Place::new().vol(&["frobnicate"]);
    assert_eq!(run.code, 2);
    insta::assert_snapshot!(run.err, @r"
    error: there is no command `frobnicate`
    help: the commands are render, check, emit, probe, report, stress, fmt, explain, doctor, new
    ");
    assert_eq!(run.out, "");
}

#[test]
fn wrong_arguments_exit_with_2_and_name_the_argument() {
    let place = ball();
    for (arguments, said) in [
        (&["render"][..], "<SCENE>"),
        (&["render", "ball.vol"], "--output"),
        (&["render", "ball.vol", "-o", "a.jpg"], "E0649"),
        (&["render", "ball.vol", "-o", "a.png", "--frames", "0..3"], "%04d"),
        (&["render", "ball.vol", "-o", "a.png", "--frames", "3..0"], "both ends"),
        (&["render", "ball.vol", "-o", "a.png", "--size", "0x4"], "640x480"),
        (&["render", "ball.vol", "-o", "a.png", "--accuracy", "-1"], "--accuracy"),
        (&["render", "ball.vol", "-o", "a.png", "--accuracy=0"], "greater than 0"),
        (&["render", "ball.vol", "-o", "a.png", "--depth", "12"], "--depth"),
        (&["render", "ball.vol", "-o", "a.png", "--engine", "abacus"], "reference"),
        (&["probe", "ball.vol"], "E0648"),
        (&["probe", "ball.vol", "--ray", "1,2,3"], "ox,oy,oz"),
        (&["emit", "ball.vol", "--target", "punchcards"], "wgsl"),
        (&["check"], "<SCENES>"),
        (&["explain", "E9999"], "E0645"),
    ] {
        let run = place.vol(arguments);
        assert_eq!(run.code, 2, "{arguments:?}: {}{}", run.out, run.err);
        assert!(run.err.contains(said), "{arguments:?}: {}", run.err);
        assert_eq!(run.out, "", "{arguments:?}");
    }
}

#[test]
fn help_and_version_are_no_errors() {
    let place = Place::new();
    for arguments in [&["--help"][..], &["--version"], &["render", "--help"], &["help", "probe"]] {
        let run = place.vol(arguments).done();
        assert!(run.out.contains("vol") && run.err.is_empty(), "{arguments:?}");
    }
}

// ---- check ----

#[test]
fn check_is_silent_about_a_good_scene() {
    let run = ball().vol(&["check", "ball.vol"]).done();
    assert_eq!((run.out.as_str(), run.err.as_str()), ("", ""));
}

#[test]
fn check_underlines_what_is_wrong() {
    let place =
        Place::new().with("bad.vol", "medium thing { shape = sphere(center: (0,0,0) m, radius: 1)  k_a = 1 /m }\n");
    let run = place.vol(&["check", "bad.vol"]);
    assert_eq!(run.code, 1);
    assert_eq!(run.out, "");
    assert!(run.err.contains("bad.vol:1:") && run.err.contains("1 m") && run.err.contains('^'), "{}", run.err);
    assert!(run.err.ends_with("1 error\n"), "{}", run.err);
    assert!(!run.err.contains('\u{1b}'), "colours in a pipe: {}", run.err);
}

#[test]
fn check_gives_places_as_json() {
    let place = ball().with("bad.vol", "medium thing { shape = sphere(center: (0,0,0) m, radius: 1)  k_a = 1 /m }\n");
    let run = place.vol(&["check", "ball.vol", "bad.vol", "--format", "json"]);
    assert_eq!((run.code, run.err.as_str()), (1, ""));
    let document = run.json("vol.check");
    assert_eq!((&document["ok"], &document["errors"], &document["warnings"]), (&false.into(), &1.into(), &0.into()));
    let files = document["files"].as_array().expect("files");
    assert_eq!((&files[0]["file"], files[0]["diagnostics"].as_array().map(Vec::len)), (&"ball.vol".into(), Some(0)));
    let found = &files[1]["diagnostics"][0];
    let keys: Vec<&str> = found.as_object().expect("an object").keys().map(String::as_str).collect();
    let expected =
        ["code", "severity", "message", "file", "line", "column", "end_line", "end_column", "labels", "notes", "hints"];
    assert_eq!(keys, expected);
    assert_eq!((&found["severity"], &found["file"], &found["line"]), (&"error".into(), &"bad.vol".into(), &1.into()));
    assert_eq!(found["end_column"].as_u64().zip(found["column"].as_u64()).map(|(e, b)| e - b), Some(1), "{found}");
    let labels: Vec<&str> = found["labels"][0].as_object().expect("a label").keys().map(String::as_str).collect();
    assert_eq!(labels, ["file", "line", "column", "end_line", "end_column", "text", "primary"]);
}

#[test]
fn warnings_fail_only_where_they_are_denied() {
    // `1/2 deg` means 1/(2 deg), which draws a warning.
    let place = ball().with("warn.vol", &BALL.replace("fov = 40 deg", "fov = 40 * (1/2 deg)^-1 * 2"));
    let run = place.vol(&["check", "warn.vol", "--format", "json"]);
    let warnings = run.json("vol.check")["warnings"].as_u64().expect("a count");
    if warnings > 0 {
        assert_eq!(run.code, 0);
        assert_eq!(place.vol(&["check", "warn.vol", "--deny", "warnings"]).code, 1);
    }
}

#[test]
fn a_missing_scene_is_the_input_s_fault() {
    let place = Place::new();
    for arguments in [
        &["check", "no.vol"][..],
        &["render", "no.vol", "-o", "a.png"],
        &["emit", "no.vol"],
        &["probe", "no.vol", "--ray", "0,0,0 0,0,1"],
        &["fmt", "no.vol"],
    ] {
        let run = place.vol(arguments);
        assert_eq!(run.code, 1, "{arguments:?}");
        assert!(run.err.contains("E0601") && run.err.contains("`no.vol` does not exist"), "{}", run.err);
    }
}

// ---- render ----

#[test]
fn render_draws_writes_and_measures() {
    let place = ball();
    let run = place.vol(&["render", "ball.vol", "-o", "ball.png", "--format", "json"]).done();
    assert_eq!(run.err, "");
    let document = run.json("vol.render");
    let keys: Vec<&str> = document.as_object().expect("an object").keys().map(String::as_str).collect();
    let expected = [
        "schema",
        "version",
        "ok",
        "engine",
        "adapter",
        "fallback",
        "backend",
        "steps",
        "bands_nm",
        "programs",
        "size",
        "accuracy",
        "compile_ms",
        "build_ms",
        "frames",
        "diagnostics",
    ];
    assert_eq!(keys, expected);
    assert_eq!(document["size"], serde_json::json!([24, 16]));
    let frame = &document["frames"][0];
    assert_eq!(frame["file"], "ball.png");
    let measured = &frame["error"]["measured"];
    assert_eq!(measured["within_accuracy"], true, "{measured}");
    let compared = measured["pixels"].as_u64().zip(measured["straddling"].as_u64()).map(|(a, b)| a + b);
    assert!(compared.is_some_and(|n| n >= 200), "{measured}");
    let picture = runtime::image::read_png(&place.path().join("ball.png")).expect("a PNG");
    assert_eq!((picture.width, picture.height), (24, 16));
    assert_eq!(runtime::image::read_png_scene(&place.path().join("ball.png")).expect("a scene"), BALL);
}

#[test]
fn render_tells_people_what_it_did() {
    let run = ball().vol(&["render", "ball.vol", "-o", "ball.exr", "--engine", "cpu"]).done();
    for line in [
        "engine   cpu",
        "backend  raymarch",
        "ready    compiled in",
        "drawn    24 x 16",
        "measured:",
        "wrote    ball.exr",
    ] {
        assert!(run.out.contains(line), "{line} in {}", run.out);
    }
}

/// Every number that differs from machine to machine as `#`.
fn without_numbers(text: &str) -> String {
    let mut out = String::new();
    for word in text.split_inclusive([' ', '\n', ',']) {
        let bare = word.trim_end_matches([' ', '\n', ',']);
        let is_number = bare.parse::<f64>().is_ok();
        out.push_str(if is_number { "#" } else { bare });
        out.push_str(&word[bare.len()..]);
    }
    out
}

#[test]
fn the_report_of_a_drawing() {
    let run = ball().vol(&["render", "ball.vol", "-o", "ball.png", "--engine", "cpu", "--size", "8x8"]).done();
    insta::assert_snapshot!(without_numbers(&run.out));
}

#[test]
fn the_message_of_a_wrong_set() {
    let run = ball().vol(&["render", "ball.vol", "-o", "a.png", "--engine", "cpu", "--set", "absorption=3 km"]);
    insta::assert_snapshot!(run.err);
    let run = ball().vol(&["render", "ball.vol", "-o", "a.png", "--engine", "cpu", "--set", "absorbtion=3"]);
    insta::assert_snapshot!(run.err);
}

#[test]
fn the_document_of_a_failure() {
    let place = Place::new().with("bad.vol", "medium thing { k_a = 1 }\n");
    let run = place.vol(&["render", "bad.vol", "-o", "a.png", "--format", "json"]);
    assert_eq!((run.code, run.err.as_str()), (1, ""));
    insta::assert_snapshot!(run.out);
}

#[test]
fn the_starter_scene_and_its_message() {
    let run = Place::new().vol(&["new", "cloud"]).done();
    insta::assert_snapshot!(run.out);
}

#[test]
fn parameters_size_and_frames_of_the_command_line_count() {
    let place = ball();
    let run = place
        .vol(&[
            "render",
            "ball.vol",
            "-o",
            "f%03d.npy",
            "--frames",
            "2..4",
            "--size",
            "5x7",
            "--engine",
            "cpu",
            "--set",
            "absorption=3",
            "--set",
            "absorption=40 /m",
            "--no-check",
            "--format",
            "json",
        ])
        .done();
    let document = run.json("vol.render");
    let frames = document["frames"].as_array().expect("frames");
    let files: Vec<&str> = frames.iter().filter_map(|f| f["file"].as_str()).collect();
    assert_eq!(files, ["f002.npy", "f003.npy", "f004.npy"]);
    assert_eq!(frames[0]["error"]["measured"], Value::Null);
    near(&frames[0]["time"], 2.0 / 24.0, 1e-12);
    for file in files {
        let bytes = fs::read(place.path().join(file)).expect("written");
        let data: Vec<f32> =
            bytes[bytes.len() - 5 * 7 * 3 * 4..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        // The middle of the picture: k_e / k_a, since the ball is opaque now.
        let middle = data[(3 * 5 + 2) * 3];
        assert!((middle - 3.0 / 40.0).abs() < 1e-2, "{middle}");
    }
}

#[test]
fn sets_that_do_not_fit_are_the_command_line_s_fault() {
    let place = ball();
    for (set, code, said) in [
        ("density=3", "E0640", "`absorption`"),
        ("absorption", "E0641", "name=value"),
        ("absorption=3 km", "E0641", "dimension"),
        ("absorption=#fff", "E0641", "colour"),
        ("absorption=3 furlong", "E0641", "furlong"),
        ("absorption=inf", "E0641", "finite"),
    ] {
        let run = place.vol(&["render", "ball.vol", "-o", "a.png", "--engine", "cpu", "--set", set]);
        assert_eq!(run.code, 2, "{set}: {}", run.err);
        assert!(run.err.contains(code) && run.err.contains(said), "{set}: {}", run.err);
    }
    let run = place.vol(&["render", "ball.vol", "-o", "a.png", "--engine", "cpu", "--set", "absorption=41"]).done();
    assert!(run.err.contains("W0640") && run.err.contains("40 m^-1"), "{}", run.err);
}

#[test]
fn a_scene_comes_from_standard_input() {
    let place = Place::new();
    place.piped(&["render", "-", "-o", "a.png", "--engine", "cpu", "--no-check"], BALL).done();
    assert!(place.path().join("a.png").exists());
    let run = place.piped(&["check", "-", "--format", "json"], "medium {");
    assert_eq!(run.code, 1);
    assert_eq!(run.json("vol.check")["files"][0]["diagnostics"][0]["file"], "-");
}

#[test]
fn a_picture_that_cannot_be_written_is_an_error() {
    let run = ball().vol(&["render", "ball.vol", "-o", "no/such/folder/a.png", "--engine", "cpu", "--no-check"]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("E0620"), "{}", run.err);
}

#[test]
fn faults_at_run_time_are_reported_on_every_engine() {
    let scene = BALL.replace("k_a = absorption", "k_a = absorption * (p.x / 1 m)");
    let place = Place::new().with("a.vol", &scene);
    for engine in ["cpu", "gpu"] {
        let run = place.vol(&["render", "a.vol", "-o", "a.png", "--engine", engine]);
        if no_adapter(&run) {
            continue;
        }
        assert_eq!(run.code, 1, "{engine}: {}{}", run.out, run.err);
        assert!(run.err.contains("E0650") && run.err.contains("k_a") && run.err.contains("ball"), "{}", run.err);
    }
}

#[test]
fn params_that_make_energy_are_refused_on_every_engine() {
    let scene = "
param share = 0.5
param glow = 1 lx / m
medium ball { shape = sphere(center: (0, 1, 0) m, radius: 1 m)  k_t = 1 /m  albedo = share  k_e = glow }
surface floor { shape = plane(point: (0, -1, 0) m, normal: (0, 1, 0))  albedo = 0.5 * share }
surface spotted { shape = sphere(center: (3, 1, 0) m, radius: 1 m)  albedo = share * (0.2 + 0.2 * sin(p.x / 0.1 m)) }
light sun { direction = (0, -1, 0)  irradiance = 1 lx }
camera { from = (0, 2, -9) m  to = (1, 1, 0) m }
image { size = 16 x 16 }
";
    for engine in ["cpu", "gpu"] {
        for scattering in ["single", "multiple"] {
            let place =
                Place::new().with("a.vol", &format!("{scene}render {{ scattering = {scattering}  samples = 32 }}"));
            // k_a is (1 − albedo)·k_t.
            for (set, code, what, whose) in [
                ("share=1.5", "E0650", "k_a", "ball"),
                ("share=-0.5", "E0650", "k_s", "ball"),
                ("glow=-1", "E0650", "k_e", "ball"),
            ] {
                let arguments = ["render", "a.vol", "-o", "a.png", "--engine", engine, "--no-check", "--set", set];
                let run = place.vol(&arguments);
                if no_adapter(&run) {
                    continue;
                }
                assert_eq!(run.code, 1, "{engine} {scattering} {set}: {}{}", run.out, run.err);
                for word in [code, what, whose] {
                    assert!(run.err.contains(word), "{engine} {scattering} {set}: {word}: {}", run.err);
                }
            }
            let place = place.with("b.vol", &scene.replace("albedo = share  k_e", "albedo = 0.5  k_e"));
            let arguments = ["render", "b.vol", "-o", "b.png", "--engine", engine, "--no-check"];
            let fine = place.vol(&arguments);
            if no_adapter(&fine) {
                continue;
            }
            assert_eq!(fine.code, 0, "{}", fine.err);
            let run = place.vol(&[&arguments[..], &["--set", "share=2.1"]].concat());
            assert_eq!(run.code, 1, "{engine} {scattering}: {}{}", run.out, run.err);
            for word in ["E0657", "albedo", "floor"] {
                assert!(run.err.contains(word), "{engine} {scattering}: {word}: {}", run.err);
            }
        }
    }
    // What differs from place to place is found where the reference looks.
    let scene = scene.replace("albedo = share  k_e", "albedo = 0.5  k_e").replace("0.5 * share", "0.5");
    let place = Place::new().with("a.vol", &scene);
    let run = place.vol(&["render", "a.vol", "-o", "a.png", "--engine", "cpu", "--set", "share=4"]);
    assert_eq!(run.code, 1, "{}{}", run.out, run.err);
    assert!(run.err.contains("E0657") && run.err.contains("spotted") && run.err.contains(" m"), "{}", run.err);
}

// ---- probe ----

/// Whether a run failed for want of an adapter; that is allowed unless one is required.
fn no_adapter(run: &Run) -> bool {
    let missing = run.code == 3 && run.err.contains("E0630") | run.out.contains("E0630");
    if missing {
        assert!(
            std::env::var("TYNDALL_REQUIRE_GPU").is_ok_and(|v| v != "1")
                || std::env::var("TYNDALL_REQUIRE_GPU").is_err()
        );
        eprintln!("skipped: no adapter");
    }
    missing
}

#[test]
fn probes_agree_with_the_closed_form() {
    let place = ball();
    // Through the middle, off the axis, from inside, and past the ball.
    let rays = ["0,0,-4 0,0,1", "0.6,0,-4 0,0,2", "-0.25 0 0 -1 0 0", "0,2,-4 0,0,1"];
    let lengths = [2.0, 1.6, 0.75, 0.0];
    for (engine, tolerance) in [("reference", 1e-9), ("cpu", 1e-2), ("gpu", 1e-4)] {
        let mut arguments = vec!["probe", "ball.vol", "--engine", engine, "--format", "json"];
        rays.iter().for_each(|ray| arguments.extend(["--ray", ray]));
        let run = place.vol(&arguments);
        if no_adapter(&run) {
            continue;
        }
        let document = run.done().json("vol.probe");
        assert_eq!(document["engine"], engine);
        assert_eq!(document["bands_nm"], serde_json::json!([680.0, 550.0, 440.0]));
        for (answer, length) in document["rays"].as_array().expect("rays").iter().zip(lengths) {
            let tau = 2.0 * length;
            for band in 0..3 {
                near(&answer["optical_depth"][band], tau, tolerance * f64::max(tau, 1e-6));
                near(&answer["transmittance"][band], f64::exp(-tau), tolerance);
                near(&answer["radiance"][band], 1.5 * -f64::exp_m1(-tau), tolerance * 1.5);
                assert!(answer["error"][band].is_number());
            }
            assert!(["bound", "estimate"].contains(&answer["error_kind"].as_str().unwrap_or_default()));
            assert!(answer["evaluations"].is_u64());
        }
        let ray = &document["rays"][1];
        assert_eq!(
            (&ray["origin"], &ray["direction"]),
            (&serde_json::json!([0.6, 0.0, -4.0]), &serde_json::json!([0.0, 0.0, 2.0]))
        );
    }
}

#[test]
fn rays_come_from_a_file_too() {
    let place = ball().with("rays.csv", "ox,oy,oz,dx,dy,dz\n# the middle\n0,0,-4,0,0,1\n\n0,2,-4,0,0,1 # past it\n");
    let run = place.vol(&["probe", "ball.vol", "--engine", "cpu", "--rays", "rays.csv", "--format", "json"]).done();
    assert_eq!(run.json("vol.probe")["rays"].as_array().map(Vec::len), Some(2));
    let place = place.with("bad.csv", "0,0,-4,0,0,1\n1,2,3\n");
    let run = place.vol(&["probe", "ball.vol", "--engine", "cpu", "--rays", "bad.csv"]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("line 2 of `bad.csv`"), "{}", run.err);
    let run = place.vol(&["probe", "ball.vol", "--engine", "cpu", "--ray", "0,0,0 0,0,0"]);
    assert_eq!(run.code, 2, "a ray without direction: {}", run.err);
}

#[test]
fn an_infinite_depth_is_a_string() {
    let place = Place::new().with(
        "fog.vol",
        "medium fog_everywhere { k_a = 1 /m  k_e = 2 lx/m }\ncamera { from = (0,0,0) m to = (0,0,1) m }\n",
    );
    let run =
        place.vol(&["probe", "fog.vol", "--engine", "reference", "--ray", "0,0,0 0,0,1", "--format", "json"]).done();
    let document = run.json("vol.probe");
    assert_eq!(document["rays"][0]["optical_depth"][0], "inf");
    near(&document["rays"][0]["radiance"][0], 2.0, 1e-9);
}

// ---- emit ----

#[test]
fn emit_writes_every_target() {
    let place = ball();
    for (target, has) in [
        ("wgsl", "@compute"),
        ("glsl", "#version"),
        ("hlsl", "numthreads"),
        ("msl", "kernel"),
        ("naga", "EntryPoint"),
        ("ir", "ball"),
        ("graph", "digraph"),
        ("plan", "raymarch"),
    ] {
        let run = place.vol(&["emit", "ball.vol", "--target", target]).done();
        assert!(run.out.contains(has), "{target}: {}", run.out);
        let document = place.vol(&["emit", "ball.vol", "--target", target, "--format", "json"]).done().json("vol.emit");
        assert_eq!(document["text"], run.out, "{target}");
    }
    place.vol(&["emit", "ball.vol", "--target", "spirv", "-o", "ball.spv"]).done();
    let words = fs::read(place.path().join("ball.spv")).expect("written");
    assert_eq!(words[..4], 0x0723_0203_u32.to_le_bytes());
}

const SPECTRAL: &str = "medium air { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_a = 1 /m * (550 nm / lambda)^4 }
image { size = 16 x 16  bands = spectral(8) }
";

#[test]
fn many_bands_are_several_programs_under_headings() {
    let place = Place::new().with("air.vol", SPECTRAL);
    let bands = ["405 nm, 455 nm, 505 nm, 555 nm", "605 nm, 655 nm, 705 nm, 755 nm"];
    for target in ["wgsl", "glsl", "hlsl", "msl", "naga", "ir", "graph", "plan"] {
        let run = place.vol(&["emit", "air.vol", "--target", target]).done();
        for (i, bands) in bands.iter().enumerate() {
            let heading = format!("// program {} of 2: {bands}\n", i + 1);
            assert_eq!(run.out.matches(&heading).count(), 1, "{target}: {}", run.out);
        }
        let document = place.vol(&["emit", "air.vol", "--target", target, "--format", "json"]).done().json("vol.emit");
        assert_eq!(document["text"], Value::Null, "{target}");
        let programs = document["programs"].as_array().expect("programs");
        assert_eq!(programs.len(), 2);
        assert_eq!(programs[1]["bands_nm"], serde_json::json!([605.0, 655.0, 705.0, 755.0]));
        assert!(programs.iter().all(|p| run.out.contains(p["text"].as_str().expect("a text"))), "{target}");
    }
    place.vol(&["emit", "air.vol", "-o", "air.wgsl", "--map"]).done();
    for (i, nm) in [("1", "405"), ("2", "755")] {
        let read = |name: String| fs::read_to_string(place.path().join(name)).expect("written");
        let map: Value = serde_json::from_str(&read(format!("air.{i}.wgsl.map.json"))).expect("JSON");
        assert!(map["lines"].as_array().is_some_and(|l| !l.is_empty()), "{nm}");
        assert!(read(format!("air.{i}.wgsl")).contains("@compute"));
    }
    assert!(!place.path().join("air.wgsl").exists());
    let run = place.vol(&["emit", "air.vol", "--explain"]).done();
    assert_eq!(run.out.matches("loop over lights").count(), 1, "{}", run.out);
    assert_eq!(place.vol(&["emit", "air.vol", "--target", "spirv"]).code, 2);
}

#[test]
fn many_bands_are_probed_and_drawn() {
    let place = Place::new().with("air.vol", SPECTRAL);
    let expected: Vec<f64> = (0..8).map(|i| 405.0 + 50.0 * f64::from(i)).collect();
    for (engine, tolerance) in [("reference", 1e-9), ("cpu", 1e-2), ("gpu", 1e-4)] {
        let arguments = ["probe", "air.vol", "--ray", "0,0,-4 0,0,1", "--engine", engine, "--format", "json"];
        let run = place.vol(&arguments);
        if no_adapter(&run) {
            continue;
        }
        let document = run.done().json("vol.probe");
        let answer = &document["rays"][0];
        for (i, nm) in expected.iter().enumerate() {
            near(&document["bands_nm"][i], *nm, 1e-9);
            near(&answer["transmittance"][i], f64::exp(-2.0 * (550.0 / nm).powi(4)), tolerance);
            assert!(answer["error"][i].is_number());
        }
        for key in ["radiance", "transmittance", "optical_depth", "error"] {
            assert_eq!(answer[key].as_array().map(Vec::len), Some(8), "{key}");
        }
        for name in ["air.exr", "air.npy", "air.png"] {
            let run = place.vol(&["render", "air.vol", "-o", name, "--engine", engine, "--format", "json"]).done();
            let document = run.json("vol.render");
            assert_eq!(document["programs"], 2);
            assert_eq!(document["bands_nm"].as_array().map(Vec::len), Some(8));
            let measured = &document["frames"][0]["error"]["measured"];
            assert!(engine == "reference" || measured["within_accuracy"] == true, "{document}");
        }
        let exr = fs::read(place.path().join("air.exr")).expect("written");
        for channel in ["405nm\0", "755nm\0", "T.405nm\0", "T.755nm\0"] {
            assert!(exr.windows(channel.len()).any(|w| w == channel.as_bytes()), "{channel:?}");
        }
        let npy = fs::read(place.path().join("air.npy")).expect("written");
        assert!(String::from_utf8_lossy(&npy[..128]).contains("16, 16, 8"));
    }
    let run = place.vol(&["render", "air.vol", "-o", "air.png", "--engine", "cpu", "--no-check"]).done();
    assert!(run.out.contains("bands    8 in 2 programs, drawn one after another"), "{}", run.out);
}

#[test]
fn emit_maps_and_explains() {
    let place = ball();
    place.vol(&["emit", "ball.vol", "-o", "ball.wgsl", "--map"]).done();
    let map: Value =
        serde_json::from_slice(&fs::read(place.path().join("ball.wgsl.map.json")).expect("written")).expect("JSON");
    assert_eq!(map["schema"], "vol.map");
    let text = fs::read_to_string(place.path().join("ball.wgsl")).expect("written");
    for line in map["lines"].as_array().expect("lines") {
        let generated = line["generated"].as_u64().expect("a line") as usize;
        let name = line["name"].as_str().expect("a name");
        assert!(text.lines().nth(generated - 1).is_some_and(|l| l.contains(name)), "{line}");
        let at = line["start"].as_u64().expect("a place") as usize..line["end"].as_u64().expect("a place") as usize;
        assert!(line["file"] != "ball.vol" || BALL.get(at).is_some(), "{line}");
    }
    let document = place.vol(&["emit", "ball.vol", "--explain", "--format", "json"]).done().json("vol.emit");
    let omissions = document["omissions"].as_array().expect("omissions");
    assert!(omissions.iter().any(|o| o["feature"].as_str().is_some_and(|f| f.contains("loop"))), "{document}");
    let run = place.vol(&["emit", "ball.vol", "--explain"]).done();
    assert!(run.out.contains("loop"), "{}", run.out);
}

// ---- fmt ----

#[test]
fn fmt_writes_only_what_changes() {
    let place = Place::new().with("a.vol", "medium   thing{k_a=1 /m}\n");
    let run = place.vol(&["fmt", "a.vol", "--check"]);
    assert_eq!((run.code, run.out.as_str()), (1, "a.vol\n"));
    assert_eq!(fs::read_to_string(place.path().join("a.vol")).expect("there"), "medium   thing{k_a=1 /m}\n");
    place.vol(&["fmt", "a.vol"]).done();
    let formatted = fs::read_to_string(place.path().join("a.vol")).expect("there");
    assert_ne!(formatted, "medium   thing{k_a=1 /m}\n");
    let run = place.vol(&["fmt", "a.vol", "--check"]).done();
    assert_eq!(run.out, "");
    let run = place.piped(&["fmt", "-"], "medium   thing{k_a=1 /m}\n").done();
    assert_eq!(run.out, formatted);
    assert_eq!(place.piped(&["fmt", "-"], &formatted).done().out, formatted);
    let broken = place.with("b.vol", "medium {{{");
    assert_eq!(broken.vol(&["fmt", "b.vol"]).code, 1);
}

/// What people read first is in the one format.
#[test]
fn every_scene_that_is_shipped_is_formatted() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("cli/ lies in the project");
    let mut scenes = vec![];
    for folder in ["library", "examples", "cli/src/commands"] {
        let entries = fs::read_dir(root.join(folder)).expect("the folder is there");
        let paths = entries.map(|e| e.expect("a folder can be listed").path());
        let found: Vec<_> = paths.filter(|p| p.extension().is_some_and(|e| e == "vol")).collect();
        assert!(!found.is_empty(), "no scene in {folder}");
        scenes.extend(found.iter().map(|p| p.to_str().expect("UTF-8").to_owned()));
    }
    let arguments: Vec<&str> = ["fmt", "--check"].into_iter().chain(scenes.iter().map(String::as_str)).collect();
    let run = Place::new().vol(&arguments).done();
    assert_eq!(run.out, "");
}

// ---- explain, doctor, new ----

#[test]
fn explain_knows_the_codes_that_check_prints() {
    let place = Place::new();
    let run = place.vol(&["explain", "e0601"]).done();
    assert!(run.out.starts_with("E0601: "), "{}", run.out);
    let list = place.vol(&["explain", "--format", "json"]).done().json("vol.explain");
    let codes: Vec<&str> = list["codes"].as_array().expect("codes").iter().filter_map(|c| c["code"].as_str()).collect();
    assert!(codes.contains(&"E0640") && codes.contains(&"E0601"));
    let mut unique = codes.clone();
    unique.sort_unstable();
    unique.dedup();
    assert_eq!(unique.len(), codes.len(), "a code is registered twice");
}

#[test]
fn doctor_reports_the_machine() {
    let place = Place::new();
    let document = place.vol(&["doctor", "--format", "json"]).done().json("vol.doctor");
    assert!(document["cores"].as_u64().is_some_and(|n| n > 0));
    let missing = document["missing"].as_array().expect("a list");
    let adapters = document["adapters"].as_array().expect("a list");
    let complains = missing.iter().any(|m| m["what"].as_str().is_some_and(|w| w.contains("adapter")));
    assert_eq!(adapters.is_empty(), complains);
    place.vol(&["doctor"]).done();
}

#[test]
fn new_makes_a_scene_that_renders_and_overwrites_nothing() {
    let place = Place::new();
    let run = place.vol(&["new", "cloud"]).done();
    assert!(run.out.contains("vol render cloud/scene.vol"), "{}", run.out);
    place.vol(&["check", "cloud/scene.vol", "--deny", "warnings"]).done();
    place.vol(&["fmt", "cloud/scene.vol", "--check"]).done();
    place.vol(&["render", "cloud/scene.vol", "-o", "a.png", "--engine", "cpu", "--size", "12x9", "--no-check"]).done();
    fs::write(place.path().join("cloud/scene.vol"), "mine").expect("written");
    let run = place.vol(&["new", "cloud"]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("E0646"), "{}", run.err);
    assert_eq!(fs::read_to_string(place.path().join("cloud/scene.vol")).expect("there"), "mine");
}

#[test]
fn an_adapter_that_is_not_there_is_the_machine_s_fault() {
    let run = ball().vol(&["render", "ball.vol", "-o", "a.png", "--engine", "gpu", "--adapter", "no such adapter"]);
    assert_eq!(run.code, 3, "{}{}", run.out, run.err);
    assert!(run.err.contains("E0630"), "{}", run.err);
}
