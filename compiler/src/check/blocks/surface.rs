//! `surface`.

use crate::check::Checker;
use crate::check::call::Callee;
use crate::check::coerce::Role;
use crate::check::hir::{Dim, Expr, Surface, SurfaceShape};
use crate::check::scope::{Inputs, Scope};
use crate::check::types::Ty;
use crate::diagnostic::Diagnostic;
use crate::resolve::ModuleId;
use crate::syntax::ast::{self, Argument, Block, ExprKind, Property};

impl Checker<'_> {
    pub(super) fn surface(&mut self, item: &ast::Item, block: &Block) -> Option<Surface> {
        let mut properties = self.properties(block, &["shape", "albedo"]);
        let name = block.name.as_ref().map_or("", |n| n.text.as_str());
        let span = block.name.as_ref().map_or(item.span, |n| n.span);
        let albedo = match properties.take("albedo") {
            None => Some(None),
            Some(p) => {
                let mut scope =
                    self.live_scope(ModuleId::SCENE, "surface", "albedo", Inputs::BANDS.and(Inputs::POSITION));
                let value = self.expression(&p.value, &mut scope);
                self.checked_albedo(value).map(Some)
            }
        };
        let Some(shape) = properties.take("shape") else {
            self.missing_property(block, "shape", "shape = plane(point: (0,0,0) m, normal: (0,1,0))");
            return None;
        };
        let shape = self.surface_shape(shape)?;
        Some(Surface { name: name.to_owned(), span, shape, albedo: albedo? })
    }

    fn surface_shape(&mut self, property: &Property) -> Option<SurfaceShape> {
        let mut scope = self.live_scope(ModuleId::SCENE, "surface", "shape", Inputs::FRAME);
        if let ExprKind::Call { function, arguments } = &property.value.kind
            && self.modules.own_name(ModuleId::SCENE, &function.text).is_none()
        {
            match function.text.as_str() {
                "plane" => {
                    let shown = "plane(point: vec3<length>, normal: vec3)";
                    let types = [("point", Ty::vec3(Dim::LENGTH)), ("normal", Ty::vec3(Dim::NONE))];
                    let [point, normal] = self.form(property, "plane", shown, &types, arguments, &mut scope)?;
                    self.refuse_zero(&normal, "`normal` of `plane`", "it points nowhere").then_some(())?;
                    return Some(SurfaceShape::Plane { point, normal });
                }
                "disc" => {
                    let shown = "disc(center: vec3<length>, normal: vec3, radius: length)";
                    let types = [
                        ("center", Ty::vec3(Dim::LENGTH)),
                        ("normal", Ty::vec3(Dim::NONE)),
                        ("radius", Ty::scalar(Dim::LENGTH)),
                    ];
                    let [center, normal, radius] = self.form(property, "disc", shown, &types, arguments, &mut scope)?;
                    self.refuse_zero(&normal, "`normal` of `disc`", "it points nowhere").then_some(())?;
                    if self.known_scalar(&radius).is_some_and(|r| r <= 0.0) {
                        let message = "`radius` of `disc` must be above zero";
                        self.report(Diagnostic::error("E0413", message).at(radius.span, "nothing would be inside"));
                        return None;
                    }
                    return Some(SurfaceShape::Disc { center, normal, radius });
                }
                "mesh" => return self.mesh(property, arguments),
                _ => {}
            }
        }
        let shape = self.live_in(&property.value, Ty::Shape, "shape", &mut scope)?;
        self.validate_shape(&shape);
        Some(SurfaceShape::Boundary(shape))
    }

    /// The arguments of a form that only one property knows.
    pub(super) fn form<const N: usize>(
        &mut self,
        property: &Property,
        name: &str,
        shown: &str,
        types: &[(&str, Ty); N],
        arguments: &[Argument],
        scope: &mut Scope,
    ) -> Option<[Expr; N]> {
        let callee = Callee { name, shown };
        let names: Vec<&str> = types.iter().map(|(n, _)| *n).collect();
        let order: Vec<usize> = (0..N).collect();
        let bound = self.bind_arguments(callee, &names, &order, arguments)?;
        let missing: Vec<&str> = names.iter().zip(&bound).filter(|(_, b)| b.is_none()).map(|(n, _)| *n).collect();
        if !missing.is_empty() {
            self.missing_argument(callee, &missing, property.value.span);
            return None;
        }
        let mut values = vec![];
        for ((parameter, ty), given) in types.iter().zip(bound) {
            let value = self.expect(given?, *ty, Role::Argument { function: name, parameter }, scope);
            values.push(self.finished(value, parameter));
        }
        let values: Option<Vec<Expr>> = values.into_iter().collect();
        <[Expr; N]>::try_from(values?).ok()
    }

    fn mesh(&mut self, property: &Property, arguments: &[Argument]) -> Option<SurfaceShape> {
        let callee = Callee { name: "mesh", shown: "mesh(file: string)" };
        let bound = self.bind_arguments(callee, &["file"], &[0], arguments)?;
        let Some(Some(file)) = bound.first() else {
            self.missing_argument(callee, &["file"], property.value.span);
            return None;
        };
        if let ExprKind::String(path) = &file.kind {
            let from = self.modules.module(ModuleId::SCENE).name.clone();
            let header = self.loader.mesh(&from, path);
            let header = self.header(header, file.span)?;
            return Some(SurfaceShape::Mesh { path: path.clone(), from, header });
        }
        let mut scope = self.fixed_scope(ModuleId::SCENE, "surface", "shape");
        let value = self.expression(file, &mut scope);
        let value = self.coerce(value, Ty::String, Role::Argument { function: "mesh", parameter: "file" });
        if !value.ty.is_error() {
            self.report(
                Diagnostic::error("E0320", "the file of a mesh is written in quotes")
                    .at(file.span, "not a text in quotes"),
            );
        }
        None
    }
}
