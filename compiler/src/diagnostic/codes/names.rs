//! E02xx: names and modules.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0201",
        title: "a name that means nothing",
        explanation: "Nothing of this name is declared in the file, imported with `use`, built in or part of the library.\n\n\
```\nmedium m { density = exp(-q.y / 1 m) }   // wrong: what is q?\nmedium m { density = exp(-p.y / 1 m) }   // right: p is the position\n```\n\
Upper and lower case differ. Names of media, lights, styles and the like are not values.",
    },
    CodeInfo {
        code: "E0203",
        title: "two things of one name",
        explanation: "Functions, constants, params, tables, transfer functions, grids, splats and imported names share one set of names; \
media, lights, surfaces, styles and texts have a set each.\n\n\
```\nconst a = 1\nfn a(x: number) -> number = x      // wrong\nfn twice(x: number) -> number = x  // right\n```",
    },
    CodeInfo {
        code: "E0204",
        title: "a unit as a name",
        explanation: "The units `m km cm mm um nm s ms deg rad sr lx px` are words of the language everywhere, so that `2 m` can \
only mean two metres. Nothing else can have their names.\n\n\
```\nconst m = 4      // wrong\nconst mass = 4   // right\n```",
    },
    CodeInfo {
        code: "E0205",
        title: "an implicit input as a name",
        explanation: "Inside fields, `p` is the position, `dir` the direction of light, `lambda` the wavelength, `time` the time and `h` \
the altitude; in phase functions `cos_theta` is the cosine of the angle. An item of that name would hide them everywhere. \
Parameters of functions may have these names.\n\n\
```\nparam time = 1 s                             // wrong\nparam duration = 1 s                         // right\nfn wave(time: time) -> number = sin(time / 1 s)   // right\n```",
    },
    CodeInfo {
        code: "E0206",
        title: "an unknown module",
        explanation: "`use std::…` names a module of the library; a file of your own is named by its path in quotes, relative to the file \
that names it.\n\n```\nuse std::noises::fbm            // wrong\nuse std::noise::fbm             // right\nuse \"./my_lib.vol\"::puff        // right\n```",
    },
    CodeInfo {
        code: "E0207",
        title: "a module without this name",
        explanation: "The module exists, but declares nothing of this name that can be used. Functions, constants, params, tables, transfer \
functions and grids can be used; media, lights and other blocks belong to their scene.",
    },
    CodeInfo {
        code: "E0208",
        title: "modules that use each other in a circle",
        explanation: "A module is read before those that use it, so modules cannot use each other in a circle. Move what both need into a \
third file that uses neither.",
    },
    CodeInfo {
        code: "E0209",
        title: "recursion",
        explanation: "A function that calls itself, directly or through others, or a constant that is defined by itself, has no value that \
could be computed in bounded time on a GPU. Repetition is written with bounds that are known:\n\n\
```\nfn f(n: number) -> number = if n < 1 then 1 else n * f(n - 1)   // wrong\nfn f(n: number) -> number = product(i in 1..9) (if i <= n then i else 1)   // right\n```",
    },
    CodeInfo {
        code: "E0210",
        title: "an implicit input where it has no value",
        explanation: "`p`, `dir`, `lambda` and `h` have values only inside fields, where something is asked for at a place; `cos_theta` only in \
`phase`; `h` only in a medium whose shape has a `shell`. A function sees only its parameters, so that its value depends on \
nothing else:\n\n\
```\nfn puff() -> number = fbm(p / 1 m)                    // wrong\nfn puff(p: vec3<length>) -> number = fbm(p / 1 m)     // right\nmedium m { density = puff(p) }\n```",
    },
    CodeInfo {
        code: "E0211",
        title: "a name of the wrong kind",
        explanation: "A function needs its arguments, a value cannot be called, and a medium, light or style is no value at all.\n\n\
```\nmedium m { density = puff }       // wrong: a function\nmedium m { density = puff(p) }    // right: its value here\n```\nIn `phase` alone, a function of `cos_theta` is named without \
arguments: `phase = rayleigh`.",
    },
    CodeInfo { code: "E0214", title: "too many modules", explanation: "A scene consists of at most 256 files." },
    CodeInfo {
        code: "W0201",
        title: "an import that is never used",
        explanation: "Nothing in this file names it. Remove it from the `use`, or the whole `use`.",
    },
    CodeInfo {
        code: "W0202",
        title: "a name that hides a built-in one",
        explanation: "The item has the name of something that is built in. In this file the name means the item, which may surprise a \
reader; take another name unless that is what you want.",
    },
    CodeInfo {
        code: "W0203",
        title: "an item that is never used",
        explanation: "Nothing that is drawn depends on it. Remove it, or put `_` in front of its name to keep it for later.",
    },
];
