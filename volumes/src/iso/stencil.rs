//! The samples around cells, those of as many cells as four registers have lanes.

use super::lanes::*;
use super::window::{SPAN, STRIDES};
use crate::field::difference;

/// The rows along x that a cell's corners are in, each by its places along y and z in a neighbourhood of four.
const OWN: [[usize; 2]; 4] = [[1, 1], [2, 1], [1, 2], [2, 2]];
/// Those beside them: central differences at the corners need their middle two samples.
const BESIDE: [[usize; 2]; 8] = [[0, 1], [3, 1], [0, 2], [3, 2], [1, 0], [2, 0], [1, 3], [2, 3]];

/// Registers of sheets that go through each stage together: the next one's numbers are on their way while one's wait for each other.
pub(super) const REGISTERS: usize = 4;
/// The most sheets of a batch.
const MOST: usize = REGISTERS * MOST_LANES;

/// The four numbers of a row for each cell.
type Row = [[f32; 4]; MOST];
/// The middle two of a row for each cell.
type Pair = [[f32; 2]; MOST];

/// Sheets in cells, each with the samples around its cell.
#[repr(align(64))]
pub(super) struct Batch {
    /// Of the rows of [`OWN`].
    own: [Row; 4],
    /// Of the rows of [`BESIDE`].
    beside: [Pair; 8],
    /// Coefficients of a spline, by y + 4 z, where there is one.
    pub(super) coefficients: [Row; 16],
    /// The cells' lowest corners, in samples of the grid.
    pub(super) cells: [[u32; MOST]; 3],
    /// The corners inside each sheet, as bits.
    pub(super) sheets: [u32; MOST],
    pub(super) len: usize,
}

impl Batch {
    pub(super) fn new() -> Self {
        Self {
            own: [[[0.0; 4]; MOST]; 4],
            beside: [[[0.0; 2]; MOST]; 8],
            coefficients: [[[0.0; 4]; MOST]; 16],
            cells: [[0; MOST]; 3],
            // Of cells that are not there, some that are sure to be well-behaved.
            sheets: [1; MOST],
            len: 0,
        }
    }

    /// Adds a sheet of a cell, where there is room.
    #[inline(always)]
    pub(super) fn push(&mut self, around: &[f32; SPAN], cell: [usize; 3], sheet: u8) {
        let lane = self.len % MOST;
        for (row, [y, z]) in self.own.iter_mut().zip(OWN) {
            row[lane] = row_at(around, y, z);
        }
        for (pair, [y, z]) in self.beside.iter_mut().zip(BESIDE) {
            let [_, low, high, _] = row_at(around, y, z);
            pair[lane] = [low, high];
        }
        for (cells, index) in self.cells.iter_mut().zip(cell) {
            cells[lane] = index as u32;
        }
        self.sheets[lane] = u32::from(sheet);
        self.len += 1;
    }

    /// Adds the spline's coefficients around the cell that was added last.
    #[inline(always)]
    pub(super) fn push_coefficients(&mut self, around: &[f32; SPAN]) {
        let lane = (self.len + MOST - 1) % MOST;
        for (number, row) in self.coefficients.iter_mut().enumerate() {
            row[lane] = row_at(around, number % 4, number / 4);
        }
    }

    /// Central differences at the corners of one cell, interpolated at p: where samples are missing, as
    /// [`difference`] has it.
    #[cold]
    fn careful_differences(&self, number: usize, p: [f32; 3]) -> [f32; 3] {
        let at = |[x, y, z]: [usize; 3]| {
            let own = OWN.iter().position(|row| *row == [y, z]).map(|row| self.own[row][number][x]);
            let beside = || {
                let pair = BESIDE.iter().position(|row| *row == [y, z])?;
                self.beside[pair][number].get(x.wrapping_sub(1)).copied()
            };
            own.or_else(beside).unwrap_or(f32::NAN)
        };
        let mut sum = [0.0; 3];
        for corner in 0..8 {
            let upper = [corner & 1, corner >> 1 & 1, corner >> 2];
            let here = upper.map(|bit| 1 + bit);
            let shares = [0, 1, 2].map(|a| if upper[a] == 1 { p[a] } else { 1.0 - p[a] });
            for (axis, sum) in sum.iter_mut().enumerate() {
                let (mut before, mut after) = (here, here);
                before[axis] -= 1;
                after[axis] += 1;
                *sum += difference(at(before), at(here), at(after)) * shares.iter().product::<f32>();
            }
        }
        sum
    }
}

#[inline(always)]
fn row_at(around: &[f32; SPAN], y: usize, z: usize) -> [f32; 4] {
    let first = z * STRIDES[1] + y * STRIDES[0];
    [around[first], around[first + 1], around[first + 2], around[first + 3]]
}

/// Four numbers of each cell of a register as four vectors.
#[inline(always)]
pub(super) fn columns<S: Simd>(simd: S, row: &Row, register: usize) -> [F<S>; 4] {
    let n = F::<S>::LEN;
    let numbers = &row.as_flattened()[4 * n * register..][..4 * n];
    let [a, b, c, d] = [
        F::<S>::from_slice(simd, &numbers[..n]),
        F::<S>::from_slice(simd, &numbers[n..2 * n]),
        F::<S>::from_slice(simd, &numbers[2 * n..3 * n]),
        F::<S>::from_slice(simd, &numbers[3 * n..4 * n]),
    ];
    let (even, odd) = ([a.unzip_low(b), c.unzip_low(d)], [a.unzip_high(b), c.unzip_high(d)]);
    [
        even[0].unzip_low(even[1]),
        odd[0].unzip_low(odd[1]),
        even[0].unzip_high(even[1]),
        odd[0].unzip_high(odd[1]),
    ]
}

/// Two numbers of each cell of a register as two vectors.
#[inline(always)]
fn halves<S: Simd>(simd: S, pair: &Pair, register: usize) -> [F<S>; 2] {
    let n = F::<S>::LEN;
    let numbers = &pair.as_flattened()[2 * n * register..][..2 * n];
    let [a, b] = [F::<S>::from_slice(simd, &numbers[..n]), F::<S>::from_slice(simd, &numbers[n..])];
    [a.unzip_low(b), a.unzip_high(b)]
}

/// The values at the corners of a register's cells.
#[inline(always)]
pub(super) fn corners<S: Simd>(simd: S, batch: &Batch, register: usize) -> [F<S>; 8] {
    let [a, b, c, d] = [
        columns(simd, &batch.own[0], register),
        columns(simd, &batch.own[1], register),
        columns(simd, &batch.own[2], register),
        columns(simd, &batch.own[3], register),
    ];
    [a[1], a[2], b[1], b[2], c[1], c[2], d[1], d[2]]
}

/// Shares of what is at a cell's lower and upper end along an axis.
type Shares<S> = [F<S>; 2];

#[inline(always)]
fn between<S: Simd>([q, p]: Shares<S>, [low, high]: [F<S>; 2]) -> F<S> {
    q.mul_add(low, p * high)
}

/// Twice the central differences at the ends, of four samples in a row.
#[inline(always)]
fn slope<S: Simd>(shares: Shares<S>, [before, low, high, after]: [F<S>; 4]) -> F<S> {
    between::<S>(shares, [high - before, after - low])
}

/// The value between the middle two of four samples in a row.
#[inline(always)]
fn middle<S: Simd>(shares: Shares<S>, [_, low, high, _]: [F<S>; 4]) -> F<S> {
    between::<S>(shares, [low, high])
}

/// The grid's differences at the corners of a register's cells, interpolated at `p`: gradients per sample step.
#[inline(always)]
pub(super) fn differences<S: Simd>(simd: S, batch: &Batch, register: usize, p: F3<S>) -> F3<S> {
    let one = splat(simd, 1.0);
    let [x, y, z] = [[one - p[0], p[0]], [one - p[1], p[1]], [one - p[2], p[2]]];
    // By their places along y and z, the cell's own rows, and what lies between the middle samples of all.
    let Batch { own, beside, .. } = batch;
    let [r11, r21] = [columns(simd, &own[0], register), columns(simd, &own[1], register)];
    let [r12, r22] = [columns(simd, &own[2], register), columns(simd, &own[3], register)];
    let [d11, d21, d12, d22] =
        [slope::<S>(x, r11), slope::<S>(x, r21), slope::<S>(x, r12), slope::<S>(x, r22)];
    let [m11, m21, m12, m22] =
        [middle::<S>(x, r11), middle::<S>(x, r21), middle::<S>(x, r12), middle::<S>(x, r22)];
    let m01 = between::<S>(x, halves(simd, &beside[0], register));
    let m31 = between::<S>(x, halves(simd, &beside[1], register));
    let m02 = between::<S>(x, halves(simd, &beside[2], register));
    let m32 = between::<S>(x, halves(simd, &beside[3], register));
    let m10 = between::<S>(x, halves(simd, &beside[4], register));
    let m20 = between::<S>(x, halves(simd, &beside[5], register));
    let m13 = between::<S>(x, halves(simd, &beside[6], register));
    let m23 = between::<S>(x, halves(simd, &beside[7], register));
    let twice = [
        between::<S>(z, [between::<S>(y, [d11, d21]), between::<S>(y, [d12, d22])]),
        between::<S>(z, [slope::<S>(y, [m01, m11, m21, m31]), slope::<S>(y, [m02, m12, m22, m32])]),
        between::<S>(y, [slope::<S>(z, [m10, m11, m12, m13]), slope::<S>(z, [m20, m21, m22, m23])]),
    ];
    let mut sum = scale::<S>(twice, splat(simd, 0.5));
    let finite = sum[0].is_finite() & sum[1].is_finite() & sum[2].is_finite();
    if !finite.all_true() {
        for lane in 0..F::<S>::LEN {
            if !finite.test(lane) {
                let at = [p[0][lane], p[1][lane], p[2][lane]];
                let careful = batch.careful_differences(F::<S>::LEN * register + lane, at);
                sum[0][lane] = careful[0];
                sum[1][lane] = careful[1];
                sum[2][lane] = careful[2];
            }
        }
    }
    sum
}
