//! The samples around cells, those of as many cells as there are lanes.

use super::lanes::*;
use super::window::{SPAN, STRIDES};
use crate::field::difference;

/// Rows along x of a cell's neighbourhood, each by its places along y and z from 0 to 3, the cell's own at 1 and 2. They are what
/// central differences at its corners need. The cell's own come first.
const ROWS: [[usize; 2]; 12] =
    [[1, 1], [2, 1], [1, 2], [2, 2], [0, 1], [3, 1], [0, 2], [3, 2], [1, 0], [2, 0], [1, 3], [2, 3]];

/// Which of [`ROWS`] is at places y and z, by y + 4 z.
const ROW_AT: [usize; 16] = {
    let mut table = [usize::MAX; 16];
    let mut row = 0;
    while row < ROWS.len() {
        table[ROWS[row][0] + 4 * ROWS[row][1]] = row;
        row += 1;
    }
    table
};

/// The four numbers of a row for each cell.
type Row = [[f32; 4]; MOST_LANES];

/// Sheets in cells, each with the samples around its cell.
#[repr(align(64))]
pub(super) struct Group {
    pub(super) samples: [Row; 12],
    /// Coefficients of a spline, by y + 4 z, where there is one.
    pub(super) coefficients: [Row; 16],
    /// The cells' lowest corners, in samples of the grid.
    pub(super) cells: [[u32; MOST_LANES]; 3],
    /// The corners inside each sheet, as bits.
    pub(super) sheets: [u32; MOST_LANES],
    pub(super) len: usize,
}

impl Group {
    pub(super) fn new() -> Self {
        Self {
            samples: [[[0.0; 4]; MOST_LANES]; 12],
            coefficients: [[[0.0; 4]; MOST_LANES]; 16],
            cells: [[0; MOST_LANES]; 3],
            // Of cells that are not there, some that are sure to be well-behaved.
            sheets: [1; MOST_LANES],
            len: 0,
        }
    }

    /// Adds a sheet of a cell, where there is room.
    #[inline(always)]
    pub(super) fn push(&mut self, around: &[f32; SPAN], cell: [usize; 3], sheet: u8) {
        let lane = self.len % MOST_LANES;
        for (row, [y, z]) in self.samples.iter_mut().zip(ROWS) {
            row[lane] = row_at(around, y, z);
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
        let lane = (self.len + MOST_LANES - 1) % MOST_LANES;
        for (number, row) in self.coefficients.iter_mut().enumerate() {
            row[lane] = row_at(around, number % 4, number / 4);
        }
    }

    /// Central differences at the corners of one lane's cell, interpolated at p: where samples are missing, as
    /// [`difference`] has it.
    #[cold]
    fn careful_differences(&self, lane: usize, p: [f32; 3]) -> [f32; 3] {
        let at = |[x, y, z]: [usize; 3]| match ROW_AT[y + 4 * z] {
            usize::MAX => f32::NAN,
            row => self.samples[row][lane][x],
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

/// Four numbers of each cell as four vectors.
#[inline(always)]
pub(super) fn columns<S: Simd>(simd: S, row: &Row) -> [F<S>; 4] {
    let n = F::<S>::LEN;
    let numbers = row.as_flattened();
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

/// The values at the cells' corners.
#[inline(always)]
pub(super) fn corners<S: Simd>(simd: S, group: &Group) -> [F<S>; 8] {
    let [a, b, c, d] = [
        columns(simd, &group.samples[0]),
        columns(simd, &group.samples[1]),
        columns(simd, &group.samples[2]),
        columns(simd, &group.samples[3]),
    ];
    [a[1], a[2], b[1], b[2], c[1], c[2], d[1], d[2]]
}

/// The grid's differences at the cells' corners, interpolated at `p`: gradients per sample step.
#[inline(always)]
pub(super) fn differences<S: Simd>(simd: S, group: &Group, p: F3<S>) -> F3<S> {
    let one = splat(simd, 1.0);
    let q = [one - p[0], one - p[1], one - p[2]];
    // Differences at the two corners along an axis, weighted, are sums of four samples along it.
    let along_y = [-q[1], -p[1], q[1], p[1]];
    let along_z = [-q[2], -p[2], q[2], p[2]];
    let (weights_y, weights_z) = ([q[1], p[1]], [q[2], p[2]]);
    let mut sum = [splat(simd, 0.0); 3];
    for (number, row) in group.samples.iter().enumerate() {
        let [y, z] = ROWS[number];
        let [before, low, high, after] = columns(simd, row);
        let middle = q[0].mul_add(low, p[0] * high);
        if number < 4 {
            let slope = q[0].mul_add(high - before, p[0] * (after - low));
            sum[0] = (weights_y[y - 1] * weights_z[z - 1]).mul_add(slope, sum[0]);
        }
        if number < 8 {
            sum[1] = (along_y[y] * weights_z[z - 1]).mul_add(middle, sum[1]);
        }
        if !(4..8).contains(&number) {
            sum[2] = (along_z[z] * weights_y[y - 1]).mul_add(middle, sum[2]);
        }
    }
    let mut sum = scale::<S>(sum, splat(simd, 0.5));
    let finite = sum[0].is_finite() & sum[1].is_finite() & sum[2].is_finite();
    if !finite.all_true() {
        for lane in 0..F::<S>::LEN {
            if !finite.test(lane) {
                let careful = group.careful_differences(lane, [p[0][lane], p[1][lane], p[2][lane]]);
                sum[0][lane] = careful[0];
                sum[1][lane] = careful[1];
                sum[2][lane] = careful[2];
            }
        }
    }
    sum
}
