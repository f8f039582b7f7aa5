//! Who refers to whom: recursion, and what nobody uses.

use super::{ItemRef, ModuleId, Modules, declare, item_word, value_name};
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::source::Span;
use crate::syntax::ast::{self, ExprKind, ItemKind};
use rustc_hash::{FxHashMap, FxHashSet};

/// An item's references, in order.
type Edges = Vec<(ItemRef, Span)>;

/// Finds recursion and what is unused, reports both, and remembers the former.
pub(super) fn analyse(modules: &mut Modules, diagnostics: &mut Diagnostics) {
    let mut graph: FxHashMap<ItemRef, Edges> = FxHashMap::default();
    let mut todo: Vec<ItemRef> = modules
        .own()
        .flat_map(|(module, m)| (0..m.tree.items.len() as u32).map(move |index| ItemRef { module, index }))
        .collect();
    while let Some(item) = todo.pop() {
        if graph.contains_key(&item) {
            continue;
        }
        let edges = references(modules, item);
        todo.extend(edges.iter().map(|(target, _)| *target));
        graph.insert(item, edges);
    }
    let cycles = cycles(&graph);
    for cycle in &cycles {
        report_cycle(modules, cycle, diagnostics);
    }
    modules.cyclic = cycles.iter().flatten().map(|(item, _)| *item).collect();
    // What could not be read may have used anything.
    if !diagnostics.has_errors() {
        let mut found = Diagnostics::default();
        unused(modules, &graph, &mut found);
        modules.unused = found;
    }
}

/// What the expressions of an item refer to.
fn references(modules: &Modules, item: ItemRef) -> Edges {
    let mut walk = Walk { modules, module: item.module, locals: vec![], edges: vec![] };
    let declared = modules.item(item);
    if let ItemKind::Function(f) = &declared.kind {
        walk.locals.extend(f.parameters.iter().map(|p| p.name.text.as_str()));
    }
    for expression in declare::expressions(declared) {
        walk.expression(expression);
    }
    walk.edges
}

struct Walk<'a> {
    modules: &'a Modules,
    module: ModuleId,
    locals: Vec<&'a str>,
    edges: Edges,
}

impl<'a> Walk<'a> {
    fn name(&mut self, name: &str, span: Span) {
        if self.locals.contains(&name) {
            return;
        }
        let module = self.modules.module(self.module);
        let library = || if super::words::is_builtin(name) { None } else { Modules::library_name(name) };
        // Of what stands in a block of its own, only a style is ever named: a `medium box` may use the shape `box`.
        let style = || module.blocks.get(name).copied().filter(|item| is_style(self.modules.item(*item)));
        let found = module.names.get(name).copied().or_else(style).or_else(library);
        self.edges.extend(found.map(|item| (item, span)));
    }

    fn expression(&mut self, expression: &'a ast::Expr) {
        match &expression.kind {
            ExprKind::Name(name) => self.name(name, expression.span),
            ExprKind::Call { function, .. } => {
                self.name(&function.text, function.span);
                self.children(expression);
            }
            ExprKind::Block { lets, last } => {
                let outer = self.locals.len();
                for (name, value) in lets {
                    self.expression(value);
                    self.locals.push(&name.text);
                }
                self.expression(last);
                self.locals.truncate(outer);
            }
            ExprKind::Reduce { variable, start, end, body, .. } => {
                self.expression(start);
                self.expression(end);
                self.locals.push(&variable.text);
                self.expression(body);
                self.locals.pop();
            }
            ExprKind::Number(_)
            | ExprKind::Size(..)
            | ExprKind::String(_)
            | ExprKind::Color(_)
            | ExprKind::Bool(_)
            | ExprKind::Quantity { .. }
            | ExprKind::Tuple(_)
            | ExprKind::List(_)
            | ExprKind::Unary { .. }
            | ExprKind::Binary { .. }
            | ExprKind::If { .. }
            | ExprKind::Member { .. } => self.children(expression),
        }
    }

    fn children(&mut self, expression: &'a ast::Expr) {
        for child in declare::children(expression) {
            self.expression(child);
        }
    }
}

fn is_style(item: &ast::Item) -> bool {
    matches!(&item.kind, ItemKind::Block(block) if block.kind == ast::BlockKind::Style)
}

/// Every way an item leads back to itself: items with the place where each names the next. Each item is in one at most.
fn cycles(graph: &FxHashMap<ItemRef, Edges>) -> Vec<Edges> {
    let mut done: FxHashSet<ItemRef> = FxHashSet::default();
    let mut found: Vec<Edges> = vec![];
    let mut items: Vec<ItemRef> = graph.keys().copied().collect();
    items.sort_unstable();
    for start in items {
        // Depth first, without recursion: chains of functions may be long.
        let mut path: Vec<(ItemRef, usize)> = vec![(start, 0)];
        let mut on_path: FxHashSet<ItemRef> = FxHashSet::default();
        if done.contains(&start) {
            continue;
        }
        on_path.insert(start);
        while let Some((item, next)) = path.last_mut() {
            let edges = graph.get(item).map_or(&[][..], Vec::as_slice);
            let Some((target, _)) = edges.get(*next).copied() else {
                on_path.remove(item);
                done.insert(*item);
                path.pop();
                continue;
            };
            *next += 1;
            if on_path.contains(&target) {
                let from = path.iter().position(|(i, _)| *i == target).unwrap_or(0);
                let cycle: Edges = path[from..].iter().map(|(i, next)| (*i, graph[i][next - 1].1)).collect();
                let known = |c: &Edges| c.iter().any(|(i, _)| cycle.iter().any(|(j, _)| i == j));
                if !found.iter().any(known) {
                    found.push(cycle);
                }
            } else if !done.contains(&target) {
                on_path.insert(target);
                path.push((target, 0));
            }
        }
    }
    found
}

fn report_cycle(modules: &Modules, cycle: &Edges, diagnostics: &mut Diagnostics) {
    let name = |item: ItemRef| value_name(modules.item(item)).map_or("", |n| n.text.as_str());
    let [(first, span), rest @ ..] = cycle.as_slice() else { return };
    let word = item_word(modules.item(*first));
    let problem = if rest.is_empty() {
        let message = match word {
            "function" => format!("the function `{}` calls itself", name(*first)),
            _ => format!("the {word} `{}` is defined by itself", name(*first)),
        };
        Diagnostic::error("E0209", message).at(*span, "leads back to itself")
    } else {
        let message = format!("the {word} `{}` leads back to itself", name(*first));
        let mut problem = Diagnostic::error("E0209", message).at(*span, format!("names `{}`", name(rest[0].0)));
        for (i, (_, span)) in rest.iter().enumerate() {
            let next = rest.get(i + 1).map_or(*first, |(item, _)| *item);
            problem = problem.because(*span, format!("which names `{}`", name(next)));
        }
        problem
    };
    let problem = problem.note("there is no recursion, so that every value can be computed in bounded time");
    diagnostics.push(match word {
        "function" => problem.hint("repeat with `sum(i in 0..n) …`, or `product`, `max`, `min`"),
        _ => problem,
    });
}

/// Warns of what nobody uses in the scene itself. Others' files are theirs to keep tidy.
fn unused(modules: &Modules, graph: &FxHashMap<ItemRef, Edges>, diagnostics: &mut Diagnostics) {
    let scene = modules.module(ModuleId::SCENE);
    let reference = |index: usize| ItemRef { module: ModuleId::SCENE, index: index as u32 };
    let is_root = |item: &ast::Item| matches!(&item.kind, ItemKind::Block(b) if !matches!(b.kind, ast::BlockKind::Grid | ast::BlockKind::Style));
    let mut todo: Vec<ItemRef> =
        scene.tree.items.iter().enumerate().filter(|(_, i)| is_root(i)).map(|(i, _)| reference(i)).collect();
    // A file without anything to draw is a module for others: all it declares is for them.
    if todo.is_empty() {
        return;
    }
    let mut live: FxHashSet<ItemRef> = FxHashSet::default();
    while let Some(item) = todo.pop() {
        if live.insert(item) {
            todo.extend(graph.get(&item).into_iter().flatten().map(|(target, _)| *target));
        }
    }
    for (index, item) in scene.tree.items.iter().enumerate() {
        if let ItemKind::Use(used) = &item.kind {
            let named: FxHashSet<ItemRef> = graph
                .iter()
                .filter(|(i, _)| i.module == ModuleId::SCENE)
                .flat_map(|(_, e)| e)
                .map(|(t, _)| *t)
                .collect();
            for name in &used.names {
                let unused = scene.names.get(&name.text).is_some_and(|target| !named.contains(target));
                if unused {
                    diagnostics.push(
                        Diagnostic::warning("W0201", format!("`{}` is imported and never used", name.text))
                            .at(name.span, "not used in this file")
                            .hint("remove it"),
                    );
                }
            }
            continue;
        }
        let name = match &item.kind {
            ItemKind::Block(b) => b.name.as_ref(),
            ItemKind::Const { .. }
            | ItemKind::Param { .. }
            | ItemKind::Function(_)
            | ItemKind::Table { .. }
            | ItemKind::Transfer { .. }
            | ItemKind::Use(_) => value_name(item),
        };
        if let Some(name) = name
            && !live.contains(&reference(index))
            && !name.text.starts_with('_')
        {
            diagnostics.push(
                Diagnostic::warning("W0203", format!("the {} `{}` is never used", item_word(item), name.text))
                    .at(name.span, "nothing that is drawn depends on it")
                    .hint(format!("remove it, or call it `_{}` to keep it", name.text)),
            );
        }
    }
}
