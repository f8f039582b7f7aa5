//! Tables in kernels, exact at every row: short constant ones as a ladder of comparisons, others by bisection of a buffer.
//! (See `Op::Lookup` for the meaning.)

use super::builder::{Code, KernelBuilder};
use crate::ir::{Graph, TableId};
use crate::program::kernel::{Expr, Function, Math, Prim, Ty};

/// Longest table that is written out as code.
const LADDER: usize = 12;

/// The rows, if all are constants that f32 can hold and there are few.
fn constant_rows(graph: &Graph, id: TableId) -> Option<Vec<(f64, Vec<f64>)>> {
    let table = graph.table(id);
    if table.keys.len() > LADDER {
        return None;
    }
    let rows = table.keys.iter().zip(&table.values).map(|(k, v)| {
        let (k, v) = (graph.constant(*k)?, graph.constant(*v)?);
        let fits = k.values().iter().chain(&v.values()).all(|x| (*x as f32).is_finite());
        fits.then(|| (k.get(0), v.values()))
    });
    rows.collect()
}

fn vector(values: &[f64]) -> Expr {
    if let [only] = values {
        return Expr::F32(*only);
    }
    Expr::Compose(Ty::float(values.len() as u8), values.iter().map(|v| Expr::F32(*v)).collect())
}

/// Within 0 to 1.
fn share(t: Expr) -> Expr {
    Expr::math(Math::Clamp, [t, Expr::F32(0.0), Expr::F32(1.0)])
}

pub(super) fn lookup(graph: &Graph, builder: &mut KernelBuilder, id: TableId) -> Function {
    let table = graph.table(id);
    let width = table.width;
    let ty = Ty::float(width);
    let mut code = Code::new(&table.name, table.span);
    let x = code.parameter("x", Ty::F32);
    if let Some(rows) = constant_rows(graph, id) {
        let mut previous: Option<&(f64, Vec<f64>)> = None;
        for row in &rows {
            let value = match previous {
                None => vector(&row.1),
                Some((k0, v0)) if row.0 > *k0 => {
                    // From the nearer row, so that both ends are met exactly and a large value next to a small one
                    // leaves no rounding behind.
                    // The keys as f32 holds them. A product that rounds up must not pass the upper row, nor a driver the lower
                    // one that makes the difference from other terms than the comparison.
                    let (low, high) = (f64::from(*k0 as f32), f64::from(row.0 as f32));
                    if high <= low {
                        previous = Some(row);
                        continue;
                    }
                    let t = share((x.clone() - *k0) * (1.0 / (high - low)));
                    let t = t.splat(width);
                    vector(v0) * (Expr::F32(1.0).splat(width) - t.clone()) + vector(&row.1) * t
                }
                Some(_) => {
                    previous = Some(row);
                    continue;
                }
            };
            code.if_(x.clone().less(row.0), |code| code.return_(value));
            previous = Some(row);
        }
        code.return_(vector(&rows.last().expect("a table has rows").1));
        return code.finish(Some(ty));
    }
    let buffer = builder.table(graph, id);
    let count = table.keys.len() as u32;
    let stride = u32::from(width) + 1;
    let key = |row: Expr| Expr::load(buffer, row * stride);
    let value = |row: Expr| {
        let parts = (0..u32::from(width)).map(|c| Expr::load(buffer, row.clone() * stride + (c + 1)));
        let parts: Vec<Expr> = parts.collect();
        if width == 1 { parts[0].clone() } else { Expr::Compose(ty, parts) }
    };
    let after = bisect(&mut code, &key, &x, count);
    code.if_(after.clone().equal(0u32), |code| code.return_(value(Expr::U32(0))));
    let before = code.bind("before", Ty::U32, after.clone() - 1u32);
    code.if_(after.clone().equal(count), |code| code.return_(value(before.clone())));
    let (k0, k1) = (key(before.clone()), key(after.clone()));
    let k0 = code.bind("k0", Ty::F32, k0);
    let t = code.bind("t", Ty::F32, share((x - k0.clone()) / (k1 - k0)));
    let t = t.splat(width);
    code.return_(value(before) * (Expr::F32(1.0).splat(width) - t.clone()) + value(after) * t);
    code.finish(Some(ty))
}

/// Number of rows whose key is ≤ x.
fn bisect(code: &mut Code, key: &dyn Fn(Expr) -> Expr, x: &Expr, count: u32) -> Expr {
    let low = code.var("low", Ty::U32, 0u32);
    let high = code.var("high", Ty::U32, count);
    code.loop_(|code| {
        code.break_if(Expr::Local(low).greater_equal(Expr::Local(high)));
        let half =
            Expr::binary(crate::program::kernel::BinaryOp::ShiftRight, Expr::Local(low) + Expr::Local(high), 1u32);
        let middle = code.bind("middle", Ty::U32, half);
        code.if_else(
            key(middle.clone()).less_equal(x.clone()),
            |code| code.set(low, middle.clone() + 1u32),
            |code| code.set(high, middle.clone()),
        );
    });
    code.bind("after", Ty::U32, low)
}

pub(super) fn slope(graph: &Graph, builder: &mut KernelBuilder, id: TableId) -> Function {
    let table = graph.table(id);
    let width = table.width;
    let ty = Ty::float(width);
    let mut code = Code::new(&format!("{}_slope", table.name), table.span);
    let x = code.parameter("x", Ty::F32);
    let zero = || Expr::F32(0.0).splat(width);
    if let Some(rows) = constant_rows(graph, id) {
        let mut previous: Option<&(f64, Vec<f64>)> = None;
        for row in &rows {
            let value = match previous {
                None => zero(),
                Some((k0, v0)) if row.0 > *k0 => {
                    let slopes: Vec<f64> = v0.iter().zip(&row.1).map(|(a, b)| (b - a) / (row.0 - k0)).collect();
                    vector(&slopes)
                }
                Some(_) => {
                    previous = Some(row);
                    continue;
                }
            };
            code.if_(x.clone().less(row.0), |code| code.return_(value));
            previous = Some(row);
        }
        code.return_(zero());
        return code.finish(Some(ty));
    }
    let buffer = builder.table(graph, id);
    let count = table.keys.len() as u32;
    let stride = u32::from(width) + 1;
    let at = |row: Expr, c: u32| Expr::load(buffer, row * stride + c);
    let after = bisect(&mut code, &|row| at(row, 0), &x, count);
    let ends = after.clone().equal(0u32).or(after.clone().equal(count));
    code.if_(ends, |code| code.return_(zero()));
    let before = code.bind("before", Ty::U32, after.clone() - 1u32);
    let span = code.bind("span", Ty::F32, at(after.clone(), 0) - at(before.clone(), 0));
    let parts = (1..=u32::from(width)).map(|c| (at(after.clone(), c) - at(before.clone(), c)) / span.clone());
    let parts: Vec<Expr> = parts.collect();
    code.return_(if width == 1 { parts[0].clone() } else { Expr::Compose(Ty::Value(Prim::F32, width), parts) });
    code.finish(Some(ty))
}
