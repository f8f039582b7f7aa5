//! The scene's files, altered on their way in.

use crate::data::mesh::Mesh;
use crate::data::{Volume, Voxels};
use crate::frame::{Loaded, LoadedMesh, LoadedSplats, SceneFiles};
use compiler::ir::{GridInfo, MeshInfo, SplatsInfo};
use compiler::loader::{GridHeader, LoadError, Loader, MeshHeader, Scalar, SplatsHeader};
use std::sync::Arc;

/// What is wrong with some voxels.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum Poison {
    NotANumber,
    Infinite,
    Negative,
    Denormal,
}

impl Poison {
    pub(super) const ALL: [Self; 4] = [Self::NotANumber, Self::Infinite, Self::Negative, Self::Denormal];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::NotANumber => "NaN",
            Self::Infinite => "infinite",
            Self::Negative => "negative",
            Self::Denormal => "denormal",
        }
    }

    fn value(self, largest: f32) -> f32 {
        match self {
            Self::NotANumber => f32::NAN,
            Self::Infinite => f32::INFINITY,
            Self::Negative => -largest.max(1.0),
            Self::Denormal => 1e-41,
        }
    }
}

/// One voxel in so many is bad; coprime to the sides of most grids, so that bad ones do not fall into planes.
const EVERY: usize = 97;

/// Grids, meshes and splats stretched, and grids with bad voxels, which only floating point can hold: they become f32.
pub(super) struct Altered<'a> {
    pub(super) inner: &'a dyn SceneFiles,
    pub(super) stretch: f64,
    pub(super) poison: Option<Poison>,
}

impl Altered<'_> {
    fn header(&self, header: GridHeader) -> GridHeader {
        GridHeader {
            world_from_index: header.world_from_index.map(|row| row.map(|v| v * self.stretch)),
            scalar: if self.poison.is_some() { Scalar::F32 } else { header.scalar },
            ..header
        }
    }

    fn volume(&self, volume: &Volume) -> Result<Loaded, LoadError> {
        let voxels = match self.poison {
            None => volume.voxels().clone(),
            Some(poison) => {
                let mut list: Vec<f32> = (0..volume.voxels().len()).map(|i| volume.voxels().get(i) as f32).collect();
                let largest = list.iter().copied().fold(0.0, f32::max);
                list.iter_mut().skip(EVERY / 2).step_by(EVERY).for_each(|v| *v = poison.value(largest));
                Voxels::F32(list)
            }
        };
        let (volume, warnings) = Volume::new(self.header(volume.header().clone()), voxels)?;
        Ok(Loaded { name: String::new(), volume: Arc::new(volume), warnings })
    }
}

impl Loader for Altered<'_> {
    fn module(&self, from: &str, path: &str) -> Result<(String, String), LoadError> {
        self.inner.module(from, path)
    }

    fn grid(&self, from: &str, path: &str) -> Result<GridHeader, LoadError> {
        Ok(self.header(self.inner.grid(from, path)?))
    }

    fn mesh(&self, from: &str, path: &str) -> Result<MeshHeader, LoadError> {
        let MeshHeader { triangles, bounds: (low, high) } = self.inner.mesh(from, path)?;
        // As the corners will be, which are kept in f32.
        let stretched = |corner: [f64; 3]| corner.map(|x| f64::from((x * self.stretch) as f32));
        Ok(MeshHeader { triangles, bounds: (stretched(low), stretched(high)) })
    }

    fn splats(&self, from: &str, path: &str) -> Result<SplatsHeader, LoadError> {
        let header = self.inner.splats(from, path)?;
        // As the centres will be; their order stays.
        let stretched = |corner: [f64; 3]| corner.map(|x| f64::from((x * self.stretch) as f32));
        let both = |(low, high)| (stretched(low), stretched(high));
        Ok(SplatsHeader { bounds: both(header.bounds), core: both(header.core), ..header })
    }
}

impl SceneFiles for Altered<'_> {
    fn volumes(&self, grids: &[GridInfo]) -> Result<Vec<Loaded>, (LoadError, usize)> {
        let own: Result<Vec<GridInfo>, _> = grids
            .iter()
            .enumerate()
            .map(|(i, g)| Ok(GridInfo { header: self.inner.grid(&g.from, &g.path).map_err(|e| (e, i))?, ..g.clone() }))
            .collect();
        let loaded = self.inner.volumes(&own?)?;
        let altered = |(i, l): (usize, Loaded)| {
            let altered = self.volume(&l.volume).map_err(|e| (e, i))?;
            Ok(Loaded { name: l.name, ..altered })
        };
        loaded.into_iter().enumerate().map(altered).collect()
    }

    fn meshes(&self, meshes: &[MeshInfo]) -> Result<Vec<LoadedMesh>, (LoadError, usize)> {
        let own: Result<Vec<MeshInfo>, _> = meshes
            .iter()
            .enumerate()
            .map(|(i, m)| Ok(MeshInfo { header: self.inner.mesh(&m.from, &m.path).map_err(|e| (e, i))?, ..m.clone() }))
            .collect();
        let loaded = self.inner.meshes(&own?)?;
        let stretched = |(i, l): (usize, LoadedMesh)| {
            let corner = |x: f32| (f64::from(x) * self.stretch) as f32;
            let triangles = l.mesh.triangles().iter().map(|t| t.map(|c| c.map(corner))).collect();
            let (mesh, warnings) = Mesh::new(triangles).map_err(|e| (e, i))?;
            Ok(LoadedMesh { name: l.name, mesh: Arc::new(mesh), warnings })
        };
        loaded.into_iter().enumerate().map(stretched).collect()
    }

    fn read_splats(&self, splats: &[SplatsInfo]) -> Result<Vec<LoadedSplats>, (LoadError, usize)> {
        let own: Result<Vec<SplatsInfo>, _> = splats
            .iter()
            .enumerate()
            .map(|(i, s)| {
                Ok(SplatsInfo { header: self.inner.splats(&s.from, &s.path).map_err(|e| (e, i))?, ..s.clone() })
            })
            .collect();
        let loaded = self.inner.read_splats(&own?)?;
        let stretched = |(i, l): (usize, LoadedSplats)| {
            let (splats, warnings) = l.splats.stretched(self.stretch).map_err(|e| (e, i))?;
            Ok(LoadedSplats { name: l.name, splats: Arc::new(splats), warnings })
        };
        loaded.into_iter().enumerate().map(stretched).collect()
    }
}
