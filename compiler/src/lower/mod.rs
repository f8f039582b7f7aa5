//! From the checked scene to the field graph: functions inlined, units scaled, spectra given their bands.
//!
//! The graph is built as the scene is written. Nothing is simplified but what the language reads as a constant
//! (a vector of numbers, a grey colour), so that the reference engine evaluates what the user wrote. Equal expressions
//! are one node all the same, because the graph is hash-consed.
//!
//! What lowering decides, and where:
//! - `expr`, `builtin`: expressions. Calls are inlined, loops keep their loop; their bounds must be known here.
//! - `spectrum`: how `rgb(…)` and colours become one value per band.
//! - `space`: transforms, and the position and direction that a medium's fields see.
//! - `shape`: regions, their bounding boxes as nodes (`center`, `size` …) and as numbers (framing, scale).
//! - `scene`: media, background, camera, projections.
//! - `light`: lights and surfaces; `splats`.
//! - `phase`: phase functions and their normalisation; `mie`: those of spheres.
//! - `pending`: what is checked but not drawn yet.
//!
//! Work is bounded: nodes, visits, nesting and loop iterations are counted, and a scene beyond the limits is an error.

mod builtin;
mod expr;
mod fold;
mod light;
mod mie;
mod pending;
mod phase;
mod scene;
mod shape;
mod space;
mod spectrum;
mod splats;

pub use pending::pending;

use crate::check::hir;
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{Bands, FieldScene, Graph, NodeId, Shape, Tier, Units};
use crate::source::Span;
use fold::Folder;
use rustc_hash::FxHashMap;
use space::{Space, Transform};
use std::ops::Range;

/// Nodes a graph may have, literal rows of tables apart.
const MAX_NODES: usize = 1 << 20;
/// Expressions that may be visited, inlined ones each time.
const MAX_VISITS: usize = 1 << 22;
/// Expressions within each other, through calls too.
const MAX_DEPTH: usize = 256;
/// Loops within each other.
const MAX_LOOPS: usize = 12;
/// Iterations of one loop.
const MAX_TRIPS: i64 = 4096;
/// Iterations of the innermost of nested loops, all in all.
const MAX_NESTED_TRIPS: i64 = 1 << 20;
/// Iterations of all loops of a scene.
const MAX_ALL_TRIPS: i64 = 1 << 24;

/// Lowers a scene of at most [`Bands::TOGETHER`] bands, with lengths measured in `units`. `None` if something was reported
/// as an error.
#[must_use]
pub fn lower(scene: &hir::Scene, units: Units, diagnostics: &mut Diagnostics) -> Option<FieldScene> {
    lower_group(scene, units, 0..scene.image.wavelengths.len(), diagnostics)
}

/// Lowers a scene for some of its bands.
#[must_use]
pub fn lower_group(
    scene: &hir::Scene,
    units: Units,
    group: Range<usize>,
    diagnostics: &mut Diagnostics,
) -> Option<FieldScene> {
    Lowerer::new(scene, units, group, diagnostics).scene()
}

/// The power of two of metres nearest the size of the scene: half the largest extent of its bounded media; without
/// any, the distance from the camera to what it looks at; without that, a metre. Judged at the params' defaults.
#[must_use]
pub fn choose_units(scene: &hir::Scene) -> Units {
    // Errors found here are found again, and reported, by the lowering that follows.
    let mut ignored = Diagnostics::default();
    let first = scene.image.all_bands().groups().first().cloned().unwrap_or_default();
    let size = Lowerer::new(scene, Units::METRE, first, &mut ignored).size();
    match size {
        Some(size) if size.is_finite() && size > 0.0 => {
            Units { length: 2f64.powi(size.log2().round().clamp(-100.0, 100.0) as i32) }
        }
        _ => Units::METRE,
    }
}

/// Lowers a scene in the units that suit it.
#[must_use]
pub fn lower_scaled(scene: &hir::Scene, diagnostics: &mut Diagnostics) -> Option<FieldScene> {
    let units = choose_units(scene);
    lower(scene, units, diagnostics)
}

/// Marks that an error has been reported already.
#[derive(Copy, Clone, Debug)]
struct Reported;

type Lowered<T> = Result<T, Reported>;

/// What an expression becomes.
#[derive(Clone, Debug)]
enum Value {
    /// Numbers, vectors, spectra, colours, truth values.
    Node(NodeId),
    /// A colour (width 3) and an extinction.
    Layer { color: NodeId, k: NodeId },
    /// Voxels.
    Grid(hir::GridId),
    /// A region, in the space it is written in.
    Shape(Shape),
    /// A map of space.
    Transform(Box<Transform>),
    /// Text, which no field uses.
    Text,
}

/// The names that an expression sees.
#[derive(Debug, Default)]
struct Frame<'s> {
    locals: FxHashMap<hir::LocalId, Value>,
    /// What each `let` of this frame is.
    definitions: FxHashMap<hir::LocalId, &'s hir::Expr>,
    /// The arguments of the call; empty outside functions.
    arguments: &'s [hir::Expr],
}

/// A function, the space and loop depth it is called in, and its arguments.
type CallKey = (hir::FunctionId, u32, usize, Vec<u32>);

struct Lowerer<'s, 'd> {
    scene: &'s hir::Scene,
    units: Units,
    /// Those of the group that is lowered.
    bands: Bands,
    /// What red, green and blue each have in them.
    shares: Vec<[f64; 3]>,
    /// Whether some colour that is not grey met a spectrum.
    colored: bool,
    graph: Graph,
    diagnostics: &'d mut Diagnostics,
    /// Whether an error was reported since the start.
    failed: bool,
    folder: Folder,
    constants: FxHashMap<hir::ConstId, Value>,
    tables: FxHashMap<hir::TableId, Option<crate::ir::TableId>>,
    calls: FxHashMap<CallKey, Value>,
    gradients: FxHashMap<(u32, NodeId, NodeId), NodeId>,
    mie_tables: FxHashMap<mie::MieKey, crate::ir::TableId>,
    frames: Vec<Frame<'s>>,
    space: Space,
    /// Counts the spaces, so that what is remembered of one is not taken for another's.
    space_number: u32,
    /// Iterations of the loops around the current expression.
    loops: Vec<i64>,
    all_trips: i64,
    shells: Vec<(NodeId, NodeId)>,
    /// Nodes that may not vary more than this, where they are written, and what they are.
    limits: Vec<(NodeId, Span, &'static str, Tier)>,
    /// Nodes that must not be 0 at the params' defaults, where they are written, and what is wrong if they are.
    nonzero: Vec<(NodeId, Span, &'static str)>,
    /// Only shapes and the camera are of interest: fields of `sdf`s are left out.
    geometry_only: bool,
    depth: usize,
    visits: usize,
    /// Nodes made by literal rows of tables, which do not count.
    free_nodes: usize,
    /// A limit was passed and reported; nothing more is lowered.
    exhausted: bool,
    /// Nodes below this id have their spans.
    spanned: usize,
}

impl<'s, 'd> Lowerer<'s, 'd> {
    fn new(scene: &'s hir::Scene, units: Units, group: Range<usize>, diagnostics: &'d mut Diagnostics) -> Self {
        let bands = scene.image.all_bands();
        let mut graph = Graph::default();
        graph.params = scene.params.iter().map(|p| p.ty.node_type()).collect();
        let space = Space::world(&mut graph);
        Self {
            scene,
            units,
            shares: bands.resample()[group.clone()].to_vec(),
            bands: bands.part(group),
            colored: false,
            graph,
            diagnostics,
            failed: false,
            folder: Folder::default(),
            constants: FxHashMap::default(),
            tables: FxHashMap::default(),
            calls: FxHashMap::default(),
            gradients: FxHashMap::default(),
            mie_tables: FxHashMap::default(),
            frames: vec![Frame::default()],
            space,
            space_number: 0,
            loops: vec![],
            all_trips: 0,
            shells: vec![],
            limits: vec![],
            nonzero: vec![],
            geometry_only: false,
            depth: 0,
            visits: 0,
            free_nodes: 0,
            exhausted: false,
            spanned: 0,
        }
    }

    /// Reports an error.
    fn report<T>(&mut self, diagnostic: Diagnostic) -> Lowered<T> {
        self.failed = true;
        self.diagnostics.push(diagnostic);
        Err(Reported)
    }

    /// Something that checking promised does not hold.
    fn broken_promise<T>(&mut self, span: Span, what: &str) -> Lowered<T> {
        self.report(
            Diagnostic::error("E0500", format!("the compiler contradicts itself: {what}"))
                .at(span, "while lowering this")
                .note("this is a fault of the compiler, not of the scene")
                .hint("report it together with the scene"),
        )
    }

    /// Counts one expression more.
    fn visit(&mut self, span: Span) -> Lowered<()> {
        if self.exhausted {
            return Err(Reported);
        }
        self.visits += 1;
        if self.visits > MAX_VISITS || self.graph.len() > MAX_NODES + self.free_nodes {
            self.exhausted = true;
            return self.report(
                Diagnostic::error("E0505", "the scene is too large once its functions are written out")
                    .at(span, "the limit was reached here")
                    .note(format!("a scene may have {MAX_NODES} different operations"))
                    .hint("repeat with `sum(i in 0..n)` instead of functions that call others many times"),
            );
        }
        if self.depth > MAX_DEPTH {
            self.exhausted = true;
            return self.report(
                Diagnostic::error("E0505", "this expression is nested too deeply")
                    .at(span, "too many expressions around this one, counting the functions it is called from")
                    .note(format!("at most {MAX_DEPTH} expressions may stand within each other"))
                    .hint("name parts of it with `let`"),
            );
        }
        Ok(())
    }

    /// The value of a node that is known now.
    fn constant(&mut self, id: NodeId) -> Option<crate::ir::Constant> {
        self.folder.get(&self.graph, id)
    }

    /// The number a node is now, if it is known and all its components are equal.
    fn number(&mut self, id: NodeId) -> Option<f64> {
        let c = self.constant(id)?;
        (0..c.width() as usize).all(|i| c.get(i) == c.get(0)).then(|| c.get(0))
    }

    /// A constant in place of a node that is known now; used where geometry is put together, not in fields.
    fn folded(&mut self, id: NodeId) -> NodeId {
        match self.constant(id) {
            Some(c) => self.graph.vector(&c.values()),
            None => id,
        }
    }

    /// A vector; a constant if its parts are.
    fn vector(&mut self, parts: &[NodeId]) -> NodeId {
        let constants: Option<Vec<f64>> = parts.iter().map(|p| self.graph.constant(*p).map(|c| c.get(0))).collect();
        match constants {
            Some(values) => self.graph.vector(&values),
            None => self.graph.compose(parts),
        }
    }

    /// Notes that a node must be the same over the whole picture; checked when all is lowered.
    fn per_frame(&mut self, id: NodeId, span: Span, what: &'static str) {
        if self.graph.constant(id).is_none() {
            self.limits.push((id, span, what, Tier::Frame));
        }
    }

    /// What a value of this dimension is multiplied by to be in the graph's units.
    fn scale(&self, dim: hir::Dim) -> f64 {
        if dim.length == 0 { 1.0 } else { self.units.scale(f64::from(dim.length) / 12.0) }
    }

    /// The params' defaults in the graph's units.
    fn defaults(&self) -> Vec<Vec<f64>> {
        let scaled = |p: &crate::ir::Param| {
            let factor = self.units.scale(p.dimension[0]);
            p.default.iter().map(|v| v * factor).collect()
        };
        self.scene.params.iter().map(scaled).collect()
    }

    /// Gives spans to the nodes that were made since the last call.
    fn span_new(&mut self, span: Span) {
        while self.spanned < self.graph.len() {
            self.graph.annotate(NodeId(self.spanned as u32), Some(span), None);
            self.spanned += 1;
        }
    }

    /// Names a node after something in the scene, unless it is one that many things share.
    fn name(&mut self, id: NodeId, name: &str) {
        use crate::ir::Op;
        match self.graph.op(id) {
            Op::Const(_) | Op::Truth(_) | Op::Input(_) | Op::Param(_) | Op::LoopVar(_) => {}
            _ => self.graph.annotate(id, None, Some(name)),
        }
    }
}
