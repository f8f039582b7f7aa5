//! E03xx: types and dimensions.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0301",
        title: "a bare number where a unit is needed",
        explanation: "Lengths, times, coefficients and strengths of light have units, and the compiler checks them everywhere. Only `0` fits \
any dimension.\n\n\
```\nsphere(center: (0,0,0) m, radius: 1)      // wrong: one what?\nsphere(center: (0,0,0) m, radius: 1 m)    // right\n\
k_a = 2                                    // wrong\nk_a = 2 /m                                 // right: per metre\n```\n\
The units are `m km cm mm um nm`, `s ms`, `deg rad`, `sr`, `lx`, `px`.",
    },
    CodeInfo {
        code: "E0302",
        title: "the wrong dimension",
        explanation: "The value has a dimension, but another one than belongs here.\n\n\
```\nk_a = 2 m     // wrong: a length\nk_a = 2 /m    // right: a coefficient, per length\ndensity = p.y / 1 m   // right: a length over a length is a number\n```",
    },
    CodeInfo {
        code: "E0303",
        title: "the wrong kind of value",
        explanation: "A number where a vector belongs, a grid where a number belongs, and so on. A scalar widens to a vector or a spectrum by \
itself; nothing else converts silently.\n\n\
```\ndensity = head        // wrong: a grid\ndensity = head(p)     // right: its value at p\nshape = head          // wrong\nshape = bounds(head)  // right\n```",
    },
    CodeInfo {
        code: "E0304",
        title: "a function of plain numbers given a dimension",
        explanation: "`exp`, `log`, `sin` and their kin are defined for numbers. An optical depth, a coefficient times a length, is one.\n\n\
```\nexp(-p.y)           // wrong: e to the power of a length\nexp(-p.y / 8 km)    // right: over the height at which it falls to a third\n```",
    },
    CodeInfo {
        code: "E0305",
        title: "different dimensions side by side",
        explanation: "Only values of one dimension can be added, subtracted, compared, mixed or clamped.\n\n\
```\np.y + 1        // wrong: a length and a number\np.y + 1 m      // right\nmax(0, p.y)    // right: 0 fits any dimension\n```",
    },
    CodeInfo {
        code: "E0306",
        title: "a colour is not a coefficient",
        explanation: "A colour has components between 0 and 1 and no strength; a coefficient has a dimension and no upper bound. They never stand \
for each other. A colour times a number is a spectrum, which says how strong it is.\n\n\
```\nk_a = #336699                 // wrong\nk_a = rgb(0.8, 0.6, 0.4) / m  // right\nk_e = #336699 * 2 lx / m      // right\ncolor = rgb(1, 0, 0)          // wrong\ncolor = color(1, 0, 0)        // right, as is #f00\n```",
    },
    CodeInfo {
        code: "E0307",
        title: "an operator that does not fit its operands",
        explanation: "Arithmetic is for numbers, vectors and spectra; `*` also joins transforms; `&&`, `||` and `!` are for truth values. A \
vector and a spectrum do not mix: one has a component per axis, the other a value per band.",
    },
    CodeInfo {
        code: "E0308",
        title: "two sides of an `if` that differ",
        explanation: "An `if` is a value, so both sides must have one type and dimension.\n\n\
```\nif p.y > 0 m then 1 /m else 0.5     // wrong\nif p.y > 0 m then 1 /m else 0.5 /m  // right\nif p.y > 0 m then 1 /m else 0       // right: 0 fits any dimension\n```",
    },
    CodeInfo {
        code: "E0310",
        title: "a comparison of what has no order",
        explanation: "Comparisons are between numbers. Compare a component or the length of a vector. A spectrum has one value per band, and \
the bands may not agree: use `step(edge, x)` or `smoothstep(low, high, x)`, which choose band by band.",
    },
    CodeInfo {
        code: "E0311",
        title: "a power or root without dimension",
        explanation: "The dimension of `a ^ b` must be known, so `b` must be constant unless `a` is a plain number.\n\n\
```\n(2 m)^x         // wrong\n(2 m / 1 m)^x   // right\n(2 m)^2         // right: an area\n```",
    },
    CodeInfo {
        code: "E0312",
        title: "no such part",
        explanation: "Vectors have `.x .y .z` and combinations of them, colours `.r .g .b`, layers `.color` and `.k`. Spectra, grids and shapes \
have no parts; `center(g)`, `min_corner(g)`, `max_corner(g)` and `size(g)` are functions.",
    },
    CodeInfo {
        code: "E0313",
        title: "a missing argument",
        explanation: "Every parameter without a default needs an argument. Arguments are given in order or by name: \
`sphere((0,0,0) m, 1 m)` or `sphere(center: (0,0,0) m, radius: 1 m)`.",
    },
    CodeInfo {
        code: "E0314",
        title: "an argument of an unknown name",
        explanation: "Named arguments have the names of the parameters, followed by a colon: `sphere(center: (0,0,0) m, radius: 1 m)`.",
    },
    CodeInfo {
        code: "E0315",
        title: "too many arguments",
        explanation: "There are more arguments than parameters. The note shows the form of the function.",
    },
    CodeInfo {
        code: "E0316",
        title: "an argument given twice",
        explanation: "One parameter has two arguments: two by name, or one in order and one by name.",
    },
    CodeInfo {
        code: "E0317",
        title: "a type that does not exist",
        explanation: "The types are `number`, `length`, `time`, `light`, `vec2`, `vec3`, `spectrum`, `color`, `bool`, `string`, `layer`, `grid`, \
`shape`, `transform`; products, quotients and powers of dimensions such as `1/length`, `light/length`, `length^2`; and `vec3<length>`, \
`spectrum<1/length>` for vectors and spectra of them.\n\n\
```\nfn f(x: float) -> m = …          // wrong\nfn f(x: number) -> length = …    // right\n```",
    },
    CodeInfo {
        code: "E0318",
        title: "a tuple that is no vector",
        explanation: "A vector has two or three parts, all numbers of one dimension. A unit behind the tuple holds for all parts.\n\n\
```\n(0, 1 m, 2)     // wrong: 2 what?\n(0, 1, 2) m     // right\n```",
    },
    CodeInfo {
        code: "E0319",
        title: "a derivative that cannot be taken",
        explanation: "`gradient(f, p)` is the exact derivative of a scalar field with respect to a vec3 variable. The field is an expression of \
that variable, a grid by its name, or a function of one vec3 by its name.\n\n\
```\ngradient(head, p)               // of a grid\ngradient(length(p) / 1 m, p)    // of an expression of p\ngradient(puff, p / 1 m)         // of a function, at a point\n```",
    },
    CodeInfo {
        code: "E0320",
        title: "a value that must be known when compiling",
        explanation: "Constants, defaults and ranges of params, and properties that decide what is compiled must not depend on params, time or \
inputs. A function may: `fn name() -> number = 2 * my_param`.",
    },
    CodeInfo {
        code: "E0322",
        title: "a function that has no value per band",
        explanation: "A function of numbers may be called with a spectrum, such as `lambda`: it is then applied band by band. That needs every \
step in it to work band by band; a comparison of numbers does not, since the bands may not agree. Use `step`, `smoothstep` or a `table` \
inside it.",
    },
    CodeInfo {
        code: "W0302",
        title: "an angle of more than a turn without a unit",
        explanation: "Angles without a unit are radians.\n\n```\nrotate(axis: (0,1,0), angle: 90)      // 90 radians, over fourteen turns\nrotate(axis: (0,1,0), angle: 90 deg)  // a quarter turn\n```",
    },
];
