//! Light of an environment from the few directions whose columns are kept.

use super::cache::{Channel, SKY};
use super::light::{Gathered, LightSample, Receiver};
use super::matter::Phase;
use super::shapes::FAR;
use super::trace::{Tracer, largest, least, widen};
use crate::fields::Code;
use crate::ir::NodeId;
use crate::program::kernel::{Expr, LocalId, Ty};
use std::f64::consts::PI;

/// The solid angle that each direction stands for.
const SOLID: f64 = 4.0 * PI / SKY as f64;

/// What media gather of the sky, apart from other lights: so few directions do not integrate a phase function to 1, least of all one with
/// a narrow lobe that may lie between them. They are told to; how much that changes is how little they tell.
pub(super) struct KeptSky {
    gathered: Gathered,
    /// Sums of each phase function over the directions; none of those that are the same in each.
    phases: Vec<Option<LocalId>>,
    /// Components of light.
    width: u8,
}

impl KeptSky {
    /// Where a sample of the sky goes that counts with these values of the phase functions.
    pub(super) fn gathering(&self, code: &mut Code, weights: &[Expr]) -> &Gathered {
        for (phase, weight) in self.phases.iter().zip(weights) {
            if let Some(phase) = phase {
                code.add(*phase, weight.clone());
            }
        }
        &self.gathered
    }

    /// Adds it to what other lights bring.
    pub(super) fn add_to(&self, code: &mut Code, others: &Gathered) {
        let wide = |value: f64| Expr::F32(value).splat(self.width);
        // By how much a phase function is too little or too much over the directions, and how little it is at least.
        let mut lacking = Expr::F32(0.0);
        let mut smallest = Expr::F32(1.0);
        for ((sum, own), phase) in others.sums.iter().zip(&self.gathered.sums).zip(&self.phases) {
            let Some(phase) = phase else {
                code.add(*sum, *own);
                continue;
            };
            let whole = (Expr::Local(*phase) * wide(SOLID)).max(wide(1e-20));
            let whole = code.bind("whole_phase", Ty::float(self.width), whole);
            code.add(*sum, Expr::Local(*own) / whole.clone());
            lacking = lacking.max(largest((wide(1.0) - whole.clone()).abs(), self.width));
            smallest = smallest.min(least(whole, self.width));
        }
        self.gathered.count_alternating(code);
        if let (Some(error), Some(own), Some(brightest)) = (others.error, self.gathered.error, self.gathered.brightest)
        {
            code.add(error, Expr::Local(own) / smallest + lacking.min(1.0) * Expr::Local(brightest) * (1.0 / SOLID));
        }
    }
}

impl Tracer<'_> {
    /// Takes the sky apart where its directions are kept.
    pub(super) fn kept_sky(&self, code: &mut Code, gathered: &mut Gathered) -> Option<KeptSky> {
        if self.cache.is_none() || !self.scene.environment {
            return None;
        }
        let lw = self.scene.light_width;
        let count = gathered.sums.len();
        let sums = (0..count).map(|i| code.var(&format!("sky_{i}"), Ty::float(lw), Expr::F32(0.0).splat(lw)));
        let sums = sums.collect();
        let (alternating, others) = gathered.alternating.drain(..).partition(|(number, _)| number.is_none());
        gathered.alternating = others;
        let mut told = |name: &str| gathered.error.map(|_| code.var(name, Ty::F32, 0.0));
        let (error, brightest) = (told("sky_error"), told("brightest"));
        let functions = self.scene.phases.iter().enumerate();
        let sum = |(i, phase): (usize, &Phase)| {
            phase.node.map(|_| code.var(&format!("phases_{i}"), Ty::float(lw), Expr::F32(0.0).splat(lw)))
        };
        let phases = functions.map(sum).collect();
        let own = Gathered {
            sums,
            alternating,
            error,
            unsure: gathered.unsure.clone(),
            k_open: gathered.k_open.clone(),
            plane: gathered.plane.clone(),
            work: gathered.work,
            brightest,
        };
        Some(KeptSky { gathered: own, phases, width: lw })
    }

    /// The directions whose columns are kept, the same at every place.
    pub(super) fn kept_environment(
        &mut self,
        code: &mut Code,
        receiver: &Receiver<'_>,
        node: NodeId,
        each: &mut dyn FnMut(&mut Self, &mut Code, &LightSample),
    ) {
        let lw = self.scene.light_width;
        let solid = match receiver {
            // So few directions do not integrate every orientation's cosine to π: they are told to.
            Receiver::Surface { normal } => {
                let cosines = code.var("cosines", Ty::F32, 1e-3);
                let j = code.var("direction_number", Ty::F32, 0.0);
                code.open();
                let to = Self::sky_direction(code, &j.into());
                code.add(cosines, to.dot((*normal).clone()).max(0.0));
                code.add(j, 1.0);
                code.break_if(Expr::Local(j).greater_equal(f64::from(SKY)));
                let block = code.close();
                code.push_loop(block);
                code.bind("solid", Ty::F32, Expr::F32(PI) / Expr::Local(cosines))
            }
            Receiver::Medium { .. } | Receiver::Path { .. } => Expr::F32(4.0 * PI / f64::from(SKY)),
        };
        let i = code.var("of_light", Ty::F32, 0.0);
        code.open();
        let to = Self::sky_direction(code, &i.into());
        let value = self.along_ray(code, &to, &[node]).remove(0);
        let e = widen(value, self.graph.width(node), lw) * solid.splat(lw);
        let e = code.bind("irradiance", Ty::float(lw), e);
        let even = Self::is_even(code, i);
        let (limit, channel) = (Expr::F32(FAR), Channel::Sky(i.into()));
        each(self, code, &LightSample { to, limit, irradiance: e, even: Some(even), channel });
        code.add(i, 1.0);
        code.break_if(Expr::Local(i).greater_equal(f64::from(SKY)));
        let block = code.close();
        code.push_loop(block);
    }
}
