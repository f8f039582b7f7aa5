//! The default rule of the language in f64: a fixed number of midpoint steps with the exact exponential inside a step.
//! Second order on smooth fields; here to measure the backends' convergence against, and independent of them.

use super::compose::{Panel, Sum, compose};
use super::field::{Ray, with_span};
use super::gauss::N;
use super::panel::{Slice, constant};
use super::scatter::Behind;
use super::trace::{BANDS, Segment, Worker};
use super::{ErrorKind, RayResult};
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;

/// Marches `steps` steps, spread over the segments by length, at least one each. The error is estimated by the difference to
/// half as many steps, about three times what a rule of second order leaves on a smooth field.
pub(super) fn march<V: Voxels + ?Sized>(
    worker: &mut Worker<'_, V>,
    ray: &Ray,
    segments: &[Segment],
    veils: &[Panel],
    behind: &Behind,
    steps: u32,
) -> Result<RayResult, Diagnostic> {
    let mut result = run(worker, ray, segments, veils, behind, steps)?;
    let other = run(worker, ray, segments, veils, behind, if steps > 1 { steps / 2 } else { 2 })?;
    let apart = |a: &[f64], b: &[f64]| -> Vec<f64> {
        let one = |(a, b): (&f64, &f64)| if a == b { 4.0 * f64::EPSILON * a.abs() } else { (a - b).abs() };
        a.iter().zip(b).map(one).map(|e| if e.is_finite() { e } else { 0.0 }).collect()
    };
    result.error = apart(&result.radiance, &other.radiance);
    let rounding = |(error, light): (&f64, &f64)| error.min(4.0 * f64::EPSILON * light.abs());
    result.rounding = result.error.iter().zip(&result.radiance).map(rounding).collect();
    result.error_tau = apart(&result.optical_depth, &other.optical_depth);
    result.evaluations = worker.evaluations;
    Ok(result)
}

fn run<V: Voxels + ?Sized>(
    worker: &mut Worker<'_, V>,
    ray: &Ray,
    segments: &[Segment],
    veils: &[Panel],
    behind: &Behind,
    steps: u32,
) -> Result<RayResult, Diagnostic> {
    let bands = worker.bands;
    let total: f64 = segments.iter().map(|s| s.end - s.start).sum();
    let mut panels: Vec<Panel> = vec![];
    let mut veils = veils.iter().cloned().peekable();
    for (i, segment) in segments.iter().enumerate() {
        while let Some(veil) = veils.next_if(|v| v.a <= segment.start) {
            panels.push(veil);
        }
        let (mut tau, mut radiance) = ([Sum::default(); BANDS], [Sum::default(); BANDS]);
        if !segment.end.is_finite() && !segment.uniform {
            let all = || segment.active.iter().map(|m| &worker.fields.media[*m]);
            // One that is the same everywhere may be lit, and be stepped through for that.
            let medium = all().find(|m| !m.field.uniform).or_else(|| all().next());
            let (name, span) = medium.map_or(("", None), |m| (m.name.as_str(), m.span));
            let message = format!("medium `{name}` never ends along a ray: a fixed number of steps cannot cover it");
            return Err(
                with_span(Diagnostic::error("E0652", message), span).hint("give it a `shape`, or leave `steps` out")
            );
        }
        let length = segment.end - segment.start;
        let count = if segment.uniform { 1.0 } else { (f64::from(steps) * length / total).round().max(1.0) };
        let h = length / count;
        let mut done = 0.0;
        while done < count {
            let lanes = (count - done).min(N as f64) as usize;
            let place = |i: f64| if h.is_finite() { segment.start + h * (i + 0.5) } else { segment.start + 0.5 };
            let ts = std::array::from_fn(|i| place(done + i.min(lanes - 1) as f64));
            let [sigma, mut emission] = worker.sample(ray, &segment.active, &ts)?;
            if segment.scatters {
                worker.front = [0.0; BANDS];
                worker.scatter(ray, &segment.active, &ts, (&sigma, &mut emission))?;
            }
            for lane in 0..lanes {
                for b in 0..bands {
                    let slice = constant(h, sigma[b][lane], emission[b][lane]);
                    radiance[b].add((-tau[b].get()).exp() * slice.radiance);
                    tau[b].add(slice.tau);
                }
            }
            done += lanes as f64;
        }
        let slice = |b: usize| Slice { tau: tau[b].get(), radiance: radiance[b].get(), ..Slice::default() };
        panels.push(Panel::new((segment.start, length), i, std::array::from_fn(slice)));
    }
    panels.extend(veils);
    let totals = compose(&panels, &behind.radiance, bands);
    let optical_depth = totals.tau[..bands].to_vec();
    Ok(RayResult {
        radiance: totals.radiance[..bands].to_vec(),
        transmittance: optical_depth.iter().map(|t| (-t).exp()).collect(),
        error: vec![0.0; bands],
        rounding: vec![0.0; bands],
        error_tau: vec![0.0; bands],
        optical_depth,
        error_kind: ErrorKind::Estimate,
        evaluations: worker.evaluations,
        complete: true,
    })
}
