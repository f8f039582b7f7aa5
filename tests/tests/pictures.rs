//! Small pictures of every example, against those kept in `pictures/`, by the perceptual measure FLIP (Andersson et al. 2020).
//!
//! `TYNDALL_UPDATE_PICTURES=1` keeps what is drawn now. Look at the pictures before committing them.

use compiler::Options;
use runtime::frame::{Cause, EngineChoice, FileLoader, Params, Session, Settings};
use runtime::image::metric::compare;
use runtime::image::{WriteOptions, read_png, write_png};
use tyndall_tests::{files, root};

/// Mean FLIP below which two pictures count as the same: a tenth of what a viewer would notice.
const TOLERANCE: f64 = 0.01;

#[test]
fn examples_look_as_they_did() {
    let mut wrong = vec![];
    for path in files("examples", "vol") {
        let name = path.file_stem().and_then(|n| n.to_str()).expect("a name").to_owned();
        let text = std::fs::read_to_string(&path).expect("the scene is text");
        let options = Options { size: Some([96, 96]), ..Options::default() };
        let settings = Settings { options, engine: EngineChoice::Gpu, ..Settings::default() };
        let mut session = match Session::open(&name, &text, &FileLoader::new(root().join("examples")), settings) {
            Ok(session) => session,
            Err(trouble) if trouble.cause == Cause::Machine => return runtime::engine::skip_without_adapter(),
            Err(trouble) => panic!("{}", compiler::diagnostic::render(&trouble.diagnostics, &trouble.sources)),
        };
        let params = Params::defaults(&session.program().lowered);
        let drawing = session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| panic!("{:?}", t.diagnostics));
        let kept = root().join("tests/pictures").join(&name).with_extension("png");
        if std::env::var_os("TYNDALL_UPDATE_PICTURES").is_some() {
            write_png(&kept, &drawing.picture, &WriteOptions::default()).expect("the picture can be kept");
            continue;
        }
        let kept = read_png(&kept).unwrap_or_else(|e| panic!("{}: {e:?}", kept.display()));
        // Rounded to 8 bits like the one that is kept, which FLIP would see.
        let drawn = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
        write_png(&drawn, &drawing.picture, &WriteOptions::default()).expect("a scratch folder");
        let drawn = read_png(&drawn).unwrap_or_else(|e| panic!("{name}: {e:?}"));
        let mean = compare(&kept, &drawn).expect("pictures of one size").flip;
        println!("{name}: mean FLIP {mean:.5}");
        if mean > TOLERANCE {
            wrong.push(format!("{name}: mean FLIP {mean:.4}"));
        }
    }
    assert!(wrong.is_empty(), "these look different: {}", wrong.join(", "));
}
