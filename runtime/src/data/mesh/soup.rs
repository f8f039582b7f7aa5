//! Corners and faces as a file gives them, and the triangles that come of them.

use super::{MAX_TRIANGLES, Triangle};
use crate::data::LoadWarning;
use compiler::diagnostic::Severity;
use compiler::loader::LoadError;

/// Corners and triangles by the numbers of their corners. A face may name corners that come later in the file.
#[derive(Debug, Default)]
pub(super) struct Soup {
    corners: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
    /// The highest index that was named, and where.
    highest: Option<(u32, String)>,
}

impl Soup {
    /// How many corners there are so far.
    pub(super) fn corners(&self) -> usize {
        self.corners.len()
    }

    /// One more corner, in metres. What does not fit 32 bits becomes infinite.
    pub(super) fn corner(&mut self, position: [f64; 3]) -> Result<(), LoadError> {
        if self.corners.len() >= 3 * MAX_TRIANGLES {
            return Err(too_large());
        }
        self.corners.push(position.map(|x| x as f32));
        Ok(())
    }

    /// A polygon by the numbers of its corners from 0, as a fan. `place` says where it stands in the file.
    pub(super) fn polygon(&mut self, corners: &[u32], place: impl Fn() -> String) -> Result<(), LoadError> {
        let [first, rest @ ..] = corners else { return Ok(()) };
        if self.faces.len() + corners.len() > MAX_TRIANGLES + 2 {
            return Err(too_large());
        }
        self.faces.extend(rest.windows(2).map(|edge| [*first, edge[0], edge[1]]));
        if let Some(&highest) = corners.iter().max()
            && highest as usize >= self.corners.len()
            && self.highest.as_ref().is_none_or(|(h, _)| highest > *h)
        {
            self.highest = Some((highest, place()));
        }
        Ok(())
    }

    /// Puts corners in the place of their numbers.
    ///
    /// # Errors
    /// `E0614` for a number that no corner has.
    pub(super) fn triangles(self) -> Result<Vec<Triangle>, LoadError> {
        if let Some((highest, place)) = &self.highest
            && *highest as usize >= self.corners.len()
        {
            let message = format!("names corner {} in {place}, but has {} corners", *highest, self.corners.len());
            return Err(index_error(message));
        }
        let at = |i: u32| self.corners.get(i as usize).copied().unwrap_or([f32::NAN; 3]);
        Ok(self.faces.iter().map(|face| face.map(at)).collect())
    }
}

/// `E0614`.
pub(super) fn index_error(message: String) -> LoadError {
    LoadError {
        code: "E0614",
        message,
        hint: Some("the file is damaged, or was put together from parts: export it again".into()),
    }
}

/// `E0616`.
pub(super) fn too_large() -> LoadError {
    LoadError {
        code: "E0616",
        message: format!("has more than {MAX_TRIANGLES} triangles"),
        hint: Some("reduce it first".into()),
    }
}

/// The normal, not of unit length. The differences are exact or nearly so in 64 bits, and nothing overflows.
pub(super) fn cross(triangle: &Triangle) -> [f64; 3] {
    let [a, b, c] = triangle.map(|corner| corner.map(f64::from));
    let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// Whether three corners lie on one line, up to the rounding of 64-bit numbers.
fn is_flat(triangle: &Triangle) -> bool {
    let [a, b, c] = triangle.map(|corner| corner.map(f64::from));
    let square = |p: [f64; 3], q: [f64; 3]| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>();
    let longest = square(a, b).max(square(b, c)).max(square(c, a));
    let twice_area = cross(triangle).iter().map(|x| x * x).sum::<f64>().sqrt();
    // Not `<`: without extent both are 0.
    twice_area <= 1e-14 * longest
}

/// Leaves out what is no triangle and tells about it.
///
/// # Errors
/// `E0615` when nothing remains.
pub(super) fn sanitise(mut triangles: Vec<Triangle>) -> Result<(Vec<Triangle>, Vec<LoadWarning>), LoadError> {
    let (mut flat, mut wild, mut first, mut at) = (0_usize, 0_usize, None, 0_usize);
    triangles.retain(|triangle| {
        let finite = triangle.iter().flatten().all(|x| x.is_finite());
        let keep = finite && !is_flat(triangle);
        if !keep {
            *(if finite { &mut flat } else { &mut wild }) += 1;
            first.get_or_insert(at);
        }
        at += 1;
        keep
    });
    let mut parts = vec![];
    for (count, one, many) in [
        (flat, "1 triangle has no area", "triangles have no area"),
        (wild, "1 triangle has a corner that is not finite", "triangles have a corner that is not finite"),
    ] {
        match count {
            0 => {}
            1 => parts.push(one.to_owned()),
            n => parts.push(format!("{n} {many}")),
        }
    }
    if triangles.is_empty() {
        let why = if parts.is_empty() { String::new() } else { format!(": {}", parts.join(", ")) };
        return Err(LoadError {
            code: "E0615",
            message: format!("has no triangle that could be seen{why}"),
            hint: Some("points, lines, curves and triangle strips are not read: export polygons".into()),
        });
    }
    let warnings = match first {
        None => vec![],
        Some(first) => vec![LoadWarning {
            code: "W0605",
            severity: Severity::Warning,
            message: format!("{}; left out, the first is triangle {}", parts.join(" and "), first + 1),
            hint: Some("clean the mesh in the program that made it".into()),
        }],
    };
    Ok((triangles, warnings))
}

/// Tells of a surface that is not closed: edges at which one triangle ends and no other begins. Corners are the same where their
/// coordinates are.
pub(super) fn holes(triangles: &[Triangle]) -> Option<LoadWarning> {
    // By value, with one zero.
    let key = |corner: &[f32; 3]| corner.map(|x| (x + 0.0).to_bits());
    let mut corners: Vec<[u32; 3]> = triangles.iter().flatten().map(key).collect();
    corners.sort_unstable();
    corners.dedup();
    let number = |corner: &[f32; 3]| corners.binary_search(&key(corner)).unwrap_or_default() as u32;
    let mut edges: Vec<[u32; 2]> = vec![];
    for triangle in triangles {
        let numbers = triangle.each_ref().map(number);
        for i in 0..3 {
            let (a, b) = (numbers[i], numbers[(i + 1) % 3]);
            edges.push([a.min(b), a.max(b)]);
        }
    }
    edges.sort_unstable();
    let mut open = edges.chunk_by(PartialEq::eq).filter(|same| same.len() == 1).map(|same| same[0]);
    let [a, b] = open.next()?.map(|c| corners[c as usize].map(f32::from_bits));
    let more = open.count();
    let [from, to] = [a, b].map(|[x, y, z]| format!("({x}, {y}, {z})"));
    let message = match more {
        0 => format!("is not closed: 1 edge belongs to one triangle alone, from {from} to {to} m"),
        _ => format!("is not closed: {} edges belong to one triangle alone, such as {from} to {to} m", more + 1),
    };
    Some(LoadWarning {
        code: "N0606",
        severity: Severity::Note,
        message,
        hint: Some(
            "light passes through holes; if none were meant, close them in the program that made the mesh".into(),
        ),
    })
}
