//! Splats against the published formulas written out a second time, against closed forms with media, and where they are odd.

use compiler::ir::FieldScene;
use compiler::ir::eval::NoVoxels;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use runtime::data::splats::Splats;
use runtime::engine::reference::{ErrorKind, Goal, Options, RayResult, Reference};
use runtime::frame::{Camera, Params, View};
use runtime::image::{srgb_decode, srgb_encode};
use std::sync::Arc;
use tyndall_tests::Made;
use tyndall_tests::splats::{One, ball, file, plump};

/// A scene of one or more items `splats` of the same file, ready to trace.
struct Scene {
    lowered: FieldScene,
    params: Params,
    files: Vec<Arc<Splats>>,
}

impl Scene {
    fn new(text: &str, splats: &Arc<Splats>) -> Self {
        let out = compiler::compile("scene.vol", text, &Made(splats.clone()), &compiler::Options::default());
        let rendered = compiler::diagnostic::render(&out.diagnostics, &out.sources);
        let lowered = out.program.unwrap_or_else(|| panic!("{rendered}")).lowered;
        let params = Params::defaults(&lowered);
        Self { files: vec![splats.clone(); lowered.splats.len()], lowered, params }
    }

    fn engine(&self) -> Reference<'_, NoVoxels> {
        Reference::new(&self.lowered, &self.params.0, 0.0, &NoVoxels).expect("a scene").with_splats(&self.files)
    }

    fn camera(&self) -> Camera {
        Camera::from_scene(&self.lowered, &self.params.0, 0.0).expect("a camera")
    }

    /// Every pixel, three bands each.
    fn draw(&self) -> Vec<f64> {
        let drawn = self.engine().render(&self.camera(), &[[0.5, 0.5]], &Options::default(), &|_| {}).expect("draws");
        let pixels = drawn.pixels;
        assert!(pixels.radiance.iter().zip(&pixels.error).all(|(l, e)| *l >= 0.0 && l.is_finite() && *e >= 0.0));
        assert!(pixels.transmittance.iter().all(|t| (0.0..=1.0).contains(t)));
        pixels.radiance
    }

    fn ray(&self, origin: [f64; 3], direction: [f64; 3], options: &Options) -> RayResult {
        let unit = self.lowered.units.length;
        self.engine().trace(origin.map(|x| x / unit), direction, options).expect("traces")
    }
}

#[track_caller]
fn assert_near(a: &[f64], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len());
    let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst <= tolerance, "{worst} apart");
}

/// The constants of the published code.
fn published_color(sh: &[f64], degree: u8, d: DVec3) -> DVec3 {
    let (x, y, z) = (d.x, d.y, d.z);
    let (xx, yy, zz, xy, yz, xz) = (x * x, y * y, z * z, x * y, y * z, x * z);
    let c = |k: usize| DVec3::new(sh[3 * k], sh[3 * k + 1], sh[3 * k + 2]);
    let mut sum = 0.282_094_791_773_878_14 * c(0);
    if degree > 0 {
        sum += 0.488_602_511_902_919_9 * (-y * c(1) + z * c(2) - x * c(3));
    }
    if degree > 1 {
        sum += 1.092_548_430_592_079_2 * xy * c(4) - 1.092_548_430_592_079_2 * yz * c(5)
            + 0.315_391_565_252_520_05 * (2.0 * zz - xx - yy) * c(6)
            - 1.092_548_430_592_079_2 * xz * c(7)
            + 0.546_274_215_296_039_6 * (xx - yy) * c(8);
    }
    if degree > 2 {
        sum += -0.590_043_589_926_643_5 * y * (3.0 * xx - yy) * c(9) + 2.890_611_442_640_554 * xy * z * c(10)
            - 0.457_045_799_464_465_8 * y * (4.0 * zz - xx - yy) * c(11)
            + 0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * c(12)
            - 0.457_045_799_464_465_8 * x * (4.0 * zz - xx - yy) * c(13)
            + 1.445_305_721_320_277 * z * (xx - yy) * c(14)
            - 0.590_043_589_926_643_5 * x * (xx - 3.0 * yy) * c(15);
    }
    (sum + 0.5).max(DVec3::ZERO)
}

/// One pixel as equations 1 to 5 of Kerbl et al. have it, with matrices, in encoded numbers.
fn published_pixel(list: &[One], degree: u8, camera: &Camera, pixel: DVec2, background: DVec3) -> DVec3 {
    let (w, h) = (f64::from(camera.size[0]), f64::from(camera.size[1]));
    let View::Perspective { tangent } = camera.view else { panic!("perspective") };
    let f = h / (2.0 * tangent);
    let v = DVec3::from_array;
    // x to the right, y down, z forward.
    let world_to_view = DMat3::from_cols(v(camera.right), -v(camera.up), v(camera.forward)).transpose();
    let mut seen: Vec<(f64, f64, DVec3)> = vec![];
    for one in list {
        // As 32-bit numbers, like the file.
        let small = |x: f64| f64::from(x as f32);
        let t = world_to_view * (v(one.center.map(small)) - v(camera.from));
        if t.z <= 0.2 {
            continue;
        }
        let [qw, qx, qy, qz] = one.rotation;
        let norm = (qw * qw + qx * qx + qy * qy + qz * qz).sqrt();
        let q = [qx, qy, qz, qw].map(|x| small(x / norm));
        let m = DMat3::from_quat(DQuat::from_array(q).normalize()) * DMat3::from_diagonal(v(one.deviations.map(small)));
        let sigma = m * m.transpose();
        let (sx, sy) = (
            (t.x / t.z).clamp(-1.3 * tangent * w / h, 1.3 * tangent * w / h),
            (t.y / t.z).clamp(-1.3 * tangent, 1.3 * tangent),
        );
        // Columns of the 3×3 Jacobian, its last row of no interest.
        let j = DMat3::from_cols(
            DVec3::new(f / t.z, 0.0, 0.0),
            DVec3::new(0.0, f / t.z, 0.0),
            DVec3::new(-f * sx / t.z, -f * sy / t.z, 0.0),
        );
        let p = j * world_to_view;
        let c = p * sigma * p.transpose();
        let c = DMat2::from_cols(DVec2::new(c.x_axis.x + 0.3, c.x_axis.y), DVec2::new(c.y_axis.x, c.y_axis.y + 0.3));
        let d = pixel - DVec2::new(w / 2.0 + f * t.x / t.z, h / 2.0 + f * t.y / t.z);
        let alpha = small(one.opacity) * (-0.5 * d.dot(c.inverse() * d)).exp();
        let direction = (v(one.center.map(small)) - v(camera.from)).normalize();
        let harmonics: Vec<f64> = one.harmonics.iter().map(|x| small(*x)).collect();
        seen.push((t.z, alpha, published_color(&harmonics, degree, direction)));
    }
    seen.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut color, mut left) = (DVec3::ZERO, 1.0);
    for (_, alpha, c) in seen {
        color += left * alpha * c;
        left *= 1.0 - alpha;
    }
    color + left * background
}

const SIZE: [usize; 2] = [24, 16];
const VIEW: &str = "splats room { file = \"s.ply\" }
    camera { from = (0.3, 0.5, -3) m  to = (0.1, 0, 0) m  fov = 50 deg }
    image { size = 24 x 16  background = #336699 }";

#[test]
fn pixels_are_those_of_the_published_formulas() {
    for degree in 0..=3 {
        let list = plump(60, u64::from(degree));
        let scene = Scene::new(VIEW, &file(&list, degree, false));
        let (drawn, camera) = (scene.draw(), scene.camera());
        let unit = scene.lowered.units.length;
        let camera = Camera { from: camera.from.map(|x| x * unit), ..camera };
        let background = DVec3::new(0.2, 0.4, 0.6);
        let (mut worst, mut plain) = (0.0_f64, 0);
        for (i, found) in drawn.chunks_exact(3).enumerate() {
            let at = DVec2::new((i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5);
            let expected = published_pixel(&list, degree, &camera, at, background);
            plain += usize::from((expected - background).length() < 1e-3);
            for (c, found) in found.iter().enumerate() {
                worst = worst.max((srgb_encode(*found) - expected[c]).abs());
            }
        }
        println!("degree {degree}: {worst:e}, {plain} pixels of background");
        assert!(worst < 1e-12, "degree {degree}: {worst}");
        // Something is in the picture.
        assert!(plain < drawn.len() / 6);
    }
}

#[test]
fn order_does_not_matter_unless_depths_are_equal() {
    let mut list = plump(200, 7);
    let drawn = Scene::new(VIEW, &file(&list, 3, false)).draw();
    list.reverse();
    list.swap(3, 150);
    assert_near(&Scene::new(VIEW, &file(&list, 3, false)).draw(), &drawn, 1e-13);
    // At one depth the first of the file is in front: opaque, it hides the other.
    let text = "splats room { file = \"s.ply\"  blend = linear }
        camera { from = (0, 0, -4) m  to = (0, 0, 0) m }  image { size = 1 x 1 }";
    let (red, blue) = (ball([0.0; 3], 1.0, 1.0, [1.0, 0.0, 0.0]), ball([0.0; 3], 1.0, 1.0, [0.0, 0.0, 1.0]));
    let first = |list: &[One]| Scene::new(text, &file(list, 0, false)).draw();
    assert_near(&first(&[red.clone(), blue.clone()]), &[1.0, 0.0, 0.0], 1e-6);
    assert_near(&first(&[blue, red]), &[0.0, 0.0, 1.0], 1e-6);
}

#[test]
fn cameras_that_are_turned() {
    let file = file(&plump(60, 9), 3, false);
    let upright = Scene::new(VIEW, &file).draw();
    let text = VIEW.replace("fov = 50 deg", "fov = 50 deg  up = (0, -1, 0)");
    let inverted = Scene::new(&text, &file).draw();
    let turned: Vec<f64> = inverted.chunks_exact(3).rev().flatten().copied().collect();
    assert_near(&turned, &upright, 1e-13);
}

#[test]
fn what_is_behind_the_eye_or_too_near_is_not_seen() {
    let text =
        "splats room { file = \"s.ply\" }  camera { from = (0, 0, 0) m  to = (0, 0, 1) m }  image { size = 5 x 5 }";
    for (z, seen) in [(-1.0, false), (0.0, false), (0.1, false), (0.1999, false), (0.2001, true), (5.0, true)] {
        let file = file(&[ball([0.0, 0.0, z], 0.3, 0.9, [1.0; 3])], 0, false);
        let scene = Scene::new(text, &file);
        assert_eq!(scene.draw().iter().any(|l| *l > 0.0), seen, "{z}");
        // A ray of a probe has no near plane, only a beginning.
        let probed = scene.ray([0.0; 3], [0.0, 0.0, 1.0], &Options::default());
        assert_eq!(probed.radiance[0] > 0.0, z > 0.0, "{z}");
    }
    // Beside the eye: the affine approximation breaks down there, and must not reach into the picture.
    let file = file(&[ball([3.0, 0.0, 0.25], 0.3, 0.9, [1.0; 3])], 0, false);
    assert!(Scene::new(text, &file).draw().iter().all(|l| *l < 1e-6));
}

#[test]
fn a_ray_without_a_pixel_meets_the_largest_response() {
    let list = plump(1, 5);
    let splats = file(&list, 0, false);
    let scene = Scene::new("splats room { file = \"s.ply\"  blend = linear }", &splats);
    let v = |x: [f32; 3]| DVec3::from_array(x.map(f64::from));
    let [w, x, y, z] = splats.rotations()[0].map(f64::from);
    let turn = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let (origin, direction) = (DVec3::new(0.3, -0.2, -4.0), DVec3::new(0.05, 0.1, 1.0).normalize());
    // In steps along the ray, through the exponent itself.
    let exponent = |t: f64| {
        let d = turn.transpose() * (origin + t * direction - v(splats.centers()[0]));
        -0.5 * (d / v(splats.deviations()[0])).length_squared()
    };
    let largest = (0..=4_000_000).map(|i| exponent(2.0 + 1e-6 * f64::from(i))).fold(f64::MIN, f64::max);
    let alpha = f64::from(splats.opacities()[0]) * largest.exp();
    let found = scene.ray(origin.to_array(), direction.to_array(), &Options::default());
    assert!((found.transmittance[0] / (1.0 - alpha) - 1.0).abs() < 1e-9, "{} {alpha}", found.transmittance[0]);
    assert!((found.optical_depth[0] + (-alpha).ln_1p()).abs() < 1e-9);
    assert_eq!(found.error_kind, ErrorKind::Bound);
}

/// Two splats in media: what lies before, between and behind them, written out.
#[test]
fn media_before_between_and_behind() {
    let list = [ball([0.0, 0.0, 1.0], 0.5, 0.6, [0.8, 0.5, 0.1]), ball([0.0, 0.0, 3.0], 0.5, 0.3, [0.2, 0.9, 0.4])];
    let splats = file(&list, 0, false);
    let seen = |i: usize| -> [f64; 3] {
        std::array::from_fn(|c| 0.5 + 0.282_094_791_773_878_14 * f64::from(splats.harmonics(i)[c]))
    };
    // Everywhere; and a ball of radius 2 around (0, 0, 2) whose extinction varies, with emission in proportion.
    let media = [
        "fog { k = 0.4 /m  color = #8090a0 }",
        "medium gas { shape = sphere(center: (0,0,2) m, radius: 2 m)  density = 1 + p.z / 4 m  k_a = 0.3 /m  k_e = rgb(0.1, 0.2, 0.3) * (1 lx / m) }",
    ];
    for (uniform, medium) in [true, false].into_iter().zip(media) {
        for encoded in [true, false] {
            let blend = if encoded { "encoded" } else { "linear" };
            let text = format!(
                "splats room {{ file = \"s.ply\"  blend = {blend} }} {medium} image {{ background = #c0b0e0 }}"
            );
            let scene = Scene::new(&text, &splats);
            let found = scene.ray([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], &Options::default());
            let hex = |bytes: [u8; 3]| bytes.map(|b| srgb_decode(f64::from(b) / 255.0));
            let (source, depth): ([f64; 3], Box<dyn Fn(f64, f64) -> f64>) = if uniform {
                (hex([0x80, 0x90, 0xa0]), Box::new(|a: f64, b: f64| 0.4 * (b - a)))
            } else {
                let integral = |z: f64| 0.3 * (z + z * z / 8.0);
                let within = move |z: f64| integral(z.clamp(0.0, 4.0));
                ([1.0 / 3.0, 2.0 / 3.0, 1.0], Box::new(move |a: f64, b: f64| within(b) - within(a)))
            };
            // Endless fog hides the background.
            let mut light = if uniform { source } else { hex([0xc0, 0xb0, 0xe0]) };
            let mut tau = if uniform { f64::INFINITY } else { depth(-1.0, 9.0) };
            let through = |light: [f64; 3], t: f64| -> [f64; 3] {
                std::array::from_fn(|c| source[c] * -(-t).exp_m1() + (-t).exp() * light[c])
            };
            if !uniform {
                light = through(light, depth(3.0, 9.0));
            }
            for (i, near) in [(1, 1.0), (0, -1.0)] {
                let alpha = f64::from(splats.opacities()[i]);
                tau -= (-alpha).ln_1p();
                light = std::array::from_fn(|c| {
                    if encoded {
                        srgb_decode(alpha * seen(i)[c] + (1.0 - alpha) * srgb_encode(light[c]))
                    } else {
                        alpha * srgb_decode(seen(i)[c]) + (1.0 - alpha) * light[c]
                    }
                });
                light = through(light, depth(near, list[i].center[2]));
            }
            for (c, light) in light.into_iter().enumerate() {
                let off = (found.radiance[c] - light).abs();
                assert!(off <= 1e-10 * light, "{medium} {blend} {c}: {} {}", found.radiance[c], light);
                assert!(off <= found.error[c] + 1e-15, "{off} {}", found.error[c]);
            }
            assert!(found.optical_depth[0] == tau || (found.optical_depth[0] - tau).abs() < 1e-10, "{tau}");
            assert_eq!(found.error_kind, if uniform { ErrorKind::Bound } else { ErrorKind::Estimate });
        }
    }
}

#[test]
fn faint_splats_that_are_moved_are_within_the_error() {
    // In a picture splats of next to no opacity are not worth a cut of the medium; what that does is counted.
    let mut list = plump(400, 21);
    list.iter_mut().for_each(|o| o.opacity *= 1e-6);
    let text = "splats room { file = \"s.ply\" }
        medium gas { shape = sphere(center: (0,0,0) m, radius: 1.5 m)  density = 1 + p.x / 2 m  k_a = 2 /m  k_e = 1 lx / m }";
    let scene = Scene::new(text, &file(&list, 3, false));
    let exact = scene.ray([0.2, 0.1, -3.0], [0.0, 0.0, 1.0], &Options::default());
    let rough = Options { rtol: 1e-3, atol: 1e-3, goal: Goal::Radiance, ..Options::default() };
    let found = scene.ray([0.2, 0.1, -3.0], [0.0, 0.0, 1.0], &rough);
    for c in 0..3 {
        let off = (found.radiance[c] - exact.radiance[c]).abs();
        assert!(off > 0.0 && off <= found.error[c], "{off} {}", found.error[c]);
        assert!(found.error[c] <= 1e-3 * exact.radiance[c]);
    }
    assert!(found.evaluations < exact.evaluations / 2, "{} {}", found.evaluations, exact.evaluations);
}

#[test]
fn surfaces_hide_what_is_behind_them_and_opaque_splats_all() {
    let text = "splats room { file = \"s.ply\" }
        surface wall { shape = plane(point: (0,0,2) m, normal: (0,0,1))  albedo = 0 }
        light sky { environment = 1 lx }  render { scattering = none }";
    let front = ball([0.0, 0.0, 1.0], 0.4, 0.5, [1.0; 3]);
    let behind = ball([0.0, 0.0, 3.0], 0.4, 0.9, [1.0; 3]);
    let found = |list: &[One]| {
        Scene::new(text, &file(list, 0, false)).ray([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], &Options::default())
    };
    assert_eq!(found(&[front.clone(), behind.clone()]).radiance, found(std::slice::from_ref(&front)).radiance);
    assert_eq!(found(&[behind]).radiance, [0.0; 3]);
    let solid = One { opacity: 1.0, ..front };
    let scene =
        Scene::new("splats room { file = \"s.ply\" }  fog { k = 1e9 /m  color = #fff }", &file(&[solid], 0, false));
    let found = scene.ray([0.0, 0.0, 0.5], [0.0, 0.0, 1.0], &Options::default());
    assert_eq!((found.optical_depth[0], found.transmittance[0]), (f64::INFINITY, 0.0));
    assert_near(&found.radiance, &[1.0; 3], 1e-12);
}

#[test]
fn a_fixed_number_of_steps_converges_beside_splats() {
    let text = "splats room { file = \"s.ply\" }
        medium gas { shape = box(min: (-1,-1,0) m, max: (1,1,3) m)  density = exp(p.z / 1 m)  k_a = 0.2 /m  k_e = 0.1 lx / m * p.z / 1 m }";
    let list = [ball([0.0, 0.0, 0.7], 0.3, 0.5, [0.9, 0.3, 0.2]), ball([0.0, 0.0, 1.9], 0.3, 0.7, [0.1, 0.8, 0.2])];
    let scene = Scene::new(text, &file(&list, 0, false));
    let exact = scene.ray([0.0, 0.0, -2.0], [0.0, 0.0, 1.0], &Options::default());
    let error = |steps: u32| {
        let options = Options { steps: Some(steps), ..Options::default() };
        (scene.ray([0.0, 0.0, -2.0], [0.0, 0.0, 1.0], &options).radiance[0] - exact.radiance[0]).abs()
    };
    let slope = (error(16) / error(256)).log2() / 4.0;
    assert!((slope - 2.0).abs() < 0.1, "{slope}");
}

#[test]
fn transforms_turn_splats_and_their_colours() {
    let list = plump(40, 11);
    let plain = Scene::new(VIEW, &file(&list, 3, false)).draw();
    // (x, y, z) goes to (z, y, −x), in millimetres: from (0.3, 0.5, −3) to (−3, 0.5, −0.3), to (0.1, 0, 0) to (0, 0, −0.1).
    let turned = "splats room { file = \"s.ply\"
            transform = translate((1, 2, 3) m) * rotate(axis: (0, 1, 0), angle: 90 deg) * scale(1e-3) }
        camera { from = (0.997, 2.0005, 2.9997) m  to = (1, 2, 2.9999) m  fov = 50 deg }
        image { size = 24 x 16  background = #336699 }";
    assert_near(&Scene::new(turned, &file(&list, 3, false)).draw(), &plain, 1e-6);
    // The name of splats is the box around them, in the world.
    let text = format!(
        "{turned} medium gas {{ shape = sphere(center: center(room), radius: 1 mm)  k_a = 0 /m }}
        medium other {{ shape = bounds(room)  k_a = 0 /m }}"
    );
    let scene = Scene::new(&text, &file(&[ball([1.0, 2.0, 3.0], 0.1, 1.0, [1.0; 3])], 0, false));
    let unit = scene.lowered.units.length;
    let compiler::ir::Shape::Primitive(sphere) = &scene.lowered.media[0].shape else { panic!() };
    let compiler::ir::PrimitiveKind::Sphere { center, .. } = sphere.kind else { panic!() };
    let center = scene.lowered.graph.constant(center).expect("known").values();
    for (found, expected) in center.iter().zip([1.003, 2.002, 2.999]) {
        assert!((found * unit - expected).abs() < 1e-12, "{center:?}");
    }
    let compiler::ir::Shape::Primitive(room) = &scene.lowered.media[1].shape else { panic!() };
    assert!(matches!(room.kind, compiler::ir::PrimitiveKind::Box { .. }) && room.from_world.is_some());
}

#[test]
fn pictures_do_not_depend_on_the_unit_of_length() {
    let list = plump(30, 13);
    let plain = Scene::new(VIEW, &file(&list, 2, true)).draw();
    for factor in [1e-6, 1e6] {
        let scaled: Vec<One> = list
            .iter()
            .map(|o| One {
                center: o.center.map(|x| f64::from(x as f32)),
                deviations: o.deviations.map(|x| f64::from(x as f32)),
                ..o.clone()
            })
            .collect();
        let text = VIEW
            .replace("s.ply\"", &format!("s.ply\"  transform = scale({factor})"))
            .replace(" m  ", &format!(" * {factor} m  "));
        assert_near(&Scene::new(&text, &file(&scaled, 2, true)).draw(), &plain, 1e-9);
    }
}

#[test]
fn a_low_pass_that_keeps_light() {
    // A splat far smaller than a pixel covers it by its own area, not by that of the low-pass.
    let text = "splats room { file = \"s.ply\"  blend = linear }
        camera { from = (0, 0, -10) m  to = (0, 0, 0) m  projection = orthographic(height: 5 m) }
        image { size = 25 x 25 }";
    let sum = |deviation: f64, antialiased: bool| -> f64 {
        let file = file(&[ball([0.0; 3], deviation, 0.5, [1.0; 3])], 0, antialiased);
        Scene::new(text, &file).draw().iter().sum::<f64>() / 3.0
    };
    // ∫ o·exp(−r²/2s²) = 2π·o·s², in pixels of 0.2 m; the mean over the pixel's own grid is exact enough.
    let (s, h) = (0.15 / 0.2, 0.3_f64);
    let own = std::f64::consts::PI * s * s;
    assert!((sum(0.15, true) / own - 1.0).abs() < 1e-2, "{} {own}", sum(0.15, true));
    assert!((sum(0.15, false) / (own * (s * s + h) / (s * s)) - 1.0).abs() < 1e-2);
}
