//! Algebraic simplification. No finite value changes by more than 2 units in the last place of f64;
//! a value that was not finite may become finite (`0 · ∞` becomes 0), never the other way round.
//!
//! | rule | change |
//! |---|---|
//! | x+0, x−0, x·1, x/1, x·0, 0/x, −(−x), x−x, x^0, x^1, min(x,x), `if true` … | none |
//! | (x·a)·b → x·(a·b), (x+a)+b → x+(a+b), (x/a)·b → x·(b/a) for constants a, b | 2 ulp |
//! | pow(x, n) → powi(x, n) for whole |n| ≤ 64 | 1 ulp |
//! | 1 ∓ cos θ → versine, vercosine | removes a cancellation |
//! | 1 − exp(x) → −expm1(x), exp(x) − 1 → expm1(x) | removes a cancellation |
//! | dot(c, v) with one component of c not 0 → c_i·v_i | none |

use super::vector::splat_of;
use crate::ir::{Binary, Compare, Graph, Input, NodeId, Op, Unary};

fn number(graph: &Graph, id: NodeId) -> Option<f64> {
    graph.number(id)
}

fn unary(graph: &mut Graph, op: Unary, a: NodeId) -> NodeId {
    super::push(graph, Op::Unary(op, a))
}

fn binary(graph: &mut Graph, op: Binary, a: NodeId, b: NodeId) -> NodeId {
    super::push(graph, Op::Binary(op, a, b))
}

/// 1 − μ, or 1 + μ if `plus`, where μ is ± the cosine of the scattering angle, or that times a sign.
fn versine(graph: &mut Graph, mu: NodeId, plus: bool) -> Option<NodeId> {
    match *graph.op(mu) {
        Op::Input(Input::CosTheta) => Some(graph.input(if plus { Input::Vercosine } else { Input::Versine })),
        Op::Unary(Unary::Neg, a) => versine(graph, a, !plus),
        Op::Binary(Binary::Mul, a, b) => {
            let (sign, cosine) = match (*graph.op(a), *graph.op(b)) {
                (Op::Unary(Unary::Sign, _), _) => (a, b),
                (_, Op::Unary(Unary::Sign, _)) => (b, a),
                _ => return None,
            };
            let (along, against) = (versine(graph, cosine, plus)?, versine(graph, cosine, !plus)?);
            let (zero, one) = (graph.scalar(0.0), graph.scalar(1.0));
            let below = super::push(graph, Op::Compare(Compare::Less, sign, zero));
            let above = super::push(graph, Op::Compare(Compare::Less, zero, sign));
            let rest = super::push(graph, Op::Select { condition: below, accept: against, reject: one });
            Some(super::push(graph, Op::Select { condition: above, accept: along, reject: rest }))
        }
        _ => None,
    }
}

/// The operands of a binary node with the constant one last, for commutative operations.
fn constant_last(graph: &Graph, op: Binary, id: NodeId) -> Option<(NodeId, NodeId)> {
    match *graph.op(id) {
        Op::Binary(found, a, b) if found == op => {
            if graph.constant(b).is_some() {
                Some((a, b))
            } else if graph.constant(a).is_some() {
                Some((b, a))
            } else {
                None
            }
        }
        _ => None,
    }
}

pub(super) fn rule(graph: &mut Graph, op: &Op) -> Option<NodeId> {
    match *op {
        Op::Unary(Unary::Neg | Unary::Not, a) => match (*graph.op(a), op) {
            (Op::Unary(inner @ (Unary::Neg | Unary::Not), x), Op::Unary(outer, _)) if inner == *outer => Some(x),
            _ => None,
        },
        Op::Unary(Unary::Abs, a) => match *graph.op(a) {
            Op::Unary(Unary::Abs | Unary::Exp | Unary::Sqrt, _) => Some(a),
            Op::Unary(Unary::Neg, x) => Some(unary(graph, Unary::Abs, x)),
            _ => None,
        },
        Op::PowI(_, 0) => {
            let Op::PowI(a, _) = *op else { return None };
            let width = graph.width(a);
            let one = graph.vector(&vec![1.0; width as usize]);
            Some(one)
        }
        Op::PowI(a, 1) => Some(a),
        Op::Binary(b, x, y) => binary_rule(graph, b, x, y),
        Op::Select { condition, accept, reject } => {
            if accept == reject {
                return Some(accept);
            }
            match *graph.op(condition) {
                Op::Truth(true) => Some(accept),
                Op::Truth(false) => Some(reject),
                Op::Unary(Unary::Not, c) => {
                    Some(super::push(graph, Op::Select { condition: c, accept: reject, reject: accept }))
                }
                _ => None,
            }
        }
        Op::Dot(a, b) => {
            let (c, v) = match (graph.constant(a), graph.constant(b)) {
                (Some(c), None) => (c, b),
                (None, Some(c)) => (c, a),
                _ => return None,
            };
            let mut nonzero = (0..c.width()).filter(|i| c.get(*i as usize) != 0.0);
            let (first, more) = (nonzero.next(), nonzero.next());
            match (first, more) {
                (None, _) => Some(graph.scalar(0.0)),
                (Some(i), None) => {
                    let part = super::push(graph, Op::Extract(v, i));
                    let factor = graph.scalar(c.get(i as usize));
                    Some(binary(graph, Binary::Mul, part, factor))
                }
                _ => None,
            }
        }
        _ => None,
    }
}

fn binary_rule(graph: &mut Graph, op: Binary, x: NodeId, y: NodeId) -> Option<NodeId> {
    let (nx, ny) = (number(graph, x), number(graph, y));
    let zero = |graph: &mut Graph| {
        let width = graph.width(x) as usize;
        graph.vector(&vec![0.0; width])
    };
    match op {
        Binary::Add => match (nx, ny) {
            (Some(0.0), _) => Some(y),
            (_, Some(0.0)) => Some(x),
            (Some(1.0), _) if versine(graph, y, true).is_some() => versine(graph, y, true),
            (_, Some(1.0)) if versine(graph, x, true).is_some() => versine(graph, x, true),
            _ => reassociate(graph, op, x, y),
        },
        Binary::Sub => match (nx, ny) {
            (_, Some(0.0)) => Some(x),
            (Some(0.0), _) => Some(unary(graph, Unary::Neg, y)),
            _ if x == y => Some(zero(graph)),
            (Some(1.0), _) if graph.width(y) == 1 && versine(graph, y, false).is_some() => versine(graph, y, false),
            (Some(1.0), _) => match *graph.op(y) {
                Op::Unary(Unary::Exp, a) => {
                    let m = unary(graph, Unary::Expm1, a);
                    Some(unary(graph, Unary::Neg, m))
                }
                _ => None,
            },
            (_, Some(1.0)) => match *graph.op(x) {
                Op::Unary(Unary::Exp, a) => Some(unary(graph, Unary::Expm1, a)),
                _ => None,
            },
            _ => None,
        },
        Binary::Mul => match (nx, ny) {
            (Some(0.0), _) | (_, Some(0.0)) => Some(zero(graph)),
            (Some(1.0), _) => Some(y),
            (_, Some(1.0)) => Some(x),
            (Some(-1.0), _) => Some(unary(graph, Unary::Neg, y)),
            (_, Some(-1.0)) => Some(unary(graph, Unary::Neg, x)),
            _ => reassociate(graph, op, x, y),
        },
        Binary::Div => match (nx, ny) {
            (_, Some(1.0)) => Some(x),
            (Some(0.0), _) => Some(zero(graph)),
            // Division by a constant becomes a multiplication where that is exact.
            (_, Some(c)) if c.is_normal() && is_power_of_two(c) && (1.0 / c).is_normal() => {
                let width = graph.width(y) as usize;
                let factor = graph.vector(&vec![1.0 / c; width]);
                Some(binary(graph, Binary::Mul, x, factor))
            }
            _ => None,
        },
        Binary::Min | Binary::Max if x == y => Some(x),
        Binary::And | Binary::Or => {
            let absorbing = op == Binary::Or;
            match (*graph.op(x), *graph.op(y)) {
                (Op::Truth(t), _) => Some(if t == absorbing { x } else { y }),
                (_, Op::Truth(t)) => Some(if t == absorbing { y } else { x }),
                _ if x == y => Some(x),
                _ => None,
            }
        }
        Binary::Pow => {
            let n = ny?;
            (n.fract() == 0.0 && n.abs() <= 64.0).then(|| super::push(graph, Op::PowI(x, n as i32)))
        }
        Binary::Min | Binary::Max | Binary::Atan2 | Binary::Mod => None,
    }
}

fn is_power_of_two(c: f64) -> bool {
    c.to_bits() & ((1 << 52) - 1) == 0
}

/// (x·a)·b → x·(a·b) and (x+a)+b → x+(a+b); also pulls the splat of a scalar out of a vector product last,
/// so that scalar factors meet: (v·s)·t → v·(s·t).
fn reassociate(graph: &mut Graph, op: Binary, x: NodeId, y: NodeId) -> Option<NodeId> {
    let (rest, outer) = if graph.constant(y).is_some() {
        (x, y)
    } else if graph.constant(x).is_some() {
        (y, x)
    } else {
        return gather_scalars(graph, op, x, y);
    };
    if let Some((inner_rest, inner)) = constant_last(graph, op, rest) {
        let both = binary(graph, op, inner, outer);
        // Folding fails when the product overflows; then the order of evaluation matters and stays.
        return graph.constant(both).map(|_| binary(graph, op, inner_rest, both));
    }
    None
}

/// (v·splat s)·splat t → v·splat(s·t): scalar work stays scalar.
fn gather_scalars(graph: &mut Graph, op: Binary, x: NodeId, y: NodeId) -> Option<NodeId> {
    if op != Binary::Mul || graph.width(x) == 1 {
        return None;
    }
    let width = graph.width(x);
    let (vector, t) = match (splat_of(graph, x), splat_of(graph, y)) {
        (None, Some(t)) => (x, t),
        (Some(t), None) => (y, t),
        _ => return None,
    };
    let Op::Binary(Binary::Mul, a, b) = *graph.op(vector) else { return None };
    let (inner, s) = match (splat_of(graph, a), splat_of(graph, b)) {
        (None, Some(s)) => (a, s),
        (Some(s), None) => (b, s),
        _ => return None,
    };
    let both = binary(graph, Binary::Mul, s, t);
    let both = super::push(graph, Op::Splat(both, width));
    Some(binary(graph, Binary::Mul, inner, both))
}
