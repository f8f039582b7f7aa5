//! Sets of ray parameters: sorted, disjoint, non-empty intervals. Shapes and their combinations along a ray are such sets.

/// Sorted disjoint intervals of `t`, each with `start < end`; the last may end at infinity.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Intervals(pub(super) Vec<(f64, f64)>);

impl Intervals {
    pub(super) fn empty() -> Self {
        Self(vec![])
    }

    /// The whole ray.
    pub(super) fn all() -> Self {
        Self(vec![(0.0, f64::INFINITY)])
    }

    /// The part of one interval that lies on the ray; nothing if it is empty or not a number.
    pub(super) fn of(start: f64, end: f64) -> Self {
        if start.is_nan() {
            return Self::empty();
        }
        let start = start.max(0.0);
        if start < end { Self(vec![(start, end)]) } else { Self::empty() }
    }

    pub(super) fn contains(&self, t: f64) -> bool {
        let after = self.0.partition_point(|i| i.0 <= t);
        after > 0 && t < self.0[after - 1].1
    }

    pub(super) fn union(&self, other: &Self) -> Self {
        let mut all: Vec<_> = self.0.iter().chain(&other.0).copied().collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut out: Vec<(f64, f64)> = vec![];
        for (start, end) in all {
            match out.last_mut() {
                Some(last) if start <= last.1 => last.1 = last.1.max(end),
                _ => out.push((start, end)),
            }
        }
        Self(out)
    }

    pub(super) fn intersection(&self, other: &Self) -> Self {
        let (mut i, mut j) = (0, 0);
        let mut out = vec![];
        while let (Some(a), Some(b)) = (self.0.get(i), other.0.get(j)) {
            let (start, end) = (a.0.max(b.0), a.1.min(b.1));
            if start < end {
                out.push((start, end));
            }
            if a.1 < b.1 { i += 1 } else { j += 1 }
        }
        Self(out)
    }

    /// The rest of the ray.
    pub(super) fn complement(&self) -> Self {
        let mut out = vec![];
        let mut start = 0.0;
        for (a, b) in &self.0 {
            if start < *a {
                out.push((start, *a));
            }
            start = *b;
        }
        if start < f64::INFINITY {
            out.push((start, f64::INFINITY));
        }
        Self(out)
    }
}

#[cfg(test)]
mod tests {
    use super::Intervals;

    #[test]
    fn algebra() {
        let a = Intervals(vec![(0.0, 2.0), (3.0, 5.0)]);
        let b = Intervals(vec![(1.0, 4.0), (7.0, f64::INFINITY)]);
        assert_eq!(a.union(&b).0, [(0.0, 5.0), (7.0, f64::INFINITY)]);
        assert_eq!(a.intersection(&b).0, [(1.0, 2.0), (3.0, 4.0)]);
        assert_eq!(b.complement().0, [(0.0, 1.0), (4.0, 7.0)]);
        assert_eq!(a.complement().complement(), a);
        assert_eq!(Intervals::all().complement(), Intervals::empty());
        assert_eq!(Intervals::of(f64::NAN, 1.0), Intervals::empty());
        assert_eq!(Intervals::of(2.0, f64::NAN), Intervals::empty());
        assert!(a.contains(0.0) && !a.contains(2.0) && a.contains(3.5) && !a.contains(6.0));
    }
}
