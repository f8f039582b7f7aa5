//! Names that the language itself gives a meaning.

/// Implicit inputs of fields and phase functions.
pub(crate) const INPUTS: &[&str] = &["p", "dir", "lambda", "time", "h", "cos_theta"];

/// Values that are always there.
pub(crate) const CONSTANTS: &[&str] = &["pi", "tau", "e", "everywhere"];

/// Functions of the prelude that are not written in the library.
pub(crate) const FUNCTIONS: &[&str] = &[
    "exp",
    "expm1",
    "log",
    "log2",
    "log10",
    "exp2",
    "sqrt",
    "cbrt",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "sinh",
    "cosh",
    "tanh",
    "abs",
    "sign",
    "floor",
    "ceil",
    "round",
    "fract",
    "atan2",
    "min",
    "max",
    "pow",
    "mod",
    "clamp",
    "mix",
    "step",
    "smoothstep",
    "dot",
    "cross",
    "length",
    "distance",
    "normalize",
    "reflect",
    "vec2",
    "vec3",
    "rgb",
    "luminance",
    "color",
    "layer",
    "opacity",
    "gradient",
    "cell_hash",
    "cell_hash3",
    "sphere",
    "ellipsoid",
    "box",
    "slab",
    "cylinder",
    "shell",
    "bounds",
    "sdf",
    "everywhere",
    "union",
    "intersection",
    "difference",
    "center",
    "min_corner",
    "max_corner",
    "size",
    "translate",
    "rotate",
    "scale",
];

/// Whether the language itself gives this name a meaning as a value or a function.
pub(crate) fn is_builtin(name: &str) -> bool {
    CONSTANTS.contains(&name) || FUNCTIONS.contains(&name)
}
