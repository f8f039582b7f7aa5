//! Time against error of every backend for the brain, the nebula, the cloud and the smoke, and the rates by which `backend = auto`
//! chooses: what `compiler/src/backends` holds in its registry. Errors are the largest of a picture off edges, as a share of display white
//! or of the light there, against the ray marcher at a thirtieth of the scene's accuracy.
//!
//! `cargo bench --bench forecast` prints both; names of scenes after `--` take these alone.

use compiler::Options;
use compiler::backends::{REGISTRY, field_weight};
use compiler::ir::{Aa, Backend};
use compiler::program::{Outcome, OutputKind};
use runtime::frame::{Drawing, EngineChoice};
use std::path::{Path, PathBuf};
use tyndall_tests::{draw, open, root};

const SIZE: [u32; 2] = [96, 96];

/// One drawing of a ladder.
struct Rung {
    /// Along a ray.
    pieces: f64,
    milliseconds: f64,
    largest: f64,
    rms: f64,
}

fn options(backend: Backend) -> Options {
    let mut options = Options { size: Some(SIZE), aa: Some(Aa::None), backend: Some(backend), ..Options::default() };
    options.outputs.extend([OutputKind::Evaluations, OutputKind::Edge]);
    options
}

/// The best of three.
fn drawn(path: &Path, options: Options) -> Option<Drawing> {
    let mut session = open(path, options, EngineChoice::Gpu)?;
    let mut drawings: Vec<Drawing> = (0..3).map(|_| draw(path, &mut session)).collect();
    drawings.sort_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
    Some(drawings.swap_remove(0))
}

/// The largest error relative to max(white, the light there), and the RMS in lx.
fn errors(drawing: &Drawing, truth: &Drawing) -> (f64, f64) {
    let (a, b) = (drawing.picture.radiance(), truth.picture.radiance());
    let bands = a.len() / (SIZE[0] * SIZE[1]) as usize;
    let (mut largest, mut sum) = (0.0f64, 0.0);
    for (pixel, (x, y)) in a.chunks_exact(bands).zip(b.chunks_exact(bands)).enumerate() {
        let off = x.iter().zip(y).map(|(x, y)| f64::from((x - y).abs()));
        sum += off.clone().map(|d| d * d).sum::<f64>();
        if !truth.edges.get(pixel).copied().unwrap_or(false) {
            let bright = y.iter().fold(1.0f32, |m, v| m.max(*v));
            largest = largest.max(off.fold(0.0, f64::max) / f64::from(bright));
        }
    }
    (largest, (sum / a.len() as f64).sqrt())
}

fn ladder(path: &Path, backend: Backend, truth: &Drawing) -> Vec<Rung> {
    let rungs: Vec<Options> = match backend {
        Backend::Auto | Backend::Raymarch => [3.0, 1.0, 0.3, 0.1]
            .map(|part| {
                let scene = open(path, options(backend), EngineChoice::Gpu).map_or(1e-2, |s| s.accuracy());
                Options { accuracy: Some(part * scene), ..options(backend) }
            })
            .into(),
        Backend::Slicing => [32, 64, 128, 256, 512].map(|n| Options { slices: Some(n), ..options(backend) }).into(),
        Backend::Splatting => {
            [4096, 32_768, 110_592, 262_144].map(|n| Options { splats: Some(n), ..options(backend) }).into()
        }
    };
    let rung = |options: Options| {
        let drawing = drawn(path, options)?;
        let (largest, rms) = errors(&drawing, truth);
        let pieces = match backend {
            Backend::Auto | Backend::Raymarch => drawing.evaluations? as f64 / f64::from(SIZE[0] * SIZE[1]),
            Backend::Slicing => f64::from(drawing.slabs?),
            Backend::Splatting => f64::from(drawing.splats?).cbrt(),
        };
        Some(Rung { pieces, milliseconds: drawing.milliseconds, largest, rms })
    };
    rungs.into_iter().filter_map(rung).collect()
}

/// y = a + b·x by least squares.
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let (sx, sy) = points.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
    let (mx, my) = (sx / n, sy / n);
    let xx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let xy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    let b = if xx > 0.0 { xy / xx } else { 0.0 };
    (my - b * mx, b)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn main() {
    // `cargo test --benches` runs this too, and wants nothing of it.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let example = |name: &str| root().join("examples").join(name).with_extension("vol");
    let scenes: [(&str, PathBuf); 4] = [
        ("brain", example("brain")),
        ("nebula", example("nebula")),
        ("cloud", example("cloud")),
        ("smoke", example("smoke")),
    ];
    let rays = f64::from(SIZE[0] * SIZE[1]);
    let mut rates: Vec<Vec<[f64; 6]>> = vec![vec![]; REGISTRY.len()];
    for (name, path) in scenes.iter().filter(|s| wanted.is_empty() || wanted.iter().any(|w| w == s.0)) {
        let plain = options(Backend::Raymarch);
        let Some(session) = open(path, plain.clone(), EngineChoice::Gpu) else {
            println!("skipped: no adapter");
            return;
        };
        let (weight, accuracy) = (field_weight(&session.program().optimised), session.accuracy());
        let Some(truth) = drawn(path, Options { accuracy: Some(accuracy / 30.0), ..plain }) else { return };
        println!("{name}: fields of weight {weight:.0}");
        for (entry, rates) in REGISTRY.iter().zip(&mut rates) {
            let rungs = ladder(path, entry.backend, &truth);
            for r in &rungs {
                println!(
                    "  {:9} {:7.1} pieces a ray: {:8.1} ms, largest error {:.2e}, RMS {:.2e} lx",
                    entry.word, r.pieces, r.milliseconds, r.largest, r.rms
                );
            }
            let time: Vec<(f64, f64)> = rungs.iter().map(|r| (r.pieces, 1e6 * r.milliseconds / rays)).collect();
            let error: Vec<(f64, f64)> = rungs.iter().map(|r| (r.pieces.ln(), r.largest.max(1e-12).ln())).collect();
            let ((ray, slope), (first, order)) = (line(&time), line(&error));
            println!(
                "  {:9} {ray:.0} ns a ray and {slope:.1} ns a piece; error {:.2} · n^{order:.2}",
                entry.word,
                first.exp()
            );
            let node = rungs.last().map_or(f64::NAN, |r| 1e6 * r.milliseconds / r.pieces.powi(3));
            rates.push([weight, ray, slope, first.exp(), -order, node]);
            let told = &session.program().forecasts;
            if let Some(Outcome::Drawn { pieces, milliseconds, error, .. }) =
                told.iter().find(|f| f.backend == entry.backend).map(|f| &f.outcome)
            {
                println!("  {:9} predicted: {pieces:.0} pieces, {milliseconds:.1} ms, error {error:.1e}", entry.word);
            }
        }
    }
    for (entry, rates) in REGISTRY.iter().zip(&rates) {
        let column = |i: usize| median(rates.iter().map(|r| r[i]).collect());
        let slopes: Vec<(f64, f64)> = rates.iter().map(|r| (r[0], r[2])).collect();
        let (piece, unit) = line(&slopes);
        let time = match entry.backend {
            Backend::Splatting => format!("{:.0} ns a node", column(5)),
            Backend::Auto | Backend::Raymarch | Backend::Slicing => {
                format!("ray {:.0} ns, piece {piece:.1} ns and {unit:.4} ns a unit of weight", column(1))
            }
        };
        println!("{:9} {time}, error {:.2} · n^-{:.2} (medians)", entry.word, column(3), column(4));
    }
}
