//! The function `survey(origin, direction, start)`: a number for what a ray meets, without a look at any field. Rays that meet the
//! same are alike enough that what one sees may be guessed from the others: the pixels of an edge-aware upsampling
//! (Kopf et al. 2007) are told apart by it.
//!
//! It counts which shapes of media a ray meets before a surface stops it, and whether it begins in them; which surface that is, and from
//! which lights it has the shadow of another; and whether the ray ends in the disc of a sun.

use super::shapes::{FAR, Ray, primitive_span};
use super::trace::{Tracer, largest};
use crate::fields::Code;
use crate::ir::PrimitiveKind;
use crate::program::kernel::{Expr, FunctionId, Ty};

/// An odd multiplier that spreads what differs over all bits (Knuth, The Art of Computer Programming 3, §6.4).
const SPREAD: u32 = 2_654_435_761;

impl Tracer<'_> {
    /// Whether everything that a ray meets is known before it is followed.
    pub(crate) fn is_surveyable(&self) -> bool {
        self.scene.primitives.iter().all(|p| match p.kind {
            PrimitiveKind::Sphere { .. }
            | PrimitiveKind::Ellipsoid { .. }
            | PrimitiveKind::Box { .. }
            | PrimitiveKind::Slab { .. }
            | PrimitiveKind::Cylinder { .. } => true,
            PrimitiveKind::Shell { .. } | PrimitiveKind::Sdf { .. } => false,
        })
    }

    /// Writes the function.
    pub(crate) fn write_survey(mut self) -> FunctionId {
        let nearest = self.write_nearest();
        let mut code = Code::new("survey", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let start = code.parameter("start", Ty::F32);
        let number = code.var("number", Ty::U32, 0u32);
        let count = |code: &mut Code, more: Expr| {
            code.set(number, Expr::Local(number) * SPREAD + more);
        };
        let mut end = Expr::F32(FAR);
        if let Some(nearest) = nearest {
            let arguments = vec![ray.origin.clone(), ray.direction.clone(), start.clone(), Expr::F32(FAR)];
            let hit = code.bind("hit", nearest.result, Expr::Call(nearest.function, arguments));
            end = code.bind("end", Ty::F32, hit.clone().field(0));
            let (met, normal) = (end.clone().less(FAR), hit.clone().field(1));
            count(&mut code, met.clone().select(hit.field(2) + 1u32, Expr::U32(0)));
            code.open();
            let at = code.bind("at", Ty::VEC3, ray.at(end.clone()));
            let at = Self::above(&mut code, at, &normal, &end);
            for light in self.scene.lights.clone() {
                let (to, limit) = self.towards(&mut code, &at, &light);
                let arguments = vec![at.clone(), to, Expr::F32(0.0), limit.clone()];
                let between = Expr::Call(nearest.function, arguments).field(0).less(limit);
                count(&mut code, between.select(Expr::U32(1), Expr::U32(0)));
            }
            let seen = code.close();
            code.push_if(met, seen);
        }
        for (i, primitive) in self.scene.primitives.iter().enumerate() {
            let name = format!("shape_{i}");
            let span = primitive_span(self.graph, self.builder, &mut self.spans, &mut code, &ray, primitive, &name);
            let Some(span) = span else { continue };
            let (a, b) = (span.clone().component(0), span.component(1));
            let met = b.greater(a.clone().max(start.clone())).and(a.clone().less(end.clone()));
            let how = a.less_equal(start.clone()).select(Expr::U32(2), Expr::U32(1));
            count(&mut code, met.select(how, Expr::U32(0)));
        }
        if let Some(discs) = self.discs(&mut code, &ray) {
            let seen = largest(discs, self.scene.light_width).greater(0.0).and(end.greater_equal(FAR));
            count(&mut code, seen.select(Expr::U32(1), Expr::U32(0)));
        }
        code.return_(Expr::Local(number));
        self.builder.add_function(code.finish(Some(Ty::U32)))
    }
}
