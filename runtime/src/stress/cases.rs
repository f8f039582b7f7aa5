//! What is tried on a scene.

use super::files::Poison;
use crate::frame::{Ball, Camera, Params, Session, Vec3, View, bounded_media, with_unit};
use compiler::ir::eval::evaluate_frame;
use compiler::ir::{Composite, FieldScene, NodeId, Param, ParamType, Primitive, PrimitiveKind, Scattering};
use compiler::trial::Change;

/// One change of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Case {
    /// Which kind of change.
    pub group: &'static str,
    /// What is changed, in words.
    pub name: String,
}

/// How a case is brought about.
#[derive(Clone, Debug)]
pub(super) enum Twist {
    None,
    /// Params by number, in the graph's units.
    Params(Vec<(usize, Vec<f64>)>),
    Camera(Camera),
    Change(Change),
    Voxels(Poison),
    Size([u32; 2]),
}

/// Whether a diagnostic in place of a picture is right.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum Tolerance {
    /// The scene promises that it can be drawn.
    None,
    MayRefuse,
    MustRefuse,
}

/// What is known of the picture besides the reference.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum Expect {
    Nothing,
    /// That of the scene as it stands.
    Same,
    /// No more than 1 lx.
    AtMostOne,
    /// 1 lx everywhere.
    One,
}

#[derive(Clone, Debug)]
pub(super) struct Setup {
    pub(super) case: Case,
    pub(super) twist: Twist,
    pub(super) tolerance: Tolerance,
    pub(super) expect: Expect,
}

impl Setup {
    pub(super) fn plain(name: &str) -> Self {
        Self::new("scene", name, Twist::None)
    }

    fn new(group: &'static str, name: impl Into<String>, twist: Twist) -> Self {
        let case = Case { group, name: name.into() };
        Self { case, twist, tolerance: Tolerance::None, expect: Expect::Nothing }
    }

    fn may_refuse(self) -> Self {
        Self { tolerance: Tolerance::MayRefuse, ..self }
    }

    fn expect(self, expect: Expect) -> Self {
        Self { expect, ..self }
    }
}

/// A range is exceeded by so many times its own length.
const BEYOND: f64 = 10.0;
/// Distance of the far camera in radii of the scene.
const FAR: f64 = 1e7;
/// How far from the outline a grazing camera looks past, as a part of the radius.
const GRAZE: f64 = 1e-6;
/// Shapes on whose faces the camera is put.
const FACES: usize = 2;

/// Every case that applies to a scene.
pub(super) fn all(session: &Session, params: &Params) -> Vec<Setup> {
    let scene = &session.program().lowered;
    let mut setups = vec![Setup::plain("as it is")];
    setups.extend(of_params(scene));
    for (factor, words) in [(1e6, "a million times larger"), (1e-6, "a million times smaller")] {
        let twist = Twist::Change(Change::Lengths(factor));
        setups.push(Setup::new("lengths", format!("everything {words}"), twist).expect(Expect::Same));
    }
    if let Ok(camera) = session.camera(params, 0.0) {
        setups.extend(of_cameras(scene, params, camera));
    }
    if scene.render.composite == Composite::Radiance && !scene.media.is_empty() {
        setups.extend(of_matter(scene));
    }
    if !scene.graph.grids.is_empty() {
        for poison in Poison::ALL {
            let setup = Setup::new("voxels", format!("{} voxels", poison.name()), Twist::Voxels(poison));
            // A coefficient that a voxel makes negative is the file's fault, and is said.
            setups.push(if poison == Poison::Negative { setup.may_refuse() } else { setup });
        }
    }
    let none = Setup::new("size", "no pixels: 0 x 0", Twist::Size([0, 0]));
    setups.push(Setup { tolerance: Tolerance::MustRefuse, ..none });
    for size in [[1, 1], [16384, 1]] {
        setups.push(Setup::new("size", format!("{} x {}", size[0], size[1]), Twist::Size(size)));
    }
    setups
}

fn of_params(scene: &FieldScene) -> Vec<Setup> {
    let mut setups = vec![];
    let (mut least, mut most) = (vec![], vec![]);
    for (i, param) in scene.params.iter().enumerate() {
        let factor = scene.units.scale(param.dimension[0]);
        let at = |si: f64| (i, vec![si * factor; usize::from(param.ty.node_type().width())]);
        let name = |si: f64, what: &str| format!("`{}` at {}{what}", param.name, shown(param, si));
        if param.ty == ParamType::Bool {
            for truth in [0.0, 1.0] {
                setups.push(Setup::new("params", name(truth, ""), Twist::Params(vec![at(truth)])));
            }
            continue;
        }
        let Some((low, high)) = param.range else { continue };
        least.push(at(low));
        most.push(at(high));
        setups.push(Setup::new("params", name(low, ", its least"), Twist::Params(vec![at(low)])));
        setups.push(Setup::new("params", name(high, ", its most"), Twist::Params(vec![at(high)])));
        for si in [low - BEYOND * (high - low), high + BEYOND * (high - low)] {
            let twist = Twist::Params(vec![at(si)]);
            setups.push(Setup::new("params", name(si, ", beyond its range"), twist).may_refuse());
        }
    }
    if least.len() > 1 {
        setups.push(Setup::new("params", "all params at their least", Twist::Params(least)));
        setups.push(Setup::new("params", "all params at their most", Twist::Params(most)));
    }
    setups
}

fn shown(param: &Param, si: f64) -> String {
    match (param.ty, si) {
        (ParamType::Bool, 0.0) => "false".into(),
        (ParamType::Bool, _) => "true".into(),
        (ParamType::Float(_) | ParamType::Color, _) => with_unit(si, param),
    }
}

/// Point `at` along directions of the camera.
fn from(at: Vec3, steps: [(f64, Vec3); 2]) -> Vec3 {
    steps.into_iter().fold(at, |p, (t, d)| std::array::from_fn(|i| p[i] + t * d[i]))
}

fn of_cameras(scene: &FieldScene, params: &Params, camera: Camera) -> Vec<Setup> {
    let Camera { forward, right, .. } = camera;
    // Without bounds, what the camera has before it.
    let ball = bounded_media(scene, &params.0, 0.0)
        .unwrap_or_else(|| Ball { center: from(camera.from, [(1.0, forward), (0.0, right)]), radius: 1.0 });
    let (center, r) = (ball.center, ball.radius);
    let narrow = |tangent: f64| match camera.view {
        View::Perspective { .. } => View::Perspective { tangent },
        View::Orthographic { .. } => View::Orthographic { half_height: r },
        View::Panorama => View::Panorama,
    };
    let setup = |name: String, camera: Camera| Setup::new("camera", name, Twist::Camera(camera));
    let mut setups = vec![];
    let inside = from(center, [(0.1 * r, forward), (0.05 * r, right)]);
    setups.push(setup("camera inside".into(), Camera { from: inside, view: narrow(0.6), ..camera }));
    let far = from(center, [(-FAR * r, forward), (0.0, right)]);
    setups.push(setup(format!("camera at {FAR:e} radii"), Camera { from: far, view: narrow(1.2 / FAR), ..camera }));
    let past = from(center, [(-4.0 * r, forward), (r * (1.0 - GRAZE), right)]);
    setups.push(setup("camera grazing".into(), Camera { from: past, view: narrow(0.02), ..camera }));
    let mut primitives = vec![];
    scene.media.iter().for_each(|m| m.shape.primitives(&mut primitives));
    let faces = primitives.iter().filter_map(|p| face(scene, params, p));
    for (name, point, inwards) in faces.take(FACES) {
        // Along the face, exactly: one component of a ray in the middle of the picture is zero.
        let along = [inwards[1], inwards[2], inwards[0]];
        for (words, forward, up) in [("along", along, inwards), ("into", inwards, along)] {
            let right = crate::frame::vector::cross(forward, up);
            let camera = Camera { from: point, forward, right, up, view: narrow(0.6), ..camera };
            setups.push(setup(format!("camera on {name}, looking {words} it"), camera));
        }
    }
    setups
}

/// A point exactly on the face of a shape, and the direction into it.
fn face(scene: &FieldScene, params: &Params, primitive: &Primitive) -> Option<(&'static str, Vec3, Vec3)> {
    if primitive.from_world.is_some() {
        return None;
    }
    let value = |node: NodeId| evaluate_frame(&scene.graph, &[node], &params.0, 0.0).remove(0);
    let vector = |node: NodeId| {
        let v = value(node);
        std::array::from_fn::<f64, 3, _>(|i| v.get(i).or(v.last()).copied().unwrap_or(0.0))
    };
    let ball = |name, center: NodeId, radius: NodeId| {
        let (c, r) = (vector(center), value(radius)[0]);
        (name, [c[0] - r, c[1], c[2]], [1.0, 0.0, 0.0])
    };
    match primitive.kind {
        PrimitiveKind::Sphere { center, radius } => Some(ball("a sphere", center, radius)),
        PrimitiveKind::Shell { center, outer, .. } => Some(ball("a shell", center, outer)),
        PrimitiveKind::Box { min, max } => {
            let (low, high) = (vector(min), vector(max));
            let middle = |i: usize| 0.5 * (low[i] + high[i]);
            Some(("a box", [low[0], middle(1), middle(2)], [1.0, 0.0, 0.0]))
        }
        PrimitiveKind::Ellipsoid { .. }
        | PrimitiveKind::Slab { .. }
        | PrimitiveKind::Cylinder { .. }
        | PrimitiveKind::Sdf { .. } => None,
    }
}

fn of_matter(scene: &FieldScene) -> Vec<Setup> {
    let setup = |group, name: &str, change| Setup::new(group, name, Twist::Change(change));
    let mut setups = vec![
        setup("coefficients", "no matter: all coefficients 0", Change::Matter(0.0)),
        setup("coefficients", "hardly any matter: coefficients × 1e-30", Change::Matter(1e-30)),
        setup("coefficients", "coefficients × 1e6", Change::Matter(1e6)),
        setup("coefficients", "coefficients × 1e30", Change::Matter(1e30)),
        setup("coefficients", "absorption and scattering × 1e12", Change::Extinction(1e12)),
        setup("coefficients", "absorption and scattering × 1e30", Change::Extinction(1e30)),
    ];
    if scene.render.scattering == Scattering::Multiple {
        // Paths find collisions by a bound of the coefficient, which is at most 1e30.
        setups.iter_mut().for_each(|s| s.tolerance = Tolerance::MayRefuse);
    }
    let scatters = scene.media.iter().any(|m| scene.graph.number(m.k_s) != Some(0.0));
    if scatters && scene.render.scattering != Scattering::None {
        for g in [0.999999, -0.999999] {
            setups.push(setup("phase", &format!("mean cosine {g}"), Change::Asymmetry(g)));
        }
    }
    let expect = match scene.render.scattering {
        Scattering::None | Scattering::Single => Expect::AtMostOne,
        Scattering::Multiple => Expect::One,
    };
    setups.push(setup("furnace", "a white furnace", Change::Furnace).expect(expect));
    setups
}
