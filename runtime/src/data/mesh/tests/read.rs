//! What is read, in every spelling.

use super::*;

#[test]
fn a_cube_in_every_spelling_of_obj() {
    let plain = |[x, y, z]: [f64; 3]| format!("v {x} {y} {z}\n");
    let quad = |[a, b, c, d]: [i32; 4]| format!("f {a} {b} {c} {d}\n");
    let cases: &[(&str, String)] = &[
        ("plain", obj(plain, quad)),
        ("triangles", obj(plain, |[a, b, c, d]| format!("f {a} {b} {c}\nf {a} {c} {d}\n"))),
        ("textures", obj(plain, |[a, b, c, d]| format!("f {a}/1 {b}/1 {c}/1 {d}/1\n"))),
        ("normals", obj(plain, |[a, b, c, d]| format!("f {a}//1 {b}//1 {c}//1 {d}//1\n"))),
        ("wild textures", obj(plain, |[a, b, c, d]| format!("f {a}/-9223372036854775808/77 {b}/x {c}/1/1 {d}/1/1\n"))),
        ("from the end", obj(plain, |f| format!("f {} {} {} {}\n", f[0] - 9, f[1] - 9, f[2] - 9, f[3] - 9))),
        ("weights", obj(|[x, y, z]| format!("v {x} {y} {z} 1.0\n"), quad)),
        ("colours", obj(|[x, y, z]| format!("v {x} {y} {z} 1 0.5 0\n"), quad)),
        ("floats", obj(|[x, y, z]| format!("\tv  {x}. {y}e0\t+{z}.000E-0 # corner\r\n"), quad)),
        ("continued", obj(plain, |[a, b, c, d]| format!("f {a} {b} \\\n {c} \\ \r\n{d}\n"))),
        ("faces first", {
            let text = obj(plain, quad);
            let (faces, rest): (Vec<&str>, Vec<&str>) = text.lines().partition(|l| l.starts_with("f "));
            [faces, rest].concat().join("\n")
        }),
        ("other things", obj(plain, quad) + "l 1 2\np 1\ng\ncurv 0 1 1 2\nl 7000 1\n\0\0\n\n"),
    ];
    for (what, text) in cases {
        assert_is_the_cube(load("a.OBJ", text.as_bytes()), what);
    }
    let latin = [b"# caf\xe9\ng na\xefve\n".as_slice(), obj(plain, quad).as_bytes()].concat();
    assert_is_the_cube(load("a.obj", latin), "not UTF-8");
    let one_object_per_face = obj(plain, |[a, b, c, d]| format!("o {a}\nusemtl m{a}\nf {a} {b} {c} {d}\n"));
    assert_is_the_cube(load("a.obj", one_object_per_face), "objects");
}

#[test]
fn a_cube_in_every_encoding_of_ply() {
    let mut cases = 0;
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for coordinate in ["float", "double", "float32", "float64", "uchar", "int16", "char", "uint", "ushort", "int8"]
        {
            for (length, index) in [
                ("uchar", "int"),
                ("uint8", "uint"),
                ("int", "ushort"),
                ("ushort", "uchar"),
                ("uint32", "short"),
                ("char", "int32"),
            ] {
                let bytes = ply(format, Types(coordinate, length, index));
                let what = format!("{format} {coordinate} {length} {index}");
                // The content decides, not the ending.
                for name in ["a.ply", "a", "a.obj"] {
                    assert_is_the_cube(load(name, bytes.clone()), &what);
                }
                cases += 1;
            }
        }
    }
    assert_eq!(cases, 180);
}

#[test]
fn other_spellings_of_ply() {
    let text = String::from_utf8(
        ply("ascii", Types("float", "uchar", "int")).iter().filter(|c| c.is_ascii()).copied().collect(),
    );
    let text = text.expect("ASCII is left");
    let cases = [
        ("the singular", text.replace("vertex_indices", "vertex_index")),
        ("line ends of Windows", text.replace('\n', "\r\n")),
        ("empty lines", text.replace("end_header\n", "end_header\n\n  \n").replace("\n5\n", "\n\n5\n\n")),
        ("no last line end", text.trim_end().to_owned()),
        ("more numbers than declared", text.replace("\n5\n", "\n5 6 7\n")),
    ];
    for (what, text) in cases {
        assert_is_the_cube(load("a.ply", text), what);
    }
}

#[test]
fn polygons_become_fans() {
    // A regular polygon of n corners has n − 2 triangles and the area n/2 · sin(2π/n).
    for n in [3_usize, 5, 17, 1000] {
        let mut text = String::new();
        for i in 0..n {
            let angle = std::f64::consts::TAU * i as f64 / n as f64;
            text += &format!("v {} {} 0\n", angle.cos(), angle.sin());
        }
        text += "f";
        text.extend((1..=n).map(|i| format!(" {i}")));
        let (mesh, warnings) = load("a.obj", text).expect("a polygon");
        let rim = format!("is not closed: {n} edges belong to one triangle alone");
        assert!(matches!(&warnings[..], [w] if w.code == "N0606" && w.message.starts_with(&rim)), "{warnings:?}");
        assert_eq!(mesh.triangles().len(), n - 2);
        let area: f64 = mesh.triangles().iter().map(|t| soup::cross(t)[2] / 2.0).sum();
        let expected = n as f64 / 2.0 * (std::f64::consts::TAU / n as f64).sin();
        assert!((area - expected).abs() < 1e-6, "{n}: {area} is not {expected}");
    }
}

#[test]
fn what_is_no_triangle_is_left_out_and_counted() {
    let good = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv nan 0 0\nv 0 inf 0\nv 1e39 0 0\nv 0.1 0.1 0.1\nv 0.2 0.2 0.2\nv 0.4 0.4 0.4\n";
    let cases: &[(&str, &str)] = &[
        ("", ""),
        ("f 1 1 2\n", "1 triangle has no area; left out, the first is triangle 1"),
        ("f 1 2 4\nf 2 2 2\n", "2 triangles have no area; left out, the first is triangle 1"),
        ("f 8 9 10\n", "1 triangle has no area; left out, the first is triangle 1"),
        ("f 1 2 3\nf 1 2 5\n", "1 triangle has a corner that is not finite; left out, the first is triangle 2"),
        ("f 1 2 6\nf 2 3 7\n", "2 triangles have a corner that is not finite; left out, the first is triangle 1"),
        (
            "f 3 2 1\nf 1 2 4\nf 1 5 3\nf 5 5 5\n",
            "1 triangle has no area and 2 triangles have a corner that is not finite; left out, the first is triangle 2",
        ),
    ];
    for (faces, message) in cases {
        let (mesh, warnings) = load("a.obj", format!("{good}{faces}f 1 2 3\n")).expect("a triangle remains");
        let kept = mesh.triangles().len();
        assert_eq!(kept, 1 + faces.matches("f 1 2 3").count() + faces.matches("f 3 2 1").count());
        assert!(mesh.triangles().iter().flatten().flatten().all(|x| x.is_finite()));
        let said: Vec<&str> = warnings.iter().filter(|w| w.code == "W0605").map(|w| w.message.as_str()).collect();
        assert_eq!(said, if message.is_empty() { vec![] } else { vec![*message] });
    }
    // As small and as large as 32 bits go, these are triangles.
    for size in ["1e-44", "1e-20", "3e38"] {
        let text = format!("v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nf 1 2 3\n");
        assert!(load("a.obj", text).expect(size).1.iter().all(|w| w.code == "N0606"));
    }
    let nan = ply("ascii", Types("float", "uchar", "int"));
    let nan = String::from_utf8_lossy(&nan).replacen("7 2 1 ", "7 nan 1 ", 1);
    let (mesh, warnings) = load("a.ply", nan).expect("some triangles remain");
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["W0605", "N0606"]);
    assert!(mesh.triangles().len() < 12);
}

#[test]
fn holes_are_told_of() {
    let cube = obj(|[x, y, z]| format!("v {x} {y} {z}\n"), |[a, b, c, d]| format!("f {a} {b} {c} {d}\n"));
    let said = |text: &str| {
        let (_, warnings) = load("a.obj", text).expect("a mesh");
        warnings.into_iter().map(|w| (w.code, w.message)).collect::<Vec<_>>()
    };
    assert_eq!(said(&cube), []);
    // Without one of its faces it has a rim of four edges.
    let face = cube.lines().rfind(|l| l.starts_with('f')).expect("a face");
    let [(code, message)] = &said(&cube.replace(face, ""))[..] else { panic!("one note") };
    assert_eq!(*code, "N0606");
    assert!(message.starts_with("is not closed: 4 edges belong to one triangle alone, such as ("), "{message}");
    // A corner that is not quite where its neighbours think; and −0, which is 0.
    assert_eq!(said("v 0 0 0\nv 1 0 0\nv 0 1 0\nv -0 0 0\nf 1 2 3\nf 4 3 2\n"), []);
    assert_eq!(said("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1e-9 0 0\nf 1 2 3\nf 4 3 2\n").len(), 1);
}
