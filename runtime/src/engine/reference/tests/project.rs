//! Projections of data.

use super::build::*;
use compiler::ir::{Composite, FieldScene, Filter, Input};

/// Data `3 − |p|²` in a ball of radius 1.5, colour = twice the value.
fn bump(composite: impl FnOnce(&mut Build) -> Composite) -> FieldScene {
    let mut b = Build::default();
    let shape = b.sphere([0.0; 3], 1.5);
    let r2 = b.square([0.0; 3]);
    let three = b.c(3.0);
    let data = b.g.sub(three, r2);
    let value = b.g.input(Input::CosTheta);
    let color = b.times(2.0, value);
    let one = b.c(1.0);
    b.medium(shape, one, one);
    b.media[0].data = Some(data);
    b.media[0].data_color = Some(color);
    let composite = composite(&mut b);
    b.composite = Some(composite);
    b.scene(0.125)
}

fn value(scene: &FieldScene) -> f64 {
    let result = trace(scene, [0.5, 0.0, -4.0], [0.0, 0.0, 1.0]);
    assert!(result.error[0] <= 1e-8 * result.radiance[0].abs());
    result.radiance[0]
}

#[test]
fn of_a_smooth_bump() {
    assert!((value(&bump(|_| Composite::Maximum)) - 5.5).abs() < 1e-10);
    assert!((value(&bump(|_| Composite::Minimum)) - 1.5).abs() < 1e-10);
    // Half chord √2: mean of 2.75 − z² is 2.75 − 2/3.
    assert!((value(&bump(|_| Composite::Average)) - 2.0 * (2.75 - 2.0 / 3.0)).abs() < 1e-10);
    // Data = 2 on the unit sphere: the normal's z is √0.75.
    let surface = bump(|b| Composite::Isosurface(b.c(2.0)));
    assert!((value(&surface) - 4.0 * 0.75f64.sqrt()).abs() < 1e-9);
    let none = bump(|b| Composite::Isosurface(b.c(9.0)));
    assert_eq!(value(&none), 0.125);
    let miss = trace(&bump(|_| Composite::Maximum), [5.0, 0.0, -4.0], [0.0, 0.0, 1.0]);
    assert_eq!((miss.radiance[0], miss.transmittance[0]), (0.125, 1.0));
}

#[test]
fn of_voxels() {
    let dims = [5, 5, 5];
    let mut data = vec![0.1; 125];
    data[2 + 5 * (2 + 5 * 2)] = 0.9;
    let values = Values { dims, data };
    for (filter, maximum) in [(Filter::Nearest, 0.9), (Filter::Linear, 0.1 + 0.8 * 0.9 * 0.8)] {
        let mut b = Build::default();
        let sample = b.grid(dims, [1.0; 3], [0.0; 3], filter);
        let shape = b.cube([-0.5; 3], [4.5; 3]);
        let color = b.g.input(Input::CosTheta);
        let zero = b.c(0.0);
        b.medium(shape, zero, zero);
        b.media[0].data = Some(sample);
        b.media[0].data_color = Some(color);
        b.composite = Some(Composite::Maximum);
        let scene = b.scene(0.0);
        let result = trace_in(&scene, &values, [2.1, 2.2, -9.0], [0.0, 0.0, 1.0]);
        assert!((result.radiance[0] - maximum).abs() < 1e-12, "{filter:?}: {}", result.radiance[0]);
        let mut iso = scene.clone();
        iso.render.composite = Composite::Isosurface(iso.graph.scalar(0.5));
        let hit = trace_in(&iso, &values, [2.1, 2.2, -9.0], [0.0, 0.0, 1.0]);
        assert_eq!(hit.transmittance[0], 0.0);
        assert!(hit.radiance[0] > 0.0 && hit.radiance[0] <= 0.5);
    }
}
