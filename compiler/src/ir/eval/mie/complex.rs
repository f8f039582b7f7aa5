//! As much of complex arithmetic as the series need.

use std::ops::{Add, Mul, Neg, Sub};

/// A complex number.
#[derive(Copy, Clone, Debug, Default, PartialEq)]
pub struct Complex {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

impl Complex {
    pub(super) const ZERO: Self = Self { re: 0.0, im: 0.0 };

    pub(super) const fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    pub(super) const fn real(re: f64) -> Self {
        Self { re, im: 0.0 }
    }

    /// |z|²
    #[must_use]
    pub fn norm(self) -> f64 {
        self.re * self.re + self.im * self.im
    }

    pub(super) fn conj(self) -> Self {
        Self { im: -self.im, ..self }
    }

    pub(super) fn scale(self, by: f64) -> Self {
        Self { re: self.re * by, im: self.im * by }
    }

    /// 1/z, by Smith's scaling, so that nothing overflows that need not; at 0, some huge number.
    pub(super) fn inverse(self) -> Self {
        let Self { re, im } = self;
        if re == 0.0 && im == 0.0 {
            return Self::real(1e300);
        }
        if re.abs() >= im.abs() {
            let ratio = im / re;
            let scale = 1.0 / (re + im * ratio);
            Self { re: scale, im: -ratio * scale }
        } else {
            let ratio = re / im;
            let scale = 1.0 / (re * ratio + im);
            Self { re: ratio * scale, im: -scale }
        }
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { re: self.re - other.re, im: self.im - other.im }
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }
}

impl Neg for Complex {
    type Output = Self;
    fn neg(self) -> Self {
        Self { re: -self.re, im: -self.im }
    }
}
