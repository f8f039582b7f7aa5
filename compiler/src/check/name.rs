//! Names in expressions.

use super::Checker;
use super::hir::{Builtin, Dim, ExprKind, Input};
use super::prelude::{self, Signature};
use super::scope::{Bound, Inputs, Place, Scope};
use super::types::{D, Form, Ty, Value};
use super::units::{self, Unit};
use crate::diagnostic::Diagnostic;
use crate::resolve::{self, ItemRef, Modules, closest, input_meaning, item_word, synonym};
use crate::source::Span;
use crate::syntax::ast;

/// What a name refers to.
#[derive(Copy, Clone, Debug)]
pub(super) enum Named {
    Local(Bound),
    Item(ItemRef),
    Unit(Unit),
    Constant(f64),
    Everywhere,
    Input(Input),
    Builtin(&'static Signature),
    /// Declared, but its declaration is broken and was reported.
    Broken,
    Nothing,
}

fn input(name: &str) -> Option<Input> {
    Some(match name {
        "p" => Input::Position,
        "dir" => Input::Direction,
        "lambda" => Input::Lambda,
        "time" => Input::Time,
        "h" => Input::Altitude,
        "cos_theta" => Input::CosTheta,
        _ => return None,
    })
}

/// The type of an implicit input.
pub(super) fn input_type(input: Input) -> Ty {
    match input {
        Input::Position => Ty::vec3(Dim::LENGTH),
        Input::Direction => Ty::vec3(Dim::NONE),
        Input::Lambda => Ty::spectrum(Dim::LENGTH),
        Input::Time => Ty::scalar(Dim::TIME),
        Input::Altitude => Ty::scalar(Dim::LENGTH),
        Input::CosTheta => Ty::NUMBER,
    }
}

impl Checker<'_> {
    /// What a name refers to: locals first, then the file's own items and imports, then the language, then the library.
    pub(super) fn find(&self, name: &str, scope: &Scope) -> Named {
        if let Some(bound) = scope.find(name) {
            return Named::Local(bound);
        }
        if let Some(item) = self.modules.own_name(scope.module, name) {
            return Named::Item(item);
        }
        if self.modules.module(scope.module).broken.contains(name) {
            return Named::Broken;
        }
        if let Some(unit) = units::unit(name) {
            return Named::Unit(unit);
        }
        match name {
            "pi" => return Named::Constant(std::f64::consts::PI),
            "tau" => return Named::Constant(std::f64::consts::TAU),
            "e" => return Named::Constant(std::f64::consts::E),
            "everywhere" => return Named::Everywhere,
            _ => {}
        }
        if let Some(input) = input(name) {
            return Named::Input(input);
        }
        if let Some(signature) = prelude::signature(name) {
            return Named::Builtin(signature);
        }
        Modules::library_name(name).map_or(Named::Nothing, Named::Item)
    }

    /// A name that stands for a value.
    pub(super) fn name(&mut self, name: &str, span: Span, scope: &mut Scope) -> Value {
        match self.find(name, scope) {
            Named::Local(Bound::Value(id, ty)) => Value::new(ExprKind::Local(id), ty, span),
            Named::Local(Bound::Grid(id)) => Value::new(ExprKind::Grid(id), Ty::Grid, span),
            Named::Local(Bound::Error) | Named::Broken => Value::error(span),
            Named::Item(item) => self.item_value(item, name, span, scope),
            Named::Unit(unit) => Value::number(unit.apply(1.0, 1), unit.dim, span),
            Named::Constant(value) => Value::number(value, Dim::NONE, span),
            Named::Everywhere => Value::new(ExprKind::Builtin(Builtin::Everywhere, vec![]), Ty::Shape, span),
            Named::Input(input) => self.input(input, name, span, scope),
            Named::Builtin(signature) => {
                self.report(
                    Diagnostic::error("E0211", format!("`{name}` is a function and needs arguments"))
                        .at(span, "not called")
                        .note(format!("its form is `{}`", signature.shown())),
                );
                Value::error(span)
            }
            Named::Nothing => {
                self.unknown(name, span, scope, false);
                Value::error(span)
            }
        }
    }

    fn item_value(&mut self, item: ItemRef, name: &str, span: Span, scope: &mut Scope) -> Value {
        if self.modules.is_cyclic(item) {
            return Value::error(span);
        }
        match &self.modules.item(item).kind {
            ast::ItemKind::Const { .. } => match self.constant(item) {
                Some((id, ty)) => Value::new(ExprKind::Const(id), ty, span),
                None => Value::error(span),
            },
            ast::ItemKind::Param { .. } => {
                let Some((id, ty)) = self.param(item) else { return Value::error(span) };
                if !scope.context.params {
                    self.param_in_fixed_place(name, span, &scope.context.place);
                    return Value::error(span);
                }
                Value::new(ExprKind::Param(id), ty, span)
            }
            ast::ItemKind::Function(function) => {
                if scope.context.phase {
                    return self.call_function(item, &[], span, scope);
                }
                let shown = self.shown_function(function);
                let declared = if item.module.is_library() { None } else { Some(function.name.span) };
                let problem = Diagnostic::error("E0211", format!("`{name}` is a function and needs arguments"))
                    .at(span, "not called")
                    .note(format!("its form is `{shown}`"));
                self.report(match declared {
                    Some(place) => problem.because(place, "declared here"),
                    None => problem,
                });
                Value::error(span)
            }
            ast::ItemKind::Table { .. } | ast::ItemKind::Transfer { .. } => {
                let word = item_word(self.modules.item(item));
                self.report(
                    Diagnostic::error("E0211", format!("`{name}` is a {word} and needs a key"))
                        .at(span, "not called")
                        .hint(format!("call it with the value to look up: `{name}(…)`")),
                );
                Value::error(span)
            }
            ast::ItemKind::Block(block)
                if block.kind == ast::BlockKind::Splats && item.module != crate::resolve::ModuleId::SCENE =>
            {
                self.report(
                    Diagnostic::error("E0211", format!("the splats `{name}` belong to another file"))
                        .at(span, "not drawn in this scene")
                        .hint("declare them here"),
                );
                Value::error(span)
            }
            ast::ItemKind::Block(block) if block.kind == ast::BlockKind::Splats => match self.splats(item) {
                Some(id) => Value::new(ExprKind::Splats(id), Ty::Shape, span),
                None => Value::error(span),
            },
            ast::ItemKind::Block(_) => match self.grid(item) {
                Some(id) => Value::new(ExprKind::Grid(id), Ty::Grid, span),
                None => Value::error(span),
            },
            ast::ItemKind::Use(_) => Value::error(span),
        }
    }

    fn param_in_fixed_place(&mut self, name: &str, span: Span, place: &Place) {
        let problem = match place {
            Place::Property { .. } => Diagnostic::error("E0407", format!("{place} cannot follow the param `{name}`"))
                .at(span, "a live control")
                .note("it decides what is compiled, and moving a param must not compile anything anew")
                .hint("write a number, or name one with `const`"),
            Place::Constant(_) | Place::Param(_) | Place::Table(_) | Place::Function(_) => {
                Diagnostic::error("E0320", format!("{place} must be known when compiling, and `{name}` is a param"))
                    .at(span, "a live control")
                    .hint("a function can follow params: `fn name() -> number = …`")
            }
        };
        self.report(problem);
    }

    fn input(&mut self, input: Input, name: &str, span: Span, scope: &Scope) -> Value {
        if scope.context.inputs.has(Inputs::of(input)) {
            return Value::new(ExprKind::Input(input), input_type(input), span);
        }
        let meaning = input_meaning(name);
        let problem = Diagnostic::error("E0210", format!("`{name}` has no value in {}", scope.context.place));
        let problem = match (&scope.context.place, input) {
            (Place::Function(function), _) => {
                let ty = match input {
                    Input::Lambda => Ty::scalar(Dim::LENGTH),
                    other => input_type(other),
                };
                problem
                    .at(span, "a function sees only its parameters")
                    .note(format!("inside a field, `{name}` is {meaning}"))
                    .hint(format!(
                        "add a parameter, `fn {function}({name}: {ty}, …)`, and give it where the function is called"
                    ))
            }
            (Place::Property { block: "medium", name }, Input::Altitude) if !matches!(*name, "shape" | "transform") => {
                problem
                    .at(span, "the altitude inside a `shell`, and the shape has none")
                    .hint("give the medium `shape = shell(center: …, inner: …, outer: …)`, or take a coordinate: `p.y`")
            }
            (_, Input::CosTheta) => problem
                .at(span, "the cosine of the scattering angle, known in `phase` alone")
                .hint("use it in `phase = …`"),
            (Place::Property { block: "light", name: "environment" }, _) => problem
                .at(span, format!("{meaning}, known only inside media"))
                .note("an environment is a field of `dir`, the direction from the scene to the sky"),
            (Place::Property { block, name: property }, _) => {
                let problem = problem
                    .at(span, format!("{meaning}, known only inside fields"))
                    .note(format!("`{block}.{property}` is one value, not a field"));
                if *property == "shape" && input == Input::Position {
                    problem.hint("`sdf(…)` makes a shape of a field: negative inside")
                } else {
                    problem
                }
            }
            (Place::Constant(_) | Place::Param(_) | Place::Table(_), _) => {
                problem.at(span, format!("{meaning}, known only inside fields")).hint(format!(
                    "a function with a parameter can do this: `fn name({name}: {}) -> …`",
                    input_type(input)
                ))
            }
        };
        self.report(problem);
        Value::error(span)
    }

    /// Reports a name that means nothing.
    pub(super) fn unknown(&mut self, name: &str, span: Span, scope: &Scope, called: bool) {
        let what = if called { "function" } else { "name" };
        let problem = Diagnostic::error("E0201", format!("there is no {what} `{name}`"));
        let module = self.modules.module(scope.module);
        if let Some(block) = module.blocks.get(name) {
            let word = item_word(self.modules.item(*block));
            self.report(
                Diagnostic::error("E0211", format!("`{name}` is a {word}, not a value"))
                    .at(span, format!("expressions cannot use a {word}"))
                    .note("functions, constants, params, tables, transfer functions, grids and splats can be used"),
            );
            return;
        }
        let locals = scope.locals.iter().map(|l| l.name.as_str());
        let own = module.names.keys().map(String::as_str);
        let own: Vec<&str> = locals.chain(own).collect();
        let language: Vec<&str> = resolve::CONSTANTS
            .iter()
            .chain(resolve::FUNCTIONS)
            .chain(resolve::INPUTS)
            .copied()
            .chain(ast::UNITS)
            .chain(Modules::library_names())
            .collect();
        let near = closest(name, own.iter().copied())
            .map(str::to_owned)
            .or_else(|| synonym(name).map(str::to_owned))
            .or_else(|| closest(name, language).map(str::to_owned));
        let problem = problem.at(span, "not known here");
        self.report(match near {
            Some(near) => problem.hint(format!("did you mean `{near}`?")),
            None => problem,
        });
    }

    /// The type of a scalar or vector value, if it is one.
    pub(super) fn numeric(value: &Value) -> Option<(Form, D)> {
        if let Ty::Numeric(form, d) = value.ty { Some((form, d)) } else { None }
    }
}
