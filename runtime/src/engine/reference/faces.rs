//! What is asked of shapes besides where a ray is inside: which faces it meets, how they lie, and where shapes are seen.

use super::shape::{Form, Solid};
use crate::frame::vector::{Vec3, cross, dot, length, normalize, scale, sub};
use compiler::ir::NodeId;

/// The vector that a matrix of these rows takes to `v`.
fn solve_three(rows: &[Vec3; 3], v: Vec3) -> Option<Vec3> {
    let [a, b, c] = rows;
    let volume = dot(*a, cross(*b, *c));
    let (x, y, z) = (cross(*b, *c), cross(*c, *a), cross(*a, *b));
    (volume != 0.0).then(|| std::array::from_fn(|i| (v[0] * x[i] + v[1] * y[i] + v[2] * z[i]) / volume))
}

const SIGNATURE: u64 = 0xcbf2_9ce4_8422_2325;

/// Mixes a number into another (FNV).
pub(super) fn mix(hash: u64, more: u64) -> u64 {
    (hash ^ more).wrapping_mul(0x0100_0000_01b3)
}

impl Solid {
    /// A number that stays the same while a ray meets the same faces in the same way up to `reach`: where it changes, what
    /// is summed along the ray may not be smooth. Fields of `sdf` are left out.
    pub(super) fn signature(&self, o: Vec3, d: Vec3, reach: f64) -> u64 {
        let mut hash = SIGNATURE;
        self.leaves(o, d, &mut |form, _, o, d| hash = mix(hash, form.signature(o, d, reach)));
        hash
    }

    /// A box around it, if it has one that is easily seen.
    pub(super) fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let join = |x: (Vec3, Vec3), y: (Vec3, Vec3)| -> (Vec3, Vec3) {
            (std::array::from_fn(|i| x.0[i].min(y.0[i])), std::array::from_fn(|i| x.1[i].max(y.1[i])))
        };
        match self {
            Self::Everywhere => None,
            Self::Union(parts) => {
                let all: Option<Vec<_>> = parts.iter().map(Self::bounds).collect();
                all?.into_iter().reduce(join)
            }
            // Any of them holds it.
            Self::Intersection(parts) => {
                let size = |b: &(Vec3, Vec3)| length(sub(b.1, b.0));
                parts.iter().filter_map(Self::bounds).min_by(|x, y| size(x).total_cmp(&size(y)))
            }
            Self::Difference(first, _) => first.bounds(),
            Self::Part { from_world, form } => {
                let (low, high) = form.bounds()?;
                let Some((rows, offset)) = from_world else { return Some((low, high)) };
                let corner = |i: usize| {
                    let own: Vec3 = std::array::from_fn(|c| if i >> c & 1 == 0 { low[c] } else { high[c] } - offset[c]);
                    solve_three(rows, own).map(|p| (p, p))
                };
                let corners: Option<Vec<_>> = (0..8).map(corner).collect();
                corners?.into_iter().reduce(join)
            }
        }
    }

    /// Whether it is a shell that begins at this radius.
    pub(super) fn is_shell_over(&self, at: Vec3, radius: f64) -> bool {
        matches!(self, Self::Part { from_world: None, form: Form::Shell { center, inner, .. } }
            if *center == at && *inner == radius)
    }

    /// Cones of directions from `p` (a unit vector and an angle about it) at whose rims what a ray meets changes: rims of balls,
    /// and corners as cones without width. Only hints: what is hard to see is left out.
    pub(super) fn cones(&self, p: Vec3, out: &mut Vec<(Vec3, f64)>) {
        // Positions in a part's own space, and back.
        self.leaves(p, [0.0; 3], &mut |form, rows, own, _| {
            let to_world = |v: Vec3| match rows {
                None => Some(v),
                Some(rows) => solve_three(rows, v),
            };
            let mut towards = |q: Vec3, radius: f64| {
                let Some(way) = to_world(sub(q, own)) else { return };
                let stretch = to_world([1.0, 0.0, 0.0]).map_or(1.0, length);
                let (far, radius) = (length(way), radius * stretch);
                if let Some(way) = normalize(way)
                    && far > radius
                {
                    out.push((way, (radius / far).asin()));
                }
            };
            match *form {
                Form::Ball { center, radius } => towards(center, radius),
                Form::Shell { center, inner, outer } => {
                    towards(center, outer);
                    if inner > 0.0 {
                        towards(center, inner);
                    }
                }
                Form::Ellipsoid { center, .. } => towards(center, 0.0),
                Form::Box { min, max } => {
                    for i in 0..8 {
                        towards(std::array::from_fn(|c| if i >> c & 1 == 0 { min[c] } else { max[c] }), 0.0);
                    }
                }
                Form::Cylinder { from, to, .. } => {
                    towards(from, 0.0);
                    towards(to, 0.0);
                }
                Form::Slab { axis, .. } => {
                    // Directions within the slab are those across its axis, whatever the transform.
                    let across = match rows {
                        None => axis,
                        Some(rows) => std::array::from_fn(|c| (0..3).map(|i| rows[i][c] * axis[i]).sum()),
                    };
                    out.extend(normalize(across).map(|a| (a, std::f64::consts::FRAC_PI_2)));
                }
                Form::Sdf { .. } => {}
            }
        });
    }

    /// Normal of the boundary that the ray meets at `t`, of either sign. `sdf` gives the value and gradient of a field there.
    pub(super) fn normal(
        &self,
        o: Vec3,
        d: Vec3,
        t: f64,
        sdf: &mut dyn FnMut(NodeId) -> Option<(f64, Vec3)>,
    ) -> Option<Vec3> {
        // Of all parts the one whose boundary is nearest.
        let mut best: Option<(f64, Vec3)> = None;
        self.leaves(o, d, &mut |form, rows, o, d| {
            let found = match form {
                // The field sees the world whatever the transform says.
                Form::Sdf { field } => sdf(*field).map(|(value, slope)| (value.abs() / length(slope), slope)),
                Form::Ball { .. }
                | Form::Ellipsoid { .. }
                | Form::Box { .. }
                | Form::Slab { .. }
                | Form::Cylinder { .. }
                | Form::Shell { .. } => {
                    let p = std::array::from_fn(|i| d[i].mul_add(t, o[i]));
                    let Some((_, own)) = form.face(p) else { return };
                    let ends = form.intervals(o, d).0;
                    let off =
                        ends.iter().flat_map(|(a, b)| [(a - t).abs(), (b - t).abs()]).fold(f64::INFINITY, f64::min);
                    let world = match rows {
                        None => own,
                        Some(rows) => std::array::from_fn(|c| (0..3).map(|i| rows[i][c] * own[i]).sum()),
                    };
                    Some((off, world))
                }
            };
            if let Some((off, normal)) = found
                && let Some(normal) = normalize(normal)
                && best.is_none_or(|b| off < b.0)
            {
                best = Some((off, normal));
            }
        });
        best.map(|b| b.1)
    }
}

impl Form {
    fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let about = |center: Vec3, half: Vec3| {
            Some((std::array::from_fn(|i| center[i] - half[i]), std::array::from_fn(|i| center[i] + half[i])))
        };
        match *self {
            Self::Ball { center, radius } | Self::Shell { center, outer: radius, .. } => about(center, [radius; 3]),
            Self::Ellipsoid { center, radii } => about(center, radii),
            Self::Box { min, max } => Some((min, max)),
            Self::Cylinder { from, to, radius } => Some((
                std::array::from_fn(|i| from[i].min(to[i]) - radius),
                std::array::from_fn(|i| from[i].max(to[i]) + radius),
            )),
            Self::Slab { .. } | Self::Sdf { .. } => None,
        }
    }

    /// Which faces a ray meets up to `reach`, as a number.
    fn signature(&self, o: Vec3, d: Vec3, reach: f64) -> u64 {
        let mut hash = SIGNATURE;
        for (a, b) in self.intervals(o, d).0 {
            if a >= reach {
                break;
            }
            let at = |t: f64| self.face(std::array::from_fn(|i| d[i].mul_add(t, o[i]))).map_or(0, |f| f.0 + 1);
            hash = mix(hash, if a > 0.0 { at(a) } else { 0 });
            hash = mix(hash, if b < reach { at(b) } else { 0 });
        }
        hash
    }

    /// Number and normal of the face nearest to a point of the boundary.
    fn face(&self, p: Vec3) -> Option<(u64, Vec3)> {
        match *self {
            Self::Ball { center, .. } | Self::Shell { center, inner: 0.0, .. } => Some((0, sub(p, center))),
            Self::Shell { center, inner, outer } => {
                let m = sub(p, center);
                let r = length(m);
                Some((u64::from((r - inner).abs() < (r - outer).abs()), m))
            }
            Self::Ellipsoid { center, radii } => {
                let m = sub(p, center);
                Some((0, std::array::from_fn(|i| m[i] / (radii[i] * radii[i]))))
            }
            Self::Box { min, max } => {
                let mut best = (f64::INFINITY, 0, [0.0; 3]);
                for i in 0..3 {
                    for (side, face) in [(0, min[i]), (1, max[i])] {
                        let off = (p[i] - face).abs();
                        if off < best.0 {
                            best = (off, 2 * i as u64 + side, std::array::from_fn(|c| f64::from(u8::from(c == i))));
                        }
                    }
                }
                Some((best.1, best.2))
            }
            Self::Slab { axis, from, to } => {
                let x = dot(axis, p);
                Some((u64::from((x - from).abs() < (x - to).abs()), axis))
            }
            Self::Cylinder { from, to, radius } => {
                let axis = sub(to, from);
                let height = length(axis);
                let axis = scale(axis, 1.0 / height);
                let m = sub(p, from);
                let x = dot(m, axis);
                let side = sub(m, scale(axis, x));
                let [low, high, off] = [x.abs(), (x - height).abs(), (length(side) - radius).abs()];
                if off <= low.min(high) { Some((0, side)) } else { Some((1 + u64::from(high < low), axis)) }
            }
            Self::Sdf { .. } => None,
        }
    }
}
