//! The order of evaluation of some roots: operands first, what does not depend on a loop before the loop.

use super::{Graph, NodeId, Op};

/// One step of an evaluation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Evaluate this node; its operands have been evaluated in this or an enclosing loop.
    Node(NodeId),
    /// Evaluate this [`Op::Reduce`] by running the steps for each value of its variable, then folding its body's value.
    Loop(NodeId, Vec<Step>),
}

/// The loop variables, as a set of depths, that each node depends on without binding them.
#[must_use]
pub fn free_variables(graph: &Graph) -> Vec<u16> {
    let mut free = vec![0u16; graph.len()];
    for id in graph.ids() {
        let op = graph.op(id);
        let mut mask = 0;
        Graph::operands(op, |a| mask |= free[a.0 as usize]);
        match op {
            Op::LoopVar(d) => mask |= 1 << d,
            Op::Reduce { depth, .. } => mask &= !(1 << depth),
            _ => {}
        }
        free[id.0 as usize] = mask;
    }
    free
}

/// Orders the nodes that the roots need, without entries of tables.
#[must_use]
pub fn schedule(graph: &Graph, roots: &[NodeId]) -> Vec<Step> {
    schedule_with(graph, roots, |_| false)
}

/// As [`schedule`], but for nodes that are available already (those must not depend on an unbound loop variable).
#[must_use]
pub fn schedule_with(graph: &Graph, roots: &[NodeId], available: impl Fn(NodeId) -> bool) -> Vec<Step> {
    let free = free_variables(graph);
    let done = graph.ids().map(|id| available(id).then_some(0)).collect();
    Scheduler { graph, free: &free, done, binders: [0; 16], entered: 0, log: vec![] }.scope(roots)
}

struct Scheduler<'a> {
    graph: &'a Graph,
    /// The loop variables that each node leaves unbound, as bits.
    free: &'a [u16],
    /// For each node that has been evaluated, the youngest loop it depends on (0: none). It counts only as long as that
    /// is still the youngest one: where a loop has bound one of its variables anew, it is evaluated anew.
    done: Vec<Option<u32>>,
    /// The loop that binds each variable now; loops are numbered from 1 as they are entered.
    binders: [u32; 16],
    entered: u32,
    /// What to restore when the current loop is left.
    log: Vec<(NodeId, Option<u32>)>,
}

impl Scheduler<'_> {
    fn youngest(&self, id: NodeId) -> u32 {
        let free = self.free[id.0 as usize];
        (0..16).filter(|d| free & (1 << d) != 0).map(|d| self.binders[d as usize]).max().unwrap_or(0)
    }

    fn is_done(&self, id: NodeId) -> bool {
        self.done[id.0 as usize] == Some(self.youngest(id))
    }

    /// Schedules the roots in ascending order of ids, which is topological.
    fn scope(&mut self, roots: &[NodeId]) -> Vec<Step> {
        let mut needed: Vec<NodeId> = vec![];
        let mut stack: Vec<NodeId> = roots.to_vec();
        let mut seen = rustc_hash::FxHashSet::default();
        while let Some(id) = stack.pop() {
            if self.is_done(id) || !seen.insert(id) {
                continue;
            }
            needed.push(id);
            match *self.graph.op(id) {
                // Of a loop, this scope evaluates only what does not vary with its variable.
                Op::Reduce { depth, body, .. } => self.invariant_of(depth, body, &mut stack),
                ref op => Graph::operands(op, |a| stack.push(a)),
            }
        }
        needed.sort_unstable();
        let mut steps = vec![];
        for id in needed {
            match *self.graph.op(id) {
                Op::Reduce { depth, body, .. } => {
                    self.entered += 1;
                    let outer = std::mem::replace(&mut self.binders[depth as usize], self.entered);
                    let log = std::mem::take(&mut self.log);
                    let inner = self.scope(&[body]);
                    for (id, before) in std::mem::replace(&mut self.log, log).into_iter().rev() {
                        self.done[id.0 as usize] = before;
                    }
                    self.binders[depth as usize] = outer;
                    steps.push(Step::Loop(id, inner));
                }
                _ => steps.push(Step::Node(id)),
            }
            self.log.push((id, self.done[id.0 as usize]));
            self.done[id.0 as usize] = Some(self.youngest(id));
        }
        steps
    }

    /// The nodes nearest to the body of a loop that depend neither on its variable nor on that of a loop within it.
    fn invariant_of(&self, depth: u8, body: NodeId, out: &mut Vec<NodeId>) {
        let mut stack = vec![(body, 1u16 << depth)];
        let mut seen = rustc_hash::FxHashSet::default();
        while let Some((id, bound)) = stack.pop() {
            if !seen.insert((id, bound)) {
                continue;
            }
            if self.free[id.0 as usize] & bound == 0 {
                out.push(id);
                continue;
            }
            let op = self.graph.op(id);
            let bound = if let Op::Reduce { depth, .. } = op { bound | 1 << depth } else { bound };
            Graph::operands(op, |a| stack.push((a, bound)));
        }
    }
}
