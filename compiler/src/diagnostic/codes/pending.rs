//! E09xx: parts of the language that are not there yet.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "W0903",
        title: "text is not drawn yet",
        explanation: "A `text` and its `style` are checked, but nothing of them is in the picture.",
    },
    CodeInfo {
        code: "W0904",
        title: "splats are not drawn on the GPU yet",
        explanation: "\
No backend of the GPU draws `splats` so far, and nothing of them is in the kernels that `vol emit` shows. Where the engine is not
chosen, scenes with splats are drawn on the processor; `--engine gpu` refuses them (E0909).
",
    },
    CodeInfo {
        code: "W0907",
        title: "this anti-aliasing is not there yet",
        explanation: "`none`, `analytic` and `ssaa(n)` are drawn as asked for; `msaa(n)`, `fxaa`, `smaa` and `taa` are drawn as \
`analytic` for now, which smooths the edges of shapes.",
    },
    CodeInfo {
        code: "E0908",
        title: "splats in light that is scattered many times are not there yet",
        explanation: "\
With `scattering = multiple` pictures are drawn along random paths, and splats are blended as they were fitted, which does not mix
with the mean over paths. Use `scattering = single`.
",
    },
    CodeInfo {
        code: "E0909",
        title: "splats of files are not drawn on the GPU yet",
        explanation: "Without an `--engine` the processor draws them, and so it does with `--engine cpu` and `--engine reference`.",
    },
];
