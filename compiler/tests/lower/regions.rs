//! Shapes, transforms, altitude, bounding boxes.

use crate::build::*;
use crate::expressions::oblique;
use crate::{Place, close, here, in_units, metres, value};
use compiler::check::hir::*;
use compiler::ir::{Affine, FieldScene, NodeId, PrimitiveKind, Shape, Units};
use compiler::syntax::ast::BinaryOp;
use proptest::prelude::*;

fn shaped(shape: Expr, transform: Option<Expr>) -> Scene {
    let mut scene = scene();
    scene.media.push(Medium { shape: Some(shape), transform, k_a: Some(per_m(1.0)), ..medium("body") });
    scene
}

/// Where an affine map takes a point given in metres, in metres.
fn mapped(scene: &FieldScene, affine: &Affine, x: [f64; 3]) -> [f64; 3] {
    let get = |node: NodeId| value(scene, node, &Place::default());
    let unit = scene.units.length;
    let offset = get(affine.offset);
    std::array::from_fn(|i| {
        let row = get(affine.rows[i]);
        ((0..3).map(|j| row[j] * x[j] / unit).sum::<f64>() + offset[i]) * unit
    })
}

/// Whether a point of the world, in metres, is in a shape of spheres and boxes.
fn contains(scene: &FieldScene, shape: &Shape, x: [f64; 3]) -> bool {
    match shape {
        Shape::Everywhere => true,
        Shape::Union(parts) => parts.iter().any(|s| contains(scene, s, x)),
        Shape::Intersection(parts) => parts.iter().all(|s| contains(scene, s, x)),
        Shape::Difference(first, rest) => contains(scene, first, x) && !rest.iter().any(|s| contains(scene, s, x)),
        Shape::Primitive(p) => {
            let x = p.from_world.as_ref().map_or(x, |a| mapped(scene, a, x));
            let unit = scene.units.length;
            let get = |node| value(scene, node, &Place::default());
            match p.kind {
                PrimitiveKind::Sphere { center, radius } => {
                    let c = get(center);
                    let d: f64 = (0..3).map(|i| (x[i] - c[i] * unit).powi(2)).sum();
                    d.sqrt() <= get(radius)[0] * unit
                }
                PrimitiveKind::Box { min, max } => {
                    let (low, high) = (get(min), get(max));
                    (0..3).all(|i| low[i] * unit <= x[i] && x[i] <= high[i] * unit)
                }
                _ => panic!("a sphere or a box"),
            }
        }
    }
}

fn translate(x: f64, y: f64, z: f64) -> Expr {
    call(Builtin::Translate, vec![m3(x, y, z)], Type::Transform)
}

fn rotate(axis: Expr, angle: f64) -> Expr {
    call(Builtin::Rotate, vec![axis, n(angle)], Type::Transform)
}

fn scale(factor: Expr) -> Expr {
    call(Builtin::Scale, vec![factor], Type::Transform)
}

fn then(outer: Expr, inner: Expr) -> Expr {
    op(BinaryOp::Multiply, outer, inner, Type::Transform)
}

/// translate · rotate a quarter about y · scale 2: own (1, 0, 0) goes to 2 along −z, then up by 1.
fn example() -> Expr {
    then(translate(0.0, 1.0, 0.0), then(rotate(v3(0.0, 3.0, 0.0), std::f64::consts::FRAC_PI_2), scale(n(2.0))))
}

/// The medium's own position, as three numbers in metres.
fn own_position(scene: &FieldScene, place: &Place) -> Vec<f64> {
    value(scene, scene.media[0].k_a, place)
}

fn seeing_p(transform: Expr) -> Scene {
    let mut scene = scene();
    // Three numbers as a spectrum: |p.x|, |p.y|, |p.z| in 1/m.
    let part = |i| {
        let size = call(Builtin::Abs, vec![px(i)], Type::Number(length(1)));
        op(BinaryOp::Divide, size, quantity(1.0, length(2)), Type::Number(length(-1)))
    };
    let k = call(Builtin::Rgb, vec![part(0), part(1), part(2)], Type::Spectrum(length(-1)));
    scene.media.push(Medium { transform: Some(transform), k_a: Some(k), ..medium("body") });
    scene
}

#[test]
fn a_medium_sees_its_own_space() {
    let scene = seeing_p(example());
    for units in [Units::METRE, Units { length: 4.0 }, Units { length: 1.0 / 1024.0 }] {
        let lowered = in_units(&scene, units);
        // Own (1, 0.25, 0.5) is at 2 · (0.5, 0.25, −1) + (0, 1, 0).
        let got = own_position(&lowered, &here(1.0, 1.5, -2.0));
        let got: Vec<f64> = got.iter().map(|k| k / units.length).collect();
        assert!(close(&got, &[1.0, 0.25, 0.5], 1e-12), "{got:?}");
    }
}

#[test]
fn directions_turn_and_keep_their_length() {
    let mut scene = scene();
    let dir = |i| {
        let part = component(input(Input::Direction), i, Dim::default());
        let half = op(BinaryOp::Add, part, n(2.0), number());
        op(BinaryOp::Multiply, half, per_m(1.0), Type::Number(length(-1)))
    };
    let k = call(Builtin::Rgb, vec![dir(0), dir(1), dir(2)], Type::Spectrum(length(-1)));
    scene.media.push(Medium { transform: Some(example()), k_a: Some(k), ..medium("body") });
    let lowered = metres(&scene);
    let place = Place { direction: [0.0, 0.6, -0.8], ..Place::default() };
    // World −z is own +x.
    let got = value(&lowered, lowered.media[0].k_a, &place);
    assert!(close(&got, &[2.8, 2.6, 2.0], 1e-12), "{got:?}");
}

#[test]
fn shapes_move_with_their_medium() {
    let cut = call(
        Builtin::Difference,
        vec![
            call(Builtin::Box, vec![m3(0.0, 0.0, 0.0), m3(1.0, 1.0, 1.0)], Type::Shape),
            sphere(m3(0.0, 0.0, 0.0), 0.5),
        ],
        Type::Shape,
    );
    for units in [Units::METRE, Units { length: 2.0 }] {
        let lowered = in_units(&shaped(cut.clone(), Some(example())), units);
        let shape = &lowered.media[0].shape;
        // Own (0.9, 0.9, 0.9) → 2 · (0.9, 0.9, −0.9) + y.
        assert!(contains(&lowered, shape, [1.8, 2.8, -1.8]));
        assert!(!contains(&lowered, shape, [1.8, 2.8, 1.8]), "behind");
        assert!(!contains(&lowered, shape, [0.2, 1.2, -0.2]), "in the sphere that was cut out");
        assert!(!contains(&lowered, shape, [2.2, 2.2, -1.0]), "beyond 2");
    }
}

#[test]
fn bounds_of_a_grid_are_the_outer_faces_of_its_voxels() {
    let mut scene = shaped(
        call(Builtin::Bounds, vec![expr(ExprKind::Grid(GridId(0)), Type::Grid)], Type::Shape),
        Some(translate(0.0, 0.0, 1.0)),
    );
    scene.grids.push(oblique());
    for units in [Units::METRE, Units { length: 1.0 / 64.0 }] {
        let lowered = in_units(&scene, units);
        let place = |i: f64, j: f64, k: f64| [0.1 - 3e-3 * j, 0.2 + 2e-3 * i, 1.3 + 5e-3 * k];
        let shape = &lowered.media[0].shape;
        assert!(contains(&lowered, shape, place(-0.49, -0.49, -0.49)));
        assert!(contains(&lowered, shape, place(7.49, 7.49, 7.49)));
        assert!(!contains(&lowered, shape, place(7.51, 0.0, 0.0)));
        assert!(!contains(&lowered, shape, place(0.0, -0.51, 0.0)));
    }
}

/// Asks for corners and sizes of a shape through the camera.
fn extents(shape: Expr, grids: Vec<Grid>) -> [Vec<f64>; 4] {
    [Builtin::Center, Builtin::MinCorner, Builtin::MaxCorner, Builtin::Size].map(|b| {
        let mut scene = scene();
        scene.grids = grids.clone();
        scene.camera.from = Some(m3(100.0, 101.0, 102.0));
        scene.camera.to = Some(call(b, vec![shape.clone()], Type::Vec3(length(1))));
        let lowered = in_units(&scene, Units { length: 0.5 });
        value(&lowered, lowered.camera.to, &Place::default()).iter().map(|v| v * 0.5).collect()
    })
}

fn shape(builtin: Builtin, arguments: Vec<Expr>) -> Expr {
    call(builtin, arguments, Type::Shape)
}

#[test]
fn corners_of_each_shape() {
    let check = |s: Expr, min: [f64; 3], max: [f64; 3]| {
        let [center, low, high, size] = extents(s, vec![oblique()]);
        assert!(close(&low, &min, 1e-12) && close(&high, &max, 1e-12), "{low:?} {high:?}");
        let middle: Vec<f64> = (0..3).map(|i| 0.5 * (min[i] + max[i])).collect();
        let extent: Vec<f64> = (0..3).map(|i| max[i] - min[i]).collect();
        assert!(close(&center, &middle, 1e-12) && close(&size, &extent, 1e-12), "{center:?} {size:?}");
    };
    let ball = || sphere(m3(1.0, 2.0, 3.0), 0.5);
    let cuboid = || shape(Builtin::Box, vec![m3(0.0, 0.0, 0.0), m3(1.25, 8.0, 3.0)]);
    let slab = || shape(Builtin::Slab, vec![v3(0.0, 1.0, 0.0), m(0.0), m(1.0)]);
    check(ball(), [0.5, 1.5, 2.5], [1.5, 2.5, 3.5]);
    check(shape(Builtin::Ellipsoid, vec![m3(0.0, 0.0, 0.0), m3(1.0, 2.0, 3.0)]), [-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]);
    check(cuboid(), [0.0; 3], [1.25, 8.0, 3.0]);
    check(shape(Builtin::Shell, vec![m3(1.0, 0.0, 0.0), m(2.0), m(3.0)]), [-2.0, -3.0, -3.0], [4.0, 3.0, 3.0]);
    // A cylinder along (3, 0, 4): the discs reach r · 0.8 in x, r in y and r · 0.6 in z.
    check(
        shape(Builtin::Cylinder, vec![m3(0.0, 0.0, 0.0), m3(3.0, 0.0, 4.0), m(1.0)]),
        [-0.8, -1.0, -0.6],
        [3.8, 1.0, 4.6],
    );
    check(shape(Builtin::Union, vec![ball(), cuboid()]), [0.0; 3], [1.5, 8.0, 3.5]);
    check(shape(Builtin::Intersection, vec![ball(), slab(), cuboid()]), [0.5, 1.5, 2.5], [1.25, 2.5, 3.0]);
    check(shape(Builtin::Difference, vec![ball(), cuboid()]), [0.5, 1.5, 2.5], [1.5, 2.5, 3.5]);
    let head = || expr(ExprKind::Grid(GridId(0)), Type::Grid);
    let (low, high) = ([0.1 - 22.5e-3, 0.2 - 1e-3, 0.3 - 2.5e-3], [0.1 + 1.5e-3, 0.2 + 15e-3, 0.3 + 37.5e-3]);
    check(head(), low, high);
    check(shape(Builtin::Bounds, vec![head()]), low, high);
}

#[test]
fn altitude_is_registered_once_and_measured_in_the_mediums_own_lengths() {
    let planet = || shape(Builtin::Shell, vec![m3(0.0, 0.0, 0.0), m(6.0), m(7.0)]);
    let k = |e: Expr| op(BinaryOp::Divide, e, quantity(1.0, length(2)), Type::Number(length(-1)));
    let mut scene = scene();
    for transform in [None, Some(then(translate(0.0, 1.0, 0.0), scale(n(-2.0))))] {
        scene.media.push(Medium {
            shape: Some(planet()),
            transform,
            k_a: Some(k(input(Input::Altitude))),
            k_s: Some(k(input(Input::Altitude))),
            ..medium("air")
        });
    }
    let lowered = in_units(&scene, Units { length: 4.0 });
    assert_eq!(lowered.shells.len(), 2);
    let (center, inner) = lowered.shells[1];
    assert_eq!(value(&lowered, center, &Place::default()), [0.0, 0.25, 0.0]);
    assert_eq!(value(&lowered, inner, &Place::default()), [3.0], "12 m in units of 4 m");
    // The engine says 1 m above the inner radius in the world; that is half a metre inside. 1/m is 4 per unit.
    let place = Place { altitude: 1.0, ..Place::default() };
    assert_eq!(value(&lowered, lowered.media[0].k_a, &place), [4.0]);
    assert_eq!(value(&lowered, lowered.media[1].k_a, &place), [2.0]);
}

#[test]
fn the_gradient_of_the_altitude_points_up() {
    let planet = shape(Builtin::Shell, vec![m3(0.0, 0.0, 0.0), m(6.0), m(7.0)]);
    let up = call(Builtin::Gradient, vec![input(Input::Altitude), p()], Type::Vec3(Dim::default()));
    let part =
        |i| op(BinaryOp::Multiply, component(up.clone(), i, Dim::default()), per_m(1.0), Type::Number(length(-1)));
    let k = call(Builtin::Rgb, vec![part(0), part(1), part(2)], Type::Spectrum(length(-1)));
    let mut scene = scene();
    let transform = Some(scale(n(2.0)));
    scene.media.push(Medium { shape: Some(planet), transform, k_a: Some(k), ..medium("air") });
    let lowered = metres(&scene);
    let got = value(&lowered, lowered.media[0].k_a, &here(12.0, 0.0, 9.0));
    assert!(close(&got, &[0.8, 0.0, 0.6], 1e-12), "{got:?}");
}

proptest! {
    /// A transform and its inverse: what a medium sees at the image of a point is the point.
    #[test]
    fn transforms_invert(
        axis in prop::array::uniform3(-1.0..1.0f64),
        angle in -7.0..7.0f64,
        shift in prop::array::uniform3(-3.0..3.0f64),
        factors in prop::array::uniform3(0.2..3.0f64),
        x in prop::array::uniform3(0.1..2.0f64),
    ) {
        prop_assume!(axis.iter().map(|a| a * a).sum::<f64>() > 1e-2);
        let transform = then(
            translate(shift[0], shift[1], shift[2]),
            then(rotate(v3(axis[0], axis[1], axis[2]), angle), scale(v3(factors[0], factors[1], factors[2]))),
        );
        // The image, by quaternions rather than by matrices.
        let size = axis.iter().map(|a| a * a).sum::<f64>().sqrt();
        let (s, c) = (0.5 * angle).sin_cos();
        let q = [axis[0] * s / size, axis[1] * s / size, axis[2] * s / size];
        let v: [f64; 3] = std::array::from_fn(|i| x[i] * factors[i]);
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let t = cross(q, v).map(|v| 2.0 * v);
        let u = cross(q, t);
        let world: [f64; 3] = std::array::from_fn(|i| v[i] + c * t[i] + u[i] + shift[i]);
        let lowered = metres(&seeing_p(transform));
        let got = own_position(&lowered, &here(world[0], world[1], world[2]));
        prop_assert!(close(&got, &x, 1e-12), "{got:?} against {x:?}");
    }
}
