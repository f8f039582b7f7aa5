//! Which registers hold the components of each node, while a graph is flattened to instructions.

use crate::ir::{Graph, NodeId, Op};

/// Number of a register.
pub(crate) type Register = u32;

/// The registers of all nodes so far.
#[derive(Clone, Debug)]
pub(crate) struct Registers {
    map: Vec<Option<Vec<Register>>>,
    /// What to restore in the map when the current loop is left.
    log: Vec<(NodeId, Option<Vec<Register>>)>,
    /// The node of each loop variable.
    variables: [Option<NodeId>; 16],
    /// Registers that hold a number from the start.
    pub(crate) constants: Vec<(Register, f64)>,
    /// How many there are.
    pub(crate) count: u32,
}

/// A loop that has been entered.
#[derive(Debug)]
pub(crate) struct Scope {
    /// Holds the loop variable.
    pub(crate) variable: Register,
    log: Vec<(NodeId, Option<Vec<Register>>)>,
}

impl Registers {
    pub(crate) fn new(graph: &Graph) -> Self {
        let mut variables = [None; 16];
        for id in graph.ids() {
            if let Op::LoopVar(depth) = graph.op(id) {
                variables[*depth as usize] = Some(id);
            }
        }
        Self { map: vec![None; graph.len()], log: vec![], variables, constants: vec![], count: 0 }
    }

    /// The first of so many new ones.
    pub(crate) fn fresh(&mut self, count: u8) -> Register {
        let first = self.count;
        self.count += u32::from(count);
        first
    }

    fn constant(&mut self, value: f64) -> Register {
        let r = self.fresh(1);
        self.constants.push((r, value));
        r
    }

    pub(crate) fn get(&self, id: NodeId) -> Vec<Register> {
        self.map[id.0 as usize].clone().expect("operands are scheduled first")
    }

    pub(crate) fn three(&self, id: NodeId) -> [Register; 3] {
        let r = self.get(id);
        [r[0], r[1], r[2]]
    }

    pub(crate) fn set(&mut self, id: NodeId, registers: Vec<Register>) {
        let before = self.map[id.0 as usize].replace(registers);
        self.log.push((id, before));
    }

    /// The registers of an operation that takes no instruction: constants, and components of what is there.
    pub(crate) fn without_instruction(&mut self, op: Op) -> Option<Vec<Register>> {
        Some(match op {
            Op::Const(c) => c.values().into_iter().map(|v| self.constant(v)).collect(),
            Op::Truth(t) => vec![self.constant(f64::from(u8::from(t)))],
            Op::Splat(a, w) => vec![self.get(a)[0]; w as usize],
            Op::Extract(a, i) => vec![self.get(a)[i as usize]],
            Op::Compose(parts, w) => parts[..w as usize].iter().map(|p| self.get(*p)[0]).collect(),
            Op::Input(_)
            | Op::Param(_)
            | Op::Unary(..)
            | Op::Binary(..)
            | Op::PowI(..)
            | Op::Compare(..)
            | Op::Select { .. }
            | Op::Dot(..)
            | Op::Sample { .. }
            | Op::SampleGradient { .. }
            | Op::Lookup { .. }
            | Op::LookupSlope { .. }
            | Op::CellHash { .. }
            | Op::LoopVar(_)
            | Op::Reduce { .. } => return None,
        })
    }

    /// Enters the loop of this depth. An inner loop may shadow what an outer one computed, so registers are restored afterwards.
    pub(crate) fn enter(&mut self, depth: u8) -> Scope {
        let variable = self.fresh(1);
        let log = std::mem::take(&mut self.log);
        if let Some(node) = self.variables[depth as usize] {
            self.set(node, vec![variable]);
        }
        Scope { variable, log }
    }

    /// Leaves the loop of a node: registers of its body, and the first of those of the result.
    pub(crate) fn leave(&mut self, scope: Scope, id: NodeId, body: NodeId) -> (Vec<Register>, Register) {
        let body = self.get(body);
        for (id, before) in std::mem::replace(&mut self.log, scope.log).into_iter().rev() {
            self.map[id.0 as usize] = before;
        }
        let out = self.fresh(body.len() as u8);
        self.set(id, (out..out + body.len() as u32).collect());
        (body, out)
    }
}
