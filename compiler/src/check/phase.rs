//! Phase functions: what is special about their arguments.

use super::Checker;
use super::constant::Known;
use super::hir::Expr;
use crate::diagnostic::Diagnostic;

/// An argument of a phase function of the library that must lie between -1 and 1.
#[derive(Debug)]
pub(super) struct Asymmetry {
    function: String,
    parameter: &'static str,
    value: Expr,
}

impl Checker<'_> {
    /// Remembers `g` and `k`; they can be evaluated when all functions are known.
    pub(super) fn remember_asymmetry(&mut self, function: &str, names: &[&str], arguments: &[Expr]) {
        for (name, value) in names.iter().zip(arguments) {
            let parameter = match *name {
                "g" => "g",
                "k" => "k",
                _ => continue,
            };
            self.asymmetries.push(Asymmetry { function: function.to_owned(), parameter, value: value.clone() });
        }
    }

    /// Reports every one that is known and out of range.
    pub(super) fn finish_asymmetries(&mut self) {
        for asymmetry in std::mem::take(&mut self.asymmetries) {
            let Asymmetry { function, parameter, value } = asymmetry;
            let Some(Known::Numbers(numbers)) = self.known(&value) else { continue };
            let Some(bad) = numbers.all().iter().copied().find(|g| g.is_nan() || g.abs() >= 1.0) else { continue };
            let problem =
                Diagnostic::error("E0411", format!("`{parameter}` of `{function}` must lie between -1 and 1"))
                    .at(value.span, format!("this is {bad}"))
                    .note("at 1 all light goes straight on, as if nothing scattered");
            self.report(if bad.abs() == 1.0 {
                problem.hint(format!("a strong forward peak is `{parameter}: 0.95`"))
            } else {
                problem
            });
        }
    }
}
