//! What splatting promises: second order on smooth fields, sources that are exact where they are uniform, and no trouble with
//! extreme media, cameras and requests.

use compiler::Options;
use compiler::ir::{Aa, Backend};
use runtime::frame::{EngineChoice, FileLoader, Params, ProbeSettings, RayQuery, Session, Settings};
use std::path::Path;
use tyndall_tests::{codes_of, draw, draw_text, open_text};

/// Smooth, and nothing is left of it at the faces of its box.
const SMOKE: &str = "
    medium smoke {
        shape = box(min: (-1.3,-1.3,-1.3) m, max: (1.3,1.3,1.3) m)
        density = exp(-dot(p, p) / (0.16 m^2)) * (1 + 0.45 * sin(6 * p.x / 1 m))
        k_a = rgb(6, 5, 4) / m
        k_e = rgb(3, 5, 1) * lx / m * (1 + p.z / 2 m)
    }
    camera { from = (0.5, 0.4, -3) m  to = (0,0,0) m  fov = 40 deg }
    image  { size = 20 x 15  aa = none  background = #102030 }
";

fn splatted(splats: Option<u32>, options: Options) -> Options {
    Options { backend: Some(Backend::Splatting), splats, aa: Some(Aa::None), ..options }
}

fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) = points.iter().map(|(a, b)| (a.ln(), b.ln())).unzip();
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    x.iter().zip(&y).map(|(a, b)| (a - mx) * (b - my)).sum::<f64>() / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>()
}

#[test]
fn radiance_and_depth_converge_with_order_two_in_the_spacing() {
    let rays = [
        RayQuery { origin: [0.05, -0.2, -4.0], direction: [0.0, 0.0, 1.0] },
        RayQuery { origin: [-4.0, 1.0, 0.5], direction: [4.0, -0.9, -0.4] },
    ];
    let settings = Settings { options: Options::probe(), engine: EngineChoice::Reference, ..Settings::default() };
    let mut reference =
        Session::open("smoke", SMOKE, &FileLoader::new(Path::new(".")), settings).expect("the scene is right");
    let params = Params::defaults(&reference.program().lowered);
    let exact = reference.probe(&params, &rays, &ProbeSettings::default()).expect("it can be probed");
    let (mut light, mut depth) = (vec![], vec![]);
    for count in [4_000, 12_000, 40_000, 120_000] {
        let Some(mut session) = open_text(SMOKE, splatted(Some(count), Options::probe())) else { return };
        let found = session.probe(&params, &rays, &ProbeSettings::default()).expect("it can be probed");
        let spacing = f64::from(count).powf(-1.0 / 3.0);
        let worst = |of: &dyn Fn(usize) -> f64| (0..rays.len()).map(of).fold(0.0, f64::max);
        light.push((spacing, worst(&|i| (found[i].radiance[0] - exact[i].radiance[0]).abs())));
        depth.push((spacing, worst(&|i| (found[i].optical_depth[0] - exact[i].optical_depth[0]).abs())));
        // The estimate from fewer splats covers what is wrong.
        for (f, e) in found.iter().zip(&exact) {
            assert!(f.error[0] >= 0.8 * (f.radiance[0] - e.radiance[0]).abs(), "{f:?}");
        }
    }
    let (light, depth) = (slope(&light), slope(&depth));
    assert!((light - 2.0).abs() < 0.35 && (depth - 2.0).abs() < 0.35, "slopes {light} and {depth}");
}

/// Where k_e/k_t is the same everywhere, L = S·(1 − T), whatever the splats are.
#[test]
fn a_uniform_source_gives_what_its_own_transmittance_leaves() {
    let text = "
        medium cloud {
            shape = union(sphere(center: (0,0,0) m, radius: 1 m), box(min: (0.5,0,0) m, max: (2,1,1) m))
            density = 3 + 2 * sin(5 * p.x / 1 m)
            k_a = rgb(1, 2, 0.5) / m
            k_e = rgb(0.5, 3, 0.1) * lx / m
        }
        camera { from = (0.5, 0.4, -5) m  to = (0.4,0,0) m  fov = 40 deg }
        image  { size = 24 x 18  aa = none }";
    let Some((light, clear)) = draw_text(text, splatted(Some(6000), Options::default())) else { return };
    for (l, t) in light.chunks(3).zip(clear.chunks(3)) {
        for (band, source) in [0.5, 1.5, 0.2].into_iter().enumerate() {
            assert!((l[band] - source * (1.0 - t[band])).abs() < 3e-5, "{l:?} {t:?}");
        }
    }
    assert!(clear.iter().any(|t| *t < 0.1) && clear.iter().any(|t| *t > 0.99));
}

#[test]
fn a_picture_is_that_of_the_ray_marcher() {
    let Some((light, clear)) = draw_text(SMOKE, splatted(Some(100_000), Options::default())) else { return };
    let marched = Options { backend: Some(Backend::Raymarch), aa: Some(Aa::None), ..Options::default() };
    let (other, other_clear) = draw_text(SMOKE, Options { accuracy: Some(1e-3), ..marched }).expect("an adapter");
    let worst = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    assert!(worst(&light, &other) < 2e-2, "{}", worst(&light, &other));
    assert!(worst(&clear, &other_clear) < 2e-2, "{}", worst(&clear, &other_clear));
}

/// Boundaries are blurred by about a spacing: that is within what is said, thin and thick, with a surface in it, and not much less. What is said
/// is an estimate: along a face that the eye looks along, where tails of two layers of nodes show, it falls short at a few pixels.
#[test]
fn what_is_blurred_at_boundaries_is_said_of_each_pixel() {
    let scene = |shape: &str, k: f64, rest: &str| {
        format!(
            "medium body {{ shape = {shape}  k_a = rgb(1, 0.6, 1.5) * {k} /m  k_e = rgb(0.2, 0.9, 1.2) * {k} lx / m }}
            camera {{ from = (0.7, 0.9, -3.5) m  to = (0,0,0) m  fov = 45 deg }}
            image {{ size = 26 x 20  aa = none  background = #8090a0 }}\n{rest}"
        )
    };
    let ball = "sphere(center: (0,0,0) m, radius: 1 m)";
    let block = "difference(box(min: (-0.9,-0.7,-0.6) m, max: (0.8,0.9,0.7) m), sphere(center: (0.5,0.5,-0.5) m, radius: 0.5 m))";
    let floor = "surface floor { shape = plane(point: (0,-0.3,0) m, normal: (0.2,1,0.1))  albedo = 0.4 }
        light sun { direction = (0.3,-1,0.4)  irradiance = 2 lx }";
    let (mut ratios, mut beyond) = (vec![], 0);
    for (shape, k, rest) in [(ball, 0.3, ""), (ball, 3.0, ""), (ball, 1e4, ""), (block, 2.0, ""), (ball, 1.0, floor)] {
        let text = scene(shape, k, rest);
        let Some(mut session) = open_text(&text, splatted(Some(8000), Options::default())) else { return };
        let drawing = draw(Path::new("scene.vol"), &mut session);
        let marched = Options { backend: Some(Backend::Raymarch), aa: Some(Aa::None), ..Options::default() };
        let (exact, _) = draw_text(&text, Options { accuracy: Some(1e-4), ..marched }).expect("an adapter");
        let pixels = drawing.picture.radiance().chunks(3).zip(exact.chunks(3));
        for (pixel, (found, exact)) in pixels.enumerate() {
            let off = found.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            let said = drawing.errors[pixel];
            assert!(off <= 1.5 * said + 1e-3, "{shape} {k}: {off} at pixel {pixel}, said to be {said}");
            beyond += usize::from(off > said + 1e-3);
            if off > 1e-3 {
                ratios.push(said / off);
            }
        }
    }
    ratios.sort_by(f32::total_cmp);
    let median = ratios[ratios.len() / 2];
    assert!(beyond <= 26, "{beyond} of 2600 pixels are beyond");
    println!("{beyond} beyond; {} pixels, median of reported over measured {median}", ratios.len());
    assert!(ratios.len() > 500 && median <= 20.0, "{median} of {}", ratios.len());
}

#[test]
fn extreme_media_and_cameras_leave_numbers() {
    for (density, camera) in [
        ("1e30", "camera { from = (0,0,-4) m  to = (0,0,0) m  fov = 40 deg }"),
        ("1e-30", "camera { from = (0,0,-4) m  to = (0,0,0) m  fov = 40 deg }"),
        ("2", "camera { from = (0,0,0) m  to = (1,0.3,0) m  fov = 120 deg }"),
        ("2", "camera { from = (0,0,-1e7) m  to = (0,0,0) m  fov = 1e-5 deg }"),
        ("2", "camera { from = (0,0,3) m  to = (0,0,9) m  fov = 60 deg }"),
        ("2", "camera { from = (0,0,0) m  to = (1,0,0) m  projection = orthographic(height: 3 m) }"),
    ] {
        let text = format!(
            "medium ball {{ shape = sphere(center: (0,0,0) m, radius: 1 m)  k_a = {density} /m * (1 + 0.1 * p.x / 1 m)  \
             k_e = {density} lx / m }}\n{camera}\nimage {{ size = 9 x 7  aa = none }}"
        );
        let Some((light, clear)) = draw_text(&text, splatted(Some(3000), Options::default())) else { return };
        assert!(light.iter().all(|l| (0.0..1.2).contains(l)), "{text}: {light:?}");
        assert!(clear.iter().all(|t| (0.0..=1.0).contains(t)), "{text}: {clear:?}");
        if density == "1e30" {
            assert!(clear[9 * 3 + 4] < 1e-6 || clear.contains(&0.0), "{clear:?}");
        }
    }
}

#[test]
fn what_splats_cannot_show_is_refused() {
    let refused = |text: &str| codes_of(text, &splatted(None, Options::default())) == ["E0530"];
    assert!(!refused(SMOKE));
    assert!(refused("fog { k = 0.1 /m  color = #fff }"));
    assert!(refused(&SMOKE.replace("fov = 40 deg", "projection = panorama")));
}
