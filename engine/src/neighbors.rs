//! Nearest neighbours: a balanced k-d tree that is only an order of the points.
//!
//! Bentley, *Multidimensional binary search trees used for associative searching*, 1975, split across the longest side as
//! Friedman, Bentley, Finkel, *An algorithm for finding best matches in logarithmic expected time*, 1977, do. Scanners
//! give planes and lines: trees that take the axes in turn look at much of a line for each of its points.

use glam::Vec3;

/// Points that are looked at one by one.
const LEAF: usize = 8;

/// Points that a task orders by itself.
const POINTS_PER_TASK: usize = 8192;

/// A point of the tree: where, and its number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaf {
    /// Where it is, finite.
    pub position: Vec3,
    /// What the caller calls it.
    pub number: u32,
}

/// Points in the tree's order. A range of more than eight is parted at its middle: no point before is higher along an
/// axis, none after lower.
#[derive(Clone, Debug)]
pub struct Tree {
    /// The points, in the tree's order.
    pub leaves: Vec<Leaf>,
    /// At the middle of each range: its axis.
    axes: Vec<u8>,
}

/// Squared distance and place in the tree, nearest first.
pub type Found = Vec<(f32, u32)>;

impl Tree {
    /// Orders points; the same whatever the threads.
    pub fn new(mut leaves: Vec<Leaf>) -> Self {
        let mut axes = vec![0; leaves.len()];
        order(&mut leaves, &mut axes);
        Self { leaves, axes }
    }

    /// The `count` points that are nearest to the one at `place`, without that one; fewer if there are no more.
    pub fn nearest(&self, place: usize, count: usize, found: &mut Found) {
        found.clear();
        let query = Query { tree: self, from: self.leaves[place].position, place, count };
        query.visit(0..self.leaves.len(), [0.0; 3], found);
    }
}

fn order(leaves: &mut [Leaf], axes: &mut [u8]) {
    if leaves.len() <= LEAF {
        return;
    }
    let corners = leaves.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), leaf| {
        (low.min(leaf.position), high.max(leaf.position))
    });
    let axis = (corners.1 - corners.0).max_position();
    let middle = leaves.len() / 2;
    leaves.select_nth_unstable_by(middle, |a, b| {
        a.position[axis].total_cmp(&b.position[axis]).then(a.number.cmp(&b.number))
    });
    axes[middle] = axis as u8;
    let (before, after) = leaves.split_at_mut(middle);
    let (axes_before, axes_after) = axes.split_at_mut(middle);
    let (after, axes_after) = (&mut after[1..], &mut axes_after[1..]);
    if middle < POINTS_PER_TASK {
        order(before, axes_before);
        order(after, axes_after);
    } else {
        rayon::join(|| order(before, axes_before), || order(after, axes_after));
    }
}

struct Query<'a> {
    tree: &'a Tree,
    from: Vec3,
    place: usize,
    count: usize,
}

impl Query<'_> {
    /// Looks at a range whose points are at least `offsets` away along each axis.
    fn visit(&self, range: std::ops::Range<usize>, offsets: [f32; 3], found: &mut Found) {
        if range.len() <= LEAF {
            range.for_each(|place| self.look(place, found));
            return;
        }
        let middle = range.start + range.len() / 2;
        let axis = usize::from(self.tree.axes[middle]);
        let offset = self.from[axis] - self.tree.leaves[middle].position[axis];
        let (before, after) = (range.start..middle, middle + 1..range.end);
        let (near, far) = if offset < 0.0 { (before, after) } else { (after, before) };
        self.visit(near, offsets, found);
        self.look(middle, found);
        let mut beyond = offsets;
        beyond[axis] = offset;
        let squared = beyond.iter().map(|offset| offset * offset).sum();
        // Equally far is not nearer: coincident points are not all looked at.
        if self.can_take(squared, found) {
            self.visit(far, beyond, found);
        }
    }

    fn look(&self, place: usize, found: &mut Found) {
        let squared = self.tree.leaves[place].position.distance_squared(self.from);
        if place == self.place || !self.can_take(squared, found) {
            return;
        }
        if found.len() == self.count {
            found.pop();
        }
        let at = found.iter().rposition(|&(other, _)| other <= squared).map_or(0, |before| before + 1);
        found.insert(at, (squared, place as u32));
    }

    fn can_take(&self, squared: f32, found: &Found) -> bool {
        found.len() < self.count || found.last().is_some_and(|&(farthest, _)| squared < farthest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn tree(positions: &[Vec3]) -> Tree {
        let leaf = |(number, &position): (usize, &Vec3)| Leaf { position, number: number as u32 };
        Tree::new(positions.iter().enumerate().map(leaf).collect())
    }

    proptest! {
        #[test]
        fn what_is_found_is_nearest(
            // Few values: coincident points, lines and planes are common.
            cells in prop::collection::vec([0_u8..6, 0_u8..6, 0_u8..3], 1..200),
            count in 1_usize..20,
        ) {
            let positions: Vec<Vec3> = cells.iter().map(|cell| Vec3::from(cell.map(f32::from))).collect();
            let tree = tree(&positions);
            let mut found = Found::new();
            for place in 0..positions.len() {
                let from = tree.leaves[place].position;
                tree.nearest(place, count, &mut found);
                let all = tree.leaves.iter().enumerate().filter(|(other, _)| *other != place);
                let mut expected: Vec<f32> = all.map(|(_, leaf)| leaf.position.distance_squared(from)).collect();
                expected.sort_by(f32::total_cmp);
                expected.truncate(count);
                let distances: Vec<f32> = found.iter().map(|found| found.0).collect();
                prop_assert_eq!(distances, expected);
                for &(squared, other) in &found {
                    prop_assert_eq!(tree.leaves[other as usize].position.distance_squared(from), squared);
                }
                let mut places: Vec<u32> = found.iter().map(|found| found.1).collect();
                places.sort_unstable();
                places.dedup();
                prop_assert_eq!(places.len(), found.len());
            }
        }
    }

    #[test]
    fn each_point_is_in_the_tree_once() {
        let tree = tree(&vec![Vec3::ONE; 1000]);
        let mut numbers: Vec<u32> = tree.leaves.iter().map(|leaf| leaf.number).collect();
        numbers.sort_unstable();
        assert!(numbers.iter().copied().eq(0..1000));
    }
}
