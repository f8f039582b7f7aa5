//! The one place where a scene's text, its grids and an engine come together; the command line and the tests draw through it.

mod adaptive;
mod canvas;
mod files;
mod random;
mod refine;
mod slabs;
mod splats;

use self::canvas::{Canvas, draw_parts, trace_parts};
pub(crate) use self::refine::TOO_LONG;
use super::measure::{Measured, Samples, worst};
use super::{
    Ball, Bricks, Camera, Eye, FaultTally, Frame, Grids, Loaded, LoadedMesh, Nothing, Origins, Params, SceneFiles,
    Vec3, findings, pack_ray, sample_offsets, scene_bounds,
};
use crate::data::mesh::Mesh;
use crate::data::splats::Splats;
use crate::data::{LoadWarning, Volume};
use crate::engine::gpu::{
    AdapterChoice, Arranging, Gpu, GpuError, GpuErrorKind, GridData, Needs, Prepared, SceneData, Timing,
};
use crate::engine::reference::{self, MeshHit, Meshes, WholeReference};
use crate::image::{Display, Picture};
use compiler::analysis::interval::Interval;
use compiler::diagnostic::{Diagnostic, Diagnostics, Severity};
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{Aa, MeshId, Scattering};
use compiler::loader::LoadError;
use compiler::program::{OutputKind, Precision, Program, RaySource, StepRule, UniformField, UniformSource};
use compiler::source::{Sources, Span};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Which engine is wanted.
#[derive(Copy, Clone, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// A graphics adapter if there is one, else the processor.
    #[default]
    Auto,
    /// A graphics adapter, or an error.
    Gpu,
    /// The processor, at the scene's accuracy.
    Cpu,
    /// The trusted one, to a tolerance of its own.
    Reference,
}

/// Whose fault it is that there is no picture.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The scene's, or a file's that it names.
    Input,
    /// The arguments'.
    Arguments,
    /// The machine cannot do it.
    Machine,
}

/// Why there is no picture. The texts that its spans mean are those of the session or of the compilation.
#[derive(Clone, Debug)]
pub struct Trouble {
    /// Whose fault it is.
    pub cause: Cause,
    /// What to say, warnings included.
    pub diagnostics: Diagnostics,
    /// The texts that the diagnostics mean.
    pub sources: Sources,
}

/// What draws, besides the scene.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// What the program is compiled for.
    pub options: compiler::Options,
    /// Which engine.
    pub engine: EngineChoice,
    /// Which adapter, for the GPU.
    pub adapter: AdapterChoice,
    /// Of random numbers.
    pub seed: u64,
}

/// The meshes of a scene, by their number.
#[derive(Clone, Debug, Default)]
struct Triangles(Vec<LoadedMesh>);

impl Meshes for Triangles {
    fn hit(&self, mesh: MeshId, origin: Vec3, direction: Vec3, reach: f64) -> Option<MeshHit> {
        let mesh = &self.0.get(mesh.0 as usize)?.mesh;
        let (t, triangle) = mesh.nearest(origin, direction, (0.0, reach))?;
        Some(MeshHit { t, normal: mesh.normal(triangle) })
    }
}

#[derive(Debug)]
enum Engine {
    /// One for each part of the program.
    Gpu(Vec<Prepared>),
    Cpu,
    Reference,
}

impl Engine {
    /// Nothing on the processor.
    fn prepared(&mut self) -> &mut [Prepared] {
        match self {
            Self::Gpu(parts) => parts,
            Self::Cpu | Self::Reference => &mut [],
        }
    }
}

/// What bounds of media are made for.
#[derive(Copy, Clone, Debug, PartialEq)]
struct Bounding {
    /// A picture, or rays by hand.
    picture: bool,
    accuracy: f64,
}

/// Bounds of media, and what they are of.
#[derive(Clone, Debug)]
struct Held {
    bounding: Bounding,
    params: Params,
    time: f64,
    bricks: Arc<Vec<Vec<Bricks>>>,
}

impl Bounding {
    fn new(program: &Program, options: &compiler::Options) -> Self {
        let accuracy = options.accuracy.unwrap_or(program.lowered.render.accuracy);
        Self { picture: program.plan.rays == RaySource::Camera, accuracy }
    }

    /// The bounds, if the program reads any.
    fn of(self, program: &Program, params: &Params, time: f64, grids: &Grids) -> Option<Held> {
        if program.parts().all(|p| p.plan.bounds.is_empty()) {
            return None;
        }
        let of_part = |part: &Program| {
            let nothing = self.nothing(part, params, time);
            let one = |b| Bricks::new(&part.optimised, b, (&params.0, time), grids, nothing);
            part.plan.bounds.iter().map(one).collect()
        };
        let bricks = Arc::new(program.parts().map(of_part).collect());
        Some(Held { bounding: self, params: params.clone(), time, bricks })
    }

    fn nothing(self, part: &Program, params: &Params, time: f64) -> Nothing {
        // Optical depth is asked for relative to itself, and so is all that a probe asks.
        let relative = part.plan.output(OutputKind::OpticalDepth).is_some() || !self.picture;
        let white = if relative { 0.0 } else { super::white(&part.lowered, &params.0, time) };
        Nothing { accuracy: self.accuracy, white, paths: matches!(part.plan.steps, StepRule::Paths(_)) }
    }
}

/// A compiled scene on an engine, with its grids loaded: draws as often as wanted.
#[derive(Debug)]
pub struct Session {
    program: Arc<Program>,
    sources: Sources,
    warnings: Diagnostics,
    options: compiler::Options,
    grids: Grids,
    meshes: Triangles,
    splats: Vec<Arc<Splats>>,
    engine: Engine,
    fallback: Option<String>,
    seed: u64,
    eye: Option<Camera>,
    patience: Option<f64>,
    grid_ranges: Vec<Interval>,
    bricks: Mutex<Option<Held>>,
    compile_ms: f64,
    build_ms: f64,
}

/// A picture and what is known about it.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// Linear radiance and transmittance.
    pub picture: Picture,
    /// Whether a pixel straddles an edge, row by row; empty when the engine does not say.
    pub edges: Vec<bool>,
    /// The largest error of a pixel as the engine knows it, in lx, and as a multiple of what `accuracy` allows there.
    pub predicted: Option<(f64, f64)>,
    /// Where that comes from, where the backend tells it apart and was asked to.
    pub origins: Option<Origins>,
    /// The error of each pixel in lx as the engine knows it, the largest over its bands, row by row; empty when the engine
    /// does not say.
    pub errors: Vec<f32>,
    /// What kind of error that is: `estimate` or `standard-error`.
    pub error_kind: &'static str,
    /// Paths of each pixel, if the picture was drawn by chance.
    pub paths: Option<u64>,
    /// Pixels that were drawn, where the others were filled in.
    pub drawn: Option<u64>,
    /// Slabs that the media were cut into, if they were.
    pub slabs: Option<u32>,
    /// Splats that they were made of, if they were.
    pub splats: Option<u32>,
    /// Field evaluations in all, if they were counted.
    pub evaluations: Option<u64>,
    /// Milliseconds to draw.
    pub milliseconds: f64,
    /// How splats were arranged on the device before that; all 0 where there are none.
    pub arranging: Arranging,
    /// Which clock measured them: `gpu` or `wall`.
    pub clock: &'static str,
    /// Dispatches that the picture was cut into; 0 on the processor.
    pub dispatches: u32,
    /// What went wrong at run time; the picture is to be distrusted then.
    pub faults: Diagnostics,
    /// The values that were used.
    pub params: Params,
    /// Seconds.
    pub time: f64,
}

/// One ray of a probe: a position in metres and a direction of any length but zero.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct RayQuery {
    /// Metres.
    pub origin: [f64; 3],
    /// Without unit.
    pub direction: [f64; 3],
}

/// What a probe found. Lists have one entry per band.
#[derive(Clone, Debug, PartialEq)]
pub struct RayAnswer {
    /// lx
    pub radiance: Vec<f64>,
    /// 0 … 1
    pub transmittance: Vec<f64>,
    /// 0 … ∞
    pub optical_depth: Vec<f64>,
    /// Of the radiance, in lx.
    pub error: Vec<f64>,
    /// `bound`, `estimate` or `standard-error`.
    pub error_kind: &'static str,
    /// Field evaluations.
    pub evaluations: u64,
}

/// How a probe is answered.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct ProbeSettings {
    /// Relative tolerance of the reference.
    pub rtol: f64,
    /// Seconds.
    pub time: f64,
}

impl Default for ProbeSettings {
    fn default() -> Self {
        Self { rtol: 1e-10, time: 0.0 }
    }
}

impl Session {
    /// Compiles a scene, loads its grids and makes an engine ready.
    ///
    /// # Errors
    /// Errors of the scene and of its files, and what the machine lacks.
    pub fn open(name: &str, text: &str, loader: &dyn SceneFiles, mut settings: Settings) -> Result<Self, Trouble> {
        let started = Instant::now();
        let compiled = compiler::compile(name, text, loader, &settings.options);
        let (sources, mut warnings) = (compiled.sources, compiled.diagnostics);
        let trouble = |cause, diagnostics: &Diagnostics| Trouble {
            cause,
            diagnostics: diagnostics.clone(),
            sources: sources.clone(),
        };
        let Some(mut program) = compiled.program.filter(|_| !warnings.has_errors()) else {
            return Err(trouble(Cause::Input, &warnings));
        };
        let mut compile_ms = milliseconds(started);
        let started = Instant::now();
        let infos = &program.lowered.graph.grids;
        let spans: Vec<_> = infos.iter().map(|g| g.span).collect();
        let loaded = loader.volumes(infos).map_err(|e| unreadable(&mut warnings, e, &spans, &trouble))?;
        tell(&mut warnings, loaded.iter().map(|g| (&g.name, &g.warnings)), &spans);
        let infos = &program.lowered.meshes;
        let spans: Vec<_> = infos.iter().map(|m| m.span).collect();
        let meshes = loader.meshes(infos).map_err(|e| unreadable(&mut warnings, e, &spans, &trouble))?;
        tell(&mut warnings, meshes.iter().map(|m| (&m.name, &m.warnings)), &spans);
        let grids = Grids::new(loaded);
        let mut held = match settings.engine {
            EngineChoice::Auto | EngineChoice::Gpu => Bounding::new(&program, &settings.options).of(
                &program,
                &Params::defaults(&program.lowered),
                0.0,
                &grids,
            ),
            EngineChoice::Cpu | EngineChoice::Reference => None,
        };
        let found = findings(&program, Some(&grids)).0;
        warnings.0.extend(found.into_iter().filter(|d| d.severity == Severity::Warning));
        // Where bounds tell nothing, code that reads them would only be in the way.
        let idle = |held: &Held| {
            held.bricks.iter().flatten().all(Bricks::is_whole)
                && !program.parts().any(|part| {
                    let nothing = held.bounding.nothing(part, &held.params, held.time);
                    let at = (held.params.0.as_slice(), held.time);
                    part.plan.bounds.iter().any(|b| Bricks::hides(&part.optimised, b, at, &grids, nothing))
                })
        };
        let again = Instant::now();
        if held.as_ref().is_some_and(idle) {
            let options = compiler::Options { unbounded: true, ..settings.options.clone() };
            if let Some(plain) = compiler::compile(name, text, loader, &options).program {
                (program, held) = (plain, None);
            }
        }
        let shaders = emit(&program).map_err(|error| {
            warnings.push(error);
            trouble(Cause::Input, &warnings)
        })?;
        let emit_ms = milliseconds(again);
        compile_ms += emit_ms;
        let infos = &program.lowered.splats;
        let spans: Vec<_> = infos.iter().map(|s| s.span).collect();
        let splats = loader.read_splats(infos).map_err(|e| unreadable(&mut warnings, e, &spans, &trouble))?;
        tell(&mut warnings, splats.iter().map(|s| (&s.name, &s.warnings)), &spans);
        let mut program = Arc::new(program);
        let mut chosen = choose(&program, shaders, (grids.loaded(), &meshes), &settings);
        if chosen.as_ref().is_err_and(|e| e.kind == GpuErrorKind::Unblendable) {
            let unbounded = held.is_none();
            settings.options.blending = Precision::Half;
            let options = compiler::Options { unbounded, ..settings.options.clone() };
            let half = compiler::compile(name, text, loader, &options).program;
            if let Some((half, shaders)) = half.and_then(|half| emit(&half).ok().map(|shaders| (half, shaders))) {
                program = Arc::new(half);
                chosen = choose(&program, shaders, (grids.loaded(), &meshes), &settings);
            }
        }
        let (engine, fallback) = chosen.map_err(|error| {
            warnings.push(machine(&error));
            trouble(Cause::Machine, &warnings)
        })?;
        let majorant = |f: &UniformField| matches!(f.source, UniformSource::Majorant(_));
        let majorants = program.parts().any(|p| p.plan.uniforms.fields.iter().any(majorant));
        let grid_ranges = if majorants { grids.loaded().iter().map(|l| values(&l.volume)).collect() } else { vec![] };
        Ok(Self {
            program,
            sources,
            warnings,
            options: settings.options,
            grids,
            meshes: Triangles(meshes),
            splats: splats.into_iter().map(|s| s.splats).collect(),
            engine,
            fallback,
            seed: settings.seed,
            eye: None,
            patience: None,
            grid_ranges,
            bricks: Mutex::new(held),
            compile_ms,
            build_ms: milliseconds(started) - emit_ms,
        })
    }

    /// The compiled scene.
    #[must_use]
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// Every text of the scene, for diagnostics.
    #[must_use]
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    /// What the compiler and the readers had to say.
    #[must_use]
    pub fn warnings(&self) -> &Diagnostics {
        &self.warnings
    }

    /// `gpu`, `cpu` or `reference`.
    #[must_use]
    pub fn engine(&self) -> &'static str {
        match self.engine {
            Engine::Gpu(_) => "gpu",
            Engine::Cpu => "cpu",
            Engine::Reference => "reference",
        }
    }

    /// Name and API of the adapter, for the GPU.
    #[must_use]
    pub fn adapter(&self) -> Option<String> {
        match &self.engine {
            Engine::Gpu(parts) => parts.first().map(|prepared| {
                let adapter = prepared.gpu().adapter();
                format!("{} ({})", adapter.name, adapter.api)
            }),
            Engine::Cpu | Engine::Reference => None,
        }
    }

    /// Why the processor draws although a graphics adapter would have been taken.
    #[must_use]
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
    }

    /// Milliseconds from text to validated shaders, and from there to an engine that is ready (grids loaded and uploaded).
    #[must_use]
    pub fn milliseconds(&self) -> (f64, f64) {
        (self.compile_ms, self.build_ms)
    }

    /// How steps are chosen, in words.
    #[must_use]
    pub fn steps(&self) -> String {
        let half = if self.blends_half() { ", blended in f16" } else { "" };
        match (&self.engine, self.program.plan.steps) {
            (Engine::Cpu | Engine::Reference, StepRule::Fixed(n)) => format!("{n} along each ray"),
            (Engine::Cpu | Engine::Reference, _) => "adaptive panels of 8 nodes".into(),
            (Engine::Gpu(_), StepRule::Paths(None)) => format!("random paths, to {}", self.accuracy()),
            (Engine::Gpu(_), StepRule::Paths(Some(n))) => format!("random paths, {n} of each pixel"),
            (Engine::Gpu(_), StepRule::Closed) => "none (closed forms)".into(),
            (Engine::Gpu(_), StepRule::Fixed(n)) => format!("{n} along each ray"),
            (Engine::Gpu(_), StepRule::Adaptive(a)) => format!("adaptive, to {a}"),
            (Engine::Gpu(_), StepRule::Splats { count: Some(n), .. }) => format!("about {n} splats"),
            (Engine::Gpu(_), StepRule::Splats { count: None, .. }) => format!("splats, to {}", self.accuracy()),
            (Engine::Gpu(_), StepRule::Slabs { count: Some(n), .. }) => format!("{n} slabs{half}"),
            (Engine::Gpu(_), StepRule::Slabs { count: None, .. }) => format!("slabs, to {}{half}", self.accuracy()),
        }
    }

    /// Pixels of the picture.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.options.size.unwrap_or(self.program.lowered.image.size)
    }

    /// A of `accuracy`.
    #[must_use]
    pub fn accuracy(&self) -> f64 {
        self.options.accuracy.unwrap_or(self.program.lowered.render.accuracy)
    }

    /// How many pipelines the GPU has compiled; 0 on the processor.
    #[must_use]
    pub fn pipelines_created(&self) -> u32 {
        match &self.engine {
            Engine::Gpu(parts) => parts.first().map_or(0, |prepared| prepared.gpu().pipelines_created()),
            Engine::Cpu | Engine::Reference => 0,
        }
    }

    /// The scene's parameters with some of them set.
    ///
    /// # Errors
    /// Names and values that do not fit. Warnings about ranges are given beside the values.
    pub fn params<S: AsRef<str>>(&self, sets: &[S]) -> Result<(Params, Diagnostics), Trouble> {
        let (params, found) = Params::from_sets(&self.program.lowered, sets);
        if found.has_errors() { Err(self.trouble(Cause::Arguments, found)) } else { Ok((params, found)) }
    }

    fn trouble(&self, cause: Cause, diagnostics: Diagnostics) -> Trouble {
        Trouble { cause, diagnostics, sources: self.sources.clone() }
    }

    fn input(&self, diagnostic: Diagnostic) -> Trouble {
        self.trouble(Cause::Input, Diagnostics(vec![diagnostic]))
    }

    fn broken(&self, error: &GpuError) -> Trouble {
        self.trouble(Cause::Machine, Diagnostics(vec![machine(error)]))
    }

    /// So many seconds and no more may go into finding how many pieces a picture needs.
    pub(crate) fn hurry(&mut self, seconds: f64) {
        self.patience = Some(seconds);
    }

    /// Draws so many pixels from now on, which no kernel depends on.
    pub(crate) fn resize(&mut self, size: [u32; 2]) {
        self.options.size = Some(size);
    }

    /// Looks from elsewhere, or as the scene says. The projection must be of the scene's kind, which kernels are made for.
    pub(crate) fn look_from(&mut self, camera: Option<Camera>) {
        self.eye = camera;
    }

    pub(crate) fn camera(&self, params: &Params, time: f64) -> Result<Camera, Trouble> {
        if let Some(camera) = self.eye {
            return Ok(camera.with_size(self.size()));
        }
        let camera = Camera::from_scene(&self.program.lowered, &params.0, time).map_err(|d| self.input(d))?;
        Ok(camera.with_size(self.size()))
    }

    fn frame(&self, params: &Params, time: f64, camera: Option<&Camera>, bounds: Option<Ball>) -> Frame {
        let scene = &self.program.lowered;
        let none = Eye { anchor: [0.0; 3], forward: [0.0, 0.0, -1.0], right: [0.0; 3], up: [0.0; 3], plane: 0.0 };
        let plan = &self.program.plan;
        Frame {
            size: camera.map_or([0, 0], |c| c.size),
            accuracy: match plan.steps {
                StepRule::Adaptive(a) => a,
                StepRule::Closed
                | StepRule::Fixed(_)
                | StepRule::Paths(_)
                | StepRule::Slabs { .. }
                | StepRule::Splats { .. } => self.accuracy(),
            },
            white: if camera.is_some() { super::white(scene, &params.0, time) } else { 0.0 },
            steps: match plan.steps {
                StepRule::Fixed(n) => n,
                StepRule::Closed
                | StepRule::Adaptive(_)
                | StepRule::Paths(_)
                | StepRule::Slabs { .. }
                | StepRule::Splats { .. } => self.options.steps.or(scene.render.steps).unwrap_or(0),
            },
            max_work: scene.render.max_work,
            eye: camera.map_or(none, |c| Eye::new(c, bounds)),
            params: params.0.clone(),
            time,
            paths: 0,
            first_path: 0,
            seed: self.seed as u32 ^ (self.seed >> 32) as u32,
            bounds: super::bounds::bounded_media(scene, &params.0, time),
            grids: self.grid_ranges.clone(),
            slabs: super::Slabs::default(),
            lattice: super::Lattice::default(),
            lean: 0.0,
            goes_on: false,
            footprints: Arc::default(),
            bricks: self.bricks(params, time, camera.is_some()),
            columns: self.columns_box(params, time),
            part: 0,
        }
    }

    /// The bounds of media at these parameters, evaluated anew when something that they depend on has moved.
    fn bricks(&self, params: &Params, time: f64, picture: bool) -> Arc<Vec<Vec<Bricks>>> {
        if self.program.parts().all(|p| p.plan.bounds.is_empty()) {
            return Arc::default();
        }
        let bounding = Bounding { picture, accuracy: self.accuracy() };
        let mut held = self.bricks.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(held) = held.as_ref().filter(|h| h.bounding == bounding && h.params == *params && h.time == time) {
            return Arc::clone(&held.bricks);
        }
        *held = bounding.of(&self.program, params, time, &self.grids);
        held.as_ref().map_or_else(Arc::default, |h| Arc::clone(&h.bricks))
    }

    /// Draws one picture. `progress` is called with the share that is done.
    ///
    /// # Errors
    /// When the scene has no value at run time (a camera without direction, a field that the reference finds negative),
    /// or the machine fails.
    pub fn draw(&mut self, params: &Params, time: f64, progress: &(dyn Fn(f64) + Sync)) -> Result<Drawing, Trouble> {
        let camera = self.camera(params, time)?;
        crate::frame::values::check(&self.program.lowered, &params.0, time).map_err(|d| self.input(d))?;
        match &self.engine {
            Engine::Gpu(_) if self.is_random() => self.draw_paths(params, time, &camera, progress),
            Engine::Gpu(_) if self.is_sliced() => self.draw_slabs(params, time, &camera, progress),
            Engine::Gpu(_) if self.is_splatted() => self.draw_splats(params, time, &camera, progress),
            Engine::Gpu(_) if self.program.plan.survey.is_some() => self.draw_adaptive(params, time, &camera, progress),
            Engine::Gpu(_) => self.draw_gpu(params, time, &camera, progress),
            Engine::Cpu | Engine::Reference => self.draw_cpu(params, time, &camera, progress),
        }
    }

    fn draw_gpu(
        &mut self,
        params: &Params,
        time: f64,
        camera: &Camera,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Drawing, Trouble> {
        let scene = &self.program.lowered;
        let mut frame = self.frame(params, time, Some(camera), scene_bounds(scene, &params.0, time));
        if self.program.plan.footprints.is_some() {
            frame.footprints = self.footprints_of_picture(params, time, (camera, &frame))?;
            frame.slabs.bounds = self.media_box(params, time);
        }
        let (mut canvas, timing) = self.canvas(&frame, progress)?;
        if let StepRule::Fixed(_) = self.program.plan.steps {
            // Only what was asked for: nothing tells how good it is.
            canvas.say_nothing();
        }
        self.drawing(canvas, timing, params, time)
    }

    /// Draws one frame.
    fn canvas(&mut self, frame: &Frame, progress: &dyn Fn(f64)) -> Result<(Canvas, Timing), Trouble> {
        let mut canvas = Canvas::new(&self.program, frame.size, frame);
        let drawn = draw_parts(&mut self.engine, frame, &mut canvas, &|_| true, &mut |canvas| progress(canvas.done()));
        let timing = drawn.map_err(|e| self.broken(&e))?;
        Ok((canvas, timing))
    }

    /// What was drawn, with what is known about it.
    fn drawing(&self, canvas: Canvas, timing: Timing, params: &Params, time: f64) -> Result<Drawing, Trouble> {
        let size = canvas.size;
        let Canvas { radiance, transmittance, edges, errors, predicted, origins, evaluations, faults, .. } = canvas;
        let bands = self.program.bands.clone();
        Ok(Drawing {
            picture: Picture::new(size, bands, radiance, transmittance).map_err(|e| self.image(e))?,
            edges,
            predicted,
            origins,
            errors,
            error_kind: "estimate",
            paths: None,
            drawn: None,
            slabs: None,
            splats: None,
            evaluations,
            milliseconds: timing.milliseconds,
            arranging: timing.arranging,
            clock: timing.clock.name(),
            dispatches: timing.dispatches,
            faults: faults.diagnostics(&self.program.lowered, "pixels"),
            params: params.clone(),
            time,
        })
    }

    fn reference(&self, params: &Params, time: f64) -> Result<WholeReference<'_, Grids>, Trouble> {
        let engine = WholeReference::new(&self.program, &params.0, time, &self.grids);
        Ok(engine.map_err(|d| self.input(d))?.with_meshes(&self.meshes).with_splats(&self.splats))
    }

    fn image(&self, error: crate::image::ImageError) -> Trouble {
        let mut diagnostic = Diagnostic::error(error.code, error.message);
        diagnostic.hints.extend(error.hint);
        self.input(diagnostic)
    }

    /// What the reference engine is asked for when it draws a picture.
    fn picture_options(&self, white: f64) -> reference::Options {
        let mut options = match self.engine {
            Engine::Reference => reference::Options { goal: reference::Goal::Radiance, ..Default::default() },
            Engine::Cpu | Engine::Gpu(_) => reference::Options::accuracy(self.accuracy(), white),
        };
        if let (Engine::Cpu, StepRule::Fixed(n)) = (&self.engine, self.program.plan.steps) {
            options.steps = Some(n);
        }
        if let Engine::Reference = self.engine {
            // Far below what a picture can show, and reachable where light is dim.
            options.atol = 1e-12 * white;
        }
        self.by_chance(options)
    }

    /// Of random paths on the processor.
    fn by_chance(&self, options: reference::Options) -> reference::Options {
        reference::Options { samples: self.options.samples.map(u64::from), seed: self.seed, ..options }
    }

    fn draw_cpu(
        &self,
        params: &Params,
        time: f64,
        camera: &Camera,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Drawing, Trouble> {
        let scene = &self.program.lowered;
        let started = Instant::now();
        let white = super::white(scene, &params.0, time);
        let engine = self.reference(params, time)?;
        let offsets = sample_offsets(self.program.plan.samples);
        let options = self.picture_options(white);
        let drawn = engine.render(camera, &offsets, &options, progress).map_err(|d| self.input(d))?;
        let pixels = drawn.pixels;
        let narrow = |list: &[f64]| list.iter().map(|v| super::to_f32(*v)).collect::<Vec<f32>>();
        let chance = scene.render.scattering == Scattering::Multiple;
        let (errors, origins) = told_apart(&pixels, chance);
        let predicted = worst(errors.iter().copied(), pixels.radiance.iter().copied(), self.accuracy(), white);
        let (radiance, transmittance) = (narrow(&pixels.radiance), narrow(&pixels.transmittance));
        let bands = self.program.bands.clone();
        Ok(Drawing {
            picture: Picture::new(camera.size, bands, radiance, Some(transmittance)).map_err(|e| self.image(e))?,
            edges: vec![],
            predicted: Some(predicted),
            origins: Some(origins),
            errors: errors.chunks_exact(engine.bands()).map(largest).collect(),
            error_kind: if chance { reference::ErrorKind::StandardError } else { reference::ErrorKind::Estimate }
                .name(),
            paths: None,
            drawn: None,
            slabs: None,
            splats: None,
            evaluations: Some(pixels.evaluations),
            milliseconds: milliseconds(started),
            arranging: Arranging::default(),
            clock: "wall",
            dispatches: 0,
            faults: Diagnostics::default(),
            params: params.clone(),
            time,
        })
    }

    /// What the reference makes of some pixels: the mean over rays through `offsets` of each.
    ///
    /// # Errors
    /// When it finds a fault in the scene.
    pub(crate) fn exact_pixels(
        &self,
        params: &Params,
        time: f64,
        (pixels, offsets): (&[[u32; 2]], &[[f64; 2]]),
        options: &reference::Options,
    ) -> Result<reference::Pixels, Trouble> {
        let camera = self.camera(params, time)?;
        self.reference(params, time)?.pixels(&camera, pixels, offsets, options).map_err(|d| self.input(d))
    }

    /// Display white of the picture, in lx.
    pub(crate) fn white(&self, params: &Params, time: f64) -> f64 {
        super::white(&self.program.lowered, &params.0, time)
    }

    /// How the picture is shown.
    #[must_use]
    pub fn display(&self, params: &Params, time: f64) -> Display {
        let scene = &self.program.lowered;
        let exposure = evaluate_frame(&scene.graph, &[scene.image.exposure], &params.0, time);
        Display { exposure: exposure[0][0], tonemap: scene.image.tonemap }
    }

    /// Compares a drawing with the reference on at most `count` pixels, spread over the picture by `seed`.
    ///
    /// # Errors
    /// When the reference finds a fault in the scene.
    pub fn measure(&self, drawing: &Drawing, count: u32, seed: u64) -> Result<Measured, Trouble> {
        self.compare(drawing, self.true_samples(), (count, seed))
    }

    /// Compares every pixel of a drawing with the reference, but for those that straddle an edge, which are counted.
    ///
    /// # Errors
    /// When the reference finds a fault in the scene.
    pub fn measure_off_edges(&self, drawing: &Drawing) -> Result<Measured, Trouble> {
        self.compare(drawing, self.true_samples().off_edges(), (u32::MAX, 0))
    }

    fn true_samples(&self) -> Samples {
        let by_area = self.options.aa.unwrap_or(self.program.lowered.image.aa) == Aa::Analytic;
        Samples::new(self.program.plan.samples, by_area)
    }

    fn compare(&self, drawing: &Drawing, samples: Samples, spread: (u32, u64)) -> Result<Measured, Trouble> {
        let scene = &self.program.lowered;
        let camera = self.camera(&drawing.params, drawing.time)?;
        let white = super::white(scene, &drawing.params.0, drawing.time);
        let engine = self.reference(&drawing.params, drawing.time)?;
        let allowed = (self.accuracy(), white);
        let measured = Measured::of(&engine, &camera, drawing, samples, spread, allowed);
        measured.map_err(|d| self.input(d))
    }

    /// Follows rays. The session must have been opened with [`compiler::Options::probe`].
    ///
    /// # Errors
    /// A ray without direction, a field without value, or a failure of the machine.
    pub fn probe(
        &mut self,
        params: &Params,
        rays: &[RayQuery],
        settings: &ProbeSettings,
    ) -> Result<Vec<RayAnswer>, Trouble> {
        crate::frame::values::check(&self.program.lowered, &params.0, settings.time).map_err(|d| self.input(d))?;
        let unit = self.program.lowered.units.length;
        let scaled = rays.iter().map(|r| (r.origin.map(|x| x / unit), super::vector::normalize(r.direction)));
        let mut list = vec![];
        for (ray, (origin, direction)) in rays.iter().zip(scaled) {
            let Some(direction) = direction.filter(|_| super::vector::is_finite(origin)) else {
                let message = format!("the ray {:?} {:?} has no direction", ray.origin, ray.direction);
                let diagnostic = Diagnostic::error("E0654", message)
                    .hint("a ray is a finite position and a direction that is not zero");
                return Err(self.trouble(Cause::Arguments, Diagnostics(vec![diagnostic])));
            };
            list.push((origin, direction));
        }
        match self.engine {
            Engine::Gpu(_) if self.is_random() => self.probe_paths(params, &list, settings),
            Engine::Gpu(_) if self.is_sliced() => self.probe_slabs(params, &list, settings),
            Engine::Gpu(_) if self.is_splatted() => self.probe_splats(params, &list, settings),
            Engine::Gpu(_) => self.probe_gpu(params, &list, settings, |_| {}),
            Engine::Cpu | Engine::Reference => self.probe_cpu(params, &list, settings),
        }
    }

    fn probe_cpu(
        &self,
        params: &Params,
        rays: &[([f64; 3], [f64; 3])],
        settings: &ProbeSettings,
    ) -> Result<Vec<RayAnswer>, Trouble> {
        let engine = self.reference(params, settings.time)?;
        let mut options = reference::Options { rtol: settings.rtol, ..Default::default() };
        if let Engine::Cpu = self.engine {
            // Relative alone, since a probe has no white.
            options =
                reference::Options { goal: reference::Goal::All, ..reference::Options::accuracy(self.accuracy(), 0.0) };
            if let StepRule::Fixed(n) = self.program.plan.steps {
                options.steps = Some(n);
            }
        }
        let results = engine.rays(rays, &self.by_chance(options)).map_err(|d| self.input(d))?;
        Ok(results
            .into_iter()
            .map(|r| RayAnswer {
                radiance: r.radiance,
                transmittance: r.transmittance,
                optical_depth: r.optical_depth,
                error: r.error,
                error_kind: r.error_kind.name(),
                evaluations: r.evaluations,
            })
            .collect())
    }

    fn probe_gpu(
        &mut self,
        params: &Params,
        rays: &[([f64; 3], [f64; 3])],
        settings: &ProbeSettings,
        change: impl FnOnce(&mut Frame),
    ) -> Result<Vec<RayAnswer>, Trouble> {
        let scene = &self.program.lowered;
        let bounds = scene_bounds(scene, &params.0, settings.time);
        let mut frame = self.frame(params, settings.time, None, bounds);
        change(&mut frame);
        let packed: Vec<_> = rays.iter().map(|(o, d)| pack_ray(*o, *d, bounds)).collect();
        if self.program.plan.footprints.is_some() {
            let starts: Vec<f64> = packed.iter().map(|ray| f64::from(ray[3])).collect();
            frame.footprints = self.footprints_of_rays(params, settings.time, (rays, &starts))?;
            frame.slabs.bounds = self.media_box(params, settings.time);
        }
        let mut answers = vec![RayAnswer::blank(self.program.places.len(), "estimate"); rays.len()];
        let mut faults = FaultTally::default();
        let traced = trace_parts(&mut self.engine, &self.program, &frame, &packed, &mut |reader, ray, record| {
            reader.answer(record, &mut answers[ray]);
            reader.fault(record, &mut faults);
        });
        traced.map_err(|e| self.broken(&e))?;
        if !faults.is_empty() {
            return Err(self.trouble(Cause::Input, faults.diagnostics(&self.program.lowered, "rays")));
        }
        Ok(answers)
    }
}

impl RayAnswer {
    fn blank(bands: usize, error_kind: &'static str) -> Self {
        let zeros = || vec![0.0; bands];
        Self {
            radiance: zeros(),
            transmittance: zeros(),
            optical_depth: zeros(),
            error: zeros(),
            error_kind,
            evaluations: 0,
        }
    }
}

/// What the voxels of a grid can be.
fn values(volume: &Volume) -> Interval {
    let (low, high) = volume.range();
    Interval { low, high, nan: false }
}

/// The error of each band of each pixel that f64 finds and f32 keeps, and where the largest come from.
fn told_apart(pixels: &reference::Pixels, chance: bool) -> (Vec<f64>, Origins) {
    let mut origins = Origins::default();
    let one = |((error, rounding), radiance): ((&f64, &f64), &f64)| {
        // To nearest, and what is denormal there not at all.
        let storage = radiance.abs() * (0.5 * f64::from(f32::EPSILON)) + f64::from(f32::MIN_POSITIVE);
        let rest = error - rounding;
        let (statistical, discretisation) = if chance { (rest, 0.0) } else { (0.0, rest) };
        origins.widen(Origins { discretisation, rounding: *rounding, storage, statistical });
        error + storage
    };
    let errors = pixels.error.iter().zip(&pixels.rounding).zip(&pixels.radiance).map(one).collect();
    (errors, origins)
}

/// The largest of a pixel's errors.
fn largest(errors: &[f64]) -> f32 {
    errors.iter().copied().fold(0.0, f64::max) as f32
}

/// The shaders of every part.
fn emit(program: &Program) -> Result<Vec<Vec<compiler::emit::Shader>>, Diagnostic> {
    let parts = program.parts().map(|part| part.kernels.iter().map(compiler::emit::emit).collect());
    parts.collect::<Result<_, _>>().map_err(|error: compiler::emit::EmitError| error.diagnostic())
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

fn at_file(diagnostic: Diagnostic, span: Option<Span>) -> Diagnostic {
    match span {
        Some(span) => diagnostic.at(span, "this file"),
        None => diagnostic,
    }
}

/// A file that could not be read, of the item of this number.
fn unreadable(
    found: &mut Diagnostics,
    (error, item): (LoadError, usize),
    spans: &[Option<Span>],
    trouble: &dyn Fn(Cause, &Diagnostics) -> Trouble,
) -> Trouble {
    let mut diagnostic = Diagnostic::error(error.code, error.message);
    diagnostic.hints.extend(error.hint);
    found.push(at_file(diagnostic, spans.get(item).copied().flatten()));
    trouble(Cause::Input, found)
}

/// What reading files has found, by their names, each at its item.
fn tell<'f>(
    found: &mut Diagnostics,
    files: impl Iterator<Item = (&'f String, &'f Vec<LoadWarning>)>,
    spans: &[Option<Span>],
) {
    for ((name, warnings), span) in files.zip(spans) {
        for warning in warnings {
            let mut diagnostic = warning.to_diagnostic();
            diagnostic.message = format!("`{name}`: {}", diagnostic.message);
            found.push(at_file(diagnostic, *span));
        }
    }
}

fn machine(error: &GpuError) -> Diagnostic {
    let mut diagnostic = Diagnostic::error(error.kind.code(), error.message.clone());
    diagnostic.hints.extend(error.hint.clone());
    diagnostic
}

/// The engine, and why it is not the GPU if that would have been taken.
fn choose(
    program: &Arc<Program>,
    shaders: Vec<Vec<compiler::emit::Shader>>,
    (grids, meshes): (&[Loaded], &[LoadedMesh]),
    settings: &Settings,
) -> Result<(Engine, Option<String>), GpuError> {
    let gpu = || {
        let gpu = Arc::new(Gpu::new(&settings.adapter, &Needs::of(program))?);
        let grids: Vec<GridData<'_>> = grids.iter().map(|l| grid_data(&l.volume)).collect();
        let scale = program.lowered.units.scale(1.0);
        let meshes: Vec<Vec<f32>> = meshes.iter().map(|m| mesh_data(&m.mesh, scale)).collect();
        gpu.prepare(program, shaders, SceneData { grids: &grids, meshes: &meshes }).map(Engine::Gpu)
    };
    match settings.engine {
        EngineChoice::Gpu => Ok((gpu()?, None)),
        EngineChoice::Cpu => Ok((Engine::Cpu, None)),
        EngineChoice::Reference => Ok((Engine::Reference, None)),
        EngineChoice::Auto => match gpu() {
            Ok(engine) => Ok((engine, None)),
            Err(error) if error.kind == GpuErrorKind::Unblendable && settings.options.blending == Precision::Single => {
                Err(error)
            }
            // Whoever names an adapter wants that one.
            Err(error) if settings.adapter.name.is_some() => Err(error),
            Err(error) => Ok((Engine::Cpu, Some(error.message))),
        },
    }
}

/// As kernels read it: the number of nodes, then the tree and the triangles.
fn mesh_data(mesh: &Mesh, scale: f64) -> Vec<f32> {
    let mut data = vec![0.0; 8];
    data[0] = f32::from_bits(mesh.node_count() as u32);
    data.extend(mesh.pack(scale));
    data
}

fn grid_data(volume: &Volume) -> GridData<'_> {
    GridData { header: volume.header(), bytes: volume.bytes() }
}
