//! What a module declares: duplicates, and names that mean something else already.

use super::{ItemRef, Module, ModuleId, item_word, value_name, words};
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::source::Span;
use crate::syntax::ast::{self, ExprKind, ItemKind, Name};
use rustc_hash::FxHashMap;

/// Fills [`Module::names`] with the module's own items.
pub(super) fn declare(id: ModuleId, module: &mut Module, diagnostics: &mut Diagnostics) {
    let mut names = FxHashMap::default();
    let mut blocks = FxHashMap::default();
    let mut firsts: FxHashMap<(&'static str, &str), Span> = FxHashMap::default();
    for (index, item) in module.tree.items.iter().enumerate() {
        let reference = ItemRef { module: id, index: index as u32 };
        match &item.kind {
            ItemKind::Block(block) if value_name(item).is_none() => {
                let Some(name) = &block.name else { continue };
                refuse_unit(name, block.kind.word(), diagnostics);
                if duplicate(&mut firsts, block.kind.word(), name, item, diagnostics) {
                    continue;
                }
                blocks.entry(name.text.clone()).or_insert(reference);
            }
            ItemKind::Use(_) => {}
            ItemKind::Const { .. }
            | ItemKind::Param { .. }
            | ItemKind::Function(_)
            | ItemKind::Table { .. }
            | ItemKind::Transfer { .. }
            | ItemKind::Block(_) => {
                let Some(name) = value_name(item) else { continue };
                let refused = !id.is_library() && refuse_reserved(name, item_word(item), diagnostics);
                // What is refused keeps its own meaning, so that `2 /m` is not wrong too.
                if !duplicate(&mut firsts, "value", name, item, diagnostics) && !refused {
                    names.insert(name.text.clone(), reference);
                }
                if let ItemKind::Function(f) = &item.kind {
                    parameters(f, diagnostics);
                }
            }
        }
        for expression in expressions(item) {
            locals(expression, diagnostics);
        }
    }
    module.names = names;
    module.blocks = blocks;
}

fn duplicate<'m>(
    firsts: &mut FxHashMap<(&'static str, &'m str), Span>,
    namespace: &'static str,
    name: &'m Name,
    item: &ast::Item,
    diagnostics: &mut Diagnostics,
) -> bool {
    let Some(first) = firsts.get(&(namespace, name.text.as_str())).copied() else {
        firsts.insert((namespace, &name.text), name.span);
        return false;
    };
    diagnostics.push(
        Diagnostic::error("E0203", format!("there are two items called `{}`", name.text))
            .at(name.span, format!("this {} needs another name", item_word(item)))
            .because(first, "the first one"),
    );
    true
}

fn refuse_unit(name: &Name, what: &str, diagnostics: &mut Diagnostics) -> bool {
    if !ast::is_unit(&name.text) {
        return false;
    }
    let what = if what == "splats" { what.to_owned() } else { format!("a {what}") };
    diagnostics.push(
        Diagnostic::error("E0204", format!("`{}` is a unit and cannot name {what}", name.text))
            .at(name.span, "the name of a unit")
            .hint(format!("take another name, such as `{}`", instead_of_unit(&name.text))),
    );
    true
}

/// A word that someone who wrote this unit as a name may have meant.
fn instead_of_unit(unit: &str) -> &'static str {
    match unit {
        "m" => "mass",
        "s" => "amount",
        "ms" => "millis",
        "km" | "cm" | "mm" | "um" | "nm" => "distance",
        "deg" | "rad" | "sr" => "angle",
        "lx" => "strength",
        _ => "pixels",
    }
}

/// Refuses names that mean something else already.
fn refuse_reserved(name: &Name, what: &str, diagnostics: &mut Diagnostics) -> bool {
    if refuse_unit(name, what, diagnostics) {
        return true;
    }
    let text = name.text.as_str();
    if words::INPUTS.contains(&text) {
        let meaning = input_meaning(text);
        diagnostics.push(
            Diagnostic::error("E0205", format!("`{text}` has a meaning of its own and cannot name a {what}"))
                .at(name.span, format!("inside a field, `{text}` is {meaning}"))
                .hint(format!("take another name, such as `{text}_0`")),
        );
        return true;
    }
    if words::is_builtin(text) {
        diagnostics.push(
            Diagnostic::warning("W0202", format!("this {what} hides the built-in `{text}`"))
                .at(name.span, "the built-in cannot be reached in this file any more")
                .hint("take another name if that is not intended"),
        );
    }
    false
}

/// What an implicit input is.
pub(crate) fn input_meaning(name: &str) -> &'static str {
    match name {
        "p" => "the position",
        "dir" => "the direction in which light travels",
        "lambda" => "the wavelength of the band",
        "time" => "the time of the frame",
        "h" => "the altitude inside a `shell`",
        _ => "the cosine of the scattering angle",
    }
}

fn parameters(function: &ast::Function, diagnostics: &mut Diagnostics) {
    for (i, parameter) in function.parameters.iter().enumerate() {
        refuse_unit(&parameter.name, "parameter", diagnostics);
        if let Some(first) = function.parameters[..i].iter().find(|q| q.name.text == parameter.name.text) {
            diagnostics.push(
                Diagnostic::error("E0203", format!("there are two parameters called `{}`", parameter.name.text))
                    .at(parameter.name.span, "needs another name")
                    .because(first.name.span, "the first one"),
            );
        }
    }
}

/// Every expression that an item holds.
pub(super) fn expressions(item: &ast::Item) -> Vec<&ast::Expr> {
    match &item.kind {
        ItemKind::Use(_) => vec![],
        ItemKind::Const { value, .. } => vec![value],
        ItemKind::Param { default, range, .. } => {
            let mut all = vec![default];
            all.extend(range.iter().flat_map(|(a, b)| [a, b]));
            all
        }
        ItemKind::Function(f) => f.parameters.iter().filter_map(|p| p.default.as_ref()).chain([&f.body]).collect(),
        ItemKind::Table { rows, .. } | ItemKind::Transfer { rows, .. } => {
            rows.iter().flat_map(|r| std::iter::once(&r.key).chain(&r.values)).collect()
        }
        ItemKind::Block(b) => b.properties.iter().map(|p| &p.value).collect(),
    }
}

/// Refuses units as names of `let`s and loop variables.
fn locals(expression: &ast::Expr, diagnostics: &mut Diagnostics) {
    if let ExprKind::Block { lets, .. } = &expression.kind {
        for (name, _) in lets {
            refuse_unit(name, "value", diagnostics);
        }
    }
    if let ExprKind::Reduce { variable, .. } = &expression.kind {
        refuse_unit(variable, "loop variable", diagnostics);
    }
    for child in children(expression) {
        locals(child, diagnostics);
    }
}

/// The direct parts of an expression.
pub(super) fn children(expression: &ast::Expr) -> Vec<&ast::Expr> {
    match &expression.kind {
        ExprKind::Number(_)
        | ExprKind::Size(..)
        | ExprKind::String(_)
        | ExprKind::Color(_)
        | ExprKind::Bool(_)
        | ExprKind::Name(_) => vec![],
        ExprKind::Quantity { value, .. } => vec![value],
        ExprKind::Tuple(parts) | ExprKind::List(parts) => parts.iter().collect(),
        ExprKind::Unary { operand, .. } => vec![operand],
        ExprKind::Binary { left, right, .. } => vec![left, right],
        ExprKind::If { condition, accept, reject } => vec![condition, accept, reject],
        ExprKind::Block { lets, last } => lets.iter().map(|(_, e)| e).chain([last.as_ref()]).collect(),
        ExprKind::Reduce { start, end, body, .. } => vec![start, end, body],
        ExprKind::Call { arguments, .. } => arguments.iter().map(|a| &a.value).collect(),
        ExprKind::Member { object, .. } => vec![object],
    }
}
