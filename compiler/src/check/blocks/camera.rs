//! `camera`.

use crate::check::Checker;
use crate::check::hir::{Camera, Dim, Expr, Projection};
use crate::check::scope::Inputs;
use crate::check::types::Ty;
use crate::diagnostic::Diagnostic;
use crate::syntax::ast::{self, Block, ExprKind, Property};
use std::f64::consts::PI;

impl Checker<'_> {
    pub(super) fn camera(&mut self, found: Option<(&ast::Item, &Block)>) -> Camera {
        let mut camera =
            Camera { span: None, from: None, to: None, up: None, projection: Projection::Perspective(None) };
        let Some((_, block)) = found else { return camera };
        camera.span = Some(block.word);
        let mut properties = self.properties(block, &["from", "to", "up", "fov", "projection"]);
        let point = Ty::vec3(Dim::LENGTH);
        camera.from = properties.take("from").and_then(|p| self.live(p, "camera", point, Inputs::FRAME));
        camera.to = properties.take("to").and_then(|p| self.live(p, "camera", point, Inputs::FRAME));
        camera.up = properties.take("up").and_then(|p| self.live(p, "camera", Ty::vec3(Dim::NONE), Inputs::FRAME));
        if let Some(up) = camera.up.clone() {
            self.refuse_zero(&up, "`up`", "it points nowhere");
        }
        self.validate_view(&camera);
        let fov = properties.take("fov").map(|p| {
            let fov = self.live(p, "camera", Ty::NUMBER, Inputs::FRAME);
            if let Some(fov) = &fov {
                self.validate_fov(p, fov);
            }
            (p, fov)
        });
        let projection = properties.take("projection");
        if let Some((_, Some(fov))) = &fov {
            camera.projection = Projection::Perspective(Some(fov.clone()));
        }
        if let Some(property) = projection
            && let Some(projection) = self.projection(property)
        {
            if let (Some((fov, _)), Projection::Orthographic(_) | Projection::Panorama) = (&fov, &projection) {
                let word = if projection == Projection::Panorama { "panorama" } else { "orthographic" };
                self.report(
                    Diagnostic::error("E0404", format!("`fov` has no meaning in `{word}` projection"))
                        .at(fov.name.span, "the angle of a perspective view")
                        .because(property.value.span, "not a perspective view")
                        .hint("remove `fov`"),
                );
            }
            match projection {
                Projection::Perspective(None) => {}
                Projection::Perspective(Some(_)) | Projection::Orthographic(_) | Projection::Panorama => {
                    camera.projection = projection;
                }
            }
        }
        camera
    }

    fn projection(&mut self, property: &Property) -> Option<Projection> {
        let known = ["perspective", "orthographic(height: 2 m)", "panorama"];
        match &property.value.kind {
            ExprKind::Name(name) if name == "panorama" => Some(Projection::Panorama),
            ExprKind::Name(name) if name == "perspective" => Some(Projection::Perspective(None)),
            ExprKind::Name(name) if name == "orthographic" => {
                self.report(
                    Diagnostic::error("E0313", "`orthographic` needs `height`")
                        .at(property.value.span, "how much of the scene is seen?")
                        .hint("give the height of the picture in the scene: `orthographic(height: 2 m)`"),
                );
                None
            }
            ExprKind::Call { function, arguments } if function.text == "orthographic" => {
                let mut scope = self.live_scope(crate::resolve::ModuleId::SCENE, "camera", "projection", Inputs::FRAME);
                let types = [("height", Ty::scalar(Dim::LENGTH))];
                let shown = "orthographic(height: length)";
                let [height] = self.form(property, "orthographic", shown, &types, arguments, &mut scope)?;
                if self.known_scalar(&height).is_some_and(|h| h <= 0.0) {
                    self.report(
                        Diagnostic::error("E0408", "`height` of `orthographic` must be above zero")
                            .at(height.span, "nothing would be seen"),
                    );
                    return None;
                }
                Some(Projection::Orthographic(height))
            }
            _ => {
                self.wrong_word(property, "camera", &known);
                None
            }
        }
    }

    fn validate_fov(&mut self, property: &Property, fov: &Expr) {
        let Some(angle) = self.known_scalar(fov) else { return };
        if angle > 0.0 && angle < PI {
            return;
        }
        let text = self.snippet(property.value.span);
        let bare = super::literal(&property.value).is_some_and(|v| v > 0.0 && v < 180.0);
        let problem = Diagnostic::error("E0408", "`fov` lies between 0 and 180 deg, both excluded");
        self.report(if bare {
            problem
                .at(property.value.span, "without a unit, an angle is in radians")
                .hint(format!("write `{text} deg`"))
        } else {
            problem
                .at(property.value.span, format!("this is {} deg", super::rounded(angle.to_degrees())))
                .hint("for a wider view: `projection = panorama`")
        });
    }

    /// Whether the camera looks somewhere, and not along its own `up`.
    fn validate_view(&mut self, camera: &Camera) {
        let (Some(from), Some(to)) = (&camera.from, &camera.to) else { return };
        let (Some(a), Some(b)) = (self.known_vector(from), self.known_vector(to)) else { return };
        let forward = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
        if forward == [0.0; 3] {
            self.report(
                Diagnostic::error("E0412", "the camera stands where it looks")
                    .at(to.span, "the same point as `from`")
                    .because(from.span, "`from`")
                    .hint("move `from` or `to`"),
            );
            return;
        }
        let up = match &camera.up {
            Some(up) => match self.known_vector(up) {
                Some(up) => up,
                None => return,
            },
            None => [0.0, 1.0, 0.0],
        };
        let cross = [
            forward[1] * up[2] - forward[2] * up[1],
            forward[2] * up[0] - forward[0] * up[2],
            forward[0] * up[1] - forward[1] * up[0],
        ];
        let size = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        if size(up) > 0.0 && size(cross) <= 1e-9 * size(forward) * size(up) {
            let place = camera.up.as_ref().map_or(to.span, |u| u.span);
            self.report(
                Diagnostic::error("E0412", "the camera looks along its own `up`")
                    .at(place, "parallel to the line of sight, so that no side of the picture is up")
                    .hint(if forward[0] == 0.0 && forward[2] == 0.0 {
                        "give another one: `up = (0, 0, 1)`"
                    } else {
                        "give another one: `up = (0, 1, 0)`"
                    }),
            );
        }
    }
}
