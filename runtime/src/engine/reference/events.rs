//! Where a field may not be smooth: read off its operations, so that integration can be split there.
//!
//! Each such place is a level set of some scalar node of the graph: zero of the argument of `abs`, whole numbers of that of
//! `floor`, equality of the arguments of `min`, `max` and comparisons, stops of tables, faces of voxels. Nodes that are affine
//! in the position are straight along a ray and are solved at once; others are searched for in each panel. What is found here
//! only places the splits; a place that is missed costs evaluations, since the adaptive integration then has to find it.

use compiler::ir::eval::Tables;
use compiler::ir::{Binary, Filter, Graph, Input, NodeId, Op, Tier, Unary};
use std::collections::{HashMap, HashSet};

/// Values at which something happens.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Levels {
    /// Ascending.
    pub(super) list: Vec<f64>,
    /// Also every whole number plus this offset.
    pub(super) lattice: Option<f64>,
    /// Values and most slopes are continuous there: a rough integration may ignore some.
    pub(super) soft: bool,
}

impl Levels {
    fn list(mut list: Vec<f64>) -> Self {
        list.sort_by(f64::total_cmp);
        list.dedup();
        Self { list, lattice: None, soft: false }
    }

    fn zero() -> Self {
        Self::list(vec![0.0])
    }

    fn whole(offset: f64) -> Self {
        Self { list: vec![], lattice: Some(offset), soft: false }
    }

    /// How many levels lie within [low, high]: an upper bound that is cheap.
    pub(super) fn count(&self, low: f64, high: f64) -> f64 {
        if low.is_nan() || high.is_nan() || low > high {
            return 0.0;
        }
        let listed = self.list.partition_point(|l| *l <= high) - self.list.partition_point(|l| *l < low);
        let lattice = self.lattice.map_or(0.0, |o| ((high - o).floor() - (low - o).ceil() + 1.0).max(0.0));
        listed as f64 + lattice
    }

    /// Calls `visit` for each level within [low, high].
    pub(super) fn visit(&self, low: f64, high: f64, mut visit: impl FnMut(f64)) {
        if low.is_nan() || high.is_nan() || low > high {
            return;
        }
        let first = self.list.partition_point(|l| *l < low);
        self.list[first..].iter().take_while(|l| **l <= high).for_each(|l| visit(*l));
        if let Some(offset) = self.lattice {
            let mut k = (low - offset).ceil();
            while k + offset <= high {
                visit(k + offset);
                k += 1.0;
            }
        }
    }
}

/// What is looked for in a node.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Watch {
    /// Places where the value passes a level.
    Levels(Levels),
    /// The argument of an `exp`: a maximum inside a panel is a peak of the field.
    Peak,
    /// A denominator: a smallest magnitude inside a panel is a peak of the field.
    Pole,
}

/// A scalar node and what is looked for in it.
#[derive(Clone, Debug)]
pub(super) struct Event {
    pub(super) node: NodeId,
    pub(super) watch: Watch,
    /// Found by unrolling a loop: the node is evaluated for its own sake alone.
    pub(super) unrolled: bool,
}

/// Events of some roots, those that are straight along every ray apart.
#[derive(Clone, Debug, Default)]
pub(super) struct Events {
    pub(super) straight: Vec<Event>,
    pub(super) curved: Vec<Event>,
}

/// Curved events are evaluated with every panel; more than this many cost more than they save.
const MAX_CURVED: usize = 48;
/// Loops are unrolled for their events up to this many nodes.
const MAX_UNROLLED: usize = 100_000;

/// How a node varies along a ray, by node: 0 not at all, 1 linearly, 2 in some other way.
pub(super) fn degrees(graph: &Graph) -> Vec<u8> {
    let tiers = graph.tiers();
    let mut degree: Vec<u8> = Vec::with_capacity(graph.len());
    for id in graph.ids() {
        let of = |n: NodeId| degree[n.0 as usize];
        let d = if tiers[id.0 as usize] < Tier::Sample {
            0
        } else {
            match *graph.op(id) {
                Op::Input(Input::Position) => 1,
                Op::Unary(Unary::Neg, a) | Op::Splat(a, _) => of(a),
                Op::Extract(a, i) => match *graph.op(a) {
                    Op::Compose(parts, _) => of(parts[i as usize]),
                    _ => of(a),
                },
                Op::Binary(Binary::Add | Binary::Sub, a, b) => of(a).max(of(b)),
                Op::Binary(Binary::Mul, a, b) | Op::Dot(a, b) => (of(a) + of(b)).min(2),
                Op::Binary(Binary::Div, a, b) if of(b) == 0 => of(a),
                Op::Compose(parts, w) => parts[..w as usize].iter().map(|p| of(*p)).max().unwrap_or(0),
                Op::PowI(a, 1) => of(a),
                _ => 2,
            }
        };
        degree.push(d);
    }
    degree
}

/// Finds the events of `roots`, adding the nodes that describe them to the graph. `tables` are this frame's.
pub(super) fn find(graph: &mut Graph, roots: &[NodeId], tables: &Tables) -> Events {
    let mut found = Found { graph, tables, seen: HashSet::new(), list: vec![], unrolled: false };
    found.walk(roots);
    let list = found.list;
    let degree = degrees(graph);
    let mut events = Events::default();
    for event in list {
        match degree[event.node.0 as usize] {
            0 => {}
            1 if matches!(event.watch, Watch::Levels(_)) => events.straight.push(event),
            1 => {}
            _ if events.curved.len() < MAX_CURVED => events.curved.push(event),
            _ => {}
        }
    }
    events
}

struct Found<'a> {
    graph: &'a mut Graph,
    tables: &'a Tables,
    seen: HashSet<NodeId>,
    list: Vec<Event>,
    /// What is being looked at lies inside a loop.
    unrolled: bool,
}

impl Found<'_> {
    fn walk(&mut self, roots: &[NodeId]) {
        let limit = self.graph.len() + MAX_UNROLLED;
        let mut stack: Vec<(NodeId, bool)> = roots.iter().map(|r| (*r, false)).collect();
        while let Some((id, unrolled)) = stack.pop() {
            if !self.seen.insert(id) {
                continue;
            }
            self.unrolled = unrolled;
            let op = *self.graph.op(id);
            if let Op::Reduce { depth, start, end, body, .. } = op {
                for i in start..end {
                    if self.graph.len() > limit {
                        break;
                    }
                    // First in, last out: what does not depend on the loop is met outside of it first.
                    let body = substitute(self.graph, body, depth, f64::from(i));
                    stack.insert(0, (body, true));
                }
                continue;
            }
            self.note(&op);
            Graph::operands(&op, |a| stack.push((a, unrolled)));
        }
    }

    fn add(&mut self, node: NodeId, watch: Watch) {
        if !self.list.iter().any(|e| e.node == node && e.watch == watch) {
            self.list.push(Event { node, watch, unrolled: self.unrolled });
        }
    }

    /// Watches each component of a node.
    fn each(&mut self, node: NodeId, watch: impl Fn(usize) -> Watch) {
        for c in 0..self.graph.width(node) {
            // Seen through `Compose`, so that one straight component is not lost beside curved ones.
            let part = match *self.graph.op(node) {
                Op::Compose(parts, _) => parts[c as usize],
                _ => self.graph.extract(node, c),
            };
            self.add(part, watch(c as usize));
        }
    }

    fn note(&mut self, op: &Op) {
        match *op {
            Op::Unary(Unary::Abs | Unary::Sign, a) => self.each(a, |_| Watch::Levels(Levels::zero())),
            Op::Unary(Unary::Floor | Unary::Ceil, a) => self.each(a, |_| Watch::Levels(Levels::whole(0.0))),
            Op::Unary(Unary::Round, a) => self.each(a, |_| Watch::Levels(Levels::whole(0.5))),
            Op::Unary(Unary::Exp, a) => self.each(a, |_| Watch::Peak),
            Op::Binary(Binary::Min | Binary::Max, a, b) => {
                let difference = self.graph.sub(a, b);
                self.each(difference, |_| Watch::Levels(Levels::zero()));
            }
            Op::Compare(_, a, b) => {
                let difference = self.graph.sub(a, b);
                self.add(difference, Watch::Levels(Levels::zero()));
            }
            Op::Binary(Binary::Mod, a, b) => {
                let quotient = self.graph.div(a, b);
                self.each(quotient, |_| Watch::Levels(Levels::whole(0.0)));
            }
            Op::Binary(Binary::Div, _, b) => self.each(b, |_| Watch::Pole),
            Op::PowI(a, n) if n < 0 => self.each(a, |_| Watch::Pole),
            Op::Sample { grid, at } | Op::SampleGradient { grid, at } => {
                let info = self.graph.grid(grid);
                let (dims, filter) = (info.header.dims, info.filter);
                self.each(at, |axis| {
                    let n = dims[axis];
                    let (offset, soft) = match filter {
                        Filter::Nearest => (0.5, false),
                        Filter::Linear | Filter::Cubic => (0.0, true),
                    };
                    let levels = Levels::list((0..n).map(|i| f64::from(i) + offset).collect());
                    Watch::Levels(Levels { soft, ..levels })
                });
                // The outer faces, where the grid's `outside` begins.
                self.each(at, |axis| Watch::Levels(Levels::list(vec![-0.5, f64::from(dims[axis]) - 0.5])));
            }
            Op::Lookup { table, at } | Op::LookupSlope { table, at } => {
                let keys = self.tables.get(table).keys.clone();
                self.add(at, Watch::Levels(Levels::list(keys)));
            }
            Op::CellHash { cell, .. } if !self.is_whole(cell) => self.each(cell, |_| Watch::Levels(Levels::whole(0.0))),
            Op::CellHash { .. }
            | Op::Const(_)
            | Op::Truth(_)
            | Op::Input(_)
            | Op::Param(_)
            | Op::LoopVar(_)
            | Op::Unary(..)
            | Op::Binary(..)
            | Op::PowI(..)
            | Op::Select { .. }
            | Op::Compose(..)
            | Op::Splat(..)
            | Op::Extract(..)
            | Op::Dot(..)
            | Op::Reduce { .. } => {}
        }
    }

    /// Whether a node is made of whole numbers already, whose jumps are events of their own.
    fn is_whole(&self, id: NodeId) -> bool {
        match *self.graph.op(id) {
            Op::Unary(Unary::Floor | Unary::Ceil | Unary::Round, _) => true,
            Op::Const(c) => c.values().iter().all(|v| v.fract() == 0.0),
            Op::Binary(Binary::Add | Binary::Sub, a, b) => self.is_whole(a) && self.is_whole(b),
            Op::Compose(parts, w) => parts[..w as usize].iter().all(|p| self.is_whole(*p)),
            Op::Splat(a, _) | Op::Extract(a, _) => self.is_whole(a),
            _ => false,
        }
    }
}

/// `body` with the variable of loop `depth` replaced by a number.
fn substitute(graph: &mut Graph, body: NodeId, depth: u8, value: f64) -> NodeId {
    let mut order = vec![];
    let mut seen = HashSet::new();
    let mut stack = vec![body];
    while let Some(id) = stack.pop() {
        if !seen.insert(id) {
            continue;
        }
        order.push(id);
        match graph.op(id) {
            // An inner loop of the same depth binds the variable anew.
            Op::Reduce { depth: inner, .. } if *inner == depth => {}
            op => Graph::operands(op, |a| stack.push(a)),
        }
    }
    order.sort_unstable();
    let mut map: HashMap<NodeId, NodeId> = HashMap::new();
    for id in order {
        let new = match *graph.op(id) {
            Op::LoopVar(d) if d == depth => graph.scalar(value),
            Op::Reduce { depth: inner, .. } if inner == depth => continue,
            ref op => {
                let op = Graph::map_operands(op, |a| map.get(&a).copied().unwrap_or(a));
                graph.push(op)
            }
        };
        if new != id {
            map.insert(id, new);
        }
    }
    map.get(&body).copied().unwrap_or(body)
}
