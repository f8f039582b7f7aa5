//! The scene around the expressions: media, background, camera, projections.

use super::{Frame, Lowered, Lowerer, Value};
use crate::check::hir::{self, ExprKind, Type};
use crate::diagnostic::Diagnostic;
use crate::ir::{
    Bands, BandsKind, Camera, Composite, FieldScene, ImageInfo, Input, Medium, NodeId, Op, Projection, RenderInfo,
    Shape, Tier, eval,
};
use crate::source::{SourceId, Span};
use std::f64::consts::{FRAC_PI_4, PI};

/// Where the eye stands when the scene does not say: in front, a little to the right and above.
const VIEW: [f64; 3] = [0.4, 0.3, -1.0];
/// Room around a framed scene.
const MARGIN: f64 = 1.05;

impl<'s> Lowerer<'s, '_> {
    pub(super) fn scene(mut self) -> Option<FieldScene> {
        let scene = self.scene;
        let start = Span { source: SourceId(0), start: 0, end: 0 };
        let here = scene.image.span.unwrap_or(start);
        let count = self.bands.wavelengths.len();
        let fits = match self.bands.kind {
            BandsKind::Rgb => count == 3,
            BandsKind::Gray => count == 1,
            BandsKind::List | BandsKind::Spectral => (1..=Bands::TOGETHER).contains(&count),
        };
        if !fits {
            let _ = self.broken_promise::<()>(here, "the number of bands");
            return None;
        }
        self.declare_grids();
        let mut media = vec![];
        for medium in &scene.media {
            if let Ok(medium) = self.medium(medium) {
                media.push(medium);
            }
        }
        let (lights, environment) = self.lights();
        let (surfaces, meshes) = self.surfaces();
        let background = match environment {
            Ok(Some(sky)) => Ok(sky),
            Ok(None) => self.background(),
            Err(error) => Err(error),
        };
        let shapes: Vec<Shape> = media.iter().map(|m| m.shape.clone()).collect();
        let mut shapes = self.with_surfaces(shapes, &surfaces, &meshes);
        let splats = self.splats();
        shapes.extend(self.splats_shapes(&splats));
        let camera = self.camera(&shapes);
        let exposure = self.exposure();
        let composite = self.composite(&media);
        self.check_limits();
        self.check_nonzero();
        self.check_colors();
        let (Ok(background), Ok(camera), Ok(exposure), Ok(composite)) = (background, camera, exposure, composite)
        else {
            return None;
        };
        if self.failed {
            return None;
        }
        let (image, render) = (&scene.image, &scene.render);
        Some(FieldScene {
            graph: self.graph,
            units: self.units,
            bands: self.bands,
            params: scene.params.clone(),
            media,
            lights,
            surfaces,
            meshes,
            splats,
            background,
            environment: matches!(environment, Ok(Some(_))),
            shells: self.shells,
            camera,
            image: ImageInfo { size: image.size, aa: image.aa, exposure, tonemap: image.tonemap },
            render: RenderInfo {
                backend: render.backend,
                scattering: render.scattering,
                composite,
                accuracy: render.accuracy,
                steps: render.steps,
                slices: render.slices,
                stacks: render.stacks,
                pixels: render.pixels,
                splats: render.splats,
                samples: render.samples,
                max_work: render.max_work,
            },
        })
    }

    /// Says when colours cannot look as they are written.
    fn check_colors(&mut self) {
        let image = &self.scene.image;
        let (true, Some(span), false) = (self.colored, image.span, image.all_bands().shows_colors()) else { return };
        self.diagnostics.push(
            Diagnostic::warning("W0528", "these bands cannot show every colour as it is written")
                .at(span, "colours of the scene are seen through them")
                .note("red, green and blue can be told apart by three bands or more, spread over 400 to 700 nm")
                .hint("write `bands = rgb`, or `bands = spectral(8)`"),
        );
    }

    /// A length that says how large the scene is, in the current units.
    pub(super) fn size(mut self) -> Option<f64> {
        self.geometry_only = true;
        self.declare_grids();
        let scene = self.scene;
        let mut shapes = vec![];
        for medium in &scene.media {
            shapes.extend(self.placed(medium));
            self.leave_space();
        }
        for surface in &scene.surfaces {
            shapes.extend(self.surface_extent(surface));
        }
        let splats = self.splats();
        shapes.extend(self.splats_shapes(&splats));
        if let Some((min, max)) = self.bounds(&shapes) {
            return Some((0..3).map(|i| 0.5 * (max[i] - min[i])).fold(0.0, f64::max));
        }
        let (from, to) = (scene.camera.from.as_ref()?, scene.camera.to.as_ref()?);
        let (from, to) = (self.node(from).ok()?, self.node(to).ok()?);
        let (from, to) = (self.at_defaults(from)?, self.at_defaults(to)?);
        Some(from.iter().zip(&to).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt())
    }

    /// Names of one expression tree are not seen by another.
    pub(super) fn fresh(&mut self) {
        self.frames = vec![Frame::default()];
    }

    /// Enters a medium's space and lowers its shape, as the world sees it.
    fn placed(&mut self, medium: &'s hir::Medium) -> Lowered<Shape> {
        self.fresh();
        let transform = medium.transform.as_ref().map(|t| self.as_transform(t)).transpose()?;
        self.enter_space(transform.clone());
        self.fresh();
        let shape = match &medium.shape {
            Some(shape) => self.as_shape(shape)?,
            None => Shape::Everywhere,
        };
        self.find_shell(&shape);
        Ok(match transform {
            Some(transform) => self.in_world(shape, &transform.inverse),
            None => shape,
        })
    }

    fn medium(&mut self, medium: &'s hir::Medium) -> Lowered<Medium> {
        let lowered = self.medium_inside(medium);
        self.leave_space();
        lowered
    }

    fn medium_inside(&mut self, medium: &'s hir::Medium) -> Lowered<Medium> {
        let shape = self.placed(medium)?;
        self.fresh();
        let density = match &medium.density {
            Some(density) => {
                let node = self.scalar(density)?;
                self.name(node, &format!("{}.density", medium.name));
                Some(node)
            }
            None => None,
        };
        // Each coefficient reports its own errors.
        let k_a = self.coefficient(medium, "k_a", medium.k_a.as_ref(), density);
        let k_s = self.coefficient(medium, "k_s", medium.k_s.as_ref(), density);
        let k_e = self.coefficient(medium, "k_e", medium.k_e.as_ref(), density);
        self.fresh();
        let phase = match (&medium.phase, &medium.k_s) {
            (Some(phase), Some(_)) => self.phase(medium, phase, &shape),
            _ => Ok(None),
        };
        let data = match (&medium.transfer, &self.scene.render.composite) {
            (None, _) | (_, hir::Composite::Radiance) => Ok(None),
            (
                Some(transfer),
                hir::Composite::Maximum
                | hir::Composite::Minimum
                | hir::Composite::Average
                | hir::Composite::Isosurface(_),
            ) => {
                self.fresh();
                self.projected(transfer)
            }
        };
        let (k_a, k_s, k_e, phase, data) = (k_a?, k_s?, k_e?, phase?, data?);
        Ok(Medium {
            name: medium.name.clone(),
            span: Some(medium.span),
            shape,
            k_a,
            k_s,
            k_e,
            phase,
            data: data.map(|d| d.0),
            data_color: data.map(|d| d.1),
        })
    }

    fn coefficient(
        &mut self,
        medium: &hir::Medium,
        property: &str,
        expr: Option<&'s hir::Expr>,
        density: Option<NodeId>,
    ) -> Lowered<NodeId> {
        let Some(expr) = expr else { return Ok(self.graph.scalar(0.0)) };
        self.fresh();
        let mut node = self.spectrum(expr)?;
        let width = self.graph.width(node);
        if width != 1 && width != self.bands.count() {
            return self.broken_promise(expr.span, "a coefficient has the wrong number of bands");
        }
        if let Some(density) = density {
            node = self.graph.mul(density, node);
            self.span_new(expr.span);
        }
        self.name(node, &format!("{}.{property}", medium.name));
        if let Some(constant) = self.constant(node) {
            let values = constant.values();
            let fault = if values.iter().any(|v| !v.is_finite()) {
                Some("is not a finite number")
            } else if values.iter().any(|v| *v < 0.0) {
                Some("is negative")
            } else {
                None
            };
            if let Some(fault) = fault {
                return self.report(
                    Diagnostic::error("E0516", format!("`{property}` of `{}` {fault}", medium.name))
                        .at(expr.span, "this is known when compiling")
                        .hint("coefficients are 0 or larger, and finite"),
                );
            }
        }
        Ok(node)
    }

    /// The data of a projection, and the colour of the transfer function over it.
    fn projected(&mut self, transfer: &'s hir::Expr) -> Lowered<Option<(NodeId, NodeId)>> {
        match &transfer.kind {
            ExprKind::Let(names, last) => {
                for (id, name, expr) in names {
                    self.bind(*id, name, expr)?;
                }
                self.projected(last)
            }
            ExprKind::Lookup(table, key) => {
                let data = self.scalar(key)?;
                let stand_in = self.graph.input(Input::CosTheta);
                let layer = self.lookup(*table, stand_in, transfer.span)?;
                Ok(self.layer_color(&layer).map(|color| (data, color)))
            }
            ExprKind::Call(function, arguments) => {
                let scene = self.scene;
                let Some(callee) = scene.functions.get(function.0 as usize) else {
                    return self.broken_promise(transfer.span, "an unknown function");
                };
                let mut values = arguments.iter().map(|a| self.value(a)).collect::<Lowered<Vec<_>>>()?;
                let mut varying = vec![];
                for (i, (value, argument)) in values.iter().zip(arguments).enumerate() {
                    if let (Value::Node(node), Type::Number(_)) = (value, &argument.ty)
                        && self.constant(*node).is_none()
                    {
                        varying.push((i, *node));
                    }
                }
                let [(place, data)] = varying[..] else { return Ok(None) };
                values[place] = Value::Node(self.graph.input(Input::CosTheta));
                let layer = self.inline(*function, callee, arguments, values)?;
                Ok(self.layer_color(&layer).map(|color| (data, color)))
            }
            _ => Ok(None),
        }
    }

    fn layer_color(&mut self, value: &Value) -> Option<NodeId> {
        let Value::Layer { color, .. } = value else { return None };
        Some(self.color_to_spectrum(*color))
    }

    /// What is behind everything where no environment shines.
    fn background(&mut self) -> Lowered<NodeId> {
        let scene = self.scene;
        self.fresh();
        match &scene.image.background {
            Some(background) => {
                let node = self.spectrum(background)?;
                self.name(node, "image.background");
                self.per_frame(node, background.span, "the background");
                Ok(node)
            }
            None => Ok(self.graph.scalar(0.0)),
        }
    }

    fn exposure(&mut self) -> Lowered<NodeId> {
        self.fresh();
        match &self.scene.image.exposure {
            Some(exposure) => {
                let node = self.scalar(exposure)?;
                self.name(node, "image.exposure");
                self.per_frame(node, exposure.span, "the exposure");
                Ok(node)
            }
            None => Ok(self.graph.scalar(0.0)),
        }
    }

    fn composite(&mut self, media: &[Medium]) -> Lowered<Composite> {
        let scene = self.scene;
        self.fresh();
        let composite = match &scene.render.composite {
            hir::Composite::Radiance => return Ok(Composite::Radiance),
            hir::Composite::Maximum => Composite::Maximum,
            hir::Composite::Minimum => Composite::Minimum,
            hir::Composite::Average => Composite::Average,
            hir::Composite::Isosurface(value) => {
                let node = self.scalar(value)?;
                self.name(node, "render.isosurface");
                self.per_frame(node, value.span, "the value of an isosurface");
                Composite::Isosurface(node)
            }
        };
        if let Some(splats) = scene.splats.first() {
            let diagnostic = Diagnostic::error("E0526", "splats have no data to project")
                .at(splats.span, "these splats")
                .note("`render.composite` projects the data of grids")
                .hint("remove the splats, or use `composite = radiance`");
            return self.report(diagnostic);
        }
        if media.iter().all(|m| m.data.is_none()) && !self.failed {
            let mut diagnostic = Diagnostic::error("E0510", "there is no data to project")
                .note("`render.composite` projects the argument of a medium's `transfer`")
                .hint("give a medium `transfer = f(x)`, where `f` is a transfer function of one number");
            if let Some(span) = scene.render.span {
                diagnostic = diagnostic.at(span, "`composite` asks for data here");
            }
            if let Some(medium) = scene.media.iter().find(|m| m.transfer.is_some()) {
                diagnostic = diagnostic.because(medium.span, "the transfer of this medium has no single argument");
            }
            return self.report(diagnostic);
        }
        Ok(composite)
    }

    /// The camera. What it does not say is framed on the bounds of the media: all of them in the picture, seen from
    /// in front, a little from the right and from above. An unbounded scene is seen from the origin along +z.
    fn camera(&mut self, shapes: &[Shape]) -> Lowered<Camera> {
        const WHAT: &str = "the camera";
        let scene = self.scene;
        let camera = &scene.camera;
        let mut get = |expr: &'s Option<hir::Expr>, name: &str| -> Lowered<Option<NodeId>> {
            let Some(expr) = expr else { return Ok(None) };
            self.fresh();
            let node = self.node(expr)?;
            self.name(node, name);
            self.per_frame(node, expr.span, WHAT);
            Ok(Some(node))
        };
        let (from, to, up) =
            (get(&camera.from, "camera.from"), get(&camera.to, "camera.to"), get(&camera.up, "camera.up"));
        self.fresh();
        let projection = match &camera.projection {
            hir::Projection::Perspective(None) => Projection::Perspective { fov: self.graph.scalar(FRAC_PI_4) },
            hir::Projection::Perspective(Some(expr)) => {
                let fov = self.scalar(expr)?;
                self.name(fov, "camera.fov");
                self.per_frame(fov, expr.span, WHAT);
                let at_defaults = self.at_defaults(fov).and_then(|v| v.first().copied());
                if at_defaults.is_some_and(|fov| !(fov > 0.0 && fov < PI)) {
                    return self.report(
                        Diagnostic::error("E0512", "the field of view must lie between 0 and 180 deg")
                            .at(expr.span, "this angle cannot be seen at once")
                            .hint("try `fov = 45 deg`, or `projection = panorama` to see all around"),
                    );
                }
                Projection::Perspective { fov }
            }
            hir::Projection::Orthographic(expr) => {
                let height = self.scalar(expr)?;
                self.name(height, "camera.height");
                self.per_frame(height, expr.span, WHAT);
                self.nonzero.push((height, expr.span, "the height of the picture"));
                Projection::Orthographic { height }
            }
            hir::Projection::Panorama => Projection::Panorama,
        };
        let (from, to, up) = (from?, to?, up?);
        for node in [from, to, up].into_iter().flatten() {
            self.three(node, camera.span.unwrap_or(Span { source: SourceId(0), start: 0, end: 0 }))?;
        }
        let (from, to) = match (from, to) {
            (Some(from), Some(to)) => (from, to),
            (from, to) => self.framed(from, to, &projection, shapes),
        };
        let up = self.upright(from, to, up)?;
        Ok(Camera { from, to, up, projection })
    }

    fn framed(
        &mut self,
        from: Option<NodeId>,
        to: Option<NodeId>,
        projection: &Projection,
        shapes: &[Shape],
    ) -> (NodeId, NodeId) {
        let bounds = self.bounds(shapes);
        let view = VIEW.iter().map(|v| v * v).sum::<f64>().sqrt();
        let view = VIEW.map(|v| v / view);
        let ahead = self.graph.vector(&[0.0, 0.0, 1.0]);
        let Some((min, max)) = bounds else {
            // Nothing to frame: a view from the origin.
            return match (from, to) {
                (Some(from), _) => (from, self.graph.add(from, ahead)),
                (None, Some(to)) => {
                    let back = self.graph.vector(&view);
                    (self.graph.add(to, back), to)
                }
                (None, None) => (self.graph.vector(&[0.0; 3]), ahead),
            };
        };
        let center: [f64; 3] = std::array::from_fn(|i| 0.5 * (min[i] + max[i]));
        let mut radius = 0.5 * (0..3).map(|i| (max[i] - min[i]).powi(2)).sum::<f64>().sqrt();
        if radius == 0.0 {
            radius = 1.0;
        }
        let middle = self.graph.vector(&center);
        if let Some(from) = from {
            // From the centre itself there is no way to look at it.
            let same = self.at_defaults(from).is_some_and(|f| f == center);
            return (from, if same { self.graph.add(from, ahead) } else { middle });
        }
        let target = to.unwrap_or(middle);
        if let Some(at) = to.and_then(|to| self.at_defaults(to)) {
            radius += (0..3).map(|i| (at[i] - center[i]).powi(2)).sum::<f64>().sqrt();
        }
        let distance = match projection {
            Projection::Perspective { fov } => {
                let fov = self.at_defaults(*fov).and_then(|v| v.first().copied()).unwrap_or(FRAC_PI_4);
                let [width, height] = self.scene.image.size.map(|n| f64::from(n.max(1)));
                let half = (0.5 * fov).min(((0.5 * fov).tan() * width / height).atan());
                MARGIN * radius / half.sin()
            }
            Projection::Orthographic { .. } => 2.0 * radius,
            Projection::Panorama => {
                // All around from the middle, unless something is to be looked at.
                return match to {
                    Some(to) if self.at_defaults(to).is_some_and(|t| t != center) => (middle, to),
                    _ => (middle, self.graph.add(middle, ahead)),
                };
            }
        };
        let back = self.graph.vector(&view.map(|v| v * distance));
        let eye = self.graph.add(target, back);
        (self.folded(eye), target)
    }

    /// The camera's `up`, checked against its direction at the params' defaults.
    fn upright(&mut self, from: NodeId, to: NodeId, up: Option<NodeId>) -> Lowered<NodeId> {
        let camera = &self.scene.camera;
        let y = self.graph.vector(&[0.0, 1.0, 0.0]);
        let (Some(a), Some(b)) = (self.at_defaults(from), self.at_defaults(to)) else { return Ok(up.unwrap_or(y)) };
        let forward: [f64; 3] = std::array::from_fn(|i| b[i] - a[i]);
        let norm = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let size = norm(forward);
        let place = |d: Diagnostic| match (&camera.to, &camera.from, camera.span) {
            (Some(e), _, _) | (None, Some(e), _) => d.at(e.span, ""),
            (None, None, Some(span)) => d.at(span, ""),
            (None, None, None) => d,
        };
        if size == 0.0 || !size.is_finite() {
            return self.report(
                place(Diagnostic::error("E0512", "the camera stands where it looks"))
                    .note("`from` and `to` are the same place, so there is no direction")
                    .hint("move one of them"),
            );
        }
        let parallel = |up: [f64; 3]| {
            let cross = std::array::from_fn(|i| {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                forward[j] * up[k] - forward[k] * up[j]
            });
            norm(cross) <= 1e-9 * size * norm(up)
        };
        match up {
            Some(node) => {
                let value = self.at_defaults(node).and_then(|v| v.first_chunk::<3>().copied());
                if value.is_some_and(parallel) {
                    let span = camera.up.as_ref().map(|e| e.span);
                    let diagnostic = Diagnostic::error("E0512", "the camera's `up` points along its view");
                    let diagnostic = match span {
                        Some(span) => diagnostic.at(span, "parallel to the line from `from` to `to`, or zero"),
                        None => diagnostic,
                    };
                    return self.report(diagnostic.hint("choose an `up` across the direction of view"));
                }
                Ok(node)
            }
            // Looking straight up or down, +z is up in the picture.
            None if parallel([0.0, 1.0, 0.0]) => Ok(self.graph.vector(&[0.0, 0.0, 1.0])),
            None => Ok(y),
        }
    }

    /// The value of a node at the params' defaults, unless it varies within the picture or is read from voxels.
    fn at_defaults(&mut self, node: NodeId) -> Option<Vec<f64>> {
        if let Some(constant) = self.constant(node) {
            return Some(constant.values());
        }
        if self.graph.tiers()[node.0 as usize] > Tier::Frame || self.reads_voxels(node) {
            return None;
        }
        eval::evaluate_frame(&self.graph, &[node], &self.defaults(), 0.0).pop()
    }

    fn reads_voxels(&self, node: NodeId) -> bool {
        let live = self.graph.reachable(&[node]);
        let sampled = |id: &NodeId| matches!(self.graph.op(*id), Op::Sample { .. } | Op::SampleGradient { .. });
        self.graph.ids().filter(|id| live[id.0 as usize]).any(|id| sampled(&id))
    }

    /// Reports what varies more than it may.
    fn check_limits(&mut self) {
        if self.limits.is_empty() {
            return;
        }
        let tiers = self.graph.tiers();
        for (node, span, what, most) in std::mem::take(&mut self.limits) {
            if tiers[node.0 as usize] <= most {
                continue;
            }
            let (message, hint) = match most {
                Tier::Ray => (format!("{what} cannot depend on the position"), "it is infinitely far away: use `dir`"),
                Tier::Constant | Tier::Frame | Tier::Sample => (
                    format!("{what} cannot differ from place to place"),
                    "use constants, params and `time`; `p`, `dir` and grids are for fields",
                ),
            };
            let _ = self.report::<()>(
                Diagnostic::error("E0509", message).at(span, "this depends on where it is evaluated").hint(hint),
            );
        }
    }

    /// Reports what must not be zero but is.
    fn check_nonzero(&mut self) {
        let checks = std::mem::take(&mut self.nonzero);
        if checks.is_empty() || self.failed {
            return;
        }
        for (node, span, what) in checks {
            if self.at_defaults(node).is_some_and(|value| value.iter().all(|v| *v == 0.0)) {
                let _ = self.report::<()>(
                    Diagnostic::error("E0508", format!("{what} must not be 0"))
                        .at(span, "this is 0")
                        .note("judged at the defaults of the params"),
                );
            }
        }
    }
}
