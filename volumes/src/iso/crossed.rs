//! Which cells of a part a surface crosses, as bits.

use super::cells::{PART, Part};
use super::hierarchy::SIDE;
use super::lanes::Simd;
use super::slab::Scalar;
use super::window::{HALO, ROW};

/// A row's samples as bits, the first of the part's own as bit 0.
type Bits = u64;

const _: () = assert!(ROW <= Bits::BITS as usize && PART[0] <= u32::BITS as usize);

/// Rows of a part's samples along y and z.
const ROWS: usize = PART[1] + 1;

/// On which side of the value a part's samples are, row after row.
pub(super) struct Sides {
    inside: [Bits; ROWS * ROWS],
    /// Samples that are not finite are neither inside nor outside.
    outside: [Bits; ROWS * ROWS],
}

impl Sides {
    /// Of no samples.
    pub(super) const NONE: Self = Self { inside: [0; ROWS * ROWS], outside: [0; ROWS * ROWS] };

    /// Takes a row of samples, from [`HALO`] before the part's on; one beside the part's is passed over.
    #[inline(always)]
    pub(super) fn set<S: Simd, T: Scalar>(
        &mut self,
        simd: S,
        row: &[T; ROW],
        value: f32,
        [j, k]: [usize; 2],
    ) {
        if j >= ROWS || k >= ROWS {
            return;
        }
        let (mut inside, mut outside) = (0, 0);
        for (number, samples) in row.as_chunks().0.iter().enumerate() {
            let sides = T::sides(simd, samples, value);
            inside |= Bits::from(sides[0]) << (16 * number);
            outside |= Bits::from(sides[1]) << (16 * number);
        }
        self.inside[ROWS * k + j] = inside >> HALO;
        self.outside[ROWS * k + j] = outside >> HALO;
    }

    /// The corners of a cell that are inside.
    #[inline(always)]
    pub(super) fn corners(&self, [i, j, k]: [usize; 3]) -> u8 {
        let first = ROWS * k + j;
        let rows = &self.inside[first..first + ROWS + 2];
        let pair = |row: usize| (rows[row] >> i) & 3;
        (pair(0) | pair(1) << 2 | pair(ROWS) << 4 | pair(ROWS + 1) << 6) as u8
    }
}

/// The cells of a part that have corners on both sides and all corners.
pub(super) struct Crossed {
    /// By z, y: a byte for each brick.
    rows: [[u32; PART[1]]; PART[2]],
    /// Whether others have corners on both sides.
    pub(super) has_gaps: bool,
}

/// Sides of the four samples around cells, along x and y.
#[derive(Clone, Copy, Default)]
struct Around {
    any_inside: Bits,
    any_outside: Bits,
    all_there: Bits,
}

impl Crossed {
    #[inline(always)]
    pub(super) fn new(sides: &Sides, part: &Part) -> Self {
        let mut rows = [[0; PART[1]]; PART[2]];
        let own: Bits = (1 << part.cells[0]) - 1;
        let mut has_gaps = 0;
        let mut below = [Around::default(); PART[1]];
        for k in 0..=part.cells[2] {
            let [inside, outside] = [&sides.inside, &sides.outside].map(|all| &all[ROWS * k..][..ROWS]);
            for (j, below) in below.iter_mut().enumerate().take(part.cells[1]) {
                let any = |rows: &[Bits]| {
                    let any = rows[j] | rows[j + 1];
                    any | any >> 1
                };
                let there = (inside[j] | outside[j]) & (inside[j + 1] | outside[j + 1]);
                let here = Around {
                    any_inside: any(inside),
                    any_outside: any(outside),
                    all_there: there & there >> 1,
                };
                if k > 0 {
                    let crossed =
                        (here.any_inside | below.any_inside) & (here.any_outside | below.any_outside) & own;
                    let whole = here.all_there & below.all_there;
                    has_gaps |= crossed & !whole;
                    rows[k - 1][j] = (crossed & whole) as u32;
                }
                *below = here;
            }
        }
        Self { rows, has_gaps: has_gaps != 0 }
    }

    /// Of a brick four rows of cells from row (j, k) of the part on, as bits in cubes of 2×2×2 one after the other, x fastest in each.
    #[inline(always)]
    pub(super) fn cubes(&self, brick: usize, [j, k]: [usize; 2]) -> u32 {
        let row = |j: usize, k: usize| (self.rows[k][j] >> (SIDE * brick)) as u8;
        let rows = u32::from_le_bytes([row(j, k), row(j + 1, k), row(j, k + 1), row(j + 1, k + 1)]);
        // A matrix of pairs of bits, transposed.
        let odd = (rows ^ rows >> 6) & 0x00cc_00cc;
        let rows = rows ^ odd ^ odd << 6;
        let upper = (rows ^ rows >> 12) & 0x0000_f0f0;
        rows ^ upper ^ upper << 12
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubes_hold_each_cell_once() {
        for (i, j, k) in (0..SIDE).flat_map(|i| (0..4).map(move |row| (i, row & 1, row >> 1))) {
            for own in 0..PART[0] / SIDE {
                let mut crossed = Crossed { rows: [[0; PART[1]]; PART[2]], has_gaps: false };
                crossed.rows[6 + k][4 + j] = 1 << (SIDE * own + i);
                let bit = i / 2 * 8 + 4 * k + 2 * j + i % 2;
                for brick in 0..PART[0] / SIDE {
                    let expected = if brick == own { 1 << bit } else { 0 };
                    assert_eq!(
                        crossed.cubes(brick, [4, 6]),
                        expected,
                        "cell {i}, {j}, {k} of {own} in {brick}"
                    );
                }
            }
        }
    }
}
