//! The prelude: mathematics, vectors, spectra, derivatives. Regions are in `shape`, transforms in `space`.

use super::mie::Mie;
use super::{Lowered, Lowerer, MAX_NODES, MAX_VISITS, Value};
use crate::check::hir::{self, Builtin, Type};
use crate::diagnostic::Diagnostic;
use crate::ir::derive::{self, MAX_UNROLL, Unsupported};
use crate::ir::{Binary, Compare, Fold, NodeId, Op, Unary};
use crate::source::Span;
use std::f64::consts::{LN_2, LN_10};

impl<'s> Lowerer<'s, '_> {
    pub(super) fn builtin(
        &mut self,
        expr: &'s hir::Expr,
        builtin: Builtin,
        arguments: &'s [hir::Expr],
    ) -> Lowered<Value> {
        let span = expr.span;
        if arguments.len() < least_arguments(builtin) {
            return self.broken_promise(span, "an argument is missing");
        }
        match builtin {
            Builtin::Sphere
            | Builtin::Ellipsoid
            | Builtin::Box
            | Builtin::Slab
            | Builtin::Cylinder
            | Builtin::Shell
            | Builtin::Bounds
            | Builtin::Sdf
            | Builtin::Everywhere
            | Builtin::Union
            | Builtin::Intersection
            | Builtin::Difference => self.region(span, builtin, arguments).map(Value::Shape),
            Builtin::Center | Builtin::MinCorner | Builtin::MaxCorner | Builtin::Size => {
                self.extent(span, builtin, &arguments[0]).map(Value::Node)
            }
            Builtin::Translate | Builtin::Rotate | Builtin::Scale => {
                self.transform(builtin, arguments).map(|t| Value::Transform(Box::new(t)))
            }
            Builtin::Mie => self.mie(span, Mie::Phase, arguments).map(Value::Node),
            Builtin::MieScattering => self.mie(span, Mie::Scattering, arguments).map(Value::Node),
            Builtin::MieAbsorption => self.mie(span, Mie::Absorption, arguments).map(Value::Node),
            Builtin::MieExtinction => self.mie(span, Mie::Extinction, arguments).map(Value::Node),
            Builtin::Layer => {
                let color = self.node(&arguments[0])?;
                let k = self.scalar(&arguments[1])?;
                Ok(Value::Layer { color: self.graph.widen(color, 3), k })
            }
            Builtin::Exp
            | Builtin::Expm1
            | Builtin::Log
            | Builtin::Log2
            | Builtin::Log10
            | Builtin::Exp2
            | Builtin::Sqrt
            | Builtin::Cbrt
            | Builtin::Sin
            | Builtin::Cos
            | Builtin::Tan
            | Builtin::Asin
            | Builtin::Acos
            | Builtin::Atan
            | Builtin::Sinh
            | Builtin::Cosh
            | Builtin::Tanh
            | Builtin::Abs
            | Builtin::Sign
            | Builtin::Floor
            | Builtin::Ceil
            | Builtin::Round
            | Builtin::Fract
            | Builtin::Atan2
            | Builtin::Min
            | Builtin::Max
            | Builtin::Pow
            | Builtin::Mod
            | Builtin::Clamp
            | Builtin::Mix
            | Builtin::Step
            | Builtin::Smoothstep
            | Builtin::Dot
            | Builtin::Cross
            | Builtin::Length
            | Builtin::Distance
            | Builtin::Normalize
            | Builtin::Reflect
            | Builtin::Vec2
            | Builtin::Vec3
            | Builtin::Rgb
            | Builtin::Luminance
            | Builtin::Color
            | Builtin::Opacity
            | Builtin::Gradient
            | Builtin::CellHash3
            | Builtin::CellHash => {
                let mut nodes = vec![];
                for argument in arguments {
                    let node = self.node(argument)?;
                    if self.graph.ty(node) == crate::ir::Type::Bool {
                        return self.broken_promise(argument.span, "a number is expected here");
                    }
                    // A colour among spectra becomes one.
                    let convert = argument.ty == Type::Color && matches!(expr.ty, Type::Spectrum(_));
                    nodes.push(if convert { self.color_to_spectrum(node) } else { node });
                }
                if builtin == Builtin::Gradient {
                    return self.gradient(span, nodes[0], nodes[1]).map(Value::Node);
                }
                self.mathematics(span, builtin, &nodes).map(Value::Node)
            }
        }
    }

    fn mathematics(&mut self, span: Span, builtin: Builtin, a: &[NodeId]) -> Lowered<NodeId> {
        let g = &mut self.graph;
        Ok(match builtin {
            Builtin::Exp => g.unary(Unary::Exp, a[0]),
            Builtin::Expm1 => g.unary(Unary::Expm1, a[0]),
            Builtin::Log => g.unary(Unary::Log, a[0]),
            Builtin::Log2 => {
                let (log, base) = (g.unary(Unary::Log, a[0]), g.scalar(LN_2));
                g.div(log, base)
            }
            Builtin::Log10 => {
                let (log, base) = (g.unary(Unary::Log, a[0]), g.scalar(LN_10));
                g.div(log, base)
            }
            Builtin::Exp2 => {
                let two = g.scalar(2.0);
                g.binary(Binary::Pow, two, a[0])
            }
            Builtin::Sqrt => g.unary(Unary::Sqrt, a[0]),
            Builtin::Cbrt => {
                let (sign, abs, third) = (g.unary(Unary::Sign, a[0]), g.unary(Unary::Abs, a[0]), g.scalar(1.0 / 3.0));
                let root = g.binary(Binary::Pow, abs, third);
                g.mul(sign, root)
            }
            Builtin::Sin => g.unary(Unary::Sin, a[0]),
            Builtin::Cos => g.unary(Unary::Cos, a[0]),
            Builtin::Tan => g.unary(Unary::Tan, a[0]),
            Builtin::Asin => g.unary(Unary::Asin, a[0]),
            Builtin::Acos => g.unary(Unary::Acos, a[0]),
            Builtin::Atan => g.unary(Unary::Atan, a[0]),
            Builtin::Sinh => g.unary(Unary::Sinh, a[0]),
            Builtin::Cosh => g.unary(Unary::Cosh, a[0]),
            Builtin::Tanh => g.unary(Unary::Tanh, a[0]),
            Builtin::Abs => g.unary(Unary::Abs, a[0]),
            Builtin::Sign => g.unary(Unary::Sign, a[0]),
            Builtin::Floor => g.unary(Unary::Floor, a[0]),
            Builtin::Ceil => g.unary(Unary::Ceil, a[0]),
            Builtin::Round => g.unary(Unary::Round, a[0]),
            Builtin::Fract => {
                let whole = g.unary(Unary::Floor, a[0]);
                g.sub(a[0], whole)
            }
            Builtin::Atan2 => self.binary(Binary::Atan2, a[0], a[1], span)?,
            Builtin::Mod => self.binary(Binary::Mod, a[0], a[1], span)?,
            Builtin::Pow => self.power(a[0], a[1], span)?,
            Builtin::Min | Builtin::Max => {
                let op = if builtin == Builtin::Min { Binary::Min } else { Binary::Max };
                let mut value = a[0];
                for next in &a[1..] {
                    value = self.binary(op, value, *next, span)?;
                }
                value
            }
            Builtin::Clamp => {
                let low = self.binary(Binary::Max, a[0], a[1], span)?;
                self.binary(Binary::Min, low, a[2], span)?
            }
            Builtin::Mix => {
                // a·(1 − t) + b·t, which is exact at both ends.
                let one = self.graph.scalar(1.0);
                let rest = self.binary(Binary::Sub, one, a[2], span)?;
                let left = self.binary(Binary::Mul, a[0], rest, span)?;
                let right = self.binary(Binary::Mul, a[1], a[2], span)?;
                self.binary(Binary::Add, left, right, span)?
            }
            Builtin::Step => self.step(span, a[0], a[1])?,
            Builtin::Smoothstep => {
                let above = self.binary(Binary::Sub, a[2], a[0], span)?;
                let range = self.binary(Binary::Sub, a[1], a[0], span)?;
                let ratio = self.binary(Binary::Div, above, range, span)?;
                let g = &mut self.graph;
                let (zero, one) = (g.scalar(0.0), g.scalar(1.0));
                let low = g.binary(Binary::Max, ratio, zero);
                let t = g.binary(Binary::Min, low, one);
                let (two, three) = (g.scalar(2.0), g.scalar(3.0));
                let (square, double) = (g.mul(t, t), g.mul(two, t));
                let rest = g.sub(three, double);
                g.mul(square, rest)
            }
            Builtin::Dot => self.dot(a[0], a[1], span)?,
            Builtin::Cross => {
                if a.iter().any(|n| self.graph.width(*n) != 3) {
                    return self.broken_promise(span, "a cross product needs two vec3");
                }
                let g = &mut self.graph;
                let mut parts = [a[0]; 3];
                for (i, part) in parts.iter_mut().enumerate() {
                    let (j, k) = ((i as u8 + 1) % 3, (i as u8 + 2) % 3);
                    let (aj, bk) = (g.extract(a[0], j), g.extract(a[1], k));
                    let (ak, bj) = (g.extract(a[0], k), g.extract(a[1], j));
                    let (left, right) = (g.mul(aj, bk), g.mul(ak, bj));
                    *part = g.sub(left, right);
                }
                g.compose(&parts)
            }
            Builtin::Length => self.length(a[0]),
            Builtin::Distance => {
                let difference = self.binary(Binary::Sub, a[0], a[1], span)?;
                self.length(difference)
            }
            Builtin::Normalize => self.normalize(a[0]),
            Builtin::Reflect => {
                let along = self.dot(a[1], a[0], span)?;
                let two = self.graph.scalar(2.0);
                let twice = self.graph.mul(two, along);
                let back = self.graph.mul(twice, a[1]);
                self.binary(Binary::Sub, a[0], back, span)?
            }
            Builtin::Vec2 | Builtin::Vec3 | Builtin::Color => {
                let count = if builtin == Builtin::Vec2 { 2 } else { 3 };
                if a[..count].iter().any(|n| self.graph.width(*n) != 1) {
                    return self.broken_promise(span, "the parts of a vector are single numbers");
                }
                self.vector(&a[..count])
            }
            Builtin::Rgb => {
                if a[..3].iter().any(|n| self.graph.width(*n) != 1) {
                    return self.broken_promise(span, "the parts of a spectrum are single numbers");
                }
                self.rgb([a[0], a[1], a[2]])
            }
            Builtin::Luminance => {
                let color = self.graph.widen(a[0], 3);
                self.luminance(color)
            }
            Builtin::Opacity => {
                // An opacity of `a` over the length `per` is the extinction −ln(1 − a) / per.
                let one = self.graph.scalar(1.0);
                let rest = self.binary(Binary::Sub, one, a[0], span)?;
                let log = self.graph.unary(Unary::Log, rest);
                let depth = self.graph.unary(Unary::Neg, log);
                self.binary(Binary::Div, depth, a[1], span)?
            }
            Builtin::CellHash3 | Builtin::CellHash => {
                let cell = self.graph.widen(a[0], 3);
                if self.graph.width(cell) != 3 || self.graph.width(a[1]) != 1 {
                    return self.broken_promise(span, "a hash needs a vec3 and a number");
                }
                let hash = self.graph.push(Op::CellHash { cell, seed: a[1] });
                if builtin == Builtin::CellHash { self.graph.extract(hash, 0) } else { hash }
            }
            Builtin::Layer
            | Builtin::Gradient
            | Builtin::Mie
            | Builtin::MieScattering
            | Builtin::MieAbsorption
            | Builtin::MieExtinction
            | Builtin::Sphere
            | Builtin::Ellipsoid
            | Builtin::Box
            | Builtin::Slab
            | Builtin::Cylinder
            | Builtin::Shell
            | Builtin::Bounds
            | Builtin::Sdf
            | Builtin::Everywhere
            | Builtin::Union
            | Builtin::Intersection
            | Builtin::Difference
            | Builtin::Center
            | Builtin::MinCorner
            | Builtin::MaxCorner
            | Builtin::Size
            | Builtin::Translate
            | Builtin::Rotate
            | Builtin::Scale => return self.broken_promise(span, "this is no function of numbers"),
        })
    }

    fn dot(&mut self, a: NodeId, b: NodeId, span: Span) -> Lowered<NodeId> {
        let width = self.graph.width(a).max(self.graph.width(b));
        if [a, b].iter().any(|n| ![1, width].contains(&self.graph.width(*n))) {
            return self.broken_promise(span, "the vectors have different numbers of components");
        }
        let (a, b) = (self.graph.widen(a, width), self.graph.widen(b, width));
        Ok(self.graph.dot(a, b))
    }

    pub(super) fn length(&mut self, v: NodeId) -> NodeId {
        if self.graph.width(v) == 1 {
            return self.graph.unary(Unary::Abs, v);
        }
        let square = self.graph.dot(v, v);
        self.graph.unary(Unary::Sqrt, square)
    }

    pub(super) fn normalize(&mut self, v: NodeId) -> NodeId {
        let length = self.length(v);
        self.graph.div(v, length)
    }

    /// 0 below the edge, 1 from it on; component by component.
    fn step(&mut self, span: Span, edge: NodeId, x: NodeId) -> Lowered<NodeId> {
        let (zero, one) = (self.graph.scalar(0.0), self.graph.scalar(1.0));
        let width = self.graph.width(edge).max(self.graph.width(x));
        let mut parts = vec![];
        for i in 0..width {
            let (e, v) = (self.graph.extract(edge, i), self.graph.extract(x, i));
            let below = self.compare(Compare::Less, v, e, span)?;
            parts.push(self.graph.select(below, zero, one));
        }
        Ok(self.graph.compose(&parts))
    }

    fn gradient(&mut self, span: Span, f: NodeId, x: NodeId) -> Lowered<NodeId> {
        let key = (self.space_number, f, x);
        if let Some(done) = self.gradients.get(&key) {
            return Ok(*done);
        }
        let altitudes: Vec<(u32, NodeId)> =
            if x == self.space.position { self.altitude_gradient().into_iter().collect() } else { vec![] };
        let mut budget =
            derive::Budget { nodes: MAX_NODES + self.free_nodes, visits: MAX_VISITS.saturating_sub(self.visits) };
        let before = budget.visits;
        let result = derive::gradient_with(&mut self.graph, f, x, &altitudes, &mut budget);
        self.visits += before - budget.visits;
        let diagnostic = match result {
            Ok(node) => {
                self.gradients.insert(key, node);
                return Ok(node);
            }
            Err(Unsupported::SecondDerivativeOfGrid(grid)) => {
                let name = self.graph.grid(grid).name.clone();
                Diagnostic::error("E0506", format!("the second derivative of the grid `{name}` is not defined"))
                    .at(span, "this differentiates something that already is a derivative of the grid")
                    .note("between voxels a grid is interpolated, and the slope of the interpolant has corners")
                    .hint("take differences of `gradient` at two places instead")
            }
            Err(Unsupported::LongFold(fold)) => {
                let word = match fold {
                    Fold::Sum => "sum",
                    Fold::Product => "product",
                    Fold::Min => "min",
                    Fold::Max => "max",
                };
                Diagnostic::error("E0506", format!("the derivative of this `{word}` is too long"))
                    .at(span, format!("it holds a `{word}` over more than {MAX_UNROLL} values"))
                    .hint(format!("shorten its range to at most {MAX_UNROLL}"))
            }
            Err(Unsupported::Altitude) => {
                Diagnostic::error("E0506", "the altitude `h` can only be differentiated with respect to `p`")
                    .at(span, "this holds `h`")
                    .hint("write the altitude as a function of the variable, for example `length(q) - radius`")
            }
            Err(Unsupported::Shape) => {
                return self.broken_promise(span, "a gradient is of a scalar with respect to a vec3");
            }
            Err(Unsupported::TooLarge) => {
                self.exhausted = true;
                Diagnostic::error("E0505", "the scene is too large once its derivatives are written out")
                    .at(span, "the limit was reached here")
                    .hint("differentiate a simpler field")
            }
        };
        self.report(diagnostic)
    }
}

/// Arguments that a call must have at least.
fn least_arguments(builtin: Builtin) -> usize {
    match builtin {
        Builtin::Everywhere => 0,
        Builtin::Exp
        | Builtin::Expm1
        | Builtin::Log
        | Builtin::Log2
        | Builtin::Log10
        | Builtin::Exp2
        | Builtin::Sqrt
        | Builtin::Cbrt
        | Builtin::Sin
        | Builtin::Cos
        | Builtin::Tan
        | Builtin::Asin
        | Builtin::Acos
        | Builtin::Atan
        | Builtin::Sinh
        | Builtin::Cosh
        | Builtin::Tanh
        | Builtin::Abs
        | Builtin::Sign
        | Builtin::Floor
        | Builtin::Ceil
        | Builtin::Round
        | Builtin::Fract
        | Builtin::Min
        | Builtin::Max
        | Builtin::Length
        | Builtin::Normalize
        | Builtin::Luminance
        | Builtin::Bounds
        | Builtin::Sdf
        | Builtin::Union
        | Builtin::Intersection
        | Builtin::Difference
        | Builtin::Center
        | Builtin::MinCorner
        | Builtin::MaxCorner
        | Builtin::Size
        | Builtin::Translate
        | Builtin::Scale => 1,
        Builtin::Atan2
        | Builtin::Pow
        | Builtin::Mod
        | Builtin::Step
        | Builtin::Dot
        | Builtin::Cross
        | Builtin::Distance
        | Builtin::Reflect
        | Builtin::Vec2
        | Builtin::Layer
        | Builtin::Opacity
        | Builtin::Gradient
        | Builtin::CellHash3
        | Builtin::CellHash
        | Builtin::Sphere
        | Builtin::Ellipsoid
        | Builtin::Box
        | Builtin::Rotate => 2,
        Builtin::Clamp
        | Builtin::Mix
        | Builtin::Smoothstep
        | Builtin::Vec3
        | Builtin::Rgb
        | Builtin::Color
        | Builtin::Slab
        | Builtin::Cylinder
        | Builtin::Shell => 3,
        Builtin::MieScattering | Builtin::MieAbsorption | Builtin::MieExtinction => 4,
        Builtin::Mie => 5,
    }
}
