//! Scenes put together at random: what the GPU draws of each is as close to the reference as it reports, or as `accuracy` allows.

use runtime::engine::gpu::AdapterChoice;
use runtime::frame::{EngineChoice, FileLoader};
use runtime::stress::{Request, Verdict, as_it_is, invent};
use std::path::Path;
use tyndall_tests::open_text;

#[test]
fn a_hundred_invented_scenes_keep_their_word() {
    if open_text(&invent(0), compiler::Options::default()).is_none() {
        return;
    }
    let loader = FileLoader::new(Path::new("."));
    let request = Request {
        sets: vec![],
        backend: Some(compiler::ir::Backend::Raymarch),
        engine: Some(EngineChoice::Gpu),
        adapter: AdapterChoice::default(),
        budget: 0.5,
        seed: 0,
    };
    let (mut wrong, mut drawn, mut compared) = (vec![], 0, 0);
    for number in 0..100 {
        let trial = as_it_is(&format!("invented-{number}.vol"), &invent(number), &loader, &request);
        let outcome = &trial.outcomes[0];
        match &outcome.verdict {
            Verdict::Failed(reasons) => wrong.push(format!("{number}: {}", reasons.join("; "))),
            Verdict::Refused(why) => wrong.push(format!("{number} is refused: {why}")),
            Verdict::Passed | Verdict::LeftOut(_) => {}
        }
        if let Some(look) = outcome.look {
            drawn += 1;
            compared += look.compared;
        }
    }
    println!("{drawn} pictures, {compared} pixels compared");
    assert!(wrong.is_empty(), "{} scenes:\n{}", wrong.len(), wrong.join("\n"));
    assert!(drawn > 90 && compared > 10_000, "{drawn} pictures, {compared} pixels");
}
