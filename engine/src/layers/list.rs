//! Records that a layer may have samples of, and these.

use crate::raster::Surfels;
use crate::tile::Plane;

/// Records of a block. There is room before a batch comes: in a loop in which it might grow nothing would stay in registers.
#[derive(Default)]
pub(super) struct List {
    /// Behind those that are used there is old content.
    room: Vec<Listed>,
    pub(super) used: usize,
}

impl List {
    /// Room for as many more.
    #[inline(always)]
    pub(super) fn room(&mut self, count: usize) -> &mut [Listed] {
        if self.used + count > self.room.len() {
            self.room.resize(self.used + count, Listed::NONE);
        }
        &mut self.room[self.used..][..count]
    }

    #[inline(always)]
    pub(super) fn all(&self) -> &[Listed] {
        &self.room[..self.used]
    }
}

/// A record of a block and its samples, which are taken once a layer.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Listed {
    /// z of the samples.
    pub(super) depth: Plane,
    /// Their weights; 0 where there is none behind the layers before.
    pub(super) weight: Plane,
    /// Its place in the tile.
    pub(super) batch: u32,
    pub(super) number: u32,
    /// Its spans begin behind this.
    pub(super) nearest: f32,
}

impl Listed {
    const NONE: Self =
        Self { depth: Plane::ZERO, weight: Plane::ZERO, batch: 0, number: 0, nearest: f32::INFINITY };

    /// Its batch, and its number there.
    #[inline(always)]
    pub(super) fn of(self, batches: &[Surfels]) -> (&Surfels, usize) {
        (&batches[self.batch as usize], self.number as usize)
    }
}
