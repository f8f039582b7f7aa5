//! The graph and its builder: hash-consing, typing, no simplification.

use super::{Binary, Compare, Constant, Filter, Fold, GridId, Input, Op, ParamId, Type, Unary};
use crate::loader::GridHeader;
use crate::source::Span;
use rustc_hash::FxHashMap;

/// Identifies a node; operands always have smaller ids.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub u32);

/// Identifies a table of the graph.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TableId(pub u32);

/// Where a node comes from: for names in the generated code and for the source map.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    /// The expression that made it first.
    pub span: Option<Span>,
    /// The scene's name for it: a `let`, a `const`, a property.
    pub name: Option<String>,
}

/// A piecewise-linear table or transfer function. Entries are nodes of tier [`Tier::Frame`](super::Tier::Frame) or lower.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The scene's name.
    pub name: String,
    /// Where it is declared.
    pub span: Option<Span>,
    /// Ascending; equal neighbours make a jump. At least one.
    pub keys: Vec<NodeId>,
    /// One per key, all of width `width`.
    pub values: Vec<NodeId>,
    /// Components of a value.
    pub width: u8,
}

/// A declared grid.
#[derive(Clone, Debug, PartialEq)]
pub struct GridInfo {
    /// The scene's name.
    pub name: String,
    /// Where it is declared.
    pub span: Option<Span>,
    /// The path as written, and the name of the source that wrote it.
    pub path: String,
    /// Name of the source that wrote the path.
    pub from: String,
    /// What the file says about itself.
    pub header: GridHeader,
    /// Interpolation.
    pub filter: Filter,
    /// The value beyond the outer faces.
    pub outside: f64,
}

/// A list of hash-consed nodes with their types and origins.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    ops: Vec<Op>,
    types: Vec<Type>,
    origins: Vec<Origin>,
    index: FxHashMap<Op, NodeId>,
    /// The tables that [`Op::Lookup`] names.
    pub tables: Vec<Table>,
    /// The grids that [`Op::Sample`] names.
    pub grids: Vec<GridInfo>,
    /// Types of the parameters that [`Op::Param`] names.
    pub params: Vec<Type>,
}

impl Graph {
    /// An empty graph with the same tables, grids and parameters.
    #[must_use]
    pub fn declarations(&self) -> Self {
        Self { tables: self.tables.clone(), grids: self.grids.clone(), params: self.params.clone(), ..Self::default() }
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ops.len()
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ops.is_empty()
    }

    /// The operation of a node.
    #[must_use]
    pub fn op(&self, id: NodeId) -> &Op {
        &self.ops[id.0 as usize]
    }

    /// The type of a node.
    #[must_use]
    pub fn ty(&self, id: NodeId) -> Type {
        self.types[id.0 as usize]
    }

    /// Components of a node.
    #[must_use]
    pub fn width(&self, id: NodeId) -> u8 {
        self.ty(id).width()
    }

    /// Where a node comes from.
    #[must_use]
    pub fn origin(&self, id: NodeId) -> &Origin {
        &self.origins[id.0 as usize]
    }

    /// All nodes in order.
    pub fn ids(&self) -> impl DoubleEndedIterator<Item = NodeId> + use<> {
        (0..self.ops.len() as u32).map(NodeId)
    }

    /// Gives a node a span or a name if it has none yet (the first one stays: it is the declaration).
    pub fn annotate(&mut self, id: NodeId, span: Option<Span>, name: Option<&str>) {
        let origin = &mut self.origins[id.0 as usize];
        if origin.span.is_none() {
            origin.span = span;
        }
        if origin.name.is_none() {
            origin.name = name.map(str::to_owned);
        }
    }

    /// The constant a node is, if it is one.
    #[must_use]
    pub fn constant(&self, id: NodeId) -> Option<Constant> {
        if let Op::Const(c) = self.op(id) { Some(*c) } else { None }
    }

    /// The single number a node is, if it is a constant with equal components.
    #[must_use]
    pub fn number(&self, id: NodeId) -> Option<f64> {
        match *self.op(id) {
            Op::Const(c) => (0..c.width() as usize).all(|i| c.get(i) == c.get(0)).then(|| c.get(0)),
            Op::Splat(a, _) => self.number(a),
            _ => None,
        }
    }

    /// Adds an operation, or finds the equal one.
    ///
    /// # Panics
    /// When operand types do not fit: graphs are built from checked scenes.
    pub fn push(&mut self, op: Op) -> NodeId {
        if let Some(id) = self.index.get(&op) {
            return *id;
        }
        let ty = self.type_of(&op);
        let id = NodeId(self.ops.len() as u32);
        self.ops.push(op);
        self.types.push(ty);
        self.origins.push(Origin::default());
        self.index.insert(op, id);
        id
    }

    fn type_of(&self, op: &Op) -> Type {
        match *op {
            Op::Const(c) => Type::Float(c.width()),
            Op::Truth(_) => Type::Bool,
            Op::Input(i) => i.ty(),
            Op::Param(p) => self.params[p.0 as usize],
            Op::LoopVar(_) => Type::SCALAR,
            Op::Unary(u, a) => {
                assert_eq!(self.ty(a) == Type::Bool, u == Unary::Not, "operand of {u:?}");
                self.ty(a)
            }
            Op::Binary(b, x, y) => {
                assert_eq!(self.ty(x), self.ty(y), "operands of {b:?}");
                assert_eq!(self.ty(x) == Type::Bool, matches!(b, Binary::And | Binary::Or), "operands of {b:?}");
                self.ty(x)
            }
            Op::PowI(a, _) => self.ty(a),
            Op::Compare(c, x, y) => {
                assert_eq!((self.ty(x), self.ty(y)), (Type::SCALAR, Type::SCALAR), "operands of {c:?}");
                Type::Bool
            }
            Op::Select { condition, accept, reject } => {
                assert_eq!(self.ty(condition), Type::Bool, "condition of a select");
                assert_eq!(self.ty(accept), self.ty(reject), "branches of a select");
                self.ty(accept)
            }
            Op::Compose(parts, width) => {
                assert!((2..=4).contains(&width), "width of a vector");
                assert!(parts.iter().all(|p| self.ty(*p) == Type::SCALAR), "parts of a vector");
                Type::Float(width)
            }
            Op::Splat(a, width) => {
                assert_eq!(self.ty(a), Type::SCALAR, "operand of a splat");
                Type::Float(width)
            }
            Op::Extract(a, i) => {
                assert!(i < self.width(a), "component {i} of {:?}", self.ty(a));
                Type::SCALAR
            }
            Op::Dot(a, b) => {
                assert_eq!(self.ty(a), self.ty(b), "operands of dot");
                Type::SCALAR
            }
            Op::Sample { grid, at } => {
                assert!((grid.0 as usize) < self.grids.len() && self.ty(at) == Type::VEC3, "sample of a grid");
                Type::SCALAR
            }
            Op::SampleGradient { at, .. } => {
                assert_eq!(self.ty(at), Type::VEC3, "gradient of a grid");
                Type::VEC3
            }
            Op::Lookup { table, at } | Op::LookupSlope { table, at } => {
                assert_eq!(self.ty(at), Type::SCALAR, "key of a table");
                Type::Float(self.tables[table.0 as usize].width)
            }
            Op::CellHash { cell, seed } => {
                assert_eq!((self.ty(cell), self.ty(seed)), (Type::VEC3, Type::SCALAR), "operands of cell_hash");
                Type::VEC3
            }
            Op::Reduce { body, .. } => self.ty(body),
        }
    }

    /// Adds a table.
    pub fn add_table(&mut self, table: Table) -> TableId {
        self.tables.push(table);
        TableId(self.tables.len() as u32 - 1)
    }

    /// The table with this id.
    #[must_use]
    pub fn table(&self, id: TableId) -> &Table {
        &self.tables[id.0 as usize]
    }

    /// The grid with this id.
    #[must_use]
    pub fn grid(&self, id: GridId) -> &GridInfo {
        &self.grids[id.0 as usize]
    }

    /// One number.
    pub fn scalar(&mut self, value: f64) -> NodeId {
        self.push(Op::Const(Constant::new(&[value])))
    }

    /// A constant vector of 1 to 4 components.
    pub fn vector(&mut self, values: &[f64]) -> NodeId {
        self.push(Op::Const(Constant::new(values)))
    }

    /// A truth value.
    pub fn truth(&mut self, value: bool) -> NodeId {
        self.push(Op::Truth(value))
    }

    /// An input.
    pub fn input(&mut self, input: Input) -> NodeId {
        self.push(Op::Input(input))
    }

    /// A parameter.
    pub fn param(&mut self, param: ParamId) -> NodeId {
        self.push(Op::Param(param))
    }

    /// A componentwise operation.
    pub fn unary(&mut self, op: Unary, a: NodeId) -> NodeId {
        self.push(Op::Unary(op, a))
    }

    /// A componentwise operation; a scalar operand is widened to the other's width.
    pub fn binary(&mut self, op: Binary, a: NodeId, b: NodeId) -> NodeId {
        let width = self.width(a).max(self.width(b));
        let (a, b) = (self.widen(a, width), self.widen(b, width));
        self.push(Op::Binary(op, a, b))
    }

    /// `a + b`
    pub fn add(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Add, a, b)
    }

    /// `a − b`
    pub fn sub(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Sub, a, b)
    }

    /// `a · b`
    pub fn mul(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Mul, a, b)
    }

    /// `a / b`
    pub fn div(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Div, a, b)
    }

    /// Integer power.
    pub fn powi(&mut self, a: NodeId, n: i32) -> NodeId {
        self.push(Op::PowI(a, n))
    }

    /// A comparison of two scalars.
    pub fn compare(&mut self, op: Compare, a: NodeId, b: NodeId) -> NodeId {
        self.push(Op::Compare(op, a, b))
    }

    /// A choice; a scalar branch is widened to the other's width.
    pub fn select(&mut self, condition: NodeId, accept: NodeId, reject: NodeId) -> NodeId {
        let width = self.width(accept).max(self.width(reject));
        let (accept, reject) = (self.widen(accept, width), self.widen(reject, width));
        self.push(Op::Select { condition, accept, reject })
    }

    /// A vector of 2 to 4 scalars; a single scalar is returned as it is.
    pub fn compose(&mut self, parts: &[NodeId]) -> NodeId {
        if let [only] = parts {
            return *only;
        }
        let last = *parts.last().expect("a vector has parts");
        let mut four = [last; 4];
        four[..parts.len()].copy_from_slice(parts);
        self.push(Op::Compose(four, parts.len() as u8))
    }

    /// The scalar `a` in `width` components; a value of that width is returned as it is.
    pub fn widen(&mut self, a: NodeId, width: u8) -> NodeId {
        if self.width(a) == width { a } else { self.push(Op::Splat(a, width)) }
    }

    /// Component `i`; a scalar is its own component 0.
    pub fn extract(&mut self, a: NodeId, i: u8) -> NodeId {
        if self.width(a) == 1 { a } else { self.push(Op::Extract(a, i)) }
    }

    /// Scalar product.
    pub fn dot(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.push(Op::Dot(a, b))
    }

    /// A bounded loop.
    pub fn reduce(&mut self, fold: Fold, depth: u8, range: std::ops::Range<i32>, body: NodeId) -> NodeId {
        self.push(Op::Reduce { fold, depth, start: range.start, end: range.end, body })
    }

    /// Calls `visit` for each operand of an operation. Entries of tables are not operands; see [`Graph::reachable`].
    pub fn operands(op: &Op, mut visit: impl FnMut(NodeId)) {
        match *op {
            Op::Const(_) | Op::Truth(_) | Op::Input(_) | Op::Param(_) | Op::LoopVar(_) => {}
            Op::Unary(_, a)
            | Op::PowI(a, _)
            | Op::Splat(a, _)
            | Op::Extract(a, _)
            | Op::Sample { at: a, .. }
            | Op::SampleGradient { at: a, .. }
            | Op::Lookup { at: a, .. }
            | Op::LookupSlope { at: a, .. }
            | Op::Reduce { body: a, .. } => visit(a),
            Op::Binary(_, a, b) | Op::Compare(_, a, b) | Op::Dot(a, b) | Op::CellHash { cell: a, seed: b } => {
                visit(a);
                visit(b);
            }
            Op::Select { condition, accept, reject } => {
                visit(condition);
                visit(accept);
                visit(reject);
            }
            Op::Compose(parts, width) => parts[..width as usize].iter().for_each(|p| visit(*p)),
        }
    }

    /// The same operation over other operands.
    pub fn map_operands(op: &Op, mut map: impl FnMut(NodeId) -> NodeId) -> Op {
        match *op {
            Op::Const(_) | Op::Truth(_) | Op::Input(_) | Op::Param(_) | Op::LoopVar(_) => *op,
            Op::Unary(u, a) => Op::Unary(u, map(a)),
            Op::PowI(a, n) => Op::PowI(map(a), n),
            Op::Splat(a, w) => Op::Splat(map(a), w),
            Op::Extract(a, i) => Op::Extract(map(a), i),
            Op::Sample { grid, at } => Op::Sample { grid, at: map(at) },
            Op::SampleGradient { grid, at } => Op::SampleGradient { grid, at: map(at) },
            Op::Lookup { table, at } => Op::Lookup { table, at: map(at) },
            Op::LookupSlope { table, at } => Op::LookupSlope { table, at: map(at) },
            Op::Reduce { fold, depth, start, end, body } => Op::Reduce { fold, depth, start, end, body: map(body) },
            Op::Binary(b, x, y) => Op::Binary(b, map(x), map(y)),
            Op::Compare(c, x, y) => Op::Compare(c, map(x), map(y)),
            Op::Dot(a, b) => Op::Dot(map(a), map(b)),
            Op::CellHash { cell, seed } => Op::CellHash { cell: map(cell), seed: map(seed) },
            Op::Select { condition, accept, reject } => {
                Op::Select { condition: map(condition), accept: map(accept), reject: map(reject) }
            }
            Op::Compose(mut parts, width) => {
                let used = width as usize;
                parts[..used].iter_mut().for_each(|p| *p = map(*p));
                let last = parts[used - 1];
                parts[used..].fill(last);
                Op::Compose(parts, width)
            }
        }
    }

    /// Whether the roots need a node with such an operation, in entries of the tables they look up too.
    #[must_use]
    pub fn reads(&self, roots: &[NodeId], wanted: impl Fn(&Op) -> bool) -> bool {
        let live = self.reachable(roots);
        self.ids().any(|id| live[id.0 as usize] && wanted(self.op(id)))
    }

    /// Marks every node that the roots need, entries of the tables they look up included.
    #[must_use]
    pub fn reachable(&self, roots: &[NodeId]) -> Vec<bool> {
        let mut seen = vec![false; self.len()];
        let mut stack = roots.to_vec();
        while let Some(id) = stack.pop() {
            if std::mem::replace(&mut seen[id.0 as usize], true) {
                continue;
            }
            let op = self.op(id);
            Self::operands(op, |a| stack.push(a));
            if let Op::Lookup { table, .. } | Op::LookupSlope { table, .. } = op {
                let table = self.table(*table);
                stack.extend(table.keys.iter().chain(&table.values));
            }
        }
        seen
    }
}
