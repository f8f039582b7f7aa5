//! How often the value of a node can change.

use super::{Graph, Input, NodeId, Op};

/// How often a value can change, from least to most. The order is meaningful: an operation has the largest tier of its operands.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Tier {
    /// Known when compiling.
    Constant,
    /// Depends on parameters or time: computed once per frame in f64 on the host.
    Frame,
    /// Depends on the direction too: once per ray.
    Ray,
    /// Depends on the position: at every sample.
    Sample,
}

/// The tiers of a graph that is still growing: each node's is found once, when it or a later one is first asked for.
///
/// Nodes never change, so neither do their tiers; but the entries of a table that is already looked up must not be replaced.
#[derive(Clone, Debug, Default)]
pub struct Tiers {
    known: Vec<Tier>,
}

impl Tiers {
    /// The tier of a node. The graph must be the same each time, or have grown.
    pub fn of(&mut self, graph: &Graph, node: NodeId) -> Tier {
        self.extend(graph);
        self.known[node.0 as usize]
    }

    fn extend(&mut self, graph: &Graph) {
        for id in self.known.len()..graph.len() {
            let tier = self.next(graph, graph.op(NodeId(id as u32)));
            self.known.push(tier);
        }
    }

    /// The tier of an operation over known nodes.
    fn next(&self, graph: &Graph, op: &Op) -> Tier {
        let known = |n: &NodeId| self.known[n.0 as usize];
        let mut tier = match op {
            Op::Input(Input::Position | Input::Altitude(_)) => Tier::Sample,
            Op::Input(Input::Direction | Input::CosTheta | Input::Versine | Input::Vercosine) => Tier::Ray,
            Op::Input(Input::Time) | Op::Param(_) => Tier::Frame,
            // Voxels are not in the program: a sample at a constant place is known once per frame at the earliest.
            Op::Sample { .. } | Op::SampleGradient { .. } => Tier::Frame,
            Op::Lookup { table, .. } | Op::LookupSlope { table, .. } => {
                let table = graph.table(*table);
                table.keys.iter().chain(&table.values).map(known).max().unwrap_or(Tier::Constant)
            }
            Op::Const(_)
            | Op::Truth(_)
            | Op::LoopVar(_)
            | Op::Unary(..)
            | Op::Binary(..)
            | Op::PowI(..)
            | Op::Compare(..)
            | Op::Select { .. }
            | Op::Compose(..)
            | Op::Splat(..)
            | Op::Extract(..)
            | Op::Dot(..)
            | Op::CellHash { .. }
            | Op::Reduce { .. } => Tier::Constant,
        };
        Graph::operands(op, |a| tier = tier.max(known(&a)));
        tier
    }
}

impl Graph {
    /// The tier of every node. A loop variable counts as a constant: where its loop runs decides.
    #[must_use]
    pub fn tiers(&self) -> Vec<Tier> {
        let mut tiers = Tiers::default();
        tiers.extend(self);
        tiers.known
    }
}
