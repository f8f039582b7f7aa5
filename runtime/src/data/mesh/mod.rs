//! Readers of files of triangles: Wavefront OBJ and PLY (`ascii`, `binary_little_endian`, `binary_big_endian`), and the
//! tree of boxes in which rays find them.
//!
//! # Conventions
//! - Coordinates are **metres**, taken as they stand: neither format has a unit. They are kept as 32-bit floating point.
//! - Polygons become fans around their first corner, which is right for convex ones.
//! - Triangles are sheets with two sides: inconsistent orientations need no care, and through holes light passes. That a surface
//!   is not closed is told in a note, since a leaf is not meant to be.
//! - Triangles without an area, and triangles with a corner that is not finite, are left out, counted and reported as a
//!   [`LoadWarning`].
//! - Materials, normals, texture coordinates, colours, lines and points are ignored.
//!
//! The readers are our own: of what the formats hold only corners and faces are wanted, errors must name the line, and the
//! crates for it stop the whole file at a `nan`, at a comment that is not UTF-8, or panic at a texture index out of range.
//!
//! The same trust as for volumes: no header is believed about sizes, and no input makes the readers panic.

mod bvh;
mod hit;
mod obj;
mod ply;
mod soup;
#[cfg(test)]
mod tests;

pub use bvh::Node;

use super::input::{Disk, Files};
use super::{Codes, LoadWarning, has_ending, named};
use compiler::loader::{LoadError, MeshHeader};
use soup::Soup;
use std::path::Path;

/// A file that breaks its format, and one that ends early.
const CODES: Codes = Codes { broken: "E0612", truncated: "E0613" };

/// The most triangles that are read. The GPU's nodes have 29 bits for the number of a triangle; memory ends earlier.
pub const MAX_TRIANGLES: usize = 1 << 26;

/// One triangle: its three corners in metres.
pub type Triangle = [[f32; 3]; 3];

/// Triangles in metres, in the order of the leaves of their tree. At least one; all corners are finite, all areas above
/// zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
}

impl Mesh {
    /// Leaves out what is no triangle, counts it, and builds the tree.
    ///
    /// # Errors
    /// `E0615` when no triangle remains, `E0616` when there are more than [`MAX_TRIANGLES`].
    pub fn new(triangles: Vec<Triangle>) -> Result<(Self, Vec<LoadWarning>), LoadError> {
        if triangles.len() > MAX_TRIANGLES {
            return Err(soup::too_large());
        }
        let (mut triangles, mut warnings) = soup::sanitise(triangles)?;
        warnings.extend(soup::holes(&triangles));
        let nodes = bvh::build(&mut triangles);
        Ok((Self { triangles, nodes }, warnings))
    }

    /// The triangles, leaf by leaf.
    #[must_use]
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// The tree, in depth-first order; the first node is its root.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Number of nodes of the tree.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// What the compiler is told.
    #[must_use]
    pub fn header(&self) -> MeshHeader {
        let Node { min, max, .. } = self.nodes[0];
        MeshHeader { triangles: self.triangles.len() as u32, bounds: (min.map(f64::from), max.map(f64::from)) }
    }
}

/// What a file of triangles holds. Neither format says so in advance, so all of it is read.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_header(path: &Path) -> Result<MeshHeader, LoadError> {
    let read = || {
        let (triangles, _) = soup::sanitise(read_soup(&Disk, path)?.triangles()?)?;
        let (min, max) = bvh::bounds(&triangles);
        Ok(MeshHeader { triangles: triangles.len() as u32, bounds: (min.map(f64::from), max.map(f64::from)) })
    };
    read().map_err(|e| named(path, e))
}

/// Reads a file of triangles and builds its tree.
///
/// # Errors
/// `E0601` when there is no such file, `E0611` to `E0616` when it is no mesh, broken, cut off, has an index out of range,
/// no triangle, or too many.
pub fn read_mesh(path: &Path) -> Result<(Mesh, Vec<LoadWarning>), LoadError> {
    read_mesh_from(&Disk, path)
}

/// [`read_mesh`] from any set of files.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_from(files: &dyn Files, path: &Path) -> Result<(Mesh, Vec<LoadWarning>), LoadError> {
    read_soup(files, path).and_then(Soup::triangles).and_then(Mesh::new).map_err(|e| named(path, e))
}

/// Looks at the first bytes, then at the ending, since OBJ has no mark of its own.
fn read_soup(files: &dyn Files, path: &Path) -> Result<Soup, LoadError> {
    let mut input = files.open(path)?;
    let head = input.peek(4)?;
    if head.is_empty() {
        return Err(broken("is empty"));
    }
    if head.starts_with(b"ply") && head.get(3).is_none_or(u8::is_ascii_whitespace) {
        let length = input.length();
        return ply::read(input.into_reader(0)?, length);
    }
    if has_ending(path, &["obj"]) {
        return obj::read(input.into_reader(0)?);
    }
    if has_ending(path, &["ply"]) {
        return Err(broken("does not start with `ply`"));
    }
    Err(not_a_mesh())
}

/// `E0611`: neither kind.
fn not_a_mesh() -> LoadError {
    LoadError {
        code: "E0611",
        message: "is not a mesh of a known kind".into(),
        hint: Some("use Wavefront OBJ (.obj) or PLY (.ply)".into()),
    }
}

/// `E0612`: the file breaks its format.
fn broken(message: impl Into<String>) -> LoadError {
    CODES.broken(message)
}
