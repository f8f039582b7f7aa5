//! Kernels: the small imperative language between backends and `emit`. Backends write it, `emit` makes naga of it.
//!
//! Semantics are WGSL's on typed values. There is no recursion: a function calls only functions before it.
//! Every `Loop` must end by itself; backends give each a counter with a cap.

use crate::source::Span;
use std::sync::Arc;

/// Scalar types of the machine.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the types")]
pub enum Prim {
    Bool,
    F32,
    I32,
    U32,
}

/// Types of the machine.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum Ty {
    /// One component (`width` 1) or a vector of 2 to 4.
    Value(Prim, u8),
    /// A struct of the kernel, by index.
    Struct(u32),
}

impl Ty {
    /// `bool`
    pub const BOOL: Self = Self::Value(Prim::Bool, 1);
    /// `f32`
    pub const F32: Self = Self::Value(Prim::F32, 1);
    /// `i32`
    pub const I32: Self = Self::Value(Prim::I32, 1);
    /// `u32`
    pub const U32: Self = Self::Value(Prim::U32, 1);
    /// `vec3<f32>`
    pub const VEC3: Self = Self::Value(Prim::F32, 3);

    /// `f32` or `vecN<f32>`.
    #[must_use]
    pub fn float(width: u8) -> Self {
        Self::Value(Prim::F32, width)
    }
}

/// A struct declaration.
#[derive(Clone, Debug, PartialEq)]
pub struct Struct {
    /// Its name.
    pub name: String,
    /// Names and types; values only, no structs within structs.
    pub fields: Vec<(String, Ty)>,
    /// What of the rasteriser it carries, if anything.
    pub carries: Option<Carries>,
}

/// What passes through the rasteriser in a struct.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum Carries {
    /// From vertices to fragments. Field 0 is the position, vec4 of f32: in clip space for a vertex, and for a fragment the
    /// centre of its pixel in x and y. Integers after it are those of the triangle's first vertex; floats are interpolated.
    Varyings,
    /// From fragments to the targets of the pass: field `i` is blended into target `i`. vec4 of f32 each.
    Colors,
}

/// Which part of a pass an entry point is.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum Stage {
    /// One invocation per ray (or whatever the plan says), in workgroups of this size.
    Compute([u32; 3]),
    /// One invocation per vertex of a triangle; returns a struct of [`Carries::Varyings`].
    Vertex,
    /// One invocation per pixel that a triangle covers; from a struct of [`Carries::Varyings`] to one of [`Carries::Colors`].
    Fragment,
}

/// Something bound from outside; its binding number is its index, its group 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Resource {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: ResourceKind,
}

/// Kinds of resources.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum ResourceKind {
    /// `var<uniform>` of a struct; at most one per kernel. Read by [`Expr::Uniform`].
    Uniform(u32),
    /// `var<storage, read> array<T>`.
    ReadBuffer(Ty),
    /// `var<storage, read_write> array<T>`.
    WriteBuffer(Ty),
    /// `texture_3d<T>` of f32, i32 or u32.
    Texture3d(Prim),
    /// `texture_2d<f32>`: what fragments were blended into.
    Texture2d,
    /// `var<workgroup> array<T, N>`: memory that the invocations of a workgroup share. Nothing is bound to it, and it begins
    /// as anything: what is read has been written before.
    Workgroup(Ty, u32),
}

/// A local of a function.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LocalId(pub u32);

/// A function of the kernel, by index.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FunctionId(pub u32);

/// Declaration of a local: a `let` or a `var`.
#[derive(Clone, Debug, PartialEq)]
pub struct Local {
    /// The name wanted; `emit` makes it unique in its function and a legal identifier.
    pub name: String,
    /// Its type.
    pub ty: Ty,
    /// The expression of the scene it stands for, for the source map.
    pub origin: Option<Span>,
}

/// A function.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Function {
    /// The name wanted.
    pub name: String,
    /// Names and types.
    pub parameters: Vec<(String, Ty)>,
    /// What it returns.
    pub result: Option<Ty>,
    /// Its locals, indexed by [`LocalId`].
    pub locals: Vec<Local>,
    /// What it does; every path returns if there is a result.
    pub body: Vec<Stmt>,
    /// The item or property of the scene it stands for.
    pub origin: Option<Span>,
}

/// A kernel: one entry point and what it calls.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    /// Name of the entry point.
    pub name: String,
    /// Which part of a pass it is.
    pub stage: Stage,
    /// Structs.
    pub structs: Vec<Struct>,
    /// What is bound.
    pub resources: Vec<Resource>,
    /// Functions, callees first.
    pub functions: Vec<Function>,
    /// The entry point: without parameters or result but those that its stage asks for.
    pub entry: Function,
}

impl Kernel {
    /// Size of a workgroup; 1 × 1 × 1 for what is drawn.
    #[must_use]
    pub fn workgroup(&self) -> [u32; 3] {
        match self.stage {
            Stage::Compute(size) => size,
            Stage::Vertex | Stage::Fragment => [1; 3],
        }
    }

    /// Bytes that the invocations of a workgroup may share.
    #[must_use]
    pub fn shared_bytes(&self) -> u64 {
        let bytes = self.resources.iter().map(|r| match r.kind {
            ResourceKind::Workgroup(Ty::Value(_, width), length) => 4 * u64::from(width) * u64::from(length),
            ResourceKind::Workgroup(Ty::Struct(_), _)
            | ResourceKind::Uniform(_)
            | ResourceKind::ReadBuffer(_)
            | ResourceKind::WriteBuffer(_)
            | ResourceKind::Texture3d(_)
            | ResourceKind::Texture2d => 0,
        });
        bytes.sum()
    }
}

/// A statement.
#[derive(Clone, Debug, PartialEq)]
pub enum Stmt {
    /// Binds an immutable local.
    Let(LocalId, Expr),
    /// Declares a mutable local with its first value.
    Var(LocalId, Expr),
    /// Sets a mutable local.
    Assign(LocalId, Expr),
    /// A branch.
    If(Expr, Vec<Stmt>, Vec<Stmt>),
    /// Repeats until `Break` or `Return`.
    Loop(Vec<Stmt>),
    /// Leaves the innermost loop.
    Break,
    /// Begins the innermost loop anew.
    Continue,
    /// Leaves the function.
    Return(Option<Expr>),
    /// `buffer[index] = value`
    Store {
        /// A [`ResourceKind::WriteBuffer`] or [`ResourceKind::Workgroup`], by index of the resource.
        buffer: u32,
        /// u32.
        index: Expr,
        /// Of the element type.
        value: Expr,
    },
    /// Waits for all invocations of the workgroup; what each has stored in memory of the workgroup before is seen by all after.
    /// Only in the outermost block of the entry point of a compute kernel, where none has returned.
    Barrier,
}

/// Unary operators.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the operators")]
pub enum UnaryOp {
    Neg,
    Not,
}

/// Binary operators, componentwise on equal types; a shift takes u32 on the right.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the operators")]
pub enum BinaryOp {
    Add,
    Sub,
    Mul,
    Div,
    Rem,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Equal,
    NotEqual,
    And,
    Or,
    BitAnd,
    BitOr,
    BitXor,
    ShiftLeft,
    ShiftRight,
}

/// Built-in functions, WGSL's of the same name.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the functions")]
pub enum Math {
    Abs,
    Sign,
    Floor,
    Ceil,
    Round,
    Sqrt,
    InverseSqrt,
    Exp,
    Log,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Atan2,
    Sinh,
    Cosh,
    Tanh,
    Pow,
    Min,
    Max,
    Clamp,
    Dot,
    Cross,
    Length,
    Normalize,
}

/// An expression. Parts are shared, so that a copy costs nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum Expr {
    /// f32, rounded from this number; must be finite in f32.
    F32(f64),
    /// i32
    I32(i32),
    /// u32
    U32(u32),
    /// bool
    Bool(bool),
    /// A local.
    Local(LocalId),
    /// A parameter of the function.
    Argument(u32),
    /// A field of the uniform struct.
    Uniform(u32),
    /// `@builtin(global_invocation_id)`, vec3 of u32; in the entry point of a compute kernel only.
    GlobalId,
    /// `@builtin(workgroup_id)`, vec3 of u32; likewise.
    GroupId,
    /// `@builtin(local_invocation_index)`, u32; likewise.
    LocalIndex,
    /// `@builtin(vertex_index)`, u32; in the entry point of a vertex kernel only.
    VertexIndex,
    /// `@builtin(instance_index)`, u32; likewise.
    InstanceIndex,
    /// Prefix operator.
    Unary(UnaryOp, Arc<Expr>),
    /// Infix operator.
    Binary(BinaryOp, Arc<Expr>, Arc<Expr>),
    /// Built-in function.
    Math(Math, Vec<Expr>),
    /// A vector from scalars, or a struct from its fields.
    Compose(Ty, Vec<Expr>),
    /// A vector of one scalar.
    Splat(Arc<Expr>, u8),
    /// A component.
    Component(Arc<Expr>, u8),
    /// A field of a struct value.
    Field(Arc<Expr>, u32),
    /// `select(reject, accept, condition)`: condition, accept, reject. The condition is one bool.
    Select(Arc<Expr>, Arc<Expr>, Arc<Expr>),
    /// Conversion of values.
    Convert(Prim, Arc<Expr>),
    /// Reinterpretation of bits.
    Bitcast(Prim, Arc<Expr>),
    /// A call of an earlier function with a result.
    Call(FunctionId, Vec<Expr>),
    /// `textureLoad(texture, at, 0)`: vec4; `at` is vec3 of i32, vec2 for a 2D texture.
    TextureLoad(u32, Arc<Expr>),
    /// `buffer[index]`; the index is u32.
    Load(u32, Arc<Expr>),
}

impl Expr {
    /// A prefix operator.
    #[must_use]
    pub fn unary(op: UnaryOp, a: impl Into<Self>) -> Self {
        Self::Unary(op, Arc::new(a.into()))
    }

    /// An infix operator.
    #[must_use]
    pub fn binary(op: BinaryOp, a: impl Into<Self>, b: impl Into<Self>) -> Self {
        Self::Binary(op, Arc::new(a.into()), Arc::new(b.into()))
    }

    /// A built-in function.
    #[must_use]
    pub fn math<const N: usize>(f: Math, arguments: [Self; N]) -> Self {
        Self::Math(f, arguments.into())
    }

    /// `self < other`
    #[must_use]
    pub fn less(self, other: impl Into<Self>) -> Self {
        Self::binary(BinaryOp::Less, self, other)
    }

    /// `self <= other`
    #[must_use]
    pub fn less_equal(self, other: impl Into<Self>) -> Self {
        Self::binary(BinaryOp::LessEqual, self, other)
    }

    /// `self > other`
    #[must_use]
    pub fn greater(self, other: impl Into<Self>) -> Self {
        Self::binary(BinaryOp::Greater, self, other)
    }

    /// `self >= other`
    #[must_use]
    pub fn greater_equal(self, other: impl Into<Self>) -> Self {
        Self::binary(BinaryOp::GreaterEqual, self, other)
    }

    /// `self == other`
    #[must_use]
    pub fn equal(self, other: impl Into<Self>) -> Self {
        Self::binary(BinaryOp::Equal, self, other)
    }

    /// `self && other`
    #[must_use]
    pub fn and(self, other: impl Into<Self>) -> Self {
        Self::binary(BinaryOp::And, self, other)
    }

    /// `self || other`
    #[must_use]
    pub fn or(self, other: impl Into<Self>) -> Self {
        Self::binary(BinaryOp::Or, self, other)
    }

    /// `min(self, other)`
    #[must_use]
    pub fn min(self, other: impl Into<Self>) -> Self {
        Self::Math(Math::Min, vec![self, other.into()])
    }

    /// `max(self, other)`
    #[must_use]
    pub fn max(self, other: impl Into<Self>) -> Self {
        Self::Math(Math::Max, vec![self, other.into()])
    }

    /// `dot(self, other)`
    #[must_use]
    pub fn dot(self, other: impl Into<Self>) -> Self {
        Self::Math(Math::Dot, vec![self, other.into()])
    }

    /// Square root.
    #[must_use]
    pub fn sqrt(self) -> Self {
        Self::Math(Math::Sqrt, vec![self])
    }

    /// e^self.
    #[must_use]
    pub fn exp(self) -> Self {
        Self::Math(Math::Exp, vec![self])
    }

    /// |self|
    #[must_use]
    pub fn abs(self) -> Self {
        Self::Math(Math::Abs, vec![self])
    }

    /// Component `i`.
    #[must_use]
    pub fn component(self, i: u8) -> Self {
        Self::Component(Arc::new(self), i)
    }

    /// Field `i`.
    #[must_use]
    pub fn field(self, i: u32) -> Self {
        Self::Field(Arc::new(self), i)
    }

    /// One scalar `width` times; a width of 1 is the scalar itself.
    #[must_use]
    pub fn splat(self, width: u8) -> Self {
        if width == 1 { self } else { Self::Splat(Arc::new(self), width) }
    }

    /// `self ? accept : reject`
    #[must_use]
    pub fn select(self, accept: impl Into<Self>, reject: impl Into<Self>) -> Self {
        Self::Select(Arc::new(self), Arc::new(accept.into()), Arc::new(reject.into()))
    }

    /// Conversion of the value.
    #[must_use]
    pub fn convert(self, prim: Prim) -> Self {
        Self::Convert(prim, Arc::new(self))
    }

    /// Reinterpretation of the bits.
    #[must_use]
    pub fn bitcast(self, prim: Prim) -> Self {
        Self::Bitcast(prim, Arc::new(self))
    }

    /// `buffer[index]`
    #[must_use]
    pub fn load(buffer: u32, index: impl Into<Self>) -> Self {
        Self::Load(buffer, Arc::new(index.into()))
    }

    /// `textureLoad(texture, at, 0)`
    #[must_use]
    pub fn texture_load(texture: u32, at: impl Into<Self>) -> Self {
        Self::TextureLoad(texture, Arc::new(at.into()))
    }
}

impl From<LocalId> for Expr {
    fn from(id: LocalId) -> Self {
        Self::Local(id)
    }
}

impl From<f64> for Expr {
    fn from(value: f64) -> Self {
        Self::F32(value)
    }
}

impl From<bool> for Expr {
    fn from(value: bool) -> Self {
        Self::Bool(value)
    }
}

impl From<u32> for Expr {
    fn from(value: u32) -> Self {
        Self::U32(value)
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $op:expr) => {
        impl<T: Into<Expr>> std::ops::$trait<T> for Expr {
            type Output = Expr;
            fn $method(self, other: T) -> Expr {
                Expr::binary($op, self, other)
            }
        }
    };
}
operator!(Add, add, BinaryOp::Add);
operator!(Sub, sub, BinaryOp::Sub);
operator!(Mul, mul, BinaryOp::Mul);
operator!(Div, div, BinaryOp::Div);

impl std::ops::Neg for Expr {
    type Output = Self;
    fn neg(self) -> Self {
        Self::unary(UnaryOp::Neg, self)
    }
}

impl std::ops::Not for Expr {
    type Output = Self;
    fn not(self) -> Self {
        Self::unary(UnaryOp::Not, self)
    }
}
