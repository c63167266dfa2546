//! What a pass draws, and what of it each tile does.

use super::watched;
use crate::bin::TileLists;
use crate::closing::Closing;
use crate::cull::VisibleRange;
use crate::footprint::{Part, Records, SceneProjector};
use crate::grow::grow;
use crate::observer::{Observer, Stage};
use crate::order::{Keys, Sorter};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// What is drawn in a pass: records and who needs them where.
#[derive(Default)]
pub(super) struct Drawn {
    pub(super) records: Records,
    /// For each run of records its range's place among the visible ones.
    ranks: Vec<u32>,
    /// Parts of octets, or distances, of which sorting makes the order, where more records may come.
    order: Vec<AtomicU32>,
    pub(super) lists: TileLists,
}

impl Drawn {
    pub(super) fn clear(&mut self) {
        self.records.clear();
        self.ranks.clear();
    }

    /// Projects those of the visible ranges that are `chosen`, and keeps all in the order of the ranges.
    pub(super) fn append(&mut self, projector: &SceneProjector, visible: &[VisibleRange], chosen: &[u32]) {
        let is_first = self.ranks.is_empty();
        self.records.append(projector, visible, chosen);
        self.ranks.extend(chosen);
        if !is_first && !chosen.is_empty() {
            self.records.sort_runs(&mut self.ranks);
        }
    }

    /// How many of the splats that are drawn stand for others.
    pub(super) fn merged(&self, visible: &[VisibleRange]) -> u64 {
        self.records.count(|run| visible[self.ranks[run] as usize].level > 0)
    }

    /// Lists octets by clusters, which come from near to far.
    pub(super) fn list_by_cluster(
        &mut self,
        observer: &dyn Observer,
        size: ([u32; 2], usize),
        scratch: &mut Vec<AtomicU64>,
    ) {
        let Self { records, order, lists, .. } = self;
        watched(observer, Stage::Bin, || {
            let count = records.list_parts(order);
            grow(scratch, count, AtomicU64::default);
            lists.fill(size, &order[..count], |part| records.rect_of(Part(part)), scratch);
        });
    }

    /// Lists records by their distance, or by their first slab.
    pub(super) fn list_by_distance(
        &mut self,
        (observer, closing, is_last): (&dyn Observer, Closing, bool),
        size: ([u32; 2], usize),
        (sorter, scratch): (&mut Sorter, &mut Vec<AtomicU64>),
    ) {
        let Records { distances, runs, rects, .. } = &self.records;
        grow(scratch, self.records.len(), AtomicU64::default);
        let distances = if is_last {
            distances
        } else {
            grow(&mut self.order, distances.len(), AtomicU32::default);
            for run in runs {
                let places = run.start..run.start + run.len;
                for (kept, distance) in self.order[places.clone()].iter().zip(&distances[places]) {
                    kept.store(distance.load(Relaxed), Relaxed);
                }
            }
            &self.order
        };
        let keys = match closing {
            _ if closing.is_mixed() => Keys::of_fractions(runs),
            _ if closing.has_slabs() => Keys::OF_NUMBERS,
            _ => Keys::of(runs, closing.alike()),
        };
        let order = watched(observer, Stage::Order, || sorter.sort((runs, keys), distances, scratch));
        watched(observer, Stage::Bin, || {
            self.lists.fill(size, order, |place| rects[place as usize], scratch)
        });
    }
}
