//! 3D Gaussian splats: data from a file, placed in the scene. What they mean stands in the language reference and, in f64, in
//! the reference engine.

use super::{Affine, NodeId};
use crate::loader::SplatsHeader;
use crate::source::Span;

/// Which splats, by number in [`super::FieldScene::splats`].
#[derive(Copy, Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SplatsId(pub u32);

/// In which numbers a splat is blended with what is behind it.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum SplatBlend {
    /// sRGB-encoded: as splats are fitted.
    Encoded,
    /// Radiance.
    Linear,
}

/// Where splats are in the world, both ways. Nodes are of tier Frame or lower.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Placement {
    /// From the file's space (in the graph's units) to the world.
    pub to_world: Affine,
    /// Its inverse.
    pub from_world: Affine,
}

/// A file of splats in the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatsInfo {
    /// The scene's name.
    pub name: String,
    /// Where it is declared.
    pub span: Option<Span>,
    /// As written.
    pub path: String,
    /// Name of the source that wrote it.
    pub from: String,
    /// What the file holds.
    pub header: SplatsHeader,
    /// `None` is as it stands.
    pub placement: Option<Placement>,
    /// How they are blended.
    pub blend: SplatBlend,
}

impl SplatsInfo {
    /// Rewrites every node it names.
    pub fn map_nodes(&mut self, map: &mut dyn FnMut(NodeId) -> NodeId) {
        for affine in self.placement.iter_mut().flat_map(|p| [&mut p.to_world, &mut p.from_world]) {
            affine.map_nodes(map);
        }
    }
}
