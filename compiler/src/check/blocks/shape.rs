//! Shapes and transforms: what can be known to be degenerate.

use crate::check::Checker;
use crate::check::constant::Known;
use crate::check::hir::{Builtin, Expr, ExprKind};
use crate::diagnostic::Diagnostic;

impl Checker<'_> {
    /// Whether a `shell` is part of a shape, so that there is an altitude.
    pub(super) fn has_shell(&mut self, shape: &Expr) -> bool {
        self.finish_functions();
        self.finds_shell(shape)
    }

    fn finds_shell(&self, shape: &Expr) -> bool {
        match &shape.kind {
            ExprKind::Builtin(Builtin::Shell, _) => true,
            ExprKind::Builtin(_, parts) => parts.iter().any(|p| self.finds_shell(p)),
            ExprKind::Const(id) => self.constants.get(id.0 as usize).is_some_and(|(_, value)| self.finds_shell(value)),
            ExprKind::Let(_, last) => self.finds_shell(last),
            ExprKind::If(_, a, b) => self.finds_shell(a) || self.finds_shell(b),
            ExprKind::Call(id, _) => {
                let function = self.functions.get(id.0 as usize).and_then(Option::as_ref);
                function.is_some_and(|f| self.finds_shell(&f.body))
            }
            ExprKind::Number(_)
            | ExprKind::Color(_)
            | ExprKind::Bool(_)
            | ExprKind::String(_)
            | ExprKind::Input(_)
            | ExprKind::Param(_)
            | ExprKind::Local(_)
            | ExprKind::Grid(_)
            | ExprKind::Splats(_)
            | ExprKind::Vector(_)
            | ExprKind::Negate(_)
            | ExprKind::Not(_)
            | ExprKind::Binary(..)
            | ExprKind::Reduce { .. }
            | ExprKind::Lookup(..)
            | ExprKind::Sample(..)
            | ExprKind::Swizzle(..)
            | ExprKind::LayerColor(_)
            | ExprKind::LayerK(_) => false,
        }
    }

    /// Reports what is known to be empty, inside out, infinite or no number.
    pub(super) fn validate_shape(&mut self, shape: &Expr) {
        let ExprKind::Builtin(builtin, arguments) = &shape.kind else {
            if let ExprKind::Const(id) = shape.kind
                && let Some((_, value)) = self.constants.get(id.0 as usize).cloned()
            {
                self.validate_shape(&value);
            }
            return;
        };
        for argument in arguments {
            let what = format!("an argument of `{}`", word(*builtin));
            self.refuse_infinite(argument, &what);
        }
        let known: Vec<Option<[f64; 3]>> = arguments.iter().map(|a| self.known_vector(a)).collect();
        let at = |i: usize| known.get(i).copied().flatten();
        let positive = |this: &mut Self, i: usize, name: &str| {
            if let (Some(v), Some(argument)) = (at(i), arguments.get(i))
                && v.iter().any(|c| *c <= 0.0)
            {
                let message = format!("`{name}` of `{}` must be above zero", word(*builtin));
                this.report(Diagnostic::error("E0413", message).at(argument.span, "nothing would be inside"));
            }
        };
        match builtin {
            Builtin::Sphere => positive(self, 1, "radius"),
            Builtin::Ellipsoid => positive(self, 1, "radii"),
            Builtin::Cylinder => {
                positive(self, 2, "radius");
                if let (Some(a), Some(b)) = (at(0), at(1))
                    && a == b
                {
                    let message = "`from` and `to` of `cylinder` are the same point";
                    self.report(Diagnostic::error("E0413", message).at(arguments[1].span, "it has no axis"));
                }
            }
            Builtin::Box => self.validate_box(shape, arguments, at(0), at(1)),
            Builtin::Slab => {
                if at(0).is_some_and(|axis| axis == [0.0; 3]) {
                    let message = "`axis` of `slab` is zero";
                    self.report(Diagnostic::error("E0413", message).at(arguments[0].span, "it has no direction"));
                }
                self.ordered(arguments, at(1), at(2), ("from", "to", "slab"));
            }
            Builtin::Shell => {
                if at(1).is_some_and(|r| r[0] < 0.0) {
                    let message = "`inner` of `shell` must not be negative";
                    self.report(Diagnostic::error("E0413", message).at(arguments[1].span, "a radius"));
                }
                positive(self, 2, "outer");
                self.ordered(arguments, at(1), at(2), ("inner", "outer", "shell"));
            }
            Builtin::Union | Builtin::Intersection | Builtin::Difference => {
                for argument in arguments {
                    self.validate_shape(argument);
                }
            }
            _ => {}
        }
    }

    fn validate_box(&mut self, shape: &Expr, arguments: &[Expr], min: Option<[f64; 3]>, max: Option<[f64; 3]>) {
        let (Some(min), Some(max)) = (min, max) else { return };
        let axes = ["x", "y", "z"];
        if let Some(axis) = (0..3).find(|i| min[*i] > max[*i]) {
            self.report(
                Diagnostic::error("E0413", format!("the box is inside out along {}", axes[axis]))
                    .at(arguments[1].span, format!("`max.{}` lies below `min.{}`", axes[axis], axes[axis]))
                    .because(arguments[0].span, "`min`")
                    .hint("`min` holds the smaller coordinate of each axis"),
            );
        } else if let Some(axis) = (0..3).find(|i| min[*i] == max[*i]) {
            self.report(
                Diagnostic::warning("W0405", format!("the box has no thickness along {}", axes[axis]))
                    .at(shape.span, "nothing is inside")
                    .hint("move `min` and `max` apart"),
            );
        }
    }

    /// Two distances, the first of which must not exceed the second.
    fn ordered(
        &mut self,
        arguments: &[Expr],
        low: Option<[f64; 3]>,
        high: Option<[f64; 3]>,
        names: (&str, &str, &str),
    ) {
        let (Some(low), Some(high)) = (low, high) else { return };
        let (a, b, shape) = names;
        if low[0] > high[0] {
            self.report(
                Diagnostic::error("E0413", format!("`{a}` of `{shape}` is greater than `{b}`"))
                    .at(arguments[1].span, format!("`{a}`"))
                    .because(arguments[2].span, format!("`{b}`"))
                    .hint("exchange the two"),
            );
        } else if low[0] == high[0] {
            self.report(
                Diagnostic::warning("W0405", format!("the {shape} has no thickness"))
                    .at(arguments[1].span, format!("`{a}` and `{b}` are equal"))
                    .hint("move the two apart"),
            );
        }
    }

    /// Reports a transform that is known to flatten space or to have no axis.
    pub(super) fn validate_transform(&mut self, transform: &Expr) {
        match &transform.kind {
            ExprKind::Binary(_, a, b) => {
                self.validate_transform(a);
                self.validate_transform(b);
            }
            ExprKind::Builtin(Builtin::Scale, arguments) => {
                let Some(factor) = arguments.first() else { return };
                self.refuse_infinite(factor, "the factor of `scale`");
                if let Some(Known::Numbers(n)) = self.known(factor)
                    && n.all().contains(&0.0)
                {
                    self.report(
                        Diagnostic::error("E0413", "`scale` by zero leaves nothing")
                            .at(factor.span, "this is zero")
                            .hint("scale by a number above zero: `scale(1.5)`"),
                    );
                }
            }
            ExprKind::Builtin(Builtin::Rotate, arguments) => {
                if let Some(axis) = arguments.first() {
                    self.refuse_zero(axis, "the axis of `rotate`", "it has no direction");
                }
            }
            _ => {}
        }
    }
}

/// How a shape is written.
fn word(builtin: Builtin) -> &'static str {
    match builtin {
        Builtin::Sphere => "sphere",
        Builtin::Ellipsoid => "ellipsoid",
        Builtin::Box => "box",
        Builtin::Slab => "slab",
        Builtin::Cylinder => "cylinder",
        Builtin::Shell => "shell",
        _ => "this shape",
    }
}
