//! Checks that a graph is well formed; run after each pass in tests.

use super::{Graph, NodeId, Op, Tier, Type};

/// Checks order of operands, ranges, that loop variables are bound, and that table entries do not depend on the ray.
///
/// # Errors
/// A sentence that names the node at fault.
pub fn verify(graph: &Graph, roots: &[NodeId]) -> Result<(), String> {
    let mut free: Vec<u16> = Vec::with_capacity(graph.len());
    for id in graph.ids() {
        let op = graph.op(id);
        let mut mask = 0;
        let mut ordered = true;
        Graph::operands(op, |a| {
            if a < id {
                mask |= free[a.0 as usize];
            } else {
                ordered = false;
            }
        });
        if !ordered {
            return Err(format!("%{} uses a node that comes after it", id.0));
        }
        match *op {
            Op::LoopVar(d) => mask |= 1 << d,
            Op::Reduce { depth, start, end, .. } => {
                mask &= !(1 << depth);
                if start > end {
                    return Err(format!("%{} runs backwards", id.0));
                }
            }
            Op::Lookup { table, .. } | Op::LookupSlope { table, .. } if table.0 as usize >= graph.tables.len() => {
                return Err(format!("%{} looks up a table that does not exist", id.0));
            }
            Op::Sample { grid, .. } | Op::SampleGradient { grid, .. } if grid.0 as usize >= graph.grids.len() => {
                return Err(format!("%{} samples a grid that does not exist", id.0));
            }
            _ => {}
        }
        free.push(mask);
    }
    let tiers = graph.tiers();
    for table in &graph.tables {
        if table.keys.is_empty() || table.keys.len() != table.values.len() {
            return Err(format!(
                "table {} has {} keys and {} values",
                table.name,
                table.keys.len(),
                table.values.len()
            ));
        }
        for node in table.keys.iter().chain(&table.values) {
            if tiers[node.0 as usize] > Tier::Frame {
                return Err(format!("table {} depends on the ray through %{}", table.name, node.0));
            }
        }
        if table.keys.iter().any(|k| graph.ty(*k) != Type::SCALAR) {
            return Err(format!("table {} has a key that is no scalar", table.name));
        }
        if table.values.iter().any(|v| graph.ty(*v) != Type::Float(table.width)) {
            return Err(format!("table {} has a value of another width", table.name));
        }
    }
    for root in roots {
        if root.0 as usize >= graph.len() {
            return Err(format!("root %{} does not exist", root.0));
        }
        if free[root.0 as usize] != 0 {
            return Err(format!("root %{} has an unbound loop variable", root.0));
        }
    }
    Ok(())
}
