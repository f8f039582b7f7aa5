//! What is wrong with a picture.

use super::Look;
use super::cases::{Expect, Setup, Tolerance};
use crate::frame::{Cause, Drawing, Session, Trouble, difference};
use crate::report::Truth;
use std::time::{Duration, Instant};

/// A part of the time of a case goes into its reference, within these seconds.
const COMPARE: f64 = 0.5;
const SECONDS: (f64, f64) = (0.15, 3.0);
/// Pixels that may lie on edges within rounding, before they count as wrong unseen.
const LOOKED_AT: usize = 32;
/// How far rounding moves a ray, in pixels per pixel of the picture's longer side: 64 units in the last place of an f32.
const ROUNDING: f64 = 64.0 / 16_777_216.0;
/// Standard errors that a pixel may be off, and the part of the pixels that may be off by more.
const SIGMAS: f64 = 5.0;
const UNLUCKY: f64 = 0.03;

/// A picture that was looked at.
pub(super) struct Found {
    pub(super) drawing: Drawing,
    pub(super) look: Look,
    pub(super) wrong: Vec<String>,
}

pub(super) fn judge(
    session: &Session,
    drawing: Drawing,
    setup: &Setup,
    plain: Option<&Drawing>,
    share: f64,
) -> Result<Found, Trouble> {
    if drawing.faults.has_errors() {
        let sources = session.sources().clone();
        return Err(Trouble { cause: Cause::Input, diagnostics: drawing.faults, sources });
    }
    let size = drawing.picture.size();
    let mut wrong = vec![];
    if setup.tolerance == Tolerance::MustRefuse {
        wrong.push("a picture that cannot be was drawn".to_owned());
    }
    let bands = drawing.picture.bands().wavelengths.len();
    let radiance = drawing.picture.radiance();
    counted(&mut wrong, radiance, "radiance", size, bands);
    if let Some(transmittance) = drawing.picture.transmittance() {
        counted(&mut wrong, transmittance, "transmittance", size, bands);
        let above = transmittance.iter().filter(|t| **t > 1.0 + 1e-5).count();
        if above > 0 {
            wrong.push(format!("{above} transmittances are above 1"));
        }
    }
    let sum = |f: fn(f64, f64) -> f64, start: f64| radiance.iter().map(|v| f64::from(*v)).fold(start, f);
    let mut look = Look {
        size,
        radiance: [
            sum(f64::min, f64::INFINITY),
            sum(|a, b| a + b, 0.0) / radiance.len().max(1) as f64,
            sum(f64::max, f64::NEG_INFINITY),
        ],
        reported: drawing.predicted.map(|p| p.0),
        ..Look::default()
    };
    expected(&mut wrong, session, &drawing, setup, plain);
    compared(&mut wrong, &mut look, session, &drawing, share)?;
    Ok(Found { drawing, look, wrong })
}

/// What no number of a picture may be.
fn counted(wrong: &mut Vec<String>, list: &[f32], what: &str, [width, _]: [u32; 2], bands: usize) {
    let kinds: [(&str, fn(&f32) -> bool); 3] =
        [("not a number", |v| v.is_nan()), ("infinite", |v| v.is_infinite()), ("negative", |v| *v < 0.0)];
    for (name, is) in kinds {
        let mut places = list.iter().enumerate().filter(|(_, v)| is(v)).map(|(i, v)| (i / bands, *v));
        if let Some((pixel, value)) = places.next() {
            let (x, y) = (pixel % width as usize, pixel / width as usize);
            let many = 1 + places.count();
            wrong.push(format!("{what} is {name} in {many} numbers, the first at pixel ({x}, {y}): {value:e}"));
        }
    }
}

fn error_of(drawing: &Drawing, pixel: usize) -> f64 {
    let times = if drawing.error_kind == "standard-error" { SIGMAS } else { 1.0 };
    times * drawing.errors.get(pixel).map_or(0.0, |e| f64::from(*e))
}

/// The white furnace, and pictures that must not change.
fn expected(wrong: &mut Vec<String>, session: &Session, drawing: &Drawing, setup: &Setup, plain: Option<&Drawing>) {
    let bands = drawing.picture.bands().wavelengths.len();
    let accuracy = session.accuracy();
    let random = drawing.error_kind == "standard-error";
    let mut off = vec![];
    for (pixel, drawn) in drawing.picture.radiance().chunks_exact(bands).enumerate() {
        for (band, value) in drawn.iter().map(|v| f64::from(*v)).enumerate() {
            let own = error_of(drawing, pixel) + 1e-5 + if random { 0.0 } else { accuracy };
            let (bad, expected) = match (setup.expect, plain) {
                (Expect::Nothing, _) | (Expect::Same, None) => (false, 0.0),
                (Expect::AtMostOne, _) => (value > 1.0 + own, 1.0),
                (Expect::One, _) => ((value - 1.0).abs() > own, 1.0),
                (Expect::Same, Some(plain)) => {
                    let before = plain.picture.radiance().get(pixel * bands + band).map_or(0.0, |v| f64::from(*v));
                    let edge = plain.edges.get(pixel).copied().unwrap_or(false);
                    let white = session.white(&drawing.params, drawing.time);
                    let allowed = own + error_of(plain, pixel) + 2.0 * accuracy * white.max(before);
                    (!edge && difference(value, before) > allowed, before)
                }
            };
            if bad {
                off.push((pixel, value, expected));
            }
        }
    }
    let few = if random { (UNLUCKY * drawing.picture.radiance().len() as f64) as usize } else { 0 };
    if off.len() > few
        && let Some((pixel, value, expected)) = off.first()
    {
        let what = match setup.expect {
            Expect::AtMostOne | Expect::One if *value > *expected => "energy is gained",
            Expect::AtMostOne | Expect::One => "energy is lost",
            Expect::Same | Expect::Nothing => "the picture depends on the unit of length",
        };
        let (many, width) = (off.len(), drawing.picture.size()[0] as usize);
        let (x, y) = (pixel % width, pixel / width);
        wrong.push(format!(
            "{what} in {many} numbers, the first at pixel ({x}, {y}): {value:e} lx, not {expected:e} lx"
        ));
    }
}

/// A pixel that is farther from the reference than it may be.
struct Broken {
    pixel: usize,
    measured: f64,
    allowed: f64,
}

fn compared(
    wrong: &mut Vec<String>,
    look: &mut Look,
    session: &Session,
    drawing: &Drawing,
    share: f64,
) -> Result<(), Trouble> {
    let (params, time) = (&drawing.params, drawing.time);
    let mut truth = Truth::rough(session, params, time);
    let seconds = (COMPARE * share).clamp(SECONDS.0, SECONDS.1);
    let until = Instant::now() + Duration::from_secs_f64(seconds);
    let edges = if drawing.edges.is_empty() { vec![false; truth.known.len()] } else { drawing.edges.clone() };
    truth.draw(session, params, time, &edges, (false, until), &|_| {})?;
    let bands = truth.bands;
    let (mut broken, mut useful) = (vec![], vec![]);
    for (pixel, drawn) in drawing.picture.radiance().chunks_exact(bands).enumerate() {
        if !truth.known[pixel] || edges[pixel] {
            continue;
        }
        let exact = &truth.radiance[pixel * bands..][..bands];
        let measured = drawn.iter().zip(exact).map(|(a, b)| difference(f64::from(*a), *b)).fold(0.0, f64::max);
        let brightest = exact.iter().copied().fold(truth.white, f64::max);
        look.compared += 1;
        look.error = look.error.max(measured);
        let own = truth.error[pixel];
        let said = error_of(drawing, pixel);
        if measured > 4.0 * (own + brightest * f64::from(f32::EPSILON)) {
            useful.push(said / measured);
        }
        let allowed = match drawing.error_kind {
            "standard-error" => said.hypot(SIGMAS * own),
            "bound" => said + own,
            // An estimate is no promise, but accuracy is.
            _ => said.max(truth.accuracy * brightest) + own,
        } + brightest * f64::from(f32::EPSILON);
        if !(measured <= allowed) {
            broken.push(Broken { pixel, measured, allowed });
        }
    }
    useful.sort_by(f64::total_cmp);
    look.useful = useful.get(useful.len() / 2).copied();
    let few =
        if drawing.error_kind == "standard-error" { (UNLUCKY * f64::from(look.compared)).ceil() as usize } else { 0 };
    if broken.len() <= few {
        return Ok(());
    }
    if broken.len() <= LOOKED_AT {
        let before = broken.len();
        broken = off_edges(session, drawing, &truth, broken)?;
        look.apart = (before - broken.len()) as u32;
    }
    let worst = broken.iter().max_by(|a, b| (a.measured / a.allowed).total_cmp(&(b.measured / b.allowed)));
    if let Some(Broken { pixel, measured, allowed }) = worst.filter(|_| broken.len() > few) {
        let width = drawing.picture.size()[0] as usize;
        wrong.push(format!(
            "{} of {} pixels are farther from the reference than reported and allowed, the worst at ({}, {}): {measured:.3e} lx, not {allowed:.3e} lx",
            broken.len(),
            look.compared,
            pixel % width,
            pixel / width
        ));
    }
    Ok(())
}

/// Those of them that stay wrong when their rays may be moved by rounding: on an edge the light of either side is right.
fn off_edges(session: &Session, drawing: &Drawing, truth: &Truth, broken: Vec<Broken>) -> Result<Vec<Broken>, Trouble> {
    let width = drawing.picture.size()[0];
    let pixels: Vec<[u32; 2]> = broken.iter().map(|b| [b.pixel as u32 % width, b.pixel as u32 / width]).collect();
    let bands = truth.bands;
    let move_by = ROUNDING * f64::from(drawing.picture.size().into_iter().max().unwrap_or(1));
    let mut range: Vec<(f64, f64)> =
        broken.iter().flat_map(|b| truth.radiance[b.pixel * bands..][..bands].iter().map(|v| (*v, *v))).collect();
    for [dx, dy] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
        let offsets: Vec<[f64; 2]> =
            truth.offsets().iter().map(|[x, y]| [x + dx * move_by, y + dy * move_by]).collect();
        let rays = (pixels.as_slice(), offsets.as_slice());
        let moved = session.exact_pixels(&drawing.params, drawing.time, rays, truth.options())?;
        for ((low, high), value) in range.iter_mut().zip(moved.radiance) {
            (*low, *high) = (low.min(value), high.max(value));
        }
    }
    let stays = |(i, b): &(usize, Broken)| {
        let drawn = &drawing.picture.radiance()[b.pixel * bands..][..bands];
        let own = &range[i * bands..][..bands];
        !drawn.iter().zip(own).all(|(v, (l, h))| (l - b.allowed..=h + b.allowed).contains(&f64::from(*v)))
    };
    Ok(broken.into_iter().enumerate().filter(stays).map(|(_, b)| b).collect())
}
