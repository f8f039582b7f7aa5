//! Rows for spreadsheets, and the few lines on the terminal.

use super::figures::exponent;
use super::{chosen, name, value, way};
use runtime::report::{Report, Row, Series};

/// The columns of the CSV file, in their order. Errors and radiance are in lx, times in milliseconds.
const COLUMNS: [&str; 30] = [
    "engine",
    "adapter",
    "backend",
    "quantity",
    "value",
    "chosen",
    "pareto",
    "compile_ms",
    "build_ms",
    "draw_ms",
    "clock",
    "evaluations",
    "paths",
    "pixels",
    "max_lx",
    "rms_lx",
    "mean_lx",
    "share",
    "flip",
    "edge_pixels",
    "edge_max_lx",
    "predicted_kind",
    "predicted_max_lx",
    "predicted_share",
    "pixels_beyond",
    "held",
    "discretisation_lx",
    "rounding_lx",
    "storage_lx",
    "statistical_lx",
];

/// One line per picture, after a heading.
pub(super) fn csv(report: &Report) -> String {
    let lines = report.series.iter().flat_map(|s| s.rows.iter().map(|r| line(s, r)));
    let heading = COLUMNS.join(",");
    [heading].into_iter().chain(lines).map(|l| l + "\n").collect()
}

fn line(series: &Series, row: &Row) -> String {
    let maybe = |v: Option<String>| v.unwrap_or_default();
    let predicted = row.predicted.as_ref();
    let origins = predicted.and_then(|p| p.origins);
    let fields: [String; 30] = [
        series.engine.to_owned(),
        quoted(series.adapter.as_deref().unwrap_or_default()),
        series.backend.unwrap_or_default().to_owned(),
        series.quantity.name().to_owned(),
        row.value.to_string(),
        row.chosen.to_string(),
        row.pareto.to_string(),
        row.compile_ms.to_string(),
        row.build_ms.to_string(),
        row.draw_ms.to_string(),
        row.clock.to_owned(),
        maybe(row.evaluations.map(|n| n.to_string())),
        maybe(row.paths.map(|n| n.to_string())),
        row.error.pixels.to_string(),
        row.error.max.to_string(),
        row.error.rms.to_string(),
        row.error.mean.to_string(),
        row.error.share.to_string(),
        maybe(row.flip.map(|f| f.to_string())),
        row.edges.pixels.to_string(),
        row.edges.max.to_string(),
        maybe(predicted.map(|p| p.kind.to_owned())),
        maybe(predicted.map(|p| p.max.to_string())),
        maybe(predicted.map(|p| p.share.to_string())),
        maybe(predicted.map(|p| p.beyond.to_string())),
        maybe(predicted.map(|p| p.held(row.error.pixels).to_string())),
        maybe(origins.map(|o| o.discretisation.to_string())),
        maybe(origins.map(|o| o.rounding.to_string())),
        maybe(origins.map(|o| o.storage.to_string())),
        maybe(origins.map(|o| o.statistical.to_string())),
    ];
    fields.join(",")
}

/// As RFC 4180 has it.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// What the scene itself chooses, and the slopes.
pub(super) fn summary(report: &Report) -> String {
    let reference = &report.reference;
    let [width, height] = report.size;
    let mut text = format!(
        "reference {width} x {height}, known at {} of {} pixels, its error at most {:.2e} lx ({}), {:.1} s\n",
        reference.pixels,
        reference.of,
        reference.max_error,
        reference.kind.replace('-', " "),
        reference.seconds
    );
    for (series, row) in chosen(report) {
        text += &format!(
            "{}: {} {}, {:.1} ms, error at most {:.2e} lx, rms {:.2e} lx, {:.2} of what accuracy allows{}\n",
            way(series.engine, series.backend),
            series.quantity.name(),
            value(series.quantity, row.value),
            row.draw_ms,
            row.error.max,
            row.error.rms,
            row.error.share,
            row.predicted.filter(|p| !p.held(row.error.pixels)).map_or(String::new(), |p| format!(
                "; {} of {} pixels are worse than predicted",
                p.beyond, row.error.pixels
            )),
        );
    }
    for series in &report.series {
        if let Some(slope) = series.slope {
            let theory = series.theory.map(|t| format!(", in theory {}", exponent(t.slope))).unwrap_or_default();
            text += &format!("{}: slope {:.2}{theory}, over {} pictures\n", name(series), slope.value, slope.rows);
        }
    }
    for omitted in &report.left_out {
        let ladder = omitted.quantity.map(|q| {
            let values: Vec<String> = omitted.values.iter().map(|v| value(q, *v)).collect();
            format!(", {} {}", q.name(), values.join(", "))
        });
        let what = way(omitted.engine, omitted.backend) + &ladder.unwrap_or_default();
        text += &format!("left out {what}: {}\n", omitted.reason);
    }
    text + &format!("spent    {:.1} s of {} s\n", report.spent, report.budget)
}
