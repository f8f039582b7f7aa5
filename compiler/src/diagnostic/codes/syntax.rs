//! E01xx: syntax.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0101",
        title: "something else must stand here",
        explanation: "\
The text stops following the grammar at this place, and none of the usual mistakes explains it. The message says what
could stand there and what was found.

Wrong:

    medium cloud = { k_a = 2 /m }

Right:

    medium cloud { k_a = 2 /m }
",
    },
    CodeInfo {
        code: "E0102",
        title: "a bracket is never closed",
        explanation: "\
Each `(`, `[` and `{` needs its closing bracket. The mark stands at the opening one; the missing one belongs somewhere
between there and the place the second mark points at.

Wrong:

    medium ball { shape = sphere(center: (0, 0, 0 m, radius: 1 m) }

Right:

    medium ball { shape = sphere(center: (0, 0, 0) m, radius: 1 m) }
",
    },
    CodeInfo {
        code: "E0103",
        title: "a closing bracket does not fit",
        explanation: "\
Either nothing is open where the bracket stands, or what is open is of another kind.

Wrong:

    const a = max(1, 2))
    const b = [1, 2)

Right:

    const a = max(1, 2)
    const b = [1, 2]
",
    },
    CodeInfo {
        code: "E0104",
        title: "a text in quotes is never closed",
        explanation: "\
Text stands between two `\"` on one line. A line break inside is written `\\n`, a quotation mark `\\\"`.

Wrong:

    grid head { file = \"head.nii }

Right:

    grid head { file = \"head.nii\" }
",
    },
    CodeInfo {
        code: "E0105",
        title: "a comment is never closed",
        explanation: "\
A comment that starts with `/*` ends with `*/`. Comments nest, so that a part with comments in it can be put into a
comment as a whole; each `/*` inside needs a `*/` of its own.

Wrong:

    /* the old sky /* too bright */
    light sky { environment = 1 lx }

Right:

    /* the old sky /* too bright */ */
    light sky { environment = 1 lx }
",
    },
    CodeInfo {
        code: "E0106",
        title: "an escape in quotes is unknown",
        explanation: "\
Inside quotes a backslash starts one of `\\n` (line break), `\\t` (tabulator), `\\\"`, `\\\\` and `\\u{…}` (a character by its
number in Unicode, one to six hexadecimal digits). Paths are written with `/` on every system.

Wrong:

    grid head { file = \"data\\head.nii\" }

Right:

    grid head { file = \"data/head.nii\" }
",
    },
    CodeInfo {
        code: "E0107",
        title: "a number is written in a way that is not read",
        explanation: "\
A number starts with a digit, a decimal point needs a digit after it (`0..10` is a range), and so does an `e`.

Wrong:

    const a = .5
    const b = 1.
    const c = 3e

Right:

    const a = 0.5
    const b = 1
    const c = 3e0
",
    },
    CodeInfo {
        code: "E0108",
        title: "a number is out of range",
        explanation: "\
Numbers are IEEE doubles, up to about 1.8e308; a number that would become infinite, or 0 though it is not, is refused.
Sizes are whole numbers of pixels up to 4294967295, powers of units whole numbers up to 1000.

Wrong:

    const huge = 1e999

Right:

    const huge = 1e99
",
    },
    CodeInfo {
        code: "E0109",
        title: "a colour is not written as one",
        explanation: "\
A colour is `#` and 3, 6 or 8 hexadecimal digits: `#rgb`, `#rrggbb`, `#rrggbbaa`.

Wrong:

    style caption { fill = #ff }

Right:

    style caption { fill = #ff0000 }
",
    },
    CodeInfo {
        code: "E0110",
        title: "there is no such unit",
        explanation: "\
A word directly after a number is a unit. The units are `m km cm mm um nm` (length), `s ms` (time), `deg rad` (angle), `sr`
(solid angle), `lx` (light) and `px` (a length on the picture). They are written without plural and in lower case.

Wrong:

    medium ball { shape = sphere(center: (0, 0, 0) m, radius: 2 meters) }

Right:

    medium ball { shape = sphere(center: (0, 0, 0) m, radius: 2 m) }
",
    },
    CodeInfo {
        code: "E0111",
        title: "two values stand side by side",
        explanation: "\
Between two values stands an operator, or a comma if they are arguments. There is one exception: a number or a tuple of
numbers may be followed by a unit. Every other product is written with `*`.

Wrong:

    medium cloud { k_a = 2 1/m  k_e = rgb(1, 2, 3) lx / m }

Right:

    medium cloud { k_a = 2 /m  k_e = rgb(1, 2, 3) * lx / m }
",
    },
    CodeInfo {
        code: "E0112",
        title: "no item starts with this word",
        explanation: "\
A scene is a list of items, and each starts with its word: `use`, `const`, `param`, `fn`, `table`, `transfer`, `grid`, `medium`,
`light`, `splats`, `surface`, `fog`, `style`, `text`, `camera`, `image` or `render`. Shapes are values of a property, and a value
with a name is a `const`.

Wrong:

    volume cloud { k_a = 2 /m }
    radius = 3 m

Right:

    medium cloud { k_a = 2 /m }
    const radius = 3 m
",
    },
    CodeInfo {
        code: "E0113",
        title: "a name is missing, or stands where none belongs",
        explanation: "\
Every item has a name, a single word, except `fog`, `camera`, `image` and `render`, of which there is at most one.

Wrong:

    medium { k_a = 2 /m }
    camera main { fov = 40 deg }

Right:

    medium cloud { k_a = 2 /m }
    camera { fov = 40 deg }
",
    },
    CodeInfo {
        code: "E0114",
        title: "`=` or `:` is missing or mistaken for the other",
        explanation: "\
Properties, constants and params are given with `=`. Arguments of a call are named with `:`, and so are keys of rows.

Wrong:

    medium ball { shape: sphere(center = (0, 0, 0) m, radius = 1 m) }

Right:

    medium ball { shape = sphere(center: (0, 0, 0) m, radius: 1 m) }
",
    },
    CodeInfo {
        code: "E0115",
        title: "a separator stands where there is none",
        explanation: "\
Items and properties stand side by side, on one line or on several. Only arguments and parts of tuples and lists are
separated, by commas. A `let` may end with `;`.

Wrong:

    medium cloud { k_a = 2 /m, k_s = 1 /m; }

Right:

    medium cloud { k_a = 2 /m  k_s = 1 /m }
",
    },
    CodeInfo {
        code: "E0116",
        title: "there is no such operator",
        explanation: "\
The operators are `|| && == != < <= > >= + - * / ! ^`. Powers are written `^`, conditions are joined with `&&`, `||` and `!`.
Values never change, so that there is neither `+=` nor `++`.

Wrong:

    const a = 2 ** 3
    const b = if a > 1 and a < 9 then 1 else 0

Right:

    const a = 2 ^ 3
    const b = if a > 1 && a < 9 then 1 else 0
",
    },
    CodeInfo {
        code: "E0117",
        title: "a value is missing",
        explanation: "\
After `=`, an operator, a comma or an opening parenthesis a value must follow.

Wrong:

    medium cloud { k_a =  k_s = 2 /m * }

Right:

    medium cloud { k_a = 1 /m  k_s = 2 /m }
",
    },
    CodeInfo {
        code: "E0118",
        title: "a word of the language is used as a name",
        explanation: "\
`if`, `then`, `else`, `let`, `true`, `false` and `in` are never names. The words that start items (`light`, `text`, …) are names
everywhere else.

Wrong:

    const in = 3

Right:

    const inner = 3
",
    },
    CodeInfo {
        code: "E0119",
        title: "a text is too deep or too large",
        explanation: "\
Brackets, `if`s and `sum`s may stand inside each other 64 deep, comments too; an expression may be 256 operations high; a
text may have 64 MiB. This keeps every later step within a fixed stack. A name for a part makes it flat.

Wrong: `a + a + …` a thousand times.

Right:

    const total = sum(i in 0..1000) a
",
    },
    CodeInfo {
        code: "E0120",
        title: "comparisons do not chain",
        explanation: "\
`a < b < c` would compare the truth of `a < b` with `c`.

Wrong:

    const inside = if 0 < x < 1 then 1 else 0

Right:

    const inside = if 0 < x && x < 1 then 1 else 0
",
    },
    CodeInfo {
        code: "E0121",
        title: "the power of a unit is not one whole number",
        explanation: "\
A unit beside a number takes its power with it: `2 m^-1` is 2·(m^-1). That power is a whole number, and there is one. To
raise the whole quantity, put it in parentheses.

Wrong:

    const side = 9 m^0.5

Right:

    const side = (9 m)^0.5
",
    },
    CodeInfo {
        code: "E0122",
        title: "a character is not of the language",
        explanation: "\
Word processors and other languages write some signs differently: typographic quotation marks, real minus and times signs,
superscripts, the degree sign, `%`, `?`, single quotes.

Wrong:

    camera { fov = 45° }
    const area = 3 × 4

Right:

    camera { fov = 45 deg }
    const area = 3 * 4
",
    },
    CodeInfo {
        code: "E0123",
        title: "a size is not written as one",
        explanation: "\
A size is two whole numbers around an `x`, closed up or with space on both sides.

Wrong:

    image { size = 1024 x768 }

Right:

    image { size = 1024 x 768 }
",
    },
    CodeInfo {
        code: "E0124",
        title: "an import is not written as one",
        explanation: "\
`use` names a module and, after the last `::`, one name or several in braces. They keep their names. Elsewhere names are
written alone, without a path.

Wrong:

    use std::noise::*
    use \"my_lib.vol\"

Right:

    use std::noise::{fbm, worley}
    use \"my_lib.vol\"::puff
",
    },
    CodeInfo {
        code: "E0125",
        title: "a row of a table or transfer function is not written as one",
        explanation: "\
A row is a key, a `:` and its values, separated by commas: one value in a `table`, a colour and a coefficient in a `transfer`.
Rows stand side by side, so keys and values are products; a sum is put in parentheses.

Wrong:

    table density { 0 km: 1, 11 km: 0.3 }

Right:

    table density { 0 km: 1  11 km: 0.3 }
",
    },
    CodeInfo {
        code: "E0126",
        title: "a function is not written as one",
        explanation: "\
A function says the type of each parameter, the type of its result, and after `=` its value.

Wrong:

    fn puff(q) { max(0, fbm(q)) }

Right:

    fn puff(q: vec3) -> number = max(0, fbm(q))
",
    },
    CodeInfo {
        code: "E0127",
        title: "a conditional lacks a part",
        explanation: "\
`if c then a else b` is a value, so that all three parts are needed.

Wrong:

    medium floor { k_a = if p.y < 0 m then 1 /m }

Right:

    medium floor { k_a = if p.y < 0 m then 1 /m else 0 /m }
",
    },
    CodeInfo {
        code: "E0128",
        title: "a block is not written as one",
        explanation: "\
A block in a value is a list of `let`s and, last, the value itself. A `let` names no type.

Wrong:

    const a = { x = 3  let y: number = 4 }

Right:

    const a = { let x = 3  let y = 4  x * y }
",
    },
    CodeInfo {
        code: "W0101",
        title: "a unit belongs to the divisor",
        explanation: "\
A unit binds more tightly than any operator, so that `1/2 deg` is 1 / (2 deg), an inverse angle, and not half a degree.

Doubtful:

    camera { fov = 1/2 deg }

Clear:

    camera { fov = 0.5 deg }
    const per_angle = 1 / (2 deg)
",
    },
];
