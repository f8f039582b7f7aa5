//! What bounds of media are worth: evaluations and times against plain marching (a fixed number of steps, nothing skipped) at
//! equal RMS error, each as a ratio within one run; with every pixel drawn, and with some filled in from others. Errors are against the same engine at a twentieth of the accuracy, or with
//! thousands of steps.
//!
//! `cargo bench --bench bounds` prints a table; evaluations do not depend on the machine.

use compiler::Options;
use compiler::ir::{Aa, Pixels};
use compiler::program::OutputKind;
use runtime::frame::{Drawing, EngineChoice, Session};
use std::io::Write;
use std::path::{Path, PathBuf};
use tyndall_tests::{draw, open, rms, root};

/// Head-like: a shell of bone around tissue with cavities, and noise of a few counts, from a small generator.
fn scan(folder: &Path) -> PathBuf {
    const N: usize = 256;
    let mut state = 1u32;
    let mut voxels = Vec::with_capacity(N * N * N);
    for k in 0..N {
        for j in 0..N {
            for i in 0..N {
                let [x, y, z] = [i, j, k].map(|n| (n as f32 + 0.5) / N as f32 * 2.0 - 1.0);
                let r = ((x / 0.72).powi(2) + (y / 0.85).powi(2) + (z / 0.8).powi(2)).sqrt();
                let folds = 0.03 * ((14.0 * x).sin() * (13.0 * y).sin() + (15.0 * z).sin() * (12.0 * x).cos());
                let cavity = (x.powi(2) + (y + 0.5).powi(2) + (z + 0.3).powi(2)).sqrt() < 0.18;
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise = (state >> 24) as f32 / 255.0 * 8.0 - 4.0;
                let smooth = |edge: f32, width: f32, r: f32| 1.0 / (1.0 + ((r - edge) / width).exp());
                let skin = 70.0 * smooth(1.0, 0.006, r);
                let bone = 120.0 * (smooth(0.93, 0.006, r) - smooth(0.84, 0.006, r));
                let brain = 30.0 * smooth(0.78 + folds, 0.01, r);
                let v = if cavity { 10.0 } else { skin + bone + brain } + if r < 1.05 { noise } else { 0.0 };
                voxels.push(v.clamp(0.0, 255.0) as u8);
            }
        }
    }
    let path = folder.join("scan.nrrd");
    let mut file = std::fs::File::create(&path).expect("the folder is writable");
    let header = format!(
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {N} {N} {N}\nencoding: raw\n\
         space: right-anterior-superior\nspace units: \"mm\" \"mm\" \"mm\"\n\
         space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n\n"
    );
    file.write_all(header.as_bytes()).expect("written");
    file.write_all(&voxels).expect("written");
    path
}

struct Trial {
    name: &'static str,
    path: PathBuf,
    size: [u32; 2],
    truth: Truth,
}

/// What errors are measured against.
#[derive(Copy, Clone)]
enum Truth {
    /// A twentieth of the accuracy.
    Accuracy,
    /// So many steps along each ray.
    Steps(u32),
}

fn session(trial: &Trial, steps: Option<u32>, accuracy: Option<f64>, pixels: Pixels) -> Option<Session> {
    let pixels = Some(pixels);
    let mut options =
        Options { size: Some(trial.size), aa: Some(Aa::None), steps, accuracy, pixels, ..Options::default() };
    options.outputs.push(OutputKind::Evaluations);
    open(&trial.path, options, EngineChoice::Gpu)
}

/// RMS error, evaluations and milliseconds.
type Cost = (f64, f64, f64);

/// The best of three, so that what else the machine does counts less.
fn cost(trial: &Trial, session: &mut Session, exact: &Drawing) -> Cost {
    let mut drawings: Vec<Drawing> = (0..3).map(|_| draw(&trial.path, session)).collect();
    drawings.sort_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
    let best = drawings.swap_remove(0);
    (rms(&best, exact), best.evaluations.unwrap_or(0) as f64, best.milliseconds)
}

/// What plain marching needs to be as good: between two of its numbers of steps, cost is interpolated by logarithms.
fn equal(plain: &[Cost], error: f64) -> Option<(f64, f64)> {
    // As good as it, but for what rounding makes of both.
    let at = plain.iter().position(|p| p.0 <= 1.05 * error)?;
    let now = plain[at];
    let Some(before) = at.checked_sub(1).map(|i| plain[i]) else { return Some((now.1, now.2)) };
    let share = if now.0 < error { (before.0 / error).ln() / (before.0 / now.0).ln() } else { 1.0 };
    let between = |a: f64, b: f64| (a.ln() + share * (b.ln() - a.ln())).exp();
    Some((between(before.1, now.1), between(before.2, now.2)))
}

fn measure(trial: &Trial) -> Option<()> {
    let mut own = session(trial, None, None, Pixels::Every)?;
    let accuracy = own.accuracy();
    // Where the least number of steps decides what is drawn, a finer accuracy draws the same.
    let mut exact = match trial.truth {
        Truth::Accuracy => session(trial, None, Some(accuracy / 20.0), Pixels::Every)?,
        Truth::Steps(n) => session(trial, Some(n), None, Pixels::Every)?,
    };
    let exact = draw(&trial.path, &mut exact);
    // At the scene's own accuracy and at one that is good enough to look at.
    let mut ways = vec![("every pixel", cost(trial, &mut own, &exact))];
    for (name, loose, pixels) in [
        ("pixels filled in", 1.0, Pixels::Adaptive),
        ("every pixel, four times the accuracy", 4.0, Pixels::Every),
        ("pixels filled in, four times the accuracy", 4.0, Pixels::Adaptive),
    ] {
        let mut session = session(trial, None, Some(loose * accuracy), pixels)?;
        if pixels == Pixels::Every || session.program().plan.survey.is_some() {
            ways.push((name, cost(trial, &mut session, &exact)));
        }
    }
    let finest = ways.iter().map(|w| w.1.0).fold(f64::INFINITY, f64::min);
    let mut plain = vec![];
    let mut steps = 32;
    while steps <= 8192 && plain.last().is_none_or(|p: &Cost| p.0 > 1.05 * finest) {
        let now = cost(trial, &mut session(trial, Some(steps), None, Pixels::Every)?, &exact);
        println!("{:8} {steps:5} steps: RMS {:.2e}, {:.3e} evaluations, {:.0} ms", trial.name, now.0, now.1, now.2);
        plain.push(now);
        steps *= 2;
    }
    for (name, (error, evaluations, milliseconds)) in ways {
        println!("{:8} {name}: RMS {error:.2e}, {evaluations:.3e} evaluations, {milliseconds:.0} ms", trial.name);
        let (more, (e, t)) = match equal(&plain, error) {
            Some(needed) => ("", needed),
            None => ("more than ", plain.last().map_or((f64::NAN, f64::NAN), |p| (p.1, p.2))),
        };
        println!(
            "{:8}   plain marching needs {more}{:.1} times the evaluations and {more}{:.2} times the time",
            "",
            e / evaluations,
            t / milliseconds
        );
    }
    Some(())
}

fn main() {
    // `cargo test --benches` runs this too, and wants nothing of it.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let folder = root().join("target").join("benchmark-scenes");
    std::fs::create_dir_all(&folder).expect("the folder can be made");
    let own = root().join("tests/benches/scenes");
    std::fs::copy(own.join("scan.vol"), folder.join("scan.vol")).expect("copied");
    let example = |name: &str| root().join("examples").join(name).with_extension("vol");
    let trials = [
        Trial { name: "sparse", path: own.join("sparse.vol"), size: [256, 256], truth: Truth::Accuracy },
        Trial { name: "dense", path: own.join("dense.vol"), size: [256, 256], truth: Truth::Steps(8192) },
        Trial { name: "scan", path: folder.join("scan.vol"), size: [512, 512], truth: Truth::Accuracy },
        Trial { name: "brain", path: example("brain"), size: [512, 512], truth: Truth::Accuracy },
        Trial { name: "nebula", path: example("nebula"), size: [512, 512], truth: Truth::Accuracy },
        Trial { name: "cloud", path: example("cloud"), size: [512, 512], truth: Truth::Accuracy },
    ];
    for trial in trials.iter().filter(|t| wanted.is_empty() || wanted.iter().any(|w| w == t.name)) {
        if trial.name == "scan" {
            scan(&folder);
        }
        if measure(trial).is_none() {
            println!("{:8} skipped: no adapter", trial.name);
        }
    }
}
