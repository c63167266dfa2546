//! The records of a tile's list, batch by batch.

use super::sums::MOST_OPEN;
use crate::closing::Closing;
use crate::footprint::Record;
use crate::raster::{BATCH, SlabColumns};
use crate::simd::Simd;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU32, Ordering};

/// Records of a batch, and pieces of records that are still to come.
#[derive(Default)]
pub(super) struct Coming {
    pub(super) records: Vec<u32>,
    /// By their first slab: all are cut to the same length.
    pieces: VecDeque<Piece>,
}

/// What lies from a slab on, of a record.
struct Piece {
    record: u32,
    first: u32,
}

impl Coming {
    /// Begins with a list.
    pub(super) fn clear(&mut self) {
        self.records.clear();
        self.pieces.clear();
    }

    /// Whether records that were taken go on.
    pub(super) fn has_pieces(&self) -> bool {
        !self.pieces.is_empty()
    }

    /// Takes the next records of a list, as many as go together; false if there is none.
    #[inline(always)]
    pub(super) fn gather<S: Simd>(
        &mut self,
        simd: S,
        list: &mut std::slice::Iter<AtomicU32>,
        (all, closing): (&[Record], &Closing),
        slabs: &mut SlabColumns,
    ) -> bool {
        let Self { records, pieces } = self;
        records.clear();
        records.extend(list.as_slice().iter().take(BATCH).map(|entry| entry.load(Ordering::Relaxed)));
        if !closing.has_slabs() {
            *list = list.as_slice()[records.len()..].iter();
            return !records.is_empty();
        }
        // Records are not in the cache. The loop is so short that most are on their way at once; to round numbers there would make it
        // long.
        let mut numbers = [[0.0; BATCH]; 2];
        for (place, record) in records.iter().enumerate() {
            [numbers[0][place], numbers[1][place]] = all[*record as usize].amplitude_slope_or_slabs;
        }
        if pieces.is_empty() && slabs.set_whole(simd, &numbers, MOST_OPEN) {
            *list = list.as_slice()[records.len()..].iter();
            return !records.is_empty();
        }
        let slabs_of = |first: f32, record: u32| [first, all[record as usize].last_slab()];
        let mut ahead = [(0, [0.0; 2]); BATCH];
        for (place, (ahead, record)) in ahead.iter_mut().zip(&*records).enumerate() {
            *ahead = (*record, slabs_of(numbers[0][place], *record));
        }
        let mut ahead = ahead[..records.len()].iter();
        records.clear();
        while records.len() < BATCH {
            let next = ahead.as_slice().first().copied();
            // Before what is composited at a centre in their first slab.
            let is_next = |piece: &mut Piece| next.is_none_or(|(_, slabs)| piece.first <= slabs[0] as u32);
            let piece = pieces.pop_front_if(is_next);
            let (record, [first, mut last]) = match (&piece, next) {
                (Some(piece), _) => (piece.record, slabs_of(piece.first as f32, piece.record)),
                (None, Some(next)) => {
                    list.next();
                    ahead.next();
                    next
                }
                (None, None) => break,
            };
            let first = first as u32;
            let ends = last as u32 - first < MOST_OPEN;
            if !ends {
                pieces.push_back(Piece { record, first: first + MOST_OPEN });
                last = (first + MOST_OPEN - 1) as f32;
            }
            slabs.set(records.len(), (first, last), [piece.is_none(), ends]);
            records.push(record);
        }
        !records.is_empty()
    }
}
