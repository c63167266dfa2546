//! Tiles of the picture, and their pixels as the rasterizer keeps them: in blocks of 4×4, each of which fills a register.

use crate::footprint::Rect;
use crate::simd::*;

/// The largest side of a tile in pixels.
pub(crate) const MAX_SIDE: usize = 32;

/// Rows and columns of a block.
pub(crate) const BLOCK_SIDE: usize = 4;

/// Pixels of a block.
pub(crate) const PIXELS: usize = BLOCK_SIDE * BLOCK_SIDE;

/// Blocks of the largest tile.
pub(crate) const MAX_BLOCKS: usize = (MAX_SIDE / BLOCK_SIDE) * (MAX_SIDE / BLOCK_SIDE);

/// From the centre of a block's first pixel to its middle.
pub(crate) const HALF_BLOCK: f32 = (BLOCK_SIDE - 1) as f32 / 2.0;

/// A number for each pixel of a block, by rows.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Plane(pub(crate) [f32; PIXELS]);

impl Plane {
    pub(crate) const ZERO: Self = Self([0.0; PIXELS]);
    pub(crate) const HALF: Self = Self([0.5; PIXELS]);
    pub(crate) const INFINITY: Self = Self([f32::INFINITY; PIXELS]);

    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self, simd: S) -> W<S> {
        W::simd_from(simd, self.0)
    }

    #[inline(always)]
    pub(crate) fn store<S: Simd>(&mut self, pixels: W<S>) {
        pixels.store_slice(&mut self.0);
    }
}

/// The first block of each column of a tile's blocks, as bits, by the logarithm of the blocks in a column.
const FIRST_ROW: [u64; 4] = [0x1, 0x5, 0x1111, 0x0101_0101_0101_0101];

/// A square of pixels at the places that are multiples of its side; the picture may end within it.
///
/// Its blocks follow each other down the columns of blocks. Its pixels may be some of the picture's: every second one of a
/// [lattice](crate::lattice), which are a picture of their own, seen through a lens of their own ([`Lens::of_every`]).
///
/// [`Lens::of_every`]: crate::footprint::Lens::of_every
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile {
    /// Column and row of its first pixel.
    pub(crate) origin: [usize; 2],
    /// Pixels in a row and rows that lie in the picture.
    pub(crate) size: [usize; 2],
    /// 8, 16 or 32: a power of two, at most [`MAX_SIDE`].
    pub(crate) side: usize,
    /// Which of the picture's pixels they are: every one, or every second one. A power of two.
    pub(crate) step: usize,
}

impl Tile {
    /// The tile at a column and row of tiles.
    pub(crate) fn new(place: [usize; 2], side: usize, picture: [usize; 2]) -> Self {
        let origin = place.map(|p| p * side);
        let size = [0, 1].map(|axis| (picture[axis] - origin[axis]).min(side));
        Self { origin, size, side, step: 1 }
    }

    /// The same, its pixels being some of a picture's.
    pub(crate) fn of_every(self, step: usize) -> Self {
        Self { step, ..self }
    }

    /// Where a place in the whole picture is among the tile's pixels.
    pub(crate) fn among_pixels(self, place: [f32; 2]) -> [f32; 2] {
        place.map(|p| (p - 0.5) / self.step as f32 + 0.5)
    }

    /// Blocks in a row, and in a column.
    #[inline(always)]
    pub(crate) fn blocks_a_side(self) -> usize {
        self.side / BLOCK_SIDE
    }

    /// All blocks, also those beside the picture.
    #[inline(always)]
    pub(crate) fn blocks(self) -> usize {
        self.blocks_a_side() * self.blocks_a_side()
    }

    /// The blocks that a rectangle of the whole picture touches, as bits.
    #[inline(always)]
    pub(crate) fn blocks_of(self, rect: &Rect) -> u64 {
        let side = self.blocks_a_side();
        // Powers of two: no divisions.
        let log_step = self.step.trailing_zeros();
        let range = |axis: usize| {
            let place = |pixel: usize| pixel.saturating_sub(self.origin[axis]).min(self.side);
            let [from, to] = [rect.min[axis], rect.max[axis]].map(usize::from);
            [
                place(from >> log_step) / BLOCK_SIDE,
                place((to + self.step - 1) >> log_step).div_ceil(BLOCK_SIDE),
            ]
        };
        let below = |count: usize| u64::MAX.checked_shr(64 - count as u32).unwrap_or(0);
        let ([left, right], [top, bottom]) = (range(0), range(1));
        let columns = below(right * side) & !below(left * side);
        columns
            & ((below(bottom) & !below(top)) * FIRST_ROW[side.trailing_zeros() as usize % FIRST_ROW.len()])
    }

    /// Where a block's first pixel is, from the tile's.
    #[inline(always)]
    pub(crate) fn corner(self, block: usize) -> [usize; 2] {
        // The side is a power of two.
        let column = block >> self.blocks_a_side().trailing_zeros();
        [column * BLOCK_SIDE, (block - column * self.blocks_a_side()) * BLOCK_SIDE]
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
    #[inline(always)]
    pub(crate) fn visible(self, block: usize) -> [usize; 2] {
        let corner = self.corner(block);
        [0, 1].each(
            #[inline(always)]
            |axis| self.size[axis].saturating_sub(corner[axis]).min(BLOCK_SIDE),
        )
    }

    /// Blocks that reach into the picture.
    #[inline(always)]
    pub(crate) fn visible_blocks(self) -> impl Iterator<Item = usize> {
        (0..self.blocks()).filter(
            #[inline(always)]
            move |block| !self.visible(*block).contains(&0),
        )
    }

    /// Those blocks, as bits.
    #[inline(always)]
    pub(crate) fn visible_set(self) -> u64 {
        self.visible_blocks().map(|block| 1 << block).sum()
    }

    /// Whether each pixel of a block lies in the picture.
    #[inline(always)]
    pub(crate) fn inside<S: Simd>(self, simd: S, block: usize) -> mask32x16<S> {
        let corner = self.corner_pixel(block);
        let pixels = pixels(simd, corner);
        let end = self.size.each(
            #[inline(always)]
            |length| W::simd_from(simd, length as f32),
        );
        pixels[0].simd_lt(end[0]) & pixels[1].simd_lt(end[1])
    }
}

/// Columns and rows of the pixels of a block with a corner, from the tile's first pixel.
#[inline(always)]
pub(crate) fn pixels<S: Simd>(simd: S, corner: [f32; 2]) -> [W<S>; 2] {
    const COLUMNS: [f32; PIXELS] =
        [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
    const ROWS: [f32; PIXELS] =
        [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];
    [W::simd_from(simd, COLUMNS) + corner[0], W::simd_from(simd, ROWS) + corner[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn blocks_of_a_rectangle_are_those_with_pixels_of_it(
            min in prop::array::uniform2(0..120_u16),
            lengths in prop::array::uniform2(1..60_u16),
            side in prop_oneof![Just(8_usize), Just(16), Just(32)],
            step in 1..3_usize,
        ) {
            let tile = Tile::new([1, 2], side, [200, 200]).of_every(step);
            let rect = Rect { min, max: [min[0] + lengths[0], min[1] + lengths[1]] };
            let mut expected = 0;
            for block in 0..tile.blocks() {
                let corner = tile.corner(block);
                let touches = |axis: usize| {
                    // The picture's pixels that lie between the first of the block and the first of the next one.
                    let first = (tile.origin[axis] + corner[axis]) * step;
                    usize::from(rect.min[axis]) < first + BLOCK_SIDE * step && usize::from(rect.max[axis]) > first
                };
                expected |= u64::from(touches(0) && touches(1)) << block;
            }
            prop_assert_eq!(tile.blocks_of(&rect), expected);
        }
    }
}
