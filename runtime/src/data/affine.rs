//! Maps from voxel index to world space, and the check that one can be inverted.

use compiler::loader::LoadError;

/// A unit of length as an exact quotient: `metres = x · multiply / divide`. Dividing by 1000 rounds once where
/// multiplying by 0.001 would round twice.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) struct Unit {
    multiply: f64,
    divide: f64,
}

impl Unit {
    pub(super) const METRE: Self = Self { multiply: 1.0, divide: 1.0 };
    pub(super) const MILLIMETRE: Self = Self { multiply: 1.0, divide: 1e3 };
    pub(super) const MICROMETRE: Self = Self { multiply: 1.0, divide: 1e6 };

    /// The unit of this name, in any of its usual spellings.
    pub(super) fn from_name(name: &str) -> Option<Self> {
        let unit = |multiply, divide| Some(Self { multiply, divide });
        match name.trim().to_lowercase().as_str() {
            "km" | "kilometer" | "kilometers" | "kilometre" | "kilometres" => unit(1e3, 1.0),
            "m" | "meter" | "meters" | "metre" | "metres" => Some(Self::METRE),
            "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => unit(1.0, 1e2),
            "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(Self::MILLIMETRE),
            // The micro sign and the Greek letter are two characters.
            "um" | "\u{b5}m" | "\u{3bc}m" | "micron" | "microns" | "micrometer" | "micrometers" | "micrometre"
            | "micrometres" => Some(Self::MICROMETRE),
            "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => unit(1.0, 1e9),
            _ => None,
        }
    }

    pub(super) fn to_metres(self, x: f64) -> f64 {
        x * self.multiply / self.divide
    }
}

/// Columns are the steps along the three index axes, then the position of voxel (0,0,0).
pub(super) fn from_columns(steps: [[f64; 3]; 3], origin: [f64; 3]) -> [[f64; 4]; 3] {
    std::array::from_fn(|row| [steps[0][row], steps[1][row], steps[2][row], origin[row]])
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The vector divided by its length, if it has one that f64 can hold.
pub(super) fn unit_vector(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    (length.is_finite() && length > 0.0).then(|| v.map(|x| x / length))
}

/// Refuses maps that are not finite or that flatten the grid.
///
/// # Errors
/// `E0607`, naming the number or the axis at fault.
pub(super) fn check(map: &[[f64; 4]; 3]) -> Result<(), LoadError> {
    let refuse = |message: String| {
        let hint = "correct the orientation in the header: spacing and axes of the grid in space".to_string();
        Err(LoadError { code: "E0607", message, hint: Some(hint) })
    };
    if let Some(bad) = map.iter().flatten().find(|x| !x.is_finite()) {
        return refuse(format!("has {bad} in the map from voxels to space"));
    }
    let mut unit = [[0.0; 3]; 3];
    for (axis, slot) in unit.iter_mut().enumerate() {
        match unit_vector([map[0][axis], map[1][axis], map[2][axis]]) {
            Some(v) => *slot = v,
            None => return refuse(format!("has no usable spacing along its axis {axis}")),
        }
    }
    // Of unit columns, so that spacings of 1:1000 or a grid of nanometres do not count as flat.
    let c = cross(unit[0], unit[1]);
    let volume = (c[0] * unit[2][0] + c[1] * unit[2][1] + c[2] * unit[2][2]).abs();
    if volume < 1e-9 {
        return refuse("has axes that lie in one plane, so that its map from voxels to space has no inverse".into());
    }
    Ok(())
}
