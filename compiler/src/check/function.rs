//! Functions: signatures, and bodies checked once for each way they are called.
//!
//! A function of plain numbers may be called with a spectrum (`law(lambda)`): it is then checked once more with one
//! value per band in that parameter, so that every expression of the checked scene has its true type. A parameter of
//! type `grid` is bound to the grid itself. Most functions have one instance, as declared.

use super::Checker;
use super::coerce::Role;
use super::hir::{self, FunctionId, GridId};
use super::scope::{Bound, Context, Inputs, Place, Scope};
use super::types::{D, Form, Ty};
use crate::diagnostic::{Diagnostic, Diagnostics, Severity};
use crate::resolve::ItemRef;
use crate::source::Span;
use crate::syntax::ast;
use std::rc::Rc;

/// A declared function.
#[derive(Debug)]
pub(super) struct Signature {
    pub(super) name: String,
    pub(super) parameters: Vec<Parameter>,
    pub(super) result: Ty,
}

/// A declared parameter.
#[derive(Debug)]
pub(super) struct Parameter {
    pub(super) name: String,
    pub(super) ty: Ty,
}

/// How a parameter is bound in one instance.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Binding {
    /// As declared.
    Plain,
    /// Declared as a scalar, given one value per band.
    Spectral,
    /// A grid.
    Grid(GridId),
}

/// A function and how its parameters are bound.
pub(super) type InstanceKey = (ItemRef, Vec<Binding>);

/// An instance whose body is still to be checked.
#[derive(Debug)]
pub(super) struct Queued {
    pub(super) id: FunctionId,
    pub(super) key: InstanceKey,
    /// The call that asked for it.
    pub(super) call: Option<Span>,
}

impl<'a> Checker<'a> {
    fn declaration(&self, item: ItemRef) -> Option<&'a ast::Function> {
        let modules = self.modules;
        if let ast::ItemKind::Function(f) = &modules.item(item).kind { Some(f) } else { None }
    }

    /// As it is declared, without body: `puff(q: vec3) -> number`.
    pub(super) fn shown_function(&self, function: &ast::Function) -> String {
        self.snippet(function.name.span.to(function.result.span))
    }

    /// The signature of a function; reports wrong types the first time.
    pub(super) fn signature(&mut self, item: ItemRef) -> Option<Rc<Signature>> {
        if let Some(known) = self.signatures.get(&item) {
            return Some(Rc::clone(known));
        }
        let function = self.declaration(item)?;
        let parameters = function
            .parameters
            .iter()
            .map(|p| Parameter { name: p.name.text.clone(), ty: self.written_type(&p.ty) })
            .collect();
        let result = self.written_type(&function.result);
        let signature = Rc::new(Signature { name: function.name.text.clone(), parameters, result });
        self.signatures.insert(item, Rc::clone(&signature));
        Some(signature)
    }

    /// Checks a function of the scene, called or not.
    pub(super) fn own_function(&mut self, item: ItemRef) {
        let Some(signature) = self.signature(item) else { return };
        let Some(function) = self.declaration(item) else { return };
        for (declared, parameter) in function.parameters.iter().zip(&signature.parameters) {
            if let Some(default) = &declared.default {
                let mut scope = Scope::new(item.module, default_context(&signature.name));
                let role = Role::Argument { function: &signature.name, parameter: &parameter.name };
                self.expect(default, parameter.ty, role, &mut scope);
            }
        }
        if signature.parameters.iter().any(|p| p.ty == Ty::Grid) {
            return;
        }
        let plain = vec![Binding::Plain; signature.parameters.len()];
        self.instance((item, plain), None);
    }

    /// The function for these bindings; its body is checked later.
    pub(super) fn instance(&mut self, key: InstanceKey, call: Option<Span>) -> FunctionId {
        if let Some(known) = self.instances.get(&key) {
            return *known;
        }
        let id = FunctionId(self.functions.len() as u32);
        self.functions.push(None);
        self.instances.insert(key.clone(), id);
        self.queue.push(Queued { id, key, call });
        id
    }

    /// Checks every body that is still to be checked.
    pub(super) fn finish_functions(&mut self) {
        while !self.queue.is_empty() {
            let queued = self.queue.remove(0);
            self.body(queued);
        }
    }

    pub(super) fn body(&mut self, queued: Queued) {
        let (item, bindings) = &queued.key;
        if self.modules.is_cyclic(*item) {
            return;
        }
        let (Some(function), Some(signature)) = (self.declaration(*item), self.signature(*item)) else { return };
        let changed = bindings.iter().any(|b| *b != Binding::Plain);
        let before = changed.then(|| std::mem::take(self.diagnostics));
        let checked = self.checked_body(*item, function, &signature, bindings);
        if let Some(before) = before {
            let found = std::mem::replace(self.diagnostics, before);
            self.report_changed(&queued, &signature, found);
        } else if checked.is_none() {
            self.failed_functions.insert(*item);
        }
        self.functions[queued.id.0 as usize] = checked;
    }

    fn checked_body(
        &mut self,
        item: ItemRef,
        function: &ast::Function,
        signature: &Signature,
        bindings: &[Binding],
    ) -> Option<hir::Function> {
        let place = Place::Function(signature.name.clone());
        let mut scope = Scope::new(item.module, Context::live(place, Inputs::NONE));
        let mut parameters = vec![];
        for (parameter, binding) in signature.parameters.iter().zip(bindings) {
            let ty = match (binding, parameter.ty) {
                (Binding::Grid(id), _) => {
                    scope.bind(&parameter.name, Bound::Grid(*id));
                    continue;
                }
                (Binding::Spectral, Ty::Numeric(_, d)) => Ty::Numeric(Form::Spectrum, d),
                (Binding::Spectral | Binding::Plain, ty) => ty,
            };
            scope.bind_value(&parameter.name, ty);
            parameters.push((parameter.name.clone(), ty.hir()));
        }
        let spectral = bindings.contains(&Binding::Spectral);
        let result = match signature.result {
            Ty::Numeric(_, d) if spectral => Ty::Numeric(Form::Spectrum, d),
            other => other,
        };
        let body = self.expect(&function.body, result, Role::Result(&signature.name), &mut scope);
        let broken = body.ty.is_error() || result.is_error() || signature.parameters.iter().any(|p| p.ty.is_error());
        (!broken).then(|| hir::Function {
            name: signature.name.clone(),
            span: function.name.span,
            parameters,
            result: result.hir(),
            body: body.expr(),
        })
    }

    /// What was found in a body that was checked for other bindings than those declared belongs to the call.
    fn report_changed(&mut self, queued: &Queued, signature: &Signature, found: Diagnostics) {
        let (item, bindings) = &queued.key;
        let Some(function) = self.declaration(*item) else { return };
        let body = function.body.span;
        let inside = |d: &Diagnostic| {
            d.primary_span().is_some_and(|s| s.source == body.source && body.start <= s.start && s.end <= body.end)
        };
        let spectral = bindings.contains(&Binding::Spectral);
        // Other functions that were checked on the way have mistakes of their own.
        let (of_body, others): (Vec<_>, Vec<_>) = found.0.into_iter().partition(|d| spectral && inside(d));
        for diagnostic in others {
            self.report(diagnostic);
        }
        let Some(first) = of_body.iter().find(|d| d.severity == Severity::Error) else { return };
        if self.failed_functions.contains(item) {
            return;
        }
        let Some(call) = queued.call else { return };
        let mut problem =
            Diagnostic::error("E0322", format!("`{}` cannot be called with one value per band", signature.name))
                .at(call, "given a spectrum where a number is declared");
        if let Some(place) = first.primary_span() {
            problem = problem.because(place, first.message.clone());
        }
        let hint = first.hints.first().cloned();
        self.report(
            problem
                .note("a function of numbers is applied band by band where everything in it can be")
                .hint(hint.unwrap_or_else(|| "declare the parameter as a `spectrum`, or give it a number".to_owned())),
        );
    }

    /// The type of the value of a call, if these bindings can have one.
    pub(super) fn result_type(&self, signature: &Signature, bindings: &[Binding]) -> Option<Ty> {
        if !bindings.contains(&Binding::Spectral) {
            return Some(signature.result);
        }
        match signature.result {
            Ty::Numeric(Form::Scalar | Form::Spectrum, d) => Some(Ty::Numeric(Form::Spectrum, D::Of(d.known()))),
            Ty::Numeric(Form::Vec2 | Form::Vec3, _)
            | Ty::Color
            | Ty::Bool
            | Ty::String
            | Ty::Layer
            | Ty::Grid
            | Ty::Shape
            | Ty::Transform
            | Ty::Error => None,
        }
    }
}

/// What the default of a parameter may use.
pub(super) fn default_context(function: &str) -> Context {
    Context::live(Place::Function(function.to_owned()), Inputs::NONE)
}
