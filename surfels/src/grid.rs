//! The occupied cells of a uniform grid, sorted row by row, and their neighbourhoods without hashing.

use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Bits of a cell's number along each axis. Cells count from 1, so that a cell's neighbours are numbers too.
const AXIS_BITS: u32 = 21;

/// The longest extent, in cells, that [`Grid::new`] takes.
pub(crate) const LONGEST_EXTENT: f64 = (1_u32 << (AXIS_BITS - 1)) as f64;

/// Cells that one task handles.
const CELLS_PER_TASK: usize = 2048;

/// An odd number and its inverse modulo 2³²: they shuffle the points of a cell and unshuffle them.
const SHUFFLE: [u32; 2] = [0x9E37_79B1, 0x0E8B_2F51];
const _: () = assert!(SHUFFLE[0].wrapping_mul(SHUFFLE[1]) == 1);

/// Occupied cells of size 1 in ascending order of (z, y, x), and where the points of each begin.
pub(crate) struct Grid {
    keys: Vec<u64>,
    starts: Vec<u32>,
}

/// The occupied cells around a cell: nine rows of up to three, each a range of cells.
pub(crate) type Rows = [Range<usize>; 9];

impl Grid {
    /// Sorts points into cells: the grid, and the points' numbers in order, those of a cell shuffled.
    pub(crate) fn new(positions: impl IndexedParallelIterator<Item = Vec3> + Clone) -> (Self, Vec<u32>) {
        let low = positions.clone().reduce(|| Vec3::MAX, Vec3::min);
        let mut entries: Vec<(u64, u32)> =
            positions.enumerate().map(|(i, p)| (key(p - low), (i as u32).wrapping_mul(SHUFFLE[0]))).collect();
        entries.par_sort_unstable();
        let begins = |i: &usize| *i == 0 || entries[*i].0 != entries[*i - 1].0;
        let mut starts: Vec<u32> =
            (0..entries.len()).into_par_iter().filter(begins).map(|i| i as u32).collect();
        let keys = starts.par_iter().map(|&start| entries[start as usize].0).collect();
        starts.push(entries.len() as u32);
        let order = entries.par_iter().map(|&(_, shuffled)| shuffled.wrapping_mul(SHUFFLE[1])).collect();
        (Self { keys, starts }, order)
    }

    /// How many cells are occupied.
    pub(crate) fn len(&self) -> usize {
        self.keys.len()
    }

    /// The points of some cells in a row of the order.
    pub(crate) fn points(&self, cells: Range<usize>) -> Range<usize> {
        self.starts[cells.start] as usize..self.starts[cells.end] as usize
    }

    /// The cells in tasks of a fixed size.
    pub(crate) fn tasks(&self) -> Vec<Range<usize>> {
        let begins = (0..self.len()).step_by(CELLS_PER_TASK);
        begins.map(|begin| begin..(begin + CELLS_PER_TASK).min(self.len())).collect()
    }

    /// One of eight colours; cells of one colour are not neighbours.
    pub(crate) fn color(&self, cell: usize) -> u64 {
        let key = self.keys[cell];
        (key & 1) | ((key >> AXIS_BITS) & 1) << 1 | ((key >> (2 * AXIS_BITS)) & 1) << 2
    }

    /// Visits cells, given in ascending order, with their neighbourhoods. The nine rows move forward with the
    /// cell, so finding them takes a few steps and no search.
    pub(crate) fn sweep(&self, cells: impl Iterator<Item = usize>, mut visit: impl FnMut(usize, &Rows)) {
        let mut cells = cells.peekable();
        let Some(&first) = cells.peek().and_then(|&cell| self.keys.get(cell)) else { return };
        let offset = |row: i64| ((row / 3 - 1) << (2 * AXIS_BITS)) + ((row % 3 - 1) << AXIS_BITS);
        let offsets: [u64; 9] = std::array::from_fn(|row| offset(row as i64) as u64);
        let mut rows: Rows = offsets.map(|offset| {
            let begin = first.wrapping_add(offset) - 1;
            let at = self.keys.partition_point(|&key| key < begin);
            at..at
        });
        for cell in cells {
            for (row, offset) in rows.iter_mut().zip(offsets) {
                let middle = self.keys[cell].wrapping_add(offset);
                row.start += self.keys[row.start..].iter().take_while(|&&key| key < middle - 1).count();
                row.end = row.end.max(row.start);
                row.end += self.keys[row.end..].iter().take_while(|&&key| key <= middle + 1).count();
            }
            visit(cell, &rows);
        }
    }
}

fn key(from_low: Vec3) -> u64 {
    let [x, y, z] = (from_low + 1.0).to_array().map(|v| u64::from(v as u32));
    x | y << AXIS_BITS | z << (2 * AXIS_BITS)
}
