//! E063x and E064x: what a machine lacks, and arguments of the command line.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0630",
        title: "there is no graphics adapter, or none of that name",
        explanation: "\
`--engine gpu` needs an adapter with a driver for Vulkan, Metal or Direct3D 12. `vol doctor` lists those that there are.
On Linux the package `mesa-vulkan-drivers` has one in software that needs no hardware. Without `--engine`, scenes are
drawn by the processor then; `--engine cpu` asks for that. `--adapter` and the variable TYNDALL_ADAPTER take a part of an
adapter's name.
",
    },
    CodeInfo {
        code: "E0631",
        title: "the graphics adapter cannot hold the scene",
        explanation: "\
A grid has more voxels along a side than the adapter's textures may have, or the scene uses more grids or larger tables
than it takes. `vol doctor` prints the limits. Draw with `--engine cpu`, on another adapter, or with a smaller grid.
",
    },
    CodeInfo {
        code: "E0632",
        title: "the graphics device was lost",
        explanation: "\
The driver was reset, the device was removed, or a watchdog ended work that took too long. Drawings are cut into short
pieces against the last. If it happens again, the system's log has the driver's reason; `--engine cpu` does without.
",
    },
    CodeInfo {
        code: "E0633",
        title: "the graphics memory is full",
        explanation: "\
Grids are held at their own precision, once; tiles need less than 256 MiB whatever the picture's size. Close other
programs that use the adapter, crop or halve the grids, or draw with `--engine cpu`.
",
    },
    CodeInfo {
        code: "E0634",
        title: "the GPU engine made a mistake",
        explanation: "\
wgpu refused something that the engine asked for. That is never the scene's fault: please report it with the scene and
the whole message. `--engine cpu` draws meanwhile.
",
    },
    CodeInfo {
        code: "E0635",
        title: "the graphics driver failed",
        explanation: "\
The driver could not open the device or could not compile a shader that is valid. Update it, choose another adapter with
`--adapter`, or draw with `--engine cpu`.
",
    },
    CodeInfo {
        code: "E0640",
        title: "`--set` names no parameter",
        explanation: "\
`--set name=value` changes a `param` of the scene. Constants cannot be set: declare what is to be changed as

    param density = 4 /m in 0 /m .. 40 /m
",
    },
    CodeInfo {
        code: "E0641",
        title: "the value of `--set` does not fit",
        explanation: "\
The value is a number in SI units, or an expression of the language with its unit: `--set height=2000`,
`--set \"height=2 km\"`, `--set \"tint=#ff8040\"`, `--set \"wind=(1, 0, 0) m\"`, `--set clouds=true`. Its dimension and its
kind must be those of the parameter.
",
    },
    CodeInfo {
        code: "E0642",
        title: "the folder of a report cannot be written",
        explanation: "\
`vol report scene.vol -o DIR` writes DIR/report.html, DIR/report.json and DIR/report.csv, over older ones. The folder is made
if it does not exist; what stands in its place must not be a file.
",
    },
    CodeInfo {
        code: "E0643",
        title: "the reference is not compared with itself",
        explanation: "\
`vol report` and `vol stress` compare every picture with that of the reference engine. `--engine gpu` and `--engine cpu` leave
the other out.
",
    },
    CodeInfo {
        code: "E0645",
        title: "there is no diagnostic of that code",
        explanation: "\
`vol explain` without a code lists all that there are.
",
    },
    CodeInfo {
        code: "E0646",
        title: "a file is there already",
        explanation: "\
`vol new` writes nothing over anything. Choose another folder, or move the file away.
",
    },
    CodeInfo {
        code: "E0647",
        title: "a target cannot be printed like that",
        explanation: "\
SPIR-V is binary: write it to a file with `-o`. Source maps exist for the text targets `wgsl`, `glsl`, `hlsl` and `msl`.
",
    },
    CodeInfo {
        code: "E0648",
        title: "a ray cannot be read",
        explanation: "\
A ray is an origin in metres and a direction of any length but zero, six numbers: `--ray \"0,0,-4 0,0,1\"`. A file of
`--rays` has one ray a line, `ox,oy,oz,dx,dy,dz`, with comments after `#` and at most one heading.
",
    },
    CodeInfo {
        code: "E0649",
        title: "the name of a picture does not fit",
        explanation: "\
The ending says what is written: `.png`, `.exr` or `.npy`. With `--frames` the name needs a place for the number, as in
`frame%04d.png`.
",
    },
    CodeInfo {
        code: "W0640",
        title: "a parameter is set outside its range",
        explanation: "\
The range of a `param` is what its author thought sensible. Values outside are used as they are.
",
    },
    CodeInfo {
        code: "W0680",
        title: "a coefficient goes negative",
        explanation: "\
Light cannot be absorbed, scattered or emitted a negative number of times. The medium was looked at in some places along
lines through its shape, with params at their defaults; where a picture meets such a place it is an error (E0650). Noise
goes below 0, and so does CT data:

    density = max(0, fbm(p / 1 m, octaves: 4))
",
    },
    CodeInfo {
        code: "W0681",
        title: "a medium is empty",
        explanation: "\
Intervals of its fields prove that all its coefficients are 0 wherever it is, with params at their defaults: a threshold
that nothing passes, or a shape that lies beside the matter.
",
    },
    CodeInfo {
        code: "N0682",
        title: "nothing is seen through a medium",
        explanation: "\
Optical depths of 50 let e^-50 of the light through. Nothing is wrong with that where a solid is meant; where mist is meant,
its coefficients are too large by far, often for a missing unit prefix (/mm for /m). `opacity(0.5, per: 1 cm)` says
directly how much is let through.
",
    },
    CodeInfo {
        code: "N0683",
        title: "a shape is far larger than the matter in it",
        explanation: "\
The medium was looked at in some places along lines through its shape, and what was found lies in a small part of it. A
smaller shape costs less wherever bounds of the fields are not known, and gives rays a better start where they are.
",
    },
    CodeInfo {
        code: "W0684",
        title: "steps are longer than what they should find",
        explanation: "\
With a fixed number of `steps` (or `--steps`) a ray looks at as many places and no others: a shell or a spike of a table
that is narrower than a step is met by chance, which looks like rings or noise. With `accuracy` steps end before what is narrow.
",
    },
    CodeInfo {
        code: "N0685",
        title: "a difference was rewritten, since its digits cancel",
        explanation: "\
Where x is near 0, e^x is near 1, and the difference of the two has only the digits that are left of it: of 1 - exp(-1e-7) a
32-bit number keeps one. The compiler computes expm1 there, which has all of them; nothing needs to be done. To say in the
scene what is meant, write `expm1(x)`.
",
    },
];
