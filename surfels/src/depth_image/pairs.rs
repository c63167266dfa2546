//! The surfels of two squares at a time, which are as wide as a register.

use super::lanes::*;
use super::squares::{AREA, CURVE, Known, SIDE};
use super::surfels::Maker;
use oblate_engine::SurfelRows;
use oblate_engine::simd::dispatch;

/// Numbers of a surfel: centre, two half-axes, area, colour.
pub(super) const NUMBERS: usize = 13;

/// Makes the surfels of an image, those of two squares at a time, which are as wide as a register.
pub(super) struct Surfels<'a> {
    maker: &'a Maker<'a>,
    /// The number of those that were made last.
    pair: Option<usize>,
    made: [Square; 2],
}

/// The surfels of the known pixels of a square along its curve, in camera space.
#[derive(Clone, Copy)]
pub(super) struct Square {
    len: usize,
    numbers: [[f32; AREA]; NUMBERS],
}

/// Where sixteen surfels are, and how they lie.
pub(super) struct Sixteen<S: Simd> {
    pub(super) center: F3<S>,
    pub(super) half_axes: [F3<S>; 2],
    pub(super) area: F<S>,
}

impl Square {
    const NONE: Self = Self { len: 0, numbers: [[0.0; AREA]; NUMBERS] };

    /// Leaves those of the known pixels of all in the square.
    #[inline(always)]
    fn keep<S: Simd>(&mut self, simd: S, known: Known) {
        self.len = known.count();
        if known.are_all() {
            return;
        }
        for row in &mut self.numbers {
            let mut kept = 0;
            for from in (0..AREA).step_by(LANES) {
                let bits = known.0 >> from & 0xffff;
                let is_known = fearless_simd::mask32x16::from_bitmask(simd, bits);
                // What is behind those that are kept has been read.
                let numbers = F::from_slice(simd, &row[from..from + LANES]).compress(is_known);
                numbers.store_slice(&mut row[kept..kept + LANES]);
                kept += bits.count_ones() as usize;
            }
        }
    }

    /// All from one on.
    pub(super) fn since(&self, first: usize) -> SurfelRows<'_> {
        let rows = self.numbers.each_ref().map(|row| &row[first..self.len]);
        let [x, y, z, a, b, c, d, e, f, areas, colors @ ..] = rows;
        let half_axes = [a, b, c, d, e, f];
        SurfelRows { centers: [x, y, z], half_axes, through: None, areas, colors }
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    pub(super) fn center(&self, number: usize) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.numbers[axis][number])
    }

    /// Centre and half-axes of one, and its area.
    #[cfg(test)]
    pub(super) fn surfel(&self, number: usize) -> ([glam::DVec3; 3], f64) {
        let vector =
            |first: usize| [0, 1, 2].map(|axis| f64::from(self.numbers[first + axis][number])).into();
        ([0, 3, 6].map(vector), f64::from(self.numbers[9][number]))
    }

    /// Sixteen from one on; of no meaning behind the last.
    #[inline(always)]
    pub(super) fn sixteen<S: Simd>(&self, simd: S, first: usize) -> Sixteen<S> {
        let center = [self.row(simd, 0, first), self.row(simd, 1, first), self.row(simd, 2, first)];
        let u = [self.row(simd, 3, first), self.row(simd, 4, first), self.row(simd, 5, first)];
        let v = [self.row(simd, 6, first), self.row(simd, 7, first), self.row(simd, 8, first)];
        Sixteen { center, half_axes: [u, v], area: self.row(simd, 9, first) }
    }

    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, number: usize, first: usize) -> F<S> {
        F::from_slice(simd, &self.numbers[number][first..first + LANES])
    }

    pub(super) fn areas(&self) -> &[f32; AREA] {
        &self.numbers[9]
    }
}

impl<'a> Surfels<'a> {
    pub(super) fn new(maker: &'a Maker<'a>) -> Self {
        Self { maker, pair: None, made: [Square::NONE; 2] }
    }

    /// Those of a square. It takes least to ask for one after the other.
    pub(super) fn of(&mut self, square: usize) -> &Square {
        let pair = square / 2;
        if self.pair != Some(pair) {
            self.pair = Some(pair);
            let known = [2 * pair, 2 * pair + 1].map(|square| self.maker.squares.known(square));
            dispatch!(self.maker.level, simd => {
                if known.iter().any(|known| known.count() > 0) {
                    self.make(simd, pair);
                }
                for (rows, known) in self.made.iter_mut().zip(known) {
                    rows.keep(simd, known);
                }
            });
        }
        &self.made[square % 2]
    }

    /// Makes those of all pixels of a pair.
    #[inline(always)]
    fn make<S: Simd>(&mut self, simd: S, pair: usize) {
        let [column, first] = self.maker.squares.corner(2 * pair);
        let last = self.maker.image.size[1] - 1;
        for y in (0..SIDE).step_by(2) {
            // What is below the image is known nowhere.
            let upper = self.maker.numbers(simd, [column, (first + y).min(last)]);
            let lower = self.maker.numbers(simd, [column, (first + y + 1).min(last)]);
            let [left, right] = &mut self.made;
            for number in 0..NUMBERS {
                let mut rows = [[0.0; LANES]; 2];
                upper[number].store_slice(&mut rows[0]);
                lower[number].store_slice(&mut rows[1]);
                let [left, right] = [&mut left.numbers[number], &mut right.numbers[number]];
                for (at, place) in QUADS[y / 2].into_iter().enumerate() {
                    let [x, beside] = [2 * at, SIDE + 2 * at];
                    let quad = |x: usize| [rows[0][x], rows[0][x + 1], rows[1][x], rows[1][x + 1]];
                    left[place..place + 4].copy_from_slice(&quad(x));
                    right[place..place + 4].copy_from_slice(&quad(beside));
                }
            }
        }
    }
}

/// Where along a square's curve the squares of 2×2 pixels begin of which two rows of it are, pair of rows by pair.
const QUADS: [[usize; SIDE / 2]; SIDE / 2] = {
    let mut quads = [[0; SIDE / 2]; SIDE / 2];
    let mut place = 0;
    while place < AREA {
        let [x, y] = CURVE[place];
        quads[y as usize / 2][x as usize / 2] = place;
        place += 4;
    }
    quads
};
