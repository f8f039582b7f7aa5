//! Functions that kernels share: written into a kernel when something in it calls them.

use super::builder::{Code, KernelBuilder};
use super::{table, volume};
use crate::ir::{Graph, GridId, TableId};
use crate::program::kernel::{BinaryOp, Expr, Function, Math, Prim, Ty};

/// Which function.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum Helper {
    /// `expm1(x)`: e^x − 1. WGSL has none.
    Expm1,
    /// `attenuated(x)`: (1 − e^(−x))/x for x ≥ 0, 1 at 0: the mean transmittance over a step of optical depth x.
    Attenuated,
    /// `exponential_integral(argument, rate, a, b)`: ∫ₐᵇ exp(argument + rate·t) dt, at most 3e38; b may be 3e38 for infinity.
    ExponentialIntegral,
    /// `srgb_encode(x)`: the transfer function of sRGB (IEC 61966-2-1), from light to what is stored; its power goes on above 1.
    SrgbEncode,
    /// `srgb_decode(x)`: back, at most 2e38.
    SrgbDecode,
    /// `cell_hash(cell, seed)`, as [`crate::ir::eval::cell_hash`].
    CellHash,
    /// A grid's value at voxel coordinates.
    Sample(GridId),
    /// A grid's gradient at voxel coordinates.
    SampleGradient(GridId),
    /// A table's value.
    Lookup(TableId),
    /// A table's slope.
    LookupSlope(TableId),
}

impl Helper {
    pub(super) fn write(self, graph: &Graph, builder: &mut KernelBuilder) -> Function {
        match self {
            Self::Expm1 => expm1(),
            Self::Attenuated => attenuated(),
            Self::ExponentialIntegral => {
                let attenuated = builder.helper(graph, Self::Attenuated);
                exponential_integral(attenuated)
            }
            Self::SrgbEncode => srgb_encode(),
            Self::SrgbDecode => srgb_decode(),
            Self::CellHash => cell_hash(),
            Self::Sample(grid) => volume::sample(graph, builder, grid),
            Self::SampleGradient(grid) => volume::gradient(graph, builder, grid),
            Self::Lookup(id) => table::lookup(graph, builder, id),
            Self::LookupSlope(id) => table::slope(graph, builder, id),
        }
    }
}

/// x·(1 + x/2·(1 + x/3·(1 + …))): Taylor's series of e^x − 1 by Horner's rule.
fn expm1_series(x: &Expr, terms: u32) -> Expr {
    let mut sum = Expr::F32(1.0);
    for n in (2..=terms).rev() {
        sum = Expr::F32(1.0) + x.clone() * Expr::F32(1.0 / f64::from(n)) * sum;
    }
    sum
}

fn expm1() -> Function {
    let mut code = Code::new("expm1", None);
    let x = code.parameter("x", Ty::F32);
    // Below 0.25 seven terms are right to 2⁻²⁴; above, the difference loses two bits at most.
    code.if_(x.clone().abs().less(0.25), |code| code.return_(x.clone() * expm1_series(&x, 7)));
    code.return_(x.exp() - 1.0);
    code.finish(Some(Ty::F32))
}

fn attenuated() -> Function {
    let mut code = Code::new("attenuated", None);
    let x = code.parameter("x", Ty::F32);
    code.if_(x.clone().less(0.25), |code| code.return_(expm1_series(&-x.clone(), 7)));
    code.return_((Expr::F32(1.0) - (-x.clone()).exp()) / x);
    code.finish(Some(Ty::F32))
}

fn exponential_integral(attenuated: crate::program::kernel::FunctionId) -> Function {
    let mut code = Code::new("exponential_integral", None);
    let [argument, rate, a, b] = ["argument", "rate", "a", "b"].map(|n| code.parameter(n, Ty::F32));
    // exp(88) is the largest that f32 holds.
    let exp = |x: Expr| x.min(88.0).exp();
    code.if_(b.clone().greater_equal(1.0e38), |code| {
        code.if_(rate.clone().greater_equal(0.0), |code| code.return_(Expr::F32(3.0e38)));
        let column = exp(argument.clone() + rate.clone() * a.clone()) / -rate.clone();
        code.return_(column.min(3.0e38));
    });
    // From the denser end, so that the exponential inside only decays.
    let length = code.bind("length", Ty::F32, b.clone() - a.clone());
    let dense = rate.clone().greater(0.0).select(b, a);
    let start = code.bind("densest", Ty::F32, exp(argument + rate.clone() * dense));
    let mean = Expr::Call(attenuated, vec![rate.abs() * length.clone()]);
    code.return_((start * length * mean).min(3.0e38));
    code.finish(Some(Ty::F32))
}

fn srgb_encode() -> Function {
    let mut code = Code::new("srgb_encode", None);
    let x = code.parameter("x", Ty::F32);
    code.if_(x.clone().less_equal(0.003_130_8), |code| code.return_(x.clone() * 12.92));
    code.return_(Expr::math(Math::Pow, [x, Expr::F32(1.0 / 2.4)]) * 1.055 - 0.055);
    code.finish(Some(Ty::F32))
}

fn srgb_decode() -> Function {
    let mut code = Code::new("srgb_decode", None);
    let x = code.parameter("x", Ty::F32);
    code.if_(x.clone().less_equal(0.040_45), |code| code.return_(x.clone() / 12.92));
    // Beyond, f32 would overflow.
    code.return_(Expr::math(Math::Pow, [(x.min(1.0e16) + 0.055) / 1.055, Expr::F32(2.4)]));
    code.finish(Some(Ty::F32))
}

/// Rounded down, clamped to i32, as bits.
fn whole(x: Expr, width: u8) -> Expr {
    let floor = Expr::math(Math::Floor, [x]);
    let low = Expr::F32(-2_147_483_648.0).splat(width);
    let high = Expr::F32(2_147_483_520.0).splat(width);
    Expr::math(Math::Clamp, [floor, low, high]).convert(Prim::I32).bitcast(Prim::U32)
}

fn cell_hash() -> Function {
    let uint3 = Ty::Value(Prim::U32, 3);
    let mut code = Code::new("cell_hash", None);
    let cell = code.parameter("cell", Ty::VEC3);
    let seed = code.parameter("seed", Ty::F32);
    let salt = [0x9E37_79B9, 0x85EB_CA6B, 0xC2B2_AE35].map(Expr::U32);
    let seed = whole(seed, 1).splat(3) * Expr::Compose(uint3, salt.into());
    let v = code.bind("seeded", uint3, whole(cell, 3) + seed);
    let v = code.bind("scrambled", uint3, v * Expr::U32(1_664_525).splat(3) + Expr::U32(1_013_904_223).splat(3));
    let mix = |code: &mut Code, v: Expr, names: [&str; 3]| -> [Expr; 3] {
        let [x, y, z] = [0, 1, 2].map(|i| v.clone().component(i));
        let x = code.bind(names[0], Ty::U32, x + y.clone() * z.clone());
        let y = code.bind(names[1], Ty::U32, y + z.clone() * x.clone());
        let z = code.bind(names[2], Ty::U32, z + x.clone() * y.clone());
        [x, y, z]
    };
    let first = mix(&mut code, v, ["x1", "y1", "z1"]);
    let v = code.bind("mixed", uint3, Expr::Compose(uint3, first.into()));
    let shift = Expr::binary(BinaryOp::ShiftRight, v.clone(), Expr::U32(16).splat(3));
    let v = code.bind("folded", uint3, Expr::binary(BinaryOp::BitXor, v, shift));
    let second = mix(&mut code, v, ["x2", "y2", "z2"]);
    let top = Expr::binary(BinaryOp::ShiftRight, Expr::Compose(uint3, second.into()), Expr::U32(8).splat(3));
    code.return_(top.convert(Prim::F32) * Expr::F32(1.0 / 16_777_216.0).splat(3));
    code.finish(Some(Ty::VEC3))
}
