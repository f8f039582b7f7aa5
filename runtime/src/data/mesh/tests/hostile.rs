//! Files that lie, break off or are something else: each gives its code, and never a panic.

use super::*;
use proptest::prelude::*;

#[test]
fn broken_obj_files() {
    let start = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    #[rustfmt::skip]
    let cases: &[(&str, &str, &str)] = &[
        ("f 1 2 4\n", "E0614", "corner 3 in line 4 (corners counted from 0), but has 3 corners"),
        ("f 1 2 0\n", "E0614", "corner 0 in line 4"),
        ("f 1 2 -4\n", "E0614", "corner -4 in line 4"),
        ("f 1 2 4294967297\n", "E0614", "corner 4294967297"),
        ("f 1 2 9223372036854775807\n", "E0614", "line 4"),
        ("f 1 2 -9223372036854775808\n", "E0614", "line 4"),
        ("f 1 2 99999999999999999999\n", "E0612", "99999999999999999999"),
        ("f 1 2 3.5\n", "E0612", "`3.5` for a corner in line 4"),
        ("f 1 2 x\n", "E0612", "`x` for a corner"),
        ("f 1 2 /1\n", "E0612", "`/1` for a corner"),
        ("f 1 2 \u{2028}\n", "E0612", "for a corner"),
        ("f 1 2\n", "E0612", "face of 2 corners in line 4"),
        ("f\n", "E0612", "face of 0 corners"),
        ("v 1 2\nf 1 2 3\n", "E0612", "fewer than 3 numbers in line 4"),
        ("v 1 2 three\nf 1 2 3\n", "E0612", "`three` for a number in line 4"),
        ("# no face\n", "E0615", "no triangle"),
        ("l 1 2\np 1\n", "E0615", "no triangle"),
        ("f 1 1 1\n", "E0615", "1 triangle has no area"),
    ];
    for (rest, code, part) in cases {
        let error = load("a.obj", format!("{start}{rest}")).map(|_| ()).expect_err(rest);
        assert_eq!((error.code, error.message.contains(part)), (*code, true), "`{rest}`: {}", error.message);
        assert!(error.message.starts_with("`a.obj` "), "{}", error.message);
    }
}

#[test]
fn files_that_are_something_else() {
    let cases: &[(&str, &[u8], &str)] = &[
        ("a.obj", b"", "E0612"),
        ("a.ply", b"", "E0612"),
        ("a.stl", b"solid cube\nfacet normal 0 0 1\n", "E0611"),
        ("a.obj", b"<html>not found</html>", "E0611"),
        ("a.obj", &[0; 1000], "E0611"),
        ("a.obj", b"plyers\n", "E0611"),
        ("a.ply", b"plyers\n", "E0612"),
        ("a.ply", b"hello", "E0612"),
        ("a", b"v 0 0 0", "E0611"),
        ("a.gltf", b"{}", "E0611"),
    ];
    for (name, bytes, code) in cases {
        let error = load(name, *bytes).map(|_| ()).expect_err(name);
        assert_eq!(error.code, *code, "{name}: {}", error.message);
    }
    let missing = read_mesh_from(&Memory::default(), Path::new("a.obj")).map(|_| ()).unwrap_err();
    assert_eq!(missing.code, "E0601");
    assert_eq!(read_mesh(Path::new(env!("CARGO_MANIFEST_DIR"))).map(|_| ()).unwrap_err().code, "E0601");
    assert_eq!(read_mesh_header(Path::new("no/such.ply")).unwrap_err().code, "E0601");
}

const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

#[test]
fn broken_ply_files() {
    assert!(load("a.ply", TRIANGLE).is_ok());
    #[rustfmt::skip]
    let cases: &[(&str, &str, &str, &str)] = &[
        ("format ascii 1.0\n", "", "E0612", "no line `format`"),
        ("format ascii 1.0", "format ascii 2.0", "E0612", "line 2"),
        ("format ascii 1.0", "format ebcdic 1.0", "E0612", "encoding in line 2"),
        ("format ascii 1.0", "format ascii 1.0\nformat ascii 1.0", "E0612", "line 3"),
        ("element vertex 3", "element vertex", "E0612", "line 3"),
        ("element vertex 3", "element vertex -3", "E0612", "count in line 3"),
        ("element vertex 3", "element vertex 99999999999999999999999", "E0612", "count"),
        ("element vertex 3", "element vertex 18446744073709551615", "E0613", "18446744073709551615"),
        ("element vertex 3", "element vertex 1000", "E0613", "promises 1000 of element `vertex`"),
        ("element vertex 3", "element vertex 4", "E0613", "ends before face 0"),
        ("element vertex 3", "element vertex 5", "E0613", "ends before vertex 4"),
        ("element vertex 3", "element vertex 2", "E0615", "no triangle"),
        ("element vertex 3\n", "", "E0612", "of no element"),
        ("element vertex 3", "element node 3", "E0614", "has 0 corners"),
        ("element face 1", "element vertex 1", "E0612", "twice"),
        ("element face 1", "element face 1000000000", "E0613", "1000000000"),
        ("element face 1", "element face 2", "E0613", "ends before face 1"),
        ("element face 1", "element facet 1", "E0615", "no triangle"),
        ("element face 1", "element face 0", "E0615", "no triangle"),
        ("property float y\n", "", "E0612", "without `x`, `y` and `z`"),
        ("property float y", "property float x", "E0612", "twice"),
        ("property float y", "property half y", "E0612", "unknown type"),
        ("property float y", "property list uchar float y", "E0612", "without"),
        ("property list uchar int", "property list float int", "E0612", "unknown type"),
        ("vertex_indices", "tristrips", "E0615", "strips"),
        ("end_header\n", "", "E0612", "something unknown in line 9: `0 0 0`"),
        ("\n1 0 0", "\n1 0", "E0612", "too few numbers in vertex 1"),
        ("\n1 0 0", "\n1 0 zero", "E0612", "`zero` for a number in vertex 1"),
        ("3 0 1 2", "4 0 1 2", "E0612", "too few numbers in face 0"),
        ("3 0 1 2", "3 0 1 3", "E0614", "corner 3 in face 0"),
        ("3 0 1 2", "3 0 1 -1", "E0614", "corner -1 in face 0"),
        ("3 0 1 2", "3 0 1 1.5", "E0614", "corner 1.5"),
        ("3 0 1 2", "3 0 1 nan", "E0614", "corner NaN"),
        ("3 0 1 2", "3 0 1 1e300", "E0614", "face 0"),
        ("3 0 1 2", "-3 0 1 2", "E0612", "list of -3 entries"),
        ("3 0 1 2", "2.5 0 1 2", "E0612", "list of 2.5 entries"),
        ("3 0 1 2", "1e9 0 1 2", "E0612", "too few numbers"),
        ("3 0 1 2", "2 0 1", "E0615", "no triangle"),
        ("3 0 1 2", "0", "E0615", "no triangle"),
        ("3 0 1 2", "3 0 1 1", "E0615", "no area"),
    ];
    for (from, to, code, part) in cases {
        let changed = TRIANGLE.replace(from, to);
        assert_ne!(changed, TRIANGLE, "{from}");
        let error = load("a.ply", changed).map(|_| ()).expect_err(to);
        let said = format!("{} {}", error.message, error.hint.clone().unwrap_or_default());
        assert_eq!((error.code, said.contains(part)), (*code, true), "`{to}`: {said}");
    }
}

#[test]
fn files_that_break_off() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let bytes = ply(format, Types("float", "uchar", "int"));
        let header = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
        for end in 4..bytes.len() - 2 {
            let error = load("a.ply", &bytes[..end]).map(|_| ()).expect_err("is cut off");
            // Inside a word, the header is broken rather than short, and so is a row of text.
            let expected: &[&str] = if end < header || format == "ascii" { &["E0612", "E0613"] } else { &["E0613"] };
            assert!(expected.contains(&error.code), "{format}, {end} bytes: {}: {}", error.code, error.message);
        }
    }
}

#[test]
fn endless_lines() {
    let long = [b"v 0 0 0\nf".as_slice(), " 1".repeat(9 << 20).as_bytes()].concat();
    assert_eq!(load("a.obj", long).map(|_| ()).unwrap_err().code, "E0612");
    let many = [b"v 0 0 0\nf".as_slice(), " 1\\\n".repeat(9 << 20).as_bytes()].concat();
    assert_eq!(load("a.obj", many).map(|_| ()).unwrap_err().code, "E0612");
}

/// What fuzzing found to take different ways through the readers; `cargo fuzz` takes it up again with
/// `cargo +nightly fuzz run mesh fuzz/seeds/mesh`.
#[test]
fn what_fuzzing_found_never_panics() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds/mesh");
    let mut loaded = [0, 0];
    for entry in std::fs::read_dir(folder).unwrap() {
        let bytes = std::fs::read(entry.unwrap().path()).unwrap();
        for (name, bytes) in [("a.ply", [b"ply\n", bytes.as_slice()].concat()), ("a.obj", bytes)] {
            survive(name, &bytes).unwrap();
            loaded[usize::from(load(name, bytes).is_err())] += 1;
        }
    }
    assert!(loaded[0] > 4 && loaded[1] > 4, "{loaded:?} loaded and refused");
}

fn survive(name: &str, bytes: &[u8]) -> Result<(), TestCaseError> {
    match load(name, bytes) {
        Ok((mesh, _)) => {
            let MeshHeader { triangles, bounds: (min, max) } = mesh.header();
            prop_assert!(triangles as usize <= bytes.len());
            prop_assert!(min.iter().zip(max).all(|(a, b)| a.is_finite() && b.is_finite() && *a <= b));
        }
        Err(error) => prop_assert!(compiler::diagnostic::explain(error.code).is_some(), "{}", error.code),
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..500), kind in 0..3) {
        let start = ["", "ply\n", "ply\nformat binary_little_endian 1.0\nelement face 3\nproperty list uchar char vertex_index\nend_header\n"];
        survive("a.obj", &[start[kind as usize].as_bytes(), &bytes].concat())?;
    }

    #[test]
    fn random_text_never_panics(text in "([vf] [-0-9./ e\\\\]{0,20}\n){0,20}") {
        survive("a.obj", text.as_bytes())?;
    }

    #[test]
    fn damaged_files_never_panic(
        seed in 0_usize..4,
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>(), 0..3), 1..12),
    ) {
        let formats = ["ascii", "binary_little_endian", "binary_big_endian"];
        let mut bytes = match formats.get(seed) {
            Some(format) => ply(format, Types("double", "ushort", "int")),
            None => obj(|p| format!("v {} {} {}\n", p[0], p[1], p[2]), |f| format!("f {} {} {} {}\n", f[0], f[1], f[2], f[3])).into_bytes(),
        };
        for (at, byte, kind) in changes {
            // Cut off again and again, nothing may be left.
            let at = at.index(bytes.len().max(1));
            match kind {
                0 => bytes[at..].iter_mut().take(1).for_each(|b| *b = byte),
                1 => bytes.insert(at.min(bytes.len()), byte),
                _ => bytes.truncate(at.max(bytes.len() / 2)),
            }
        }
        survive("a.obj", &bytes)?;
    }
}
