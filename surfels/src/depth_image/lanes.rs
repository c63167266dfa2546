//! Sixteen pixels of a row at once.
//!
//! What works with them is `#[inline(always)]` down from where the level of SIMD is chosen.

pub(super) use fearless_simd::prelude::*;
pub(super) use oblate_engine::simd::Simd;
use rayon::prelude::*;

/// Pixels that are worked on together.
pub(super) const LANES: usize = 16;

/// A number of each.
pub(super) type F<S> = fearless_simd::f32x16<S>;

/// A vector of each.
pub(super) type F3<S> = [F<S>; 3];

/// How far beside a pixel anybody looks.
pub(super) const BORDER: usize = 2;

/// A number for each pixel of an image, with zeros around them: nobody needs to ask where the image ends.
#[derive(Default)]
pub(super) struct Bordered {
    width: usize,
    /// How far the pixel below is.
    pub(super) stride: usize,
    numbers: Vec<f32>,
}

impl Bordered {
    /// An image of this size, in the memory of one of the same: then its numbers are old, and only those around them zeros.
    pub(super) fn renewed(self, [width, height]: [usize; 2]) -> Self {
        let stride = width.next_multiple_of(LANES) + 2 * BORDER;
        let len = stride * (height + 2 * BORDER);
        if self.width == width && self.numbers.len() == len {
            return self;
        }
        Self { width, stride, numbers: rayon::iter::repeat_n(0.0, len).with_min_len(1 << 14).collect() }
    }

    /// One number after the other.
    #[cfg(test)]
    pub(super) fn of(width: usize, pixels: &[f32]) -> Self {
        let mut image = Self::default().renewed([width, pixels.len() / width]);
        image
            .rows()
            .zip(pixels.par_chunks(width))
            .for_each(|(row, pixels)| row[..width].copy_from_slice(pixels));
        image
    }

    /// The rows, each up to a multiple of [`LANES`].
    pub(super) fn rows(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        let (stride, height) = (self.stride, self.numbers.len() / self.stride - 2 * BORDER);
        let rows = self.numbers.par_chunks_mut(stride).skip(BORDER).take(height);
        rows.map(move |row| &mut row[BORDER..stride - BORDER])
    }

    /// All numbers, those of the borders among them.
    pub(super) fn numbers(&self) -> &[f32] {
        &self.numbers
    }

    /// Where a pixel is, in all images of this size.
    pub(super) fn place(&self, [column, row]: [usize; 2]) -> usize {
        debug_assert!(column < self.width);
        (row + BORDER) * self.stride + column + BORDER
    }

    /// The pixels from a place on.
    #[inline(always)]
    pub(super) fn load<S: Simd>(&self, simd: S, place: usize) -> F<S> {
        F::from_slice(simd, &self.numbers[place..place + LANES])
    }
}

#[inline(always)]
pub(super) fn splat<S: Simd>(simd: S, number: f32) -> F<S> {
    F::splat(simd, number)
}
