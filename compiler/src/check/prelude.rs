//! The functions of the prelude that are not written in the library: names, parameters, and the types of those that
//! have one type only. What the generic ones make of their arguments stands in [`super::builtins`].

use super::hir::{Builtin, Dim};
use super::types::{D, Form, Ty};

/// A parameter of the prelude.
#[derive(Copy, Clone, Debug)]
pub(super) struct Parameter {
    pub(super) name: &'static str,
    /// Its type where it has only one.
    pub(super) ty: Option<Ty>,
    /// How a signature shows its type.
    pub(super) shown: &'static str,
    /// May be left out.
    pub(super) optional: bool,
}

/// A function of the prelude.
#[derive(Copy, Clone, Debug)]
pub(super) struct Signature {
    pub(super) name: &'static str,
    pub(super) builtin: Builtin,
    pub(super) parameters: &'static [Parameter],
    /// Any number of arguments, two at least, all like the first parameter.
    pub(super) variadic: bool,
    pub(super) result: &'static str,
}

const fn any(name: &'static str, shown: &'static str) -> Parameter {
    Parameter { name, ty: None, shown, optional: false }
}

const fn typed(name: &'static str, ty: Ty, shown: &'static str) -> Parameter {
    Parameter { name, ty: Some(ty), shown, optional: false }
}

const fn optional(parameter: Parameter) -> Parameter {
    Parameter { optional: true, ..parameter }
}

const NUMBER: Ty = Ty::NUMBER;
const LENGTH: Ty = Ty::scalar(Dim::LENGTH);
const VECTOR: Ty = Ty::Numeric(Form::Vec3, D::NONE);
const POINT: Ty = Ty::vec3(Dim::LENGTH);

const X: &[Parameter] = &[any("x", "number")];
const ANY_X: &[Parameter] = &[any("x", "any")];
const AB: &[Parameter] = &[any("a", "any"), any("b", "any")];
const SHAPES: &[Parameter] = &[typed("a", Ty::Shape, "shape")];
const SPHERES: &[Parameter] = &[
    any("radius", "length"),
    any("index", "number or vec2"),
    optional(any("spread", "number")),
    optional(any("k", "number")),
];
const SPHERES_AT: &[Parameter] = &[
    any("radius", "length"),
    any("index", "number or vec2"),
    optional(any("spread", "number")),
    optional(any("k", "number")),
    optional(typed("cos_theta", NUMBER, "number")),
];
const REGION: &[Parameter] = &[any("region", "grid or shape")];

const fn plain(
    name: &'static str,
    builtin: Builtin,
    parameters: &'static [Parameter],
    result: &'static str,
) -> Signature {
    Signature { name, builtin, parameters, variadic: false, result }
}

const fn variadic(
    name: &'static str,
    builtin: Builtin,
    parameters: &'static [Parameter],
    result: &'static str,
) -> Signature {
    Signature { name, builtin, parameters, variadic: true, result }
}

/// All of them.
#[rustfmt::skip]
pub(super) const SIGNATURES: &[Signature] = &[
    plain("exp", Builtin::Exp, X, "number"),
    plain("expm1", Builtin::Expm1, X, "number"),
    plain("log", Builtin::Log, X, "number"),
    plain("log2", Builtin::Log2, X, "number"),
    plain("log10", Builtin::Log10, X, "number"),
    plain("exp2", Builtin::Exp2, X, "number"),
    plain("sqrt", Builtin::Sqrt, ANY_X, "any^(1/2)"),
    plain("cbrt", Builtin::Cbrt, ANY_X, "any^(1/3)"),
    plain("sin", Builtin::Sin, X, "number"),
    plain("cos", Builtin::Cos, X, "number"),
    plain("tan", Builtin::Tan, X, "number"),
    plain("asin", Builtin::Asin, X, "number"),
    plain("acos", Builtin::Acos, X, "number"),
    plain("atan", Builtin::Atan, X, "number"),
    plain("sinh", Builtin::Sinh, X, "number"),
    plain("cosh", Builtin::Cosh, X, "number"),
    plain("tanh", Builtin::Tanh, X, "number"),
    plain("abs", Builtin::Abs, ANY_X, "any"),
    plain("sign", Builtin::Sign, ANY_X, "number"),
    plain("floor", Builtin::Floor, X, "number"),
    plain("ceil", Builtin::Ceil, X, "number"),
    plain("round", Builtin::Round, X, "number"),
    plain("fract", Builtin::Fract, X, "number"),
    plain("atan2", Builtin::Atan2, &[any("y", "any"), any("x", "any")], "number"),
    variadic("min", Builtin::Min, &[any("a", "any")], "any"),
    variadic("max", Builtin::Max, &[any("a", "any")], "any"),
    plain("pow", Builtin::Pow, &[any("a", "any"), any("b", "number")], "any^b"),
    plain("mod", Builtin::Mod, AB, "any"),
    plain("clamp", Builtin::Clamp, &[any("x", "any"), any("low", "any"), any("high", "any")], "any"),
    plain("mix", Builtin::Mix, &[any("a", "any"), any("b", "any"), any("t", "number")], "any"),
    plain("step", Builtin::Step, &[any("edge", "any"), any("x", "any")], "number"),
    plain("smoothstep", Builtin::Smoothstep, &[any("low", "any"), any("high", "any"), any("x", "any")], "number"),
    plain("dot", Builtin::Dot, &[any("a", "vec3<any>"), any("b", "vec3<any>")], "any"),
    plain("cross", Builtin::Cross, &[any("a", "vec3<any>"), any("b", "vec3<any>")], "vec3<any>"),
    plain("length", Builtin::Length, &[any("v", "vec3<any>")], "any"),
    plain("distance", Builtin::Distance, &[any("a", "vec3<any>"), any("b", "vec3<any>")], "any"),
    plain("normalize", Builtin::Normalize, &[any("v", "vec3<any>")], "vec3"),
    plain("reflect", Builtin::Reflect, &[any("incident", "vec3<any>"), typed("normal", VECTOR, "vec3")], "vec3<any>"),
    plain("vec2", Builtin::Vec2, &[any("x", "any"), optional(any("y", "any"))], "vec2<any>"),
    plain("vec3", Builtin::Vec3, &[any("x", "any"), optional(any("y", "any")), optional(any("z", "any"))], "vec3<any>"),
    plain("rgb", Builtin::Rgb, &[any("r", "any"), any("g", "any"), any("b", "any")], "spectrum<any>"),
    plain("luminance", Builtin::Luminance, &[typed("color", Ty::Color, "color")], "number"),
    plain("color", Builtin::Color, &[typed("r", NUMBER, "number"), typed("g", NUMBER, "number"), typed("b", NUMBER, "number")], "color"),
    plain("layer", Builtin::Layer, &[typed("color", Ty::Color, "color"), typed("k", Ty::scalar(Dim::COEFFICIENT), "1/length")], "layer"),
    plain("opacity", Builtin::Opacity, &[typed("a", NUMBER, "number"), typed("per", LENGTH, "length")], "1/length"),
    plain("gradient", Builtin::Gradient, &[any("f", "field or grid"), any("p", "vec3<any>")], "vec3<any>"),
    plain("mie", Builtin::Mie, SPHERES_AT, "spectrum"),
    plain("mie_scattering", Builtin::MieScattering, SPHERES, "spectrum<length^2>"),
    plain("mie_absorption", Builtin::MieAbsorption, SPHERES, "spectrum<length^2>"),
    plain("mie_extinction", Builtin::MieExtinction, SPHERES, "spectrum<length^2>"),
    plain("cell_hash", Builtin::CellHash, &[typed("cell", VECTOR, "vec3"), optional(typed("seed", NUMBER, "number"))], "number"),
    plain("cell_hash3", Builtin::CellHash3, &[typed("cell", VECTOR, "vec3"), optional(typed("seed", NUMBER, "number"))], "vec3"),
    plain("sphere", Builtin::Sphere, &[typed("center", POINT, "vec3<length>"), typed("radius", LENGTH, "length")], "shape"),
    plain("ellipsoid", Builtin::Ellipsoid, &[typed("center", POINT, "vec3<length>"), typed("radii", POINT, "vec3<length>")], "shape"),
    plain("box", Builtin::Box, &[typed("min", POINT, "vec3<length>"), typed("max", POINT, "vec3<length>")], "shape"),
    plain("slab", Builtin::Slab, &[typed("axis", VECTOR, "vec3"), typed("from", LENGTH, "length"), typed("to", LENGTH, "length")], "shape"),
    plain("cylinder", Builtin::Cylinder, &[typed("from", POINT, "vec3<length>"), typed("to", POINT, "vec3<length>"), typed("radius", LENGTH, "length")], "shape"),
    plain("shell", Builtin::Shell, &[typed("center", POINT, "vec3<length>"), typed("inner", LENGTH, "length"), typed("outer", LENGTH, "length")], "shape"),
    plain("bounds", Builtin::Bounds, &[any("of", "grid or splats")], "shape"),
    plain("sdf", Builtin::Sdf, &[typed("field", LENGTH, "length")], "shape"),
    plain("everywhere", Builtin::Everywhere, &[], "shape"),
    variadic("union", Builtin::Union, SHAPES, "shape"),
    variadic("intersection", Builtin::Intersection, SHAPES, "shape"),
    variadic("difference", Builtin::Difference, SHAPES, "shape"),
    plain("center", Builtin::Center, REGION, "vec3<length>"),
    plain("min_corner", Builtin::MinCorner, REGION, "vec3<length>"),
    plain("max_corner", Builtin::MaxCorner, REGION, "vec3<length>"),
    plain("size", Builtin::Size, REGION, "vec3<length>"),
    plain("translate", Builtin::Translate, &[typed("offset", POINT, "vec3<length>")], "transform"),
    plain("rotate", Builtin::Rotate, &[typed("axis", VECTOR, "vec3"), typed("angle", NUMBER, "number")], "transform"),
    plain("scale", Builtin::Scale, &[any("factor", "number or vec3")], "transform"),
];

/// The function of this name.
pub(super) fn signature(name: &str) -> Option<&'static Signature> {
    SIGNATURES.iter().find(|s| s.name == name)
}

impl Signature {
    /// As it would be declared: `sphere(center: vec3<length>, radius: length) -> shape`.
    pub(super) fn shown(&self) -> String {
        let parameters: Vec<String> = self
            .parameters
            .iter()
            .map(|p| if p.optional { format!("{}?: {}", p.name, p.shown) } else { format!("{}: {}", p.name, p.shown) })
            .collect();
        let parameters = if self.variadic {
            let shown = self.parameters.first().map_or("any", |p| p.shown);
            format!("a: {shown}, b: {shown}, …")
        } else {
            parameters.join(", ")
        };
        format!("{}({parameters}) -> {}", self.name, self.result)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_and_checking_know_the_same_prelude() {
        let here: BTreeSet<&str> = SIGNATURES.iter().map(|s| s.name).collect();
        let there: BTreeSet<&str> = crate::resolve::FUNCTIONS.iter().copied().collect();
        assert_eq!(here, there);
    }
}
