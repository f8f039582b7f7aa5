//! Expressions: one function per form of the tree.

use super::Checker;
use super::coerce::Role;
use super::hir::{Dim, ExprKind};
use super::scope::{Bound, Scope};
use super::types::{D, Form, Ty, Value};
use super::units;
use crate::diagnostic::Diagnostic;
use crate::ir::Fold;
use crate::source::Span;
use crate::syntax::ast::{self, BinaryOp, ReduceOp};

impl Checker<'_> {
    /// The checked form of an expression; its type is [`Ty::Error`] when something was wrong and reported.
    pub(super) fn expression(&mut self, expression: &ast::Expr, scope: &mut Scope) -> Value {
        let span = expression.span;
        match &expression.kind {
            ast::ExprKind::Number(value) => {
                let dim = if *value == 0.0 { D::Any } else { D::NONE };
                Value::new(ExprKind::Number(*value), Ty::Numeric(Form::Scalar, dim), span)
            }
            ast::ExprKind::Color(bytes) => Value::new(ExprKind::Color(linear(*bytes)), Ty::Color, span),
            ast::ExprKind::Bool(value) => Value::new(ExprKind::Bool(*value), Ty::Bool, span),
            ast::ExprKind::String(text) => Value::new(ExprKind::String(text.clone()), Ty::String, span),
            ast::ExprKind::Name(name) => self.name(name, span, scope),
            ast::ExprKind::Quantity { value, unit, power } => self.quantity(value, unit, *power, span, scope),
            ast::ExprKind::Tuple(parts) => self.tuple(parts, span, scope),
            ast::ExprKind::Unary { op, operand } => self.unary(*op, operand, span, scope),
            ast::ExprKind::Binary { op, op_span, left, right } => {
                let left = self.expression(left, scope);
                let right = self.expression(right, scope);
                self.binary(*op, *op_span, left, right, span)
            }
            ast::ExprKind::If { condition, accept, reject } => self.conditional(condition, accept, reject, span, scope),
            ast::ExprKind::Block { lets, last } => self.block(lets, last, span, scope),
            ast::ExprKind::Reduce { op, variable, start, end, body } => {
                self.reduce(*op, variable, (start, end), body, span, scope)
            }
            ast::ExprKind::Call { function, arguments } => self.call(function, arguments, span, scope),
            ast::ExprKind::Member { object, field } => self.member(object, field, span, scope),
            ast::ExprKind::Size(width, height) => {
                self.report(
                    Diagnostic::error("E0303", "a size in pixels has no place in an expression")
                        .at(span, "only `image.size` is written like this")
                        .hint(format!("multiply with `*`: `{width} * {height}`")),
                );
                Value::error(span)
            }
            ast::ExprKind::List(_) => {
                self.report(
                    Diagnostic::error("E0303", "a list has no place in an expression")
                        .at(span, "only `image.bands` is written like this")
                        .hint("a vector is written `(x, y, z)`"),
                );
                Value::error(span)
            }
        }
    }

    fn quantity(&mut self, value: &ast::Expr, unit: &ast::Name, power: i32, span: Span, scope: &mut Scope) -> Value {
        let Some(found) = units::unit(&unit.text) else {
            let near = crate::resolve::closest(&unit.text, ast::UNITS.iter().copied());
            let problem =
                Diagnostic::error("E0201", format!("there is no unit `{}`", unit.text)).at(unit.span, "not a unit");
            self.report(match near {
                Some(near) => problem.hint(format!("did you mean `{near}`?")),
                None => problem.note(format!("the units are {}", ast::UNITS.join(", "))),
            });
            return Value::error(span);
        };
        let Some(dim) = found.dim.power(f64::from(power)) else {
            self.report(Diagnostic::error("E0311", "this power is out of range").at(span, "far beyond any physics"));
            return Value::error(span);
        };
        let dimension = D::Of(dim);
        if let Some(number) = units::literal(value) {
            let ty = Ty::Numeric(Form::Scalar, dimension);
            return self.finite(Value::new(ExprKind::Number(found.apply(number, power)), ty, span));
        }
        if let ast::ExprKind::Tuple(parts) = &value.kind
            && (2..=3).contains(&parts.len())
            && let Some(numbers) = parts.iter().map(units::literal).collect::<Option<Vec<f64>>>()
        {
            let part = |(n, p): (f64, &ast::Expr)| Value::number(found.apply(n, power), dim, p.span).expr();
            let form = if parts.len() == 2 { Form::Vec2 } else { Form::Vec3 };
            let kind = ExprKind::Vector(numbers.into_iter().zip(parts).map(part).collect());
            return self.finite(Value::new(kind, Ty::Numeric(form, dimension), span));
        }
        let value = self.expression(value, scope);
        let factor = Value::number(found.apply(1.0, power), dim, unit.span);
        self.binary(BinaryOp::Multiply, unit.span, value, factor, span)
    }

    /// A literal that a unit made too large for a double.
    fn finite(&mut self, value: Value) -> Value {
        let bad = match &value.kind {
            ExprKind::Number(n) => !n.is_finite(),
            ExprKind::Vector(parts) => parts.iter().any(|p| matches!(p.kind, ExprKind::Number(n) if !n.is_finite())),
            _ => false,
        };
        if bad {
            self.report(
                Diagnostic::error("E0409", "this quantity is too large").at(value.span, "infinite in SI units"),
            );
            return Value::error(value.span);
        }
        value
    }

    fn tuple(&mut self, parts: &[ast::Expr], span: Span, scope: &mut Scope) -> Value {
        let values: Vec<Value> = parts.iter().map(|p| self.expression(p, scope)).collect();
        if values.iter().any(|v| v.ty.is_error()) {
            return Value::error(span);
        }
        let form = match values.len() {
            2 => Form::Vec2,
            3 => Form::Vec3,
            count => {
                self.report(
                    Diagnostic::error("E0318", format!("a vector has two or three parts, not {count}"))
                        .at(span, format!("{count} parts")),
                );
                return Value::error(span);
            }
        };
        self.vector(values, form, span)
    }

    /// Numbers of one dimension to a vector.
    pub(super) fn vector(&mut self, values: Vec<Value>, form: Form, span: Span) -> Value {
        let mut dim = D::Any;
        let mut first: Option<&Value> = None;
        for value in &values {
            let Ty::Numeric(Form::Scalar, d) = value.ty else {
                if !value.ty.is_error() {
                    self.report(
                        Diagnostic::error("E0318", format!("a part of a vector is a number, not {}", value.ty.prose()))
                            .at(value.span, format!("this is {}", value.ty.prose())),
                    );
                }
                return Value::error(span);
            };
            let Some(both) = dim.unify(d) else {
                let first = first.unwrap_or(value);
                let problem = Diagnostic::error("E0318", "the parts of a vector have different dimensions")
                    .at(value.span, format!("this is {}", value.ty.prose()))
                    .because(first.span, format!("this is {}", first.ty.prose()));
                let unit = if d.is_none() { dim.known().unit() } else { d.known().unit() };
                self.report(problem.hint(format!("one unit behind the tuple holds for all parts: `(1, 2, 3) {unit}`")));
                return Value::error(span);
            };
            if let (D::Any, D::Of(_)) = (dim, d) {
                first = Some(value);
            }
            dim = both;
        }
        let part = |mut v: Value| {
            v.ty = Ty::Numeric(Form::Scalar, dim);
            v.expr()
        };
        Value::new(ExprKind::Vector(values.into_iter().map(part).collect()), Ty::Numeric(form, dim), span)
    }

    fn conditional(
        &mut self,
        condition: &ast::Expr,
        accept: &ast::Expr,
        reject: &ast::Expr,
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        let condition = self.expect(condition, Ty::Bool, Role::Words("the condition of an `if`"), scope);
        let accept = self.expression(accept, scope);
        let reject = self.expression(reject, scope);
        if condition.ty.is_error() || accept.ty.is_error() || reject.ty.is_error() {
            return Value::error(span);
        }
        let Some(ty) = self.common_type(&accept, &reject, "the two sides of this `if` differ") else {
            return Value::error(span);
        };
        let fit = |mut v: Value| {
            if let (Ty::Numeric(form, _), Ty::Numeric(_, dim)) = (v.ty, ty) {
                v.ty = Ty::Numeric(form, dim);
            }
            v.boxed()
        };
        Value::new(ExprKind::If(condition.boxed(), fit(accept), fit(reject)), ty, span)
    }

    /// The type that two values share; reports when there is none.
    pub(super) fn common_type(&mut self, a: &Value, b: &Value, complaint: &str) -> Option<Ty> {
        match (a.ty, b.ty) {
            (Ty::Error, _) | (_, Ty::Error) => return None,
            (Ty::Numeric(fa, da), Ty::Numeric(fb, db)) => {
                if let (Some(form), Some(dim)) = (fa.join(fb), da.unify(db)) {
                    return Some(Ty::Numeric(form, dim));
                }
            }
            (x, y) if x == y => return Some(x),
            _ => {}
        }
        let mut problem = Diagnostic::error("E0308", complaint)
            .at(b.span, format!("this is {}", b.ty.prose()))
            .because(a.span, format!("this is {}", a.ty.prose()));
        if let (Ty::Numeric(fa, da), Ty::Numeric(fb, db)) = (a.ty, b.ty)
            && fa.join(fb).is_some()
        {
            let bare = if db.is_none() { Some((b, da)) } else { da.is_none().then_some((a, db)) };
            if let Some((bare, dim)) = bare {
                let text = self.snippet(bare.span);
                problem = problem.hint(format!("give it a unit: `{}`", super::coerce::with_unit(&text, dim.known())));
            }
        }
        self.report(problem);
        None
    }

    fn block(&mut self, lets: &[(ast::Name, ast::Expr)], last: &ast::Expr, span: Span, scope: &mut Scope) -> Value {
        let outer = scope.locals.len();
        let mut bound = vec![];
        for (name, value) in lets {
            let value = self.expression(value, scope);
            // A grid has no value of its own: its name is enough.
            if let (Ty::Grid, ExprKind::Grid(id)) = (value.ty, &value.kind) {
                scope.bind(&name.text, Bound::Grid(*id));
                continue;
            }
            let id = scope.bind_value(&name.text, value.ty);
            bound.push((id, name.text.clone(), value));
        }
        let last = self.expression(last, scope);
        scope.locals.truncate(outer);
        if last.ty.is_error() || bound.iter().any(|(_, _, v)| v.ty.is_error()) {
            return Value::error(span);
        }
        if bound.is_empty() {
            return last;
        }
        let ty = last.ty;
        let bound = bound.into_iter().map(|(id, name, value)| (id, name, value.expr())).collect();
        Value::new(ExprKind::Let(bound, last.boxed()), ty, span)
    }

    fn reduce(
        &mut self,
        op: ReduceOp,
        variable: &ast::Name,
        (start, end): (&ast::Expr, &ast::Expr),
        body: &ast::Expr,
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        let (fold, word) = match op {
            ReduceOp::Sum => (Fold::Sum, "sum"),
            ReduceOp::Product => (Fold::Product, "product"),
            ReduceOp::Max => (Fold::Max, "max"),
            ReduceOp::Min => (Fold::Min, "min"),
        };
        let start = self.expect(start, Ty::NUMBER, Role::Words("the first value of a range"), scope);
        let end = self.expect(end, Ty::NUMBER, Role::Words("the end of a range"), scope);
        let outer = scope.locals.len();
        let id = scope.bind_value(&variable.text, Ty::NUMBER);
        let body = self.expression(body, scope);
        scope.locals.truncate(outer);
        let ty = match body.ty {
            Ty::Error => return Value::error(span),
            Ty::Numeric(_, d) if op == ReduceOp::Product && !d.is_none() => {
                self.report(
                    Diagnostic::error("E0304", format!("`product` takes numbers, not {}", body.ty.prose()))
                        .at(body.span, format!("this is {}", body.ty.prose()))
                        .note("the dimension of the product would depend on how many factors there are"),
                );
                return Value::error(span);
            }
            Ty::Numeric(form, d) => Ty::Numeric(form, D::Of(d.known())),
            other => {
                self.report(
                    Diagnostic::error("E0307", format!("`{word}` cannot combine {}", plural(other)))
                        .at(body.span, format!("this is {}", other.prose())),
                );
                return Value::error(span);
            }
        };
        if start.ty.is_error() || end.ty.is_error() {
            return Value::error(span);
        }
        let (start, end, body) = (start.boxed(), end.boxed(), body.boxed());
        let kind = ExprKind::Reduce { fold, variable: id, name: variable.text.clone(), start, end, body };
        Value::new(kind, ty, span)
    }

    fn member(&mut self, object: &ast::Expr, field: &ast::Name, span: Span, scope: &mut Scope) -> Value {
        let value = self.expression(object, scope);
        let text = field.text.as_str();
        let (letters, width): (&str, usize) = match value.ty {
            Ty::Error => return Value::error(span),
            Ty::Numeric(Form::Vec2, _) => ("xy", 2),
            Ty::Numeric(Form::Vec3, _) => ("xyz", 3),
            Ty::Color => ("rgb", 3),
            Ty::Layer => match text {
                "color" => return Value::new(ExprKind::LayerColor(value.boxed()), Ty::Color, span),
                "k" => return Value::new(ExprKind::LayerK(value.boxed()), Ty::scalar(Dim::COEFFICIENT), span),
                _ => ("", 0),
            },
            Ty::Numeric(Form::Scalar | Form::Spectrum, _)
            | Ty::Bool
            | Ty::String
            | Ty::Grid
            | Ty::Shape
            | Ty::Transform => ("", 0),
        };
        let places: Option<Vec<u8>> = text.chars().map(|c| letters.find(c).map(|i| i as u8)).collect();
        let (Some(places), true) = (places, (1..=3).contains(&text.chars().count()) && width > 0) else {
            self.no_member(&value, object, field);
            return Value::error(span);
        };
        let dim = if let Ty::Numeric(_, d) = value.ty { d } else { D::NONE };
        let form = match places.len() {
            1 => Form::Scalar,
            2 => Form::Vec2,
            _ => Form::Vec3,
        };
        Value::new(ExprKind::Swizzle(value.boxed(), places), Ty::Numeric(form, dim), span)
    }

    fn no_member(&mut self, value: &Value, object: &ast::Expr, field: &ast::Name) {
        let text = self.snippet(object.span);
        let problem = Diagnostic::error("E0312", format!("{} has no `.{}`", value.ty.prose(), field.text))
            .at(field.span, "no such part")
            .because(value.span, format!("this is {}", value.ty.prose()));
        let region = ["center", "min_corner", "max_corner", "size"].contains(&field.text.as_str());
        let problem = match value.ty {
            Ty::Grid | Ty::Shape if region => problem.hint(format!("it is a function: `{}({text})`", field.text)),
            Ty::Numeric(Form::Vec2, _) => problem.note("its parts are `.x` and `.y`, and combinations such as `.yx`"),
            Ty::Numeric(Form::Vec3, _) => {
                let at = ["r", "g", "b"].iter().position(|c| *c == field.text);
                let near = at.map(|i| ["x", "y", "z"][i]);
                let problem = problem.note("its parts are `.x`, `.y` and `.z`, and combinations such as `.xy`");
                match near {
                    Some(near) => problem.hint(format!("write `{text}.{near}`")),
                    None => problem,
                }
            }
            Ty::Color => problem.note("its parts are `.r`, `.g` and `.b`"),
            Ty::Layer => problem.note("its parts are `.color` and `.k`"),
            Ty::Numeric(Form::Spectrum, _) => {
                problem.note("a spectrum has as many bands as the scene asks for, so none of them has a name")
            }
            Ty::Numeric(Form::Scalar, _) | Ty::Bool | Ty::String | Ty::Grid | Ty::Shape | Ty::Transform | Ty::Error => {
                problem
            }
        };
        self.report(problem);
    }
}

fn plural(ty: Ty) -> &'static str {
    match ty {
        Ty::Numeric(..) => "numbers",
        Ty::Color => "colours",
        Ty::Bool => "truth values",
        Ty::String => "texts",
        Ty::Layer => "layers",
        Ty::Grid => "grids",
        Ty::Shape => "shapes",
        Ty::Transform => "transforms",
        Ty::Error => "what is wrong",
    }
}

/// sRGB bytes to linear components; alpha is linear already.
fn linear([r, g, b, a]: [u8; 4]) -> [f64; 4] {
    let decode = |byte: u8| {
        let encoded = f64::from(byte) / 255.0;
        if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    };
    [decode(r), decode(g), decode(b), f64::from(a) / 255.0]
}
