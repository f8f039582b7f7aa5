//! `light`.

use crate::check::Checker;
use crate::check::hir::{Dim, Expr, Light, LightKind};
use crate::check::scope::Inputs;
use crate::check::types::Ty;
use crate::diagnostic::Diagnostic;
use crate::syntax::ast::{self, Block, Property};

const PROPERTIES: &[&str] =
    &["direction", "irradiance", "angular_diameter", "position", "intensity", "radius", "environment"];

/// The property that makes a light what it is, what it needs besides, and what it may have.
const KINDS: &[(&str, &[&str])] =
    &[("direction", &["irradiance", "angular_diameter"]), ("position", &["intensity", "radius"]), ("environment", &[])];

impl Checker<'_> {
    pub(super) fn light(&mut self, item: &ast::Item, block: &Block) -> Option<Light> {
        let mut properties = self.properties(block, PROPERTIES);
        let name = block.name.as_ref().map_or("", |n| n.text.as_str());
        let span = block.name.as_ref().map_or(item.span, |n| n.span);
        let place = block.word.to(span);
        let kinds: Vec<(&Property, &[&str])> =
            KINDS.iter().filter_map(|(word, others)| Some((properties.take(word)?, *others))).collect();
        let (kind, others) = match kinds.as_slice() {
            [one] => *one,
            [] => {
                self.report(
                    Diagnostic::error("E0417", format!("the light `{name}` comes from nowhere"))
                        .at(place, "without `direction`, `position` or `environment`")
                        .hint("parallel light: `direction = (0, -1, 0)  irradiance = 5 lx`")
                        .hint("a point: `position = (0, 2, 0) m  intensity = 10 lx * m^2`")
                        .hint("a sky: `environment = rgb(0.3, 0.5, 0.9) * lx`"),
                );
                return None;
            }
            [(first, _), (second, _), ..] => {
                self.report(
                    Diagnostic::error("E0417", format!("the light `{name}` is of two kinds at once"))
                        .at(second.name.span, "another kind of light")
                        .because(first.name.span, "one kind of light")
                        .hint("make two lights of it"),
                );
                return None;
            }
        };
        let mut good = true;
        for property in &block.properties {
            let text = property.name.text.as_str();
            if text != kind.name.text && !others.contains(&text) && PROPERTIES.contains(&text) {
                self.report(
                    Diagnostic::error("E0417", format!("`{text}` does not go with `{}`", kind.name.text))
                        .at(property.name.span, "belongs to another kind of light")
                        .because(kind.name.span, "makes it this kind of light")
                        .hint(match (kind.name.text.as_str(), text) {
                            ("position", "irradiance") => "a point has an `intensity`: `intensity = 10 lx * m^2`",
                            ("direction", "intensity") => "parallel light has an `irradiance`: `irradiance = 5 lx`",
                            _ => "remove one of the two",
                        }),
                );
                good = false;
            }
        }
        let kind = match kind.name.text.as_str() {
            "direction" => {
                let direction = self.live(kind, "light", Ty::vec3(Dim::NONE), Inputs::FRAME);
                let direction = direction.filter(|d| self.refuse_zero(d, "`direction`", "it points nowhere"));
                let irradiance =
                    self.strength(block, properties.take("irradiance"), "irradiance", Dim::LIGHT, "5 lx", good);
                let disc = properties.take("angular_diameter").map(|p| {
                    let value = self.live(p, "light", Ty::NUMBER, Inputs::FRAME)?;
                    self.disc(p, &value).then_some(value)
                });
                LightKind::Directional {
                    direction: direction?,
                    irradiance: irradiance?,
                    angular_diameter: optional(disc)?,
                }
            }
            "position" => {
                let position = self.live(kind, "light", Ty::vec3(Dim::LENGTH), Inputs::FRAME);
                let intensity = self.strength(
                    block,
                    properties.take("intensity"),
                    "intensity",
                    Dim::INTENSITY,
                    "10 lx * m^2",
                    good,
                );
                let radius = properties.take("radius").map(|p| {
                    let value = self.live(p, "light", Ty::scalar(Dim::LENGTH), Inputs::FRAME)?;
                    self.not_negative(&value, "`radius`").then_some(value)
                });
                LightKind::Point { position: position?, intensity: intensity?, radius: optional(radius)? }
            }
            _ => {
                let inputs = Inputs::BANDS.and(Inputs::DIRECTION);
                let radiance = self.live(kind, "light", Ty::spectrum(Dim::LIGHT), inputs)?;
                LightKind::Environment { radiance: self.not_negative(&radiance, "`environment`").then_some(radiance)? }
            }
        };
        good.then(|| Light { name: name.to_owned(), span, kind })
    }

    fn strength(
        &mut self,
        block: &Block,
        property: Option<&Property>,
        name: &'static str,
        dim: Dim,
        example: &str,
        report_missing: bool,
    ) -> Option<Expr> {
        let Some(property) = property else {
            if report_missing {
                self.missing_property(block, name, &format!("{name} = {example}"));
            }
            return None;
        };
        let value = self.live(property, "light", Ty::spectrum(dim), Inputs::BANDS)?;
        self.not_negative(&value, &format!("`{name}`")).then_some(value)
    }

    fn disc(&mut self, property: &Property, value: &Expr) -> bool {
        let Some(angle) = self.known_scalar(value) else { return true };
        if (0.0..=std::f64::consts::PI).contains(&angle) {
            return true;
        }
        let text = self.snippet(property.value.span);
        let problem = Diagnostic::error("E0408", "`angular_diameter` lies between 0 and 180 deg")
            .at(property.value.span, format!("this is {} deg", super::rounded(angle.to_degrees())));
        let bare = super::literal(&property.value).is_some();
        self.report(if bare { problem.hint(format!("write `{text} deg`")) } else { problem });
        false
    }
}

/// Nothing where nothing was written, `None` where it was wrong.
#[expect(clippy::option_option, reason = "what is absent and what is wrong are different things")]
fn optional<T>(value: Option<Option<T>>) -> Option<Option<T>> {
    match value {
        None => Some(None),
        Some(Some(value)) => Some(Some(value)),
        Some(None) => None,
    }
}
