//! Where stretches of a ray are divided for the sake of quantities that are watched.

use super::events::Watch;
use super::gauss::{Decay, Nodes, RULE, monotone, root};

/// Cuts where a straight quantity passes levels on its way from `g0` at `start` to `g1` at `end`.
pub(super) fn cuts_of(
    (g0, g1): (f64, f64),
    (start, end): (f64, f64),
    levels: &super::events::Levels,
    most: f64,
    cuts: &mut Vec<(f64, bool)>,
) {
    if !g0.is_finite() || !g1.is_finite() || g0 == g1 || levels.count(g0.min(g1), g0.max(g1)) > most {
        return;
    }
    levels.visit(g0.min(g1), g0.max(g1), |level| {
        let t = start + (end - start) * ((level - g0) / (g1 - g0));
        if t > start && t < end {
            cuts.push((t, levels.soft));
        }
    });
}

/// Sorts divisions and drops those at the ends and those that coincide.
pub(super) fn sort_splits(xs: &mut Vec<(f64, bool)>) {
    xs.retain(|x| x.0 > 1e-12 && x.0 < 1.0 - 1e-12);
    xs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    xs.dedup_by(|b, a| b.0 - a.0 < 1e-12);
}

/// Sorts cuts and drops those that coincide, and when rough also two of three in every run of soft ones.
pub(super) fn thin(mut cuts: Vec<(f64, bool)>, rough: bool) -> Vec<f64> {
    cuts.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut kept: Vec<f64> = vec![];
    let mut skipped = 0;
    for (t, soft) in cuts {
        if kept.last().is_some_and(|last| t - last <= 4.0 * f64::EPSILON * t.abs()) {
            continue;
        }
        if rough && soft && skipped < 2 {
            skipped += 1;
            continue;
        }
        skipped = 0;
        kept.push(t);
    }
    kept
}

/// Where in a panel (0..1) it should be divided for the sake of one watched quantity.
pub(super) fn splits_of(values: &Nodes, watch: &Watch, forced: u8, lean: bool, out: &mut Vec<(f64, bool)>) {
    if values.iter().any(|v| !v.is_finite()) {
        return;
    }
    let c = RULE.coefficients(values);
    let spread: f64 = c[1..].iter().map(|x| x.abs()).sum();
    if spread <= 1e-14 * c[0].abs() {
        return;
    }
    let (low, high) = (c[0] - spread, c[0] + spread);
    let decay = Decay::of(&c);
    let resolved = decay.interpolation() <= 1e-6 * spread || decay.interpolation() <= 1e-13 * c[0].abs();
    match watch {
        Watch::Levels(levels) => {
            let count = levels.count(low, high);
            if count == 0.0 {
                return;
            }
            if !resolved || count > 64.0 {
                if forced < if lean { 2 } else { 8 } {
                    out.push((0.5, true));
                }
                return;
            }
            let points = monotone(&c);
            for pair in points.windows(2) {
                let (p, q) = (pair[0], pair[1]);
                levels.visit(p.1.min(q.1), p.1.max(q.1), |level| out.push((root(&c, level, p, q), false)));
            }
        }
        Watch::Peak => {
            // Only where the exponential peaks between the nodes, or before the first or after the last.
            if forced >= 6 || 2.0 * spread < 4.0 || decay.interpolation() > 0.1 * spread {
                return;
            }
            let points = monotone(&c);
            let seen = values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v));
            let Some(peak) = points.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)) else { return };
            if peak.1 - seen < 2.0 {
                return;
            }
            out.push((peak.0, true));
            beside(&c, &points, peak, |value, drop| value < peak.1 - drop, &[4.0, 30.0], |d| peak.1 - d, out);
        }
        Watch::Pole => {
            let seen = values.iter().fold(f64::INFINITY, |m, v| m.min(v.abs()));
            if forced >= 6 || !resolved {
                return;
            }
            let sign = c[0].signum();
            let points = monotone(&c);
            let Some(pole) = points.iter().copied().min_by(|a, b| (sign * a.1).total_cmp(&(sign * b.1))) else {
                return;
            };
            if sign * pole.1 <= 0.0 || seen < 3.0 * pole.1.abs() {
                return;
            }
            out.push((pole.0, true));
            let beyond = |value: f64, times: f64| sign * value > times * sign * pole.1;
            beside(&c, &points, pole, beyond, &[3.0, 40.0], |d| d * pole.1, out);
        }
    }
}

/// Adds the nearest places on both sides of an extremum where the interpolant has moved away by given amounts.
fn beside(
    c: &Nodes,
    points: &[(f64, f64)],
    middle: (f64, f64),
    beyond: impl Fn(f64, f64) -> bool,
    amounts: &[f64],
    level: impl Fn(f64) -> f64,
    out: &mut Vec<(f64, bool)>,
) {
    for amount in amounts {
        let right = points.iter().find(|p| p.0 > middle.0 && beyond(p.1, *amount));
        let left = points.iter().rev().find(|p| p.0 < middle.0 && beyond(p.1, *amount));
        for side in [left, right].into_iter().flatten() {
            out.push((root(c, level(*amount), middle, *side), true));
        }
    }
}
