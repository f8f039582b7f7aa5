//! One path from the eye: collisions and bounces, at each of which lights are looked for, until it escapes or ends by chance.

use super::super::field::{Ray, with_span};
use super::super::gauss::N;
use super::super::light::{Arrival, Beam};
use super::super::sphere::{direction, frame};
use super::super::surface::{Hit, Spot};
use super::super::trace::{BANDS, PerBand, Worker};
use super::collide::Event;
use super::phase::PhaseTable;
use super::random::Random;
use crate::frame::vector::{Vec3, dot, length, scale, sub};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;
use std::f64::consts::PI;

/// What a path carries in each band, and how likely it was for each band to decide it: ratios count.
#[derive(Copy, Clone, Debug)]
pub(super) struct Throughput {
    value: PerBand,
    density: PerBand,
    bands: usize,
}

impl Throughput {
    fn new(bands: usize) -> Self {
        Self { value: [1.0; BANDS], density: [1.0; BANDS], bands }
    }

    /// Goes on by factors of what is carried and of the densities.
    pub(super) fn times(&mut self, value: &PerBand, density: &PerBand) {
        for b in 0..self.bands {
            self.value[b] *= value[b];
            self.density[b] *= density[b];
        }
        // Kept near 1, so that neither runs out of numbers on long paths.
        let mean = self.density[..self.bands].iter().sum::<f64>() / self.bands as f64;
        for b in 0..self.bands {
            self.value[b] /= mean;
            self.density[b] /= mean;
        }
    }

    /// Densities are all the same by now: what counts.
    fn weight(&self, b: usize) -> f64 {
        self.value[b]
    }

    fn largest(&self) -> f64 {
        self.value[..self.bands].iter().fold(0.0, |m, v| m.max(*v))
    }
}

/// A path on its way.
pub(super) struct Walk<'k, 'r, V: ?Sized> {
    pub(super) worker: &'k mut Worker<'r, V>,
    pub(super) random: Random,
    /// The band that decides.
    pub(super) hero: usize,
    pub(super) path: Throughput,
    total: PerBand,
}

/// Paths that carry less than this may end by chance.
const FAINT: f64 = 0.2;
/// Collisions after which a path is taken for one without end.
const LONGEST: u32 = 10_000_000;

/// A lamp and a ray: places on the ray are drawn so that the angle at the lamp is uniform (Kulla and Fajardo 2012), which
/// takes the peak of 1/d² away.
struct Angles {
    closest: f64,
    q: f64,
    from: f64,
    to: f64,
}

impl Angles {
    fn new(at: Vec3, ray: &Ray, reach: f64) -> Self {
        let way = sub(at, ray.origin);
        let closest = dot(way, ray.direction);
        let q = length(sub(way, scale(ray.direction, closest))).max(1e-12 * length(way)).max(1e-280);
        Self { closest, q, from: (-closest / q).atan(), to: ((reach - closest) / q).atan() }
    }

    fn draw(&self, random: &mut Random) -> f64 {
        self.closest + self.q * (self.from + (self.to - self.from) * random.unit()).tan()
    }

    fn density(&self, t: f64) -> f64 {
        let x = t - self.closest;
        self.q / ((self.to - self.from) * (self.q * self.q + x * x))
    }
}

impl<'k, 'r, V: Voxels + ?Sized> Walk<'k, 'r, V> {
    pub(super) fn new(worker: &'k mut Worker<'r, V>, mut random: Random) -> Self {
        let bands = worker.bands;
        let hero = ((random.unit() * bands as f64) as usize).min(bands - 1);
        Self { worker, random, hero, path: Throughput::new(bands), total: [0.0; BANDS] }
    }

    /// Adds light that a path brings.
    pub(super) fn gain(&mut self, path: &Throughput, light: &PerBand) {
        for b in 0..self.worker.bands {
            if light[b] > 0.0 {
                self.total[b] += path.weight(b) * light[b];
            }
        }
    }

    /// What one path from the origin of a ray brings.
    pub(super) fn run(mut self, first: &Ray) -> Result<PerBand, Diagnostic> {
        let fields = self.worker.fields;
        let mut ray = first.clone();
        for bounce in 0..LONGEST {
            let hit = self.worker.nearest(&ray, f64::INFINITY)?;
            let reach = hit.map_or(f64::INFINITY, |h| h.t);
            let spans = self.worker.spans(&ray, reach)?;
            self.lamps(&ray, &spans, reach)?;
            let event = self.collide(&ray, &spans, reach)?;
            let next = match (event, hit) {
                (Some(event), _) => self.scatter(&ray, &spans, &event, reach)?,
                (None, Some(hit)) => self.bounce(&ray, &hit)?,
                (None, None) => {
                    let behind = match (bounce, fields.environment) {
                        (0, _) => self.worker.background(&ray)?,
                        (_, true) => self.worker.sky(&[ray.direction; N])?.map(|l| l[0]),
                        (_, false) => [0.0; BANDS],
                    };
                    let path = self.path;
                    self.gain(&path, &behind);
                    None
                }
            };
            let Some(next) = next else { return Ok(self.total) };
            let carried = self.path.largest();
            if carried < FAINT {
                // Survivors carry as much as those that may not end.
                let chance = carried / FAINT;
                if !(self.random.unit() < chance) {
                    return Ok(self.total);
                }
                self.path.value.iter_mut().for_each(|v| *v /= chance);
            }
            ray = next;
        }
        let medium = fields.media.iter().find(|m| m.scatters);
        let (name, span) = medium.map_or(("", None), |m| (m.name.as_str(), m.span));
        let message = format!("light is scattered without end in medium `{name}`");
        Err(with_span(Diagnostic::error("E0655", message), span)
            .hint("give the medium a bounded `shape`, or let it absorb a little"))
    }

    /// Light of lamps that is scattered anywhere along a ray.
    fn lamps(&mut self, ray: &Ray, spans: &[Vec<(f64, f64)>], reach: f64) -> Result<(), Diagnostic> {
        let fields = self.worker.fields;
        if spans.iter().enumerate().all(|(m, s)| s.is_empty() || !fields.media[m].scatters) {
            return Ok(());
        }
        let bands = self.worker.bands;
        for light in &fields.lights {
            let Beam::Lamp { at, .. } = &light.beam else { continue };
            let angles = Angles::new(*at, ray, reach);
            let t = angles.draw(&mut self.random);
            if !(t > 0.0 && t < reach) {
                continue;
            }
            let Some(arrival) = light.beam.arrival(ray.at(t)) else { continue };
            let cosine = dot(arrival.towards, ray.direction).clamp(-1.0, 1.0);
            let mut scattered = [0.0; BANDS];
            for m in active(spans, t) {
                let k = self.worker.coefficients(m, ray, &[t; N])?[0];
                let phase = self.worker.phase(m, ray, &[t; N], &[cosine; N])?;
                (0..bands).for_each(|b| scattered[b] += k[1][b] * phase[b][0]);
            }
            if scattered.iter().all(|s| *s == 0.0) {
                continue;
            }
            let (light, dimmed) = (self.arriving(ray.at(t), &arrival)?, self.worker.depth(ray, t, DEPTH)?);
            // Shared with collisions, each by how likely it is to find this place.
            let (own, other) = (angles.density(t), self.chance(ray, spans, t)?);
            let share = 1.0 / (own + other);
            let light = std::array::from_fn(|b| light[b] * scattered[b] * (-dimmed.tau[b]).exp() * share);
            let path = self.path;
            self.gain(&path, &light);
        }
        Ok(())
    }

    /// Density of collisions at a place of a ray, over media and bands.
    fn chance(&mut self, ray: &Ray, spans: &[Vec<(f64, f64)>], t: f64) -> Result<f64, Diagnostic> {
        let bands = self.worker.bands;
        let mut sigma = [0.0; BANDS];
        for m in active(spans, t) {
            let k = self.worker.coefficients(m, ray, &[t; N])?[0];
            (0..bands).for_each(|b| sigma[b] += k[0][b] + k[1][b]);
        }
        let depth = self.worker.depth(ray, t, DEPTH)?;
        Ok((0..bands).map(|b| sigma[b] * (-depth.tau[b]).exp()).sum::<f64>() / bands as f64)
    }

    /// A light seen from a place, with what it brings there; a direction of a disc is drawn. `solid` is what a disc's
    /// radiance is worth as an irradiance.
    fn seen(&mut self, beam: &Beam, place: Vec3) -> Option<Arrival> {
        match beam {
            Beam::Disc { towards, radiance, angle } => {
                let depth = 2.0 * (0.5 * angle).sin().powi(2);
                let (u, phi) = (depth * self.random.unit(), 2.0 * PI * self.random.unit());
                let irradiance = radiance.map(|l| l * 2.0 * PI * depth);
                let towards = direction(&frame(*towards), u, phi);
                Some(Arrival { towards, distance: f64::INFINITY, irradiance })
            }
            Beam::Parallel { .. } | Beam::Lamp { .. } => beam.arrival(place),
        }
    }

    /// A collision: lights, then a new direction.
    fn scatter(
        &mut self,
        ray: &Ray,
        spans: &[Vec<(f64, f64)>],
        event: &Event,
        reach: f64,
    ) -> Result<Option<Ray>, Diagnostic> {
        let fields = self.worker.fields;
        if self.path.largest() == 0.0 {
            return Ok(None);
        }
        let place = ray.at(event.t);
        for light in &fields.lights {
            let Some(arrival) = self.seen(&light.beam, place) else { continue };
            let share = match &light.beam {
                Beam::Parallel { .. } | Beam::Disc { .. } => 1.0,
                Beam::Lamp { at, .. } => {
                    let own = self.chance(ray, spans, event.t)?;
                    own / (own + Angles::new(*at, ray, reach).density(event.t))
                }
            };
            let cosine = dot(arrival.towards, ray.direction).clamp(-1.0, 1.0);
            let phase = self.worker.phase(event.medium, ray, &[event.t; N], &[cosine; N])?;
            let light = self.arriving(place, &arrival)?;
            let path = self.path;
            self.gain(&path, &std::array::from_fn(|b| light[b] * phase[b][0] * share));
        }
        // Directions towards where light comes from: the cosine to the eye ray is that of the scattering.
        let medium = &fields.media[event.medium];
        let (u, density) = match (&medium.phase, &medium.table) {
            (None, _) => (2.0 * self.random.unit(), 0.25 / PI),
            (Some(_), Some(table)) => table.draw(&mut self.random),
            (Some(_), None) => {
                let (worker, t) = (&mut *self.worker, event.t);
                let bands = worker.bands;
                let table = PhaseTable::new(false, bands, |c| worker.phase(event.medium, ray, &[t; N], c))?;
                let Some(table) = table else { return Ok(None) };
                table.draw(&mut self.random)
            }
        };
        if medium.phase.is_some() {
            let phase = self.worker.phase(event.medium, ray, &[event.t; N], &[1.0 - u; N])?;
            let weight = std::array::from_fn(|b| phase[b][0] / density);
            self.path.times(&weight, &[1.0; BANDS]);
        }
        let towards = direction(&frame(ray.direction), u, 2.0 * PI * self.random.unit());
        Ok(Some(Ray::new(place, towards, &fields.shells)))
    }

    /// A surface: lights, then a direction by the cosine.
    fn bounce(&mut self, ray: &Ray, hit: &Hit) -> Result<Option<Ray>, Diagnostic> {
        let fields = self.worker.fields;
        let albedo = self.worker.albedo(ray, hit)?;
        self.path.times(&albedo, &[1.0; BANDS]);
        if self.path.largest() == 0.0 {
            return Ok(None);
        }
        let Spot { at, place, normal } = self.worker.spot(ray, hit);
        for light in &fields.lights {
            let Some(arrival) = self.seen(&light.beam, at) else { continue };
            let cosine = dot(arrival.towards, normal);
            if cosine > 0.0 {
                let light = self.arriving(place, &arrival)?;
                let path = self.path;
                self.gain(&path, &light.map(|l| l * cosine / PI));
            }
        }
        // cos² θ is uniform.
        let u = 1.0 - self.random.unit().sqrt();
        let towards = direction(&frame(normal), u, 2.0 * PI * self.random.unit());
        Ok(Some(Ray::new(place, towards, &fields.shells)))
    }
}

/// Absolute tolerance of optical depths.
pub(super) const DEPTH: f64 = 1e-8;

/// Media at a place of a ray.
fn active(spans: &[Vec<(f64, f64)>], t: f64) -> impl Iterator<Item = usize> + '_ {
    let inside = move |s: &Vec<(f64, f64)>| s.iter().any(|(a, b)| *a <= t && t < *b);
    spans.iter().enumerate().filter(move |(_, s)| inside(s)).map(|(m, _)| m)
}

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// The stretches of each medium before `reach`.
    pub(super) fn spans(&mut self, ray: &Ray, reach: f64) -> Result<Vec<Vec<(f64, f64)>>, Diagnostic> {
        let cut = |list: &[(f64, f64)]| list.iter().map(|(a, b)| (*a, b.min(reach))).filter(|(a, b)| a < b).collect();
        let fields = self.fields;
        let mut all = vec![];
        for medium in &fields.media {
            all.push(match medium.solid.span(ray.origin, ray.direction) {
                Some(span) => cut(span.as_slice()),
                None => cut(&self.intervals(&medium.solid, ("medium", &medium.name, medium.span), ray)?.0),
            });
        }
        Ok(all)
    }
}
