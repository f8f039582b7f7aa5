//! Which pictures are drawn: what each way to draw can vary, from coarse to fine, within the budget.

use super::compare::{Compared, compare};
use super::fit::fit;
use super::truth::Truth;
use super::{LeftOut, Row, Series, Slope, Study, Way, sentence};
use crate::frame::{Drawing, EngineChoice, Params, Session};
use compiler::Options;
use compiler::ir::Backend;
use compiler::program::{Plan, StepRule};
use std::collections::VecDeque;
use std::time::Instant;

/// A picture that takes less is drawn several times, for so many seconds or times at most.
const AGAIN: (f64, usize) = (0.1, 5);
/// Where rounding in f32 begins to be seen: so many units in the last place of the brightest pixel.
const ROUNDINGS: f64 = 32.0;
/// A trial picture has so many times fewer pixels along each side.
const TRIAL: u32 = 8;

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

/// What a plan of this kind can vary.
fn quantities(plan: &Plan) -> Vec<Quantity> {
    match plan.steps {
        StepRule::Closed => vec![],
        StepRule::Fixed(_) | StepRule::Adaptive(_) => vec![Quantity::Accuracy, Quantity::Steps],
        StepRule::Splats { .. } => vec![Quantity::Accuracy, Quantity::Splats],
        StepRule::Slabs { .. } => vec![Quantity::Accuracy, Quantity::Slices],
        StepRule::Paths(_) => vec![Quantity::Accuracy, Quantity::Samples],
    }
}

/// A series while it is being drawn.
pub(super) struct Line {
    way: Way,
    adapter: Option<String>,
    quantity: Quantity,
    random: bool,
    rows: Vec<Row>,
    waiting: VecDeque<f64>,
    /// Value and seconds of the last picture, or of the one that is nearest to what comes.
    last: (f64, f64),
    /// Drawn before there was a reference.
    pending: Option<(Row, Drawing)>,
}

/// Draws the scene by its own schedule, if that does not take longer than `patience`, and makes a line of each quantity that
/// can be varied. Gives the reason if it cannot be drawn.
pub(super) fn begin(study: &Study<'_>, way: Way, patience: f64) -> Result<(Vec<Line>, Drawing), String> {
    let trial = study.size.map(|n| n.div_ceil(TRIAL));
    let share = f64::from(study.size[0] * study.size[1]) / f64::from(trial[0] * trial[1]);
    let (mut session, params) = study.open(way, trial, |_| {}).map_err(|t| sentence(&t))?;
    let started = Instant::now();
    draw(&mut session, &params, study.request.time)?;
    let seconds = started.elapsed().as_secs_f64() * share;
    // A picture so small takes longer for each pixel than a larger one on a GPU.
    let expected = if way.engine == EngineChoice::Gpu { seconds / 4.0 } else { seconds };
    if expected > patience {
        return Err(format!(
            "the budget: a picture would take about {expected:.0} s, and {patience:.0} s are its share"
        ));
    }
    let started = Instant::now();
    let (row, drawing, session) = picture(study, way, None)?;
    let seconds = started.elapsed().as_secs_f64();
    let (own, value) = own_quantity(&session);
    let mut lines: Vec<Line> = vec![];
    let mut all = quantities(&session.program().plan);
    if !all.contains(&own) {
        all.push(own);
    }
    let closed = matches!(session.program().plan.steps, StepRule::Closed);
    for quantity in all {
        let mut waiting: VecDeque<f64> = if closed { VecDeque::new() } else { quantity.ladder().into() };
        waiting.retain(|v| quantity != own || *v != value);
        let last = if quantity == own { (value, seconds) } else { (waiting[0], 0.0) };
        lines.push(Line {
            way,
            adapter: session.adapter(),
            quantity,
            random: session.is_random(),
            rows: vec![],
            waiting,
            last,
            pending: None,
        });
    }
    if let Some(line) = lines.iter_mut().find(|l| l.quantity == own) {
        let mut row = row;
        row.value = value;
        line.pending = Some((row, drawing.clone()));
    }
    Ok((lines, drawing))
}

fn draw(session: &mut Session, params: &Params, time: f64) -> Result<Drawing, String> {
    session.draw(params, time, &|_| {}).map_err(|t| sentence(&t))
}

/// One picture: the scene's own, or one of a ladder.
fn picture(study: &Study<'_>, way: Way, asked: Option<(Quantity, f64)>) -> Result<(Row, Drawing, Session), String> {
    let ask = |options: &mut Options| {
        if let Some((quantity, value)) = asked {
            quantity.ask(value, options);
        }
    };
    let (mut session, params) = study.open(way, study.size, ask).map_err(|t| sentence(&t))?;
    let started = Instant::now();
    let drawing = draw(&mut session, &params, study.request.time)?;
    let mut times = vec![drawing.milliseconds];
    while started.elapsed().as_secs_f64() < AGAIN.0 && times.len() < AGAIN.1 && !session.is_random() {
        times.push(draw(&mut session, &params, study.request.time)?.milliseconds);
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
    Ok((row, drawing, session))
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
            let Some(value) = line.waiting.pop_front() else { continue };
            let expected = line.last.1 * line.quantity.growth(line.last.0, value, line.random).max(1.0);
            if part * study.left() < expected.max(0.01) {
                let mut values = vec![value];
                values.extend(line.waiting.drain(..));
                let reason = format!("the budget: the next picture would take about {expected:.1} s");
                left_out.push(line.without(values, reason));
                continue;
            }
            let share = ((study.spent() - begun) / all).clamp(0.0, 1.0);
            progress(0.5 + 0.5 * share, &format!("{}, {} {value}", line.way.name(), line.quantity.name()));
            let started = Instant::now();
            match picture(study, line.way, Some((line.quantity, value))) {
                Ok((row, drawing, _)) => {
                    line.last = (value, started.elapsed().as_secs_f64());
                    line.pending = Some((row, drawing));
                    line.compare_pending(truth, edges);
                }
                Err(reason) => left_out.push(line.without(vec![value], reason)),
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
