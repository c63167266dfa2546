//! The order in which pixels become surfels.

use super::lanes::*;
use oblate_engine::simd::{Level, dispatch};
use rayon::prelude::*;
use std::ops::Range;

/// Column and row of a pixel, of which images have 65,535 at most.
pub(super) type Pixel = [u16; 2];

/// Pixels along the side of a square: half a register's.
pub(super) const SIDE: usize = LANES / 2;

/// Pixels of a square.
pub(super) const AREA: usize = SIDE * SIDE;

/// The places in a square along a Morton curve.
pub(super) const CURVE: [[u8; 2]; AREA] = {
    let mut curve = [[0; 2]; AREA];
    let mut step = 0;
    while step < curve.len() {
        let mut bit = 0;
        while 1 << (2 * bit) < curve.len() {
            curve[step][0] |= ((step >> (2 * bit) & 1) << bit) as u8;
            curve[step][1] |= ((step >> (2 * bit + 1) & 1) << bit) as u8;
            bit += 1;
        }
        step += 1;
    }
    curve
};

/// The pixels of an image whose depths are known, square by square, and in these along a Morton curve: what follows each other lies together in
/// the picture, where eight surfels at a time are looked at.
pub(super) struct Squares {
    /// How many there are in a row of them, an even number.
    across: usize,
    known: Vec<Known>,
    /// How many pixels are known up to each square's end.
    ends: Vec<usize>,
}

/// Which pixels of a square are known: a bit each, along the curve.
#[derive(Clone, Copy, Default)]
pub(super) struct Known(pub(super) u64);

impl Known {
    /// Adds those of a row, a bit each.
    #[inline(always)]
    fn add(&mut self, y: usize, row: u64) {
        let along = row & 0x3 | (row & 0xc) << 2 | (row & 0x30) << 12 | (row & 0xc0) << 14;
        let down = y & 1 | (y & 2) << 1 | (y & 4) << 2;
        self.0 |= along << (2 * down);
    }

    pub(super) fn are_all(self) -> bool {
        self.0 == u64::MAX
    }

    pub(super) fn count(self) -> usize {
        self.0.count_ones() as usize
    }
}

impl Squares {
    /// Of inverse depths, 0 where unknown.
    pub(super) fn of(level: Level, [width, height]: [usize; 2], inverses: &Bordered) -> Self {
        let pairs = width.div_ceil(LANES);
        let of_pair = |at: usize| {
            let [column, row] = [at % pairs * LANES, at / pairs * SIDE];
            let mut known = [Known::default(); 2];
            dispatch!(level, simd => {
                for y in 0..SIDE.min(height - row) {
                    let place = inverses.place([column, row + y]);
                    let bits = inverses.load(simd, place).simd_gt(splat(simd, 0.0)).to_bitmask();
                    known[0].add(y, bits & 0xff);
                    known[1].add(y, bits >> SIDE);
                }
            });
            known
        };
        let pairs_known: Vec<[Known; 2]> =
            (0..pairs * height.div_ceil(SIDE)).into_par_iter().with_min_len(64).map(of_pair).collect();
        let known = pairs_known.into_flattened();
        let next_end = |end: &mut usize, known: &Known| {
            *end += known.count();
            Some(*end)
        };
        let ends = known.iter().scan(0, next_end).collect();
        Self { across: 2 * pairs, known, ends }
    }

    /// Those of a row of squares.
    pub(super) fn in_row(&self, row: usize) -> Range<usize> {
        row * self.across..(row + 1) * self.across
    }

    /// How many pixels are known.
    pub(super) fn pixels(&self) -> usize {
        self.ends.last().copied().unwrap_or(0)
    }

    pub(super) fn known(&self, square: usize) -> Known {
        self.known[square]
    }

    /// The first pixel of a square.
    pub(super) fn corner(&self, square: usize) -> [usize; 2] {
        [square % self.across * SIDE, square / self.across * SIDE]
    }

    /// The known pixels of a square.
    pub(super) fn pixels_of(&self, square: usize) -> impl Iterator<Item = Pixel> {
        let corner = self.corner(square);
        let pixel = move |place: [u8; 2]| [0, 1].map(|axis| (corner[axis] + usize::from(place[axis])) as u16);
        let known = self.known[square].0;
        CURVE
            .into_iter()
            .enumerate()
            .filter(move |(step, _)| known >> step & 1 != 0)
            .map(move |(_, place)| pixel(place))
    }

    /// The squares in which known pixels of these numbers are, and of the pixels of the first how many are before.
    pub(super) fn with(&self, numbers: Range<usize>) -> (Range<usize>, usize) {
        let square = |number: usize| self.ends.partition_point(|end| *end <= number);
        let first = square(numbers.start);
        let before = first.checked_sub(1).map_or(0, |before| self.ends[before]);
        (first..square(numbers.end - 1) + 1, numbers.start - before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squares(width: usize, depths: &[f32]) -> Squares {
        let inverses = Bordered::of(width, depths);
        Squares::of(Level::best(), [width, depths.len() / width], &inverses)
    }

    /// Each pixel whose depth is known comes once, in images of any side, and eight that follow each other in a whole square are beside
    /// each other.
    #[test]
    fn known_pixels_come_once() {
        for [width, height] in [[1, 2], [7, 3], [8, 8], [21, 17], [64, 24]] {
            let depths: Vec<f32> = (0..width * height).map(|at| (at % 5 % 2) as f32).collect();
            let squares = squares(width, &depths);
            let all = || (0..squares.known.len()).flat_map(|square| squares.pixels_of(square));
            let mut places: Vec<usize> =
                all().map(|[column, row]| usize::from(row) * width + usize::from(column)).collect();
            places.sort_unstable();
            let known: Vec<usize> = (0..depths.len()).filter(|at| depths[*at] > 0.0).collect();
            assert_eq!(places, known, "{width}×{height}");
            assert_eq!(squares.pixels(), known.len());
            let pixels: Vec<Pixel> = all().collect();
            for numbers in [0..known.len(), known.len() / 3..known.len() / 2 + 1] {
                let (within, before) = squares.with(numbers.clone());
                let own: Vec<Pixel> =
                    within.flat_map(|square| squares.pixels_of(square)).skip(before).collect();
                assert!(own.starts_with(&pixels[numbers]));
            }
        }
        let whole = squares(24, &[1.0; 24 * 16]);
        let pixels: Vec<Pixel> = (0..whole.known.len()).flat_map(|square| whole.pixels_of(square)).collect();
        for eight in pixels.chunks(8) {
            let sides = [0, 1].map(|axis| {
                let along = || eight.iter().map(|pixel| pixel[axis]);
                along().max().unwrap() - along().min().unwrap()
            });
            assert_eq!(sides, [3, 1]);
        }
    }
}
