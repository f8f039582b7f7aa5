//! E06xx: data files and run time. 01 to 10 are volume files, 11 to 19 meshes, 20 to 29 pictures; engines take 30 and up.

use super::CodeInfo;

pub(super) const CODES: &[CodeInfo] = &[
    CodeInfo {
        code: "E0601",
        title: "a file is missing or cannot be read",
        explanation: "\
The path in the scene is taken relative to the file that names it, not to the folder in which `vol` was started.
Folders, pipes and devices are not read.

Wrong, for a scene in `scenes/` and a file `scenes/data/head.nii.gz`:

    grid head { file = \"scenes/data/head.nii.gz\" }

Right:

    grid head { file = \"data/head.nii.gz\" }
",
    },
    CodeInfo {
        code: "E0602",
        title: "the kind of a volume file is not known",
        explanation: "\
Volumes are read from NIfTI-1 and NIfTI-2 (`.nii`, `.nii.gz`, a pair `.hdr` + `.img`) and from NRRD (`.nrrd`, `.nhdr`).
The content decides, not the ending. Convert other formats (DICOM, MetaImage, VTK, raw, ANALYZE) with the program that
made them, with `dcm2niix`, or with ITK; for bare voxels, write a `.nhdr` beside them:

    NRRD0004
    type: uint16
    dimension: 3
    sizes: 512 512 300
    spacings: 0.5 0.5 1
    encoding: raw
    endian: little
    data file: head.raw
",
    },
    CodeInfo {
        code: "E0603",
        title: "the header of a volume file is broken",
        explanation: "\
The file says which format it has but does not keep to it: a required field is missing, a number cannot be one, or the
file ends inside its header. The message names the field. Write the file again with a current version of the program
that made it.
",
    },
    CodeInfo {
        code: "E0604",
        title: "a volume file holds fewer voxels than its header promises",
        explanation: "\
The file was cut off (an interrupted copy or download), or its header was written for another file. The message gives
both numbers. Nothing is drawn from part of a volume, since a picture with a missing part looks like a picture.
",
    },
    CodeInfo {
        code: "E0605",
        title: "the sample type of a volume file cannot be a grid",
        explanation: "\
A grid is one real number per voxel: 8- to 64-bit integers, 32- or 64-bit floating point. Colours, complex numbers,
single bits and opaque blocks are not. Split the components into files of their own and read one grid from each:

    grid red { file = \"red.nrrd\" }
    grid green { file = \"green.nrrd\" }
",
    },
    CodeInfo {
        code: "E0606",
        title: "a volume file has more than three axes, or more than one value a voxel",
        explanation: "\
A grid has three axes in space and one value a voxel. A further axis is allowed while it has one sample. Take one time
step or one component out first, for example with `fslroi in.nii.gz out.nii.gz 0 1` or `unu slice -a 3 -p 0`.
",
    },
    CodeInfo {
        code: "E0607",
        title: "the orientation of a volume file cannot be used",
        explanation: "\
The map from voxels to space must be finite and have an inverse, or the voxels would have no place. It does not if a
spacing is zero, if a number is NaN or infinite, or if two axes point the same way. Correct the header: in NIfTI the
sform (`srow_x`, `srow_y`, `srow_z`) counts first, then the qform, then `pixdim`; in NRRD `space directions`, then
`spacings`.
",
    },
    CodeInfo {
        code: "E0608",
        title: "a volume is too large",
        explanation: "\
Volumes of up to 16 GiB of voxels are read, if the machine has the memory. If the size in the message is not what you
expect, the header is broken. Otherwise cut the volume to the part that is seen, or halve its resolution.
",
    },
    CodeInfo {
        code: "E0609",
        title: "the encoding of a volume file is not read",
        explanation: "\
NRRD files may be `raw`, `gzip`, `text` or `hex`, with their voxels in one file. bzip2 and lists of files are not read.
Write the file again as one with gzip: `unu save -f nrrd -e gzip -i in.nrrd -o out.nrrd`.
",
    },
    CodeInfo {
        code: "E0610",
        title: "the voxels of a file cannot be decoded",
        explanation: "\
The compressed stream is damaged (its checksum or its structure is wrong), or text among the voxels is no number that
fits their type, such as `300` in a grid of 8-bit numbers. Copy the file again.
",
    },
    CodeInfo {
        code: "E0611",
        title: "the kind of a mesh file is not known",
        explanation: "\
Triangles are read from Wavefront OBJ (`.obj`) and from PLY (`.ply`, as text or binary). A PLY file is known by its first
word, an OBJ file by its ending and by its corners (`v`) and faces (`f`). Convert STL, glTF, FBX and others in the program
that made them, or with Blender or MeshLab. Coordinates are metres.
",
    },
    CodeInfo {
        code: "E0612",
        title: "a mesh file is broken",
        explanation: "\
The file does not keep to its format: a line that is no part of it, a word where a number belongs, a face of fewer than
three corners, or corners without `x`, `y` and `z`. The message names the line or the element. Export the file again.
",
    },
    CodeInfo {
        code: "E0613",
        title: "a mesh file holds less than its header promises",
        explanation: "\
The header of a PLY file says how many corners and faces follow; fewer do. The file was cut off by an interrupted copy or
download, or its header was edited. Nothing is drawn from part of a mesh.
",
    },
    CodeInfo {
        code: "E0614",
        title: "a face names a corner that does not exist",
        explanation: "\
Faces name their corners by number: in OBJ from 1, or from −1 backwards, in PLY from 0. The number in the message is
outside of what the file has. Files put together from several by hand are a usual cause: the numbers of the second part
must be raised by the corners of the first.
",
    },
    CodeInfo {
        code: "E0615",
        title: "a mesh has no triangle that could be seen",
        explanation: "\
The file has corners but no faces, or all of its triangles have no area or a corner that is not finite. Clouds of points,
lines, free-form curves and triangle strips are not read: export polygons.
",
    },
    CodeInfo {
        code: "E0616",
        title: "a mesh is too large",
        explanation: "\
Meshes of up to 2^26 (67 million) triangles are read. Reduce the mesh first, for example with the decimation of Blender or
MeshLab.
",
    },
    CodeInfo {
        code: "E0620",
        title: "a picture cannot be written",
        explanation: "\
The file could not be created or written: the folder does not exist, is not writable, or the disk is full; or the
picture has no pixels or more than the format can hold.
",
    },
    CodeInfo {
        code: "E0621",
        title: "the ending of a picture file is not known",
        explanation: "\
The ending says what is written:

- `.png`: the displayed picture, 8 or 16 bits, with the scene inside
- `.exr`: linear radiance, one 32-bit channel per band, and transmittance
- `.npy`: linear radiance as an array of height × width × bands
",
    },
    CodeInfo {
        code: "E0622",
        title: "a picture cannot be read, or holds no scene",
        explanation: "\
Pictures that `vol render` writes as `.png` carry their scene in a text chunk named `tyndall:scene`. This file is no
PNG, is damaged, or was stripped of its metadata by another program.
",
    },
    CodeInfo {
        code: "E0650",
        title: "a coefficient is negative at some place",
        explanation: "\
`k_a`, `k_s` and `k_e` are densities of what absorbs, scatters or emits: there is none below zero, nor are there phase
functions, albedos or lights below it. The message names the field and a position where it happens; it could not be known
before drawing.

Wrong, since noise swings around zero:

    k_a = 2 /m * fbm(p / 0.3 m)

Right:

    k_a = 2 /m * max(0, fbm(p / 0.3 m))
",
    },
    CodeInfo {
        code: "E0651",
        title: "a field is infinite or not a number at some place",
        explanation: "\
Divisions by zero, roots and logarithms of negative numbers and exponentials of large ones have no finite value. The
message names the field and a position where it happens. Keep the argument away from there with `max`, `clamp` or `if`.

Wrong at the centre:

    k_a = 1 / length(p)

Right:

    k_a = 1 / max(length(p), 1 mm)
",
    },
    CodeInfo {
        code: "E0652",
        title: "a medium without end cannot be integrated",
        explanation: "\
A ray that never leaves a medium is followed to infinity: uniform fields and fields that decay or grow steadily have a
definite result. This one has none (it emits without end and absorbs nothing), or none that could be shown within a
reasonable distance. Give the medium a `shape`.
",
    },
    CodeInfo {
        code: "E0653",
        title: "the camera cannot look",
        explanation: "\
`from` and `to` must differ, all values must be finite, `fov` must lie between 0 and 180 degrees, and the height of an
orthographic picture must be positive. Look at the params that the camera uses.
",
    },
    CodeInfo {
        code: "E0655",
        title: "no upper bound is known of a coefficient",
        explanation: "Light that is scattered more than once is followed along random paths. Where a medium has no closed form, \
collisions are found by a bound that its coefficient never exceeds (a majorant), worked out by interval arithmetic from \
the scene, the values of its params and the voxels of its grids. A field without a bound, such as `1/length(p)`, must be clamped, \
and a medium without a closed form that never ends needs a `shape`:\n\n\
```\nmedium glow { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_s = min(100, 1 m / length(p)) /m }\n```",
    },
    CodeInfo {
        code: "E0656",
        title: "the graphics driver ended loops early",
        explanation: "Some drivers, software ones above all, end every loop of a shader once 65535 rounds have been taken in all, and \
report nothing. A kernel notices it at its end; the light of those rays is wrong, and the program ends with an error. Ask for less: a larger \
`accuracy`, fewer `steps`, a simpler field; or let the processor draw with `--engine cpu`.",
    },
    CodeInfo {
        code: "E0657",
        title: "a surface reflects more light than falls on it",
        explanation: "\
An albedo is the share of light that a surface sends back: 0 for black, 1 for all of it. Above 1 a surface would shine by
itself, and light between two of them would grow without end. The message names the surface; it could not be known before
its params had their values.

Wrong, when `brightness` is set to 2:

    albedo = brightness

Right:

    albedo = min(1, brightness)
",
    },
    CodeInfo {
        code: "E0658",
        title: "a picture would take longer than it may",
        explanation: "\
Slices and splats become more until twice as many change nothing by more than `accuracy` allows. `vol report` gives each picture a
share of its `--budget`; where the next number of them would take longer than that, the picture is left out, and the report says
so. Give it a larger budget, or fewer pixels with `--size`.
",
    },
    CodeInfo {
        code: "E0654",
        title: "a ray or the values of params do not fit",
        explanation: "\
A ray needs a finite origin and a direction that is not zero, and each param of the scene needs as many numbers as its
type has.
",
    },
    CodeInfo {
        code: "W0601",
        title: "voxels that are not finite were replaced",
        explanation: "\
NaN and infinite voxels, and those that overflow when the header's slope scales them, have no meaning in the transfer
equation. They are stored as 0, so that their value is the header's intercept (0 without one). The message counts them
and gives the first position (i, j, k). Many scanners' tools write NaN outside a mask; then nothing is wrong.
",
    },
    CodeInfo {
        code: "W0602",
        title: "denormal voxels were replaced by 0",
        explanation: "\
Floating-point voxels smaller than the smallest normal number of their type (1.2e-38 for 32 bits) are stored as 0: GPUs
may treat them as 0 or not, and the picture must not depend on the machine.
",
    },
    CodeInfo {
        code: "W0603",
        title: "voxels are negative",
        explanation: "\
Negative values are kept: they are legitimate, for example in CT, where air is −1000 HU. A coefficient must not be
negative, however: put a transfer function or `max(0, …)` between the grid and `k_a`, `k_s` or `density`.
",
    },
    CodeInfo {
        code: "W0604",
        title: "a unit of length in a volume file is not known",
        explanation: "\
NRRD headers name units as free text. km, m, cm, mm, um and nm are known, in their usual spellings; anything else is
taken for millimetres, and so is a missing unit, silently.
",
    },
    CodeInfo {
        code: "W0605",
        title: "triangles were left out",
        explanation: "\
Triangles whose corners lie on one line have no area and cannot be seen; those with a corner that is NaN or infinite (or
does not fit 32-bit floating point) have no place. Both are left out. The message counts them and gives the first. Exact
duplicates of corners after an export are the usual cause and harmless.
",
    },
    CodeInfo {
        code: "N0606",
        title: "a mesh is not closed",
        explanation: "\
Some edges of the mesh belong to one triangle alone, so that its surface has a rim or holes. It is drawn as it is, a sheet with
two sides: a leaf is meant so, but light also passes through holes that were not meant, into a body and out of it again.
The message counts such edges and gives the corners of the first. Two corners are the same where their coordinates are equal
to the last digit; parts that only seem to touch count as open.
",
    },
];
