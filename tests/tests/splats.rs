//! Files of splats as scenes name them, and the example.

use compiler::Options;
use runtime::data::Memory;
use runtime::data::splats::read_splats_from;
use runtime::frame::{EngineChoice, FileLoader, Session, Settings};
use std::path::Path;
use tyndall_tests::{bonsai, draw, open, root, text};

/// The file beside the examples is what its generator makes, to a step of each number.
#[test]
fn the_bonsai_is_what_its_generator_makes() {
    let path = root().join("examples/data/bonsai.spz");
    let kept = std::fs::read(&path).expect("the file is there");
    assert!(kept.len() < 300 << 10, "{} bytes", kept.len());
    let read = |bytes: Vec<u8>| read_splats_from(&Memory::one("a.spz", bytes), Path::new("a.spz")).expect("reads").0;
    let (kept, made) = (read(kept), read(bonsai::file()));
    assert_eq!(kept.header().count, made.header().count);
    let off = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0_f32, f32::max);
    for i in 0..kept.len() {
        assert!(off(&kept.centers()[i], &made.centers()[i]) <= 2e-5, "splat {i}");
        assert!(off(kept.harmonics(i), made.harmonics(i)) <= 0.13, "splat {i}");
    }
    // What the generator wanted is what the reader gives.
    for (i, wanted) in bonsai::splats().iter().enumerate() {
        let center = wanted.center.map(|x| x as f32);
        assert!(off(&made.centers()[i], &center) <= 1e-5, "splat {i}");
        let turn: f64 = (0..4).map(|k| f64::from(made.rotations()[i][k]) * wanted.rotation[k]).sum();
        assert!(turn.abs() > 0.9999, "splat {i}: {turn}");
        for k in 0..3 {
            let ratio = f64::from(made.deviations()[i][k]) / wanted.deviations[k];
            assert!((ratio.ln()).abs() <= 0.04, "splat {i}: {ratio}");
        }
    }
}

/// Whoever does not choose an engine sees the splats; whoever chooses the GPU is told that it cannot draw them.
#[test]
fn splats_are_drawn_where_they_can_be() {
    let path = root().join("examples/splats/bonsai.vol");
    let options = || Options { size: Some([16, 16]), ..Options::default() };
    let mut session = open(&path, options(), EngineChoice::Auto).expect("the processor is always there");
    assert_eq!(session.engine(), "cpu");
    assert!(session.fallback().expect("a reason").contains("splats"));
    assert_eq!(session.warnings().iter().count(), 0);
    let drawing = draw(&path, &mut session);
    // The tree is darker than the mist around it.
    let brightness = |x: u32, y: u32| drawing.picture.pixel(x, y).iter().sum::<f32>();
    assert!(brightness(8, 4) < 0.7 * brightness(1, 1), "{} {}", brightness(8, 4), brightness(1, 1));
    // What is refused, and why, does not depend on the machine.
    let settings = Settings { options: options(), engine: EngineChoice::Gpu, ..Settings::default() };
    let loader = FileLoader::new(path.parent().expect("a folder"));
    let trouble = Session::open("bonsai.vol", &text(&path), &loader, settings).map(|_| ()).expect_err("is refused");
    assert_eq!(trouble.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>(), ["E0909"]);
}
