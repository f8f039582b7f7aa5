//! `render`.

use crate::check::Checker;
use crate::check::hir::{Composite, Dim, Render};
use crate::check::scope::Inputs;
use crate::check::types::Ty;
use crate::diagnostic::Diagnostic;
use crate::ir::{Backend, Pixels, Scattering, Stacks};
use crate::resolve::ModuleId;
use crate::syntax::ast::{self, Block, ExprKind, Property};

const PROPERTIES: &[&str] = &[
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

impl Checker<'_> {
    pub(super) fn render(&mut self, found: Option<(&ast::Item, &Block)>) -> Render {
        let mut render = Render {
            span: None,
            backend: Backend::Auto,
            scattering: Scattering::None,
            scattering_explicit: false,
            composite: Composite::Radiance,
            accuracy: 1e-2,
            steps: None,
            slices: None,
            stacks: Stacks::View,
            splats: None,
            samples: None,
            pixels: Pixels::Every,
            max_work: 65536,
        };
        let Some((_, block)) = found else { return render };
        render.span = Some(block.word);
        let mut properties = self.properties(block, PROPERTIES);
        let backends = [
            ("auto", Backend::Auto),
            ("raymarch", Backend::Raymarch),
            ("slicing", Backend::Slicing),
            ("splatting", Backend::Splatting),
        ];
        if let Some(backend) = properties.take("backend").and_then(|p| self.word(p, "render", &backends)) {
            render.backend = backend;
        }
        let orders = [("none", Scattering::None), ("single", Scattering::Single), ("multiple", Scattering::Multiple)];
        if let Some(property) = properties.take("scattering") {
            render.scattering_explicit = true;
            render.scattering = self.word(property, "render", &orders).unwrap_or(Scattering::None);
        }
        if let Some(composite) = properties.take("composite").and_then(|p| self.composite(p)) {
            render.composite = composite;
        }
        if let Some(accuracy) = properties.take("accuracy").and_then(|p| self.accuracy(p)) {
            render.accuracy = accuracy;
        }
        let mut count = |name: &'static str, most: u32| {
            let property = properties.take(name)?;
            self.fixed_count(&property.value, "render", name, 1..=most)
        };
        render.steps = count("steps", u32::MAX);
        render.slices = count("slices", u32::MAX);
        render.splats = count("splats", u32::MAX);
        render.samples = count("samples", u32::MAX);
        if let Some(cap) = count("max_work", u32::MAX) {
            render.max_work = cap;
        }
        let stacks = [("view", Stacks::View), ("object", Stacks::Object), ("half_angle", Stacks::HalfAngle)];
        if let Some(property) = properties.take("stacks") {
            render.stacks = self.word(property, "render", &stacks).unwrap_or(Stacks::View);
            self.unused_stacks(property, render.backend);
        }
        let pixels = [("every", Pixels::Every), ("adaptive", Pixels::Adaptive)];
        if let Some(pixels) = properties.take("pixels").and_then(|p| self.word(p, "render", &pixels)) {
            render.pixels = pixels;
        }
        render
    }

    /// Warns of planes that a backend does not draw.
    fn unused_stacks(&mut self, property: &Property, backend: Backend) {
        let word = match backend {
            Backend::Auto | Backend::Slicing => return,
            Backend::Raymarch => "raymarch",
            Backend::Splatting => "splatting",
        };
        self.report(
            Diagnostic::warning("W0407", format!("`stacks` has no effect with `backend = {word}`"))
                .at(property.name.span, "of slicing alone")
                .hint("use `backend = slicing`, or leave it out"),
        );
    }

    fn composite(&mut self, property: &Property) -> Option<Composite> {
        match &property.value.kind {
            ExprKind::Name(name) => match name.as_str() {
                "radiance" => Some(Composite::Radiance),
                "maximum" => Some(Composite::Maximum),
                "minimum" => Some(Composite::Minimum),
                "average" => Some(Composite::Average),
                "isosurface" => {
                    self.report(
                        Diagnostic::error("E0313", "`isosurface` needs a value")
                            .at(property.value.span, "the surface of which value?")
                            .hint("give the value of the data on the surface: `isosurface(40)`"),
                    );
                    None
                }
                _ => {
                    self.wrong_composite(property);
                    None
                }
            },
            ExprKind::Call { function, arguments } if function.text == "isosurface" => {
                let mut scope = self.live_scope(ModuleId::SCENE, "render", "composite", Inputs::FRAME);
                let types = [("value", Ty::NUMBER)];
                let shown = "isosurface(value: number)";
                let [value] = self.form(property, "isosurface", shown, &types, arguments, &mut scope)?;
                Some(Composite::Isosurface(value))
            }
            _ => {
                self.wrong_composite(property);
                None
            }
        }
    }

    fn wrong_composite(&mut self, property: &Property) {
        self.wrong_word(property, "render", &["radiance", "maximum", "minimum", "average", "isosurface(40)"]);
    }

    fn accuracy(&mut self, property: &Property) -> Option<f64> {
        let accuracy = self.fixed_number(ModuleId::SCENE, property, "render", Dim::NONE)?;
        if accuracy > 0.0 {
            return Some(accuracy);
        }
        self.report(
            Diagnostic::error("E0408", "`accuracy` must be above zero")
                .at(property.value.span, format!("this is {accuracy}"))
                .note("it is the greatest error of a pixel, in units of display white")
                .hint("a fine picture has `accuracy = 1e-3`"),
        );
        None
    }
}
