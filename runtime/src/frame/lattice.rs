//! The lattice of splats around the media.

use super::Vec3;
use super::vector::{add, sub};

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
}

impl Lattice {
    /// About `count` nodes in the boxes, and a rim around them.
    #[must_use]
    pub fn around(boxes: &[[Vec3; 8]], count: u32) -> Self {
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
        Self { low, spacing, counts: counts.map(|n| n as u32) }
    }

    /// Nodes in all.
    #[must_use]
    pub fn len(&self) -> u32 {
        self.counts.iter().product()
    }

    /// Whether there is nothing to draw.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(low: Vec3, high: Vec3) -> [Vec3; 8] {
        std::array::from_fn(|i| std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] }))
    }

    #[test]
    fn the_rim_lies_outside_and_the_rest_covers_the_box() {
        let lattice = Lattice::around(&[cube([-1.0, 0.0, 2.0], [1.0, 0.5, 3.0])], 4000);
        let far = add(lattice.low, lattice.counts.map(|n| f64::from(n - 1) * lattice.spacing));
        assert!((0..3).all(|k| lattice.low[k] < [-1.0, 0.0, 2.0][k] && far[k] > [1.0, 0.5, 3.0][k]));
        let inside = lattice.counts.map(|n| n - 2 * RIM as u32);
        assert!((4000..6000).contains(&inside.iter().product::<u32>()), "{inside:?}");
    }

    #[test]
    fn there_is_always_an_answer() {
        assert!(Lattice::around(&[], 100).is_empty());
        assert!(Lattice::around(&[cube([0.0; 3], [0.0; 3])], 100).is_empty());
        let flat = Lattice::around(&[cube([0.0; 3], [1.0, 1.0, 0.0])], 1000);
        assert!(flat.len() > 100 && flat.counts[2] == 7);
    }
}
