//! Surfels in the making, number by number.

use super::lanes::*;
use super::surfel::NUMBERS;

/// Each number of surfels in a row of its own, one row after the other.
#[derive(Default)]
pub(super) struct Columns {
    numbers: Vec<f32>,
    /// Of a row.
    capacity: usize,
    len: usize,
}

impl Columns {
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends those that `is_there` tells.
    #[inline(always)]
    pub(super) fn push<S: Simd>(&mut self, numbers: [F<S>; NUMBERS], is_there: M<S>) {
        if self.len + F::<S>::LEN > self.capacity {
            self.grow();
        }
        for (row, numbers) in self.numbers.chunks_exact_mut(self.capacity).zip(numbers) {
            numbers.compress(is_there).store_slice(&mut row[self.len..][..F::<S>::LEN]);
        }
        self.len += is_there.to_bitmask().count_ones() as usize;
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self) {
        let capacity = (2 * self.capacity).max(1024);
        let mut numbers = vec![0.0; NUMBERS * capacity];
        for (to, from) in numbers.chunks_exact_mut(capacity).zip(self.rows()) {
            to[..from.len()].copy_from_slice(from);
        }
        (self.numbers, self.capacity) = (numbers, capacity);
    }

    fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.numbers.chunks_exact(self.capacity.max(1)).map(|row| &row[..self.len])
    }

    /// Puts them into an array, one row of numbers after the other.
    pub(super) fn gather(&self, to: &mut Vec<f32>) {
        to.clear();
        to.reserve_exact(NUMBERS * self.len);
        for row in self.rows() {
            to.extend_from_slice(row);
        }
    }
}
