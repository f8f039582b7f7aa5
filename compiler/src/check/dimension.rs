//! Arithmetic of dimensions, and how they are written.

use super::hir::Dim;
use std::fmt;

/// Twelfths in one whole power.
const WHOLE: i16 = 12;

impl Dim {
    /// A plain number.
    pub const NONE: Self = Self { length: 0, time: 0, light: 0, pixel: 0 };
    /// Metres.
    pub const LENGTH: Self = Self { length: WHOLE, ..Self::NONE };
    /// Square metres.
    pub const AREA: Self = Self { length: 2 * WHOLE, ..Self::NONE };
    /// Cubic metres.
    pub const VOLUME: Self = Self { length: 3 * WHOLE, ..Self::NONE };
    /// Seconds.
    pub const TIME: Self = Self { time: WHOLE, ..Self::NONE };
    /// `lx`.
    pub const LIGHT: Self = Self { light: WHOLE, ..Self::NONE };
    /// Pixels.
    pub const PIXEL: Self = Self { pixel: WHOLE, ..Self::NONE };
    /// Of a coefficient of absorption or scattering.
    pub const COEFFICIENT: Self = Self { length: -WHOLE, ..Self::NONE };
    /// Of a coefficient of emission.
    pub const EMISSION: Self = Self { light: WHOLE, length: -WHOLE, ..Self::NONE };
    /// Of the intensity of a point light.
    pub const INTENSITY: Self = Self { light: WHOLE, length: 2 * WHOLE, ..Self::NONE };

    /// Whether it is that of a plain number.
    #[must_use]
    pub fn is_none(self) -> bool {
        self == Self::NONE
    }

    /// Exponents of length, time, light and pixel.
    #[must_use]
    pub fn exponents(self) -> [f64; 4] {
        self.parts().map(|(_, _, e)| f64::from(e) / f64::from(WHOLE))
    }

    /// The dimension of a product; `None` beyond any physics.
    #[must_use]
    pub fn times(self, other: Self) -> Option<Self> {
        self.zip(other, i16::checked_add)
    }

    /// The dimension of a quotient; `None` beyond any physics.
    #[must_use]
    pub fn over(self, other: Self) -> Option<Self> {
        self.zip(other, i16::checked_sub)
    }

    /// The dimension of a power; `None` where it is no multiple of a twelfth, or beyond any physics.
    #[must_use]
    pub fn power(self, exponent: f64) -> Option<Self> {
        let scale = |e: i16| {
            let exact = f64::from(e) * exponent;
            let whole = exact.round();
            // 12 · (1/3) is 4 only up to rounding.
            let near = (exact - whole).abs() <= 1e-9 * exact.abs().max(1.0);
            (near && whole.abs() <= f64::from(i16::MAX)).then_some(whole as i16)
        };
        Some(Self {
            length: scale(self.length)?,
            time: scale(self.time)?,
            light: scale(self.light)?,
            pixel: scale(self.pixel)?,
        })
    }

    fn zip(self, other: Self, f: fn(i16, i16) -> Option<i16>) -> Option<Self> {
        Some(Self {
            length: f(self.length, other.length)?,
            time: f(self.time, other.time)?,
            light: f(self.light, other.light)?,
            pixel: f(self.pixel, other.pixel)?,
        })
    }

    /// Name, unit and exponent in twelfths; light first, since `light/length` reads better than `1/length*light`.
    fn parts(self) -> [(&'static str, &'static str, i16); 4] {
        [
            ("length", "m", self.length),
            ("time", "s", self.time),
            ("light", "lx", self.light),
            ("pixel", "px", self.pixel),
        ]
    }

    fn written(self, unit: bool, one: &str, slash: &str) -> String {
        let [length, time, light, pixel] = self.parts();
        let ordered = [light, length, time, pixel];
        let power = |(name, short, e): (&str, &str, i16)| {
            let name = if unit { short } else { name };
            match (e.abs(), e.abs() % WHOLE) {
                (WHOLE, _) => name.to_owned(),
                (e, 0) => format!("{name}^{}", e / WHOLE),
                (e, _) => {
                    let common = gcd(e, WHOLE);
                    format!("{name}^({}/{})", e / common, WHOLE / common)
                }
            }
        };
        let above: Vec<String> = ordered.into_iter().filter(|p| p.2 > 0).map(power).collect();
        let below: Vec<String> = ordered.into_iter().filter(|p| p.2 < 0).map(power).collect();
        let mut out = if above.is_empty() { one.to_owned() } else { above.join(if unit { " * " } else { "*" }) };
        for part in below {
            out.push_str(slash);
            out.push_str(&part);
        }
        out
    }

    /// What is written after a number to give it this dimension: `m`, `/m`, `lx / m`; empty for none.
    #[must_use]
    pub fn unit(self) -> String {
        let has_above = self.parts().iter().any(|p| p.2 > 0);
        self.written(true, "", if has_above { " / " } else { "/" })
    }
}

fn gcd(a: i16, b: i16) -> i16 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// As it is written in a type: `number`, `1/length`, `light/length`.
impl fmt::Display for Dim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_none() { f.write_str("number") } else { f.write_str(&self.written(false, "1", "/")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dimensions_are_written_as_in_the_language() {
        assert_eq!(Dim::NONE.to_string(), "number");
        assert_eq!(Dim::EMISSION.to_string(), "light/length");
        assert_eq!(Dim::COEFFICIENT.to_string(), "1/length");
        assert_eq!(Dim::INTENSITY.to_string(), "light*length^2");
        assert_eq!(Dim::LENGTH.power(0.5).unwrap().to_string(), "length^(1/2)");
        assert_eq!(Dim::COEFFICIENT.unit(), "/m");
        assert_eq!(Dim::EMISSION.unit(), "lx / m");
    }

    #[test]
    fn roots_are_exact() {
        let third = Dim::LENGTH.power(1.0 / 3.0).unwrap();
        assert_eq!(third.power(3.0), Some(Dim::LENGTH));
        assert_eq!(Dim::LENGTH.power(0.3), None);
        assert_eq!(Dim::LENGTH.power(1e9), None);
    }
}
