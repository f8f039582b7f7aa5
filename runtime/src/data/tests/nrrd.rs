//! NRRD in every encoding, sample type, byte order and form of orientation.

use super::*;

/// An attached file of a header's lines and what follows the empty line.
pub(super) fn attached(lines: &str, data: &[u8]) -> Vec<u8> {
    let text: String = lines.lines().map(|l| l.trim().to_string() + "\n").collect();
    [b"NRRD0004\n# a comment\nkey:=value: with a colon\n", text.as_bytes(), b"\n", data].concat()
}

const SMALL: &str = "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n";

fn geometry(lines: &str) -> Result<[[f64; 4]; 3], LoadError> {
    load("a.nrrd", attached(&format!("{SMALL}{lines}"), &[1; 8])).map(|(v, _)| v.header().world_from_index)
}

fn steps(map: [[f64; 4]; 3]) -> [[f64; 3]; 4] {
    std::array::from_fn(|c| std::array::from_fn(|r| map[r][c]))
}

#[test]
fn every_spelling_of_every_type_is_known() {
    let spellings: [(Scalar, &[&str]); 10] = [
        (Scalar::I8, &["signed char", "int8", "int8_t"]),
        (Scalar::U8, &["uchar", "unsigned char", "uint8", "uint8_t"]),
        (Scalar::I16, &["short", "short int", "signed short", "signed short int", "int16", "int16_t"]),
        (Scalar::U16, &["ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"]),
        (Scalar::I32, &["int", "signed int", "int32", "int32_t", "SIGNED  INT"]),
        (Scalar::U32, &["uint", "unsigned int", "uint32", "uint32_t"]),
        (
            Scalar::I64,
            &["longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"],
        ),
        (Scalar::U64, &["ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"]),
        (Scalar::F32, &["float"]),
        (Scalar::F64, &["double"]),
    ];
    for (scalar, names) in spellings {
        for name in names {
            let lines = format!("type: {name}\ndimension: 3\nsizes: 1 1 1\nencoding: raw\nendian: little");
            let volume = load_ok("a.nrrd", attached(&lines, &encode(scalar, 7.0, false)));
            assert_eq!((volume.header().scalar, volume.value(0, 0, 0)), (scalar, 7.0), "{name}");
        }
    }
}

#[test]
fn every_type_byte_order_and_encoding_gives_the_same_values() {
    let names = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float", "double"];
    for (scalar, name) in SCALARS.into_iter().zip(names) {
        let data = samples(scalar);
        for big_endian in [false, true] {
            let raw: Vec<u8> = data.iter().flat_map(|v| encode(scalar, *v, big_endian)).collect();
            let hex: String = raw.iter().enumerate().map(|(n, b)| format!("{b:02x}{}", ["", "\n"][n % 2])).collect();
            let text: Vec<String> = data.iter().map(|v| text_of(scalar, *v)).collect();
            let text = text.join("\n").replacen('\n', ", ", 3);
            for (encoding, bytes) in [
                ("raw", raw.clone()),
                ("gzip", gzip(&raw)),
                ("gz", gzip(&raw)),
                ("hex", hex.to_uppercase().into_bytes()),
                ("ascii", text.clone().into_bytes()),
                ("text", (text.clone() + "\n").into_bytes()),
                ("txt", text.into_bytes()),
            ] {
                let endian = if big_endian { "big" } else { "little" };
                let lines = format!(
                    "type: {name}\ndimension: 3\nsizes: 2 3 4\nspacings: 1 1 1\nendian: {endian}\nencoding: {encoding}"
                );
                let volume = load_ok("a.nrrd", attached(&lines, &bytes));
                for (at, expected) in data.iter().enumerate() {
                    let value = volume.value(at % 2, at / 2 % 3, at / 6);
                    assert_eq!(value, *expected, "{name} {endian} {encoding} at {at}");
                }
            }
        }
    }
}

/// As C's `printf` would write it; 64-bit integers must not go through the rounding of f64.
fn text_of(scalar: Scalar, value: f64) -> String {
    match scalar {
        Scalar::F32 | Scalar::F64 => format!("{value:e}"),
        Scalar::U64 => (value as u64).to_string(),
        _ => (value as i64).to_string(),
    }
}

#[test]
fn text_may_hold_nan_and_infinity() {
    let lines = "type: float\ndimension: 3\nsizes: 2 2 1\nencoding: text";
    let (volume, warnings) = load("a.nrrd", attached(lines, b"nan -inf\n1.5 Infinity")).unwrap();
    assert_eq!(volume.range(), (0.0, 1.5));
    assert_eq!(warnings.len(), 2);
}

#[test]
fn spacings_and_axis_ends() {
    let at = |lines: &str| steps(geometry(lines).unwrap());
    let diagonal = |s: [f64; 3], o: [f64; 3]| [[s[0], 0.0, 0.0], [0.0, s[1], 0.0], [0.0, 0.0, s[2]], o];
    assert_eq!(at(""), diagonal([0.001; 3], [0.0; 3]));
    assert_eq!(at("spacings: 1 2 -3"), diagonal([0.001, 0.002, -0.003], [0.0; 3]));
    // Two cells between 0 and 4: steps of 2, centres at 1 and 3. Two nodes: at the ends.
    assert_eq!(at("axis mins: 0 0 0\naxis maxs: 4 4 4"), diagonal([0.002; 3], [0.001; 3]));
    let nodes = "axismins: 0 0 0\naxismaxs: 4 4 4\ncenterings: node cell ???";
    assert_eq!(at(nodes), diagonal([0.004, 0.002, 0.002], [0.0, 0.001, 0.001]));
    assert_eq!(at("spacings: 2 2 2\naxis mins: 10 10 10\ncenters: cell cell cell")[3], [0.011; 3]);
    assert_eq!(at("spacings: 1 2 3\nspace dimension: 3\nspace origin: (1, 2, 3)")[3], [0.001, 0.002, 0.003]);
}

#[test]
fn units_per_axis_and_of_space() {
    let at = |lines: &str| steps(geometry(lines).unwrap());
    let s = at("spacings: 1 1 1\nunits: \"m\" \"cm\" \"\u{b5}m\"");
    assert_near([s[0][0], s[1][1], s[2][2]], [1.0, 0.01, 1e-6]);
    let s = at("space dimension: 3\nspace units: \"um\" \"nm\" \"km\"\nspace directions: (1,0,0) (0,1,0) (0,0,1)
        space origin: (5,5,5)");
    assert_near([s[0][0] * 1e9, s[1][1] * 1e9, s[2][2]], [1e3, 1.0, 1e3]);
    assert_near([s[3][0] * 1e9, s[3][1] * 1e9, s[3][2]], [5e3, 5.0, 5e3]);
    assert_eq!(at("spacings: 1 1 1\nunits: \"\" ??? \"mm\"")[1][1], 0.001);

    let (volume, warnings) = load("a.nrrd", attached(&format!("{SMALL}units: \"furlong\" mm mm"), &[1; 8])).unwrap();
    assert_eq!(volume.header().world_from_index[0][0], 0.001);
    assert_eq!((warnings[0].code, warnings.len()), ("W0604", 1));
}

#[test]
fn anatomical_spaces_become_right_anterior_superior() {
    let lines = "space directions: (0,2,0) (1,0,0) (0,0,3)\nspace origin: (10,20,30)";
    for (space, [x, y, z]) in [
        ("right-anterior-superior", [1.0, 1.0, 1.0]),
        ("RAS", [1.0, 1.0, 1.0]),
        ("left-anterior-superior", [-1.0, 1.0, 1.0]),
        ("LAS", [-1.0, 1.0, 1.0]),
        ("left-posterior-superior", [-1.0, -1.0, 1.0]),
        ("LPS", [-1.0, -1.0, 1.0]),
        ("scanner-xyz", [1.0, 1.0, 1.0]),
        ("3D-left-handed", [1.0, 1.0, 1.0]),
    ] {
        let map = geometry(&format!("space: {space}\n{lines}")).unwrap();
        assert_near(apply(&map, [0.0; 3]), [x * 0.010, y * 0.020, z * 0.030]);
        assert_near(apply(&map, [1.0, 0.0, 0.0]), [x * 0.010, y * 0.022, z * 0.030]);
        assert_near(apply(&map, [0.0, 1.0, 0.0]), [x * 0.011, y * 0.020, z * 0.030]);
        assert_near(apply(&map, [0.0, 0.0, 1.0]), [x * 0.010, y * 0.020, z * 0.033]);
    }
}

#[test]
fn axes_that_are_not_spatial_may_have_one_sample() {
    let read = |lines: &str| load("a.nrrd", attached(&format!("type: uchar\nencoding: raw\n{lines}"), &[1; 8]));
    let dims = |lines: &str| read(lines).map(|(v, _)| v.header().dims).map_err(|e| e.code);
    let directed = "space: LPS\nspace directions: none (1,0,0) (0,1,0) (0,0,1)";
    assert_eq!(
        dims(&format!("dimension: 4\nsizes: 1 2 2 2\n{directed}\nkinds: list domain domain domain")),
        Ok([2; 3])
    );
    assert_eq!(dims(&format!("dimension: 4\nsizes: 8 1 1 1\n{directed}")), Err("E0606"));
    assert_eq!(dims("dimension: 4\nsizes: 1 2 2 2\nkinds: vector domain domain domain"), Ok([2; 3]));
    assert_eq!(dims("dimension: 4\nsizes: 2 2 2 1"), Ok([2; 3]));
    assert_eq!(dims("dimension: 4\nsizes: 2 1 2 2"), Ok([2; 3]));
    assert_eq!(dims("dimension: 5\nsizes: 2 1 1 2 2"), Ok([2, 2, 2]));
    assert_eq!(dims("dimension: 4\nsizes: 2 2 2 1\nkinds: RGB-color domain domain domain"), Err("E0606"));
    assert_eq!(dims("dimension: 3\nsizes: 2 2 2\nkinds: 2-vector space space"), Err("E0606"));
}

#[test]
fn fewer_axes_get_unit_steps_across() {
    let read = |lines: &str| {
        load("a.nrrd", attached(&format!("type: uchar\nencoding: raw\n{lines}"), &[1; 8])).unwrap().0.header().clone()
    };
    let h = read("dimension: 2\nsizes: 4 2\nspacings: 2 3");
    assert_eq!(h.dims, [4, 2, 1]);
    assert_eq!(steps(h.world_from_index)[..3], [[0.002, 0.0, 0.0], [0.0, 0.003, 0.0], [0.0, 0.0, 0.001]]);
    let h = read("dimension: 2\nsizes: 4 2\nspace dimension: 3\nspace directions: (0,2,0) (0,0,2)");
    assert_eq!(steps(h.world_from_index)[2], [0.001, 0.0, 0.0]);
    let h = read("dimension: 1\nsizes: 8\nspace dimension: 3\nspace directions: (0,0,-5)");
    assert_eq!(h.dims, [8, 1, 1]);
    let [x, y, z, _] = steps(h.world_from_index);
    assert_eq!(x, [0.0, 0.0, -0.005]);
    assert!(y[2] == 0.0 && z[2] == 0.0);
}

#[test]
fn detached_data_with_skips() {
    let header = |more: &str| format!("NRRD0005\r\n{}data file: a.raw\r\n{more}", SMALL.replace('\n', "\r\n"));
    let data: Vec<u8> = (1..=8).collect();
    let with = |more: &str, bytes: Vec<u8>| {
        let files = Memory::one("d/a.nhdr", header(more)).and("d/a.raw", bytes);
        read_volume_from(&files, Path::new("d/a.nhdr")).map(|(v, _)| v.bytes().to_vec())
    };
    let code = |more: &str, bytes: Vec<u8>| with(more, bytes).unwrap_err().code;
    assert_eq!(with("", data.clone()).unwrap(), data);
    let padded = [b"one\ntwo\nxyz".to_vec(), data.clone()].concat();
    assert_eq!(with("line skip: 2\nbyte skip: 3\n", padded.clone()).unwrap(), data);
    assert_eq!(with("byte skip: 11\n", padded.clone()).unwrap(), data);
    assert_eq!(with("byte skip: -1\n", padded.clone()).unwrap(), data);
    assert_eq!(code("byte skip: -2\n", padded.clone()), "E0603");
    assert_eq!(code("byte skip: 12\n", padded.clone()), "E0604");
    assert_eq!(code("line skip: 3\n", padded.clone()), "E0603");
    assert_eq!(code("line skip: -1\n", padded.clone()), "E0603");
    assert_eq!(code("byte skip: -1\n", data[1..].to_vec()), "E0604");
    assert_eq!(code("byte skip: 9223372036854775807\n", padded), "E0604");
    let files = Memory::one("d/a.nhdr", header(""));
    assert_eq!(read_header_from(&files, Path::new("d/a.nhdr")).unwrap_err().code, "E0601");
}

#[test]
fn skips_around_compression() {
    // Lines are skipped before, bytes after unpacking.
    let data: Vec<u8> = (1..=8).collect();
    let packed = [b"a line\n".to_vec(), gzip(&[vec![0xee; 5], data.clone()].concat())].concat();
    let lines = SMALL.replace("raw", "gzip") + "line skip: 1\nbyte skip: 5\n";
    assert_eq!(load_ok("a.nrrd", attached(&lines, &packed)).bytes(), data);
    let lines = SMALL.replace("raw", "gzip") + "byte skip: -1\n";
    assert_eq!(load("a.nrrd", attached(&lines, &gzip(&data))).unwrap_err().code, "E0603");
}

#[test]
fn the_last_bytes_of_an_attached_file_may_be_asked_for() {
    let data: Vec<u8> = (1..=8).collect();
    let bytes = attached(&format!("{SMALL}byte skip: -1"), &[vec![9; 100], data.clone()].concat());
    assert_eq!(load_ok("a.nrrd", bytes).bytes(), data);
}
