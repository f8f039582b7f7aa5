//! `vol emit`

use super::read;
use crate::args::{Emit, Format, Target};
use crate::output::{Exit, diagnostics, diagnostics_json, document, say, trouble};
use compiler::diagnostic::Diagnostics;
use compiler::emit::{EmitError, Shader};
use compiler::program::{Ledger, Program, print_graphviz, print_ir, print_ledger, print_plan};
use compiler::source::Sources;
use runtime::frame::{Cause, FileLoader, Trouble};
use serde_json::{Value, json};
use std::io::IsTerminal;

/// What was emitted.
enum Product {
    Text(String),
    Binary(Vec<u8>),
}

pub(super) fn run(format: Format, arguments: &Emit) -> Result<Exit, Trouble> {
    let loader = FileLoader::default();
    let text = read(&loader, &arguments.scene)?;
    let options = arguments.schedule.apply(compiler::Options::default());
    let compiled = compiler::compile(&arguments.scene, &text, &loader, &options);
    let (sources, mut found) = (compiled.sources, compiled.diagnostics);
    let Some(program) = compiled.program.filter(|_| !found.has_errors()) else {
        return Err(Trouble { cause: Cause::Input, diagnostics: found, sources });
    };
    if format == Format::Human {
        diagnostics(&found, &sources);
    }
    if arguments.explain {
        return Ok(explain(format, arguments, &program.ledger, &found, &sources));
    }
    let made = shaders(&program).and_then(|shaders| Ok((product(&program, &shaders, arguments.target)?, shaders)));
    let (product, shaders) = match made {
        Ok(made) => made,
        Err(error) => {
            found.push(error.diagnostic());
            return Err(Trouble { cause: Cause::Input, diagnostics: found, sources });
        }
    };
    let map = if arguments.map { Some(map(&product, &shaders, arguments.target, &sources)?) } else { None };
    if let Some(path) = &arguments.output {
        let bytes = match &product {
            Product::Text(text) => text.as_bytes(),
            Product::Binary(bytes) => bytes,
        };
        write(path, bytes)?;
        if let Some(map) = &map {
            let mut name = path.clone().into_os_string();
            name.push(".map.json");
            let document = json!({ "schema": "vol.map", "version": 1, "lines": map });
            write(std::path::Path::new(&name), format!("{document:#}\n").as_bytes())?;
        }
    }
    let target = arguments.target.name();
    match (format, &product) {
        (Format::Json, product) => {
            let text = match (product, &arguments.output) {
                (Product::Text(text), None) => Value::from(text.as_str()),
                (Product::Text(_) | Product::Binary(_), _) => Value::Null,
            };
            let list = diagnostics_json(&found, &sources);
            let output = arguments.output.as_ref().map(|p| p.display().to_string());
            let body = json!({
                "ok": true, "target": target, "output": output, "text": text, "map": map, "diagnostics": list,
            });
            document("vol.emit", body);
        }
        (Format::Human, _) if arguments.output.is_some() => {}
        (Format::Human, Product::Binary(bytes)) => {
            if std::io::stdout().is_terminal() {
                let message = format!("{target} is binary and is not printed on a terminal");
                return Err(trouble(Cause::Arguments, "E0647", message, Some("write it to a file with -o")));
            }
            let _ = std::io::Write::write_all(&mut std::io::stdout().lock(), bytes);
        }
        (Format::Human, Product::Text(text)) => match map {
            Some(map) => say(&map_text(&map)),
            None => say(text),
        },
    }
    Ok(Exit::Done)
}

fn shaders(program: &Program) -> Result<Vec<Shader>, EmitError> {
    program.kernels.iter().map(compiler::emit::emit).collect()
}

fn product(program: &Program, shaders: &[Shader], target: Target) -> Result<Product, EmitError> {
    let all = |write: &dyn Fn(&Shader) -> Result<String, EmitError>| -> Result<Product, EmitError> {
        let texts: Result<Vec<String>, EmitError> = shaders.iter().map(write).collect();
        Ok(Product::Text(texts?.join("\n")))
    };
    match target {
        Target::Wgsl => all(&Shader::wgsl),
        Target::Glsl => all(&Shader::glsl),
        Target::Hlsl => all(&Shader::hlsl),
        Target::Msl => all(&Shader::msl),
        Target::Naga => all(&|s| Ok(s.naga_text())),
        Target::Spirv => {
            let words: Result<Vec<Vec<u32>>, EmitError> = shaders.iter().map(Shader::spirv).collect();
            Ok(Product::Binary(words?.into_iter().flatten().flat_map(u32::to_le_bytes).collect()))
        }
        Target::Ir => Ok(Product::Text(print_ir(program))),
        Target::Graph => Ok(Product::Text(print_graphviz(program))),
        Target::Plan => Ok(Product::Text(print_plan(program))),
    }
}

/// The source map, both ways: it lists pairs of a generated line and a place in a scene.
fn map(product: &Product, shaders: &[Shader], target: Target, sources: &Sources) -> Result<Value, Trouble> {
    let (Product::Text(text), [shader]) = (product, shaders) else {
        let message = format!("there is no source map of {}", target.name());
        let hint = Some("maps exist for wgsl, glsl, hlsl and msl of a program with one kernel");
        return Err(trouble(Cause::Arguments, "E0647", message, hint));
    };
    let entries = shader.source_map(text).entries(sources);
    Ok(entries
        .iter()
        .map(|e| {
            json!({
                "generated": e.generated, "name": e.name, "file": e.source,
                "line": e.line, "column": e.column, "start": e.start, "end": e.end,
            })
        })
        .collect())
}

fn map_text(map: &Value) -> String {
    let line = |e: &Value| {
        let text = |key: &str| e[key].as_str().unwrap_or_default().to_owned();
        format!("{:>5}  {:<24} {}:{}:{}\n", e["generated"], text("name"), text("file"), e["line"], e["column"])
    };
    map.as_array().into_iter().flatten().map(line).collect()
}

fn explain(format: Format, arguments: &Emit, ledger: &Ledger, found: &Diagnostics, sources: &Sources) -> Exit {
    let place = |span: Option<compiler::source::Span>| {
        span.map(|s| (sources.get(s.source).name.as_str(), sources.line_column(s).0)).unzip()
    };
    match format {
        Format::Human => say(&print_ledger(ledger, sources)),
        Format::Json => {
            let list: Vec<Value> = ledger
                .0
                .iter()
                .map(|o| {
                    let (file, line): (Option<&str>, Option<usize>) = place(o.span);
                    json!({ "feature": o.feature, "reason": o.reason, "file": file, "line": line })
                })
                .collect();
            let body = json!({
                "ok": true, "scene": arguments.scene, "omissions": list,
                "diagnostics": diagnostics_json(found, sources),
            });
            document("vol.emit", body);
        }
    }
    Exit::Done
}

fn write(path: &std::path::Path, bytes: &[u8]) -> Result<(), Trouble> {
    std::fs::write(path, bytes).map_err(|error| {
        trouble(Cause::Input, "E0620", format!("`{}` cannot be written: {error}", path.display()), None)
    })
}
