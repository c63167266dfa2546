//! The surfels of a block of cells, number by number.

use oblate_engine::{SurfelPlaces, SurfelRows};

use super::lanes::*;
use super::surfel::{IsoSurfel, NUMBERS};

/// Surfels for which there is room in a chunk: 5 KiB, of which half is empty in the last one of each block on average.
const ROOM: usize = 128;

/// Surfels that are written where they stay, chunk after chunk.
#[derive(Debug, Default)]
pub(super) struct Block {
    chunks: Vec<Chunk>,
    /// Chunks in use: the others are there to be used again.
    used: usize,
}

impl Clone for Block {
    fn clone(&self) -> Self {
        Self { chunks: self.chunks().to_vec(), used: self.used }
    }
}

impl PartialEq for Block {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl Block {
    pub(super) fn clear(&mut self) {
        self.used = 0;
    }

    /// Its surfels, which are in the chunks one after the other.
    pub(super) fn chunks(&self) -> &[Chunk] {
        &self.chunks[..self.used]
    }

    pub(super) fn len(&self) -> usize {
        self.chunks().iter().map(Chunk::len).sum()
    }

    #[inline]
    pub(super) fn iter(&self) -> impl Iterator<Item = IsoSurfel> + '_ {
        self.chunks().iter().flat_map(|chunk| chunk.since(0))
    }

    /// Appends those that `is_there` tells.
    #[inline(always)]
    pub(super) fn push<S: Simd>(&mut self, numbers: &[F<S>; NUMBERS], is_there: M<S>) {
        let has_room = |chunk: &Chunk| chunk.len + F::<S>::LEN <= ROOM;
        if !self.chunks().last().is_some_and(has_room) {
            self.begin();
        }
        if let Some(chunk) = self.chunks[..self.used].last_mut() {
            chunk.push::<S>(numbers, is_there);
        }
    }

    /// Another chunk.
    #[cold]
    #[inline(never)]
    fn begin(&mut self) {
        match self.chunks.get_mut(self.used) {
            Some(chunk) => chunk.len = 0,
            None => self.chunks.push(Chunk::default()),
        }
        self.used += 1;
    }
}

impl FromIterator<IsoSurfel> for Block {
    fn from_iter<I: IntoIterator<Item = IsoSurfel>>(surfels: I) -> Self {
        let mut block = Self::default();
        for surfel in surfels {
            if block.chunks().last().is_none_or(|chunk| chunk.len == ROOM) {
                block.begin();
            }
            if let Some(chunk) = block.chunks.last_mut() {
                for (row, number) in chunk.numbers.iter_mut().zip(surfel.numbers()) {
                    row[chunk.len] = number;
                }
                chunk.len += 1;
            }
        }
        block
    }
}

/// Some surfels, each of their numbers in a row of its own, as [`IsoSurfel::new`] takes them.
#[derive(Clone, Debug)]
pub(super) struct Chunk {
    len: usize,
    numbers: Box<[[f32; ROOM]; NUMBERS]>,
}

impl Default for Chunk {
    fn default() -> Self {
        Self { len: 0, numbers: bytemuck::zeroed_box() }
    }
}

impl Chunk {
    pub(super) fn len(&self) -> usize {
        self.len
    }

    pub(super) fn areas(&self) -> &[f32] {
        &self.numbers[NUMBERS - 1][..self.len]
    }

    /// All from one on.
    #[inline]
    pub(super) fn since(&self, first: usize) -> impl Iterator<Item = IsoSurfel> + '_ {
        let rows = self.numbers.each_ref().map(|row| &row[..self.len]);
        (first..self.len).map(move |i| IsoSurfel::new(rows.map(|row| row[i])))
    }

    /// Puts all from one on in places of a cloud, of a thickness that makes their radius so many times as long.
    pub(super) fn put(&self, first: usize, flattening: f32, places: &mut SurfelPlaces) {
        let mut through = [[0.0; ROOM]; 3];
        let is_flat = flattening == f32::INFINITY;
        if !is_flat {
            for (place, surfel) in self.since(first).enumerate() {
                let half_axis = surfel.factor(flattening).z_axis.to_array();
                for (row, number) in through.iter_mut().zip(half_axis) {
                    row[place] = number;
                }
            }
        }
        let [x, y, z, half_axes @ .., areas] = self.numbers.each_ref().map(|row| &row[first..self.len]);
        places.put(&SurfelRows {
            centers: [x, y, z],
            half_axes,
            through: (!is_flat).then(|| through.each_ref().map(|row| &row[..areas.len()])),
            areas,
            colors: [&[]; 3],
        });
    }

    /// Appends some, where there is room for a register.
    #[inline(always)]
    fn push<S: Simd>(&mut self, numbers: &[F<S>; NUMBERS], is_there: M<S>) {
        let len = self.len;
        // Nearly always all are there, and not every processor can pack lanes by itself.
        if is_there.all_true() {
            for (row, numbers) in self.numbers.iter_mut().zip(numbers) {
                numbers.store_slice(&mut row[len..][..F::<S>::LEN]);
            }
            self.len += F::<S>::LEN;
        } else {
            for (row, numbers) in self.numbers.iter_mut().zip(numbers) {
                numbers.compress(is_there).store_slice(&mut row[len..][..F::<S>::LEN]);
            }
            self.len += is_there.to_bitmask().count_ones() as usize;
        }
    }
}
