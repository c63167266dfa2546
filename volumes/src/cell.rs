//! One cell of a grid that an iso-surface crosses: its polygons, and the way onto the surface.
//!
//! Cell coordinates run from 0 to 1 along the grid's axes; bit a of a corner's number says upper along axis a.

use std::sync::LazyLock;

use glam::{DMat3, DVec3};

/// The corners of an edge: lower, upper, by axis.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

/// The corners of each face, counter-clockwise seen from outside the cell; lower and upper face by axis.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Faces that lie on a side of the grid, as bits 2·axis + upper; the mask of corners on each.
pub(crate) const FACE_CORNERS: [u8; 6] = {
    let mut masks = [0; 6];
    let mut face = 0;
    while face < 24 {
        masks[face / 4] |= 1 << FACES[face / 4][face % 4];
        face += 1;
    }
    masks
};

/// How far outside its cell a surfel may be moved along the gradient, in steps of the grid.
const REACH: f64 = 0.1;
/// Where a root is taken as found, in steps of the grid.
const ROOT_TOLERANCE: f64 = 1e-7;

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
    fn crossing(&self, edge: u8) -> DVec3 {
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

    /// The trilinear interpolant and its gradient in cell coordinates.
    pub(crate) fn interpolate(&self, p: DVec3) -> (f64, DVec3) {
        let v = &self.0;
        let lerp = |a: f64, b: f64, t: f64| a + t * (b - a);
        let along_x =
            [lerp(v[0], v[1], p.x), lerp(v[2], v[3], p.x), lerp(v[4], v[5], p.x), lerp(v[6], v[7], p.x)];
        let (low, high) = (lerp(along_x[0], along_x[1], p.y), lerp(along_x[2], along_x[3], p.y));
        let dx = lerp(lerp(v[1] - v[0], v[3] - v[2], p.y), lerp(v[5] - v[4], v[7] - v[6], p.y), p.z);
        let dy = lerp(along_x[1] - along_x[0], along_x[3] - along_x[2], p.z);
        (lerp(low, high, p.z), DVec3::new(dx, dy, high - low))
    }

    /// Moves `start`, inside the cell, onto the interpolant's zero: along the gradient (steepest in the world)
    /// as far as a tenth of a step outside the cell, or, if the zero is not there, towards the nearest corner
    /// on the other side, where it must be.
    pub(crate) fn onto_surface(&self, start: DVec3, gradients_to_world: DMat3) -> DVec3 {
        let (value, gradient) = self.interpolate(start);
        if value == 0.0 {
            return start;
        }
        // The way back from the world to the cell is the transpose of what takes gradients there.
        let direction = gradients_to_world.transpose() * (gradients_to_world * gradient) * -value.signum();
        let reach = (0..3).fold(f64::INFINITY, |reach, axis| {
            let bound = if direction[axis] > 0.0 { 1.0 + REACH } else { -REACH };
            if direction[axis] == 0.0 { reach } else { reach.min((bound - start[axis]) / direction[axis]) }
        });
        let end = start + direction * reach;
        if end.is_finite() && self.interpolate(end).0 * value <= 0.0 {
            return self.root(start, end);
        }
        let other = |corner: &usize| (self.0[*corner] >= 0.0) != (value >= 0.0);
        let distance = |corner: usize| corner_position(corner).distance_squared(start);
        match (0..8).filter(other).min_by(|&a, &b| distance(a).total_cmp(&distance(b))) {
            Some(corner) => self.root(start, corner_position(corner)),
            None => start,
        }
    }

    /// A zero between two points at which the interpolant's signs differ: Newton steps, bisection where they
    /// leave the bracket.
    fn root(&self, start: DVec3, end: DVec3) -> DVec3 {
        let way = end - start;
        let tolerance = ROOT_TOLERANCE / way.length();
        let positive_start = self.interpolate(start).0 >= 0.0;
        let (mut low, mut high, mut t) = (0.0, 1.0, 0.0);
        for _ in 0..64 {
            let (value, gradient) = self.interpolate(start + way * t);
            if (value >= 0.0) == positive_start {
                low = t;
            } else {
                high = t;
            }
            let newton = t - value / gradient.dot(way);
            let following = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let moved = (following - t).abs();
            t = following;
            if moved <= tolerance {
                break;
            }
        }
        start + way * t
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn corner_position(corner: usize) -> DVec3 {
    DVec3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_crossed_edge_is_in_one_loop() {
        for (mask, loops) in LOOPS.iter().enumerate() {
            let mut seen = [0; 12];
            for edges in loops.iter() {
                assert!(edges.len() >= 3, "mask {mask:08b}");
                edges.iter().for_each(|&edge| seen[usize::from(edge)] += 1);
            }
            for (edge, (a, b)) in EDGES.into_iter().enumerate() {
                assert_eq!(seen[edge], (mask >> a ^ mask >> b) & 1, "mask {mask:08b}, edge {edge}");
            }
        }
    }

    #[test]
    fn polygons_face_the_lower_values() {
        for corner in 0..8 {
            let mut values = [-1.0; 8];
            values[corner] = 1.0;
            let cell = Cell(values);
            for steps in [DMat3::IDENTITY, DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 2.0))] {
                let edges = LOOPS[1 << corner].iter().next().unwrap();
                let polygon = cell.polygon(edges, steps).unwrap();
                let outwards = steps * (DVec3::splat(0.5) - corner_position(corner));
                assert!(polygon.vector_area.dot(outwards) > 0.0, "corner {corner}");
            }
        }
    }

    #[test]
    fn faces_are_counter_clockwise_from_outside() {
        for (face, corners) in FACES.into_iter().enumerate() {
            let [a, b, c, _] = corners.map(corner_position);
            let normal = (b - a).cross(c - b);
            let mut outwards = DVec3::ZERO;
            outwards[face / 2] = if face % 2 == 1 { 1.0 } else { -1.0 };
            assert_eq!(normal, outwards, "face {face}");
        }
    }

    #[test]
    fn the_way_onto_the_surface_ends_on_it() {
        // A saddle whose gradient at the centre is zero, and a field that is zero far along its gradient.
        for values in [
            [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -0.9],
            [1e-3, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1e3],
            [1e3, -1e-3, 1.0, 1.0, 2.0, 3.0, 5.0, 7.0],
        ] {
            let cell = Cell(values);
            let mask = values.iter().enumerate().map(|(c, v)| usize::from(*v >= 0.0) << c).sum::<usize>();
            for edges in LOOPS[mask].iter() {
                let polygon = cell.polygon(edges, DMat3::IDENTITY).unwrap();
                let p = cell.onto_surface(polygon.centroid, DMat3::IDENTITY);
                let (value, gradient) = cell.interpolate(p);
                assert!(value.abs() <= 1e-6 * gradient.length(), "{values:?}: {value} at {p}");
                assert!(p.min_element() >= -REACH && p.max_element() <= 1.0 + REACH, "{values:?}: {p}");
            }
        }
    }
}
