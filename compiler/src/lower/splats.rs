//! Splats: where they are, and the box that stands for them.

use super::{Lowered, Lowerer};
use crate::check::hir;
use crate::ir::{Affine, Placement, Primitive, PrimitiveKind, Shape, SplatsId, SplatsInfo};
use crate::loader::SplatsHeader;
use crate::source::Span;

impl<'s> Lowerer<'s, '_> {
    /// Every item of splats, in order.
    pub(super) fn splats(&mut self) -> Vec<SplatsInfo> {
        let scene = self.scene;
        let mut all = vec![];
        for splats in &scene.splats {
            if let Ok(placement) = self.placement(splats) {
                all.push(SplatsInfo {
                    name: splats.name.clone(),
                    span: Some(splats.span),
                    path: splats.path.clone(),
                    from: splats.from.clone(),
                    header: splats.header,
                    placement,
                    blend: splats.blend,
                });
            }
        }
        all
    }

    fn placement(&mut self, splats: &'s hir::Splats) -> Lowered<Option<Placement>> {
        let Some(transform) = &splats.transform else { return Ok(None) };
        self.fresh();
        let transform = self.as_transform(transform)?;
        Ok(Some(Placement { to_world: transform.forward, from_world: transform.inverse }))
    }

    /// The box around most of the centres, which is what the name of splats means in an expression.
    pub(super) fn splats_box(&mut self, id: SplatsId, span: Span) -> Lowered<Shape> {
        let scene = self.scene;
        let Some(splats) = scene.splats.get(id.0 as usize) else {
            return self.broken_promise(span, "unknown splats");
        };
        let placement = self.placement(splats)?;
        Ok(self.core(&splats.header, placement.map(|p| p.from_world), Some(span)))
    }

    fn core(&mut self, header: &SplatsHeader, from_world: Option<Affine>, span: Option<Span>) -> Shape {
        let scale = self.units.scale(1.0);
        let (min, max) = (header.core.0.map(|x| x * scale), header.core.1.map(|x| x * scale));
        let kind = PrimitiveKind::Box { min: self.graph.vector(&min), max: self.graph.vector(&max) };
        Shape::Primitive(Primitive { kind, from_world, span })
    }

    /// What a camera that is not told otherwise frames of splats.
    pub(super) fn splats_shapes(&mut self, splats: &[SplatsInfo]) -> Vec<Shape> {
        splats.iter().map(|s| self.core(&s.header, s.placement.map(|p| p.from_world), None)).collect()
    }
}
