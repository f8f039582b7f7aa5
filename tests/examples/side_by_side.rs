//! Draws a scene by marching, slicing and splatting on the GPU and puts the three pictures beside each other, and under each what it is off
//! from the first, ten times as bright. `cargo run --release -p tyndall-tests --example side_by_side [SCENE [PNG]]`; without
//! arguments the scene is `examples/three_ways.vol`.

use compiler::Options;
use compiler::backends::REGISTRY;
use runtime::frame::EngineChoice;
use runtime::image::{Picture, WriteOptions, write_png};
use std::path::PathBuf;
use tyndall_tests::{draw, open, root};

/// By how much differences are brightened.
const GAIN: f32 = 10.0;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().map_or_else(|| root().join("examples/three_ways.vol"), PathBuf::from);
    let out = arguments.next().unwrap_or_else(|| "side_by_side.png".into());
    let mut pictures: Vec<Picture> = vec![];
    for entry in REGISTRY {
        let (backend, name) = (entry.backend, entry.word);
        let options = Options { backend: Some(backend), ..Options::default() };
        let Some(mut session) = open(&scene, options, EngineChoice::Gpu) else { return };
        let drawing = draw(&scene, &mut session);
        let measured = session.measure(&drawing, 256, 1).map(|m| format!("{:.1e} lx", m.max));
        println!(
            "{name}: {:.0} ms, reported error at most {}, measured {}",
            drawing.milliseconds,
            drawing.predicted.map_or_else(|| "unknown".into(), |p| format!("{:.1e} lx", p.0)),
            measured.unwrap_or_else(|_| "unknown".into())
        );
        pictures.push(drawing.picture);
    }
    let [width, height] = pictures[0].size().map(|n| n as usize);
    let bands = pictures[0].bands().clone();
    let row = width * bands.wavelengths.len();
    let mut radiance = Vec::with_capacity(2 * height * row * pictures.len());
    for y in 0..height {
        pictures.iter().for_each(|p| radiance.extend(&p.radiance()[y * row..][..row]));
    }
    for y in 0..height {
        for picture in &pictures {
            let pairs = picture.radiance()[y * row..][..row].iter().zip(&pictures[0].radiance()[y * row..][..row]);
            radiance.extend(pairs.map(|(a, b)| GAIN * (a - b).abs()));
        }
    }
    let size = [(width * pictures.len()) as u32, 2 * height as u32];
    let all = Picture::new(size, bands, radiance, None).expect("as many numbers as pixels");
    write_png(out.as_ref(), &all, &WriteOptions::default()).expect("the picture can be written");
    println!("wrote {out}");
}
