//! `vol render`

use super::{nanometres, read};
use crate::args::{Format, Render};
use crate::output::{
    Exit, complain, diagnostics, diagnostics_json, document, number, origins_json, origins_text, progress, say, trouble,
};
use compiler::ir::Bands;
use compiler::program::OutputKind;
use runtime::engine::gpu::Arranging;
use runtime::frame::{Cause, Drawing, FileLoader, Measured, Params, Session, Settings, Trouble};
use runtime::image::{self, Depth, WriteOptions};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Pixels that are compared with the reference.
const CHECKED: u32 = 256;
/// Fewer of them come first, and more only if they fit in so many seconds.
const LADDER: [u32; 4] = [4, 32, 128, CHECKED];
const PATIENCE: f64 = 30.0;

pub(super) fn run(format: Format, arguments: &Render) -> Result<Exit, Trouble> {
    let jobs = jobs(arguments)?;
    let loader = FileLoader::default();
    let text = read(&loader, &arguments.scene)?;
    let (engine, adapter) = arguments.engine.choice();
    let outputs = vec![
        OutputKind::Radiance,
        OutputKind::Transmittance,
        OutputKind::Error,
        OutputKind::Rounding,
        OutputKind::Storage,
        OutputKind::Evaluations,
        OutputKind::Fault,
        OutputKind::Edge,
    ];
    let options = arguments.schedule.apply(compiler::Options { outputs, size: arguments.size, ..Default::default() });
    let mut session = Session::open(
        &arguments.scene,
        &text,
        &loader,
        Settings { options, engine, adapter, seed: arguments.schedule.seed },
    )?;
    let (params, mut found) = session.params(&arguments.set)?;
    found.0.splice(0..0, session.warnings().0.iter().cloned());
    if format == Format::Human {
        diagnostics(&found, session.sources());
        if let Some(why) = session.fallback() {
            complain(&format!("note: {why}; engine cpu draws\n"));
        }
        say(&heading(&session));
    }
    let mut frames: Vec<Value> = vec![];
    let mut faulty = false;
    for (path, time) in jobs {
        let done = frame(format, arguments, &mut session, &text, (&path, time), &params)?;
        faulty |= done.drawing.faults.has_errors();
        match format {
            Format::Human => {
                say(&done.text());
                diagnostics(&done.drawing.faults, session.sources());
            }
            Format::Json => {
                found.0.extend(done.drawing.faults.0.iter().cloned());
                frames.push(done.json());
            }
        }
    }
    if format == Format::Json {
        let (compile, build) = session.milliseconds();
        let body = json!({
            "ok": !faulty,
            "engine": session.engine(),
            "adapter": session.adapter(),
            "fallback": session.fallback(),
            "backend": session.program().plan.backend,
            "steps": session.steps(),
            "bands_nm": nanometres(&session.program().bands),
            "programs": session.program().parts().count(),
            "size": session.size(),
            "accuracy": session.accuracy(),
            "compile_ms": compile,
            "build_ms": build,
            "frames": frames,
            "diagnostics": diagnostics_json(&found, session.sources()),
        });
        document("vol.render", body);
    }
    Ok(if faulty { Exit::Input } else { Exit::Done })
}

/// Files and times of the pictures to draw.
fn jobs(arguments: &Render) -> Result<Vec<(PathBuf, f64)>, Trouble> {
    let usage = |message: String, hint| trouble(Cause::Arguments, "E0649", message, hint);
    let name = arguments.output.to_string_lossy();
    let known = |e: &str| ["png", "exr", "npy"].contains(&e.to_lowercase().as_str());
    if !arguments.output.extension().is_some_and(|e| known(&e.to_string_lossy())) {
        let hint = Some("the ending says what is written: .png, .exr or .npy");
        return Err(usage(format!("`{name}` has no ending of a picture"), hint));
    }
    let Some((first, last)) = arguments.frames else { return Ok(vec![(arguments.output.clone(), arguments.time)]) };
    let Some((before, width, after)) = pattern(&name) else {
        let hint = Some("write %04d where the number of the frame belongs: frame%04d.png");
        return Err(usage(format!("`{name}` would be written over by each frame"), hint));
    };
    let job = |n: u32| {
        let file = format!("{before}{n:0width$}{after}");
        (PathBuf::from(file), arguments.time + f64::from(n) / arguments.fps)
    };
    Ok((first..=last).map(job).collect())
}

/// Splits a name at its `%04d` or `%d`.
fn pattern(name: &str) -> Option<(&str, usize, &str)> {
    let (before, rest) = name.split_once('%')?;
    let (digits, after) = rest.split_once('d')?;
    let width = if digits.is_empty() { 1 } else { digits.parse().ok().filter(|w| *w <= 20)? };
    Some((before, width, after))
}

fn heading(session: &Session) -> String {
    let adapter = session.adapter().map(|a| format!(", {a}")).unwrap_or_default();
    let (compile, build) = session.milliseconds();
    format!(
        "engine   {}{adapter}\nbackend  {}, steps: {}\n{}ready    compiled in {compile:.1} ms, built in {build:.1} ms\n",
        session.engine(),
        session.program().plan.backend,
        session.steps(),
        bands(session),
    )
}

/// What more bands than one program can draw cost.
fn bands(session: &Session) -> String {
    let program = session.program();
    match (program.bands.wavelengths.len(), program.further.len() + 1) {
        (..=Bands::TOGETHER, _) => String::new(),
        (n, 1) => format!("bands    {n}, alike in this scene: one program draws them all\n"),
        (n, programs) => format!("bands    {n} in {programs} programs, drawn one after another\n"),
    }
}

/// One picture that has been drawn and written.
struct Done {
    path: PathBuf,
    drawing: Drawing,
    measured: Option<Measured>,
    nan: usize,
    programs: usize,
}

fn frame(
    format: Format,
    arguments: &Render,
    session: &mut Session,
    scene: &str,
    (path, time): (&Path, f64),
    params: &Params,
) -> Result<Done, Trouble> {
    let bar = progress(format, &path.display().to_string());
    let drawing = session.draw(params, time, &|share| bar.set_position((share * 1000.0) as u64));
    bar.finish_and_clear();
    let drawing = drawing?;
    let measured = if arguments.no_check
        || drawing.faults.has_errors()
        || session.engine() == "reference"
        || session.is_random()
    {
        None
    } else {
        let bar = progress(format, "comparing with the reference");
        bar.enable_steady_tick(std::time::Duration::from_millis(200));
        let measured = measure(session, &drawing, arguments.schedule.seed);
        bar.finish_and_clear();
        Some(measured?)
    };
    let options = WriteOptions {
        display: session.display(params, time),
        depth: if arguments.depth == "16" { Depth::Sixteen } else { Depth::Eight },
        scene: Some(scene.to_owned()),
    };
    let written = image::write(path, &drawing.picture, &options)
        .map_err(|e| trouble(Cause::Input, e.code, e.message, e.hint.as_deref()))?;
    let programs = session.program().parts().count();
    Ok(Done { path: path.to_owned(), drawing, measured, nan: written.nan, programs })
}

/// Compares as many pixels as half a minute allows: rays through lit matter under a sky can take the reference seconds each.
fn measure(session: &Session, drawing: &Drawing, seed: u64) -> Result<Measured, Trouble> {
    let mut counts = LADDER.into_iter();
    let mut count = counts.next().unwrap_or(CHECKED);
    loop {
        let started = Instant::now();
        let measured = session.measure(drawing, count, seed)?;
        let each = started.elapsed().as_secs_f64() / f64::from(count);
        match counts.next() {
            Some(next) if each * f64::from(next) <= PATIENCE => count = next,
            Some(_) | None => return Ok(measured),
        }
    }
}

impl Done {
    fn text(&self) -> String {
        let drawing = &self.drawing;
        let [width, height] = drawing.picture.size();
        let how = match (drawing.clock, drawing.dispatches) {
            ("gpu", n) => format!("GPU time, {}", dispatches(n)),
            (_, 0) => "wall clock".into(),
            (_, n) => format!("wall clock, {}", dispatches(n)),
        };
        let cost = drawing.evaluations.map(|n| format!(", {n} field evaluations")).unwrap_or_default();
        let mut text = format!("drawn    {width} x {height} in {:.1} ms ({how}){cost}\n", drawing.milliseconds);
        if let Some(paths) = drawing.paths {
            let each = if self.programs > 1 { " for each program" } else { "" };
            text += &format!("paths    {paths} of each pixel{each}\n");
        }
        if let Some(drawn) = drawing.drawn {
            let all = u64::from(width) * u64::from(height);
            text += &format!("pixels   {drawn} of {all} drawn, the others filled in from them\n");
        }
        if let Some(slabs) = drawing.slabs {
            text += &format!("slabs    {slabs}\n");
        }
        if let Some(splats) = drawing.splats {
            text += &format!("splats   {splats}\n");
        }
        let splats = drawing.arranging;
        if splats.drawn > 0 || splats.unseen > 0 {
            text += &format!(
                "order    {} splats drawn, {} not seen; sorted in {:.1} ms, listed in {:.1} ms\n",
                splats.drawn, splats.unseen, splats.order, splats.lists
            );
        }
        if let Some((error, share)) = drawing.predicted {
            let kind = drawing.error_kind.replace('-', " ");
            text +=
                &format!("error    predicted: at most {error:.2e} lx ({kind}), {share:.2} of what accuracy allows\n");
        }
        if let Some(origins) = drawing.origins {
            text += &format!("         of which at most {}\n", origins_text(origins));
        }
        if let Some(m) = &self.measured {
            text += &format!(
                "         measured: at most {:.2e} lx, rms {:.2e} lx on {} pixels, {:.2} of what accuracy allows\n",
                m.max, m.rms, m.pixels, m.share
            );
            if m.straddling > 0 {
                text +=
                    &format!("         apart: {} pixels on edges, at most {:.2e} lx\n", m.straddling, m.straddling_max);
            }
            if !m.within() {
                text += "warning: the picture is not within the scene's accuracy\n";
            }
        }
        if self.nan > 0 {
            text += &format!("warning: {} pixels are not numbers; they are magenta\n", self.nan);
        }
        text + &format!("wrote    {}\n", self.path.display())
    }

    fn json(&self) -> Value {
        let drawing = &self.drawing;
        json!({
            "file": self.path.display().to_string(),
            "time": drawing.time,
            "draw_ms": drawing.milliseconds,
            "clock": drawing.clock,
            "dispatches": drawing.dispatches,
            "evaluations": drawing.evaluations,
            "pixels_drawn": drawing.drawn,
            "paths": drawing.paths,
            "slabs": drawing.slabs,
            "splats": drawing.splats,
            "arranging": (drawing.arranging != Arranging::default()).then_some(json!({
                "drawn": drawing.arranging.drawn,
                "unseen": drawing.arranging.unseen,
                "order_ms": drawing.arranging.order,
                "lists_ms": drawing.arranging.lists,
            })),
            "nan": self.nan,
            "error": {
                "kind": drawing.error_kind,
                "predicted_max": drawing.predicted.map(|p| number(p.0)),
                "predicted_share": drawing.predicted.map(|p| number(p.1)),
                "origins": drawing.origins.map(origins_json),
                "measured": self.measured.map(|m| json!({
                    "pixels": m.pixels,
                    "max": number(m.max),
                    "rms": number(m.rms),
                    "share": number(m.share),
                    "within_accuracy": m.within(),
                    "straddling": m.straddling,
                    "straddling_max": number(m.straddling_max),
                    "reference_error": number(m.reference_error),
                })),
            },
        })
    }
}

fn dispatches(n: u32) -> String {
    if n == 1 { "1 dispatch".into() } else { format!("{n} dispatches") }
}

#[cfg(test)]
mod tests {
    use super::pattern;

    #[test]
    fn frames_are_numbered_as_printf_does() {
        assert_eq!(pattern("a%04d.png"), Some(("a", 4, ".png")));
        assert_eq!(pattern("a%d.png"), Some(("a", 1, ".png")));
        assert_eq!(pattern("a.png"), None);
        assert_eq!(pattern("a%xd.png"), None);
    }
}
