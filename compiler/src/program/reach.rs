//! What of a kernel its entry point reaches: kernels that are written together share a list of functions and resources.

use super::kernel::{Expr, FunctionId, Kernel, ResourceKind, Stmt, Ty};

/// Calls a function with every expression of some statements, inner ones too.
pub(crate) fn expressions(block: &[Stmt], visit: &mut dyn FnMut(&Expr)) {
    for statement in block {
        match statement {
            Stmt::Let(_, value) | Stmt::Var(_, value) | Stmt::Assign(_, value) | Stmt::Return(Some(value)) => {
                expression(value, visit);
            }
            Stmt::If(condition, then, otherwise) => {
                expression(condition, visit);
                expressions(then, visit);
                expressions(otherwise, visit);
            }
            Stmt::Loop(body) => expressions(body, visit),
            Stmt::Store { index, value, .. } => {
                expression(index, visit);
                expression(value, visit);
            }
            Stmt::Break | Stmt::Continue | Stmt::Return(None) | Stmt::Barrier => {}
        }
    }
}

fn expression(value: &Expr, visit: &mut dyn FnMut(&Expr)) {
    visit(value);
    match value {
        Expr::F32(_)
        | Expr::I32(_)
        | Expr::U32(_)
        | Expr::Bool(_)
        | Expr::Local(_)
        | Expr::Argument(_)
        | Expr::Uniform(_)
        | Expr::GlobalId
        | Expr::GroupId
        | Expr::LocalIndex
        | Expr::VertexIndex
        | Expr::InstanceIndex => {}
        Expr::Unary(_, a)
        | Expr::Splat(a, _)
        | Expr::Component(a, _)
        | Expr::Field(a, _)
        | Expr::Convert(_, a)
        | Expr::Bitcast(_, a)
        | Expr::TextureLoad(_, a)
        | Expr::Load(_, a) => expression(a, visit),
        Expr::Binary(_, a, b) => {
            expression(a, visit);
            expression(b, visit);
        }
        Expr::Math(_, list) | Expr::Compose(_, list) | Expr::Call(_, list) => {
            list.iter().for_each(|a| expression(a, visit));
        }
        Expr::Select(a, b, c) => [a, b, c].into_iter().for_each(|x| expression(x, visit)),
    }
}

fn stores(block: &[Stmt], visit: &mut dyn FnMut(u32)) {
    for statement in block {
        match statement {
            Stmt::Store { buffer, .. } => visit(*buffer),
            Stmt::If(_, then, otherwise) => {
                stores(then, visit);
                stores(otherwise, visit);
            }
            Stmt::Loop(body) => stores(body, visit),
            Stmt::Let(..) | Stmt::Var(..) | Stmt::Assign(..) | Stmt::Return(_) => {}
            Stmt::Break | Stmt::Continue | Stmt::Barrier => {}
        }
    }
}

/// Which functions of a kernel its entry point reaches.
#[must_use]
pub fn reached(kernel: &Kernel) -> Vec<bool> {
    let mut seen = vec![false; kernel.functions.len()];
    let mut stack: Vec<u32> = vec![];
    let calls = |body: &[Stmt], stack: &mut Vec<u32>| {
        expressions(body, &mut |e| {
            if let Expr::Call(FunctionId(id), _) = e {
                stack.push(*id);
            }
        });
    };
    calls(&kernel.entry.body, &mut stack);
    while let Some(id) = stack.pop() {
        if !std::mem::replace(&mut seen[id as usize], true) {
            calls(&kernel.functions[id as usize].body, &mut stack);
        }
    }
    seen
}

/// Which resources of a kernel something reads or writes.
#[must_use]
pub fn used_resources(kernel: &Kernel) -> Vec<bool> {
    let mut used = vec![false; kernel.resources.len()];
    let functions = kernel.functions.iter().zip(reached(kernel)).filter(|(_, r)| *r).map(|(f, _)| f);
    for function in functions.chain([&kernel.entry]) {
        let mut mark = |i: u32| used[i as usize] = true;
        stores(&function.body, &mut mark);
        expressions(&function.body, &mut |e| match e {
            Expr::TextureLoad(i, _) | Expr::Load(i, _) => mark(*i),
            Expr::Uniform(_) => {
                if let Some(i) = kernel.resources.iter().position(|r| matches!(r.kind, ResourceKind::Uniform(_))) {
                    mark(i as u32);
                }
            }
            _ => {}
        });
    }
    used
}

/// Which structs of a kernel its resources and the functions that are reached name.
#[must_use]
pub fn used_structs(kernel: &Kernel) -> Vec<bool> {
    let mut used = vec![false; kernel.structs.len()];
    let mut mark = |ty: Ty| {
        if let Ty::Struct(i) = ty {
            used[i as usize] = true;
        }
    };
    for (resource, _) in kernel.resources.iter().zip(used_resources(kernel)).filter(|(_, used)| *used) {
        match resource.kind {
            ResourceKind::Uniform(i) => mark(Ty::Struct(i)),
            ResourceKind::ReadBuffer(ty) | ResourceKind::WriteBuffer(ty) | ResourceKind::Workgroup(ty, _) => mark(ty),
            ResourceKind::Texture3d(_) | ResourceKind::Texture2d => {}
        }
    }
    let functions = kernel.functions.iter().zip(reached(kernel)).filter(|(_, r)| *r).map(|(f, _)| f);
    for function in functions.chain([&kernel.entry]) {
        function.parameters.iter().map(|p| p.1).chain(function.result).for_each(&mut mark);
        function.locals.iter().for_each(|l| mark(l.ty));
        expressions(&function.body, &mut |e| {
            if let Expr::Compose(ty, _) = e {
                mark(*ty);
            }
        });
    }
    used
}
