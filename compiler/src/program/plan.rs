//! The plan: what the runtime binds, fills and dispatches, as plain data.

use crate::ir::{GridId, MeshId, NodeId, RenderInfo, TableId};

/// What a survey says of a pixel that is like no other.
pub const ALONE: u32 = u32::MAX;

/// Where the rays of a drawing come from.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum RaySource {
    /// One per pixel (and sample) of the camera.
    Camera,
    /// A buffer of rays: origin xyz, least t, direction xyz, 0 (eight f32 each).
    List,
}

/// What can come out of a ray. A quantity per band has the width of the bands, or 1 when it is the same in all.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum OutputKind {
    /// Radiance in lx, per band.
    Radiance,
    /// Transmittance from the eye to the end of the ray, per band.
    Transmittance,
    /// Optical depth, per band; +∞ where it is unbounded.
    OpticalDepth,
    /// Estimated absolute error of the radiance, the largest over the bands: local errors, early exit, exceeded caps. Width 1.
    Error,
    /// Of the error, what f32 makes of places, of the ends of segments and of the last operations. Width 1.
    Rounding,
    /// Of the error, what is left out on purpose: what lies behind where a ray ends early, and in bricks that count as empty. Width 1.
    Storage,
    /// Field evaluations. Width 1.
    Evaluations,
    /// 0, or what went wrong and how far along the ray: the bits of a u32 ([`Fault::code`]), then the position (4 wide).
    Fault,
    /// 1 where the pixel straddles an edge of a shape, else 0. Width 1.
    Edge,
}

/// One output's place in the record of a ray.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct Output {
    /// Which.
    pub kind: OutputKind,
    /// First f32 of it in the record.
    pub offset: u32,
    /// Components.
    pub width: u8,
}

/// What a kernel can find wrong at run time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Index of the medium in the scene.
    pub medium: u32,
    /// `k_a`, `k_s`, `k_e` or `k_t`.
    pub field: &'static str,
    /// Whether it was not finite (else negative).
    pub not_finite: bool,
}

impl Fault {
    /// What a kernel writes when the driver ended one of its loops early: some (llvmpipe among them) end all loops of an
    /// invocation after 65535 rounds in all, and say nothing.
    pub const CUT_SHORT: u32 = u32::MAX;

    /// The number a kernel writes: 1 + medium·8 + field·2 + not_finite, with fields k_a, k_s, k_e, k_t in this order.
    #[must_use]
    pub fn code(&self) -> u32 {
        let field = Self::FIELDS.iter().position(|f| *f == self.field).unwrap_or(0) as u32;
        1 + self.medium * 8 + field * 2 + u32::from(self.not_finite)
    }

    /// The fault that a number other than 0 stands for.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        let n = code.checked_sub(1)?;
        Some(Self { medium: n / 8, field: Self::FIELDS[(n % 8 / 2) as usize], not_finite: n % 2 == 1 })
    }

    const FIELDS: [&'static str; 4] = ["k_a", "k_s", "k_e", "k_t"];
}

/// Where the value of a uniform comes from.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum UniformSource {
    /// A node of the optimised graph of tier Frame, evaluated in f64 on the host.
    Node(NodeId),
    /// The largest value that a node can have anywhere in the scene at these parameters, by interval arithmetic: the majorant of
    /// a coefficient.
    Majorant(NodeId),
    /// Where the lattice of [`Plan::bounds`] with this number lies.
    Bricks(u32, BricksPart),
    /// Something about this drawing.
    Frame(FrameValue),
}

/// Place and size of a lattice of bricks.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum BricksPart {
    /// vec3: its lower corner.
    Low,
    /// vec3: bricks per unit of length along each axis.
    PerUnit,
    /// vec3: bricks along each axis.
    Counts,
    /// vec3: by how much [`MediumBounds::support`] is higher between two places than at either of them at most, where these are
    /// the first three of [`SPANS`] apart.
    RiseNear,
    /// vec3: the same for the other three.
    RiseFar,
    /// vec3: over which length the medium's coefficients rise from nothing, where that is fastest; 0 and 0.
    Grain,
}

/// Distances in cells over which it is measured how far a field rises between two places.
pub const SPANS: [f64; 6] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0];

/// What may be left in bricks that count as empty, as a share of the accuracy: of a picture, all together, in optical depth and
/// in emission relative to white. For a probe nothing may be left.
pub const EMPTY: f64 = 1e-4;
/// Optical depth of a cell of a field, over `accuracy`, up to which ordinary steps are taken to find everything in it.
pub const HIDING: f64 = 16.0;
/// Bricks of a lattice at most, and with them the size of its buffer.
pub const MOST_BRICKS: u32 = 64 * 64 * 64;

/// What bounds a medium: fields of the optimised graph that the runtime evaluates over bricks, by intervals in f64, for each
/// set of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumBounds {
    /// Index in the scene.
    pub medium: u32,
    /// k_a + k_s; `None` if it is 0.
    pub extinction: Option<NodeId>,
    /// k_e; `None` if it is 0.
    pub emission: Option<NodeId>,
    /// k_s, where it sends light towards the eye.
    pub scattering: Option<NodeId>,
    /// Where something may hide between samples.
    pub narrow: Vec<Narrow>,
    /// Steps are no longer than twice this anyway, in units of length.
    pub cell: Option<f64>,
    /// The same, where it is the cell of a noise: what is cut off at a value may leave grains of any size.
    pub grain: Option<f64>,
    /// Where there are grains, a scalar that is not negative wherever any coefficient is anything but 0.
    pub support: Option<NodeId>,
}

/// A scalar field, its gradient, and the bands of its values within which coefficients may rise and fall again.
#[derive(Clone, Debug, PartialEq)]
pub struct Narrow {
    /// Width 1.
    pub argument: NodeId,
    /// Width 3.
    pub gradient: NodeId,
    /// Ascending pairs.
    pub bands: Vec<(f64, f64)>,
}

/// What the runtime knows about a drawing. Lengths are in the scene's units.
///
/// A camera ray through the point (x, y) of the picture (pixels from the top left corner) is made from
/// u = (2x − width)/height and v = 1 − 2y/height:
/// - perspective: origin = anchor + plane·(u·right + v·up), direction = normalize(forward + u·right + v·up),
///   with right and up scaled by tan(fov/2); anchor = eye + plane·forward. The plane is put near the scene when the eye
///   is far from it, so that f32 loses nothing; t starts at −|origin − eye| = −plane·|forward + u·right + v·up|.
/// - orthographic: origin = anchor + u·right + v·up with right and up scaled by height/2, direction = forward, t starts at −plane.
/// - panorama: longitude = π·(2x/width − 1), latitude = π·(½ − y/height), origin = anchor, t starts at 0,
///   direction = cos(latitude)·(sin(longitude)·right + cos(longitude)·forward) + sin(latitude)·up.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum FrameValue {
    /// First pixel of this dispatch: vec2 of u32.
    TileOrigin,
    /// Pixels of this dispatch: vec2 of u32. The record of pixel (i, j) of the tile is number j·width + i.
    TileSize,
    /// Pixels of the picture: vec2 of u32.
    ImageSize,
    /// Number of rays in the list: u32.
    RayCount,
    /// vec3
    CameraAnchor,
    /// vec3, unit
    CameraForward,
    /// vec3, scaled as said above
    CameraRight,
    /// vec3, scaled as said above
    CameraUp,
    /// f32: distance of the anchor from the eye along forward
    CameraPlane,
    /// f32: A of `accuracy`
    Accuracy,
    /// f32: W of `accuracy`, display white in lx; 0 for a probe, whose accuracy is relative
    White,
    /// u32: `steps`
    Steps,
    /// u32: `max_work`
    MaxWork,
    /// u32: paths of a pixel or ray in this dispatch
    Paths,
    /// u32: number of the first of them
    FirstPath,
    /// u32: `--seed`
    Seed,
    /// vec3: lower corner of the box in which columns of light are kept
    CacheLow,
    /// vec3: its edges
    CacheSize,
    /// u32: 2, which no compiler knows: a loop of so many rounds shows whether the driver still lets loops go on
    Rounds,
    /// f32: how many pixels of the picture one unit of u spans (height/2)
    PixelScale,
    /// u32: which of the plan's `repeats` this is
    Repeat,
    /// f32: distance of the first slab's near plane from the anchor, along forward
    SlabStart,
    /// vec3: across the planes of slabs, away from the eye, where they stand across an axis of the media
    SlabNormal,
    /// f32: thickness of a slab
    SlabStep,
    /// u32: how many slabs there are
    SlabCount,
    /// vec3: where the axis of [`LightBuffer`] crosses the middle of the media
    LightCenter,
    /// vec3, unit: the way of light along that axis
    LightForward,
    /// vec3: nodes of the buffer per unit of length across it, at the centre
    LightRight,
    /// vec3: likewise, across both
    LightUp,
    /// vec2: coordinates of node (0, 0)
    LightCorner,
    /// f32: one over the distance of the lamp from the centre; 0 for parallel light
    LightNear,
    /// vec2 of u32: nodes along both
    LightNodes,
    /// vec3: lower corner of the box around the bounded media
    BoundsLow,
    /// vec3: its upper corner
    BoundsHigh,
    /// vec3: the first node of the lattice of splats
    LatticeLow,
    /// f32: distance between its nodes
    LatticeSpacing,
    /// u32 × 3: nodes along each axis; number i is x + counts.x·(y + counts.y·z)
    LatticeCounts,
    /// f32: 0 for splats as they are; 1 and −1 for coefficients larger and smaller by what they may be wrong by
    Lean,
    /// u32: edge of the tiles of the picture that have lists of splats, in pixels
    ListEdge,
    /// u32: which of the rounds of [`Pass::Rounds`] this is
    Round,
    /// u32: how many there are
    RoundCount,
    /// u32: how many things a sort puts in order
    SortCount,
    /// u32: which word of their keys it is at, the least significant being 0
    SortWord,
    /// u32: the first bit of its digit in that word
    SortShift,
    /// u32: how many of [`Binding::Tallies`] are summed up
    ScanLength,
    /// u32: entries of all lists of splats
    ListEntries,
    /// u32: tiles of the picture in a row
    ListColumns,
}

/// One field of the uniform block. Layout is WGSL's: offsets in bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct UniformField {
    /// Its name in the shader.
    pub name: String,
    /// Byte offset.
    pub offset: u32,
    /// Components, f32 or u32 each.
    pub width: u8,
    /// Whether it is u32 (else f32). Truth values are u32 0 or 1.
    pub integer: bool,
    /// Where its value comes from.
    pub source: UniformSource,
}

/// The uniform block.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct UniformLayout {
    /// In order of offset.
    pub fields: Vec<UniformField>,
    /// Bytes, a multiple of 16.
    pub size: u32,
}

impl UniformLayout {
    /// Lays fields out in this order by WGSL's rules: a value of 1, 2, 3 or 4 components is aligned to 4, 8, 16 or
    /// 16 bytes. Each field is its name, components, whether it is u32, and source.
    #[must_use]
    pub fn new(fields: impl IntoIterator<Item = (String, u8, bool, UniformSource)>) -> Self {
        let mut end = 0u32;
        let fields: Vec<_> = fields
            .into_iter()
            .map(|(name, width, integer, source)| {
                let alignment = if width == 3 { 16 } else { 4 * u32::from(width) };
                let offset = end.next_multiple_of(alignment.max(1));
                end = offset + 4 * u32::from(width);
                UniformField { name, offset, width, integer, source }
            })
            .collect();
        Self { fields, size: end.next_multiple_of(16).max(16) }
    }
}

/// What is bound at one binding of group 0; the index is the binding.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum Binding {
    /// The uniform block.
    Uniforms,
    /// A 3D texture of a grid's stored values (not scaled): R8/R16/R32 Uint or Sint, or R32Float, as [`texture_prim`] says.
    Grid(GridId),
    /// A table: array of f32: per row its key, then its values, `width + 1` numbers a row.
    Table(TableId),
    /// A mesh: array of u32, the bits of f32 but where it says so. First eight numbers, of which the first is the count of nodes as the bits of a u32. Then the nodes
    /// of a hierarchy of boxes in depth-first order, eight numbers each: lower corner, the node to go on with when this one
    /// is missed (bits), upper corner, and for a leaf its first triangle · 8 + number of triangles (bits), else 0. Then
    /// triangles, nine numbers each: a corner, and the two edges from it. In the scene's units.
    Mesh(MeshId),
    /// Optical depths towards lights, one or one per band for each node: array of f32, filled by [`FillPass`].
    Cache,
    /// Bounds of a medium on a lattice of bricks, by number in [`Plan::bounds`]: array of f32, four for each brick, x fastest.
    /// The largest extinction in it; the largest of emission and scattering in it; how many bricks on every side, its own
    /// included, are empty (0: it is not); how many likewise hold nothing narrow, or how fast the
    /// arguments change at most, per unit of length, on which something narrow in it depends, negative.
    /// They hold a thousandth of a brick around it too.
    Bounds(u32),
    /// Rays of the list.
    Rays,
    /// What tells pixels apart: array of u32, row by row, written by [`Plan::survey`].
    Survey,
    /// Records, one per ray: array of f32.
    Records,
    /// What the passes of a tile tell those after them: array of f32, `Plan::notes` per invocation. Written to.
    Notes,
    /// The same, only read.
    NotesRead,
    /// Outlines of slabs: array of f32, three per vertex of a list of triangles: x and y in pixels of the picture, and the number
    /// of the slab. The farthest slab comes first; then, with [`AGAINST`] added, the nearest. For [`Pass::Alternate`], slab by slab: as
    /// rays see it that go along the normal; with [`AGAINST`] added, as others do; and as light meets it, in texels of its buffer.
    Outlines,
    /// Coefficients of the splats at the nodes of the lattice, and what they may be wrong by: array of f32. Written to.
    Splats,
    /// The same, only read.
    SplatsRead,
    /// What has been sorted, in its order: numbers of nodes, the farthest first. Array of u32.
    Order,
    /// Keys of what is to be sorted: array of u32, word w of thing i of n at w·n + i, the least significant word first. Written to.
    Keys,
    /// The same, only read.
    KeysRead,
    /// What a pass of a sort reads and writes: array of u32 each, words of keys and numbers of things.
    Sorting(SortBuffer),
    /// How many keys of each workgroup have each value of a digit, digit by digit; then how many come before them. Or the sums of
    /// something over workgroups, likewise. Array of u32.
    Tallies,
    /// Which tiles each splat of a file reaches: array of u32, four for each. The first tile; the first of another part, where a panorama
    /// comes round; columns of the main part · 65536 + columns of the other; rows of both.
    Reaches,
    /// Where the entries of each splat begin, in the order of depth: array of u32. Written to.
    Starts,
    /// The same, only read.
    StartsRead,
    /// Splats of entries, before these are sorted by tile: array of u32. Written to.
    Entries,
    /// The same, only read.
    EntriesRead,
    /// Memory of a workgroup, to which nothing is bound, by a number of its own.
    Workgroup(u32),
    /// Splats of files as this picture shows them: array of f32, each as [`FootprintShape`] says.
    Footprints,
    /// What a round of [`Pass::Rounds`] leaves for the next: array of f32, `Plan::carried` per invocation.
    Carried,
    /// Which of them each tile of the picture ([`FrameValue::ListEdge`]), row by row, or each ray of the list is covered by: array of u32. First
    /// three numbers for each, and for one more: where its list begins; the bits of an f32, what is left out of it, as the sum of the
    /// largest α that each has in it; and those of another, the largest radiance of what is left out, in lx. A list ends where the next
    /// begins, and has numbers of footprints, the nearest first.
    TileLists,
    /// The same, written to.
    TileListsWritten,
    /// A target of [`Plan::targets`], by its number: what was drawn into it.
    Target(u32),
    /// A target of [`LightBuffer::targets`], by its number: what light has lost before the slab at hand.
    Light(u32),
}

/// Buffers that a pass of a sort goes from and to; the next pass goes back.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum SortBuffer {
    /// Keys as the pass before left them, only read.
    KeysFrom,
    /// Numbers likewise.
    NumbersFrom,
    /// Keys in the order of this pass, written to.
    KeysTo,
    /// Numbers likewise.
    NumbersTo,
}

/// A stable radix sort on the device, least significant digit first. For each digit of each word of the keys, in this order: `count`
/// and `scatter` over workgroups that take [`SortPass::TAKES`] keys each, and between them one workgroup of `scan`. The first
/// pass of a word reads [`Binding::KeysRead`] through the numbers that are in order so far, and the very first pass of all numbers them.
///
/// Workgroups of `count` and `scatter`, and of all that goes over as many things, stand in rows of [`SortPass::ROW`], for there
/// may be more of them than a dispatch has along an axis.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct SortPass {
    /// The kernel that counts the digits of each workgroup.
    pub count: u32,
    /// The one that sums up [`Binding::Tallies`].
    pub scan: u32,
    /// The one that puts keys and numbers where they belong.
    pub scatter: u32,
    /// u32 words of a key.
    pub words: u32,
}

impl SortPass {
    /// Bits of a digit.
    pub const DIGIT: u32 = 4;
    /// Invocations of a workgroup.
    pub const THREADS: u32 = 256;
    /// Keys that a workgroup takes.
    pub const TAKES: u32 = 4096;
    /// Workgroups in a row.
    pub const ROW: u32 = 32768;
    /// The key of what is not drawn: it comes last.
    pub const LAST: u32 = u32::MAX;

    /// Workgroups that take so many things each, along both axes.
    #[must_use]
    pub fn groups(count: u32, takes: u32) -> [u32; 2] {
        let groups = count.div_ceil(takes);
        [groups.min(Self::ROW), groups.div_ceil(Self::ROW)]
    }
}

/// What is known of a splat of a file where the rays of a drawing meet it. A footprint covers α = |o|·exp(−½(u² + v²)) of what is behind
/// it; o is negative for what is blended as sRGB-encoded numbers. It has these numbers, and then those that are blended, one for
/// each band of the program: encoded, or in lx.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum FootprintShape {
    /// Of a ray of the list: t, o; u and v are 0.
    Ray,
    /// In a plane: depth along the view, from the anchor; xx, xy, x0, yy, y0, and o. With (x, y) in pixels from the middle of the picture, y
    /// down, u = xx·x + xy·y + x0 and v = yy·y + y0.
    Plane,
    /// Around the eye: distance; vectors a, b and c; and o. On a ray along d, u = a·d/c·d and v = b·d/c·d; where c·d ≤ 0 it covers nothing.
    Around,
}

impl FootprintShape {
    /// f32 before those of the bands.
    #[must_use]
    pub fn head(self) -> u32 {
        match self {
            Self::Ray => 2,
            Self::Plane => 7,
            Self::Around => 11,
        }
    }
}

/// What the runtime makes of splats of files before it draws.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct FootprintLayout {
    /// Which numbers.
    pub shape: FootprintShape,
    /// f32 of each: those, and one for each band.
    pub stride: u32,
    /// Entries of a list that a round goes through.
    pub round: u32,
    /// What puts them in order of depth, and entries of lists in order of tiles.
    pub sort: SortPass,
    /// What makes the lists.
    pub lists: ListPasses,
}

/// Kernels that make [`Binding::TileLists`] on the device, when splats are in order. The runtime writes the heads of the lists.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct ListPasses {
    /// Sums of how many tiles the splats of a workgroup reach, [`SortPass::TAKES`] of them, into [`Binding::Tallies`]; then the sort's `scan`.
    pub sums: u32,
    /// Where the entries of each splat begin, over as many.
    pub starts: u32,
    /// The tile of each entry, which is its key, and its splat; [`SortPass::THREADS`] to a workgroup. Then the sort, by one word.
    pub spread: u32,
    /// The lists, over as many.
    pub fill: u32,
}

/// How a fragment comes together with what its target holds.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum Blend {
    /// source + destination · α of the source: light, over what lies behind it. α is a transmittance.
    Over,
    /// source + destination
    Add,
    /// The larger.
    Max,
}

/// Floating point that fragments are blended in.
#[derive(Copy, Clone, Debug, Default, PartialEq, Eq, Hash)]
pub enum Precision {
    /// f32
    #[default]
    Single,
    /// f16, where the adapter cannot blend f32.
    Half,
}

impl Precision {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "f32",
            Self::Half => "f16",
        }
    }

    /// What a blend may be wrong by, relative: what is blended, its product and its sum are each rounded to nearest, or the sum is
    /// cut off.
    #[must_use]
    pub fn blend_error(self) -> f64 {
        match self {
            Self::Single => 3.0 / 16_777_216.0,
            Self::Half => 3.0 / 2048.0,
        }
    }
}

/// A picture that fragments are blended into; it begins as 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// Its name in the shader.
    pub name: String,
    /// 1, 2 or 4.
    pub channels: u8,
    /// How.
    pub blend: Blend,
    /// In what.
    pub precision: Precision,
}

/// How many invocations a pass has.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum Extent {
    /// One per pixel of the tile, in two dimensions.
    Tile,
    /// One per ray of the list, in one dimension.
    Rays,
}

/// What is drawn.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum Geometry {
    /// The triangles of [`Binding::Outlines`].
    Outlines,
    /// Six corners for each entry of [`Binding::Order`], which is the instance.
    Billboards,
}

/// What is added to the number of a slab in an outline that is for rays which meet the planes from behind.
pub const AGAINST: u32 = 65536;

/// What a billboard cuts off of a Gaussian's share of an optical depth: e^(−R²/2) for a reach of R = 4.5 deviations.
pub const SPLAT_CUT: f64 = 4.0e-5;

/// What [`Pass::Alternate`] keeps of light on its way through the slabs: at nodes across its way, what it has lost before the slab
/// at hand.
///
/// With D the way of light along an axis through C, the middle of the media, and κ one over the distance of the lamp from there (0
/// for parallel light), light goes through the point p along D + κ·(p − C). Across the axis lie R and U, in nodes per unit of
/// length. The node at p is (R·(p − C), U·(p − C)) / (1 + κ·D·(p − C)) less the corner, and node (0, 0) is texel (0, 0).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightBuffer {
    /// Optical depths, one for all bands or one for each, and behind them what they may be wrong by where that is kept. They are
    /// added up in f32, never multiplied as transmittances.
    pub targets: Vec<Target>,
    /// Which media of the scene take light away here: those whose depths have no closed form. The nodes span the boxes around them.
    pub media: Vec<u32>,
}

/// The kernels of a draw, by their number in the program.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Of the corners.
    pub vertex: u32,
    /// Of the pixels.
    pub fragment: u32,
}

/// One dispatch or draw. Kernels are named by their number in the program.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum Pass {
    /// A dispatch.
    Compute {
        /// What runs.
        kernel: u32,
        /// Over what.
        extent: Extent,
    },
    /// A dispatch for each part of the longest list of splats, so that no invocation loops for long.
    Rounds {
        /// What runs.
        kernel: u32,
        /// Over what.
        extent: Extent,
    },
    /// Triangles, in order, into all targets, which are cleared before.
    Raster {
        /// Which triangles.
        geometry: Geometry,
        /// Of the corners.
        vertex: u32,
        /// Of the pixels.
        fragment: u32,
    },
    /// The triangles of [`Binding::Outlines`] slab by slab, in the order in which light meets them (Kniss et al. 2003): first what is
    /// seen of a slab, into all targets, and then what light loses in it, into those of the [`LightBuffer`], which `seen` reads. All
    /// targets are cleared before.
    ///
    /// Rays that go against light meet the farthest slab first, and what is [`Blend::Over`] is blended so. Others meet the nearest
    /// first: their light comes under what is there, source · α of the destination + destination. In both, the α of a
    /// target is the product of the transmittances so far and begins as 1.
    Alternate {
        /// What is seen.
        seen: Draw,
        /// What light loses; `None` where that is known otherwise.
        light: Option<Draw>,
    },
}

impl Pass {
    /// The kernels that it runs.
    pub fn kernels(&self) -> impl Iterator<Item = u32> + use<> {
        let of = |draw: Draw| [Some(draw.vertex), Some(draw.fragment)];
        let (first, second) = match *self {
            Self::Compute { kernel, .. } | Self::Rounds { kernel, .. } => ([Some(kernel), None], None),
            Self::Raster { vertex, fragment, .. } => ([Some(vertex), Some(fragment)], None),
            Self::Alternate { seen, light } => (of(seen), light.map(of)),
        };
        first.into_iter().chain(second.into_iter().flatten()).flatten()
    }
}

/// A pass that fills [`Binding::Cache`] before anything is drawn. Node `TileOrigin.x + i` is invocation `i` of `RayCount`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FillPass {
    /// Which of the program's kernels.
    pub kernel: u32,
    /// Invocations in all.
    pub nodes: u32,
    /// Numbers that the cache holds.
    pub floats: u32,
    /// Which media of the scene it is about: the box around them is where the nodes are.
    pub media: Vec<u32>,
}

/// A pass that finds what is at the nodes of the lattice of splats. Node `TileOrigin.x + i` is invocation `i` of `RayCount`.
/// For a list of rays, all of them go along `CameraForward`.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct PlantPass {
    /// Which of the program's kernels.
    pub kernel: u32,
    /// The one that runs after it, likewise, and finds how wrong that may be.
    pub doubt: u32,
    /// f32 of a node in [`Binding::Splats`].
    pub stride: u32,
    /// The one that runs after that, likewise, and gives each node its key: by depth, the farthest first, and [`SortPass::LAST`] for what is
    /// not drawn.
    pub rank: u32,
    /// What puts them in order.
    pub sort: SortPass,
    /// One invocation, which puts into [`Binding::Tallies`] how many of the sorted keys are not [`SortPass::LAST`].
    pub drawn: u32,
}

/// How steps are chosen.
#[derive(Copy, Clone, Debug, PartialEq)]
pub enum StepRule {
    /// Closed forms only: no step at all.
    Closed,
    /// This many midpoint steps, spread over the media along the ray.
    Fixed(u32),
    /// By local error control, to this accuracy.
    Adaptive(f64),
    /// Random paths: this many of each pixel or ray, or as many as `accuracy` needs.
    Paths(Option<u32>),
    /// This many slabs across the media, or as many as it takes until twice as many change nothing by more than `accuracy`
    /// allows; the midpoint rule in each.
    Slabs {
        /// How many; `None` is as many as it takes.
        count: Option<u32>,
        /// What shadows within a slab are stepped to.
        accuracy: f64,
    },
    /// About this many Gaussians on a lattice around the media, or as many as it takes, likewise.
    Splats {
        /// How many; `None` is as many as it takes.
        count: Option<u32>,
        /// What shadows are stepped to.
        accuracy: f64,
    },
}

impl StepRule {
    /// How a ray is stepped through, all of whose segments may be closed. What options ask for is in `render` already.
    pub(crate) fn along_rays(render: &RenderInfo, closed: bool) -> Self {
        match render.steps {
            _ if closed => Self::Closed,
            Some(n) => Self::Fixed(n),
            None => Self::Adaptive(render.accuracy),
        }
    }

    /// The accuracy that local error control works to, if some part of a drawing has that.
    #[must_use]
    pub fn accuracy(self) -> Option<f64> {
        match self {
            Self::Adaptive(accuracy) | Self::Slabs { accuracy, .. } | Self::Splats { accuracy, .. } => Some(accuracy),
            Self::Closed | Self::Fixed(_) | Self::Paths(_) => None,
        }
    }
}

/// Everything the runtime must know to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name of the backend that made it.
    pub backend: &'static str,
    /// Where rays come from.
    pub rays: RaySource,
    /// What comes out, in order of offset.
    pub outputs: Vec<Output>,
    /// f32 per record.
    pub stride: u32,
    /// Group 0.
    pub bindings: Vec<Binding>,
    /// Contents of the uniform block.
    pub uniforms: UniformLayout,
    /// In order.
    pub passes: Vec<Pass>,
    /// What is drawn into.
    pub targets: Vec<Target>,
    /// What light has lost, where slabs are lit one after another.
    pub light: Option<LightBuffer>,
    /// f32 of [`Binding::Notes`] per invocation.
    pub notes: u32,
    /// f32 of [`Binding::Carried`] per invocation.
    pub carried: u32,
    /// How often all passes run over a tile, each time with another ray through each pixel. Records add up.
    pub repeats: u32,
    /// How steps are chosen.
    pub steps: StepRule,
    /// What is worked out once for each picture.
    pub fill: Option<FillPass>,
    /// What finds the splats, once for each picture and after `fill`.
    pub plant: Option<PlantPass>,
    /// Splats of files, which are put before the drawing into [`Binding::Footprints`], then in order, and into lists.
    pub footprints: Option<FootprintLayout>,
    /// Media that are bounded on a lattice.
    pub bounds: Vec<MediumBounds>,
    /// Where some pixels of the camera are drawn and others filled in: the kernel that tells pixels apart by what their rays meet, once for each
    /// picture and over all of it. A pixel may be filled in from others that have the same number in [`Binding::Survey`]. Passes run over a
    /// list of pixels then, whose columns and rows stand first in [`Binding::Rays`], in place of origins.
    pub survey: Option<u32>,
    /// Samples per pixel.
    pub samples: u32,
    /// Most evaluations a ray of the camera is expected to need: for the size of tiles.
    pub work_per_ray: u32,
}

impl Plan {
    /// All kernels, in no particular order.
    pub fn kernels(&self) -> impl Iterator<Item = u32> + '_ {
        let plant = self.plant.iter().flat_map(|p| [p.kernel, p.doubt, p.rank, p.drawn]);
        let sort = self.sort().into_iter().flat_map(|s| [s.count, s.scan, s.scatter]);
        let fill = self.fill.as_ref().map(|f| f.kernel);
        let lists =
            self.footprints.into_iter().flat_map(|f| [f.lists.sums, f.lists.starts, f.lists.spread, f.lists.fill]);
        self.passes.iter().flat_map(Pass::kernels).chain(fill).chain(plant).chain(sort).chain(lists).chain(self.survey)
    }

    /// What puts splats in order on the device.
    #[must_use]
    pub fn sort(&self) -> Option<SortPass> {
        self.plant.map(|p| p.sort).or(self.footprints.map(|f| f.sort))
    }

    /// The output of this kind, if it was asked for.
    #[must_use]
    pub fn output(&self, kind: OutputKind) -> Option<Output> {
        self.outputs.iter().copied().find(|o| o.kind == kind)
    }
}

/// The component type of the texture that holds voxels of this kind, and whether it holds them exactly.
/// 64-bit voxels are converted to f32.
#[must_use]
pub fn texture_prim(scalar: crate::loader::Scalar) -> (super::kernel::Prim, bool) {
    use super::kernel::Prim;
    use crate::loader::Scalar;
    match scalar {
        Scalar::U8 | Scalar::U16 | Scalar::U32 => (Prim::U32, true),
        Scalar::I8 | Scalar::I16 | Scalar::I32 => (Prim::I32, true),
        Scalar::F32 => (Prim::F32, true),
        Scalar::U64 | Scalar::I64 | Scalar::F64 => (Prim::F32, false),
    }
}
