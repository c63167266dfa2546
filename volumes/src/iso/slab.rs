//! Consecutive slices of a grid, as many as are in memory.

use bytemuck::Pod;
use fearless_simd::{f32x16, i16x16, u8x16, u16x16};

use super::lanes::*;
use super::window::ROW;

/// A number that a sample can be.
pub(super) trait Scalar: Pod + PartialOrd + Send + Sync {
    /// Below all others, and above.
    const ENDS: [Self; 2];

    fn number(self) -> f32;

    /// How far above a value it is, so far that differences are finite: NaN if it is not finite, 0 only where both are equal.
    fn above(self, value: f32) -> f32;

    /// Which of sixteen samples are inside, those from a value on, which some samples reach, and which are outside; those that are not finite are neither.
    fn sides<S: Simd>(simd: S, samples: &[Self; 16], value: f32) -> [u32; 2];
}

macro_rules! impl_integers {
    ($($integer:ty, $row:ident);*) => {$(
        impl Scalar for $integer {
            const ENDS: [Self; 2] = [Self::MIN, Self::MAX];

            #[inline(always)]
            fn number(self) -> f32 {
                f32::from(self)
            }

            #[inline(always)]
            fn above(self, value: f32) -> f32 {
                f32::from(self) - value
            }

            #[inline(always)]
            fn sides<S: Simd>(simd: S, samples: &[Self; 16], value: f32) -> [u32; 2] {
                let least = $row::splat(simd, value.ceil() as $integer);
                let inside = $row::from_slice(simd, samples).simd_ge(least).to_bitmask() as u32;
                [inside, inside ^ 0xffff]
            }
        }
    )*};
}

impl_integers!(u8, u8x16; u16, u16x16; i16, i16x16);

impl Scalar for f32 {
    const ENDS: [Self; 2] = [f32::NEG_INFINITY, f32::INFINITY];

    #[inline(always)]
    fn number(self) -> f32 {
        self
    }

    #[inline(always)]
    fn above(self, value: f32) -> f32 {
        if self.is_finite() { (self - value).clamp(-1e38, 1e38) } else { f32::NAN }
    }

    #[inline(always)]
    fn sides<S: Simd>(simd: S, samples: &[Self; 16], value: f32) -> [u32; 2] {
        let samples = f32x16::from_slice(simd, samples);
        let inside = samples.simd_ge(f32x16::splat(simd, value)).to_bitmask() as u32;
        let is_there = samples.is_finite().to_bitmask() as u32;
        [inside & is_there, !inside & is_there]
    }
}

/// Slices `first` and following of a grid of `dims` samples.
#[derive(Clone, Copy)]
pub(super) struct Slab<'a, T> {
    pub(super) samples: &'a [T],
    pub(super) dims: [usize; 3],
    pub(super) first: usize,
}

impl<T: Scalar> Slab<'_, T> {
    /// Row (j, k), where slice k is in memory.
    #[inline(always)]
    pub(super) fn row(&self, j: usize, k: usize) -> &[T] {
        let [nx, ny, _] = self.dims;
        &self.samples[((k - self.first) * ny + j) * nx..][..nx]
    }

    /// Samples in memory from one on; any for those that are not there, before the first, too, where `first` is that much below 2⁶⁴.
    #[inline(always)]
    pub(super) fn samples(&self, first: usize) -> [T; ROW] {
        let there = self.samples.get(first..first.wrapping_add(ROW)).and_then(|row| row.try_into().ok());
        there.unwrap_or_else(|| self.samples_at_ends(first))
    }

    #[cold]
    fn samples_at_ends(&self, first: usize) -> [T; ROW] {
        let at = |number| self.samples.get(first.wrapping_add(number)).copied();
        std::array::from_fn(|number| at(number).unwrap_or(T::ENDS[0]))
    }
}

/// Evaluates an expression on voxels of any type; `$slab` is the [`Slab`] of them.
macro_rules! with_slab {
    ($voxels:expr, $dims:expr, $first:expr, $slab:ident => $op:expr) => {
        match $voxels {
            $crate::volume::Voxels::U8(samples) => {
                let $slab = $crate::iso::slab::Slab { samples, dims: $dims, first: $first };
                $op
            }
            $crate::volume::Voxels::U16(samples) => {
                let $slab = $crate::iso::slab::Slab { samples, dims: $dims, first: $first };
                $op
            }
            $crate::volume::Voxels::I16(samples) => {
                let $slab = $crate::iso::slab::Slab { samples, dims: $dims, first: $first };
                $op
            }
            $crate::volume::Voxels::F32(samples) => {
                let $slab = $crate::iso::slab::Slab { samples, dims: $dims, first: $first };
                $op
            }
        }
    };
}
pub(super) use with_slab;
