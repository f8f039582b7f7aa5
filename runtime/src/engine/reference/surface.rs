//! Opaque surfaces: where a ray meets them, and how they lie there.

use super::field::{Ray, bad_field, with_span};
use super::gauss::N;
use super::shape::Solid;
use super::trace::Worker;
use crate::frame::vector::{Vec3, along, dot, is_finite, length, normalize, scale, sub};
use crate::frame::{AT_MOST_ONE, GAIN};
use compiler::diagnostic::Diagnostic;
use compiler::ir::derive::gradient;
use compiler::ir::eval::{Tape, Voxels};
use compiler::ir::{FieldScene, Graph, Input, MeshId, NodeId, Shape, SurfaceShape};
use compiler::source::Span;
use std::collections::HashMap;
use std::fmt;

/// Where a ray meets a mesh. Lengths in metres.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct MeshHit {
    /// Metres along the ray.
    pub t: f64,
    /// Normal of the triangle, of either sign and any length but zero.
    pub normal: Vec3,
}

/// Where triangles come from.
pub trait Meshes: Sync {
    /// The first triangle that the ray `origin + t·direction` meets with `0 < t < reach`, both sides alike. Positions and
    /// lengths in metres; the direction is a unit vector.
    fn hit(&self, mesh: MeshId, origin: Vec3, direction: Vec3, reach: f64) -> Option<MeshHit>;
}

/// Lists of triangles, one for each mesh, in metres. Every triangle is tried.
#[derive(Clone, Debug, Default)]
pub struct Triangles(pub Vec<Vec<[Vec3; 3]>>);

impl Meshes for Triangles {
    fn hit(&self, mesh: MeshId, origin: Vec3, direction: Vec3, reach: f64) -> Option<MeshHit> {
        let list = self.0.get(mesh.0 as usize)?;
        let hits = list.iter().filter_map(|t| triangle(t, origin, direction)).filter(|h| h.t < reach);
        hits.min_by(|a, b| a.t.total_cmp(&b.t))
    }
}

/// Möller and Trumbore 1997; edges belong to the triangle.
fn triangle([a, b, c]: &[Vec3; 3], o: Vec3, d: Vec3) -> Option<MeshHit> {
    use crate::frame::vector::cross;
    let (e, f) = (sub(*b, *a), sub(*c, *a));
    let p = cross(d, f);
    let volume = dot(e, p);
    if volume == 0.0 {
        return None;
    }
    let s = sub(o, *a);
    let u = dot(s, p) / volume;
    let q = cross(s, e);
    let v = dot(d, q) / volume;
    let t = dot(f, q) / volume;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then(|| MeshHit { t, normal: cross(e, f) })
}

/// The form of a surface with the values of one frame.
#[derive(Clone, Debug)]
pub(super) enum SurfaceForm {
    Plane { point: Vec3, normal: Vec3 },
    Disc { center: Vec3, normal: Vec3, radius: f64 },
    Boundary(Solid),
    Mesh(MeshId),
}

/// A surface of one frame.
#[derive(Clone, Debug)]
pub(super) struct SurfaceField {
    pub(super) name: String,
    pub(super) span: Option<Span>,
    pub(super) form: SurfaceForm,
    pub(super) albedo: Tape,
}

/// Evaluates surfaces. `frame` gives the numbers of nodes of tier Frame, `solid` shapes.
///
/// # Errors
/// `E0651` for a number that is not finite.
pub(super) fn evaluate(
    scene: &FieldScene,
    frame: &dyn Fn(&[NodeId]) -> Vec<Vec<f64>>,
    solid: &mut dyn FnMut(&Shape) -> Result<Solid, String>,
) -> Result<Vec<SurfaceField>, Diagnostic> {
    let mut all = vec![];
    for surface in &scene.surfaces {
        let bad = |part: &str| {
            let message = format!("the {part} of surface `{}` is not finite", surface.name);
            with_span(Diagnostic::error("E0651", message), surface.span)
                .hint("check the params and divisions that it uses")
        };
        let vector = |node: NodeId, part: &str| -> Result<Vec3, Diagnostic> {
            let v = frame(&[node]).swap_remove(0);
            let v: Vec3 = std::array::from_fn(|c| v[c.min(v.len() - 1)]);
            if is_finite(v) { Ok(v) } else { Err(bad(part)) }
        };
        let unit = |node: NodeId| normalize(vector(node, "normal")?).ok_or_else(|| bad("normal"));
        let form = match &surface.shape {
            SurfaceShape::Plane { point, normal } => {
                SurfaceForm::Plane { point: vector(*point, "point")?, normal: unit(*normal)? }
            }
            SurfaceShape::Disc { center, normal, radius } => SurfaceForm::Disc {
                center: vector(*center, "center")?,
                normal: unit(*normal)?,
                radius: vector(*radius, "radius")?[0],
            },
            SurfaceShape::Boundary(shape) => SurfaceForm::Boundary(solid(shape).map_err(|part| bad(&part))?),
            SurfaceShape::Mesh(id) => SurfaceForm::Mesh(*id),
        };
        let (name, albedo) = (surface.name.clone(), Tape::new(&scene.graph, &[surface.albedo]));
        all.push(SurfaceField { name, span: surface.span, form, albedo });
    }
    Ok(all)
}

/// Exact gradients of the fields that bound surfaces, where there are any.
pub(super) fn slopes(graph: &mut Graph, surfaces: &[SurfaceField]) -> HashMap<NodeId, Tape> {
    let mut fields = vec![];
    for surface in surfaces {
        match &surface.form {
            SurfaceForm::Boundary(solid) => solid.fields(&mut fields),
            SurfaceForm::Plane { .. } | SurfaceForm::Disc { .. } | SurfaceForm::Mesh(_) => {}
        }
    }
    let mut all = HashMap::new();
    for field in fields {
        let position = graph.input(Input::Position);
        if let Ok(slope) = gradient(graph, field, position) {
            all.insert(field, Tape::new(graph, &[slope]));
        }
    }
    all
}

/// Where a ray ends.
#[derive(Copy, Clone, Debug)]
pub(super) struct Hit {
    pub(super) t: f64,
    pub(super) surface: usize,
    /// Of a mesh, whose triangles know it.
    normal: Option<Vec3>,
}

/// A point of a surface, seen from one side.
#[derive(Copy, Clone, Debug)]
pub(super) struct Spot {
    pub(super) at: Vec3,
    /// Moved off the surface by a little more than positions are rounded, to the side from which it is seen.
    pub(super) place: Vec3,
    /// Unit normal on that side.
    pub(super) normal: Vec3,
}

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Where a ray first meets a surface before `reach`.
    fn meet(&mut self, index: usize, ray: &Ray, reach: f64) -> Result<Option<Hit>, Diagnostic> {
        let fields = self.fields;
        let surface = &fields.surfaces[index];
        let flat = |point: Vec3, normal: Vec3| {
            let rate = dot(normal, ray.direction);
            if rate == 0.0 { f64::NAN } else { dot(normal, sub(point, ray.origin)) / rate }
        };
        let (t, normal) = match &surface.form {
            SurfaceForm::Plane { point, normal } => (flat(*point, *normal), None),
            SurfaceForm::Disc { center, normal, radius } => {
                let t = flat(*center, *normal);
                let off = length(along(sub(ray.origin, *center), ray.direction, t));
                (if off <= *radius { t } else { f64::NAN }, None)
            }
            SurfaceForm::Boundary(solid) => {
                let inside = self.intervals(solid, ("surface", &surface.name, surface.span), ray)?;
                let first = inside.0.first().map(|(a, b)| if *a > 0.0 { *a } else { *b });
                (first.unwrap_or(f64::NAN), None)
            }
            SurfaceForm::Mesh(id) => {
                let Some(meshes) = self.meshes else { return Ok(None) };
                let metre = self.metre;
                match meshes.hit(*id, scale(ray.origin, metre), ray.direction, reach * metre) {
                    Some(hit) => (hit.t / metre, Some(hit.normal)),
                    None => return Ok(None),
                }
            }
        };
        // Not a number where there is no crossing.
        Ok((t > 0.0 && t < reach).then_some(Hit { t, surface: index, normal }))
    }

    /// The first surface before `reach`.
    pub(super) fn nearest(&mut self, ray: &Ray, reach: f64) -> Result<Option<Hit>, Diagnostic> {
        let mut best: Option<Hit> = None;
        for index in 0..self.fields.surfaces.len() {
            best = self.meet(index, ray, best.map_or(reach, |b| b.t))?.or(best);
        }
        Ok(best)
    }

    /// Whether some surface lies before `reach`.
    pub(super) fn blocked(&mut self, ray: &Ray, reach: f64) -> Result<bool, Diagnostic> {
        for index in 0..self.fields.surfaces.len() {
            if self.meet(index, ray, reach)?.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The place where a ray meets a surface.
    pub(super) fn spot(&mut self, ray: &Ray, hit: &Hit) -> Spot {
        let fields = self.fields;
        let normal = match &fields.surfaces[hit.surface].form {
            SurfaceForm::Plane { normal, .. } | SurfaceForm::Disc { normal, .. } => Some(*normal),
            SurfaceForm::Boundary(solid) => {
                let mut sdf = |node: NodeId| self.slope(node, ray, hit.t);
                solid.normal(ray.origin, ray.direction, hit.t, &mut sdf)
            }
            SurfaceForm::Mesh(_) => hit.normal.and_then(normalize),
        };
        // Without a normal (the tip of a cone) it faces the viewer.
        let normal = normal.unwrap_or(ray.direction);
        let normal = if dot(normal, ray.direction) > 0.0 { scale(normal, -1.0) } else { normal };
        let at = ray.at(hit.t);
        let size = at.iter().chain(&ray.origin).fold(hit.t, |m, x| m.max(x.abs()));
        Spot { at, place: along(at, normal, 1e-12 * size), normal }
    }

    /// Value and gradient of the field of an `sdf`.
    fn slope(&mut self, node: NodeId, ray: &Ray, t: f64) -> Option<(f64, Vec3)> {
        let fields = self.fields;
        let tape = fields.sdf.get(&node)?;
        let mut scratch = tape.scratch();
        fields.run(tape, &mut scratch, self.voxels, ray, &[t; N], false);
        let value = tape.component(&scratch, 0, 0)[0];
        if let Some(exact) = fields.slopes.get(&node) {
            let mut scratch = exact.scratch();
            fields.run(exact, &mut scratch, self.voxels, ray, &[t; N], false);
            let slope: Vec3 = std::array::from_fn(|c| exact.component(&scratch, 0, c)[0]);
            if is_finite(slope) && slope != [0.0; 3] {
                return Some((value, slope));
            }
        }
        // Differences, where the derivative is not known: noise and altitudes.
        let p = ray.at(t);
        let h = 1e-5 * p.iter().fold(t.max(1e-3), |m, x| m.max(x.abs()));
        let mut points = [p; N];
        for c in 0..3 {
            points[2 * c][c] += h;
            points[2 * c + 1][c] -= h;
        }
        fields.run_at(tape, &mut scratch, self.voxels, ray, &points);
        let v = tape.component(&scratch, 0, 0);
        let slope: Vec3 = std::array::from_fn(|c| (v[2 * c] - v[2 * c + 1]) / (2.0 * h));
        (is_finite(slope) && slope != [0.0; 3]).then_some((value, slope))
    }

    /// Share of light that a surface reflects at a point of a ray, per band.
    pub(super) fn albedo(&mut self, ray: &Ray, hit: &Hit) -> Result<super::trace::PerBand, Diagnostic> {
        let fields = self.fields;
        let surface = &fields.surfaces[hit.surface];
        let tape = &surface.albedo;
        let mut scratch = tape.scratch();
        fields.run(tape, &mut scratch, self.voxels, ray, &[hit.t; N], false);
        self.evaluations += 1;
        let mut out = [0.0; super::trace::BANDS];
        for (b, slot) in out.iter_mut().enumerate().take(self.bands) {
            let v = tape.component(&scratch, 0, b.min(tape.width(0) - 1))[0];
            if !(v >= 0.0 && v.is_finite()) {
                let (owner, place) = (format!("surface `{}`", surface.name), scale(ray.at(hit.t), self.metre));
                return Err(bad_field(&owner, surface.span, "albedo", v, place));
            }
            if v > GAIN {
                let [x, y, z] = scale(ray.at(hit.t), self.metre);
                let message = format!("albedo of surface `{}` is {v} at ({x:.6}, {y:.6}, {z:.6}) m", surface.name);
                return Err(with_span(Diagnostic::error("E0657", message), surface.span).hint(AT_MOST_ONE));
            }
            *slot = v;
        }
        Ok(out)
    }
}

impl fmt::Debug for dyn Meshes + '_ {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Meshes")
    }
}
