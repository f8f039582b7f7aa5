//! Opaque surfaces: the function `nearest(origin, direction, start, limit)` gives the first hit of a ray.
//!
//! A flat sheet is one division. The boundary of a region is where being inside it changes along the ray, walked from one
//! boundary of its primitives to the next. Triangles are found through a hierarchy of boxes in depth-first order, in which
//! every node names the one to go on with when it is missed, so that no stack is needed (Smits 1998).

use super::shapes::{Boundaries, FAR, Ray, Region, primitive_span, region, sdf_functions, transformed};
use super::trace::Tracer;
use crate::fields::{Code, Writer};
use crate::ir::{FieldScene, Input, MeshId, NodeId, Primitive, PrimitiveKind, SurfaceShape, derive};
use crate::passes::is_zero;
use crate::program::Ledger;
use crate::program::kernel::{BinaryOp, Expr, FunctionId, LocalId, Math, Prim, Ty};

/// One surface.
pub(super) struct Sheet {
    pub(super) name: String,
    pub(super) form: Form,
    /// `None` is black.
    pub(super) albedo: Option<NodeId>,
}

/// What it is made of.
pub(super) enum Form {
    Plane { point: NodeId, normal: NodeId },
    Disc { center: NodeId, normal: NodeId, radius: NodeId },
    Boundary { region: Region, primitives: Vec<Primitive>, gradients: Vec<Option<NodeId>> },
    Mesh(MeshId),
}

/// The function of the nearest hit; its result has t, normal and number of the sheet.
#[derive(Copy, Clone)]
pub(super) struct Nearest {
    pub(super) function: FunctionId,
    pub(super) result: Ty,
}

/// The surfaces of a scene, as the kernel sees them.
pub(super) fn sheets(scene: &mut FieldScene, ledger: &mut Ledger) -> Vec<Sheet> {
    let mut out = vec![];
    for surface in scene.surfaces.clone() {
        let form = match surface.shape {
            SurfaceShape::Plane { point, normal } => Form::Plane { point, normal },
            SurfaceShape::Disc { center, normal, radius } => Form::Disc { center, normal, radius },
            SurfaceShape::Boundary(shape) => {
                let mut primitives = vec![];
                let region = region(&shape, &mut primitives);
                let position = scene.graph.input(Input::Position);
                let gradients = primitives.iter().map(|p| match p.kind {
                    PrimitiveKind::Sdf { field } => derive::gradient(&mut scene.graph, field, position).ok(),
                    PrimitiveKind::Sphere { .. }
                    | PrimitiveKind::Ellipsoid { .. }
                    | PrimitiveKind::Box { .. }
                    | PrimitiveKind::Slab { .. }
                    | PrimitiveKind::Cylinder { .. }
                    | PrimitiveKind::Shell { .. } => None,
                });
                let gradients = gradients.collect();
                Form::Boundary { region, primitives, gradients }
            }
            SurfaceShape::Mesh(id) => Form::Mesh(id),
        };
        let black = is_zero(&scene.graph, surface.albedo);
        if black {
            ledger.omit(format!("light reflected by {}", surface.name), "its albedo is 0", surface.span);
        }
        out.push(Sheet { name: surface.name, form, albedo: (!black).then_some(surface.albedo) });
    }
    out
}

/// Variables of the function.
struct Best {
    t: LocalId,
    normal: LocalId,
    sheet: LocalId,
}

impl Tracer<'_> {
    /// Writes the function, if there are surfaces.
    pub(super) fn write_nearest(&mut self) -> Option<Nearest> {
        if self.scene.sheets.is_empty() {
            return None;
        }
        let mut meshes = vec![];
        for sheet in &self.scene.sheets {
            meshes.push(match &sheet.form {
                Form::Mesh(id) => Some(self.mesh_function(*id)),
                Form::Plane { .. } | Form::Disc { .. } | Form::Boundary { .. } => None,
            });
        }
        let mut sdfs = vec![];
        for (number, sheet) in self.scene.sheets.iter().enumerate() {
            sdfs.push(self.sheet_sdfs(number, sheet));
        }
        let fields = [("t", Ty::F32), ("normal", Ty::VEC3), ("sheet", Ty::U32)];
        let result = self.builder.add_struct("Hit", fields.map(|(n, ty)| (n.to_owned(), ty)).into());
        let mut code = Code::new("nearest", None);
        let origin = code.parameter("origin", Ty::VEC3);
        let direction = code.parameter("direction", Ty::VEC3);
        let start = code.parameter("start", Ty::F32);
        let limit = code.parameter("limit", Ty::F32);
        let ray = Ray { origin, direction };
        let best = Best {
            t: code.var("best", Ty::F32, limit),
            normal: code.var("normal", Ty::VEC3, Expr::F32(0.0).splat(3)),
            sheet: code.var("sheet", Ty::U32, 0u32),
        };
        for (number, sheet) in self.scene.sheets.iter().enumerate() {
            code.open();
            match &sheet.form {
                Form::Plane { point, normal } => {
                    self.flat(&mut code, &ray, (*point, *normal, None), &start, &best, number);
                }
                Form::Disc { center, normal, radius } => {
                    self.flat(&mut code, &ray, (*center, *normal, Some(*radius)), &start, &best, number);
                }
                Form::Boundary { region, primitives, gradients } => {
                    self.boundary(
                        &mut code,
                        &ray,
                        (region, primitives, gradients),
                        &sdfs[number],
                        &start,
                        &best,
                        number,
                    );
                }
                Form::Mesh(_) => {
                    let Some(function) = meshes[number] else { continue };
                    let arguments = vec![ray.origin.clone(), ray.direction.clone(), start.clone(), best.t.into()];
                    let hit = code.bind("hit", Ty::float(4), Expr::Call(function, arguments));
                    let t = hit.clone().component(0);
                    code.if_(t.clone().less(best.t), |code| {
                        code.set(best.t, t);
                        let n = (1..4).map(|i| hit.clone().component(i)).collect();
                        code.set(best.normal, Expr::Compose(Ty::VEC3, n));
                        code.set(best.sheet, number as u32);
                    });
                }
            }
            let block = code.close();
            // A block of its own keeps names apart.
            code.push_if(Expr::Local(best.t).greater(start.clone()), block);
        }
        // Towards the side from which the ray comes.
        let behind = Expr::Local(best.normal).dot(ray.direction.clone()).greater(0.0);
        let normal = behind.select(-Expr::Local(best.normal), best.normal);
        code.return_(Expr::Compose(result, vec![best.t.into(), normal, best.sheet.into()]));
        let function = self.builder.add_function(code.finish(Some(result)));
        Some(Nearest { function, result })
    }

    fn flat(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        (point, normal, radius): (NodeId, NodeId, Option<NodeId>),
        start: &Expr,
        best: &Best,
        number: usize,
    ) {
        let name = self.scene.sheets[number].name.clone();
        let at = self.builder.value(self.graph, point, &format!("{name}_point"));
        let n = self.builder.value(self.graph, normal, &format!("{name}_normal"));
        let climb = code.bind("climb", Ty::F32, n.clone().dot(ray.direction.clone()));
        let height = n.clone().dot(at.clone() - ray.origin.clone());
        let still = climb.clone().equal(0.0);
        let t = height / still.clone().select(1.0, climb);
        let t = code.bind("t", Ty::F32, t);
        let mut hit = (!still).and(t.clone().greater(start.clone())).and(t.clone().less(best.t));
        if let Some(radius) = radius {
            let radius = self.builder.value(self.graph, radius, &format!("{name}_radius"));
            let off = code.bind("off", Ty::VEC3, ray.at(t.clone()) - at);
            hit = hit.and(off.clone().dot(off).less_equal(radius.clone() * radius));
        }
        code.if_(hit, |code| {
            code.set(best.t, t);
            code.set(best.normal, n);
            code.set(best.sheet, number as u32);
        });
    }

    fn sheet_sdfs(&mut self, number: usize, sheet: &Sheet) -> Vec<Option<super::shapes::SdfFunctions>> {
        let Form::Boundary { primitives, .. } = &sheet.form else { return vec![] };
        let mut out = vec![];
        for (i, primitive) in primitives.iter().enumerate() {
            let PrimitiveKind::Sdf { field } = primitive.kind else {
                out.push(None);
                continue;
            };
            let slope = self.features().steepness()[field.0 as usize].max(1.0);
            let name = format!("{}_sdf_{number}_{i}", sheet.name);
            let cap = self.max_work.min(4096);
            out.push(Some(sdf_functions(self.graph, &self.scene.tiers, self.builder, &name, field, slope, cap)));
        }
        out
    }

    /// Walks from boundary to boundary until being inside changes.
    fn boundary(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        (region, primitives, gradients): (&Region, &[Primitive], &[Option<NodeId>]),
        sdfs: &[Option<super::shapes::SdfFunctions>],
        start: &Expr,
        best: &Best,
        number: usize,
    ) {
        let name = self.scene.sheets[number].name.clone();
        let mut spans = vec![];
        for (i, primitive) in primitives.iter().enumerate() {
            let name = format!("{name}_{i}");
            spans.push(primitive_span(self.graph, self.builder, &mut self.spans, code, ray, primitive, &name));
        }
        let mut hoisted = vec![];
        for sdf in sdfs {
            hoisted.push(match sdf {
                Some(sdf) => self.along_ray(code, &-ray.direction.clone(), &sdf.field.hoisted),
                None => vec![],
            });
        }
        let t = code.var("t", Ty::F32, start.clone());
        let side = code.var("side", Ty::U32, 2u32);
        let found = code.var("found", Ty::F32, FAR);
        code.open();
        // Nothing beyond the best hit so far is of interest.
        let next = code.var("next", Ty::F32, best.t);
        let boundaries = Boundaries { spans: &spans, sdfs, arguments: &hoisted };
        let inside = boundaries.advance(code, ray, t, next);
        let now = region.inside(&|i| inside[i].clone()).unwrap_or(Expr::Bool(true));
        let now = code.bind("now", Ty::U32, now.select(1u32, 0u32));
        let same = Expr::Local(side).equal(2u32).or(now.clone().equal(Expr::Local(side)));
        code.open();
        code.set(found, t);
        code.break_();
        let hit = code.close();
        code.push_if(!same, hit);
        code.set(side, now);
        code.break_if(Expr::Local(next).greater_equal(best.t));
        code.set(t, next);
        let block = code.close();
        code.push_loop(block);
        code.open();
        self.boundary_normal(code, ray, primitives, (&spans, sdfs, &hoisted, gradients), found, best);
        code.set(best.t, found);
        code.set(best.sheet, number as u32);
        let taken = code.close();
        code.push_if(Expr::Local(found).less(best.t), taken);
    }

    /// The normal of whichever primitive's boundary is nearest to the hit.
    fn boundary_normal(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        primitives: &[Primitive],
        (spans, sdfs, hoisted, gradients): (
            &[Option<Expr>],
            &[Option<super::shapes::SdfFunctions>],
            &[Vec<Expr>],
            &[Option<NodeId>],
        ),
        found: LocalId,
        best: &Best,
    ) {
        let off = code.var("off", Ty::F32, FAR);
        for (i, primitive) in primitives.iter().enumerate() {
            let distance = match &spans[i] {
                Some(span) => {
                    let to = |end: u8| (span.clone().component(end) - Expr::Local(found)).abs();
                    to(0).min(to(1))
                }
                // Tracing stops within its resolution of the boundary.
                None => Expr::Local(found).abs().max(1.0) * 1e-6,
            };
            let distance = code.bind("distance", Ty::F32, distance);
            code.open();
            code.set(off, distance.clone());
            let p = code.bind("p", Ty::VEC3, ray.at(found.into()));
            let normal = match (&sdfs.get(i).and_then(Option::as_ref), gradients[i]) {
                (Some(_), Some(node)) => {
                    let mut writer = Writer::new(self.graph, &self.scene.tiers);
                    writer.know_input(Input::Position, p);
                    writer.know_input(Input::Direction, -ray.direction.clone());
                    writer.write(self.builder, code, &[node]).remove(0)
                }
                (Some(sdf), None) => difference(code, sdf.field.id, &p, &hoisted[i]),
                (None, _) => self.primitive_normal(code, ray, primitive, &p),
            };
            let normal = code.bind("outward", Ty::VEC3, normal);
            let length = code.bind("size", Ty::F32, Expr::math(Math::Length, [normal.clone()]));
            code.set(best.normal, normal / length.max(1e-30).splat(3));
            let nearer = code.close();
            code.push_if(distance.less(off), nearer);
        }
    }

    /// Perpendicular to a primitive at a point of its boundary, in the world, of any length.
    fn primitive_normal(&mut self, code: &mut Code, ray: &Ray, primitive: &Primitive, p: &Expr) -> Expr {
        let mut value = |node: NodeId, name: &str| self.builder.value(self.graph, node, name);
        let local = |this: &mut Self, code: &mut Code| match &primitive.from_world {
            Some(affine) => {
                let at = Ray { origin: p.clone(), direction: ray.direction.clone() };
                transformed(this.graph, this.builder, code, &at, affine).origin
            }
            None => p.clone(),
        };
        let normal = match primitive.kind {
            PrimitiveKind::Sphere { center, .. } => {
                let center = value(center, "center");
                local(self, code) - center
            }
            PrimitiveKind::Ellipsoid { center, radii } => {
                let (center, radii) = (value(center, "center"), value(radii, "radii"));
                (local(self, code) - center) / radii.clone() / radii
            }
            PrimitiveKind::Box { min, max } => {
                let (low, high) = (value(min, "min"), value(max, "max"));
                let q = local(self, code);
                let half = code.bind("half", Ty::VEC3, (high.clone() - low.clone()) * Expr::F32(0.5).splat(3));
                let q = q - (low + high) * Expr::F32(0.5).splat(3);
                let q = code.bind("q", Ty::VEC3, q / half.max(Expr::F32(1e-30).splat(3)));
                let size = code.bind("sizes", Ty::VEC3, q.clone().abs());
                let most = code.bind("most", Ty::F32, super::trace::largest(size.clone(), 3));
                let part = |i: u8| {
                    let own = size.clone().component(i).greater_equal(most.clone());
                    own.select(Expr::math(Math::Sign, [q.clone().component(i)]), 0.0)
                };
                Expr::Compose(Ty::VEC3, vec![part(0), part(1), part(2)])
            }
            PrimitiveKind::Slab { axis, .. } => value(axis, "axis"),
            PrimitiveKind::Cylinder { from, to, radius } => {
                let (from, to, radius) = (value(from, "from"), value(to, "to"), value(radius, "radius"));
                let q = local(self, code);
                let along = code.bind("along", Ty::VEC3, Expr::math(Math::Normalize, [to.clone() - from.clone()]));
                let rel = code.bind("rel", Ty::VEC3, q - from.clone());
                let height = code.bind("height", Ty::F32, rel.clone().dot(along.clone()));
                let flat = code.bind("flat", Ty::VEC3, rel - along.clone() * height.clone().splat(3));
                let length = Expr::math(Math::Length, [to - from]);
                let cap = height.clone().abs().min((length - height).abs());
                let mantle = (Expr::math(Math::Length, [flat.clone()]) - radius).abs();
                cap.less(mantle).select(along, flat)
            }
            // Shells were split into balls, and fields have gradients.
            PrimitiveKind::Shell { .. } | PrimitiveKind::Sdf { .. } => Expr::F32(0.0).splat(3),
        };
        match &primitive.from_world {
            Some(affine) => {
                // Normals go back by the transpose.
                let n = code.bind("own_normal", Ty::VEC3, normal);
                let rows = affine.rows.map(|r| self.builder.value(self.graph, r, "row"));
                let parts = rows.into_iter().enumerate().map(|(i, row)| row * n.clone().component(i as u8).splat(3));
                parts.reduce(|a, b| a + b).unwrap_or_else(|| n.clone())
            }
            None => normal,
        }
    }

    /// `mesh_i(origin, direction, start, limit)`: t and normal of the first triangle hit; t = limit if there is none.
    fn mesh_function(&mut self, id: MeshId) -> FunctionId {
        let buffer = self.builder.mesh(id);
        let mut code = Code::new(&format!("mesh_{}", id.0), None);
        let origin = code.parameter("origin", Ty::VEC3);
        let direction = code.parameter("direction", Ty::VEC3);
        let start = code.parameter("start", Ty::F32);
        let limit = code.parameter("limit", Ty::F32);
        // As integers, since the bits of small ones are denormal numbers, which a GPU may read as 0.
        let bits = |at: Expr| Expr::load(buffer, at);
        let load = |at: Expr| bits(at).bitcast(Prim::F32);
        let three = |code: &mut Code, name: &str, at: Expr| {
            let parts = (0..3u32).map(|i| load(at.clone() + i)).collect();
            code.bind(name, Ty::VEC3, Expr::Compose(Ty::VEC3, parts))
        };
        let count = code.bind("nodes", Ty::U32, bits(Expr::U32(0)));
        let triangles = code.bind("triangles", Ty::U32, (count.clone() + 1u32) * 8u32);
        let best = code.var("best", Ty::F32, limit);
        let normal = code.var("normal", Ty::VEC3, Expr::F32(0.0).splat(3));
        let node = code.var("node", Ty::U32, 0u32);
        // Never 0, so that 0 · ∞ does not arise.
        let safe = |i: u8| {
            let d = direction.clone().component(i);
            d.clone().abs().less(1e-30).select(1e-30, d)
        };
        let inverse = Expr::Compose(Ty::VEC3, (0..3u8).map(|i| Expr::F32(1.0) / safe(i)).collect());
        let inverse = code.bind("inverse", Ty::VEC3, inverse);
        code.open();
        code.break_if(Expr::Local(node).greater_equal(count));
        let at = code.bind("at", Ty::U32, (Expr::Local(node) + 1u32) * 8u32);
        let low = three(&mut code, "low", at.clone());
        let high = three(&mut code, "high", at.clone() + 4u32);
        let a = code.bind("a", Ty::VEC3, (low - origin.clone()) * inverse.clone());
        let b = code.bind("b", Ty::VEC3, (high - origin.clone()) * inverse);
        let enter = super::trace::largest(a.clone().min(b.clone()), 3).max(start.clone());
        // Widened a little: boxes are rounded too.
        let leave = super::trace::least(a.max(b), 3) * (1.0 + 1e-6) + 1e-7;
        let missed = code.bind("missed", Ty::BOOL, enter.greater(leave.min(best)));
        let skip = code.bind("skip", Ty::U32, bits(at.clone() + 3u32));
        let leaf = code.bind("leaf", Ty::U32, bits(at + 7u32));
        code.open();
        let first = Expr::binary(BinaryOp::ShiftRight, leaf.clone(), 3u32);
        let i = code.var("i", Ty::U32, first.clone());
        let end = first + Expr::binary(BinaryOp::BitAnd, leaf.clone(), 7u32);
        let end = code.bind("end", Ty::U32, end);
        code.open();
        code.break_if(Expr::Local(i).greater_equal(end));
        let base = code.bind("base", Ty::U32, triangles + Expr::Local(i) * 9u32);
        let v0 = three(&mut code, "v0", base.clone());
        let e1 = three(&mut code, "e1", base.clone() + 3u32);
        let e2 = three(&mut code, "e2", base + 6u32);
        let cross = |a: Expr, b: Expr| Expr::math(Math::Cross, [a, b]);
        let q = code.bind("q", Ty::VEC3, cross(direction.clone(), e2.clone()));
        let det = code.bind("det", Ty::F32, e1.clone().dot(q.clone()));
        let safe = det.clone().equal(0.0).select(1.0, det.clone());
        let s = code.bind("s", Ty::VEC3, (origin - v0) / safe.splat(3));
        let u = code.bind("u", Ty::F32, s.clone().dot(q));
        let r = code.bind("r", Ty::VEC3, cross(s, e1.clone()));
        let v = code.bind("v", Ty::F32, direction.dot(r.clone()));
        let t = code.bind("t", Ty::F32, e2.clone().dot(r));
        let within =
            u.clone().greater_equal(-1e-6).and(v.clone().greater_equal(-1e-6)).and((u + v).less_equal(1.0 + 1e-6));
        let hit = (!det.equal(0.0)).and(within).and(t.clone().greater(start)).and(t.clone().less(best));
        code.if_(hit, |code| {
            code.set(best, t);
            code.set(normal, cross(e1, e2));
        });
        code.add(i, 1u32);
        let block = code.close();
        code.push_loop(block);
        let triangles_of_leaf = code.close();
        code.push_if((!missed.clone()).and(leaf.greater(0u32)), triangles_of_leaf);
        code.set(node, missed.select(skip, Expr::Local(node) + 1u32));
        let block = code.close();
        code.push_loop(block);
        let length = Expr::math(Math::Length, [normal.into()]).max(1e-37);
        let n = code.bind("unit", Ty::VEC3, Expr::Local(normal) / length.splat(3));
        let parts = vec![best.into(), n.clone().component(0), n.clone().component(1), n.component(2)];
        code.return_(Expr::Compose(Ty::float(4), parts));
        self.builder.add_function(code.finish(Some(Ty::float(4))))
    }
}

/// A gradient by central differences, for a field that has no derivative in closed form.
fn difference(code: &mut Code, field: FunctionId, p: &Expr, hoisted: &[Expr]) -> Expr {
    let step = 1.0 / 2048.0;
    let mut parts = vec![];
    for axis in 0..3usize {
        let mut offset = [0.0; 3];
        offset[axis] = step;
        let offset = Expr::Compose(Ty::VEC3, offset.map(Expr::F32).into());
        let call = |at: Expr| {
            let mut arguments = vec![at];
            arguments.extend(hoisted.iter().cloned());
            Expr::Call(field, arguments)
        };
        let rise = call(p.clone() + offset.clone()) - call(p.clone() - offset);
        parts.push(code.bind(["dx", "dy", "dz"][axis], Ty::F32, rise));
    }
    Expr::Compose(Ty::VEC3, parts)
}
