//! What is left of a light at a place: optical depths in closed form where there is one; elsewhere the transmittance is drawn
//! without bias by ratio tracking (Novák, Selle and Jarosz 2014) where that takes few evaluations, and the depth integrated where not.

use super::super::field::Ray;
use super::super::gauss::{N, Nodes};
use super::super::light::Arrival;
use super::super::trace::{BANDS, PerBand};
use super::walk::{DEPTH, Walk};
use crate::frame::vector::Vec3;
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;

/// Most tentative events expected on a stretch that is drawn: integration takes at least as many evaluations there.
const FEW: f64 = 256.0;

impl<V: Voxels + ?Sized> Walk<'_, '_, V> {
    /// The irradiance of a light that arrives at a place, for a plane that faces it: exact or drawn.
    pub(super) fn arriving(&mut self, place: Vec3, arrival: &Arrival) -> Result<PerBand, Diagnostic> {
        let fields = self.worker.fields;
        let ray = Ray::new(place, arrival.towards, &fields.shells);
        if self.worker.blocked(&ray, arrival.distance)? {
            return Ok([0.0; BANDS]);
        }
        let spans = self.worker.spans(&ray, arrival.distance)?;
        let (mut left, mut depth) = (arrival.irradiance, [0.0; BANDS]);
        for (m, medium) in fields.media.iter().enumerate() {
            let Some(shade) = &medium.shade else { continue };
            for &(a, b) in &spans[m] {
                if shade.closed.is_none() && medium.bound.most() * (b - a) < FEW {
                    self.pass(&ray, m, (a, b), &mut left)?;
                } else {
                    let part = self.worker.part(&ray, m, (a, b), DEPTH)?;
                    (0..BANDS).for_each(|band| depth[band] += part.tau[band]);
                }
            }
        }
        Ok(std::array::from_fn(|band| left[band] * (-depth[band]).exp()))
    }

    /// Draws what a medium leaves of light on a stretch.
    fn pass(&mut self, ray: &Ray, m: usize, (a, b): (f64, f64), left: &mut PerBand) -> Result<(), Diagnostic> {
        let (bounds, bands) = (&self.worker.fields.media[m].bound, self.worker.bands);
        let mut t = a;
        while left[..bands].iter().any(|l| *l > 0.0) {
            let mut rates: Nodes = [0.0; N];
            let mut ts: Nodes = [f64::INFINITY; N];
            for (slot, rate) in ts.iter_mut().zip(&mut rates) {
                let Some(bound) = bounds.next(ray, &mut t, (b, 0.0), &mut || self.random.depth()) else { break };
                (*slot, *rate) = (t, bound);
            }
            if ts[0] >= b {
                break;
            }
            let (sigma, _) = self.worker.extinction(ray, m, &ts.map(|t| t.min(b)))?;
            for (lane, _) in ts.iter().enumerate().take_while(|(_, t)| **t < b) {
                (0..bands).for_each(|band| left[band] *= (1.0 - sigma[band][lane] / rates[lane]).max(0.0));
            }
            if t >= b {
                break;
            }
        }
        Ok(())
    }
}
