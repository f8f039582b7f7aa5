//! The reference of a program whose bands are drawn in parts: traces each part and puts the bands in their order.

use super::{ErrorKind, Meshes, Options, Picture, Pixels, RayResult, Reference};
use crate::data::splats::Splats;
use crate::frame::Camera;
use compiler::diagnostic::Diagnostic;
use compiler::ir::eval::Voxels;
use compiler::program::{BandPlace, Program};
use std::sync::Arc;

/// One [`Reference`] for each part of a program.
#[derive(Clone, Debug)]
pub struct WholeReference<'a, V: ?Sized> {
    parts: Vec<Reference<'a, V>>,
    places: &'a [BandPlace],
}

impl<'a, V: Voxels + ?Sized> WholeReference<'a, V> {
    /// See [`Reference::new`].
    ///
    /// # Errors
    /// The same.
    pub fn new(program: &'a Program, params: &[Vec<f64>], time: f64, voxels: &'a V) -> Result<Self, Diagnostic> {
        let parts = program.parts().map(|part| Reference::new(&part.lowered, params, time, voxels));
        Ok(Self { parts: parts.collect::<Result<_, _>>()?, places: &program.places })
    }

    /// See [`Reference::with_meshes`].
    #[must_use]
    pub fn with_meshes(self, meshes: &'a dyn Meshes) -> Self {
        Self { parts: self.parts.into_iter().map(|p| p.with_meshes(meshes)).collect(), ..self }
    }

    /// See [`Reference::with_splats`].
    #[must_use]
    pub fn with_splats(self, files: &[Arc<Splats>]) -> Self {
        Self { parts: self.parts.into_iter().map(|p| p.with_splats(files)).collect(), ..self }
    }

    /// Number of bands of every result.
    #[must_use]
    pub fn bands(&self) -> usize {
        self.places.len()
    }

    /// See [`Reference::render`].
    ///
    /// # Errors
    /// The same.
    pub fn render(
        &self,
        camera: &Camera,
        offsets: &[[f64; 2]],
        options: &Options,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Picture, Diagnostic> {
        let count = self.parts.len() as f64;
        let mut drawn = vec![];
        for (i, part) in self.parts.iter().enumerate() {
            let share = |done: f64| progress((i as f64 + done) / count);
            drawn.push(part.render(camera, offsets, options, &share)?.pixels);
        }
        Ok(Picture { size: camera.size, bands: self.bands(), pixels: self.join(&drawn) })
    }

    /// See [`Reference::pixels`].
    ///
    /// # Errors
    /// The same.
    pub fn pixels(
        &self,
        camera: &Camera,
        pixels: &[[u32; 2]],
        offsets: &[[f64; 2]],
        options: &Options,
    ) -> Result<Pixels, Diagnostic> {
        let drawn: Result<Vec<_>, _> = self.parts.iter().map(|p| p.pixels(camera, pixels, offsets, options)).collect();
        Ok(self.join(&drawn?))
    }

    /// See [`Reference::rays`].
    ///
    /// # Errors
    /// The same.
    pub fn rays(&self, rays: &[([f64; 3], [f64; 3])], options: &Options) -> Result<Vec<RayResult>, Diagnostic> {
        let traced: Result<Vec<_>, _> = self.parts.iter().map(|p| p.rays(rays, options)).collect();
        let traced = traced?;
        let ray = |i: usize| {
            let found: Vec<&RayResult> = traced.iter().map(|part| &part[i]).collect();
            let list = |of: fn(&RayResult) -> &[f64]| self.places.iter().map(|p| of(found[p.part])[p.band]).collect();
            RayResult {
                radiance: list(|r| &r.radiance),
                transmittance: list(|r| &r.transmittance),
                optical_depth: list(|r| &r.optical_depth),
                error: list(|r| &r.error),
                rounding: list(|r| &r.rounding),
                error_tau: list(|r| &r.error_tau),
                error_kind: found.iter().map(|r| r.error_kind).max().unwrap_or(ErrorKind::Bound),
                evaluations: found.iter().map(|r| r.evaluations).sum(),
                complete: found.iter().all(|r| r.complete),
            }
        };
        Ok((0..rays.len()).map(ray).collect())
    }

    /// Pixels of each part to pixels of all bands.
    fn join(&self, parts: &[Pixels]) -> Pixels {
        let bands: Vec<usize> = self.parts.iter().map(Reference::bands).collect();
        let count = parts.first().map_or(0, |p| p.radiance.len() / bands[0]);
        let list = |of: fn(&Pixels) -> &[f64]| {
            let number = |i: usize, p: &BandPlace| of(&parts[p.part])[i * bands[p.part] + p.band];
            (0..count).flat_map(|i| self.places.iter().map(move |p| (i, p))).map(|(i, p)| number(i, p)).collect()
        };
        Pixels {
            radiance: list(|p| &p.radiance),
            transmittance: list(|p| &p.transmittance),
            error: list(|p| &p.error),
            rounding: list(|p| &p.rounding),
            evaluations: parts.iter().map(|p| p.evaluations).sum(),
            incomplete: parts.iter().map(|p| p.incomplete).sum(),
        }
    }
}
