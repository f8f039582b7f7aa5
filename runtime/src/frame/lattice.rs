//! The lattice of splats around the media, and the order in which they are drawn.

use super::Vec3;
use super::vector::{add, dot, sub};
use rayon::prelude::*;

/// Nodes by which the lattice is wider than the media on each side, so that Gaussians at its rim add up as inside.
const RIM: f64 = 3.0;

/// Nodes in the middles of cubes. Lengths are in the scene's units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lattice {
    /// The first node.
    pub low: Vec3,
    /// Distance between nodes.
    pub spacing: f64,
    /// Nodes along each axis; number i is x + counts.x·(y + counts.y·z).
    pub counts: [u32; 3],
    /// All of them, from the farthest to the nearest; of those at one depth the later in front.
    pub order: Vec<u32>,
}

impl Lattice {
    /// About `count` nodes in the boxes, and a rim around them, in order along a direction.
    #[must_use]
    pub fn around(boxes: &[[Vec3; 8]], count: u32, forward: Vec3) -> Self {
        let extreme = |start: f64, pick: fn(f64, f64) -> f64| -> Vec3 {
            std::array::from_fn(|k| boxes.iter().flatten().map(|p| p[k]).fold(start, pick))
        };
        let (low, high) = (extreme(f64::INFINITY, f64::min), extreme(f64::NEG_INFINITY, f64::max));
        let edges = sub(high, low);
        let longest = edges.iter().copied().fold(0.0, f64::max);
        if boxes.is_empty() || count == 0 || !(longest > 0.0 && longest.is_finite()) {
            return Self { spacing: 1.0, ..Self::default() };
        }
        // A flat box has a layer of nodes.
        let volume = edges.iter().map(|e| e.max(1e-3 * longest)).product::<f64>();
        let spacing = (volume / f64::from(count)).cbrt();
        let counts = edges.map(|e| (e / spacing).ceil().max(1.0) + 2.0 * RIM);
        let middle = add(low, edges.map(|e| 0.5 * e));
        let low: Vec3 = std::array::from_fn(|k| middle[k] - 0.5 * (counts[k] - 1.0) * spacing);
        let counts = counts.map(|n| n as u32);
        let [nx, ny, nz] = counts;
        let depth = |i: u32| {
            let index = [i % nx, i / nx % ny, i / nx / ny].map(f64::from);
            dot(index, forward)
        };
        let mut keyed: Vec<(f64, u32)> = (0..nx * ny * nz).into_par_iter().map(|i| (depth(i), i)).collect();
        keyed.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        Self { low, spacing, counts, order: keyed.into_iter().map(|k| k.1).collect() }
    }

    /// Nodes in all.
    #[must_use]
    pub fn len(&self) -> u32 {
        self.order.len() as u32
    }

    /// Whether there is nothing to draw.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(low: Vec3, high: Vec3) -> [Vec3; 8] {
        std::array::from_fn(|i| std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] }))
    }

    #[test]
    fn every_node_is_drawn_once_from_far_to_near() {
        for forward in [[0.0, 0.0, 1.0], [0.6, 0.0, -0.8], [0.36, 0.48, 0.8]] {
            let lattice = Lattice::around(&[cube([-1.0, 0.0, 2.0], [1.0, 0.5, 3.0])], 4000, forward);
            let place = |i: u32| {
                let [nx, ny, _] = lattice.counts;
                let index = [i % nx, i / nx % ny, i / nx / ny].map(f64::from);
                add(lattice.low, index.map(|x| x * lattice.spacing))
            };
            let depths: Vec<f64> = lattice.order.iter().map(|i| dot(place(*i), forward)).collect();
            assert!(depths.windows(2).all(|w| w[0] >= w[1] - 1e-9));
            let mut all = lattice.order.clone();
            all.sort_unstable();
            assert!(all.iter().copied().eq(0..lattice.len()), "each once");
            assert_eq!(lattice.len(), lattice.counts.iter().product());
            // The rim lies outside, the rest covers the box.
            let far = place(lattice.len() - 1);
            assert!((0..3).all(|k| lattice.low[k] < [-1.0, 0.0, 2.0][k] && far[k] > [1.0, 0.5, 3.0][k]));
        }
    }

    #[test]
    fn there_is_always_an_answer() {
        assert!(Lattice::around(&[], 100, [0.0, 0.0, 1.0]).is_empty());
        assert!(Lattice::around(&[cube([0.0; 3], [0.0; 3])], 100, [0.0, 0.0, 1.0]).is_empty());
        let flat = Lattice::around(&[cube([0.0; 3], [1.0, 1.0, 0.0])], 1000, [0.0, 0.0, 1.0]);
        assert!(flat.len() > 100 && flat.counts[2] == 7);
    }
}
