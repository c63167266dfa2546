//! Which kernels reach points: boxes around those of a k-d tree's ranges.

use glam::Vec3;
use std::ops::Range;

use oblate_engine::neighbors::{Leaf, Tree};

/// Kernels that are taken together.
const LEAF: usize = 8;

/// A box: its corners.
type Corners = [Vec3; 2];

/// Boxes of kernels, by the tree of their centres: that of each range is kept at the range's middle.
pub(super) struct Supports {
    /// Numbers of kernels, in the tree's order.
    pub(super) order: Vec<u32>,
    ranges: Vec<Corners>,
}

impl Supports {
    /// Of boxes around centres, by half of their sides.
    pub(super) fn new(boxes: &[(Vec3, Vec3)]) -> Self {
        let leaf =
            |(number, (center, _)): (usize, &(Vec3, Vec3))| Leaf { position: *center, number: number as u32 };
        let tree = Tree::new(boxes.iter().enumerate().map(leaf).collect());
        let order: Vec<u32> = tree.leaves.iter().map(|leaf| leaf.number).collect();
        let corners = |number: &u32| {
            let (center, half) = boxes[*number as usize];
            [center - half, center + half]
        };
        let mut supports = Self { ranges: order.iter().map(corners).collect(), order };
        supports.join(0..boxes.len());
        supports
    }

    /// Puts the box of a range in the place of its middle's own, which it holds.
    fn join(&mut self, range: Range<usize>) -> Corners {
        let union = |[low, high]: Corners, [a, b]: Corners| [low.min(a), high.max(b)];
        if range.is_empty() {
            return [Vec3::INFINITY, Vec3::NEG_INFINITY];
        }
        let middle = range.start + range.len() / 2;
        let sides = if range.len() <= LEAF {
            self.ranges[range].iter().copied().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], union)
        } else {
            union(self.join(range.start..middle), self.join(middle + 1..range.end))
        };
        self.ranges[middle] = union(sides, self.ranges[middle]);
        self.ranges[middle]
    }

    /// Calls back with ranges of the order that hold all kernels whose boxes meet the one around `points`, always in the same sequence.
    pub(super) fn around(&self, points: &[Vec3], see: &mut impl FnMut(Range<usize>)) {
        let corners = points.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], point| {
            [low.min(*point), high.max(*point)]
        });
        self.visit(0..self.ranges.len(), corners, see);
    }

    fn visit(&self, range: Range<usize>, around: Corners, see: &mut impl FnMut(Range<usize>)) {
        let meets = |[low, high]: Corners| low.cmple(around[1]).all() && around[0].cmple(high).all();
        let middle = range.start + range.len() / 2;
        if range.is_empty() || !meets(self.ranges[middle]) {
            return;
        }
        if range.len() <= LEAF {
            return see(range);
        }
        self.visit(range.start..middle, around, see);
        see(middle..middle + 1);
        self.visit(middle + 1..range.end, around, see);
    }
}
