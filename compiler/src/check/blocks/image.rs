//! `image`.

use crate::check::Checker;
use crate::check::coerce::Role;
use crate::check::constant::Known;
use crate::check::hir::{Dim, Expr, Image};
use crate::check::scope::Inputs;
use crate::check::types::Ty;
use crate::diagnostic::Diagnostic;
use crate::ir::{Aa, Bands, BandsKind, Tonemap};
use crate::resolve::ModuleId;
use crate::syntax::ast::{self, Block, ExprKind, Property};

/// The bands of `bands = rgb`.
const RGB: [f64; 3] = [680e-9, 550e-9, 440e-9];
/// The band of `bands = gray`.
const GRAY: f64 = 550e-9;

impl Checker<'_> {
    pub(super) fn image(&mut self, found: Option<(&ast::Item, &Block)>) -> Image {
        let mut image = Image {
            span: None,
            size: [1024, 768],
            aa: Aa::Analytic,
            bands: BandsKind::Rgb,
            wavelengths: RGB.to_vec(),
            exposure: None,
            tonemap: Tonemap::None,
            background: None,
        };
        let Some((_, block)) = found else { return image };
        image.span = Some(block.word);
        let mut properties = self.properties(block, &["size", "aa", "bands", "exposure", "tonemap", "background"]);
        if let Some(size) = properties.take("size").and_then(|p| self.size(p)) {
            image.size = size;
        }
        if let Some(aa) = properties.take("aa").and_then(|p| self.aa(p)) {
            image.aa = aa;
        }
        if let Some((kind, wavelengths)) = properties.take("bands").and_then(|p| self.bands(p)) {
            image.bands = kind;
            image.wavelengths = wavelengths;
        }
        image.exposure = properties.take("exposure").and_then(|p| self.live(p, "image", Ty::NUMBER, Inputs::FRAME));
        let tonemaps = [
            ("none", Tonemap::None),
            ("reinhard", Tonemap::Reinhard),
            ("aces", Tonemap::Aces),
            ("exposure", Tonemap::Exposure),
        ];
        if let Some(tonemap) = properties.take("tonemap").and_then(|p| self.word(p, "image", &tonemaps)) {
            image.tonemap = tonemap;
        }
        image.background = properties.take("background").and_then(|p| self.background(p));
        image
    }

    fn size(&mut self, property: &Property) -> Option<[u32; 2]> {
        let limits = 1..=65536u32;
        let ExprKind::Size(width, height) = property.value.kind else {
            if self.names_param(&property.value, "image", "size") {
                return None;
            }
            let text = self.snippet(property.value.span);
            let numbers: Vec<&str> =
                text.trim_matches(['(', ')', '[', ']', '"']).split([',', '*', 'x', '×']).map(str::trim).collect();
            let whole = |n: &&str| n.parse::<u32>().is_ok();
            let problem = Diagnostic::error("E0406", "`image.size` is written as width x height")
                .at(property.value.span, "not a size");
            self.report(match numbers.as_slice() {
                [w, h] if whole(w) && whole(h) => problem.hint(format!("write `size = {w} x {h}`")),
                _ => problem.hint("write `size = 1024 x 768`"),
            });
            return None;
        };
        if !limits.contains(&width) || !limits.contains(&height) {
            self.report(
                Diagnostic::error("E0408", format!("a picture of {width} x {height} cannot be drawn"))
                    .at(property.value.span, "each side has 1 to 65536 pixels"),
            );
            return None;
        }
        Some([width, height])
    }

    /// Reports a param in a structural property; whether there was one.
    fn names_param(&mut self, value: &ast::Expr, block: &'static str, name: &'static str) -> bool {
        let ExprKind::Name(word) = &value.kind else { return false };
        let Some(item) = self.modules.own_name(ModuleId::SCENE, word) else { return false };
        if !matches!(self.modules.item(item).kind, ast::ItemKind::Param { .. }) {
            return false;
        }
        let mut scope = self.fixed_scope(ModuleId::SCENE, block, name);
        self.expression(value, &mut scope);
        true
    }

    fn aa(&mut self, property: &Property) -> Option<Aa> {
        let words =
            [("none", Aa::None), ("analytic", Aa::Analytic), ("fxaa", Aa::Fxaa), ("smaa", Aa::Smaa), ("taa", Aa::Taa)];
        match &property.value.kind {
            ExprKind::Name(name) if words.iter().any(|(w, _)| w == name) => self.word(property, "image", &words),
            ExprKind::Call { function, arguments } if matches!(function.text.as_str(), "ssaa" | "msaa") => {
                let [ast::Argument { value, .. }] = arguments.as_slice() else {
                    self.report(
                        Diagnostic::error("E0313", format!("`{}` takes one number", function.text))
                            .at(property.value.span, "the samples of a pixel, along each side")
                            .hint(format!("write `aa = {}(4)`", function.text)),
                    );
                    return None;
                };
                let count = self.fixed_count(value, "image", "aa", 1..=16)?;
                Some(if function.text == "ssaa" { Aa::Ssaa(count) } else { Aa::Msaa(count) })
            }
            ExprKind::Name(name) if matches!(name.as_str(), "ssaa" | "msaa") => {
                self.report(
                    Diagnostic::error("E0313", format!("`{name}` needs a number of samples"))
                        .at(property.value.span, "how many?")
                        .hint(format!("write `aa = {name}(4)`")),
                );
                None
            }
            _ => {
                let known = ["none", "analytic", "ssaa(4)", "msaa(4)", "fxaa", "smaa", "taa"];
                self.wrong_word(property, "image", &known);
                None
            }
        }
    }

    fn bands(&mut self, property: &Property) -> Option<(BandsKind, Vec<f64>)> {
        match &property.value.kind {
            ExprKind::Name(name) if name == "rgb" => Some((BandsKind::Rgb, RGB.to_vec())),
            ExprKind::Name(name) if name == "gray" => Some((BandsKind::Gray, vec![GRAY])),
            ExprKind::Call { function, arguments } if function.text == "spectral" => self.spectral(property, arguments),
            ExprKind::Name(name) if name == "spectral" => {
                self.report(
                    Diagnostic::error("E0313", "`spectral` needs a number of bands")
                        .at(property.value.span, "how many?")
                        .hint("write `bands = spectral(16)`"),
                );
                None
            }
            ExprKind::List(parts) => self.band_list(property, parts),
            _ => {
                let known = ["rgb", "gray", "[680 nm, 550 nm, 440 nm]", "spectral(16)"];
                let is_length = matches!(property.value.kind, ExprKind::Quantity { .. });
                if is_length {
                    let text = self.snippet(property.value.span);
                    self.report(
                        Diagnostic::error("E0406", "`image.bands` is a list of wavelengths")
                            .at(property.value.span, "not a list")
                            .hint(format!("write `bands = [{text}]`")),
                    );
                } else if let ExprKind::Name(name) = &property.value.kind
                    && name == "grey"
                {
                    self.report(
                        Diagnostic::error("E0406", "`image.bands` cannot be `grey`")
                            .at(property.value.span, "not one of its values")
                            .hint("write `bands = gray`"),
                    );
                } else {
                    self.wrong_word(property, "image", &known);
                }
                None
            }
        }
    }

    /// `spectral(n)`
    fn spectral(&mut self, property: &Property, arguments: &[ast::Argument]) -> Option<(BandsKind, Vec<f64>)> {
        let [ast::Argument { value, .. }] = arguments else {
            self.report(
                Diagnostic::error("E0313", "`spectral` takes one number")
                    .at(property.value.span, "how many bands from 380 to 780 nm?")
                    .hint("write `bands = spectral(16)`, or list wavelengths: `[680 nm, 550 nm, 440 nm]`"),
            );
            return None;
        };
        let number = self.fixed_value(ModuleId::SCENE, value, "image", "bands", Dim::NONE)?;
        if number.fract() != 0.0 || number < 1.0 || number > Bands::MOST as f64 {
            self.report(
                Diagnostic::error("E0418", format!("a picture has 1 to {} bands", Bands::MOST))
                    .at(value.span, format!("this is {number}"))
                    .note("what the eye is known to see is tabulated in steps of 5 nm; closer bands would show nothing new")
                    .hint("colours change little from `spectral(16)` on"),
            );
            return None;
        }
        let bands = Bands::spectral(number as u32);
        Some((bands.kind, bands.wavelengths))
    }

    /// Warns of wavelengths in a list that goes through CIE XYZ, and have no place there.
    fn invisible(&mut self, parts: &[ast::Expr], wavelengths: &[f64]) {
        // One band is shown grey and three as red, green and blue, whatever they are.
        if matches!(wavelengths.len(), 1 | 3) || !wavelengths.iter().any(|w| Bands::is_visible(*w)) {
            return;
        }
        for (part, wavelength) in parts.iter().zip(wavelengths) {
            if !Bands::is_visible(*wavelength) {
                self.report(
                    Diagnostic::warning("W0406", "a band that cannot be seen")
                        .at(part.span, "outside 380 to 780 nm")
                        .note(
                            "it is computed, and is in EXR and NPY files and in probes, but a PNG shows nothing of it",
                        ),
                );
            }
        }
    }

    fn band_list(&mut self, property: &Property, parts: &[ast::Expr]) -> Option<(BandsKind, Vec<f64>)> {
        if parts.is_empty() {
            self.report(
                Diagnostic::error("E0418", "the list of bands is empty")
                    .at(property.value.span, "nothing would be drawn")
                    .hint("write `bands = rgb`, or list wavelengths: `[680 nm, 550 nm, 440 nm]`"),
            );
            return None;
        }
        let mut wavelengths = vec![];
        let mut good = true;
        for part in parts {
            if let Some(bare) = super::literal(part).filter(|v| *v != 0.0) {
                self.bare_wavelength(part, bare);
                good = false;
                continue;
            }
            let value = self.fixed_value(ModuleId::SCENE, part, "image", "bands", Dim::LENGTH);
            if value.is_some_and(|v| v <= 0.0) {
                self.report(
                    Diagnostic::error("E0418", "a wavelength must be above zero").at(part.span, "not a wavelength"),
                );
                good = false;
            }
            good &= value.is_some();
            wavelengths.extend(value);
        }
        if parts.len() > Bands::MOST {
            self.report(
                Diagnostic::error("E0418", format!("a picture has 1 to {} bands", Bands::MOST))
                    .at(property.value.span, format!("{} bands", parts.len()))
                    .hint("draw several pictures, each with some of them"),
            );
            return None;
        }
        if good {
            self.invisible(parts, &wavelengths);
        }
        good.then_some((BandsKind::List, wavelengths))
    }

    /// A wavelength without a unit; its size tells which one was meant.
    fn bare_wavelength(&mut self, part: &ast::Expr, value: f64) {
        let text = self.snippet(part.span);
        let unit = match value.abs() {
            v if v < 1e-3 => "m",
            v if v < 50.0 => "um",
            _ => "nm",
        };
        self.report(
            Diagnostic::error("E0301", "a wavelength is a length, but this is a bare number")
                .at(part.span, "has no unit")
                .hint(format!("give it a unit: `{text} {unit}`")),
        );
    }

    /// A colour, or a radiance in units of display white.
    fn background(&mut self, property: &Property) -> Option<Expr> {
        let mut scope = self.live_scope(ModuleId::SCENE, "image", "background", Inputs::BANDS);
        let value = self.expression(&property.value, &mut scope);
        let value = if value.ty == Ty::Color {
            value
        } else {
            self.coerce(value, Ty::spectrum(Dim::NONE), Role::Property("background"))
        };
        let value = self.finished(value, "background")?;
        let negative = match self.known(&value) {
            Some(Known::Numbers(n)) => n.all().iter().any(|v| *v < 0.0),
            Some(Known::Color(_) | Known::Bool(_) | Known::Layer(..)) | None => false,
        };
        if negative {
            self.report(Diagnostic::error("E0410", "`background` is negative").at(value.span, "below zero"));
            return None;
        }
        Some(value)
    }
}
