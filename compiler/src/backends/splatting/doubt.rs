//! `doubt`: how far the coefficients of the lattice may be from those of the media, and pictures of what this leaves open.
//!
//! Gaussians on a lattice reproduce what is linear. What they blur is told by second differences: on smooth fields the error is
//! κ²/2 of their sum, and at a jump they are as large as the jump, at the nodes on both sides. Times [`SMOOTH`] to [`SUDDEN`] and spread by
//! the same Gaussians, they are what a boundary between nodes may be off by. What is blurred along the view is the same in sum: only
//! the part across it counts. Besides, Gaussians overlap and are composed in the order of their centres, so that light comes from
//! before or behind its place by as much as one of them hides.
//!
//! Of what is opaque within a spacing, even tails of Gaussians hide what is beside the medium: where coefficients are made smaller
//! these end at [`CORE`] deviations, and those at the rim are left out.
//!
//! Two more pictures are drawn, one with all coefficients larger by what they may be wrong by, one with all smaller, both with sources
//! larger by what order may change: where the source is the same everywhere, radiance grows or falls with optical depth, and they
//! enclose it. That is an estimate and no bound: errors of several boundaries may be of either sign, and what lies between
//! nodes and touches none has no part in it.

use super::splat::{along, coefficients, index, kept, node, read};
use crate::fields::{Code, KernelBuilder};
use crate::ir::FieldScene;
use crate::program::kernel::{Expr, Function, Math, Ty};
use crate::program::{FrameValue, RaySource};
use crate::transport::layers::{component, components};
use crate::transport::records;
use crate::transport::slab::{Part, Pieces};

/// What part of a second difference is taken for the error: κ²/2 and a little more where a field is smooth,
const SMOOTH: f64 = 0.33;
/// and where it jumps, what covers a boundary anywhere between two nodes.
const SUDDEN: f64 = 1.0;
/// What is left of a coefficient when as much is taken away, and counts as nothing.
const ROUNDING: f64 = 1e-5;
/// Optical depth of a spacing above which Gaussians hide what is beside a medium; the deviations beyond which that may be nothing but blur;
/// and what part of an extinction is in doubt where a boundary is next to a node.
const THICK: f64 = 2.0;
const CORE: f64 = 1.2;
const RIM: f64 = 0.2;
/// Stands for no bound.
const MOST: f64 = 1e37;

/// Components of emission, where there is extinction too.
fn sources(pieces: &Pieces) -> Option<u8> {
    pieces.place(Part::Depth)?;
    kept(pieces).find(|p| p.0 == Part::Light).map(|p| components(p.1))
}

/// f32 of a node: its coefficients, what each may be wrong by, and what order may add to emission.
pub(super) fn stride(pieces: &Pieces) -> u32 {
    let all = 2 * coefficients(pieces) + u32::from(sources(pieces).unwrap_or(0));
    all.max(1)
}

/// The number of the component of extinction that goes with one of emission.
fn with(pieces: &Pieces, band: u8) -> u32 {
    let mut first = 0;
    for (part, ty) in kept(pieces) {
        if part == Part::Depth {
            return first + u32::from(band.min(components(ty) - 1));
        }
        first += u32::from(components(ty));
    }
    first
}

/// The entry point.
pub(super) fn entry(scene: &FieldScene, builder: &mut KernelBuilder, pieces: &Pieces, rays: RaySource) -> Function {
    let mut code = Code::new("doubt", None);
    let number = records::numbered(builder, &mut code);
    let splats = builder.splats();
    let stride = stride(pieces);
    let count = coefficients(pieces);
    let all = |code: &mut Code, number: Expr| -> Vec<Expr> {
        let base = code.bind("base", Ty::U32, number * stride);
        (0..count).map(|i| code.bind("coefficient", Ty::F32, Expr::load(splats, base.clone() + i))).collect()
    };
    let own = all(&mut code, number.clone());
    let center = node(builder, &mut code, &number);
    let along = along(scene, builder, &mut code, (rays, &center));
    let place = index(builder, &mut code, &number);
    let counts = builder.frame(FrameValue::LatticeCounts);
    let mut step = Expr::U32(1);
    let mut bends: Vec<Expr> = vec![Expr::F32(0.0); count as usize];
    let mut around = vec![own.clone()];
    for (axis, at) in (0..).zip(place) {
        let share = along.clone().component(axis);
        let across = code.bind("across", Ty::F32, Expr::F32(1.0) - share.clone() * share);
        let size = counts.clone().component(axis);
        // The rim is empty; beyond it is nothing.
        let less = at.clone().greater(0u32).select(number.clone() - step.clone(), number.clone());
        let more = (at + 1u32).less(size.clone()).select(number.clone() + step.clone(), number.clone());
        let [less, more] = [("node_before", less), ("node_after", more)].map(|(name, n)| {
            let n = code.bind(name, Ty::U32, n);
            all(&mut code, n)
        });
        for (i, bend) in bends.iter_mut().enumerate() {
            let to = code.bind("to", Ty::F32, more[i].clone() - own[i].clone());
            let from = code.bind("from", Ty::F32, own[i].clone() - less[i].clone());
            let size = |of: &Expr| Expr::math(Math::Abs, [of.clone()]);
            let second = code.bind("second", Ty::F32, size(&(to.clone() - from.clone())));
            let first = code.bind("first", Ty::F32, size(&to) + size(&from));
            // 1 where all of the change is on one side.
            let sudden = code.bind("sudden", Ty::F32, second.clone() / first.max(1e-37));
            let margin = sudden.clone() * sudden * (SUDDEN - SMOOTH) + SMOOTH;
            *bend = code.bind("bend", Ty::F32, bend.clone() + second * margin * across.clone());
        }
        around.extend([less, more]);
        step = code.bind("step", Ty::U32, step * size);
    }
    let base = code.bind("base", Ty::U32, number * stride);
    let lights = sources(pieces).unwrap_or(0);
    for band in 0..lights {
        // Emission without extinction has a source that is beyond all bounds.
        let (least, most) = (code.var("least", Ty::F32, Expr::F32(MOST)), code.var("most", Ty::F32, Expr::F32(0.0)));
        let through = with(pieces, band) as usize;
        for node in &around {
            let (light, depth) = (node[band as usize].clone(), node[through].clone());
            let source = light.clone() / depth.clone().max(1e-37);
            let source = depth.clone().greater(0.0).select(source.min(MOST), MOST);
            let source = code.bind("source", Ty::F32, source);
            let there = light.greater(0.0).or(depth.greater(0.0));
            let (low, high) = (Expr::Local(least).min(source.clone()), Expr::Local(most).max(source));
            code.set(least, there.clone().select(low, Expr::Local(least)));
            code.set(most, there.select(high, Expr::Local(most)));
        }
        let depth = own[through].clone();
        let hidden = (depth.clone() * builder.frame(FrameValue::LatticeSpacing) * super::splat::PEAK).min(1.0);
        let apart = (Expr::Local(most) - Expr::Local(least)).max(0.0);
        let known = Expr::Local(most).less(MOST);
        let moved = code.bind("moved", Ty::F32, known.select(depth * apart * hidden, 0.0));
        code.store(splats, base.clone() + (2 * count + u32::from(band)), moved.min(MOST));
    }
    for (i, bend) in (0..).zip(bends) {
        code.store(splats, base.clone() + (count + i), bend.min(MOST));
    }
    code.finish(None)
}

/// What a node sends and lets through along a length: as it is, or leaning.
pub(super) fn within(
    builder: &mut KernelBuilder,
    code: &mut Code,
    pieces: &Pieces,
    (number, length, distance): (&Expr, &Expr, &Expr),
) -> Expr {
    let splats = builder.splats_read();
    let base = code.bind("base", Ty::U32, number.clone() * stride(pieces));
    let from = (splats, &base);
    let types: Vec<Ty> = kept(pieces).map(|p| p.1).collect();
    let given = read(code, from, 0, types.iter().copied());
    let vars: Vec<_> =
        given.iter().zip(&types).map(|(value, ty)| (code.var("part", *ty, value.clone()), *ty)).collect();
    let reach = code.var("reach", Ty::F32, length.clone());
    if !vars.is_empty() {
        let lean = builder.frame(FrameValue::Lean);
        code.open();
        let off = read(code, from, coefficients(pieces), types.iter().copied());
        if let Some((((_, ty), depth), off)) = kept(pieces).zip(&given).zip(&off).find(|((p, _), _)| p.0 == Part::Depth)
        {
            let largest = |value: &Expr| {
                let all = (0..components(ty)).map(|i| component(value.clone(), ty, i));
                all.reduce(Expr::max).expect("a component")
            };
            let most = code.bind("most", Ty::F32, largest(depth));
            let thick = (most.clone() * builder.frame(FrameValue::LatticeSpacing) * super::splat::PEAK).greater(THICK);
            let rim = largest(off).greater(most * RIM);
            let blur = distance.clone().greater(CORE * CORE).or(rim);
            let gone = thick.and(lean.clone().less(0.0)).and(blur);
            code.set(reach, gone.select(0.0, Expr::Local(reach)));
        }
        let lights = sources(pieces).map(Ty::float);
        let mut order = read(code, from, 2 * coefficients(pieces), lights.into_iter()).into_iter();
        for (((part, ty), (var, _)), (value, off)) in kept(pieces).zip(&vars).zip(given.iter().zip(off)) {
            let wide = components(ty);
            let moved = value.clone() + off * lean.clone().splat(wide);
            // So that all of what goes together goes, whatever rounding does.
            let least = value.clone() * Expr::F32(ROUNDING).splat(wide);
            let there = Expr::math(Math::Sign, [(moved.clone() - least).max(Expr::F32(0.0).splat(wide))]);
            let mut moved = moved * there;
            if part == Part::Light
                && let Some(order) = order.next()
            {
                moved = moved + order;
            }
            code.set(*var, moved);
        }
        let body = code.close();
        code.push_if(lean.clone().greater(0.0).or(lean.less(0.0)), body);
    }
    let parts = vars.into_iter().map(|(var, _)| Expr::Local(var));
    let arguments = parts.chain([Expr::Local(reach)]).collect();
    code.bind("within", pieces.result, Expr::Call(pieces.footprint, arguments))
}
