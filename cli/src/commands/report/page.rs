//! The page: one file, no network, light and dark.

use super::figures::{against_time, against_work, falling, keys, predicted, quantities};
use super::plot::{self, Plot, escaped, marker};
use super::{chosen, name, short, value, way};
use crate::output::origins_text;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use runtime::image::{Shown, png_bytes};
use runtime::report::{Comparison, Report, Row, Series};
use std::fmt::Write;

const STYLE: &str = include_str!("page.css");

/// Differences are shown from this part of display white to all of it, in decades.
const DECADES: f32 = 6.0;
/// Colours from no difference to one as large as display white: inferno's, at equal distances (Smith and van der Walt 2015).
const SCALE: [[f32; 3]; 6] = [
    [0.001, 0.000, 0.014],
    [0.258, 0.039, 0.406],
    [0.578, 0.148, 0.404],
    [0.865, 0.317, 0.226],
    [0.988, 0.645, 0.040],
    [0.988, 0.998, 0.645],
];

pub(super) fn html(report: &Report, scene: &str) -> String {
    let mut page = String::new();
    let title = format!("{}: error against run time", report.scene);
    let _ = write!(
        page,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{0}</title>\n\
         <style>\n{1}{STYLE}</style>\n</head>\n<body>\n<h1>{0}</h1>\n",
        escaped(&title),
        plot::STYLE,
    );
    page += &facts(report);
    page += "<h2>What the scene itself chooses</h2>\n";
    page += &choices(report);
    page += "<h2>Error against time</h2>\n";
    page += &figure(
        &against_time(report),
        &report.series.iter().collect::<Vec<_>>(),
        "The front joins the pictures that no other beats in both error and time.",
    );
    page += "<h2>How the error falls</h2>\n<div class=\"pair\">\n";
    for quantity in quantities(report) {
        let own: Vec<&Series> = report.series.iter().filter(|s| s.quantity == quantity && s.rows.len() > 1).collect();
        if !own.is_empty() {
            page += &figure(
                &falling(report, quantity),
                &own,
                "Thin lines: the largest error. Dashed: the slope of theory.",
            );
        }
    }
    page += "</div>\n<h2>Predicted and measured</h2>\n<div class=\"pair\">\n";
    let all: Vec<&Series> = report.series.iter().collect();
    page += &figure(
        &predicted(report),
        &all,
        "Above the diagonal a picture is worse at its worst pixel than the engine said.",
    );
    if report.series.iter().flat_map(|s| &s.rows).any(|r| r.evaluations.is_some_and(|n| n > 0)) {
        page += &figure(&against_work(report), &all, "A count that does not depend on the machine.");
    }
    page += "</div>\n<h2>Where the time goes</h2>\n";
    page += &times(report);
    page += "<h2>Pictures</h2>\n";
    page += &pictures(report);
    page += "<h2>Every picture in numbers</h2>\n";
    page += &rows(report);
    page += "<h2>Left out</h2>\n";
    page += &left_out(report);
    let _ = write!(page, "<h2>The scene</h2>\n<pre>{}</pre>\n</body>\n</html>\n", escaped(scene));
    page
}

fn facts(report: &Report) -> String {
    let reference = &report.reference;
    let tolerance = match reference.rtol {
        Some(rtol) => format!("to a relative tolerance of {rtol:.0e} along each ray"),
        None => format!("along {} random paths of each pixel", reference.samples),
    };
    let known = if reference.pixels == reference.of {
        "every pixel".to_owned()
    } else {
        format!(
            "{} of {} pixels, spread over the picture; the budget ended it, and FLIP is left out",
            reference.pixels, reference.of
        )
    };
    let adapter = report.series.iter().find_map(|s| s.adapter.clone()).unwrap_or_else(|| "none".into());
    let rows = [
        ("Picture", format!("{} × {} pixels", report.size[0], report.size[1])),
        ("Graphics adapter", escaped(&adapter)),
        (
            "Reference",
            format!(
                "f64, {tolerance}, {known}; its own error is at most {} lx ({}), rms {} lx; {:.1} s",
                short(reference.max_error),
                reference.kind.replace('-', " "),
                short(reference.rms_error),
                reference.seconds
            ),
        ),
        (
            "Allowed",
            format!(
                "accuracy {:e} of {} lx (display white) or of the pixel, whichever is larger",
                report.accuracy,
                short(report.white)
            ),
        ),
        ("Edges", format!("{} pixels straddle an edge and are counted apart", report.edges)),
        ("Time", format!("{:.1} s of {} s", report.spent, report.budget)),
    ];
    let rows: String = rows.iter().map(|(k, v)| format!("<tr><th>{k}</th><td>{v}</td></tr>\n")).collect();
    format!("<table class=\"facts\">\n{rows}</table>\n")
}

fn choices(report: &Report) -> String {
    let mut out = String::new();
    for (series, row) in chosen(report) {
        let verdict = if row.error.share <= 1.0 { "within" } else { "not within" };
        let said = row.predicted.map_or(String::new(), |p| {
            let held = if p.held(row.error.pixels) {
                "held at every pixel".to_owned()
            } else {
                format!("<b>exceeded at {} of {} pixels</b>", p.beyond, row.error.pixels)
            };
            let origins = p.origins.map_or(String::new(), |o| format!(" Of which at most {}.", origins_text(o)));
            format!(" Predicted: at most {} lx ({}), {held}.{origins}", short(p.max), p.kind.replace('-', " "))
        });
        let _ = writeln!(
            out,
            "<p><b>{}</b>: {}; drawn in {} ms, error at most {} lx and rms {} lx, {verdict} what accuracy allows ({} of it).{said}</p>",
            way(series.engine, series.backend),
            escaped(&row.steps),
            short(row.draw_ms),
            short(row.error.max),
            short(row.error.rms),
            short(row.error.share),
        );
    }
    let mut ways: Vec<String> = vec![];
    for series in &report.series {
        let own = way(series.engine, series.backend);
        let drawn = chosen(report).any(|(s, _)| way(s.engine, s.backend) == own);
        if !drawn && !ways.contains(&own) {
            let _ = writeln!(out, "<p><b>{own}</b>: not drawn as the scene says; why, stands below.</p>");
            ways.push(own);
        }
    }
    if out.is_empty() { "<p>Nothing could be drawn.</p>\n".into() } else { out }
}

/// A plot with its legend.
fn figure(plot: &Plot, series: &[&Series], note: &str) -> String {
    let mut legend = String::new();
    for key in keys(series) {
        let _ = write!(
            legend,
            "<span class=\"key\"><svg viewBox=\"0 0 14 14\" width=\"14\" height=\"14\"><g class=\"mark s{}\">{}</g></svg>{}</span> ",
            key.colour,
            marker(key.marker, 7.0, 7.0),
            escaped(&key.text),
        );
    }
    legend += "<span class=\"key\"><svg viewBox=\"0 0 20 20\" width=\"16\" height=\"16\"><circle class=\"ring\" cx=\"10\" cy=\"10\" r=\"8\"/></svg>as the scene says</span>";
    format!(
        "<figure>\n<figcaption>{}</figcaption>\n{}<p class=\"legend\">{legend}</p>\n<p class=\"small\">{}</p>\n</figure>\n",
        escaped(&plot.title),
        plot.svg(),
        escaped(note)
    )
}

/// Bars of the scene's own pictures.
fn times(report: &Report) -> String {
    let all: Vec<(&Series, &Row)> = chosen(report).collect();
    let total = |r: &Row| r.compile_ms + r.build_ms + r.draw_ms;
    let longest = all.iter().map(|(_, r)| total(r)).fold(1e-9, f64::max);
    let mut out = String::from("<table class=\"bars\">\n");
    for (series, row) in all {
        let part = |ms: f64, class: &str| {
            format!(
                "<i class=\"{class}\" style=\"width:{:.2}%\" title=\"{class} {} ms\"></i>",
                100.0 * ms / longest,
                short(ms)
            )
        };
        let _ = writeln!(
            out,
            "<tr><th>{}</th><td><div class=\"bar\">{}{}{}</div><span class=\"small\">compile {} ms, build {} ms, draw {} ms ({})</span></td></tr>",
            way(series.engine, series.backend),
            part(row.compile_ms, "compile"),
            part(row.build_ms, "build"),
            part(row.draw_ms, "draw"),
            short(row.compile_ms),
            short(row.build_ms),
            short(row.draw_ms),
            if row.clock == "gpu" { "the GPU's clock" } else { "wall clock" },
        );
    }
    out + "</table>\n<p class=\"small\"><i class=\"swatch compile\"></i> compile: text to validated shaders <i class=\"swatch build\"></i> build: pipelines and grids <i class=\"swatch draw\"></i> draw</p>\n"
}

fn pictures(report: &Report) -> String {
    let mut out = String::from("<div class=\"pictures\">\n");
    let _ = writeln!(out, "<figure>{}<figcaption>Reference</figcaption></figure>", picture(&report.picture));
    out += "</div>\n";
    for series in &report.series {
        let kept: Vec<(&Row, &Comparison)> =
            series.rows.iter().filter_map(|r| Some((r, r.picture.as_ref()?))).collect();
        let _ = write!(out, "<h3>{}</h3>\n<div class=\"pictures\">\n", escaped(&name(series)));
        for (row, comparison) in kept {
            let own = if row.chosen { ", as the scene says" } else { "" };
            let flip = row.flip.map(|f| format!(", FLIP {}", short(f))).unwrap_or_default();
            let _ = writeln!(
                out,
                "<figure>{}{}<figcaption>{} {}{own}<br>rms {} lx{flip}</figcaption></figure>",
                picture(&comparison.shown),
                picture(&heat(comparison, report.white)),
                series.quantity.name(),
                value(series.quantity, row.value),
                short(row.error.rms),
            );
        }
        out += "</div>\n";
    }
    let stops: Vec<String> = SCALE.iter().map(|c| css(*c)).collect();
    let _ = write!(
        out,
        "<div class=\"scale\"><span>{} lx</span><i style=\"background:linear-gradient(90deg,{})\"></i><span>{} lx</span></div>\n\
         <p class=\"small\">The right picture of each pair is the largest difference of a pixel’s bands from the reference, on a logarithmic scale; grey where the reference is not known. FLIP (Andersson et al. 2020) is the mean over the picture as shown, edges included.</p>\n",
        short(report.white * 10f64.powf(f64::from(-DECADES))),
        stops.join(","),
        short(report.white)
    );
    out
}

fn css(colour: [f32; 3]) -> String {
    let [r, g, b] = colour.map(|c| (c * 255.0).round() as u8);
    format!("rgb({r},{g},{b})")
}

/// A map of differences in colours.
fn heat(comparison: &Comparison, white: f64) -> Shown {
    let pixel = |d: &f32| {
        if d.is_nan() {
            return [0.5; 3];
        }
        let place = ((d / white as f32).max(1e-30).log10() / DECADES + 1.0).clamp(0.0, 1.0) * (SCALE.len() - 1) as f32;
        let low = (place as usize).min(SCALE.len() - 2);
        let part = place - low as f32;
        std::array::from_fn(|c| SCALE[low][c] * (1.0 - part) + SCALE[low + 1][c] * part)
    };
    let Shown { width, height, .. } = comparison.shown;
    Shown { width, height, pixels: comparison.difference.iter().map(pixel).collect() }
}

/// A picture inside the page.
fn picture(shown: &Shown) -> String {
    let Ok(bytes) = png_bytes(shown) else { return String::new() };
    format!(
        "<img width=\"{}\" height=\"{}\" alt=\"\" src=\"data:image/png;base64,{}\">",
        shown.width,
        shown.height,
        STANDARD.encode(bytes)
    )
}

fn rows(report: &Report) -> String {
    let mut out = String::from(
        "<div class=\"wide\"><table class=\"rows\">\n<tr><th>drawn by</th><th>varied</th><th>value</th><th>draw / ms</th><th>build / ms</th><th>evaluations</th><th>paths</th>\
         <th>max / lx</th><th>rms / lx</th><th>mean / lx</th><th>of allowed</th><th>FLIP</th><th>edges, max / lx</th><th>predicted / lx</th><th>worse than predicted</th></tr>\n",
    );
    let count = |n: Option<u64>| n.map_or(String::new(), |n| n.to_string());
    for series in &report.series {
        for row in &series.rows {
            let (said, beyond) = row
                .predicted
                .map_or_else(Default::default, |p| (short(p.max), format!("{} of {}", p.beyond, row.error.pixels)));
            let broken = row.predicted.is_some_and(|p| !p.held(row.error.pixels));
            let cells = [
                way(series.engine, series.backend),
                series.quantity.name().into(),
                value(series.quantity, row.value)
                    + if row.chosen { " ◯" } else { "" }
                    + if row.pareto { " ★" } else { "" },
                short(row.draw_ms),
                short(row.build_ms),
                count(row.evaluations),
                count(row.paths),
                short(row.error.max),
                short(row.error.rms),
                short(row.error.mean),
                short(row.error.share),
                row.flip.map(short).unwrap_or_default(),
                if row.edges.pixels > 0 { short(row.edges.max) } else { String::new() },
                said,
                if broken { format!("<b>{beyond}</b>") } else { beyond },
            ];
            let class = if row.chosen { " class=\"chosen\"" } else { "" };
            let _ = writeln!(out, "<tr{class}>{}</tr>", cells.map(|c| format!("<td>{c}</td>")).concat());
            for fault in &row.faults {
                let _ = writeln!(out, "<tr><td></td><td colspan=\"14\"><b>{}</b></td></tr>", escaped(fault));
            }
        }
    }
    out + "</table></div>\n<p class=\"small\">◯ as the scene says; ★ on the front. Errors over pixels off edges.</p>\n"
}

fn left_out(report: &Report) -> String {
    if report.left_out.is_empty() {
        return "<p>Nothing.</p>\n".into();
    }
    let mut out = String::from("<ul>\n");
    for omitted in &report.left_out {
        let ladder = omitted.quantity.map_or(String::new(), |q| {
            let values: Vec<String> = omitted.values.iter().map(|v| value(q, *v)).collect();
            format!(", {} {}", q.name(), values.join(", "))
        });
        let _ = writeln!(
            out,
            "<li><b>{}{ladder}</b>: {}</li>",
            way(omitted.engine, omitted.backend),
            escaped(&omitted.reason)
        );
    }
    out + "</ul>\n"
}
