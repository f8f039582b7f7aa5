//! Types during checking: those of the checked scene, the literal `0` that fits any dimension, and the type of what
//! is wrong already, which fits everywhere so that one mistake is reported once.

use super::hir::{self, Dim, ExprKind, Type};
use crate::source::Span;
use std::fmt;

/// How many numbers a value holds.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Form {
    Scalar,
    Vec2,
    Vec3,
    Spectrum,
}

impl Form {
    /// A scalar widens to anything; nothing else mixes.
    pub(super) fn join(self, other: Self) -> Option<Self> {
        match (self, other) {
            (Self::Scalar, form) | (form, Self::Scalar) => Some(form),
            (a, b) => (a == b).then_some(a),
        }
    }
}

/// A dimension, or that of a literal 0.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum D {
    Any,
    Of(Dim),
}

impl D {
    pub(super) const NONE: Self = Self::Of(Dim::NONE);

    /// The dimension, a plain number's where any would do.
    pub(super) fn known(self) -> Dim {
        match self {
            Self::Any => Dim::NONE,
            Self::Of(dim) => dim,
        }
    }

    /// The one dimension that fits both.
    pub(super) fn unify(self, other: Self) -> Option<Self> {
        match (self, other) {
            (Self::Any, d) | (d, Self::Any) => Some(d),
            (a, b) => (a == b).then_some(a),
        }
    }

    pub(super) fn is_none(self) -> bool {
        self.known().is_none()
    }
}

/// The type of a value during checking.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Ty {
    Numeric(Form, D),
    Color,
    Bool,
    String,
    Layer,
    Grid,
    Shape,
    Transform,
    /// Reported already.
    Error,
}

impl Ty {
    pub(super) const NUMBER: Self = Self::scalar(Dim::NONE);

    pub(super) const fn scalar(dim: Dim) -> Self {
        Self::Numeric(Form::Scalar, D::Of(dim))
    }

    pub(super) const fn vec3(dim: Dim) -> Self {
        Self::Numeric(Form::Vec3, D::Of(dim))
    }

    pub(super) const fn spectrum(dim: Dim) -> Self {
        Self::Numeric(Form::Spectrum, D::Of(dim))
    }

    pub(super) fn of(ty: &Type) -> Self {
        match *ty {
            Type::Number(d) => Self::Numeric(Form::Scalar, D::Of(d)),
            Type::Vec2(d) => Self::Numeric(Form::Vec2, D::Of(d)),
            Type::Vec3(d) => Self::Numeric(Form::Vec3, D::Of(d)),
            Type::Spectrum(d) => Self::Numeric(Form::Spectrum, D::Of(d)),
            Type::Color => Self::Color,
            Type::Bool => Self::Bool,
            Type::String => Self::String,
            Type::Layer => Self::Layer,
            Type::Grid => Self::Grid,
            Type::Shape => Self::Shape,
            Type::Transform => Self::Transform,
        }
    }

    pub(super) fn hir(self) -> Type {
        match self {
            Self::Numeric(form, d) => {
                let dim = d.known();
                match form {
                    Form::Scalar => Type::Number(dim),
                    Form::Vec2 => Type::Vec2(dim),
                    Form::Vec3 => Type::Vec3(dim),
                    Form::Spectrum => Type::Spectrum(dim),
                }
            }
            Self::Color => Type::Color,
            Self::Bool => Type::Bool,
            Self::String => Type::String,
            Self::Layer => Type::Layer,
            Self::Grid => Type::Grid,
            Self::Shape => Type::Shape,
            Self::Transform => Type::Transform,
            Self::Error => Type::Number(Dim::NONE),
        }
    }

    pub(super) fn is_error(self) -> bool {
        self == Self::Error
    }

    /// In words, with its article: `a length`, `a colour`.
    pub(super) fn prose(self) -> String {
        match self {
            Self::Numeric(form, d) => {
                let dim = d.known();
                let of = |what: &str| {
                    if dim.is_none() { format!("a {what} of numbers") } else { format!("a {what} of {dim}") }
                };
                match form {
                    Form::Scalar => match dim {
                        Dim::NONE => "a number".to_owned(),
                        Dim::LENGTH | Dim::TIME => format!("a {dim}"),
                        Dim::LIGHT => "a light strength (`lx`)".to_owned(),
                        Dim::COEFFICIENT => "a coefficient (1/length)".to_owned(),
                        Dim::EMISSION => "an emission (light/length)".to_owned(),
                        Dim::PIXEL => "a size in `px`".to_owned(),
                        Dim::INTENSITY => "an intensity (`lx * m^2`)".to_owned(),
                        Dim::AREA => "an area (length^2)".to_owned(),
                        Dim::VOLUME => "a volume (length^3)".to_owned(),
                        other => format!("a {other}"),
                    },
                    Form::Vec2 => of("vec2"),
                    Form::Vec3 => of("vec3"),
                    Form::Spectrum => of("spectrum"),
                }
            }
            Self::Color => "a colour".to_owned(),
            Self::Bool => "true or false".to_owned(),
            Self::String => "a text".to_owned(),
            Self::Layer => "a layer (colour and extinction)".to_owned(),
            Self::Grid => "a grid".to_owned(),
            Self::Shape => "a shape".to_owned(),
            Self::Transform => "a transform".to_owned(),
            Self::Error => "unknown".to_owned(),
        }
    }
}

/// As it is written in a function's signature.
impl fmt::Display for Ty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = match self {
            Self::Numeric(form, d) => {
                let dim = d.known();
                let name = match form {
                    Form::Scalar => return write!(f, "{dim}"),
                    Form::Vec2 => "vec2",
                    Form::Vec3 => "vec3",
                    Form::Spectrum => "spectrum",
                };
                return if dim.is_none() { f.write_str(name) } else { write!(f, "{name}<{dim}>") };
            }
            Self::Color => "color",
            Self::Bool => "bool",
            Self::String => "string",
            Self::Layer => "layer",
            Self::Grid => "grid",
            Self::Shape => "shape",
            Self::Transform => "transform",
            Self::Error => "?",
        };
        f.write_str(word)
    }
}

/// An expression being checked.
#[derive(Clone, Debug)]
pub(super) struct Value {
    pub(super) kind: ExprKind,
    pub(super) ty: Ty,
    pub(super) span: Span,
}

impl Value {
    pub(super) fn new(kind: ExprKind, ty: Ty, span: Span) -> Self {
        Self { kind, ty, span }
    }

    /// Stands for what was reported already.
    pub(super) fn error(span: Span) -> Self {
        Self::new(ExprKind::Number(0.0), Ty::Error, span)
    }

    pub(super) fn number(value: f64, dim: Dim, span: Span) -> Self {
        Self::new(ExprKind::Number(value), Ty::scalar(dim), span)
    }

    pub(super) fn expr(self) -> hir::Expr {
        hir::Expr { kind: self.kind, ty: self.ty.hir(), span: self.span }
    }

    pub(super) fn boxed(self) -> Box<hir::Expr> {
        Box::new(self.expr())
    }
}
