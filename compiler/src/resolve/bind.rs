//! What the `use`s of a module bring in.

use super::load::Targets;
use super::{ItemRef, ModuleId, Modules, closest, item_word, words};
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::library;
use crate::syntax::ast::{self, ItemKind, ModulePath, Name};
use rustc_hash::FxHashMap;

/// What the `use`s of one module bring in.
#[derive(Default)]
pub(super) struct Bound {
    pub(super) names: Vec<(String, ItemRef)>,
    /// Names that were asked for and could not be had.
    pub(super) broken: Vec<String>,
}

/// `std::noise` to its module.
pub(super) fn library_module(words: &[Name]) -> Option<ModuleId> {
    let [std, module] = words else { return None };
    let place = library::MODULES.iter().position(|m| std.text == "std" && m.word == module.text)?;
    Some(ModuleId(place as u32 + 1))
}

pub(super) fn bind(modules: &Modules, id: ModuleId, targets: &Targets, diagnostics: &mut Diagnostics) -> Bound {
    let module = modules.module(id);
    let mut bound = Bound::default();
    let mut imported: FxHashMap<&str, &Name> = FxHashMap::default();
    for (index, item) in module.tree.items.iter().enumerate() {
        let ItemKind::Use(used) = &item.kind else { continue };
        let target = match &used.module {
            ModulePath::File { .. } => targets.get(&(id, index as u32)).copied(),
            ModulePath::Library(path) => library_target(path, used, diagnostics),
        };
        let Some(target) = target else {
            let prelude = |n: &Name| matches!(used.module, ModulePath::Library(_)) && words::is_builtin(&n.text);
            bound.broken.extend(used.names.iter().filter(|n| !prelude(n)).map(|n| n.text.clone()));
            continue;
        };
        let from = modules.module(target);
        for name in &used.names {
            if let Some(first) = imported.insert(&name.text, name) {
                diagnostics.push(
                    Diagnostic::error("E0203", format!("`{}` is imported twice", name.text))
                        .at(name.span, "the second time")
                        .because(first.span, "the first time")
                        .hint("remove one of the two"),
                );
                continue;
            }
            // Only what the module declares itself is for others to use.
            let found = from.names.get(&name.text).filter(|item| item.module == target).copied();
            match found {
                Some(item) => {
                    if let Some(own) = module.names.get(&name.text).copied() {
                        let first = super::value_name(modules.item(own)).map_or(name.span, |n| n.span);
                        diagnostics.push(
                            Diagnostic::error("E0203", format!("`{}` is imported and declared here too", name.text))
                                .at(name.span, "imported here")
                                .because(first, "declared here")
                                .hint("rename the one in this file, or remove it from the `use`"),
                        );
                    } else {
                        bound.names.push((name.text.clone(), item));
                    }
                }
                // Names of the prelude may be imported from any module of the library.
                None if target.is_library() && words::is_builtin(&name.text) => {}
                None => {
                    bound.broken.push(name.text.clone());
                    if !from.broken.contains(&name.text) {
                        diagnostics.push(unknown(modules, target, name));
                    }
                }
            }
        }
    }
    bound
}

fn unknown(modules: &Modules, target: ModuleId, name: &Name) -> Diagnostic {
    let from = modules.module(target);
    let mut problem =
        Diagnostic::error("E0207", format!("`{}` has no `{}`", from.name, name.text)).at(name.span, "not found there");
    if let Some(block) = from.blocks.get(&name.text) {
        let word = item_word(modules.item(*block));
        return problem.note(format!(
            "there is a {word} of that name, but only functions, constants, params, tables and grids can be used"
        ));
    }
    let mut own: Vec<&str> = from.names.iter().filter(|(_, i)| i.module == target).map(|(n, _)| n.as_str()).collect();
    own.sort_unstable();
    if let Some(near) = closest(&name.text, own.iter().copied()) {
        return problem.hint(format!("did you mean `{near}`?"));
    }
    if let Some(elsewhere) = Modules::library_name(&name.text) {
        let home = &modules.module(elsewhere.module).name;
        return problem.hint(format!("it is in `{home}`: `use {home}::{}`", name.text));
    }
    if own.is_empty() {
        problem = problem.note(format!("`{}` declares nothing that can be used", from.name));
    } else {
        problem = problem.note(format!("it has {}", list(&own)));
    }
    problem
}

/// `a`, `b` and `c`.
pub(crate) fn list(words: &[&str]) -> String {
    let quoted: Vec<String> = words.iter().map(|w| format!("`{w}`")).collect();
    match quoted.as_slice() {
        [] => String::new(),
        [one] => one.clone(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}

fn library_target(path: &[Name], used: &ast::Use, diagnostics: &mut Diagnostics) -> Option<ModuleId> {
    if let Some(id) = library_module(path) {
        return Some(id);
    }
    // `use std::math::exp`: the prelude has no module of its own, but may be imported by its field's name.
    let prelude = path.len() == 2 && path[0].text == "std" && path[1].text == "math";
    if prelude && used.names.iter().all(|n| words::is_builtin(&n.text)) {
        return None;
    }
    let words: Vec<&str> = path.iter().map(|n| n.text.as_str()).collect();
    let span = match (path.first(), path.last()) {
        (Some(first), Some(last)) => first.span.to(last.span),
        _ => return None,
    };
    let known: Vec<&str> = library::MODULES.iter().map(|m| m.name).collect();
    let mut problem = Diagnostic::error("E0206", format!("there is no module `{}`", words.join("::")));
    problem = problem.at(span, "not part of the library");
    let wanted = if words.first() == Some(&"std") { words.join("::") } else { format!("std::{}", words.join("::")) };
    let hint = if known.contains(&wanted.as_str()) {
        format!("write `{wanted}`")
    } else if let Some(near) = closest(&wanted, known.iter().copied()) {
        format!("did you mean `{near}`?")
    } else {
        "a file of your own is named by its path, in quotes: `use \"./my_lib.vol\"::name`".to_owned()
    };
    diagnostics.push(problem.note(format!("the library has {}", list(&known))).hint(hint));
    None
}
