//! Scenes nobody has thought of: shapes, fields, transfer spikes, lights and cameras put together at random, extreme numbers among them.
//!
//! A scene depends on its number alone, so that a number names a failure for good.

use crate::engine::reference::Random;
use std::fmt::Write as _;

/// Scenes that stand behind each other in the list of numbers are as different as others.
const STREAM: u64 = 0x1f;

/// The text of a scene. It names no files.
#[must_use]
pub fn invent(number: u64) -> String {
    Inventor { random: Random::new(number, STREAM, 0), scale: 1.0, uses: vec![], items: String::new() }.scene()
}

struct Inventor {
    random: Random,
    /// What a scene calls 1, in metres.
    scale: f64,
    uses: Vec<&'static str>,
    /// Items before the medium at hand.
    items: String,
}

/// A field of a medium.
struct Field {
    /// A dimensionless expression that is not negative.
    text: String,
    /// About its largest value.
    most: f64,
    /// How much of a shape it fills along a ray.
    share: f64,
}

impl Inventor {
    fn unit(&mut self) -> f64 {
        self.random.unit()
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A power of ten, uniform in its exponent.
    fn power(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(self.between(low, high))
    }

    fn chance(&mut self, share: f64) -> bool {
        self.unit() < share
    }

    fn one_of(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    /// A length in a scene of this scale.
    fn length(&self, x: f64) -> String {
        format!("{:.7e} m", x * self.scale)
    }

    fn place(&self, p: [f64; 3]) -> String {
        let [x, y, z] = p.map(|v| format!("{:.7e}", v * self.scale));
        format!("({x}, {y}, {z}) m")
    }

    fn somewhere(&mut self, reach: f64) -> [f64; 3] {
        std::array::from_fn(|_| self.between(-reach, reach))
    }

    fn color(&mut self) -> String {
        if self.chance(0.4) {
            return "1".into();
        }
        let [r, g, b]: [f64; 3] = std::array::from_fn(|_| self.between(0.0, 1.0));
        format!("rgb({r:.3}, {g:.3}, {b:.3})")
    }

    fn scene(mut self) -> String {
        if self.chance(0.2) {
            self.scale = self.power(-6.0, 6.0);
        }
        let lit = self.chance(0.25);
        // Light in several media with noise takes some drivers ten seconds to compile.
        let media = if lit { 1 } else { 1 + self.one_of(8) / 5 + self.one_of(8) / 7 };
        let mut text = String::new();
        for i in 0..media {
            let medium = self.medium(i, lit);
            text += &std::mem::take(&mut self.items);
            text += &medium;
        }
        if lit {
            text += &self.light();
            if self.chance(0.2) {
                let height = -self.between(1.2, 2.0);
                let point = self.place([0.0, height, 0.0]);
                let albedo = self.unit();
                let _ = writeln!(
                    text,
                    "surface floor {{ shape = plane(point: {point}, normal: (0, 1, 0))  albedo = {albedo:.3} }}"
                );
            }
        }
        text += &self.camera();
        if self.chance(0.8) {
            let color = self.color();
            let _ = writeln!(text, "image {{ background = {} }}", if color == "1" { "#808080".into() } else { color });
        }
        if self.chance(0.3) {
            let accuracy = self.power(-3.0, -1.0);
            let _ = writeln!(text, "render {{ accuracy = {accuracy:.2e} }}");
        }
        let mut head = String::new();
        self.uses.sort_unstable();
        self.uses.dedup();
        if !self.uses.is_empty() {
            let _ = writeln!(head, "use std::noise::{{{}}}", self.uses.join(", "));
        }
        head + &text
    }

    fn medium(&mut self, number: usize, lit: bool) -> String {
        let shape = self.shape(0);
        let field = self.field(number, lit);
        // Mostly as dense as is worth looking at; now and then as no picture has it.
        let depth = if self.chance(0.15) { self.power(-30.0, 30.0) } else { self.power(-2.0, 2.0) };
        let k = depth / (self.scale * field.most * field.share);
        let mut text = format!("medium m{number} {{\n    shape = {shape}\n");
        if field.text != "1" {
            let _ = writeln!(text, "    density = {}", field.text);
        }
        let color = self.color();
        let of = |color: &str| if color == "1" { String::new() } else { format!(" * {color}") };
        if lit && self.chance(0.7) {
            let _ = writeln!(text, "    k_s = {k:.7e}{} / m", of(&color));
            let albedo = self.unit();
            let _ = writeln!(text, "    k_a = {:.7e} / m", k * (1.0 - albedo));
            if self.chance(0.6) {
                let g = [0.3, 0.8, -0.4, 0.99, 0.9999, -0.9999, 0.0][self.one_of(7)];
                let _ = writeln!(text, "    phase = henyey_greenstein(g: {g})");
            }
        } else if self.chance(0.92) {
            let _ = writeln!(text, "    k_a = {k:.7e}{} / m", of(&color));
        }
        if !lit || self.chance(0.3) {
            // Sources near display white, or far from it.
            let source = if self.chance(0.1) { self.power(-6.0, 4.0) } else { self.between(0.1, 1.5) };
            let glow = self.color();
            let _ = writeln!(text, "    k_e = {:.7e} lx{} / m", source * k.min(1e33), of(&glow));
        }
        if self.chance(0.15) {
            let angle = self.between(0.0, 90.0);
            let axis = [(1, 0, 0), (0, 1, 0), (1, 1, 1)][self.one_of(3)];
            let _ = writeln!(text, "    transform = rotate(axis: {axis:?}, angle: {angle:.3} deg)");
        }
        text + "}\n"
    }

    fn shape(&mut self, depth: u32) -> String {
        let near = self.somewhere(0.4);
        let center = self.place(near);
        let size = self.between(0.3, 1.0);
        match self.one_of(if depth < 1 { 10 } else { 6 }) {
            0 | 1 => format!("sphere(center: {center}, radius: {})", self.length(size)),
            2 => {
                let radii = std::array::from_fn(|_| self.between(0.2, 1.0));
                format!("ellipsoid(center: {center}, radii: {})", self.place(radii))
            }
            3 | 4 => {
                let thin = if self.chance(0.1) { self.power(-6.0, -1.0) } else { 1.0 };
                let half: [f64; 3] = std::array::from_fn(|i| self.between(0.2, 1.0) * if i == 1 { thin } else { 1.0 });
                let low = self.place(std::array::from_fn(|i| near[i] - half[i]));
                let high = self.place(std::array::from_fn(|i| near[i] + half[i]));
                format!("box(min: {low}, max: {high})")
            }
            5 => {
                let far = self.somewhere(1.0);
                let radius = size * 0.7;
                format!("cylinder(from: {center}, to: {}, radius: {})", self.place(far), self.length(radius))
            }
            6 => {
                let thickness = self.power(-5.0, -0.5);
                let inner = size * (1.0 - thickness);
                format!("shell(center: {center}, inner: {}, outer: {})", self.length(inner), self.length(size))
            }
            n => {
                let name = ["union", "intersection", "difference"][n - 7];
                format!("{name}({}, {})", self.shape(depth + 1), self.shape(depth + 1))
            }
        }
    }

    fn field(&mut self, number: usize, lit: bool) -> Field {
        let axis = ["x", "y", "z"][self.one_of(3)];
        let unit = self.length(1.0);
        let at = self.between(-0.5, 0.5);
        let cell = self.power(-1.0, 0.0);
        let kind = self.one_of(13);
        match if lit && (6..=7).contains(&kind) { 0 } else { kind } {
            0..=2 => Field { text: "1".into(), most: 1.0, share: 1.0 },
            3 => {
                let slope = self.between(-1.0, 1.0);
                Field { text: format!("max(0, 0.5 + {slope:.3} * p.{axis} / ({unit}))"), most: 1.0, share: 1.0 }
            }
            4 => {
                let height = self.power(-2.0, 1.0);
                let text = format!("exp(-(p.{axis} + {}) / ({}))", self.length(1.0), self.length(height));
                Field { text, most: 1.0, share: height.min(1.0) }
            }
            5 => {
                let width = self.power(-2.0, 0.0);
                let middle = self.somewhere(0.3);
                let away = format!("(p - {})", self.place(middle));
                let text = format!("exp(-dot({away}, {away}) / ({})^2)", self.length(width));
                Field { text, most: 1.0, share: width }
            }
            6 => {
                self.uses.push("fbm");
                let (octaves, cut) = (1 + self.one_of(5), self.between(-0.2, 0.6));
                let text = format!("max(0, fbm(p / ({}), octaves: {octaves}) - {cut:.3})", self.length(cell));
                Field { text, most: (0.8 - cut).max(0.1), share: 0.5 }
            }
            7 => {
                self.uses.push("worley");
                let text = format!("max(0, 0.6 - worley(p / ({})))", self.length(cell));
                Field { text, most: 0.6, share: 0.5 }
            }
            8 => {
                let width = self.power(-5.0, -1.0);
                let radius = self.between(0.2, 0.7);
                let (r, w) = (self.length(radius), self.length(width));
                let text = format!("if abs(length(p) - {r}) < {w} then 1 else 0");
                Field { text, most: 1.0, share: width }
            }
            9 => {
                let step = self.power(-12.0, 12.0);
                let text = format!("if p.{axis} < {} then 1 else {step:.3e}", self.length(at));
                Field { text, most: step.max(1.0), share: 1.0 }
            }
            10 => {
                let width = self.power(-5.0, -1.0);
                let height = self.power(0.0, 3.0);
                let _ = writeln!(
                    self.items,
                    "table t{number} {{ -2: 0.1  {at:.8}: 0.3  {:.8}: {height:.4}  {:.8}: 0.3  2: 1 }}",
                    at + width,
                    at + 2.0 * width
                );
                let bend = self.between(-1.0, 1.0);
                let text = format!("t{number}(p.{axis} / ({unit}) + {bend:.3} * p.x * p.y / ({unit})^2)");
                Field { text, most: height.max(1.0), share: width.max(1.0 / height) }
            }
            11 => {
                let waves = self.between(1.0, 20.0);
                Field { text: format!("0.5 + 0.5 * sin({waves:.3} * p.{axis} / ({unit}))"), most: 1.0, share: 0.5 }
            }
            _ => {
                let cells = self.between(1.0, 6.0);
                let text = format!("clamp(floor({cells:.3} * p.{axis} / ({unit})) + 3, 0, 6) / 6");
                Field { text, most: 1.0, share: 0.5 }
            }
        }
    }

    fn light(&mut self) -> String {
        let strength = self.between(0.5, 5.0);
        // A sky is what the reference takes longest for.
        match self.one_of(12) {
            0..=5 => {
                let [x, y, z] = self.somewhere(1.0);
                let y = -y.abs() - 0.1;
                format!("light sun {{ direction = ({x:.4}, {y:.4}, {z:.4})  irradiance = {strength:.3} lx }}\n")
            }
            6..=10 => {
                let at = self.somewhere(2.0);
                format!(
                    "light lamp {{ position = {}  intensity = {:.7e} lx * m^2  radius = {} }}\n",
                    self.place(at),
                    strength * self.scale * self.scale,
                    self.length(0.05)
                )
            }
            _ => format!("light sky {{ environment = {strength:.3} * rgb(0.3, 0.5, 0.9) * lx }}\n"),
        }
    }

    fn camera(&mut self) -> String {
        let [x, y, z] = self.somewhere(1.0);
        let size = (x * x + y * y + z * z).sqrt().max(1e-3);
        let (distance, fov) = match self.one_of(20) {
            0..=2 => (0.3, 70.0),
            3 => (1000.0, 0.15),
            _ => (self.between(3.0, 6.0), 34.0),
        };
        let from = [x, y, z].map(|v| v / size * distance);
        let to = self.somewhere(0.2);
        format!("camera {{ from = {}  to = {}  fov = {fov} deg }}\n", self.place(from), self.place(to))
    }
}

#[cfg(test)]
mod tests {
    use super::invent;
    use compiler::Options;
    use compiler::diagnostic::Severity;

    #[test]
    fn numbers_name_scenes() {
        assert_eq!(invent(7), invent(7));
        assert_ne!(invent(7), invent(8));
    }

    #[test]
    fn what_is_invented_compiles() {
        let loader = crate::frame::FileLoader::new(std::path::Path::new("."));
        for number in 0..300 {
            let text = invent(number);
            let found = compiler::compile("invented.vol", &text, &loader, &Options::default());
            let errors: Vec<_> = found.diagnostics.iter().filter(|d| d.severity == Severity::Error).collect();
            assert!(errors.is_empty(), "{number}:\n{text}\n{errors:?}");
        }
    }
}
