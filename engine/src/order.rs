//! Stage `order`: records from near to far, equal distances by their place.

use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Bits of a digit; a key has two of them.
const DIGIT: u32 = 11;
const BUCKETS: usize = 1 << DIGIT;

/// Bits of a distance that don't count, at least: distances that agree to 2⁻²⁰ of themselves are equal.
const DROPPED: u32 = 3;

/// 2²³, which holds whole numbers in its lowest bits.
const HOLDER: f32 = 8_388_608.0;

/// Fractions are told apart no finer than single precision does.
const LEAST_STEP: f32 = 1.0 / (1 << 20) as f32;

/// Entries that a thread copies in one go, at least.
const ENTRIES_A_TASK: usize = 1 << 14;

/// Places taken from `start` on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) start: usize,
    pub(crate) len: usize,
    /// The least and the greatest distance from the eye, or z where rays are parallel.
    distances: [f32; 2],
}

impl Run {
    pub(crate) fn new(start: usize) -> Self {
        Self { start, len: 0, distances: [f32::INFINITY, f32::NEG_INFINITY] }
    }

    /// Lets the range of the distances, but not the run, grow.
    pub(crate) fn include(&mut self, distances: [f32; 2]) {
        let [nearest, farthest] = self.distances;
        self.distances = [nearest.min(distances[0]), farthest.max(distances[1])];
    }

    pub(crate) fn places(&self) -> std::ops::Range<usize> {
        self.start..self.start + self.len
    }
}

/// Numbers of 22 bits that sort as distances do.
///
/// Bits of a positive number sort as it does, and tell it to a share of itself; distances of any sign are moved to where
/// that is the same share of all. Or they are told apart by a power of two: added to, 2²³ times that holds its multiples in its lowest bits.
#[derive(Clone, Copy)]
pub(crate) struct Keys {
    offset: f32,
    least: u32,
    dropped: u32,
}

impl Keys {
    /// Whole numbers below 2²² as they are.
    pub(crate) const OF_NUMBERS: Self = Self { offset: HOLDER, least: HOLDER.to_bits(), dropped: 0 };

    /// Numbers below 2²² and as much of their fractions as there is room for.
    pub(crate) fn of_fractions(runs: &[Run]) -> Self {
        let farthest = runs.iter().map(|run| run.distances[1]).fold(0.0, f32::max);
        let step = (farthest / ((1 << (2 * DIGIT)) - 4) as f32).max(LEAST_STEP).log2().ceil().exp2();
        Self::in_steps(step.min(1.0), 0.0)
    }

    /// Multiples of a power of two from an even one on.
    fn in_steps(step: f32, nearest: f32) -> Self {
        let offset = step * (HOLDER - 2.0 * (0.5 * nearest / step).floor());
        Self { offset, least: (step * HOLDER).to_bits(), dropped: 0 }
    }

    /// Distances of any range, in steps of `alike` at most, if that is not 0 and so many steps have numbers.
    pub(crate) fn of(runs: &[Run], alike: f32) -> Self {
        let ends = |i: usize| runs.iter().map(move |run| run.distances[i]);
        let (nearest, farthest) =
            (ends(0).fold(f32::INFINITY, f32::min), ends(1).fold(f32::NEG_INFINITY, f32::max));
        let step = alike.log2().floor().exp2();
        if step > 0.0 && farthest - nearest < step * ((1 << (2 * DIGIT)) - 4) as f32 {
            // What is rounded to which doesn't go by what else there is.
            return Self::in_steps(step, nearest);
        }
        let offset = if nearest > 0.0 { 0.0 } else { farthest - 2.0 * nearest };
        // What is so near that it would cost the rest precision is equally near.
        const NEAR: f32 = 1.0 / (1_u64 << 32) as f32;
        let [nearest, farthest] = [nearest, farthest].map(|distance| distance + offset);
        let (least, most) = (nearest.max(farthest * NEAR).to_bits(), farthest.to_bits());
        let bits = u32::BITS - most.saturating_sub(least).leading_zeros();
        Self { offset, least, dropped: bits.saturating_sub(2 * DIGIT).max(DROPPED) }
    }

    #[inline(always)]
    pub(crate) fn key(self, distance: f32) -> u32 {
        (distance + self.offset).to_bits().saturating_sub(self.least) >> self.dropped
    }
}

/// A stable radix sort on all threads.
///
/// Numbers move by relaxed atomic stores, each to a place of its own: plain stores to the processor, and the
/// result does not depend on the number of threads.
#[derive(Default)]
pub(crate) struct Sorter {
    counts: Vec<[u32; BUCKETS]>,
}

impl Sorter {
    /// Sorts the places of `runs` by the keys of distances there, and gives them in the array of the distances.
    /// Runs are about as long as each other; `scratch` has room for all.
    pub(crate) fn sort<'a>(
        &mut self,
        (runs, keys): (&[Run], Keys),
        distances: &'a [AtomicU32],
        scratch: &[AtomicU64],
    ) -> &'a [AtomicU32] {
        let count: usize = runs.iter().map(|run| run.len).sum();
        let shares = rayon::current_num_threads().max(1);
        let share_of = |share: usize, whole: usize| share * whole / shares..(share + 1) * whole / shares;
        // An entry is a key and, as its low half, a place.
        let low = |entry: u64| (entry >> 32) as usize % BUCKETS;
        let high = |entry: u64| (entry >> (32 + DIGIT)) as usize % BUCKETS;
        let unsorted = |share| {
            let runs = &runs[share_of(share, runs.len())];
            runs.iter().flat_map(move |run| {
                distances[run.places()].iter().zip(run.start as u64..).map(move |(distance, place)| {
                    u64::from(keys.key(f32::from_bits(distance.load(Relaxed)))) << 32 | place
                })
            })
        };
        self.pass(shares, unsorted, low, move |to, entry| scratch[to].store(entry, Relaxed));
        let sorted = &distances[..count];
        let farthest = runs.iter().map(|run| run.distances[1]).fold(f32::NEG_INFINITY, f32::max);
        if keys.key(farthest) >> DIGIT == 0 {
            // As slabs most often have; that all are in one bucket would be counted one after the other.
            let entries = scratch[..count].par_iter().zip(sorted).with_min_len(ENTRIES_A_TASK);
            entries.for_each(|(entry, place)| place.store(entry.load(Relaxed) as u32, Relaxed));
            return sorted;
        }
        let half_sorted = |share| scratch[share_of(share, count)].iter().map(|entry| entry.load(Relaxed));
        self.pass(shares, half_sorted, high, move |to, entry| distances[to].store(entry as u32, Relaxed));
        sorted
    }

    /// Stores all entries at their places by one digit.
    fn pass<I: Iterator<Item = u64>>(
        &mut self,
        shares: usize,
        entries: impl Fn(usize) -> I + Sync,
        digit: impl Fn(u64) -> usize + Sync,
        store: impl Fn(usize, u64) + Sync + Copy,
    ) {
        self.counts.clear();
        self.counts.resize(shares, [0; BUCKETS]);
        self.counts.par_iter_mut().enumerate().for_each(|(share, counts)| {
            entries(share).for_each(|entry| counts[digit(entry)] += 1);
        });
        // Where each share puts its first entry of each bucket.
        let mut next = 0;
        for bucket in 0..BUCKETS {
            for counts in &mut self.counts {
                (counts[bucket], next) = (next, next + counts[bucket]);
            }
        }
        let (entries, digit) = (&entries, &digit);
        self.counts.par_iter_mut().enumerate().for_each(|(share, next)| {
            // It has a copy of `store`, so that no store seems to change where it goes.
            entries(share).for_each(move |entry| {
                let place = &mut next[digit(entry)];
                store(*place as usize, entry);
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
            distances in prop_oneof![
                prop::collection::vec(prop_oneof![0.1..0.11f32, 0.1..1000.0f32, -5.0..5.0f32], 0..3000),
                prop::collection::vec(0..2048_u16, 0..3000).prop_map(|numbers| numbers.into_iter().map(f32::from).collect()),
                prop::collection::vec(2000..9999_u16, 0..3000).prop_map(|numbers| numbers.into_iter().map(f32::from).collect()),
            ],
            are_numbers in any::<bool>(),
            alike in prop::sample::select(vec![0.0, 1e-3, 0.3, 50.0_f32]),
            threads in 1..5_usize,
        ) {
            // Runs of a hundred with gaps between them.
            let places: Vec<AtomicU32> =
                (0..distances.len().div_ceil(100) * 150 + 150).map(|_| AtomicU32::new(u32::MAX)).collect();
            let scratch: Vec<AtomicU64> = distances.iter().map(|_| AtomicU64::new(u64::MAX)).collect();
            let mut runs = Vec::new();
            for (number, chunk) in distances.chunks(100).enumerate() {
                let mut run = Run::new(number * 150);
                for (place, distance) in places[run.start..].iter().zip(chunk) {
                    place.store(distance.to_bits(), Relaxed);
                    run.include([*distance; 2]);
                    run.len += 1;
                }
                runs.push(run);
            }
            let are_numbers = are_numbers && distances.iter().all(|distance| distance.fract() == 0.0);
            let keys = if are_numbers { Keys::OF_NUMBERS } else { Keys::of(&runs, alike) };
            let mut expected: Vec<usize> = (0..distances.len()).collect();
            expected.sort_by_key(|i| keys.key(distances[*i]));
            let expected: Vec<usize> = expected.into_iter().map(|i| i / 100 * 150 + i % 100).collect();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let sorted = pool.install(|| Sorter::default().sort((&runs, keys), &places, &scratch));
            let found: Vec<usize> = sorted.iter().map(|entry| entry.load(Relaxed) as usize).collect();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn keys_sort_as_distances_do(
            ends in prop_oneof![[-1e3..1e6f32, -1e3..1e6f32], [0.0..1e6f32, 1e-12..1e6f32]],
            shares in prop::array::uniform2(0.0..=1.0f32),
            share_alike in prop::sample::select(vec![0.0, 1e-3, 0.1_f32]),
        ) {
            let mut run = Run::new(0);
            ends.into_iter().for_each(|end| run.include([end; 2]));
            let alike = share_alike * (run.distances[1] - run.distances[0]);
            let keys = Keys::of(&[run], alike);
            let [a, b] = shares.map(|share| (ends[0] + share * (ends[1] - ends[0])).clamp(run.distances[0], run.distances[1]));
            let [near, far] = [a.min(b), a.max(b)];
            prop_assert!(keys.key(near) <= keys.key(far));
            prop_assert!(keys.key(far) >> (2 * DIGIT) == 0, "{:b} has too many bits", keys.key(far));
            // Of itself, or of all where distances have any sign.
            let size = if run.distances[0] > 0.0 { far } else { run.distances[1] - run.distances[0] };
            let is_far_apart = far - near > size * 2f32.powi(-16) && far > run.distances[1] * 2f32.powi(-31);
            let is_far_apart = is_far_apart && far - near > 1.01 * alike;
            prop_assert!(!is_far_apart || keys.key(near) < keys.key(far));
        }
    }

    #[test]
    fn fractions_come_between_the_whole_numbers_around_them() {
        for farthest in [0.7, 13.5, 150.0, 4e4, 3e6, 4_194_303.0_f32] {
            let mut run = Run::new(0);
            run.include([0.0, farthest]);
            let keys = Keys::of_fractions(&[run]);
            for number in [0.0, 1.0, 7.0, 149.0, 4_194_302.0].into_iter().filter(|n| n + 1.0 <= farthest) {
                let places = [0.0, 0.25, 0.5, 0.75, 1.0].map(|part| keys.key(number + part));
                assert!(places.is_sorted() && places[0] < places[4], "{number} of {farthest}: {places:?}");
                // A two millionth of all, or a slab, is told apart.
                let steps = f64::from(places[4] - places[0]);
                let least = (4_194_300.0 / 2.0 / f64::from(farthest)).clamp(1.0, 1e6);
                assert!(steps >= least, "{number} of {farthest}: {steps}");
            }
            assert!(keys.key(farthest) < 1 << (2 * DIGIT), "{farthest}");
        }
    }
}
