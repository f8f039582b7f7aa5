//! Loading: the scene, the modules that it names, and theirs; each once.

use super::{ItemRef, Module, ModuleId, Modules, bind, declare, references};
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::library;
use crate::loader::Loader;
use crate::source::{SourceId, Sources};
use crate::syntax::{self, ast};
use rustc_hash::FxHashMap;
use std::sync::LazyLock;

/// More local modules than anyone writes, so that a loader that invents files cannot keep us busy forever.
const MAX_MODULES: usize = 256;

/// The library's modules with their names bound.
pub(super) fn library() -> &'static [Module] {
    static LIBRARY: LazyLock<Vec<Module>> = LazyLock::new(|| {
        let trees = &library::parsed().0;
        let mut modules: Vec<Module> =
            library::MODULES.iter().zip(trees).map(|(m, tree)| Module::new(m.name, m.text, tree.clone())).collect();
        let mut ignored = Diagnostics::default();
        for (i, module) in modules.iter_mut().enumerate() {
            declare::declare(ModuleId(i as u32 + 1), module, &mut ignored);
        }
        for i in 0..modules.len() {
            let imports: Vec<(String, ItemRef)> = modules[i]
                .tree
                .items
                .iter()
                .filter_map(|item| if let ast::ItemKind::Use(used) = &item.kind { Some(used) } else { None })
                .filter_map(|used| match &used.module {
                    ast::ModulePath::Library(words) => Some((used, bind::library_module(words)?)),
                    ast::ModulePath::File { .. } => None,
                })
                .flat_map(|(used, id)| {
                    let names = &modules[id.0 as usize - 1].names;
                    let found = |n: &ast::Name| Some((n.text.clone(), *names.get(&n.text)?));
                    used.names.iter().filter_map(found).collect::<Vec<_>>()
                })
                .collect();
            modules[i].names.extend(imports);
        }
        modules
    });
    &LIBRARY
}

/// Everything the library declares.
pub(super) fn library_names() -> &'static FxHashMap<String, ItemRef> {
    static NAMES: LazyLock<FxHashMap<String, ItemRef>> = LazyLock::new(|| {
        // Earlier modules win, so that the order of MODULES is the order of precedence.
        let all = library().iter().rev().flat_map(|m| m.names.iter().map(|(n, i)| (n.clone(), *i)));
        all.collect()
    });
    &NAMES
}

/// Loads a scene and every module that it names, binds all names, and reports what is wrong with them.
///
/// `sources` is filled anew: the scene becomes source 0, the library sources 1 and up, local modules follow.
#[must_use]
pub fn load(
    name: &str,
    text: &str,
    loader: &dyn Loader,
    sources: &mut Sources,
    diagnostics: &mut Diagnostics,
) -> Modules {
    *sources = Sources::default();
    let scene = sources.add(name, text);
    for module in library::MODULES {
        sources.add(module.name, module.text);
    }
    for problem in library::parsed().1.iter() {
        diagnostics.push(problem.clone());
    }
    let tree = syntax::parse(scene, text, diagnostics);
    let mut loading =
        Loading { loader, sources, own: vec![], known: FxHashMap::default(), targets: FxHashMap::default() };
    loading.known.insert(name.to_owned(), ModuleId::SCENE);
    loading.own.push(Module::new(name, text, tree));
    loading.follow(ModuleId::SCENE, &mut vec![], diagnostics);
    let Loading { own, targets, .. } = loading;
    let mut modules = Modules { own, ..Modules::default() };
    let ids: Vec<ModuleId> = modules.own().map(|(id, _)| id).collect();
    for (id, module) in ids.iter().zip(&mut modules.own) {
        declare::declare(*id, module, diagnostics);
    }
    let bound: Vec<bind::Bound> = ids.iter().map(|id| bind::bind(&modules, *id, &targets, diagnostics)).collect();
    for (module, bound) in modules.own.iter_mut().zip(bound) {
        for (name, item) in bound.names {
            module.names.entry(name).or_insert(item);
        }
        module.broken.extend(bound.broken);
    }
    references::analyse(&mut modules, diagnostics);
    modules
}

/// Which module each `use "…"` of each module names; those that could not be loaded are missing.
pub(super) type Targets = FxHashMap<(ModuleId, u32), ModuleId>;

struct Loading<'a> {
    loader: &'a dyn Loader,
    sources: &'a mut Sources,
    own: Vec<Module>,
    known: FxHashMap<String, ModuleId>,
    targets: Targets,
}

impl Loading<'_> {
    fn own_index(id: ModuleId) -> usize {
        if id == ModuleId::SCENE { 0 } else { id.0 as usize - library::MODULES.len() }
    }

    /// Loads what a module names. `path` holds the modules that led here.
    fn follow(&mut self, id: ModuleId, path: &mut Vec<ModuleId>, diagnostics: &mut Diagnostics) {
        path.push(id);
        let module = &self.own[Self::own_index(id)];
        let from = module.name.clone();
        let uses: Vec<(u32, String, crate::source::Span)> = module
            .tree
            .items
            .iter()
            .enumerate()
            .filter_map(|(i, item)| {
                let ast::ItemKind::Use(used) = &item.kind else { return None };
                let ast::ModulePath::File { path, span } = &used.module else { return None };
                Some((i as u32, path.clone(), *span))
            })
            .collect();
        for (index, written, span) in uses {
            let (name, text) = match self.loader.module(&from, &written) {
                Ok(found) => found,
                Err(error) => {
                    let mut problem = Diagnostic::error(error.code, error.message).at(span, "named here");
                    problem.hints.extend(error.hint);
                    diagnostics.push(problem);
                    continue;
                }
            };
            if let Some(known) = self.known.get(&name).copied() {
                if let Some(start) = path.iter().position(|m| *m == known) {
                    let names: Vec<&str> =
                        path[start..].iter().map(|m| self.own[Self::own_index(*m)].name.as_str()).collect();
                    let message = if names.len() == 1 {
                        "a module cannot use itself".to_owned()
                    } else {
                        "modules use each other in a circle".to_owned()
                    };
                    diagnostics.push(
                        Diagnostic::error("E0208", message)
                            .at(span, format!("leads back to `{name}`"))
                            .note(format!("the circle: {} -> {name}", names.join(" -> ")))
                            .hint("move what both need into a third file that uses neither"),
                    );
                    continue;
                }
                self.targets.insert((id, index), known);
                continue;
            }
            if self.own.len() >= MAX_MODULES {
                diagnostics.push(
                    Diagnostic::error("E0214", format!("more than {MAX_MODULES} modules")).at(span, "one too many"),
                );
                return;
            }
            let SourceId(source) = self.sources.add(name.clone(), text.clone());
            let tree = syntax::parse(SourceId(source), &text, diagnostics);
            let module = ModuleId(source);
            self.known.insert(name.clone(), module);
            self.targets.insert((id, index), module);
            self.own.push(Module::new(&name, &text, tree));
            self.follow(module, path, diagnostics);
        }
        path.pop();
    }
}
