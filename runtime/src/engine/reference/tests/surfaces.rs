//! Opaque surfaces and the lights on them.

use super::super::{ErrorKind, Reference, Triangles};
use super::build::*;
use super::closed::quad;
use crate::frame::vector::{Vec3, normalize};
use compiler::ir::eval::NoVoxels;
use compiler::ir::{Binary, Input, MeshId, MeshInfo, PrimitiveKind, Shape, SurfaceShape, Unary, Units};
use compiler::loader::MeshHeader;
use std::f64::consts::PI;

#[test]
fn plane_under_parallel_light() {
    // From both sides: the light counts only where the eye is.
    for (eye, expected) in [(2.0, 0.8), (-2.0, 0.0)] {
        let mut b = Build::default();
        b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.7);
        b.sun([0.6, -0.8, 0.0], 5.0, None);
        let scene = b.scene(9.0);
        let result = trace(&scene, [0.3, eye, 0.0], [0.2, -eye, 0.5]);
        assert!((result.radiance[0] - 0.7 * 5.0 * expected / PI).abs() < 1e-14);
        assert_eq!(result.error_kind, ErrorKind::Bound);
        let away = trace(&scene, [0.3, eye, 0.0], [0.2, eye, 0.5]);
        assert_eq!(away.radiance[0], 9.0);
    }
}

#[test]
fn lamps_and_their_radius() {
    // E = I·cosine/max(d, r)²; in the lamp itself nothing breaks.
    for (height, radius) in [(2.0, None), (2.0, Some(3.0)), (0.0, None), (0.0, Some(1.0)), (1e-200, None)] {
        let mut b = Build::default();
        b.plane([0.0; 3], [0.0, 0.0, -1.0], 0.5);
        b.lamp([0.0, 0.0, -height], 3.0, radius);
        let result = ahead(&b.scene(0.0));
        let d: f64 = f64::max(height, radius.unwrap_or(0.0));
        if height > 1.0 {
            assert!((result.radiance[0] - 0.5 * 3.0 / (d * d) / PI).abs() < 1e-11, "{height} {radius:?}");
        }
        assert!(result.radiance[0].is_finite() && result.radiance[0] >= 0.0);
    }
}

#[test]
fn lambert_through_fog() {
    // Fog of σ = 0.3 between z = −1 and the wall at z = 2: slanted eye ray, lamp inside the fog, parallel light from outside.
    let sigma: f64 = 0.3;
    let eye = normalize([0.2, 0.1, 1.0]).unwrap();
    let t = 6.0 / eye[2];
    let hit = [t * eye[0], t * eye[1], 2.0];
    let lamp = [0.5, -0.4, 0.0];
    let d2: f64 = (0..3).map(|i| (hit[i] - lamp[i]) * (hit[i] - lamp[i])).sum();
    let from_lamp = 4.0 / d2 * (2.0 / d2.sqrt()) * (-sigma * d2.sqrt()).exp();
    let from_sun = 5.0 * 0.8 * (-sigma * 3.0 / 0.8).exp();
    for flat in [true, false] {
        let mut b = Build::default();
        let shape = b.slab([0.0, 0.0, 1.0], -1.0, 5.0);
        if flat {
            b.plain(shape, sigma, 0.0);
        } else {
            // The same depth by quadrature: sin² + cos².
            let x = b.linear(0, 3.0, 0.1);
            let (s, c) = (b.g.unary(Unary::Sin, x), b.g.unary(Unary::Cos, x));
            let (s, c) = (b.g.mul(s, s), b.g.mul(c, c));
            let one = b.g.add(s, c);
            let k = b.times(sigma, one);
            let zero = b.c(0.0);
            b.medium(shape, k, zero);
        }
        b.plane([0.0, 0.0, 2.0], [0.0, 0.0, -1.0], 0.6);
        b.lamp(lamp, 4.0, None);
        b.sun([0.6, 0.0, 0.8], 5.0, None);
        let result = trace(&b.scene(1.0), [0.0, 0.0, -4.0], [0.2, 0.1, 1.0]);
        let tau = sigma * 3.0 / eye[2];
        close(&result, 0.6 / PI * (from_lamp + from_sun) * (-tau).exp(), tau, 1e-11);
    }
}

#[test]
fn shadows_of_one_surface_on_another() {
    // A ball before the sun, above a floor.
    let mut b = Build::default();
    b.plane([0.0; 3], [0.0, 1.0, 0.0], 1.0);
    let ball = b.sphere([0.0, 2.0, 0.0], 1.0);
    b.surface(SurfaceShape::Boundary(ball), 0.5);
    b.sun([1.0, -1.0, 0.0], PI, None);
    let scene = b.scene(0.0);
    // The shadow's middle is at x = 2 and reaches √2 along x, 1 along z.
    let at = |x: f64, z: f64| trace(&scene, [x, 1e-3, z], [0.0, -1.0, 0.0]).radiance[0];
    let lit = 0.5f64.sqrt();
    let reach = 2f64.sqrt();
    assert!(
        at(2.0, 0.0).abs() < 1e-15 && at(2.0 + reach - 1e-6, 0.0).abs() < 1e-15 && at(2.0, 0.999_999).abs() < 1e-15
    );
    assert!((at(2.0 + reach + 1e-6, 0.0) - lit).abs() < 1e-12 && (at(2.0, 1.000_001) - lit).abs() < 1e-12);
    // The ball itself: lit to the last bit of its terminator, dark behind it.
    let ball = |y: f64| trace(&scene, [-4.0, y, 0.0], [1.0, 0.0, 0.0]).radiance[0];
    for y in [1.01f64, 1.5, 2.0, 2.9] {
        let normal = [-(1.0 - (y - 2.0) * (y - 2.0)).sqrt(), y - 2.0];
        let cosine = (-normal[0] + normal[1]) * 0.5f64.sqrt();
        assert!((ball(y) - 0.5 * cosine.max(0.0)).abs() < 1e-11, "{y}: {}", ball(y));
    }
}

#[test]
fn boundaries_and_their_normals() {
    // Light along the ray: radiance is albedo·E·cosine/π, so that normals show.
    let cosine = |shape: Shape, b: Build, o: Vec3, d: Vec3| {
        let mut b = b;
        b.surface(SurfaceShape::Boundary(shape), 1.0);
        b.sun(d, PI, None);
        let result = trace(&b.scene(0.0), o, d);
        result.radiance[0]
    };
    let mut b = Build::default();
    let (center, radii) = (b.g.vector(&[0.0; 3]), b.g.vector(&[1.0, 2.0, 3.0]));
    let shape = primitive(PrimitiveKind::Ellipsoid { center, radii });
    // At x = 0.5, y = 0.4: the gradient is p/r².
    let z = -3.0 * (1.0f64 - 0.25 - 0.04).sqrt();
    let n = normalize([0.5, 0.1, z / 9.0]).unwrap();
    assert!((cosine(shape, b, [0.5, 0.4, -9.0], [0.0, 0.0, 1.0]) + n[2]).abs() < 1e-11);
    let mut b = Build::default();
    let (from, to, radius) = (b.g.vector(&[0.0; 3]), b.g.vector(&[0.0, 2.0, 0.0]), b.c(1.0));
    let rod = |_: &mut Build| primitive(PrimitiveKind::Cylinder { from, to, radius });
    let shape = rod(&mut b);
    assert!((cosine(shape, b, [0.6, 1.0, -5.0], [0.0, 0.0, 1.0]) - 0.8).abs() < 1e-11);
    let mut b = Build::default();
    let shape = b.cube([-1.0; 3], [1.0; 3]);
    let d = normalize([0.1, 0.2, 1.0]).unwrap();
    assert!((cosine(shape, b, [0.0, 0.0, -4.0], d) - d[2]).abs() < 1e-12);
    // From inside a solid its inner wall, first the nearer ball of two that overlap.
    let mut b = Build::default();
    let (one, two) = (b.sphere([0.0; 3], 1.0), b.sphere([0.0, 0.0, 1.5], 1.0));
    b.surface(SurfaceShape::Boundary(Shape::Union(vec![one, two])), 1.0);
    b.lamp([0.0; 3], PI, None);
    let inner = trace(&b.scene(0.0), [0.0, 0.0, 0.2], [0.0, 0.0, 1.0]);
    assert!((inner.radiance[0] - 1.0 / 6.25).abs() < 1e-11, "{}", inner.radiance[0]);
    // An implicit ball; the same after noise has taken its derivative away.
    for rough in [false, true] {
        let mut b = Build::default();
        let r2 = b.square([0.0; 3]);
        let r = b.g.unary(Unary::Sqrt, r2);
        let one = b.c(1.0);
        let field = b.g.sub(r, one);
        let field = if rough {
            let shells = (b.g.vector(&[0.0; 3]), b.c(1.0));
            b.shells.push(shells);
            b.g.input(Input::Altitude(0))
        } else {
            field
        };
        let shape = primitive(PrimitiveKind::Sdf { field });
        let found = cosine(shape, b, [0.6, 0.0, -4.0], [0.0, 0.0, 1.0]);
        assert!((found - 0.8).abs() < if rough { 1e-8 } else { 1e-11 }, "{rough} {found}");
    }
    // A hole: the wall behind the near side that was cut away.
    let mut b = Build::default();
    let (ball, near) = (b.sphere([0.0; 3], 1.0), b.slab([0.0, 0.0, 1.0], -2.0, 0.5));
    let shape = Shape::Difference(Box::new(ball), vec![near]);
    assert!((cosine(shape, b, [0.3, 0.0, -4.0], [0.0, 0.0, 1.0]) - 1.0).abs() < 1e-11);
}

#[test]
fn triangles_make_the_same_wall() {
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let meshes = Triangles(vec![vec![[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]]);
    let mut b = Build::default();
    let header = MeshHeader { triangles: 2, bounds: ([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]) };
    b.meshes.push(MeshInfo { path: String::new(), from: String::new(), span: None, header });
    b.surface(SurfaceShape::Mesh(MeshId(0)), 1.0);
    // A floor behind it that it shades. The graph's unit is 4 m.
    b.plane([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 0.5);
    b.sun([0.0, 0.0, 1.0], PI, None);
    let mut scene = b.scene(0.25);
    scene.units = Units { length: 4.0 };
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap().with_meshes(&meshes);
    let at = |x: f64, y: f64, z: f64| {
        reference.trace([x, y, z], [0.0, 0.0, 1.0], &super::super::Options::default()).unwrap()
    };
    // A quarter of a unit wide; also exactly on the seam between the triangles.
    for (x, y) in [(0.0, 0.0), (0.24, 0.24), (-0.2, 0.1), (0.1, 0.1)] {
        let wall = at(x, y, -4.0);
        assert!((wall.radiance[0] - 1.0).abs() < 1e-12, "{x} {y}");
        assert_eq!(at(x, y, 0.5).radiance[0], 0.0);
    }
    assert!((at(0.26, 0.0, -4.0).radiance[0] - 0.5).abs() < 1e-12);
}

#[test]
fn surfaces_end_rays() {
    // A medium that never ends, behind and before a wall.
    let mut b = Build::default();
    b.plain(Shape::Everywhere, 0.5, 2.0);
    b.plane([0.0, 0.0, -2.0], [0.0, 0.0, 1.0], 0.5);
    let result = ahead(&b.scene(7.0));
    close(&result, 4.0 * -(-1.0f64).exp_m1(), 1.0, 1e-15);
}

#[test]
fn discs_of_light() {
    for degrees in [0.53f64, 10.0, 60.0] {
        let alpha = 0.5 * degrees.to_radians();
        let direction = normalize([0.4, -1.0, 0.2]).unwrap();
        // A whole disc over the horizon shines as if from its middle.
        let mut b = Build::default();
        b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.7);
        b.sun(direction, 5.0, Some(2.0 * alpha));
        let scene = b.scene(0.5);
        let floor = trace(&scene, [0.0, 1.0, 0.0], [0.3, -1.0, 0.0]);
        let exact = 0.7 / PI * 5.0 * -direction[1];
        let wrong = (floor.radiance[0] - exact).abs();
        assert!(wrong <= 1e-7 * exact && wrong <= floor.error[0], "{wrong:e} {:e}", floor.error[0]);
        // It is seen itself: up to its rim.
        let radiance = 5.0 / (PI * alpha.sin() * alpha.sin());
        let side = normalize([1.0, 0.4, 0.0]).unwrap();
        let at = |angle: f64| {
            let d = std::array::from_fn(|i| -direction[i] * angle.cos() + side[i] * angle.sin());
            trace(&scene, [0.0, 1.0, 0.0], d).radiance[0]
        };
        assert!((at(0.0) - radiance - 0.5).abs() < 1e-9 * radiance);
        assert!((at(0.9999 * alpha) - radiance - 0.5).abs() < 1e-9 * radiance && at(1.0001 * alpha) == 0.5);
    }
    // Half below the horizon: ∫ over the upper half of cosine, 2/3·sin³α… by quadrature over the height.
    let alpha = 0.2f64;
    let mut b = Build::default();
    b.plane([0.0; 3], [0.0, 1.0, 0.0], 1.0);
    b.sun([1.0, 0.0, 0.0], 1.0, Some(2.0 * alpha));
    let found = trace(&b.scene(0.0), [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]);
    // ∫₀^α sin²θ dθ ∫₀^π sinφ dφ = α − sin α·cos α.
    let exact = (alpha - alpha.sin() * alpha.cos()) / (PI * alpha.sin().powi(2)) / PI;
    assert!((found.radiance[0] - exact).abs() <= 2e-7 * exact, "{} {exact}", found.radiance[0]);
}

#[test]
fn floor_under_a_sky() {
    // A uniform sky of 2 over a floor: albedo·2. One that brightens upwards as its height: ∫ cosine² = 2π/3.
    let floor = |gradient: bool, wall: bool| {
        let mut b = Build { environment: true, ..Build::default() };
        b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.6);
        if wall {
            // Hides half of the sky.
            b.plane([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0);
        }
        let direction = b.g.input(Input::Direction);
        let height = b.g.extract(direction, 1);
        let zero = b.c(0.0);
        let sky = if gradient { b.g.binary(Binary::Max, height, zero) } else { b.c(2.0) };
        let mut scene = b.scene(0.0);
        scene.background = sky;
        trace(&scene, [0.0, 1.0, 0.0], [0.1, -1.0, 0.0])
    };
    let close = |found: &super::super::RayResult, exact: f64| {
        let wrong = (found.radiance[0] - exact).abs();
        assert!(wrong <= 2e-7 * exact && wrong <= found.error[0], "{} {exact} {:e}", found.radiance[0], found.error[0]);
    };
    close(&floor(false, false), 1.2);
    close(&floor(true, false), 0.6 / PI * 2.0 * PI / 3.0);
    close(&floor(false, true), 0.6);
    // Under an absorbing slab: ∫ e^(−τ/cosine) cosine = 2π·E₃(τ).
    let mut b = Build { environment: true, ..Build::default() };
    b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.6);
    let slab = b.slab([0.0, 1.0, 0.0], 2.0, 3.0);
    b.plain(slab, 0.8, 0.0);
    let found = trace(&b.scene(2.0), [0.0, 1.0, 0.0], [0.1, -1.0, 0.0]);
    let e3 = quad(|m| m * (-0.8 / m).exp(), 0.0, 1.0);
    close(&found, 0.6 * 2.0 * 2.0 * e3);
}

#[test]
fn wrong_surfaces_and_lights_are_named() {
    let mut b = Build::default();
    b.plane([0.0; 3], [0.0, 0.0, 1.0], -0.5);
    b.sun([0.0, 0.0, 1.0], 1.0, None);
    let scene = b.scene(0.0);
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let error = reference.trace([0.0, 0.0, -4.0], [0.0, 0.0, 1.0], &super::super::Options::default()).unwrap_err();
    assert_eq!(error.code, "E0650");
    assert!(error.message.contains("albedo of surface `s0`"), "{}", error.message);
    for (irradiance, intensity, code, name) in
        [(-1.0, 1.0, "E0650", "irradiance of light `l0`"), (1.0, f64::NAN, "E0651", "intensity of light `l1`")]
    {
        let mut b = Build::default();
        b.sun([0.0, 0.0, 1.0], irradiance, None);
        b.lamp([0.0; 3], intensity, None);
        let scene = b.scene(0.0);
        let error = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap_err();
        assert_eq!(error.code, code);
        assert!(error.message.contains(name), "{}", error.message);
    }
    // An environment that is negative where nothing but a floor looks at it.
    let mut b = Build { environment: true, ..Build::default() };
    b.plane([0.0; 3], [0.0, 1.0, 0.0], 0.6);
    let direction = b.g.input(Input::Direction);
    let x = b.g.extract(direction, 0);
    let mut scene = b.scene(0.0);
    scene.graph.annotate(x, None, Some("dawn.environment"));
    scene.background = x;
    let reference = Reference::new(&scene, &[], 0.0, &NoVoxels).unwrap();
    let error = reference.trace([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], &super::super::Options::default()).unwrap_err();
    assert_eq!(error.code, "E0650");
    assert!(error.message.contains("light `dawn`"), "{}", error.message);
}
