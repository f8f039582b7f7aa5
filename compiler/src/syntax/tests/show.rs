//! The tree without its spans, as text: what two readings must agree on.

use crate::syntax::ast::{
    BinaryOp, Expr, ExprKind, Item, ItemKind, Module, ModulePath, Name, ReduceOp, Row, TypeExpr, TypeExprKind, UnaryOp,
};

pub(super) fn module(module: &Module) -> String {
    let mut out = format!("docs {:?}\n", module.docs);
    for it in &module.items {
        out.push_str(&item(it));
        out.push('\n');
    }
    out
}

fn names(names: &[Name]) -> String {
    names.iter().map(|n| n.text.as_str()).collect::<Vec<_>>().join(" ")
}

pub(super) fn item(item: &Item) -> String {
    let docs = item.docs.as_ref().map_or(String::new(), |d| format!("{d:?} "));
    let kind = match &item.kind {
        ItemKind::Use(u) => {
            let module = match &u.module {
                ModulePath::Library(path) => names(path),
                ModulePath::File { path, .. } => format!("{path:?}"),
            };
            format!("use {module}: {}", names(&u.names))
        }
        ItemKind::Const { name, value } => format!("const {} {}", name.text, expr(value)),
        ItemKind::Param { name, default, range } => {
            let range = range.as_ref().map_or(String::new(), |(a, b)| format!(" {}..{}", expr(a), expr(b)));
            format!("param {} {}{range}", name.text, expr(default))
        }
        ItemKind::Function(f) => {
            let parameters: Vec<_> = f
                .parameters
                .iter()
                .map(|p| {
                    let default = p.default.as_ref().map_or(String::new(), |d| format!(" = {}", expr(d)));
                    format!("{}: {}{default}", p.name.text, ty(&p.ty))
                })
                .collect();
            format!("fn {}({}) -> {} = {}", f.name.text, parameters.join(", "), ty(&f.result), expr(&f.body))
        }
        ItemKind::Table { name, rows: r } => format!("table {} {}", name.text, rows(r)),
        ItemKind::Transfer { name, rows: r } => format!("transfer {} {}", name.text, rows(r)),
        ItemKind::Block(b) => {
            let properties: Vec<_> =
                b.properties.iter().map(|p| format!(" [{} {}]", p.name.text, expr(&p.value))).collect();
            let name = b.name.as_ref().map_or("-", |n| &n.text);
            format!("{} {name}{}", b.kind.word(), properties.concat())
        }
    };
    docs + &kind
}

fn rows(rows: &[Row]) -> String {
    rows.iter().map(|r| format!("[{}: {}]", expr(&r.key), list(&r.values))).collect::<Vec<_>>().join(" ")
}

fn ty(t: &TypeExpr) -> String {
    match &t.kind {
        TypeExprKind::Named { name, of: None } => name.text.clone(),
        TypeExprKind::Named { name, of: Some(of) } => format!("{}<{}>", name.text, ty(of)),
        TypeExprKind::One => "1".to_owned(),
        TypeExprKind::Product(a, b) => format!("(* {} {})", ty(a), ty(b)),
        TypeExprKind::Quotient(a, b) => format!("(/ {} {})", ty(a), ty(b)),
        TypeExprKind::Power(a, n) => format!("(^ {} {n})", ty(a)),
    }
}

fn list(list: &[Expr]) -> String {
    list.iter().map(expr).collect::<Vec<_>>().join(" ")
}

pub(super) fn expr(e: &Expr) -> String {
    match &e.kind {
        ExprKind::Number(n) => n.to_string(),
        ExprKind::Size(w, h) => format!("{w}x{h}"),
        ExprKind::String(s) => format!("{s:?}"),
        ExprKind::Color(c) => format!("#{:02x}{:02x}{:02x}{:02x}", c[0], c[1], c[2], c[3]),
        ExprKind::Bool(b) => b.to_string(),
        ExprKind::Name(n) => n.clone(),
        ExprKind::Quantity { value, unit, power: 1 } => format!("{}'{}", expr(value), unit.text),
        ExprKind::Quantity { value, unit, power } => format!("{}'{}^{power}", expr(value), unit.text),
        ExprKind::Tuple(parts) => format!("<{}>", list(parts)),
        ExprKind::List(parts) => format!("[{}]", list(parts)),
        ExprKind::Unary { op, operand } => {
            let op = match op {
                UnaryOp::Negate => "neg",
                UnaryOp::Not => "not",
            };
            format!("({op} {})", expr(operand))
        }
        ExprKind::Binary { op, left, right, .. } => format!("({} {} {})", sign(*op), expr(left), expr(right)),
        ExprKind::If { condition, accept, reject } => {
            format!("(if {} {} {})", expr(condition), expr(accept), expr(reject))
        }
        ExprKind::Block { lets, last } => {
            let lets: Vec<_> = lets.iter().map(|(n, v)| format!("{}={} ", n.text, expr(v))).collect();
            format!("{{{}{}}}", lets.concat(), expr(last))
        }
        ExprKind::Reduce { op, variable, start, end, body } => {
            let op = match op {
                ReduceOp::Sum => "sum",
                ReduceOp::Product => "product",
                ReduceOp::Max => "max",
                ReduceOp::Min => "min",
            };
            format!("({op} {} {}..{} {})", variable.text, expr(start), expr(end), expr(body))
        }
        ExprKind::Call { function, arguments } => {
            let arguments: Vec<_> = arguments
                .iter()
                .map(|a| a.name.as_ref().map_or(String::new(), |n| format!("{}:", n.text)) + &expr(&a.value))
                .collect();
            format!("{}({})", function.text, arguments.join(", "))
        }
        ExprKind::Member { object, field } => format!("{}.{}", expr(object), field.text),
    }
}

fn sign(op: BinaryOp) -> &'static str {
    match op {
        BinaryOp::Or => "||",
        BinaryOp::And => "&&",
        BinaryOp::Equal => "==",
        BinaryOp::NotEqual => "!=",
        BinaryOp::Less => "<",
        BinaryOp::LessEqual => "<=",
        BinaryOp::Greater => ">",
        BinaryOp::GreaterEqual => ">=",
        BinaryOp::Add => "+",
        BinaryOp::Subtract => "-",
        BinaryOp::Multiply => "*",
        BinaryOp::Divide => "/",
        BinaryOp::Power => "^",
    }
}
