//! Programs as text: `vol emit --target ir|graph|plan` and the omission ledger.

use super::{
    Binding, Blend, Extent, Geometry, Ledger, Pass, Plan, Program, RaySource, SortBuffer, SortPass, StepRule,
    UniformSource, print_forecasts,
};
use crate::ir::{FieldScene, Graph, LightKind, NodeId, Op, print};
use crate::source::Sources;
use std::fmt::Write as _;

/// Every field of a scene with its name.
fn named_roots(scene: &FieldScene) -> Vec<(String, NodeId)> {
    let mut roots = vec![];
    for medium in &scene.media {
        for (field, node) in [("k_a", medium.k_a), ("k_s", medium.k_s), ("k_e", medium.k_e)] {
            roots.push((format!("{}.{field}", medium.name), node));
        }
        for (field, node) in [("phase", medium.phase), ("data", medium.data), ("data_color", medium.data_color)] {
            roots.extend(node.map(|n| (format!("{}.{field}", medium.name), n)));
        }
        let mut shape = medium.shape.clone();
        let mut count = 0;
        shape.map_nodes(&mut |node| {
            roots.push((format!("{}.shape.{count}", medium.name), node));
            count += 1;
            node
        });
    }
    for light in &scene.lights {
        let mut named = |part: &str, node: NodeId| roots.push((format!("{}.{part}", light.name), node));
        match light.kind {
            LightKind::Directional { direction, irradiance, angular_diameter } => {
                named("direction", direction);
                named("irradiance", irradiance);
                angular_diameter.into_iter().for_each(|n| named("angular_diameter", n));
            }
            LightKind::Point { position, intensity, radius } => {
                named("position", position);
                named("intensity", intensity);
                radius.into_iter().for_each(|n| named("radius", n));
            }
        }
    }
    for surface in &scene.surfaces {
        roots.push((format!("{}.albedo", surface.name), surface.albedo));
        let mut count = 0;
        surface.shape.clone().map_nodes(&mut |node| {
            roots.push((format!("{}.shape.{count}", surface.name), node));
            count += 1;
            node
        });
    }
    roots.push(("background".into(), scene.background));
    let camera = scene.camera;
    roots.extend(
        [("camera.from", camera.from), ("camera.to", camera.to), ("camera.up", camera.up)]
            .map(|(n, id)| (n.into(), id)),
    );
    roots
}

/// The field graph of a scene, one node a line.
#[must_use]
pub fn print_scene(scene: &FieldScene) -> String {
    let mut out = format!("// 1 unit of length = {} m; bands: {} \n", scene.units.length, scene.bands);
    out.push_str(&print(&scene.graph, &named_roots(scene)));
    out
}

/// Both graphs: as lowered, and as optimised.
#[must_use]
pub fn print_ir(program: &Program) -> String {
    format!(
        "// as lowered: what the reference engine evaluates\n{}\n// as optimised: what the backends see\n{}",
        print_scene(&program.lowered),
        print_scene(&program.optimised)
    )
}

/// The optimised field graph in Graphviz's language.
#[must_use]
pub fn print_graphviz(program: &Program) -> String {
    let scene = &program.optimised;
    let graph = &scene.graph;
    let roots = named_roots(scene);
    let ids: Vec<NodeId> = roots.iter().map(|r| r.1).collect();
    let live = graph.reachable(&ids);
    let mut out = String::from("digraph fields {\n    rankdir = BT\n    node [shape = box, fontname = monospace]\n");
    for id in graph.ids().filter(|id| live[id.0 as usize]) {
        let label = match graph.op(id) {
            Op::Const(c) => c.values().iter().map(f64::to_string).collect::<Vec<_>>().join(", "),
            op => format!("{op:?}").split(['(', ' ', '{']).next().unwrap_or("").to_lowercase(),
        };
        let name = graph.origin(id).name.as_ref().map_or(String::new(), |n| format!("\\n{n}"));
        let _ = writeln!(out, "    n{} [label = \"{label}{name}\"]", id.0);
        Graph::operands(graph.op(id), |a| {
            let _ = writeln!(out, "    n{} -> n{}", a.0, id.0);
        });
    }
    for (i, (name, id)) in roots.iter().enumerate() {
        let _ = writeln!(out, "    r{i} [label = \"{name}\", shape = oval]\n    n{} -> r{i}", id.0);
    }
    out.push_str("}\n");
    out
}

/// The plan: what is bound, filled and dispatched.
#[must_use]
pub fn print_plan(program: &Program) -> String {
    let plan: &Plan = &program.plan;
    let scene = &program.optimised;
    let mut out = format!("backend {}\n", plan.backend);
    out.push_str(&print_forecasts(&program.forecasts, plan.backend));
    let rays = match plan.rays {
        RaySource::Camera => "camera",
        RaySource::List => "list",
    };
    let _ = writeln!(out, "rays {rays}, {} per pixel", plan.samples);
    let _ = match plan.steps {
        StepRule::Closed => writeln!(out, "steps none: closed forms"),
        StepRule::Fixed(n) => writeln!(out, "steps {n}, midpoint rule with the exact exponential inside a step"),
        StepRule::Paths(None) => writeln!(out, "paths until the standard error is within the accuracy"),
        StepRule::Paths(Some(n)) => writeln!(out, "paths {n}"),
        StepRule::Slabs { count: None, .. } => {
            writeln!(out, "slabs until twice as many change nothing by more than the accuracy")
        }
        StepRule::Slabs { count: Some(n), .. } => {
            writeln!(out, "slabs {n}, midpoint rule with the exact exponential in each")
        }
        StepRule::Splats { count: None, .. } => {
            writeln!(out, "splats until a lattice of twice as many changes nothing by more than the accuracy")
        }
        StepRule::Splats { count: Some(n), .. } => writeln!(out, "splats {n}, Gaussians on a lattice"),
        StepRule::Adaptive(a) => writeln!(out, "steps by local error control to accuracy {a:e}"),
    };
    let _ = writeln!(out, "bands {}", scene.bands);
    let _ = writeln!(out, "unit of length {} m", scene.units.length);
    let _ = writeln!(out, "record of {} f32:", plan.stride);
    for output in &plan.outputs {
        let _ = writeln!(out, "    {:3} {:?} × {}", output.offset, output.kind, output.width);
    }
    let _ = writeln!(out, "bindings:");
    for (i, binding) in plan.bindings.iter().enumerate() {
        let what = match binding {
            Binding::Uniforms => format!("uniform block of {} bytes", plan.uniforms.size),
            Binding::Grid(id) => {
                let info = scene.graph.grid(*id);
                let [x, y, z] = info.header.dims;
                format!("texture of grid {}: {x} × {y} × {z} of {:?}", info.name, info.header.scalar)
            }
            Binding::Table(id) => {
                let table = scene.graph.table(*id);
                format!("buffer of table {}: {} rows of {}", table.name, table.keys.len(), table.width + 1)
            }
            Binding::Mesh(id) => {
                let info = &scene.meshes[id.0 as usize];
                format!("buffer of mesh {}: {} triangles and their boxes", info.path, info.header.triangles)
            }
            Binding::Cache => format!("cache of {} depths towards lights", plan.fill.as_ref().map_or(0, |f| f.floats)),
            Binding::Bounds(number) => {
                let bounds = &plan.bounds[*number as usize];
                let narrow = if bounds.narrow.is_empty() { "" } else { ", and of what is narrow in it" };
                format!("bounds of medium {} on a lattice{narrow}", scene.media[bounds.medium as usize].name)
            }
            Binding::Rays => "buffer of rays, 8 f32 each".into(),
            Binding::Survey => "buffer of what tells pixels apart, one u32 each".into(),
            Binding::Records => format!("buffer of records, {} f32 each", plan.stride),
            Binding::Notes => format!("buffer of notes, {} f32 each", plan.notes),
            Binding::NotesRead => "the same, only read".into(),
            Binding::Outlines => "buffer of outlines, 3 f32 a vertex".into(),
            Binding::Splats => format!("buffer of splats, {} f32 each", plan.plant.map_or(0, |p| p.stride)),
            Binding::SplatsRead => "the same, only read".into(),
            Binding::Order => "buffer of the numbers of splats in their order".into(),
            Binding::Keys => "buffer of the keys of splats, written".into(),
            Binding::KeysRead => "the same, only read".into(),
            Binding::Sorting(buffer) => match buffer {
                SortBuffer::KeysFrom => "buffer of keys that a pass of the sort reads".into(),
                SortBuffer::NumbersFrom => "buffer of numbers likewise".into(),
                SortBuffer::KeysTo => "buffer of keys that it writes".into(),
                SortBuffer::NumbersTo => "buffer of numbers likewise".into(),
            },
            Binding::Tallies => "buffer of tallies of digits".into(),
            Binding::Reaches => "buffer of the tiles that splats reach, 4 u32 each".into(),
            Binding::Starts => "buffer of where entries of splats begin".into(),
            Binding::Entries => "buffer of the splats of entries".into(),
            Binding::StartsRead | Binding::EntriesRead | Binding::TileListsWritten => {
                "the same, for other kernels".into()
            }
            Binding::Workgroup(_) => "memory of a workgroup".into(),
            Binding::Footprints => {
                format!("buffer of splats of files, {} f32 each", plan.footprints.map_or(0, |f| f.stride))
            }
            Binding::Carried => format!("buffer of what is carried from round to round, {} f32 each", plan.carried),
            Binding::TileLists => match plan.rays {
                RaySource::Camera => "buffer of lists of them for tiles of the picture".into(),
                RaySource::List => "buffer of lists of them for rays".into(),
            },
            Binding::Target(i) => format!("target {}", plan.targets[*i as usize].name),
            Binding::Light(i) => {
                let name = plan.light.as_ref().map_or("", |light| &light.targets[*i as usize].name);
                format!("target {name}, as it is before a slab")
            }
        };
        let _ = writeln!(out, "    {i} {what}");
    }
    let _ = writeln!(out, "uniforms:");
    for field in &plan.uniforms.fields {
        let prim = if field.integer { "u32" } else { "f32" };
        let source = match field.source {
            UniformSource::Node(node) => format!("node %{}", node.0),
            UniformSource::Majorant(node) => format!("majorant of node %{}", node.0),
            UniformSource::Bricks(number, part) => format!("{part:?} of the bounds {number}"),
            UniformSource::Frame(value) => format!("{value:?}"),
        };
        let _ = writeln!(out, "    {:4} {} : {prim} × {} = {source}", field.offset, field.name, field.width);
    }
    let _ = writeln!(out, "passes:");
    if let Some(fill) = &plan.fill {
        let kernel = &program.kernels[fill.kernel as usize].name;
        let _ = writeln!(out, "    {kernel} once, over {} nodes of the cache", fill.nodes);
    }
    if let Some(plant) = plan.plant {
        for kernel in [plant.kernel, plant.doubt, plant.rank] {
            let name = &program.kernels[kernel as usize].name;
            let _ = writeln!(out, "    {name} once, over the nodes of the lattice");
        }
        print_sort(&mut out, program, plant.sort, "nodes");
        let name = &program.kernels[plant.drawn as usize].name;
        let _ = writeln!(out, "    {name} once, in one invocation");
    }
    if let Some(layout) = plan.footprints {
        print_sort(&mut out, program, layout.sort, "splats");
        let passes = layout.lists;
        let names = [passes.sums, layout.sort.scan, passes.starts, passes.spread, passes.fill];
        let [sums, scan, starts, spread, fill] = names.map(|k| &program.kernels[k as usize].name);
        let _ = writeln!(out, "    {sums}, {scan} and {starts} once, over splats");
        let _ =
            writeln!(out, "    {spread} and {fill} once, over entries of lists, which are sorted by tile between them");
    }
    if let Some(survey) = plan.survey {
        let name = &program.kernels[survey as usize].name;
        let _ = writeln!(
            out,
            "    {name} once, over all pixels; then, of finer and finer lattices, over those that are not filled in:"
        );
    }
    for pass in &plan.passes {
        let name = |kernel: &u32| &program.kernels[*kernel as usize].name;
        let _ = match pass {
            Pass::Compute { kernel, extent } | Pass::Rounds { kernel, extent } => {
                let over = match extent {
                    Extent::Tile => "pixels of a tile",
                    Extent::Rays => "rays of the list",
                };
                let rounds =
                    if matches!(pass, Pass::Rounds { .. }) { ", for each part of the longest list" } else { "" };
                writeln!(out, "    {} over {over}{rounds}", name(kernel))
            }
            Pass::Raster { vertex, fragment, geometry } => {
                let what = match geometry {
                    Geometry::Outlines => "the outlines of slabs",
                    Geometry::Billboards => "a billboard for each splat",
                };
                writeln!(out, "    {} and {} draw {what}, farthest first", name(vertex), name(fragment))
            }
            Pass::Alternate { seen, light } => {
                let _ = writeln!(
                    out,
                    "    for each slab across half the angle between view and light, as light meets them:"
                );
                let order = "over what is there where light comes towards the eye, else under it";
                let drawn = writeln!(
                    out,
                    "        {} and {} draw its outline as it is seen, {order}",
                    name(&seen.vertex),
                    name(&seen.fragment)
                );
                match light {
                    Some(light) => writeln!(
                        out,
                        "        {} and {} draw it as light meets it, into the buffer of light that the next one reads",
                        name(&light.vertex),
                        name(&light.fragment)
                    ),
                    None => drawn,
                }
            }
        };
    }
    if plan.repeats > 1 {
        let _ = writeln!(out, "    {} times, with another ray through each pixel", plan.repeats);
    }
    let fading = plan.targets.iter().filter(|t| t.blend == Blend::Over).count();
    if fading > 0 {
        let how = match fading {
            1 => "one transmittance for all bands, as the alpha of one target".to_owned(),
            n => format!(
                "a transmittance for each band, as the alphas of {n} targets in one pass; no dual-source blending"
            ),
        };
        let _ = writeln!(out, "blended by {how}");
    }
    for target in plan.targets.iter().chain(plan.light.iter().flat_map(|light| &light.targets)) {
        let blend = match target.blend {
            Blend::Over => "over what is behind it",
            Blend::Add => "added",
            Blend::Max => "the larger",
        };
        let _ = writeln!(out, "target {}: {} × {}, {blend}", target.name, target.channels, target.precision.name());
    }
    out
}

fn print_sort(out: &mut String, program: &Program, sort: SortPass, what: &str) {
    let [count, scan, scatter] = [sort.count, sort.scan, sort.scatter].map(|k| &program.kernels[k as usize].name);
    let passes = sort.words * 32 / SortPass::DIGIT;
    let _ =
        writeln!(out, "    {count}, {scan} and {scatter} once for each of {passes} digits, over the keys of {what}");
}

/// The omission ledger: one line per thing left out, with the place that made it unneeded.
#[must_use]
pub fn print_ledger(ledger: &Ledger, sources: &Sources) -> String {
    let mut out = String::new();
    for omission in &ledger.0 {
        let _ = write!(out, "without {}: {}", omission.feature, omission.reason);
        if let Some(span) = omission.span {
            let (line, _) = sources.line_column(span);
            let _ = write!(out, " ({}:{line})", sources.get(span.source).name);
        }
        out.push('\n');
    }
    out
}
