//! How text and grid headers reach the compiler, which opens no file itself.

use serde::Serialize;

/// What a file of voxels says about itself, before any voxel is read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GridHeader {
    /// Samples along x, y, z; each at least 1.
    pub dims: [u32; 3],
    /// How a sample is stored.
    pub scalar: Scalar,
    /// A value is `slope · stored + intercept`.
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
    /// Rows of the 3×4 affine map from voxel index (samples at whole numbers) to world space in metres.
    pub world_from_index: [[f64; 4]; 3],
}

/// What a file of triangles holds, in metres.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct MeshHeader {
    /// Number of triangles that have an area.
    pub triangles: u32,
    /// Lower and upper corner of the box around them.
    pub bounds: ([f64; 3], [f64; 3]),
}

/// What a file of 3D Gaussian splats holds, in metres.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct SplatsHeader {
    /// Number of splats.
    pub count: u32,
    /// Degree of their spherical harmonics, 0 to 3.
    pub degree: u8,
    /// Lower and upper corner of the box around their centres.
    pub bounds: ([f64; 3], [f64; 3]),
    /// The same without the hundredth of centres that is lowest and the hundredth that is highest along each axis.
    pub core: ([f64; 3], [f64; 3]),
}

/// How a voxel is stored.
#[derive(Copy, Clone, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names are the types")]
pub enum Scalar {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Scalar {
    /// Bytes of one sample.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// Why a loader could not deliver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadError {
    /// A diagnostic code of the range `E06xx`.
    pub code: &'static str,
    /// One sentence for the person who wrote the scene.
    pub message: String,
    /// What to try, if there is something.
    pub hint: Option<String>,
}

/// Gives the compiler the texts and headers that a scene names.
pub trait Loader {
    /// The text of a `use`d module. `from` is the name of the source that asks (as given to [`crate::source::Sources`]),
    /// `path` what stands in the string. Returns the name under which the module is known (so that the same file
    /// reached by two paths is one module) and its text.
    ///
    /// # Errors
    /// When there is no such file or it is no text.
    fn module(&self, from: &str, path: &str) -> Result<(String, String), LoadError>;

    /// The header of a grid file. `from` and `path` as above.
    ///
    /// # Errors
    /// When the file is missing, of an unknown kind, or broken.
    fn grid(&self, from: &str, path: &str) -> Result<GridHeader, LoadError>;

    /// What a file of triangles holds. `from` and `path` as above.
    ///
    /// # Errors
    /// When the file is missing, of an unknown kind, or broken; loaders that know no meshes refuse all.
    fn mesh(&self, from: &str, path: &str) -> Result<MeshHeader, LoadError> {
        let _ = from;
        Err(NoFiles::refuse(path))
    }

    /// What a file of splats holds. `from` and `path` as above.
    ///
    /// # Errors
    /// When the file is missing, of an unknown kind, or broken; loaders that know no splats refuse all.
    fn splats(&self, from: &str, path: &str) -> Result<SplatsHeader, LoadError> {
        let _ = from;
        Err(NoFiles::refuse(path))
    }
}

/// A loader for scenes that name no file.
#[derive(Copy, Clone, Debug, Default)]
pub struct NoFiles;

impl NoFiles {
    fn refuse(path: &str) -> LoadError {
        LoadError {
            code: "E0601",
            message: format!("there is no file `{path}`: this compilation has no files"),
            hint: None,
        }
    }
}

impl Loader for NoFiles {
    fn module(&self, _from: &str, path: &str) -> Result<(String, String), LoadError> {
        Err(Self::refuse(path))
    }

    fn grid(&self, _from: &str, path: &str) -> Result<GridHeader, LoadError> {
        Err(Self::refuse(path))
    }
}
