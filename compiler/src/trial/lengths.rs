//! A scene of another size: every number with a length in its dimension is multiplied by a power of the factor.

use crate::check::hir::{Builtin, Camera, Composite, Dim, Expr, ExprKind, Input, Light, LightKind, Medium, Projection};
use crate::check::hir::{Scene, Surface, SurfaceShape, TableRows, Type};
use crate::syntax::ast::BinaryOp;

/// Makes all lengths of a checked scene `factor` times as large. Wavelengths of the bands stay; where the scene reads them they
/// are multiplied, and where spheres are compared with them the spheres are divided.
pub(crate) fn stretch(scene: &mut Scene, factor: f64) {
    let s = Stretch(factor);
    for param in &mut scene.params {
        let by = factor.powf(param.dimension[0]);
        param.default.iter_mut().for_each(|v| *v *= by);
        if let Some((low, high)) = &mut param.range {
            *low *= by;
            *high *= by;
        }
    }
    scene.constants.iter_mut().for_each(|(_, e)| s.expr(e));
    scene.functions.iter_mut().for_each(|f| s.expr(&mut f.body));
    for table in &mut scene.tables {
        match &mut table.rows {
            TableRows::Values(rows) => rows.iter_mut().for_each(|(k, v)| [k, v].into_iter().for_each(|e| s.expr(e))),
            TableRows::Layers(rows) => {
                rows.iter_mut().for_each(|(k, c, v)| [k, c, v].into_iter().for_each(|e| s.expr(e)));
            }
        }
    }
    scene.media.iter_mut().for_each(|m| s.medium(m));
    scene.lights.iter_mut().for_each(|l| s.light(l));
    scene.surfaces.iter_mut().for_each(|surface| s.surface(surface));
    scene.splats.iter_mut().for_each(|splats| s.maybe([&mut splats.transform]));
    s.camera(&mut scene.camera);
    s.maybe([&mut scene.image.exposure, &mut scene.image.background]);
    match &mut scene.render.composite {
        Composite::Isosurface(value) => s.expr(value),
        Composite::Radiance | Composite::Maximum | Composite::Minimum | Composite::Average => {}
    }
}

struct Stretch(f64);

impl Stretch {
    fn maybe<const N: usize>(&self, list: [&mut Option<Expr>; N]) {
        list.into_iter().flatten().for_each(|e| self.expr(e));
    }

    fn medium(&self, medium: &mut Medium) {
        let Medium { name: _, span: _, shape, transform, density, k_a, k_s, k_e, phase, transfer } = medium;
        self.maybe([shape, transform, density, k_a, k_s, k_e, phase, transfer]);
    }

    fn light(&self, light: &mut Light) {
        match &mut light.kind {
            LightKind::Directional { direction, irradiance, angular_diameter } => {
                [direction, irradiance].into_iter().for_each(|e| self.expr(e));
                self.maybe([angular_diameter]);
            }
            LightKind::Point { position, intensity, radius } => {
                [position, &mut *intensity].into_iter().for_each(|e| self.expr(e));
                self.maybe([radius]);
                // Light alone is meant per square metre.
                if dim(&intensity.ty).is_some_and(|d| d.length == 0) {
                    self.times(intensity, 2);
                }
            }
            LightKind::Environment { radiance } => self.expr(radiance),
        }
    }

    fn surface(&self, surface: &mut Surface) {
        match &mut surface.shape {
            SurfaceShape::Plane { point, normal } => [point, normal].into_iter().for_each(|e| self.expr(e)),
            SurfaceShape::Disc { center, normal, radius } => {
                [center, normal, radius].into_iter().for_each(|e| self.expr(e));
            }
            SurfaceShape::Boundary(shape) => self.expr(shape),
            SurfaceShape::Mesh { path: _, from: _, header: _ } => {}
        }
        self.maybe([&mut surface.albedo]);
    }

    fn camera(&self, camera: &mut Camera) {
        self.maybe([&mut camera.from, &mut camera.to, &mut camera.up]);
        match &mut camera.projection {
            Projection::Perspective(fov) => self.maybe([fov]),
            Projection::Orthographic(height) => self.expr(height),
            Projection::Panorama => {}
        }
    }

    /// Multiplies an expression by a power of the factor; its type stays.
    fn times(&self, expr: &mut Expr, exponent: i32) {
        let number = |value| Expr { kind: ExprKind::Number(value), ty: Type::Number(Dim::default()), span: expr.span };
        let by = number(self.0.powi(exponent));
        let own = std::mem::replace(expr, number(0.0));
        let (ty, span) = (own.ty.clone(), own.span);
        *expr = Expr { kind: ExprKind::Binary(BinaryOp::Multiply, Box::new(own), Box::new(by)), ty, span };
    }

    fn expr(&self, expr: &mut Expr) {
        match &mut expr.kind {
            ExprKind::Number(value) => {
                if let Some(dim) = dim(&expr.ty).filter(|d| d.length != 0) {
                    *value *= self.0.powf(f64::from(dim.length) / 12.0);
                }
            }
            ExprKind::Input(Input::Lambda) => self.times(expr, 1),
            ExprKind::Input(Input::Position | Input::Direction | Input::Time | Input::Altitude | Input::CosTheta)
            | ExprKind::Color(_)
            | ExprKind::Bool(_)
            | ExprKind::String(_)
            | ExprKind::Param(_)
            | ExprKind::Const(_)
            | ExprKind::Local(_)
            | ExprKind::Grid(_)
            | ExprKind::Splats(_) => {}
            ExprKind::Vector(list) | ExprKind::Call(_, list) => list.iter_mut().for_each(|e| self.expr(e)),
            ExprKind::Builtin(builtin, list) => {
                list.iter_mut().for_each(|e| self.expr(e));
                // Every other builtin maps lengths to lengths.
                let areas = [Builtin::MieScattering, Builtin::MieAbsorption, Builtin::MieExtinction];
                let area = areas.contains(builtin);
                if area || *builtin == Builtin::Mie {
                    list.iter_mut().take(1).for_each(|radius| self.times(radius, -1));
                }
                if area {
                    self.times(expr, 2);
                }
            }
            ExprKind::Negate(a)
            | ExprKind::Not(a)
            | ExprKind::Lookup(_, a)
            | ExprKind::Sample(_, a)
            | ExprKind::Swizzle(a, _)
            | ExprKind::LayerColor(a)
            | ExprKind::LayerK(a) => self.expr(a),
            ExprKind::Binary(_, a, b) => [a, b].into_iter().for_each(|e| self.expr(e)),
            ExprKind::If(a, b, c) => [a, b, c].into_iter().for_each(|e| self.expr(e)),
            ExprKind::Let(bound, value) => {
                bound.iter_mut().for_each(|(_, _, e)| self.expr(e));
                self.expr(value);
            }
            ExprKind::Reduce { fold: _, variable: _, name: _, start, end, body } => {
                [start, end, body].into_iter().for_each(|e| self.expr(e));
            }
        }
    }
}

fn dim(ty: &Type) -> Option<Dim> {
    match ty {
        Type::Number(d) | Type::Vec2(d) | Type::Vec3(d) | Type::Spectrum(d) => Some(*d),
        Type::Color | Type::Bool | Type::String | Type::Layer | Type::Grid | Type::Shape | Type::Transform => None,
    }
}
