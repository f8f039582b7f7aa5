//! Where a ray is inside a shape: closed forms in f64 that survive planets, grazing and degenerate cases, combined exactly.

use super::interval::Intervals;
use crate::frame::vector::{Vec3, cross, dot, length, scale, sub};
use compiler::ir::{NodeId, Primitive, PrimitiveKind, Shape};

/// A shape with the values of one frame.
#[derive(Clone, Debug)]
pub(super) enum Solid {
    Everywhere,
    Part { from_world: Option<([Vec3; 3], Vec3)>, form: Form },
    Union(Vec<Solid>),
    Intersection(Vec<Solid>),
    Difference(Box<Solid>, Vec<Solid>),
}

/// A primitive with the values of one frame.
#[derive(Clone, Debug)]
pub(super) enum Form {
    Ball { center: Vec3, radius: f64 },
    Ellipsoid { center: Vec3, radii: Vec3 },
    Box { min: Vec3, max: Vec3 },
    Slab { axis: Vec3, from: f64, to: f64 },
    Cylinder { from: Vec3, to: Vec3, radius: f64 },
    Shell { center: Vec3, inner: f64, outer: f64 },
    Sdf { field: NodeId },
}

/// Evaluates a shape. `value` gives the numbers of a node of tier Frame.
///
/// # Errors
/// When a number is not finite; the sentence says which part.
pub(super) fn evaluate(shape: &Shape, value: &mut dyn FnMut(NodeId) -> Vec<f64>) -> Result<Solid, String> {
    let mut all = |parts: &[Shape]| parts.iter().map(|s| evaluate(s, value)).collect::<Result<Vec<_>, _>>();
    Ok(match shape {
        Shape::Everywhere => Solid::Everywhere,
        Shape::Union(parts) => Solid::Union(all(parts)?),
        Shape::Intersection(parts) => Solid::Intersection(all(parts)?),
        Shape::Difference(first, rest) => {
            let rest = all(rest)?;
            Solid::Difference(Box::new(evaluate(first, value)?), rest)
        }
        Shape::Primitive(primitive) => part(primitive, value)?,
    })
}

fn part(primitive: &Primitive, value: &mut dyn FnMut(NodeId) -> Vec<f64>) -> Result<Solid, String> {
    let mut bad = None;
    let mut numbers = |node: NodeId, what: &'static str| -> Vec3 {
        let v = value(node);
        if v.iter().any(|x| !x.is_finite()) {
            bad.get_or_insert(what);
        }
        std::array::from_fn(|c| v[c.min(v.len() - 1)])
    };
    let form = match primitive.kind {
        PrimitiveKind::Sphere { center, radius } => Form::Ball {
            center: numbers(center, "center of a sphere"),
            radius: numbers(radius, "radius of a sphere")[0],
        },
        PrimitiveKind::Ellipsoid { center, radii } => Form::Ellipsoid {
            center: numbers(center, "center of an ellipsoid"),
            radii: numbers(radii, "radii of an ellipsoid"),
        },
        PrimitiveKind::Box { min, max } => {
            Form::Box { min: numbers(min, "lower corner of a box"), max: numbers(max, "upper corner of a box") }
        }
        PrimitiveKind::Slab { axis, from, to } => Form::Slab {
            axis: numbers(axis, "axis of a slab"),
            from: numbers(from, "start of a slab")[0],
            to: numbers(to, "end of a slab")[0],
        },
        PrimitiveKind::Cylinder { from, to, radius } => Form::Cylinder {
            from: numbers(from, "start of a cylinder"),
            to: numbers(to, "end of a cylinder"),
            radius: numbers(radius, "radius of a cylinder")[0],
        },
        PrimitiveKind::Shell { center, inner, outer } => Form::Shell {
            center: numbers(center, "center of a shell"),
            inner: numbers(inner, "inner radius of a shell")[0],
            outer: numbers(outer, "outer radius of a shell")[0],
        },
        PrimitiveKind::Sdf { field } => Form::Sdf { field },
    };
    let from_world = primitive.from_world.map(|a| {
        let rows = a.rows.map(|r| numbers(r, "transform of a shape"));
        (rows, numbers(a.offset, "transform of a shape"))
    });
    match bad {
        Some(what) => Err(what.to_owned()),
        None => Ok(Solid::Part { from_world, form }),
    }
}

impl Solid {
    /// Every field of an `sdf` in it.
    pub(super) fn fields(&self, out: &mut Vec<NodeId>) {
        match self {
            Self::Everywhere => {}
            Self::Part { form, .. } => {
                if let Form::Sdf { field } = form {
                    out.push(*field);
                }
            }
            Self::Union(parts) | Self::Intersection(parts) => parts.iter().for_each(|p| p.fields(out)),
            Self::Difference(first, rest) => {
                first.fields(out);
                rest.iter().for_each(|p| p.fields(out));
            }
        }
    }

    /// Calls `visit` for every closed form with the ray in its own space.
    fn leaves(&self, o: Vec3, d: Vec3, visit: &mut dyn FnMut(&Form, Option<&[Vec3; 3]>, Vec3, Vec3)) {
        match self {
            Self::Everywhere => {}
            Self::Union(parts) | Self::Intersection(parts) => parts.iter().for_each(|p| p.leaves(o, d, visit)),
            Self::Difference(first, rest) => {
                first.leaves(o, d, visit);
                rest.iter().for_each(|p| p.leaves(o, d, visit));
            }
            Self::Part { from_world: None, form } => visit(form, None, o, d),
            Self::Part { from_world: Some((rows, offset)), form } => {
                let own = |v: Vec3| rows.map(|r| dot(r, v));
                let from = own(o);
                visit(form, Some(rows), std::array::from_fn(|i| from[i] + offset[i]), own(d));
            }
        }
    }

    /// A number that stays the same while a ray meets the same faces in the same way up to `reach`: where it changes, what
    /// is summed along the ray may not be smooth. Fields of `sdf` are left out.
    pub(super) fn signature(&self, o: Vec3, d: Vec3, reach: f64) -> u64 {
        let mut hash = SIGNATURE;
        self.leaves(o, d, &mut |form, _, o, d| hash = mix(hash, form.signature(o, d, reach)));
        hash
    }

    /// The one stretch of the ray that is inside, where that is all there can be and no list is needed: outer `None` asks for
    /// [`Solid::intervals`].
    pub(super) fn span(&self, o: Vec3, d: Vec3) -> Option<Option<(f64, f64)>> {
        match self {
            Self::Everywhere => Some(Some((0.0, f64::INFINITY))),
            Self::Part { from_world: None, form } => match form {
                Form::Ball { .. }
                | Form::Ellipsoid { .. }
                | Form::Box { .. }
                | Form::Slab { .. }
                | Form::Cylinder { .. } => Some(form.span(o, d)),
                Form::Shell { .. } | Form::Sdf { .. } => None,
            },
            Self::Part { .. } | Self::Union(_) | Self::Intersection(_) | Self::Difference(..) => None,
        }
    }

    /// A box around it, if it has one that is easily seen.
    pub(super) fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let join = |x: (Vec3, Vec3), y: (Vec3, Vec3)| -> (Vec3, Vec3) {
            (std::array::from_fn(|i| x.0[i].min(y.0[i])), std::array::from_fn(|i| x.1[i].max(y.1[i])))
        };
        match self {
            Self::Everywhere => None,
            Self::Union(parts) => {
                let all: Option<Vec<_>> = parts.iter().map(Self::bounds).collect();
                all?.into_iter().reduce(join)
            }
            // Any of them holds it.
            Self::Intersection(parts) => {
                let size = |b: &(Vec3, Vec3)| length(sub(b.1, b.0));
                parts.iter().filter_map(Self::bounds).min_by(|x, y| size(x).total_cmp(&size(y)))
            }
            Self::Difference(first, _) => first.bounds(),
            Self::Part { from_world, form } => {
                let (low, high) = form.bounds()?;
                let Some((rows, offset)) = from_world else { return Some((low, high)) };
                let corner = |i: usize| {
                    let own: Vec3 = std::array::from_fn(|c| if i >> c & 1 == 0 { low[c] } else { high[c] } - offset[c]);
                    solve_three(rows, own).map(|p| (p, p))
                };
                let corners: Option<Vec<_>> = (0..8).map(corner).collect();
                corners?.into_iter().reduce(join)
            }
        }
    }

    /// Whether it is a shell that begins at this radius.
    pub(super) fn is_shell_over(&self, at: Vec3, radius: f64) -> bool {
        matches!(self, Self::Part { from_world: None, form: Form::Shell { center, inner, .. } }
            if *center == at && *inner == radius)
    }

    /// Cones of directions from `p` (a unit vector and an angle about it) at whose rims what a ray meets changes: rims of balls,
    /// and corners as cones without width. Only hints: what is hard to see is left out.
    pub(super) fn cones(&self, p: Vec3, out: &mut Vec<(Vec3, f64)>) {
        // Positions in a part's own space, and back.
        self.leaves(p, [0.0; 3], &mut |form, rows, own, _| {
            let to_world = |v: Vec3| match rows {
                None => Some(v),
                Some(rows) => solve_three(rows, v),
            };
            let mut towards = |q: Vec3, radius: f64| {
                let Some(way) = to_world(sub(q, own)) else { return };
                let stretch = to_world([1.0, 0.0, 0.0]).map_or(1.0, length);
                let (far, radius) = (length(way), radius * stretch);
                if let Some(way) = crate::frame::vector::normalize(way)
                    && far > radius
                {
                    out.push((way, (radius / far).asin()));
                }
            };
            match *form {
                Form::Ball { center, radius } => towards(center, radius),
                Form::Shell { center, inner, outer } => {
                    towards(center, outer);
                    if inner > 0.0 {
                        towards(center, inner);
                    }
                }
                Form::Ellipsoid { center, .. } => towards(center, 0.0),
                Form::Box { min, max } => {
                    for i in 0..8 {
                        towards(std::array::from_fn(|c| if i >> c & 1 == 0 { min[c] } else { max[c] }), 0.0);
                    }
                }
                Form::Cylinder { from, to, .. } => {
                    towards(from, 0.0);
                    towards(to, 0.0);
                }
                Form::Slab { axis, .. } => {
                    // Directions within the slab are those across its axis, whatever the transform.
                    let across = match rows {
                        None => axis,
                        Some(rows) => std::array::from_fn(|c| (0..3).map(|i| rows[i][c] * axis[i]).sum()),
                    };
                    out.extend(crate::frame::vector::normalize(across).map(|a| (a, std::f64::consts::FRAC_PI_2)));
                }
                Form::Sdf { .. } => {}
            }
        });
    }

    /// Normal of the boundary that the ray meets at `t`, of either sign. `sdf` gives the value and gradient of a field there.
    pub(super) fn normal(
        &self,
        o: Vec3,
        d: Vec3,
        t: f64,
        sdf: &mut dyn FnMut(NodeId) -> Option<(f64, Vec3)>,
    ) -> Option<Vec3> {
        // Of all parts the one whose boundary is nearest.
        let mut best: Option<(f64, Vec3)> = None;
        self.leaves(o, d, &mut |form, rows, o, d| {
            let found = match form {
                // The field sees the world whatever the transform says.
                Form::Sdf { field } => sdf(*field).map(|(value, slope)| (value.abs() / length(slope), slope)),
                Form::Ball { .. }
                | Form::Ellipsoid { .. }
                | Form::Box { .. }
                | Form::Slab { .. }
                | Form::Cylinder { .. }
                | Form::Shell { .. } => {
                    let p = std::array::from_fn(|i| d[i].mul_add(t, o[i]));
                    let Some((_, own)) = form.face(p) else { return };
                    let ends = form.intervals(o, d).0;
                    let off =
                        ends.iter().flat_map(|(a, b)| [(a - t).abs(), (b - t).abs()]).fold(f64::INFINITY, f64::min);
                    let world = match rows {
                        None => own,
                        Some(rows) => std::array::from_fn(|c| (0..3).map(|i| rows[i][c] * own[i]).sum()),
                    };
                    Some((off, world))
                }
            };
            if let Some((off, normal)) = found
                && let Some(normal) = crate::frame::vector::normalize(normal)
                && best.is_none_or(|b| off < b.0)
            {
                best = Some((off, normal));
            }
        });
        best.map(|b| b.1)
    }

    /// Where the ray `o + t·d`, `t ≥ 0`, |d| = 1, is inside. `sdf` gives the intervals where a field is negative, at least
    /// within the set of parameters it is given.
    pub(super) fn intervals<E>(
        &self,
        o: Vec3,
        d: Vec3,
        within: &Intervals,
        sdf: &mut dyn FnMut(NodeId, &Intervals) -> Result<Intervals, E>,
    ) -> Result<Intervals, E> {
        Ok(match self {
            Self::Everywhere => Intervals::all(),
            Self::Union(parts) => {
                let mut all = Intervals::empty();
                for part in parts {
                    all = all.union(&part.intervals(o, d, within, sdf)?);
                }
                all
            }
            Self::Intersection(parts) => {
                // Closed forms first: they narrow where fields have to be searched.
                let mut all = within.clone();
                for search in [false, true] {
                    for part in parts {
                        let mut fields = vec![];
                        part.fields(&mut fields);
                        if fields.is_empty() != search {
                            all = all.intersection(&part.intervals(o, d, &all, sdf)?);
                        }
                    }
                }
                all
            }
            Self::Difference(first, rest) => {
                let mut all = first.intervals(o, d, within, sdf)?;
                for part in rest {
                    all = all.intersection(&part.intervals(o, d, &all, sdf)?.complement());
                }
                all
            }
            Self::Part { form: Form::Sdf { field }, .. } => sdf(*field, within)?,
            Self::Part { from_world, form } => match from_world {
                None => form.intervals(o, d),
                Some((rows, offset)) => {
                    let own = |v: Vec3| rows.map(|r| dot(r, v));
                    let (o, d) = (own(o), own(d));
                    form.intervals(std::array::from_fn(|i| o[i] + offset[i]), d)
                }
            },
        })
    }
}

/// The vector that a matrix of these rows takes to `v`.
fn solve_three(rows: &[Vec3; 3], v: Vec3) -> Option<Vec3> {
    let [a, b, c] = rows;
    let volume = dot(*a, cross(*b, *c));
    let (x, y, z) = (cross(*b, *c), cross(*c, *a), cross(*a, *b));
    (volume != 0.0).then(|| std::array::from_fn(|i| (v[0] * x[i] + v[1] * y[i] + v[2] * z[i]) / volume))
}

const SIGNATURE: u64 = 0xcbf2_9ce4_8422_2325;

/// Mixes a number into another (FNV).
pub(super) fn mix(hash: u64, more: u64) -> u64 {
    (hash ^ more).wrapping_mul(0x0100_0000_01b3)
}

impl Form {
    fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let about = |center: Vec3, half: Vec3| {
            Some((std::array::from_fn(|i| center[i] - half[i]), std::array::from_fn(|i| center[i] + half[i])))
        };
        match *self {
            Self::Ball { center, radius } | Self::Shell { center, outer: radius, .. } => about(center, [radius; 3]),
            Self::Ellipsoid { center, radii } => about(center, radii),
            Self::Box { min, max } => Some((min, max)),
            Self::Cylinder { from, to, radius } => Some((
                std::array::from_fn(|i| from[i].min(to[i]) - radius),
                std::array::from_fn(|i| from[i].max(to[i]) + radius),
            )),
            Self::Slab { .. } | Self::Sdf { .. } => None,
        }
    }

    /// Which faces a ray meets up to `reach`, as a number.
    fn signature(&self, o: Vec3, d: Vec3, reach: f64) -> u64 {
        let mut hash = SIGNATURE;
        for (a, b) in self.intervals(o, d).0 {
            if a >= reach {
                break;
            }
            let at = |t: f64| self.face(std::array::from_fn(|i| d[i].mul_add(t, o[i]))).map_or(0, |f| f.0 + 1);
            hash = mix(hash, if a > 0.0 { at(a) } else { 0 });
            hash = mix(hash, if b < reach { at(b) } else { 0 });
        }
        hash
    }

    /// Number and normal of the face nearest to a point of the boundary.
    fn face(&self, p: Vec3) -> Option<(u64, Vec3)> {
        match *self {
            Self::Ball { center, .. } | Self::Shell { center, inner: 0.0, .. } => Some((0, sub(p, center))),
            Self::Shell { center, inner, outer } => {
                let m = sub(p, center);
                let r = length(m);
                Some((u64::from((r - inner).abs() < (r - outer).abs()), m))
            }
            Self::Ellipsoid { center, radii } => {
                let m = sub(p, center);
                Some((0, std::array::from_fn(|i| m[i] / (radii[i] * radii[i]))))
            }
            Self::Box { min, max } => {
                let mut best = (f64::INFINITY, 0, [0.0; 3]);
                for i in 0..3 {
                    for (side, face) in [(0, min[i]), (1, max[i])] {
                        let off = (p[i] - face).abs();
                        if off < best.0 {
                            best = (off, 2 * i as u64 + side, std::array::from_fn(|c| f64::from(u8::from(c == i))));
                        }
                    }
                }
                Some((best.1, best.2))
            }
            Self::Slab { axis, from, to } => {
                let x = dot(axis, p);
                Some((u64::from((x - from).abs() < (x - to).abs()), axis))
            }
            Self::Cylinder { from, to, radius } => {
                let axis = sub(to, from);
                let height = length(axis);
                let axis = scale(axis, 1.0 / height);
                let m = sub(p, from);
                let x = dot(m, axis);
                let side = sub(m, scale(axis, x));
                let [low, high, off] = [x.abs(), (x - height).abs(), (length(side) - radius).abs()];
                if off <= low.min(high) { Some((0, side)) } else { Some((1 + u64::from(high < low), axis)) }
            }
            Self::Sdf { .. } => None,
        }
    }

    /// Any direction, also of other than unit length.
    fn intervals(&self, o: Vec3, d: Vec3) -> Intervals {
        match *self {
            Self::Shell { center, inner, outer } => {
                let of = |radius: f64| Intervals(Self::Ball { center, radius }.span(o, d).into_iter().collect());
                let hole = if inner > 0.0 { of(inner) } else { Intervals::empty() };
                of(outer).intersection(&hole.complement())
            }
            Self::Ball { .. }
            | Self::Ellipsoid { .. }
            | Self::Box { .. }
            | Self::Slab { .. }
            | Self::Cylinder { .. }
            | Self::Sdf { .. } => Intervals(self.span(o, d).into_iter().collect()),
        }
    }

    /// The one stretch of a convex form, if there is any.
    fn span(&self, o: Vec3, d: Vec3) -> Option<(f64, f64)> {
        let speed = length(d);
        if !(speed > 0.0 && speed.is_finite()) {
            // The transform sends the whole ray to one point, which no solid of interest has: nothing to integrate.
            return None;
        }
        match *self {
            Self::Ball { center, radius } => {
                slowed(ball(sub(o, center), low(o, center), scale(d, 1.0 / speed), radius), speed)
            }
            Self::Ellipsoid { center, radii } => {
                if radii.iter().any(|r| *r <= 0.0) {
                    return None;
                }
                let unit = scale(d, 1.0 / speed);
                let m = sub(o, center);
                let (m, d): (Vec3, Vec3) =
                    (std::array::from_fn(|i| m[i] / radii[i]), std::array::from_fn(|i| unit[i] / radii[i]));
                let stretched = length(d);
                slowed(slowed(ball(m, [0.0; 3], scale(d, 1.0 / stretched), 1.0), stretched), speed)
            }
            Self::Box { min, max } => {
                let (mut start, mut end) = (0.0f64, f64::INFINITY);
                for i in 0..3 {
                    let (a, b) = between(o[i], d[i], min[i], max[i]);
                    (start, end) = (start.max(a), end.min(b));
                }
                clip(start, end)
            }
            Self::Slab { axis, from, to } => {
                let (a, b) = between(dot(axis, o), dot(axis, d), from, to);
                clip(a, b)
            }
            Self::Cylinder { from, to, radius } => {
                let axis = sub(to, from);
                let height = length(axis);
                if height == 0.0 {
                    return None;
                }
                let axis = scale(axis, 1.0 / height);
                let m = sub(o, from);
                let (a, b) = between(dot(m, axis), dot(d, axis), 0.0, height);
                // Parts perpendicular to the axis by cross products: no cancellation for nearly parallel rays.
                let (m2, d2) = (cross(axis, cross(m, axis)), cross(axis, cross(d, axis)));
                let speed = length(d2);
                if speed <= 1e-300 {
                    return if length(m2) <= radius { clip(a, b) } else { None };
                }
                let (from, to) = slowed(ball(m2, [0.0; 3], scale(d2, 1.0 / speed), radius), speed)?;
                clip(a.max(from), b.min(to))
            }
            Self::Shell { .. } | Self::Sdf { .. } => None,
        }
    }
}

/// The part of a stretch that lies on the ray, if there is any.
fn clip(start: f64, end: f64) -> Option<(f64, f64)> {
    let start = if start.is_nan() { return None } else { start.max(0.0) };
    (start < end).then_some((start, end))
}

fn slowed(span: Option<(f64, f64)>, speed: f64) -> Option<(f64, f64)> {
    span.map(|(a, b)| (a / speed, b / speed))
}

/// Parameters between which `from ≤ x + t·v ≤ to`; reversed if there are none.
fn between(x: f64, v: f64, from: f64, to: f64) -> (f64, f64) {
    if v == 0.0 {
        // Parallel: on a face is inside; no 0·∞.
        return if from <= x && x <= to { (f64::NEG_INFINITY, f64::INFINITY) } else { (0.0, -1.0) };
    }
    if to < from {
        return (0.0, -1.0);
    }
    let (a, b) = ((from - x) / v, (to - x) / v);
    (a.min(b), a.max(b))
}

/// What rounding lost in `a − b`.
fn low(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| two_diff(a[i], b[i]).1)
}

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let bb = s - a;
    (s, (a - (s - bb)) + (b - bb))
}

fn two_diff(a: f64, b: f64) -> (f64, f64) {
    two_sum(a, -b)
}

/// `|m + low|² − r²` to nearly full precision even when it cancels: squares and their sum in double-double.
pub(super) fn power(m: Vec3, low: Vec3, r: f64) -> f64 {
    let (mut high, mut rest) = (0.0f64, 0.0f64);
    for (a, b, sign) in [(m[0], low[0], 1.0), (m[1], low[1], 1.0), (m[2], low[2], 1.0), (r, 0.0, -1.0)] {
        let p = a * a;
        let e = a.mul_add(a, -p);
        let (s, lost) = two_sum(high, sign * p);
        high = s;
        rest += lost + sign * (e + 2.0 * a * b);
    }
    high + rest
}

/// A ball around the origin and a ray from `m + low` along the unit vector `d`.
fn ball(m: Vec3, low: Vec3, d: Vec3, r: f64) -> Option<(f64, f64)> {
    if !(r > 0.0 && r.is_finite()) {
        return None;
    }
    let b = dot(m, d);
    let c = power(m, low, r);
    // Both forms are b² − c; each rounds relative to other terms, so take the one whose terms are smaller.
    let disc = if b * b + c.abs() < 2.0 * r * r {
        b * b - c
    } else {
        let q = length(cross(m, d));
        (r - q) * (r + q)
    };
    if disc.is_nan() || disc <= 0.0 {
        return None;
    }
    let s = disc.sqrt();
    // The root without cancellation first, the other by Vieta.
    if b >= 0.0 { clip(-b - s, -c / (b + s)) } else { clip(c / (s - b), s - b) }
}

/// Altitude over a sphere of radius `r` along a ray, without cancellation (numerics: planet scale).
#[derive(Copy, Clone, Debug)]
pub(super) struct AltitudeRay {
    r: f64,
    /// Parameter of the closest point.
    closest: f64,
    /// Distance of the line from the centre.
    q: f64,
    /// From near: `|o − c|² − r²`.
    c: f64,
    near: bool,
}

impl AltitudeRay {
    pub(super) fn new(o: Vec3, d: Vec3, center: Vec3, r: f64) -> Self {
        let (m, l) = (sub(o, center), low(o, center));
        let b = dot(m, d);
        Self { r, closest: -b, q: length(cross(m, d)), c: power(m, l, r), near: length(m) < 4.0 * r }
    }

    /// Altitude at `o + t·d`.
    pub(super) fn at(&self, t: f64) -> f64 {
        let s = t - self.closest;
        let distance = self.q.hypot(s);
        if self.r == 0.0 {
            return distance;
        }
        // |p|² − r², from the origin of the ray when it is near, from the closest point when it is far.
        let power = if self.near {
            self.c + t * (t - 2.0 * self.closest)
        } else {
            (self.q - self.r) * (self.q + self.r) + s * s
        };
        power / (distance + self.r)
    }
}

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

    fn hit(form: &Form, o: Vec3, d: Vec3) -> Vec<(f64, f64)> {
        form.intervals(o, d).0
    }

    #[test]
    fn ball_from_everywhere() {
        let ball = Form::Ball { center: [0.0; 3], radius: 1.0 };
        assert_eq!(hit(&ball, [0.0, 0.0, -4.0], [0.0, 0.0, 1.0]), [(3.0, 5.0)]);
        assert_eq!(hit(&ball, [0.0; 3], [0.0, 1.0, 0.0]), [(0.0, 1.0)]);
        assert!(hit(&ball, [0.0, 0.0, 4.0], [0.0, 0.0, 1.0]).is_empty());
        assert!(hit(&ball, [0.0, 1.0, -4.0], [0.0, 0.0, 1.0]).is_empty());
        // On the surface, leaving.
        assert!(hit(&ball, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]).is_empty());
        let far = hit(&ball, [0.6, 0.0, -1e9], [0.0, 0.0, 1.0]);
        assert!((far[0].1 - far[0].0 - 1.6).abs() < 1e-6);
        // Directions of another length keep the parameter.
        assert_eq!(hit(&ball, [0.0, 0.0, -4.0], [0.0, 0.0, 2.0]), [(1.5, 2.5)]);
    }

    #[test]
    fn planet_keeps_metres() {
        let r = 6.36e6;
        // Two metres up, the horizon dips: the ray that leaves horizontally meets the top of the air at √((R+H)²−(R+h)²).
        let shell = Form::Shell { center: [0.0, -r, 0.0], inner: r, outer: r + 60e3 };
        let t = hit(&shell, [0.0, 2.0, 0.0], [1.0, 0.0, 0.0]);
        let exact = (59_998.0f64 * (2.0 * r + 60_002.0)).sqrt();
        assert_eq!(t.len(), 1);
        assert!((t[0].1 / exact - 1.0).abs() < 1e-15);
        // Straight down: two metres of air.
        let t = hit(&shell, [0.0, 2.0, 0.0], [0.0, -1.0, 0.0]);
        assert!((t[0].1 - 2.0).abs() < 1e-14, "{t:?}");
        let ray = AltitudeRay::new([0.0, 2.0, 0.0], [1.0, 0.0, 0.0], [0.0, -r, 0.0], r);
        let x: f64 = 1000.0;
        let exact = 2.0 + x * x / (2.0 * (r + 2.0)) * (1.0 - x * x / (4.0 * (r + 2.0) * (r + 2.0)));
        assert!((ray.at(x) / exact - 1.0).abs() < 1e-14);
        let far = AltitudeRay::new([0.0, 1e9, 0.0], [0.0, -1.0, 0.0], [0.0, -r, 0.0], r);
        assert!((far.at(1e9 - 5.0) - 5.0).abs() < 1e-6);
    }

    #[test]
    fn boxes_at_their_edges() {
        let cube = Form::Box { min: [0.0; 3], max: [1.0; 3] };
        assert_eq!(hit(&cube, [0.0, 0.5, -1.0], [0.0, 0.0, 1.0]), [(1.0, 2.0)]);
        assert_eq!(hit(&cube, [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]), [(0.0, 0.5)]);
        assert!(hit(&cube, [1.5, 0.5, -1.0], [0.0, 0.0, 1.0]).is_empty());
        assert!(hit(&cube, [0.5, 0.5, 3.0], [0.0, 0.0, 1.0]).is_empty());
        let flat = Form::Box { min: [0.0; 3], max: [1.0, 1.0, 0.0] };
        assert!(hit(&flat, [0.5, 0.5, -1.0], [0.0, 0.0, 1.0]).is_empty());
        let slab = Form::Slab { axis: [0.0, 1.0, 0.0], from: 0.0, to: 1.0 };
        assert_eq!(hit(&slab, [0.0, 0.5, 0.0], [1.0, 0.0, 0.0]), [(0.0, f64::INFINITY)]);
        assert_eq!(hit(&slab, [0.0, -1.0, 0.0], [0.0, 0.5, 0.0]), [(2.0, 4.0)]);
    }

    #[test]
    fn cylinder_and_ellipsoid() {
        let rod = Form::Cylinder { from: [0.0; 3], to: [0.0, 2.0, 0.0], radius: 1.0 };
        assert_eq!(hit(&rod, [0.0, 1.0, -3.0], [0.0, 0.0, 1.0]), [(2.0, 4.0)]);
        assert_eq!(hit(&rod, [0.5, -1.0, 0.0], [0.0, 1.0, 0.0]), [(1.0, 3.0)]);
        assert!(hit(&rod, [1.5, -1.0, 0.0], [0.0, 1.0, 0.0]).is_empty());
        let egg = Form::Ellipsoid { center: [0.0; 3], radii: [1.0, 2.0, 3.0] };
        let t = hit(&egg, [0.0, 0.0, -5.0], [0.0, 0.0, 1.0]);
        assert!((t[0].0 - 2.0).abs() < 1e-14 && (t[0].1 - 8.0).abs() < 1e-14);
    }

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
