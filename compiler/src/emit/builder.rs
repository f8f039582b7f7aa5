//! A small builder over naga's arenas: types, literals and, in one place, `Emit` ranges and blocks.

use crate::program::kernel::{Carries, Kernel, Prim, Ty};
use naga::{
    Block, Expression, Handle, Literal, LocalVariable, Module, Scalar, ScalarKind, Span, Statement, StructMember, Type,
    TypeInner, VectorSize,
};
use rustc_hash::FxHashMap;

/// Values nested deeper than this get a name, for readers and for compilers with a limit.
const MAX_DEPTH: u16 = 12;

/// Values spelt with more parts than this get a name.
const MAX_SIZE: u16 = 24;

/// The scalar type of a [`Prim`].
pub(super) fn scalar(prim: Prim) -> Scalar {
    match prim {
        Prim::Bool => Scalar::BOOL,
        Prim::F32 => Scalar::F32,
        Prim::I32 => Scalar::I32,
        Prim::U32 => Scalar::U32,
    }
}

/// The scalar kind of a [`Prim`].
pub(super) fn kind(prim: Prim) -> ScalarKind {
    scalar(prim).kind
}

fn inner(prim: Prim, width: u8) -> TypeInner {
    let scalar = scalar(prim);
    match width {
        2 => TypeInner::Vector { size: VectorSize::Bi, scalar },
        3 => TypeInner::Vector { size: VectorSize::Tri, scalar },
        4 => TypeInner::Vector { size: VectorSize::Quad, scalar },
        _ => TypeInner::Scalar(scalar),
    }
}

/// Size and alignment in bytes by WGSL's rules; naga holds a bool for one byte.
fn layout(prim: Prim, width: u8) -> (u32, u32) {
    let bytes = u32::from(scalar(prim).width);
    (bytes * u32::from(width), bytes * u32::from(if width == 3 { 4 } else { width }))
}

/// How a field passes through the rasteriser.
fn carried(carries: Carries, place: u32, ty: Ty) -> naga::Binding {
    let location = |location, interpolation, sampling| naga::Binding::Location {
        location,
        interpolation,
        sampling,
        blend_src: None,
        per_primitive: false,
    };
    match (carries, ty) {
        (Carries::Varyings, _) if place == 0 => naga::Binding::BuiltIn(naga::BuiltIn::Position { invariant: false }),
        (Carries::Varyings, Ty::Value(Prim::F32, _)) => {
            location(place - 1, Some(naga::Interpolation::Perspective), Some(naga::Sampling::Center))
        }
        (Carries::Varyings, _) => location(place - 1, Some(naga::Interpolation::Flat), None),
        (Carries::Colors, _) => location(place, None, None),
    }
}

/// The types of a module, made when first asked for so that nothing unused is declared.
pub(super) struct Types {
    /// Handle, size and alignment of each struct; `None` where this kernel does not use it.
    structs: Vec<Option<(Handle<Type>, u32, u32)>>,
}

impl Types {
    /// Declares the structs that a kernel uses under the names given: each its own and those of its fields.
    pub(super) fn new(kernel: &Kernel, module: &mut Module, names: Vec<(String, Vec<String>)>) -> Self {
        let mut types = Self { structs: vec![] };
        let used = crate::program::used_structs(kernel);
        for ((s, used), (name, fields)) in kernel.structs.iter().zip(used).zip(names) {
            if !used {
                types.structs.push(None);
                continue;
            }
            let (mut end, mut widest) = (0u32, 1u32);
            let mut members = vec![];
            for ((_, ty), field) in s.fields.iter().zip(fields) {
                let (size, alignment) = types.layout(*ty);
                let offset = end.next_multiple_of(alignment);
                (end, widest) = (offset + size, widest.max(alignment));
                let place = members.len() as u32;
                let binding = s.carries.map(|carries| carried(carries, place, *ty));
                members.push(StructMember { name: Some(field), ty: types.get(module, *ty), binding, offset });
            }
            let span = end.next_multiple_of(widest);
            let inner = TypeInner::Struct { members, span };
            let handle = module.types.insert(Type { name: Some(name), inner }, Span::UNDEFINED);
            types.structs.push(Some((handle, span, widest)));
        }
        types
    }

    /// The handle of a type.
    pub(super) fn get(&self, module: &mut Module, ty: Ty) -> Handle<Type> {
        match ty {
            Ty::Value(prim, width) => {
                module.types.insert(Type { name: None, inner: inner(prim, width) }, Span::UNDEFINED)
            }
            Ty::Struct(i) => self.of_struct(i).0,
        }
    }

    fn of_struct(&self, number: u32) -> (Handle<Type>, u32, u32) {
        self.structs[number as usize].expect("a struct that is named was found in use")
    }

    fn layout(&self, ty: Ty) -> (u32, u32) {
        match ty {
            Ty::Value(prim, width) => layout(prim, width),
            Ty::Struct(i) => (self.of_struct(i).1, self.of_struct(i).2),
        }
    }

    /// The handle of an array of a type, of a length that is known when it is bound unless it is given.
    pub(super) fn array(&self, module: &mut Module, element: Ty, length: Option<u32>) -> Handle<Type> {
        let (size, alignment) = self.layout(element);
        let base = self.get(module, element);
        let length = length.and_then(std::num::NonZeroU32::new);
        let length = length.map_or(naga::ArraySize::Dynamic, naga::ArraySize::Constant);
        let inner = TypeInner::Array { base, size: length, stride: size.next_multiple_of(alignment) };
        module.types.insert(Type { name: None, inner }, Span::UNDEFINED)
    }

    /// The handle of a sampled texture.
    pub(super) fn texture(&self, module: &mut Module, prim: Prim, dim: naga::ImageDimension) -> Handle<Type> {
        let inner = TypeInner::Image {
            dim,
            arrayed: false,
            class: naga::ImageClass::Sampled { kind: kind(prim), multi: false },
        };
        module.types.insert(Type { name: None, inner }, Span::UNDEFINED)
    }
}

/// How much text an expression is until a name cuts it short.
#[derive(Copy, Clone, Default)]
struct Extent {
    depth: u16,
    size: u16,
}

/// A function being built.
#[derive(Default)]
pub(super) struct Body {
    function: naga::Function,
    /// Blocks not yet finished, the innermost last; the function's own is the first.
    blocks: Vec<Block>,
    /// First expression of the open `Emit` range.
    open: Option<usize>,
    literals: FxHashMap<(ScalarKind, u32), Handle<Expression>>,
    extents: Vec<Extent>,
    /// The values of this statement, by what they are made of, and those of them that were asked for again.
    values: FxHashMap<Value, Handle<Expression>>,
    shared: Vec<Handle<Expression>>,
}

/// An operation and its operands, by number.
#[derive(PartialEq, Eq, Hash)]
struct Value(u8, [u32; 4]);

impl Value {
    /// Equal for expressions that are the same; `None` for what memory holds, and for what stands for itself.
    fn of(expression: &Expression) -> Option<Self> {
        let at = |e: Handle<Expression>| e.index() as u32;
        let maybe = |e: Option<Handle<Expression>>| e.map_or(u32::MAX, at);
        Some(match *expression {
            Expression::Unary { op, expr } => Self(0, [op as u32, at(expr), 0, 0]),
            Expression::Binary { op, left, right } => Self(1, [op as u32, at(left), at(right), 0]),
            Expression::Math { fun, arg, arg1, arg2, arg3: None } => {
                Self(2, [fun as u32, at(arg), maybe(arg1), maybe(arg2)])
            }
            Expression::Splat { size, value } => Self(3, [size as u32, at(value), 0, 0]),
            Expression::Select { condition, accept, reject } => Self(4, [at(condition), at(accept), at(reject), 0]),
            Expression::As { expr, kind, convert } => {
                Self(5, [at(expr), kind as u32, convert.map_or(u32::MAX, u32::from), 0])
            }
            Expression::Compose { ty, ref components } if components.len() <= 3 => {
                let mut parts = [ty.index() as u32, u32::MAX, u32::MAX, u32::MAX];
                parts[1..].iter_mut().zip(components).for_each(|(part, c)| *part = at(*c));
                Self(6, parts)
            }
            Expression::AccessIndex { base, index } => Self(7, [at(base), index, 0, 0]),
            _ => return None,
        })
    }

    /// The same for a call, if it has few arguments.
    fn of_call(function: Handle<naga::Function>, arguments: &[Handle<Expression>]) -> Option<Self> {
        let mut parts = [function.index() as u32, u32::MAX, u32::MAX, u32::MAX];
        (arguments.len() <= 3).then(|| {
            parts[1..].iter_mut().zip(arguments).for_each(|(part, a)| *part = a.index() as u32);
            Self(8, parts)
        })
    }
}

impl Body {
    /// A function with these arguments and this result.
    pub(super) fn new(
        name: String,
        arguments: Vec<naga::FunctionArgument>,
        result: Option<naga::FunctionResult>,
    ) -> Self {
        let function = naga::Function { name: Some(name), arguments, result, ..naga::Function::default() };
        Self { function, blocks: vec![Block::new()], ..Self::default() }
    }

    /// The finished function.
    pub(super) fn finish(mut self) -> naga::Function {
        self.close();
        self.function.body = self.blocks.pop().unwrap_or_default();
        self.function
    }

    /// Begins a statement: values made before may hold no longer.
    pub(super) fn begin(&mut self) {
        self.values.clear();
        self.shared.clear();
    }

    /// Where a value is about to be made, for [`Body::made`].
    pub(super) fn mark(&self) -> (usize, usize) {
        (self.function.expressions.len(), self.shared.len())
    }

    /// Notes a value that was there already. What it is made of was found again on the way, but is not used again.
    pub(super) fn made(&mut self, (there, shared): (usize, usize), value: Handle<Expression>) {
        if value.index() < there {
            self.shared.truncate(shared);
            self.shared.push(value);
        }
    }

    /// The values that this statement uses more than once and that need a name. Components are written out each time.
    pub(super) fn shared(&mut self) -> Vec<Handle<Expression>> {
        let mut shared = std::mem::take(&mut self.shared);
        shared.sort_unstable_by_key(|e| e.index());
        shared.dedup();
        let component = |e: &Handle<_>| matches!(self.function.expressions[*e], Expression::AccessIndex { .. });
        shared.retain(|e| self.can_name(*e) && !component(e));
        shared
    }

    /// Adds an expression, or finds it in the same statement; `parts` are its operands.
    pub(super) fn add(&mut self, expression: Expression, parts: &[Handle<Expression>]) -> Handle<Expression> {
        let value = Value::of(&expression);
        if let Some(known) = value.as_ref().and_then(|v| self.values.get(v)) {
            return *known;
        }
        let handle = self.append(expression, parts);
        if let Some(value) = value {
            self.values.insert(value, handle);
        }
        handle
    }

    /// The result of the same call in the same statement.
    pub(super) fn known_call(
        &self,
        function: Handle<naga::Function>,
        arguments: &[Handle<Expression>],
    ) -> Option<Handle<Expression>> {
        self.values.get(&Value::of_call(function, arguments)?).copied()
    }

    /// Notes the result of a call. Functions of kernels write nothing: called again, they give the same.
    pub(super) fn called(
        &mut self,
        function: Handle<naga::Function>,
        arguments: &[Handle<Expression>],
        result: Handle<Expression>,
    ) {
        if let Some(value) = Value::of_call(function, arguments) {
            self.values.insert(value, result);
        }
    }

    fn append(&mut self, expression: Expression, parts: &[Handle<Expression>]) -> Handle<Expression> {
        // Literals, globals and the like stand for themselves, and a call's result comes from its statement.
        let emitted = !(expression.needs_pre_emit() || matches!(expression, Expression::CallResult(_)));
        if !emitted {
            self.close();
        } else if self.open.is_none() {
            self.open = Some(self.function.expressions.len());
        }
        let mut extent = Extent { depth: 0, size: 1 };
        for part in parts.iter().map(|p| self.extents[p.index()]) {
            extent.depth = extent.depth.max(part.depth + 1);
            extent.size = extent.size.saturating_add(part.size);
        }
        self.extents.push(extent);
        self.function.expressions.append(expression, Span::UNDEFINED)
    }

    /// Whether this value should have a name, for it is long or deeply nested.
    pub(super) fn is_long(&self, e: Handle<Expression>) -> bool {
        let extent = self.extents[e.index()];
        extent.depth >= MAX_DEPTH || extent.size >= MAX_SIZE
    }

    /// Whether a `let` can carry this value: it belongs to an `Emit` range and has no name.
    pub(super) fn can_name(&self, e: Handle<Expression>) -> bool {
        let expression = &self.function.expressions[e];
        let emitted = !(expression.needs_pre_emit() || matches!(expression, Expression::CallResult(_)));
        emitted && !self.function.named_expressions.contains_key(&e)
    }

    /// Gives a value a name: the writers bind it there and then.
    pub(super) fn name(&mut self, e: Handle<Expression>, name: String) {
        self.function.named_expressions.insert(e, name);
        self.bound(e);
    }

    /// Notes that a value is bound to a name, so that its own text ends there.
    pub(super) fn bound(&mut self, e: Handle<Expression>) {
        self.extents[e.index()] = Extent { depth: 0, size: 1 };
    }

    /// A literal; each is in the arena once.
    pub(super) fn literal(&mut self, literal: Literal) -> Handle<Expression> {
        let key = match literal {
            Literal::F32(x) => (ScalarKind::Float, x.to_bits()),
            Literal::I32(x) => (ScalarKind::Sint, x.cast_unsigned()),
            Literal::U32(x) => (ScalarKind::Uint, x),
            Literal::Bool(x) => (ScalarKind::Bool, u32::from(x)),
            _ => return self.add(Expression::Literal(literal), &[]),
        };
        match self.literals.get(&key) {
            Some(handle) => *handle,
            None => {
                let handle = self.add(Expression::Literal(literal), &[]);
                self.literals.insert(key, handle);
                handle
            }
        }
    }

    /// Declares a local variable and returns the pointer to it.
    pub(super) fn variable(&mut self, name: String, ty: Handle<Type>) -> Handle<Expression> {
        let variable = LocalVariable { name: Some(name), ty, init: None };
        let variable = self.function.local_variables.append(variable, Span::UNDEFINED);
        self.add(Expression::LocalVariable(variable), &[])
    }

    /// Ends the open `Emit` range: its values are computed here.
    fn close(&mut self) {
        if let Some(start) = self.open.take() {
            let range = self.function.expressions.range_from(start);
            self.block().push(Statement::Emit(range), Span::UNDEFINED);
        }
    }

    fn block(&mut self) -> &mut Block {
        if self.blocks.is_empty() {
            self.blocks.push(Block::new());
        }
        let last = self.blocks.len() - 1;
        &mut self.blocks[last]
    }

    /// Adds a statement after everything computed so far.
    pub(super) fn push(&mut self, statement: Statement) {
        self.close();
        self.block().push(statement, Span::UNDEFINED);
    }

    /// Begins a nested block.
    pub(super) fn enter(&mut self) {
        self.close();
        self.blocks.push(Block::new());
    }

    /// Ends the innermost block.
    pub(super) fn leave(&mut self) -> Block {
        self.close();
        self.blocks.pop().unwrap_or_default()
    }
}

/// Adds a module-level constant of a scalar type.
pub(super) fn constant(module: &mut Module, name: String, literal: Literal) -> Handle<naga::Constant> {
    let inner = TypeInner::Scalar(literal.scalar());
    let ty = module.types.insert(Type { name: None, inner }, Span::UNDEFINED);
    let init = module.global_expressions.append(Expression::Literal(literal), Span::UNDEFINED);
    module.constants.append(naga::Constant { name: Some(name), ty, init }, Span::UNDEFINED)
}
