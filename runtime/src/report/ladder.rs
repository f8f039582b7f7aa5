//! Which pictures are drawn: what each way to draw can vary, from coarse to fine, within the budget.

use super::compare::{Compared, compare};
use super::fit::fit;
use super::truth::Truth;
use super::{LeftOut, Row, Series, Slope, Study, Way, sentence};
use crate::frame::{Drawing, EngineChoice, Params, Session, TOO_LONG, Trouble};
use compiler::Options;
use compiler::ir::Backend;
use compiler::program::StepRule;
use std::collections::VecDeque;
use std::time::Instant;

/// A picture that takes less is drawn several times, for so many seconds or times at most.
const AGAIN: (f64, usize) = (0.1, 5);
/// Where rounding in f32 begins to be seen: so many units in the last place of the brightest pixel.
const ROUNDINGS: f64 = 32.0;
/// Paths of a pixel that tell how many are needed.
const LOOK: u32 = 128;
/// Trial pictures have so many times fewer pixels along each side.
const TRIALS: [u32; 3] = [8, 4, 2];

/// What a ladder varies.
#[derive(Copy, Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    /// `accuracy`: A.
    Accuracy,
    /// `steps` along a ray.
    Steps,
    /// `slices` across the media.
    Slices,
    /// `splats` that the media are made of.
    Splats,
    /// `samples`: random paths of a pixel.
    Samples,
}

impl Quantity {
    /// The word of the language.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Accuracy => "accuracy",
            Self::Steps => "steps",
            Self::Slices => "slices",
            Self::Splats => "splats",
            Self::Samples => "samples",
        }
    }

    fn ask(self, value: f64, options: &mut Options) {
        match self {
            Self::Accuracy => options.accuracy = Some(value),
            Self::Steps => options.steps = Some(value as u32),
            Self::Slices => options.slices = Some(value as u32),
            Self::Splats => options.splats = Some(value as u32),
            Self::Samples => options.samples = Some(value as u32),
        }
    }

    /// From coarse to fine.
    fn ladder(self) -> Vec<f64> {
        match self {
            Self::Accuracy => vec![3e-1, 1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5],
            Self::Steps | Self::Slices => (1..=11).map(|n| f64::from(1 << n)).collect(),
            // On a lattice: half the spacing is eight times as many.
            Self::Splats => (2..=8).map(|n| 8f64.powi(n)).collect(),
            Self::Samples => (5..=16).map(|n| f64::from(1 << n)).collect(),
        }
    }

    /// How many times longer a picture takes when a value is taken in place of another.
    fn growth(self, from: f64, to: f64, random: bool) -> f64 {
        match self {
            Self::Accuracy if random => (from / to).powi(2),
            // Local errors fall with the square of a step.
            Self::Accuracy => (from / to).sqrt(),
            Self::Steps | Self::Slices | Self::Splats | Self::Samples => to / from,
        }
    }
}

/// How an error should fall.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Theory {
    /// The exponent.
    pub slope: f64,
    /// Why.
    pub reason: &'static str,
}

/// What is known of the rule by which a way to draw takes this quantity.
fn theory(way: Way, quantity: Quantity) -> Option<Theory> {
    let midpoint = Theory {
        slope: -2.0,
        reason: "midpoint rule with the exact exponential inside a step, on fields without jumps inside a step",
    };
    match quantity {
        Quantity::Splats => Some(Theory {
            slope: -2.0 / 3.0,
            reason: "second order in the spacing of a lattice, where fields are smooth",
        }),
        Quantity::Samples => Some(Theory { slope: -0.5, reason: "standard error of a mean" }),
        Quantity::Accuracy => Some(Theory { slope: 1.0, reason: "error in proportion to what is allowed" }),
        Quantity::Steps | Quantity::Slices => match (way.engine, way.backend) {
            (EngineChoice::Cpu | EngineChoice::Reference, _) => Some(midpoint),
            (EngineChoice::Gpu | EngineChoice::Auto, backend) => match backend {
                Backend::Auto | Backend::Raymarch | Backend::Slicing => Some(midpoint),
                Backend::Splatting => None,
            },
        },
    }
}

/// What a plan varies when it is drawn as it stands.
fn own_quantity(session: &Session) -> (Quantity, f64) {
    match session.program().plan.steps {
        StepRule::Fixed(n) => (Quantity::Steps, f64::from(n)),
        StepRule::Paths(Some(n)) => (Quantity::Samples, f64::from(n)),
        StepRule::Slabs { count: Some(n), .. } => (Quantity::Slices, f64::from(n)),
        StepRule::Splats { count: Some(n), .. } => (Quantity::Splats, f64::from(n)),
        StepRule::Slabs { count: None, .. } | StepRule::Splats { count: None, .. } => {
            (Quantity::Accuracy, session.accuracy())
        }
        StepRule::Paths(None) | StepRule::Closed | StepRule::Adaptive(_) => (Quantity::Accuracy, session.accuracy()),
    }
}

/// What a plan of this kind can vary; the processor knows no pieces.
fn quantities(session: &Session, way: Way) -> Vec<Quantity> {
    match session.program().plan.steps {
        StepRule::Splats { .. } | StepRule::Slabs { .. } if way.engine == EngineChoice::Cpu => vec![Quantity::Accuracy],
        StepRule::Closed => vec![],
        StepRule::Fixed(_) | StepRule::Adaptive(_) => vec![Quantity::Accuracy, Quantity::Steps],
        StepRule::Splats { .. } => vec![Quantity::Accuracy, Quantity::Splats],
        StepRule::Slabs { .. } => vec![Quantity::Accuracy, Quantity::Slices],
        StepRule::Paths(_) => vec![Quantity::Accuracy, Quantity::Samples],
    }
}

/// The last picture, or the one that is nearest to what comes.
#[derive(Copy, Clone, Debug)]
struct Last {
    value: f64,
    seconds: f64,
    /// Whether it was drawn; else it would take so long.
    drawn: bool,
}

/// A series while it is being drawn.
pub(super) struct Line {
    way: Way,
    adapter: Option<String>,
    quantity: Quantity,
    random: bool,
    rows: Vec<Row>,
    waiting: VecDeque<f64>,
    last: Last,
    /// Drawn before there was a reference.
    pending: Option<(Row, Drawing)>,
}

/// What a way to draw begins with.
pub(super) struct Begun {
    pub(super) lines: Vec<Line>,
    /// Whether pixels straddle an edge, where it says so.
    pub(super) edges: Vec<bool>,
    /// The scene's own schedule, if it takes too long.
    pub(super) left_out: Option<LeftOut>,
}

/// Why there is no picture.
struct Refused {
    reason: String,
    /// Whether more time would help.
    slow: bool,
}

impl From<&Trouble> for Refused {
    fn from(trouble: &Trouble) -> Self {
        let slow = trouble.diagnostics.iter().any(|d| d.code == TOO_LONG);
        let reason = sentence(trouble);
        Self { reason: if slow { format!("the budget: {reason}") } else { reason }, slow }
    }
}

/// Draws the scene by its own schedule, if that does not take longer than `patience`, else as coarsely as may be; makes a line of each
/// quantity that can be varied. Gives the reason if it cannot be drawn.
pub(super) fn begin(study: &Study<'_>, way: Way, patience: f64) -> Result<Begun, String> {
    let (mut session, params) = study.open(way, study.size, |_| {}).map_err(|t| sentence(&t))?;
    let (own, value) = own_quantity(&session);
    let mut all = quantities(&session, way);
    if !all.contains(&own) {
        all.push(own);
    }
    let closed = matches!(session.program().plan.steps, StepRule::Closed);
    let line = |quantity: Quantity| {
        let mut waiting: VecDeque<f64> = if closed { VecDeque::new() } else { quantity.ladder().into() };
        waiting.retain(|v| quantity != own || *v != value);
        let last = Last { value: waiting.front().copied().unwrap_or(value), seconds: 0.0, drawn: false };
        let random = session.is_random();
        Line { way, adapter: session.adapter(), quantity, random, rows: vec![], waiting, last, pending: None }
    };
    let mut lines: Vec<Line> = all.into_iter().map(line).collect();
    // Where pieces become more until they are enough, the engine itself says when that takes too long.
    let refines = matches!(session.program().plan.steps, StepRule::Slabs { .. } | StepRule::Splats { .. });
    let open_ended = session.is_random() && own == Quantity::Accuracy;
    let expected = if refines && way.engine == EngineChoice::Gpu {
        0.0
    } else if open_ended {
        let few = study.open(way, study.size, |options| options.samples = Some(LOOK));
        let (mut session, params) = few.map_err(|t| sentence(&t))?;
        expected(study, (&mut session, &params), open_ended, patience)?
    } else {
        expected(study, (&mut session, &params), open_ended, patience)?
    };
    let started = Instant::now();
    let drawn = if expected > patience {
        let reason =
            format!("the budget: a picture would take about {expected:.1} s, and {patience:.1} s are its share");
        Err(Refused { reason, slow: true })
    } else {
        session.resize(study.size);
        draw_row(study, (&mut session, &params), None, patience)
    };
    match drawn {
        Ok((mut row, drawing)) => {
            let edges = drawing.edges.clone();
            row.value = value;
            for line in lines.iter_mut().filter(|l| l.quantity == own) {
                line.last = Last { value, seconds: started.elapsed().as_secs_f64(), drawn: true };
                line.pending = Some((row.clone(), drawing.clone()));
            }
            Ok(Begun { lines, edges, left_out: None })
        }
        Err(refused) if refused.slow => {
            let mut omitted = None;
            for line in lines.iter_mut().filter(|l| l.quantity == own) {
                let seconds = if expected > 0.0 { expected } else { patience };
                line.last = Last { value, seconds, drawn: false };
                omitted = Some(line.without(vec![value], refused.reason.clone()));
            }
            // Edges are wanted before there is a reference: of some picture. The processor does not tell them.
            let coarse = lines.iter_mut().rev().filter(|_| way.engine == EngineChoice::Gpu);
            let edges = coarse.filter_map(|line| line.draw_next(study, patience).ok()).find(|e| !e.is_empty());
            let edges = edges.unwrap_or_default();
            Ok(Begun { lines, edges, left_out: omitted })
        }
        Err(refused) => Err(refused.reason),
    }
}

/// How long the scene's own schedule would take: from small pictures, which are drawn twice, since the first time is longer. What does not grow
/// with the number of pixels is told by two of them.
///
/// Where paths are followed until they are enough, a few tell how many that are.
fn expected(
    study: &Study<'_>,
    (session, params): (&mut Session, &Params),
    open_ended: bool,
    patience: f64,
) -> Result<f64, String> {
    let pixels = |size: [u32; 2]| f64::from(size[0]) * f64::from(size[1]);
    let all = pixels(study.size);
    let mut before: Option<(f64, f64)> = None;
    let mut expected = 0.0;
    for shrunk in TRIALS {
        let size = study.size.map(|n| n.div_ceil(shrunk));
        session.resize(size);
        let (mut seconds, mut more) = (f64::INFINITY, 1.0f64);
        for _ in 0..2 {
            let started = Instant::now();
            let drawing = draw(session, params, study.request.time).map_err(|r| r.reason)?;
            seconds = seconds.min(started.elapsed().as_secs_f64());
            // Standard errors fall as 1/√n.
            more = drawing.predicted.map_or(1.0, |(_, share)| share.powi(2)).max(1.0);
            if seconds > patience {
                break;
            }
        }
        let own = pixels(size);
        if open_ended {
            return Ok(seconds * more * all / own);
        }
        let each = match before {
            Some((n, less)) if own > n => ((seconds - less) / (own - n)).max(0.0),
            Some(_) | None => seconds / own,
        };
        expected = seconds + each * (all - own);
        // Another look is worth a quarter of the time.
        if expected <= patience || 4.0 * seconds > 0.25 * patience {
            break;
        }
        before = Some((own, seconds));
    }
    Ok(expected)
}

fn draw(session: &mut Session, params: &Params, time: f64) -> Result<Drawing, Refused> {
    session.draw(params, time, &|_| {}).map_err(|t| Refused::from(&t))
}

/// One picture: the scene's own, or one of a ladder.
fn picture(
    study: &Study<'_>,
    way: Way,
    asked: Option<(Quantity, f64)>,
    patience: f64,
) -> Result<(Row, Drawing), Refused> {
    let ask = |options: &mut Options| {
        if let Some((quantity, value)) = asked {
            quantity.ask(value, options);
        }
    };
    let (mut session, params) = study.open(way, study.size, ask).map_err(|t| Refused::from(&t))?;
    draw_row(study, (&mut session, &params), asked, patience)
}

/// The same of a session that is open.
fn draw_row(
    study: &Study<'_>,
    (session, params): (&mut Session, &Params),
    asked: Option<(Quantity, f64)>,
    patience: f64,
) -> Result<(Row, Drawing), Refused> {
    session.hurry(patience);
    let started = Instant::now();
    let drawing = draw(session, params, study.request.time)?;
    let mut times = vec![drawing.milliseconds];
    while started.elapsed().as_secs_f64() < AGAIN.0 && times.len() < AGAIN.1 && !session.is_random() {
        times.push(draw(session, params, study.request.time)?.milliseconds);
    }
    times.sort_by(f64::total_cmp);
    let (compile_ms, build_ms) = session.milliseconds();
    let row = Row {
        value: asked.map_or(0.0, |(quantity, value)| match (quantity, drawing.splats) {
            // A lattice has as many nodes as fit.
            (Quantity::Splats, Some(n)) => f64::from(n),
            (Quantity::Accuracy | Quantity::Steps | Quantity::Slices | Quantity::Splats | Quantity::Samples, _) => {
                value
            }
        }),
        chosen: asked.is_none(),
        pareto: false,
        steps: session.steps(),
        compile_ms,
        build_ms,
        draw_ms: times[times.len() / 2],
        draws: times.len() as u32,
        clock: drawing.clock,
        evaluations: drawing.evaluations,
        paths: drawing.paths,
        error: super::Errors::default(),
        edges: super::Edges::default(),
        flip: None,
        predicted: None,
        faults: drawing.faults.iter().map(|d| format!("{}: {}", d.code, d.message)).collect(),
        picture: None,
    };
    Ok((row, drawing))
}

/// Draws the ladders, a rung of each at a time, until all is drawn or the budget is spent.
pub(super) fn climb(
    study: &Study<'_>,
    lines: &mut [Line],
    truth: &Truth,
    edges: &[bool],
    left_out: &mut Vec<LeftOut>,
    progress: &dyn Fn(f64, &str),
) {
    let begun = study.spent();
    let all = (study.request.budget - begun).max(1e-3);
    loop {
        // One slow way to draw shall not eat what the others need.
        let waiting = lines.iter().filter(|line| !line.waiting.is_empty()).count();
        if waiting == 0 {
            break;
        }
        let part = if waiting > 1 { 0.5 } else { 1.0 };
        for line in lines.iter_mut() {
            let Some(value) = line.waiting.front().copied() else { continue };
            let (expected, patience) = (line.expected(value), part * study.left());
            if patience < expected.max(0.01) {
                let reason = format!("the budget: the next picture would take about {expected:.1} s");
                let values = line.waiting.drain(..).collect();
                left_out.push(line.without(values, reason));
                continue;
            }
            let share = ((study.spent() - begun) / all).clamp(0.0, 1.0);
            progress(0.5 + 0.5 * share, &format!("{}, {} {value}", line.way.name(), line.quantity.name()));
            match line.draw_next(study, patience) {
                Ok(_) => line.compare_pending(truth, edges),
                Err(refused) => {
                    let mut values = vec![value];
                    // What is finer takes longer.
                    if refused.slow {
                        values.extend(line.waiting.drain(..));
                    }
                    let omitted = line.without(values, refused.reason);
                    let known = left_out.iter_mut().find(|o| {
                        LeftOut { values: vec![], ..(**o).clone() } == LeftOut { values: vec![], ..omitted.clone() }
                    });
                    match known {
                        Some(known) => known.values.extend(omitted.values),
                        None => left_out.push(omitted),
                    }
                }
            }
        }
    }
}

impl Line {
    fn without(&self, values: Vec<f64>, reason: String) -> LeftOut {
        LeftOut {
            engine: self.way.engine_name(),
            backend: self.way.backend_name(),
            quantity: Some(self.quantity),
            values,
            reason,
        }
    }

    /// Seconds that a picture will take.
    fn expected(&self, value: f64) -> f64 {
        let growth = self.quantity.growth(self.last.value, value, self.random);
        // What was drawn has taken what does not grow.
        self.last.seconds * if self.last.drawn { growth.max(1.0) } else { growth }
    }

    /// Draws the next picture of the ladder, to be compared; gives its edges.
    fn draw_next(&mut self, study: &Study<'_>, patience: f64) -> Result<Vec<bool>, Refused> {
        let Some(value) = self.waiting.pop_front() else { return Ok(vec![]) };
        let started = Instant::now();
        let (row, drawing) = picture(study, self.way, Some((self.quantity, value)), patience)?;
        self.last = Last { value, seconds: started.elapsed().as_secs_f64(), drawn: true };
        let edges = drawing.edges.clone();
        self.pending = Some((row, drawing));
        Ok(edges)
    }

    pub(super) fn compare_pending(&mut self, truth: &Truth, edges: &[bool]) {
        let Some((mut row, drawing)) = self.pending.take() else { return };
        let Compared { error, edges, flip, predicted, comparison } = compare(&drawing, truth, edges);
        (row.error, row.edges, row.flip, row.predicted) = (error, edges, flip, predicted);
        row.picture = Some(comparison);
        self.rows.push(row);
        // Pictures of the middle of a ladder are not worth their memory.
        let coarse_to_fine = |a: &Row, b: &Row| match self.quantity {
            Quantity::Accuracy => b.value.total_cmp(&a.value),
            Quantity::Steps | Quantity::Slices | Quantity::Splats | Quantity::Samples => a.value.total_cmp(&b.value),
        };
        self.rows.sort_by(coarse_to_fine);
        let end = self.rows.len() - 1;
        for row in self.rows.iter_mut().take(end).skip(1).filter(|r| !r.chosen) {
            row.picture = None;
        }
    }

    pub(super) fn finish(self, truth: &Truth) -> Option<Series> {
        if self.rows.is_empty() {
            return None;
        }
        Some(Series {
            engine: self.way.engine_name(),
            adapter: self.adapter,
            backend: self.way.backend_name(),
            quantity: self.quantity,
            slope: slope(&self.rows, self.quantity, truth),
            theory: if self.rows.len() > 1 { theory(self.way, self.quantity) } else { None },
            rows: self.rows,
        })
    }
}

/// The slope of the finest pictures whose error is well above what the reference and f32 can tell: that is where theory
/// speaks. Of random pictures all, less the variance of the reference.
fn slope(rows: &[Row], quantity: Quantity, truth: &Truth) -> Option<Slope> {
    let own = truth.facts().rms_error;
    if truth.is_random() {
        let points = rows.iter().map(|r| (place(r, quantity), r.error.rms.powi(2) - own * own));
        return fit(&points.filter(|p| p.1 > own * own).map(|(x, y)| (x, y.sqrt())).collect::<Vec<_>>());
    }
    const FINEST: usize = 5;
    let brightest = truth.radiance.iter().copied().fold(truth.white, f64::max);
    let floor = (5.0 * own).max(ROUNDINGS * f64::from(f32::EPSILON) * brightest);
    let points: Vec<_> = rows.iter().map(|r| (r.value, r.error.rms)).filter(|p| p.1 > floor).collect();
    fit(&points[points.len().saturating_sub(FINEST)..])
}

/// Paths come in whole batches: as many as were drawn count, not as many as were asked for.
fn place(row: &Row, quantity: Quantity) -> f64 {
    match (quantity, row.paths) {
        (Quantity::Samples, Some(n)) => n as f64,
        (Quantity::Samples | Quantity::Steps | Quantity::Slices | Quantity::Splats | Quantity::Accuracy, _) => {
            row.value
        }
    }
}
