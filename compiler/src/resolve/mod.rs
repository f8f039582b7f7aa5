//! Names: which modules a scene consists of, what each name in them refers to, and which items refer to themselves.

mod bind;
mod declare;
mod load;
mod references;
mod suggest;
mod words;

pub(crate) use bind::list;
pub(crate) use declare::input_meaning;
pub use load::load;
pub(crate) use suggest::{closest, synonym};
pub(crate) use words::{CONSTANTS, FUNCTIONS, INPUTS};

use crate::diagnostic::Diagnostics;
use crate::library;
use crate::source::Span;
use crate::syntax::ast;
use rustc_hash::{FxHashMap, FxHashSet};

/// Identifies a module; equal to the number of its source.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ModuleId(pub u32);

impl ModuleId {
    /// The scene itself.
    pub const SCENE: Self = Self(0);

    /// Whether it belongs to the standard library.
    #[must_use]
    pub fn is_library(self) -> bool {
        (1..=library::MODULES.len() as u32).contains(&self.0)
    }
}

/// Identifies an item of a module.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ItemRef {
    /// Its module.
    pub module: ModuleId,
    /// Its place in [`ast::Module::items`].
    pub index: u32,
}

/// A loaded text with its tree and its names.
#[derive(Clone, Debug)]
pub struct Module {
    /// As diagnostics print it, and as loaders know it.
    pub name: String,
    /// The whole text.
    pub text: String,
    /// Its tree.
    pub tree: ast::Module,
    /// What names in its expressions refer to: its own functions, constants, params, tables, grids and
    /// splats, and what it `use`s.
    pub names: FxHashMap<String, ItemRef>,
    /// Its other named items: media, lights, surfaces, styles …
    pub blocks: FxHashMap<String, ItemRef>,
    /// Names whose declaration is broken and was reported: uses of them are not to be reported again.
    pub broken: FxHashSet<String>,
}

impl Module {
    fn new(name: &str, text: &str, tree: ast::Module) -> Self {
        let broken = tree.unread.iter().map(|n| n.text.clone()).collect();
        let (name, text) = (name.to_owned(), text.to_owned());
        Self { name, text, tree, names: FxHashMap::default(), blocks: FxHashMap::default(), broken }
    }
}

/// All modules of one compilation.
#[derive(Clone, Debug, Default)]
pub struct Modules {
    /// The scene first, then local modules in order of loading. The library's modules are shared by all compilations.
    own: Vec<Module>,
    /// Items that refer to themselves, directly or through others; reported already.
    cyclic: FxHashSet<ItemRef>,
    /// Warnings of what nobody uses, to be given when nothing else is wrong: a misspelt name would bring one too.
    unused: Diagnostics,
}

impl Modules {
    /// The module with this id.
    #[must_use]
    pub fn module(&self, id: ModuleId) -> &Module {
        let library = library::MODULES.len() as u32;
        match id.0 {
            0 => &self.own[0],
            i if i <= library => &load::library()[i as usize - 1],
            i => &self.own[(i - library) as usize],
        }
    }

    /// The scene and its local modules.
    pub fn own(&self) -> impl Iterator<Item = (ModuleId, &Module)> {
        let library = library::MODULES.len() as u32;
        self.own.iter().enumerate().map(move |(i, m)| (ModuleId(if i == 0 { 0 } else { library + i as u32 }), m))
    }

    /// An item.
    #[must_use]
    pub fn item(&self, item: ItemRef) -> &ast::Item {
        &self.module(item.module).tree.items[item.index as usize]
    }

    /// What a name in an expression of this module refers to, the library's names last. Implicit inputs, units and
    /// the prelude's own names come between the two and are not looked at here.
    #[must_use]
    pub fn own_name(&self, module: ModuleId, name: &str) -> Option<ItemRef> {
        self.module(module).names.get(name).copied()
    }

    /// An item of the library that is usable without `use`.
    #[must_use]
    pub fn library_name(name: &str) -> Option<ItemRef> {
        load::library_names().get(name).copied()
    }

    /// Every name of the library.
    pub fn library_names() -> impl Iterator<Item = &'static str> {
        load::library_names().keys().map(String::as_str)
    }

    /// Whether an item refers to itself; that was reported.
    #[must_use]
    pub fn is_cyclic(&self, item: ItemRef) -> bool {
        self.cyclic.contains(&item)
    }

    /// Warnings of what nobody uses; beside errors they only distract.
    #[must_use]
    pub fn unused(&self) -> &Diagnostics {
        &self.unused
    }

    /// The text under a span.
    #[must_use]
    pub fn text(&self, span: Span) -> &str {
        &self.module(ModuleId(span.source.0)).text[span.range()]
    }
}

/// The name an item declares in the namespace of expressions.
#[must_use]
pub(crate) fn value_name(item: &ast::Item) -> Option<&ast::Name> {
    match &item.kind {
        ast::ItemKind::Const { name, .. }
        | ast::ItemKind::Param { name, .. }
        | ast::ItemKind::Table { name, .. }
        | ast::ItemKind::Transfer { name, .. } => Some(name),
        ast::ItemKind::Function(f) => Some(&f.name),
        ast::ItemKind::Block(b) if matches!(b.kind, ast::BlockKind::Grid | ast::BlockKind::Splats) => b.name.as_ref(),
        ast::ItemKind::Block(_) | ast::ItemKind::Use(_) => None,
    }
}

/// What an item is called in messages: `function`, `medium` …
#[must_use]
pub(crate) fn item_word(item: &ast::Item) -> &'static str {
    match &item.kind {
        ast::ItemKind::Const { .. } => "constant",
        ast::ItemKind::Param { .. } => "param",
        ast::ItemKind::Table { .. } => "table",
        ast::ItemKind::Transfer { .. } => "transfer function",
        ast::ItemKind::Function(_) => "function",
        ast::ItemKind::Block(b) => b.kind.word(),
        ast::ItemKind::Use(_) => "use",
    }
}
