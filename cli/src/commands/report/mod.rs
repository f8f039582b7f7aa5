//! `vol report`

mod json;
mod page;
mod plot;
mod table;

use super::read;
use crate::args::{Format, Report as Arguments};
use crate::output::{Exit, complain, diagnostics, document_text, progress, say, trouble};
use runtime::frame::{Cause, EngineChoice, FileLoader, Trouble};
use runtime::report::{Quantity, Report, Request, Row, Series, report};
use std::fs;

pub(super) fn run(format: Format, arguments: &Arguments) -> Result<Exit, Trouble> {
    let loader = FileLoader::default();
    let text = read(&loader, &arguments.scene)?;
    let (engine, adapter) = arguments.engine.choice();
    if engine == EngineChoice::Reference {
        let hint = Some("`--engine gpu` or `--engine cpu`");
        return Err(trouble(Cause::Arguments, "E0643", "everything is compared with the reference already", hint));
    }
    // Before anything is drawn.
    let folder = &arguments.output;
    let cannot = |e: std::io::Error| {
        trouble(Cause::Input, "E0642", format!("`{}` cannot be written: {e}", folder.display()), None)
    };
    fs::create_dir_all(folder).map_err(cannot)?;
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
    let bar = progress(format, &arguments.scene);
    let found = report(&arguments.scene, &text, &loader, &request, &|share, what| {
        bar.set_position((share * 1000.0) as u64);
        bar.set_message(what.to_owned());
    });
    bar.finish_and_clear();
    let found = found?;
    let document = document_text("vol.report", json::body(&found));
    fs::write(folder.join("report.json"), &document).map_err(cannot)?;
    fs::write(folder.join("report.csv"), table::csv(&found)).map_err(cannot)?;
    fs::write(folder.join("report.html"), page::html(&found, &text)).map_err(cannot)?;
    match format {
        Format::Json => say(&document),
        Format::Human => {
            diagnostics(&found.warnings, &found.sources);
            say(&table::summary(&found));
            if found.series.is_empty() {
                complain("warning: nothing could be drawn; see what was left out\n");
            }
            say(&format!("wrote    {0}/report.html, {0}/report.json, {0}/report.csv\n", folder.display()));
        }
    }
    Ok(Exit::Done)
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
