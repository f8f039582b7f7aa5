//! Rays against triangles in f64.

use super::soup::cross;
use super::{Mesh, Node, Triangle};

impl Mesh {
    /// The first triangle that `origin + t · direction` meets for a `t` of the closed range, from either side; `t` counts
    /// in lengths of `direction`, all lengths are metres. Of triangles at the same `t` any may be given.
    ///
    /// No ray slips through an edge or corner that triangles share: which side of an edge the ray passes is found by the
    /// same operations for both of its triangles (Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", 2013).
    #[must_use]
    pub fn nearest(&self, origin: [f64; 3], direction: [f64; 3], range: (f64, f64)) -> Option<(f64, usize)> {
        let ray = Ray::new(origin, direction)?;
        let (low, mut high) = range;
        let mut found = None;
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !ray.meets(node, low, high) {
                at = node.skip as usize;
                continue;
            }
            let first = node.first as usize;
            for i in first..first + node.count as usize {
                if let Some(t) = ray.hit(&self.triangles[i]).filter(|t| low <= *t && *t <= high) {
                    high = t;
                    found = Some((t, i));
                }
            }
            at += 1;
        }
        found
    }

    /// The unit normal of a triangle, on the side from which its corners run counter-clockwise.
    ///
    /// # Panics
    /// If there is no triangle of this number.
    #[must_use]
    pub fn normal(&self, triangle: usize) -> [f64; 3] {
        let n = cross(&self.triangles[triangle]);
        let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
        n.map(|x| x / length)
    }
}

/// A ray and what is the same for all boxes and triangles.
pub(super) struct Ray {
    origin: [f64; 3],
    direction: [f64; 3],
    /// The axis along which the ray runs farthest, last, and the two others.
    axes: [usize; 3],
    /// Shears and scales the ray onto the last axis.
    shear: [f64; 3],
}

impl Ray {
    /// `None` for a direction that is zero or not finite.
    pub(super) fn new(origin: [f64; 3], direction: [f64; 3]) -> Option<Self> {
        let z = (0..3).max_by(|a, b| direction[*a].abs().total_cmp(&direction[*b].abs()))?;
        let usable = direction[z] != 0.0 && direction.iter().chain(&origin).all(|x| x.is_finite());
        usable.then(|| {
            let axes = [(z + 1) % 3, (z + 2) % 3, z];
            let d = axes.map(|i| direction[i]);
            Self { origin, direction, axes, shear: [d[0] / d[2], d[1] / d[2], 1.0 / d[2]] }
        })
    }

    /// Whether some `t` of the range lies in the box; may say so for a ray that passes within rounding.
    fn meets(&self, node: &Node, mut low: f64, mut high: f64) -> bool {
        for i in 0..3 {
            let (min, max) = (f64::from(node.min[i]) - self.origin[i], f64::from(node.max[i]) - self.origin[i]);
            if self.direction[i] == 0.0 {
                if min > 0.0 || max < 0.0 {
                    return false;
                }
                continue;
            }
            let (a, b) = (min / self.direction[i], max / self.direction[i]);
            let (near, far) = if a < b { (a, b) } else { (b, a) };
            low = low.max(near - 4.0 * f64::EPSILON * near.abs());
            high = high.min(far + 4.0 * f64::EPSILON * far.abs());
        }
        low <= high
    }

    /// Where it meets the plane of the triangle, if that is inside the triangle or on its edge.
    pub(super) fn hit(&self, triangle: &Triangle) -> Option<f64> {
        let [a, b, c] = triangle.map(|corner| {
            let [x, y, z] = self.axes.map(|i| f64::from(corner[i]) - self.origin[i]);
            [x - self.shear[0] * z, y - self.shear[1] * z, z]
        });
        // Twice the areas between the ray and each edge; the same edge, the other way round, gives exactly the negative.
        let edge = |p: [f64; 3], q: [f64; 3]| p[0] * q[1] - p[1] * q[0];
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let sum = u + v + w;
        (sum != 0.0).then(|| self.shear[2] * (u * a[2] + v * b[2] + w * c[2]) / sum)
    }
}
