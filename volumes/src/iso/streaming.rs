//! Grids that do not fit into memory, some slices at a time.

use std::ops::Range;

use super::extractor::{find, geometry};
use super::hierarchy::Hierarchy;
use super::slab::with_slab;
use super::window::HALO;
use super::{Interpolation, IsoError, IsoSurfels, cells::Search};
use crate::volume::{GridFrame, Voxels};

/// Slices of cells that are searched at a time: two blocks.
const THICKNESS: usize = 64;

/// A grid whose samples are elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Samples along x, y, z.
    pub dims: [usize; 3],
    /// Where they lie.
    pub frame: GridFrame,
}

/// The surfels of [`iso_surfels`](super::iso_surfels) of a grid of which only some slices are in memory: at most 69.
///
/// `read` gives the samples of a range of slices, x fastest, then y, then z, and is called for one range after the other; neighbouring
/// ranges share five slices. `each` gets the surfels of 64 slices of cells at a time, those of each in Morton order of bricks; they are
/// the same as those of the whole grid, and relative to its sample (0, 0, 0). The surface is closed from where all its
/// parts are: [`Closed::and`](oblate_engine::Closed::and).
///
/// # Errors
/// When `value` is not finite, single precision has no room for the grid's lengths or areas, or `read` gives another number
/// of samples than was asked for; and what `read` and `each` return.
pub fn stream_iso_surfels<E: From<IsoError>>(
    grid: &Grid,
    value: f32,
    interpolation: Interpolation,
    mut read: impl FnMut(Range<usize>) -> Result<Voxels, E>,
    mut each: impl FnMut(&IsoSurfels) -> Result<(), E>,
) -> Result<(), E> {
    let Grid { dims, frame } = *grid;
    let geometry = geometry(frame, dims, value)?;
    let mut surfels = IsoSurfels { frame, ..IsoSurfels::default() };
    let last = dims[2].saturating_sub(1);
    for begin in (0..last).step_by(THICKNESS) {
        let end = (begin + THICKNESS).min(last);
        let slices = begin.saturating_sub(HALO)..(end + 1 + HALO).min(dims[2]);
        let first = slices.start;
        let expected = dims[0] * dims[1] * slices.len();
        let voxels = read(slices)?;
        if voxels.len() != expected {
            return Err(IsoError::Slices { expected, found: voxels.len() }.into());
        }
        with_slab!(&voxels, dims, first, slab => {
            let hierarchy = Hierarchy::new(slab, [begin, end]);
            let search = Search::new(slab, &hierarchy, &geometry, (value, interpolation));
            surfels.closed = find(&search, &mut surfels.blocks).closed(frame, dims);
        });
        each(&surfels)?;
    }
    Ok(())
}
