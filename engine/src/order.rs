//! Stage `order`: records from near to far, equal distances by their place.

use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bits of a digit.
const DIGIT: u32 = 11;
const BUCKETS: usize = 1 << DIGIT;

/// Bits of a distance that don't count: distances that agree to 2⁻²⁰ of themselves are equal.
const DROPPED: u32 = 3;

/// A distance from the eye (or z where rays are parallel) with the index that goes with it, which is the low half.
/// The high half sorts as distances do.
#[inline(always)]
pub(crate) fn keyed(distance: f32, index: u32) -> u64 {
    u64::from(sortable(distance)) << 32 | u64::from(index)
}

/// Bits that sort as the number does.
#[inline(always)]
pub(crate) fn sortable(x: f32) -> u32 {
    let bits = x.to_bits();
    if x.is_sign_negative() { !bits } else { bits | 1 << 31 }
}

/// Entries that stand together.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Run {
    pub(crate) start: usize,
    pub(crate) len: usize,
    /// The least and the greatest [`sortable`] distance, of no meaning in an empty run.
    pub(crate) keys: [u32; 2],
}

/// The range of the keys.
#[derive(Clone, Copy)]
struct Keys {
    nearest: u32,
    digits: u32,
}

impl Keys {
    fn of(runs: &[Run]) -> Self {
        let runs = || runs.iter().filter(|run| run.len > 0);
        let nearest = runs().map(|run| run.keys[0]).min().unwrap_or(0);
        let farthest = runs().map(|run| run.keys[1]).max().unwrap_or(0);
        let bits = u32::BITS - ((farthest - nearest) >> DROPPED).leading_zeros();
        Self { nearest, digits: bits.div_ceil(DIGIT).max(1) }
    }

    #[inline(always)]
    fn bucket(self, entry: u64, digit: u32) -> usize {
        let key = ((entry >> 32) as u32 - self.nearest) >> DROPPED;
        (key >> (digit * DIGIT)) as usize % BUCKETS
    }
}

/// Copies the entries of runs behind each other, and says how many they are.
pub(crate) fn gather(runs: &[Run], from: &[AtomicU64], to: &[AtomicU64]) -> usize {
    let mut next = 0;
    for run in runs {
        for (entry, place) in from[run.start..run.start + run.len].iter().zip(&to[next..]) {
            place.store(entry.load(Relaxed), Relaxed);
        }
        next += run.len;
    }
    next
}

/// A stable radix sort on all threads.
///
/// Numbers move by relaxed atomic stores, each to a place of its own: plain stores to the processor, and the
/// result does not depend on the number of threads.
#[derive(Default)]
pub(crate) struct Sorter {
    counts: Vec<u32>,
}

impl Sorter {
    /// Sorts the entries of `runs`, which lie in `first`, and gives the array with the result and the other one.
    /// Runs are about as long as each other; `second` has room for all.
    pub(crate) fn sort<'a>(
        &mut self,
        runs: &[Run],
        [first, second]: [&'a [AtomicU64]; 2],
    ) -> [&'a [AtomicU64]; 2] {
        let count: usize = runs.iter().map(|run| run.len).sum();
        let keys = Keys::of(runs);
        let shares = rayon::current_num_threads().max(1);
        let share_of = |share: usize, whole: usize| share * whole / shares..(share + 1) * whole / shares;
        self.pass((keys, 0), second, |share| {
            let runs = &runs[share_of(share, runs.len())];
            runs.iter().flat_map(|run| &first[run.start..run.start + run.len])
        });
        let [mut from, mut to] = [second, first];
        for digit in 1..keys.digits {
            self.pass((keys, digit), to, |share| from[share_of(share, count)].iter());
            (from, to) = (to, from);
        }
        [&from[..count], to]
    }

    /// Moves all entries to their places by one digit.
    fn pass<'a, I: Iterator<Item = &'a AtomicU64>>(
        &mut self,
        (keys, digit): (Keys, u32),
        to: &[AtomicU64],
        entries: impl Fn(usize) -> I + Sync,
    ) {
        let shares = rayon::current_num_threads().max(1);
        let bucket = |entry: u64| keys.bucket(entry, digit);
        self.counts.clear();
        self.counts.resize(shares * BUCKETS, 0);
        self.counts.par_chunks_mut(BUCKETS).enumerate().for_each(|(share, counts)| {
            entries(share).for_each(|entry| counts[bucket(entry.load(Relaxed))] += 1);
        });
        // Where each share puts its first entry of each bucket.
        let mut next = 0;
        for bucket in 0..BUCKETS {
            for share in 0..shares {
                let count = &mut self.counts[share * BUCKETS + bucket];
                (*count, next) = (next, next + *count);
            }
        }
        self.counts.par_chunks_mut(BUCKETS).enumerate().for_each(|(share, next)| {
            entries(share).for_each(|entry| {
                let entry = entry.load(Relaxed);
                let place = &mut next[bucket(entry)];
                to[*place as usize].store(entry, Relaxed);
                *place += 1;
            });
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn sorts_as_a_stable_sort_does(
            distances in prop::collection::vec(prop_oneof![0.1..0.11f32, 0.1..1000.0f32, -5.0..5.0f32], 0..3000),
            threads in 1..5_usize,
        ) {
            // Runs of a hundred with gaps between them.
            let slots = |entries: usize| entries.div_ceil(100) * 150 + 150;
            let first: Vec<AtomicU64> = (0..slots(distances.len())).map(|_| AtomicU64::new(u64::MAX)).collect();
            let second: Vec<AtomicU64> = (0..first.len()).map(|_| AtomicU64::new(u64::MAX)).collect();
            let mut runs = Vec::new();
            for (number, chunk) in distances.chunks(100).enumerate() {
                let keys = chunk.iter().map(|distance| sortable(*distance));
                let keys = [keys.clone().min().unwrap(), keys.max().unwrap()];
                runs.push(Run { start: number * 150, len: chunk.len(), keys });
                for (i, distance) in chunk.iter().enumerate() {
                    first[number * 150 + i].store(keyed(*distance, (number * 100 + i) as u32), Relaxed);
                }
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let [sorted, _] = pool.install(|| Sorter::default().sort(&runs, [&first, &second]));
            let nearest = distances.iter().map(|d| sortable(*d)).min().unwrap_or(0);
            let mut expected: Vec<u32> = (0..distances.len() as u32).collect();
            expected.sort_by_key(|i| (sortable(distances[*i as usize]) - nearest) >> DROPPED);
            let found: Vec<u32> = sorted.iter().map(|entry| entry.load(Relaxed) as u32).collect();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn keys_sort_as_distances_do(a in -1e3..1e6f32, b in -1e3..1e6f32) {
            prop_assert_eq!(a.total_cmp(&b), sortable(a).cmp(&sortable(b)));
        }
    }
}
