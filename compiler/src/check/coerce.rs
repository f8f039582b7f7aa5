//! Whether a value fits the place where it stands, and what to say where it does not.

use super::Checker;
use super::hir::{Dim, Expr, ExprKind};
use super::scope::Scope;
use super::types::{D, Form, Ty, Value};
use super::units::is_number_text;
use crate::diagnostic::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::{self, BinaryOp};
use std::fmt;

/// The part that a value plays, for messages.
#[derive(Copy, Clone, Debug)]
pub(super) enum Role<'r> {
    /// Value of a property.
    Property(&'r str),
    /// Argument of a function.
    Argument { function: &'r str, parameter: &'r str },
    /// Value of a function.
    Result(&'r str),
    /// Anything else, in words.
    Words(&'r str),
}

impl fmt::Display for Role<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Property(name) => write!(f, "`{name}`"),
            Self::Argument { function, parameter } => write!(f, "`{parameter}` of `{function}`"),
            Self::Result(name) => write!(f, "the value of `{name}`"),
            Self::Words(words) => f.write_str(words),
        }
    }
}

impl Checker<'_> {
    /// Checks an expression and fits it to a type.
    pub(super) fn expect(&mut self, expression: &ast::Expr, want: Ty, role: Role<'_>, scope: &mut Scope) -> Value {
        let value = self.expression(expression, scope);
        self.coerce(value, want, role)
    }

    /// Fits a value to a type: 0 takes any dimension, a scalar widens; everything else must agree.
    pub(super) fn coerce(&mut self, mut value: Value, want: Ty, role: Role<'_>) -> Value {
        match (value.ty, want) {
            (Ty::Error, _) => value,
            (_, Ty::Error) => Value::error(value.span),
            (Ty::Numeric(form, d), Ty::Numeric(wanted, dim)) => {
                let fits = form == wanted || form == Form::Scalar;
                let Some(dim) = d.unify(dim).filter(|_| fits) else {
                    self.mismatch(&value, want, role);
                    return Value::error(value.span);
                };
                value.ty = Ty::Numeric(form, dim);
                match wanted {
                    Form::Vec2 if form == Form::Scalar => widen(value, 2),
                    Form::Vec3 if form == Form::Scalar => widen(value, 3),
                    Form::Scalar | Form::Vec2 | Form::Vec3 | Form::Spectrum => value,
                }
            }
            (got, want) if got == want => value,
            _ => {
                self.mismatch(&value, want, role);
                Value::error(value.span)
            }
        }
    }

    /// Reports that a value does not fit.
    pub(super) fn mismatch(&mut self, value: &Value, want: Ty, role: Role<'_>) {
        let text = self.snippet(value.span);
        let problem = match (value.ty, want) {
            (Ty::Numeric(form, d), Ty::Numeric(wanted, dim)) if form == wanted || form == Form::Scalar => {
                wrong_dimension(&text, value.span, (form, d.known()), (wanted, dim.known()), role)
            }
            (Ty::Color, Ty::Numeric(Form::Scalar | Form::Spectrum, dim)) => {
                let dim = dim.known();
                let hint = if dim.is_none() {
                    format!("a colour times a number is a spectrum: `{text} * 1`")
                } else {
                    format!("say how strong it is: `{text} * {}`", one(dim))
                };
                Diagnostic::error("E0306", format!("{role} is {}, not a colour", Ty::scalar(dim).prose()))
                    .at(value.span, "a colour")
                    .note("a colour lies between 0 and 1 and has no strength; a coefficient has a dimension and no upper bound")
                    .hint(hint)
            }
            (got @ Ty::Numeric(form, _), Ty::Color) => {
                let inner = text.strip_prefix("rgb").unwrap_or(&text);
                let hint = match form {
                    Form::Scalar => {
                        "build a colour of three numbers from 0 to 1: `color(0.5, 0.5, 0.5)`, or write it as `#808080`"
                            .to_owned()
                    }
                    Form::Spectrum if text.starts_with("rgb(") => {
                        format!("build a colour of numbers from 0 to 1: `color{inner}`")
                    }
                    Form::Vec3 if text.starts_with('(') => {
                        format!("build a colour of numbers from 0 to 1: `color{inner}`")
                    }
                    Form::Vec2 | Form::Vec3 | Form::Spectrum => {
                        "build a colour of three numbers from 0 to 1: `color(r, g, b)`".to_owned()
                    }
                };
                Diagnostic::error("E0306", format!("{role} is a colour, not {}", got.prose()))
                    .at(value.span, format!("this is {}", got.prose()))
                    .hint(hint)
            }
            (got, want) => {
                let single =
                    if let Ty::Numeric(Form::Spectrum, d) = want { Ty::Numeric(Form::Scalar, d) } else { want };
                let problem = Diagnostic::error("E0303", format!("{role} is {}, not {}", single.prose(), got.prose()))
                    .at(value.span, format!("this is {}", got.prose()));
                match hint_for_kind(&text, got, want) {
                    Some(hint) => problem.hint(hint),
                    None => problem,
                }
            }
        };
        self.report(problem);
    }
}

/// A scalar in every component of a vector.
fn widen(value: Value, width: usize) -> Value {
    let Ty::Numeric(_, dim) = value.ty else { return value };
    let form = if width == 2 { Form::Vec2 } else { Form::Vec3 };
    let span = value.span;
    let ty = Ty::Numeric(form, dim);
    let part = |kind: &ExprKind| Expr { kind: kind.clone(), ty: value.ty.hir(), span };
    let simple =
        matches!(value.kind, ExprKind::Number(_) | ExprKind::Local(_) | ExprKind::Param(_) | ExprKind::Const(_));
    if simple {
        return Value::new(ExprKind::Vector((0..width).map(|_| part(&value.kind)).collect()), ty, span);
    }
    let one = Value::number(1.0, Dim::NONE, span).expr();
    let ones = Value::new(ExprKind::Vector(vec![one; width]), Ty::Numeric(form, D::NONE), span);
    Value::new(ExprKind::Binary(BinaryOp::Multiply, value.boxed(), ones.boxed()), ty, span)
}

fn wrong_dimension(
    text: &str,
    span: Span,
    (form, got): (Form, Dim),
    (wanted, dim): (Form, Dim),
    role: Role<'_>,
) -> Diagnostic {
    // A spectrum is wanted where one number for all bands would do as well.
    let want_form = if wanted == Form::Spectrum { Form::Scalar } else { wanted };
    let want_prose = Ty::Numeric(want_form, D::Of(dim)).prose();
    let got_prose = Ty::Numeric(form, D::Of(got)).prose();
    if got.is_none() {
        let bare = if form == Form::Scalar {
            "a bare number".to_owned()
        } else {
            got_prose.replace("of numbers", "of bare numbers")
        };
        return Diagnostic::error("E0301", format!("{role} is {want_prose}, but this is {bare}"))
            .at(span, "has no unit")
            .hint(format!("give it a unit: `{}`", with_unit(text, dim)));
    }
    let problem = Diagnostic::error("E0302", format!("{role} is {want_prose}, but this is {got_prose}"))
        .at(span, format!("this is {got_prose}"));
    let angle = matches!(role, Role::Property("fov" | "angular_diameter") | Role::Argument { parameter: "angle", .. });
    match (number_of_quantity(text), dimension_hint(text, got, dim)) {
        (Some(number), _) if angle => problem.hint(format!("an angle is written `{number} deg`")),
        (_, Some(hint)) => problem.hint(hint),
        (_, None) => problem,
    }
}

/// How a value of one dimension becomes one of another.
pub(super) fn dimension_hint(text: &str, got: Dim, want: Dim) -> Option<String> {
    if let Some(number) = number_of_quantity(text) {
        let right = if want.is_none() { number.to_owned() } else { with_unit(number, want) };
        return Some(format!("write `{right}` if the unit is what is wrong"));
    }
    if want.is_none() {
        return Some(format!("divide by {}: `{}`", Ty::scalar(got).prose(), divided(text, got)));
    }
    let ratio = want.over(got)?;
    if ratio.unit().starts_with('/') {
        let excess = got.over(want)?;
        return Some(format!("divide by {}: `{}`", Ty::scalar(excess).prose(), divided(text, excess)));
    }
    Some(format!("multiply by {}: `{} * {}`", Ty::scalar(ratio).prose(), grouped(text), one(ratio)))
}

/// The number of `2 m`, `1.5e3 lx`.
fn number_of_quantity(text: &str) -> Option<&str> {
    let (number, unit) = text.split_once(' ')?;
    (is_number_text(number) && super::units::unit(unit.split('^').next()?).is_some()).then_some(number)
}

/// `text` made a plain number by dividing by one unit of what it is.
pub(super) fn divided(text: &str, dim: Dim) -> String {
    let text = grouped(text);
    let unit = dim.unit();
    if let Some(below) = unit.strip_prefix('/')
        && !below.contains('/')
    {
        format!("{text} * 1 {below}")
    } else if unit.contains([' ', '/']) {
        format!("{text} / (1 {unit})")
    } else {
        format!("{text} / 1 {unit}")
    }
}

/// `1 m`, `1 /m`, `1 lx / m`.
pub(super) fn one(dim: Dim) -> String {
    format!("1 {}", dim.unit())
}

/// `text` with a unit behind it.
pub(super) fn with_unit(text: &str, dim: Dim) -> String {
    let unit = dim.unit();
    let tuple = text.starts_with('(') && text.ends_with(')') && text.contains(',');
    if is_number_text(text) || (tuple && !unit.contains(' ')) || unit.starts_with('/') {
        format!("{} {unit}", grouped(text))
    } else {
        format!("{} * {unit}", grouped(text))
    }
}

/// `text` as an operand of a product.
pub(super) fn grouped(text: &str) -> String {
    if is_number_text(text) || !is_sum(text) { text.to_owned() } else { format!("({text})") }
}

/// Whether a product would tear this text apart.
fn is_sum(text: &str) -> bool {
    if text.starts_with("if ") {
        return true;
    }
    let mut depth = 0i32;
    let bytes = text.as_bytes();
    for (i, c) in bytes.iter().enumerate() {
        match c {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth -= 1,
            // Between spaces it is an operator; else a sign or part of an exponent.
            b'+' | b'-' | b'<' | b'>' | b'=' | b'&' | b'|' if depth == 0 && i > 0 && bytes[i - 1] == b' ' => {
                return true;
            }
            _ => {}
        }
    }
    false
}

/// What to try where not the dimension but the kind of value is wrong.
fn hint_for_kind(text: &str, got: Ty, want: Ty) -> Option<String> {
    match (got, want) {
        (Ty::Grid, Ty::Numeric(..)) => Some(format!("take its value at a position: `{text}(p)`")),
        (Ty::Grid, Ty::Shape) => Some(format!("take the region it fills: `bounds({text})`")),
        (Ty::Layer, Ty::Numeric(..)) => Some(format!("take its extinction: `{text}.k`")),
        (Ty::Layer, Ty::Color) => Some(format!("take its colour: `{text}.color`")),
        (Ty::Color | Ty::Numeric(..), Ty::Layer) => {
            Some("a layer is made by a `transfer` function or by `layer(color: …, k: …)`".to_owned())
        }
        (Ty::Numeric(Form::Vec3, _), Ty::Numeric(Form::Spectrum, _)) if text.starts_with('(') => {
            let end = text.rfind(')').map_or(text.len(), |i| i + 1);
            let (tuple, rest) = text.split_at(end);
            let unit = rest.trim_start();
            let unit = match unit.as_bytes().first() {
                None => String::new(),
                Some(b'/' | b'*') => format!(" {unit}"),
                Some(_) => format!(" * {unit}"),
            };
            Some(format!("one value per band is written `rgb{tuple}{unit}`"))
        }
        (Ty::Numeric(Form::Spectrum, _), Ty::Numeric(Form::Vec3, _)) if text.starts_with("rgb(") => {
            Some(format!("a position or direction is a tuple: `{}`", &text[3..]))
        }
        (Ty::Numeric(Form::Vec2 | Form::Vec3, _), Ty::Numeric(Form::Scalar, _)) => {
            Some(format!("take a component or the length: `{text}.x`, `length({text})`"))
        }
        (Ty::Numeric(Form::Spectrum, _), Ty::Numeric(Form::Scalar, _)) => {
            Some("a spectrum has one value per band; here one value for all bands is wanted".to_owned())
        }
        (Ty::Bool, Ty::Numeric(..)) => Some(format!("choose between two numbers: `if {text} then 1 else 0`")),
        (Ty::Numeric(..), Ty::Bool) => Some(format!("compare it: `{text} > 0`")),
        (Ty::Numeric(..), Ty::String) if is_number_text(text) => Some(format!("write it in quotes: `\"{text}\"`")),
        (Ty::Shape, Ty::Transform) | (Ty::Transform, Ty::Shape) | (_, _) => None,
    }
}
