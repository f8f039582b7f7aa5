//! Rays in slabs: what the stretch of a ray inside one slab sends and lets through, and what comes of all slabs together.
//!
//! A slab is short: where coefficients vary, they are taken from its middle and the exact exponential is used along it
//! (Hillaire 2015), which is of second order in the thickness. It is cut at every boundary of a shape, so that order is
//! kept there, and what has a closed form costs no sample.

use super::shapes::{FAR, Ray};
use super::sheets::Nearest;
use super::trace::{State, Stretch, Traced, Tracer};
use crate::fields::Code;
use crate::program::kernel::{Expr, Function, FunctionId, Ty};
use crate::program::{FillPass, Ledger};

/// What a slab gives, in this order where it is there.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Light towards the eye, in lx.
    Light,
    /// Optical depth.
    Depth,
    /// What the light may be wrong by beside the midpoint rule: f32.
    Error,
    /// Field evaluations: u32.
    Work,
    /// 0 or the code of a fault: u32.
    Fault,
}

/// The functions of a ray in slabs.
pub(crate) struct Slabs {
    /// `slab(origin, direction, from, to)`.
    pub(crate) slab: FunctionId,
    pub(crate) result: Ty,
    /// Its fields, with their types.
    pub(crate) parts: Vec<(Part, Ty)>,
    /// `nearest`: where a surface ends the ray.
    nearest: Option<Nearest>,
    /// `whole(origin, direction, start, fault_at, parts …)`: the outputs, from the sums of all slabs. Without `fault_at` where
    /// there are no faults.
    pub(crate) whole: Traced,
    /// `through_box(origin, direction, low, high)`: where a ray is inside a box.
    pub(crate) through_box: FunctionId,
    /// What fills the cache of light, and its entry point.
    pub(crate) fill: Option<(FillPass, Function)>,
}

impl Slabs {
    /// Where the ray ends: at a surface, or never.
    pub(crate) fn end(&self, code: &mut Code, origin: &Expr, direction: &Expr, start: &Expr) -> Expr {
        let Some(nearest) = self.nearest else { return Expr::F32(FAR) };
        let arguments = vec![origin.clone(), direction.clone(), start.clone(), Expr::F32(FAR)];
        code.bind("hit", nearest.result, Expr::Call(nearest.function, arguments)).field(0)
    }

    /// Where a part stands in the result of `slab`.
    pub(crate) fn place(&self, part: Part) -> Option<u32> {
        self.parts.iter().position(|p| p.0 == part).map(|i| i as u32)
    }
}

impl Tracer<'_> {
    /// Writes them.
    pub(crate) fn write_slabs(mut self, ledger: &mut Ledger) -> Slabs {
        let sdfs = self.sdfs();
        let fill = self.write_light(&sdfs, ledger);
        let reflected = self.write_reflected();
        let mut code = Code::new("slab", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let (from, to) = (code.parameter("from", Ty::F32), code.parameter("to", Ty::F32));
        let state = self.declare(&mut code, ledger);
        self.follow(&mut code, &ray, &state, &sdfs, &Stretch { start: from, end: Some(to) }, Some(ledger));
        if let (Some(fault), true) = (state.fault, self.has_loops()) {
            let cut = self.cut_short(&mut code);
            code.if_(cut, |code| code.set(fault, crate::program::Fault::CUT_SHORT));
        }
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let all = [
            (Part::Light, state.radiance, Ty::float(lw), "light"),
            (Part::Depth, state.depth, Ty::float(dw), "depth"),
            (Part::Error, state.error, Ty::F32, "error"),
            (Part::Work, state.work, Ty::U32, "work"),
            (Part::Fault, state.fault, Ty::U32, "fault"),
        ];
        let there: Vec<_> = all.into_iter().filter_map(|(part, var, ty, name)| Some((part, var?, ty, name))).collect();
        // A struct has a field: nothing at all sends no light.
        let (fields, values): (Vec<_>, Vec<_>) = if there.is_empty() {
            (vec![("light".to_owned(), Ty::F32)], vec![Expr::F32(0.0)])
        } else {
            there.iter().map(|(_, var, ty, name)| (((*name).to_owned(), *ty), Expr::Local(*var))).unzip()
        };
        let result = self.builder.add_struct("Slab", fields);
        code.return_(Expr::Compose(result, values));
        let slab = self.builder.add_function(code.finish(Some(result)));
        let nearest = self.nearest;
        let through_box = self.spans.boxes(self.builder);

        let mut code = Code::new("whole", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let start = code.parameter("start", Ty::F32);
        let fault_at = state.fault.map(|_| code.parameter("fault_at", Ty::VEC3));
        let mut sums = [None; 5];
        for (slot, (_, var, ty, name)) in sums.iter_mut().zip(all) {
            *slot = var.map(|_| {
                let given = code.parameter(&format!("{name}_of_slabs"), ty);
                code.var(name, ty, given)
            });
        }
        let [radiance, depth, error, work, fault] = sums;
        let fault_at = fault_at.map(|at| code.var("at", Ty::VEC3, at));
        let state = State { depth, radiance, error, work, fault, fault_at, projected: None };
        let hit = nearest.map(|nearest| {
            let arguments = vec![ray.origin.clone(), ray.direction.clone(), start, Expr::F32(FAR)];
            code.bind("hit", nearest.result, Expr::Call(nearest.function, arguments))
        });
        let whole = self.finish(code, &ray, &state, hit.as_ref(), reflected.as_ref());
        let parts = there.into_iter().map(|(part, _, ty, _)| (part, ty)).collect();
        Slabs { slab, result, parts, nearest, whole, through_box, fill }
    }
}
