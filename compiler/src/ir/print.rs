//! The textual form of a graph: one line per node, for people and for snapshots.

use super::{Graph, NodeId, Op, Type};
use std::fmt::Write as _;

/// Prints the nodes that the named roots need, in order, then the roots.
#[must_use]
pub fn print(graph: &Graph, roots: &[(String, NodeId)]) -> String {
    let ids: Vec<NodeId> = roots.iter().map(|r| r.1).collect();
    let live = graph.reachable(&ids);
    let mut out = String::new();
    for (i, table) in graph.tables.iter().enumerate() {
        let used = table.keys.iter().chain(&table.values).all(|n| live[n.0 as usize]);
        if used {
            let _ = write!(out, "table {} #{i} {{", table.name);
            for (k, v) in table.keys.iter().zip(&table.values) {
                let _ = write!(out, " %{}: %{}", k.0, v.0);
            }
            out.push_str(" }\n");
        }
    }
    for id in graph.ids().filter(|id| live[id.0 as usize]) {
        let _ = write!(out, "%{} : {} = {}", id.0, type_name(graph.ty(id)), operation(graph, graph.op(id)));
        if let Some(name) = &graph.origin(id).name {
            let _ = write!(out, "  // {name}");
        }
        out.push('\n');
    }
    for (name, id) in roots {
        let _ = writeln!(out, "{name} = %{}", id.0);
    }
    out
}

fn type_name(ty: Type) -> String {
    match ty {
        Type::Bool => "bool".into(),
        Type::Float(1) => "f".into(),
        Type::Float(w) => format!("f{w}"),
    }
}

fn operation(graph: &Graph, op: &Op) -> String {
    let mut operands = String::new();
    Graph::operands(op, |a| {
        let _ = write!(operands, " %{}", a.0);
    });
    let word = match op {
        Op::Const(c) => {
            let parts: Vec<String> = c.values().iter().map(|v| format!("{v:?}")).collect();
            return parts.join(", ");
        }
        Op::Truth(t) => return t.to_string(),
        Op::Input(i) => return format!("input {i:?}"),
        Op::Param(p) => return format!("param {}", p.0),
        Op::LoopVar(d) => return format!("loop_var {d}"),
        Op::Unary(u, _) => format!("{u:?}").to_lowercase(),
        Op::Binary(b, ..) => format!("{b:?}").to_lowercase(),
        Op::PowI(_, n) => format!("powi[{n}]"),
        Op::Compare(c, ..) => format!("{c:?}").to_lowercase(),
        Op::Select { .. } => "select".into(),
        Op::Compose(..) => "compose".into(),
        Op::Splat(..) => "splat".into(),
        Op::Extract(_, i) => format!("extract[{i}]"),
        Op::Dot(..) => "dot".into(),
        Op::Sample { grid, .. } => format!("sample[{}]", graph.grid(*grid).name),
        Op::SampleGradient { grid, .. } => format!("sample_gradient[{}]", graph.grid(*grid).name),
        Op::Lookup { table, .. } => format!("lookup[{}]", graph.table(*table).name),
        Op::LookupSlope { table, .. } => format!("lookup_slope[{}]", graph.table(*table).name),
        Op::CellHash { .. } => "cell_hash".into(),
        Op::Reduce { fold, depth, start, end, .. } => {
            format!("{}[{depth}: {start}..{end}]", format!("{fold:?}").to_lowercase())
        }
    };
    word + &operands
}
