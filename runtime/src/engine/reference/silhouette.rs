//! Where on a ray the shadows of closed forms begin and end, however narrow the light between two of them is: probing places
//! of the ray one by one would miss what lies between two of them.
//!
//! A ray o + x·d and the way w towards a light span a plane with coordinates (x, y), y along w. In it boxes and slabs are
//! bounded by straight lines, discs are stretches of a line, and what shadows do changes where a corner of these, or a crossing
//! of two of them, stands before the light. Balls, ellipsoids and the mantles of cylinders are touched by the lines to the light
//! at the roots of a quadratic. Distance fields and meshes have no such form, nor has the crossing of a curved shape with another inside
//! an `intersection` or `difference`; those are left to probing.

use super::field::Ray;
use super::light::Beam;
use super::shape::{Form, Solid};
use super::surface::SurfaceForm;
use crate::frame::vector::{Vec3, cross, dot, length, scale, sub};

/// More lines than this in one solid are not crossed with each other.
const MOST_LINES: usize = 96;

/// The plane of a ray and a light, in the space of one form: relative to some point of it.
#[derive(Copy, Clone)]
struct Plane {
    /// The ray's origin.
    o: Vec3,
    /// The ray's direction.
    d: Vec3,
    /// Towards the light; to the light itself if it is a lamp.
    w: Vec3,
    lamp: bool,
}

/// low ≤ a + b·x + c·y ≤ high.
#[derive(Copy, Clone)]
struct Strip {
    a: f64,
    b: f64,
    c: f64,
    low: f64,
    high: f64,
    /// Of which form.
    form: usize,
}

impl Strip {
    fn holds(&self, (x, y): (f64, f64)) -> bool {
        let value = self.a + self.b * x + self.c * y;
        let rounding = 1e-9 * (self.a.abs() + (self.b * x).abs() + (self.c * y).abs());
        value >= self.low - rounding && value <= self.high + rounding
    }
}

impl Plane {
    /// The ray parameter whose light passes through a point of the plane.
    fn parameter(&self, (x, y): (f64, f64)) -> Option<f64> {
        if y < 0.0 || (self.lamp && y >= 1.0) {
            return None;
        }
        Some(if self.lamp { x / (1.0 - y) } else { x })
    }

    /// Where lines to the light touch a ball around `o = 0`.
    fn touches(&self, radius: f64, out: &mut Vec<f64>) {
        // |from × along|² = r²|along|², with a point and the direction of the line to the light from x·d.
        let r2 = radius * radius;
        let (from, fixed, square, linear, constant) = if self.lamp {
            let w = self.w;
            (std::array::from_fn(|i| self.o[i] + w[i]), scale(w, -1.0), dot(self.d, self.d), -dot(w, self.d), dot(w, w))
        } else {
            (self.o, self.w, 0.0, 0.0, dot(self.w, self.w))
        };
        let (a, b) = if self.lamp {
            (cross(from, fixed), cross(from, self.d))
        } else {
            (cross(from, fixed), cross(self.d, fixed))
        };
        roots(dot(b, b) - r2 * square, dot(a, b) - r2 * linear, dot(a, a) - r2 * constant, out);
    }

    /// The ends of the stretch of the plane within a disc around `o = 0`.
    fn rim(&self, normal: Vec3, radius: f64, out: &mut Vec<f64>) {
        let (a, b, c) = (dot(normal, self.o), dot(normal, self.d), dot(normal, self.w));
        let mut found = vec![];
        // Along x, or along y where the disc is met at one x only.
        let along_x = c.abs() * length(self.d) >= b.abs() * length(self.w);
        let (start, way) = if along_x {
            (sub(self.o, scale(self.w, a / c)), sub(self.d, scale(self.w, b / c)))
        } else {
            (sub(self.o, scale(self.d, a / b)), sub(self.w, scale(self.d, c / b)))
        };
        roots(dot(way, way), dot(start, way), dot(start, start) - radius * radius, &mut found);
        for s in found {
            let at = if along_x { (s, -(a + b * s) / c) } else { (-(a + c * s) / b, s) };
            out.extend(self.parameter(at));
        }
    }
}

/// Roots of a·x² + 2b·x + c.
fn roots(a: f64, b: f64, c: f64, out: &mut Vec<f64>) {
    let root = (b * b - a * c).sqrt();
    let q = -(b + root.copysign(b));
    out.extend([q / a, c / q].into_iter().filter(|x| x.is_finite()));
}

/// Adds the parameters of a ray at which the shadow that a solid casts in a light may begin or end.
pub(super) fn of_solid(solid: &Solid, ray: &Ray, beam: &Beam, out: &mut Vec<f64>) {
    let (way, lamp) = match beam {
        // The penumbra of a disc lies about the shadow of its middle.
        Beam::Parallel { towards, .. } | Beam::Disc { towards, .. } => (*towards, false),
        Beam::Lamp { at, .. } => (sub(*at, ray.origin), true),
    };
    let (mut strips, mut forms) = (vec![], 0);
    let mut plane = Plane { o: [0.0; 3], d: [0.0; 3], w: way, lamp };
    solid.leaves(ray.origin, ray.direction, &mut |form, rows, o, d| {
        let w = rows.map_or(way, |rows| rows.map(|r| dot(r, way)));
        plane = Plane { o, d, w, lamp };
        of_form(form, &plane, forms, &mut strips, out);
        forms += 1;
    });
    let cross_forms = strips.len() <= MOST_LINES / 2;
    for (i, first) in strips.iter().enumerate() {
        for second in strips[i + 1..].iter().filter(|s| cross_forms || s.form == first.form) {
            let volume = first.b * second.c - first.c * second.b;
            for (p, q) in
                [(first.low, second.low), (first.low, second.high), (first.high, second.low), (first.high, second.high)]
            {
                let (p, q) = (p - first.a, q - second.a);
                let at = ((p * second.c - first.c * q) / volume, (first.b * q - p * second.b) / volume);
                if !(at.0.is_finite() && at.1.is_finite()) {
                    continue;
                }
                let within = |form| strips.iter().filter(|s| s.form == form).all(|s| s.holds(at));
                if within(first.form) && within(second.form) {
                    out.extend(plane.parameter(at));
                }
            }
        }
    }
}

fn of_form(form: &Form, plane: &Plane, number: usize, strips: &mut Vec<Strip>, out: &mut Vec<f64>) {
    let around = |center: Vec3| Plane { o: sub(plane.o, center), ..*plane };
    match *form {
        Form::Ball { center, radius } => around(center).touches(radius, out),
        Form::Shell { center, inner, outer } => {
            around(center).touches(inner, out);
            around(center).touches(outer, out);
        }
        Form::Ellipsoid { center, radii } => {
            let own = |v: Vec3| std::array::from_fn(|i| v[i] / radii[i]);
            let o = own(sub(plane.o, center));
            Plane { o, d: own(plane.d), w: own(plane.w), lamp: plane.lamp }.touches(1.0, out);
        }
        Form::Box { min, max } => {
            for i in 0..3 {
                let (a, b, c) = (plane.o[i], plane.d[i], plane.w[i]);
                strips.push(Strip { a, b, c, low: min[i], high: max[i], form: number });
            }
        }
        Form::Slab { axis, from, to } => {
            let [a, b, c] = [plane.o, plane.d, plane.w].map(|v| dot(axis, v));
            strips.push(Strip { a, b, c, low: from, high: to, form: number });
        }
        Form::Cylinder { from, to, radius } => {
            let axis = sub(to, from);
            let height = length(axis);
            if height == 0.0 {
                return;
            }
            let axis = scale(axis, 1.0 / height);
            let aside = |v: Vec3| cross(axis, cross(v, axis));
            let base = around(from);
            Plane { o: aside(base.o), d: aside(base.d), w: aside(base.w), lamp: plane.lamp }.touches(radius, out);
            base.rim(axis, radius, out);
            around(to).rim(axis, radius, out);
        }
        Form::Sdf { .. } => {}
    }
}

/// The same for a surface.
pub(super) fn of_surface(surface: &SurfaceForm, ray: &Ray, beam: &Beam, out: &mut Vec<f64>) {
    match surface {
        SurfaceForm::Boundary(solid) => of_solid(solid, ray, beam, out),
        SurfaceForm::Disc { center, normal, radius } => {
            let (w, lamp) = match beam {
                Beam::Parallel { towards, .. } | Beam::Disc { towards, .. } => (*towards, false),
                Beam::Lamp { at, .. } => (sub(*at, ray.origin), true),
            };
            Plane { o: sub(ray.origin, *center), d: ray.direction, w, lamp }.rim(*normal, *radius, out);
        }
        // Nothing is behind a plane that was not there before it, and triangles are probed.
        SurfaceForm::Plane { .. } | SurfaceForm::Mesh(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::vector::normalize;

    /// Every change between lit and dark along a ray, found by walking it in small steps, is among the events.
    fn all_found(solid: &Solid, beam: &Beam) {
        let mut changes = 0;
        for (i, slant) in [-0.3, 0.02, 0.1].into_iter().enumerate() {
            let direction = normalize([1.0, slant, 0.13 * slant]).expect("not zero");
            let ray = Ray::new([-4.0, -0.1 - 0.3 * i as f64, 0.07], direction, &[]);
            let mut events = vec![];
            of_solid(solid, &ray, beam, &mut events);
            let dark = |t: f64| {
                let arrival = beam.arrival(ray.at(t)).expect("not at the lamp");
                let mut none = |_, _: &_| -> Result<_, ()> { unreachable!("no fields") };
                let all = super::super::interval::Intervals::all();
                let inside = solid.intervals(ray.at(t), arrival.towards, &all, &mut none).expect("closed forms");
                inside.0.iter().any(|(a, _)| *a < arrival.distance)
            };
            let h = 1e-3;
            for k in 0..8_000 {
                let (a, b) = (f64::from(k) * h, f64::from(k + 1) * h);
                if dark(a) != dark(b) {
                    changes += 1;
                    let near = events.iter().any(|e| *e > a - 1e-9 && *e < b + 1e-9);
                    assert!(near, "{solid:?} {beam:?}: {a} .. {b} is not in {events:?}");
                }
            }
        }
        assert!(changes >= 2, "{solid:?} casts no shadow on these rays");
    }

    fn part(form: Form) -> Solid {
        Solid::Part { from_world: None, form }
    }

    #[test]
    fn nothing_is_missed() {
        let cube = |min: Vec3, max: Vec3| part(Form::Box { min, max });
        let turned = {
            let (c, s) = (0.8, 0.6);
            let rows = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 2.0]];
            Solid::Part {
                from_world: Some((rows, [0.1, -0.5, 0.0])),
                form: Form::Box { min: [-0.5; 3], max: [0.5; 3] },
            }
        };
        let solids = [
            part(Form::Ball { center: [0.0, 1.0, 0.0], radius: 0.6 }),
            part(Form::Ellipsoid { center: [0.3, 1.2, 0.0], radii: [0.9, 0.2, 0.5] }),
            part(Form::Shell { center: [0.0, 1.2, 0.0], inner: 0.2, outer: 0.5 }),
            part(Form::Cylinder { from: [-0.5, 0.9, 0.1], to: [0.8, 1.3, -0.1], radius: 0.25 }),
            cube([-0.4, 0.8, -0.5], [0.5, 1.1, 0.6]),
            turned,
            // A wall with two windows.
            Solid::Difference(
                Box::new(cube([-2.0, 1.0, -9.0], [2.0, 1.2, 9.0])),
                vec![cube([-1.0, 0.0, -1.0], [-0.95, 3.0, 1.0]), cube([0.2, 0.0, -1.0], [0.6, 3.0, 1.0])],
            ),
        ];
        let parallel = |towards: Vec3| Beam::Parallel {
            towards: normalize(towards).expect("not zero"),
            irradiance: [1.0; super::super::trace::BANDS],
        };
        let lamp = |at: Vec3| Beam::Lamp { at, intensity: [1.0; super::super::trace::BANDS], radius: 0.0 };
        for solid in &solids {
            for beam in [parallel([0.1, 1.0, 0.0]), parallel([-0.5, 1.0, 0.02]), lamp([0.2, 2.2, 0.1])] {
                all_found(solid, &beam);
            }
        }
    }
}
