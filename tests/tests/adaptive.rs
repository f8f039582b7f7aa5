//! Pictures of which some pixels are filled in: what they say they may be wrong by is what they are.

use compiler::Options;
use compiler::ir::{Aa, Pixels};
use compiler::program::OutputKind;
use runtime::frame::{Drawing, EngineChoice};
use std::path::Path;
use tyndall_tests::{codes_of, draw, every_scene, name, open, open_text};

const SIZE: [u32; 2] = [160, 144];

fn options(pixels: Pixels) -> Options {
    let mut options = Options { size: Some(SIZE), aa: Some(Aa::None), pixels: Some(pixels), ..Options::default() };
    options.outputs.push(OutputKind::Evaluations);
    options
}

/// Where the filled picture is farther from the one with every pixel than both say they may be wrong.
fn beyond(filled: &Drawing, every: &Drawing) -> Vec<String> {
    let bands = every.picture.radiance().len() / every.errors.len();
    let pixels = filled.picture.radiance().chunks_exact(bands).zip(every.picture.radiance().chunks_exact(bands));
    let mut out = vec![];
    for (i, (a, b)) in pixels.enumerate() {
        let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let said = filled.errors[i] + every.errors[i];
        if !(off <= said) {
            let [x, y] = [i as u32 % SIZE[0], i as u32 / SIZE[0]];
            out.push(format!("({x}, {y}): {off} off, {said} said, {:?}", filled.errors[i]));
        }
    }
    out
}

/// Every example and every scene with features of its own: outlines, surfaces, suns, noise, grids.
#[test]
fn what_is_filled_in_is_as_good_as_it_says() {
    for folder in ["examples", "tests/suite/agree"] {
        every_scene(folder, |path| {
            // These take seconds.
            if ["smoke", "brain_shaded"].contains(&name(path)) {
                return Some(vec![]);
            }
            let mut session = open(path, options(Pixels::Adaptive), EngineChoice::Gpu)?;
            if session.program().plan.survey.is_none() {
                return Some(vec![]);
            }
            let filled = draw(path, &mut session);
            let every = draw(path, &mut open(path, options(Pixels::Every), EngineChoice::Gpu)?);
            let (drawn, all) = (filled.drawn.expect("it is counted"), u64::from(SIZE[0] * SIZE[1]));
            let beyond = beyond(&filled, &every);
            println!("{}: {drawn} of {all} drawn, {} beyond", path.display(), beyond.len());
            let mut wrong = vec![];
            // Of estimates that are checked on one pixel in sixteen a few may be too small, on pixels that are like no other.
            if beyond.len() as u64 * 10_000 > all {
                wrong.push(format!(
                    "{} pixels are farther off than they say: {:?}",
                    beyond.len(),
                    &beyond[..beyond.len().min(5)]
                ));
            }
            let share = filled.predicted.expect("an error").1;
            if share > 1.0 && share > every.predicted.expect("an error").1 {
                wrong.push(format!("filling in takes more than accuracy allows: {share}"));
            }
            Some(wrong)
        });
    }
}

const EYE: &str = "camera { from = (0, 0.5, -4) m  to = (0, 0, 0) m  fov = 40 deg }";
const WAVES: &str = "medium waves { shape = box(min: (-2, -2, -1) m, max: (2, 2, 1) m)
    density = 1 + 0.4 * sin(2 * p.x / 1 m + p.y / 1 m + 0.7 * p.z / 1 m)  k_a = 0.3 /m  k_e = 1 lx / m }";

/// Dots and a rod that are hardly wider than a pixel, between the pixels that are drawn first: none is overlooked.
#[test]
fn what_is_thinner_than_a_pixel_is_not_filled_over() {
    let mut dots = String::new();
    for i in 0..12 {
        let (x, y) = (-1.1 + 0.193 * f64::from(i), -0.8 + 0.137 * f64::from(i));
        dots += &format!(
            "medium dot{i} {{ shape = sphere(center: ({x}, {y}, -1.2) m, radius: 1.2 cm)  k_e = 90 lx / m }}\n"
        );
    }
    dots += "medium rod { shape = cylinder(from: (-1.2, 0.6, -1.2) m, to: (1.2, 0.61, -1.2) m, radius: 8 mm)  k_e = 90 lx / m }\n";
    let text = format!("{WAVES}\n{dots}\n{EYE}\nrender {{ accuracy = 2e-2 }}");
    let Some(mut session) = open_text(&text, options(Pixels::Adaptive)) else { return };
    let filled = draw(Path::new("dots.vol"), &mut session);
    let mut whole = open_text(&text, options(Pixels::Every)).expect("there is an adapter");
    let every = draw(Path::new("dots.vol"), &mut whole);
    assert!(filled.drawn.expect("counted") < 3 * u64::from(SIZE[0] * SIZE[1]) / 4, "{:?}", filled.drawn);
    assert_eq!(beyond(&filled, &every), Vec::<String>::new());
    // Where there is none, fewer are drawn, and fields are evaluated less often.
    let plain = format!("{WAVES}\n{EYE}\nrender {{ accuracy = 2e-2 }}");
    let filled = draw(Path::new("waves.vol"), &mut open_text(&plain, options(Pixels::Adaptive)).expect("an adapter"));
    let every = draw(Path::new("waves.vol"), &mut open_text(&plain, options(Pixels::Every)).expect("an adapter"));
    let evaluations = |d: &Drawing| d.evaluations.expect("counted") as f64;
    assert!(evaluations(&filled) < 0.6 * evaluations(&every), "{:?} of {:?}", filled.evaluations, every.evaluations);
    assert_eq!(every.drawn, None);
}

/// Where pixels are not filled in, the ledger says why.
#[test]
fn why_no_pixel_is_filled_in_is_told() {
    let reason = |text: &str| {
        let compiled = compiler::compile("scene.vol", text, &compiler::loader::NoFiles, &Options::default());
        let program = compiled.program.unwrap_or_else(|| panic!("{:?}", compiled.diagnostics));
        let line = program.ledger.0.iter().find(|l| l.feature == "pixels that are filled in").map(|l| l.reason.clone());
        assert_eq!(line.is_none(), program.plan.survey.is_some(), "{text}");
        // Whoever asked for it is told without asking.
        let remarked = compiled.diagnostics.iter().any(|d| d.code == "N0532");
        assert_eq!(remarked, line.is_some() && text.contains("adaptive"), "{text}");
        line
    };
    let of = |render: &str, image: &str| reason(&format!("{WAVES}\n{EYE}\nrender {{ {render} }}\nimage {{ {image} }}"));
    assert_eq!(of("pixels = adaptive", "aa = none"), None);
    assert_eq!(of("pixels = adaptive", ""), None);
    let told = [
        of("", ""),
        of("pixels = every", ""),
        of("pixels = adaptive  steps = 9", ""),
        of("pixels = adaptive", "aa = ssaa(4)"),
        reason(&format!(
            "medium even {{ shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_a = 1 /m }}\n{EYE}\nrender {{ pixels = adaptive }}"
        )),
        reason(&format!(
            "medium dent {{ shape = sdf(length(p) - 1 m + 0.1 m * sin(p.x / 0.2 m))  density = 1 + p.x / 3 m  k_a = 1 /m }}\n{EYE}\nrender {{ pixels = adaptive }}"
        )),
    ];
    insta::assert_debug_snapshot!(told);
    assert_eq!(codes_of("render { pixels = some }", &Options::default()), ["E0406"]);
}
