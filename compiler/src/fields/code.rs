//! Nodes as kernel expressions.

use super::builder::{Code, KernelBuilder};
use super::helpers::Helper;
use crate::ir::{
    Binary, Compare, Fold, Graph, Input, NodeId, Op, Step, Tier, Type, Unary, free_variables, schedule_with,
};
use crate::program::kernel::{Expr, FunctionId, Math, Prim, Ty};
use crate::source::Span;
use rustc_hash::{FxHashMap, FxHashSet};

/// Deepest expression without a name of its own.
const DEPTH: u32 = 8;

/// Writes nodes into a function.
pub struct Writer<'a> {
    graph: &'a Graph,
    tiers: &'a [Tier],
    free: Vec<u16>,
    /// Values that are known here: inputs, hoisted nodes, nodes already written.
    values: FxHashMap<NodeId, Expr>,
    /// Depth of the inline expressions among them.
    depth: FxHashMap<NodeId, u32>,
    /// How often each node is used by what is being written.
    uses: FxHashMap<NodeId, u32>,
}

impl<'a> Writer<'a> {
    /// A writer over a graph and its tiers.
    #[must_use]
    pub fn new(graph: &'a Graph, tiers: &'a [Tier]) -> Self {
        Self {
            graph,
            tiers,
            free: free_variables(graph),
            values: FxHashMap::default(),
            depth: FxHashMap::default(),
            uses: FxHashMap::default(),
        }
    }

    /// Declares the value of a node: an input, or something computed outside.
    pub fn know(&mut self, node: NodeId, value: Expr) {
        self.values.insert(node, value);
    }

    /// Declares the value of an input, if the graph uses it.
    pub fn know_input(&mut self, input: Input, value: Expr) {
        if let Some(node) = self.graph.ids().find(|id| *self.graph.op(*id) == Op::Input(input)) {
            self.know(node, value);
        }
    }

    fn hosted(&self, node: NodeId) -> bool {
        self.tiers[node.0 as usize] <= Tier::Frame && self.free[node.0 as usize] == 0
    }

    /// Writes what the roots need and gives their values.
    pub fn write(&mut self, builder: &mut KernelBuilder, code: &mut Code, roots: &[NodeId]) -> Vec<Expr> {
        let steps = schedule_with(self.graph, roots, |n| self.hosted(n) || self.values.contains_key(&n));
        count_uses(self.graph, &steps, &mut self.uses);
        for root in roots {
            *self.uses.entry(*root).or_default() += 1;
        }
        self.steps(builder, code, &steps);
        roots.iter().map(|r| self.get(builder, *r)).collect()
    }

    fn get(&mut self, builder: &mut KernelBuilder, node: NodeId) -> Expr {
        if let Some(value) = self.values.get(&node) {
            return value.clone();
        }
        builder.value(self.graph, node, "value")
    }

    fn steps(&mut self, builder: &mut KernelBuilder, code: &mut Code, steps: &[Step]) {
        for step in steps {
            match step {
                Step::Node(id) => self.node(builder, code, *id),
                Step::Loop(id, inner) => self.reduce(builder, code, *id, inner),
            }
        }
    }

    fn name(&self, id: NodeId) -> String {
        if let Some(name) = &self.graph.origin(id).name {
            return name.rsplit('.').next().unwrap_or(name).to_owned();
        }
        let word = match self.graph.op(id) {
            Op::Sample { .. } => "sample",
            Op::SampleGradient { .. } => "gradient",
            Op::Lookup { .. } => "layer",
            Op::CellHash { .. } => "hash",
            Op::Reduce { fold: Fold::Sum, .. } => "sum",
            Op::Reduce { fold: Fold::Product, .. } => "product",
            Op::Reduce { fold: Fold::Min, .. } => "least",
            Op::Reduce { fold: Fold::Max, .. } => "most",
            Op::Unary(Unary::Floor, _) => "cell",
            Op::Dot(..) => "dot",
            _ => "v",
        };
        word.to_owned()
    }

    fn node(&mut self, builder: &mut KernelBuilder, code: &mut Code, id: NodeId) {
        let mut deepest = 0;
        Graph::operands(self.graph.op(id), |a| deepest = deepest.max(self.depth.get(&a).copied().unwrap_or(0)));
        let value = self.expression(builder, code, id);
        let heavy = matches!(
            self.graph.op(id),
            Op::Sample { .. }
                | Op::SampleGradient { .. }
                | Op::Lookup { .. }
                | Op::LookupSlope { .. }
                | Op::CellHash { .. }
        );
        let shared = self.uses.get(&id).copied().unwrap_or(0) > 1;
        // Taking apart something that has a name costs nothing: another name would only be in the way.
        let trivial = match &value {
            Expr::Splat(inner, _) | Expr::Component(inner, _) => is_atom(inner),
            other => is_atom(other),
        };
        let named = self.graph.origin(id).name.is_some();
        if !trivial && (heavy || shared || named || deepest >= DEPTH) {
            let origin = self.graph.origin(id).span;
            let bound = code.bind_from(&self.name(id), type_of(self.graph, id), value, origin);
            self.values.insert(id, bound);
            self.depth.insert(id, 0);
        } else {
            self.values.insert(id, value);
            self.depth.insert(id, deepest + 1);
        }
    }

    fn expression(&mut self, builder: &mut KernelBuilder, code: &mut Code, id: NodeId) -> Expr {
        let graph = self.graph;
        let width = graph.width(id);
        match *graph.op(id) {
            Op::Const(_) | Op::Truth(_) | Op::Param(_) => builder.value(graph, id, "value"),
            // What the caller declares is never scheduled; a loop variable is bound by its loop.
            Op::Input(_) | Op::LoopVar(_) | Op::Reduce { .. } => self.get(builder, id),
            Op::Unary(op, a) => {
                let a = self.get(builder, a);
                self.unary(builder, code, op, a, width)
            }
            Op::Binary(op, a, b) => {
                let (mut a, mut b) = (self.get(builder, a), self.get(builder, b));
                if op == Binary::Mod {
                    // Both are read twice.
                    a = named(code, "dividend", Ty::float(width), a);
                    b = named(code, "divisor", Ty::float(width), b);
                }
                match op {
                    Binary::Add => a + b,
                    Binary::Sub => a - b,
                    Binary::Mul => a * b,
                    Binary::Div => a / b,
                    Binary::Min => a.min(b),
                    Binary::Max => a.max(b),
                    Binary::Pow => Expr::math(Math::Pow, [a, b]),
                    Binary::Atan2 => Expr::math(Math::Atan2, [a, b]),
                    Binary::Mod => a.clone() - b.clone() * Expr::math(Math::Floor, [a / b]),
                    Binary::And => a.and(b),
                    Binary::Or => a.or(b),
                }
            }
            Op::PowI(a, n) => {
                let base = self.get(builder, a);
                power(code, base, n, Ty::float(width), width)
            }
            Op::Compare(op, a, b) => {
                let (a, b) = (self.get(builder, a), self.get(builder, b));
                match op {
                    Compare::Less => a.less(b),
                    Compare::LessEqual => a.less_equal(b),
                    Compare::Equal => a.equal(b),
                }
            }
            Op::Select { condition, accept, reject } => {
                let (accept, reject) = (self.get(builder, accept), self.get(builder, reject));
                self.get(builder, condition).select(accept, reject)
            }
            Op::Compose(parts, width) => {
                let parts = parts[..width as usize].iter().map(|p| self.get(builder, *p)).collect();
                Expr::Compose(Ty::float(width), parts)
            }
            Op::Splat(a, width) => self.get(builder, a).splat(width),
            Op::Extract(a, i) => self.get(builder, a).component(i),
            Op::Dot(a, b) => self.get(builder, a).dot(self.get(builder, b)),
            Op::Sample { grid, at } => {
                let at = self.get(builder, at);
                builder.call(graph, Helper::Sample(grid), [at])
            }
            Op::SampleGradient { grid, at } => {
                let at = self.get(builder, at);
                builder.call(graph, Helper::SampleGradient(grid), [at])
            }
            Op::Lookup { table, at } => {
                let at = self.get(builder, at);
                builder.call(graph, Helper::Lookup(table), [at])
            }
            Op::LookupSlope { table, at } => {
                let at = self.get(builder, at);
                builder.call(graph, Helper::LookupSlope(table), [at])
            }
            Op::CellHash { cell, seed } => {
                let (cell, seed) = (self.get(builder, cell), self.get(builder, seed));
                builder.call(graph, Helper::CellHash, [cell, seed])
            }
        }
    }

    fn unary(&self, builder: &mut KernelBuilder, code: &mut Code, op: Unary, a: Expr, width: u8) -> Expr {
        let math = |f: Math, a: Expr| Expr::math(f, [a]);
        match op {
            Unary::Neg => -a,
            Unary::Not => !a,
            Unary::Abs => math(Math::Abs, a),
            Unary::Sign => math(Math::Sign, a),
            Unary::Floor => math(Math::Floor, a),
            Unary::Ceil => math(Math::Ceil, a),
            Unary::Round => math(Math::Round, a),
            Unary::Sqrt => math(Math::Sqrt, a),
            Unary::Exp => math(Math::Exp, a),
            Unary::Expm1 => {
                let a = named(code, "x", Ty::float(width), a);
                componentwise(width, a, |x| builder.call(self.graph, Helper::Expm1, [x]))
            }
            Unary::Log => math(Math::Log, a),
            Unary::Sin => math(Math::Sin, a),
            Unary::Cos => math(Math::Cos, a),
            Unary::Tan => math(Math::Tan, a),
            Unary::Asin => math(Math::Asin, a),
            Unary::Acos => math(Math::Acos, a),
            Unary::Atan => math(Math::Atan, a),
            Unary::Sinh => math(Math::Sinh, a),
            Unary::Cosh => math(Math::Cosh, a),
            Unary::Tanh => math(Math::Tanh, a),
        }
    }

    fn reduce(&mut self, builder: &mut KernelBuilder, code: &mut Code, id: NodeId, inner: &[Step]) {
        let graph = self.graph;
        let Op::Reduce { fold, depth, start, end, body } = *graph.op(id) else { return };
        let ty = type_of(graph, id);
        let width = graph.width(id);
        let identity = match fold {
            Fold::Sum => 0.0,
            Fold::Product => 1.0,
            // Infinity is no literal; the largest number serves, since loops over nothing are refused earlier.
            Fold::Min => f64::from(f32::MAX),
            Fold::Max => -f64::from(f32::MAX),
        };
        let total = code.var(&self.name(id), ty, Expr::F32(identity).splat(width));
        let index = code.var("i", Ty::I32, Expr::I32(start));
        let (values, depths) = (self.values.clone(), self.depth.clone());
        code.open();
        let variable = code.bind("n", Ty::F32, Expr::Local(index).convert(Prim::F32));
        if let Some(node) = graph.ids().find(|n| *graph.op(*n) == Op::LoopVar(depth)) {
            self.values.insert(node, variable);
        }
        self.steps(builder, code, inner);
        let value = self.get(builder, body);
        let so_far = Expr::Local(total);
        let next = match fold {
            Fold::Sum => so_far + value,
            Fold::Product => so_far * value,
            Fold::Min => so_far.min(value),
            Fold::Max => so_far.max(value),
        };
        code.set(total, next);
        code.set(index, Expr::Local(index) + Expr::I32(1));
        code.break_if(Expr::Local(index).greater_equal(Expr::I32(end)));
        let block = code.close();
        // A loop over nothing leaves what there is of nothing.
        if start < end {
            code.push_loop(block);
        }
        // What was computed inside varies with the loop and is not known outside.
        self.values = values;
        self.depth = depths;
        let done = code.bind(&self.name(id), ty, total);
        self.values.insert(id, done);
    }
}

fn count_uses(graph: &Graph, steps: &[Step], uses: &mut FxHashMap<NodeId, u32>) {
    for step in steps {
        match step {
            Step::Node(id) => Graph::operands(graph.op(*id), |a| *uses.entry(a).or_default() += 1),
            Step::Loop(id, inner) => {
                // What a loop takes from outside must be computed before it, not in every round: counted twice.
                let mut inside = FxHashSet::default();
                nodes_of(inner, &mut inside);
                let mut operands = vec![];
                for node in &inside {
                    Graph::operands(graph.op(*node), |a| operands.push(a));
                }
                for a in operands.into_iter().filter(|a| !inside.contains(a)) {
                    *uses.entry(a).or_default() += 2;
                }
                count_uses(graph, inner, uses);
                Graph::operands(graph.op(*id), |a| *uses.entry(a).or_default() += 1);
            }
        }
    }
}

fn nodes_of(steps: &[Step], out: &mut FxHashSet<NodeId>) {
    for step in steps {
        match step {
            Step::Node(id) => {
                out.insert(*id);
            }
            Step::Loop(id, inner) => {
                out.insert(*id);
                nodes_of(inner, out);
            }
        }
    }
}

fn type_of(graph: &Graph, id: NodeId) -> Ty {
    match graph.ty(id) {
        Type::Bool => Ty::BOOL,
        Type::Float(w) => Ty::float(w),
    }
}

/// Whether reading this twice is free.
fn is_atom(value: &Expr) -> bool {
    matches!(
        value,
        Expr::F32(_)
            | Expr::I32(_)
            | Expr::U32(_)
            | Expr::Bool(_)
            | Expr::Local(_)
            | Expr::Argument(_)
            | Expr::Uniform(_)
            | Expr::GlobalId
            | Expr::GroupId
            | Expr::LocalIndex
            | Expr::VertexIndex
            | Expr::InstanceIndex
    )
}

/// The value under a name, unless reading it twice is free anyway.
pub(super) fn named(code: &mut Code, name: &str, ty: Ty, value: Expr) -> Expr {
    if is_atom(&value) { value } else { code.bind(name, ty, value) }
}

/// A scalar function on each component.
pub(super) fn componentwise(width: u8, a: Expr, mut f: impl FnMut(Expr) -> Expr) -> Expr {
    if width == 1 {
        return f(a);
    }
    Expr::Compose(Ty::float(width), (0..width).map(|i| f(a.clone().component(i))).collect())
}

/// Integer power by repeated squaring; |n| > 64 by exp and log would lose more than it saves, so it multiplies too.
fn power(code: &mut Code, base: Expr, n: i32, ty: Ty, width: u8) -> Expr {
    let one = || Expr::F32(1.0).splat(width);
    if n == 0 {
        return one();
    }
    let mut square = named(code, "x", ty, base);
    let mut rest = n.unsigned_abs();
    let mut result: Option<Expr> = None;
    while rest > 0 {
        if rest & 1 == 1 {
            result = Some(match result {
                Some(r) => code.bind("power", ty, r * square.clone()),
                None => square.clone(),
            });
        }
        rest >>= 1;
        if rest > 0 {
            square = code.bind("square", ty, square.clone() * square);
        }
    }
    let result = result.unwrap_or_else(one);
    if n < 0 { one() / result } else { result }
}

/// A function of the position that gives several fields at once.
#[derive(Clone, Debug)]
pub struct FieldFunction {
    /// Which function of the kernel.
    pub id: FunctionId,
    /// What it returns: the one field, or a struct of them.
    pub result: Ty,
    /// Nodes of tier Ray that the caller computes and passes after the position.
    pub hoisted: Vec<NodeId>,
    /// Shells whose altitude the caller passes after those.
    pub altitudes: Vec<u32>,
    /// Number of fields.
    pub count: usize,
}

impl FieldFunction {
    /// Field `i` of a value this function returned.
    #[must_use]
    pub fn part(&self, value: &Expr, i: usize) -> Expr {
        if self.count == 1 { value.clone() } else { value.clone().field(i as u32) }
    }
}

/// Writes a function `name(p, hoisted…, altitudes…)` of some fields.
pub fn field_function(
    graph: &Graph,
    tiers: &[Tier],
    builder: &mut KernelBuilder,
    name: &str,
    origin: Option<Span>,
    roots: &[(&str, NodeId)],
) -> FieldFunction {
    let ids: Vec<NodeId> = roots.iter().map(|r| r.1).collect();
    let free = free_variables(graph);
    let live = graph.reachable(&ids);
    // The maximal nodes of tier Ray: what a node of tier Sample (or the result) takes from the ray.
    let mut hoisted: FxHashSet<NodeId> = ids.iter().copied().filter(|n| tiers[n.0 as usize] == Tier::Ray).collect();
    let mut altitudes = vec![];
    for id in graph.ids().filter(|id| live[id.0 as usize]) {
        if let Op::Input(Input::Altitude(shell)) = *graph.op(id) {
            altitudes.push(shell);
        }
        let within_loop = free[id.0 as usize] != 0;
        if tiers[id.0 as usize] == Tier::Sample || within_loop {
            Graph::operands(graph.op(id), |a| {
                if tiers[a.0 as usize] == Tier::Ray && free[a.0 as usize] == 0 {
                    hoisted.insert(a);
                }
            });
        }
    }
    let mut hoisted: Vec<NodeId> = hoisted.into_iter().collect();
    hoisted.sort_unstable();
    let mut code = Code::new(name, origin);
    let mut writer = Writer::new(graph, tiers);
    let p = code.parameter("p", Ty::VEC3);
    writer.know_input(Input::Position, p);
    for (i, node) in hoisted.iter().enumerate() {
        let name = graph.origin(*node).name.clone().unwrap_or_else(|| format!("along_{i}"));
        let value = code.parameter(&name, type_of(graph, *node));
        writer.know(*node, value);
    }
    for shell in &altitudes {
        let h = code.parameter("h", Ty::F32);
        writer.know_input(Input::Altitude(*shell), h);
    }
    let values = writer.write(builder, &mut code, &ids);
    let result = if let [(_, only)] = roots {
        code.return_(values[0].clone());
        type_of(graph, *only)
    } else {
        let fields = roots.iter().map(|(name, node)| ((*name).to_owned(), type_of(graph, *node))).collect();
        let ty = builder.add_struct(&format!("{name}_fields"), fields);
        code.return_(Expr::Compose(ty, values));
        ty
    };
    let id = builder.add_function(code.finish(Some(result)));
    FieldFunction { id, result, hoisted, altitudes, count: roots.len() }
}

/// A phase function in a kernel.
#[derive(Clone, Debug)]
pub struct PhaseFunction {
    /// Which function of the kernel.
    pub id: FunctionId,
    /// The inputs that the caller passes, in order.
    pub inputs: Vec<Input>,
}

/// Writes a function `name(inputs…)` of a phase function, with the inputs that it reads and no others.
pub fn phase_function(
    graph: &Graph,
    tiers: &[Tier],
    builder: &mut KernelBuilder,
    name: &str,
    node: NodeId,
) -> PhaseFunction {
    let live = graph.reachable(&[node]);
    let mut inputs = vec![];
    for id in graph.ids().filter(|id| live[id.0 as usize]) {
        match *graph.op(id) {
            Op::Input(Input::Time) => {}
            Op::Input(input) => inputs.push(input),
            _ => {}
        }
    }
    let mut code = Code::new(name, graph.origin(node).span);
    let mut writer = Writer::new(graph, tiers);
    for input in &inputs {
        let name = match input {
            Input::Position => "p",
            Input::Direction => "dir",
            Input::CosTheta => "cos_theta",
            Input::Versine => "versine",
            Input::Vercosine => "vercosine",
            Input::Time => "time",
            Input::Altitude(_) => "h",
        };
        let value = code.parameter(name, Ty::float(input.ty().width()));
        writer.know_input(*input, value);
    }
    let value = writer.write(builder, &mut code, &[node]).remove(0);
    code.return_(value);
    let id = builder.add_function(code.finish(Some(type_of(graph, node))));
    PhaseFunction { id, inputs }
}
