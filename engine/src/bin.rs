//! Stage `bin`: records to a list for each tile, in the order they come in.
//!
//! A counting sort: every thread counts, tile by tile, the records of its share of the order, then puts them behind
//! those of the shares before. As in [`crate::order`], entries are stored each to a place of its own.

use crate::footprint::Rect;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Lists of record indices, one a tile, rows of tiles from top to bottom.
#[derive(Default)]
pub(crate) struct TileLists {
    /// Tiles in a row, and rows.
    pub(crate) tiles: [usize; 2],
    starts: Vec<u32>,
    /// For each share and tile: first counts, then where its next entry goes.
    counts: Vec<u32>,
    entries: Vec<AtomicU32>,
}

/// The tiles, of a power of two pixels, that a rectangle touches: first and last column, first and last row, 16 bits each.
#[inline(always)]
fn packed(rect: &Rect, log_side: u32) -> u64 {
    let [left, top] = rect.min.map(|x| u64::from(x >> log_side));
    let [right, bottom] = rect.max.map(|x| u64::from((x - 1) >> log_side));
    left | right << 16 | top << 32 | bottom << 48
}

/// Calls `visit` with tiles and whether they count. Most rectangles touch at most 2×2 tiles: those take one way,
/// without branches that a processor could guess wrong.
#[inline(always)]
fn for_each_tile(packed: u64, columns: usize, mut visit: impl FnMut(usize, bool)) {
    let part = |shift: u32| (packed >> shift) as usize & 0xffff;
    let [left, right, top, bottom] = [part(0), part(16), part(32), part(48)];
    if right - left <= 1 && bottom - top <= 1 {
        let [first, last] = [top * columns, bottom * columns];
        let [is_wide, is_high] = [right > left, bottom > top];
        visit(first + left, true);
        visit(first + right, is_wide);
        visit(last + left, is_high);
        visit(last + right, is_wide & is_high);
        return;
    }
    for row in top..=bottom {
        for column in left..=right {
            visit(row * columns + column, true);
        }
    }
}

impl TileLists {
    /// Lists the records whose indices are the low halves of `order`; rectangles are not empty. `scratch` is as
    /// long as `order`.
    pub(crate) fn fill(
        &mut self,
        (size, side): ([u32; 2], usize),
        order: &[AtomicU64],
        rects: &[Rect],
        scratch: &[AtomicU64],
    ) {
        let log_side = side.trailing_zeros();
        let tiles = size.map(|length| (length as usize).div_ceil(side));
        let (columns, count) = (tiles[0], tiles[0] * tiles[1]);
        let shares = rayon::current_num_threads().max(1);
        let share_of = |share: usize| share * order.len() / shares..(share + 1) * order.len() / shares;
        self.tiles = tiles;
        self.counts.clear();
        self.counts.resize(shares * count, 0);
        self.counts.par_chunks_mut(count).enumerate().for_each(|(share, counts)| {
            for (entry, kept) in order[share_of(share)].iter().zip(&scratch[share_of(share)]) {
                // Rectangles are read once, from all over; the second time they are in order.
                let touched = packed(&rects[entry.load(Relaxed) as u32 as usize], log_side);
                kept.store(touched, Relaxed);
                for_each_tile(touched, columns, |tile, counts_in| counts[tile] += u32::from(counts_in));
            }
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
        // What doesn't count is written behind all lists.
        let nowhere = next;
        let room = self.entries.len().max(nowhere as usize + 1);
        self.entries.resize_with(room, AtomicU32::default);
        let entries = &self.entries;
        self.counts.par_chunks_mut(count).enumerate().for_each(|(share, next)| {
            for (entry, kept) in order[share_of(share)].iter().zip(&scratch[share_of(share)]) {
                let index = entry.load(Relaxed) as u32;
                for_each_tile(kept.load(Relaxed), columns, |tile, counts_in| {
                    let place = if counts_in { next[tile] } else { nowhere };
                    entries[place as usize].store(index, Relaxed);
                    next[tile] += u32::from(counts_in);
                });
            }
        });
    }

    /// The records of a tile.
    pub(crate) fn tile(&self, tile: usize) -> &[AtomicU32] {
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
            let order: Vec<AtomicU64> = (0..rects.len() as u64).rev().map(AtomicU64::new).collect();
            let scratch: Vec<AtomicU64> = order.iter().map(|_| AtomicU64::new(0)).collect();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut lists = TileLists::default();
            pool.install(|| lists.fill((size, side), &order, &rects, &scratch));
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
