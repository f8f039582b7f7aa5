//! Lights and surfaces.

use super::{Lowered, Lowerer, Reported};
use crate::check::hir;
use crate::diagnostic::Diagnostic;
use crate::ir::{
    Light, LightKind, MeshId, MeshInfo, NodeId, Primitive, PrimitiveKind, Shape, Surface, SurfaceShape, Tier,
};

/// What a surface reflects when it does not say.
const ALBEDO: f64 = 0.5;

impl<'s> Lowerer<'s, '_> {
    /// The lights, and the sum of the environments among them.
    pub(super) fn lights(&mut self) -> (Vec<Light>, Lowered<Option<NodeId>>) {
        let scene = self.scene;
        let mut lights = vec![];
        let mut sky: Lowered<Option<NodeId>> = Ok(None);
        for light in &scene.lights {
            self.fresh();
            if let hir::LightKind::Environment { radiance } = &light.kind {
                sky = self.environment(light, radiance, sky);
            } else if let Ok(kind) = self.light(light) {
                lights.push(Light { name: light.name.clone(), span: Some(light.span), kind });
            }
        }
        (lights, sky)
    }

    fn environment(
        &mut self,
        light: &'s hir::Light,
        radiance: &'s hir::Expr,
        sky: Lowered<Option<NodeId>>,
    ) -> Lowered<Option<NodeId>> {
        let node = self.spectrum(radiance)?;
        self.name(node, &format!("{}.environment", light.name));
        self.limits.push((node, radiance.span, "an environment", Tier::Ray));
        Ok(Some(match sky? {
            None => node,
            Some(other) => self.graph.add(other, node),
        }))
    }

    fn light(&mut self, light: &'s hir::Light) -> Lowered<LightKind> {
        const WHAT: &str = "a light";
        let mut get = |expr: &'s hir::Expr, part: &str, spectrum: bool| -> Lowered<NodeId> {
            let node = if spectrum { self.spectrum(expr)? } else { self.node(expr)? };
            self.name(node, &format!("{}.{part}", light.name));
            self.per_frame(node, expr.span, WHAT);
            Ok(node)
        };
        match &light.kind {
            hir::LightKind::Directional { direction, irradiance, angular_diameter } => {
                let to = get(direction, "direction", false)?;
                let irradiance = get(irradiance, "irradiance", true)?;
                let disc = angular_diameter.as_ref().map(|a| get(a, "angular_diameter", false)).transpose()?;
                let to = self.three(to, direction.span)?;
                self.nonzero.push((to, direction.span, "the direction of a light"));
                let to = self.normalize(to);
                // A disc without width is a point.
                let disc = match disc {
                    Some(node) if self.number(node) == Some(0.0) => None,
                    other => other,
                };
                Ok(LightKind::Directional { direction: self.folded(to), irradiance, angular_diameter: disc })
            }
            hir::LightKind::Point { position, intensity, radius } => {
                let at = get(position, "position", false)?;
                let intensity = get(intensity, "intensity", true)?;
                let radius = radius.as_ref().map(|r| get(r, "radius", false)).transpose()?;
                Ok(LightKind::Point { position: self.three(at, position.span)?, intensity, radius })
            }
            hir::LightKind::Environment { radiance } => {
                self.broken_promise(radiance.span, "an environment is no light here")
            }
        }
    }

    /// The surfaces, and the files of triangles they name.
    pub(super) fn surfaces(&mut self) -> (Vec<Surface>, Vec<MeshInfo>) {
        let scene = self.scene;
        let (mut surfaces, mut meshes) = (vec![], vec![]);
        for surface in &scene.surfaces {
            if let Ok(surface) = self.surface(surface, &mut meshes) {
                surfaces.push(surface);
            }
        }
        (surfaces, meshes)
    }

    fn surface(&mut self, surface: &'s hir::Surface, meshes: &mut Vec<MeshInfo>) -> Lowered<Surface> {
        self.fresh();
        let shape = self.surface_shape(surface, meshes);
        self.fresh();
        let albedo = match &surface.albedo {
            Some(albedo) => self.spectrum(albedo)?,
            None => self.graph.scalar(ALBEDO),
        };
        self.name(albedo, &format!("{}.albedo", surface.name));
        Ok(Surface { name: surface.name.clone(), span: Some(surface.span), shape: shape?, albedo })
    }

    fn surface_shape(&mut self, surface: &'s hir::Surface, meshes: &mut Vec<MeshInfo>) -> Lowered<SurfaceShape> {
        let mut get = |expr: &'s hir::Expr, part: &str| -> Lowered<NodeId> {
            let node = self.node(expr)?;
            self.name(node, &format!("{}.{part}", surface.name));
            self.per_frame(node, expr.span, "a surface");
            Ok(node)
        };
        Ok(match &surface.shape {
            hir::SurfaceShape::Plane { point, normal } => {
                let (at, up) = (get(point, "point")?, get(normal, "normal")?);
                SurfaceShape::Plane { point: self.three(at, point.span)?, normal: self.unit(up, normal)? }
            }
            hir::SurfaceShape::Disc { center, normal, radius } => {
                let (at, up, radius) = (get(center, "center")?, get(normal, "normal")?, get(radius, "radius")?);
                SurfaceShape::Disc { center: self.three(at, center.span)?, normal: self.unit(up, normal)?, radius }
            }
            hir::SurfaceShape::Boundary(shape) => {
                let lowered = self.as_shape(shape)?;
                if self.is_endless(&lowered) {
                    return self.report(
                        Diagnostic::error("E0523", format!("the surface `{}` has no boundary", surface.name))
                            .at(shape.span, "this is everywhere")
                            .hint("a surface is the boundary of its shape: try `plane`, `disc`, `sphere` or `box`"),
                    );
                }
                SurfaceShape::Boundary(lowered)
            }
            hir::SurfaceShape::Mesh { path, from, header } => {
                let known = meshes.iter().position(|m| m.path == *path && m.from == *from);
                let id = known.unwrap_or_else(|| {
                    let (path, from) = (path.clone(), from.clone());
                    meshes.push(MeshInfo { path, from, span: Some(surface.span), header: *header });
                    meshes.len() - 1
                });
                SurfaceShape::Mesh(MeshId(id as u32))
            }
        })
    }

    fn unit(&mut self, node: NodeId, expr: &hir::Expr) -> Lowered<NodeId> {
        let node = self.three(node, expr.span)?;
        self.nonzero.push((node, expr.span, "the normal of a surface"));
        let unit = self.normalize(node);
        Ok(self.folded(unit))
    }

    fn is_endless(&self, shape: &Shape) -> bool {
        match shape {
            Shape::Everywhere => true,
            Shape::Primitive(_) | Shape::Difference(..) => false,
            Shape::Union(parts) => parts.iter().any(|s| self.is_endless(s)),
            Shape::Intersection(parts) => parts.iter().all(|s| self.is_endless(s)),
        }
    }

    /// What a surface adds to the size of the scene, if it is bounded.
    pub(super) fn surface_extent(&mut self, surface: &'s hir::Surface) -> Option<Shape> {
        self.fresh();
        let mut meshes = vec![];
        let lowered: Result<SurfaceShape, Reported> = self.surface_shape(surface, &mut meshes);
        let surface = Surface { name: String::new(), span: None, shape: lowered.ok()?, albedo: self.graph.scalar(0.0) };
        self.with_surfaces(vec![], &[surface], &meshes).pop()
    }

    /// The shapes of media together with bounded surfaces: what a camera that is not told otherwise frames.
    pub(super) fn with_surfaces(
        &mut self,
        mut shapes: Vec<Shape>,
        surfaces: &[Surface],
        meshes: &[MeshInfo],
    ) -> Vec<Shape> {
        let scale = self.units.scale(1.0);
        for surface in surfaces {
            let kind = match &surface.shape {
                SurfaceShape::Plane { .. } => continue,
                SurfaceShape::Disc { center, radius, .. } => PrimitiveKind::Sphere { center: *center, radius: *radius },
                SurfaceShape::Boundary(shape) => {
                    shapes.push(shape.clone());
                    continue;
                }
                SurfaceShape::Mesh(id) => {
                    let (min, max) = meshes[id.0 as usize].header.bounds;
                    let (min, max) = (min.map(|x| x * scale), max.map(|x| x * scale));
                    PrimitiveKind::Box { min: self.graph.vector(&min), max: self.graph.vector(&max) }
                }
            };
            shapes.push(Shape::Primitive(Primitive { kind, from_world: None, span: None }));
        }
        shapes
    }
}
