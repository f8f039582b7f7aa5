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
    pub(super) fn leaves(&self, o: Vec3, d: Vec3, visit: &mut dyn FnMut(&Form, Option<&[Vec3; 3]>, Vec3, Vec3)) {
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

impl Form {
    /// Any direction, also of other than unit length.
    pub(super) fn intervals(&self, o: Vec3, d: Vec3) -> Intervals {
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
}
