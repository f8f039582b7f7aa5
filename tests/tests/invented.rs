//! Scenes put together at random: what the GPU draws of each is as close to the reference as it reports, or as `accuracy` allows.

use compiler::ir::Backend;
use runtime::engine::gpu::AdapterChoice;
use runtime::frame::{EngineChoice, FileLoader};
use runtime::stress::{Request, Verdict, as_it_is, invent};
use std::path::Path;
use tyndall_tests::open_text;

/// Draws them by a backend; how many were drawn, and how many pixels were compared.
fn keep_their_word(backend: Backend, numbers: impl Iterator<Item = u64>) -> Option<(u32, u32)> {
    open_text(&invent(0), compiler::Options::default())?;
    let loader = FileLoader::new(Path::new("."));
    let request = Request {
        sets: vec![],
        backend: Some(backend),
        engine: Some(EngineChoice::Gpu),
        adapter: AdapterChoice::default(),
        budget: 0.5,
        seed: 0,
    };
    let (mut wrong, mut drawn, mut compared) = (vec![], 0, 0);
    for number in numbers {
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
    Some((drawn, compared))
}

#[test]
fn a_hundred_invented_scenes_keep_their_word() {
    let Some((drawn, compared)) = keep_their_word(Backend::Raymarch, 0..100) else { return };
    assert!(drawn > 90 && compared > 10_000, "{drawn} pictures, {compared} pixels");
}

/// Scenes beyond those hundred that once broke their word, and what in them did.
const BROKEN_ONCE: [(u64, &str); 14] = [
    (127, "a skin thinner than cells of the lattice of light"),
    (270, "a narrow layer of a table, lit by a lamp"),
    (284, "a skin thinner than cells of the lattice of light"),
    (320, "cells of noise that glow through a Gaussian"),
    (326, "waves of density that a sun lights, a millionth of a metre long"),
    (403, "specks of noise above a threshold that glow alone"),
    (524, "a shell that outshines everything behind something opaque"),
    (542, "specks of noise, too dense to be seen through"),
    (591, "waves of density that glow and are lit"),
    (850, "waves of density, lit from the side"),
    (902, "a shell that no column of light meets, though places are behind it"),
    (1181, "an edge that light grazes, within a cell of the lattice of light"),
    (1339, "a skin far thinner than f32 can tell, under a closed shadow"),
    (1571, "a shell of a fifty-thousandth of its box, whose sides are rounded"),
];

#[test]
fn invented_scenes_that_broke_their_word_keep_it() {
    for (number, what) in BROKEN_ONCE {
        println!("{number}: {what}");
        if keep_their_word(Backend::Raymarch, number..number + 1).is_none() {
            return;
        }
    }
}

/// Among them shells far thinner than a slab, and fields that jump inside of one.
#[test]
fn invented_scenes_keep_their_word_in_slabs() {
    let Some((drawn, compared)) = keep_their_word(Backend::Slicing, 0..40) else { return };
    assert!(drawn > 35 && compared > 5000, "{drawn} pictures, {compared} pixels");
}
