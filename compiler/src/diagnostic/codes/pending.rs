//! E09xx: parts of the language that are not there yet.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "W0901",
        title: "in-scattered light is not drawn yet",
        explanation: "The scene has something that scatters and light to scatter. The picture shows how scattering weakens the \
light that passes (extinction), and emission, but not yet the light that is scattered towards the eye: it is \
`scattering = none` for now. Write that in `render` to silence the warning.",
    },
    CodeInfo {
        code: "W0902",
        title: "surfaces are not drawn yet",
        explanation: "A `surface` is checked, but rays pass through it, and it casts no shadow.",
    },
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
        code: "E0905",
        title: "the backend `slicing` is not there yet",
        explanation: "Only the ray marcher can draw so far. Write `backend = raymarch`, or `auto`, which picks what there is.",
    },
    CodeInfo {
        code: "E0906",
        title: "the backend `splatting` is not there yet",
        explanation: "Only the ray marcher can draw so far. Write `backend = raymarch`, or `auto`, which picks what there is.",
    },
    CodeInfo {
        code: "W0907",
        title: "this anti-aliasing is not there yet",
        explanation: "`none`, `analytic` and `ssaa(n)` are drawn as asked for; `msaa(n)`, `fxaa`, `smaa` and `taa` are drawn as \
`analytic` for now, which smooths the edges of shapes.",
    },
    CodeInfo {
        code: "E0912",
        title: "`bands = spectral(n)` is not there yet",
        explanation: "Pictures have up to four bands so far: `rgb`, `gray`, or a list of wavelengths.",
    },
    CodeInfo {
        code: "E0913",
        title: "more than four bands are not there yet",
        explanation: "Pictures have up to four bands so far. Draw several with up to four each.",
    },
];
