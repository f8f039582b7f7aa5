//! The page: one file, no network, light and dark.

use super::plot::{Curve, Guide, Marker, Plot, Point, escaped, marker};
use super::{chosen, name, value, way};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use runtime::image::{Shown, png_bytes};
use runtime::report::{Comparison, Quantity, Report, Row, Series};
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
         <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{0}</h1>\n",
        escaped(&title)
    );
    page += &facts(report);
    page += "<h2>What the scene itself chooses</h2>\n";
    page += &choices(report);
    page += "<h2>Error against time</h2>\n";
    page += &figure(
        report,
        &against_time(report),
        &report.series.iter().collect::<Vec<_>>(),
        "The front joins the pictures that no other beats in both error and time.",
    );
    page += "<h2>How the error falls</h2>\n<div class=\"pair\">\n";
    for quantity in quantities(report) {
        let own: Vec<&Series> = report.series.iter().filter(|s| s.quantity == quantity && s.rows.len() > 1).collect();
        if !own.is_empty() {
            page += &figure(
                report,
                &falling(report, quantity),
                &own,
                "Thin lines: the largest error. Dashed: the slope of theory.",
            );
        }
    }
    page += "</div>\n<h2>Predicted and measured</h2>\n<div class=\"pair\">\n";
    let all: Vec<&Series> = report.series.iter().collect();
    page += &figure(
        report,
        &predicted(report),
        &all,
        "Above the diagonal a picture is worse at its worst pixel than the engine said.",
    );
    if report.series.iter().flat_map(|s| &s.rows).any(|r| r.evaluations.is_some_and(|n| n > 0)) {
        page += &figure(report, &against_work(report), &all, "A count that does not depend on the machine.");
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
            let origins = p.origins.map_or(String::new(), |o| {
                let [discretisation, rounding, storage] = [o.discretisation, o.rounding, o.storage].map(short);
                format!(
                    " At most {discretisation} lx of it are of discretisation, {rounding} of rounding, {storage} of storage."
                )
            });
            format!(" Predicted: at most {} lx ({}), {held}.{origins}", short(p.max), p.kind.replace('-', " "))
        });
        let _ = writeln!(
            out,
            "<p><b>{}</b>: {}; drawn in {} ms, error at most {} lx and rms {} lx, {verdict} what accuracy allows ({:.2} of it).{said}</p>",
            way(series.engine, series.backend),
            escaped(&row.steps),
            short(row.draw_ms),
            short(row.error.max),
            short(row.error.rms),
            row.error.share,
        );
    }
    if out.is_empty() { "<p>Nothing could be drawn.</p>\n".into() } else { out }
}

/// Which of the colours a way to draw has.
fn colour(report: &Report, series: &Series) -> usize {
    let mut ways: Vec<String> = vec![];
    for s in &report.series {
        let way = way(s.engine, s.backend);
        if !ways.contains(&way) {
            ways.push(way);
        }
    }
    let own = way(series.engine, series.backend);
    ways.iter().position(|w| *w == own).unwrap_or(0) % 6
}

fn shape(quantity: Quantity) -> Marker {
    match quantity {
        Quantity::Accuracy => Marker::Circle,
        Quantity::Steps => Marker::Square,
        Quantity::Slices | Quantity::Splats => Marker::Diamond,
        Quantity::Samples => Marker::Triangle,
    }
}

fn quantities(report: &Report) -> Vec<Quantity> {
    let mut found: Vec<Quantity> = report.series.iter().map(|s| s.quantity).collect();
    found.sort_unstable();
    found.dedup();
    found
}

fn curve(report: &Report, series: &Series, place: impl Fn(&Row) -> Option<(f64, f64)>) -> Curve {
    let point = |row: &Row| {
        let (x, y) = place(row)?;
        let title = format!(
            "{} {}: {} ms, rms {} lx, max {} lx",
            name(series),
            value(series.quantity, row.value),
            short(row.draw_ms),
            short(row.error.rms),
            short(row.error.max)
        );
        Some(Point { x, y, title, ring: row.chosen })
    };
    Curve {
        points: series.rows.iter().filter_map(point).collect(),
        colour: colour(report, series),
        marker: shape(series.quantity),
        joined: true,
        faint: false,
    }
}

/// What accuracy allows at a black pixel, and what the reference can tell.
fn levels(report: &Report) -> Vec<(f64, String)> {
    vec![
        (report.accuracy * report.white, "accuracy allows".into()),
        (report.reference.rms_error, "error of the reference".into()),
    ]
}

fn against_time(report: &Report) -> Plot {
    let mut front: Vec<(f64, f64)> =
        report.series.iter().flat_map(|s| &s.rows).filter(|r| r.pareto).map(|r| (r.draw_ms, r.error.rms)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    Plot {
        title: "Error against time to draw".into(),
        x: "time to draw / ms".into(),
        y: "rms error / lx".into(),
        curves: report.series.iter().map(|s| curve(report, s, |r| Some((r.draw_ms, r.error.rms)))).collect(),
        guides: vec![Guide { points: front, class: "front", label: "front".into() }],
        levels: levels(report),
    }
}

fn against_work(report: &Report) -> Plot {
    let place = |r: &Row| r.evaluations.filter(|n| *n > 0).map(|n| (n as f64, r.error.rms));
    Plot {
        title: "Error against field evaluations".into(),
        x: "field evaluations of the picture".into(),
        y: "rms error / lx".into(),
        curves: report.series.iter().map(|s| curve(report, s, place)).collect(),
        guides: vec![],
        levels: levels(report),
    }
}

fn falling(report: &Report, quantity: Quantity) -> Plot {
    let (mut curves, mut guides) = (vec![], vec![]);
    for series in report.series.iter().filter(|s| s.quantity == quantity && s.rows.len() > 1) {
        curves.push(Curve { faint: true, ..curve(report, series, |r| Some((r.value, r.error.max))) });
        curves.push(curve(report, series, |r| Some((r.value, r.error.rms))));
        if let (Some(theory), Some(slope)) = (series.theory, series.slope) {
            let ends = [series.rows.first(), series.rows.last()].map(|r| r.map_or(1.0, |r| r.value));
            // Through the middle of what was fitted, which is the fine end.
            let fitted = series.rows.len().saturating_sub(slope.rows as usize);
            let middle = (series.rows[fitted].value * ends[1]).sqrt();
            let at = |x: f64| (x, slope.at(middle) * (x / middle).powf(theory.slope));
            guides.push(Guide {
                points: ends.map(at).to_vec(),
                class: "theory",
                label: format!("slope {} in theory: {}", theory.slope, theory.reason),
            });
        }
    }
    Plot {
        title: format!("Error against {}", quantity.name()),
        x: match quantity {
            Quantity::Accuracy => "accuracy".into(),
            Quantity::Steps => "steps along a ray".into(),
            Quantity::Slices => "slices across the media".into(),
            Quantity::Splats => "splats in the media".into(),
            Quantity::Samples => "samples: paths of a pixel".into(),
        },
        y: "rms error / lx".into(),
        curves,
        guides,
        levels: levels(report),
    }
}

fn predicted(report: &Report) -> Plot {
    let place = |r: &Row| r.predicted.filter(|p| p.max > 0.0 && r.error.max > 0.0).map(|p| (p.max, r.error.max));
    let curves: Vec<Curve> = report.series.iter().map(|s| Curve { joined: false, ..curve(report, s, place) }).collect();
    let ends = |f: fn(&Point) -> f64| {
        let all = curves.iter().flat_map(|c| &c.points).map(f);
        all.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)))
    };
    let (x, y) = (ends(|p| p.x), ends(|p| p.y));
    let (low, high) = (x.0.max(y.0), x.1.min(y.1));
    let diagonal = if low < high { vec![(low, low), (high, high)] } else { vec![] };
    Plot {
        title: "Measured against predicted error".into(),
        x: "predicted at the worst pixel / lx".into(),
        y: "measured at the worst pixel / lx".into(),
        curves,
        guides: vec![Guide { points: diagonal, class: "theory", label: "as predicted".into() }],
        levels: vec![],
    }
}

/// A plot with its legend.
fn figure(report: &Report, plot: &Plot, series: &[&Series], note: &str) -> String {
    let mut legend = String::new();
    for s in series {
        let slope = match (s.slope, s.theory) {
            (Some(slope), Some(theory)) => format!(" (slope {:.2}, theory {})", slope.value, theory.slope),
            (Some(slope), None) => format!(" (slope {:.2})", slope.value),
            (None, _) => String::new(),
        };
        let _ = write!(
            legend,
            "<span class=\"key\"><svg viewBox=\"0 0 14 14\" width=\"14\" height=\"14\"><g class=\"mark s{}\">{}</g></svg>{}{}</span> ",
            colour(report, s),
            marker(shape(s.quantity), 7.0, 7.0),
            escaped(&name(s)),
            slope
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
         <p class=\"small\">The right picture of each pair is the largest difference of a pixel’s bands from the reference, on a logarithmic scale; grey where the reference is not known.</p>\n",
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
                format!("{:.2}", row.error.share),
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
