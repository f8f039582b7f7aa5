//! Files are made in memory, so that every case stands in the test that needs it.

mod hostile;
mod nifti;
mod nrrd;
mod sanitise;

use super::*;
use compiler::loader::Scalar;
use std::path::PathBuf;

/// The brain of the examples.
fn brain() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/data/mni152_t1_1mm.nii.gz")
}

fn load(name: &str, bytes: impl Into<Vec<u8>>) -> Result<(Volume, Vec<LoadWarning>), LoadError> {
    read_volume_from(&Memory::one(name, bytes), Path::new(name))
}

fn load_ok(name: &str, bytes: impl Into<Vec<u8>>) -> Volume {
    load(name, bytes).unwrap_or_else(|e| panic!("{}: {} ({:?})", e.code, e.message, e.hint)).0
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(vec![], flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A sample as it stands in a file.
fn encode(scalar: Scalar, value: f64, big_endian: bool) -> Vec<u8> {
    let mut bytes = match scalar {
        Scalar::U8 => (value as u8).to_le_bytes().to_vec(),
        Scalar::I8 => (value as i8).to_le_bytes().to_vec(),
        Scalar::U16 => (value as u16).to_le_bytes().to_vec(),
        Scalar::I16 => (value as i16).to_le_bytes().to_vec(),
        Scalar::U32 => (value as u32).to_le_bytes().to_vec(),
        Scalar::I32 => (value as i32).to_le_bytes().to_vec(),
        Scalar::U64 => (value as u64).to_le_bytes().to_vec(),
        Scalar::I64 => (value as i64).to_le_bytes().to_vec(),
        Scalar::F32 => (value as f32).to_le_bytes().to_vec(),
        Scalar::F64 => value.to_le_bytes().to_vec(),
    };
    if big_endian {
        bytes.reverse();
    }
    bytes
}

const SCALARS: [Scalar; 10] = [
    Scalar::U8,
    Scalar::I8,
    Scalar::U16,
    Scalar::I16,
    Scalar::U32,
    Scalar::I32,
    Scalar::U64,
    Scalar::I64,
    Scalar::F32,
    Scalar::F64,
];

/// Values that each type can hold exactly and whose bytes differ, ends of the range among them.
fn samples(scalar: Scalar) -> Vec<f64> {
    let ends = match scalar {
        Scalar::U8 => [0.0, 255.0],
        Scalar::I8 => [-128.0, 127.0],
        Scalar::U16 => [0.0, 65535.0],
        Scalar::I16 => [-32768.0, 32767.0],
        Scalar::U32 => [0.0, 4294967295.0],
        Scalar::I32 => [-2147483648.0, 2147483647.0],
        Scalar::U64 => [0.0, (u64::MAX - 2047) as f64],
        Scalar::I64 => [i64::MIN as f64, (i64::MAX - 1023) as f64],
        Scalar::F32 => [f64::from(f32::MIN), f64::from(f32::MAX)],
        Scalar::F64 => [-1e300, 1e300],
    };
    (0..22).map(f64::from).chain(ends).collect()
}

/// Applies a map to a voxel index.
fn apply(map: &[[f64; 4]; 3], p: [f64; 3]) -> [f64; 3] {
    map.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3])
}

#[track_caller]
fn assert_near(a: [f64; 3], b: [f64; 3]) {
    let near = a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9 * (1.0 + b.abs()));
    assert!(near, "{a:?} is not {b:?}");
}

#[test]
fn the_brain_of_the_examples_loads() {
    let (volume, warnings) = read_volume(&brain()).unwrap();
    let header = volume.header();
    assert_eq!(header.dims, [197, 233, 189]);
    assert_eq!(header.scalar, Scalar::U8);
    assert_eq!((header.slope, header.intercept), (1.0, 0.0));
    assert_near(apply(&header.world_from_index, [0.0; 3]), [-0.098, -0.134, -0.072]);
    assert_near(apply(&header.world_from_index, [98.0, 134.0, 72.0]), [0.0; 3]);
    assert_eq!(header.world_from_index[0][0], 0.001);
    assert_eq!(volume.bytes().len(), 197 * 233 * 189);
    assert_eq!(volume.voxels().allocated(), 197 * 233 * 189, "the voxels are held once and without slack");
    assert_eq!(warnings, vec![]);
    let (low, high) = volume.range();
    assert!(low == 0.0 && high > 200.0 && high <= 255.0, "{low} to {high}");
    assert_eq!(read_header(&brain()).unwrap(), *header);
}

#[test]
fn every_code_is_explained() {
    for code in ["E0601", "E0602", "E0603", "E0604", "E0605", "E0606", "E0607", "E0608", "E0609", "E0610"] {
        assert!(compiler::diagnostic::explain(code).is_some(), "{code}");
    }
    for code in ["W0601", "W0602", "W0603", "W0604", "W0605", "N0606", "E0620", "E0621", "E0622"] {
        assert!(compiler::diagnostic::explain(code).is_some(), "{code}");
    }
}

#[test]
fn missing_files_and_folders_are_refused() {
    let folder = brain().parent().unwrap().to_path_buf();
    let error = read_volume(&folder.join("MNI152_T1_1mm.nii")).unwrap_err();
    assert_eq!(error.code, "E0601");
    assert_eq!(error.hint.as_deref(), Some("did you mean `mni152_t1_1mm.nii.gz`?"));
    let error = read_header(&folder.join("nothing.nrrd")).unwrap_err();
    assert_eq!(error.hint.as_deref(), Some("paths are relative to the file that names them"));
    assert_eq!(read_volume(&folder).unwrap_err().code, "E0601");
    let error = read_volume(&folder.join("README.md")).unwrap_err();
    assert_eq!(error.code, "E0602");
    assert!(error.message.ends_with("is not a volume file of a known kind"), "{}", error.message);
}
