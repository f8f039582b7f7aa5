//! The document.

use crate::output::{diagnostics_json, number, origins_json};
use runtime::report::{LeftOut, Report, Row, Series};
use serde_json::{Value, json};

pub(super) fn body(report: &Report) -> Value {
    let reference = &report.reference;
    json!({
        "ok": true,
        "scene": report.scene,
        "size": report.size,
        "accuracy": report.accuracy,
        "white_lx": number(report.white),
        "budget_s": report.budget,
        "spent_s": report.spent,
        "edge_pixels": report.edges,
        "reference": {
            "kind": reference.kind,
            "pixels": reference.pixels,
            "of": reference.of,
            "samples": reference.samples,
            "rtol": reference.rtol,
            "max_error_lx": number(reference.max_error),
            "rms_error_lx": number(reference.rms_error),
            "evaluations": reference.evaluations,
            "draw_ms": reference.seconds * 1e3,
        },
        "series": report.series.iter().map(series).collect::<Vec<_>>(),
        "left_out": report.left_out.iter().map(left_out).collect::<Vec<_>>(),
        "diagnostics": diagnostics_json(&report.warnings, &report.sources),
    })
}

fn series(series: &Series) -> Value {
    json!({
        "engine": series.engine,
        "adapter": series.adapter,
        "backend": series.backend,
        "quantity": series.quantity.name(),
        "slope": series.slope.map(|s| json!({ "measured": s.value, "r2": s.r2, "rows": s.rows })),
        "theory": series.theory.map(|t| json!({ "slope": t.slope, "reason": t.reason })),
        "rows": series.rows.iter().map(row).collect::<Vec<_>>(),
    })
}

fn row(row: &Row) -> Value {
    json!({
        "value": row.value,
        "chosen": row.chosen,
        "pareto": row.pareto,
        "steps": row.steps,
        "compile_ms": row.compile_ms,
        "build_ms": row.build_ms,
        "draw_ms": row.draw_ms,
        "draws": row.draws,
        "clock": row.clock,
        "evaluations": row.evaluations,
        "paths": row.paths,
        "error": {
            "pixels": row.error.pixels,
            "max_lx": number(row.error.max),
            "rms_lx": number(row.error.rms),
            "mean_lx": number(row.error.mean),
            "share": number(row.error.share),
            "flip": row.flip.map(number),
        },
        "edges": { "pixels": row.edges.pixels, "max_lx": number(row.edges.max) },
        "predicted": row.predicted.map(|p| json!({
            "kind": p.kind,
            "max_lx": number(p.max),
            "share": number(p.share),
            "origins": p.origins.map(origins_json),
            "pixels_beyond": p.beyond,
            "held": p.held(row.error.pixels),
            "median_ratio": p.median_ratio.map(number),
        })),
        "faults": row.faults,
    })
}

fn left_out(omitted: &LeftOut) -> Value {
    json!({
        "engine": omitted.engine,
        "backend": omitted.backend,
        "quantity": omitted.quantity.map(|q| q.name()),
        "values": omitted.values,
        "reason": omitted.reason,
    })
}
