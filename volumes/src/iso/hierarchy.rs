//! Smallest and largest values in bricks of 8×8×8 cells, and in blocks of 4×4×4 bricks.

use oblate_engine::simd::{Level, dispatch};
use rayon::prelude::*;

use super::slab::{Scalar, Slab};

/// Cells of a brick along an axis.
pub(super) const SIDE: usize = 8;
/// Bricks of a block along an axis.
const BRICKS: usize = 4;

/// Smallest and largest value of the samples at the corners of cells: finite unless there are infinite ones; reversed where
/// none is a number.
type Range = [f32; 2];

const NONE: Range = [f32::INFINITY, f32::NEG_INFINITY];

/// Whether a surface at `value` can be where values are in a range.
#[inline]
fn is_crossed(range: Range, value: f32) -> bool {
    range[0] < value && value <= range[1]
}

/// The ranges of the bricks that begin in some layers of a grid.
#[derive(Clone, Debug)]
pub(super) struct Hierarchy {
    /// The first layer.
    first: usize,
    /// Bricks along x, y, and layers of them.
    counts: [usize; 3],
    bricks: Vec<Range>,
    /// First bricks of blocks, in Morton order, and their ranges.
    blocks: Vec<([usize; 3], Range)>,
}

impl Hierarchy {
    /// Of a slab's layers of bricks, of which the first begins at slice `begin` and the last ends at `end` or at the grid's.
    pub(super) fn new<T: Scalar>(slab: Slab<'_, T>, [begin, end]: [usize; 2]) -> Self {
        let [nx, ny, nz] = slab.dims.map(|samples| (samples - 1).div_ceil(SIDE));
        let layers = nz.min(end.div_ceil(SIDE)).saturating_sub(begin / SIDE);
        let counts = [nx, ny, layers];
        let mut bricks = vec![NONE; nx * ny * layers];
        let level = Level::best();
        // Grids of one sample along an axis have no bricks.
        let layer = (nx * ny).max(1);
        bricks.par_chunks_mut(layer).enumerate().for_each(|(k, layer)| {
            let k = k * SIDE + begin;
            layer.par_chunks_mut(nx * ROWS).enumerate().for_each_init(Rows::default, |rows, (j, ranges)| {
                dispatch!(level, _simd => rows.ranges(slab, [j * ROWS * SIDE, k], ranges));
            });
        });
        let blocks = block_bases(counts).into_par_iter().map(|base| {
            let all = bricks_of(base, counts).map(|brick| bricks[place(brick, counts)]);
            (base, all.fold(NONE, |a, b| [a[0].min(b[0]), a[1].max(b[1])]))
        });
        let blocks = blocks.collect();
        Self { first: begin / SIDE, counts, bricks, blocks }
    }

    /// The blocks that a surface at `value` can be in, in Morton order.
    pub(super) fn blocks(&self, value: f32) -> Vec<[usize; 3]> {
        let blocks = self.blocks.iter().filter(|(_, range)| is_crossed(*range, value));
        blocks.map(|(base, _)| *base).collect()
    }

    /// The first samples of a block's bricks that a surface at `value` can be in, in Morton order.
    #[inline(always)]
    pub(super) fn bricks(&self, block: [usize; 3], value: f32) -> impl Iterator<Item = [usize; 3]> + '_ {
        let may_hold = move |brick: &[usize; 3]| is_crossed(self.bricks[place(*brick, self.counts)], value);
        bricks_of(block, self.counts)
            .filter(may_hold)
            .map(|[x, y, z]| [x, y, z + self.first].map(|brick| brick * SIDE))
    }
}

fn place([x, y, z]: [usize; 3], [nx, ny, _]: [usize; 3]) -> usize {
    (z * ny + y) * nx + x
}

/// A block's bricks that are there, in Morton order.
fn bricks_of(base: [usize; 3], counts: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    // Every third bit of a number below 64.
    let every_third = |code: usize, axis: usize| (code >> axis & 1) | (code >> (axis + 3) & 1) << 1;
    let bricks = (0..BRICKS.pow(3)).map(move |code| [0, 1, 2].map(|a| base[a] + every_third(code, a)));
    bricks.filter(move |brick| (0..3).all(|a| brick[a] < counts[a]))
}

/// First bricks of blocks, in Morton order.
fn block_bases(counts: [usize; 3]) -> Vec<[usize; 3]> {
    let [nx, ny, nz] = counts.map(|bricks| bricks.div_ceil(BRICKS));
    let mut blocks = Vec::with_capacity(nx * ny * nz);
    for z in 0..nz {
        for y in 0..ny {
            blocks.extend((0..nx).map(|x| [x, y, z]));
        }
    }
    blocks.sort_by_cached_key(|b| spread(b[0]) | spread(b[1]) << 1 | spread(b[2]) << 2);
    blocks.into_iter().map(|b| b.map(|c| c * BRICKS)).collect()
}

/// Puts two zero bits between the bits of a number below 2^42.
fn spread(number: usize) -> u128 {
    let bits = usize::BITS - number.leading_zeros();
    (0..bits).fold(0, |code, bit| code | ((number as u128 >> bit) & 1) << (3 * bit))
}

/// Rows of bricks that are looked through together, so that memory is read in long stretches.
const ROWS: usize = 8;

/// The least and the largest of the samples of each row of bricks, along x.
struct Rows<T> {
    least: Vec<T>,
    most: Vec<T>,
}

impl<T> Default for Rows<T> {
    fn default() -> Self {
        Self { least: Vec::new(), most: Vec::new() }
    }
}

impl<T: Scalar> Rows<T> {
    /// The ranges of rows of bricks, of which the first one's cells begin at rows [j, k].
    #[inline(always)]
    fn ranges(&mut self, slab: Slab<'_, T>, [j, k]: [usize; 2], ranges: &mut [Range]) {
        let [nx, ny, nz] = slab.dims;
        let [low, high] = T::ENDS;
        let bricks = (nx - 1).div_ceil(SIDE);
        let rows = ranges.len() / bricks;
        self.least.clear();
        self.least.resize(nx * rows, high);
        self.most.clear();
        self.most.resize(nx * rows, low);
        for k in k..(k + SIDE + 1).min(nz) {
            for row in 0..(rows * SIDE + 1).min(ny - j) {
                let samples = slab.row(j + row, k);
                // The last samples of a row of bricks are the first of the next one.
                let (of, is_shared) = (row / SIDE, row % SIDE == 0);
                if of < rows {
                    self.widen(of, samples);
                }
                if is_shared && of > 0 {
                    self.widen(of - 1, samples);
                }
            }
        }
        for (row, ranges) in ranges.chunks_exact_mut(bricks).enumerate() {
            let (least, most) = (&self.least[row * nx..][..nx], &self.most[row * nx..][..nx]);
            for (brick, range) in ranges.iter_mut().enumerate() {
                let samples = brick * SIDE..(brick * SIDE + SIDE + 1).min(nx);
                let least = least[samples.clone()].iter().fold(high, |a, b| if *b < a { *b } else { a });
                let most = most[samples].iter().fold(low, |a, b| if *b > a { *b } else { a });
                *range = [least.number(), most.number()];
            }
        }
    }

    #[inline(always)]
    fn widen(&mut self, row: usize, samples: &[T]) {
        let n = samples.len();
        let (least, most) = (&mut self.least[row * n..][..n], &mut self.most[row * n..][..n]);
        for ((least, most), value) in least.iter_mut().zip(most).zip(samples) {
            *least = if *value < *least { *value } else { *least };
            *most = if *value > *most { *value } else { *most };
        }
    }
}
