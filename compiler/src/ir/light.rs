//! Lights and opaque surfaces, as nodes of the scene's graph. Spectra have the width of the bands, or 1 when neutral.
//!
//! A light shines on a point as a direction (to the light), an irradiance on a plane facing it, and a distance up to which
//! media and surfaces attenuate it. An environment is radiance from every direction; it is
//! [`super::FieldScene::background`] too, so it is no light of this list.

use super::{NodeId, Shape};
use crate::source::Span;

/// Something that shines from outside the media.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The scene's name.
    pub name: String,
    /// Where it is declared.
    pub span: Option<Span>,
    /// Which kind.
    pub kind: LightKind,
}

/// The kinds of lights. All nodes are of tier Frame or lower.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// Parallel light, or a disc infinitely far away.
    Directional {
        /// The unit vector along which it travels.
        direction: NodeId,
        /// On a plane facing it. Spectrum of light.
        irradiance: NodeId,
        /// Radians; `None` is a point infinitely far away. Of a disc of radius α, every direction within α of `direction`
        /// brings the same radiance E / (π sin² α), so that a plane facing it receives E.
        angular_diameter: Option<NodeId>,
    },
    /// E = intensity / max(distance, radius)².
    Point {
        /// Where it is.
        position: NodeId,
        /// Spectrum of light · length².
        intensity: NodeId,
        /// A length; `None` is 0.
        radius: Option<NodeId>,
    },
}

impl LightKind {
    /// Whether it shines from many directions.
    #[must_use]
    pub fn is_disc(&self) -> bool {
        matches!(self, Self::Directional { angular_diameter: Some(_), .. })
    }

    /// Rewrites every node it names.
    pub fn map_nodes(&mut self, map: &mut dyn FnMut(NodeId) -> NodeId) {
        let (a, b, c) = match self {
            Self::Directional { direction, irradiance, angular_diameter } => (direction, irradiance, angular_diameter),
            Self::Point { position, intensity, radius } => (position, intensity, radius),
        };
        *a = map(*a);
        *b = map(*b);
        if let Some(c) = c {
            *c = map(*c);
        }
    }
}

/// Which triangles, by number in [`super::FieldScene::meshes`].
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MeshId(pub u32);

/// A file of triangles that a scene names.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshInfo {
    /// As written in the scene.
    pub path: String,
    /// The source that wrote it.
    pub from: String,
    /// Where.
    pub span: Option<Span>,
    /// Number of triangles, and the box around them in metres.
    pub header: crate::loader::MeshHeader,
}

/// An opaque Lambertian surface, seen and lit from both sides: it reflects albedo · E / π.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// The scene's name.
    pub name: String,
    /// Where it is declared.
    pub span: Option<Span>,
    /// Which points.
    pub shape: SurfaceShape,
    /// Share of light that it reflects, 0 to 1; may depend on the position. Spectrum.
    pub albedo: NodeId,
}

/// The forms of surfaces. All nodes are of tier Frame or lower, but for the field of an `sdf`.
#[derive(Clone, Debug, PartialEq)]
pub enum SurfaceShape {
    /// An infinite plane.
    Plane {
        /// Some point of it.
        point: NodeId,
        /// Unit vector.
        normal: NodeId,
    },
    /// A flat disc.
    Disc {
        /// Its middle.
        center: NodeId,
        /// Unit vector.
        normal: NodeId,
        /// A length.
        radius: NodeId,
    },
    /// The boundary of a region.
    Boundary(Shape),
    /// Triangles, in metres.
    Mesh(MeshId),
}

impl SurfaceShape {
    /// Rewrites every node it names.
    pub fn map_nodes(&mut self, map: &mut dyn FnMut(NodeId) -> NodeId) {
        match self {
            Self::Plane { point, normal } => {
                *point = map(*point);
                *normal = map(*normal);
            }
            Self::Disc { center, normal, radius } => {
                for node in [center, normal, radius] {
                    *node = map(*node);
                }
            }
            Self::Boundary(shape) => shape.map_nodes(map),
            Self::Mesh(_) => {}
        }
    }
}
