//! The triangles of a mesh in one space: relative to its middle, in sides of the cells of a lattice.

use crate::mesh::{Mesh, Primitive};
use crate::sight::Sight;
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

/// A primitive's vertices in sides of a cell.
pub(crate) struct Part<'a> {
    pub(crate) primitive: &'a Primitive,
    positions: Vec<DVec3>,
    /// Unit normals, or zero where the file has none that can be used.
    pub(crate) normals: Option<Vec<Vec3>>,
    /// A mirroring transform turns the triangles over; they are turned back.
    mirrored: bool,
}

/// A triangle with area.
#[derive(Clone, Copy)]
pub(crate) struct Facet {
    /// Its part and its number in the part.
    pub(crate) part: u32,
    pub(crate) triangle: u32,
    /// Outward unit normal.
    pub(crate) normal: Vec3,
    /// In squared cells.
    pub(crate) area: f32,
}

/// The triangles of a mesh that have area, all or those that are seen.
pub(crate) struct Facets<'a> {
    /// Where the origin is, and the side of a cell, in mesh units.
    pub(crate) middle: DVec3,
    pub(crate) cell: f64,
    pub(crate) parts: Vec<Part<'a>>,
    pub(crate) facets: Vec<Facet>,
}

impl<'a> Facets<'a> {
    /// Places a checked mesh: `middle` becomes the origin, `cell` (mesh units) becomes 1.
    pub(crate) fn new(mesh: &'a Mesh, (middle, cell): (DVec3, f64), sight: Option<&Sight>) -> Self {
        let sees =
            |corners: [DVec3; 3]| sight.is_none_or(|sight| sight.sees(corners.map(|p| p * cell + middle)));
        let parts: Vec<Part> = mesh.primitives.iter().map(|p| Part::new(p, middle, cell)).collect();
        let mut facets = Vec::new();
        for (index, part) in parts.iter().enumerate() {
            let found = (0..part.primitive.triangles.len() as u32).into_par_iter().filter_map(|triangle| {
                let [a, b, c] = part.corners(triangle);
                let double = (b - a).cross(c - a);
                let area = (double.length() / 2.0) as f32;
                let normal = double.try_normalize()?.as_vec3();
                (area > 0.0 && sees([a, b, c])).then_some(Facet {
                    part: index as u32,
                    triangle,
                    normal,
                    area,
                })
            });
            facets.append(&mut found.collect());
        }
        Self { middle, cell, parts, facets }
    }

    /// A facet's corners, counter-clockwise seen from outside.
    pub(crate) fn corners(&self, facet: &Facet) -> [DVec3; 3] {
        self.parts[facet.part as usize].corners(facet.triangle)
    }
}

impl<'a> Part<'a> {
    fn new(primitive: &'a Primitive, middle: DVec3, cell: f64) -> Self {
        let to_mesh = primitive.primitive_to_mesh;
        let place = |p: &Vec3| (to_mesh.transform_point3(p.as_dvec3()) - middle) / cell;
        let determinant = to_mesh.matrix3.determinant();
        // Normals are covectors: the cofactors carry them, and stay finite where the inverse is not.
        let cofactors = cofactors(to_mesh.matrix3) * determinant.signum();
        let turn = |n: &Vec3| {
            let unit = (cofactors * n.as_dvec3()).try_normalize();
            unit.map_or(Vec3::ZERO, DVec3::as_vec3)
        };
        Self {
            primitive,
            positions: primitive.positions.par_iter().map(place).collect(),
            normals: primitive.normals.as_ref().map(|normals| normals.par_iter().map(turn).collect()),
            mirrored: determinant < 0.0,
        }
    }

    /// The vertices of a triangle, counter-clockwise seen from outside.
    pub(crate) fn vertices(&self, triangle: u32) -> [usize; 3] {
        let [a, b, c] = self.primitive.triangles[triangle as usize].map(|index| index as usize);
        if self.mirrored { [a, c, b] } else { [a, b, c] }
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.vertices(triangle).map(|vertex| self.positions[vertex])
    }
}

fn cofactors(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}
