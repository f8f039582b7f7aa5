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
        title: "splats are not drawn yet",
        explanation: "`splats` are checked, but nothing of them is in the picture.",
    },
    CodeInfo {
        code: "W0907",
        title: "this anti-aliasing is not there yet",
        explanation: "`none`, `analytic` and `ssaa(n)` are drawn as asked for; `msaa(n)`, `fxaa`, `smaa` and `taa` are drawn as \
`analytic` for now, which smooths the edges of shapes.",
    },
];
