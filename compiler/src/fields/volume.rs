//! Grids in kernels: interpolation by hand in f32 over whole texels, so that no sampler's few-bit weights come in
//! (see `Op::Sample` for the meaning).

use super::builder::{Code, KernelBuilder};
use crate::ir::{Filter, Graph, GridId};
use crate::program::kernel::{Expr, Function, Math, Prim, Ty};

const INT3: Ty = Ty::Value(Prim::I32, 3);

/// What both functions begin with.
struct Site {
    /// Position clamped to the sample centres, vec3.
    at: Expr,
    /// Whether each component lies strictly between the first and last centre: 1 or 0, vec3. For gradients only.
    inside: Option<Expr>,
    dims: [u32; 3],
}

fn three(values: [f64; 3]) -> Expr {
    Expr::Compose(Ty::VEC3, values.map(Expr::F32).into())
}

fn three_ints(values: [i32; 3]) -> Expr {
    Expr::Compose(INT3, values.map(Expr::I32).into())
}

fn enter(code: &mut Code, graph: &Graph, grid: GridId, outside: Expr, gradient: bool) -> Site {
    let dims = graph.grid(grid).header.dims;
    let at = code.parameter("at", Ty::VEC3);
    let last = dims.map(|n| f64::from(n) - 1.0);
    let centre = last.map(|l| 0.5 * l);
    let half = dims.map(|n| 0.5 * f64::from(n));
    let beyond = code.bind("beyond", Ty::VEC3, (at.clone() - three(centre)).abs() - three(half));
    let most = beyond.clone().component(0).max(beyond.clone().component(1)).max(beyond.component(2));
    code.if_(most.greater(0.0), |code| code.return_(outside));
    let clamped = Expr::math(Math::Clamp, [at.clone(), Expr::F32(0.0).splat(3), three(last)]);
    let clamped = code.bind("clamped", Ty::VEC3, clamped);
    let inside = gradient.then(|| {
        // Where clamping changed nothing and the point is not on the rim itself.
        let parts = (0..3u8).map(|i| {
            let x = at.clone().component(i);
            x.clone().greater(0.0).and(x.less(last[i as usize])).select(1.0, 0.0)
        });
        Expr::Compose(Ty::VEC3, parts.collect())
    });
    Site { at: clamped, inside, dims }
}

/// A stored value at whole indices, converted to f32 (not yet scaled).
fn fetch(texture: u32, at: Expr) -> Expr {
    Expr::texture_load(texture, at).component(0).convert(Prim::F32)
}

fn scaled(graph: &Graph, grid: GridId, stored: Expr) -> Expr {
    let header = &graph.grid(grid).header;
    match (header.slope == 1.0, header.intercept == 0.0) {
        (true, true) => stored,
        (false, true) => stored * header.slope,
        (true, false) => stored + header.intercept,
        (false, false) => stored * header.slope + header.intercept,
    }
}

/// The cell's lower corner, upper corner (both vec3 of i32) and position in it (vec3).
fn cell(code: &mut Code, site: &Site) -> (Expr, Expr, Expr) {
    let top = site.dims.map(|n| f64::from(n.saturating_sub(2)));
    let floor = Expr::math(Math::Floor, [site.at.clone()]);
    let base = code.bind("base", Ty::VEC3, floor.min(three(top)));
    let f = code.bind("f", Ty::VEC3, site.at.clone() - base.clone());
    let low = code.bind("low", INT3, base.convert(Prim::I32));
    let last = three_ints(site.dims.map(|n| n as i32 - 1));
    let high = code.bind("high", INT3, (low.clone() + Expr::I32(1).splat(3)).min(last));
    (low, high, f)
}

/// The eight corners of a cell, x fastest.
fn corners(code: &mut Code, texture: u32, low: &Expr, high: &Expr) -> Vec<Expr> {
    let mut values = vec![];
    for z in 0..2 {
        for y in 0..2 {
            for x in 0..2 {
                let pick = |i: u8, up: i32| if up == 1 { high.clone() } else { low.clone() }.component(i);
                let at = Expr::Compose(INT3, vec![pick(0, x), pick(1, y), pick(2, z)]);
                values.push(code.bind(&format!("v{x}{y}{z}"), Ty::F32, fetch(texture, at)));
            }
        }
    }
    values
}

fn mix(a: Expr, b: Expr, t: Expr) -> Expr {
    a.clone() + (b - a) * t
}

pub(super) fn sample(graph: &Graph, builder: &mut KernelBuilder, grid: GridId) -> Function {
    let info = graph.grid(grid);
    let texture = builder.grid(graph, grid);
    let mut code = Code::new(&info.name, info.span);
    let site = enter(&mut code, graph, grid, Expr::F32(info.outside), false);
    let stored = match info.filter {
        Filter::Nearest => {
            let last = three_ints(site.dims.map(|n| n as i32 - 1));
            let nearest = Expr::math(Math::Floor, [site.at + Expr::F32(0.5).splat(3)]).convert(Prim::I32);
            fetch(texture, nearest.min(last))
        }
        Filter::Linear => {
            let (low, high, f) = cell(&mut code, &site);
            let v = corners(&mut code, texture, &low, &high);
            let along = |code: &mut Code, name: &str, a: &Expr, b: &Expr, axis: u8| {
                code.bind(name, Ty::F32, mix(a.clone(), b.clone(), f.clone().component(axis)))
            };
            let x = ["x00", "x10", "x01", "x11"];
            let rows: Vec<Expr> = (0..4).map(|i| along(&mut code, x[i], &v[2 * i], &v[2 * i + 1], 0)).collect();
            let y0 = along(&mut code, "y0", &rows[0], &rows[1], 1);
            let y1 = along(&mut code, "y1", &rows[2], &rows[3], 1);
            mix(y0, y1, f.component(2))
        }
        Filter::Cubic => cubic(&mut code, texture, &site, None),
    };
    code.return_(scaled(graph, grid, stored));
    code.finish(Some(Ty::F32))
}

pub(super) fn gradient(graph: &Graph, builder: &mut KernelBuilder, grid: GridId) -> Function {
    let info = graph.grid(grid);
    let texture = builder.grid(graph, grid);
    let mut code = Code::new(&format!("{}_gradient", info.name), info.span);
    let site = enter(&mut code, graph, grid, Expr::F32(0.0).splat(3), true);
    let inside = site.inside.clone().expect("asked for");
    let slope = Expr::F32(info.header.slope).splat(3);
    let stored = match info.filter {
        Filter::Nearest => Expr::F32(0.0).splat(3),
        Filter::Linear => {
            let (low, high, f) = cell(&mut code, &site);
            let v = corners(&mut code, texture, &low, &high);
            let [x, y, z] = [0, 1, 2].map(|i| f.clone().component(i));
            let d = |a: usize, b: usize| v[b].clone() - v[a].clone();
            // Differences along one axis, interpolated along the two others.
            let plane = |d00: Expr, d10: Expr, d01: Expr, d11: Expr, s: &Expr, t: &Expr| {
                mix(mix(d00, d10, s.clone()), mix(d01, d11, s.clone()), t.clone())
            };
            let gx = plane(d(0, 1), d(2, 3), d(4, 5), d(6, 7), &y, &z);
            let gy = plane(d(0, 2), d(1, 3), d(4, 6), d(5, 7), &x, &z);
            let gz = plane(d(0, 4), d(1, 5), d(2, 6), d(3, 7), &x, &y);
            Expr::Compose(Ty::VEC3, vec![gx, gy, gz])
        }
        Filter::Cubic => {
            let parts = (0..3).map(|axis| cubic(&mut code, texture, &site, Some(axis))).collect();
            Expr::Compose(Ty::VEC3, parts)
        }
    };
    code.return_(stored * inside * slope);
    code.finish(Some(Ty::VEC3))
}

/// Catmull–Rom over 4×4×4 voxels; with an axis, the derivative along it.
fn cubic(code: &mut Code, texture: u32, site: &Site, derivative: Option<u8>) -> Expr {
    let (low, _, f) = cell(code, site);
    let last = site.dims.map(|n| n as i32 - 1);
    let weights = |code: &mut Code, axis: u8| -> Vec<Expr> {
        let t = f.clone().component(axis);
        let n = |x: f64| Expr::F32(x);
        let polynomials = if derivative == Some(axis) {
            [
                n(0.5) * ((n(4.0) - n(3.0) * t.clone()) * t.clone() - n(1.0)),
                n(0.5) * t.clone() * (n(9.0) * t.clone() - n(10.0)),
                n(0.5) * ((n(8.0) - n(9.0) * t.clone()) * t.clone() + n(1.0)),
                n(0.5) * t.clone() * (n(3.0) * t - n(2.0)),
            ]
        } else {
            [
                n(0.5) * t.clone() * ((n(2.0) - t.clone()) * t.clone() - n(1.0)),
                n(0.5) * (t.clone() * t.clone() * (n(3.0) * t.clone() - n(5.0)) + n(2.0)),
                n(0.5) * t.clone() * ((n(4.0) - n(3.0) * t.clone()) * t.clone() + n(1.0)),
                n(0.5) * (t.clone() - n(1.0)) * t.clone() * t,
            ]
        };
        let axis = ["x", "y", "z"][axis as usize];
        polynomials.into_iter().enumerate().map(|(i, w)| code.bind(&format!("w{axis}{i}"), Ty::F32, w)).collect()
    };
    let [wx, wy, wz] = [0, 1, 2].map(|axis| weights(code, axis));
    let index = |code: &mut Code, axis: u8| -> Vec<Expr> {
        let low = low.clone().component(axis);
        let clamp = |x: Expr| x.max(Expr::I32(0)).min(Expr::I32(last[axis as usize]));
        let axis = ["x", "y", "z"][axis as usize];
        (-1..3).map(|k| code.bind(&format!("i{axis}{}", k + 1), Ty::I32, clamp(low.clone() + Expr::I32(k)))).collect()
    };
    let [ix, iy, iz] = [0, 1, 2].map(|axis| index(code, axis));
    let total = code.var("total", Ty::F32, 0.0);
    for k in 0..4 {
        for j in 0..4 {
            let mut row = Expr::F32(0.0);
            for i in 0..4 {
                let at = Expr::Compose(INT3, vec![ix[i].clone(), iy[j].clone(), iz[k].clone()]);
                row = row + wx[i].clone() * fetch(texture, at);
            }
            code.add(total, row * (wy[j].clone() * wz[k].clone()));
        }
    }
    total.into()
}
