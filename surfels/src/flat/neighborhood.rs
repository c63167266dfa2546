//! Samples by cubes, so that what lies around a place is found.

use super::patch::Sample;
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Samples, sorted into cubes.
pub(super) struct Neighborhood<'a> {
    pub(super) samples: &'a [Sample],
    /// Which cube, and where its indices begin; in order, and the end behind the last.
    cubes: Vec<(IVec3, u32)>,
    indices: Vec<u32>,
    low: DVec3,
    side: f64,
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
        let side =
            (side * spacing).max((high - low).max_element() * 2.0_f64.powi(-20)).max(f64::MIN_POSITIVE);
        let cube = |s: &Sample| ((s.center - low) / side).as_ivec3();
        let mut keyed: Vec<(IVec3, u32)> =
            samples.par_iter().enumerate().map(|(index, s)| (cube(s), index as u32)).collect();
        keyed.par_sort_unstable_by_key(|(cube, index)| (cube.to_array(), *index));
        let mut cubes: Vec<(IVec3, u32)> = Vec::new();
        for (at, (cube, _)) in keyed.iter().enumerate() {
            if cubes.last().is_none_or(|(last, _)| last != cube) {
                cubes.push((*cube, at as u32));
            }
        }
        let indices = keyed.into_iter().map(|(_, index)| index).collect();
        Self { samples, cubes, indices, low, side }
    }

    /// Numbers of the cubes.
    pub(super) fn cubes(&self) -> Range<usize> {
        0..self.cubes.len()
    }

    /// Indices of a cube's samples.
    pub(super) fn indices(&self, cube: usize) -> &[u32] {
        let end = self.cubes.get(cube + 1).map_or(self.indices.len(), |(_, begin)| *begin as usize);
        &self.indices[self.cubes[cube].1 as usize..end]
    }

    /// Numbers of the cubes that a box around `center` touches.
    pub(super) fn touched(&self, center: DVec3, reach: DVec3) -> impl Iterator<Item = usize> + '_ {
        let [low, high] =
            [center - reach, center + reach].map(|p| ((p - self.low) / self.side).floor().as_ivec3());
        let rows = (low.x..=high.x).flat_map(move |x| (low.y..=high.y).map(move |y| [x, y]));
        rows.flat_map(move |[x, y]| {
            let from = [x, y, low.z];
            let first = self.cubes.partition_point(|(cube, _)| cube.to_array() < from);
            (first..self.cubes.len()).take_while(move |number| {
                let cube = self.cubes[*number].0;
                [cube.x, cube.y] == [x, y] && cube.z <= high.z
            })
        })
    }
}
