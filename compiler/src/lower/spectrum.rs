//! How three numbers become one value per band.
//!
//! - In RGB mode a band is one of the three.
//! - In grey mode the one band is their luminance (Rec. 709 / sRGB primaries).
//! - In a list of wavelengths each band mixes the three by weights that sum to 1: red from 680 nm up, blue from 440 nm
//!   down, green at 550 nm, and a smoothstep between neighbours. So a list of just these three wavelengths gives the
//!   same values as RGB mode, and equal parts give the same value in every band.
//!
//! Where the three parts are one and the same number the spectrum is neutral and stays a single number, in every mode.

use super::Lowerer;
use crate::ir::{BandsKind, NodeId};

/// Luminance of linear sRGB.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// Wavelengths at which red, green and blue stand alone, in metres.
const PRIMARIES: [f64; 3] = [680e-9, 550e-9, 440e-9];

/// The weights of red, green and blue at a wavelength in metres.
pub(super) fn weights(wavelength: f64) -> [f64; 3] {
    let [red, green, blue] = PRIMARIES;
    let rise = |from: f64, to: f64| {
        let t = ((wavelength - from) / (to - from)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    if wavelength <= green {
        let g = rise(blue, green);
        [0.0, g, 1.0 - g]
    } else {
        let r = rise(green, red);
        [r, 1.0 - r, 0.0]
    }
}

impl Lowerer<'_, '_> {
    /// `rgb(r, g, b)`
    pub(super) fn rgb(&mut self, parts: [NodeId; 3]) -> NodeId {
        if parts[0] == parts[1] && parts[1] == parts[2] {
            return parts[0];
        }
        match self.bands.kind {
            BandsKind::Rgb => self.vector(&parts),
            BandsKind::Gray => self.weighted(parts, LUMINANCE),
            BandsKind::List => {
                let bands: Vec<NodeId> =
                    self.bands.wavelengths.clone().into_iter().map(|w| self.weighted(parts, weights(w))).collect();
                self.vector(&bands)
            }
        }
    }

    /// A colour as a spectrum.
    pub(super) fn color_to_spectrum(&mut self, color: NodeId) -> NodeId {
        if self.graph.width(color) == 1 {
            return color;
        }
        if let Some(grey) = self.graph.number(color) {
            return self.graph.scalar(grey);
        }
        match self.bands.kind {
            BandsKind::Rgb => color,
            BandsKind::Gray => self.luminance(color),
            BandsKind::List => {
                let mut bands = vec![];
                for wavelength in self.bands.wavelengths.clone() {
                    let row = self.graph.vector(&weights(wavelength));
                    bands.push(self.graph.dot(color, row));
                }
                self.vector(&bands)
            }
        }
    }

    pub(super) fn luminance(&mut self, color: NodeId) -> NodeId {
        let row = self.graph.vector(&LUMINANCE);
        self.graph.dot(color, row)
    }

    /// The sum of the parts by weight; parts without weight are left out.
    fn weighted(&mut self, parts: [NodeId; 3], weights: [f64; 3]) -> NodeId {
        let mut sum = None;
        for (part, weight) in parts.into_iter().zip(weights) {
            if weight == 0.0 {
                continue;
            }
            let term = if weight == 1.0 {
                part
            } else {
                let weight = self.graph.scalar(weight);
                self.graph.mul(part, weight)
            };
            sum = Some(sum.map_or(term, |sum| self.graph.add(sum, term)));
        }
        sum.unwrap_or_else(|| self.graph.scalar(0.0))
    }
}
