//! What the prelude makes of its arguments.

use super::Checker;
use super::call::SDF_INPUTS;
use super::coerce::{self, Role};
use super::hir::{Builtin, Dim, Expr, ExprKind};
use super::prelude::Signature;
use super::scope::Scope;
use super::types::{D, Form, Ty, Value};
use crate::diagnostic::Diagnostic;
use crate::source::Span;
use crate::syntax::ast::{self, BinaryOp};

impl Checker<'_> {
    /// A call whose arguments are bound: all that are needed are there.
    pub(super) fn builtin(
        &mut self,
        signature: &'static Signature,
        bound: &[Option<&ast::Expr>],
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        if signature.builtin == Builtin::Gradient
            && let [Some(f), Some(x)] = bound
        {
            return self.gradient(f, x, span, scope);
        }
        if let Builtin::Mie | Builtin::MieScattering | Builtin::MieAbsorption | Builtin::MieExtinction =
            signature.builtin
        {
            return self.mie(signature, bound, span, scope);
        }
        let outside = scope.context.inputs;
        if signature.builtin == Builtin::Sdf {
            scope.context.inputs = SDF_INPUTS;
        }
        let mut values = vec![];
        for (parameter, given) in signature.parameters.iter().zip(bound) {
            let Some(given) = given else { continue };
            let value = self.expression(given, scope);
            let role = Role::Argument { function: signature.name, parameter: parameter.name };
            values.push(match parameter.ty {
                Some(ty) => self.coerce(value, ty, role),
                None => value,
            });
        }
        scope.context.inputs = outside;
        if values.iter().any(|v| v.ty.is_error()) {
            return Value::error(span);
        }
        self.apply(signature, values, span)
    }

    /// `min`, `max`, `union`, `intersection`, `difference`.
    pub(super) fn variadic(&mut self, signature: &'static Signature, values: Vec<Value>, span: Span) -> Value {
        if values.iter().any(|v| v.ty.is_error()) {
            return Value::error(span);
        }
        if matches!(signature.builtin, Builtin::Min | Builtin::Max) {
            return match self.alike(signature, values) {
                Some((values, form, dim)) => builtin(signature, values, Ty::Numeric(form, dim), span),
                None => Value::error(span),
            };
        }
        let mut shapes = vec![];
        for value in values {
            let role = format!("an argument of `{}`", signature.name);
            shapes.push(self.coerce(value, Ty::Shape, Role::Words(&role)));
        }
        if shapes.iter().any(|v| v.ty.is_error()) {
            return Value::error(span);
        }
        builtin(signature, shapes, Ty::Shape, span)
    }

    /// Arguments are checked and fit the parameters that have one type only.
    fn apply(&mut self, signature: &'static Signature, mut values: Vec<Value>, span: Span) -> Value {
        let failed = Value::error(span);
        let spectral = |values: &[Value]| values.iter().any(|v| matches!(v.ty, Ty::Numeric(Form::Spectrum, _)));
        match signature.builtin {
            Builtin::Exp
            | Builtin::Expm1
            | Builtin::Log
            | Builtin::Log2
            | Builtin::Log10
            | Builtin::Exp2
            | Builtin::Sin
            | Builtin::Cos
            | Builtin::Tan
            | Builtin::Asin
            | Builtin::Acos
            | Builtin::Atan
            | Builtin::Sinh
            | Builtin::Cosh
            | Builtin::Tanh
            | Builtin::Floor
            | Builtin::Ceil
            | Builtin::Round
            | Builtin::Fract => {
                let Some((form, d)) = self.numeric_argument(signature, &values[0]) else { return failed };
                if !d.is_none() {
                    self.not_a_number(signature, &values[0]);
                    return failed;
                }
                builtin(signature, values, Ty::Numeric(form, D::NONE), span)
            }
            Builtin::Abs => {
                let Some((form, d)) = self.numeric_argument(signature, &values[0]) else { return failed };
                builtin(signature, values, Ty::Numeric(form, d), span)
            }
            Builtin::Sign => {
                let Some((form, _)) = self.numeric_argument(signature, &values[0]) else { return failed };
                builtin(signature, values, Ty::Numeric(form, D::NONE), span)
            }
            Builtin::Sqrt | Builtin::Cbrt => {
                let Some((form, d)) = self.numeric_argument(signature, &values[0]) else { return failed };
                let root = if signature.builtin == Builtin::Sqrt { 0.5 } else { 1.0 / 3.0 };
                let Some(dim) = d.known().power(root) else {
                    self.report(
                        Diagnostic::error("E0311", format!("{} has no such root", values[0].ty.prose()))
                            .at(values[0].span, "its dimension cannot be divided any further"),
                    );
                    return failed;
                };
                let dim = if d == D::Any { d } else { D::Of(dim) };
                builtin(signature, values, Ty::Numeric(form, dim), span)
            }
            Builtin::Atan2 | Builtin::Step | Builtin::Smoothstep => match self.alike(signature, values) {
                Some((values, form, _)) => builtin(signature, values, Ty::Numeric(form, D::NONE), span),
                None => failed,
            },
            Builtin::Min | Builtin::Max | Builtin::Mod | Builtin::Clamp => match self.alike(signature, values) {
                Some((values, form, dim)) => builtin(signature, values, Ty::Numeric(form, dim), span),
                None => failed,
            },
            Builtin::Mix => self.mix(signature, values, span),
            Builtin::Pow => {
                let (Some(b), Some(a)) = (values.pop(), values.pop()) else { return failed };
                self.power(a, b, span)
            }
            Builtin::Dot | Builtin::Cross | Builtin::Distance => self.two_vectors(signature, values, span),
            Builtin::Length | Builtin::Normalize => {
                let Some((_, d)) = self.vector_argument(signature, &values[0]) else { return failed };
                let form = if let Ty::Numeric(form, _) = values[0].ty { form } else { Form::Vec3 };
                let ty = match signature.builtin {
                    Builtin::Length => Ty::Numeric(Form::Scalar, d),
                    _ => Ty::Numeric(form, D::NONE),
                };
                builtin(signature, values, ty, span)
            }
            Builtin::Reflect => {
                let Some((_, d)) = self.vector_argument(signature, &values[0]) else { return failed };
                builtin(signature, values, Ty::Numeric(Form::Vec3, d), span)
            }
            Builtin::Vec2 | Builtin::Vec3 => {
                let (form, width) = if signature.builtin == Builtin::Vec2 { (Form::Vec2, 2) } else { (Form::Vec3, 3) };
                if let [one] = values.as_slice() {
                    values = vec![one.clone(); width];
                }
                if values.len() != width {
                    let shown = signature.shown();
                    let callee = super::call::Callee { name: signature.name, shown: &shown };
                    self.missing_argument(callee, &["z"], span);
                    return failed;
                }
                self.vector(values, form, span)
            }
            Builtin::Rgb => {
                if spectral(&values) || values.iter().any(|v| !matches!(v.ty, Ty::Numeric(Form::Scalar, _))) {
                    if let Some(odd) = values.iter().find(|v| !matches!(v.ty, Ty::Numeric(Form::Scalar, _))) {
                        self.report(
                            Diagnostic::error("E0303", format!("`rgb` takes three numbers, not {}", odd.ty.prose()))
                                .at(odd.span, format!("this is {}", odd.ty.prose())),
                        );
                    }
                    return failed;
                }
                match self.alike(signature, values) {
                    Some((values, _, dim)) => builtin(signature, values, Ty::Numeric(Form::Spectrum, dim), span),
                    None => failed,
                }
            }
            Builtin::Bounds => {
                if values[0].ty != Ty::Grid && !matches!(values[0].kind, ExprKind::Splats(_)) {
                    self.report(
                        Diagnostic::error(
                            "E0303",
                            format!("`bounds` takes a grid or splats, not {}", values[0].ty.prose()),
                        )
                        .at(values[0].span, format!("this is {}", values[0].ty.prose())),
                    );
                    return failed;
                }
                builtin(signature, values, Ty::Shape, span)
            }
            Builtin::Center | Builtin::MinCorner | Builtin::MaxCorner | Builtin::Size => {
                if !matches!(values[0].ty, Ty::Grid | Ty::Shape) {
                    self.report(
                        Diagnostic::error(
                            "E0303",
                            format!("`{}` takes a grid or a shape, not {}", signature.name, values[0].ty.prose()),
                        )
                        .at(values[0].span, format!("this is {}", values[0].ty.prose())),
                    );
                    return failed;
                }
                builtin(signature, values, Ty::vec3(Dim::LENGTH), span)
            }
            Builtin::Scale => {
                let fits = matches!(values[0].ty, Ty::Numeric(Form::Scalar | Form::Vec3, d) if d.is_none());
                if !fits {
                    self.mismatch(&values[0], Ty::NUMBER, Role::Argument { function: "scale", parameter: "factor" });
                    return failed;
                }
                builtin(signature, values, Ty::Transform, span)
            }
            Builtin::Rotate => {
                self.warn_of_degrees(&values[1]);
                builtin(signature, values, Ty::Transform, span)
            }
            Builtin::CellHash | Builtin::CellHash3 => {
                if values.len() == 1 {
                    values.push(Value::number(0.0, Dim::NONE, span));
                }
                let form = if signature.builtin == Builtin::CellHash { Form::Scalar } else { Form::Vec3 };
                builtin(signature, values, Ty::Numeric(form, D::NONE), span)
            }
            Builtin::Luminance => builtin(signature, values, Ty::NUMBER, span),
            Builtin::Color => builtin(signature, values, Ty::Color, span),
            Builtin::Layer => builtin(signature, values, Ty::Layer, span),
            Builtin::Opacity => builtin(signature, values, Ty::scalar(Dim::COEFFICIENT), span),
            Builtin::Sphere
            | Builtin::Ellipsoid
            | Builtin::Box
            | Builtin::Slab
            | Builtin::Cylinder
            | Builtin::Shell
            | Builtin::Sdf
            | Builtin::Everywhere
            | Builtin::Union
            | Builtin::Intersection
            | Builtin::Difference => builtin(signature, values, Ty::Shape, span),
            Builtin::Translate => builtin(signature, values, Ty::Transform, span),
            // Handled before its arguments are checked.
            Builtin::Gradient
            | Builtin::Mie
            | Builtin::MieScattering
            | Builtin::MieAbsorption
            | Builtin::MieExtinction => failed,
        }
    }

    fn numeric_argument(&mut self, signature: &Signature, value: &Value) -> Option<(Form, D)> {
        if let Some(found) = Self::numeric(value) {
            return Some(found);
        }
        let code = if value.ty == Ty::Color { "E0306" } else { "E0303" };
        let problem = Diagnostic::error(code, format!("`{}` takes numbers, not {}", signature.name, value.ty.prose()))
            .at(value.span, format!("this is {}", value.ty.prose()));
        let text = self.snippet(value.span);
        self.report(match value.ty {
            Ty::Grid => problem.hint(format!("take its value at a position: `{text}(p)`")),
            Ty::Color => problem.hint(format!("take a component, `{text}.r`, or its brightness, `luminance({text})`")),
            _ => problem,
        });
        None
    }

    fn vector_argument(&mut self, signature: &Signature, value: &Value) -> Option<(Form, D)> {
        if let Ty::Numeric(form @ (Form::Vec2 | Form::Vec3), d) = value.ty {
            return Some((form, d));
        }
        let problem =
            Diagnostic::error("E0303", format!("`{}` takes a vector, not {}", signature.name, value.ty.prose()))
                .at(value.span, format!("this is {}", value.ty.prose()));
        let text = self.snippet(value.span);
        self.report(match value.ty {
            Ty::Numeric(Form::Scalar, _) if signature.builtin == Builtin::Length => {
                problem.hint(format!("the size of a number is `abs({text})`"))
            }
            Ty::Grid | Ty::Shape => problem.hint(format!("its extent is `size({text})`")),
            _ => problem,
        });
        None
    }

    /// A function of numbers was given a dimension.
    fn not_a_number(&mut self, signature: &Signature, value: &Value) {
        let Some((_, d)) = Self::numeric(value) else { return };
        let dim = d.known();
        let text = self.snippet(value.span);
        let problem = Diagnostic::error(
            "E0304",
            format!("`{}` takes a number, but this is {}", signature.name, value.ty.prose()),
        )
        .at(value.span, format!("this is {}", value.ty.prose()));
        let problem = match (signature.builtin, dim) {
            (Builtin::Exp | Builtin::Expm1, Dim::COEFFICIENT) => {
                problem.note("an optical depth is a coefficient times a length").hint(format!(
                    "multiply by the length of the path: `{}(… * {})`",
                    signature.name,
                    coerce::grouped(&text)
                ))
            }
            _ => problem.hint(format!(
                "divide by {} that sets the scale: `{}({})`",
                Ty::scalar(dim).prose(),
                signature.name,
                coerce::divided(&text, dim)
            )),
        };
        self.report(problem);
    }

    /// Numbers of one dimension, of forms that go together.
    fn alike(&mut self, signature: &Signature, mut values: Vec<Value>) -> Option<(Vec<Value>, Form, D)> {
        let mut form = Form::Scalar;
        let mut dim = D::Any;
        let mut lead = 0;
        for i in 0..values.len() {
            let (f, d) = self.numeric_argument(signature, &values[i])?;
            let (joined, unified) = (form.join(f), dim.unify(d));
            let (Some(joined), Some(unified)) = (joined, unified) else {
                let (a, b) = (&values[lead], &values[i]);
                let message = format!(
                    "`{}` needs arguments that are alike, not {} and {}",
                    signature.name,
                    a.ty.prose(),
                    b.ty.prose()
                );
                let mut problem = Diagnostic::error("E0305", message)
                    .at(b.span, format!("this is {}", b.ty.prose()))
                    .because(a.span, format!("this is {}", a.ty.prose()));
                if let (Some((_, da)), Some((_, db))) = (Self::numeric(a), Self::numeric(b)) {
                    let bare = if db.is_none() { Some((b, da)) } else { da.is_none().then_some((a, db)) };
                    if let Some((bare, dim)) = bare.filter(|(_, d)| !d.is_none()) {
                        let text = self.snippet(bare.span);
                        problem = problem.hint(format!("give it a unit: `{}`", coerce::with_unit(&text, dim.known())));
                    }
                }
                self.report(problem);
                return None;
            };
            if dim == D::Any || (form == Form::Scalar && f != Form::Scalar) {
                lead = i;
            }
            (form, dim) = (joined, unified);
        }
        for value in &mut values {
            if let Ty::Numeric(f, _) = value.ty {
                value.ty = Ty::Numeric(f, dim);
            }
        }
        Some((values, form, dim))
    }

    fn mix(&mut self, signature: &'static Signature, mut values: Vec<Value>, span: Span) -> Value {
        let Some(t) = values.pop() else { return Value::error(span) };
        let t_form = match t.ty {
            Ty::Numeric(form, d) if d.is_none() => form,
            _ => {
                self.mismatch(&t, Ty::NUMBER, Role::Argument { function: "mix", parameter: "t" });
                return Value::error(span);
            }
        };
        if values.iter().all(|v| v.ty == Ty::Color) {
            if t_form != Form::Scalar {
                self.mismatch(&t, Ty::NUMBER, Role::Argument { function: "mix", parameter: "t" });
                return Value::error(span);
            }
            values.push(t);
            return builtin(signature, values, Ty::Color, span);
        }
        if let (Some(color), Some(other)) =
            (values.iter().find(|v| v.ty == Ty::Color), values.iter().find(|v| v.ty != Ty::Color))
        {
            let message = format!("`mix` needs arguments that are alike, not a colour and {}", other.ty.prose());
            let problem = Diagnostic::error("E0306", message)
                .at(other.span, format!("this is {}", other.ty.prose()))
                .because(color.span, "this is a colour")
                .hint("mix two colours, or multiply the colour by a number to make it a spectrum");
            self.report(problem);
            return Value::error(span);
        }
        let Some((mut values, form, dim)) = self.alike(signature, values) else { return Value::error(span) };
        let Some(form) = form.join(t_form) else {
            self.mismatch(&t, Ty::NUMBER, Role::Argument { function: "mix", parameter: "t" });
            return Value::error(span);
        };
        values.push(t);
        builtin(signature, values, Ty::Numeric(form, dim), span)
    }

    fn two_vectors(&mut self, signature: &'static Signature, values: Vec<Value>, span: Span) -> Value {
        let (Some((fa, da)), Some((fb, db))) =
            (self.vector_argument(signature, &values[0]), self.vector_argument(signature, &values[1]))
        else {
            return Value::error(span);
        };
        let wide = signature.builtin != Builtin::Cross || fa == Form::Vec3;
        if fa != fb || !wide {
            let message =
                format!("`{}` cannot combine {} and {}", signature.name, values[0].ty.prose(), values[1].ty.prose());
            self.report(Diagnostic::error("E0303", message).at(span, format!("its form is `{}`", signature.shown())));
            return Value::error(span);
        }
        if signature.builtin == Builtin::Distance {
            let Some(dim) = da.unify(db) else {
                let [a, b] = values.as_slice() else { return Value::error(span) };
                self.different_dimensions(BinaryOp::Subtract, span, a, b);
                return Value::error(span);
            };
            return builtin(signature, values, Ty::Numeric(Form::Scalar, dim), span);
        }
        let Some(dim) = super::operators::times(da, db) else { return Value::error(span) };
        let form = if signature.builtin == Builtin::Dot { Form::Scalar } else { Form::Vec3 };
        builtin(signature, values, Ty::Numeric(form, D::Of(dim)), span)
    }

    /// An angle that is plainly meant in degrees.
    pub(super) fn warn_of_degrees(&mut self, angle: &Value) {
        let ExprKind::Number(value) = angle.kind else { return };
        let text = self.snippet(angle.span);
        if value.abs() > std::f64::consts::TAU && super::units::is_number_text(&text) {
            self.report(
                Diagnostic::warning("W0302", format!("an angle of {text} is in radians, more than a whole turn"))
                    .at(angle.span, "has no unit")
                    .hint(format!("if degrees are meant, write `{text} deg`")),
            );
        }
    }
}

fn builtin(signature: &Signature, values: Vec<Value>, ty: Ty, span: Span) -> Value {
    let arguments: Vec<Expr> = values.into_iter().map(Value::expr).collect();
    Value::new(ExprKind::Builtin(signature.builtin, arguments), ty, span)
}
