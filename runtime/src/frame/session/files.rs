//! Splats of files, for the GPU.

use super::{Session, Trouble};
use crate::frame::bounds::box_around;
use crate::frame::{Camera, Cast, Footprints, Frame, Params, Vec3};
use std::sync::Arc;

impl Session {
    /// As a camera sees them.
    pub(super) fn footprints_of_picture(
        &self,
        params: &Params,
        time: f64,
        (camera, frame): (&Camera, &Frame),
    ) -> Result<Arc<Footprints>, Trouble> {
        let cast = self.cast(params, time)?;
        let bands = self.parts_of_bands();
        let all = Footprints::of_picture(&cast, camera, &frame.eye, &bands, self.accuracy());
        Ok(Arc::new(all.in_rounds_of(self.round())))
    }

    /// On rays, each of which begins at a t.
    pub(super) fn footprints_of_rays(
        &self,
        params: &Params,
        time: f64,
        (rays, starts): (&[(Vec3, Vec3)], &[f64]),
    ) -> Result<Arc<Footprints>, Trouble> {
        let cast = self.cast(params, time)?;
        let bands = self.parts_of_bands();
        let all = Footprints::of_rays(&cast, rays, starts, &bands, self.accuracy());
        Ok(Arc::new(all.in_rounds_of(self.round())))
    }

    /// Entries of a list that a dispatch goes through.
    fn round(&self) -> u32 {
        self.program.plan.footprints.map_or(u32::MAX, |f| f.round)
    }

    fn cast(&self, params: &Params, time: f64) -> Result<Cast<'_>, Trouble> {
        Cast::new(&self.program.lowered, params, time, &self.splats).map_err(|d| self.input(d))
    }

    /// For each part of the program and each of its bands, the parts of red, green and blue.
    fn parts_of_bands(&self) -> Vec<Vec<Vec3>> {
        self.program.parts().map(|part| part.lowered.bands.resample()).collect()
    }

    /// The box around the media, or all that f32 can square where one has no end: where errors are shared out.
    pub(super) fn media_box(&self, params: &Params, time: f64) -> [Vec3; 2] {
        let scene = &self.program.lowered;
        box_around(scene, &scene.media, (&params.0, time)).unwrap_or([[-1e15; 3], [1e15; 3]])
    }

    /// The box around the media whose columns of light are kept, if there are any.
    pub(super) fn columns_box(&self, params: &Params, time: f64) -> Option<[Vec3; 2]> {
        let scene = &self.program.lowered;
        let mut kept: Vec<u32> =
            self.program.parts().filter_map(|p| p.plan.fill.as_ref()).flat_map(|f| f.media.clone()).collect();
        kept.sort_unstable();
        kept.dedup();
        box_around(scene, kept.iter().filter_map(|i| scene.media.get(*i as usize)), (&params.0, time))
    }
}
