//! Tiles of the picture, and their pixels as the rasterizer keeps them: in blocks of 8×8.

use crate::columns::{LANES, Lanes};
use crate::simd::*;
use glam::DVec2;

/// The largest side of a tile in pixels.
pub(crate) const MAX_SIDE: usize = 32;

/// Rows and columns of a block.
pub(crate) const BLOCK_SIDE: usize = LANES;

/// Blocks of the largest tile.
pub(crate) const MAX_BLOCKS: usize = (MAX_SIDE / BLOCK_SIDE) * (MAX_SIDE / BLOCK_SIDE);

/// A number for each pixel of a block, by rows.
pub(crate) type Plane = [Lanes; BLOCK_SIDE];

/// A block of pixels in registers: two rows in each.
pub(crate) type Block<S> = [W<S>; BLOCK_SIDE / 2];

/// A square of pixels at the places that are multiples of its side; the picture may end within it.
///
/// Its blocks follow each other down the columns of blocks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile {
    /// Column and row of its first pixel.
    pub(crate) origin: [usize; 2],
    /// Pixels in a row and rows that lie in the picture.
    pub(crate) size: [usize; 2],
    /// A multiple of eight, at most [`MAX_SIDE`].
    pub(crate) side: usize,
}

impl Tile {
    /// The tile at a column and row of tiles.
    pub(crate) fn new(place: [usize; 2], side: usize, picture: [usize; 2]) -> Self {
        let origin = place.map(|p| p * side);
        let size = [0, 1].map(|axis| (picture[axis] - origin[axis]).min(side));
        Self { origin, size, side }
    }

    /// Blocks in a row, and in a column.
    pub(crate) fn blocks_a_side(self) -> usize {
        self.side / BLOCK_SIDE
    }

    /// All blocks, also those beside the picture.
    pub(crate) fn blocks(self) -> usize {
        self.blocks_a_side() * self.blocks_a_side()
    }

    /// Where a block's first pixel is, from the tile's.
    pub(crate) fn corner(self, block: usize) -> [usize; 2] {
        [block / self.blocks_a_side() * BLOCK_SIDE, block % self.blocks_a_side() * BLOCK_SIDE]
    }

    /// As [`Self::corner`].
    #[inline(always)]
    pub(crate) fn corner_pixel(self, block: usize) -> [f32; 2] {
        self.corner(block).each(
            #[inline(always)]
            |pixel| pixel as f32,
        )
    }

    /// How many columns and rows of a block lie in the picture.
    pub(crate) fn visible(self, block: usize) -> [usize; 2] {
        let corner = self.corner(block);
        [0, 1].map(|axis| self.size[axis].saturating_sub(corner[axis]).min(BLOCK_SIDE))
    }

    /// Blocks that reach into the picture.
    pub(crate) fn visible_blocks(self) -> impl Iterator<Item = usize> {
        (0..self.blocks()).filter(move |block| self.visible(*block).iter().all(|length| *length > 0))
    }

    /// The centre of the first pixel of a block's row, in the picture.
    pub(crate) fn first_center(self, block: usize, row: usize) -> DVec2 {
        let [left, top] = self.corner(block);
        DVec2::new((self.origin[0] + left) as f64, (self.origin[1] + top + row) as f64) + 0.5
    }
}

/// Columns and rows, from a tile's first pixel, of the first two rows of a block with a corner.
#[inline(always)]
pub(crate) fn first_pixels<S: Simd>(simd: S, corner: [f32; 2]) -> [W<S>; 2] {
    let column: [f32; 16] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let row = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
    [W::simd_from(simd, column) + corner[0], W::simd_from(simd, row) + corner[1]]
}

#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, plane: &Plane) -> Block<S> {
    [0, 1, 2, 3].each(
        #[inline(always)]
        |pair| W::from_slice(simd, &plane.as_flattened()[16 * pair..16 * pair + 16]),
    )
}

#[inline(always)]
pub(crate) fn store<S: Simd>(block: Block<S>, plane: &mut Plane) {
    for (pair, two_rows) in block.iter().enumerate() {
        two_rows.store_slice(&mut plane.as_flattened_mut()[16 * pair..16 * pair + 16]);
    }
}

/// Adds a · b to a plane.
#[inline(always)]
pub(crate) fn add_products<S: Simd>(simd: S, plane: &mut Plane, (a, b): (Block<S>, Block<S>)) {
    let mut sum = load(simd, plane);
    for i in 0..4 {
        sum[i] = a[i].mul_add(b[i], sum[i]);
    }
    store(sum, plane);
}
