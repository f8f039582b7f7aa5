//! What happens to voxels that engines cannot take.

use super::*;

fn header(scalar: Scalar, dims: [u32; 3], slope: f64, intercept: f64) -> GridHeader {
    let world_from_index = [[0.001, 0.0, 0.0, 0.0], [0.0, 0.001, 0.0, 0.0], [0.0, 0.0, 0.001, 0.0]];
    GridHeader { dims, scalar, slope, intercept, world_from_index }
}

#[test]
fn what_is_not_finite_is_stored_as_zero_and_counted() {
    let mut voxels = vec![1.0_f32; 24];
    voxels[7] = f32::NAN;
    voxels[9] = f32::INFINITY;
    voxels[23] = f32::NEG_INFINITY;
    voxels[5] = 1e-40;
    voxels[3] = -2.0;
    let (volume, warnings) = Volume::new(header(Scalar::F32, [2, 3, 4], 1.0, 0.0), Voxels::F32(voxels)).unwrap();
    let said: Vec<_> = warnings.iter().map(|w| (w.code, w.severity, w.message.as_str())).collect();
    assert_eq!(
        said,
        [
            (
                "W0601",
                Severity::Warning,
                "1 voxel is not a number and now stored as 0 (value 0), the first at (1, 0, 1)"
            ),
            ("W0601", Severity::Warning, "2 voxels are infinite and now stored as 0 (value 0), the first at (1, 1, 1)"),
            (
                "W0602",
                Severity::Note,
                "1 voxel is too small for a normal floating-point number and now stored as 0, the first at (1, 2, 0)"
            ),
            ("W0603", Severity::Note, "1 voxel is negative, down to -2, the first at (1, 1, 0); they are kept"),
        ]
    );
    assert_eq!(volume.range(), (-2.0, 1.0));
    assert_eq!(volume.value(1, 0, 1), 0.0);
    assert_eq!(volume.value(1, 2, 0), 0.0);
    assert_eq!(volume.value(1, 1, 0), -2.0);
    let values = bytemuck::cast_slice::<u8, f32>(volume.bytes());
    assert!(values.iter().all(|v| v.is_finite() && !v.is_subnormal()));
}

#[test]
fn the_value_of_a_replaced_voxel_is_the_intercept() {
    let voxels = Voxels::F64(vec![f64::NAN, 2.0]);
    let (volume, warnings) = Volume::new(header(Scalar::F64, [2, 1, 1], 3.0, -1000.0), voxels).unwrap();
    assert_eq!(volume.value(0, 0, 0), -1000.0);
    assert_eq!(volume.value(1, 0, 0), -994.0);
    assert_eq!(warnings.len(), 2);
    assert!(warnings[0].message.contains("(value -1000)"));
}

#[test]
fn values_that_overflow_when_scaled_count_as_infinite() {
    let voxels = Voxels::F64(vec![1e300, 1.0]);
    let (volume, warnings) = Volume::new(header(Scalar::F64, [1, 1, 2], 1e20, 0.0), voxels).unwrap();
    assert_eq!(volume.range(), (0.0, 1e20));
    assert_eq!(warnings[0].code, "W0601");
    let voxels = Voxels::U8(vec![255, 0]);
    let (volume, warnings) = Volume::new(header(Scalar::U8, [1, 1, 2], f64::MAX, 0.0), voxels).unwrap();
    assert_eq!((volume.range(), warnings.len()), ((0.0, 0.0), 1));
}

#[test]
fn the_first_place_does_not_depend_on_threads() {
    // Several parts of the parallel pass, with the first bad voxel in the second of them.
    let n = 100_u32;
    let mut voxels = vec![0.5_f64; (n * n * n) as usize];
    let first = 70_007;
    for at in (first..voxels.len()).step_by(13) {
        voxels[at] = f64::NAN;
    }
    let bad = voxels.iter().filter(|v| v.is_nan()).count();
    let (_, warnings) = Volume::new(header(Scalar::F64, [n, n, n], 1.0, 0.0), Voxels::F64(voxels)).unwrap();
    let expected = format!("{bad} voxels are not a number and now stored as 0 (value 0), the first at (7, 0, 7)");
    assert_eq!(warnings[0].message, expected);
}

#[test]
fn negative_values_after_scaling_are_a_note() {
    let (volume, warnings) =
        Volume::new(header(Scalar::U16, [3, 1, 1], 1.0, -1024.0), Voxels::U16(vec![0, 1024, 3000])).unwrap();
    assert_eq!(volume.range(), (-1024.0, 1976.0));
    assert_eq!((warnings.len(), warnings[0].code, warnings[0].severity), (1, "W0603", Severity::Note));
    let diagnostic = warnings[0].to_diagnostic();
    assert_eq!((diagnostic.code, diagnostic.severity), ("W0603", Severity::Note));
}

#[test]
fn parts_that_do_not_fit_are_refused() {
    let two = || Voxels::U8(vec![1, 2]);
    let code = |h: GridHeader, v| Volume::new(h, v).unwrap_err().code;
    assert_eq!(code(header(Scalar::U8, [3, 1, 1], 1.0, 0.0), two()), "E0603");
    assert_eq!(code(header(Scalar::I8, [2, 1, 1], 1.0, 0.0), two()), "E0603");
    assert_eq!(code(header(Scalar::U8, [0, 1, 1], 1.0, 0.0), Voxels::U8(vec![])), "E0603");
    assert_eq!(code(header(Scalar::U8, [2, 1, 1], f64::NAN, 0.0), two()), "E0603");
    let mut flat = header(Scalar::U8, [2, 1, 1], 1.0, 0.0);
    flat.world_from_index[2][2] = 0.0;
    assert_eq!(code(flat, two()), "E0607");
}
