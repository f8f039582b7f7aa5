//! The PLY files of the code by Kerbl et al.: of the element `vertex`, the numbers `x y z`, `f_dc_0..2`, `f_rest_*` (all of
//! red, then all of green, then all of blue), `opacity` (a logit), `scale_0..2` (natural logarithms) and `rot_0..3`
//! (w, x, y, z, of any length). Normals and everything else are skipped by their types.

use super::{Builder, CODES, Gaussian, broken, coefficients, no_splats, too_many};
use crate::data::ply::{Element, Header};
use compiler::loader::LoadError;
use std::io::BufRead;

/// Where the numbers of a splat go, in one list: centre, colour, opacity, deviations, rotation, then the harmonics.
const REST: usize = 14;

/// The names of the first numbers, in that order.
const NAMES: [&str; REST] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
    "rot_3",
];

fn place(property: &str) -> Option<usize> {
    let rest = || property.strip_prefix("f_rest_")?.parse::<usize>().ok().map(|n| REST.saturating_add(n));
    NAMES.iter().position(|n| *n == property).or_else(rest)
}

/// Where each number of a splat goes, and the degree of the harmonics.
fn layout(element: &Element) -> Result<(Vec<Option<usize>>, u8), LoadError> {
    let places: Vec<Option<usize>> =
        element.properties.iter().map(|p| place(&p.name).filter(|_| !p.is_list())).collect();
    if let Some(lacking) = (0..REST).find(|i| !places.contains(&Some(*i))) {
        return Err(no_splats(
            format!("has no `{}` at its points", NAMES[lacking]),
            "it may be a mesh (`surface { shape = mesh(\"…\") }`) or a plain cloud of points, which is not drawn",
        ));
    }
    let rest = places.iter().flatten().filter(|p| **p >= REST).count();
    let degree = (0..=4).find(|d| 3 * (coefficients(*d) - 1) == rest);
    let complete = (REST..REST + rest).all(|i| places.contains(&Some(i)));
    match degree {
        Some(degree) if complete => Ok((places, degree)),
        _ => Err(broken(format!("has {rest} coefficients `f_rest_`, which no degree of spherical harmonics has"))),
    }
}

/// `length` is that of the whole file in bytes.
pub(super) fn read(mut reader: impl BufRead, length: u64) -> Result<Builder, LoadError> {
    let once = |element: &str, property: &str| element == "vertex" && place(property).is_some();
    let header = Header::read(&mut reader, length, CODES, once)?;
    let Some(points) = header.elements.iter().position(|e| e.name == "vertex") else {
        return Err(no_splats("has no element `vertex`", "use the PLY files of 3D Gaussian splatting"));
    };
    let (places, degree) = layout(&header.elements[points])?;
    if header.elements[points].count > super::MAX_SPLATS as u64 {
        return Err(too_many());
    }
    let mut builder = Builder::new(degree, false);
    let n = coefficients(degree);
    let mut numbers = vec![0.0; REST + 3 * (n - 1)];
    let mut harmonics = vec![0.0; 3 * n];
    let mut body = header.body(reader, CODES);
    // What follows the points does not matter.
    for (at, element) in header.elements[..=points].iter().enumerate() {
        for i in 0..element.count {
            let place = || format!("{} {i}", element.name);
            body.start(&place)?;
            for (k, property) in element.properties.iter().enumerate() {
                let target = if at == points { places[k] } else { None };
                body.property(property, &place, |value| {
                    if let Some(target) = target {
                        numbers[target] = value;
                    }
                    Ok(())
                })?;
            }
            if at == points {
                push(&mut builder, &numbers, &mut harmonics)?;
            }
        }
    }
    Ok(builder)
}

fn push(builder: &mut Builder, numbers: &[f64], harmonics: &mut [f64]) -> Result<(), LoadError> {
    let three = |from: usize| [numbers[from], numbers[from + 1], numbers[from + 2]];
    harmonics[..3].copy_from_slice(&numbers[3..6]);
    let above = harmonics.len() / 3 - 1;
    for k in 0..above {
        for channel in 0..3 {
            harmonics[3 * (k + 1) + channel] = numbers[REST + channel * above + k];
        }
    }
    builder.push(&Gaussian {
        center: three(0),
        opacity: 1.0 / (1.0 + (-numbers[6]).exp()),
        deviations: three(7).map(f64::exp),
        rotation: [numbers[10], numbers[11], numbers[12], numbers[13]],
        harmonics,
    })
}
