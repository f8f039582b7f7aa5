//! Error against run time: one scene drawn over and over, coarser and finer, by every backend and engine that can draw it,
//! each picture compared with one reference picture. What comes out is plain data; who prints it decides how it looks.
//!
//! # What is measured
//! Errors are absolute differences of radiance in lx between a picture and the reference picture, over the pixels off edges
//! and all bands. Pixels that a backend divides at an edge are counted apart: within rounding of the edge either side is
//! right, and there the reference is the mean of many rays. FLIP (Andersson et al. 2020) compares the pictures as shown.
//!
//! # The reference picture
//! is drawn by the reference engine, as exactly as its share of the budget allows, and its own error stands beside every
//! other: no measured error is known better than that. Where even a small picture takes too long it is known at some pixels
//! only, spread over the picture, and FLIP is left out. Under random paths every picture is drawn through the middles of its
//! pixels, so that nothing but noise differs; the reference has a standard error of its own then, whose square is subtracted
//! where a slope is fitted.
//!
//! # Time
//! is split into compiling (text to validated shaders), building (shaders to pipelines, grids to the device) and drawing,
//! the median of several drawings where one is short.

mod compare;
mod fit;
mod ladder;
#[cfg(test)]
mod tests;
mod truth;

pub(crate) use crate::engine::gpu::AdapterChoice;
use crate::frame::{EngineChoice, FileLoader, Params, Session, Settings, Trouble};
use crate::image::Shown;
pub use compare::{Edges, Errors, Predicted};
use compiler::Options;
use compiler::backends::REGISTRY;
use compiler::diagnostic::{Diagnostics, Severity};
use compiler::ir::{Aa, Backend, Scattering};
use compiler::program::OutputKind;
use compiler::source::Sources;
pub use fit::Slope;
use ladder::Line;
pub use ladder::{Quantity, Theory};
use std::time::{Duration, Instant};
pub use truth::ReferenceFacts;
pub(crate) use truth::Truth;

/// Part of the budget that the reference picture may take.
const TRUTH: f64 = 0.35;
/// Part of the budget that the scene's own schedule may take on one backend and engine.
const CHOSEN: f64 = 0.12;
/// Pixels along the longer side of a picture whose size nobody gave, at most and at least.
const LONGEST: u32 = 128;
const SHORTEST: u32 = 24;

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Request {
    /// Pixels, instead of a small picture of the scene's shape.
    pub size: Option<[u32; 2]>,
    /// Values of params: `name=value`.
    pub sets: Vec<String>,
    /// Instead of the scene's `scattering`.
    pub scattering: Option<Scattering>,
    /// Instead of the scene's `accuracy`.
    pub accuracy: Option<f64>,
    /// Only this one of the registry.
    pub backend: Option<Backend>,
    /// Only this one of `gpu` and `cpu`.
    pub engine: Option<EngineChoice>,
    /// Which adapter.
    pub adapter: AdapterChoice,
    /// Seconds that all of it may take, about.
    pub budget: f64,
    /// Of random numbers.
    pub seed: u64,
    /// Of the scene, in seconds.
    pub time: f64,
}

/// One picture of a ladder.
#[derive(Clone, Debug)]
pub struct Row {
    /// How many steps, samples …, or which accuracy.
    pub value: f64,
    /// Whether this is the scene's own schedule.
    pub chosen: bool,
    /// Whether no other picture has both less error and less time to draw.
    pub pareto: bool,
    /// How steps were taken, in words.
    pub steps: String,
    /// From text to shaders.
    pub compile_ms: f64,
    /// From shaders to an engine that is ready.
    pub build_ms: f64,
    /// The median over `draws`.
    pub draw_ms: f64,
    /// How often it was drawn.
    pub draws: u32,
    /// Which clock measured it: `gpu` or `wall`.
    pub clock: &'static str,
    /// Field evaluations, where they were counted.
    pub evaluations: Option<u64>,
    /// Paths of each pixel.
    pub paths: Option<u64>,
    /// Off edges.
    pub error: Errors,
    /// On edges.
    pub edges: Edges,
    /// Mean over the picture as shown; nothing where the reference is not known at every pixel.
    pub flip: Option<f64>,
    /// What the engine itself said.
    pub predicted: Option<Predicted>,
    /// What went wrong while drawing.
    pub faults: Vec<String>,
    /// The picture and its difference, kept for the coarsest, the finest and the chosen picture of a series.
    pub picture: Option<Comparison>,
}

/// A picture beside the reference.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// As a screen shows it.
    pub shown: Shown,
    /// The largest difference of each pixel's bands in lx, row by row; NaN where the reference is not known.
    pub difference: Vec<f32>,
}

/// Pictures that differ in one quantity.
#[derive(Clone, Debug)]
pub struct Series {
    /// `gpu` or `cpu`.
    pub engine: &'static str,
    /// Name and API of the graphics adapter.
    pub adapter: Option<String>,
    /// The backend; none on the processor, which has one way to draw.
    pub backend: Option<&'static str>,
    /// What differs.
    pub quantity: Quantity,
    /// From coarse to fine.
    pub rows: Vec<Row>,
    /// How the error falls, fitted.
    pub slope: Option<Slope>,
    /// How it should.
    pub theory: Option<Theory>,
}

/// What was not drawn, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// `gpu` or `cpu`.
    pub engine: &'static str,
    /// Which backend.
    pub backend: Option<&'static str>,
    /// Which ladder; all of them if it is nothing.
    pub quantity: Option<Quantity>,
    /// Which values of it; all of them if there are none.
    pub values: Vec<f64>,
    /// One sentence.
    pub reason: String,
}

/// All of it.
#[derive(Clone, Debug)]
pub struct Report {
    /// Name of the scene.
    pub scene: String,
    /// Pixels of each picture.
    pub size: [u32; 2],
    /// A of `accuracy`.
    pub accuracy: f64,
    /// W of `accuracy`: display white, in lx.
    pub white: f64,
    /// Seconds that were given, and that it took.
    pub budget: f64,
    /// See `budget`.
    pub spent: f64,
    /// The reference picture in numbers.
    pub reference: ReferenceFacts,
    /// The reference picture as shown.
    pub picture: Shown,
    /// Pixels that some backend divides at an edge.
    pub edges: u32,
    /// Every ladder.
    pub series: Vec<Series>,
    /// Every omission.
    pub left_out: Vec<LeftOut>,
    /// What the compiler had to say.
    pub warnings: Diagnostics,
    /// Texts that the warnings mean.
    pub sources: Sources,
}

/// What is drawn by.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(crate) struct Way {
    pub(crate) engine: EngineChoice,
    pub(crate) backend: Backend,
}

impl Way {
    pub(crate) fn engine_name(self) -> &'static str {
        match self.engine {
            EngineChoice::Gpu | EngineChoice::Auto => "gpu",
            EngineChoice::Cpu => "cpu",
            EngineChoice::Reference => "reference",
        }
    }

    /// `gpu raymarch`, or `cpu`.
    pub(crate) fn name(self) -> String {
        match self.backend_name() {
            Some(backend) => format!("{} {backend}", self.engine_name()),
            None => self.engine_name().to_owned(),
        }
    }

    /// The processor does not draw by kernels, whichever backend made them.
    pub(crate) fn backend_name(self) -> Option<&'static str> {
        match self.engine {
            EngineChoice::Gpu | EngineChoice::Auto => {
                REGISTRY.iter().find(|b| b.backend == self.backend).map(|b| b.word)
            }
            EngineChoice::Cpu | EngineChoice::Reference => None,
        }
    }
}

/// The scene and the way to its pictures.
struct Study<'a> {
    name: &'a str,
    text: &'a str,
    loader: &'a FileLoader,
    request: &'a Request,
    size: [u32; 2],
    /// Instead of the scene's.
    aa: Option<Aa>,
    started: Instant,
}

impl Study<'_> {
    fn spent(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn left(&self) -> f64 {
        self.request.budget - self.spent()
    }

    /// The reference, compiled as for the ray marcher, or as for another backend where that cannot draw the scene. It draws none of
    /// their kernels.
    fn reference(&self) -> Result<(Session, Params, Backend), Trouble> {
        let all = [Backend::Raymarch].into_iter().chain(REGISTRY.iter().map(|b| b.backend));
        let mut first = None;
        for backend in all {
            let way = Way { engine: EngineChoice::Reference, backend };
            match self.open(way, [1, 1], |options| options.size = None) {
                Ok((session, params)) => return Ok((session, params, backend)),
                Err(trouble) => first = first.or(Some(trouble)),
            }
        }
        Err(first.expect("there is a backend"))
    }

    fn open(&self, way: Way, size: [u32; 2], ask: impl FnOnce(&mut Options)) -> Result<(Session, Params), Trouble> {
        let mut options = Options {
            outputs: vec![
                OutputKind::Radiance,
                OutputKind::Error,
                OutputKind::Rounding,
                OutputKind::Storage,
                OutputKind::Evaluations,
                OutputKind::Fault,
                OutputKind::Edge,
            ],
            backend: Some(way.backend),
            scattering: self.request.scattering,
            accuracy: self.request.accuracy,
            size: Some(size),
            aa: self.aa,
            ..Options::default()
        };
        ask(&mut options);
        let settings =
            Settings { options, engine: way.engine, adapter: self.request.adapter.clone(), seed: self.request.seed };
        let session = Session::open(self.name, self.text, self.loader, settings)?;
        let (params, _) = session.params(&self.request.sets)?;
        Ok((session, params))
    }
}

/// The first error of a failure, on one line.
pub(crate) fn sentence(trouble: &Trouble) -> String {
    let error = trouble.diagnostics.iter().find(|d| d.severity == Severity::Error);
    error.or(trouble.diagnostics.iter().next()).map_or_else(String::new, |d| format!("{}: {}", d.code, d.message))
}

/// Draws and compares until everything is done or the budget is spent. `progress` is told the share that is done and what is
/// being drawn.
///
/// # Errors
/// When no engine can draw the scene, params do not fit, or the reference finds a fault.
pub fn report(
    name: &str,
    text: &str,
    loader: &FileLoader,
    request: &Request,
    progress: &dyn Fn(f64, &str),
) -> Result<Report, Trouble> {
    let mut study = Study { name, text, loader, request, size: [1, 1], aa: None, started: Instant::now() };
    progress(0.0, "looking at the reference");
    let (mut session, mut params, backend) = study.reference()?;
    if session.is_random() {
        study.aa = Some(Aa::None);
        (session, params, _) = study.reference()?;
    }
    let (mut truth, size) = Truth::plan(&study, &mut session, &params)?;
    study.size = size;

    let mut left_out = vec![];
    let mut lines: Vec<Line> = vec![];
    let mut edges = vec![false; size[0] as usize * size[1] as usize];
    let mut ways = ways(request.engine, request.backend);
    for way in ways.iter_mut().filter(|way| way.engine == EngineChoice::Cpu) {
        way.backend = backend;
    }
    for (i, way) in ways.iter().enumerate() {
        progress(0.2 * i as f64 / ways.len() as f64, &format!("{}, as the scene says", way.name()));
        match ladder::begin(&study, *way, request.budget * CHOSEN) {
            Ok(begun) => {
                edges.iter_mut().zip(&begun.edges).for_each(|(edge, found)| *edge |= found);
                lines.extend(begun.lines);
                left_out.extend(begun.left_out);
            }
            Err(reason) => left_out.push(LeftOut {
                engine: way.engine_name(),
                backend: way.backend_name(),
                quantity: None,
                values: vec![],
                reason,
            }),
        }
    }

    let until = study.spent() + request.budget * TRUTH;
    let until = study.started + Duration::from_secs_f64(until);
    let tell = |share| progress(0.2 + 0.3 * share, "the reference picture");
    truth.draw(&session, &params, request.time, &edges, (true, until), &tell)?;
    for line in &mut lines {
        line.compare_pending(&truth, &edges);
    }
    ladder::climb(&study, &mut lines, &truth, &edges, &mut left_out, progress);
    let mut series: Vec<Series> = lines.into_iter().filter_map(|line| line.finish(&truth)).collect();
    fit::mark_pareto(&mut series);
    progress(1.0, "done");
    Ok(Report {
        scene: name.to_owned(),
        size,
        accuracy: session.accuracy(),
        white: truth.white,
        budget: request.budget,
        spent: study.spent(),
        picture: truth.shown(&truth.display),
        edges: edges.iter().filter(|e| **e).count() as u32,
        reference: truth.facts(),
        series,
        left_out,
        warnings: session.warnings().clone(),
        sources: session.sources().clone(),
    })
}

/// Every backend of the registry on the GPU, and the processor once.
pub(crate) fn ways(engine: Option<EngineChoice>, backend: Option<Backend>) -> Vec<Way> {
    let gpu = REGISTRY.iter().map(|b| Way { engine: EngineChoice::Gpu, backend: b.backend });
    let all = gpu.chain([Way { engine: EngineChoice::Cpu, backend: Backend::Raymarch }]);
    let wanted = |way: &Way| {
        let backend = backend.is_none_or(|b| way.engine == EngineChoice::Cpu || b == way.backend);
        let engine = match engine {
            None | Some(EngineChoice::Auto) => true,
            Some(engine) => engine == way.engine,
        };
        backend && engine
    };
    all.filter(wanted).collect()
}
