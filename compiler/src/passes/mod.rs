//! Passes: graph and facts in, graph out. One file each; [`crate::ir::verify`] holds after every one.
//!
//! All rewriting happens while a graph is rebuilt bottom-up: dead nodes are not copied, equal nodes are found again by
//! hash-consing, and each operation passes through the rules before it is added.

mod algebra;
mod fold;
mod unroll;
mod vector;

use crate::ir::{FieldScene, Graph, LightKind, NodeId, Op};
use crate::program::Ledger;

/// A local rule: sees an operation whose operands are already rewritten; gives the node to use instead, or `None`.
pub type Rule = fn(&mut Graph, &Op) -> Option<NodeId>;

/// The passes in order, by name.
pub const PASSES: [(&str, Rule); 4] =
    [("fold", fold::rule), ("vector", vector::rule), ("algebra", algebra::rule), ("unroll", unroll::rule)];

/// Adds an operation through all rules, so that what backends derive is as tidy as what passes made.
pub fn push(graph: &mut Graph, op: Op) -> NodeId {
    for (_, rule) in PASSES {
        if let Some(node) = rule(graph, &op) {
            return node;
        }
    }
    graph.push(op)
}

/// Rebuilds a scene, sending every live operation through one function.
#[must_use]
pub fn rebuild(scene: &FieldScene, mut add: impl FnMut(&mut Graph, Op) -> NodeId) -> FieldScene {
    let old = &scene.graph;
    let live = old.reachable(&scene.roots());
    // Widths of tables are needed to type look-ups; entries follow once they are rewritten.
    let mut graph = old.declarations();
    let mut map: Vec<Option<NodeId>> = vec![None; old.len()];
    for id in old.ids().filter(|id| live[id.0 as usize]) {
        let op = Graph::map_operands(old.op(id), |a| map[a.0 as usize].expect("operands come first"));
        let new = add(&mut graph, op);
        let origin = old.origin(id);
        graph.annotate(new, origin.span, origin.name.as_deref());
        map[id.0 as usize] = Some(new);
    }
    for table in &mut graph.tables {
        for node in table.keys.iter_mut().chain(&mut table.values) {
            // A table that nothing reads keeps no entries alive.
            *node = map[node.0 as usize].unwrap_or(NodeId(0));
        }
    }
    let mut scene = scene.with_graph(graph);
    scene.map_roots(&mut |id| map[id.0 as usize].expect("roots are live"));
    drop_dead_tables(&mut scene, &live, old);
    scene
}

/// A table that nothing reads would keep dangling entries; it keeps its id and one harmless row.
fn drop_dead_tables(scene: &mut FieldScene, live: &[bool], old: &Graph) {
    for (i, table) in old.tables.iter().enumerate() {
        if table.keys.iter().chain(&table.values).any(|n| !live[n.0 as usize]) {
            let zero = scene.graph.scalar(0.0);
            let value = scene.graph.vector(&vec![0.0; table.width as usize]);
            let dead = &mut scene.graph.tables[i];
            dead.keys = vec![zero];
            dead.values = vec![value];
        }
    }
}

/// Spectra that are the same in all bands become scalars.
fn narrow_roots(scene: &mut FieldScene) {
    let mut graph = std::mem::take(&mut scene.graph);
    let mut narrow = |id: NodeId| vector::narrow(&mut graph, id);
    for medium in &mut scene.media {
        medium.k_a = narrow(medium.k_a);
        medium.k_s = narrow(medium.k_s);
        medium.k_e = narrow(medium.k_e);
        medium.phase = medium.phase.map(&mut narrow);
        medium.data_color = medium.data_color.map(&mut narrow);
    }
    for light in &mut scene.lights {
        let (LightKind::Directional { irradiance: strength, .. } | LightKind::Point { intensity: strength, .. }) =
            &mut light.kind;
        *strength = narrow(*strength);
    }
    for surface in &mut scene.surfaces {
        surface.albedo = narrow(surface.albedo);
    }
    scene.background = narrow(scene.background);
    scene.graph = graph;
}

/// Runs every pass until nothing changes and notes what became unneeded.
#[must_use]
pub fn optimise(lowered: &FieldScene, ledger: &mut Ledger) -> FieldScene {
    let mut scene = rebuild(lowered, push);
    narrow_roots(&mut scene);
    // One round settles almost every scene; rules can expose each other's work at most a few levels deep.
    for _ in 0..4 {
        let before = scene.graph.len();
        scene = rebuild(&scene, push);
        narrow_roots(&mut scene);
        if scene.graph.len() == before {
            break;
        }
    }
    note_params(lowered, &scene, ledger);
    scene
}

/// Notes parameters and grids that the optimised scene no longer reads.
fn note_params(lowered: &FieldScene, scene: &FieldScene, ledger: &mut Ledger) {
    let live = scene.graph.reachable(&scene.roots());
    let reads =
        |wanted: &dyn Fn(&Op) -> bool| scene.graph.ids().any(|id| live[id.0 as usize] && wanted(scene.graph.op(id)));
    for (i, param) in lowered.params.iter().enumerate() {
        if !reads(&|op| matches!(op, Op::Param(p) if p.0 as usize == i)) {
            ledger.omit(format!("parameter {}", param.name), "no field that is drawn reads it", param.span);
        }
    }
    for (i, grid) in lowered.graph.grids.iter().enumerate() {
        if !reads(&|op| matches!(op, Op::Sample { grid, .. } | Op::SampleGradient { grid, .. } if grid.0 as usize == i))
        {
            ledger.omit(format!("texture of grid {}", grid.name), "no field that is drawn samples it", grid.span);
        }
    }
}

/// Whether a node is the number 0 in every component.
#[must_use]
pub fn is_zero(graph: &Graph, id: NodeId) -> bool {
    graph.number(id) == Some(0.0)
}
