//! `vol emit`

use super::{nanometres, read};
use crate::args::{Emit, Format, Target};
use crate::output::{Exit, diagnostics, diagnostics_json, document, say, trouble};
use compiler::diagnostic::Diagnostics;
use compiler::emit::{EmitError, Shader};
use compiler::ir::Bands;
use compiler::program::{Ledger, Program, print_graphviz, print_ir, print_ledger, print_plan};
use compiler::source::Sources;
use runtime::frame::{Cause, FileLoader, Trouble};
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

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
    let made: Result<Vec<Made>, Trouble> = program.parts().map(|part| make(part, arguments, &sources)).collect();
    let mut made = match made {
        Ok(made) => made,
        Err(mut trouble) => {
            found.0.append(&mut trouble.diagnostics.0);
            return Err(Trouble { cause: trouble.cause, diagnostics: found, sources });
        }
    };
    if let Some(path) = &arguments.output {
        let several = made.len() > 1;
        for (i, made) in made.iter_mut().enumerate() {
            let path = if several { numbered(path, i + 1) } else { path.clone() };
            made.save(&path)?;
        }
    }
    match format {
        Format::Json => {
            let parts: Vec<Value> = made.iter().map(Made::json).collect();
            let mut body = json!({
                "ok": true, "target": arguments.target.name(), "diagnostics": diagnostics_json(&found, &sources),
            });
            // One program stands at the top; several stand in a list, and nothing of them at the top.
            let single = match parts.as_slice() {
                [single] => single.clone(),
                _ => json!({ "output": null, "text": null, "map": null }),
            };
            for key in ["output", "text", "map"] {
                body[key] = single[key].clone();
            }
            body["programs"] = parts.into();
            document("vol.emit", body);
        }
        Format::Human if arguments.output.is_some() => {
            if made.len() > 1 {
                made.iter().for_each(|m| say(&format!("wrote    {}: {}\n", m.written(), m.bands)));
            }
        }
        Format::Human => print(&made, arguments.target)?,
    }
    Ok(Exit::Done)
}

/// What came of one program, which has some of the picture's bands.
struct Made {
    bands: Bands,
    product: Product,
    map: Option<Value>,
    output: Option<PathBuf>,
}

fn make(program: &Program, arguments: &Emit, sources: &Sources) -> Result<Made, Trouble> {
    let refuse = |error: EmitError| Trouble {
        cause: Cause::Input,
        diagnostics: Diagnostics(vec![error.diagnostic()]),
        sources: sources.clone(),
    };
    let shaders = shaders(program).map_err(refuse)?;
    let product = product(program, &shaders, arguments.target).map_err(refuse)?;
    let map = if arguments.map { Some(map(&product, &shaders, arguments.target, sources)?) } else { None };
    Ok(Made { bands: program.lowered.bands.clone(), product, map, output: None })
}

impl Made {
    fn save(&mut self, path: &Path) -> Result<(), Trouble> {
        let bytes = match &self.product {
            Product::Text(text) => text.as_bytes(),
            Product::Binary(bytes) => bytes,
        };
        write(path, bytes)?;
        if let Some(map) = &self.map {
            let mut name = path.as_os_str().to_owned();
            name.push(".map.json");
            let document = json!({ "schema": "vol.map", "version": 1, "lines": map });
            write(Path::new(&name), format!("{document:#}\n").as_bytes())?;
        }
        self.output = Some(path.to_owned());
        Ok(())
    }

    fn written(&self) -> String {
        self.output.as_ref().map(|p| p.display().to_string()).unwrap_or_default()
    }

    fn json(&self) -> Value {
        let text = match (&self.product, &self.output) {
            (Product::Text(text), None) => Value::from(text.as_str()),
            (Product::Text(_) | Product::Binary(_), _) => Value::Null,
        };
        let output = self.output.as_ref().map(|p| p.display().to_string());
        json!({ "bands_nm": nanometres(&self.bands), "output": output, "text": text, "map": self.map })
    }
}

/// `shader.2.wgsl` of `shader.wgsl`.
fn numbered(path: &Path, number: usize) -> PathBuf {
    match path.extension() {
        Some(ending) => path.with_extension(format!("{number}.{}", ending.to_string_lossy())),
        None => path.with_extension(number.to_string()),
    }
}

/// On standard output, with a heading above each of several programs.
fn print(made: &[Made], target: Target) -> Result<(), Trouble> {
    for (i, part) in made.iter().enumerate() {
        let text = match (&part.product, &part.map) {
            (Product::Binary(bytes), _) => {
                let refuse = |message: String, hint| Err(trouble(Cause::Arguments, "E0647", message, Some(hint)));
                if made.len() > 1 {
                    let message = format!("these are {} binary files, one for each group of bands", made.len());
                    return refuse(message, "write them to files with -o");
                }
                if std::io::stdout().is_terminal() {
                    let message = format!("{} is binary and is not printed on a terminal", target.name());
                    return refuse(message, "write it to a file with -o");
                }
                let _ = std::io::Write::write_all(&mut std::io::stdout().lock(), bytes);
                continue;
            }
            (Product::Text(_), Some(map)) => map_text(map),
            (Product::Text(text), None) => text.clone(),
        };
        if made.len() > 1 {
            say(&format!("// program {} of {}: {}\n", i + 1, made.len(), part.bands));
        }
        say(&text);
    }
    Ok(())
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

fn write(path: &Path, bytes: &[u8]) -> Result<(), Trouble> {
    std::fs::write(path, bytes).map_err(|error| {
        trouble(Cause::Input, "E0620", format!("`{}` cannot be written: {error}", path.display()), None)
    })
}
