//! Parts polygons at the planes of a cubic lattice of side 1.

use glam::{DVec3, UVec3};

/// Polygons on a stack: a part lies above what it is a part of.
#[derive(Default)]
pub(crate) struct Divider(Vec<DVec3>);

impl Divider {
    /// Visits the cells that a triangle goes through, of those from `low` to `high`, with what lies in each: the corners
    /// of a convex polygon, in the triangle's sense of rotation. Together the polygons are the triangle, or what of it lies in these cells.
    pub(crate) fn divide(
        &mut self,
        triangle: [DVec3; 3],
        [low, high]: [UVec3; 2],
        visit: &mut impl FnMut(UVec3, &[DVec3]),
    ) {
        self.0.clear();
        self.0.extend(triangle);
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
        // Roundings don't lead beyond the planes that were cut at.
        let [first, last] = [least, most].map(|p| p.floor().as_uvec3().clamp(low, high));
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
                let mut on = from.lerp(to, a / (a - b));
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
