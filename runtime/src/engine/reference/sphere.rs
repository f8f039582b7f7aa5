//! Adaptive integration over directions: caps of the sphere about an axis, by u = 1 − cosine and the angle φ around it.
//!
//! dω = du dφ, and u keeps its digits for the smallest discs. Both integrals are made of eight-point Gauss panels that are
//! divided where the decay of their coefficients asks for it; panels are cut where the signature of the integrand changes,
//! which is where a direction begins to meet something else.

use super::faces::mix;
use super::gauss::{Decay, N, Nodes, RULE};
use super::split::sort_splits;
use super::trace::{BANDS, PerBand};
use crate::frame::vector::{Vec3, cross, dot, normalize};
use compiler::diagnostic::Diagnostic;
use std::f64::consts::PI;

/// Values at eight points and how wrong each may be.
#[derive(Copy, Clone, Debug)]
pub(super) struct Values {
    pub(super) value: [Nodes; BANDS],
    pub(super) wrong: [Nodes; BANDS],
}

impl Default for Values {
    fn default() -> Self {
        Self { value: [[0.0; N]; BANDS], wrong: [[0.0; N]; BANDS] }
    }
}

/// A function of one variable, several numbers at once.
pub(super) trait Integrand {
    fn values(&mut self, xs: &Nodes) -> Result<Values, Diagnostic>;
    /// Stays the same where the function is smooth; may always.
    fn signature(&mut self, x: f64) -> Result<u64, Diagnostic>;
    /// Where in the panel whose values were just asked for (0..1) it may not be smooth, besides.
    fn splits(&mut self, _divided: u8, _out: &mut Vec<(f64, bool)>) {}
}

/// An integral and its error.
#[derive(Copy, Clone, Debug, Default)]
pub(super) struct Integral {
    pub(super) value: PerBand,
    pub(super) error: PerBand,
}

/// How well an integral has to be known: within `relative` of itself or `absolute`.
#[derive(Copy, Clone, Debug)]
pub(super) struct Tolerance {
    pub(super) relative: f64,
    pub(super) absolute: PerBand,
}

struct Piece {
    a: f64,
    h: f64,
    depth: u8,
    value: PerBand,
    /// Of the quadrature.
    error: PerBand,
    /// Of the values.
    inner: PerBand,
}

/// Divisions of a first panel.
const DEEP: u8 = 48;
/// Panels at which an integral is taken as it is.
const PIECES: usize = 1500;

/// ∫ between the first and the last of `cuts`.
pub(super) fn integrate(
    f: &mut dyn Integrand,
    cuts: &[f64],
    bands: usize,
    tolerance: &Tolerance,
) -> Result<Integral, Diagnostic> {
    let first = |pair: &[f64]| (pair[0], pair[1] - pair[0], 0);
    let cuts: Vec<_> = cuts.windows(2).map(first).collect();
    divided(&cuts, bands, (tolerance, PIECES), &mut |panel, out| build(f, panel, bands, out))
}

/// Builds panels and divides those that spoil their sum, until it is within a tolerance or they are too many.
fn divided(
    first: &[(f64, f64, u8)],
    bands: usize,
    (tolerance, most): (&Tolerance, usize),
    build: &mut dyn FnMut((f64, f64, u8), &mut Vec<Piece>) -> Result<(), Diagnostic>,
) -> Result<Integral, Diagnostic> {
    let mut pieces: Vec<Piece> = vec![];
    for panel in first {
        build(*panel, &mut pieces)?;
    }
    loop {
        let mut total = Integral::default();
        let mut allowed = [0.0; BANDS];
        for b in 0..bands {
            total.value[b] = pieces.iter().map(|p| p.value[b]).sum();
            total.error[b] = pieces.iter().map(|p| p.error[b] + p.inner[b]).sum();
            allowed[b] = (tolerance.relative * total.value[b].abs()).max(tolerance.absolute[b]).max(1e-300);
        }
        let share = |p: &Piece| (0..bands).map(|b| p.error[b] / allowed[b]).fold(0.0, f64::max);
        let shares: Vec<f64> = pieces.iter().map(share).collect();
        let mut left: f64 = shares.iter().sum();
        if left <= 1.0 || pieces.len() > most {
            return Ok(total);
        }
        let mut order: Vec<usize> = (0..pieces.len()).collect();
        order.sort_by(|x, y| shares[*y].total_cmp(&shares[*x]));
        let mut divide = vec![false; pieces.len()];
        let mut any = false;
        for i in order {
            if left <= 0.5 {
                break;
            }
            left -= shares[i];
            if pieces[i].depth < DEEP && shares[i] > 0.0 {
                divide[i] = true;
                any = true;
            }
        }
        if !any {
            return Ok(total);
        }
        for (i, p) in std::mem::take(&mut pieces).into_iter().enumerate() {
            if divide[i] {
                let half = 0.5 * p.h;
                build((p.a, half, p.depth + 1), &mut pieces)?;
                build((p.a + half, half, p.depth + 1), &mut pieces)?;
            } else {
                pieces.push(p);
            }
        }
    }
}

/// Where between two points of different signatures the first change is.
pub(super) fn change(
    mut low: f64,
    mut high: f64,
    mut signature: impl FnMut(f64) -> Result<u64, Diagnostic>,
    before: u64,
) -> Result<f64, Diagnostic> {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high || high - low <= 1e-15 * high.abs() {
            break;
        }
        if signature(middle)? == before { low = middle } else { high = middle }
    }
    Ok(0.5 * (low + high))
}

/// Just inside both ends of a panel, where signatures are looked at beside its nodes.
const RIM: f64 = 1e-9;

/// Cuts (0..1) of a panel where signatures change.
pub(super) fn changes(
    a: f64,
    h: f64,
    mut signature: impl FnMut(f64) -> Result<u64, Diagnostic>,
) -> Result<Vec<f64>, Diagnostic> {
    let mut cuts = vec![];
    let mut last = (RIM, signature(a + h * RIM)?);
    for x in RULE.x.iter().copied().chain([1.0 - RIM]) {
        let now = signature(a + h * x)?;
        if now != last.1 {
            let at = change(a + h * last.0, a + h * x, &mut signature, last.1)?;
            let at = (at - a) / h;
            if at > 1e-12 && at < 1.0 - 1e-12 {
                cuts.push(at);
            }
        }
        last = (x, now);
    }
    Ok(cuts)
}

fn build(f: &mut dyn Integrand, first: (f64, f64, u8), bands: usize, out: &mut Vec<Piece>) -> Result<(), Diagnostic> {
    let mut stack = vec![(first, 0)];
    while let Some(((a, h, depth), cut)) = stack.pop() {
        if cut < 6 && depth < DEEP {
            let cuts = changes(a, h, |x| f.signature(x))?;
            if !cuts.is_empty() {
                let mut end = 1.0;
                for x in cuts.iter().rev().copied().chain([0.0]) {
                    stack.push(((a + h * x, h * (end - x), depth + 1), cut + 1));
                    end = x;
                }
                continue;
            }
        }
        let values = f.values(&RULE.x.map(|x| a + h * x))?;
        if cut < 6 && depth < DEEP {
            let mut cuts = vec![];
            f.splits(cut, &mut cuts);
            sort_splits(&mut cuts);
            if !cuts.is_empty() {
                let mut end = 1.0;
                for x in cuts.iter().rev().map(|x| x.0).chain([0.0]) {
                    stack.push(((a + h * x, h * (end - x), depth + 1), cut + 1));
                    end = x;
                }
                continue;
            }
        }
        let mut piece = Piece { a, h, depth, value: [0.0; BANDS], error: [0.0; BANDS], inner: [0.0; BANDS] };
        for b in 0..bands {
            let v = &values.value[b];
            piece.value[b] = h * RULE.mean(v);
            piece.inner[b] = h * RULE.mean(&values.wrong[b]) + 2.0 * f64::EPSILON * piece.value[b].abs();
            let noise = values.wrong[b].iter().fold(0.0f64, |m, w| m.max(*w));
            piece.error[b] = h * Decay::above(&RULE.coefficients(v), noise).quadrature();
        }
        out.push(piece);
    }
    Ok(())
}

/// A function of direction, several directions at once.
pub(super) trait OfDirection {
    fn values(&mut self, directions: &[Vec3; N]) -> Result<Values, Diagnostic>;
    fn signature(&mut self, direction: Vec3) -> Result<u64, Diagnostic>;
    /// As [`Integrand::splits`], of the panel of directions last asked for.
    fn splits(&mut self, divided: u8, out: &mut Vec<(f64, bool)>);
    /// Cones (a unit vector and an angle about it) at whose rims it is not smooth, as far as they are known.
    fn cones(&self) -> Vec<(Vec3, f64)>;
}

/// Two unit vectors that complete one to a right-handed frame (after Duff et al. 2017).
pub(super) fn frame(axis: Vec3) -> [Vec3; 3] {
    let other = if axis[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let x = normalize(cross(axis, other)).unwrap_or([0.0, 0.0, 1.0]);
    [x, cross(axis, x), axis]
}

/// The direction at u = 1 − cosine and φ about the axis of a frame.
pub(super) fn direction([x, y, z]: &[Vec3; 3], u: f64, phi: f64) -> Vec3 {
    let sine = (u * (2.0 - u)).max(0.0).sqrt();
    let (s, c) = phi.sin_cos();
    let d = std::array::from_fn(|i| z[i] * (1.0 - u) + sine * (c * x[i] + s * y[i]));
    normalize(d).unwrap_or(*z)
}

struct Ring<'a> {
    of: &'a mut dyn OfDirection,
    frame: &'a [Vec3; 3],
    u: f64,
}

impl Integrand for Ring<'_> {
    fn values(&mut self, xs: &Nodes) -> Result<Values, Diagnostic> {
        self.of.values(&xs.map(|phi| direction(self.frame, self.u, phi)))
    }

    fn signature(&mut self, phi: f64) -> Result<u64, Diagnostic> {
        self.of.signature(direction(self.frame, self.u, phi))
    }

    fn splits(&mut self, divided: u8, out: &mut Vec<(f64, bool)>) {
        self.of.splits(divided, out);
    }
}

struct Cap<'a> {
    of: &'a mut dyn OfDirection,
    frame: [Vec3; 3],
    /// Cuts of φ.
    turn: Vec<f64>,
    bands: usize,
    tolerance: Tolerance,
}

/// Cuts of φ.
const THIRDS: [f64; 4] = [0.0, 2.0 / 3.0 * PI, 4.0 / 3.0 * PI, 2.0 * PI];
const HALVES: [f64; 3] = [0.0, PI, 2.0 * PI];

impl Cap<'_> {
    fn ring(&mut self, u: f64) -> Result<Integral, Diagnostic> {
        let mut ring = Ring { of: &mut *self.of, frame: &self.frame, u };
        integrate(&mut ring, &self.turn, self.bands, &self.tolerance)
    }
}

impl Integrand for Cap<'_> {
    fn values(&mut self, xs: &Nodes) -> Result<Values, Diagnostic> {
        let mut all = Values::default();
        for (lane, u) in xs.iter().enumerate() {
            let ring = self.ring(*u)?;
            for b in 0..self.bands {
                all.value[b][lane] = ring.value[b];
                all.wrong[b][lane] = ring.error[b];
            }
        }
        Ok(all)
    }

    fn signature(&mut self, u: f64) -> Result<u64, Diagnostic> {
        // What is met around the ring, in a few directions: places the larger changes.
        let mut hash = 0;
        for i in 0..3 {
            hash = mix(hash, self.of.signature(direction(&self.frame, u, 0.1 + f64::from(i) * 2.0))?);
        }
        Ok(hash)
    }
}

/// Cuts of φ and of u where rings about an axis touch the rims of cones: there a thin sliver of a cone begins that no node
/// would see.
fn touches([x, y, z]: &[Vec3; 3], cones: &[(Vec3, f64)], cuts: &[f64], turn: &[f64]) -> (Vec<f64>, Vec<f64>) {
    /// More cones than these cost more than they show.
    const MOST: usize = 12;
    let (mut turn, mut us) = (turn.to_vec(), cuts.to_vec());
    let (low, high) = (cuts[0], cuts[cuts.len() - 1]);
    for (direction, angle) in cones.iter().take(MOST) {
        let sine = dot(*direction, *x).hypot(dot(*direction, *y));
        let theta = sine.atan2(dot(*direction, *z));
        let azimuth = dot(*direction, *y).atan2(dot(*direction, *x));
        let (near, far) = (theta - angle, theta + angle);
        for (rim, opposite) in [(near, near < 0.0), (far, far > PI)] {
            let rim = if rim > PI { 2.0 * PI - rim } else { rim.abs() };
            let u = 2.0 * (0.5 * rim).sin().powi(2);
            if u > low && u < high {
                us.push(u);
                if sine > 1e-9 {
                    turn.push((azimuth + if opposite { PI } else { 0.0 }).rem_euclid(2.0 * PI));
                }
            }
        }
    }
    for list in [&mut turn, &mut us] {
        list.sort_by(f64::total_cmp);
        list.dedup_by(|b, a| *b - *a <= 1e-13 * b.abs());
    }
    (turn, us)
}

/// ∫ over the directions whose u = 1 − cosine to `axis` lies between the first and the last of `cuts`, to within a `relative` or an
/// `absolute` tolerance.
///
/// # Errors
/// Those of the function.
pub(super) fn over_cap(
    of: &mut dyn OfDirection,
    axis: Vec3,
    cuts: &[f64],
    bands: usize,
    (relative, absolute): (f64, f64),
) -> Result<Integral, Diagnostic> {
    let fine = relative < 1e-6;
    let (turn, cuts) = touches(&frame(axis), &of.cones(), cuts, if fine { &THIRDS } else { &HALVES });
    let loose = Tolerance { relative: 1e-2, absolute: [0.0; BANDS] };
    let mut cap = Cap { of, frame: frame(axis), turn, bands, tolerance: loose };
    // A crude mean first, so that rings that hardly matter are not followed to their last digit.
    let (low, high) = (cuts[0], cuts[cuts.len() - 1]);
    let mut mean = [0.0; BANDS];
    for i in 0..4 {
        let ring = cap.ring(low + (high - low) * [0.069, 0.33, 0.67, 0.93][i])?;
        (0..bands).for_each(|b| mean[b] += 0.25 * ring.value[b]);
    }
    let of_ring = |m: f64| 0.2 * (relative * m).max(absolute / (high - low));
    cap.tolerance = Tolerance { relative: 0.2 * relative, absolute: mean.map(of_ring) };
    let total = Tolerance { relative, absolute: [absolute; BANDS] };
    integrate(&mut cap, &cuts, bands, &total)
}

/// Fibonacci lattices (number of points, generator) of a panel of the sphere.
const LATTICES: [(usize, usize); 2] = [(144, 89), (377, 233)];
/// Panels of the sphere at which its integral is taken as it is.
const MOST_PANELS: usize = 64;

/// The same to a rough tolerance: panels of u and all angles around the axis at once, each by two lattices of points, which differ by about
/// as much as the sparser is wrong. Kinks and edges, which nobody looks for here, lie across a panel and not along a whole ring, so that points
/// all over it settle them sooner than rings that are each followed to the last digit: lattices converge faster than as 1/N on what is
/// continuous, with the argument folded (baker's transformation, Hickernell 2002) where it is not periodic.
///
/// # Errors
/// Those of the function.
pub(super) fn over_cap_roughly(
    of: &mut dyn OfDirection,
    axis: Vec3,
    cuts: &[f64],
    bands: usize,
    (relative, absolute): (f64, f64),
) -> Result<Integral, Diagnostic> {
    let frame = frame(axis);
    let (_, cuts) = touches(&frame, &of.cones(), cuts, &HALVES);
    let first: Vec<_> = cuts.windows(2).map(|pair| (pair[0], pair[1] - pair[0], 0)).collect();
    let tolerance = Tolerance { relative, absolute: [absolute; BANDS] };
    divided(&first, bands, (&tolerance, MOST_PANELS), &mut |(a, h, depth), out| {
        let sparse = on_lattice(of, &frame, (a, h), LATTICES[0], bands)?;
        let dense = on_lattice(of, &frame, (a, h), LATTICES[1], bands)?;
        let mut piece = Piece { a, h, depth, value: dense.value, error: [0.0; BANDS], inner: dense.error };
        for b in 0..bands {
            let noise = dense.error[b] + sparse.error[b];
            piece.error[b] = ((dense.value[b] - sparse.value[b]).abs() - noise).max(0.0);
        }
        out.push(piece);
        Ok(())
    })
}

/// ∫ over a panel of u by a lattice; the error is that of the values.
fn on_lattice(
    of: &mut dyn OfDirection,
    frame: &[Vec3; 3],
    (a, h): (f64, f64),
    (count, generator): (usize, usize),
    bands: usize,
) -> Result<Integral, Diagnostic> {
    let mut sum = Integral::default();
    let weight = 2.0 * PI * h / count as f64;
    for start in (0..count).step_by(N) {
        let point = |lane: usize| {
            let i = (start + lane).min(count - 1);
            let folded = 1.0 - (2.0 * i as f64 / count as f64 - 1.0).abs();
            let turn = (i * generator % count) as f64 / count as f64;
            direction(frame, a + h * folded, 2.0 * PI * turn)
        };
        let values = of.values(&std::array::from_fn(point))?;
        for b in 0..bands {
            let lanes = 0..N.min(count - start);
            sum.value[b] += weight * values.value[b][lanes.clone()].iter().sum::<f64>();
            sum.error[b] += weight * values.wrong[b][lanes].iter().sum::<f64>();
        }
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::vector::dot;

    /// A function with the half-spaces at whose rims it has kinks.
    struct Of<F>(F, Vec<(Vec3, f64)>);

    impl<F: Fn(Vec3) -> f64> OfDirection for Of<F> {
        fn values(&mut self, directions: &[Vec3; N]) -> Result<Values, Diagnostic> {
            let mut all = Values::default();
            all.value[0] = directions.map(&self.0);
            Ok(all)
        }

        fn signature(&mut self, direction: Vec3) -> Result<u64, Diagnostic> {
            Ok(self.1.iter().map(|c| u64::from(dot(c.0, direction) > 0.0)).sum())
        }

        fn splits(&mut self, _divided: u8, _out: &mut Vec<(f64, bool)>) {}

        fn cones(&self) -> Vec<(Vec3, f64)> {
            self.1.clone()
        }
    }

    #[test]
    fn integrals_over_the_sphere() {
        let axis = normalize([0.3, -0.5, 0.8]).unwrap();
        let up = [0.0, 1.0, 0.0];
        let sphere = |f: &dyn Fn(Vec3) -> f64, cuts: &[f64]| {
            over_cap(&mut Of(f, vec![(up, 0.5 * PI)]), axis, cuts, 1, (1e-9, 0.0)).unwrap()
        };
        let whole = [0.0, 1.0, 2.0];
        let cases: [(&dyn Fn(Vec3) -> f64, f64); 4] = [
            (&|_| 1.0, 4.0 * PI),
            (&|d| dot(d, up).powi(4), 4.0 * PI / 5.0),
            // exp(k·cosine): 4π·sinh(k)/k.
            (&|d| (20.0 * dot(d, up)).exp(), 4.0 * PI * 20f64.sinh() / 20.0),
            // A kink off the axis.
            (&|d| dot(d, up).max(0.0), PI),
        ];
        for (i, (f, exact)) in cases.iter().enumerate() {
            let found = sphere(f, &whole);
            let wrong = (found.value[0] - exact).abs();
            assert!(wrong <= 1e-8 * exact && wrong <= found.error[0] + 1e-13 * exact, "{i}: {wrong:e} {found:?}");
        }
        // Roughly, too: as wrong as is said, and better than was asked for where there is no more than a kink.
        for (i, (f, exact)) in cases.into_iter().enumerate() {
            let of = &mut Of(f, vec![]);
            let found = over_cap_roughly(of, axis, &whole, 1, (1e-4, 0.0)).unwrap();
            let wrong = (found.value[0] - exact).abs();
            assert!(wrong <= found.error[0] + 1e-13 * exact && wrong <= 1e-4 * exact, "{i}: {wrong:e} {found:?}");
        }
        // A lobe as narrow as a ten-thousandth of a radian, on the axis (Henyey and Greenstein 1941).
        let g = 0.9999f64;
        let lobe = |d: Vec3| {
            let u = 0.5 * dot(std::array::from_fn(|i| d[i] - axis[i]), std::array::from_fn(|i| d[i] - axis[i]));
            0.25 / PI * (1.0 - g * g) / ((1.0 - g).powi(2) + 2.0 * g * u).powf(1.5)
        };
        let found = over_cap_roughly(&mut Of(&lobe, vec![]), axis, &whole, 1, (1e-4, 0.0)).unwrap();
        assert!((found.value[0] - 1.0).abs() <= 1e-4 && found.error[0] <= 1e-4, "{found:?}");
        // A disc of a thousandth of a degree.
        let angle = 1.7e-5f64;
        let depth = 2.0 * (0.5 * angle).sin().powi(2);
        let found = sphere(&|d| dot(d, axis), &[0.0, depth]);
        assert!((found.value[0] / (PI * angle.sin().powi(2)) - 1.0).abs() < 1e-12);
    }
}
