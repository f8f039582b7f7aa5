//! Pictures of any number of bands: colours and white as they are displayed, and what a scene without colours is spared.

use compiler::Options;
use compiler::loader::NoFiles;
use runtime::frame::{EngineChoice, FileLoader, Params, Session, Settings};
use runtime::image::{Display, srgb_decode};
use tyndall_tests::root;

/// Every way to ask for bands that can tell colours apart.
const MODES: [&str; 11] = [
    "rgb",
    "[680 nm, 550 nm, 440 nm]",
    "[650 nm, 540 nm, 450 nm]",
    "spectral(3)",
    "spectral(4)",
    "spectral(5)",
    "spectral(8)",
    "spectral(16)",
    "spectral(31)",
    "spectral(64)",
    "[450 nm, 610 nm, 490 nm, 650 nm, 550 nm, 580 nm]",
];
/// Those that show what they have as a shade of grey, or in part.
const FEW: [&str; 5] = ["gray", "[550 nm]", "spectral(1)", "spectral(2)", "[1000 nm, 2000 nm, 3000 nm, 4000 nm]"];

/// Saturated and pale, dark and light, and white.
const COLORS: [[f64; 3]; 12] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 1.0],
    [1.0, 0.0, 1.0],
    [0.9, 0.75, 0.6],
    [0.7, 0.8, 0.9],
    [0.02, 0.05, 0.03],
    [0.3, 0.1, 0.02],
    [0.5, 0.5, 0.52],
    [1.0, 1.0, 1.0],
];

/// What a screen shows in the middle of a picture of one pixel, sRGB-encoded.
fn shown(scene: &str, bands: &str) -> [f64; 3] {
    let text = format!("{scene}\nimage {{ size = 1 x 1  aa = none  bands = {bands} }}\n");
    let settings = Settings { options: Options::default(), engine: EngineChoice::Cpu, ..Settings::default() };
    let mut session = Session::open("scene.vol", &text, &FileLoader::new(root()), settings)
        .unwrap_or_else(|t| panic!("{}", compiler::diagnostic::render(&t.diagnostics, &t.sources)));
    let params = Params::defaults(&session.program().lowered);
    let drawing = session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
    drawing.picture.shown(&Display::default()).pixels[0].map(f64::from)
}

/// CIELab (CIE 15:2018) of an sRGB-encoded colour, by the matrix and white of IEC 61966-2-1.
fn lab(rgb: [f64; 3]) -> [f64; 3] {
    const XYZ: [[f64; 3]; 3] = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
    let linear = rgb.map(srgb_decode);
    let f = |row: [f64; 3]| {
        let white: f64 = row.iter().sum();
        let t = row.iter().zip(linear).map(|(a, b)| a * b).sum::<f64>() / white;
        if t > (6.0f64 / 29.0).powi(3) { t.cbrt() } else { t * (29.0f64 / 6.0).powi(2) / 3.0 + 4.0 / 29.0 }
    };
    let [x, y, z] = XYZ.map(f);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIE 1976 ΔE*ab, which tells saturated colours apart more strictly than later formulas.
fn delta_e(a: [f64; 3], b: [f64; 3]) -> f64 {
    let (a, b) = (lab(a), lab(b));
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn the_difference_of_colours_is_the_formula_s() {
    // The primaries of sRGB in CIELab, as published with the standard.
    for (rgb, expected) in [
        ([1.0, 0.0, 0.0], [53.24, 80.09, 67.20]),
        ([0.0, 0.0, 1.0], [32.30, 79.19, -107.86]),
        ([1.0, 1.0, 1.0], [100.0, 0.0, 0.0]),
    ] {
        let found = lab(rgb);
        assert!((0..3).all(|i| (found[i] - expected[i]).abs() < 0.05), "{rgb:?}: {found:?}");
    }
}

/// A colour stays within ΔE of 1 (in fact of 0.01) in every mode: as a source behind matter that is not there, and as an albedo.
fn looks_alike(what: &str, scene: impl Fn([f64; 3]) -> String) {
    let (mut wrong, mut worst) = (vec![], 0.0f64);
    for color in COLORS {
        let known = shown(&scene(color), "rgb");
        for bands in MODES {
            let found = shown(&scene(color), bands);
            let off = delta_e(known, found);
            worst = worst.max(off);
            if off >= 1.0 {
                wrong.push(format!("{what} {color:?} in {bands}: {found:?}, not {known:?}, ΔE {off:.2}"));
            }
        }
    }
    println!("{what}: largest ΔE*ab {worst:.2e}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn emission_looks_the_same_in_every_mode() {
    looks_alike("emission", |[r, g, b]| {
        format!(
            "medium glow {{ shape = box(min: (-1, -1, -1) m, max: (1, 1, 1) m)  k_e = rgb({r}, {g}, {b}) * lx / 2 m }}
             camera {{ from = (0, 0, -3) m  to = (0, 0, 0) m  projection = orthographic(height: 0.1 m) }}"
        )
    });
}

#[test]
fn albedos_look_the_same_in_every_mode() {
    looks_alike("albedo", |[r, g, b]| {
        format!(
            "surface wall {{ shape = plane(point: (0, 0, 0) m, normal: (0, 0, -1))  albedo = rgb({r}, {g}, {b}) }}
             light sun {{ direction = (0, 0, 1)  irradiance = 3.14159265358979 lx }}
             camera {{ from = (0, 0, -3) m  to = (0, 0, 0) m  projection = orthographic(height: 0.1 m) }}"
        )
    });
}

#[test]
fn white_is_white_in_every_mode() {
    let scenes = [
        // A light seen directly, one that matter scatters, and one that a grey wall reflects.
        "light sky { environment = 0.6 lx }\ncamera { from = (0, 0, -3) m  to = (0, 0, 0) m }",
        "medium mist { shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_s = 0.5 /m }
         light sun { direction = (1, -1, 0)  irradiance = 5 lx }
         camera { from = (0, 0, -3) m  to = (0, 0, 0) m  projection = orthographic(height: 0.1 m) }",
        "surface wall { shape = plane(point: (0, 0, 0) m, normal: (0, 0, -1))  albedo = 0.5 }
         light sun { direction = (0, 0, 1)  irradiance = 2 lx }
         camera { from = (0, 0, -3) m  to = (0, 0, 0) m }",
    ];
    for scene in scenes {
        let known = shown(scene, "rgb");
        assert!(known[0] > 0.1 && known[0] < 0.99, "{known:?} tells nothing");
        for bands in MODES.into_iter().chain(FEW) {
            let found = shown(scene, bands);
            // Rounding of f32 in the picture.
            assert!((0..3).all(|c| (found[c] - known[0]).abs() < 1e-5), "{bands}: {found:?}, not {known:?}");
        }
    }
}

/// Programs of a scene, and its ledger as lines.
fn compiled(scene: &str) -> (usize, Vec<String>) {
    let out = compiler::compile("scene.vol", scene, &NoFiles, &Options::default());
    let program = out.program.unwrap_or_else(|| panic!("{:?}", out.diagnostics));
    assert_eq!(program.bands.wavelengths.len(), program.places.len());
    assert!(program.further.iter().all(|part| part.ledger.0.is_empty()), "the ledger is told once");
    let lines = program.ledger.0.iter().map(|o| format!("{}: {}", o.feature, o.reason)).collect();
    (program.parts().count(), lines)
}

const BALL: &str = "medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_e = 1 lx/m  k_a = 1 /m";

#[test]
fn what_does_not_depend_on_the_wavelength_is_one_program() {
    let (programs, ledger) = compiled(&format!("{BALL} }}\nimage {{ bands = spectral(16) }}"));
    assert_eq!(programs, 1);
    assert!(ledger.iter().any(|l| l.starts_with("programs of further bands")), "{ledger:?}");
    for (bands, count) in
        [("rgb", 1), ("spectral(4)", 1), ("spectral(5)", 2), ("spectral(16)", 4), ("spectral(64)", 16)]
    {
        let (programs, ledger) = compiled(&format!("{BALL} * (550 nm / lambda) }}\nimage {{ bands = {bands} }}"));
        assert_eq!(programs, count, "{bands}");
        let mut unique = ledger.clone();
        unique.sort();
        unique.dedup();
        assert_eq!(unique.len(), ledger.len(), "{bands}: {ledger:?}");
    }
}

/// Where only some bands do without a feature, the ledger says which.
#[test]
fn the_ledger_names_the_bands() {
    let scene = "medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_e = 1 lx/m
                 k_a = 1 /m * (1 + 0.5 * step(600 nm, lambda) * sin(p.x / 0.1 m)) }\nimage { bands = spectral(8) }";
    let (programs, ledger) = compiled(scene);
    assert_eq!(programs, 2);
    let steps: Vec<&String> = ledger.iter().filter(|l| l.starts_with("loop over steps")).collect();
    let [line] = steps[..] else { panic!("{ledger:?}") };
    assert!(line.ends_with("(at 405 nm, 455 nm, 505 nm, 555 nm)"), "{line}");
}

/// What is found in every group of bands is said once.
#[test]
fn findings_are_not_repeated() {
    let scene = format!(
        "fn lobe(cos_theta: number, lambda: length) -> number = lambda / 550 nm
         {BALL}  k_s = 1 /m  phase = lobe }}
         light sun {{ direction = (0, -1, 0)  irradiance = 1 lx }}
         image {{ bands = spectral(16) }}"
    );
    let out = compiler::compile("scene.vol", &scene, &NoFiles, &Options::default());
    let codes: Vec<&str> = out.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(codes, ["N0518"], "{}", compiler::diagnostic::render(&out.diagnostics, &out.sources));
}
