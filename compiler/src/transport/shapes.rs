//! Rays against shapes, in f32: where a ray o + t·d is inside each primitive, as one interval of t.
//!
//! Directions need not be unit vectors (they are not in a primitive's own space). Distances to centres are taken
//! perpendicular to the ray and radii enter as (r − s)·(r + s), so that nothing cancels far away. A ray parallel to a face is
//! inside or outside by comparison, never by 0·∞.

use crate::fields::{Code, KernelBuilder};
use crate::ir::{Affine, Graph, NodeId, Primitive, PrimitiveKind, Shape, Tier};
use crate::program::kernel::{Expr, Function, FunctionId, LocalId, Math, Ty};

/// Stands for infinity along a ray: WGSL has no literal for it.
pub(super) const FAR: f64 = 3.0e38;

pub(super) const SPAN: Ty = Ty::Value(crate::program::kernel::Prim::F32, 2);

/// Functions of spans, written when a primitive needs them.
#[derive(Default)]
pub(super) struct SpanFunctions {
    axis: Option<FunctionId>,
    sphere: Option<FunctionId>,
    boxes: Option<FunctionId>,
    cylinder: Option<FunctionId>,
}

fn span(low: Expr, high: Expr) -> Expr {
    Expr::Compose(SPAN, vec![low, high])
}

fn nothing() -> Expr {
    span(Expr::F32(FAR), Expr::F32(-FAR))
}

/// `within(o, d, low, high)`: where low ≤ o + t·d ≤ high.
fn axis_function() -> Function {
    let mut code = Code::new("within", None);
    let [o, d, low, high] = ["o", "d", "low", "high"].map(|n| code.parameter(n, Ty::F32));
    code.if_(d.clone().equal(0.0), |code| {
        let inside = o.clone().greater_equal(low.clone()).and(o.clone().less_equal(high.clone()));
        code.if_(inside, |code| code.return_(span(Expr::F32(-FAR), Expr::F32(FAR))));
        code.return_(nothing());
    });
    let a = code.bind("a", Ty::F32, (low - o.clone()) / d.clone());
    let b = code.bind("b", Ty::F32, (high - o) / d);
    let clamp = |x: Expr| x.max(-FAR).min(FAR);
    code.return_(span(clamp(a.clone().min(b.clone())), clamp(a.max(b))));
    code.finish(Some(SPAN))
}

/// `through_ball(o, d, r)`: a ball around the origin, in two or three dimensions.
fn sphere_function() -> Function {
    let mut code = Code::new("through_ball", None);
    let o = code.parameter("o", Ty::VEC3);
    let d = code.parameter("d", Ty::VEC3);
    let r = code.parameter("r", Ty::F32);
    let a = code.bind("a", Ty::F32, d.clone().dot(d.clone()));
    // A ray that stands still in this space is inside for ever, or never.
    code.if_(a.clone().equal(0.0), |code| {
        let inside = o.clone().dot(o.clone()).less(r.clone() * r.clone());
        code.if_(inside, |code| code.return_(span(Expr::F32(-FAR), Expr::F32(FAR))));
        code.return_(nothing());
    });
    let nearest = code.bind("nearest", Ty::F32, -(o.clone().dot(d.clone())) / a.clone());
    let foot = code.bind("foot", Ty::VEC3, o + d * nearest.clone().splat(3));
    let s = code.bind("s", Ty::F32, Expr::math(Math::Length, [foot]));
    let square = code.bind("square", Ty::F32, (r.clone() - s.clone()) * (r + s) / a);
    code.if_(square.clone().less_equal(0.0), |code| code.return_(nothing()));
    let half = code.bind("half", Ty::F32, square.sqrt());
    code.return_(span(nearest.clone() - half.clone(), nearest + half));
    code.finish(Some(SPAN))
}

fn intersect(a: Expr, b: Expr) -> Expr {
    span(a.clone().component(0).max(b.clone().component(0)), a.component(1).min(b.component(1)))
}

/// An empty intersection as the empty span.
fn return_span(code: &mut Code, value: Expr) {
    let value = code.bind("common", SPAN, value);
    code.if_(value.clone().component(0).greater_equal(value.clone().component(1)), |code| code.return_(nothing()));
    code.return_(value);
}

fn box_function(axis: FunctionId) -> Function {
    let mut code = Code::new("through_box", None);
    let [o, d, low, high] = ["o", "d", "low", "high"].map(|n| code.parameter(n, Ty::VEC3));
    let spans: Vec<Expr> = (0..3u8)
        .map(|i| {
            let arguments = [&o, &d, &low, &high].map(|v| v.clone().component(i)).into();
            code.bind(["x", "y", "z"][i as usize], SPAN, Expr::Call(axis, arguments))
        })
        .collect();
    let xy = code.bind("xy", SPAN, intersect(spans[0].clone(), spans[1].clone()));
    return_span(&mut code, intersect(xy, spans[2].clone()));
    code.finish(Some(SPAN))
}

fn cylinder_function(axis: FunctionId, ball: FunctionId) -> Function {
    let mut code = Code::new("through_cylinder", None);
    let [o, d, bottom, top] = ["o", "d", "bottom", "top"].map(|n| code.parameter(n, Ty::VEC3));
    let r = code.parameter("r", Ty::F32);
    let along = code.bind("along", Ty::VEC3, top - bottom.clone());
    let length = code.bind("height", Ty::F32, Expr::math(Math::Length, [along.clone()]));
    code.if_(length.clone().equal(0.0), |code| code.return_(nothing()));
    let along = code.bind("axis", Ty::VEC3, along / length.clone().splat(3));
    let from = code.bind("from", Ty::VEC3, o - bottom);
    let height = code.bind("start", Ty::F32, from.clone().dot(along.clone()));
    let climb = code.bind("climb", Ty::F32, d.clone().dot(along.clone()));
    let caps = Expr::Call(axis, vec![height.clone(), climb.clone(), Expr::F32(0.0), length]);
    let caps = code.bind("caps", SPAN, caps);
    let flat_o = from - along.clone() * height.splat(3);
    let flat_d = d - along * climb.splat(3);
    let side = code.bind("side", SPAN, Expr::Call(ball, vec![flat_o, flat_d, r]));
    return_span(&mut code, intersect(caps, side));
    code.finish(Some(SPAN))
}

impl SpanFunctions {
    /// `within(o, d, low, high)`: where a coordinate lies between two values.
    pub(super) fn within(&mut self, builder: &mut KernelBuilder) -> FunctionId {
        self.axis(builder)
    }

    fn axis(&mut self, builder: &mut KernelBuilder) -> FunctionId {
        *self.axis.get_or_insert_with(|| builder.add_function(axis_function()))
    }

    fn sphere(&mut self, builder: &mut KernelBuilder) -> FunctionId {
        *self.sphere.get_or_insert_with(|| builder.add_function(sphere_function()))
    }

    /// `through_box(o, d, low, high)`
    pub(super) fn boxes(&mut self, builder: &mut KernelBuilder) -> FunctionId {
        let axis = self.axis(builder);
        *self.boxes.get_or_insert_with(|| builder.add_function(box_function(axis)))
    }

    fn cylinder(&mut self, builder: &mut KernelBuilder) -> FunctionId {
        let (axis, sphere) = (self.axis(builder), self.sphere(builder));
        *self.cylinder.get_or_insert_with(|| builder.add_function(cylinder_function(axis, sphere)))
    }
}

/// A region with shells split into balls: each leaf is one primitive by its number.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Region {
    Everywhere,
    Leaf(usize),
    Union(Vec<Region>),
    Intersection(Vec<Region>),
    Difference(Box<Region>, Vec<Region>),
}

/// Numbers the primitives of a shape, equal ones once.
pub(super) fn region(shape: &Shape, primitives: &mut Vec<Primitive>) -> Region {
    let mut leaf = |p: Primitive| {
        let same = primitives.iter().position(|q| q.kind == p.kind && q.from_world == p.from_world);
        Region::Leaf(same.unwrap_or_else(|| {
            primitives.push(p);
            primitives.len() - 1
        }))
    };
    match shape {
        Shape::Everywhere => Region::Everywhere,
        Shape::Primitive(p) => match p.kind {
            PrimitiveKind::Shell { center, inner, outer } => {
                let ball = |radius| Primitive { kind: PrimitiveKind::Sphere { center, radius }, ..p.clone() };
                let outer = leaf(ball(outer));
                let inner = leaf(ball(inner));
                Region::Difference(Box::new(outer), vec![inner])
            }
            _ => leaf(p.clone()),
        },
        Shape::Union(parts) => Region::Union(parts.iter().map(|s| region(s, primitives)).collect()),
        Shape::Intersection(parts) => Region::Intersection(parts.iter().map(|s| region(s, primitives)).collect()),
        Shape::Difference(first, rest) => {
            let first = region(first, primitives);
            Region::Difference(Box::new(first), rest.iter().map(|s| region(s, primitives)).collect())
        }
    }
}

impl Region {
    /// Whether no ray leaves it for certain only by reaching infinity.
    pub(super) fn is_unbounded(&self, primitives: &[Primitive]) -> bool {
        match self {
            Self::Everywhere => true,
            Self::Leaf(i) => matches!(primitives[*i].kind, PrimitiveKind::Slab { .. } | PrimitiveKind::Sdf { .. }),
            Self::Union(parts) => parts.iter().any(|r| r.is_unbounded(primitives)),
            Self::Intersection(parts) => parts.iter().all(|r| r.is_unbounded(primitives)),
            Self::Difference(first, _) => first.is_unbounded(primitives),
        }
    }

    /// Whether a point is inside, given whether it is inside each primitive; `None` is "for certain".
    pub(super) fn inside(&self, leaf: &dyn Fn(usize) -> Expr) -> Option<Expr> {
        let all = |parts: &[Self], op: fn(Expr, Expr) -> Expr| {
            let parts: Vec<Option<Expr>> = parts.iter().map(|r| r.inside(leaf)).collect();
            (parts.iter().all(Option::is_some)).then(|| parts.into_iter().flatten().reduce(op)).flatten()
        };
        match self {
            Self::Everywhere => None,
            Self::Leaf(i) => Some(leaf(*i)),
            // Everywhere in a union is everywhere.
            Self::Union(parts) => all(parts, Expr::or),
            Self::Intersection(parts) => parts.iter().filter_map(|r| r.inside(leaf)).reduce(Expr::and),
            Self::Difference(first, rest) => {
                let mut out = first.inside(leaf);
                for part in rest {
                    let outside = match part.inside(leaf) {
                        Some(inside) => !inside,
                        None => Expr::Bool(false),
                    };
                    out = Some(match out {
                        Some(o) => o.and(outside),
                        None => outside,
                    });
                }
                out
            }
        }
    }
}

/// A ray in a function: origin and direction.
#[derive(Clone)]
pub(super) struct Ray {
    pub(super) origin: Expr,
    pub(super) direction: Expr,
}

impl Ray {
    pub(super) fn at(&self, t: Expr) -> Expr {
        self.origin.clone() + self.direction.clone() * t.splat(3)
    }
}

fn host(graph: &Graph, builder: &mut KernelBuilder, node: NodeId, name: &str) -> Expr {
    builder.value(graph, node, name)
}

/// A ray in a primitive's own space.
pub(super) fn transformed(
    graph: &Graph,
    builder: &mut KernelBuilder,
    code: &mut Code,
    ray: &Ray,
    affine: &Affine,
) -> Ray {
    let rows = affine.rows.map(|r| host(graph, builder, r, "row"));
    let offset = host(graph, builder, affine.offset, "offset");
    let apply = |v: &Expr| Expr::Compose(Ty::VEC3, rows.iter().map(|r| r.clone().dot(v.clone())).collect());
    let origin = code.bind("local_origin", Ty::VEC3, apply(&ray.origin) + offset);
    let direction = code.bind("local_direction", Ty::VEC3, apply(&ray.direction));
    Ray { origin, direction }
}

/// The span of a closed-form primitive, bound to a name; `None` for an sdf.
pub(super) fn primitive_span(
    graph: &Graph,
    builder: &mut KernelBuilder,
    functions: &mut SpanFunctions,
    code: &mut Code,
    ray: &Ray,
    primitive: &Primitive,
    name: &str,
) -> Option<Expr> {
    let ray = match &primitive.from_world {
        Some(affine) if !matches!(primitive.kind, PrimitiveKind::Sdf { .. }) => {
            &transformed(graph, builder, code, ray, affine)
        }
        _ => ray,
    };
    let mut value = |node: NodeId, part: &str| host(graph, builder, node, &format!("{name}_{part}"));
    let (o, d) = (ray.origin.clone(), ray.direction.clone());
    let call = match primitive.kind {
        PrimitiveKind::Sphere { center, radius } => {
            let (center, radius) = (value(center, "center"), value(radius, "radius"));
            Expr::Call(functions.sphere(builder), vec![o - center, d, radius])
        }
        PrimitiveKind::Ellipsoid { center, radii } => {
            let (center, radii) = (value(center, "center"), value(radii, "radii"));
            let arguments = vec![(o - center) / radii.clone(), d / radii, Expr::F32(1.0)];
            Expr::Call(functions.sphere(builder), arguments)
        }
        PrimitiveKind::Box { min, max } => {
            let (min, max) = (value(min, "min"), value(max, "max"));
            Expr::Call(functions.boxes(builder), vec![o, d, min, max])
        }
        PrimitiveKind::Slab { axis, from, to } => {
            let axis = value(axis, "axis");
            let (from, to) = (value(from, "from"), value(to, "to"));
            let arguments = vec![axis.clone().dot(o), axis.dot(d), from, to];
            Expr::Call(functions.axis(builder), arguments)
        }
        PrimitiveKind::Cylinder { from, to, radius } => {
            let (from, to, radius) = (value(from, "from"), value(to, "to"), value(radius, "radius"));
            Expr::Call(functions.cylinder(builder), vec![o, d, from, to, radius])
        }
        // Shells were split into balls; the boundary of an sdf is found by tracing.
        PrimitiveKind::Shell { .. } | PrimitiveKind::Sdf { .. } => return None,
    };
    Some(code.bind(&format!("{name}_span"), SPAN, call))
}

/// A signed distance as a function of the position, and one that finds its next change of sign along a ray.
pub(super) struct SdfFunctions {
    /// `field(p)`, with what the field takes from the ray.
    pub(super) field: crate::fields::FieldFunction,
    /// `next(o, d, t, end, …)`: the least t' > t with a change of sign, at most `end`.
    pub(super) next: FunctionId,
}

/// Writes the functions of a signed distance field of slope at most `lipschitz`.
///
/// Sphere tracing (Hart 1996): a step of |f|/slope cannot pass a change of sign. Steps shorter than the resolution
/// (2⁻¹⁸ of the distance reached, and of the unit) are lengthened to it; thinner parts than that are below f32.
pub(super) fn sdf_functions(
    graph: &Graph,
    tiers: &[Tier],
    builder: &mut KernelBuilder,
    name: &str,
    field: NodeId,
    lipschitz: f64,
    max_steps: u32,
) -> SdfFunctions {
    let function =
        crate::fields::field_function(graph, tiers, builder, name, graph.origin(field).span, &[("distance", field)]);
    let mut code = Code::new(&format!("{name}_next"), None);
    let o = code.parameter("o", Ty::VEC3);
    let d = code.parameter("d", Ty::VEC3);
    let start = code.parameter("start", Ty::F32);
    let end = code.parameter("end", Ty::F32);
    let hoisted: Vec<Expr> = function
        .hoisted
        .iter()
        .enumerate()
        .map(|(i, n)| code.parameter(&format!("along_{i}"), Ty::float(graph.width(*n))))
        .collect();
    let ray = Ray { origin: o, direction: d };
    let call = |t: Expr| {
        let mut arguments = vec![ray.at(t)];
        arguments.extend(hoisted.iter().cloned());
        Expr::Call(function.id, arguments)
    };
    let resolution = |t: Expr| t.abs().max(1.0) * (1.0 / 262_144.0);
    let t = code.var("t", Ty::F32, start.clone() + resolution(start));
    let first = code.bind("first", Ty::F32, call(t.into()));
    let side = code.bind("side", Ty::BOOL, first.clone().less(0.0));
    let distance = code.var("distance", Ty::F32, first.abs());
    let count = code.var("count", Ty::U32, 0u32);
    code.loop_(|code| {
        let give_up = Expr::Local(t).greater_equal(end.clone()).or(Expr::Local(count).greater_equal(max_steps));
        code.break_if(give_up);
        let step = (Expr::Local(distance) * (1.0 / lipschitz)).max(resolution(t.into()));
        code.add(t, step);
        let value = code.bind("value", Ty::F32, call(t.into()));
        let changed = Expr::binary(crate::program::kernel::BinaryOp::NotEqual, value.clone().less(0.0), side.clone());
        code.break_if(changed);
        code.set(distance, value.abs());
        code.add(count, 1u32);
    });
    code.return_(Expr::Local(t).min(end));
    let next = builder.add_function(code.finish(Some(Ty::F32)));
    SdfFunctions { field: function, next }
}

/// Whether a node reads the ray at all.
pub(super) fn is_hosted(tiers: &[Tier], node: NodeId) -> bool {
    tiers[node.0 as usize] <= Tier::Frame
}

/// What a walk from boundary to boundary knows of its primitives.
pub(super) struct Boundaries<'b> {
    /// Of closed forms.
    pub(super) spans: &'b [Option<Expr>],
    /// Of signed distances.
    pub(super) sdfs: &'b [Option<SdfFunctions>],
    /// What the latter take from the ray.
    pub(super) arguments: &'b [Vec<Expr>],
}

impl Boundaries<'_> {
    /// Draws `next` back to the first boundary after `t`, and tells which primitives the ray is inside of between the two.
    pub(super) fn advance(&self, code: &mut Code, ray: &Ray, t: LocalId, next: LocalId) -> Vec<Expr> {
        for span in self.spans.iter().flatten() {
            for i in 0..2 {
                let end = span.clone().component(i);
                let ahead = end.clone().greater(Expr::Local(t)).select(end, FAR);
                code.set(next, Expr::Local(next).min(ahead));
            }
        }
        for (sdf, arguments) in self.sdfs.iter().zip(self.arguments) {
            if let Some(sdf) = sdf {
                let mut all = vec![ray.origin.clone(), ray.direction.clone(), t.into(), next.into()];
                all.extend(arguments.iter().cloned());
                code.set(next, Expr::Call(sdf.next, all));
            }
        }
        let middle = Expr::Local(next)
            .greater_equal(FAR)
            .select(Expr::Local(t) + (Expr::Local(t).abs() + 1.0), (Expr::Local(t) + Expr::Local(next)) * 0.5);
        let middle = code.bind("middle", Ty::F32, middle);
        let mut inside = vec![];
        for (i, span) in self.spans.iter().enumerate() {
            let value = match (span, &self.sdfs[i]) {
                (Some(span), _) => {
                    let after = middle.clone().greater(span.clone().component(0));
                    after.and(middle.clone().less(span.clone().component(1)))
                }
                (None, Some(sdf)) => {
                    let mut all = vec![ray.at(middle.clone())];
                    all.extend(self.arguments[i].iter().cloned());
                    Expr::Call(sdf.field.id, all).less(0.0)
                }
                (None, None) => Expr::Bool(false),
            };
            inside.push(code.bind(&format!("in_{i}"), Ty::BOOL, value));
        }
        inside
    }
}
