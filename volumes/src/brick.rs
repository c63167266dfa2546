//! Bricks: pieces of 8×8×8 samples with the samples around them, as f32, in Morton order.
//!
//! Working brick by brick makes the sample's number type, the grid's border and values that are not finite
//! one case (NaN), and gives splats an order in which neighbours in space are neighbours in memory.

use crate::field::difference;
use crate::volume::{Volume, Voxels};
use rayon::prelude::*;

/// Samples, and cells, of a brick along an axis.
pub(crate) const SIDE: usize = 8;
/// One more below; above, one more for the last cells and one for the gradients at their corners.
const WIDTH: usize = SIDE + 3;
const STRIDES: [usize; 3] = [1, WIDTH, WIDTH * WIDTH];

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
    // A lane for each sample of a row: lanes do not wait for each other.
    let (mut low, mut high) = ([f32::INFINITY; SIDE], [f32::NEG_INFINITY; SIDE]);
    for k in base[2]..end[2] {
        for j in base[1]..end[1] {
            let row = (k * dims[1] + j) * dims[0];
            let row = &samples[row + base[0]..row + end[0]];
            for ((low, high), sample) in low.iter_mut().zip(&mut high).zip(row) {
                let value: f32 = (*sample).into();
                let finite = value.is_finite();
                *low = if finite && value < *low { value } else { *low };
                *high = if finite && value > *high { value } else { *high };
            }
        }
    }
    [low.into_iter().fold(f32::INFINITY, f32::min), high.into_iter().fold(f32::NEG_INFINITY, f32::max)]
}

/// Bricks that one task of [`walk_bricks`] takes.
const BRICKS_A_TASK: usize = 32;

/// Loads every brick of a volume and adds it to a batch; batches come in Morton order, for any number of threads.
pub(crate) fn walk_bricks<B: Default + Send>(
    volume: &Volume,
    add: impl Fn(&Brick, [usize; 3], &mut B) + Sync,
) -> Vec<B> {
    brick_bases(volume.dims())
        .par_chunks(BRICKS_A_TASK)
        .map_init(Brick::default, |brick, bases| {
            let mut batch = B::default();
            for &base in bases {
                brick.load(volume, base);
                add(brick, base, &mut batch);
            }
            batch
        })
        .collect()
}

/// A brick's samples; NaN stands for samples outside the grid and for values that are not finite.
pub(crate) struct Brick {
    values: Vec<f32>,
    /// Smallest and largest finite value, the halo included; reversed when there is none.
    pub(crate) range: [f32; 2],
}

impl Default for Brick {
    fn default() -> Self {
        Self { values: vec![f32::NAN; WIDTH * STRIDES[2]], range: [f32::INFINITY, f32::NEG_INFINITY] }
    }
}

impl Brick {
    /// Loads the brick whose first sample is `base`.
    pub(crate) fn load(&mut self, volume: &Volume, base: [usize; 3]) {
        match volume.voxels() {
            Voxels::U8(v) => self.fill(v, volume.dims(), base),
            Voxels::U16(v) => self.fill(v, volume.dims(), base),
            Voxels::I16(v) => self.fill(v, volume.dims(), base),
            Voxels::F32(v) => self.fill(v, volume.dims(), base),
        }
    }

    fn fill<T: Copy + Into<f32>>(&mut self, samples: &[T], dims: [usize; 3], base: [usize; 3]) {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        // Along an axis: the first sample's place in the brick, the first sample, how many.
        let span = |axis: usize| {
            let skipped = usize::from(base[axis] == 0);
            let first = base[axis] + skipped - 1;
            (skipped, first, (base[axis] + WIDTH - 1).min(dims[axis]) - first)
        };
        let [x, y, z] = [0, 1, 2].map(span);
        if [x.2, y.2, z.2] != [WIDTH; 3] {
            self.values.fill(f32::NAN);
        }
        for k in 0..z.2 {
            for j in 0..y.2 {
                let from = ((z.1 + k) * dims[1] + y.1 + j) * dims[0] + x.1;
                let to = (z.0 + k) * STRIDES[2] + (y.0 + j) * STRIDES[1] + x.0;
                for (slot, sample) in self.values[to..to + x.2].iter_mut().zip(&samples[from..from + x.2]) {
                    let value: f32 = (*sample).into();
                    *slot = if value.is_finite() { value } else { f32::NAN };
                    low = low.min(*slot);
                    high = high.max(*slot);
                }
            }
        }
        self.range = [low, high];
    }

    /// Where local sample (i, j, k), each at most 8, lies among the values.
    #[inline]
    pub(crate) fn place([i, j, k]: [u8; 3]) -> usize {
        (usize::from(k) + 1) * STRIDES[2] + (usize::from(j) + 1) * STRIDES[1] + usize::from(i) + 1
    }

    /// The place of a cell's corner; bit a of `corner` says upper along axis a.
    #[inline]
    pub(crate) fn corner(place: usize, corner: usize) -> usize {
        place + (corner & 1) * STRIDES[0] + (corner >> 1 & 1) * STRIDES[1] + (corner >> 2) * STRIDES[2]
    }

    /// The samples 0 to 8 along x of local row (j, k), each at most 8.
    #[inline]
    pub(crate) fn row(&self, j: usize, k: usize) -> &[f32] {
        let first = (k + 1) * STRIDES[2] + (j + 1) * STRIDES[1] + 1;
        &self.values[first..=first + SIDE]
    }

    #[inline]
    pub(crate) fn value(&self, place: usize) -> f32 {
        self.values[place]
    }

    /// Differences per sample step along the grid's axes.
    #[inline]
    pub(crate) fn differences(&self, place: usize) -> [f32; 3] {
        let here = self.values[place];
        STRIDES.map(|stride| difference(self.values[place - stride], here, self.values[place + stride]))
    }
}
