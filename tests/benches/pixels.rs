//! What it is worth to draw some pixels and fill the others in: time, evaluations and RMS error of both ways, in one run. Errors are against
//! every pixel at a twentieth of the accuracy.
//!
//! `cargo bench --bench pixels` prints a table; evaluations do not depend on the machine.

use compiler::Options;
use compiler::ir::{Aa, Pixels};
use compiler::program::OutputKind;
use runtime::frame::{Drawing, EngineChoice};
use tyndall_tests::{draw, open, rms, root};

const SIZE: [u32; 2] = [1024, 768];

/// The faster of two drawings.
fn drawn(name: &str, pixels: Pixels, finer: f64) -> Option<Drawing> {
    let path = root().join("examples").join(name).with_extension("vol");
    let mut options = Options { size: Some(SIZE), aa: Some(Aa::None), pixels: Some(pixels), ..Options::default() };
    options.outputs.push(OutputKind::Evaluations);
    let own = open(&path, options.clone(), EngineChoice::Gpu)?.accuracy();
    let mut session = open(&path, Options { accuracy: Some(own / finer), ..options }, EngineChoice::Gpu)?;
    let drawings = [draw(&path, &mut session), draw(&path, &mut session)];
    drawings.into_iter().min_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds))
}

fn main() {
    // `cargo test --benches` runs this too, and wants nothing of it.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    println!("{} x {}: milliseconds, million evaluations, RMS error", SIZE[0], SIZE[1]);
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    for name in ["haze", "god_rays", "street_lamps", "fogbow", "cloud", "nebula"] {
        if !wanted.is_empty() && !wanted.iter().any(|w| w == name) {
            continue;
        }
        let Some(every) = drawn(name, Pixels::Every, 1.0) else {
            println!("{name}: skipped: no adapter");
            continue;
        };
        let (Some(filled), Some(truth)) = (drawn(name, Pixels::Adaptive, 1.0), drawn(name, Pixels::Every, 20.0)) else {
            continue;
        };
        let tell = |d: &Drawing| {
            let evaluations = d.evaluations.unwrap_or(0) as f64 / 1e6;
            format!("{:5.0} {evaluations:6.1} {:.1e}", d.milliseconds, rms(d, &truth))
        };
        let share = filled.drawn.map_or(1.0, |n| n as f64 / f64::from(SIZE[0] * SIZE[1]));
        println!(
            "{name:12} every {}   filled in {}   {:.0} % drawn, {:.2} of the time",
            tell(&every),
            tell(&filled),
            100.0 * share,
            filled.milliseconds / every.milliseconds
        );
    }
}
