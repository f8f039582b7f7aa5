//! `mie` and its cross-sections: what their arguments may be. The numbers come when lowering, where the bands are known.

use super::Checker;
use super::coerce::Role;
use super::hir::{Builtin, Dim, Expr, ExprKind};
use super::prelude::Signature;
use super::scope::Scope;
use super::types::{D, Form, Ty, Value};
use crate::diagnostic::Diagnostic;
use crate::source::Span;
use crate::syntax::ast;

impl Checker<'_> {
    /// Brings the arguments into the order radius, n, k, spread and, for the phase function, the cosine.
    pub(super) fn mie(
        &mut self,
        signature: &'static Signature,
        bound: &[Option<&ast::Expr>],
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        let given = |name: &str| {
            let place = signature.parameters.iter().position(|p| p.name == name);
            place.and_then(|i| bound.get(i).copied().flatten())
        };
        let role = |parameter: &'static str| Role::Argument { function: signature.name, parameter };
        let mut value = |checker: &mut Self, name: &'static str, ty: Ty, default: f64| match given(name) {
            None => Value::number(default, Dim::NONE, span),
            Some(expression) => checker.expect(expression, ty, role(name), scope),
        };
        let number = Ty::spectrum(Dim::NONE);
        let radius = value(self, "radius", Ty::spectrum(Dim::LENGTH), 0.0);
        let spread = value(self, "spread", number, 1.0);
        let k = value(self, "k", number, 0.0);
        let index = match given("index") {
            None => Value::error(span),
            Some(expression) => self.expression(expression, scope),
        };
        let (n, k) = match (index.ty, given("k")) {
            (Ty::Numeric(Form::Vec2, d), None) if d.is_none() => (component(&index, 0), component(&index, 1)),
            (Ty::Numeric(Form::Vec2, d), Some(second)) if d.is_none() => {
                self.report(
                    Diagnostic::error("E0316", format!("`k` of `{}` is given twice", signature.name))
                        .at(second.span, "the second time")
                        .because(index.span, "the first time, as the second part of the index")
                        .note(format!("its form is `{}`", signature.shown())),
                );
                return Value::error(span);
            }
            _ => (self.coerce(index, number, role("index")), k),
        };
        let mut values = vec![radius, n, k, spread];
        let ty = if signature.builtin == Builtin::Mie {
            values.push(match given("cos_theta") {
                Some(expression) => self.expect(expression, Ty::NUMBER, role("cos_theta"), scope),
                // As for the functions of `std::phase`, it comes by itself; a parameter of this name will do too.
                None => {
                    let cosine = self.name("cos_theta", span, scope);
                    self.coerce(cosine, Ty::NUMBER, role("cos_theta"))
                }
            });
            number
        } else {
            Ty::spectrum(Dim::AREA)
        };
        if values.iter().any(|v| v.ty.is_error()) {
            return Value::error(span);
        }
        let arguments: Vec<Expr> = values.into_iter().map(Value::expr).collect();
        Value::new(ExprKind::Builtin(signature.builtin, arguments), ty, span)
    }
}

fn component(vector: &Value, i: u8) -> Value {
    let kind = ExprKind::Swizzle(vector.clone().boxed(), vec![i]);
    Value::new(kind, Ty::Numeric(Form::Scalar, D::NONE), vector.span)
}
