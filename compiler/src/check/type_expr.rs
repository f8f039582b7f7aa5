//! Types as they are written in signatures.

use super::Checker;
use super::hir::Dim;
use super::types::{D, Form, Ty};
use crate::diagnostic::Diagnostic;
use crate::resolve::closest;
use crate::syntax::ast::{self, TypeExpr, TypeExprKind};

const NAMES: &[&str] = &[
    "number",
    "length",
    "time",
    "light",
    "pixel",
    "vec2",
    "vec3",
    "spectrum",
    "color",
    "bool",
    "string",
    "layer",
    "grid",
    "shape",
    "transform",
];

impl Checker<'_> {
    /// The type that is written here.
    pub(super) fn written_type(&mut self, written: &TypeExpr) -> Ty {
        match &written.kind {
            TypeExprKind::Named { name, of: None } => self.named_type(name),
            TypeExprKind::Named { name, of: Some(of) } => {
                let form = match name.text.as_str() {
                    "vec2" => Form::Vec2,
                    "vec3" => Form::Vec3,
                    "spectrum" => Form::Spectrum,
                    other => {
                        if NAMES.contains(&other) {
                            self.report(
                                Diagnostic::error("E0317", format!("`{other}` is made of nothing else"))
                                    .at(written.span, "only `vec2`, `vec3` and `spectrum` take a type in `< >`")
                                    .hint(format!("write `{other}`")),
                            );
                        } else {
                            self.named_type(name);
                        }
                        return Ty::Error;
                    }
                };
                let inner = self.dimension(of);
                inner.map_or(Ty::Error, |dim| Ty::Numeric(form, D::Of(dim)))
            }
            TypeExprKind::One | TypeExprKind::Product(..) | TypeExprKind::Quotient(..) | TypeExprKind::Power(..) => {
                self.dimension(written).map_or(Ty::Error, Ty::scalar)
            }
        }
    }

    fn named_type(&mut self, name: &ast::Name) -> Ty {
        match name.text.as_str() {
            "number" => Ty::NUMBER,
            "length" => Ty::scalar(Dim::LENGTH),
            "time" => Ty::scalar(Dim::TIME),
            "light" => Ty::scalar(Dim::LIGHT),
            "pixel" => Ty::scalar(Dim::PIXEL),
            "vec2" => Ty::Numeric(Form::Vec2, D::NONE),
            "vec3" => Ty::Numeric(Form::Vec3, D::NONE),
            "spectrum" => Ty::Numeric(Form::Spectrum, D::NONE),
            "color" => Ty::Color,
            "bool" => Ty::Bool,
            "string" => Ty::String,
            "layer" => Ty::Layer,
            "grid" => Ty::Grid,
            "shape" => Ty::Shape,
            "transform" => Ty::Transform,
            other => {
                let problem =
                    Diagnostic::error("E0317", format!("there is no type `{other}`")).at(name.span, "not a type");
                let problem = if let Some(unit) = super::units::unit(other) {
                    problem.hint(format!("a type is a dimension, not a unit: `{}`", unit.dim))
                } else if let Some(ours) = meant(other) {
                    problem.hint(format!("did you mean `{ours}`?"))
                } else {
                    problem.note(format!(
                        "the types are `{}`, and products, quotients and powers of dimensions such as `1/length`",
                        NAMES.join("`, `")
                    ))
                };
                self.report(problem);
                Ty::Error
            }
        }
    }

    /// A type that must be a plain scalar of some dimension.
    fn dimension(&mut self, written: &TypeExpr) -> Option<Dim> {
        let dim = match &written.kind {
            TypeExprKind::One => Some(Dim::NONE),
            TypeExprKind::Named { .. } => match self.written_type(written) {
                Ty::Numeric(Form::Scalar, d) => Some(d.known()),
                Ty::Error => return None,
                other => {
                    let mut problem = Diagnostic::error("E0317", format!("`{other}` is not a dimension"))
                        .at(written.span, "only numbers with a dimension multiply and divide in a type");
                    if matches!(other, Ty::Numeric(..)) {
                        problem = problem.hint("put the dimension inside: `vec3<1/length>`, `spectrum<1/length>`");
                    }
                    self.report(problem);
                    return None;
                }
            },
            TypeExprKind::Product(a, b) => {
                let (a, b) = (self.dimension(a), self.dimension(b));
                a?.times(b?)
            }
            TypeExprKind::Quotient(a, b) => {
                let (a, b) = (self.dimension(a), self.dimension(b));
                a?.over(b?)
            }
            TypeExprKind::Power(a, power) => self.dimension(a)?.power(f64::from(*power)),
        };
        if dim.is_none() {
            self.report(
                Diagnostic::error("E0317", "the powers of this type are out of range")
                    .at(written.span, "far beyond any physics"),
            );
        }
        dim
    }
}

/// The type that a name of another language stands for.
fn meant(name: &str) -> Option<&'static str> {
    const OTHERS: &[(&str, &str)] = &[
        ("float", "number"),
        ("f32", "number"),
        ("f64", "number"),
        ("double", "number"),
        ("int", "number"),
        ("real", "number"),
        ("scalar", "number"),
        ("num", "number"),
        ("boolean", "bool"),
        ("str", "string"),
        ("text", "string"),
        ("vec", "vec3"),
        ("vector", "vec3"),
        ("float3", "vec3"),
        ("vec3f", "vec3"),
        ("point", "vec3<length>"),
        ("position", "vec3<length>"),
        ("rgb", "spectrum"),
        ("colour", "color"),
        ("radiance", "light"),
        ("irradiance", "light"),
        ("distance", "length"),
        ("duration", "time"),
        ("angle", "number"),
        ("coefficient", "1/length"),
        ("volume", "grid"),
    ];
    let lower = name.to_lowercase();
    let other = OTHERS.iter().find(|(theirs, _)| *theirs == lower).map(|(_, ours)| *ours);
    other.or_else(|| closest(name, NAMES.iter().copied()))
}
