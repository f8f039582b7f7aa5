//! A numerical trial: a scene as it stands and as it might come to be, on every engine and backend, each picture looked at for what
//! no picture may have.
//!
//! # What is changed
//! - Params: each at both ends of its range, all at once, and beyond them.
//! - Lengths: a million times larger and smaller, in the checked scene where numbers have dimensions
//!   ([`compiler::trial::Change::Lengths`]); grids and meshes on their way in. The picture must stay the same.
//! - The camera: inside, far away (1e7 radii, the field of view narrowed so that the scene still fills it), grazing the scene's outline,
//!   and on faces of shapes, looking along them and in.
//! - Coefficients: none at all, hardly any, and up to 1e30 times as many, in the field graph.
//! - Phase functions: Henyey and Greenstein's with a mean cosine of ±0.999999.
//! - Voxels: NaN, infinite, negative and denormal ones among the good.
//! - Sizes of the picture: none, one pixel, a very wide one.
//! - A white furnace, in which no pixel may be brighter than the background.
//!
//! # What a picture may not have
//! A radiance that is NaN, infinite or negative; an error that is larger than what was reported of it *and* larger than what `accuracy`
//! allows (a bound: larger than reported); in the furnace, more than the background's radiance. A program may not panic.
//! Pixels off edges are compared with the reference engine, as many as fit in their share of the time. A pixel whose ray passes an edge
//! within the rounding of f32 is right if it has the light of either side: before it counts as wrong, the reference looks at the rays
//! around it.
//!
//! A change that asks for what cannot be drawn may be refused with a diagnostic, and a picture of no pixels must be.

mod cases;
mod files;
mod invent;
mod judge;

pub use cases::Case;
pub use invent::invent;

use crate::engine::gpu::AdapterChoice;
use crate::frame::{Camera, Cause, Drawing, EngineChoice, Params, SceneFiles, Session, Settings, Trouble};
use crate::report::{Way, sentence, ways};
use cases::{Setup, Tolerance, Twist};
use compiler::Options;
use compiler::ir::Backend;
use compiler::program::OutputKind;
use files::Altered;
use judge::{Found, judge};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// Pictures are this large unless they take too long or the case says otherwise.
const SIZE: [u32; 2] = [24, 16];
/// Smaller ones that are tried for scenes that take long.
const SMALLER: [[u32; 2]; 2] = [[12, 8], [6, 4]];
/// And a very small one that shows how long a picture takes.
const FEW: [u32; 2] = [3, 2];
/// A case whose picture takes a larger part of the budget than this is left out.
const PART: f64 = 0.2;

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Request {
    /// Values of params: `name=value`.
    pub sets: Vec<String>,
    /// Only this one of the registry.
    pub backend: Option<Backend>,
    /// Only this one of `gpu` and `cpu`.
    pub engine: Option<EngineChoice>,
    /// Which adapter.
    pub adapter: AdapterChoice,
    /// Seconds that a scene may take, about.
    pub budget: f64,
    /// Of random numbers.
    pub seed: u64,
}

/// How a case ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The picture has nothing that it may not have.
    Passed,
    /// There is no picture but a diagnostic that says why, as there should be.
    Refused(String),
    /// What is wrong.
    Failed(Vec<String>),
    /// Not drawn, and why.
    LeftOut(String),
}

/// What the picture is like.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Pixels.
    pub size: [u32; 2],
    /// Least, mean and largest radiance over pixels and bands, in lx.
    pub radiance: [f64; 3],
    /// Pixels that were compared with the reference.
    pub compared: u32,
    /// The largest measured error of those, in lx.
    pub error: f64,
    /// The largest error that the engine reports, in lx.
    pub reported: Option<f64>,
    /// Pixels that differ as edges do, and were granted.
    pub apart: u32,
    /// Median of the reported over the measured error, over pixels where rounding is not all there is.
    pub useful: Option<f64>,
}

/// One case on one engine.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// What was changed.
    pub case: Case,
    /// `gpu` or `cpu`.
    pub engine: &'static str,
    /// The backend; none on the processor.
    pub backend: Option<&'static str>,
    /// How it ended.
    pub verdict: Verdict,
    /// The picture, if there is one.
    pub look: Option<Look>,
    /// Of the whole case.
    pub milliseconds: f64,
}

/// Every case of a scene.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Name of the scene.
    pub scene: String,
    /// In the order in which they were tried.
    pub outcomes: Vec<Outcome>,
    /// Seconds.
    pub spent: f64,
}

impl Trial {
    /// How many passed, were refused, failed and were left out.
    #[must_use]
    pub fn counts(&self) -> [usize; 4] {
        let mut counts = [0; 4];
        for outcome in &self.outcomes {
            counts[match outcome.verdict {
                Verdict::Passed => 0,
                Verdict::Refused(_) => 1,
                Verdict::Failed(_) => 2,
                Verdict::LeftOut(_) => 3,
            }] += 1;
        }
        counts
    }
}

struct Study<'a> {
    name: &'a str,
    text: &'a str,
    files: &'a dyn SceneFiles,
    request: &'a Request,
    started: Instant,
}

/// Puts a scene through every case that applies to it. `progress` is told the share that is done and the case; each outcome is
/// handed out as soon as it is known.
///
/// # Errors
/// When the scene cannot be compiled as it stands, or params do not fit.
pub fn stress(
    name: &str,
    text: &str,
    files: &dyn SceneFiles,
    request: &Request,
    progress: &dyn Fn(f64, &str),
    each: &mut dyn FnMut(&Outcome),
) -> Result<Trial, Trouble> {
    let study = Study { name, text, files, request, started: Instant::now() };
    let reference = Way { engine: EngineChoice::Reference, backend: Backend::Raymarch };
    let (session, params) = study.open(reference, &Setup::plain("as it is"), SIZE)?;
    Ok(study.every(&cases::all(&session, &params), progress, each))
}

/// The same with the scene as it stands alone.
#[must_use]
pub fn as_it_is(name: &str, text: &str, files: &dyn SceneFiles, request: &Request) -> Trial {
    let study = Study { name, text, files, request, started: Instant::now() };
    study.every(&[Setup::plain("as it is")], &|_, _| {}, &mut |_| {})
}

impl Study<'_> {
    fn every(&self, setups: &[Setup], progress: &dyn Fn(f64, &str), each: &mut dyn FnMut(&Outcome)) -> Trial {
        let ways = ways(self.request.engine, self.request.backend);
        let mut outcomes: Vec<Outcome> = vec![];
        let total = (setups.len() * ways.len()) as f64;
        for (number, way) in ways.iter().enumerate() {
            // None shall eat what the others need.
            let until = self.request.budget * (number + 1) as f64 / ways.len() as f64;
            let mut run = Run { study: self, way: *way, size: SIZE, plain: None, gone: None };
            for (i, setup) in setups.iter().enumerate() {
                progress(outcomes.len() as f64 / total, &format!("{}: {}", way.name(), setup.case.name));
                let outcome = run.case(setup, (until - self.spent()) / (setups.len() - i) as f64);
                each(&outcome);
                outcomes.push(outcome);
            }
        }
        progress(1.0, "done");
        Trial { scene: self.name.to_owned(), outcomes, spent: self.spent() }
    }

    fn spent(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn open(&self, way: Way, setup: &Setup, size: [u32; 2]) -> Result<(Session, Params), Trouble> {
        let (stretch, poison) = match setup.twist {
            Twist::Change(compiler::trial::Change::Lengths(factor)) => (factor, None),
            Twist::Voxels(poison) => (1.0, Some(poison)),
            Twist::None | Twist::Change(_) | Twist::Params(_) | Twist::Camera(_) | Twist::Size(_) => (1.0, None),
        };
        let options = Options {
            outputs: vec![
                OutputKind::Radiance,
                OutputKind::Transmittance,
                OutputKind::Error,
                OutputKind::Fault,
                OutputKind::Edge,
            ],
            backend: Some(way.backend),
            size: Some(size),
            change: match setup.twist {
                Twist::Change(change) => Some(change),
                Twist::None | Twist::Voxels(_) | Twist::Params(_) | Twist::Camera(_) | Twist::Size(_) => None,
            },
            ..Options::default()
        };
        let settings =
            Settings { options, engine: way.engine, adapter: self.request.adapter.clone(), seed: self.request.seed };
        let altered = Altered { inner: self.files, stretch, poison };
        let session = Session::open(self.name, self.text, &altered, settings)?;
        let (params, _) = session.params(&self.request.sets)?;
        Ok((session, params))
    }
}

/// The cases of one way to draw.
struct Run<'a> {
    study: &'a Study<'a>,
    way: Way,
    size: [u32; 2],
    /// The picture of the scene as it stands, for what must not change it.
    plain: Option<Drawing>,
    /// Why nothing can be drawn this way.
    gone: Option<String>,
}

impl Run<'_> {
    fn case(&mut self, setup: &Setup, share: f64) -> Outcome {
        let started = Instant::now();
        let caught = catch_unwind(AssertUnwindSafe(|| self.attempt(setup, share)));
        let (verdict, look) = caught.unwrap_or_else(|panic| {
            let said = panic.downcast_ref::<String>().map(String::as_str);
            let said = said.or(panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
            (Verdict::Failed(vec![format!("panic: {said}")]), None)
        });
        Outcome {
            case: setup.case.clone(),
            engine: self.way.engine_name(),
            backend: self.way.backend_name(),
            verdict,
            look,
            milliseconds: started.elapsed().as_secs_f64() * 1e3,
        }
    }

    fn attempt(&mut self, setup: &Setup, share: f64) -> (Verdict, Option<Look>) {
        if let Some(reason) = &self.gone {
            return (Verdict::LeftOut(reason.clone()), None);
        }
        if share <= 0.0 {
            return (Verdict::LeftOut("the budget is spent".into()), None);
        }
        let mut size = if let Twist::Size(size) = setup.twist { size } else { self.size };
        if let Some(expected) = self.too_long(setup, size) {
            return (Verdict::LeftOut(format!("the budget: it would take about {expected:.0} s")), None);
        }
        let wide = u64::from(size[0]) * u64::from(size[1]) > 4096;
        if let (true, Some(plain)) = (wide, &self.plain) {
            // Only where it does not take long: what is tried is the size, not the patience.
            let each = plain.milliseconds / 1e3 / f64::from(self.size[0] * self.size[1]);
            let expected = each * f64::from(size[0]) * f64::from(size[1]);
            let allowed = PART * self.study.request.budget;
            if expected > allowed {
                return (Verdict::LeftOut(format!("the budget: it would take about {expected:.0} s")), None);
            }
        }
        let is_plain = matches!(setup.twist, Twist::None);
        loop {
            let found = self.draw(setup, size, share);
            // The reference has its own limit, in which a smaller picture gets it no farther.
            let seconds = found.as_ref().map_or(0.0, |found| found.drawing.milliseconds / 1e3);
            // A scene that takes long is tried small.
            let next = SMALLER.iter().find(|s| s[0] < self.size[0]);
            if let (true, Ok(_), Some(next)) = (is_plain, &found, next)
                && seconds > 0.5 * share.max(0.3) + 0.5
            {
                (self.size, size) = (*next, *next);
                continue;
            }
            return match found {
                Ok(found) => {
                    let verdict = if found.wrong.is_empty() { Verdict::Passed } else { Verdict::Failed(found.wrong) };
                    if is_plain {
                        self.plain = Some(found.drawing);
                    }
                    (verdict, Some(found.look))
                }
                Err(trouble) => (self.refusal(setup, &trouble, is_plain), None),
            };
        }
    }

    /// How many seconds a picture takes on the processor, which cannot be interrupted, if they are too many.
    fn too_long(&self, setup: &Setup, size: [u32; 2]) -> Option<f64> {
        let all = f64::from(size[0]) * f64::from(size[1]);
        let few = f64::from(FEW[0] * FEW[1]);
        if self.way.engine != EngineChoice::Cpu || matches!(setup.twist, Twist::None) || all <= few {
            return None;
        }
        let started = Instant::now();
        // What is wrong with it will show in the picture.
        let (mut session, params) = self.open(setup, FEW).ok()?;
        session.draw(&params, 0.0, &|_| {}).ok()?;
        let expected = started.elapsed().as_secs_f64() * all / few;
        (expected > (PART * self.study.request.budget).max(1.0)).then_some(expected)
    }

    /// The session of a case, with its params and its camera.
    fn open(&self, setup: &Setup, size: [u32; 2]) -> Result<(Session, Params), Trouble> {
        let (mut session, mut params) = self.study.open(self.way, setup, size)?;
        if let Twist::Params(values) = &setup.twist {
            for (index, value) in values {
                params.0[*index].clone_from(value);
            }
        }
        let camera: Option<Camera> = if let Twist::Camera(camera) = setup.twist { Some(camera) } else { None };
        session.look_from(camera);
        Ok((session, params))
    }

    fn refusal(&mut self, setup: &Setup, trouble: &Trouble, is_plain: bool) -> Verdict {
        let said = sentence(trouble);
        if is_plain && trouble.cause == Cause::Machine
            || is_plain && self.way.engine == EngineChoice::Gpu && cannot(trouble)
        {
            // No adapter, or a backend that cannot draw this kind of scene: no fault of the scene's.
            self.gone = Some(said.clone());
            return Verdict::LeftOut(said);
        }
        if trouble.diagnostics.iter().any(|d| d.code == "E0656") {
            // The driver's limit, which is told and drawn nowhere.
            return Verdict::LeftOut(said);
        }
        let allowed = match setup.tolerance {
            Tolerance::None => false,
            Tolerance::MayRefuse | Tolerance::MustRefuse => trouble.cause != Cause::Machine,
        };
        if allowed { Verdict::Refused(said) } else { Verdict::Failed(vec![format!("refused: {said}")]) }
    }

    fn draw(&self, setup: &Setup, size: [u32; 2], share: f64) -> Result<Found, Trouble> {
        let (mut session, params) = self.open(setup, size)?;
        let drawing = session.draw(&params, 0.0, &|_| {})?;
        judge(&session, drawing, setup, self.plain.as_ref(), share)
    }
}

/// Whether a backend says that it is not made for a scene.
fn cannot(trouble: &Trouble) -> bool {
    trouble.diagnostics.iter().any(|d| d.code.starts_with("E09"))
}
