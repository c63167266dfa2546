//! Samples by cubes, so that what lies around a place is found.

use super::patch::Sample;
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Bits of a cube's place along an axis.
const BITS: u32 = 21;

/// Samples, sorted into cubes.
pub(super) struct Neighborhood<'a> {
    pub(super) samples: &'a [Sample],
    /// Keys of cubes, in order, and where each one's indices begin.
    keys: Vec<u64>,
    begins: Vec<u32>,
    indices: Vec<u32>,
    low: DVec3,
    side: f64,
    /// The farthest cube.
    last: IVec3,
}

/// Cubes of one x and y are consecutive, by z.
fn key(x: i32, y: i32, z: i32) -> u64 {
    (x as u64) << (2 * BITS) | (y as u64) << BITS | z as u64
}

impl<'a> Neighborhood<'a> {
    /// Cubes have a side of so many mean distances between samples.
    pub(super) fn new(samples: &'a [Sample], side: f64) -> Self {
        let infinite = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0);
        let (low, high, area) = samples
            .iter()
            .fold(infinite, |(low, high, area), s| (low.min(s.center), high.max(s.center), area + s.area));
        // At most 2²⁰ cubes along an axis; a cloud of no area is one cube.
        let spacing = (area / samples.len().max(1) as f64).sqrt();
        let least = (high - low).max_element() * 2.0_f64.powi(-20);
        let side = (side * spacing).max(least).max(f64::MIN_POSITIVE);
        let last = ((high - low).max(DVec3::ZERO) / side).as_ivec3();
        let keyed = |(index, s): (usize, &Sample)| {
            let [x, y, z] = ((s.center - low) / side).as_ivec3().to_array();
            (key(x, y, z), index as u32)
        };
        let mut keyed: Vec<(u64, u32)> = samples.par_iter().enumerate().map(keyed).collect();
        keyed.par_sort_unstable();
        let (mut keys, mut begins) = (Vec::new(), Vec::new());
        for (at, (key, _)) in keyed.iter().enumerate() {
            if keys.last() != Some(key) {
                keys.push(*key);
                begins.push(at as u32);
            }
        }
        let indices = keyed.into_iter().map(|(_, index)| index).collect();
        Self { samples, keys, begins, indices, low, side, last }
    }

    /// Numbers of the cubes.
    pub(super) fn cubes(&self) -> Range<usize> {
        0..self.keys.len()
    }

    /// Indices of a cube's samples.
    pub(super) fn indices(&self, cube: usize) -> &[u32] {
        let end = self.begins.get(cube + 1).map_or(self.indices.len(), |begin| *begin as usize);
        &self.indices[self.begins[cube] as usize..end]
    }

    /// Numbers of the cubes that a box around `center` touches.
    pub(super) fn touched(&self, center: DVec3, reach: DVec3) -> impl Iterator<Item = usize> + '_ {
        let place = |p: DVec3| ((p - self.low) / self.side).floor().as_ivec3().clamp(IVec3::ZERO, self.last);
        let (low, high) = (place(center - reach), place(center + reach));
        // Boxes of more rows than there are cubes touch all of them, for all that matters.
        let rows = (high.x - low.x + 1) as usize * (high.y - low.y + 1) as usize;
        let is_vast = rows > self.keys.len();
        let all = if is_vast { self.cubes() } else { 0..0 };
        let columns = if is_vast { 0..0 } else { low.x..high.x + 1 };
        let rows = columns.flat_map(move |x| (low.y..=high.y).map(move |y| (x, y)));
        let listed = rows.flat_map(move |(x, y)| {
            let (from, to) = (key(x, y, low.z), key(x, y, high.z));
            let first = self.keys.partition_point(|key| *key < from);
            let count = self.keys[first..].iter().take_while(|key| **key <= to).count();
            first..first + count
        });
        all.chain(listed)
    }
}
