//! Bands: what is neutral stays one number, what is not has one per band.

use crate::build::*;
use crate::{close, here, metres, value};
use compiler::check::hir::*;
use compiler::ir::BandsKind;
use compiler::syntax::ast::BinaryOp;

fn coefficient() -> Type {
    Type::Spectrum(length(-1))
}

fn absorbing(k_a: Expr, kind: BandsKind, wavelengths: &[f64]) -> Vec<f64> {
    let mut scene = scene();
    scene.image.bands = kind;
    scene.image.wavelengths = wavelengths.to_vec();
    scene.media.push(Medium { k_a: Some(k_a), ..medium("haze") });
    let lowered = metres(&scene);
    value(&lowered, lowered.media[0].k_a, &here(0.0, 0.0, 0.0))
}

const RGB: [f64; 3] = [680e-9, 550e-9, 440e-9];

fn rgb(r: f64, g: f64, b: f64) -> Expr {
    call(Builtin::Rgb, vec![per_m(r), per_m(g), per_m(b)], coefficient())
}

#[test]
fn rgb_in_each_mode() {
    assert_eq!(absorbing(rgb(1.0, 2.0, 4.0), BandsKind::Rgb, &RGB), [1.0, 2.0, 4.0]);
    let grey = absorbing(rgb(1.0, 2.0, 4.0), BandsKind::Gray, &[550e-9]);
    assert!(close(&grey, &[0.2126 + 2.0 * 0.7152 + 4.0 * 0.0722], 1e-15));
    // A list of the same wavelengths is the same spectrum.
    assert!(close(&absorbing(rgb(1.0, 2.0, 4.0), BandsKind::List, &RGB), &[1.0, 2.0, 4.0], 1e-12));
    // So is any list of three, since it is displayed as red, green and blue.
    assert!(close(&absorbing(rgb(1.0, 2.0, 4.0), BandsKind::List, &[650e-9, 500e-9, 450e-9]), &[1.0, 2.0, 4.0], 1e-12));
    // In others the three spectra of the table mix.
    let list = absorbing(rgb(1.0, 2.0, 4.0), BandsKind::List, &[780e-9, 615e-9, 495e-9, 380e-9]);
    let mixed = [1.0, 0.9661 + 2.0 * 0.0339, 2.0 * 0.6112 + 4.0 * 0.3888, 0.0248 + 4.0 * 0.9752];
    assert!(close(&list, &mixed, 1e-9), "{list:?}");
    assert!(close(&absorbing(rgb(1.0, 2.0, 4.0), BandsKind::List, &[550e-9]), &[2.0], 1e-12));
    // A single band for all that is visible is grey.
    assert_eq!(absorbing(rgb(1.0, 2.0, 4.0), BandsKind::Spectral, &[580e-9]), grey);
}

#[test]
fn grey_is_one_number_in_every_mode() {
    for (kind, wavelengths) in
        [(BandsKind::Rgb, RGB.to_vec()), (BandsKind::Gray, vec![550e-9]), (BandsKind::List, vec![400e-9, 700e-9])]
    {
        assert_eq!(absorbing(rgb(3.0, 3.0, 3.0), kind, &wavelengths), [3.0]);
        assert_eq!(absorbing(per_m(3.0), kind, &wavelengths), [3.0]);
        let grey = op(BinaryOp::Multiply, color(0.5, 0.5, 0.5), per_m(4.0), coefficient());
        assert_eq!(absorbing(grey, kind, &wavelengths), [2.0]);
    }
}

#[test]
fn a_colour_times_a_number_is_a_spectrum() {
    let product = || op(BinaryOp::Multiply, per_m(2.0), color(0.5, 0.25, 1.0), coefficient());
    assert_eq!(absorbing(product(), BandsKind::Rgb, &RGB), [1.0, 0.5, 2.0]);
    let grey = absorbing(product(), BandsKind::Gray, &[550e-9]);
    assert!(close(&grey, &[2.0 * (0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722)], 1e-15));
    let list = absorbing(product(), BandsKind::List, &[615e-9, 550e-9]);
    assert!(close(&list, &[2.0 * (0.9661 * 0.5 + 0.0339 * 0.25), 0.5], 1e-9), "{list:?}");
}

#[test]
fn wavelength() {
    // k = (680 nm / lambda)^4 / m
    let ratio = op(BinaryOp::Divide, m(680e-9), input(Input::Lambda), Type::Spectrum(Dim::default()));
    let law = op(BinaryOp::Power, ratio, n(4.0), Type::Spectrum(Dim::default()));
    let k = || op(BinaryOp::Multiply, law.clone(), per_m(1.0), coefficient());
    let expected = RGB.map(|w| (680e-9 / w).powi(4));
    assert!(close(&absorbing(k(), BandsKind::Rgb, &RGB), &expected, 1e-14));
    assert!(close(&absorbing(k(), BandsKind::Gray, &[550e-9]), &expected[1..2], 1e-14));
}

/// More bands than a value of the graph holds are lowered in groups, each with its own wavelengths and colours.
#[test]
fn groups_of_bands() {
    let bands = compiler::ir::Bands::spectral(8);
    let mut scene = scene();
    (scene.image.bands, scene.image.wavelengths) = (bands.kind, bands.wavelengths.clone());
    let law = op(BinaryOp::Divide, input(Input::Lambda), m(550e-9), Type::Spectrum(Dim::default()));
    let k_a = op(BinaryOp::Multiply, law, rgb(1.0, 2.0, 4.0), coefficient());
    scene.media.push(Medium { k_a: Some(k_a), ..medium("haze") });
    let mut found = vec![];
    for group in bands.groups() {
        let mut diagnostics = compiler::diagnostic::Diagnostics::default();
        let lowered = compiler::lower::lower_group(&scene, compiler::ir::Units::METRE, group.clone(), &mut diagnostics);
        let lowered = lowered.expect("a field scene");
        assert_eq!(lowered.bands.wavelengths, bands.wavelengths[group]);
        found.extend(value(&lowered, lowered.media[0].k_a, &here(0.0, 0.0, 0.0)));
    }
    let expected: Vec<f64> = bands
        .wavelengths
        .iter()
        .zip(bands.resample())
        .map(|(w, [r, g, b])| w / 550e-9 * (r + 2.0 * g + 4.0 * b))
        .collect();
    assert!(close(&found, &expected, 1e-12), "{found:?}");
}

/// Functions of the prelude work band by band, with colours converted first.
#[test]
fn mixing_spectra() {
    let a = rgb(1.0, 2.0, 3.0);
    let b = op(BinaryOp::Multiply, color(1.0, 0.0, 0.5), per_m(10.0), coefficient());
    let mixed = call(Builtin::Mix, vec![a, b, n(0.5)], coefficient());
    assert_eq!(absorbing(mixed, BandsKind::Rgb, &RGB), [5.5, 1.0, 4.0]);
    let least = call(Builtin::Min, vec![rgb(1.0, 2.0, 3.0), per_m(1.5)], coefficient());
    assert_eq!(absorbing(least, BandsKind::Rgb, &RGB), [1.0, 1.5, 1.5]);
    let choice =
        expr(ExprKind::If(Box::new(truth(false)), Box::new(per_m(9.0)), Box::new(rgb(1.0, 2.0, 3.0))), coefficient());
    assert_eq!(absorbing(choice, BandsKind::Rgb, &RGB), [1.0, 2.0, 3.0]);
}
