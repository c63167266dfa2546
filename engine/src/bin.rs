//! Stage `bin`: records, or octets, to a list for each tile, in the order they come in.
//!
//! A counting sort: every thread counts, tile by tile, the records of its share of the order, then puts them behind
//! those of the shares before. As in [`crate::order`], entries are stored each to a place of its own.

use crate::footprint::Rect;
use crate::grow::grow;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Entries whose rectangles are fetched together, from all over.
const FETCHED: usize = 64;

/// Lists of numbers, one a tile, rows of tiles from top to bottom.
#[derive(Default)]
pub(crate) struct TileLists {
    /// Tiles in a row, and rows.
    pub(crate) tiles: [usize; 2],
    starts: Vec<u32>,
    /// For each share and tile, a column and a row more than there are: first counts, then where its next entry goes.
    counts: Vec<u32>,
    entries: Vec<AtomicU32>,
}

/// The tiles that a rectangle touches: first column, first row, and one past the last ones, of 16 bits each.
#[derive(Clone, Copy)]
struct Touched(u64);

impl Touched {
    /// Of tiles of a power of two pixels.
    #[inline(always)]
    fn new(rect: &Rect, log_side: u32) -> Self {
        const ONES: u32 = 0x0001_0001;
        let pair = |[x, y]: [u16; 2]| u32::from(x) | u32::from(y) << 16;
        // What one half of a pair shifts into the other doesn't stay.
        let tiles = |pixels: u32| (pixels >> log_side) & ((u32::from(u16::MAX) >> log_side) * ONES);
        let (first, behind) = (tiles(pair(rect.min)), tiles(pair(rect.max) - ONES) + ONES);
        Self(u64::from(first) | u64::from(behind) << 32)
    }

    #[inline(always)]
    fn columns(self) -> std::ops::Range<usize> {
        self.0 as usize & 0xffff..(self.0 >> 32) as usize & 0xffff
    }

    #[inline(always)]
    fn rows(self) -> std::ops::Range<usize> {
        (self.0 >> 16) as usize & 0xffff..(self.0 >> 48) as usize
    }
}

/// How often each tile is touched, from what [`count_corners`] makes; there are `columns` in a row.
fn sum_up(counts: &mut [u32], columns: usize) {
    for row in counts.chunks_mut(columns) {
        for i in 1..columns {
            row[i] = row[i].wrapping_add(row[i - 1]);
        }
    }
    for i in columns..counts.len() {
        counts[i] = counts[i].wrapping_add(counts[i - columns]);
    }
}

/// Counts a rectangle by its corners alone: the sum of the counts above and to the left of a tile, its own included, is
/// 1 more in the tiles that are touched.
#[inline(always)]
fn count_corners(counts: &mut [u32], columns: usize, touched: Touched) {
    let (across, down) = (touched.columns(), touched.rows());
    let [top, bottom] = [down.start * columns, down.end * columns];
    let mut add = |tile: usize, change: u32| counts[tile] = counts[tile].wrapping_add(change);
    add(top + across.start, 1);
    add(top + across.end, u32::MAX);
    add(bottom + across.start, u32::MAX);
    add(bottom + across.end, 1);
}

impl TileLists {
    /// Lists what the numbers in `order` stand for, by its rectangle, which is not empty. `scratch` is at least as long as `order`.
    pub(crate) fn fill(
        &mut self,
        (size, side): ([u32; 2], usize),
        order: &[AtomicU32],
        rect_of: impl Fn(u32) -> Rect + Sync,
        scratch: &[AtomicU64],
    ) {
        let rect_of = &rect_of;
        let log_side = side.trailing_zeros();
        let tiles = size.map(|length| (length as usize).div_ceil(side));
        // Corners of rectangles may be one column and one row behind the last tiles.
        let (columns, count) = (tiles[0] + 1, (tiles[0] + 1) * (tiles[1] + 1));
        let shares = rayon::current_num_threads().max(1);
        let share_of = |share: usize| share * order.len() / shares..(share + 1) * order.len() / shares;
        self.tiles = tiles;
        self.counts.clear();
        self.counts.resize(shares * count, 0);
        self.counts.par_chunks_mut(count).enumerate().for_each(move |(share, counts)| {
            let (order, kept) = (&order[share_of(share)], &scratch[share_of(share)]);
            let mut rects = [Rect::default(); FETCHED];
            for (order, kept) in order.chunks(FETCHED).zip(kept.chunks(FETCHED)) {
                for (rect, entry) in rects.iter_mut().zip(order) {
                    *rect = rect_of(entry.load(Relaxed));
                }
                for (rect, kept) in rects.iter().zip(kept) {
                    let touched = Touched::new(rect, log_side);
                    count_corners(counts, columns, touched);
                    kept.store(touched.0, Relaxed);
                }
            }
            sum_up(counts, columns);
        });
        self.starts.clear();
        let mut next = 0;
        for tile in 0..count {
            self.starts.push(next);
            for share in 0..shares {
                let count = &mut self.counts[share * count + tile];
                (*count, next) = (next, next + *count);
            }
        }
        self.starts.push(next);
        grow(&mut self.entries, next as usize, AtomicU32::default);
        let entries = self.entries.as_slice();
        self.counts.par_chunks_mut(count).enumerate().for_each(move |(share, next)| {
            let (order, kept) = (&order[share_of(share)], &scratch[share_of(share)]);
            for (entry, kept) in order.iter().zip(kept) {
                let (index, touched) = (entry.load(Relaxed), Touched(kept.load(Relaxed)));
                let (across, down) = (touched.columns(), touched.rows());
                let (mut row, end) = (down.start * columns, down.end * columns);
                while row < end {
                    for next in &mut next[row + across.start..row + across.end] {
                        entries[*next as usize].store(index, Relaxed);
                        *next += 1;
                    }
                    row += columns;
                }
            }
        });
    }

    /// The records of a tile.
    pub(crate) fn tile(&self, tile: usize) -> &[AtomicU32] {
        // Rows have a column more than tiles.
        let tile = tile + tile / self.tiles[0];
        &self.entries[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn lists_what_touches_a_tile_in_order(
            rects in prop::collection::vec((0..100_u16, 0..70_u16, 1..60_u16, 1..60_u16), 0..200),
            side in prop_oneof![Just(8_usize), Just(16), Just(32)],
            threads in 1..5_usize,
        ) {
            let size = [100, 70];
            let rects: Vec<Rect> = rects
                .into_iter()
                .map(|(x, y, w, h)| Rect { min: [x, y], max: [(x + w).min(100), (y + h).min(70)] })
                .collect();
            let order: Vec<AtomicU32> = (0..rects.len() as u32).rev().map(AtomicU32::new).collect();
            let scratch: Vec<AtomicU64> = order.iter().map(|_| AtomicU64::new(0)).collect();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut lists = TileLists::default();
            pool.install(|| lists.fill((size, side), &order, |index| rects[index as usize], &scratch));
            let [columns, rows] = lists.tiles;
            for tile in 0..columns * rows {
                let low = [tile % columns * side, tile / columns * side];
                let touches = |i: &u32| {
                    let Rect { min, max } = rects[*i as usize];
                    (0..2).all(|a| (min[a] as usize) < low[a] + side && max[a] as usize > low[a])
                };
                let expected: Vec<u32> = (0..rects.len() as u32).rev().filter(touches).collect();
                let found: Vec<u32> = lists.tile(tile).iter().map(|entry| entry.load(Relaxed)).collect();
                prop_assert_eq!(found, expected);
            }
        }
    }
}
