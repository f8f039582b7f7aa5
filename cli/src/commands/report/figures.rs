//! Which plots there are of a report, and their keys.

use super::plot::{Curve, Guide, Key, Marker, Plot, Point};
use super::{name, short, value};
use compiler::backends::REGISTRY;
use runtime::report::{Quantity, Report, Row, Series};

/// Colours of the style sheet.
const COLOURS: usize = 6;

/// The plot that tells most, as a file of its own.
pub(super) fn file(report: &Report) -> String {
    against_time(report).file(&keys(&report.series.iter().collect::<Vec<_>>()))
}

/// What the curves of a plot are.
pub(super) fn keys(series: &[&Series]) -> Vec<Key> {
    let key = |s: &&Series| {
        let slope = match (s.slope, s.theory) {
            (Some(slope), Some(theory)) => format!(" (slope {:.2}, theory {})", slope.value, exponent(theory.slope)),
            (Some(slope), None) => format!(" (slope {:.2})", slope.value),
            (None, _) => String::new(),
        };
        Key { colour: colour(s), marker: shape(s.quantity), text: name(s) + &slope }
    };
    series.iter().map(key).collect()
}

/// Of two digits, as they are written: −2, −0.67.
pub(super) fn exponent(slope: f64) -> String {
    ((slope * 100.0).round() / 100.0).to_string()
}

/// Which of the colours a way to draw has: the same in every report.
fn colour(series: &Series) -> usize {
    let known = |backend| REGISTRY.iter().position(|b| b.word == backend).unwrap_or(0);
    // The processor's comes after all backends.
    series.backend.map_or(REGISTRY.len(), known) % COLOURS
}

fn shape(quantity: Quantity) -> Marker {
    match quantity {
        Quantity::Accuracy => Marker::Circle,
        Quantity::Steps => Marker::Square,
        Quantity::Slices | Quantity::Splats => Marker::Diamond,
        Quantity::Samples => Marker::Triangle,
    }
}

pub(super) fn quantities(report: &Report) -> Vec<Quantity> {
    let mut found: Vec<Quantity> = report.series.iter().map(|s| s.quantity).collect();
    found.sort_unstable();
    found.dedup();
    found
}

fn curve(series: &Series, place: impl Fn(&Row) -> Option<(f64, f64)>) -> Curve {
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
        colour: colour(series),
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

pub(super) fn against_time(report: &Report) -> Plot {
    let mut front: Vec<(f64, f64)> =
        report.series.iter().flat_map(|s| &s.rows).filter(|r| r.pareto).map(|r| (r.draw_ms, r.error.rms)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    Plot {
        title: "Error against time to draw".into(),
        x: "time to draw / ms".into(),
        y: "rms error / lx".into(),
        curves: report.series.iter().map(|s| curve(s, |r| Some((r.draw_ms, r.error.rms)))).collect(),
        guides: vec![Guide { points: front, class: "front", label: "front".into() }],
        levels: levels(report),
        diagonal: None,
    }
}

pub(super) fn against_work(report: &Report) -> Plot {
    let place = |r: &Row| r.evaluations.filter(|n| *n > 0).map(|n| (n as f64, r.error.rms));
    Plot {
        title: "Error against field evaluations".into(),
        x: "field evaluations of the picture".into(),
        y: "rms error / lx".into(),
        curves: report.series.iter().map(|s| curve(s, place)).collect(),
        guides: vec![],
        levels: levels(report),
        diagonal: None,
    }
}

pub(super) fn falling(report: &Report, quantity: Quantity) -> Plot {
    let (mut curves, mut guides) = (vec![], vec![]);
    for series in report.series.iter().filter(|s| s.quantity == quantity && s.rows.len() > 1) {
        curves.push(Curve { faint: true, ..curve(series, |r| Some((r.value, r.error.max))) });
        curves.push(curve(series, |r| Some((r.value, r.error.rms))));
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
        diagonal: None,
    }
}

pub(super) fn predicted(report: &Report) -> Plot {
    let place = |r: &Row| r.predicted.filter(|p| p.max > 0.0 && r.error.max > 0.0).map(|p| (p.max, r.error.max));
    let curves: Vec<Curve> = report.series.iter().map(|s| Curve { joined: false, ..curve(s, place) }).collect();
    Plot {
        title: "Measured against predicted error".into(),
        x: "predicted at the worst pixel / lx".into(),
        y: "measured at the worst pixel / lx".into(),
        curves,
        guides: vec![],
        levels: vec![],
        diagonal: Some("as predicted"),
    }
}
