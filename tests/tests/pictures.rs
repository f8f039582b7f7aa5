//! Small pictures of every example, against those kept in `pictures/`, by the perceptual measure FLIP (Andersson et al. 2020).
//!
//! `TYNDALL_UPDATE_PICTURES=1` keeps what is drawn now. Look at the pictures before committing them.

use compiler::Options;
use runtime::frame::EngineChoice;
use runtime::image::metric::compare;
use runtime::image::{WriteOptions, read_png, write_png};
use std::path::Path;
use tyndall_tests::{draw, every_scene, name, open, root};

/// Mean FLIP below which two pictures count as the same: a tenth of what a viewer would notice.
const TOLERANCE: f64 = 0.01;

#[test]
fn examples_look_as_they_did() {
    every_scene("examples", |path| {
        let options = Options { size: Some([96, 96]), ..Options::default() };
        let drawing = draw(path, &mut open(path, options, EngineChoice::Gpu)?);
        let kept = root().join("tests/pictures").join(name(path)).with_extension("png");
        if std::env::var_os("TYNDALL_UPDATE_PICTURES").is_some() {
            write_png(&kept, &drawing.picture, &WriteOptions::default()).expect("the picture can be kept");
            return Some(vec![]);
        }
        let kept = read_png(&kept).unwrap_or_else(|e| panic!("{}: {e:?}", kept.display()));
        // Rounded to 8 bits like the one that is kept, which FLIP would see.
        let drawn = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name(path)).with_extension("png");
        write_png(&drawn, &drawing.picture, &WriteOptions::default()).expect("a scratch folder");
        let drawn = read_png(&drawn).unwrap_or_else(|e| panic!("{}: {e:?}", drawn.display()));
        let mean = compare(&kept, &drawn).expect("pictures of one size").flip;
        println!("{}: mean FLIP {mean:.5}", path.display());
        Some(if mean > TOLERANCE { vec![format!("looks different: mean FLIP {mean:.4}")] } else { vec![] })
    });
}
