//! One file per command.

mod check;
mod doctor;
mod emit;
mod explain;
mod fmt;
mod new;
mod probe;
mod render;
mod report;
mod stress;

use crate::args::{Arguments, Command};
use crate::output::{self, Exit};
use compiler::diagnostic::{Diagnostic, Diagnostics};
use compiler::ir::Bands;
use compiler::source::Sources;
use runtime::frame::{Cause, FileLoader, STDIN, Trouble};
use std::io::Read;

/// Runs the command that was asked for.
pub(crate) fn run(arguments: Arguments) -> Exit {
    let format = arguments.format;
    let result = match arguments.command {
        Command::Render(a) => render::run(format, &a).map_err(|t| (t, "vol.render")),
        Command::Check(a) => Ok(check::run(format, &a)),
        Command::Emit(a) => emit::run(format, &a).map_err(|t| (t, "vol.emit")),
        Command::Probe(a) => probe::run(format, &a).map_err(|t| (t, "vol.probe")),
        Command::Report(a) => report::run(format, &a).map_err(|t| (t, "vol.report")),
        Command::Stress(a) => stress::run(format, &a).map_err(|t| (t, "vol.stress")),
        Command::Fmt(a) => Ok(fmt::run(format, &a)),
        Command::Explain(a) => explain::run(format, &a).map_err(|t| (t, "vol.explain")),
        Command::Doctor => Ok(doctor::run(format)),
        Command::New(a) => new::run(format, &a).map_err(|t| (t, "vol.new")),
    };
    result.unwrap_or_else(|(trouble, schema)| output::fail(format, schema, &trouble))
}

/// The bands of a picture in nanometres, without the last bits that the way through metres leaves.
fn nanometres(bands: &Bands) -> Vec<f64> {
    let nanometres = |metres: &f64| {
        let exact = metres * 1e9;
        let round = (exact * 1e6).round() / 1e6;
        if (round - exact).abs() < 1e-9 * exact.abs() { round } else { exact }
    };
    bands.wavelengths.iter().map(nanometres).collect()
}

/// The text of a scene, from a file or from standard input.
fn read(loader: &FileLoader, name: &str) -> Result<String, Trouble> {
    let refuse = |diagnostic| Trouble {
        cause: Cause::Input,
        diagnostics: Diagnostics(vec![diagnostic]),
        sources: Sources::default(),
    };
    if name != STDIN {
        return loader.text(name).map_err(|error| {
            let mut diagnostic = Diagnostic::error(error.code, error.message);
            diagnostic.hints.extend(error.hint);
            refuse(diagnostic)
        });
    }
    let mut text = String::new();
    match std::io::stdin().lock().read_to_string(&mut text) {
        Ok(_) => Ok(text),
        Err(error) => {
            let message = format!("the scene cannot be read from standard input: {error}");
            Err(refuse(Diagnostic::error("E0601", message)))
        }
    }
}
