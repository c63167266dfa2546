//! The order in which four consecutive splats, and sixteen, and so on, are neighbours.

use crate::columns::{CHILDREN, Columns, Kind};
use glam::Vec3;
use rayon::prelude::*;

/// The fewest and the most consecutive splats that are put in order among themselves; powers of four. Where they end cells are not compact: of
/// a square of 4096 surfels 28 of the 64 cells of 64 border on the end.
const RUNS: [usize; 2] = [1 << 12, 1 << 18];

/// How many runs a surface has at least where they are not the shortest: threads share them, each with a copy of a run's numbers.
const LEAST_RUNS: usize = 16;

/// Puts the splats of each run in the order of a k-d tree's leaves, whose cells are the families: each split is across the longest side
/// of the centres' box, and as near to the middle as whole families, and families of those, allow.
pub(super) fn make_compact(columns: &mut Columns) {
    // Of lattices of kernels, in Morton order, the shortest runs are whole cubes, whose families of four are the most compact.
    let run = if matches!(columns.kind, Kind::Surface(_)) { run_of(columns.len) } else { RUNS[0] };
    make_compact_in(columns, run);
}

fn make_compact_in(columns: &mut Columns, run: usize) {
    let mut order: Vec<u32> = (0..columns.len).map(|index| (index % run) as u32).collect();
    order.par_chunks_mut(run).enumerate().for_each(|(number, order)| {
        let first = number * run;
        let centers: Vec<Vec3> = (0..order.len()).map(|i| columns.center(first + i)).collect();
        split(order, &centers);
    });
    columns.reorder(&order, run);
}

/// How many splats of a surface are a run.
fn run_of(count: usize) -> usize {
    let [mut run, most] = RUNS;
    while run < most && CHILDREN * run * LEAST_RUNS <= count {
        run *= CHILDREN;
    }
    run
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
    use crate::columns::Column;

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
    fn runs_grow_with_clouds() {
        let counts = [0, 262_143, 262_144, 1_000_000, 1 << 20, (1 << 22) - 1, 1 << 22, 1 << 30];
        let expected = [1 << 12, 1 << 12, 1 << 14, 1 << 14, 1 << 16, 1 << 16, 1 << 18, 1 << 18];
        assert_eq!(counts.map(run_of), expected);
    }

    #[test]
    fn longer_runs_are_permutations_too() {
        let (count, run) = (40_001, 1 << 14);
        let place = |i: usize| Vec3::new((i * 7919 % 613) as f32, (i * 104_729 % 977) as f32, i as f32);
        let mut columns = Columns { len: count, ..Columns::default() };
        columns.centers = Column::new((0..count).map(place).collect(), Vec3::to_array);
        make_compact_in(&mut columns, run);
        // Coordinate z is the number that a splat had.
        for first in (0..count).step_by(run) {
            let own = first..count.min(first + run);
            let mut before: Vec<usize> = own.clone().map(|i| columns.center(i).z as usize).collect();
            for (i, number) in own.clone().zip(&before) {
                assert_eq!(columns.center(i), place(*number));
            }
            before.sort_unstable();
            assert!(before.into_iter().eq(own));
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
