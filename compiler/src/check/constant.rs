//! Values that are known when compiling, in f64: for exponents, structural properties, and for finding what cannot be
//! meant (a negative coefficient, a camera at its own target) before anything is drawn.

use super::Checker;
use super::hir::{Builtin, ConstId, Expr, ExprKind, FunctionId, GridId, LocalId, TableId, TableRows, Type};
use crate::ir::Fold;
use crate::syntax::ast::BinaryOp;
use rustc_hash::FxHashSet;
use std::cell::Cell;

/// One number, or up to three: components of a vector, or the R, G and B that make a spectrum.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) struct Numbers {
    values: [f64; 3],
    width: usize,
    spectrum: bool,
}

/// A value that is known.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Known {
    Numbers(Numbers),
    Color([f64; 4]),
    Bool(bool),
    Layer([f64; 4], f64),
}

impl Numbers {
    pub(super) fn one(value: f64) -> Self {
        Self { values: [value; 3], width: 1, spectrum: false }
    }

    fn many(values: &[f64]) -> Option<Self> {
        let last = *values.last()?;
        let at = |i: usize| values.get(i).copied().unwrap_or(last);
        (values.len() <= 3).then(|| Self { values: [at(0), at(1), at(2)], width: values.len(), spectrum: false })
    }

    /// Its components.
    pub(super) fn all(&self) -> &[f64] {
        &self.values[..self.width]
    }

    /// The value of a scalar.
    pub(super) fn scalar(&self) -> Option<f64> {
        (self.width == 1).then_some(self.values[0])
    }

    /// The components of a vector.
    pub(super) fn vector(&self) -> [f64; 3] {
        self.values
    }

    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self { values: self.values.map(f), ..self }
    }

    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut values = [0.0; 3];
        for (v, (a, b)) in values.iter_mut().zip(self.values.iter().zip(other.values)) {
            *v = f(*a, b);
        }
        Self { values, width: self.width.max(other.width), spectrum: self.spectrum || other.spectrum }
    }
}

/// What an expression cannot be evaluated without.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash)]
enum Need {
    Function(FunctionId),
    Const(ConstId),
    Table(TableId),
}

fn needs(expression: &Expr, out: &mut Vec<Need>) {
    match &expression.kind {
        ExprKind::Number(_)
        | ExprKind::Color(_)
        | ExprKind::Bool(_)
        | ExprKind::String(_)
        | ExprKind::Input(_)
        | ExprKind::Param(_)
        | ExprKind::Local(_)
        | ExprKind::Grid(_)
        | ExprKind::Splats(_) => {}
        ExprKind::Const(id) => out.push(Need::Const(*id)),
        ExprKind::Vector(parts) | ExprKind::Builtin(_, parts) => parts.iter().for_each(|p| needs(p, out)),
        ExprKind::Call(id, parts) => {
            out.push(Need::Function(*id));
            parts.iter().for_each(|p| needs(p, out));
        }
        ExprKind::Lookup(id, key) => {
            out.push(Need::Table(*id));
            needs(key, out);
        }
        ExprKind::Negate(a)
        | ExprKind::Not(a)
        | ExprKind::Sample(_, a)
        | ExprKind::Swizzle(a, _)
        | ExprKind::LayerColor(a)
        | ExprKind::LayerK(a) => needs(a, out),
        ExprKind::Binary(_, a, b) => {
            needs(a, out);
            needs(b, out);
        }
        ExprKind::If(a, b, c) => {
            needs(a, out);
            needs(b, out);
            needs(c, out);
        }
        ExprKind::Let(bound, last) => {
            bound.iter().for_each(|(_, _, value)| needs(value, out));
            needs(last, out);
        }
        ExprKind::Reduce { start, end, body, .. } => {
            needs(start, out);
            needs(end, out);
            needs(body, out);
        }
    }
}

/// More work than any constant is worth.
const BUDGET: u32 = 20_000;

struct Evaluator<'e> {
    checker: &'e Checker<'e>,
    budget: Cell<u32>,
}

type Locals = Vec<(LocalId, Known)>;

impl Checker<'_> {
    /// The value of an expression that depends on nothing; `None` for all others.
    pub(super) fn known(&mut self, expression: &Expr) -> Option<Known> {
        self.make_ready(expression);
        let evaluator = Evaluator { checker: self, budget: Cell::new(BUDGET) };
        evaluator.eval(expression, &mut vec![])
    }

    /// Checks the bodies of the functions that an expression calls, and no others: this runs while items are being
    /// checked, and what has nothing to do with them may name them before they are known.
    fn make_ready(&mut self, expression: &Expr) {
        let mut todo = vec![];
        needs(expression, &mut todo);
        let mut seen = FxHashSet::default();
        while let Some(need) = todo.pop() {
            if !seen.insert(need) {
                continue;
            }
            match need {
                Need::Function(id) => {
                    if let Some(place) = self.queue.iter().position(|q| q.id == id) {
                        let queued = self.queue.remove(place);
                        self.body(queued);
                    }
                    if let Some(Some(function)) = self.functions.get(id.0 as usize) {
                        needs(&function.body, &mut todo);
                    }
                }
                Need::Const(id) => {
                    if let Some((_, value)) = self.constants.get(id.0 as usize) {
                        needs(value, &mut todo);
                    }
                }
                Need::Table(id) => match self.tables.get(id.0 as usize).map(|t| &t.rows) {
                    Some(TableRows::Values(rows)) => {
                        for (key, value) in rows {
                            needs(key, &mut todo);
                            needs(value, &mut todo);
                        }
                    }
                    Some(TableRows::Layers(rows)) => {
                        for (key, color, k) in rows {
                            needs(key, &mut todo);
                            needs(color, &mut todo);
                            needs(k, &mut todo);
                        }
                    }
                    None => {}
                },
            }
        }
    }

    /// The value of a constant scalar.
    pub(super) fn known_scalar(&mut self, expression: &Expr) -> Option<f64> {
        match self.known(expression)? {
            Known::Numbers(n) => n.scalar(),
            Known::Color(_) | Known::Bool(_) | Known::Layer(..) => None,
        }
    }

    /// The outer faces of a grid in world space: least and greatest corner.
    pub(super) fn grid_corners(&self, id: GridId) -> Option<([f64; 3], [f64; 3])> {
        let header = &self.grids.get(id.0 as usize)?.header;
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in 0..8u32 {
            let index = |axis: usize| {
                if corner >> axis & 1 == 0 { -0.5 } else { f64::from(header.dims[axis]) - 0.5 }
            };
            for (axis, row) in header.world_from_index.iter().enumerate() {
                let at = row[0] * index(0) + row[1] * index(1) + row[2] * index(2) + row[3];
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        Some((low, high))
    }
}

impl Evaluator<'_> {
    fn eval(&self, expression: &Expr, locals: &mut Locals) -> Option<Known> {
        self.budget.set(self.budget.get().checked_sub(1)?);
        match &expression.kind {
            ExprKind::Number(v) => Some(Known::Numbers(Numbers::one(*v))),
            ExprKind::Color(c) => Some(Known::Color(*c)),
            ExprKind::Bool(b) => Some(Known::Bool(*b)),
            ExprKind::String(_)
            | ExprKind::Input(_)
            | ExprKind::Param(_)
            | ExprKind::Grid(_)
            | ExprKind::Splats(_)
            | ExprKind::Sample(..) => None,
            ExprKind::Const(id) => {
                let (_, value) = self.checker.constants.get(id.0 as usize)?;
                self.eval(value, &mut vec![])
            }
            ExprKind::Local(id) => locals.iter().rev().find(|(l, _)| l == id).map(|(_, v)| v.clone()),
            ExprKind::Vector(parts) => {
                let parts: Option<Vec<f64>> = parts.iter().map(|p| self.numbers(p, locals)?.scalar()).collect();
                Numbers::many(&parts?).map(Known::Numbers)
            }
            ExprKind::Negate(a) => Some(Known::Numbers(self.numbers(a, locals)?.map(|v| -v))),
            ExprKind::Not(a) => Some(Known::Bool(!self.truth(a, locals)?)),
            ExprKind::Binary(op, a, b) => self.binary(*op, a, b, locals),
            ExprKind::If(condition, accept, reject) => {
                let taken = if self.truth(condition, locals)? { accept } else { reject };
                self.eval(taken, locals)
            }
            ExprKind::Let(bound, last) => {
                let outer = locals.len();
                for (id, _, value) in bound {
                    // What is not known may not be needed.
                    if let Some(value) = self.eval(value, locals) {
                        locals.push((*id, value));
                    }
                }
                let value = self.eval(last, locals);
                locals.truncate(outer);
                value
            }
            ExprKind::Reduce { fold, variable, start, end, body, .. } => {
                let (start, end) = (self.numbers(start, locals)?.scalar()?, self.numbers(end, locals)?.scalar()?);
                let start_value = match fold {
                    Fold::Sum => 0.0,
                    Fold::Product => 1.0,
                    Fold::Min => f64::INFINITY,
                    Fold::Max => f64::NEG_INFINITY,
                };
                if (end - start).is_nan() || end - start > f64::from(BUDGET) {
                    return None;
                }
                let mut total = Numbers::one(start_value);
                let mut i = start.ceil();
                while i < end {
                    locals.push((*variable, Known::Numbers(Numbers::one(i))));
                    let value = self.numbers(body, locals);
                    locals.pop();
                    total = total.zip(value?, |a, b| match fold {
                        Fold::Sum => a + b,
                        Fold::Product => a * b,
                        Fold::Min => a.min(b),
                        Fold::Max => a.max(b),
                    });
                    i += 1.0;
                }
                Some(Known::Numbers(total))
            }
            ExprKind::Call(id, arguments) => {
                let function = self.checker.functions.get(id.0 as usize)?.as_ref()?;
                let mut inner: Locals = vec![];
                for (i, argument) in arguments.iter().enumerate() {
                    if let Some(value) = self.eval(argument, locals) {
                        inner.push((LocalId(i as u32), value));
                    }
                }
                self.eval(&function.body, &mut inner)
            }
            ExprKind::Lookup(id, key) => {
                let key = self.numbers(key, locals)?;
                let table = self.checker.tables.get(id.0 as usize)?;
                self.lookup(&table.rows, key)
            }
            ExprKind::Builtin(builtin, arguments) => self.builtin(*builtin, arguments, locals),
            ExprKind::Swizzle(a, places) => {
                let parts: [f64; 3] = match self.eval(a, locals)? {
                    Known::Numbers(n) => n.vector(),
                    Known::Color([r, g, b, _]) => [r, g, b],
                    Known::Bool(_) | Known::Layer(..) => return None,
                };
                let taken: Option<Vec<f64>> = places.iter().map(|i| parts.get(*i as usize).copied()).collect();
                Numbers::many(&taken?).map(Known::Numbers)
            }
            ExprKind::LayerColor(a) => match self.eval(a, locals)? {
                Known::Layer(color, _) => Some(Known::Color(color)),
                Known::Numbers(_) | Known::Color(_) | Known::Bool(_) => None,
            },
            ExprKind::LayerK(a) => match self.eval(a, locals)? {
                Known::Layer(_, k) => Some(Known::Numbers(Numbers::one(k))),
                Known::Numbers(_) | Known::Color(_) | Known::Bool(_) => None,
            },
        }
    }

    /// A numeric value; a colour counts as the three it holds.
    fn numbers(&self, expression: &Expr, locals: &mut Locals) -> Option<Numbers> {
        match self.eval(expression, locals)? {
            Known::Numbers(n) => Some(n),
            Known::Color([r, g, b, _]) => Some(Numbers { values: [r, g, b], width: 3, spectrum: true }),
            Known::Bool(_) | Known::Layer(..) => None,
        }
    }

    fn truth(&self, expression: &Expr, locals: &mut Locals) -> Option<bool> {
        match self.eval(expression, locals)? {
            Known::Bool(b) => Some(b),
            Known::Numbers(_) | Known::Color(_) | Known::Layer(..) => None,
        }
    }

    fn binary(&self, op: BinaryOp, a: &Expr, b: &Expr, locals: &mut Locals) -> Option<Known> {
        if let BinaryOp::And | BinaryOp::Or = op {
            let (a, b) = (self.truth(a, locals)?, self.truth(b, locals)?);
            return Some(Known::Bool(if op == BinaryOp::And { a && b } else { a || b }));
        }
        if a.ty == Type::Bool {
            let same = self.truth(a, locals)? == self.truth(b, locals)?;
            return Some(Known::Bool(same == (op == BinaryOp::Equal)));
        }
        if a.ty == Type::Transform {
            return None;
        }
        let colors = a.ty == Type::Color && b.ty == Type::Color;
        let (a, b) = (self.numbers(a, locals)?, self.numbers(b, locals)?);
        let compare = |f: fn(&f64, &f64) -> bool| Some(Known::Bool(f(&a.scalar()?, &b.scalar()?)));
        let value = match op {
            BinaryOp::And | BinaryOp::Or => return None,
            BinaryOp::Equal => return compare(|a, b| a == b),
            BinaryOp::NotEqual => return compare(|a, b| a != b),
            BinaryOp::Less => return compare(f64::lt),
            BinaryOp::LessEqual => return compare(f64::le),
            BinaryOp::Greater => return compare(f64::gt),
            BinaryOp::GreaterEqual => return compare(f64::ge),
            BinaryOp::Add => a.zip(b, |a, b| a + b),
            BinaryOp::Subtract => a.zip(b, |a, b| a - b),
            BinaryOp::Multiply => a.zip(b, |a, b| a * b),
            BinaryOp::Divide => a.zip(b, |a, b| a / b),
            BinaryOp::Power => a.zip(b, f64::powf),
        };
        if colors {
            let [r, g, b] = value.values;
            return Some(Known::Color([r, g, b, 1.0]));
        }
        Some(Known::Numbers(value))
    }

    fn lookup(&self, rows: &TableRows, key: Numbers) -> Option<Known> {
        match rows {
            TableRows::Values(rows) => {
                let points: Option<Vec<(f64, f64)>> = rows
                    .iter()
                    .map(|(k, v)| {
                        Some((self.numbers(k, &mut vec![])?.scalar()?, self.numbers(v, &mut vec![])?.scalar()?))
                    })
                    .collect();
                let points = points?;
                Some(Known::Numbers(key.map(|x| piecewise(&points, x))))
            }
            TableRows::Layers(rows) => {
                let x = key.scalar()?;
                let mut stops = vec![];
                for (k, c, e) in rows {
                    let at = self.numbers(k, &mut vec![])?.scalar()?;
                    let color = self.numbers(c, &mut vec![])?.vector();
                    stops.push((at, [color[0], color[1], color[2], self.numbers(e, &mut vec![])?.scalar()?]));
                }
                let part = |i: usize| piecewise(&stops.iter().map(|(k, v)| (*k, v[i])).collect::<Vec<_>>(), x);
                Some(Known::Layer([part(0), part(1), part(2), 1.0], part(3)))
            }
        }
    }

    fn builtin(&self, builtin: Builtin, arguments: &[Expr], locals: &mut Locals) -> Option<Known> {
        let mut n = |i: usize| self.numbers(arguments.get(i)?, locals);
        let map = |a: Option<Numbers>, f: fn(f64) -> f64| Some(Known::Numbers(a?.map(f)));
        let dot = |a: Numbers, b: Numbers| a.all().iter().zip(b.all()).map(|(a, b)| a * b).sum::<f64>();
        match builtin {
            Builtin::Exp => map(n(0), f64::exp),
            Builtin::Expm1 => map(n(0), f64::exp_m1),
            Builtin::Log => map(n(0), f64::ln),
            Builtin::Log2 => map(n(0), f64::log2),
            Builtin::Log10 => map(n(0), f64::log10),
            Builtin::Exp2 => map(n(0), f64::exp2),
            Builtin::Sqrt => map(n(0), f64::sqrt),
            Builtin::Cbrt => map(n(0), f64::cbrt),
            Builtin::Sin => map(n(0), f64::sin),
            Builtin::Cos => map(n(0), f64::cos),
            Builtin::Tan => map(n(0), f64::tan),
            Builtin::Asin => map(n(0), f64::asin),
            Builtin::Acos => map(n(0), f64::acos),
            Builtin::Atan => map(n(0), f64::atan),
            Builtin::Sinh => map(n(0), f64::sinh),
            Builtin::Cosh => map(n(0), f64::cosh),
            Builtin::Tanh => map(n(0), f64::tanh),
            Builtin::Abs => map(n(0), f64::abs),
            Builtin::Sign => map(n(0), |v| if v == 0.0 { 0.0 } else { v.signum() }),
            Builtin::Floor => map(n(0), f64::floor),
            Builtin::Ceil => map(n(0), f64::ceil),
            Builtin::Round => map(n(0), f64::round_ties_even),
            Builtin::Fract => map(n(0), |v| v - v.floor()),
            Builtin::Atan2 => Some(Known::Numbers(n(0)?.zip(n(1)?, f64::atan2))),
            Builtin::Min | Builtin::Max => {
                let mut value = n(0)?;
                for i in 1..arguments.len() {
                    value = value.zip(n(i)?, if builtin == Builtin::Min { f64::min } else { f64::max });
                }
                Some(Known::Numbers(value))
            }
            Builtin::Pow => Some(Known::Numbers(n(0)?.zip(n(1)?, f64::powf))),
            Builtin::Mod => Some(Known::Numbers(n(0)?.zip(n(1)?, |a, b| a - b * (a / b).floor()))),
            Builtin::Clamp => Some(Known::Numbers(n(0)?.zip(n(1)?, f64::max).zip(n(2)?, f64::min))),
            Builtin::Mix => {
                let colors = arguments.first()?.ty == Type::Color;
                let (a, b, t) = (n(0)?, n(1)?, n(2)?);
                let value = a.zip(b.zip(a, |b, a| b - a).zip(t, |d, t| d * t), |a, d| a + d);
                let [r, g, b] = value.values;
                Some(if colors { Known::Color([r, g, b, 1.0]) } else { Known::Numbers(value) })
            }
            Builtin::Step => Some(Known::Numbers(n(0)?.zip(n(1)?, |edge, x| if x < edge { 0.0 } else { 1.0 }))),
            Builtin::Smoothstep => {
                let (low, high, x) = (n(0)?, n(1)?, n(2)?);
                let t = x.zip(low, |x, l| x - l).zip(high.zip(low, |h, l| h - l), |a, b| (a / b).clamp(0.0, 1.0));
                Some(Known::Numbers(t.map(|t| t * t * (3.0 - 2.0 * t))))
            }
            Builtin::Dot => Some(Known::Numbers(Numbers::one(dot(n(0)?, n(1)?)))),
            Builtin::Cross => {
                let ([a, b, c], [x, y, z]) = (n(0)?.vector(), n(1)?.vector());
                Numbers::many(&[b * z - c * y, c * x - a * z, a * y - b * x]).map(Known::Numbers)
            }
            Builtin::Length => {
                let v = n(0)?;
                Some(Known::Numbers(Numbers::one(dot(v, v).sqrt())))
            }
            Builtin::Distance => {
                let d = n(0)?.zip(n(1)?, |a, b| a - b);
                Some(Known::Numbers(Numbers::one(dot(d, d).sqrt())))
            }
            Builtin::Normalize => {
                let v = n(0)?;
                let size = dot(v, v).sqrt();
                Some(Known::Numbers(v.map(|c| c / size)))
            }
            Builtin::Reflect => {
                let (i, normal) = (n(0)?, n(1)?);
                let twice = 2.0 * dot(i, normal);
                Some(Known::Numbers(i.zip(normal, |i, n| i - twice * n)))
            }
            Builtin::Vec2 | Builtin::Vec3 => {
                let parts: Option<Vec<f64>> = (0..arguments.len()).map(|i| n(i)?.scalar()).collect();
                Numbers::many(&parts?).map(Known::Numbers)
            }
            Builtin::Rgb => {
                let (r, g, b) = (n(0)?.scalar()?, n(1)?.scalar()?, n(2)?.scalar()?);
                Some(Known::Numbers(Numbers { values: [r, g, b], width: 3, spectrum: true }))
            }
            Builtin::Luminance => {
                let [r, g, b] = n(0)?.vector();
                Some(Known::Numbers(Numbers::one(0.2126 * r + 0.7152 * g + 0.0722 * b)))
            }
            Builtin::Color => Some(Known::Color([n(0)?.scalar()?, n(1)?.scalar()?, n(2)?.scalar()?, 1.0])),
            Builtin::Layer => {
                let [r, g, b] = n(0)?.vector();
                Some(Known::Layer([r, g, b, 1.0], n(1)?.scalar()?))
            }
            Builtin::Opacity => Some(Known::Numbers(n(0)?.zip(n(1)?, |a, per| -(-a).ln_1p() / per))),
            Builtin::Center | Builtin::MinCorner | Builtin::MaxCorner | Builtin::Size => {
                let ExprKind::Grid(id) = arguments.first()?.kind else { return None };
                let (low, high) = self.checker.grid_corners(id)?;
                let value = |i: usize| match builtin {
                    Builtin::Center => 0.5 * (low[i] + high[i]),
                    Builtin::MinCorner => low[i],
                    Builtin::MaxCorner => high[i],
                    _ => high[i] - low[i],
                };
                Numbers::many(&[value(0), value(1), value(2)]).map(Known::Numbers)
            }
            Builtin::Gradient
            | Builtin::Mie
            | Builtin::MieScattering
            | Builtin::MieAbsorption
            | Builtin::MieExtinction
            | Builtin::CellHash
            | Builtin::CellHash3
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
            | Builtin::Translate
            | Builtin::Rotate
            | Builtin::Scale => None,
        }
    }
}

/// A piecewise-linear function, clamped at its ends; at a jump the later row holds.
fn piecewise(points: &[(f64, f64)], x: f64) -> f64 {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return f64::NAN };
    if x < first.0 {
        return first.1;
    }
    let after = points.partition_point(|(k, _)| *k <= x);
    let Some(&(k1, v1)) = points.get(after) else { return last.1 };
    let (k0, v0) = points[after - 1];
    v0 + (v1 - v0) * ((x - k0) / (k1 - k0))
}
