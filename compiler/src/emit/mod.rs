//! Kernels to shaders: the only room that names naga. A kernel becomes a validated `naga::Module`, and that WGSL, SPIR-V,
//! GLSL, HLSL, MSL, and a source map.
//!
//! naga has no optimiser and no memory of the scene: what a kernel says is what is written, in that order. Each `let` of a
//! kernel is one line under a name that is unique in the module, and that is all the source map rests on.

mod builder;
mod keywords;
mod lower;
mod names;
mod source_map;
#[cfg(test)]
mod tests;
mod write;

pub use source_map::{MapEntry, MapLine, SourceMap};

use crate::diagnostic::Diagnostic;
use crate::program::kernel::Kernel;
use crate::source::Span;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

/// A validated compute shader.
#[derive(Clone, Debug)]
pub struct Shader {
    /// The module: one entry point, resources in group 0.
    pub module: naga::Module,
    /// What the validator found out about it; the writers need it.
    pub info: ModuleInfo,
    /// Name of the entry point in every target but GLSL, which calls it `main`.
    pub entry: String,
    origins: Vec<source_map::Origin>,
    calls: Vec<lower::CallName>,
}

/// Why there is no shader.
#[derive(Clone, Debug, PartialEq)]
pub enum EmitError {
    /// A number that f32 cannot hold: not finite, or beyond ±3.4·10³⁸.
    Number {
        /// The number.
        value: f64,
        /// The nearest place in the scene.
        span: Option<Span>,
    },
    /// The kernel is wrong: a mistake of a backend.
    Kernel(String),
    /// naga refuses the module: a mistake here.
    Module {
        /// What naga says.
        message: String,
        /// The module as WGSL, or as naga prints it where it cannot be written.
        text: String,
    },
    /// A target cannot express the shader.
    Target {
        /// `WGSL`, `SPIR-V`, `GLSL`, `HLSL` or `MSL`.
        target: &'static str,
        /// What naga says.
        message: String,
    },
}

impl std::fmt::Display for EmitError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number { value, .. } => write!(f, "the number {value:e} does not fit 32-bit floating point"),
            Self::Kernel(message) => write!(f, "internal error: a kernel is wrong: {message}"),
            Self::Module { message, .. } => write!(f, "internal error: naga refuses a shader: {message}"),
            Self::Target { target, message } => write!(f, "the shader cannot be written as {target}: {message}"),
        }
    }
}

impl std::error::Error for EmitError {}

impl EmitError {
    /// The error as a finding about the scene.
    #[must_use]
    pub fn diagnostic(&self) -> Diagnostic {
        match self {
            Self::Number { span, .. } => {
                let d = Diagnostic::error("E0590", self.to_string())
                    .hint("choose units so that the number lies between 1e-38 and 1e38");
                span.map_or(d.clone(), |span| d.at(span, "this makes it"))
            }
            Self::Kernel(_) => Diagnostic::error("E0591", self.to_string()).hint("please report this with the scene"),
            Self::Module { text, .. } => Diagnostic::error("E0591", self.to_string())
                .hint("please report this with the scene")
                .note(format!("the shader was:\n{text}")),
            Self::Target { .. } => {
                Diagnostic::error("E0592", self.to_string()).hint("choose another target, such as `--target wgsl`")
            }
        }
    }
}

/// Makes the shader of a kernel.
///
/// # Errors
/// A number that f32 cannot hold, or an internal error: a kernel that its verifier refuses, or a module that naga refuses.
pub fn emit(kernel: &Kernel) -> Result<Shader, EmitError> {
    crate::program::verify(kernel).map_err(EmitError::Kernel)?;
    let lowered = lower::lower(kernel)?;
    // No capability beyond the base of WebGPU: nothing that a kernel can say needs one.
    let validated = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&lowered.module);
    let lower::Lowered { module, origins, calls, entry } = lowered;
    match validated {
        Ok(info) => Ok(Shader { module, info, entry, origins, calls }),
        Err(error) => {
            let unchecked = Validator::new(ValidationFlags::empty(), Capabilities::all()).validate(&module);
            let flags = naga::back::wgsl::WriterFlags::empty();
            let text = unchecked.ok().and_then(|info| naga::back::wgsl::write_string(&module, &info, flags).ok());
            let text = text.unwrap_or_else(|| format!("{module:#?}"));
            Err(EmitError::Module { message: chain(&error.into_inner()), text })
        }
    }
}

/// An error with all that caused it, in one line.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        text.push_str(": ");
        text.push_str(&cause.to_string());
        next = cause.source();
    }
    text
}
