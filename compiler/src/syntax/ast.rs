//! The syntax tree: what was written, with spans, before any name or type is known.

use crate::source::Span;

/// An identifier where it stands.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Name {
    /// As written.
    pub text: String,
    /// Where.
    pub span: Span,
}

/// One `.vol` text.
#[derive(Clone, Debug)]
pub struct Module {
    /// `//!` lines at the top, joined, markers removed.
    pub docs: Option<String>,
    /// In order of appearance.
    pub items: Vec<Item>,
    /// Names of items that could not be read; the text has errors then, and uses of these names are not to be reported again.
    pub unread: Vec<Name>,
    /// The whole text.
    pub span: Span,
}

/// A top-level declaration.
#[derive(Clone, Debug)]
pub struct Item {
    /// `///` lines above it, joined, markers removed.
    pub docs: Option<String>,
    /// What it declares.
    pub kind: ItemKind,
    /// From its first word to its last character.
    pub span: Span,
}

/// The kinds of items.
#[derive(Clone, Debug)]
pub enum ItemKind {
    /// `use std::noise::{fbm, worley}` or `use "./lib.vol"::name`.
    Use(Use),
    /// `const pi2 = 2 * pi`.
    Const {
        /// Its name.
        name: Name,
        /// Its value.
        value: Expr,
    },
    /// `param density = 4 /m in 0 /m .. 40 /m`.
    Param {
        /// Its name.
        name: Name,
        /// The value it starts with.
        default: Expr,
        /// Inclusive range, if one is given.
        range: Option<(Expr, Expr)>,
    },
    /// `fn puff(q: vec3) -> number = …`.
    Function(Function),
    /// `table air { 0 km: 1  11 km: 0.297 }`.
    Table {
        /// Its name.
        name: Name,
        /// Key and values of each row; a table's row has one value.
        rows: Vec<Row>,
    },
    /// `transfer tissue { 30: #000, 0 /m }`.
    Transfer {
        /// Its name.
        name: Name,
        /// Key, colour and extinction of each stop.
        rows: Vec<Row>,
    },
    /// Everything of the form `word name? { property = value … }`.
    Block(Block),
}

/// `use` of names from a module.
#[derive(Clone, Debug)]
pub struct Use {
    /// Which module.
    pub module: ModulePath,
    /// The names taken from it.
    pub names: Vec<Name>,
}

/// The module a `use` names.
#[derive(Clone, Debug)]
pub enum ModulePath {
    /// `std::noise`: the words before the last `::`.
    Library(Vec<Name>),
    /// `"./my_lib.vol"`, relative to the file that names it.
    File {
        /// Contents of the string.
        path: String,
        /// The string.
        span: Span,
    },
}

/// A function declaration.
#[derive(Clone, Debug)]
pub struct Function {
    /// Its name.
    pub name: Name,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// What it returns.
    pub result: TypeExpr,
    /// Its value.
    pub body: Expr,
}

/// `q: vec3` or `octaves: number = 4`.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Its name.
    pub name: Name,
    /// Its type.
    pub ty: TypeExpr,
    /// Used when the call leaves it out.
    pub default: Option<Expr>,
}

/// A type as written: `number`, `1/length`, `light/length`, `length^2`, `vec3`, `vec3<length>`, `spectrum<1/length>`.
#[derive(Clone, Debug)]
pub struct TypeExpr {
    /// Its form.
    pub kind: TypeExprKind,
    /// Where.
    pub span: Span,
}

/// The forms of a written type.
#[derive(Clone, Debug)]
pub enum TypeExprKind {
    /// `number`, `length`, `vec3`, `spectrum<…>` …
    Named {
        /// The word.
        name: Name,
        /// What stands in `< >`.
        of: Option<Box<TypeExpr>>,
    },
    /// The `1` of `1/length`.
    One,
    /// `a * b`.
    Product(Box<TypeExpr>, Box<TypeExpr>),
    /// `a / b`.
    Quotient(Box<TypeExpr>, Box<TypeExpr>),
    /// `a ^ n`.
    Power(Box<TypeExpr>, i32),
}

/// A row of a table or transfer function.
#[derive(Clone, Debug)]
pub struct Row {
    /// Before the colon.
    pub key: Expr,
    /// After it, separated by commas.
    pub values: Vec<Expr>,
    /// The whole row.
    pub span: Span,
}

/// The words that open a block of properties.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum BlockKind {
    /// `grid`
    Grid,
    /// `medium`
    Medium,
    /// `light`
    Light,
    /// `splats`
    Splats,
    /// `surface`
    Surface,
    /// `fog`
    Fog,
    /// `style`
    Style,
    /// `text`
    Text,
    /// `camera`
    Camera,
    /// `image`
    Image,
    /// `render`
    Render,
}

impl BlockKind {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Grid,
        Self::Medium,
        Self::Light,
        Self::Splats,
        Self::Surface,
        Self::Fog,
        Self::Style,
        Self::Text,
        Self::Camera,
        Self::Image,
        Self::Render,
    ];

    /// The word in the language.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Grid => "grid",
            Self::Medium => "medium",
            Self::Light => "light",
            Self::Splats => "splats",
            Self::Surface => "surface",
            Self::Fog => "fog",
            Self::Style => "style",
            Self::Text => "text",
            Self::Camera => "camera",
            Self::Image => "image",
            Self::Render => "render",
        }
    }

    /// Whether a name stands between the word and the brace. `fog`, `camera`, `image` and `render` have none.
    #[must_use]
    pub fn is_named(self) -> bool {
        match self {
            Self::Grid | Self::Medium | Self::Light | Self::Splats | Self::Surface | Self::Style | Self::Text => true,
            Self::Fog | Self::Camera | Self::Image | Self::Render => false,
        }
    }
}

/// `word name { property = value … }`.
#[derive(Clone, Debug)]
pub struct Block {
    /// Which word.
    pub kind: BlockKind,
    /// Where the word stands.
    pub word: Span,
    /// The name, for the kinds that have one.
    pub name: Option<Name>,
    /// In order of appearance.
    pub properties: Vec<Property>,
}

/// `name = value`.
#[derive(Clone, Debug)]
pub struct Property {
    /// Before the `=`.
    pub name: Name,
    /// After it.
    pub value: Expr,
}

/// An expression.
#[derive(Clone, Debug)]
pub struct Expr {
    /// Its form.
    pub kind: ExprKind,
    /// From its first to its last character.
    pub span: Span,
}

/// Unary operators.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum UnaryOp {
    /// `-a`
    Negate,
    /// `!a`
    Not,
}

/// Binary operators.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum BinaryOp {
    /// `a || b`
    Or,
    /// `a && b`
    And,
    /// `a == b`
    Equal,
    /// `a != b`
    NotEqual,
    /// `a < b`
    Less,
    /// `a <= b`
    LessEqual,
    /// `a > b`
    Greater,
    /// `a >= b`
    GreaterEqual,
    /// `a + b`
    Add,
    /// `a - b`
    Subtract,
    /// `a * b`
    Multiply,
    /// `a / b`
    Divide,
    /// `a ^ b`
    Power,
}

/// The words of bounded repetition.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum ReduceOp {
    /// `sum(i in a..b) e`
    Sum,
    /// `product(i in a..b) e`
    Product,
    /// `max(i in a..b) e`
    Max,
    /// `min(i in a..b) e`
    Min,
}

/// The forms of expressions.
#[derive(Clone, Debug)]
pub enum ExprKind {
    /// `1.5`
    Number(f64),
    /// `1024 x 768`
    Size(u32, u32),
    /// `"…"`, escapes resolved.
    String(String),
    /// `#rgb`, `#rrggbb`, `#rrggbbaa`: the sRGB-encoded bytes, alpha 255 unless given.
    Color([u8; 4]),
    /// `true`, `false`
    Bool(bool),
    /// A name, a unit standing alone included.
    Name(String),
    /// A number or tuple directly followed by a unit: `2 m^-1`, `(0, 1, 0) m`.
    Quantity {
        /// A `Number` or a `Tuple`.
        value: Box<Expr>,
        /// The unit's name.
        unit: Name,
        /// The unit's power, 1 unless written.
        power: i32,
    },
    /// `(a, b)`, two or more parts; one part in parentheses is just that part.
    Tuple(Vec<Expr>),
    /// `[a, b]`
    List(Vec<Expr>),
    /// Prefix operator.
    Unary {
        /// Which.
        op: UnaryOp,
        /// On what.
        operand: Box<Expr>,
    },
    /// Infix operator.
    Binary {
        /// Which.
        op: BinaryOp,
        /// The operator itself.
        op_span: Span,
        /// Left side.
        left: Box<Expr>,
        /// Right side.
        right: Box<Expr>,
    },
    /// `if c then a else b`
    If {
        /// The condition.
        condition: Box<Expr>,
        /// When it holds.
        accept: Box<Expr>,
        /// When it does not.
        reject: Box<Expr>,
    },
    /// `{ let x = e … last }`
    Block {
        /// The named values, in order.
        lets: Vec<(Name, Expr)>,
        /// The value.
        last: Box<Expr>,
    },
    /// `sum(i in 0..n) body`
    Reduce {
        /// Which.
        op: ReduceOp,
        /// The loop variable.
        variable: Name,
        /// First value.
        start: Box<Expr>,
        /// One past the last value.
        end: Box<Expr>,
        /// What is combined.
        body: Box<Expr>,
    },
    /// `f(a, name: b)`
    Call {
        /// The function's name.
        function: Name,
        /// The arguments, in order.
        arguments: Vec<Argument>,
    },
    /// `e.field`
    Member {
        /// Of what.
        object: Box<Expr>,
        /// Which part.
        field: Name,
    },
}

/// An argument of a call.
#[derive(Clone, Debug)]
pub struct Argument {
    /// The parameter it is for, if named.
    pub name: Option<Name>,
    /// Its value.
    pub value: Expr,
}

/// The unit words of the language. `px` is a length on the screen, `sr` and `rad` are 1.
pub const UNITS: [&str; 13] = ["m", "km", "cm", "mm", "um", "nm", "s", "ms", "deg", "rad", "sr", "lx", "px"];

/// Whether this word is a unit.
#[must_use]
pub fn is_unit(word: &str) -> bool {
    UNITS.contains(&word)
}
