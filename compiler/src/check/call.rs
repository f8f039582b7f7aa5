//! Calls: of functions, tables, transfer functions and grids.

use super::Checker;
use super::coerce::Role;
use super::function::{self, Binding};
use super::hir::{Dim, ExprKind, GridId, Input};
use super::name::{Named, input_type};
use super::prelude::Signature;
use super::scope::{Bound, Inputs, Scope};
use super::types::{D, Form, Ty, Value};
use crate::diagnostic::Diagnostic;
use crate::resolve::{ItemRef, closest, item_word};
use crate::source::Span;
use crate::syntax::ast::{self, Argument};

/// What a call is of, for messages.
#[derive(Copy, Clone)]
pub(super) struct Callee<'c> {
    pub(super) name: &'c str,
    /// As it would be declared.
    pub(super) shown: &'c str,
}

impl Checker<'_> {
    pub(super) fn call(
        &mut self,
        function: &ast::Name,
        arguments: &[Argument],
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        let name = function.text.as_str();
        match self.find(name, scope) {
            Named::Local(Bound::Grid(id)) => self.sample(id, name, arguments, span, scope),
            Named::Local(Bound::Error) | Named::Broken => {
                self.look_into(arguments, scope);
                Value::error(span)
            }
            Named::Item(item) => self.call_item(item, name, arguments, span, scope),
            Named::Builtin(signature) => self.call_builtin(signature, arguments, span, scope),
            Named::Everywhere => match super::prelude::signature(name) {
                Some(signature) => self.call_builtin(signature, arguments, span, scope),
                None => Value::error(span),
            },
            Named::Local(Bound::Value(..)) | Named::Unit(_) | Named::Constant(_) | Named::Input(_) => {
                self.report(
                    Diagnostic::error("E0211", format!("`{name}` is a value, not a function"))
                        .at(function.span, "cannot be called")
                        .hint(format!("multiply with `*`: `{name} * …`")),
                );
                self.look_into(arguments, scope);
                Value::error(span)
            }
            Named::Nothing => {
                self.unknown(name, function.span, scope, true);
                self.look_into(arguments, scope);
                Value::error(span)
            }
        }
    }

    /// Checks arguments only for what is wrong inside them.
    fn look_into(&mut self, arguments: &[Argument], scope: &mut Scope) {
        for argument in arguments {
            self.expression(&argument.value, scope);
        }
    }

    fn call_item(&mut self, item: ItemRef, name: &str, arguments: &[Argument], span: Span, scope: &mut Scope) -> Value {
        if self.modules.is_cyclic(item) {
            self.look_into(arguments, scope);
            return Value::error(span);
        }
        match &self.modules.item(item).kind {
            ast::ItemKind::Function(_) => self.call_function(item, arguments, span, scope),
            ast::ItemKind::Table { .. } | ast::ItemKind::Transfer { .. } => {
                self.lookup(item, name, arguments, span, scope)
            }
            ast::ItemKind::Block(_) => match self.grid(item) {
                Some(id) => self.sample(id, name, arguments, span, scope),
                None => {
                    self.look_into(arguments, scope);
                    Value::error(span)
                }
            },
            ast::ItemKind::Const { .. } | ast::ItemKind::Param { .. } | ast::ItemKind::Use(_) => {
                let word = item_word(self.modules.item(item));
                self.report(
                    Diagnostic::error("E0211", format!("`{name}` is a {word}, not a function"))
                        .at(span, "cannot be called")
                        .hint(format!("multiply with `*`: `{name} * …`")),
                );
                self.look_into(arguments, scope);
                Value::error(span)
            }
        }
    }

    /// Gives each parameter its argument. `order` holds the parameters that positional arguments fill. Reports what
    /// does not fit and then returns `None`.
    pub(super) fn bind_arguments<'e>(
        &mut self,
        callee: Callee<'_>,
        names: &[&str],
        order: &[usize],
        arguments: &'e [Argument],
    ) -> Option<Vec<Option<&'e ast::Expr>>> {
        let mut bound: Vec<Option<&'e ast::Expr>> = vec![None; names.len()];
        let mut positional = 0;
        let mut good = true;
        for argument in arguments {
            let place = match &argument.name {
                None => {
                    positional += 1;
                    order.get(positional - 1).copied().ok_or_else(|| {
                        let count = order.len();
                        let plural = if count == 1 { "" } else { "s" };
                        Diagnostic::error("E0315", format!("`{}` takes {count} argument{plural}", callee.name))
                            .at(argument.value.span, "one too many")
                    })
                }
                Some(name) => names.iter().position(|n| *n == name.text).ok_or_else(|| {
                    let problem =
                        Diagnostic::error("E0314", format!("`{}` has no argument `{}`", callee.name, name.text))
                            .at(name.span, "not one of its arguments");
                    let open: Vec<&str> = order.iter().map(|i| names[*i]).collect();
                    let near = closest(&name.text, open.iter().copied());
                    match near.or_else(|| abbreviated(&name.text, &open)).or_else(|| only_other(&open, arguments)) {
                        Some(near) => problem.hint(format!("did you mean `{near}`?")),
                        None => problem,
                    }
                }),
            };
            let problem = match place {
                Err(problem) => problem,
                Ok(place) => match bound[place] {
                    None => {
                        bound[place] = Some(&argument.value);
                        continue;
                    }
                    Some(first) => {
                        Diagnostic::error("E0316", format!("`{}` of `{}` is given twice", names[place], callee.name))
                            .at(argument.value.span, "the second time")
                            .because(first.span, "the first time")
                    }
                },
            };
            good = false;
            self.report(problem.note(format!("its form is `{}`", callee.shown)));
        }
        good.then_some(bound)
    }

    /// Reports an argument that is needed and not there.
    pub(super) fn missing_argument(&mut self, callee: Callee<'_>, missing: &[&str], span: Span) {
        let list = crate::resolve::list(missing);
        self.report(
            Diagnostic::error("E0313", format!("`{}` needs {list}", callee.name))
                .at(span, format!("without {list}"))
                .note(format!("its form is `{}`", callee.shown)),
        );
    }

    fn call_builtin(
        &mut self,
        signature: &'static Signature,
        arguments: &[Argument],
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        let shown = signature.shown();
        let callee = Callee { name: signature.name, shown: &shown };
        if signature.variadic {
            return self.call_variadic(signature, callee, arguments, span, scope);
        }
        let names: Vec<&str> = signature.parameters.iter().map(|p| p.name).collect();
        let order: Vec<usize> = (0..names.len()).collect();
        let Some(bound) = self.bind_arguments(callee, &names, &order, arguments) else {
            self.look_into(arguments, scope);
            return Value::error(span);
        };
        let missing: Vec<&str> = (signature.parameters.iter().zip(&bound))
            .filter(|(p, b)| !p.optional && b.is_none())
            .map(|(p, _)| p.name)
            .collect();
        if !missing.is_empty() {
            self.missing_argument(callee, &missing, span);
            self.look_into(arguments, scope);
            return Value::error(span);
        }
        self.builtin(signature, &bound, span, scope)
    }

    fn call_variadic(
        &mut self,
        signature: &'static Signature,
        callee: Callee<'_>,
        arguments: &[Argument],
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        if let Some(name) = arguments.iter().find_map(|a| a.name.as_ref()) {
            self.report(
                Diagnostic::error("E0314", format!("the arguments of `{}` have no names", callee.name))
                    .at(name.span, "")
                    .note(format!("its form is `{}`", callee.shown))
                    .hint(format!("remove `{}:`", name.text)),
            );
            self.look_into(arguments, scope);
            return Value::error(span);
        }
        if arguments.len() < 2 {
            self.report(
                Diagnostic::error("E0313", format!("`{}` needs at least two arguments", callee.name))
                    .at(span, if arguments.is_empty() { "without any" } else { "only one" })
                    .note(format!("its form is `{}`", callee.shown)),
            );
            self.look_into(arguments, scope);
            return Value::error(span);
        }
        let values = arguments.iter().map(|a| self.expression(&a.value, scope)).collect();
        self.variadic(signature, values, span)
    }

    /// A function of the scene or the library.
    pub(super) fn call_function(
        &mut self,
        item: ItemRef,
        arguments: &[Argument],
        span: Span,
        scope: &mut Scope,
    ) -> Value {
        let modules = self.modules;
        let ast::ItemKind::Function(declared) = &modules.item(item).kind else { return Value::error(span) };
        let Some(signature) = self.signature(item) else { return Value::error(span) };
        let names: Vec<&str> = signature.parameters.iter().map(|p| p.name.as_str()).collect();
        let implicit: Vec<Option<Input>> = signature
            .parameters
            .iter()
            .map(|p| if scope.context.phase { supplied(&p.name, p.ty) } else { None })
            .collect();
        let mut shown = self.shown_function(declared);
        let by_itself: Vec<&str> = (0..names.len()).filter(|i| implicit[*i].is_some()).map(|i| names[i]).collect();
        if !by_itself.is_empty() {
            // Closes the quotation of the form, which the note ends with.
            shown.push_str(&format!("`, where {} comes by itself in `phase", crate::resolve::list(&by_itself)));
        }
        let callee = Callee { name: &signature.name, shown: &shown };
        let order = positional_order(&implicit, arguments);
        let Some(bound) = self.bind_arguments(callee, &names, &order, arguments) else {
            self.look_into(arguments, scope);
            return Value::error(span);
        };
        let missing: Vec<&str> = (0..names.len())
            .filter(|i| bound[*i].is_none() && implicit[*i].is_none() && declared.parameters[*i].default.is_none())
            .map(|i| names[i])
            .collect();
        if !missing.is_empty() {
            self.missing_argument(callee, &missing, span);
            self.look_into(arguments, scope);
            return Value::error(span);
        }
        let mut values = vec![];
        let mut bindings = vec![];
        let mut good = true;
        for (i, parameter) in signature.parameters.iter().enumerate() {
            let role = Role::Argument { function: &signature.name, parameter: &parameter.name };
            let value = match (bound[i], implicit[i], &declared.parameters[i].default) {
                (Some(given), ..) => self.expression(given, scope),
                (None, Some(input), _) => Value::new(ExprKind::Input(input), input_type(input), span),
                (None, None, Some(default)) => {
                    let mut inner = scope.nested(item.module, function::default_context(&signature.name));
                    let value = self.expression(default, &mut inner);
                    scope.adopt(&inner);
                    value
                }
                (None, None, None) => return Value::error(span),
            };
            let (value, binding) = self.fit_argument(value, parameter.ty, role);
            good &= !value.ty.is_error();
            if !matches!(binding, Binding::Grid(_)) {
                values.push(value);
            }
            bindings.push(binding);
        }
        if !good || signature.result.is_error() {
            return Value::error(span);
        }
        let Some(ty) = self.result_type(&signature, &bindings) else {
            self.report(
                Diagnostic::error("E0322", format!("`{}` cannot be called with one value per band", signature.name))
                    .at(span, format!("its value is {}, which has no bands", signature.result.prose()))
                    .note(format!("its form is `{shown}`")),
            );
            return Value::error(span);
        };
        let id = self.instance((item, bindings), Some(span));
        let arguments: Vec<_> = values.into_iter().map(Value::expr).collect();
        if item.module.is_library() && modules.module(item.module).name == "std::phase" {
            self.remember_asymmetry(&signature.name, &names, &arguments);
        }
        Value::new(ExprKind::Call(id, arguments), ty, span)
    }

    /// An argument, and how it binds its parameter.
    fn fit_argument(&mut self, mut value: Value, want: Ty, role: Role<'_>) -> (Value, Binding) {
        if let (Ty::Numeric(Form::Spectrum, got), Ty::Numeric(Form::Scalar, dim)) = (value.ty, want)
            && let Some(dim) = got.unify(dim)
        {
            value.ty = Ty::Numeric(Form::Spectrum, dim);
            return (value, Binding::Spectral);
        }
        if let (Ty::Grid, ExprKind::Grid(id)) = (want, &value.kind) {
            let id = *id;
            return (value, Binding::Grid(id));
        }
        (self.coerce(value, want, role), Binding::Plain)
    }

    /// The one key of a table, or position of a grid.
    fn single<'e>(&mut self, name: &str, what: &str, arguments: &'e [Argument], span: Span) -> Option<&'e ast::Expr> {
        match arguments {
            [Argument { name: None, value }] => Some(value),
            [Argument { name: Some(label), .. }] => {
                self.report(
                    Diagnostic::error("E0314", format!("`{name}` takes {what}, which has no name"))
                        .at(label.span, "")
                        .hint(format!("remove `{}:`", label.text)),
                );
                None
            }
            [] => {
                self.report(Diagnostic::error("E0313", format!("`{name}` needs {what}")).at(span, "without it"));
                None
            }
            [_, second, ..] => {
                self.report(
                    Diagnostic::error("E0315", format!("`{name}` takes {what} and nothing else"))
                        .at(second.value.span, "one too many"),
                );
                None
            }
        }
    }

    fn lookup(&mut self, item: ItemRef, name: &str, arguments: &[Argument], span: Span, scope: &mut Scope) -> Value {
        let Some(key) = self.single(name, "one key", arguments, span) else {
            self.look_into(arguments, scope);
            return Value::error(span);
        };
        let key = self.expression(key, scope);
        let Some(table) = self.table(item) else { return Value::error(span) };
        if key.ty.is_error() {
            return Value::error(span);
        }
        let words = format!("the key of `{name}`");
        // One key per band gives one value per band.
        if let (Some((Form::Spectrum, got)), Ty::Numeric(_, dim), Ty::Numeric(_, value)) =
            (Self::numeric(&key), table.key, table.value)
            && got.unify(dim).is_some()
        {
            return Value::new(ExprKind::Lookup(table.id, key.boxed()), Ty::Numeric(Form::Spectrum, value), span);
        }
        let key = self.coerce(key, table.key, Role::Words(&words));
        if key.ty.is_error() {
            return Value::error(span);
        }
        Value::new(ExprKind::Lookup(table.id, key.boxed()), table.value, span)
    }

    fn sample(&mut self, id: GridId, name: &str, arguments: &[Argument], span: Span, scope: &mut Scope) -> Value {
        let Some(at) = self.single(name, "one position", arguments, span) else {
            self.look_into(arguments, scope);
            return Value::error(span);
        };
        let words = format!("the position in `{name}`");
        let at = self.expect(at, Ty::vec3(Dim::LENGTH), Role::Words(&words), scope);
        if at.ty.is_error() {
            return Value::error(span);
        }
        Value::new(ExprKind::Sample(id, at.boxed()), Ty::NUMBER, span)
    }

    /// The first argument of `gradient` may name a grid or a function.
    pub(super) fn gradient(&mut self, f: &ast::Expr, x: &ast::Expr, span: Span, scope: &mut Scope) -> Value {
        let at = self.expression(x, scope);
        let Some((Form::Vec3, dx)) = Self::numeric(&at) else {
            if !at.ty.is_error() {
                self.report(
                    Diagnostic::error(
                        "E0319",
                        format!("`gradient` is taken with respect to a vec3, not {}", at.ty.prose()),
                    )
                    .at(at.span, format!("this is {}", at.ty.prose()))
                    .hint("the usual one is the position: `gradient(f, p)`"),
                );
            }
            self.expression(f, scope);
            return Value::error(span);
        };
        let named = if let ast::ExprKind::Name(name) = &f.kind { Some((name, self.find(name, scope))) } else { None };
        let grid = match named {
            Some((_, Named::Local(Bound::Grid(id)))) => Some(id),
            Some((_, Named::Item(item))) if matches!(self.modules.item(item).kind, ast::ItemKind::Block(_)) => {
                let Some(id) = self.grid(item) else { return Value::error(span) };
                Some(id)
            }
            _ => None,
        };
        let function = match named {
            Some((_, Named::Item(item))) if matches!(self.modules.item(item).kind, ast::ItemKind::Function(_)) => {
                Some(item)
            }
            _ => None,
        };
        let at = if grid.is_some() {
            self.coerce(at, Ty::vec3(Dim::LENGTH), Role::Words("the position in a grid"))
        } else {
            at
        };
        if at.ty.is_error() {
            return Value::error(span);
        }
        let variable = matches!(at.kind, ExprKind::Local(_) | ExprKind::Input(Input::Position | Input::Direction));
        // The derivative is with respect to a variable; any other position gets a name.
        let ty = at.ty;
        let (at, binding) = if variable || (grid.is_none() && function.is_none()) {
            (at, None)
        } else {
            let id = scope.fresh();
            (Value::new(ExprKind::Local(id), ty, at.span), Some((id, at)))
        };
        let value = if let Some(id) = grid {
            Value::new(ExprKind::Sample(id, at.clone().boxed()), Ty::NUMBER, f.span)
        } else if let Some(item) = function {
            self.call_with(item, at.clone(), f.span, scope)
        } else {
            if !variable {
                self.report(
                    Diagnostic::error("E0319", "`gradient` is taken with respect to a variable")
                        .at(x.span, "not a name")
                        .note("the derivative of an expression at a point needs the name of what varies")
                        .hint("write the field as a function: `gradient(f, x)` is the derivative of `f` at `x`"),
                );
                self.expression(f, scope);
                return Value::error(span);
            }
            self.expression(f, scope)
        };
        let Some((Form::Scalar, df)) = Self::numeric(&value) else {
            if !value.ty.is_error() {
                self.report(
                    Diagnostic::error("E0319", format!("`gradient` takes a scalar field, not {}", value.ty.prose()))
                        .at(value.span, format!("this is {}", value.ty.prose())),
                );
            }
            return Value::error(span);
        };
        let Some(dim) = df.known().over(dx.known()) else { return Value::error(span) };
        let kind = ExprKind::Builtin(super::hir::Builtin::Gradient, vec![value.expr(), at.expr()]);
        let gradient = Value::new(kind, Ty::vec3(dim), span);
        match binding {
            None => gradient,
            Some((id, at)) => {
                let ty = gradient.ty;
                Value::new(ExprKind::Let(vec![(id, "x".to_owned(), at.expr())], gradient.boxed()), ty, span)
            }
        }
    }

    /// A function by its name alone, at a point.
    fn call_with(&mut self, item: ItemRef, at: Value, span: Span, scope: &mut Scope) -> Value {
        let modules = self.modules;
        let ast::ItemKind::Function(declared) = &modules.item(item).kind else { return Value::error(span) };
        if modules.is_cyclic(item) {
            return Value::error(span);
        }
        let Some(signature) = self.signature(item) else { return Value::error(span) };
        let rest_has_defaults = declared.parameters.iter().skip(1).all(|p| p.default.is_some());
        let Some(first) = signature.parameters.first().filter(|_| rest_has_defaults) else {
            let shown = self.shown_function(declared);
            self.report(
                Diagnostic::error("E0319", format!("`{}` is not a function of one position", signature.name))
                    .at(span, "differentiated by its name alone")
                    .note(format!("its form is `{shown}`"))
                    .hint(format!("call it: `gradient({}(…), p)`", signature.name)),
            );
            return Value::error(span);
        };
        let role = Role::Argument { function: &signature.name, parameter: &first.name };
        let at = self.coerce(at, first.ty, role);
        let mut arguments = vec![at];
        for (declared, parameter) in declared.parameters.iter().zip(&signature.parameters).skip(1) {
            let Some(default) = &declared.default else { continue };
            let mut inner = scope.nested(item.module, function::default_context(&signature.name));
            let role = Role::Argument { function: &signature.name, parameter: &parameter.name };
            arguments.push(self.expect(default, parameter.ty, role, &mut inner));
            scope.adopt(&inner);
        }
        if signature.result.is_error() || arguments.iter().any(|v| v.ty.is_error()) {
            return Value::error(span);
        }
        let id = self.instance((item, vec![Binding::Plain; arguments.len()]), Some(span));
        Value::new(ExprKind::Call(id, arguments.into_iter().map(Value::expr).collect()), signature.result, span)
    }
}

/// In a phase function, `cos_theta`, `p` and `lambda` come by themselves.
fn supplied(name: &str, ty: Ty) -> Option<Input> {
    match (name, ty) {
        ("cos_theta", Ty::Numeric(Form::Scalar, D::NONE)) => Some(Input::CosTheta),
        ("p", ty) if ty == input_type(Input::Position) => Some(Input::Position),
        ("lambda", Ty::Numeric(Form::Scalar | Form::Spectrum, D::Of(Dim::LENGTH))) => Some(Input::Lambda),
        _ => None,
    }
}

/// Positional arguments pass over what comes by itself, unless there is one for every parameter.
fn positional_order(implicit: &[Option<Input>], arguments: &[Argument]) -> Vec<usize> {
    let explicit: Vec<usize> = (0..implicit.len()).filter(|i| implicit[*i].is_none()).collect();
    let positional = arguments.iter().filter(|a| a.name.is_none()).count();
    if positional > explicit.len() { (0..implicit.len()).collect() } else { explicit }
}

/// The one parameter that begins with these letters.
fn abbreviated<'n>(written: &str, names: &[&'n str]) -> Option<&'n str> {
    let mut found = names.iter().filter(|n| n.starts_with(written));
    let first = found.next().copied();
    if found.next().is_none() { first } else { None }
}

/// The one parameter that no argument names, if there is just one.
fn only_other<'n>(names: &[&'n str], arguments: &[Argument]) -> Option<&'n str> {
    let positional = arguments.iter().filter(|a| a.name.is_none()).count();
    let given = |n: &str| arguments.iter().any(|a| a.name.as_ref().is_some_and(|m| m.text == n));
    let mut open = names.iter().skip(positional).filter(|n| !given(n));
    let first = open.next().copied();
    if open.next().is_none() { first } else { None }
}

/// What a distance field may use.
pub(super) const SDF_INPUTS: Inputs = Inputs::TIME.and(Inputs::POSITION);
