//! Comparing a picture that is known with a truth that is known.

use super::compare::compare;
use super::truth::Truth;
use crate::frame::{Drawing, Params};
use crate::image::Picture;
use compiler::diagnostic::Diagnostics;
use compiler::ir::{Bands, BandsKind};

fn bands() -> Bands {
    Bands { kind: BandsKind::Gray, wavelengths: vec![550e-9] }
}

/// Four pixels in a row with so much radiance, and what the engine says of each.
fn drawing(radiance: [f32; 4], said: [f32; 4], kind: &'static str) -> Drawing {
    Drawing {
        picture: Picture::new([4, 1], bands(), radiance.to_vec(), None).expect("a picture"),
        edges: vec![],
        predicted: Some((f64::from(said.into_iter().fold(0.0, f32::max)), 0.0)),
        origins: None,
        errors: said.to_vec(),
        error_kind: kind,
        paths: None,
        drawn: None,
        slabs: None,
        splats: None,
        evaluations: None,
        milliseconds: 1.0,
        arranging: crate::engine::gpu::Arranging::default(),
        clock: "wall",
        dispatches: 0,
        faults: Diagnostics::default(),
        params: Params::default(),
        time: 0.0,
    }
}

fn truth(radiance: [f64; 4]) -> Truth {
    Truth::known([4, 1], bands(), radiance.to_vec(), 0.01)
}

#[test]
fn errors_are_those_of_pixels_off_edges() {
    let drawn = drawing([1.0, 2.5, 3.0, 9.0], [1.0; 4], "bound");
    let found = compare(&drawn, &truth([1.0, 2.0, 2.75, 4.0]), &[false, false, false, true]);
    assert_eq!((found.error.pixels, found.error.max), (3, 0.5));
    assert!((found.error.mean - 0.25).abs() < 1e-12);
    assert!((found.error.rms - (0.3125f64 / 3.0).sqrt()).abs() < 1e-12);
    // 0.5 where 1 % of 2 are allowed.
    assert!((found.error.share - 25.0).abs() < 1e-9);
    assert_eq!((found.edges.pixels, found.edges.max), (1, 5.0));
    assert_eq!(found.comparison.difference, [0.0, 0.5, 0.25, 5.0]);
}

#[test]
fn a_broken_bound_is_counted_and_a_kept_one_is_not() {
    let exact = truth([1.0, 2.0, 2.75, 4.0]);
    let plain = [false; 4];
    let kept = compare(&drawing([1.0, 2.5, 2.75, 4.0], [0.0, 0.5, 0.0, 0.0], "bound"), &exact, &plain);
    let kept = kept.predicted.expect("a prediction");
    assert_eq!((kept.beyond, kept.held(4), kept.median_ratio), (0, true, Some(1.0)));
    let broken = compare(&drawing([1.0, 2.5, 2.75, 4.0], [0.0, 0.4, 0.0, 0.0], "bound"), &exact, &plain);
    let broken = broken.predicted.expect("a prediction");
    assert_eq!((broken.beyond, broken.held(4)), (1, false));
    // Three standard errors are granted, and one pixel in fifty beyond them.
    let random = compare(&drawing([1.0, 2.5, 2.75, 4.0], [0.2; 4], "standard-error"), &exact, &plain);
    let random = random.predicted.expect("a prediction");
    assert_eq!((random.beyond, random.held(4)), (0, true));
    let unlikely = compare(&drawing([1.0, 2.5, 2.75, 4.0], [0.1; 4], "standard-error"), &exact, &plain);
    let unlikely = unlikely.predicted.expect("a prediction");
    assert_eq!((unlikely.beyond, unlikely.held(4), unlikely.held(50)), (1, false, true));
}

#[test]
fn what_is_no_number_is_as_wrong_as_can_be() {
    let drawn = drawing([1.0, f32::NAN, 2.75, f32::INFINITY], [9.0; 4], "bound");
    let found = compare(&drawn, &truth([1.0, 2.0, 2.75, 4.0]), &[false; 4]);
    assert_eq!(found.error.max, f64::INFINITY);
    assert_eq!(found.predicted.map(|p| p.beyond), Some(2));
}
