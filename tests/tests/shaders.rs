//! The shaders of every example: valid in every target, and without a trace of what the scene does not need.

use compiler::backends::REGISTRY;
use compiler::emit::{Shader, emit};
use compiler::ir::Backend;
use compiler::program::{Program, print_forecasts, print_ledger, print_plan};
use compiler::{Compilation, Options, compile};
use runtime::frame::FileLoader;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use tyndall_tests::{codes, files, name, root, text};

fn compiled(path: &Path, options: &Options) -> Compilation {
    compile(name(path), &text(path), &FileLoader::new(path.parent().expect("a folder")), options)
}

/// Examples and test scenes, those without a closed form too.
fn scenes() -> Vec<PathBuf> {
    ["examples", "tests/suite", "tests/suite/light", "tests/suite/agree"]
        .into_iter()
        .flat_map(|folder| files(folder, "vol"))
        .collect()
}

fn program(out: &Compilation) -> &Program {
    out.program.as_ref().unwrap_or_else(|| panic!("{}", compiler::diagnostic::render(&out.diagnostics, &out.sources)))
}

fn shaders(out: &Compilation) -> Vec<Shader> {
    program(out).kernels.iter().map(|k| emit(k).unwrap_or_else(|e| panic!("{e}"))).collect()
}

fn scene(text: &str) -> Compilation {
    let out = compile("scene.vol", text, &FileLoader::new(root().join("examples")), &Options::default());
    program(&out);
    out
}

fn code(out: &Compilation) -> String {
    shaders(out).iter().map(|s| s.wgsl().expect("WGSL")).collect()
}

fn wgsl(text: &str) -> String {
    code(&scene(text))
}

#[test]
fn every_example_is_valid_in_every_target_of_every_backend() {
    let mut drawn = [0; 3];
    for path in scenes() {
        let sources = [Options::default(), Options::probe()];
        let all = REGISTRY.iter().enumerate().flat_map(|b| sources.iter().map(move |s| (b, s)));
        for ((number, entry), options) in all {
            let options = Options { backend: Some(entry.backend), ..options.clone() };
            if entry.backend != Backend::Raymarch && codes(&path, &options) == ["E0530"] {
                continue;
            }
            drawn[number] += 1;
            let out = compiled(&path, &options);
            for shader in shaders(&out) {
                let wgsl = shader.wgsl().expect("WGSL");
                let module = naga::front::wgsl::parse_str(&wgsl)
                    .unwrap_or_else(|e| panic!("{}: {}", path.display(), e.emit_to_string(&wgsl)));
                let flags = naga::valid::ValidationFlags::all();
                naga::valid::Validator::new(flags, naga::valid::Capabilities::empty())
                    .validate(&module)
                    .unwrap_or_else(|e| panic!("{}: {e:?}\n{wgsl}", path.display()));
                assert!(!shader.spirv().expect("SPIR-V").is_empty());
                assert!(shader.glsl().expect("GLSL").contains("void main()"));
                let stage = module.entry_points[0].stage;
                let compute = stage == naga::ShaderStage::Compute;
                assert_eq!(shader.hlsl().expect("HLSL").contains("[numthreads("), compute);
                assert_eq!(shader.msl().expect("MSL").contains("kernel void"), compute);
            }
        }
    }
    assert!(drawn.iter().all(|n| *n >= 10), "{drawn:?}");
}

/// A piece of a shader, and what must be in a scene for it to be there.
const TRACES: [(&str, fn(&str) -> bool); 8] = [
    ("texture_3d", |scene| scene.contains("grid ")),
    // What was blended is read back.
    ("textureLoad", |scene| ["grid ", "backend = slicing", "backend = splatting"].iter().any(|w| scene.contains(w))),
    ("fn cell_hash", |scene| scene.contains("std::noise")),
    ("fn through_box", |scene| scene.contains("box(") || scene.contains("bounds(")),
    ("fn through_ball", |scene| ["sphere(", "ellipsoid(", "shell(", "cylinder("].iter().any(|w| scene.contains(w))),
    ("_next(", |scene| scene.contains("sdf(")),
    ("fn exponential_integral", |scene| scene.contains("exp(") || scene.contains("height")),
    // The loop over samples of a pixel.
    ("var sample", |scene| scene.contains("ssaa") || scene.contains("msaa")),
];

/// A word that a name in a shader may have as a part, the names that may have it in any scene, and what must be in a scene
/// for others to have it.
const WORDS: [(&str, &[&str], fn(&str) -> bool); 6] = [
    // What a step of a march adds is light too, wherever it comes from.
    ("light", &["light", "light_first", "light_whole", "light_second", "light_error"], lit),
    ("phase", &[], lit),
    ("shadow", &[], lit),
    ("sampler", &[], |scene| scene.contains("grid ")),
    ("glyph", &[], |scene| scene.contains("text ")),
    ("atlas", &[], |scene| scene.contains("text ")),
];

fn lit(scene: &str) -> bool {
    scene.contains("light ")
}

/// What a scene says, comments apart.
fn said(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or(line)).fold(String::new(), |all, line| all + line + "\n")
}

/// The names in a shader, without the endings `_b`, `_2` that tell equal ones apart.
fn names(code: &str) -> BTreeSet<String> {
    let words = code.split(|c: char| !(c.is_alphanumeric() || c == '_'));
    let base = |word: &str| {
        let mut parts: Vec<&str> = word.split('_').collect();
        while parts.len() > 1 && parts.last().is_some_and(|p| p.len() < 2) {
            parts.pop();
        }
        parts.join("_")
    };
    words.map(base).filter(|w| !w.is_empty()).collect()
}

/// What a shader has without its scene's needing it.
fn needless(scene: &str, code: &str) -> Vec<String> {
    let scene = said(scene);
    let traces = TRACES.iter().filter(|(piece, needed)| code.contains(piece) && !needed(&scene));
    let mut found: Vec<String> = traces.map(|t| t.0.to_owned()).collect();
    for (word, everywhere, needed) in WORDS {
        if !needed(&scene) {
            let has = |name: &&String| name.split('_').any(|part| part == word) && !everywhere.contains(&name.as_str());
            found.extend(names(code).iter().filter(has).cloned());
        }
    }
    found
}

#[test]
fn no_shader_has_a_trace_of_what_its_scene_does_without() {
    let mut seen = BTreeSet::new();
    for path in scenes() {
        let code = code(&compiled(&path, &Options::default()));
        assert_eq!(needless(&text(&path), &code), [""; 0], "{} has these for nothing", path.display());
        seen.extend(TRACES.iter().map(|t| t.0).filter(|piece| code.contains(piece)));
    }
    // A piece that no shader has any more would be looked for in vain.
    assert_eq!(seen, TRACES.iter().map(|t| t.0).collect());
}

#[test]
fn traces_are_found() {
    for (piece, _) in TRACES {
        assert_eq!(needless("medium m { k_a = 1 /m }", &format!("{{ {piece} ")), [piece]);
    }
    for (word, everywhere, _) in WORDS {
        let code = format!("fn {word}_of_sun() {{ let the_{word}_b = {word}s; }}");
        let names = [format!("{word}_of_sun"), format!("the_{word}")];
        assert_eq!(needless("// light text grid", &code), names);
        assert_eq!(needless("light l {} text t {} grid g {}", &code), [""; 0]);
        assert_eq!(needless("", &everywhere.join("_c + ")), [""; 0]);
    }
}

/// Members of the uniform block that the code never reads.
fn unread(code: &str) -> Vec<&str> {
    let block =
        code.split_once("struct Frame {").and_then(|(_, rest)| rest.split_once('}')).map_or("", |(block, _)| block);
    let members = block.lines().filter_map(|line| Some(line.split_once(':')?.0.trim()));
    let is_read = |member: &&str| {
        let uses = code.split("frame.").skip(1);
        uses.map(|rest| rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).next())
            .any(|name| name == Some(member))
    };
    members.filter(|m| !is_read(m)).collect()
}

#[test]
fn unread_uniforms_are_found() {
    let code = "struct Frame {\n    size: vec2<u32>,\n    white: f32,\n    time: f32,\n}\nlet a = frame.size_b + frame.white.x;\n";
    assert_eq!(unread(code), ["size", "time"]);
}

#[test]
fn every_binding_and_uniform_is_used() {
    for path in scenes() {
        for options in [Options::default(), Options::probe()] {
            let out = compiled(&path, &options);
            for shader in shaders(&out) {
                let module = &shader.module;
                let entries = module.entry_points.iter().map(|e| &e.function);
                let functions: Vec<&naga::Function> = module.functions.iter().map(|f| f.1).chain(entries).collect();
                for (handle, variable) in module.global_variables.iter() {
                    let used = functions
                        .iter()
                        .flat_map(|f| f.expressions.iter())
                        .any(|(_, e)| matches!(e, naga::Expression::GlobalVariable(h) if *h == handle));
                    assert!(used, "{}: binding `{:?}` is used by nothing", path.display(), variable.name);
                }
            }
            // Several kernels share the block, and each field is there for one of them at least.
            let code = code(&out);
            let declared = code
                .split_once("struct Frame {")
                .map_or(0, |(_, rest)| rest.split('}').next().unwrap_or("").matches(':').count());
            assert_eq!(declared, program(&out).plan.uniforms.fields.len(), "{}", path.display());
            assert_eq!(unread(&code), [""; 0], "{}: these uniforms are read by nothing", path.display());
        }
    }
}

#[test]
fn a_uniform_gray_scene_is_scalar_and_has_no_loop() {
    let text = "medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_a = 2 /m  k_e = 3 lx / m }\n\
                camera { from = (0,0,-4) m  to = (0,0,0) m }\nimage { bands = gray  aa = none  size = 64 x 64 }";
    let code = wgsl(text);
    assert!(!code.contains("loop"), "{code}");
    assert!(!code.contains("radiance: vec"), "{code}");
    insta::assert_snapshot!("uniform_gray", code);
    let out = scene(text);
    insta::assert_snapshot!("uniform_gray_ledger", print_ledger(&program(&out).ledger, &out.sources));
}

#[test]
fn what_media_of_one_place_share_is_worked_out_once() {
    let two = |second: &str| {
        wgsl(&format!(
            "use std::noise::fbm\n\
             fn lumps(q: vec3) -> number = clamp(fbm(q / 0.3, octaves: 2), 0, 1)\n\
             medium smoke {{ shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_a = 2 /m * lumps(p / 1 m) }}\n\
             medium fire {{ shape = sphere(center: (0, 0, 0) m, radius: {second})  k_e = 3 lx/m * lumps(p / 1 m)^2 }}\n\
             camera {{ from = (0, 0, -4) m  to = (0, 0, 0) m }}"
        ))
    };
    let hashes = |code: &str| code.matches("= cell_hash(").count();
    let (together, apart) = (two("1 m"), two("0.9 m"));
    assert!(together.contains("fn smoke_and_fire_at("), "{together}");
    assert!(apart.contains("fn smoke_at(") && apart.contains("fn fire_at("), "{apart}");
    assert_eq!(2 * hashes(&together), hashes(&apart));
}

#[test]
fn the_plan_lists_what_each_backend_is_predicted_to_need() {
    let forecasts = |name: &str| {
        let out = compiled(&root().join("examples").join(name).with_extension("vol"), &Options::default());
        let program = program(&out);
        let printed = print_forecasts(&program.forecasts, program.plan.backend);
        assert!(print_plan(program).contains(&printed));
        format!("{name}\n{printed}")
    };
    let all = ["brain", "nebula", "haze", "glowing_ball", "paths/milk", "splats/bonsai"].map(forecasts);
    insta::assert_snapshot!("forecasts", all.concat());
}

#[test]
fn fog_is_its_closed_form() {
    let code = wgsl(
        "fog { k = 0.05 /m  color = #c8d0d8  height = 200 m }\nimage { aa = none  size = 64 x 64 }\ncamera { from = (0,1,0) m  to = (0,1,1) m }",
    );
    assert!(!code.contains("loop"), "{code}");
    insta::assert_snapshot!("layered_fog", code);
}

#[test]
fn a_parameter_is_a_uniform_and_no_literal() {
    let out = scene(
        "param density = 4 /m in 0 /m .. 40 /m\n\
         medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_a = density }",
    );
    let plan = &program(&out).plan;
    assert!(plan.uniforms.fields.iter().any(|f| f.name.contains("density")), "{:?}", plan.uniforms);
}

#[test]
fn the_source_map_leads_both_ways() {
    let out = compiled(&root().join("examples/nebula.vol"), &Options::default());
    for shader in shaders(&out) {
        let code = shader.wgsl().expect("WGSL");
        let map = shader.source_map(&code);
        assert!(map.lines.len() > 20, "only {} lines are mapped", map.lines.len());
        for line in &map.lines {
            assert_eq!(map.scene_span(line.generated), Some(line.span));
            assert!(map.generated_lines(line.span).contains(&line.generated), "line {}", line.generated);
        }
    }
}
