//! Headers that lie, break off or ask for too much: each gives its code, and never a panic.

use super::nifti::{Builder, plain};
use super::nrrd::attached;
use super::*;
use proptest::prelude::*;

type Change = fn(&mut Builder);

#[test]
fn broken_nifti_headers() {
    #[rustfmt::skip]
    let cases: &[(&str, Change, &str, &str)] = &[
        ("no axis", |b| { b.dim(0, 0); }, "E0603", "0 axes"),
        ("eight axes", |b| { b.dim(0, 8); }, "E0603", "8 axes"),
        ("negative size", |b| { b.dim(2, -3); }, "E0603", "-3 samples"),
        ("size zero", |b| { b.dim(3, 0); }, "E0603", "0 samples"),
        ("four times", |b| { b.dim(0, 4).dim(4, 4); }, "E0606", "4 time steps"),
        ("vectors", |b| { b.dim(0, 5).dim(4, 1).dim(5, 3); }, "E0606", "3 values a voxel"),
        ("more than there is", |b| { b.dim(1, 3000).dim(2, 1000); }, "E0604", "3000 × 1000 × 4"),
        ("30 TiB", |b| { b.dim(1, 32767).dim(2, 32767).dim(3, 32767); }, "E0608", "16 GiB"),
        ("RGB", |b| { b.datatype(128); }, "E0605", "RGB"),
        ("RGBA", |b| { b.datatype(2304); }, "E0605", "RGB"),
        ("complex", |b| { b.datatype(32); }, "E0605", "complex"),
        ("bits", |b| { b.datatype(1); }, "E0605", "bits"),
        ("f128", |b| { b.datatype(1536); }, "E0605", "128-bit"),
        ("type 0", |b| { b.datatype(0); }, "E0603", "type 0"),
        ("type -5", |b| { b.datatype(-5); }, "E0603", "type -5"),
        ("zero spacing", |b| { b.pixdim(2, 0.0); }, "E0607", "axis 1"),
        ("NaN spacing", |b| { b.pixdim(3, f64::NAN); }, "E0607", "NaN"),
        ("infinite spacing", |b| { b.pixdim(1, f64::INFINITY); }, "E0607", "inf"),
        ("NaN quaternion", |b| { b.qform(1, [f64::NAN, 0.0, 0.0], [0.0; 3]); }, "E0607", "quaternion"),
        ("NaN offset", |b| { b.qform(1, [0.0; 3], [0.0, f64::NAN, 0.0]); }, "E0607", "NaN"),
        ("zero sform", |b| { b.sform(1, [[0.0; 4]; 3]); }, "E0607", "axis 0"),
        ("flat sform", |b| { b.sform(1, [[1.0, 2.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]); }, "E0607", "plane"),
        ("infinite sform", |b| { b.sform(1, [[f64::INFINITY; 4]; 3]); }, "E0607", "inf"),
        ("negative offset", |b| { b.voxel_offset(-1.0); }, "E0603", "byte -1"),
        ("offset past the end", |b| { b.voxel_offset(1e6); }, "E0604", "cannot hold all"),
        ("offset past all ends", |b| { b.voxel_offset(1e18); }, "E0603", "start at byte"),
        ("NaN intercept", |b| { b.scaling(1.0, f64::NAN); }, "E0603", "intercept"),
        ("wrong magic", |b| { b.magic(b"n+3\0"); }, "E0603", "magic"),
        ("one byte short", |b| { b.data.pop(); }, "E0604", "promises 2 × 3 × 4 voxels of 4 bytes"),
        ("no voxels", |b| b.data.clear(), "E0604", "cannot hold all"),
    ];
    for (name, change, code, part) in cases {
        for (version, big_endian) in [(1, false), (1, true), (2, false), (2, true)] {
            let mut b = plain(version, big_endian);
            change(&mut b);
            let error = load("a.nii", b.file()).map(|_| ()).expect_err(name);
            assert_eq!((error.code, error.message.contains(part)), (*code, true), "{name}: {}", error.message);
            // Packed, a lie about sizes may show later, but it shows.
            let packed = load("a.nii.gz", gzip(&b.file())).map(|_| ()).expect_err(name);
            assert_eq!(packed.code, *code, "{name}, packed: {}", packed.message);
            if *code != "E0604" {
                let header = read_header_from(&Memory::one("a.nii", b.file()), Path::new("a.nii"));
                assert_eq!(header.unwrap_err(), error, "{name}");
            }
        }
    }
}

#[test]
fn sizes_of_version_2_that_overflow() {
    for dims in [[i64::MAX; 3], [1 << 31, 1 << 31, 4], [1 << 33, 1, 1], [u32::MAX as i64; 3], [1 << 40, 1, 1]] {
        let b = Builder::new(2, false, Scalar::F64, &dims, &[1.0]);
        for bytes in [b.file(), gzip(&b.file())] {
            assert_eq!(load("a.nii", bytes).unwrap_err().code, "E0608", "{dims:?}");
        }
    }
}

#[test]
fn files_that_are_something_else() {
    let analyze = {
        let mut b = plain(1, false);
        b.magic(&[0; 4]);
        b.file()
    };
    let cases: &[(&str, Vec<u8>, &str)] = &[
        ("a.nii", vec![], "E0603"),
        ("a.nii", vec![92], "E0603"),
        ("a.nii", b"<html>not found</html>".to_vec(), "E0603"),
        ("a.nii.gz", gzip(b"<html>not found</html>"), "E0603"),
        ("a.nrrd", b"hello".to_vec(), "E0603"),
        ("a.raw", b"hello".to_vec(), "E0602"),
        ("a.hdr", analyze, "E0602"),
        ("a.nrrd.gz", gzip(b"NRRD0004\n"), "E0602"),
        ("a.nii.gz", vec![0x1f, 0x8b], "E0610"),
        ("a.nii.gz", [vec![0x1f, 0x8b, 8, 0], vec![0xff; 100]].concat(), "E0610"),
        ("a.nii", plain(1, false).bytes[..100].to_vec(), "E0603"),
        ("a.nii", plain(2, true).bytes[..400].to_vec(), "E0603"),
        ("a.nii.gz", gzip(&plain(2, true).bytes[..400]), "E0603"),
    ];
    for (name, bytes, code) in cases {
        let error = load(name, bytes.clone()).unwrap_err();
        assert_eq!(error.code, *code, "{name}: {}", error.message);
    }
}

#[test]
fn damaged_gzip_streams() {
    let noise: Vec<f64> = (0..6000).map(|n| f64::from(n * 7919 % 251)).collect();
    let packed = gzip(&Builder::new(1, false, Scalar::U8, &[10, 20, 30], &noise).file());
    assert!(load("a.nii.gz", packed.clone()).is_ok());
    let short = load("a.nii.gz", packed[..packed.len() / 2].to_vec()).unwrap_err();
    assert!(["E0604", "E0610"].contains(&short.code), "{}", short.message);
    // The checksum stands in the last eight bytes; a wrong one must be noticed although all voxels are there.
    let mut wrong = packed.clone();
    let at = packed.len() - 6;
    wrong[at] ^= 0xff;
    assert_eq!(load("a.nii.gz", wrong).unwrap_err().code, "E0610");
    assert_eq!(load("a.nii.gz", packed[..packed.len() - 3].to_vec()).unwrap_err().code, "E0610");
}

#[test]
fn a_small_stream_cannot_claim_gigabytes() {
    // 8 GiB of voxels cannot come from a few hundred bytes, so nothing is even tried.
    let b = Builder::new(1, false, Scalar::F64, &[1024, 1024, 1024], &[1.0; 100]);
    let error = load("a.nii.gz", gzip(&b.file())).unwrap_err();
    assert_eq!(error.code, "E0604");
    // A bomb that holds more than the header asks for is read only as far as asked.
    let mut b = Builder::new(1, false, Scalar::U8, &[2, 2, 2], &[3.0; 8]);
    b.data.resize(50_000_000, 0);
    assert_eq!(load_ok("a.nii.gz", gzip(&b.file())).voxels().allocated(), 8);
}

#[test]
fn broken_nrrd_headers() {
    let good = "type: float\ndimension: 3\nsizes: 2 2 2\nspacings: 1 1 1\nencoding: raw\nendian: little\n";
    assert!(load("a.nrrd", attached(good, &[0; 32])).is_ok());
    // What to replace, with what, and what comes of it.
    #[rustfmt::skip]
    let cases: &[(&str, &str, &str, &str)] = &[
        ("type: float\n", "", "E0603", "no field `type`"),
        ("dimension: 3\n", "", "E0603", "no field `dimension`"),
        ("sizes: 2 2 2\n", "", "E0603", "no field `sizes`"),
        ("encoding: raw\n", "", "E0603", "no field `encoding`"),
        ("endian: little\n", "", "E0603", "order of the bytes"),
        ("endian: little", "endian: middle", "E0603", "middle"),
        ("type: float", "type: quad", "E0603", "quad"),
        ("type: float", "type: block", "E0605", "blocks"),
        ("dimension: 3", "dimension: 0", "E0603", "dimension `0`"),
        ("dimension: 3", "dimension: 17", "E0603", "dimension `17`"),
        ("dimension: 3", "dimension: 2", "E0603", "3 entries in `sizes`"),
        ("dimension: 3", "dimension: three", "E0603", "three"),
        ("sizes: 2 2 2", "sizes: 2 2", "E0603", "2 entries in `sizes`"),
        ("sizes: 2 2 2", "sizes: 2 0 2", "E0603", "axis 1"),
        ("sizes: 2 2 2", "sizes: 2 -2 2", "E0603", "sizes"),
        ("sizes: 2 2 2", "sizes: 2 2 2.5", "E0603", "sizes"),
        ("sizes: 2 2 2", "sizes: 2 2 3", "E0604", "2 × 2 × 3"),
        ("sizes: 2 2 2", "sizes: 99999999999 1 1", "E0608", "99999999999"),
        ("sizes: 2 2 2", "sizes: 4294967295 4294967295 4294967295", "E0608", "16 GiB"),
        ("sizes: 2 2 2", "sizes: 99999999999999999999 1 1", "E0603", "sizes"),
        ("spacings: 1 1 1", "spacings: 1 0 1", "E0607", "axis 1"),
        ("spacings: 1 1 1", "spacings: 1 1 nan", "E0607", "NaN"),
        ("spacings: 1 1 1", "spacings: 1 1 inf", "E0607", "inf"),
        ("spacings: 1 1 1", "spacings: 1 1 1e-320", "E0607", "axis 2"),
        ("spacings: 1 1 1", "spacings: 1 1", "E0603", "2 entries in `spacings`"),
        ("spacings: 1 1 1", "spacings: 1 one 1", "E0603", "spacings"),
        ("spacings: 1 1 1", "spacings: 1 1 1\nspacings: 1 1 1", "E0603", "twice"),
        ("spacings: 1 1 1", "space: LPS\nspace directions: (1,0,0) (2,0,0) (0,0,1)", "E0607", "plane"),
        ("spacings: 1 1 1", "space: LPS\nspace directions: (1,0,0) (0,1,0)", "E0603", "2 entries"),
        ("spacings: 1 1 1", "space: LPS\nspace directions: (1,0) (0,1,0) (0,0,1)", "E0603", "2 numbers"),
        ("spacings: 1 1 1", "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1", "E0603", "cannot be read"),
        ("spacings: 1 1 1", "space: LPS\nspace directions: (1,0,0) nothing (0,0,1)", "E0603", "cannot be read"),
        ("spacings: 1 1 1", "space: LPS\nspace directions: (nan,0,0) (0,1,0) (0,0,1)", "E0607", "NaN"),
        ("spacings: 1 1 1", "space: LPS\nspace directions: none none none", "E0606", "values a voxel"),
        ("spacings: 1 1 1", "space: LPS\nspace origin: (1,2)", "E0603", "space origin"),
        ("spacings: 1 1 1", "space: LPS\nspace origin: (inf,0,0)", "E0607", "inf"),
        ("spacings: 1 1 1", "space: middle-earth", "E0603", "middle-earth"),
        ("spacings: 1 1 1", "space: LPST", "E0606", "LPST"),
        ("spacings: 1 1 1", "space dimension: 4", "E0606", "4 dimensions"),
        ("spacings: 1 1 1", "space: LPS\nspace units: \"mm\" \"mm\"", "E0603", "space units"),
        ("spacings: 1 1 1", "units: \"mm\" \"mm\" \"mm", "E0603", "units"),
        ("spacings: 1 1 1", "kinds: domain", "E0603", "kinds"),
        ("spacings: 1 1 1", "no colon here", "E0603", "line 7"),
        ("encoding: raw", "encoding: bzip2", "E0609", "bzip2"),
        ("encoding: raw", "encoding: rot13", "E0603", "rot13"),
        ("encoding: raw", "encoding: gzip", "E0610", "decoded"),
        ("encoding: raw", "encoding: text", "E0610", "number"),
        ("encoding: raw", "encoding: hex", "E0604", "cannot hold all"),
        ("encoding: raw", "encoding: raw\ndata file: LIST", "E0609", "several files"),
        ("encoding: raw", "encoding: raw\ndata file: slice%03d.raw 1 100 1", "E0609", "several files"),
        ("encoding: raw", "encoding: raw\ndata file: nowhere.raw", "E0601", "nowhere.raw"),
    ];
    for (from, to, code, part) in cases {
        let changed = good.replace(from, to);
        assert_ne!(changed, good, "{from}");
        // No byte of which could be taken for a digit or space.
        let error = load("a.nrrd", attached(&changed, &[0xff; 32])).map(|_| ()).expect_err(to);
        assert_eq!((error.code, error.message.contains(part)), (*code, true), "`{to}`: {}", error.message);
    }
}

#[test]
fn nrrd_files_that_break_off() {
    let code = |bytes: &[u8]| load("a.nrrd", bytes).unwrap_err().code;
    assert_eq!(code(b"NRRD"), "E0603");
    assert_eq!(code(b"NRRD0009\n"), "E0603");
    assert_eq!(code(b"NRRDabcd\n\n"), "E0603");
    assert_eq!(code(b"NRRD0004\ntype: uchar\n"), "E0603");
    assert_eq!(code(b"NRRD0004\ntype: uchar\ndimension: 1\nsizes: 1\nencoding: raw"), "E0603");
    assert_eq!(code(&[b"NRRD0004\n".to_vec(), vec![b'#'; 3 << 20]].concat()), "E0603");
}

#[test]
fn broken_text_and_hex() {
    let lines = |encoding| format!("type: uint8\ndimension: 3\nsizes: 2 2 1\nencoding: {encoding}");
    let code = |encoding, data: &[u8]| load("a.nrrd", attached(&lines(encoding), data)).unwrap_err().code;
    assert_eq!(code("text", b"1 2 3 300"), "E0610");
    assert_eq!(code("text", b"1 2 3 -1"), "E0610");
    assert_eq!(code("text", b"1 2 3 4.5"), "E0610");
    assert_eq!(code("text", b"1 2 3      "), "E0604");
    assert_eq!(code("text", b"1 2"), "E0604");
    assert_eq!(code("text", &[b'9'; 5000]), "E0610");
    assert_eq!(code("hex", b"0102030g"), "E0610");
    assert_eq!(code("hex", b"010203 "), "E0604");
    assert_eq!(code("hex", b"01 02 03   0"), "E0604");
}

/// Valid files of every kind, to be damaged.
fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mut turned = plain(1, true);
    turned.qform(1, [0.5, 0.5, 0.5], [1.0, 2.0, 3.0]).scaling(2.0, 1.0).units(2);
    let detailed = "type: short\ndimension: 4\nsizes: 1 2 2 2\nspace: left-posterior-superior\nkinds: list domain domain domain
        space directions: none (1,0,0) (0,1,0) (0,0,1)\nspace origin: (1,2,3)\nspace units: \"mm\" \"mm\" \"mm\"\nendian: big";
    let data: Vec<u8> = (0..16).collect();
    vec![
        ("a.nii", plain(1, false).file()),
        ("a.nii", turned.file()),
        ("a.nii", plain(2, false).file()),
        ("a.nii.gz", gzip(&plain(2, true).file())),
        ("a.nrrd", attached(&format!("{detailed}\nencoding: raw\nbyte skip: -1"), &data)),
        ("a.nrrd", attached(&format!("{detailed}\nencoding: gzip\nline skip: 0"), &gzip(&data))),
        ("a.nrrd", attached(&format!("{detailed}\nencoding: hex"), b"000102030405060708090a0b0c0d0e0f")),
        (
            "a.nrrd",
            attached(
                "type: float\ndimension: 3\nsizes: 2 1 2\nunits: m m m\naxis mins: 0 0 0\naxis maxs: 1 1 1\nencoding: text",
                b"1 2 3 4",
            ),
        ),
    ]
}

/// Loads, and checks what must hold of anything that loads.
fn survive(name: &str, bytes: &[u8]) -> Result<(), TestCaseError> {
    match load(name, bytes) {
        Ok((volume, _)) => {
            // What was allocated is what arrived: a file of n bytes cannot unpack to more than 1040 n.
            prop_assert!(volume.voxels().allocated() <= 1040 * bytes.len());
            let (low, high) = volume.range();
            prop_assert!(low.is_finite() && high.is_finite() && low <= high);
            prop_assert!(volume.header().world_from_index.iter().flatten().all(|x| x.is_finite()));
        }
        Err(error) => prop_assert!(compiler::diagnostic::explain(error.code).is_some(), "{}", error.code),
    }
    Ok(())
}

/// What ten minutes of fuzzing found to take different ways through the readers; `cargo fuzz` takes it up again with
/// `cargo +nightly fuzz run nifti fuzz/seeds/nifti`.
#[test]
fn what_fuzzing_found_never_panics() {
    for (kind, name, magic) in [("nifti", "a.hdr", &b""[..]), ("nrrd", "a.nrrd", b"NRRD0004\n")] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(kind);
        let mut loaded = [0, 0];
        for entry in std::fs::read_dir(folder).unwrap() {
            let bytes = std::fs::read(entry.unwrap().path()).unwrap();
            let files = Memory::one(name, [magic, &bytes].concat()).and("a.img", bytes.clone()).and("a", bytes.clone());
            match read_volume_from(&files, Path::new(name)) {
                Ok((volume, _)) => {
                    assert!(volume.voxels().allocated() <= 1040 * (bytes.len() + 9));
                    loaded[0] += 1;
                }
                Err(_) => loaded[1] += 1,
            }
        }
        assert!(loaded[0] > 5 && loaded[1] > 50, "{kind}: {loaded:?} loaded and refused");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..2000), kind in 0..4) {
        let start: &[u8] = [&b""[..], b"NRRD0005\n", &[0x5c, 1, 0, 0], &[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 3]][kind as usize];
        survive("a.nii", &[start, &bytes].concat())?;
    }

    #[test]
    fn damaged_files_never_panic(
        seed in 0_usize..8,
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>(), 0..3), 1..12),
    ) {
        let (name, mut bytes) = seeds().swap_remove(seed);
        for (at, byte, kind) in changes {
            if bytes.is_empty() {
                break;
            }
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = byte,
                1 => bytes.insert(at, byte),
                _ => bytes.truncate(at.max(bytes.len() / 2)),
            }
        }
        survive(name, &bytes)?;
    }

    #[test]
    fn random_numbers_in_nifti_headers_never_panic(
        version in 1_u8..3,
        numbers in proptest::collection::vec((0_usize..540, any::<u64>()), 1..6),
    ) {
        let mut b = plain(version, false);
        for (at, number) in numbers {
            // Behind the magic number and the size, so that the rest is looked at.
            let (from, to) = if version == 1 { (4, 340) } else { (12, 532) };
            let at = from + at % (to - from);
            b.bytes[at..at + 4].copy_from_slice(&number.to_le_bytes()[..4]);
        }
        survive("a.nii", &b.file())?;
    }

    #[test]
    fn any_text_for_any_nrrd_field_never_panics(field in 0_usize..12, value in "[-0-9a-zA-Z(),.\" \\\\]{0,40}") {
        let name = ["sizes", "spacings", "space", "space directions", "space origin", "units", "kinds", "byte skip",
            "line skip", "axis mins", "data file", "encoding"][field];
        let lines = format!("type: uchar\ndimension: 3\nencoding : raw\nsizes : 2 2 2\n{name}: {value}");
        survive("a.nrrd", &attached(&lines.replacen(&format!("{name} : "), "content: ", 1), &[7; 8]))?;
    }
}
