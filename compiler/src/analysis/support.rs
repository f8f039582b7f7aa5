//! Where a field is nothing: a continuous argument that must be positive for it to be anything.
//!
//! `smoothstep(a, b, x)` is 0 while x < a, a product where one factor is, a sum where all its terms are. Found structurally;
//! in real numbers, as everything about graphs.

use super::Push;
use super::interval::Interval;
use super::range::ranges;
use crate::ir::{Binary, Compare, Graph, NodeId, Op, Unary};
use rustc_hash::FxHashMap;

/// Most rows of a table that are looked at.
const MOST_ROWS: usize = 4096;

/// What is known of where a node is 0 in all its components.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
enum Where {
    Everywhere,
    /// Wherever this scalar is negative.
    Below(NodeId),
    /// Nothing is known.
    Unknown,
}

struct Search<'a, 'p> {
    graph: &'a mut Graph,
    push: Push<'p>,
    ranges: Vec<Interval>,
    known: FxHashMap<NodeId, Where>,
}

/// A scalar that is positive or 0 wherever one of the roots is anything but 0; `None` if no such scalar follows from how they
/// are made. Nodes are added to the graph.
pub fn support(graph: &mut Graph, push: Push<'_>, roots: &[NodeId]) -> Option<NodeId> {
    let ranges = ranges(graph);
    let mut search = Search { graph, push, ranges, known: FxHashMap::default() };
    let all = roots.iter().fold(Where::Everywhere, |all, root| {
        let own = search.of(*root);
        search.both(all, own)
    });
    match all {
        Where::Below(node) => Some(node),
        Where::Everywhere | Where::Unknown => None,
    }
}

impl Search<'_, '_> {
    fn make(&mut self, op: Op) -> NodeId {
        (self.push)(self.graph, op)
    }

    fn join(&mut self, binary: Binary, a: NodeId, b: NodeId) -> Where {
        if a == b { Where::Below(a) } else { Where::Below(self.make(Op::Binary(binary, a, b))) }
    }

    /// Where both are 0.
    fn both(&mut self, a: Where, b: Where) -> Where {
        match (a, b) {
            (Where::Everywhere, other) | (other, Where::Everywhere) => other,
            (Where::Below(a), Where::Below(b)) => self.join(Binary::Max, a, b),
            (Where::Unknown, _) | (_, Where::Unknown) => Where::Unknown,
        }
    }

    /// Where one of them is 0.
    fn either(&mut self, a: Where, b: Where) -> Where {
        match (a, b) {
            (Where::Everywhere, _) | (_, Where::Everywhere) => Where::Everywhere,
            (Where::Below(a), Where::Below(b)) => self.join(Binary::Min, a, b),
            (Where::Below(a), Where::Unknown) | (Where::Unknown, Where::Below(a)) => Where::Below(a),
            (Where::Unknown, Where::Unknown) => Where::Unknown,
        }
    }

    /// Whether a node that was there before the search is never negative.
    fn nonnegative(&self, node: NodeId) -> bool {
        self.ranges.get(node.0 as usize).is_some_and(|r| r.is_nonnegative())
    }

    fn scalar_number(&self, node: NodeId) -> Option<f64> {
        self.graph.number(node).filter(|_| self.graph.width(node) == 1)
    }

    /// a − b.
    fn less(&mut self, a: NodeId, b: NodeId) -> NodeId {
        match self.scalar_number(b) {
            Some(0.0) => a,
            _ => self.make(Op::Binary(Binary::Sub, a, b)),
        }
    }

    fn of(&mut self, node: NodeId) -> Where {
        if let Some(known) = self.known.get(&node) {
            return *known;
        }
        let found = self.find(node);
        self.known.insert(node, found);
        found
    }

    fn find(&mut self, node: NodeId) -> Where {
        if let Some(constant) = self.graph.constant(node) {
            let nothing = constant.values().iter().all(|v| *v == 0.0);
            return if nothing { Where::Everywhere } else { Where::Unknown };
        }
        match *self.graph.op(node) {
            Op::Const(_) | Op::Truth(_) | Op::Input(_) | Op::Param(_) | Op::LoopVar(_) => Where::Unknown,
            Op::Unary(unary, a) => match unary {
                Unary::Neg
                | Unary::Abs
                | Unary::Sign
                | Unary::Round
                | Unary::Sqrt
                | Unary::Expm1
                | Unary::Sin
                | Unary::Tan
                | Unary::Asin
                | Unary::Atan
                | Unary::Sinh
                | Unary::Tanh
                | Unary::Floor
                | Unary::Ceil => self.of(a),
                Unary::Exp | Unary::Log | Unary::Cos | Unary::Acos | Unary::Cosh | Unary::Not => Where::Unknown,
            },
            Op::Binary(binary, a, b) => self.binary(binary, a, b),
            Op::PowI(a, n) if n > 0 => self.of(a),
            Op::Select { condition, accept, reject } => self.select(condition, accept, reject),
            Op::Compose(parts, width) => parts[..width as usize].iter().fold(Where::Everywhere, |all, part| {
                let own = self.of(*part);
                self.both(all, own)
            }),
            Op::Splat(a, _) | Op::Extract(a, _) => self.of(a),
            Op::Dot(a, b) => {
                let (a, b) = (self.of(a), self.of(b));
                self.either(a, b)
            }
            Op::Lookup { table, at } => self.lookup(table, at),
            Op::PowI(..)
            | Op::Compare(..)
            | Op::Sample { .. }
            | Op::SampleGradient { .. }
            | Op::LookupSlope { .. }
            | Op::CellHash { .. }
            | Op::Reduce { .. } => Where::Unknown,
        }
    }

    fn binary(&mut self, binary: Binary, a: NodeId, b: NodeId) -> Where {
        let width = self.graph.width(a);
        let zero = |this: &Self, n: NodeId| this.graph.number(n) == Some(0.0);
        match binary {
            Binary::Mul => {
                let (a, b) = (self.of(a), self.of(b));
                self.either(a, b)
            }
            Binary::Div => self.of(a),
            Binary::Pow if self.graph.number(b).is_some_and(|n| n > 0.0) => self.of(a),
            Binary::Add | Binary::Sub => {
                let (a, b) = (self.of(a), self.of(b));
                self.both(a, b)
            }
            // What is cut off below 0 is 0 while its argument is negative.
            Binary::Max if width == 1 && zero(self, b) => Where::Below(a),
            Binary::Max if width == 1 && zero(self, a) => Where::Below(b),
            Binary::Max => {
                let (a, b) = (self.of(a), self.of(b));
                self.both(a, b)
            }
            Binary::Min => {
                let (free_a, free_b) = (self.nonnegative(a), self.nonnegative(b));
                let (a, b) = (self.of(a), self.of(b));
                match (free_a, free_b) {
                    (true, true) => self.either(a, b),
                    (false, true) => a,
                    (true, false) => b,
                    (false, false) => self.both(a, b),
                }
            }
            Binary::Pow | Binary::Atan2 | Binary::Mod | Binary::And | Binary::Or => Where::Unknown,
        }
    }

    fn select(&mut self, condition: NodeId, accept: NodeId, reject: NodeId) -> Where {
        let (accept, reject) = (self.of(accept), self.of(reject));
        let compared = match *self.graph.op(condition) {
            Op::Compare(Compare::Less | Compare::LessEqual, a, b) => Some((a, b)),
            _ => None,
        };
        match (accept, reject, compared) {
            // Nothing while b < a, or while a < b.
            (_, Where::Everywhere, Some((a, b))) => {
                let open = self.less(b, a);
                self.either(Where::Below(open), accept)
            }
            (Where::Everywhere, _, Some((a, b))) => {
                let open = self.less(a, b);
                self.either(Where::Below(open), reject)
            }
            (accept, reject, _) => self.both(accept, reject),
        }
    }

    /// Nothing below the last of the first rows that are 0, and above the first of the last.
    fn lookup(&mut self, table: crate::ir::TableId, at: NodeId) -> Where {
        let rows = self.graph.table(table);
        if rows.keys.len() > MOST_ROWS {
            return Where::Unknown;
        }
        let keys: Option<Vec<f64>> = rows.keys.iter().map(|k| self.graph.number(*k)).collect();
        let nothing = |v: &NodeId| self.graph.constant(*v).is_some_and(|c| c.values().iter().all(|v| *v == 0.0));
        let (first, last) = (
            rows.values.iter().take_while(|v| nothing(v)).count(),
            rows.values.iter().rev().take_while(|v| nothing(v)).count(),
        );
        let Some(keys) = keys else { return Where::Unknown };
        if first == keys.len() {
            return Where::Everywhere;
        }
        let below = (first > 0).then(|| {
            let key = self.graph.scalar(keys[first - 1]);
            Where::Below(self.less(at, key))
        });
        let above = (last > 0).then(|| {
            let key = self.graph.scalar(keys[keys.len() - last]);
            Where::Below(self.less(key, at))
        });
        match (below, above) {
            (Some(a), Some(b)) => self.either(a, b),
            (Some(one), None) | (None, Some(one)) => one,
            (None, None) => Where::Unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::eval::{Environment, LANES, NoVoxels, Tables, Tape};
    use crate::ir::{Input, Table};

    /// Supports of x-dependent fields, each compared with the field at many places.
    fn sound(make: impl Fn(&mut Graph, NodeId) -> NodeId) -> bool {
        let mut graph = Graph::default();
        let p = graph.input(Input::Position);
        let x = graph.push(Op::Extract(p, 0));
        let field = make(&mut graph, x);
        let Some(found) = support(&mut graph, &mut |g, op| g.push(op), &[field]) else { return false };
        let tape = Tape::new(&graph, &[field, found]);
        let tables = Tables::evaluate(&graph, &[], 0.0);
        let mut scratch = tape.scratch();
        let mut nothing = 0;
        for i in 0..400 {
            let mut place = [[0.0; LANES]; 3];
            place[0] = std::array::from_fn(|l| f64::from(i * LANES as u32 + l as u32) / (200.0 * LANES as f64) - 1.0);
            let environment = Environment { position: place, tables: &tables, ..Environment::default() };
            tape.run(&environment, &NoVoxels, &mut scratch);
            for c in 0..tape.width(0) {
                let (field, found) = (tape.component(&scratch, 0, c), tape.component(&scratch, 1, 0));
                for (field, found) in field.iter().zip(found) {
                    assert!(*found >= 0.0 || *field == 0.0, "{found} {field}");
                    nothing += usize::from(*found < 0.0);
                }
            }
        }
        assert!(nothing > 0, "it says something");
        true
    }

    fn ramp(graph: &mut Graph, x: NodeId, from: f64) -> NodeId {
        let (from, zero, one) = (graph.scalar(from), graph.scalar(0.0), graph.scalar(1.0));
        let above = graph.sub(x, from);
        let above = graph.binary(Binary::Max, above, zero);
        graph.binary(Binary::Min, above, one)
    }

    #[test]
    fn what_is_cut_off_is_nothing_below() {
        assert!(sound(|g, x| ramp(g, x, 0.25)));
        assert!(sound(|g, x| {
            let a = ramp(g, x, 0.25);
            g.unary(Unary::Sqrt, a)
        }));
        assert!(!sound(|_, x| x));
        assert!(!sound(|g, x| {
            let a = ramp(g, x, 0.25);
            g.unary(Unary::Exp, a)
        }));
    }

    #[test]
    fn products_are_nothing_where_a_factor_is_and_sums_where_all_terms_are() {
        assert!(sound(|g, x| {
            let down = g.unary(Unary::Neg, x);
            let (a, b) = (ramp(g, x, -0.5), ramp(g, down, -0.25));
            g.mul(a, b)
        }));
        assert!(sound(|g, x| {
            let (a, b) = (ramp(g, x, -0.5), ramp(g, x, 0.25));
            let (a, b) = (g.push(Op::Splat(a, 3)), g.push(Op::Splat(b, 3)));
            g.add(a, b)
        }));
        assert!(!sound(|g, x| {
            let a = ramp(g, x, 0.25);
            g.add(a, x)
        }));
    }

    #[test]
    fn choices_are_nothing_where_they_choose_nothing() {
        for (op, swap) in [(Compare::Less, false), (Compare::LessEqual, true)] {
            assert!(sound(|g, x| {
                let (zero, one, edge) = (g.scalar(0.0), g.scalar(1.0), g.scalar(0.3));
                let condition = g.push(Op::Compare(op, x, edge));
                let (accept, reject) = if swap { (one, zero) } else { (zero, one) };
                g.push(Op::Select { condition, accept, reject })
            }));
        }
    }

    #[test]
    fn tables_are_nothing_beyond_their_rows() {
        assert!(sound(|g, x| {
            let keys = [-0.5, -0.2, 0.1, 0.6].map(|k| g.scalar(k)).to_vec();
            let values = [0.0, 0.0, 1.0, 0.0].map(|k| g.scalar(k)).to_vec();
            let table = g.add_table(Table { name: "t".into(), span: None, keys, values, width: 1 });
            g.push(Op::Lookup { table, at: x })
        }));
    }
}
