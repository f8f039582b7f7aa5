//! Files of splats that are made and not read.

use compiler::ir::{GridInfo, MeshInfo, SplatsInfo};
use compiler::loader::{GridHeader, LoadError, Loader, SplatsHeader};
use runtime::data::splats::Splats;
use runtime::frame::{Loaded, LoadedMesh, LoadedSplats, SceneFiles};
use std::sync::Arc;

/// Splats of whatever file a scene names.
#[derive(Clone, Debug)]
pub struct Made(pub Arc<Splats>);

impl Loader for Made {
    fn module(&self, _: &str, path: &str) -> Result<(String, String), LoadError> {
        panic!("{path}")
    }

    fn grid(&self, _: &str, path: &str) -> Result<GridHeader, LoadError> {
        panic!("{path}")
    }

    fn splats(&self, _: &str, _: &str) -> Result<SplatsHeader, LoadError> {
        Ok(self.0.header())
    }
}

impl SceneFiles for Made {
    fn volumes(&self, _: &[GridInfo]) -> Result<Vec<Loaded>, (LoadError, usize)> {
        Ok(vec![])
    }

    fn meshes(&self, _: &[MeshInfo]) -> Result<Vec<LoadedMesh>, (LoadError, usize)> {
        Ok(vec![])
    }

    fn read_splats(&self, splats: &[SplatsInfo]) -> Result<Vec<LoadedSplats>, (LoadError, usize)> {
        let one = |s: &SplatsInfo| LoadedSplats { name: s.path.clone(), splats: self.0.clone(), warnings: vec![] };
        Ok(splats.iter().map(one).collect())
    }
}
