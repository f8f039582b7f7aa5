//! Files are made in memory; rays are compared with brute force and with closed surfaces.

mod hostile;
mod rays;
mod read;

use super::*;
use crate::data::Memory;

fn load(name: &str, bytes: impl Into<Vec<u8>>) -> Result<(Mesh, Vec<LoadWarning>), LoadError> {
    read_mesh_from(&Memory::one(name, bytes), Path::new(name))
}

/// Corners of the cube from 1 to 2.
const CORNERS: [[f64; 3]; 8] = [
    [1.0, 1.0, 1.0],
    [2.0, 1.0, 1.0],
    [2.0, 2.0, 1.0],
    [1.0, 2.0, 1.0],
    [1.0, 1.0, 2.0],
    [2.0, 1.0, 2.0],
    [2.0, 2.0, 2.0],
    [1.0, 2.0, 2.0],
];

/// Its faces, counter-clockwise from outside.
const FACES: [[i32; 4]; 6] = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

/// `corner` and `face` write one line each; faces are counted from 1.
fn obj(corner: impl Fn([f64; 3]) -> String, face: impl Fn([i32; 4]) -> String) -> String {
    let mut text = String::from("# a cube\nmtllib cube.mtl\no cube\n");
    text.extend(CORNERS.map(corner));
    text.push_str("vt 0 0\nvn 0 0 1\ns off\nusemtl red\n");
    text.extend(FACES.map(|f| face(f.map(|i| i + 1))));
    text
}

/// The types of coordinates, of lengths and of indices in a PLY file.
#[derive(Copy, Clone)]
struct Types(&'static str, &'static str, &'static str);

/// `format` as in the header; a property before, between and after those that count, and an element that does not.
fn ply(format: &str, types: Types) -> Vec<u8> {
    let Types(coordinate, length, index) = types;
    let header = format!(
        "ply\nformat {format} 1.0\ncomment a cube\nobj_info of \u{fe}\nelement vertex 8\nproperty uchar red\n\
        property {coordinate} x\nproperty {coordinate} y\nproperty list uchar short list\nproperty {coordinate} z\n\
        element edge 1\nproperty int a\nelement face 6\nproperty double area\n\
        property list {length} {index} vertex_indices\nproperty uchar flags\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    let mut row = |values: &[(&str, f64)]| {
        if format == "ascii" {
            let words: Vec<String> = values.iter().map(|(_, v)| v.to_string()).collect();
            bytes.extend(format!("{}\n", words.join(" ")).into_bytes());
            return;
        }
        for (kind, v) in values {
            let mut word = match *kind {
                "char" | "int8" => (*v as i8).to_le_bytes().to_vec(),
                "uchar" | "uint8" => (*v as u8).to_le_bytes().to_vec(),
                "short" | "int16" => (*v as i16).to_le_bytes().to_vec(),
                "ushort" | "uint16" => (*v as u16).to_le_bytes().to_vec(),
                "int" | "int32" => (*v as i32).to_le_bytes().to_vec(),
                "uint" | "uint32" => (*v as u32).to_le_bytes().to_vec(),
                "float" | "float32" => (*v as f32).to_le_bytes().to_vec(),
                "double" | "float64" => v.to_le_bytes().to_vec(),
                other => panic!("{other}"),
            };
            if format == "binary_big_endian" {
                word.reverse();
            }
            bytes.extend(word);
        }
    };
    for [x, y, z] in CORNERS {
        row(&[
            ("uchar", 7.0),
            (coordinate, x),
            (coordinate, y),
            ("uchar", 2.0),
            ("short", -1.0),
            ("short", 300.0),
            (coordinate, z),
        ]);
    }
    row(&[("int", 5.0)]);
    for face in FACES {
        let mut values = vec![("double", 1.0), (length, 4.0)];
        values.extend(face.map(|i| (index, f64::from(i))));
        values.push(("uchar", 0.0));
        row(&values);
    }
    bytes
}

/// The volume inside a closed surface whose triangles run counter-clockwise from outside.
fn volume(triangles: &[Triangle]) -> f64 {
    let determinant = |t: &Triangle| {
        let [a, b, c] = t.map(|p| p.map(f64::from));
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    triangles.iter().map(determinant).sum::<f64>() / 6.0
}

#[track_caller]
fn assert_is_the_cube(loaded: Result<(Mesh, Vec<LoadWarning>), LoadError>, what: &str) {
    let (mesh, warnings) = loaded.unwrap_or_else(|e| panic!("{what}: {}: {}", e.code, e.message));
    assert_eq!(warnings, vec![], "{what}");
    assert_eq!(mesh.header(), MeshHeader { triangles: 12, bounds: ([1.0; 3], [2.0; 3]) }, "{what}");
    // Right corners, the right way round: volume and surface of a cube of edge 1.
    assert_eq!(volume(mesh.triangles()), 1.0, "{what}");
    let area: f64 =
        mesh.triangles().iter().map(|t| soup::cross(t).iter().map(|x| x * x).sum::<f64>().sqrt() / 2.0).sum();
    assert_eq!(area, 6.0, "{what}");
    // From the middle, each wall is half an edge away.
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let direction: [f64; 3] = std::array::from_fn(|i| if i == axis { sign } else { 0.0 });
            let (t, triangle) = mesh.nearest([1.5; 3], direction, (0.0, f64::INFINITY)).expect("a wall");
            assert_eq!((t, mesh.normal(triangle)), (0.5, direction), "{what}");
        }
    }
}
