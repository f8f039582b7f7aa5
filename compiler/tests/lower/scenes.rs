//! Media, background, camera, projections, units, and what is not there yet.

use crate::build::*;
use crate::{Place, close, codes, here, in_units, metres, value};
use compiler::check::hir::*;
use compiler::ir::{self, Aa, FieldScene, Units, print};
use compiler::lower::{choose_units, lower_scaled, pending};
use compiler::syntax::ast::{BinaryOp, BlockKind};

fn ball(center: Expr, radius: f64) -> Medium {
    Medium { shape: Some(sphere(center, radius)), k_a: Some(per_m(2.0)), ..medium("ball") }
}

fn unframed() -> Scene {
    let mut scene = scene();
    (scene.camera.from, scene.camera.to) = (None, None);
    scene
}

fn camera(scene: &Scene) -> ([f64; 3], [f64; 3], [f64; 3]) {
    let mut diagnostics = compiler::diagnostic::Diagnostics::default();
    let lowered = lower_scaled(scene, &mut diagnostics).expect("a field scene");
    let get = |node, unit: f64| {
        let v = value(&lowered, node, &Place::default());
        [v[0] * unit, v[1] * unit, v[2] * unit]
    };
    let unit = lowered.units.length;
    (get(lowered.camera.from, unit), get(lowered.camera.to, unit), get(lowered.camera.up, 1.0))
}

#[test]
fn the_unit_follows_the_size_of_the_scene() {
    for (radius, unit) in [(1.0, 1.0), (1.3, 1.0), (1.5, 2.0), (6.4e6, 8_388_608.0), (1e-3, 1.0 / 1024.0)] {
        let mut scene = unframed();
        scene.media.push(ball(m3(0.0, 0.0, 0.0), radius));
        assert_eq!(choose_units(&scene).length, unit, "radius {radius}");
    }
    // Without bounded media, the distance the camera looks over.
    let mut scene = scene();
    scene.media.push(Medium { k_a: Some(per_m(1.0)), ..medium("air") });
    assert_eq!(choose_units(&scene).length, 4.0);
    scene.camera.from = None;
    assert_eq!(choose_units(&scene).length, 1.0);
    // A ball far away counts with its own size, whatever its place.
    let mut scene = unframed();
    scene.media.push(ball(m3(1000.0, 0.0, 0.0), 1.0));
    assert_eq!(choose_units(&scene).length, 1.0);
}

/// The same scene in different units has the same optical quantities, to the last bit: units are powers of two.
#[test]
fn units_change_nothing() {
    let mut scene = scene();
    let law = op(BinaryOp::Divide, m(680e-9), input(Input::Lambda), Type::Spectrum(Dim::default()));
    let law = op(BinaryOp::Power, law, n(4.0), Type::Spectrum(Dim::default()));
    let height = op(BinaryOp::Divide, px(1), the_param(0, length(1)), number());
    let density = call(Builtin::Exp, vec![expr(ExprKind::Negate(Box::new(height)), number())], number());
    scene.params.push(param("height", 1.25, 1.0));
    scene.media.push(Medium {
        shape: Some(sphere(m3(0.0, 1.0, 0.0), 3.0)),
        transform: Some(call(Builtin::Rotate, vec![v3(1.0, 1.0, 0.0), n(0.3)], Type::Transform)),
        density: Some(density),
        k_a: Some(op(BinaryOp::Multiply, law, per_m(0.7), Type::Spectrum(length(-1)))),
        k_e: Some(quantity(3.0, dimension(-1, 1))),
        ..medium("haze")
    });
    let place = here(0.3, 0.7, -0.2);
    let at = |unit: f64| {
        let lowered = in_units(&scene, Units { length: unit });
        let medium = &lowered.media[0];
        // Optical depth and radiance over a metre.
        let over = |node| value(&lowered, node, &place).iter().map(|k| k / unit).collect::<Vec<f64>>();
        let eye: Vec<f64> = value(&lowered, lowered.camera.from, &place).iter().map(|v| v * unit).collect();
        (over(medium.k_a), over(medium.k_e), eye)
    };
    let metre = at(1.0);
    assert_eq!(metre.0.len(), 3);
    assert_eq!(metre, at(1024.0));
    assert_eq!(metre, at(1.0 / 1024.0));
    assert_eq!(metre.2, [0.0, 0.0, -4.0]);
}

#[test]
fn coefficients_that_are_absent_are_zero_and_density_scales_the_others() {
    let mut scene = with_density(n(3.0));
    scene.media[0].k_s = Some(per_m(2.0));
    let lowered = metres(&scene);
    let medium = &lowered.media[0];
    let get = |node| value(&lowered, node, &here(0.0, 0.0, 0.0));
    assert_eq!([get(medium.k_a), get(medium.k_s), get(medium.k_e)], [[3.0], [6.0], [0.0]]);
    assert_eq!(medium.shape, ir::Shape::Everywhere);
    assert_eq!(lowered.graph.origin(medium.k_a).name.as_deref(), Some("cloud.k_a"));
}

#[test]
fn the_background() {
    let get = |scene: &Scene, place: &Place| {
        let lowered = metres(scene);
        value(&lowered, lowered.background, place)
    };
    let mut scene = scene();
    assert_eq!(get(&scene, &Place::default()), [0.0]);
    scene.image.background = Some(color(0.1, 0.2, 0.3));
    assert_eq!(get(&scene, &Place::default()), [0.1, 0.2, 0.3]);
    scene.image.background = Some(color(0.5, 0.5, 0.5));
    assert_eq!(get(&scene, &Place::default()), [0.5], "grey is one number");
    // Environments replace it and add up.
    let light = dimension(0, 1);
    let up = component(input(Input::Direction), 1, Dim::default());
    let sky = op(BinaryOp::Multiply, up, quantity(2.0, light), Type::Number(light));
    for radiance in [sky, quantity(0.25, light)] {
        scene.lights.push(Light { name: "sky".into(), span: span(0), kind: LightKind::Environment { radiance } });
    }
    let place = Place { direction: [0.0, 0.5, 0.0], ..Place::default() };
    assert_eq!(get(&scene, &place), [1.25]);
}

#[test]
fn a_written_camera_is_taken_as_it_is() {
    let mut scene = scene();
    scene.media.push(ball(m3(7.0, 0.0, 0.0), 2.0));
    assert_eq!(camera(&scene), ([0.0, 0.0, -4.0], [0.0; 3], [0.0, 1.0, 0.0]));
}

/// Every corner of what is framed lies within the picture, and the picture is not mostly empty.
#[test]
fn a_scene_without_a_camera_is_framed() {
    for (center, radius, size) in
        [([0.0, 0.0, 0.0], 1.0, [64, 64]), ([5.0, -3.0, 40.0], 0.01, [300, 100]), ([0.0, 1e4, 0.0], 3000.0, [50, 100])]
    {
        let mut scene = unframed();
        scene.image.size = size;
        scene.media.push(ball(m3(center[0], center[1], center[2]), radius));
        let (from, to, _) = camera(&scene);
        assert!(close(&to, &center, 1e-12));
        let distance = (0..3).map(|i| (from[i] - to[i]).powi(2)).sum::<f64>().sqrt();
        // The half angle that the ball fills, against that of the narrower side of the picture.
        let angle = (radius / distance).asin();
        let tangent = (std::f64::consts::FRAC_PI_8).tan() * f64::from(size[0].min(size[1])) / f64::from(size[1]);
        assert!(angle < tangent.atan() && angle > 0.4 * tangent.atan(), "{angle} in {}", tangent.atan());
        assert!(from[2] < to[2] && from[1] > to[1], "from in front and above");
    }
}

#[test]
fn half_a_camera() {
    let mut scene = unframed();
    scene.media.push(ball(m3(0.0, 0.0, 0.0), 1.0));
    scene.camera.from = Some(m3(0.0, 2.0, 9.0));
    assert_eq!(camera(&scene).1, [0.0; 3], "looks at the middle");
    scene.camera.from = Some(m3(0.0, 0.0, 0.0));
    assert_eq!(camera(&scene).1, [0.0, 0.0, 1.0], "from the middle, ahead");
    scene.camera.from = None;
    scene.camera.to = Some(m3(0.0, 1.0, 0.0));
    let (from, to, _) = camera(&scene);
    assert!(to == [0.0, 1.0, 0.0] && from[2] < -2.0);
    // Nothing to frame.
    let mut scene = unframed();
    scene.media.push(Medium { k_a: Some(per_m(1.0)), ..medium("air") });
    assert_eq!(camera(&scene), ([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]));
}

#[test]
fn looking_straight_down_needs_no_up() {
    let mut scene = scene();
    scene.camera.from = Some(m3(0.0, 5.0, 0.0));
    assert_eq!(camera(&scene).2, [0.0, 0.0, 1.0]);
}

#[test]
fn projections_of_data() {
    let mut scene = scene();
    let x = || component(plain_p(), 0, Dim::default());
    let layer = |key: Expr| expr(ExprKind::Lookup(TableId(0), Box::new(key)), Type::Layer);
    scene.tables.push(Table {
        name: "tissue".into(),
        span: span(0),
        key: number(),
        rows: TableRows::Layers(vec![
            (n(0.0), color(0.0, 0.0, 0.0), per_m(0.0)),
            (n(1.0), color(1.0, 0.5, 0.0), per_m(20.0)),
        ]),
    });
    let k = expr(ExprKind::LayerK(Box::new(layer(x()))), Type::Number(length(-1)));
    scene.media.push(Medium { k_a: Some(k), transfer: Some(layer(x())), ..medium("scan") });
    let lowered = metres(&scene);
    assert!(lowered.media[0].data.is_none(), "nothing is projected");

    scene.render.composite = Composite::Maximum;
    let check = |lowered: &FieldScene| {
        let (data, shade) = (lowered.media[0].data.expect("data"), lowered.media[0].data_color.expect("a colour"));
        assert_eq!(value(lowered, data, &here(0.75, 0.0, 0.0)), [0.75]);
        let place = Place { cos_theta: 0.5, ..here(0.75, 0.0, 0.0) };
        assert_eq!(value(lowered, shade, &place), [0.5, 0.25, 0.0]);
    };
    check(&metres(&scene));
    // Through a function with a constant argument besides.
    scene.functions.push(Function {
        name: "shaded".into(),
        span: span(0),
        parameters: vec![("x".into(), number()), ("gain".into(), number())],
        result: Type::Layer,
        body: layer(op(BinaryOp::Multiply, local(0, number()), local(1, number()), number())),
    });
    scene.media[0].transfer = Some(function(0, vec![x(), n(1.0)], Type::Layer));
    check(&metres(&scene));
    // Of two varying arguments neither is the data.
    scene.media[0].transfer = Some(function(0, vec![x(), x()], Type::Layer));
    assert_eq!(codes(&scene), ["E0510"]);
    scene.media[0].transfer = None;
    scene.render.composite = Composite::Isosurface(n(0.5));
    assert_eq!(codes(&scene), ["E0510"]);
}

#[test]
fn what_is_not_there_yet_is_said() {
    let found = |scene: &Scene| pending(scene).iter().map(|d| d.code).collect::<Vec<_>>();
    let mut scene = scene();
    for (kind, name) in [(BlockKind::Text, "title"), (BlockKind::Style, "caption")] {
        scene.pending.push(Pending { kind, name: name.into(), span: span(2) });
    }
    scene.image.aa = Aa::Smaa;
    assert_eq!(found(&scene), ["W0903", "W0907"]);
    scene.image.aa = Aa::Ssaa(4);
    assert_eq!(found(&scene), ["W0903"]);
    let sources = {
        let mut sources = compiler::source::Sources::default();
        sources.add("scene.vol", "abcdef\n");
        sources
    };
    insta::assert_snapshot!(compiler::diagnostic::render(&pending(&scene), &sources));
}

/// The printed graph of a ball, a cloud with a param and a scan.
#[test]
fn graphs() {
    let show = |scene: &Scene| {
        let mut diagnostics = compiler::diagnostic::Diagnostics::default();
        let lowered = lower_scaled(scene, &mut diagnostics).expect("a field scene");
        let medium = &lowered.media[0];
        let roots = [("k_a", medium.k_a), ("k_s", medium.k_s), ("k_e", medium.k_e), ("eye", lowered.camera.from)];
        let roots: Vec<_> = roots.into_iter().map(|(n, id)| (n.to_owned(), id)).collect();
        format!("unit {} m\n{:?}\n{}", lowered.units.length, medium.shape, print(&lowered.graph, &roots))
    };
    let mut scene = unframed();
    scene.media.push(Medium { k_e: Some(quantity(3.0, dimension(-1, 1))), ..ball(m3(0.0, 1.0, 0.0), 8.0) });
    insta::assert_snapshot!("ball", show(&scene));

    let mut scene = with_density(call(
        Builtin::Max,
        vec![
            n(0.0),
            op(
                BinaryOp::Multiply,
                the_param(0, Dim::default()),
                reduce(
                    compiler::ir::Fold::Sum,
                    0,
                    n(0.0),
                    n(3.0),
                    call(
                        Builtin::Sin,
                        vec![op(
                            BinaryOp::Multiply,
                            component(plain_p(), 0, Dim::default()),
                            local(0, number()),
                            number(),
                        )],
                        number(),
                    ),
                ),
                number(),
            ),
        ],
        number(),
    ));
    scene.params.push(param("gain", 0.5, 0.0));
    scene.media[0].k_s = Some(call(Builtin::Rgb, vec![per_m(2.0), per_m(2.4), per_m(3.0)], Type::Spectrum(length(-1))));
    insta::assert_snapshot!("cloud", show(&scene));

    let mut scene = unframed();
    scene.grids.push(crate::expressions::oblique());
    let head = || expr(ExprKind::Grid(GridId(0)), Type::Grid);
    let layer = || {
        let sample = expr(ExprKind::Sample(GridId(0), Box::new(p())), number());
        expr(ExprKind::Lookup(TableId(0), Box::new(sample)), Type::Layer)
    };
    scene.tables.push(Table {
        name: "tissue".into(),
        span: span(0),
        key: number(),
        rows: TableRows::Layers(vec![
            (n(30.0), color(0.0, 0.0, 0.0), per_m(0.0)),
            (n(200.0), color(1.0, 0.5, 0.0), per_m(300.0)),
        ]),
    });
    let k = || expr(ExprKind::LayerK(Box::new(layer())), Type::Number(length(-1)));
    let shade = expr(ExprKind::LayerColor(Box::new(layer())), Type::Color);
    scene.media.push(Medium {
        shape: Some(call(Builtin::Bounds, vec![head()], Type::Shape)),
        k_a: Some(k()),
        k_e: Some(op(BinaryOp::Multiply, k(), shade, Type::Spectrum(dimension(-1, 1)))),
        ..medium("scan")
    });
    insta::assert_snapshot!("scan", show(&scene));
}
