//! Units, and the SI values of quantities.

use super::hir::Dim;
use crate::syntax::ast;

/// What a unit is in SI.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) struct Unit {
    pub(super) dim: Dim,
    /// Decimal exponent of its value.
    decimal: i32,
    /// Factor besides.
    factor: f64,
}

/// The unit of this name.
pub(super) fn unit(name: &str) -> Option<Unit> {
    let decimal = |dim, decimal| Unit { dim, decimal, factor: 1.0 };
    Some(match name {
        "m" => decimal(Dim::LENGTH, 0),
        "km" => decimal(Dim::LENGTH, 3),
        "cm" => decimal(Dim::LENGTH, -2),
        "mm" => decimal(Dim::LENGTH, -3),
        "um" => decimal(Dim::LENGTH, -6),
        "nm" => decimal(Dim::LENGTH, -9),
        "s" => decimal(Dim::TIME, 0),
        "ms" => decimal(Dim::TIME, -3),
        "deg" => Unit { dim: Dim::NONE, decimal: 0, factor: std::f64::consts::PI / 180.0 },
        "rad" | "sr" => decimal(Dim::NONE, 0),
        "lx" => decimal(Dim::LIGHT, 0),
        "px" => decimal(Dim::PIXEL, 0),
        _ => return None,
    })
}

impl Unit {
    /// `value` times a power of the unit, rounded once where that is possible: 550 nm is the double nearest to 5.5e-7.
    pub(super) fn apply(self, value: f64, power: i32) -> f64 {
        let decimal = self.decimal.saturating_mul(power);
        let scaled = match decimal {
            0 => value,
            d if d > 0 => value * 10f64.powi(d),
            d => value / 10f64.powi(d.saturating_neg()),
        };
        if self.factor == 1.0 { scaled } else { scaled * self.factor.powi(power) }
    }
}

/// The value of a literal, a sign included.
pub(super) fn literal(expression: &ast::Expr) -> Option<f64> {
    match &expression.kind {
        ast::ExprKind::Number(value) => Some(*value),
        ast::ExprKind::Unary { op: ast::UnaryOp::Negate, operand } => literal(operand).map(|v| -v),
        ast::ExprKind::Size(..)
        | ast::ExprKind::String(_)
        | ast::ExprKind::Color(_)
        | ast::ExprKind::Bool(_)
        | ast::ExprKind::Name(_)
        | ast::ExprKind::Quantity { .. }
        | ast::ExprKind::Tuple(_)
        | ast::ExprKind::List(_)
        | ast::ExprKind::Unary { .. }
        | ast::ExprKind::Binary { .. }
        | ast::ExprKind::If { .. }
        | ast::ExprKind::Block { .. }
        | ast::ExprKind::Reduce { .. }
        | ast::ExprKind::Call { .. }
        | ast::ExprKind::Member { .. } => None,
    }
}

/// Whether a span holds nothing but a literal number, as far as its text shows.
pub(super) fn is_number_text(text: &str) -> bool {
    let digits = text.strip_prefix('-').unwrap_or(text).trim_start();
    digits.starts_with(|c: char| c.is_ascii_digit())
        && digits.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '+' | '-'))
        && digits.replace('_', "").parse::<f64>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_are_rounded_once() {
        assert_eq!(unit("nm").unwrap().apply(550.0, 1), 5.5e-7);
        assert_eq!(unit("km").unwrap().apply(2.0, -1), 0.002);
        assert_eq!(unit("mm").unwrap().apply(2.0, -1), 2000.0);
        assert_eq!(unit("deg").unwrap().apply(180.0, 1), std::f64::consts::PI);
    }
}
