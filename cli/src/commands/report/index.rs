//! An index of several reports: one page in Markdown, with a plot of each.

use super::figures::exponent;
use super::{chosen, short, way};
use runtime::report::Report;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

pub(super) struct Index {
    budget: f64,
    names: BTreeSet<String>,
    reports: Vec<(String, Report)>,
}

impl Index {
    pub(super) fn new(budget: f64) -> Self {
        Self { budget, names: BTreeSet::new(), reports: vec![] }
    }

    /// The name of a scene's folder: of its file, and a number where another has it.
    pub(super) fn name(&mut self, scene: &str) -> String {
        let own = Path::new(scene).file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy().into_owned());
        let own = if own == "-" { "scene".to_owned() } else { own };
        let numbered = (2..).map(|n| format!("{own}-{n}"));
        let mut names = [own.clone()].into_iter().chain(numbered);
        names.find(|name| self.names.insert(name.clone())).unwrap_or(own)
    }

    pub(super) fn add(&mut self, name: &str, report: Report) {
        self.reports.push((name.to_owned(), report));
    }

    pub(super) fn text(&self) -> String {
        let adapters: BTreeSet<&str> =
            self.reports.iter().flat_map(|(_, r)| &r.series).filter_map(|s| s.adapter.as_deref()).collect();
        let adapters = if adapters.is_empty() {
            "no graphics adapter".to_owned()
        } else {
            adapters.into_iter().collect::<Vec<_>>().join(", ")
        };
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let mut out = format!(
            "# Error against run time\n\n\
             Each scene was drawn coarser and finer by every backend and engine that can draw it, for about {} s, and each picture was compared with\n\
             the f64 reference. Made by `vol report` {} on {adapters}; {cores} cores, {} {}. The pages (`report.html`, to be opened from disk: one file each,\n\
             without scripts or network) have more plots, pictures, differences and all numbers, which also stand in `report.json` and `report.csv`.\n\n\
             Plots: rings are what the scene itself asks for; the grey band joins the pictures that no other beats in both error and time. Tables: errors in lx,\n\
             over pixels off edges; *allowed* is the largest error as a multiple of what the scene's `accuracy` allows; *predicted* is what the engine said of\n\
             its own picture, and *worse* how many pixels were worse than that.\n\n",
            self.budget,
            env!("CARGO_PKG_VERSION"),
            std::env::consts::OS,
            std::env::consts::ARCH,
        );
        for (name, _) in &self.reports {
            let _ = writeln!(out, "- [{name}](#{})", name.to_lowercase());
        }
        for (name, report) in &self.reports {
            out += &section(name, report);
        }
        out
    }
}

fn section(name: &str, report: &Report) -> String {
    let [width, height] = report.size;
    let reference = &report.reference;
    let mut out = format!(
        "\n## {name}\n\n[page]({name}/report.html) · [JSON]({name}/report.json) · [CSV]({name}/report.csv)\n\n\
         {width} × {height} pixels; the reference is known at {} of {} of them, to {} lx ({}).\n\n![Error against time to draw]({name}/report.svg)\n\n",
        reference.pixels,
        reference.of,
        short(reference.max_error),
        reference.kind.replace('-', " "),
    );
    if chosen(report).next().is_some() {
        out += "| as the scene says | steps | ms | largest error | rms | allowed | predicted | worse |\n|---|---|--:|--:|--:|--:|--:|--:|\n";
    }
    for (series, row) in chosen(report) {
        let (said, beyond) = row
            .predicted
            .map_or_else(Default::default, |p| (short(p.max), format!("{} of {}", p.beyond, row.error.pixels)));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {said} | {beyond} |",
            way(series.engine, series.backend),
            row.steps,
            short(row.draw_ms),
            short(row.error.max),
            short(row.error.rms),
            short(row.error.share),
        );
    }
    let slopes: Vec<String> = report
        .series
        .iter()
        .filter_map(|s| {
            let theory = s.theory.map_or(String::new(), |t| format!(" (theory {})", exponent(t.slope)));
            Some(format!("{} {:.2}{theory}", super::name(s), s.slope?.value))
        })
        .collect();
    if !slopes.is_empty() {
        let _ = writeln!(out, "\nSlopes: {}.", slopes.join("; "));
    }
    let cannot = report.left_out.iter().filter(|o| o.quantity.is_none());
    for omitted in cannot {
        let _ = writeln!(out, "\nNot by {}: {}.", way(omitted.engine, omitted.backend), omitted.reason);
    }
    out
}
