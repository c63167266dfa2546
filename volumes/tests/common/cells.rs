//! Marching cubes' polygons in f64, cell by cell: what iso-surfels are compared with.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::sync::LazyLock;

use glam::{DMat3, DVec3};
use oblate_volumes::Volume;

/// The corners of an edge: lower, upper, by axis.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

/// The corners of each face, counter-clockwise seen from outside the cell; lower and upper face by axis.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// The closed polygons of edge crossings of a cell.
#[derive(Clone, Copy, Default)]
pub(crate) struct Loops {
    edges: [u8; 12],
    /// Where each loop ends among the edges; unused ones repeat the last.
    ends: [u8; 4],
}

impl Loops {
    /// The loops' edges, one loop after the other.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &[u8]> {
        let begins = [0, self.ends[0], self.ends[1], self.ends[2]];
        begins
            .into_iter()
            .zip(self.ends)
            .filter(|(begin, end)| begin < end)
            .map(|(begin, end)| &self.edges[usize::from(begin)..usize::from(end)])
    }
}

/// Loops for every set of inside corners (bit c: corner c).
///
/// On each face a run of neighbouring inside corners is cut off by one segment. On a face whose inside corners
/// are diagonal that is one segment for each, so they are parted there, from both sides alike: polygons of
/// neighbouring cells always meet, and a cell has as many polygons as the surface has sheets in it.
/// (Where the interpolant joins such corners instead the polygons differ from it by less than a cell.)
pub(crate) static LOOPS: LazyLock<[Loops; 256]> = LazyLock::new(|| std::array::from_fn(loops_of));

fn loops_of(mask: usize) -> Loops {
    let inside = |corner: usize| mask >> corner & 1 == 1;
    let edge_between =
        |a: usize, b: usize| EDGES.iter().position(|&e| e == (a.min(b), a.max(b))).unwrap_or(0);
    // Every crossed edge is entered on one of its faces and left on the other, so `next` is a permutation.
    let mut next = [None; 12];
    for face in FACES {
        for entry in 0..4 {
            if inside(face[entry]) || !inside(face[(entry + 1) % 4]) {
                continue;
            }
            let mut last = entry + 1;
            while inside(face[(last + 1) % 4]) {
                last += 1;
            }
            let entered = edge_between(face[entry], face[(entry + 1) % 4]);
            let left = edge_between(face[last % 4], face[(last + 1) % 4]);
            next[entered] = Some(left);
        }
    }
    let mut loops = Loops::default();
    let (mut length, mut count) = (0, 0);
    for start in 0..12 {
        let mut edge = start;
        while let Some(following) = next[edge].take() {
            loops.edges[length] = edge as u8;
            length += 1;
            edge = following;
        }
        if count < 4 && length > usize::from(if count == 0 { 0 } else { loops.ends[count - 1] }) {
            loops.ends[count..].fill(length as u8);
            count += 1;
        }
    }
    loops
}

/// The polygon of a loop of crossings.
pub(crate) struct Polygon {
    /// Centroid by area in cell coordinates.
    pub(crate) centroid: DVec3,
    /// Area in squared world units.
    pub(crate) area: f64,
    /// Sum of the vector areas of its triangles in the world; points to values below the iso-value.
    pub(crate) vector_area: DVec3,
    /// Covariance of its points about the centroid, by area, in squared world units.
    pub(crate) covariance: DMat3,
}

/// A cell's eight values, relative to the iso-value, by corner.
pub(crate) struct Cell(pub(crate) [f64; 8]);

impl Cell {
    /// Where the linear interpolant on an edge is zero.
    pub(crate) fn crossing(&self, edge: u8) -> DVec3 {
        let (lower, upper) = EDGES[usize::from(edge)];
        let (a, b) = (self.0[lower], self.0[upper]);
        corner_position(lower).lerp(corner_position(upper), (a / (a - b)).clamp(0.0, 1.0))
    }

    /// The polygon through the crossings of `edges`, a fan of triangles around their mean; `None` if it has no
    /// area, as where the surface only touches a corner. `steps` takes cell coordinates to the world.
    pub(crate) fn polygon(&self, edges: &[u8], steps: DMat3) -> Option<Polygon> {
        let mut vertices = [DVec3::ZERO; 12];
        let mut mean = DVec3::ZERO;
        for (vertex, &edge) in vertices.iter_mut().zip(edges) {
            *vertex = self.crossing(edge);
            mean += *vertex / edges.len() as f64;
        }
        let orientation = steps.determinant().signum();
        let (mut area, mut moment, mut vector_area) = (0.0, DVec3::ZERO, DVec3::ZERO);
        let mut second_moment = DMat3::ZERO;
        for (index, &vertex) in vertices[..edges.len()].iter().enumerate() {
            let following = vertices[(index + 1) % edges.len()];
            let (a, b) = (steps * (vertex - mean), steps * (following - mean));
            let twice = a.cross(b);
            let part = 0.5 * twice.length();
            area += part;
            moment += part / 3.0 * (vertex + following - 2.0 * mean);
            vector_area += 0.5 * orientation * twice;
            // ∫ x xᵀ over the triangle 0, a, b.
            second_moment += (outer(a, a) + outer(b, b) + outer(a + b, a + b)) * (part / 12.0);
        }
        let (offset, in_world) = (moment / area, steps * moment / area);
        (area > 0.0 && area as f32 > 0.0).then(|| Polygon {
            centroid: mean + offset,
            area,
            vector_area,
            covariance: second_moment * area.recip() - outer(in_world, in_world),
        })
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn corner_position(corner: usize) -> DVec3 {
    DVec3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64)
}

/// A polygon of a volume, its centroid and vertices in the world.
pub(crate) struct Found {
    pub(crate) cell: [usize; 3],
    pub(crate) polygon: Polygon,
    pub(crate) centroid: DVec3,
    pub(crate) vertices: Vec<DVec3>,
}

/// All polygons of a volume's surface at `iso`.
pub(crate) fn polygons(volume: &Volume, iso: f32) -> Vec<Found> {
    let [nx, ny, nz] = volume.dims();
    let (steps, to_world) = (volume.steps(), volume.index_to_world());
    let mut found = Vec::new();
    for index in 0..(nx - 1) * (ny - 1) * (nz - 1) {
        let cell = [index % (nx - 1), index / (nx - 1) % (ny - 1), index / (nx - 1) / (ny - 1)];
        let value = |corner: usize| {
            let at = [0, 1, 2].map(|axis| cell[axis] + (corner >> axis & 1));
            f64::from(volume.value(at)) - f64::from(iso)
        };
        let values = Cell([0, 1, 2, 3, 4, 5, 6, 7].map(value));
        if values.0.iter().any(|v| !v.is_finite()) {
            continue;
        }
        let mask = (0..8).filter(|&c| values.0[c] >= 0.0).map(|c| 1 << c).sum::<usize>();
        let corner = DVec3::from(cell.map(|i| i as f64));
        let in_world = |p: DVec3| to_world.transform_point3(corner + p);
        for edges in LOOPS[mask].iter() {
            let Some(polygon) = values.polygon(edges, steps) else { continue };
            let vertices = edges.iter().map(|&edge| in_world(values.crossing(edge))).collect();
            found.push(Found { cell, centroid: in_world(polygon.centroid), polygon, vertices });
        }
    }
    found
}
