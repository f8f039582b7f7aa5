//! The shaders of every example: valid in every target, and without a trace of what the scene does not need.

use compiler::emit::{Shader, emit};
use compiler::program::{Program, print_ledger};
use compiler::{Compilation, Options, compile};
use runtime::frame::FileLoader;
use std::path::Path;
use tyndall_tests::{files, root};

fn compiled(path: &Path, options: &Options) -> Compilation {
    let text = std::fs::read_to_string(path).expect("the scene is text");
    let name = path.file_name().and_then(|n| n.to_str()).expect("a name");
    compile(name, &text, &FileLoader::new(path.parent().expect("a folder")), options)
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

fn wgsl(text: &str) -> String {
    shaders(&scene(text)).iter().map(|s| s.wgsl().expect("WGSL")).collect()
}

#[test]
fn every_example_is_valid_in_every_target() {
    for path in files("examples", "vol").iter().chain(&files("tests/suite", "vol")) {
        for options in [Options::default(), Options::probe()] {
            let out = compiled(path, &options);
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
                assert!(shader.hlsl().expect("HLSL").contains("[numthreads("));
                assert!(shader.msl().expect("MSL").contains("kernel void"));
            }
        }
    }
}

/// A word in a shader, and what must be in a scene for it to be there.
const TRACES: [(&str, fn(&str) -> bool); 8] = [
    ("texture_3d", |scene| scene.contains("grid ")),
    ("textureLoad", |scene| scene.contains("grid ")),
    ("fn cell_hash", |scene| scene.contains("std::noise")),
    ("fn through_box", |scene| scene.contains("box(") || scene.contains("bounds(")),
    ("fn through_ball", |scene| ["sphere(", "ellipsoid(", "shell(", "cylinder("].iter().any(|w| scene.contains(w))),
    ("_next(", |scene| scene.contains("sdf(")),
    ("fn exponential_integral", |scene| scene.contains("exp(") || scene.contains("height")),
    ("sample_offset", |scene| scene.contains("ssaa")),
];

#[test]
fn no_shader_has_a_trace_of_what_its_scene_does_without() {
    for path in files("examples", "vol").iter().chain(&files("tests/suite", "vol")) {
        let text = std::fs::read_to_string(path).expect("the scene is text");
        let code: String =
            shaders(&compiled(path, &Options::default())).iter().map(|s| s.wgsl().expect("WGSL")).collect();
        for (word, needed) in TRACES {
            assert!(needed(&text) || !code.contains(word), "{} has `{word}` for nothing", path.display());
        }
        for word in ["light", "phase", "shadow", "glyph", "atlas", "sampler"] {
            let absent = ["fn ", "var ", "struct "].iter().all(|k| !code.contains(&format!("{k}{word}")));
            // `light` is also what a step of a march adds.
            assert!(absent || word == "light", "{} has `{word}` for nothing", path.display());
        }
    }
}

#[test]
fn every_binding_and_uniform_is_used() {
    for path in files("examples", "vol").iter().chain(&files("tests/suite", "vol")) {
        let out = compiled(path, &Options::default());
        for shader in shaders(&out) {
            for (handle, variable) in shader.module.global_variables.iter() {
                let name = variable.name.clone().unwrap_or_default();
                let used = shader
                    .module
                    .functions
                    .iter()
                    .map(|f| f.1)
                    .chain(shader.module.entry_points.iter().map(|e| &e.function));
                let used = used.flat_map(|f| f.expressions.iter().map(|e| e.1));
                let used = used.filter(|e| matches!(e, naga::Expression::GlobalVariable(h) if *h == handle)).count();
                assert!(used > 0, "{}: binding `{name}` is used by nothing", path.display());
            }
            let code = shader.wgsl().expect("WGSL");
            for field in &program(&out).plan.uniforms.fields {
                let read = code.contains("frame.");
                assert!(read, "{}: uniform `{}` is read by nothing", path.display(), field.name);
            }
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
