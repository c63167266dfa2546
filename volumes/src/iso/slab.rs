//! Consecutive slices of a grid, as many as are in memory.

/// A number that a sample can be.
pub(super) trait Scalar: Copy + PartialOrd + Send + Sync {
    /// Below all others, and above.
    const ENDS: [Self; 2];

    fn number(self) -> f32;

    /// How far above a value it is, so far that differences are finite: NaN if it is not finite, 0 only where both are equal.
    fn above(self, value: f32) -> f32;
}

macro_rules! impl_integers {
    ($($integer:ty),*) => {$(
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
        }
    )*};
}

impl_integers!(u8, u16, i16);

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
