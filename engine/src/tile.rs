//! Tiles of the picture, and their pixels as the rasterizer keeps them: in cells of eight side by side.

use crate::columns::{LANES, Lanes};
use glam::DVec2;

/// The largest side of a tile in pixels: the rows of its strips are found for all strips at once.
pub(crate) const MAX_SIDE: usize = 32;

/// Rows of a block, which is eight pixels wide too.
pub(crate) const BLOCK_ROWS: usize = 8;

/// A square of pixels at the places that are multiples of its side; the picture may end within it.
///
/// Its pixels lie in strips, eight wide and as high as the tile; a strip's rows follow each other.
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

    /// Cells of a tile with this side.
    pub(crate) const fn cells(side: usize) -> usize {
        side * side / LANES
    }

    /// Strips that reach into the picture.
    pub(crate) fn strips(self) -> usize {
        self.size[0].div_ceil(LANES)
    }

    /// The cells of a strip that lie in the picture.
    pub(crate) fn strip(self, strip: usize) -> std::ops::Range<usize> {
        strip * self.side..strip * self.side + self.size[1]
    }

    /// The centre of a cell's first pixel, in the picture.
    pub(crate) fn first_center(self, cell: usize) -> DVec2 {
        let [left, top] = self.origin;
        DVec2::new((left + cell / self.side * LANES) as f64, (top + cell % self.side) as f64) + 0.5
    }

    /// How many of a strip's columns lie in the picture.
    pub(crate) fn columns(self, strip: usize) -> usize {
        (self.size[0] - strip * LANES).min(LANES)
    }
}

/// Eight pixels side by side: what is seen so far.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Cell {
    /// Red, green, blue, each times its contribution.
    pub(crate) color: [Lanes; 3],
    /// What does not pass. Kept instead of the transmittance, of which 1 − α loses the thinnest media.
    pub(crate) opacity: Lanes,
    /// z times its contribution; kept only where it is asked for.
    pub(crate) depth: Lanes,
}

impl Cell {
    /// Nothing there.
    pub(crate) const CLEAR: Self =
        Self { color: [[0.0; LANES]; 3], opacity: [0.0; LANES], depth: [0.0; LANES] };
}
