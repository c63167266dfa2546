//! Stage `order`: records from near to far, equal distances by id.

use crate::footprint::Records;
use rayon::prelude::*;

/// The indices of the records, sorted. Keys are unique, so the order is the same for any thread count.
pub(crate) fn by_distance(records: &Records) -> Vec<u32> {
    let mut keys: Vec<u64> = records
        .distance_keys
        .iter()
        .enumerate()
        .map(|(index, key)| (u64::from(*key) << 32) | index as u64)
        .collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}
