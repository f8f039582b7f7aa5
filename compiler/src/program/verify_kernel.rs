//! The verifier of kernels: types of every expression, scopes, indices, calls and returns.
//!
//! `emit` runs it on every kernel: it names the function and the statement in the terms of the backend,
//! where naga would name a handle.

use super::kernel::{
    BinaryOp, Carries, Expr, Function, Kernel, LocalId, Math, Prim, ResourceKind, Stage, Stmt, Ty, UnaryOp,
};

/// Expressions nested deeper than this are refused: walkers of kernels are recursive, and so are their readers.
/// `emit` names intermediate values by itself long before, so that this is no limit on the text.
pub const MAX_EXPRESSION_DEPTH: u32 = 400;

/// Blocks nested deeper than this are refused: WGSL allows 127 levels of braces.
pub const MAX_BLOCK_DEPTH: u32 = 100;

/// Bytes that the invocations of a workgroup may share: what WebGPU promises.
const MAX_SHARED: u64 = 16 << 10;

/// Checks a kernel against everything that its types promise.
///
/// # Errors
/// The first thing found wrong, with the function and the local or statement it lies in. It is always a mistake of the
/// backend that made the kernel, never of the scene.
pub fn verify(kernel: &Kernel) -> Result<(), String> {
    let [x, y, z] = kernel.workgroup();
    if [x, y, z].contains(&0) || u64::from(x) * u64::from(y) * u64::from(z) > 256 {
        return Err(format!("workgroup size {x}×{y}×{z} is not between 1 and 256 invocations"));
    }
    for (i, s) in kernel.structs.iter().enumerate() {
        if s.fields.is_empty() {
            return Err(format!("struct {i} `{}` has no fields", s.name));
        }
        for (name, ty) in &s.fields {
            if !matches!(ty, Ty::Value(..)) {
                return Err(format!("field `{name}` of struct `{}` is not a value", s.name));
            }
            check_type(kernel, *ty).map_err(|e| format!("field `{name}` of struct `{}`: {e}", s.name))?;
        }
        let vec4 = |ty: &Ty| *ty == Ty::float(4);
        let fits = match s.carries {
            None => true,
            Some(Carries::Varyings) => {
                vec4(&s.fields[0].1) && s.fields.iter().all(|f| !matches!(f.1, Ty::Value(Prim::Bool, _)))
            }
            Some(Carries::Colors) => s.fields.iter().all(|f| vec4(&f.1)),
        };
        if !fits {
            return Err(format!("struct `{}` cannot pass through the rasteriser", s.name));
        }
    }
    let mut uniforms = 0;
    for r in &kernel.resources {
        let shared = |ty| shareable(kernel, ty).map_err(|e| format!("resource `{}`: {e}", r.name));
        match r.kind {
            ResourceKind::Uniform(index) => {
                uniforms += 1;
                shared(Ty::Struct(index))?;
            }
            ResourceKind::ReadBuffer(ty) | ResourceKind::WriteBuffer(ty) => shared(ty)?,
            ResourceKind::Workgroup(Ty::Value(Prim::F32 | Prim::I32 | Prim::U32, 1), 1..) => {}
            ResourceKind::Workgroup(..) => {
                return Err(format!("memory `{}` of a workgroup holds some numbers, each of one component", r.name));
            }
            ResourceKind::Texture3d(Prim::Bool) => return Err(format!("texture `{}` of bool", r.name)),
            ResourceKind::Texture3d(Prim::F32 | Prim::I32 | Prim::U32) | ResourceKind::Texture2d => {}
        }
    }
    if kernel.shared_bytes() > MAX_SHARED {
        return Err(format!("a workgroup shares {} bytes, more than {MAX_SHARED}", kernel.shared_bytes()));
    }
    if uniforms > 1 {
        return Err("more than one uniform struct".into());
    }
    for (i, f) in kernel.functions.iter().enumerate() {
        if f.result.is_none() {
            return Err(format!("function {i} `{}` has no result: nothing could call it", f.name));
        }
        Checker::new(kernel, f, i, false).run()?;
    }
    let entry = &kernel.entry;
    let carries = |ty: Ty| match ty {
        Ty::Struct(i) => kernel.structs.get(i as usize).and_then(|s| s.carries),
        Ty::Value(..) => None,
    };
    let parameters: Vec<_> = entry.parameters.iter().map(|p| carries(p.1)).collect();
    let (takes, gives): (&[_], _) = match kernel.stage {
        Stage::Compute(_) => (&[], None),
        Stage::Vertex => (&[], Some(Some(Carries::Varyings))),
        Stage::Fragment => (&[Some(Carries::Varyings)], Some(Some(Carries::Colors))),
    };
    if parameters != takes || entry.result.map(carries) != gives {
        return Err("the entry point has parameters or a result that its stage does not have".into());
    }
    Checker::new(kernel, entry, kernel.functions.len(), true).run()
}

fn check_type(kernel: &Kernel, ty: Ty) -> Result<(), String> {
    match ty {
        Ty::Value(_, 1..=4) => Ok(()),
        Ty::Value(_, width) => Err(format!("a value of {width} components")),
        Ty::Struct(i) if (i as usize) < kernel.structs.len() => Ok(()),
        Ty::Struct(i) => Err(format!("there is no struct {i}")),
    }
}

/// Whether memory outside the kernel can hold it: WGSL has no bool there.
fn shareable(kernel: &Kernel, ty: Ty) -> Result<(), String> {
    check_type(kernel, ty)?;
    match ty {
        Ty::Value(Prim::Bool, _) => Err("bool cannot live in a buffer".into()),
        Ty::Value(Prim::F32 | Prim::I32 | Prim::U32, _) => Ok(()),
        Ty::Struct(i) => {
            kernel.structs[i as usize].fields.iter().try_for_each(|(name, ty)| match shareable(kernel, *ty) {
                Ok(()) => Ok(()),
                Err(e) => Err(format!("field `{name}`: {e}")),
            })
        }
    }
}

/// What is known about a local at some point of the function.
#[derive(Copy, Clone, PartialEq)]
enum Scope {
    /// Not yet declared.
    Unseen,
    /// Declared; the flag says whether by `Var`.
    Live(bool),
    /// Declared in a block that has ended.
    Gone,
}

struct Checker<'a> {
    kernel: &'a Kernel,
    function: &'a Function,
    /// Functions before this one may be called.
    index: usize,
    entry: bool,
    scope: Vec<Scope>,
    /// Locals in order of declaration, to end their scope with their block.
    declared: Vec<LocalId>,
    loops: u32,
    /// Whether an invocation may have returned.
    returned: bool,
}

impl<'a> Checker<'a> {
    fn new(kernel: &'a Kernel, function: &'a Function, index: usize, entry: bool) -> Self {
        let scope = vec![Scope::Unseen; function.locals.len()];
        Self { kernel, function, index, entry, scope, declared: vec![], loops: 0, returned: false }
    }

    fn run(mut self) -> Result<(), String> {
        let name = &self.function.name;
        let context = |e: String| format!("function `{name}`: {e}");
        let types = self.function.parameters.iter().map(|(n, ty)| (n, *ty));
        for (n, ty) in types.chain(self.function.locals.iter().map(|l| (&l.name, l.ty))) {
            check_type(self.kernel, ty).map_err(|e| context(format!("`{n}`: {e}")))?;
        }
        if let Some(ty) = self.function.result {
            check_type(self.kernel, ty).map_err(|e| context(format!("result: {e}")))?;
        }
        let function = self.function;
        let ends = self.block(&function.body, 0).map_err(context)?;
        if self.function.result.is_some() && !ends {
            return Err(context("a path ends without returning the result".into()));
        }
        Ok(())
    }

    /// Checks a block and says whether control never reaches its end.
    fn block(&mut self, block: &[Stmt], depth: u32) -> Result<bool, String> {
        if depth > MAX_BLOCK_DEPTH {
            return Err(format!("blocks nested deeper than {MAX_BLOCK_DEPTH}"));
        }
        let mark = self.declared.len();
        let mut ends = false;
        for (i, stmt) in block.iter().enumerate() {
            if ends {
                return Err(format!("statement {i} of a block stands after one that leaves it"));
            }
            ends = self.stmt(stmt, depth)?;
        }
        for id in self.declared.drain(mark..) {
            self.scope[id.0 as usize] = Scope::Gone;
        }
        Ok(ends)
    }

    fn stmt(&mut self, stmt: &Stmt, depth: u32) -> Result<bool, String> {
        match stmt {
            Stmt::Let(id, value) => self.declare(*id, value, false)?,
            Stmt::Var(id, value) => self.declare(*id, value, true)?,
            Stmt::Assign(id, value) => {
                let local = self.local(*id)?;
                let within = |e: String| format!("assignment to `{}`: {e}", local.name);
                if self.scope[id.0 as usize] != Scope::Live(true) {
                    return Err(within("it is not a variable in scope".into()));
                }
                self.expect(value, local.ty).map_err(within)?;
            }
            Stmt::If(condition, accept, reject) => {
                self.expect(condition, Ty::BOOL).map_err(|e| format!("condition: {e}"))?;
                let accept = self.block(accept, depth + 1)?;
                let reject = self.block(reject, depth + 1)?;
                return Ok(accept && reject);
            }
            Stmt::Loop(body) => {
                self.loops += 1;
                self.block(body, depth + 1)?;
                self.loops -= 1;
                if !leaves_loop(body) {
                    return Err("a loop that nothing leaves".into());
                }
                // Only a loop without a break of its own never reaches what follows.
                return Ok(!breaks(body));
            }
            Stmt::Break | Stmt::Continue => {
                if self.loops == 0 {
                    return Err("a break or continue outside of a loop".into());
                }
                return Ok(true);
            }
            Stmt::Barrier => {
                let compute = matches!(self.kernel.stage, Stage::Compute(_));
                if !self.entry || !compute || depth > 0 || self.returned {
                    return Err("a barrier that not every invocation of a workgroup comes to".into());
                }
            }
            Stmt::Return(value) => {
                self.returned = true;
                match (value, self.function.result) {
                    (Some(value), Some(ty)) => self.expect(value, ty).map_err(|e| format!("return: {e}"))?,
                    (None, None) => {}
                    (Some(_), None) => return Err("returns a value but has no result".into()),
                    (None, Some(_)) => return Err("returns without its result".into()),
                }
                return Ok(true);
            }
            Stmt::Store { buffer, index, value } => {
                let resource = self.kernel.resources.get(*buffer as usize);
                let Some((ResourceKind::WriteBuffer(ty) | ResourceKind::Workgroup(ty, _), name)) =
                    resource.map(|r| (r.kind, &r.name))
                else {
                    return Err(format!("stores to resource {buffer}, which is not a write buffer"));
                };
                self.expect(index, Ty::U32).map_err(|e| format!("index into `{name}`: {e}"))?;
                self.expect(value, ty).map_err(|e| format!("store to `{name}`: {e}"))?;
            }
        }
        Ok(false)
    }

    fn local(&self, id: LocalId) -> Result<&'a super::kernel::Local, String> {
        self.function.locals.get(id.0 as usize).ok_or_else(|| format!("there is no local {}", id.0))
    }

    fn declare(&mut self, id: LocalId, value: &Expr, variable: bool) -> Result<(), String> {
        let local = self.local(id)?;
        self.expect(value, local.ty).map_err(|e| format!("`{}`: {e}", local.name))?;
        if self.scope[id.0 as usize] != Scope::Unseen {
            return Err(format!("local {} `{}` is declared twice", id.0, local.name));
        }
        self.scope[id.0 as usize] = Scope::Live(variable);
        self.declared.push(id);
        Ok(())
    }

    fn expect(&self, e: &Expr, ty: Ty) -> Result<(), String> {
        same(ty, self.ty(e, 0)?, "expected", self.kernel)
    }

    fn ty(&self, e: &Expr, depth: u32) -> Result<Ty, String> {
        if depth > MAX_EXPRESSION_DEPTH {
            return Err(format!("an expression nested deeper than {MAX_EXPRESSION_DEPTH}: name a part of it"));
        }
        let of = |e: &Expr| self.ty(e, depth + 1);
        let show = |ty: Ty| show(ty, self.kernel);
        match e {
            Expr::F32(_) => Ok(Ty::F32),
            Expr::I32(_) => Ok(Ty::I32),
            Expr::U32(_) => Ok(Ty::U32),
            Expr::Bool(_) => Ok(Ty::BOOL),
            Expr::Local(id) => {
                let local = self.local(*id)?;
                match self.scope[id.0 as usize] {
                    Scope::Live(_) => Ok(local.ty),
                    Scope::Unseen => Err(format!("local {} `{}` is read before it is declared", id.0, local.name)),
                    Scope::Gone => Err(format!("local {} `{}` is read outside of its block", id.0, local.name)),
                }
            }
            Expr::Argument(i) => match self.function.parameters.get(*i as usize) {
                Some((_, ty)) => Ok(*ty),
                None => Err(format!("there is no argument {i}")),
            },
            Expr::Uniform(i) => {
                let uniform = self.kernel.resources.iter().find_map(|r| match r.kind {
                    ResourceKind::Uniform(s) => Some(s),
                    ResourceKind::ReadBuffer(_) | ResourceKind::WriteBuffer(_) | ResourceKind::Workgroup(..) => None,
                    ResourceKind::Texture3d(_) | ResourceKind::Texture2d => None,
                });
                let fields = uniform.map_or(&[][..], |s| &self.kernel.structs[s as usize].fields);
                fields.get(*i as usize).map(|f| f.1).ok_or_else(|| format!("there is no uniform field {i}"))
            }
            Expr::GlobalId | Expr::GroupId | Expr::LocalIndex | Expr::VertexIndex | Expr::InstanceIndex => {
                match (e, self.kernel.stage) {
                    _ if !self.entry => Err("an index of the invocation is known to the entry point only".into()),
                    (Expr::GlobalId | Expr::GroupId, Stage::Compute(_)) => Ok(Ty::Value(Prim::U32, 3)),
                    (Expr::LocalIndex, Stage::Compute(_)) => Ok(Ty::U32),
                    (Expr::VertexIndex | Expr::InstanceIndex, Stage::Vertex) => Ok(Ty::U32),
                    _ => Err("an index of the invocation that its stage does not have".into()),
                }
            }
            Expr::Unary(op, a) => match (op, of(a)?) {
                (UnaryOp::Neg, ty @ Ty::Value(Prim::F32 | Prim::I32, _))
                | (UnaryOp::Not, ty @ Ty::Value(Prim::Bool, _)) => Ok(ty),
                (op, ty) => Err(format!("{op:?} of {}", show(ty))),
            },
            Expr::Binary(op, a, b) => self.binary(*op, of(a)?, of(b)?, b),
            Expr::Math(f, arguments) => {
                let types = arguments.iter().map(of).collect::<Result<Vec<_>, _>>()?;
                math(*f, &types).ok_or_else(|| {
                    let types: Vec<_> = types.iter().map(|ty| show(*ty)).collect();
                    format!("{f:?} of ({})", types.join(", "))
                })
            }
            Expr::Compose(ty, parts) => {
                check_type(self.kernel, *ty)?;
                let wanted: Vec<Ty> = match *ty {
                    Ty::Value(_, 1) => return Err("composes a scalar".into()),
                    Ty::Value(prim, width) => vec![Ty::Value(prim, 1); width as usize],
                    Ty::Struct(i) => self.kernel.structs[i as usize].fields.iter().map(|f| f.1).collect(),
                };
                if wanted.len() != parts.len() {
                    return Err(format!("composes {} from {} parts", show(*ty), parts.len()));
                }
                for (i, (part, wanted)) in parts.iter().zip(wanted).enumerate() {
                    same(wanted, of(part)?, &format!("part {i} of {} should be", show(*ty)), self.kernel)?;
                }
                Ok(*ty)
            }
            Expr::Splat(a, width) => match (of(a)?, width) {
                (Ty::Value(prim, 1), 2..=4) => Ok(Ty::Value(prim, *width)),
                (ty, width) => Err(format!("splat of {} to {width} components", show(ty))),
            },
            Expr::Component(a, i) => match of(a)? {
                Ty::Value(prim, width @ 2..=4) if *i < width => Ok(Ty::Value(prim, 1)),
                ty => Err(format!("component {i} of {}", show(ty))),
            },
            Expr::Field(a, i) => match of(a)? {
                Ty::Struct(s) => match self.kernel.structs[s as usize].fields.get(*i as usize) {
                    Some((_, ty)) => Ok(*ty),
                    None => Err(format!("field {i} of {}", show(Ty::Struct(s)))),
                },
                ty @ Ty::Value(..) => Err(format!("field {i} of {}", show(ty))),
            },
            Expr::Select(condition, accept, reject) => {
                same(Ty::BOOL, of(condition)?, "the condition of a select should be", self.kernel)?;
                let ty = of(accept)?;
                same(ty, of(reject)?, "both sides of a select should be", self.kernel)?;
                if matches!(ty, Ty::Struct(_)) {
                    return Err(format!("select of {}: select its fields or branch", show(ty)));
                }
                Ok(ty)
            }
            Expr::Convert(prim, a) => match of(a)? {
                Ty::Value(_, width) => Ok(Ty::Value(*prim, width)),
                ty @ Ty::Struct(_) => Err(format!("conversion of {}", show(ty))),
            },
            Expr::Bitcast(prim, a) => match (prim, of(a)?) {
                (Prim::F32 | Prim::I32 | Prim::U32, Ty::Value(Prim::F32 | Prim::I32 | Prim::U32, width)) => {
                    Ok(Ty::Value(*prim, width))
                }
                (prim, ty) => Err(format!("bitcast of {} to {prim:?}", show(ty))),
            },
            Expr::Call(id, arguments) => {
                let index = id.0 as usize;
                let Some(callee) = self.kernel.functions.get(index).filter(|_| index < self.index) else {
                    return Err(format!("calls function {index}, which is not before it"));
                };
                if callee.parameters.len() != arguments.len() {
                    let (got, wanted) = (arguments.len(), callee.parameters.len());
                    return Err(format!("calls `{}` with {got} arguments instead of {wanted}", callee.name));
                }
                for (a, (name, ty)) in arguments.iter().zip(&callee.parameters) {
                    same(*ty, of(a)?, &format!("argument `{name}` of `{}` should be", callee.name), self.kernel)?;
                }
                callee.result.ok_or_else(|| format!("calls `{}`, which has no result", callee.name))
            }
            Expr::TextureLoad(texture, at) => {
                let kind = self.kernel.resources.get(*texture as usize).map(|r| r.kind);
                let axes = if kind == Some(ResourceKind::Texture2d) { 2 } else { 3 };
                same(Ty::Value(Prim::I32, axes), of(at)?, "a texel's place should be", self.kernel)?;
                match kind {
                    Some(ResourceKind::Texture3d(prim)) => Ok(Ty::Value(prim, 4)),
                    Some(ResourceKind::Texture2d) => Ok(Ty::float(4)),
                    _ => Err(format!("loads a texel of resource {texture}, which is not a texture")),
                }
            }
            Expr::Load(buffer, index) => {
                same(Ty::U32, of(index)?, "an index should be", self.kernel)?;
                match self.kernel.resources.get(*buffer as usize).map(|r| r.kind) {
                    Some(ResourceKind::ReadBuffer(ty) | ResourceKind::WriteBuffer(ty)) => Ok(ty),
                    Some(ResourceKind::Workgroup(ty, _)) => Ok(ty),
                    _ => Err(format!("loads from resource {buffer}, which is not a buffer")),
                }
            }
        }
    }

    fn binary(&self, op: BinaryOp, a: Ty, b: Ty, right: &Expr) -> Result<Ty, String> {
        use BinaryOp as B;
        let wrong = || format!("{op:?} of {} and {}", show(a, self.kernel), show(b, self.kernel));
        let Ty::Value(prim, width) = a else { return Err(wrong()) };
        if matches!(op, B::ShiftLeft | B::ShiftRight) {
            if !matches!(prim, Prim::I32 | Prim::U32) || b != Ty::Value(Prim::U32, width) {
                return Err(wrong());
            }
            return match right {
                Expr::U32(32..) => Err(format!("{op:?} by {right:?}: at most 31")),
                _ => Ok(a),
            };
        }
        if a != b {
            return Err(wrong());
        }
        let number = prim != Prim::Bool;
        match op {
            B::Add | B::Sub | B::Mul | B::Div | B::Rem if number => Ok(a),
            B::Less | B::LessEqual | B::Greater | B::GreaterEqual if number => Ok(Ty::Value(Prim::Bool, width)),
            B::Equal | B::NotEqual => Ok(Ty::Value(Prim::Bool, width)),
            B::And | B::Or if a == Ty::BOOL => Ok(a),
            B::BitAnd | B::BitOr if prim != Prim::F32 => Ok(a),
            B::BitXor if matches!(prim, Prim::I32 | Prim::U32) => Ok(a),
            B::Add | B::Sub | B::Mul | B::Div | B::Rem => Err(wrong()),
            B::Less | B::LessEqual | B::Greater | B::GreaterEqual => Err(wrong()),
            B::And | B::Or | B::BitAnd | B::BitOr | B::BitXor | B::ShiftLeft | B::ShiftRight => Err(wrong()),
        }
    }
}

/// The type of a built-in function on these arguments, if it takes them.
fn math(f: Math, arguments: &[Ty]) -> Option<Ty> {
    let (Some(&first @ Ty::Value(prim, width)), true) = (arguments.first(), arguments.windows(2).all(|w| w[0] == w[1]))
    else {
        return None;
    };
    let float = prim == Prim::F32;
    let (count, fits, result) = match f {
        Math::Abs => (1, prim != Prim::Bool, first),
        Math::Sign => (1, matches!(prim, Prim::F32 | Prim::I32), first),
        Math::Floor | Math::Ceil | Math::Round | Math::Sqrt | Math::InverseSqrt | Math::Exp | Math::Log => {
            (1, float, first)
        }
        Math::Sin | Math::Cos | Math::Tan | Math::Asin | Math::Acos | Math::Atan => (1, float, first),
        Math::Sinh | Math::Cosh | Math::Tanh => (1, float, first),
        Math::Atan2 | Math::Pow => (2, float, first),
        Math::Min | Math::Max => (2, prim != Prim::Bool, first),
        Math::Clamp => (3, prim != Prim::Bool, first),
        Math::Dot => (2, width > 1 && prim != Prim::Bool, Ty::Value(prim, 1)),
        Math::Cross => (2, float && width == 3, first),
        Math::Length => (1, float, Ty::F32),
        Math::Normalize => (1, float && width > 1, first),
    };
    (fits && arguments.len() == count).then_some(result)
}

fn same(wanted: Ty, got: Ty, what: &str, kernel: &Kernel) -> Result<(), String> {
    if wanted == got { Ok(()) } else { Err(format!("{what} {}, not {}", show(wanted, kernel), show(got, kernel))) }
}

/// A type as WGSL would write it.
fn show(ty: Ty, kernel: &Kernel) -> String {
    match ty {
        Ty::Value(prim, 1) => format!("{prim:?}").to_lowercase(),
        Ty::Value(prim, width) => format!("vec{width}<{}>", format!("{prim:?}").to_lowercase()),
        Ty::Struct(i) => kernel.structs.get(i as usize).map_or_else(|| format!("struct {i}"), |s| s.name.clone()),
    }
}

/// Whether a `Break` of the loop whose body this is stands in it.
pub(crate) fn breaks(body: &[Stmt]) -> bool {
    body.iter().any(|s| match s {
        Stmt::Break => true,
        Stmt::If(_, accept, reject) => breaks(accept) || breaks(reject),
        Stmt::Let(..) | Stmt::Var(..) | Stmt::Assign(..) | Stmt::Store { .. } => false,
        Stmt::Loop(_) | Stmt::Continue | Stmt::Return(_) | Stmt::Barrier => false,
    })
}

fn leaves_loop(body: &[Stmt]) -> bool {
    breaks(body) || returns(body)
}

fn returns(body: &[Stmt]) -> bool {
    body.iter().any(|s| match s {
        Stmt::Return(_) => true,
        Stmt::If(_, accept, reject) => returns(accept) || returns(reject),
        Stmt::Loop(inner) => returns(inner),
        Stmt::Let(..) | Stmt::Var(..) | Stmt::Assign(..) | Stmt::Store { .. } => false,
        Stmt::Break | Stmt::Continue | Stmt::Barrier => false,
    })
}

#[cfg(test)]
mod tests {
    use super::super::kernel::{FunctionId, Local, Resource, Struct};
    use super::*;

    /// A kernel that binds one expression of a type, in a world with one of everything.
    fn binding(ty: Ty, e: Expr) -> Kernel {
        with_body(vec![("x", ty)], vec![Stmt::Let(LocalId(0), e)])
    }

    fn with_body(locals: Vec<(&str, Ty)>, body: Vec<Stmt>) -> Kernel {
        let local = |(name, ty): (&str, Ty)| Local { name: name.into(), ty, origin: None };
        let square = Function {
            name: "square".into(),
            parameters: vec![("a".into(), Ty::F32)],
            result: Some(Ty::F32),
            body: vec![Stmt::Return(Some(Expr::Argument(0) * Expr::Argument(0)))],
            ..Function::default()
        };
        Kernel {
            name: "k".into(),
            stage: Stage::Compute([64, 1, 1]),
            structs: vec![Struct {
                name: "Frame".into(),
                fields: vec![("a".into(), Ty::F32), ("b".into(), Ty::VEC3)],
                carries: None,
            }],
            resources: vec![
                Resource { name: "frame".into(), kind: ResourceKind::Uniform(0) },
                Resource { name: "out".into(), kind: ResourceKind::WriteBuffer(Ty::F32) },
                Resource { name: "voxels".into(), kind: ResourceKind::Texture3d(Prim::U32) },
            ],
            functions: vec![square],
            entry: Function {
                name: "entry".into(),
                locals: locals.into_iter().map(local).collect(),
                body,
                ..Function::default()
            },
        }
    }

    fn refused(kernel: &Kernel, what: &str) {
        let message = verify(kernel).expect_err(what);
        assert!(message.contains(what), "`{message}` does not say `{what}`");
    }

    #[test]
    fn expressions_have_their_types() {
        let f = || Expr::Uniform(0);
        let v = || Expr::Uniform(1);
        let three = Ty::VEC3;
        for (ty, e, what) in [
            (Ty::F32, Expr::U32(1), "`x`: expected f32, not u32"),
            (Ty::F32, v(), "expected f32, not vec3<f32>"),
            (three, f() * v(), "Mul of f32 and vec3<f32>"),
            (Ty::F32, f() + 1u32, "Add of f32 and u32"),
            (Ty::F32, Expr::unary(UnaryOp::Not, f()), "Not of f32"),
            (Ty::U32, Expr::unary(UnaryOp::Neg, Expr::U32(1)), "Neg of u32"),
            (Ty::BOOL, v().less(v()).and(v().less(v())), "And of vec3<bool>"),
            (Ty::F32, Expr::binary(BinaryOp::BitAnd, f(), f()), "BitAnd of f32"),
            (Ty::I32, Expr::binary(BinaryOp::ShiftLeft, Expr::I32(1), Expr::I32(1)), "ShiftLeft of i32 and i32"),
            (Ty::U32, Expr::binary(BinaryOp::ShiftLeft, Expr::U32(1), 32u32), "at most 31"),
            (Ty::F32, Expr::math(Math::Sqrt, [Expr::U32(2)]), "Sqrt of (u32)"),
            (Ty::F32, Expr::math(Math::Max, [f()]), "Max of (f32)"),
            (Ty::F32, Expr::Math(Math::Abs, vec![]), "Abs of ()"),
            (three, Expr::math(Math::Clamp, [v(), f(), f()]), "Clamp of (vec3<f32>, f32, f32)"),
            (Ty::F32, f().dot(f()), "Dot of (f32, f32)"),
            (three, Expr::Compose(three, vec![f(), f()]), "from 2 parts"),
            (three, Expr::Compose(three, vec![f(), f(), Expr::I32(1)]), "part 2 of vec3<f32> should be f32, not i32"),
            (Ty::Value(Prim::F32, 5), f(), "5 components"),
            (Ty::F32, v().component(3), "component 3 of vec3<f32>"),
            (Ty::F32, f().component(0), "component 0 of f32"),
            (Ty::F32, f().field(0), "field 0 of f32"),
            (Ty::F32, Expr::Compose(Ty::Struct(0), vec![f(), v()]).field(2), "field 2 of Frame"),
            (Ty::Struct(4), f(), "there is no struct 4"),
            (three, v().splat(3), "splat of vec3<f32>"),
            (three, v().less(v()).select(v(), v()), "condition of a select should be bool"),
            (Ty::F32, Expr::Bool(true).select(f(), Expr::I32(0)), "both sides of a select"),
            (Ty::BOOL, f().bitcast(Prim::Bool), "bitcast of f32 to Bool"),
            (Ty::F32, Expr::Call(FunctionId(0), vec![]), "with 0 arguments instead of 1"),
            (Ty::F32, Expr::Call(FunctionId(0), vec![v()]), "argument `a` of `square` should be f32"),
            (Ty::F32, Expr::Call(FunctionId(1), vec![f()]), "calls function 1, which is not before it"),
            (Ty::F32, Expr::Argument(0), "there is no argument 0"),
            (Ty::F32, Expr::Uniform(2), "there is no uniform field 2"),
            (Ty::F32, Expr::load(2, 0u32), "resource 2, which is not a buffer"),
            (Ty::F32, Expr::load(1, Expr::I32(0)), "an index should be u32, not i32"),
            (Ty::F32, Expr::texture_load(1, Expr::I32(0).splat(3)), "which is not a texture"),
            (Ty::F32, Expr::texture_load(2, Expr::GlobalId), "place should be vec3<i32>, not vec3<u32>"),
            (Ty::F32, Expr::Local(LocalId(7)), "there is no local 7"),
            (Ty::F32, Expr::Local(LocalId(0)), "`x` is read before it is declared"),
        ] {
            refused(&binding(ty, e), what);
        }
        assert_eq!(verify(&binding(Ty::F32, Expr::Call(FunctionId(0), vec![f()]))), Ok(()));
    }

    #[test]
    fn statements_keep_their_scopes() {
        let (a, b) = (LocalId(0), LocalId(1));
        let two = || vec![("a", Ty::F32), ("b", Ty::F32)];
        let yes = || Expr::Bool(true);
        let one = || Expr::F32(1.0);
        for (body, what) in [
            (vec![Stmt::Let(a, one()), Stmt::Let(a, one())], "`a` is declared twice"),
            (vec![Stmt::Let(a, one()), Stmt::Assign(a, one())], "assignment to `a`: it is not a variable in scope"),
            (vec![Stmt::Assign(a, one())], "not a variable in scope"),
            (vec![Stmt::If(yes(), vec![Stmt::Let(a, one())], vec![]), Stmt::Let(b, a.into())], "outside of its block"),
            (vec![Stmt::If(yes(), vec![Stmt::Var(a, one())], vec![Stmt::Assign(a, one())])], "not a variable in scope"),
            (vec![Stmt::If(one(), vec![], vec![])], "condition: expected bool, not f32"),
            (vec![Stmt::Break], "outside of a loop"),
            (vec![Stmt::Loop(vec![Stmt::Continue])], "a loop that nothing leaves"),
            (vec![Stmt::Loop(vec![Stmt::Loop(vec![Stmt::Break])])], "a loop that nothing leaves"),
            (vec![Stmt::Return(None), Stmt::Let(a, one())], "statement 1 of a block stands after one that leaves it"),
            (vec![Stmt::Return(Some(one()))], "returns a value but has no result"),
            (vec![Stmt::Store { buffer: 2, index: 0u32.into(), value: one() }], "not a write buffer"),
            (vec![Stmt::Store { buffer: 1, index: one(), value: one() }], "index into `out`: expected u32"),
            (vec![Stmt::Store { buffer: 1, index: 0u32.into(), value: yes() }], "store to `out`: expected f32"),
        ] {
            refused(&with_body(two(), body), what);
        }
        let fine = vec![
            Stmt::Var(a, one()),
            Stmt::Loop(vec![
                Stmt::If(Expr::Local(a).greater(9.0), vec![Stmt::Break], vec![]),
                Stmt::Let(b, Expr::Local(a) * 2.0),
                Stmt::Assign(a, b.into()),
            ]),
        ];
        assert_eq!(verify(&with_body(two(), fine)), Ok(()));
    }

    #[test]
    fn functions_return_and_kernels_are_whole() {
        let mut k = with_body(vec![], vec![]);
        k.functions[0].body = vec![Stmt::If(Expr::Argument(0).less(0.0), vec![Stmt::Return(Some(1.0.into()))], vec![])];
        refused(&k, "function `square`: a path ends without returning the result");
        k.functions[0].body = vec![Stmt::Return(None)];
        refused(&k, "returns without its result");
        k.functions[0].body = vec![Stmt::Return(Some(Expr::Call(FunctionId(0), vec![Expr::Argument(0)])))];
        refused(&k, "calls function 0, which is not before it");
        k.functions[0].body = vec![Stmt::Return(Some(Expr::GlobalId.component(0).convert(Prim::F32)))];
        refused(&k, "known to the entry point only");
        k.functions[0].result = None;
        refused(&k, "has no result");
        let whole = || with_body(vec![], vec![]);
        let mut k = whole();
        k.stage = Stage::Compute([64, 64, 1]);
        refused(&k, "workgroup size");
        let mut k = whole();
        k.structs[0].fields.clear();
        refused(&k, "has no fields");
        let mut k = whole();
        k.structs[0].fields[0].1 = Ty::Struct(0);
        refused(&k, "field `a` of struct `Frame` is not a value");
        let mut k = whole();
        k.structs[0].fields[0].1 = Ty::BOOL;
        refused(&k, "field `a`: bool cannot live in a buffer");
        let mut k = whole();
        k.resources.push(k.resources[0].clone());
        refused(&k, "more than one uniform struct");
        let mut k = whole();
        k.resources[2].kind = ResourceKind::Texture3d(Prim::Bool);
        refused(&k, "texture `voxels` of bool");
        let mut k = whole();
        k.entry.parameters.push(("p".into(), Ty::F32));
        refused(&k, "the entry point has parameters");
    }

    #[test]
    fn nesting_has_a_limit() {
        let deep = (0..500).fold(Expr::Uniform(0), |e, _| -e);
        refused(&binding(Ty::F32, deep), "nested deeper");
        let mut block = vec![];
        for _ in 0..110 {
            block = vec![Stmt::If(Expr::Bool(true), block, vec![])];
        }
        refused(&with_body(vec![], block), "blocks nested deeper");
    }
}
