//! What checking makes of right scenes: values in SI, sugar expanded, defaults filled in.

use compiler::check::hir::{Dim, Expr, ExprKind, Input, LightKind, Projection, Scene, Type};
use compiler::check_scene;
use compiler::diagnostic::render;
use compiler::ir::{Aa, BandsKind, ParamType, Scattering};
use compiler::loader::NoFiles;
use compiler::syntax::ast::BinaryOp;

fn scene(text: &str) -> Scene {
    let (sources, diagnostics, scene) = check_scene("scene.vol", text, &NoFiles);
    scene.unwrap_or_else(|| panic!("{}", render(&diagnostics, &sources)))
}

fn number(expr: &Expr) -> f64 {
    if let ExprKind::Number(v) = expr.kind { v } else { panic!("{expr:?}") }
}

/// Every node of a tree.
fn walk<'e>(expr: &'e Expr, out: &mut Vec<&'e Expr>) {
    out.push(expr);
    match &expr.kind {
        ExprKind::Vector(parts) | ExprKind::Call(_, parts) | ExprKind::Builtin(_, parts) => {
            parts.iter().for_each(|p| walk(p, out));
        }
        ExprKind::Negate(a)
        | ExprKind::Not(a)
        | ExprKind::Lookup(_, a)
        | ExprKind::Sample(_, a)
        | ExprKind::Swizzle(a, _)
        | ExprKind::LayerColor(a)
        | ExprKind::LayerK(a) => walk(a, out),
        ExprKind::Binary(_, a, b) => [a, b].into_iter().for_each(|p| walk(p, out)),
        ExprKind::If(a, b, c) => [a, b, c].into_iter().for_each(|p| walk(p, out)),
        ExprKind::Let(bound, last) => {
            bound.iter().for_each(|(_, _, v)| walk(v, out));
            walk(last, out);
        }
        ExprKind::Reduce { start, end, body, .. } => [start, end, body].into_iter().for_each(|p| walk(p, out)),
        _ => {}
    }
}

#[test]
fn quantities_are_in_si() {
    let scene =
        scene("medium a { shape = sphere(center: (1, 2, 3) km, radius: 5 cm)  k_a = 2 mm^-1  k_e = 3 lx / km }");
    let medium = &scene.media[0];
    assert_eq!(number(medium.k_a.as_ref().unwrap()), 2000.0);
    assert_eq!(medium.k_a.as_ref().unwrap().ty, Type::Number(Dim::COEFFICIENT));
    assert_eq!(medium.k_e.as_ref().unwrap().ty, Type::Number(Dim::EMISSION));
    let ExprKind::Builtin(_, arguments) = &medium.shape.as_ref().unwrap().kind else { panic!() };
    let ExprKind::Vector(center) = &arguments[0].kind else { panic!() };
    assert_eq!(center.iter().map(number).collect::<Vec<_>>(), [1000.0, 2000.0, 3000.0]);
    assert_eq!(number(&arguments[1]), 0.05);
}

#[test]
fn albedo_splits_the_extinction() {
    let scene = scene("medium a { k_t = 4 m^-1  albedo = 0.75 }");
    let (k_a, k_s) = (scene.media[0].k_a.as_ref().unwrap(), scene.media[0].k_s.as_ref().unwrap());
    let ExprKind::Binary(BinaryOp::Multiply, share, total) = &k_s.kind else { panic!() };
    assert_eq!((number(share), number(total)), (0.75, 4.0));
    let ExprKind::Binary(BinaryOp::Multiply, rest, total) = &k_a.kind else { panic!() };
    let ExprKind::Binary(BinaryOp::Subtract, one, share) = &rest.kind else { panic!() };
    assert_eq!((number(one), number(share), number(total)), (1.0, 0.75, 4.0));
    assert_eq!((&k_a.ty, &k_s.ty), (&Type::Number(Dim::COEFFICIENT), &Type::Number(Dim::COEFFICIENT)));
}

#[test]
fn a_layer_absorbs_and_shines() {
    let scene = scene("medium a { transfer = layer(color: #fff, k: 20 /m) }");
    let medium = &scene.media[0];
    assert!(matches!(&medium.k_a.as_ref().unwrap().kind, ExprKind::LayerK(_)));
    assert_eq!(medium.k_e.as_ref().unwrap().ty, Type::Spectrum(Dim::EMISSION));
    assert_eq!(medium.transfer.as_ref().unwrap().ty, Type::Layer);
}

#[test]
fn phases_get_the_angle_by_themselves() {
    let text = "fn mine(cos_theta: number, p: vec3<length>) -> number = cos_theta * p.x / 1 m\n\
                medium a { k_s = 1 /m  phase = mix(rayleigh, mine, 0.5) }\n\
                medium b { k_s = 1 /m  phase = henyey_greenstein(0.25) }";
    let scene = scene(text);
    let mut nodes = vec![];
    walk(scene.media[0].phase.as_ref().unwrap(), &mut nodes);
    let count = |input| nodes.iter().filter(|e| e.kind == ExprKind::Input(input)).count();
    assert_eq!((count(Input::CosTheta), count(Input::Position)), (2, 1));
    let ExprKind::Call(_, arguments) = &scene.media[1].phase.as_ref().unwrap().kind else { panic!() };
    assert_eq!(arguments[0].kind, ExprKind::Input(Input::CosTheta));
    assert_eq!(number(&arguments[1]), 0.25);
}

#[test]
fn functions_of_numbers_are_checked_again_for_spectra() {
    let text = "fn law(x: length) -> number = 550 nm / x\nmedium a { k_a = law(lambda) * law(1 um) / m }";
    let scene = scene(text);
    let law: Vec<_> = scene.functions.iter().filter(|f| f.name == "law").collect();
    assert_eq!(law.len(), 2);
    assert_eq!(law[0].parameters[0].1, Type::Number(Dim::LENGTH));
    assert_eq!(law[1].parameters[0].1, Type::Spectrum(Dim::LENGTH));
    assert_eq!(law[1].result, Type::Spectrum(Dim::NONE));
    assert_eq!(scene.media[0].k_a.as_ref().unwrap().ty, Type::Spectrum(Dim::COEFFICIENT));
}

#[test]
fn params_keep_their_dimension_and_range() {
    let text = "/// How dense.\nparam d = 4 /km in 0 .. 1 /m\nparam tint = #f00\nparam on = true\n\
                medium a { k_a = if on then d else luminance(tint) / m }";
    let scene = scene(text);
    assert_eq!(scene.params[0].dimension, [-1.0, 0.0, 0.0, 0.0]);
    assert_eq!(scene.params[0].default, [0.004]);
    assert_eq!(scene.params[0].range, Some((0.0, 1.0)));
    assert_eq!(scene.params[0].docs.as_deref().map(str::trim), Some("How dense."));
    assert_eq!((scene.params[1].ty, scene.params[1].default.clone()), (ParamType::Color, vec![1.0, 0.0, 0.0]));
    assert_eq!((scene.params[2].ty, scene.params[2].default.clone()), (ParamType::Bool, vec![1.0]));
}

#[test]
fn defaults_are_those_of_the_language() {
    let scene = scene("medium a { k_a = 1 /m }");
    assert_eq!((scene.image.size, scene.image.aa, scene.image.bands), ([1024, 768], Aa::Analytic, BandsKind::Rgb));
    assert_eq!(scene.image.wavelengths, [6.8e-7, 5.5e-7, 4.4e-7]);
    assert_eq!(scene.camera.projection, Projection::Perspective(None));
    assert_eq!((scene.render.accuracy, scene.render.max_work, scene.render.steps), (1e-2, 65536, None));
    assert_eq!(scene.render.scattering, Scattering::None);
}

#[test]
fn scattering_is_single_where_it_would_be_seen() {
    let light = "light sun { direction = (0, -1, 0)  irradiance = 1 lx }";
    let of = |text: &str| scene(text).render.scattering;
    assert_eq!(of(&format!("medium a {{ k_s = 1 /m }}\n{light}")), Scattering::Single);
    assert_eq!(of("medium a { k_s = 1 /m }"), Scattering::None);
    assert_eq!(of(&format!("medium a {{ k_a = 1 /m }}\n{light}")), Scattering::None);
    let explicit = scene(&format!("medium a {{ k_s = 1 /m }}\n{light}\nrender {{ scattering = none }}"));
    assert_eq!((explicit.render.scattering, explicit.render.scattering_explicit), (Scattering::None, true));
}

#[test]
fn names_bound_in_one_tree_are_told_apart() {
    let text = "fn two(x: number, y: number = { let z = 2  z * z }) -> number = x + y\n\
                medium a { density = { let x = p.x / 1 m  { let x = two(x)  x * two(x) } + x }  k_a = 1 /m }";
    let scene = scene(text);
    let mut nodes = vec![];
    walk(scene.media[0].density.as_ref().unwrap(), &mut nodes);
    let mut bound: Vec<u32> = nodes
        .iter()
        .filter_map(|e| if let ExprKind::Let(bound, _) = &e.kind { Some(bound) } else { None })
        .flatten()
        .map(|(id, ..)| id.0)
        .collect();
    let all = bound.len();
    bound.sort_unstable();
    bound.dedup();
    assert_eq!((all, bound.len()), (4, 4));
}

#[test]
fn lights_are_of_three_kinds() {
    let text = "light a { direction = (0, -1, 0)  irradiance = 1 lx  angular_diameter = 180 deg }\n\
                light b { position = (0, 1, 0) m  intensity = 3 lx * m^2 }\n\
                light c { environment = rgb(1, 2, 3) * lx * max(0, dir.y) }";
    let lights = scene(text).lights;
    let LightKind::Directional { angular_diameter: Some(angle), .. } = &lights[0].kind else { panic!() };
    assert_eq!(number(angle), std::f64::consts::PI);
    assert!(matches!(&lights[1].kind, LightKind::Point { radius: None, .. }));
    assert!(
        matches!(&lights[2].kind, LightKind::Environment { radiance } if radiance.ty == Type::Spectrum(Dim::LIGHT))
    );
}
