//! How a picture is cut into dispatches: each short enough for watchdogs, by what the ones before took.

use super::uniforms::Part;

/// Seconds that one dispatch should take.
const TARGET: f64 = 0.1;
/// Field evaluations that the first dispatch may take: short even in software.
const FIRST: u64 = 1 << 21;

/// How many invocations the next dispatch gets.
#[derive(Clone, Debug)]
pub(super) struct Pace {
    budget: f64,
    most: u64,
    /// Whether nothing is learnt: what takes long is cut otherwise.
    steady: bool,
}

impl Pace {
    /// `most` is what a buffer holds. No dispatch gets more than a sixteenth of the whole, since the beginning of a
    /// picture says little about its middle.
    pub(super) fn new(work_per_ray: u32, total: u64, most: u64) -> Self {
        let most = most.min((total / 16).max(4096)).max(1);
        let first = FIRST / u64::from(work_per_ray.max(1));
        Self { budget: first.clamp(64, 16384) as f64, most, steady: false }
    }

    /// Always as many as a buffer holds: for what is drawn in parts of its geometry, where a smaller tile costs as much.
    pub(super) fn steady(total: u64, most: u64) -> Self {
        let most = most.min(total).max(1);
        Self { budget: most as f64, most, steady: true }
    }

    /// Invocations of the largest dispatch there can be.
    pub(super) fn most(&self) -> u64 {
        self.most
    }

    /// Invocations of the next one.
    pub(super) fn budget(&self) -> u64 {
        (self.budget as u64).clamp(1, self.most)
    }

    /// Learns from one that took `seconds`.
    pub(super) fn took(&mut self, invocations: u64, seconds: f64) {
        if self.steady {
            return;
        }
        let ideal = invocations as f64 * TARGET / seconds.max(1e-6);
        self.budget = ideal.clamp(64.0, 2.0 * self.budget).min(self.most as f64);
    }
}

/// Covers a picture with tiles, row of tiles by row of tiles, whatever sizes are asked for.
#[derive(Clone, Debug)]
pub(super) struct Walk {
    size: [u32; 2],
    group: [u32; 2],
    at: [u32; 2],
    height: u32,
    /// Most pixels on each axis.
    largest: [u32; 2],
}

impl Walk {
    /// Over `size` pixels with workgroups of `group`.
    pub(super) fn new(size: [u32; 2], group: [u32; 2]) -> Self {
        let at = if size.contains(&0) { [0, size[1]] } else { [0, 0] };
        let group = group.map(|g| g.max(1));
        Self { size, group, at, height: 0, largest: group.map(|g| 65535u32.saturating_mul(g)) }
    }

    /// No tile larger than this on any axis.
    pub(super) fn within(mut self, largest: u32) -> Self {
        self.largest = self.largest.map(|n| n.min(largest));
        self
    }

    /// The next tile, of about `budget` pixels and no more unless that is less than one pixel in each row of the band.
    pub(super) fn next(&mut self, budget: u64) -> Option<Part> {
        let [width, height] = self.size;
        let [x, y] = self.at;
        if y >= height {
            return None;
        }
        let whole = |n: u64, group: u32, rest: u32| -> u32 {
            let n = n.clamp(1, u64::from(rest)) as u32;
            // Full workgroups, unless the budget is smaller than one.
            if n > group { n - n % group } else { n }
        };
        if x == 0 {
            let rows = budget / u64::from(width);
            self.height = whole(rows.max(u64::from(self.group[1]).min(budget)), self.group[1], height - y);
            self.height = self.height.min(self.largest[1]);
        }
        let most = width.min(self.largest[0]);
        let columns = whole(budget / u64::from(self.height), self.group[0], (width - x).min(most));
        let part = Part { origin: self.at, size: [columns, self.height], rays: columns, ..Part::default() };
        self.at[0] += columns;
        if self.at[0] >= width {
            self.at = [0, y + self.height];
        }
        Some(part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cover(size: [u32; 2], group: [u32; 2], budgets: &[u64]) {
        let mut seen = vec![0u8; size[0] as usize * size[1] as usize];
        let mut walk = Walk::new(size, group);
        let mut budgets = budgets.iter().cycle();
        let mut band = 0;
        loop {
            let budget = *budgets.next().expect("cycles");
            let Some(part) = walk.next(budget) else { break };
            let [w, h] = part.size;
            if part.origin[0] == 0 {
                band = h;
            }
            let area = u64::from(w) * u64::from(h);
            assert!(area > 0 && (area <= budget || w == 1), "{part:?} for {budget}");
            assert_eq!(h, band, "one height in a band");
            for y in part.origin[1]..part.origin[1] + h {
                for x in part.origin[0]..part.origin[0] + w {
                    seen[(y * size[0] + x) as usize] += 1;
                }
            }
        }
        assert!(seen.iter().all(|n| *n == 1), "each pixel once: {size:?}");
    }

    #[test]
    fn tiles_cover_every_pixel_once() {
        for size in [[1, 1], [0, 5], [5, 0], [7, 3], [640, 48], [1, 1000], [16384, 1], [129, 65]] {
            for budgets in [&[1u64][..], &[64], &[100, 7, 5000], &[1 << 20], &[4096, 8192, 64]] {
                cover(size, [8, 8], budgets);
                cover(size, [64, 1], budgets);
            }
        }
    }

    #[test]
    fn pace_follows_what_is_measured() {
        let mut pace = Pace::new(1000, 1 << 20, 1 << 20);
        let first = pace.budget();
        assert!((64..=16384).contains(&first));
        pace.took(first, 0.001);
        assert_eq!(pace.budget(), 2 * first, "grows by two at most");
        pace.took(2 * first, 1.0);
        assert_eq!(pace.budget(), first / 5, "shrinks at once");
        for _ in 0..40 {
            pace.took(pace.budget(), 1e-5);
        }
        assert_eq!(pace.budget(), (1 << 20) / 16, "never more than a sixteenth");
    }
}
