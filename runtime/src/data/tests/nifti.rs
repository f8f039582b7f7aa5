//! NIfTI of both versions, byte orders, every sample type and every form of orientation.

use super::*;

/// Builds a file field by field, at the places that `nifti1.h` and `nifti2.h` give.
pub(super) struct Builder {
    pub(super) version: u8,
    pub(super) big_endian: bool,
    pub(super) pair: bool,
    pub(super) bytes: Vec<u8>,
    pub(super) data: Vec<u8>,
}

/// The type's number in NIfTI.
fn datatype(scalar: Scalar) -> i16 {
    match scalar {
        Scalar::U8 => 2,
        Scalar::I8 => 256,
        Scalar::U16 => 512,
        Scalar::I16 => 4,
        Scalar::U32 => 768,
        Scalar::I32 => 8,
        Scalar::U64 => 1280,
        Scalar::I64 => 1024,
        Scalar::F32 => 16,
        Scalar::F64 => 64,
    }
}

impl Builder {
    pub(super) fn new(version: u8, big_endian: bool, scalar: Scalar, dims: &[i64], data: &[f64]) -> Self {
        let bytes = vec![0; if version == 1 { 352 } else { 544 }];
        let data = data.iter().flat_map(|v| encode(scalar, *v, big_endian)).collect();
        let mut b = Self { version, big_endian, pair: false, bytes, data };
        b.put(0, &(if version == 1 { 348_i32 } else { 540 }).to_le_bytes());
        if version == 1 {
            b.bytes[344..348].copy_from_slice(b"n+1\0");
            b.put(108, &352_f32.to_le_bytes());
        } else {
            b.bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
            b.put(168, &544_i64.to_le_bytes());
        }
        b.datatype(datatype(scalar));
        b.dim(0, dims.len() as i64);
        b.pixdim(0, 1.0);
        for (n, d) in dims.iter().enumerate() {
            b.dim(n + 1, *d);
            b.pixdim(n + 1, 1.0);
        }
        b
    }

    fn put(&mut self, at: usize, number: &[u8]) -> &mut Self {
        let mut number = number.to_vec();
        if self.big_endian {
            number.reverse();
        }
        self.bytes[at..at + number.len()].copy_from_slice(&number);
        self
    }

    fn float(&mut self, at_1: usize, at_2: usize, value: f64) -> &mut Self {
        if self.version == 1 {
            self.put(at_1, &(value as f32).to_le_bytes())
        } else {
            self.put(at_2, &value.to_le_bytes())
        }
    }

    fn code(&mut self, at_1: usize, at_2: usize, value: i16) -> &mut Self {
        if self.version == 1 {
            self.put(at_1, &value.to_le_bytes())
        } else {
            self.put(at_2, &i32::from(value).to_le_bytes())
        }
    }

    pub(super) fn datatype(&mut self, n: i16) -> &mut Self {
        let at = if self.version == 1 { 70 } else { 12 };
        self.put(at, &n.to_le_bytes())
    }

    pub(super) fn dim(&mut self, n: usize, value: i64) -> &mut Self {
        if self.version == 1 {
            self.put(40 + 2 * n, &(value as i16).to_le_bytes())
        } else {
            self.put(16 + 8 * n, &value.to_le_bytes())
        }
    }

    pub(super) fn pixdim(&mut self, n: usize, value: f64) -> &mut Self {
        self.float(76 + 4 * n, 104 + 8 * n, value)
    }

    pub(super) fn scaling(&mut self, slope: f64, intercept: f64) -> &mut Self {
        self.float(112, 176, slope).float(116, 184, intercept)
    }

    pub(super) fn units(&mut self, units: u8) -> &mut Self {
        if self.version == 1 {
            self.bytes[123] = units;
            self
        } else {
            self.put(500, &i32::from(units).to_le_bytes())
        }
    }

    pub(super) fn qform(&mut self, code: i16, quaternion: [f64; 3], offset: [f64; 3]) -> &mut Self {
        self.code(252, 344, code);
        for n in 0..3 {
            self.float(256 + 4 * n, 352 + 8 * n, quaternion[n]).float(268 + 4 * n, 376 + 8 * n, offset[n]);
        }
        self
    }

    pub(super) fn sform(&mut self, code: i16, rows: [[f64; 4]; 3]) -> &mut Self {
        self.code(254, 348, code);
        for (r, row) in rows.iter().enumerate() {
            for (c, x) in row.iter().enumerate() {
                self.float(280 + 16 * r + 4 * c, 400 + 32 * r + 8 * c, *x);
            }
        }
        self
    }

    pub(super) fn voxel_offset(&mut self, offset: f64) -> &mut Self {
        if self.version == 1 {
            self.put(108, &(offset as f32).to_le_bytes())
        } else {
            self.put(168, &(offset as i64).to_le_bytes())
        }
    }

    pub(super) fn magic(&mut self, magic: &[u8]) -> &mut Self {
        let at = if self.version == 1 { 344 } else { 4 };
        self.bytes[at..at + magic.len()].copy_from_slice(magic);
        self
    }

    pub(super) fn file(&self) -> Vec<u8> {
        [self.bytes.clone(), self.data.clone()].concat()
    }
}

/// A plain f32 grid of 2 × 3 × 4.
pub(super) fn plain(version: u8, big_endian: bool) -> Builder {
    let data: Vec<f64> = (0..24).map(f64::from).collect();
    Builder::new(version, big_endian, Scalar::F32, &[2, 3, 4], &data)
}

/// Runs a test on both versions in both byte orders.
fn variants(test: impl Fn(Builder)) {
    for version in [1, 2] {
        for big_endian in [false, true] {
            test(plain(version, big_endian));
        }
    }
}

#[test]
fn every_type_version_byte_order_and_compression_gives_the_same_values() {
    for scalar in SCALARS {
        for version in [1, 2] {
            for big_endian in [false, true] {
                let data = samples(scalar);
                let file = Builder::new(version, big_endian, scalar, &[2, 3, 4], &data).file();
                for (name, bytes) in [("a.nii", file.clone()), ("a.nii.gz", gzip(&file)), ("misnamed.dat", file)] {
                    let volume = load_ok(name, bytes);
                    assert_eq!(volume.voxels().scalar(), scalar);
                    for (at, expected) in data.iter().enumerate() {
                        let value = volume.value(at % 2, at / 2 % 3, at / 6);
                        assert_eq!(value, *expected, "{scalar:?} v{version} big {big_endian} {name} at {at}");
                    }
                    let expected = data.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
                    assert_eq!(volume.range(), expected);
                }
            }
        }
    }
}

#[test]
fn bare_spacing_puts_the_first_voxel_at_the_origin() {
    variants(|mut b| {
        // The sign of qfac and of a spacing mean nothing without a qform.
        b.pixdim(0, -1.0).pixdim(1, 2.0).pixdim(2, 3.0).pixdim(3, -4.0);
        let map = load_ok("a.nii", b.file()).header().world_from_index;
        assert_near(apply(&map, [0.0; 3]), [0.0; 3]);
        assert_near(apply(&map, [1.0, 1.0, 1.0]), [0.002, 0.003, 0.004]);
    });
}

#[test]
fn the_sform_counts_before_the_qform() {
    variants(|mut b| {
        let rows = [[0.0, -2.0, 0.0, 10.0], [0.5, 0.0, 0.0, -20.0], [0.0, 0.0, 1.5, 30.0]];
        b.qform(1, [0.0; 3], [0.0; 3]).sform(2, rows);
        let map = load_ok("a.nii", b.file()).header().world_from_index;
        assert_near(apply(&map, [0.0; 3]), [0.010, -0.020, 0.030]);
        assert_near(apply(&map, [1.0, 2.0, 3.0]), [0.006, -0.0195, 0.0345]);
    });
}

#[test]
fn the_qform_turns_and_flips() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // Quaternion, qfac, and where the three unit steps (of 1, 2 and 3 mm) go.
    let cases = [
        ([0.0, 0.0, 0.0], 1.0, [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]),
        ([0.0, 0.0, 0.0], -1.0, [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -3.0]]),
        // pixdim[0] = 0 counts as +1.
        ([0.0, 0.0, half], 0.0, [[0.0, 1.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 3.0]]),
        ([half, 0.0, 0.0], 1.0, [[1.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, -3.0, 0.0]]),
        // Half a turn about y: a = 0. And one whose length is past 1 by rounding.
        ([0.0, 1.0, 0.0], 1.0, [[-1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -3.0]]),
        ([0.0, 1.0001, 0.0], -1.0, [[-1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]),
    ];
    for (quaternion, qfac, steps) in cases {
        variants(|mut b| {
            b.pixdim(0, qfac).pixdim(1, 1.0).pixdim(2, 2.0).pixdim(3, 3.0);
            b.qform(1, quaternion, [7.0, 8.0, 9.0]);
            let map = load_ok("a.nii", b.file()).header().world_from_index;
            let origin = apply(&map, [0.0; 3]);
            assert_near(origin, [0.007, 0.008, 0.009]);
            for (axis, step) in steps.iter().enumerate() {
                let column = [map[0][axis] * 1e3, map[1][axis] * 1e3, map[2][axis] * 1e3];
                let near = column.iter().zip(step).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(near, "{quaternion:?} {qfac}: {column:?} is not {step:?}");
            }
        });
    }
}

#[test]
fn units_of_length_are_honoured() {
    // The unit of time in the higher bits must not disturb.
    for (units, metres) in [(0, 1e-3), (1, 1.0), (2, 1e-3), (3, 1e-6), (2 | 8, 1e-3), (1 | 16, 1.0), (5, 1e-3)] {
        variants(|mut b| {
            b.units(units).pixdim(1, 2.0);
            let map = load_ok("a.nii", b.file()).header().world_from_index;
            assert_eq!(map[0][0], 2.0 * metres, "{units}");
        });
    }
}

#[test]
fn values_are_scaled_as_the_header_says() {
    for (slope, intercept, a, b) in [
        (2.0, -1.0, 2.0, -1.0),
        (-0.5, 3.0, -0.5, 3.0),
        (0.0, 3.0, 1.0, 0.0),
        (f64::NAN, 3.0, 1.0, 0.0),
        (f64::INFINITY, 3.0, 1.0, 0.0),
    ] {
        variants(|mut builder| {
            builder.scaling(slope, intercept);
            let volume = load_ok("a.nii", builder.file());
            assert_eq!(volume.value(1, 2, 3), a * 23.0 + b);
            let ends = (b, a * 23.0 + b);
            assert_eq!(volume.range(), (ends.0.min(ends.1), ends.0.max(ends.1)));
        });
    }
}

#[test]
fn voxels_start_where_the_header_says() {
    variants(|mut b| {
        let header = b.bytes.len() as f64;
        b.voxel_offset(header + 16.0);
        b.data.splice(0..0, [0xaa; 16]);
        for bytes in [b.file(), gzip(&b.file())] {
            assert_eq!(load_ok("a.nii.gz", bytes).value(1, 0, 0), 1.0);
        }
        // Less than the header's own length means right after it.
        b.voxel_offset(0.0).data.drain(0..16);
        assert_eq!(load_ok("a.nii", b.file()).value(1, 0, 0), 1.0);
    });
}

#[test]
fn a_pair_of_files_is_read_from_either() {
    for version in [1, 2] {
        let mut b = plain(version, true);
        b.pair = true;
        b.voxel_offset(0.0).magic(if version == 1 { b"ni1\0" } else { b"ni2\0" });
        let (header, data) = (b.bytes.clone(), b.data.clone());
        let plain = Memory::one("d/a.hdr", header.clone()).and("d/a.img", data.clone());
        let packed = Memory::one("d/a.hdr.gz", gzip(&header)).and("d/a.img.gz", gzip(&data));
        for (files, name) in
            [(&plain, "d/a.hdr"), (&plain, "d/a.img"), (&packed, "d/a.hdr.gz"), (&packed, "d/a.img.gz")]
        {
            let (volume, _) = read_volume_from(files, Path::new(name)).unwrap();
            assert_eq!(volume.value(1, 2, 3), 23.0);
        }
        let error = read_volume_from(&Memory::one("d/a.hdr", header), Path::new("d/a.hdr")).unwrap_err();
        assert_eq!(error.code, "E0601");
        assert!(error.message.contains("a.img"), "{}", error.message);
    }
}

#[test]
fn fewer_axes_and_single_further_ones_are_grids_too() {
    let data: Vec<f64> = (0..24).map(f64::from).collect();
    for (dims, expected) in
        [(&[24][..], [24, 1, 1]), (&[4, 6], [4, 6, 1]), (&[2, 3, 4, 1], [2, 3, 4]), (&[2, 3, 4, 1, 1, 1, 1], [2, 3, 4])]
    {
        for version in [1, 2] {
            let mut b = Builder::new(version, false, Scalar::I16, dims, &data);
            // What stands in the fields of axes that are not there must not matter.
            if dims.len() < 3 {
                b.pixdim(3, 0.0).dim(4, -7);
            }
            assert_eq!(load_ok("a.nii", b.file()).header().dims, expected);
        }
    }
}

#[test]
fn gzip_files_of_many_members_with_padding_are_read() {
    let file = plain(1, false).file();
    let (a, b) = file.split_at(400);
    let bytes = [gzip(a), gzip(b""), gzip(b), vec![0; 100]].concat();
    assert_eq!(load_ok("a.nii.gz", bytes).value(1, 2, 3), 23.0);
}
