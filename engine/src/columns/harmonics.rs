//! Directional colours of splats, packed.

use super::{BLOCKS_A_TASK, LANES};
use crate::cloud::Harmonics;
use rayon::prelude::*;

/// Coefficients of [`Harmonics`] in 16 bits: integers times one unit, so each is off by at most half of that,
/// 1.6e-5 of the largest one. At degree 3 a splat takes 96 bytes instead of 180, and reading them is what
/// evaluating costs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PackedHarmonics {
    pub(crate) degree: u8,
    pub(crate) unit: f32,
    /// Pairs of coefficients of one channel, the first of a pair in the low half; of each block red's pairs
    /// come first, then green's, then blue's.
    pairs: Vec<[u32; LANES]>,
}

impl PackedHarmonics {
    pub(super) fn new(harmonics: Harmonics) -> Self {
        let per_splat = harmonics.per_splat();
        let Harmonics { degree, coefficients } = harmonics;
        let largest = coefficients
            .par_iter()
            .with_min_len(BLOCKS_A_TASK * LANES)
            .map(|color| color.iter().fold(0.0, |largest: f32, c| largest.max(c.abs())))
            .reduce(|| 0.0, f32::max);
        let unit = if largest > 0.0 { largest / f32::from(i16::MAX) } else { 1.0 };
        let mut packed = Self { degree, unit, pairs: Vec::new() };
        let (pairs_per_channel, pairs_per_block) = (packed.pairs_per_channel(), packed.pairs_per_block());
        let blocks = (coefficients.len() / per_splat).div_ceil(LANES);
        packed.pairs = vec![[0; LANES]; blocks * pairs_per_block];
        let pack = |(pairs, coefficients): (&mut [[u32; LANES]], &[[f32; 3]])| {
            for (lane, splat) in coefficients.chunks_exact(per_splat).enumerate() {
                for (number, color) in splat.iter().enumerate() {
                    for (channel, value) in color.iter().enumerate() {
                        let rounded = (value / unit).round() as i16;
                        let pair = &mut pairs[channel * pairs_per_channel + number / 2][lane];
                        *pair |= u32::from(rounded as u16) << (number % 2 * 16);
                    }
                }
            }
        };
        let coefficients = coefficients.par_chunks(LANES * per_splat);
        packed.pairs.par_chunks_mut(pairs_per_block).zip(coefficients).for_each(pack);
        packed
    }

    /// As [`Columns::reorder`](super::Columns::reorder).
    pub(super) fn reorder(&mut self, order: &[u32], run: usize) {
        let count = self.pairs_per_block();
        self.pairs.par_chunks_mut(run / LANES * count).zip(order.par_chunks(run)).for_each(
            |(pairs, order)| {
                let before = pairs.to_vec();
                for (block, order) in pairs.chunks_mut(count).zip(order.chunks(LANES)) {
                    for (lane, from) in order.iter().enumerate() {
                        let from = *from as usize;
                        let before = &before[from / LANES * count..];
                        block
                            .iter_mut()
                            .zip(before)
                            .for_each(|(pair, before)| pair[lane] = before[from % LANES]);
                    }
                }
            },
        );
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.pairs[..])
    }

    pub(crate) fn pairs_per_channel(&self) -> usize {
        Harmonics::count(self.degree).div_ceil(2)
    }

    fn pairs_per_block(&self) -> usize {
        3 * self.pairs_per_channel()
    }

    /// The pairs of splats 8 · block up to 8 · block + 7.
    #[inline(always)]
    pub(crate) fn block(&self, block: usize) -> &[[u32; LANES]] {
        let count = self.pairs_per_block();
        &self.pairs[block * count..][..count]
    }

    /// The coefficients of one splat.
    pub(crate) fn row(&self, index: usize) -> impl Iterator<Item = [f32; 3]> + '_ {
        let block = self.block(index / LANES);
        (0..Harmonics::count(self.degree)).map(move |number| {
            std::array::from_fn(|channel| {
                let pair = block[channel * self.pairs_per_channel() + number / 2][index % LANES];
                f32::from((pair >> (number % 2 * 16)) as u16 as i16) * self.unit
            })
        })
    }

    pub(super) fn unpacked(&self, len: usize) -> Harmonics {
        Harmonics { degree: self.degree, coefficients: (0..len).flat_map(|i| self.row(i)).collect() }
    }
}
