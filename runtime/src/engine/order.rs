//! The order of splats: depths as keys of 32 bits, and the stable radix sort that a GPU is held to.

/// A key that grows with a depth: unsigned comparison of keys is comparison of depths, −0 below +0, and NaN of either sign
/// beyond everything, so that what has no depth is drawn first from the back and hides nothing.
#[must_use]
pub fn depth_key(depth: f32) -> u32 {
    if depth.is_nan() {
        return u32::MAX;
    }
    let bits = depth.to_bits();
    // Negative numbers run backwards; positive ones lie above them.
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

/// The indices of keys from the smallest to the largest; of equal keys the first stays first. Least significant digit
/// first, eight bits at a time: what a parallel radix sort does, one after the other.
#[must_use]
pub fn sorted_indices(keys: &[u32]) -> Vec<u32> {
    let mut from: Vec<u32> = (0..keys.len() as u32).collect();
    let mut to = vec![0; keys.len()];
    for shift in [0, 8, 16, 24] {
        let digit = |i: u32| (keys[i as usize] >> shift & 0xff) as usize;
        let mut starts = [0_usize; 256];
        from.iter().for_each(|i| starts[digit(*i)] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        for i in &from {
            to[starts[digit(*i)]] = *i;
            starts[digit(*i)] += 1;
        }
        std::mem::swap(&mut from, &mut to);
    }
    from
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn by_comparison(keys: &[u32]) -> Vec<u32> {
        let mut all: Vec<u32> = (0..keys.len() as u32).collect();
        all.sort_by_key(|i| keys[*i as usize]);
        all
    }

    #[test]
    fn a_million_depths_with_ties() {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        // A tenth as many depths as splats: each comes about ten times.
        let depths: Vec<f32> = (0..1_000_000).map(|_| (next() % 100_000) as f32 * 1e-3 - 20.0).collect();
        let keys: Vec<u32> = depths.iter().map(|d| depth_key(*d)).collect();
        let order = sorted_indices(&keys);
        assert_eq!(order, by_comparison(&keys));
        assert!(order.windows(2).all(|p| {
            let (a, b) = (p[0] as usize, p[1] as usize);
            depths[a] < depths[b] || depths[a] == depths[b] && a < b
        }));
        // The same input gives the same order, frame after frame.
        assert_eq!(sorted_indices(&keys), order);
    }

    proptest! {
        #[test]
        fn keys_are_ordered_as_depths(a in any::<f32>(), b in any::<f32>()) {
            let (ka, kb) = (depth_key(a), depth_key(b));
            match a.partial_cmp(&b) {
                // −0 and +0 are equal, and their keys are not.
                Some(std::cmp::Ordering::Equal) => prop_assert!(ka == kb || a == 0.0),
                Some(order) => prop_assert_eq!(ka.cmp(&kb), order),
                None => prop_assert!(ka == u32::MAX || kb == u32::MAX),
            }
        }

        #[test]
        fn any_keys(keys in proptest::collection::vec(any::<u32>(), 0..300)) {
            prop_assert_eq!(sorted_indices(&keys), by_comparison(&keys));
        }
    }
}
