//! Surfels in the making, number by number.

use super::lanes::*;
use super::surfel::NUMBERS;

/// Each number of surfels in a row of its own.
#[derive(Default)]
pub(super) struct Columns {
    numbers: [Vec<f32>; NUMBERS],
    len: usize,
}

impl Columns {
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends those that `is_there` tells.
    #[inline(always)]
    pub(super) fn push<S: Simd>(&mut self, numbers: [F<S>; NUMBERS], is_there: M<S>) {
        let end = self.len + F::<S>::LEN;
        for (to, numbers) in self.numbers.iter_mut().zip(numbers) {
            if to.len() < end {
                to.resize(2 * end, 0.0);
            }
            numbers.compress(is_there).store_slice(&mut to[self.len..end]);
        }
        self.len += is_there.to_bitmask().count_ones() as usize;
    }

    /// Puts them into an array, one row of numbers after the other.
    pub(super) fn gather(&self, to: &mut Vec<f32>) {
        to.clear();
        to.reserve_exact(NUMBERS * self.len);
        for numbers in &self.numbers {
            to.extend_from_slice(numbers.get(..self.len).unwrap_or_default());
        }
    }
}
