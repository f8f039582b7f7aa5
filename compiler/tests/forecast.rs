//! What backends are predicted to need, and which of them `backend = auto` takes.

use compiler::backends::{REGISTRY, choose};
use compiler::ir::{Backend, RenderInfo};
use compiler::loader::NoFiles;
use compiler::program::{Forecast, Outcome, Program, print_forecasts};
use compiler::{Options, compile};

const WAVES: &str = "medium smoke { shape = sphere(center: (0, 0, 0) m, radius: 1 m)
    k_a = 2 /m * (1 + sin(p.x / 0.1 m))  k_e = 1 lx/m }\n";

fn program(text: &str, options: &Options) -> Program {
    let text = format!("{text}\ncamera {{ from = (0, 0, -4) m  to = (0, 0, 0) m }}");
    let out = compile("scene.vol", &text, &NoFiles, options);
    let found: Vec<&str> = out.diagnostics.iter().map(|d| d.message.as_str()).collect();
    out.program.unwrap_or_else(|| panic!("{found:?}"))
}

fn drawn(forecast: &Forecast) -> (f64, f64, f64) {
    match forecast.outcome {
        Outcome::Drawn { pieces, milliseconds, error, .. } => (pieces, milliseconds, error),
        Outcome::Refused(ref why) => panic!("{}: {why}", forecast.word),
    }
}

#[test]
fn auto_takes_the_fastest_that_keeps_the_accuracy() {
    for accuracy in [1e-1, 1e-2, 1e-3] {
        let p = program(WAVES, &Options { accuracy: Some(accuracy), ..Options::default() });
        assert_eq!(p.forecasts.len(), REGISTRY.len());
        let able: Vec<_> = p.forecasts.iter().filter(|f| drawn(f).2 <= 1.001 * accuracy).collect();
        // The ray marcher, unless another is twice as fast.
        let time = |f: &Forecast| drawn(f).1 / if f.backend == Backend::Raymarch { 2.0 } else { 1.0 };
        let fastest = able.iter().min_by(|a, b| time(a).total_cmp(&time(b))).expect("one of them");
        assert_eq!(p.plan.backend, fastest.word);
    }
}

#[test]
fn more_accuracy_takes_more_pieces_and_more_time() {
    let [rough, fine] = [1e-1, 1e-3].map(|a| program(WAVES, &Options { accuracy: Some(a), ..Options::default() }));
    for (rough, fine) in rough.forecasts.iter().zip(&fine.forecasts) {
        let (rough, fine) = (drawn(rough), drawn(fine));
        // Where as many as there may be do not do, no more of them are promised.
        assert!(fine.0 >= rough.0 && fine.1 >= rough.1 && fine.2 <= rough.2, "{rough:?} {fine:?}");
        assert!(fine.2 > 1e-3 * 1.001 || (fine.0 > rough.0 && fine.1 > rough.1), "{rough:?} {fine:?}");
    }
}

#[test]
fn heavier_fields_take_longer() {
    let noise = "use std::noise::fbm\nmedium smoke { shape = sphere(center: (0, 0, 0) m, radius: 1 m)
        k_a = 2 /m * max(0, fbm(p / 0.1 m))  k_e = 1 lx/m }\n";
    let [light, heavy] = [WAVES, noise].map(|text| program(text, &Options::default()));
    for (light, heavy) in light.forecasts.iter().zip(&heavy.forecasts) {
        assert!(drawn(heavy).1 > 1.2 * drawn(light).1, "{}", light.word);
        assert_eq!(drawn(heavy).0, drawn(light).0);
    }
}

#[test]
fn numbers_that_are_asked_for_are_kept() {
    let asked = |options: Options| {
        let p = program(WAVES, &options);
        (p.plan.backend, p.forecasts.iter().map(|f| drawn(f).0.round()).collect::<Vec<_>>())
    };
    // Steps mean the ray marcher, however few.
    let (backend, pieces) = asked(Options { steps: Some(7), ..Options::default() });
    assert_eq!((backend, pieces[0]), ("raymarch", 7.0));
    // So few slabs and Gaussians are predicted not to do, fast as they are.
    let (backend, pieces) = asked(Options { slices: Some(3), splats: Some(64), ..Options::default() });
    assert_eq!((backend, &pieces[1..]), ("raymarch", &[3.0, 64.0][..]));
}

#[test]
fn what_a_backend_cannot_draw_it_says_and_auto_does_not_take_it() {
    let fog = "fog { k = 0.05 /m  color = #c8d0d8  height = 200 m }";
    let milk = "medium milk { shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_s = 9 /m }
        light sun { direction = (0, -1, 0)  irradiance = 3 lx }
        render { scattering = multiple }";
    for (text, why) in [(fog, "which has no end"), (milk, "follow light from scattering to scattering")] {
        let p = program(text, &Options::default());
        assert_eq!(p.plan.backend, "raymarch");
        drawn(&p.forecasts[0]);
        for forecast in &p.forecasts[1..] {
            assert!(matches!(&forecast.outcome, Outcome::Refused(said) if said.contains(why)), "{forecast:?}");
        }
    }
    // The reason is the message that asking for the backend brings.
    let asked = Options { backend: Some(Backend::Slicing), ..Options::default() };
    let out = compile("scene.vol", fog, &NoFiles, &asked);
    let message = &out.diagnostics.iter().find(|d| d.code == "E0530").expect("refused").message;
    let Outcome::Refused(said) = &program(fog, &Options::default()).forecasts[1].outcome else { panic!("refused") };
    assert_eq!(said, message);
}

#[test]
fn closed_forms_need_no_pieces() {
    let p =
        program("medium ball { shape = sphere(center: (0, 0, 0) m, radius: 1 m)  k_a = 1 /m }", &Options::default());
    assert_eq!((drawn(&p.forecasts[0]).0, drawn(&p.forecasts[1]).0), (0.0, 0.0));
    assert!(print_forecasts(&p.forecasts, "raymarch").starts_with("  * raymarch  closed forms, "));
}

/// What a scene asks of its drawing that says nothing but an accuracy.
fn render() -> RenderInfo {
    program(WAVES, &Options { accuracy: Some(1e-3), ..Options::default() }).lowered.render
}

#[test]
fn where_none_is_good_enough_the_marcher_says_so() {
    let lost = |backend| Forecast {
        backend,
        word: "",
        outcome: Outcome::Drawn { pieces: 1.0, of: "slabs", milliseconds: 1.0, error: 1.0 },
    };
    let refused = |backend| Forecast { backend, word: "", outcome: Outcome::Refused("it cannot".into()) };
    assert_eq!(choose(&[lost(Backend::Raymarch), lost(Backend::Slicing)], &render()), Backend::Raymarch);
    assert_eq!(choose(&[refused(Backend::Raymarch), lost(Backend::Splatting)], &render()), Backend::Splatting);
    assert_eq!(choose(&[refused(Backend::Raymarch), refused(Backend::Slicing)], &render()), Backend::Raymarch);
}

#[test]
fn another_backend_is_taken_if_it_is_twice_as_fast() {
    let takes = |backend, milliseconds| Forecast {
        backend,
        word: "",
        outcome: Outcome::Drawn { pieces: 1.0, of: "slabs", milliseconds, error: 1e-3 },
    };
    let render = render();
    let taken = |slicing| choose(&[takes(Backend::Raymarch, 10.0), takes(Backend::Slicing, slicing)], &render);
    assert_eq!((taken(6.0), taken(4.0)), (Backend::Raymarch, Backend::Slicing));
}
