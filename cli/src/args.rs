//! The command line.

use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use compiler::ir::{Backend, Pixels, Scattering};
use runtime::engine::gpu::AdapterChoice;
use runtime::frame::EngineChoice;
use std::path::PathBuf;

/// Tyndall, the language for light in matter: draws .vol scenes.
#[derive(Debug, Parser)]
#[command(name = "vol", version, arg_required_else_help = true, subcommand_required = true)]
pub(crate) struct Arguments {
    /// How results and diagnostics are printed. JSON goes to standard output, one document
    #[arg(long, global = true, value_enum, default_value = "human")]
    pub(crate) format: Format,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Names of all commands, in the order of the help.
pub(crate) fn command_names() -> Vec<String> {
    Arguments::command().get_subcommands().map(|c| c.get_name().to_owned()).collect()
}

#[derive(Copy, Clone, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// For people
    Human,
    /// For programs
    Json,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Draw a scene
    Render(Box<Render>),
    /// Print what is wrong with scenes, and nothing else
    Check(Check),
    /// Print what the compiler made of a scene
    Emit(Emit),
    /// Follow rays: radiance, transmittance and optical depth along each
    Probe(Box<Probe>),
    /// Draw error against run time: every backend and engine, coarser and finer, against the reference
    Report(Box<Report>),
    /// Put a scene through a numerical trial: extremes of params, lengths, cameras, coefficients, voxels and sizes
    Stress(Stress),
    /// Bring scenes into the one format
    Fmt(Fmt),
    /// Print the long form of a diagnostic, or a list of all of them
    Explain(Explain),
    /// Print what this machine offers, and what is missing
    Doctor,
    /// Write a starter scene into a folder
    New(New),
}

/// What draws, and how well.
#[derive(Debug, Args)]
pub(crate) struct Schedule {
    /// Instead of `render.backend`
    #[arg(long, value_enum)]
    pub(crate) backend: Option<BackendName>,
    /// Instead of `render.scattering`
    #[arg(long, value_enum)]
    pub(crate) scattering: Option<ScatteringName>,
    /// Instead of `render.accuracy`
    #[arg(long, allow_hyphen_values = true, value_parser = positive)]
    pub(crate) accuracy: Option<f64>,
    /// Instead of `render.steps`
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) steps: Option<u32>,
    /// Slabs that slicing cuts the media into, instead of `render.slices`
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65535))]
    pub(crate) slices: Option<u32>,
    /// Splats that splatting makes of the media, about, instead of `render.splats`
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    pub(crate) splats: Option<u32>,
    /// Which pixels are drawn, instead of `render.pixels`
    #[arg(long, value_enum)]
    pub(crate) pixels: Option<PixelsName>,
    /// Paths of each pixel or ray with `scattering = multiple`, instead of `render.samples`
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) samples: Option<u32>,
    /// Of random numbers, and of the pixels that are compared with the reference
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

impl Schedule {
    pub(crate) fn apply(&self, options: compiler::Options) -> compiler::Options {
        compiler::Options {
            backend: self.backend.map(BackendName::backend),
            scattering: self.scattering.map(ScatteringName::scattering),
            accuracy: self.accuracy,
            steps: self.steps,
            slices: self.slices,
            splats: self.splats,
            pixels: self.pixels.map(PixelsName::pixels),
            samples: self.samples,
            ..options
        }
    }
}

/// Which engine and which adapter.
#[derive(Debug, Args)]
pub(crate) struct EngineArguments {
    /// What computes: a graphics adapter, the processor, or the trusted reference. Default: an adapter if there is one
    #[arg(long, value_enum)]
    pub(crate) engine: Option<EngineName>,
    /// A part of the name of the graphics adapter to use (also from TYNDALL_ADAPTER)
    #[arg(long)]
    pub(crate) adapter: Option<String>,
}

impl EngineArguments {
    pub(crate) fn choice(&self) -> (EngineChoice, AdapterChoice) {
        let engine = match self.engine {
            None => EngineChoice::Auto,
            Some(EngineName::Gpu) => EngineChoice::Gpu,
            Some(EngineName::Cpu) => EngineChoice::Cpu,
            Some(EngineName::Reference) => EngineChoice::Reference,
        };
        let adapter = match &self.adapter {
            Some(name) => AdapterChoice { name: Some(name.clone()), ..AdapterChoice::default() },
            None => AdapterChoice::from_env(),
        };
        (engine, adapter)
    }
}

#[derive(Debug, Args)]
pub(crate) struct Render {
    /// The scene; `-` reads it from standard input
    pub(crate) scene: String,
    /// The picture: .png, .exr (linear, one channel per band) or .npy. With --frames a name with %04d
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Set a parameter: `density=6` in SI, or with a unit: `"height=2 km"`. Repeats
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true)]
    pub(crate) set: Vec<String>,
    /// Pixels, instead of `image.size`
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    #[command(flatten)]
    pub(crate) schedule: Schedule,
    #[command(flatten)]
    pub(crate) engine: EngineArguments,
    /// Draw several pictures, both ends included
    #[arg(long, value_name = "A..B", value_parser = frames)]
    pub(crate) frames: Option<(u32, u32)>,
    /// Frames per second of `time` with --frames
    #[arg(long, default_value_t = 24.0, allow_hyphen_values = true, value_parser = positive)]
    pub(crate) fps: f64,
    /// Seconds; with --frames, of frame 0
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    pub(crate) time: f64,
    /// Bits of a PNG sample
    #[arg(long, default_value = "8", value_parser = ["8", "16"])]
    pub(crate) depth: String,
    /// Do not compare 256 pixels with the reference
    #[arg(long)]
    pub(crate) no_check: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Check {
    /// The scenes; `-` reads one from standard input
    #[arg(required = true)]
    pub(crate) scenes: Vec<String>,
    /// Treat warnings as errors
    #[arg(long, value_name = "WHAT", value_parser = ["warnings"])]
    pub(crate) deny: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct Emit {
    /// The scene; `-` reads it from standard input
    pub(crate) scene: String,
    /// What to print
    #[arg(long, value_enum, default_value = "wgsl")]
    pub(crate) target: Target,
    /// Write to a file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// The source map: into FILE.map.json beside -o, else instead of the text
    #[arg(long)]
    pub(crate) map: bool,
    /// What was left out, and the line that made it unneeded, instead of the text
    #[arg(long, conflicts_with = "map")]
    pub(crate) explain: bool,
    #[command(flatten)]
    pub(crate) schedule: Schedule,
}

#[derive(Copy, Clone, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Target {
    /// WebGPU
    Wgsl,
    /// Vulkan, binary
    Spirv,
    /// OpenGL
    Glsl,
    /// Direct3D
    Hlsl,
    /// Metal
    Msl,
    /// The field graph after the passes
    Ir,
    /// What is bound, filled and dispatched
    Plan,
    /// The field graph for Graphviz
    Graph,
    /// The module in naga's own form
    Naga,
}

impl Target {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Wgsl => "wgsl",
            Self::Spirv => "spirv",
            Self::Glsl => "glsl",
            Self::Hlsl => "hlsl",
            Self::Msl => "msl",
            Self::Ir => "ir",
            Self::Plan => "plan",
            Self::Graph => "graph",
            Self::Naga => "naga",
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct Probe {
    /// The scene; `-` reads it from standard input
    pub(crate) scene: String,
    /// Origin in metres and direction. Repeats
    #[arg(long, value_name = "ox,oy,oz dx,dy,dz", allow_hyphen_values = true, value_parser = ray)]
    pub(crate) ray: Vec<[f64; 6]>,
    /// A file with one ray a line: ox,oy,oz,dx,dy,dz
    #[arg(long, value_name = "FILE.csv")]
    pub(crate) rays: Option<PathBuf>,
    /// Set a parameter: `density=6` in SI, or with a unit: `"height=2 km"`. Repeats
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true)]
    pub(crate) set: Vec<String>,
    #[command(flatten)]
    pub(crate) schedule: Schedule,
    #[command(flatten)]
    pub(crate) engine: EngineArguments,
    /// Relative tolerance of the reference
    #[arg(long, default_value_t = 1e-10, allow_hyphen_values = true, value_parser = positive)]
    pub(crate) rtol: f64,
    /// Seconds
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    pub(crate) time: f64,
}

#[derive(Debug, Args)]
pub(crate) struct Report {
    /// The scene; `-` reads it from standard input. Of several each gets a folder of its own, and an index is made of them
    #[arg(required = true, value_name = "SCENE")]
    pub(crate) scenes: Vec<String>,
    /// The folder for report.html, report.json, report.csv and report.svg; made if it does not exist
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Seconds that each may take, about; what does not fit is left out, and the report says what
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", allow_hyphen_values = true, value_parser = positive)]
    pub(crate) budget: f64,
    /// Set a parameter: `density=6` in SI, or with a unit: `"height=2 km"`. Repeats
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true)]
    pub(crate) set: Vec<String>,
    /// Pixels, instead of a small picture of the scene's shape
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Only this backend
    #[arg(long, value_enum)]
    pub(crate) backend: Option<BackendName>,
    /// Instead of `render.scattering`
    #[arg(long, value_enum)]
    pub(crate) scattering: Option<ScatteringName>,
    /// Instead of `render.accuracy`, for what the scene itself would choose
    #[arg(long, allow_hyphen_values = true, value_parser = positive)]
    pub(crate) accuracy: Option<f64>,
    /// Of random numbers
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) engine: EngineArguments,
    /// Seconds
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    pub(crate) time: f64,
}

#[derive(Debug, Args)]
pub(crate) struct Stress {
    /// The scene; `-` reads it from standard input. Without one, scenes that are carried along put the program itself on trial
    pub(crate) scene: Option<String>,
    /// Seconds that each scene may take, about; what does not fit is left out, and is listed [default: 60, invented scenes 2]
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = positive)]
    pub(crate) budget: Option<f64>,
    /// Invent so many scenes at random, each of which is tried as it stands; `--seed` is the number of the first
    #[arg(long, value_name = "COUNT", conflicts_with = "scene")]
    pub(crate) invent: Option<u64>,
    /// Write the invented scene of this number to standard output instead, and try nothing
    #[arg(long, value_name = "NUMBER", conflicts_with_all = ["scene", "invent"])]
    pub(crate) show: Option<u64>,
    /// Set a parameter in every case that does not set it itself. Repeats
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true)]
    pub(crate) set: Vec<String>,
    /// Only this backend
    #[arg(long, value_enum)]
    pub(crate) backend: Option<BackendName>,
    /// Of random numbers
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) engine: EngineArguments,
}

#[derive(Debug, Args)]
pub(crate) struct Fmt {
    /// The scenes, rewritten in place; `-` goes from standard input to standard output
    #[arg(required = true)]
    pub(crate) scenes: Vec<String>,
    /// Change nothing; exit 1 if something would change
    #[arg(long)]
    pub(crate) check: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Explain {
    /// A code such as E0301
    pub(crate) code: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct New {
    /// The folder; made if it does not exist
    pub(crate) folder: PathBuf,
}

#[derive(Copy, Clone, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EngineName {
    /// A graphics adapter
    Gpu,
    /// The processor, at the scene's accuracy
    Cpu,
    /// The trusted one in f64
    Reference,
}

#[derive(Copy, Clone, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackendName {
    /// The compiler chooses
    Auto,
    /// Along each ray
    Raymarch,
    /// Slice by slice
    Slicing,
    /// Splat by splat
    Splatting,
}

impl BackendName {
    pub(crate) fn backend(self) -> Backend {
        match self {
            Self::Auto => Backend::Auto,
            Self::Raymarch => Backend::Raymarch,
            Self::Slicing => Backend::Slicing,
            Self::Splatting => Backend::Splatting,
        }
    }
}

#[derive(Copy, Clone, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ScatteringName {
    /// Emission and extinction
    None,
    /// Light scattered once
    Single,
    /// All orders
    Multiple,
}

impl ScatteringName {
    pub(crate) fn scattering(self) -> Scattering {
        match self {
            Self::None => Scattering::None,
            Self::Single => Scattering::Single,
            Self::Multiple => Scattering::Multiple,
        }
    }
}

#[derive(Copy, Clone, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelsName {
    /// All of them
    Every,
    /// As many as it takes; the others are filled in from those around them
    Adaptive,
}

impl PixelsName {
    pub(crate) fn pixels(self) -> Pixels {
        match self {
            Self::Every => Pixels::Every,
            Self::Adaptive => Pixels::Adaptive,
        }
    }
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = |part: &str| part.trim().parse::<u32>().ok().filter(|n| *n > 0);
    let sides = text.split_once(['x', '×', 'X']).and_then(|(w, h)| Some([parse(w)?, parse(h)?]));
    sides.ok_or_else(|| "a size is two whole numbers of pixels, such as 640x480".into())
}

fn frames(text: &str) -> Result<(u32, u32), String> {
    let range = text.split_once("..").and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    range.filter(|(a, b)| a <= b).ok_or_else(|| "frames are a range such as 0..99, both ends included".into())
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|n| *n > 0.0 && n.is_finite());
    number.ok_or_else(|| "this is a number greater than 0".into())
}

/// Six numbers, separated by commas or spaces.
pub(crate) fn ray(text: &str) -> Result<[f64; 6], String> {
    let numbers: Option<Vec<f64>> =
        text.split([',', ' ', '\t', ';']).filter(|p| !p.is_empty()).map(|p| p.parse().ok()).collect();
    numbers
        .and_then(|n| <[f64; 6]>::try_from(n).ok())
        .ok_or_else(|| "a ray is an origin and a direction: \"ox,oy,oz dx,dy,dz\"".into())
}
