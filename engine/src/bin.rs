//! Stage `bin`: sorted records to a list for each tile, in the same order.

use crate::footprint::Rect;
use rayon::prelude::*;
use std::ops::Range;

/// Side of a tile in pixels.
pub(crate) const TILE: usize = 16;

/// Lists of record indices, one a tile, rows of tiles from top to bottom.
pub(crate) struct TileLists {
    /// Tiles in a row.
    pub(crate) columns: usize,
    /// Rows of tiles.
    pub(crate) rows: usize,
    bands: Vec<Band>,
    rows_per_band: usize,
}

/// The lists of consecutive rows of tiles.
struct Band {
    starts: Vec<usize>,
    entries: Vec<u32>,
}

impl TileLists {
    /// Counts and places every record into the tiles that its rectangle touches; `order` decides the order
    /// within a tile. A thread takes a band of rows and walks all records, so nothing depends on timing.
    pub(crate) fn new(size: [u32; 2], order: &[u32], rects: &[Rect]) -> Self {
        let [columns, rows] = size.map(|side| (side as usize).div_ceil(TILE));
        let rows_per_band = rows.div_ceil(rayon::current_num_threads()).max(1);
        let bands = (0..rows.div_ceil(rows_per_band))
            .into_par_iter()
            .map(|band| {
                let first = band * rows_per_band;
                Band::new(columns, first..rows.min(first + rows_per_band), order, rects)
            })
            .collect();
        Self { columns, rows, bands, rows_per_band }
    }

    /// The records of a tile.
    pub(crate) fn tile(&self, column: usize, row: usize) -> &[u32] {
        let band = &self.bands[row / self.rows_per_band];
        let index = (row % self.rows_per_band) * self.columns + column;
        &band.entries[band.starts[index]..band.starts[index + 1]]
    }
}

impl Band {
    fn new(columns: usize, rows: Range<usize>, order: &[u32], rects: &[Rect]) -> Self {
        let tiles = |rect: &Rect| {
            let top = (rect.min[1] as usize / TILE).max(rows.start);
            let bottom = (rect.max[1] as usize).div_ceil(TILE).min(rows.end);
            let (left, right) = (rect.min[0] as usize / TILE, (rect.max[0] as usize).div_ceil(TILE));
            let first_row = rows.start;
            (top..bottom.max(top))
                .flat_map(move |row| (left..right).map(move |c| (row - first_row) * columns + c))
        };
        let mut starts = vec![0_usize; columns * rows.len() + 1];
        for index in order {
            for tile in tiles(&rects[*index as usize]) {
                starts[tile + 1] += 1;
            }
        }
        for tile in 1..starts.len() {
            starts[tile] += starts[tile - 1];
        }
        let mut next = starts.clone();
        let mut entries = vec![0; starts[starts.len() - 1]];
        for index in order {
            for tile in tiles(&rects[*index as usize]) {
                entries[next[tile]] = *index;
                next[tile] += 1;
            }
        }
        Self { starts, entries }
    }
}
