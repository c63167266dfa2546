//! Parts polygons at the planes of a cubic lattice of side 1.

use glam::{DVec3, UVec3};

/// Polygons on a stack: a part lies above what it is a part of.
#[derive(Default)]
pub(crate) struct Divider(Vec<DVec3>);

impl Divider {
    /// Visits the cells that a convex polygon goes through, of those from `low` to `high`, with what lies in each: the corners of
    /// a convex polygon, in the same sense of rotation. Together the parts are the whole, or what of it lies in these cells.
    pub(crate) fn divide(
        &mut self,
        polygon: &[DVec3],
        [low, high]: [UVec3; 2],
        visit: &mut impl FnMut(UVec3, &[DVec3]),
    ) {
        self.0.clear();
        self.0.extend(polygon);
        let mut begin = 0;
        for axis in 0..3 {
            for (plane, above) in [(low[axis], true), (high[axis] + 1, false)] {
                let plane = f64::from(plane);
                if self.0[begin..].iter().any(|p| (p[axis] < plane) == above) {
                    begin = self.cut(begin, (axis, plane), above);
                }
            }
        }
        self.parts(begin, [low, high], visit);
    }

    /// Visits the cells of the polygon on top of the stack, which begins at `begin`.
    fn parts(&mut self, begin: usize, [low, high]: [UVec3; 2], visit: &mut impl FnMut(UVec3, &[DVec3])) {
        let polygon = &self.0[begin..];
        if polygon.len() < 3 {
            return;
        }
        let least = polygon.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let most = polygon.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        // Nothing lies below 0, so that this is the floor; roundings don't lead beyond the planes that were cut at.
        let [first, last] = [least, most].map(|p| p.as_uvec3().clamp(low, high));
        let steps = last - first;
        let longest = steps.max_element();
        if longest == 0 {
            return visit(first, polygon);
        }
        let axis = (0..3).find(|&axis| steps[axis] == longest).unwrap_or_default();
        let plane = first[axis] + longest.div_ceil(2);
        let (mut below, mut above) = (last, first);
        below[axis] = plane - 1;
        above[axis] = plane;
        for (bounds, is_above) in [([first, below], false), ([above, last], true)] {
            let part = self.cut(begin, (axis, f64::from(plane)), is_above);
            self.parts(part, bounds, visit);
            self.0.truncate(part);
        }
    }

    /// Puts the part of the polygon on top of the stack that lies above a plane, or below it, on the stack; returns where it begins.
    /// Both sides get the same corners on the plane.
    fn cut(&mut self, begin: usize, (axis, plane): (usize, f64), above: bool) -> usize {
        let end = self.0.len();
        let Some(&(mut from)) = self.0[begin..].last() else { return end };
        for index in begin..end {
            let to = self.0[index];
            let (a, b) = (from[axis] - plane, to[axis] - plane);
            if (a < 0.0) != (b < 0.0) {
                // Of two equal numbers exactly that number: what lies on a plane of the lattice stays on it (`lerp` may round off it).
                let mut on = from + (to - from) * (a / (a - b));
                on[axis] = plane;
                self.0.push(on);
            }
            if (b >= 0.0) == above {
                self.0.push(to);
            }
            from = to;
        }
        end
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Cells along an axis.
    const SIDE: u32 = 6;

    fn area(polygon: &[DVec3]) -> f64 {
        let [first, rest @ ..] = polygon else { return 0.0 };
        rest.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum::<DVec3>().length() / 2.0
    }

    /// The cells of a box that a triangle goes through, and the area of what lies in each.
    fn parts(triangle: [DVec3; 3], cells: [UVec3; 2]) -> Vec<(UVec3, f64)> {
        let mut found = Vec::new();
        let facing = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).normalize_or_zero();
        Divider::default().divide(&triangle, cells, &mut |cell, polygon| {
            for corner in polygon {
                let inside = (corner - cell.as_dvec3()).cmpge(DVec3::splat(-1e-12))
                    & (corner - cell.as_dvec3()).cmple(DVec3::splat(1.0 + 1e-12));
                assert!(inside.all(), "{corner} is not in {cell}");
            }
            for pair in polygon[1..].windows(2) {
                let normal = (pair[0] - polygon[0]).cross(pair[1] - polygon[0]);
                assert!(normal.dot(facing) > -1e-12, "turned round");
            }
            found.push((cell, area(polygon)));
        });
        found.sort_by_key(|(cell, _)| cell.to_array());
        found
    }

    /// Corners that are often on planes of the lattice, though not on its last: what lies on a plane is of the cell above.
    fn corner() -> impl Strategy<Value = DVec3> {
        let along = || prop_oneof![0.0..f64::from(SIDE), (0..SIDE).prop_map(f64::from)];
        [along(), along(), along()].prop_map(DVec3::from)
    }

    /// The parts are the triangle, each in a cell of its own.
    fn parts_make_the_whole(triangle: [DVec3; 3]) {
        let all = [UVec3::ZERO, UVec3::splat(SIDE - 1)];
        let found = parts(triangle, all);
        assert!(found.windows(2).all(|pair| pair[0].0 != pair[1].0));
        // Each of some hundred places is off by a few roundings of 6.
        let sum: f64 = found.iter().map(|(_, area)| area).sum();
        assert!((sum - area(&triangle)).abs() < 1e-12);
        // A cell asked alone has the same of it.
        for index in 0..SIDE.pow(3) {
            let cell = UVec3::new(index / SIDE.pow(2), index / SIDE % SIDE, index % SIDE);
            let of_cell = |parts: &[(UVec3, f64)]| {
                parts.iter().filter(|(own, _)| *own == cell).map(|(_, area)| area).sum::<f64>()
            };
            let alone = parts(triangle, [cell, cell]);
            assert!((of_cell(&alone) - of_cell(&found)).abs() < 1e-12);
            assert!(alone.iter().all(|(own, _)| *own == cell));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn parts_are_the_triangle_each_in_a_cell_of_its_own(a in corner(), b in corner(), c in corner()) {
            parts_make_the_whole([a, b, c]);
        }
    }

    #[test]
    fn a_triangle_on_a_plane_of_the_lattice_stays_on_it() {
        // `lerp` puts cuts of this one off the plane that it lies on.
        let corners = [(4.864126988025673, 5.581796995396889), (4.207132978864452, 0.0), (0.0, 0.0)];
        parts_make_the_whole(corners.map(|(x, y)| DVec3::new(x, y, 5.0)));
    }

    #[test]
    fn a_square_along_the_lattice_is_parted_into_squares() {
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.5);
        let all = [UVec3::ZERO, UVec3::splat(3)];
        let halves = [[at(0.5, 0.5), at(3.5, 0.5), at(3.5, 3.5)], [at(0.5, 0.5), at(3.5, 3.5), at(0.5, 3.5)]];
        let mut found = [[0.0; 4]; 4];
        for (cell, area) in halves.into_iter().flat_map(|triangle| parts(triangle, all)) {
            assert_eq!(cell.z, 0);
            found[cell.x as usize][cell.y as usize] += area;
        }
        let along = [0.5, 1.0, 1.0, 0.5];
        assert_eq!(found, along.map(|x| along.map(|y| x * y)));
    }
}
