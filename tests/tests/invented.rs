//! Scenes put together at random: what the GPU draws of each is as close to the reference as it reports, or as `accuracy` allows.

use runtime::engine::gpu::AdapterChoice;
use runtime::frame::{EngineChoice, FileLoader};
use runtime::stress::{Request, Verdict, as_it_is, invent};
use std::path::Path;

/// Numbers that are known to break their word, and how. One that keeps it again has to leave this list.
const KNOWN: [(u64, &str); 0] = [];

#[test]
fn a_hundred_invented_scenes_keep_their_word() {
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
        let known = KNOWN.iter().find(|k| k.0 == number);
        match (&outcome.verdict, known) {
            (Verdict::LeftOut(why), _) if why.contains("E0642") || why.contains("adapter") => {
                runtime::engine::skip_without_adapter();
                return;
            }
            (Verdict::Failed(reasons), None) => wrong.push(format!("{number}: {}", reasons.join("; "))),
            (Verdict::Passed, Some(known)) => wrong.push(format!("{number} keeps its word again: {}", known.1)),
            (Verdict::Refused(why), _) => wrong.push(format!("{number} is refused: {why}")),
            (Verdict::Passed | Verdict::Failed(_) | Verdict::LeftOut(_), _) => {}
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
