//! Any bytes as a file of triangles: as OBJ, and as PLY behind its first line. Good seeds are in `fuzz/seeds/mesh`; run with
//! `-- -dict=fuzz/ply.dict -max_len=4000`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use runtime::data::Memory;
use runtime::data::mesh::read_mesh_from;
use std::path::Path;

fn read(name: &str, bytes: Vec<u8>) {
    let length = bytes.len();
    if let Ok((mesh, _)) = read_mesh_from(&Memory::one(name, bytes), Path::new(name)) {
        assert!(!mesh.triangles().is_empty() && mesh.triangles().len() <= length);
        assert!(mesh.triangles().iter().flatten().flatten().all(|x| x.is_finite()));
    }
}

fuzz_target!(|bytes: &[u8]| {
    read("a.obj", bytes.to_vec());
    read("a.ply", [b"ply\n", bytes].concat());
});
