//! The integer hash that all noise rests on: its numbers are part of the language and may never change.

use compiler::ir::eval::cell_hash;
use proptest::prelude::*;

/// PCG3D written out in 64-bit arithmetic, reduced modulo 2³² where the definition wraps.
fn again(cell: [i64; 3], seed: i64) -> [f64; 3] {
    const M: u64 = 1 << 32;
    let wrap = |x: i64| x.rem_euclid(M as i64) as u64;
    let mut v = [0, 1, 2].map(|i| {
        let odd = [0x9E37_79B9u64, 0x85EB_CA6B, 0xC2B2_AE35][i];
        (wrap(cell[i]) + wrap(seed) * odd) % M
    });
    v = v.map(|x| (x * 1_664_525 + 1_013_904_223) % M);
    for round in 0..2 {
        v[0] = (v[0] + v[1] * v[2] % M) % M;
        v[1] = (v[1] + v[2] * v[0] % M) % M;
        v[2] = (v[2] + v[0] * v[1] % M) % M;
        if round == 0 {
            v = v.map(|x| x ^ (x >> 16));
        }
    }
    v.map(|x| (x >> 8) as f64 / 16_777_216.0)
}

/// As 24-bit integers, so that a reader can compare them with any other implementation.
#[test]
fn golden_values() {
    let bits = |cell, seed| cell_hash(cell, seed).map(|x| (x * 16_777_216.0) as u32);
    let cases = [
        ([0.0, 0.0, 0.0], 0.0),
        ([1.0, 2.0, 3.0], 0.0),
        ([1.0, 2.0, 3.0], 1.0),
        ([-1.0, -2.0, -3.0], 7.0),
        ([1e6, -1e6, 12_345.0], -4.0),
    ];
    let got: Vec<String> = cases.iter().map(|(c, s)| format!("{c:?} seed {s}: {:?}", bits(*c, *s))).collect();
    insta::assert_snapshot!(got.join("\n"), @r"
    [0.0, 0.0, 0.0] seed 0: [10203095, 11069578, 4134216]
    [1.0, 2.0, 3.0] seed 0: [16424825, 4780788, 5861210]
    [1.0, 2.0, 3.0] seed 1: [16679267, 10381501, 3589750]
    [-1.0, -2.0, -3.0] seed 7: [9421025, 2203591, 11615799]
    [1000000.0, -1000000.0, 12345.0] seed -4: [3505915, 12200855, 15662244]
    ");
}

proptest! {
    #[test]
    fn it_is_the_published_function(cell in prop::array::uniform3(any::<i32>()), seed in any::<i16>()) {
        // Beyond the largest f32 below 2³¹ coordinates are clamped.
        let cell = cell.map(|c| c.min(2_147_483_520));
        let got = cell_hash(cell.map(f64::from), f64::from(seed));
        prop_assert_eq!(got, again(cell.map(i64::from), i64::from(seed)));
    }

    #[test]
    fn a_cell_is_all_its_points(cell in prop::array::uniform3(-1000i32..1000), t in prop::array::uniform3(0.0..1.0f64)) {
        let whole = cell.map(f64::from);
        let inside: [f64; 3] = std::array::from_fn(|i| whole[i] + t[i] * 0.999);
        prop_assert_eq!(cell_hash(inside, 3.0), cell_hash(whole, 3.0));
    }

    #[test]
    fn its_range_is_half_open(cell in prop::array::uniform3(any::<f64>()), seed in any::<f64>()) {
        prop_assert!(cell_hash(cell, seed).iter().all(|x| (0.0..1.0).contains(x) && (x * 16_777_216.0).fract() == 0.0));
    }
}

/// Pearson's statistic over 64 bins for 64 000 neighbouring cells: 63 ± 11 if uniform; 140 is beyond chance.
#[test]
fn neighbouring_cells_are_uniform_and_uncorrelated() {
    let mut bins = [[0u32; 64]; 3];
    let (mut product, mut count) = ([0.0; 3], 0.0);
    for x in 0..40 {
        for y in 0..40 {
            for z in 0..40 {
                let cell = [f64::from(x), f64::from(y), f64::from(z)];
                let here = cell_hash(cell, 0.0);
                let next = cell_hash([cell[0] + 1.0, cell[1], cell[2]], 0.0);
                for c in 0..3 {
                    bins[c][(here[c] * 64.0) as usize] += 1;
                    product[c] += (here[c] - 0.5) * (next[c] - 0.5) * 12.0;
                }
                count += 1.0;
            }
        }
    }
    for c in 0..3 {
        let expected = count / 64.0;
        let statistic: f64 = bins[c].iter().map(|n| (f64::from(*n) - expected).powi(2) / expected).sum();
        assert!((20.0..140.0).contains(&statistic), "component {c}: χ² = {statistic}");
        let correlation = product[c] / count;
        assert!(correlation.abs() < 5.0 / f64::sqrt(count), "component {c} follows its neighbour: {correlation}");
    }
}
