//! At which rate tentative collisions happen: that of a medium's bounds in the brick at hand, or one for all of it.

use super::media::Medium;
use super::paths::Random;
use super::shapes::{FAR, Ray};
use super::trace::Tracer;
use crate::fields::Code;
use crate::program::kernel::{Expr, LocalId, Math, Stmt, Ty};

impl Tracer<'_> {
    /// The sum of the majorants of tracked media that are here, if it is the same along the whole segment. If light is
    /// gathered, at least one collision per unit where something shines.
    pub(super) fn still_rate(&mut self, code: &mut Code, open: &[&Medium<'_>], light: bool) -> Option<Expr> {
        if open.iter().any(|m| m.matter.bounds.is_some()) {
            return None;
        }
        let sigma = code.var("majorant", Ty::F32, 0.0);
        for medium in open {
            let bound = self.majorant_of(medium, light);
            code.add(sigma, here(medium, bound, 0.0));
        }
        Some(code.bind("sigma", Ty::F32, sigma))
    }

    fn majorant_of(&mut self, medium: &Medium<'_>, light: bool) -> Expr {
        let matter = medium.matter;
        let bound = match matter.extinction {
            Some(node) => self.builder.majorant(node, &format!("{}_k_t", matter.name)),
            None => Expr::F32(0.0),
        };
        if light && matter.emission.is_some() { bound.max(1.0) } else { bound }
    }

    /// Goes on to the next tentative collision before `end`, or leaves the loop that this is written into; gives its rate.
    /// Where the rate changes from brick to brick, the way to the next face is gone first, and a new distance drawn there:
    /// exponential distances have no memory.
    pub(super) fn tentative(
        &mut self,
        code: &mut Code,
        ray: &Ray,
        (open, light): (&[&Medium<'_>], bool),
        still: Option<&Expr>,
        (t, end): (LocalId, &Expr),
        rng: LocalId,
    ) -> Expr {
        let random = self.random.expect("paths draw numbers");
        if let Some(sigma) = still {
            let step = free_path(code, random, rng, sigma);
            code.add(t, step);
            code.break_if(Expr::Local(t).greater_equal(end.clone()));
            return sigma.clone();
        }
        let rate = code.var("rate_here", Ty::F32, 0.0);
        let way = code.var("way_on", Ty::F32, FAR);
        let p = code.bind("p_brick", Ty::VEC3, ray.at(t.into()));
        for medium in open {
            code.open();
            match self.brick(code, medium, &p, &ray.direction) {
                Some(brick) => {
                    let bound = if light && medium.matter.emission.is_some() {
                        let shines = brick.source.greater(0.0);
                        shines.select(brick.extinction.clone().max(1.0), brick.extinction)
                    } else {
                        brick.extinction
                    };
                    code.add(rate, bound);
                    code.set(way, Expr::Local(way).min(brick.clear.max(brick.exit)));
                }
                None => {
                    let bound = self.majorant_of(medium, light);
                    code.add(rate, bound);
                }
            }
            let body = code.close();
            match &medium.here {
                Some(here) => code.push_if(here.clone(), body),
                None => code.push_all(body),
            }
        }
        let sigma = code.bind("sigma", Ty::F32, rate);
        let step = free_path(code, random, rng, &sigma);
        let step = code.bind("free_path", Ty::F32, step);
        // Far from the origin, as far as rounding lets a ray advance.
        let way = code.bind("to_face", Ty::F32, Expr::Local(way).max(Expr::Local(t).abs() * 2.4e-7));
        code.add(t, step.clone().min(way.clone()));
        code.break_if(Expr::Local(t).greater_equal(end.clone()));
        code.if_(step.greater_equal(way), Code::continue_);
        sigma
    }
}

fn here(medium: &Medium<'_>, value: Expr, elsewhere: f64) -> Expr {
    match &medium.here {
        Some(here) => here.clone().select(value, elsewhere),
        None => value,
    }
}

fn free_path(code: &mut Code, random: Random, rng: LocalId, sigma: &Expr) -> Expr {
    -Expr::math(Math::Log, [random.draw(code, rng)]) / sigma.clone().max(1e-37)
}

/// Adds the loop over tentative collisions; without a rate there is nothing to meet.
pub(super) fn push_tracking(code: &mut Code, still: Option<Expr>, block: Vec<Stmt>) {
    match still {
        Some(sigma) => {
            code.open();
            code.push_loop(block);
            let tracking = code.close();
            code.push_if(sigma.greater(0.0), tracking);
        }
        None => code.push_loop(block),
    }
}
