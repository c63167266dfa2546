//! The order in which four consecutive splats, and sixteen, and so on, are neighbours.

use crate::columns::{CHILDREN, Columns};
use glam::Vec3;
use rayon::prelude::*;

/// Consecutive splats that are put in order among themselves; a power of four.
pub(super) const RUN: usize = 4096;

/// Puts the splats of each run in the order of a k-d tree's leaves, whose cells are the families: each split is across the longest side
/// of the centres' box, and as near to the middle as whole families, and families of those, allow.
pub(super) fn make_compact(columns: &mut Columns) {
    let mut order: Vec<u32> = (0..columns.len).map(|index| (index % RUN) as u32).collect();
    order.par_chunks_mut(RUN).enumerate().for_each(|(number, order)| {
        let first = number * RUN;
        let centers: Vec<Vec3> = (0..order.len()).map(|i| columns.center(first + i)).collect();
        split(order, &centers);
    });
    columns.reorder(&order, RUN);
}

fn split(order: &mut [u32], centers: &[Vec3]) {
    let Some(left) = left_part(order.len()) else { return };
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for index in &*order {
        let center = centers[*index as usize];
        (low, high) = (low.min(center), high.max(center));
    }
    // Halves, since centres may be as far apart as numbers go.
    let extent = (high * 0.5 - low * 0.5).to_array();
    let axis = (1..3).fold(0, |longest, axis| if extent[axis] > extent[longest] { axis } else { longest });
    let place = |index: &u32| centers[*index as usize][axis];
    order.select_nth_unstable_by(left, |a, b| place(a).total_cmp(&place(b)).then(a.cmp(b)));
    let (left, right) = order.split_at_mut(left);
    split(left, centers);
    split(right, centers);
}

/// How many splats come before the split: a multiple of the largest power of four that is less than all of them, so that only the
/// last cell of each size isn't full. `None` where they are one family.
fn left_part(count: usize) -> Option<usize> {
    if count <= CHILDREN {
        return None;
    }
    let mut whole = CHILDREN;
    while whole * CHILDREN < count {
        whole *= CHILDREN;
    }
    Some((count / 2 / whole).max(1) * whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_cells_are_not_full() {
        assert_eq!([1, 4].map(left_part), [None; 2]);
        assert_eq!([5, 8, 9, 16, 17, 64, 100, 4096].map(left_part), [4, 4, 4, 8, 16, 32, 64, 2048].map(Some));
        for count in 5..300 {
            let mut sizes = vec![count];
            let mut at = 0;
            while let Some(size) = sizes.pop() {
                if let Some(left) = left_part(size) {
                    assert!(left < size);
                    sizes.extend([size - left, left]);
                } else {
                    assert!(size == CHILDREN || at + size == count, "{size} of {count} at {at}");
                    at += size;
                }
            }
        }
    }

    #[test]
    fn coincident_and_infinite_distances_are_an_order() {
        let centers: Vec<Vec3> =
            (0..1000).map(|i| Vec3::X * if i % 2 == 0 { f32::MAX } else { f32::MIN }).collect();
        let mut order: Vec<u32> = (0..1000).collect();
        split(&mut order, &centers);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..1000));
        assert!(order.chunks(4).take(124).all(|family| family.iter().all(|i| i % 2 == family[0] % 2)));
    }
}
