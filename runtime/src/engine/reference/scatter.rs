//! Light that arrives at a point: scattered into a ray by media, reflected by surfaces.
//!
//! A medium adds k_s·∫ phase(cos θ)·L_in dω to the source along the ray, a Lambertian surface reflects albedo·E/π; both see
//! the same L_in: every light and the environment through e^(−τ) of all media, where no surface lies before them. The cosine
//! is that of travel before and after scattering; light travels against the eye ray, so with w towards the light and d along
//! the eye ray it is (−w)·(−d).

use super::Options;
use super::faces::mix;
use super::field::{Ray, bad_coefficient};
use super::gauss::N;
use super::gauss::Nodes;
use super::light::{Arrival, Beam};
use super::shade::Depth;
use super::sphere::{OfDirection, Values, changes, over_cap, over_cap_roughly};
use super::surface::{Hit, Spot, SurfaceForm};
use super::trace::{BANDS, PerBand, Worker};
use crate::frame::vector::{Vec3, dot, normalize, scale, sub};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;
use std::f64::consts::PI;

/// Share of the tolerance of a ray that is left to what arrives at each point of it.
const INNER: f64 = 0.1;
/// Beyond this depth nothing is scattered to the eye that could be seen beside what lies before it.
const UNSEEN: f64 = 100.0;

/// Places on a ray are known to this, relative to how far away they and its origin are.
pub(super) const PLACES: f64 = 16.0 * f64::EPSILON;

/// What is behind the media of a ray.
#[derive(Copy, Clone, Debug, Default)]
pub(super) struct Behind {
    pub(super) radiance: PerBand,
    pub(super) wrong: PerBand,
    /// More than rounding was approximated.
    pub(super) rough: bool,
}

/// Media that scatter at a point, each with its k_s there.
type Scatterers = Vec<(usize, PerBand)>;

/// What light is gathered for.
enum Receiver<'g> {
    /// A surface that faces this way.
    Surface(Vec3),
    /// The media at a point of a ray.
    Media { ray: &'g Ray, t: f64, scatterers: &'g Scatterers },
}

/// Light from a part of the sphere on a point.
struct Gather<'g, 'w, 'r, V: ?Sized> {
    worker: &'w mut Worker<'r, V>,
    place: Vec3,
    /// The same from everywhere; `None` is the environment.
    radiance: Option<PerBand>,
    receiver: Receiver<'g>,
    /// Of optical depths.
    tolerance: f64,
    /// What rounding of the place may do to them.
    blur: PerBand,
}

impl<V: Voxels + ?Sized> OfDirection for Gather<'_, '_, '_, V> {
    fn values(&mut self, directions: &[Vec3; N]) -> Result<Values, Diagnostic> {
        let bands = self.worker.bands;
        let mut all = Values::default();
        match &self.receiver {
            Receiver::Surface(normal) => {
                let cosines = directions.map(|d| dot(*normal, d).max(0.0));
                all.value = [cosines; BANDS];
            }
            Receiver::Media { ray, t, scatterers } => {
                let cosines = directions.map(|d| dot(ray.direction, d));
                for (m, k_s) in *scatterers {
                    let phase = self.worker.phase(*m, ray, &[*t; N], &cosines)?;
                    for b in 0..bands {
                        (0..N).for_each(|lane| all.value[b][lane] += k_s[b] * phase[b][lane]);
                    }
                }
            }
        }
        let sky = match self.radiance {
            Some(radiance) => radiance.map(|l| [l; N]),
            None => self.worker.sky(directions)?,
        };
        for lane in 0..N {
            for b in 0..bands {
                all.value[b][lane] *= sky[b][lane];
            }
            if (0..bands).all(|b| all.value[b][lane] == 0.0) {
                continue;
            }
            let depth = self.worker.shadow(self.place, directions[lane], f64::INFINITY, self.tolerance)?;
            for b in 0..bands {
                let (t, wrong) = depth.map_or((0.0, 0.0), |d| d.blurred(&self.blur).transmittance(b));
                all.wrong[b][lane] = all.value[b][lane] * wrong;
                all.value[b][lane] *= t;
            }
        }
        Ok(all)
    }

    fn signature(&mut self, direction: Vec3) -> Result<u64, Diagnostic> {
        let lit = match &self.receiver {
            Receiver::Surface(normal) => dot(*normal, direction) > 0.0,
            Receiver::Media { .. } => true,
        };
        if lit { self.worker.signature(self.place, direction, f64::INFINITY) } else { Ok(0) }
    }

    fn splits(&mut self, divided: u8, out: &mut Vec<(f64, bool)>) {
        if self.radiance.is_none() {
            self.worker.sky_splits(divided, out);
        }
    }

    fn cones(&self) -> Vec<(Vec3, f64)> {
        let mut cones = vec![];
        if let Receiver::Surface(normal) = &self.receiver {
            cones.push((*normal, 0.5 * PI));
        }
        for surface in &self.worker.fields.surfaces {
            match &surface.form {
                SurfaceForm::Plane { normal, .. } => cones.push((*normal, 0.5 * PI)),
                SurfaceForm::Disc { center, .. } => {
                    cones.extend(normalize(sub(*center, self.place)).map(|way| (way, 0.0)));
                }
                SurfaceForm::Boundary(solid) => solid.cones(self.place, &mut cones),
                SurfaceForm::Mesh(_) => {}
            }
        }
        self.worker.fields.media.iter().for_each(|m| m.solid.cones(self.place, &mut cones));
        cones
    }
}

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Depth to a light, or nothing if a surface is before it.
    fn shadow(&mut self, p: Vec3, towards: Vec3, reach: f64, tolerance: f64) -> Result<Option<Depth>, Diagnostic> {
        let ray = Ray::new(p, towards, &self.fields.shells);
        if self.blocked(&ray, reach)? { Ok(None) } else { self.depth(&ray, reach, tolerance).map(Some) }
    }

    /// A number that stays the same where the light that arrives from a direction changes smoothly with place and direction.
    fn signature(&mut self, p: Vec3, towards: Vec3, reach: f64) -> Result<u64, Diagnostic> {
        let fields = self.fields;
        let ray = Ray::new(p, towards, &fields.shells);
        if self.blocked(&ray, reach)? {
            return Ok(1);
        }
        let mut hash = 2;
        for medium in &fields.media {
            hash = mix(hash, medium.solid.signature(p, towards, reach));
        }
        Ok(hash)
    }

    /// Cuts (0..1) of a stretch of a ray where the shadows of lights begin or end.
    pub(super) fn shadow_cuts(&mut self, ray: &Ray, a: f64, h: f64) -> Result<Vec<f64>, Diagnostic> {
        let fields = self.fields;
        if fields.lights.is_empty() {
            return Ok(vec![]);
        }
        changes(a, h, |t| {
            let p = ray.at(t);
            let mut hash = 0;
            for light in &fields.lights {
                if let Some(arrival) = light.beam.arrival(p) {
                    hash = mix(hash, self.signature(p, arrival.towards, arrival.distance)?);
                }
            }
            Ok(hash)
        })
    }

    /// Phase function of a medium at points of a ray, for cosines of the angle of scattering.
    pub(super) fn phase(
        &mut self,
        m: usize,
        ray: &Ray,
        ts: &Nodes,
        cosines: &Nodes,
    ) -> Result<[Nodes; BANDS], Diagnostic> {
        let medium = &self.fields.media[m];
        let (Some(tape), Some(scratch)) = (&medium.phase, &mut self.phases[m]) else {
            return Ok([[0.25 / PI; N]; BANDS]);
        };
        self.fields.run_phase(tape, scratch, self.voxels, ray, ts, cosines);
        let mut out = [[0.0; N]; BANDS];
        for (b, slot) in out.iter_mut().enumerate().take(self.bands) {
            *slot = *tape.component(scratch, 0, b.min(tape.width(0) - 1));
            if let Some(lane) = slot.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
                let place = scale(ray.at(ts[lane]), self.metre);
                return Err(bad_coefficient(&medium.name, medium.span, "phase", slot[lane], place));
            }
        }
        Ok(out)
    }

    /// Adds what the media that were sampled last scatter into the ray to their emission at the nodes of a panel. Gives how
    /// wrong that may be at each node.
    pub(super) fn scatter(
        &mut self,
        ray: &Ray,
        active: &[usize],
        ts: &Nodes,
        (sigma, emission): (&[Nodes; BANDS], &mut [Nodes; BANDS]),
    ) -> Result<[Nodes; BANDS], Diagnostic> {
        if self.front[..self.bands].iter().all(|t| *t > UNSEEN) {
            return Ok([[0.0; N]; BANDS]);
        }
        // Lent for the time being, so that the worker stays whole whatever happens.
        let k_s = std::mem::take(&mut self.k_s);
        let wrong = self.scatter_all(ray, (active, &k_s), ts, (sigma, emission));
        self.k_s = k_s;
        wrong
    }

    fn scatter_all(
        &mut self,
        ray: &Ray,
        (active, k_s): (&[usize], &[[Nodes; BANDS]]),
        ts: &Nodes,
        (sigma, emission): (&[Nodes; BANDS], &mut [Nodes; BANDS]),
    ) -> Result<[Nodes; BANDS], Diagnostic> {
        let (fields, bands) = (self.fields, self.bands);
        let mut wrong = [[0.0; N]; BANDS];
        let some = |m: &usize| fields.media[*m].scatters && k_s[*m][..bands].iter().flatten().any(|k| *k > 0.0);
        let active: Vec<usize> = active.iter().copied().filter(some).collect();
        if active.is_empty() {
            return Ok(wrong);
        }
        let blurs = blurs(ray, ts, sigma);
        for light in &fields.lights {
            self.scatter_light(ray, (&active, k_s, &blurs), ts, &light.beam, (&mut *emission, &mut wrong))?;
        }
        if fields.environment {
            let axis = fields.axis.unwrap_or(ray.direction);
            for lane in 0..N {
                let scatterers = scatterers(&active, k_s, lane);
                let receiver = Receiver::Media { ray, t: ts[lane], scatterers: &scatterers };
                let found = self.gather((ray.at(ts[lane]), blurs[lane]), None, receiver, (axis, &[0.0, 1.0, 2.0]))?;
                for b in 0..bands {
                    emission[b][lane] += found.radiance[b];
                    wrong[b][lane] += found.wrong[b];
                }
            }
        }
        Ok(wrong)
    }

    fn scatter_light(
        &mut self,
        ray: &Ray,
        (active, k_s, blurs): (&[usize], &[[Nodes; BANDS]], &[PerBand; N]),
        ts: &Nodes,
        beam: &Beam,
        (emission, wrong): (&mut [Nodes; BANDS], &mut [Nodes; BANDS]),
    ) -> Result<(), Diagnostic> {
        let bands = self.bands;
        if let Beam::Disc { towards, radiance, angle } = beam {
            for lane in 0..N {
                let scatterers = scatterers(active, k_s, lane);
                let receiver = Receiver::Media { ray, t: ts[lane], scatterers: &scatterers };
                let place = (ray.at(ts[lane]), blurs[lane]);
                let found = self.gather(place, Some(*radiance), receiver, (*towards, &[0.0, depth_of(*angle)]))?;
                for b in 0..bands {
                    emission[b][lane] += found.radiance[b];
                    wrong[b][lane] += found.wrong[b];
                }
            }
            return Ok(());
        }
        let mut cosines = [0.0; N];
        let (mut light, mut light_wrong) = ([[0.0; N]; BANDS], [[0.0; N]; BANDS]);
        for lane in 0..N {
            let p = ray.at(ts[lane]);
            let none = |m: &usize| (0..bands).all(|b| k_s[*m][b][lane] == 0.0);
            let Some(arrival) = beam.arrival(p).filter(|_| !active.iter().all(none)) else { continue };
            cosines[lane] = dot(arrival.towards, ray.direction).clamp(-1.0, 1.0);
            let (e, w) = self.arrive((p, &blurs[lane]), &arrival)?;
            for b in 0..bands {
                light[b][lane] = e[b];
                light_wrong[b][lane] = w[b];
            }
        }
        for &m in active {
            let phase = self.phase(m, ray, ts, &cosines)?;
            for b in 0..bands {
                for lane in 0..N {
                    let share = k_s[m][b][lane] * phase[b][lane];
                    emission[b][lane] += share * light[b][lane];
                    wrong[b][lane] += share * light_wrong[b][lane];
                }
            }
        }
        Ok(())
    }

    /// What is left of a light at a point, and how wrong that may be.
    pub(super) fn arrive(
        &mut self,
        (p, blur): (Vec3, &PerBand),
        arrival: &Arrival,
    ) -> Result<(PerBand, PerBand), Diagnostic> {
        let tolerance = self.eased();
        let depth = self.shadow(p, arrival.towards, arrival.distance, tolerance)?;
        let (mut light, mut wrong) = ([0.0; BANDS], [0.0; BANDS]);
        if let Some(depth) = depth {
            for b in 0..self.bands {
                let (t, w) = depth.blurred(blur).transmittance(b);
                light[b] = arrival.irradiance[b] * t;
                wrong[b] = arrival.irradiance[b] * w;
            }
        }
        Ok((light, wrong))
    }

    /// Tolerance of what arrives: looser where much lies before it.
    fn eased(&self) -> f64 {
        let seen = self.front[..self.bands].iter().fold(0.0f64, |m, t| m.max((-t).exp()));
        (self.inner / seen.max(1e-6)).min(self.inner.max(1e-2))
    }

    /// Light from a cap of the sphere (an axis, and cuts of 1 − cosine) on a receiver.
    fn gather(
        &mut self,
        (place, blur): (Vec3, PerBand),
        radiance: Option<PerBand>,
        receiver: Receiver<'_>,
        (axis, cuts): (Vec3, &[f64]),
    ) -> Result<Behind, Diagnostic> {
        let (bands, relative) = (self.bands, self.eased());
        let absolute = match receiver {
            // A surface reflects no more than 1/π of it.
            Receiver::Surface(_) => PI * self.enough,
            // Of a source all along the stretch.
            Receiver::Media { .. } => self.enough / self.lit.max(1e-300),
        };
        // The discs of suns are smaller than what lies before them, mostly.
        let rough = self.lean && radiance.is_none();
        let mut gather = Gather { worker: self, place, radiance, receiver, tolerance: 0.1 * relative, blur };
        let over = if rough { over_cap_roughly } else { over_cap };
        let found = over(&mut gather, axis, cuts, bands, (relative, absolute))?;
        Ok(Behind { radiance: found.value, wrong: found.error, rough: true })
    }

    /// What a surface reflects towards the origin of a ray.
    pub(super) fn reflected(&mut self, ray: &Ray, hit: &Hit) -> Result<Behind, Diagnostic> {
        let fields = self.fields;
        let bands = self.bands;
        let albedo = self.albedo(ray, hit)?;
        let mut lit = Behind::default();
        if (fields.lights.is_empty() && !fields.environment) || albedo.iter().all(|a| *a == 0.0) {
            return Ok(lit);
        }
        let Spot { at, place, normal } = self.spot(ray, hit);
        self.front = [0.0; BANDS];
        for light in &fields.lights {
            let found = match &light.beam {
                Beam::Disc { towards, radiance, angle } => {
                    if dot(*towards, normal) <= -angle.sin() {
                        continue;
                    }
                    let cap = (*towards, &[0.0, depth_of(*angle)][..]);
                    self.gather((place, [0.0; BANDS]), Some(*radiance), Receiver::Surface(normal), cap)?
                }
                Beam::Parallel { .. } | Beam::Lamp { .. } => {
                    let Some(arrival) = light.beam.arrival(at) else { continue };
                    let cosine = dot(arrival.towards, normal);
                    if cosine <= 0.0 {
                        continue;
                    }
                    let (e, w) = self.arrive((place, &[0.0; BANDS]), &arrival)?;
                    let closed = fields.media.iter().all(|m| m.shade.as_ref().is_none_or(|s| s.closed.is_some()));
                    Behind { radiance: e.map(|e| e * cosine), wrong: w.map(|w| w * cosine), rough: !closed }
                }
            };
            for b in 0..bands {
                lit.radiance[b] += found.radiance[b];
                lit.wrong[b] += found.wrong[b];
            }
            lit.rough |= found.rough;
        }
        if fields.environment {
            let found = self.gather((place, [0.0; BANDS]), None, Receiver::Surface(normal), (normal, &[0.0, 1.0]))?;
            for b in 0..bands {
                lit.radiance[b] += found.radiance[b];
                lit.wrong[b] += found.wrong[b];
            }
            lit.rough = true;
        }
        for b in 0..bands {
            let share = albedo[b] / PI;
            lit.radiance[b] *= share;
            // Shadow rays begin a little off the surface, where media are hardly different.
            lit.wrong[b] = lit.wrong[b] * share + 2e-12 * lit.radiance[b];
        }
        Ok(lit)
    }

    /// The tolerance within a ray of these options, of the ray and of what arrives at each point of it.
    pub(super) fn tolerances(&mut self, options: &Options) -> Options {
        let fields = self.fields;
        let mut options = *options;
        let areas = fields.environment || fields.lights.iter().any(|l| matches!(l.beam, Beam::Disc { .. }));
        let floor = if areas { 1e-7 } else { 1e-9 };
        if fields.scatters {
            options.rtol = options.rtol.max(floor);
            // Depths of shadow rays count as evaluations too.
            options.max_evaluations = options.max_evaluations.saturating_mul(64);
        }
        self.inner = INNER * if fields.scatters || areas { options.rtol.max(floor) } else { options.rtol };
        self.enough = INNER * options.atol;
        options
    }
}

fn scatterers(active: &[usize], k_s: &[[Nodes; BANDS]], lane: usize) -> Scatterers {
    active.iter().map(|m| (*m, std::array::from_fn(|b| k_s[*m][b][lane]))).collect()
}

/// Optical depths by which rounding of each place on a ray may move it.
fn blurs(ray: &Ray, ts: &Nodes, sigma: &[Nodes; BANDS]) -> [PerBand; N] {
    let far = ray.origin.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    std::array::from_fn(|lane| {
        let rounding = PLACES * (far + ts[lane]);
        std::array::from_fn(|b| sigma[b][lane] * rounding)
    })
}

/// 1 − cosine of an angle.
fn depth_of(angle: f64) -> f64 {
    2.0 * (0.5 * angle).sin().powi(2)
}
