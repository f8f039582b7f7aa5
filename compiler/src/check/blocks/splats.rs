//! `splats`.

use crate::check::Checker;
use crate::check::hir::Splats;
use crate::check::scope::Inputs;
use crate::check::types::Ty;
use crate::diagnostic::Diagnostic;
use crate::ir::{SplatBlend, SplatsId};
use crate::resolve::ItemRef;
use crate::syntax::ast;

const PROPERTIES: &[&str] = &["file", "transform", "blend"];

impl Checker<'_> {
    /// Splats; what their file holds is asked for when they are first named.
    pub(in crate::check) fn splats(&mut self, item: ItemRef) -> Option<SplatsId> {
        if let Some(known) = self.known_splats.get(&item) {
            return *known;
        }
        self.known_splats.insert(item, None);
        let modules = self.modules;
        let declared = modules.item(item);
        let ast::ItemKind::Block(block) = &declared.kind else { return None };
        if modules.is_cyclic(item) {
            return None;
        }
        let name = block.name.as_ref().map_or("", |n| n.text.as_str());
        let mut properties = self.properties(block, PROPERTIES);
        let transform = match properties.take("transform") {
            None => Some(None),
            Some(property) => {
                let transform = self.live(property, "splats", Ty::Transform, Inputs::FRAME);
                if let Some(transform) = &transform {
                    self.validate_transform(transform);
                }
                transform.map(Some)
            }
        };
        let blends = [("encoded", SplatBlend::Encoded), ("linear", SplatBlend::Linear)];
        let blend = properties.take("blend").map_or(Some(SplatBlend::Encoded), |p| self.word(p, "splats", &blends));
        let Some(file) = properties.take("file") else {
            self.missing_property(block, "file", "file = \"room.ply\"");
            return None;
        };
        let path = self.text(item.module, file, "splats")?;
        if ![".ply", ".spz"].iter().any(|end| path.to_lowercase().ends_with(end)) {
            self.report(
                Diagnostic::error("E0406", "splats are read from `.ply` and `.spz` files")
                    .at(file.value.span, "another kind of file"),
            );
            return None;
        }
        let from = modules.module(item.module).name.clone();
        let header = self.loader.splats(&from, &path);
        let header = self.header(header, file.value.span)?;
        let (transform, blend) = (transform?, blend?);
        let id = SplatsId(self.splats.len() as u32);
        let span = block.name.as_ref().map_or(declared.span, |n| n.span);
        self.splats.push(Splats { name: name.to_owned(), span, path, from, header, transform, blend });
        self.known_splats.insert(item, Some(id));
        Some(id)
    }
}
