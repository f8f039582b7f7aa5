//! `vol probe`

use super::{nanometres, read};
use crate::args::{self, Format, Probe};
use crate::output::{Exit, diagnostics, diagnostics_json, document, number, say, trouble};
use runtime::frame::{Cause, FileLoader, ProbeSettings, RayAnswer, RayQuery, Session, Settings, Trouble};
use serde_json::{Value, json};
use std::path::Path;

pub(super) fn run(format: Format, arguments: &Probe) -> Result<Exit, Trouble> {
    let loader = FileLoader::default();
    let mut rays: Vec<RayQuery> = arguments.ray.iter().copied().map(query).collect();
    if let Some(path) = &arguments.rays {
        rays.extend(list(path)?);
    }
    if rays.is_empty() {
        let hint = Some("give one: --ray \"0,0,-4 0,0,1\", or a file: --rays rays.csv");
        return Err(trouble(Cause::Arguments, "E0648", "there is no ray to follow", hint));
    }
    let text = read(&loader, &arguments.scene)?;
    let (engine, adapter) = arguments.engine.choice();
    let options = arguments.schedule.apply(compiler::Options::probe());
    let mut session = Session::open(
        &arguments.scene,
        &text,
        &loader,
        Settings { options, engine, adapter, seed: arguments.schedule.seed },
    )?;
    let (params, mut found) = session.params(&arguments.set)?;
    let settings = ProbeSettings { rtol: arguments.rtol, time: arguments.time };
    let answers = session.probe(&params, &rays, &settings)?;
    found.0.splice(0..0, session.warnings().0.iter().cloned());
    let bands = nanometres(&session.program().bands);
    match format {
        Format::Human => {
            diagnostics(&found, session.sources());
            if let Some(why) = session.fallback() {
                crate::output::complain(&format!("note: {why}; engine cpu follows the rays\n"));
            }
            say(&format!("engine {}, bands {bands:?} nm\n", session.engine()));
            rays.iter().zip(&answers).for_each(|(ray, answer)| say(&table(ray, answer)));
        }
        Format::Json => {
            let rays: Vec<Value> = rays.iter().zip(&answers).map(|(ray, answer)| entry(ray, answer)).collect();
            let body = json!({
                "engine": session.engine(),
                "adapter": session.adapter(),
                "backend": session.program().plan.backend,
                "bands_nm": bands,
                "rays": rays,
                "diagnostics": diagnostics_json(&found, session.sources()),
            });
            document("vol.probe", body);
        }
    }
    Ok(Exit::Done)
}

fn query([x, y, z, u, v, w]: [f64; 6]) -> RayQuery {
    RayQuery { origin: [x, y, z], direction: [u, v, w] }
}

/// Rays of a file: six numbers a line; empty lines, comments after `#` and one heading are skipped.
fn list(path: &Path) -> Result<Vec<RayQuery>, Trouble> {
    let name = path.display();
    let refuse = |what: String, hint| trouble(Cause::Input, "E0648", what, hint);
    let text = std::fs::read_to_string(path).map_err(|e| refuse(format!("`{name}` cannot be read: {e}"), None))?;
    let mut rays = vec![];
    for (i, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        let heading = rays.is_empty() && line.chars().any(char::is_alphabetic) && args::ray(line).is_err();
        if line.is_empty() || heading {
            continue;
        }
        let ray = args::ray(line);
        let ray = ray.map_err(|_| {
            let hint = Some("a line is `ox,oy,oz,dx,dy,dz`");
            refuse(format!("line {} of `{name}` is no ray: `{line}`", i + 1), hint)
        })?;
        rays.push(query(ray));
    }
    Ok(rays)
}

fn numbers(list: &[f64]) -> Value {
    list.iter().map(|v| number(*v)).collect()
}

fn entry(ray: &RayQuery, answer: &RayAnswer) -> Value {
    json!({
        "origin": numbers(&ray.origin),
        "direction": numbers(&ray.direction),
        "radiance": numbers(&answer.radiance),
        "transmittance": numbers(&answer.transmittance),
        "optical_depth": numbers(&answer.optical_depth),
        "error": numbers(&answer.error),
        "error_kind": answer.error_kind,
        "evaluations": answer.evaluations,
    })
}

fn table(ray: &RayQuery, answer: &RayAnswer) -> String {
    let join = |list: &[f64]| list.iter().map(f64::to_string).collect::<Vec<_>>().join("  ");
    format!(
        "ray            {} m  towards  {}\n  radiance       {} lx\n  transmittance  {}\n  optical depth  {}\n  error          {} lx ({}), {} evaluations\n",
        join(&ray.origin),
        join(&ray.direction),
        join(&answer.radiance),
        join(&answer.transmittance),
        join(&answer.optical_depth),
        join(&answer.error),
        answer.error_kind,
        answer.evaluations,
    )
}
