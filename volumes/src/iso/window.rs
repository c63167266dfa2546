//! A part's samples with those around them, as f32 above the value: NaN stands for samples outside the grid and for
//! values that are not finite.

use bytemuck::{Pod, Zeroable};

use super::cells::{PART, Part};
use super::crossed::Sides;
use super::lanes::Simd;
use super::slab::{Scalar, Slab};

/// Samples before the part's, and after the last corners of its cells, as cubic splines of their corners' neighbours need.
pub(super) const HALO: usize = 2;
/// Samples along y and z.
const WIDTH: usize = PART[1] + 1 + 2 * HALO;
/// Samples along x: as many as are needed and more, whole registers of sixteen.
pub(super) const ROW: usize = 48;
const _: () = assert!(ROW.is_multiple_of(16) && ROW > PART[0] + 2 * HALO && PART[1] == PART[2]);
/// From a sample to the next along y and z.
pub(super) const STRIDES: [usize; 2] = [ROW, ROW * WIDTH];

/// Samples from a cell's neighbourhood's first to its last: four along each axis.
pub(super) const SPAN: usize = 3 * STRIDES[1] + 3 * STRIDES[0] + 4;

/// Whole lines of the cache.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Row([f32; ROW]);

/// See above.
pub(super) struct Window {
    /// By z, y.
    rows: Vec<Row>,
}

impl Default for Window {
    fn default() -> Self {
        Self { rows: vec![Row([f32::NAN; ROW]); WIDTH * WIDTH] }
    }
}

impl Window {
    /// Takes over another's numbers.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.rows.copy_from_slice(&other.rows);
    }

    /// Loads a part and so many rows of samples around it, at most [`HALO`]; gives the sides of its own.
    #[inline(always)]
    pub(super) fn load<S: Simd, T: Scalar>(
        &mut self,
        simd: S,
        (slab, value): (Slab<'_, T>, f32),
        (part, halo): (&Part, usize),
    ) -> Sides {
        let mut sides = Sides::NONE;
        let [nx, ny, nz] = slab.dims;
        let base = part.base;
        // Of a row what lies in the grid: the rest is of the rows beside it in memory.
        let (begin, end) = (HALO.saturating_sub(base[0]), ROW.min(nx + HALO - base[0]));
        let [loaded_j, loaded_k] = [1, 2].map(|axis| HALO - halo..HALO + part.cells[axis] + 1 + halo);
        for k in loaded_k {
            let rows = &mut self.rows[k * WIDTH..][..WIDTH];
            let slice = (base[2] + k).wrapping_sub(HALO);
            let row_of = |j: usize| (base[1] + j).wrapping_sub(HALO);
            // First rows as they are: in so short a loop many wait for memory at once.
            for j in loaded_j.clone() {
                if row_of(j) < ny && slice < nz {
                    let first = (((slice - slab.first) * ny + row_of(j)) * nx + base[0]).wrapping_sub(HALO);
                    *samples_in(&mut rows[j]) = slab.samples(first);
                }
            }
            for j in loaded_j.clone() {
                if row_of(j) >= ny || slice >= nz {
                    rows[j].0 = [f32::NAN; ROW];
                    continue;
                }
                let samples: [T; ROW] = *samples_in(&mut rows[j]);
                sides.set(simd, &samples, value, [j, k].map(|place| place.wrapping_sub(HALO)));
                let numbers = &mut rows[j].0;
                for (number, sample) in numbers.iter_mut().zip(&samples) {
                    *number = sample.above(value);
                }
                if end - begin < ROW {
                    numbers[..begin].fill(f32::NAN);
                    numbers[end..].fill(f32::NAN);
                }
            }
        }
        sides
    }

    /// Goes straight on beyond the grid's borders by a sample, so that central differences there are one-sided ones.
    pub(super) fn extend(&mut self, part: &Part, dims: [usize; 3]) {
        for (axis, samples) in dims.into_iter().enumerate() {
            let (first, last) = (HALO, HALO + part.cells[axis]);
            if part.base[axis] == 0 {
                self.extend_along(axis, [first - 1, first, first + 1]);
            }
            if part.base[axis] + part.cells[axis] + 1 == samples {
                self.extend_along(axis, [last + 1, last, last - 1]);
            }
        }
    }

    /// Sets the first of three layers of samples across an axis to what goes on from the others.
    fn extend_along(&mut self, axis: usize, layers: [usize; 3]) {
        let numbers = self.numbers_mut();
        let strides = [1, STRIDES[0], STRIDES[1]];
        let counts = [ROW, WIDTH, WIDTH];
        let [u, v] = [[2, 1], [2, 0], [1, 0]][axis];
        for i in 0..counts[u] {
            let starts = layers.map(|at| at * strides[axis] + i * strides[u]);
            for j in 0..counts[v] {
                let [to, near, far] = starts.map(|start| start + j * strides[v]);
                numbers[to] = 2.0 * numbers[near] - numbers[far];
            }
        }
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
        bytemuck::cast_slice(&self.rows)
    }

    #[inline(always)]
    pub(super) fn numbers_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.rows)
    }
}

/// Room for a row's samples where their numbers will be.
#[inline(always)]
fn samples_in<T: Scalar>(row: &mut Row) -> &mut [T; ROW] {
    bytemuck::from_bytes_mut(&mut bytemuck::bytes_of_mut(row)[..size_of::<[T; ROW]>()])
}
