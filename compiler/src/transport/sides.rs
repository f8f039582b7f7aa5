//! Where a step crosses a curved surface on which a field jumps: found by bisection, so that the step ends there.

use super::shapes::Ray;
use super::trace::Tracer;
use crate::analysis::jumps::Curved;
use crate::fields::{Code, FieldFunction, field_function};
use crate::ir::{NodeId, Tier};
use crate::program::kernel::{BinaryOp, Expr, LocalId, Math, Ty};

/// Rounds of a bisection: to a millionth of a step.
const ROUNDS: f64 = 20.0;

/// The arguments of all curved jumps as a function of the position, on one ray.
pub(super) struct Sides {
    function: FieldFunction,
    hoisted: Vec<Expr>,
    every_whole: Vec<bool>,
}

impl Tracer<'_> {
    /// The curved jumps of all media, if there are any.
    pub(super) fn sides(&mut self, code: &mut Code, ray: &Ray) -> Option<Sides> {
        let tiers = &self.scene.tiers;
        let mut all: Vec<Curved> = vec![];
        for curved in self.scene.matter.iter().flat_map(|m| &m.jumps.curved) {
            if tiers[curved.argument.0 as usize] == Tier::Sample && !all.contains(curved) {
                all.push(*curved);
            }
        }
        if all.is_empty() {
            return None;
        }
        let function = match &self.sides {
            Some(function) => function.clone(),
            None => {
                let roots: Vec<(String, NodeId)> =
                    all.iter().enumerate().map(|(i, c)| (format!("side_{i}"), c.argument)).collect();
                let roots: Vec<(&str, NodeId)> = roots.iter().map(|(name, node)| (name.as_str(), *node)).collect();
                let function = field_function(self.graph, tiers, self.builder, "sides", None, &roots);
                self.sides = Some(function.clone());
                function
            }
        };
        let hoisted = self.along_ray(code, &-ray.direction.clone(), &function.hoisted);
        Some(Sides { function, hoisted, every_whole: all.iter().map(|c| c.every_whole).collect() })
    }

    /// The arguments at a distance along the ray.
    fn sides_at(&mut self, code: &mut Code, ray: &Ray, sides: &Sides, t: Expr, name: &str) -> Expr {
        self.at_distance(code, ray, (&sides.function, &sides.hoisted), t, name)
    }

    /// A function of fields at a distance along the ray.
    pub(super) fn call_field(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        function: &FieldFunction,
        t: &Expr,
        name: &str,
    ) -> Expr {
        let hoisted = self.along_ray(code, &-ray.direction.clone(), &function.hoisted);
        self.at_distance(code, ray, (function, &hoisted), t.clone(), name)
    }

    fn at_distance(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        called: (&FieldFunction, &[Expr]),
        t: Expr,
        name: &str,
    ) -> Expr {
        let t = code.bind(&format!("t_{name}"), Ty::F32, t);
        let p = ray.at(t.clone());
        self.call(code, ray, called, (&p, &t), name)
    }

    /// A function of fields, with what it takes from the ray, at a place and its distance.
    pub(super) fn call(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        (function, hoisted): (&FieldFunction, &[Expr]),
        (p, t): (&Expr, &Expr),
        name: &str,
    ) -> Expr {
        let mut arguments = vec![p.clone()];
        arguments.extend(hoisted.iter().cloned());
        for shell in &function.altitudes {
            arguments.push(self.altitude(code, ray, *shell, t));
        }
        code.bind(name, function.result, Expr::Call(function.id, arguments))
    }

    /// Whether two places lie on different sides of some jump.
    fn apart(sides: &Sides, a: &Expr, b: &Expr) -> Expr {
        let each = sides.every_whole.iter().enumerate().map(|(i, whole)| {
            let side = |v: &Expr| {
                let x = sides.function.part(v, i);
                if *whole { Expr::math(Math::Floor, [x]) } else { x.less(0.0).select(1.0, 0.0) }
            };
            Expr::binary(BinaryOp::NotEqual, side(a), side(b))
        });
        each.reduce(Expr::or).unwrap_or(Expr::Bool(false))
    }

    /// Shortens a step from t so that it ends where it first crosses a jump, a little beyond it; whether it does.
    pub(super) fn cut_at_jump(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        sides: &Sides,
        from: &Expr,
        step: LocalId,
    ) -> Expr {
        let before = self.sides_at(code, ray, sides, from.clone(), "sides_before");
        let after = self.sides_at(code, ray, sides, from.clone() + Expr::Local(step), "sides_after");
        let crosses = code.bind("crosses", Ty::BOOL, Self::apart(sides, &before, &after));
        code.open();
        let low = code.var("short_of_jump", Ty::F32, 0.0);
        let round = code.var("bisection", Ty::F32, 0.0);
        code.open();
        code.break_if(Expr::Local(round).greater_equal(ROUNDS));
        let middle = code.bind("middle", Ty::F32, (Expr::Local(low) + Expr::Local(step)) * 0.5);
        let there = self.sides_at(code, ray, sides, from.clone() + middle.clone(), "sides_there");
        let beyond = code.bind("beyond", Ty::BOOL, Self::apart(sides, &before, &there));
        code.set(step, beyond.clone().select(middle.clone(), step));
        code.set(low, beyond.select(low, middle));
        code.add(round, 1.0);
        let bisect = code.close();
        code.push_loop(bisect);
        let block = code.close();
        code.push_if(crosses.clone(), block);
        crosses
    }
}
