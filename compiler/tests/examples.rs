//! Every example, from text to validated WGSL: no file but the text is read, the brain's header is written here.

use compiler::diagnostic::render;
use compiler::emit::emit;
use compiler::loader::{GridHeader, LoadError, Loader, Scalar};
use compiler::{Compilation, Options, compile};

/// Gives every grid the header of the MNI template.
struct Template;

impl Loader for Template {
    fn module(&self, _from: &str, path: &str) -> Result<(String, String), LoadError> {
        Err(LoadError { code: "E0601", message: format!("there is no file `{path}`"), hint: None })
    }

    fn grid(&self, _from: &str, _path: &str) -> Result<GridHeader, LoadError> {
        Ok(GridHeader {
            dims: [197, 233, 189],
            scalar: Scalar::U8,
            slope: 1.0,
            intercept: 0.0,
            world_from_index: [[1e-3, 0.0, 0.0, -0.098], [0.0, 1e-3, 0.0, -0.134], [0.0, 0.0, 1e-3, -0.072]],
        })
    }
}

fn compiled(name: &str, text: &str, options: &Options) -> Compilation {
    compile(name, text, &Template, options)
}

const EXAMPLES: [(&str, &str); 6] = [
    ("glowing_ball", include_str!("../../examples/glowing_ball.vol")),
    ("brain", include_str!("../../examples/brain.vol")),
    ("nebula", include_str!("../../examples/nebula.vol")),
    ("cloud", include_str!("../../examples/cloud.vol")),
    ("overlap", include_str!("../../examples/overlap.vol")),
    ("haze", include_str!("../../examples/haze.vol")),
];

#[test]
fn every_example_becomes_wgsl() {
    for (name, text) in EXAMPLES {
        let out = compiled(name, text, &Options::default());
        let program = out.program.unwrap_or_else(|| panic!("{name}: {}", render(&out.diagnostics, &out.sources)));
        for kernel in &program.kernels {
            let shader = emit(kernel).unwrap_or_else(|e| panic!("{name}: {e}\n{e:?}"));
            let wgsl = shader.wgsl().unwrap();
            println!("==== {name}\n{}\n{wgsl}", compiler::program::print_ledger(&program.ledger, &out.sources));
        }
    }
}
