//! The field graph: pure, total, typed, hash-consed expressions over positions, directions, time and parameters.
//!
//! # Semantics
//! A [`Graph`] is a list of nodes, each an [`Op`] over earlier nodes. A node denotes a function from an environment
//! (position, direction, time, parameters, loop variables, voxel data) to a value of its [`Type`]: a truth value or
//! 1 to 4 real numbers. Values are real numbers; each evaluator approximates them (f64 on the CPU, f32 on the GPU,
//! intervals in the analysis) and is tested against the definitions here.
//!
//! - Every length has been divided by the scene's unit of length ([`Units`]) and every dimension has been erased:
//!   nodes carry plain numbers. The unit is a power of two of metres, so that this costs no rounding.
//! - Componentwise operations take operands of equal width. Broadcasting is explicit ([`Op::Splat`]).
//! - Operations are total. Where mathematics has no value (`sqrt(-1)`, `0/0`) or an infinite one (`1/0`, `log 0`)
//!   the result is IEEE's NaN or infinity in f64; a program never lets one reach a picture, since each medium's
//!   coefficients are checked where they are used and such a value is reported with the field and the position.
//! - [`Op::Select`] discards the branch that is not taken, whatever its value.
//! - [`Op::Floor`-like](Unary::Floor) operations make jumps; derivatives ignore them (the derivative almost everywhere).
//! - [`Op::Reduce`] binds its loop variable in its body. Variables are numbered by nesting depth, so equal loops are
//!   equal nodes; an inner loop of the same depth number shadows.
//! - `pow(a, b)` for non-integer `b` needs `a ≥ 0`; [`Op::PowI`] takes any `a`. `modulo(a, b) = a − b·floor(a/b)`.
//!
//! Nothing here simplifies: a graph is built exactly as asked, which is what the reference engine evaluates.
//! Optimisation lives in `passes`, which build a new graph from an old one.

mod bands;
pub mod derive;
pub mod eval;
mod graph;
mod light;
mod print;
mod scene;
mod splats;
mod schedule;
mod tier;
mod verify;

pub use bands::{Bands, BandsKind, LUMINANCE, XYZ_FROM_RGB, nanometres};
pub use graph::{Graph, GridInfo, NodeId, Origin, Table, TableId};
pub use light::{Light, LightKind, MeshId, MeshInfo, Surface, SurfaceShape};
pub use print::print;
pub use scene::{
    Aa, Affine, Backend, Camera, Composite, FieldScene, ImageInfo, Medium, Param, ParamType, Pixels, Primitive,
    PrimitiveKind, Projection, RenderInfo, Scattering, Shape, Stacks, Tonemap, Units,
};
pub use schedule::{Step, free_variables, schedule, schedule_with};
pub use splats::{Placement, SplatBlend, SplatsId, SplatsInfo};
pub use tier::{Tier, Tiers};
pub use verify::verify;

/// Identifies a declared grid.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GridId(pub u32);

/// Identifies a declared parameter.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ParamId(pub u32);

/// The type of a node.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Type {
    /// A truth value.
    Bool,
    /// 1 to 4 real numbers.
    Float(u8),
}

impl Type {
    /// One number.
    pub const SCALAR: Self = Self::Float(1);
    /// Three numbers: positions, directions, RGB.
    pub const VEC3: Self = Self::Float(3);

    /// Components; 1 for a truth value.
    #[must_use]
    pub fn width(self) -> u8 {
        match self {
            Self::Bool => 1,
            Self::Float(w) => w,
        }
    }
}

/// A constant: up to four numbers, compared by their bits.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Constant {
    bits: [u64; 4],
    width: u8,
}

impl Constant {
    /// A constant of 1 to 4 components.
    #[must_use]
    pub fn new(values: &[f64]) -> Self {
        assert!((1..=4).contains(&values.len()), "a constant has 1 to 4 components");
        let mut bits = [0; 4];
        for (b, v) in bits.iter_mut().zip(values) {
            *b = v.to_bits();
        }
        Self { bits, width: values.len() as u8 }
    }

    /// Its components.
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        self.bits[..self.width as usize].iter().map(|b| f64::from_bits(*b)).collect()
    }

    /// Component `i`.
    #[must_use]
    pub fn get(&self, i: usize) -> f64 {
        f64::from_bits(self.bits[i])
    }

    /// Components.
    #[must_use]
    pub fn width(&self) -> u8 {
        self.width
    }
}

/// What the environment supplies.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Input {
    /// Position in world space, in units of length. Width 3.
    Position,
    /// Unit vector along which light travels on the segment. Width 3. In an environment it points to the sky.
    Direction,
    /// Cosine between travel before and after scattering, +1 forward. Width 1.
    CosTheta,
    /// 1 − [`Input::CosTheta`], which engines take from the directions themselves (half the square of their difference), so
    /// that narrow forward lobes keep their digits. Passes make it. Width 1.
    Versine,
    /// 1 + [`Input::CosTheta`] likewise, for backward lobes. Width 1.
    Vercosine,
    /// Seconds. Width 1.
    Time,
    /// Altitude above the inner radius of a `shell`, in units of length, computed by the engine without cancellation:
    /// the index counts the scene's shells ([`FieldScene::shells`]). Width 1.
    Altitude(u32),
}

impl Input {
    /// Its type.
    #[must_use]
    pub fn ty(self) -> Type {
        match self {
            Self::Position | Self::Direction => Type::VEC3,
            Self::CosTheta | Self::Versine | Self::Vercosine | Self::Time | Self::Altitude(_) => Type::SCALAR,
        }
    }
}

/// Componentwise operations on one operand.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the names are the functions")]
pub enum Unary {
    Neg,
    Abs,
    /// −1, 0 or +1.
    Sign,
    Floor,
    Ceil,
    /// Half to even.
    Round,
    Sqrt,
    Exp,
    /// e^x − 1 without cancellation.
    Expm1,
    /// Natural logarithm.
    Log,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    /// Truth values only.
    Not,
}

/// Componentwise operations on two operands of equal type.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the names are the functions")]
pub enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    Min,
    Max,
    Pow,
    /// `atan2(y, x)`
    Atan2,
    /// a − b·floor(a/b)
    Mod,
    /// Truth values only.
    And,
    /// Truth values only.
    Or,
}

/// Comparisons of two scalars.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the names are the relations")]
pub enum Compare {
    Less,
    LessEqual,
    Equal,
}

/// How the values of a loop are combined.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the names are the operations")]
pub enum Fold {
    Sum,
    Product,
    Min,
    Max,
}

/// How a grid is interpolated between its samples.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Filter {
    /// The sample whose voxel the point lies in.
    Nearest,
    /// Trilinear.
    Linear,
    /// Tricubic convolution with a = −½ (Keys 1981, Catmull–Rom): goes through the samples, C¹, may overshoot.
    Cubic,
}

/// A node's operation.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum Op {
    /// A number or vector known now.
    Const(Constant),
    /// A truth value known now.
    Truth(bool),
    /// Supplied by the environment.
    Input(Input),
    /// A live control, in scaled units. Width as declared.
    Param(ParamId),
    /// The variable of the loop at this nesting depth (0 outermost). Width 1.
    LoopVar(u8),
    /// Componentwise.
    Unary(Unary, NodeId),
    /// Componentwise.
    Binary(Binary, NodeId, NodeId),
    /// Integer power, componentwise. `PowI(a, 0)` is 1.
    PowI(NodeId, i32),
    /// Of two scalars.
    Compare(Compare, NodeId, NodeId),
    /// `condition ? accept : reject`; the condition is one truth value.
    Select {
        /// A truth value.
        condition: NodeId,
        /// The value when it holds.
        accept: NodeId,
        /// The value when it does not; same type.
        reject: NodeId,
    },
    /// A vector of scalars; unused places repeat the last one.
    Compose([NodeId; 4], u8),
    /// One scalar in every component.
    Splat(NodeId, u8),
    /// One component.
    Extract(NodeId, u8),
    /// Scalar product of two vectors of equal width.
    Dot(NodeId, NodeId),
    /// Value of a grid at a position in voxel indices (sample centres at whole numbers). Within [−½, n−½] on every
    /// axis the position is clamped to [0, n−1] and interpolated; elsewhere the grid's `outside`. Width 1.
    Sample {
        /// Which grid.
        grid: GridId,
        /// Width 3.
        at: NodeId,
    },
    /// Exact derivative of [`Op::Sample`]'s interpolant with respect to `at`; 0 outside and in the clamped rim. Width 3.
    SampleGradient {
        /// Which grid.
        grid: GridId,
        /// Width 3.
        at: NodeId,
    },
    /// Piecewise-linear table at a scalar key: clamped at the ends, equal keys make a jump (the later row holds at the
    /// key itself). Width of the table.
    Lookup {
        /// Which table.
        table: TableId,
        /// Width 1.
        at: NodeId,
    },
    /// Slope of the segment that [`Op::Lookup`] uses; 0 beyond the ends. Width of the table.
    LookupSlope {
        /// Which table.
        table: TableId,
        /// Width 1.
        at: NodeId,
    },
    /// Three independent uniform numbers in [0, 1), multiples of 2⁻²⁴, from the cell's whole coordinates and a whole
    /// seed: PCG3D (Jarzynski and Olano 2020) over `i32` coordinates, the seed mixed in first; see [`eval::cell_hash`].
    /// Width 3.
    CellHash {
        /// Width 3; each component is rounded down and clamped to the range of `i32`.
        cell: NodeId,
        /// Width 1; likewise.
        seed: NodeId,
    },
    /// Combines `body` for the loop variable `start ≤ i < end`. An empty sum is 0, product 1, min +∞, max −∞.
    Reduce {
        /// How.
        fold: Fold,
        /// Nesting depth of the variable.
        depth: u8,
        /// First value.
        start: i32,
        /// One past the last.
        end: i32,
        /// What is combined, componentwise.
        body: NodeId,
    },
}
