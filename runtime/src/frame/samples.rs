//! Sample positions inside a pixel, and the pixels that are checked against the reference.

/// Positions inside a pixel, in pixels from its top left corner, for `n` samples: the centre for 1, a regular √n × √n
/// grid for a perfect square, else the rank-1 lattice `(½ + i·a, ½ + i·b) mod 1` of R2 (Roberts 2018), `a = 1/g`,
/// `b = 1/g²`, `g³ = g + 1`.
#[must_use]
pub fn sample_offsets(n: u32) -> Vec<[f64; 2]> {
    let n = n.max(1);
    let root = n.isqrt();
    if root * root == n {
        let step = 1.0 / f64::from(root);
        return (0..n).map(|i| [(f64::from(i % root) + 0.5) * step, (f64::from(i / root) + 0.5) * step]).collect();
    }
    const G: f64 = 1.324_717_957_244_746;
    (0..n).map(|i| [(0.5 + f64::from(i) / G).fract(), (0.5 + f64::from(i) / (G * G)).fract()]).collect()
}

/// At most `count` different pixels, one at a hashed place in each cell of a regular partition of the picture, in rows
/// from the top. The same arguments give the same pixels.
#[must_use]
pub fn stratified_pixels(size: [u32; 2], count: u32, seed: u64) -> Vec<[u32; 2]> {
    let [w, h] = size;
    if w == 0 || h == 0 || count == 0 {
        return vec![];
    }
    if u64::from(w) * u64::from(h) <= u64::from(count) {
        return (0..h).flat_map(|y| (0..w).map(move |x| [x, y])).collect();
    }
    // Cells as square as the picture allows, never more than pixels on an axis.
    let columns = (f64::from(count) * f64::from(w) / f64::from(h)).sqrt().round().max(1.0) as u32;
    let columns = columns.min(w).min(count);
    let rows = (count / columns).max(1).min(h);
    let columns = (count / rows).min(w);
    let edge = |i: u32, n: u32, size: u32| (u64::from(i) * u64::from(size) / u64::from(n)) as u32;
    let mut state = seed;
    let mut pixels = vec![];
    for j in 0..rows {
        for i in 0..columns {
            let mut pick = |i, n, size| {
                let (low, high) = (edge(i, n, size), edge(i + 1, n, size));
                low + (splitmix(&mut state) % u64::from((high - low).max(1))) as u32
            };
            pixels.push([pick(i, columns, w), pick(j, rows, h)]);
        }
    }
    pixels
}

/// SplitMix64 (Steele, Lea and Flood 2014).
pub(crate) fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_lie_inside_and_average_to_the_centre() {
        assert_eq!(sample_offsets(1), [[0.5, 0.5]]);
        assert_eq!(sample_offsets(4), [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]]);
        for n in 1..40 {
            let offsets = sample_offsets(n);
            assert_eq!(offsets.len(), n as usize);
            for axis in 0..2 {
                assert!(offsets.iter().all(|o| (0.0..1.0).contains(&o[axis])));
                let mean = offsets.iter().map(|o| o[axis]).sum::<f64>() / f64::from(n);
                assert!((mean - 0.5).abs() < 0.51 / f64::from(n).sqrt(), "{n} samples have mean {mean}");
            }
        }
    }

    #[test]
    fn stratified_pixels_are_distinct_and_spread() {
        for size in [[800, 800], [16384, 1], [1, 5000], [17, 16], [3, 2], [1920, 1080]] {
            let pixels = stratified_pixels(size, 256, 7);
            let mut unique = pixels.clone();
            unique.sort_unstable();
            unique.dedup();
            assert_eq!(unique.len(), pixels.len());
            assert!(pixels.iter().all(|p| p[0] < size[0] && p[1] < size[1]));
            let all = u64::from(size[0]) * u64::from(size[1]);
            assert!(pixels.len() <= 256 && pixels.len() as u64 >= all.min(180), "{size:?}: {}", pixels.len());
            assert_eq!(pixels, stratified_pixels(size, 256, 7));
        }
        assert!(stratified_pixels([0, 9], 256, 7).is_empty());
    }
}
