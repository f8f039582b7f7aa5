//! Files that lie, break off or are something else: each gives its code, and never a panic.

use super::*;
use proptest::prelude::*;

fn code(name: &str, bytes: impl Into<Vec<u8>>) -> (&'static str, String) {
    let error = load(name, bytes).map(|_| ()).expect_err(name);
    (error.code, error.message)
}

#[test]
fn files_that_are_something_else() {
    let cases: &[(&str, &[u8], &str)] = &[
        ("a.ply", b"", "E0661"),
        ("a.spz", b"", "E0661"),
        ("a.ply", b"hello", "E0661"),
        ("a.spz", b"hello", "E0661"),
        ("a.splat", &[7; 64], "E0660"),
        ("a.spz", b"NGSP\x04\0\0\0", "E0665"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n", "E0660"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 1\nproperty float x\nend_header\n0\n", "E0660"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\n", "E0660"),
    ];
    for (name, bytes, expected) in cases {
        let (code, message) = code(name, *bytes);
        assert_eq!(code, *expected, "{message}");
        assert!(message.starts_with(&format!("`{name}` ")), "{message}");
    }
    assert_eq!(read_splats(Path::new("no/such.ply")).map(|_| ()).unwrap_err().code, "E0601");
    assert!(code("a.ply", cases[6].1).1.contains("`f_dc_0`"));
}

#[test]
fn broken_headers() {
    let good = String::from_utf8(ply("ascii", &some(2, 1))).expect("text");
    for (from, to, expected) in [
        ("element vertex 2", "element vertex 3", "E0662"),
        ("element vertex 2", "element vertex 4000000000", "E0662"),
        ("element vertex 2", "element vertex 99999999999999999", "E0662"),
        ("element vertex 2", "element vertex 0", "E0663"),
        ("element vertex 2", "element vertex -1", "E0661"),
        ("f_rest_8", "f_rest_9", "E0661"),
        ("f_rest_8", "f_rest_7", "E0661"),
        ("f_rest_8", "other", "E0661"),
        ("f_rest_8", "f_rest_99999999999999999999", "E0661"),
        ("property float opacity", "property list uchar float opacity", "E0660"),
        ("rot_3", "rot_4", "E0660"),
        ("float scale_0", "half scale_0", "E0661"),
        ("end_header\n", "end_header\nx", "E0661"),
    ] {
        let changed = good.replace(from, to);
        assert_ne!(changed, good, "{from}");
        let (code, message) = code("a.ply", changed);
        assert_eq!(code, expected, "`{to}`: {message}");
    }
}

#[test]
fn headers_of_spz_that_lie() {
    let good = spz_stream(3, 1, 0, &some(2, 1));
    for (at, byte, expected) in [
        (0, b'X', "E0661"),
        (4, 1, "E0665"),
        (4, 9, "E0665"),
        (8, 3, "E0662"),
        (8, 0, "E0663"),
        (11, 255, "E0664"),
        (10, 255, "E0662"),
        (12, 5, "E0661"),
        (12, 2, "E0662"),
        (13, 31, "E0661"),
    ] {
        let mut bytes = good.clone();
        bytes[at] = byte;
        let (code, message) = code("a.spz", gzip(&bytes));
        assert_eq!(code, expected, "byte {at} is {byte}: {message}");
    }
}

#[test]
fn files_that_break_off() {
    for format in ["ascii", "binary_little_endian"] {
        let bytes = ply(format, &some(3, 1));
        // A text whose last number is shorter is as good a text.
        let last = if format == "ascii" { bytes.iter().rposition(|b| *b == b' ') } else { Some(bytes.len() - 1) };
        for end in 4..last.expect("many numbers") {
            let (code, message) = code("a.ply", &bytes[..end]);
            assert!(["E0660", "E0661", "E0662"].contains(&code), "{format}, {end} bytes: {message}");
        }
    }
    let stream = spz_stream(2, 1, 0, &some(3, 1));
    for end in 0..stream.len() {
        assert_eq!(code("a.spz", gzip(&stream[..end])).0, "E0662", "{end} bytes");
    }
    let file = gzip(&stream);
    for end in 2..file.len() {
        let (code, message) = code("a.spz", &file[..end]);
        assert!(["E0661", "E0662"].contains(&code), "{end} bytes: {code}: {message}");
    }
    // A damaged checksum.
    let mut damaged = file.clone();
    let at = damaged.len() - 6;
    damaged[at] ^= 1;
    assert_eq!(code("a.spz", damaged).0, "E0661");
}

/// What fuzzing found to take different ways through the readers; `cargo fuzz` takes it up again with
/// `cargo +nightly fuzz run splats fuzz/seeds/splats`.
#[test]
fn what_fuzzing_found_never_panics() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds/splats");
    let mut loaded = [0, 0];
    for entry in std::fs::read_dir(folder).unwrap() {
        let bytes = std::fs::read(entry.unwrap().path()).unwrap();
        for bytes in [gzip(&[b"NGSP", bytes.as_slice()].concat()), bytes] {
            survive(&bytes).unwrap();
            loaded[usize::from(load("a.ply", bytes).is_err())] += 1;
        }
    }
    assert!(loaded[0] > 5 && loaded[1] > 5, "{loaded:?} loaded and refused");
}

fn survive(bytes: &[u8]) -> Result<(), TestCaseError> {
    match load("a.ply", bytes) {
        Ok((splats, _)) => {
            let header = splats.header();
            prop_assert!(header.count > 0 && splats.len() <= bytes.len() * 1040);
            prop_assert!(header.bounds.0.iter().chain(&header.bounds.1).all(|x| x.is_finite()));
            prop_assert!(splats.opacities().iter().all(|o| (0.0..=1.0).contains(o)));
            prop_assert!(splats.deviations().iter().flatten().all(|s| *s >= 0.0 && s.is_finite()));
        }
        Err(error) => prop_assert!(compiler::diagnostic::explain(error.code).is_some(), "{}", error.code),
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn damaged_files_never_panic(
        kind in 0_usize..4,
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>(), 0..3), 1..12),
    ) {
        let plain = some(5, 2);
        let mut bytes = match kind {
            0 => ply("ascii", &plain),
            1 => ply("binary_little_endian", &plain),
            2 => ply("binary_big_endian", &plain),
            _ => spz_stream(3, 2, 0, &plain),
        };
        for (at, byte, change) in changes {
            // Cut off again and again, nothing may be left.
            let at = at.index(bytes.len().max(1));
            match change {
                0 => bytes[at..].iter_mut().take(1).for_each(|b| *b = byte),
                1 => bytes.insert(at.min(bytes.len()), byte),
                _ => bytes.truncate(at.max(bytes.len() / 2)),
            }
        }
        survive(&if kind == 3 { gzip(&bytes) } else { bytes })?;
    }

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400), packed in any::<bool>()) {
        if packed {
            survive(&gzip(&[b"NGSP\x03\0\0\0".as_slice(), &bytes].concat()))?;
        }
        survive(&[[0x1f, 0x8b].as_slice(), &bytes].concat())?;
        survive(&bytes)?;
    }
}
