//! `medium` and `fog`.

use super::Properties;
use crate::check::Checker;
use crate::check::coerce::Role;
use crate::check::hir::{Builtin, Dim, Expr, ExprKind, LocalId, Medium};
use crate::check::scope::{Context, Inputs, Place, Scope};
use crate::check::types::{D, Form, Ty, Value};
use crate::diagnostic::Diagnostic;
use crate::resolve::ModuleId;
use crate::syntax::ast::{self, BinaryOp, Block, Property};

const PROPERTIES: &[&str] =
    &["shape", "density", "k_a", "k_s", "k_e", "k_t", "albedo", "mean_free_path", "transfer", "phase", "transform"];

/// Properties that say the same in different ways.
const CONFLICTS: &[(&str, &str)] = &[
    ("k_t", "k_a"),
    ("k_t", "k_s"),
    ("k_t", "mean_free_path"),
    ("k_t", "transfer"),
    ("mean_free_path", "k_a"),
    ("mean_free_path", "k_s"),
    ("mean_free_path", "transfer"),
    ("transfer", "k_a"),
    ("transfer", "k_e"),
    ("transfer", "albedo"),
];

impl Checker<'_> {
    pub(super) fn medium(&mut self, item: &ast::Item, block: &Block) -> Option<Medium> {
        let mut properties = self.properties(block, PROPERTIES);
        let name = block.name.as_ref().map_or("", |n| n.text.as_str());
        let span = block.name.as_ref().map_or(item.span, |n| n.span);
        let errors = self.error_count();
        self.conflicts(&mut properties, CONFLICTS);
        let shape = properties.take("shape").and_then(|p| {
            let shape = self.live(p, "medium", Ty::Shape, Inputs::FRAME)?;
            self.validate_shape(&shape);
            Some(shape)
        });
        let transform = properties.take("transform").and_then(|p| self.live(p, "medium", Ty::Transform, Inputs::FRAME));
        if let Some(transform) = &transform {
            self.validate_transform(transform);
        }
        let inputs = match &shape {
            Some(shape) if self.has_shell(shape) => Inputs::FIELD.and(Inputs::ALTITUDE),
            // A broken shape may have been one.
            None if properties.take("shape").is_some() => Inputs::FIELD.and(Inputs::ALTITUDE),
            Some(_) | None => Inputs::FIELD,
        };
        // One scope for all of them, since sugar joins their trees.
        let place = Place::Property { block: "medium", name: "density" };
        let mut scope = Scope::new(ModuleId::SCENE, Context::live(place, inputs));
        let density = properties.take("density").and_then(|p| self.field(p, Ty::NUMBER, &mut scope));
        if let Some(density) = &density {
            self.not_negative(density, "`density`");
        }
        let coefficient = Ty::spectrum(Dim::COEFFICIENT);
        let k_a = properties.take("k_a").and_then(|p| self.coefficient(p, coefficient, &mut scope));
        let k_s = properties.take("k_s").and_then(|p| self.coefficient(p, coefficient, &mut scope));
        let k_e = properties.take("k_e").and_then(|p| self.coefficient(p, Ty::spectrum(Dim::EMISSION), &mut scope));
        let phase = properties.take("phase").and_then(|p| self.phase(p, &mut scope));
        let mut medium =
            Medium { name: name.to_owned(), span, shape, transform, density, k_a, k_s, k_e, phase, transfer: None };
        self.extinction(block, &mut properties, &mut medium, &mut scope);
        if let Some(property) = properties.take("transfer") {
            self.transfer(property, &mut medium, &mut scope);
        }
        if self.error_count() > errors {
            return None;
        }
        self.warn_of_no_effect(block, &mut properties, &medium);
        Some(medium)
    }

    fn error_count(&self) -> usize {
        self.diagnostics.iter().filter(|d| d.severity == crate::diagnostic::Severity::Error).count()
    }

    pub(super) fn conflicts(&mut self, properties: &mut Properties<'_>, pairs: &[(&str, &str)]) {
        for (a, b) in pairs {
            if let (Some(a), Some(b)) = (properties.take(a), properties.take(b)) {
                let (first, second) = if a.name.span.start < b.name.span.start { (a, b) } else { (b, a) };
                self.report(
                    Diagnostic::error(
                        "E0404",
                        format!("`{}` and `{}` say the same thing", first.name.text, second.name.text),
                    )
                    .at(second.name.span, "cannot stand beside the other")
                    .because(first.name.span, "the other")
                    .hint("keep one of the two"),
                );
            }
        }
    }

    /// A property that is a field.
    fn field(&mut self, property: &Property, want: Ty, scope: &mut Scope) -> Option<Expr> {
        let name = super::static_name(&property.name.text);
        scope.context.place = Place::Property { block: "medium", name };
        self.live_in(&property.value, want, name, scope)
    }

    /// A coefficient: a field that must not be negative.
    fn coefficient(&mut self, property: &Property, want: Ty, scope: &mut Scope) -> Option<Expr> {
        let value = self.field(property, want, scope)?;
        self.not_negative(&value, &format!("`{}`", property.name.text)).then_some(value)
    }

    fn phase(&mut self, property: &Property, scope: &mut Scope) -> Option<Expr> {
        let outside = (scope.context.inputs, scope.context.phase);
        scope.context.inputs = outside.0.and(Inputs::COS_THETA);
        scope.context.phase = true;
        scope.context.place = Place::Property { block: "medium", name: "phase" };
        let value = self.expression(&property.value, scope);
        (scope.context.inputs, scope.context.phase) = outside;
        if matches!(value.kind, ExprKind::Number(_)) && !value.ty.is_error() {
            let text = self.snippet(value.span);
            let problem = Diagnostic::error("E0303", "`phase` is a function of the scattering angle, not a number")
                .at(value.span, "the same in every direction");
            self.report(if crate::check::units::is_number_text(&text) {
                problem.hint(format!(
                    "write `phase = isotropic`, or `phase = henyey_greenstein(g: {text})` if it is the mean cosine"
                ))
            } else {
                problem.hint("write `phase = isotropic`, or `phase = henyey_greenstein(g: 0.6)`")
            });
            return None;
        }
        // One value per band where it follows `lambda`.
        let want = match value.ty {
            Ty::Numeric(Form::Spectrum, _) => Ty::spectrum(Dim::NONE),
            _ => Ty::NUMBER,
        };
        if let Ty::Numeric(Form::Scalar, d) = value.ty
            && !d.is_none()
        {
            self.mismatch(&value, Ty::NUMBER, Role::Property("phase"));
            return None;
        }
        let value = self.coerce(value, want, Role::Property("phase"));
        self.finished(value, "phase")
    }

    /// `k_t` or `mean_free_path` with `albedo`.
    fn extinction(&mut self, block: &Block, properties: &mut Properties<'_>, medium: &mut Medium, scope: &mut Scope) {
        let (k_t, path) = (properties.take("k_t"), properties.take("mean_free_path"));
        let albedo = properties.take("albedo");
        let total = match (k_t, path) {
            (Some(p), _) => self.coefficient(p, Ty::spectrum(Dim::COEFFICIENT), scope),
            (None, Some(p)) => {
                let path = self.coefficient(p, Ty::spectrum(Dim::LENGTH), scope);
                path.map(|path| {
                    let span = path.span;
                    let ty = Ty::Numeric(form(&path), D::Of(Dim::COEFFICIENT));
                    binary(BinaryOp::Divide, Value::number(1.0, Dim::NONE, span).expr(), path, ty)
                })
            }
            (None, None) => None,
        };
        let Some(source) = k_t.or(path) else {
            if let Some(albedo) = albedo {
                self.albedo(albedo, scope);
                if medium.k_a.is_none() && medium.k_s.is_none() && properties.take("k_s").is_none() {
                    let place = block.name.as_ref().map_or(block.word, |n| n.span);
                    self.report(
                        Diagnostic::error("E0403", "`albedo` needs `k_t`")
                            .at(albedo.name.span, "the share of `k_t` that is scattered")
                            .because(place, "in this medium")
                            .hint("say how dense it is: `k_t = 1 /m`, or `mean_free_path = 1 m`"),
                    );
                } else {
                    self.report(
                        Diagnostic::error("E0404", "`albedo` goes with `k_t`, not with `k_a` and `k_s`")
                            .at(albedo.name.span, "the share of `k_t` that is scattered")
                            .hint("give `k_t` and `albedo`, or `k_a` and `k_s`"),
                    );
                }
            }
            return;
        };
        let Some(albedo) = albedo else {
            self.report(
                Diagnostic::error("E0403", format!("`{}` needs `albedo`", source.name.text))
                    .at(source.name.span, "how much of it is scattered, and how much absorbed?")
                    .hint("add `albedo = 0.9`, the share that is scattered; or give `k_a` and `k_s` instead"),
            );
            return;
        };
        let (Some(albedo), Some(total)) = (self.albedo(albedo, scope), total) else { return };
        let joined = form(&albedo).join(form(&total)).unwrap_or(Form::Spectrum);
        let ty = Ty::Numeric(joined, D::Of(Dim::COEFFICIENT));
        let one = Value::number(1.0, Dim::NONE, albedo.span).expr();
        let rest = binary(BinaryOp::Subtract, one, albedo.clone(), Ty::Numeric(form(&albedo), D::NONE));
        medium.k_s = Some(binary(BinaryOp::Multiply, albedo, total.clone(), ty));
        medium.k_a = Some(binary(BinaryOp::Multiply, rest, total, ty));
    }

    /// Between 0 and 1; a colour counts as the spectrum it is.
    fn albedo(&mut self, property: &Property, scope: &mut Scope) -> Option<Expr> {
        scope.context.place = Place::Property { block: "medium", name: "albedo" };
        let value = self.expression(&property.value, scope);
        self.checked_albedo(value)
    }

    /// A colour becomes a spectrum; what is known to be outside 0..1 is reported.
    pub(super) fn checked_albedo(&mut self, value: Value) -> Option<Expr> {
        let span = value.span;
        let value = if value.ty == Ty::Color {
            let one = Value::number(1.0, Dim::NONE, span);
            self.binary(BinaryOp::Multiply, span, value, one, span)
        } else {
            self.coerce(value, Ty::spectrum(Dim::NONE), Role::Property("albedo"))
        };
        let value = self.finished(value, "albedo")?;
        if let Some(crate::check::constant::Known::Numbers(n)) = self.known(&value)
            && n.all().iter().any(|v| *v < 0.0 || *v > 1.0)
        {
            self.report(
                Diagnostic::error("E0408", "`albedo` lies between 0 and 1")
                    .at(span, "outside")
                    .note("it is the share of light that is scattered rather than absorbed; above 1 energy would grow"),
            );
            return None;
        }
        Some(value)
    }

    /// `transfer = layer`: k_a = layer.k, k_e = layer.k * (layer.color * 1 lx).
    fn transfer(&mut self, property: &Property, medium: &mut Medium, scope: &mut Scope) {
        let Some(layer) = self.field(property, Ty::Layer, scope) else { return };
        let span = layer.span;
        let id = scope.fresh();
        let local = || Box::new(Expr { kind: ExprKind::Local(id), ty: Ty::Layer.hir(), span });
        let k = Expr { kind: ExprKind::LayerK(local()), ty: Ty::scalar(Dim::COEFFICIENT).hir(), span };
        let color = Expr { kind: ExprKind::LayerColor(local()), ty: Ty::Color.hir(), span };
        let strength = Value::number(1.0, Dim::LIGHT, span).expr();
        let light = binary(BinaryOp::Multiply, color, strength, Ty::spectrum(Dim::LIGHT));
        let emission = binary(BinaryOp::Multiply, k, light, Ty::spectrum(Dim::EMISSION));
        medium.k_a = Some(Expr {
            kind: ExprKind::LayerK(Box::new(layer.clone())),
            ty: Ty::scalar(Dim::COEFFICIENT).hir(),
            span,
        });
        medium.k_e = Some(named(id, "layer", layer.clone(), emission));
        medium.transfer = Some(layer);
    }

    fn warn_of_no_effect(&mut self, block: &Block, properties: &mut Properties<'_>, medium: &Medium) {
        let place = block.name.as_ref().map_or(block.word, |n| block.word.to(n.span));
        let written = ["k_a", "k_s", "k_e", "k_t", "mean_free_path", "transfer"];
        // What is written and wrong has been reported.
        let nothing = written.iter().all(|name| properties.take(name).is_none());
        if nothing && block.properties.iter().all(|p| PROPERTIES.contains(&p.name.text.as_str())) {
            self.report(
                Diagnostic::warning("W0403", format!("the medium `{}` has no effect", medium.name))
                    .at(place, "neither absorbs, nor scatters, nor emits")
                    .hint("give it `k_a`, `k_s` or `k_e`, or a `transfer` function"),
            );
        } else if let Some(phase) = properties.take("phase")
            && medium.k_s.is_none()
            && properties.take("k_s").is_none()
        {
            self.report(
                Diagnostic::warning("W0404", "`phase` has no effect without scattering")
                    .at(phase.name.span, "this medium does not scatter")
                    .hint("give it `k_s`"),
            );
        }
    }

    /// `fog`: k_a = k exp(-p.y / height), k_e = k_a * color * 1 lx.
    pub(super) fn fog(&mut self, item: &ast::Item, block: &Block) -> Option<Medium> {
        let mut properties = self.properties(block, &["k", "color", "height"]);
        let place = |name| Place::Property { block: "fog", name };
        let mut scope = Scope::new(ModuleId::SCENE, Context::live(place("k"), Inputs::BANDS.and(Inputs::POSITION)));
        let k = match properties.take("k") {
            Some(p) => {
                let value = self.live_in(&p.value, Ty::spectrum(Dim::COEFFICIENT), "k", &mut scope)?;
                self.not_negative(&value, "`k`").then_some(value)
            }
            None => Some(Value::number(0.05, Dim::COEFFICIENT, block.word).expr()),
        };
        scope.context.place = place("color");
        let color = match properties.take("color") {
            Some(p) => self.live_in(&p.value, Ty::Color, "color", &mut scope),
            // #c8d0d8, the colour of a bright overcast day.
            None => Some(
                Value::new(ExprKind::Color([0.577_580_4, 0.630_757_1, 0.686_685_3, 1.0]), Ty::Color, block.word).expr(),
            ),
        };
        scope.context.place = place("height");
        scope.context.inputs = Inputs::FRAME;
        let height = match properties.take("height") {
            None => None,
            Some(p) => {
                let height = self.live_in(&p.value, Ty::scalar(Dim::LENGTH), "height", &mut scope)?;
                if self.known_scalar(&height).is_some_and(|h| h <= 0.0) {
                    self.report(
                        Diagnostic::error("E0408", "`height` of the fog must be above zero")
                            .at(p.value.span, "over this height the fog thins to a third")
                            .hint("without `height`, the fog is the same everywhere"),
                    );
                    return None;
                }
                Some(height)
            }
        };
        let (k, color) = (k?, color?);
        let k_a = match height {
            None => k,
            Some(height) => {
                let fall = exponential(height);
                let ty = Ty::of(&k.ty);
                binary(BinaryOp::Multiply, k, fall, ty)
            }
        };
        let span = k_a.span;
        let strength = Value::number(1.0, Dim::LIGHT, span).expr();
        let light = binary(BinaryOp::Multiply, color, strength, Ty::spectrum(Dim::LIGHT));
        let k_e = binary(BinaryOp::Multiply, k_a.clone(), light, Ty::spectrum(Dim::EMISSION));
        Some(Medium {
            name: "fog".to_owned(),
            span: if item.span.start == block.word.start { block.word } else { item.span },
            shape: None,
            transform: None,
            density: None,
            k_a: Some(k_a),
            k_s: None,
            k_e: Some(k_e),
            phase: None,
            transfer: None,
        })
    }
}

/// exp(-p.y / height)
fn exponential(height: Expr) -> Expr {
    let span = height.span;
    let expr = |kind, ty: Ty| Expr { kind, ty: ty.hir(), span };
    let p = expr(ExprKind::Input(crate::check::hir::Input::Position), Ty::vec3(Dim::LENGTH));
    let y = expr(ExprKind::Swizzle(Box::new(p), vec![1]), Ty::scalar(Dim::LENGTH));
    let down = expr(ExprKind::Negate(Box::new(y)), Ty::scalar(Dim::LENGTH));
    let ratio = binary(BinaryOp::Divide, down, height, Ty::NUMBER);
    expr(ExprKind::Builtin(Builtin::Exp, vec![ratio]), Ty::NUMBER)
}

fn form(value: &Expr) -> Form {
    if let Ty::Numeric(form, _) = Ty::of(&value.ty) { form } else { Form::Spectrum }
}

fn binary(op: BinaryOp, a: Expr, b: Expr, ty: Ty) -> Expr {
    let span = a.span;
    Expr { kind: ExprKind::Binary(op, Box::new(a), Box::new(b)), ty: ty.hir(), span }
}

fn named(id: LocalId, name: &str, value: Expr, last: Expr) -> Expr {
    let (ty, span) = (last.ty.clone(), last.span);
    Expr { kind: ExprKind::Let(vec![(id, name.to_owned(), value)], Box::new(last)), ty, span }
}
