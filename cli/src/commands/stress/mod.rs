//! `vol stress`

use super::read;
use crate::args::{Format, Stress as Arguments};
use crate::output::{Exit, document, number, progress, say, trouble};
use compiler::ir::Backend;
use runtime::frame::{Cause, EngineChoice, FileLoader, Trouble};
use runtime::stress::{Look, Outcome, Request, Trial, Verdict, as_it_is, invent, stress};
use serde_json::{Value, json};

/// Scenes that are carried along to put the program itself on trial, by the name of what is nasty about each.
const TRIAL: [(&str, &str); 9] = [
    ("jumps.vol", include_str!("trial/jumps.vol")),
    ("thin_shell.vol", include_str!("trial/thin_shell.vol")),
    ("planet.vol", include_str!("trial/planet.vol")),
    ("touching_faces.vol", include_str!("trial/touching_faces.vol")),
    ("steep_transfer.vol", include_str!("trial/steep_transfer.vol")),
    ("nanometres.vol", include_str!("trial/nanometres.vol")),
    ("narrow_lobe.vol", include_str!("trial/narrow_lobe.vol")),
    ("noise.vol", include_str!("trial/noise.vol")),
    ("paths.vol", include_str!("trial/paths.vol")),
];

pub(super) fn run(format: Format, arguments: &Arguments) -> Result<Exit, Trouble> {
    let loader = FileLoader::default();
    let (engine, adapter) = arguments.engine.choice();
    if engine == EngineChoice::Reference {
        let hint = Some("`--engine gpu` or `--engine cpu`");
        return Err(trouble(Cause::Arguments, "E0643", "everything is compared with the reference already", hint));
    }
    let request = Request {
        sets: arguments.set.clone(),
        backend: arguments.backend.map(|b| b.backend()).filter(|b| *b != Backend::Auto),
        engine: Some(engine).filter(|e| *e != EngineChoice::Auto),
        adapter,
        budget: arguments.budget.unwrap_or(if arguments.invent.is_some() { 2.0 } else { 60.0 }),
        seed: arguments.seed,
    };
    if let Some(number) = arguments.show {
        say(&invent(number));
        return Ok(Exit::Done);
    }
    if let Some(count) = arguments.invent {
        return Ok(invented(format, arguments.seed..arguments.seed.saturating_add(count), &loader, &request));
    }
    let scenes: Vec<(String, String)> = match &arguments.scene {
        Some(name) => vec![(name.clone(), read(&loader, name)?)],
        None => TRIAL.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect(),
    };
    let mut trials = vec![];
    for (name, text) in &scenes {
        let bar = progress(format, name);
        if format == Format::Human {
            say(&format!("{name}\n"));
        }
        let tell = |share: f64, what: &str| {
            bar.set_position((share * 1000.0) as u64);
            bar.set_message(what.to_owned());
        };
        let trial = stress(name, text, &loader, &request, &tell, &mut |outcome| {
            if format == Format::Human {
                bar.suspend(|| say(&line(outcome)));
            }
        });
        bar.finish_and_clear();
        trials.push(trial?);
    }
    Ok(finish(format, &trials))
}

/// Tries invented scenes; those that fail are shown.
fn invented(format: Format, numbers: std::ops::Range<u64>, loader: &FileLoader, request: &Request) -> Exit {
    let count = (numbers.end - numbers.start).max(1) as f64;
    let bar = progress(format, "invented scenes");
    let mut trials = vec![];
    for number in numbers.clone() {
        bar.set_position(((number - numbers.start) as f64 / count * 1000.0) as u64);
        bar.set_message(number.to_string());
        let (name, text) = (format!("invented-{number}.vol"), invent(number));
        let trial = as_it_is(&name, &text, loader, request);
        if format == Format::Human && trial.counts()[2] > 0 {
            let failed = trial.outcomes.iter().filter(|o| matches!(o.verdict, Verdict::Failed(_)));
            let lines: String = failed.map(line).collect();
            bar.suspend(|| say(&format!("{name}\n{text}{lines}")));
        }
        trials.push(trial);
    }
    bar.finish_and_clear();
    finish(format, &trials)
}

/// The median over pictures of how much larger the reported error is than the measured one.
fn useful(trials: &[Trial], backend: &str) -> Option<f64> {
    let outcomes = trials.iter().flat_map(|t| &t.outcomes).filter(|o| o.backend.unwrap_or(o.engine) == backend);
    let mut all: Vec<f64> = outcomes.filter_map(|o| o.look?.useful).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied()
}

fn finish(format: Format, trials: &[Trial]) -> Exit {
    let sum = |i: usize| trials.iter().map(|t| t.counts()[i]).sum::<usize>();
    let [passed, refused, failed, left_out] = [0, 1, 2, 3].map(sum);
    match format {
        Format::Human => {
            for backend in ["raymarch", "slicing", "splatting", "cpu"] {
                if let Some(ratio) = useful(trials, backend) {
                    say(&format!("{backend}: reported over measured error, median of pictures: {ratio:.1}\n"));
                }
            }
            say(&format!(
                "{passed} passed, {refused} refused as they should be, {failed} failed, {left_out} left out\n"
            ));
        }
        Format::Json => document(
            "vol.stress",
            json!({
                "ok": failed == 0,
                "passed": passed,
                "refused": refused,
                "failed": failed,
                "left_out": left_out,
                "scenes": trials.iter().map(scene).collect::<Vec<_>>(),
            }),
        ),
    }
    if failed == 0 { Exit::Done } else { Exit::Input }
}

fn verdict(outcome: &Outcome) -> (&'static str, Vec<&str>) {
    match &outcome.verdict {
        Verdict::Passed => ("pass", vec![]),
        Verdict::Refused(reason) => ("refused", vec![reason]),
        Verdict::Failed(reasons) => ("fail", reasons.iter().map(String::as_str).collect()),
        Verdict::LeftOut(reason) => ("left out", vec![reason]),
    }
}

fn line(outcome: &Outcome) -> String {
    let (word, reasons) = verdict(outcome);
    let way = outcome.backend.map_or_else(|| outcome.engine.to_owned(), |b| format!("{} {b}", outcome.engine));
    let look = outcome.look.map(|look| format!(": {}", words(&look))).unwrap_or_default();
    let mut text = format!("  {word:8}  {way}, {}{look}\n", outcome.case.name);
    for reason in reasons {
        text += &format!("            {reason}\n");
    }
    text
}

/// What a picture is like.
fn words(look: &Look) -> String {
    let [least, mean, most] = look.radiance;
    let mut text = format!("{least:.3e} to {most:.3e} lx, mean {mean:.3e}");
    if look.compared > 0 {
        text += &format!("; error {:.2e} lx on {} pixels", look.error, look.compared);
    }
    if let Some(reported) = look.reported {
        text += &format!(", reported {reported:.2e}");
    }
    if look.apart > 0 {
        text += &format!(", {} on edges apart", look.apart);
    }
    text
}

fn scene(trial: &Trial) -> Value {
    json!({
        "scene": trial.scene,
        "spent_s": trial.spent,
        "cases": trial.outcomes.iter().map(case).collect::<Vec<_>>(),
    })
}

fn case(outcome: &Outcome) -> Value {
    let (word, reasons) = verdict(outcome);
    json!({
        "group": outcome.case.group,
        "case": outcome.case.name,
        "engine": outcome.engine,
        "backend": outcome.backend,
        "verdict": word,
        "reasons": reasons,
        "picture": outcome.look.map(|look| json!({
            "size": look.size,
            "least_lx": number(look.radiance[0]),
            "mean_lx": number(look.radiance[1]),
            "most_lx": number(look.radiance[2]),
            "compared": look.compared,
            "error_lx": number(look.error),
            "reported_lx": look.reported.map(number),
            "apart": look.apart,
            "reported_over_measured": look.useful.map(number),
        })),
        "milliseconds": outcome.milliseconds,
    })
}
