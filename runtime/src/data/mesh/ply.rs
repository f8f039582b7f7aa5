//! Triangles of PLY files: of the elements, `vertex` (scalars `x`, `y`, `z` of any type) and `face` (a list
//! `vertex_indices` or `vertex_index`) are used; all others are skipped by their types.

use super::soup::{Soup, index_error};
use super::{CODES, broken};
use crate::data::ply::{Element, Header, whole};
use compiler::loader::LoadError;
use std::io::BufRead;

/// What the values of a property are for.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
enum Role {
    Coordinate(usize),
    Corners,
    Nothing,
}

impl Role {
    fn of(element: &str, property: &str) -> Self {
        match (element, property) {
            ("vertex", "x") => Self::Coordinate(0),
            ("vertex", "y") => Self::Coordinate(1),
            ("vertex", "z") => Self::Coordinate(2),
            ("face", "vertex_indices" | "vertex_index") => Self::Corners,
            _ => Self::Nothing,
        }
    }
}

fn roles(element: &Element) -> Result<Vec<Role>, LoadError> {
    let role = |p: &crate::data::ply::Property| {
        let role = Role::of(&element.name, &p.name);
        // Coordinates are single numbers, corners are lists.
        if p.is_list() == (role == Role::Corners) { role } else { Role::Nothing }
    };
    let roles: Vec<Role> = element.properties.iter().map(role).collect();
    if element.name == "vertex" && !(0..3).all(|axis| roles.contains(&Role::Coordinate(axis))) {
        return Err(broken("has corners without `x`, `y` and `z`"));
    }
    if roles.iter().filter(|r| **r == Role::Corners).count() > 1 {
        return Err(broken("has the corners of its faces twice"));
    }
    Ok(roles)
}

/// `length` is that of the whole file in bytes.
pub(super) fn read(mut reader: impl BufRead, length: u64) -> Result<Soup, LoadError> {
    let once = |element: &str, property: &str| Role::of(element, property) != Role::Nothing;
    let header = Header::read(&mut reader, length, CODES, once)?;
    let roles = header.elements.iter().map(roles).collect::<Result<Vec<_>, _>>()?;
    let mut soup = Soup::default();
    let mut body = header.body(reader, CODES);
    let mut corners = vec![];
    for (element, roles) in header.elements.iter().zip(&roles) {
        let is_vertex = element.name == "vertex";
        for n in 0..element.count {
            let place = || format!("{} {n}", element.name);
            body.start(&place)?;
            let mut position = [0.0; 3];
            corners.clear();
            for (property, role) in element.properties.iter().zip(roles) {
                body.property(property, &place, |value| {
                    match role {
                        Role::Coordinate(axis) => position[*axis] = value,
                        Role::Corners => corners.push(
                            whole(value).ok_or_else(|| index_error(format!("names corner {value} in {}", place())))?,
                        ),
                        Role::Nothing => {}
                    }
                    Ok(())
                })?;
            }
            if is_vertex {
                soup.corner(position)?;
            } else {
                soup.polygon(&corners, place)?;
            }
        }
    }
    Ok(soup)
}
