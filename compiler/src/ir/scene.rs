//! A scene whose every field is a node of one graph: what lowering makes, passes rewrite, and engines draw.

use super::{Bands, Graph, Light, MeshInfo, NodeId, SplatsInfo, Surface, Type};
use crate::source::Span;

/// What one unit of the graph is worth.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Units {
    /// Metres per unit of length: a power of two near the size of the scene, so that f32 sees numbers near 1.
    pub length: f64,
}

impl Units {
    /// SI: one unit is one metre.
    pub const METRE: Self = Self { length: 1.0 };

    /// What a value of dimension lengthⁿ in SI units is in the graph's units.
    #[must_use]
    pub fn scale(self, length_exponent: f64) -> f64 {
        self.length.powf(-length_exponent)
    }
}

/// A 3×3 matrix and an offset, each a node: `rows · x + offset`.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Affine {
    /// Rows, width 3.
    pub rows: [NodeId; 3],
    /// Width 3.
    pub offset: NodeId,
}

impl Affine {
    /// Rewrites every node it names.
    pub fn map_nodes(&mut self, map: &mut dyn FnMut(NodeId) -> NodeId) {
        self.rows.iter_mut().for_each(|n| *n = map(*n));
        self.offset = map(self.offset);
    }
}

/// A region of space. All nodes are of tier Frame or lower, but for the field of an `sdf`.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// All of space.
    Everywhere,
    /// One closed form.
    Primitive(Primitive),
    /// In any.
    Union(Vec<Shape>),
    /// In all.
    Intersection(Vec<Shape>),
    /// In the first and in none of the others.
    Difference(Box<Shape>, Vec<Shape>),
}

/// A closed-form region, given in its own space.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// Which.
    pub kind: PrimitiveKind,
    /// From the world to the primitive's own space; `None` is the identity. Rays keep their parameter under it.
    pub from_world: Option<Affine>,
    /// Where it is written.
    pub span: Option<Span>,
}

/// The closed forms. Vectors have width 3, lengths width 1.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "named as in the language")]
pub enum PrimitiveKind {
    Sphere {
        center: NodeId,
        radius: NodeId,
    },
    Ellipsoid {
        center: NodeId,
        radii: NodeId,
    },
    Box {
        min: NodeId,
        max: NodeId,
    },
    /// from ≤ axis·p ≤ to, with a unit axis.
    Slab {
        axis: NodeId,
        from: NodeId,
        to: NodeId,
    },
    /// A capped cylinder between two points.
    Cylinder {
        from: NodeId,
        to: NodeId,
        radius: NodeId,
    },
    Shell {
        center: NodeId,
        inner: NodeId,
        outer: NodeId,
    },
    /// Where the field is negative. The field sees the world position, whatever `from_world` says.
    Sdf {
        field: NodeId,
    },
}

/// One participating medium. Spectra have the width of the bands, or 1 when neutral.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// The scene's name (`fog` for the fog).
    pub name: String,
    /// Where it is declared.
    pub span: Option<Span>,
    /// Where the medium is.
    pub shape: Shape,
    /// Absorption, 1/length, density already multiplied in.
    pub k_a: NodeId,
    /// Scattering, 1/length, density already multiplied in.
    pub k_s: NodeId,
    /// Emission, light/length, density already multiplied in.
    pub k_e: NodeId,
    /// Phase function of [`super::Input::CosTheta`], normalised over the sphere; `None` is isotropic. Spectrum.
    pub phase: Option<NodeId>,
    /// For the projections (`composite`): the data value that is projected (the argument of the transfer function).
    pub data: Option<NodeId>,
    /// For the projections: the transfer function's colour as a function of that value alone, which stands for
    /// [`super::Input::CosTheta`] here (a scalar the engine supplies). Spectrum.
    pub data_color: Option<NodeId>,
}

/// How rays leave the eye.
#[derive(Copy, Clone, Debug, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians, width 1.
    Perspective {
        /// Radians.
        fov: NodeId,
    },
    /// Height of the picture in space, width 1.
    Orthographic {
        /// A length.
        height: NodeId,
    },
    /// Equirectangular, forward in the middle.
    Panorama,
}

/// The camera. Nodes are of tier Frame or lower.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye.
    pub from: NodeId,
    /// What it looks at.
    pub to: NodeId,
    /// Which way is up.
    pub up: NodeId,
    /// How rays leave it.
    pub projection: Projection,
}

/// Anti-aliasing.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "named as in the language")]
pub enum Aa {
    None,
    Analytic,
    Ssaa(u32),
    Msaa(u32),
    Fxaa,
    Smaa,
    Taa,
}

/// Display transform.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "named as in the language")]
pub enum Tonemap {
    None,
    Reinhard,
    Aces,
    Exposure,
}

/// The picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageInfo {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Anti-aliasing.
    pub aa: Aa,
    /// In stops, width 1, tier Frame.
    pub exposure: NodeId,
    /// Display transform.
    pub tonemap: Tonemap,
}

/// Which backend draws.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "named as in the language")]
pub enum Backend {
    Auto,
    Raymarch,
    Slicing,
    Splatting,
}

/// Which orders of scattering count.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "named as in the language")]
pub enum Scattering {
    None,
    Single,
    Multiple,
}

/// What a ray collects.
#[derive(Copy, Clone, Debug, PartialEq)]
pub enum Composite {
    /// The transfer equation.
    Radiance,
    /// Largest value of the data along the ray, through the transfer function's colour.
    Maximum,
    /// Smallest value likewise.
    Minimum,
    /// Mean value likewise.
    Average,
    /// First surface where the data equals this value.
    Isosurface(NodeId),
}

/// Which planes slicing cuts media with.
#[derive(Copy, Clone, Debug, Default, PartialEq, Eq, Hash)]
pub enum Stacks {
    /// Across the view.
    #[default]
    View,
    /// Across the axis of the first medium's box that the view is most nearly along.
    Object,
    /// Across half the angle between the ways of sight and light, so that light is followed from slab to slab.
    HalfAngle,
}

/// Which pixels of a picture are drawn.
#[derive(Copy, Clone, Debug, Default, PartialEq, Eq, Hash)]
pub enum Pixels {
    /// Every one.
    #[default]
    Every,
    /// As many as it takes: the others are filled in from those around them, within what `accuracy` allows.
    Adaptive,
}

/// The schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderInfo {
    /// Which backend draws.
    pub backend: Backend,
    /// Which orders of scattering count.
    pub scattering: Scattering,
    /// What a ray collects.
    pub composite: Composite,
    /// A: every pixel within A · max(W, its radiance).
    pub accuracy: f64,
    /// Overrides of `accuracy`.
    pub steps: Option<u32>,
    /// Overrides of `accuracy`.
    pub slices: Option<u32>,
    /// Which planes they lie between.
    pub stacks: Stacks,
    /// Overrides of `accuracy`.
    pub splats: Option<u32>,
    /// Overrides of `accuracy`.
    pub samples: Option<u32>,
    /// Which pixels are drawn.
    pub pixels: Pixels,
    /// Cap on steps per ray.
    pub max_work: u32,
}

/// Type of a parameter.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
pub enum ParamType {
    /// A truth value, 0 or 1.
    Bool,
    /// 1 to 4 numbers.
    Float(u8),
    /// A colour: three linear components.
    Color,
}

/// A live control.
#[derive(Clone, Debug, PartialEq)]
pub struct Param {
    /// The scene's name.
    pub name: String,
    /// Where it is declared.
    pub span: Option<Span>,
    /// Its documentation.
    pub docs: Option<String>,
    /// Its type.
    pub ty: ParamType,
    /// Exponents of length, time, light and pixel, in this order.
    pub dimension: [f64; 4],
    /// The value it starts with, in SI.
    pub default: Vec<f64>,
    /// Inclusive range in SI.
    pub range: Option<(f64, f64)>,
}

/// A whole scene over one graph.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldScene {
    /// Every field.
    pub graph: Graph,
    /// What lengths are measured in.
    pub units: Units,
    /// The bands of every spectrum: all of the picture's, or a group of them.
    pub bands: Bands,
    /// Live controls, indexed by [`super::ParamId`].
    pub params: Vec<Param>,
    /// Everything that absorbs, scatters or emits, fog included.
    pub media: Vec<Medium>,
    /// Everything that shines on media and surfaces, environments apart.
    pub lights: Vec<Light>,
    /// Opaque surfaces.
    pub surfaces: Vec<Surface>,
    /// Files of triangles, indexed by [`super::MeshId`].
    pub meshes: Vec<MeshInfo>,
    /// 3D Gaussian splats, indexed by [`super::SplatsId`].
    pub splats: Vec<SplatsInfo>,
    /// Radiance behind everything: `image.background`, or the environment as a function of the direction to the sky.
    pub background: NodeId,
    /// Whether the background is an environment, which shines on media and surfaces as well.
    pub environment: bool,
    /// Centre and inner radius of each `shell` that some field asks the altitude of.
    pub shells: Vec<(NodeId, NodeId)>,
    /// The camera.
    pub camera: Camera,
    /// The picture.
    pub image: ImageInfo,
    /// The schedule.
    pub render: RenderInfo,
}

impl FieldScene {
    /// Every node that something outside the graph names, tables' entries apart. Passes keep these alive.
    #[must_use]
    pub fn roots(&self) -> Vec<NodeId> {
        let mut roots = vec![];
        // One list of what is a root: walk a copy without its graph.
        self.with_graph(Graph::default()).map_roots(&mut |id| {
            roots.push(id);
            id
        });
        roots
    }

    /// The same scene over another graph, whose nodes have the same numbers.
    #[must_use]
    pub fn with_graph(&self, graph: Graph) -> Self {
        Self {
            graph,
            units: self.units,
            bands: self.bands.clone(),
            params: self.params.clone(),
            media: self.media.clone(),
            lights: self.lights.clone(),
            surfaces: self.surfaces.clone(),
            meshes: self.meshes.clone(),
            splats: self.splats.clone(),
            background: self.background,
            environment: self.environment,
            shells: self.shells.clone(),
            camera: self.camera,
            image: self.image.clone(),
            render: self.render.clone(),
        }
    }

    /// Whether two scenes differ in their wavelengths at most, and in nothing that is made of them.
    #[must_use]
    pub fn is_same_but_for_bands(&self, other: &mut Self) -> bool {
        let own = std::mem::replace(&mut other.bands, self.bands.clone());
        // The light of splats is in their files.
        let same = self.splats.is_empty() && self == other;
        other.bands = own;
        same
    }

    /// The params' defaults in the graph's units.
    #[must_use]
    pub fn defaults(&self) -> Vec<Vec<f64>> {
        let scaled = |p: &Param| {
            let factor = self.units.scale(p.dimension[0]);
            p.default.iter().map(|v| v * factor).collect()
        };
        self.params.iter().map(scaled).collect()
    }

    /// Rewrites every node that something outside the graph names.
    pub fn map_roots(&mut self, map: &mut dyn FnMut(NodeId) -> NodeId) {
        for medium in &mut self.media {
            medium.shape.map_nodes(map);
            for node in [&mut medium.k_a, &mut medium.k_s, &mut medium.k_e] {
                *node = map(*node);
            }
            for node in [&mut medium.phase, &mut medium.data, &mut medium.data_color].into_iter().flatten() {
                *node = map(*node);
            }
        }
        for light in &mut self.lights {
            light.kind.map_nodes(map);
        }
        for surface in &mut self.surfaces {
            surface.shape.map_nodes(map);
            surface.albedo = map(surface.albedo);
        }
        self.splats.iter_mut().for_each(|s| s.map_nodes(map));
        self.background = map(self.background);
        for (center, inner) in &mut self.shells {
            *center = map(*center);
            *inner = map(*inner);
        }
        let camera = &mut self.camera;
        for node in [&mut camera.from, &mut camera.to, &mut camera.up] {
            *node = map(*node);
        }
        match &mut camera.projection {
            Projection::Perspective { fov: node } | Projection::Orthographic { height: node } => *node = map(*node),
            Projection::Panorama => {}
        }
        self.image.exposure = map(self.image.exposure);
        match &mut self.render.composite {
            Composite::Isosurface(node) => *node = map(*node),
            Composite::Radiance | Composite::Maximum | Composite::Minimum | Composite::Average => {}
        }
    }
}

impl Shape {
    /// Every primitive in it, left to right.
    pub fn primitives<'a>(&'a self, out: &mut Vec<&'a Primitive>) {
        match self {
            Self::Everywhere => {}
            Self::Primitive(p) => out.push(p),
            Self::Union(parts) | Self::Intersection(parts) => parts.iter().for_each(|s| s.primitives(out)),
            Self::Difference(first, rest) => {
                first.primitives(out);
                rest.iter().for_each(|s| s.primitives(out));
            }
        }
    }

    /// Rewrites every node it names.
    pub fn map_nodes(&mut self, map: &mut dyn FnMut(NodeId) -> NodeId) {
        match self {
            Self::Everywhere => {}
            Self::Primitive(p) => p.map_nodes(map),
            Self::Union(parts) | Self::Intersection(parts) => parts.iter_mut().for_each(|s| s.map_nodes(map)),
            Self::Difference(first, rest) => {
                first.map_nodes(map);
                rest.iter_mut().for_each(|s| s.map_nodes(map));
            }
        }
    }
}

impl Primitive {
    /// Rewrites every node it names.
    pub fn map_nodes(&mut self, map: &mut dyn FnMut(NodeId) -> NodeId) {
        if let Some(affine) = &mut self.from_world {
            affine.map_nodes(map);
        }
        let nodes: Vec<&mut NodeId> = match &mut self.kind {
            PrimitiveKind::Sphere { center, radius } => vec![center, radius],
            PrimitiveKind::Ellipsoid { center, radii } => vec![center, radii],
            PrimitiveKind::Box { min, max } => vec![min, max],
            PrimitiveKind::Slab { axis, from, to } => vec![axis, from, to],
            PrimitiveKind::Cylinder { from, to, radius } => vec![from, to, radius],
            PrimitiveKind::Shell { center, inner, outer } => vec![center, inner, outer],
            PrimitiveKind::Sdf { field } => vec![field],
        };
        for node in nodes {
            *node = map(*node);
        }
    }
}

impl ParamType {
    /// Type of the parameter's node.
    #[must_use]
    pub fn node_type(self) -> Type {
        match self {
            Self::Bool => Type::Bool,
            Self::Float(w) => Type::Float(w),
            Self::Color => Type::VEC3,
        }
    }
}
