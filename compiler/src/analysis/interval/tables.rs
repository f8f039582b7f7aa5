//! What tables can give over a range of keys: min–max pyramids over their rows.

use super::number::Interval;
use super::tape::{Enclosure, Region};
use super::{NoExtremes, binary};
use crate::ir::{Binary, Graph, NodeId, TableId};

/// Least and greatest of any run of a list of numbers: blocks of 2, 4, 8, … of them.
#[derive(Clone, Debug, Default)]
struct Runs(Vec<Vec<(f64, f64)>>);

impl Runs {
    fn new(numbers: &[f64]) -> Self {
        let mut levels = vec![numbers.iter().map(|v| (*v, *v)).collect::<Vec<_>>()];
        while let Some(below) = levels.last().filter(|l| l.len() > 1) {
            let above = below
                .chunks(2)
                .map(|c| c.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |m, v| (m.0.min(v.0), m.1.max(v.1))))
                .collect();
            levels.push(above);
        }
        Self(levels)
    }

    /// Of the numbers from `first` up to `end`; nothing where there are none.
    fn of(&self, mut first: usize, mut end: usize) -> Option<Interval> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut take = |v: (f64, f64)| (low, high) = (low.min(v.0), high.max(v.1));
        for level in &self.0 {
            if first >= end {
                break;
            }
            if first % 2 == 1 {
                take(level[first]);
                first += 1;
            }
            if end % 2 == 1 && end > first {
                take(level[end - 1]);
                end -= 1;
            }
            (first, end) = (first / 2, end / 2);
        }
        (low <= high).then(|| Interval::new(low, high))
    }
}

/// One table whose rows are known numbers.
#[derive(Clone, Debug)]
struct Known {
    keys: Vec<f64>,
    /// By component: the values and their runs, the slopes between rows likewise (one fewer; 0 at jumps).
    values: Vec<(Vec<f64>, Runs)>,
    slopes: Vec<Runs>,
}

#[derive(Clone, Debug)]
enum Bounds {
    Known(Known),
    /// Keys or values move with parameters: all rows together, by component.
    Moving(Vec<Interval>),
}

/// The tables of a graph for a range of parameters and times.
#[derive(Clone, Debug, Default)]
pub struct TableBounds(Vec<Bounds>);

impl TableBounds {
    /// Of a graph without tables.
    pub const NONE: Self = Self(Vec::new());

    /// Evaluates the entries of every table in order: an entry may read earlier tables.
    #[must_use]
    pub fn new(graph: &Graph, params: &[Vec<Interval>], time: Interval) -> Self {
        let mut tables = Self::default();
        for table in &graph.tables {
            let flat = |nodes: &[NodeId]| -> Vec<Interval> {
                let code = Enclosure::new(graph, nodes);
                let mut work = code.workspace();
                code.run(&Region { params, time, tables: &tables, ..Region::default() }, &NoExtremes, &mut work);
                (0..nodes.len()).flat_map(|i| code.root(&work, i)).collect()
            };
            let width = table.width as usize;
            let (keys, values) = (flat(&table.keys), flat(&table.values));
            let exact = |list: &[Interval]| list.iter().map(|i| i.exact()).collect::<Option<Vec<f64>>>();
            // What is exact but for the rounding of a constant expression counts as moving too.
            let known = exact(&keys).zip(exact(&values)).filter(|(k, _)| k.is_sorted());
            tables.0.push(match known {
                Some((keys, flat)) => {
                    let column = |c: usize| flat.iter().skip(c).step_by(width).copied().collect::<Vec<f64>>();
                    let values: Vec<_> = (0..width).map(|c| (column(c), Runs::new(&column(c)))).collect();
                    let slopes = values.iter().map(|(v, _)| Runs::new(&slopes(&keys, v))).collect();
                    Bounds::Known(Known { keys, values, slopes })
                }
                None => Bounds::Moving(
                    (0..width)
                        .map(|c| {
                            let column = values.iter().skip(c).step_by(width).copied();
                            column.reduce(Interval::hull).unwrap_or(Interval::ANY)
                        })
                        .collect(),
                ),
            });
        }
        tables
    }

    /// Component `c` of a table between two keys.
    #[must_use]
    pub fn value(&self, table: TableId, at: Interval, c: usize) -> Interval {
        let own = match &self.0[table.0 as usize] {
            Bounds::Moving(all) => all[c],
            Bounds::Known(known) => known.value(at, c),
        };
        Interval { nan: own.nan || at.nan, ..own }
    }

    /// Component `c` of the slope of a table between two keys.
    #[must_use]
    pub fn slope(&self, table: TableId, at: Interval, c: usize) -> Interval {
        match &self.0[table.0 as usize] {
            Bounds::Moving(_) => Interval::ANY,
            Bounds::Known(known) => {
                let own = known.slope(at, c);
                Interval { nan: own.nan || at.nan, ..own }
            }
        }
    }
}

/// Slopes between rows. Between equal keys there is none; 0 stands there, which lies beside any other by continuity of hulls.
fn slopes(keys: &[f64], values: &[f64]) -> Vec<f64> {
    let rows = keys.windows(2).zip(values.windows(2));
    rows.map(|(k, v)| if k[0] == k[1] { 0.0 } else { (v[1] - v[0]) / (k[1] - k[0]) }).collect()
}

impl Known {
    /// The value at a key, in an interval that allows for rounding.
    fn at(&self, x: f64, c: usize) -> Interval {
        let values = &self.values[c].0;
        let after = self.keys.partition_point(|k| *k <= x);
        if after == 0 {
            return Interval::point(values[0]);
        }
        if after == self.keys.len() {
            return Interval::point(values[after - 1]);
        }
        let (k, v) = ([self.keys[after - 1], self.keys[after]], [values[after - 1], values[after]]);
        if v[0] == v[1] {
            return Interval::point(v[0]);
        }
        let [k0, k1, v0, v1, x] = [k[0], k[1], v[0], v[1], x].map(Interval::point);
        let share = binary(Binary::Div, binary(Binary::Sub, x, k0), binary(Binary::Sub, k1, k0));
        let rise = binary(Binary::Mul, binary(Binary::Sub, v1, v0), share);
        // The sum may round beyond the rows; the value between them does not.
        binary(Binary::Add, v0, rise)
    }

    fn value(&self, at: Interval, c: usize) -> Interval {
        let ends = self.at(at.low, c).hull(self.at(at.high, c));
        // Every row within; the one before a jump at the lower end belongs to what lies below.
        let first = self.keys.partition_point(|k| *k <= at.low);
        let end = self.keys.partition_point(|k| *k <= at.high);
        match self.values[c].1.of(first, end) {
            Some(rows) => ends.hull(rows),
            None => ends,
        }
    }

    fn slope(&self, at: Interval, c: usize) -> Interval {
        let n = self.keys.len();
        let (a, b) = (self.keys.partition_point(|k| *k <= at.low), self.keys.partition_point(|k| *k <= at.high));
        // Segment i lies between rows i and i + 1; 0 beyond the ends.
        let beyond = (a == 0 || b == n).then(|| Interval::point(0.0));
        let inner = self.slopes[c].of(a.max(1) - 1, b.min(n - 1));
        let own = match (beyond, inner) {
            (Some(x), Some(y)) => x.hull(y),
            (Some(x), None) | (None, Some(x)) => x,
            (None, None) => Interval::point(0.0),
        };
        let room = 4.0 * f64::EPSILON * own.magnitude();
        Interval { low: own.low - room, high: own.high + room, nan: own.nan }
    }
}
