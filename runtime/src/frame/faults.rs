//! What goes wrong at run time, gathered from records and told once for each field.

use compiler::diagnostic::{Diagnostic, Diagnostics};
use compiler::ir::{FieldScene, NodeId};
use compiler::program::Fault;
use std::collections::BTreeMap;

/// Faults of one drawing: how many rays met each, and where the first one did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaultTally {
    found: BTreeMap<u32, (u64, [f64; 3])>,
}

impl FaultTally {
    /// Counts a ray whose record has this code, at a position in the scene's units. A code of 0 is no fault.
    pub fn add(&mut self, code: u32, position: [f64; 3]) {
        if code != 0 {
            self.found.entry(code).or_insert((0, position)).0 += 1;
        }
    }

    /// With those of another part of the program, or of more paths. Each was met by as many rays at least as met it in either.
    pub fn join(&mut self, other: Self) {
        for (code, (count, position)) in other.found {
            let entry = self.found.entry(code).or_insert((count, position));
            entry.0 = entry.0.max(count);
        }
    }

    /// Whether the driver ended loops early somewhere.
    #[must_use]
    pub fn is_cut_short(&self) -> bool {
        self.found.contains_key(&Fault::CUT_SHORT)
    }

    /// Whether nothing went wrong.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// One diagnostic for each medium and field. `rays` is what was counted: `pixels` or `rays`.
    #[must_use]
    pub fn diagnostics(&self, scene: &FieldScene, rays: &str) -> Diagnostics {
        let mut found = Diagnostics::default();
        if let Some((count, _)) = self.found.get(&Fault::CUT_SHORT) {
            let message = format!("the graphics driver ended loops before they were done, in {count} {rays}");
            found.push(
                Diagnostic::error("E0656", message)
                    .note("this driver ends all loops of an invocation after a number of rounds and does not say so; the light of these rays is wrong")
                    .hint("try a lower accuracy or fewer `steps`, or `--engine cpu`"),
            );
        }
        for (code, (count, position)) in &self.found {
            let Some(fault) = Fault::from_code(*code) else { continue };
            let Some(medium) = scene.media.get(fault.medium as usize) else { continue };
            let [x, y, z] = position.map(|v| metres(v * scene.units.length));
            let (name, field) = (&medium.name, fault.field);
            let rays = if *count == 1 { rays.trim_end_matches('s') } else { rays };
            let place = format!("at ({x}, {y}, {z}) m, in {count} {rays}");
            let diagnostic = if fault.not_finite {
                Diagnostic::error("E0651", format!("`{field}` of `{name}` is not finite {place}"))
                    .hint("look for a division by zero, a logarithm of zero or an overflow there")
            } else {
                Diagnostic::error("E0650", format!("`{field}` of `{name}` is negative {place}"))
                    .hint("put `max(0, …)` around it")
            };
            // k_t is the sum, which no line of the scene writes.
            let node: Option<NodeId> = match fault.field {
                "k_a" => Some(medium.k_a),
                "k_s" => Some(medium.k_s),
                "k_e" => Some(medium.k_e),
                _ => None,
            };
            let span = node.and_then(|n| scene.graph.origin(n).span).or(medium.span);
            found.push(match span {
                Some(span) => diagnostic.at(span, ""),
                None => diagnostic,
            });
        }
        found
    }
}

/// A coordinate to six digits.
fn metres(x: f64) -> String {
    let text = format!("{x:.5e}").parse::<f64>().unwrap_or(x);
    format!("{text}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_short() {
        assert_eq!(metres(0.1 + 0.2), "0.3");
        assert_eq!(metres(-1234.56789), "-1234.57");
        assert_eq!(metres(0.0), "0");
    }
}
