//! E05xx: lowering, analysis and backends.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0500",
        title: "the compiler contradicts itself",
        explanation: "A later stage found something that an earlier one had ruled out. This is a fault of the compiler, \
not of the scene.\n\nPlease report it together with the scene; rewriting the expression that is underlined usually \
avoids it.",
    },
    CodeInfo {
        code: "E0501",
        title: "the bounds of a loop must be constant",
        explanation: "`sum(i in 0..n)` and its kin become loops of the generated program, and how often they run decides \
how it is built. So the bounds must be known when compiling, once all functions are written out.\n\n\
```\nparam octaves = 5 in 1 .. 8\nmedium m { density = fbm(p / 1 m, octaves: octaves) }   // wrong: a param may change\n```\n\
```\nmedium m { density = fbm(p / 1 m, octaves: 5) }         // right\n```\n\
A `param` may weigh the terms of a loop; give terms you do not want the weight 0.",
    },
    CodeInfo {
        code: "E0502",
        title: "the bounds of a loop must be whole numbers",
        explanation: "A loop variable counts in steps of 1 from the first bound up to, but without, the second.\n\n\
```\nsum(i in 0..2.5) i          // wrong\nsum(i in 0..ceil(2.5)) i    // right: 0 + 1 + 2\n```",
    },
    CodeInfo {
        code: "E0503",
        title: "a loop runs too often",
        explanation: "A loop runs at every sample of every ray, so there are limits: 4096 iterations of one loop, about a \
million of nested loops taken together, and about sixteen million of all loops of a scene. Data of that size \
belongs into a `grid` or a `table`, which is read at one place only.",
    },
    CodeInfo {
        code: "E0504",
        title: "too many loops within each other",
        explanation: "Loops may be nested twelve deep, counting those of the functions that are called.",
    },
    CodeInfo {
        code: "E0505",
        title: "the scene is too large",
        explanation: "Functions are written out where they are called. A function that calls another twice, which calls \
another twice, and so on, doubles the scene at every level; exact derivatives make it larger too. The limit is about a \
million different operations, and 256 expressions within each other.\n\n\
Name a value with `let` instead of computing it twice in different ways, and repeat with `sum(i in 0..n)`.",
    },
    CodeInfo {
        code: "E0506",
        title: "this has no derivative",
        explanation: "`gradient(f, x)` is the exact derivative of `f` with respect to `x`. It exists for every operation of \
the language, with three exceptions: the derivative of a grid cannot be differentiated again (the slope of the \
interpolant has corners), a `product`, `min` or `max` may have at most 64 values, and the altitude `h` can only be \
differentiated with respect to `p`.",
    },
    CodeInfo {
        code: "E0507",
        title: "this shape has no bounds",
        explanation: "`center`, `size`, `min_corner` and `max_corner` need a bounding box. A `slab` and `everywhere` are \
infinite, and the extent of an `sdf` is not known.\n\n\
```\ncamera { to = center(intersection(sdf(d), box(min: (-1,-1,-1) m, max: (1,1,1) m))) }\n```",
    },
    CodeInfo {
        code: "E0508",
        title: "this must not be 0",
        explanation: "A scale by 0 flattens a medium and cannot be undone, an axis of length 0 points nowhere, a picture of \
height 0 shows nothing. The value is judged at the defaults of the params.",
    },
    CodeInfo {
        code: "E0509",
        title: "this cannot differ from place to place",
        explanation: "Shapes, transforms, entries of tables, the camera, the exposure and the background are the same for \
the whole picture: they may use constants, params and `time`, but not `p`, `dir` or grids. An environment may use `dir`.\n\n\
A shape that is given by a field is an `sdf(field)`.",
    },
    CodeInfo {
        code: "E0510",
        title: "there is no data to project",
        explanation: "`render { composite = maximum }`, `minimum`, `average` and `isosurface(value)` show the data itself: the \
one number that a medium's transfer function is asked with.\n\n\
```\nmedium scan { shape = bounds(head)  transfer = tissue(head(p)) }\nrender { composite = maximum }\n```",
    },
    CodeInfo {
        code: "E0511",
        title: "`h` needs a shell",
        explanation: "`h` is the altitude over the inner radius of the medium's `shell`, computed without cancellation at any \
radius. It has no meaning without a shell, or in one that `scale` stretches differently in different directions.",
    },
    CodeInfo {
        code: "E0512",
        title: "the camera sees nothing",
        explanation: "A camera needs a place, a different place to look at, an `up` that is not along the view, and a field of \
view between 0 and 180 degrees. `projection = panorama` looks all around.",
    },
    CodeInfo {
        code: "E0513",
        title: "this choice must be known when compiling",
        explanation: "`if` between numbers is made for every sample. Between shapes, transforms or grids it decides how the \
program is built, so its condition must be constant. Choose between numbers instead:\n\n\
```\nshape = sphere(center: (0,0,0) m, radius: if big then 2 m else 1 m)\n```",
    },
    CodeInfo {
        code: "E0514",
        title: "the extremum of no values",
        explanation: "An empty `sum` is 0 and an empty `product` 1, but `min` and `max` over an empty range have no value. \
The end of a range is excluded: `0..0` is empty.",
    },
    CodeInfo {
        code: "E0515",
        title: "a grid has no volume",
        explanation: "The header of the file gives axes for its voxels that lie in one plane, so that no position can be turned \
into voxel indices. Correct the orientation in the file.",
    },
    CodeInfo {
        code: "E0516",
        title: "a coefficient is negative or not finite",
        explanation: "Absorption, scattering and emission are 0 or larger, and finite. Where a field becomes negative only at \
some places, write `max(0 /m, …)`.",
    },
    CodeInfo {
        code: "E0517",
        title: "a phase function that scatters nothing, or less than nothing",
        explanation: "A phase function gives, for each cosine of the scattering angle, the share of light that is turned by it: \
0 or more everywhere, more than 0 somewhere, and finite when added up over the sphere. Its size does not matter, since it is \
normalised: 2π ∫₋₁¹ f dμ = 1.\n\n\
```\nmedium mist { k_s = 1 /m  phase = max(0, cos_theta) }\n```",
    },
    CodeInfo {
        code: "N0518",
        title: "a phase function was normalised",
        explanation: "Phase functions are normalised over the sphere, so that scattering neither adds nor loses light. This one \
was not, and every value is multiplied by the factor shown; where it depends on params, the factor follows them.",
    },
    CodeInfo {
        code: "E0520",
        title: "a medium without end has no closed form",
        explanation: "A ray that never leaves a medium is integrated to infinity where that is possible: coefficients that are \
uniform or exponential along the ray (`exp(-p.y / 8 km)`), and sums of these. Give other fields a shape:\n\n\
```\nmedium cloud { shape = sphere(center: (0,0,0) m, radius: 10 m)  k_a = fbm(p / 1 m)^2 / m }\n```",
    },
    CodeInfo {
        code: "E0521",
        title: "light without end",
        explanation: "A medium that reaches to infinity, shines and absorbs nothing would be infinitely bright. Give it a `k_a`, \
or a shape.",
    },
    CodeInfo {
        code: "E0522",
        title: "an isosurface of a gradient",
        explanation: "`composite = isosurface(value)` shades the surface by the gradient of the data. Where the data is itself \
made of a gradient, that would be a second derivative, which is not computed. Project with `maximum`, or take the isosurface \
of the grid itself.",
    },
    CodeInfo {
        code: "E0523",
        title: "a surface without a boundary",
        explanation: "A surface is the boundary of its shape, and `everywhere` has none. A floor is a `plane`:\n\n\
```\nsurface floor { shape = plane(point: (0,0,0) m, normal: (0,1,0)) }\n```",
    },
    CodeInfo {
        code: "E0524",
        title: "particles of `mie` that are not known when compiling",
        explanation: "The series of Mie's theory are summed by the compiler, once for each band, so the particles must be \
known to it: constants, or functions of `lambda`. A `param`, `time` or the position can weigh two kinds of particles:\n\n\
```\nparam age = 0.5 in 0 .. 1\nmedium fog { k_s = 0.1 /m  phase = mix(mie(radius: 2 um, index: 1.33), mie(radius: 8 um, index: 1.33), age) }\n```",
    },
    CodeInfo {
        code: "E0525",
        title: "particles that `mie` does not know",
        explanation: "A sphere has a radius above zero, an index n + ik with n above zero and k not below (k > 0 absorbs), and \
a `spread`, the geometric standard deviation of the radii, of 1 or more. It is computed for 2πr/λ from 1e-6 to 1e5, and its \
phase function up to 1e4: for smaller ones `rayleigh` is exact, and larger ones are better drawn with a smooth lobe. With a \
`spread`, all sizes that matter count, and large ones scatter most.",
    },
    CodeInfo {
        code: "E0526",
        title: "splats have no data to project",
        explanation: "\
The projections (`composite = maximum`, `minimum`, `average`, `isosurface`) show data of grids, of which splats have none. Remove
the splats, or draw the scene with `composite = radiance`.
",
    },
    CodeInfo {
        code: "N0526",
        title: "`mie` is less exact than usual",
        explanation: "The phase function of one size of particles has as many ripples as 2πr/λ is large, and its table up to \
16384 rows; an average over sizes sums as many of them as there is time for. Where that leaves more than a ten-thousandth of \
the value, it is said. Energy is not touched: the table is normalised as it is interpolated. Particles of nature are of many \
sizes, and with a `spread` their ripples vanish.",
    },
    CodeInfo {
        code: "W0527",
        title: "`mie` is far from exact",
        explanation: "As N0526, but by more than a twentieth: the ripples of the phase function are finer than its table, or \
more sizes matter than could be summed. Lobes and colours are right on the whole and wrong in detail. Give the particles a \
`spread`, or make it smaller.",
    },
    CodeInfo {
        code: "W0528",
        title: "bands that cannot show every colour",
        explanation: "Colours are given to the bands as smooth spectra, and a picture of many bands shows them as they are written. \
Two bands, or more that lie close together or beyond sight, cannot tell red, green and blue apart: a colour is seen through \
them as through a filter. White stays white. `spectral(n)` with n of 3 or more shows every colour.",
    },
    CodeInfo {
        code: "E0530",
        title: "a backend cannot draw this",
        explanation: "\
Every backend draws the same meaning, but not each can draw every scene. Slicing cuts media into slabs across the view, and \
splatting makes Gaussians on a lattice of them, so both need media with an end, a perspective or orthographic camera, and \
light that is scattered at most once; they do not project data (`composite`). The ray marcher draws all of these:

```vol
render { backend = raymarch }
```

Splats of files (`splats`) are drawn by splatting alone, which then integrates the media between them, with or without an end, and takes any
camera. `backend = auto` knows that:

```vol
render { backend = splatting }
```",
    },
    CodeInfo {
        code: "E0531",
        title: "light cannot be followed from slab to slab",
        explanation: "\
With `stacks = half_angle`, slicing puts its planes across half the angle between the view and the light, so that both meet the \
slabs in order, and keeps what light has lost in a buffer that goes along from slab to slab. That takes a single light from a \
single place, a sun without `angular_diameter` or a lamp that stands outside of the media, media that scatter it, and an \
adapter that blends f32. Planes across the view draw all light that there is:

```vol
render { backend = slicing  stacks = view }
```",
    },
    CodeInfo {
        code: "N0532",
        title: "pixels that are all drawn",
        explanation:
            "With `pixels = adaptive` the ray marcher draws some pixels and fills the others in from them. Here it draws all, \
for the reason that is given: with several rays for each pixel (`aa = ssaa(n)`), a given number of `steps`, random paths, \
projections of data, media whose outline is an `sdf`, or where closed forms make rays cheap. This works:

```vol
image { aa = analytic }
render { backend = raymarch  pixels = adaptive }
```",
    },
    CodeInfo {
        code: "E0590",
        title: "a number does not fit 32-bit floating point",
        explanation: "\
Scenes are worked out in 64-bit numbers, but a GPU computes in 32-bit ones, which end near 3.4e38. A number of the scene \
(perhaps one that the compiler worked out from constants) is larger than that, infinite, or not a number at all.

```vol
let strength = 1e30 * 1e30      // 1e60
```
Choose units or constants so that numbers stay between 1e-38 and 1e38:
```vol
let strength = 1e30
```",
    },
    CodeInfo {
        code: "E0591",
        title: "internal error in the shader",
        explanation: "\
The compiler made a shader that its own checks refuse. This is a mistake of the compiler, not of the scene. Please report \
it with the scene; until it is mended, writing the expression named in the message in another way may help.",
    },
    CodeInfo {
        code: "E0592",
        title: "a target cannot express the shader",
        explanation: "\
`vol emit` was asked for a shading language that lacks something the scene's shader needs, for instance enough bindings. \
Another target, such as `--target wgsl`, can express it.",
    },
];
