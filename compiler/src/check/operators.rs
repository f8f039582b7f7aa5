//! Operators: what they make of their operands.

use super::Checker;
use super::coerce::{self, Role};
use super::hir::{Dim, ExprKind};
use super::scope::Scope;
use super::types::{D, Form, Ty, Value};
use crate::diagnostic::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::{self, BinaryOp, UnaryOp};

/// How an operator is written.
pub(super) fn symbol(op: BinaryOp) -> &'static str {
    match op {
        BinaryOp::Or => "||",
        BinaryOp::And => "&&",
        BinaryOp::Equal => "==",
        BinaryOp::NotEqual => "!=",
        BinaryOp::Less => "<",
        BinaryOp::LessEqual => "<=",
        BinaryOp::Greater => ">",
        BinaryOp::GreaterEqual => ">=",
        BinaryOp::Add => "+",
        BinaryOp::Subtract => "-",
        BinaryOp::Multiply => "*",
        BinaryOp::Divide => "/",
        BinaryOp::Power => "^",
    }
}

impl Checker<'_> {
    pub(super) fn unary(&mut self, op: UnaryOp, operand: &ast::Expr, span: Span, scope: &mut Scope) -> Value {
        let value = self.expression(operand, scope);
        match (op, value.ty) {
            (_, Ty::Error) => Value::error(span),
            (UnaryOp::Negate, Ty::Numeric(..)) => {
                let ty = value.ty;
                match value.kind {
                    ExprKind::Number(n) => Value::new(ExprKind::Number(-n), ty, span),
                    _ => Value::new(ExprKind::Negate(value.boxed()), ty, span),
                }
            }
            (UnaryOp::Not, Ty::Bool) => Value::new(ExprKind::Not(value.boxed()), Ty::Bool, span),
            (UnaryOp::Negate, other) => {
                self.report(
                    Diagnostic::error("E0307", format!("`-` takes a number, not {}", other.prose()))
                        .at(value.span, format!("this is {}", other.prose())),
                );
                Value::error(span)
            }
            (UnaryOp::Not, other) => {
                self.report(
                    Diagnostic::error("E0307", format!("`!` takes true or false, not {}", other.prose()))
                        .at(value.span, format!("this is {}", other.prose())),
                );
                Value::error(span)
            }
        }
    }

    /// An operator between two checked values.
    pub(super) fn binary(&mut self, op: BinaryOp, op_span: Span, left: Value, right: Value, span: Span) -> Value {
        if left.ty.is_error() || right.ty.is_error() {
            return Value::error(span);
        }
        match op {
            BinaryOp::Or | BinaryOp::And => self.logic(op, left, right, span),
            BinaryOp::Equal
            | BinaryOp::NotEqual
            | BinaryOp::Less
            | BinaryOp::LessEqual
            | BinaryOp::Greater
            | BinaryOp::GreaterEqual => self.comparison(op, op_span, left, right, span),
            BinaryOp::Add | BinaryOp::Subtract => self.sum(op, op_span, left, right, span),
            BinaryOp::Multiply | BinaryOp::Divide => self.product(op, op_span, left, right, span),
            BinaryOp::Power => self.power(left, right, span),
        }
    }

    fn logic(&mut self, op: BinaryOp, left: Value, right: Value, span: Span) -> Value {
        let words = format!("each side of `{}`", symbol(op));
        let left = self.coerce(left, Ty::Bool, Role::Words(&words));
        let right = self.coerce(right, Ty::Bool, Role::Words(&words));
        if left.ty.is_error() || right.ty.is_error() {
            return Value::error(span);
        }
        Value::new(ExprKind::Binary(op, left.boxed(), right.boxed()), Ty::Bool, span)
    }

    fn comparison(&mut self, op: BinaryOp, op_span: Span, mut left: Value, mut right: Value, span: Span) -> Value {
        let equality = matches!(op, BinaryOp::Equal | BinaryOp::NotEqual);
        match (left.ty, right.ty) {
            (Ty::Numeric(Form::Scalar, a), Ty::Numeric(Form::Scalar, b)) => match a.unify(b) {
                Some(dim) => {
                    left.ty = Ty::Numeric(Form::Scalar, dim);
                    right.ty = left.ty;
                    return Value::new(ExprKind::Binary(op, left.boxed(), right.boxed()), Ty::Bool, span);
                }
                None => self.different_dimensions(op, op_span, &left, &right),
            },
            (Ty::Bool, Ty::Bool) if equality => {
                return Value::new(ExprKind::Binary(op, left.boxed(), right.boxed()), Ty::Bool, span);
            }
            (a, b) => {
                let odd = if matches!(a, Ty::Numeric(Form::Scalar, _)) { (b, right.span) } else { (a, left.span) };
                let problem =
                    Diagnostic::error("E0310", format!("`{}` compares numbers, not {}", symbol(op), odd.0.prose()))
                        .at(odd.1, format!("this is {}", odd.0.prose()));
                self.report(match odd.0 {
                    Ty::Numeric(Form::Spectrum, _) => problem
                        .note("a spectrum has one value per band, and the bands may not agree")
                        .hint("`step(edge, x)` and `smoothstep(low, high, x)` choose band by band"),
                    Ty::Numeric(Form::Vec2 | Form::Vec3, _) => {
                        problem.hint("compare a component or the length: `v.y < …`, `length(v) < …`")
                    }
                    Ty::Numeric(Form::Scalar, _)
                    | Ty::Color
                    | Ty::Bool
                    | Ty::String
                    | Ty::Layer
                    | Ty::Grid
                    | Ty::Shape
                    | Ty::Transform
                    | Ty::Error => problem,
                });
            }
        }
        Value::error(span)
    }

    /// Both sides are numbers, of dimensions that do not agree.
    pub(super) fn different_dimensions(&mut self, op: BinaryOp, op_span: Span, left: &Value, right: &Value) {
        let verb = match op {
            BinaryOp::Add => "add",
            BinaryOp::Subtract => "subtract",
            _ => "compare",
        };
        let message = format!("cannot {verb} {} and {}", left.ty.prose(), right.ty.prose());
        let problem = Diagnostic::error("E0305", message)
            .at(op_span, "needs the same dimension on both sides")
            .because(left.span, format!("this is {}", left.ty.prose()))
            .because(right.span, format!("this is {}", right.ty.prose()));
        let hint = self.unit_hint(left, right).or_else(|| self.unit_hint(right, left));
        self.report(match hint {
            Some(hint) => problem.hint(hint),
            None => problem,
        });
    }

    /// If `bare` has no dimension and the other has one: how it gets it, or the other loses it.
    fn unit_hint(&self, bare: &Value, other: &Value) -> Option<String> {
        let (Ty::Numeric(_, a), Ty::Numeric(_, b)) = (bare.ty, other.ty) else { return None };
        if !a.is_none() {
            return None;
        }
        let text = self.snippet(bare.span);
        if matches!(bare.kind, ExprKind::Number(_) | ExprKind::Vector(_)) {
            return Some(format!("give the number a unit: `{}`", coerce::with_unit(&text, b.known())));
        }
        let other_text = self.snippet(other.span);
        Some(format!("divide the other side: `{}`", coerce::divided(&other_text, b.known())))
    }

    fn sum(&mut self, op: BinaryOp, op_span: Span, mut left: Value, mut right: Value, span: Span) -> Value {
        if let (Ty::Numeric(fa, da), Ty::Numeric(fb, db)) = (left.ty, right.ty) {
            return match (fa.join(fb), da.unify(db)) {
                (Some(form), Some(dim)) => {
                    left.ty = Ty::Numeric(fa, dim);
                    right.ty = Ty::Numeric(fb, dim);
                    let ty = Ty::Numeric(form, dim);
                    Value::new(ExprKind::Binary(op, left.boxed(), right.boxed()), ty, span)
                }
                (Some(_), None) => {
                    self.different_dimensions(op, op_span, &left, &right);
                    Value::error(span)
                }
                (None, _) => {
                    self.no_operator(op, op_span, &left, &right);
                    Value::error(span)
                }
            };
        }
        self.no_operator(op, op_span, &left, &right);
        Value::error(span)
    }

    fn product(&mut self, op: BinaryOp, op_span: Span, left: Value, right: Value, span: Span) -> Value {
        let multiply = op == BinaryOp::Multiply;
        let spectral = Some(Form::Spectrum);
        let (form, dims) = match (left.ty, right.ty) {
            (Ty::Numeric(fa, da), Ty::Numeric(fb, db)) => (fa.join(fb), (da, db)),
            (Ty::Color, Ty::Color) if multiply => {
                return Value::new(ExprKind::Binary(op, left.boxed(), right.boxed()), Ty::Color, span);
            }
            (Ty::Color, Ty::Numeric(Form::Scalar | Form::Spectrum, d)) => (spectral, (D::NONE, d)),
            (Ty::Numeric(Form::Scalar | Form::Spectrum, d), Ty::Color) if multiply => (spectral, (d, D::NONE)),
            (Ty::Transform, Ty::Transform) if multiply => {
                return Value::new(ExprKind::Binary(op, left.boxed(), right.boxed()), Ty::Transform, span);
            }
            _ => (None, (D::NONE, D::NONE)),
        };
        let Some(form) = form else {
            self.no_operator(op, op_span, &left, &right);
            return Value::error(span);
        };
        let dim = match dims {
            // 0 · x stays a 0 of any dimension, so that `0 * 1 m` is still what it says: a length.
            (D::Any, D::Any) => Some(D::Any),
            (a, b) => {
                let (a, b) = (a.known(), b.known());
                (if multiply { a.times(b) } else { a.over(b) }).map(D::Of)
            }
        };
        let Some(dim) = dim else {
            self.report(
                Diagnostic::error("E0311", "the dimension of this product is out of range")
                    .at(span, "far beyond any physics"),
            );
            return Value::error(span);
        };
        Value::new(ExprKind::Binary(op, left.boxed(), right.boxed()), Ty::Numeric(form, dim), span)
    }

    /// `a ^ b`, also as `pow(a, b)`.
    pub(super) fn power(&mut self, left: Value, right: Value, span: Span) -> Value {
        let (Ty::Numeric(base, d), Ty::Numeric(exponent, e)) = (left.ty, right.ty) else {
            self.no_operator(BinaryOp::Power, span, &left, &right);
            return Value::error(span);
        };
        if !e.is_none() {
            let text = self.snippet(right.span);
            self.report(
                Diagnostic::error("E0304", format!("an exponent is a number, not {}", right.ty.prose()))
                    .at(right.span, format!("this is {}", right.ty.prose()))
                    .hint(format!("divide it: `({})`", coerce::divided(&text, e.known()))),
            );
            return Value::error(span);
        }
        let Some(form) = base.join(exponent) else {
            self.no_operator(BinaryOp::Power, span, &left, &right);
            return Value::error(span);
        };
        if d.is_none() {
            let ty = Ty::Numeric(form, D::NONE);
            return Value::new(ExprKind::Binary(BinaryOp::Power, left.boxed(), right.boxed()), ty, span);
        }
        let right_span = right.span;
        let right = right.boxed();
        let Some(value) = self.known_scalar(&right) else {
            let text = self.snippet(left.span);
            self.report(
                Diagnostic::error("E0311", format!("{} can only be raised to a constant power", left.ty.prose()))
                    .at(right_span, "not known when compiling")
                    .note("the dimension of the result would depend on it")
                    .hint(format!("make the base a number: `({})^…`", coerce::divided(&text, d.known()))),
            );
            return Value::error(span);
        };
        let Some(dim) = d.known().power(value) else {
            self.report(
                Diagnostic::error("E0311", format!("{} cannot be raised to the power {value}", left.ty.prose()))
                    .at(right_span, "the result has no dimension that could be written")
                    .note("powers of dimensions are multiples of one twelfth, within reason"),
            );
            return Value::error(span);
        };
        Value::new(ExprKind::Binary(BinaryOp::Power, left.boxed(), right), Ty::Numeric(form, D::Of(dim)), span)
    }

    fn no_operator(&mut self, op: BinaryOp, op_span: Span, left: &Value, right: &Value) {
        let message = format!("`{}` cannot combine {} and {}", symbol(op), left.ty.prose(), right.ty.prose());
        let colours = matches!((left.ty, right.ty), (Ty::Color, _) | (_, Ty::Color));
        let code = if colours { "E0306" } else { "E0307" };
        let mut problem = Diagnostic::error(code, message)
            .at(op_span, "")
            .because(left.span, format!("this is {}", left.ty.prose()))
            .because(right.span, format!("this is {}", right.ty.prose()));
        let hint = match (left.ty, right.ty) {
            (Ty::Color, Ty::Color) => {
                Some("`mix(a, b, t)` blends colours; a colour times a number is a spectrum, and spectra add".to_owned())
            }
            (Ty::Color, Ty::Numeric(..)) | (Ty::Numeric(..), Ty::Color) => {
                Some("a colour times a number is a spectrum, which adds to other spectra: `#f00 * 1 lx`".to_owned())
            }
            (Ty::Layer, _) | (_, Ty::Layer) => Some("take its parts: `.color` and `.k`".to_owned()),
            (Ty::Grid, _) => Some(format!("take its value at a position: `{}(p)`", self.snippet(left.span))),
            (_, Ty::Grid) => Some(format!("take its value at a position: `{}(p)`", self.snippet(right.span))),
            (Ty::Shape, Ty::Shape) => {
                Some("shapes combine with `union(a, b)`, `intersection(a, b)` and `difference(a, b)`".to_owned())
            }
            (Ty::Transform, _) | (_, Ty::Transform) => {
                Some("transforms combine with `*` alone, the right one first".to_owned())
            }
            (Ty::Numeric(Form::Spectrum, _), Ty::Numeric(..)) | (Ty::Numeric(..), Ty::Numeric(Form::Spectrum, _)) => {
                Some(
                    "a spectrum has one value per band, a vector one per axis; `rgb(r, g, b)` makes a spectrum"
                        .to_owned(),
                )
            }
            _ => None,
        };
        if let Some(hint) = hint {
            problem = problem.hint(hint);
        }
        self.report(problem);
    }
}

/// The dimension of a product of two, where it is in range.
pub(super) fn times(a: D, b: D) -> Option<Dim> {
    a.known().times(b.known())
}
