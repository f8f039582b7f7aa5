//! What checking makes of the syntax trees of all modules: one scene, every name resolved, every expression typed,
//! sugar expanded, values in SI. Lowering turns it into a field graph and meets no user error that could be known here.

use crate::ir::{
    Aa, Backend, Bands, BandsKind, Filter, Fold, Param, ParamId, Pixels, Scattering, SplatBlend, SplatsId, Stacks,
    Tonemap,
};
use crate::loader::{GridHeader, MeshHeader, SplatsHeader};
use crate::source::Span;

/// Exponents of length, time, light and pixel in twelfths, so that square and cube roots stay exact.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, Default)]
#[expect(missing_docs, reason = "named as the dimensions")]
pub struct Dim {
    pub length: i16,
    pub time: i16,
    pub light: i16,
    pub pixel: i16,
}

/// The type of an expression.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Type {
    /// A scalar of some dimension.
    Number(Dim),
    /// Two of them.
    Vec2(Dim),
    /// Three of them: positions, directions.
    Vec3(Dim),
    /// One per band.
    Spectrum(Dim),
    /// Three linear components 0..1 (alpha apart).
    Color,
    /// A truth value.
    Bool,
    /// Text.
    String,
    /// A colour and an extinction.
    Layer,
    /// Voxels.
    Grid,
    /// A region of space.
    Shape,
    /// An affine map of space.
    Transform,
}

/// Identifies a function of [`Scene::functions`].
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct FunctionId(pub u32);
/// Identifies a table or transfer function of [`Scene::tables`].
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct TableId(pub u32);
/// Identifies a grid of [`Scene::grids`].
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct GridId(pub u32);
/// Identifies a constant of [`Scene::constants`].
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct ConstId(pub u32);
/// A name bound inside one expression tree (parameter, `let`, loop variable); unique within its function, constant or property.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct LocalId(pub u32);

/// A typed expression.
#[derive(Clone, Debug, PartialEq)]
pub struct Expr {
    /// Its form.
    pub kind: ExprKind,
    /// Its type.
    pub ty: Type,
    /// Where it is written.
    pub span: Span,
}

/// Implicit inputs.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum Input {
    /// `p`, Vec3(length); the medium's own space under `transform`.
    Position,
    /// `dir`, Vec3(number).
    Direction,
    /// `lambda`, Spectrum(length): each band's wavelength (the one input that makes an expression spectral).
    Lambda,
    /// `time`, Number(time).
    Time,
    /// `h`, Number(length): altitude over the inner radius of the medium's `shell`.
    Altitude,
    /// `cos_theta`, Number.
    CosTheta,
}

/// The forms of expressions. Operands are typed already; a scalar operand beside a vector, spectrum or colour is widened by lowering.
#[derive(Clone, Debug, PartialEq)]
pub enum ExprKind {
    /// A value in SI.
    Number(f64),
    /// Linear RGB, 0..1, and alpha.
    Color([f64; 4]),
    /// A truth value.
    Bool(bool),
    /// Text.
    String(String),
    /// Implicit input.
    Input(Input),
    /// Live control.
    Param(ParamId),
    /// A constant.
    Const(ConstId),
    /// Bound by a parameter, `let` or loop.
    Local(LocalId),
    /// A grid itself, as an argument of `bounds`, `center`, `gradient` …
    Grid(GridId),
    /// The box around splats: a Shape.
    Splats(SplatsId),
    /// Two or three numbers of one dimension.
    Vector(Vec<Expr>),
    /// `-a`
    Negate(Box<Expr>),
    /// `!a`
    Not(Box<Expr>),
    /// Arithmetic, comparison and logic; `Power` has a constant right side if the left has a dimension.
    Binary(crate::syntax::ast::BinaryOp, Box<Expr>, Box<Expr>),
    /// `if c then a else b`
    If(Box<Expr>, Box<Expr>, Box<Expr>),
    /// Named values, then the value.
    Let(Vec<(LocalId, String, Expr)>, Box<Expr>),
    /// A loop. Bounds are constant once the function is inlined (lowering reports it where they are not).
    Reduce {
        /// How values are combined.
        fold: Fold,
        /// The loop variable, a Number.
        variable: LocalId,
        /// Its name.
        name: String,
        /// First value.
        start: Box<Expr>,
        /// One past the last.
        end: Box<Expr>,
        /// What is combined.
        body: Box<Expr>,
    },
    /// A function of the scene or the library; one argument per parameter, defaults filled in.
    Call(FunctionId, Vec<Expr>),
    /// A table (result Number) or transfer function (result Layer) at a key. A table at a Spectrum of keys is a Spectrum:
    /// each band's value at each band's key.
    Lookup(TableId, Box<Expr>),
    /// A grid at a world position.
    Sample(GridId, Box<Expr>),
    /// Something of the prelude; one argument per parameter of [`Builtin`]'s signature, defaults filled in.
    Builtin(Builtin, Vec<Expr>),
    /// Components of a Vec2, Vec3 (`.x`, `.xy`, …) or of a Color (`.r` …); indices into the vector.
    Swizzle(Box<Expr>, Vec<u8>),
    /// `.color` of a layer.
    LayerColor(Box<Expr>),
    /// `.k` of a layer.
    LayerK(Box<Expr>),
}

/// The prelude beyond operators. Arguments in the order given.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "named as in the language; see the reference in grammar/")]
pub enum Builtin {
    // Componentwise on scalars, vectors, spectra.
    Exp,
    Expm1,
    Log,
    Log2,
    Log10,
    Exp2,
    Sqrt,
    Cbrt,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Abs,
    Sign,
    Floor,
    Ceil,
    Round,
    Fract,
    /// (y, x)
    Atan2,
    /// (a, b, …) two or more
    Min,
    /// (a, b, …) two or more
    Max,
    /// (a, b)
    Pow,
    /// (a, b)
    Mod,
    /// (x, low, high)
    Clamp,
    /// (a, b, t)
    Mix,
    /// (edge, x)
    Step,
    /// (low, high, x)
    Smoothstep,
    // Vectors.
    Dot,
    Cross,
    Length,
    Distance,
    Normalize,
    /// (incident, normal)
    Reflect,
    /// (x, y) or (x, y, z)
    Vec2,
    Vec3,
    // Spectra and colours.
    /// (r, g, b) of one dimension: one value per band
    Rgb,
    /// (colour): its linear luminance
    Luminance,
    /// (r, g, b): a Color from linear numbers
    Color,
    /// (color, k): a Layer
    Layer,
    /// (a, per): the extinction −ln(1−a)/per of opacity a over a length
    Opacity,
    /// (f, x): the exact derivative of a scalar expression with respect to a Vec3; when f is a grid the first argument is `Sample(grid, x)`
    Gradient,
    // Scattering by spheres.
    /// (radius, n, k, spread, cos_theta): a phase function, one value per band
    Mie,
    /// (radius, n, k, spread): an area per particle, one value per band
    MieScattering,
    MieAbsorption,
    MieExtinction,
    // Noise.
    /// (cell, seed): three uniform numbers, a Vec3
    CellHash3,
    /// (cell, seed): the first of them
    CellHash,
    // Shapes.
    /// (center, radius)
    Sphere,
    /// (center, radii)
    Ellipsoid,
    /// (min, max)
    Box,
    /// (axis, from, to)
    Slab,
    /// (from, to, radius)
    Cylinder,
    /// (center, inner, outer)
    Shell,
    /// (grid)
    Bounds,
    /// (field), a length, negative inside
    Sdf,
    /// ()
    Everywhere,
    /// (a, b, …)
    Union,
    /// (a, b, …)
    Intersection,
    /// (a, b, …): the first without the others
    Difference,
    /// (grid or shape): Vec3(length)
    Center,
    /// (grid or shape): Vec3(length)
    MinCorner,
    /// (grid or shape): Vec3(length)
    MaxCorner,
    /// (grid or shape): Vec3(length)
    Size,
    // Transforms; `a * b` of two transforms is Binary(Multiply), b first.
    /// (offset)
    Translate,
    /// (axis, angle)
    Rotate,
    /// (factor), a Number or a Vec3
    Scale,
}

/// A checked function. Its parameters are the locals `0..parameters.len()`.
#[derive(Clone, Debug, PartialEq)]
pub struct Function {
    /// Its name.
    pub name: String,
    /// Where it is declared.
    pub span: Span,
    /// Names and types.
    pub parameters: Vec<(String, Type)>,
    /// Type of the value.
    pub result: Type,
    /// The value.
    pub body: Expr,
}

/// A table (values of one Number each) or a transfer function.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Its name.
    pub name: String,
    /// Where it is declared.
    pub span: Span,
    /// Type of a key.
    pub key: Type,
    /// Rows in ascending order of constant keys (checked where they are known).
    pub rows: TableRows,
}

/// The rows.
#[derive(Clone, Debug, PartialEq)]
pub enum TableRows {
    /// Key and value.
    Values(Vec<(Expr, Expr)>),
    /// Key, Color and extinction (Number(1/length)).
    Layers(Vec<(Expr, Expr, Expr)>),
}

/// A declared grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Its name.
    pub name: String,
    /// Where it is declared.
    pub span: Span,
    /// The path as written.
    pub path: String,
    /// Name of the source that wrote it.
    pub from: String,
    /// What the file says.
    pub header: GridHeader,
    /// Interpolation.
    pub filter: Filter,
    /// Value beyond the faces.
    pub outside: f64,
}

/// Declared splats.
#[derive(Clone, Debug, PartialEq)]
pub struct Splats {
    /// Their name.
    pub name: String,
    /// Where they are declared.
    pub span: Span,
    /// The path as written.
    pub path: String,
    /// Name of the source that wrote it.
    pub from: String,
    /// What the file holds.
    pub header: SplatsHeader,
    /// A Transform.
    pub transform: Option<Expr>,
    /// How they are blended.
    pub blend: SplatBlend,
}

/// A checked medium, sugar expanded (`k_t`/`albedo`, `transfer`, `mean_free_path`, fog).
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// Its name; `fog` for the fog.
    pub name: String,
    /// Where it is declared.
    pub span: Span,
    /// A Shape; `None` is everywhere.
    pub shape: Option<Expr>,
    /// A Transform.
    pub transform: Option<Expr>,
    /// Number: scales the three coefficients.
    pub density: Option<Expr>,
    /// Number or Spectrum of 1/length; `None` is 0.
    pub k_a: Option<Expr>,
    /// Number or Spectrum of 1/length; `None` is 0.
    pub k_s: Option<Expr>,
    /// Number or Spectrum of light/length; `None` is 0.
    pub k_e: Option<Expr>,
    /// Number: a function of `cos_theta`; `None` is isotropic.
    pub phase: Option<Expr>,
    /// The layer of `transfer = f(x)`, from which k_a and k_e above were made.
    pub transfer: Option<Expr>,
}

/// A checked light.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Its name.
    pub name: String,
    /// Where it is declared.
    pub span: Span,
    /// Which kind.
    pub kind: LightKind,
}

/// The kinds of lights.
#[derive(Clone, Debug, PartialEq)]
pub enum LightKind {
    /// Parallel light.
    Directional {
        /// Vec3, the direction the light travels.
        direction: Expr,
        /// Number or Spectrum of light.
        irradiance: Expr,
        /// Number: radians, if it is a disc.
        angular_diameter: Option<Expr>,
    },
    /// A point, or a small ball.
    Point {
        /// Vec3(length).
        position: Expr,
        /// Number or Spectrum of light·length² (or light).
        intensity: Expr,
        /// Number(length).
        radius: Option<Expr>,
    },
    /// From everywhere: radiance as a field of `dir`.
    Environment {
        /// Number or Spectrum of light.
        radiance: Expr,
    },
}

/// A checked surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Its name.
    pub name: String,
    /// Where it is declared.
    pub span: Span,
    /// Which form.
    pub shape: SurfaceShape,
    /// Number, Spectrum or Color.
    pub albedo: Option<Expr>,
}

/// Forms of surfaces.
#[derive(Clone, Debug, PartialEq)]
pub enum SurfaceShape {
    /// Point and normal.
    Plane {
        /// Vec3(length).
        point: Expr,
        /// Vec3.
        normal: Expr,
    },
    /// Centre, normal, radius.
    Disc {
        /// Vec3(length).
        center: Expr,
        /// Vec3.
        normal: Expr,
        /// Number(length).
        radius: Expr,
    },
    /// The boundary of a region.
    Boundary(Expr),
    /// Triangles from a file.
    Mesh {
        /// As written.
        path: String,
        /// The source that wrote it.
        from: String,
        /// What the file holds.
        header: MeshHeader,
    },
}

/// A checked camera. `None`s are framed on the scene's bounds by lowering.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Where the block is, if there is one.
    pub span: Option<Span>,
    /// Vec3(length).
    pub from: Option<Expr>,
    /// Vec3(length).
    pub to: Option<Expr>,
    /// Vec3; default (0, 1, 0).
    pub up: Option<Expr>,
    /// Which projection.
    pub projection: Projection,
}

/// Projections.
#[derive(Clone, Debug, PartialEq)]
pub enum Projection {
    /// Number: vertical, radians; default 45°.
    Perspective(Option<Expr>),
    /// Number(length).
    Orthographic(Expr),
    /// All around.
    Panorama,
}

/// A checked `image`.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Where the block is, if there is one.
    pub span: Option<Span>,
    /// Pixels; default 1024 × 768.
    pub size: [u32; 2],
    /// Anti-aliasing, and where it is asked for.
    pub aa: Aa,
    /// How bands are shown.
    pub bands: BandsKind,
    /// Wavelengths in metres.
    pub wavelengths: Vec<f64>,
    /// Number; `None` is 0.
    pub exposure: Option<Expr>,
    /// Display transform.
    pub tonemap: Tonemap,
    /// Color, Number or Spectrum; `None` is black.
    pub background: Option<Expr>,
}

impl Image {
    /// How the bands are shown, and their wavelengths.
    #[must_use]
    pub fn all_bands(&self) -> Bands {
        Bands { kind: self.bands, wavelengths: self.wavelengths.clone() }
    }
}

/// What a ray collects.
#[derive(Clone, Debug, PartialEq)]
pub enum Composite {
    /// The transfer equation.
    Radiance,
    /// Projection of data.
    Maximum,
    /// Projection of data.
    Minimum,
    /// Projection of data.
    Average,
    /// First surface of this value (Number).
    Isosurface(Expr),
}

/// A checked `render`.
#[derive(Clone, Debug, PartialEq)]
pub struct Render {
    /// Where the block is, if there is one.
    pub span: Option<Span>,
    /// Which backend, as asked for.
    pub backend: Backend,
    /// Orders of scattering; the default follows the contract.
    pub scattering: Scattering,
    /// Whether `scattering` was written.
    pub scattering_explicit: bool,
    /// What a ray collects.
    pub composite: Composite,
    /// A > 0.
    pub accuracy: f64,
    /// Overrides of `accuracy`.
    pub steps: Option<u32>,
    /// Overrides of `accuracy`.
    pub slices: Option<u32>,
    /// Which planes they lie between.
    pub stacks: Stacks,
    /// Overrides of `accuracy`.
    pub splats: Option<u32>,
    /// Overrides of `accuracy`.
    pub samples: Option<u32>,
    /// Which pixels are drawn.
    pub pixels: Pixels,
    /// Cap on steps per ray.
    pub max_work: u32,
}

/// Something that is checked but that no backend can draw yet: text, styles.
#[derive(Clone, Debug, PartialEq)]
pub struct Pending {
    /// `text`, `style`.
    pub kind: crate::syntax::ast::BlockKind,
    /// Its name.
    pub name: String,
    /// Where it is declared.
    pub span: Span,
}

/// A whole checked scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Live controls (dimension, default and range in SI), indexed by `ParamId`.
    pub params: Vec<Param>,
    /// Constants with their names.
    pub constants: Vec<(String, Expr)>,
    /// Functions of the scene, and those of modules that it uses.
    pub functions: Vec<Function>,
    /// Tables and transfer functions.
    pub tables: Vec<Table>,
    /// Grids.
    pub grids: Vec<Grid>,
    /// Media, the fog last.
    pub media: Vec<Medium>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Opaque surfaces.
    pub surfaces: Vec<Surface>,
    /// 3D Gaussian splats.
    pub splats: Vec<Splats>,
    /// What no backend draws yet.
    pub pending: Vec<Pending>,
    /// The camera.
    pub camera: Camera,
    /// The picture.
    pub image: Image,
    /// The schedule.
    pub render: Render,
}
