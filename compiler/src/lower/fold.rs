//! Which nodes are known now: what structure (loop bounds, exponents, orientation) is read from.

use crate::ir::{Constant, Graph, NodeId, Op, eval};

/// Values of constant nodes, computed once each, in f64 and in order of their ids.
#[derive(Debug, Default)]
pub(super) struct Folder {
    values: Vec<Option<Constant>>,
}

impl Folder {
    /// The value of a node that depends on nothing; truth values are 0 or 1. Loops and tables are not followed.
    pub(super) fn get(&mut self, graph: &Graph, id: NodeId) -> Option<Constant> {
        while self.values.len() <= id.0 as usize {
            let value = self.compute(graph, NodeId(self.values.len() as u32));
            self.values.push(value);
        }
        self.values[id.0 as usize]
    }

    fn of(&self, id: NodeId) -> Option<Constant> {
        self.values[id.0 as usize]
    }

    fn compute(&self, graph: &Graph, id: NodeId) -> Option<Constant> {
        let map = |a: NodeId, f: &dyn Fn(f64) -> f64| {
            let values: Vec<f64> = self.of(a)?.values().into_iter().map(f).collect();
            Some(Constant::new(&values))
        };
        let truth = |t: bool| Some(Constant::new(&[f64::from(u8::from(t))]));
        match *graph.op(id) {
            Op::Const(c) => Some(c),
            Op::Truth(t) => truth(t),
            Op::Input(_)
            | Op::Param(_)
            | Op::LoopVar(_)
            | Op::Sample { .. }
            | Op::SampleGradient { .. }
            | Op::Lookup { .. }
            | Op::LookupSlope { .. }
            | Op::CellHash { .. }
            | Op::Reduce { .. } => None,
            Op::Unary(u, a) => map(a, &|v| eval::unary(u, v)),
            Op::PowI(a, n) => map(a, &|v| v.powi(n)),
            Op::Binary(b, x, y) => {
                let (x, y) = (self.of(x)?.values(), self.of(y)?.values());
                let values: Vec<f64> = x.into_iter().zip(y).map(|(x, y)| eval::binary(b, x, y)).collect();
                Some(Constant::new(&values))
            }
            Op::Compare(c, x, y) => truth(eval::compare(c, self.of(x)?.get(0), self.of(y)?.get(0))),
            Op::Select { condition, accept, reject } => {
                self.of(if self.of(condition)?.get(0) != 0.0 { accept } else { reject })
            }
            Op::Compose(parts, width) => {
                let values: Option<Vec<f64>> =
                    parts[..width as usize].iter().map(|p| self.of(*p).map(|c| c.get(0))).collect();
                Some(Constant::new(&values?))
            }
            Op::Splat(a, width) => Some(Constant::new(&vec![self.of(a)?.get(0); width as usize])),
            Op::Extract(a, i) => Some(Constant::new(&[self.of(a)?.get(i as usize)])),
            Op::Dot(a, b) => {
                let (a, b) = (self.of(a)?.values(), self.of(b)?.values());
                Some(Constant::new(&[a.into_iter().zip(b).map(|(a, b)| a * b).sum()]))
            }
        }
    }
}
