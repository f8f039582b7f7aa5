//! Expressions: names, operators, calls, loops, tables.

use super::{Frame, Lowered, Lowerer, MAX_ALL_TRIPS, MAX_LOOPS, MAX_NESTED_TRIPS, MAX_TRIPS, Reported, Value};
use crate::check::hir::{self, ExprKind, Type};
use crate::diagnostic::Diagnostic;
use crate::ir::{Binary, Compare, Fold, Input, NodeId, Op, Table, Unary, eval};
use crate::source::Span;
use crate::syntax::ast::BinaryOp;

impl<'s> Lowerer<'s, '_> {
    /// Lowers an expression that is one node: a number, vector, spectrum, colour or truth value.
    pub(super) fn node(&mut self, expr: &'s hir::Expr) -> Lowered<NodeId> {
        let value = self.value(expr)?;
        self.as_node(value, expr.span, &expr.ty)
    }

    /// The node of a value, widened if its type is a vector.
    pub(super) fn as_node(&mut self, value: Value, span: Span, ty: &Type) -> Lowered<NodeId> {
        let Value::Node(node) = value else { return self.broken_promise(span, "a number is expected here") };
        let width = match ty {
            Type::Vec2(_) => 2,
            Type::Vec3(_) | Type::Color => 3,
            _ => return Ok(node),
        };
        match self.graph.width(node) {
            1 => Ok(self.graph.widen(node, width)),
            w if w == width => Ok(node),
            _ => self.broken_promise(span, "a vector has the wrong number of components"),
        }
    }

    /// As [`Self::node`], with a colour turned into a spectrum.
    pub(super) fn spectrum(&mut self, expr: &'s hir::Expr) -> Lowered<NodeId> {
        let node = self.node(expr)?;
        Ok(if expr.ty == Type::Color { self.color_to_spectrum(node) } else { node })
    }

    /// Lowers an expression of any type.
    pub(super) fn value(&mut self, expr: &'s hir::Expr) -> Lowered<Value> {
        self.visit(expr.span)?;
        self.depth += 1;
        let value = self.form(expr);
        self.depth -= 1;
        let value = value?;
        self.span_new(expr.span);
        Ok(value)
    }

    fn form(&mut self, expr: &'s hir::Expr) -> Lowered<Value> {
        let node = match &expr.kind {
            ExprKind::Number(v) => self.literal(*v, &expr.ty),
            ExprKind::Color([r, g, b, _]) => self.graph.vector(&[*r, *g, *b]),
            ExprKind::Bool(t) => self.graph.truth(*t),
            ExprKind::String(_) => return Ok(Value::Text),
            ExprKind::Input(input) => self.implicit(*input, expr.span)?,
            ExprKind::Param(p) if (p.0 as usize) < self.graph.params.len() => {
                let node = self.graph.param(*p);
                let param = &self.scene.params[p.0 as usize];
                self.graph.annotate(node, param.span, Some(&param.name));
                node
            }
            ExprKind::Param(_) => return self.broken_promise(expr.span, "an unknown param"),
            ExprKind::Const(id) => return self.constant_item(*id, expr.span),
            ExprKind::Local(id) => match self.frames.last().and_then(|f| f.locals.get(id)) {
                Some(value) => return Ok(value.clone()),
                None => return self.unbound(expr.span),
            },
            ExprKind::Grid(id) => return Ok(Value::Grid(*id)),
            ExprKind::Splats(id) => return Ok(Value::Shape(self.splats_box(*id, expr.span)?)),
            ExprKind::Vector(parts) => {
                let parts = parts.iter().map(|p| self.scalar(p)).collect::<Lowered<Vec<_>>>()?;
                if !(2..=4).contains(&parts.len()) {
                    return self.broken_promise(expr.span, "a vector has 2 to 4 components");
                }
                self.vector(&parts)
            }
            ExprKind::Negate(a) => {
                let a = self.number_node(a)?;
                self.graph.unary(Unary::Neg, a)
            }
            ExprKind::Not(a) => {
                let a = self.truth(a)?;
                self.graph.unary(Unary::Not, a)
            }
            ExprKind::Binary(..) => return self.chain(expr),
            ExprKind::If(condition, accept, reject) => return self.choice(expr, condition, accept, reject),
            ExprKind::Let(names, last) => return self.block(names, last),
            ExprKind::Reduce { fold, variable, start, end, body, .. } => {
                self.repetition(expr, *fold, *variable, (start, end), body)?
            }
            ExprKind::Call(function, arguments) => return self.call(expr, *function, arguments),
            ExprKind::Lookup(table, key) => {
                let at = self.node(key)?;
                return self.lookup_all(*table, at, expr.span);
            }
            ExprKind::Sample(grid, at) => {
                let at = self.node(at)?;
                self.sample(*grid, at, expr.span)?
            }
            ExprKind::Builtin(builtin, arguments) => return self.builtin(expr, *builtin, arguments),
            ExprKind::Swizzle(vector, components) => {
                let vector_node = self.node(vector)?;
                let width = self.graph.width(vector_node);
                if components.is_empty() || components.len() > 4 || components.iter().any(|c| *c >= width) {
                    return self.broken_promise(expr.span, "there is no such component");
                }
                let parts: Vec<NodeId> = components.iter().map(|c| self.graph.extract(vector_node, *c)).collect();
                self.graph.compose(&parts)
            }
            ExprKind::LayerColor(layer) => self.layer(layer)?.0,
            ExprKind::LayerK(layer) => self.layer(layer)?.1,
        };
        Ok(Value::Node(node))
    }

    fn unbound<T>(&mut self, span: Span) -> Lowered<T> {
        // A name whose value could not be lowered has been reported where it was bound.
        if self.failed { Err(Reported) } else { self.broken_promise(span, "an unbound name") }
    }

    /// A node of numbers.
    fn number_node(&mut self, expr: &'s hir::Expr) -> Lowered<NodeId> {
        let node = self.node(expr)?;
        if self.graph.ty(node) == crate::ir::Type::Bool {
            return self.broken_promise(expr.span, "a number is expected here");
        }
        Ok(node)
    }

    /// A single number.
    pub(super) fn scalar(&mut self, expr: &'s hir::Expr) -> Lowered<NodeId> {
        let node = self.node(expr)?;
        if self.graph.ty(node) != crate::ir::Type::SCALAR {
            return self.broken_promise(expr.span, "a single number is expected here");
        }
        Ok(node)
    }

    fn truth(&mut self, expr: &'s hir::Expr) -> Lowered<NodeId> {
        let node = self.node(expr)?;
        if self.graph.ty(node) != crate::ir::Type::Bool {
            return self.broken_promise(expr.span, "a truth value is expected here");
        }
        Ok(node)
    }

    pub(super) fn layer(&mut self, expr: &'s hir::Expr) -> Lowered<(NodeId, NodeId)> {
        match self.value(expr)? {
            Value::Layer { color, k } => Ok((color, k)),
            _ => self.broken_promise(expr.span, "a layer is expected here"),
        }
    }

    /// A number of the scene, in the graph's units.
    fn literal(&mut self, value: f64, ty: &Type) -> NodeId {
        let factor = match ty {
            Type::Number(d) | Type::Vec2(d) | Type::Vec3(d) | Type::Spectrum(d) => self.scale(*d),
            _ => 1.0,
        };
        self.graph.scalar(value * factor)
    }

    fn implicit(&mut self, input: hir::Input, span: Span) -> Lowered<NodeId> {
        Ok(match input {
            hir::Input::Position => self.space.position,
            hir::Input::Direction => self.space.direction,
            hir::Input::Lambda => {
                let factor = self.units.scale(1.0);
                let values: Vec<f64> = self.bands.wavelengths.iter().map(|w| w * factor).collect();
                self.graph.vector(&values)
            }
            hir::Input::Time => self.graph.input(Input::Time),
            hir::Input::CosTheta => self.graph.input(Input::CosTheta),
            hir::Input::Altitude => return self.altitude(span),
        })
    }

    /// A `const`: it sees no field, so it is lowered once, outside of all loops.
    fn constant_item(&mut self, id: hir::ConstId, span: Span) -> Lowered<Value> {
        if let Some(value) = self.constants.get(&id) {
            return Ok(value.clone());
        }
        let scene = self.scene;
        let Some((name, body)) = scene.constants.get(id.0 as usize) else {
            return self.broken_promise(span, "an unknown constant");
        };
        let loops = std::mem::take(&mut self.loops);
        self.frames.push(Frame::default());
        let value = self.value(body);
        self.frames.pop();
        self.loops = loops;
        let value = value?;
        if let Value::Node(node) = value {
            self.name(node, name);
        }
        self.constants.insert(id, value.clone());
        Ok(value)
    }

    fn block(&mut self, names: &'s [(hir::LocalId, String, hir::Expr)], last: &'s hir::Expr) -> Lowered<Value> {
        for (id, name, expr) in names {
            self.bind(*id, name, expr)?;
        }
        self.value(last)
    }

    /// Binds a `let`.
    pub(super) fn bind(&mut self, id: hir::LocalId, name: &str, expr: &'s hir::Expr) -> Lowered<()> {
        let mut value = self.value(expr)?;
        if let Value::Node(_) = value {
            let node = self.as_node(value, expr.span, &expr.ty)?;
            self.name(node, name);
            value = Value::Node(node);
        }
        if let Some(frame) = self.frames.last_mut() {
            frame.locals.insert(id, value);
            frame.definitions.insert(id, expr);
        }
        Ok(())
    }

    /// Operators. The left spine is walked in a loop, because a sum of a thousand terms is that deep.
    fn chain(&mut self, expr: &'s hir::Expr) -> Lowered<Value> {
        let mut spine = vec![];
        let mut first = expr;
        while let ExprKind::Binary(op, left, right) = &first.kind {
            spine.push((first, *op, &**left, &**right));
            first = left;
        }
        let mut value = self.value(first)?;
        for (whole, op, left, right) in spine.into_iter().rev() {
            self.visit(whole.span)?;
            value = self.operator(whole, op, (value, left), right)?;
            self.span_new(whole.span);
        }
        Ok(value)
    }

    fn operator(
        &mut self,
        expr: &'s hir::Expr,
        op: BinaryOp,
        (left, left_expr): (Value, &'s hir::Expr),
        right_expr: &'s hir::Expr,
    ) -> Lowered<Value> {
        let right = self.value(right_expr)?;
        if let (Value::Transform(a), Value::Transform(b), BinaryOp::Multiply) = (&left, &right, op) {
            let product = self.compose_transforms(a, b);
            return Ok(Value::Transform(Box::new(product)));
        }
        let mut a = self.as_node(left, left_expr.span, &left_expr.ty)?;
        let mut b = self.as_node(right, right_expr.span, &right_expr.ty)?;
        // A colour that meets a number or a spectrum becomes one itself; two colours stay colours.
        if expr.ty != Type::Color {
            if left_expr.ty == Type::Color {
                a = self.color_to_spectrum(a);
            }
            if right_expr.ty == Type::Color {
                b = self.color_to_spectrum(b);
            }
        }
        let span = expr.span;
        let node = match op {
            BinaryOp::Or => self.binary(Binary::Or, a, b, span)?,
            BinaryOp::And => self.binary(Binary::And, a, b, span)?,
            BinaryOp::Equal => self.equal(a, b, span)?,
            BinaryOp::NotEqual => {
                let equal = self.equal(a, b, span)?;
                self.graph.unary(Unary::Not, equal)
            }
            BinaryOp::Less => self.compare(Compare::Less, a, b, span)?,
            BinaryOp::LessEqual => self.compare(Compare::LessEqual, a, b, span)?,
            BinaryOp::Greater => self.compare(Compare::Less, b, a, span)?,
            BinaryOp::GreaterEqual => self.compare(Compare::LessEqual, b, a, span)?,
            BinaryOp::Add => self.binary(Binary::Add, a, b, span)?,
            BinaryOp::Subtract => self.binary(Binary::Sub, a, b, span)?,
            BinaryOp::Multiply => self.binary(Binary::Mul, a, b, span)?,
            BinaryOp::Divide => self.binary(Binary::Div, a, b, span)?,
            BinaryOp::Power => self.power(a, b, span)?,
        };
        Ok(Value::Node(node))
    }

    /// An operation on numbers (or on truth values) of equal width, or of which one is a single number.
    pub(super) fn binary(&mut self, op: Binary, a: NodeId, b: NodeId, span: Span) -> Lowered<NodeId> {
        let logic = matches!(op, Binary::And | Binary::Or);
        let fits = [a, b].iter().all(|n| (self.graph.ty(*n) == crate::ir::Type::Bool) == logic);
        let (wa, wb) = (self.graph.width(a), self.graph.width(b));
        if !fits || (wa != wb && wa != 1 && wb != 1) {
            return self.broken_promise(span, "the operands do not fit");
        }
        Ok(self.graph.binary(op, a, b))
    }

    pub(super) fn compare(&mut self, op: Compare, a: NodeId, b: NodeId, span: Span) -> Lowered<NodeId> {
        if [a, b].iter().any(|n| self.graph.ty(*n) != crate::ir::Type::SCALAR) {
            return self.broken_promise(span, "only single numbers have an order");
        }
        Ok(self.graph.compare(op, a, b))
    }

    fn equal(&mut self, a: NodeId, b: NodeId, span: Span) -> Lowered<NodeId> {
        let is_bool = |n: &NodeId| self.graph.ty(*n) == crate::ir::Type::Bool;
        let (wa, wb) = (self.graph.width(a), self.graph.width(b));
        match [a, b].iter().filter(|n| is_bool(n)).count() {
            0 if wa == wb || wa == 1 || wb == 1 => {
                let mut all = None;
                for i in 0..wa.max(wb) {
                    let (x, y) = (self.graph.extract(a, i), self.graph.extract(b, i));
                    let equal = self.graph.compare(Compare::Equal, x, y);
                    all = Some(all.map_or(equal, |all| self.graph.binary(Binary::And, all, equal)));
                }
                all.map_or_else(|| self.broken_promise(span, "nothing to compare"), Ok)
            }
            2 => {
                let (na, nb) = (self.graph.unary(Unary::Not, a), self.graph.unary(Unary::Not, b));
                let both = self.graph.binary(Binary::And, a, b);
                let neither = self.graph.binary(Binary::And, na, nb);
                Ok(self.graph.binary(Binary::Or, both, neither))
            }
            _ => self.broken_promise(span, "the operands do not fit"),
        }
    }

    /// `a ^ b`: a known whole exponent is an integer power, ±½ a square root, anything else `pow`, which needs a ≥ 0.
    pub(super) fn power(&mut self, a: NodeId, b: NodeId, span: Span) -> Lowered<NodeId> {
        match self.number(b) {
            Some(n) if n.fract() == 0.0 && n.abs() <= f64::from(i32::MAX) => Ok(self.graph.powi(a, n as i32)),
            Some(n) if n.abs() == 0.5 => {
                let root = self.graph.unary(Unary::Sqrt, a);
                Ok(if n < 0.0 { self.graph.powi(root, -1) } else { root })
            }
            _ => self.binary(Binary::Pow, a, b, span),
        }
    }

    fn choice(
        &mut self,
        expr: &'s hir::Expr,
        condition: &'s hir::Expr,
        accept: &'s hir::Expr,
        reject: &'s hir::Expr,
    ) -> Lowered<Value> {
        let condition_node = self.truth(condition)?;
        let (a, b) = (self.value(accept)?, self.value(reject)?);
        match (a, b) {
            (Value::Node(a), Value::Node(b)) => {
                let to_spectrum = matches!(expr.ty, Type::Spectrum(_));
                let mut branch = |value, from: &hir::Expr| {
                    let node = self.as_node(Value::Node(value), from.span, &from.ty)?;
                    Ok(if to_spectrum && from.ty == Type::Color { self.color_to_spectrum(node) } else { node })
                };
                let (a, b) = (branch(a, accept)?, branch(b, reject)?);
                let is_bool = |n| self.graph.ty(n) == crate::ir::Type::Bool;
                let (wa, wb) = (self.graph.width(a), self.graph.width(b));
                if is_bool(a) != is_bool(b) || (wa != wb && wa != 1 && wb != 1) {
                    return self.broken_promise(expr.span, "the branches do not fit");
                }
                Ok(Value::Node(self.graph.select(condition_node, a, b)))
            }
            (Value::Layer { color: c1, k: k1 }, Value::Layer { color: c2, k: k2 }) => Ok(Value::Layer {
                color: self.graph.select(condition_node, c1, c2),
                k: self.graph.select(condition_node, k1, k2),
            }),
            (a, b) => match self.number(condition_node) {
                Some(truth) => Ok(if truth != 0.0 { a } else { b }),
                None => self.report(
                    Diagnostic::error(
                        "E0513",
                        "a choice between shapes, transforms or grids must be known when compiling",
                    )
                    .at(condition.span, "this is not known yet")
                    .because(expr.span, "what is chosen here decides how the program is built")
                    .hint("choose between numbers instead, for example between two radii"),
                ),
            },
        }
    }

    fn repetition(
        &mut self,
        expr: &'s hir::Expr,
        fold: Fold,
        variable: hir::LocalId,
        (start, end): (&'s hir::Expr, &'s hir::Expr),
        body: &'s hir::Expr,
    ) -> Lowered<NodeId> {
        let (first, last) = (self.bound(start, expr.span)?, self.bound(end, expr.span)?);
        let trips = (last - first).max(0);
        let depth = self.loops.len();
        if depth >= MAX_LOOPS {
            return self.report(
                Diagnostic::error("E0504", "too many loops within each other")
                    .at(expr.span, format!("this would be loop {} of a nest", depth + 1))
                    .note(format!("at most {MAX_LOOPS} loops may be nested")),
            );
        }
        let nested = self.loops.iter().fold(trips, |product, t| product.saturating_mul(*t));
        self.all_trips = self.all_trips.saturating_add(nested);
        if trips > MAX_TRIPS || nested > MAX_NESTED_TRIPS || self.all_trips > MAX_ALL_TRIPS {
            let (count, limit) = match () {
                () if trips > MAX_TRIPS => (format!("this loop runs {trips} times"), MAX_TRIPS),
                () if nested > MAX_NESTED_TRIPS => {
                    (format!("with the loops around it, this one runs {nested} times"), MAX_NESTED_TRIPS)
                }
                () => ("all loops of the scene together run too often".to_owned(), MAX_ALL_TRIPS),
            };
            return self.report(
                Diagnostic::error("E0503", "a loop runs too often")
                    .at(expr.span, count)
                    .note(format!("the limit is {limit}; every sample of every ray would run it"))
                    .hint("put the data into a `grid` or a `table` if there is so much of it"),
            );
        }
        if trips == 0 && matches!(fold, Fold::Min | Fold::Max) {
            let word = if fold == Fold::Min { "min" } else { "max" };
            return self.report(
                Diagnostic::error("E0514", format!("`{word}` over no values has no value"))
                    .at(start.span.to(end.span), "this range is empty: its end is excluded")
                    .hint("make the range cover at least one number"),
            );
        }
        let index = self.graph.push(Op::LoopVar(depth as u8));
        if let Some(frame) = self.frames.last_mut() {
            frame.locals.insert(variable, Value::Node(index));
        }
        self.loops.push(trips);
        let body_node = self.number_node(body);
        self.loops.pop();
        let mut body_node = body_node?;
        if body.ty == Type::Color && expr.ty != Type::Color {
            body_node = self.color_to_spectrum(body_node);
        }
        let first = first as i32;
        Ok(self.graph.reduce(fold, depth as u8, first..first + trips as i32, body_node))
    }

    /// A bound of a loop: a whole number that is known now.
    fn bound(&mut self, expr: &'s hir::Expr, of: Span) -> Lowered<i64> {
        let node = self.scalar(expr)?;
        let Some(value) = self.known(node) else {
            let (cause, why) = self.trace(expr, self.frames.len() - 1, 0);
            let mut diagnostic = Diagnostic::error("E0501", "the bounds of a loop must be constant").at(cause, why);
            if cause != expr.span {
                diagnostic = diagnostic.because(expr.span, "it decides how often this loop runs");
            } else {
                diagnostic = diagnostic.because(of, "it decides how often this loop runs");
            }
            return self.report(
                diagnostic.hint("write a number; a `param` can weigh the terms of the loop but not their number"),
            );
        };
        if value.fract() != 0.0 || value.abs() > 1e9 {
            let (cause, _) = self.trace(expr, self.frames.len() - 1, 0);
            return self.report(
                Diagnostic::error("E0502", "the bounds of a loop must be whole numbers")
                    .at(cause, format!("this makes a bound of {value}"))
                    .because(of, "of this loop")
                    .hint("round it with `floor` or `ceil`"),
            );
        }
        Ok(value as i64)
    }

    /// The number a node is, loops and tables over constants included.
    fn known(&mut self, node: NodeId) -> Option<f64> {
        self.known_components(node).and_then(|v| v.first().copied())
    }

    /// The numbers a node is, loops and tables over constants included.
    pub(super) fn known_components(&mut self, node: NodeId) -> Option<Vec<f64>> {
        if let Some(value) = self.constant(node) {
            return Some(value.values());
        }
        let live = self.graph.reachable(&[node]);
        self.visits += live.len() / 8;
        let open = |id: NodeId| match self.graph.op(id) {
            Op::Input(_) | Op::Param(_) | Op::Sample { .. } | Op::SampleGradient { .. } => true,
            // A variable may be bound by a loop of the enclosing nest, which is not known.
            Op::LoopVar(d) => (*d as usize) < self.loops.len(),
            _ => false,
        };
        if self.graph.ids().any(|id| live[id.0 as usize] && open(id)) {
            return None;
        }
        // Tables that the node does not read may follow params; they are evaluated with the rest.
        eval::evaluate_frame(&self.graph, &[node], &self.defaults(), 0.0).pop()
    }

    /// The place that makes an expression what it is: through arguments to the call that gave them.
    pub(super) fn trace(&self, expr: &'s hir::Expr, frame: usize, depth: usize) -> (Span, &'static str) {
        let here = (expr.span, "this is not known when compiling");
        if depth > 64 {
            return here;
        }
        match &expr.kind {
            ExprKind::Param(_) => (expr.span, "a `param` may change at any time"),
            ExprKind::Input(_) => (expr.span, "this differs from place to place"),
            ExprKind::Sample(..) => (expr.span, "voxels are not known when compiling"),
            ExprKind::Local(id) => {
                let Some(scope) = self.frames.get(frame) else { return here };
                if let Some(definition) = scope.definitions.get(id) {
                    return self.trace(definition, frame, depth + 1);
                }
                match scope.arguments.get(id.0 as usize) {
                    Some(argument) if frame > 0 => self.trace(argument, frame - 1, depth + 1),
                    _ => here,
                }
            }
            ExprKind::Negate(a) | ExprKind::Not(a) | ExprKind::Swizzle(a, _) => self.trace(a, frame, depth + 1),
            ExprKind::Binary(_, a, b) => {
                let varies = |e: &hir::Expr| !matches!(e.kind, ExprKind::Number(_) | ExprKind::Const(_));
                match (varies(a), varies(b)) {
                    (true, false) => self.trace(a, frame, depth + 1),
                    (false, true) => self.trace(b, frame, depth + 1),
                    _ => here,
                }
            }
            ExprKind::Builtin(_, arguments) if arguments.len() == 1 => self.trace(&arguments[0], frame, depth + 1),
            _ => here,
        }
    }

    fn call(&mut self, expr: &'s hir::Expr, function: hir::FunctionId, arguments: &'s [hir::Expr]) -> Lowered<Value> {
        let scene = self.scene;
        let Some(callee) = scene.functions.get(function.0 as usize) else {
            return self.broken_promise(expr.span, "an unknown function");
        };
        if callee.parameters.len() != arguments.len() {
            return self.broken_promise(expr.span, "the number of arguments is wrong");
        }
        let mut values = vec![];
        for (argument, (_, ty)) in arguments.iter().zip(&callee.parameters) {
            let mut value = self.value(argument)?;
            if let Value::Node(_) = value {
                let mut node = self.as_node(value, argument.span, &argument.ty)?;
                if argument.ty == Type::Color && matches!(ty, Type::Spectrum(_)) {
                    node = self.color_to_spectrum(node);
                }
                value = Value::Node(self.as_node(Value::Node(node), argument.span, ty)?);
            }
            values.push(value);
        }
        self.inline(function, callee, arguments, values)
    }

    /// Lowers a function's body with these arguments, or finds it done.
    pub(super) fn inline(
        &mut self,
        id: hir::FunctionId,
        callee: &'s hir::Function,
        arguments: &'s [hir::Expr],
        values: Vec<Value>,
    ) -> Lowered<Value> {
        let key = key(&values).map(|key| (id, self.space_number, self.loops.len(), key));
        if let Some(value) = key.as_ref().and_then(|k| self.calls.get(k)) {
            return Ok(value.clone());
        }
        let locals = values.into_iter().enumerate().map(|(i, v)| (hir::LocalId(i as u32), v)).collect();
        self.frames.push(Frame { locals, arguments, ..Frame::default() });
        let value = self.value(&callee.body);
        self.frames.pop();
        let mut value = value?;
        if let Value::Node(node) = value {
            let node = self.as_node(Value::Node(node), callee.body.span, &callee.result)?;
            self.name(node, &callee.name);
            value = Value::Node(node);
        }
        if let Some(key) = key {
            self.calls.insert(key, value.clone());
        }
        Ok(value)
    }

    /// A table or transfer function at a key.
    pub(super) fn lookup(&mut self, id: hir::TableId, at: NodeId, span: Span) -> Lowered<Value> {
        let table = self.table(id, span)?;
        let value = self.graph.push(Op::Lookup { table, at });
        if self.graph.width(value) == 1 {
            return Ok(Value::Node(value));
        }
        self.name(value, &self.graph.table(table).name.clone());
        let parts: Vec<NodeId> = (0..4).map(|i| self.graph.extract(value, i)).collect();
        Ok(Value::Layer { color: self.graph.compose(&parts[..3]), k: parts[3] })
    }

    /// Looks up every component of a key: one value per band for one wavelength per band.
    fn lookup_all(&mut self, id: hir::TableId, at: NodeId, span: Span) -> Lowered<Value> {
        let width = self.graph.width(at);
        if width == 1 {
            return self.lookup(id, at, span);
        }
        let mut parts = vec![];
        for i in 0..width {
            let key = self.graph.extract(at, i);
            match self.lookup(id, key, span)? {
                Value::Node(node) => parts.push(node),
                _ => return self.broken_promise(span, "a layer has no value per band"),
            }
        }
        Ok(Value::Node(self.graph.compose(&parts)))
    }

    /// The graph's table, made when it is first looked up, so that the tables its entries read come before it.
    fn table(&mut self, id: hir::TableId, span: Span) -> Lowered<crate::ir::TableId> {
        let scene = self.scene;
        let Some(table) = scene.tables.get(id.0 as usize) else {
            return self.broken_promise(span, "an unknown table");
        };
        match self.tables.get(&id) {
            Some(Some(done)) => return Ok(*done),
            // Either it is being made, and refers to itself, or making it failed.
            Some(None) => return self.unbound(span),
            None => {}
        }
        self.tables.insert(id, None);
        let loops = std::mem::take(&mut self.loops);
        self.frames.push(Frame::default());
        let rows = self.rows(table);
        self.frames.pop();
        self.loops = loops;
        let (keys, values, width) = rows?;
        if keys.is_empty() {
            return self.broken_promise(table.span, "a table without rows");
        }
        let made =
            self.graph.add_table(Table { name: table.name.clone(), span: Some(table.span), keys, values, width });
        self.tables.insert(id, Some(made));
        Ok(made)
    }

    fn rows(&mut self, table: &'s hir::Table) -> Lowered<(Vec<NodeId>, Vec<NodeId>, u8)> {
        const WHAT: &str = "an entry of a table";
        let (mut keys, mut values) = (vec![], vec![]);
        let width = match &table.rows {
            hir::TableRows::Values(rows) => {
                for (key, value) in rows {
                    let key_node = self.entry(key)?;
                    let value_node = self.entry(value)?;
                    self.per_frame(key_node, key.span, WHAT);
                    self.per_frame(value_node, value.span, WHAT);
                    keys.push(key_node);
                    values.push(value_node);
                }
                1
            }
            hir::TableRows::Layers(rows) => {
                for (key, color, k) in rows {
                    let key_node = self.entry(key)?;
                    let value_node = match (&color.kind, &k.kind) {
                        // Read at once: transfer functions may have a million stops.
                        (ExprKind::Color([r, g, b, _]), ExprKind::Number(v)) => {
                            let factor = if let Type::Number(d) = k.ty { self.scale(d) } else { 1.0 };
                            self.free(|graph| graph.vector(&[*r, *g, *b, v * factor]))
                        }
                        _ => {
                            let color_node = self.node(color)?;
                            let k_node = self.scalar(k)?;
                            let mut parts: Vec<NodeId> = (0..3).map(|i| self.graph.extract(color_node, i)).collect();
                            parts.push(k_node);
                            let node = self.graph.compose(&parts);
                            let node = self.folded(node);
                            self.per_frame(node, color.span.to(k.span), WHAT);
                            node
                        }
                    };
                    self.per_frame(key_node, key.span, WHAT);
                    keys.push(key_node);
                    values.push(value_node);
                }
                4
            }
        };
        self.span_new(table.span);
        Ok((keys, values, width))
    }

    fn entry(&mut self, expr: &'s hir::Expr) -> Lowered<NodeId> {
        match (&expr.kind, &expr.ty) {
            (ExprKind::Number(v), Type::Number(d)) => {
                let value = v * self.scale(*d);
                Ok(self.free(|graph| graph.scalar(value)))
            }
            _ => self.scalar(expr),
        }
    }

    /// Makes nodes that do not count towards the limit: the source text already bounds their number.
    pub(super) fn free(&mut self, make: impl FnOnce(&mut crate::ir::Graph) -> NodeId) -> NodeId {
        let before = self.graph.len();
        let node = make(&mut self.graph);
        self.free_nodes += self.graph.len() - before;
        node
    }
}

/// Arguments as numbers that are equal only if the arguments are; `None` for what is not remembered.
fn key(values: &[Value]) -> Option<Vec<u32>> {
    let mut key = vec![];
    for value in values {
        match value {
            Value::Node(n) => key.extend([0, n.0]),
            Value::Layer { color, k } => key.extend([1, color.0, k.0]),
            Value::Grid(g) => key.extend([2, g.0]),
            Value::Text => key.push(3),
            Value::Shape(_) | Value::Transform(_) => return None,
        }
    }
    Some(key)
}
