//! A brick's samples with those around them, as f32 above the value: NaN stands for samples outside the grid and for
//! values that are not finite.

use bytemuck::{Pod, Zeroable};

use super::hierarchy::SIDE;
use super::slab::{Scalar, Slab};

/// Samples before the brick's, and after the last corners of its cells, as cubic splines of their corners' neighbours need.
pub(super) const HALO: usize = 2;
/// Samples along y and z.
const WIDTH: usize = SIDE + 1 + 2 * HALO;
/// Samples along x, more than are needed.
pub(super) const ROW: usize = 16;
/// From a sample to the next along y and z.
pub(super) const STRIDES: [usize; 2] = [ROW, ROW * WIDTH];

/// Samples from a cell's neighbourhood's first to its last: four along each axis.
pub(super) const SPAN: usize = 3 * STRIDES[1] + 3 * STRIDES[0] + 4;

/// A line of the cache.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; ROW]);

/// See above.
pub(super) struct Window {
    values: Box<[Line; WIDTH * WIDTH]>,
}

impl Default for Window {
    fn default() -> Self {
        Self { values: Box::new([Line([f32::NAN; ROW]); WIDTH * WIDTH]) }
    }
}

impl Window {
    /// Takes over another's numbers.
    #[inline(always)]
    pub(super) fn copy_from(&mut self, other: &Self) {
        *self.values = *other.values;
    }

    /// Loads the brick whose first sample is `base`, and so many rows of samples around it, at most [`HALO`].
    #[inline(always)]
    pub(super) fn load<T: Scalar>(
        &mut self,
        slab: Slab<'_, T>,
        base: [usize; 3],
        (value, halo): (f32, usize),
    ) {
        let [nx, ny, nz] = slab.dims;
        // Rows begin at base − HALO, so all indices here are that much too large.
        let skipped = HALO.saturating_sub(base[0]);
        let first = base[0] + skipped - HALO;
        let count = (ROW - skipped).min(nx - first);
        for k in HALO - halo..WIDTH - (HALO - halo) {
            let plane = &mut self.values[k * WIDTH..][..WIDTH];
            let k = base[2] + k;
            let is_slice = k >= HALO && k < nz + HALO;
            let rows = plane.iter_mut().enumerate().take(WIDTH - (HALO - halo)).skip(HALO - halo);
            for (j, to) in rows {
                let j = base[1] + j;
                if !is_slice || j < HALO || j >= ny + HALO {
                    *to = Line([f32::NAN; ROW]);
                    continue;
                }
                let row = &slab.row(j - HALO, k - HALO)[first..][..count];
                // A place of its own: what is written can't change what is read.
                let mut numbers = [f32::NAN; ROW];
                if let Ok(row) = <&[T; ROW]>::try_from(row) {
                    for (number, sample) in numbers.iter_mut().zip(row) {
                        *number = sample.above(value);
                    }
                } else {
                    for (number, sample) in numbers[skipped..].iter_mut().zip(row) {
                        *number = sample.above(value);
                    }
                }
                *to = Line(numbers);
            }
        }
    }

    /// Row (j, k) of the brick's samples, from 0 to [`SIDE`]: its first sample has index [`HALO`].
    #[inline(always)]
    pub(super) fn row(&self, j: usize, k: usize) -> &[f32; ROW] {
        &self.values[(k + HALO) * WIDTH + j + HALO].0
    }

    /// The samples around a cell from its lowest corner's lower neighbours on; `None` never is.
    #[inline(always)]
    pub(super) fn around(&self, [i, j, k]: [usize; 3]) -> Option<&[f32; SPAN]> {
        let first = (k + HALO - 1) * STRIDES[1] + (j + HALO - 1) * STRIDES[0] + i + HALO - 1;
        self.numbers().get(first..first + SPAN)?.try_into().ok()
    }

    /// All numbers, in order.
    #[inline(always)]
    pub(super) fn numbers(&self) -> &[f32] {
        bytemuck::cast_slice(&self.values[..])
    }

    #[inline(always)]
    pub(super) fn numbers_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.values[..])
    }
}
