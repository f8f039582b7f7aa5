//! What is read, in every encoding.

use super::*;

#[track_caller]
fn assert_near(a: f64, b: f64, tolerance: f64, what: &str) {
    assert!((a - b).abs() <= tolerance, "{what}: {a}, not {b}");
}

/// Compares with the numbers the file was made from, to the steps of a format.
#[track_caller]
fn assert_same(splats: &Splats, plain: &[Plain], [place, color, opacity, scale, turn, rest]: [f64; 6], what: &str) {
    assert_eq!(splats.len(), plain.len(), "{what}");
    let above = coefficients(splats.degree()) - 1;
    for (i, p) in plain.iter().enumerate() {
        for axis in 0..3 {
            assert_near(splats.centers()[i][axis].into(), p.center[axis].into(), place, what);
            let (found, log) = (f64::from(splats.deviations()[i][axis]), f64::from(p.scale[axis]));
            assert_near(found.ln(), log, scale, what);
            let found = f64::from(splats.harmonics(i)[axis]);
            assert_near(found, p.color[axis].into(), color, what);
            for k in 0..above {
                let found = f64::from(splats.harmonics(i)[3 * (k + 1) + axis]);
                assert_near(found, p.rest[axis * above + k].into(), rest, what);
            }
        }
        let logit = f64::from(p.opacity);
        assert_near(splats.opacities()[i].into(), 1.0 / (1.0 + (-logit).exp()), opacity, what);
        let q = p.rotation.map(f64::from);
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        // A quaternion and its negative are one rotation.
        let r = splats.rotations()[i].map(f64::from);
        let same = (0..4).map(|k| r[k] * q[k] / norm).sum::<f64>().abs();
        assert_near((2.0 * (1.0 - same)).max(0.0).sqrt(), 0.0, turn, what);
        assert_near(r.iter().map(|x| x * x).sum::<f64>(), 1.0, 1e-6, what);
    }
}

#[test]
fn every_degree_in_every_encoding_of_ply() {
    for degree in 0..=3 {
        let plain = some(50, degree);
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            let what = format!("{format}, degree {degree}");
            // The content decides, not the ending.
            for name in ["a.ply", "a", "a.spz"] {
                let (splats, warnings) = load(name, ply(format, &plain)).expect(&what);
                assert_eq!((warnings, splats.degree()), (vec![], degree), "{what}");
                assert_same(&splats, &plain, [0.0, 0.0, 1e-7, 1e-6, 1e-3, 0.0], &what);
            }
        }
    }
}

#[test]
fn every_degree_and_version_of_spz() {
    for degree in 0..=3 {
        let plain = some(50, degree);
        for version in [2, 3] {
            let what = format!("version {version}, degree {degree}");
            let (splats, warnings) = load("a.spz", gzip(&spz_stream(version, degree, 0, &plain))).expect(&what);
            assert_eq!((warnings, splats.degree()), (vec![], degree), "{what}");
            // Half a step of each number; of a quaternion's parts together.
            let turn = if version == 2 { 0.02 } else { 0.003 };
            assert_same(&splats, &plain, [1.3e-4, 1.4e-2, 2.1e-3, 3.2e-2, turn, 4e-3], &what);
            assert!(!splats.antialiased());
        }
    }
    let (splats, _) = load("a.spz", gzip(&spz_stream(3, 0, 1, &some(3, 0)))).expect("reads");
    assert!(splats.antialiased());
}

#[test]
fn numbers_of_spz_that_are_known() {
    // −1, the smallest, and 2047.99976 in units of 1/4096; the middle of every other range.
    let mut stream = b"NGSP\x03\0\0\0\x01\0\0\0\0\x0c\0\0".to_vec();
    stream.extend([0x00, 0xf0, 0xff, 0x00, 0x00, 0x80, 0xff, 0xff, 0x7f]);
    stream.extend([255, 0, 255, 51, 160, 144, 176]);
    // w is the largest; x = √½·511/511, y = −√½·100/511, z = 0.
    let word: u32 = 3 << 30 | 511 << 20 | (1 << 9 | 100) << 10;
    stream.extend(word.to_le_bytes());
    let (splats, _) = load("a.spz", gzip(&stream)).expect("reads");
    assert_eq!(splats.centers()[0], [-1.0, -2048.0, 8_388_607.0 / 4096.0]);
    assert_eq!(splats.opacities()[0], 1.0);
    let color: Vec<f32> = [-0.5, 0.5, -0.3].iter().map(|x| (x / 0.15) as f32).collect();
    assert_eq!(splats.harmonics(0), color);
    assert_eq!(splats.deviations()[0], [0.0_f64, -1.0, 1.0].map(|x| x.exp() as f32));
    let (x, y) = (0.5_f64.sqrt(), 0.5_f64.sqrt() * 100.0 / 511.0);
    let expected = [(1.0 - x * x - y * y).sqrt(), x, -y, 0.0].map(|q| q as f32);
    for (a, b) in splats.rotations()[0].iter().zip(expected) {
        assert!((a - b).abs() < 1e-6);
    }
}

#[test]
fn what_is_odd_but_right() {
    let plain = some(4, 1);
    // Doubles, other properties between, lists, and elements before and after.
    let text = String::from_utf8(ply("ascii", &plain)).expect("text");
    let text = text.replace("property float", "property double").replace(
        "element vertex 4\n",
        "element sensor 1\nproperty list uchar int ids\nelement vertex 4\nproperty list uchar uchar tags\nproperty uchar red\n",
    );
    let (head, rows) = text.split_once("end_header\n").expect("a header");
    let rows: String = rows.lines().map(|l| format!("2 1 1 255 {l}\n")).collect();
    let text =
        format!("{head}element face 1\nproperty list uchar int vertex_indices\nend_header\n3 7 8 9\n{rows}3 0 1 2\n");
    let (splats, warnings) = load("a.ply", text).expect("reads");
    assert_eq!(warnings, vec![]);
    assert_same(&splats, &plain, [0.0, 0.0, 1e-7, 1e-6, 1e-3, 0.0], "odd");
    // Harmonics of degree 4 are dropped, extensions skipped.
    let mut many = some(2, 3);
    many.iter_mut().for_each(|s| s.rest.extend([0.25; 27]));
    let mut stream = spz_stream(3, 4, 2, &many);
    stream.extend([2, 0, 0xbe, 0xad, 4, 0, 0, 0, 1, 2, 3, 4]);
    let (splats, warnings) = load("a.spz", gzip(&stream)).expect("reads");
    assert_eq!((splats.degree(), warnings.len()), (3, 2));
    assert!(warnings[0].message.contains("degree 4") && warnings[1].message.contains("extensions"));
}

#[test]
fn bad_splats_are_left_out_and_counted() {
    let mut plain = some(8, 1);
    plain[1].center[2] = f32::NAN;
    plain[2].rest[4] = f32::INFINITY;
    plain[3].rotation = [0.0; 4];
    plain[4].scale[0] = 90.0;
    plain[5].opacity = f32::NAN;
    // Fully opaque, fully clear, and without an extent: all right.
    plain[6].opacity = f32::INFINITY;
    plain[6].scale = [f32::NEG_INFINITY; 3];
    plain[7].opacity = f32::NEG_INFINITY;
    for format in ["ascii", "binary_little_endian"] {
        let (splats, warnings) = load("a.ply", ply(format, &plain)).expect("reads");
        assert_eq!(splats.len(), 3);
        assert_eq!(splats.opacities()[1..], [1.0, 0.0]);
        assert_eq!(splats.deviations()[1], [0.0; 3]);
        let said = "4 splats have a number that is not finite and 1 splat has a rotation of zero; left out, the first is splat 2";
        assert_eq!(warnings.iter().map(|w| (w.code, w.message.as_str())).collect::<Vec<_>>(), [("W0660", said)]);
    }
    // Tiny and huge quaternions are rotations all the same.
    plain = some(2, 0);
    plain[0].rotation = [1e-30, 0.0, 1e-30, 0.0];
    plain[1].rotation = [3e38, 3e38, 3e38, 3e38];
    let (splats, warnings) = load("a.ply", ply("binary_big_endian", &plain)).expect("reads");
    assert_eq!(warnings, vec![]);
    assert!((splats.rotations()[0][0] - 0.5_f32.sqrt()).abs() < 1e-6 && splats.rotations()[1] == [0.5; 4]);
}

#[test]
fn the_header_knows_the_middle() {
    let mut plain = some(200, 0);
    for (i, s) in plain.iter_mut().enumerate() {
        s.center = [i as f32, -(i as f32), 1.0];
    }
    plain[7].center[0] = -1e6;
    let (splats, _) = load("a.ply", ply("binary_little_endian", &plain)).expect("reads");
    let header = splats.header();
    assert_eq!((header.count, header.degree), (200, 0));
    assert_eq!(header.bounds, ([-1e6, -199.0, 1.0], [199.0, 0.0, 1.0]));
    assert_eq!(header.core, ([1.0, -197.0, 1.0], [197.0, -2.0, 1.0]));
    assert_eq!(splats.bytes_per_splat(), 56);
}
