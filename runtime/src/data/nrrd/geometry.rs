//! Which axes of a NRRD file are spatial, and the map to world space.

use super::super::affine::{self, Unit};
use super::super::{LoadWarning, broken};
use super::fields::Fields;
use compiler::diagnostic::Severity;
use compiler::loader::LoadError;

/// Samples along the three spatial axes and the map to world space in metres.
pub(super) fn read(fields: &Fields, warnings: &mut Vec<LoadWarning>) -> Result<([u32; 3], [[f64; 4]; 3]), LoadError> {
    let sizes = sizes(fields)?;
    let space = space(fields)?;
    let world_units = match fields.words("spaceunits")? {
        None => None,
        Some(words) => {
            let words = one_per(words, 3, "space units", "dimension of space")?;
            Some([unit(&words[0], warnings), unit(&words[1], warnings), unit(&words[2], warnings)])
        }
    };

    let (axes, mut origin) = match fields.vectors("spacedirections")? {
        Some(directions) => (directed_axes(&sizes, directions)?, [0.0; 3]),
        None => spaced_axes(fields, &sizes, world_units.is_some(), warnings)?,
    };
    if axes.len() > 3 {
        let n = axes.len();
        return Err(not_a_grid(format!("has {n} axes in space with more than one sample, where a grid has three")));
    }
    if let Some(vectors) = fields.vectors("spaceorigin")? {
        match vectors.as_slice() {
            [Some(v)] if v.len() == 3 => origin = [v[0], v[1], v[2]],
            _ => return Err(broken("has a `space origin` that is no vector of three numbers")),
        }
    }

    let mut dims = [1; 3];
    for (dim, axis) in dims.iter_mut().zip(&axes) {
        *dim = u32::try_from(axis.size).map_err(|_| LoadError {
            code: "E0608",
            message: format!("has {} samples along one axis", axis.size),
            hint: Some("cut it or halve its resolution first".into()),
        })?;
    }
    let steps = complete(&axes);
    let mut map = affine::from_columns(steps, origin);
    for (row, numbers) in map.iter_mut().enumerate() {
        let unit = world_units.map_or(Unit::MILLIMETRE, |units| units[row]);
        // Axes that were scaled by units of their own are in millimetres by now.
        *numbers = numbers.map(|x| space.signs[row] * unit.to_metres(x));
    }
    Ok((dims, map))
}

struct Axis {
    size: u64,
    step: [f64; 3],
}

fn sizes(fields: &Fields) -> Result<Vec<u64>, LoadError> {
    let dimension = fields.required("dimension")?;
    let n = dimension.trim().parse().ok().filter(|n| (1..=16).contains(n));
    let n: usize = n.ok_or_else(|| broken(format!("has the dimension `{dimension}`, where NRRD has 1 to 16")))?;
    fields.required("sizes")?;
    let sizes: Vec<u64> = fields.numbers("sizes")?.unwrap_or_default();
    if let Some(axis) = sizes.iter().position(|s| *s == 0) {
        return Err(broken(format!("has 0 samples along its axis {axis}")));
    }
    one_per(sizes, n, "sizes", "axis")
}

/// The list, if it has an entry for each of `n`.
fn one_per<T>(list: Vec<T>, n: usize, field: &str, of: &str) -> Result<Vec<T>, LoadError> {
    if list.len() == n {
        return Ok(list);
    }
    Err(broken(format!("has {} entries in `{field}`, where each of {n} needs one: one per {of}", list.len())))
}

fn not_a_grid(message: String) -> LoadError {
    LoadError { code: "E0606", message, hint: Some("extract one value a voxel and three axes first".into()) }
}

struct Space {
    /// What turns the file's space into RAS+.
    signs: [f64; 3],
}

fn space(fields: &Fields) -> Result<Space, LoadError> {
    let Some(name) = fields.get("space") else {
        return match fields.integer("spacedimension")? {
            None | Some(3) => Ok(Space { signs: [1.0; 3] }),
            Some(n) => Err(not_a_grid(format!("lies in a space of {n} dimensions, where a grid has three"))),
        };
    };
    let signs = match name.trim().to_lowercase().as_str() {
        "right-anterior-superior" | "ras" => [1.0, 1.0, 1.0],
        "left-anterior-superior" | "las" => [-1.0, 1.0, 1.0],
        "left-posterior-superior" | "lps" => [-1.0, -1.0, 1.0],
        // No anatomy in these. A left-handed space would need a mirror, and nothing says which; it is taken as it is.
        "scanner-xyz" | "3d-right-handed" | "3d-left-handed" => [1.0; 3],
        other if other.ends_with("-time") || ["rast", "last", "lpst"].contains(&other) => {
            return Err(not_a_grid(format!("lies in the space `{name}`, where a grid has three axes and no time")));
        }
        _ => return Err(broken(format!("lies in the space `{name}`, which NRRD does not define"))),
    };
    Ok(Space { signs })
}

fn unit(name: &str, warnings: &mut Vec<LoadWarning>) -> Unit {
    Unit::from_name(name).unwrap_or_else(|| {
        if !matches!(name.trim(), "" | "???" | "none") {
            warnings.push(LoadWarning {
                code: "W0604",
                severity: Severity::Warning,
                message: format!("the unit of length `{name}` is not known, millimetres are taken"),
                hint: Some("write one of km, m, cm, mm, um, nm in the header".into()),
            });
        }
        Unit::MILLIMETRE
    })
}

/// `space directions` says which axes are spatial and how they lie.
fn directed_axes(sizes: &[u64], directions: Vec<Option<Vec<f64>>>) -> Result<Vec<Axis>, LoadError> {
    let mut axes = vec![];
    for ((number, direction), &size) in
        one_per(directions, sizes.len(), "space directions", "axis")?.into_iter().enumerate().zip(sizes)
    {
        match direction {
            Some(v) => match v.as_slice() {
                [x, y, z] => axes.push(Axis { size, step: [*x, *y, *z] }),
                _ => return Err(broken(format!("has a direction of {} numbers for its axis {number}", v.len()))),
            },
            None if size == 1 => {}
            None => {
                return Err(not_a_grid(format!("has {size} values a voxel (axis {number} has no direction in space)")));
            }
        }
    }
    if axes.is_empty() {
        return Err(not_a_grid("has no axis in space".into()));
    }
    Ok(axes)
}

/// Without directions the axes are x, y, z in their order; `kinds` may take some out. Steps come from `spacings`, else
/// from `axis mins` and `axis maxs`, else they are 1. The second result is the position of the first sample.
fn spaced_axes(
    fields: &Fields,
    sizes: &[u64],
    in_world_units: bool,
    warnings: &mut Vec<LoadWarning>,
) -> Result<(Vec<Axis>, [f64; 3]), LoadError> {
    let n = sizes.len();
    let per_axis = |name: &str| -> Result<Option<Vec<f64>>, LoadError> {
        fields.numbers(name)?.map(|list| one_per(list, n, name, "axis")).transpose()
    };
    let words = |name: &str| -> Result<Option<Vec<String>>, LoadError> {
        fields.words(name)?.map(|list| one_per(list, n, name, "axis")).transpose()
    };
    let (spacings, mins, maxs) = (per_axis("spacings")?, per_axis("axismins")?, per_axis("axismaxs")?);
    let (units, kinds, centers) = (words("units")?, words("kinds")?, words("centers")?);

    let mut chosen = vec![];
    for (axis, &size) in sizes.iter().enumerate() {
        let kind = kinds.as_ref().map_or(String::new(), |k| k[axis].to_lowercase());
        let spatial = matches!(kind.as_str(), "" | "domain" | "space" | "none" | "???");
        if spatial {
            chosen.push(axis);
        } else if size > 1 {
            return Err(not_a_grid(format!("has {size} values a voxel (its axis {axis} is of the kind `{kind}`)")));
        }
    }
    // More axes than space has are no harm as long as there is one sample along them.
    while chosen.len() > 3 {
        let Some(single) = chosen.iter().rposition(|axis| sizes[*axis] == 1) else { break };
        chosen.remove(single);
    }
    if chosen.is_empty() {
        return Err(not_a_grid("has no axis in space".into()));
    }

    let mut axes = vec![];
    let mut origin = [0.0; 3];
    for (slot, &axis) in chosen.iter().enumerate() {
        let size = sizes[axis];
        let node = centers.as_ref().is_some_and(|c| c[axis].eq_ignore_ascii_case("node"));
        let (min, max) = (mins.as_ref().map(|m| m[axis]), maxs.as_ref().map(|m| m[axis]));
        let spacing = match (spacings.as_ref(), min, max) {
            (Some(spacings), _, _) => spacings[axis],
            (None, Some(min), Some(max)) if node => (max - min) / (size.max(2) - 1) as f64,
            (None, Some(min), Some(max)) => (max - min) / size as f64,
            (None, _, _) => 1.0,
        };
        // The first sample of a cell-centred axis (the default) sits half a step inside its end.
        let first = min.map_or(0.0, |min| if node { min } else { min + spacing / 2.0 });
        let scale = match units.as_ref() {
            // In millimetres, the unit of a space without units.
            Some(units) if !in_world_units => unit(&units[axis], warnings).to_metres(1e3),
            _ => 1.0,
        };
        if slot < 3 {
            origin[slot] = if first.is_finite() { first * scale } else { 0.0 };
        }
        let mut step = [0.0; 3];
        if let Some(component) = step.get_mut(slot) {
            *component = spacing * scale;
        }
        axes.push(Axis { size, step });
    }
    Ok((axes, origin))
}

/// Steps for all three axes: what a file of one or two axes leaves open becomes a unit step across the others.
fn complete(axes: &[Axis]) -> [[f64; 3]; 3] {
    let given = |n: usize| axes.get(n).map(|a| a.step);
    let across = |a: [f64; 3], b: [f64; 3]| affine::unit_vector(affine::cross(a, b)).unwrap_or([0.0; 3]);
    let x = given(0).unwrap_or([1.0, 0.0, 0.0]);
    let y = given(1).unwrap_or_else(|| {
        // Across the coordinate axis that lies least along x.
        let least = (0..3).min_by(|a, b| x[*a].abs().total_cmp(&x[*b].abs())).unwrap_or(0);
        let mut helper = [0.0; 3];
        helper[least] = 1.0;
        across(helper, x)
    });
    let z = given(2).unwrap_or_else(|| across(x, y));
    [x, y, z]
}
