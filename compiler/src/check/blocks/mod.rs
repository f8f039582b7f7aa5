//! Blocks of properties: one file per kind, and what they have in common here.

mod camera;
mod image;
mod light;
mod medium;
mod render;
mod shape;
mod splats;
mod surface;
mod text;

use super::coerce::Role;
use super::constant::Known;
use super::hir::{self, Dim};
use super::scope::{Inputs, Scope};
use super::types::{Ty, Value};
use super::{Checker, units};
use crate::diagnostic::Diagnostic;
use crate::ir::Scattering;
use crate::resolve::{ModuleId, closest, list};
use crate::source::Span;
use crate::syntax::ast::{self, Block, BlockKind, ExprKind, Property};

/// The properties of one block, each once.
pub(super) struct Properties<'b> {
    found: Vec<&'b Property>,
}

impl<'b> Properties<'b> {
    /// The property of this name, if it is written.
    pub(super) fn take(&mut self, name: &str) -> Option<&'b Property> {
        self.found.iter().find(|p| p.name.text == name).copied()
    }
}

impl Checker<'_> {
    /// Sorts the properties of a block; reports unknown ones and repeated ones. The values of unknown ones are checked
    /// for nothing: what they should be is not known.
    pub(super) fn properties<'b>(&mut self, block: &'b Block, known: &[&'static str]) -> Properties<'b> {
        let mut found: Vec<&'b Property> = vec![];
        for property in &block.properties {
            let name = property.name.text.as_str();
            if !known.contains(&name) {
                self.unknown_property(block, property, known);
                continue;
            }
            if let Some(first) = found.iter().find(|p| p.name.text == name) {
                self.report(
                    Diagnostic::error("E0402", format!("`{name}` is given twice"))
                        .at(property.name.span, "the second time")
                        .because(first.name.span, "the first time")
                        .hint("remove one of the two"),
                );
                continue;
            }
            found.push(property);
        }
        Properties { found }
    }

    fn unknown_property(&mut self, block: &Block, property: &Property, known: &[&'static str]) {
        let word = block.kind.word();
        let name = property.name.text.as_str();
        let article = if matches!(block.kind, BlockKind::Image) { "an" } else { "a" };
        let article = match block.kind {
            BlockKind::Splats | BlockKind::Render => "",
            BlockKind::Grid
            | BlockKind::Medium
            | BlockKind::Light
            | BlockKind::Surface
            | BlockKind::Fog
            | BlockKind::Style
            | BlockKind::Text
            | BlockKind::Camera
            | BlockKind::Image => article,
        };
        let owner = if article.is_empty() { format!("`{word}`") } else { format!("{article} {word}") };
        let problem = Diagnostic::error("E0401", format!("{owner} has no property `{name}`"))
            .at(property.name.span, "unknown property");
        let usual = usual_name(block.kind, name).filter(|n| known.contains(n));
        let near = usual.or_else(|| closest(name, known.iter().copied()));
        let problem = match near {
            Some(near) => problem.hint(format!("did you mean `{near}`?")),
            None => match elsewhere(name) {
                Some(other) if other != word => problem.hint(format!("`{name}` belongs to `{other} {{ … }}`")),
                _ => problem,
            },
        };
        self.report(problem.note(format!("it has {}", list(known))));
    }

    pub(super) fn missing_property(&mut self, block: &Block, name: &str, example: &str) {
        let place = block.name.as_ref().map_or(block.word, |n| block.word.to(n.span));
        self.report(
            Diagnostic::error(
                "E0403",
                if block.kind == BlockKind::Splats {
                    format!("these splats need `{name}`")
                } else {
                    format!("this {} needs `{name}`", block.kind.word())
                },
            )
            .at(place, format!("without `{name}`"))
            .hint(format!("add one: `{example}`")),
        );
    }

    /// One of a few words.
    pub(super) fn word<T: Copy>(&mut self, property: &Property, block: &str, words: &[(&str, T)]) -> Option<T> {
        if let ExprKind::Name(name) = &property.value.kind
            && let Some((_, value)) = words.iter().find(|(w, _)| w == name)
        {
            return Some(*value);
        }
        let known: Vec<&str> = words.iter().map(|(w, _)| *w).collect();
        self.wrong_word(property, block, &known);
        None
    }

    /// A property has none of the values that it can have.
    pub(super) fn wrong_word(&mut self, property: &Property, block: &str, known: &[&str]) {
        let text = self.snippet(property.value.span);
        let name = &property.name.text;
        let problem = Diagnostic::error("E0406", format!("`{block}.{name}` cannot be `{text}`"))
            .at(property.value.span, "not one of its values")
            .note(format!("it is one of {}", list(known)));
        let written = text.trim_matches('"');
        let head = written.split('(').next().unwrap_or(written);
        let near = known.iter().find(|w| **w == written).copied().or_else(|| {
            let heads = known.iter().map(|w| w.split('(').next().unwrap_or(w));
            closest(head, heads).or_else(|| known.iter().map(|w| w.split('(').next().unwrap_or(w)).find(|w| *w == head))
        });
        self.report(match near {
            Some(near) => {
                let full = known.iter().find(|w| w.split('(').next() == Some(near)).copied().unwrap_or(near);
                problem.hint(format!("write `{name} = {full}`"))
            }
            None => problem,
        });
    }

    /// A text in quotes.
    pub(super) fn text(&mut self, module: ModuleId, property: &Property, block: &'static str) -> Option<String> {
        if let ExprKind::String(text) = &property.value.kind {
            return Some(text.clone());
        }
        // A constant may hold it.
        let mut scope = self.fixed_scope(module, block, static_name(&property.name.text));
        let value = self.expression(&property.value, &mut scope);
        let value = self.coerce(value, Ty::String, Role::Property(&property.name.text));
        if value.ty.is_error() {
            return None;
        }
        let mut kind = value.kind;
        while let hir::ExprKind::Const(id) = kind {
            kind = self.constants.get(id.0 as usize)?.1.kind.clone();
        }
        if let hir::ExprKind::String(text) = kind {
            return Some(text);
        }
        self.not_constant(property.value.span, &format!("`{block}.{}`", property.name.text));
        None
    }

    /// A number that must be known when compiling.
    pub(super) fn fixed_number(
        &mut self,
        module: ModuleId,
        property: &Property,
        block: &'static str,
        dim: Dim,
    ) -> Option<f64> {
        self.fixed_value(module, &property.value, block, static_name(&property.name.text), dim)
    }

    pub(super) fn fixed_value(
        &mut self,
        module: ModuleId,
        value: &ast::Expr,
        block: &'static str,
        name: &'static str,
        dim: Dim,
    ) -> Option<f64> {
        let mut scope = self.fixed_scope(module, block, name);
        let checked = self.expect(value, Ty::scalar(dim), Role::Property(name), &mut scope);
        if checked.ty.is_error() {
            return None;
        }
        let what = format!("`{block}.{name}`");
        match self.known(&checked.expr()) {
            Some(Known::Numbers(n)) if n.all()[0].is_finite() => Some(n.all()[0]),
            Some(_) => {
                self.infinite(value.span, &what);
                None
            }
            None => {
                self.not_constant(value.span, &what);
                None
            }
        }
    }

    /// A whole number in a range, known when compiling.
    pub(super) fn fixed_count(
        &mut self,
        value: &ast::Expr,
        block: &'static str,
        name: &'static str,
        range: std::ops::RangeInclusive<u32>,
    ) -> Option<u32> {
        let number = self.fixed_value(ModuleId::SCENE, value, block, name, Dim::NONE)?;
        let (low, high) = (f64::from(*range.start()), f64::from(*range.end()));
        if number.fract() != 0.0 || number < low || number > high {
            let range =
                if range.end() == &u32::MAX { format!("of at least {low}") } else { format!("from {low} to {high}") };
            self.report(
                Diagnostic::error("E0408", format!("`{block}.{name}` is a whole number {range}"))
                    .at(value.span, format!("this is {number}")),
            );
            return None;
        }
        Some(number as u32)
    }

    /// A value that may follow params and inputs, of one type. Reports what is known to be NaN or infinite.
    pub(super) fn live(
        &mut self,
        property: &Property,
        block: &'static str,
        want: Ty,
        inputs: Inputs,
    ) -> Option<hir::Expr> {
        let name = static_name(&property.name.text);
        let mut scope = self.live_scope(ModuleId::SCENE, block, name, inputs);
        self.live_in(&property.value, want, name, &mut scope)
    }

    pub(super) fn live_in(&mut self, value: &ast::Expr, want: Ty, name: &str, scope: &mut Scope) -> Option<hir::Expr> {
        let value = self.expect(value, want, Role::Property(name), scope);
        self.finished(value, name)
    }

    /// A checked value of a property, unless it is wrong.
    pub(super) fn finished(&mut self, value: Value, name: &str) -> Option<hir::Expr> {
        if value.ty.is_error() {
            return None;
        }
        let value = value.expr();
        (!self.refuse_infinite(&value, &format!("`{name}`"))).then_some(value)
    }

    /// A position, direction or size that must not vanish.
    pub(super) fn refuse_zero(&mut self, value: &hir::Expr, what: &str, consequence: &str) -> bool {
        if let Some(Known::Numbers(n)) = self.known(value)
            && n.all().iter().all(|v| *v == 0.0)
        {
            self.report(Diagnostic::error("E0412", format!("{what} is zero")).at(value.span, consequence.to_owned()));
            return false;
        }
        true
    }

    /// The value of a constant vector.
    pub(super) fn known_vector(&mut self, value: &hir::Expr) -> Option<[f64; 3]> {
        match self.known(value)? {
            Known::Numbers(n) => Some(n.vector()),
            Known::Color(_) | Known::Bool(_) | Known::Layer(..) => None,
        }
    }

    /// Everything that is drawn.
    pub(super) fn scene(&mut self) -> hir::Scene {
        let blocks: Vec<(&ast::Item, &Block)> = self.scene_blocks().collect();
        self.refuse_second(&blocks);
        let of = |kind: BlockKind| blocks.iter().copied().filter(move |(_, b)| b.kind == kind);
        let mut media: Vec<hir::Medium> = vec![];
        for (item, block) in of(BlockKind::Medium) {
            media.extend(self.medium(item, block));
        }
        if let Some((item, block)) = of(BlockKind::Fog).next() {
            media.extend(self.fog(item, block));
        }
        let mut lights = vec![];
        for (item, block) in of(BlockKind::Light) {
            lights.extend(self.light(item, block));
        }
        let mut surfaces = vec![];
        for (item, block) in of(BlockKind::Surface) {
            surfaces.extend(self.surface(item, block));
        }
        let mut pending = vec![];
        for kind in [BlockKind::Style, BlockKind::Text] {
            for (_, block) in of(kind) {
                pending.extend(self.pending(block));
            }
        }
        let camera = self.camera(of(BlockKind::Camera).next());
        let image = self.image(of(BlockKind::Image).next());
        let mut render = self.render(of(BlockKind::Render).next());
        if !render.scattering_explicit {
            let scatters = media.iter().any(|m| m.k_s.is_some()) && !lights.is_empty();
            render.scattering = if scatters { Scattering::Single } else { Scattering::None };
        }
        let drawn = blocks.iter().any(|(_, b)| {
            matches!(
                b.kind,
                BlockKind::Medium | BlockKind::Fog | BlockKind::Surface | BlockKind::Splats | BlockKind::Text
            )
        });
        let says_nothing = !drawn && !lights.iter().any(|l| matches!(l.kind, hir::LightKind::Environment { .. }));
        if says_nothing && !self.diagnostics.has_errors() {
            self.warn_of_emptiness(&blocks);
        }
        hir::Scene {
            params: vec![],
            constants: vec![],
            functions: vec![],
            tables: vec![],
            grids: vec![],
            media,
            lights,
            surfaces,
            splats: vec![],
            pending,
            camera,
            image,
            render,
        }
    }

    fn warn_of_emptiness(&mut self, blocks: &[(&ast::Item, &Block)]) {
        let tree = &self.modules.module(ModuleId::SCENE).tree;
        let place = blocks.first().map_or_else(
            || Span { end: tree.span.start, ..tree.span },
            |(_, b)| b.name.as_ref().map_or(b.word, |n| b.word.to(n.span)),
        );
        self.report(
            Diagnostic::warning("W0402", "this scene has nothing to draw")
                .at(place, "no medium, surface, text or environment in this file")
                .hint("add a medium: `medium ball { shape = sphere(center: (0,0,0) m, radius: 1 m)  k_e = 1 lx / m }`"),
        );
    }

    /// At most one camera, image, render and fog.
    fn refuse_second(&mut self, blocks: &[(&ast::Item, &Block)]) {
        for kind in [BlockKind::Camera, BlockKind::Image, BlockKind::Render, BlockKind::Fog] {
            let mut of_kind = blocks.iter().filter(|(_, b)| b.kind == kind);
            let Some((_, first)) = of_kind.next() else { continue };
            for (_, block) in of_kind {
                self.report(
                    Diagnostic::error("E0405", format!("a scene has one `{}` at most", kind.word()))
                        .at(block.word, "the second one")
                        .because(first.word, "the first one")
                        .hint("remove one, or move its properties into the other"),
                );
            }
        }
    }
}

/// Names of properties live as long as the program, so that places can hold them.
pub(super) fn static_name(name: &str) -> &'static str {
    const NAMES: &[&str] = &[
        "file",
        "filter",
        "outside",
        "shape",
        "density",
        "k_a",
        "k_s",
        "k_e",
        "k_t",
        "albedo",
        "mean_free_path",
        "phase",
        "transform",
        "blend",
        "transfer",
        "direction",
        "irradiance",
        "angular_diameter",
        "position",
        "intensity",
        "radius",
        "environment",
        "k",
        "color",
        "height",
        "font",
        "size",
        "method",
        "fill",
        "outline",
        "style",
        "content",
        "at",
        "align",
        "emission",
        "from",
        "to",
        "up",
        "fov",
        "projection",
        "aa",
        "bands",
        "exposure",
        "tonemap",
        "background",
        "backend",
        "scattering",
        "composite",
        "accuracy",
        "steps",
        "slices",
        "stacks",
        "splats",
        "samples",
        "pixels",
        "max_work",
    ];
    NAMES.iter().find(|n| **n == name).copied().unwrap_or("value")
}

/// What a property is called here that people know by another name.
fn usual_name(kind: BlockKind, name: &str) -> Option<&'static str> {
    const MEDIUM: &[(&str, &str)] = &[
        ("sigma_a", "k_a"),
        ("absorption", "k_a"),
        ("sigma_s", "k_s"),
        ("scattering", "k_s"),
        ("emission", "k_e"),
        ("sigma_e", "k_e"),
        ("emissive", "k_e"),
        ("sigma_t", "k_t"),
        ("extinction", "k_t"),
        ("mfp", "mean_free_path"),
        ("geometry", "shape"),
        ("bounds", "shape"),
        ("g", "phase"),
        ("phase_function", "phase"),
        ("transfer_function", "transfer"),
        ("color", "albedo"),
        ("colour", "albedo"),
    ];
    const LIGHT: &[(&str, &str)] = &[
        ("dir", "direction"),
        ("pos", "position"),
        ("power", "intensity"),
        ("strength", "irradiance"),
        ("brightness", "irradiance"),
        ("sky", "environment"),
        ("radiance", "environment"),
    ];
    const CAMERA: &[(&str, &str)] = &[
        ("position", "from"),
        ("eye", "from"),
        ("origin", "from"),
        ("look_at", "to"),
        ("lookat", "to"),
        ("target", "to"),
        ("at", "to"),
        ("field_of_view", "fov"),
        ("angle", "fov"),
        ("type", "projection"),
    ];
    const IMAGE: &[(&str, &str)] = &[
        ("resolution", "size"),
        ("width", "size"),
        ("height", "size"),
        ("antialiasing", "aa"),
        ("anti_aliasing", "aa"),
        ("tone_map", "tonemap"),
        ("ev", "exposure"),
        ("bg", "background"),
    ];
    const RENDER: &[(&str, &str)] = &[
        ("method", "backend"),
        ("quality", "accuracy"),
        ("error", "accuracy"),
        ("tolerance", "accuracy"),
        ("step_count", "steps"),
        ("spp", "samples"),
        ("mode", "composite"),
        ("projection", "composite"),
    ];
    const OTHER: &[(&str, &str)] = &[
        ("path", "file"),
        ("src", "file"),
        ("source", "file"),
        ("interpolation", "filter"),
        ("background", "outside"),
        ("colour", "color"),
        ("density", "k"),
        ("reflectance", "albedo"),
        ("text", "content"),
        ("string", "content"),
        ("position", "at"),
    ];
    let names = match kind {
        BlockKind::Medium => MEDIUM,
        BlockKind::Light => LIGHT,
        BlockKind::Camera => CAMERA,
        BlockKind::Image => IMAGE,
        BlockKind::Render => RENDER,
        BlockKind::Grid
        | BlockKind::Splats
        | BlockKind::Surface
        | BlockKind::Fog
        | BlockKind::Style
        | BlockKind::Text => OTHER,
    };
    names.iter().find(|(theirs, _)| *theirs == name).map(|(_, ours)| *ours)
}

/// The block that a property belongs to, for the properties of blocks that there is one of.
fn elsewhere(name: &str) -> Option<&'static str> {
    match name {
        "from" | "to" | "up" | "fov" => Some("camera"),
        "size" | "aa" | "bands" | "exposure" | "tonemap" | "background" => Some("image"),
        "backend" | "scattering" | "composite" | "accuracy" | "steps" | "max_work" => Some("render"),
        "k_a" | "k_s" | "k_e" | "phase" | "density" => Some("medium"),
        _ => None,
    }
}

/// A number as people write it, to four decimals.
pub(super) fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// A literal number, sign included.
pub(super) fn literal(expression: &ast::Expr) -> Option<f64> {
    units::literal(expression)
}
