//! Where rays come from: the camera, by the formulas of [`crate::program::FrameValue`], or a list.

use crate::fields::{Code, KernelBuilder};
use crate::ir::Projection;
use crate::program::FrameValue;
use crate::program::kernel::{Expr, FunctionId, Math, Ty};

/// A ray in a function.
pub(crate) struct Start {
    pub(crate) origin: Expr,
    pub(crate) direction: Expr,
    /// Least t that counts.
    pub(crate) from: Expr,
}

/// The function `camera_ray(x, y)`: the ray through a point of the picture, in pixels from the top left corner.
pub(crate) struct Camera {
    function: FunctionId,
    result: Ty,
}

impl Camera {
    pub(crate) fn new(builder: &mut KernelBuilder, projection: Projection) -> Self {
        let fields = [("origin", Ty::VEC3), ("direction", Ty::VEC3), ("from_t", Ty::F32)];
        let result = builder.add_struct("CameraRay", fields.map(|(n, ty)| (n.to_owned(), ty)).into());
        let mut code = Code::new("camera_ray", None);
        let x = code.parameter("x", Ty::F32);
        let y = code.parameter("y", Ty::F32);
        let start = camera(builder, &mut code, projection, x, y);
        code.return_(Expr::Compose(result, vec![start.origin, start.direction, start.from]));
        let function = builder.add_function(code.finish(Some(result)));
        Self { function, result }
    }

    /// Calls it.
    pub(crate) fn ray(&self, code: &mut Code, name: &str, x: Expr, y: Expr) -> Start {
        let ray = code.bind(name, self.result, Expr::Call(self.function, vec![x, y]));
        Start { origin: ray.clone().field(0), direction: ray.clone().field(1), from: ray.field(2) }
    }
}

/// Writes the ray through the point (x, y).
fn camera(builder: &mut KernelBuilder, code: &mut Code, projection: Projection, x: Expr, y: Expr) -> Start {
    let size = builder.frame(FrameValue::ImageSize).convert(crate::program::kernel::Prim::F32);
    let size = code.bind("size", Ty::float(2), size);
    let (width, height) = (size.clone().component(0), size.component(1));
    let anchor = builder.frame(FrameValue::CameraAnchor);
    let right = builder.frame(FrameValue::CameraRight);
    let up = builder.frame(FrameValue::CameraUp);
    let forward = builder.frame(FrameValue::CameraForward);
    match projection {
        Projection::Perspective { .. } => {
            let plane = builder.frame(FrameValue::CameraPlane);
            let side = across(code, &right, &up, x, y, &width, &height);
            let toward = code.bind("toward", Ty::VEC3, forward + side.clone());
            let length = code.bind("toward_length", Ty::F32, Expr::math(Math::Length, [toward.clone()]));
            let origin = code.bind("origin", Ty::VEC3, anchor + side * plane.clone().splat(3));
            let direction = code.bind("direction", Ty::VEC3, toward / length.clone().splat(3));
            Start { origin, direction, from: -(plane * length) }
        }
        Projection::Orthographic { .. } => {
            let plane = builder.frame(FrameValue::CameraPlane);
            let side = across(code, &right, &up, x, y, &width, &height);
            let origin = code.bind("origin", Ty::VEC3, anchor + side);
            Start { origin, direction: forward, from: -plane }
        }
        Projection::Panorama => {
            let pi = std::f64::consts::PI;
            let longitude = code.bind("longitude", Ty::F32, (x * 2.0 / width - 1.0) * pi);
            let latitude = code.bind("latitude", Ty::F32, (Expr::F32(0.5) - y / height) * pi);
            let (sin, cos) =
                (|a: &Expr| Expr::math(Math::Sin, [a.clone()]), |a: &Expr| Expr::math(Math::Cos, [a.clone()]));
            let flat = right * sin(&longitude).splat(3) + forward * cos(&longitude).splat(3);
            let direction = flat * cos(&latitude).splat(3) + up * sin(&latitude).splat(3);
            let direction = code.bind("direction", Ty::VEC3, Expr::math(Math::Normalize, [direction]));
            Start { origin: anchor, direction, from: Expr::F32(0.0) }
        }
    }
}

fn across(code: &mut Code, right: &Expr, up: &Expr, x: Expr, y: Expr, width: &Expr, height: &Expr) -> Expr {
    let u = code.bind("u", Ty::F32, (x * 2.0 - width.clone()) / height.clone());
    let v = code.bind("v", Ty::F32, Expr::F32(1.0) - y * 2.0 / height.clone());
    code.bind("side", Ty::VEC3, right.clone() * u.splat(3) + up.clone() * v.splat(3))
}

/// Reads ray number `index` of the list.
pub(crate) fn list(builder: &mut KernelBuilder, code: &mut Code, index: &Expr) -> Start {
    let rays = builder.rays();
    let at = |i: u32| Expr::load(rays, index.clone() * 8u32 + i);
    let three = |i: u32| Expr::Compose(Ty::VEC3, vec![at(i), at(i + 1), at(i + 2)]);
    let origin = code.bind("origin", Ty::VEC3, three(0));
    let direction = code.bind("direction", Ty::VEC3, three(4));
    Start { origin, direction, from: at(3) }
}

/// Offset of sample `index` of `count` within its pixel, as (x, y) in 0..1; the same points as the host's.
///
/// A square number makes a regular grid of cell centres; any other count the R2 sequence (Roberts 2018).
pub(crate) fn sample_offset(code: &mut Code, index: Expr, count: u32) -> (Expr, Expr) {
    let root = f64::from(count).sqrt().round() as u32;
    if root * root == count {
        let side = f64::from(root);
        let column = index.clone() - Expr::math(Math::Floor, [index.clone() / side]) * side;
        let row = Expr::math(Math::Floor, [index / side]);
        return ((column + 0.5) / side, (row + 0.5) / side);
    }
    let fract = |code: &mut Code, name: &str, x: Expr| {
        let x = code.bind(name, Ty::F32, x);
        x.clone() - Expr::math(Math::Floor, [x])
    };
    let x = fract(code, "sequence_x", index.clone() * 0.754_877_666_246_692_7 + 0.5);
    let y = fract(code, "sequence_y", index * 0.569_840_290_998_053_2 + 0.5);
    (x, y)
}

/// A function of the pixel is called once per sample; its result is a struct.
pub(crate) fn call(function: FunctionId, start: &Start) -> Expr {
    Expr::Call(function, vec![start.origin.clone(), start.direction.clone(), start.from.clone()])
}
