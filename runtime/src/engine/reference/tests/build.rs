//! Small scenes over one graph.

use super::super::{Options, RayResult, Reference};
use compiler::ir::eval::Voxels;
use compiler::ir::{
    Aa, Backend, Bands, BandsKind, Binary, Camera, Composite, FieldScene, Filter, Graph, GridId, GridInfo, ImageInfo,
    Input, Light, LightKind, Medium, MeshInfo, NodeId, Op, Primitive, PrimitiveKind, Projection, RenderInfo,
    Scattering, Shape, Surface, SurfaceShape, Tonemap, Unary, Units,
};
use compiler::loader::{GridHeader, Scalar};

/// A grid's numbers.
pub(super) struct Values {
    pub(super) dims: [u32; 3],
    pub(super) data: Vec<f64>,
}

impl Voxels for Values {
    fn voxel(&self, _grid: GridId, [i, j, k]: [u32; 3]) -> f64 {
        self.data[(i + self.dims[0] * (j + self.dims[1] * k)) as usize]
    }
}

/// A graph on its way to a scene.
#[derive(Default)]
pub(super) struct Build {
    pub(super) g: Graph,
    pub(super) media: Vec<Medium>,
    pub(super) bands: usize,
    pub(super) shells: Vec<(NodeId, NodeId)>,
    pub(super) composite: Option<Composite>,
    pub(super) lights: Vec<Light>,
    pub(super) surfaces: Vec<Surface>,
    pub(super) meshes: Vec<MeshInfo>,
    pub(super) environment: bool,
    pub(super) scattering: Option<Scattering>,
}

impl Build {
    pub(super) fn c(&mut self, x: f64) -> NodeId {
        self.g.scalar(x)
    }

    pub(super) fn p(&mut self) -> NodeId {
        self.g.input(Input::Position)
    }

    pub(super) fn axis(&mut self, i: u8) -> NodeId {
        let p = self.p();
        self.g.extract(p, i)
    }

    /// `a·x + b` of one coordinate.
    pub(super) fn linear(&mut self, axis: u8, a: f64, b: f64) -> NodeId {
        let (x, a, b) = (self.axis(axis), self.c(a), self.c(b));
        let ax = self.g.mul(a, x);
        self.g.add(ax, b)
    }

    pub(super) fn exp(&mut self, a: NodeId) -> NodeId {
        self.g.unary(Unary::Exp, a)
    }

    pub(super) fn times(&mut self, a: f64, b: NodeId) -> NodeId {
        let a = self.c(a);
        self.g.mul(a, b)
    }

    /// Squared length of `p − q`.
    pub(super) fn square(&mut self, q: [f64; 3]) -> NodeId {
        let p = self.p();
        let q = self.g.vector(&q);
        let d = self.g.sub(p, q);
        self.g.dot(d, d)
    }

    pub(super) fn max(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.g.binary(Binary::Max, a, b)
    }

    pub(super) fn sphere(&mut self, center: [f64; 3], radius: f64) -> Shape {
        let (center, radius) = (self.g.vector(&center), self.c(radius));
        primitive(PrimitiveKind::Sphere { center, radius })
    }

    pub(super) fn slab(&mut self, axis: [f64; 3], from: f64, to: f64) -> Shape {
        let (axis, from, to) = (self.g.vector(&axis), self.c(from), self.c(to));
        primitive(PrimitiveKind::Slab { axis, from, to })
    }

    pub(super) fn cube(&mut self, min: [f64; 3], max: [f64; 3]) -> Shape {
        let (min, max) = (self.g.vector(&min), self.g.vector(&max));
        primitive(PrimitiveKind::Box { min, max })
    }

    /// A grid whose voxel (0,0,0) is centred at `origin`, and the node that samples it at the position.
    pub(super) fn grid(&mut self, dims: [u32; 3], spacing: [f64; 3], origin: [f64; 3], filter: Filter) -> NodeId {
        let header = GridHeader {
            dims,
            scalar: Scalar::F64,
            slope: 1.0,
            intercept: 0.0,
            world_from_index: [
                [spacing[0], 0.0, 0.0, origin[0]],
                [0.0, spacing[1], 0.0, origin[1]],
                [0.0, 0.0, spacing[2], origin[2]],
            ],
        };
        self.g.grids.push(GridInfo {
            name: "grid".into(),
            span: None,
            path: String::new(),
            from: String::new(),
            header,
            filter,
            outside: 0.0,
        });
        let grid = GridId(self.g.grids.len() as u32 - 1);
        let parts: Vec<NodeId> =
            (0..3).map(|i| self.linear(i as u8, 1.0 / spacing[i], -origin[i] / spacing[i])).collect();
        let at = self.g.compose(&parts);
        self.g.push(Op::Sample { grid, at })
    }

    pub(super) fn medium(&mut self, shape: Shape, k_a: NodeId, k_e: NodeId) {
        let zero = self.c(0.0);
        self.media.push(Medium {
            name: format!("m{}", self.media.len()),
            span: None,
            shape,
            k_a,
            k_s: zero,
            k_e,
            phase: None,
            data: None,
            data_color: None,
        });
    }

    /// Uniform.
    pub(super) fn plain(&mut self, shape: Shape, k_a: f64, k_e: f64) {
        let (k_a, k_e) = (self.c(k_a), self.c(k_e));
        self.medium(shape, k_a, k_e);
    }

    /// A medium that scatters, with coefficients as nodes.
    pub(super) fn scattering(&mut self, shape: Shape, k_a: NodeId, k_s: NodeId, phase: Option<NodeId>) {
        let zero = self.c(0.0);
        self.medium(shape, k_a, zero);
        let medium = self.media.last_mut().unwrap();
        (medium.k_s, medium.phase) = (k_s, phase);
    }

    /// The same, uniform.
    pub(super) fn milk(&mut self, shape: Shape, k_a: f64, k_s: f64, phase: Option<NodeId>) {
        let (k_a, k_s) = (self.c(k_a), self.c(k_s));
        self.scattering(shape, k_a, k_s, phase);
    }

    /// (1 − g²)/(4π·(1 + g² − 2g·cosine)^1.5)
    pub(super) fn hg(&mut self, g: f64) -> NodeId {
        let cosine = self.g.input(Input::CosTheta);
        let x = self.times(-2.0 * g, cosine);
        let one = self.c(1.0 + g * g);
        let x = self.g.add(x, one);
        let power = self.c(1.5);
        let below = self.g.binary(Binary::Pow, x, power);
        let above = self.c((1.0 - g * g) / (4.0 * std::f64::consts::PI));
        self.g.div(above, below)
    }

    fn light(&mut self, kind: LightKind) {
        self.lights.push(Light { name: format!("l{}", self.lights.len()), span: None, kind });
    }

    /// Parallel light that travels along a direction, or a disc of some angular diameter.
    pub(super) fn sun(&mut self, direction: [f64; 3], irradiance: f64, diameter: Option<f64>) {
        let direction = self.g.vector(&crate::frame::vector::normalize(direction).unwrap());
        let irradiance = self.c(irradiance);
        let angular_diameter = diameter.map(|d| self.c(d));
        self.light(LightKind::Directional { direction, irradiance, angular_diameter });
    }

    pub(super) fn lamp(&mut self, at: [f64; 3], intensity: f64, radius: Option<f64>) {
        let (position, intensity) = (self.g.vector(&at), self.c(intensity));
        let radius = radius.map(|r| self.c(r));
        self.light(LightKind::Point { position, intensity, radius });
    }

    pub(super) fn surface(&mut self, shape: SurfaceShape, albedo: f64) {
        let albedo = self.c(albedo);
        self.surfaces.push(Surface { name: format!("s{}", self.surfaces.len()), span: None, shape, albedo });
    }

    pub(super) fn plane(&mut self, point: [f64; 3], normal: [f64; 3], albedo: f64) {
        let normal = crate::frame::vector::normalize(normal).unwrap();
        let (point, normal) = (self.g.vector(&point), self.g.vector(&normal));
        self.surface(SurfaceShape::Plane { point, normal }, albedo);
    }

    pub(super) fn disc(&mut self, center: [f64; 3], normal: [f64; 3], radius: f64, albedo: f64) {
        let (center, normal, radius) = (self.g.vector(&center), self.g.vector(&normal), self.c(radius));
        self.surface(SurfaceShape::Disc { center, normal, radius }, albedo);
    }

    pub(super) fn scene(mut self, background: f64) -> FieldScene {
        let background = self.c(background);
        let zero = self.c(0.0);
        let (from, to, up) =
            (self.g.vector(&[0.0, 0.0, -4.0]), self.g.vector(&[0.0; 3]), self.g.vector(&[0.0, 1.0, 0.0]));
        let fov = self.c(0.7);
        FieldScene {
            lights: self.lights,
            surfaces: self.surfaces,
            meshes: self.meshes,
            splats: vec![],
            environment: self.environment,
            graph: self.g,
            units: Units::METRE,
            bands: Bands { kind: BandsKind::Gray, wavelengths: vec![550e-9; self.bands.max(1)] },
            params: vec![],
            media: self.media,
            background,
            shells: self.shells,
            camera: Camera { from, to, up, projection: Projection::Perspective { fov } },
            image: ImageInfo { size: [16, 12], aa: Aa::None, exposure: zero, tonemap: Tonemap::None },
            render: RenderInfo {
                backend: Backend::Auto,
                scattering: self.scattering.unwrap_or(Scattering::None),
                composite: self.composite.unwrap_or(Composite::Radiance),
                accuracy: 1e-2,
                steps: None,
                slices: None,
                stacks: compiler::ir::Stacks::View,
                pixels: compiler::ir::Pixels::Every,
                splats: None,
                samples: None,
                max_work: 65536,
            },
        }
    }
}

pub(super) fn primitive(kind: PrimitiveKind) -> Shape {
    Shape::Primitive(Primitive { kind, from_world: None, span: None })
}

pub(super) fn trace_in<V: Voxels>(scene: &FieldScene, voxels: &V, o: [f64; 3], d: [f64; 3]) -> RayResult {
    let reference = Reference::new(scene, &[], 0.0, voxels).unwrap();
    let result = reference.trace(o, d, &Options::default()).unwrap();
    assert!(result.complete);
    result
}

pub(super) fn trace(scene: &FieldScene, o: [f64; 3], d: [f64; 3]) -> RayResult {
    trace_in(scene, &compiler::ir::eval::NoVoxels, o, d)
}

/// Along +z from (0, 0, −4).
pub(super) fn ahead(scene: &FieldScene) -> RayResult {
    trace(scene, [0.0, 0.0, -4.0], [0.0, 0.0, 1.0])
}

/// Radiance and depth of one band are within 1e-9 and within their own errors, which are of use.
#[track_caller]
pub(super) fn expect(result: &RayResult, radiance: f64, tau: f64) {
    close(result, radiance, tau, 1e-9);
}

#[track_caller]
pub(super) fn close(result: &RayResult, radiance: f64, tau: f64, rtol: f64) {
    let (l, t) = (result.radiance[0], result.optical_depth[0]);
    let wrong = (l - radiance).abs();
    assert!(wrong <= rtol * radiance.abs(), "radiance {l:e}, not {radiance:e}: {:e}", wrong / radiance);
    assert!(wrong <= result.error[0] + 1e-13 * radiance.abs(), "error {wrong:e} beyond {:e}", result.error[0]);
    assert!(result.error[0] <= 1e-8 * l.abs() + 1e-300, "useless error {:e} of {l:e}", result.error[0]);
    if tau.is_infinite() {
        assert_eq!(t, tau);
    } else {
        let wrong = (t - tau).abs();
        assert!(wrong <= rtol * tau, "depth {t:e}, not {tau:e}: {:e}", wrong / tau);
        assert!(wrong <= result.error_tau[0] + 1e-13 * tau, "error {wrong:e} beyond {:e}", result.error_tau[0]);
    }
    assert_eq!(result.transmittance[0], (-t).exp());
}
