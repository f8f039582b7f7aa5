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
    let done = graph.ids().map(available).collect();
    let mut scope = Scope { graph, free: &free, done, steps: vec![] };
    scope.run(roots);
    scope.steps
}

struct Scope<'a> {
    graph: &'a Graph,
    free: &'a [u16],
    done: Vec<bool>,
    steps: Vec<Step>,
}

impl Scope<'_> {
    /// Schedules the roots in ascending order of ids, which is topological.
    fn run(&mut self, roots: &[NodeId]) {
        let mut needed: Vec<NodeId> = vec![];
        let mut stack: Vec<NodeId> = roots.to_vec();
        let mut seen = rustc_hash::FxHashSet::default();
        while let Some(id) = stack.pop() {
            if self.done[id.0 as usize] || !seen.insert(id) {
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
        for id in needed {
            self.done[id.0 as usize] = true;
            match *self.graph.op(id) {
                Op::Reduce { depth, body, .. } => {
                    // Inside, everything that varies with the variable is computed anew.
                    let done = self
                        .graph
                        .ids()
                        .map(|n| self.done[n.0 as usize] && self.free[n.0 as usize] & (1 << depth) == 0);
                    let mut inner = Scope { graph: self.graph, free: self.free, done: done.collect(), steps: vec![] };
                    inner.run(&[body]);
                    self.steps.push(Step::Loop(id, inner.steps));
                }
                _ => self.steps.push(Step::Node(id)),
            }
        }
    }

    fn invariant_of(&self, depth: u8, body: NodeId, out: &mut Vec<NodeId>) {
        let mut stack = vec![body];
        let mut seen = rustc_hash::FxHashSet::default();
        while let Some(id) = stack.pop() {
            if !seen.insert(id) {
                continue;
            }
            if self.free[id.0 as usize] & (1 << depth) == 0 {
                out.push(id);
            } else {
                Graph::operands(self.graph.op(id), |a| stack.push(a));
            }
        }
    }
}
