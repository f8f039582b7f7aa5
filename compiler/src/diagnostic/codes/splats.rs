//! E066x: files of 3D Gaussian splats.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0660",
        title: "a file holds no 3D Gaussian splats",
        explanation: "\
Splats are read from the PLY files of the original code of 3D Gaussian splatting and from SPZ files. Each point of the PLY
file must have `x y z`, `f_dc_0..2`, `opacity`, `scale_0..2` and `rot_0..3`; the message names what is missing. A mesh is a
surface: `surface s { shape = mesh(\"mesh.ply\") }`. Convert other formats (`.splat`, `.ksplat`, `.sog`) to one of these.
",
    },
    CodeInfo {
        code: "E0661",
        title: "a file of splats is broken",
        explanation: "\
The file does not keep to its format: a line of the header that is no part of it, a word where a number belongs, a number of
spherical harmonics that no degree has, or compressed data that do not decompress. Export or copy it again.
",
    },
    CodeInfo {
        code: "E0662",
        title: "a file of splats holds less than its header promises",
        explanation: "\
The file was cut off by an interrupted copy or download, or its header was edited. Nothing is drawn from part of a file.
",
    },
    CodeInfo {
        code: "E0663",
        title: "a file has no splat that could be seen",
        explanation: "\
The file says that it holds no splats, or each of them has a number that is not finite or a rotation of zero.
",
    },
    CodeInfo {
        code: "E0664",
        title: "a file has too many splats",
        explanation: "Up to 2^26 (67 million) splats are read. Prune the file first; what trains splats has a way to do that.",
    },
    CodeInfo {
        code: "E0665",
        title: "this version of SPZ is not read",
        explanation: "\
SPZ files of versions 2 and 3 are read. Version 1 was never released, and version 4 is built differently. Save the splats as
version 3 or as PLY.
",
    },
    CodeInfo {
        code: "W0660",
        title: "splats were left out",
        explanation: "\
Splats with a NaN or an infinite number (or one that does not fit 32-bit floating point) have no place or no size, and those
whose quaternion is zero have no orientation. They are left out. The message counts them and gives the first. Training that
diverged leaves some; a few do no harm.
",
    },
    CodeInfo {
        code: "W0661",
        title: "part of a file of splats is not used",
        explanation: "\
SPZ files may hold spherical harmonics of degree 4, of which those up to degree 3 are used, and extensions of other programs,
which are not read. Most extensions concern viewers; one changes the axes, and a picture on its side is then turned by
`transform`.
",
    },
];
