//! The whole way from text to program.

use crate::backends::{self, REGISTRY};
use crate::check::hir;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{Backend, FieldScene, Pixels, Scattering, Stacks};
use crate::loader::Loader;
use crate::program::{BandPlace, FILLED, Ledger, Program, RaySource};
use crate::source::Sources;
use crate::trial::{self, Change};
use crate::{Compilation, Options, lower, passes, resolve};
use std::sync::Arc;

/// Reads and checks a scene: all findings, and the checked scene when there is no error.
pub fn check_scene(name: &str, text: &str, loader: &dyn Loader) -> (Sources, Diagnostics, Option<hir::Scene>) {
    let mut sources = Sources::default();
    let mut diagnostics = Diagnostics::default();
    let modules = resolve::load(name, text, loader, &mut sources, &mut diagnostics);
    let scene = crate::check::check(&modules, loader, &mut diagnostics);
    (sources, diagnostics, scene)
}

/// Finds all that can be said about a scene without drawing it: what `vol check` prints.
pub fn check(name: &str, text: &str, loader: &dyn Loader) -> Compilation {
    compile(name, text, loader, &Options::default())
}

/// Compiles a scene. `name` is what diagnostics call it; files it names are found relative to it, through the loader.
pub fn compile(name: &str, text: &str, loader: &dyn Loader, options: &Options) -> Compilation {
    let (sources, mut diagnostics, scene) = check_scene(name, text, loader);
    let program = scene.filter(|_| !diagnostics.has_errors()).and_then(|mut scene| {
        if let Some(Change::Lengths(factor)) = options.change {
            trial::stretch(&mut scene, factor);
        }
        build(&scene, options, &mut diagnostics)
    });
    Compilation { sources, diagnostics, program }
}

fn build(scene: &hir::Scene, options: &Options, diagnostics: &mut Diagnostics) -> Option<Program> {
    diagnostics.0.extend(lower::pending(scene).0);
    let bands = scene.image.all_bands();
    let units = lower::choose_units(scene);
    let mut parts: Vec<Program> = vec![];
    let mut places = vec![];
    for group in bands.groups() {
        let mut found = Diagnostics::default();
        let lowered = lower::lower_group(scene, units, group.clone(), &mut found);
        let lowered = lowered.filter(|_| !found.has_errors());
        let part = lowered.and_then(|mut lowered| {
            apply(options, &mut lowered);
            // What does not depend on the wavelength is one program for all bands.
            let same = parts.iter().position(|p| p.lowered.is_same_but_for_bands(&mut lowered));
            same.or_else(|| {
                parts.push(backend(scene, lowered, options, &mut found)?);
                Some(parts.len() - 1)
            })
        });
        merge(diagnostics, found, group.start > 0);
        let part = part.filter(|_| !diagnostics.has_errors())?;
        let count = parts[part].lowered.bands.wavelengths.len();
        places.extend(group.clone().map(|b| BandPlace { part, band: (b - group.start) % count }));
    }
    let ledgers = parts.iter_mut().map(|p| (p.lowered.bands.to_string(), std::mem::take(&mut p.ledger))).collect();
    let mut ledger = Ledger::merge(ledgers);
    if parts.len() < bands.groups().len() {
        let reason = "parts of the spectrum in which the scene is the same are drawn once";
        ledger.omit("programs of further bands", reason, scene.image.span);
    }
    let mut parts = parts.into_iter();
    let first = parts.next()?;
    Some(Program { bands, places, ledger, further: parts.map(Arc::new).collect(), ..first })
}

/// Adds what was found in a group of bands. What an earlier group said of the same place differs in its numbers alone, and
/// is not said again as a finding of its own.
fn merge(diagnostics: &mut Diagnostics, found: Diagnostics, further: bool) {
    let (said, new): (Vec<_>, Vec<_>) = found.0.into_iter().partition(|f| {
        let place = f.primary_span();
        further && place.is_some() && diagnostics.iter().any(|d| d.code == f.code && d.primary_span() == place)
    });
    for finding in said {
        let same = |d: &&mut Diagnostic| d.code == finding.code && d.primary_span() == finding.primary_span();
        let mut alike: Vec<&mut Diagnostic> = diagnostics.0.iter_mut().filter(same).collect();
        let note = format!("in further bands, {}", finding.message);
        let told = alike.iter().any(|d| d.message == finding.message || d.notes.contains(&note));
        if let (Some(first), false) = (alike.first_mut(), told) {
            first.notes.push(note);
        }
    }
    new.into_iter().for_each(|finding| diagnostics.push(finding));
}

/// The program of one group of bands.
fn backend(
    scene: &hir::Scene,
    lowered: FieldScene,
    options: &Options,
    diagnostics: &mut Diagnostics,
) -> Option<Program> {
    if let (Scattering::Multiple, Some(splats)) = (lowered.render.scattering, lowered.splats.first()) {
        let mut diagnostic =
            Diagnostic::error("E0908", "splats in light that is scattered many times are not there yet")
                .hint("use `scattering = single`, or `none`");
        if let Some(span) = splats.span {
            diagnostic = diagnostic.at(span, "these splats");
        }
        diagnostics.push(diagnostic);
        return None;
    }
    let mut ledger = Ledger::default();
    note_features(scene, &lowered, &mut ledger);
    let mut optimised = passes::optimise(&lowered, &mut ledger);
    let mut forecasts = backends::forecasts(&optimised, options);
    let wanted = match lowered.render.backend {
        // Whoever says how planes stand means those of slicing.
        Backend::Auto if lowered.render.stacks == Stacks::HalfAngle && options.rays == RaySource::Camera => {
            Backend::Slicing
        }
        Backend::Auto => backends::choose(&forecasts, &lowered.render),
        asked => asked,
    };
    let entry = REGISTRY.iter().find(|entry| entry.backend == wanted).expect("every backend is registered");
    let (kernels, plan) = (entry.build)(&mut optimised, options, &mut ledger, diagnostics)?;
    backends::settle(&mut forecasts, &plan, &lowered);
    if lowered.render.pixels == Pixels::Adaptive && plan.rays == RaySource::Camera && plan.survey.is_none() {
        let told = ledger.0.iter().find(|l| l.feature == FILLED).map(|l| l.reason.as_str());
        let remark = Diagnostic::remark("N0532", "every pixel is drawn, although `pixels = adaptive`")
            .note(told.unwrap_or("the ray marcher alone fills pixels in"));
        diagnostics.push(match scene.render.span {
            Some(span) => remark.at(span, "asked for here"),
            None => remark,
        });
    }
    Some(Program { forecasts, ..Program::new((lowered, optimised), kernels, plan, ledger) })
}

/// Options change the schedule of both copies alike, before anything is built on it.
fn apply(options: &Options, scene: &mut FieldScene) {
    if let Some(change) = options.change {
        trial::overlay(change, scene);
    }
    let render = &mut scene.render;
    render.backend = options.backend.unwrap_or(render.backend);
    render.scattering = options.scattering.unwrap_or(render.scattering);
    if let Some(accuracy) = options.accuracy {
        render.accuracy = accuracy;
        (render.steps, render.slices, render.splats, render.samples) = (None, None, None, None);
    }
    render.steps = options.steps.or(render.steps);
    render.slices = options.slices.or(render.slices);
    render.stacks = options.stacks.unwrap_or(render.stacks);
    render.pixels = options.pixels.unwrap_or(render.pixels);
    render.splats = options.splats.or(render.splats);
    render.samples = options.samples.or(render.samples);
    scene.image.size = options.size.unwrap_or(scene.image.size);
    scene.image.aa = options.aa.unwrap_or(scene.image.aa);
}

/// Notes the parts of the language that this scene does without.
fn note_features(scene: &hir::Scene, lowered: &FieldScene, ledger: &mut Ledger) {
    if scene.lights.is_empty() {
        ledger.omit("loop over lights", "the scene has no light", None);
    }
    match lowered.render.scattering {
        Scattering::None if scene.media.iter().all(|m| m.k_s.is_none()) => {
            ledger.omit("phase functions and shadow rays", "no medium scatters", None);
        }
        Scattering::None => {
            ledger.omit("phase functions and shadow rays", "`scattering` is `none`", scene.render.span);
        }
        Scattering::Single | Scattering::Multiple => {}
    }
    if scene.surfaces.is_empty() {
        ledger.omit("surfaces", "the scene has none", None);
    }
    if scene.pending.is_empty() && scene.splats.is_empty() {
        ledger.omit("glyph atlas and splat sorting", "the scene has no text and no splats", None);
    }
    if lowered.bands.count() == 1 {
        ledger.omit("vectors of bands", "there is one band", scene.image.span);
    }
}
