//! Analytic anti-aliasing of silhouettes: where an edge of a shape crosses a pixel, the pixel is the mean of both sides,
//! weighted by the area that each covers.
//!
//! For each closed-form primitive a function g of the picture is positive where its rays hit and negative where they miss,
//! and smooth across the silhouette: the radius less the distance of the ray from the centre (ball, ellipsoid), or the
//! common length of the ray's spans between opposite faces (box, cylinder). Linearised over the pixel, g = 0 is a straight line;
//! the area on either side has a closed form, and each side is sampled at its middle. For a straight edge between
//! smooth sides this is exact to second order in the pixel's size.

use super::rays::{Camera, Start};
use super::shapes::{FAR, Ray, transformed};
use crate::fields::{Code, KernelBuilder};
use crate::ir::{Graph, Primitive, PrimitiveKind};
use crate::program::kernel::{Expr, FunctionId, Math, Ty};

/// How an edge divides a pixel.
pub(crate) struct Division {
    /// Share of the pixel on the side of the shape, 0..1; 1 where there is no edge.
    pub(crate) covered: Expr,
    /// From the pixel's centre to the middle of the side of the shape, in pixels.
    pub(crate) inner: (Expr, Expr),
    /// To the middle of the other side.
    pub(crate) outer: (Expr, Expr),
    /// Whether some edge crosses the pixel.
    pub(crate) divided: Expr,
}

/// Whether this primitive has a silhouette that g describes.
pub(crate) fn has_edge(primitive: &Primitive) -> bool {
    match primitive.kind {
        PrimitiveKind::Sphere { .. }
        | PrimitiveKind::Ellipsoid { .. }
        | PrimitiveKind::Box { .. }
        | PrimitiveKind::Cylinder { .. } => true,
        // A slab has none, shells were split into balls, and that of a signed distance field is not known in closed form.
        PrimitiveKind::Slab { .. } | PrimitiveKind::Shell { .. } | PrimitiveKind::Sdf { .. } => false,
    }
}

/// `edge_i(origin, direction, from)`: g of one primitive, FAR where it lies behind the eye.
fn edge_function(graph: &Graph, builder: &mut KernelBuilder, index: usize, primitive: &Primitive) -> FunctionId {
    let mut code = Code::new(&format!("edge_{index}"), primitive.span);
    let origin = code.parameter("origin", Ty::VEC3);
    let direction = code.parameter("direction", Ty::VEC3);
    let from = code.parameter("from_t", Ty::F32);
    let world = Ray { origin, direction };
    let ray = match &primitive.from_world {
        Some(affine) => transformed(graph, builder, &mut code, &world, affine),
        None => world,
    };
    let mut value = |node, name: &str| builder.value(graph, node, name);
    let (o, d) = (ray.origin, ray.direction);
    match primitive.kind {
        PrimitiveKind::Sphere { center, radius } => {
            let (c, r) = (value(center, "center"), value(radius, "radius"));
            ball_edge(&mut code, o - c, d, r, from);
        }
        PrimitiveKind::Ellipsoid { center, radii } => {
            let (c, r) = (value(center, "center"), value(radii, "radii"));
            ball_edge(&mut code, (o - c) / r.clone(), d / r, Expr::F32(1.0), from);
        }
        PrimitiveKind::Box { min, max } => {
            let (low, high) = (value(min, "min"), value(max, "max"));
            let spans: Vec<(Expr, Expr)> = (0..3u8)
                .map(|i| {
                    let part = |v: &Expr| v.clone().component(i);
                    faces(&mut code, part(&o), part(&d), part(&low), part(&high), ["x", "y", "z"][i as usize])
                })
                .collect();
            let near = spans.iter().map(|s| s.0.clone()).reduce(Expr::max).expect("three axes");
            let far = spans.iter().map(|s| s.1.clone()).reduce(Expr::min).expect("three axes");
            let near = code.bind("near", Ty::F32, near);
            let far = code.bind("far", Ty::F32, far);
            behind(&mut code, near.clone().min(far.clone()), from);
            code.return_(far - near);
        }
        PrimitiveKind::Cylinder { from: bottom, to: top, radius } => {
            let (bottom, top, r) = (value(bottom, "from"), value(top, "to"), value(radius, "radius"));
            let along = code.bind("along", Ty::VEC3, top - bottom.clone());
            let length = code.bind("height", Ty::F32, Expr::math(Math::Length, [along.clone()]));
            let along = code.bind("axis", Ty::VEC3, along / length.clone().max(1e-30).splat(3));
            let rel = code.bind("rel", Ty::VEC3, o - bottom);
            let start = code.bind("start", Ty::F32, rel.clone().dot(along.clone()));
            let climb = code.bind("climb", Ty::F32, d.clone().dot(along.clone()));
            let flat_o = code.bind("flat_o", Ty::VEC3, rel - along.clone() * start.clone().splat(3));
            let flat_d = code.bind("flat_d", Ty::VEC3, d - along * climb.clone().splat(3));
            let (cap0, cap1) = faces(&mut code, start, climb, Expr::F32(0.0), length, "caps");
            let a = code.bind("a", Ty::F32, flat_d.clone().dot(flat_d.clone()).max(1e-30));
            let nearest = code.bind("nearest", Ty::F32, -(flat_o.clone().dot(flat_d.clone())) / a.clone());
            let foot = flat_o + flat_d * nearest.clone().splat(3);
            let s = code.bind("s", Ty::F32, Expr::math(Math::Length, [foot]));
            behind(&mut code, nearest.clone(), from);
            let square = code.bind("square", Ty::F32, (r.clone() - s.clone()) * (r.clone() + s.clone()) / a);
            // Beside the mantle the distance from it decides, else what the caps leave.
            code.if_(square.clone().less_equal(0.0), |code| code.return_(r.clone() - s.clone()));
            let half = code.bind("half", Ty::F32, square.sqrt());
            let common = cap1.min(nearest.clone() + half.clone()) - cap0.max(nearest - half);
            code.return_(common.min(r - s));
        }
        PrimitiveKind::Slab { .. } | PrimitiveKind::Shell { .. } | PrimitiveKind::Sdf { .. } => {
            code.return_(Expr::F32(FAR));
        }
    }
    builder.add_function(code.finish(Some(Ty::F32)))
}

fn behind(code: &mut Code, nearest: Expr, from: Expr) {
    code.if_(nearest.less(from), |code| code.return_(Expr::F32(FAR)));
}

fn ball_edge(code: &mut Code, o: Expr, d: Expr, r: Expr, from: Expr) {
    let o = code.bind("o", Ty::VEC3, o);
    let d = code.bind("d", Ty::VEC3, d);
    let a = code.bind("a", Ty::F32, d.clone().dot(d.clone()).max(1e-30));
    let nearest = code.bind("nearest", Ty::F32, -(o.clone().dot(d.clone())) / a);
    behind(code, nearest.clone(), from);
    let foot = o + d * nearest.splat(3);
    code.return_(r - Expr::math(Math::Length, [foot]));
}

/// Distances to two parallel faces, the nearer first; a parallel ray is far inside or far outside.
fn faces(code: &mut Code, o: Expr, d: Expr, low: Expr, high: Expr, name: &str) -> (Expr, Expr) {
    let tiny = d.clone().abs().less(1e-12);
    let safe = code.bind(&format!("{name}_slope"), Ty::F32, tiny.select(1e-12, d));
    let a = code.bind(&format!("{name}_low"), Ty::F32, (low - o.clone()) / safe.clone());
    let b = code.bind(&format!("{name}_high"), Ty::F32, (high - o) / safe);
    (a.clone().min(b.clone()), a.max(b))
}

/// Writes how edges divide the pixel around (x, y); `None` if no primitive has an edge.
pub(crate) fn divide(
    graph: &Graph,
    builder: &mut KernelBuilder,
    code: &mut Code,
    camera: &Camera,
    primitives: &[Primitive],
    (x, y): (Expr, Expr),
) -> Option<Division> {
    let functions: Vec<FunctionId> = primitives
        .iter()
        .enumerate()
        .filter(|(_, p)| has_edge(p))
        .map(|(i, p)| edge_function(graph, builder, i, p))
        .collect();
    if functions.is_empty() {
        return None;
    }
    // The centre, and half a pixel to each side.
    let places =
        [("center", 0.0, 0.0), ("left", -0.5, 0.0), ("right", 0.5, 0.0), ("above", 0.0, -0.5), ("below", 0.0, 0.5)];
    let shift = |v: &Expr, d: f64| if d == 0.0 { v.clone() } else { v.clone() + d };
    let starts = places.map(|(name, dx, dy)| camera.ray(code, name, shift(&x, dx), shift(&y, dy)));
    // The edge that is nearest in pixels: g and its slopes across and down.
    let nearest = code.var("nearest_edge", Ty::F32, 2.0);
    let value = code.var("edge", Ty::F32, 1.0);
    let slope_x = code.var("edge_x", Ty::F32, 0.0);
    let slope_y = code.var("edge_y", Ty::F32, 0.0);
    for function in functions {
        let g = |code: &mut Code, name: &str, s: &Start| {
            code.bind(name, Ty::F32, Expr::Call(function, vec![s.origin.clone(), s.direction.clone(), s.from.clone()]))
        };
        let names = ["g", "g_left", "g_right", "g_above", "g_below"];
        let values: Vec<Expr> = names.iter().zip(&starts).map(|(n, s)| g(code, n, s)).collect();
        let dx = code.bind("g_x", Ty::F32, values[2].clone() - values[1].clone());
        let dy = code.bind("g_y", Ty::F32, values[4].clone() - values[3].clone());
        let reach = dx.clone().abs() + dy.clone().abs();
        // Behind the eye g is FAR, and its slope is nothing or nonsense.
        let largest = values.iter().cloned().map(Expr::abs).reduce(Expr::max).expect("five values");
        let distance = code.bind("distance", Ty::F32, values[0].clone().abs() / reach.max(1e-30));
        let counts = distance.clone().less(nearest).and(largest.less(1e30));
        code.if_(counts, |code| {
            code.set(nearest, distance);
            code.set(value, values[0].clone());
            code.set(slope_x, dx);
            code.set(slope_y, dy);
        });
    }
    let divided = code.bind("divided", Ty::BOOL, Expr::Local(nearest).less(0.5));
    let (a, b) = (Expr::Local(slope_x).abs(), Expr::Local(slope_y).abs());
    let a = code.bind("steep", Ty::F32, a.clone().max(b.clone()).max(1e-30));
    let b = code.bind("shallow", Ty::F32, Expr::Local(slope_x).abs().min(Expr::Local(slope_y).abs()));
    let g = Expr::Local(value);
    // Area of {g > 0} in the unit square: a corner triangle, or what is left of one, or a trapezium.
    let missing = (a.clone() + b.clone()) * 0.5 - g.clone().abs();
    let corner = missing.clone() * missing / (a.clone() * b.clone() * 2.0).max(1e-30);
    let corner = code.bind("corner", Ty::F32, corner);
    let trapezium = Expr::F32(0.5) + g.clone() / a.clone();
    let by_corner = g.clone().less(0.0).select(corner.clone(), Expr::F32(1.0) - corner);
    let in_corner = g.abs().greater((a.clone() - b.clone()) * 0.5);
    let area = in_corner.select(by_corner, trapezium);
    let area = Expr::math(Math::Clamp, [area, Expr::F32(0.0), Expr::F32(1.0)]);
    let covered = code.bind("covered", Ty::F32, divided.clone().select(area, 1.0));
    // Along the slope, the pixel is (|gx| + |gy|)/|∇g| wide.
    let norm = Expr::Local(slope_x) * Expr::Local(slope_x) + Expr::Local(slope_y) * Expr::Local(slope_y);
    let norm = code.bind("norm", Ty::F32, norm.max(1e-30));
    let width = code.bind("half_width", Ty::F32, (a + b) * 0.5 / norm);
    let offset = |code: &mut Code, name: &str, share: Expr| {
        let share = code.bind(name, Ty::F32, divided.clone().select(share * width.clone(), 0.0));
        (Expr::Local(slope_x) * share.clone(), Expr::Local(slope_y) * share)
    };
    let inner = offset(code, "inner", Expr::F32(1.0) - covered.clone());
    let outer = offset(code, "outer", -covered.clone());
    Some(Division { covered, inner, outer, divided })
}
