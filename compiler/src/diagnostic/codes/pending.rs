//! E09xx: parts of the language that are not there yet.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "W0903",
        title: "text is not drawn yet",
        explanation: "A `text` and its `style` are checked, but nothing of them is in the picture.",
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
];
