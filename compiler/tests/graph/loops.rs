//! Loops: folding, nesting, shadowing, and what is computed outside of them.

use crate::at;
use compiler::ir::{Fold, Graph, Input, NodeId, Op, Step, schedule, verify};
use proptest::prelude::*;

fn variable(g: &mut Graph, depth: u8) -> NodeId {
    g.push(Op::LoopVar(depth))
}

fn value(g: &Graph, node: NodeId) -> f64 {
    verify(g, &[node]).expect("a well-formed graph");
    at(g, node, [2.0, 3.0, 5.0])[0]
}

#[test]
fn each_fold() {
    let mut g = Graph::default();
    let i = variable(&mut g, 0);
    let one = g.scalar(1.0);
    let body = g.add(i, one);
    let folds = [Fold::Sum, Fold::Product, Fold::Min, Fold::Max].map(|f| g.reduce(f, 0, 1..5, body));
    assert_eq!(folds.map(|f| value(&g, f)), [2.0 + 3.0 + 4.0 + 5.0, 120.0, 2.0, 5.0]);
    let empty = [Fold::Sum, Fold::Product, Fold::Min, Fold::Max].map(|f| g.reduce(f, 0, 3..3, body));
    assert_eq!(empty.map(|f| value(&g, f)), [0.0, 1.0, f64::INFINITY, f64::NEG_INFINITY]);
    let negative = g.reduce(Fold::Sum, 0, -2..2, i);
    assert_eq!(value(&g, negative), -2.0);
}

/// What depends on the inner variable alone stays inside the inner loop.
#[test]
fn an_inner_loop_keeps_what_only_it_needs() {
    let mut g = Graph::default();
    let (i, j) = (variable(&mut g, 0), variable(&mut g, 1));
    let square = g.mul(j, j);
    let body = g.mul(i, square);
    let inner = g.reduce(Fold::Sum, 1, 0..4, body);
    let outer = g.reduce(Fold::Sum, 0, 0..3, inner);
    assert_eq!(value(&g, outer), (0.0 + 1.0 + 2.0) * (0.0 + 1.0 + 4.0 + 9.0));
}

#[test]
fn an_inner_loop_of_the_same_depth_shadows() {
    let mut g = Graph::default();
    let i = variable(&mut g, 0);
    let inner = g.reduce(Fold::Sum, 0, 0..4, i); // 6, closed
    let body = g.mul(inner, i);
    let outer = g.reduce(Fold::Sum, 0, 0..3, body);
    assert_eq!(value(&g, outer), 6.0 * 3.0);
    // The same body inside and outside of the inner loop.
    let square = g.mul(i, i);
    let inner = g.reduce(Fold::Sum, 0, 0..4, square); // 14
    let body = g.add(inner, square);
    let outer = g.reduce(Fold::Sum, 0, 0..3, body);
    assert_eq!(value(&g, outer), 3.0 * 14.0 + 5.0);
}

#[test]
fn a_closed_loop_within_another_that_uses_both_variables() {
    let mut g = Graph::default();
    let (i, j) = (variable(&mut g, 0), variable(&mut g, 1));
    let product = g.mul(i, j);
    let inner = g.reduce(Fold::Max, 1, 0..5, product); // 4 i
    let sum = g.add(inner, i); // 5 i
    let outer = g.reduce(Fold::Sum, 0, 0..4, sum);
    let twice = g.reduce(Fold::Sum, 1, 0..5, j); // 10, at the depth of the inner loop
    let total = g.mul(outer, twice);
    assert_eq!(value(&g, total), 30.0 * 10.0);
}

fn nodes(steps: &[Step]) -> Vec<NodeId> {
    steps.iter().filter_map(|s| if let Step::Node(n) = s { Some(*n) } else { None }).collect()
}

fn loops(steps: &[Step]) -> Vec<(NodeId, &[Step])> {
    steps
        .iter()
        .filter_map(|s| if let Step::Loop(n, inner) = s { Some((*n, inner.as_slice())) } else { None })
        .collect()
}

#[test]
fn what_does_not_vary_is_computed_before_the_loop() {
    let mut g = Graph::default();
    let p = g.input(Input::Position);
    let x = g.extract(p, 0);
    let heavy = g.unary(compiler::ir::Unary::Exp, x);
    let (i, j) = (variable(&mut g, 0), variable(&mut g, 1));
    let row = g.mul(heavy, i);
    let body = g.mul(row, j);
    let inner = g.reduce(Fold::Sum, 1, 0..3, body);
    let outer = g.reduce(Fold::Sum, 0, 0..2, inner);
    let steps = schedule(&g, &[outer]);
    assert!(nodes(&steps).contains(&heavy), "exp(p.x) stands before both loops");
    let [(id, first)] = loops(&steps)[..] else { panic!("one outer loop") };
    assert_eq!(id, outer);
    assert!(nodes(first).contains(&row), "row · i stands before the inner loop");
    let [(id, second)] = loops(first)[..] else { panic!("one inner loop") };
    assert_eq!(id, inner);
    assert_eq!(nodes(second).into_iter().filter(|n| *n != j).collect::<Vec<_>>(), [body]);
    assert_eq!(value(&g, outer), 2f64.exp() * 1.0 * 3.0);
}

/// A random nest of loops as a tree, evaluated by walking it.
#[derive(Clone, Debug)]
enum Tree {
    Number(i32),
    /// The variable of the loop so many levels up; 0 if there is none.
    Variable(u8),
    Add(Box<Tree>, Box<Tree>),
    Mul(Box<Tree>, Box<Tree>),
    Loop(Fold, i32, i32, Box<Tree>),
    /// A loop at depth 0 whatever surrounds it, over a body that sees only its own variable.
    Closed(i32, Box<Tree>),
}

impl Tree {
    fn build(&self, g: &mut Graph, depth: u8) -> NodeId {
        match self {
            Self::Number(v) => g.scalar(f64::from(*v)),
            Self::Variable(up) if *up < depth => g.push(Op::LoopVar(depth - 1 - up)),
            Self::Variable(_) => g.scalar(0.0),
            Self::Add(a, b) | Self::Mul(a, b) => {
                let (x, y) = (a.build(g, depth), b.build(g, depth));
                if matches!(self, Self::Add(..)) { g.add(x, y) } else { g.mul(x, y) }
            }
            Self::Loop(fold, start, trips, body) => {
                let body = body.build(g, depth + 1);
                g.reduce(*fold, depth, *start..start + trips, body)
            }
            Self::Closed(trips, body) => {
                let body = body.build(g, 1);
                g.reduce(Fold::Sum, 0, 0..*trips, body)
            }
        }
    }

    fn walk(&self, stack: &mut Vec<f64>) -> f64 {
        match self {
            Self::Number(v) => f64::from(*v),
            Self::Variable(up) => stack.iter().rev().nth(*up as usize).copied().unwrap_or(0.0),
            Self::Add(a, b) => a.walk(stack) + b.walk(stack),
            Self::Mul(a, b) => a.walk(stack) * b.walk(stack),
            Self::Loop(fold, start, trips, body) => {
                let mut total = match fold {
                    Fold::Sum => 0.0,
                    Fold::Product => 1.0,
                    Fold::Min => f64::INFINITY,
                    Fold::Max => f64::NEG_INFINITY,
                };
                for i in *start..start + trips {
                    stack.push(f64::from(i));
                    let v = body.walk(stack);
                    stack.pop();
                    total = match fold {
                        Fold::Sum => total + v,
                        Fold::Product => total * v,
                        Fold::Min => total.min(v),
                        Fold::Max => total.max(v),
                    };
                }
                total
            }
            Self::Closed(trips, body) => (0..*trips).map(|i| body.walk(&mut vec![f64::from(i)])).sum(),
        }
    }
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![(-3i32..4).prop_map(Tree::Number), (0u8..4).prop_map(Tree::Variable)];
    leaf.prop_recursive(6, 40, 3, |inner| {
        let fold = prop_oneof![Just(Fold::Sum), Just(Fold::Product), Just(Fold::Min), Just(Fold::Max)];
        prop_oneof![
            (inner.clone(), inner.clone()).prop_map(|(a, b)| Tree::Add(Box::new(a), Box::new(b))),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| Tree::Mul(Box::new(a), Box::new(b))),
            (fold, -2i32..2, 1i32..4, inner.clone()).prop_map(|(f, s, n, b)| Tree::Loop(f, s, n, Box::new(b))),
            (1i32..4, inner).prop_map(|(n, b)| Tree::Closed(n, Box::new(b))),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]
    #[test]
    fn any_nest_of_loops_agrees_with_a_walk_of_its_tree(tree in tree()) {
        let mut g = Graph::default();
        let node = tree.build(&mut g, 0);
        let (got, expected) = (value(&g, node), tree.walk(&mut vec![]));
        // Products of such nests may overflow; both sides do then.
        prop_assert!(got == expected || (got.is_nan() && expected.is_nan())
            || (got - expected).abs() <= 1e-12 * expected.abs(), "{got} against {expected}");
    }
}
