//! How three numbers become one value per band: in RGB mode a band is one of the three, in every other the bands say what
//! share of red, green and blue each of them has ([`crate::ir::Bands::resample`]).
//!
//! Where the three parts are one and the same number the spectrum is neutral and stays a single number, in every mode.

use super::Lowerer;
use crate::ir::{BandsKind, LUMINANCE, NodeId};

impl Lowerer<'_, '_> {
    /// `rgb(r, g, b)`
    pub(super) fn rgb(&mut self, parts: [NodeId; 3]) -> NodeId {
        if parts[0] == parts[1] && parts[1] == parts[2] {
            return parts[0];
        }
        self.colored = true;
        match self.bands.kind {
            BandsKind::Rgb => self.vector(&parts),
            BandsKind::Gray | BandsKind::List | BandsKind::Spectral => {
                let bands: Vec<NodeId> = self.shares.clone().into_iter().map(|w| self.weighted(parts, w)).collect();
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
        self.colored = true;
        match self.bands.kind {
            BandsKind::Rgb => color,
            BandsKind::Gray | BandsKind::List | BandsKind::Spectral => {
                let mut bands = vec![];
                for shares in self.shares.clone() {
                    let row = self.graph.vector(&shares);
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
