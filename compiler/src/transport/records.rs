//! What comes out of rays, and how pixels are made of them.

use super::edges;
use crate::fields::{Code, KernelBuilder};
use crate::ir::{Aa, Primitive};
use crate::program::kernel::{Expr, Function, Prim, Stage, Ty};
use crate::program::{Extent, FillPass, FrameValue, Ledger, Output, OutputKind, RaySource};

/// The outputs that are made: those asked for, and what went wrong.
pub(crate) fn wanted(options: &[OutputKind]) -> Vec<OutputKind> {
    let mut wanted = options.to_vec();
    if !wanted.contains(&OutputKind::Fault) {
        wanted.push(OutputKind::Fault);
    }
    wanted.sort_unstable();
    wanted.dedup();
    wanted
}

/// Places of outputs of these widths in a record, whether pixels are told to straddle an edge behind them, and f32 in all.
pub(crate) fn layout(fields: &[(OutputKind, u8)], edge: bool) -> (Vec<Output>, u32) {
    let (mut outputs, mut stride) = (vec![], 0);
    for (kind, width) in fields.iter().copied().chain(edge.then_some((OutputKind::Edge, 1))) {
        outputs.push(Output { kind, offset: stride, width });
        stride += u32::from(width);
    }
    (outputs, stride)
}

/// Stores a traced ray in its record.
pub(crate) fn store(
    builder: &mut KernelBuilder,
    code: &mut Code,
    widths: &[u8],
    values: &[Expr],
    record: &Expr,
    stride: u32,
) {
    let records = builder.records();
    let base = code.bind("base", Ty::U32, record.clone() * stride);
    let mut offset = 0u32;
    for (width, value) in widths.iter().zip(values) {
        for i in 0..*width {
            let part = if *width == 1 { value.clone() } else { value.clone().component(i) };
            code.store(records, base.clone() + offset, part);
            offset += 1;
        }
    }
}

/// Stores what a ray gave, or adds it to what the rays of its pixel before it gave, with a weight.
pub(crate) fn gather(
    builder: &mut KernelBuilder,
    code: &mut Code,
    (fields, values): (&[(OutputKind, u8)], Vec<Expr>),
    (record, stride): (&Expr, u32),
    weight: Option<&Expr>,
) {
    let widths: Vec<u8> = fields.iter().map(|f| f.1).collect();
    let Some(weight) = weight else { return store(builder, code, &widths, &values, record, stride) };
    let records = builder.records();
    let base = code.bind("so_far_at", Ty::U32, record.clone() * stride);
    let first = code.bind("first_ray", Ty::BOOL, builder.frame(FrameValue::Repeat).equal(0u32));
    let mut offset = 0u32;
    let mut sums = vec![];
    for ((kind, width), value) in fields.iter().zip(values) {
        let before: Vec<Expr> = (0..u32::from(*width))
            .map(|i| {
                let load = Expr::load(records, base.clone() + (offset + i));
                let load = code.bind("so_far", Ty::F32, load);
                first.clone().select(0.0, load)
            })
            .collect();
        offset += u32::from(*width);
        let before =
            if let [only] = before.as_slice() { only.clone() } else { Expr::Compose(Ty::float(*width), before) };
        let before = code.bind("before", Ty::float(*width), before);
        sums.push(match kind {
            OutputKind::Fault => {
                let none = before.clone().component(0).bitcast(Prim::U32).equal(0u32);
                none.select(value, before)
            }
            OutputKind::Evaluations => before + value,
            OutputKind::Edge => before.max(value),
            OutputKind::Radiance
            | OutputKind::Transmittance
            | OutputKind::OpticalDepth
            | OutputKind::Error
            | OutputKind::Rounding
            | OutputKind::Storage => before + value * weight.clone().splat(*width),
        });
    }
    store(builder, code, &widths, &sums, record, stride);
}

/// The pixel that an invocation draws.
pub(crate) struct Pixel {
    /// Of its upper left corner, in pixels of the picture.
    pub(crate) x: Expr,
    pub(crate) y: Expr,
    pub(crate) record: Expr,
}

/// What a kernel goes over that traces rays, and its workgroups.
pub(crate) fn extent(rays: RaySource) -> (Extent, [u32; 3]) {
    match rays {
        RaySource::Camera => (Extent::Tile, [8, 8, 1]),
        RaySource::List => (Extent::Rays, [64, 1, 1]),
    }
}

/// Adds the kernel that fills the cache of light, if there is one.
pub(crate) fn add_fill(
    entries: &mut Vec<(&str, Stage, Function)>,
    fill: Option<(FillPass, Function)>,
) -> Option<FillPass> {
    let (fill, entry) = fill?;
    entries.push(("fill", Stage::Compute([64, 1, 1]), entry));
    Some(FillPass { kernel: entries.len() as u32 - 1, ..fill })
}

/// The number of this invocation's ray in a list. Leaves the kernel where there is no such ray.
pub(crate) fn listed(builder: &mut KernelBuilder, code: &mut Code) -> Expr {
    let index = code.bind("index", Ty::U32, Expr::GlobalId.component(0));
    let count = builder.frame(FrameValue::RayCount);
    code.if_(index.clone().greater_equal(count), Code::return_nothing);
    index
}

/// The number of this invocation's pixel in a picture of so many. Leaves the kernel where there is none.
pub(crate) fn numbered(builder: &mut KernelBuilder, code: &mut Code) -> Expr {
    let own = code.bind("own", Ty::U32, Expr::GlobalId.component(0));
    let count = builder.frame(FrameValue::RayCount);
    code.if_(own.clone().greater_equal(count), Code::return_nothing);
    code.bind("number", Ty::U32, builder.frame(FrameValue::TileOrigin).component(0) + own)
}

/// The pixel of this invocation, of a tile or of a list of pixels.
pub(crate) fn pixel_of(builder: &mut KernelBuilder, code: &mut Code, of_list: bool) -> Pixel {
    if !of_list {
        return pixel(builder, code);
    }
    let record = listed(builder, code);
    let rays = builder.rays();
    let mut at = |name: &str, i: u32| code.bind(name, Ty::F32, Expr::load(rays, record.clone() * 8u32 + i));
    let (x, y) = (at("x", 0), at("y", 1));
    Pixel { x, y, record }
}

/// The pixel of this invocation. Leaves the kernel where the tile has none.
pub(crate) fn pixel(builder: &mut KernelBuilder, code: &mut Code) -> Pixel {
    let tile = builder.frame(FrameValue::TileSize);
    let column = code.bind("column", Ty::U32, Expr::GlobalId.component(0));
    let row = code.bind("row", Ty::U32, Expr::GlobalId.component(1));
    let outside = column.clone().greater_equal(tile.clone().component(0));
    let outside = outside.or(row.clone().greater_equal(tile.clone().component(1)));
    code.if_(outside, Code::return_nothing);
    let origin = builder.frame(FrameValue::TileOrigin);
    let prim = Prim::F32;
    let x = code.bind("x", Ty::F32, (origin.clone().component(0) + column.clone()).convert(prim));
    let y = code.bind("y", Ty::F32, (origin.component(1) + row.clone()).convert(prim));
    let record = code.bind("record", Ty::U32, row * tile.component(0) + column);
    Pixel { x, y, record }
}

/// Rays of each pixel.
pub(crate) fn samples(aa: Aa, rays: RaySource, ledger: &mut Ledger) -> u32 {
    match (rays, aa) {
        (RaySource::List, _) => 1,
        (RaySource::Camera, Aa::Ssaa(n)) if n > 1 => n,
        (RaySource::Camera, _) => {
            ledger.omit("loop over samples of a pixel", "one ray per pixel is asked for", None);
            1
        }
    }
}

/// Whether silhouettes are found and their pixels divided.
pub(crate) fn divides(aa: Aa, rays: RaySource, primitives: &[Primitive], ledger: &mut Ledger) -> bool {
    let analytic = match aa {
        // Until they have code of their own, the other kinds are drawn with this one, and a warning says so.
        Aa::Analytic | Aa::Msaa(_) | Aa::Fxaa | Aa::Smaa | Aa::Taa => rays == RaySource::Camera,
        Aa::None | Aa::Ssaa(_) => false,
    };
    if !analytic {
        ledger.omit("division of pixels at edges", "analytic anti-aliasing is not asked for", None);
        return false;
    }
    if !primitives.iter().any(edges::has_edge) {
        ledger.omit("division of pixels at edges", "no shape has a silhouette in closed form", None);
        return false;
    }
    true
}
