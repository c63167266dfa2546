//! How far the tiles of a picture were looked into.

use crate::cuts::Cuts;
use crate::footprint::Rect;
use crate::tile::Tile;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Side of a cell in pixels: tiles consist of whole ones.
pub(super) const CELL: usize = 8;

/// Depths behind which nothing matters: behind surfaces by cells, behind volumes by tiles.
#[derive(Default)]
pub(crate) struct Looked {
    side: usize,
    /// Columns of cells, and of tiles, and how many there are in all.
    columns: [usize; 2],
    counts: [usize; 2],
    /// Where the last layer of surfaces ends that anything is seen of.
    layers: Vec<AtomicU32>,
    /// z of the farthest of the cuts behind which nothing is seen.
    cuts: Vec<AtomicU32>,
    /// The same of tiles, and the distance up to which kernels were added.
    kernels: Vec<[AtomicU32; 2]>,
}

/// Squares that a rectangle of pixels touches.
pub(super) fn squares(pixels: &Rect, side: usize) -> [std::ops::Range<usize>; 2] {
    [0, 1].map(|axis| usize::from(pixels.min[axis]) / side..usize::from(pixels.max[axis]).div_ceil(side))
}

impl Looked {
    pub(super) fn clear(&mut self, size: [u32; 2], side: usize) {
        let of = |side: usize| size.map(|length| (length as usize).div_ceil(side));
        let [cells, tiles] = [of(CELL), of(side)];
        self.side = side;
        self.columns = [cells[0], tiles[0]];
        self.counts = [cells[0] * cells[1], tiles[0] * tiles[1]];
        let endless = || AtomicU32::new(f32::INFINITY.to_bits());
        for cells in [&mut self.layers, &mut self.cuts] {
            cells.clear();
            cells.resize_with(self.counts[0], endless);
        }
        self.kernels.clear();
        self.kernels.resize_with(self.counts[1], || [endless(), endless()]);
    }

    /// Side of a tile in pixels.
    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Columns of cells, and of tiles.
    pub(super) fn columns(&self) -> [usize; 2] {
        self.columns
    }

    /// How many cells there are.
    pub(super) fn cells(&self) -> usize {
        self.counts[0]
    }

    /// How many tiles there are.
    pub(super) fn tiles(&self) -> usize {
        self.counts[1]
    }

    /// Says how far a tile's surfaces were looked into, which one thread does.
    pub(crate) fn store_cuts(&self, tile: Tile, cuts: &Cuts) {
        store(&self.kernels[self.place_of(tile)][0], cuts.hidden());
        let cell = |block: usize| {
            let [x, y] = [0, 1].map(|axis| (tile.origin[axis] + tile.corner(block)[axis]) / CELL);
            y * self.columns[0] + x
        };
        for block in tile.visible_blocks() {
            store(&self.layers[cell(block)], f32::NEG_INFINITY);
            store(&self.cuts[cell(block)], f32::NEG_INFINITY);
        }
        for block in tile.visible_blocks() {
            let (cell, cuts) = (cell(block), cuts.block(block));
            store(&self.layers[cell], read(&self.layers[cell]).max(cuts.ends));
            store(&self.cuts[cell], read(&self.cuts[cell]).max(cuts.hidden));
        }
    }

    /// Says from which distance on a tile needed no kernel, which one thread does.
    pub(crate) fn store_reached(&self, tile: Tile, reached: f32) {
        store(&self.kernels[self.place_of(tile)][1], reached);
    }

    fn place_of(&self, tile: Tile) -> usize {
        tile.origin[1] / self.side * self.columns[1] + tile.origin[0] / self.side
    }

    /// Whether surfaces in a rectangle of pixels whose spans begin behind `near` take part in no layer.
    pub(super) fn hides_surface(&self, pixels: &Rect, near: f32) -> bool {
        self.are_before(&self.layers, pixels, near)
    }

    /// Whether nothing that lies behind `near` is seen in a rectangle of pixels.
    #[inline(always)]
    pub(crate) fn hides_kernel(&self, pixels: &Rect, near: f32) -> bool {
        self.are_before(&self.cuts, pixels, near)
    }

    #[inline(always)]
    fn are_before(&self, depths: &[AtomicU32], pixels: &Rect, near: f32) -> bool {
        let [columns, mut rows] = squares(pixels, CELL);
        rows.all(|row| {
            let row = &depths[row * self.columns[0]..];
            row[columns.clone()].iter().all(|depth| read(depth) < near)
        })
    }

    /// The cells of a rectangle of pixels where surfaces from a z on take part in layers.
    pub(super) fn cells_that_show(
        &self,
        pixels: &Rect,
        near: f32,
    ) -> impl Iterator<Item = usize> + Clone + '_ {
        let [columns, rows] = squares(pixels, CELL);
        let cells = rows.flat_map(move |row| columns.clone().map(move |x| row * self.columns[0] + x));
        cells.filter(move |cell| read(&self.layers[*cell]) >= near)
    }

    /// The tile that a cell is in.
    pub(super) fn tile_of(&self, cell: usize) -> usize {
        let cells = self.side / CELL;
        cell / self.columns[0] / cells * self.columns[1] + cell % self.columns[0] / cells
    }

    /// The tiles of a rectangle of pixels where kernels from a z and from a distance on are needed.
    pub(super) fn tiles_that_show(&self, pixels: &Rect, from: [f32; 2]) -> impl Iterator<Item = usize> + '_ {
        let [columns, rows] = squares(pixels, self.side);
        let tiles = rows.flat_map(move |row| columns.clone().map(move |x| row * self.columns[1] + x));
        tiles.filter(move |tile| {
            let [cut, reached] = &self.kernels[*tile];
            read(cut) >= from[0] && read(reached) >= from[1]
        })
    }
}

fn read(depth: &AtomicU32) -> f32 {
    f32::from_bits(depth.load(Relaxed))
}

fn store(depth: &AtomicU32, z: f32) {
    depth.store(z.to_bits(), Relaxed);
}
