//! The tree of boxes around triangles: built by the surface area heuristic in bins (Wald, "On fast Construction of SAH-based
//! Bounding Volume Hierarchies", 2007), stored in depth-first order with a skip link in each node (Smits, "Efficiency Issues
//! for Ray Tracing", 1998), so that a walk through it needs neither stack nor recursion:
//!
//! ```text
//! i = 0
//! while i < nodes.len():
//!     if the ray meets box i:  test the triangles of i, if it is a leaf;  i = i + 1
//!     else:                    i = nodes[i].skip
//! ```

use super::{Mesh, Triangle};

/// Most triangles in a leaf; their number has three bits on the GPU.
pub(super) const LEAF: usize = 4;
const BINS: usize = 16;
/// Deeper than this, halves are taken instead of the best split: the depth stays below 64 + log2 n for any input.
const DEEP: u32 = 64;

/// A box and what is in it.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Node {
    /// Lower corner, in metres.
    pub min: [f32; 3],
    /// Upper corner.
    pub max: [f32; 3],
    /// The node that follows when this box is missed, or when all in it is done: the first that is not below it.
    pub skip: u32,
    /// The first triangle of a leaf.
    pub first: u32,
    /// Number of triangles of a leaf, 1 to 4; 0 for an inner node, whose first child is the next node.
    pub count: u32,
}

#[derive(Copy, Clone)]
struct Item {
    min: [f32; 3],
    max: [f32; 3],
    triangle: u32,
}

impl Item {
    fn center(&self, axis: usize) -> f64 {
        0.5 * (f64::from(self.min[axis]) + f64::from(self.max[axis]))
    }
}

#[derive(Copy, Clone)]
struct Bounds {
    min: [f32; 3],
    max: [f32; 3],
}

impl Bounds {
    const NOTHING: Self = Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    fn with(self, min: [f32; 3], max: [f32; 3]) -> Self {
        let (low, high) = (self.min, self.max);
        Self { min: std::array::from_fn(|i| low[i].min(min[i])), max: std::array::from_fn(|i| high[i].max(max[i])) }
    }

    /// Half its surface, in f64 since the square of a large f32 overflows.
    fn area(&self) -> f64 {
        let d: [f64; 3] = std::array::from_fn(|i| (f64::from(self.max[i]) - f64::from(self.min[i])).max(0.0));
        d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
    }
}

/// The box around all corners.
pub(super) fn bounds(triangles: &[Triangle]) -> ([f32; 3], [f32; 3]) {
    let all = triangles.iter().flatten().fold(Bounds::NOTHING, |b, corner| b.with(*corner, *corner));
    (all.min, all.max)
}

/// Builds the tree and puts the triangles into the order of its leaves.
pub(super) fn build(triangles: &mut Vec<Triangle>) -> Vec<Node> {
    let mut items: Vec<Item> = triangles
        .iter()
        .zip(0..)
        .map(|(t, triangle)| {
            let (min, max) = bounds(std::slice::from_ref(t));
            Item { min, max, triangle }
        })
        .collect();
    let mut nodes = Vec::with_capacity(items.len());
    split(&mut items, 0, 0, &mut nodes);
    *triangles = items.iter().map(|item| triangles[item.triangle as usize]).collect();
    nodes
}

fn split(items: &mut [Item], first: u32, depth: u32, nodes: &mut Vec<Node>) {
    let around = items.iter().fold(Bounds::NOTHING, |b, item| b.with(item.min, item.max));
    let at = nodes.len();
    nodes.push(Node { min: around.min, max: around.max, skip: 0, first: 0, count: 0 });
    match best_split(items, &around, depth) {
        None => {
            nodes[at].first = first;
            nodes[at].count = items.len() as u32;
        }
        Some(middle) => {
            let (left, right) = items.split_at_mut(middle);
            split(left, first, depth + 1, nodes);
            split(right, first + middle as u32, depth + 1, nodes);
        }
    }
    nodes[at].skip = nodes.len() as u32;
}

/// Sorts the items into two parts and says where the second starts; `None` for a leaf.
fn best_split(items: &mut [Item], around: &Bounds, depth: u32) -> Option<usize> {
    if items.len() == 1 {
        return None;
    }
    // Cost of a split relative to testing one triangle, and where it is.
    let mut best: Option<(f64, usize, usize)> = None;
    let mut ranges = [(0.0, 0.0); 3];
    for (axis, range) in ranges.iter_mut().enumerate() {
        let low = items.iter().map(|i| i.center(axis)).fold(f64::INFINITY, f64::min);
        let high = items.iter().map(|i| i.center(axis)).fold(f64::NEG_INFINITY, f64::max);
        *range = (low, high);
        if !(high > low) || depth > DEEP {
            continue;
        }
        let mut bins = [(Bounds::NOTHING, 0_usize); BINS];
        for item in &*items {
            let (bounds, count) = &mut bins[bin(item.center(axis), *range)];
            *bounds = bounds.with(item.min, item.max);
            *count += 1;
        }
        // From the right first, so that one sweep from the left knows both sides.
        let mut right = [(0.0, 0_usize); BINS];
        let (mut bounds, mut count) = (Bounds::NOTHING, 0);
        for b in (1..BINS).rev() {
            bounds = bounds.with(bins[b].0.min, bins[b].0.max);
            count += bins[b].1;
            right[b] = (bounds.area(), count);
        }
        let (mut bounds, mut count) = (Bounds::NOTHING, 0);
        for b in 1..BINS {
            bounds = bounds.with(bins[b - 1].0.min, bins[b - 1].0.max);
            count += bins[b - 1].1;
            if count == 0 || right[b].1 == 0 {
                continue;
            }
            let cost = bounds.area() * count as f64 + right[b].0 * right[b].1 as f64;
            if best.is_none_or(|(c, ..)| cost < c) {
                best = Some((cost, axis, b));
            }
        }
    }
    let area = around.area();
    let Some((cost, axis, b)) = best else {
        // All in one place, or too deep: halves along the longest axis.
        if items.len() <= LEAF {
            return None;
        }
        let extent = |axis: &usize| ranges[*axis].1 - ranges[*axis].0;
        let axis = (0..3).max_by(|a, b| extent(a).total_cmp(&extent(b))).unwrap_or(0);
        let middle = items.len() / 2;
        items.select_nth_unstable_by(middle, |a, b| a.center(axis).total_cmp(&b.center(axis)));
        return Some(middle);
    };
    // A box costs about as much as a triangle.
    if items.len() <= LEAF && area * items.len() as f64 <= area + cost {
        return None;
    }
    let mut middle = 0;
    for i in 0..items.len() {
        if bin(items[i].center(axis), ranges[axis]) < b {
            items.swap(i, middle);
            middle += 1;
        }
    }
    Some(middle)
}

fn bin(center: f64, (low, high): (f64, f64)) -> usize {
    ((BINS as f64 * (center - low) / (high - low)) as usize).min(BINS - 1)
}

impl Mesh {
    /// Tree and triangles for a GPU, lengths multiplied by `scale` (metres into the scene's unit).
    ///
    /// First each node as 8 numbers: `min.xyz`, the bits of `skip`, `max.xyz`, the bits of 0 for an inner node and of
    /// `first << 3 | count` for a leaf. Then each triangle as 9: `v0`, `v1 − v0`, `v2 − v0`. Small integers are the bits of
    /// denormal numbers, so a shader declares the buffer as `u32` and takes the bits of what it wants as `f32`.
    /// Boxes are wider than exact by a few units in the last place of their largest corner: what rounding moves out of them
    /// stays in.
    #[must_use]
    pub fn pack(&self, scale: f64) -> Vec<f32> {
        let scaled = |corner: [f32; 3]| corner.map(|x| (f64::from(x) * scale) as f32);
        let mut words = Vec::with_capacity(8 * self.nodes.len() + 9 * self.triangles.len());
        for node in &self.nodes {
            let (min, max) = (scaled(node.min), scaled(node.max));
            let largest = min.iter().chain(&max).fold(0.0_f32, |m, x| m.max(x.abs()));
            let room = 4.0 * f32::EPSILON * largest;
            let leaf = if node.count == 0 { 0 } else { node.first << 3 | node.count };
            words.extend(min.map(|x| x - room));
            words.push(f32::from_bits(node.skip));
            words.extend(max.map(|x| x + room));
            words.push(f32::from_bits(leaf));
        }
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|corner| corner.map(|x| f64::from(x) * scale));
            words.extend(a.map(|x| x as f32));
            words.extend((0..3).map(|i| (b[i] - a[i]) as f32));
            words.extend((0..3).map(|i| (c[i] - a[i]) as f32));
        }
        words
    }
}
