//! Changes of the field graph.

use super::Change;
use crate::ir::{Binary, FieldScene, Graph, Input, NodeId, Op, Stacks, Unary};
use std::f64::consts::PI;

/// The largest coefficient.
const MOST: f64 = 1e30;

/// Makes a change in a lowered scene.
pub(crate) fn overlay(change: Change, scene: &mut FieldScene) {
    match change {
        // Made in the checked scene.
        Change::Lengths(_) => {}
        Change::Matter(factor) => scale(scene, factor, true),
        Change::Extinction(factor) => scale(scene, factor, false),
        Change::Asymmetry(g) => {
            let phase = henyey_greenstein(&mut scene.graph, g);
            scene.media.iter_mut().for_each(|medium| medium.phase = Some(phase));
        }
        Change::Furnace => furnace(scene),
    }
}

fn scale(scene: &mut FieldScene, factor: f64, emission: bool) {
    let graph = &mut scene.graph;
    // As much as f32 can hold, with room for what is made of it.
    let most = MOST / factor.max(1.0);
    for medium in &mut scene.media {
        let own = [&mut medium.k_a, &mut medium.k_s].into_iter().chain(emission.then_some(&mut medium.k_e));
        for node in own {
            let width = graph.width(*node);
            let [by, most] = [factor, most].map(|v| graph.scalar(v)).map(|v| graph.widen(v, width));
            if factor > 1.0 {
                *node = graph.push(Op::Binary(Binary::Min, *node, most));
            }
            *node = graph.mul(*node, by);
        }
    }
}

/// (1 − g²)/4π · ((1 − |g|)² + 2|g|(1 ∓ cos θ))^(−3/2), which loses nothing where |g| is nearly 1.
fn henyey_greenstein(graph: &mut Graph, g: f64) -> NodeId {
    let cosine = graph.input(Input::CosTheta);
    let one = graph.scalar(1.0);
    let bracket = if g >= 0.0 { graph.sub(one, cosine) } else { graph.add(one, cosine) };
    let (twice, rest) = (graph.scalar(2.0 * g.abs()), graph.scalar((1.0 - g.abs()).powi(2)));
    let bracket = graph.mul(twice, bracket);
    let bracket = graph.add(rest, bracket);
    let root = graph.unary(Unary::Sqrt, bracket);
    let below = graph.mul(bracket, root);
    let above = graph.scalar((1.0 - g * g) / (4.0 * PI));
    graph.div(above, below)
}

fn furnace(scene: &mut FieldScene) {
    let graph = &mut scene.graph;
    let black = graph.scalar(0.0);
    for medium in &mut scene.media {
        let width = graph.width(medium.k_a).max(graph.width(medium.k_s));
        let [k_a, k_s] = [medium.k_a, medium.k_s].map(|node| graph.widen(node, width));
        medium.k_s = graph.push(Op::Binary(Binary::Add, k_a, k_s));
        (medium.k_a, medium.k_e) = (black, black);
    }
    let white = graph.scalar(1.0);
    scene.surfaces.iter_mut().for_each(|surface| surface.albedo = white);
    scene.lights.clear();
    // Light from everywhere has no half angle.
    if scene.render.stacks == Stacks::HalfAngle {
        scene.render.stacks = Stacks::View;
    }
    // They shine by themselves.
    scene.splats.clear();
    scene.background = white;
    scene.environment = true;
}
