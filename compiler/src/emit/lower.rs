//! Kernels to naga: one function at a time, one statement at a time.

use super::EmitError;
use super::builder::{Body, Types, constant, kind, scalar};
use super::names::Names;
use super::source_map::Origin;
use crate::program::breaks;
use crate::program::kernel::{
    BinaryOp, Expr, Function, FunctionId, Kernel, LocalId, Math, Prim, ResourceKind, Stage, Stmt, Ty, UnaryOp,
};
use crate::source::Span;
use naga::{
    AddressSpace, BinaryOperator, BuiltIn, Expression, Handle, Literal, MathFunction, Module, ResourceBinding,
    Statement, UnaryOperator, VectorSize,
};

/// What naga's writers call `_e7`, and what it should be called instead: they give the result of a call no name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CallName {
    /// Name of the function it stands in.
    pub(super) function: String,
    /// The number of the expression there.
    pub(super) number: usize,
    /// Its name.
    pub(super) name: String,
}

/// A module being built from a kernel.
pub(super) struct Lowering<'a> {
    kernel: &'a Kernel,
    module: Module,
    names: Names,
    types: Types,
    /// By number of the resource; `None` where this kernel does not use it.
    globals: Vec<Option<Handle<naga::GlobalVariable>>>,
    /// By number of the function; `None` where this kernel does not reach it.
    functions: Vec<Option<Handle<naga::Function>>>,
    function_names: Vec<String>,
    field_names: Vec<Vec<String>>,
    origins: Vec<Origin>,
    calls: Vec<CallName>,
}

/// What lowering makes.
pub(super) struct Lowered {
    pub(super) module: Module,
    pub(super) origins: Vec<Origin>,
    pub(super) calls: Vec<CallName>,
    pub(super) entry: String,
}

/// Builds the module of a verified kernel.
pub(super) fn lower(kernel: &Kernel) -> Result<Lowered, EmitError> {
    let mut names = Names::default();
    let mut module = Module::default();
    // The names of structs, the entry point, functions and resources come first: they are the ones that people look for.
    let struct_names: Vec<(String, Vec<String>)> = kernel
        .structs
        .iter()
        .map(|s| {
            let mut fields = Names::default();
            (names.unique(&s.name), s.fields.iter().map(|(name, _)| fields.unique(name)).collect())
        })
        .collect();
    let entry = names.unique(&kernel.name);
    let reached = crate::program::reached(kernel);
    let named = kernel.functions.iter().zip(&reached);
    let function_names = named.map(|(f, used)| if *used { names.unique(&f.name) } else { String::new() }).collect();
    let field_names = struct_names.iter().map(|s| s.1.clone()).collect();
    let types = Types::new(kernel, &mut module, struct_names);
    let (globals, functions, origins, calls) = (vec![], vec![], vec![], vec![]);
    let mut lowering =
        Lowering { kernel, module, names, types, globals, functions, function_names, field_names, origins, calls };
    lowering.resources();
    for (index, f) in kernel.functions.iter().enumerate() {
        if !reached[index] {
            lowering.functions.push(None);
            continue;
        }
        let name = lowering.function_names[index].clone();
        let function = lowering.function(f, name, false)?;
        let handle = lowering.module.functions.append(function, naga::Span::UNDEFINED);
        lowering.functions.push(Some(handle));
    }
    let function = lowering.function(&kernel.entry, entry.clone(), true)?;
    let Lowering { mut module, origins, calls, .. } = lowering;
    module.entry_points.push(naga::EntryPoint {
        name: entry.clone(),
        stage: match kernel.stage {
            Stage::Compute(_) => naga::ShaderStage::Compute,
            Stage::Vertex => naga::ShaderStage::Vertex,
            Stage::Fragment => naga::ShaderStage::Fragment,
        },
        early_depth_test: None,
        workgroup_size: match kernel.stage {
            Stage::Compute(size) => size,
            Stage::Vertex | Stage::Fragment => [0; 3],
        },
        workgroup_size_overrides: None,
        function,
        mesh_info: None,
        task_payload: None,
        incoming_ray_payload: None,
    });
    Ok(Lowered { module, origins, calls, entry })
}

impl Lowering<'_> {
    fn resources(&mut self) {
        let used = crate::program::used_resources(self.kernel);
        for (binding, r) in self.kernel.resources.iter().enumerate() {
            if !used[binding] {
                self.globals.push(None);
                continue;
            }
            let storage = |access| AddressSpace::Storage { access };
            let (space, ty) = match r.kind {
                ResourceKind::Uniform(s) => (AddressSpace::Uniform, self.types.get(&mut self.module, Ty::Struct(s))),
                ResourceKind::ReadBuffer(ty) => {
                    (storage(naga::StorageAccess::LOAD), self.types.array(&mut self.module, ty, None))
                }
                ResourceKind::WriteBuffer(ty) => {
                    let access = naga::StorageAccess::LOAD | naga::StorageAccess::STORE;
                    (storage(access), self.types.array(&mut self.module, ty, None))
                }
                ResourceKind::Texture3d(prim) => {
                    let dim = naga::ImageDimension::D3;
                    (AddressSpace::Handle, self.types.texture(&mut self.module, prim, dim))
                }
                ResourceKind::Texture2d => {
                    let dim = naga::ImageDimension::D2;
                    (AddressSpace::Handle, self.types.texture(&mut self.module, Prim::F32, dim))
                }
                ResourceKind::Workgroup(ty, length) => {
                    (AddressSpace::WorkGroup, self.types.array(&mut self.module, ty, Some(length)))
                }
            };
            let global = naga::GlobalVariable {
                name: Some(self.names.unique(&r.name)),
                space,
                binding: match r.kind {
                    ResourceKind::Workgroup(..) => None,
                    ResourceKind::Uniform(_)
                    | ResourceKind::ReadBuffer(_)
                    | ResourceKind::WriteBuffer(_)
                    | ResourceKind::Texture3d(_)
                    | ResourceKind::Texture2d => Some(ResourceBinding { group: 0, binding: binding as u32 }),
                },
                ty,
                init: None,
                memory_decorations: naga::MemoryDecorations::empty(),
            };
            self.globals.push(Some(self.module.global_variables.append(global, naga::Span::UNDEFINED)));
        }
    }

    fn function(&mut self, f: &Function, name: String, entry: bool) -> Result<naga::Function, EmitError> {
        if let Some(span) = f.origin {
            self.origins.push(Origin { name: name.clone(), span });
        }
        let mut arguments = vec![];
        for (wanted, ty) in &f.parameters {
            let ty = self.types.get(&mut self.module, *ty);
            arguments.push(naga::FunctionArgument { name: Some(self.names.unique(wanted)), ty, binding: None });
        }
        let indices = if entry { indices(&f.body) } else { vec![] };
        for builtin in &indices {
            let (name, width) = match builtin {
                BuiltIn::GlobalInvocationId => ("global_id", 3),
                BuiltIn::WorkGroupId => ("group_id", 3),
                BuiltIn::LocalInvocationIndex => ("local_index", 1),
                BuiltIn::VertexIndex => ("vertex_index", 1),
                _ => ("instance_index", 1),
            };
            let ty = self.types.get(&mut self.module, Ty::Value(Prim::U32, width));
            let binding = Some(naga::Binding::BuiltIn(*builtin));
            arguments.push(naga::FunctionArgument { name: Some(self.names.unique(name)), ty, binding });
        }
        let result =
            f.result.map(|ty| naga::FunctionResult { ty: self.types.get(&mut self.module, ty), binding: None });
        let count = arguments.len() as u32;
        let local_names: Vec<String> = f.locals.iter().map(|l| self.names.unique(&l.name)).collect();
        for (local, name) in f.locals.iter().zip(&local_names) {
            if let Some(span) = local.origin {
                self.origins.push(Origin { name: name.clone(), span });
            }
        }
        let mut body = Body::new(name.clone(), arguments, result);
        let arguments = (0..count).map(|i| body.add(Expression::FunctionArgument(i), &[])).collect();
        let mut lowering = FunctionLowering {
            global_handles: vec![None; self.globals.len()],
            loads: Loads {
                variables: vec![None; f.locals.len()],
                uniforms: vec![None; self.uniform().map_or(0, |(_, fields)| fields)],
            },
            slots: vec![Slot::Undeclared; f.locals.len()],
            of: self,
            f,
            name,
            local_names,
            body,
            arguments,
            indices,
            span: f.origin,
        };
        lowering.block(&f.body)?;
        // A loop that only returns never reaches the end, but naga's own front end asks for a return there.
        if let (Some(Stmt::Loop(body)), Some(ty)) = (f.body.last(), f.result)
            && !breaks(body)
        {
            let ty = lowering.of.types.get(&mut lowering.of.module, ty);
            let value = Some(lowering.body.add(Expression::ZeroValue(ty), &[]));
            lowering.body.push(Statement::Return { value });
        }
        Ok(lowering.body.finish())
    }

    /// The uniform struct's resource and number of fields.
    fn uniform(&self) -> Option<(usize, usize)> {
        self.kernel.resources.iter().enumerate().find_map(|(i, r)| match r.kind {
            ResourceKind::Uniform(s) => Some((i, self.kernel.structs[s as usize].fields.len())),
            ResourceKind::ReadBuffer(_) | ResourceKind::WriteBuffer(_) | ResourceKind::Workgroup(..) => None,
            ResourceKind::Texture3d(_) | ResourceKind::Texture2d => None,
        })
    }
}

/// What a local stands for.
#[derive(Copy, Clone)]
enum Slot {
    /// Not yet anything.
    Undeclared,
    /// The value of a `let`.
    Value(Handle<Expression>),
    /// The pointer to a `var`.
    Variable(Handle<Expression>),
}

/// Values of memory that are still good at this point: a variable is read once between two assignments, a uniform once
/// per block, so that the text is not full of copies.
#[derive(Clone)]
struct Loads {
    variables: Vec<Option<Handle<Expression>>>,
    uniforms: Vec<Option<Handle<Expression>>>,
}

struct FunctionLowering<'a, 'k> {
    of: &'a mut Lowering<'k>,
    f: &'a Function,
    name: String,
    local_names: Vec<String>,
    body: Body,
    arguments: Vec<Handle<Expression>>,
    indices: Vec<BuiltIn>,
    global_handles: Vec<Option<Handle<Expression>>>,
    slots: Vec<Slot>,
    loads: Loads,
    /// The nearest place in the scene, for errors.
    span: Option<Span>,
}

impl FunctionLowering<'_, '_> {
    fn block(&mut self, block: &[Stmt]) -> Result<(), EmitError> {
        block.iter().try_for_each(|s| self.stmt(s))
    }

    /// A block of its own: what it loads is not known outside, and what it assigns is stale there.
    fn nested(&mut self, block: &[Stmt]) -> Result<naga::Block, EmitError> {
        let loads = self.loads.clone();
        self.body.enter();
        self.block(block)?;
        self.loads = loads;
        self.forget_assigned(block);
        Ok(self.body.leave())
    }

    fn forget_assigned(&mut self, block: &[Stmt]) {
        for s in block {
            match s {
                Stmt::Assign(id, _) => self.loads.variables[id.0 as usize] = None,
                Stmt::If(_, accept, reject) => {
                    self.forget_assigned(accept);
                    self.forget_assigned(reject);
                }
                Stmt::Loop(body) => self.forget_assigned(body),
                Stmt::Let(..) | Stmt::Var(..) | Stmt::Store { .. } => {}
                Stmt::Break | Stmt::Continue | Stmt::Return(_) | Stmt::Barrier => {}
            }
        }
    }

    fn stmt(&mut self, stmt: &Stmt) -> Result<(), EmitError> {
        self.body.begin();
        match stmt {
            Stmt::Let(id, value) => {
                let local = &self.f.locals[id.0 as usize];
                let (outer, name) = (self.span, self.local_names[id.0 as usize].clone());
                self.span = local.origin.or(outer);
                self.slots[id.0 as usize] = Slot::Value(self.bind(value, name)?);
                self.span = outer;
            }
            Stmt::Var(id, value) => {
                let local = &self.f.locals[id.0 as usize];
                let outer = self.span;
                self.span = local.origin.or(outer);
                let value = self.expr(value)?;
                let ty = self.of.types.get(&mut self.of.module, local.ty);
                let pointer = self.body.variable(self.local_names[id.0 as usize].clone(), ty);
                self.slots[id.0 as usize] = Slot::Variable(pointer);
                self.body.push(Statement::Store { pointer, value });
                self.loads.variables[id.0 as usize] = None;
                self.span = outer;
            }
            Stmt::Assign(id, value) => {
                let value = self.expr(value)?;
                if let Slot::Variable(pointer) = self.slots[id.0 as usize] {
                    self.body.push(Statement::Store { pointer, value });
                }
                self.loads.variables[id.0 as usize] = None;
            }
            Stmt::If(condition, accept, reject) => {
                let condition = self.expr(condition)?;
                self.name_shared();
                let before = self.loads.clone();
                let accept_block = self.nested(accept)?;
                // The other branch starts from what was known before the first.
                let after = std::mem::replace(&mut self.loads, before);
                let reject_block = self.nested(reject)?;
                self.loads = after;
                self.forget_assigned(reject);
                self.body.push(Statement::If { condition, accept: accept_block, reject: reject_block });
            }
            Stmt::Loop(body) => {
                // The second turn sees what the first assigned.
                self.forget_assigned(body);
                let body = self.nested(body)?;
                self.body.push(Statement::Loop { body, continuing: naga::Block::new(), break_if: None });
            }
            Stmt::Break => self.body.push(Statement::Break),
            Stmt::Continue => self.body.push(Statement::Continue),
            Stmt::Return(value) => {
                let value = value.as_ref().map(|v| self.expr(v)).transpose()?;
                self.body.push(Statement::Return { value });
            }
            Stmt::Store { buffer, index, value } => {
                let index = self.expr(index)?;
                let value = self.expr(value)?;
                let base = self.global(*buffer);
                let pointer = self.body.add(Expression::Access { base, index }, &[base, index]);
                self.body.push(Statement::Store { pointer, value });
            }
            Stmt::Barrier => self.body.push(Statement::ControlBarrier(naga::Barrier::WORK_GROUP)),
        }
        self.name_shared();
        Ok(())
    }

    /// Names what the statement uses more than once: naga's writers would call it `_e7`.
    fn name_shared(&mut self) {
        for value in self.body.shared() {
            let name = self.of.names.unique("part");
            self.body.name(value, name);
        }
    }

    /// The value of a `let`, bound to its name.
    fn bind(&mut self, e: &Expr, name: String) -> Result<Handle<Expression>, EmitError> {
        match e {
            // A literal needs no line in the function; as a constant it keeps its name and line.
            Expr::F32(_) | Expr::I32(_) | Expr::U32(_) | Expr::Bool(_) => {
                let literal = self.literal(e)?;
                let constant = constant(&mut self.of.module, name, literal);
                Ok(self.body.add(Expression::Constant(constant), &[]))
            }
            Expr::Call(id, arguments) => self.call(*id, arguments, Some(name)),
            // A `let` of its own even if the value was read before.
            Expr::Local(id) => match self.slots[id.0 as usize] {
                Slot::Variable(pointer) => Ok(self.load(pointer, name)),
                Slot::Value(_) | Slot::Undeclared => self.expr(e),
            },
            Expr::Uniform(i) => match self.uniform_pointer(*i) {
                Some(pointer) => Ok(self.load(pointer, name)),
                None => self.expr(e),
            },
            Expr::TextureLoad(texture, at) => {
                let handle = self.texture_load(*texture, at)?;
                self.body.name(handle, name);
                Ok(handle)
            }
            Expr::Load(buffer, index) => {
                let pointer = self.element(*buffer, index)?;
                Ok(self.load(pointer, name))
            }
            Expr::Argument(_) | Expr::GlobalId | Expr::GroupId | Expr::LocalIndex => self.expr(e),
            Expr::VertexIndex | Expr::InstanceIndex => self.expr(e),
            Expr::Unary(..) | Expr::Binary(..) | Expr::Math(..) | Expr::Compose(..) | Expr::Splat(..) => {
                self.bind_value(e, name)
            }
            Expr::Component(..) | Expr::Field(..) | Expr::Select(..) | Expr::Convert(..) | Expr::Bitcast(..) => {
                self.bind_value(e, name)
            }
        }
    }

    fn bind_value(&mut self, e: &Expr, name: String) -> Result<Handle<Expression>, EmitError> {
        let handle = self.build(e)?;
        if self.body.can_name(handle) {
            self.body.name(handle, name);
        }
        Ok(handle)
    }

    /// An index of the invocation: these arguments come after the parameters.
    fn index(&self, builtin: BuiltIn) -> Handle<Expression> {
        let place = self.indices.iter().position(|b| *b == builtin).expect("found when the arguments were declared");
        self.arguments[self.f.parameters.len() + place]
    }

    /// The value of an expression; a long one gets a name of its own.
    fn expr(&mut self, e: &Expr) -> Result<Handle<Expression>, EmitError> {
        let mark = self.body.mark();
        let handle = self.build(e)?;
        self.body.made(mark, handle);
        if self.body.is_long(handle) && self.body.can_name(handle) {
            let name = self.of.names.unique("part");
            self.body.name(handle, name);
        }
        Ok(handle)
    }

    fn exprs(&mut self, es: &[Expr]) -> Result<Vec<Handle<Expression>>, EmitError> {
        es.iter().map(|e| self.expr(e)).collect()
    }

    fn build(&mut self, e: &Expr) -> Result<Handle<Expression>, EmitError> {
        Ok(match e {
            Expr::F32(_) | Expr::I32(_) | Expr::U32(_) | Expr::Bool(_) => {
                let literal = self.literal(e)?;
                self.body.literal(literal)
            }
            Expr::Local(id) => self.local(*id)?,
            Expr::Argument(i) => self.arguments[*i as usize],
            Expr::GlobalId => self.index(BuiltIn::GlobalInvocationId),
            Expr::GroupId => self.index(BuiltIn::WorkGroupId),
            Expr::LocalIndex => self.index(BuiltIn::LocalInvocationIndex),
            Expr::VertexIndex => self.index(BuiltIn::VertexIndex),
            Expr::InstanceIndex => self.index(BuiltIn::InstanceIndex),
            Expr::Uniform(i) => self.uniform(*i)?,
            Expr::Unary(op, a) => {
                let op = match op {
                    UnaryOp::Neg => UnaryOperator::Negate,
                    UnaryOp::Not => UnaryOperator::LogicalNot,
                };
                let expr = self.expr(a)?;
                self.body.add(Expression::Unary { op, expr }, &[expr])
            }
            Expr::Binary(op, a, b) => {
                let (left, right) = (self.expr(a)?, self.expr(b)?);
                self.body.add(Expression::Binary { op: binary(*op), left, right }, &[left, right])
            }
            Expr::Math(f, arguments) => {
                let a = self.exprs(arguments)?;
                let (arg, arg1, arg2) = (a[0], a.get(1).copied(), a.get(2).copied());
                self.body.add(Expression::Math { fun: math(*f), arg, arg1, arg2, arg3: None }, &a)
            }
            Expr::Compose(ty, parts) => {
                let components = self.exprs(parts)?;
                let ty = self.of.types.get(&mut self.of.module, *ty);
                let parts = components.clone();
                self.body.add(Expression::Compose { ty, components }, &parts)
            }
            Expr::Splat(a, width) => {
                let value = self.expr(a)?;
                let size = match width {
                    2 => VectorSize::Bi,
                    3 => VectorSize::Tri,
                    _ => VectorSize::Quad,
                };
                self.body.add(Expression::Splat { size, value }, &[value])
            }
            Expr::Component(a, i) => {
                let base = self.expr(a)?;
                self.body.add(Expression::AccessIndex { base, index: u32::from(*i) }, &[base])
            }
            Expr::Field(a, i) => {
                let base = self.expr(a)?;
                self.body.add(Expression::AccessIndex { base, index: *i }, &[base])
            }
            Expr::Select(condition, accept, reject) => {
                let (condition, accept, reject) = (self.expr(condition)?, self.expr(accept)?, self.expr(reject)?);
                self.body.add(Expression::Select { condition, accept, reject }, &[condition, accept, reject])
            }
            Expr::Convert(prim, a) => {
                let expr = self.expr(a)?;
                let convert = Some(scalar(*prim).width);
                self.body.add(Expression::As { expr, kind: kind(*prim), convert }, &[expr])
            }
            Expr::Bitcast(prim, a) => {
                let expr = self.bits(*prim, a)?;
                self.body.add(Expression::As { expr, kind: kind(*prim), convert: None }, &[expr])
            }
            Expr::Call(id, arguments) => self.call(*id, arguments, None)?,
            Expr::TextureLoad(texture, at) => {
                let handle = self.texture_load(*texture, at)?;
                let name = self.of.names.unique("texel");
                self.body.name(handle, name);
                handle
            }
            Expr::Load(buffer, index) => {
                let pointer = self.element(*buffer, index)?;
                let name = self.of.names.unique("item");
                self.load(pointer, name)
            }
        })
    }

    fn literal(&self, e: &Expr) -> Result<Literal, EmitError> {
        Ok(match e {
            Expr::I32(x) => Literal::I32(*x),
            Expr::U32(x) => Literal::U32(*x),
            Expr::Bool(x) => Literal::Bool(*x),
            Expr::F32(x) if (*x as f32).is_finite() => Literal::F32(*x as f32),
            Expr::F32(x) => return Err(EmitError::Number { value: *x, span: self.span }),
            other => return Err(EmitError::Kernel(format!("function `{}`: {other:?} is no literal", self.f.name))),
        })
    }

    /// The operand of a bitcast. WGSL works out what it can when it compiles and refuses an infinity or NaN found so;
    /// the bits of one therefore pass through a variable.
    fn bits(&mut self, to: Prim, a: &Expr) -> Result<Handle<Expression>, EmitError> {
        let bits = match (to, a) {
            (Prim::F32, Expr::U32(bits)) => Some(*bits),
            (Prim::F32, Expr::I32(bits)) => Some(bits.cast_unsigned()),
            _ => None,
        };
        let value = self.expr(a)?;
        if bits.is_none_or(|bits| f32::from_bits(bits).is_finite()) {
            return Ok(value);
        }
        let ty = Ty::Value(if matches!(a, Expr::U32(_)) { Prim::U32 } else { Prim::I32 }, 1);
        let ty = self.of.types.get(&mut self.of.module, ty);
        let pointer = self.body.variable(self.of.names.unique("not_finite"), ty);
        self.body.push(Statement::Store { pointer, value });
        let name = self.of.names.unique("bits");
        Ok(self.load(pointer, name))
    }

    fn local(&mut self, id: LocalId) -> Result<Handle<Expression>, EmitError> {
        let index = id.0 as usize;
        match (self.slots[index], self.loads.variables[index]) {
            (Slot::Value(handle), _) | (Slot::Variable(_), Some(handle)) => Ok(handle),
            (Slot::Variable(pointer), None) => {
                let name = self.of.names.unique(&self.f.locals[index].name);
                let handle = self.load(pointer, name);
                self.loads.variables[index] = Some(handle);
                Ok(handle)
            }
            (Slot::Undeclared, _) => {
                let name = &self.f.locals[index].name;
                Err(EmitError::Kernel(format!("function `{}`: `{name}` is read before it is declared", self.f.name)))
            }
        }
    }

    fn uniform(&mut self, field: u32) -> Result<Handle<Expression>, EmitError> {
        if let Some(Some(handle)) = self.loads.uniforms.get(field as usize) {
            return Ok(*handle);
        }
        let Some(pointer) = self.uniform_pointer(field) else {
            return Err(EmitError::Kernel(format!("function `{}`: there is no uniform struct", self.f.name)));
        };
        let name = self.uniform_name(field);
        let handle = self.load(pointer, name);
        self.loads.uniforms[field as usize] = Some(handle);
        Ok(handle)
    }

    fn uniform_name(&mut self, field: u32) -> String {
        let wanted = self.of.kernel.resources.iter().find_map(|r| match r.kind {
            ResourceKind::Uniform(s) => Some(self.of.field_names[s as usize][field as usize].as_str()),
            ResourceKind::ReadBuffer(_) | ResourceKind::WriteBuffer(_) | ResourceKind::Workgroup(..) => None,
            ResourceKind::Texture3d(_) | ResourceKind::Texture2d => None,
        });
        self.of.names.unique(wanted.unwrap_or("uniform_value"))
    }

    fn uniform_pointer(&mut self, field: u32) -> Option<Handle<Expression>> {
        let (resource, _) = self.of.uniform()?;
        let base = self.global(resource as u32);
        Some(self.body.add(Expression::AccessIndex { base, index: field }, &[base]))
    }

    fn element(&mut self, buffer: u32, index: &Expr) -> Result<Handle<Expression>, EmitError> {
        let index = self.expr(index)?;
        let base = self.global(buffer);
        Ok(self.body.add(Expression::Access { base, index }, &[base, index]))
    }

    fn load(&mut self, pointer: Handle<Expression>, name: String) -> Handle<Expression> {
        let handle = self.body.add(Expression::Load { pointer }, &[pointer]);
        self.body.name(handle, name);
        handle
    }

    fn texture_load(&mut self, texture: u32, at: &Expr) -> Result<Handle<Expression>, EmitError> {
        let coordinate = self.expr(at)?;
        let level = self.body.literal(Literal::I32(0));
        let image = self.global(texture);
        let load = Expression::ImageLoad { image, coordinate, array_index: None, sample: None, level: Some(level) };
        Ok(self.body.add(load, &[image, coordinate, level]))
    }

    fn global(&mut self, resource: u32) -> Handle<Expression> {
        let index = resource as usize;
        if let Some(handle) = self.global_handles[index] {
            return handle;
        }
        let global = self.of.globals[index].expect("a resource that is named was found in use");
        let handle = self.body.add(Expression::GlobalVariable(global), &[]);
        self.global_handles[index] = Some(handle);
        handle
    }

    /// A call; without a name, one that the statement has made already will do.
    fn call(
        &mut self,
        id: FunctionId,
        arguments: &[Expr],
        name: Option<String>,
    ) -> Result<Handle<Expression>, EmitError> {
        let arguments = self.exprs(arguments)?;
        let function = self.of.functions[id.0 as usize].expect("a function that is called is reached");
        if let Some(known) = self.body.known_call(function, &arguments).filter(|_| name.is_none()) {
            return Ok(known);
        }
        let name = name.unwrap_or_else(|| self.of.names.unique(&self.of.kernel.functions[id.0 as usize].name));
        let result = self.body.add(Expression::CallResult(function), &arguments);
        self.body.bound(result);
        self.body.called(function, &arguments, result);
        self.body.push(Statement::Call { function, arguments, result: Some(result) });
        self.of.calls.push(CallName { function: self.name.clone(), number: result.index(), name });
        Ok(result)
    }
}

fn binary(op: BinaryOp) -> BinaryOperator {
    match op {
        BinaryOp::Add => BinaryOperator::Add,
        BinaryOp::Sub => BinaryOperator::Subtract,
        BinaryOp::Mul => BinaryOperator::Multiply,
        BinaryOp::Div => BinaryOperator::Divide,
        BinaryOp::Rem => BinaryOperator::Modulo,
        BinaryOp::Less => BinaryOperator::Less,
        BinaryOp::LessEqual => BinaryOperator::LessEqual,
        BinaryOp::Greater => BinaryOperator::Greater,
        BinaryOp::GreaterEqual => BinaryOperator::GreaterEqual,
        BinaryOp::Equal => BinaryOperator::Equal,
        BinaryOp::NotEqual => BinaryOperator::NotEqual,
        BinaryOp::And => BinaryOperator::LogicalAnd,
        BinaryOp::Or => BinaryOperator::LogicalOr,
        BinaryOp::BitAnd => BinaryOperator::And,
        BinaryOp::BitOr => BinaryOperator::InclusiveOr,
        BinaryOp::BitXor => BinaryOperator::ExclusiveOr,
        BinaryOp::ShiftLeft => BinaryOperator::ShiftLeft,
        BinaryOp::ShiftRight => BinaryOperator::ShiftRight,
    }
}

fn math(f: Math) -> MathFunction {
    match f {
        Math::Abs => MathFunction::Abs,
        Math::Sign => MathFunction::Sign,
        Math::Floor => MathFunction::Floor,
        Math::Ceil => MathFunction::Ceil,
        Math::Round => MathFunction::Round,
        Math::Sqrt => MathFunction::Sqrt,
        Math::InverseSqrt => MathFunction::InverseSqrt,
        Math::Exp => MathFunction::Exp,
        Math::Log => MathFunction::Log,
        Math::Sin => MathFunction::Sin,
        Math::Cos => MathFunction::Cos,
        Math::Tan => MathFunction::Tan,
        Math::Asin => MathFunction::Asin,
        Math::Acos => MathFunction::Acos,
        Math::Atan => MathFunction::Atan,
        Math::Atan2 => MathFunction::Atan2,
        Math::Sinh => MathFunction::Sinh,
        Math::Cosh => MathFunction::Cosh,
        Math::Tanh => MathFunction::Tanh,
        Math::Pow => MathFunction::Pow,
        Math::Min => MathFunction::Min,
        Math::Max => MathFunction::Max,
        Math::Clamp => MathFunction::Clamp,
        Math::Dot => MathFunction::Dot,
        Math::Cross => MathFunction::Cross,
        Math::Length => MathFunction::Length,
        Math::Normalize => MathFunction::Normalize,
    }
}

/// The indices of its invocation that an entry point reads, in the order of its arguments.
fn indices(body: &[Stmt]) -> Vec<BuiltIn> {
    let mut found = vec![];
    crate::program::expressions(body, &mut |e| {
        let builtin = match e {
            Expr::GlobalId => BuiltIn::GlobalInvocationId,
            Expr::GroupId => BuiltIn::WorkGroupId,
            Expr::LocalIndex => BuiltIn::LocalInvocationIndex,
            Expr::VertexIndex => BuiltIn::VertexIndex,
            Expr::InstanceIndex => BuiltIn::InstanceIndex,
            _ => return,
        };
        if !found.contains(&builtin) {
            found.push(builtin);
        }
    });
    found
}
