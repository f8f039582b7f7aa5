//! `text` and `style`: checked in full, drawn by nothing yet.

use crate::check::Checker;
use crate::check::hir::{Dim, Pending};
use crate::check::scope::Inputs;
use crate::check::types::{Form, Ty};
use crate::diagnostic::Diagnostic;
use crate::resolve::{ModuleId, closest};
use crate::syntax::ast::{self, Block, BlockKind, ExprKind, Property};

impl Checker<'_> {
    pub(super) fn pending(&mut self, block: &Block) -> Option<Pending> {
        let good = match block.kind {
            BlockKind::Style => self.style(block),
            BlockKind::Text => self.text_block(block),
            BlockKind::Grid
            | BlockKind::Medium
            | BlockKind::Light
            | BlockKind::Splats
            | BlockKind::Surface
            | BlockKind::Fog
            | BlockKind::Camera
            | BlockKind::Image
            | BlockKind::Render => return None,
        };
        let name = block.name.as_ref()?;
        good.then(|| Pending { kind: block.kind, name: name.text.clone(), span: name.span })
    }

    fn style(&mut self, block: &Block) -> bool {
        let mut properties = self.properties(block, &["font", "size", "method", "fill", "outline"]);
        let mut good = true;
        if let Some(font) = properties.take("font") {
            good &= self.text(ModuleId::SCENE, font, "style").is_some();
        }
        if let Some(size) = properties.take("size") {
            let value = self.live(size, "style", Ty::scalar(Dim::PIXEL), Inputs::FRAME);
            if let Some(value) = &value
                && self.known_scalar(value).is_some_and(|v| v <= 0.0)
            {
                self.report(
                    Diagnostic::error("E0408", "`size` must be above zero").at(size.value.span, "too small to read"),
                );
            }
            good &= value.is_some();
        }
        if let Some(method) = properties.take("method") {
            let words = ["auto", "bitmap", "sdf", "msdf", "vector", "loop_blinn", "triangles"].map(|w| (w, ()));
            good &= self.word(method, "style", &words).is_some();
        }
        if let Some(fill) = properties.take("fill") {
            good &= self.live(fill, "style", Ty::Color, Inputs::FRAME).is_some();
        }
        if let Some(outline) = properties.take("outline") {
            good &= self.outline(outline);
        }
        good
    }

    /// `(2 px, #000)`
    fn outline(&mut self, property: &Property) -> bool {
        let mut scope = self.live_scope(ModuleId::SCENE, "style", "outline", Inputs::FRAME);
        let ExprKind::Tuple(parts) = &property.value.kind else {
            return self.wrong_outline(property);
        };
        let [width, color] = parts.as_slice() else {
            return self.wrong_outline(property);
        };
        let width = self.live_in(width, Ty::scalar(Dim::PIXEL), "the width of `outline`", &mut scope);
        let color = self.live_in(color, Ty::Color, "the colour of `outline`", &mut scope);
        width.is_some() && color.is_some()
    }

    fn wrong_outline(&mut self, property: &Property) -> bool {
        self.report(
            Diagnostic::error("E0406", "`outline` is a width and a colour")
                .at(property.value.span, "not both")
                .hint("write `outline = (2 px, #000)`"),
        );
        false
    }

    fn text_block(&mut self, block: &Block) -> bool {
        let mut properties = self.properties(block, &["style", "content", "at", "align", "emission"]);
        let mut good = true;
        match properties.take("content") {
            Some(content) => good &= self.text(ModuleId::SCENE, content, "text").is_some(),
            None => {
                self.missing_property(block, "content", "content = \"…\"");
                good = false;
            }
        }
        match properties.take("at") {
            Some(at) => good &= self.text_place(at),
            None => {
                self.missing_property(block, "at", "at = screen(0.5, 0.9)");
                good = false;
            }
        }
        if let Some(style) = properties.take("style") {
            good &= self.style_name(style);
        }
        if let Some(align) = properties.take("align") {
            let words = ["left", "center", "right"].map(|w| (w, ()));
            good &= self.word(align, "text", &words).is_some();
        }
        if let Some(emission) = properties.take("emission") {
            let value = self.live(emission, "text", Ty::spectrum(Dim::LIGHT), Inputs::BANDS);
            good &= value.is_some_and(|v| self.not_negative(&v, "`emission`"));
        }
        good
    }

    fn style_name(&mut self, property: &Property) -> bool {
        let module = self.modules.module(ModuleId::SCENE);
        let styles: Vec<&str> = module.tree.items.iter().filter_map(style_of).collect();
        let text = self.snippet(property.value.span);
        if matches!(property.value.kind, ExprKind::Name(_)) && styles.contains(&text.as_str()) {
            return true;
        }
        let problem =
            Diagnostic::error("E0201", format!("there is no style `{text}`")).at(property.value.span, "not a style");
        self.report(match closest(&text, styles.iter().copied()) {
            Some(near) => problem.hint(format!("did you mean `{near}`?")),
            None => problem.hint(format!("declare one: `style {text} {{ size = 32 px }}`")),
        });
        false
    }

    /// `screen(x, y)` or `plane(origin: …, right: …, up: …, height: …)`.
    fn text_place(&mut self, property: &Property) -> bool {
        let mut scope = self.live_scope(ModuleId::SCENE, "text", "at", Inputs::FRAME);
        if let ExprKind::Call { function, arguments } = &property.value.kind {
            if function.text == "screen" {
                let types = [("x", Ty::NUMBER), ("y", Ty::NUMBER)];
                let shown = "screen(x: number, y: number)";
                return self.form(property, "screen", shown, &types, arguments, &mut scope).is_some();
            }
            if function.text == "plane" {
                let direction = Ty::Numeric(Form::Vec3, crate::check::types::D::NONE);
                let types = [
                    ("origin", Ty::vec3(Dim::LENGTH)),
                    ("right", direction),
                    ("up", direction),
                    ("height", Ty::scalar(Dim::LENGTH)),
                ];
                let shown = "plane(origin: vec3<length>, right: vec3, up: vec3, height: length)";
                let Some([_, right, up, height]) = self.form(property, "plane", shown, &types, arguments, &mut scope)
                else {
                    return false;
                };
                let mut good = self.refuse_zero(&right, "`right` of `plane`", "it points nowhere");
                good &= self.refuse_zero(&up, "`up` of `plane`", "it points nowhere");
                if self.known_scalar(&height).is_some_and(|h| h <= 0.0) {
                    self.report(
                        Diagnostic::error("E0408", "`height` of `plane` must be above zero")
                            .at(height.span, "too small to read"),
                    );
                    good = false;
                }
                return good;
            }
        }
        let known = ["screen(0.5, 0.9)", "plane(origin: …, right: …, up: …, height: …)"];
        self.wrong_word(property, "text", &known);
        false
    }
}

/// The name of an item that is a style.
fn style_of(item: &ast::Item) -> Option<&str> {
    let ast::ItemKind::Block(block) = &item.kind else { return None };
    if block.kind == BlockKind::Style { block.name.as_ref().map(|n| n.text.as_str()) } else { None }
}
