//! Exact derivatives of fields: forward symbolic differentiation over the graph.
//!
//! The derivative is taken with respect to one node of width 3, which is treated as an independent variable:
//! whatever is not reached through that node is a constant. Operations with jumps (`floor`, comparisons, hashes) have
//! the derivative that they have almost everywhere, 0; `min`, `max`, `abs` and tables have the one of the active branch.
//! A derivative that is zero everywhere is no node at all, so that nothing is computed only to be multiplied by 0.

use super::{Binary, Compare, Filter, Fold, Graph, GridId, Input, NodeId, Op, Type, Unary, eval};
use rustc_hash::{FxHashMap, FxHashSet};

/// Loops whose values are multiplied or compared are unrolled for their derivative, up to this many iterations.
pub const MAX_UNROLL: i64 = 64;

/// Why there is no derivative.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum Unsupported {
    /// The field already holds a derivative of this grid's interpolant, and second ones are not defined.
    SecondDerivativeOfGrid(GridId),
    /// A `product`, `min` or `max` over more than [`MAX_UNROLL`] values.
    LongFold(Fold),
    /// The field holds the altitude over a shell, and nothing says how that depends on the variable.
    Altitude,
    /// The field is no scalar or the variable has no three components.
    Shape,
    /// The budget is spent.
    TooLarge,
}

/// What a derivative may cost, so that no scene can make the compiler hang.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct Budget {
    /// The graph may not grow beyond this many nodes.
    pub nodes: usize,
    /// Nodes that may still be visited; reduced by what was spent.
    pub visits: usize,
}

impl Default for Budget {
    fn default() -> Self {
        Self { nodes: 1 << 20, visits: 1 << 22 }
    }
}

/// The gradient of the scalar `f` with respect to the vector `x`: a node of width 3.
///
/// # Errors
/// When some part of `f` has no derivative; see [`Unsupported`].
pub fn gradient(graph: &mut Graph, f: NodeId, x: NodeId) -> Result<NodeId, Unsupported> {
    gradient_with(graph, f, x, &[], &mut Budget::default())
}

/// As [`gradient`], with the gradients (width 3, with respect to `x`) of the altitudes that `f` may hold.
///
/// # Errors
/// As [`gradient`].
pub fn gradient_with(
    graph: &mut Graph,
    f: NodeId,
    x: NodeId,
    altitudes: &[(u32, NodeId)],
    budget: &mut Budget,
) -> Result<NodeId, Unsupported> {
    if graph.ty(f) != Type::SCALAR {
        return Err(Unsupported::Shape);
    }
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| graph.vector(&axis));
    let parts = along(graph, f, x, &axes, altitudes, budget)?;
    if parts.iter().all(Option::is_none) {
        return Ok(graph.vector(&[0.0; 3]));
    }
    let zero = graph.scalar(0.0);
    let parts: Vec<NodeId> = parts.into_iter().map(|p| p.unwrap_or(zero)).collect();
    Ok(compose(graph, &parts))
}

/// The derivative of `f`, of any width, when `x` moves along `direction`; `None` is zero.
///
/// # Errors
/// As [`gradient`].
pub fn directional(graph: &mut Graph, f: NodeId, x: NodeId, direction: NodeId) -> Result<Option<NodeId>, Unsupported> {
    let parts = along(graph, f, x, &[direction], &[], &mut Budget::default())?;
    Ok(parts.into_iter().next().flatten())
}

/// The derivatives of `f` when `x` moves along each of the seeds.
fn along(
    graph: &mut Graph,
    f: NodeId,
    x: NodeId,
    seeds: &[NodeId],
    altitudes: &[(u32, NodeId)],
    budget: &mut Budget,
) -> Result<Vec<Option<NodeId>>, Unsupported> {
    if graph.ty(f) == Type::Bool || seeds.iter().chain([&x]).any(|n| graph.ty(*n) != Type::VEC3) {
        return Err(Unsupported::Shape);
    }
    let bound = free_variables(graph, x);
    let mut forward = Forward { graph, x, seeds, seed: 0, bound, altitudes, budget, tangents: FxHashMap::default() };
    forward.tangents(f)
}

/// The loop variables that a node leaves unbound, as bits.
fn free_variables(graph: &Graph, root: NodeId) -> u16 {
    let mut order = vec![];
    let mut stack = vec![root];
    let mut free = FxHashMap::<NodeId, u16>::default();
    while let Some(id) = stack.pop() {
        if free.insert(id, 0).is_none() {
            order.push(id);
            Graph::operands(graph.op(id), |a| stack.push(a));
        }
    }
    order.sort_unstable();
    for id in order {
        let op = graph.op(id);
        let mut mask = 0;
        Graph::operands(op, |a| mask |= free[&a]);
        match op {
            Op::LoopVar(d) => mask |= 1 << d,
            Op::Reduce { depth, .. } => mask &= !(1 << depth),
            _ => {}
        }
        free.insert(id, mask);
    }
    free[&root]
}

/// A vector, as a constant where all parts are.
fn compose(graph: &mut Graph, parts: &[NodeId]) -> NodeId {
    let constants: Option<Vec<f64>> = parts.iter().map(|p| graph.constant(*p).map(|c| c.get(0))).collect();
    match constants {
        Some(values) => graph.vector(&values),
        None => graph.compose(parts),
    }
}

struct Forward<'a> {
    graph: &'a mut Graph,
    x: NodeId,
    seeds: &'a [NodeId],
    /// The seed whose derivatives are being made.
    seed: usize,
    /// Loop variables free in `x`: inside a loop that binds one of them anew, a node equal to `x` is not `x`.
    bound: u16,
    altitudes: &'a [(u32, NodeId)],
    budget: &'a mut Budget,
    /// The derivatives of a node along each seed, of the node's own width.
    tangents: FxHashMap<NodeId, Vec<Option<NodeId>>>,
}

impl Forward<'_> {
    fn spend(&mut self, visits: usize) -> Result<(), Unsupported> {
        if visits > self.budget.visits || self.graph.len() > self.budget.nodes {
            return Err(Unsupported::TooLarge);
        }
        self.budget.visits -= visits;
        Ok(())
    }

    /// Nodes in ascending order are in order of dependence, so that no recursion over the graph is needed.
    fn tangents(&mut self, root: NodeId) -> Result<Vec<Option<NodeId>>, Unsupported> {
        let mut order = vec![];
        let mut stack = vec![root];
        let mut seen = FxHashSet::default();
        while let Some(id) = stack.pop() {
            if self.tangents.contains_key(&id) || !seen.insert(id) {
                continue;
            }
            if id == self.x {
                self.tangents.insert(id, self.seeds.iter().map(|s| Some(*s)).collect());
                continue;
            }
            order.push(id);
            match self.graph.op(id) {
                // These are unrolled: their body as it stands is not what is differentiated.
                Op::Reduce { fold: Fold::Product | Fold::Min | Fold::Max, .. } => {}
                Op::Reduce { depth, .. } if self.bound & (1 << depth) != 0 => {}
                op => Graph::operands(op, |a| stack.push(a)),
            }
        }
        self.spend(order.len())?;
        order.sort_unstable();
        for id in order {
            let outer = self.seed;
            let tangents = match self.shared_loop(id) {
                Some(tangents) => tangents,
                None => (0..self.seeds.len())
                    .map(|seed| {
                        self.seed = seed;
                        self.rule(id)
                    })
                    .collect::<Result<_, _>>()?,
            };
            self.seed = outer;
            self.spend(0)?;
            self.tangents.insert(id, tangents);
        }
        Ok(self.tangents[&root].clone())
    }

    fn of(&self, id: NodeId) -> Option<NodeId> {
        self.tangents.get(&id)?[self.seed]
    }

    /// A sum of scalars has its derivatives along all seeds in one loop, so that what they share is computed once.
    fn shared_loop(&mut self, id: NodeId) -> Option<Vec<Option<NodeId>>> {
        let Op::Reduce { fold: Fold::Sum, depth, start, end, body } = *self.graph.op(id) else { return None };
        if self.graph.width(body) != 1 || self.bound & (1 << depth) != 0 {
            return None;
        }
        let parts: Vec<(usize, NodeId)> =
            self.tangents.get(&body)?.iter().enumerate().filter_map(|(i, t)| t.map(|t| (i, t))).collect();
        if parts.len() < 2 {
            return None;
        }
        let nodes: Vec<NodeId> = parts.iter().map(|p| p.1).collect();
        let together = compose(self.graph, &nodes);
        let sum = self.graph.reduce(Fold::Sum, depth, start..end, together);
        let mut tangents = vec![None; self.seeds.len()];
        for (place, (seed, _)) in parts.into_iter().enumerate() {
            tangents[seed] = Some(self.graph.extract(sum, place as u8));
        }
        Some(tangents)
    }

    fn rule(&mut self, id: NodeId) -> Result<Option<NodeId>, Unsupported> {
        let op = *self.graph.op(id);
        Ok(match op {
            Op::Const(_) | Op::Truth(_) | Op::Param(_) | Op::LoopVar(_) | Op::Compare(..) | Op::CellHash { .. } => None,
            Op::Input(Input::Altitude(shell)) => {
                let known = self.altitudes.iter().find(|a| a.0 == shell).ok_or(Unsupported::Altitude)?;
                self.dot(known.1, self.seeds[self.seed])
            }
            Op::Input(
                Input::Position | Input::Direction | Input::CosTheta | Input::Versine | Input::Vercosine | Input::Time,
            ) => None,
            Op::Unary(u, a) => self.of(a).and_then(|d| self.unary(id, u, a, d)),
            Op::Binary(b, x, y) => self.binary(id, b, x, y),
            Op::PowI(_, 0) => None,
            Op::PowI(a, n) => self.of(a).map(|d| {
                let power = if n == 1 { self.graph.scalar(1.0) } else { self.graph.powi(a, n - 1) };
                let n = self.graph.scalar(f64::from(n));
                let slope = self.op(Binary::Mul, n, power);
                self.op(Binary::Mul, slope, d)
            }),
            Op::Select { condition, accept, reject } => self.choose(condition, self.of(accept), self.of(reject), id),
            Op::Compose(parts, width) => {
                let parts: Vec<_> = parts[..width as usize].iter().map(|p| self.of(*p)).collect();
                self.assemble(&parts)
            }
            Op::Splat(a, width) => self.of(a).map(|d| match self.graph.constant(d) {
                Some(c) => self.graph.vector(&vec![c.get(0); width as usize]),
                None => self.graph.widen(d, width),
            }),
            Op::Extract(a, i) => self.of(a).and_then(|d| self.extract(d, i)),
            Op::Dot(a, b) => {
                let (da, db) = (self.of(a), self.of(b));
                let left = da.and_then(|d| self.dot(d, b));
                let right = db.and_then(|d| self.dot(a, d));
                self.sum(left, right)
            }
            Op::Sample { grid, at } => match self.of(at) {
                Some(d) if self.graph.grid(grid).filter != Filter::Nearest => {
                    let slope = self.graph.push(Op::SampleGradient { grid, at });
                    self.dot(slope, d)
                }
                _ => None,
            },
            Op::SampleGradient { grid, at } => match self.of(at) {
                Some(_) => return Err(Unsupported::SecondDerivativeOfGrid(grid)),
                None => None,
            },
            Op::Lookup { table, at } => self.of(at).map(|d| {
                let slope = self.graph.push(Op::LookupSlope { table, at });
                self.op(Binary::Mul, slope, d)
            }),
            Op::LookupSlope { .. } => None,
            Op::Reduce { depth, .. } if self.bound & (1 << depth) != 0 => None,
            Op::Reduce { fold: Fold::Sum, depth, start, end, body } => {
                self.of(body).map(|d| self.graph.reduce(Fold::Sum, depth, start..end, d))
            }
            Op::Reduce { fold, depth, start, end, body } => self.unrolled(fold, depth, start..end, body)?,
        })
    }

    fn unary(&mut self, id: NodeId, op: Unary, a: NodeId, d: NodeId) -> Option<NodeId> {
        let one = self.graph.scalar(1.0);
        let slope = match op {
            Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Not => return None,
            Unary::Neg => return Some(self.negate(d)),
            Unary::Abs => self.graph.unary(Unary::Sign, a),
            Unary::Sqrt => {
                let half = self.graph.scalar(0.5);
                self.op(Binary::Div, half, id)
            }
            Unary::Exp => id,
            Unary::Expm1 => self.graph.unary(Unary::Exp, a),
            Unary::Log => return Some(self.op(Binary::Div, d, a)),
            Unary::Sin => self.graph.unary(Unary::Cos, a),
            Unary::Cos => {
                let sin = self.graph.unary(Unary::Sin, a);
                self.negate(sin)
            }
            Unary::Tan => {
                let square = self.graph.mul(id, id);
                self.graph.add(one, square)
            }
            Unary::Asin | Unary::Acos => {
                let square = self.graph.mul(a, a);
                let rest = self.graph.sub(one, square);
                let root = self.graph.unary(Unary::Sqrt, rest);
                let quotient = self.op(Binary::Div, d, root);
                return Some(if op == Unary::Acos { self.negate(quotient) } else { quotient });
            }
            Unary::Atan => {
                let square = self.graph.mul(a, a);
                let sum = self.graph.add(one, square);
                return Some(self.op(Binary::Div, d, sum));
            }
            Unary::Sinh => self.graph.unary(Unary::Cosh, a),
            Unary::Cosh => self.graph.unary(Unary::Sinh, a),
            Unary::Tanh => {
                let square = self.graph.mul(id, id);
                self.graph.sub(one, square)
            }
        };
        Some(self.op(Binary::Mul, slope, d))
    }

    fn binary(&mut self, id: NodeId, op: Binary, x: NodeId, y: NodeId) -> Option<NodeId> {
        let (dx, dy) = (self.of(x), self.of(y));
        if dx.is_none() && dy.is_none() {
            return None;
        }
        let times = |this: &mut Self, d: Option<NodeId>, factor: NodeId| d.map(|d| this.op(Binary::Mul, d, factor));
        match op {
            Binary::Add => self.sum(dx, dy),
            Binary::Sub => self.difference(dx, dy),
            Binary::Mul => {
                let (left, right) = (times(self, dx, y), times(self, dy, x));
                self.sum(left, right)
            }
            Binary::Div => {
                let right = times(self, dy, id);
                let top = self.difference(dx, right);
                top.map(|t| self.op(Binary::Div, t, y))
            }
            Binary::Min | Binary::Max => self.extremum(op, (x, y), (dx, dy), id),
            Binary::Pow => {
                let left = dx.map(|d| {
                    let minus_one = self.graph.scalar(-1.0);
                    let exponent = self.op(Binary::Add, y, minus_one);
                    let power = self.graph.binary(Binary::Pow, x, exponent);
                    let slope = self.op(Binary::Mul, y, power);
                    self.op(Binary::Mul, slope, d)
                });
                let right = dy.map(|d| {
                    let log = self.graph.unary(Unary::Log, x);
                    let slope = self.op(Binary::Mul, id, log);
                    self.op(Binary::Mul, slope, d)
                });
                self.sum(left, right)
            }
            Binary::Atan2 => {
                // atan2(y, x) with the operands named as in the graph: x is its first.
                let (left, right) = (times(self, dx, y), times(self, dy, x));
                let top = self.difference(left, right);
                let (xx, yy) = (self.graph.mul(x, x), self.graph.mul(y, y));
                let below = self.graph.add(xx, yy);
                top.map(|t| self.op(Binary::Div, t, below))
            }
            Binary::Mod => {
                let quotient = self.graph.div(x, y);
                let whole = self.graph.unary(Unary::Floor, quotient);
                let right = times(self, dy, whole);
                self.difference(dx, right)
            }
            Binary::And | Binary::Or => None,
        }
    }

    /// The derivative of the operand that `min` or `max` takes, component by component.
    fn extremum(
        &mut self,
        op: Binary,
        (x, y): (NodeId, NodeId),
        (dx, dy): (Option<NodeId>, Option<NodeId>),
        id: NodeId,
    ) -> Option<NodeId> {
        let width = self.graph.width(id);
        let parts: Vec<Option<NodeId>> = (0..width)
            .map(|i| {
                let (xi, yi) = (self.graph.extract(x, i), self.graph.extract(y, i));
                let condition = match op {
                    Binary::Max => self.graph.compare(Compare::Less, yi, xi),
                    _ => self.graph.compare(Compare::Less, xi, yi),
                };
                let di = dx.and_then(|d| self.extract(d, i));
                let dj = dy.and_then(|d| self.extract(d, i));
                self.choose(condition, di, dj, xi)
            })
            .collect();
        self.assemble(&parts)
    }

    /// A product or extremum over a loop, iteration by iteration.
    fn unrolled(
        &mut self,
        fold: Fold,
        depth: u8,
        range: std::ops::Range<i32>,
        body: NodeId,
    ) -> Result<Option<NodeId>, Unsupported> {
        if !self.depends(body)? || range.is_empty() {
            return Ok(None);
        }
        if i64::from(range.end) - i64::from(range.start) > MAX_UNROLL {
            return Err(Unsupported::LongFold(fold));
        }
        let mut values = vec![];
        let mut tangents = vec![];
        for i in range {
            let value = self.substitute(body, depth, f64::from(i))?;
            tangents.push(self.tangents(value)?[self.seed]);
            values.push(value);
        }
        let (mut total, mut tangent) = (values[0], tangents[0]);
        for (value, d) in values.into_iter().zip(tangents).skip(1) {
            let op = match fold {
                Fold::Sum => Binary::Add,
                Fold::Product => Binary::Mul,
                Fold::Min => Binary::Min,
                Fold::Max => Binary::Max,
            };
            let next = self.graph.binary(op, total, value);
            tangent = match fold {
                Fold::Sum => self.sum(tangent, d),
                Fold::Product => {
                    let left = tangent.map(|t| self.op(Binary::Mul, t, value));
                    let right = d.map(|d| self.op(Binary::Mul, d, total));
                    self.sum(left, right)
                }
                Fold::Min | Fold::Max => self.extremum(op, (total, value), (tangent, d), next),
            };
            total = next;
        }
        Ok(tangent)
    }

    /// Whether a node is reached through the variable.
    fn depends(&mut self, root: NodeId) -> Result<bool, Unsupported> {
        let mut stack = vec![root];
        let mut seen = FxHashSet::default();
        let mut found = false;
        while let Some(id) = stack.pop() {
            if !seen.insert(id) {
                continue;
            }
            match self.graph.op(id) {
                _ if id == self.x => found = true,
                Op::Input(Input::Altitude(_)) => found = true,
                Op::Reduce { depth, .. } if self.bound & (1 << depth) != 0 => {}
                op => Graph::operands(op, |a| stack.push(a)),
            }
        }
        self.spend(seen.len())?;
        Ok(found)
    }

    /// The node with a number in place of the loop variable of this depth.
    fn substitute(&mut self, root: NodeId, depth: u8, value: f64) -> Result<NodeId, Unsupported> {
        let mut order = vec![];
        let mut stack = vec![root];
        let mut map = FxHashMap::<NodeId, NodeId>::default();
        while let Some(id) = stack.pop() {
            if map.insert(id, id).is_some() {
                continue;
            }
            match self.graph.op(id) {
                // An inner loop of the same depth binds the variable anew.
                Op::Reduce { depth: inner, .. } if *inner == depth => {}
                op => {
                    order.push(id);
                    Graph::operands(op, |a| stack.push(a));
                }
            }
        }
        self.spend(order.len())?;
        order.sort_unstable();
        for id in order {
            let op = *self.graph.op(id);
            let new = match op {
                Op::LoopVar(d) if d == depth => self.graph.scalar(value),
                _ => self.graph.push(Graph::map_operands(&op, |a| map[&a])),
            };
            map.insert(id, new);
        }
        self.spend(0)?;
        Ok(map[&root])
    }

    /// `condition ? a : b`, of the width of `like`.
    fn choose(&mut self, condition: NodeId, a: Option<NodeId>, b: Option<NodeId>, like: NodeId) -> Option<NodeId> {
        if a.is_none() && b.is_none() {
            return None;
        }
        let zero = self.graph.vector(&vec![0.0; self.graph.width(like) as usize]);
        Some(self.graph.select(condition, a.unwrap_or(zero), b.unwrap_or(zero)))
    }

    fn assemble(&mut self, parts: &[Option<NodeId>]) -> Option<NodeId> {
        if parts.iter().all(Option::is_none) {
            return None;
        }
        let zero = self.graph.scalar(0.0);
        let parts: Vec<NodeId> = parts.iter().map(|p| p.unwrap_or(zero)).collect();
        Some(compose(self.graph, &parts))
    }

    fn sum(&mut self, a: Option<NodeId>, b: Option<NodeId>) -> Option<NodeId> {
        match (a, b) {
            (Some(a), Some(b)) => Some(self.op(Binary::Add, a, b)),
            (a, b) => a.or(b),
        }
    }

    fn difference(&mut self, a: Option<NodeId>, b: Option<NodeId>) -> Option<NodeId> {
        match (a, b) {
            (Some(a), Some(b)) => Some(self.op(Binary::Sub, a, b)),
            (None, Some(b)) => Some(self.negate(b)),
            (a, None) => a,
        }
    }

    fn negate(&mut self, a: NodeId) -> NodeId {
        match self.graph.constant(a) {
            Some(c) => {
                let values: Vec<f64> = c.values().iter().map(|v| -v).collect();
                self.graph.vector(&values)
            }
            None => self.graph.unary(Unary::Neg, a),
        }
    }

    fn extract(&mut self, a: NodeId, i: u8) -> Option<NodeId> {
        match self.graph.constant(a) {
            Some(c) if c.width() > 1 => (c.get(i as usize) != 0.0).then(|| self.graph.scalar(c.get(i as usize))),
            _ => Some(self.graph.extract(a, i)),
        }
    }

    fn dot(&mut self, a: NodeId, b: NodeId) -> Option<NodeId> {
        if let (Some(x), Some(y)) = (self.graph.constant(a), self.graph.constant(b)) {
            let sum: f64 = x.values().iter().zip(y.values()).map(|(x, y)| x * y).sum();
            return (sum != 0.0).then(|| self.graph.scalar(sum));
        }
        // Along an axis the product is a component.
        for (vector, other) in [(a, b), (b, a)] {
            if let Some(values) = self.graph.constant(vector).map(|c| c.values()) {
                let mut set = values.iter().enumerate().filter(|(_, v)| **v != 0.0);
                match (set.next(), set.next()) {
                    (None, _) => return None,
                    (Some((i, 1.0)), None) => return self.extract(other, i as u8),
                    _ => {}
                }
            }
        }
        Some(self.graph.dot(a, b))
    }

    /// An operation that folds constants and drops factors of 1.
    fn op(&mut self, op: Binary, a: NodeId, b: NodeId) -> NodeId {
        let width = self.graph.width(a).max(self.graph.width(b));
        if let (Some(x), Some(y)) = (self.constant(a, width), self.constant(b, width)) {
            let values: Vec<f64> = x.iter().zip(&y).map(|(x, y)| eval::binary(op, *x, *y)).collect();
            return self.graph.vector(&values);
        }
        match op {
            Binary::Mul if self.graph.number(a) == Some(1.0) => self.graph.widen(b, width),
            Binary::Mul | Binary::Div if self.graph.number(b) == Some(1.0) => self.graph.widen(a, width),
            _ => self.graph.binary(op, a, b),
        }
    }

    fn constant(&self, id: NodeId, width: u8) -> Option<Vec<f64>> {
        let c = self.graph.constant(id)?;
        Some((0..width as usize).map(|i| c.get(if c.width() == 1 { 0 } else { i })).collect())
    }
}
