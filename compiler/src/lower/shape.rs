//! Regions: from expressions to trees of closed forms, and their bounding boxes, as nodes and as numbers.

use super::space::{inverse, invert};
use super::{Lowered, Lowerer, Value};
use crate::check::hir::{self, Builtin};
use crate::diagnostic::Diagnostic;
use crate::ir::{Affine, Binary, NodeId, Primitive, PrimitiveKind, Shape, Tier, Unary, eval};
use crate::source::Span;
use rustc_hash::FxHashMap;

/// A box along the axes: its lower and upper corner.
pub(super) type Corners = ([f64; 3], [f64; 3]);

impl<'s> Lowerer<'s, '_> {
    pub(super) fn region(&mut self, span: Span, builtin: Builtin, arguments: &'s [hir::Expr]) -> Lowered<Shape> {
        match builtin {
            Builtin::Everywhere => return Ok(Shape::Everywhere),
            Builtin::Union | Builtin::Intersection | Builtin::Difference => {
                let mut parts = arguments.iter().map(|a| self.as_shape(a)).collect::<Lowered<Vec<_>>>()?;
                return Ok(match builtin {
                    Builtin::Union => Shape::Union(parts),
                    Builtin::Intersection => Shape::Intersection(parts),
                    _ => {
                        let first = parts.remove(0);
                        Shape::Difference(Box::new(first), parts)
                    }
                });
            }
            // Splats stand for the box around them already.
            Builtin::Bounds if matches!(arguments[0].kind, hir::ExprKind::Splats(_)) => {
                return self.as_shape(&arguments[0]);
            }
            Builtin::Bounds => {
                let grid = self.as_grid(&arguments[0])?;
                let affine = self.index_from_space(grid, span)?;
                let dims = self.scene.grids[grid.0 as usize].header.dims;
                let min = self.graph.vector(&[-0.5; 3]);
                let max = self.graph.vector(&dims.map(|n| f64::from(n) - 0.5));
                return Ok(primitive(PrimitiveKind::Box { min, max }, Some(affine), span));
            }
            Builtin::Sdf => {
                let field = if self.geometry_only { self.graph.scalar(0.0) } else { self.scalar(&arguments[0])? };
                return Ok(primitive(PrimitiveKind::Sdf { field }, None, span));
            }
            _ => {}
        }
        let mut nodes = vec![];
        for argument in arguments {
            let node = self.node(argument)?;
            let node = self.folded(node);
            self.per_frame(node, argument.span, "a shape");
            nodes.push(node);
        }
        let scalar = |this: &mut Self, i: usize| match this.graph.width(nodes[i]) {
            1 => Ok(nodes[i]),
            _ => this.broken_promise(span, "a single number is expected here"),
        };
        let kind = match builtin {
            Builtin::Sphere => PrimitiveKind::Sphere { center: self.three(nodes[0], span)?, radius: scalar(self, 1)? },
            Builtin::Ellipsoid => {
                PrimitiveKind::Ellipsoid { center: self.three(nodes[0], span)?, radii: self.three(nodes[1], span)? }
            }
            Builtin::Box => PrimitiveKind::Box { min: self.three(nodes[0], span)?, max: self.three(nodes[1], span)? },
            Builtin::Slab => {
                let axis = self.three(nodes[0], span)?;
                self.nonzero.push((axis, arguments[0].span, "the axis of a slab"));
                let axis = self.normalize(axis);
                PrimitiveKind::Slab { axis: self.folded(axis), from: scalar(self, 1)?, to: scalar(self, 2)? }
            }
            Builtin::Cylinder => PrimitiveKind::Cylinder {
                from: self.three(nodes[0], span)?,
                to: self.three(nodes[1], span)?,
                radius: scalar(self, 2)?,
            },
            Builtin::Shell => PrimitiveKind::Shell {
                center: self.three(nodes[0], span)?,
                inner: scalar(self, 1)?,
                outer: scalar(self, 2)?,
            },
            _ => return self.broken_promise(span, "this is no shape"),
        };
        Ok(primitive(kind, None, span))
    }

    pub(super) fn as_shape(&mut self, expr: &'s hir::Expr) -> Lowered<Shape> {
        match self.value(expr)? {
            Value::Shape(shape) => Ok(shape),
            _ => self.broken_promise(expr.span, "a shape is expected here"),
        }
    }

    fn as_grid(&mut self, expr: &'s hir::Expr) -> Lowered<hir::GridId> {
        match self.value(expr)? {
            Value::Grid(id) if (id.0 as usize) < self.scene.grids.len() => Ok(id),
            _ => self.broken_promise(expr.span, "a grid is expected here"),
        }
    }

    /// The shape as the world sees it.
    pub(super) fn in_world(&mut self, shape: Shape, from_world: &Affine) -> Shape {
        let many =
            |this: &mut Self, parts: Vec<Shape>| parts.into_iter().map(|s| this.in_world(s, from_world)).collect();
        match shape {
            Shape::Everywhere => Shape::Everywhere,
            // The field of an `sdf` already sees the medium's own position.
            Shape::Primitive(p) if matches!(p.kind, PrimitiveKind::Sdf { .. }) => Shape::Primitive(p),
            Shape::Primitive(p) => {
                let affine = match &p.from_world {
                    Some(own) => self.compose_affine(own, from_world),
                    None => *from_world,
                };
                Shape::Primitive(Primitive { from_world: Some(affine), ..p })
            }
            Shape::Union(parts) => Shape::Union(many(self, parts)),
            Shape::Intersection(parts) => Shape::Intersection(many(self, parts)),
            Shape::Difference(first, rest) => {
                let first = self.in_world(*first, from_world);
                Shape::Difference(Box::new(first), many(self, rest))
            }
        }
    }

    /// `center`, `min_corner`, `max_corner` and `size` of a grid or shape.
    pub(super) fn extent(&mut self, span: Span, builtin: Builtin, of: &'s hir::Expr) -> Lowered<NodeId> {
        let corners = match self.value(of)? {
            Value::Grid(id) => self.grid_box(id),
            Value::Shape(shape) => self.node_box(&shape),
            _ => return self.broken_promise(of.span, "a grid or shape is expected here"),
        };
        let Some((min, max)) = corners else {
            return self.report(
                Diagnostic::error("E0507", "this shape has no bounds")
                    .at(of.span, "it is unbounded, or nothing is known of its extent")
                    .because(span, "a bounding box is needed here")
                    .note("slabs and `everywhere` are infinite, and the extent of an `sdf` is not known")
                    .hint("use its intersection with a `box` or `sphere`"),
            );
        };
        let node = match builtin {
            Builtin::MinCorner => min,
            Builtin::MaxCorner => max,
            Builtin::Size => self.graph.sub(max, min),
            _ => {
                let (sum, half) = (self.graph.add(min, max), self.graph.scalar(0.5));
                self.graph.mul(sum, half)
            }
        };
        Ok(self.folded(node))
    }

    /// The box of a grid, which need not lie along the axes, in space.
    fn grid_box(&mut self, id: hir::GridId) -> Option<(NodeId, NodeId)> {
        let header = &self.scene.grids.get(id.0 as usize)?.header;
        let m = &header.world_from_index;
        let scale = self.units.scale(1.0);
        let (mut min, mut max) = ([0.0; 3], [0.0; 3]);
        for i in 0..3 {
            let middle: f64 = (0..3).map(|j| m[i][j] * (f64::from(header.dims[j]) - 1.0) / 2.0).sum::<f64>() + m[i][3];
            let half: f64 = (0..3).map(|j| m[i][j].abs() * f64::from(header.dims[j]) / 2.0).sum();
            (min[i], max[i]) = ((middle - half) * scale, (middle + half) * scale);
        }
        inverse(header)?;
        Some((self.graph.vector(&min), self.graph.vector(&max)))
    }

    /// The bounding box of a shape in the space it is written in; `None` if it has none. Of an intersection, the box of
    /// its bounded parts; of a difference, that of its first part.
    fn node_box(&mut self, shape: &Shape) -> Option<(NodeId, NodeId)> {
        let around = |this: &mut Self, center: NodeId, half: NodeId| {
            Some((this.graph.sub(center, half), this.graph.add(center, half)))
        };
        match shape {
            Shape::Everywhere => None,
            Shape::Primitive(p) => match p.kind {
                PrimitiveKind::Sphere { center, radius: half }
                | PrimitiveKind::Ellipsoid { center, radii: half }
                | PrimitiveKind::Shell { center, outer: half, .. } => around(self, center, half),
                PrimitiveKind::Box { min, max } => match &p.from_world {
                    None => Some((min, max)),
                    Some(affine) => {
                        let corners = self.constant_box(min, max, affine)?;
                        Some((self.graph.vector(&corners.0), self.graph.vector(&corners.1)))
                    }
                },
                PrimitiveKind::Cylinder { from, to, radius } => {
                    // A disc with normal n reaches radius · sqrt(1 − n²) along each axis.
                    let axis = self.graph.sub(to, from);
                    let unit = self.normalize(axis);
                    let g = &mut self.graph;
                    let (one, zero) = (g.scalar(1.0), g.scalar(0.0));
                    let square = g.mul(unit, unit);
                    let rest = g.sub(one, square);
                    let rest = g.binary(Binary::Max, rest, zero);
                    let root = g.unary(Unary::Sqrt, rest);
                    let reach = g.mul(radius, root);
                    let (low, high) = (g.binary(Binary::Min, from, to), g.binary(Binary::Max, from, to));
                    Some((g.sub(low, reach), g.add(high, reach)))
                }
                PrimitiveKind::Slab { .. } | PrimitiveKind::Sdf { .. } => None,
            },
            Shape::Union(parts) => self.merge(parts, true),
            Shape::Intersection(parts) => self.merge(parts, false),
            Shape::Difference(first, _) => self.node_box(first),
        }
    }

    fn merge(&mut self, parts: &[Shape], union: bool) -> Option<(NodeId, NodeId)> {
        let mut all: Option<(NodeId, NodeId)> = None;
        for part in parts {
            let Some((min, max)) = self.node_box(part) else {
                if union {
                    return None;
                }
                continue;
            };
            let (lower, upper) = if union { (Binary::Min, Binary::Max) } else { (Binary::Max, Binary::Min) };
            all = Some(match all {
                None => (min, max),
                Some((a, b)) => (self.graph.binary(lower, a, min), self.graph.binary(upper, b, max)),
            });
        }
        all
    }

    /// The box in space of a constant box in its own space.
    fn constant_box(&mut self, min: NodeId, max: NodeId, affine: &Affine) -> Option<Corners> {
        let mut get = |id| self.constant(id).map(|c| [c.get(0), c.get(1), c.get(2)]);
        let rows = [get(affine.rows[0])?, get(affine.rows[1])?, get(affine.rows[2])?];
        let (offset, min, max) = (get(affine.offset)?, get(min)?, get(max)?);
        oriented(min, max, &rows, offset)
    }

    /// The box of all bounded media in the world, as numbers at the params' defaults.
    pub(super) fn bounds(&mut self, shapes: &[Shape]) -> Option<Corners> {
        let mut primitives = vec![];
        shapes.iter().for_each(|s| s.primitives(&mut primitives));
        let mut nodes = vec![];
        for primitive in primitives {
            if !matches!(primitive.kind, PrimitiveKind::Sdf { .. }) {
                primitive.clone().map_nodes(&mut |id| {
                    nodes.push(id);
                    id
                });
            }
        }
        let tiers = self.graph.tiers();
        if nodes.iter().any(|n| tiers[n.0 as usize] > Tier::Frame) {
            return None;
        }
        let values = eval::evaluate_frame(&self.graph, &nodes, &self.defaults(), 0.0);
        let values = Values(nodes.into_iter().zip(values).collect());
        let boxes: Vec<Corners> = shapes.iter().filter_map(|s| values.corners(s)).collect();
        let all = boxes.into_iter().reduce(|a, b| join(a, b, true))?;
        let sound = all.0.iter().zip(&all.1).all(|(a, b)| a.is_finite() && b.is_finite() && a <= b);
        sound.then_some(all)
    }
}

fn primitive(kind: PrimitiveKind, from_world: Option<Affine>, span: Span) -> Shape {
    Shape::Primitive(Primitive { kind, from_world, span: Some(span) })
}

fn join(a: Corners, b: Corners, union: bool) -> Corners {
    let pick = |x: [f64; 3], y: [f64; 3], lower: bool| {
        std::array::from_fn(|i| if lower { x[i].min(y[i]) } else { x[i].max(y[i]) })
    };
    (pick(a.0, b.0, union), pick(a.1, b.1, !union))
}

/// The box around a box that is given in a space of its own.
fn oriented(min: [f64; 3], max: [f64; 3], rows: &[[f64; 3]; 3], offset: [f64; 3]) -> Option<Corners> {
    let world = invert(rows)?;
    let middle: [f64; 3] = std::array::from_fn(|i| 0.5 * (min[i] + max[i]) - offset[i]);
    let half: [f64; 3] = std::array::from_fn(|i| 0.5 * (max[i] - min[i]).abs());
    let center = world.map(|r| r[0] * middle[0] + r[1] * middle[1] + r[2] * middle[2]);
    let reach = world.map(|r| r[0].abs() * half[0] + r[1].abs() * half[1] + r[2].abs() * half[2]);
    Some((std::array::from_fn(|i| center[i] - reach[i]), std::array::from_fn(|i| center[i] + reach[i])))
}

/// The box around an ellipsoid along the axes of a space of its own.
fn rounded(center: [f64; 3], radii: [f64; 3], rows: &[[f64; 3]; 3], offset: [f64; 3]) -> Option<Corners> {
    let world = invert(rows)?;
    let own: [f64; 3] = std::array::from_fn(|i| center[i] - offset[i]);
    let middle = world.map(|r| r[0] * own[0] + r[1] * own[1] + r[2] * own[2]);
    let reach = world.map(|r| (0..3).map(|j| (r[j] * radii[j]).powi(2)).sum::<f64>().sqrt());
    Some((std::array::from_fn(|i| middle[i] - reach[i]), std::array::from_fn(|i| middle[i] + reach[i])))
}

/// Evaluated nodes of shapes.
struct Values(FxHashMap<NodeId, Vec<f64>>);

impl Values {
    fn scalar(&self, id: NodeId) -> Option<f64> {
        self.0.get(&id)?.first().copied()
    }

    fn vector(&self, id: NodeId) -> Option<[f64; 3]> {
        self.0.get(&id)?.first_chunk::<3>().copied()
    }

    fn corners(&self, shape: &Shape) -> Option<Corners> {
        match shape {
            Shape::Everywhere => None,
            Shape::Primitive(p) => self.primitive(p),
            Shape::Union(parts) => {
                let boxes: Option<Vec<Corners>> = parts.iter().map(|s| self.corners(s)).collect();
                boxes?.into_iter().reduce(|a, b| join(a, b, true))
            }
            Shape::Intersection(parts) => parts.iter().filter_map(|s| self.corners(s)).reduce(|a, b| join(a, b, false)),
            Shape::Difference(first, _) => self.corners(first),
        }
    }

    fn primitive(&self, p: &Primitive) -> Option<Corners> {
        let (rows, offset) = match &p.from_world {
            None => ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]),
            Some(a) => {
                ([self.vector(a.rows[0])?, self.vector(a.rows[1])?, self.vector(a.rows[2])?], self.vector(a.offset)?)
            }
        };
        match p.kind {
            PrimitiveKind::Sphere { center, radius } | PrimitiveKind::Shell { center, outer: radius, .. } => {
                rounded(self.vector(center)?, [self.scalar(radius)?; 3], &rows, offset)
            }
            PrimitiveKind::Ellipsoid { center, radii } => {
                rounded(self.vector(center)?, self.vector(radii)?, &rows, offset)
            }
            PrimitiveKind::Box { min, max } => oriented(self.vector(min)?, self.vector(max)?, &rows, offset),
            PrimitiveKind::Cylinder { from, to, radius } => {
                let (a, b, r) = (self.vector(from)?, self.vector(to)?, self.scalar(radius)?.abs());
                let axis: [f64; 3] = std::array::from_fn(|i| b[i] - a[i]);
                let length = axis.iter().map(|v| v * v).sum::<f64>().sqrt();
                let reach = axis.map(|v| r * (1.0 - (v / length).powi(2)).max(0.0).sqrt());
                let min = std::array::from_fn(|i| a[i].min(b[i]) - reach[i]);
                let max = std::array::from_fn(|i| a[i].max(b[i]) + reach[i]);
                oriented(min, max, &rows, offset)
            }
            PrimitiveKind::Slab { .. } | PrimitiveKind::Sdf { .. } => None,
        }
    }
}
