//! Where the splats of a scene are in one frame.

use super::vector::{Vec3, is_finite};
use compiler::diagnostic::Diagnostic;
use compiler::ir::{FieldScene, NodeId, SplatBlend};

/// Where an item of splats is in one frame.
#[derive(Copy, Clone, Debug)]
pub(crate) struct Placed {
    /// Rows of the map from the file's space to the world.
    pub(crate) rows: [Vec3; 3],
    pub(crate) offset: Vec3,
    /// Rows of its inverse.
    pub(crate) back: [Vec3; 3],
    /// Whether they are blended as encoded numbers.
    pub(crate) encoded: bool,
}

const IDENTITY: [Vec3; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Evaluates where splats are. `frame` gives the numbers of nodes of tier Frame.
///
/// # Errors
/// `E0651` for a transform that is not finite.
pub(crate) fn placed(
    scene: &FieldScene,
    frame: &dyn Fn(&[NodeId]) -> Vec<Vec<f64>>,
) -> Result<Vec<Placed>, Diagnostic> {
    let mut all = vec![];
    for info in &scene.splats {
        let encoded = info.blend == SplatBlend::Encoded;
        let placed = match &info.placement {
            None => Placed { rows: IDENTITY, offset: [0.0; 3], back: IDENTITY, encoded },
            Some(p) => {
                let (to, from) = (p.to_world, p.from_world);
                let nodes: Vec<NodeId> = to.rows.into_iter().chain(from.rows).chain([to.offset]).collect();
                let values = frame(&nodes);
                let three = |i: usize| -> Vec3 { std::array::from_fn(|c| values[i][c.min(values[i].len() - 1)]) };
                if !(0..7).all(|i| is_finite(three(i))) {
                    let message = format!("the transform of the splats `{}` is not finite", info.name);
                    let diagnostic = Diagnostic::error("E0651", message);
                    let diagnostic = match info.span {
                        Some(span) => diagnostic.at(span, ""),
                        None => diagnostic,
                    };
                    return Err(diagnostic.hint("check the params and divisions that it uses"));
                }
                Placed { rows: [0, 1, 2].map(three), offset: three(6), back: [3, 4, 5].map(three), encoded }
            }
        };
        all.push(placed);
    }
    Ok(all)
}
