//! The files of the machine, for the compiler and for the engines.

use crate::data::mesh::{self, Mesh};
use crate::data::splats::{self, Splats};
use crate::data::{self, LoadWarning, Volume};
use compiler::ir::{GridInfo, MeshInfo, SplatsInfo};
use compiler::loader::{GridHeader, LoadError, Loader, MeshHeader, SplatsHeader};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// The name of a scene that is read from standard input.
pub const STDIN: &str = "-";

/// Texts longer than this are no scenes.
const MAX_TEXT: u64 = 64 << 20;

/// Everything that a scene reads: texts and headers for the compiler, voxels, triangles and splats for the engines.
pub trait SceneFiles: Loader {
    /// Reads the grids of a program. Element `i` is grid `i`.
    ///
    /// # Errors
    /// What is wrong, and with which grid.
    fn volumes(&self, grids: &[GridInfo]) -> Result<Vec<Loaded>, (LoadError, usize)>;

    /// Reads the meshes of a program. Element `i` is mesh `i`.
    ///
    /// # Errors
    /// What is wrong, and with which mesh.
    fn meshes(&self, meshes: &[MeshInfo]) -> Result<Vec<LoadedMesh>, (LoadError, usize)>;

    /// Reads the splats of a program. Element `i` is item `i` of splats.
    ///
    /// # Errors
    /// What is wrong, and with which item.
    fn read_splats(&self, splats: &[SplatsInfo]) -> Result<Vec<LoadedSplats>, (LoadError, usize)>;
}

/// Reads modules, grids, meshes and splats from the file system. Paths in a scene are relative to the file that names them; names of
/// sources are relative to `root`, and the scene from standard input lies in `root` itself.
#[derive(Clone, Debug)]
pub struct FileLoader {
    root: PathBuf,
}

impl Default for FileLoader {
    /// Relative to the folder in which the program was started.
    fn default() -> Self {
        Self::new("")
    }
}

impl FileLoader {
    /// Names are relative to this folder.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The name of what `path` means in the source `from`.
    fn resolve(from: &str, path: &str) -> String {
        let folder = if from == STDIN { Path::new("") } else { Path::new(from).parent().unwrap_or(Path::new("")) };
        let mut parts: Vec<Component<'_>> = vec![];
        let joined = folder.join(path);
        for part in joined.components() {
            match (part, parts.last()) {
                (Component::CurDir, _) => {}
                (Component::ParentDir, Some(Component::Normal(_))) => _ = parts.pop(),
                _ => parts.push(part),
            }
        }
        let name: PathBuf = parts.iter().collect();
        // One spelling on every system, since diagnostics and snapshots print it.
        name.to_string_lossy().replace('\\', "/")
    }

    /// Reads a scene or a module.
    ///
    /// # Errors
    /// `E0601` when there is no such file, it is a folder, too long, or no UTF-8.
    pub fn text(&self, name: &str) -> Result<String, LoadError> {
        let fail = |what: &str, hint: Option<&str>| LoadError {
            code: "E0601",
            message: format!("`{name}` {what}"),
            hint: hint.map(Into::into),
        };
        let path = self.root.join(name);
        let facts = fs::metadata(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => fail("does not exist", None),
            _ => fail(&format!("cannot be read: {e}"), None),
        })?;
        if facts.is_dir() {
            return Err(fail("is a folder, not a file", None));
        }
        if facts.len() > MAX_TEXT {
            return Err(fail("is too long for a scene", None));
        }
        let bytes = fs::read(&path).map_err(|e| fail(&format!("cannot be read: {e}"), None))?;
        String::from_utf8(bytes).map_err(|_| fail("is not UTF-8 text", Some("scenes are text in UTF-8")))
    }
}

fn changed(name: &str) -> LoadError {
    LoadError {
        code: "E0601",
        message: format!("`{name}` changed while it was read"),
        hint: Some("start again".into()),
    }
}

/// One grid in memory.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// Name of the file.
    pub name: String,
    /// Its voxels.
    pub volume: Arc<Volume>,
    /// What is worth telling; once for each file.
    pub warnings: Vec<LoadWarning>,
}

/// One mesh in memory.
#[derive(Clone, Debug)]
pub struct LoadedMesh {
    /// Name of the file.
    pub name: String,
    /// Its triangles, in metres.
    pub mesh: Arc<Mesh>,
    /// What is worth telling; once for each file.
    pub warnings: Vec<LoadWarning>,
}

/// One file of splats in memory.
#[derive(Clone, Debug)]
pub struct LoadedSplats {
    /// Name of the file.
    pub name: String,
    /// Its splats, in metres.
    pub splats: Arc<Splats>,
    /// What is worth telling; once for each file.
    pub warnings: Vec<LoadWarning>,
}

impl Loader for FileLoader {
    fn module(&self, from: &str, path: &str) -> Result<(String, String), LoadError> {
        let name = Self::resolve(from, path);
        self.text(&name).map(|text| (name, text))
    }

    fn grid(&self, from: &str, path: &str) -> Result<GridHeader, LoadError> {
        data::read_header(&self.root.join(Self::resolve(from, path)))
    }

    fn mesh(&self, from: &str, path: &str) -> Result<MeshHeader, LoadError> {
        mesh::read_mesh_header(&self.root.join(Self::resolve(from, path)))
    }

    fn splats(&self, from: &str, path: &str) -> Result<SplatsHeader, LoadError> {
        splats::read_splats(&self.root.join(Self::resolve(from, path))).map(|(splats, _)| splats.header())
    }
}

/// What is read of a list of items: the names of their files, and for each item its file's content with the warnings of reading
/// it. Each file is read once, and its warnings are told once.
fn each_once<T>(
    names: impl Iterator<Item = String>,
    mut read: impl FnMut(usize, &str) -> Result<(Arc<T>, Vec<LoadWarning>), LoadError>,
) -> Result<Vec<(String, Arc<T>, Vec<LoadWarning>)>, (LoadError, usize)> {
    let mut loaded: Vec<(String, Arc<T>, Vec<LoadWarning>)> = vec![];
    for (i, name) in names.enumerate() {
        let same = loaded.iter().find(|l| l.0 == name).map(|l| l.1.clone());
        let (content, warnings) = match same {
            Some(content) => (content, vec![]),
            None => read(i, &name).map_err(|e| (e, i))?,
        };
        loaded.push((name, content, warnings));
    }
    Ok(loaded)
}

/// Unless a file says something else now than when the scene was checked.
fn unchanged(same: bool, name: &str) -> Result<(), LoadError> {
    if same { Ok(()) } else { Err(changed(name)) }
}

impl SceneFiles for FileLoader {
    fn volumes(&self, grids: &[GridInfo]) -> Result<Vec<Loaded>, (LoadError, usize)> {
        let all = each_once(grids.iter().map(|g| Self::resolve(&g.from, &g.path)), |i, name| {
            let (volume, warnings) = data::read_volume(&self.root.join(name))?;
            // By their text: a number that is not one differs from itself, and must not here.
            unchanged(format!("{:?}", volume.header()) == format!("{:?}", grids[i].header), name)?;
            Ok((Arc::new(volume), warnings))
        })?;
        Ok(all.into_iter().map(|(name, volume, warnings)| Loaded { name, volume, warnings }).collect())
    }

    fn meshes(&self, meshes: &[MeshInfo]) -> Result<Vec<LoadedMesh>, (LoadError, usize)> {
        let all = each_once(meshes.iter().map(|m| Self::resolve(&m.from, &m.path)), |i, name| {
            let (mesh, warnings) = mesh::read_mesh(&self.root.join(name))?;
            unchanged(mesh.header() == meshes[i].header, name)?;
            Ok((Arc::new(mesh), warnings))
        })?;
        Ok(all.into_iter().map(|(name, mesh, warnings)| LoadedMesh { name, mesh, warnings }).collect())
    }

    fn read_splats(&self, splats: &[SplatsInfo]) -> Result<Vec<LoadedSplats>, (LoadError, usize)> {
        let all = each_once(splats.iter().map(|s| Self::resolve(&s.from, &s.path)), |i, name| {
            let (content, warnings) = splats::read_splats(&self.root.join(name))?;
            unchanged(content.header() == splats[i].header, name)?;
            Ok((Arc::new(content), warnings))
        })?;
        Ok(all.into_iter().map(|(name, splats, warnings)| LoadedSplats { name, splats, warnings }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_to_the_file_that_names_them() {
        for (from, path, expected) in [
            ("examples/brain.vol", "data/b.nii", "examples/data/b.nii"),
            ("examples/brain.vol", "./data/../b.nii", "examples/b.nii"),
            ("examples/brain.vol", "../b.nii", "b.nii"),
            ("brain.vol", "../b.nii", "../b.nii"),
            ("../x/brain.vol", "../../b.nii", "../../b.nii"),
            ("/a/b.vol", "c.nii", "/a/c.nii"),
            ("a/b.vol", "/c.nii", "/c.nii"),
            (STDIN, "data/b.nii", "data/b.nii"),
        ] {
            assert_eq!(FileLoader::resolve(from, path), expected, "{from} {path}");
        }
    }

    #[test]
    fn folders_missing_files_and_binaries_are_refused() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        fs::write(folder.path().join("a.vol"), [0xff, 0xfe]).expect("written");
        fs::write(folder.path().join("b.vol"), "// Туман").expect("written");
        fs::create_dir(folder.path().join("lib")).expect("made");
        let loader = FileLoader::new(folder.path());
        assert_eq!(loader.module("lib/x.vol", "../b.vol").expect("reads"), ("b.vol".into(), "// Туман".into()));
        for (name, what) in [("a.vol", "UTF-8"), ("lib", "folder"), ("c.vol", "does not exist")] {
            let error = loader.module(STDIN, name).expect_err(name);
            assert!(error.message.contains(what), "{}", error.message);
        }
        assert_eq!(loader.grid(STDIN, "c.nii").expect_err("is missing").code, "E0601");
    }

    #[test]
    fn meshes_are_found_beside_the_scene_and_read_once() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        fs::create_dir(folder.path().join("scenes")).expect("made");
        let file = folder.path().join("scenes/t.obj");
        fs::write(&file, "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\nf 1 1 2\n").expect("written");
        let loader = FileLoader::new(folder.path());
        let header = loader.mesh("scenes/a.vol", "t.obj").expect("reads");
        assert_eq!(header, MeshHeader { triangles: 1, bounds: ([0.0; 3], [1.0, 2.0, 0.0]) });
        let info = |path: &str| MeshInfo { path: path.into(), from: "scenes/a.vol".into(), span: None, header };
        let infos = [info("t.obj"), info("../scenes/t.obj")];
        let loaded = loader.meshes(&infos).expect("reads");
        assert!(Arc::ptr_eq(&loaded[0].mesh, &loaded[1].mesh));
        assert_eq!(loaded[0].warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["W0605", "N0606"]);
        assert_eq!(loaded[1].warnings.len(), 0);
        let (error, at) = loader.meshes(&[info("t.obj"), info("u.obj")]).expect_err("is missing");
        assert_eq!((error.code, at), ("E0601", 1));
        fs::write(&file, "v 0 0 0\nv 1 0 0\nv 0 3 0\nf 1 2 3\n").expect("written");
        assert!(loader.meshes(&infos).expect_err("changed").0.message.contains("changed"));
    }
}
