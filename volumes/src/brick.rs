//! Bricks: pieces of 8×8×8 samples with the samples around them, as f32, in Morton order.
//!
//! Working brick by brick makes the sample's number type, the grid's border and values that are not finite
//! one case (NaN), and gives splats an order in which neighbours in space are neighbours in memory.

use crate::volume::{Volume, Voxels};
use rayon::prelude::*;

/// Samples, and cells, of a brick along an axis.
pub(crate) const SIDE: usize = 8;

/// Local coordinates of a brick's samples or cells in Morton order.
pub(crate) const MORTON: [[u8; 3]; SIDE * SIDE * SIDE] = {
    let mut table = [[0; 3]; SIDE * SIDE * SIDE];
    let mut code = 0;
    while code < table.len() {
        let mut bit = 0;
        while bit < 9 {
            table[code][bit % 3] |= ((code >> bit & 1) << (bit / 3)) as u8;
            bit += 1;
        }
        code += 1;
    }
    table
};

/// First samples of a grid's bricks, in Morton order.
fn brick_bases(dims: [usize; 3]) -> Vec<[usize; 3]> {
    let [nx, ny, nz] = dims.map(|d| d.div_ceil(SIDE));
    let mut bricks = Vec::with_capacity(nx * ny * nz);
    for z in 0..nz {
        for y in 0..ny {
            bricks.extend((0..nx).map(|x| [x, y, z]));
        }
    }
    bricks.sort_by_cached_key(|b| spread(b[0]) | spread(b[1]) << 1 | spread(b[2]) << 2);
    bricks.into_iter().map(|b| b.map(|c| c * SIDE)).collect()
}

/// Puts two zero bits between the bits of a number below 2^42.
fn spread(number: usize) -> u128 {
    let bits = usize::BITS - number.leading_zeros();
    (0..bits).fold(0, |code, bit| code | ((number as u128 >> bit) & 1) << (3 * bit))
}

/// A brick's own samples, those that cells begin at, seen from afar.
#[derive(Clone, Debug)]
pub(crate) struct BrickRange {
    /// Its first sample.
    pub(crate) base: [usize; 3],
    /// Its smallest and largest finite value.
    pub(crate) range: [f32; 2],
}

/// The bricks of a volume that hold a finite value, in Morton order.
pub(crate) fn brick_ranges(volume: &Volume) -> Vec<BrickRange> {
    let dims = volume.dims();
    let seen = |base: [usize; 3]| {
        let range = match volume.voxels() {
            Voxels::U8(v) => range_of(v, dims, base),
            Voxels::U16(v) => range_of(v, dims, base),
            Voxels::I16(v) => range_of(v, dims, base),
            Voxels::F32(v) => range_of(v, dims, base),
        };
        (range[0] <= range[1]).then_some(BrickRange { base, range })
    };
    brick_bases(dims).into_par_iter().filter_map(seen).collect()
}

fn range_of<T: Copy + Into<f32>>(samples: &[T], dims: [usize; 3], base: [usize; 3]) -> [f32; 2] {
    let end = [0, 1, 2].map(|axis| dims[axis].min(base[axis] + SIDE));
    let mut extremes = Extremes::default();
    for k in base[2]..end[2] {
        for j in base[1]..end[1] {
            let row = (k * dims[1] + j) * dims[0];
            extremes.include(&samples[row + base[0]..row + end[0]]);
        }
    }
    extremes.range()
}

/// Smallest and largest finite values so far: in lanes, which do not wait for each other.
pub(crate) struct Extremes {
    low: [f32; SIDE],
    high: [f32; SIDE],
}

impl Default for Extremes {
    fn default() -> Self {
        Self { low: [f32::INFINITY; SIDE], high: [f32::NEG_INFINITY; SIDE] }
    }
}

impl Extremes {
    #[inline]
    pub(crate) fn include<T: Copy + Into<f32>>(&mut self, samples: &[T]) {
        for row in samples.chunks(SIDE) {
            for ((low, high), sample) in self.low.iter_mut().zip(&mut self.high).zip(row) {
                let value: f32 = (*sample).into();
                let finite = value.is_finite();
                *low = if finite && value < *low { value } else { *low };
                *high = if finite && value > *high { value } else { *high };
            }
        }
    }

    /// The first is the greater one where there was no finite value.
    pub(crate) fn range(&self) -> [f32; 2] {
        let low = self.low.into_iter().fold(f32::INFINITY, f32::min);
        [low, self.high.into_iter().fold(f32::NEG_INFINITY, f32::max)]
    }
}
