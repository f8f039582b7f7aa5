//! What is blended into which target: light over what lies behind it, and sums.

use super::shapes::FAR;
use super::slab::{Part, Pieces};
use crate::fields::{Code, KernelBuilder};
use crate::program::kernel::{Carries, Expr, LocalId, Math, Prim, Ty};
use crate::program::{Blend, FrameValue, OutputKind, Precision, Target};

/// A fault as a number that f32 holds exactly: its code, at most 255, times this, and the number of the piece.
pub(crate) const FAULT: f64 = 65536.0;
/// The same of f16: which eighth of the pieces is all that is left of the number.
const FAULT_HALF: f64 = 8.0;
/// What white is as f16, whose normal numbers go from 6.1e-5 to 65504: light from a millionth of white to a thousand times white.
const WHITE_HALF: f64 = 64.0;
/// More than this is not summed up in f16.
const MOST_HALF: f64 = 6e4;
/// Optical depth of a piece beyond which nothing is left to see, in f16.
const OPAQUE_HALF: f64 = 1024.0;
/// The least normal number of f16: smaller ones may count as nothing.
const LEAST_HALF: f64 = 1.0 / 16_384.0;
/// Stands for [`crate::program::Fault::CUT_SHORT`].
pub(crate) const CUT_SHORT: u32 = 255;

/// Which number of a piece goes into which channel of which target.
pub(crate) struct Layers {
    pub(crate) targets: Vec<Target>,
    /// Of each target, what its channels hold: a part and its component. The fourth of a target of light is for the
    /// transmittance that it fades by.
    pub(crate) channels: Vec<Vec<(Part, u8)>>,
    precision: Precision,
}

impl Layers {
    /// `either`: whether pieces may be blended from either side, for which targets of light keep their transmittance.
    pub(crate) fn new(pieces: &Pieces, precision: Precision, either: bool) -> Self {
        let width = |part| pieces.place(part).map_or(0, |i| components(pieces.parts[i as usize].1));
        let (light, depth) = (width(Part::Light), width(Part::Depth));
        let mut layers = Self { targets: vec![], channels: vec![], precision };
        let all: Vec<u8> = (0..light).collect();
        // A target fades by one transmittance: bands that fade alike share one.
        for bands in all.chunks(if depth > 1 { 1 } else { 3 }) {
            let name = match (depth, bands) {
                (0 | 1, [0, ..]) => "radiance".to_owned(),
                (_, bands) => format!("radiance_{}", bands[0]),
            };
            let channels = bands.iter().map(|b| (Part::Light, *b)).collect();
            layers.push(name, Blend::Over, channels);
            if let (true, Some(target)) = (either, layers.targets.last_mut()) {
                target.channels = 4;
            }
        }
        let sums = (0..depth).map(|b| (Part::Depth, b));
        let sums =
            sums.chain([Part::Work, Part::Error, Part::Rounding].into_iter().filter(|p| width(*p) > 0).map(|p| (p, 0)));
        let sums: Vec<_> = sums.collect();
        for (i, part) in sums.chunks(4).enumerate() {
            layers.push(if i == 0 { "sums".into() } else { "more_sums".into() }, Blend::Add, part.to_vec());
        }
        if width(Part::Fault) > 0 {
            layers.push("faults".into(), Blend::Max, vec![(Part::Fault, 0)]);
        }
        if layers.targets.is_empty() {
            layers.push("nothing".into(), Blend::Add, vec![]);
        }
        layers
    }

    /// The struct that fragments return.
    pub(crate) fn colors(&self, builder: &mut KernelBuilder) -> Ty {
        let fields = self.targets.iter().map(|t| (t.name.clone(), Ty::float(4))).collect();
        builder.add_carrier("Colors", Carries::Colors, fields)
    }

    /// A variable for each target, of what changes nothing in it.
    pub(crate) fn clear(&self, code: &mut Code) -> Vec<LocalId> {
        let nothing = |blend| match blend {
            Blend::Over => Expr::Compose(Ty::float(4), [0.0, 0.0, 0.0, 1.0].map(Expr::F32).into()),
            Blend::Add | Blend::Max => Expr::F32(0.0).splat(4),
        };
        self.targets.iter().map(|t| code.var(&t.name, Ty::float(4), nothing(t.blend))).collect()
    }

    /// What light is in a target, in lx, per what is written there.
    fn unit(&self, builder: &mut KernelBuilder) -> Option<Expr> {
        match self.precision {
            Precision::Single => None,
            Precision::Half => Some(builder.frame(FrameValue::White) / WHITE_HALF),
        }
    }

    /// Sets them to what a piece sends and lets through. `number` says where a fault was found.
    pub(crate) fn fill(
        &self,
        builder: &mut KernelBuilder,
        code: &mut Code,
        pieces: &Pieces,
        vars: &[LocalId],
        (value, number): (&Expr, &Expr),
    ) {
        let unit = self.unit(builder);
        let half = self.precision == Precision::Half;
        let (place, most) = match self.precision {
            Precision::Single => (number.clone(), FAULT),
            Precision::Half => {
                let eighth = number.clone() / builder.frame(FrameValue::SlabCount).convert(Prim::F32) * FAULT_HALF;
                (Expr::math(Math::Floor, [eighth]), FAULT_HALF)
            }
        };
        let part = |part: Part, i: u8| {
            let place = pieces.place(part)?;
            Some(component(value.clone().field(place), pieces.parts[place as usize].1, i))
        };
        for (layer, var) in vars.iter().enumerate() {
            let mut parts = vec![Expr::F32(0.0); 4];
            for (slot, (kind, i)) in parts.iter_mut().zip(&self.channels[layer]) {
                let Some(value) = part(*kind, *i) else { continue };
                *slot = match kind {
                    Part::Light | Part::Error | Part::Rounding => match &unit {
                        Some(unit) => {
                            let value = value / unit.clone();
                            Expr::math(Math::Clamp, [value, Expr::F32(-MOST_HALF), Expr::F32(MOST_HALF)])
                        }
                        None => value,
                    },
                    Part::Depth => {
                        if half {
                            value.min(OPAQUE_HALF)
                        } else {
                            value
                        }
                    }
                    Part::Work => value.convert(Prim::F32),
                    Part::Fault => {
                        let code_of = Expr::Math(Math::Min, vec![value.clone(), CUT_SHORT.into()]);
                        value.greater(0u32).select(code_of.convert(Prim::F32) * most + place.clone(), 0.0)
                    }
                };
            }
            if self.targets[layer].blend == Blend::Over {
                let band = self.channels[layer].first().map_or(0, |c| c.1);
                parts[3] = part(Part::Depth, band).map_or(Expr::F32(1.0), |depth| (-depth).exp());
            }
            code.set(*var, Expr::Compose(Ty::float(4), parts));
        }
    }

    /// The code of a fault, and the number of its piece, of what is written for it.
    pub(crate) fn fault(&self, builder: &mut KernelBuilder, code: &mut Code, packed: &Expr) -> (Expr, Expr) {
        let most = match self.precision {
            Precision::Single => FAULT,
            Precision::Half => FAULT_HALF,
        };
        let number = Expr::math(Math::Floor, [packed.clone() / most]);
        let number = code.bind("fault_number", Ty::F32, number);
        let rest = packed.clone() - number.clone() * most;
        let piece = match self.precision {
            Precision::Single => rest,
            Precision::Half => {
                let count = builder.frame(FrameValue::SlabCount).convert(Prim::F32);
                Expr::math(Math::Floor, [(rest + 0.5) / FAULT_HALF * count])
            }
        };
        (number, piece)
    }

    /// What was written into a channel, in the units of its part.
    pub(crate) fn read(&self, builder: &mut KernelBuilder, part: Part, texel: Expr) -> Expr {
        match (part, self.unit(builder)) {
            (Part::Light | Part::Rounding, Some(unit)) => texel.min(MOST_HALF) * unit,
            // Sums of f16 lose what is small beside them.
            (Part::Error, Some(unit)) => {
                let count = builder.frame(FrameValue::SlabCount).convert(Prim::F32);
                (texel * (count.clone() * self.precision.blend_error() + 1.0) + count * LEAST_HALF) * unit
            }
            (Part::Light | Part::Depth | Part::Error | Part::Rounding | Part::Work | Part::Fault, _) => texel,
        }
    }

    /// What the error of blending counts as, and how much of the sum of errors that was read is of that kind: f32 rounds, f16 stores.
    pub(crate) fn blending(
        &self,
        builder: &mut KernelBuilder,
        error: Option<(Expr, Expr)>,
    ) -> (OutputKind, Option<Expr>) {
        match (self.precision, self.unit(builder)) {
            (Precision::Half, Some(unit)) => {
                (OutputKind::Storage, error.map(|(read, texel)| (read - texel * unit).max(0.0)))
            }
            (Precision::Half, None) => (OutputKind::Storage, None),
            (Precision::Single, _) => (OutputKind::Rounding, None),
        }
    }

    /// What blending this many pieces may have made wrong in `light` of their own and in `behind`, the light that came through an
    /// optical depth: each blend rounds once more what was there (Higham 2002, §3.1), and depths add up likewise.
    pub(crate) fn rounding(
        &self,
        builder: &mut KernelBuilder,
        count: &Expr,
        light: Option<Expr>,
        (behind, depth): (Expr, Option<Expr>),
    ) -> Expr {
        let each = count.clone() * self.precision.blend_error();
        let lost = |value: Expr| match self.precision {
            Precision::Single => value,
            Precision::Half => value + count.clone() * LEAST_HALF,
        };
        let own = light.map(|light| {
            let lost = match self.unit(builder) {
                Some(unit) => {
                    let over = light.clone().greater_equal(unit.clone() * (0.99 * MOST_HALF));
                    count.clone() * LEAST_HALF * unit + over.select(FAR, 0.0)
                }
                None => Expr::F32(0.0),
            };
            light * each.clone() + lost
        });
        let through = depth.map(|depth| behind * lost(depth * each.clone()).min(1.0));
        own.into_iter().chain(through).reduce(|a, b| a + b).unwrap_or(Expr::F32(0.0))
    }

    fn push(&mut self, name: String, blend: Blend, channels: Vec<(Part, u8)>) {
        let count = match channels.len() {
            0 | 1 => 1,
            2 => 2,
            _ => 4,
        };
        self.targets.push(Target { name, channels: count, blend, precision: self.precision });
        self.channels.push(channels);
    }
}

/// Components of a value.
pub(crate) fn components(ty: Ty) -> u8 {
    match ty {
        Ty::Value(_, width) => width,
        Ty::Struct(_) => 0,
    }
}

/// A component of a part that may have one only.
pub(crate) fn component(value: Expr, ty: Ty, i: u8) -> Expr {
    if components(ty) > 1 { value.component(i) } else { value }
}
