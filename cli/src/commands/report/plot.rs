//! Plots on log-log axes as SVG. Colours are classes, so that one style sheet serves light and dark.

use std::fmt::Write;

/// Colours, light and dark.
pub(super) const STYLE: &str = include_str!("plot.css");

const WIDTH: f64 = 680.0;
const HEIGHT: f64 = 420.0;
/// Room for labels: left, right, top, bottom.
const ROOM: [f64; 4] = [78.0, 16.0, 14.0, 52.0];

/// A level so many decades beyond all points is not shown.
const NEAR: i32 = 2;

/// How a point looks; shape and colour both tell series apart.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
}

/// One point.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) x: f64,
    pub(super) y: f64,
    /// Shown by the pointer.
    pub(super) title: String,
    /// Whether a ring is drawn around it.
    pub(super) ring: bool,
}

/// Points that belong together.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    pub(super) points: Vec<Point>,
    /// Number of its colour.
    pub(super) colour: usize,
    pub(super) marker: Marker,
    /// Whether neighbours are joined.
    pub(super) joined: bool,
    /// Drawn thinner and without markers.
    pub(super) faint: bool,
}

/// A line without points of its own.
#[derive(Clone, Debug)]
pub(super) struct Guide {
    pub(super) points: Vec<(f64, f64)>,
    pub(super) class: &'static str,
    pub(super) label: String,
}

/// A plot with both axes logarithmic.
#[derive(Clone, Debug)]
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) x: String,
    pub(super) y: String,
    pub(super) curves: Vec<Curve>,
    pub(super) guides: Vec<Guide>,
    /// Lines across the whole plot: heights and what they are.
    pub(super) levels: Vec<(f64, String)>,
    /// What the line is along which both axes are equal, if it is drawn.
    pub(super) diagonal: Option<&'static str>,
}

/// A logarithmic axis from one power of ten to another.
#[derive(Copy, Clone, Debug, PartialEq)]
struct Axis {
    low: i32,
    high: i32,
}

impl Axis {
    fn over(values: impl Iterator<Item = f64>) -> Self {
        let logs = values.filter(|v| *v > 0.0 && v.is_finite()).map(f64::log10);
        let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return Self { low: -1, high: 1 };
        }
        let low_decade = low.floor() as i32;
        Self { low: low_decade, high: (high.ceil() as i32).max(low_decade + 1) }
    }

    /// Longer by what is not far from its ends; the rest would leave no room for the points.
    fn with(self, values: impl Iterator<Item = f64>) -> Self {
        let near = values.filter(|v| *v > 0.0 && v.is_finite()).map(f64::log10);
        let near = near.filter(|v| *v > f64::from(self.low - NEAR) && *v < f64::from(self.high + NEAR));
        near.fold(self, |axis, v| Self { low: axis.low.min(v.floor() as i32), high: axis.high.max(v.ceil() as i32) })
    }

    fn holds(self, value: f64) -> bool {
        value > 0.0 && (f64::from(self.low)..=f64::from(self.high)).contains(&value.log10())
    }

    /// 0 … 1 along the axis; what lies below it, zero among that, is at its start.
    fn place(self, value: f64) -> f64 {
        let log = value.max(f64::MIN_POSITIVE).log10();
        ((log - f64::from(self.low)) / f64::from(self.high - self.low)).clamp(0.0, 1.0)
    }

    /// Labelled powers, no more than fit.
    fn ticks(self) -> impl Iterator<Item = i32> {
        let step = ((self.high - self.low) / 10 + 1).max(1);
        (self.low..=self.high).filter(move |n| (n - self.low) % step == 0)
    }
}

fn x_of(axis: Axis, value: f64) -> f64 {
    ROOM[0] + axis.place(value) * (WIDTH - ROOM[0] - ROOM[1])
}

fn y_of(axis: Axis, value: f64) -> f64 {
    HEIGHT - ROOM[3] - axis.place(value) * (HEIGHT - ROOM[2] - ROOM[3])
}

/// 10 to a power, as people write it.
fn power(n: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    match n {
        0 => "1".into(),
        1 => "10".into(),
        2 => "100".into(),
        3 => "1000".into(),
        -1 => "0.1".into(),
        _ => {
            let digits = n.abs().to_string();
            let digits: String = digits.bytes().map(|d| DIGITS[usize::from(d - b'0')]).collect();
            format!("10{}{digits}", if n < 0 { "⁻" } else { "" })
        }
    }
}

/// Text for markup.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// What a curve is.
#[derive(Clone, Debug)]
pub(super) struct Key {
    pub(super) colour: usize,
    pub(super) marker: Marker,
    pub(super) text: String,
}

/// Height of a line of keys.
const LINE: f64 = 20.0;

impl Plot {
    /// As a file of its own, with its keys below.
    pub(super) fn file(&self, keys: &[Key]) -> String {
        let height = HEIGHT + 10.0 + LINE * (keys.len() + 1).div_ceil(2) as f64;
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{}\">\n\
             <style>\n{STYLE}.paper {{ fill: var(--paper); }}\n</style>\n<rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n",
            escaped(&self.title)
        );
        self.content(&mut out);
        let place = |i: usize| {
            let (column, line) = ((i % 2) as f64, (i / 2) as f64);
            (20.0 + (WIDTH / 2.0 - 10.0) * column, HEIGHT + 10.0 + LINE * line)
        };
        for (i, key) in keys.iter().enumerate() {
            let (x, y) = place(i);
            let _ = writeln!(
                out,
                "<g class=\"mark s{}\">{}</g><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                key.colour,
                marker(key.marker, x, y),
                x + 12.0,
                y + 4.0,
                escaped(&key.text)
            );
        }
        let (x, y) = place(keys.len());
        let _ = writeln!(
            out,
            "<circle class=\"ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6\"/><text x=\"{:.1}\" y=\"{:.1}\">as the scene says</text>",
            x + 12.0,
            y + 4.0
        );
        out + "</svg>\n"
    }

    pub(super) fn svg(&self) -> String {
        let mut out =
            format!("<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">\n", escaped(&self.title));
        self.content(&mut out);
        out + "</svg>\n"
    }

    fn content(&self, out: &mut String) {
        let own = || self.curves.iter().flat_map(|c| &c.points);
        let mut x = Axis::over(own().map(|p| p.x));
        let mut y = Axis::over(own().map(|p| p.y)).with(self.levels.iter().map(|l| l.0));
        if self.diagonal.is_some() {
            // On equal axes, so that the distance from the diagonal is seen.
            y = Axis { low: x.low.min(y.low), high: x.high.max(y.high) };
            x = y;
        }
        self.axes(out, x, y);
        let (left, right) = (ROOM[0], WIDTH - ROOM[1]);
        for (height, label) in self.levels.iter().filter(|l| y.holds(l.0)) {
            let at = y_of(y, *height);
            let _ = writeln!(
                out,
                "<line class=\"level\" x1=\"{left}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
                 <text class=\"note\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                right - 4.0,
                at - 4.0,
                escaped(label)
            );
        }
        for guide in &self.guides {
            let inside = |p: &&(f64, f64)| p.0 > 0.0 && p.1 > 0.0;
            let points: Vec<String> = guide
                .points
                .iter()
                .filter(inside)
                .map(|p| format!("{:.1},{:.1}", x_of(x, p.0), y_of(y, p.1)))
                .collect();
            let _ = writeln!(
                out,
                "<polyline class=\"{}\" points=\"{}\"><title>{}</title></polyline>",
                guide.class,
                points.join(" "),
                escaped(&guide.label)
            );
        }
        if let Some(label) = self.diagonal {
            let ends = [x.low.max(y.low), x.high.min(y.high)].map(|n| 10f64.powi(n));
            let [x1, x2] = ends.map(|v| x_of(x, v));
            let [y1, y2] = ends.map(|v| y_of(y, v));
            let _ = writeln!(
                out,
                "<line class=\"theory\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"><title>{}</title></line>",
                escaped(label)
            );
        }
        for curve in &self.curves {
            curve.write(out, x, y);
        }
    }

    fn axes(&self, out: &mut String, x: Axis, y: Axis) {
        let (left, right, top, bottom) = (ROOM[0], WIDTH - ROOM[1], ROOM[2], HEIGHT - ROOM[3]);
        for n in x.low..x.high {
            for part in 2..10 {
                let at = x_of(x, f64::from(part) * 10f64.powi(n));
                let _ =
                    writeln!(out, "<line class=\"minor\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{top}\" y2=\"{bottom}\"/>");
            }
        }
        for n in x.ticks() {
            let at = x_of(x, 10f64.powi(n));
            let _ = writeln!(
                out,
                "<line class=\"grid\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{top}\" y2=\"{bottom}\"/>\
                 <text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                bottom + 18.0,
                power(n)
            );
        }
        for n in y.ticks() {
            let at = y_of(y, 10f64.powi(n));
            let _ = writeln!(
                out,
                "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left - 8.0,
                at + 4.0,
                power(n)
            );
        }
        let middle = (top + bottom) / 2.0;
        let _ = writeln!(
            out,
            "<text class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text class=\"axis\" transform=\"translate(18 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            (left + right) / 2.0,
            HEIGHT - 10.0,
            escaped(&self.x),
            escaped(&self.y)
        );
    }
}

impl Curve {
    fn write(&self, out: &mut String, x: Axis, y: Axis) {
        let drawn = || self.points.iter().filter(|p| p.x > 0.0 && p.x.is_finite() && !p.y.is_nan());
        if self.joined {
            let points: Vec<String> = drawn().map(|p| format!("{:.1},{:.1}", x_of(x, p.x), y_of(y, p.y))).collect();
            let class = if self.faint { "faint" } else { "curve" };
            let _ = writeln!(out, "<polyline class=\"{class} s{}\" points=\"{}\"/>", self.colour, points.join(" "));
        }
        if self.faint {
            return;
        }
        for point in drawn() {
            let (px, py) = (x_of(x, point.x), y_of(y, point.y));
            if point.ring {
                let _ = writeln!(out, "<circle class=\"ring\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"9\"/>");
            }
            let mark = marker(self.marker, px, py);
            let _ =
                writeln!(out, "<g class=\"mark s{}\">{mark}<title>{}</title></g>", self.colour, escaped(&point.title));
        }
    }
}

/// The outline of a marker around a place.
pub(super) fn marker(marker: Marker, x: f64, y: f64) -> String {
    match marker {
        Marker::Circle => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\"/>"),
        Marker::Square => format!("<rect x=\"{:.1}\" y=\"{:.1}\" width=\"8\" height=\"8\"/>", x - 4.0, y - 4.0),
        Marker::Diamond => {
            let (left, right, top, bottom) = (x - 5.5, x + 5.5, y - 5.5, y + 5.5);
            format!("<path d=\"M{left:.1} {y:.1}L{x:.1} {top:.1}L{right:.1} {y:.1}L{x:.1} {bottom:.1}Z\"/>")
        }
        Marker::Triangle => {
            let (left, right, top, bottom) = (x - 5.0, x + 5.0, y - 5.5, y + 4.0);
            format!("<path d=\"M{left:.1} {bottom:.1}H{right:.1}L{x:.1} {top:.1}Z\"/>")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Axis, escaped, power};

    #[test]
    fn axes_reach_over_whole_decades() {
        let axis = Axis::over([3e-4, 0.0, f64::INFINITY, 20.0].into_iter());
        assert_eq!(axis, Axis { low: -4, high: 2 });
        assert_eq!((axis.place(1e-4), axis.place(100.0), axis.place(0.0)), (0.0, 1.0, 0.0));
        assert!((axis.place(0.1) - 0.5).abs() < 1e-12);
        assert_eq!(Axis::over([1.0].into_iter()), Axis { low: 0, high: 1 });
        assert_eq!(Axis::over(std::iter::empty()), Axis { low: -1, high: 1 });
    }

    #[test]
    fn levels_far_from_all_points_do_not_squeeze_them() {
        let axis = Axis { low: -4, high: 2 };
        assert_eq!(axis.with([3e-6, 5.0, 0.0, f64::INFINITY].into_iter()), Axis { low: -6, high: 2 });
        assert_eq!(axis.with([1e-15, 1e9].into_iter()), axis);
        assert!(axis.holds(1e-4) && axis.holds(100.0) && !axis.holds(1e-15) && !axis.holds(0.0));
    }

    #[test]
    fn powers_and_markup() {
        assert_eq!([-12, -1, 0, 3, 5].map(power), ["10⁻¹²", "0.1", "1", "1000", "10⁵"]);
        assert_eq!(escaped("a<b & \"c\""), "a&lt;b &amp; &quot;c&quot;");
    }
}
