//! Where a field is negative along a ray: the search behind shapes that are given by a distance.

use super::interval::Intervals;

/// Samples of one run of a tape.
const N: usize = 8;

/// Where a field is negative along a ray, within some set of parameters.
///
/// Each interval of the set is walked in 64 stretches, in octaves beyond a quarter unit and up to 2⁴⁰. A stretch of 10 samples
/// is dismissed where the field cannot reach zero if its slope along the ray is nowhere more than twice the largest slope
/// between neighbouring samples of that stretch; elsewhere it is divided. This is what is guaranteed: no crossing is missed of
/// a field that keeps that condition from the first division on. Beyond 4096 units eight samples have to do for the first
/// look at an octave. Crossings are found to the last bits by bisection.
///
/// # Errors
/// Whatever `f` fails with.
pub(super) fn negative<E>(
    within: &Intervals,
    mut f: impl FnMut(&[f64; N]) -> Result<[f64; N], E>,
) -> Result<Intervals, E> {
    let mut all = Intervals::empty();
    for (from, to) in &within.0 {
        let found = negative_between(*from, *to, &mut f)?;
        all = all.union(&found);
    }
    Ok(all)
}

fn negative_between<E>(
    from: f64,
    to: f64,
    mut f: impl FnMut(&[f64; N]) -> Result<[f64; N], E>,
) -> Result<Intervals, E> {
    const PARTS: usize = 8;
    const NEAR: f64 = 4096.0;
    let mut ends: Vec<f64> = (-2..40).map(|k| 2f64.powi(k)).filter(|e| *e > from && *e < to).collect();
    if to.is_finite() {
        // One octave at a time is for rays without end; a short interval is looked at as a whole.
        if to <= NEAR {
            ends.clear();
        }
        ends.push(to);
    }
    let first = f(&[from; N])?[0];
    let mut crossings: Vec<f64> = vec![];
    let mut inside = first < 0.0;
    let mut result = Intervals::empty();
    let (mut start, mut f_start) = (from, first);
    for end in ends {
        let width = (end - start) / PARTS as f64;
        let ts: [f64; N] = std::array::from_fn(|i| if i + 1 == PARTS { end } else { start + width * (i + 1) as f64 });
        let values = f(&ts)?;
        let slope = (1..N).map(|i| (values[i] - values[i - 1]).abs()).fold((values[0] - f_start).abs(), f64::max);
        let least = values.iter().fold(f_start.abs(), |m, v| m.min(v.abs()));
        if end > NEAR && least > 2.0 * slope {
            (start, f_start) = (end, values[PARTS - 1]);
            continue;
        }
        let mut stack = vec![];
        for i in (0..PARTS).rev() {
            let before = if i == 0 { (start, f_start) } else { (ts[i - 1], values[i - 1]) };
            stack.push((before, (ts[i], values[i]), 0));
        }
        while let Some(((a, fa), (b, fb), depth)) = stack.pop() {
            let step = (b - a) / 9.0;
            if depth > 15 || step <= f64::EPSILON * b {
                if (fa < 0.0) != (fb < 0.0) {
                    crossings.push(b);
                }
                continue;
            }
            let ts: [f64; N] = std::array::from_fn(|i| a + step * (i + 1) as f64);
            let inner = f(&ts)?;
            let point = |i: usize| match i {
                0 => (a, fa),
                9 => (b, fb),
                i => (ts[i - 1], inner[i - 1]),
            };
            let steepest = (0..9).map(|i| (point(i + 1).1 - point(i).1).abs()).fold(0.0, f64::max);
            let mut pieces = vec![];
            for i in 0..9 {
                let (p, q) = (point(i), point(i + 1));
                let crosses = (p.1 < 0.0) != (q.1 < 0.0);
                if crosses || p.1.abs() + q.1.abs() <= 2.0 * steepest {
                    // A crossing amid steady slopes is a single one.
                    let slope = q.1 - p.1;
                    let steady = |i: usize| {
                        let s = point(i + 1).1 - point(i).1;
                        s * slope > 0.0 && s.abs() > 0.5 * slope.abs() && s.abs() < 2.0 * slope.abs()
                    };
                    if crosses && depth > 0 && steady(i.max(1) - 1) && steady((i + 1).min(8)) {
                        pieces.push((p, q, true));
                    } else {
                        pieces.push((p, q, false));
                    }
                }
            }
            // Bisection is exact enough to run at once when nothing uncertain lies before it; order is kept by depth.
            for (p, q, single) in pieces.into_iter().rev() {
                if single {
                    let t = bisect(&mut f, p, q)?;
                    stack.push(((t, p.1), (t, q.1), u32::MAX));
                } else {
                    stack.push((p, q, depth + 1));
                }
            }
        }
        f_start = values[PARTS - 1];
        start = end;
    }
    let mut from = from;
    for t in crossings {
        if inside && t > from {
            result.0.push((from, t));
        }
        inside = !inside;
        from = t;
    }
    if inside && from < to {
        result.0.push((from, to));
    }
    Ok(result)
}

/// Narrows a change of sign nine-fold at each run.
fn bisect<E>(
    f: &mut impl FnMut(&[f64; N]) -> Result<[f64; N], E>,
    (mut a, fa): (f64, f64),
    (mut b, _): (f64, f64),
) -> Result<f64, E> {
    let negative = fa < 0.0;
    for _ in 0..20 {
        let step = (b - a) / 9.0;
        if step <= f64::EPSILON * b * 0.25 {
            break;
        }
        let ts: [f64; N] = std::array::from_fn(|i| a + step * (i + 1) as f64);
        let values = f(&ts)?;
        let same = values.iter().take_while(|v| (**v < 0.0) == negative).count();
        let (low, high) = (if same == 0 { a } else { ts[same - 1] }, if same == N { b } else { ts[same] });
        (a, b) = (low, high);
    }
    Ok(0.5 * (a + b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sdf(f: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        negative(&Intervals::all(), |ts| Ok::<_, ()>(ts.map(&f))).unwrap().0
    }

    #[test]
    fn negative_parts_of_fields() {
        let close = |got: Vec<(f64, f64)>, want: &[(f64, f64)]| {
            assert_eq!(got.len(), want.len(), "{got:?}");
            for (g, w) in got.iter().zip(want) {
                assert!(
                    (g.0 - w.0).abs() <= 1e-13 * w.0 && (g.1 == w.1 || (g.1 - w.1).abs() <= 1e-13 * w.1),
                    "{got:?}"
                );
            }
        };
        close(sdf(|t| (t - 4.0f64).abs() - 1.0), &[(3.0, 5.0)]);
        close(sdf(|t| (t - 4.0f64).powi(2) - 1.0), &[(3.0, 5.0)]);
        close(sdf(|t| 3.0 - t), &[(3.0, f64::INFINITY)]);
        close(sdf(|t| t - 3.0), &[(0.0, 3.0)]);
        close(sdf(|t| t + 3.0), &[]);
        // A slit of a thousandth, a wall of a thousandth, touching without entering.
        close(sdf(|t| ((t - 4.0f64).abs() - 1.0).max(5e-4 - (t - 4.1f64).abs())), &[(3.0, 4.0995), (4.1005, 5.0)]);
        close(sdf(|t| (t - 4.1f64).abs() - 5e-4), &[(4.0995, 4.1005)]);
        close(sdf(|t| (t - 4.0f64).powi(2)), &[]);
        close(sdf(|t| (t - 100.0f64).hypot(1.0) - 1.0 - 1e-9), &[(100.0 - 4.472_135_955e-5, 100.0 + 4.472_135_955e-5)]);
    }

    #[test]
    fn many_crossings() {
        let got = sdf(|t| if t < 10.0 { (20.0 * t).sin() } else { (200.0f64).sin().abs() + t - 10.0 });
        assert_eq!(got.len(), 32);
        for (k, g) in got.iter().enumerate() {
            let pi = std::f64::consts::PI;
            assert!((g.0 - (2 * k + 1) as f64 * pi / 20.0).abs() < 1e-13, "{k}: {g:?}");
        }
    }
}
