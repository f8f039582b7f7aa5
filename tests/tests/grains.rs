//! Noise that is cut off, so that it is here and there: steps are long where nothing is, and miss nothing that counts.

use compiler::Options;
use compiler::ir::Aa;
use compiler::program::OutputKind;
use runtime::frame::{Drawing, EngineChoice};
use tyndall_tests::{draw, every_scene, name, open};

const SIZE: u32 = 64;

/// Evaluations a pixel that each scene may cost: measured, and a quarter more.
fn most(name: &str) -> f64 {
    match name {
        "rare_puffs" => 135.0,
        "billows" => 23.0,
        "strands" => 57.0,
        "cells" => 58.0,
        other => panic!("{other} is new: measure it"),
    }
}

#[test]
fn long_steps_through_nothing_miss_nothing() {
    every_scene("tests/suite/grains", |path| {
        let mut options = Options { size: Some([SIZE, SIZE]), aa: Some(Aa::None), ..Options::default() };
        options.outputs.push(OutputKind::Evaluations);
        let plain = Options { steps: Some(3000), ..options.clone() };
        let mut wrong = vec![];
        let truth = draw(path, &mut open(path, plain, EngineChoice::Gpu)?);
        for accuracy in [0.3, 2e-2, 2e-3] {
            let own = Options { accuracy: Some(accuracy), ..options.clone() };
            let drawing = draw(path, &mut open(path, own, EngineChoice::Gpu)?);
            let off = differences(&drawing, &truth);
            let evaluations = drawing.evaluations.expect("asked for") as f64 / f64::from(SIZE * SIZE);
            let beyond = off.iter().filter(|off| **off > accuracy).count();
            let rms = (off.iter().map(|off| off * off).sum::<f64>() / off.len() as f64).sqrt();
            println!("{} {accuracy}: {beyond} beyond, RMS {rms:.1e}, {evaluations:.1} evaluations a pixel", name(path));
            // What lies between samples is an estimate: of four thousand pixels, two may meet the tip of something unseen.
            if beyond > 2 || rms > 0.1 * accuracy {
                wrong.push(format!("{accuracy}: {beyond} pixels are wrong by more, RMS {rms}"));
            }
            if accuracy == 2e-2 && evaluations > most(name(path)) {
                wrong.push(format!("{evaluations} evaluations a pixel"));
            }
        }
        Some(wrong)
    });
}

/// How far each pixel is off, in lx.
fn differences(drawing: &Drawing, truth: &Drawing) -> Vec<f64> {
    let bands = truth.picture.radiance().len() / (SIZE * SIZE) as usize;
    let pixels = drawing.picture.radiance().chunks_exact(bands).zip(truth.picture.radiance().chunks_exact(bands));
    pixels.map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)).collect()
}
