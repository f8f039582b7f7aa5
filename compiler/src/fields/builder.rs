//! Builds kernels: resources and uniforms on demand, functions statement by statement.

use super::helpers::Helper;
use crate::ir::{Graph, GridId, MeshId, NodeId, TableId, Type};
use crate::program::kernel::{
    Carries, Expr, Function, FunctionId, Kernel, Local, LocalId, Resource, ResourceKind, Stage, Stmt, Struct, Ty,
};
use crate::program::{Binding, BricksPart, FrameValue, SortBuffer, UniformLayout, UniformSource, texture_prim};
use crate::source::Span;
use rustc_hash::FxHashMap;

/// Collects what a kernel needs while its code is written: nothing is declared that nothing uses.
#[derive(Debug, Default)]
pub struct KernelBuilder {
    structs: Vec<Struct>,
    functions: Vec<Function>,
    resources: Vec<(Resource, Binding)>,
    uniforms: Vec<(String, u8, bool, UniformSource)>,
    helpers: FxHashMap<Helper, FunctionId>,
}

impl KernelBuilder {
    /// The value of a uniform, declared at first use.
    pub fn uniform(&mut self, name: &str, width: u8, integer: bool, source: UniformSource) -> Expr {
        let index = self.uniforms.iter().position(|u| u.3 == source).unwrap_or_else(|| {
            self.uniforms.push((name.to_owned(), width, integer, source));
            self.uniforms.len() - 1
        });
        Expr::Uniform(index as u32)
    }

    /// A value that the runtime knows about the drawing.
    pub fn frame(&mut self, value: FrameValue) -> Expr {
        let (name, width, integer) = match value {
            FrameValue::TileOrigin => ("tile_origin", 2, true),
            FrameValue::TileSize => ("tile_size", 2, true),
            FrameValue::ImageSize => ("image_size", 2, true),
            FrameValue::RayCount => ("ray_count", 1, true),
            FrameValue::CameraAnchor => ("camera_anchor", 3, false),
            FrameValue::CameraForward => ("camera_forward", 3, false),
            FrameValue::CameraRight => ("camera_right", 3, false),
            FrameValue::CameraUp => ("camera_up", 3, false),
            FrameValue::CameraPlane => ("camera_plane", 1, false),
            FrameValue::Accuracy => ("accuracy", 1, false),
            FrameValue::White => ("white", 1, false),
            FrameValue::Steps => ("steps", 1, true),
            FrameValue::MaxWork => ("max_work", 1, true),
            FrameValue::Paths => ("paths", 1, true),
            FrameValue::FirstPath => ("first_path", 1, true),
            FrameValue::Seed => ("seed", 1, true),
            FrameValue::Rounds => ("rounds", 1, true),
            FrameValue::CacheLow => ("cache_low", 3, false),
            FrameValue::CacheSize => ("cache_size", 3, false),
            FrameValue::PixelScale => ("pixel_scale", 1, false),
            FrameValue::Repeat => ("repeat", 1, true),
            FrameValue::SlabStart => ("slab_start", 1, false),
            FrameValue::SlabNormal => ("slab_normal", 3, false),
            FrameValue::SlabStep => ("slab_step", 1, false),
            FrameValue::SlabCount => ("slab_count", 1, true),
            FrameValue::LightCenter => ("light_center", 3, false),
            FrameValue::LightForward => ("light_forward", 3, false),
            FrameValue::LightRight => ("light_right", 3, false),
            FrameValue::LightUp => ("light_up", 3, false),
            FrameValue::LightCorner => ("light_corner", 2, false),
            FrameValue::LightNear => ("light_near", 1, false),
            FrameValue::LightNodes => ("light_nodes", 2, true),
            FrameValue::BoundsLow => ("bounds_low", 3, false),
            FrameValue::BoundsHigh => ("bounds_high", 3, false),
            FrameValue::LatticeLow => ("lattice_low", 3, false),
            FrameValue::LatticeSpacing => ("lattice_spacing", 1, false),
            FrameValue::LatticeCounts => ("lattice_counts", 3, true),
            FrameValue::Lean => ("lean", 1, false),
            FrameValue::ListEdge => ("list_edge", 1, true),
            FrameValue::Round => ("round_number", 1, true),
            FrameValue::RoundCount => ("round_count", 1, true),
            FrameValue::SortCount => ("sort_count", 1, true),
            FrameValue::SortWord => ("sort_word", 1, true),
            FrameValue::SortShift => ("sort_shift", 1, true),
            FrameValue::ScanLength => ("scan_length", 1, true),
            FrameValue::ListEntries => ("list_entries", 1, true),
            FrameValue::ListColumns => ("list_columns", 1, true),
        };
        self.uniform(name, width, integer, UniformSource::Frame(value))
    }

    /// A node of tier Frame or lower: a literal where that is possible, else a uniform.
    pub fn value(&mut self, graph: &Graph, node: NodeId, fallback_name: &str) -> Expr {
        if let Some(literal) = literal(graph, node) {
            return literal;
        }
        let name = graph.origin(node).name.as_deref().unwrap_or(fallback_name).replace('.', "_");
        let width = graph.width(node);
        let truth = graph.ty(node) == Type::Bool;
        let value = self.uniform(&name, width, truth, UniformSource::Node(node));
        if truth { Expr::binary(crate::program::kernel::BinaryOp::NotEqual, value, 0u32) } else { value }
    }

    /// The largest value that a node can have anywhere.
    pub fn majorant(&mut self, node: NodeId, name: &str) -> Expr {
        self.uniform(&format!("{name}_majorant"), 1, false, UniformSource::Majorant(node))
    }

    fn resource(&mut self, name: &str, kind: ResourceKind, binding: Binding) -> u32 {
        let index = self.resources.iter().position(|r| r.1 == binding).unwrap_or_else(|| {
            self.resources.push((Resource { name: name.to_owned(), kind }, binding));
            self.resources.len() - 1
        });
        // Number 0 is kept for the uniform block, which is declared last because it is known last.
        index as u32 + 1
    }

    /// The texture of a grid.
    pub fn grid(&mut self, graph: &Graph, grid: GridId) -> u32 {
        let info = graph.grid(grid);
        let prim = texture_prim(info.header.scalar).0;
        self.resource(&format!("{}_voxels", info.name), ResourceKind::Texture3d(prim), Binding::Grid(grid))
    }

    /// The buffer of a table.
    pub fn table(&mut self, graph: &Graph, table: TableId) -> u32 {
        let name = format!("{}_rows", graph.table(table).name);
        self.resource(&name, ResourceKind::ReadBuffer(Ty::F32), Binding::Table(table))
    }

    /// The buffer of a mesh.
    pub fn mesh(&mut self, mesh: MeshId) -> u32 {
        self.resource(&format!("mesh_{}_nodes", mesh.0), ResourceKind::ReadBuffer(Ty::U32), Binding::Mesh(mesh))
    }

    /// Columns of light that are kept.
    pub fn cache(&mut self) -> u32 {
        self.resource("columns", ResourceKind::WriteBuffer(Ty::F32), Binding::Cache)
    }

    /// Bounds of a medium.
    pub fn bounds(&mut self, number: u32, name: &str) -> u32 {
        self.resource(&format!("{name}_bricks"), ResourceKind::ReadBuffer(Ty::F32), Binding::Bounds(number))
    }

    /// Lower corner, bricks per unit of length and number of bricks of a medium's lattice.
    pub fn lattice(&mut self, number: u32, name: &str) -> [Expr; 3] {
        let parts = [(BricksPart::Low, "low"), (BricksPart::PerUnit, "per_unit"), (BricksPart::Counts, "counts")];
        parts.map(|part| self.of_bricks(number, name, part))
    }

    /// How far the support of a medium rises over spans: two times three.
    pub fn rises(&mut self, number: u32, name: &str) -> [Expr; 2] {
        let parts = [(BricksPart::RiseNear, "rise_near"), (BricksPart::RiseFar, "rise_far")];
        parts.map(|part| self.of_bricks(number, name, part))
    }

    /// Over which length the coefficients of a medium rise from nothing.
    pub fn grain(&mut self, number: u32, name: &str) -> Expr {
        self.of_bricks(number, name, (BricksPart::Grain, "grain")).component(0)
    }

    fn of_bricks(&mut self, number: u32, name: &str, (part, word): (BricksPart, &str)) -> Expr {
        self.uniform(&format!("{name}_{word}"), 3, false, UniformSource::Bricks(number, part))
    }

    /// The list of rays.
    pub fn rays(&mut self) -> u32 {
        self.resource("rays", ResourceKind::ReadBuffer(Ty::F32), Binding::Rays)
    }

    /// What tells pixels apart, to be written.
    pub fn survey(&mut self) -> u32 {
        self.resource("survey_of_pixels", ResourceKind::WriteBuffer(Ty::U32), Binding::Survey)
    }

    /// The records that come out.
    pub fn records(&mut self) -> u32 {
        self.resource("records", ResourceKind::WriteBuffer(Ty::F32), Binding::Records)
    }

    /// What passes tell those after them, to be written.
    pub fn notes(&mut self) -> u32 {
        self.resource("notes", ResourceKind::WriteBuffer(Ty::F32), Binding::Notes)
    }

    /// The same, to be read.
    pub fn notes_read(&mut self) -> u32 {
        self.resource("notes_read", ResourceKind::ReadBuffer(Ty::F32), Binding::NotesRead)
    }

    /// Outlines of slabs.
    pub fn outlines(&mut self) -> u32 {
        self.resource("outlines", ResourceKind::ReadBuffer(Ty::F32), Binding::Outlines)
    }

    /// Coefficients of splats, to be written.
    pub fn splats(&mut self) -> u32 {
        self.resource("splats", ResourceKind::WriteBuffer(Ty::F32), Binding::Splats)
    }

    /// The same, to be read.
    pub fn splats_read(&mut self) -> u32 {
        self.resource("splats_read", ResourceKind::ReadBuffer(Ty::F32), Binding::SplatsRead)
    }

    /// The order in which splats are drawn.
    pub fn order(&mut self) -> u32 {
        self.resource("order", ResourceKind::ReadBuffer(Ty::U32), Binding::Order)
    }

    /// Keys of what is to be sorted, to be written.
    pub fn keys(&mut self) -> u32 {
        self.resource("keys", ResourceKind::WriteBuffer(Ty::U32), Binding::Keys)
    }

    /// The same, to be read.
    pub fn keys_read(&mut self) -> u32 {
        self.resource("keys_read", ResourceKind::ReadBuffer(Ty::U32), Binding::KeysRead)
    }

    /// What a pass of a sort reads or writes.
    pub fn sorting(&mut self, buffer: SortBuffer) -> u32 {
        let (name, kind) = match buffer {
            SortBuffer::KeysFrom => ("keys_from", ResourceKind::ReadBuffer(Ty::U32)),
            SortBuffer::NumbersFrom => ("numbers_from", ResourceKind::ReadBuffer(Ty::U32)),
            SortBuffer::KeysTo => ("keys_to", ResourceKind::WriteBuffer(Ty::U32)),
            SortBuffer::NumbersTo => ("numbers_to", ResourceKind::WriteBuffer(Ty::U32)),
        };
        self.resource(name, kind, Binding::Sorting(buffer))
    }

    /// Tallies of workgroups.
    pub fn tallies(&mut self) -> u32 {
        self.resource("tallies", ResourceKind::WriteBuffer(Ty::U32), Binding::Tallies)
    }

    /// Numbers that a workgroup shares; the same name is the same memory.
    pub fn workgroup(&mut self, name: &str, length: u32) -> u32 {
        let same = |r: &&(Resource, Binding)| matches!(r.1, Binding::Workgroup(_)) && r.0.name == name;
        let found = self.resources.iter().find(same).map(|r| r.1);
        let all = self.resources.iter().filter(|r| matches!(r.1, Binding::Workgroup(_))).count();
        let binding = found.unwrap_or(Binding::Workgroup(all as u32));
        self.resource(name, ResourceKind::Workgroup(Ty::U32, length), binding)
    }

    /// Splats of files as the picture shows them.
    pub fn footprints(&mut self) -> u32 {
        self.resource("footprints", ResourceKind::ReadBuffer(Ty::F32), Binding::Footprints)
    }

    /// What a round leaves for the next.
    pub fn carried(&mut self) -> u32 {
        self.resource("carried", ResourceKind::WriteBuffer(Ty::F32), Binding::Carried)
    }

    /// Which of them cover a tile of the picture, or a ray.
    pub fn tile_lists(&mut self) -> u32 {
        self.resource("tile_lists", ResourceKind::ReadBuffer(Ty::U32), Binding::TileLists)
    }

    /// The same, to be written.
    pub fn tile_lists_written(&mut self) -> u32 {
        self.resource("tile_lists_written", ResourceKind::WriteBuffer(Ty::U32), Binding::TileListsWritten)
    }

    /// Which tiles splats reach.
    pub fn reaches(&mut self) -> u32 {
        self.resource("reaches", ResourceKind::ReadBuffer(Ty::U32), Binding::Reaches)
    }

    /// Where entries of splats begin, to be written.
    pub fn starts(&mut self) -> u32 {
        self.resource("starts", ResourceKind::WriteBuffer(Ty::U32), Binding::Starts)
    }

    /// The same, to be read.
    pub fn starts_read(&mut self) -> u32 {
        self.resource("starts_read", ResourceKind::ReadBuffer(Ty::U32), Binding::StartsRead)
    }

    /// Splats of entries, to be written.
    pub fn entries(&mut self) -> u32 {
        self.resource("entries", ResourceKind::WriteBuffer(Ty::U32), Binding::Entries)
    }

    /// The same, to be read.
    pub fn entries_read(&mut self) -> u32 {
        self.resource("entries_read", ResourceKind::ReadBuffer(Ty::U32), Binding::EntriesRead)
    }

    /// What was drawn into a target.
    pub fn target(&mut self, number: u32, name: &str) -> u32 {
        self.resource(name, ResourceKind::Texture2d, Binding::Target(number))
    }

    /// What light has lost before a slab.
    pub fn light_target(&mut self, number: u32, name: &str) -> u32 {
        self.resource(name, ResourceKind::Texture2d, Binding::Light(number))
    }

    /// Declares a struct.
    pub fn add_struct(&mut self, name: &str, fields: Vec<(String, Ty)>) -> Ty {
        self.structs.push(Struct { name: name.to_owned(), fields, carries: None });
        Ty::Struct(self.structs.len() as u32 - 1)
    }

    /// Declares a struct that passes through the rasteriser.
    pub fn add_carrier(&mut self, name: &str, carries: Carries, fields: Vec<(String, Ty)>) -> Ty {
        self.structs.push(Struct { name: name.to_owned(), fields, carries: Some(carries) });
        Ty::Struct(self.structs.len() as u32 - 1)
    }

    /// Adds a finished function.
    pub fn add_function(&mut self, function: Function) -> FunctionId {
        self.functions.push(function);
        FunctionId(self.functions.len() as u32 - 1)
    }

    /// What a finished function returns.
    ///
    /// # Panics
    /// If it returns nothing.
    #[must_use]
    pub fn result_of(&self, function: FunctionId) -> Ty {
        self.functions[function.0 as usize].result.expect("the function has a result")
    }

    /// A function of the fixed set, written at first use.
    pub fn helper(&mut self, graph: &Graph, helper: Helper) -> FunctionId {
        if let Some(id) = self.helpers.get(&helper) {
            return *id;
        }
        let function = helper.write(graph, self);
        let id = self.add_function(function);
        self.helpers.insert(helper, id);
        id
    }

    /// Calls a helper.
    pub fn call<const N: usize>(&mut self, graph: &Graph, helper: Helper, arguments: [Expr; N]) -> Expr {
        Expr::Call(self.helper(graph, helper), arguments.into())
    }

    /// The kernels (each a name, a stage and an entry point), what to bind to them, and the contents of their uniform block.
    #[must_use]
    pub fn finish(mut self, entries: Vec<(&str, Stage, Function)>) -> (Vec<Kernel>, Vec<Binding>, UniformLayout) {
        let layout = UniformLayout::new(self.uniforms.iter().cloned());
        let prim =
            |integer: bool| if integer { crate::program::kernel::Prim::U32 } else { crate::program::kernel::Prim::F32 };
        let frame = self.uniforms.iter().map(|u| (u.0.clone(), Ty::Value(prim(u.2), u.1))).collect();
        let Ty::Struct(block) = self.add_struct("Frame", frame) else { unreachable!("a struct was just added") };
        let mut resources = vec![Resource { name: "frame".into(), kind: ResourceKind::Uniform(block) }];
        let mut bindings = vec![Binding::Uniforms];
        for (resource, binding) in self.resources {
            resources.push(resource);
            bindings.push(binding);
        }
        let kernels = entries.into_iter().map(|(name, stage, entry)| Kernel {
            name: name.to_owned(),
            stage,
            structs: self.structs.clone(),
            resources: resources.clone(),
            functions: self.functions.clone(),
            entry,
        });
        (kernels.collect(), bindings, layout)
    }
}

/// A constant that f32 can hold, as a literal.
fn literal(graph: &Graph, node: NodeId) -> Option<Expr> {
    use crate::ir::Op;
    match *graph.op(node) {
        Op::Truth(t) => Some(Expr::Bool(t)),
        Op::Const(c) => {
            let values = c.values();
            // What overflows f32 comes through a uniform, where it may be infinite; what underflows is 0 anyway.
            if !values.iter().all(|v| (*v as f32).is_finite()) {
                return None;
            }
            if values.iter().all(|v| *v == values[0]) {
                return Some(Expr::F32(values[0]).splat(c.width()));
            }
            Some(Expr::Compose(Ty::float(c.width()), values.into_iter().map(Expr::F32).collect()))
        }
        Op::Splat(a, width) => Some(literal(graph, a)?.splat(width)),
        _ => None,
    }
}

/// A function being written.
#[derive(Debug, Default)]
pub struct Code {
    function: Function,
    blocks: Vec<Vec<Stmt>>,
}

impl Code {
    /// An empty function.
    #[must_use]
    pub fn new(name: &str, origin: Option<Span>) -> Self {
        let function = Function { name: name.to_owned(), origin, ..Function::default() };
        Self { function, blocks: vec![vec![]] }
    }

    /// Adds a parameter and gives its value.
    pub fn parameter(&mut self, name: &str, ty: Ty) -> Expr {
        self.function.parameters.push((name.to_owned(), ty));
        Expr::Argument(self.function.parameters.len() as u32 - 1)
    }

    fn local(&mut self, name: &str, ty: Ty, origin: Option<Span>) -> LocalId {
        self.function.locals.push(Local { name: name.to_owned(), ty, origin });
        LocalId(self.function.locals.len() as u32 - 1)
    }

    fn push(&mut self, statement: Stmt) {
        self.blocks.last_mut().expect("a function has a body").push(statement);
    }

    /// `let name = value`
    pub fn bind(&mut self, name: &str, ty: Ty, value: impl Into<Expr>) -> Expr {
        self.bind_from(name, ty, value, None)
    }

    /// `let name = value`, standing for a place in the scene.
    pub fn bind_from(&mut self, name: &str, ty: Ty, value: impl Into<Expr>, origin: Option<Span>) -> Expr {
        let id = self.local(name, ty, origin);
        self.push(Stmt::Let(id, value.into()));
        Expr::Local(id)
    }

    /// `var name = value`
    pub fn var(&mut self, name: &str, ty: Ty, value: impl Into<Expr>) -> LocalId {
        let id = self.local(name, ty, None);
        self.push(Stmt::Var(id, value.into()));
        id
    }

    /// `name = value`
    pub fn set(&mut self, local: LocalId, value: impl Into<Expr>) {
        self.push(Stmt::Assign(local, value.into()));
    }

    /// `name = name + value`
    pub fn add(&mut self, local: LocalId, value: impl Into<Expr>) {
        self.set(local, Expr::Local(local) + value.into());
    }

    /// `if condition { then }`
    pub fn if_(&mut self, condition: impl Into<Expr>, then: impl FnOnce(&mut Self)) {
        self.if_else(condition, then, |_| {});
    }

    /// `if condition { then } else { otherwise }`
    pub fn if_else(
        &mut self,
        condition: impl Into<Expr>,
        then: impl FnOnce(&mut Self),
        otherwise: impl FnOnce(&mut Self),
    ) {
        let then = self.block(then);
        let otherwise = self.block(otherwise);
        self.push(Stmt::If(condition.into(), then, otherwise));
    }

    /// `loop { body }`
    pub fn loop_(&mut self, body: impl FnOnce(&mut Self)) {
        let body = self.block(body);
        self.push(Stmt::Loop(body));
    }

    /// `break`
    pub fn break_(&mut self) {
        self.push(Stmt::Break);
    }

    /// `if condition { break; }`
    pub fn break_if(&mut self, condition: impl Into<Expr>) {
        self.if_(condition, Self::break_);
    }

    /// `continue`
    pub fn continue_(&mut self) {
        self.push(Stmt::Continue);
    }

    /// `return value`
    pub fn return_(&mut self, value: Expr) {
        self.push(Stmt::Return(Some(value)));
    }

    /// `return`
    pub fn return_nothing(&mut self) {
        self.push(Stmt::Return(None));
    }

    /// `buffer[index] = value`
    pub fn store(&mut self, buffer: u32, index: Expr, value: Expr) {
        self.push(Stmt::Store { buffer, index, value });
    }

    /// Waits for the workgroup.
    pub fn barrier(&mut self) {
        self.push(Stmt::Barrier);
    }

    fn block(&mut self, write: impl FnOnce(&mut Self)) -> Vec<Stmt> {
        self.blocks.push(vec![]);
        write(self);
        self.blocks.pop().expect("the block that was just pushed")
    }

    /// Opens a block that [`Code::close`] returns, where closures would not do.
    pub fn open(&mut self) {
        self.blocks.push(vec![]);
    }

    /// Closes the block opened last.
    #[must_use]
    pub fn close(&mut self) -> Vec<Stmt> {
        self.blocks.pop().expect("open and close are paired")
    }

    /// Adds a loop over a closed block. Counted loops that go round at least once break at their end: drivers that run all
    /// invocations of a group in step would otherwise go round once more, for none of them, to find that all are done.
    pub fn push_loop(&mut self, body: Vec<Stmt>) {
        self.push(Stmt::Loop(body));
    }

    /// Adds a branch over a closed block, unless nothing is in it.
    pub fn push_if(&mut self, condition: Expr, then: Vec<Stmt>) {
        if !then.is_empty() {
            self.push(Stmt::If(condition, then, vec![]));
        }
    }

    /// Adds a branch over two closed blocks.
    pub fn push_if_else(&mut self, condition: Expr, then: Vec<Stmt>, otherwise: Vec<Stmt>) {
        self.push(Stmt::If(condition, then, otherwise));
    }

    /// Adds the statements of a closed block.
    pub fn push_all(&mut self, block: Vec<Stmt>) {
        block.into_iter().for_each(|s| self.push(s));
    }

    /// The finished function.
    #[must_use]
    pub fn finish(mut self, result: Option<Ty>) -> Function {
        self.function.result = result;
        self.function.body = self.blocks.pop().expect("a function has a body");
        self.function
    }
}
