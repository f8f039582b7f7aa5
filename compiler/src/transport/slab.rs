//! Rays in slabs: what the stretch of a ray inside one slab sends and lets through, and what comes of all slabs together.
//!
//! A slab is short: where coefficients vary, they are taken from its middle and the exact exponential is used along it
//! (Hillaire 2015), which is of second order in the thickness. It is cut at every boundary of a shape, where a field jumps and
//! around what is narrow, so that order is kept there, and what has a closed form costs no sample.

use super::half::LightSlabs;
use super::shapes::{FAR, Ray};
use super::sheets::Nearest;
use super::trace::{Apart, State, Stretch, Traced, Tracer, cut_short, widen};
use crate::fields::Code;
use crate::program::kernel::{Expr, Function, FunctionId, Ty};
use crate::program::{FillPass, Ledger, StepRule};

/// What a piece of a ray gives, in this order where it is there.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Light towards the eye, in lx.
    Light,
    /// Optical depth.
    Depth,
    /// What the light may be wrong by beside the midpoint rule: f32.
    Error,
    /// As much of that as is rounding: f32.
    Rounding,
    /// Field evaluations: u32.
    Work,
    /// 0 or the code of a fault: u32.
    Fault,
}

impl Part {
    /// Its name in the shader.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Light => "radiance",
            Self::Depth => "depth",
            Self::Error => "error",
            Self::Rounding => "rounding",
            Self::Work => "work",
            Self::Fault => "fault",
        }
    }
}

/// The functions of a ray in pieces, which are blended.
pub(crate) struct Pieces {
    /// `slab(origin, direction, from, to)`, or of splats; where slabs are lit one after another, `plane` as well: how far the near one
    /// of its planes, as light meets them, is from the anchor along the normal; where steps are shared out, `part_of` as well: the length
    /// of what the piece is a part of, or 0 if it is the whole.
    pub(crate) piece: FunctionId,
    pub(crate) result: Ty,
    /// Whether it takes `part_of`.
    pub(crate) controlled: bool,
    /// Its fields, with their types.
    pub(crate) parts: Vec<(Part, Ty)>,
    /// `nearest`: where a surface ends the ray.
    nearest: Option<Nearest>,
    /// `whole(origin, direction, start, fault_at, parts …)`: the outputs, from the sums of all pieces. Without `fault_at` where
    /// there are no faults.
    pub(crate) whole: Traced,
    /// `footprint(coefficients …, length)`: what a stretch of this length with the extinction and emission in the order of
    /// `parts` sends and lets through.
    pub(crate) footprint: FunctionId,
    /// `means(coefficients …, length)`: the same backwards, from what a stretch sends and lets through to emission and extinction.
    pub(crate) means: FunctionId,
    /// `through_box(origin, direction, low, high)`: where a ray is inside a box.
    pub(crate) through_box: FunctionId,
    /// What light loses from slab to slab.
    pub(crate) light: Option<LightSlabs>,
    /// What fills the cache of light, and its entry point.
    pub(crate) fill: Option<(FillPass, Function)>,
}

impl Pieces {
    /// Where the ray ends: at a surface, or never.
    pub(crate) fn end(&self, code: &mut Code, origin: &Expr, direction: &Expr, start: &Expr) -> Expr {
        let Some(nearest) = self.nearest else { return Expr::F32(FAR) };
        let arguments = vec![origin.clone(), direction.clone(), start.clone(), Expr::F32(FAR)];
        code.bind("hit", nearest.result, Expr::Call(nearest.function, arguments)).field(0)
    }

    /// Where a part stands in the result of `piece`.
    pub(crate) fn place(&self, part: Part) -> Option<u32> {
        self.parts.iter().position(|p| p.0 == part).map(|i| i as u32)
    }
}

impl Tracer<'_> {
    /// Writes them.
    pub(crate) fn write_slabs(mut self, ledger: &mut Ledger) -> Pieces {
        let sdfs = self.sdfs();
        let fill = self.write_light(&sdfs, ledger);
        let reflected = self.write_reflected();
        let mut code = Code::new("slab", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let (from, to) = (code.parameter("from", Ty::F32), code.parameter("to", Ty::F32));
        let controlled =
            matches!(self.rule, StepRule::Adaptive(_) | StepRule::Fixed(_)) && !self.scene.matter.is_empty();
        let part_of = controlled.then(|| code.parameter("part_of", Ty::F32));
        self.plane = self.buffered.as_ref().map(|_| code.parameter("plane", Ty::F32));
        let state = self.declare(&mut code, ledger);
        self.follow(
            &mut code,
            &ray,
            &state,
            &sdfs,
            &Stretch { start: from, end: Some(to), whole: part_of },
            Some(ledger),
        );
        if let (Some(fault), true) = (state.fault, self.has_loops()) {
            let cut = cut_short(self.builder, &mut code);
            code.if_(cut, |code| code.set(fault, crate::program::Fault::CUT_SHORT));
        }
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let all = [
            (Part::Light, state.radiance, Ty::float(lw), Part::Light.name()),
            (Part::Depth, state.depth, Ty::float(dw), Part::Depth.name()),
            (Part::Error, state.error, Ty::F32, Part::Error.name()),
            (Part::Rounding, state.apart.rounding, Ty::F32, Part::Rounding.name()),
            (Part::Work, state.work, Ty::U32, Part::Work.name()),
            (Part::Fault, state.fault, Ty::U32, Part::Fault.name()),
        ];
        let there: Vec<_> = all.into_iter().filter_map(|(part, var, ty, name)| Some((part, var?, ty, name))).collect();
        // A struct has a field: nothing at all sends no light.
        let (fields, values): (Vec<_>, Vec<_>) = if there.is_empty() {
            (vec![(Part::Light.name().to_owned(), Ty::F32)], vec![Expr::F32(0.0)])
        } else {
            there.iter().map(|(_, var, ty, name)| (((*name).to_owned(), *ty), Expr::Local(*var))).unzip()
        };
        let result = self.builder.add_struct("Slab", fields);
        code.return_(Expr::Compose(result, values));
        let slab = self.builder.add_function(code.finish(Some(result)));
        let given: Vec<_> = there.iter().map(|t| (t.0, t.2)).collect();
        let footprint = self.write_footprint(&given, result, false);
        let means = self.write_footprint(&given, result, true);
        let light = self.buffered.as_ref().map(|b| b.slabs.clone());
        let nearest = self.nearest;
        let through_box = self.spans.boxes(self.builder);

        let mut code = Code::new("whole", None);
        let ray = Ray { origin: code.parameter("origin", Ty::VEC3), direction: code.parameter("direction", Ty::VEC3) };
        let start = code.parameter("start", Ty::F32);
        let fault_at = state.fault.map(|_| code.parameter("fault_at", Ty::VEC3));
        let mut sums = [None; 6];
        for (slot, (_, var, ty, name)) in sums.iter_mut().zip(all) {
            *slot = var.map(|_| {
                let given = code.parameter(&format!("{name}_of_all"), ty);
                code.var(name, ty, given)
            });
        }
        let [radiance, depth, error, rounding, work, fault] = sums;
        let fault_at = fault_at.map(|at| code.var("at", Ty::VEC3, at));
        // Slabs leave nothing out on purpose.
        let apart = Apart { rounding, ..Apart::default() };
        let state = State { depth, radiance, error, apart, work, fault, fault_at, projected: None };
        let hit = nearest.map(|nearest| {
            let arguments = vec![ray.origin.clone(), ray.direction.clone(), start, Expr::F32(FAR)];
            code.bind("hit", nearest.result, Expr::Call(nearest.function, arguments))
        });
        let whole = self.finish(code, &ray, &state, hit.as_ref(), reflected.as_ref());
        let parts = there.into_iter().map(|(part, _, ty, _)| (part, ty)).collect();
        Pieces { piece: slab, result, controlled, parts, nearest, whole, footprint, means, through_box, light, fill }
    }

    fn write_footprint(&mut self, parts: &[(Part, Ty)], result: Ty, back: bool) -> FunctionId {
        let (dw, lw) = (self.scene.depth_width, self.scene.light_width);
        let mut code = Code::new(if back { "means" } else { "footprint" }, None);
        let mut given = |part: Part, name: &str| {
            let ty = parts.iter().find(|p| p.0 == part)?.1;
            Some(code.parameter(name, ty))
        };
        let names = if back { ["light", "depth"] } else { ["emission", "extinction"] };
        let (first, second) = (given(Part::Light, names[0]), given(Part::Depth, names[1]));
        let length = code.parameter("length", Ty::F32);
        let by = |value: Expr, width: u8| {
            let length = length.clone().splat(width);
            if back { value / length } else { value * length }
        };
        let depth = second.clone().map(|k| code.bind("along", Ty::float(dw), by(k, dw)));
        let light = first.map(|e| {
            let light = by(e, lw);
            // Light that is attenuated on its way out of the stretch, by the depth of all of it.
            match if back { &second } else { &depth } {
                Some(depth) => {
                    let mean = self.attenuated(&mut code, depth.clone(), dw);
                    let mean = widen(mean, dw, lw);
                    if back { light / mean.max(Expr::F32(1e-30).splat(lw)) } else { light * mean }
                }
                None => light,
            }
        });
        let value = |(part, ty): &(Part, Ty)| match part {
            Part::Light => light.clone().expect("it is there"),
            Part::Depth => depth.clone().expect("it is there"),
            Part::Error | Part::Rounding => Expr::F32(0.0),
            Part::Work | Part::Fault => {
                debug_assert_eq!(*ty, Ty::U32);
                Expr::U32(0)
            }
        };
        let values: Vec<Expr> = if parts.is_empty() { vec![Expr::F32(0.0)] } else { parts.iter().map(value).collect() };
        code.return_(Expr::Compose(result, values));
        self.builder.add_function(code.finish(Some(result)))
    }
}
