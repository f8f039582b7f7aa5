//! E04xx: items, properties and values.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0401",
        title: "an unknown property",
        explanation: "Each kind of block has its own properties; the note lists them.\n\n\
```\nmedium m { absorption = 1 /m }   // wrong\nmedium m { k_a = 1 /m }          // right\n```",
    },
    CodeInfo { code: "E0402", title: "a property given twice", explanation: "A block has each property once." },
    CodeInfo {
        code: "E0403",
        title: "a missing property",
        explanation: "Most properties have defaults, but some blocks mean nothing without one: a `grid` without its `file`, a `surface` without \
its `shape`, a light without its strength.",
    },
    CodeInfo {
        code: "E0404",
        title: "properties that exclude each other",
        explanation: "Some properties are two ways to say one thing: `k_t` with `albedo` stands for `k_a` with `k_s`, `mean_free_path` for `k_t`, \
`transfer` for `k_a` with `k_e`.\n\n\
```\nmedium m { k_t = 4 /m  k_a = 1 /m }           // wrong\nmedium m { k_t = 4 /m  albedo = 0.75 }        // right\nmedium m { k_a = 1 /m  k_s = 3 /m }           // right, the same\n```",
    },
    CodeInfo {
        code: "E0405",
        title: "more than one camera, image, render or fog",
        explanation: "A scene has at most one of each; those that are missing have defaults.",
    },
    CodeInfo {
        code: "E0406",
        title: "a value that the property does not have",
        explanation: "Some properties take one of a few words, or a form of their own: `image.size = 1024 x 768`, `image.aa = smaa`, \
`camera.projection = orthographic(height: 2 m)`. Words are written without quotes.",
    },
    CodeInfo {
        code: "E0407",
        title: "a param in a structural property",
        explanation: "Params are live controls: moving one must not compile anything anew. So they cannot decide what is compiled: the size of the \
picture, its bands, the name of a file, a number of steps. Write a number there, or name one with `const`.",
    },
    CodeInfo {
        code: "E0408",
        title: "a number out of range",
        explanation: "The number has the right type, but no meaning here: an accuracy of zero, a picture without pixels, an albedo above 1, a field of \
view of 45 radians.\n\n```\ncamera { fov = 45 }        // wrong: radians\ncamera { fov = 45 deg }    // right\n```",
    },
    CodeInfo {
        code: "E0409",
        title: "an infinite constant, or one that is no number",
        explanation: "The value is known when compiling, and is infinite or not a number: `1 / 0`, `log(0)`, `sqrt(-1)`.",
    },
    CodeInfo {
        code: "E0410",
        title: "a negative coefficient",
        explanation: "Media absorb, scatter and emit zero or more; lights have a strength of zero or more. A difference that may fall below zero is held \
with `max(0, …)`.",
    },
    CodeInfo {
        code: "E0411",
        title: "an asymmetry of 1 or more",
        explanation: "`g` is the mean cosine of the scattering angle and lies between -1 and 1, as does Schlick's `k`. At 1 all light would go straight on, \
which is no scattering at all, and the formula divides by zero.",
    },
    CodeInfo {
        code: "E0412",
        title: "a direction that is none",
        explanation: "A direction of length zero, a camera at the point it looks at, or one that looks along its own `up`: no picture follows from it.",
    },
    CodeInfo {
        code: "E0413",
        title: "a shape without inside",
        explanation: "A radius of zero or less, a box whose `min` lies above its `max`, a slab whose `from` lies beyond its `to`.\n\n\
```\nbox(min: (1,1,1) m, max: (0,0,0) m)    // wrong\nbox(min: (0,0,0) m, max: (1,1,1) m)    // right\n```",
    },
    CodeInfo {
        code: "E0414",
        title: "a row of the wrong form",
        explanation: "A row of a `table` is `key: value`; a stop of a `transfer` is `key: colour, extinction`.\n\n\
```\ntransfer t { 30: #000  90: #fff }              // wrong: how dense?\ntransfer t { 30: #000, 0 /m  90: #fff, 20 /m } // right\n```",
    },
    CodeInfo {
        code: "E0415",
        title: "keys that do not ascend",
        explanation: "Rows stand in ascending order of their keys. Two equal keys make a jump; the later one holds at the key itself.",
    },
    CodeInfo {
        code: "E0416",
        title: "a param outside its range",
        explanation: "The range of a param is written from low to high and includes its ends; the param starts inside it.\n\n\
```\nparam d = 5 in 0 .. 1    // wrong\nparam d = 0.5 in 0 .. 1  // right\n```",
    },
    CodeInfo {
        code: "E0417",
        title: "a light of no kind, or of several",
        explanation: "A light is parallel (`direction`, `irradiance`), a point (`position`, `intensity`) or a sky (`environment`).\n\n\
```\nlight sun  { direction = (0, -1, 0)  irradiance = 5 lx }\nlight lamp { position = (0, 2, 0) m  intensity = 10 lx * m^2 }\nlight sky  { environment = rgb(0.3, 0.5, 0.9) * lx }\n```",
    },
    CodeInfo {
        code: "E0418",
        title: "a list of bands that cannot be",
        explanation: "A picture has 1 to 64 bands: `bands = [680 nm, 550 nm, 440 nm]`, each wavelength above zero, or `bands = \
spectral(16)`. More would be closer than the tables of what the eye sees. Each four bands are a program of their own, which \
is compiled and drawn after the others, so that the cost grows with their number.",
    },
    CodeInfo {
        code: "W0402",
        title: "nothing to draw",
        explanation: "The scene has no medium, fog, surface, text, splats or environment, so every pixel shows the background.",
    },
    CodeInfo {
        code: "W0403",
        title: "a medium without effect",
        explanation: "The medium neither absorbs (`k_a`), nor scatters (`k_s`), nor emits (`k_e`), so nothing of it can be seen.",
    },
    CodeInfo {
        code: "W0404",
        title: "a property without effect",
        explanation: "The property is right, but nothing depends on it here: a `phase` where nothing scatters.",
    },
    CodeInfo {
        code: "W0405",
        title: "a shape without thickness",
        explanation: "A box whose `min` and `max` agree along an axis, or a slab or shell of no thickness, holds nothing, so nothing of it can be seen.",
    },
    CodeInfo {
        code: "W0406",
        title: "a band that cannot be seen",
        explanation: "A list of two, or of four or more wavelengths is shown through CIE XYZ, which ends at 380 and 780 nm. What is \
beyond is computed, and is in EXR and NPY files and in probes, but adds nothing to what a PNG shows. One band is shown grey, and \
three as red, green and blue in their order, whatever they are.",
    },
    CodeInfo {
        code: "W0407",
        title: "planes that nothing draws",
        explanation:
            "`stacks` says which planes slicing cuts media with. Other backends have none, so that it changes nothing:

```vol
render { backend = slicing  stacks = half_angle }
```",
    },
];
