//! Lights of one frame: from where they shine on a point, and how bright.

use super::field::{Ray, with_span};
use super::gauss::N;
use super::split::splits_of;
use super::trace::{BANDS, PerBand, Worker};
use crate::frame::vector::{Vec3, dot, is_finite, length, normalize, scale, sub};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;
use compiler::ir::{FieldScene, LightKind, NodeId};
use compiler::source::Span;

/// How a light shines.
#[derive(Clone, Debug)]
pub(super) enum Beam {
    /// From one direction, on a plane facing it.
    Parallel { towards: Vec3, irradiance: PerBand },
    /// The same radiance from every direction within `angle` of one.
    Disc { towards: Vec3, radiance: PerBand, angle: f64 },
    /// From a point.
    Lamp { at: Vec3, intensity: PerBand, radius: f64 },
}

/// A light seen from a point: the unit vector to it, its distance, and what it brings to a plane facing it.
#[derive(Copy, Clone, Debug)]
pub(super) struct Arrival {
    pub(super) towards: Vec3,
    pub(super) distance: f64,
    pub(super) irradiance: PerBand,
}

impl Beam {
    /// Nothing for a disc, and at the place of a lamp without radius, which has no irradiance: a place that no integral sees.
    pub(super) fn arrival(&self, p: Vec3) -> Option<Arrival> {
        match self {
            Self::Parallel { towards, irradiance } => {
                Some(Arrival { towards: *towards, distance: f64::INFINITY, irradiance: *irradiance })
            }
            Self::Disc { .. } => None,
            Self::Lamp { at, intensity, radius } => {
                let way = sub(*at, p);
                let distance = length(way);
                // At the lamp itself every direction is as good.
                let towards = normalize(way).unwrap_or([0.0, 0.0, 1.0]);
                let d = distance.max(*radius);
                let irradiance = intensity.map(|i| i / d / d);
                irradiance.iter().all(|e| e.is_finite()).then_some(Arrival { towards, distance, irradiance })
            }
        }
    }

    /// Adds the parameters of a ray at which what arrives is not smooth, or peaks.
    pub(super) fn cuts(&self, ray: &Ray, out: &mut Vec<f64>) {
        match self {
            Self::Parallel { .. } | Self::Disc { .. } => {}
            Self::Lamp { at, radius, .. } => {
                let way = sub(*at, ray.origin);
                let closest = dot(way, ray.direction);
                let q = length(sub(way, scale(ray.direction, closest)));
                out.extend([closest - 4.0 * q, closest - q, closest, closest + q, closest + 4.0 * q]);
                if *radius > q {
                    let half = ((radius - q) * (radius + q)).sqrt();
                    out.extend([closest - half, closest + half]);
                }
            }
        }
    }
}

/// A light of one frame.
#[derive(Clone, Debug)]
pub(super) struct LightField {
    pub(super) beam: Beam,
}

/// Evaluates lights. `frame` gives the numbers of nodes of tier Frame.
///
/// # Errors
/// `E0650` for a strength below zero, `E0651` for a number that is not finite.
pub(super) fn evaluate(
    scene: &FieldScene,
    bands: usize,
    frame: &dyn Fn(&[NodeId]) -> Vec<Vec<f64>>,
) -> Result<Vec<LightField>, Diagnostic> {
    scene.lights.iter().map(|light| one(&light.kind, &light.name, light.span, bands, frame)).collect()
}

fn one(
    kind: &LightKind,
    name: &str,
    span: Option<Span>,
    bands: usize,
    frame: &dyn Fn(&[NodeId]) -> Vec<Vec<f64>>,
) -> Result<LightField, Diagnostic> {
    let number = |node: NodeId| frame(&[node]).swap_remove(0);
    let bad = |part: &str, v: f64| -> Diagnostic {
        let (code, what) = if v < 0.0 && v.is_finite() { ("E0650", "negative") } else { ("E0651", "not finite") };
        with_span(Diagnostic::error(code, format!("the {part} of light `{name}` is {what}: {v}")), span)
            .hint("check the params and divisions that it uses")
    };
    let vector = |node: NodeId, part: &str| -> Result<Vec3, Diagnostic> {
        let v = number(node);
        let v: Vec3 = std::array::from_fn(|c| v[c.min(v.len() - 1)]);
        if is_finite(v) { Ok(v) } else { Err(bad(part, f64::NAN)) }
    };
    let size = |node: NodeId, part: &str| -> Result<f64, Diagnostic> {
        let v = number(node)[0];
        if v >= 0.0 && v.is_finite() { Ok(v) } else { Err(bad(part, v)) }
    };
    let strength = |node: NodeId, part: &str| -> Result<PerBand, Diagnostic> {
        let v = number(node);
        let mut out = [0.0; BANDS];
        for b in 0..bands {
            out[b] = v[b.min(v.len() - 1)];
            if !(out[b] >= 0.0 && out[b].is_finite()) {
                return Err(bad(part, out[b]));
            }
        }
        Ok(out)
    };
    let beam = match kind {
        LightKind::Directional { direction, irradiance, angular_diameter } => {
            let direction = normalize(vector(*direction, "direction")?).ok_or_else(|| bad("direction", f64::NAN))?;
            let (towards, irradiance) = (scale(direction, -1.0), strength(*irradiance, "irradiance")?);
            let angle = match angular_diameter {
                Some(node) => (0.5 * size(*node, "angular_diameter")?).min(std::f64::consts::FRAC_PI_2),
                None => 0.0,
            };
            let share = std::f64::consts::PI * angle.sin() * angle.sin();
            if share > 0.0 {
                Beam::Disc { towards, radiance: irradiance.map(|e| e / share), angle }
            } else {
                Beam::Parallel { towards, irradiance }
            }
        }
        LightKind::Point { position, intensity, radius } => Beam::Lamp {
            at: vector(*position, "position")?,
            intensity: strength(*intensity, "intensity")?,
            radius: radius.map_or(Ok(0.0), |r| size(r, "radius"))?,
        },
    };
    Ok(LightField { beam })
}

impl<V: Voxels + ?Sized> Worker<'_, V> {
    /// Radiance behind everything in some directions, lights apart.
    ///
    /// # Errors
    /// `E0650` or `E0651` where it is negative or not finite.
    pub(super) fn sky(&mut self, directions: &[Vec3; N]) -> Result<[[f64; N]; BANDS], Diagnostic> {
        let fields = self.fields;
        let tape = &fields.background.tape;
        fields.run_sky(&mut self.sky, self.voxels, directions);
        let mut out = [[0.0; N]; BANDS];
        for (b, slot) in out.iter_mut().enumerate().take(self.bands) {
            *slot = *tape.component(&self.sky, 0, b.min(tape.width(0) - 1));
            if let Some(lane) = slot.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
                let (v, [x, y, z]) = (slot[lane], directions[lane]);
                let code = if v < 0.0 { "E0650" } else { "E0651" };
                let what = &fields.sky_name;
                return Err(Diagnostic::error(code, format!("{what} is {v} in direction ({x:.4}, {y:.4}, {z:.4})")));
            }
        }
        Ok(out)
    }

    /// Where in the panel of directions that [`Worker::sky`] was last asked for the sky may not be smooth.
    pub(super) fn sky_splits(&self, divided: u8, out: &mut Vec<(f64, bool)>) {
        let sampler = &self.fields.background;
        for (i, watch) in sampler.watches.iter().enumerate() {
            splits_of(sampler.tape.component(&self.sky, sampler.roots + i, 0), watch, divided, false, out);
        }
    }

    /// What a ray that meets no surface comes from: the background, and discs of lights before it.
    pub(super) fn background(&mut self, ray: &Ray) -> Result<PerBand, Diagnostic> {
        let sky = self.sky(&[ray.direction; N])?;
        let mut behind: PerBand = sky.map(|lanes| lanes[0]);
        for light in &self.fields.lights {
            if let Beam::Disc { towards, radiance, angle } = &light.beam {
                // By the chord: a cosine cannot tell small angles apart.
                let apart = 2.0 * (0.5 * length(sub(ray.direction, *towards))).min(1.0).asin();
                if apart <= *angle {
                    (0..self.bands).for_each(|b| behind[b] += radiance[b]);
                }
            }
        }
        Ok(behind)
    }
}
