//! Tables and transfer functions.

use super::coerce::Role;
use super::constant::Known;
use super::hir::{Dim, Expr, Table, TableId, TableRows};
use super::scope::{Context, Inputs, Place, Scope};
use super::types::{D, Form, Ty, Value};
use super::{Checker, TableInfo};
use crate::diagnostic::Diagnostic;
use crate::resolve::ItemRef;
use crate::syntax::ast::{self, Row};

impl Checker<'_> {
    /// A table or transfer function; checked when it is first named.
    pub(super) fn table(&mut self, item: ItemRef) -> Option<TableInfo> {
        if let Some(known) = self.known_tables.get(&item) {
            return *known;
        }
        self.known_tables.insert(item, None);
        let modules = self.modules;
        let declared = modules.item(item);
        let (name, rows, transfer) = match &declared.kind {
            ast::ItemKind::Table { name, rows } => (name, rows, false),
            ast::ItemKind::Transfer { name, rows } => (name, rows, true),
            ast::ItemKind::Use(_)
            | ast::ItemKind::Const { .. }
            | ast::ItemKind::Param { .. }
            | ast::ItemKind::Function(_)
            | ast::ItemKind::Block(_) => return None,
        };
        if modules.is_cyclic(item) {
            return None;
        }
        if rows.is_empty() {
            let what = if transfer { "the transfer function" } else { "the table" };
            self.report(
                Diagnostic::error("E0414", format!("{what} `{}` is empty", name.text))
                    .at(declared.span, "needs one row at least")
                    .hint(if transfer {
                        "a stop is `key: colour, extinction`: `30: #000, 0 /m`"
                    } else {
                        "a row is `key: value`: `0 km: 1`"
                    }),
            );
            return None;
        }
        // Rows follow params, so that they can be moved live.
        let context = Context::live(Place::Table(name.text.clone()), Inputs::FRAME);
        let mut scope = Scope::new(item.module, context);
        let mut keys: Vec<Value> = vec![];
        let mut values: Vec<Vec<Value>> = vec![];
        let mut good = true;
        for row in rows {
            keys.push(self.expression(&row.key, &mut scope));
            let row_values: Vec<Value> = row.values.iter().map(|v| self.expression(v, &mut scope)).collect();
            good &= self.row_form(&name.text, row, &row_values, transfer);
            values.push(row_values);
        }
        good &= keys.iter().chain(values.iter().flatten()).all(|v| !v.ty.is_error());
        if !good {
            return None;
        }
        let words = format!("a key of `{}`", name.text);
        let (keys, key) = self.column(keys, &words)?;
        self.ascending(&name.text, &keys)?;
        let (rows, value) = if transfer {
            (self.stops(&name.text, keys, values)?, Ty::Layer)
        } else {
            let words = format!("a value of `{}`", name.text);
            let (values, ty) = self.column(values.into_iter().flatten().collect(), &words)?;
            for value in &values {
                self.refuse_infinite(value, &words);
            }
            (TableRows::Values(keys.into_iter().zip(values).collect()), ty)
        };
        let info = TableInfo { id: TableId(self.tables.len() as u32), key, value };
        self.tables.push(Table { name: name.text.clone(), span: name.span, key: key.hir(), rows });
        self.known_tables.insert(item, Some(info));
        Some(info)
    }

    /// Whether a row has as many values as it should.
    fn row_form(&mut self, name: &str, row: &Row, values: &[Value], transfer: bool) -> bool {
        let key = self.snippet(row.key.span);
        if !transfer {
            let [_, second, ..] = row.values.as_slice() else { return !row.values.is_empty() };
            self.report(
                Diagnostic::error("E0414", format!("a row of the table `{name}` has one value"))
                    .at(second.span, "one too many")
                    .hint("a colour with an extinction belongs into a `transfer`; several values into several tables"),
            );
            return false;
        }
        match row.values.as_slice() {
            [_, _] => true,
            [only] => {
                let color = values.first().is_some_and(|v| v.ty == Ty::Color);
                let text = self.snippet(only.span);
                let (missing, hint) = if color {
                    ("an extinction", format!("say how dense it is: `{key}: {text}, 20 /m`; `0 /m` is clear"))
                } else {
                    ("a colour", format!("say which colour it has: `{key}: #fff, {text}`"))
                };
                self.report(
                    Diagnostic::error("E0414", format!("this stop of `{name}` lacks {missing}"))
                        .at(row.span, "needs a colour and an extinction")
                        .hint(hint),
                );
                false
            }
            [_, _, third, ..] => {
                self.report(
                    Diagnostic::error(
                        "E0414",
                        format!("a stop of `{name}` has a colour and an extinction, nothing more"),
                    )
                    .at(third.span, "one too many"),
                );
                false
            }
            [] => false,
        }
    }

    /// Numbers of one dimension.
    fn column(&mut self, values: Vec<Value>, words: &str) -> Option<(Vec<Expr>, Ty)> {
        let dim = values.iter().find_map(|v| match v.ty {
            Ty::Numeric(_, d @ D::Of(_)) => Some(d),
            _ => None,
        });
        let ty = Ty::scalar(dim.unwrap_or(D::NONE).known());
        let mut good = true;
        let mut out = vec![];
        for value in values {
            let value = self.coerce(value, ty, Role::Words(words));
            good &= !value.ty.is_error();
            out.push(value.expr());
        }
        good.then_some((out, ty))
    }

    /// Keys must not descend, where they are known.
    fn ascending(&mut self, name: &str, keys: &[Expr]) -> Option<()> {
        let mut last: Option<(f64, &Expr)> = None;
        for key in keys {
            let Some(Known::Numbers(n)) = self.known(key) else { continue };
            let value = n.scalar()?;
            if !value.is_finite() {
                self.infinite(key.span, &format!("a key of `{name}`"));
                return None;
            }
            if let Some((before, place)) = last
                && value < before
            {
                self.report(
                    Diagnostic::error("E0415", format!("the keys of `{name}` must ascend"))
                        .at(key.span, "smaller than the one before")
                        .because(place.span, "the one before")
                        .hint("sort the rows by their keys; two equal keys make a jump"),
                );
                return None;
            }
            last = Some((value, key));
        }
        Some(())
    }

    fn stops(&mut self, name: &str, keys: Vec<Expr>, values: Vec<Vec<Value>>) -> Option<TableRows> {
        let color_words = format!("the colour of a stop of `{name}`");
        let k_words = format!("the extinction of a stop of `{name}`");
        let mut rows = vec![];
        let mut good = true;
        for (key, pair) in keys.into_iter().zip(values) {
            let Ok([color, k]) = <[Value; 2]>::try_from(pair) else { return None };
            // The likeliest mistake: the two in the wrong order.
            if matches!(color.ty, Ty::Numeric(Form::Scalar, _)) && k.ty == Ty::Color {
                let (a, b) = (self.snippet(color.span), self.snippet(k.span));
                self.report(
                    Diagnostic::error("E0414", format!("this stop of `{name}` has its colour last"))
                        .at(color.span.to(k.span), "the colour comes first")
                        .hint(format!("write `{b}, {a}`")),
                );
                good = false;
                continue;
            }
            let color = self.coerce(color, Ty::Color, Role::Words(&color_words));
            let k = self.coerce(k, Ty::scalar(Dim::COEFFICIENT), Role::Words(&k_words));
            good &= !color.ty.is_error() && !k.ty.is_error();
            let (color, k) = (color.expr(), k.expr());
            if good {
                good &= self.not_negative(&k, &k_words);
            }
            rows.push((key, color, k));
        }
        good.then_some(TableRows::Layers(rows))
    }

    /// Reports a coefficient that is known to be negative, infinite or no number.
    pub(super) fn not_negative(&mut self, value: &Expr, words: &str) -> bool {
        let numbers = match self.known(value) {
            Some(Known::Numbers(n)) => n.all().to_vec(),
            Some(Known::Color(c)) => c.to_vec(),
            Some(Known::Bool(_) | Known::Layer(..)) | None => return true,
        };
        if numbers.iter().any(|v| !v.is_finite()) {
            self.infinite(value.span, words);
            return false;
        }
        if numbers.iter().any(|v| *v < 0.0) {
            let text = self.snippet(value.span);
            let problem = Diagnostic::error("E0410", format!("{words} is negative")).at(value.span, "below zero");
            self.report(match text.strip_prefix('-') {
                Some(rest) => problem.hint(format!("remove the sign: `{}`", rest.trim_start())),
                None => problem.hint("`max(0, …)` keeps a difference from going below zero"),
            });
            return false;
        }
        true
    }
}
