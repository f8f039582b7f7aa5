//! Which rays have no end, and whether that can be borne; which orders of scattering there are.

use super::matter::Scene;
use super::shapes::{Region, region};
use crate::diagnostic::{Diagnostic, Diagnostics};
use crate::ir::{Composite, FieldScene, Medium, Primitive, Scattering};
use crate::passes::is_zero;

impl Scene {
    /// A ray that never leaves a medium needs a closed form to infinity.
    pub(crate) fn refuse_endless(&self, scene: &FieldScene, diagnostics: &mut Diagnostics) {
        for m in self.matter.iter().filter(|m| m.region.is_unbounded(&self.primitives)) {
            let at = |d: Diagnostic| match m.span {
                Some(span) => d.at(span, "this medium has no end"),
                None => d,
            };
            let hint = "give it a shape, for example `shape = sphere(center: (0,0,0) m, radius: 10 m)`";
            let open = m.varying
                && (m.closed.is_none()
                    || (m.emission.is_some() && m.steps && m.source_bound.is_none() && m.scattering.is_none()));
            if open && !bounded_sdf(&m.region, &self.primitives) {
                diagnostics.push(
                    at(Diagnostic::error(
                        "E0520",
                        format!("`{}` reaches to infinity, and its integral along a ray has no closed form", m.name),
                    ))
                    .note("uniform and exponential coefficients can be integrated to infinity; other fields cannot")
                    .hint(hint),
                );
            }
            if scene.render.composite == Composite::Radiance && m.extinction.is_none() && m.emission.is_some() {
                diagnostics.push(
                    at(Diagnostic::error(
                        "E0521",
                        format!("`{}` shines without end and absorbs nothing: its radiance is infinite", m.name),
                    ))
                    .hint("give it a k_a")
                    .hint(hint),
                );
            }
        }
    }

    /// Every closed form or signed distance that some medium is bounded by.
    pub(crate) fn primitives(&self) -> &[Primitive] {
        &self.primitives
    }
}

/// The media that no box holds.
pub(crate) fn endless(scene: &FieldScene) -> impl Iterator<Item = &Medium> {
    let seen = |node| !is_zero(&scene.graph, node);
    scene.media.iter().filter(move |m| {
        let mut primitives = vec![];
        let region = region(&m.shape, &mut primitives);
        [m.k_a, m.k_s, m.k_e].into_iter().any(seen) && region.is_unbounded(&primitives)
    })
}

/// Whether light is followed over more than one scattering: only where there is something to scatter it and light to scatter.
pub(crate) fn is_multiple(scene: &FieldScene) -> bool {
    let is = |node| !is_zero(&scene.graph, node);
    let light = !scene.lights.is_empty()
        || (scene.environment && is(scene.background))
        || scene.media.iter().any(|m| is(m.k_e));
    let scatters = !scene.surfaces.is_empty() || scene.media.iter().any(|m| is(m.k_s));
    scene.render.scattering == Scattering::Multiple
        && scene.render.composite == Composite::Radiance
        && light
        && scatters
}

/// A signed distance field may bound a medium although no box is known: tracing finds its far side, or that there is none.
fn bounded_sdf(region: &Region, primitives: &[crate::ir::Primitive]) -> bool {
    match region {
        Region::Leaf(i) => matches!(primitives[*i].kind, crate::ir::PrimitiveKind::Sdf { .. }),
        Region::Everywhere => false,
        Region::Union(parts) => parts.iter().all(|r| !r.is_unbounded(primitives) || bounded_sdf(r, primitives)),
        Region::Intersection(parts) => parts.iter().any(|r| bounded_sdf(r, primitives)),
        Region::Difference(first, _) => bounded_sdf(first, primitives),
    }
}
