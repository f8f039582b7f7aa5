//! Transforms, and what a medium's fields see of the world: its own position, direction and altitude.

use super::{Lowered, Lowerer, Value};
use crate::check::hir::{self, Builtin};
use crate::diagnostic::Diagnostic;
use crate::ir::{Affine, Graph, GridId, GridInfo, Input, NodeId, Op, PrimitiveKind, Shape, Unary};
use crate::loader::GridHeader;
use crate::source::Span;

/// How a transform changes lengths.
#[derive(Copy, Clone, Debug)]
pub(super) enum Stretch {
    /// Not at all.
    None,
    /// By this factor in all directions.
    Even(NodeId),
    /// Differently in different directions.
    Uneven,
}

/// A map of space, with its inverse, which is known in closed form for every transform of the language.
#[derive(Clone, Debug)]
pub(super) struct Transform {
    pub(super) forward: Affine,
    pub(super) inverse: Affine,
    pub(super) stretch: Stretch,
}

/// What the fields of a medium see.
#[derive(Clone, Debug)]
pub(super) struct Space {
    /// `p`
    pub(super) position: NodeId,
    /// `dir`
    pub(super) direction: NodeId,
    /// From the medium's own space to the world.
    pub(super) transform: Option<Transform>,
    /// Centre and inner radius of the medium's `shell`, in its own space.
    pub(super) shell: Option<(NodeId, NodeId)>,
}

impl Space {
    pub(super) fn world(graph: &mut Graph) -> Self {
        Self {
            position: graph.input(Input::Position),
            direction: graph.input(Input::Direction),
            transform: None,
            shell: None,
        }
    }
}

impl<'s> Lowerer<'s, '_> {
    /// Makes the space of a medium the current one.
    pub(super) fn enter_space(&mut self, transform: Option<Transform>) {
        self.space_number += 1;
        let mut space = Space::world(&mut self.graph);
        if let Some(transform) = transform {
            space.position = self.apply(&transform.inverse, space.position);
            if !self.is_identity(&transform.inverse) {
                let rows = transform.inverse.rows.map(|row| self.graph.dot(row, space.direction));
                let turned = self.graph.compose(&rows);
                space.direction = self.normalize(turned);
            }
            space.transform = Some(transform);
        }
        self.space = space;
    }

    /// The first `shell` of a medium's shape, in its own space, is the one that `h` measures from.
    pub(super) fn find_shell(&mut self, shape: &Shape) {
        let mut primitives = vec![];
        shape.primitives(&mut primitives);
        self.space.shell = primitives.iter().find_map(|p| match p.kind {
            PrimitiveKind::Shell { center, inner, .. } => Some((center, inner)),
            _ => None,
        });
    }

    /// Makes the world the current space.
    pub(super) fn leave_space(&mut self) {
        self.space_number += 1;
        self.space = Space::world(&mut self.graph);
    }

    /// `h`
    pub(super) fn altitude(&mut self, span: Span) -> Lowered<NodeId> {
        let Some((center, inner)) = self.space.shell else {
            return self.report(
                Diagnostic::error("E0511", "`h` is the altitude inside a `shell`, and this medium has none")
                    .at(span, "there is nothing to measure the altitude from")
                    .hint("give the medium `shape = shell(center: …, inner: …, outer: …)`, or write `p.y`"),
            );
        };
        let (center, inner, factor) = match self.space.transform.clone() {
            None => (center, inner, None),
            Some(transform) => {
                let center = self.apply(&transform.forward, center);
                match transform.stretch {
                    Stretch::None => (center, inner, None),
                    Stretch::Even(factor) => {
                        let size = self.graph.unary(Unary::Abs, factor);
                        let size = self.folded(size);
                        (center, self.graph.mul(inner, size), Some(size))
                    }
                    Stretch::Uneven => {
                        return self.report(
                            Diagnostic::error("E0511", "`h` has no meaning in a shell that is scaled unevenly")
                                .at(span, "the altitude over an ellipsoid is not defined")
                                .hint("scale the medium by one number"),
                        );
                    }
                }
            }
        };
        let shell = (self.folded(center), self.folded(inner));
        let index = match self.shells.iter().position(|s| *s == shell) {
            Some(index) => index,
            None => {
                self.shells.push(shell);
                self.shells.len() - 1
            }
        };
        let altitude = self.graph.input(Input::Altitude(index as u32));
        Ok(match factor {
            Some(factor) => self.graph.div(altitude, factor),
            None => altitude,
        })
    }

    /// The gradient of the altitude in the world with respect to the medium's own `p`, if `h` is asked for at all.
    pub(super) fn altitude_gradient(&mut self) -> Option<(u32, NodeId)> {
        let (center, _) = self.space.shell?;
        // The index of this medium's shell; asking for `h` again finds it.
        let span = Span { source: crate::source::SourceId(0), start: 0, end: 0 };
        let uneven = self.space.transform.as_ref().is_some_and(|t| matches!(t.stretch, Stretch::Uneven));
        if uneven || self.shells.is_empty() {
            return None;
        }
        let shells = self.shells.len();
        let altitude = self.altitude(span).ok()?;
        if self.shells.len() != shells {
            self.shells.truncate(shells);
            return None;
        }
        let (index, factor) = match *self.graph.op(altitude) {
            Op::Input(Input::Altitude(index)) => (index, None),
            Op::Binary(_, input, factor) => match *self.graph.op(input) {
                Op::Input(Input::Altitude(index)) => (index, Some(factor)),
                _ => return None,
            },
            _ => return None,
        };
        let outward = self.graph.sub(self.space.position, center);
        let unit = self.normalize(outward);
        Some((index, factor.map_or(unit, |f| self.graph.mul(unit, f))))
    }

    /// `translate`, `rotate`, `scale`
    pub(super) fn transform(&mut self, builtin: Builtin, arguments: &'s [hir::Expr]) -> Lowered<Transform> {
        const WHAT: &str = "a transform";
        let mut nodes = vec![];
        for argument in arguments {
            let node = self.node(argument)?;
            let node = self.folded(node);
            self.per_frame(node, argument.span, WHAT);
            nodes.push(node);
        }
        let span = arguments[0].span;
        let identity = self.identity_rows();
        let zero = self.graph.vector(&[0.0; 3]);
        match builtin {
            Builtin::Translate => {
                let offset = self.three(nodes[0], span)?;
                let back = self.graph.unary(Unary::Neg, offset);
                let back = self.folded(back);
                Ok(Transform {
                    forward: Affine { rows: identity, offset },
                    inverse: Affine { rows: identity, offset: back },
                    stretch: Stretch::None,
                })
            }
            Builtin::Rotate => {
                let axis = self.three(nodes[0], span)?;
                self.nonzero.push((axis, span, "the axis of a rotation"));
                let (forward, inverse) = self.rotation(axis, nodes[1]);
                Ok(Transform {
                    forward: Affine { rows: forward, offset: zero },
                    inverse: Affine { rows: inverse, offset: zero },
                    stretch: Stretch::None,
                })
            }
            Builtin::Scale => {
                let factors = self.graph.widen(nodes[0], 3);
                let factors = self.three(factors, span)?;
                let stretch = if self.graph.width(nodes[0]) == 1 { Stretch::Even(nodes[0]) } else { Stretch::Uneven };
                let (none, one) = (self.graph.scalar(0.0), self.graph.scalar(1.0));
                let (mut forward, mut inverse) = (identity, identity);
                for i in 0..3 {
                    let factor = self.graph.extract(factors, i);
                    let factor = self.folded(factor);
                    self.nonzero.push((factor, span, "a factor of a scale"));
                    let reverse = self.graph.div(one, factor);
                    let reverse = self.folded(reverse);
                    let row = |this: &mut Self, value| {
                        let mut parts = [none; 3];
                        parts[i as usize] = value;
                        this.vector(&parts)
                    };
                    forward[i as usize] = row(self, factor);
                    inverse[i as usize] = row(self, reverse);
                }
                Ok(Transform {
                    forward: Affine { rows: forward, offset: zero },
                    inverse: Affine { rows: inverse, offset: zero },
                    stretch,
                })
            }
            _ => self.broken_promise(span, "this is no transform"),
        }
    }

    pub(super) fn three(&mut self, node: NodeId, span: Span) -> Lowered<NodeId> {
        let node = self.graph.widen(node, 3);
        if self.graph.width(node) == 3 { Ok(node) } else { self.broken_promise(span, "a vec3 is expected here") }
    }

    /// Rodrigues' formula: rows of the rotation about an axis, and of its inverse, which is the transpose.
    fn rotation(&mut self, axis: NodeId, angle: NodeId) -> ([NodeId; 3], [NodeId; 3]) {
        let unit = self.normalize(axis);
        let g = &mut self.graph;
        let (cos, sin, one) = (g.unary(Unary::Cos, angle), g.unary(Unary::Sin, angle), g.scalar(1.0));
        let rest = g.sub(one, cos);
        let mut m = [[one; 3]; 3];
        for i in 0..3u8 {
            for j in 0..3u8 {
                let (ui, uj) = (g.extract(unit, i), g.extract(unit, j));
                let product = g.mul(ui, uj);
                let shared = g.mul(rest, product);
                // The cross-product matrix of the axis: −u_k above, +u_k below the diagonal, cyclically.
                let entry = if i == j {
                    g.add(cos, shared)
                } else {
                    let uk = g.extract(unit, 3 - i - j);
                    let turn = g.mul(sin, uk);
                    if (i + 1) % 3 == j { g.sub(shared, turn) } else { g.add(shared, turn) }
                };
                m[i as usize][j as usize] = entry;
            }
        }
        let mut rows = |m: [[NodeId; 3]; 3]| {
            m.map(|row| {
                let parts = row.map(|entry| self.folded(entry));
                self.vector(&parts)
            })
        };
        let forward = rows(m);
        let inverse = rows([0, 1, 2].map(|i| [m[0][i], m[1][i], m[2][i]]));
        (forward, inverse)
    }

    fn identity_rows(&mut self) -> [NodeId; 3] {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|row| self.graph.vector(&row))
    }

    fn is_identity(&mut self, affine: &Affine) -> bool {
        affine.rows == self.identity_rows()
    }

    /// `rows · x + offset`
    pub(super) fn apply(&mut self, affine: &Affine, x: NodeId) -> NodeId {
        let turned = if self.is_identity(affine) {
            x
        } else {
            let parts = affine.rows.map(|row| self.graph.dot(row, x));
            self.graph.compose(&parts)
        };
        if self.number(affine.offset) == Some(0.0) { turned } else { self.graph.add(turned, affine.offset) }
    }

    /// First `inner`, then `outer`.
    pub(super) fn compose_affine(&mut self, outer: &Affine, inner: &Affine) -> Affine {
        let rows = outer.rows.map(|row| {
            let mut sum = None;
            for (i, other) in inner.rows.iter().enumerate() {
                let entry = self.graph.extract(row, i as u8);
                let term = self.graph.mul(entry, *other);
                sum = Some(sum.map_or(term, |sum| self.graph.add(sum, term)));
            }
            let sum = sum.unwrap_or(row);
            self.folded(sum)
        });
        let offset = self.apply(outer, inner.offset);
        Affine { rows, offset: self.folded(offset) }
    }

    /// `a * b`: first b, then a.
    pub(super) fn compose_transforms(&mut self, a: &Transform, b: &Transform) -> Transform {
        let stretch = match (a.stretch, b.stretch) {
            (Stretch::Uneven, _) | (_, Stretch::Uneven) => Stretch::Uneven,
            (Stretch::None, other) | (other, Stretch::None) => other,
            (Stretch::Even(x), Stretch::Even(y)) => {
                let product = self.graph.mul(x, y);
                Stretch::Even(self.folded(product))
            }
        };
        Transform {
            forward: self.compose_affine(&a.forward, &b.forward),
            inverse: self.compose_affine(&b.inverse, &a.inverse),
            stretch,
        }
    }

    /// The value of an expression that is a transform.
    pub(super) fn as_transform(&mut self, expr: &'s hir::Expr) -> Lowered<Transform> {
        match self.value(expr)? {
            Value::Transform(transform) => Ok(*transform),
            _ => self.broken_promise(expr.span, "a transform is expected here"),
        }
    }

    /// The graph's grids are the scene's, in order.
    pub(super) fn declare_grids(&mut self) {
        let grids = self.scene.grids.iter().map(|grid| GridInfo {
            name: grid.name.clone(),
            span: Some(grid.span),
            path: grid.path.clone(),
            from: grid.from.clone(),
            header: grid.header.clone(),
            filter: grid.filter,
            outside: grid.outside,
        });
        self.graph.grids = grids.collect();
    }

    /// From space, in units of length, to the voxel indices of a grid.
    pub(super) fn index_from_space(&mut self, id: hir::GridId, span: Span) -> Lowered<Affine> {
        let scene = self.scene;
        let Some(grid) = scene.grids.get(id.0 as usize) else {
            return self.broken_promise(span, "an unknown grid");
        };
        let Some((rows, offset)) = inverse(&grid.header) else {
            return self.report(
                Diagnostic::error("E0515", format!("the grid `{}` has no volume", grid.name))
                    .at(grid.span, "the axes of its voxels lie in a plane")
                    .note("its header gives an orientation that cannot be inverted"),
            );
        };
        let unit = self.units.length;
        let rows = rows.map(|row| self.graph.vector(&row.map(|v| v * unit)));
        Ok(Affine { rows, offset: self.graph.vector(&offset) })
    }

    /// A grid at a position.
    pub(super) fn sample(&mut self, id: hir::GridId, position: NodeId, span: Span) -> Lowered<NodeId> {
        let affine = self.index_from_space(id, span)?;
        let position = self.three(position, span)?;
        let parts = affine.rows.map(|row| self.graph.dot(row, position));
        let turned = self.graph.compose(&parts);
        let at = self.graph.add(turned, affine.offset);
        let value = self.graph.push(Op::Sample { grid: GridId(id.0), at });
        self.name(value, &self.graph.grid(GridId(id.0)).name.clone());
        Ok(value)
    }
}

/// Rows and offset of the map from metres to voxel indices.
pub(super) fn inverse(header: &GridHeader) -> Option<([[f64; 3]; 3], [f64; 3])> {
    let m = &header.world_from_index;
    let linear: [[f64; 3]; 3] = std::array::from_fn(|i| [m[i][0], m[i][1], m[i][2]]);
    let rows = invert(&linear)?;
    let shift = [m[0][3], m[1][3], m[2][3]];
    let offset = rows.map(|row| -(row[0] * shift[0] + row[1] * shift[1] + row[2] * shift[2]));
    offset.iter().all(|v| v.is_finite()).then_some((rows, offset))
}

/// The inverse of a 3×3 matrix by cofactors.
pub(super) fn invert(m: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let det: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    if det == 0.0 || !det.is_finite() {
        return None;
    }
    let rows: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| cofactor(j, i) / det));
    rows.iter().flatten().all(|v| v.is_finite()).then_some(rows)
}
