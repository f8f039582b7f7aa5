//! What the suites share: finding scenes, opening them on an engine, and the expectations that stand in the scenes themselves.

pub mod bonsai;
mod made;
pub mod splats;

pub use made::Made;

use compiler::Options;
use compiler::diagnostic::{Diagnostics, Severity};
use compiler::trial::Change;
use runtime::frame::{
    Camera, Cause, Drawing, EngineChoice, FileLoader, Params, ProbeSettings, RayAnswer, RayQuery, Session, Settings,
    Trouble,
};
use std::path::{Path, PathBuf};

/// The top folder of the project.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the project").to_owned()
}

/// Files with this ending in a folder of the project, sorted.
///
/// # Panics
/// If the folder cannot be read.
#[must_use]
pub fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(root().join(folder)).expect("the folder exists");
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == ending));
    files.sort();
    assert!(!files.is_empty(), "no .{ending} in {folder}");
    files
}

/// The text of a scene.
///
/// # Panics
/// If it cannot be read.
#[must_use]
pub fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The name of a scene without folder and ending.
///
/// # Panics
/// If it has none.
#[must_use]
pub fn name(path: &Path) -> &str {
    path.file_stem().and_then(|n| n.to_str()).expect("a scene has a name")
}

/// Runs a check on every scene of a folder, and fails with all that is wrong with any of them. `None` from the check says
/// that this machine cannot run it, which ends the test.
///
/// # Panics
/// If something is wrong.
pub fn every_scene(folder: &str, mut check: impl FnMut(&Path) -> Option<Vec<String>>) {
    let mut wrong = vec![];
    for path in files(folder, "vol") {
        let Some(found) = check(&path) else { return };
        wrong.extend(found.into_iter().map(|f| format!("{}: {f}", path.display())));
    }
    assert!(wrong.is_empty(), "{} things are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

/// Opens a scene; `None`, with a note, where the machine lacks the engine.
///
/// # Panics
/// If anything is wrong with the scene, or if the engine must be there (see [`runtime::engine::skip_without_adapter`]).
#[must_use]
pub fn open(path: &Path, options: Options, engine: EngineChoice) -> Option<Session> {
    let settings = Settings { options, engine, ..Settings::default() };
    let loader = FileLoader::new(path.parent().expect("a scene lies in a folder"));
    match Session::open(name(path), &text(path), &loader, settings) {
        Ok(session) => Some(session),
        Err(trouble) if trouble.cause == Cause::Machine => {
            runtime::engine::skip_without_adapter();
            None
        }
        Err(trouble) => fail(path, &trouble),
    }
}

/// Codes of the errors that a compilation finds, each once.
///
/// # Panics
/// If the scene cannot be read.
#[must_use]
pub fn codes(path: &Path, options: &Options) -> Vec<&'static str> {
    let loader = FileLoader::new(path.parent().expect("a scene lies in a folder"));
    errors(&compiler::compile(name(path), &text(path), &loader, options).diagnostics)
}

/// The same of a text that names no files.
#[must_use]
pub fn codes_of(text: &str, options: &Options) -> Vec<&'static str> {
    errors(&compiler::compile("scene.vol", text, &FileLoader::new(Path::new(".")), options).diagnostics)
}

fn errors(found: &Diagnostics) -> Vec<&'static str> {
    let mut codes: Vec<_> = found.iter().filter(|d| d.severity == Severity::Error).map(|d| d.code).collect();
    codes.dedup();
    codes
}

/// Ends the test with what an engine had to say.
///
/// # Panics
/// Always.
pub fn fail(path: &Path, trouble: &Trouble) -> ! {
    panic!("{}: {}", path.display(), compiler::diagnostic::render(&trouble.diagnostics, &trouble.sources))
}

/// A scene's picture with its parameters as written, at time 0.
///
/// # Panics
/// If it cannot be drawn.
pub fn draw(path: &Path, session: &mut Session) -> Drawing {
    let params = Params::defaults(&session.program().lowered);
    session.draw(&params, 0.0, &|_| {}).unwrap_or_else(|t| fail(path, &t))
}

/// The root of the mean square of what two pictures differ by, over pixels and bands, in lx.
#[must_use]
pub fn rms(a: &Drawing, b: &Drawing) -> f64 {
    let (a, b) = (a.picture.radiance(), b.picture.radiance());
    let sum: f64 = a.iter().zip(b).map(|(x, y)| f64::from(x - y).powi(2)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

/// Opens a scene that names no files on the GPU; `None` where there is none.
///
/// # Panics
/// If anything is wrong with the scene, or if the engine must be there.
#[must_use]
pub fn open_text(text: &str, options: Options) -> Option<Session> {
    let settings = Settings { options, engine: EngineChoice::Gpu, ..Settings::default() };
    match Session::open("scene.vol", text, &FileLoader::new(Path::new(".")), settings) {
        Ok(session) => Some(session),
        Err(trouble) if trouble.cause == Cause::Machine => {
            runtime::engine::skip_without_adapter();
            None
        }
        Err(trouble) => fail(Path::new("scene.vol"), &trouble),
    }
}

/// Radiance and transmittance of every pixel of such a scene.
///
/// # Panics
/// If it cannot be drawn.
#[must_use]
pub fn draw_text(text: &str, options: Options) -> Option<(Vec<f32>, Vec<f32>)> {
    let mut session = open_text(text, options)?;
    let picture = draw(Path::new("scene.vol"), &mut session).picture;
    Some((picture.radiance().to_vec(), picture.transmittance().expect("it is asked for").to_vec()))
}

/// The expectations of a scene with the answers of an engine; `None` where the machine lacks the engine.
///
/// # Panics
/// If the scene expects nothing, or cannot be probed.
#[must_use]
pub fn probe(path: &Path, options: Options, engine: EngineChoice) -> Option<Vec<(Expectation, RayAnswer)>> {
    let wanted = expectations(&text(path));
    assert!(!wanted.is_empty(), "{} expects nothing", path.display());
    let stretch = if let Some(Change::Lengths(factor)) = options.change { factor } else { 1.0 };
    let mut session = open(path, options, engine)?;
    // A scene of another size is seen from places as far away.
    let query = |e: &Expectation| RayQuery { origin: e.origin.map(|x| x * stretch), direction: e.direction };
    let rays: Vec<RayQuery> = wanted.iter().map(query).collect();
    let answers = follow(path, &mut session, &rays);
    Some(wanted.into_iter().zip(answers).collect())
}

/// The rays through the middles of a picture's pixels, row by row from the top.
///
/// # Panics
/// If the scene has no camera at its parameters as written.
#[must_use]
pub fn pixel_rays(session: &Session, [w, h]: [u32; 2]) -> Vec<RayQuery> {
    let scene = &session.program().lowered;
    let params = Params::defaults(scene);
    let camera = Camera::from_scene(scene, &params.0, 0.0).expect("a camera").with_size([w, h]);
    let middles = (0..h).flat_map(|y| (0..w).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5)));
    let rays = middles.map(|(x, y)| camera.ray(x, y));
    rays.map(|(o, direction)| RayQuery { origin: o.map(|v| v * scene.units.length), direction }).collect()
}

/// Follows rays with the parameters as written, at time 0.
///
/// # Panics
/// If they cannot be followed.
pub fn follow(path: &Path, session: &mut Session, rays: &[RayQuery]) -> Vec<RayAnswer> {
    let params = Params::defaults(&session.program().lowered);
    session.probe(&params, rays, &ProbeSettings::default()).unwrap_or_else(|t| fail(path, &t))
}

/// One line `//? ray ox,oy,oz dx,dy,dz | radiance a b c | transmittance … | depth … // note`: what a ray must find.
/// One number stands for all bands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expectation {
    /// Metres.
    pub origin: [f64; 3],
    /// Of any length.
    pub direction: [f64; 3],
    /// Per band, if it is given.
    pub radiance: Option<Vec<f64>>,
    /// Per band, if it is given.
    pub transmittance: Option<Vec<f64>>,
    /// Per band, if it is given; may be infinite.
    pub depth: Option<Vec<f64>>,
    /// The line itself.
    pub line: String,
}

/// The expectations of a scene.
///
/// # Panics
/// If a line is not understood: a test that is not read cannot fail.
#[must_use]
pub fn expectations(text: &str) -> Vec<Expectation> {
    text.lines()
        .filter_map(|line| Some((line, line.strip_prefix("//? ray ")?)))
        .map(|(line, rest)| one(line, rest))
        .collect()
}

/// What the GPU may be off by, where a scene says so in a line `//? gpu 1e-3 // why`; else a ten-thousandth.
///
/// # Panics
/// If the line is not understood.
#[must_use]
pub fn gpu_tolerance(text: &str) -> f64 {
    let line = text.lines().find_map(|line| line.strip_prefix("//? gpu "));
    line.map_or(1e-4, |rest| {
        let (number, why) = rest.split_once("//").expect("a reason");
        assert!(!why.trim().is_empty(), "a reason");
        number.trim().parse().expect("a number")
    })
}

fn one(line: &str, rest: &str) -> Expectation {
    let number = |x: &str| -> f64 { x.trim().parse().unwrap_or_else(|_| panic!("no number `{x}` in `{line}`")) };
    let rest = rest.split("//").next().unwrap_or(rest);
    let mut parts = rest.split('|').map(str::trim);
    let mut points = parts.next().unwrap_or("").split_whitespace().map(|p| {
        let numbers: Vec<f64> = p.split(',').map(number).collect();
        <[f64; 3]>::try_from(numbers).unwrap_or_else(|_| panic!("three numbers in `{line}`"))
    });
    let mut out = Expectation { line: line.to_owned(), ..Expectation::default() };
    out.origin = points.next().expect("an origin");
    out.direction = points.next().expect("a direction");
    for part in parts {
        let (word, values) = part.split_once(' ').unwrap_or_else(|| panic!("a word and numbers in `{part}`"));
        let values: Vec<f64> = values.split_whitespace().map(number).collect();
        match word {
            "radiance" => out.radiance = Some(values),
            "transmittance" => out.transmittance = Some(values),
            "depth" => out.depth = Some(values),
            other => panic!("unknown word `{other}` in `{line}`"),
        }
    }
    out
}
