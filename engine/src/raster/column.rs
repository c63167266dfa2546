//! Numbers of a tile's records side by side, as many as go together.

use crate::columns::{LANES, Lanes};
use crate::simd::*;

/// Records that are rasterized together: as many as a mask has bits.
pub(crate) const BATCH: usize = u64::BITS as usize;

/// A number for each record of a batch.
pub(crate) type Column = [f32; BATCH];

/// Where numbers of some of an octet's surfels are put side by side.
#[derive(Clone, Copy)]
pub(crate) struct Place<S: Simd> {
    pub(crate) first: usize,
    pub(crate) some: M<S>,
    /// Which, where it is only one.
    pub(crate) one: Option<usize>,
}

impl<S: Simd> Place<S> {
    /// Puts them in a column. What is behind them, up to eight numbers from the first place on, may be lost.
    #[inline(always)]
    pub(crate) fn put(&self, simd: S, column: &mut Column, numbers: &Lanes) {
        match self.one {
            Some(lane) => column[self.first % BATCH] = numbers[lane % LANES],
            None => simd
                .compress_f32x8(V::simd_from(simd, *numbers), self.some)
                .store_slice(&mut column[self.first..self.first + LANES]),
        }
    }
}

/// The numbers of eight records.
#[inline(always)]
pub(crate) fn eight<S: Simd>(simd: S, column: &Column, first: usize) -> V<S> {
    let first = first % BATCH;
    V::from_slice(simd, &column[first..first + LANES])
}

/// As [`eight`], of some columns.
#[inline(always)]
pub(crate) fn eight_of<S: Simd, const N: usize>(simd: S, columns: &[Column; N], first: usize) -> [V<S>; N]
where
    for<'a> [&'a Column; N]: Each<&'a Column, N>,
{
    columns.each_ref().each(
        #[inline(always)]
        |column| eight(simd, column, first),
    )
}

/// The numbers of sixteen records.
#[inline(always)]
pub(crate) fn sixteen<S: Simd>(simd: S, column: &Column, first: usize) -> W<S> {
    W::from_slice(simd, &column[first..first + 16])
}

/// As [`sixteen`], of some columns.
#[inline(always)]
pub(crate) fn sixteen_of<S: Simd, const N: usize>(simd: S, columns: &[Column; N], first: usize) -> [W<S>; N]
where
    for<'a> [&'a Column; N]: Each<&'a Column, N>,
{
    columns.each_ref().each(
        #[inline(always)]
        |column| sixteen(simd, column, first),
    )
}
