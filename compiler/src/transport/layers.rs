//! What is blended into which target: light over what lies behind it, and sums.

use super::slab::{Part, Pieces};
use crate::fields::{Code, KernelBuilder};
use crate::program::kernel::{Carries, Expr, LocalId, Math, Prim, Ty};
use crate::program::{Blend, Target};

/// A fault as a number that f32 holds exactly: its code, at most 255, times this, and the number of the piece.
pub(crate) const FAULT: f64 = 65536.0;
/// Stands for [`crate::program::Fault::CUT_SHORT`].
pub(crate) const CUT_SHORT: u32 = 255;

/// Which number of a piece goes into which channel of which target.
pub(crate) struct Layers {
    pub(crate) targets: Vec<Target>,
    /// Of each target, what its channels hold: a part and its component. The fourth of a target of light is for the
    /// transmittance that it fades by.
    pub(crate) channels: Vec<Vec<(Part, u8)>>,
}

impl Layers {
    pub(crate) fn new(pieces: &Pieces) -> Self {
        let width = |part| pieces.place(part).map_or(0, |i| components(pieces.parts[i as usize].1));
        let (light, depth) = (width(Part::Light), width(Part::Depth));
        let mut layers = Self { targets: vec![], channels: vec![] };
        let all: Vec<u8> = (0..light).collect();
        // A target fades by one transmittance: bands that fade alike share one.
        for bands in all.chunks(if depth > 1 { 1 } else { 3 }) {
            let name = match (depth, bands) {
                (0 | 1, [0, ..]) => "light".to_owned(),
                (_, bands) => format!("light_{}", bands[0]),
            };
            let channels = bands.iter().map(|b| (Part::Light, *b)).collect();
            layers.push(name, Blend::Over, channels);
        }
        let sums = (0..depth).map(|b| (Part::Depth, b));
        let sums = sums.chain([Part::Work, Part::Error].into_iter().filter(|p| width(*p) > 0).map(|p| (p, 0)));
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

    /// Sets them to what a piece sends and lets through. `number` says where a fault was found.
    pub(crate) fn fill(&self, code: &mut Code, pieces: &Pieces, vars: &[LocalId], value: &Expr, number: &Expr) {
        let part = |part: Part, i: u8| {
            let place = pieces.place(part)?;
            Some(component(value.clone().field(place), pieces.parts[place as usize].1, i))
        };
        for (layer, var) in vars.iter().enumerate() {
            let mut parts = vec![Expr::F32(0.0); 4];
            for (slot, (kind, i)) in parts.iter_mut().zip(&self.channels[layer]) {
                let Some(value) = part(*kind, *i) else { continue };
                *slot = match kind {
                    Part::Light | Part::Depth | Part::Error => value,
                    Part::Work => value.convert(Prim::F32),
                    Part::Fault => {
                        let code_of = Expr::Math(Math::Min, vec![value.clone(), CUT_SHORT.into()]);
                        value.greater(0u32).select(code_of.convert(Prim::F32) * FAULT + number.clone(), 0.0)
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

    fn push(&mut self, name: String, blend: Blend, channels: Vec<(Part, u8)>) {
        let count = match channels.len() {
            0 | 1 => 1,
            2 => 2,
            _ => 4,
        };
        self.targets.push(Target { name, channels: count, blend });
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
