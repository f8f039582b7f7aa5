//! `vol report`

mod figures;
mod index;
mod json;
mod page;
mod plot;
mod table;

use super::read;
use crate::args::{Format, Report as Arguments};
use crate::output::{Exit, complain, diagnostics, document, document_text, progress, say, trouble};
use index::Index;
use runtime::frame::{Cause, EngineChoice, FileLoader, Trouble};
use runtime::report::{Quantity, Report, Request, Row, Series, report};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

pub(super) fn run(format: Format, arguments: &Arguments) -> Result<Exit, Trouble> {
    let (engine, adapter) = arguments.engine.choice();
    if engine == EngineChoice::Reference {
        let hint = Some("`--engine gpu` or `--engine cpu`");
        return Err(trouble(Cause::Arguments, "E0643", "everything is compared with the reference already", hint));
    }
    let request = Request {
        size: arguments.size,
        sets: arguments.set.clone(),
        scattering: arguments.scattering.map(|s| s.scattering()),
        accuracy: arguments.accuracy,
        backend: arguments.backend.map(|b| b.backend()).filter(|b| *b != compiler::ir::Backend::Auto),
        engine: Some(engine).filter(|e| *e != EngineChoice::Auto),
        adapter,
        budget: arguments.budget,
        seed: arguments.seed,
        time: arguments.time,
    };
    let folder = &arguments.output;
    if let [scene] = arguments.scenes.as_slice() {
        let body = one(format, scene, folder, &request)?.1;
        if let Format::Json = format {
            document("vol.report", body);
        }
        return Ok(Exit::Done);
    }
    make(folder)?;
    let mut exit = Exit::Done;
    let (mut index, mut bodies) = (Index::new(arguments.budget), vec![]);
    for scene in &arguments.scenes {
        let name = index.name(scene);
        // What one scene lacks is no reason to leave out the others.
        match one(format, scene, &folder.join(&name), &request) {
            Ok((report, body)) => {
                index.add(&name, report);
                bodies.push(body);
            }
            Err(found) => {
                exit = Exit::from(found.cause);
                complain(&format!("{scene}\n"));
                diagnostics(&found.diagnostics, &found.sources);
            }
        }
    }
    fs::write(folder.join("README.md"), index.text()).map_err(|e| unwritable(folder, &e))?;
    match format {
        Format::Json => document("vol.reports", json!({ "ok": exit == Exit::Done, "reports": bodies })),
        Format::Human => say(&format!("wrote    {}/README.md\n", folder.display())),
    }
    Ok(exit)
}

fn unwritable(folder: &Path, error: &std::io::Error) -> Trouble {
    trouble(Cause::Input, "E0642", format!("`{}` cannot be written: {error}", folder.display()), None)
}

fn make(folder: &Path) -> Result<(), Trouble> {
    fs::create_dir_all(folder).map_err(|e| unwritable(folder, &e))
}

/// The report of a scene, and its document.
fn one(format: Format, scene: &str, folder: &Path, request: &Request) -> Result<(Report, Value), Trouble> {
    let loader = FileLoader::default();
    let text = read(&loader, scene)?;
    // Before anything is drawn.
    make(folder)?;
    let bar = progress(format, scene);
    let found = report(scene, &text, &loader, request, &|share, what| {
        bar.set_position((share * 1000.0) as u64);
        bar.set_message(what.to_owned());
    });
    bar.finish_and_clear();
    let found = found?;
    let body = json::body(&found);
    let files = [
        ("report.json", document_text("vol.report", body.clone())),
        ("report.csv", table::csv(&found)),
        ("report.html", page::html(&found, &text)),
        ("report.svg", figures::file(&found)),
    ];
    for (name, text) in &files {
        fs::write(folder.join(name), text).map_err(|e| unwritable(folder, &e))?;
    }
    if let Format::Human = format {
        diagnostics(&found.warnings, &found.sources);
        say(&table::summary(&found));
        if found.series.is_empty() {
            complain("warning: nothing could be drawn; see what was left out\n");
        }
        let names: Vec<String> = files.iter().map(|(name, _)| format!("{}/{name}", folder.display())).collect();
        say(&format!("wrote    {}\n", names.join(", ")));
    }
    Ok((found, body))
}

/// `gpu raymarch`, or `cpu`.
fn way(engine: &str, backend: Option<&str>) -> String {
    backend.map_or_else(|| engine.to_owned(), |b| format!("{engine} {b}"))
}

fn name(series: &Series) -> String {
    format!("{}, {}", way(series.engine, series.backend), series.quantity.name())
}

/// A value of a quantity as people write it.
fn value(quantity: Quantity, value: f64) -> String {
    match quantity {
        Quantity::Accuracy => format!("{value:e}"),
        Quantity::Steps | Quantity::Slices | Quantity::Splats | Quantity::Samples => format!("{value}"),
    }
}

/// The pictures that the scene itself asks for.
fn chosen(report: &Report) -> impl Iterator<Item = (&Series, &Row)> {
    report.series.iter().flat_map(|s| s.rows.iter().filter(|r| r.chosen).map(move |r| (s, r)))
}

/// Three digits.
fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".into()
    } else if !(1e-3..1e5).contains(&size) {
        format!("{value:.2e}")
    } else if size >= 100.0 {
        format!("{value:.0}")
    } else if size >= 10.0 {
        format!("{value:.1}")
    } else if size >= 1.0 {
        format!("{value:.2}")
    } else {
        format!("{value:.4}")
    }
}
