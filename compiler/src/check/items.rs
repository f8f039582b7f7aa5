//! Constants, params and grids.

use super::Checker;
use super::coerce::Role;
use super::constant::Known;
use super::hir::{ConstId, Dim, Grid, GridId};
use super::scope::{Context, Inputs, Place, Scope};
use super::types::{D, Form, Ty};
use crate::diagnostic::Diagnostic;
use crate::ir::{Filter, Param, ParamId, ParamType};
use crate::loader::LoadError;
use crate::resolve::ItemRef;
use crate::source::Span;
use crate::syntax::ast;

impl Checker<'_> {
    /// A constant; checked when it is first named.
    pub(super) fn constant(&mut self, item: ItemRef) -> Option<(ConstId, Ty)> {
        if let Some(known) = self.known_constants.get(&item) {
            return *known;
        }
        // Whoever comes back here while it is being checked is part of a cycle, which was reported.
        self.known_constants.insert(item, None);
        let modules = self.modules;
        let ast::ItemKind::Const { name, value } = &modules.item(item).kind else { return None };
        if modules.is_cyclic(item) {
            return None;
        }
        let mut scope = Scope::new(item.module, Context::fixed(Place::Constant(name.text.clone())));
        let value = self.expression(value, &mut scope);
        if value.ty.is_error() {
            return None;
        }
        // `const zero = 0` is a number.
        let ty = Ty::of(&value.ty.hir());
        let expression = value.expr();
        if self.refuse_infinite(&expression, &format!("the constant `{}`", name.text)) {
            return None;
        }
        let id = ConstId(self.constants.len() as u32);
        self.constants.push((name.text.clone(), expression));
        self.known_constants.insert(item, Some((id, ty)));
        Some((id, ty))
    }

    /// A param; checked when it is first named.
    pub(super) fn param(&mut self, item: ItemRef) -> Option<(ParamId, Ty)> {
        if let Some(known) = self.known_params.get(&item) {
            return *known;
        }
        self.known_params.insert(item, None);
        let modules = self.modules;
        let declared = modules.item(item);
        let ast::ItemKind::Param { name, default, range } = &declared.kind else { return None };
        let place = || Context::fixed(Place::Param(name.text.clone()));
        let default_span = default.span;
        let mut scope = Scope::new(item.module, place());
        let default = self.expression(default, &mut scope);
        let range = range.as_ref().map(|(low, high)| {
            let low = self.expression(low, &mut scope);
            (low, self.expression(high, &mut scope))
        });
        let mut ty = default.ty;
        // `param x = 0 in 0 m .. 2 m` takes its dimension from the range.
        if let (Ty::Numeric(form, D::Any), Some((low, high))) = (ty, &range) {
            for end in [low, high] {
                if let Ty::Numeric(_, d @ D::Of(_)) = end.ty {
                    ty = Ty::Numeric(form, d);
                    break;
                }
            }
        }
        let ty = Ty::of(&ty.hir());
        if default.ty.is_error() {
            return None;
        }
        let (kind, dim) = match ty {
            Ty::Numeric(Form::Scalar, d) => (ParamType::Float(1), d.known()),
            Ty::Numeric(Form::Vec2, d) => (ParamType::Float(2), d.known()),
            Ty::Numeric(Form::Vec3, d) => (ParamType::Float(3), d.known()),
            Ty::Color => (ParamType::Color, Dim::NONE),
            Ty::Bool => (ParamType::Bool, Dim::NONE),
            other => {
                self.report(
                    Diagnostic::error("E0303", format!("a param cannot be {}", other.prose()))
                        .at(default_span, format!("this is {}", other.prose()))
                        .note("a param is a number, a vector, a colour, or true or false"),
                );
                return None;
            }
        };
        let default = self.coerce(default, ty, Role::Words("the default")).expr();
        let values = match self.known(&default) {
            Some(Known::Numbers(n)) => n.all().to_vec(),
            Some(Known::Color([r, g, b, _])) => vec![r, g, b],
            Some(Known::Bool(b)) => vec![f64::from(u8::from(b))],
            Some(Known::Layer(..)) | None => {
                self.not_constant(default_span, &format!("the default of the param `{}`", name.text));
                return None;
            }
        };
        if values.iter().any(|v| !v.is_finite()) {
            self.infinite(default_span, &format!("the default of the param `{}`", name.text));
            return None;
        }
        let range = match range {
            None => None,
            Some((low, high)) => Some(self.param_range(&name.text, ty, (default_span, &values), low, high)?),
        };
        let id = ParamId(self.params.len() as u32);
        self.params.push(Param {
            name: name.text.clone(),
            span: Some(name.span),
            docs: declared.docs.clone(),
            ty: kind,
            dimension: dim.exponents(),
            default: values,
            range,
        });
        self.known_params.insert(item, Some((id, ty)));
        Some((id, ty))
    }

    fn param_range(
        &mut self,
        name: &str,
        ty: Ty,
        (default_span, values): (Span, &[f64]),
        low: super::types::Value,
        high: super::types::Value,
    ) -> Option<(f64, f64)> {
        let Ty::Numeric(_, d) = ty else {
            self.report(
                Diagnostic::error("E0416", format!("the param `{name}` is {}, which has no range", ty.prose()))
                    .at(low.span, "a range needs numbers"),
            );
            return None;
        };
        let scalar = Ty::Numeric(Form::Scalar, d);
        let (low_span, high_span) = (low.span, high.span);
        let low = self.coerce(low, scalar, Role::Words("the start of the range"));
        let high = self.coerce(high, scalar, Role::Words("the end of the range"));
        if low.ty.is_error() || high.ty.is_error() {
            return None;
        }
        let mut end = |value: super::types::Value| {
            let span = value.span;
            let expression = value.expr();
            match self.known(&expression) {
                Some(Known::Numbers(n)) if n.all()[0].is_finite() => Some(n.all()[0]),
                Some(_) => {
                    self.infinite(span, "the end of a range");
                    None
                }
                None => {
                    self.not_constant(span, "the end of a range");
                    None
                }
            }
        };
        let (low, high) = (end(low)?, end(high)?);
        let both = low_span.to(high_span);
        if low > high {
            let (a, b) = (self.snippet(low_span), self.snippet(high_span));
            self.report(
                Diagnostic::error("E0416", format!("the range of the param `{name}` is backwards"))
                    .at(both, "starts above its end")
                    .hint(format!("write `{b} .. {a}`")),
            );
            return None;
        }
        if values.iter().any(|v| *v < low || *v > high) {
            self.report(
                Diagnostic::error("E0416", format!("the param `{name}` starts outside its range"))
                    .at(default_span, "not inside")
                    .because(both, "the range")
                    .hint("widen the range, or start inside it"),
            );
            return None;
        }
        Some((low, high))
    }

    /// A grid; its header is asked for when it is first named.
    pub(super) fn grid(&mut self, item: ItemRef) -> Option<GridId> {
        if let Some(known) = self.known_grids.get(&item) {
            return *known;
        }
        self.known_grids.insert(item, None);
        let modules = self.modules;
        let declared = modules.item(item);
        let ast::ItemKind::Block(block) = &declared.kind else { return None };
        if modules.is_cyclic(item) {
            return None;
        }
        let name = block.name.as_ref().map_or("", |n| n.text.as_str());
        let mut properties = self.properties(block, &["file", "filter", "outside"]);
        let file = properties.take("file");
        let filter = properties.take("filter");
        let outside = properties.take("outside");
        let filters = [("nearest", Filter::Nearest), ("linear", Filter::Linear), ("cubic", Filter::Cubic)];
        let filter = filter.map_or(Some(Filter::Linear), |p| self.word(p, "grid", &filters));
        let outside = outside.map_or(Some(0.0), |p| self.fixed_number(item.module, p, "grid", Dim::NONE));
        let Some(file) = file else {
            self.missing_property(block, "file", "file = \"scan.nii.gz\"");
            return None;
        };
        let path = self.text(item.module, file, "grid")?;
        let from = modules.module(item.module).name.clone();
        let header = self.loader.grid(&from, &path);
        let header = self.header(header, file.value.span)?;
        let (filter, outside) = (filter?, outside?);
        let id = GridId(self.grids.len() as u32);
        let span = block.name.as_ref().map_or(declared.span, |n| n.span);
        self.grids.push(Grid { name: name.to_owned(), span, path, from, header, filter, outside });
        self.known_grids.insert(item, Some(id));
        Some(id)
    }

    /// What a loader found of a file that is named at a place; what is wrong with it is reported.
    pub(super) fn header<T>(&mut self, found: Result<T, LoadError>, span: Span) -> Option<T> {
        let report = |error: LoadError| {
            let mut problem = Diagnostic::error(error.code, error.message).at(span, "named here");
            problem.hints.extend(error.hint);
            self.report(problem);
        };
        found.map_err(report).ok()
    }

    pub(super) fn not_constant(&mut self, span: Span, what: &str) {
        self.report(
            Diagnostic::error("E0320", format!("{what} must be known when compiling"))
                .at(span, "depends on what is not known yet"),
        );
    }

    pub(super) fn infinite(&mut self, span: Span, what: &str) {
        self.report(
            Diagnostic::error("E0409", format!("{what} is not a finite number"))
                .at(span, "infinite, or not a number at all")
                .hint("look for a division by zero, or a root or logarithm of a negative number"),
        );
    }

    /// Reports a value that is known and is NaN or infinite; whether it is.
    pub(super) fn refuse_infinite(&mut self, expression: &super::hir::Expr, what: &str) -> bool {
        let bad = match self.known(expression) {
            Some(Known::Numbers(n)) => n.all().iter().any(|v| !v.is_finite()),
            Some(Known::Color(c) | Known::Layer(c, _)) => c.iter().any(|v| !v.is_finite()),
            Some(Known::Bool(_)) | None => false,
        };
        if bad {
            self.infinite(expression.span, what);
        }
        bad
    }

    /// A scope for a value that must be known when compiling.
    pub(super) fn fixed_scope(
        &self,
        module: crate::resolve::ModuleId,
        block: &'static str,
        name: &'static str,
    ) -> Scope {
        Scope::new(module, Context::fixed(Place::Property { block, name }))
    }

    /// A scope for a value that may follow params and these inputs.
    pub(super) fn live_scope(
        &self,
        module: crate::resolve::ModuleId,
        block: &'static str,
        name: &'static str,
        inputs: Inputs,
    ) -> Scope {
        Scope::new(module, Context::live(Place::Property { block, name }, inputs))
    }
}
