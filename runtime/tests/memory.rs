//! Memory of the readers of volumes, meshes and splats, under an allocator that refuses more than it is allowed. One test, since the limit
//! counts for the whole process.

use cap::Cap;
use runtime::data::mesh::read_mesh_from;
use runtime::data::splats::read_splats_from;
use runtime::data::{Memory, read_header, read_volume, read_volume_from};
use std::alloc::System;
use std::io::Write;
use std::path::Path;

#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, usize::MAX);

/// Runs with at most `bytes` on top of what is allocated now. Whatever asks for more and does not expect a refusal
/// aborts the process, and with it the test.
fn within<T>(bytes: usize, work: impl FnOnce() -> T) -> T {
    ALLOCATOR.set_limit(ALLOCATOR.allocated() + bytes).expect("a limit above what is allocated");
    let result = work();
    ALLOCATOR.set_limit(usize::MAX).expect("no limit");
    result
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(vec![], flate2::Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A NIfTI-1 header of f32 voxels.
fn nifti(dims: [i16; 3]) -> Vec<u8> {
    let mut b = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| b[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    put(344, b"n+1\0");
    put(40, &3_i16.to_le_bytes());
    put(70, &16_i16.to_le_bytes());
    for (n, size) in dims.iter().enumerate() {
        put(42 + 2 * n, &size.to_le_bytes());
        put(80 + 4 * n, &1_f32.to_le_bytes());
    }
    b
}

const SLACK: usize = 3 << 20;

#[test]
fn voxels_are_held_once_and_headers_are_not_believed() {
    let brain = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/data/mni152_t1_1mm.nii.gz");
    // Threads for the pass over the voxels are started by the first load and stay.
    let (small, _) = read_volume_from(&Memory::one("a.nii", [nifti([1; 3]), vec![0; 4]].concat()), Path::new("a.nii"))
        .expect("a voxel");
    drop(small);

    let voxels = 197 * 233 * 189;
    let (volume, _) = within(voxels + SLACK, || read_volume(&brain)).expect("the brain");
    assert_eq!(volume.bytes().len(), voxels);
    drop(volume);
    within(SLACK, || read_header(&brain)).expect("its header alone needs no voxels");

    // 16 GB promised (below the readers' cap), a few bytes there: packed and raw.
    let lie = [nifti([2000, 2000, 1000]), vec![0; 1000]].concat();
    for (name, bytes) in [("a.nii", lie.clone()), ("a.nii.gz", gzip(&lie))] {
        let files = Memory::one(name, bytes);
        let error = within(SLACK, || read_volume_from(&files, Path::new(name))).unwrap_err();
        assert_eq!(error.code, "E0604", "{name}: {}", error.message);
    }

    // A promise that the length of the stream allows, but not its content: at most twice what arrived.
    let arrived = 4 << 20;
    let mut stream = gzip(&[nifti([2000, 2000, 4]), vec![0; arrived]].concat());
    stream.extend(vec![0; 1 << 20]);
    let files = Memory::one("a.nii.gz", stream);
    let error =
        within(2 * arrived + SLACK + (1 << 20), || read_volume_from(&files, Path::new("a.nii.gz"))).unwrap_err();
    assert_eq!(error.code, "E0604", "{}", error.message);

    let lines = "NRRD0004\ntype: double\ndimension: 3\nsizes: 1000 1000 2000\nencoding: ";
    for encoding in ["raw\nendian: big", "gzip\nendian: big", "hex\nendian: big", "text"] {
        let files = Memory::one("a.nrrd", [lines.as_bytes(), encoding.as_bytes(), b"\n\n1 2 3 4 5"].concat());
        let error = within(SLACK, || read_volume_from(&files, Path::new("a.nrrd"))).unwrap_err();
        assert_eq!(error.code, "E0604", "{encoding}: {}", error.message);
    }
    // A header without end: a megabyte is looked at, as bytes and as fields.
    let files = Memory::one("a.nrrd", [b"NRRD0004\n".to_vec(), vec![b':'; 5 << 20]].concat());
    assert!(within((5 << 20) + 2 * SLACK, || read_volume_from(&files, Path::new("a.nrrd"))).is_err());

    // Counts of a PLY header, and lengths of its lists.
    let corners = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let list = "property list uint int vertex_indices\n";
    let body = [&[0; 36][..], &u32::MAX.to_le_bytes(), &[0; 12]].concat();
    for (counts, code) in [
        (corners.replace('3', "4000000000"), "E0613"),
        (format!("{corners}element face 4000000000\n{list}"), "E0613"),
        (format!("{corners}element face 1\n{list}"), "E0613"),
        (format!("{corners}element nothing 4000000000\nelement face 1\n{list}"), "E0613"),
    ] {
        let start = format!("ply\nformat binary_little_endian 1.0\n{counts}end_header\n");
        let files = Memory::one("a.ply", [start.as_bytes(), &body].concat());
        let error = within(SLACK, || read_mesh_from(&files, Path::new("a.ply"))).map(|_| ()).unwrap_err();
        assert_eq!(error.code, code, "{counts}: {}", error.message);
    }

    // Splats: a count that nothing bears out, and a file of a hundred thousand of degree 3, zeros but for its rotations.
    let header = |count: u32| [b"NGSP\x03\0\0\0".as_slice(), &count.to_le_bytes(), &[3, 12, 0, 0]].concat();
    let files = Memory::one("a.spz", gzip(&[header(60_000_000), vec![0; 1000]].concat()));
    let error = within(SLACK, || read_splats_from(&files, Path::new("a.spz"))).map(|_| ()).unwrap_err();
    assert_eq!(error.code, "E0662", "{}", error.message);
    let count = 100_000;
    let files = Memory::one("a.spz", gzip(&[header(count as u32), vec![0; 65 * count]].concat()));
    // Vectors may be twice as long as what is in them, here and in the decompressed blocks.
    let (splats, _) =
        within(2 * (236 + 65) * count + SLACK, || read_splats_from(&files, Path::new("a.spz"))).expect("reads");
    assert_eq!((splats.len(), splats.bytes_per_splat()), (count, 236));
}
