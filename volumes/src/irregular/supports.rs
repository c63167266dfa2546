//! Which kernels reach a point: boxes around those of a k-d tree's ranges.

use glam::Vec3;
use std::ops::Range;

use oblate_engine::neighbors::{Leaf, Tree};

/// Kernels that are looked at one by one.
const LEAF: usize = 4;

/// A box: its corners.
type Corners = [Vec3; 2];

/// Boxes of kernels, by the tree of their centres: that of each range is kept at the range's middle.
pub(super) struct Supports {
    /// Numbers of kernels, in the tree's order.
    pub(super) order: Vec<u32>,
    own: Vec<Corners>,
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
        let own: Vec<Corners> = order.iter().map(corners).collect();
        let mut supports = Self { order, ranges: own.clone(), own };
        supports.join(0..boxes.len());
        supports
    }

    fn join(&mut self, range: Range<usize>) -> Corners {
        let union = |[low, high]: Corners, [a, b]: Corners| [low.min(a), high.max(b)];
        if range.len() <= LEAF {
            return self.own[range].iter().copied().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], union);
        }
        let middle = range.start + range.len() / 2;
        let sides = union(self.join(range.start..middle), self.join(middle + 1..range.end));
        self.ranges[middle] = union(sides, self.own[middle]);
        self.ranges[middle]
    }

    /// Calls back with the place in the order of each kernel whose box holds `point`, always in the same sequence.
    pub(super) fn around(&self, point: Vec3, see: &mut impl FnMut(usize)) {
        self.visit(0..self.own.len(), point, see);
    }

    fn visit(&self, range: Range<usize>, point: Vec3, see: &mut impl FnMut(usize)) {
        let holds = |[low, high]: Corners| low.cmple(point).all() && point.cmple(high).all();
        if range.len() <= LEAF {
            range.filter(|place| holds(self.own[*place])).for_each(see);
            return;
        }
        let middle = range.start + range.len() / 2;
        if !holds(self.ranges[middle]) {
            return;
        }
        self.visit(range.start..middle, point, see);
        if holds(self.own[middle]) {
            see(middle);
        }
        self.visit(middle + 1..range.end, point, see);
    }
}
