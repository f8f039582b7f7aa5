//! Types and dimensions: the only room that knows units.
//!
//! Checking takes the bound modules to one [`hir::Scene`]: every name resolved, every expression typed and in SI, sugar
//! expanded. It reports as much as it can in one run; what is wrong already has the type `types::Ty::Error`, which
//! fits everywhere, so that a mistake is reported once.

mod blocks;
mod builtins;
mod call;
mod coerce;
mod constant;
mod dimension;
mod expression;
mod function;
pub mod hir;
mod items;
mod mie;
mod name;
mod operators;
mod phase;
mod prelude;
mod rows;
mod scope;
mod type_expr;
mod types;
mod units;

use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::Param;
use crate::ir::SplatsId;
use crate::loader::Loader;
use crate::resolve::{ItemRef, ModuleId, Modules};
use crate::source::Span;
use crate::syntax::ast;
use hir::{ConstId, FunctionId, GridId, TableId};
use rustc_hash::{FxHashMap, FxHashSet};
use types::Ty;

/// Checks a scene with all its modules. `None` when it has errors; they are in `diagnostics`.
#[must_use]
pub fn check(modules: &Modules, loader: &dyn Loader, diagnostics: &mut Diagnostics) -> Option<hir::Scene> {
    let mut checker = Checker::new(modules, loader, diagnostics);
    checker.items();
    let scene = checker.scene();
    checker.finish_functions();
    checker.finish_asymmetries();
    let scene = checker.assemble(scene);
    let failed = diagnostics.has_errors();
    if !failed && scene.is_none() {
        let start = modules.module(ModuleId::SCENE).tree.span;
        diagnostics.push(
            Diagnostic::error("E0500", "something in this scene is wrong, and what it is was not reported")
                .at(Span { end: start.start, ..start }, "this is a fault of the compiler"),
        );
        return None;
    }
    if !failed {
        for warning in modules.unused().iter() {
            diagnostics.push(warning.clone());
        }
    }
    // From top to bottom, as a reader meets them.
    diagnostics.0.sort_by_key(|d| d.primary_span().map(|s| (s.source, s.start)));
    scene.filter(|_| !failed)
}

/// A table or transfer function that was checked.
#[derive(Copy, Clone, Debug)]
struct TableInfo {
    id: TableId,
    key: Ty,
    /// Type of what a lookup gives.
    value: Ty,
}

/// State of one run.
struct Checker<'a> {
    modules: &'a Modules,
    loader: &'a dyn Loader,
    diagnostics: &'a mut Diagnostics,
    params: Vec<Param>,
    constants: Vec<(String, hir::Expr)>,
    /// `None` until its body is checked, or when that failed.
    functions: Vec<Option<hir::Function>>,
    tables: Vec<hir::Table>,
    grids: Vec<hir::Grid>,
    splats: Vec<hir::Splats>,
    // What was checked already; `None` for what failed and was reported.
    known_params: FxHashMap<ItemRef, Option<(crate::ir::ParamId, Ty)>>,
    known_constants: FxHashMap<ItemRef, Option<(ConstId, Ty)>>,
    known_tables: FxHashMap<ItemRef, Option<TableInfo>>,
    known_grids: FxHashMap<ItemRef, Option<GridId>>,
    known_splats: FxHashMap<ItemRef, Option<SplatsId>>,
    signatures: FxHashMap<ItemRef, std::rc::Rc<function::Signature>>,
    instances: FxHashMap<function::InstanceKey, FunctionId>,
    /// Instances whose bodies are still to be checked.
    queue: Vec<function::Queued>,
    /// Functions whose body is wrong as it is declared.
    failed_functions: FxHashSet<ItemRef>,
    /// Arguments `g` and `k` of phase functions, to be looked at when all is known.
    asymmetries: Vec<phase::Asymmetry>,
}

impl<'a> Checker<'a> {
    fn new(modules: &'a Modules, loader: &'a dyn Loader, diagnostics: &'a mut Diagnostics) -> Self {
        Self {
            modules,
            loader,
            diagnostics,
            params: vec![],
            constants: vec![],
            functions: vec![],
            tables: vec![],
            grids: vec![],
            splats: vec![],
            known_params: FxHashMap::default(),
            known_constants: FxHashMap::default(),
            known_tables: FxHashMap::default(),
            known_grids: FxHashMap::default(),
            known_splats: FxHashMap::default(),
            signatures: FxHashMap::default(),
            instances: FxHashMap::default(),
            queue: vec![],
            failed_functions: FxHashSet::default(),
            asymmetries: vec![],
        }
    }

    fn report(&mut self, diagnostic: Diagnostic) {
        self.diagnostics.push(diagnostic);
    }

    /// The source under a span, on one line.
    fn snippet(&self, span: Span) -> String {
        self.modules.text(span).split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Checks every item of the scene and its local modules that expressions can name, used or not.
    fn items(&mut self) {
        let modules = self.modules;
        for (module, loaded) in modules.own() {
            for (index, item) in loaded.tree.items.iter().enumerate() {
                let reference = ItemRef { module, index: index as u32 };
                match &item.kind {
                    ast::ItemKind::Use(_) => {}
                    ast::ItemKind::Const { .. } => {
                        self.constant(reference);
                    }
                    ast::ItemKind::Param { .. } => {
                        self.param(reference);
                    }
                    ast::ItemKind::Function(_) => self.own_function(reference),
                    ast::ItemKind::Table { .. } | ast::ItemKind::Transfer { .. } => {
                        self.table(reference);
                    }
                    ast::ItemKind::Block(b) if b.kind == ast::BlockKind::Grid => {
                        self.grid(reference);
                    }
                    // Of other files, what is not named is not drawn.
                    ast::ItemKind::Block(b) if b.kind == ast::BlockKind::Splats && module == ModuleId::SCENE => {
                        self.splats(reference);
                    }
                    ast::ItemKind::Block(_) => {}
                }
            }
        }
        self.finish_functions();
    }

    /// Puts the parts together; `None` when something is missing because it was wrong.
    fn assemble(&mut self, scene: hir::Scene) -> Option<hir::Scene> {
        let functions = std::mem::take(&mut self.functions).into_iter().collect::<Option<Vec<_>>>()?;
        Some(hir::Scene {
            params: std::mem::take(&mut self.params),
            constants: std::mem::take(&mut self.constants),
            functions,
            tables: std::mem::take(&mut self.tables),
            grids: std::mem::take(&mut self.grids),
            splats: std::mem::take(&mut self.splats),
            ..scene
        })
    }

    /// The blocks of the scene itself, in order.
    fn scene_blocks(&self) -> impl Iterator<Item = (&'a ast::Item, &'a ast::Block)> + use<'a> {
        let modules: &'a Modules = self.modules;
        modules.module(ModuleId::SCENE).tree.items.iter().filter_map(|item| match &item.kind {
            ast::ItemKind::Block(block) => Some((item, block)),
            ast::ItemKind::Use(_)
            | ast::ItemKind::Const { .. }
            | ast::ItemKind::Param { .. }
            | ast::ItemKind::Function(_)
            | ast::ItemKind::Table { .. }
            | ast::ItemKind::Transfer { .. } => None,
        })
    }
}
